//! FLIP, the perceived difference of two alternating pictures, by its authors' code; and HDR-FLIP.
use super::picture::{check_pair, luminance};
use super::{Map, MetricError, Picture};
use nv_flip::{DEFAULT_PIXELS_PER_DEGREE, FlipImageFloat, FlipImageRgb8, magma_lut};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Angular resolution, pixels per degree: 0.7 m from a display 0.7 m and 3840 pixels wide.
pub const FLIP_PIXELS_PER_DEGREE: f32 = DEFAULT_PIXELS_PER_DEGREE;

/// Tone-mapped value of the brightest pixel at the start exposure, and of the median pixel at the stop exposure.
const BRIGHT: f64 = 0.85;
/// Coefficients of the tone curve's numerator and denominator, highest power first: the fit of ACES by Narkowicz 2015, with its
/// pre-exposure of 0.6 included, as used by Andersson et al. 2021.
const NUMERATOR: [f64; 3] = [0.36 * 2.51, 0.6 * 0.03, 0.0];
const DENOMINATOR: [f64; 3] = [0.36 * 2.43, 0.6 * 0.59, 0.14];

/// The exposures of HDR-FLIP.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Exposures {
    /// First exposure, stops: the brightest pixel of the reference just avoids clipping.
    pub start: f64,
    /// Last exposure, stops: the median pixel of the reference reaches the same value.
    pub stop: f64,
    /// Number of exposures, evenly spaced from start to stop.
    pub count: usize,
}

impl Exposures {
    fn each(self) -> impl IndexedParallelIterator<Item = f64> {
        let step = if self.count > 1 { (self.stop - self.start) / (self.count - 1) as f64 } else { 0.0 };
        (0..self.count).into_par_iter().map(move |i| self.start + i as f64 * step)
    }
}

/// Mean FLIP of display values (clamped to 0..1), from 0 (equal) to 1: Andersson et al. 2020, "FLIP: A Difference Evaluator for Alternating
/// Images", at [`FLIP_PIXELS_PER_DEGREE`].
///
/// # Errors
/// [`MetricError`] if the pictures differ in size or are not finite.
pub fn flip_ldr(test: &Picture, reference: &Picture) -> Result<f64, MetricError> {
    Ok(flip_ldr_map(test, reference)?.mean())
}

/// FLIP of each pixel, of which [`flip_ldr`] is the mean. The authors' code takes 8 bits per channel, so differences below one of 255 steps
/// can count as equal.
///
/// # Errors
/// As [`flip_ldr`].
pub fn flip_ldr_map(test: &Picture, reference: &Picture) -> Result<Map, MetricError> {
    check_pair(test, reference)?;
    let values = flip_of_bytes(test, &test.to_srgb8(), &reference.to_srgb8());
    Ok(Map { width: test.width, height: test.height, values })
}

/// Mean of [`flip_hdr_map`], from 0 (equal) to 1.
///
/// # Errors
/// As [`flip_ldr`].
pub fn flip_hdr(test: &Picture, reference: &Picture) -> Result<f64, MetricError> {
    Ok(flip_hdr_map(test, reference)?.mean())
}

/// HDR-FLIP: Andersson, Nilsson, Shirley, Akenine-Möller 2021, "Visualizing Errors in Rendered High Dynamic Range Images". Both pictures
/// are tone-mapped at each of the [`exposures`] of the reference; a pixel's error is the maximum of its FLIP values.
///
/// # Errors
/// As [`flip_ldr`].
pub fn flip_hdr_map(test: &Picture, reference: &Picture) -> Result<Map, MetricError> {
    check_pair(test, reference)?;
    let at_exposure = |stops: f64| flip_of_bytes(test, &expose(test, stops), &expose(reference, stops));
    let greater = |mut a: Vec<f32>, b: Vec<f32>| {
        a.iter_mut().zip(b).for_each(|(a, b)| *a = a.max(b));
        a
    };
    let values = exposures(reference)?.each().map(at_exposure).reduce_with(greater).unwrap_or_default();
    Ok(Map { width: test.width, height: test.height, values })
}

