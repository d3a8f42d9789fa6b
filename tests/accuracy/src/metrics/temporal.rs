//! Metrics of sequences: flicker, lag, ghosting, and error of disoccluded pixels.
use super::picture::check_pair;
use super::spatial::{relative, squared};
use super::{Map, MetricError, Picture};
use serde::{Deserialize, Serialize};
use std::cmp::Ordering;

/// Share of a step at which it counts as complete.
const REACHED: f64 = 0.9;
/// Least squared step of a pixel in [`Lag::median_frames`], relative to the greatest.
const MIN_STEP: f64 = 1e-4;

/// Temporal variance at a static camera.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Flicker {
    /// Temporal variance in excess of the reference's, mean over pixels and channels, in the squared unit of the pictures.
    pub variance: f64,
    /// Its square root over the mean luminance of the reference; none if that is not above 0.
    pub relative: Option<f64>,
}

/// Response to a sudden change.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Lag {
    /// Share of the step completed by the picture as a whole, per frame: 0 before, 1 after.
    pub curve: Vec<f64>,
    /// Frames until `curve` first reaches 0.9, counted from 1 for the first frame after the change; none if it never does.
    pub frames: Option<usize>,
    /// The same per pixel that changed, the median over them; none if half or more of them never do.
    pub median_frames: Option<usize>,
    /// Number of pixels that changed by at least 1 % of the greatest change.
    pub pixels: usize,
    /// Number of those that never reach 0.9.
    pub unreached: usize,
}

/// Remains of something that vanished suddenly.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ghosting {
    /// Remaining energy per frame, relative to what the vanished thing contributed: 1 before, 0 gone, negative for overshoot.
    pub curve: Vec<f64>,
    /// Sum of the curve: the equivalent number of frames of full persistence.
    pub total_frames: f64,
}

/// Error of disoccluded pixels, and of all others.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Disocclusion {
    /// Number of disoccluded pixels.
    pub pixels_new: usize,
    /// Number of all others.
    pub pixels_elsewhere: usize,
    /// Mean squared error of the disoccluded ones; none if there are none.
    pub mse_new: Option<f64>,
    /// The same of all others.
    pub mse_elsewhere: Option<f64>,
    /// Relative mean squared error of the disoccluded ones, as in [`super::relmse`].
    pub relmse_new: Option<f64>,
    /// The same of all others.
    pub relmse_elsewhere: Option<f64>,
}

/// Checks that there are at least `least` pictures, of the reference's size and finite.
fn check_frames(what: &'static str, frames: &[Picture], least: usize, like: &Picture) -> Result<(), MetricError> {
    if frames.len() < least {
        return Err(MetricError::Frames { what, wanted: format!("{least} at least"), got: frames.len() });
    }
    for (frame, picture) in frames.iter().enumerate() {
        let checked = picture.check(what).and_then(|()| picture.check_size(what, like));
        checked.map_err(|fault| MetricError::Frame { frame, fault: Box::new(fault) })?;
    }
    Ok(())
}

/// Temporal variance of each pixel, mean over its channels: the unbiased estimate, divided by the frames less one.
fn variances(frames: &[Picture]) -> Vec<f64> {
    let (count, pixels) = (frames.len() as f64, frames.first().map_or(0, |f| f.pixels.len()));
    let variance = |at: usize, c: usize| {
        let values = || frames.iter().map(|f| f64::from(f.pixels[at][c]));
        let mean = values().sum::<f64>() / count;
        values().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (count - 1.0)
    };
    (0..pixels).map(|at| (variance(at, 0) + variance(at, 1) + variance(at, 2)) / 3.0).collect()
}

fn excess(test: &[Picture], reference: &[Picture]) -> Result<Vec<f64>, MetricError> {
    let what = "the reference sequence";
    let Some(like) = reference.first() else {
        return Err(MetricError::Frames { what, wanted: "1, or as many as the test".to_owned(), got: 0 });
    };
    check_frames(what, reference, 1, like)?;
    check_frames("the sequence under test", test, 2, like)?;
    let own = match reference.len() {
        1 => vec![0.0; like.pixels.len()],
        n if n == test.len() => variances(reference),
        got => return Err(MetricError::Frames { what, wanted: format!("1 or {}", test.len()), got }),
    };
    Ok(variances(test).into_iter().zip(own).map(|(test, own)| (test - own).max(0.0)).collect())
}

