//! From linear radiance to display values: anti-aliasing and upsampling, sharpening, exposure, tone curve, sRGB encoding.
mod filters;
mod taa;

use crate::contracts::{PostIn, PostOut};
use filters::{Sharpen, Upscale};
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::scene::SceneFacts;
use magpie::slot::{Build, Needs, Preset, SettingSpec, Settings, Slot, SlotError};
use magpie_shaders::POST_TONE_MAP_COMP;
use magpie_shaders::post::{CURVE_ACES, CURVE_AGX, CURVE_NONE, ToneMapParams};
use taa::Taa;

/// From cheap to accurate. They differ in the resolution of the whole frame; TAA upsamples it to the output.
pub const PRESETS: [Preset; 4] = [
    Preset {
        name: "low",
        implementation: "standard",
        settings: &[("resolution_scale", "0.5"), ("anti_aliasing", "taa")],
    },
    Preset {
        name: "medium",
        implementation: "standard",
        settings: &[("resolution_scale", "0.67"), ("anti_aliasing", "taa")],
    },
    Preset {
        name: "high",
        implementation: "standard",
        settings: &[("resolution_scale", "0.8"), ("anti_aliasing", "taa")],
    },
    Preset {
        name: "ultra",
        implementation: "standard",
        settings: &[("resolution_scale", "1"), ("anti_aliasing", "taa")],
    },
];

pub fn slot() -> Slot<PostIn, PostOut> {
    let settings = [
        SettingSpec::choice(
            "tone_map",
            "Curve from radiance to display values. `agx`: desaturates bright colours. `aces`: more contrast. `none`: clips.",
            "agx",
            &["agx", "aces", "none"],
        ),
        SettingSpec::float("exposure", "stops", "Higher is brighter: each stop doubles the light.", 0.0, -24.0..=24.0),
        SettingSpec::choice(
            "anti_aliasing",
            "`taa`: temporal anti-aliasing, which averages jittered frames; edges are smooth from the second frame on. `none`: one sample \
             at the centre of each pixel.",
            "none",
            &["none", "taa"],
        )
        .sweep_all(),
        SettingSpec::float(
            "resolution_scale",
            "",
            "Rendered pixels per pixel of the picture, in each direction. Lower: time falls with the square, and fine detail blurs; with \
             `taa` it returns where the picture stands still.",
            1.0,
            0.5..=1.0,
        )
        .sweep([1.0, 0.8, 0.67, 0.5]),
        SettingSpec::float(
            "sharpening",
            "",
            "Strength of sharpening, as a fraction of the greatest that does not overshoot. Higher: crisper edges, more visible noise. 0: \
             no pass.",
            0.0,
            0.0..=1.0,
        ),
        SettingSpec::among(
            "bits",
            "bits",
            "Bits of each colour of display values. `16`: for windows with more than 8, where shallow gradients show no steps.",
            8,
            &[8, 16],
        ),
    ];
    Slot::new("post")
        .about("Linear radiance to display values.")
        .with("standard", "Anti-aliasing, sharpening, exposure, tone curve, sRGB.", &settings, |build, settings| {
            Ok(Box::new(Standard::new(build, settings)?))
        })
        .presets(&PRESETS)
}

struct Standard {
    /// Rendered pixels over pixels of the picture, in each direction.
    scale: f64,
    taa: Option<Taa>,
    upscale: Upscale,
    sharpen: Option<Sharpen>,
    tone_map: Kernel,
    /// `CURVE_*`.
    curve: u32,
    /// Factor before the tone curve.
    exposure: f32,
    /// Format of display values.
    display: Format,
}

impl Standard {
    fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        let curve = match settings.choice("tone_map")? {
            "aces" => CURVE_ACES,
            "none" => CURVE_NONE,
            _ => CURVE_AGX,
        };
        let exposure = settings.f32("exposure")?.exp2();
        let taa = settings.choice("anti_aliasing")? == "taa";
        let sharpening = settings.f32("sharpening")?;
        Ok(Self {
            scale: settings.f64("resolution_scale")?,
            taa: taa.then(|| Taa::new(build, exposure)).transpose()?,
            upscale: Upscale::new(build)?,
            sharpen: (sharpening > 0.0).then(|| Sharpen::new(build, sharpening, exposure)).transpose()?,
            tone_map: build.kernel(&POST_TONE_MAP_COMP)?,
            curve,
            exposure,
            display: if settings.i64("bits")? == 16 { Format::Rgba16Unorm } else { Format::Rgba8Unorm },
        })
    }

    fn tone_map(&self, g: &mut FrameGraph, radiance: Handle<Image>) -> Handle<Image> {
        let (kernel, curve, exposure, format) = (self.tone_map, self.curve, self.exposure, self.display);
        g.pass("post.tone_map", Queue::Graphics, |p| {
            let colour = p.sample(radiance);
            let (display, target) = p.create("display", ImageDesc::like(format, radiance));
            let extent = p.extent(radiance);
            (display.read(), move |c: &mut Record<'_>| {
                let params = ToneMapParams {
                    not_finite: c.not_finite(),
                    colour: c.id(colour),
                    display: c.id(target),
                    size: [extent.width, extent.height],
                    exposure,
                    curve,
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }
}

impl Effect for Standard {
    type In = PostIn;
    type Out = PostOut;

    fn needs(&self, _: &SceneFacts) -> Needs {
        Needs { jitter: self.taa.is_some(), resolution_scale: self.scale, ..Needs::default() }
    }

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: PostIn) -> PostOut {
        let mut radiance = match (&self.taa, i.seen) {
            (Some(taa), Some(seen)) => taa.add(g, view, i.colour, seen),
            _ if g.extent(i.colour) != view.output => self.upscale.add(g, i.colour, view.output),
            _ => i.colour,
        };
        if let Some(sharpen) = &self.sharpen {
            radiance = sharpen.add(g, radiance);
        }
        PostOut { radiance, display: self.tone_map(g, radiance) }
    }
}
