//! Reading files: containers, URIs and buffers.
use super::{Import, Of};
use crate::files::open_regular;
use crate::scene::SceneError;
use crate::scene::error::Fault;
use gltf::json;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Largest file, bytes.
const MAX_FILE: u64 = 1 << 32;
/// Largest sum of all buffers, bytes.
const MAX_BUFFERS: u64 = 1 << 33;

/// Reads a scene file: its parsed JSON, and the binary chunk of a .glb.
pub(super) fn open(path: &Path, notices: &mut Vec<String>) -> Result<(json::Root, Option<Vec<u8>>), SceneError> {
    let read = |source| SceneError::Read { path: path.to_owned(), source };
    let (file, size) = open_regular(path).map_err(read)?;
    if size > MAX_FILE {
        return Err(SceneError::TooLarge { path: path.to_owned(), got: size, limit: MAX_FILE });
    }
    let mut bytes = Vec::with_capacity(size as usize);
    file.take(MAX_FILE).read_to_end(&mut bytes).map_err(read)?;
    let (text, bin) = if bytes.starts_with(b"glTF") { split_glb(path, &bytes)? } else { (&bytes[..], None) };
    let refuse = |reason: String| SceneError::NotGltf { path: path.to_owned(), reason };
    let text = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text);
    let root = parse(text, notices).map_err(|e| refuse(e.to_string()))?;
    let asked = root.asset.min_version.as_ref().unwrap_or(&root.asset.version);
    if !(asked == "2.0" || (root.asset.min_version.is_none() && asked.starts_with("2."))) {
        let version: String = asked.chars().filter(|c| !c.is_control()).take(16).collect();
        return Err(refuse(format!("version {version:?}, wanted 2.0")));
    }
    Ok((root, bin.map(<[u8]>::to_vec)))
}

/// Parses the JSON. The `gltf` crate requires every animation channel to have a node, although glTF lets extensions omit it. If
/// parsing fails, it is repeated without such channels.
fn parse(text: &[u8], notices: &mut Vec<String>) -> Result<json::Root, json::Error> {
    let error = match json::deserialize::from_slice(text) {
        Ok(root) => return Ok(root),
        Err(error) => error,
    };
    let Ok(mut root) = json::deserialize::from_slice::<json::Value>(text) else { return Err(error) };
    let mut nodeless = 0;
    let animations = root.get_mut("animations").and_then(|a| a.as_array_mut());
    for channels in animations.into_iter().flatten().filter_map(|a| a.get_mut("channels")?.as_array_mut()) {
        let before = channels.len();
        channels.retain(|c| c.get("target").is_none_or(|t| t.get("node").is_some()));
        nodeless += before - channels.len();
    }
    if nodeless == 0 {
        return Err(error);
    }
    notices.push(format!("{nodeless} channels of animations without a node: ignored"));
    json::deserialize::from_value(root)
}

/// The JSON and the binary chunk of a .glb (glTF 2.0 specification, section 4).
fn split_glb<'a>(path: &Path, bytes: &'a [u8]) -> Result<(&'a [u8], Option<&'a [u8]>), SceneError> {
    let cut =
        |what, wanted: u64, got: usize| SceneError::Truncated { path: path.to_owned(), what, wanted, got: got as u64 };
    let word = |at: usize| bytes.get(at..at + 4).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes);
    let refuse = |reason: String| SceneError::NotGltf { path: path.to_owned(), reason };
    let (Some(version), Some(length)) = (word(4), word(8)) else {
        return Err(cut("the header", 12, bytes.len()));
    };
    if version != 2 {
        return Err(refuse(format!("container version {version}, wanted 2")));
    }
    if length as usize > bytes.len() {
        return Err(cut("the container", length as u64, bytes.len()));
    }
    let bytes = &bytes[..length as usize];
    let mut at = 12;
    let (mut text, mut bin) = (None, None);
    while at < bytes.len() {
        let rest = bytes.len() - at;
        let (Some(size), Some(kind)) = (word(at), bytes.get(at + 4..at + 8)) else {
            return Err(cut("a chunk header", 8, rest));
        };
        let Some(chunk) = (at + 8).checked_add(size as usize).and_then(|end| bytes.get(at + 8..end)) else {
            return Err(cut("a chunk", size as u64, rest.saturating_sub(8)));
        };
        match (kind, text) {
            (b"JSON", None) => text = Some(chunk),
            (_, None) => return Err(refuse("the first chunk is not JSON".to_owned())),
            (b"BIN\0", _) if bin.is_none() => bin = Some(chunk),
            // The specification requires that chunks of other types are ignored.
            _ => {}
        }
        at += 8 + size as usize;
        // Chunks start at multiples of four bytes. Missing padding at the end of the file is accepted.
        at = at.next_multiple_of(4).min(bytes.len().max(at));
    }
    match text {
        Some(text) => Ok((text, bin)),
        None => Err(cut("the JSON chunk", 20, bytes.len())),
    }
}

