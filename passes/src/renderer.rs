//! Renders a scene frame by frame: declares each frame, submits it, and reads images back.
use crate::contracts::AccelerationIn;
use crate::frame::{FrameOut, frame};
use crate::in_flight::{FrameTicket, Outcome, Pending, SlotCopies, is_loss};
use crate::parts::inspect::{Inspected, Inspection, Inspector, Lookout};
use crate::picture::{AddPasses, NamedCopies, Picture};
use crate::read_back::Copies;
use crate::sampling::Sampling;
use crate::slots::{Frame, Slots, merged};
use magpie::config::{Config, ConfigError, Suggestion};
use magpie::frame::{PreviousView, ViewDesc};
use magpie::gpu::{Gpu, GpuError, PipelineSet};
use magpie::graph::check::{Finding, FindingTracker, Poison, Scan};
use magpie::graph::execute::{ExecuteError, ExecuteOptions, Executor, Imports};
use magpie::graph::{Declaration, Extent, Format, GraphError, Observer, Plan, Switches};
use magpie::measure::{FrameSample, SlotReport, slot_reports};
use magpie::pixels::Pixels;
use magpie::scene::{
    Camera, FloatingOrigin, Moment, ResidentError, ResidentOptions, ResidentScene, Scene, SceneFacts, SharedScene,
};
use magpie::slot::{Build, SlotError, SlotNeeds};
use magpie_shaders::Rays;
use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Instant;

/// Options of a [`Renderer`].
#[derive(Clone, Copy, Debug)]
pub struct RenderOptions {
    /// Width of the picture, pixels; 0 while a window is minimised.
    pub width: u32,
    /// Height of the picture, pixels; 0 while a window is minimised.
    pub height: u32,
    /// Seed of all random numbers.
    pub seed: u32,
    /// Scan every pass output for NaN and infinity, and treat messages of the validation layers as errors. The device must have been opened with
    /// them ([`GpuOptions::validation`](magpie::gpu::GpuOptions)), else [`Renderer::new`] fails with [`GpuError::NotValidated`].
    pub check: bool,
    /// Ray-tracing backend, which the device must support.
    pub rays: Rays,
    /// Frames that may be submitted and not finished, 1 to [`MOST_IN_FLIGHT`]: [`Renderer::submit`]. The nearest of these is taken for others.
    pub frames_in_flight: u32,
}

/// Greatest number of frames in flight.
pub const MOST_IN_FLIGHT: u32 = 3;

impl Default for RenderOptions {
    fn default() -> Self {
        Self { width: 0, height: 0, seed: 0, check: false, rays: Rays::default(), frames_in_flight: 2 }
    }
}

/// Parameters of one frame.
#[derive(Clone, Copy, Debug)]
pub struct FrameRequest<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// Time in the scene's animation, seconds.
    pub time: f64,
    /// An image to read back instead of the finished picture: names of the pass and of its output.
    pub view: Option<(&'a str, &'a str)>,
    /// Copy images to the host.
    pub read_back: bool,
}

/// Images of a frame on the host.
#[derive(Clone, Debug)]
pub struct ReadBack {
    /// Linear radiance before exposure and tone curve, or the image of [`FrameRequest::view`].
    pub linear: Pixels,
    /// Display values; `None` with a [`FrameRequest::view`].
    pub display: Option<Pixels>,
}

/// The result of a frame.
pub struct FrameResult {
    /// Number of the frame, from 0.
    pub frame: u32,
    /// Times, counts and memory.
    pub sample: FrameSample,
    /// The images, with [`FrameRequest::read_back`].
    pub images: Option<ReadBack>,
    /// Main images of the slots of [`Renderer::read_slots`], in that order; `None` for a slot without output, such as one that is off.
    pub slots: Vec<(String, Option<Pixels>)>,
    /// Images of [`Picture::read_back`], in the order of its calls.
    pub copied: Vec<(String, Pixels)>,
    /// What was found in the image of [`Renderer::inspect`], if the frame made it.
    pub inspected: Option<Inspected>,
    /// Values that are not finite, as the scan found them.
    pub findings: Vec<Finding>,
    /// The needs of the implementations.
    pub needs: Vec<SlotNeeds>,
    /// The declared passes and resources.
    pub declaration: Arc<Declaration>,
    /// Order, queues, memory and barriers of the frame.
    pub plan: Arc<Plan>,
}

