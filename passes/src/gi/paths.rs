//! What implementations that follow paths from the pixels share: how the paths go on, and where they end.
use super::no_bounces;
use super::surfels::{self, Surfels};
use crate::contracts::{LightCache, LightingIn};
use crate::parts::hit_shading::{self, HitShading};
use magpie::prelude::*;
use magpie::scene::SceneFacts;
use magpie::slot::{Build, Needs, SettingSpec, Settings, SlotError};

/// How paths of pixels are followed.
pub struct Paths {
    /// Greatest number of surfaces that a path meets.
    pub bounces: u32,
    /// Of lib/regularization.glsl.
    pub regularization: f32,
    /// Hits take the light of the previous frame.
    reuse: bool,
    /// Surfels that know the light at the hits.
    surfels: Option<Surfels>,
}

/// Settings of the paths, and of the surfels that they may end at.
pub fn settings() -> Vec<SettingSpec> {
    let bounces = "Surfaces that a path may meet one after another. Higher: more light in rooms, more time.";
    let cache = "What knows the indirect light at hits. `none`: paths go on. `surfels`: those of the implementation of that name, which are kept beside; \
                 paths end at them, and have all bounces.";
    let reuse = "Hits that the previous frame shows take its light, with all its bounces, instead of sampling lights. Not with `cache`.";
    let mut settings = vec![
        SettingSpec::integer("bounces", "", bounces, 2, 1..=8).sweep([1, 2, 4]),
        hit_shading::regularization(),
        SettingSpec::switch("reuse", reuse, true).sweep_all(),
        SettingSpec::choice("cache", cache, "none", &["none", "surfels"]).sweep_all(),
    ];
    settings.extend(surfels::pool_settings().into_iter().map(|spec| SettingSpec { sweep: Vec::new(), ..spec }));
    settings
}

impl Paths {
    /// Reads the settings.
    pub fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        let cached = settings.choice("cache")? == "surfels";
        Ok(Self {
            bounces: settings.u32("bounces")?,
            regularization: settings.f32("regularization")?,
            // Surfels have all bounces, the picture those that it shows.
            reuse: settings.switch("reuse")? && !cached,
            surfels: cached.then(|| Surfels::new(build, settings, false)).transpose()?,
        })
    }

    /// Whether paths end at surfels, which have passes of their own.
    pub const fn end_at_surfels(&self) -> bool {
        self.surfels.is_some()
    }

    /// What they need of the frame.
    pub fn needs(&self, facts: &SceneFacts) -> Needs {
        no_bounces(facts)
            .map_or_else(|| Needs { previous_radiance: self.reuse, ..hit_shading::needs(facts) }, Needs::idle)
    }

    /// Brings surfels up to date, if paths end at some. Returns what shading at the hits reads, and the surfels; `None` where there is nothing to do.
    pub fn begin(&self, g: &mut FrameGraph, view: &View, i: LightingIn) -> Option<(HitShading, Option<LightCache>)> {
        let is_idle = self.needs(&view.facts).idle.is_some();
        let hits = HitShading::new(&i, self.reuse).filter(|_| !is_idle)?;
        let cache = self.surfels.as_ref().map(|surfels| surfels.update(g, view, i).cache());
        Some((hits.with_cache(cache), cache))
    }
}
