//! Helpers that assemble a scene.
use super::shapes::Shape;
use crate::scene::{Animation, Camera, Channel, Instance, Interpolation, Local, Material, Mesh, Node, Property, Scene};
use glam::{Affine3A, DAffine3, Quat, Vec3, Vec4};
use std::f32::consts::TAU;

/// A scene under construction.
pub(super) struct Stage {
    pub scene: Scene,
}

/// Times of an animation channel, and the values at them.
pub(super) struct Keyframes {
    pub times: Vec<f32>,
    pub values: Vec<f32>,
}

/// Keys of a cubic spline through `f` of the share of a loop of this many seconds, with tangents from its slope; `keys` keys per loop.
pub(super) fn smooth<const N: usize>(seconds: f32, keys: usize, f: impl Fn(f32) -> [f32; N]) -> Keyframes {
    const STEP: f32 = 1.0 / 256.0;
    let (mut times, mut values) = (Vec::new(), Vec::new());
    for key in 0..=keys {
        let t = key as f32 / keys as f32;
        let (before, after) = (f(t - STEP), f(t + STEP));
        let slope: [f32; N] = std::array::from_fn(|c| (after[c] - before[c]) / (2.0 * STEP * seconds));
        times.push(t * seconds);
        values.extend(slope.into_iter().chain(f(t)).chain(slope));
    }
    Keyframes { times, values }
}

/// Linear keys of `f`; `keys` keys per loop.
pub(super) fn sampled<const N: usize>(seconds: f32, keys: usize, f: impl Fn(f32) -> [f32; N]) -> Keyframes {
    let at = |key| key as f32 / keys as f32;
    let times = (0..=keys).map(|k| at(k) * seconds).collect();
    Keyframes { times, values: (0..=keys).flat_map(|k| f(at(k))).collect() }
}

/// Height of a sine wave, with its position given in turns.
pub(super) fn wave(turns: f32, phase: f32) -> f32 {
    (TAU * (turns + phase)).sin()
}

/// A matte material with an albedo.
pub(super) fn matte(name: &str, colour: [f32; 3]) -> Material {
    dielectric(name, colour, 0.9)
}

/// A dielectric material.
pub(super) fn dielectric(name: &str, colour: [f32; 3], roughness: f32) -> Material {
    Material {
        name: name.to_owned(),
        base_colour: Vec3::from(colour).extend(1.0),
        metalness: 0.0,
        roughness,
        ..Material::default()
    }
}

/// A metal, with its reflectance at normal incidence.
pub(super) fn metal(name: &str, colour: [f32; 3], roughness: f32) -> Material {
    Material { metalness: 1.0, ..dielectric(name, colour, roughness) }
}

/// A translation and a rotation about y.
pub(super) fn at(x: f32, y: f32, z: f32, turn_degrees: f32) -> Affine3A {
    Affine3A::from_rotation_translation(Quat::from_rotation_y(turn_degrees.to_radians()), Vec3::new(x, y, z))
}

/// A translation, a rotation about y, and a scale.
pub(super) fn scaled(x: f32, y: f32, z: f32, turn_degrees: f32, scale: f32) -> Affine3A {
    at(x, y, z, turn_degrees) * Affine3A::from_scale(Vec3::splat(scale))
}

/// Completes a shape to a mesh, with all vertex tables.
pub(super) fn finish(name: &str, shape: Shape) -> Mesh {
    let mut mesh = shape.mesh;
    mesh.name = name.to_owned();
    mesh.uv1 = mesh.uv0.clone();
    mesh.colours = vec![Vec4::ONE; mesh.positions.len()];
    mesh.make_tangents(false);
    mesh
}

impl Stage {
    pub fn new(name: &str) -> Self {
        Self { scene: Scene { name: name.to_owned(), ..Scene::default() } }
    }

    pub fn material(&mut self, material: Material) -> u32 {
        self.scene.materials.push(material);
        self.scene.materials.len() as u32 - 1
    }

    pub fn mesh(&mut self, name: &str, shape: Shape) -> u32 {
        let mesh = finish(name, shape);
        self.scene.meshes.push(mesh);
        self.scene.meshes.len() as u32 - 1
    }

    pub fn put(&mut self, mesh: u32, material: u32, world_from_object: Affine3A) {
        let name = self.scene.meshes[mesh as usize].name.clone();
        self.scene.instances.push(Instance::fixed(name, mesh, material, world_from_object));
    }

    /// Adds a mesh with one instance.
    pub fn add(&mut self, name: &str, shape: Shape, material: u32, world_from_object: Affine3A) {
        let mesh = self.mesh(name, shape);
        self.put(mesh, material, world_from_object);
    }

    /// Adds a camera; the numbers must be valid.
    pub fn camera(&mut self, name: &str, eye: [f32; 3], target: [f32; 3], fov_degrees: f32) {
        let camera = Camera::look_at(name, Vec3::from(eye), Vec3::from(target), Vec3::Y, fov_degrees.to_radians());
        self.scene.cameras.extend(camera.map(|c| Camera { near: 0.05, ..c }));
    }

    /// Adds an animation without channels.
    pub fn animation(&mut self, name: &str) {
        self.scene.animations.push(Animation { name: name.to_owned(), ..Animation::default() });
    }

    pub fn node(&mut self, name: &str, parent: Option<u32>, local: Local) -> u32 {
        self.scene.nodes.push(Node { name: name.to_owned(), parent, local, weights: Vec::new() });
        self.scene.nodes.len() as u32 - 1
    }

    /// World-from-node transform in the rest pose.
    pub fn world(&self, node: u32) -> DAffine3 {
        let Node { parent, local, .. } = &self.scene.nodes[node as usize];
        parent.map_or(local.affine(), |parent| self.world(parent) * local.affine())
    }

    /// Adds a channel to the last animation; `times` are in seconds.
    pub fn channel(&mut self, node: u32, property: Property, interpolation: Interpolation, keyframes: Keyframes) {
        let Keyframes { times, values } = keyframes;
        if let Some(animation) = self.scene.animations.last_mut() {
            animation.duration = times.last().map_or(animation.duration, |t| animation.duration.max(f64::from(*t)));
            animation.channels.push(Channel { node, property, interpolation, times, values });
        }
    }

    /// Adds an instance of a mesh at a node.
    pub fn put_on(&mut self, mesh: u32, material: u32, node: u32) {
        self.put(mesh, material, Affine3A::IDENTITY);
        let world_from_object = self.world(node);
        if let Some(instance) = self.scene.instances.last_mut() {
            (instance.world_from_object, instance.node) = (world_from_object, Some(node));
        }
    }

    /// Adds a mesh with one instance at a node.
    pub fn hang(&mut self, name: &str, shape: Shape, material: u32, node: u32) {
        let mesh = self.mesh(name, shape);
        self.put_on(mesh, material, node);
    }
}
