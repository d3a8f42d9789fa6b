//! How rows are judged: by a metric of an image.
use crate::display::Display;
use crate::metrics::{Comparison, MetricError, Picture, flip_hdr, flip_ldr, relmse, rmse, smape, ssim};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// An error metric; 0 is no error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Metric {
    /// FLIP of display values.
    #[default]
    FlipLdr,
    /// HDR-FLIP, over the exposures of the ground truth.
    FlipHdr,
    /// Relative mean squared error.
    Relmse,
    /// Root mean squared error.
    Rmse,
    /// Symmetric mean absolute percentage error.
    Smape,
    /// 1 less the structural similarity.
    Dssim,
}

impl Metric {
    /// All metrics, the default first.
    pub const ALL: [Self; 6] = [Self::FlipLdr, Self::FlipHdr, Self::Relmse, Self::Rmse, Self::Smape, Self::Dssim];

    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::FlipLdr => "FLIP",
            Self::FlipHdr => "HDR-FLIP",
            Self::Relmse => "relMSE",
            Self::Rmse => "RMSE",
            Self::Smape => "SMAPE",
            Self::Dssim => "1 - SSIM",
        }
    }

    /// Name on the command line.
    pub fn word(self) -> &'static str {
        match self {
            Self::FlipLdr => "flip",
            Self::FlipHdr => "hdr-flip",
            Self::Relmse => "relmse",
            Self::Rmse => "rmse",
            Self::Smape => "smape",
            Self::Dssim => "dssim",
        }
    }

    /// Name in JSON.
    pub fn key(self) -> &'static str {
        match self {
            Self::FlipLdr => "flip_ldr",
            Self::FlipHdr => "flip_hdr",
            Self::Relmse => "relmse",
            Self::Rmse => "rmse",
            Self::Smape => "smape",
            Self::Dssim => "dssim",
        }
    }

    /// This metric's value.
    pub fn of(self, comparison: &Comparison) -> f64 {
        match self {
            Self::FlipLdr => comparison.flip_ldr,
            Self::FlipHdr => comparison.flip_hdr,
            Self::Relmse => comparison.relmse,
            Self::Rmse => comparison.rmse,
            Self::Smape => comparison.smape,
            Self::Dssim => 1.0 - comparison.ssim,
        }
    }

    /// Computes this metric only.
    ///
    /// # Errors
    /// [`MetricError`] if the pictures differ in size or are not finite.
    pub fn measure(self, test: &Picture, truth: &Picture, display: &Display) -> Result<f64, MetricError> {
        match self {
            Self::FlipLdr => flip_ldr(&display.show(test), &display.show(truth)),
            Self::FlipHdr => flip_hdr(test, truth),
            Self::Relmse => relmse(test, truth),
            Self::Rmse => rmse(test, truth),
            Self::Smape => smape(test, truth),
            Self::Dssim => Ok(1.0 - ssim(&display.show(test), &display.show(truth))?),
        }
    }
}

impl fmt::Display for Metric {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Metric {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let known = || Self::ALL.map(Self::word).join(", ");
        Self::ALL.into_iter().find(|m| m.word() == text).ok_or_else(|| format!("wanted one of {}", known()))
    }
}

/// The image that a row is judged by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Image {
    /// The output of the slot itself.
    Slot,
    /// The final picture, with camera and scene at rest.
    #[default]
    Picture,
    /// The final picture while the camera moves.
    Moving,
}

impl Image {
    /// All images.
    pub const ALL: [Self; 3] = [Self::Slot, Self::Picture, Self::Moving];

    /// Name on the command line.
    pub fn word(self) -> &'static str {
        match self {
            Self::Slot => "slot",
            Self::Picture => "picture",
            Self::Moving => "moving",
        }
    }

    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Slot => "its own image",
            Self::Picture => "the picture",
            Self::Moving => "the picture while the camera moves",
        }
    }
}

impl FromStr for Image {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let known = || Self::ALL.map(Self::word).join(", ");
        Self::ALL.into_iter().find(|i| i.word() == text).ok_or_else(|| format!("wanted one of {}", known()))
    }
}

/// The metric and image that fronts are computed from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Judge {
    /// The metric.
    pub metric: Metric,
    /// The image; the picture where a slot has no such image.
    pub image: Image,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_and_keys_name_one_metric_each() {
        for metric in Metric::ALL {
            assert_eq!(metric.word().parse(), Ok(metric));
            assert_eq!(Metric::ALL.iter().filter(|m| m.key() == metric.key()).count(), 1);
        }
        for image in Image::ALL {
            assert_eq!(image.word().parse(), Ok(image));
        }
        assert!("flap".parse::<Metric>().unwrap_err().contains("flip, hdr-flip, relmse"));
        assert_eq!(Judge::default(), Judge { metric: Metric::FlipLdr, image: Image::Picture });
    }

    #[test]
    fn a_single_metric_is_that_of_the_whole_comparison() {
        let picture = |f: f32| Picture::grey(8, 8, &(0..64).map(|i| 0.05 + f * i as f32).collect::<Vec<_>>());
        let (test, truth) = (picture(0.05), picture(0.04));
        let display = Display { exposure: 0.5, ..Display::PLAIN };
        let whole = Comparison::displayed(&test, &truth, &display).unwrap();
        for metric in Metric::ALL {
            let alone = metric.measure(&test, &truth, &display).unwrap();
            assert!((alone - metric.of(&whole)).abs() < 1e-12 && alone > 0.0, "{metric}: {alone}");
        }
    }
}
