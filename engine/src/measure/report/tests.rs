use serde_json::{Value, json};

use super::*;
use crate::measure::{FrameSample, MeasureError, PassTime, Recorder};

fn run() -> Run {
    let mut config = Config::default();
    config.set("stages.shadows=off").unwrap();
    config.set("shadows.cone_degrees=0.5").unwrap();
    Run {
        magpie: "0.1.0".to_owned(),
        commit: "abc".to_owned(),
        device: Device { name: "soft".to_owned(), driver: "mesa 1".to_owned(), kind: "cpu".to_owned() },
        rays: "software".to_owned(),
        scene: "builtin:cornell".to_owned(),
        size: [640, 360],
        config,
    }
}

fn pass(name: &str, gpu_ms: u64) -> PassTime {
    PassTime {
        name: name.to_owned(),
        stage: name.split('.').next().unwrap().to_owned(),
        queue: "graphics",
        gpu_ns: Some(gpu_ms * 1_000_000),
        cpu_ns: 2_500,
        dispatches: 1,
        rays_any: 10,
        ..PassTime::default()
    }
}

fn frame(gpu_ms: u64, passes: Vec<PassTime>) -> FrameSample {
    let memory = Memory { transient_bytes: 1024, ..Memory::default() };
    FrameSample {
        gpu_ns: Some(gpu_ms * 1_000_000),
        cpu_ns: 4_000_000,
        declare_ns: 1_500,
        plan_ns: 500,
        bind_ns: 250,
        record_ns: 2_000,
        submit_ns: 750,
        wait_ns: 3_000,
        passes,
        culled: 1,
        barriers: 7,
        memory,
        acceleration: Acceleration {
            traced: 3,
            outside: 1,
            bottom_bytes: 80,
            uncompacted_bytes: 160,
            top_bytes: 16,
            bottom_ms: 0.5,
            top_ms: 0.25,
            ..Acceleration::default()
        },
        ..FrameSample::default()
    }
}

fn recorder(frames: Vec<FrameSample>, warmup: usize) -> Recorder {
    let mut recorder = Recorder::new(warmup);
    frames.into_iter().for_each(|f| recorder.push(f));
    recorder
}

#[test]
fn json_has_the_documented_names() {
    let frames = vec![frame(99, vec![pass("a.b", 98)]), frame(4, vec![pass("a.b", 2)]), frame(6, vec![pass("a.b", 4)])];
    let report = recorder(frames, 1).report(run()).unwrap();
    let got: Value = serde_json::from_str(&report.to_json().unwrap()).unwrap();
    let wanted = json!({
        "magpie": "0.1.0", "commit": "abc",
        "device": {"name": "soft", "driver": "mesa 1", "kind": "cpu"}, "rays": "software",
        "scene": "builtin:cornell", "size": [640, 360], "frames": 2, "warmup": 1,
        "config": {"stages": {"shadows": "off"}, "shadows": {"cone_degrees": 0.5}},
        "frame": {"gpu_ms": {"median": 5.0, "min": 4.0, "p99": 6.0, "max": 6.0}, "cpu_ms": {"median": 4.0}},
        "graph": {"declare_us": 1.5, "plan_us": 0.5, "bind_us": 0.25, "record_us": 2.0,
                  "submit_us": 0.75, "wait_us": 3.0, "passes": 1, "culled": 1, "barriers": 7, "queues": 1, "overlap_ms": null},
        "memory": {"transient_bytes": 1024, "transient_lower_bound": 0, "transient_unaliased": 0, "history_bytes": 0,
                   "scene_bytes": 0, "acceleration_bytes": 0},
        "acceleration": {"traced": 3, "far": 0, "outside": 1, "small": 0, "bottom_bytes": 80, "uncompacted_bytes": 160,
                         "top_bytes": 16, "bottom_ms": 0.5, "top_ms": 0.25},
        "slots": [],
        "passes": [{"name": "a.b", "stage": "a", "queue": "graphics", "frames": 2,
                    "gpu_ms": {"median": 3.0, "min": 2.0, "p99": 4.0, "max": 4.0}, "cpu_us": 2.5,
                    "rays": {"closest": 0, "any": 10, "screen": 0}, "bytes": 0, "not_finite": 0, "draws": 0, "dispatches": 1}],
    });
    assert_eq!(got, wanted);
}

#[test]
fn what_a_pass_counts_itself_is_reported_by_name() {
    let of = |surfels| PassTime { counts: vec![("surfels", surfels), ("dropped", 0)], ..pass("gi.keep", 1) };
    // In the last frame the pass counts nothing.
    let frames = [9, 4, 5].map(|n| frame(9, vec![of(n)])).into_iter().chain([frame(9, vec![pass("gi.keep", 1)])]);
    let report = recorder(frames.collect(), 0).report(run()).unwrap();
    let json: Value = serde_json::from_str(&report.to_json().unwrap()).unwrap();
    assert_eq!(json["passes"][0]["counts"], json!({ "surfels": 5, "dropped": 0 }));
    let without = recorder(vec![frame(9, vec![pass("a.x", 1)])], 0).report(run()).unwrap();
    let json: Value = serde_json::from_str(&without.to_json().unwrap()).unwrap();
    assert!(json["passes"][0].get("counts").is_none());
}

