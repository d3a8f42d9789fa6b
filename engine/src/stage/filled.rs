//! What sits in a slot, and how something else takes its place while frames go on.

use std::{collections::BTreeMap, fmt};

use super::{BoxedEffect, Build, Settings, Stage, StageError};
use crate::{config::Config, frame::View, graph::FrameGraph};

/// A slot with an implementation in it.
pub struct Filled<In, Out> {
    effect: BoxedEffect<In, Out>,
    slot: String,
    implementation: String,
    settings: Settings,
}

/// Puts another implementation into a slot; all that could fail is done.
pub type Change<'f> = Box<dyn FnOnce() + 'f>;

impl<In, Out> Filled<In, Out> {
    /// Adds its passes; see [`Effect::add`](super::Effect::add).
    pub fn add(&mut self, g: &mut FrameGraph, view: &View, input: In) -> Out {
        self.effect.add(g, view, input)
    }

    /// Name of the slot.
    #[must_use]
    pub fn slot(&self) -> &str {
        &self.slot
    }

    /// Name of the implementation.
    #[must_use]
    pub fn implementation(&self) -> &str {
        &self.implementation
    }

    /// What it was made with.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.settings
    }
}

impl<In, Out> fmt::Debug for Filled<In, Out> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Filled").field(&self.implementation).field(&self.settings).finish()
    }
}

impl<In, Out> Stage<In, Out> {
    /// The settings of the implementation that `config` names, for whoever needs them before it is made.
    ///
    /// # Errors
    /// As [`Stage::from_config`].
    pub fn settings(&self, config: &Config) -> Result<Settings, StageError> {
        Ok(self.wanted(config)?.1)
    }

    /// Makes the implementation that `config` names for this slot, or the default, with the settings of `config`.
    ///
    /// # Errors
    /// As [`Stage::choose`].
    pub fn from_config(&self, build: &Build<'_>, config: &Config) -> Result<Filled<In, Out>, StageError> {
        let (at, settings) = self.wanted(config)?;
        let implementation = self.info.implementations[at].name.clone();
        let slot = self.info.name.clone();
        Ok(Filled { effect: self.construct(build, at, &settings)?, slot, implementation, settings })
    }

    /// Makes what `config` wants in place of what is there, and gives what puts it there. `None` where implementation and
    /// settings are what they were: the instance stays, and with it the histories that it owns.
    ///
    /// # Errors
    /// As [`Stage::choose`]; what is there stays.
    pub fn change<'f>(
        &self,
        filled: &'f mut Filled<In, Out>,
        build: &Build<'_>,
        config: &Config,
    ) -> Result<Option<Change<'f>>, StageError> {
        let (at, settings) = self.wanted(config)?;
        if filled.implementation == self.info.implementations[at].name && filled.settings == settings {
            return Ok(None);
        }
        let new = self.from_config(build, config)?;
        Ok(Some(Box::new(move || *filled = new)))
    }

    fn wanted(&self, config: &Config) -> Result<(usize, Settings), StageError> {
        let name = config.stages.get(&self.info.name).unwrap_or(&self.info.default);
        let none = BTreeMap::new();
        self.find(name, config.settings.get(&self.info.name).unwrap_or(&none))
    }
}
