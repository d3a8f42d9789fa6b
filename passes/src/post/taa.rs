//! Temporal anti-aliasing and upsampling: the mean of jittered frames, reprojected along motion vectors.
use super::filters::bilinear;
use crate::contracts::{Channel, Seen};
use magpie::gpu::Kernel;
use magpie::graph::HistoryScope;
use magpie::prelude::*;
use magpie::slot::{Build, SlotError};
use magpie_shaders::denoise::NO_IMAGE;
use magpie_shaders::post::TaaParams;
use magpie_shaders::{POST_TAA_COMP, SamplerId};

/// Temporal anti-aliasing.
pub struct Taa {
    kernel: Kernel,
    sampler: SamplerId,
    /// Factor before the tone curve.
    exposure: f32,
    scope: HistoryScope,
}

impl Taa {
    /// Creates the pipeline. `exposure` is the factor before the tone curve.
    pub fn new(build: &Build<'_>, exposure: f32) -> Result<Self, SlotError> {
        let kernel = build.kernel(&POST_TAA_COMP)?;
        Ok(Self { kernel, sampler: bilinear(build)?, exposure, scope: HistoryScope::new() })
    }

    /// Adds the pass. The result has the size of the output.
    pub fn add(&self, g: &mut FrameGraph, view: &View, colour: Handle<Image>, seen: Seen) -> Handle<Image> {
        let Self { kernel, sampler, exposure, .. } = *self;
        let (block, output) = (view.block, view.output);
        let mut history = |name, format| g.history(&self.scope, name, ImageDesc::fixed(format, output));
        // In 16-bit floats the 64th sample would change the mean by less than their precision.
        let picture = history("radiance", Format::Rgba32Float);
        let moments = history("moments", Format::Rgba16Float);
        let fast = history("fast_moments", Format::Rgba16Float);
        let surfaces = history("surfaces", Format::Rg32Uint);
        // What stood still and then moves on leaves a history that looks like that of what is now there.
        let movers = view.facts.instances_move.then(|| history("movers", Format::R32Uint));
        let valid = picture.valid
            && moments.valid
            && fast.valid
            && surfaces.valid
            && movers.as_ref().is_none_or(|movers| movers.valid);
        g.pass("post.taa", Queue::Graphics, |p| {
            let (block, scene, colour) = (p.read(block), seen.scene.read(p), p.sample(colour));
            let gbuffer = seen.gbuffer.read(p, &[Channel::Depth, Channel::Motion, Channel::Ids]);
            let before = [
                p.sample(picture.previous),
                p.sample(moments.previous),
                p.sample(fast.previous),
                p.sample(surfaces.previous),
            ];
            let movers = movers.map(|movers| (p.sample(movers.previous), p.write(movers.next).1));
            let (picture, target) = p.write(picture.next);
            let (_, next_moments) = p.write(moments.next);
            let (_, next_fast) = p.write(fast.next);
            let (_, next_surfaces) = p.write(surfaces.next);
            (picture.read(), move |c: &mut Record<'_>| {
                let params = TaaParams {
                    view: c.id(block),
                    scene: c.id(scene),
                    not_finite: c.not_finite(),
                    colour: c.id(colour),
                    gbuffer: gbuffer.images(c),
                    picture: c.id(before[0]),
                    moments: c.id(before[1]),
                    fast_moments: c.id(before[2]),
                    surfaces: c.id(before[3]),
                    movers: movers.map_or(NO_IMAGE, |(previous, _)| c.id(previous).index()),
                    next_picture: c.id(target),
                    next_moments: c.id(next_moments),
                    next_fast_moments: c.id(next_fast),
                    next_surfaces: c.id(next_surfaces),
                    next_movers: movers.map_or(NO_IMAGE, |(_, next)| c.id(next).index()),
                    sampler_id: sampler,
                    valid: valid.into(),
                    exposure,
                };
                c.dispatch(kernel, &params, output);
            })
        })
    }
}
