//! What is written where something is already: links, protected files, pipes, devices.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "the helpers of tests fail as tests do")]

use std::{
    fs,
    io::Read,
    os::unix::fs::{PermissionsExt, symlink},
    path::Path,
    process::{Command, Output, Stdio},
    thread,
};

use magpie::{
    graph::{Extent, Format},
    pixels::Pixels,
};
use magpie_demo::write_png;
use tempfile::TempDir;

const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";

/// A folder with two pictures to compare.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, value) in [("a.png", 10), ("b.png", 200)] {
        let (extent, format) = (Extent::new(16, 16), Format::Rgba8Unorm);
        let pixels = Pixels { extent, format, bytes: vec![value; 16 * 16 * 4] };
        write_png(&mut fs::File::create(folder.path().join(name)).unwrap(), &pixels).unwrap();
    }
    folder
}

fn compare(folder: &Path, diff: &str, stdout: Stdio) -> Output {
    let arguments = ["compare", "a.png", "b.png", "--diff", diff];
    let program = env!("CARGO_BIN_EXE_magpie");
    Command::new(program).args(arguments).current_dir(folder).stdout(stdout).output().unwrap()
}

fn done(output: &Output) {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

fn is_picture(path: &Path) -> bool {
    fs::read(path).is_ok_and(|bytes| bytes.starts_with(PNG))
}

#[test]
fn the_target_of_a_link_is_written_and_the_link_stays() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    fs::create_dir(at("else")).unwrap();
    fs::write(at("else/old.png"), "old").unwrap();
    fs::set_permissions(at("else/old.png"), fs::Permissions::from_mode(0o600)).unwrap();
    for (link, target) in [("old.png", "else/old.png"), ("new.png", "else/new.png")] {
        symlink(target, at(link)).unwrap();
        done(&compare(folder.path(), link, Stdio::null()));
        assert!(fs::symlink_metadata(at(link)).unwrap().is_symlink(), "{link} is no link any more");
        assert!(is_picture(&at(target)), "{target}");
    }
    assert_eq!(fs::metadata(at("else/old.png")).unwrap().permissions().mode() & 0o777, 0o600);
}

#[test]
fn a_protected_file_is_refused_before_any_work() {
    let folder = folder();
    let path = folder.path().join("kept.png");
    fs::write(&path, "old").unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o444)).unwrap();
    symlink("kept.png", folder.path().join("link.png")).unwrap();
    for name in ["kept.png", "link.png"] {
        let output = compare(folder.path(), name, Stdio::null());
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(message.contains(&format!("--diff {name}: the file is protected against writing")), "{message}");
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
    }
}

#[test]
fn pipes_and_devices_are_written_to() {
    let folder = folder();
    let pipe = folder.path().join("pipe");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let read = thread::spawn({
        let pipe = pipe.clone();
        move || {
            let mut bytes = Vec::new();
            fs::File::open(pipe).unwrap().read_to_end(&mut bytes).unwrap();
            bytes
        }
    });
    done(&compare(folder.path(), "pipe", Stdio::null()));
    assert!(read.join().unwrap().starts_with(PNG));
    assert!(!fs::symlink_metadata(&pipe).unwrap().is_file(), "the pipe became a file");

    done(&compare(folder.path(), "/dev/null", Stdio::null()));
    assert!(!fs::metadata("/dev/null").unwrap().is_file());

    let output = compare(folder.path(), "/dev/stdout", Stdio::piped());
    done(&output);
    let has_picture = |bytes: &[u8]| bytes.windows(PNG.len()).any(|w| w == PNG);
    assert!(has_picture(&output.stdout) && String::from_utf8_lossy(&output.stdout).contains("RMSE"));
    // Into a file too, where nothing is written over.
    let into = folder.path().join("all.txt");
    done(&compare(folder.path(), "/dev/stdout", fs::File::create(&into).unwrap().into()));
    let bytes = fs::read(&into).unwrap();
    assert!(has_picture(&bytes) && String::from_utf8_lossy(&bytes).contains("RMSE"));
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 4, "something was left behind");
}
