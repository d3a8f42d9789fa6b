//! Mean errors of single values: RMSE, relMSE, SMAPE, PSNR. All sums are in double precision.
use super::picture::check_pair;
use super::{Map, MetricError, Picture};

/// Added to the squared reference in [`relmse`]: below 0.01 the error becomes absolute.
pub const RELMSE_EPSILON: f64 = 1e-4;
/// Added to the sum of both values in [`smape`], as in Vogels et al. 2018.
pub const SMAPE_EPSILON: f64 = 1e-2;

/// Error of one channel, from the value under test and that of the reference.
type Error = fn(f64, f64) -> f64;

pub(super) fn squared(a: f64, b: f64) -> f64 {
    (a - b) * (a - b)
}

pub(super) fn relative(a: f64, b: f64) -> f64 {
    squared(a, b) / (b * b + RELMSE_EPSILON)
}

fn symmetric(a: f64, b: f64) -> f64 {
    (a - b).abs() / (a.abs() + b.abs() + SMAPE_EPSILON)
}

/// The mean of `error` over the channels of each pixel.
fn per_pixel<'a>(test: &'a Picture, reference: &'a Picture, error: Error) -> impl Iterator<Item = f64> + 'a {
    test.pixels.iter().zip(&reference.pixels).map(move |(a, b)| {
        let [r, g, b] = [0, 1, 2].map(|c| error(f64::from(a[c]), f64::from(b[c])));
        (r + g + b) / 3.0
    })
}

fn mean(test: &Picture, reference: &Picture, error: Error) -> Result<f64, MetricError> {
    check_pair(test, reference)?;
    Ok(per_pixel(test, reference, error).sum::<f64>() / test.pixels.len() as f64)
}

fn map(test: &Picture, reference: &Picture, error: Error) -> Result<Map, MetricError> {
    check_pair(test, reference)?;
    let values = per_pixel(test, reference, error).map(|e| e as f32).collect();
    Ok(Map { width: test.width, height: test.height, values })
}

/// Mean squared error over pixels and channels: `mean((a - b)²)`, in the squared unit of the pictures, at least 0.
///
/// # Errors
/// [`MetricError`] if the pictures differ in size or are not finite; so for every function here.
pub fn mse(test: &Picture, reference: &Picture) -> Result<f64, MetricError> {
    mean(test, reference, squared)
}

/// The squared error of each pixel, mean over its channels.
///
/// # Errors
/// As [`mse`].
pub fn squared_error_map(test: &Picture, reference: &Picture) -> Result<Map, MetricError> {
    map(test, reference, squared)
}

/// Root mean squared error over pixels and channels, in the unit of the pictures, at least 0.
///
/// # Errors
/// As [`mse`].
pub fn rmse(test: &Picture, reference: &Picture) -> Result<f64, MetricError> {
    Ok(mse(test, reference)?.sqrt())
}

/// Relative mean squared error, `mean((a - b)² / (b² + 1e-4))` over pixels and channels, at least 0. The form is that of Rousselle, Knaus,
/// Zwicker 2011, "Adaptive Sampling and Reconstruction using Greedy Error Minimization"; the constant differs from paper to paper, this one
/// is [`RELMSE_EPSILON`]. Outliers are not trimmed.
///
/// # Errors
/// As [`mse`].
pub fn relmse(test: &Picture, reference: &Picture) -> Result<f64, MetricError> {
    mean(test, reference, relative)
}

/// The relative squared error of each pixel, mean over its channels.
///
/// # Errors
/// As [`mse`].
pub fn relmse_map(test: &Picture, reference: &Picture) -> Result<Map, MetricError> {
    map(test, reference, relative)
}

/// Symmetric mean absolute percentage error, `mean(|a - b| / (|a| + |b| + 1e-2))` over pixels and channels, from 0 to 1: Vogels et
/// al. 2018, "Denoising with Kernel Prediction and Asymmetric Loss Functions".
///
/// # Errors
/// As [`mse`].
pub fn smape(test: &Picture, reference: &Picture) -> Result<f64, MetricError> {
    mean(test, reference, symmetric)
}

/// [`smape`] of each pixel, mean over its channels.
///
/// # Errors
/// As [`mse`].
pub fn smape_map(test: &Picture, reference: &Picture) -> Result<Map, MetricError> {
    map(test, reference, symmetric)
}

/// Peak signal-to-noise ratio, `10 log10(peak² / mse)`, decibels: higher is better, infinite for equal pictures. `peak` is the greatest
/// possible value; 1 for display values.
///
/// # Errors
/// As [`mse`], and [`MetricError::Parameter`] where `peak` is not finite and above 0.
pub fn psnr(test: &Picture, reference: &Picture, peak: f64) -> Result<f64, MetricError> {
    psnr_of_mse(mse(test, reference)?, peak)
}

