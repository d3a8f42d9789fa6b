//! Windows on a display without a screen, for tests of the viewer.
#![allow(dead_code, reason = "each test uses some of it")]
#![allow(clippy::unwrap_used, reason = "the helpers of tests fail as tests do")]

use std::{
    env, fs,
    io::{BufRead, BufReader, ErrorKind},
    path::{Path, PathBuf},
    process::{Child, Command, Output, Stdio},
    thread,
    time::{Duration, Instant},
};

use magpie_demo::read_picture;
use serde_json::{Value, json};

/// A display of this test's own, for all its windows.
pub struct Display {
    server: Child,
    name: String,
    /// Where the server keeps what it shows.
    memory: tempfile::TempDir,
}

impl Display {
    /// Its name, as `DISPLAY` has it.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// What it shows in its upper left corner, where windows open: rows of red, green, blue.
    pub fn shown(&self, size: [usize; 2]) -> Vec<[u8; 3]> {
        self.words(size).into_iter().map(|word| [2, 1, 0].map(|at| word.to_le_bytes()[at])).collect()
    }

    /// The same of a display with 10 bits of each colour.
    pub fn shown_10(&self, size: [usize; 2]) -> Vec<[u32; 3]> {
        self.words(size).into_iter().map(|word| [20, 10, 0].map(|shift| (word >> shift) & 0x3ff)).collect()
    }

    fn words(&self, [width, height]: [usize; 2]) -> Vec<u32> {
        // A file of the X window dump format, version 7: a header of big-endian words, the colour map, the pixels.
        let dump = fs::read(self.memory.path().join("Xvfb_screen0")).unwrap();
        let word = |at: usize| u32::from_be_bytes(dump[4 * at..4 * at + 4].try_into().unwrap()) as usize;
        let (header, version, bits, row, colours) = (word(0), word(1), word(11), word(12), word(19));
        assert_eq!((version, bits), (7, 32));
        let pixels = &dump[header + 12 * colours..];
        let pixel = |x: usize, y: usize| {
            let at = y * row + 4 * x;
            u32::from_le_bytes(pixels[at..at + 4].try_into().unwrap())
        };
        (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| pixel(x, y)).collect()
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

/// `None` where no device is wanted.
pub fn display() -> Option<Display> {
    display_of("24")
}

/// The same with so many bits per pixel: 24, or 30 for 10 of each colour.
pub fn display_of(bits: &str) -> Option<Display> {
    if env::var_os("MAGPIE_NO_GPU").is_some() {
        eprintln!("skipped: MAGPIE_NO_GPU is set");
        return None;
    }
    let memory = tempfile::tempdir().unwrap();
    let server = Command::new("Xvfb")
        .args(["-displayfd", "1", "-screen", "0", &format!("800x600x{bits}"), "-nolisten", "tcp", "-fbdir"])
        .arg(memory.path())
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn();
    let mut server = match server {
        Ok(server) => server,
        // `cargo xtask setup` leaves a machine that has a driver as it is.
        Err(error) if error.kind() == ErrorKind::NotFound => {
            eprintln!("skipped: Xvfb is not installed");
            return None;
        }
        Err(error) => panic!("Xvfb cannot be started: {error}"),
    };
    let mut line = String::new();
    BufReader::new(server.stdout.take().unwrap()).read_line(&mut line).unwrap();
    assert!(!line.trim().is_empty(), "Xvfb found no free display");
    Some(Display { server, name: format!(":{}", line.trim()), memory })
}

/// The viewer with a small window.
pub fn viewer(display: Option<&str>, folder: &Path, arguments: &[&str]) -> Command {
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
pub fn view(display: Option<&str>, folder: &Path, arguments: &[&str]) -> Output {
    viewer(display, folder, arguments).output().unwrap()
}

/// A viewer that goes on until it is ended from outside, and writes its configuration to `now.toml` every few frames.
pub struct Running {
    pub program: Child,
    folder: PathBuf,
}

impl Running {
    pub fn start(display: &str, folder: &Path, arguments: &[&str]) -> Self {
        let steps: Vec<_> = (0..2000).map(|at| (1 + 3 * at, json!({"save_config": "now.toml"}))).collect();
        let script = actions(folder, &steps);
        let mut command = viewer(Some(display), folder, &[arguments, &["--actions", script, "--no-panels"]].concat());
        let program = command.stderr(Stdio::piped()).spawn().unwrap();
        Self { program, folder: folder.to_owned() }
    }

    /// Waits until the configuration in use has this line.
    pub fn wait_for(&mut self, line: &str) {
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

    pub fn end(self) -> Output {
        self.program.wait_with_output().unwrap()
    }
}

pub fn done(output: &Output) {
    assert!(output.status.success(), "{:?}: {}", output.status, String::from_utf8_lossy(&output.stderr));
}

/// Mean of each channel of a rectangle of a picture, in parts of its size.
pub fn mean(path: &Path, [left, top, right, bottom]: [f64; 4]) -> [f64; 3] {
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

pub fn size(path: &Path) -> [usize; 2] {
    let (picture, _) = read_picture(path).unwrap();
    [picture.width, picture.height]
}

/// Writes a file of actions: each is done before the frame beside it.
pub fn actions(folder: &Path, steps: &[(u32, Value)]) -> &'static str {
    let steps: Vec<Value> = steps.iter().map(|(frame, action)| json!({"frame": frame, "do": action})).collect();
    fs::write(folder.join("actions.json"), Value::from(steps).to_string()).unwrap();
    "actions.json"
}

/// Every implementation and preset of every slot, as `magpie stages --json` lists them.
pub fn choices() -> Vec<String> {
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

/// A copy of the shaders below a folder, to be edited.
pub fn shaders(folder: &Path) -> PathBuf {
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

/// Writes a scene of a red square that stands upright, without light or camera.
pub fn square(folder: &Path) -> &'static str {
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
