//! A quick run of everyone who is built in: it comes to its end, and every frame's result was checked on the way.
#![allow(clippy::unwrap_used, reason = "the helpers of tests fail as tests do")]
use magpie::gpu::{Gpu, GpuOptions};
use magpie_bench::{Options, QUICK_PASSES, Variant, run};
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
fn everyone_writes_what_the_cpu_says() {
    let Some(gpu) = gpu() else { return };
    let report = run(&gpu, &Options::quick(), |_| ()).unwrap_or_else(|error| panic!("{error}"));
    println!("{}", report.table());
    let names: Vec<_> = report.contestants.iter().map(|c| c.name).collect();
    assert!(names.contains(&"floor") && names.iter().any(|n| n.starts_with("magpie")), "{names:?}");
    for name in names {
        let works = report.rows.iter().filter(|row| row.contestant == name).count();
        // The prepared stream of vk-graph takes part with buffers only.
        let variants = if name == "vk-graph prepared" { 1 } else { Variant::ALL.len() };
        assert_eq!(works, QUICK_PASSES.len() * variants, "{name}");
        assert_eq!(report.growth.iter().filter(|g| g.contestant == name).count(), variants, "{name}");
    }
    for row in &report.rows {
        assert!(row.total_us.min > 0.0 && row.total_us.min <= row.total_us.median, "{row:?}");
        assert!(row.cpu_us.is_none_or(|cpu| cpu.min > 0.0), "{row:?}");
        assert!(row.contestant == "floor" || row.allocations_per_frame > 0, "nothing was counted: {row:?}");
    }
    let floor = report.rows.iter().find(|row| row.contestant == "floor").unwrap();
    assert_eq!((floor.allocations_per_frame, floor.barriers_per_pass), (0, Some(1.1)));
    let json: serde_json::Value = serde_json::from_str(&report.to_json().unwrap()).unwrap();
    assert_eq!(json["rows"].as_array().unwrap().len(), report.rows.len());
}
