//! Where everything is at a time.
use super::animation::{Channel, Local, Node, Property, Skin, rest_worlds};
use super::reach::Reach;
use super::{Camera, Light, Scene, SceneError};
use glam::{DAffine3, DVec3, Vec3};

/// Plays one animation of a scene. It owns what that needs and no more: no vertices, no textures.
///
/// Where [`is_animated`](Self::is_animated) says no, every pose is the same and none but the first need be asked for.
#[derive(Clone, Debug)]
pub struct Animator {
    /// World from node in the rest pose.
    rest: Vec<DAffine3>,
    /// Place in `moving` of every node, [`STILL`] for those that do not move.
    slots: Vec<u32>,
    /// Nodes that a channel moves, themselves or through an ancestor; parents before children.
    moving: Vec<Moving>,
    channels: Vec<Channel>,
    duration: f64,
    instances: Vec<Placed>,
    skins: Vec<Skin>,
    /// For each mesh that deforms; others have none.
    reaches: Vec<Option<Reach>>,
    lights: Vec<(Light, Option<u32>)>,
    cameras: Vec<(Camera, Option<u32>)>,
    animated: bool,
}

const STILL: u32 = u32::MAX;

#[derive(Clone, Debug)]
struct Moving {
    parent: Option<u32>,
    local: Local,
    /// Channels of translation, rotation and scale.
    channels: [Option<usize>; 3],
}

#[derive(Clone, Debug)]
struct Placed {
    world_from_object: DAffine3,
    node: Option<u32>,
    skin: Option<u32>,
    mesh: u32,
    /// Morph weights in the rest pose; empty where nothing morphs.
    weights: Vec<f32>,
    weight_channel: Option<usize>,
    moves: bool,
    changes: bool,
}

/// A scene at one time. All tables but lights and cameras are parallel to [`Scene::instances`].
///
/// An animation may make a transform singular (a scale of zero), and one from a hostile file may leave every range: whoever
/// uses a transform checks it, as for the rest pose of a scene made in code.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pose {
    /// World from object.
    pub instances: Vec<DAffine3>,
    /// Object-from-bind matrices of the joints of skinned instances, `inverse(instance) * joint * inverse_bind`; empty for others.
    pub joints: Vec<Vec<DAffine3>>,
    /// Weights of all morph targets of instances that morph; empty for others.
    pub weights: Vec<Vec<f32>>,
    /// A box around the vertices of instances that deform, object space, wide enough for the rounding of a shader that works in
    /// `f32`; `None` for others, whose vertices are those of the mesh.
    pub bounds: Vec<Option<[Vec3; 2]>>,
    /// [`Scene::lights`], moved.
    pub lights: Vec<Light>,
    /// [`Scene::cameras`], moved.
    pub cameras: Vec<Camera>,
}

impl Animator {
    /// Plays the first animation of a scene, or holds the rest pose of one that has none.
    pub fn new(scene: &Scene) -> Self {
        Self::play(scene, (!scene.animations.is_empty()).then_some(0))
    }

    /// Plays the animation of a name; where none has it, that of an index.
    ///
    /// # Errors
    /// [`SceneError::Animation`] when there is none.
    pub fn with_animation(scene: &Scene, which: &str) -> Result<Self, SceneError> {
        let named = scene.animations.iter().position(|a| a.name == which);
        let counted = || which.parse::<usize>().ok().filter(|i| *i < scene.animations.len());
        match named.or_else(counted) {
            Some(animation) => Ok(Self::play(scene, Some(animation))),
            None => Err(SceneError::Animation {
                name: which.to_owned(),
                known: scene.animations.iter().map(|a| a.name.clone()).collect(),
            }),
        }
    }

    /// Holds the rest pose.
    pub fn still(scene: &Scene) -> Self {
        Self::play(scene, None)
    }

