//! The denoiser `svgf`: spatiotemporal variance-guided filtering (Schied et al. 2017).
//!
//! The passes are `accumulate` → `spatial_variance` → `level_N`. The result of the first level is the history of the next
//! frame. Between passes, values are packed together with their standard deviations.
use super::inputs::{Samples, index_of};
use super::signal::{Packed, PackedWrite};
use super::{DenoiseIn, Options};
use magpie::gpu::Kernel;
use magpie::graph::{Extent, History, HistoryScope};
use magpie::prelude::*;
use magpie::slot::{Build, SlotError};
use magpie_shaders::denoise::{AccumulateParams, LevelParams, NO_IMAGE, SpatialVarianceParams, TILE};
use magpie_shaders::{DENOISE_ACCUMULATE_COMP, DENOISE_LEVEL_COMP, DENOISE_SPATIAL_VARIANCE_COMP};

/// The denoiser `svgf`.
pub struct Svgf {
    effect: &'static str,
    scope: HistoryScope,
    kernels: Kernels,
    options: Options,
}

#[derive(Clone, Copy)]
struct Kernels {
    accumulate: Kernel,
    spatial_variance: Kernel,
    level: Kernel,
}

/// The temporal mean with its deviation, and the history length.
#[derive(Clone, Copy)]
struct Accumulated {
    signal: Packed,
    frames: Handle<Image>,
}

/// Input of a level of the à-trous filter.
#[derive(Clone, Copy)]
struct Filtered {
    signal: Packed,
    /// One pixel per tile: 1 if any of its pixels has a variance.
    varied_tiles: Handle<Image>,
}

/// One level of the à-trous filter.
struct Level {
    index: u32,
    from: Filtered,
    /// Where the next frame looks for the filtered signal, for the level that writes it.
    history: Option<PackedWrite>,
}

impl Svgf {
    /// Creates the pipelines.
    pub fn new(build: &Build<'_>, effect: &'static str, options: Options) -> Result<Self, SlotError> {
        let kernels = Kernels {
            accumulate: build.kernel(&DENOISE_ACCUMULATE_COMP)?,
            spatial_variance: build.kernel(&DENOISE_SPATIAL_VARIANCE_COMP)?,
            level: build.kernel(&DENOISE_LEVEL_COMP)?,
        };
        Ok(Self { effect, scope: HistoryScope::new(), kernels, options })
    }

    /// Adds the passes. `name` is appended to their names and to those of the histories.
    pub fn add(&self, g: &mut FrameGraph, view: &View, i: DenoiseIn, name: &str) -> Handle<Image> {
        let pass = |step: &str| format!("{}.{step}{name}", self.effect);
        let packing = i.signal.content.packing(self.options.precision);
        let (filtered, next) = packing.history(g, &self.scope, &format!("filtered{name}"), i.signal.image);
        let accumulated = self.accumulate(g, view, i, filtered, name);
        let mut filtered = self.spatial_variance(g, view, i, accumulated, &pass("spatial_variance"));
        let (mut next, mut result) = (Some(next), i.signal.image);
        for index in 0..self.options.levels {
            let (level, pass) =
                (Level { index, from: filtered, history: next.take() }, pass(&format!("level_{index}")));
            (filtered.signal, result) = self.level(g, view, i, level, &pass);
        }
        result
    }

