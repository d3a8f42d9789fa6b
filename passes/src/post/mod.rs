//! From linear radiance to a display: exposure, tone curve, sRGB.
use crate::stages::{PostIn, PostOut};
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::stage::{SettingSpec, Settings, Stage, StageError};
use magpie_shaders::POST_TONE_MAP_COMP;
use magpie_shaders::post::{CURVE_ACES, CURVE_AGX, CURVE_NONE, ToneMapParams};

/// The slot.
pub fn stage() -> Stage<PostIn, PostOut> {
    let settings = [
        SettingSpec::choice(
            "tone_map",
            "Curve from radiance to display: agx keeps bright colours from turning garish, aces has more contrast, none clips.",
            "agx",
            &["agx", "aces", "none"],
        ),
        SettingSpec::float("exposure", "stops", "Higher is brighter: each stop doubles the light.", 0.0, (-24.0, 24.0)),
    ];
    Stage::new("post").about("From linear radiance to a display.").with(
        "standard",
        "Exposure, tone curve, sRGB.",
        &settings,
        |build, settings| Ok(Box::new(Standard::new(build.gpu, settings)?)),
    )
}

struct Standard {
    tone_map: Kernel,
    curve: u32,
    exposure: f32,
}

impl Standard {
    fn new(gpu: &Gpu, settings: &Settings) -> Result<Self, StageError> {
        let curve = match settings.choice("tone_map")? {
            "aces" => CURVE_ACES,
            "none" => CURVE_NONE,
            _ => CURVE_AGX,
        };
        let tone_map = gpu.kernel(&POST_TONE_MAP_COMP).map_err(StageError::other)?;
        Ok(Self { tone_map, curve, exposure: settings.f32("exposure")?.exp2() })
    }
}

impl Effect for Standard {
    type In = PostIn;
    type Out = PostOut;

    fn add(&mut self, g: &mut FrameGraph, _: &View, i: PostIn) -> PostOut {
        let (kernel, curve, exposure) = (self.tone_map, self.curve, self.exposure);
        let display = g.pass("post.tone_map", Queue::Graphics, |p| {
            let colour = p.sample(i.colour);
            let (display, target) = p.create("display", ImageDesc::like(Format::Rgba8Unorm, i.colour));
            let extent = p.extent(i.colour);
            (display.read(), move |c: &mut Record<'_>| {
                let params = ToneMapParams {
                    colour: c.id(colour),
                    display: c.id(target),
                    size: [extent.width, extent.height],
                    exposure,
                    curve,
                };
                c.dispatch(kernel, &params, extent);
            })
        });
        PostOut { display }
    }
}
