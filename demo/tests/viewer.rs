//! The viewer in a window of a display without a screen: it is opened, used by actions, and closed.
#![allow(clippy::unwrap_used, reason = "the helpers of tests fail as tests do")]

use std::{
    collections::BTreeSet,
    env, fs,
    process::{Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use serde_json::{Value, json};

mod window;
use window::*;

/// One run does all that people do, under all checks: it swaps what fills every slot, hides panels, resizes, minimises, goes to another scene.
#[test]
fn everything_is_done_in_a_window() {
    let Some(display) = display() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut steps =
        vec![(0, json!({"screenshot": "first.png"})), (1, json!("panels")), (3, json!({"screenshot": "bare.png"}))];
    steps.extend([(4, json!("panels")), (4, json!({"panel": "help"})), (5, json!({"screenshot": "help.png"}))]);
    steps.extend([(6, json!({"panel": "help"})), (6, json!({"look_at": [0.5, 0.6]})), (7, json!({"play": false}))]);
    steps.extend([(8, json!({"resize": [500, 350]})), (12, json!({"screenshot": "resized.png"}))]);
    steps.extend([
        (13, json!({"minimise": true})),
        (15, json!({"minimise": false})),
        (16, json!({"save_config": "saved.toml"})),
    ]);
    steps.extend([(17, json!({"set": "stages.gi=nothing"})), (18, json!({"screenshot": "mistake.png"}))]);
    let choices = choices();
    assert!(choices.len() > 40, "{choices:?}");
    let mut frame = 19;
    for choice in &choices {
        steps.push((frame, json!({"set": choice})));
        frame += 1;
        let slot = choice.split_once('=').unwrap().0.strip_prefix("stages.").unwrap();
        steps.push((frame, json!({"reset": slot})));
    }
    steps
        .extend([(frame + 1, json!({"open": "builtin:carousel"})), (frame + 3, json!({"screenshot": "carousel.png"}))]);
    steps.extend([(frame + 4, json!({"screenshot": "radiance.exr"})), (frame + 5, json!({"open": "no_such.glb"}))]);
    let frames = (frame + 8).to_string();
    let script = actions(folder, &steps);
    let arguments =
        ["builtin:cornell", "--actions", script, "--frames", &frames, "--check", "--screenshot", "last.png"];
    let output = view(Some(display.name()), folder, &arguments);
    done(&output);

    let picture = |name: &str| folder.join(name);
    let difference = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f64>();
    // The picture without panels fills the window; with them the bar on top is of one colour, and darker.
    let (bar, middle) = ([0.05, 0.01, 0.95, 0.03], [0.4, 0.4, 0.6, 0.6]);
    assert_eq!(size(&picture("first.png")), [400, 300]);
    assert!(mean(&picture("bare.png"), middle).iter().all(|channel| *channel > 0.02));
    assert!(difference(mean(&picture("first.png"), bar), mean(&picture("bare.png"), bar)) > 0.01);
    assert!(difference(mean(&picture("first.png"), middle), mean(&picture("help.png"), middle)) > 0.01);
    assert_eq!(size(&picture("resized.png")), [500, 350]);
    assert_eq!(size(&picture("last.png")), [500, 350]);
    let beside_the_panel = [0.7, 0.2, 0.95, 0.35];
    let (room, carousel) = (picture("resized.png"), picture("carousel.png"));
    assert!(difference(mean(&room, beside_the_panel), mean(&carousel, beside_the_panel)) > 0.01);
    // Mistakes are shown in red, and nothing else comes of them.
    let row = [0.65, 0.09, 0.95, 0.3];
    let [red, green, _] = mean(&picture("mistake.png"), row);
    let [red_before, green_before, _] = mean(&picture("resized.png"), row);
    assert!(red - green > red_before - green_before + 0.002, "{red} {green}, before {red_before} {green_before}");
    let saved = fs::read_to_string(picture("saved.toml")).unwrap();
    assert!(saved.contains("gi = \"surfels\""), "{saved}");
    assert!(mean(&picture("radiance.exr"), [0.0, 0.0, 1.0, 1.0]).iter().all(|channel| *channel > 0.0));
}

/// Two configurations beside each other: what is edited is on the left of the line, and both can be exchanged.
#[test]
fn two_configurations_are_compared() {
    let Some(display) = display() else { return };
    let folder = tempfile::tempdir().unwrap();
    let steps = [
        (0, json!("panels")),
        (1, json!({"compare": true})),
        (2, json!({"set": "post.exposure=2.5"})),
        (4, json!({"screenshot": "left.png"})),
        (5, json!("swap")),
        (7, json!({"screenshot": "right.png"})),
        (8, json!({"split": 0.1})),
        (9, json!({"screenshot": "most.png"})),
        (10, json!({"resize": [420, 310]})),
        (13, json!({"set": "stages.reflections=off"})),
        (14, json!({"compare": false})),
        (16, json!({"screenshot": "alone.png"})),
    ];
    let script = actions(folder.path(), &steps);
    done(&view(
        Some(display.name()),
        folder.path(),
        &["builtin:cornell", "--actions", script, "--frames", "20", "--check"],
    ));
    let sides = |name: &str| {
        let path = folder.path().join(name);
        // Of the ceiling, which is lit alike on both sides.
        let [left, right] = [[0.3, 0.05, 0.4, 0.1], [0.6, 0.05, 0.7, 0.1]].map(|place| mean(&path, place)[1]);
        right / left
    };
    let [left, right, most, alone] = ["left.png", "right.png", "most.png", "alone.png"].map(sides);
    // What is edited is 5.7 times as bright before the tone curve.
    assert!(right > 10.0 * left, "{left} {right}");
    for same in [most, alone] {
        assert!((2.0 * left..0.5 * right).contains(&same), "{left} {same} {right}");
    }
}

/// What is done by hand can be taken away: the path of the camera, and the times that the profiler shows.
#[test]
fn paths_and_times_are_written() {
    let Some(display) = display() else { return };
    let folder = tempfile::tempdir().unwrap();
    let steps = [
        (0, json!({"record": "path.json"})),
        (8, json!({"look_at": [0.5, 0.8]})),
        (16, json!("stop_recording")),
        (17, json!({"replay": "path.json"})),
        (20, json!({"export": "e.json"})),
        (20, json!({"export": "e.csv"})),
        (20, json!({"export": "e.trace.json"})),
        (21, json!({"export": "e.txt"})),
    ];
    let script = actions(folder.path(), &steps);
    done(&view(Some(display.name()), folder.path(), &["builtin:cornell", "--actions", script, "--frames", "40"]));
    let read = |name: &str| fs::read_to_string(folder.path().join(name)).unwrap();
    let path: Value = serde_json::from_str(&read("path.json")).unwrap();
    let keys = path["keys"].as_array().unwrap();
    let target = |key: usize| keys[key]["camera"]["target"].as_array().unwrap();
    assert!(keys.len() >= 3 && target(0) != target(keys.len() - 1), "{path}");
    let exported: Value = serde_json::from_str(&read("e.json")).unwrap();
    assert!((15..=20).contains(&exported["frames"].as_u64().unwrap()), "{exported}");
    assert!(read("e.csv").contains("overlay.draw"));
    let trace: Value = serde_json::from_str(&read("e.trace.json")).unwrap();
    assert!(trace.to_string().contains("overlay.draw"));
    assert!(!folder.path().join("e.txt").exists());
    // The same path without a window.
    let mut render = Command::new(env!("CARGO_BIN_EXE_magpie"));
    render.args(["render", "builtin:cornell", "--size", "16x12", "--time-step", "0.1", "--quiet"]);
    render.args(["--camera-path", "path.json", "--out", "p_%d.png"]).current_dir(folder.path());
    if let Ok(device) = env::var("MAGPIE_DEVICE") {
        render.args(["--device", &device]);
    }
    done(&render.output().unwrap());
    assert!(folder.path().join("p_3.png").exists());
}

/// The times are those of `--timings` of any run, for every frame that was drawn.
#[test]
fn times_of_a_run_are_written() {
    let Some(display) = display() else { return };
    let folder = tempfile::tempdir().unwrap();
    let output =
        view(Some(display.name()), folder.path(), &["builtin:cornell", "--frames", "5", "--timings", "t.json"]);
    done(&output);
    let times: Value = serde_json::from_str(&fs::read_to_string(folder.path().join("t.json")).unwrap()).unwrap();
    assert_eq!(times["frames"], 5);
    let passes = times["passes"].as_array().unwrap();
    let of = |name: &str| passes.iter().find(|pass| pass["name"] == name).unwrap_or_else(|| panic!("no {name}"));
    assert_eq!(of("overlay.draw")["stage"], "overlay");
    assert!(of("overlay.draw")["gpu_ms"]["median"].as_f64().unwrap() > 0.0);
    assert!(of("overlay.draw")["draws"].as_u64().unwrap() >= 2);
    assert!(of("gbuffer.draw")["gpu_ms"]["median"].as_f64().unwrap() > 0.0);
}

/// The profiler's numbers are those of `--timings` of the same run, to the last digit.
#[test]
fn the_profiler_has_the_numbers_of_timings() {
    let Some(display) = display() else { return };
    let folder = tempfile::tempdir().unwrap();
    let script = actions(folder.path(), &[(30, json!({"export": "shown.json"})), (30, json!({"export": "shown.csv"}))]);
    for ending in ["json", "csv"] {
        let times = format!("all.{ending}");
        let arguments = ["builtin:cornell", "--frames", "30", "--timings", &times, "--actions", script];
        done(&view(Some(display.name()), folder.path(), &arguments));
        let read = |name: &str| fs::read_to_string(folder.path().join(format!("{name}.{ending}"))).unwrap();
        let (shown, all) = (read("shown"), read("all"));
        assert!(all.contains("overlay.draw") && all.len() > 1000, "{all}");
        assert_eq!(shown, all);
    }
}

/// What the panels cost beyond the time of `egui`, and that drawing them is a pass as any other.
#[test]
fn panels_are_cheap() {
    let Some(display) = display() else { return };
    let folder = tempfile::tempdir().unwrap();
    let script = actions(folder.path(), &[(0, json!({"panel": "graph"}))]);
    let arguments = ["builtin:cornell", "--frames", "120", "--actions", script, "--size", "700x500", "--verbose"];
    let output = view(Some(display.name()), folder.path(), &arguments);
    done(&output);
    let log = String::from_utf8_lossy(&output.stderr);
    let line = log.lines().find(|line| line.contains("panels: egui")).unwrap_or_else(|| panic!("{log}"));
    let numbers: Vec<f64> = line.split([' ', ',', ')']).filter_map(|word| word.parse().ok()).collect();
    let [egui, overlay, overlay_mean, statistics, statistics_mean, passes] = numbers[..] else { panic!("{line}") };
    let (beyond, mean) = (overlay + statistics, overlay_mean + statistics_mean);
    assert!(egui > 0.0 && overlay > 0.0 && statistics > 0.0 && passes > 20.0, "{line}");
    println!("{line}");
    // The overlay: 0.3 ms for 100 passes. With what the profiler keeps twice that, and more now and then.
    assert!(overlay < 0.3 * passes / 100.0, "{line}");
    assert!(beyond < 0.6 * passes / 100.0, "{line}");
    assert!(mean < 2.0 * passes / 100.0, "{line}");
}

/// Window, panels, colours and the camera of each scene are as they were the last time.
#[test]
fn the_last_run_is_remembered() {
    let Some(display) = display() else { return };
    let folder = tempfile::tempdir().unwrap();
    let run = |script: &str, arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_magpie"));
        command.args(["view", "builtin:cornell", "--quiet", "--frames", "8", "--actions", script]).args(arguments);
        if let Ok(device) = env::var("MAGPIE_DEVICE") {
            command.args(["--device", &device]);
        }
        command
            .current_dir(folder.path())
            .env("DISPLAY", display.name())
            .env("MAGPIE_STATE", folder.path().join("state"));
        done(&command.env_remove("WAYLAND_DISPLAY").env_remove("WAYLAND_SOCKET").output().unwrap());
    };
    let steps = [
        (0, json!({"panel": "profiler"})),
        (0, json!({"panel": "stages"})),
        (1, json!({"light": true})),
        (2, json!({"look_at": [0.1, 0.9]})),
        (6, json!({"screenshot": "a.png"})),
    ];
    run(actions(folder.path(), &steps), &["--size", "360x240"]);
    run(actions(folder.path(), &[(6, json!({"screenshot": "b.png"}))]), &[]);
    run(actions(folder.path(), &[(6, json!({"screenshot": "c.png"}))]), &["--time-step", "0.02", "--size", "360x240"]);
    assert_eq!(size(&folder.path().join("b.png")), [360, 240]);
    let seen = |name: &str, place: [f64; 4]| mean(&folder.path().join(name), place);
    let differ = |place: [f64; 4], other: &str| {
        seen("a.png", place).iter().zip(seen(other, place)).map(|(a, b)| (a - b).abs()).sum::<f64>()
    };
    // The bar is light, and under it there is the picture alone, from the same place.
    let (bar, left) = ([0.4, 0.01, 0.6, 0.06], [0.02, 0.3, 0.3, 0.9]);
    assert!(seen("b.png", bar).iter().all(|channel| *channel > 0.3), "{:?}", seen("b.png", bar));
    assert!(
        differ(bar, "b.png") < 0.05 && differ(left, "b.png") < 0.05,
        "{} {}",
        differ(bar, "b.png"),
        differ(left, "b.png")
    );
    // A run that is to be repeated remembers nothing.
    assert!(differ(bar, "c.png") > 0.5 && differ(left, "c.png") > 0.05);
    let state: Value =
        serde_json::from_str(&fs::read_to_string(folder.path().join("state/viewer.json")).unwrap()).unwrap();
    assert_eq!((&state["recent"], &state["light"]), (&json!(["builtin:cornell"]), &json!(true)), "{state}");
}

/// The reference gathers samples behind a camera that stands still, and tells configurations apart.
#[test]
fn configurations_are_measured_against_the_reference() {
    let Some(display) = display() else { return };
    let folder = tempfile::tempdir().unwrap();
    let mut steps = vec![(0, json!("panels")), (4, json!({"truth": true})), (24, json!({"export_truth": "a.json"}))];
    steps.extend([(24, json!({"screenshot": "split.png"})), (25, json!({"truth_as": "error"}))]);
    steps.extend([(26, json!({"screenshot": "error.png"})), (27, json!({"set": "stages.gi=off"}))]);
    steps.extend([(34, json!({"export_truth": "b.json"})), (35, json!({"screenshot": "far.png"}))]);
    steps.extend([(36, json!({"look_at": [0.4, 0.4]})), (42, json!({"export_truth": "c.json"}))]);
    steps.extend([
        (43, json!({"truth_as": "split"})),
        (43, json!({"resize": [420, 310]})),
        (50, json!({"truth": false})),
    ]);
    steps.extend([(51, json!({"screenshot": "alone.png"}))]);
    let script = actions(folder.path(), &steps);
    let arguments = ["builtin:cornell", "--actions", script, "--frames", "54", "--check", "--size", "200x150"];
    done(&view(Some(display.name()), folder.path(), &arguments));
    let read =
        |name: &str| -> Value { serde_json::from_str(&fs::read_to_string(folder.path().join(name)).unwrap()).unwrap() };
    let number = |row: &Value, name: &str| row[name].as_f64().unwrap();
    let (a, b, c) = (read("a.json"), read("b.json"), read("c.json"));
    assert_eq!((a.as_array().unwrap().len(), b.as_array().unwrap().len()), (1, 2), "{a} {b}");
    assert_eq!(
        (&a[0]["config"], &b[0]["config"], &b[1]["config"]),
        (&json!("defaults"), &json!("gi=off"), &json!("defaults"))
    );
    assert!(number(&a[0], "samples") >= 14.0 && number(&b[0], "samples") > number(&a[0], "samples"), "{a} {b}");
    assert!(number(&b[0], "flip") > 2.0 * number(&b[1], "flip"), "{b}");
    assert!(number(&b[0], "gpu_ms") > 0.0);
    // The noise of the reference is most of the error of a good picture, and little of that of a bad one.
    let noise = |row: &Value| number(row, "relmse_of_reference") / number(row, "relmse");
    assert!((0.3..1.5).contains(&noise(&b[1])) && noise(&b[0]) < 0.3, "{b}");
    // From another place there are only the numbers of there.
    assert_eq!(c.as_array().unwrap().len(), 1, "{c}");
    assert!(number(&c[0], "samples") < 8.0, "{c}");
    // A map of small errors is dark, and brighter where there are large ones.
    let light = |name: &str| mean(&folder.path().join(name), [0.3, 0.1, 0.7, 0.9]).iter().sum::<f64>();
    assert!(light("far.png") > 2.0 * light("error.png"), "{} {}", light("far.png"), light("error.png"));
    assert_eq!(size(&folder.path().join("alone.png")), [420, 310]);
}

/// What a screenshot has is what the display shows, to the last bit.
#[test]
fn the_display_shows_the_window() {
    let Some(display) = display() else { return };
    let folder = tempfile::tempdir().unwrap();
    // Nothing in it is random.
    let scene = square(folder.path());
    let still = [scene, "--set", "stages.gi=off", "--set", "stages.shadows=off", "--set", "stages.ao=off"];
    let mut running = Running::start(display.name(), folder.path(), &still);
    running.wait_for("gi = \"off\"");
    let script = actions(folder.path(), &[(3, json!({"screenshot": "same.png"}))]);
    let arguments = [&still[..], &["--actions", script, "--frames", "6", "--no-panels"]].concat();
    // On a display of its own, so that the first window stays on top of this one.
    let other = self::display().unwrap();
    done(&view(Some(other.name()), folder.path(), &arguments));
    let same = image::open(folder.path().join("same.png")).unwrap().into_rgb8();
    let wanted: Vec<[u8; 3]> = same.pixels().map(|pixel| pixel.0).collect();
    thread::sleep(Duration::from_millis(500));
    let shown = display.shown([400, 300]);
    running.program.kill().unwrap();
    running.end();
    assert!(wanted.iter().any(|pixel| pixel[0] > 100), "the window is black");
    let differ = shown.iter().zip(&wanted).filter(|(a, b)| a != b).count();
    assert_eq!(differ, 0, "pixels of {}", wanted.len());
}

/// On a display with 10 bits of each colour, those of 16-bit display values are seen, and those of 8-bit ones as they are.
#[test]
fn ten_bits_are_shown_where_the_display_has_them() {
    let folder = tempfile::tempdir().unwrap();
    let scene = square(folder.path());
    // How many levels are seen, and how many that no 8-bit value has: the sky is a gradient.
    let between = |bits: &str| {
        let display = display_of("30")?;
        let still = [scene, "--set", "stages.gi=off", "--set", "stages.shadows=off", "--set", "stages.ao=off"];
        let setting = format!("post.bits={bits}");
        let mut running =
            Running::start(display.name(), folder.path(), &[&still[..], &["--set", &setting, "--check"]].concat());
        running.wait_for(&format!("bits = {bits}"));
        let begun = Instant::now();
        let shown = loop {
            let shown = display.shown_10([400, 300]);
            if shown.iter().filter(|[_, _, blue]| *blue > 200).count() > 10_000 {
                break shown;
            }
            assert!(begun.elapsed() < Duration::from_secs(30), "no sky is seen");
            thread::sleep(Duration::from_millis(50));
        };
        fs::remove_file(folder.path().join("now.toml")).unwrap();
        running.program.kill().unwrap();
        running.end();
        let is_of_8_bits = |level: u32| {
            let nearest = (f64::from(level) * 255.0 / 1023.0).round();
            // They are four apart, and devices may round either way.
            ((nearest * 1023.0 / 255.0).round() as u32).abs_diff(level) <= 1
        };
        let levels: BTreeSet<u32> = shown.iter().flatten().copied().collect();
        Some([levels.len(), levels.iter().filter(|level| !is_of_8_bits(**level)).count()])
    };
    let (Some(eight), Some(sixteen)) = (between("8"), between("16")) else { return };
    assert_eq!(eight[1], 0);
    assert!(sixteen[1] > 2 && 2 * sixteen[0] > 3 * eight[0], "{eight:?}, {sixteen:?}");
}

/// The example of a window in few lines shows a scene of one's own.
#[test]
fn the_smallest_viewer_shows_a_scene() {
    let Some(display) = display() else { return };
    let programs = env::current_exe().unwrap().parent().unwrap().parent().unwrap().join("examples/minimal");
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join(square(folder.path()));
    let mut command = Command::new(&programs);
    command.arg(&scene).env("DISPLAY", display.name()).env_remove("WAYLAND_DISPLAY").env_remove("WAYLAND_SOCKET");
    let mut program = command.stderr(Stdio::piped()).spawn().unwrap_or_else(|error| {
        panic!("{}: {error}; `cargo test --release -p magpie-demo` builds it", programs.display())
    });
    // A red square under a sky: both are seen.
    let begun = Instant::now();
    let is_seen = loop {
        let shown = display.shown([800, 600]);
        let red = shown.iter().filter(|[r, g, b]| u16::from(*r) > 2 * u16::from((*g).max(*b)) && *r > 60).count();
        let blue = shown.iter().filter(|[r, _, b]| b > r && *b > 60).count();
        if red > 5_000 && blue > 5_000 {
            break true;
        }
        if begun.elapsed() > Duration::from_secs(60) || program.try_wait().unwrap().is_some() {
            break false;
        }
        thread::sleep(Duration::from_millis(100));
    };
    program.kill().unwrap();
    let output = program.wait_with_output().unwrap();
    assert!(is_seen, "{}", String::from_utf8_lossy(&output.stderr));
}