/// Temporal variance at a static camera in excess of the reference's: `mean over pixels of max(0, var(test) - var(reference))`. The
/// reference is a sequence of the same length, or one converged picture, whose variance is 0.
///
/// # Errors
/// [`MetricError`] if there are fewer than two frames, or a picture differs in size or is not finite.
pub fn flicker(test: &[Picture], reference: &[Picture]) -> Result<Flicker, MetricError> {
    let excess = excess(test, reference)?;
    let variance = excess.iter().sum::<f64>() / excess.len() as f64;
    let mean = reference.iter().map(Picture::mean_luminance).sum::<f64>() / reference.len() as f64;
    Ok(Flicker { variance, relative: (mean > 0.0).then(|| variance.sqrt() / mean) })
}

/// [`flicker`] of each pixel: excess temporal variance, mean over its channels.
///
/// # Errors
/// As [`flicker`].
pub fn flicker_map(test: &[Picture], reference: &[Picture]) -> Result<Map, MetricError> {
    let values = excess(test, reference)?.into_iter().map(|v| v as f32).collect();
    let Picture { width, height, .. } = reference[0];
    Ok(Map { width, height, values })
}

/// For one pixel: dot product of its progress with its step, and the step's squared length.
fn along(now: &[f32; 3], before: &[f32; 3], after: &[f32; 3]) -> [f64; 2] {
    let [mut gone, mut all] = [0.0; 2];
    for c in 0..3 {
        let (now, before, after) = (f64::from(now[c]), f64::from(before[c]), f64::from(after[c]));
        gone += (now - before) * (after - before);
        all += (after - before) * (after - before);
    }
    [gone, all]
}

fn check_step(test: &[Picture], before: &Picture, after: &Picture) -> Result<(), MetricError> {
    after.check("the picture after the change")?;
    before.check("the picture before the change")?;
    before.check_size("the picture before the change", after)?;
    check_frames("the sequence under test", test, 1, after)
}

/// Response to a sudden change. `test` begins with the first frame after it; `before` and `after` are converged pictures, preferably of the
/// implementation under test, so that its bias at rest does not count as delay.
///
/// The response of a frame `x` is its share of the step by least squares over pixels and channels: `sum((x - before) (after - before)) /
/// sum((after - before)²)`. Zero-mean noise cancels.
///
/// # Errors
/// [`MetricError`] if there are no frames, a picture differs in size or is not finite, or nothing changed.
pub fn lag(test: &[Picture], before: &Picture, after: &Picture) -> Result<Lag, MetricError> {
    check_step(test, before, after)?;
    let steps: Vec<f64> = before.pixels.iter().zip(&after.pixels).map(|(b, a)| along(a, b, a)[1]).collect();
    let (all, greatest) = (steps.iter().sum::<f64>(), steps.iter().copied().fold(0.0, f64::max));
    if all <= 0.0 {
        return Err(MetricError::Nothing { metric: "lag", fault: "nothing changed from before to after" });
    }
    let response = |frame: &Picture, at: usize| along(&frame.pixels[at], &before.pixels[at], &after.pixels[at])[0];
    let curve: Vec<f64> =
        test.iter().map(|frame| (0..steps.len()).map(|at| response(frame, at)).sum::<f64>() / all).collect();
    let frames = curve.iter().position(|&part| part >= REACHED).map(|at| at + 1);

    let changed = (0..steps.len()).filter(|&at| steps[at] > 0.0 && steps[at] >= MIN_STEP * greatest);
    let reach = |at: usize| test.iter().position(|frame| response(frame, at) >= REACHED * steps[at]).map(|at| at + 1);
    let mut reached: Vec<usize> = changed.map(|at| reach(at).unwrap_or(usize::MAX)).collect();
    reached.sort_unstable();
    let median_frames = Some(reached[reached.len() / 2]).filter(|&frames| frames != usize::MAX);
    let unreached = reached.iter().filter(|&&frames| frames == usize::MAX).count();
    Ok(Lag { curve, frames, median_frames, pixels: reached.len(), unreached })
}

