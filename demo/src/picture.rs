//! Pictures as files: PNG for what a display shows, EXR for radiance.

use std::io::{Seek, Write};

use image::{
    ExtendedColorType, ImageEncoder, ImageError,
    codecs::{openexr::OpenExrEncoder, png::PngEncoder},
};

/// Colour of a pixel that is not finite, where one would otherwise be hidden.
const NOT_FINITE: [u8; 3] = [255, 0, 255];

/// Why a picture could not be written.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// The table of pixels does not fit the size.
    #[error("wanted {wanted} pixels for {width}x{height}, got {got}")]
    Size {
        /// Pixels.
        width: u32,
        /// Pixels.
        height: u32,
        /// Width times height.
        wanted: usize,
        /// Length of the table.
        got: usize,
    },
    /// The encoder or the file failed.
    #[error(transparent)]
    Encode(#[from] ImageError),
}

fn check_size(width: u32, height: u32, got: usize) -> Result<(), PictureError> {
    let wanted = width as usize * height as usize;
    if wanted == got { Ok(()) } else { Err(PictureError::Size { width, height, wanted, got }) }
}

/// Writes red, green and blue of RGBA bytes as an 8-bit PNG: pictures are opaque.
///
/// # Errors
/// [`PictureError`].
pub fn write_png(out: &mut impl Write, width: u32, height: u32, rgba: &[u8]) -> Result<(), PictureError> {
    let (pixels, _) = rgba.as_chunks::<4>();
    check_size(width, height, pixels.len())?;
    let rgb: Vec<u8> = pixels.iter().flat_map(|p| [p[0], p[1], p[2]]).collect();
    Ok(PngEncoder::new(out).write_image(&rgb, width, height, ExtendedColorType::Rgb8)?)
}

/// Writes red, green and blue as they are as a 32-bit float EXR, NaN and infinities included.
///
/// # Errors
/// [`PictureError`].
pub fn write_exr(
    out: &mut (impl Write + Seek),
    width: u32,
    height: u32,
    rgba: &[[f32; 4]],
) -> Result<(), PictureError> {
    check_size(width, height, rgba.len())?;
    let bytes: Vec<u8> = rgba.iter().flat_map(|p| &p[..3]).flat_map(|x| x.to_ne_bytes()).collect();
    Ok(OpenExrEncoder::new(out).write_image(&bytes, width, height, ExtendedColorType::Rgb32F)?)
}

/// Makes any output of a pass visible, as RGBA bytes. With negative values, zero becomes mid grey and the scale is linear and
/// symmetric, as fits directions; else values are encoded as sRGB, and scaled to a 99.5th percentile of 1 if that
/// lies above 1 or below 0.1. A single channel is shown in grey, a pixel that is not finite in magenta.
#[must_use]
pub fn shown(pixels: &[[f32; 4]]) -> Vec<u8> {
    let finite = |p: &&[f32; 4]| p[..3].iter().all(|x| x.is_finite());
    let mut sizes: Vec<f32> =
        pixels.iter().filter(finite).map(|p| p[..3].iter().fold(0.0_f32, |most, x| most.max(x.abs()))).collect();
    sizes.sort_unstable_by(f32::total_cmp);
    let high = sizes.get((sizes.len() * 199 / 200).min(sizes.len().saturating_sub(1))).copied().unwrap_or(1.0);
    let signed = pixels.iter().filter(finite).any(|p| p[..3].iter().any(|x| *x < 0.0));
    let grey = pixels.iter().filter(finite).all(|p| p[1] == 0.0 && p[2] == 0.0);
    let scale = if high > 1.0 || (high > 0.0 && high < 0.1 && !signed) { 1.0 / high } else { 1.0 };
    let byte = |x: f32| {
        let x = x * scale;
        let encoded = if signed { 0.5 + 0.5 * x } else { srgb(x) };
        (encoded * 255.0).round().clamp(0.0, 255.0) as u8
    };
    let show = |p: &[f32; 4]| {
        if !finite(&p) {
            return [NOT_FINITE[0], NOT_FINITE[1], NOT_FINITE[2], 255];
        }
        let [r, g, b] = if grey { [p[0]; 3] } else { [p[0], p[1], p[2]] };
        [byte(r), byte(g), byte(b), 255]
    };
    pixels.iter().flat_map(show).collect()
}

/// Transfer function of sRGB (IEC 61966-2-1).
fn srgb(x: f32) -> f32 {
    if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    #[test]
    fn exr_keeps_every_bit_and_is_the_same_twice() {
        let pixels: Vec<[f32; 4]> = (0..64 * 48)
            .map(|i| [i as f32 * 1.1e3, -(i as f32), if i == 7 { f32::NAN } else { f32::MIN_POSITIVE }, 1.0])
            .collect();
        let write = || {
            let mut file = Cursor::new(Vec::new());
            write_exr(&mut file, 64, 48, &pixels).unwrap();
            file.into_inner()
        };
        let bytes = write();
        assert_eq!(bytes, write());
        let back = image::load_from_memory_with_format(&bytes, image::ImageFormat::OpenExr).unwrap();
        assert_eq!(back.color(), image::ColorType::Rgb32F);
        for (got, wanted) in back.into_rgb32f().pixels().zip(&pixels) {
            for channel in 0..3 {
                assert_eq!(got[channel].to_bits(), wanted[channel].to_bits());
            }
        }
    }

    #[test]
    fn png_reads_back() {
        let rgba: Vec<u8> = (0..5 * 3 * 4).map(|i| i as u8 * 4).collect();
        let mut bytes = Vec::new();
        write_png(&mut bytes, 5, 3, &rgba).unwrap();
        let back = image::load_from_memory_with_format(&bytes, image::ImageFormat::Png).unwrap().into_rgb8();
        assert_eq!(back.dimensions(), (5, 3));
        for (got, wanted) in back.pixels().zip(rgba.chunks(4)) {
            assert_eq!(got.0, wanted[..3]);
        }
    }

    #[test]
    fn a_table_of_the_wrong_length_is_refused() {
        assert!(matches!(
            write_png(&mut Vec::new(), 2, 2, &[0; 12]),
            Err(PictureError::Size { wanted: 4, got: 3, .. })
        ));
        assert!(write_exr(&mut Cursor::new(Vec::new()), 2, 2, &[[0.0; 4]; 5]).is_err());
    }

    #[test]
    fn outputs_are_made_visible() {
        let first = |pixels: &[[f32; 4]]| shown(pixels)[..3].to_vec();
        assert_eq!(first(&[[1.0, 0.5, 0.0, 1.0]]), [255, 188, 0]);
        assert_eq!(first(&[[-1.0, 0.0, 1.0, 0.0]]), [0, 128, 255]);
        assert_eq!(first(&[[100.0, 50.0, 1.0, 0.0]]), [255, 188, 25]);
        assert_eq!(first(&[[0.01, 0.005, 0.002, 0.0]])[0], 255);
        assert_eq!(first(&[[0.5, 0.0, 0.0, 1.0]]), [188, 188, 188]);
        assert_eq!(first(&[[f32::NAN, 0.0, 0.0, 1.0], [0.5, 0.2, 0.1, 1.0]]), NOT_FINITE);
        assert_eq!(first(&[[0.0; 4]]), [0, 0, 0]);
        assert!(shown(&[]).is_empty());
    }
}
