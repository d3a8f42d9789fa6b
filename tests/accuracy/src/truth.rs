//! Ground truths: the expected output of each slot, path-traced, with its standard error, and cached in files.
use crate::AccuracyError;
use crate::display::Display;
use crate::hash::short;
use crate::metrics::{Comparison, Picture};
use glam::DVec3;
use magpie::config::{Config, Value};
use magpie::gpu::Gpu;
use magpie::scene::{Camera, Scene};
use magpie_passes::reference::{Estimate, Only, PixelSampling, Reference, ReferenceOptions};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Samples between two saves of an unfinished ground truth.
const SAVE_EVERY: u64 = 64;
/// Samples between two reports of progress.
const STEP: u32 = 8;

/// The slots whose own image has a ground truth.
pub const TRUTHS: [(&str, Only); 5] = [
    ("shadows", Only::Shadows),
    ("ao", Only::AmbientOcclusion),
    ("direct", Only::Direct),
    ("gi", Only::Gi),
    ("reflections", Only::Reflections),
];

/// Slots whose own image is visibility or openness, 0 to 1, and 1 without output; those of other slots are radiance, and 0 without output.
pub const SHARES: [&str; 2] = ["shadows", "ao"];

/// Range of ambient occlusion, metres, in the ground truth of a configuration's `ao`: the configuration's own.
pub fn ao_range(config: &Config) -> f32 {
    match config.settings.get("ao").and_then(|settings| settings.get("range")) {
        Some(Value::Float(range)) => *range as f32,
        Some(Value::Integer(range)) => *range as f32,
        _ => ReferenceOptions::default().ao_range,
    }
}

/// The ground truth of a slot's own image, if it has one.
pub fn truth_of(slot: &str) -> Option<Only> {
    TRUTHS.iter().find(|(name, _)| *name == slot).map(|(_, only)| *only)
}

/// A source of ground truths. Tests replace it.
pub trait TruthSource {
    /// Identity of the ground truth: equal for equal scenes and cameras, independent of samples and seed.
    fn subject(&self, only: Only) -> String;

    /// Starts an estimate, or continues one.
    ///
    /// # Errors
    /// [`AccuracyError`].
    fn begin(&mut self, only: Only, from: Option<&Estimate>) -> Result<(), AccuracyError>;

    /// Adds samples per pixel to the current estimate.
    ///
    /// # Errors
    /// [`AccuracyError`].
    fn add(&mut self, samples: u32) -> Result<(), AccuracyError>;

    /// The current estimate.
    fn estimate(&self) -> Option<&Estimate>;
}

/// Magpie's own path tracer.
pub struct PathTracer<'a> {
    gpu: &'a Gpu,
    scene: &'a Scene,
    camera: &'a Camera,
    options: ReferenceOptions,
    begun: Option<(Only, Reference)>,
}

impl<'a> PathTracer<'a> {
    /// Samples at pixel centres, as the raster.
    pub fn new(gpu: &'a Gpu, scene: &'a Scene, camera: &'a Camera, options: ReferenceOptions) -> Self {
        Self { gpu, scene, camera, options: ReferenceOptions { pixel: PixelSampling::Centre, ..options }, begun: None }
    }

    /// Samples over the pixels' squares, as anti-aliasing approximates.
    pub fn over_pixels(gpu: &'a Gpu, scene: &'a Scene, camera: &'a Camera, options: ReferenceOptions) -> Self {
        Self { gpu, scene, camera, options: ReferenceOptions { pixel: PixelSampling::Area, ..options }, begun: None }
    }
}

impl TruthSource for PathTracer<'_> {
    fn subject(&self, only: Only) -> String {
        ReferenceOptions { only, ..self.options }.subject(self.scene, self.camera)
    }

    fn begin(&mut self, only: Only, from: Option<&Estimate>) -> Result<(), AccuracyError> {
        let failed = |source| AccuracyError::Reference { what: only.name(), source: Box::new(source) };
        let options = ReferenceOptions { only, ..self.options };
        let mut reference = Reference::new(self.gpu, self.scene, self.camera, options).map_err(failed)?;
        if let Some(from) = from {
            reference.resume(from).map_err(failed)?;
        }
        self.begun = Some((only, reference));
        Ok(())
    }

    fn add(&mut self, samples: u32) -> Result<(), AccuracyError> {
        let Some((only, reference)) = &mut self.begun else { return Ok(()) };
        let what = only.name();
        reference.add(samples).map_err(|source| AccuracyError::Reference { what, source: Box::new(source) })
    }

    fn estimate(&self) -> Option<&Estimate> {
        self.begun.as_ref().map(|(_, reference)| reference.estimate())
    }
}

/// Quality of a ground truth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TruthInfo {
    /// Name of the [`Only`]; with `_area` if averaged over pixels, with `_moving` for the moved camera.
    pub only: String,
    /// Hash of everything that it depends on: scene, camera, size, model, samples, seed.
    pub hash: String,
    /// Samples per pixel.
    pub samples: u64,
    /// Root mean square of its standard error, in the unit of the picture.
    pub standard_error: f64,
    /// Mean luminance, or mean visibility.
    pub mean: f64,
    /// Noise floor of every metric: the error between this ground truth and the same with normally distributed noise of its standard error.
    /// Smaller errors of a stage are indistinguishable from 0.
    pub floor: Comparison,
}

