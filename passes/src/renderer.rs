//! Renders a scene frame by frame: declares the frame, runs it, reads images back.
use crate::contracts::AccelerationIn;
use crate::frame::frame;
use crate::read_back::Copies;
use crate::sampling::Sampling;
use crate::slots::{Frame, Slots, merged};
use magpie::config::{Config, ConfigError, Suggestion};
use magpie::frame::{PreviousView, ViewDesc};
use magpie::gpu::{Gpu, GpuError};
use magpie::graph::check::{Finding, FindingTracker, Poison, Scan};
use magpie::graph::execute::{ExecuteError, ExecuteOptions, Executed, Executor, Imports};
use magpie::graph::{Declaration, Extent, GraphError, Observer, Plan, Switches};
use magpie::measure::{FrameSample, SlotReport, slot_reports};
use magpie::pixels::Pixels;
use magpie::scene::{
    Camera, FloatingOrigin, Moment, ResidentError, ResidentOptions, ResidentScene, Scene, SceneFacts, SharedScene,
};
use magpie::slot::{Build, SlotError, SlotNeeds};
use magpie_shaders::Rays;
use std::cell::RefCell;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Instant;

/// How to render.
#[derive(Clone, Copy, Debug, Default)]
pub struct RenderOptions {
    /// Pixels of the picture from left to right, or 0: minimised.
    pub width: u32,
    /// Pixels from top to bottom, or 0: minimised.
    pub height: u32,
    /// Seed of everything random.
    pub seed: u32,
    /// Scan every pass output for NaN and infinity, and ask the validation layers, which the device must have been opened with
    /// ([`GpuOptions::validation`](magpie::gpu::GpuOptions)): else [`Renderer::new`] fails with [`GpuError::NotValidated`].
    pub check: bool,
    /// How rays are traced; the device must be able to.
    pub rays: Rays,
}

/// One frame, as it is asked for.
#[derive(Clone, Copy, Debug)]
pub struct FrameRequest<'a> {
    /// From where.
    pub camera: &'a Camera,
    /// Which moment of the scene's animation, seconds.
    pub time: f64,
    /// An image to read back instead of the frame's own: the pass and its output.
    pub view: Option<(&'a str, &'a str)>,
    /// Bring the images to the host.
    pub read_back: bool,
}

/// Images of a frame on the host.
#[derive(Clone, Debug)]
pub struct ReadBack {
    /// Linear radiance before the tone map, or the image that was asked for.
    pub linear: Pixels,
    /// What a display shows; `None` when another image was asked for.
    pub display: Option<Pixels>,
}

/// A frame that ran.
pub struct FrameResult {
    /// Times, counts and memory.
    pub sample: FrameSample,
    /// Images, when they were asked for.
    pub images: Option<ReadBack>,
    /// What the slots of [`Renderer::read_slots`] gave, in that order; `None` where a slot gave nothing, as one that is off.
    pub slots: Vec<(String, Option<Pixels>)>,
    /// What the scan found.
    pub findings: Vec<Finding>,
    /// What the implementations asked for.
    pub needs: Vec<SlotNeeds>,
    /// What was declared.
    pub declaration: Arc<Declaration>,
    /// How it ran.
    pub plan: Arc<Plan>,
}

impl FrameResult {
    /// What ran in each slot, and what was idle and why.
    #[must_use]
    pub fn what_runs(&self) -> Vec<SlotReport> {
        slot_reports(&self.needs, &self.declaration, &self.plan)
    }
}