/// The exposures of [`flip_hdr`] for a reference: from where its brightest pixel reaches 0.85 on the tone curve to where its median pixel
/// does, one per stop and at least two; a single one if both are equal. If more than half of the pixels are black, the median is that of
/// the others; if all are, the only exposure is 0.
///
/// # Errors
/// [`MetricError`] if the reference is not finite.
pub fn exposures(reference: &Picture) -> Result<Exposures, MetricError> {
    reference.check("the reference")?;
    let mut light: Vec<f64> = reference.pixels.iter().map(luminance).collect();
    light.sort_by(f64::total_cmp);
    let (lit, brightest) = (light.partition_point(|&y| y <= 0.0), light[light.len() - 1]);
    if brightest <= 0.0 {
        return Ok(Exposures { start: 0.0, stop: 0.0, count: 1 });
    }
    let middle = light.len() / 2;
    let median = light[if middle >= lit { middle } else { lit + (light.len() - lit) / 2 }];
    let x = brightest_input();
    let (start, stop) = ((x / brightest).log2(), (x / median).log2());
    let count = if stop > start { ((stop - start).ceil() as usize).max(2) } else { 1 };
    Ok(Exposures { start, stop, count })
}

/// Input for which the tone curve gives [`BRIGHT`]: the positive root of `numerator - BRIGHT * denominator`.
fn brightest_input() -> f64 {
    let [a, b, c] = [0, 1, 2].map(|i| NUMERATOR[i] - BRIGHT * DENOMINATOR[i]);
    (-b + (b * b - 4.0 * a * c).sqrt()) / (2.0 * a)
}

fn tone(x: f64) -> f64 {
    let polynomial = |c: [f64; 3]| (c[0] * x + c[1]) * x + c[2];
    polynomial(NUMERATOR) / polynomial(DENOMINATOR)
}

/// Display values at an exposure in stops.
fn expose(picture: &Picture, stops: f64) -> Vec<u8> {
    let scale = stops.exp2();
    // The curve is defined for radiance: negative values become black.
    let shown = |x: f32| tone(f64::from(x).max(0.0) * scale) as f32;
    let pixels = picture.pixels.iter().map(|p| p.map(shown)).collect();
    Picture { pixels, ..*picture }.to_srgb8()
}

fn flip_of_bytes(size: &Picture, test: &[u8], reference: &[u8]) -> Vec<f32> {
    let image = |bytes: &[u8]| FlipImageRgb8::with_data(size.width as u32, size.height as u32, bytes);
    nv_flip::flip(image(reference), image(test), FLIP_PIXELS_PER_DEGREE).to_vec()
}

