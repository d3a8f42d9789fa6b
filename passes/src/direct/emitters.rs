//! Direct light of emissive surfaces: rays to points on them and along specular lobes, followed by a denoiser.
use super::lobes::{self, Lobes, Reflected};
use crate::contracts::{Channel, DirectIn};
use crate::parts::denoise::Hints;
use crate::ray_kernels::RayKernels;
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
    trace: RayKernels,
    samples: u32,
    lobes: Lobes,
}

/// Settings of emissive surfaces and of their denoisers. `split`: the default of that setting.
pub fn settings(split: f64) -> Vec<SettingSpec> {
    let rays = "Rays per pixel to emissive surfaces that no light stands for. Higher: less noise, with time proportional to the number. \
                0: emissive surfaces light nothing.";
    let mut settings = vec![SettingSpec::among(RAYS, "", rays, 1, &[0, 1, 2, 4, 8]).sweep_all()];
    settings.extend(lobes::settings(split));
    settings
}

impl Emitters {
    /// Creates the pipelines; `None` if the number of rays is 0. `splits`: as in [`Lobes::new`].
    pub fn new(build: &Build<'_>, settings: &Settings, splits: bool) -> Result<Option<Self>, SlotError> {
        let samples = settings.u32(RAYS)?;
        if samples == 0 {
            return Ok(None);
        }
        let trace = RayKernels::new(build, &DIRECT_EMITTERS_RAY, &DIRECT_TINTED_EMITTERS_RAY)?;
        Ok(Some(Self { trace, samples, lobes: Lobes::new(build, settings, splits)? }))
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

    /// Adds the passes. `None` if nothing emits.
    pub fn add(&self, g: &mut FrameGraph, view: &View, i: DirectIn) -> Option<Reflected> {
        let table = i.scene.emitters?;
        let kernel = self.trace.of(view);
        let (samples, block, gbuffer) = (self.samples, view.block, i.gbuffer);
        let noisy = g.pass("direct.emitters", Queue::AsyncCompute, |p| {
            let (block, scene, table) = (p.read(block), i.scene.trace(p), p.read(table));
            let surfaces = gbuffer.read(p, CHANNELS);
            let (noisy, targets) = self.lobes.create(p, &view.facts, i);
            let extent = p.extent(gbuffer.depth);
            (noisy, move |c: &mut Record<'_>| {
                let params = EmitterParams {
                    view: c.id(block),
                    scene: c.id(scene.root),
                    rays: c.rays(),
                    lights: c.id(table),
                    gbuffer: surfaces.images(c),
                    lobes: targets.images(c),
                    samples,
                };
                c.trace(kernel, scene.tlas, &params, extent);
            })
        });
        Some(self.lobes.denoise(g, view, i, noisy, Hints::default()))
    }
}
