//! Presets: named choices of an implementation and its settings, from cheap to accurate.

use std::collections::BTreeMap;

use serde::Serialize;

use super::{ImplementationInfo, SettingSpec, SlotInfo};
use crate::config::Value;

/// How much accuracy for how much time. The later ones cost more and err less.
pub const QUALITIES: [&str; 4] = ["low", "medium", "high", "ultra"];

/// A choice with a name. It stands where the name of an implementation stands: `stages.shadows = "high"`. Settings that are given
/// beside it are laid over its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Preset {
    /// Name in the configuration: one of [`QUALITIES`].
    pub name: &'static str,
    /// What it fills the slot with.
    pub implementation: &'static str,
    /// Settings and their values, as they are written behind `--set`; the others are as by default.
    pub settings: &'static [(&'static str, &'static str)],
}

impl Preset {
    /// Its settings as values.
    pub fn values(&self) -> BTreeMap<String, Value> {
        self.settings.iter().map(|(key, text)| ((*key).to_owned(), Value::parse(text))).collect()
    }
}

impl SlotInfo {
    /// The preset of that name.
    #[must_use]
    pub fn preset(&self, name: &str) -> Option<&Preset> {
        self.presets.iter().find(|p| p.name == name)
    }

    /// What the name of an implementation or of a preset stands for: an implementation, and the settings that come with the name.
    #[must_use]
    pub fn choice(&self, name: &str) -> Option<(&ImplementationInfo, BTreeMap<String, Value>)> {
        let Some(preset) = self.preset(name) else { return Some((self.implementation(name)?, BTreeMap::new())) };
        let implementation = self.implementation(preset.implementation)?;
        let mut values = preset.values();
        for spec in &implementation.settings {
            // In the setting's own type: 1 becomes 1.0 where a number is wanted.
            if let Some(value) = values.get_mut(spec.key)
                && let Ok(accepted) = spec.accept(value)
            {
                *value = accepted;
            }
        }
        Some((implementation, values))
    }

    /// Mistakes in its presets, one sentence each.
    pub(super) fn mistakes_of_presets(&self) -> Vec<String> {
        let mut found = Vec::new();
        for preset in &self.presets {
            let key = format!("{}, preset {}", self.name, preset.name);
            if self.implementation(preset.name).is_some() {
                found.push(format!("{key}: an implementation has the same name"));
            }
            if !QUALITIES.contains(&preset.name) {
                found.push(format!("{key}: not one of {}", QUALITIES.join(", ")));
            }
            let Some(implementation) = self.implementation(preset.implementation) else {
                found.push(format!("{key}: the implementation \"{}\" is not registered", preset.implementation));
                continue;
            };
            for (name, value) in preset.values() {
                let spec = implementation.settings.iter().find(|s: &&SettingSpec| s.key == name);
                let fault = spec.map(|s| s.accept(&value).err().map(|fault| fault.to_string()));
                if let Some(fault) = fault.unwrap_or(Some("no such setting".to_owned())) {
                    found.push(format!("{key}: {name}: {fault}"));
                }
            }
        }
        found
    }
}
