//! The viewer in a window of a display without a screen: it is opened, used by actions, and closed.
#![allow(clippy::unwrap_used, reason = "the helpers of tests fail as tests do")]

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::{Child, Command, Output, Stdio},
    thread,
    time::{Duration, Instant},
};

use magpie_demo::read_picture;
use serde_json::{Value, json};

mod xvfb;
use xvfb::{Display, display};

/// The viewer with a small window.
fn viewer(display: Option<&str>, folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_magpie"));
    command.args(["view", "--time-step", "0.02"]);
    if !arguments.contains(&"--size") {
        command.args(["--size", "400x300"]);
    }
    if !arguments.contains(&"--verbose") {
        command.arg("--quiet");
    }
    if let Ok(device) = env::var("MAGPIE_DEVICE") {
        command.args(["--device", &device]);
    }
    command.args(arguments).current_dir(folder).env_remove("WAYLAND_DISPLAY").env_remove("WAYLAND_SOCKET");
    match display {
        Some(name) => command.env("DISPLAY", name),
        None => command.env_remove("DISPLAY"),
    };
    command
}

/// The same where it ends by itself.
fn view(display: Option<&str>, folder: &Path, arguments: &[&str]) -> Output {
    viewer(display, folder, arguments).output().unwrap()
}

/// A viewer that goes on until it is ended from outside, and writes its configuration to `now.toml` every few frames.
struct Running {
    program: Child,
    folder: PathBuf,
}

impl Running {
    fn start(display: &str, folder: &Path, arguments: &[&str]) -> Self {
        let steps: Vec<_> = (0..2000).map(|at| (1 + 3 * at, json!({"save_config": "now.toml"}))).collect();
        let script = actions(folder, &steps);
        let mut command = viewer(Some(display), folder, &[arguments, &["--actions", script, "--no-panels"]].concat());
        let program = command.stderr(Stdio::piped()).spawn().unwrap();
        Self { program, folder: folder.to_owned() }
    }

    /// Waits until the configuration in use has this line.
    fn wait_for(&mut self, line: &str) {
        let begun = Instant::now();
        while begun.elapsed() < Duration::from_secs(60) {
            let now = fs::read_to_string(self.folder.join("now.toml")).unwrap_or_default();
            if now.lines().any(|known| known == line) {
                return;
            }
            if let Some(status) = self.program.try_wait().unwrap() {
                panic!("it ended with {status} instead of {line}");
            }
            thread::sleep(Duration::from_millis(20));
        }
        panic!("after a minute there is still no {line}");
    }

    fn end(self) -> Output {
        self.program.wait_with_output().unwrap()
    }
}

fn done(output: &Output) {
    assert!(output.status.success(), "{:?}: {}", output.status, String::from_utf8_lossy(&output.stderr));
}

/// Mean of each channel of a rectangle of a picture, in parts of its size.
fn mean(path: &Path, [left, top, right, bottom]: [f64; 4]) -> [f64; 3] {
    let (picture, _) = read_picture(path).unwrap();
    let range = |from: f64, to: f64, side: usize| (from * side as f64) as usize..(to * side as f64) as usize;
    let (mut sum, mut count) = ([0.0; 3], 0.0);
    for y in range(top, bottom, picture.height) {
        for x in range(left, right, picture.width) {
            for (total, channel) in sum.iter_mut().zip(picture.pixels[y * picture.width + x]) {
                *total += f64::from(channel);
            }
            count += 1.0;
        }
    }
    sum.map(|total| total / count)
}

fn size(path: &Path) -> [usize; 2] {
    let (picture, _) = read_picture(path).unwrap();
    [picture.width, picture.height]
}

/// Writes a file of actions: each is done before the frame beside it.
fn actions(folder: &Path, steps: &[(u32, Value)]) -> &'static str {
    let steps: Vec<Value> = steps.iter().map(|(frame, action)| json!({"frame": frame, "do": action})).collect();
    fs::write(folder.join("actions.json"), Value::from(steps).to_string()).unwrap();
    "actions.json"
}

