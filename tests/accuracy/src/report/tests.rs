use super::*;
use crate::fixture::{digits, folder, report};
use serde_json::Value;

#[test]
fn rows_hold_medians_and_know_their_place() {
    let report = report();
    let shadows = report.effect("shadows").unwrap();
    let labels: Vec<&str> = shadows.rows.iter().map(|r| r.variant.label.as_str()).collect();
    assert_eq!(labels, ["ray-traced", "ray-traced, rays 16", "ray-traced, rays 1", "off"]);
    // Rounds take 1, 2 and 3 times as long.
    assert_eq!((shadows.rows[0].ms, shadows.rows[0].stage.min_ms, shadows.rows[0].frame_ms), (8.0, 4.0, 40.0));
    assert_eq!(shadows.rows[3].ms, 0.0);
    assert_eq!(
        (shadows.judged_by, shadows.metric, shadows.time_scope),
        (Image::Picture, Metric::FlipLdr, TimeScope::Stage)
    );
    assert!(shadows.rows.iter().all(|r| shadows.is_front(r) && r.rounds == [1, 2, 3] && r.sure > 0.9));
    // Shadows are also judged by their own image.
    assert!(shadows.rows.iter().all(|r| r.is_front(Image::Slot, Metric::Rmse)));
    // 16 bits change the error by less than 1 % and take less time: they are on the front instead of 32.
    let gi = report.effect("gi").unwrap();
    assert_eq!(gi.rows[0].standing[&Image::Slot][&Metric::Relmse], Standing::DominatedBy(1));
    assert!(gi.is_front(&gi.rows[1]) && gi.is_front(&gi.rows[2]));
    assert_eq!(report.run.plan.left_out[0].0, "post");
}

#[test]
fn the_json_has_the_names_that_others_stand_on_and_reads_back() {
    let place = tempfile::tempdir().unwrap();
    let report = report();
    std::fs::create_dir_all(place.path().join(IMAGES)).unwrap();
    report.write(place.path()).unwrap();
    assert_eq!(digits(&Report::read(place.path()).unwrap()), digits(&report));
    let json: Value = serde_json::from_str(&std::fs::read_to_string(place.path().join(REPORT_JSON)).unwrap()).unwrap();
    for path in [
        "/schema",
        "/run/device/name",
        "/run/device/driver",
        "/run/commit",
        "/run/date",
        "/run/size/0",
        "/run/plan/variants/0/slot",
        "/truths/0/standard_error",
        "/truths/0/floor/relmse",
        "/effects/0/slot",
        "/effects/0/metric",
        "/effects/0/rows/0/variant/settings/rays",
        "/effects/0/rows/0/ms",
        "/effects/0/rows/0/spread_ms",
        "/effects/0/rows/0/stage/trace_ms",
        "/effects/0/rows/0/stage/denoise_ms",
        "/effects/0/rows/0/stage/rays_any",
        "/effects/0/rows/0/transient_bytes",
        "/effects/0/rows/0/errors/1/slot/flip_hdr",
        "/effects/0/rows/0/errors/1/picture/relmse",
        "/effects/0/rows/0/standing/slot/rmse",
        "/effects/0/rows/0/standing/picture/flip_ldr",
        "/effects/0/rows/0/sure",
        "/effects/0/rows/0/ms_interval",
        "/effects/0/rows/0/stages_ms/gi",
        "/combination/products/0/0",
    ] {
        assert!(json.pointer(path).is_some_and(|v| !v.is_null()), "{path}");
    }
    assert_eq!(json["schema"], 1);
}

#[test]
fn the_csv_has_a_row_per_variant_and_as_many_fields_in_each() {
    let report = report();
    let csv = report.to_csv();
    let lines: Vec<&str> = csv.lines().collect();
    assert_eq!(lines.len(), 1 + report.run.plan.variants.len());
    // Labels with a comma are quoted.
    let fields = |line: &str| line.split('"').step_by(2).map(|part| part.matches(',').count()).sum::<usize>();
    for line in &lines {
        assert_eq!(fields(line), fields(lines[0]), "{line}");
    }
    assert!(lines[0].starts_with("slot,implementation,settings,default,setup,ms,"));
    assert!(csv.contains("\nshadows,ray-traced,rays=4,true,"), "{csv}");
}

#[test]
fn the_page_needs_no_other_file_and_cannot_be_broken_by_names() {
    let place = tempfile::tempdir().unwrap();
    let mut report = report();
    report.run.scene = "</script><b>".to_owned();
    let setup = &report.run.plan.setups[0].id;
    std::fs::write(place.path().join(format!("{setup}.shadows.png")), b"picture").unwrap();
    let html = report.to_html(place.path()).unwrap();
    assert!(html.contains("cGljdHVyZQ=="), "the picture is inside");
    assert_eq!(html.matches("</script>").count(), 2, "two scripts, and none from a name");
    for outside in ["src=\"http", "href=\"http", "url(", "<link", "@import"] {
        assert!(!html.contains(outside), "{outside}");
    }
}

#[test]
fn a_report_of_a_part_is_refused() {
    let mut part = folder();
    part.measurements.pop();
    let message = Report::build(&part, Path::new("somewhere")).unwrap_err().to_string();
    assert!(message.contains("somewhere: 1 of 24 measurements are missing"), "{message}");
}

#[test]
fn rows_are_judged_at_rest_in_motion_or_by_their_own_image() {
    let mut moved = folder();
    let shadows: Vec<String> =
        moved.run.plan.variants.iter().filter(|v| v.slot == "shadows").map(|v| v.setup.clone()).collect();
    // In motion the most expensive row is the worst.
    for (at, one) in moved.measurements.iter_mut().filter(|m| m.round == 0 && shadows.contains(&m.setup)).enumerate() {
        let mut errors = one.errors.last().unwrap().clone();
        errors.picture.flip_ldr = if at == 1 { 0.9 } else { 0.1 };
        one.moving = Some(errors);
    }
    let build = |image| {
        let mut folder = moved.clone();
        folder.run.judge.image = image;
        Report::build(&folder, Path::new("nowhere")).unwrap()
    };
    let judged = |image| build(image).effects.iter().map(|e| e.judged_by).collect::<Vec<_>>();
    assert_eq!(judged(Image::Picture), [Image::Picture; 2]);
    assert_eq!(judged(Image::Slot), [Image::Slot; 2]);
    // Rows that were not measured in motion are judged at rest.
    assert_eq!(judged(Image::Moving), [Image::Moving, Image::Picture]);
    let report = build(Image::Moving);
    let shadows = report.effect("shadows").unwrap();
    let worst = shadows.rows.iter().find(|r| r.error(Image::Moving).unwrap().flip_ldr > 0.5).unwrap();
    assert!(!shadows.is_front(worst) && worst.is_front(Image::Picture, Metric::FlipLdr));
    assert!(report.table().contains("the picture while the camera moves"), "{}", report.table());
    assert!(report.to_csv().lines().next().unwrap().contains(",moving_flip_ldr,"));
}

#[test]
fn what_another_frame_changes_is_told() {
    let mut two = folder();
    two.run.frames = vec![1, 7, 8];
    for one in two.measurements.iter_mut().filter(|m| m.round == 0) {
        let mut before = one.errors.last().unwrap().clone();
        before.frame = 7;
        before.picture.flip_ldr += 0.01;
        one.errors.insert(1, before);
    }
    let report = Report::build(&two, Path::new("nowhere")).unwrap();
    assert!(report.effects.iter().flat_map(|e| &e.rows).all(|r| (r.error_interval - 0.01).abs() < 1e-9));
}
