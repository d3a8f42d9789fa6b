//! Probabilities for sampling emissive surfaces: proportional to power, in alias tables. Any positive probabilities are unbiased;
//! good ones have less variance.
use super::{AlphaMode, Instance, Material, Mesh, Pose, Scene, Texture, TextureUse, deform};
use glam::{DVec3, Vec2, Vec3};
use magpie_shaders::light_sampling::{CHOICE_EMITTER, LightChoice, NO_EMITTER};
use std::f64::consts::PI;

/// Fraction of the probability that is distributed evenly, so that no emitter has a probability of zero.
pub const UNIFORM_FRACTION: f64 = 0.05;
/// Square root of the number of points at which the emission of a triangle is sampled.
const TEXTURE_SAMPLES: u32 = 4;

/// Whether a material lights other surfaces. One that only shows a light does not, since the light does.
pub fn emits(material: &Material) -> bool {
    material.emission != Vec3::ZERO && !material.shows_light && !material.unlit
}

/// Whether an instance lights other surfaces: its material emits, and alpha leaves some of it visible.
pub fn is_emitter(scene: &Scene, instance: &Instance) -> bool {
    let (mesh, material) = (&scene.meshes[instance.mesh as usize], &scene.materials[instance.material as usize]);
    emits(material) && is_visible_anywhere(scene, material, mesh)
}

/// Whether any point of a mesh passes the alpha test. Texture filtering cannot exceed the largest texel.
fn is_visible_anywhere(scene: &Scene, material: &Material, mesh: &Mesh) -> bool {
    // Allows for rounding errors.
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

/// Luminance of linear Rec.709.
pub fn luminance(c: Vec3) -> f64 {
    c.as_dvec3().dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

/// Adds the triangles or spheres of an emissive instance to `entries`, with their powers. Returns the index of the first, or [`NO_EMITTER`].
pub fn add_emitters(scene: &Scene, pose: &Pose, instance: usize, entries: &mut Vec<(f64, LightChoice)>) -> u32 {
    let placed = &scene.instances[instance];
    let (mesh, material) = (&scene.meshes[placed.mesh as usize], &scene.materials[placed.material as usize]);
    if !is_emitter(scene, placed) {
        return NO_EMITTER;
    }
    let first = entries.len() as u32;
    let world = &pose.instances[instance];
    let sides = if material.double_sided { 2.0 } else { 1.0 };
    let mut push = |power: f64| {
        let primitive = entries.len() as u32 - first;
        entries.push((
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

/// Emission of a triangle for its probability: the mean, mixed with a fraction [`UNIFORM_FRACTION`] of the emission without textures and alpha.
pub(super) fn emission(scene: &Scene, material: &Material, mesh: &Mesh, corners: &[u32]) -> f64 {
    let full = luminance(material.emission);
    emission_fraction(scene, material, mesh, corners)
        .map_or(full, |share| full * (UNIFORM_FRACTION + (1.0 - UNIFORM_FRACTION) * share))
}

/// Approximate mean luminance that a triangle emits: factor times texture and coverage.
pub fn mean_emission(scene: &Scene, material: &Material, mesh: &Mesh, corners: &[u32]) -> f64 {
    luminance(material.emission) * emission_fraction(scene, material, mesh, corners).unwrap_or(1.0)
}

/// Mean fraction of a triangle's emission that textures and alpha leave; `None` if there is nothing to look up.
fn emission_fraction(scene: &Scene, material: &Material, mesh: &Mesh, corners: &[u32]) -> Option<f64> {
    let texture = |used: Option<TextureUse>| used.and_then(|u| Some((u, scene.textures.get(u.texture as usize)?)));
    let (emission_texture, base_texture) = (texture(material.emission_texture), texture(material.base_colour_texture));
    if emission_texture.is_none() && material.alpha == AlphaMode::Opaque {
        return None;
    }
    let mut sum = 0.0;
    for i in 0..TEXTURE_SAMPLES * TEXTURE_SAMPLES {
        // A regular grid in the square, mapped to the triangle.
        let [x, y] = [i % TEXTURE_SAMPLES, i / TEXTURE_SAMPLES].map(|k| (k as f32 + 0.5) / TEXTURE_SAMPLES as f32);
        let root = x.sqrt();
        let weights = [1.0 - root, root * (1.0 - y), root * y];
        let sample = |(used, texture): (TextureUse, &Texture)| {
            let uvs = if used.uv_set == 0 { &mesh.uv0 } else { &mesh.uv1 };
            let place = (0..3).map(|k| uvs[corners[k] as usize] * weights[k]).sum::<Vec2>().extend(1.0);
            texel(texture, Vec2::new(used.rows[0].dot(place), used.rows[1].dot(place)))
        };
        let colour = (0..3).map(|k| mesh.colours[corners[k] as usize].w * weights[k]).sum::<f32>();
        let alpha =
            || material.base_colour.w * colour * base_texture.map_or(1.0, |used| f32::from(sample(used)[3]) / 255.0);
        let covers = match material.alpha {
            AlphaMode::Opaque => 1.0,
            AlphaMode::Mask(cutoff) => f64::from(u8::from(alpha() >= cutoff)),
            AlphaMode::Blend => f64::from(alpha().clamp(0.0, 1.0)),
        };
        sum += covers * emission_texture.map_or(1.0, |used| luminance(from_srgb(sample(used))));
    }
    Some(sum / f64::from(TEXTURE_SAMPLES * TEXTURE_SAMPLES))
}

/// The texel at wrapped coordinates, of a mip small enough for a few samples to represent the texture.
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

/// Computes thresholds, aliases and probabilities (Vose 1991, "A Linear Algorithm for Generating Random Numbers with a Given
/// Distribution"). Entries without a weight above 0 are never chosen. If there are no others, the table is empty, which shaders check for.
pub fn alias_table(mut entries: Vec<(f64, LightChoice)>) -> Vec<LightChoice> {
    // NaN counts as 0.
    entries.iter_mut().for_each(|(weight, _)| *weight = weight.max(0.0));
    let sum: f64 = entries.iter().map(|(weight, _)| weight).sum();
    if sum == 0.0 {
        return Vec::new();
    }
    let n = entries.len() as f64;
    let mut scaled: Vec<f64> = entries.iter().map(|(weight, _)| weight / sum * n).collect();
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
    let (mut small, mut large): (Vec<usize>, Vec<usize>) = (0..scaled.len()).partition(|i| scaled[*i] < 1.0);
    while let (Some(small_entry), Some(large_entry)) = (small.pop(), large.last().copied()) {
        table[small_entry].threshold = scaled[small_entry] as f32;
        table[small_entry].alias = large_entry as u32;
        scaled[large_entry] -= 1.0 - scaled[small_entry];
        if scaled[large_entry] < 1.0 {
            large.pop();
            small.push(large_entry);
        }
    }
    table
}
