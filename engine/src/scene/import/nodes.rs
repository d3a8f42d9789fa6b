//! Reads the node hierarchy: instances, lights and cameras, in world space.
use super::probe::probe_at;
use super::{Import, MAX_INSTANCES, MAX_POSED, Of, label, refer};
use crate::scene::camera::{MIN_FOV, NEAR_RANGE};
use crate::scene::error::Fault;
use crate::scene::pose::good_inverse;
use crate::scene::{Animator, Camera, Instance, Light, Local, Node, Property, ReflectionProbe, Scene, single};
use glam::{DAffine3, DMat3, DMat4, DQuat, DVec3, Vec3};
use gltf::json;
use json::camera::Type as CameraType;
use json::extensions::scene::khr_lights_punctual::{Light as JsonLight, Type as LightType};
use json::validation::Checked;
use std::f32::consts::{FRAC_PI_2, PI};

/// Largest nesting depth of nodes.
const MAX_DEPTH: usize = 1024;
/// Largest world coordinate, metres; squares of larger ones would overflow on the GPU.
const MAX_COORDINATE: f64 = crate::ray::COORDINATE_LIMIT as f64;

/// A node that shows a mesh.
pub(super) struct Shown {
    pub node: usize,
    pub mesh: usize,
    pub skin: Option<usize>,
    world: DAffine3,
}

/// Everything that is attached to the nodes of the scene.
#[derive(Default)]
pub(super) struct Placed {
    pub nodes: Vec<Node>,
    /// Index in `nodes` of each node of the file; `None` for nodes outside the scene.
    pub places: Vec<Option<u32>>,
    pub shown: Vec<Shown>,
    pub lights: Vec<Light>,
    pub light_nodes: Vec<Option<u32>>,
    pub cameras: Vec<Camera>,
    pub camera_nodes: Vec<Option<u32>>,
    pub probes: Vec<ReflectionProbe>,
}

/// Visits the default scene (or else the first, or else all root nodes), parents first, in the order of the file.
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

    let mut placed = Placed { places: vec![None; root.nodes.len()], ..Placed::default() };
    let mut stack: Vec<(usize, Option<u32>, DAffine3, usize)> =
        roots.into_iter().rev().map(|n| (n, None, DAffine3::IDENTITY, 1)).collect();
    while let Some((index, parent, from_parent, depth)) = stack.pop() {
        let element = || format!("node {index}");
        if depth > MAX_DEPTH {
            return Err(Fault::Depth { limit: MAX_DEPTH }).of(element);
        }
        let node = &root.nodes[index];
        let local = local(node).of(element)?;
        let world = from_parent * local.affine();
        if !single(&world).is_finite() {
            return Err(Fault::NotFinite { at: 0 }).of(|| format!("node {index} world transform"));
        }
        let here = Some(placed.nodes.len() as u32);
        placed.places[index] = here;
        let name = label(node.name.as_deref(), element);
        let weights = node.weights.clone().unwrap_or_default();
        placed.nodes.push(Node { name, parent, local, weights });
        if let Some(mesh) = node.mesh {
            refer(&root.meshes, mesh.value(), "mesh").of(element)?;
            let skin = node.skin.map(|s| s.value());
            placed.shown.push(Shown { node: index, mesh: mesh.value(), skin, world });
        }
        if let Some(camera) = node.camera {
            let camera = camera.value();
            let from = refer(&root.cameras, camera, "camera").of(element)?;
            let camera = camera_at(from, camera, node, &world, notices).of(|| format!("camera {camera}"))?;
            placed.camera_nodes.extend(camera.is_some().then_some(here));
            placed.cameras.extend(camera);
        }
        if let Some(light) = node.extensions.as_ref().and_then(|e| e.khr_lights_punctual.as_ref()) {
            let lights = root.extensions.as_ref().and_then(|e| e.khr_lights_punctual.as_ref());
            let lights = lights.map_or(&[][..], |l| &l.lights);
            let light = light.light.value();
            let from = refer(lights, light, "light").of(element)?;
            placed.lights.push(light_at(from, &world).of(|| format!("light {light}"))?);
            placed.light_nodes.push(here);
        }
        if let Some(extras) = &node.extras
            && let Some(probe) = probe_at(extras.get(), &world, placed.probes.len(), MAX_COORDINATE).of(element)?
        {
            placed.probes.push(probe);
        }
        let children = node.children.iter().flatten().rev();
        stack.extend(children.map(|c| (c.value(), here, world, depth + 1)));
    }
    Ok(placed)
}

