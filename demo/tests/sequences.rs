//! Sequences of pictures, along a path of the camera and in place.
#![allow(clippy::unwrap_used, reason = "the helpers of tests fail as tests do")]

use std::{
    env, fs,
    path::Path,
    process::{Command, Output},
};

/// A path of one second that goes to the right.
const PATH: &str = r#"{"keys": [
    {"time": 3.0, "camera": {"position": [0.0, 1.0, 3.4], "target": [0.0, 1.0, 0.0]}},
    {"time": 3.4, "camera": {"position": [0.2, 1.0, 3.4], "target": [0.1, 1.0, 0.0]}},
    {"time": 4.0, "camera": {"position": [0.5, 1.1, 3.3], "target": [0.1, 1.0, 0.0], "vertical_fov_degrees": 45}}
]}"#;
/// The camera of its first key.
const FIRST: &str = "position = [0.0, 1.0, 3.4]\ntarget = [0.0, 1.0, 0.0]\n";

fn magpie(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_magpie"));
    command.args(["render", "builtin:cornell", "--size", "40x30", "--time-step", "0.25", "--quiet"]);
    if let Ok(device) = env::var("MAGPIE_DEVICE") {
        command.args(["--device", &device]);
    }
    command.args(arguments).current_dir(folder).output().unwrap()
}

/// `None` where no device is wanted.
fn render(folder: &Path, arguments: &[&str]) -> Option<Output> {
    if env::var_os("MAGPIE_NO_GPU").is_some() {
        eprintln!("skipped: MAGPIE_NO_GPU is set");
        return None;
    }
    Some(magpie(folder, arguments))
}

fn done(output: &Output) {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

fn names(folder: &Path) -> Vec<String> {
    let all = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut pictures: Vec<String> = all.filter(|name| name.ends_with(".png") || name.ends_with(".exr")).collect();
    pictures.sort();
    pictures
}

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("p.json"), PATH).unwrap();
    fs::write(folder.path().join("first.toml"), FIRST).unwrap();
    folder
}

#[test]
fn every_frame_of_a_path_is_written() {
    let (folder, serial) = (folder(), folder());
    let whole = ["--camera-path", "p.json", "--out", "f_%03d.png"];
    let Some(output) = render(folder.path(), &whole) else { return };
    done(&output);
    assert_eq!(names(folder.path()), ["f_000.png", "f_001.png", "f_002.png", "f_003.png", "f_004.png"]);
    let read = |folder: &Path, name: &str| fs::read(folder.join(name)).unwrap();
    let frames: Vec<Vec<u8>> = names(folder.path()).iter().map(|name| read(folder.path(), name)).collect();
    assert!(frames.windows(2).all(|pair| pair[0] != pair[1]), "two frames are the same");

    // The first frame is that of the first key's camera, and the number of frames in flight changes nothing.
    done(&render(folder.path(), &["--camera", "first.toml", "--frames", "1", "--out", "first.png"]).unwrap());
    assert!(read(folder.path(), "first.png") == frames[0], "the path does not begin at its first key");
    done(&render(serial.path(), &[&whole[..], &["--frames-in-flight", "1"]].concat()).unwrap());
    for (name, frame) in names(serial.path()).iter().zip(&frames) {
        assert!(read(serial.path(), name) == *frame, "{name} differs with one frame in flight");
    }
}

#[test]
fn a_path_begins_after_the_warm_up_and_ends_where_it_is_told_to() {
    let folder = folder();
    let arguments = ["--camera-path", "p.json", "--warmup", "2", "--frames", "2", "--out", "f%d.exr"];
    let Some(output) = render(folder.path(), &arguments) else { return };
    done(&output);
    assert_eq!(names(folder.path()), ["f0.exr", "f1.exr"]);
    let still = ["--camera", "first.toml", "--warmup", "2", "--frames", "2", "--out", "s%d.exr"];
    done(&render(folder.path(), &still).unwrap());
    let same = |frame: u32| {
        let read = |letter: &str| fs::read(folder.path().join(format!("{letter}{frame}.exr"))).unwrap();
        read("f") == read("s")
    };
    assert!(same(0) && !same(1), "the camera moves at the wrong time");
}

#[test]
fn mistakes_are_named() {
    let folder = folder();
    fs::write(folder.path().join("back.json"), PATH.replace("\"time\": 3.4", "\"time\": 2.0")).unwrap();
    fs::write(folder.path().join("long.json"), PATH.replace("\"time\": 4.0", "\"time\": 1e7")).unwrap();
    for (arguments, says) in [
        (&["--camera-path", "none.json"][..], "--camera-path: none.json"),
        (&["--camera-path", "back.json"], "keys[1]: time is 2, wanted more than 3"),
        (&["--camera-path", "p.json", "--camera", "first.toml"], "cannot be used with"),
        (&["--camera-path", "p.json", "--out", "f%.png"], "wanted one %d or %04d"),
        (&["--camera-path", "long.json"], "more than 1000000 frames"),
        (&["--frames-in-flight", "4"], "1..=3"),
    ] {
        let output = magpie(folder.path(), arguments);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(2) && message.contains(says), "{arguments:?}: {message}");
    }
    assert_eq!(names(folder.path()), [""; 0]);
}
