//! Bad input of every kind: each ends with exit status 2 or 3 and a message that names the fault, without a panic and without
//! a file left behind. No driver is visible here, so status 2 also shows that the fault is found before a device is opened.
#![allow(clippy::unwrap_used, reason = "the helpers of tests fail as tests do")]

use std::{
    ffi::OsString,
    fs,
    path::Path,
    process::{Command, Stdio},
    thread::sleep,
    time::{Duration, Instant},
};

use magpie::{
    config::Value,
    graph::{Extent, Format},
    pixels::Pixels,
    slot::Range,
};
use magpie_demo::{write_exr, write_png};
use serde_json::{Value as Json, json};

#[path = "bad_input/files.rs"]
mod files;
#[path = "bad_input/parameters.rs"]
mod parameters;

/// Longest that one bad input may take.
const PATIENCE: Duration = Duration::from_secs(60);

struct Ended {
    status: Option<i32>,
    stderr: String,
}

fn run(folder: &Path, arguments: &[OsString]) -> Ended {
    let mut child = Command::new(env!("CARGO_BIN_EXE_magpie"))
        .args(arguments)
        .current_dir(folder)
        .env("VK_DRIVER_FILES", "/nonexistent.json")
        .env("VK_ICD_FILENAMES", "/nonexistent.json")
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let begun = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if begun.elapsed() > PATIENCE {
            child.kill().unwrap();
            panic!("{arguments:?} did not end within {PATIENCE:?}");
        }
        sleep(Duration::from_millis(2));
    }
    let output = child.wait_with_output().unwrap();
    Ended { status: output.status.code(), stderr: String::from_utf8_lossy(&output.stderr).into_owned() }
}

/// Every file below `folder` with its size.
fn listing(folder: &Path) -> Vec<(String, u64)> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let entry = entry.unwrap();
        if entry.path().is_dir() {
            files.extend(listing(&entry.path()));
        }
        files.push((entry.path().display().to_string(), entry.metadata().unwrap().len()));
    }
    files.sort();
    files
}

/// Runs the command and checks all that holds for every kind of bad input.
fn refused(folder: &Path, arguments: &[&str], status: i32, names: &[&str]) {
    refused_os(folder, &arguments.iter().map(OsString::from).collect::<Vec<_>>(), status, names);
}

fn refused_os(folder: &Path, arguments: &[OsString], status: i32, names: &[&str]) {
    let before = listing(folder);
    let Ended { status: got, stderr } = run(folder, arguments);
    assert!(!stderr.contains("panicked"), "{arguments:?} panicked:\n{stderr}");
    assert_eq!(got, Some(status), "{arguments:?}:\n{stderr}");
    for name in names {
        assert!(stderr.contains(name), "{arguments:?}: wanted the message to say {name:?}, got:\n{stderr}");
    }
    // What a scene was given may be said before; then comes the error.
    let said = |line: &&str| !line.starts_with("info: ") && !line.starts_with("warning: ");
    let first = stderr.lines().find(said).unwrap_or_default();
    assert!(first.starts_with("error: "), "{arguments:?}:\n{stderr}");
    assert_eq!(listing(folder), before, "{arguments:?} left files behind");
}

/// Every file that a run can write.
const OUTPUTS: [&str; 8] =
    ["--out", "o.png", "--timings", "t.json", "--trace", "trace.json", "--dump-graph", "plan.txt"];

