//! Direct light of emissive surfaces: rays to points on them and along specular lobes, followed by a denoiser.
use crate::contracts::{Channel, DirectIn};
use crate::parts::denoise::{self, Content, DenoiseIn, Denoiser, Hints, Options, Signal, Surfaces};
use crate::precision;
use magpie::prelude::*;
use magpie::scene::SceneFacts;
use magpie::slot::{Build, Needs, Part, SettingSpec, Settings, SlotError};
use magpie_shaders::direct::EmitterParams;
use magpie_shaders::{DIRECT_EMITTERS_RAY, DIRECT_TINTED_EMITTERS_RAY};
use std::borrow::Cow;

const RAYS: &str = "emitter_rays";
/// Channels of the G-buffer that the rays need: surface and material.
const CHANNELS: &[Channel] = &[
    Channel::Depth,
    Channel::Normal,
    Channel::GeometricNormal,
    Channel::Ids,
    Channel::BaseColour,
    Channel::Material,
    Channel::Coat,
];

/// Direct light of emissive surfaces.
pub struct Emitters {
    trace: RayKernel,
    /// For scenes with surfaces that transmit light.
    tinted: RayKernel,
    samples: u32,
    format: Format,
    denoiser: Denoiser,
}

/// Settings of emissive surfaces and of their denoiser.
pub fn settings() -> Vec<SettingSpec> {
    let rays = "Rays per pixel to emissive surfaces that no light stands for. Higher: less noise, with time proportional to the number. \
                0: emissive surfaces light nothing.";
    let mut settings = vec![SettingSpec::among(RAYS, "", rays, 1, &[0, 1, 2, 4, 8]).sweep_all()];
    settings.extend(denoise::settings());
    settings
}

impl Emitters {
    /// Creates the pipelines; `None` if the number of rays is 0.
    pub fn new(build: &Build<'_>, settings: &Settings) -> Result<Option<Self>, SlotError> {
        let samples = settings.u32(RAYS)?;
        if samples == 0 {
            return Ok(None);
        }
        let denoiser = Denoiser::new(build, "direct", Options::read(settings)?)?;
        let (trace, tinted) = (build.ray_kernel(&DIRECT_EMITTERS_RAY)?, build.ray_kernel(&DIRECT_TINTED_EMITTERS_RAY)?);
        Ok(Some(Self { trace, tinted, samples, format: precision::format(settings)?, denoiser }))
    }

    /// Asks for the sampling table of emissive surfaces if the scene has any.
    pub fn needs(facts: &SceneFacts) -> Needs {
        let idle = (!facts.emits()).then_some("no material emits");
        Needs { emitters: idle.is_none(), ..Needs::default() }.part(Part {
            name: "emitters",
            idle: idle.map(Cow::Borrowed),
            without: Some("emitter_rays=0"),
        })
    }

    /// Adds the passes. Returns outgoing radiance divided by the albedo; `None` if nothing emits.
    pub fn add(&self, g: &mut FrameGraph, view: &View, i: DirectIn) -> Option<Handle<Image>> {
        let table = i.scene.emitters?;
        let kernel = if view.facts.lets_light_through { self.tinted } else { self.trace };
        let (samples, format, block, gbuffer) = (self.samples, self.format, view.block, i.gbuffer);
        let noisy = g.pass("direct.emitters", Queue::AsyncCompute, |p| {
            let (block, scene, table) = (p.read(block), i.scene.trace(p), p.read(table));
            let surfaces = gbuffer.read(p, CHANNELS);
            let (radiance, target) = p.create("radiance", ImageDesc::like(format, gbuffer.depth));
            let extent = p.extent(gbuffer.depth);
            (radiance.read(), move |c: &mut Record<'_>| {
                let params = EmitterParams {
                    view: c.id(block),
                    scene: c.id(scene.root),
                    rays: c.rays(),
                    lights: c.id(table),
                    gbuffer: surfaces.images(c),
                    radiance: c.id(target),
                    samples,
                    greatest: format.greatest(),
                };
                c.trace(kernel, scene.tlas, &params, extent);
            })
        });
        let i = DenoiseIn {
            signal: Signal { image: noisy, content: Content::Radiance },
            surfaces: Surfaces { gbuffer, reprojected: i.reprojected },
            hints: Hints::default(),
        };
        Some(self.denoiser.add(g, view, i, ""))
    }
}
