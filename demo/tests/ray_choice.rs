//! Devices are honest about rays: what is not there is refused by name, and a choice is told with its reason. Needs a device.
#![allow(clippy::unwrap_used, reason = "the helpers of tests fail as tests do")]

use std::{
    env,
    process::{Command, Output},
};

use serde_json::Value as Json;

/// Runs the program; `None` where no device is wanted.
fn magpie(arguments: &[&str]) -> Option<Output> {
    if env::var_os("MAGPIE_NO_GPU").is_some() {
        eprintln!("skipped: MAGPIE_NO_GPU is set");
        return None;
    }
    let mut command = Command::new(env!("CARGO_BIN_EXE_magpie"));
    command.args(arguments);
    if let (Ok(device), Some(&"render")) = (env::var("MAGPIE_DEVICE"), arguments.first()) {
        command.args(["--device", &device]);
    }
    Some(command.output().unwrap())
}

const SMALL: [&str; 7] = ["render", "builtin:cornell", "--size", "16x16", "--frames", "1", "-v"];

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn a_way_that_the_device_has_not_is_refused_by_name() {
    for way in ["query", "pipeline"] {
        let Some(output) = magpie(&[&SMALL[..], &["--rays", way, "--without-rays", way]].concat()) else { return };
        let text = said(&output);
        assert_eq!(output.status.code(), Some(3), "{text}");
        let about = text.lines().last().unwrap();
        assert!(about.contains(&format!("--rays {way}")) && about.contains("software"), "{text}");
        // The other way is still there, where the driver has it.
        let other = if way == "query" { "pipeline" } else { "query" };
        let has = magpie(&["devices", "--json"]).unwrap();
        let devices: Json = serde_json::from_slice(&has.stdout).unwrap();
        let listed = devices.as_array().or_else(|| devices["devices"].as_array()).unwrap();
        let all = listed.iter().all(|d| d["rays"].as_array().unwrap().iter().any(|r| r == other));
        assert!(!all || about.contains(other), "{text}");
    }
    let Some(output) = magpie(&[&SMALL[..], &["--rays", "query", "--without-rays", "query,pipeline"]].concat()) else {
        return;
    };
    let text = said(&output);
    assert_eq!(output.status.code(), Some(3), "{text}");
    assert!(!text.lines().last().unwrap().contains("pipeline"), "{text}");
}

#[test]
fn a_choice_is_told_with_its_reason() {
    let Some(output) = magpie(&[&SMALL[..], &["--rays", "auto"]].concat()) else { return };
    let text = said(&output);
    assert_eq!(output.status.code(), Some(0), "{text}");
    let lines: Vec<&str> = text.lines().filter(|l| l.contains("rays:")).collect();
    assert!(lines.len() == 1 && lines[0].contains("since"), "{text}");

    // Where the driver traces none, the walk is taken, whatever the device is.
    let Some(output) = magpie(&[&SMALL[..], &["--without-rays", "query,pipeline"]].concat()) else { return };
    let text = said(&output);
    assert_eq!(output.status.code(), Some(0), "{text}");
    assert!(text.lines().any(|l| l.contains("rays: software, since")), "{text}");
}
