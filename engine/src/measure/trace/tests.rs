use std::collections::{HashMap, HashSet};

use super::*;

fn pass(name: &str, queue: &'static str, gpu_ns: Option<u64>) -> PassTime {
    PassTime { name: name.to_owned(), queue, gpu_ns, cpu_ns: 1_000, ..PassTime::default() }
}

/// A time in whole nanoseconds.
fn ns(event: &Value, key: &str) -> u64 {
    let micros = event[key].as_f64().unwrap_or_else(|| panic!("{key} of {event}"));
    assert!(micros.is_finite() && micros >= 0.0, "{key} of {event}");
    (micros * 1e3).round() as u64
}

/// Name, start and end of the spans on a lane.
fn spans(trace: &Value, process: u32, lane: usize) -> Vec<(String, u64, u64)> {
    let events = trace["traceEvents"].as_array().unwrap();
    let inside = events.iter().filter(|e| e["ph"] == "X" && e["pid"] == process && e["tid"] == lane);
    inside.map(|e| (e["name"].as_str().unwrap().to_owned(), ns(e, "ts"), ns(e, "ts") + ns(e, "dur"))).collect()
}

fn begins(trace: &Value, process: u32, lane: usize) -> Vec<u64> {
    spans(trace, process, lane).into_iter().map(|(_, begin, _)| begin).collect()
}

fn lanes(trace: &Value, process: u32) -> Vec<String> {
    let events = trace["traceEvents"].as_array().unwrap();
    let named = events.iter().filter(|e| e["name"] == "thread_name" && e["pid"] == process);
    named.map(|e| e["args"]["name"].as_str().unwrap().to_owned()).collect()
}

/// Checks the rules of the Trace Event Format that Perfetto's importer depends on: known phases with their fields, sorted times, spans of
/// a lane that are nested or disjoint, names for every process and lane, and arrows in pairs whose ends are inside spans.
fn assert_keeps_to_the_format(trace: &Value) {
    let text = trace.to_string();
    let read: Value = serde_json::from_str(&text).unwrap();
    let events = read["traceEvents"].as_array().unwrap();
    let (mut named, mut last) = (HashSet::new(), 0);
    let mut open: HashMap<(u64, u64), Vec<u64>> = HashMap::new();
    let mut arrows: HashMap<u64, Vec<(&str, u64)>> = HashMap::new();
    for event in events {
        let place = (event["pid"].as_u64().unwrap(), event["tid"].as_u64().unwrap());
        let name = event["name"].as_str().unwrap();
        if event["ph"] == "M" {
            match name {
                "process_name" | "thread_name" => {
                    assert!(!event["args"]["name"].as_str().unwrap().is_empty(), "{event}");
                    assert!(named.insert((name.to_owned(), place)), "twice: {event}");
                }
                "process_sort_index" | "thread_sort_index" => assert!(event["args"]["sort_index"].is_u64(), "{event}"),
                _ => panic!("unknown: {event}"),
            }
            continue;
        }
        assert!(named.contains(&("thread_name".to_owned(), place)), "no name: {event}");
        assert!(named.contains(&("process_name".to_owned(), (place.0, 0))), "no process: {event}");
        let at = ns(event, "ts");
        assert!(at >= last, "back in time: {event}");
        last = at;
        let around = open.entry(place).or_default();
        match event["ph"].as_str().unwrap() {
            "X" => {
                let end = at + ns(event, "dur");
                around.retain(|outer| *outer > at);
                assert!(around.iter().all(|outer| *outer >= end), "crosses another span: {event}");
                around.push(end);
                assert!(event["args"].is_object(), "{event}");
            }
            phase @ ("s" | "f") => {
                assert!(around.iter().any(|outer| *outer > at), "no span around: {event}");
                assert!(event["cat"].is_string() && (phase == "s" || event["bp"] == "e"), "{event}");
                arrows.entry(event["id"].as_u64().unwrap()).or_default().push((phase, at));
            }
            phase => panic!("phase {phase}: {event}"),
        }
    }
    for (id, ends) in arrows {
        assert!(matches!(ends[..], [("s", from), ("f", to)] if from <= to), "arrow {id}: {ends:?}");
    }
}

