//! `all-lights`: every light at every pixel, times its visibility; and rays to emissive surfaces.
use super::emitters::Emitters;
use super::shade::{Lights, Shade};
use crate::contracts::{DirectIn, DirectOut};
use magpie::prelude::*;
use magpie::scene::SceneFacts;
use magpie::slot::{Build, Needs, Settings, SlotError};

/// Every light at every pixel.
pub struct AllLights {
    shade: Shade,
    /// `None` if no rays are traced to emissive surfaces.
    emitters: Option<Emitters>,
}

impl AllLights {
    /// Creates the pipelines. `splits`: whether specular light of emissive surfaces may have a denoiser of its own.
    pub fn new(build: &Build<'_>, settings: &Settings, splits: bool) -> Result<Self, SlotError> {
        Ok(Self { shade: Shade::new(build, settings)?, emitters: Emitters::new(build, settings, splits)? })
    }
}

impl Effect for AllLights {
    type In = DirectIn;
    type Out = DirectOut;

    fn needs(&self, facts: &SceneFacts) -> Needs {
        self.emitters.as_ref().map_or_else(Needs::default, |_| Emitters::needs(facts))
    }

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: DirectIn) -> DirectOut {
        let emitters = self.emitters.as_ref().and_then(|emitters| emitters.add(g, view, i));
        self.shade.add(g, view, i, emitters, Lights::All)
    }
}
