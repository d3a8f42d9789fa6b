//! The denoiser `recurrent-blur`: what is blurred in one frame is the history of the next, and the longer the history the narrower the blur
//! (Zhdan 2021, "ReBLUR: A Hierarchical Recurrent Denoiser", Ray Tracing Gems II, chapter 49).
//!
//! The passes are `accumulate` → `mend_history` → `blur` → `post_blur`.
use super::inputs::{Before, Samples, TwoHistories, index_of};
use super::signal::{Packed, PackedWrite};
use super::{DenoiseIn, Options};
use magpie::gpu::Kernel;
use magpie::graph::{History, HistoryScope};
use magpie::prelude::*;
use magpie::slot::{Build, SlotError};
use magpie_shaders::denoise::{AccumulateBlurredParams, MendHistoryParams, NO_IMAGE, NoisyImage, RecurrentBlurParams};
use magpie_shaders::{DENOISE_ACCUMULATE_BLURRED_COMP, DENOISE_BLUR_COMP, DENOISE_MEND_HISTORY_COMP};

/// Format of the width of noise.
const WIDTH: Format = Format::R8Unorm;

/// The denoiser `recurrent-blur`.
pub struct RecurrentBlur {
    effect: &'static str,
    scope: HistoryScope,
    accumulate: Kernel,
    mend_history: Kernel,
    blur: Kernel,
    options: Options,
}

/// The mean over frames with the deviation of the samples.
#[derive(Clone, Copy)]
struct Accumulated {
    signal: Packed,
    frames: Handle<Image>,
    fast: Handle<Image>,
    /// Width of the noise.
    width: Option<Handle<Image>>,
}

/// The same where it is not out of date, with its own deviation.
#[derive(Clone, Copy)]
struct Mended {
    signal: Packed,
    frames: Handle<Image>,
}

/// What a blur is made of.
struct Blur {
    from: Packed,
    mended: Mended,
    accumulated: Accumulated,
    /// Of the last blur: the history of the next frame.
    next: Option<PackedWrite>,
}

impl RecurrentBlur {
    /// Creates the pipelines.
    pub fn new(build: &Build<'_>, effect: &'static str, options: Options) -> Result<Self, SlotError> {
        Ok(Self {
            effect,
            scope: HistoryScope::new(),
            accumulate: build.kernel(&DENOISE_ACCUMULATE_BLURRED_COMP)?,
            mend_history: build.kernel(&DENOISE_MEND_HISTORY_COMP)?,
            blur: build.kernel(&DENOISE_BLUR_COMP)?,
            options,
        })
    }

    /// Adds the passes. `name` is appended to their names and to those of the histories.
    pub fn add(&self, g: &mut FrameGraph, view: &View, i: DenoiseIn, name: &str) -> Handle<Image> {
        let pass = |step: &str| format!("{}.{step}{name}", self.effect);
        let packing = i.signal.content.packing(self.options.precision);
        let (signal, next) = packing.history(g, &self.scope, &format!("blurred{name}"), i.signal.image);
        let frames = ImageDesc::like(i.signal.content.counts(), i.signal.image);
        let History { previous: previous_frames, next: next_frames, .. } =
            g.history(&self.scope, format!("frames{name}"), frames);
        let before = |fast| Before { signal, frames: previous_frames, fast: Some(fast) };
        let accumulated = self.accumulate(g, view, i, &before, name);
        let mended = self.mend_history(g, view, i, accumulated, next_frames, &pass("mend_history"));
        let first = Blur { from: mended.signal, mended, accumulated, next: None };
        let (blurred, _) = self.blur(g, view, i, first, &pass("blur"));
        let last = Blur { from: blurred, mended, accumulated, next: Some(next) };
        self.blur(g, view, i, last, &pass("post_blur")).1
    }