/// The bytes of every buffer.
pub(super) fn buffers(root: &json::Root, mut bin: Option<Vec<u8>>, folder: &Path) -> Import<Vec<Vec<u8>>> {
    let mut total = 0_u64;
    let mut all = Vec::with_capacity(root.buffers.len());
    for (i, buffer) in root.buffers.iter().enumerate() {
        let element = || format!("buffer {i}");
        let wanted = buffer.byte_length.0;
        total = total.saturating_add(wanted);
        if total > MAX_BUFFERS {
            return Err(Fault::Limit { what: "bytes of buffers", got: total, limit: MAX_BUFFERS }).of(element);
        }
        let mut bytes = match &buffer.uri {
            Some(uri) => fetch(uri, folder, Some(wanted)).of(element)?,
            None if i == 0 => bin.take().ok_or(Fault::Missing("the binary chunk")).of(element)?,
            None => return Err(Fault::Missing("its URI")).of(element),
        };
        if (bytes.len() as u64) < wanted {
            return Err(Fault::Truncated { wanted, got: bytes.len() as u64 }).of(element);
        }
        bytes.truncate(wanted as usize);
        all.push(bytes);
    }
    Ok(all)
}

/// The bytes behind a URI: a data URI, or a file in the scene's folder. At most `limit` bytes of a file are read.
pub(super) fn fetch(uri: &str, folder: &Path, limit: Option<u64>) -> Result<Vec<u8>, Fault> {
    if let Some(data) = uri.strip_prefix("data:") {
        let refuse = |reason: &str| Fault::Uri { uri: shorten(uri), reason: reason.to_owned() };
        let (kind, payload) = data.split_once(',').ok_or_else(|| refuse("a data URI without a comma"))?;
        if !kind.ends_with(";base64") {
            return Err(refuse("a data URI that is not base64"));
        }
        return base64(payload).ok_or_else(|| refuse("its base64 is faulty"));
    }
    let path = resolve(uri, folder)?;
    let failed = |reason: String| Fault::File { uri: shorten(uri), reason };
    let (file, size) = open_regular(&path).map_err(|e| failed(e.to_string()))?;
    if limit.is_none() && size > MAX_FILE {
        return Err(Fault::Limit { what: "bytes", got: size, limit: MAX_FILE });
    }
    let size = size.min(limit.unwrap_or(MAX_FILE));
    let mut bytes = Vec::with_capacity(size as usize);
    file.take(size).read_to_end(&mut bytes).map_err(|e| failed(e.to_string()))?;
    Ok(bytes)
}