impl FrameResult {
    /// The passes that ran in each slot, and why others were idle.
    #[must_use]
    pub fn what_runs(&self) -> Vec<SlotReport> {
        slot_reports(&self.needs, &self.declaration, &self.plan)
    }
}

/// Why a frame could not be rendered.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// An implementation could not be created.
    #[error(transparent)]
    Stage(#[from] SlotError),
    /// There is no such slot, implementation or setting.
    #[error(transparent)]
    Config(Box<ConfigError>),
    /// The scene could not be uploaded or updated.
    #[error("scene: {0}")]
    Scene(#[from] ResidentError),
    /// The frame could not be run.
    #[error(transparent)]
    Execute(#[from] ExecuteError),
    /// The image of [`FrameRequest::view`] does not exist.
    #[error(transparent)]
    View(#[from] GraphError),
    /// The device reported an error.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The image of [`Picture::copy_into`] does not fit the picture.
    #[error("the image of {name} is {:?} of {}, the picture {:?} of {}", found.0, found.1, wanted.0, wanted.1)]
    Target {
        /// Name of the copy.
        name: String,
        /// Format and size of the image.
        found: (Format, Extent),
        /// Format and size of the picture.
        wanted: (Format, Extent),
    },
    /// The ticket of a frame that this renderer has not submitted.
    #[error("frame {frame} was submitted by another renderer")]
    Ticket {
        /// Number of the frame.
        frame: u32,
    },
}

/// A scene, a configuration and a size, ready to render.
pub struct Renderer {
    pub(crate) gpu: Gpu,
    pub(crate) executor: Executor,
    pub(crate) scene: SharedScene,
    slots: Slots,
    config: Config,
    implementations: Frame,
    view: magpie::gpu::Staging,
    scan: Option<Scan>,
    pub(crate) tracker: FindingTracker,
    poisons: Vec<Poison>,
    read_slots: Vec<String>,
    /// Made when it is first needed.
    pub(crate) inspector: Option<Inspector>,
    pub(crate) inspection: Option<Inspection>,
    pub(crate) options: RenderOptions,
    frame: u32,
    previous: Option<Previous>,
    origin: FloatingOrigin,
    /// Frames in flight, the oldest first.
    pub(crate) pending: VecDeque<Pending>,
    /// The first error of a frame of which nobody had the ticket.
    pub(crate) unclaimed: Option<RenderError>,
    /// The picture that [`Renderer::show`] hands to the display.
    pub(crate) shown: Option<Arc<magpie::gpu::Image>>,
}

/// Camera and size of the previous frame.
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
    /// Uploads the scene and creates all pipelines.
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
        let mut resident_options = ResidentOptions { rays: options.rays, ..ResidentOptions::default() };
        if let Some(geometry) = merged(&implementations.needs(&facts)).geometry {
            resident_options.compaction = geometry.compaction;
            resident_options.ray_detail = geometry.ray_detail;
        }
        let resident = ResidentScene::with_facts(gpu, scene, facts, resident_options)?;
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
            inspector: None,
            inspection: None,
            options,
            frame: 0,
            previous: None,
            origin: FloatingOrigin::default(),
            pending: VecDeque::new(),
            unclaimed: None,
            shown: None,
        })
    }

    /// Sets which optional steps the frame graph takes, from the next frame on.
    pub fn set_switches(&mut self, switches: Switches) {
        self.executor.set_options(ExecuteOptions { switches, ..self.executor.options() });
    }

    /// The options by which frames are executed.
    pub fn execution(&self) -> ExecuteOptions {
        self.executor.options()
    }

    /// Sets the options by which frames are executed, from the next frame on.
    pub fn set_execution(&mut self, options: ExecuteOptions) {
        self.executor.set_options(options);
    }

    /// For tests: the next frame behaves as if the device were lost in this pass.
    #[doc(hidden)]
    pub fn lose_device_in(&mut self, pass: &str) {
        self.executor.lose_device_in(pass);
    }

    /// Starts over: the next frame has the number 0 and no histories. Frames in flight are waited for.
    pub fn restart(&mut self) {
        if let Some(loss) = self.first_loss() {
            self.unclaimed.get_or_insert(loss);
        }
        self.executor.restart();
        self.tracker.clear();
        (self.frame, self.previous, self.origin) = (0, None, FloatingOrigin::default());
    }

    /// Sets the size of the picture from the next frame on. Histories are discarded when a frame of the new size is rendered. If the old size
    /// is restored before that, as after a window was minimised, they are kept.
    pub fn resize(&mut self, width: u32, height: u32) {
        (self.options.width, self.options.height) = (width, height);
    }

    /// Marks a camera cut: the next frame has no histories, and its motion vectors are 0.
    pub fn cut(&mut self) {
        self.executor.cut();
        self.previous = None;
    }

    /// Replaces the implementation of a slot. The new one gets the settings that the configuration has for it.
    ///
    /// # Errors
    /// [`RenderError::Config`] if there is no such slot or implementation, [`RenderError::Stage`] if it cannot be created. The old implementation
    /// is kept in both cases.
    pub fn swap(&mut self, slot: &str, implementation: &str) -> Result<(), RenderError> {
        let mut over = Config::default();
        over.stages.insert(slot.to_owned(), implementation.to_owned());
        self.slots.catalogue().check(&over, "swap").map_err(config_error)?;
        let mut config = self.config.clone();
        config.merge(over);
        self.apply(config)
    }

    /// Sets the configuration from the next frame on. Slots whose implementation and settings do not change keep their histories.
    ///
    /// # Errors
    /// As [`Renderer::swap`], and for invalid settings. Nothing has changed in these cases.
    pub fn configure(&mut self, config: &Config) -> Result<(), RenderError> {
        self.slots.catalogue().check(config, "configure").map_err(config_error)?;
        self.apply(config.clone())
    }

    /// The pipelines that the slots which this configuration changes may need. Made by [`PipelineSet::make`], on another thread while frames
    /// go on, they are no burden to the first frame after [`Renderer::configure`]. What other slots did without before, for want of anybody who
    /// reads it, is made by that frame.
    ///
    /// # Errors
    /// As [`Renderer::configure`].
    pub fn pipelines_of(&self, config: &Config) -> Result<PipelineSet, RenderError> {
        self.slots.catalogue().check(config, "configure").map_err(config_error)?;
        let set = PipelineSet::default();
        self.implementations.rehearse(&Build::new(&self.gpu, self.options.rays).noting(&set), &self.slots, config)?;
        Ok(set)
    }

    fn apply(&mut self, config: Config) -> Result<(), RenderError> {
        self.implementations.configure(&Build::new(&self.gpu, self.options.rays), &self.slots, &config)?;
        self.config = config;
        Ok(())
    }

    /// The needs of the implementation in each slot for the next frame, in the order of the frame.
    pub fn needs(&self) -> Vec<SlotNeeds> {
        self.implementations.needs(self.scene.borrow().facts())
    }

    /// The configuration in use.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The origins of all values that are not finite and that the scan has found. Frames are counted from 0, as in [`magpie::frame::View::frame`].
    pub fn finding_tracker(&self) -> &FindingTracker {
        &self.tracker
    }

    /// Scales the strength of a light of the scene from the next frame on. `factor` is at least 0; 0 switches the light off.
    pub fn scale_light(&mut self, light: u32, factor: f32) {
        self.scene.borrow_mut().scale_light(light, factor);
    }

    /// Writes NaN or infinity into an output of the next frame, to test how they are found and contained.
    pub fn poison(&mut self, poison: Poison) {
        self.poisons.push(poison);
    }

    /// From the next frame on, frames that are read back also include the main image of these slots: visibility of `shadows` (the first group of
    /// lights), openness of `ao`, radiance of `direct`, `gi` and `reflections`, the sum so far of `compose` and `sky`, display values of `post`.
    ///
    /// # Errors
    /// [`RenderError::Config`] if there is no such slot, or it has no image.
    pub fn read_slots(&mut self, slots: &[&str]) -> Result<(), RenderError> {
        let known = Slots::with_images();
        if let Some(slot) = slots.iter().find(|s| !known.contains(s)) {
            let (origin, key, slot) = ("read_slots".to_owned(), (*slot).to_owned(), (*slot).to_owned());
            let suggestion = Suggestion::find(&slot, known.iter().copied());
            let known = known.into_iter().map(str::to_owned).collect();
            return Err(config_error(ConfigError::UnknownSlot { origin, key, slot, known, suggestion }));
        }
        self.read_slots = slots.iter().map(|s| (*s).to_owned()).collect();
        Ok(())
    }

    /// Renders one frame and waits for it. If the size is zero, it does nothing and returns `None`.
    ///
    /// # Errors
    /// [`RenderError::View`] if the requested image does not exist, and errors of the device. With [`RenderOptions::check`], messages of the
    /// validation layers are errors too.
    pub fn frame(&mut self, request: FrameRequest<'_>) -> Result<Option<FrameResult>, RenderError> {
        let Some(ticket) = self.submit(request)? else { return Ok(None) };
        let alone = self.pending.len() == 1;
        let mut result = self.finish(ticket)?;
        if alone {
            result.sample.wait_start_ns = None;
        }
        Ok(Some(result))
    }

    /// Submits one frame and returns while the device works on it. If as many frames as [`RenderOptions::frames_in_flight`] are not finished, it
    /// waits for the oldest of them before it begins. If the size is zero, it does nothing and returns `None`.
    ///
    /// Pictures do not depend on the number of frames in flight, but for one thing: where a pass has met values that are not finite, kept images and
    /// what is derived from the scene are made anew by the first frame that is submitted after this frame was waited for.
    ///
    /// # Errors
    /// As [`Renderer::frame`], and the error of an earlier frame of which nobody has the ticket.
    pub fn submit(&mut self, request: FrameRequest<'_>) -> Result<Option<FrameTicket>, RenderError> {
        self.submit_and(request, None)
    }

    /// [`Renderer::submit`] of a frame to which `add` adds passes once all others are declared: to draw over the picture, or to bring it elsewhere.
    /// Without [`FrameRequest::read_back`] the frame then runs only as far as these passes need it.
    ///
    /// # Errors
    /// As [`Renderer::submit`], and those of `add`.
    pub fn submit_with(
        &mut self,
        request: FrameRequest<'_>,
        add: &mut AddPasses<'_>,
    ) -> Result<Option<FrameTicket>, RenderError> {
        self.submit_and(request, Some(add))
    }

    fn submit_and(
        &mut self,
        request: FrameRequest<'_>,
        add: Option<&mut AddPasses<'_>>,
    ) -> Result<Option<FrameTicket>, RenderError> {
        let most = self.options.frames_in_flight.clamp(1, MOST_IN_FLIGHT) as usize;
        while self.pending.len() >= most {
            let Some(oldest) = self.pending.pop_front() else { break };
            if let Some(loss) = self.retire(oldest) {
                return Err(loss);
            }
        }
        if let Some(error) = self.unclaimed.take() {
            return Err(error);
        }
        self.try_submit(request, add).map_err(|error| {
            self.scene.borrow_mut().forget();
            if is_loss(&error) { self.first_loss().unwrap_or(error) } else { error }
        })
    }

    fn try_submit(
        &mut self,
        request: FrameRequest<'_>,
        add: Option<&mut AddPasses<'_>>,
    ) -> Result<Option<FrameTicket>, RenderError> {
        if self.options.width == 0 || self.options.height == 0 {
            return Ok(None);
        }
        let start = Instant::now();
        let output = Extent::new(self.options.width, self.options.height);
        let needs = self.needs();
        let all = merged(&needs);
        self.scene.borrow_mut().want_lights(&self.gpu, &all)?;
        self.scene.borrow_mut().set_single_scattering(all.single_scattering);
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
            samples_lamps: all.samples_lamps,
        };
        let (cut, origin) = (self.previous.is_none(), self.origin.follow(request.camera));
        self.scene.borrow_mut().set_moment(&Moment { time: request.time, origin, cut });
        let view = desc.declare(&mut self.view, &self.scene.borrow(), &mut g, &mut imports.borrow_mut())?;
        let (scene, camera) = (self.scene.clone(), request.camera.clone());
        let scene = AccelerationIn::Resident { scene, imports: imports.clone(), camera };

        self.poisons.drain(..).for_each(|poison| g.poison(poison));
        request.view.into_iter().for_each(|(pass, output)| g.watch(pass, output));
        self.inspection.iter().for_each(|inspection| g.watch(&inspection.pass, &inspection.output));

        // Observers run after each pass is declared, before later passes overwrite its outputs: the scan, the copy for `request.view`, and the
        // inspection.
        let mut scan = None;
        let mut scanner: Option<Observer> = None;
        if let Some(pipelines) = self.scan {
            let (scanned, observer) = pipelines.observer(&self.gpu, &imports);
            scan = Some(scanned);
            scanner = Some(Box::new(observer));
        }
        let copies = Copies::new(&self.gpu, &imports);
        let mut requested = request.view.filter(|_| request.read_back).map(|(p, o)| (p.to_owned(), o.to_owned()));
        let viewer = copies.clone();
        let lookout = self.lookout(output, &imports);
        let looking = lookout.clone();
        g.observe_passes(move |g, pass| {
            if let Some(scanner) = &mut scanner {
                scanner(g, pass);
            }
            if let Some(lookout) = &looking {
                lookout.see(g, pass);
            }
            if requested.is_some() {
                let found = g
                    .images_of(pass)
                    .into_iter()
                    .find(|p| requested.as_ref() == Some(&(p.pass.clone(), p.output.clone())));
                if let Some(found) = found {
                    requested = None;
                    viewer.copy(g, "view.read_back", found.image);
                }
            }
        });

        let mut slot_copies = None;
        if request.read_back && !self.read_slots.is_empty() {
            let copies = Copies::new(&self.gpu, &imports);
            let has_image = Rc::new(RefCell::new(vec![false; self.read_slots.len()]));
            let requested = self.read_slots.clone();
            let slots =
                SlotCopies { requested: requested.clone(), has_image: has_image.clone(), copies: copies.clone() };
            slot_copies = Some(slots);
            g.observe_slots(move |g, slot, image| {
                if let (Some(at), Some(image)) = (requested.iter().position(|name| name == slot), image) {
                    copies.copy(g, &format!("read_back.{slot}"), image);
                    has_image.borrow_mut()[at] = true;
                }
            });
        }

        let out = frame(&mut self.implementations, &mut g, &view, &all, scene)?;
        let inspecting = lookout.as_ref().map(Lookout::end).transpose()?.flatten();
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
            // The rest of the frame runs also where the picture makes way for an inspected image.
            None if add.is_none() || inspecting.is_some() => g.output(out.display),
            None => {}
        }
        let mut read = NamedCopies { copies: Copies::new(&self.gpu, &imports), names: Vec::new() };
        if let Some(add) = add {
            let inspected = inspecting.as_ref().map(|inspecting| inspecting.image);
            let FrameOut { radiance, display, depth } = out;
            let mut picture = Picture { radiance, display, depth, view, inspected, read };
            add(&mut g, &mut imports.borrow_mut(), &mut picture)?;
            read = picture.read;
        }

        let declare_ns = start.elapsed().as_nanos() as u64;
        let work = self.executor.submit(g, &imports.borrow())?;
        if self.options.check {
            self.gpu.check_validation()?;
        }
        let mut sample = FrameSample { declare_ns, ..FrameSample::default() };
        sample.memory.scene_bytes = self.scene.borrow().scene_bytes();
        sample.memory.acceleration_bytes = self.scene.borrow().acceleration_bytes();
        sample.acceleration = self.scene.borrow().acceleration();
        let known = FrameResult {
            frame: self.frame,
            sample,
            images: None,
            slots: Vec::new(),
            copied: Vec::new(),
            inspected: None,
            findings: Vec::new(),
            needs,
            declaration: work.declaration.clone(),
            plan: work.plan.clone(),
        };
        let ticket = FrameTicket { frame: self.frame, done: work.done(), result: Outcome::default() };
        let outcome = ticket.result.clone();
        self.pending.push_back(Pending { work, known, scan, copies, read, inspecting, slots: slot_copies, outcome });
        self.previous = Some(Previous { camera: request.camera.clone(), extent, output, jitter });
        self.frame += 1;
        Ok(Some(ticket))
    }
}

fn config_error(error: ConfigError) -> RenderError {
    RenderError::Config(Box::new(error))
}
