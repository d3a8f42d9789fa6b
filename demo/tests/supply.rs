//! `--supply`: what a scene is given that lacks it, and what is said about it. No driver is visible here: what is loaded ends with
//! exit status 3, what cannot be shown with 2.
#![allow(clippy::unwrap_used, reason = "the helpers of tests fail as tests do")]

use std::{fs, path::Path, process::Command};

use serde_json::{Value, json};

/// Two squares, one above the other and 1 m apart, that face each other; the upper one emits so much. No light, no camera.
fn squares(emission: f64) -> (Value, Vec<u8>) {
    let corners: [[f32; 3]; 8] = [
        [-1.0, 0.0, 1.0],
        [1.0, 0.0, 1.0],
        [1.0, 0.0, -1.0],
        [-1.0, 0.0, -1.0],
        [-1.0, 1.0, -1.0],
        [1.0, 1.0, -1.0],
        [1.0, 1.0, 1.0],
        [-1.0, 1.0, 1.0],
    ];
    let mut bytes: Vec<u8> = corners.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
    bytes.extend([0_u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()));
    let square = |positions: u32, material: u32| json!({"attributes": {"POSITION": positions}, "indices": 2, "material": material});
    let positions = |y: u32| {
        let (min, max) = ([-1, y as i32, -1], [1, y as i32, 1]);
        json!({"bufferView": 0, "byteOffset": 48 * y, "componentType": 5126, "count": 4, "type": "VEC3", "min": min, "max": max})
    };
    let strong = json!({"KHR_materials_emissive_strength": {"emissiveStrength": emission}});
    let scene = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "extensionsUsed": ["KHR_materials_emissive_strength"],
        "meshes": [{"primitives": [square(0, 0), square(1, 1)]}],
        "materials": [{}, {"emissiveFactor": [1, 1, 1], "extensions": strong}],
        "accessors": [positions(0), positions(1), {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"}],
        "bufferViews": [{"buffer": 0, "byteLength": 96}, {"buffer": 0, "byteOffset": 96, "byteLength": 12}],
        "buffers": [{"uri": "b.bin", "byteLength": 108}],
    });
    (scene, bytes)
}

fn run(folder: &Path, arguments: &[&str]) -> (Option<i32>, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_magpie"))
        .args(arguments)
        .current_dir(folder)
        .env("VK_DRIVER_FILES", "/nonexistent.json")
        .env("VK_ICD_FILENAMES", "/nonexistent.json")
        .output()
        .unwrap();
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

fn write(folder: &Path, name: &str, emission: f64) {
    let (scene, bytes) = squares(emission);
    fs::write(folder.join(name), scene.to_string()).unwrap();
    fs::write(folder.join("b.bin"), bytes).unwrap();
}

const CAMERA: &str = "position = [0.0, 0.5, 3.0]\ntarget = [0.0, 0.5, 0.0]\n";

#[test]
fn what_is_refused_is_not_added() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write(folder, "dark.gltf", 0.0);
    write(folder, "lit.gltf", 4.0);
    fs::write(folder.join("c.toml"), CAMERA).unwrap();
    let (camera, sun, own) = ("no camera: one at", "the scene has no light", "what emits lights");
    for (arguments, wanted, unwanted) in [
        (&["dark.gltf"][..], &[camera, sun][..], &[own][..]),
        (&["dark.gltf", "--supply", "all"], &[camera, sun], &[own]),
        (&["dark.gltf", "--supply", "camera"], &[camera], &[sun, own]),
        (&["dark.gltf", "--supply", "none", "--camera", "c.toml"], &[], &[camera, sun, own]),
        (&["lit.gltf"], &[camera, own], &[sun]),
        (&["lit.gltf", "--supply", "camera"], &[camera], &[own, sun]),
        (&["builtin:cornell"], &[], &[camera, sun, own]),
        (&["builtin:cornell", "--supply", "none"], &[], &[camera, sun, own]),
    ] {
        let arguments = [&["render", "-v"][..], arguments].concat();
        let (status, said) = run(folder, &arguments);
        assert_eq!(status, Some(3), "{arguments:?}: {said}");
        for text in wanted {
            assert!(said.contains(text), "{arguments:?}: wanted {text:?} in:\n{said}");
        }
        for text in unwanted {
            assert!(!said.contains(text), "{arguments:?}: did not want {text:?} in:\n{said}");
        }
    }
}

#[test]
fn without_any_camera_there_is_an_error_that_says_what_helps() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write(folder, "dark.gltf", 0.0);
    for command in [
        &["render", "dark.gltf"][..],
        &["reference", "dark.gltf", "--samples", "1", "--out", "r.exr"],
        &["accuracy", "dark.gltf", "--out", "a"],
        &["bench", "rays", "--scene", "dark.gltf"],
        &["bench", "motion", "dark.gltf"],
    ] {
        let (status, said) = run(folder, &[command, &["--supply", "none"]].concat());
        assert_eq!(status, Some(2), "{command:?}: {said}");
        assert!(
            said.contains("dark: the scene has no camera") && said.contains("--supply camera"),
            "{command:?}: {said}"
        );
        let (status, said) = run(folder, &[command, &["--supply", "moon"]].concat());
        assert!(status == Some(2) && said.contains("none, camera, all"), "{command:?}: {said}");
    }
    let left = fs::read_dir(folder).unwrap().count();
    assert_eq!(left, 2, "the scene and its buffer are all there is");
}
