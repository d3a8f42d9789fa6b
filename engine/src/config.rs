//! Configuration: which implementation sits in each slot, and its settings.
//!
//! Layers are laid over each other, the later ones winning: built-in defaults, the scene's needs, a file, `--set`. Each
//! layer is checked against the [`Catalogue`] on its own, so that a message can name where the fault came from.

use std::{collections::BTreeMap, fmt};

use serde::{Deserialize, Serialize};

use crate::slot::{SettingFault, SettingSpec, SlotInfo};

/// Name of the table that says which implementation sits in each slot.
pub const STAGES: &str = "stages";

/// One value.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Value {
    /// A switch.
    Bool(bool),
    /// A whole number.
    Integer(i64),
    /// A number.
    Float(f64),
    /// A name or text.
    Text(String),
}

impl Value {
    /// Name of the type, for messages.
    #[must_use]
    pub const fn kind(&self) -> &'static str {
        match self {
            Self::Bool(_) => "switch (true or false)",
            Self::Integer(_) => "whole number",
            Self::Float(_) => "number",
            Self::Text(_) => "text",
        }
    }

    /// Reads what stands behind `KEY=`: `true`, `false`, a number, else a text, with or without double quotes.
    pub(crate) fn parse(text: &str) -> Self {
        if let Some(quoted) = text.strip_prefix('"').and_then(|t| t.strip_suffix('"')) {
            return Self::Text(quoted.to_owned());
        }
        match text {
            "true" => return Self::Bool(true),
            "false" => return Self::Bool(false),
            _ => {}
        }
        if let Ok(whole) = text.parse() {
            return Self::Integer(whole);
        }
        text.parse().map_or_else(|_| Self::Text(text.to_owned()), Self::Float)
    }
}

impl From<bool> for Value {
    fn from(on: bool) -> Self {
        Self::Bool(on)
    }
}

impl From<i64> for Value {
    fn from(whole: i64) -> Self {
        Self::Integer(whole)
    }
}

impl From<f64> for Value {
    fn from(number: f64) -> Self {
        Self::Float(number)
    }
}

impl From<&str> for Value {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bool(x) => write!(f, "{x}"),
            Self::Integer(x) => write!(f, "{x}"),
            Self::Float(x) => write!(f, "{x}"),
            Self::Text(x) => write!(f, "\"{x}\""),
        }
    }
}

/// A layer of configuration, or all layers together. In TOML and JSON the slots of `settings` are tables beside `stages`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Config {
    /// Implementation by slot.
    #[serde(default)]
    pub stages: BTreeMap<String, String>,
    /// Settings by slot, then by key.
    #[serde(flatten)]
    pub settings: BTreeMap<String, BTreeMap<String, Value>>,
}

