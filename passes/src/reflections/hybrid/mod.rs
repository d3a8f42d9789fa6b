//! Reflections by as few rays as the picture shows: chosen per pixel, found on the screen where it knows enough, traced elsewhere, with a fallback
//! where rays are not worth their time.
mod settings;

use super::idle_reason;
use super::probe::Probes;
use super::reconstruct::{Cells, Found, MATERIAL, Reconstruction, Resolve};
use crate::contracts::{Channel, LightingIn, LightingOut, RAY_START};
use crate::parts::denoise::{DenoiseIn, Denoiser, Options};
use crate::parts::hit_shading::{self, HitShading};
use crate::parts::pixel_lists::{PixelList, PixelLists};
use crate::parts::pyramid::{self, Pyramid};
use crate::precision;
use crate::ray_kernels::RayKernels;
use magpie::gpu::Kernel;
use magpie::graph::{History, HistoryScope, WriteHandle};
use magpie::prelude::*;
use magpie::scene::SceneFacts;
use magpie::slot::{Build, Needs, Settings, SlotError};
use magpie_shaders::hybrid_reflections::{
    ChooseParams, HybridMarchParams, HybridTraceParams, RATE_FULL, RATE_QUARTER, RATE_SIXTEENTH, SourcesParams,
};
use magpie_shaders::screen_march::{ScreenLight, ScreenMarch};
use magpie_shaders::{
    REFLECTIONS_CHOOSE_COMP, REFLECTIONS_HYBRID_MARCH_COMP, REFLECTIONS_HYBRID_TINTED_TRACE_RAY,
    REFLECTIONS_HYBRID_TRACE_RAY, REFLECTIONS_SOURCES_COMP,
};
pub use settings::settings;

/// Levels of the pyramid of depths: cells of 2 to 64 pixels.
const LEVELS: u32 = 6;
/// Greatest number of steps of a ray through the depth image.
const STEPS: u32 = 48;
/// Greatest length of such a ray, metres.
const DISTANCE: f32 = 1000.0;
/// Share of the picture's width and height over which the screen's knowledge fades at each border.
const EDGE: f32 = 0.05;
/// Format of the rays.
const RAY: Format = Format::Rgba16Float;
/// Format of what the next frame knows of this one's noise and lobes.
const STEERING: Format = Format::Rgba8Unorm;

/// Reflections by as few rays as the picture shows.
pub struct Hybrid {
    choose: Kernel,
    march: Kernel,
    trace: RayKernels,
    sources: Kernel,
    lists: PixelLists,
    /// Without it all rays are traced.
    pyramid: Option<Pyramid>,
    reconstruction: Reconstruction,
    resolve: Resolve,
    denoiser: Denoiser,
    /// Without it the sky is the fallback.
    probes: Option<Probes>,
    scope: HistoryScope,
    spacing: f32,
    /// `RATE_*`.
    least_rate: u32,
    noise: f32,
    /// Rays per pixel; 0 for no limit.
    budget: f64,
    thickness: f32,
    bounces: u32,
    regularization: f32,
    format: Format,
}

/// Where rays start.
struct Chosen {
    rate: Handle<Image>,
    keys: Handle<Image>,
    rays: Rays,
}

/// The images that rays are written into.
struct Rays {
    radiance: WriteHandle<Image>,
    rays: WriteHandle<Image>,
}

