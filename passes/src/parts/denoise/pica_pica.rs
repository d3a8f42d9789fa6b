//! The denoiser `pica-pica`: the temporal half of the chain that PICA PICA has for reflections (Barré-Brisebois et al. 2019, "Hybrid Rendering
//! for Real-Time Ray Tracing", Ray Tracing Gems, chapter 25, section 25.3.2).
//!
//! The passes are `accumulate` → `clean_up`. What accumulates is the history of the next frame, so that the blur of the clean-up does not add up.
use super::inputs::{Before, Samples, TwoHistories, index_of};
use super::signal::Packed;
use super::{DenoiseIn, Options};
use magpie::gpu::Kernel;
use magpie::graph::{History, HistoryScope};
use magpie::prelude::*;
use magpie::slot::{Build, SlotError};
use magpie_shaders::denoise::{CleanUpParams, DualSourceParams, NO_IMAGE};
use magpie_shaders::{DENOISE_CLEAN_UP_COMP, DENOISE_DUAL_SOURCE_COMP};

/// Format of history lengths: samples count by fractions.
const FRAMES: Format = Format::R16Float;
/// Format of the shares of the two sources of history: the surface's, and that of the reflected image.
const SOURCE: Format = Format::Rg8Unorm;

/// The denoiser `pica-pica`.
pub struct PicaPica {
    effect: &'static str,
    scope: HistoryScope,
    accumulate: Kernel,
    clean_up: Kernel,
    options: Options,
}

/// The temporal mean with the deviation of the samples, and the history length.
#[derive(Clone, Copy)]
struct Accumulated {
    signal: Packed,
    frames: Handle<Image>,
}

impl PicaPica {
    /// Creates the pipelines.
    pub fn new(build: &Build<'_>, effect: &'static str, options: Options) -> Result<Self, SlotError> {
        let (accumulate, clean_up) = (build.kernel(&DENOISE_DUAL_SOURCE_COMP)?, build.kernel(&DENOISE_CLEAN_UP_COMP)?);
        Ok(Self { effect, scope: HistoryScope::new(), accumulate, clean_up, options })
    }

    /// Adds the passes. `name` is appended to their names and to those of the histories.
    pub fn add(&self, g: &mut FrameGraph, view: &View, i: DenoiseIn, name: &str) -> Handle<Image> {
        let accumulated = self.accumulate(g, view, i, name);
        self.clean_up(g, view, i, accumulated, name)
    }

    fn accumulate(&self, g: &mut FrameGraph, view: &View, i: DenoiseIn, name: &str) -> Accumulated {
        let (kernel, longest, noisy) = (self.accumulate, self.options.history as f32, i.signal.image);
        let packing = i.signal.content.packing(self.options.precision);
        let (previous, next) = packing.history(g, &self.scope, &format!("accumulated{name}"), noisy);
        let History { previous: previous_frames, next: next_frames, .. } =
            g.history(&self.scope, format!("frames{name}"), ImageDesc::like(FRAMES, noisy));
        g.pass(&format!("{}.accumulate{name}", self.effect), Queue::AsyncCompute, |p| {
            let gradient = i.hints.change.map(|change| p.sample(change));
            let samples = Samples::declare(p, view, &i, packing.layout, TwoHistories::CHANNELS);
            let before = Before { signal: previous, frames: previous_frames, fast: None };
            let histories = TwoHistories::declare(p, &i, before);
            let (signal, target) = next.write(p);
            let (counted, frames) = p.write(next_frames);
            let source = p.is_watched("source").then(|| p.create("source", ImageDesc::like(SOURCE, noisy)).1);
            (Accumulated { signal, frames: counted.read() }, move |c: &mut Record<'_>| {
                let (accumulated, accumulated_deviation) = target.ids(c);
                let [motion, taps] = samples.motion(c);
                let params = DualSourceParams {
                    view: samples.view(c),
                    not_finite: c.not_finite(),
                    noisy: samples.noisy(c),
                    motion,
                    taps,
                    history: histories.images(c, &samples),
                    accumulated,
                    accumulated_deviation,
                    frames: c.id(frames),
                    gradient: index_of(c, gradient),
                    source: source.map_or(NO_IMAGE, |t| c.id(t).index()),
                    longest,
                    greatest: packing.values.greatest(),
                };
                c.dispatch(kernel, &params, samples.extent);
            })
        })
    }

    fn clean_up(&self, g: &mut FrameGraph, view: &View, i: DenoiseIn, from: Accumulated, name: &str) -> Handle<Image> {
        let (kernel, block, options) = (self.clean_up, view.block, self.options);
        let packing = i.signal.content.packing(options.precision);
        let format = i.signal.content.result(options.precision);
        g.pass(&format!("{}.clean_up{name}", self.effect), Queue::AsyncCompute, |p| {
            let (block, guide) = (p.read(block), p.sample(i.surfaces.reprojected.guide));
            let (noise_width, normals) = (i.hints.width.map(|h| p.sample(h)), i.normals().map(|h| p.sample(h)));
            let (signal, frames) = (from.signal.sample(p), p.sample(from.frames));
            let (result, target) = p.create("result", ImageDesc::like(format, i.signal.image));
            let extent = p.extent(i.signal.image);
            (result.read(), move |c: &mut Record<'_>| {
                let (accumulated, accumulated_deviation) = signal.ids(c);
                let params = CleanUpParams {
                    view: c.id(block),
                    guide: c.id(guide),
                    normals: index_of(c, normals),
                    accumulated,
                    accumulated_deviation,
                    frames: c.id(frames),
                    noise_width: index_of(c, noise_width),
                    result: c.id(target),
                    threshold: options.clean_up,
                    radius: options.radius as f32,
                    packing: packing.layout,
                    greatest: format.greatest(),
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }
}
