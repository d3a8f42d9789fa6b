//! Slots of the frame, each filled by one named implementation.
//!
//! A slot is a [`Slot`] with the types that go in and come out. Implementations register by name, the engine's and a
//! user's alike, so that no central list has to be edited:
//!
//! ```text
//! stages.shadows.register("mine", "My own shadows.", &[], |build, settings| Ok(Box::new(Mine::new(build, settings)?)));
//! ```
//!
//! [`Slot::wrap`] registers one that adds to another.

mod build;
mod implementation;
mod needs;
mod preset;
mod setting;
mod wrap;

pub use build::Build;
pub use implementation::{Change, Implementation};
pub use needs::{Geometry, Needs, Part, SlotNeeds};
pub use preset::{Preset, QUALITIES};
pub use setting::{Range, SettingFault, SettingSpec};

use std::{collections::BTreeMap, error::Error, fmt, sync::Arc};

use serde::Serialize;

use crate::{
    config::{Suggestion, Value},
    frame::View,
    graph::FrameGraph,
    scene::SceneFacts,
};

/// One effect: adds its passes to the frame that is being declared.
pub trait Effect {
    /// What it reads: handles and plain values.
    type In;
    /// What it makes: handles and plain values.
    type Out;

    /// What it asks of the frame that shows such a scene, or why it has nothing to do in it.
    ///
    /// Asked before every frame, before anything of it is declared, so it has to be quick. Where it says that it is idle,
    /// [`add`](Effect::add) must add no pass: that is checked. Both see the same facts, [`View::facts`].
    fn needs(&self, facts: &SceneFacts) -> Needs {
        let _ = facts;
        Needs::default()
    }

    /// Adds its passes.
    fn add(&mut self, g: &mut FrameGraph, view: &View, input: Self::In) -> Self::Out;
}

/// An effect of any type with these inputs and outputs.
pub type BoxedEffect<In, Out> = Box<dyn Effect<In = In, Out = Out>>;

/// One implementation of a slot, as `magpie stages` shows it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ImplementationInfo {
    /// Name in the configuration.
    pub name: String,
    /// One line.
    pub about: String,
    /// Its settings.
    pub settings: Vec<SettingSpec>,
}

/// One slot, as `magpie stages` shows it and as configurations are checked against it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SlotInfo {
    /// Name in the configuration.
    pub name: String,
    /// One line.
    pub about: String,
    /// Name of the implementation that runs when nothing else is said.
    pub default: String,
    /// What can be chosen, in order of registration.
    pub implementations: Vec<ImplementationInfo>,
    /// Named choices among these, from cheap to accurate.
    pub presets: Vec<Preset>,
}

impl SlotInfo {
    /// The implementation of that name.
    #[must_use]
    pub fn implementation(&self, name: &str) -> Option<&ImplementationInfo> {
        self.implementations.iter().find(|i| i.name == name)
    }

    /// Every name that can be chosen: implementations, then presets.
    #[must_use]
    pub fn names(&self) -> Vec<String> {
        let presets = self.presets.iter().map(|p| p.name.to_owned());
        self.implementations.iter().map(|i| i.name.clone()).chain(presets).collect()
    }

    /// Mistakes in the description itself, one sentence each: a missing default implementation, a repeated key, a default
    /// value or a step of a sweep that its own range refuses, a setting without a description, a preset that names what is not there.
    /// For tests of those who register effects.
    #[must_use]
    pub fn mistakes(&self) -> Vec<String> {
        let slot = &self.name;
        let mut found = Vec::new();
        if self.implementation(&self.default).is_none() {
            found.push(format!("{slot}: the default implementation \"{}\" is not registered", self.default));
        }
        for implementation in &self.implementations {
            let mut seen = Vec::new();
            for spec in &implementation.settings {
                let key = format!("{slot}.{} of {}", spec.key, implementation.name);
                if seen.contains(&spec.key) {
                    found.push(format!("{key}: described twice"));
                }
                seen.push(spec.key);
                if let Err(fault) = spec.accept(&spec.default) {
                    found.push(format!("{key}: its default does not suit it: {fault}"));
                }
                found.extend(spec.mistakes_of_sweep().into_iter().map(|mistake| format!("{key}: {mistake}")));
                if spec.about.is_empty() {
                    found.push(format!("{key}: no description"));
                }
            }
        }
        found.extend(self.mistakes_of_presets());
        found
    }
}

