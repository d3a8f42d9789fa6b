//! A quick run of `magpie bench rays`: everything is measured that should be, and every way meets the same.
#![allow(clippy::unwrap_used, reason = "the helpers of tests fail as tests do")]
use magpie::gpu::{Gpu, GpuOptions};
use magpie::prelude::Rays;
use magpie::scene::{BUILTIN, builtin, supply_missing};
use magpie_bench::rays::{RayOptions, charts, run};
use std::collections::BTreeSet;
use std::env;

fn gpu() -> Option<Gpu> {
    if env::var_os("MAGPIE_NO_GPU").is_some() {
        eprintln!("skipped: MAGPIE_NO_GPU is set");
        return None;
    }
    let options = GpuOptions { device: env::var("MAGPIE_DEVICE").ok(), validation: false, ..GpuOptions::default() };
    Some(Gpu::new(&options).unwrap())
}

#[test]
fn a_quick_run_measures_everything_and_all_ways_meet_the_same() {
    let Some(gpu) = gpu() else { return };
    let mut scenes: Vec<_> = BUILTIN.iter().map(|(name, _)| builtin(name).unwrap()).collect();
    scenes.iter_mut().for_each(supply_missing);
    let ways = gpu.rays();
    let options = RayOptions { ways: ways.clone(), size: Some(2048), quick: true, commit: "test".to_owned() };
    let report = run(&gpu, &scenes, &options, |_| ()).unwrap_or_else(|error| panic!("{error}"));
    println!("{}", report.table());

    // The same rays meet the same, but for surfaces in one place.
    assert_eq!(report.agreement.is_empty(), ways.len() == 1);
    for agreement in &report.agreement {
        assert!(agreement.count >= 1024 || agreement.case.setup == "scene", "{agreement:?}");
        assert!(agreement.share() >= 0.999, "{agreement:?}");
    }

    // The shape of the JSON.
    let json: serde_json::Value = serde_json::from_str(&report.to_json().unwrap()).unwrap();
    for key in
        ["magpie", "commit", "device", "threads", "quick", "size", "rays", "rows", "ratios", "agreement", "left_out"]
    {
        assert!(!json[key].is_null(), "{key}");
    }
    let rows = json["rows"].as_array().unwrap();
    for row in rows {
        for key in ["setup", "subject", "variant", "rays", "quantity", "unit"] {
            assert!(row[key].is_string(), "{key} of {row}");
        }
        let number = |key: &str| row[key].as_f64().unwrap_or_else(|| panic!("{key} of {row}"));
        assert!(number("min") <= number("median") && number("median") <= number("max") && number("samples") >= 1.0);
        assert!(number("median") > 0.0, "{row}");
        let of_rays = ["rate", "sort"].iter().any(|quantity| row["quantity"] == *quantity);
        assert_eq!(of_rays, number("count") > 0.0, "{row}");
    }
    // Every way has a rate in every case that is the same for all.
    let cases = |way: Rays| -> BTreeSet<String> {
        let of = rows.iter().filter(|r| r["quantity"] == "rate" && r["rays"] == way.name());
        let plain = of.filter(|r| {
            let variant = r["variant"].as_str().unwrap();
            !["compacted", "fast build", "refitted", "sorted"].iter().any(|word| variant.contains(word))
        });
        plain.map(|r| format!("{} {} {} {}", r["setup"], r["subject"], r["x"], r["variant"])).collect()
    };
    let software = cases(Rays::Software);
    // Five kinds of ray on each scene, three sizes of two meshes, three counts of two placements, three stops.
    assert_eq!(software.len(), 5 * scenes.len() + 6 + 6 + 3, "{software:?} {:?}", report.left_out);
    for way in ways {
        assert_eq!(cases(way), software, "{way}");
    }
    // The CSV has the same rows.
    let csv = report.to_csv();
    assert_eq!(csv.lines().count(), rows.len() + 1);
    // Every second part between quotes is text.
    let columns = |line: &str| line.split('"').step_by(2).map(|part| part.matches(',').count()).sum::<usize>() + 1;
    assert!(csv.lines().all(|line| columns(line) == 12), "{csv}");

    let drawn = charts(&report).unwrap_or_else(|error| panic!("{error}"));
    let names: Vec<&str> = drawn.iter().map(|(name, _)| name.as_str()).collect();
    assert!(names.contains(&"rays-triangles.svg") && names.contains(&"rays-instances.svg"), "{names:?}");
    assert!(drawn.iter().all(|(_, svg)| svg.starts_with("<svg") && svg.ends_with("</svg>\n")));
}
