//! Scripted motion, the same for every scene.
use glam::{DAffine3, DQuat, DVec3, Quat, Vec3};
use magpie::scene::{Animation, Camera, Channel, Instance, Interpolation, Light, Local, Node, Property, Scene};

/// Time between two frames, seconds.
const FRAME: f64 = 1.0 / 60.0;
/// Rotation of the camera per frame, radians.
const CAMERA_TURN: f64 = 0.01;
/// Rotation of the lights about the world's vertical axis per frame, radians.
const LIGHT_TURN: f64 = 0.005;

/// Rotation of the circling lamp over the whole path, radians.
const LAMP_TURN: f64 = 1.5;
/// Time in which a door opens and a lamp is at its other place, seconds.
const SOON: f64 = 0.1;
/// Longer than any path, seconds.
const LONG: f64 = 1000.0;

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
    /// Index of the frame from which on nothing moves or changes; none where something does so to the end.
    pub settles: Option<usize>,
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
    let mut paths =
        vec![Path { name: "still", scene: scene.clone(), before: None, moments: still_moments, settles: Some(0) }];
    paths.push(Path { name: "camera", scene: scene.clone(), before: Some(still(0.0)), moments, settles: None });
    if !scene.animations.is_empty() {
        let moments = all(&|frame| still(at(frame)));
        paths.push(Path { name: "things", scene: scene.clone(), before: Some(still(0.0)), moments, settles: None });
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
            settles: None,
        });
        let (before, moments) = (Some(Moment { light: 0.0, ..still(0.0) }), all(&|_| still(0.0)));
        paths.push(Path { name: "switch", scene: scene.clone(), before, moments, settles: Some(0) });
    }
    paths
}

/// Paths for indirect light, beside the others: the lights go off, a coloured lamp circles around what the camera looks at or goes to another place and
/// stays, and a thing of this name, or with it in its name, slides aside, if there is one that nothing moves.
#[must_use]
pub fn paths_of_light(scene: &Scene, frames: u32, door: &str) -> Vec<Path> {
    let Some(camera) = scene.cameras.first() else { return Vec::new() };
    let still = |time: f64| Moment { camera: camera.clone(), time, light: 1.0 };
    let path = |name, scene, seconds: Option<f64>| {
        let moments = (0..frames).map(|frame| still(FRAME * f64::from(frame))).collect();
        let settles = seconds.map(|seconds| (seconds / FRAME - 1e-6).ceil() as usize);
        Path { name, scene, before: Some(still(0.0)), moments, settles }
    };
    let mut paths = Vec::new();
    if !scene.lights.is_empty() {
        let dark = |_| Moment { light: 0.0, ..still(0.0) };
        paths.push(Path { moments: (0..frames).map(dark).collect(), ..path("off", scene.clone(), Some(0.0)) });
    }
    let around = |k: u32| DQuat::from_rotation_y(f64::from(k) / 8.0 * LAMP_TURN) * DVec3::X;
    let circle: Vec<DVec3> = (0..=8).map(around).collect();
    let right = camera.world_from_camera.matrix3.x_axis.normalize();
    paths.push(path("lamp", with_moving_lamp(scene, camera, &circle, FRAME * f64::from(frames)), None));
    paths.push(path("aside", with_moving_lamp(scene, camera, &[right, -right], SOON), Some(SOON)));
    let name = |i: &Instance| i.name.to_lowercase();
    let door = door.to_lowercase();
    let find = |is_it: &dyn Fn(&Instance) -> bool| {
        scene.instances.iter().position(|i| i.node.is_none() && i.skin.is_none() && is_it(i))
    };
    if let Some(door) = find(&|i| name(i) == door).or_else(|| find(&|i| name(i).contains(&door))) {
        paths.push(path("door", with_opening_door(scene, door), Some(SOON)));
    }
    paths
}