/// Colours of a FLIP map: the colour map magma, from black over red to pale yellow for 0..1. Three bytes per pixel, sRGB.
pub fn magma(map: &Map) -> Vec<u8> {
    let values: Vec<f32> = map.values.iter().map(|v| v.clamp(0.0, 1.0)).collect();
    FlipImageFloat::with_data(map.width as u32, map.height as u32, &values).apply_color_lut(&magma_lut()).to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_reaches_its_marks() {
        assert!((tone(brightest_input()) - 0.85).abs() < 1e-12);
        assert_eq!(tone(0.0), 0.0);
        assert!((brightest_input() - 2.1189).abs() < 1e-4, "{}", brightest_input());
        // The curve's limit is above 1, which is clamped.
        assert!(tone(1e30) > 1.0 && tone(1e30) < 1.04);
    }

    #[test]
    fn exposures_go_from_the_brightest_to_the_median() {
        let mut values = vec![0.5; 9];
        values[4] = 32.0;
        let got = exposures(&Picture::grey(3, 3, &values)).unwrap();
        // 0.5 and 32 are six stops apart.
        assert!((got.stop - got.start - 6.0).abs() < 1e-6, "{got:?}");
        assert!((got.stop - (brightest_input() / 0.5).log2()).abs() < 1e-6);
        assert!((6..=7).contains(&got.count), "{got:?}");
        assert_eq!(exposures(&Picture::grey(2, 2, &[0.7; 4])).unwrap().count, 1);
        assert_eq!(exposures(&Picture::grey(2, 1, &[0.7, 0.6])).unwrap().count, 1);
        assert_eq!(exposures(&Picture::grey(3, 1, &[0.7, 0.6, 0.6])).unwrap().count, 2);
    }

    #[test]
    fn black_has_an_exposure_as_well() {
        let black = Picture::grey(2, 2, &[0.0; 4]);
        assert_eq!(exposures(&black).unwrap(), Exposures { start: 0.0, stop: 0.0, count: 1 });
        assert_eq!(flip_hdr(&black, &black), Ok(0.0));
        assert!(flip_hdr(&Picture::grey(2, 2, &[1.0; 4]), &black).unwrap() > 0.5);
        let mostly = exposures(&Picture::grey(5, 1, &[0.0, 0.0, 1.0, 0.0, 0.25])).unwrap();
        assert!(mostly.stop.is_finite() && mostly.stop >= mostly.start, "{mostly:?}");
    }

    #[test]
    fn ldr_grows_with_the_difference_and_is_the_authors_number() {
        let grey = |byte: u8| Picture::from_srgb8(16, 8, &[byte; 16 * 8 * 3]);
        assert_eq!(flip_ldr(&grey(100), &grey(100)), Ok(0.0));
        let (near, far) = (flip_ldr(&grey(104), &grey(100)).unwrap(), flip_ldr(&grey(140), &grey(100)).unwrap());
        assert!(0.0 < near && near < far && far < 0.5, "{near} {far}");
        let most = flip_ldr(&grey(255), &grey(0)).unwrap();
        assert!((0.9..=1.0).contains(&most), "{most}");
    }

    #[test]
    fn an_error_in_the_highlights_is_seen_only_in_high_dynamic_range() {
        // A light of radiance 40 against one of 20: both clip to white.
        let room = |lamp: f32| {
            let values: Vec<f32> = (0..64 * 32).map(|i| if i % 64 > 40 { lamp } else { 0.2 }).collect();
            Picture::grey(64, 32, &values)
        };
        let (test, reference) = (room(40.0), room(20.0));
        assert_eq!(flip_ldr(&test, &reference), Ok(0.0));
        let map = flip_hdr_map(&test, &reference).unwrap();
        assert!(map.values[16 * 64 + 60] > 0.05 && map.values[16 * 64] < 0.01);
        assert!((flip_hdr(&test, &reference).unwrap() - map.mean()).abs() < 1e-12);
    }

    #[test]
    fn colours_run_from_black_to_pale_and_every_value_has_one() {
        let colours = magma(&Map { width: 4, height: 1, values: vec![0.0, 0.5, 1.0, 7.0] });
        let sum = |i: usize| colours[3 * i..3 * i + 3].iter().map(|&c| u32::from(c)).sum::<u32>();
        assert!(sum(0) < 12 && sum(0) < sum(1) && sum(1) < sum(2) && sum(2) == sum(3) && sum(2) > 600, "{colours:?}");
    }

    #[test]
    fn what_cannot_be_compared_is_refused() {
        let (a, b) = (Picture::grey(2, 1, &[0.0; 2]), Picture::grey(1, 2, &[0.0; 2]));
        let nan = Picture::grey(2, 1, &[0.0, f32::NAN]);
        for metric in [flip_ldr, flip_hdr] {
            assert!(matches!(metric(&a, &b), Err(MetricError::Size { .. })));
            assert!(matches!(metric(&nan, &a), Err(MetricError::NotFinite { x: 1, y: 0, .. })));
            assert!(matches!(metric(&a, &nan), Err(MetricError::NotFinite { x: 1, y: 0, .. })));
        }
    }
}
