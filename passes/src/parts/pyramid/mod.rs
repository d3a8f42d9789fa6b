//! Image pyramids: minima and maxima, as rays through the depth image step over, or means.
use magpie::gpu::Kernel;
use magpie::graph::Part;
use magpie::prelude::*;
use magpie::slot::{Build, SlotError};
use magpie_shaders::PYRAMID_REDUCE_COMP;
use magpie_shaders::pyramid::{PYRAMID_FIRST_MIN_MAX, PYRAMID_LEVELS, PYRAMID_MEAN, PYRAMID_MIN_MAX, PyramidParams};

/// What a pixel of a level holds of those below it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Content {
    /// The least value in red and the greatest in green, of an image of one channel. RG32F.
    MinMax,
    /// The mean of all channels, RGBA16F.
    Mean,
}

/// Makes pyramids for an effect. The passes are called `SLOT.pyramid_K`, after the first level that each makes.
pub struct Pyramid {
    kernel: Kernel,
    slot: &'static str,
    content: Content,
}

impl Pyramid {
    /// Most levels of a pyramid.
    pub const MAX_LEVELS: u32 = 8;

    /// Describes the pipeline for the effect in `slot`.
    ///
    /// # Errors
    /// None of its own.
    pub fn new(build: &Build<'_>, slot: &'static str, content: Content) -> Result<Self, SlotError> {
        Ok(Self { kernel: build.kernel(&PYRAMID_REDUCE_COMP)?, slot, content })
    }

    /// Size of the first level over an image: half of it, rounded up to a multiple of 2^(`levels` - 1), so that each pixel of a level stands for
    /// exactly four of the level below.
    #[must_use]
    pub fn extent(image: Extent, levels: u32) -> Extent {
        let unit = 1 << (levels - 1);
        let side = |n: u32| n.div_ceil(2).next_multiple_of(unit);
        Extent::new(side(image.width), side(image.height))
    }

    /// Adds the passes. The result has `levels` mips, 1 to [`Pyramid::MAX_LEVELS`]; mip k is level k + 1, and its pixel (x, y) covers the pixels of
    /// `image` from (x, y) · 2^(k+1) on. Beyond its border the image counts as going on with the nearest pixel.
    pub fn add(&self, g: &mut FrameGraph, image: Handle<Image>, levels: u32) -> Handle<Image> {
        let levels = levels.clamp(1, Self::MAX_LEVELS);
        let source_size = g.extent(image);
        let extent = Self::extent(source_size, levels);
        let format = match self.content {
            Content::MinMax => Format::Rg32Float,
            Content::Mean => Format::Rgba16Float,
        };
        let desc = ImageDesc { mips: levels, ..ImageDesc::fixed(format, extent) };
        let mut made = self.reduce(g, Source { image, mip: None, extent: source_size }, Target::New(desc), levels);
        for first in (PYRAMID_LEVELS..levels).step_by(PYRAMID_LEVELS as usize) {
            let source = Source { image: made.read(), mip: Some(first - 1), extent: extent.mip(first - 1) };
            made = self.reduce(g, source, Target::Next(made), levels);
        }
        made.read()
    }

    /// Adds one pass, which makes up to four levels.
    fn reduce(&self, g: &mut FrameGraph, source: Source, target: Target, levels: u32) -> WriteHandle<Image> {
        let (kernel, first) = (self.kernel, source.mip.map_or(0, |mip| mip + 1));
        let count = (levels - first).min(PYRAMID_LEVELS);
        let content = match (self.content, source.mip) {
            (Content::MinMax, None) => PYRAMID_FIRST_MIN_MAX,
            (Content::MinMax, Some(_)) => PYRAMID_MIN_MAX,
            (Content::Mean, _) => PYRAMID_MEAN,
        };
        g.pass(&format!("{}.pyramid_{first}", self.slot), Queue::AsyncCompute, |p| {
            let from = match source.mip {
                None => p.sample(source.image),
                Some(mip) => p.sample_part(source.image, Part::mip(mip)),
            };
            let (mut made, token, extent) = match target {
                Target::New(desc) => {
                    let (made, token) = p.create_part("pyramid", desc, Part::mip(0));
                    (made, token, p.extent_of(desc))
                }
                Target::Next(made) => {
                    let extent = p.extent(made.read()).mip(first);
                    let (made, token) = p.write_part(made, Part::mip(first));
                    (made, token, extent)
                }
            };
            let mut tokens = vec![token];
            for level in first + 1..first + count {
                let (next, token) = p.write_part(made, Part::mip(level));
                made = next;
                tokens.push(token);
            }
            (made, move |c: &mut Record<'_>| {
                let mut params = PyramidParams {
                    source: c.id(from),
                    source_mip: 0,
                    source_size: [source.extent.width, source.extent.height],
                    content,
                    count,
                    size: [extent.width, extent.height],
                    ..PyramidParams::default()
                };
                for (level, token) in params.levels.iter_mut().zip(&tokens) {
                    *level = c.id(*token);
                }
                c.dispatch(kernel, &params, extent);
            })
        })
    }
}

/// What a pass reduces.
struct Source {
    image: Handle<Image>,
    /// The mip of a pyramid; `None` for the image that it is made of.
    mip: Option<u32>,
    /// Size of that, pixels.
    extent: Extent,
}

/// Where a pass writes.
enum Target {
    /// A pyramid with this description, from its first mip on.
    New(ImageDesc),
    /// This pyramid.
    Next(WriteHandle<Image>),
}
