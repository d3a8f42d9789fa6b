//! glTF 2.0 import (.gltf, .glb). Files are untrusted: sizes are checked before memory is allocated, and every index is checked
//! before use. The `gltf` crate parses the JSON. Its own validation is not used, since it does not support KHR_mesh_quantization
//! and does not check the data.
use super::coverage::preserve_coverage;
use super::error::Fault;
use super::{Scene, SceneError};
use gltf::json;
use rayon::prelude::*;
use std::path::Path;

mod accessor;
mod animation;
mod file;
mod geometry;
mod images;
mod layers;
mod material;
mod nodes;
mod probe;
mod skin;
#[cfg(test)]
mod tests;

use accessor::Data;

/// Extensions that are supported.
const SUPPORTED: [&str; 10] = [
    "KHR_lights_punctual",
    layers::CLEARCOAT,
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
];
/// Largest number of vertices of all meshes (72 bytes each).
const MAX_VERTICES: u64 = 1 << 26;
/// Largest number of indices of all meshes (4 bytes each).
const MAX_INDICES: u64 = 1 << 28;
/// Largest number of instances.
const MAX_INSTANCES: u64 = 1 << 22;
/// Largest number of joint influences of all vertices (8 bytes each).
const MAX_INFLUENCES: u64 = 1 << 28;
/// Largest number of delta vectors of all morph targets (12 bytes each).
const MAX_DELTAS: u64 = 1 << 27;
/// Largest number of values and times in the keys of all animations (4 bytes each).
const MAX_KEY_NUMBERS: u64 = 1 << 27;
/// Largest number of joints of a skin, since vertices refer to them with 16 bits.
const MAX_SKIN_JOINTS: usize = 1 << 16;
/// Largest number of joints and morph weights of all instances (96 and 4 bytes each in a pose).
const MAX_POSED: u64 = 1 << 23;

/// A fault with the element that has it; [`load`] adds the path of the file.
#[derive(Debug)]
struct At {
    element: String,
    fault: Fault,
}

type Import<T> = Result<T, At>;

/// Adds the element to a fault.
trait Of<T> {
    fn of(self, element: impl FnOnce() -> String) -> Import<T>;
}

impl<T> Of<T> for Result<T, Fault> {
    fn of(self, element: impl FnOnce() -> String) -> Import<T> {
        self.map_err(|fault| At { element: element(), fault })
    }
}

/// `table[index]`, or a fault with the kind of element.
fn refer<'a, T>(table: &'a [T], index: usize, what: &'static str) -> Result<&'a T, Fault> {
    table.get(index).ok_or(Fault::Reference { what, index, count: table.len() })
}

/// A name from a file, made printable: without control characters, and shortened.
fn label(name: Option<&str>, fallback: impl FnOnce() -> String) -> String {
    let text: String = name.unwrap_or_default().chars().filter(|c| !c.is_control()).take(80).collect();
    if text.trim().is_empty() { fallback() } else { text }
}

/// Loads a glTF 2.0 scene. Missing lights and cameras are left to [`supply_missing`](super::supply_missing).
///
/// # Errors
/// [`SceneError`], with the file and the element.
pub fn load(path: &Path) -> Result<Scene, SceneError> {
    let mut notices = Vec::new();
    let (root, bin) = file::open(path, &mut notices)?;
    check_extensions(&root, path, &mut notices)?;
    let scene = assemble(&root, bin, path, notices).map_err(|At { element, fault }| SceneError::Element {
        path: path.to_owned(),
        element,
        fault,
    })?;
    if scene.instances.is_empty() {
        return Err(SceneError::NoGeometry { path: path.to_owned() });
    }
    Ok(scene)
}

