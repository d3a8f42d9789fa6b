//! The whole frame on one screen: read this first.
use crate::contract::Slotted;
use crate::denoise::Reprojection;
use crate::slots::Slots;
use crate::stages::{
    AccelerationIn, AoIn, AoOut, ComposeIn, DirectIn, DirectOut, GBuffer, GBufferIn, IndirectIn, IndirectOut, PostIn,
    PostOut, RaysIn, RaysOut, SceneHandles, Seen, ShadowIn, ShadowOut, SkyIn,
};
use magpie::config::Config;
use magpie::prelude::*;
use magpie::scene::ResidentError;
use magpie::stage::{Build, Filled, StageError};

/// One implementation in every slot.
pub struct Stages {
    acceleration: Filled<AccelerationIn, Result<SceneHandles, ResidentError>>,
    rays: Filled<RaysIn, RaysOut>,
    gbuffer: Filled<GBufferIn, GBuffer>,
    reprojection: Reprojection,
    shadows: Filled<ShadowIn, ShadowOut>,
    ao: Filled<AoIn, AoOut>,
    direct: Filled<DirectIn, DirectOut>,
    gi: Filled<IndirectIn, IndirectOut>,
    reflections: Filled<IndirectIn, IndirectOut>,
    compose: Filled<ComposeIn, WriteHandle<Image>>,
    sky: Filled<SkyIn, Handle<Image>>,
    post: Filled<PostIn, PostOut>,
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
///
/// # Errors
/// [`ResidentError`] where the scene could not be brought up to date.
pub fn frame(
    stages: &mut Stages,
    g: &mut FrameGraph,
    view: &View,
    scene: AccelerationIn,
) -> Result<FrameOut, ResidentError> {
    let scene = stages.acceleration.add(g, view, scene)?;
    stages.rays.give(g, view, RaysIn { scene }); // for looking at, and culled when nobody does
    let gbuffer = stages.gbuffer.give(g, view, GBufferIn { scene });
    let reprojected = stages.reprojection.add(g, view, (scene, gbuffer)); // for denoisers, and culled when there are none
    let shadows = stages.shadows.give(g, view, ShadowIn { scene, gbuffer, reprojected });
    let ao = stages.ao.give(g, view, AoIn { scene, gbuffer, reprojected });
    let direct = stages.direct.give(g, view, DirectIn { scene, gbuffer, reprojected, shadows });
    let gi = stages.gi.give(g, view, IndirectIn { gbuffer, ao });
    let reflections = stages.reflections.give(g, view, IndirectIn { gbuffer, ao });
    let lit = stages.compose.give(g, view, ComposeIn { direct, gi, reflections });
    let radiance = stages.sky.give(g, view, SkyIn { depth: gbuffer.depth, lit });
    let post = stages.post.give(g, view, PostIn { colour: radiance, seen: Some(Seen { scene, gbuffer }) });
    Ok(FrameOut { radiance: post.radiance, display: post.display })
}

impl Stages {
    /// Fills every slot with the implementation that `config` names.
    ///
    /// # Errors
    /// [`StageError`] for an unknown name or setting, or a pipeline that cannot be made.
    pub fn new(build: &Build<'_>, slots: &Slots, config: &Config) -> Result<Self, StageError> {
        Ok(Self {
            acceleration: slots.acceleration.from_config(build, config)?,
            rays: slots.rays.from_config(build, config)?,
            gbuffer: slots.gbuffer.from_config(build, config)?,
            reprojection: Reprojection::new(build.gpu)?,
            shadows: slots.shadows.from_config(build, config)?,
            ao: slots.ao.from_config(build, config)?,
            direct: slots.direct.from_config(build, config)?,
            gi: slots.gi.from_config(build, config)?,
            reflections: slots.reflections.from_config(build, config)?,
            compose: slots.compose.from_config(build, config)?,
            sky: slots.sky.from_config(build, config)?,
            post: slots.post.from_config(build, config)?,
        })
    }

    /// Puts what `config` names into the slots where that is another implementation or has other settings. The others keep
    /// their instances, and with them their histories.
    ///
    /// # Errors
    /// As [`Stages::new`]; then nothing has changed.
    pub fn configure(&mut self, build: &Build<'_>, slots: &Slots, config: &Config) -> Result<(), StageError> {
        // Everything is made before anything takes its place.
        let changes = [
            slots.acceleration.change(&mut self.acceleration, build, config)?,
            slots.rays.change(&mut self.rays, build, config)?,
            slots.gbuffer.change(&mut self.gbuffer, build, config)?,
            slots.shadows.change(&mut self.shadows, build, config)?,
            slots.ao.change(&mut self.ao, build, config)?,
            slots.direct.change(&mut self.direct, build, config)?,
            slots.gi.change(&mut self.gi, build, config)?,
            slots.reflections.change(&mut self.reflections, build, config)?,
            slots.compose.change(&mut self.compose, build, config)?,
            slots.sky.change(&mut self.sky, build, config)?,
            slots.post.change(&mut self.post, build, config)?,
        ];
        changes.into_iter().flatten().for_each(|change| change());
        Ok(())
    }
}
