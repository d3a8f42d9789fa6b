//! The hint [`Hints::change`](super::Hints::change) from changes of single pixels.
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::slot::{Build, SlotError};
use magpie_shaders::denoise::{BlurGradientParams, GRADIENT_STRATUM};
use magpie_shaders::{DENOISE_BLUR_GRADIENT_COMP, DENOISE_SUM_GRADIENT_COMP};

/// Number of blurs: over 5x5 texels, then 9x9. Their images have a third of the frame's width and height.
const BLURS: u32 = 2;

/// Size of an image with a texel for each square of pixels, one of which tells what has changed, in a frame of this size.
pub fn squares(frame: Extent) -> Extent {
    Extent::new(frame.width.div_ceil(GRADIENT_STRATUM), frame.height.div_ceil(GRADIENT_STRATUM))
}

/// The image in which a frame stores a surface for each square, in two texels (`remember` of `lib/gradient.glsl`).
pub fn surfaces(frame: Extent) -> ImageDesc {
    let Extent { width, height } = squares(frame);
    ImageDesc::fixed(Format::Rg32Uint, Extent::new(2 * width, height))
}

/// Turns changes of single pixels into the share of the history to discard.
#[derive(Clone, Copy)]
pub struct Changes {
    kernel: Kernel,
    /// Second part of the names of the passes.
    pass: &'static str,
    /// Of the result; `None` for that of the changes.
    format: Option<Format>,
}

impl Changes {
    /// Creates the pipeline for changes, 0 to 1 per channel, that are 0 where nothing changes.
    pub fn new(build: &Build<'_>) -> Result<Self, SlotError> {
        Ok(Self { kernel: build.kernel(&DENOISE_BLUR_GRADIENT_COMP)?, pass: "blur_gradient", format: None })
    }

    /// Creates the pipeline for changes with noise, which cancels in their sum. In RGBA32F: the change, its square, what it is a change of, and the change
    /// without its sign.
    pub fn noisy(build: &Build<'_>) -> Result<Self, SlotError> {
        let kernel = build.kernel(&DENOISE_SUM_GRADIENT_COMP)?;
        Ok(Self { kernel, pass: "sum_gradient", format: Some(Format::R16Float) })
    }

    /// Adds the passes `EFFECT.blur_gradient_0` or `EFFECT.sum_gradient_0` and so on. `change`: of one pixel out of each 3x3, in the size of [`squares`].
    /// `name` is appended to the names of the passes.
    pub fn add(self, g: &mut FrameGraph, change: Handle<Image>, effect: &str, name: &str) -> Handle<Image> {
        let pass = |blur| format!("{effect}.{}_{blur}{name}", self.pass);
        (0..BLURS).fold(change, |change, blur| self.blur(g, change, blur, &pass(blur)))
    }

    fn blur(self, g: &mut FrameGraph, change: Handle<Image>, blur: u32, pass: &str) -> Handle<Image> {
        let is_last = blur + 1 == BLURS;
        g.pass(pass, Queue::AsyncCompute, |p| {
            let change_read = p.sample(change);
            let format = self.format.filter(|_| is_last).unwrap_or(p.desc(change).format);
            let (blurred, target) = p.create("blurred", ImageDesc::like(format, change));
            let extent = p.extent(change);
            (blurred.read(), move |c: &mut Record<'_>| {
                let params = BlurGradientParams {
                    size: [extent.width, extent.height],
                    change: c.id(change_read),
                    blurred: c.id(target),
                    step: 1 << blur,
                    is_last: is_last.into(),
                };
                c.dispatch(self.kernel, &params, extent);
            })
        })
    }
}
