//! Chrome trace of the frames: opens in Perfetto and in chrome://tracing.

use serde_json::{Value, json};

use super::{FrameSample, PassTime};

const CPU: u32 = 1;
const GPU: u32 = 2;
/// Lane of whole frames, in both processes.
const FRAMES: usize = 0;
/// Lane of a frame's phases on the CPU; the lanes of recording threads follow.
const PHASES: usize = 1;
const THREADS: usize = 2;
/// Lane of the first queue on the GPU.
const QUEUES: usize = 1;

/// Trace events of the frames, as JSON. The CPU process has lanes for frames, for their phases, and for each thread that records
/// passes. The GPU process has lanes for frames and for each queue, with arrows where a queue waits for another. Times are in
/// microseconds, and events are sorted by time. If the clocks cannot be compared, the GPU's first timestamp is placed at the end
/// of recording, when the frame is submitted; passes without a start time follow each other.
#[must_use]
pub fn chrome_trace(frames: &[FrameSample]) -> Value {
    let queues = distinct(frames, |p| p.queue);
    let threads = distinct(frames, |p| p.thread);
    let mut trace = Trace { queues: &queues, threads: &threads, spans: Vec::new(), arrows: 0 };
    let (mut cpu_free, mut gpu_free) = (0, 0); // end of the previous frame on either clock
    for (number, frame) in frames.iter().enumerate() {
        let start = frame.start_ns.unwrap_or(cpu_free.max(gpu_free) + frame.declare_ns);
        let recorded = start + frame.plan_ns + frame.bind_ns + frame.record_ns;
        let submitted = frame.gpu_begin_ns.unwrap_or(recorded).max(gpu_free);
        trace.cpu(number, frame, start);
        trace.gpu(number, frame, submitted);
        cpu_free = match frame.wait_start_ns {
            Some(from) => from + frame.wait_ns,
            None => start.saturating_sub(frame.declare_ns) + frame.cpu_ns,
        };
        gpu_free = submitted + frame.gpu_ns.unwrap_or(0);
    }
    let Trace { mut spans, .. } = trace;
    // Longer spans first, so that a span precedes those inside it. Arrows come after the spans that they connect.
    spans.sort_by_key(|e| (e.at_ns, std::cmp::Reverse(e.ns)));

    let mut events = Vec::new();
    process(&mut events, CPU, "CPU");
    lane(&mut events, CPU, FRAMES, "frame");
    lane(&mut events, CPU, PHASES, "phases");
    for at in 0..threads.len() {
        let name = if threads.len() == 1 { "record".to_owned() } else { format!("record {}", at + 1) };
        lane(&mut events, CPU, THREADS + at, &name);
    }
    process(&mut events, GPU, "GPU");
    lane(&mut events, GPU, FRAMES, "frame");
    for (at, queue) in queues.iter().enumerate() {
        lane(&mut events, GPU, QUEUES + at, queue);
    }
    events.extend(spans.into_iter().map(|e| e.json));
    json!({ "displayTimeUnit": "ms", "traceEvents": events })
}

/// The distinct values of a property of passes, in the order in which they occur.
fn distinct<T: PartialEq>(frames: &[FrameSample], of: impl Fn(&PassTime) -> T) -> Vec<T> {
    let mut found = Vec::new();
    for value in frames.iter().flat_map(|f| &f.passes).map(of) {
        if !found.contains(&value) {
            found.push(value);
        }
    }
    found
}

/// The events so far.
struct Trace<'a> {
    queues: &'a [&'static str],
    threads: &'a [u32],
    spans: Vec<Event>,
    arrows: u32,
}

struct Event {
    at_ns: u64,
    /// Duration; `None` for an arrow.
    ns: Option<u64>,
    json: Value,
}

