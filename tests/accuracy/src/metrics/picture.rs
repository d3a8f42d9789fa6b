//! Pictures and maps in CPU memory.
use super::MetricError;
use magpie::graph::Format;
use magpie::pixels::{Pixels, srgb_decode, srgb_encode};

/// A picture in CPU memory, linear Rec.709.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Width, pixels.
    pub width: usize,
    /// Height, pixels.
    pub height: usize,
    /// `width * height` pixels, row by row from the top.
    pub pixels: Vec<[f32; 3]>,
}

/// One value per pixel, such as an error or a similarity.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// Width, pixels.
    pub width: usize,
    /// Height, pixels.
    pub height: usize,
    /// `width * height` values, row by row from the top.
    pub values: Vec<f32>,
}

impl Map {
    /// Mean over all pixels.
    pub fn mean(&self) -> f64 {
        self.values.iter().map(|&v| f64::from(v)).sum::<f64>() / self.values.len() as f64
    }
}

impl Picture {
    /// A grey picture from one value per pixel, such as visibility.
    pub fn grey(width: usize, height: usize, values: &[f32]) -> Self {
        Self { width, height, pixels: values.iter().map(|&v| [v; 3]).collect() }
    }

    /// A picture from display values: 8 bits, sRGB-encoded, three bytes per pixel.
    pub fn from_srgb8(width: usize, height: usize, bytes: &[u8]) -> Self {
        let decode = |byte: u8| srgb_decode(f32::from(byte) / 255.0);
        Self { width, height, pixels: bytes.as_chunks::<3>().0.iter().map(|rgb| rgb.map(decode)).collect() }
    }

    /// From a read-back image. `Rgba8Unorm` is decoded from sRGB, as the engine uses this format for display images only; a single channel
    /// (visibility, occlusion, depth) becomes grey; with two channels the third is 0.
    ///
    /// # Errors
    /// [`MetricError::Ids`] for integer formats.
    pub fn from_pixels(image: &Pixels) -> Result<Self, MetricError> {
        let mut picture = Self::from_numbers(image)?;
        if image.format == Format::Rgba8Unorm {
            picture.pixels.iter_mut().for_each(|v| *v = v.map(srgb_decode));
        }
        Ok(picture)
    }

    /// From a read-back image without sRGB decoding.
    ///
    /// # Errors
    /// [`MetricError::Ids`] for integer formats.
    pub fn from_numbers(image: &Pixels) -> Result<Self, MetricError> {
        let format = image.format;
        if matches!(format, Format::R32Uint | Format::Rg32Uint) {
            return Err(MetricError::Ids(format));
        }
        let pixel = |v: [f32; 4]| if format.channels() == 1 { [v[0]; 3] } else { [v[0], v[1], v[2]] };
        let pixels = image.values().into_iter().map(pixel).collect();
        Ok(Self { width: image.extent.width as usize, height: image.extent.height as usize, pixels })
    }

    /// Display values without a tone map: clamped to 0..1, sRGB-encoded.
    pub fn encoded(&self) -> Self {
        let encode = |x: f32| srgb_encode(x.clamp(0.0, 1.0));
        Self { pixels: self.pixels.iter().map(|p| p.map(encode)).collect(), ..*self }
    }

    /// [`Picture::encoded`] as bytes, three per pixel.
    pub fn to_srgb8(&self) -> Vec<u8> {
        self.encoded().pixels.iter().flatten().map(|&x| (x * 255.0 + 0.5) as u8).collect()
    }

    /// Mean luminance, Rec.709.
    pub fn mean_luminance(&self) -> f64 {
        self.pixels.iter().map(luminance).sum::<f64>() / self.pixels.len() as f64
    }

    /// Checks that the picture has pixels, as many as its size says, and that all are finite.
    ///
    /// # Errors
    /// [`MetricError::Empty`], [`MetricError::Length`], [`MetricError::NotFinite`].
    pub fn check(&self, what: &'static str) -> Result<(), MetricError> {
        let Self { width, height, ref pixels } = *self;
        if width == 0 || height == 0 {
            return Err(MetricError::Empty { what, width, height });
        }
        if pixels.len() != width * height {
            return Err(MetricError::Length { what, width, height, got: pixels.len() });
        }
        for (at, pixel) in pixels.iter().enumerate() {
            if let Some(channel) = pixel.iter().position(|x| !x.is_finite()) {
                let value = pixel[channel];
                return Err(MetricError::NotFinite { what, x: at % width, y: at / width, channel, value });
            }
        }
        Ok(())
    }