fn check_extensions(root: &json::Root, path: &Path, notices: &mut Vec<String>) -> Result<(), SceneError> {
    let unknown = |names: &[String]| {
        let mut names: Vec<String> = names
            .iter()
            .filter(|n| !SUPPORTED.contains(&n.as_str()))
            .map(|n| label(Some(n), || "an extension without a name".to_owned()))
            .collect();
        names.sort();
        names.dedup();
        names
    };
    let required = unknown(&root.extensions_required);
    if !required.is_empty() {
        return Err(SceneError::Extensions { path: path.to_owned(), names: required.join(", ") });
    }
    for name in unknown(&root.extensions_used) {
        notices.push(format!("extension {name} is present but not supported: ignored"));
    }
    Ok(())
}

fn assemble(root: &json::Root, bin: Option<Vec<u8>>, path: &Path, mut notices: Vec<String>) -> Import<Scene> {
    let folder = match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    };
    let buffers = file::buffers(root, bin, folder)?;
    let data = Data::new(root, &buffers);
    let mut placed = nodes::walk(root, &mut notices)?;
    let mut materials = material::read(root, &mut notices)?;
    let textures = images::decode(&data, folder, &materials.requests)?;

    // The primitives that are shown, each once, in the order of the file.
    let mut wanted: Vec<usize> = placed.shown.iter().map(|shown| shown.mesh).collect();
    wanted.sort_unstable();
    wanted.dedup();
    let mut primitives = Vec::new();
    for mesh in wanted {
        let primitive_count = refer(&root.meshes, mesh, "mesh").of(|| "scene".to_owned())?.primitives.len();
        primitives.extend((0..primitive_count).map(|p| (mesh, p)));
    }
    let mut skinned = vec![false; root.meshes.len()];
    for shown in placed.shown.iter().filter(|s| s.skin.is_some()) {
        skinned[shown.mesh] = true;
    }
    geometry::check_budget(&data, &primitives, &skinned)?;
    nodes::check_weights(root, &placed)?;
    let normal_uv = |material: Option<usize>| {
        material.and_then(|m| materials.materials.get(m)).and_then(|m| m.normal_texture).map_or(0, |t| t.uv_set)
    };
    let read: Vec<geometry::Read> = primitives
        .par_iter()
        .map(|(mesh, primitive)| geometry::read(&data, *mesh, *primitive, &normal_uv, skinned[*mesh]))
        .collect::<Import<_>>()?;

    let mut scene = Scene {
        name: path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default(),
        textures,
        samplers: std::mem::take(&mut materials.samplers),
        lights: std::mem::take(&mut placed.lights),
        light_nodes: std::mem::take(&mut placed.light_nodes),
        cameras: std::mem::take(&mut placed.cameras),
        camera_nodes: std::mem::take(&mut placed.camera_nodes),
        probes: std::mem::take(&mut placed.probes),
        animations: animation::read(&data, &placed, &mut notices)?,
        ..Scene::default()
    };
    let mut first_of_mesh = std::collections::HashMap::new();
    let mut kept: Vec<Option<(u32, Option<usize>)>> = Vec::new();
    for ((mesh, primitive), read) in primitives.iter().zip(read) {
        if *primitive == 0 {
            first_of_mesh.insert(*mesh, kept.len());
        }
        notices.extend(read.notices);
        kept.push(read.mesh.map(|m| {
            scene.meshes.push(m);
            (scene.meshes.len() as u32 - 1, read.material)
        }));
    }
    scene.materials = materials.materials;
    let default_material = scene.materials.len() as u32;
    let mut needs_default = scene.materials.is_empty();
    let skins = skin::read(&data, &placed, &mut scene.skins, &mut notices)?;
    scene.nodes = std::mem::take(&mut placed.nodes);
    nodes::place(root, &placed, &skins, &mut scene, &mut notices, |mesh, primitive| {
        let first = first_of_mesh.get(&mesh)?;
        let (index, material) = (*kept.get(first + primitive)?)?;
        needs_default |= material.is_none();
        Some((index, material.map_or(default_material, |m| m as u32)))
    })?;
    nodes::check_rest(&scene)?;
    if needs_default {
        scene.materials.push(super::Material::default());
    }
    preserve_coverage(&mut scene);
    scene.warnings = notices;
    Ok(scene)
}
