//! Screen-space ambient occlusion after Jimenez, Wu, Pesce and Jarabo 2016, "Practical Real-Time Strategies for Accurate Indirect
//! Occlusion" (GTAO): a horizon search in the depth image, and a filter for its noise.
use super::{OPENNESS, needs};
use crate::contracts::{AoIn, AoOut, GEOMETRY};
use crate::parts::upsample::{Upsample, UpsampleIn};
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::scene::SceneFacts;
use magpie::slot::{Build, Needs, SettingSpec, Settings, SlotError};
use magpie_shaders::ao::{FilterParams, NO_BENT_NORMAL, SearchParams};
use magpie_shaders::{AO_FILTER_COMP, AO_SEARCH_COMP};

/// Rotations of the slices from frame to frame, as shares of half a circle, from the paper. Together with [`STARTS`] the noise repeats after
/// 24 frames.
const TURNS: [f32; 6] = [60.0 / 360.0, 300.0 / 360.0, 180.0 / 360.0, 240.0 / 360.0, 120.0 / 360.0, 0.0];
/// Offsets of the steps, as shares of a step, from the paper. The offset changes every six frames.
const STARTS: [f32; 4] = [0.0, 0.5, 0.25, 0.75];

/// Format of the search's result: bent normals, -1 to 1 stored as 0 to 1, and openness. It is noisy, and the filter takes the mean of 25
/// values, so 8 bits are enough.
const FOUND: Format = Format::Rgba8Unorm;
/// Format of the same after the filter, at half resolution.
const FILTERED: Format = Format::Rgba16Float;
/// Format of bent normals.
const BENT_NORMAL: Format = Format::Rg16Float;

/// Screen-space ambient occlusion.
pub struct ScreenSpace {
    search: Kernel,
    filter: Kernel,
    slices: u32,
    steps: u32,
    /// Metres.
    range: f32,
    /// As in [`SearchParams::decay`].
    decay: f32,
    /// The noise differs from frame to frame.
    moving_noise: bool,
    /// Set at half resolution only.
    upsample: Option<Upsample>,
}

/// Settings of `screen-space`.
pub fn settings() -> [SettingSpec; 6] {
    let slices = "Slices, planes that contain the view direction, in which horizons are searched for. Higher: less noise, with time \
                  proportional to the number.";
    let steps = "Depth samples on each side of a slice. Higher: thin occluders are missed less often, with time proportional to the \
                 number.";
    let thickness = "Assumed thickness of occluders, which a depth buffer does not hold. 1: infinitely thick; no light comes from behind, \
                     and thin objects get wide dark rims. Lower: horizons fall off with distance, down to this fraction of their \
                     occlusion at the end of the range.";
    let resolution = "`full`: every pixel. `half`: one pixel of four, upsampled along surfaces.";
    let noise = "`still`: the same noise in every frame. `moving`: different noise in every frame, for temporal anti-aliasing to average; \
                 without it the picture flickers.";
    [
        SettingSpec::integer("slices", "", slices, 2, 1..=16).sweep([1, 2, 4]),
        SettingSpec::integer("steps", "", steps, 8, 1..=64).sweep([4, 8, 16]),
        super::range(),
        SettingSpec::float("thickness", "", thickness, 1.0, 0.0..=1.0),
        SettingSpec::choice("resolution", resolution, "full", &["full", "half"]).sweep_all(),
        SettingSpec::choice("noise", noise, "still", &["still", "moving"]),
    ]
}

