//! All spatial metrics of a pair of pictures.
use super::picture::check_pair;
use super::{Exposures, MetricError, Picture, exposures, flip_hdr, flip_ldr, mse, psnr_of_mse, relmse, smape, ssim};
use crate::display::Display;
use serde::{Deserialize, Serialize};

/// Error of a picture against its reference, by every spatial metric.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    /// Width, pixels.
    pub width: usize,
    /// Height, pixels.
    pub height: usize,
    /// Root mean squared error, in the unit of the pictures.
    pub rmse: f64,
    /// Relative mean squared error; [`super::relmse`].
    pub relmse: f64,
    /// SMAPE, 0 to 1; [`super::smape`].
    pub smape: f64,
    /// Peak signal-to-noise ratio of display values (clamped to 0..1, sRGB-encoded, peak 1), decibels; none if they are equal.
    pub psnr: Option<f64>,
    /// Structural similarity of display values, at most 1, which is equal.
    pub ssim: f64,
    /// FLIP of display values, 0 to 1.
    pub flip_ldr: f64,
    /// HDR-FLIP over the exposures of the reference, 0 to 1.
    pub flip_hdr: f64,
    /// The exposures of `flip_hdr`.
    pub exposures: Exposures,
    /// Mean luminance of the picture under test.
    pub mean_test: f64,
    /// Mean luminance of the reference.
    pub mean_reference: f64,
}

impl Comparison {
    /// Computes every metric. The pictures are display-referred already.
    ///
    /// # Errors
    /// [`MetricError`] if the pictures differ in size or are not finite.
    pub fn of(test: &Picture, reference: &Picture) -> Result<Self, MetricError> {
        Self::displayed(test, reference, &Display::PLAIN)
    }

    /// The same for radiance: PSNR, SSIM and FLIP are computed after conversion by `display`.
    ///
    /// # Errors
    /// As [`Comparison::of`].
    pub fn displayed(test: &Picture, reference: &Picture, display: &Display) -> Result<Self, MetricError> {
        check_pair(test, reference)?;
        let (seen, wanted) = (display.show(test), display.show(reference));
        let shown = mse(&seen.encoded(), &wanted.encoded())?;
        Ok(Self {
            width: test.width,
            height: test.height,
            rmse: mse(test, reference)?.sqrt(),
            relmse: relmse(test, reference)?,
            smape: smape(test, reference)?,
            psnr: if shown > 0.0 { Some(psnr_of_mse(shown, 1.0)?) } else { None },
            ssim: ssim(&seen, &wanted)?,
            flip_ldr: flip_ldr(&seen, &wanted)?,
            flip_hdr: flip_hdr(test, reference)?,
            exposures: exposures(reference)?,
            mean_test: test.mean_luminance(),
            mean_reference: reference.mean_luminance(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn json_holds_every_metric_and_comes_back() {
        let reference = Picture::grey(4, 4, &[0.5; 16]);
        let mut test = reference.clone();
        test.pixels[3] = [1.0, 0.5, 0.25];
        let comparison = Comparison::of(&test, &reference).unwrap();
        let text = serde_json::to_string(&comparison).unwrap();
        // Reading a number back may change its last digit.
        let back: Comparison = serde_json::from_str(&text).unwrap();
        assert!(
            (back.relmse / comparison.relmse - 1.0).abs() < 1e-14 && back.exposures == comparison.exposures,
            "{text}"
        );
        for field in ["rmse", "relmse", "smape", "psnr", "ssim", "flip_ldr", "flip_hdr", "mean_test", "mean_reference"]
        {
            assert!(text.contains(&format!("\"{field}\":")), "{field}: {text}");
        }
        assert!(comparison.rmse > 0.0 && comparison.psnr.unwrap() > 20.0 && comparison.ssim < 1.0, "{text}");
        assert!((comparison.mean_reference - 0.5).abs() < 1e-9 && comparison.mean_test > 0.5, "{text}");
    }

    #[test]
    fn the_same_picture_twice() {
        let picture = Picture::grey(4, 4, &[0.5; 16]);
        let comparison = Comparison::of(&picture, &picture).unwrap();
        let Comparison { rmse, relmse, smape, psnr, flip_ldr, flip_hdr, .. } = comparison;
        assert_eq!((rmse, relmse, smape, psnr, flip_ldr, flip_hdr), (0.0, 0.0, 0.0, None, 0.0, 0.0));
        // None is written as null, as JSON has no infinity.
        assert!(serde_json::to_string(&comparison).unwrap().contains("\"psnr\":null"));
    }

    #[test]
    fn a_nan_is_no_number() {
        let picture = Picture::grey(2, 2, &[0.5; 4]);
        let mut broken = picture.clone();
        broken.pixels[2][0] = f32::INFINITY;
        assert!(matches!(Comparison::of(&broken, &picture), Err(MetricError::NotFinite { x: 0, y: 1, .. })));
    }
}
