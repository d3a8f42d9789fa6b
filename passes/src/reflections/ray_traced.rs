//! Reflections by rays: sampled from the specular lobe, shaded where they hit, denoised over what the lobe covers of the screen.
use super::reconstruct::{Cells, Found, MATERIAL, Reconstruction, Resolve};
use super::{ALL_ROUGH, idle_reason};
use crate::contracts::{GBufferToken, LightingIn, LightingOut, RAY_START, SceneToken};
use crate::parts::denoise::{self, DenoiseIn, Denoiser, Options};
use crate::parts::hit_shading::{self, HitShading, HitShadingToken};
use crate::precision;
use crate::ray_kernels::RayKernels;
use crate::sky_light::SkyLight;
use crate::specular_signal::SpecularSignal;
use magpie::graph::{BufferToken, PassBuilder};
use magpie::prelude::*;
use magpie::scene::SceneFacts;
use magpie::slot::{Build, Needs, SettingSpec, Settings, SlotError};
use magpie_shaders::denoise::NO_IMAGE;
use magpie_shaders::reflections::TraceParams;
use magpie_shaders::{REFLECTIONS_SKY_COMP, REFLECTIONS_TINTED_TRACE_RAY, REFLECTIONS_TRACE_RAY};

/// Format of the rays of cells.
const RAY: Format = Format::Rgba16Float;

/// Reflections by rays.
pub struct RayTraced {
    trace: RayKernels,
    /// Rays of each cell.
    samples: u32,
    pixels_per_ray: u32,
    bounces: u32,
    regularization: f32,
    reuse: bool,
    reconstruction: Option<Reconstruction>,
    roughness_limit: f32,
    /// For scenes that are rougher than that throughout.
    fallback: SkyLight,
    resolve: Resolve,
    format: Format,
    denoiser: Denoiser,
}

/// Settings of `ray-traced`.
pub fn settings() -> Vec<SettingSpec> {
    let rays = "Rays per pixel, if `pixels_per_ray` is 1. Higher: less noise, with time proportional to the number.";
    let pixels_per_ray = "Pixels that share a ray, which starts from another one of them in every frame: 1, 2 side by side, or 4 in a square. \
                          Higher: less time, more noise.";
    let bounces = "Surfaces that a path may meet one after another. Higher: more reflections of reflections, more time. Beyond, one more \
                   ray from smooth surfaces finds the sky, lights and what the previous frame shows.";
    let reuse = "Hits that the previous frame shows take its light, with all its bounces, instead of sampling lights. Smooth surfaces are \
                 always shaded anew.";
    let reconstruct = "Each pixel takes the rays of its neighbours as samples of its own lobe, before the denoiser: less noise in the first frames, a \
                       little less light. Off: only its own rays. Always on where pixels share rays, never with several rays per pixel.";
    let limit = "Roughness from which a surface has no ray and reflects the sky as `sky` does; from three quarters of it on the two are blended. \
                 1: every surface has rays. Lower: less time, and glossy surfaces lose reflections of things.";
    let mut settings = vec![
        SettingSpec::among("rays", "", rays, 1, &[1, 2, 4, 8]).sweep_all(),
        SettingSpec::among("pixels_per_ray", "", pixels_per_ray, 1, &[1, 2, 4]).sweep_all(),
        SettingSpec::integer("bounces", "", bounces, 2, 1..=8).sweep([1, 2, 4]),
        hit_shading::regularization(),
        SettingSpec::switch("reuse", reuse, true).sweep_all(),
        SettingSpec::switch("reconstruct", reconstruct, false).sweep_all(),
        SettingSpec::float("roughness_limit", "", limit, 1.0, 0.0..=1.0).sweep([0.3, 0.6, 1.0]),
    ];
    settings.extend(Reconstruction::settings(8));
    settings.extend(denoise::settings_with("pica-pica"));
    settings.push(precision::setting());
    settings
}

/// Number of cells across and down.
fn cells(pixels_per_ray: u32, frame: Extent) -> Extent {
    let across = if pixels_per_ray > 1 { 2 } else { 1 };
    let down = if pixels_per_ray > 2 { 2 } else { 1 };
    Extent::new(frame.width.div_ceil(across), frame.height.div_ceil(down))
}