    /// Checks that the size is that of the reference.
    pub(super) fn check_size(&self, what: &'static str, reference: &Self) -> Result<(), MetricError> {
        let Self { width, height, .. } = *reference;
        if (self.width, self.height) == (width, height) {
            return Ok(());
        }
        Err(MetricError::Size { what, width, height, got_width: self.width, got_height: self.height })
    }
}

/// Rec.709 luminance of linear values; luma of encoded ones.
pub(super) fn luminance(p: &[f32; 3]) -> f64 {
    0.2126 * f64::from(p[0]) + 0.7152 * f64::from(p[1]) + 0.0722 * f64::from(p[2])
}

/// The checks common to all comparisons.
pub(super) fn check_pair(test: &Picture, reference: &Picture) -> Result<(), MetricError> {
    test.check("the picture under test")?;
    reference.check("the reference")?;
    test.check_size("the picture under test", reference)
}

#[cfg(test)]
mod tests {
    use super::*;
    use magpie::graph::Extent;

    fn read(format: Format, bytes: &[u8]) -> Result<Picture, MetricError> {
        Picture::from_pixels(&Pixels { extent: Extent::new(1, 1), format, bytes: bytes.to_vec() })
    }

    #[test]
    fn every_kind_of_image_becomes_a_picture() {
        assert_eq!(read(Format::R8Unorm, &[51]).unwrap().pixels, [[0.2; 3]]);
        assert_eq!(read(Format::R32Float, &7.5_f32.to_le_bytes()).unwrap().pixels, [[7.5; 3]]);
        assert_eq!(read(Format::Rg16Float, &[0, 0x3c, 0, 0xc0]).unwrap().pixels, [[1.0, -2.0, 0.0]]);
        let floats: Vec<u8> = [1e9_f32, -3.0, 0.25, 0.0].iter().flat_map(|x| x.to_le_bytes()).collect();
        assert_eq!(read(Format::Rgba32Float, &floats).unwrap().pixels, [[1e9, -3.0, 0.25]]);
        // The display value 188 is half of the linear range.
        for format in [Format::Rgba8Unorm, Format::Rgba8Srgb] {
            let [r, g, b] = read(format, &[188, 0, 255, 9]).unwrap().pixels[0];
            assert!((r - 0.5).abs() < 4e-3 && g == 0.0 && (b - 1.0).abs() < 1e-6, "{format:?}: {r} {g} {b}");
        }
        for format in [Format::R32Uint, Format::Rg32Uint] {
            assert_eq!(read(format, &[0; 8]).unwrap_err(), MetricError::Ids(format));
        }
    }

    #[test]
    fn display_bytes_survive() {
        let bytes: Vec<u8> = (0..=255).flat_map(|i| [i, 255 - i, i / 2]).collect();
        assert_eq!(Picture::from_srgb8(16, 16, &bytes).to_srgb8(), bytes);
    }

    #[test]
    fn a_fault_is_named_with_its_place() {
        let mut picture = Picture::grey(3, 2, &[0.5; 6]);
        assert_eq!(picture.check("it"), Ok(()));
        assert!((picture.mean_luminance() - 0.5).abs() < 1e-12);
        picture.pixels[5][1] = f32::NEG_INFINITY;
        assert_eq!(picture.check("it").unwrap_err().to_string(), "it has -inf in channel 1 of pixel (2, 1)");
        picture.pixels[1][2] = f32::NAN;
        assert_eq!(picture.check("it").unwrap_err().to_string(), "it has NaN in channel 2 of pixel (1, 0)");
        picture.pixels.pop();
        assert!(picture.check("it").unwrap_err().to_string().contains("wanted 6 values, got 5"));
        assert!(matches!(Picture::grey(0, 3, &[]).check("it"), Err(MetricError::Empty { .. })));
    }
}
