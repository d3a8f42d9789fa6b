//! Commands that need no device.
#![allow(clippy::unwrap_used, reason = "the helpers of tests fail as tests do")]

use std::process::{Command, Output, Stdio};

use magpie::config::Config;
use serde_json::Value;

fn magpie(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_magpie")).args(arguments).stdin(Stdio::null()).output().unwrap()
}

fn said(arguments: &[&str]) -> String {
    let output = magpie(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn scenes_are_listed_as_they_are_named_on_the_command_line() {
    let text = said(&["scenes"]);
    assert!(text.lines().any(|l| l.starts_with("builtin:cornell ")), "{text}");
    assert!(text.lines().any(|l| l.starts_with("builtin:courtyard ")), "{text}");
    let parameter = "builtin:night-market?lights=1000: number of lamps, 10 to 100000";
    assert!(text.lines().any(|l| l.trim_start() == parameter), "{text}");
}

/// A scene is named as it is listed, and its parameter counts.
#[test]
fn a_parameter_follows_the_name_of_a_scene() {
    let lights = |scene: &str| {
        let json: Value = serde_json::from_str(&said(&["plan", scene, "--json", "--size", "64x36"])).unwrap();
        json["facts"]["lights"].as_array().unwrap().len()
    };
    assert_eq!(lights("builtin:night-market"), 1000);
    assert_eq!(lights("builtin:night-market?lights=10"), 10);
}

#[test]
fn stages_are_listed_for_people_and_programs() {
    let text = said(&["stages"]);
    let json: Value = serde_json::from_str(&said(&["stages", "--json"])).unwrap();
    for slot in json.as_array().unwrap() {
        let (name, default) = (slot["name"].as_str().unwrap(), slot["default"].as_str().unwrap());
        assert!(text.contains(&format!("{name}: ")) && text.contains(&format!("  {default} (default): ")), "{text}");
        assert!(slot["implementations"].as_array().unwrap().iter().any(|i| i["name"] == default));
    }
}

/// Without a device: the plan says what runs, and why the rest does not.
#[test]
fn a_plan_says_what_runs_and_why_not() {
    let text = said(&["plan", "builtin:cornell"]);
    for line in ["idle: the scene has no sky", "idle: no material emits", "lights: rectangle; without sky"] {
        assert!(text.contains(line), "{text}");
    }
    let json: Value = serde_json::from_str(&said(&["plan", "builtin:cornell", "--json", "--size", "64x36"])).unwrap();
    let slots = json["slots"].as_array().unwrap();
    let slot = |name: &str| slots.iter().find(|slot| slot["slot"] == name).unwrap();
    for (name, runs) in
        [("gbuffer", true), ("shadows", true), ("gi", true), ("reflections", false), ("sky", false), ("rays", false)]
    {
        assert_eq!((slot(name)["runs"].as_bool(), slot(name)["reason"].is_string()), (Some(runs), !runs), "{name}");
    }
    assert_eq!(slot("reflections")["reason"], "the scene has no sky");
    assert_eq!(slot("shadows")["implementation"], "ray-traced");
    assert!(slot("shadows")["passes"].as_array().unwrap().iter().any(|pass| pass == "shadows.trace"));
    assert!(json["memory"]["transient_bytes"].as_u64().unwrap() > 0 && json["bytes_per_pixel"].as_f64().unwrap() > 0.0);
    assert_eq!(json["facts"]["lights"][0]["kind"], "rectangle");
}

#[test]
fn the_printed_configuration_is_whole_and_reads_back() {
    let text = said(&["render", "--print-config", "--set", "stages.shadows=off"]);
    let config = Config::from_toml(&text, "printed").unwrap();
    let catalogue = magpie_passes::Slots::default().catalogue();
    catalogue.check(&config, "printed").unwrap();
    assert_eq!(catalogue.complete(&config), config);
    assert_eq!(config.stages["shadows"], "off");
}

#[test]
fn help_and_version_are_no_errors() {
    assert!(said(&["--help"]).contains("render"));
    assert!(said(&["render", "--help"]).contains("--dump-graph"));
    assert!(said(&["--version"]).contains(env!("CARGO_PKG_VERSION")));
}

#[test]
fn a_reader_that_goes_away_is_no_failure() {
    for arguments in [&["stages", "--json"][..], &["scenes"], &["--help"], &["render", "--print-config"]] {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let output = Command::new(env!("CARGO_BIN_EXE_magpie")).args(arguments).stdout(writer).output().unwrap();
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success() && stderr.is_empty(), "{arguments:?}: {:?} {stderr}", output.status);
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_a_failure() {
    let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_magpie")).arg("stages").stdout(full).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("standard output"));
}
