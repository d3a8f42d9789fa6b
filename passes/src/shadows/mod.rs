//! Visibility of the most important lights, by the technique that the configuration selects for each.
mod choice;
mod maps;
mod penumbra_width;
mod ray_traced;

use crate::contracts::{ShadowGroup, ShadowIn, ShadowOut};
use crate::parts::denoise::{
    self, Changes, Content, DenoiseIn, Denoiser, Hints, Options, Signal, Surfaces, is_adaptive,
};
use choice::{Choice, Group, Technique};
use magpie::prelude::*;
use magpie::scene::SceneFacts;
use magpie::slot::{Build, Needs, Preset, SettingSpec, Settings, Slot, SlotError};
use maps::{MapOut, MapShadows};
use penumbra_width::PenumbraWidth;
use ray_traced::{RayTraced, Traced};

/// From cheap to accurate. Shadow maps have approximate penumbrae and no noise; rays have accurate penumbrae, and noise.
pub const PRESETS: [Preset; 4] = [
    Preset {
        name: "low",
        implementation: "shadow-map",
        settings: &[("filter", "none"), ("map_size", "1024"), ("lamp_map_size", "512")],
    },
    Preset { name: "medium", implementation: "shadow-map", settings: &[("filter", "pcss")] },
    Preset { name: "high", implementation: "ray-traced", settings: &[("rays", "1"), ("denoiser", "svgf")] },
    Preset { name: "ultra", implementation: "ray-traced", settings: &[("rays", "4"), ("denoiser", "svgf")] },
];

pub fn slot() -> Slot<ShadowIn, ShadowOut> {
    Slot::new("shadows")
        .about("Visibility of each light at each pixel.")
        .with("ray-traced", "Rays from the surface to the lights.", &settings(Technique::Rays), |build, settings| {
            Ok(Box::new(Shadows::new(build, settings, Technique::Rays)?))
        })
        .with(
            "shadow-map",
            "Depth maps as seen from each light, redrawn only where something moved.",
            &settings(Technique::Map),
            |build, settings| Ok(Box::new(Shadows::new(build, settings, Technique::Map)?)),
        )
        .with(
            "hybrid",
            "Shadow maps, and rays where maps are unreliable: in penumbrae, near contacts, and at edges that are finer than texels.",
            &settings(Technique::Hybrid),
            |build, settings| Ok(Box::new(Shadows::new(build, settings, Technique::Hybrid)?)),
        )
        .with("off", "No shadows.", &[], |_, _| Ok(Box::new(Off)))
        .presets(&PRESETS)
}

/// Single lights may use another technique than that of the implementation, so every implementation has all settings. Those of other
/// techniques than `measured` are not swept.
fn settings(measured: Technique) -> Vec<SettingSpec> {
    let of = |technique: Technique, mut spec: SettingSpec| {
        // Most of a hybrid's visibility comes from rays. The settings of its maps are swept with the implementation `shadow-map`.
        let is_measured = technique == measured || (measured == Technique::Hybrid && spec.key == "denoiser");
        if !is_measured {
            spec.sweep.clear();
        }
        spec
    };
    // The settings that trade accuracy for time most come first, as the accuracy report combines the first ones.
    let denoising = denoise::settings().into_iter().chain([denoise::precision(), denoise::adaptive()]);
    let rays = std::iter::once(ray_traced::rays()).chain(denoising).chain(ray_traced::settings());
    let rays = rays.map(|s| of(Technique::Rays, s));
    let maps = maps::settings().into_iter().map(|s| of(Technique::Map, s));
    rays.chain(maps).chain(choice::settings()).collect()
}

/// Computes visibility for groups of up to four lights, each group by one technique.
struct Shadows {
    choice: Choice,
    rays: RayTraced,
    penumbra_width: PenumbraWidth,
    maps: MapShadows,
    changes: Changes,
    denoiser: Denoiser,
    adaptive: bool,
}

impl Shadows {
    fn new(build: &Build<'_>, settings: &Settings, technique: Technique) -> Result<Self, SlotError> {
        Ok(Self {
            choice: Choice::new(settings, technique)?,
            rays: RayTraced::new(build, settings)?,
            penumbra_width: PenumbraWidth::new(build)?,
            maps: MapShadows::new(build, settings)?,
            changes: Changes::new(build)?,
            denoiser: Denoiser::new(build, "shadows", Options::read(settings)?)?,
            adaptive: is_adaptive(settings)?,
        })
    }

    /// Traces and denoises the visibility of a group. With `maps`, only pixels where these are unsure are traced.
    fn rays(
        &mut self,
        g: &mut FrameGraph,
        view: &View,
        i: ShadowIn,
        group: &Group,
        maps: Option<MapOut>,
        name: &str,
    ) -> Handle<Image> {
        let Traced { visibility, change, penumbra } = self.rays.add(g, view, i, group, maps, name);
        if !self.rays.is_noisy(&group.lights) {
            return visibility;
        }
        let change = change.map(|change| self.changes.add(g, change, "shadows", name));
        let content = Content::Visibility { channels: group.channels() as u32 };
        let width = penumbra.map(|penumbra| self.penumbra_width.add(g, penumbra, i.gbuffer.depth, name));
        let moved = if self.adaptive { self.rays.moved(group) } else { 0 };
        let noisy = DenoiseIn {
            signal: Signal { image: visibility, content },
            surfaces: Surfaces { gbuffer: i.gbuffer, reprojected: i.reprojected },
            hints: Hints::default().change(change).width(width).moved(moved),
        };
        self.denoiser.add(g, view, noisy, name)
    }
}

impl Effect for Shadows {
    type In = ShadowIn;
    type Out = ShadowOut;

    fn needs(&self, facts: &SceneFacts) -> Needs {
        if facts.shining().next().is_none() {
            return Needs::idle("no light shines");
        }
        if facts.area > 0.0 { Needs::default() } else { Needs::idle("there is no surface") }
    }

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: ShadowIn) -> ShadowOut {
        let mut out = ShadowOut::default();
        if self.needs(&view.facts).idle.is_some() {
            return out;
        }
        let groups = self.choice.groups(&view.shadow_lights, self.rays.is_tinted(&view.facts));
        for ((at, group), out) in groups.iter().enumerate().zip(&mut out.groups) {
            // Names of passes of the first group have no suffix.
            let name = if at == 0 { String::new() } else { format!("_{}", at + 1) };
            let visibility = match group.technique {
                Technique::Map => self.maps.add(g, view, i, &group.lights, false, &name).visibility,
                Technique::Hybrid => {
                    let maps = self.maps.add(g, view, i, &group.lights, true, &name);
                    self.rays(g, view, i, group, Some(maps), &name)
                }
                Technique::Rays | Technique::None => self.rays(g, view, i, group, None, &name),
            };
            let lights = ray_traced::indices(&group.lights);
            let raw = group.technique == Technique::Rays && self.rays.gives_raw();
            *out = Some(ShadowGroup { visibility, lights, coloured: group.coloured, raw });
        }
        out
    }
}

/// All lights are unshadowed.
struct Off;

impl Effect for Off {
    type In = ShadowIn;
    type Out = ShadowOut;

    fn add(&mut self, _: &mut FrameGraph, _: &View, _: ShadowIn) -> ShadowOut {
        ShadowOut::default()
    }
}
