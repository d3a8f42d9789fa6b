//! Lobes as cones: mirror reflections, blurred into a pyramid whose levels stand for widths of cones.
use crate::contracts::{Channel, LightingIn};
use magpie::gpu::Kernel;
use magpie::graph::Part;
use magpie::prelude::*;
use magpie::slot::{Build, Settings, SlotError};
use magpie_shaders::denoise::NO_IMAGE;
use magpie_shaders::screen_reflections::{BlurParams, ConeParams};
use magpie_shaders::{REFLECTIONS_BLUR_COMP, REFLECTIONS_CONE_COMP};

/// Most levels of the pyramid: the widest has a standard deviation of 44 pixels.
const LEVELS: u32 = 6;
/// What the cone of a pixel is computed from.
const SURFACE: &[Channel] =
    &[Channel::Depth, Channel::Normal, Channel::GeometricNormal, Channel::BaseColour, Channel::Material, Channel::Coat];

/// The blurred reflections.
pub struct Cone {
    blur: Kernel,
    gather: Kernel,
    /// The blur stays on surfaces.
    is_guided: bool,
    xi: f32,
    format: Format,
}

/// What all passes of a frame get.
#[derive(Clone, Copy)]
pub struct Frame<'a> {
    /// The view.
    pub view: &'a View,
    /// What the effect was given.
    pub i: LightingIn,
}

/// A level of the pyramid, or the sharp reflection: what a blur reads.
#[derive(Clone, Copy)]
struct Level {
    image: Handle<Image>,
    /// `None` for an image without others.
    mip: Option<u32>,
    extent: Extent,
    /// How often it was halved along x and y.
    halved: [u32; 2],
    /// Where it is not in alpha.
    confidence: Option<Handle<Image>>,
}

impl Cone {
    /// Creates the pipelines.
    pub fn new(build: &Build<'_>, settings: &Settings, format: Format) -> Result<Self, SlotError> {
        Ok(Self {
            blur: build.kernel(&REFLECTIONS_BLUR_COMP)?,
            gather: build.kernel(&REFLECTIONS_CONE_COMP)?,
            is_guided: settings.choice("blur")? == "bilateral",
            xi: settings.f32("xi")?,
            format,
        })
    }

    /// Adds the passes. `sharp`: radiance, confidence and hit distance of mirror rays. The result is radiance times confidence, and
    /// confidence in the format given.
    pub fn add(
        &self,
        g: &mut FrameGraph,
        of: Frame<'_>,
        sharp: [Handle<Image>; 3],
        confidence: Format,
    ) -> [Handle<Image>; 2] {
        let extent = g.extent(sharp[0]);
        // A level has two pixels at least along the shorter axis.
        let levels = extent.width.min(extent.height).ilog2().clamp(1, LEVELS);
        let mips = extent_after(extent, [1, 1]);
        let desc = ImageDesc { mips: levels, ..ImageDesc::fixed(self.format, mips) };
        let first = Level { image: sharp[0], mip: None, extent, halved: [0; 2], confidence: Some(sharp[1]) };
        let mut pyramid = self.halve(g, of, first, Target::New(desc));
        for level in 1..levels {
            let (image, mip) = (pyramid.read(), Some(level - 1));
            let source = Level { image, mip, extent: mips.mip(level - 1), halved: [level; 2], confidence: None };
            pyramid = self.halve(g, of, source, Target::Next(pyramid, level));
        }
        self.gather(g, of, sharp, (pyramid.read(), levels), confidence)
    }

    /// Adds a level: one pass across, one down.
    fn halve(&self, g: &mut FrameGraph, of: Frame<'_>, source: Level, target: Target) -> WriteHandle<Image> {
        let number = source.halved[0];
        let mip = match &target {
            Target::New(desc) => g.extent_of(*desc),
            Target::Next(image, level) => g.extent(image.read()).mip(*level),
        };
        let across = Extent::new(mip.width, source.extent.height);
        let desc = ImageDesc::fixed(self.format, across);
        let half = self.blur(g, of, &format!("reflections.blur_{number}_across"), source, Target::New(desc));
        let halved = [number + 1, number];
        let source = Level { image: half.read(), mip: None, extent: across, halved, confidence: None };
        self.blur(g, of, &format!("reflections.blur_{number}_down"), source, target)
    }