impl Hybrid {
    /// Creates the pipelines.
    pub fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        let format = precision::format(settings)?;
        let by_probes = settings.choice("fallback")? == "probe";
        Ok(Self {
            choose: build.kernel(&REFLECTIONS_CHOOSE_COMP)?,
            march: build.kernel(&REFLECTIONS_HYBRID_MARCH_COMP)?,
            trace: RayKernels::new(build, &REFLECTIONS_HYBRID_TRACE_RAY, &REFLECTIONS_HYBRID_TINTED_TRACE_RAY)?,
            sources: build.kernel(&REFLECTIONS_SOURCES_COMP)?,
            lists: PixelLists::new(build, "reflections")?,
            pyramid: settings
                .switch("screen")?
                .then(|| Pyramid::new(build, "reflections", pyramid::Content::MinMax))
                .transpose()?,
            reconstruction: Reconstruction::new(build, settings, format)?,
            resolve: Resolve::new(build, format)?.limited(settings.f32("roughness_limit")?, settings.f32("faint")?),
            denoiser: Denoiser::new(build, "reflections", Options::read(settings)?)?,
            probes: by_probes.then(|| Probes::with_defaults(build)).transpose()?,
            scope: HistoryScope::new(),
            spacing: settings.f32("spacing")?,
            least_rate: match settings.u32("pixels_per_ray")? {
                1 => RATE_FULL,
                4 => RATE_QUARTER,
                _ => RATE_SIXTEENTH,
            },
            noise: settings.f32("noise")?,
            budget: settings.f64("budget")?,
            thickness: settings.f32("thickness")?,
            bounces: settings.u32("bounces")?,
            regularization: settings.f32("regularization")?,
            format,
        })
    }

    /// Adds the pass that decides where rays start.
    fn choose(&self, g: &mut FrameGraph, view: &View, i: LightingIn, steering: Handle<Image>) -> Chosen {
        let (kernel, block, format) = (self.choose, view.block, self.format);
        let Self { spacing, least_rate, noise, .. } = *self;
        let screen = self.pyramid.is_some().into();
        let (faint, roughness_limit) = (self.resolve.faint, self.resolve.roughness_limit);
        g.pass("reflections.choose", Queue::AsyncCompute, |p| {
            let block = p.read(block);
            let read = [&[Channel::Depth, Channel::Normal, Channel::Motion], MATERIAL].concat();
            let gbuffer = i.gbuffer.read(p, &read);
            let (taps, steering) = (p.sample(i.reprojected.taps), p.sample(steering));
            let mut create = |name, format| p.create(name, ImageDesc::like(format, i.gbuffer.depth));
            let (rate, rate_target) = create("rate", Format::Rgba8Unorm);
            let (keys, keys_target) = create("keys", Format::R8Unorm);
            let (radiance, radiance_target) = create("found", format);
            let (rays, rays_target) = create("rays", RAY);
            let extent = p.extent(i.gbuffer.depth);
            let chosen = Chosen { rate: rate.read(), keys: keys.read(), rays: Rays { radiance, rays } };
            (chosen, move |c: &mut Record<'_>| {
                let params = ChooseParams {
                    view: c.id(block),
                    gbuffer: gbuffer.images(c),
                    taps: c.id(taps),
                    steering: c.id(steering),
                    rate: c.id(rate_target),
                    keys: c.id(keys_target),
                    found: c.id(radiance_target),
                    rays_found: c.id(rays_target),
                    spacing,
                    least_rate,
                    noise,
                    faint,
                    roughness_limit,
                    screen,
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }

    /// Adds the pass that looks for rays on the screen. Returns those that it did not find.
    fn march(&self, g: &mut FrameGraph, view: &View, i: LightingIn, from: Marched, rays: Rays) -> (PixelList, Rays) {
        let Marched { list, rate, previous, pyramid } = from;
        let (kernel, block, format, thickness) = (self.march, view.block, self.format, self.thickness);
        let rest = self.lists.empty(g, "rest", g.extent(i.gbuffer.depth));
        g.pass("reflections.march", Queue::AsyncCompute, |p| {
            let (block, scene, pyramid) = (p.read(block), i.scene.read(p), p.sample(pyramid));
            let gbuffer = i.gbuffer.read(p, &[RAY_START, MATERIAL, &[Channel::Emission]].concat());
            let (previous, guide) = (p.sample(previous), p.sample(i.reprojected.previous_guide));
            let (list, rate) = (list.read(p), p.sample(rate));
            let (rest, rest_target) = rest.fill(p);
            let (radiance, radiance_target) = p.overwrite(rays.radiance);
            let (rays, rays_target) = p.overwrite(rays.rays);
            ((rest, Rays { radiance, rays }), move |c: &mut Record<'_>| {
                let march =
                    ScreenMarch { pyramid: c.id(pyramid), levels: LEVELS, steps: STEPS, thickness, distance: DISTANCE };
                let light = ScreenLight {
                    march,
                    previous_radiance: c.id(previous),
                    previous_guide: c.id(guide),
                    edge: EDGE,
                    has_emission: i.gbuffer.emission.is_some().into(),
                };
                let params = HybridMarchParams {
                    view: c.id(block),
                    scene: c.id(scene),
                    not_finite: c.not_finite(),
                    list: c.id(list.list),
                    rest: c.id(rest_target),
                    gbuffer: gbuffer.images(c),
                    rate: c.id(rate),
                    light,
                    found: c.id(radiance_target),
                    rays_found: c.id(rays_target),
                    greatest: format.greatest(),
                };
                c.dispatch_indirect(kernel, &params, list.threads, 0);
            })
        })
    }

    /// Adds the pass that traces the rays of a list.
    fn trace(&self, g: &mut FrameGraph, view: &View, i: LightingIn, of: Listed, rays: Rays) -> Found {
        let Listed { list, rate, hits } = of;
        let kernel = self.trace.of(view);
        let Self { bounces, regularization, format, .. } = *self;
        let block = view.block;
        g.pass("reflections.trace", Queue::AsyncCompute, |p| {
            let (block, scene, hits) = (p.read(block), i.scene.trace(p), hits.read(p));
            let gbuffer = i.gbuffer.read(p, &[RAY_START, MATERIAL].concat());
            let (list, rate) = (list.read(p), p.sample(rate));
            let (radiance, radiance_target) = p.overwrite(rays.radiance);
            let (rays, rays_target) = p.overwrite(rays.rays);
            (Found { radiance: radiance.read(), rays: rays.read() }, move |c: &mut Record<'_>| {
                let params = HybridTraceParams {
                    view: c.id(block),
                    scene: c.id(scene.root),
                    rays: c.rays(),
                    list: c.id(list.list),
                    gbuffer: gbuffer.images(c),
                    rate: c.id(rate),
                    hits: hits.params(c),
                    found: c.id(radiance_target),
                    rays_found: c.id(rays_target),
                    bounces,
                    regularization,
                    greatest: format.greatest(),
                };
                c.trace_indirect(kernel, scene.tlas, &params, list.threads, 0);
            })
        })
    }

    /// Adds the picture of where each pixel's reflection comes from. It is left out unless somebody looks at it.
    fn sources(&self, g: &mut FrameGraph, rate: Handle<Image>, found: Handle<Image>) {
        let kernel = self.sources;
        g.pass("reflections.sources", Queue::AsyncCompute, |p| {
            let extent = p.extent(rate);
            let (colours, target) = p.create("colours", ImageDesc::like(Format::Rgba8Unorm, rate));
            let (rate, found) = (p.sample(rate), p.sample(found));
            (colours.read(), move |c: &mut Record<'_>| {
                let size = [extent.width, extent.height];
                let params = SourcesParams { rate: c.id(rate), found: c.id(found), colours: c.id(target), size };
                c.dispatch(kernel, &params, extent);
            })
        });
    }
}

