//! Rooms that are hard for diffuse indirect light. Surfaces are Lambertian and visible from both sides.
use crate::fixtures::{add, block, camera, material, plane, scene};
use glam::{Affine3A, DQuat, DVec3, Quat, Vec3};
use magpie::scene::{Animation, Camera, Channel, Interpolation, Light, Local, Material, Node, Property, Scene};
use std::f32::consts::PI;

/// Half the size of a room, metres.
const HALF: Vec3 = Vec3::new(2.0, 1.25, 2.0);

fn matte(albedo: impl Into<Vec3>) -> Material {
    Material { double_sided: true, specular: 0.0, ..material(albedo.into().to_array(), 0.0, 1.0) }
}

fn wide(eye: [f64; 3], target: [f64; 3]) -> Camera {
    let mut camera = camera(eye, target);
    camera.vertical_fov = 60_f32.to_radians();
    camera
}

fn at(x: f32, y: f32, z: f32) -> Affine3A {
    Affine3A::from_translation(Vec3::new(x, y, z))
}

/// A block between two corners.
fn between(s: &mut Scene, low: [f32; 3], high: [f32; 3], of: Material) {
    let (low, high) = (Vec3::from(low), Vec3::from(high));
    add(s, block(0.5 * (high - low)), of, Affine3A::from_translation(0.5 * (low + high)));
}

fn lamp(centre: [f64; 3], radius: f32, watts: Vec3) -> Light {
    // Of a sphere that shines with this radiance, power is 4 pi² radius² radiance.
    Light::Sphere { centre: centre.into(), radius, radiance: watts / (4.0 * PI * PI * radius * radius) }
}

/// A closed room, its floor at height 0.
fn closed(name: &str, albedo: impl Into<Vec3>, camera: Camera) -> Scene {
    let mut s = scene(name, camera);
    add(&mut s, block(HALF), matte(albedo), at(0.0, HALF.y, 0.0));
    s
}

/// A white room, albedo 0.8, with one small lamp: most light has bounced many times.
pub fn white() -> Scene {
    let mut s = closed("white room", [0.8; 3], wide([1.7, 1.5, 1.7], [-1.0, 0.9, -1.0]));
    s.lights.push(lamp([0.3, 2.0, -0.2], 0.05, Vec3::splat(40.0)));
    s
}

/// A room that is lit by an emissive panel and nothing else.
pub fn emissive() -> Scene {
    let mut s = closed("emissive room", [0.6, 0.55, 0.5], wide([1.7, 1.5, 1.7], [-1.0, 0.9, -1.0]));
    let panel = Material { emission: Vec3::new(12.0, 10.0, 7.0), ..matte([0.5; 3]) };
    add(&mut s, plane(0.5), panel, at(-0.6, 2.2, -0.5));
    between(&mut s, [-1.4, 0.0, -1.2], [-0.7, 1.0, -0.5], matte([0.7, 0.3, 0.2]));
    s
}

/// Thickness of the wall between two rooms, metres.
const PARTITION: f32 = 0.1;

/// Two rooms side by side, with an opening from z to z in the wall between them, and a lamp in the one to the right. The camera is in the
/// other, and does not look at the opening.
fn two_rooms(name: &str, opening: [f32; 2]) -> Scene {
    let mut s = scene(name, wide([-0.5, 1.4, 1.7], [-3.6, 0.7, -1.2]));
    add(&mut s, block(HALF * Vec3::new(2.0, 1.0, 1.0)), matte([0.7; 3]), at(0.0, HALF.y, 0.0));
    let half = 0.5 * PARTITION;
    let [from, to] = opening;
    between(&mut s, [-half, 0.0, -HALF.z], [half, 2.5, from], matte([0.7; 3]));
    between(&mut s, [-half, 0.0, to], [half, 2.5, HALF.z], matte([0.7; 3]));
    between(&mut s, [-half, 2.0, from], [half, 2.5, to], matte([0.7; 3]));
    s.lights.push(lamp([2.2, 1.9, 0.9], 0.15, Vec3::new(160.0, 140.0, 110.0)));
    s
}