impl RayTraced {
    /// Creates the pipelines.
    pub fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        let pixels_per_ray = settings.u32("pixels_per_ray")?;
        let samples = if pixels_per_ray == 1 { settings.u32("rays")? } else { 1 };
        let format = precision::format(settings)?;
        let roughness_limit = settings.f32("roughness_limit")?;
        let reconstructs = pixels_per_ray > 1 || (samples == 1 && settings.switch("reconstruct")?);
        Ok(Self {
            trace: RayKernels::new(build, &REFLECTIONS_TRACE_RAY, &REFLECTIONS_TINTED_TRACE_RAY)?,
            samples,
            pixels_per_ray,
            bounces: settings.u32("bounces")?,
            regularization: settings.f32("regularization")?,
            reuse: settings.switch("reuse")?,
            reconstruction: reconstructs.then(|| Reconstruction::new(build, settings, format)).transpose()?,
            roughness_limit,
            fallback: SkyLight::new(build, "reflections.sky", &REFLECTIONS_SKY_COMP, false, idle_reason, settings)?,
            resolve: Resolve::new(build, format)?.limited(roughness_limit, 0.0),
            format,
            denoiser: Denoiser::new(build, "reflections", Options::read(settings)?)?,
        })
    }

    /// Adds the rays, of which each pixel has its own.
    fn trace(&self, g: &mut FrameGraph, view: &View, i: LightingIn, hits: HitShading) -> SpecularSignal {
        let (launch, format) = (self.launch(view), self.format);
        g.pass("reflections.trace", Queue::AsyncCompute, |p| {
            let declared = launch.declare(p, i, hits);
            let extent = p.extent(i.gbuffer.depth);
            let (traced, targets) = SpecularSignal::create(p, "radiance", format, i.gbuffer.depth);
            (traced, move |c: &mut Record<'_>| {
                let params = TraceParams {
                    radiance: c.id(targets.radiance),
                    hit_distance: c.id(targets.hit_distance),
                    width: c.id(targets.width),
                    rays_found: NO_IMAGE,
                    ..launch.params(c, declared)
                };
                c.trace(launch.kernel, declared.scene.tlas, &params, extent);
            })
        })
    }

    /// Adds one ray for each cell.
    fn trace_cells(&self, g: &mut FrameGraph, view: &View, i: LightingIn, hits: HitShading) -> Found {
        let (launch, format, frame) = (self.launch(view), self.format, g.extent(i.gbuffer.depth));
        let cells = cells(launch.pixels_per_ray, frame);
        g.pass("reflections.trace", Queue::AsyncCompute, |p| {
            let declared = launch.declare(p, i, hits);
            let (radiance, radiance_target) = p.create("radiance", ImageDesc::fixed(format, cells));
            let (rays, rays_target) = p.create("rays", ImageDesc::fixed(RAY, cells));
            (Found { radiance: radiance.read(), rays: rays.read() }, move |c: &mut Record<'_>| {
                let params = TraceParams {
                    radiance: c.id(radiance_target),
                    rays_found: c.id(rays_target).index(),
                    ..launch.params(c, declared)
                };
                c.trace(launch.kernel, declared.scene.tlas, &params, cells);
            })
        })
    }

    fn launch(&self, view: &View) -> Launch {
        let kernel = self.trace.of(view);
        let Self { samples, pixels_per_ray, bounces, regularization, roughness_limit, format, .. } = *self;
        let (view, greatest) = (view.block, format.greatest());
        Launch { kernel, view, samples, pixels_per_ray, bounces, regularization, roughness_limit, greatest }
    }
}

impl Effect for RayTraced {
    type In = LightingIn;
    type Out = LightingOut;

    fn needs(&self, facts: &SceneFacts) -> Needs {
        if let Some(reason) = idle_reason(facts) {
            return Needs::idle(reason);
        }
        if facts.has_smooth(self.roughness_limit) {
            return Needs { previous_radiance: self.reuse, ..hit_shading::needs(facts) };
        }
        if facts.has_sky { Needs::default() } else { Needs::idle(ALL_ROUGH) }
    }

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: LightingIn) -> LightingOut {
        if !view.facts.has_smooth(self.roughness_limit) {
            return self.fallback.add(g, view, i);
        }
        let is_idle = self.needs(&view.facts).idle.is_some();
        let Some(hits) = HitShading::new(&i, self.reuse).filter(|_| !is_idle) else { return LightingOut::default() };
        let traced = match &self.reconstruction {
            Some(reconstruction) => {
                let found = self.trace_cells(g, view, i, hits);
                reconstruction.add(
                    g,
                    view,
                    i,
                    found,
                    Cells::Even { pixels_per_ray: self.pixels_per_ray, roughness_limit: self.roughness_limit },
                )
            }
            None => self.trace(g, view, i, hits),
        };
        let noisy = traced.noisy(i.gbuffer, i.reprojected);
        let noisy = DenoiseIn { hints: noisy.hints.weighted(self.reconstruction.is_some()), ..noisy };
        let denoised = self.denoiser.add(g, view, noisy, "");
        LightingOut::radiance(self.resolve.add(g, view, i, Some(denoised), None)).with_hit_distance(traced.hit_distance)
    }
}

/// What both ways to launch rays share.
#[derive(Clone, Copy)]
struct Launch {
    kernel: RayKernel,
    view: Handle<Buffer>,
    samples: u32,
    pixels_per_ray: u32,
    bounces: u32,
    regularization: f32,
    roughness_limit: f32,
    greatest: f32,
}

/// What a pass that launches rays reads.
#[derive(Clone, Copy)]
struct Declared {
    view: BufferToken,
    scene: SceneToken,
    hits: HitShadingToken,
    gbuffer: GBufferToken,
}

impl Launch {
    fn declare(self, p: &mut PassBuilder<'_>, i: LightingIn, hits: HitShading) -> Declared {
        let gbuffer = i.gbuffer.read(p, &[RAY_START, MATERIAL].concat());
        Declared { view: p.read(self.view), scene: i.scene.trace(p), hits: hits.read(p), gbuffer }
    }

    /// The parameters but for the images that are written.
    fn params(self, c: &Record<'_>, declared: Declared) -> TraceParams {
        TraceParams {
            view: c.id(declared.view),
            scene: c.id(declared.scene.root),
            rays: c.rays(),
            gbuffer: declared.gbuffer.images(c),
            hits: declared.hits.params(c),
            // One of them is 1.
            density: self.samples.max(self.pixels_per_ray),
            bounces: self.bounces,
            regularization: self.regularization,
            greatest: self.greatest,
            roughness_limit: self.roughness_limit,
            ..TraceParams::default()
        }
    }
}
