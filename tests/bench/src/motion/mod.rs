//! Effects in motion, `magpie bench motion`: error of each frame against that frame's ground truth, for raw rays and for each denoiser.
mod contestants;
mod course;
mod paths;
mod report;

pub use contestants::{CONTESTANTS, Contestant};
pub use course::{Cost, Course};
pub use paths::{Moment, Path, Turned, around, paths, paths_of_light, stand};
pub use report::MotionReport;

use crate::FrameBenchError;
use contestants::{DIRECT, GI, config};
use magpie::config::Config;
use magpie::gpu::Gpu;
use magpie::prelude::{Extent, Rays};
use magpie::scene::Scene;
use magpie_passes::{FrameRequest, FrameResult, RenderOptions, Renderer, Slots};

/// Frames of eight rays per pixel that a ground truth is the mean of.
const TRUTH_FRAMES: u32 = 16;
/// The same of diffuse indirect light, whose paths make more noise.
const GI_TRUTH_FRAMES: u32 = 32;
/// The same for pictures, over whose pixels anti-aliasing averages: as many as its jitter has places.
const PICTURE_TRUTH_FRAMES: u32 = 48;
/// Of the pictures before and after a lasting change of light, so many times more.
const LASTING: u32 = 8;
/// Frames at rest before the motion: more than the longest default history.
pub const WARM_UP: u32 = 40;

/// Options of `magpie bench motion`.
#[derive(Clone, Debug)]
pub struct MotionOptions {
    /// Name of the slot: `gi`, `direct`, or one with a denoiser.
    pub slot: String,
    /// Compares the picture at the end of the frame in place of the slot's image.
    pub picture: bool,
    /// Labels of the contestants that take part, and names of paths; empty for all.
    pub only: Vec<String>,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Frames per path.
    pub frames: u32,
    /// Backend for rays.
    pub rays: Rays,
    /// Seed of everything random.
    pub seed: u32,
    /// Runs of each contestant on each path, each with the next seed.
    pub seeds: u32,
    /// Name of the thing that path `door` moves, or a part of it, in any case.
    pub door: String,
    /// Configuration of everything else.
    pub config: Config,
    /// Commit of the build, for the report.
    pub commit: String,
}

impl Default for MotionOptions {
    fn default() -> Self {
        Self {
            slot: "shadows".to_owned(),
            picture: false,
            only: Vec::new(),
            size: [160, 90],
            frames: 24,
            rays: Rays::Software,
            seed: 0,
            seeds: 1,
            door: "door".to_owned(),
            config: Config::default(),
            commit: String::new(),
        }
    }
}

impl MotionOptions {
    /// Whether what is compared is light, without a greatest value, and no share.
    #[must_use]
    pub fn is_radiance(&self) -> bool {
        self.picture || matches!(self.slot.as_str(), "reflections" | GI | DIRECT)
    }

    /// Whether `name` takes part: it is wanted, or none of the `names` of its kind is.
    fn takes(&self, names: &[&str], name: &str) -> bool {
        let is_wanted = |name: &str| self.only.iter().any(|only| only == name);
        is_wanted(name) || !names.iter().any(|name| is_wanted(name))
    }
}

/// What is compared: an image of the slot, or the picture.
#[derive(Clone, Debug)]
pub struct Seen {
    /// Width and height, pixels.
    pub size: Extent,
    /// Number of channels in use.
    pub channels: usize,
    /// Linear values.
    pub pixels: Vec<[f32; 4]>,
}

impl Seen {
    /// As colours: the first three channels, or grey.
    #[must_use]
    pub fn colours(&self) -> Vec<[f32; 3]> {
        let colour = |v: &[f32; 4]| if self.channels == 1 { [v[0]; 3] } else { [v[0], v[1], v[2]] };
        self.pixels.iter().map(colour).collect()
    }
}

/// A frame of a contestant on a path.
#[derive(Clone, Copy, Debug)]
pub struct Place<'a> {
    /// Name of the path.
    pub path: &'a str,
    /// Label of the contestant.
    pub label: &'a str,
    /// Number of the frame, from 1.
    pub frame: usize,
    /// Number of the run, from 0.
    pub run: u32,
}

