//! A frame that is planned without a device: what runs in it, what is idle and why, and what memory it takes.
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

/// A frame that was planned.
#[derive(Debug)]
pub struct FramePlan {
    /// What the scene is made of.
    pub facts: Arc<SceneFacts>,
    /// What runs in each slot, in the order of the frame.
    pub slots: Vec<SlotReport>,
    /// What was declared.
    pub declaration: Declaration,
    /// How it would run, with everything padded to 256 bytes.
    pub plan: Plan,
}

/// Why a frame could not be planned.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// An implementation could not be made, or needs a device.
    #[error(transparent)]
    Slot(#[from] SlotError),
    /// The scene could not be brought into the frame.
    #[error(transparent)]
    Scene(#[from] ResidentError),
    /// The frame was declared with mistakes.
    #[error(transparent)]
    Declaration(#[from] GraphErrors),
}

/// Plans a frame of a scene at rest as it would run on a device with the graphics queue alone. `output`: pixels of the picture.
///
/// # Errors
/// [`PlanError`].
pub fn plan_frame(
    scene: &Scene,
    camera: &Camera,
    (slots, config): (&Slots, &Config),
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
    let desc = ViewDesc { camera, extent, output, jitter, frame: 1, seed: 0, previous: Some(previous) };
    let view = desc.sketch(&sketch, &mut g);
    let out = frame(&mut implementations, &mut g, &view, &all, AccelerationIn::Sketch(Rc::new(sketch)))?;
    g.output(out.display);
    let declaration = g.finish()?.declaration;
    let plan = plan(&declaration, &Switches::default(), Queues::default(), &mut Packed);
    Ok(FramePlan { facts, slots: slot_reports(&needs, &declaration, &plan), declaration, plan })
}
