//! Diffuse indirect light frame by frame: the implementations to compare, and their images.
use crate::against::relmse;
use crate::harness::config;
use anyhow::{Context, Result, ensure};
use glam::{DVec3, Vec3};
use magpie::gpu::Gpu;
use magpie::scene::{Camera, Scene};
use magpie_passes::reference::Estimate;
use magpie_passes::{FrameRequest, FrameResult, RenderOptions, Renderer, Slots};

/// An implementation of the slot `gi` with settings.
#[derive(Clone, Copy, Debug)]
pub struct Way {
    /// Name in tables.
    pub label: &'static str,
    /// Name of the implementation.
    pub implementation: &'static str,
    changes: &'static [&'static str],
}

/// What leaves the expected value of rays as that of a path tracer.
pub const UNBIASED: [&str; 9] = [
    "gi.denoiser=none",
    "gi.reuse=false",
    "gi.regularization=0",
    "gi.precision=32",
    "gbuffer.precision=full",
    "stages.shadows=off",
    "stages.reflections=off",
    "stages.ao=off",
    "direct.emitter_rays=0",
];

/// What pictures of the slot alone do not need. Ambient occlusion and the light that rays take from the last frame stay.
const AROUND: [&str; 4] =
    ["gi.precision=32", "gbuffer.precision=full", "stages.reflections=off", "post.anti_aliasing=none"];
/// What stays out where neither ambient occlusion nor the last frame's light counts.
const ALONE: [&str; 3] = ["stages.shadows=off", "stages.ao=off", "direct.emitter_rays=0"];

/// Surfels as they are by default.
pub const SURFELS: Way = Way { label: "surfels", implementation: "surfels", changes: &[] };
/// One ray of each pixel, denoised.
pub const DENOISED: Way =
    Way { label: "ray-traced, svgf", implementation: "ray-traced", changes: &["gi.denoiser=svgf", "gi.rays=1"] };
/// One ray of each pixel.
pub const ONE_RAY: Way =
    Way { label: "ray-traced, raw", implementation: "ray-traced", changes: &["gi.denoiser=none", "gi.rays=1"] };

/// The same with surfels at the hits.
pub const CACHED: Way = Way {
    label: "ray-traced, svgf, surfels at hits",
    implementation: "ray-traced",
    changes: &["gi.denoiser=svgf", "gi.rays=1", "gi.cache=surfels"],
};

/// One resampled path of each pixel, denoised.
pub const RESTIR: Way = Way { label: "restir, svgf", implementation: "restir", changes: &["gi.denoiser=svgf"] };
/// One resampled path of each pixel.
pub const RESTIR_RAW: Way = Way { label: "restir, raw", implementation: "restir", changes: &["gi.denoiser=none"] };

/// What there is to compare; what the slot does not have is left out.
pub fn ways() -> Vec<Way> {
    let simple = |implementation| Way { label: implementation, implementation, changes: &[] };
    let all = [SURFELS, DENOISED, CACHED, ONE_RAY, RESTIR, RESTIR_RAW, simple("sky"), simple("screen-space")];
    let infos = Slots::default().infos();
    let has = |name: &str| {
        infos.iter().filter(|slot| slot.name == "gi").any(|slot| slot.implementations.iter().any(|i| i.name == name))
    };
    all.into_iter().filter(|way| has(way.implementation)).collect()
}

/// A renderer of which the image of `gi` is read.
pub struct Frames {
    /// The renderer.
    pub renderer: Renderer,
    /// The camera of the next frame.
    pub camera: Camera,
    /// Time of the next frame, seconds.
    pub time: f64,
    way: Way,
    pixels: usize,
}

/// Counters of a frame, in the order of `SurfelShowParams::counters`.
#[derive(Clone, Copy, Debug)]
pub struct Counters {
    /// Surfels.
    pub live: f32,
    /// Share of pixels that no surfel covers.
    pub uncovered: f32,
    /// Rays of surfels.
    pub rays: f32,
}

impl Frames {
    /// Frames of a scene, with settings beside those of the way. They have every check on if the device does.
    ///
    /// # Errors
    /// Any error of the renderer.
    pub fn new(gpu: &Gpu, scene: &Scene, way: Way, changes: &[&str], size: [u32; 2]) -> Result<Self> {
        Self::seeded(gpu, scene, way, changes, size, RenderOptions::default().seed)
    }

