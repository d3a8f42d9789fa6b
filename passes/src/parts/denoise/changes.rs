//! The hint [`Hints::change`](super::Hints::change) from changes of single pixels.
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::slot::{Build, SlotError};
use magpie_shaders::denoise::{BlurGradientParams, SumGradientParams};
use magpie_shaders::{DENOISE_BLUR_GRADIENT_COMP, DENOISE_SUM_GRADIENT_COMP};

/// Number of blurs: over 5x5 texels, then 9x9. Their images have a third of the frame's width and height.
const BLURS: u32 = 2;

/// Turns changes of single pixels into the share of the history to discard.
#[derive(Clone, Copy)]
pub struct Changes(Kernel);

impl Changes {
    /// Creates the pipeline.
    pub fn new(build: &Build<'_>) -> Result<Self, SlotError> {
        Ok(Self(build.kernel(&DENOISE_BLUR_GRADIENT_COMP)?))
    }

    /// Adds the blurs `EFFECT.blur_gradient_0` and so on. `change`: of one pixel out of each 3x3, 0 to 1 per channel: an image of a third of the width and
    /// height, rounded up. `name` is appended to the names of the passes.
    pub fn add(self, g: &mut FrameGraph, change: Handle<Image>, effect: &str, name: &str) -> Handle<Image> {
        let pass = |blur| format!("{effect}.blur_gradient_{blur}{name}");
        (0..BLURS).fold(change, |change, blur| self.blur(g, change, blur, &pass(blur)))
    }

    fn blur(self, g: &mut FrameGraph, change: Handle<Image>, blur: u32, pass: &str) -> Handle<Image> {
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
                    is_last: (blur + 1 == BLURS).into(),
                };
                c.dispatch(self.0, &params, extent);
            })
        })
    }
}

/// The same for changes with noise, which cancels in their sum.
#[derive(Clone, Copy)]
pub struct NoisyChanges(Kernel);

impl NoisyChanges {
    /// Creates the pipeline.
    pub fn new(build: &Build<'_>) -> Result<Self, SlotError> {
        Ok(Self(build.kernel(&DENOISE_SUM_GRADIENT_COMP)?))
    }

    /// Adds the sums `EFFECT.sum_gradient_0` and so on. `change`, RGBA32F, of one pixel out of each 3x3: its change, the square of that, what it is a change
    /// of, and the change without its sign.
    pub fn add(self, g: &mut FrameGraph, change: Handle<Image>, effect: &str) -> Handle<Image> {
        (0..BLURS).fold(change, |change, step| self.sum(g, change, step, &format!("{effect}.sum_gradient_{step}")))
    }

    fn sum(self, g: &mut FrameGraph, change: Handle<Image>, step: u32, pass: &str) -> Handle<Image> {
        let is_last = step + 1 == BLURS;
        g.pass(pass, Queue::AsyncCompute, |p| {
            let change_read = p.sample(change);
            let format = if is_last { Format::R16Float } else { p.desc(change).format };
            let (sum, target) = p.create("sum", ImageDesc::like(format, change));
            let extent = p.extent(change);
            (sum.read(), move |c: &mut Record<'_>| {
                let params = SumGradientParams {
                    size: [extent.width, extent.height],
                    change: c.id(change_read),
                    sum: c.id(target),
                    step: 1 << step,
                    is_last: is_last.into(),
                };
                c.dispatch(self.0, &params, extent);
            })
        })
    }
}