    fn play(scene: &Scene, animation: Option<usize>) -> Self {
        let animation = animation.map(|a| &scene.animations[a]);
        let channels = animation.map_or(Vec::new(), |a| a.channels.clone());
        let (slots, moving) = moving(&scene.nodes, &channels);
        let moves = |node: Option<u32>| node.is_some_and(|n| slots[n as usize] != STILL);

        let mut weight_channels = vec![None; scene.nodes.len()];
        for (i, channel) in channels.iter().enumerate().filter(|(_, c)| c.property == Property::Weights) {
            weight_channels[channel.node as usize] = Some(i);
        }
        let skin_moves: Vec<bool> =
            scene.skins.iter().map(|s| s.joints.iter().any(|j| slots[*j as usize] != STILL)).collect();
        let mut reaches = vec![None; scene.meshes.len()];
        let instances: Vec<Placed> = scene
            .instances
            .iter()
            .map(|i| {
                let mesh = &scene.meshes[i.mesh as usize];
                let skin = i.skin.filter(|_| !mesh.influences.is_empty());
                let weight_channel = i.node.and_then(|n| weight_channels[n as usize]);
                let own = i.node.map(|n| &scene.nodes[n as usize].weights).filter(|w| !w.is_empty());
                let mut weights = own.unwrap_or(&mesh.weights).clone();
                weights.resize(mesh.targets.len(), 0.0);
                if weight_channel.is_none() && weights.iter().all(|w| *w == 0.0) {
                    weights.clear();
                }
                let weight_channel = weight_channel.filter(|_| !weights.is_empty());
                if skin.is_some() || !weights.is_empty() {
                    reaches[i.mesh as usize].get_or_insert_with(|| Reach::of(mesh));
                }
                let moves = moves(i.node);
                let bends = skin.is_some_and(|s| moves || skin_moves[s as usize]);
                let changes = bends || weight_channel.is_some();
                let (world_from_object, node, mesh) = (i.world_from_object, i.node, i.mesh);
                Placed { world_from_object, node, skin, mesh, weights, weight_channel, moves, changes }
            })
            .collect();
        let follow = |nodes: &[Option<u32>], i: usize| nodes.get(i).copied().flatten().filter(|n| moves(Some(*n)));
        let lights: Vec<_> =
            scene.lights.iter().enumerate().map(|(i, l)| (l.clone(), follow(&scene.light_nodes, i))).collect();
        let cameras: Vec<_> =
            scene.cameras.iter().enumerate().map(|(i, c)| (c.clone(), follow(&scene.camera_nodes, i))).collect();
        let animated = instances.iter().any(|i| i.moves || i.changes)
            || lights.iter().any(|(_, n)| n.is_some())
            || cameras.iter().any(|(_, n)| n.is_some());
        Self {
            rest: rest_worlds(&scene.nodes),
            slots,
            moving,
            duration: animation.map_or(0.0, |a| a.duration),
            channels,
            instances,
            skins: scene.skins.clone(),
            reaches,
            lights,
            cameras,
            animated,
        }
    }

    /// Whether any pose differs from another.
    pub fn is_animated(&self) -> bool {
        self.animated
    }

    /// Seconds until the animation begins again; 0 without one.
    pub fn duration(&self) -> f64 {
        self.duration
    }

    /// Whether the transform of an instance changes with time: its node or an ancestor is animated.
    pub fn moves(&self, instance: usize) -> bool {
        self.instances[instance].moves
    }

    /// Whether the vertices of an instance are others than its mesh's: it is skinned, or morphs in some pose. They may still be
    /// the same in every pose, see [`changes`](Self::changes).
    pub fn deforms(&self, instance: usize) -> bool {
        let placed = &self.instances[instance];
        placed.skin.is_some() || !placed.weights.is_empty()
    }

    /// Whether a light ever moves.
    pub fn moves_light(&self, light: usize) -> bool {
        self.lights[light].1.is_some()
    }

    /// Whether the vertices of an instance change with time.
    pub fn changes(&self, instance: usize) -> bool {
        self.instances[instance].changes
    }

    /// Where everything is at a time in seconds, which loops over the animation.
    ///
    /// A skinned instance stands where its node does, though glTF gives that no meaning: so its vertices are near its origin,
    /// and its joints carry the rest. Where the node's transform has no good inverse, it stands at the world's origin.
    ///
    /// A light on a node is at its origin and shines along its -z, as KHR_lights_punctual has it; a rectangle, which glTF does
    /// not know, keeps its place relative to the node. What has no direction in a pose keeps that of the rest pose.
    pub fn pose(&self, time: f64) -> Pose {
        let time = if self.duration > 0.0 { time.rem_euclid(self.duration) } else { 0.0 };
        let mut worlds: Vec<DAffine3> = Vec::with_capacity(self.moving.len());
        for node in &self.moving {
            let local = self.local(node, time);
            worlds.push(match node.parent {
                None => local,
                Some(parent) => self.world(&worlds, parent) * local,
            });
        }
        let count = self.instances.len();
        let mut pose = Pose {
            instances: Vec::with_capacity(count),
            joints: vec![Vec::new(); count],
            weights: vec![Vec::new(); count],
            bounds: vec![None; count],
            lights: self.lights.iter().map(|(l, n)| self.light(l, *n, &worlds)).collect(),
            cameras: self.cameras.iter().map(|(c, n)| self.camera(c, *n, &worlds)).collect(),
        };
        for (i, placed) in self.instances.iter().enumerate() {
            let mut here = match placed.node.filter(|_| placed.moves) {
                Some(node) => self.world(&worlds, node),
                None => placed.world_from_object,
            };
            if let Some(skin) = placed.skin {
                let skin = &self.skins[skin as usize];
                let inverse = good_inverse(&here);
                if inverse.is_none() {
                    here = DAffine3::IDENTITY;
                }
                let object_from_world = inverse.unwrap_or(DAffine3::IDENTITY);
                let joint = |(joint, bind): (&u32, &DAffine3)| object_from_world * self.world(&worlds, *joint) * *bind;
                pose.joints[i] = skin.joints.iter().zip(&skin.inverse_bind).map(joint).collect();
            }
            if !placed.weights.is_empty() {
                let mut weights = placed.weights.clone();
                if let Some(channel) = placed.weight_channel {
                    self.channels[channel].weights(time, &mut weights);
                }
                pose.weights[i] = weights;
            }
            if placed.skin.is_some() || !placed.weights.is_empty() {
                let reach = self.reaches[placed.mesh as usize].as_ref();
                pose.bounds[i] = reach.and_then(|r| r.bounds(&pose.joints[i], &pose.weights[i]));
            }
            pose.instances.push(here);
        }
        pose
    }

