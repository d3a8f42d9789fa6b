//! Implementations that add to another one of the same slot.

use std::{cell::RefCell, rc::Rc};

use super::{BoxedEffect, Build, Effect, Needs, SettingSpec, Settings, Slot, SlotError};
use crate::{config::Suggestion, frame::View, graph::FrameGraph, scene::SceneFacts};

impl<In, Out> Slot<In, Out> {
    /// Adds an implementation that wraps another one of this slot, such as a filter after the standard `post`.
    ///
    /// The settings of the wrapped one become settings of the new one, with the same names, units, ranges, defaults and sweeps: whoever
    /// configures `post.exposure` configures it for both. What the wrapped one [needs](super::Effect::needs) of the frame is asked for too, so
    /// that a wrapper need not pass it on. `make` gets the wrapped effect, made with what the configuration says, and all
    /// settings, its own and those of the wrapped one.
    ///
    /// What is wrapped is the implementation that has the name `wrapped` now, whatever is registered under that name later. So an
    /// implementation may be wrapped under its own name, and takes its place then, in presets too.
    ///
    /// ```text
    /// stages.post.wrap("standard", "vignette", "Darker corners.", &settings, |build, settings, standard| {
    ///     Ok(Box::new(Vignette::new(build, settings, standard)?))
    /// })?;
    /// ```
    ///
    /// # Errors
    /// [`SlotError::UnknownImplementation`] where nothing has the name `wrapped`; [`SlotError::SettingTwice`] where one of `settings` is
    /// called as one of the wrapped implementation's. Nothing is registered then.
    pub fn wrap<F>(
        &mut self,
        wrapped: &str,
        name: &str,
        about: &str,
        settings: &[SettingSpec],
        make: F,
    ) -> Result<(), SlotError>
    where
        F: Fn(&Build<'_>, &Settings, BoxedEffect<In, Out>) -> Result<BoxedEffect<In, Out>, SlotError>
            + Send
            + Sync
            + 'static,
        In: 'static,
        Out: 'static,
    {
        let slot = &self.info.name;
        let Some(at) = self.info.implementations.iter().position(|i| i.name == wrapped) else {
            let known: Vec<String> = self.info.implementations.iter().map(|i| i.name.clone()).collect();
            let suggestion = Suggestion::find(wrapped, known.iter().map(String::as_str));
            let (slot, name) = (slot.clone(), wrapped.to_owned());
            return Err(SlotError::UnknownImplementation { slot, name, known, suggestion });
        };
        let (info, constructor) = (self.info.implementations[at].clone(), self.constructors[at].clone());
        if let Some(twice) = settings.iter().find(|own| info.settings.iter().any(|s| s.key == own.key)) {
            let (slot, key) = (slot.clone(), twice.key.to_owned());
            return Err(SlotError::SettingTwice { slot, key, wrapper: name.to_owned(), wrapped: info.name });
        }
        let all: Vec<SettingSpec> = settings.iter().chain(&info.settings).cloned().collect();
        self.register(name, about, &all, move |build, settings| {
            let inner = Rc::new(RefCell::new(constructor(build, &settings.of(&info))?));
            let outer = make(build, settings, Box::new(Shared(inner.clone())))?;
            Ok(Box::new(Wrapping { outer, inner }))
        });
        Ok(())
    }
}

type Inner<In, Out> = Rc<RefCell<BoxedEffect<In, Out>>>;

/// The wrapped effect, as its wrapper has it.
struct Shared<In, Out>(Inner<In, Out>);

impl<In, Out> Effect for Shared<In, Out> {
    type In = In;
    type Out = Out;

    fn needs(&self, facts: &SceneFacts) -> Needs {
        self.0.borrow().needs(facts)
    }

    fn add(&mut self, g: &mut FrameGraph, view: &View, input: In) -> Out {
        self.0.borrow_mut().add(g, view, input)
    }
}

/// A wrapper, which needs what it wraps needs.
struct Wrapping<In, Out> {
    outer: BoxedEffect<In, Out>,
    inner: Inner<In, Out>,
}

impl<In, Out> Effect for Wrapping<In, Out> {
    type In = In;
    type Out = Out;

    fn needs(&self, facts: &SceneFacts) -> Needs {
        self.outer.needs(facts).and(self.inner.borrow().needs(facts))
    }

    fn add(&mut self, g: &mut FrameGraph, view: &View, input: In) -> Out {
        self.outer.add(g, view, input)
    }
}

impl Settings {
    /// Those that an implementation describes.
    pub(super) fn of(&self, implementation: &super::ImplementationInfo) -> Self {
        let described = |key: &str| implementation.settings.iter().any(|s| s.key == key);
        let values =
            self.values.iter().filter(|(key, _)| described(key)).map(|(k, v)| (k.clone(), v.clone())).collect();
        Self { slot: self.slot.clone(), values }
    }
}