impl ScreenSpace {
    /// Creates the pipelines.
    pub fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        let half = settings.choice("resolution")? == "half";
        let upsample = half.then(|| Upsample::new(build, "ao")).transpose()?;
        let steps = settings.u32("steps")?;
        Ok(Self {
            search: build.kernel(&AO_SEARCH_COMP)?,
            filter: build.kernel(&AO_FILTER_COMP)?,
            slices: settings.u32("slices")?,
            steps,
            range: settings.f32("range")?,
            // After all steps the horizon has fallen to the share `thickness`, however many steps there are.
            decay: 1.0 - settings.f32("thickness")?.powf(1.0 / steps as f32),
            moving_noise: settings.choice("noise")? == "moving",
            upsample,
        })
    }

    /// Description of an image of the searched resolution, and the spacing of its pixels in full-resolution pixels.
    fn size(&self, i: AoIn, format: Format) -> (ImageDesc, u32) {
        match &self.upsample {
            Some(_) => (ImageDesc::half(format), 2),
            None => (ImageDesc::like(format, i.gbuffer.depth), 1),
        }
    }

    /// Adds the horizon search, which outputs noisy bent normals and openness.
    fn search(&self, g: &mut FrameGraph, view: &View, i: AoIn) -> Handle<Image> {
        let (kernel, block, (desc, step)) = (self.search, view.block, self.size(i, FOUND));
        let Self { slices, steps, range, decay, .. } = *self;
        let frame = if self.moving_noise { view.frame as usize } else { 0 };
        let noise = [TURNS[(frame + 5) % TURNS.len()], STARTS[frame / TURNS.len() % STARTS.len()]];
        g.pass("ao.search", Queue::AsyncCompute, |p| {
            let (block, gbuffer) = (p.read(block), i.gbuffer.read(p, GEOMETRY));
            let (found, target) = p.create("found", desc);
            let extent = p.extent_of(desc);
            (found.read(), move |c: &mut Record<'_>| {
                let params = SearchParams {
                    view: c.id(block),
                    gbuffer: gbuffer.images(c),
                    not_finite: c.not_finite(),
                    found: c.id(target),
                    step,
                    slices,
                    steps,
                    range,
                    decay,
                    noise,
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }

    /// Adds the filter. At half resolution its output is a single image in [`AoOut::openness`], which holds both values and must be upsampled.
    fn filter(&self, g: &mut FrameGraph, view: &View, i: AoIn, found: Handle<Image>) -> AoOut {
        let (kernel, block, is_whole) = (self.filter, view.block, self.upsample.is_none());
        let (desc, step) = self.size(i, if is_whole { OPENNESS } else { FILTERED });
        g.pass("ao.filter", Queue::AsyncCompute, |p| {
            let (block, found) = (p.read(block), p.sample(found));
            let gbuffer = i.gbuffer.read(p, GEOMETRY);
            let (filtered, target) = p.create(if is_whole { "openness" } else { "filtered" }, desc);
            let bent = is_whole.then(|| p.create("bent_normal", ImageDesc { format: BENT_NORMAL, ..desc }));
            let (bent_normal, bent_target) = bent.map(|(image, target)| (image.read(), target)).unzip();
            let extent = p.extent_of(desc);
            (AoOut { openness: Some(filtered.read()), bent_normal }, move |c: &mut Record<'_>| {
                let params = FilterParams {
                    view: c.id(block),
                    gbuffer: gbuffer.images(c),
                    found: c.id(found),
                    filtered: c.id(target),
                    bent_normal: bent_target.map_or(NO_BENT_NORMAL, |t| c.id(t).index()),
                    step,
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }
}

impl Effect for ScreenSpace {
    type In = AoIn;
    type Out = AoOut;

    fn needs(&self, facts: &SceneFacts) -> Needs {
        needs(facts)
    }

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: AoIn) -> AoOut {
        if self.needs(&view.facts).idle.is_some() {
            return AoOut { openness: None, bent_normal: None };
        }
        let found = self.search(g, view, i);
        let filtered = self.filter(g, view, i, found);
        match (&self.upsample, filtered.openness) {
            (Some(upsample), Some(half_size)) => {
                let (value, direction) = (("openness", OPENNESS), Some(("bent_normal", BENT_NORMAL)));
                let i = UpsampleIn { half_size, gbuffer: i.gbuffer, value, direction, background: 1.0 };
                let full = upsample.add(g, view, i, "");
                AoOut { openness: Some(full.value), bent_normal: full.direction }
            }
            _ => filtered,
        }
    }
}
