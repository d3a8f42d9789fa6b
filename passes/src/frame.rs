//! The whole frame on one screen: read this first.
use crate::slots::Slots;
use crate::stages::{
    ComposeIn, DirectIn, DirectOut, GBuffer, GBufferIn, IndirectIn, IndirectOut, PostIn, PostOut, SceneHandles,
    ShadowIn, ShadowOut, SkyIn,
};
use magpie::config::Config;
use magpie::prelude::*;
use magpie::stage::{BoxedEffect, Build, StageError};

/// One implementation in every slot.
pub struct Stages {
    gbuffer: BoxedEffect<GBufferIn, GBuffer>,
    shadows: BoxedEffect<ShadowIn, ShadowOut>,
    direct: BoxedEffect<DirectIn, DirectOut>,
    gi: BoxedEffect<IndirectIn, IndirectOut>,
    reflections: BoxedEffect<IndirectIn, IndirectOut>,
    compose: BoxedEffect<ComposeIn, WriteHandle<Image>>,
    sky: BoxedEffect<SkyIn, Handle<Image>>,
    post: BoxedEffect<PostIn, PostOut>,
}

/// What a frame is made for.
#[derive(Clone, Copy, Debug)]
pub struct FrameOut {
    /// Linear radiance before the tone map, RGBA32F.
    pub radiance: Handle<Image>,
    /// What a display shows, RGBA8.
    pub display: Handle<Image>,
}

/// Declares the frame. Data flow is ordinary Rust: outputs of one stage are inputs of the next.
pub fn frame(stages: &mut Stages, g: &mut FrameGraph, view: &View, scene: SceneHandles) -> FrameOut {
    let gbuffer = stages.gbuffer.add(g, view, GBufferIn { scene });
    let shadows = stages.shadows.add(g, view, ShadowIn { scene, gbuffer });
    let direct = stages.direct.add(g, view, DirectIn { scene, gbuffer, shadows });
    let gi = stages.gi.add(g, view, IndirectIn { gbuffer });
    let reflections = stages.reflections.add(g, view, IndirectIn { gbuffer });
    let lit = stages.compose.add(g, view, ComposeIn { direct, gi, reflections });
    let radiance = stages.sky.add(g, view, SkyIn { depth: gbuffer.depth, lit });
    let post = stages.post.add(g, view, PostIn { colour: radiance });
    FrameOut { radiance, display: post.display }
}

impl Stages {
    /// Fills every slot with the implementation that `config` names.
    ///
    /// # Errors
    /// [`StageError`] for an unknown name or setting, or a pipeline that cannot be made.
    pub fn new(gpu: &Gpu, slots: &Slots, config: &Config) -> Result<Self, StageError> {
        let build = Build { gpu };
        Ok(Self {
            gbuffer: slots.gbuffer.from_config(&build, config)?,
            shadows: slots.shadows.from_config(&build, config)?,
            direct: slots.direct.from_config(&build, config)?,
            gi: slots.gi.from_config(&build, config)?,
            reflections: slots.reflections.from_config(&build, config)?,
            compose: slots.compose.from_config(&build, config)?,
            sky: slots.sky.from_config(&build, config)?,
            post: slots.post.from_config(&build, config)?,
        })
    }
}