/// Every implementation and preset of every slot, as `magpie stages --json` lists them.
fn choices() -> Vec<String> {
    let listed = Command::new(env!("CARGO_BIN_EXE_magpie")).args(["stages", "--json"]).output().unwrap();
    let stages: Value = serde_json::from_slice(&listed.stdout).unwrap();
    let mut choices = Vec::new();
    for slot in stages.as_array().unwrap() {
        for list in ["implementations", "presets"] {
            for choice in slot[list].as_array().unwrap() {
                choices.push(format!("stages.{}={}", slot["name"].as_str().unwrap(), choice["name"].as_str().unwrap()));
            }
        }
    }
    choices
}

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
        let [left, right] = [[0.35, 0.9, 0.45, 0.95], [0.55, 0.9, 0.65, 0.95]].map(|place| mean(&path, place)[1]);
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
    let [egui, beyond, mean, passes] = numbers[..] else { panic!("{line}") };
    assert!(egui > 0.0 && beyond > 0.0 && passes > 20.0, "{line}");
    println!("{line}");
    // 0.3 ms for 100 passes; twice that where other tests run beside it.
    assert!(beyond < 0.6 * passes / 100.0, "{line}");
    assert!(mean < 2.0 * passes / 100.0, "{line}");
}

/// A device that is lost ends it with a message, and nothing is half written.
#[test]
fn a_lost_device_is_said() {
    let Some(display) = display() else { return };
    let folder = tempfile::tempdir().unwrap();
    let steps = [(2, json!({"screenshot": "two.png"})), (5, json!({"lose_device": "gbuffer.draw"}))];
    let script = actions(folder.path(), &steps);
    let arguments =
        ["builtin:cornell", "--frames", "20", "--actions", script, "--timings", "t.json", "--screenshot", "last.png"];
    let output = view(Some(display.name()), folder.path(), &arguments);
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("the device was lost") && !message.contains("panicked"), "{message}");
    assert_eq!(size(&folder.path().join("two.png")), [400, 300]);
    let mut left: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    left.sort_unstable();
    assert_eq!(left, ["actions.json", "two.png"]);
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

/// Who closes the window ends the program, and what was asked for by then is written.
#[test]
fn a_closed_window_is_no_failure() {
    let Some(display) = display() else { return };
    let folder = tempfile::tempdir().unwrap();
    let script = actions(folder.path(), &[(2, json!({"screenshot": "two.png"})), (3, json!("close"))]);
    done(&view(Some(display.name()), folder.path(), &["builtin:cornell", "--actions", script, "--no-panels"]));
    assert_eq!(size(&folder.path().join("two.png")), [400, 300]);
}

/// An edit of the configuration file applies while frames go on, a mistake in it changes nothing, and a signal ends it all in order.
#[test]
fn edits_of_the_configuration_apply_at_once() {
    let Some(display) = display() else { return };
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("c.toml");
    fs::write(&file, "[stages]\ngi = \"sky\"\n").unwrap();
    let mut running = Running::start(display.name(), folder.path(), &["builtin:cornell", "--config", "c.toml"]);
    running.wait_for("gi = \"sky\"");
    fs::write(&file, "[stages]\ngi = \"off\"\n[post]\nexposure = 1.5\n").unwrap();
    running.wait_for("gi = \"off\"");
    running.wait_for("exposure = 1.5");
    for mistake in ["[stages]\ngi = \"nothing\"\n", "[stages", "[post]\nexposure = \"much\"\n"] {
        fs::write(&file, mistake).unwrap();
        thread::sleep(Duration::from_millis(200));
        running.wait_for("gi = \"off\"");
        running.wait_for("exposure = 1.5");
    }
    // As editors do it: another file in its place.
    fs::write(folder.path().join("other"), "[stages]\ngi = \"sky\"\n").unwrap();
    fs::rename(folder.path().join("other"), &file).unwrap();
    running.wait_for("gi = \"sky\"");
    running.wait_for("exposure = 0.0");
    let number = running.program.id().to_string();
    assert!(Command::new("kill").args(["-INT", &number]).status().unwrap().success());
    let output = running.end();
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{message}");
    assert_eq!(message.trim(), "error: interrupted");
    let left = fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(left, 3, "a file was left half written");
}