impl Trace<'_> {
    fn cpu(&mut self, number: usize, frame: &FrameSample, start: u64) {
        let (name, barriers) = (format!("frame {number}"), json!({ "barriers": frame.barriers }));
        let declared = start.saturating_sub(frame.declare_ns);
        // Where other frames were submitted before this one was waited for, its span ends with its own submission.
        let submitted_ns = frame.plan_ns + frame.bind_ns + frame.record_ns + frame.submit_ns;
        let ns = if frame.wait_start_ns.is_some() { start - declared + submitted_ns } else { frame.cpu_ns };
        self.span(&name, CPU, FRAMES, declared, ns, barriers);
        let phases = [
            ("declare", start - declared),
            ("plan", frame.plan_ns),
            ("bind", frame.bind_ns),
            ("record", frame.record_ns),
            ("submit", frame.submit_ns),
        ];
        let mut at = declared;
        for (phase, ns) in phases.into_iter().filter(|(_, ns)| *ns > 0) {
            self.span(phase, CPU, PHASES, at, ns, json!({}));
            at += ns;
        }
        if frame.wait_ns > 0 {
            let from = frame.wait_start_ns.unwrap_or(at);
            self.span("wait", CPU, PHASES, from, frame.wait_ns, json!({ "frame": number }));
        }
        let mut next = vec![start + frame.plan_ns + frame.bind_ns; self.threads.len()];
        for pass in &frame.passes {
            let Some(lane) = self.threads.iter().position(|t| *t == pass.thread) else { continue };
            let at = pass.cpu_start_ns.map_or(next[lane], |ns| start + ns);
            self.span(&pass.name, CPU, THREADS + lane, at, pass.cpu_ns, arguments(pass));
            next[lane] = at + pass.cpu_ns;
        }
    }

    fn gpu(&mut self, number: usize, frame: &FrameSample, submitted: u64) {
        if let Some(gpu_ns) = frame.gpu_ns {
            self.span(&format!("frame {number}"), GPU, FRAMES, submitted, gpu_ns, json!({}));
        }
        let mut next = vec![submitted; self.queues.len()];
        // Lane and start of passes that took any time.
        let mut placed = vec![None; frame.passes.len()];
        for (index, pass) in frame.passes.iter().enumerate() {
            let lane = self.queues.iter().position(|q| *q == pass.queue);
            let (Some(gpu_ns), Some(lane)) = (pass.gpu_ns, lane) else { continue };
            let at = pass.gpu_start_ns.map_or(next[lane], |ns| submitted + ns);
            self.span(&pass.name, GPU, QUEUES + lane, at, gpu_ns, arguments(pass));
            next[lane] = at + gpu_ns;
            placed[index] = Some((QUEUES + lane, at)).filter(|_| gpu_ns > 0);
        }
        let place = |index: u32| placed.get(index as usize).copied().flatten();
        for &(before, after) in &frame.waits {
            if let (Some(from), Some(to)) = (place(before), place(after)) {
                self.arrow(from, to);
            }
        }
    }

    fn span(&mut self, name: &str, process: u32, lane: usize, at_ns: u64, ns: u64, arguments: Value) {
        let json = json!({
            "ph": "X", "name": name, "pid": process, "tid": lane,
            "ts": at_ns as f64 / 1e3, "dur": ns as f64 / 1e3, "args": arguments,
        });
        self.spans.push(Event { at_ns, ns: Some(ns), json });
    }

    /// An arrow between two spans of the GPU, each given by its lane and start. It binds to the spans that are open at its ends;
    /// viewers draw it from the end of the first. The format does not allow arrows back in time.
    fn arrow(&mut self, from: (usize, u64), to: (usize, u64)) {
        if from.1 > to.1 {
            return;
        }
        let end = |phase: &str, (lane, at_ns): (usize, u64)| {
            let mut json = json!({
                "ph": phase, "cat": "wait", "name": "wait", "id": self.arrows, "pid": GPU, "tid": lane, "ts": at_ns as f64 / 1e3,
            });
            if phase == "f" {
                json["bp"] = "e".into();
            }
            Event { at_ns, ns: None, json }
        };
        let ends = [end("s", from), end("f", to)];
        self.spans.extend(ends);
        self.arrows += 1;
    }
}

fn arguments(pass: &PassTime) -> Value {
    let mut arguments = json!({
        "stage": pass.stage, "draws": pass.draws, "dispatches": pass.dispatches,
        "rays_closest": pass.rays_closest, "rays_any": pass.rays_any, "rays_screen": pass.rays_screen,
        "not_finite": pass.not_finite,
    });
    for (name, count) in &pass.counts {
        arguments[*name] = json!(count);
    }
    if let Some(statistics) = pass.statistics {
        arguments["statistics"] = json!(statistics);
    }
    arguments
}

fn process(events: &mut Vec<Value>, process: u32, name: &str) {
    events.push(label("process_name", process, FRAMES, json!({ "name": name })));
    events.push(label("process_sort_index", process, FRAMES, json!({ "sort_index": process })));
}

fn lane(events: &mut Vec<Value>, process: u32, lane: usize, name: &str) {
    events.push(label("thread_name", process, lane, json!({ "name": name })));
    events.push(label("thread_sort_index", process, lane, json!({ "sort_index": lane })));
}

fn label(kind: &str, process: u32, lane: usize, arguments: Value) -> Value {
    json!({ "ph": "M", "name": kind, "pid": process, "tid": lane, "args": arguments })
}

#[cfg(test)]
mod tests;