#[test]
fn arguments() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("folder.png")).unwrap();
    fs::write(folder.path().join("c.toml"), "").unwrap();
    fs::write(folder.path().join("s.json"), "{}").unwrap();
    let cases: &[(&[&str], &[&str])] = &[
        (&["--no-such-option"], &["--no-such-option"]),
        (&["draw"], &["draw"]),
        (&["render"], &["SCENE"]),
        (&["render", "builtin:cornell", "--no-such-option"], &["--no-such-option"]),
        (&["render", "builtin:cornell", "extra"], &["extra"]),
        (&["render", "builtin:cornell", "--size", "0x10"], &["--size", "0x10", "1 to 16384"]),
        (&["render", "builtin:cornell", "--size", "640"], &["--size", "WIDTHxHEIGHT"]),
        (&["render", "builtin:cornell", "--size", "640x360x2"], &["--size", "WIDTHxHEIGHT"]),
        (&["render", "builtin:cornell", "--size", "-1x5"], &["--size", "1 to 16384"]),
        (&["render", "builtin:cornell", "--size", "99999x1"], &["--size", "1 to 16384"]),
        (&["render", "builtin:cornell", "--frames", "0"], &["--frames", "1..=1000000"]),
        (&["render", "builtin:cornell", "--frames", "1000001"], &["--frames", "1..=1000000"]),
        (&["render", "builtin:cornell", "--frames", "many"], &["--frames", "many"]),
        (&["render", "builtin:cornell", "--warmup", "-1"], &["--warmup", "-1"]),
        (&["render", "builtin:cornell", "--seed", "-1"], &["--seed", "-1"]),
        (&["render", "builtin:cornell", "--seed", "4294967296"], &["--seed", "4294967296"]),
        (&["render", "builtin:cornell", "--time-step", "0"], &["--time-step", "above 0"]),
        (&["render", "builtin:cornell", "--time-step", "nan"], &["--time-step", "finite"]),
        (&["render", "builtin:cornell", "--time-step", "-0.1"], &["--time-step", "above 0"]),
        (&["render", "builtin:cornell", "--rays", "sideways"], &["--rays", "sideways", "software"]),
        (&["render", "builtin:cornell", "--view", "depth", "--out", "o.png"], &["--view", "PASS:OUTPUT"]),
        (&["render", "builtin:cornell", "--view", "gbuffer.draw:depth"], &["--out"]),
        (&["render", "builtin:cornell", "--view-as", "log", "--out", "o.png"], &["--view"]),
        (
            &["render", "builtin:cornell", "--view", "gbuffer.draw:depth", "--view-as", "logs", "--out", "o.png"],
            &["--view-as", "`logs`", "LO..HI"],
        ),
        (
            &["render", "builtin:cornell", "--view", "gbuffer.draw:depth", "--view-as", "log", "--out", "o.exr"],
            &["--view-as", "EXR", "PNG"],
        ),
        (&["render", "builtin:cornell", "--out"], &["--out"]),
        (&["render", "builtin:cornell", "--out", "o.png", "--out", "p.png"], &["--out", "multiple"]),
        (&["render", "builtin:cornell", "--out", "o.jpg"], &["--out", "o.jpg", ".png or .exr"]),
        (&["render", "builtin:cornell", "--out", "png"], &["--out", ".png or .exr"]),
        (&["render", "builtin:cornell", "--out", ""], &["--out"]),
        (&["render", "builtin:cornell", "--out", "folder.png"], &["--out", "folder.png", "folder"]),
        (&["render", "builtin:cornell", "--out", "none/o.png"], &["--out", "none", "does not exist"]),
        (&["render", "builtin:cornell", "--timings", "t.xml"], &["--timings", "t.xml", ".json or .csv"]),
        (&["render", "builtin:cornell", "--trace", "t.txt"], &["--trace", "t.txt", ".json"]),
        (&["render", "builtin:cornell", "--dump-graph", "g.pdf"], &["--dump-graph", "g.pdf", ".dot"]),
        (
            &["render", "builtin:cornell", "--timings", "t.json", "--trace", "./t.json"],
            &["--trace", "--timings", "same"],
        ),
        (&["render", "s.json", "--timings", "s.json"], &["--timings", "s.json", "overwrite the scene"]),
        (&["-v", "--quiet", "scenes"], &["--quiet", "--verbose"]),
        (&["stages", "--json=maybe"], &["--json"]),
        (&["plan"], &["SCENE"]),
        (&["plan", "builtin:cornel"], &["cornel", "did you mean \"cornell\""]),
        (&["plan", "builtin:cornell", "--out", "o.toml"], &["--measure"]),
        (&["plan", "builtin:cornell", "--measure", "--worth", "2"], &["--worth", "0 to 1"]),
        (&["plan", "builtin:cornell", "--measure", "--out", "o.png"], &["--out", "o.png", ".toml"]),
        (&["plan", "builtin:cornell", "--report", "c.toml"], &["--report", "c.toml", "render --timings"]),
        (&["plan", "builtin:cornell", "--set", "stages.rays=heat"], &["stages.rays", "heat-map"]),
        (&["compare"], &["A", "B"]),
        (&["compare", "folder.png"], &["B"]),
        (&["compare", "a.png", "b.png", "c.png"], &["c.png"]),
        (&["compare", "a.png", "b.png", "--diff", "o.exr"], &["--diff", "o.exr", ".png"]),
        (&["compare", "a.png", "b.png", "--diff", "none/o.png"], &["--diff", "none", "does not exist"]),
        (&["compare", "none.png", "none.png"], &["none.png", "cannot be read"]),
        (&["compare", "folder.png", "folder.png"], &["folder.png", "wanted a file"]),
        (&["compare", "c.toml", "c.toml"], &["c.toml", "PNG or an EXR"]),
        (&["bench"], &["subcommand", "graph"]),
        (&["bench", "speed"], &["speed"]),
        (&["bench", "graph", "extra"], &["extra"]),
        (&["bench", "graph", "--passes", "0"], &["--passes", "1..=100000"]),
        (&["bench", "graph", "--passes", "10,,20"], &["--passes"]),
        (&["bench", "graph", "--passes", "10,many"], &["--passes", "many"]),
        (&["bench", "graph", "--passes", "-5"], &["--passes", "-5"]),
        (&["bench", "graph", "--passes", "100001"], &["--passes", "1..=100000"]),
        (&["bench", "graph", "--passes"], &["--passes"]),
        (&["bench", "graph", "--repeat", "0"], &["--repeat", "1..=100000"]),
        (&["bench", "graph", "--repeat", "4.5"], &["--repeat", "4.5"]),
        (&["bench", "graph", "--quick", "--repeat", "3"], &["--quick", "--repeat"]),
        (&["bench", "graph", "--json", "o.txt"], &["--json", "o.txt", ".json"]),
        (&["bench", "rays", "--size", "10"], &["--size", "1024..="]),
        (&["bench", "rays", "--rays", "magic"], &["--rays", "magic", "pipeline"]),
        (&["bench", "rays", "--csv", "o.json"], &["--csv", "o.json", ".csv"]),
        (&["bench", "rays", "--json", "o.txt"], &["--json", "o.txt", ".json"]),
        (&["bench", "rays", "--scene", "none.glb"], &["none.glb"]),
        (&["bench", "rays", "--scene", "builtin:none"], &["none", "courtyard"]),
        (&["bench", "graph", "--json", "none/o.json"], &["--json", "none", "does not exist"]),
    ];
    for (arguments, names) in cases {
        refused(folder.path(), arguments, 2, names);
    }
    // Without arguments the viewer opens, for which there is no display or no device here.
    refused(folder.path(), &[], 3, &[]);
}