/// A copy of the shaders below a folder, to be edited.
fn shaders(folder: &Path) -> PathBuf {
    let (from, to) = (Path::new(env!("CARGO_MANIFEST_DIR")).join("../shaders"), folder.join("glsl"));
    for effect in fs::read_dir(from).unwrap().map(Result::unwrap).filter(|entry| entry.file_type().unwrap().is_dir()) {
        let copy = to.join(effect.file_name());
        fs::create_dir_all(&copy).unwrap();
        for file in fs::read_dir(effect.path()).unwrap().map(Result::unwrap) {
            if file.file_type().unwrap().is_file() {
                fs::copy(file.path(), copy.join(file.file_name())).unwrap();
            }
        }
    }
    to
}

/// A shader that is saved runs within a second; one with a mistake is named with its line, and the one before runs on.
#[test]
fn edits_of_shaders_are_seen_within_a_second() {
    let Some(display) = display() else { return };
    let folder = tempfile::tempdir().unwrap();
    let scene = square(folder.path());
    let glsl = shaders(folder.path());
    let still = [scene, "--set", "stages.gi=off", "--set", "stages.shadows=off", "--set", "stages.ao=off"];
    let mut running = Running::start(
        display.name(),
        folder.path(),
        &[&still[..], &["--shaders", "glsl", "--check", "--verbose"]].concat(),
    );
    running.wait_for("gi = \"off\"");
    // The sky is in the corner: blue, and without any red once the shader takes it away.
    let red = |display: &Display| display.shown([8, 8]).iter().map(|[r, _, _]| usize::from(*r)).sum::<usize>();
    let wait = |wanted: bool| {
        let begun = Instant::now();
        while (red(&display) == 0) != wanted {
            assert!(begun.elapsed() < Duration::from_secs(20), "it is not seen");
            thread::sleep(Duration::from_millis(5));
        }
        begun.elapsed()
    };
    wait(false);
    let file = glsl.join("post/tone_map.comp");
    let text = fs::read_to_string(&file).unwrap();
    let store = text.lines().find(|line| line.trim_start().starts_with("store(")).unwrap();
    let edited = text.replace(store, &format!("    display.r = 0.0;\n{store}"));
    fs::write(&file, &edited).unwrap();
    let first = wait(true);
    fs::write(&file, text.replace(store, &format!("    nonsense;\n{store}"))).unwrap();
    thread::sleep(Duration::from_millis(700));
    assert_eq!(red(&display), 0, "the shader of before the mistake does not run any more");
    fs::write(&file, text.replace("local_size_x = 8", "local_size_x = 16")).unwrap();
    thread::sleep(Duration::from_millis(700));
    assert_eq!(red(&display), 0, "the shader of before the mistake does not run any more");
    fs::write(&file, &text).unwrap();
    let last = wait(false);
    for took in [first, last] {
        // Twice what is promised: the machine may be busy with other tests.
        assert!(took < Duration::from_secs(2), "{took:?}");
    }
    let number = running.program.id().to_string();
    assert!(Command::new("kill").args(["-INT", &number]).status().unwrap().success());
    let output = running.end();
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{message}");
    let line = 1 + text.lines().position(|line| line == store).unwrap();
    assert!(message.contains(&format!("post/tone_map.comp:{line}: 'nonsense'")), "{message}");
    assert!(message.contains("8 x 8 x 1 and is 16 x 8 x 1"), "{message}");
    assert_eq!(message.lines().filter(|line| line.starts_with("error")).count(), 1, "{message}");
}

