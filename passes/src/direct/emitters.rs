//! Light of emissive surfaces: rays to points of them, and along the lobes of smooth surfaces. What comes out is noisy, and a denoiser follows.
use crate::denoise::{self, Content, DenoiseIn, Denoiser};
use crate::stages::{DirectIn, DirectOut};
use magpie::config::{Config, Value};
use magpie::prelude::*;
use magpie::stage::{Build, SettingSpec, Settings, Stage, StageError};
use magpie_shaders::direct::EmitterParams;
use magpie_shaders::{DIRECT_EMITTERS_RAY, DIRECT_TINTED_EMITTERS_RAY};

const RAYS: &str = "emitter_rays";

/// Traces and denoises.
pub struct Emitters {
    trace: RayKernel,
    samples: u32,
    denoiser: Denoiser,
}

/// The settings.
pub fn settings() -> Vec<SettingSpec> {
    let rays = "Rays of a pixel to emissive surfaces, where the scene has any that no light stands for. Higher: less noise, at a cost that \
                grows as much. 0: they light nothing.";
    let mut settings = vec![SettingSpec::among(RAYS, "", rays, 1, &[0, 1, 2, 4, 8]).sweep_all()];
    settings.extend(denoise::settings());
    settings
}

/// Whether this configuration asks for the scene's table of emissive surfaces.
///
/// # Errors
/// [`StageError`] for settings that do not suit.
pub fn wants_emitters(stage: &Stage<DirectIn, DirectOut>, config: &Config) -> Result<bool, StageError> {
    let settings = stage.settings(config)?;
    Ok(matches!(settings.values().get(RAYS), Some(Value::Integer(rays)) if *rays > 0))
}

impl Emitters {
    /// Makes the pipelines; `None` where no rays are wanted.
    pub fn new(build: &Build<'_>, settings: &Settings) -> Result<Option<Self>, StageError> {
        let samples = settings.u32(RAYS)?;
        if samples == 0 {
            return Ok(None);
        }
        let denoiser = Denoiser::new(build.gpu, "direct", settings)?;
        let shader = if build.lets_light_through { &DIRECT_TINTED_EMITTERS_RAY } else { &DIRECT_EMITTERS_RAY };
        Ok(Some(Self { trace: build.ray_kernel(shader)?, samples, denoiser }))
    }

    /// Radiance over the reflectance; `None` where nothing emits.
    pub fn add(&self, g: &mut FrameGraph, view: &View, i: DirectIn) -> Option<Handle<Image>> {
        let table = i.scene.emitters?;
        let (kernel, samples, block, gbuffer) = (self.trace, self.samples, view.block, i.gbuffer);
        let noisy = g.pass("direct.emitters", Queue::AsyncCompute, |p| {
            let (block, tlas, table) = (p.read(block), i.scene.trace(p), p.read(table));
            let (depth, normal, ids) = (p.sample(gbuffer.depth), p.sample(gbuffer.normal), p.sample(gbuffer.ids));
            let (base_colour, material) = (p.sample(gbuffer.base_colour), p.sample(gbuffer.material));
            let (radiance, target) = p.create("radiance", ImageDesc::like(Format::Rgba32Float, gbuffer.depth));
            let extent = p.extent(gbuffer.depth);
            (radiance.read(), move |c: &mut Record<'_>| {
                let params = EmitterParams {
                    view: c.id(block),
                    rays: c.rays(),
                    lights: c.id(table),
                    depth: c.id(depth),
                    normal: c.id(normal),
                    ids: c.id(ids),
                    base_colour: c.id(base_colour),
                    material: c.id(material),
                    radiance: c.id(target),
                    samples,
                };
                c.trace(kernel, tlas, &params, extent);
            })
        });
        let content = Content::Radiance;
        let i = DenoiseIn {
            noisy,
            content,
            gbuffer,
            reprojected: i.reprojected,
            shading: true,
            change: None,
            reach: None,
            moved: 0,
        };
        Some(self.denoiser.add(g, view, i, ""))
    }
}
