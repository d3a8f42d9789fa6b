//! `clustered`: as `all-lights`, with lamps by cells of the view.
use super::clusters::{self, Clustering};
use super::emitters::{self, Emitters};
use super::shade::{self, Lights, Shade};
use crate::contracts::{DirectIn, DirectOut};
use crate::precision;
use magpie::prelude::*;
use magpie::scene::{LightKind, SceneFacts};
use magpie::slot::{Build, Needs, SettingSpec, Settings, SlotError};
use magpie_shaders::clusters::CELL_LAMPS;
use magpie_shaders::view::MAX_SHADOW_LIGHTS;

/// All settings.
pub fn settings() -> Vec<SettingSpec> {
    let mut settings = clusters::settings().to_vec();
    settings.push(SettingSpec { sweep: Vec::new(), ..shade::area() });
    settings.extend(emitters::settings(0.0).into_iter().map(|spec| SettingSpec { sweep: Vec::new(), ..spec }));
    settings.push(precision::setting());
    settings
}

/// Lamps by clusters.
pub struct Clustered {
    clustering: Clustering,
    shade: Shade,
    /// `None` if no rays are traced to emissive surfaces.
    emitters: Option<Emitters>,
}

impl Clustered {
    /// Creates the pipelines.
    pub fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        Ok(Self {
            clustering: Clustering::new(build, settings)?,
            shade: Shade::new(build, settings)?,
            emitters: Emitters::new(build, settings, true)?,
        })
    }

    /// Whether there are more lamps than are near everywhere, and cells can list what counts everywhere besides: directional lights, and those
    /// with a shadow.
    fn applies(&self, facts: &SceneFacts) -> bool {
        let directional = facts.lights.iter().filter(|light| light.kind == LightKind::Directional).count();
        let everywhere = directional + MAX_SHADOW_LIGHTS as usize;
        facts.lamps() > self.clustering.near() as usize && everywhere < (CELL_LAMPS / 2) as usize
    }
}

impl Effect for Clustered {
    type In = DirectIn;
    type Out = DirectOut;

    fn needs(&self, facts: &SceneFacts) -> Needs {
        let needs = self.emitters.as_ref().map_or_else(Needs::default, |_| Emitters::needs(facts));
        let by_tree = self.applies(facts) && self.clustering.looks_up(facts);
        Needs { light_tables: needs.light_tables || by_tree, light_tree: by_tree, ..needs }
    }

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: DirectIn) -> DirectOut {
        let emitters = self.emitters.as_ref().and_then(|emitters| emitters.add(g, view, i));
        let lights =
            if self.applies(&view.facts) { Lights::Clustered(self.clustering.add(g, view, i)) } else { Lights::All };
        self.shade.add(g, view, i, emitters, lights)
    }
}