/// The settings of one effect: every key that its implementation describes has a value of the described type.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    slot: String,
    values: BTreeMap<String, Value>,
}

impl Settings {
    /// The defaults of `implementation` with `given` laid over them. Keys that it does not have are left out: they belong
    /// to another implementation of the slot ([`Catalogue`](crate::config::Catalogue) refuses those that belong to none).
    ///
    /// # Errors
    /// [`SlotError::Setting`] for a value that does not suit its setting.
    pub fn new(
        slot: &str,
        implementation: &ImplementationInfo,
        given: &BTreeMap<String, Value>,
    ) -> Result<Self, SlotError> {
        let mut values = BTreeMap::new();
        for spec in &implementation.settings {
            let value = spec.accept(given.get(spec.key).unwrap_or(&spec.default)).map_err(|fault| {
                SlotError::Setting { slot: slot.to_owned(), key: spec.key.to_owned(), fault: Box::new(fault) }
            })?;
            values.insert(spec.key.to_owned(), value);
        }
        Ok(Self { slot: slot.to_owned(), values })
    }

    fn read<T>(&self, key: &str, wanted: &'static str, read: impl Fn(&Value) -> Option<T>) -> Result<T, SlotError> {
        let got = self.values.get(key);
        got.and_then(read).ok_or_else(|| SlotError::NotDescribed {
            slot: self.slot.clone(),
            key: key.to_owned(),
            wanted,
            described: got.map_or("not described", Value::kind),
        })
    }

    /// A number.
    ///
    /// # Errors
    /// [`SlotError::NotDescribed`] when the implementation does not describe `key` as a number.
    pub fn f64(&self, key: &str) -> Result<f64, SlotError> {
        self.read(key, "number", |v| match v {
            Value::Float(x) => Some(*x),
            _ => None,
        })
    }

    /// A number, rounded to single precision.
    ///
    /// # Errors
    /// As [`Settings::f64`].
    pub fn f32(&self, key: &str) -> Result<f32, SlotError> {
        self.f64(key).map(|x| x as f32)
    }

    /// A whole number.
    ///
    /// # Errors
    /// [`SlotError::NotDescribed`] when the implementation does not describe `key` as a whole number.
    pub fn i64(&self, key: &str) -> Result<i64, SlotError> {
        self.read(key, "whole number", |v| match v {
            Value::Integer(x) => Some(*x),
            _ => None,
        })
    }

    /// A whole number from 0 to 2^32 - 1; the described range must lie inside that.
    ///
    /// # Errors
    /// As [`Settings::i64`].
    pub fn u32(&self, key: &str) -> Result<u32, SlotError> {
        self.read(key, "whole number of 32 bits", |v| match v {
            Value::Integer(x) => u32::try_from(*x).ok(),
            _ => None,
        })
    }

    /// A switch.
    ///
    /// # Errors
    /// [`SlotError::NotDescribed`] when the implementation does not describe `key` as a switch.
    pub fn switch(&self, key: &str) -> Result<bool, SlotError> {
        self.read(key, "switch", |v| match v {
            Value::Bool(on) => Some(*on),
            _ => None,
        })
    }

    /// A name or text.
    ///
    /// # Errors
    /// [`SlotError::NotDescribed`] when the implementation does not describe `key` as a text.
    pub fn choice(&self, key: &str) -> Result<&str, SlotError> {
        match self.values.get(key) {
            Some(Value::Text(text)) => Ok(text),
            _ => self.read(key, "text", |_| None),
        }
    }

