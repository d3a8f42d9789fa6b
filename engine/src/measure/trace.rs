//! Chrome trace of the frames: opens in Perfetto and in chrome://tracing.

use serde_json::{Value, json};

use super::{FrameSample, PassTime};

const CPU: u32 = 1;
const GPU: u32 = 2;
/// Lane of whole frames in both processes; the lanes of queues follow.
const FRAMES: usize = 0;

/// Trace events of the frames as JSON: a process for the CPU with a lane for frames and one for recording, a process for the GPU with
/// a lane for frames and one for each queue. Times are microseconds. Where the clocks cannot be compared, the GPU's first
/// timestamp is laid at the end of recording, when the frame is submitted; passes without a begin of their own follow each other.
#[must_use]
pub fn chrome_trace(frames: &[FrameSample]) -> Value {
    let mut queues: Vec<&str> = Vec::new();
    for pass in frames.iter().flat_map(|f| &f.passes) {
        if !queues.contains(&pass.queue) {
            queues.push(pass.queue);
        }
    }
    let mut events = vec![
        label("process_name", CPU, FRAMES, "CPU"),
        label("process_name", GPU, FRAMES, "GPU"),
        label("thread_name", CPU, FRAMES, "frame"),
        label("thread_name", CPU, 1, "record"),
        label("thread_name", GPU, FRAMES, "frame"),
    ];
    events.extend(queues.iter().enumerate().map(|(lane, queue)| label("thread_name", GPU, lane + 1, queue)));
    let mut free_ns = 0; // where the frame before ends on both clocks
    for (number, frame) in frames.iter().enumerate() {
        let start = frame.start_ns.unwrap_or(free_ns);
        let submitted = frame.gpu_begin_ns.unwrap_or(start + frame.plan_ns + frame.record_ns);
        free_ns = (start + frame.cpu_ns).max(submitted + frame.gpu_ns.unwrap_or(0));
        let name = format!("frame {number}");
        events.push(span(&name, CPU, FRAMES, start, frame.cpu_ns, json!({ "barriers": frame.barriers })));
        if let Some(gpu_ns) = frame.gpu_ns {
            events.push(span(&name, GPU, FRAMES, submitted, gpu_ns, json!({})));
        }
        let (mut cpu_next, mut gpu_next) = (start + frame.plan_ns, vec![submitted; queues.len()]);
        for pass in &frame.passes {
            let at = pass.cpu_start_ns.map_or(cpu_next, |ns| start + ns);
            events.push(span(&pass.name, CPU, 1, at, pass.cpu_ns, arguments(pass)));
            cpu_next = at + pass.cpu_ns;
            let lane = queues.iter().position(|q| *q == pass.queue);
            if let (Some(gpu_ns), Some(lane)) = (pass.gpu_ns, lane) {
                let at = pass.gpu_start_ns.map_or(gpu_next[lane], |ns| submitted + ns);
                events.push(span(&pass.name, GPU, lane + 1, at, gpu_ns, arguments(pass)));
                gpu_next[lane] = at + gpu_ns;
            }
        }
    }
    json!({ "displayTimeUnit": "ms", "traceEvents": events })
}

fn arguments(pass: &PassTime) -> Value {
    json!({
        "stage": pass.stage, "draws": pass.draws, "dispatches": pass.dispatches,
        "rays_closest": pass.rays_closest, "rays_any": pass.rays_any,
    })
}

fn label(kind: &str, process: u32, lane: usize, name: &str) -> Value {
    json!({ "ph": "M", "name": kind, "pid": process, "tid": lane, "args": { "name": name } })
}

fn span(name: &str, process: u32, lane: usize, start_ns: u64, ns: u64, arguments: Value) -> Value {
    json!({
        "ph": "X", "name": name, "pid": process, "tid": lane,
        "ts": start_ns as f64 / 1e3, "dur": ns as f64 / 1e3, "args": arguments,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pass(name: &str, queue: &'static str, gpu_ns: Option<u64>) -> PassTime {
        PassTime { name: name.to_owned(), queue, gpu_ns, cpu_ns: 1_000, ..PassTime::default() }
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
                pass("b", "async-compute", Some(4_000)),
                pass("c", "graphics", Some(4_000)),
                pass("d", "graphics", None),
            ],
            ..FrameSample::default()
        };
        let trace = chrome_trace(&[frame.clone(), frame]);
        let events = trace["traceEvents"].as_array().unwrap();
        let lane = |pid: u32, tid: u32| -> Vec<(String, f64, f64)> {
            let inside = events.iter().filter(|e| e["ph"] == "X" && e["pid"] == pid && e["tid"] == tid);
            let figure = |e: &Value, key: &str| e[key].as_f64().unwrap();
            inside.map(|e| (e["name"].as_str().unwrap().to_owned(), figure(e, "ts"), figure(e, "dur"))).collect()
        };
        assert_eq!(lane(CPU, 1).len(), 8);
        assert_eq!(lane(GPU, 1).len(), 4);
        assert_eq!(lane(GPU, 2), [("b".to_owned(), 2.0, 4.0), ("b".to_owned(), 13.0, 4.0)]);
        for spans in [lane(CPU, 0), lane(CPU, 1), lane(GPU, 0), lane(GPU, 1)] {
            assert!(spans.windows(2).all(|s| s[0].1 + s[0].2 <= s[1].1), "{spans:?}");
        }
        let names: Vec<_> = events.iter().filter(|e| e["ph"] == "M").map(|e| e["args"]["name"].clone()).collect();
        assert_eq!(names, ["CPU", "GPU", "frame", "record", "frame", "graphics", "async-compute"]);
    }

    #[test]
    fn a_calibrated_gpu_begins_when_it_does() {
        let passes = vec![pass("a", "graphics", Some(1_000))];
        let frame = FrameSample { gpu_begin_ns: Some(7_000), gpu_ns: Some(1_000), passes, ..FrameSample::default() };
        let trace = chrome_trace(&[frame]);
        let on_gpu = |e: &&Value| e["ph"] == "X" && e["pid"] == GPU;
        let starts: Vec<_> = trace["traceEvents"].as_array().unwrap().iter().filter(on_gpu).map(|e| &e["ts"]).collect();
        assert_eq!(starts, [7.0, 7.0]);
    }

    #[test]
    fn times_of_the_pass_win() {
        let timed =
            PassTime { gpu_start_ns: Some(2_000), cpu_start_ns: Some(3_000), ..pass("a", "graphics", Some(1_000)) };
        let frame = FrameSample {
            start_ns: Some(10_000),
            cpu_ns: 9_000,
            record_ns: 1_000,
            passes: vec![timed],
            ..FrameSample::default()
        };
        let trace = chrome_trace(&[frame]);
        let starts: Vec<f64> = trace["traceEvents"]
            .as_array()
            .unwrap()
            .iter()
            .filter(|e| e["ph"] == "X" && e["name"] == "a")
            .map(|e| e["ts"].as_f64().unwrap())
            .collect();
        assert_eq!(starts, [13.0, 13.0]);
    }
}
