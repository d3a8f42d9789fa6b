//! Scripted motion, the same for every scene.
use glam::{DAffine3, DQuat, DVec3, Quat, Vec3};
use magpie::scene::{Animation, Camera, Channel, Interpolation, Light, Local, Node, Property, Scene};

/// Time between two frames, seconds.
const FRAME: f64 = 1.0 / 60.0;
/// Rotation of the camera per frame, radians.
const CAMERA_TURN: f64 = 0.01;
/// Rotation of the lights about the world's vertical axis per frame, radians.
const LIGHT_TURN: f64 = 0.005;

/// State of the scene in a frame.
#[derive(Clone, Debug)]
pub struct Moment {
    /// The camera.
    pub camera: Camera,
    /// Scene time, seconds.
    pub time: f64,
    /// Factor of all lights' intensity.
    pub light: f32,
}

/// A scene with the moments to render.
#[derive(Clone, Debug)]
pub struct Path {
    /// Name in tables and file names.
    pub name: &'static str,
    /// The scene.
    pub scene: Scene,
    /// State in the frames before the path, which fill the history; none for the first moment.
    pub before: Option<Moment>,
    /// State of each frame.
    pub moments: Vec<Moment>,
}

impl Path {
    /// Whether nothing moves or changes.
    #[must_use]
    pub fn is_still(&self) -> bool {
        matches!(self.name, "still" | "switch")
    }
}

/// A camera that can orbit a point.
pub trait Turned {
    /// Rotated about the vertical axis through `around` by this angle, radians.
    #[must_use]
    fn turned(&self, around: DVec3, angle: f64) -> Self;
}

impl Turned for Camera {
    fn turned(&self, around: DVec3, angle: f64) -> Self {
        let turn = DAffine3::from_translation(around)
            * DAffine3::from_quat(DQuat::from_rotation_y(angle))
            * DAffine3::from_translation(-around);
        Self { world_from_camera: turn * self.world_from_camera, ..self.clone() }
    }
}

/// Cameras of an orbit around what a camera sees in the middle of its picture, frame by frame, starting with the camera itself.
#[must_use]
pub fn around(scene: &Scene, camera: &Camera, frames: u32) -> Vec<Camera> {
    let forward = -camera.world_from_camera.matrix3.z_axis;
    // Cameras that look at nothing go around a point a thousand near planes away.
    let distance = distance_along(scene, camera.eye(), forward).unwrap_or(1e3 * f64::from(camera.near));
    let centre = camera.eye() + forward * distance;
    (0..frames).map(|frame| camera.turned(centre, CAMERA_TURN * f64::from(frame))).collect()
}

/// Distance to the first triangle along a ray of unit direction in the scene's rest pose, metres.
fn distance_along(scene: &Scene, from: DVec3, direction: DVec3) -> Option<f64> {
    let mut nearest: Option<f64> = None;
    for instance in &scene.instances {
        let mesh = &scene.meshes[instance.mesh as usize];
        let object_from_world = instance.world_from_object.inverse();
        let (o, d) = (object_from_world.transform_point3(from), object_from_world.transform_vector3(direction));
        for corners in mesh.indices.as_chunks::<3>().0 {
            let [a, b, c] = corners.map(|i| mesh.positions[i as usize].as_dvec3());
            // Möller and Trumbore 1997, "Fast, Minimum Storage Ray/Triangle Intersection".
            let (ab, ac, ao) = (b - a, c - a, o - a);
            let (p, q) = (d.cross(ac), ao.cross(ab));
            let scale = 1.0 / ab.dot(p);
            let (u, v, t) = (ao.dot(p) * scale, d.dot(q) * scale, ac.dot(q) * scale);
            if u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0 && nearest.is_none_or(|n| t < n) {
                nearest = Some(t);
            }
        }
    }
    nearest
}

/// The paths of a scene: nothing moves from the first frame on, the camera orbits, the lights turn, animations play, and the lights are switched on.
#[must_use]
pub fn paths(scene: &Scene, frames: u32) -> Vec<Path> {
    let Some(camera) = scene.cameras.first() else { return Vec::new() };
    let still = |time: f64| Moment { camera: camera.clone(), time, light: 1.0 };
    let all = |moment: &dyn Fn(u32) -> Moment| (0..frames).map(moment).collect::<Vec<_>>();
    let at = |frame: u32| FRAME * f64::from(frame);
    let moments = around(scene, camera, frames).into_iter().map(|camera| Moment { camera, ..still(0.0) }).collect();
    let still_moments = all(&|_| still(0.0));
    let mut paths = vec![Path { name: "still", scene: scene.clone(), before: None, moments: still_moments }];
    paths.push(Path { name: "camera", scene: scene.clone(), before: Some(still(0.0)), moments });
    if !scene.animations.is_empty() {
        let moments = all(&|frame| still(at(frame)));
        paths.push(Path { name: "things", scene: scene.clone(), before: Some(still(0.0)), moments });
    }
    if !scene.lights.is_empty() {
        let mut moving = scene.clone();
        moving.animations.clear();
        turn_lights(&mut moving, at(frames));
        paths.push(Path {
            name: "lights",
            scene: moving,
            before: Some(still(0.0)),
            moments: all(&|frame| still(at(frame))),
        });
        let before = Some(Moment { light: 0.0, ..still(0.0) });
        paths.push(Path { name: "switch", scene: scene.clone(), before, moments: all(&|_| still(0.0)) });
    }
    paths
}