    fn accumulate(&self, g: &mut FrameGraph, view: &View, i: DenoiseIn, history: Packed, name: &str) -> Accumulated {
        let (kernel, longest) = (self.kernels.accumulate, self.options.history as f32);
        let (content, noisy) = (i.signal.content, i.signal.image);
        let packing = content.packing(self.options.precision);
        let moments = content.moments(self.options.precision);
        let (previous_moments, next_moments) = moments.history(g, &self.scope, &format!("moments{name}"), noisy);
        let History { previous: previous_frames, next: next_frames, .. } =
            g.history(&self.scope, format!("frames{name}"), ImageDesc::like(content.frames(), noisy));
        g.pass(&format!("{}.accumulate{name}", self.effect), Queue::AsyncCompute, |p| {
            let samples = Samples::declare(p, view, &i, packing.layout, &[]);
            let gradient = i.hints.change.map(|change| p.sample(change));
            let (previous_filtered, previous_frames) = (p.sample(history.values), p.sample(previous_frames));
            let previous_moments = previous_moments.sample(p);
            let (signal, signal_target) = packing.create(p, "accumulated", noisy);
            let (_, moments) = next_moments.write(p);
            let (counted, frames) = p.write(next_frames);
            (Accumulated { signal, frames: counted.read() }, move |c: &mut Record<'_>| {
                let [motion, taps] = samples.motion(c);
                let (accumulated, accumulated_deviation) = signal_target.ids(c);
                let (previous_moments, previous_moments_deviation) = previous_moments.ids(c);
                let (moments, moments_deviation) = moments.ids(c);
                let params = AccumulateParams {
                    view: samples.view(c),
                    not_finite: c.not_finite(),
                    noisy: samples.noisy(c),
                    motion,
                    taps,
                    previous_filtered: c.id(previous_filtered),
                    previous_moments,
                    previous_moments_deviation,
                    previous_frames: c.id(previous_frames),
                    gradient: index_of(c, gradient),
                    moved: i.hints.moved,
                    accumulated,
                    accumulated_deviation,
                    moments,
                    moments_deviation,
                    frames: c.id(frames),
                    longest,
                    alike: i.hints.alike,
                    greatest: packing.values.greatest(),
                };
                c.dispatch(kernel, &params, samples.extent);
            })
        })
    }

    fn spatial_variance(
        &self,
        g: &mut FrameGraph,
        view: &View,
        i: DenoiseIn,
        from: Accumulated,
        pass: &str,
    ) -> Filtered {
        let (kernel, block, content) = (self.kernels.spatial_variance, view.block, i.signal.content);
        let packing = content.packing(self.options.precision);
        let extent = g.extent(i.signal.image);
        let tiles = Extent::new(extent.width.div_ceil(TILE), extent.height.div_ceil(TILE));
        g.pass(pass, Queue::AsyncCompute, |p| {
            let (block, guide) = (p.read(block), p.sample(i.surfaces.reprojected.guide));
            let (accumulated, frames) = (from.signal.sample(p), p.sample(from.frames));
            let (noise_width, normals) = (i.hints.width.map(|h| p.sample(h)), i.normals().map(|h| p.sample(h)));
            let (signal, signal_target) = packing.create(p, "signal", i.signal.image);
            let (varied_tiles, varied_target) = p.create("varied_tiles", ImageDesc::fixed(Format::R8Unorm, tiles));
            (Filtered { signal, varied_tiles: varied_tiles.read() }, move |c: &mut Record<'_>| {
                let (accumulated, accumulated_deviation) = accumulated.ids(c);
                let (signal, signal_deviation) = signal_target.ids(c);
                let params = SpatialVarianceParams {
                    view: c.id(block),
                    guide: c.id(guide),
                    normals: index_of(c, normals),
                    accumulated,
                    accumulated_deviation,
                    frames: c.id(frames),
                    noise_width: index_of(c, noise_width),
                    signal,
                    signal_deviation,
                    varied_tiles: c.id(varied_target),
                    packing: packing.layout,
                    channels: content.variances(),
                    alike: i.hints.alike,
                    greatest: packing.values.greatest(),
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }

    /// Adds one level. The last one returns the result, all others the filtered signal for the next level.
    fn level(
        &self,
        g: &mut FrameGraph,
        view: &View,
        i: DenoiseIn,
        level: Level,
        pass: &str,
    ) -> (Packed, Handle<Image>) {
        let Level { index, from, history } = level;
        let (kernel, block, content) = (self.kernels.level, view.block, i.signal.content);
        let (sigma, is_last) = (self.options.sigma, index + 1 == self.options.levels);
        let packing = content.packing(self.options.precision);
        let result = content.result(self.options.precision);
        g.pass(pass, Queue::AsyncCompute, |p| {
            let (block, guide) = (p.read(block), p.sample(i.surfaces.reprojected.guide));
            let (noise_width, normals) = (i.hints.width.map(|h| p.sample(h)), i.normals().map(|h| p.sample(h)));
            let (signal, varied_tiles) = (from.signal.sample(p), p.sample(from.varied_tiles));
            let filtered = match history {
                Some(history) => Some(history.write(p)),
                None => (!is_last).then(|| packing.create(p, "filtered", i.signal.image)),
            };
            let (filtered, filtered_target) = filtered.unzip();
            let (result, result_target) =
                is_last.then(|| p.create("result", ImageDesc::like(result, i.signal.image))).unzip();
            let extent = p.extent(i.signal.image);
            let out = filtered.unwrap_or(from.signal);
            ((out, result.map_or(out.values, |r| r.read())), move |c: &mut Record<'_>| {
                let (signal, signal_deviation) = signal.ids(c);
                let filtered = filtered_target.map(|t| t.ids(c));
                let params = LevelParams {
                    view: c.id(block),
                    guide: c.id(guide),
                    normals: index_of(c, normals),
                    signal,
                    signal_deviation,
                    varied_tiles: c.id(varied_tiles),
                    noise_width: index_of(c, noise_width),
                    filtered: filtered.map_or(NO_IMAGE, |(values, _)| values.index()),
                    filtered_deviation: filtered.map_or(NO_IMAGE, |(_, deviations)| deviations),
                    result: result_target.map_or(NO_IMAGE, |t| c.id(t).index()),
                    step: 1 << index,
                    packing: packing.layout,
                    sigma,
                    greatest: packing.values.greatest(),
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }
}