    /// The same with a seed of its own.
    ///
    /// # Errors
    /// Any error of the renderer.
    pub fn seeded(
        gpu: &Gpu,
        scene: &Scene,
        way: Way,
        changes: &[&str],
        [width, height]: [u32; 2],
        seed: u32,
    ) -> Result<Self> {
        let chosen = format!("stages.gi={}", way.implementation);
        let alone: &[&str] = if way.implementation == "surfels" { &ALONE } else { &[] };
        let changes = [&[chosen.as_str()], &AROUND[..], alone, way.changes, changes].concat();
        let options = RenderOptions { width, height, seed, check: gpu.validates(), ..RenderOptions::default() };
        let mut renderer = Renderer::new(gpu, scene, &Slots::default(), &config(&changes)?, options)?;
        renderer.read_slots(&["gi"])?;
        Ok(Self { renderer, camera: scene.cameras[0].clone(), time: 0.0, way, pixels: (width * height) as usize })
    }

    /// The next frame as it is, with one of its images.
    ///
    /// # Errors
    /// Any error of the renderer.
    pub fn frame(&mut self, view: Option<&str>) -> Result<FrameResult> {
        let view = view.and_then(|name| name.split_once(':'));
        let request = FrameRequest { camera: &self.camera, time: self.time, view, read_back: true };
        self.renderer.frame(request)?.context("no frame")
    }

    fn image(&mut self, view: Option<&str>) -> Result<(Vec<DVec3>, FrameResult)> {
        let result = self.frame(view)?;
        ensure!(result.findings.is_empty(), "{}: {}", self.way.label, result.findings[0]);
        // Without a sky `sky` gives nothing.
        let light = match self.way.implementation {
            "sky" if result.slots[0].1.is_none() => vec![DVec3::ZERO; self.pixels],
            _ => light_of(&result)?,
        };
        ensure!(light.iter().all(|v| v.is_finite()), "{}: light is not finite", self.way.label);
        Ok((light, result))
    }

    /// The light of the next frame.
    ///
    /// # Errors
    /// Any error of the renderer, and values that are not finite.
    pub fn light(&mut self) -> Result<Vec<DVec3>> {
        Ok(self.image(None)?.0)
    }

    /// The light after so many others.
    ///
    /// # Errors
    /// As of [`light`](Self::light).
    pub fn after(&mut self, others: u32) -> Result<Vec<DVec3>> {
        for _ in 0..others {
            let request = FrameRequest { camera: &self.camera, time: self.time, view: None, read_back: false };
            let result = self.renderer.frame(request)?.context("no frame")?;
            ensure!(result.findings.is_empty(), "{}: {}", self.way.label, result.findings[0]);
        }
        self.light()
    }

    /// The light of the next frame, and counters of surfels.
    ///
    /// # Errors
    /// As of [`light`](Self::light), and where there are no surfels.
    pub fn counted(&mut self) -> Result<(Vec<DVec3>, Counters)> {
        let (light, result) = self.image(Some("gi.show:counters"))?;
        let values = result.images.as_ref().context("no image")?.linear.values();
        ensure!(values.len() == 8 && values[6][0] > 0.0, "counters: {values:?}");
        Ok((light, Counters { live: values[0][0], uncovered: values[5][0] / values[6][0], rays: values[7][0] }))
    }
}

/// The image of the slot in a frame.
///
/// # Errors
/// Where the slot gave none.
pub fn light_of(result: &FrameResult) -> Result<Vec<DVec3>> {
    let image = &result.slots.first().context("no slot was read")?.1;
    let image = image.as_ref().context("no image of `gi`")?;
    Ok(image.values().iter().map(|v| Vec3::from_slice(v).as_dvec3()).collect())
}

/// Mean over pixels and channels.
pub fn mean(pixels: &[DVec3]) -> f64 {
    pixels.iter().map(|p| p.element_sum()).sum::<f64>() / (3 * pixels.len()) as f64
}

/// Mean over the truth's, and relMSE less what the truth's noise makes of it.
pub fn light_and_error(found: &[DVec3], truth: &Estimate) -> [f64; 2] {
    let [error, noise] = relmse(found, truth);
    [mean(found) / mean(&truth.mean), (error - noise).max(0.0)]
}
