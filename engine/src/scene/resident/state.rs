//! What may change from frame to frame: where instances and lights are. The device has it in one buffer, behind the scene's root.
use super::block::Block;
use super::rounding::{Shape, rounding};
use super::tables::{light, rows};
use crate::gpu::{Buffer, BufferUse, Gpu, GpuError, Staging};
use crate::graph::execute::Imports;
use crate::graph::{Access, Buffer as GraphBuffer, BufferDesc, FrameGraph, Handle, Queue, Record};
use crate::ray::{Bounds, object_from_world};
use crate::scene::{Animator, Pose, single};
use glam::{Affine3A, DAffine3, DVec3};
use magpie_shaders::Address;
use magpie_shaders::scene as shared;
use std::sync::Arc;

/// Which moment a frame shows, and from where numbers are counted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moment {
    /// Seconds since the scene began.
    pub time: f64,
    /// The world point that is the origin on the device: near the eye, so that what is near keeps its digits. Metres.
    pub origin: DVec3,
    /// This frame has nothing to do with the one before: nothing moves in it.
    pub cut: bool,
}

/// Where everything is, in the frame at hand and one frame before.
pub(super) struct State {
    animator: Animator,
    pub pose: Pose,
    previous: Vec<DAffine3>,
    /// Of each instance, the count of moments at which it moved or changed its shape last.
    pub changed: Vec<u64>,
    moments: u64,
    /// Of each light, whether it moved with the newest moment.
    moved_lights: Vec<bool>,
    pub origin: DVec3,
    /// What the strength of each light is multiplied with.
    factors: Vec<f32>,
    /// What the device has is not what the frame needs.
    stale: bool,
    root: shared::Scene,
    /// Mesh, material, mask and flags of each instance.
    fixed: Vec<shared::Instance>,
    /// Those of the mesh of each, where it does not deform.
    shapes: Vec<Shape>,
    pub memory: Arc<Buffer>,
    staging: Staging,
    instances: u64,
    lights: u64,
}

impl State {
    /// Room for the tables. `root` lacks the addresses that are made here.
    pub fn new(
        gpu: &Gpu,
        animator: Animator,
        fixed: Vec<shared::Instance>,
        shapes: Vec<Shape>,
        mut root: shared::Scene,
    ) -> Result<Self, GpuError> {
        let pose = animator.pose(0.0);
        let mut block = Block::default();
        block.add(&[shared::Scene::default()]);
        let instances = block.add(&fixed);
        let lights = block.add(&vec![shared::Light::default(); pose.lights.len()]);
        let memory = block.buffer(gpu, "scene state", BufferUse::Storage)?;
        root.instances = memory.address().offset(instances);
        root.lights = memory.address().offset(lights);
        root.instance_count = fixed.len() as u32;
        root.light_count = pose.lights.len() as u32;
        Ok(Self {
            animator,
            previous: pose.instances.clone(),
            changed: vec![0; pose.instances.len()],
            moved_lights: Vec::new(),
            moments: 0,
            factors: vec![1.0; pose.lights.len()],
            pose,
            origin: DVec3::ZERO,
            stale: true,
            root,
            fixed,
            shapes,
            memory,
            staging: Staging::new(gpu, "scene state"),
            instances,
            lights,
        })
    }

    /// Address of the root.
    pub fn root(&self) -> Address {
        self.memory.address()
    }

    /// Whether anything ever moves.
    pub fn is_animated(&self) -> bool {
        self.animator.is_animated()
    }

    /// Goes to another moment. Says whether what rays see has changed.
    pub fn go(&mut self, moment: &Moment) -> bool {
        let shifted = self.origin != moment.origin;
        self.origin = moment.origin;
        self.stale |= shifted;
        if !self.animator.is_animated() {
            return shifted;
        }
        // What moves is written anew even where it pauses: then nothing is in motion.
        self.stale = true;
        let pose = self.animator.pose(moment.time);
        let before = std::mem::replace(&mut self.pose, pose);
        self.moments += 1;
        let now = &self.pose;
        for (i, changed) in self.changed.iter_mut().enumerate() {
            let stays = before.instances[i] == now.instances[i];
            if !(stays && before.joints[i] == now.joints[i] && before.weights[i] == now.weights[i]) {
                *changed = self.moments;
            }
        }
        self.moved_lights = before.lights.iter().zip(&now.lights).map(|(before, now)| before != now).collect();
        let before = before.instances;
        let changed = before != self.pose.instances;
        self.previous = if moment.cut { self.pose.instances.clone() } else { before };
        shifted || changed
    }