#[cfg(unix)]
#[test]
fn arguments_that_are_no_text() {
    use std::os::unix::ffi::OsStringExt;
    let folder = tempfile::tempdir().unwrap();
    let odd = OsString::from_vec(b"a\xff".to_vec());
    let with = |option: &str| ["render", "builtin:cornell", option].map(OsString::from);
    refused_os(folder.path(), &[&with("--set")[..], std::slice::from_ref(&odd)].concat(), 2, &["--set"]);
    refused_os(folder.path(), &[&with("--size")[..], std::slice::from_ref(&odd)].concat(), 2, &["--size"]);
    refused_os(folder.path(), &[OsString::from("render"), odd], 2, &[]);
}

#[test]
fn assignments() {
    let folder = tempfile::tempdir().unwrap();
    let (key, above) = ranged_number();
    let (over, text, nan) = (format!("{key}={above}"), format!("{key}=wide"), format!("{key}=nan"));
    let (infinite, misspelt) = (format!("{key}=1e999"), format!("{key}x=1"));
    let cases: &[(&str, &[&str])] = &[
        ("", &["SLOT.KEY=VALUE"]),
        ("shadows", &["shadows", "SLOT.KEY=VALUE"]),
        ("shadows=off", &["shadows=off", "SLOT.KEY=VALUE"]),
        ("a.b.c=1", &["a.b.c=1", "SLOT.KEY=VALUE"]),
        ("stages.shadows=", &["SLOT.KEY=VALUE"]),
        ("stages.shadows=offf", &["stages.shadows", "offf", "did you mean \"off\"", "known: "]),
        ("stages.shadow=off", &["stages.shadow", "did you mean \"shadows\"", "known: "]),
        ("weather.rain=1", &["weather", "known: "]),
        (&over, &[&key, "wanted"]),
        (&text, &[&key, "number", "wide"]),
        (&nan, &[&key, "finite"]),
        (&infinite, &[&key, "finite"]),
        (&misspelt, &[&key, "did you mean", "known: "]),
    ];
    for (assignment, names) in cases {
        let arguments = [&["render", "builtin:cornell", "--set", assignment][..], &OUTPUTS].concat();
        refused(folder.path(), &arguments, 2, &[&["--set"], *names].concat());
    }
}

