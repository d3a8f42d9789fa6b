//! From rays to the slot's radiance: reconstruction for every pixel, and the product with the albedo of the lobe. What the implementations that
//! trace share.
use crate::contracts::{Channel, GEOMETRY, LightingIn};
use crate::specular_signal::SpecularSignal;
use magpie::gpu::Kernel;
use magpie::graph::WriteHandle;
use magpie::prelude::*;
use magpie::scene::SceneFacts;
use magpie::slot::{Build, SettingSpec, Settings, SlotError};
use magpie_shaders::denoise::NO_IMAGE;
use magpie_shaders::reflections::{MOST_TAPS, ReconstructParams, ResolveParams};
use magpie_shaders::{REFLECTIONS_RECONSTRUCT_COMP, REFLECTIONS_RESOLVE_COMP, SampledImage};

/// Channels with the material.
pub const MATERIAL: &[Channel] = &[Channel::BaseColour, Channel::Material, Channel::Coat];

/// Single rays.
#[derive(Clone, Copy)]
pub struct Found {
    pub radiance: Handle<Image>,
    pub rays: Handle<Image>,
}

/// Where the rays of [`Found`] start.
pub enum Cells {
    /// One for so many pixels, 1, 2 side by side or 4 in a square, unless the surface is rougher than the limit; the images have a pixel for
    /// each such cell.
    Even { pixels_per_ray: u32, roughness_limit: f32 },
    /// As the image of rates says, `rate` of `choose.comp`; the images have the size of the frame. `steering`, for the next frame, is written.
    Rated { rate: Handle<Image>, steering: WriteHandle<Image> },
}

/// Makes a full image of rays.
pub struct Reconstruction {
    kernel: Kernel,
    taps: u32,
    reach: f32,
    firefly_limit: f32,
    format: Format,
}

impl Reconstruction {
    /// Settings, of which `taps` has another default from implementation to implementation.
    pub fn settings(default_taps: i64) -> [SettingSpec; 3] {
        let taps = "Of `reconstruct`: rays that are looked at. Higher: less noise, more time.";
        let reach = "Of `reconstruct`: greatest distance of these rays. No farther than half of the lobe's width on the screen. Higher: \
                     less noise, softer.";
        let firefly_limit = "Of `reconstruct`: limit for the brightest of these rays, over the mean of the others. Lower: fewer bright \
                             specks, but light of small bright things is lost.";
        [
            SettingSpec::integer("taps", "", taps, default_taps, 1..=MOST_TAPS.into()).sweep([4, 8, 16]),
            SettingSpec::float("reach", "pixels", reach, 16.0, 1.0..=64.0).sweep([8.0, 16.0, 32.0]),
            SettingSpec::float("firefly_limit", "", firefly_limit, 8.0, 1.0..=1e6),
        ]
    }

    /// Creates the pipeline.
    pub fn new(build: &Build<'_>, settings: &Settings, format: Format) -> Result<Self, SlotError> {
        Ok(Self {
            kernel: build.kernel(&REFLECTIONS_RECONSTRUCT_COMP)?,
            taps: settings.u32("taps")?,
            reach: settings.f32("reach")?,
            firefly_limit: settings.f32("firefly_limit")?,
            format,
        })
    }