    fn local(&self, node: &Moving, time: f64) -> DAffine3 {
        let Local::Trs { mut translation, mut rotation, mut scale } = node.local else {
            return node.local.affine();
        };
        let [t, r, s] = node.channels.map(|c| c.map(|c| &self.channels[c]));
        if let Some(channel) = t {
            translation = channel.vector(time);
        }
        if let Some(channel) = r {
            rotation = channel.rotation(time);
        }
        if let Some(channel) = s {
            scale = channel.vector(time);
        }
        DAffine3::from_scale_rotation_translation(scale, rotation, translation)
    }

    fn world(&self, worlds: &[DAffine3], node: u32) -> DAffine3 {
        match self.slots[node as usize] {
            STILL => self.rest[node as usize],
            slot => worlds[slot as usize],
        }
    }

    fn light(&self, light: &Light, node: Option<u32>, worlds: &[DAffine3]) -> Light {
        let mut light = light.clone();
        let Some(node) = node else { return light };
        let world = self.world(worlds, node);
        let along = (-world.matrix3.z_axis).try_normalize().map(|d| d.as_vec3());
        let origin = world.translation;
        match &mut light {
            Light::Directional { direction, .. } => *direction = along.unwrap_or(*direction),
            Light::Point { position, .. } => *position = origin,
            Light::Sphere { centre, .. } => *centre = origin,
            Light::Disc { centre, normal, .. } => {
                *centre = origin;
                *normal = along.unwrap_or(*normal);
            }
            Light::Spot { position, direction, .. } => {
                *position = origin;
                *direction = along.unwrap_or(*direction);
            }
            Light::Rectangle { centre, half_u, half_v, .. } => {
                if let Some(inverse) = good_inverse(&self.rest[node as usize]) {
                    let by = world * inverse;
                    *centre = by.transform_point3(*centre);
                    *half_u = by.transform_vector3(half_u.as_dvec3()).as_vec3();
                    *half_v = by.transform_vector3(half_v.as_dvec3()).as_vec3();
                }
            }
        }
        light
    }

    fn camera(&self, camera: &Camera, node: Option<u32>, worlds: &[DAffine3]) -> Camera {
        let mut camera = camera.clone();
        if let Some(node) = node {
            let world = self.world(worlds, node);
            let matrix3 = Camera::rigid(world.matrix3).unwrap_or(camera.world_from_camera.matrix3);
            camera.world_from_camera = DAffine3 { matrix3, translation: world.translation };
        }
        camera
    }
}

/// The nodes that channels move, and the place of every node among them.
fn moving(nodes: &[Node], channels: &[Channel]) -> (Vec<u32>, Vec<Moving>) {
    let mut own: Vec<[Option<usize>; 3]> = vec![[None; 3]; if channels.is_empty() { 0 } else { nodes.len() }];
    for (i, channel) in channels.iter().enumerate() {
        let place = match channel.property {
            Property::Translation => 0,
            Property::Rotation => 1,
            Property::Scale => 2,
            Property::Weights => continue,
        };
        if matches!(nodes[channel.node as usize].local, Local::Trs { .. }) {
            own[channel.node as usize][place] = Some(i);
        }
    }
    let mut slots = vec![STILL; nodes.len()];
    let mut moving = Vec::new();
    for (i, channels) in own.into_iter().enumerate() {
        let parent = nodes[i].parent;
        if channels != [None; 3] || parent.is_some_and(|p| slots[p as usize] != STILL) {
            slots[i] = moving.len() as u32;
            moving.push(Moving { parent, local: nodes[i].local, channels });
        }
    }
    (slots, moving)
}

/// The inverse of a transform that loses little: its axes are of ordinary length and none lies in the plane of the others.
pub(super) fn good_inverse(m: &DAffine3) -> Option<DAffine3> {
    let lengths = DVec3::from_array([0, 1, 2].map(|c| m.matrix3.col(c).length()));
    let ordinary = lengths.min_element() >= 1e-6 && lengths.max_element() <= 1e6;
    let volume = m.matrix3.determinant().abs() / lengths.element_product();
    (ordinary && m.translation.is_finite() && volume >= 1e-6).then(|| m.inverse())
}

#[cfg(test)]
#[path = "pose_tests.rs"]
mod tests;