/// A setting with a number in a range, and a value above the range.
fn ranged_number() -> (String, f64) {
    for slot in magpie_passes::Slots::default().catalogue().slots {
        for spec in slot.implementations.iter().flat_map(|i| &i.settings) {
            if let (Range::Float { max, .. }, Value::Float(_)) = (&spec.range, &spec.default) {
                return (format!("{}.{}", slot.name, spec.key), max + 1.0);
            }
        }
    }
    panic!("no stage has a setting with a range of numbers");
}

#[test]
fn configurations() {
    let folder = tempfile::tempdir().unwrap();
    let (key, above) = ranged_number();
    let (slot, setting) = key.split_once('.').unwrap();
    let line = |value: &str| format!("[{slot}]\n{setting} = {value}\n").into_bytes();
    let cases: Vec<(Vec<u8>, Vec<&str>)> = vec![
        (b"[stages\n".to_vec(), vec![":1:"]),
        (b"[stages]\nshadows = off\n".to_vec(), vec![":2:11"]),
        (b"[stages]\nshadows = \"off\"\nshadows = \"off\"\n".to_vec(), vec![":3:", "duplicate"]),
        (b"[stages]\nshadows = true\n".to_vec(), vec!["stages.shadows", "boolean"]),
        (b"[stages]\nshadows = \"of\"\n".to_vec(), vec!["stages.shadows", "did you mean \"off\"", "known: "]),
        (b"[stages]\nshade = \"off\"\n".to_vec(), vec!["stages.shade", "known: "]),
        (b"shadows = \"off\"\n".to_vec(), vec!["shadows", "[stages]"]),
        (b"[weather]\nrain = true\n".to_vec(), vec!["weather", "known: "]),
        (format!("[{slot}]\n{setting}x = 1\n").into_bytes(), vec![&key, "did you mean", "known: "]),
        (line(&above.to_string()), vec![&key, "wanted"]),
        (line("\"wide\""), vec![&key, "number"]),
        (line("nan"), vec![&key, "finite"]),
        (line("-inf"), vec![&key, "finite"]),
        (line("[1, 2]"), vec![&key, "array"]),
        (line("2020-01-01"), vec![&key, "datetime"]),
        (format!("[{slot}.{setting}]\nx = 1\n").into_bytes(), vec![&key, "table"]),
        (b"[stages]\n# \xff\n".to_vec(), vec!["UTF-8", "byte 11"]),
        (vec![b'#'; 2 << 20], vec!["at most"]),
        (format!("x = {}", "[".repeat(100_000)).into_bytes(), vec![":1:"]),
        (vec![0; 64], vec![":1:"]),
    ];
    for (text, names) in cases {
        fs::write(folder.path().join("c.toml"), text).unwrap();
        let arguments = [&["render", "builtin:cornell", "--config", "c.toml"][..], &OUTPUTS].concat();
        refused(folder.path(), &arguments, 2, &[&["--config", "c.toml"][..], &names].concat());
    }
    for missing in ["none.toml", "."] {
        refused(folder.path(), &["render", "builtin:cornell", "--config", missing], 2, &[missing, "cannot be read"]);
    }
}

