//! `direct.shade`, the last pass of every implementation: lights that are evaluated at every pixel, light that comes as an image, and emission.
use super::clusters::Clusters;
use super::lobes::Reflected;
use crate::contracts::{Channel, DirectIn, DirectOut, SHADOW_GROUPS, ShadowGroup};
use crate::precision;
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::slot::{Build, SettingSpec, Settings, SlotError};
use magpie_shaders::direct::{
    AREA_SHIFT, LIGHTS_ALL, LIGHTS_DIRECTIONAL, LIGHTS_NONE, NO_LOBE, NO_SAMPLED_LIGHT, NO_SHADOW_LIGHT, RADIANCE_HALF,
    ShadeParams,
};
use magpie_shaders::{Address, DIRECT_CLUSTERED_COMP, DIRECT_SHADE_COMP, SampledImage};

/// Channels of the G-buffer that shading reads.
const CHANNELS: &[Channel] =
    &[Channel::Depth, Channel::Normal, Channel::BaseColour, Channel::Material, Channel::Coat, Channel::Emission];

/// The setting `area`.
pub fn area() -> SettingSpec {
    let about = "Samples of each light that has an extent, and as many samples of the specular lobe, for its highlight. Higher: less \
                 noise, with time proportional to the number. 0: every light is a point at its centre.";
    SettingSpec::among("area", "", about, 4, &[0, 1, 4, 16]).sweep_all()
}

/// Which lights are evaluated at every pixel.
#[derive(Clone, Copy)]
pub enum Lights {
    All,
    /// All, those that are far as far as their clusters say.
    Clustered(Clusters),
    Directional,
    None,
}

/// The pass.
pub struct Shade {
    kernel: Kernel,
    clustered: Kernel,
    /// Samples of each light that has a size; 0 treats it as a point at its centre.
    area: u32,
    format: Format,
}

impl Shade {
    /// Creates the pipeline.
    pub fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        Ok(Self {
            kernel: build.kernel(&DIRECT_SHADE_COMP)?,
            clustered: build.kernel(&DIRECT_CLUSTERED_COMP)?,
            area: settings.u32("area")?,
            format: precision::format(settings)?,
        })
    }

    /// Adds the pass. `sampled`: light of other lights.
    pub fn add(
        &self,
        g: &mut FrameGraph,
        view: &View,
        i: DirectIn,
        sampled: Option<Reflected>,
        lights: Lights,
    ) -> DirectOut {
        let (format, area, block) = (self.format, self.area, view.block);
        let kernel = if matches!(lights, Lights::Clustered(_)) { self.clustered } else { self.kernel };
        let gbuffer = i.gbuffer;
        let radiance = g.pass("direct.shade", Queue::Graphics, |p| {
            let (block, scene) = (p.read(block), i.scene.read(p));
            let surfaces = gbuffer.read(p, CHANNELS);
            let limit = sampled.map_or(0.0, |sampled| sampled.limit);
            let specular = sampled.and_then(|sampled| sampled.specular).map(|image| p.sample(image));
            let sampled = sampled.map(|sampled| p.sample(sampled.radiance));
            let clusters = if let Lights::Clustered(clusters) = lights { Some(clusters.read(p)) } else { None };
            let shadows = if matches!(lights, Lights::None) { Default::default() } else { i.shadows.groups };
            let groups = shadows.map(|group| group.map(|group| p.sample(group.visibility)));
            let shadowed = shadows.map(|group| group.map_or(0, |group| pack_shadow_lights(view, group.lights)));
            let shadow_lights = std::array::from_fn(|pair| shadowed[2 * pair] | shadowed[2 * pair + 1] << 16);
            let bits = |is: fn(&ShadowGroup) -> bool| {
                let is = |k: usize| shadows[k].as_ref().is_some_and(is);
                (0..SHADOW_GROUPS).map(|k| u32::from(is(k)) << k).sum::<u32>()
            };
            let lit = match lights {
                Lights::All | Lights::Clustered(_) => LIGHTS_ALL,
                Lights::Directional => LIGHTS_DIRECTIONAL,
                Lights::None => LIGHTS_NONE,
            };
            let half = if format == Format::Rgba16Float { RADIANCE_HALF } else { 0 };
            let flags = bits(|group| group.coloured) | bits(|group| group.raw) << 8 | lit | half | area << AREA_SHIFT;
            // In 16 bits, highlights above 65504, such as sunlight on a mirror, are clamped to that.
            let (radiance, target) = p.create("radiance", ImageDesc::like(format, gbuffer.depth));
            let extent = p.extent(gbuffer.depth);
            (radiance, move |c: &mut Record<'_>| {
                let params = ShadeParams {
                    view: c.id(block),
                    scene: c.id(scene),
                    gbuffer: surfaces.images(c),
                    radiance: c.id(target),
                    sampled: sampled.map_or(NO_SAMPLED_LIGHT, |token| c.id(token).index()),
                    specular: specular.map_or(NO_LOBE, |token| c.id(token).index()),
                    limit,
                    clusters: clusters.map_or(Address::default(), |token| c.id(token)),
                    visibility: groups.map(|group| group.map_or(SampledImage::default(), |token| c.id(token))),
                    shadow_lights,
                    flags,
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
