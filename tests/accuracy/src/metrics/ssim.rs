//! Structural similarity.
use super::picture::{check_pair, luminance};
use super::{Map, MetricError, Picture};
use rayon::prelude::*;

/// Radius of the window, pixels: 11 x 11.
const REACH: usize = 5;
/// Standard deviation of the window, pixels.
const SIGMA: f64 = 1.5;
/// `(K1 L)²` and `(K2 L)²` with L = 1.
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// Structural similarity (Wang, Bovik, Sheikh, Simoncelli 2004, "Image Quality Assessment: From Error Visibility to Structural Similarity")
/// of the luma of display values (clamped to 0..1, sRGB-encoded). Mean of [`ssim_map`], from -1 to 1 (equal).
///
/// # Errors
/// [`MetricError`] if the pictures differ in size or are not finite.
pub fn ssim(test: &Picture, reference: &Picture) -> Result<f64, MetricError> {
    let values = similarity(test, reference)?;
    Ok(values.iter().sum::<f64>() / values.len() as f64)
}

/// Structural similarity around each pixel, under a Gaussian window of 11 x 11 pixels and standard deviation 1.5. The paper leaves out the
/// border; here the window is cut there and its weights renormalised, so that the map covers the picture.
///
/// # Errors
/// As [`ssim`].
pub fn ssim_map(test: &Picture, reference: &Picture) -> Result<Map, MetricError> {
    let values = similarity(test, reference)?.into_iter().map(|v| v as f32).collect();
    Ok(Map { width: test.width, height: test.height, values })
}

fn similarity(test: &Picture, reference: &Picture) -> Result<Vec<f64>, MetricError> {
    check_pair(test, reference)?;
    let luma = |picture: &Picture| picture.encoded().pixels.iter().map(luminance).collect::<Vec<_>>();
    let (a, b) = (luma(test), luma(reference));
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).collect::<Vec<_>>();
    let (aa, bb, ab) = (product(&a, &a), product(&b, &b), product(&a, &b));
    let blurred: Vec<_> = [a, b, aa, bb, ab].par_iter().map(|values| blur(values, test.width)).collect();
    let similar = |at: usize| {
        let [mean_a, mean_b, aa, bb, ab] = [0, 1, 2, 3, 4].map(|i| blurred[i][at]);
        // Rounding can make the variance of a flat window slightly negative, by far less than C2.
        let (var_a, var_b, covariance) = (aa - mean_a * mean_a, bb - mean_b * mean_b, ab - mean_a * mean_b);
        let luminance = (2.0 * mean_a * mean_b + C1) / (mean_a * mean_a + mean_b * mean_b + C1);
        luminance * (2.0 * covariance + C2) / (var_a + var_b + C2)
    };
    Ok((0..test.pixels.len()).map(similar).collect())
}

/// Separable Gaussian blur, over rows and then columns.
fn blur(values: &[f64], width: usize) -> Vec<f64> {
    let rows: Vec<f64> = values.chunks(width).flat_map(|row| blur_line(row, 1, width)).collect();
    let height = values.len() / width;
    let mut out = vec![0.0; values.len()];
    for x in 0..width {
        for (y, value) in blur_line(&rows[x..], width, height).enumerate() {
            out[y * width + x] = value;
        }
    }
    out
}