#[test]
fn cameras() {
    let folder = tempfile::tempdir().unwrap();
    refused(folder.path(), &["render", "builtin:cornell", "--camera", "nobody"], 2, &["--camera", "nobody", "known: "]);
    refused(folder.path(), &["render", "builtin:cornell", "--camera", "none.toml"], 2, &["--camera", "none.toml"]);
    let base = "position = [0, 1, 4]\ntarget = [0, 1, 0]\n";
    for (text, name) in [
        ("position = [0, 1".to_owned(), "c.toml"),
        ("position = [0, 1, 4]\n".to_owned(), "target"),
        (format!("{base}roll = 3\n"), "roll"),
        (format!("{base}vertical_fov_degrees = 180\n"), "field of view"),
        (format!("{base}vertical_fov_degrees = nan\n"), "field of view"),
        (format!("{base}near = 0\n"), "near"),
        (format!("{base}up = [0, 0, 1]\n"), "up"),
        ("position = [0, 1, 4]\ntarget = [0, 1, 4]\n".to_owned(), "position"),
        ("position = [0, 1, inf]\ntarget = [0, 1, 0]\n".to_owned(), "position"),
        ("position = [0, 1]\ntarget = [0, 1, 0]\n".to_owned(), "position"),
    ] {
        fs::write(folder.path().join("c.toml"), &text).unwrap();
        let arguments = [&["render", "builtin:cornell", "--camera", "c.toml"][..], &OUTPUTS].concat();
        refused(folder.path(), &arguments, 2, &["--camera", "c.toml", name]);
    }
}

/// An OpenEXR image of 2x1 texels: 1 everywhere but in the last number.
fn environment(last: f32) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let texels = vec![1.0, 1.0, 1.0, 1.0, 1.0, last];
    let image = image::Rgb32FImage::from_raw(2, 1, texels).unwrap();
    image.write_to(&mut bytes, image::ImageFormat::OpenExr).unwrap();
    bytes.into_inner()
}

#[test]
fn environments() {
    let folder = tempfile::tempdir().unwrap();
    let with = |arguments: &[&str], status: i32, names: &[&str]| {
        let arguments = [&["render", "builtin:cornell"][..], arguments, &OUTPUTS].concat();
        refused(folder.path(), &arguments, status, names);
    };
    let good = environment(2.0);
    for (name, contents) in [
        ("good.exr", good.clone()),
        ("nan.exr", environment(f32::NAN)),
        ("inf.exr", environment(f32::INFINITY)),
        ("less.exr", environment(-0.5)),
        ("half.exr", good[..good.len() / 2].to_vec()),
        ("empty.hdr", Vec::new()),
        ("text.hdr", b"hello".to_vec()),
        ("header.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n".to_vec()),
        ("large.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 99999\n".to_vec()),
        ("many.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 16384 +X 16384\n".to_vec()),
    ] {
        fs::write(folder.path().join(name), contents).unwrap();
    }
    for (file, name) in [
        ("nan.exr", "pixel (1, 0)"),
        ("inf.exr", "pixel (1, 0)"),
        ("less.exr", "pixel (1, 0)"),
        ("half.exr", "cannot be decoded"),
        ("empty.hdr", "neither Radiance HDR nor OpenEXR"),
        ("text.hdr", "neither Radiance HDR nor OpenEXR"),
        ("header.hdr", "cannot be decoded"),
        ("large.hdr", "99999 texels along an edge"),
        ("many.hdr", "268435456 texels"),
        ("none.hdr", "cannot be read"),
        (".", "cannot be read"),
    ] {
        with(&["--environment", file], 2, &["--environment", file, name]);
    }
    let map = ["--environment", "good.exr"];
    for (option, value, name) in [
        ("--environment-scale", "-1", "at least 0"),
        ("--environment-scale", "nan", "finite"),
        ("--environment-scale", "much", "finite"),
        ("--environment-turn", "inf", "finite number of degrees"),
        ("--environment-turn", "left", "finite number of degrees"),
        ("--environment-scale", "1e30", "pixel (0, 0)"),
    ] {
        with(&[&map[..], &[option, value]].concat(), 2, &["--environment", name]);
    }
    with(&["--environment-scale", "2"], 2, &["--environment <"]);
    with(&["--environment-turn", "2"], 2, &["--environment <"]);
    let over = ["render", "builtin:cornell", "--environment", "o.exr", "--out", "o.exr"];
    fs::write(folder.path().join("o.exr"), &good).unwrap();
    refused(folder.path(), &over, 2, &["--out", "o.exr", "overwrite the environment map"]);
    // What all of these were made from is fine: only the device is missing.
    with(&[&map[..], &["--environment-scale", "0.5", "--environment-turn", "-90"]].concat(), 3, &[]);
}

