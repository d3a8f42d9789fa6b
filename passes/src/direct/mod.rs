//! Direct lighting: every light at every pixel, times its visibility; and light of emissive surfaces.
mod emitters;

use crate::contracts::{Channel, DirectIn, DirectOut, SHADOW_GROUPS, ShadowGroup};
use crate::precision;
use emitters::Emitters;
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::scene::SceneFacts;
use magpie::slot::{Build, Needs, Preset, SettingSpec, Settings, Slot, SlotError};
use magpie_shaders::DIRECT_SHADE_COMP;
use magpie_shaders::direct::{NO_EMITTERS, NO_SHADOW_LIGHT, ShadeParams};

/// Channels of the G-buffer that shading reads.
const CHANNELS: &[Channel] =
    &[Channel::Depth, Channel::Normal, Channel::BaseColour, Channel::Material, Channel::Coat, Channel::Emission];

/// From cheap to accurate. They differ in the number of samples of lights that have a size, and of rays to emissive surfaces.
pub const PRESETS: [Preset; 4] = [
    Preset { name: "low", implementation: "all-lights", settings: &[("area", "0"), ("emitter_rays", "0")] },
    Preset { name: "medium", implementation: "all-lights", settings: &[("area", "0"), ("emitter_rays", "1")] },
    Preset { name: "high", implementation: "all-lights", settings: &[("area", "4"), ("emitter_rays", "1")] },
    Preset { name: "ultra", implementation: "all-lights", settings: &[("area", "16"), ("emitter_rays", "4")] },
];

pub fn slot() -> Slot<DirectIn, DirectOut> {
    let settings = [area()].into_iter().chain(emitters::settings()).chain([precision::setting()]);
    Slot::new("direct")
        .about("Light from lights and emissive surfaces, and emission itself.")
        .with(
            "all-lights",
            "Every light is evaluated at every pixel.",
            &settings.collect::<Vec<_>>(),
            |build, settings| Ok(Box::new(AllLights::new(build, settings)?)),
        )
        .presets(&PRESETS)
}

fn area() -> SettingSpec {
    let about = "Samples of each light that has an extent, and as many samples of the specular lobe, for its highlight. Higher: less \
                 noise, with time proportional to the number. 0: every light is a point at its centre.";
    SettingSpec::among("area", "", about, 4, &[0, 1, 4, 16]).sweep_all()
}

struct AllLights {
    shade: Kernel,
    /// Samples of each light that has a size; 0 treats it as a point at its centre.
    area: u32,
    /// `None` if no rays are traced to emissive surfaces.
    emitters: Option<Emitters>,
    format: Format,
}

impl AllLights {
    fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        Ok(Self {
            shade: build.kernel(&DIRECT_SHADE_COMP)?,
            area: settings.u32("area")?,
            emitters: Emitters::new(build, settings)?,
            format: precision::format(settings)?,
        })
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
        let (kernel, format, area, block) = (self.shade, self.format, self.area, view.block);
        let gbuffer = i.gbuffer;
        let radiance = g.pass("direct.shade", Queue::Graphics, |p| {
            let (block, scene) = (p.read(block), i.scene.read(p));
            let surfaces = gbuffer.read(p, CHANNELS);
            let emitters = emitters.map(|image| p.sample(image));
            let groups = i.shadows.groups.map(|group| group.map(|group| p.sample(group.visibility)));
            let lights = i.shadows.groups.map(|group| group.map_or(0, |group| pack_shadow_lights(view, group.lights)));
            let shadow_lights = std::array::from_fn(|pair| lights[2 * pair] | lights[2 * pair + 1] << 16);
            let bits = |is: fn(&ShadowGroup) -> bool| {
                let is = |k: usize| i.shadows.groups[k].as_ref().is_some_and(is);
                (0..SHADOW_GROUPS).map(|k| u32::from(is(k)) << k).sum::<u32>()
            };
            let group_flags = bits(|group| group.coloured) | bits(|group| group.raw) << 8;
            // In 16 bits, highlights above 65504, such as sunlight on a mirror, are clamped to `greatest`.
            let (radiance, target) = p.create("radiance", ImageDesc::like(format, gbuffer.depth));
            let extent = p.extent(gbuffer.depth);
            (radiance, move |c: &mut Record<'_>| {
                let params = ShadeParams {
                    view: c.id(block),
                    scene: c.id(scene),
                    gbuffer: surfaces.images(c),
                    radiance: c.id(target),
                    greatest: format.greatest(),
                    emitters: emitters.map_or(NO_EMITTERS, |token| c.id(token).index()),
                    area,
                    group_count: groups.iter().flatten().count() as u32,
                    visibility: groups.map(|group| group.map_or(0, |token| c.id(token).index())),
                    shadow_lights,
                    group_flags,
                };
                c.dispatch(kernel, &params, extent);
            })
        });
        DirectOut { radiance }
    }
}

/// Packs the lights of four channels into four bits each: their index in [`View::shadow_lights`], or [`NO_SHADOW_LIGHT`].
fn pack_shadow_lights(view: &View, lights: [u32; 4]) -> u32 {
    let index_of = |light: u32| {
        view.shadow_lights
            .iter()
            .position(|shadow_light| shadow_light.light == light)
            .map_or(NO_SHADOW_LIGHT, |at| at as u32)
    };
    lights.iter().zip(0..).map(|(light, channel)| index_of(*light) << (4 * channel)).sum()
}
