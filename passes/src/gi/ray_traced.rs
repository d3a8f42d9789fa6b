//! Diffuse indirect light by rays: cosine-distributed, shaded where they hit, denoised without the albedo of the surface.
use super::resolve::Resolve;
use super::surfels::{self, Surfels};
use super::{MATERIAL, no_bounces};
use crate::contracts::{LightingIn, LightingOut, RAY_START};
use crate::parts::denoise::{self, Content, DenoiseIn, Denoiser, Hints, Options, Signal, Surfaces};
use crate::parts::hit_shading::{self, HitShading};
use crate::precision;
use magpie::prelude::*;
use magpie::scene::SceneFacts;
use magpie::slot::{Build, Needs, SettingSpec, Settings, SlotError};
use magpie_shaders::gi::TraceParams;
use magpie_shaders::{GI_TINTED_TRACE_RAY, GI_TRACE_RAY};

/// Diffuse indirect light by rays.
pub struct RayTraced {
    trace: RayKernel,
    /// For scenes with surfaces that let light straight through.
    tinted: RayKernel,
    resolve: Resolve,
    /// Surfels that know the light at the hits.
    surfels: Option<Surfels>,
    samples: u32,
    bounces: u32,
    regularization: f32,
    reuse: bool,
    format: Format,
    denoiser: Denoiser,
}

/// Settings of `ray-traced`.
pub fn settings() -> Vec<SettingSpec> {
    let rays = "Rays per pixel. Higher: less noise, with time proportional to the number.";
    let bounces = "Surfaces that a path may meet one after another. Higher: more light in rooms, more time.";
    let cache = "What knows the indirect light at hits. `none`: paths go on. `surfels`: those of the implementation of that name, which are kept beside; \
                 paths end at them, and have all bounces.";
    let reuse = "Hits that the previous frame shows take its light, with all its bounces, instead of sampling lights. Not with `cache`.";
    let mut settings = vec![
        SettingSpec::among("rays", "", rays, 1, &[1, 2, 4, 8]).sweep_all(),
        SettingSpec::integer("bounces", "", bounces, 2, 1..=8).sweep([1, 2, 4]),
        hit_shading::regularization(),
        SettingSpec::switch("reuse", reuse, true).sweep_all(),
        SettingSpec::choice("cache", cache, "none", &["none", "surfels"]).sweep_all(),
    ];
    settings.extend(surfels::pool_settings().into_iter().map(|spec| SettingSpec { sweep: Vec::new(), ..spec }));
    settings.extend(denoise::settings());
    settings.push(precision::setting());
    settings
}

impl RayTraced {
    /// Creates the pipelines.
    pub fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        Ok(Self {
            trace: build.ray_kernel(&GI_TRACE_RAY)?,
            tinted: build.ray_kernel(&GI_TINTED_TRACE_RAY)?,
            resolve: Resolve::new(build, precision::format(settings)?)?,
            surfels: (settings.choice("cache")? == "surfels")
                .then(|| Surfels::new(build, settings, false))
                .transpose()?,
            samples: settings.u32("rays")?,
            bounces: settings.u32("bounces")?,
            regularization: settings.f32("regularization")?,
            // Surfels have all bounces, the picture those that it shows.
            reuse: settings.switch("reuse")? && settings.choice("cache")? == "none",
            format: precision::format(settings)?,
            denoiser: Denoiser::new(build, "gi", Options::read(settings)?)?,
        })
    }

    /// Adds the rays.
    fn trace(&self, g: &mut FrameGraph, view: &View, i: LightingIn, hits: HitShading) -> Handle<Image> {
        let Self { samples, bounces, regularization, format, .. } = *self;
        let (kernel, block) = (if view.facts.lets_light_through { self.tinted } else { self.trace }, view.block);
        let name = if self.surfels.is_some() { "gi.trace_pixels" } else { "gi.trace" };
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
        no_bounces(facts).map_or_else(
            || Needs { light_tables: true, previous_radiance: self.reuse, ..Needs::default() },
            Needs::idle,
        )
    }

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: LightingIn) -> LightingOut {
        let is_idle = self.needs(&view.facts).idle.is_some();
        let Some(hits) = HitShading::new(&i, self.reuse).filter(|_| !is_idle) else { return LightingOut::default() };
        let cache = self.surfels.as_ref().map(|surfels| surfels.update(g, view, i).cache());
        let traced = self.trace(g, view, i, hits.with_cache(cache));
        let noisy = DenoiseIn {
            signal: Signal { image: traced, content: Content::Radiance },
            surfaces: Surfaces { gbuffer: i.gbuffer, reprojected: i.reprojected },
            hints: Hints::default(),
        };
        let denoised = self.denoiser.add(g, view, noisy, "");
        LightingOut { cache, ..LightingOut::radiance(self.resolve.add(g, view, i, denoised, None)) }
    }
}