/// A picture as EXR or PNG by its name.
fn picture(path: &Path, width: u32, height: u32, value: f32) {
    let bytes = (0..width * height).flat_map(|_| [value; 4]).flat_map(f32::to_le_bytes).collect();
    let pixels = Pixels { extent: Extent::new(width, height), format: Format::Rgba32Float, bytes };
    let mut file = fs::File::create(path).unwrap();
    match path.extension().unwrap().to_str() {
        Some("png") => write_png(&mut file, &pixels).unwrap(),
        _ => write_exr(&mut file, &pixels).unwrap(),
    }
}

#[test]
fn pictures() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for (name, width, height, value) in [
        ("good.png", 8, 4, 0.5),
        ("good.exr", 8, 4, 0.5),
        ("other.png", 4, 8, 0.5),
        ("other.exr", 4, 8, 0.5),
        ("nan.exr", 8, 4, f32::NAN),
        ("infinite.exr", 8, 4, f32::NEG_INFINITY),
    ] {
        picture(&at(name), width, height, value);
    }
    let (png, exr) = (fs::read(at("good.png")).unwrap(), fs::read(at("good.exr")).unwrap());
    let mut flipped = png.clone();
    let middle = flipped.len() / 2;
    flipped[middle] ^= 0xff;
    let mut vast = png.clone();
    vast[16..24].fill(0x7f);
    for (name, contents) in [
        ("empty.png", &[][..]),
        ("half.png", &png[..png.len() / 2]),
        ("head.png", &png[..12]),
        ("flipped.png", &flipped),
        ("vast.png", &vast),
        ("half.exr", &exr[..exr.len() / 2]),
        ("head.exr", &exr[..8]),
    ] {
        fs::write(at(name), contents).unwrap();
        for pair in [[name, "good.png"], ["good.png", name]] {
            refused(folder.path(), &["compare", pair[0], pair[1], "--diff", "o.png"], 2, &[name]);
        }
    }
    for (a, b, names) in [
        ("other.png", "good.png", &["other.png against good.png", "4x8", "8x4"][..]),
        ("good.exr", "other.exr", &["good.exr against other.exr", "8x4", "4x8"]),
        ("nan.exr", "good.exr", &["nan.exr", "NaN", "channel 0", "(0, 0)"]),
        ("good.png", "infinite.exr", &["infinite.exr", "-inf", "(0, 0)"]),
    ] {
        refused(folder.path(), &["compare", a, b, "--json", "--diff", "o.png"], 2, names);
    }
    refused(folder.path(), &["compare", "good.png", "good.exr", "--diff", "good.png"], 2, &["--diff", "overwrite"]);
    refused(folder.path(), &["compare", "good.exr", "good.png", "--diff", "./good.png"], 2, &["overwrite"]);
}

