//! The list of configurations to measure: every implementation of every slot, and every step of its settings.
use crate::AccuracyError;
use crate::hash::short;
use magpie::config::{Catalogue, Config, Suggestion, Value};
use magpie::slot::{ImplementationInfo, SettingSpec, SlotInfo};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Slots that do not affect the picture, and why.
const NOT_PICTURED: [(&str, &str); 1] = [("rays", "it is there for looking at, and no part of the picture")];

/// Settings whose implementations use history: rows of a slot that has one are also judged while the camera moves.
const OF_HISTORIES: [&str; 2] = ["denoiser", "anti_aliasing"];

/// Settings without effect while nothing moves.
const OF_MOTION: [(&str, &str); 1] = [("acceleration", "top_level")];

/// Limit on the number of setting combinations per implementation. Settings are combined in their order up to this limit; the rest are
/// varied one at a time.
const MAX_COMBINATIONS: usize = 12;

/// One row of the report: a slot with an implementation and settings, everything else at its default.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Variant {
    /// The slot.
    pub slot: String,
    /// Name of the implementation.
    pub implementation: String,
    /// Its settings that are swept, and their values.
    pub settings: BTreeMap<String, Value>,
    /// A short name: presets, implementation, and settings that differ from the default.
    pub label: String,
    /// Whether this is the default of its slot.
    pub is_default: bool,
    /// Names of the presets that are equal to it.
    #[serde(default)]
    pub presets: Vec<String>,
    /// Id of the [`Setup`] that is rendered for it.
    pub setup: String,
}

/// A complete configuration to render. The default one is shared by all slots.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setup {
    /// Unique, and stable for the same configuration.
    pub id: String,
    /// Name in tables.
    pub label: String,
    /// Every slot and setting.
    pub config: Config,
    /// Slots that have a variant with this setup.
    pub slots: Vec<String>,
    /// Whether the scene moves while it is measured.
    pub moving: bool,
    /// Whether the camera moves after the frames at rest, for slots with a history.
    #[serde(default)]
    pub turns: bool,
}

impl Setup {
    /// Whether the slot acts on the finished sum of the terms, so that its picture is not split into terms.
    pub fn is_whole(&self) -> bool {
        self.slots == ["post"]
    }
}

/// All configurations to measure, in a fixed order.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// Rows by slot in the order of the frame, the default of each slot first.
    pub variants: Vec<Variant>,
    /// Setups that are rendered for them, the default first.
    pub setups: Vec<Setup>,
    /// Slots that are not measured, each with the reason.
    pub left_out: Vec<(String, String)>,
}

impl Plan {
    /// Plans a sweep around `base`. `stages` names the slots to measure, empty for all. `moves` says whether the scene moves.
    ///
    /// # Errors
    /// [`AccuracyError::UnknownStage`], [`AccuracyError::NotMeasured`].
    pub fn new(catalogue: &Catalogue, base: &Config, stages: &[String], moves: bool) -> Result<Self, AccuracyError> {
        let base = catalogue.complete(base);
        let known: Vec<String> = catalogue.slots.iter().map(|s| s.name.clone()).collect();
        for name in stages {
            if !known.contains(name) {
                let suggestion = Suggestion::find(name, known.iter().map(String::as_str));
                return Err(AccuracyError::UnknownStage { name: name.clone(), known, suggestion });
            }
        }
        let mut plan = Self::default();
        for slot in &catalogue.slots {
            let wanted = stages.is_empty() || stages.contains(&slot.name);
            match why_not(slot, moves) {
                Some(why) if !stages.is_empty() && wanted => {
                    return Err(AccuracyError::NotMeasured { name: slot.name.clone(), why });
                }
                Some(why) => plan.left_out.push((slot.name.clone(), why)),
                None if wanted => plan.add_slot(catalogue, slot, &base, moves),
                None => plan.left_out.push((slot.name.clone(), "not asked for".to_owned())),
            }
        }
        Ok(plan)
    }