/// A dark room with a door that is open by a slit, beside a bright one.
pub fn door_slit(width: f32) -> Scene {
    two_rooms("door slit", [-0.5 * width, 0.5 * width])
}

/// Seconds in which [`opening_door`] opens.
pub const DOOR_OPENS: f64 = 0.1;

/// The same with a door that slides open, all of it, from time 0 on.
pub fn opening_door() -> Scene {
    let mut s = two_rooms("opening door", [-0.4, 0.4]);
    let door = block(Vec3::new(0.02, 1.0, 0.42));
    add(&mut s, door, matte([0.6, 0.45, 0.3]), Affine3A::IDENTITY);
    let from = Vec3::new(0.5 * PARTITION + 0.03, 1.0, 0.0);
    let node = slide(&mut s, from, from + Vec3::new(0.0, 0.0, -0.85), DOOR_OPENS);
    let last = s.instances.len() - 1;
    s.instances[last].node = Some(node);
    s.instances[last].world_from_object.translation = from.as_dvec3();
    s
}

/// Adds a node that goes from one place to another in so many seconds, and stays there.
pub fn slide(s: &mut Scene, from: Vec3, to: Vec3, seconds: f64) -> u32 {
    let node = s.nodes.len() as u32;
    let local = Local::Trs { translation: from.as_dvec3(), rotation: DQuat::IDENTITY, scale: DVec3::ONE };
    s.nodes.push(Node { name: "slide".to_owned(), local, ..Node::default() });
    let values = [from, to, to].iter().flat_map(|p| p.to_array()).collect();
    s.animations.push(Animation {
        name: "slide".to_owned(),
        duration: 1000.0,
        channels: vec![Channel {
            node,
            property: Property::Translation,
            interpolation: Interpolation::Linear,
            times: vec![0.0, seconds as f32, 1000.0],
            values,
        }],
    });
    node
}

/// A room without a wall to the viewer, with a block in it and a coloured lamp.
pub fn coloured_lamp() -> Scene {
    let mut s = scene("coloured lamp", camera([0.0, 1.3, 5.6], [0.0, 1.1, 0.0]));
    let [w, d] = [HALF.x, HALF.z];
    between(&mut s, [-w, -0.1, -d], [w, 0.0, d], matte([0.6; 3]));
    between(&mut s, [-w, 2.5, -d], [w, 2.6, d], matte([0.6; 3]));
    between(&mut s, [-w, 0.0, -d - 0.1], [w, 2.5, -d], matte([0.6; 3]));
    between(&mut s, [-w - 0.1, 0.0, -d], [-w, 2.5, d], matte([0.6, 0.2, 0.2]));
    between(&mut s, [w, 0.0, -d], [w + 0.1, 2.5, d], matte([0.2, 0.6, 0.2]));
    between(&mut s, [-0.4, 0.0, -0.9], [0.4, 1.1, -0.2], matte([0.7; 3]));
    s.lights.push(lamp([-1.2, 1.8, 0.2], 0.1, Vec3::new(90.0, 50.0, 20.0)));
    s
}

/// The same with two lamps in one place, a red and a blue one, which give the same luminance.
pub fn lamp_of_two_colours() -> Scene {
    let mut s = coloured_lamp();
    s.lights = [Vec3::new(150.0, 15.0, 8.0), Vec3::new(10.0, 40.0, 170.0)]
        .map(|watts| lamp([-1.2, 1.8, 0.2], 0.1, watts))
        .into();
    s
}