/// One triangle, its buffer beside it as `b.bin`: three positions, then three 16-bit indices.
fn triangle() -> (Json, Vec<u8>) {
    let positions: [f32; 9] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let mut bytes: Vec<u8> = positions.iter().flat_map(|x| x.to_le_bytes()).collect();
    bytes.extend([0_u16, 1, 2].iter().flat_map(|i| i.to_le_bytes()));
    let scene = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
            {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 6},
        ],
        "buffers": [{"uri": "b.bin", "byteLength": 42}],
    });
    (scene, bytes)
}

/// Binary glTF 2.0: a header, then chunks of JSON and bytes.
fn container(json: &str, bytes: &[u8]) -> Vec<u8> {
    let pad = |mut chunk: Vec<u8>, with: u8| {
        chunk.resize(chunk.len().next_multiple_of(4), with);
        chunk
    };
    let (json, bytes) = (pad(json.as_bytes().to_vec(), b' '), pad(bytes.to_vec(), 0));
    let chunk = |kind: &[u8; 4], data: &[u8]| [&(data.len() as u32).to_le_bytes()[..], kind, data].concat();
    let body = [chunk(b"JSON", &json), chunk(b"BIN\0", &bytes)].concat();
    [b"glTF", &2_u32.to_le_bytes()[..], &(12 + body.len() as u32).to_le_bytes(), &body].concat()
}

