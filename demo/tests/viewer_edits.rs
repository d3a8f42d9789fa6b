//! Files that are edited while the viewer runs: configuration, shaders, scene.
#![allow(clippy::unwrap_used, reason = "the helpers of tests fail as tests do")]

use std::{
    fs,
    io::Write as _,
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use serde_json::{Value, json};

mod window;
use window::*;

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

/// A viewer that does what it is told, line by line.
struct Session {
    program: Child,
    folder: PathBuf,
    pictures: u32,
}

impl Session {
    fn start(display: &str, folder: &Path, arguments: &[&str]) -> Self {
        let mut command = viewer(Some(display), folder, &[arguments, &["--actions", "-"]].concat());
        let program = command.stdin(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        Self { program, folder: folder.to_owned(), pictures: 0 }
    }

    fn act(&mut self, action: &Value) {
        writeln!(self.program.stdin.as_mut().unwrap(), "{action}").unwrap();
    }

    /// Asks for a picture of the window, and waits for it: the actions before it were done by then.
    fn picture(&mut self) -> PathBuf {
        let name = format!("picture_{:03}.png", self.pictures);
        self.pictures += 1;
        self.act(&json!({"screenshot": name}));
        let (path, begun) = (self.folder.join(name), Instant::now());
        while !path.exists() {
            assert!(begun.elapsed() < Duration::from_secs(120), "{} does not come", path.display());
            if let Some(status) = self.program.try_wait().unwrap() {
                panic!("it ended with {status}");
            }
            thread::sleep(Duration::from_millis(5));
        }
        path
    }

    /// Does something, and takes a picture of it.
    fn see(&mut self, action: &Value) -> PathBuf {
        self.act(action);
        self.picture()
    }

    /// Takes pictures until one looks as wanted.
    fn wait(&mut self, what: &str, wanted: impl Fn(&Path) -> bool) {
        let begun = Instant::now();
        loop {
            let picture = self.picture();
            if wanted(&picture) {
                return;
            }
            assert!(begun.elapsed() < Duration::from_secs(60), "{what} is not seen");
        }
    }
}

/// All in one run, with every check on and a picture of every step: it ends without a message.
#[test]
fn a_whole_session_leaves_nothing_behind() {
    let Some(display) = display() else { return };
    let folder = tempfile::tempdir().unwrap();
    let glsl = shaders(folder.path());
    let config = folder.path().join("c.toml");
    fs::write(&config, "[stages]\ngi = \"sky\"\n").unwrap();
    let arguments = ["builtin:cornell", "--config", "c.toml", "--shaders", "glsl", "--check", "--size", "600x400"];
    let mut session = Session::start(display.name(), folder.path(), &arguments);
    let middle = [0.4, 0.3, 0.6, 0.6];
    let light = |path: &Path| mean(path, middle).iter().sum::<f64>();
    let first = session.picture();
    assert_eq!(size(&first), [600, 400]);

    for choice in choices() {
        session.see(&json!({"set": choice}));
        let slot = choice.split_once('=').unwrap().0.strip_prefix("stages.").unwrap().to_owned();
        session.act(&json!({"reset": slot}));
    }
    session.see(&json!({"resize": [640, 420]}));
    session.wait("the new size", |path| size(path) == [640, 420]);
    session.see(&json!({"minimise": true}));
    session.see(&json!({"minimise": false}));
    session.see(&json!({"open": "builtin:carousel"}));
    session.see(&json!({"open": "builtin:cornell"}));

    // The configuration: brighter, then a mistake. Without panels, whose messages would cover the picture.
    session.see(&json!("panels"));
    let before = light(&session.see(&json!({"config": "c.toml"})));
    fs::write(&config, "[stages]\ngi = \"sky\"\n[post]\nexposure = 2.0\n").unwrap();
    session.wait("the edit of the configuration", |path| light(path) > 1.2 * before);
    fs::write(&config, "[stages]\ngi = \"nothing\"\n").unwrap();
    thread::sleep(Duration::from_millis(300));
    assert!(light(&session.picture()) > 1.2 * before);
    fs::write(&config, "[stages]\ngi = \"sky\"\n").unwrap();
    session.wait("the configuration of before", |path| light(path) < 1.1 * before);

    // A shader: dark, then a mistake.
    let file = glsl.join("post/tone_map.comp");
    let text = fs::read_to_string(&file).unwrap();
    fs::write(&file, text.replace("srgb_encode(display)", "0.1 * srgb_encode(display)")).unwrap();
    session.wait("the edit of the shader", |path| light(path) < 0.3 * before);
    fs::write(&file, text.replace("srgb_encode(display)", "srgb_encode(nothing)")).unwrap();
    thread::sleep(Duration::from_millis(500));
    assert!(light(&session.picture()) < 0.5 * before);
    fs::write(&file, &text).unwrap();
    session.wait("the shader of before", |path| light(path) > 0.9 * before);

    // Two configurations, and the line between them, which is dragged.
    session.act(&json!({"compare": true}));
    let line = session.see(&json!({"set": "post.exposure=3"}));
    let right = |path: &Path| mean(path, [0.55, 0.4, 0.75, 0.6]).iter().sum::<f64>();
    for input in [
        json!({"move": [0.5, 0.5]}),
        json!({"press": "primary"}),
        json!({"move": [0.6, 0.5]}),
        json!({"move": [0.8, 0.5]}),
    ] {
        session.see(&json!({"input": input}));
    }
    let dragged = session.see(&json!({"input": {"release": "primary"}}));
    assert!(right(&dragged) > 1.2 * right(&line), "{} {}", right(&line), right(&dragged));
    session.see(&json!("swap"));
    session.see(&json!({"compare": false}));

    // The truth: it has bounced light, which the picture has not.
    session.act(&json!({"set": "post.exposure=0"}));
    session.act(&json!({"split": 0.5}));
    let alone = session.picture();
    session.act(&json!({"truth": true}));
    session.wait("the reference", |path| right(path) > 1.05 * right(&alone));
    session.see(&json!({"truth_as": "error"}));
    session.see(&json!({"truth": false}));

    session.act(&json!("close"));
    drop(session.program.stdin.take());
    let output = session.program.wait_with_output().unwrap();
    done(&output);
    assert!(output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
}
