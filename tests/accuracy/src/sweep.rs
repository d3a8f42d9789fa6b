//! A sweep: ground truths first, then every configuration round by round. Each result is written immediately.
mod course;
mod truths;

use crate::AccuracyError;
use crate::compose::{read_terms, split, write_terms};
use crate::display::Display;
use crate::measure::{AREA, Bench, Images};
use crate::metric::Judge;
use crate::metrics::Picture;
use crate::pictures;
use crate::plan::{Plan, Setup};
use crate::results::{DeviceName, Folder, IMAGES, Measurement, Results, Run, TRUTHS};
use crate::truth::{PathTracer, SHARES, Truth, TruthCache, TruthSource, ao_range};
use magpie::config::Config;
use magpie::gpu::Gpu;
use magpie::prelude::Rays;
use magpie::scene::{Camera, Scene};
use magpie_bench::motion::around;
use magpie_passes::Slots;
use magpie_passes::reference::{Only, ReferenceOptions, single_scattering};
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::{Instant, SystemTime};

/// A part of a sweep, for one of several machines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Index of the part, from 1.
    pub index: u32,
    /// Number of parts.
    pub count: u32,
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        match numbers {
            Some((index, count)) if 1 <= index && index <= count => Ok(Self { index, count }),
            _ => Err("wanted I/N with I from 1 to N, such as 2/8".to_owned()),
        }
    }
}

impl Shard {
    /// Whether the configuration with this index in the plan belongs to it.
    pub fn has(self, place: usize) -> bool {
        place as u64 % u64::from(self.count) == u64::from(self.index - 1)
    }
}

/// Options of a sweep.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Folder of results.
    pub out: PathBuf,
    /// Folder of ground truths, by default one in `out`. Several runs may share one.
    pub truths: Option<PathBuf>,
    /// Slots to measure; empty for all.
    pub stages: Vec<String>,
    /// Use a smaller picture, fewer samples and frames by default.
    pub quick: bool,
    /// Width and height, pixels; none for the default.
    pub size: Option<[u32; 2]>,
    /// Samples per pixel of the ground truths; none for the default.
    pub samples: Option<u32>,
    /// Time limit, minutes: configurations then race for the fronts, and the sweep ends with what it knows. None: each runs all its rounds.
    pub minutes: Option<f64>,
    /// Metric and image that fronts, and the race for them, are about.
    pub judge: Judge,
    /// The part to measure; none for all.
    pub shard: Option<Shard>,
    /// Seed of everything random.
    pub seed: u32,
    /// Backend for rays.
    pub rays: Rays,
    /// Commit of the build.
    pub commit: String,
}

/// Default amounts of everything.
struct Extent {
    size: [u32; 2],
    samples: u32,
    /// The last two measure how much an error changes from frame to frame.
    frames: [u32; 4],
    rounds: u32,
    timed: u32,
    moving: u32,
}

const QUICK: Extent = Extent { size: [160, 90], samples: 128, frames: [1, 8, 23, 24], rounds: 9, timed: 4, moving: 6 };
const FULL: Extent =
    Extent { size: [640, 360], samples: 1024, frames: [1, 8, 63, 64], rounds: 9, timed: 16, moving: 16 };

/// Default time limit of a quick sweep, minutes.
pub const QUICK_MINUTES: f64 = 10.0;

/// Scene time per frame, seconds.
const TIME_STEP: f64 = 1.0 / 60.0;

/// Progress of a sweep.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Progress {
    /// Units of work done.
    pub done: u64,
    /// Units of work in total.
    pub all: u64,
    /// Units of work done by an earlier run.
    pub skipped: u64,
    /// Current activity.
    pub what: String,
    /// Name of the unit.
    pub unit: &'static str,
}

impl fmt::Display for Progress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} of {}: {}", self.done, self.all, self.what)
    }
}

/// Scene and program to sweep.
pub struct Subject<'a> {
    /// The device.
    pub gpu: &'a Gpu,
    /// The scene, including supplied camera and lights.
    pub scene: &'a Scene,
    /// The camera.
    pub camera: &'a Camera,
    /// The implementations.
    pub slots: &'a Slots,
    /// The base configuration.
    pub config: &'a Config,
}

