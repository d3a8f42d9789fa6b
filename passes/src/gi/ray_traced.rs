//! Diffuse indirect light by rays: cosine-distributed, shaded where they hit, denoised without the albedo of the surface.
use super::MATERIAL;
use super::gradient::{Gradient, Kept};
use super::paths::{self, Paths};
use super::resolve::{Finish, Noisy};
use crate::contracts::{LightingIn, LightingOut, RAY_START};
use crate::parts::denoise;
use crate::parts::hit_shading::HitShading;
use crate::precision;
use crate::ray_kernels::RayKernels;
use magpie::prelude::*;
use magpie::scene::SceneFacts;
use magpie::slot::{Build, Needs, SettingSpec, Settings, SlotError};
use magpie_shaders::denoise::NO_IMAGE;
use magpie_shaders::gi::TraceParams;
use magpie_shaders::{GI_TINTED_TRACE_RAY, GI_TRACE_RAY};

/// Diffuse indirect light by rays.
pub struct RayTraced {
    trace: RayKernels,
    gradient: Option<Gradient>,
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
    settings.push(denoise::adaptive_to_paths());
    settings.push(precision::setting());
    settings
}

impl RayTraced {
    /// Creates the pipelines.
    pub fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        Ok(Self {
            trace: RayKernels::new(build, &GI_TRACE_RAY, &GI_TINTED_TRACE_RAY)?,
            gradient: Gradient::new(build, settings)?,
            finish: Finish::new(build, settings)?,
            paths: Paths::new(build, settings)?,
            samples: settings.u32("rays")?,
            format: precision::format(settings)?,
        })
    }

    /// Adds the rays, and keeps some for the next frame.
    fn trace(
        &self,
        g: &mut FrameGraph,
        view: &View,
        i: LightingIn,
        hits: HitShading,
        kept: Option<Kept>,
    ) -> Handle<Image> {
        let Self { samples, format, .. } = *self;
        let Paths { bounces, regularization, .. } = self.paths;
        let (kernel, block) = (self.trace.of(view), view.block);
        let name = if self.paths.end_at_surfels() { "gi.trace_pixels" } else { "gi.trace" };
        g.pass(name, Queue::AsyncCompute, |p| {
            let (block, scene, hits) = (p.read(block), i.scene.trace(p), hits.read(p));
            let gbuffer = i.gbuffer.read(p, &[RAY_START, MATERIAL].concat());
            let (radiance, target) = p.create("radiance", ImageDesc::like(format, i.gbuffer.depth));
            let kept = kept.map(|kept| (p.write(kept.surfaces).1, p.write(kept.luminance).1));
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
                    surfaces: kept.map_or(NO_IMAGE, |(surfaces, _)| c.id(surfaces).index()),
                    luminance: kept.map_or(NO_IMAGE, |(_, luminance)| c.id(luminance).index()),
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
        let gradient = self.gradient.as_ref().map(|gradient| gradient.add(g, view, i, hits, &self.paths, self.samples));
        let (change, kept) = gradient.unzip();
        let noisy = Noisy { image: self.trace(g, view, i, hits, kept), change };
        LightingOut { cache, ..LightingOut::radiance(self.finish.add(g, view, i, noisy, None)) }
    }
}