/// Blurs `count` values that lie `step` apart.
fn blur_line(values: &[f64], step: usize, count: usize) -> impl Iterator<Item = f64> + '_ {
    let weights: [f64; REACH + 1] = std::array::from_fn(|i| (-((i * i) as f64) / (2.0 * SIGMA * SIGMA)).exp());
    (0..count).map(move |at| {
        let (mut sum, mut total) = (0.0, 0.0);
        for near in at.saturating_sub(REACH)..(at + REACH + 1).min(count) {
            let weight = weights[near.abs_diff(at)];
            sum += weight * values[near * step];
            total += weight;
        }
        sum / total
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture with the encoded luma that `value` returns.
    fn encoded(width: usize, height: usize, value: impl Fn(usize, usize) -> f32) -> Picture {
        let decode = |x: f32| magpie::pixels::srgb_decode(x);
        let values: Vec<f32> = (0..width * height).map(|i| decode(value(i % width, i / width))).collect();
        Picture::grey(width, height, &values)
    }

    #[test]
    fn flat_pictures_follow_the_closed_form() {
        let (a, b) = (encoded(20, 15, |_, _| 0.25), encoded(20, 15, |_, _| 0.75));
        let wanted = (2.0 * 0.25 * 0.75 + C1) / (0.25_f64.powi(2) + 0.75_f64.powi(2) + C1);
        assert!((ssim(&a, &b).unwrap() - wanted).abs() < 1e-6, "{}", ssim(&a, &b).unwrap());
        assert!((ssim(&a, &a).unwrap() - 1.0).abs() < 1e-12);
        // Everything above 1 is the same white.
        let (white, more) = (Picture::grey(3, 3, &[1.0; 9]), Picture::grey(3, 3, &[9.0; 9]));
        assert!((ssim(&white, &more).unwrap() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_window_by_hand_agrees_in_the_middle_and_in_the_corner() {
        let wave = |x: usize, y: usize| 0.5 + 0.4 * ((x * 7 + y * 3) as f32 * 0.7).sin();
        let (a, b) = (encoded(23, 17, wave), encoded(23, 17, |x, y| 0.9 * wave(x + 1, y)));
        let map = ssim_map(&a, &b).unwrap();
        let luma = |p: &Picture, x: usize, y: usize| luminance(&p.encoded().pixels[y * 23 + x]);
        for (x, y) in [(11, 8), (0, 0), (22, 3)] {
            let mut sums = [0.0; 6];
            for v in 0..17_usize {
                for u in 0..23_usize {
                    let (dx, dy) = (u.abs_diff(x), v.abs_diff(y));
                    if dx <= 5 && dy <= 5 {
                        let weight = (-((dx * dx + dy * dy) as f64) / 4.5).exp();
                        let (a, b) = (luma(&a, u, v), luma(&b, u, v));
                        let add = [1.0, a, b, a * a, b * b, a * b];
                        sums.iter_mut().zip(add).for_each(|(sum, value)| *sum += weight * value);
                    }
                }
            }
            let [ma, mb, aa, bb, ab] = [1, 2, 3, 4, 5].map(|i| sums[i] / sums[0]);
            let wanted = (2.0 * ma * mb + 1e-4) * (2.0 * (ab - ma * mb) + 9e-4)
                / ((ma * ma + mb * mb + 1e-4) * (aa - ma * ma + bb - mb * mb + 9e-4));
            let got = f64::from(map.values[y * 23 + x]);
            assert!((got - wanted).abs() < 1e-6, "({x}, {y}): {got}, wanted {wanted}");
        }
    }

    #[test]
    fn an_inverted_pattern_is_below_zero_and_noise_below_a_shift() {
        let stripes = |x: usize, y: usize| if (x + y).is_multiple_of(2) { 0.2 } else { 0.8 };
        let a = encoded(32, 32, stripes);
        let inverted = ssim(&encoded(32, 32, |x, y| 1.0 - stripes(x, y)), &a).unwrap();
        assert!(inverted < -0.9, "{inverted}");
        let brighter = ssim(&encoded(32, 32, |x, y| stripes(x, y) + 0.1), &a).unwrap();
        let flat = ssim(&encoded(32, 32, |_, _| 0.5), &a).unwrap();
        assert!(brighter > 0.95 && flat < 0.1, "{brighter} {flat}");
    }

    #[test]
    fn the_smallest_picture_and_what_is_refused() {
        let one = Picture::grey(1, 1, &[0.5]);
        assert!((ssim(&one, &one).unwrap() - 1.0).abs() < 1e-12);
        assert!(ssim(&one, &Picture::grey(2, 1, &[0.5; 2])).is_err());
        assert!(ssim(&one, &Picture::grey(1, 1, &[f32::NAN])).is_err());
    }
}
