//! The viewer under events that nobody would think of, and over thousands of frames.
#![allow(clippy::unwrap_used, reason = "the helpers of tests fail as tests do")]

use std::{
    env, fs,
    path::Path,
    process::{Child, Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use serde_json::{Value, json};

mod window;
use window::{Display, display};

/// PCG hash (Jarzynski and Olano 2020) of a counter: the events of a seed are the same everywhere.
struct Random(u32);

impl Random {
    fn next(&mut self) -> u32 {
        self.0 = self.0.wrapping_add(1);
        let state = self.0.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
        (word >> 22) ^ word
    }

    fn below(&mut self, count: u32) -> u32 {
        self.next() % count
    }

    fn unit(&mut self) -> f64 {
        f64::from(self.next()) / f64::from(u32::MAX)
    }
}

/// One event of mouse or keyboard, or of the window.
fn event(random: &mut Random) -> Value {
    let place = |random: &mut Random| json!([random.unit(), random.unit()]);
    let button =
        |random: &mut Random| ["primary", "primary", "primary", "secondary", "middle"][random.below(5) as usize];
    match random.below(24) {
        0..=8 => json!({"input": {"move": place(random)}}),
        9..=12 => json!({"input": {"press": button(random)}}),
        13..=16 => json!({"input": {"release": button(random)}}),
        17 | 18 => json!({"input": {"wheel": 6.0 * random.unit() - 3.0}}),
        19 => {
            let keys = [
                "F1", "F2", "F3", "F4", "F5", "F7", "F8", "Space", "W", "A", "S", "D", "Q", "E", "Escape", "Enter",
                "Tab",
            ];
            let key = keys[random.below(keys.len() as u32) as usize];
            json!({"input": {"key": key}})
        }
        20 => {
            let text = ["1", "0.5", "-3", "x", "\u{e9}"][random.below(5) as usize];
            json!({"input": {"text": text}})
        }
        21 => json!({"resize": [64 + random.below(400), 48 + random.below(300)]}),
        22 => json!({"compare": random.below(3) == 0}),
        _ => json!({"split": random.unit()}),
    }
}

/// Everything as it was at first, so that memory can be compared.
fn base(frame: u32, steps: &mut Vec<(u32, Value)>) {
    for button in ["primary", "secondary", "middle"] {
        steps.push((frame, json!({"input": {"release": button}})));
    }
    steps.push((frame, json!({"input": {"key": "Escape"}})));
    steps.push((frame + 1, json!({"truth": false})));
    steps.push((frame + 1, json!({"compare": false})));
    steps.push((frame + 1, json!({"config": "base.toml"})));
    steps.push((frame + 1, json!({"resize": [320, 240]})));
    steps.push((frame + 1, json!({"open": "builtin:cornell"})));
}

/// Resident memory of a process, MiB.
fn memory(program: &Child) -> Option<f64> {
    let status = fs::read_to_string(format!("/proc/{}/status", program.id())).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    Some(line.trim().trim_end_matches(" kB").trim().parse::<f64>().ok()? / 1024.0)
}

/// Runs the viewer over these actions, and returns its memory at the marks: the frames at which `mark_N.toml` is written.
fn run(
    display: &Display,
    folder: &Path,
    mut steps: Vec<(u32, Value)>,
    marks: &[u32],
    frames: u32,
    more: &[&str],
) -> Vec<f64> {
    for (number, mark) in marks.iter().enumerate() {
        steps.push((*mark, json!({"save_config": format!("mark_{number}.toml")})));
    }
    let steps: Vec<Value> = steps.iter().map(|(frame, action)| json!({"frame": frame, "do": action})).collect();
    fs::write(folder.join("actions.json"), Value::from(steps).to_string()).unwrap();
    fs::write(folder.join("base.toml"), "[stages]\n").unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_magpie"));
    command.args([
        "view",
        "builtin:cornell",
        "--size",
        "320x240",
        "--time-step",
        "0.02",
        "--quiet",
        "--actions",
        "actions.json",
    ]);
    command.args(["--frames", &frames.to_string()]).args(more);
    if let Ok(device) = env::var("MAGPIE_DEVICE") {
        command.args(["--device", &device]);
    }
    command.env("DISPLAY", display.name()).env_remove("WAYLAND_DISPLAY").env_remove("WAYLAND_SOCKET");
    let mut program = command.current_dir(folder).stderr(Stdio::piped()).spawn().unwrap();
    let mut seen = Vec::new();
    let begun = Instant::now();
    loop {
        if folder.join(format!("mark_{}.toml", seen.len())).exists()
            && let Some(memory) = memory(&program)
        {
            seen.push(memory);
        }
        if program.try_wait().unwrap().is_some() {
            break;
        }
        assert!(begun.elapsed() < Duration::from_secs(3600), "an hour has gone by");
        thread::sleep(Duration::from_millis(5));
    }
    let output = program.wait_with_output().unwrap();
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.success() && message.is_empty(),
        "{:?} after {:?}: {message}",
        output.status,
        begun.elapsed()
    );
    println!("{frames} frames in {:.0} s, MiB at the marks: {seen:.0?}", begun.elapsed().as_secs_f64());
    assert_eq!(seen.len(), marks.len());
    seen
}

fn is_full() -> bool {
    env::var_os("MAGPIE_FULL").is_some()
}

/// Memory at the end is what it was after the first rounds, which fill caches.
fn is_flat(seen: &[f64]) -> bool {
    let (first, last) = (seen[1], seen[seen.len() - 1]);
    last <= 1.05 * first + 8.0
}

/// Random events, in rounds after which all is as at first: no message, and memory stays what it was. With `MAGPIE_FULL` ten minutes.
#[test]
fn events_of_any_kind_do_no_harm() {
    let Some(display) = display() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (rounds, length) = if is_full() { (12, 400) } else { (4, 40) };
    let mut random = Random(20);
    let (mut steps, mut marks) = (Vec::new(), Vec::new());
    for round in 0..rounds {
        let first = round * (length + 20);
        for frame in first..first + length {
            (0..random.below(3)).for_each(|_| steps.push((frame, event(&mut random))));
        }
        base(first + length, &mut steps);
        marks.push(first + length + 16);
    }
    let seen = run(&display, folder.path(), steps, &marks, rounds * (length + 20), &["--check"]);
    assert!(is_flat(&seen), "{seen:?} MiB");
}

/// Frames with changes of size, configuration and scene leak nothing. With `MAGPIE_FULL` ten thousand.
#[test]
fn thousands_of_frames_leak_nothing() {
    let Some(display) = display() else { return };
    let folder = tempfile::tempdir().unwrap();
    let frames = if is_full() { 10_000 } else { 400 };
    let every = frames / 8;
    let changes = [
        "stages.gi=off",
        "stages.reflections=screen-space",
        "post.anti_aliasing=taa",
        "stages.shadows=off",
        "stages.ao=ray-traced",
    ];
    let (mut steps, mut marks) = (Vec::new(), Vec::new());
    let mut random = Random(7);
    // Each change is made once before the mark that the last is compared with: memory grows when something is used for the first time.
    let mut first = changes.into_iter();
    for frame in (0..frames).step_by(10) {
        if frame == 2 * every {
            assert_eq!(first.len(), 0);
        }
        // The last frames of a round are those of the base.
        if frame % every >= every - 20 {
            continue;
        }
        let step = match frame / 10 % 16 {
            0 | 4 | 8 | 12 => json!({"resize": [48 + random.below(64), 48 + random.below(64)]}),
            15 => json!({"config": "base.toml"}),
            _ => json!({"set": first.next().unwrap_or_else(|| changes[random.below(5) as usize])}),
        };
        steps.push((frame, step));
    }
    for round in 0..8 {
        base((round + 1) * every - 20, &mut steps);
        marks.push((round + 1) * every - 2);
    }
    steps.sort_by_key(|step| step.0);
    let seen = run(&display, folder.path(), steps, &marks, frames, &["--no-panels"]);
    assert!(is_flat(&seen), "{seen:?} MiB");
}