/// Runs a sweep and returns the contents of the folder. Existing results are not measured again.
///
/// # Errors
/// [`AccuracyError`].
pub fn sweep(
    subject: &Subject<'_>,
    options: &Options,
    progress: &mut dyn FnMut(&Progress),
) -> Result<Folder, AccuracyError> {
    let start = Instant::now();
    let Subject { gpu, scene, camera, slots, config } = *subject;
    let extent = if options.quick { QUICK } else { FULL };
    let size = options.size.unwrap_or(extent.size);
    let frames = extent.frames.to_vec();
    let moves = !scene.animations.is_empty();
    let plan = Plan::new(&slots.catalogue(), config, &options.stages, moves)?;
    // The frames before the measured time start at time 0.
    let time = if moves { f64::from(extent.frames[3] - 1) * TIME_STEP } else { 0.0 };
    let reference = ReferenceOptions {
        width: size[0],
        height: size[1],
        seed: options.seed,
        ao_range: ao_range(config),
        time,
        rays: options.rays,
        single_scattering: single_scattering(config),
        ..ReferenceOptions::default()
    };
    let report = gpu.report();
    let turns = plan.setups.iter().any(|s| s.turns);
    let mut run = Run {
        magpie: env!("CARGO_PKG_VERSION").to_owned(),
        commit: options.commit.clone(),
        date: date(SystemTime::now()),
        device: DeviceName { name: report.name.clone(), driver: report.driver.clone(), kind: report.kind.to_owned() },
        rays: options.rays.name().to_owned(),
        scene: scene.name.clone(),
        subject: PathTracer::new(gpu, scene, camera, reference).subject(Only::All),
        size,
        samples: options.samples.unwrap_or(extent.samples),
        frames,
        rounds: extent.rounds,
        timed: extent.timed,
        seed: options.seed,
        time_step: TIME_STEP,
        time,
        minutes: options.minutes,
        moving_frames: if turns { extent.moving } else { 0 },
        judge: options.judge,
        plan,
    };
    let mut results = Results::open(&options.out, &mut run)?;
    let mine = |place: usize| options.shard.is_none_or(|shard| shard.has(place));
    let setups: Vec<&Setup> = run.plan.setups.iter().enumerate().filter(|(at, _)| mine(*at)).map(|(_, s)| s).collect();

    // The first frame after those at rest has moved by one step.
    let ways: Vec<Camera> = around(scene, camera, run.moving_frames + 1).split_off(1);
    let place = ways.last().unwrap_or(camera);
    let wanted = truths::wanted(&setups, run.moving_frames > 0);
    let units = course::Units::of(&run, &setups, wanted.len());
    let mut at = Progress { all: units.all, unit: units.name, ..Progress::default() };
    let mut finder = truths::Finder {
        cache: TruthCache::new(options.truths.as_deref().unwrap_or(&options.out.join(TRUTHS)), run.samples, run.seed)?,
        tracers: [
            PathTracer::new(gpu, scene, camera, reference),
            PathTracer::over_pixels(gpu, scene, camera, reference),
            PathTracer::new(gpu, scene, place, reference),
            PathTracer::over_pixels(gpu, scene, place, reference),
        ],
        run: &run,
        display: Display::of(config),
        out: &options.out,
        start,
        // Once measurements exist, the ground truths they were compared with must not change.
        is_frozen: run.minutes.is_some() && !results.measurements.is_empty(),
    };
    let truths = finder.find(&wanted, &mut at, progress)?;
    drop(finder);

    let mut bench = Bench::new(gpu, scene, camera, options.rays, slots);
    bench.set_cameras(ways);
    let mut on_device = OnDevice { bench, run: &run, truths: &truths, out: &options.out, terms: None, start };
    course::run(&run, &setups, &truths, &mut results, &mut on_device, &mut at, progress)?;
    Folder::read(&options.out)
}

/// Measures on the device, and writes pictures to the folder.
struct OnDevice<'a> {
    bench: Bench<'a>,
    run: &'a Run,
    truths: &'a BTreeMap<String, Truth>,
    out: &'a Path,
    /// Terms of the default, once it has been measured.
    terms: Option<[Picture; 4]>,
    start: Instant,
}

