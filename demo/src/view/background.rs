//! Work that would make a frame wait, on threads of its own: pipelines of a new configuration, scenes from files.

use std::{
    mem,
    path::PathBuf,
    thread::{self, JoinHandle},
};

use magpie::{
    config::Config,
    gpu::{Gpu, GpuError, PipelineSet},
    scene::Scene,
};

use super::window::App;
use crate::{
    args::{EnvironmentArguments, Supply},
    exit::Failure,
    session,
};

/// A configuration whose pipelines are being made. The one before runs until they are.
pub(super) struct Coming {
    pub(super) config: Config,
    made: JoinHandle<Result<(), GpuError>>,
}

/// A scene that is being loaded.
pub(super) struct Loading {
    wanted: Wanted,
    loaded: JoinHandle<Result<Scene, Failure>>,
}

/// A scene, and what surrounds it.
#[derive(Clone)]
pub(super) struct Wanted {
    pub(super) path: PathBuf,
    pub(super) environment: EnvironmentArguments,
    /// Stay where the camera is, with time and the rest as they are.
    pub(super) stays: bool,
}

impl Wanted {
    pub(super) fn load(&self, supply: Supply) -> Result<Scene, Failure> {
        session::load_scene(&self.path, Some(&self.environment), supply)
    }
}

/// What runs beside the frames.
#[derive(Default)]
pub(super) struct Background {
    pub(super) coming: Option<Coming>,
    pub(super) loading: Option<Loading>,
    /// Pipelines that nobody waits for any more. The threads have a share of the device.
    stale: Vec<JoinHandle<Result<(), GpuError>>>,
}

impl Background {
    /// Makes the pipelines of a configuration, which takes the place of one that is still being made.
    pub(super) fn prepare(&mut self, gpu: &Gpu, set: PipelineSet, config: Config) -> Result<(), Failure> {
        let gpu = gpu.clone();
        let make = move || set.make(&gpu);
        let made = thread::Builder::new().name("pipelines".to_owned()).spawn(make).map_err(Failure::running)?;
        self.drop_coming();
        self.coming = Some(Coming { config, made });
        Ok(())
    }

    /// Lets go of a configuration that will not be needed.
    pub(super) fn drop_coming(&mut self) {
        self.stale.retain(|thread| !thread.is_finished());
        self.stale.extend(self.coming.take().map(|coming| coming.made));
    }

    /// Loads a scene, which takes the place of one that is still being loaded.
    pub(super) fn load(&mut self, wanted: Wanted, supply: Supply) -> Result<(), Failure> {
        let of_thread = wanted.clone();
        let load = move || of_thread.load(supply);
        let loaded = thread::Builder::new().name("scene".to_owned()).spawn(load).map_err(Failure::running)?;
        self.loading = Some(Loading { wanted, loaded });
        Ok(())
    }

    /// What is going on, as a line.
    pub(super) fn line(&self) -> Option<String> {
        let loading = self.loading.as_ref().map(|loading| format!("loading {}", loading.wanted.path.display()));
        let coming = self.coming.as_ref().map(|_| "pipelines of the new configuration are being made".to_owned());
        loading.or(coming)
    }

    /// Waits for all that uses the device.
    pub(super) fn end(mut self) {
        self.drop_coming();
        for thread in mem::take(&mut self.stale) {
            let _ = thread.join();
        }
    }
}

impl App<'_> {
    /// Puts in place what is done.
    pub(super) fn take_background(&mut self) -> Result<(), Failure> {
        if let Some(Coming { config, made }) = self.background.coming.take_if(|coming| coming.made.is_finished()) {
            joined(made)?.map_err(Failure::from)?;
            self.configure_now(config)?;
        }
        if let Some(Loading { wanted, loaded }) =
            self.background.loading.take_if(|loading| loading.loaded.is_finished())
        {
            let scene = joined(loaded)?.map_err(|failure| failure.context(wanted.path.display().to_string()))?;
            self.show_scene(scene, wanted)?;
        }
        Ok(())
    }
}

/// What a thread returns.
fn joined<T>(thread: JoinHandle<T>) -> Result<T, Failure> {
    thread.join().map_err(|_| Failure::Run(anyhow::anyhow!("a thread beside the frames has panicked")))
}
