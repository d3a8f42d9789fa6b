//! Environment maps from files: Radiance HDR and OpenEXR.
use super::{Environment, EnvironmentError};
use crate::files::open_regular;
use crate::scene::SceneError;
use glam::Vec3;
use image::codecs::{hdr::HdrDecoder, openexr::OpenExrDecoder};
use image::{DynamicImage, ImageDecoder};
use std::io::{Cursor, Read};
use std::path::Path;

/// Largest file, bytes.
const MAX_FILE: u64 = 1 << 32;
/// Largest width and height, texels.
const MAX_EDGE: u64 = 16384;
/// Largest number of texels: 2 GiB on the device.
const MAX_TEXELS: u64 = 1 << 27;
/// First bytes of files: `#?RADIANCE` or `#?RGBE` for Radiance, and the magic number of OpenEXR.
const RADIANCE: &[u8] = b"#?";
const OPEN_EXR: &[u8] = &[0x76, 0x2f, 0x31, 0x01];

impl Environment {
    /// Reads an environment map from a Radiance HDR or OpenEXR file, as its first bytes decide. Scale 1, no turn. An alpha
    /// channel is ignored.
    ///
    /// # Errors
    /// [`SceneError::Environment`], for the first pixel that is negative or not finite, or for another fault of the file;
    /// [`SceneError::Read`], [`SceneError::TooLarge`].
    pub fn load(path: &Path) -> Result<Self, SceneError> {
        let bytes = read(path)?;
        let name = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
        let refuse = |fault| SceneError::Environment { path: path.to_owned(), fault };
        let made = decode(name, &bytes).map_err(refuse)?;
        made.validate().map_err(refuse)?;
        Ok(made)
    }
}

fn read(path: &Path) -> Result<Vec<u8>, SceneError> {
    let failed = |source| SceneError::Read { path: path.to_owned(), source };
    let (file, size) = open_regular(path).map_err(failed)?;
    if size > MAX_FILE {
        return Err(SceneError::TooLarge { path: path.to_owned(), got: size, limit: MAX_FILE });
    }
    let mut bytes = Vec::with_capacity(size as usize);
    file.take(MAX_FILE).read_to_end(&mut bytes).map_err(failed)?;
    Ok(bytes)
}

/// Decodes a file, whose format the first bytes tell.
pub(super) fn decode(name: String, bytes: &[u8]) -> Result<Environment, EnvironmentError> {
    let failed = |e: image::ImageError| EnvironmentError::Image(e.to_string());
    if bytes.starts_with(RADIANCE) {
        // Not strict: many writers deviate in parts of the header that are not needed here.
        texels(name, HdrDecoder::new_nonstrict(Cursor::new(bytes)).map_err(failed)?)
    } else if bytes.starts_with(OPEN_EXR) {
        texels(name, OpenExrDecoder::new(Cursor::new(bytes)).map_err(failed)?)
    } else {
        Err(EnvironmentError::Kind)
    }
}

fn texels(name: String, decoder: impl ImageDecoder) -> Result<Environment, EnvironmentError> {
    let (width, height) = decoder.dimensions();
    if width == 0 || height == 0 {
        return Err(EnvironmentError::Texels { width, height, got: 0 });
    }
    for (what, got, limit) in [
        ("texels along an edge", u64::from(width.max(height)), MAX_EDGE),
        ("texels", u64::from(width) * u64::from(height), MAX_TEXELS),
    ] {
        if got > limit {
            return Err(EnvironmentError::Limit { what, got, limit });
        }
    }
    let image = DynamicImage::from_decoder(decoder).map_err(|e| EnvironmentError::Image(e.to_string()))?;
    let radiance = image.into_rgb32f().pixels().map(|p| Vec3::from(p.0)).collect();
    Ok(Environment { name, width, height, radiance, scale: 1.0, turn: 0.0 })
}