impl Config {
    /// Reads TOML. `origin` is the file's name, for messages.
    ///
    /// # Errors
    /// [`ConfigError`] for bad TOML (with line and column; a repeated key is bad TOML), a value outside a table, and values
    /// that are not switches, finite numbers or texts.
    pub fn from_toml(text: &str, origin: &str) -> Result<Self, ConfigError> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let table: toml::Table = toml::from_str(text).map_err(|error| {
            let (line, column) = position(text, error.span().map_or(text.len(), |s| s.start));
            ConfigError::Toml { origin: origin.to_owned(), line, column, message: error.message().trim().to_owned() }
        })?;
        let mut config = Self::default();
        for (slot, value) in table {
            let toml::Value::Table(entries) = value else {
                return Err(ConfigError::OutsideTable { origin: origin.to_owned(), key: slot });
            };
            for (key, value) in entries {
                config.insert(&slot, key, &value, origin)?;
            }
        }
        Ok(config)
    }

    fn insert(&mut self, slot: &str, key: String, value: &toml::Value, origin: &str) -> Result<(), ConfigError> {
        let full = || format!("{slot}.{key}");
        let wrong = |wanted| ConfigError::WrongKind {
            origin: origin.to_owned(),
            key: full(),
            wanted,
            got: value.type_str().to_owned(),
        };
        if slot == STAGES {
            let toml::Value::String(name) = value else {
                return Err(wrong("the name of an implementation, in quotes"));
            };
            self.stages.insert(key, name.clone());
            return Ok(());
        }
        let value = match value {
            toml::Value::Boolean(x) => Value::Bool(*x),
            toml::Value::Integer(x) => Value::Integer(*x),
            toml::Value::Float(x) if x.is_finite() => Value::Float(*x),
            toml::Value::Float(x) => {
                return Err(ConfigError::NotFinite { origin: origin.to_owned(), key: full(), got: *x });
            }
            toml::Value::String(x) => Value::Text(x.clone()),
            _ => return Err(wrong("true, false, a number or a text")),
        };
        self.settings.entry(slot.to_owned()).or_default().insert(key, value);
        Ok(())
    }

    /// Sets one value from text such as `stages.shadows=off` or `shadows.cone_degrees=0.5`.
    ///
    /// # Errors
    /// [`ConfigError`] when it is not of the form `SLOT.KEY=VALUE`, or the number is not finite.
    pub fn set(&mut self, assignment: &str) -> Result<(), ConfigError> {
        let malformed = || ConfigError::Assignment { got: assignment.to_owned() };
        let (key, value) = assignment.split_once('=').ok_or_else(malformed)?;
        let (slot, key) = key.trim().split_once('.').ok_or_else(malformed)?;
        let value = value.trim();
        if slot.is_empty() || key.is_empty() || key.contains('.') || value.is_empty() {
            return Err(malformed());
        }
        let value = Value::parse(value);
        if slot == STAGES {
            let name = match value {
                Value::Text(name) => name,
                other => other.to_string(),
            };
            self.stages.insert(key.to_owned(), name);
            return Ok(());
        }
        if let Value::Float(got) = value
            && !got.is_finite()
        {
            let (origin, key) = (format!("--set {assignment}"), format!("{slot}.{key}"));
            return Err(ConfigError::NotFinite { origin, key, got });
        }
        self.settings.entry(slot.to_owned()).or_default().insert(key.to_owned(), value);
        Ok(())
    }

    /// Lays `over` on top: what it says wins, the rest stays.
    pub fn merge(&mut self, over: Self) {
        self.stages.extend(over.stages);
        for (slot, values) in over.settings {
            self.settings.entry(slot).or_default().extend(values);
        }
    }

    /// TOML that [`Config::from_toml`] reads back to the same configuration.
    ///
    /// # Errors
    /// [`ConfigError::Write`] when the serialiser refuses.
    pub fn to_toml(&self) -> Result<String, ConfigError> {
        toml::to_string(self).map_err(|e| ConfigError::Write { message: e.to_string() })
    }
}

/// Line and column, both from 1, of a byte offset.
fn position(text: &str, offset: usize) -> (usize, usize) {
    let before = text.get(..offset.min(text.len())).unwrap_or(text);
    let line_start = before.rfind('\n').map_or(0, |at| at + 1);
    (before.matches('\n').count() + 1, before[line_start..].chars().count() + 1)
}

/// Every slot with its implementations and settings: what configurations are checked against.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[serde(transparent)]
pub struct Catalogue {
    /// In the order of the frame.
    pub slots: Vec<SlotInfo>,
}

impl Catalogue {
    /// Makes a catalogue of these slots.
    #[must_use]
    pub fn new(slots: Vec<SlotInfo>) -> Self {
        Self { slots }
    }

    /// The slot of that name.
    #[must_use]
    pub fn slot(&self, name: &str) -> Option<&SlotInfo> {
        self.slots.iter().find(|s| s.name == name)
    }

    fn slot_or_error(&self, name: &str, key: &str, origin: &str) -> Result<&SlotInfo, ConfigError> {
        self.slot(name).ok_or_else(|| {
            let known: Vec<_> = self.slots.iter().map(|s| s.name.clone()).collect();
            let suggestion = Suggestion::find(name, known.iter().map(String::as_str));
            ConfigError::UnknownSlot {
                origin: origin.to_owned(),
                key: key.to_owned(),
                slot: name.to_owned(),
                known,
                suggestion,
            }
        })
    }

