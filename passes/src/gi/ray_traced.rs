//! Diffuse indirect light by rays: cosine-distributed, shaded where they hit, denoised without the albedo of the surface.
use super::MATERIAL;
use super::paths::{self, Paths};
use super::resolve::Finish;
use crate::contracts::{LightingIn, LightingOut, RAY_START};
use crate::parts::denoise;
use crate::parts::hit_shading::HitShading;
use crate::precision;
use crate::ray_kernels::RayKernels;
use magpie::prelude::*;
use magpie::scene::SceneFacts;
use magpie::slot::{Build, Needs, SettingSpec, Settings, SlotError};
use magpie_shaders::gi::TraceParams;
use magpie_shaders::{GI_TINTED_TRACE_RAY, GI_TRACE_RAY};

/// Diffuse indirect light by rays.
pub struct RayTraced {
    trace: RayKernels,
    finish: Finish,
    paths: Paths,
    samples: u32,
    format: Format,
}

/// Settings of `ray-traced`.
pub fn settings() -> Vec<SettingSpec> {
    let rays = "Rays per pixel. Higher: less noise, with time proportional to the number.";
    let mut settings = vec![SettingSpec::among("rays", "", rays, 1, &[1, 2, 4, 8]).sweep_all()];
    settings.extend(paths::settings());
    settings.extend(denoise::settings());
    settings.push(precision::setting());
    settings
}

impl RayTraced {
    /// Creates the pipelines.
    pub fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        Ok(Self {
            trace: RayKernels::new(build, &GI_TRACE_RAY, &GI_TINTED_TRACE_RAY)?,
            finish: Finish::new(build, settings)?,
            paths: Paths::new(build, settings)?,
            samples: settings.u32("rays")?,
            format: precision::format(settings)?,
        })
    }

    /// Adds the rays.
    fn trace(&self, g: &mut FrameGraph, view: &View, i: LightingIn, hits: HitShading) -> Handle<Image> {
        let Self { samples, format, .. } = *self;
        let Paths { bounces, regularization, .. } = self.paths;
        let (kernel, block) = (self.trace.of(view), view.block);
        let name = if self.paths.end_at_surfels() { "gi.trace_pixels" } else { "gi.trace" };
        g.pass(name, Queue::AsyncCompute, |p| {
            let (block, scene, hits) = (p.read(block), i.scene.trace(p), hits.read(p));
            let gbuffer = i.gbuffer.read(p, &[RAY_START, MATERIAL].concat());
            let (radiance, target) = p.create("radiance", ImageDesc::like(format, i.gbuffer.depth));
            let extent = p.extent(i.gbuffer.depth);
            (radiance.read(), move |c: &mut Record<'_>| {
                let params = TraceParams {
                    view: c.id(block),
                    scene: c.id(scene.root),
                    rays: c.rays(),
                    gbuffer: gbuffer.images(c),
                    hits: hits.params(c),
                    radiance: c.id(target),
                    samples,
                    bounces,
                    regularization,
                    greatest: format.greatest(),
                };
                c.trace(kernel, scene.tlas, &params, extent);
            })
        })
    }
}

impl Effect for RayTraced {
    type In = LightingIn;
    type Out = LightingOut;

    fn needs(&self, facts: &SceneFacts) -> Needs {
        self.paths.needs(facts)
    }

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: LightingIn) -> LightingOut {
        let Some((hits, cache)) = self.paths.begin(g, view, i) else { return LightingOut::default() };
        let traced = self.trace(g, view, i, hits);
        LightingOut { cache, ..LightingOut::radiance(self.finish.add(g, view, i, traced, None)) }
    }
}
