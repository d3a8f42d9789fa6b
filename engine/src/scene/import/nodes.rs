//! The node hierarchy: instances, lights and cameras in the world.
use super::{Import, MAX_INSTANCES, Of, label, refer};
use crate::scene::camera::{MIN_FOV, NEAR_RANGE};
use crate::scene::error::Fault;
use crate::scene::{Camera, Instance, Light, Scene};
use glam::{Affine3A, DAffine3, DMat3, DMat4, DQuat, DVec3, Mat3A, Vec3};
use gltf::json;
use json::camera::Type as CameraType;
use json::extensions::scene::khr_lights_punctual::{Light as JsonLight, Type as LightType};
use json::validation::Checked;
use std::f32::consts::{FRAC_PI_2, PI};

/// Deepest level of nested nodes.
const MAX_DEPTH: usize = 1024;
/// World coordinates above this, metres, would overflow when squared on the GPU.
const MAX_COORDINATE: f32 = crate::ray::COORDINATE_LIMIT;

/// A node that shows a mesh.
pub(super) struct Shown {
    node: usize,
    pub mesh: usize,
    world: Affine3A,
}

/// What the nodes of the scene hold.
#[derive(Default)]
pub(super) struct Placed {
    pub shown: Vec<Shown>,
    pub lights: Vec<Light>,
    pub cameras: Vec<Camera>,
}

/// Walks the default scene (else the first, else all nodes without a parent), parents first, in the order of the file.
pub(super) fn walk(root: &json::Root, notices: &mut Vec<String>) -> Import<Placed> {
    let parents = check_tree(root)?;
    let roots: Vec<usize> = match root.scene.map(|s| s.value()).or((!root.scenes.is_empty()).then_some(0)) {
        Some(scene) => {
            let nodes = &refer(&root.scenes, scene, "scene").of(|| "default scene".to_owned())?.nodes;
            let mut seen = vec![false; root.nodes.len()];
            for node in nodes {
                let (node, element) = (node.value(), || format!("scene {scene}"));
                refer(&root.nodes, node, "node").of(element)?;
                let second = format!("scene {scene}");
                let first = match parents[node] {
                    Some(parent) => format!("node {parent}"),
                    None if seen[node] => second.clone(),
                    None => {
                        seen[node] = true;
                        continue;
                    }
                };
                return Err(Fault::TwoParents { first, second }).of(|| format!("node {node}"));
            }
            nodes.iter().map(|n| n.value()).collect()
        }
        None => (0..root.nodes.len()).filter(|n| parents[*n].is_none()).collect(),
    };

    let mut placed = Placed::default();
    let mut stack: Vec<(usize, DAffine3, usize)> =
        roots.into_iter().rev().map(|n| (n, DAffine3::IDENTITY, 1)).collect();
    while let Some((index, parent, depth)) = stack.pop() {
        let element = || format!("node {index}");
        if depth > MAX_DEPTH {
            return Err(Fault::Depth { limit: MAX_DEPTH }).of(element);
        }
        let node = &root.nodes[index];
        let world = parent * local(node).of(element)?;
        let single =
            Affine3A { matrix3: Mat3A::from(world.matrix3.as_mat3()), translation: world.translation.as_vec3().into() };
        if !single.is_finite() {
            return Err(Fault::NotFinite { at: 0 }).of(|| format!("node {index} world transform"));
        }
        if let Some(mesh) = node.mesh {
            refer(&root.meshes, mesh.value(), "mesh").of(element)?;
            placed.shown.push(Shown { node: index, mesh: mesh.value(), world: single });
        }
        if let Some(camera) = node.camera {
            let camera = camera.value();
            let from = refer(&root.cameras, camera, "camera").of(element)?;
            placed.cameras.extend(camera_at(from, camera, node, &single, notices).of(|| format!("camera {camera}"))?);
        }
        if let Some(light) = node.extensions.as_ref().and_then(|e| e.khr_lights_punctual.as_ref()) {
            let lights = root.extensions.as_ref().and_then(|e| e.khr_lights_punctual.as_ref());
            let lights = lights.map_or(&[][..], |l| &l.lights);
            let light = light.light.value();
            let from = refer(lights, light, "light").of(element)?;
            placed.lights.push(light_at(from, &single).of(|| format!("light {light}"))?);
        }
        let children = node.children.iter().flatten().rev();
        stack.extend(children.map(|c| (c.value(), world, depth + 1)));
    }
    Ok(placed)
}