/// Perceived difference of what is seen from the truth, 0 to 1, or why it cannot be told.
pub type Perceived<'a> = &'a dyn Fn(Place<'_>, &Seen, &Seen) -> Result<f64, String>;

/// Values of all pixels and channels of an image, as they are compared.
type Values = Vec<f64>;

/// A renderer of which one slot's image, or the picture, is read back.
struct Bench {
    renderer: Renderer,
    slot: String,
    /// The picture at the end of the frame; of a truth the one before anti-aliasing.
    picture: bool,
    is_radiance: bool,
    lights: u32,
    label: String,
    last: Option<FrameResult>,
}

impl Bench {
    fn new(
        gpu: &Gpu,
        scene: &Scene,
        options: &MotionOptions,
        label: &str,
        config: &Config,
    ) -> Result<Self, FrameBenchError> {
        let MotionOptions { size: [width, height], rays, seed, picture, .. } = *options;
        let render = RenderOptions { width, height, seed, rays, ..RenderOptions::default() };
        let failed = FrameBenchError::render(label);
        let mut renderer = Renderer::new(gpu, scene, &Slots::default(), config, render).map_err(failed)?;
        let slot = if picture { "sky" } else { options.slot.as_str() };
        renderer.read_slots(&[slot]).map_err(failed)?;
        let (lights, label) = (scene.lights.len() as u32, label.to_owned());
        let is_radiance = options.is_radiance();
        Ok(Self { renderer, slot: options.slot.clone(), picture, is_radiance, lights, label, last: None })
    }

    fn frame(&mut self, path: &Path, moment: &Moment, is_truth: bool) -> Result<Seen, FrameBenchError> {
        (0..self.lights).for_each(|light| self.renderer.scale_light(light, moment.light));
        let request = FrameRequest { camera: &moment.camera, time: moment.time, view: None, read_back: true };
        let failed = FrameBenchError::render(&self.label);
        self.last = self.renderer.frame(request).map_err(failed)?;
        let image = self.last.as_ref().and_then(|result| {
            if self.picture && !is_truth {
                return result.images.as_ref().map(|images| &images.linear);
            }
            result.slots.first().and_then(|(_, image)| image.as_ref())
        });
        let none = || FrameBenchError::NoImage { path: path.name, slot: self.slot.clone() };
        let image = image.ok_or_else(none)?;
        // Alpha of radiance says nothing.
        let channels = (image.format.channels() as usize).min(if self.is_radiance { 3 } else { 4 });
        Ok(Seen { size: image.extent, channels, pixels: image.values() })
    }

    /// What errors are measured of: single bright pixels must not decide.
    fn compared(&self, seen: &Seen) -> Values {
        let shown = |x: f64| if self.is_radiance { x / (1.0 + x) } else { x };
        seen.pixels.iter().flat_map(|v| v[..seen.channels].iter().map(|x| shown(f64::from(*x)))).collect()
    }

    /// Time of the slot's passes in the last frame, milliseconds, and their bytes.
    fn cost(&self) -> Option<Cost> {
        let result = self.last.as_ref()?;
        let passes = result.sample.passes.iter().filter(|pass| pass.stage == self.slot);
        let ms = passes.map(|pass| pass.gpu_ns).sum::<Option<u64>>().map(|ns| ns as f64 / 1e6);
        let report = result.what_runs().into_iter().find(|report| report.slot == self.slot)?;
        Some(Cost { ms, traffic: report.bytes as f64, kept: report.history_bytes as f64 })
    }
}

/// Ground truths.
#[derive(Default)]
struct Truths {
    /// Of each frame.
    frames: Vec<Seen>,
    /// Of the moment before a lasting change of light.
    before: Option<Seen>,
}

/// Ground truths of all frames. Each frame of the renderer has different rays, so that their mean converges.
fn truths(gpu: &Gpu, path: &Path, options: &MotionOptions) -> Result<Truths, FrameBenchError> {
    let of_gi = options.slot == GI;
    let Some(mut config) = config(options, Contestant::truth(&options.slot))? else { return Ok(Truths::default()) };
    if options.slot == DIRECT {
        // Shadows of suns are in its light.
        for change in ["stages.shadows=ray-traced", "shadows.rays=8", "shadows.denoiser=none"] {
            config.set(change)?;
        }
    }
    // The slots of the truth have the size of the picture, whatever a preset says.
    let complete = Slots::default().catalogue().complete(&config);
    if complete.settings.get("post").is_some_and(|post| post.contains_key("resolution_scale")) {
        config.set("post.resolution_scale=1")?;
    }
    let mut bench = Bench::new(gpu, &path.scene, options, "truth", &config)?;
    let frames = match () {
        () if options.picture => PICTURE_TRUTH_FRAMES,
        () if of_gi => GI_TRUTH_FRAMES,
        () => TRUTH_FRAMES,
    };
    let mut of = |moment: &Moment, frames: u32| -> Result<Seen, FrameBenchError> {
        let Seen { size, channels, pixels } = bench.frame(path, moment, true)?;
        let mut sums: Vec<[f64; 4]> = pixels.iter().map(|p| p.map(f64::from)).collect();
        for _ in 1..frames {
            let next = bench.frame(path, moment, true)?;
            for (sum, v) in sums.iter_mut().zip(next.pixels) {
                (0..4).for_each(|k| sum[k] += f64::from(v[k]));
            }
        }
        let pixels = sums.iter().map(|sum| sum.map(|x| (x / f64::from(frames)) as f32)).collect();
        Ok(Seen { size, channels, pixels })
    };
    // Light that has changed for good is compared with all that has changed, which noise in these two pictures must not be a part of.
    let lasts = options.is_radiance() && path.before.is_some();
    let mut truths = Truths::default();
    for (at, moment) in path.moments.iter().enumerate() {
        // Where nothing moves any more, all frames have the same truth.
        let settled = path.settles.filter(|settles| at > *settles);
        let frames = if lasts && path.settles == Some(at) { LASTING * frames } else { frames };
        let truth = settled.map_or_else(|| of(moment, frames), |settles| Ok(truths.frames[settles].clone()))?;
        truths.frames.push(truth);
    }
    if let (Some(before), Some(_), true) = (&path.before, path.settles, lasts) {
        truths.before = Some(of(before, LASTING * frames)?);
    }
    Ok(truths)
}

/// How much of the way from one picture to another a third one has gone; none if those two are the same.
fn gone(seen: &Seen, before: &Seen, after: &Seen) -> Option<f64> {
    let [seen, before, after] = [seen, before, after].map(blocks);
    let way = || after.iter().zip(&before).map(|(b, a)| b - a);
    let went: f64 = seen.iter().zip(&before).zip(way()).map(|((s, a), way)| (s - a) * way).sum();
    let all: f64 = way().map(|way| way * way).sum();
    (all > 0.0).then_some(went / all)
}

/// Width of the blocks over which light is averaged before it is compared with that before and after a change, pixels: noise must not decide.
const BLOCK: usize = 8;

/// Means over blocks of pixels, channel by channel.
fn blocks(seen: &Seen) -> Vec<f64> {
    let [width, height] = [seen.size.width, seen.size.height].map(|n| n as usize);
    let [across, down] = [width, height].map(|n| n.div_ceil(BLOCK));
    let mut sums = vec![[0.0_f64; 4]; across * down];
    let mut counts = vec![0.0_f64; across * down];
    for (at, pixel) in seen.pixels.iter().enumerate() {
        let block = at / width / BLOCK * across + at % width / BLOCK;
        counts[block] += 1.0;
        (0..seen.channels).for_each(|k| sums[block][k] += f64::from(pixel[k]));
    }
    sums.iter().zip(counts).flat_map(|(sum, count)| sum[..seen.channels].iter().map(move |x| x / count)).collect()
}

fn root_mean_square(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    (values.map(|value| value * value).sum::<f64>() / count).sqrt()
}

/// Frames, from 1, that are also compared as they are perceived, beside the last.
const PERCEIVED: [usize; 3] = [1, 8, 32];

/// Renders one path with every contestant that takes part.
///
/// # Errors
/// [`FrameBenchError`].
pub fn walk(
    gpu: &Gpu,
    path: &Path,
    options: &MotionOptions,
    perceived: Perceived<'_>,
) -> Result<Vec<Course>, FrameBenchError> {
    let truths = truths(gpu, path, options)?;
    let mut courses = Vec::new();
    let mut configs: Vec<Config> = Vec::new();
    for contestant in CONTESTANTS {
        let Some(config) = config(options, contestant)? else { continue };
        if !options.takes(&CONTESTANTS.map(|c| c.label), contestant.label) || configs.contains(&config) {
            continue; // not wanted, or the effect does not have this setting
        }
        let runs = (0..options.seeds)
            .map(|run| course(gpu, path, options, (contestant.label, &config, run), &truths, perceived));
        match runs.collect() {
            Ok(runs) => courses.extend(Course::mean_of(runs)),
            // In a scene without a sky it has nothing to do.
            Err(FrameBenchError::NoImage { .. }) if contestant.implementation == "sky" => continue,
            Err(error) => return Err(error),
        }
        configs.push(config);
    }
    Ok(courses)
}

/// One run of a contestant on one path.
fn course(
    gpu: &Gpu,
    path: &Path,
    options: &MotionOptions,
    (label, config, run): (&'static str, &Config, u32),
    truths: &Truths,
    perceived: Perceived<'_>,
) -> Result<Course, FrameBenchError> {
    let mean = |values: &Values| values.iter().sum::<f64>() / values.len() as f64;
    let seeded = MotionOptions { seed: options.seed.wrapping_add(run), ..options.clone() };
    let mut bench = Bench::new(gpu, &path.scene, &seeded, label, config)?;
    if let Some(before) = &path.before {
        for _ in 0..WARM_UP {
            bench.frame(path, before, false)?;
        }
    }
    let pixels = options.size.iter().map(|n| f64::from(*n)).product::<f64>();
    let cost = Cost { ms: None, traffic: 0.0, kept: 0.0 };
    let true_means = truths.frames.iter().map(|truth| mean(&bench.compared(truth))).collect();
    let (errors, means, flicker, noticed) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut course = Course {
        path: path.name,
        label,
        errors,
        perceived: noticed,
        cost,
        flicker,
        means,
        true_means,
        gone: Vec::new(),
        late: Vec::new(),
    };
    let mut before: Option<Values> = None;
    for (at, (moment, truth)) in path.moments.iter().zip(&truths.frames).enumerate() {
        let seen = bench.frame(path, moment, false)?;
        let (values, true_values) = (bench.compared(&seen), bench.compared(truth));
        let apart: Values = values.iter().zip(true_values).map(|(a, b)| a - b).collect();
        course.errors.push(root_mean_square(apart.iter().copied()));
        let is_perceived = PERCEIVED.contains(&(at + 1)) || at + 1 == truths.frames.len();
        let place = Place { path: path.name, label, frame: at + 1, run };
        let difference = is_perceived.then(|| perceived(place, &seen, truth)).transpose();
        course.perceived.push(difference.map_err(FrameBenchError::Perceived)?);
        course.flicker.extend(before.map(|before| root_mean_square(apart.iter().zip(&before).map(|(a, b)| a - b))));
        before = Some(apart);
        course.means.push(mean(&values));
        if let Some(before) = truths.before.as_ref().filter(|_| path.settles.is_some_and(|settles| at >= settles)) {
            course.gone.extend(gone(&seen, before, truth));
        }
        if let Some(now) = bench.cost() {
            let least = course.cost.ms.map_or(now.ms, |least| now.ms.map(|ms| ms.min(least)));
            course.cost = Cost { ms: least, traffic: now.traffic / pixels, kept: now.kept / pixels };
        }
    }
    Ok(course.told())
}

/// Renders every path of the scene that takes part.
///
/// # Errors
/// [`FrameBenchError`].
pub fn run(
    gpu: &Gpu,
    scene: &Scene,
    options: &MotionOptions,
    perceived: Perceived<'_>,
    mut progress: impl FnMut(&str),
) -> Result<MotionReport, FrameBenchError> {
    let mut paths = paths(scene, options.frames);
    if [GI, DIRECT].contains(&options.slot.as_str()) {
        paths.extend(paths_of_light(scene, options.frames, &options.door));
    }
    let labels = CONTESTANTS.map(|contestant| contestant.label);
    for name in &options.only {
        if !paths.iter().any(|path| path.name == name) && !labels.contains(&name.as_str()) {
            let known = paths.iter().map(|path| path.name).chain(labels).collect::<Vec<_>>().join(", ");
            return Err(FrameBenchError::UnknownContestant { name: name.clone(), known });
        }
    }
    let names: Vec<&str> = paths.iter().map(|path| path.name).collect();
    let mut courses = Vec::new();
    for path in paths.iter().filter(|path| options.takes(&names, path.name)) {
        progress(path.name);
        courses.extend(walk(gpu, path, options, perceived)?);
    }
    Ok(MotionReport::new(gpu, scene, options, courses))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_goes_from_the_picture_before_to_the_one_after() {
        let size = Extent { width: 20, height: 12 };
        // Noise of pixels within a block does not count.
        let picture = |left: f32, right: f32| {
            let noise = |at: usize| if at.is_multiple_of(2) { 0.25 } else { -0.25 };
            let pixels = (0..240).map(|at| [if at % 20 < 8 { left } else { right } + noise(at); 4]).collect();
            Seen { size, channels: 3, pixels }
        };
        let (before, after) = (picture(1.0, 1.0), picture(1.0, 3.0));
        let share = |seen: &Seen| gone(seen, &before, &after).unwrap();
        assert!((share(&picture(1.0, 2.0)) - 0.5).abs() < 1e-6);
        // What changes elsewhere is not on the way.
        assert!((share(&picture(7.0, 3.0)) - 1.0).abs() < 1e-6);
        assert!(gone(&after, &before, &before).is_none());
    }
}
