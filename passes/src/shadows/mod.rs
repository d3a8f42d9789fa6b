//! Shadows of the key light: the sun, or the strongest lamp of a scene without one.
mod ray_traced;

use crate::stages::{ShadowIn, ShadowOut};
use magpie::prelude::*;
use magpie::stage::Stage;

/// The slot.
pub fn stage() -> Stage<ShadowIn, ShadowOut> {
    Stage::new("shadows")
        .about("Where the key light (the sun, else the strongest lamp) is hidden.")
        .with("ray-traced", "One hard shadow ray per lit pixel.", &ray_traced::settings(), |build, settings| {
            Ok(Box::new(ray_traced::RayTraced::new(build, settings)?))
        })
        .with("off", "Every light shines through everything.", &[], |_, _| Ok(Box::new(Off)))
}

struct Off;

impl Effect for Off {
    type In = ShadowIn;
    type Out = ShadowOut;

    fn add(&mut self, _: &mut FrameGraph, _: &View, _: ShadowIn) -> ShadowOut {
        ShadowOut { visibility: None }
    }
}