/// The same with a lamp that goes to the other side within a tenth of a second, from time 0 on.
pub fn moving_lamp() -> Scene {
    let mut s = coloured_lamp();
    let from = Vec3::new(-1.2, 1.8, 0.2);
    let node = slide(&mut s, from, Vec3::new(1.3, 0.9, 0.9), 0.1);
    s.light_nodes = vec![Some(node)];
    if let Light::Sphere { centre, .. } = &mut s.lights[0] {
        *centre = from.as_dvec3();
    }
    s
}

/// A hall with so many small lamps of all colours under its ceiling.
pub fn lamps(count: u32) -> Scene {
    let mut s = scene("hall of lamps", wide([8.5, 2.2, 8.5], [-2.0, 1.2, -2.0]));
    add(&mut s, block(Vec3::new(10.0, 2.0, 10.0)), matte([0.6, 0.6, 0.55]), at(0.0, 2.0, 0.0));
    for k in 0..6_u8 {
        let (x, z) = (f32::from(k % 3) * 5.0 - 5.0, f32::from(k / 3) * 7.0 - 4.0);
        between(&mut s, [x - 0.3, 0.0, z - 0.3], [x + 0.3, 4.0, z + 0.3], matte([0.7, 0.5, 0.4]));
    }
    let across = f64::from(count).sqrt().ceil() as u32;
    for k in 0..count {
        let place = |n: u32| 19.0 * (f64::from(n) + 0.5) / f64::from(across) - 9.5;
        let height = 2.6 + 1.2 * (f64::from(k) * 0.618_034).fract();
        let hue = |phase: f32| 0.55 + 0.45 * (0.7 * k as f32 + phase).sin();
        let watts = Vec3::new(hue(0.0), hue(2.1), hue(4.2)) * (4000.0 / count as f32);
        s.lights.push(lamp([place(k % across), height, place(k / across)], 0.03, watts));
    }
    s
}

/// A white block beside a red wall in the sun: its shaded side is lit by the wall.
pub fn coloured_wall() -> Scene {
    let mut s = scene("coloured wall", camera([2.6, 1.6, 3.2], [-0.4, 0.7, 0.0]));
    add(&mut s, plane(6.0), matte([0.4; 3]), Affine3A::IDENTITY);
    between(&mut s, [-1.6, 0.0, -2.0], [-1.5, 2.2, 2.0], matte([0.8, 0.08, 0.06]));
    between(&mut s, [-0.9, 0.0, -0.5], [-0.1, 1.1, 0.5], matte([0.8; 3]));
    s.lights.push(Light::Directional {
        direction: (Quat::from_rotation_y(0.4) * Vec3::new(-0.7, -0.7, 0.0)).normalize(),
        illuminance: Vec3::splat(5.0),
        angular_radius: 0.005,
    });
    s
}

/// Two rooms without ceilings, seen from above, with a wall between them of so many metres; in one is a lamp.
pub fn open_rooms(wall: f32) -> Scene {
    let mut s = scene("rooms", camera([0.0, 7.0, 0.01], [0.0, 0.0, 0.0]));
    let white = || Material { double_sided: true, ..material([0.8; 3], 0.0, 1.0) };
    add(&mut s, plane(2.0), white(), Affine3A::IDENTITY);
    for (half, at) in [
        (Vec3::new(0.5 * wall, 0.5, 2.0), Vec3::new(0.0, 0.5, 0.0)),
        (Vec3::new(0.1, 0.5, 2.0), Vec3::new(-2.0, 0.5, 0.0)),
        (Vec3::new(0.1, 0.5, 2.0), Vec3::new(2.0, 0.5, 0.0)),
        (Vec3::new(2.0, 0.5, 0.1), Vec3::new(0.0, 0.5, -2.0)),
        (Vec3::new(2.0, 0.5, 0.1), Vec3::new(0.0, 0.5, 2.0)),
    ] {
        add(&mut s, block(half), white(), Affine3A::from_translation(at));
    }
    s.lights.push(Light::Point { position: DVec3::new(1.0, 0.4, 0.0), intensity: Vec3::splat(3.0), range: None });
    s
}
