//! Plans a frame without a device: which passes run, which effects are idle and why, and how much memory it takes.
use crate::contracts::AccelerationIn;
use crate::frame::frame;
use crate::sampling::Sampling;
use crate::slots::{Frame, Slots, merged};
use magpie::config::Config;
use magpie::frame::{PreviousView, ViewDesc};
use magpie::gpu::Pipelines;
use magpie::graph::plan::{Packed, plan};
use magpie::graph::{Declaration, Extent, FrameGraph, GraphErrors, Plan, Queues, Switches};
use magpie::measure::{SlotReport, slot_reports};
use magpie::scene::{Camera, ResidentError, Scene, SceneFacts, SceneSketch};
use magpie::slot::{Build, SlotError};
use magpie_shaders::Rays;
use std::rc::Rc;
use std::sync::Arc;

/// A planned frame.
#[derive(Debug)]
pub struct FramePlan {
    /// Facts about the scene that decide what runs.
    pub facts: Arc<SceneFacts>,
    /// The passes that run in each slot, and why others are idle, in the order of the frame.
    pub slots: Vec<SlotReport>,
    /// The declared passes and resources.
    pub declaration: Declaration,
    /// Order, memory and barriers. Sizes in memory are padded to 256 bytes, as no device is asked.
    pub plan: Plan,
}

/// Why a frame could not be planned.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// An implementation could not be created, or needs a device.
    #[error(transparent)]
    Slot(#[from] SlotError),
    /// The scene could not be declared.
    #[error(transparent)]
    Scene(#[from] ResidentError),
    /// The declaration of the frame has errors.
    #[error(transparent)]
    Declaration(#[from] GraphErrors),
}

/// Plans a frame of a static scene as it would run on a device with a graphics queue only. `output` is the size of the picture, pixels.
///
/// # Errors
/// [`PlanError`].
pub fn plan_frame(
    scene: &Scene,
    camera: &Camera,
    slots: &Slots,
    config: &Config,
    rays: Rays,
    output: Extent,
) -> Result<FramePlan, PlanError> {
    let pipelines = Pipelines::default();
    let mut implementations = Frame::new(&Build::without_device(&pipelines, rays), slots, config)?;
    let facts = Arc::new(SceneFacts::new(scene));
    let needs = implementations.needs(&facts);
    let all = merged(&needs);
    let sampling = Sampling::of(&all);
    let (extent, jitter) = (sampling.extent(output), sampling.jitter(0));
    let sketch = SceneSketch::new(scene, facts.clone(), camera, &all);
    let mut g = FrameGraph::new(extent);
    let previous = PreviousView { camera, extent, output, jitter };
    let desc = ViewDesc {
        camera,
        extent,
        output,
        jitter,
        frame: 1,
        seed: 0,
        previous: Some(previous),
        samples_lamps: all.samples_lamps,
    };
    let view = desc.sketch(&sketch, &mut g);
    let out = frame(&mut implementations, &mut g, &view, &all, AccelerationIn::Sketch(Rc::new(sketch)))?;
    g.output(out.display);
    let declaration = g.finish()?.declaration;
    let plan = plan(&declaration, &Switches::default(), Queues::default(), &mut Packed);
    Ok(FramePlan { facts, slots: slot_reports(&needs, &declaration, &plan), declaration, plan })
}
