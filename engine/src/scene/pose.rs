//! Evaluates animations: where everything is at a given time.
use super::animation::{Channel, Local, Node, Property, Skin, rest_worlds};
use super::pose_bounds::PoseBounds;
use super::{Camera, Light, Scene, SceneError};
use glam::{DAffine3, DVec3, Vec3};

/// Plays one animation of a scene. It copies what it needs, without vertices and textures.
///
/// If [`is_animated`](Self::is_animated) is false, every pose is the same and needs to be computed only once.
#[derive(Clone, Debug)]
pub struct Animator {
    /// World-from-node transforms in the rest pose.
    rest: Vec<DAffine3>,
    /// Index in `moving` of every node, or [`STILL`].
    slots: Vec<u32>,
    /// Nodes that are animated, directly or through an ancestor; parents before children.
    moving: Vec<Moving>,
    channels: Vec<Channel>,
    duration: f64,
    instances: Vec<Placed>,
    skins: Vec<Skin>,
    /// Bounds of each mesh that some instance deforms.
    pose_bounds: Vec<Option<PoseBounds>>,
    lights: Vec<(Light, Option<u32>)>,
    /// Indices of the lights that move.
    moving_lights: Vec<u32>,
    cameras: Vec<(Camera, Option<u32>)>,
    animated: bool,
}

const STILL: u32 = u32::MAX;

#[derive(Clone, Debug)]
struct Moving {
    parent: Option<u32>,
    local: Local,
    /// Indices of the channels of translation, rotation and scale.
    channels: [Option<usize>; 3],
}

#[derive(Clone, Debug)]
struct Placed {
    world_from_object: DAffine3,
    node: Option<u32>,
    skin: Option<u32>,
    mesh: u32,
    /// Morph weights in the rest pose; empty if the instance never morphs.
    weights: Vec<f32>,
    weight_channel: Option<usize>,
    moves: bool,
    changes: bool,
}

/// The state of a scene at one time. All tables except lights and cameras are parallel to [`Scene::instances`].
///
/// An animation may make a transform singular (scale 0), and one from an untrusted file may exceed any range. Users must check
/// transforms, as for the rest pose of a scene made by code.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pose {
    /// World-from-object transforms.
    pub instances: Vec<DAffine3>,
    /// Object-from-bind matrices of the joints of skinned instances, `inverse(instance) * joint * inverse_bind`; empty for others.
    pub joints: Vec<Vec<DAffine3>>,
    /// Weights of all morph targets of morphing instances; empty for others.
    pub weights: Vec<Vec<f32>>,
    /// Bounding boxes of the vertices of deforming instances, object space, widened for the rounding errors of shaders in `f32`;
    /// `None` for others, whose vertices are those of the mesh.
    pub bounds: Vec<Option<[Vec3; 2]>>,
    /// [`Scene::lights`] at this time.
    pub lights: Vec<Light>,
    /// [`Scene::cameras`] at this time.
    pub cameras: Vec<Camera>,
}

impl Animator {
    /// Plays the first animation of a scene; holds the rest pose if there is none.
    pub fn new(scene: &Scene) -> Self {
        Self::play(scene, (!scene.animations.is_empty()).then_some(0))
    }

    /// Plays the animation with this name, or else with this index.
    ///
    /// # Errors
    /// [`SceneError::Animation`] if there is no such animation.
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

    /// Holds the rest pose of a scene.
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
        let mut pose_bounds = vec![None; scene.meshes.len()];
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
                    pose_bounds[i.mesh as usize].get_or_insert_with(|| PoseBounds::of(mesh));
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
        let moving_lights = (0..).zip(&lights).filter(|(_, (_, node))| node.is_some()).map(|(i, _)| i).collect();
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
            pose_bounds,
            lights,
            moving_lights,
            cameras,
            animated,
        }
    }

    /// Whether the pose depends on time.
    pub fn is_animated(&self) -> bool {
        self.animated
    }

    /// Length of the animation loop, seconds; 0 without an animation.
    pub fn duration(&self) -> f64 {
        self.duration
    }

    /// Whether the transform of an instance changes with time: its node or an ancestor is animated.
    pub fn moves(&self, instance: usize) -> bool {
        self.instances[instance].moves
    }

    /// Whether the vertices of an instance differ from those of its mesh: it is skinned, or it morphs in some pose. They may be
    /// the same in every pose; see [`changes`](Self::changes).
    pub fn deforms(&self, instance: usize) -> bool {
        let placed = &self.instances[instance];
        placed.skin.is_some() || !placed.weights.is_empty()
    }

    /// Whether a light ever moves.
    pub fn moves_light(&self, light: usize) -> bool {
        self.lights[light].1.is_some()
    }

    /// The lights that move, by index, in order.
    pub fn moving_lights(&self) -> &[u32] {
        &self.moving_lights
    }

    /// Whether the vertices of an instance change with time.
    pub fn changes(&self, instance: usize) -> bool {
        self.instances[instance].changes
    }

    /// The pose at a time in seconds, which wraps around the length of the animation.
    ///
    /// A skinned instance gets the transform of its node, although glTF ignores that, so that its vertices are near its origin;
    /// its joint matrices compensate. If the node's transform is not safely invertible, the instance gets the identity.
    ///
    /// A light on a node is at the node's origin and shines along its -z, as in KHR_lights_punctual; a rectangle, which glTF does not
    /// have, keeps its transform relative to the node. A light whose direction is undefined in a pose keeps that of the rest pose.
    pub fn pose(&self, time: f64) -> Pose {
        self.pose_with(time, self.lights.iter().map(|(light, _)| light.clone()).collect())
    }

    /// The same with the lights of an earlier pose: of them only those that move are computed, as there may be many.
    pub fn pose_with(&self, time: f64, mut lights: Vec<Light>) -> Pose {
        let time = if self.duration > 0.0 { time.rem_euclid(self.duration) } else { 0.0 };
        let mut worlds: Vec<DAffine3> = Vec::with_capacity(self.moving.len());
        for node in &self.moving {
            let local = self.local(node, time);
            worlds.push(match node.parent {
                None => local,
                Some(parent) => self.world(&worlds, parent) * local,
            });
        }
        for index in &self.moving_lights {
            let (light, node) = &self.lights[*index as usize];
            lights[*index as usize] = self.light(light, *node, &worlds);
        }
        let count = self.instances.len();
        let mut pose = Pose {
            instances: Vec::with_capacity(count),
            joints: vec![Vec::new(); count],
            weights: vec![Vec::new(); count],
            bounds: vec![None; count],
            lights,
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
                let pose_bounds = self.pose_bounds[placed.mesh as usize].as_ref();
                pose.bounds[i] = pose_bounds.and_then(|r| r.bounds(&pose.joints[i], &pose.weights[i]));
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

/// The index of every node in the list of animated nodes, and that list.
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

/// The inverse of a well-conditioned transform: its axes have moderate lengths and are far from coplanar.
pub(super) fn good_inverse(m: &DAffine3) -> Option<DAffine3> {
    let lengths = DVec3::from_array([0, 1, 2].map(|c| m.matrix3.col(c).length()));
    let ordinary = lengths.min_element() >= 1e-6 && lengths.max_element() <= 1e6;
    let volume = m.matrix3.determinant().abs() / lengths.element_product();
    (ordinary && m.translation.is_finite() && volume >= 1e-6).then(|| m.inverse())
}

#[cfg(test)]
#[path = "pose_tests.rs"]
mod tests;
