//! Predicts the picture of several choices together from the pictures of each choice alone.
//!
//! A frame is a sum of terms: direct light, indirect light, reflections, and the rest (the background sky, rounding to 16 bits). Every
//! rendered configuration has stored those of its terms that differ from the default's. A combination is composed term by term, and the
//! changes of slots that act on the whole picture (anti-aliasing, upsampling) are added to the sum. Within a term, per pixel, with `b` the
//! default's value and `x_i` the value of choice `i` alone:
//!
//! ```text
//! (b + sum of max(x_i - b, 0)) * product of min(x_i / b, 1)
//! ```
//!
//! Choices that darken multiply, and choices that brighten add. That is exact where one choice alone changes the term, and where one scales
//! the result of another, as ambient occlusion scales sky light and `off` scales it to 0. Elsewhere it is a first-order approximation, as
//! where a pixel is lit by several lights with a shadow each. The change by anti-aliasing is that of the default picture, so edges that
//! another choice adds or removes are not anti-aliased.
use crate::AccuracyError;
use crate::display::Display;
use crate::metric::Metric;
use crate::metrics::{MetricError, Picture};
use crate::pictures::{read_exr, write_exr};
use std::collections::BTreeMap;
use std::path::Path;

/// The slots whose images add up to the picture.
pub const TERMS: [&str; 3] = ["direct", "gi", "reflections"];
/// The remaining term: the picture minus [`TERMS`].
const REST: &str = "rest";
/// Files of the ground truth of the picture: averaged over pixels where `post` was measured, else at pixel centres.
pub const TRUTH_PICTURES: [&str; 2] = ["truth.all_area.exr", "truth.all.exr"];

/// What a configuration changes: the terms that differ from the default's, or the whole picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Parts {
    /// [`TERMS`] and the rest; none where equal to the default's.
    terms: [Option<Picture>; 4],
    /// The picture, for a configuration that is not split into terms.
    whole: Option<Picture>,
}

impl Parts {
    /// For a configuration that is not split into terms.
    #[cfg(test)]
    pub(crate) fn of_whole(picture: Picture) -> Self {
        Self { whole: Some(picture), ..Self::default() }
    }
}

/// Splits a picture into its terms: the given images and the rest.
///
/// None if the images have another size than the picture (upsampling).
pub fn split(picture: &Picture, terms: &BTreeMap<String, Picture>) -> Option<[Picture; 4]> {
    let fits = |p: &&Picture| (p.width, p.height) == (picture.width, picture.height);
    let [direct, gi, reflections] = TERMS.map(|name| terms.get(name).filter(fits).cloned());
    let (direct, gi, reflections) = (direct?, gi?, reflections?);
    let mut rest = picture.clone();
    for term in [&direct, &gi, &reflections] {
        rest.pixels.iter_mut().zip(&term.pixels).for_each(|(r, t)| (0..3).for_each(|c| r[c] -= t[c]));
    }
    Some([direct, gi, reflections, rest])
}

/// File name of a term of a configuration.
fn term_file(setup: &str, term: usize) -> String {
    format!("{setup}.term.{}.exr", TERMS.get(term).unwrap_or(&REST))
}

/// Writes those terms of a configuration that differ from the default's to a folder.
///
/// # Errors
/// [`AccuracyError::Image`].
pub fn write_terms(
    folder: &Path,
    setup: &str,
    terms: &[Picture; 4],
    default: Option<&[Picture; 4]>,
) -> Result<(), AccuracyError> {
    for (at, term) in terms.iter().enumerate() {
        if default.is_none_or(|default| !alike(&default[at], term)) {
            write_exr(&folder.join(term_file(setup, at)), term)?;
        }
    }
    Ok(())
}

/// Equal but for rounding of sums.
fn alike(a: &Picture, b: &Picture) -> bool {
    let near = |(a, b): (&f32, &f32)| (a - b).abs() <= 1e-5 * (a.abs() + b.abs()) + 1e-6;
    a.pixels.len() == b.pixels.len() && a.pixels.iter().flatten().zip(b.pixels.iter().flatten()).all(near)
}

/// Reads all terms of the default; none if a file is missing.
pub fn read_terms(folder: &Path, setup: &str) -> Option<[Picture; 4]> {
    let read = |at: usize| read_exr(&folder.join(term_file(setup, at))).ok();
    Some([read(0)?, read(1)?, read(2)?, read(3)?])
}

/// Composes pictures and measures their error against the ground truth.
#[derive(Clone, Debug)]
pub struct Composer {
    truth: Picture,
    display: Display,
    /// Terms of the default.
    terms: Option<[Picture; 4]>,
    picture: Picture,
    /// Changes by id of the configuration, the default excluded.
    parts: BTreeMap<String, Parts>,
}

impl Composer {
    /// From the ground truth, the default's picture and terms, and the changes of every other configuration.
    pub fn new(
        truth: Picture,
        display: Display,
        picture: Picture,
        terms: Option<[Picture; 4]>,
        parts: BTreeMap<String, Parts>,
    ) -> Self {
        Self { truth, display, terms, picture, parts }
    }