/// The parent of every node, after a check that the nodes form trees.
fn check_tree(root: &json::Root) -> Import<Vec<Option<usize>>> {
    let mut parents: Vec<Option<usize>> = vec![None; root.nodes.len()];
    for (i, node) in root.nodes.iter().enumerate() {
        for child in node.children.iter().flatten() {
            let child = child.value();
            refer(&root.nodes, child, "node").of(|| format!("node {i}"))?;
            if child == i {
                return Err(Fault::Cycle).of(|| format!("node {i}"));
            }
            if let Some(first) = parents[child].replace(i) {
                let (first, second) = (format!("node {first}"), format!("node {i}"));
                return Err(Fault::TwoParents { first, second }).of(|| format!("node {child}"));
            }
        }
    }
    // With one parent each, what cannot be reached from a node without one lies on, or below, a cycle.
    let mut reached = vec![false; root.nodes.len()];
    let mut stack: Vec<usize> = (0..root.nodes.len()).filter(|n| parents[*n].is_none()).collect();
    while let Some(i) = stack.pop() {
        reached[i] = true;
        stack.extend(root.nodes[i].children.iter().flatten().map(|c| c.value()));
    }
    match reached.iter().position(|r| !r) {
        Some(i) => Err(Fault::Cycle).of(|| format!("node {i}")),
        None => Ok(parents),
    }
}

fn local(node: &json::Node) -> Result<DAffine3, Fault> {
    let finite = |values: &[f32], what: &'static str| {
        if values.iter().all(|v| v.is_finite()) {
            Ok(())
        } else {
            Err(Fault::Value { what, got: format!("{values:?}"), wanted: "finite numbers" })
        }
    };
    if let Some(m) = node.matrix {
        finite(&m, "matrix")?;
        if [m[3], m[7], m[11], m[15]] != [0.0, 0.0, 0.0, 1.0] {
            let got = format!("{:?}", [m[3], m[7], m[11], m[15]]);
            return Err(Fault::Value { what: "the last row of matrix", got, wanted: "[0, 0, 0, 1]" });
        }
        let m = DMat4::from_cols_array(&m.map(f64::from));
        return Ok(DAffine3 { matrix3: DMat3::from_mat4(m), translation: m.w_axis.truncate() });
    }
    let translation = node.translation.unwrap_or_default();
    let scale = node.scale.unwrap_or([1.0; 3]);
    let rotation = node.rotation.unwrap_or_default().0;
    finite(&translation, "translation")?;
    finite(&scale, "scale")?;
    finite(&rotation, "rotation")?;
    let rotation = DQuat::from_array(rotation.map(f64::from));
    // Files round: only a quaternion without a direction is refused.
    if rotation.length() < 1e-6 {
        return Err(Fault::Value { what: "rotation", got: rotation.to_string(), wanted: "a unit quaternion" });
    }
    Ok(DAffine3::from_scale_rotation_translation(
        DVec3::from_array(scale.map(f64::from)),
        rotation.normalize(),
        DVec3::from_array(translation.map(f64::from)),
    ))
}

fn camera_at(
    from: &json::Camera,
    index: usize,
    node: &json::Node,
    world: &Affine3A,
    notices: &mut Vec<String>,
) -> Result<Option<Camera>, Fault> {
    let name = label(from.name.as_deref().or(node.name.as_deref()), || format!("camera {index}"));
    if from.type_ == Checked::Valid(CameraType::Orthographic) {
        notices.push(format!("camera {name} is orthographic, which is not supported: ignored"));
        return Ok(None);
    }
    let Some(lens) = &from.perspective else { return Err(Fault::Missing("perspective")) };
    if !(MIN_FOV..PI).contains(&lens.yfov) {
        let wanted = "at least 1e-6 and less than pi";
        return Err(Fault::Value { what: "yfov", got: lens.yfov.to_string(), wanted });
    }
    if !NEAR_RANGE.contains(&lens.znear) {
        let wanted = "1e-18 to 1e18";
        return Err(Fault::Value { what: "znear", got: lens.znear.to_string(), wanted });
    }
    let Some(rotation) = Camera::rigid(world.matrix3) else {
        notices.push(format!("camera {name} has a singular transform: ignored"));
        return Ok(None);
    };
    let world_from_camera = Affine3A { matrix3: rotation, translation: world.translation };
    Ok(Some(Camera { name, world_from_camera, vertical_fov: lens.yfov, near: lens.znear }))
}

