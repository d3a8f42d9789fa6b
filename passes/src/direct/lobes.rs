//! Noisy light that surfaces reflect once, denoised: that of specular lobes apart from diffuse light where a surface is smooth, as a mirror shows
//! lamps, of which the surface tells a denoiser nothing.
use crate::contracts::DirectIn;
use crate::parts::denoise::{self, Content, DenoiseIn, Denoiser, Hints, Method, Options, Signal, Surfaces};
use crate::precision;
use crate::specular_signal::{SpecularSignal, SpecularTargets};
use magpie::graph::{PassBuilder, StorageToken};
use magpie::prelude::*;
use magpie::scene::SceneFacts;
use magpie::slot::{Build, SettingSpec, Settings, SlotError};
use magpie_shaders::direct::{LobeImages, NO_LOBE};

const SPLIT: &str = "split";
/// What `split` is best set to where lamps are sampled: at 0.02 and 0.15 light apart has far less error, in a scene whose smoothest surfaces have 0.25
/// more.
pub const SMOOTH: f64 = 0.2;
const SPECULAR: &str = "specular_denoiser";

/// The denoisers.
pub struct Lobes {
    /// Of all light, or of diffuse light.
    denoiser: Denoiser,
    specular: Denoiser,
    /// Light is split where a surface is smoother than this, perceptual roughness. 0: nowhere.
    limit: f32,
    format: Format,
}

/// Light over the albedo.
#[derive(Clone, Copy)]
pub struct Reflected {
    /// Of all lobes, over the albedo of all; with `specular` without what is apart.
    pub radiance: Handle<Image>,
    /// Of the specular lobes of smooth surfaces, over their albedo.
    pub specular: Option<Handle<Image>>,
    /// Roughness below which that is apart.
    pub limit: f32,
}

/// What a pass finds.
pub struct Noisy {
    radiance: Handle<Image>,
    specular: Option<SpecularSignal>,
    limit: f32,
}

/// Where it writes that.
#[derive(Clone, Copy)]
pub struct Targets {
    radiance: StorageToken,
    specular: Option<SpecularTargets>,
    format: Format,
    limit: f32,
}

/// Settings. `split`: the default of the limit.
pub fn settings(split: f64) -> Vec<SettingSpec> {
    let about = "Roughness: specular light of surfaces that are smoother has a denoiser of its own, which follows what mirrors show and blurs it no \
                 wider than the lobe; from three quarters of it on a part, falling to none. Higher: more surfaces have one, with its time and memory. 0: none \
                 has, and lamps in mirrors blur.";
    let specular = "The same of specular light, where it has a denoiser of its own. `pica-pica` and `recurrent-blur` find the history where the mirrored \
                    lamp was. Not asked for where `denoiser` is `none`.";
    let mut settings = denoise::settings();
    settings.push(SettingSpec::float(SPLIT, "", about, split, 0.0..=1.0).sweep([0.0, SMOOTH]));
    settings.push(SettingSpec::choice(SPECULAR, specular, "recurrent-blur", &Method::NAMES).sweep_all());
    settings
}

impl Lobes {
    /// Creates the pipelines. `splits`: light may be split at all.
    pub fn new(build: &Build<'_>, settings: &Settings, splits: bool) -> Result<Self, SlotError> {
        let options = Options::read(settings)?;
        let method = Method::named(settings.choice(SPECULAR)?);
        Ok(Self {
            denoiser: Denoiser::new(build, "direct", options)?,
            specular: Denoiser::new(build, "direct", Options { method, ..options })?,
            limit: if splits && options.method != Method::None { settings.f32(SPLIT)? } else { 0.0 },
            format: precision::format(settings)?,
        })
    }

    /// Declares that the pass writes noisy light of the size of the frame.
    pub fn create(&self, p: &mut PassBuilder<'_>, facts: &SceneFacts, i: DirectIn) -> (Noisy, Targets) {
        let (like, format) = (i.gbuffer.depth, self.format);
        let (radiance, target) = p.create("radiance", ImageDesc::like(format, like));
        let limit = self.limit;
        let is_split = limit > 0.0 && facts.has_smooth(limit);
        let (specular, specular_targets) =
            is_split.then(|| SpecularSignal::create(p, "specular", format, like)).unzip();
        let targets = Targets { radiance: target, specular: specular_targets, format, limit };
        (Noisy { radiance: radiance.read(), specular, limit }, targets)
    }

    /// Adds the passes. `hints`: what more is known of the noise, of [`Hints::sharp`] that of specular light.
    pub fn denoise(&self, g: &mut FrameGraph, view: &View, i: DirectIn, noisy: Noisy, hints: Hints) -> Reflected {
        let all = DenoiseIn {
            signal: Signal { image: noisy.radiance, content: Content::Radiance },
            surfaces: Surfaces { gbuffer: i.gbuffer, reprojected: i.reprojected },
            hints,
        };
        let radiance = self.denoiser.add(g, view, all, "");
        let specular = noisy.specular.map(|specular| {
            let noisy = specular.noisy(i.gbuffer, i.reprojected);
            let hints = noisy.hints.alike(hints.alike).sharp(hints.sharp).change(hints.change);
            self.specular.add(g, view, DenoiseIn { hints, ..noisy }, "_specular")
        });
        Reflected { radiance, specular, limit: noisy.limit }
    }
}

impl Targets {
    /// For the shader.
    pub fn images(self, c: &Record<'_>) -> LobeImages {
        let mut images = LobeImages {
            radiance: c.id(self.radiance),
            specular: NO_LOBE,
            greatest: self.format.greatest(),
            ..LobeImages::default()
        };
        if let Some(specular) = self.specular {
            images.specular = c.id(specular.radiance).index();
            images.hit_distance = c.id(specular.hit_distance);
            images.width = c.id(specular.width);
            images.limit = self.limit;
        }
        images
    }
}
