//! Ray-traced ambient occlusion: rays over the cosine-weighted hemisphere, as the reference has them. What comes out is noisy: 1 ray per
//! pixel says no more than open or hidden.
use super::upsample::{OPENNESS, upsample};
use crate::stages::{AoIn, AoOut};
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::stage::{Build, SettingSpec, Settings, StageError};
use magpie_shaders::ao::TraceParams;
use magpie_shaders::{AO_TRACE_RAY, AO_UPSAMPLE_COMP};

/// The effect.
pub struct RayTraced {
    trace: RayKernel,
    samples: u32,
    range: f32,
    /// At half resolution only.
    upsample: Option<Kernel>,
}

/// Its settings.
pub fn settings() -> [SettingSpec; 3] {
    let rays = "Rays per pixel and frame. Higher: less noise, at a cost that grows as much.";
    let resolution = "`full`: rays from every pixel. `half`: from one of four pixels, brought to full size along surfaces; a quarter \
                      of the rays, small folds suffer.";
    [
        SettingSpec::integer("rays", "", rays, 1, (1, 64)).sweep([1, 2, 4, 8]),
        super::range(),
        SettingSpec::choice("resolution", resolution, "full", &["full", "half"]).sweep_all(),
    ]
}

impl RayTraced {
    /// Makes its pipelines.
    pub fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, StageError> {
        let half = settings.choice("resolution")? == "half";
        let upsample = half.then(|| build.gpu.kernel(&AO_UPSAMPLE_COMP)).transpose().map_err(StageError::other)?;
        let (samples, range) = (settings.u32("rays")?, settings.f32("range")?);
        Ok(Self { trace: build.ray_kernel(&AO_TRACE_RAY)?, samples, range, upsample })
    }
}

impl Effect for RayTraced {
    type In = AoIn;
    type Out = AoOut;

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: AoIn) -> AoOut {
        let (kernel, block, samples, range) = (self.trace, view.block, self.samples, self.range);
        let step = if self.upsample.is_some() { 2 } else { 1 };
        let traced = g.pass("ao.trace", Queue::AsyncCompute, |p| {
            let (block, tlas) = (p.read(block), i.scene.trace(p));
            let (depth, normal) = (p.sample(i.gbuffer.depth), p.sample(i.gbuffer.normal));
            let ids = p.sample(i.gbuffer.ids);
            let like = ImageDesc::like(OPENNESS, i.gbuffer.depth);
            let desc = if step == 1 { like } else { ImageDesc::half(OPENNESS) };
            let (openness, target) = p.create("openness", desc);
            let extent = p.extent_of(desc);
            (openness.read(), move |c: &mut Record<'_>| {
                let params = TraceParams {
                    view: c.id(block),
                    rays: c.rays(),
                    depth: c.id(depth),
                    normal: c.id(normal),
                    ids: c.id(ids),
                    openness: c.id(target),
                    step,
                    samples,
                    range,
                };
                c.trace(kernel, tlas, &params, extent);
            })
        });
        // A denoiser goes here: `traced` is what it takes.
        match self.upsample {
            Some(kernel) => upsample(g, view, kernel, i, traced, false),
            None => AoOut { openness: Some(traced), bent_normal: None },
        }
    }
}