/// The parent of every node, after checking that the nodes form trees.
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
    // Every node has at most one parent, so a node that no root reaches is on a cycle or below one.
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

fn local(node: &json::Node) -> Result<Local, Fault> {
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
        return Ok(Local::Matrix(DAffine3 { matrix3: DMat3::from_mat4(m), translation: m.w_axis.truncate() }));
    }
    let translation = node.translation.unwrap_or_default();
    let scale = node.scale.unwrap_or([1.0; 3]);
    let rotation = node.rotation.unwrap_or_default().0;
    finite(&translation, "translation")?;
    finite(&scale, "scale")?;
    finite(&rotation, "rotation")?;
    let rotation = DQuat::from_array(rotation.map(f64::from));
    // Files have rounding errors, so only a quaternion close to zero is refused.
    if rotation.length() < 1e-6 {
        return Err(Fault::Value { what: "rotation", got: rotation.to_string(), wanted: "a unit quaternion" });
    }
    Ok(Local::Trs {
        translation: DVec3::from_array(translation.map(f64::from)),
        rotation: rotation.normalize(),
        scale: DVec3::from_array(scale.map(f64::from)),
    })
}

fn camera_at(
    from: &json::Camera,
    index: usize,
    node: &json::Node,
    world: &DAffine3,
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
    let world_from_camera = DAffine3 { matrix3: rotation, translation: world.translation };
    Ok(Some(Camera { name, world_from_camera, vertical_fov: lens.yfov, near: lens.znear }))
}

/// A light of KHR_lights_punctual, which shines along the node's -z. Scale does not affect its intensity.
fn light_at(from: &JsonLight, world: &DAffine3) -> Result<Light, Fault> {
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
    let position = world.translation;
    let direction = (-world.matrix3.z_axis).try_normalize().map(|d| d.as_vec3());
    let direction = || {
        let (what, got) = ("direction", "of no length".to_owned());
        direction.ok_or(Fault::Value { what, got, wanted: "a node whose z axis has a length" })
    };
    match from.type_ {
        Checked::Valid(LightType::Directional) => {
            Ok(Light::Directional { direction: direction()?, illuminance: strength, angular_radius: 0.0 })
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
            // A cone with a hard edge gets a very narrow soft one, because shaders divide by its width.
            let inner = inner.min(outer * 0.999);
            Ok(Light::Spot { position, direction: direction()?, intensity: strength, range: from.range, inner, outer })
        }
        Checked::Invalid => {
            Err(Fault::Value { what: "type", got: "unknown".to_owned(), wanted: "directional, point or spot" })
        }
    }
}

/// Number of morph targets of a mesh of the file.
pub(super) fn target_count(mesh: &json::Mesh) -> usize {
    mesh.primitives.first().and_then(|p| p.targets.as_ref()).map_or(0, Vec::len)
}

/// Checks the morph weights of the nodes and meshes that are shown.
pub(super) fn check_weights(root: &json::Root, placed: &Placed) -> Import<()> {
    for shown in &placed.shown {
        let mesh = &root.meshes[shown.mesh];
        let of_mesh = (mesh.weights.as_deref(), format!("mesh {}", shown.mesh));
        let of_node = (root.nodes[shown.node].weights.as_deref(), format!("node {}", shown.node));
        for (weights, element) in [of_mesh, of_node] {
            let weights = weights.unwrap_or_default();
            let targets = target_count(mesh);
            if !weights.is_empty() && weights.len() != targets {
                let got = format!("{} for {targets} morph targets", weights.len());
                return Err(Fault::Value { what: "the number of weights", got, wanted: "one for each" }).of(|| element);
            }
            if let Some(at) = weights.iter().position(|w| !w.is_finite()) {
                return Err(Fault::NotFinite { at }).of(|| format!("{element} weights"));
            }
        }
    }
    Ok(())
}

/// Whether each node is animated, directly or through an ancestor.
fn moving(scene: &Scene) -> Vec<bool> {
    let mut moving = vec![false; scene.nodes.len()];
    let channels = scene.animations.iter().flat_map(|a| &a.channels);
    for channel in channels.filter(|c| c.property != Property::Weights) {
        moving[channel.node as usize] = true;
    }
    for i in 0..moving.len() {
        moving[i] |= scene.nodes[i].parent.is_some_and(|p| moving[p as usize]);
    }
    moving
}

