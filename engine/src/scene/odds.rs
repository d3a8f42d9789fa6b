//! How often what shines is sampled: by power, as alias tables. Any positive odds are unbiased; good ones are less noisy.
use super::{Animator, Material, Mesh, Pose, Scene, Texture, deform};
use glam::{DVec3, Vec2, Vec3};
use magpie_shaders::reference::{CHOICE_EMITTER, LightChoice, NO_EMITTER};
use std::f64::consts::PI;

/// Share of the odds that is spread evenly, so that nothing that shines is never sampled.
pub const EVEN: f64 = 0.05;
/// Points of a triangle at which its emission is looked up.
const LOOK_UPS: u32 = 4;

/// Emissive triangles and spheres, and how often each is sampled. The odds are those of the rest pose; what stretches later is sampled too
/// often or too rarely, which is noise and no error.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Emitters {
    /// The alias table.
    pub choices: Vec<LightChoice>,
    /// Of each instance where its own begin in the table, or [`NO_EMITTER`].
    pub first: Vec<u32>,
}

impl Emitters {
    /// Those of a scene; `None` where nothing emits but what shows a light.
    pub fn new(scene: &Scene) -> Option<Self> {
        if !scene.instances.iter().any(|i| emits(&scene.materials[i.material as usize])) {
            return None;
        }
        let pose = Animator::new(scene).pose(0.0);
        let mut weighed = Vec::new();
        let first = (0..scene.instances.len()).map(|i| add_emitters(scene, &pose, i, &mut weighed)).collect();
        let choices = alias_table(weighed);
        (!choices.is_empty()).then_some(Self { choices, first })
    }
}

/// Whether a surface of this material lights others. What shows a light does not: the light does.
pub fn emits(material: &Material) -> bool {
    material.emission != Vec3::ZERO && !material.shows_light && !material.unlit
}

/// Of linear Rec.709.
pub fn luminance(c: Vec3) -> f64 {
    c.as_dvec3().dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

/// Adds the triangles or spheres of an instance that emits, each with its power; gives where they begin, or [`NO_EMITTER`].
pub fn add_emitters(scene: &Scene, pose: &Pose, instance: usize, near: &mut Vec<(f64, LightChoice)>) -> u32 {
    let shown = &scene.instances[instance];
    let (mesh, material) = (&scene.meshes[shown.mesh as usize], &scene.materials[shown.material as usize]);
    if !emits(material) {
        return NO_EMITTER;
    }
    let first = near.len() as u32;
    let world = &pose.instances[instance];
    let sides = if material.double_sided { 2.0 } else { 1.0 };
    let mut push = |power: f64| {
        let primitive = near.len() as u32 - first;
        near.push((
            power,
            LightChoice { light: CHOICE_EMITTER, instance: instance as u32, primitive, ..Default::default() },
        ));
    };
    for sphere in &mesh.spheres {
        let radius = f64::from(sphere.radius) * world.matrix3.determinant().abs().cbrt();
        push(4.0 * PI * PI * radius * radius * luminance(material.emission));
    }
    let deformed =
        pose.bounds[instance].map(|_| deform(mesh, &pose.joints[instance], &pose.weights[instance]).positions);
    let positions = deformed.as_deref().unwrap_or(&mesh.positions);
    for corners in mesh.indices.chunks_exact(3) {
        let [a, b, c] = [0, 1, 2].map(|k| world.transform_point3(positions[corners[k] as usize].as_dvec3()));
        let area = 0.5 * (b - a).cross(c - a).length();
        push(PI * sides * area * emission(scene, material, mesh, corners));
    }
    first
}

/// The weight of what a triangle emits: its mean, and a little of what it might emit.
fn emission(scene: &Scene, material: &Material, mesh: &Mesh, corners: &[u32]) -> f64 {
    let full = luminance(material.emission);
    share_of_texture(scene, material, mesh, corners).map_or(full, |share| full * (EVEN + (1.0 - EVEN) * share))
}

/// Mean luminance that a triangle emits, roughly: factor times texture.
pub fn mean_emission(scene: &Scene, material: &Material, mesh: &Mesh, corners: &[u32]) -> f64 {
    luminance(material.emission) * share_of_texture(scene, material, mesh, corners).unwrap_or(1.0)
}

/// Mean luminance of the texture of emission on a triangle.
fn share_of_texture(scene: &Scene, material: &Material, mesh: &Mesh, corners: &[u32]) -> Option<f64> {
    let used = material.emission_texture?;
    let texture = scene.textures.get(used.texture as usize)?;
    let uvs = if used.uv_set == 0 { &mesh.uv0 } else { &mesh.uv1 };
    let mut sum = 0.0;
    for i in 0..LOOK_UPS * LOOK_UPS {
        // A regular pattern in the square, folded into the triangle.
        let [x, y] = [i % LOOK_UPS, i / LOOK_UPS].map(|k| (k as f32 + 0.5) / LOOK_UPS as f32);
        let root = x.sqrt();
        let weights = [1.0 - root, root * (1.0 - y), root * y];
        let uv: Vec2 = (0..3).map(|k| uvs[corners[k] as usize] * weights[k]).sum();
        let place = uv.extend(1.0);
        sum += luminance(texel(texture, Vec2::new(used.rows[0].dot(place), used.rows[1].dot(place))));
    }
    Some(sum / f64::from(LOOK_UPS * LOOK_UPS))
}

/// The texel there, tiled, of a mip that is small enough for few look-ups to see it all.
fn texel(texture: &Texture, uv: Vec2) -> Vec3 {
    let mip = texture.mips.len().saturating_sub(7);
    let [width, height] = texture.mip_size(mip);
    let at = |x: f32, n: u32| ((x.rem_euclid(1.0) * n as f32) as usize).min(n as usize - 1);
    let first = 4 * (at(uv.y, height) * width as usize + at(uv.x, width));
    let channel = |k: usize| {
        let x = f32::from(texture.mips[mip][first + k]) / 255.0;
        if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
    };
    Vec3::new(channel(0), channel(1), channel(2))
}

/// Fills in thresholds, aliases and probabilities (Vose 1991, "A Linear Algorithm for Generating Random Numbers with a Given
/// Distribution"). Where no weight is above 0, nothing is left to choose.
pub fn alias_table(entries: Vec<(f64, LightChoice)>) -> Vec<LightChoice> {
    let sum: f64 = entries.iter().map(|(weight, _)| weight).sum();
    if sum <= 0.0 {
        return Vec::new();
    }
    let n = entries.len() as f64;
    let mut shares: Vec<f64> = entries.iter().map(|(weight, _)| weight / sum * n).collect();
    let mut table: Vec<LightChoice> = entries
        .iter()
        .zip(0..)
        .map(|((weight, choice), own)| LightChoice {
            threshold: 1.0,
            alias: own,
            probability: (weight / sum) as f32,
            ..*choice
        })
        .collect();
    let (mut small, mut large): (Vec<usize>, Vec<usize>) = (0..shares.len()).partition(|i| shares[*i] < 1.0);
    while let (Some(poor), Some(rich)) = (small.pop(), large.last().copied()) {
        table[poor].threshold = shares[poor] as f32;
        table[poor].alias = rich as u32;
        shares[rich] -= 1.0 - shares[poor];
        if shares[rich] < 1.0 {
            large.pop();
            small.push(rich);
        }
    }
    table
}