impl course::Measures for OnDevice<'_> {
    fn measure(&mut self, setup: &Setup, round: u32) -> Result<Measurement, AccuracyError> {
        let (measurement, images) = self.bench.measure(setup, round, self.run, self.truths)?;
        if let Some(images) = images {
            let folder = self.out.join(IMAGES);
            write_images(&folder, setup, &images, self.truths)?;
            let default = self.run.plan.default_setup().map_or("", |s| s.id.as_str());
            if self.terms.is_none() {
                self.terms = read_terms(&folder, default);
            }
            if let Some(terms) = split(&images.picture, &images.slots).filter(|_| !setup.is_whole() && !setup.moving) {
                write_terms(&folder, &setup.id, &terms, self.terms.as_ref().filter(|_| setup.id != default))?;
            }
        }
        Ok(measurement)
    }

    fn seconds(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }
}

/// Writes the pictures of a configuration for the report.
fn write_images(
    folder: &Path,
    setup: &Setup,
    images: &Images,
    truths: &BTreeMap<String, Truth>,
) -> Result<(), AccuracyError> {
    pictures::write_exr(&folder.join(format!("{}.exr", setup.id)), &images.picture)?;
    let all = images.slots.iter().map(|(slot, picture)| (slot.as_str(), picture)).chain([("", &images.picture)]);
    for (slot, picture) in all {
        if !slot.is_empty() && !setup.slots.iter().any(|s| s == slot) {
            continue; // it is only needed as a term of the picture
        }
        let key = if slot.is_empty() && setup.is_whole() { AREA } else { slot };
        let Some(truth) = truths.get(key) else { continue };
        let display = if SHARES.contains(&slot) { Display::PLAIN } else { Display::of(&setup.config) };
        let name = |what: &str| folder.join(image_name(&setup.id, slot, what));
        pictures::write_shown(&name("png"), picture, &display)?;
        pictures::write_flip(&name("flip.png"), picture, &truth.picture, &display)?;
    }
    Ok(())
}

/// File name of a picture of a slot; `slot` is empty for the whole picture.
pub fn image_name(setup: &str, slot: &str, what: &str) -> String {
    let slot = if slot.is_empty() { "picture" } else { slot };
    format!("{setup}.{slot}.{what}")
}

/// Formats a time after 1970 as `2026-01-31 12:34 UTC`, by the days-to-civil algorithm (Hinnant 2013, "chrono-Compatible Low-Level Date
/// Algorithms").
fn date(time: SystemTime) -> String {
    let seconds = time.duration_since(SystemTime::UNIX_EPOCH).map_or(0, |d| d.as_secs()) as i64;
    let (days, minutes) = (seconds / 86_400 + 719_468, seconds % 86_400 / 60);
    let era = days / 146_097;
    let day_of_era = days % 146_097;
    let year_of_era = (day_of_era - day_of_era / 1_460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * shifted + 2) / 5 + 1;
    let month = if shifted < 10 { shifted + 3 } else { shifted - 9 };
    let year = year_of_era + era * 400 + i64::from(month <= 2);
    format!("{year:04}-{month:02}-{day:02} {:02}:{:02} UTC", minutes / 60, minutes % 60)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn dates_are_those_of_the_calendar() {
        let at = |seconds: u64| date(SystemTime::UNIX_EPOCH + Duration::from_secs(seconds));
        assert_eq!(at(0), "1970-01-01 00:00 UTC");
        assert_eq!(at(951_827_640), "2000-02-29 12:34 UTC");
        assert_eq!(at(1_798_761_599), "2026-12-31 23:59 UTC");
    }

    #[test]
    fn shards_share_everything_and_nothing_twice() {
        let shards: Vec<Shard> = (1..=3).map(|index| Shard { index, count: 3 }).collect();
        for place in 0..20 {
            assert_eq!(shards.iter().filter(|s| s.has(place)).count(), 1, "{place}");
        }
        assert_eq!("2/8".parse(), Ok(Shard { index: 2, count: 8 }));
        for bad in ["", "2", "0/8", "9/8", "1/0", "a/b", "1/2/3", "-1/2"] {
            assert!(bad.parse::<Shard>().is_err(), "{bad}");
        }
    }
}