/// Position and orientation of a light: the transform of a node that carries it.
#[must_use]
pub fn stand(light: &Light) -> (DVec3, DQuat) {
    let to = |direction: &Vec3| DQuat::from_rotation_arc(DVec3::NEG_Z, direction.as_dvec3().normalize());
    match light {
        Light::Directional { direction, .. } => (DVec3::ZERO, to(direction)),
        Light::Point { position, .. } => (*position, DQuat::IDENTITY),
        Light::Spot { position, direction, .. } => (*position, to(direction)),
        Light::Rectangle { .. } => (DVec3::ZERO, DQuat::IDENTITY), // its own position is relative to the node
        Light::Disc { centre, normal, .. } => (*centre, to(normal)),
        Light::Sphere { centre, .. } => (*centre, DQuat::IDENTITY),
    }
}

/// Attaches every unattached light to a node that rotates for `seconds`.
fn turn_lights(scene: &mut Scene, seconds: f64) {
    let node = scene.nodes.len() as u32;
    scene.nodes.push(Node { name: "turn".to_owned(), ..Node::default() });
    scene.light_nodes.resize(scene.lights.len(), None);
    for (light, hangs_on) in scene.lights.iter().zip(&mut scene.light_nodes).filter(|(_, on)| on.is_none()) {
        *hangs_on = Some(scene.nodes.len() as u32);
        let (translation, rotation) = stand(light);
        let local = Local::Trs { translation, rotation, scale: DVec3::ONE };
        scene.nodes.push(Node { name: "light".to_owned(), parent: Some(node), local, ..Node::default() });
    }
    // Keys at quarters of the way keep each rotation well below half a turn.
    let keys: Vec<f64> = (0..=4).map(|k| seconds * f64::from(k) / 4.0).collect();
    let turn = |time: &f64| Quat::from_axis_angle(Vec3::Y, (LIGHT_TURN * time / FRAME) as f32);
    scene.animations.push(Animation {
        name: "turn".to_owned(),
        duration: seconds,
        channels: vec![Channel {
            node,
            property: Property::Rotation,
            interpolation: Interpolation::Linear,
            times: keys.iter().map(|time| *time as f32).collect(),
            values: keys.iter().flat_map(|time| turn(time).to_array()).collect(),
        }],
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_goes_around_what_it_looks_at() {
        let centre = DVec3::new(1.0, 2.0, 3.0);
        let camera = Camera::look_at("c", DVec3::new(5.0, 4.0, 3.0), centre, Vec3::Y, 0.7).unwrap();
        for angle in [0.0, 0.5, 3.0] {
            let turned = camera.turned(centre, angle);
            assert!((turned.eye().distance(centre) - camera.eye().distance(centre)).abs() < 1e-12);
            let forward = -turned.world_from_camera.matrix3.z_axis;
            assert!(forward.dot((centre - turned.eye()).normalize()) > 1.0 - 1e-6, "{angle}"); // cameras are rounded to 32 bits
        }
    }

    #[test]
    fn a_camera_goes_around_what_is_in_the_middle_of_its_picture() {
        for name in ["courtyard", "cornell"] {
            let scene = magpie::scene::builtin(name).unwrap();
            let camera = &scene.cameras[0];
            let forward = -camera.world_from_camera.matrix3.z_axis;
            let seen = distance_along(&scene, camera.eye(), forward).unwrap();
            assert!((2.0..20.0).contains(&seen), "{name}: {seen} m");
            let cameras = around(&scene, camera, 32);
            let path: f64 = cameras.windows(2).map(|pair| pair[0].eye().distance(pair[1].eye())).sum();
            assert!((path - 31.0 * CAMERA_TURN * seen).abs() < 0.01 * path, "{name}: {path} m around {seen} m");
        }
        assert!(distance_along(&Scene::default(), DVec3::ZERO, DVec3::X).is_none());
    }

    #[test]
    fn scenes_have_the_paths_that_they_can_have() {
        let names = |scene: &Scene| paths(scene, 4).iter().map(|p| p.name).collect::<Vec<_>>();
        let scene = magpie::scene::builtin("courtyard").unwrap();
        assert_eq!(names(&scene), ["still", "camera", "lights", "switch"]);
        assert_eq!(names(&Scene { lights: Vec::new(), ..scene }), ["still", "camera"]);
        assert_eq!(names(&magpie::scene::builtin("carousel").unwrap())[2], "things");
    }
}
