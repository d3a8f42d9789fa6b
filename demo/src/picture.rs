//! Pictures as files: PNG for display values, EXR for radiance.

use std::{
    fs::File,
    io::{BufReader, Seek, Write},
    path::Path,
};

use exr::prelude::{Image, SpecificChannels, Vec2, WritableImage};
use image::{ExtendedColorType, ImageEncoder, ImageError, ImageFormat, ImageReader, codecs::png::PngEncoder};
use magpie::{
    graph::Extent,
    pixels::{Mapping, Pixels, srgb_decode},
};
use magpie_accuracy::metrics::{DynamicRange, MetricError, Picture};

/// Colour of non-finite pixels in a PNG.
const NOT_FINITE: [u8; 3] = [255, 0, 255];

/// Why a picture could not be written or read.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// The number of pixels is not width times height.
    #[error("wanted {wanted} pixels for {width}x{height}, got {got}")]
    Size {
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
        /// Width times height.
        wanted: usize,
        /// Pixels that were given.
        got: usize,
    },
    /// Encoding, decoding or file access failed.
    #[error(transparent)]
    Encode(#[from] ImageError),
    /// Encoding an EXR, or writing it, failed.
    #[error(transparent)]
    Exr(#[from] exr::error::Error),
    /// The file cannot be opened.
    #[error("cannot be read: {0}")]
    Open(#[from] std::io::Error),
    /// The path is not a regular file.
    #[error("wanted a file, this is none")]
    NoFile,
    /// The contents are neither PNG nor EXR.
    #[error("wanted a PNG or an EXR, got {0}")]
    Kind(String),
    /// The pixels are refused by the metrics.
    #[error(transparent)]
    Picture(#[from] MetricError),
}

fn check_size(width: u32, height: u32, got: usize) -> Result<(), PictureError> {
    let wanted = width as usize * height as usize;
    if wanted == got { Ok(()) } else { Err(PictureError::Size { width, height, wanted, got }) }
}

/// Writes an opaque 8-bit PNG: a display image as it is, any other made visible. Non-finite pixels are magenta.
///
/// # Errors
/// [`PictureError`].
pub fn write_png(out: &mut impl Write, pixels: &Pixels) -> Result<(), PictureError> {
    write_shown(out, pixels, &pixels.presentable())
}

/// [`write_png`] of an image that is shown in another way. Logs which numbers its colours stand for.
///
/// # Errors
/// [`PictureError`].
pub fn write_mapped(out: &mut impl Write, pixels: &Pixels, mapping: &Mapping) -> Result<(), PictureError> {
    let (shown, [low, high]) = mapping.apply(pixels);
    log::info!("colours stand for {low} to {high}");
    write_shown(out, pixels, &shown)
}

/// Writes a PNG of 8-bit RGBA colours; magenta where the image is not finite.
fn write_shown(out: &mut impl Write, pixels: &Pixels, shown: &[u8]) -> Result<(), PictureError> {
    let (shown, _) = shown.as_chunks::<4>();
    let Extent { width, height, .. } = pixels.extent;
    check_size(width, height, shown.len())?;
    let values = pixels.values();
    let rgb: Vec<u8> = shown
        .iter()
        .zip(&values)
        .flat_map(|(p, v)| if v.iter().all(|x| x.is_finite()) { [p[0], p[1], p[2]] } else { NOT_FINITE })
        .collect();
    Ok(PngEncoder::new(out).write_image(&rgb, width, height, ExtendedColorType::Rgb8)?)
}

/// Writes the values unchanged as a 32-bit float EXR, NaN and infinities included: four channels where the image has four, else red, green
/// and blue.
///
/// # Errors
/// [`PictureError`].
pub fn write_exr(out: &mut (impl Write + Seek), pixels: &Pixels) -> Result<(), PictureError> {
    let values = pixels.values();
    let Extent { width, height, .. } = pixels.extent;
    check_size(width, height, values.len())?;
    let size = (width as usize, height as usize);
    let at = |place: Vec2<usize>| values[place.y() * size.0 + place.x()];
    // Threads would write blocks in the order in which they are done, and no two files of one picture would be alike.
    match pixels.format.channels() {
        4 => {
            let channels = SpecificChannels::rgba(|place| {
                let [r, g, b, a] = at(place);
                (r, g, b, a)
            });
            Image::from_channels(size, channels).write().non_parallel().to_buffered(out)?;
        }
        _ => {
            let channels = SpecificChannels::rgb(|place| {
                let [r, g, b, _] = at(place);
                (r, g, b)
            });
            Image::from_channels(size, channels).write().non_parallel().to_buffered(out)?;
        }
    }
    Ok(())
}

/// Reads a picture to compare; its format is taken from the contents, not the name. PNG: 8 or 16 bits, sRGB-decoded. EXR: 32-bit floats
/// unchanged. Grey becomes three equal channels; alpha is dropped.
///
/// # Errors
/// [`PictureError`], also where a pixel is not finite.
pub fn read_picture(path: &Path) -> Result<(Picture, DynamicRange), PictureError> {
    if !std::fs::metadata(path)?.is_file() {
        return Err(PictureError::NoFile);
    }
    // `ImageReader::open` would fall back on the file name where the contents are not recognised.
    let reader = ImageReader::new(BufReader::new(File::open(path)?)).with_guessed_format()?;
    let range = match reader.format() {
        Some(ImageFormat::Png) => DynamicRange::Display,
        Some(ImageFormat::OpenExr) => DynamicRange::High,
        Some(other) => return Err(PictureError::Kind(format!("{other:?}"))),
        None => return Err(PictureError::Kind("something else".to_owned())),
    };
    let image = reader.decode()?.into_rgb32f();
    let (width, height) = (image.width() as usize, image.height() as usize);
    let linear = |x: f32| if range == DynamicRange::Display { srgb_decode(x) } else { x };
    let pixels = image.pixels().map(|p| p.0.map(linear)).collect();
    let picture = Picture { width, height, pixels };
    picture.check("the picture")?;
    Ok((picture, range))
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use magpie::graph::Format;

    use super::*;

    fn floats(width: u32, height: u32, values: &[[f32; 4]]) -> Pixels {
        let bytes = values.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        Pixels { extent: Extent::new(width, height), format: Format::Rgba32Float, bytes }
    }

    fn png(pixels: &Pixels) -> image::RgbImage {
        let mut bytes = Vec::new();
        write_png(&mut bytes, pixels).unwrap();
        image::load_from_memory_with_format(&bytes, ImageFormat::Png).unwrap().into_rgb8()
    }

    #[test]
    fn exr_keeps_every_bit_and_is_the_same_twice() {
        // Large enough for several blocks.
        let values: Vec<[f32; 4]> = (0..320 * 240)
            .map(|i| [i as f32 * 1.1e3, -(i as f32), if i == 7 { f32::NAN } else { f32::MIN_POSITIVE }, 1.0])
            .collect();
        let write = || {
            let mut file = Cursor::new(Vec::new());
            write_exr(&mut file, &floats(320, 240, &values)).unwrap();
            file.into_inner()
        };
        let bytes = write();
        for _ in 0..16 {
            assert!(bytes == write());
        }
        let back = image::load_from_memory_with_format(&bytes, ImageFormat::OpenExr).unwrap();
        assert_eq!(back.color(), image::ColorType::Rgba32F);
        for (got, wanted) in back.into_rgba32f().pixels().zip(&values) {
            for channel in 0..4 {
                assert_eq!(got[channel].to_bits(), wanted[channel].to_bits());
            }
        }
    }

    #[test]
    fn a_display_image_becomes_a_png_as_it_is() {
        let bytes: Vec<u8> = (0..5 * 3 * 4).map(|i| i * 4).collect();
        let pixels = Pixels { extent: Extent::new(5, 3), format: Format::Rgba8Unorm, bytes: bytes.clone() };
        let back = png(&pixels);
        assert_eq!(back.dimensions(), (5, 3));
        for (got, wanted) in back.pixels().zip(bytes.chunks(4)) {
            assert_eq!(got.0, wanted[..3]);
        }
    }

    #[test]
    fn what_is_not_finite_is_seen() {
        let back = png(&floats(2, 2, &[[f32::NAN, 0.0, 0.0, 1.0], [0.0; 4], [1.0; 4], [0.0, f32::INFINITY, 0.0, 1.0]]));
        let pixels: Vec<_> = back.pixels().map(|p| p.0).collect();
        assert_eq!([pixels[0], pixels[1], pixels[3]], [NOT_FINITE, [0; 3], NOT_FINITE]);
        assert_ne!(pixels[2], NOT_FINITE);
    }

    #[test]
    fn what_was_written_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let values = [[0.5, -3.0, 1e9, 1.0], [0.25, 0.0, 1.5, 0.0]];
        // The name does not match the contents.
        let path = folder.path().join("a.png");
        write_exr(&mut File::create(&path).unwrap(), &floats(2, 1, &values)).unwrap();
        let (picture, range) = read_picture(&path).unwrap();
        assert_eq!((picture.width, picture.height, range), (2, 1, DynamicRange::High));
        assert_eq!(picture.pixels, [[0.5, -3.0, 1e9], [0.25, 0.0, 1.5]]);

        let bytes: Vec<u8> = (0..=255).flat_map(|i| [i, 255 - i, i / 3, 255]).collect();
        let pixels = Pixels { extent: Extent::new(16, 16), format: Format::Rgba8Unorm, bytes };
        write_png(&mut File::create(&path).unwrap(), &pixels).unwrap();
        let (picture, range) = read_picture(&path).unwrap();
        assert_eq!((&picture, range), (&Picture::from_pixels(&pixels).unwrap(), DynamicRange::Display));

        // 16-bit grey: 0x8000 is half of the display range.
        image::ImageBuffer::<image::Luma<u16>, _>::from_raw(1, 1, vec![0x8000_u16]).unwrap().save(&path).unwrap();
        let [r, g, b] = read_picture(&path).unwrap().0.pixels[0];
        assert!(r == g && g == b && (r - srgb_decode(0x8000 as f32 / 65535.0)).abs() < 1e-6, "{r} {g} {b}");
    }

    #[test]
    fn what_is_no_picture_is_not_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        assert!(matches!(read_picture(&path), Err(PictureError::Open(_))));
        assert!(matches!(read_picture(folder.path()), Err(PictureError::NoFile)));
        std::fs::write(&path, "text").unwrap();
        assert!(matches!(read_picture(&path), Err(PictureError::Kind(_))));
        std::fs::write(&path, b"\xff\xd8\xff\xe0 like a JPEG").unwrap();
        assert!(matches!(read_picture(&path), Err(PictureError::Kind(kind)) if kind == "Jpeg"));
        let nan = floats(2, 1, &[[0.0; 4], [0.0, f32::NAN, 0.0, 1.0]]);
        write_exr(&mut File::create(&path).unwrap(), &nan).unwrap();
        let error = read_picture(&path).unwrap_err().to_string();
        assert_eq!(error, "the picture has NaN in channel 1 of pixel (1, 0)");
    }

    #[test]
    fn a_table_of_the_wrong_length_is_refused() {
        let short = floats(2, 2, &[[0.0; 4]; 3]);
        assert!(matches!(write_png(&mut Vec::new(), &short), Err(PictureError::Size { wanted: 4, got: 3, .. })));
        assert!(matches!(write_exr(&mut Cursor::new(Vec::new()), &short), Err(PictureError::Size { .. })));
    }
}