    fn add_slot(&mut self, catalogue: &Catalogue, slot: &SlotInfo, base: &Config, moves: bool) {
        let mut rows = Vec::new();
        for implementation in &slot.implementations {
            for settings in steps(slot, implementation, base, moves) {
                let config = with(catalogue, base, base, slot, implementation, &settings);
                let label = label(slot, implementation, &settings, base);
                rows.push(Row { implementation, settings, preset: None, config, label });
            }
        }
        // The default first, then in the order of registration.
        rows.sort_by_key(|row| row.config != *base);
        rows.extend(slot.presets.iter().filter_map(|preset| {
            // A preset is defined by its name, independently of the base.
            let (around, (implementation, settings)) = (Config::default(), slot.choice(preset.name)?);
            let config = with(catalogue, base, &around, slot, implementation, &settings);
            let label = label(slot, implementation, &settings, &around);
            Some(Row { implementation, settings, preset: Some(preset.name.to_owned()), config, label })
        }));
        let moving = moves && slot.implementations.iter().flat_map(|i| &i.settings).any(|s| is_of_motion(slot, s));
        let has_history = |i: &ImplementationInfo| i.settings.iter().any(|s| OF_HISTORIES.contains(&s.key));
        let turns = !moving && slot.implementations.iter().any(has_history);
        for Row { implementation, settings, preset, config, label } in rows {
            let is_default = config == *base;
            let setup = self.setup(slot, config, base, &label, moving, turns);
            let known = self.variants.iter().position(|v| v.slot == slot.name && v.setup == setup);
            let at = known.unwrap_or_else(|| {
                let (slot, implementation, presets) = (slot.name.clone(), implementation.name.clone(), Vec::new());
                self.variants.push(Variant { slot, implementation, settings, label, is_default, presets, setup });
                self.variants.len() - 1
            });
            if let Some(name) = preset {
                let variant = &mut self.variants[at];
                variant.label = format!("{name}: {}", variant.label);
                variant.presets.push(name);
            }
        }
    }

    /// Adds a setup for a configuration, or finds an equal one.
    fn setup(
        &mut self,
        slot: &SlotInfo,
        config: Config,
        base: &Config,
        label: &str,
        moving: bool,
        turns: bool,
    ) -> String {
        let text = format!("{config:?}");
        let id = short(&[&text, if moving { "moving" } else { "still" }]);
        match self.setups.iter_mut().find(|s| s.id == id) {
            Some(known) => {
                if !known.slots.contains(&slot.name) {
                    known.slots.push(slot.name.clone());
                }
                known.turns |= turns;
            }
            None => {
                let label = if config == *base { "default".to_owned() } else { format!("{}: {label}", slot.name) };
                let slots = vec![slot.name.clone()];
                self.setups.push(Setup { id: id.clone(), label, config, slots, moving, turns });
            }
        }
        id
    }

    /// The setup with that id.
    pub fn find(&self, id: &str) -> Option<&Setup> {
        self.setups.iter().find(|s| s.id == id)
    }

    /// The slots that have rows, in the order of the frame.
    pub fn slots(&self) -> Vec<String> {
        let mut slots: Vec<String> = self.variants.iter().map(|v| v.slot.clone()).collect();
        slots.dedup();
        slots
    }

    /// The setups by how informative they are: the default, presets, implementations with default settings, all others.
    pub fn best_first(&self) -> Vec<&Setup> {
        let rank = |setup: &Setup| {
            let variants = self.variants.iter().filter(|v| v.setup == setup.id);
            let of = |v: &Variant| match v {
                v if v.is_default => 0,
                v if !v.presets.is_empty() => 1,
                v if v.label == v.implementation => 2,
                _ => 3,
            };
            variants.map(of).min().unwrap_or(3)
        };
        let mut setups: Vec<&Setup> = self.setups.iter().collect();
        setups.sort_by_key(|s| rank(s));
        setups
    }

    /// The default setup, with the scene at rest.
    pub fn default_setup(&self) -> Option<&Setup> {
        self.setups.iter().find(|s| s.label == "default" && !s.moving)
    }
}

/// A variant before its setup is known.
struct Row<'a> {
    implementation: &'a ImplementationInfo,
    settings: BTreeMap<String, Value>,
    preset: Option<String>,
    config: Config,
    label: String,
}