    /// Checks one layer, or all layers together. A setting of an implementation that is not chosen is fine, so that a file
    /// can hold the settings of several; it must suit one implementation of its slot, and the chosen one if that has it.
    ///
    /// # Errors
    /// [`ConfigError`] for the first fault; it begins with `origin`.
    pub fn check(&self, config: &Config, origin: &str) -> Result<(), ConfigError> {
        for (slot, name) in &config.stages {
            let key = format!("{STAGES}.{slot}");
            let info = self.slot_or_error(slot, &key, origin)?;
            if info.choice(name).is_none() {
                let known = info.names();
                let suggestion = Suggestion::find(name, known.iter().map(String::as_str));
                let (origin, name) = (origin.to_owned(), name.clone());
                return Err(ConfigError::UnknownImplementation { origin, key, name, known, suggestion });
            }
        }
        for (slot, values) in &config.settings {
            let info = self.slot_or_error(slot, slot, origin)?;
            let chosen = config.stages.get(slot);
            for (key, value) in values {
                check_setting(info, chosen.map(String::as_str), key, value, origin)?;
            }
        }
        Ok(())
    }

    /// `config` with everything that it leaves open filled in: the default implementation of each slot, and the settings of those that
    /// are chosen. Presets become the implementations and settings that they stand for.
    #[must_use]
    pub fn complete(&self, config: &Config) -> Config {
        let mut full = Config::default();
        for slot in &self.slots {
            let named = config.stages.get(&slot.name).unwrap_or(&slot.default);
            let Some((chosen, of_preset)) = slot.choice(named) else {
                full.stages.insert(slot.name.clone(), named.clone()); // unknown: it stays for whoever checks
                continue;
            };
            full.stages.insert(slot.name.clone(), chosen.name.clone());
            let defaults = chosen.settings.iter().map(|s| (s.key.to_owned(), s.default.clone()));
            let values: BTreeMap<_, _> = defaults.chain(of_preset).collect();
            if !values.is_empty() {
                full.settings.insert(slot.name.clone(), values);
            }
        }
        full.merge(Config { stages: BTreeMap::new(), settings: config.settings.clone() });
        full
    }
}

fn check_setting(
    slot: &SlotInfo,
    chosen: Option<&str>,
    key: &str,
    value: &Value,
    origin: &str,
) -> Result<(), ConfigError> {
    let full = format!("{}.{key}", slot.name);
    let find = |settings: &'_ [SettingSpec]| settings.iter().find(|s| s.key == key).cloned();
    let of_chosen = chosen.and_then(|name| slot.choice(name)).and_then(|(i, _)| find(&i.settings));
    let specs: Vec<_> = match of_chosen {
        Some(spec) => vec![spec],
        None => slot.implementations.iter().filter_map(|i| find(&i.settings)).collect(),
    };
    let mut fault = None;
    for spec in &specs {
        match spec.accept(value) {
            Ok(_) => return Ok(()),
            Err(found) => fault = fault.or(Some(found)),
        }
    }
    if let Some(fault) = fault {
        return Err(ConfigError::Setting { origin: origin.to_owned(), key: full, fault: Box::new(fault) });
    }
    let mut known: Vec<_> =
        slot.implementations.iter().flat_map(|i| i.settings.iter().map(|s| s.key.to_owned())).collect();
    known.sort();
    known.dedup();
    let suggestion = Suggestion::find(key, known.iter().map(String::as_str));
    Err(ConfigError::UnknownKey { origin: origin.to_owned(), key: full, known: Known(known), suggestion })
}