    fn accumulate(
        &self,
        g: &mut FrameGraph,
        view: &View,
        i: DenoiseIn,
        before: &dyn Fn(Handle<Image>) -> Before,
        name: &str,
    ) -> Accumulated {
        let (kernel, options, content, noisy) = (self.accumulate, self.options, i.signal.content, i.signal.image);
        let packing = content.packing(options.precision);
        let History { previous: previous_fast, next: next_fast, .. } =
            g.history(&self.scope, format!("fast{name}"), ImageDesc::like(content.compared(options.precision), noisy));
        g.pass(&format!("{}.accumulate{name}", self.effect), Queue::AsyncCompute, |p| {
            let samples = Samples::declare(p, view, &i, packing.layout, TwoHistories::CHANNELS);
            let histories = TwoHistories::declare(p, &i, before(previous_fast));
            let gradient = i.hints.change.map(|change| p.sample(change));
            let (signal, target) = packing.create(p, "accumulated", noisy);
            let (counted, frames_target) = p.create("frames", ImageDesc::like(content.counts(), noisy));
            let (fast, fast_target) = p.write(next_fast);
            // The width of visibility is steady as it is.
            let is_steadied = i.hints.width.is_some() && content.depends_on_shading_normal();
            let (width, width_target) = is_steadied.then(|| p.create("width", ImageDesc::like(WIDTH, noisy))).unzip();
            let width = width.map_or(i.hints.width, |width| Some(width.read()));
            let accumulated = Accumulated { signal, frames: counted.read(), fast: fast.read(), width };
            (accumulated, move |c: &mut Record<'_>| {
                let (accumulated, accumulated_deviation) = target.ids(c);
                let [motion, taps] = samples.motion(c);
                let params = AccumulateBlurredParams {
                    view: samples.view(c),
                    not_finite: c.not_finite(),
                    noisy: samples.noisy(c),
                    motion,
                    taps,
                    history: histories.images(c, &samples),
                    gradient: index_of(c, gradient),
                    moved: i.hints.moved,
                    accumulated,
                    accumulated_deviation,
                    frames: c.id(frames_target),
                    fast: c.id(fast_target),
                    width: width_target.map_or(NO_IMAGE, |token| c.id(token).index()),
                    longest: options.history as f32,
                    fast_longest: options.fast_history as f32,
                    radius: options.radius as f32,
                    outliers: options.outliers,
                    greatest: packing.values.greatest(),
                };
                c.dispatch(kernel, &params, samples.extent);
            })
        })
    }

    fn mend_history(
        &self,
        g: &mut FrameGraph,
        view: &View,
        i: DenoiseIn,
        from: Accumulated,
        next_frames: WriteHandle<Image>,
        pass: &str,
    ) -> Mended {
        let (kernel, options, block, image) = (self.mend_history, self.options, view.block, i.signal.image);
        let packing = i.signal.content.packing(options.precision);
        g.pass(pass, Queue::AsyncCompute, |p| {
            let (block, guide) = (p.read(block), p.sample(i.surfaces.reprojected.guide));
            let normals = i.normals().map(|normals| p.sample(normals));
            let (signal, frames, fast) = (from.signal.sample(p), p.sample(from.frames), p.sample(from.fast));
            let (noisy, width) = (p.sample(image), from.width.map(|width| p.sample(width)));
            let (mended, target) = packing.create(p, "mended", image);
            let (mended_frames, frames_target) = p.write(next_frames);
            let extent = p.extent(image);
            (Mended { signal: mended, frames: mended_frames.read() }, move |c: &mut Record<'_>| {
                let (accumulated, accumulated_deviation) = signal.ids(c);
                let (mended, mended_deviation) = target.ids(c);
                let (width, samples) = (index_of(c, width), i.hints.samples());
                let params = MendHistoryParams {
                    view: c.id(block),
                    noisy: NoisyImage { image: c.id(noisy), width, samples, packing: packing.layout },
                    guide: c.id(guide),
                    normals: index_of(c, normals),
                    accumulated,
                    accumulated_deviation,
                    frames: c.id(frames),
                    fast: c.id(fast),
                    mended,
                    mended_deviation,
                    mended_frames: c.id(frames_target),
                    longest: options.history as f32,
                    fast_longest: options.fast_history as f32,
                    radius: options.radius as f32,
                    greatest: packing.values.greatest(),
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }

    /// Adds a blur. The last one returns the result, the first one what the last one blurs.
    fn blur(&self, g: &mut FrameGraph, view: &View, i: DenoiseIn, blur: Blur, pass: &str) -> (Packed, Handle<Image>) {
        let (kernel, options, block, image) = (self.blur, self.options, view.block, i.signal.image);
        let packing = i.signal.content.packing(options.precision);
        let result = i.signal.content.result(options.precision);
        let Blur { from, mended, accumulated, next } = blur;
        g.pass(pass, Queue::AsyncCompute, |p| {
            let (block, guide) = (p.read(block), p.sample(i.surfaces.reprojected.guide));
            let normals = i.normals().map(|normals| p.sample(normals));
            let width = accumulated.width.map(|width| p.sample(width));
            let (signal, frames) = (from.sample(p), p.sample(mended.frames));
            let is_last = next.is_some();
            let means = is_last.then(|| [mended.signal.sample(p), accumulated.signal.sample(p)]);
            let (blurred, target) = match next {
                Some(next) => next.write(p),
                None => packing.create(p, "blurred", image),
            };
            let (result, result_target) = is_last.then(|| p.create("result", ImageDesc::like(result, image))).unzip();
            let extent = p.extent(image);
            let result = result.map_or(blurred.values, |result| result.read());
            ((blurred, result), move |c: &mut Record<'_>| {
                let (signal, signal_deviation) = signal.ids(c);
                let (blurred, blurred_deviation) = target.ids(c);
                let means = means.map(|means| means.map(|image| image.ids(c)));
                let of = |k: usize| means.map_or([NO_IMAGE; 2], |means| [means[k].0.index(), means[k].1]);
                let ([mended, mended_deviation], [accumulated, accumulated_deviation]) = (of(0), of(1));
                let params = RecurrentBlurParams {
                    view: c.id(block),
                    guide: c.id(guide),
                    normals: index_of(c, normals),
                    signal,
                    signal_deviation,
                    frames: c.id(frames),
                    noise_width: index_of(c, width),
                    mended,
                    mended_deviation,
                    accumulated,
                    accumulated_deviation,
                    blurred,
                    blurred_deviation,
                    result: result_target.map_or(NO_IMAGE, |token| c.id(token).index()),
                    longest: options.history as f32,
                    fast_longest: options.fast_history as f32,
                    radius: options.radius as f32,
                    sigma: options.sigma,
                    packing: packing.layout,
                    greatest: packing.values.greatest(),
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }
}