/// `base` with another implementation in a slot and these settings; the slot's other settings are as in `around`.
fn with(
    catalogue: &Catalogue,
    base: &Config,
    around: &Config,
    slot: &SlotInfo,
    implementation: &ImplementationInfo,
    settings: &BTreeMap<String, Value>,
) -> Config {
    let mut config = base.clone();
    config.stages.insert(slot.name.clone(), implementation.name.clone());
    if around.stages.get(&slot.name) != Some(&implementation.name) {
        // Settings of the previous implementation are dropped, except those that both share and that are not swept, such as the range of
        // ambient occlusion.
        let is_asked = |key: &String, value: &Value| {
            let spec = implementation.settings.iter().find(|s| s.key == *key);
            spec.is_some_and(|s| s.sweep.is_empty() && s.accept(value).is_ok())
        };
        let mut kept = config.settings.remove(&slot.name).unwrap_or_default();
        kept.retain(|key, value| is_asked(key, value));
        if !kept.is_empty() {
            config.settings.insert(slot.name.clone(), kept);
        }
    }
    if !settings.is_empty() {
        config.settings.entry(slot.name.clone()).or_default().extend(settings.clone());
    }
    catalogue.complete(&config)
}

fn is_of_motion(slot: &SlotInfo, spec: &SettingSpec) -> bool {
    OF_MOTION.iter().any(|(of, key)| *of == slot.name && *key == spec.key)
}

/// The reason why a slot has no rows, if it has none.
fn why_not(slot: &SlotInfo, moves: bool) -> Option<String> {
    if let Some((_, why)) = NOT_PICTURED.iter().find(|(name, _)| *name == slot.name) {
        return Some((*why).to_owned());
    }
    let choices: usize = slot.implementations.iter().map(|i| swept(slot, i, moves).count().max(1)).sum();
    let has_steps = slot.implementations.iter().any(|i| swept(slot, i, moves).next().is_some());
    (choices < 2 && !has_steps).then(|| "there is one way to do it only, without steps".to_owned())
}

/// The settings of an implementation that are swept: they trade accuracy for time.
fn swept<'a>(
    slot: &'a SlotInfo,
    implementation: &'a ImplementationInfo,
    moves: bool,
) -> impl Iterator<Item = &'a SettingSpec> {
    implementation.settings.iter().filter(move |s| s.sweep.len() > 1 && (moves || !is_of_motion(slot, s)))
}

/// The base's value of a setting, or the default if the base runs another implementation.
fn of_base(base: &Config, slot: &SlotInfo, implementation: &ImplementationInfo, key: &str) -> Option<Value> {
    let is_chosen = base.stages.get(&slot.name) == Some(&implementation.name);
    let set = base.settings.get(&slot.name).and_then(|values| values.get(key)).filter(|_| is_chosen);
    let default = || implementation.settings.iter().find(|s| s.key == key).map(|s| s.default.clone());
    set.cloned().or_else(default)
}

/// The swept settings of every row of an implementation: the base, each step of one setting, and combinations up to [`MAX_COMBINATIONS`].
fn steps(
    slot: &SlotInfo,
    implementation: &ImplementationInfo,
    base: &Config,
    moves: bool,
) -> Vec<BTreeMap<String, Value>> {
    let specs: Vec<&SettingSpec> = swept(slot, implementation, moves).collect();
    let around: BTreeMap<String, Value> =
        specs.iter().filter_map(|s| Some((s.key.to_owned(), of_base(base, slot, implementation, s.key)?))).collect();
    let mut rows = vec![around.clone()];
    for spec in &specs {
        for step in &spec.sweep {
            let mut row = around.clone();
            row.insert(spec.key.to_owned(), step.clone());
            rows.push(row);
        }
    }
    let mut all = vec![around];
    for spec in &specs {
        if all.len() * spec.sweep.len() > MAX_COMBINATIONS {
            break;
        }
        let with = |row: &BTreeMap<String, Value>, step: &Value| {
            let mut row = row.clone();
            row.insert(spec.key.to_owned(), step.clone());
            row
        };
        all = all.iter().flat_map(|row| spec.sweep.iter().map(move |step| with(row, step))).collect();
    }
    rows.extend(all);
    let mut unique: Vec<BTreeMap<String, Value>> = Vec::new();
    for row in rows {
        if !unique.contains(&row) {
            unique.push(row);
        }
    }
    unique
}