/// Remains of a light or an object that vanished suddenly. `test` begins with the first frame without it; `before` is the converged picture
/// with it, `after` without it.
///
/// The remaining energy of a frame `x` is `sum(s (x - after)) / sum(|before - after|)` over pixels and channels, with the sign `s` of
/// `before - after`: for a light exactly the share of its radiance that remains. Unaffected pixels do not count, and zero-mean noise
/// cancels.
///
/// # Errors
/// As [`lag`].
pub fn ghosting(test: &[Picture], before: &Picture, after: &Picture) -> Result<Ghosting, MetricError> {
    check_step(test, before, after)?;
    let remaining = |now: &Picture| {
        let pixels = now.pixels.iter().zip(&before.pixels).zip(&after.pixels);
        let values = pixels.flat_map(|((n, b), a)| [0, 1, 2].map(|c| [n[c], b[c], a[c]].map(f64::from)));
        let signed = |[now, before, after]: [f64; 3]| match before.partial_cmp(&after) {
            Some(Ordering::Greater) => now - after,
            Some(Ordering::Less) => after - now,
            _ => 0.0,
        };
        values.map(signed).sum::<f64>()
    };
    let added = remaining(before);
    if added <= 0.0 {
        return Err(MetricError::Nothing { metric: "ghosting", fault: "nothing vanished from before to after" });
    }
    let curve: Vec<f64> = test.iter().map(|frame| remaining(frame) / added).collect();
    let total_frames = curve.iter().sum();
    Ok(Ghosting { curve, total_frames })
}

/// The error of disoccluded pixels, where `new` is set, and of all others. The caller derives `new` from motion and depth, or from ids.
///
/// # Errors
/// [`MetricError`] if a picture or the mask differs in size, or is not finite.
pub fn disocclusion(test: &Picture, reference: &Picture, new: &[bool]) -> Result<Disocclusion, MetricError> {
    check_pair(test, reference)?;
    let Picture { width, height, .. } = *reference;
    if new.len() != reference.pixels.len() {
        return Err(MetricError::Length { what: "the mask", width, height, got: new.len() });
    }
    let mean = |wanted: bool, error: fn(f64, f64) -> f64| {
        let (mut sum, mut count) = (0.0, 0_usize);
        for ((a, b), _) in test.pixels.iter().zip(&reference.pixels).zip(new).filter(|(_, new)| **new == wanted) {
            sum += [0, 1, 2].map(|c| error(f64::from(a[c]), f64::from(b[c]))).iter().sum::<f64>();
            count += 3;
        }
        (count > 0).then(|| sum / count as f64)
    };
    let pixels_new = new.iter().filter(|&&new| new).count();
    Ok(Disocclusion {
        pixels_new,
        pixels_elsewhere: new.len() - pixels_new,
        mse_new: mean(true, squared),
        mse_elsewhere: mean(false, squared),
        relmse_new: mean(true, relative),
        relmse_elsewhere: mean(false, relative),
    })
}

impl Disocclusion {
    /// Pools the frames of a path, every pixel with the same weight.
    pub fn pooled(frames: &[Self]) -> Self {
        let pool = |count: fn(&Self) -> usize, mean: fn(&Self) -> Option<f64>| {
            let total: usize = frames.iter().map(count).sum();
            let sum: f64 = frames.iter().filter_map(|f| Some(mean(f)? * count(f) as f64)).sum();
            (total > 0).then(|| sum / total as f64)
        };
        Self {
            pixels_new: frames.iter().map(|f| f.pixels_new).sum(),
            pixels_elsewhere: frames.iter().map(|f| f.pixels_elsewhere).sum(),
            mse_new: pool(|f| f.pixels_new, |f| f.mse_new),
            mse_elsewhere: pool(|f| f.pixels_elsewhere, |f| f.mse_elsewhere),
            relmse_new: pool(|f| f.pixels_new, |f| f.relmse_new),
            relmse_elsewhere: pool(|f| f.pixels_elsewhere, |f| f.relmse_elsewhere),
        }
    }