/// The path of a relative URI. It must be inside the scene's folder after resolving symbolic links.
fn resolve(uri: &str, folder: &Path) -> Result<PathBuf, Fault> {
    let refuse = |reason: &str| Fault::Uri { uri: shorten(uri), reason: reason.to_owned() };
    let name = percent_decode(uri).ok_or_else(|| refuse("its percent encoding is faulty"))?;
    if name.contains(['\0', '\\']) {
        return Err(refuse("it holds a NUL or a backslash"));
    }
    if name.starts_with('/') {
        return Err(refuse("an absolute path"));
    }
    let scheme = name.split(['/', '?', '#']).next().unwrap_or_default();
    if scheme.contains(':') {
        return Err(refuse("only data URIs and relative paths are read"));
    }
    let mut depth = 0_i64;
    for part in name.split('/') {
        match part {
            "" | "." => {}
            ".." => depth -= 1,
            _ => depth += 1,
        }
        if depth < 0 {
            return Err(refuse("it leaves the scene's folder"));
        }
    }
    let failed = |e: std::io::Error| Fault::File { uri: shorten(uri), reason: e.to_string() };
    let home = folder.canonicalize().map_err(failed)?;
    let path = folder.join(&name).canonicalize().map_err(failed)?;
    if !path.starts_with(&home) {
        return Err(refuse("it leaves the scene's folder through a link"));
    }
    Ok(path)
}

fn shorten(uri: &str) -> String {
    uri.chars().take(80).collect()
}

fn percent_decode(text: &str) -> Option<String> {
    let mut out = Vec::with_capacity(text.len());
    let mut bytes = text.bytes();
    while let Some(b) = bytes.next() {
        out.push(if b == b'%' {
            let digit = |b: Option<u8>| (b? as char).to_digit(16);
            (digit(bytes.next())? * 16 + digit(bytes.next())?) as u8
        } else {
            b
        });
    }
    String::from_utf8(out).ok()
}

/// Decodes base64 (RFC 4648, standard alphabet); padding is optional.
fn base64(text: &str) -> Option<Vec<u8>> {
    let text = text.trim_end_matches('=');
    let mut out = Vec::with_capacity(text.len() / 4 * 3 + 3);
    let (mut bits, mut held) = (0_u32, 0);
    for b in text.bytes() {
        let value = match b {
            b'A'..=b'Z' => b - b'A',
            b'a'..=b'z' => b - b'a' + 26,
            b'0'..=b'9' => b - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            _ => return None,
        };
        bits = bits << 6 | value as u32;
        held += 6;
        if held >= 8 {
            held -= 8;
            out.push((bits >> held) as u8);
            bits &= (1 << held) - 1;
        }
    }
    // A single remaining letter does not make a byte.
    (text.len() % 4 != 1).then_some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_of_the_rfc() {
        for (text, bytes) in
            [("", ""), ("Zg==", "f"), ("Zm8=", "fo"), ("Zm9v", "foo"), ("Zm9vYmFy", "foobar"), ("Zm8", "fo")]
        {
            assert_eq!(base64(text).as_deref(), Some(bytes.as_bytes()), "{text}");
        }
        for text in ["Z", "Zm9v\n", "Zm9vY", "Zm=v", "Zm-v"] {
            assert_eq!(base64(text), None, "{text:?}");
        }
    }

    #[test]
    fn uris_stay_in_the_folder() {
        let folder = tempfile::tempdir().unwrap();
        let home = folder.path().join("scene");
        std::fs::create_dir_all(home.join("in side")).unwrap();
        std::fs::write(home.join("in side/a.bin"), b"abc").unwrap();
        std::fs::write(folder.path().join("secret"), b"no").unwrap();
        assert_eq!(fetch("in%20side/a.bin", &home, Some(2)).unwrap(), b"ab");
        assert_eq!(fetch("in side/../in side/./a.bin", &home, None).unwrap(), b"abc");
        for uri in [
            "../secret",
            "in side/../../secret",
            "%2e%2e/secret",
            "/etc/hostname",
            "file:///etc/hostname",
            "http://example.org/a.bin",
            "C:/a.bin",
            "..\\secret",
            "a%00.bin",
            "a%zz.bin",
            "data:application/octet-stream,abc",
            "data:;base64,!!!!",
        ] {
            assert!(matches!(fetch(uri, &home, None), Err(Fault::Uri { .. })), "{uri}");
        }
        assert!(matches!(fetch("none.bin", &home, None), Err(Fault::File { .. })));
        assert!(matches!(fetch("in%20side", &home, None), Err(Fault::File { .. })));
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(folder.path().join("secret"), home.join("link")).unwrap();
            assert!(matches!(fetch("link", &home, None), Err(Fault::Uri { .. })));
        }
    }
}
