//! Shadows of the lights that matter most, each found as the configuration says.
mod choice;
mod ray_traced;

use crate::denoise::{Content, DenoiseIn, Denoiser, settings as denoising};
use crate::stages::{ShadowGroup, ShadowIn, ShadowOut};
use choice::{Choice, Technique};
use magpie::prelude::*;
use magpie::stage::{Build, Settings, Stage, StageError};
use ray_traced::{RayTraced, Traced};

/// The slot.
pub fn stage() -> Stage<ShadowIn, ShadowOut> {
    // Rays and the denoiser first: the report crosses what comes first.
    let mut settings = vec![ray_traced::rays()];
    settings.extend(denoising());
    settings.extend(ray_traced::settings());
    settings.extend(choice::settings());
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
    denoiser: Denoiser,
}

impl Shadows {
    fn new(build: &Build<'_>, settings: &Settings, technique: Technique) -> Result<Self, StageError> {
        let denoiser = Denoiser::new(build.gpu, "shadows", settings)?;
        Ok(Self { choice: Choice::new(settings, technique)?, rays: RayTraced::new(build, settings)?, denoiser })
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
            let Traced { mut visibility, change } = self.rays.add(g, view, i, &group.lights, &name);
            if self.rays.is_noisy(&group.lights) {
                let content = Content::Channels(group.lights.len() as u32);
                let noisy =
                    DenoiseIn { noisy: visibility, content, gbuffer: i.gbuffer, reprojected: i.reprojected, change };
                visibility = self.denoiser.add(g, view, noisy, &name);
            }
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
