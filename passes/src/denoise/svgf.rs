//! Spatiotemporal variance-guided filtering (Schied et al. 2017), every stage a pass of its own.
//!
//! (`blur_gradient_N` →) `accumulate` → `spatial_variance` → `classify` → for each level `blur_variance_N`, `level_N`. What the first level
//! gives is what the next frame accumulates on.
use super::{Content, DenoiseIn};
use magpie::gpu::Kernel;
use magpie::graph::{Buffer, BufferDesc, History, HistoryScope};
use magpie::prelude::*;
use magpie::slot::{Build, Settings, SlotError};
use magpie_shaders::denoise::{
    AccumulateParams, BlurGradientParams, BlurVarianceParams, ClassifyParams, LevelParams, NO_IMAGE,
    SpatialVarianceParams, TILE, Tiles,
};
use magpie_shaders::{
    DENOISE_ACCUMULATE_COMP, DENOISE_BLUR_GRADIENT_COMP, DENOISE_BLUR_VARIANCE_COMP, DENOISE_CLASSIFY_COMP,
    DENOISE_LEVEL_COMP, DENOISE_SPATIAL_VARIANCE_COMP,
};

/// How often changes are blurred: over 5x5, then 9x9 of their pixels, which are a third as many on each side.
const GRADIENT_BLURS: u32 = 2;

/// The denoiser.
pub struct Svgf {
    effect: &'static str,
    scope: HistoryScope,
    kernels: Kernels,
    longest: u32,
    levels: u32,
    sigma: f32,
}

#[derive(Clone, Copy)]
struct Kernels {
    blur_gradient: Kernel,
    accumulate: Kernel,
    spatial_variance: Kernel,
    classify: Kernel,
    blur_variance: Kernel,
    level: Kernel,
}

/// What the levels work with.
#[derive(Clone, Copy)]
struct Work<'a> {
    view: &'a View,
    guide: Handle<Image>,
    normals: Option<Handle<Image>>,
    tiles: Handle<Buffer>,
    content: Content,
    reach: Option<Handle<Image>>,
}

/// Images that the levels read and write in turn.
struct Turns {
    /// What the next level filters.
    colour: WriteHandle<Image>,
    /// What it writes.
    target: WriteHandle<Image>,
    /// What the level after it writes; `None` where that is what the next one reads.
    spare: Option<WriteHandle<Image>>,
    error: WriteHandle<Image>,
    error_target: WriteHandle<Image>,
    blurred: WriteHandle<Image>,
}

/// A mean over frames.
struct Accumulated {
    colour: WriteHandle<Image>,
    error: Handle<Image>,
    frames: Handle<Image>,
}

impl Svgf {
    /// Makes its pipelines.
    pub fn new(build: &Build<'_>, effect: &'static str, settings: &Settings) -> Result<Self, SlotError> {
        let kernel = |shader| build.kernel(shader);
        let kernels = Kernels {
            blur_gradient: kernel(&DENOISE_BLUR_GRADIENT_COMP)?,
            accumulate: kernel(&DENOISE_ACCUMULATE_COMP)?,
            spatial_variance: kernel(&DENOISE_SPATIAL_VARIANCE_COMP)?,
            classify: kernel(&DENOISE_CLASSIFY_COMP)?,
            blur_variance: kernel(&DENOISE_BLUR_VARIANCE_COMP)?,
            level: kernel(&DENOISE_LEVEL_COMP)?,
        };
        Ok(Self {
            effect,
            scope: HistoryScope::new(),
            kernels,
            longest: settings.u32("history")?,
            levels: settings.u32("levels")?,
            sigma: settings.f32("sigma")?,
        })
    }

    /// Denoises an image.
    pub fn add(&self, g: &mut FrameGraph, view: &View, i: DenoiseIn, name: &str) -> Handle<Image> {
        let pass = |step: &str| format!("{}.{step}{name}", self.effect);
        let History { previous, next, .. } =
            g.history(&self.scope, format!("filtered{name}"), ImageDesc::like(i.content.colour(), i.noisy));
        let gradient = i.change.map(|change| {
            (0..GRADIENT_BLURS).fold(change, |change, blur| {
                self.blur_gradient(g, change, blur, &pass(&format!("blur_gradient_{blur}")))
            })
        });
        let accumulated = self.accumulate(g, view, i, (previous, gradient), &pass("accumulate"), name);
        let (error, tiles) = self.spatial_variance(g, view, i, &accumulated, &pass("spatial_variance"));
        let images = [accumulated.colour, error, next];
        let (mut turns, tiles) = self.classify(g, i.content, images, tiles, &pass("classify"));
        let (guide, normals) = (i.reprojected.guide, i.normals());
        let work = Work { view, guide, normals, tiles, content: i.content, reach: i.reach };
        for level in 0..self.levels {
            turns = self.blur_variance(g, work, turns, &pass(&format!("blur_variance_{level}")));
            turns = self.level(g, work, turns, level, &pass(&format!("level_{level}")));
        }
        turns.colour.read()
    }