    /// Adds the pass.
    pub fn add(&self, g: &mut FrameGraph, view: &View, i: LightingIn, found: Found, cells: Cells) -> SpecularSignal {
        let Self { kernel, taps, reach, firefly_limit, format } = *self;
        let block = view.block;
        g.pass("reflections.reconstruct", Queue::AsyncCompute, |p| {
            let (block, guide) = (p.read(block), p.sample(i.reprojected.guide));
            let gbuffer = i.gbuffer.read(p, &[&[Channel::Depth, Channel::Normal], MATERIAL].concat());
            let (rays, light) = (p.sample(found.rays), p.sample(found.radiance));
            let (pixels_per_ray, roughness_limit, rated) = match cells {
                Cells::Even { pixels_per_ray, roughness_limit } => (pixels_per_ray, roughness_limit, None),
                Cells::Rated { rate, steering } => (1, 1.0, Some((p.sample(rate), p.overwrite(steering).1))),
            };
            let extent = p.extent(i.gbuffer.depth);
            let (traced, targets) = SpecularSignal::create(p, "radiance", format, i.gbuffer.depth);
            (traced, move |c: &mut Record<'_>| {
                let params = ReconstructParams {
                    view: c.id(block),
                    not_finite: c.not_finite(),
                    gbuffer: gbuffer.images(c),
                    guide: c.id(guide),
                    found: c.id(light),
                    rays_found: c.id(rays),
                    radiance: c.id(targets.radiance),
                    hit_distance: c.id(targets.hit_distance),
                    width: c.id(targets.width),
                    rate: rated.map_or(NO_IMAGE, |(rate, _)| c.id(rate).index()),
                    steering: rated.map_or(NO_IMAGE, |(_, steering)| c.id(steering).index()),
                    pixels_per_ray,
                    taps,
                    radius: reach,
                    firefly_limit,
                    greatest: format.greatest(),
                    roughness_limit,
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }
}

/// Multiplies with the albedo of the lobe, and puts the fallback where rays are not worth it.
pub struct Resolve {
    kernel: Kernel,
    format: Format,
    /// Perceptual roughness from which the fallback stands alone; 1 for none.
    pub roughness_limit: f32,
    /// Albedo of the lobe below which the fallback stands alone.
    pub faint: f32,
}

impl Resolve {
    /// Creates the pipeline, without limits.
    pub fn new(build: &Build<'_>, format: Format) -> Result<Self, SlotError> {
        Ok(Self { kernel: build.kernel(&REFLECTIONS_RESOLVE_COMP)?, format, roughness_limit: 1.0, faint: 0.0 })
    }

    /// Sets the limits.
    pub fn limited(self, roughness_limit: f32, faint: f32) -> Self {
        Self { roughness_limit, faint, ..self }
    }

    /// Whether the fallback leaves anything to rays.
    pub fn takes_rays(&self, facts: &SceneFacts) -> bool {
        facts.has_smooth(self.roughness_limit)
    }

    /// Adds the pass. Without `fallback` it is the sky. `denoised` is not needed where [`Self::takes_rays`] is false.
    pub fn add(
        &self,
        g: &mut FrameGraph,
        view: &View,
        i: LightingIn,
        denoised: Option<Handle<Image>>,
        fallback: Option<Handle<Image>>,
    ) -> Handle<Image> {
        let Self { kernel, format, roughness_limit, faint } = *self;
        let block = view.block;
        let has_fallback = roughness_limit < 1.0 || faint > 0.0;
        g.pass("reflections.resolve", Queue::AsyncCompute, |p| {
            let (block, denoised) = (p.read(block), denoised.map(|image| p.sample(image)));
            let geometry: &[Channel] = if has_fallback { GEOMETRY } else { &[Channel::Depth, Channel::Normal] };
            let gbuffer = i.gbuffer.read(p, &[geometry, MATERIAL].concat());
            let openness = i.ao.openness.filter(|_| has_fallback && fallback.is_none()).map(|image| p.sample(image));
            let fallback = fallback.filter(|_| has_fallback).map(|image| p.sample(image));
            let (radiance, target) = p.create("radiance", ImageDesc::like(format, i.gbuffer.depth));
            let extent = p.extent(i.gbuffer.depth);
            (radiance.read(), move |c: &mut Record<'_>| {
                let params = ResolveParams {
                    view: c.id(block),
                    gbuffer: gbuffer.images(c),
                    denoised: denoised.map_or(SampledImage::NONE, |token| c.id(token)),
                    fallback: fallback.map_or(NO_IMAGE, |token| c.id(token).index()),
                    openness: openness.map_or(NO_IMAGE, |token| c.id(token).index()),
                    radiance: c.id(target),
                    roughness_limit,
                    faint,
                    greatest: format.greatest(),
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }
}
