//! Diffuse indirect light by resampled paths: one of each pixel and frame, whose first point is reused in the frames after and by the pixels
//! around. Ouyang et al. 2021, "ReSTIR GI: Path Resampling for Real-Time Path Tracing".
//!
//! `sample` traces, `temporal` merges with what the pixel had, `validate` first traces what is old again, `spatial_1` and so on merge with
//! pixels around, `shade` makes noisy light of what is left, which is denoised.
mod passes;
mod settings;

use super::paths::Paths;
use super::resolve::{Finish, Noisy};
use crate::contracts::{LightingIn, LightingOut};
use crate::parts::upsample::{Upsample, UpsampleIn};
use crate::precision;
use magpie::prelude::*;
use magpie::scene::SceneFacts;
use magpie::slot::{Build, Needs, Settings, SlotError};
use passes::Passes;
use settings::Options;
pub use settings::settings;

/// Diffuse indirect light by resampled paths.
pub struct Restir {
    paths: Paths,
    passes: Passes,
    /// Set at half resolution only.
    upsample: Option<Upsample>,
    finish: Finish,
    format: Format,
}

impl Restir {
    /// Creates the pipelines.
    pub fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        let (options, format) = (Options::read(settings)?, precision::format(settings)?);
        Ok(Self {
            paths: Paths::new(build, settings)?,
            passes: Passes::new(build, options, format)?,
            upsample: options.half.then(|| Upsample::new(build, "gi")).transpose()?,
            finish: Finish::new(build, settings)?,
            format,
        })
    }
}

impl Effect for Restir {
    type In = LightingIn;
    type Out = LightingOut;

    fn needs(&self, facts: &SceneFacts) -> Needs {
        self.paths.needs(facts)
    }

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: LightingIn) -> LightingOut {
        let Some((hits, cache)) = self.paths.begin(g, view, i) else { return LightingOut::default() };
        let mut noisy = self.passes.add(g, view, i, hits, self.paths.regularization);
        if let Some(upsample) = &self.upsample {
            let value = ("radiance", self.format);
            let half = UpsampleIn { half_size: noisy, gbuffer: i.gbuffer, value, direction: None, background: 0.0 };
            noisy = upsample.add(g, view, half, "").value;
        }
        LightingOut {
            cache,
            ..LightingOut::radiance(self.finish.add(g, view, i, Noisy { image: noisy, change: None }, None))
        }
    }
}
