//! Shadows of the lights that matter most, each found as the configuration says.
mod choice;
mod ray_traced;

use crate::stages::{ShadowGroup, ShadowIn, ShadowOut};
use choice::{Choice, Technique};
use magpie::prelude::*;
use magpie::stage::{Build, SettingSpec, Settings, Stage, StageError};
use ray_traced::RayTraced;

/// The slot.
pub fn stage() -> Stage<ShadowIn, ShadowOut> {
    let settings: Vec<SettingSpec> = choice::settings().into_iter().chain(ray_traced::settings()).collect();
    Stage::new("shadows")
        .about("How much of each light is seen.")
        .with("ray-traced", "Rays from the surface to the lights.", &settings, |build, settings| {
            Ok(Box::new(Shadows::new(build, settings, Technique::Rays)?))
        })
        .with("off", "Every light shines through everything.", &[], |_, _| Ok(Box::new(Off)))
}

/// Lights in groups of up to four, each group by one technique.
struct Shadows {
    choice: Choice,
    rays: RayTraced,
}

impl Shadows {
    fn new(build: &Build<'_>, settings: &Settings, technique: Technique) -> Result<Self, StageError> {
        Ok(Self { choice: Choice::new(settings, technique)?, rays: RayTraced::new(build, settings)? })
    }
}

impl Effect for Shadows {
    type In = ShadowIn;
    type Out = ShadowOut;

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: ShadowIn) -> ShadowOut {
        let mut out = ShadowOut::default();
        for (at, group) in self.choice.groups(&view.casters).iter().enumerate() {
            // Passes of the first group have the plain names.
            let name = if at == 0 { String::new() } else { format!("_{}", at + 1) };
            let visibility = self.rays.add(g, view, i, &group.lights, &name);
            let lights = ray_traced::indices(&group.lights);
            out.groups[at] = Some(ShadowGroup { visibility, lights, coloured: false });
        }
        out
    }
}

/// Nothing casts a shadow: no pass, no ray.
struct Off;

impl Effect for Off {
    type In = ShadowIn;
    type Out = ShadowOut;

    fn add(&mut self, _: &mut FrameGraph, _: &View, _: ShadowIn) -> ShadowOut {
        ShadowOut::default()
    }
}