/// A ground truth.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// The mean of its samples.
    pub picture: Picture,
    /// Its quality.
    pub info: TruthInfo,
}

/// A folder of ground truths.
#[derive(Clone, Debug)]
pub struct TruthCache {
    folder: PathBuf,
    samples: u32,
    seed: u32,
}

impl TruthCache {
    /// Creates the folder if needed. Ground truths have `samples` samples per pixel, from this seed.
    ///
    /// # Errors
    /// [`AccuracyError::File`].
    pub fn new(folder: &Path, samples: u32, seed: u32) -> Result<Self, AccuracyError> {
        std::fs::create_dir_all(folder).map_err(AccuracyError::file(folder))?;
        Ok(Self { folder: folder.to_owned(), samples, seed })
    }

    /// Hash in the file name of a ground truth.
    pub fn hash(&self, source: &dyn TruthSource, only: Only) -> String {
        let version = concat!("magpie ", env!("CARGO_PKG_VERSION"));
        short(&[version, &source.subject(only), &self.samples.to_string(), &self.seed.to_string()])
    }

    /// Loads the ground truth, or traces it and saves it; an interrupted one is continued. `progress` is called with the number of samples,
    /// and returns whether to continue: tracing may stop early once there are some samples.
    ///
    /// # Errors
    /// [`AccuracyError`].
    pub fn get(
        &self,
        source: &mut dyn TruthSource,
        only: Only,
        display: &Display,
        progress: &mut dyn FnMut(u64) -> bool,
    ) -> Result<Truth, AccuracyError> {
        let (hash, subject) = (self.hash(source, only), source.subject(only));
        let path = self.folder.join(format!("{}-{hash}.exr", only.name()));
        let failed = |e| AccuracyError::Estimate(Box::new(e));
        let mut known = None;
        if path.exists() {
            known = Some(Estimate::load(&path, Some(&subject)).map_err(failed)?);
        }
        let wanted = u64::from(self.samples);
        let begun = known.as_ref().map_or(0, |e| e.samples);
        // At least one step is always traced: a standard error needs two samples.
        let mut goes_on = progress(begun.min(wanted)) || begun < u64::from(STEP);
        if begun < wanted && goes_on {
            source.begin(only, known.as_ref())?;
            let (mut have, mut saved) = (begun, begun);
            while have < wanted && goes_on {
                let step = STEP.min((wanted - have) as u32);
                source.add(step)?;
                have += u64::from(step);
                goes_on = progress(have);
                if have == wanted || !goes_on || have - saved >= SAVE_EVERY {
                    saved = have;
                    if let Some(estimate) = source.estimate() {
                        estimate.save(&path, &subject).map_err(failed)?;
                    }
                }
            }
            // Loaded from the file in any case, so that later runs get exactly the same numbers.
            known = Some(Estimate::load(&path, Some(&subject)).map_err(failed)?);
        }
        let estimate = known.unwrap_or_else(|| Estimate::new(1, 1));
        Truth::new(only.name(), hash, &estimate, display)
    }
}

impl Truth {
    /// A ground truth of that name from an estimate.
    ///
    /// # Errors
    /// [`AccuracyError::Metric`] if it is not finite.
    pub fn new(name: &str, hash: String, estimate: &Estimate, display: &Display) -> Result<Self, AccuracyError> {
        let (width, height) = (estimate.width as usize, estimate.height as usize);
        let pixel = |v: &DVec3| v.as_vec3().to_array();
        let picture = Picture { width, height, pixels: estimate.mean.iter().map(pixel).collect() };
        let errors = estimate.standard_error();
        let mean_square = errors.iter().map(|e| e.length_squared() / 3.0).sum::<f64>() / errors.len() as f64;
        let another = perturbed(&picture, &errors);
        let what = format!("truth of {name}");
        let floor = Comparison::displayed(&another, &picture, display).map_err(AccuracyError::metric(&what))?;
        let info = TruthInfo {
            only: name.to_owned(),
            hash,
            samples: estimate.samples,
            standard_error: mean_square.sqrt(),
            mean: picture.mean_luminance(),
            floor,
        };
        Ok(Self { picture, info })
    }
}

/// The picture with independent normal noise of these standard deviations, always the same.
fn perturbed(picture: &Picture, errors: &[DVec3]) -> Picture {
    let mut random = Normal(0x9e37_79b9_7f4a_7c15);
    let mut pixels = picture.pixels.clone();
    for (pixel, error) in pixels.iter_mut().zip(errors) {
        // The channels of a path are correlated.
        let deviation = random.next();
        for (x, e) in pixel.iter_mut().zip(error.to_array()) {
            *x += (deviation * e) as f32;
        }
    }
    Picture { pixels, ..*picture }
}

/// Normal deviates: SplitMix64 (Steele, Lea, Flood 2014), then the transform of Box and Muller 1958.
struct Normal(u64);

