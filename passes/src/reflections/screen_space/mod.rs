//! Reflections found on the screen: rays through the depth image, radiance of the previous frame where they hit, and the sky where they find
//! nothing.
mod cone;
mod settings;

use super::{ALL_ROUGH, idle_reason};
use crate::contracts::{Channel, GEOMETRY, LightingIn, LightingOut};
use crate::parts::denoise::{Content, DenoiseIn, Denoiser, Hints, Options, Precision, Signal, Surfaces};
use crate::parts::pyramid::{self, Pyramid};
use crate::precision;
use cone::{Cone, Frame};
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::scene::SceneFacts;
use magpie::slot::{Build, Needs, Settings, SlotError};
use magpie_shaders::denoise::NO_IMAGE;
use magpie_shaders::screen_march::{ScreenLight, ScreenMarch};
use magpie_shaders::screen_reflections::{BlendParams, MARCH_HALF, MARCH_MIRROR, MarchParams, SpreadParams};
use magpie_shaders::{REFLECTIONS_BLEND_COMP, REFLECTIONS_MARCH_COMP, REFLECTIONS_SPREAD_COMP, SampledImage};
pub use settings::settings;

/// Levels of the pyramid of depths: cells of 2 to 64 pixels.
const LEVELS: u32 = 6;
/// Format of hit distances.
const DISTANCE: Format = Format::R16Float;
/// Format of the width of the lobe.
const WIDTH: Format = Format::R8Unorm;
/// Format of the confidence that the slot gives.
const CONFIDENCE: Format = Format::R8Unorm;
/// What a ray starts from, and what it reads where it hits.
const MARCHED: &[Channel] = &[
    Channel::Depth,
    Channel::Normal,
    Channel::GeometricNormal,
    Channel::BaseColour,
    Channel::Material,
    Channel::Coat,
    Channel::Emission,
    Channel::Ids,
];
/// What light in a lobe is computed from.
const LOBE: &[Channel] =
    &[Channel::Normal, Channel::GeometricNormal, Channel::BaseColour, Channel::Material, Channel::Coat];

/// Reflections found on the screen.
pub struct ScreenSpace {
    march: Kernel,
    spread: Kernel,
    blend: Kernel,
    /// Without it steps have equal lengths.
    pyramid: Option<Pyramid>,
    lobe: Lobe,
    is_half: bool,
    steps: u32,
    /// As in [`MarchParams::strides`].
    strides: u32,
    thickness: f32,
    distance: f32,
    edge: f32,
    roughness_limit: f32,
    format: Format,
}

/// How one ray per pixel becomes the light of a lobe.
enum Lobe {
    /// Directions are sampled from the lobe, and what they find is denoised.
    Stochastic(Denoiser),
    /// Mirror directions, blurred.
    Cone(Cone),
}

/// What rays have found, of one size.
#[derive(Clone, Copy)]
struct Marched {
    /// Over the albedo of the lobe, times confidence.
    radiance: Handle<Image>,
    confidence: Handle<Image>,
    hit_distance: Handle<Image>,
    width: Handle<Image>,
}

