//! `ris` and `restir`: one light sample for each pixel.
//!
//! `candidates` draws it. With reuse `visibility` drops hidden ones, `temporal` merges those of the previous frame, `spatial_1` and so on those of
//! pixels around, each from one buffer into another; the last buffer is the history. `sampled` shades, a denoiser filters, `shade` adds emission
//! and the directional lights. Bitterli et al. 2020, "Spatiotemporal reservoir resampling for real-time ray tracing with dynamic direct lighting".
mod passes;
mod settings;

use super::light_change::LightChange;
use super::lobes::Lobes;
use super::shade::{Lights, Shade};
use crate::contracts::{DirectIn, DirectOut};
use crate::parts::denoise::Hints;
use magpie::prelude::*;
use magpie::scene::{LightKind, SceneFacts};
use magpie::slot::{Build, Needs, Settings, SlotError};
use magpie_shaders::resampling::SOURCE_TREE;
use passes::Passes;
use settings::Options;
pub use settings::settings;

/// One light sample for each pixel.
pub struct Sampled {
    passes: Passes,
    change: LightChange,
    lobes: Lobes,
    shade: Shade,
    options: Options,
}

impl Sampled {
    /// Creates the pipelines. `reuse`: samples are reused.
    pub fn new(build: &Build<'_>, settings: &Settings, reuse: bool) -> Result<Self, SlotError> {
        let options = Options::read(settings, reuse)?;
        Ok(Self {
            passes: Passes::new(build, options)?,
            change: LightChange::new(build, settings)?,
            lobes: Lobes::new(build, settings, true)?,
            shade: Shade::new(build, settings)?,
            options,
        })
    }

    /// Whether there is anything to draw from.
    fn draws(&self, facts: &SceneFacts) -> bool {
        let is_drawn = |kind: LightKind| self.options.directional || kind != LightKind::Directional;
        facts.emits() || facts.lights.iter().any(|light| is_drawn(light.kind))
    }
}

impl Effect for Sampled {
    type In = DirectIn;
    type Out = DirectOut;

    fn needs(&self, facts: &SceneFacts) -> Needs {
        let draws = self.draws(facts);
        let light_tree = draws && self.options.source == SOURCE_TREE;
        Needs { light_tables: draws, light_tree, samples_lamps: true, ..Needs::default() }
    }

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: DirectIn) -> DirectOut {
        let lights = i.scene.lights.filter(|_| self.draws(&view.facts));
        let sampled = lights.map(|lights| {
            let noisy = self.passes.add(g, view, i, lights, &self.lobes);
            // A mirror's candidate along the lobe meets the same lamp in every frame.
            let hints = Hints::default().alike(self.options.alike()).sharp(self.options.widest_alpha > 0.0);
            let hints = hints.change(self.change.add(g, view, i));
            self.lobes.denoise(g, view, i, noisy, hints)
        });
        let any = view.facts.lights.iter().any(|light| light.kind == LightKind::Directional);
        let lights = if any && !self.options.directional { Lights::Directional } else { Lights::None };
        self.shade.add(g, view, i, sampled, lights)
    }
}
