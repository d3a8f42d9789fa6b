//! How the viewer ends, and with what exit status.
#![allow(clippy::unwrap_used, reason = "the helpers of tests fail as tests do")]

use std::{fs, path::PathBuf};

use serde_json::json;

mod window;
use window::*;

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

/// Who closes the window ends the program, and what was asked for by then is written.
#[test]
fn a_closed_window_is_no_failure() {
    let Some(display) = display() else { return };
    let folder = tempfile::tempdir().unwrap();
    let script = actions(folder.path(), &[(2, json!({"screenshot": "two.png"})), (3, json!("close"))]);
    done(&view(Some(display.name()), folder.path(), &["builtin:cornell", "--actions", script, "--no-panels"]));
    assert_eq!(size(&folder.path().join("two.png")), [400, 300]);
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
