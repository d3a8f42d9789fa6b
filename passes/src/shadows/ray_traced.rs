//! Shadow rays: from each surface that is seen, or from one of four, to points of the lights.
use crate::stages::ShadowIn;
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::scene::Caster;
use magpie::stage::{Build, SettingSpec, Settings, StageError};
use magpie_shaders::shadows::{TraceParams, UpsampleParams};
use magpie_shaders::view::NO_LIGHT;
use magpie_shaders::{SHADOWS_TRACE_RAY, SHADOWS_UPSAMPLE_COMP};

/// Traces.
pub struct RayTraced {
    trace: RayKernel,
    /// At half resolution only.
    upsample: Option<Kernel>,
    /// To each light that has a size; 0 for hard shadows.
    samples: u32,
}

/// Its settings.
pub fn settings() -> [SettingSpec; 3] {
    [
        SettingSpec::choice(
            "resolution",
            "`full`: each pixel has rays. `half`: one of four, brought to full size along surfaces; a quarter of the rays, thin shadows \
             and the edges of others suffer.",
            "full",
            &["full", "half"],
        )
        .sweep_all(),
        SettingSpec::choice(
            "edges",
            "`soft`: rays go to points all over a light, whose shadows have penumbrae, and noise. `hard`: one ray to its centre, as \
             though it were a point.",
            "soft",
            &["soft", "hard"],
        )
        .sweep_all(),
        SettingSpec::among(
            "rays",
            "",
            "Rays of a pixel to each light that has a size. Higher: less noise, its variance falls by as much as the time grows.",
            1,
            &[1, 2, 4, 8],
        )
        .sweep_all(),
    ]
}

/// One number for each light: no more memory than is needed.
pub fn format(lights: usize) -> Format {
    match lights {
        1 => Format::R8Unorm,
        2 => Format::Rg8Unorm,
        _ => Format::Rgba8Unorm,
    }
}

/// Indices of up to four lights.
pub fn indices(lights: &[Caster]) -> [u32; 4] {
    std::array::from_fn(|k| lights.get(k).map_or(NO_LIGHT, |caster| caster.light))
}

impl RayTraced {
    /// Makes its pipelines.
    pub fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, StageError> {
        let half = settings.choice("resolution")? == "half";
        let upsample = half.then(|| build.gpu.kernel(&SHADOWS_UPSAMPLE_COMP)).transpose().map_err(StageError::other)?;
        let samples = if settings.choice("edges")? == "hard" { 0 } else { settings.u32("rays")? };
        Ok(Self { trace: build.ray_kernel(&SHADOWS_TRACE_RAY)?, upsample, samples })
    }

    /// Visibility of up to four lights, one in each channel.
    pub fn add(&self, g: &mut FrameGraph, view: &View, i: ShadowIn, lights: &[Caster], name: &str) -> Handle<Image> {
        let (kernel, samples, block, step) =
            (self.trace, self.samples, view.block, if self.upsample.is_some() { 2 } else { 1 });
        let (count, lights, format) = (lights.len() as u32, indices(lights), format(lights.len()));
        let traced = g.pass(&format!("shadows.trace{name}"), Queue::AsyncCompute, |p| {
            let (block, tlas) = (p.read(block), i.scene.trace(p));
            let (depth, normal) = (p.sample(i.gbuffer.depth), p.sample(i.gbuffer.normal));
            let ids = p.sample(i.gbuffer.ids);
            let like = ImageDesc::like(format, i.gbuffer.depth);
            let desc = if step == 1 { like } else { ImageDesc::half(format) };
            let (visibility, target) = p.create("visibility", desc);
            let extent = p.extent_of(desc);
            (visibility.read(), move |c: &mut Record<'_>| {
                let params = TraceParams {
                    view: c.id(block),
                    rays: c.rays(),
                    depth: c.id(depth),
                    normal: c.id(normal),
                    ids: c.id(ids),
                    visibility: c.id(target),
                    step,
                    samples,
                    count,
                    lights,
                };
                c.trace(kernel, tlas, &params, extent);
            })
        });
        match self.upsample {
            Some(kernel) => upsample(g, view, kernel, i, traced, name),
            None => traced,
        }
    }
}

/// From half resolution to full.
fn upsample(
    g: &mut FrameGraph,
    view: &View,
    kernel: Kernel,
    i: ShadowIn,
    traced: Handle<Image>,
    name: &str,
) -> Handle<Image> {
    let block = view.block;
    let format = g.desc(traced).format;
    g.pass(&format!("shadows.upsample{name}"), Queue::AsyncCompute, |p| {
        let (block, traced) = (p.read(block), p.sample(traced));
        let (depth, normal) = (p.sample(i.gbuffer.depth), p.sample(i.gbuffer.normal));
        let (visibility, target) = p.create("visibility", ImageDesc::like(format, i.gbuffer.depth));
        let extent = p.extent(i.gbuffer.depth);
        (visibility.read(), move |c: &mut Record<'_>| {
            let params = UpsampleParams {
                view: c.id(block),
                depth: c.id(depth),
                normal: c.id(normal),
                half_visibility: c.id(traced),
                visibility: c.id(target),
            };
            c.dispatch(kernel, &params, extent);
        })
    })
}
