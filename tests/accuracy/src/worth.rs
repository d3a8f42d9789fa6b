//! What each effect of a frame contributes to the picture, beside what it costs: the frame with and without it.
use crate::error::AccuracyError;
use crate::metrics::{Picture, flip_ldr};
use magpie::config::{Catalogue, Config};
use magpie::gpu::Gpu;
use magpie::measure::median;
use magpie::pixels::Pixels;
use magpie::scene::{Camera, Scene};
use magpie_passes::{FrameRequest, FrameResult, RenderOptions, Renderer, Slots};
use serde::Serialize;
use std::collections::BTreeMap;

/// Slots that are no effect: without them there is no picture, or another one.
const NO_EFFECTS: [&str; 2] = ["rays", "sky"];

/// How probes are rendered.
#[derive(Clone, Copy, Debug)]
pub struct ProbeOptions {
    /// How.
    pub render: RenderOptions,
    /// Frames of each; the last one is the picture. Medians of times are of the later half.
    pub frames: u32,
    /// An effect that contributes less than this by itself (FLIP, 0 to 1) is proposed to be left out.
    pub min_flip: f64,
}

/// An effect, and the frame without it.
#[derive(Clone, Debug, Serialize)]
pub struct Contribution {
    /// What is left out: a slot, or a part of its implementation as `slot.part`.
    pub effect: String,
    /// The assignment that leaves it out, as `--set` takes it.
    pub without: String,
    /// FLIP of the displayed picture without it, against the one with it.
    pub flip: f64,
    /// Milliseconds of the passes that are gone without it.
    pub ms: f64,
    /// The picture without it.
    #[serde(skip)]
    pub picture: Pixels,
}

/// What the effects of a frame are worth.
#[derive(Clone, Debug, Serialize)]
pub struct Worth {
    /// Milliseconds of all passes of the frame.
    pub ms: f64,
    /// The picture with all of them.
    #[serde(skip)]
    pub picture: Pixels,
    /// One for each effect that runs and can be left out, in the order of the frame.
    pub contributions: Vec<Contribution>,
    /// What remains when all that contributes less than the threshold is left out together; `None` where nothing does.
    pub proposal: Option<Proposal>,
}

/// The configuration without what is not worth its time.
#[derive(Clone, Debug, Serialize)]
pub struct Proposal {
    /// The assignments that it has beyond the given one.
    pub without: Vec<String>,
    /// FLIP of its picture against the one with everything.
    pub flip: f64,
    /// Milliseconds of the passes that are gone.
    pub ms: f64,
    /// The whole of it.
    #[serde(skip)]
    pub config: Config,
    /// Its picture.
    #[serde(skip)]
    pub picture: Pixels,
}

/// A picture, and the milliseconds of each pass that made it.
struct Probe {
    picture: Pixels,
    passes: BTreeMap<String, f64>,
    last: FrameResult,
}

/// Renders the frame with and without each effect that runs in it. What contributes less than [`ProbeOptions::min_flip`] by itself is left out
/// together in the proposal.
///
/// # Errors
/// [`AccuracyError`].
pub fn worth(
    gpu: &Gpu,
    scene: &Scene,
    camera: &Camera,
    config: &Config,
    options: ProbeOptions,
) -> Result<Worth, AccuracyError> {
    let slots = Slots::default();
    let catalogue = slots.catalogue();
    let probe = |config: &Config| probe(gpu, scene, camera, &slots, config, options);
    let whole = probe(config)?;
    let mut contributions = Vec::new();
    for (effect, without) in effects(&catalogue, &whole.last) {
        let probe = probe(&with(config, &[&without])?)?;
        let (flip, ms) = whole.against(&probe)?;
        contributions.push(Contribution { effect, without, flip, ms, picture: probe.picture });
    }
    let left_out: Vec<&str> =
        contributions.iter().filter(|c| c.flip < options.min_flip).map(|c| c.without.as_str()).collect();
    let proposal = if left_out.is_empty() {
        None
    } else {
        let config = with(config, &left_out)?;
        let probe = probe(&config)?;
        let (flip, ms) = whole.against(&probe)?;
        let without = left_out.iter().map(|w| (*w).to_owned()).collect();
        Some(Proposal { without, flip, ms, config, picture: probe.picture })
    };
    Ok(Worth { ms: whole.passes.values().sum(), picture: whole.picture, contributions, proposal })
}

/// What runs and can be left out, each with the assignment that does so.
fn effects(catalogue: &Catalogue, frame: &FrameResult) -> Vec<(String, String)> {
    let mut found = Vec::new();
    for slot in frame.what_runs().into_iter().filter(|slot| slot.runs) {
        let info = catalogue.slots.iter().find(|info| info.name == slot.slot);
        if info.is_some_and(|info| info.implementation("off").is_some()) && !NO_EFFECTS.contains(&slot.slot.as_str()) {
            found.push((slot.slot.clone(), format!("stages.{}=off", slot.slot)));
        }
        for part in slot.parts.iter().filter(|part| part.runs) {
            if let Some(without) = part.without {
                found.push((format!("{}.{}", slot.slot, part.part), format!("{}.{without}", slot.slot)));
            }
        }
    }
    found
}

fn with(config: &Config, assignments: &[&str]) -> Result<Config, AccuracyError> {
    let mut config = config.clone();
    for assignment in assignments {
        config
            .set(assignment)
            .map_err(|e| AccuracyError::Render(Box::new(magpie_passes::RenderError::Config(Box::new(e)))))?;
    }
    Ok(config)
}

fn probe(
    gpu: &Gpu,
    scene: &Scene,
    camera: &Camera,
    slots: &Slots,
    config: &Config,
    options: ProbeOptions,
) -> Result<Probe, AccuracyError> {
    let render = |error| AccuracyError::Render(Box::new(error));
    let mut renderer = Renderer::new(gpu, scene, slots, config, options.render).map_err(render)?;
    let mut times: BTreeMap<String, Vec<u64>> = BTreeMap::new();
    let mut last = None;
    for frame in 1..=options.frames {
        let request = FrameRequest { camera, time: 0.0, view: None, read_back: frame == options.frames };
        let result = renderer.frame(request).map_err(render)?;
        if let Some(result) = &result {
            let own =
                result.sample.passes.iter().filter(|p| frame > options.frames / 2 && !p.name.starts_with("read_back"));
            own.for_each(|p| times.entry(p.name.clone()).or_default().push(p.gpu_ns.unwrap_or(0)));
        }
        last = result;
    }
    let lacks =
        || AccuracyError::Lacks { setup: "a probe".to_owned(), frame: options.frames, what: "a picture".to_owned() };
    let last = last.ok_or_else(lacks)?;
    let picture = last.images.as_ref().and_then(|images| images.display.clone()).ok_or_else(lacks)?;
    let passes = times.into_iter().map(|(name, ms)| (name, median(&ms).unwrap_or(0.0) * 1e-6)).collect();
    Ok(Probe { picture, passes, last })
}

impl Probe {
    /// FLIP of another one against this one, and the milliseconds of the passes that the other one lacks.
    fn against(&self, other: &Self) -> Result<(f64, f64), AccuracyError> {
        let metric = AccuracyError::metric("the picture of a probe");
        let pictures = [&other.picture, &self.picture].map(Picture::from_pixels);
        let [test, reference] = pictures;
        let compare = || flip_ldr(&test?, &reference?);
        let flip = compare().map_err(metric)?;
        let gone = self.passes.iter().filter(|(name, _)| !other.passes.contains_key(*name));
        Ok((flip, gone.map(|(_, ms)| ms).sum()))
    }
}
