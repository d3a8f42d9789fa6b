//! How often what shines is sampled: by power, as alias tables. Any positive odds are unbiased; good ones are less noisy.
use super::{AlphaMode, Animator, Instance, Material, Mesh, Pose, Scene, Texture, TextureUse, deform};
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
    /// Those of a scene; `None` where nothing shines but what shows a light.
    pub fn new(scene: &Scene) -> Option<Self> {
        if !scene.instances.iter().any(|i| shines(scene, i)) {
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

/// Whether an instance lights others: its material emits, and alpha leaves anything of it.
pub fn shines(scene: &Scene, instance: &Instance) -> bool {
    let (mesh, material) = (&scene.meshes[instance.mesh as usize], &scene.materials[instance.material as usize]);
    emits(material) && is_anywhere(scene, material, mesh)
}

/// Whether alpha reaches what is seen of it, anywhere on a mesh; no filter of a texture goes beyond its texels.
fn is_anywhere(scene: &Scene, material: &Material, mesh: &Mesh) -> bool {
    // Rounding goes either way.
    const ROUNDING: f32 = 1e-5;
    let is_spheres = !mesh.spheres.is_empty();
    let least = match material.alpha {
        AlphaMode::Mask(cutoff) if !is_spheres => cutoff * (1.0 - ROUNDING),
        AlphaMode::Blend => f32::MIN_POSITIVE,
        _ => return true,
    };
    if is_spheres {
        return material.base_colour.w >= least;
    }
    let greatest = mesh.colours.iter().map(|c| c.w).reduce(f32::max).unwrap_or(1.0) * material.base_colour.w;
    let texture = material.base_colour_texture.and_then(|used| scene.textures.get(used.texture as usize));
    let passes = |texel: u8| greatest * f32::from(texel) / 255.0 >= least;
    match texture.and_then(|t| t.mips.first()) {
        Some(texels) => texels.iter().skip(3).step_by(4).any(|alpha| passes(*alpha)),
        None => greatest >= least,
    }
}

/// Of linear Rec.709.
pub fn luminance(c: Vec3) -> f64 {
    c.as_dvec3().dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

/// Adds the triangles or spheres of an instance that shines, each with its power; gives where they begin, or [`NO_EMITTER`].
pub fn add_emitters(scene: &Scene, pose: &Pose, instance: usize, near: &mut Vec<(f64, LightChoice)>) -> u32 {
    let shown = &scene.instances[instance];
    let (mesh, material) = (&scene.meshes[shown.mesh as usize], &scene.materials[shown.material as usize]);
    if !shines(scene, shown) {
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
        let alpha = if material.alpha == AlphaMode::Blend { f64::from(material.base_colour.w.min(1.0)) } else { 1.0 };
        push(4.0 * PI * PI * radius * radius * alpha * luminance(material.emission));
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
    share_of_emission(scene, material, mesh, corners).map_or(full, |share| full * (EVEN + (1.0 - EVEN) * share))
}

/// Mean luminance that a triangle emits, roughly: factor times texture, less what alpha takes.
pub fn mean_emission(scene: &Scene, material: &Material, mesh: &Mesh, corners: &[u32]) -> f64 {
    luminance(material.emission) * share_of_emission(scene, material, mesh, corners).unwrap_or(1.0)
}

/// What textures and alpha leave of the emission of a triangle, on average; `None` for all of it.
fn share_of_emission(scene: &Scene, material: &Material, mesh: &Mesh, corners: &[u32]) -> Option<f64> {
    let texture = |used: Option<TextureUse>| used.and_then(|u| Some((u, scene.textures.get(u.texture as usize)?)));
    let (glow, base) = (texture(material.emission_texture), texture(material.base_colour_texture));
    if glow.is_none() && material.alpha == AlphaMode::Opaque {
        return None;
    }
    let mut sum = 0.0;
    for i in 0..LOOK_UPS * LOOK_UPS {
        // A regular pattern in the square, folded into the triangle.
        let [x, y] = [i % LOOK_UPS, i / LOOK_UPS].map(|k| (k as f32 + 0.5) / LOOK_UPS as f32);
        let root = x.sqrt();
        let weights = [1.0 - root, root * (1.0 - y), root * y];
        let read = |(used, texture): (TextureUse, &Texture)| {
            let uvs = if used.uv_set == 0 { &mesh.uv0 } else { &mesh.uv1 };
            let place = (0..3).map(|k| uvs[corners[k] as usize] * weights[k]).sum::<Vec2>().extend(1.0);
            texel(texture, Vec2::new(used.rows[0].dot(place), used.rows[1].dot(place)))
        };
        let colour = (0..3).map(|k| mesh.colours[corners[k] as usize].w * weights[k]).sum::<f32>();
        let alpha = || material.base_colour.w * colour * base.map_or(1.0, |base| f32::from(read(base)[3]) / 255.0);
        let covers = match material.alpha {
            AlphaMode::Opaque => 1.0,
            AlphaMode::Mask(cutoff) => f64::from(u8::from(alpha() >= cutoff)),
            AlphaMode::Blend => f64::from(alpha().clamp(0.0, 1.0)),
        };
        sum += covers * glow.map_or(1.0, |glow| luminance(from_srgb(read(glow))));
    }
    Some(sum / f64::from(LOOK_UPS * LOOK_UPS))
}

/// The texel there, tiled, of a mip that is small enough for few look-ups to see it all.
fn texel(texture: &Texture, uv: Vec2) -> [u8; 4] {
    let mip = texture.mips.len().saturating_sub(7);
    let [width, height] = texture.mip_size(mip);
    let at = |x: f32, n: u32| ((x.rem_euclid(1.0) * n as f32) as usize).min(n as usize - 1);
    let first = 4 * (at(uv.y, height) * width as usize + at(uv.x, width));
    [0, 1, 2, 3].map(|k| texture.mips[mip][first + k])
}

fn from_srgb(texel: [u8; 4]) -> Vec3 {
    let channel = |k: usize| {
        let x = f32::from(texel[k]) / 255.0;
        if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
    };
    Vec3::new(channel(0), channel(1), channel(2))
}

/// Fills in thresholds, aliases and probabilities (Vose 1991, "A Linear Algorithm for Generating Random Numbers with a Given
/// Distribution"). What has no weight above 0 is never chosen; where nothing has, the table is empty, which is what every shader that reads
/// one expects.
pub fn alias_table(mut entries: Vec<(f64, LightChoice)>) -> Vec<LightChoice> {
    // NaN is no weight either.
    entries.iter_mut().for_each(|(weight, _)| *weight = weight.max(0.0));
    let sum: f64 = entries.iter().map(|(weight, _)| weight).sum();
    if sum == 0.0 {
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