fn label(
    slot: &SlotInfo,
    implementation: &ImplementationInfo,
    settings: &BTreeMap<String, Value>,
    base: &Config,
) -> String {
    let mut label = implementation.name.clone();
    for (key, value) in settings {
        if of_base(base, slot, implementation, key).as_ref() != Some(value) {
            let value = match value {
                Value::Text(text) => text.clone(),
                other => other.to_string(),
            };
            label += &format!(", {key} {value}");
        }
    }
    label
}

#[cfg(test)]
mod tests {
    use super::*;
    use magpie::slot::Preset;
    use std::collections::BTreeSet;

    fn implementation(name: &str, settings: Vec<SettingSpec>) -> ImplementationInfo {
        ImplementationInfo { name: name.to_owned(), about: "About.".to_owned(), settings }
    }

    fn slot(name: &str, implementations: Vec<ImplementationInfo>) -> SlotInfo {
        let default = implementations[0].name.clone();
        SlotInfo { name: name.to_owned(), about: "About.".to_owned(), default, implementations, presets: Vec::new() }
    }

    fn catalogue() -> Catalogue {
        let resolution = SettingSpec::choice("resolution", "About.", "full", &["full", "half"]).sweep_all();
        let rays = SettingSpec::integer("rays", "", "About.", 1, 1..=16).sweep([1, 4]);
        let taste = SettingSpec::float("exposure", "", "About.", 0.0, -1.0..=1.0);
        let top = SettingSpec::choice("top_level", "About.", "rebuild", &["rebuild", "refit"]).sweep_all();
        Catalogue::new(vec![
            slot("acceleration", vec![implementation("two-level", vec![top])]),
            slot("shadows", vec![implementation("ray-traced", vec![resolution, rays]), implementation("off", vec![])]),
            slot("compose", vec![implementation("sum", vec![])]),
            slot("post", vec![implementation("standard", vec![taste])]),
        ])
    }

    #[test]
    fn every_step_and_few_combinations_are_rows() {
        let plan = Plan::new(&catalogue(), &Config::default(), &[], false).unwrap();
        let labels: Vec<&str> = plan.variants.iter().map(|v| v.label.as_str()).collect();
        let wanted = [
            "ray-traced",
            "ray-traced, resolution half",
            "ray-traced, rays 4",
            "ray-traced, rays 4, resolution half",
            "off",
        ];
        assert_eq!(labels, wanted);
        assert!(plan.variants[0].is_default && plan.variants[1..].iter().all(|v| !v.is_default));
        let ids: BTreeSet<&str> = plan.setups.iter().map(|s| s.id.as_str()).collect();
        assert_eq!(ids.len(), 5);
        assert_eq!(plan.default_setup().map(|s| s.id.as_str()), Some(plan.variants[0].setup.as_str()));
        let left: Vec<&str> = plan.left_out.iter().map(|(slot, _)| slot.as_str()).collect();
        assert_eq!(left, ["acceleration", "compose", "post"]);
        assert_eq!(plan, Plan::new(&catalogue(), &Config::default(), &[], false).unwrap());
    }

    #[test]
    fn presets_are_rows_and_named_where_a_row_is_one_already() {
        let preset = |name, settings| Preset { name, implementation: "ray-traced", settings };
        let mut with = catalogue();
        with.slots[1].presets = vec![preset("medium", &[]), preset("high", &[("rays", "8")])];
        let plan = Plan::new(&with, &Config::default(), &["shadows".to_owned()], false).unwrap();
        let of = |name: &str| plan.variants.iter().find(|v| v.presets == [name.to_owned()]).unwrap();
        assert!(of("medium").is_default && of("medium").label == "medium: ray-traced");
        assert_eq!(of("high").label, "high: ray-traced, rays 8");
        assert_eq!(plan.variants.len(), 5 + 1);
        // A preset is the same whatever is varied around it.
        let mut base = Config::default();
        base.set("shadows.resolution=half").unwrap();
        let plan = Plan::new(&with, &base, &["shadows".to_owned()], false).unwrap();
        let high = plan.variants.iter().find(|v| v.presets == ["high".to_owned()]).unwrap();
        assert_eq!(plan.find(&high.setup).unwrap().config.settings["shadows"]["resolution"], Value::from("full"));
    }