    /// Adds one axis of a level.
    fn blur(&self, g: &mut FrameGraph, of: Frame<'_>, name: &str, source: Level, target: Target) -> WriteHandle<Image> {
        let (kernel, block, format) = (self.blur, of.view.block, self.format);
        let guide = self.is_guided.then_some(of.i.reprojected.guide);
        // Across first.
        let axis = u32::from(source.halved[0] > source.halved[1]);
        g.pass(name, Queue::AsyncCompute, |p| {
            let (block, guide) = (p.read(block), guide.map(|image| p.sample(image)));
            let from = match source.mip {
                None => p.sample(source.image),
                Some(mip) => p.sample_part(source.image, Part::mip(mip)),
            };
            let confidence = source.confidence.map(|image| p.sample(image));
            let (made, token, extent) = match target {
                Target::New(desc) => {
                    let (made, token) = p.create_part("blurred", desc, Part::mip(0));
                    (made, token, p.extent_of(desc))
                }
                Target::Next(made, level) => {
                    let extent = p.extent(made.read()).mip(level);
                    let (made, token) = p.write_part(made, Part::mip(level));
                    (made, token, extent)
                }
            };
            (made, move |c: &mut Record<'_>| {
                let params = BlurParams {
                    view: c.id(block),
                    not_finite: c.not_finite(),
                    guide: guide.map_or(NO_IMAGE, |token| c.id(token).index()),
                    source: c.id(from),
                    source_mip: 0,
                    confidence: confidence.map_or(NO_IMAGE, |token| c.id(token).index()),
                    source_size: [source.extent.width, source.extent.height],
                    halved: source.halved,
                    axis,
                    blurred: c.id(token),
                    size: [extent.width, extent.height],
                    greatest: format.greatest(),
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }

    /// Adds the pass that reads each pixel's level.
    fn gather(
        &self,
        g: &mut FrameGraph,
        of: Frame<'_>,
        sharp: [Handle<Image>; 3],
        (pyramid, levels): (Handle<Image>, u32),
        confidence: Format,
    ) -> [Handle<Image>; 2] {
        let (kernel, block, format, xi) = (self.gather, of.view.block, self.format, self.xi);
        let guide = self.is_guided.then_some(of.i.reprojected.guide);
        g.pass("reflections.cone", Queue::AsyncCompute, |p| {
            let (block, guide) = (p.read(block), guide.map(|image| p.sample(image)));
            let gbuffer = of.i.gbuffer.read(p, SURFACE);
            let (sharp, blurred) = (sharp.map(|image| p.sample(image)), p.sample(pyramid));
            let (radiance, target) = p.create("radiance", ImageDesc::like(format, of.i.gbuffer.depth));
            let (found, found_target) = p.create("confidence", ImageDesc::like(confidence, of.i.gbuffer.depth));
            let extent = p.extent(of.i.gbuffer.depth);
            ([radiance.read(), found.read()], move |c: &mut Record<'_>| {
                let [sharp, confidence, hit_distance] = sharp.map(|token| c.id(token));
                let params = ConeParams {
                    view: c.id(block),
                    gbuffer: gbuffer.images(c),
                    sharp,
                    confidence,
                    hit_distance,
                    blurred: c.id(blurred),
                    guide: guide.map_or(NO_IMAGE, |token| c.id(token).index()),
                    levels,
                    xi,
                    radiance: c.id(target),
                    blurred_confidence: c.id(found_target),
                    greatest: format.greatest(),
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }
}

/// Where a blur writes.
enum Target {
    /// The first mip of an image with this description.
    New(ImageDesc),
    /// This mip of an image.
    Next(WriteHandle<Image>, u32),
}

/// An extent halved this often along each axis, rounded up.
fn extent_after(extent: Extent, halved: [u32; 2]) -> Extent {
    let side = |n: u32, times: u32| n.div_ceil(1 << times);
    Extent::new(side(extent.width, halved[0]), side(extent.height, halved[1]))
}