    /// A light as shaders read it.
    pub fn light(&self, index: usize) -> shared::Light {
        let placed = light(&self.pose.lights[index], self.origin);
        shared::Light { intensity: placed.intensity.map(|x| x * self.factors[index]), ..placed }
    }

    /// Whether a light is not where it was in the moment before.
    pub fn light_moved(&self, index: usize) -> bool {
        self.moved_lights.get(index).copied().unwrap_or(false)
    }

    /// Multiplies the strength of a light, from the next frame on. Nothing where there is no such light.
    pub fn dim(&mut self, light: usize, factor: f32) {
        if let Some(known) = self.factors.get_mut(light) {
            self.stale |= *known != factor;
            *known = factor;
        }
    }

    /// What the device has is unknown: the tables are written with the next frame.
    pub fn forget(&mut self) {
        self.stale = true;
    }

    /// World from object of an instance, counted from the origin.
    pub fn placed(&self, instance: usize) -> Affine3A {
        single(&shift(&self.pose.instances[instance], self.origin))
    }

    /// An instance as shaders read it.
    pub fn instance(&self, index: usize) -> shared::Instance {
        let world_from_object = self.placed(index);
        // One whose transform is singular has no inside to trace.
        let inverse = object_from_world(&world_from_object).unwrap_or(Affine3A::ZERO);
        let shape = self.shapes[index];
        let shape = self.pose.bounds[index].map_or(shape, |[min, max]| Shape { bounds: Bounds { min, max }, ..shape });
        shared::Instance {
            world_from_object: rows(&world_from_object),
            object_from_world: rows(&inverse),
            previous_world_from_object: rows(&single(&shift(&self.previous[index], self.origin))),
            rounding: rounding(&world_from_object, &inverse, &shape),
            ..self.fixed[index]
        }
    }

    /// Brings the tables into a frame; where they have changed, with a pass that copies them.
    pub fn declare(&mut self, g: &mut FrameGraph, imports: &mut Imports) -> Result<Handle<GraphBuffer>, GpuError> {
        let bytes = self.memory.bytes();
        let state =
            g.import_buffer("scene.state", BufferDesc::new(bytes), Access::BufferRead, imports.buffer(&self.memory));
        if !std::mem::take(&mut self.stale) {
            return Ok(state.read());
        }
        let mut block = Block::default();
        block.add(&[self.root]);
        let instances: Vec<_> = (0..self.fixed.len()).map(|i| self.instance(i)).collect();
        let at = block.add(&instances);
        debug_assert_eq!(at, self.instances, "places in the tables");
        let lights: Vec<_> = (0..self.pose.lights.len()).map(|i| self.light(i)).collect();
        let at = block.add(&lights);
        debug_assert_eq!(at, self.lights, "places in the tables");
        let staged = imports.buffer(self.staging.write(&block.0)?);
        let length = block.0.len() as u64;
        let staged = g.import_buffer("scene.staged", BufferDesc::new(length), Access::CopyRead, staged);
        let state = g.pass("scene.update", Queue::Graphics, |p| {
            let from = p.copy_from(staged.read());
            let (state, to) = p.copy_to(state);
            (state, move |c: &mut Record<'_>| c.copy_buffer(from, 0, to, 0, length))
        });
        Ok(state.read())
    }
}

/// A transform counted from another origin.
pub(super) fn shift(world: &DAffine3, origin: DVec3) -> DAffine3 {
    DAffine3 { matrix3: world.matrix3, translation: world.translation - origin }
}
