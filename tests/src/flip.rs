//! Perceived difference of two images: FLIP as in the metrics of `magpie-accuracy`.
use anyhow::Result;
use magpie::graph::Format;
use magpie::pixels::Pixels;
use magpie_accuracy::metrics::{Picture, flip_ldr};

/// Mean FLIP of the display values of two images, from 0 (equal) to 1, at 67 pixels per degree.
pub fn mean_flip(a: &Pixels, b: &Pixels) -> Result<f64> {
    let picture = |pixels: &Pixels| {
        Picture::from_pixels(&Pixels { format: Format::Rgba8Unorm, bytes: pixels.presentable(), ..*pixels })
    };
    Ok(flip_ldr(&picture(a)?, &picture(b)?)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use magpie::graph::Extent;

    fn flat(rgb: [u8; 3]) -> Pixels {
        let extent = Extent::new(16, 8);
        let bytes = (0..16 * 8).flat_map(|_| [rgb[0], rgb[1], rgb[2], 255]).collect();
        Pixels { extent, format: Format::Rgba8Unorm, bytes }
    }

    #[test]
    fn the_same_is_zero_and_black_and_white_are_far_apart() -> Result<()> {
        assert!(mean_flip(&flat([9, 100, 200]), &flat([9, 100, 200]))? == 0.0);
        let far = mean_flip(&flat([0; 3]), &flat([255; 3]))?;
        assert!((0.9..=1.0).contains(&far), "{far}");
        let near = mean_flip(&flat([100; 3]), &flat([104; 3]))?;
        assert!(near > 0.0 && near < 0.1, "{near}");
        assert!(mean_flip(&flat([0; 3]), &Pixels { extent: Extent::new(8, 16), ..flat([0; 3]) }).is_err());
        Ok(())
    }
}
