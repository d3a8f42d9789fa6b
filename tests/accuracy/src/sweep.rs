//! A sweep: truths, then every configuration round after round, each result on the disk as soon as it is there.
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
use magpie_passes::reference::{Only, ReferenceOptions};
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::{Instant, SystemTime};

/// A part of a sweep, for one of several machines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Which, from 1.
    pub index: u32,
    /// Of how many.
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
    /// Whether the configuration at this place of the plan belongs to it.
    pub fn has(self, place: usize) -> bool {
        place as u64 % u64::from(self.count) == u64::from(self.index - 1)
    }
}

/// How to sweep.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Where results go.
    pub out: PathBuf,
    /// Where truths are kept; in a folder of `out` where nothing is said. Several runs may share one.
    pub truths: Option<PathBuf>,
    /// The slots; none for all.
    pub stages: Vec<String>,
    /// A smaller picture, fewer samples and frames.
    pub quick: bool,
    /// Width and height, pixels.
    pub size: Option<[u32; 2]>,
    /// Samples per pixel of the truths.
    pub samples: Option<u32>,
    /// The time that it may take, minutes. Configurations race for the fronts then, and it ends with what is known. None: each has all
    /// its rounds.
    pub minutes: Option<f64>,
    /// What the fronts, and the race for them, stand for.
    pub judge: Judge,
    /// The part to measure; none for all.
    pub shard: Option<Shard>,
    /// Seed of everything random.
    pub seed: u32,
    /// How rays are traced.
    pub rays: Rays,
    /// What the program was built from.
    pub commit: String,
}

/// How much there is of everything.
struct Extent {
    size: [u32; 2],
    samples: u32,
    /// The last two say how much an error changes from frame to frame.
    frames: [u32; 4],
    rounds: u32,
    timed: u32,
    moving: u32,
}

const QUICK: Extent = Extent { size: [160, 90], samples: 128, frames: [1, 8, 23, 24], rounds: 9, timed: 4, moving: 6 };
const FULL: Extent =
    Extent { size: [640, 360], samples: 1024, frames: [1, 8, 63, 64], rounds: 9, timed: 16, moving: 16 };

/// Minutes that a quick sweep takes at most, where nothing else is said.
pub const QUICK_MINUTES: f64 = 10.0;

/// Seconds of scene time from frame to frame.
const TIME_STEP: f64 = 1.0 / 60.0;

/// How far a sweep is.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Progress {
    /// Units of work that are done.
    pub done: u64,
    /// All of them.
    pub all: u64,
    /// Units that were done before, by an earlier run.
    pub skipped: u64,
    /// What is being done.
    pub what: String,
    /// Of what `all` is a number.
    pub unit: &'static str,
}

impl fmt::Display for Progress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} of {}: {}", self.done, self.all, self.what)
    }
}

/// What is swept.
pub struct Subject<'a> {
    /// The device.
    pub gpu: &'a Gpu,
    /// The scene, with all that it lacked supplied.
    pub scene: &'a Scene,
    /// From where it is seen.
    pub camera: &'a Camera,
    /// The implementations.
    pub slots: &'a Slots,
    /// What is measured around.
    pub config: &'a Config,
}

/// Sweeps, and gives all that the folder then holds. What is there already is not measured again.
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
    // Frames before the moment that is measured have moments of their own, from 0.
    let time = if moves { f64::from(extent.frames[3] - 1) * TIME_STEP } else { 0.0 };
    let reference = ReferenceOptions {
        width: size[0],
        height: size[1],
        seed: options.seed,
        ao_range: ao_range(config),
        time,
        rays: options.rays,
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

    // The camera has moved by one step in the first frame after those at rest.
    let ways: Vec<Camera> = around(camera, run.moving_frames + 1).split_off(1);
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
        // What is measured stands against the truths as they were.
        is_frozen: run.minutes.is_some() && !results.measurements.is_empty(),
    };
    let truths = finder.find(&wanted, &mut at, progress)?;
    drop(finder);

    let mut bench = Bench::new(gpu, scene, camera, options.rays, slots);
    bench.go(ways);
    let mut on_device = OnDevice { bench, run: &run, truths: &truths, out: &options.out, terms: None, start };
    course::run(&run, &setups, &truths, &mut results, &mut on_device, &mut at, progress)?;
    Folder::read(&options.out)
}

/// Measures on the device, and leaves pictures in the folder.
struct OnDevice<'a> {
    bench: Bench<'a>,
    run: &'a Run,
    truths: &'a BTreeMap<String, Truth>,
    out: &'a Path,
    /// Of the default, once it has been measured.
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

/// Pictures of a configuration for the report.
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
            continue; // a term of the picture
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

/// Name of a picture of a slot, or of the whole picture under the empty name.
pub fn image_name(setup: &str, slot: &str, what: &str) -> String {
    let slot = if slot.is_empty() { "picture" } else { slot };
    format!("{setup}.{slot}.{what}")
}

/// `2026-01-31 12:34 UTC` of a time after 1970, by the days-to-civil algorithm (Hinnant 2013, "chrono-Compatible Low-Level Date
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
