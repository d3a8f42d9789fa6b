//! `auto`: `all-lights` where lamps are few, `light-tree` where they are many.
use super::all_lights::AllLights;
use super::light_tree::TreeLights;
use super::{emitters, light_tree, lobes, shade};
use crate::contracts::{DirectIn, DirectOut};
use crate::parts::denoise;
use crate::precision;
use magpie::prelude::*;
use magpie::scene::SceneFacts;
use magpie::slot::{Build, Needs, Part, SettingSpec, Settings, SlotError};

/// What fits the scene.
pub struct Auto {
    few: AllLights,
    many: TreeLights,
    /// Local lights from which on they are many.
    from: usize,
}

/// Settings: those of both, and where the one ends.
pub fn settings() -> Vec<SettingSpec> {
    let many = "Lamps from which on they are chosen by the light tree, each with its shadow, instead of evaluated one by one, with shadows of the strongest \
                eight. Higher: less noise and more time where there are some lamps.";
    let mut settings = vec![SettingSpec::integer("many", "lamps", many, 9, 1..=1_000_000), shade::area()];
    settings.extend(emitters::settings(lobes::SMOOTH));
    // Where lamps are few these change nothing; `light-tree` sweeps them.
    settings.extend(light_tree::own_settings().into_iter().map(|spec| SettingSpec { sweep: Vec::new(), ..spec }));
    settings.push(SettingSpec { sweep: Vec::new(), ..denoise::adaptive_to_lamps() });
    settings.push(precision::setting());
    settings
}

impl Auto {
    /// Creates the pipelines of both; what is not used is never compiled.
    pub fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        Ok(Self {
            // Glossy surfaces show emissive meshes with less noise through one denoiser.
            few: AllLights::new(build, settings, false)?,
            many: TreeLights::new(build, settings)?,
            from: settings.u32("many")? as usize,
        })
    }
}

impl Effect for Auto {
    type In = DirectIn;
    type Out = DirectOut;

    fn needs(&self, facts: &SceneFacts) -> Needs {
        let (lamps, from) = (facts.lamps(), self.from);
        if lamps < from {
            let why = format!("fewer than {from} lamps, each evaluated at every pixel");
            return self.few.needs(facts).part(Part { name: "tree", idle: Some(why.into()), without: None });
        }
        let why = format!("{lamps} lamps, among which and emissive surfaces the light tree chooses");
        self.many.needs(facts).part(Part { name: "emitters", idle: Some(why.into()), without: None })
    }

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: DirectIn) -> DirectOut {
        if view.facts.lamps() < self.from { self.few.add(g, view, i) } else { self.many.add(g, view, i) }
    }
}
