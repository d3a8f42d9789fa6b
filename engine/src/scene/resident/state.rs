//! The part of the scene that may change every frame: transforms of instances and lights, in one buffer behind the scene's root table.
use super::block::Block;
use super::rounding::{Shape, rounding};
use super::tables::{light, rows};
use crate::gpu::{Buffer, BufferUse, Gpu, GpuError, Staging};
use crate::graph::execute::Imports;
use crate::graph::{Access, Buffer as GraphBuffer, BufferDesc, FrameGraph, Handle, Queue, Record};
use crate::ray::{Bounds, object_from_world};
use crate::scene::{Animator, Light, Pose, single};
use glam::{Affine3A, DAffine3, DVec3};
use magpie_shaders::Address;
use magpie_shaders::scene as shared;
use std::ops::Range;
use std::sync::Arc;

/// The time that a frame shows, and the origin of its coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moment {
    /// Scene time, seconds; animations loop.
    pub time: f64,
    /// The world point that is the origin on the device, metres. It should be near the camera, to keep precision there; see
    /// [`FloatingOrigin`](crate::scene::FloatingOrigin).
    pub origin: DVec3,
    /// Whether this frame is unrelated to the previous one. Instances then have no motion in it.
    pub cut: bool,
}

/// Transforms in the current and in the previous frame.
pub(super) struct State {
    animator: Animator,
    pub pose: Pose,
    previous: Vec<DAffine3>,
    /// For each instance, the number of the call to [`Self::set_moment`] at which it last moved or changed its shape.
    pub changed: Vec<u64>,
    moments: u64,
    /// For each light that moves, in order, whether it did in the last call to [`Self::set_moment`].
    moved_lights: Vec<bool>,
    /// Rises whenever a light moves or is dimmed.
    pub lights_changed: u64,
    pub origin: DVec3,
    /// Factor on the intensity of each light.
    factors: Vec<f32>,
    /// The factors of the previous frame, and the lights that move as they were in it.
    previous_factors: Vec<f32>,
    previous_moving: Vec<Light>,
    /// Whether the tables on the device are out of date, and whether also lights that do not move are.
    stale: bool,
    all_lights_stale: bool,
    root: shared::Scene,
    /// The constant fields of each instance: mesh, material, mask and flags.
    fixed: Vec<shared::Instance>,
    /// Extent of each instance's mesh, for instances that do not deform.
    shapes: Vec<Shape>,
    pub memory: Arc<Buffer>,
    staging: Staging,
    instances: u64,
    lights: u64,
    lights_before: u64,
}

impl State {
    /// Allocates the tables. The addresses in `root` that point to them are filled in here.
    pub fn new(
        gpu: &Gpu,
        animator: Animator,
        mut fixed: Vec<shared::Instance>,
        shapes: Vec<Shape>,
        mut root: shared::Scene,
    ) -> Result<Self, GpuError> {
        let pose = animator.pose(0.0);
        for (_, instance) in fixed.iter_mut().enumerate().filter(|(i, _)| animator.moves(*i)) {
            instance.flags |= shared::INSTANCE_MOVES;
        }
        let mut block = Block::default();
        block.add(&[shared::Scene::default()]);
        let instances = block.add(&fixed);
        let lights = block.add(&vec![shared::Light::default(); pose.lights.len()]);
        let lights_before = block.add(&vec![shared::Light::default(); pose.lights.len()]);
        let memory = block.buffer(gpu, "scene state", BufferUse::Storage)?;
        root.instances = memory.address().offset(instances);
        root.lights = memory.address().offset(lights);
        root.previous_lights = memory.address().offset(lights_before);
        root.instance_count = fixed.len() as u32;
        root.light_count = pose.lights.len() as u32;
        let moving = animator.moving_lights().iter();
        let previous_moving = moving.map(|i| pose.lights[*i as usize].clone()).collect();
        Ok(Self {
            animator,
            previous: pose.instances.clone(),
            changed: vec![0; pose.instances.len()],
            moved_lights: Vec::new(),
            lights_changed: 0,
            moments: 0,
            factors: vec![1.0; pose.lights.len()],
            previous_factors: vec![1.0; pose.lights.len()],
            previous_moving,
            pose,
            origin: DVec3::ZERO,
            stale: true,
            all_lights_stale: true,
            root,
            fixed,
            shapes,
            memory,
            staging: Staging::new(gpu, "scene state"),
            instances,
            lights,
            lights_before,
        })
    }

    /// Address of the root table.
    pub fn root(&self) -> Address {
        self.memory.address()
    }

    /// Whether the scene is animated.
    pub fn is_animated(&self) -> bool {
        self.animator.is_animated()
    }

    /// Moves the scene to another time and origin. Returns whether anything changed for ray tracing.
    pub fn set_moment(&mut self, moment: &Moment) -> bool {
        let shifted = self.origin != moment.origin;
        self.origin = moment.origin;
        self.stale |= shifted;
        self.all_lights_stale |= shifted;
        if !self.animator.is_animated() {
            return shifted;
        }
        // An animated scene is always written, even if it pauses, so that the previous transforms become equal to the current ones.
        self.stale = true;
        let moving = self.animator.moving_lights();
        let lights_before: Vec<_> = moving.iter().map(|i| self.pose.lights[*i as usize].clone()).collect();
        let lights = std::mem::take(&mut self.pose.lights);
        let pose = self.animator.pose_with(moment.time, lights);
        let before = std::mem::replace(&mut self.pose, pose);
        self.moments += 1;
        let now = &self.pose;
        for (i, changed) in self.changed.iter_mut().enumerate() {
            let stays = before.instances[i] == now.instances[i];
            if !(stays && before.joints[i] == now.joints[i] && before.weights[i] == now.weights[i]) {
                *changed = self.moments;
            }
        }
        let changes = |(before, i): (&Light, &u32)| *before != now.lights[*i as usize];
        let moved: Vec<bool> = lights_before.iter().zip(moving).map(changes).collect();
        self.lights_changed += u64::from(moved.contains(&true));
        self.moved_lights = moved.into_iter().map(|moved| moved && !moment.cut).collect();
        let before = before.instances;
        let changed = before != self.pose.instances;
        self.previous = if moment.cut { self.pose.instances.clone() } else { before };
        shifted || changed
    }