/// What is wrong with a configuration.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ConfigError {
    /// Not TOML, or a key stands twice.
    #[error("{origin}:{line}:{column}: {message}")]
    Toml {
        /// The file.
        origin: String,
        /// From 1.
        line: usize,
        /// From 1.
        column: usize,
        /// What the parser says.
        message: String,
    },
    /// A value at the top of the file.
    #[error("{origin}: {key}: stands outside a table; wanted [{STAGES}] or the table of a slot before it")]
    OutsideTable {
        /// The file.
        origin: String,
        /// The key.
        key: String,
    },
    /// A list, table or date where a plain value belongs.
    #[error("{origin}: {key}: wanted {wanted}, got a value of type {got}")]
    WrongKind {
        /// The file.
        origin: String,
        /// The key.
        key: String,
        /// What belongs there.
        wanted: &'static str,
        /// TOML's name of the type.
        got: String,
    },
    /// NaN or infinite.
    #[error("{origin}: {key}: wanted a finite number, got {got}")]
    NotFinite {
        /// File or argument.
        origin: String,
        /// The key.
        key: String,
        /// The value.
        got: f64,
    },
    /// Not of the form `SLOT.KEY=VALUE`.
    #[error("--set {got}: wanted SLOT.KEY=VALUE or {STAGES}.SLOT=NAME")]
    Assignment {
        /// What was given.
        got: String,
    },
    /// No such slot.
    #[error("{origin}: {key}: unknown stage \"{slot}\"{suggestion}; known: {}", known.join(", "))]
    UnknownSlot {
        /// File or argument.
        origin: String,
        /// The key.
        key: String,
        /// The slot that was named.
        slot: String,
        /// All slots.
        known: Vec<String>,
        /// The closest slot.
        suggestion: Suggestion,
    },
    /// No such implementation.
    #[error("{origin}: {key}: unknown implementation \"{name}\"{suggestion}; known: {}", known.join(", "))]
    UnknownImplementation {
        /// File or argument.
        origin: String,
        /// The key.
        key: String,
        /// What was named.
        name: String,
        /// All implementations of the slot.
        known: Vec<String>,
        /// The closest one.
        suggestion: Suggestion,
    },
    /// No such setting.
    #[error("{origin}: {key}: unknown setting{suggestion}; known: {known}")]
    UnknownKey {
        /// File or argument.
        origin: String,
        /// Slot and key.
        key: String,
        /// All settings of the slot.
        known: Known,
        /// The closest one.
        suggestion: Suggestion,
    },
    /// A value that does not suit its setting.
    #[error("{origin}: {key}: {fault}")]
    Setting {
        /// File or argument.
        origin: String,
        /// Slot and key.
        key: String,
        /// What is wrong.
        fault: Box<SettingFault>,
    },
    /// It could not be written as TOML.
    #[error("the configuration cannot be written as TOML: {message}")]
    Write {
        /// What the serialiser says.
        message: String,
    },
}

/// Names that would have been accepted; may be none.
#[derive(Clone, Debug, PartialEq)]
pub struct Known(pub Vec<String>);

impl fmt::Display for Known {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.is_empty() {
            f.write_str("none, this stage has no settings")
        } else {
            f.write_str(&self.0.join(", "))
        }
    }
}

/// The name that was probably meant, if one is close. Shows as ` (did you mean "x"?)` or as nothing.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Suggestion(pub Option<String>);

impl Suggestion {
    /// Finds the candidate with the fewest edits to `name`, at most one for every three letters of the longer one.
    pub fn find<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Self {
        let close = |candidate: &&str| {
            let longer = name.chars().count().max(candidate.chars().count());
            edits(name, candidate) <= longer.div_ceil(3).min(4)
        };
        let best = candidates.into_iter().filter(close).min_by_key(|candidate| edits(name, candidate));
        Self(best.map(str::to_owned))
    }
}

impl fmt::Display for Suggestion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.0 {
            Some(name) => write!(f, " (did you mean \"{name}\"?)"),
            None => Ok(()),
        }
    }
}

/// Levenshtein distance without regard to case: insertions, deletions and substitutions (Wagner and Fischer 1974).
fn edits(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.to_lowercase().chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.to_lowercase().chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let substituted = diagonal + usize::from(x != *y);
            diagonal = row[j + 1];
            row[j + 1] = substituted.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests;
