//! What sits in a slot, and how something else takes its place while frames go on.

use std::{collections::BTreeMap, fmt};

use super::{BoxedEffect, Build, Needs, Settings, Slot, SlotError};
use crate::{config::Config, frame::View, graph::FrameGraph, scene::SceneFacts};

/// A slot with an implementation in it.
pub struct Implementation<In, Out> {
    effect: BoxedEffect<In, Out>,
    slot: String,
    implementation: String,
    settings: Settings,
}

/// Puts another implementation into a slot; all that could fail is done.
pub type Change<'f> = Box<dyn FnOnce() + 'f>;

impl<In, Out> Implementation<In, Out> {
    /// Adds its passes; see [`Effect::add`](super::Effect::add).
    pub fn add(&mut self, g: &mut FrameGraph, view: &View, input: In) -> Out {
        self.effect.add(g, view, input)
    }

    /// What it asks of the frame; see [`Effect::needs`](super::Effect::needs).
    #[must_use]
    pub fn needs(&self, facts: &SceneFacts) -> Needs {
        self.effect.needs(facts)
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

impl<In, Out> fmt::Debug for Implementation<In, Out> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Implementation").field(&self.implementation).field(&self.settings).finish()
    }
}

impl<In, Out> Slot<In, Out> {
    /// Makes the implementation that `config` names for this slot, or the default, with the settings of `config`.
    ///
    /// # Errors
    /// As [`Slot::choose`].
    pub fn from_config(&self, build: &Build<'_>, config: &Config) -> Result<Implementation<In, Out>, SlotError> {
        let (at, settings) = self.wanted(config)?;
        let implementation = self.info.implementations[at].name.clone();
        let slot = self.info.name.clone();
        Ok(Implementation { effect: self.construct(build, at, &settings)?, slot, implementation, settings })
    }

    /// Makes what `config` wants in place of what is there, and gives what puts it there. `None` where implementation and
    /// settings are what they were: the instance stays, and with it the histories that it owns.
    ///
    /// # Errors
    /// As [`Slot::choose`]; what is there stays.
    pub fn change<'f>(
        &self,
        old: &'f mut Implementation<In, Out>,
        build: &Build<'_>,
        config: &Config,
    ) -> Result<Option<Change<'f>>, SlotError> {
        let (at, settings) = self.wanted(config)?;
        if old.implementation == self.info.implementations[at].name && old.settings == settings {
            return Ok(None);
        }
        let new = self.from_config(build, config)?;
        Ok(Some(Box::new(move || *old = new)))
    }

    /// Makes what [`change`](Self::change) would make, and drops it, so that `build` notes its pipelines. Returns whether there is such a change.
    ///
    /// # Errors
    /// As [`Slot::choose`].
    pub fn rehearse(
        &self,
        old: &Implementation<In, Out>,
        build: &Build<'_>,
        config: &Config,
    ) -> Result<bool, SlotError> {
        let (at, settings) = self.wanted(config)?;
        let changes = old.implementation != self.info.implementations[at].name || old.settings != settings;
        if changes {
            drop(self.construct(build, at, &settings)?);
        }
        Ok(changes)
    }

    pub(super) fn wanted(&self, config: &Config) -> Result<(usize, Settings), SlotError> {
        let name = config.stages.get(&self.info.name).unwrap_or(&self.info.default);
        let none = BTreeMap::new();
        self.find(name, config.settings.get(&self.info.name).unwrap_or(&none))
    }
}