    /// RMSE of disoccluded pixels over that of the others; 1 means that disocclusion costs nothing. None if either is missing or the others
    /// have no error.
    pub fn excess(&self) -> Option<f64> {
        let (new, elsewhere) = (self.mse_new?, self.mse_elsewhere?);
        (elsewhere > 0.0).then(|| (new / elsewhere).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A step in half of the picture: a light or an object on the left.
    fn step() -> (Picture, Picture) {
        let (width, height) = (8, 4);
        let before = Picture {
            width,
            height,
            pixels: (0..32).map(|i| if i % 8 < 4 { [4.0, 2.0, 0.25 * (i / 8) as f32] } else { [0.5; 3] }).collect(),
        };
        let after = Picture { width, height, pixels: vec![[0.5, 2.5, 0.125]; 32] };
        (before, after)
    }

    /// Exponential moving average from `before` to `after`: `x' = x + alpha (after - x)`.
    fn average(before: &Picture, after: &Picture, alpha: f32, frames: usize) -> Vec<Picture> {
        let mut now = before.clone();
        let mut next = || {
            for (x, a) in now.pixels.iter_mut().flatten().zip(after.pixels.iter().flatten()) {
                *x += alpha * (a - *x);
            }
            now.clone()
        };
        (0..frames).map(|_| next()).collect()
    }

    #[test]
    fn an_average_has_the_lag_that_its_factor_says() {
        let (before, after) = step();
        for (alpha, wanted) in [(1.0, 1), (0.5, 4), (0.25, 9), (0.1, 22), (0.05, 45)] {
            // The first n with 1 - (1 - alpha)^n of at least 0.9.
            assert_eq!(wanted, (0.1_f64.ln() / (1.0 - f64::from(alpha)).ln()).ceil().max(1.0) as usize);
            let got = lag(&average(&before, &after, alpha, 60), &before, &after).unwrap();
            assert_eq!((got.frames, got.median_frames, got.unreached), (Some(wanted), Some(wanted), 0), "{alpha}");
            for (t, part) in got.curve.iter().enumerate() {
                let wanted = 1.0 - (1.0 - f64::from(alpha)).powi(t as i32 + 1);
                assert!((part - wanted).abs() < 1e-5, "alpha {alpha}, frame {t}: {part}, wanted {wanted}");
            }
        }
    }

    #[test]
    fn a_lag_beyond_the_sequence_is_none_and_part_of_the_pixels_may_be_late() {
        let (before, after) = step();
        let slow = lag(&average(&before, &after, 0.1, 20), &before, &after).unwrap();
        assert_eq!((slow.frames, slow.median_frames, slow.unreached), (None, None, slow.pixels));
        // A quarter of the pixels never moves, but they differ little, so the picture as a whole is done.
        let (before, after) = (Picture::grey(4, 1, &[1.0; 4]), Picture::grey(4, 1, &[9.0, 9.0, 9.0, 1.5]));
        let stuck = Picture::grey(4, 1, &[9.0, 9.0, 9.0, 1.0]);
        let got = lag(&[before.clone(), stuck], &before, &after).unwrap();
        assert_eq!((got.frames, got.median_frames, got.pixels, got.unreached), (Some(2), Some(2), 4, 1));
    }

    #[test]
    fn an_average_leaves_the_ghost_that_its_factor_says() {
        let (before, after) = step();
        for alpha in [0.5_f32, 0.2, 0.1] {
            let got = ghosting(&average(&before, &after, alpha, 200), &before, &after).unwrap();
            let keep = 1.0 - f64::from(alpha);
            for (t, part) in got.curve.iter().take(30).enumerate() {
                assert!((part - keep.powi(t as i32 + 1)).abs() < 1e-5, "alpha {alpha}, frame {t}: {part}");
            }
            assert!((got.total_frames / (keep / f64::from(alpha)) - 1.0).abs() < 1e-3, "{alpha}: {}", got.total_frames);
        }
        let gone = ghosting(std::slice::from_ref(&after), &before, &after).unwrap();
        assert_eq!(gone.curve, [0.0]);
        // Overshoot: darker than the target after a light went out.
        let (lit, dark) = (Picture::grey(1, 1, &[3.0]), Picture::grey(1, 1, &[1.0]));
        assert_eq!(ghosting(&[Picture::grey(1, 1, &[0.5])], &lit, &dark).unwrap().curve, [-0.25]);
    }

    #[test]
    fn flicker_is_the_variance_beyond_the_references() {
        // Of 1, 3, 1, 3 the variance is 4 / 3; one pixel of four flickers.
        let frame = |x: f32| Picture::grey(2, 2, &[x, 2.0, 2.0, 2.0]);
        let test: Vec<Picture> = [1.0, 3.0, 1.0, 3.0].map(frame).to_vec();
        let got = flicker(&test, &[frame(2.0)]).unwrap();
        assert!((got.variance - 1.0 / 3.0).abs() < 1e-12, "{got:?}");
        assert!((got.relative.unwrap() - (1.0_f64 / 3.0).sqrt() / 2.0).abs() < 1e-7, "{got:?}");
        let map = flicker_map(&test, &[frame(2.0)]).unwrap();
        assert!((map.values[0] - 4.0 / 3.0).abs() < 1e-6 && map.values[1..] == [0.0; 3]);
        // Variance of the ground truth is no flicker, and less variance in one place does not compensate for more in another.
        assert_eq!(flicker(&test, &test).unwrap().variance, 0.0);
        let lamp: Vec<Picture> = [0.0, 9.0, 0.0, 9.0].map(|x| Picture::grey(2, 2, &[x, 2.0, x, x])).to_vec();
        assert_eq!(flicker(&test, &lamp).unwrap().variance, 0.0);
        let other = flicker(&lamp, &test).unwrap().variance;
        assert!((other - (3.0 * 27.0 - 4.0 / 3.0) / 4.0).abs() < 1e-9, "{other}");
        let black = vec![Picture::grey(1, 1, &[0.0]); 2];
        assert_eq!(flicker(&black, &black[..1]).unwrap().relative, None);
    }

    #[test]
    fn disocclusion_parts_the_error() {
        let reference = Picture::grey(4, 1, &[1.0; 4]);
        let test = Picture::grey(4, 1, &[2.0, 1.5, 1.5, 1.0]);
        let got = disocclusion(&test, &reference, &[true, false, false, false]).unwrap();
        assert_eq!((got.pixels_new, got.pixels_elsewhere), (1, 3));
        assert_eq!((got.mse_new, got.mse_elsewhere), (Some(1.0), Some(0.5 / 3.0)));
        assert!((got.relmse_new.unwrap() - 1.0 / 1.0001).abs() < 1e-12);
        assert!((got.excess().unwrap() - 6.0_f64.sqrt()).abs() < 1e-12);
        let none = disocclusion(&test, &reference, &[false; 4]).unwrap();
        assert_eq!((none.mse_new, none.excess(), none.mse_elsewhere), (None, None, Some(1.5 / 4.0)));
        let pooled = Disocclusion::pooled(&[got, none, got]);
        assert_eq!((pooled.pixels_new, pooled.pixels_elsewhere, pooled.mse_new), (2, 10, Some(1.0)));
        assert!((pooled.mse_elsewhere.unwrap() - (0.5 + 1.5 + 0.5) / 10.0).abs() < 1e-12);
        assert_eq!(Disocclusion::pooled(&[]).mse_new, None);
    }

    #[test]
    fn what_cannot_be_measured_is_refused() {
        let (before, after) = step();
        let frames = average(&before, &after, 0.5, 4);
        let mut broken = frames.clone();
        broken[2].pixels[9][1] = f32::NAN;
        let wanted = "frame 2: the sequence under test has NaN in channel 1 of pixel (1, 1)";
        for error in [
            flicker(&broken, &frames).map(|_| ()).unwrap_err(),
            lag(&broken, &before, &after).map(|_| ()).unwrap_err(),
            ghosting(&broken, &before, &after).map(|_| ()).unwrap_err(),
        ] {
            assert_eq!(error.to_string(), wanted);
        }
        let small = Picture::grey(1, 1, &[0.0]);
        assert!(matches!(lag(&frames, &small, &after), Err(MetricError::Size { .. })));
        assert!(matches!(ghosting(std::slice::from_ref(&small), &before, &after), Err(MetricError::Frame { .. })));
        assert!(matches!(lag(&[], &before, &after), Err(MetricError::Frames { got: 0, .. })));
        assert!(matches!(lag(&frames, &after, &after), Err(MetricError::Nothing { .. })));
        assert!(matches!(ghosting(&frames, &after, &after), Err(MetricError::Nothing { .. })));
        assert!(matches!(flicker(&frames[..1], &frames[..1]), Err(MetricError::Frames { got: 1, .. })));
        assert!(matches!(flicker(&frames, &frames[..2]), Err(MetricError::Frames { got: 2, .. })));
        assert!(matches!(flicker(&frames, &[]), Err(MetricError::Frames { got: 0, .. })));
        assert!(matches!(disocclusion(&before, &after, &[true]), Err(MetricError::Length { got: 1, .. })));
    }
}
