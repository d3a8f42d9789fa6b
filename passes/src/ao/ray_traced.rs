//! Ray-traced ambient occlusion: cosine-distributed rays over the hemisphere, as in the reference, followed by a denoiser. With 1 ray per
//! pixel each sample is either 0 or 1.
use super::{OPENNESS, needs};
use crate::contracts::{AoIn, AoOut, RAY_START};
use crate::parts::denoise::{self, Content, DenoiseIn, Denoiser, Hints, Options, Signal, Surfaces};
use crate::parts::upsample::{Upsample, UpsampleIn};
use magpie::prelude::*;
use magpie::scene::SceneFacts;
use magpie::slot::{Build, Needs, SettingSpec, Settings, SlotError};
use magpie_shaders::AO_TRACE_RAY;
use magpie_shaders::ao::TraceParams;

/// Ray-traced ambient occlusion.
pub struct RayTraced {
    trace: RayKernel,
    samples: u32,
    range: f32,
    /// Set at half resolution only.
    upsample: Option<Upsample>,
    denoiser: Denoiser,
}

/// Settings of `ray-traced`.
pub fn settings() -> Vec<SettingSpec> {
    let rays = "Rays per pixel. Higher: less noise, with time proportional to the number.";
    let resolution = "`full`: rays from every pixel. `half`: rays from one pixel of four, upsampled along surfaces; a quarter of the \
                      rays, but small creases lose detail.";
    let mut settings = vec![SettingSpec::integer("rays", "", rays, 1, 1..=64).sweep([1, 2, 4, 8])];
    // Occluders mostly move together with the surface, so temporal gradients (the setting `adaptive`) are not offered.
    settings.extend(denoise::settings());
    settings.push(denoise::precision());
    settings.push(super::range());
    settings.push(SettingSpec::choice("resolution", resolution, "full", &["full", "half"]).sweep_all());
    settings
}

impl RayTraced {
    /// Creates the pipelines.
    pub fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        let half = settings.choice("resolution")? == "half";
        let upsample = half.then(|| Upsample::new(build, "ao")).transpose()?;
        let (samples, range) = (settings.u32("rays")?, settings.f32("range")?);
        let denoiser = Denoiser::new(build, "ao", Options::read(settings)?)?;
        Ok(Self { trace: build.ray_kernel(&AO_TRACE_RAY)?, samples, range, upsample, denoiser })
    }
}

impl Effect for RayTraced {
    type In = AoIn;
    type Out = AoOut;

    fn needs(&self, facts: &SceneFacts) -> Needs {
        needs(facts)
    }

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: AoIn) -> AoOut {
        if self.needs(&view.facts).idle.is_some() {
            return AoOut { openness: None, bent_normal: None };
        }
        let (kernel, block, samples, range) = (self.trace, view.block, self.samples, self.range);
        let step = if self.upsample.is_some() { 2 } else { 1 };
        let traced = g.pass("ao.trace", Queue::AsyncCompute, |p| {
            let (block, scene) = (p.read(block), i.scene.trace(p));
            let gbuffer = i.gbuffer.read(p, RAY_START);
            let like = ImageDesc::like(OPENNESS, i.gbuffer.depth);
            let desc = if step == 1 { like } else { ImageDesc::half(OPENNESS) };
            let (openness, target) = p.create("openness", desc);
            let extent = p.extent_of(desc);
            (openness.read(), move |c: &mut Record<'_>| {
                let params = TraceParams {
                    view: c.id(block),
                    scene: c.id(scene.root),
                    rays: c.rays(),
                    gbuffer: gbuffer.images(c),
                    openness: c.id(target),
                    step,
                    samples,
                    range,
                };
                c.trace(kernel, scene.tlas, &params, extent);
            })
        });
        let noisy = match &self.upsample {
            Some(upsample) => {
                let value = ("openness", OPENNESS);
                let gbuffer = i.gbuffer;
                let i = UpsampleIn { half_size: traced, gbuffer, value, direction: None, background: 1.0 };
                upsample.add(g, view, i, "").value
            }
            None => traced,
        };
        let i = DenoiseIn {
            signal: Signal { image: noisy, content: Content::Occlusion },
            surfaces: Surfaces { gbuffer: i.gbuffer, reprojected: i.reprojected },
            hints: Hints::default(),
        };
        AoOut { openness: Some(self.denoiser.add(g, view, i, "")), bent_normal: None }
    }
}
