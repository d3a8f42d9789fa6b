//! Reflections by rays: sampled from the specular lobe, shaded where they hit, denoised over what the lobe covers of the screen.
use super::idle_reason;
use crate::contracts::{Channel, LightingIn, LightingOut, RAY_START};
use crate::parts::denoise::{self, Content, DenoiseIn, Denoiser, Hints, Options, Signal, Surfaces};
use crate::parts::hit_shading::HitShading;
use crate::precision;
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::scene::SceneFacts;
use magpie::slot::{Build, Needs, SettingSpec, Settings, SlotError};
use magpie_shaders::reflections::{ResolveParams, TraceParams};
use magpie_shaders::{REFLECTIONS_RESOLVE_COMP, REFLECTIONS_TINTED_TRACE_RAY, REFLECTIONS_TRACE_RAY};

/// Format of hit distances.
const DISTANCE: Format = Format::R16Float;
/// Format of the width of the lobe.
const WIDTH: Format = Format::R8Unorm;
/// Channels with the material.
const MATERIAL: &[Channel] = &[Channel::BaseColour, Channel::Material, Channel::Coat];

/// Reflections by rays.
pub struct RayTraced {
    trace: RayKernel,
    /// For scenes with surfaces that let light straight through.
    tinted: RayKernel,
    resolve: Kernel,
    samples: u32,
    bounces: u32,
    reuse: bool,
    format: Format,
    denoiser: Denoiser,
}

/// What the rays found.
struct Traced {
    radiance: Handle<Image>,
    hit_distance: Handle<Image>,
    width: Handle<Image>,
}

/// Settings of `ray-traced`.
pub fn settings() -> Vec<SettingSpec> {
    let rays = "Rays per pixel. Higher: less noise, with time proportional to the number.";
    let bounces = "Surfaces that a path may meet one after another. Higher: more reflections of reflections, more time. What lies beyond \
                   is the sky for smooth surfaces and direct light for others.";
    let reuse = "Hits that the previous frame shows take its light, with all its bounces, instead of sampling lights. Smooth surfaces are \
                 always shaded anew.";
    let mut settings = vec![
        SettingSpec::among("rays", "", rays, 1, &[1, 2, 4, 8]).sweep_all(),
        SettingSpec::integer("bounces", "", bounces, 2, 1..=8).sweep([1, 2, 4]),
        SettingSpec::switch("reuse", reuse, true).sweep_all(),
    ];
    settings.extend(denoise::settings());
    settings.push(precision::setting());
    settings
}

impl RayTraced {
    /// Creates the pipelines.
    pub fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        Ok(Self {
            trace: build.ray_kernel(&REFLECTIONS_TRACE_RAY)?,
            tinted: build.ray_kernel(&REFLECTIONS_TINTED_TRACE_RAY)?,
            resolve: build.kernel(&REFLECTIONS_RESOLVE_COMP)?,
            samples: settings.u32("rays")?,
            bounces: settings.u32("bounces")?,
            reuse: settings.switch("reuse")?,
            format: precision::format(settings)?,
            denoiser: Denoiser::new(build, "reflections", Options::read(settings)?)?,
        })
    }

    /// Adds the rays. The radiance is divided by the albedo of the specular lobe.
    fn trace(&self, g: &mut FrameGraph, view: &View, i: LightingIn, hits: HitShading) -> Traced {
        let kernel = if view.facts.lets_light_through { self.tinted } else { self.trace };
        let (block, samples, bounces, format) = (view.block, self.samples, self.bounces, self.format);
        g.pass("reflections.trace", Queue::AsyncCompute, |p| {
            let (block, scene, hits) = (p.read(block), i.scene.trace(p), hits.read(p));
            let gbuffer = i.gbuffer.read(p, &[RAY_START, MATERIAL].concat());
            let extent = p.extent(i.gbuffer.depth);
            let mut create = |name, format| p.create(name, ImageDesc::like(format, i.gbuffer.depth));
            let (radiance, radiance_target) = create("radiance", format);
            let (hit_distance, distance_target) = create("hit_distance", DISTANCE);
            let (width, width_target) = create("width", WIDTH);
            let traced = Traced { radiance: radiance.read(), hit_distance: hit_distance.read(), width: width.read() };
            (traced, move |c: &mut Record<'_>| {
                let params = TraceParams {
                    view: c.id(block),
                    scene: c.id(scene.root),
                    rays: c.rays(),
                    gbuffer: gbuffer.images(c),
                    hits: hits.params(c),
                    radiance: c.id(radiance_target),
                    hit_distance: c.id(distance_target),
                    width: c.id(width_target),
                    samples,
                    bounces,
                    greatest: format.greatest(),
                };
                c.trace(kernel, scene.tlas, &params, extent);
            })
        })
    }

    /// Multiplies with the albedo of the specular lobe.
    fn resolve(&self, g: &mut FrameGraph, view: &View, i: LightingIn, denoised: Handle<Image>) -> Handle<Image> {
        let (kernel, format, block) = (self.resolve, self.format, view.block);
        g.pass("reflections.resolve", Queue::AsyncCompute, |p| {
            let (block, denoised) = (p.read(block), p.sample(denoised));
            let gbuffer = i.gbuffer.read(p, &[&[Channel::Depth, Channel::Normal], MATERIAL].concat());
            let (radiance, target) = p.create("radiance", ImageDesc::like(format, i.gbuffer.depth));
            let extent = p.extent(i.gbuffer.depth);
            (radiance.read(), move |c: &mut Record<'_>| {
                let params = ResolveParams {
                    view: c.id(block),
                    gbuffer: gbuffer.images(c),
                    denoised: c.id(denoised),
                    radiance: c.id(target),
                    greatest: format.greatest(),
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }
}

impl Effect for RayTraced {
    type In = LightingIn;
    type Out = LightingOut;

    fn needs(&self, facts: &SceneFacts) -> Needs {
        if let Some(reason) = idle_reason(facts) {
            return Needs::idle(reason);
        }
        Needs { light_tables: true, previous_radiance: self.reuse, ..Needs::default() }
    }

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: LightingIn) -> LightingOut {
        let is_idle = self.needs(&view.facts).idle.is_some();
        let Some(hits) = HitShading::new(&i, self.reuse).filter(|_| !is_idle) else { return LightingOut::default() };
        let traced = self.trace(g, view, i, hits);
        let noisy = DenoiseIn {
            signal: Signal { image: traced.radiance, content: Content::Radiance },
            surfaces: Surfaces { gbuffer: i.gbuffer, reprojected: i.reprojected },
            hints: Hints::default().width(Some(traced.width)),
        };
        let denoised = self.denoiser.add(g, view, noisy, "");
        LightingOut::radiance(self.resolve(g, view, i, denoised)).with_hit_distance(traced.hit_distance)
    }
}