/// Why a frame could not be rendered.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// A stage could not be made.
    #[error(transparent)]
    Stage(#[from] SlotError),
    /// No such slot, implementation or setting.
    #[error(transparent)]
    Config(Box<ConfigError>),
    /// The scene could not be brought to the device.
    #[error("scene: {0}")]
    Scene(#[from] ResidentError),
    /// The frame did not run.
    #[error(transparent)]
    Execute(#[from] ExecuteError),
    /// No such image for `--view`.
    #[error(transparent)]
    View(#[from] GraphError),
    /// The device refused.
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

/// A scene, a configuration and a size, ready to render.
pub struct Renderer {
    gpu: Gpu,
    executor: Executor,
    scene: SharedScene,
    slots: Slots,
    config: Config,
    implementations: Frame,
    view: magpie::gpu::Staging,
    scan: Option<Scan>,
    tracker: FindingTracker,
    poisons: Vec<Poison>,
    read_slots: Vec<String>,
    options: RenderOptions,
    frame: u32,
    previous: Option<Previous>,
    origin: FloatingOrigin,
}

/// From where the frame before was seen.
struct Previous {
    camera: Camera,
    extent: Extent,
    output: Extent,
    jitter: [f32; 2],
}

impl Previous {
    fn view(&self) -> PreviousView<'_> {
        let Self { ref camera, extent, output, jitter } = *self;
        PreviousView { camera, extent, output, jitter }
    }
}

impl Renderer {
    /// Uploads the scene and makes every pipeline.
    ///
    /// # Errors
    /// [`RenderError`].
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        slots: &Slots,
        config: &Config,
        options: RenderOptions,
    ) -> Result<Self, RenderError> {
        if options.check {
            gpu.need_validation()?;
        }
        let (implementations, facts) =
            (Frame::new(&Build::new(gpu, options.rays), slots, config)?, SceneFacts::new(scene));
        let mut how = ResidentOptions { rays: options.rays, ..ResidentOptions::default() };
        if let Some(geometry) = merged(&implementations.needs(&facts)).geometry {
            (how.compaction, how.ray_detail) = (geometry.compaction, geometry.ray_detail);
        }
        let resident = ResidentScene::with_facts(gpu, scene, facts, how)?;
        Ok(Self {
            gpu: gpu.clone(),
            executor: Executor::new(gpu)?,
            implementations,
            slots: slots.clone(),
            config: config.clone(),
            view: magpie::gpu::Staging::new(gpu, "view"),
            scan: options.check.then(|| Scan::new(gpu)).transpose()?,
            scene: resident.shared(),
            tracker: FindingTracker::default(),
            poisons: Vec::new(),
            read_slots: Vec::new(),
            options,
            frame: 0,
            previous: None,
            origin: FloatingOrigin::default(),
        })
    }

    /// Sets which steps the frame graph takes, from the next frame on.
    pub fn set_switches(&mut self, switches: Switches) {
        self.executor.set_options(ExecuteOptions { switches, ..self.executor.options() });
    }

    /// How frames are run.
    pub fn execution(&self) -> ExecuteOptions {
        self.executor.options()
    }

    /// Sets how frames are run, from the next on.
    pub fn set_execution(&mut self, options: ExecuteOptions) {
        self.executor.set_options(options);
    }

    /// Begins anew: the next frame is the first again, and nothing is left of those before it.
    pub fn restart(&mut self) {
        self.executor.restart();
        self.tracker.clear();
        (self.frame, self.previous, self.origin) = (0, None, FloatingOrigin::default());
    }

    /// Renders in another size from the next frame on. What histories hold in the old size is lost then, but not before:
    /// where the old size returns without a frame between them, as after a window was minimised, they go on.
    pub fn resize(&mut self, width: u32, height: u32) {
        (self.options.width, self.options.height) = (width, height);
    }

    /// The camera jumps: the next frame has nothing to do with the one before. Nothing moves in it, and histories begin anew.
    pub fn cut(&mut self) {
        self.executor.cut();
        self.previous = None;
    }

    /// Puts an implementation into a slot, with the settings that the configuration has for it.
    ///
    /// # Errors
    /// [`RenderError::Config`] where there is no such slot or implementation, [`RenderError::Stage`] where it cannot be made.
    /// The old one stays then.
    pub fn swap(&mut self, slot: &str, implementation: &str) -> Result<(), RenderError> {
        let mut over = Config::default();
        over.stages.insert(slot.to_owned(), implementation.to_owned());
        self.slots.catalogue().check(&over, "swap").map_err(wrong)?;
        let mut config = self.config.clone();
        config.merge(over);
        self.put_in_place(config)
    }

    /// Renders with another configuration from the next frame on. Slots whose implementation and settings stay what they are
    /// keep their histories.
    ///
    /// # Errors
    /// As [`Renderer::swap`], and for settings that do not suit. Nothing has changed then.
    pub fn configure(&mut self, config: &Config) -> Result<(), RenderError> {
        self.slots.catalogue().check(config, "configure").map_err(wrong)?;
        self.put_in_place(config.clone())
    }

    fn put_in_place(&mut self, config: Config) -> Result<(), RenderError> {
        self.implementations.configure(&Build::new(&self.gpu, self.options.rays), &self.slots, &config)?;
        self.config = config;
        Ok(())
    }

    /// What the implementation in each slot asks for in the frame to come, in the order of the frame.
    pub fn needs(&self) -> Vec<SlotNeeds> {
        self.implementations.needs(self.scene.borrow().facts())
    }

    /// The configuration in use.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Where everything that the scan has found came from. Frames count from 0, as in [`magpie::frame::View::frame`].
    pub fn finding_tracker(&self) -> &FindingTracker {
        &self.tracker
    }

    /// Multiplies the strength of a light with a factor, at least 0, from the next frame on: 0 switches it off.
    pub fn scale_light(&mut self, light: u32, factor: f32) {
        self.scene.borrow_mut().scale_light(light, factor);
    }

    /// Spoils an output of the next frame, to test what finds NaN.
    pub fn poison(&mut self, poison: Poison) {
        self.poisons.push(poison);
    }

    /// From the next frame on, frames that are read back also bring the main image of these slots: `shadows` the visibility, `ao` the openness,
    /// `direct`, `gi` and `reflections` their radiance, `compose` and `sky` the sum so far, `post` the display.
    ///
    /// # Errors
    /// [`RenderError::Config`] where there is no such slot, or it has no image.
    pub fn read_slots(&mut self, slots: &[&str]) -> Result<(), RenderError> {
        let known = Slots::with_images();
        if let Some(slot) = slots.iter().find(|s| !known.contains(s)) {
            let (origin, key, slot) = ("read_slots".to_owned(), (*slot).to_owned(), (*slot).to_owned());
            let suggestion = Suggestion::find(&slot, known.iter().copied());
            let known = known.into_iter().map(str::to_owned).collect();
            return Err(wrong(ConfigError::UnknownSlot { origin, key, slot, known, suggestion }));
        }
        self.read_slots = slots.iter().map(|s| (*s).to_owned()).collect();
        Ok(())
    }

    /// Renders one frame and waits for it. `None`: the size is zero, nothing was done, and all is as it was.
    ///
    /// # Errors
    /// [`RenderError::View`] when the image that was asked for does not exist, and whatever the device says. With
    /// `check`, messages of the validation layers are errors.
    pub fn frame(&mut self, request: FrameRequest<'_>) -> Result<Option<FrameResult>, RenderError> {
        let result = self.try_frame(request);
        if result.is_err() {
            self.scene.borrow_mut().forget();
        }
        result
    }

    fn try_frame(&mut self, request: FrameRequest<'_>) -> Result<Option<FrameResult>, RenderError> {
        if self.options.width == 0 || self.options.height == 0 {
            return Ok(None);
        }
        let start = Instant::now();
        let output = Extent::new(self.options.width, self.options.height);
        let needs = self.needs();
        let all = merged(&needs);
        self.scene.borrow_mut().want_light_tables(&self.gpu, all.emitters, all.light_tables)?;
        let sampling = Sampling::of(&all);
        let (extent, jitter) = (sampling.extent(output), sampling.jitter(self.frame));
        let mut g = self.executor.begin(extent);
        let imports = Rc::<RefCell<Imports>>::default();
        let desc = ViewDesc {
            camera: request.camera,
            extent,
            output,
            jitter,
            frame: self.frame,
            seed: self.options.seed,
            previous: self.previous.as_ref().map(Previous::view),
        };
        let (cut, origin) = (self.previous.is_none(), self.origin.follow(request.camera));
        self.scene.borrow_mut().set_moment(&Moment { time: request.time, origin, cut });
        let view = desc.declare(&mut self.view, &self.scene.borrow(), &mut g, &mut imports.borrow_mut())?;
        let (scene, camera) = (self.scene.clone(), request.camera.clone());
        let scene = AccelerationIn::Resident { scene, imports: imports.clone(), camera };

        self.poisons.drain(..).for_each(|poison| g.poison(poison));

        // Observers see every pass while what it wrote is new: the scan, and the copy for `--view`.
        let mut scan = None;
        let mut scanner: Option<Observer> = None;
        if let Some(pipelines) = self.scan {
            let (scanned, observer) = pipelines.observer(&self.gpu, &imports);
            scan = Some(scanned);
            scanner = Some(Box::new(observer));
        }
        let copies = Copies::new(&self.gpu, &imports);
        let mut wanted = request.view.filter(|_| request.read_back).map(|(p, o)| (p.to_owned(), o.to_owned()));
        let viewer = copies.clone();
        g.observe_passes(move |g, pass| {
            if let Some(scanner) = &mut scanner {
                scanner(g, pass);
            }
            if wanted.is_some() {
                let found = g
                    .images_of(pass)
                    .into_iter()
                    .find(|p| wanted.as_ref() == Some(&(p.pass.clone(), p.output.clone())));
                if let Some(found) = found {
                    wanted = None;
                    viewer.copy(g, "view.read_back", found.image);
                }
            }
        });

        let mut slot_copies = None;
        if request.read_back && !self.read_slots.is_empty() {
            let copies = Copies::new(&self.gpu, &imports);
            let gave = Rc::new(RefCell::new(vec![false; self.read_slots.len()]));
            slot_copies = Some((copies.clone(), gave.clone()));
            let wanted = self.read_slots.clone();
            g.observe_slots(move |g, slot, image| {
                if let (Some(at), Some(image)) = (wanted.iter().position(|w| w == slot), image) {
                    copies.copy(g, &format!("read_back.{slot}"), image);
                    gave.borrow_mut()[at] = true;
                }
            });
        }

        let out = frame(&mut self.implementations, &mut g, &view, &all, scene)?;
        match request.view {
            Some((pass, output)) => {
                let image = g.find(pass, output)?;
                if !request.read_back {
                    g.output(image);
                }
            }
            None if request.read_back => {
                copies.copy(&mut g, "read_back.radiance", out.radiance);
                copies.copy(&mut g, "read_back.display", out.display);
            }
            None => g.output(out.display),
        }

        let declare_ns = start.elapsed().as_nanos() as u64;
        let Executed { declaration, plan, mut sample } = self.executor.run(g, &imports.borrow())?;
        if sample.passes.iter().any(|p| p.not_finite > 0) {
            // It may stand in what is made from the scene only where that moves: all of that is made anew.
            self.scene.borrow_mut().forget();
        }
        if self.options.check {
            self.gpu.check_validation()?;
        }
        sample.declare_ns = declare_ns;
        sample.cpu_ns += declare_ns;
        sample.memory.scene_bytes = self.scene.borrow().scene_bytes();
        sample.acceleration = self.scene.borrow().acceleration();
        sample.memory.acceleration_bytes = self.scene.borrow().acceleration_bytes();
        let mut findings = Vec::new();
        if let Some(scanned) = scan {
            findings = scanned.findings();
            self.tracker.follow(self.frame, &declaration, &plan.order, &findings, &scanned.unscanned());
        }
        self.previous = Some(Previous { camera: request.camera.clone(), extent, output, jitter });
        self.frame += 1;
        let slots = match slot_copies {
            None => Vec::new(),
            Some((copies, gave)) => in_order(&self.read_slots, &gave.borrow(), copies.finish()?),
        };
        let mut images = copies.finish()?.into_iter();
        let images = images.next().map(|linear| ReadBack { linear, display: images.next() });
        Ok(Some(FrameResult { sample, images, slots, findings, needs, declaration, plan }))
    }
}

/// Images come in the order of the frame; they are wanted in the order in which they were asked for.
fn in_order(wanted: &[String], gave: &[bool], images: Vec<Pixels>) -> Vec<(String, Option<Pixels>)> {
    let mut slots: Vec<(String, Option<Pixels>)> = wanted.iter().map(|slot| (slot.clone(), None)).collect();
    let in_frame = Slots::with_images().into_iter();
    let given = in_frame.filter_map(|slot| wanted.iter().position(|w| w == slot)).filter(|at| gave[*at]);
    for (at, image) in given.zip(images) {
        slots[at].1 = Some(image);
    }
    slots
}

fn wrong(error: ConfigError) -> RenderError {
    RenderError::Config(Box::new(error))
}