    /// A light in the format of shaders.
    pub fn light(&self, index: usize) -> shared::Light {
        self.dimmed(&self.pose.lights[index], self.factors[index])
    }

    /// The same as it was in the previous frame, relative to the origin of this one.
    fn previous_light(&self, index: usize) -> shared::Light {
        let moving = self.animator.moving_lights().binary_search(&(index as u32)).ok();
        let of = moving.map_or(&self.pose.lights[index], |at| &self.previous_moving[at]);
        self.dimmed(of, self.previous_factors[index])
    }

    /// Notes the lights for the next frame, which writes all of them if any was dimmed since the one before.
    fn keep_lights(&mut self) {
        let dimmed = self.previous_factors != self.factors;
        self.stale |= dimmed;
        self.all_lights_stale |= dimmed;
        self.previous_factors.clone_from(&self.factors);
        for (kept, index) in self.previous_moving.iter_mut().zip(self.animator.moving_lights()) {
            kept.clone_from(&self.pose.lights[*index as usize]);
        }
    }

    fn dimmed(&self, of: &Light, factor: f32) -> shared::Light {
        let placed = light(of, self.origin);
        shared::Light { intensity: placed.intensity.map(|x| x * factor), ..placed }
    }

    /// The same at full strength.
    pub fn undimmed_light(&self, index: usize) -> shared::Light {
        light(&self.pose.lights[index], self.origin)
    }

    /// Whether a light moved in the last call to [`Self::set_moment`].
    pub fn light_moved(&self, index: usize) -> bool {
        let at = self.animator.moving_lights().binary_search(&(index as u32));
        at.ok().and_then(|at| self.moved_lights.get(at)).copied().unwrap_or(false)
    }

    /// Scales the intensity of a light by a factor, from the next frame on. Ignored if the light does not exist.
    pub fn scale_light(&mut self, light: usize, factor: f32) {
        if let Some(known) = self.factors.get_mut(light) {
            self.stale |= *known != factor;
            self.lights_changed += u64::from(*known != factor);
            self.all_lights_stale |= *known != factor;
            *known = factor;
        }
    }

    /// Sets the table of the specular lobe's albedo, from the next frame on.
    pub fn set_lobe_albedo(&mut self, table: Address) {
        self.stale |= self.root.lobe_albedo != table;
        self.root.lobe_albedo = table;
    }

    /// Discards the state of the device: the next frame writes the tables.
    pub fn forget(&mut self) {
        self.stale = true;
        self.all_lights_stale = true;
    }

    /// The lights to write: all, or from the first that moves to the last.
    fn stale_lights(&mut self) -> Range<usize> {
        if std::mem::take(&mut self.all_lights_stale) {
            return 0..self.pose.lights.len();
        }
        match self.animator.moving_lights() {
            [first, .., last] => *first as usize..*last as usize + 1,
            [only] => *only as usize..*only as usize + 1,
            [] => 0..0,
        }
    }

    /// World-from-object transform of an instance, relative to the origin.
    pub fn placed(&self, instance: usize) -> Affine3A {
        single(&shift(&self.pose.instances[instance], self.origin))
    }

    /// An instance in the format of shaders.
    pub fn instance(&self, index: usize) -> shared::Instance {
        let world_from_object = self.placed(index);
        // Instances with a singular transform are not traced.
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

    /// Imports the tables into a frame, with a pass that copies them if they have changed.
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
        let range = self.stale_lights();
        let lights: Vec<_> = range.clone().map(|i| self.light(i)).collect();
        let from_light = block.add(&lights);
        let before: Vec<_> = range.clone().map(|i| self.previous_light(i)).collect();
        let from_before = block.add(&before);
        debug_assert_eq!(from_light, self.lights, "places in the tables");
        self.keep_lights();
        let staged = imports.buffer(self.staging.write(&block.0)?);
        let length = block.0.len() as u64;
        let light_bytes = size_of_val(&lights[..]) as u64;
        let skipped = (range.start * size_of::<shared::Light>()) as u64;
        let (to_light, to_before) = (self.lights + skipped, self.lights_before + skipped);
        let staged = g.import_buffer("scene.staged", BufferDesc::new(length), Access::CopyRead, staged);
        let state = g.pass("scene.update", Queue::Graphics, |p| {
            let from = p.copy_from(staged.read());
            let (state, to) = p.copy_to(state);
            (state, move |c: &mut Record<'_>| {
                c.copy_buffer(from, 0, to, 0, from_light);
                if length > from_light {
                    c.copy_buffer(from, from_light, to, to_light, light_bytes);
                    c.copy_buffer(from, from_before, to, to_before, light_bytes);
                }
            })
        });
        Ok(state.read())
    }
}

/// A transform relative to another origin.
pub(super) fn shift(world: &DAffine3, origin: DVec3) -> DAffine3 {
    DAffine3 { matrix3: world.matrix3, translation: world.translation - origin }
}
