//! Diffuse indirect light found on the screen, after Therrien, Levesque and Gilet 2023, "Screen Space Indirect Lighting with Visibility
//! Bitmask": the light of what the depth image shows around each pixel, and that of the sky where nothing is in the way.
use super::resolve::{Finish, Noisy};
use super::{MATERIAL, no_bounces};
use crate::contracts::{Channel, GEOMETRY, LightingIn, LightingOut};
use crate::parts::denoise;
use crate::parts::upsample::{Upsample, UpsampleIn};
use crate::precision;
use magpie::gpu::Kernel;
use magpie::graph::HistoryScope;
use magpie::prelude::*;
use magpie::scene::SceneFacts;
use magpie::slot::{Build, Needs, SettingSpec, Settings, SlotError};
use magpie_shaders::denoise::NO_IMAGE;
use magpie_shaders::gi::{ScreenLightParams, ScreenSearchParams};
use magpie_shaders::{GI_SCREEN_LIGHT_COMP, GI_SCREEN_SEARCH_COMP};

/// What the light of a surface is taken from.
const SHINES: &[Channel] = &[Channel::Depth, Channel::Motion, Channel::Emission, Channel::Ids];

/// Diffuse indirect light found on the screen.
pub struct ScreenSpace {
    light: Kernel,
    search: Kernel,
    finish: Finish,
    /// Set at half resolution only.
    upsample: Option<Upsample>,
    /// Of the light of the previous frame.
    scope: HistoryScope,
    slices: u32,
    steps: u32,
    /// Metres.
    range: f32,
    /// Metres.
    thickness: f32,
    reuse: bool,
    /// The noise differs from frame to frame.
    moving_noise: bool,
    format: Format,
}

/// Settings of `screen-space`.
pub fn settings() -> Vec<SettingSpec> {
    let slices = "Slices, planes that contain the view direction, that are searched. Higher: less noise, with time proportional to the \
                  number.";
    let steps = "Samples on each side of a slice. Higher: small things are missed less often, with time proportional to the number.";
    let range = "Distance up to which surfaces give light and hide the sky. Lower: nearer samples, so finer detail, but what is farther \
                 counts as open sky.";
    let thickness = "Assumed thickness of what the camera sees. Higher: less light passes behind things, and thin ones hide too much.";
    let reuse =
        "Indirect light of the previous frame is passed on too, so that each frame adds a bounce. Off: one bounce.";
    let resolution = "`full`: every pixel. `half`: one pixel of four, upsampled along surfaces.";
    let noise = "`moving`: different noise in every frame, for denoisers with a history and temporal anti-aliasing to average. `still`: the \
                 same noise in every frame.";
    let mut settings = vec![
        SettingSpec::integer("slices", "", slices, 2, 1..=16).sweep([1, 2, 4]),
        SettingSpec::integer("steps", "", steps, 8, 1..=64).sweep([4, 8, 16]),
        SettingSpec::float("range", "m", range, 1000.0, 0.001..=1e6),
        SettingSpec::float("thickness", "m", thickness, 0.1, 0.0..=1000.0),
        SettingSpec::switch("reuse", reuse, true).sweep_all(),
        SettingSpec::choice("resolution", resolution, "full", &["full", "half"]).sweep_all(),
        SettingSpec::choice("noise", noise, "moving", &["still", "moving"]),
    ];
    settings.extend(denoise::settings());
    settings.push(precision::setting());
    settings
}