/// Adds a lamp that is brighter than all others and goes from place to place around the middle of the picture, each in a unit direction from there, in so
/// many seconds to the last.
fn with_moving_lamp(scene: &Scene, camera: &Camera, places: &[DVec3], seconds: f64) -> Scene {
    let mut moving = scene.clone();
    moving.animations.clear();
    let forward = -camera.world_from_camera.matrix3.z_axis;
    let distance = distance_along(scene, camera.eye(), forward).unwrap_or(1e3 * f64::from(camera.near));
    let centre = camera.eye() + 0.85 * distance * forward;
    let (across, radius) = (0.2 * distance, (0.01 * distance) as f32);
    // The same for scenes of any size: on a surface at the distance of the circle, light of some suns.
    let radiance = Vec3::new(12.0, 4.0, 1.5) * (across as f32 / radius).powi(2);
    moving.light_nodes.resize(moving.lights.len(), None);
    moving.light_nodes.push(Some(moving.nodes.len() as u32));
    let places: Vec<Vec3> = places.iter().map(|place| (centre + across * *place).as_vec3()).collect();
    moving.lights.push(Light::Sphere { centre: places[0].as_dvec3(), radius, radiance });
    moves(&mut moving, "lamp", DQuat::IDENTITY, DVec3::ONE, &places, seconds);
    moving
}

/// Lets a thing slide aside by its width, from the first frame on.
fn with_opening_door(scene: &Scene, door: usize) -> Scene {
    let mut moving = scene.clone();
    moving.animations.clear();
    let world = moving.instances[door].world_from_object;
    let [low, high] = moving.meshes[moving.instances[door].mesh as usize].bounds().unwrap_or_default();
    let size = (high - low).as_dvec3();
    let along = if size.x > size.z { DVec3::X * size.x } else { DVec3::Z * size.z };
    let (scale, rotation, from) = world.to_scale_rotation_translation();
    let to = from + world.transform_vector3(along);
    moving.instances[door].node = Some(moving.nodes.len() as u32);
    moves(&mut moving, "door", rotation, scale, &[from.as_vec3(), to.as_vec3()], SOON);
    moving
}

/// Adds a node that goes from place to place, in so many seconds to the last, where it stays.
fn moves(scene: &mut Scene, name: &str, rotation: DQuat, scale: DVec3, places: &[Vec3], seconds: f64) {
    let node = scene.nodes.len() as u32;
    let local = Local::Trs { translation: places[0].as_dvec3(), rotation, scale };
    scene.nodes.push(Node { name: name.to_owned(), local, ..Node::default() });
    let step = seconds / (places.len() - 1) as f64;
    let mut times: Vec<f32> = (0..places.len()).map(|k| (step * k as f64) as f32).collect();
    let mut values: Vec<f32> = places.iter().flat_map(|place| place.to_array()).collect();
    // Animations repeat: this one not within any path.
    times.push(LONG as f32);
    values.extend(places[places.len() - 1].to_array());
    scene.animations.push(Animation {
        name: name.to_owned(),
        duration: LONG,
        channels: vec![Channel {
            node,
            property: Property::Translation,
            interpolation: Interpolation::Linear,
            times,
            values,
        }],
    });
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
    use magpie::scene::{Animator, Pose};

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

    #[test]
    fn a_lamp_circles_and_a_door_opens() {
        let mut scene = magpie::scene::builtin("cornell").unwrap();
        assert_eq!(
            paths_of_light(&scene, 4, "door").iter().map(|p| p.name).collect::<Vec<_>>(),
            ["off", "lamp", "aside"]
        );
        let door = scene.instances.iter().position(|i| i.name == "short block").unwrap();
        scene.instances[door].name = "Door".to_owned();
        scene.instances[door - 1].name = "door frame".to_owned();
        let paths = paths_of_light(&scene, 24, "door");
        assert_eq!(paths.iter().map(|p| p.name).collect::<Vec<_>>(), ["off", "lamp", "aside", "door"]);
        for path in &paths[1..] {
            let animator = Animator::new(&path.scene);
            let [first, last] = [0, 23].map(|k: usize| animator.pose(path.moments[k].time));
            let lamp = path.scene.lights.len() - 1;
            let [(from, _), (to, _)] = [&first, &last].map(|pose| stand(&pose.lights[lamp]));
            let went = first.instances[door].translation.distance(last.instances[door].translation);
            // The block is 2.08 m wide.
            assert_eq!(went > 1.5, path.name == "door", "{}: the door went {went} m", path.name);
            assert_eq!(from.distance(to) > 1.0, path.name != "door", "{}: from {from} to {to}", path.name);
            if let Some(settles) = path.settles {
                let [at, before] = [settles, settles - 1].map(|k| animator.pose(path.moments[k].time));
                let place = |pose: &Pose| (pose.instances[door].translation, stand(&pose.lights[lamp]).0);
                assert!(
                    place(&at).0.distance(place(&last).0) + place(&at).1.distance(place(&last).1) < 1e-3,
                    "{}",
                    path.name
                );
                assert!(place(&before) != place(&last), "{} settles before", path.name);
            }
        }
    }
}