#[test]
fn lanes_hold_spans_that_do_not_overlap() {
    let frame = FrameSample {
        gpu_ns: Some(9_000),
        cpu_ns: 4_000,
        plan_ns: 500,
        record_ns: 1_500,
        passes: vec![
            pass("a", "graphics", Some(5_000)),
            pass("b", "async compute", Some(4_000)),
            pass("c", "graphics", Some(4_000)),
            pass("d", "graphics", None),
        ],
        ..FrameSample::default()
    };
    let trace = chrome_trace(&[frame.clone(), frame]);
    assert_keeps_to_the_format(&trace);
    assert_eq!(spans(&trace, CPU, THREADS).len(), 8);
    assert_eq!(spans(&trace, GPU, 1).len(), 4);
    assert_eq!(spans(&trace, GPU, 2), [("b".to_owned(), 2_000, 6_000), ("b".to_owned(), 13_000, 17_000)]);
    assert_eq!(lanes(&trace, CPU), ["frame", "phases", "record"]);
    assert_eq!(lanes(&trace, GPU), ["frame", "graphics", "async compute"]);
}

#[test]
fn phases_follow_each_other_inside_of_the_frame() {
    let frame = FrameSample {
        start_ns: Some(50_000),
        cpu_ns: 21_500,
        declare_ns: 1_000,
        plan_ns: 2_000,
        bind_ns: 3_000,
        record_ns: 4_000,
        submit_ns: 5_000,
        wait_ns: 6_000,
        ..FrameSample::default()
    };
    let trace = chrome_trace(&[frame]);
    assert_keeps_to_the_format(&trace);
    assert_eq!(spans(&trace, CPU, FRAMES), [("frame 0".to_owned(), 49_000, 70_500)]);
    let phases = spans(&trace, CPU, PHASES);
    let wanted = [
        ("declare", 49_000, 50_000),
        ("plan", 50_000, 52_000),
        ("bind", 52_000, 55_000),
        ("record", 55_000, 59_000),
        ("submit", 59_000, 64_000),
        ("wait", 64_000, 70_000),
    ];
    assert_eq!(phases, wanted.map(|(name, begin, end)| (name.to_owned(), begin, end)));
}

#[test]
fn a_frame_in_flight_ends_with_its_submission_and_is_waited_for_later() {
    let frame = |start_ns, wait_start_ns, wait_ns| FrameSample {
        start_ns: Some(start_ns),
        cpu_ns: 3_500 + wait_ns,
        declare_ns: 1_000,
        record_ns: 2_000,
        submit_ns: 500,
        wait_ns,
        wait_start_ns: Some(wait_start_ns),
        ..FrameSample::default()
    };
    // The second frame is declared, recorded and submitted before the first is waited for.
    let trace = chrome_trace(&[frame(1_000, 7_000, 2_000), frame(4_500, 9_500, 100)]);
    assert_keeps_to_the_format(&trace);
    let frames = [("frame 0", 0, 3_500), ("frame 1", 3_500, 7_000)];
    assert_eq!(spans(&trace, CPU, FRAMES), frames.map(|(name, begin, end)| (name.to_owned(), begin, end)));
    let waits: Vec<_> = spans(&trace, CPU, PHASES).into_iter().filter(|(name, ..)| name == "wait").collect();
    assert_eq!(waits, [("wait".to_owned(), 7_000, 9_000), ("wait".to_owned(), 9_500, 9_600)]);
}

#[test]
fn each_thread_that_records_has_a_lane() {
    let on = |name: &str, thread, start| PassTime { thread, cpu_start_ns: Some(start), ..pass(name, "graphics", None) };
    let passes = vec![on("a", 3, 0), on("b", 3, 1_000), on("c", 1, 200)];
    let trace = chrome_trace(&[FrameSample { cpu_ns: 3_000, passes, ..FrameSample::default() }]);
    assert_keeps_to_the_format(&trace);
    assert_eq!(lanes(&trace, CPU), ["frame", "phases", "record 1", "record 2"]);
    assert_eq!(begins(&trace, CPU, THREADS), [0, 1_000]);
    assert_eq!(begins(&trace, CPU, THREADS + 1), [200]);
}