impl ScreenSpace {
    /// Creates the pipelines.
    pub fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        let format = precision::format(settings)?;
        let half = settings.choice("resolution")? == "half";
        Ok(Self {
            light: build.kernel(&GI_SCREEN_LIGHT_COMP)?,
            search: build.kernel(&GI_SCREEN_SEARCH_COMP)?,
            finish: Finish::new(build, settings)?,
            upsample: half.then(|| Upsample::new(build, "gi")).transpose()?,
            scope: HistoryScope::new(),
            slices: settings.u32("slices")?,
            steps: settings.u32("steps")?,
            range: settings.f32("range")?,
            thickness: settings.f32("thickness")?,
            reuse: settings.switch("reuse")?,
            moving_noise: settings.choice("noise")? == "moving",
            format,
        })
    }

    /// Adds the pass that collects the light that surfaces give to others. `previous`: indirect light of the previous frame.
    fn light(&self, g: &mut FrameGraph, view: &View, i: LightingIn, previous: Option<Handle<Image>>) -> Handle<Image> {
        let (kernel, block, format) = (self.light, view.block, self.format);
        g.pass("gi.light", Queue::AsyncCompute, |p| {
            let (block, scene) = (p.read(block), i.scene.read(p));
            let gbuffer = i.gbuffer.read(p, SHINES);
            let (direct, taps) = (p.sample(i.direct), p.sample(i.reprojected.taps));
            let previous = previous.map(|image| p.sample(image));
            let (light, target) = p.create("light", ImageDesc::like(format, i.gbuffer.depth));
            let extent = p.extent(i.gbuffer.depth);
            (light.read(), move |c: &mut Record<'_>| {
                let params = ScreenLightParams {
                    view: c.id(block),
                    scene: c.id(scene),
                    not_finite: c.not_finite(),
                    gbuffer: gbuffer.images(c),
                    direct: c.id(direct),
                    taps: c.id(taps),
                    previous: previous.map_or(NO_IMAGE, |token| c.id(token).index()),
                    light: c.id(target),
                    has_emission: i.gbuffer.emission.is_some().into(),
                    greatest: format.greatest(),
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }

    /// Adds the search, which gives noisy irradiance over pi.
    fn search(&self, g: &mut FrameGraph, view: &View, i: LightingIn, light: Handle<Image>) -> Handle<Image> {
        let (kernel, block) = (self.search, view.block);
        let Self { slices, steps, range, thickness, format, .. } = *self;
        let frame = if self.moving_noise { view.frame } else { 0 };
        let (desc, step) = match &self.upsample {
            Some(_) => (ImageDesc::half(format), 2),
            None => (ImageDesc::like(format, i.gbuffer.depth), 1),
        };
        g.pass("gi.search", Queue::AsyncCompute, |p| {
            let (block, light) = (p.read(block), p.sample(light));
            let gbuffer = i.gbuffer.read(p, &[GEOMETRY, MATERIAL].concat());
            let (found, target) = p.create("found", desc);
            let extent = p.extent_of(desc);
            (found.read(), move |c: &mut Record<'_>| {
                let params = ScreenSearchParams {
                    view: c.id(block),
                    not_finite: c.not_finite(),
                    gbuffer: gbuffer.images(c),
                    light: c.id(light),
                    found: c.id(target),
                    step,
                    slices,
                    steps,
                    frame,
                    range,
                    thickness,
                    greatest: format.greatest(),
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }
}

impl Effect for ScreenSpace {
    type In = LightingIn;
    type Out = LightingOut;

    fn needs(&self, facts: &SceneFacts) -> Needs {
        no_bounces(facts).map_or_else(Needs::default, Needs::idle)
    }

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: LightingIn) -> LightingOut {
        if self.needs(&view.facts).idle.is_some() {
            return LightingOut::default();
        }
        let desc = ImageDesc::like(self.format, i.gbuffer.depth);
        let history = self.reuse.then(|| g.history(&self.scope, "radiance", desc));
        let (previous, next) = history.map(|history| (history.previous, history.next)).unzip();
        let light = self.light(g, view, i, previous);
        let mut found = self.search(g, view, i, light);
        if let Some(upsample) = &self.upsample {
            let value = ("found", self.format);
            let half = UpsampleIn { half_size: found, gbuffer: i.gbuffer, value, direction: None, background: 0.0 };
            found = upsample.add(g, view, half, "").value;
        }
        LightingOut::radiance(self.finish.add(g, view, i, Noisy { image: found, change: None }, next))
    }
}