    /// All values by key.
    #[must_use]
    pub fn values(&self) -> &BTreeMap<String, Value> {
        &self.values
    }
}

/// Why a slot could not be filled.
#[derive(Debug, thiserror::Error)]
pub enum SlotError {
    /// No implementation of that name.
    #[error("stages.{slot}: unknown implementation \"{name}\"{suggestion}; known: {}", known.join(", "))]
    UnknownImplementation {
        /// The slot.
        slot: String,
        /// What was asked for.
        name: String,
        /// What there is.
        known: Vec<String>,
        /// The closest known name.
        suggestion: Suggestion,
    },
    /// A value that does not suit its setting.
    #[error("{slot}.{key}: {fault}")]
    Setting {
        /// The slot.
        slot: String,
        /// The setting.
        key: String,
        /// What is wrong.
        fault: Box<SettingFault>,
    },
    /// An effect asked for a setting that it did not describe: a mistake in the effect.
    #[error("{slot}.{key}: the effect asked for a {wanted}, but registered it as: {described}")]
    NotDescribed {
        /// The slot.
        slot: String,
        /// The setting.
        key: String,
        /// Type that the effect asked for.
        wanted: &'static str,
        /// Type that it registered.
        described: &'static str,
    },
    /// The constructor failed.
    #[error("stages.{slot}: \"{implementation}\" could not be made")]
    Construct {
        /// The slot.
        slot: String,
        /// The implementation.
        implementation: String,
        /// What went wrong.
        source: Box<dyn Error + Send + Sync>,
    },
    /// An implementation that wraps another has a setting of the same name.
    #[error(
        "{slot}.{key}: \"{wrapper}\" would have it twice, its own and that of \"{wrapped}\": give its own another name"
    )]
    SettingTwice {
        /// The slot.
        slot: String,
        /// The setting.
        key: String,
        /// The implementation that wraps.
        wrapper: String,
        /// The one that it wraps.
        wrapped: String,
    },
    /// The implementation does not go with how the program was started.
    #[error("stages.{slot}: \"{implementation}\" cannot run here: {reason}")]
    Unsuitable {
        /// The slot.
        slot: &'static str,
        /// The implementation.
        implementation: &'static str,
        /// Why.
        reason: String,
    },
    /// The implementation cannot be made where a frame is only planned.
    #[error("it needs a device, and the frame is planned without one")]
    NoDevice,
    /// Anything that fails inside a constructor; [`Slot::choose`] adds slot and implementation.
    #[error(transparent)]
    Other(Box<dyn Error + Send + Sync>),
}

impl SlotError {
    /// Wraps what went wrong inside a constructor.
    pub fn other(source: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self::Other(source.into())
    }
}

type Constructor<In, Out> = Arc<dyn Fn(&Build<'_>, &Settings) -> Result<BoxedEffect<In, Out>, SlotError> + Send + Sync>;

/// A slot of the frame and the implementations that can fill it. Clones share these.
pub struct Slot<In, Out> {
    info: SlotInfo,
    constructors: Vec<Constructor<In, Out>>,
}

impl<In, Out> Clone for Slot<In, Out> {
    fn clone(&self) -> Self {
        Self { info: self.info.clone(), constructors: self.constructors.clone() }
    }
}

impl<In, Out> fmt::Debug for Slot<In, Out> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Slot").field(&self.info).finish()
    }
}

impl<In, Out> Slot<In, Out> {
    /// A slot without implementations.
    #[must_use]
    pub fn new(name: &str) -> Self {
        let info = SlotInfo {
            name: name.to_owned(),
            about: String::new(),
            default: String::new(),
            implementations: Vec::new(),
            presets: Vec::new(),
        };
        Self { info, constructors: Vec::new() }
    }

