//! The implementations that come with Magpie. A user adds others with [`Stage::register`].
use crate::stages::{
    AccelerationIn, AoIn, AoOut, ComposeIn, DirectIn, DirectOut, GBuffer, GBufferIn, IndirectIn, IndirectOut, PostIn,
    PostOut, RaysIn, RaysOut, SceneHandles, ShadowIn, ShadowOut, SkyIn,
};
use crate::{acceleration, ao, compose, direct, gbuffer, gi, post, rays, reflections, shadows, sky};
use magpie::config::Catalogue;
use magpie::prelude::*;
use magpie::scene::ResidentError;
use magpie::stage::{SlotInfo, Stage};

/// Every slot of the frame with all that can fill it.
#[derive(Clone, Debug)]
pub struct Slots {
    /// The scene as rays see it.
    pub acceleration: Stage<AccelerationIn, Result<SceneHandles, ResidentError>>,
    /// How much work rays are.
    pub rays: Stage<RaysIn, RaysOut>,
    /// What the camera sees first.
    pub gbuffer: Stage<GBufferIn, GBuffer>,
    /// How much of each light is seen.
    pub shadows: Stage<ShadowIn, ShadowOut>,
    /// What is left of the hemisphere above each pixel.
    pub ao: Stage<AoIn, AoOut>,
    /// Light straight from the lights.
    pub direct: Stage<DirectIn, DirectOut>,
    /// Diffuse indirect light.
    pub gi: Stage<IndirectIn, IndirectOut>,
    /// Specular indirect light.
    pub reflections: Stage<IndirectIn, IndirectOut>,
    /// The sum of all light.
    pub compose: Stage<ComposeIn, WriteHandle<Image>>,
    /// What lies behind everything.
    pub sky: Stage<SkyIn, Handle<Image>>,
    /// From radiance to a display.
    pub post: Stage<PostIn, PostOut>,
}

impl Default for Slots {
    fn default() -> Self {
        Self {
            acceleration: acceleration::stage(),
            rays: rays::stage(),
            gbuffer: gbuffer::stage(),
            shadows: shadows::stage(),
            ao: ao::stage(),
            direct: direct::stage(),
            gi: gi::stage(),
            reflections: reflections::stage(),
            compose: compose::stage(),
            sky: sky::stage(),
            post: post::stage(),
        }
    }
}

impl Slots {
    /// Describes every slot, in the order of the frame.
    pub fn infos(&self) -> Vec<SlotInfo> {
        let infos = [
            self.acceleration.info(),
            self.rays.info(),
            self.gbuffer.info(),
            self.shadows.info(),
            self.ao.info(),
            self.direct.info(),
            self.gi.info(),
            self.reflections.info(),
            self.compose.info(),
            self.sky.info(),
            self.post.info(),
        ];
        infos.into_iter().cloned().collect()
    }

    /// What a configuration is checked against.
    pub fn catalogue(&self) -> Catalogue {
        Catalogue::new(self.infos())
    }
}