/// KHR_lights_punctual: the light shines along the node's -z; scale does not change its strength.
fn light_at(from: &JsonLight, world: &Affine3A) -> Result<Light, Fault> {
    let strength = Vec3::from(from.color) * from.intensity;
    if !(strength.is_finite() && strength.min_element() >= 0.0) {
        let wanted = "finite numbers of at least 0";
        return Err(Fault::Value { what: "intensity", got: strength.to_string(), wanted });
    }
    if let Some(range) = from.range
        && !(range > 0.0 && range.is_finite())
    {
        return Err(Fault::Value { what: "range", got: range.to_string(), wanted: "a finite number above 0" });
    }
    let position = Vec3::from(world.translation);
    let direction = (-world.matrix3.z_axis.as_dvec3()).try_normalize().map(|d| d.as_vec3());
    let direction = || {
        let (what, got) = ("direction", "of no length".to_owned());
        direction.ok_or(Fault::Value { what, got, wanted: "a node whose z axis has a length" })
    };
    match from.type_ {
        Checked::Valid(LightType::Directional) => {
            Ok(Light::Directional { direction: direction()?, illuminance: strength })
        }
        Checked::Valid(LightType::Point) => Ok(Light::Point { position, intensity: strength, range: from.range }),
        Checked::Valid(LightType::Spot) => {
            let spot = from.spot.as_ref().ok_or(Fault::Missing("spot"))?;
            let (inner, outer) = (spot.inner_cone_angle, spot.outer_cone_angle);
            if !(inner >= 0.0 && inner <= outer && outer > 0.0 && outer <= FRAC_PI_2 + 1e-4) {
                let got = format!("{inner} to {outer}");
                return Err(Fault::Value { what: "the cone", got, wanted: "0 <= inner <= outer <= pi / 2" });
            }
            let outer = outer.min(FRAC_PI_2);
            // A hard edge is a very narrow soft one: its width is divided by.
            let inner = inner.min(outer * 0.999);
            Ok(Light::Spot { position, direction: direction()?, intensity: strength, range: from.range, inner, outer })
        }
        Checked::Invalid => {
            Err(Fault::Value { what: "type", got: "unknown".to_owned(), wanted: "directional, point or spot" })
        }
    }
}

/// Adds an instance for every primitive of every node that shows a mesh; `find` gives mesh and material of a primitive that
/// was kept.
pub(super) fn place(
    root: &json::Root,
    placed: &Placed,
    scene: &mut Scene,
    notices: &mut Vec<String>,
    mut find: impl FnMut(usize, usize) -> Option<(u32, u32)>,
) -> Import<()> {
    let total: u64 = placed.shown.iter().map(|s| root.meshes[s.mesh].primitives.len() as u64).sum();
    if total > MAX_INSTANCES {
        let limit = MAX_INSTANCES;
        return Err(Fault::Limit { what: "instances", got: total, limit }).of(|| "scene".to_owned());
    }
    let bounds: Vec<_> = scene.meshes.iter().map(|m| m.bounds().unwrap_or_default()).collect();
    for shown in &placed.shown {
        let name = label(root.nodes[shown.node].name.as_deref(), || format!("node {}", shown.node));
        let inverse = shown.world.inverse();
        if shown.world.matrix3.determinant() == 0.0 || !inverse.is_finite() {
            notices.push(format!("node {} ({name}) has a singular transform: skipped", shown.node));
            continue;
        }
        for primitive in 0..root.meshes[shown.mesh].primitives.len() {
            let Some((mesh, material)) = find(shown.mesh, primitive) else { continue };
            let [lo, hi] = bounds[mesh as usize];
            for corner in 0..8 {
                let pick = |axis: usize| if corner >> axis & 1 == 0 { lo[axis] } else { hi[axis] };
                let p = shown.world.transform_point3(Vec3::new(pick(0), pick(1), pick(2)));
                if !p.is_finite() || p.abs().max_element() > MAX_COORDINATE {
                    let (got, wanted) = (p.to_string(), "at most 1e12 metres");
                    return Err(Fault::Value { what: "a world coordinate", got, wanted })
                        .of(|| format!("node {}", shown.node));
                }
            }
            let instance = Instance { name: name.clone(), mesh, material, world_from_object: shown.world };
            scene.instances.push(instance);
        }
    }
    Ok(())
}
