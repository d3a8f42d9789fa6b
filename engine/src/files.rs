//! Opening files that strangers name.

use std::fs::{self, File, FileType};
use std::io::{Error, Result};
use std::path::Path;

/// Opens a file to be read, and gives its size in bytes. Only regular files, links followed: what is a pipe, a device or a socket may make
/// whoever reads it wait for ever, and has no size.
///
/// # Errors
/// Whatever the system says; for anything but a regular file, a sentence that says what it is.
pub fn open_regular(path: &Path) -> Result<(File, u64)> {
    // Looked at before it is opened: opening a pipe waits for whoever writes to it.
    regular(fs::metadata(path)?.file_type())?;
    let file = File::open(path)?;
    let meta = file.metadata()?;
    regular(meta.file_type())?;
    Ok((file, meta.len()))
}

fn regular(kind: FileType) -> Result<()> {
    match what(kind) {
        None => Ok(()),
        Some(what) => Err(Error::other(format!("wanted a regular file, this is {what}"))),
    }
}

/// What a thing in a file system is that is no regular file.
pub fn what(kind: FileType) -> Option<&'static str> {
    if kind.is_file() {
        return None;
    }
    if kind.is_dir() {
        return Some("a folder");
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt;
        if kind.is_fifo() {
            return Some("a named pipe");
        }
        if kind.is_socket() {
            return Some("a socket");
        }
        if kind.is_char_device() || kind.is_block_device() {
            return Some("a device");
        }
    }
    Some("something else")
}