    #[test]
    fn what_is_asked_for_is_asked_of_every_implementation() {
        let range = || SettingSpec::float("range", "metres", "About.", 1.0, 0.0..=9.0);
        let rays = SettingSpec::integer("rays", "", "About.", 1, 1..=16).sweep([1, 4]);
        let ao = vec![implementation("screen", vec![range()]), implementation("rays", vec![rays, range()])];
        let mut base = Config::default();
        base.set("ao.range=0.25").unwrap();
        let plan = Plan::new(&Catalogue::new(vec![slot("ao", ao)]), &base, &[], false).unwrap();
        assert_eq!(plan.variants.len(), 3);
        for setup in &plan.setups {
            assert_eq!(setup.config.settings["ao"]["range"], Value::Float(0.25), "{}", setup.label);
        }
    }

    #[test]
    fn settings_of_motion_are_measured_where_something_moves() {
        let plan = Plan::new(&catalogue(), &Config::default(), &[], true).unwrap();
        assert_eq!(plan.variants[1].label, "two-level, top_level refit");
        assert!(plan.find(&plan.variants[1].setup).unwrap().moving);
        let defaults: Vec<&Variant> = plan.variants.iter().filter(|v| v.is_default).collect();
        assert_eq!(defaults.len(), 2);
        assert_ne!(defaults[0].setup, defaults[1].setup, "the scene stands still for the second");
        assert!(!plan.default_setup().unwrap().moving);
    }

    #[test]
    fn the_default_serves_every_slot_and_follows_the_base() {
        let mut base = Config::default();
        base.set("stages.shadows=off").unwrap();
        let mut both = catalogue();
        both.slots.push(slot("gi", vec![implementation("sky", vec![]), implementation("off", vec![])]));
        let plan = Plan::new(&both, &base, &[], false).unwrap();
        assert_eq!(plan.variants[0].label, "off");
        let default = plan.default_setup().unwrap();
        assert_eq!(default.slots, ["shadows", "gi"]);
        assert_eq!(plan.setups.len(), plan.variants.len() - 1);
        // Settings of one implementation are not carried over to another.
        assert!(!default.config.settings.contains_key("shadows"));
    }

    #[test]
    fn stages_that_cannot_be_measured_are_told_with_the_reason() {
        let wanted = |name: &str| {
            Plan::new(&catalogue(), &Config::default(), &[name.to_owned()], false).map_err(|e| e.to_string())
        };
        assert_eq!(wanted("shadows").unwrap().slots(), ["shadows"]);
        assert!(wanted("shadow").unwrap_err().contains("did you mean \"shadows\"?"));
        assert!(wanted("post").unwrap_err().contains("one way"));
        assert!(wanted("compose").unwrap_err().contains("one way"));
    }

    #[test]
    fn what_tells_most_comes_first_and_histories_are_seen_in_motion() {
        let denoiser = SettingSpec::choice("denoiser", "About.", "none", &["none", "svgf"]).sweep_all();
        let mut with = catalogue();
        with.slots[1].implementations[0].settings.push(denoiser);
        let preset = Preset { name: "high", implementation: "ray-traced", settings: &[("rays", "8")] };
        with.slots[1].presets = vec![preset];
        with.slots.push(slot("gi", vec![implementation("sky", vec![]), implementation("off", vec![])]));
        let plan = Plan::new(&with, &Config::default(), &[], false).unwrap();
        let order: Vec<&str> = plan.best_first().iter().map(|s| s.label.as_str()).collect();
        assert_eq!(order[..4], ["default", "shadows: ray-traced, rays 8", "shadows: off", "gi: off"]);
        assert_eq!(order.len(), plan.setups.len());
        for setup in &plan.setups {
            assert_eq!(setup.turns, setup.slots.contains(&"shadows".to_owned()), "{}", setup.label);
        }
    }

    #[test]
    fn the_first_settings_are_crossed_and_the_others_varied_one_at_a_time() {
        let setting = |key: &'static str| SettingSpec::integer(key, "", "About.", 0, 0..=9).sweep([0, 1, 2]);
        let many = implementation("many", ["a", "b", "c"].map(setting).to_vec());
        let plan = Plan::new(&Catalogue::new(vec![slot("gi", vec![many])]), &Config::default(), &[], false).unwrap();
        assert_eq!(plan.variants.len(), 3 * 3 + 2);
    }
}