#[test]
fn what_is_not_finite_is_counted_over_all_frames() {
    let bad = |name, not_finite| PassTime { not_finite, ..pass(name, 1) };
    let frames = vec![
        frame(9, vec![bad("a.x", 0), bad("b.x", 5)]),
        frame(9, vec![bad("a.x", 1), bad("b.x", 0)]),
        frame(9, vec![bad("a.x", 0), bad("b.x", 2)]),
        frame(9, vec![bad("a.x", 0), bad("b.x", 0)]),
    ];
    let recorder = recorder(frames, 1);
    let lines: Vec<String> = recorder.not_finite().iter().map(ToString::to_string).collect();
    assert_eq!(
        lines,
        [
            "b.x left out 7 values that were not finite, in frame 0 and 1 more",
            "a.x left out 1 value that was not finite, in frame 1"
        ]
    );
    let report = recorder.report(run()).unwrap();
    assert_eq!(report.passes.iter().map(|p| p.not_finite).collect::<Vec<_>>(), [1, 2]);
}

#[test]
fn only_warm_up_is_no_report() {
    let error = recorder(vec![frame(1, vec![])], 3).report(run()).unwrap_err();
    assert_eq!(error, MeasureError::NoFrames { seen: 1, warmup: 3 });
}

#[test]
fn passes_may_come_and_go() {
    let frames = vec![
        frame(9, vec![pass("a.x", 1), pass("c.x", 3)]),
        frame(9, vec![pass("a.x", 1), pass("b.x", 2), pass("c.x", 5), pass("c.x", 7)]),
        frame(9, vec![pass("b.x", 4)]),
    ];
    let report = recorder(frames, 0).report(run()).unwrap();
    let rows: Vec<_> = report.passes.iter().map(|p| (p.name.as_str(), p.frames, p.gpu_ms.unwrap().median)).collect();
    assert_eq!(rows, [("a.x", 2, 1.0), ("b.x", 2, 3.0), ("c.x", 2, 4.0), ("c.x #2", 1, 7.0)]);
}

#[test]
fn a_device_without_timestamps_has_null_and_empty_times() {
    let untimed = PassTime { gpu_ns: None, ..pass("a.x", 1) };
    let report = recorder(vec![FrameSample { gpu_ns: None, ..frame(1, vec![untimed]) }], 0).report(run()).unwrap();
    let json: Value = serde_json::from_str(&report.to_json().unwrap()).unwrap();
    assert!(json["frame"]["gpu_ms"].is_null() && json["passes"][0]["gpu_ms"].is_null());
    assert!(report.to_csv().contains("a.x,a,graphics,1,,,,,2.5,"));
}

/// A pass from `start` to `end`, milliseconds, with pipeline statistics.
fn counted(start: u64, end: u64) -> PassTime {
    let statistics = Some(Statistics {
        input_vertices: 3,
        vertex_invocations: 2,
        clipping_primitives: 1,
        fragment_invocations: 40 + start,
        compute_invocations: 64,
    });
    PassTime { gpu_start_ns: Some(start * 1_000_000), statistics, ..pass("a.x", end - start) }
}

#[test]
fn statistics_are_there_when_they_were_counted() {
    let frames = vec![frame(9, vec![counted(1, 2), pass("b.x", 1)]), frame(9, vec![counted(3, 4), pass("b.x", 1)])];
    let report = recorder(frames, 0).report(run()).unwrap();
    let json: Value = serde_json::from_str(&report.to_json().unwrap()).unwrap();
    let wanted = json!({"input_vertices": 3, "vertex_invocations": 2, "clipping_primitives": 1,
                        "fragment_invocations": 42, "compute_invocations": 64});
    assert_eq!(json["passes"][0]["statistics"], wanted);
    assert!(json["passes"][1].get("statistics").is_none());
}

#[test]
fn overlap_is_the_median_of_the_frames() {
    let on = |queue, start, end| PassTime { queue, ..counted(start, end) };
    let two = |end| frame(9, vec![on("graphics", 0, 5), on("async compute", 2, end)]);
    let report = recorder(vec![two(3), two(4), two(9)], 0).report(run()).unwrap();
    assert_eq!(report.graph.overlap_ms, Some(2.0));
    assert_eq!(report.graph.queues, 2);
}

/// The fields of a CSV line, unquoted.
fn fields(line: &str) -> Vec<String> {
    let (mut fields, mut inside) = (vec![String::new()], false);
    let mut letters = line.chars().peekable();
    while let Some(letter) = letters.next() {
        let field = fields.last_mut().unwrap();
        match letter {
            '"' if inside && letters.peek() == Some(&'"') => field.push(letters.next().unwrap()),
            '"' => inside = !inside,
            ',' if !inside => fields.push(String::new()),
            _ => field.push(letter),
        }
    }
    fields
}

#[test]
fn csv_reads_back() {
    let odd = PassTime { name: "odd.\"one\", here".to_owned(), ..pass("x", 3) };
    let report = recorder(vec![frame(9, vec![counted(1, 5), odd])], 0).report(run()).unwrap();
    let graph = serde_json::to_value(report.graph).unwrap();
    let csv = report.to_csv();
    let rows: Vec<_> = csv.lines().map(fields).collect();
    assert_eq!(rows.len(), 3);
    assert_eq!(rows[0], CSV_COLUMNS);
    for (row, pass) in rows[1..].iter().zip(&report.passes) {
        let mut json = serde_json::to_value(pass).unwrap();
        json["graph"] = graph.clone();
        assert_eq!(row.len(), CSV_COLUMNS.len());
        for (column, field) in CSV_COLUMNS.iter().zip(row) {
            let value = column.split('.').fold(&json, |v, name| &v[name]);
            match value {
                Value::String(text) => assert_eq!(text, field, "{column}"),
                Value::Null => assert_eq!(field, "", "{column}"),
                number => assert_eq!(number.as_f64().unwrap(), field.parse::<f64>().unwrap(), "{column}"),
            }
        }
    }
}
