//! The picture that several choices make together, from the pictures that each made alone.
//!
//! A frame is a sum: direct light, indirect light, reflections, and the rest (the sky behind things, what 16 bits round off). Every
//! configuration that was rendered left those of its terms that differ from the default's. A combination is composed term by term, as
//! the frame does, and what a whole picture goes through afterwards (anti-aliasing, upsampling) is laid over the sum. Within a term,
//! pixel by pixel, with `b` the default's value and `x_i` what each choice alone made of it:
//!
//! ```text
//! (b + sum of max(x_i - b, 0)) * product of min(x_i / b, 1)
//! ```
//!
//! What takes light away takes its share of whatever else is there, and what adds light adds. That is exact where one choice alone
//! changes the term; where one choice scales what another gives, as ambient occlusion scales the light of the sky and `off` scales it
//! to 0; and it is of first order elsewhere, as where a pixel has the light of several lamps and shadows of each. Anti-aliasing is
//! linear but for what it makes of motion: its change of the default picture is added, so that all edges of the default are smoothed, and
//! those that another choice brings or takes are not.
use crate::AccuracyError;
use crate::display::Display;
use crate::metric::Metric;
use crate::metrics::{MetricError, Picture};
use crate::pictures::{read_exr, write_exr};
use std::collections::BTreeMap;
use std::path::Path;

/// The slots whose images add up to the picture.
pub const TERMS: [&str; 3] = ["direct", "gi", "reflections"];
/// The rest of the picture.
const REST: &str = "rest";
/// The picture of truth, over the squares of pixels where `post` was measured.
pub const TRUTH_PICTURES: [&str; 2] = ["truth.all_area.exr", "truth.all.exr"];

/// What a configuration made: its picture, and those of its terms that are not the default's.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Parts {
    /// The terms, [`TERMS`] and the rest; none where they are as in the default.
    terms: [Option<Picture>; 4],
    /// The picture, of a configuration that is not taken apart.
    whole: Option<Picture>,
}

impl Parts {
    /// Of a configuration that is not taken apart.
    #[cfg(test)]
    pub(crate) fn of_whole(picture: Picture) -> Self {
        Self { whole: Some(picture), ..Self::default() }
    }
}

/// Takes a picture apart: its terms as they were read, and the rest.
///
/// A frame of other pixels than the picture's own (upsampling) has no terms.
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

/// File of a term of a configuration.
fn term_file(setup: &str, term: usize) -> String {
    format!("{setup}.term.{}.exr", TERMS.get(term).unwrap_or(&REST))
}

/// Leaves the terms of a configuration in a folder, those that differ from the default's.
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

/// The same but for how sums were rounded.
fn alike(a: &Picture, b: &Picture) -> bool {
    let near = |(a, b): (&f32, &f32)| (a - b).abs() <= 1e-5 * (a.abs() + b.abs()) + 1e-6;
    a.pixels.len() == b.pixels.len() && a.pixels.iter().flatten().zip(b.pixels.iter().flatten()).all(near)
}

/// Reads all terms of the default.
pub fn read_terms(folder: &Path, setup: &str) -> Option<[Picture; 4]> {
    let read = |at: usize| read_exr(&folder.join(term_file(setup, at))).ok();
    Some([read(0)?, read(1)?, read(2)?, read(3)?])
}

/// Composes pictures and says how far they are from the truth.
#[derive(Clone, Debug)]
pub struct Composer {
    truth: Picture,
    display: Display,
    /// Of the default.
    terms: Option<[Picture; 4]>,
    picture: Picture,
    /// By id, without the default.
    parts: BTreeMap<String, Parts>,
}

impl Composer {
    /// From the truth, the default's picture and terms, and what every other configuration made.
    pub fn new(
        truth: Picture,
        display: Display,
        (picture, terms): (Picture, Option<[Picture; 4]>),
        parts: BTreeMap<String, Parts>,
    ) -> Self {
        Self { truth, display, terms, picture, parts }
    }

    /// From the pictures of a folder: of the default, and of those configurations that have theirs there. `None` where those of the
    /// default or the truth are missing. `whole` says which configurations are not taken apart.
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
        Ok(Some(Self::new(read_exr(&truth)?, display, (read_exr(&picture)?, terms), parts)))
    }

    /// Whether this configuration has left a picture, or is the default.
    pub fn knows(&self, setup: &str, default: &str) -> bool {
        setup == default || self.parts.contains_key(setup)
    }

    /// What is looked for.
    pub fn truth(&self) -> &Picture {
        &self.truth
    }

    /// The same with pictures that are no wider than this, each pixel the mean of a square of them: cheaper, for searching.
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

    /// The picture with the changes of these configurations together; those that are not known, and the default, change nothing.
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
                // Light stays light where a dark edge of the default meets what has become darker than it.
                (0..3).for_each(|c| s[c] = (s[c] + new[c] - old[c]).max(s[c].min(0.0)));
            }
        }
        sum
    }

    /// How far that picture is from the truth.
    ///
    /// # Errors
    /// [`MetricError`] where pictures are not of one size or not finite.
    pub fn error<'a>(&self, metric: Metric, setups: impl IntoIterator<Item = &'a str>) -> Result<f64, MetricError> {
        metric.measure(&self.compose(setups), &self.truth, &self.display)
    }
}

/// What several changes of a term make together.
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
                // What is not light, as the rest of a sum that was rounded, only adds.
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

/// Each pixel the mean of a square of pixels, those at the right and at the bottom of what is there of theirs.
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