    fn blur_gradient(&self, g: &mut FrameGraph, change: Handle<Image>, blur: u32, pass: &str) -> Handle<Image> {
        let kernel = self.kernels.blur_gradient;
        g.pass(pass, Queue::AsyncCompute, |p| {
            let change_read = p.sample(change);
            let (blurred, target) = p.create("blurred", p.desc(change));
            let extent = p.extent(change);
            (blurred.read(), move |c: &mut Record<'_>| {
                let params = BlurGradientParams {
                    size: [extent.width, extent.height],
                    change: c.id(change_read),
                    blurred: c.id(target),
                    step: 1 << blur,
                    is_last: (blur + 1 == GRADIENT_BLURS).into(),
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }

    fn accumulate(
        &self,
        g: &mut FrameGraph,
        view: &View,
        i: DenoiseIn,
        (previous_filtered, gradient): (Handle<Image>, Option<Handle<Image>>),
        pass: &str,
        name: &str,
    ) -> Accumulated {
        let (kernel, longest, block) = (self.kernels.accumulate, self.longest as f32, view.block);
        let like = |format| ImageDesc::like(format, i.noisy);
        let mut history = |what: &str, format| g.history(&self.scope, format!("{what}{name}"), like(format));
        let mean = history("mean", i.content.variance());
        let variance = history("variance", i.content.variance());
        let frames = history("frames", i.content.frames());
        g.pass(pass, Queue::AsyncCompute, |p| {
            let (block, noisy, motion) = (p.read(block), p.sample(i.noisy), p.sample(i.gbuffer.motion));
            let (taps, gradient) = (p.sample(i.reprojected.taps), gradient.map(|h| p.sample(h)));
            let reach = i.reach.map(|h| p.sample(h));
            let previous_filtered = p.sample(previous_filtered);
            let [previous_mean, previous_variance, previous_frames] =
                [mean.previous, variance.previous, frames.previous].map(|h| p.sample(h));
            let (accumulated, target) = p.create("accumulated", like(i.content.colour()));
            let (error, error_target) = p.create("error", like(i.content.variance()));
            let (_, mean) = p.write(mean.next);
            let (_, variance) = p.write(variance.next);
            let (counted, frames) = p.write(frames.next);
            let extent = p.extent(i.noisy);
            let out = Accumulated { colour: accumulated, error: error.read(), frames: counted.read() };
            (out, move |c: &mut Record<'_>| {
                let params = AccumulateParams {
                    view: c.id(block),
                    not_finite: c.not_finite(),
                    noisy: c.id(noisy),
                    motion: c.id(motion),
                    taps: c.id(taps),
                    previous_filtered: c.id(previous_filtered),
                    previous_mean: c.id(previous_mean),
                    previous_variance: c.id(previous_variance),
                    previous_frames: c.id(previous_frames),
                    gradient: gradient.map_or(NO_IMAGE, |t| c.id(t).index()),
                    reach: reach.map_or(NO_IMAGE, |t| c.id(t).index()),
                    moved: i.moved,
                    accumulated: c.id(target),
                    error: c.id(error_target),
                    mean: c.id(mean),
                    variance: c.id(variance),
                    frames: c.id(frames),
                    longest,
                    radiance: i.content.is_radiance().into(),
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }

    fn spatial_variance(
        &self,
        g: &mut FrameGraph,
        view: &View,
        i: DenoiseIn,
        from: &Accumulated,
        pass: &str,
    ) -> (WriteHandle<Image>, WriteHandle<Buffer>) {
        let (kernel, block) = (self.kernels.spatial_variance, view.block);
        g.pass(pass, Queue::AsyncCompute, |p| {
            let (block, guide) = (p.read(block), p.sample(i.reprojected.guide));
            let [accumulated, error, frames] = [from.colour.read(), from.error, from.frames].map(|h| p.sample(h));
            let (reach, normals) = (i.reach.map(|h| p.sample(h)), i.normals().map(|h| p.sample(h)));
            let (variance, target) = p.create("variance", ImageDesc::like(i.content.variance(), i.noisy));
            let extent = p.extent(i.noisy);
            let most = extent.width.div_ceil(TILE) * extent.height.div_ceil(TILE);
            let bytes = size_of::<Tiles>() as u64 + 4 * u64::from(most);
            let (tiles, cleared) = p.create_buffer("tiles", BufferDesc::new(bytes));
            ((variance, tiles), move |c: &mut Record<'_>| {
                let params = SpatialVarianceParams {
                    view: c.id(block),
                    tiles: c.id(cleared),
                    guide: c.id(guide),
                    normals: normals.map_or(NO_IMAGE, |t| c.id(t).index()),
                    accumulated: c.id(accumulated),
                    error: c.id(error),
                    frames: c.id(frames),
                    reach: reach.map_or(NO_IMAGE, |t| c.id(t).index()),
                    variance: c.id(target),
                    radiance: i.content.is_radiance().into(),
                    channels: i.content.variances(),
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }

    /// `images`: what is filtered, its variance, and what the first level writes.
    fn classify(
        &self,
        g: &mut FrameGraph,
        content: Content,
        [colour, error, first]: [WriteHandle<Image>; 3],
        tiles: WriteHandle<Buffer>,
        pass: &str,
    ) -> (Turns, Handle<Buffer>) {
        let kernel = self.kernels.classify;
        g.pass(pass, Queue::AsyncCompute, |p| {
            let (seen, seen_error) = (p.sample(colour.read()), p.sample(error.read()));
            let (tiles, found) = p.write_buffer(tiles);
            let (target, first) = p.write(first);
            let like = |format| ImageDesc::like(format, colour.read());
            let (spare, other) = p.create("colour", like(content.colour()));
            let (error_target, other_error) = p.create("variance", like(content.variance()));
            let (blurred, blurred_target) = p.create("blurred", like(content.variance()));
            let extent = p.extent(colour.read());
            let turns = Turns { colour, target, spare: Some(spare), error, error_target, blurred };
            ((turns, tiles.read()), move |c: &mut Record<'_>| {
                let tiles = c.id(found);
                let params = ClassifyParams {
                    tiles,
                    list: tiles.offset(size_of::<Tiles>() as u64),
                    size: [extent.width, extent.height],
                    colour: c.id(seen),
                    error: c.id(seen_error),
                    first: c.id(first),
                    other: c.id(other),
                    other_error: c.id(other_error),
                    blurred: c.id(blurred_target),
                    channels: content.variances(),
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }

    fn blur_variance(&self, g: &mut FrameGraph, work: Work<'_>, turns: Turns, pass: &str) -> Turns {
        let kernel = self.kernels.blur_variance;
        g.pass(pass, Queue::AsyncCompute, |p| {
            let (list, groups) = (p.read(work.tiles), p.indirect(work.tiles));
            let error = p.sample(turns.error.read());
            let (blurred, target) = p.write(turns.blurred);
            let extent = p.extent(turns.error.read());
            (Turns { blurred, ..turns }, move |c: &mut Record<'_>| {
                let params = BlurVarianceParams {
                    list: c.id(list).offset(size_of::<Tiles>() as u64),
                    size: [extent.width, extent.height],
                    error: c.id(error),
                    blurred: c.id(target),
                };
                c.dispatch_indirect(kernel, &params, groups, 0);
            })
        })
    }

    fn level(&self, g: &mut FrameGraph, work: Work<'_>, turns: Turns, level: u32, pass: &str) -> Turns {
        let (kernel, sigma, block, content) = (self.kernels.level, self.sigma, work.view.block, work.content);
        g.pass(pass, Queue::AsyncCompute, |p| {
            let (block, guide) = (p.read(block), p.sample(work.guide));
            let normals = work.normals.map(|h| p.sample(h));
            let (list, groups) = (p.read(work.tiles), p.indirect(work.tiles));
            let (colour, error) = (p.sample(turns.colour.read()), p.sample(turns.error.read()));
            let (blurred, reach) = (p.sample(turns.blurred.read()), work.reach.map(|h| p.sample(h)));
            let (filtered, target) = p.write(turns.target);
            let (filtered_error, error_target) = p.write(turns.error_target);
            // The first level reads what was accumulated and writes the history, the second reads that and leaves it as it is; from
            // there on two images take turns.
            let (target_after, spare) = match (level, turns.spare) {
                (0, Some(spare)) => (spare, Some(turns.colour)),
                (_, Some(spare)) => (spare, None),
                (_, None) => (turns.colour, None),
            };
            let turns = Turns {
                colour: filtered,
                target: target_after,
                spare,
                error: filtered_error,
                error_target: turns.error,
                blurred: turns.blurred,
            };
            (turns, move |c: &mut Record<'_>| {
                let params = LevelParams {
                    view: c.id(block),
                    list: c.id(list).offset(size_of::<Tiles>() as u64),
                    guide: c.id(guide),
                    normals: normals.map_or(NO_IMAGE, |t| c.id(t).index()),
                    colour: c.id(colour),
                    error: c.id(error),
                    blurred: c.id(blurred),
                    reach: reach.map_or(NO_IMAGE, |t| c.id(t).index()),
                    filtered: c.id(target),
                    filtered_error: c.id(error_target),
                    step: 1 << level,
                    radiance: content.is_radiance().into(),
                    channels: content.variances(),
                    sigma,
                };
                c.dispatch_indirect(kernel, &params, groups, 0);
            })
        })
    }
}
