//! How much the light of lamps has changed since the previous frame, for denoisers with a history.
use crate::contracts::{Channel, DirectIn};
use crate::parts::denoise::{Changes, follows_light, squares};
use magpie::gpu::Kernel;
use magpie::graph::HistoryScope;
use magpie::prelude::*;
use magpie::slot::{Build, Settings, SlotError};
use magpie_shaders::DIRECT_LIGHT_CHANGE_COMP;
use magpie_shaders::direct::LightChangeParams;

const READ: &[Channel] = &[Channel::Depth, Channel::Normal, Channel::Ids, Channel::Motion];

/// Compares lamps with what they were, in one pixel of nine.
pub struct LightChange {
    /// None where the denoiser asks for nothing.
    kernels: Option<(Kernel, Changes)>,
    scope: HistoryScope,
}

impl LightChange {
    /// Creates the pipeline.
    pub fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        let kernels = if follows_light(settings)? {
            Some((build.kernel(&DIRECT_LIGHT_CHANGE_COMP)?, Changes::new(build)?))
        } else {
            None
        };
        Ok(Self { kernels, scope: HistoryScope::new() })
    }

    /// Adds the passes. Returns [`Hints::change`](crate::parts::denoise::Hints::change), in scenes with a light tree.
    pub fn add(&self, g: &mut FrameGraph, view: &View, i: DirectIn) -> Option<Handle<Image>> {
        let ((kernel, changes), lights, tree) = (self.kernels?, i.scene.lights?, i.scene.light_tree?);
        let extent = squares(g.extent(i.gbuffer.depth));
        let drawn = g.history(&self.scope, "drawn".to_owned(), ImageDesc::fixed(Format::Rg32Uint, extent));
        let block = view.block;
        let change = g.pass("direct.light_change", Queue::AsyncCompute, |p| {
            let (block, scene) = (p.read(block), i.scene.read(p));
            let (lights, tree) = (p.read(lights), p.read(tree));
            let gbuffer = i.gbuffer.read(p, READ);
            let previous = p.sample(drawn.previous);
            let (_, drawn_target) = p.write(drawn.next);
            let (change, target) = p.create("change", ImageDesc::fixed(Format::R8Unorm, extent));
            (change.read(), move |c: &mut Record<'_>| {
                let params = LightChangeParams {
                    view: c.id(block),
                    scene: c.id(scene),
                    lights: c.id(lights),
                    tree: c.id(tree),
                    gbuffer: gbuffer.images(c),
                    previous: c.id(previous),
                    drawn: c.id(drawn_target),
                    change: c.id(target),
                    valid: drawn.valid.into(),
                };
                c.dispatch(kernel, &params, extent);
            })
        });
        Some(changes.add(g, change, "direct", ""))
    }
}
