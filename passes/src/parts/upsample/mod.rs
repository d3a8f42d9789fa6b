//! Upsampling from half to full resolution, along surfaces.
use crate::contracts::{GBuffer, GEOMETRY};
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::slot::{Build, SlotError};
use magpie_shaders::UPSAMPLE_JOINT_BILATERAL_COMP;
use magpie_shaders::upsample::{NO_DIRECTION, UpsampleParams};

/// Upsamples images of an effect. A pass is called `SLOT.upsample`.
pub struct Upsample {
    kernel: Kernel,
    slot: &'static str,
}

/// What is upsampled.
#[derive(Clone, Copy, Debug)]
pub struct UpsampleIn {
    /// Image of half the frame's size, a texel for the upper left one of four pixels. If [`UpsampleIn::direction`] is wanted: a direction in
    /// red to blue, of any length, and the value in alpha.
    pub half_size: Handle<Image>,
    /// The surfaces.
    pub gbuffer: GBuffer,
    /// Name and format of the value at full size.
    pub value: (&'static str, Format),
    /// Name and format of the octahedral direction at full size, if there is one.
    pub direction: Option<(&'static str, Format)>,
    /// The value where no surface is seen.
    pub background: f32,
}

/// Images of the frame's size.
#[derive(Clone, Copy, Debug)]
pub struct Upsampled {
    /// The value.
    pub value: Handle<Image>,
    /// The octahedral direction, if there is one.
    pub direction: Option<Handle<Image>>,
}

impl Upsample {
    /// Describes the pipeline for the effect in `slot`.
    ///
    /// # Errors
    /// None of its own.
    pub fn new(build: &Build<'_>, slot: &'static str) -> Result<Self, SlotError> {
        Ok(Self { kernel: build.kernel(&UPSAMPLE_JOINT_BILATERAL_COMP)?, slot })
    }

    /// Adds the pass. `suffix` goes after its name, for effects that upsample several images.
    pub fn add(&self, g: &mut FrameGraph, view: &View, i: UpsampleIn, suffix: &str) -> Upsampled {
        let (kernel, block) = (self.kernel, view.block);
        g.pass(&format!("{}.upsample{suffix}", self.slot), Queue::AsyncCompute, |p| {
            let (block, half_size) = (p.read(block), p.sample(i.half_size));
            let gbuffer = i.gbuffer.read(p, GEOMETRY);
            let mut create = |(name, format)| p.create(name, ImageDesc::like(format, i.gbuffer.depth));
            let (value, value_target) = create(i.value);
            let (direction, direction_target) = i.direction.map(create).unzip();
            let extent = p.extent(i.gbuffer.depth);
            let made = Upsampled { value: value.read(), direction: direction.map(|image| image.read()) };
            (made, move |c: &mut Record<'_>| {
                let params = UpsampleParams {
                    view: c.id(block),
                    gbuffer: gbuffer.images(c),
                    half_size: c.id(half_size),
                    value: c.id(value_target),
                    direction: direction_target.map_or(NO_DIRECTION, |target| c.id(target).index()),
                    background: i.background,
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }
}