/// A scene that is written anew is shown as it is now, and one with a mistake is not.
#[test]
fn edits_of_the_scene_are_seen() {
    let Some(display) = display() else { return };
    let folder = tempfile::tempdir().unwrap();
    let scene = square(folder.path());
    let mut running = Running::start(display.name(), folder.path(), &[scene]);
    running.wait_for("gi = \"surfels\"");
    let seen = |most: usize| {
        let begun = Instant::now();
        loop {
            let shown = display.shown([400, 300]);
            let count = |at: usize| {
                let clear = |pixel: &&[u8; 3]| (0..3).all(|c| c == at || pixel[at] > 60 && pixel[at] > 2 * pixel[c]);
                shown.iter().filter(clear).count()
            };
            if count(most) > 5_000 {
                return;
            }
            assert!(begun.elapsed() < Duration::from_secs(30), "{most} is not seen");
            thread::sleep(Duration::from_millis(20));
        }
    };
    seen(0);
    let path = folder.path().join(scene);
    let text = fs::read_to_string(&path).unwrap();
    assert!(text.contains("[0.8,0.02,0.02,1.0]"), "{text}");
    fs::write(&path, "{").unwrap();
    thread::sleep(Duration::from_millis(600));
    seen(0);
    fs::write(&path, text.replace("[0.8,0.02,0.02,1.0]", "[0.02,0.8,0.02,1.0]")).unwrap();
    seen(1);
    let number = running.program.id().to_string();
    assert!(Command::new("kill").args(["-INT", &number]).status().unwrap().success());
    assert_eq!(running.end().status.code(), Some(130));
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

/// Writes a scene of a red square that stands upright, without light or camera.
fn square(folder: &Path) -> &'static str {
    let floats: [f32; 12] = [-1.0, -1.0, 0.0, 1.0, -1.0, 0.0, 1.0, 1.0, 0.0, -1.0, 1.0, 0.0];
    let bytes: Vec<u8> = floats.iter().flat_map(|x| x.to_le_bytes()).collect();
    let indices: Vec<u8> = [0_u16, 1, 2, 0, 2, 3].iter().flat_map(|x| x.to_le_bytes()).collect();
    let scene = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
        "materials": [{"doubleSided": true, "pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.02, 0.02, 1.0], "metallicFactor": 0.0}}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [-1, -1, 0], "max": [1, 1, 0]},
            {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
        "bufferViews": [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 12}],
        "buffers": [{"uri": "square.bin", "byteLength": 60}],
    });
    fs::write(folder.join("square.bin"), [bytes, indices].concat()).unwrap();
    fs::write(folder.join("square.gltf"), scene.to_string()).unwrap();
    "square.gltf"
}

/// A display that goes away ends it with a message.
#[test]
fn a_lost_display_is_said() {
    let Some(display) = display() else { return };
    let folder = tempfile::tempdir().unwrap();
    let mut running = Running::start(display.name(), folder.path(), &["builtin:cornell"]);
    running.wait_for("gi = \"surfels\"");
    drop(display);
    let output = running.end();
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(!message.is_empty() && !message.contains("panicked"), "{message}");
}

/// Without a display there is one sentence, and what to do instead.
#[test]
fn without_a_display_there_is_a_hint() {
    let folder = tempfile::tempdir().unwrap();
    for arguments in [&["builtin:cornell"][..], &["builtin:cornell", "--frames", "3"]] {
        let output = view(None, folder.path(), arguments);
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(3), "{message}");
        assert!(message.contains("no display") && message.contains("magpie render"), "{message}");
        assert!(message.lines().count() == 1 && !message.contains(".rs"), "{message}");
    }
}

/// Mistakes in what is given end it before a window opens.
#[test]
fn mistakes_are_found_before_the_window_opens() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("bad.json"), "[{\"frame\": 1, \"do\": \"dance\"}]").unwrap();
    for (arguments, wanted) in [
        (&["builtin:nowhere"][..], "nowhere"),
        (&["builtin:cornell", "--actions", "bad.json"], "dance"),
        (&["builtin:cornell", "--set", "stages.gi=nothing"], "nothing"),
        (&["builtin:cornell", "--screenshot", "a.png"], "--frames"),
        (&["builtin:cornell", "--frames", "2", "--screenshot", "a.bmp"], ".png"),
        (&["builtin:cornell", "--frames", "2", "--screenshot", "no_folder/a.png"], "no_folder"),
    ] {
        let output = view(None, folder.path(), arguments);
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
        assert!(message.contains(wanted), "{arguments:?}: {message}");
    }
    let left: Vec<PathBuf> = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path()).collect();
    assert_eq!(left.len(), 1, "{left:?}");
}