#[test]
fn scenes() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let render = |scene: &str, names: &[&str]| {
        let arguments = [&["render", scene][..], &OUTPUTS].concat();
        refused(folder.path(), &arguments, 2, names);
    };
    render("builtin:nowhere", &["nowhere", "known: "]);
    render("builtin:cornel", &["cornel", "did you mean \"cornell\""]);
    render("builtin:", &["known: "]);
    render("none.gltf", &["none.gltf", "cannot be read"]);
    fs::create_dir(at("folder.gltf")).unwrap();
    render("folder.gltf", &["folder.gltf"]);

    let (scene, bytes) = triangle();
    let glb = container(&scene.to_string(), &bytes);
    let deep = format!("{{\"asset\": {}1{}}}", "[".repeat(100_000), "]".repeat(100_000));
    for (name, contents) in [
        ("empty.gltf", Vec::new()),
        ("empty.glb", Vec::new()),
        ("text.gltf", b"hello".to_vec()),
        ("text.glb", b"hello, this is no glTF".to_vec()),
        ("list.gltf", b"[]".to_vec()),
        ("bare.gltf", b"{}".to_vec()),
        ("deep.gltf", deep.into_bytes()),
        ("half.gltf", scene.to_string().into_bytes()[..200].to_vec()),
        ("half.glb", glb[..glb.len() / 2].to_vec()),
        ("header.glb", glb[..12].to_vec()),
        ("old.glb", [b"glTF", &1_u32.to_le_bytes()[..], &glb[8..]].concat()),
        ("long.glb", [&glb[..8], &u32::MAX.to_le_bytes(), &glb[12..]].concat()),
        ("chunk.glb", [&glb[..12], &u32::MAX.to_le_bytes(), &glb[16..]].concat()),
    ] {
        fs::write(at(name), contents).unwrap();
        render(name, &[name]);
    }

    fs::write(at("b.bin"), &bytes).unwrap();
    fs::write(at("short.bin"), &bytes[..20]).unwrap();
    let mut broken = bytes.clone();
    broken[..4].copy_from_slice(&f32::NAN.to_le_bytes());
    fs::write(at("nan.bin"), &broken).unwrap();
    let mut beyond = bytes.clone();
    beyond[40..42].copy_from_slice(&9_u16.to_le_bytes());
    fs::write(at("index.bin"), &beyond).unwrap();
    let cases: Vec<(&str, Json, &str)> = vec![
        ("/buffers/0/uri", json!("absent.bin"), "absent.bin"),
        ("/buffers/0/uri", json!("short.bin"), "truncated"),
        ("/buffers/0/uri", json!("nan.bin"), "not finite"),
        ("/buffers/0/uri", json!("index.bin"), "index"),
        ("/buffers/0/uri", json!("../../../../etc/passwd"), "passwd"),
        ("/buffers/0/uri", json!("/dev/zero"), "/dev/zero"),
        ("/buffers/0/uri", json!("data:application/octet-stream;base64,@@@@"), "URI"),
        ("/buffers/0/byteLength", json!(u64::MAX / 2), "buffer"),
        ("/bufferViews/0/byteLength", json!(4_000_000), "buffer"),
        ("/bufferViews/0/byteOffset", json!(u64::MAX / 2), "buffer"),
        ("/bufferViews/0/buffer", json!(7), "buffer"),
        ("/accessors/0/count", json!(1_000_000_000), "1000000000"),
        ("/accessors/0/bufferView", json!(9), "buffer view 9"),
        ("/accessors/0/type", json!("SCALAR"), "accessor"),
        ("/accessors/0/componentType", json!(1), "accessor 0"),
        ("/accessors/1/componentType", json!(5126), "accessor"),
        ("/meshes/0/primitives/0/attributes", json!({}), "POSITION"),
        ("/meshes/0/primitives/0/attributes/POSITION", json!(5), "accessor 5"),
        ("/meshes/0/primitives/0/indices", json!(5), "accessor 5"),
        ("/nodes/0/mesh", json!(3), "mesh 3"),
        ("/nodes", json!([{"mesh": 0, "children": [0]}]), "ancestor"),
        ("/scenes/0/nodes", json!([4]), "node 4"),
        ("/scenes/0/nodes", json!([]), "geometry"),
        ("/scene", json!(3), "scene 3"),
        ("/asset/version", json!("1.0"), "1.0"),
    ];
    for (pointer, value, name) in cases {
        let (mut scene, _) = triangle();
        *scene.pointer_mut(pointer).unwrap() = value;
        fs::write(at("bad.gltf"), scene.to_string()).unwrap();
        render("bad.gltf", &["bad.gltf", name]);
    }
    let (mut scene, _) = triangle();
    scene["extensionsRequired"] = json!(["EXT_of_the_future"]);
    fs::write(at("bad.gltf"), scene.to_string()).unwrap();
    render("bad.gltf", &["bad.gltf", "EXT_of_the_future"]);
    let (mut scene, _) = triangle();
    scene["nodes"][0]["scale"] = json!([1e300, 1, 1]);
    fs::write(at("bad.gltf"), scene.to_string()).unwrap();
    render("bad.gltf", &["bad.gltf", "node 0", "scale"]);

    // What all of these were made from is fine: only the device is missing.
    let (scene, _) = triangle();
    fs::write(at("good.gltf"), scene.to_string()).unwrap();
    fs::write(at("good.glb"), {
        let (mut scene, bytes) = triangle();
        scene["buffers"] = json!([{"byteLength": 42}]);
        container(&scene.to_string(), &bytes)
    })
    .unwrap();
    for good in ["good.gltf", "good.glb"] {
        refused(folder.path(), &[&["render", good][..], &OUTPUTS].concat(), 3, &[]);
    }
}

#[test]
fn no_device() {
    let folder = tempfile::tempdir().unwrap();
    let (list, names): (_, &[&str]) = (["devices"], &["Vulkan"]);
    refused(folder.path(), &list, 3, names);
    refused(folder.path(), &["devices", "--json"], 3, names);
    refused(folder.path(), &[&["render", "builtin:cornell"][..], &OUTPUTS].concat(), 3, names);
    refused(folder.path(), &["render", "builtin:cornell", "--device", "99", "--check"], 3, &[]);
    refused(folder.path(), &["bench", "graph", "--json", "o.json"], 3, &[]);
    refused(folder.path(), &["render", "builtin:cornell", "--rays", "query", "--check"], 3, &[]);
}