impl Normal {
    /// Uniform in (0, 1).
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 12) as f64 / (1_u64 << 52) as f64 + 0.5 / (1_u64 << 52) as f64
    }

    fn next(&mut self) -> f64 {
        let (u, v) = (self.uniform(), self.uniform());
        (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every sample is 1 in even pixels; in odd ones it alternates between 0 and 2.
    struct FixedTruth {
        estimate: Option<Estimate>,
        asked: u32,
    }

    impl TruthSource for FixedTruth {
        fn subject(&self, only: Only) -> String {
            format!("made up {}", only.name())
        }

        fn begin(&mut self, _: Only, from: Option<&Estimate>) -> Result<(), AccuracyError> {
            self.estimate = Some(from.cloned().unwrap_or_else(|| Estimate::new(8, 4)));
            Ok(())
        }

        fn add(&mut self, samples: u32) -> Result<(), AccuracyError> {
            self.asked += samples;
            let mut added = Estimate::new(8, 4);
            added.samples = u64::from(samples);
            added.mean = vec![DVec3::ONE; 32];
            added.squares = (0..32).map(|i| DVec3::splat(f64::from(i % 2) * f64::from(samples))).collect();
            self.estimate.as_mut().unwrap().merge(&added).unwrap();
            Ok(())
        }

        fn estimate(&self) -> Option<&Estimate> {
            self.estimate.as_ref()
        }
    }

    #[test]
    fn truths_are_kept_and_go_on_where_they_stopped() {
        let folder = tempfile::tempdir().unwrap();
        let cache = |samples| TruthCache::new(folder.path(), samples, 0).unwrap();
        let mut source = FixedTruth { estimate: None, asked: 0 };
        let mut reports = Vec::new();
        let all = &mut |_: u64| true;
        let show = &Display::PLAIN;
        let mut report = |n: u64| {
            reports.push(n);
            true
        };
        let first = cache(100).get(&mut source, Only::Gi, show, &mut report).unwrap();
        assert_eq!((source.asked, first.info.samples), (100, 100));
        assert_eq!((reports[0], *reports.last().unwrap()), (0, 100));
        let again = cache(100).get(&mut source, Only::Gi, show, all).unwrap();
        assert_eq!((source.asked, again.clone()), (100, first.clone()), "from the file");
        assert_ne!(cache(100).hash(&source, Only::Gi), cache(100).hash(&source, Only::All));
        assert_ne!(
            cache(100).hash(&source, Only::Gi),
            TruthCache::new(folder.path(), 100, 1).unwrap().hash(&source, Only::Gi)
        );

        // A file with fewer samples, as an interrupted run leaves it.
        let path = folder.path().join(format!("gi-{}.exr", first.info.hash));
        let mut part = FixedTruth { estimate: None, asked: 0 };
        part.begin(Only::Gi, None).unwrap();
        part.add(64).unwrap();
        part.estimate().unwrap().save(&path, "made up gi").unwrap();
        source.asked = 0;
        let resumed = cache(100).get(&mut source, Only::Gi, show, all).unwrap();
        assert_eq!((source.asked, resumed.info.samples), (36, 100));
        assert!((resumed.info.standard_error / first.info.standard_error - 1.0).abs() < 0.02);

        // Without remaining time the existing samples are used, or a minimum is traced.
        source.asked = 0;
        let hasty = cache(200).get(&mut source, Only::Gi, show, &mut |samples| samples < 20).unwrap();
        assert_eq!((source.asked, hasty.info.samples), (24, 24));
        let again = cache(200).get(&mut source, Only::Gi, show, &mut |_| false).unwrap();
        assert_eq!((source.asked, again), (24, hasty));
        let none = cache(200).get(&mut source, Only::Direct, show, &mut |_| false).unwrap();
        assert_eq!(none.info.samples, 8);
    }

    #[test]
    fn the_floor_is_what_the_standard_error_makes() {
        let folder = tempfile::tempdir().unwrap();
        let cache = TruthCache::new(folder.path(), 100, 0).unwrap();
        let mut source = FixedTruth { estimate: None, asked: 0 };
        let truth = cache.get(&mut source, Only::Gi, &Display::PLAIN, &mut |_| true).unwrap();
        // Half the pixels have a standard deviation of 1 over 100 samples, divided by n - 1.
        let wanted = (0.5_f64 / 99.0).sqrt();
        assert!((truth.info.standard_error - wanted).abs() < 1e-6, "{} {wanted}", truth.info.standard_error);
        assert!((truth.info.floor.rmse / wanted - 1.0).abs() < 0.5, "{} {wanted}", truth.info.floor.rmse);
        assert!(truth.info.floor.relmse > 0.0 && truth.info.floor.flip_hdr > 0.0);
    }

    #[test]
    fn deviates_are_normal() {
        let mut random = Normal(1);
        let values: Vec<f64> = (0..100_000).map(|_| random.next()).collect();
        let moment = |n: i32| values.iter().map(|v| v.powi(n)).sum::<f64>() / values.len() as f64;
        assert!(moment(1).abs() < 0.015 && (moment(2) - 1.0).abs() < 0.02 && (moment(4) - 3.0).abs() < 0.15);
    }
}