/// What a pass that marches rays reads.
#[derive(Clone, Copy)]
struct Marched {
    list: PixelList,
    rate: Handle<Image>,
    previous: Handle<Image>,
    pyramid: Handle<Image>,
}

/// What a pass that traces rays reads.
#[derive(Clone, Copy)]
struct Listed {
    list: PixelList,
    rate: Handle<Image>,
    hits: HitShading,
}

impl Effect for Hybrid {
    type In = LightingIn;
    type Out = LightingOut;

    fn needs(&self, facts: &SceneFacts) -> Needs {
        if let Some(reason) = idle_reason(facts) {
            return Needs::idle(reason);
        }
        let takes_rays = self.resolve.takes_rays(facts);
        if !takes_rays && self.probes.is_none() && !facts.has_sky {
            return Needs::idle("all surfaces are rougher than `roughness_limit`, and the scene has no sky");
        }
        let shades_hits = takes_rays || self.probes.is_some();
        let needs = if shades_hits { hit_shading::needs(facts) } else { Needs::default() };
        Needs { previous_radiance: takes_rays, ..needs }
    }

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: LightingIn) -> LightingOut {
        if self.needs(&view.facts).idle.is_some() {
            return LightingOut::default();
        }
        let fallback = self.probes.as_mut().and_then(|probes| probes.add(g, view, i).radiance);
        let Some(hits) = HitShading::new(&i, true).filter(|_| self.resolve.takes_rays(&view.facts)) else {
            return LightingOut::radiance(self.resolve.add(g, view, i, None, fallback));
        };
        let History { previous, next, .. } =
            g.history(&self.scope, "steering", ImageDesc::like(STEERING, i.gbuffer.depth));
        let Chosen { rate, keys, mut rays } = self.choose(g, view, i, previous);
        let extent = g.extent(i.gbuffer.depth);
        let most = (self.budget > 0.0)
            .then(|| (self.budget * f64::from(extent.width) * f64::from(extent.height)).ceil() as u32);
        let mut list = self.lists.add(g, "rays", keys, most);
        if let (Some(pyramid), Some(previous)) = (&self.pyramid, i.previous_radiance) {
            let pyramid = pyramid.add(g, i.gbuffer.depth, LEVELS);
            (list, rays) = self.march(g, view, i, Marched { list, rate, previous, pyramid }, rays);
        }
        let found = self.trace(g, view, i, Listed { list, rate, hits }, rays);
        self.sources(g, rate, found.radiance);
        let traced = self.reconstruction.add(g, view, i, found, Cells::Rated { rate, steering: next });
        let noisy = traced.noisy(i.gbuffer, i.reprojected);
        let noisy = DenoiseIn { hints: noisy.hints.weighted(true), ..noisy };
        let denoised = self.denoiser.add(g, view, noisy, "");
        LightingOut::radiance(self.resolve.add(g, view, i, Some(denoised), fallback))
            .with_hit_distance(traced.hit_distance)
    }
}