    /// Says in one line what the slot is for.
    #[must_use]
    pub fn about(mut self, about: &str) -> Self {
        self.info.about = about.to_owned();
        self
    }

    /// Adds an implementation; see [`Slot::register`].
    #[must_use]
    pub fn with<F>(mut self, name: &str, about: &str, settings: &[SettingSpec], make: F) -> Self
    where
        F: Fn(&Build<'_>, &Settings) -> Result<BoxedEffect<In, Out>, SlotError> + Send + Sync + 'static,
    {
        self.register(name, about, settings, make);
        self
    }

    /// Adds an implementation to a slot that stands already. The first one is the default, unless [`Slot::default_to`]
    /// names another. One of the same name takes the place of the earlier one.
    pub fn register<F>(&mut self, name: &str, about: &str, settings: &[SettingSpec], make: F)
    where
        F: Fn(&Build<'_>, &Settings) -> Result<BoxedEffect<In, Out>, SlotError> + Send + Sync + 'static,
    {
        let info = ImplementationInfo { name: name.to_owned(), about: about.to_owned(), settings: settings.to_vec() };
        if self.info.default.is_empty() {
            name.clone_into(&mut self.info.default);
        }
        if let Some(at) = self.info.implementations.iter().position(|i| i.name == name) {
            self.info.implementations[at] = info;
            self.constructors[at] = Arc::new(make);
        } else {
            self.info.implementations.push(info);
            self.constructors.push(Arc::new(make));
        }
    }

    /// Names the implementation that runs when nothing else is said.
    #[must_use]
    pub fn default_to(mut self, name: &str) -> Self {
        name.clone_into(&mut self.info.default);
        self
    }

    /// Adds named choices among its implementations, from cheap to accurate.
    #[must_use]
    pub fn presets(mut self, presets: &[Preset]) -> Self {
        self.info.presets.extend_from_slice(presets);
        self
    }

    /// Describes the slot.
    #[must_use]
    pub fn info(&self) -> &SlotInfo {
        &self.info
    }

    /// Makes the implementation or preset `name` with `given` laid over its settings. It knows nothing of the configuration: to add to
    /// an implementation with the settings that the user chose for it, use [`Slot::wrap`].
    ///
    /// # Errors
    /// [`SlotError`] for an unknown name (the known ones are listed), an unsuitable value, or a constructor that failed.
    pub fn choose(
        &self,
        build: &Build<'_>,
        name: &str,
        given: &BTreeMap<String, Value>,
    ) -> Result<BoxedEffect<In, Out>, SlotError> {
        let (at, settings) = self.find(name, given)?;
        self.construct(build, at, &settings)
    }

    /// Place and settings of the implementation that `name`, its own or that of a preset, stands for.
    fn find(&self, name: &str, given: &BTreeMap<String, Value>) -> Result<(usize, Settings), SlotError> {
        let slot = &self.info.name;
        let unknown = || {
            let known = self.info.names();
            let suggestion = Suggestion::find(name, known.iter().map(String::as_str));
            SlotError::UnknownImplementation { slot: slot.clone(), name: name.to_owned(), known, suggestion }
        };
        let (chosen, mut values) = self.info.choice(name).ok_or_else(unknown)?;
        values.extend(given.clone());
        let at = self.info.implementations.iter().position(|i| i.name == chosen.name).ok_or_else(unknown)?;
        Ok((at, Settings::new(slot, chosen, &values)?))
    }

    fn construct(&self, build: &Build<'_>, at: usize, settings: &Settings) -> Result<BoxedEffect<In, Out>, SlotError> {
        self.constructors[at](build, settings).map_err(|source| match source {
            SlotError::Other(source) => SlotError::Construct {
                slot: self.info.name.clone(),
                implementation: self.info.implementations[at].name.clone(),
                source,
            },
            other => other,
        })
    }
}

#[cfg(test)]
mod tests;