    /// Reads the pictures of a folder: the default's, and those of other configurations as far as they exist. `None` if the default's or
    /// the ground truth are missing. `setups` also says which configurations are not split into terms.
    ///
    /// # Errors
    /// [`AccuracyError::Image`].
    pub fn read<'a>(
        folder: &Path,
        display: Display,
        default: &str,
        setups: impl Iterator<Item = (&'a str, bool)>,
    ) -> Result<Option<Self>, AccuracyError> {
        let picture = folder.join(format!("{default}.exr"));
        let truth = TRUTH_PICTURES.iter().map(|name| folder.join(name)).find(|path| path.exists());
        let Some(truth) = truth.filter(|_| picture.exists()) else { return Ok(None) };
        let terms = read_terms(folder, default);
        let mut parts = BTreeMap::new();
        for (id, is_whole) in setups.filter(|(id, _)| *id != default) {
            let path = folder.join(format!("{id}.exr"));
            if !path.exists() {
                continue;
            }
            let mut part = Parts::default();
            for (at, term) in part.terms.iter_mut().enumerate() {
                let path = folder.join(term_file(id, at));
                *term = path.exists().then(|| read_exr(&path)).transpose()?;
            }
            if is_whole || terms.is_none() || part.terms.iter().all(Option::is_none) {
                part = Parts { whole: Some(read_exr(&path)?), ..Parts::default() };
            }
            parts.insert(id.to_owned(), part);
        }
        Ok(Some(Self::new(read_exr(&truth)?, display, read_exr(&picture)?, terms, parts)))
    }

    /// Whether this configuration has a picture here, or is the default.
    pub fn knows(&self, setup: &str, default: &str) -> bool {
        setup == default || self.parts.contains_key(setup)
    }

    /// The ground truth.
    pub fn truth(&self) -> &Picture {
        &self.truth
    }

    /// The same with pictures of at most this width, downsampled by a box filter: faster to search with.
    #[must_use]
    pub fn at_most(&self, width: usize) -> Self {
        let by = self.truth.width.div_ceil(width);
        if by < 2 {
            return self.clone();
        }
        let small = |p: &Picture| smaller(p, by);
        let parts = |parts: &Parts| Parts {
            terms: parts.terms.each_ref().map(|t| t.as_ref().map(small)),
            whole: parts.whole.as_ref().map(small),
        };
        Self {
            truth: small(&self.truth),
            display: self.display,
            terms: self.terms.as_ref().map(|terms| terms.each_ref().map(small)),
            picture: small(&self.picture),
            parts: self.parts.iter().map(|(id, p)| (id.clone(), parts(p))).collect(),
        }
    }

    /// The predicted picture of these configurations combined. Unknown ones, and the default, change nothing.
    pub fn compose<'a>(&self, setups: impl IntoIterator<Item = &'a str>) -> Picture {
        let chosen: Vec<&Parts> = setups.into_iter().filter_map(|id| self.parts.get(id)).collect();
        let mut sum = self.picture.clone();
        if let Some(terms) = &self.terms {
            for (at, base) in terms.iter().enumerate() {
                let changes: Vec<&Picture> = chosen.iter().filter_map(|p| p.terms[at].as_ref()).collect();
                if changes.is_empty() {
                    continue;
                }
                let changed = together(base, &changes);
                for ((s, new), old) in sum.pixels.iter_mut().zip(&changed.pixels).zip(&base.pixels) {
                    (0..3).for_each(|c| s[c] += new[c] - old[c]);
                }
            }
        }
        for whole in chosen.iter().filter_map(|p| p.whole.as_ref()) {
            let changed = whole.pixels.iter().zip(&self.picture.pixels);
            for (s, (new, old)) in sum.pixels.iter_mut().zip(changed) {
                // Radiance stays positive where edges that only the default has are darkened.
                (0..3).for_each(|c| s[c] = (s[c] + new[c] - old[c]).max(s[c].min(0.0)));
            }
        }
        sum
    }

    /// The error of that picture.
    ///
    /// # Errors
    /// [`MetricError`] where pictures are not of one size or not finite.
    pub fn error<'a>(&self, metric: Metric, setups: impl IntoIterator<Item = &'a str>) -> Result<f64, MetricError> {
        metric.measure(&self.compose(setups), &self.truth, &self.display)
    }
}

/// Combined value of several changes to a term.
fn together(base: &Picture, changes: &[&Picture]) -> Picture {
    if let [only] = changes {
        return (*only).clone();
    }
    let mut result = base.clone();
    for (at, pixel) in result.pixels.iter_mut().enumerate() {
        for (c, value) in pixel.iter_mut().enumerate() {
            let b = *value;
            let (mut added, mut left) = (0.0, 1.0);
            for x in changes.iter().map(|p| p.pixels[at][c]) {
                // Negative values, from the rounding in the rest, are only added.
                if x < b && x >= 0.0 {
                    left *= x / b;
                } else {
                    added += x - b;
                }
            }
            *value = (b + added) * left;
        }
    }
    result
}

/// Downsampled by a box filter; boxes at the right and lower border are cut.
fn smaller(picture: &Picture, by: usize) -> Picture {
    let (width, height) = (picture.width.div_ceil(by), picture.height.div_ceil(by));
    let mut pixels = Vec::with_capacity(width * height);
    for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
        let (mut sum, mut count) = ([0.0_f32; 3], 0.0);
        for row in y * by..((y + 1) * by).min(picture.height) {
            for column in x * by..((x + 1) * by).min(picture.width) {
                let pixel = picture.pixels[row * picture.width + column];
                (0..3).for_each(|c| sum[c] += pixel[c]);
                count += 1.0;
            }
        }
        pixels.push(sum.map(|s| s / count));
    }
    Picture { width, height, pixels }
}

#[cfg(test)]
mod tests;
