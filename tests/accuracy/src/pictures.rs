//! Picture files of a report: a slot's output, its ground truth, and the FLIP map.
use crate::AccuracyError;
use crate::display::Display;
use crate::metrics::{Picture, flip_ldr_map, magma};
use image::{DynamicImage, Rgb32FImage, RgbImage, imageops};
use std::path::Path;

/// Greatest width of a picture in a report, pixels.
const MAX_WIDTH: u32 = 480;

/// Writes the display values of a picture as PNG.
///
/// # Errors
/// [`AccuracyError::Image`].
pub fn write_shown(path: &Path, picture: &Picture, display: &Display) -> Result<(), AccuracyError> {
    write_rgb(path, picture, display.show(picture).to_srgb8())
}

/// Writes the FLIP map of the display values of two pictures.
///
/// # Errors
/// [`AccuracyError`].
pub fn write_flip(path: &Path, test: &Picture, truth: &Picture, display: &Display) -> Result<(), AccuracyError> {
    let map = flip_ldr_map(&display.show(test), &display.show(truth));
    let map = map.map_err(AccuracyError::metric(&path.display().to_string()))?;
    write_rgb(path, test, magma(&map))
}

fn write_rgb(path: &Path, size: &Picture, bytes: Vec<u8>) -> Result<(), AccuracyError> {
    let (width, height) = (size.width as u32, size.height as u32);
    let shown = RgbImage::from_raw(width, height, bytes).unwrap_or_else(|| RgbImage::new(width, height));
    let fits = width <= MAX_WIDTH;
    let shown = if fits {
        shown
    } else {
        imageops::resize(&shown, MAX_WIDTH, (height * MAX_WIDTH / width).max(1), imageops::FilterType::Triangle)
    };
    shown.save(path).map_err(AccuracyError::image(path))
}

/// Writes the linear values as EXR.
///
/// # Errors
/// [`AccuracyError::Image`].
pub fn write_exr(path: &Path, picture: &Picture) -> Result<(), AccuracyError> {
    let (width, height) = (picture.width as u32, picture.height as u32);
    let values: Vec<f32> = picture.pixels.iter().flatten().copied().collect();
    let image = Rgb32FImage::from_raw(width, height, values).unwrap_or_else(|| Rgb32FImage::new(width, height));
    DynamicImage::from(image).save(path).map_err(AccuracyError::image(path))
}

/// Reads the linear values of an EXR.
///
/// # Errors
/// [`AccuracyError::Image`].
pub fn read_exr(path: &Path) -> Result<Picture, AccuracyError> {
    let image = image::open(path).map_err(AccuracyError::image(path))?.into_rgb32f();
    let (width, height) = (image.width() as usize, image.height() as usize);
    let pixels = image.pixels().map(|p| p.0).collect();
    Ok(Picture { width, height, pixels })
}

/// A file in base 64 (RFC 4648), to embed in a page. `None` if there is no such file.
pub fn base64(path: &Path) -> Option<String> {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let bytes = std::fs::read(path).ok()?;
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let word = three.iter().fold(0_u32, |word, byte| word << 8 | u32::from(*byte)) << (8 * (3 - three.len()));
        for at in 0..4 {
            let digit = DIGITS[(word >> (18 - 6 * at)) as usize & 63] as char;
            text.push(if at <= three.len() { digit } else { '=' });
        }
    }
    Some(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base_64_is_that_of_the_standard() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("f");
        // Test vectors of RFC 4648, section 10.
        for (text, wanted) in
            [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foob", "Zm9vYg=="), ("foobar", "Zm9vYmFy")]
        {
            std::fs::write(&path, text).unwrap();
            assert_eq!(base64(&path).as_deref(), Some(wanted));
        }
        assert_eq!(base64(&folder.path().join("gone")), None);
    }

    #[test]
    fn numbers_come_back_from_an_exr_as_they_were() {
        let folder = tempfile::tempdir().unwrap();
        let pixels = (0..6).map(|i| [i as f32, 1e-6 * i as f32, 1e6]).collect();
        let picture = Picture { width: 3, height: 2, pixels };
        let path = folder.path().join("p.exr");
        write_exr(&path, &picture).unwrap();
        assert_eq!(read_exr(&path).unwrap(), picture);
    }
}