#[test]
fn arrows_show_which_queue_waited_for_which() {
    let at = |name: &str, queue, start, end: u64| PassTime {
        gpu_start_ns: Some(start),
        ..pass(name, queue, Some(end - start))
    };
    let frame = FrameSample {
        gpu_ns: Some(9_000),
        cpu_ns: 20_000,
        passes: vec![
            at("draw", "graphics", 0, 3_000),
            at("ao", "async compute", 3_000, 8_000),
            at("empty", "async compute", 8_000, 8_000),
            at("join", "graphics", 8_500, 9_000),
        ],
        // The last wait has an end outside any span, and one refers to a pass that does not exist: neither makes an arrow.
        waits: vec![(0, 1), (1, 3), (2, 3), (9, 3)],
        ..FrameSample::default()
    };
    let trace = chrome_trace(&[frame]);
    assert_keeps_to_the_format(&trace);
    let events = trace["traceEvents"].as_array().unwrap();
    let ends = |phase: &str| -> Vec<(u64, u64)> {
        let of_phase = events.iter().filter(|e| e["ph"] == phase);
        of_phase.map(|e| (e["tid"].as_u64().unwrap(), ns(e, "ts"))).collect()
    };
    assert_eq!(ends("s"), [(1, 0), (2, 3_000)]);
    assert_eq!(ends("f"), [(2, 3_000), (1, 8_500)]);
}

#[test]
fn a_calibrated_gpu_begins_when_it_does() {
    let passes = vec![pass("a", "graphics", Some(1_000))];
    let frame = FrameSample { gpu_begin_ns: Some(7_000), gpu_ns: Some(1_000), passes, ..FrameSample::default() };
    // The clock reading of the second frame is slightly early, but the device executes one frame after the other.
    let early = FrameSample { gpu_begin_ns: Some(7_600), ..frame.clone() };
    let trace = chrome_trace(&[frame, early]);
    assert_keeps_to_the_format(&trace);
    for lane in [FRAMES, QUEUES] {
        assert_eq!(begins(&trace, GPU, lane), [7_000, 8_000]);
    }
}

#[test]
fn times_of_the_pass_win() {
    let timed = PassTime { gpu_start_ns: Some(2_000), cpu_start_ns: Some(3_000), ..pass("a", "graphics", Some(1_000)) };
    let frame = FrameSample {
        start_ns: Some(10_000),
        cpu_ns: 9_000,
        record_ns: 1_000,
        passes: vec![timed],
        ..FrameSample::default()
    };
    let trace = chrome_trace(&[frame]);
    assert_keeps_to_the_format(&trace);
    assert_eq!(begins(&trace, CPU, THREADS), [13_000]);
    assert_eq!(begins(&trace, GPU, QUEUES), [13_000]);
}

#[test]
fn the_check_of_the_format_finds_mistakes() {
    let passes = vec![pass("a", "graphics", Some(5_000)), pass("b", "graphics", Some(4_000))];
    let good = chrome_trace(&[FrameSample { gpu_ns: Some(9_000), cpu_ns: 4_000, passes, ..FrameSample::default() }]);
    assert_keeps_to_the_format(&good);
    let broken: [fn(&mut Vec<Value>); 5] = [
        |events| events.retain(|e| e["name"] != "process_name"),
        |events| events.retain(|e| e["name"] != "thread_name"),
        |events| events.iter_mut().filter(|e| e["name"] == "a").for_each(|e| e["dur"] = json!(6.0)),
        |events| events.reverse(),
        |events| {
            events.push(json!({ "ph": "s", "name": "wait", "cat": "wait", "id": 1, "pid": 2, "tid": 1, "ts": 0.1 }))
        },
    ];
    for (at, breaks) in broken.into_iter().enumerate() {
        let mut bad = good.clone();
        breaks(bad["traceEvents"].as_array_mut().unwrap());
        let found = std::panic::catch_unwind(|| assert_keeps_to_the_format(&bad));
        assert!(found.is_err(), "mistake {at} was not found");
    }
}