/// Adds an instance for every primitive of every node that shows a mesh. `find` returns the mesh and material of a primitive that
/// was kept; `skins` are the indices of the skins in the scene.
pub(super) fn place(
    root: &json::Root,
    placed: &Placed,
    skins: &[Option<u32>],
    scene: &mut Scene,
    notices: &mut Vec<String>,
    mut find: impl FnMut(usize, usize) -> Option<(u32, u32)>,
) -> Import<()> {
    let (mut total, mut posed) = (0_u64, 0_u64);
    for shown in &placed.shown {
        let mesh = &root.meshes[shown.mesh];
        let joints = shown.skin.map_or(0, |s| root.skins[s].joints.len()) + target_count(mesh);
        total += mesh.primitives.len() as u64;
        posed = posed.saturating_add((mesh.primitives.len() as u64).saturating_mul(joints as u64));
    }
    for (what, got, limit) in
        [("instances", total, MAX_INSTANCES), ("joints and morph weights of all instances", posed, MAX_POSED)]
    {
        if got > limit {
            return Err(Fault::Limit { what, got, limit }).of(|| "scene".to_owned());
        }
    }
    let bounds: Vec<_> = scene.meshes.iter().map(|m| m.bounds().unwrap_or_default()).collect();
    let most_joint: Vec<_> = scene.meshes.iter().map(|m| m.influences.iter().map(|i| i.joint).max()).collect();
    let moving = moving(scene);
    for shown in &placed.shown {
        let name = label(root.nodes[shown.node].name.as_deref(), || format!("node {}", shown.node));
        let node = placed.places[shown.node];
        let skin = shown.skin.and_then(|s| skins[s]);
        let rounded = single(&shown.world);
        let singular = rounded.matrix3.determinant() == 0.0 || !rounded.inverse().is_finite();
        // The transform of an animated node may be invertible in other poses, and a skinned mesh ignores its node's transform.
        let unfit = singular && !node.is_some_and(|n| moving[n as usize]);
        if unfit && skin.is_none() {
            notices.push(format!("node {} ({name}) has a singular transform: skipped", shown.node));
            continue;
        }
        for primitive in 0..root.meshes[shown.mesh].primitives.len() {
            let Some((mesh, material)) = find(shown.mesh, primitive) else { continue };
            let skin = skin.filter(|_| most_joint[mesh as usize].is_some());
            match (skin, most_joint[mesh as usize]) {
                (Some(skin), Some(joint)) => {
                    let element = || format!("node {} mesh {} primitive {primitive} JOINTS", shown.node, shown.mesh);
                    refer(&scene.skins[skin as usize].joints, joint as usize, "joint").of(element)?;
                }
                _ if unfit => continue,
                _ => in_range(&shown.world, bounds[mesh as usize]).of(|| format!("node {}", shown.node))?,
            }
            let bent_at_origin = skin.is_some() && good_inverse(&shown.world).is_none();
            let world_from_object = if bent_at_origin { DAffine3::IDENTITY } else { shown.world };
            let instance = Instance { name: name.clone(), mesh, material, world_from_object, node, skin };
            scene.instances.push(instance);
        }
    }
    Ok(())
}

fn in_range(world: &DAffine3, [lo, hi]: [Vec3; 2]) -> Result<(), Fault> {
    for corner in 0..8 {
        let pick = |axis: usize| f64::from(if corner >> axis & 1 == 0 { lo[axis] } else { hi[axis] });
        let p = world.transform_point3(DVec3::new(pick(0), pick(1), pick(2)));
        if !p.is_finite() || p.abs().max_element() > MAX_COORDINATE {
            let (got, wanted) = (p.as_vec3().to_string(), "at most 1e12 metres");
            return Err(Fault::Value { what: "a world coordinate", got, wanted });
        }
    }
    Ok(())
}

/// Checks the bounds of deforming instances in the rest pose.
pub(super) fn check_rest(scene: &Scene) -> Import<()> {
    let pose = Animator::still(scene).pose(0.0);
    for ((instance, world), bounds) in scene.instances.iter().zip(&pose.instances).zip(&pose.bounds) {
        if let Some(bounds) = bounds {
            in_range(world, *bounds).of(|| format!("node {} in the rest pose", instance.name))?;
        }
    }
    Ok(())
}