/// [`psnr`] from a known mean squared error, such as that of the pass `metrics.sum`.
///
/// # Errors
/// [`MetricError::Parameter`] if `mse` is negative or NaN, or `peak` is not finite and above 0.
pub fn psnr_of_mse(mse: f64, peak: f64) -> Result<f64, MetricError> {
    if !(mse >= 0.0 && mse.is_finite()) {
        return Err(MetricError::Parameter { name: "mse", wanted: "a finite number from 0 up", got: mse });
    }
    if !(peak > 0.0 && peak.is_finite()) {
        return Err(MetricError::Parameter { name: "peak", wanted: "a finite number above 0", got: peak });
    }
    Ok(10.0 * (peak * peak / mse).log10())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(got: f64, wanted: f64) {
        assert!((got - wanted).abs() <= 1e-9 * wanted.abs(), "{got}, wanted {wanted}");
    }

    /// Two pixels that differ by 0.5 in one channel each, exact in binary.
    fn pair() -> (Picture, Picture) {
        let reference = Picture { width: 2, height: 1, pixels: vec![[0.5, 1.0, 2.0], [0.0, 0.25, 4.0]] };
        let mut test = reference.clone();
        test.pixels[0][1] = 1.5;
        test.pixels[1][0] = 0.5;
        (test, reference)
    }

    #[test]
    fn known_pictures_have_known_errors() {
        let (test, reference) = pair();
        near(mse(&test, &reference).unwrap(), 0.5 / 6.0);
        near(rmse(&test, &reference).unwrap(), (0.5_f64 / 6.0).sqrt());
        near(relmse(&test, &reference).unwrap(), (0.25 / 1.0001 + 0.25 / 1e-4) / 6.0);
        near(smape(&test, &reference).unwrap(), (0.5 / 2.51 + 0.5 / 0.51) / 6.0);
        near(psnr(&test, &reference, 2.0).unwrap(), 10.0 * (4.0_f64 / (0.5 / 6.0)).log10());
        assert_eq!(squared_error_map(&test, &reference).unwrap().values, [0.25 / 3.0; 2].map(|x: f64| x as f32));
        for (map, mean) in [(relmse_map as fn(_, _) -> _, relmse as fn(_, _) -> _), (smape_map, smape)] {
            let (map, mean): (Result<Map, MetricError>, Result<f64, MetricError>) =
                (map(&test, &reference), mean(&test, &reference));
            assert!((map.unwrap().mean() / mean.unwrap() - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn equal_pictures_have_no_error() {
        let (_, picture) = pair();
        for metric in [mse, rmse, relmse, smape] {
            assert_eq!(metric(&picture, &picture), Ok(0.0));
        }
        assert_eq!(psnr(&picture, &picture, 1.0), Ok(f64::INFINITY));
    }

    #[test]
    fn smape_does_not_care_which_is_which_and_ends_at_one() {
        let (test, reference) = pair();
        assert_eq!(smape(&test, &reference), smape(&reference, &test));
        let (black, white) = (Picture::grey(1, 1, &[0.0]), Picture::grey(1, 1, &[1e6]));
        let most = smape(&white, &black).unwrap();
        assert!(most > 1.0 - 1e-7 && most <= 1.0, "{most}");
    }

    #[test]
    fn a_small_error_is_seen_beside_a_large_sum() {
        // In single precision the last of a million squares would be lost in the sum.
        let reference = Picture::grey(1000, 1000, &vec![0.0; 1_000_000]);
        let mut test = Picture::grey(1000, 1000, &vec![1.0; 1_000_000]);
        test.pixels[999_999] = [1.0 + 2.0_f32.powi(-10); 3];
        let beyond = mse(&test, &reference).unwrap() - 1.0;
        assert!((beyond / 1.954e-9 - 1.0).abs() < 1e-2, "{beyond}");
    }

    #[test]
    fn what_cannot_be_compared_is_refused() {
        let (mut test, reference) = pair();
        let other = Picture::grey(1, 2, &[0.0; 2]);
        let error = rmse(&other, &reference).unwrap_err().to_string();
        assert!(error.contains("1x2") && error.contains("2x1"), "{error}");
        test.pixels[1][2] = f32::NAN;
        for metric in [mse, rmse, relmse, smape] {
            let error = metric(&test, &reference).unwrap_err().to_string();
            assert_eq!(error, "the picture under test has NaN in channel 2 of pixel (1, 0)");
            let error = metric(&reference, &test).unwrap_err().to_string();
            assert_eq!(error, "the reference has NaN in channel 2 of pixel (1, 0)");
        }
        assert!(squared_error_map(&test, &reference).is_err() && psnr(&test, &reference, 1.0).is_err());
        for peak in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(psnr(&reference, &reference, peak).is_err(), "{peak}");
        }
        assert!(psnr_of_mse(f64::NAN, 1.0).is_err() && psnr_of_mse(-1.0, 1.0).is_err());
    }
}
