//! A display without a screen.
#![allow(dead_code, reason = "not every test looks at what is shown")]

use std::{
    env, fs,
    io::{BufRead, BufReader, ErrorKind},
    process::{Child, Command, Stdio},
};

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
    pub fn shown(&self, [width, height]: [usize; 2]) -> Vec<[u8; 3]> {
        // A file of the X window dump format, version 7: a header of big-endian words, the colour map, the pixels.
        let dump = fs::read(self.memory.path().join("Xvfb_screen0")).unwrap();
        let word = |at: usize| u32::from_be_bytes(dump[4 * at..4 * at + 4].try_into().unwrap()) as usize;
        let (header, version, bits, row, colours) = (word(0), word(1), word(11), word(12), word(19));
        assert_eq!((version, bits), (7, 32));
        let pixels = &dump[header + 12 * colours..];
        let pixel = |x: usize, y: usize| {
            let at = y * row + 4 * x;
            [pixels[at + 2], pixels[at + 1], pixels[at]]
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
    if env::var_os("MAGPIE_NO_GPU").is_some() {
        eprintln!("skipped: MAGPIE_NO_GPU is set");
        return None;
    }
    let memory = tempfile::tempdir().unwrap();
    let server = Command::new("Xvfb")
        .args(["-displayfd", "1", "-screen", "0", "800x600x24", "-nolisten", "tcp", "-fbdir"])
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
