//! `magpie compare` on pictures with known errors. Bad input is in `bad_input.rs`.
#![allow(clippy::unwrap_used, reason = "the helpers of tests fail as tests do")]

use std::{
    fs::File,
    path::Path,
    process::{Command, Output, Stdio},
};

use magpie::{
    graph::{Extent, Format},
    pixels::Pixels,
};
use magpie_demo::{read_picture, write_exr, write_png};
use serde_json::Value;

const WIDTH: u32 = 24;
const HEIGHT: u32 = 16;

fn compare(folder: &Path, arguments: &[&str]) -> Output {
    // No driver is visible: no device is needed.
    let mut command = Command::new(env!("CARGO_BIN_EXE_magpie"));
    command.env("VK_DRIVER_FILES", "/nonexistent.json").env("VK_ICD_FILENAMES", "/nonexistent.json");
    command.arg("compare").args(arguments).current_dir(folder).stdin(Stdio::null()).output().unwrap()
}

fn said(folder: &Path, arguments: &[&str]) -> String {
    let output = compare(folder, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// A picture of one value in all channels, another from the middle on.
fn exr(folder: &Path, name: &str, left: f32, right: f32) {
    let values = (0..WIDTH * HEIGHT).flat_map(|i| {
        let x = if i % WIDTH < WIDTH / 2 { left } else { right };
        [x, x, x, 1.0_f32]
    });
    let bytes = values.flat_map(f32::to_le_bytes).collect();
    let pixels = Pixels { extent: Extent::new(WIDTH, HEIGHT), format: Format::Rgba32Float, bytes };
    write_exr(&mut File::create(folder.join(name)).unwrap(), &pixels).unwrap();
}

fn png(folder: &Path, name: &str, grey: u8) {
    let bytes = (0..WIDTH * HEIGHT).flat_map(|_| [grey, grey, grey, 255]).collect();
    let pixels = Pixels { extent: Extent::new(WIDTH, HEIGHT), format: Format::Rgba8Unorm, bytes };
    write_png(&mut File::create(folder.join(name)).unwrap(), &pixels).unwrap();
}

fn near(json: &Value, field: &str, wanted: f64) {
    let got = json[field].as_f64().unwrap();
    assert!((got - wanted).abs() <= 1e-6 * wanted.abs(), "{field}: {got}, wanted {wanted}");
}

#[test]
fn known_pictures_give_known_numbers_to_people_and_programs() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    exr(at, "a.exr", 5.0, 0.5);
    exr(at, "b.exr", 4.0, 0.5);
    let json: Value = serde_json::from_str(&said(at, &["a.exr", "b.exr", "--json"])).unwrap();
    assert_eq!((json["test"].as_str(), json["reference"].as_str()), (Some("a.exr"), Some("b.exr")));
    assert_eq!((json["width"].as_u64(), json["height"].as_u64()), (Some(24), Some(16)));
    near(&json, "rmse", 0.5_f64.sqrt());
    near(&json, "relmse", 0.5 / 16.0001);
    near(&json, "smape", 0.5 / 9.01);
    near(&json, "mean_test", 2.75);
    near(&json, "mean_reference", 2.25);
    // A display shows 4 and 5 as the same white, two pictures in high dynamic range do not.
    assert!(json["psnr"].is_null() && json["flip_ldr"] == 0.0, "{json}");
    near(&json, "ssim", 1.0);
    assert!(json["flip_hdr"].as_f64().unwrap() > 0.01, "{json}");

    let text = said(at, &["a.exr", "b.exr"]);
    assert!(text.starts_with("a.exr against b.exr, 24x16\n"), "{text}");
    for line in ["RMSE                0.707107  ", "SMAPE               0.055494  ", "PSNR                   equal  "] {
        assert!(text.contains(line), "{text}");
    }
    for name in ["relMSE", "SSIM", "FLIP", "FLIP HDR", "mean"] {
        assert!(text.lines().any(|line| line.trim_start().starts_with(&format!("{name}  "))), "{name}: {text}");
    }
}

#[test]
fn a_picture_equals_itself_and_the_second_is_the_reference() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    png(at, "a.png", 100);
    png(at, "b.png", 140);
    let json = |a: &str, b: &str| serde_json::from_str::<Value>(&said(at, &[a, b, "--json"])).unwrap();
    let same = json("a.png", "a.png");
    for field in ["rmse", "relmse", "smape", "flip_ldr", "flip_hdr"] {
        assert_eq!(same[field].as_f64(), Some(0.0), "{field}");
    }
    let (there, back) = (json("a.png", "b.png"), json("b.png", "a.png"));
    near(&there, "psnr", 20.0 * (255.0_f64 / 40.0).log10());
    assert_eq!(there["rmse"], back["rmse"]);
    assert!(there["relmse"].as_f64() < back["relmse"].as_f64(), "the darker reference weighs an error more");
}

#[test]
fn the_drawing_shows_both_and_their_difference() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    png(at, "a.png", 100);
    png(at, "b.png", 140);
    said(at, &["a.png", "b.png", "--diff", "d.png"]);
    let (drawn, _) = read_picture(&at.join("d.png")).unwrap();
    assert_eq!((drawn.width, drawn.height), (3 * 24 + 2 * 4, 16));
    let bytes = drawn.to_srgb8();
    let pixel = |x: usize| &bytes[3 * x..3 * x + 3];
    assert_eq!((pixel(0), pixel(25), pixel(28)), (&[100; 3][..], &[255; 3][..], &[140; 3][..]));
    let colour = pixel(24 + 4 + 24 + 4 + 12);
    assert!(colour[0] > 20 && colour[2] > colour[1], "magma of a small error is violet: {colour:?}");

    exr(at, "a.exr", 50.0, 0.5);
    exr(at, "b.exr", 10.0, 0.5);
    said(at, &["a.exr", "b.exr", "--diff", "d.png", "--json"]);
    let bytes = read_picture(&at.join("d.png")).unwrap().0.to_srgb8();
    let light = |x: usize| bytes[3 * x..3 * x + 3].iter().map(|&b| u32::from(b)).sum::<u32>();
    assert!(light(0) > light(28), "radiance is not cut");
    assert!(light(56 + 2) > 100 && light(56 + 22) < 12, "the left half differs: {} {}", light(58), light(78));
}