impl ScreenSpace {
    /// Creates the pipelines.
    pub fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        let format = precision::format(settings)?;
        let is_whole = format == Format::Rgba32Float;
        let lobe = match settings.choice("lobe")? {
            "cone" => Lobe::Cone(Cone::new(build, settings, format)?),
            _ => {
                let precision = if is_whole { Precision::ThirtyTwo } else { Precision::Sixteen };
                let options = Options { precision, ..Options::read(settings)? };
                Lobe::Stochastic(Denoiser::new(build, "reflections", options)?)
            }
        };
        let is_linear = settings.choice("march")? == "linear";
        let least = settings.u32("stride")?;
        Ok(Self {
            march: build.kernel(&REFLECTIONS_MARCH_COMP)?,
            spread: build.kernel(&REFLECTIONS_SPREAD_COMP)?,
            blend: build.kernel(&REFLECTIONS_BLEND_COMP)?,
            pyramid: (!is_linear).then(|| Pyramid::new(build, "reflections", pyramid::Content::MinMax)).transpose()?,
            lobe,
            is_half: settings.choice("resolution")? == "half",
            steps: settings.u32("steps")?,
            strides: least | settings.u32("rough_stride")?.max(least) << 16,
            thickness: settings.f32("thickness")?,
            distance: settings.f32("distance")?,
            edge: settings.f32("edge")?,
            roughness_limit: settings.f32("roughness_limit")?,
            format,
        })
    }

    /// Whether any surface is smooth enough for rays.
    fn marches(&self, facts: &SceneFacts) -> bool {
        facts.has_smooth(self.roughness_limit)
    }

    /// Format of confidence between passes.
    fn confidence(&self) -> Format {
        if self.format == Format::Rgba32Float { Format::R32Float } else { Format::R16Unorm }
    }

    /// Formats of what rays find, by name.
    fn images(&self) -> [(&'static str, Format); 4] {
        let confidence = ("confidence", self.confidence());
        [("radiance", self.format), confidence, ("hit_distance", DISTANCE), ("width", WIDTH)]
    }

    /// Adds the rays.
    fn march(&self, g: &mut FrameGraph, view: &View, i: LightingIn, previous: Handle<Image>) -> Marched {
        let pyramid = self.pyramid.as_ref().map(|pyramid| pyramid.add(g, i.gbuffer.depth, LEVELS));
        let (kernel, block, is_half, images) = (self.march, view.block, self.is_half, self.images());
        let mirror = if matches!(self.lobe, Lobe::Cone(_)) { MARCH_MIRROR } else { 0 };
        let flags = mirror | if is_half { MARCH_HALF } else { 0 };
        let Self { steps, strides, thickness, distance, edge, roughness_limit, format, .. } = *self;
        g.pass("reflections.march", Queue::AsyncCompute, |p| {
            let (block, scene, pyramid) = (p.read(block), i.scene.read(p), pyramid.map(|image| p.sample(image)));
            let gbuffer = i.gbuffer.read(p, MARCHED);
            let (previous, guide) = (p.sample(previous), p.sample(i.reprojected.previous_guide));
            let like = |format| {
                if is_half { ImageDesc::half(format) } else { ImageDesc::like(format, i.gbuffer.depth) }
            };
            let made = images.map(|(name, format)| p.create(name, like(format)));
            let extent = p.extent_of(like(format));
            let [radiance, confidence, hit_distance, width] = made.each_ref().map(|(image, _)| image.read());
            let targets = made.map(|(_, target)| target);
            let marched = Marched { radiance, confidence, hit_distance, width };
            (marched, move |c: &mut Record<'_>| {
                let march = ScreenMarch {
                    pyramid: pyramid.map_or(SampledImage::NONE, |token| c.id(token)),
                    levels: LEVELS,
                    steps,
                    thickness,
                    distance,
                };
                let light = ScreenLight {
                    march,
                    previous_radiance: c.id(previous),
                    previous_guide: c.id(guide),
                    edge,
                    has_emission: i.gbuffer.emission.is_some().into(),
                };
                let [radiance, confidence, hit_distance, width] = targets.map(|target| c.id(target));
                let params = MarchParams {
                    view: c.id(block),
                    scene: c.id(scene),
                    not_finite: c.not_finite(),
                    gbuffer: gbuffer.images(c),
                    light,
                    radiance,
                    confidence,
                    hit_distance,
                    width,
                    strides,
                    roughness_limit,
                    flags,
                    greatest: format.greatest(),
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }

    /// Brings what rays of half resolution found to all pixels, along surfaces.
    fn spread(&self, g: &mut FrameGraph, view: &View, i: LightingIn, half: Marched) -> Marched {
        let (kernel, block, images) = (self.spread, view.block, self.images());
        let Self { format, roughness_limit, .. } = *self;
        g.pass("reflections.spread", Queue::AsyncCompute, |p| {
            let block = p.read(block);
            let gbuffer = i.gbuffer.read(p, &[GEOMETRY, &[Channel::Material]].concat());
            let Marched { radiance, confidence, hit_distance, width } = half;
            let sources = [radiance, confidence, hit_distance, width].map(|image| p.sample(image));
            let made = images.map(|(name, format)| p.create(name, ImageDesc::like(format, i.gbuffer.depth)));
            let extent = p.extent(i.gbuffer.depth);
            let [radiance, confidence, hit_distance, width] = made.each_ref().map(|(image, _)| image.read());
            let targets = made.map(|(_, target)| target);
            let marched = Marched { radiance, confidence, hit_distance, width };
            (marched, move |c: &mut Record<'_>| {
                let params = SpreadParams {
                    view: c.id(block),
                    gbuffer: gbuffer.images(c),
                    half_size: sources.map(|source| c.id(source)),
                    full_size: targets.map(|target| c.id(target)),
                    roughness_limit,
                    greatest: format.greatest(),
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }

    /// Adds the pass that puts what was found over the fallback, and multiplies with the albedo of the lobe.
    fn blend(&self, g: &mut FrameGraph, view: &View, i: LightingIn, found: Option<[Handle<Image>; 2]>) -> LightingOut {
        let (kernel, format, block) = (self.blend, self.format, view.block);
        g.pass("reflections.blend", Queue::AsyncCompute, |p| {
            let block = p.read(block);
            let gbuffer = i.gbuffer.read(p, LOBE);
            let found = found.map(|images| images.map(|image| p.sample(image)));
            let openness = i.ao.openness.map(|image| p.sample(image));
            let (radiance, target) = p.create("radiance", ImageDesc::like(format, i.gbuffer.depth));
            let confidence =
                found.is_some().then(|| p.create("confidence", ImageDesc::like(CONFIDENCE, i.gbuffer.depth)));
            let (confidence, confidence_target) = confidence.map(|(image, target)| (image.read(), target)).unzip();
            let extent = p.extent(i.gbuffer.depth);
            let mut out = LightingOut::radiance(radiance.read());
            out.confidence = confidence;
            (out, move |c: &mut Record<'_>| {
                let params = BlendParams {
                    view: c.id(block),
                    gbuffer: gbuffer.images(c),
                    found: found.map_or(NO_IMAGE, |[radiance, _]| c.id(radiance).index()),
                    found_confidence: found.map_or(SampledImage::NONE, |[_, confidence]| c.id(confidence)),
                    openness: openness.map_or(NO_IMAGE, |token| c.id(token).index()),
                    radiance: c.id(target),
                    confidence: confidence_target.map_or(NO_IMAGE, |token| c.id(token).index()),
                    greatest: format.greatest(),
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }

    /// From one ray of each pixel to the light of its lobe: radiance times confidence, and confidence.
    fn widen(&self, g: &mut FrameGraph, view: &View, i: LightingIn, marched: Marched) -> [Handle<Image>; 2] {
        let denoiser = match &self.lobe {
            Lobe::Stochastic(denoiser) => denoiser,
            Lobe::Cone(cone) => {
                let Marched { radiance, confidence, hit_distance, .. } = marched;
                return cone.add(g, Frame { view, i }, [radiance, confidence, hit_distance], self.confidence());
            }
        };
        let noisy = |image, content| DenoiseIn {
            signal: Signal { image, content },
            surfaces: Surfaces { gbuffer: i.gbuffer, reprojected: i.reprojected },
            hints: Hints::default().width(Some(marched.width)),
        };
        [
            denoiser.add(g, view, noisy(marched.radiance, Content::Radiance), ""),
            denoiser.add(g, view, noisy(marched.confidence, Content::Occlusion), "_confidence"),
        ]
    }
}

impl Effect for ScreenSpace {
    type In = LightingIn;
    type Out = LightingOut;

    fn needs(&self, facts: &SceneFacts) -> Needs {
        if let Some(reason) = idle_reason(facts) {
            return Needs::idle(reason);
        }
        let marches = self.marches(facts);
        if !marches && !facts.has_sky {
            return Needs::idle(ALL_ROUGH);
        }
        Needs { previous_radiance: marches, ..Needs::default() }
    }

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: LightingIn) -> LightingOut {
        if self.needs(&view.facts).idle.is_some() {
            return LightingOut::default();
        }
        let Some(previous) = i.previous_radiance.filter(|_| self.marches(&view.facts)) else {
            return self.blend(g, view, i, None);
        };
        let mut marched = self.march(g, view, i, previous);
        if self.is_half {
            marched = self.spread(g, view, i, marched);
        }
        let found = self.widen(g, view, i, marched);
        self.blend(g, view, i, Some(found)).with_hit_distance(marched.hit_distance)
    }
}
