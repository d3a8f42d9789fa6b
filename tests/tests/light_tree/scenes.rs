//! Scenes with many lights.
use super::rig::Numbers;
use glam::{Affine3A, DVec3, Mat3, Quat, Vec3};
use magpie::scene::{
    Animation, Channel, Instance, Interpolation, Light, Local, Material, Mesh, MorphTarget, Node, Property, Scene,
    Sphere,
};
use magpie_tests::fixtures::{add, block, camera, material, plane, scene, sphere};

/// A camera, and a floor.
pub fn empty(name: &str) -> Scene {
    let mut made = scene(name, camera([0.0, 2.0, 20.0], [0.0, 0.0, 0.0]));
    add(&mut made, plane(50.0), material([0.5; 3], 0.0, 0.8), Affine3A::IDENTITY);
    made
}

/// The half extents of a town with this many lamps.
pub fn town_extent(lamps: u32) -> Vec3 {
    let side = (lamps as f32).sqrt();
    Vec3::new(side, 4.0, side)
}

/// Lamps without a size above a town, about one for every 4 m²: points and spots whose intensities span four decades.
pub fn town(lamps: u32) -> Scene {
    let mut made = empty("town");
    let (mut numbers, extent) = (Numbers(5), town_extent(lamps));
    for i in 0..lamps {
        let position = (numbers.point() * extent + Vec3::Y * 5.0).as_dvec3();
        let intensity = Vec3::splat(10_f32.powf(4.0 * numbers.next() - 2.0));
        let direction = (numbers.direction() - Vec3::Y).normalize();
        made.lights.push(match i % 2 {
            0 => Light::Point { position, intensity, range: None },
            _ => Light::Spot { position, direction, intensity, range: None, inner: 0.4, outer: 0.9 },
        });
    }
    made
}

/// Points above the ground of a town.
pub fn town_points(lamps: u32, count: usize) -> Vec<super::rig::Point> {
    let mut points = super::rig::points_in(0.8 * town_extent(lamps), count, &mut Numbers(6));
    points.iter_mut().for_each(|point| point.position[1] += 3.0);
    points
}

/// A town whose lamps leave their places: after one second each is at another place of the town.
pub fn leaving_town(lamps: u32) -> Scene {
    let mut made = town(lamps);
    let (mut numbers, extent) = (Numbers(7), town_extent(lamps));
    made.animations.push(Animation { name: "leave".to_owned(), duration: 2.0, channels: Vec::new() });
    for (index, light) in made.lights.iter_mut().enumerate() {
        let (Light::Point { position, .. } | Light::Spot { position, .. }) = light else { continue };
        let (to, from) = (numbers.point() * extent + Vec3::Y * 5.0, *position);
        let mut rotation = glam::DQuat::IDENTITY;
        if let Light::Spot { direction, .. } = light {
            rotation = glam::DQuat::from_rotation_arc(DVec3::NEG_Z, direction.as_dvec3().normalize());
        }
        let local = Local::Trs { translation: from, rotation, scale: DVec3::ONE };
        made.nodes.push(Node { local, ..Node::default() });
        made.light_nodes.push(Some(index as u32));
        let keys = [from.as_vec3(), to, to].iter().flat_map(|v| v.to_array()).collect();
        made.animations[0].channels.push(Channel {
            node: index as u32,
            property: Property::Translation,
            interpolation: Interpolation::Linear,
            times: vec![0.0, 1.0, 2.0],
            values: keys,
        });
    }
    made
}

pub fn glow(radiance: f32, double_sided: bool) -> Material {
    let emission = Vec3::new(1.0, 0.8, 0.6) * radiance;
    Material { emission, double_sided, ..material([0.0; 3], 0.0, 1.0) }
}

/// Luminance of the ball that deforms.
pub const BALL_LUMINANCE: f32 = 4.0 * (0.2126 + 0.8 * 0.7152 + 0.6 * 0.0722);

/// A ball that grows a bump, as a morph target.
fn bumpy() -> Mesh {
    let mut mesh = sphere(6);
    let bump = |p: &Vec3| *p * 2.0 * (p.x * 3.0).sin().abs() + Vec3::Y;
    let positions = mesh.positions.iter().map(bump).collect();
    mesh.targets = vec![MorphTarget { positions, ..MorphTarget::default() }];
    mesh.weights = vec![0.0];
    mesh
}

/// Surfaces that emit, placed in all ways: turned, stretched, mirrored, sheared, flat, shared by several instances, one-sided and two-sided.
pub fn surfaces(made: &mut Scene) {
    let at = |x: f32, y: f32, z: f32| Affine3A::from_translation(Vec3::new(x, y, z));
    let turned = |degrees: f32| Affine3A::from_rotation_x(degrees.to_radians());
    let stretched = |x: f32, y: f32, z: f32| Affine3A::from_scale(Vec3::new(x, y, z));
    add(made, plane(0.5), glow(8.0, false), at(-4.0, 5.0, 0.0) * turned(180.0));
    add(made, plane(0.5), glow(3.0, true), at(4.0, 3.0, 1.0) * turned(70.0));
    add(made, block(Vec3::splat(0.5)), glow(2.0, false), at(0.0, 4.0, -5.0) * stretched(3.0, 0.2, -1.0));
    add(made, sphere(8), glow(5.0, false), at(-3.0, 2.0, 5.0) * turned(20.0) * stretched(0.3, 0.9, 0.3));
    // Sheared: a turn between two stretches.
    let sheared = at(2.0, 1.5, -2.0) * stretched(1.0, 0.4, 1.0) * turned(40.0) * stretched(0.5, 1.0, 0.3);
    add(made, block(Vec3::splat(0.6)), glow(1.0, false), sheared);
    let balls = [(Vec3::ZERO, 0.3), (Vec3::new(1.0, 0.4, 0.0), 0.1), (Vec3::new(0.0, -0.5, 0.7), 0.05)];
    let spheres = balls.iter().map(|(centre, radius)| Sphere { centre: *centre, radius: *radius }).collect();
    let mesh = Mesh { name: "balls".to_owned(), spheres, ..Mesh::default() };
    add(made, mesh, glow(20.0, false), at(5.0, 2.0, -4.0) * stretched(2.0, 2.0, 2.0));
    // Two more of the first mesh, one of them without any extent.
    let (mesh, material) = (made.instances[1].mesh, made.instances[1].material);
    for world in [at(0.0, 6.0, 4.0) * turned(150.0), at(0.0, 1.0, 0.0) * stretched(1.0, 0.0, 0.0)] {
        made.instances.push(Instance::fixed("again", mesh, material, world));
    }
}

/// Lamps of every kind within this box, some with a range, some narrow, some without power.
pub fn lamps(made: &mut Scene, count: u32, extent: Vec3) {
    let mut numbers = Numbers(8);
    for i in 0..count {
        let position = (numbers.point() * extent + Vec3::Y * extent.y).as_dvec3();
        let strength = if i % 11 == 10 { 0.0 } else { 10_f32.powf(3.0 * numbers.next() - 1.0) };
        let intensity = Vec3::new(1.0, 0.7, 0.4) * strength;
        let (direction, across) = (numbers.direction(), numbers.direction());
        let range = (i % 3 > 0).then(|| 0.5 + 4.0 * numbers.next());
        let turn = Mat3::from_quat(Quat::from_axis_angle(across, 1.0));
        made.lights.push(match i % 6 {
            0 => Light::Point { position, intensity, range },
            1 => Light::Spot { position, direction, intensity, range, inner: 0.05, outer: 0.15 },
            2 => Light::Spot { position, direction, intensity, range: None, inner: 0.3, outer: 1.5 },
            3 => {
                let (half_u, half_v) = (turn * Vec3::X * 0.3, turn * Vec3::new(0.1, 0.2, 0.0));
                Light::Rectangle { centre: position, half_u, half_v, radiance: intensity }
            }
            4 => Light::Disc { centre: position, normal: direction, radius: 0.4, radiance: intensity },
            _ => Light::Sphere { centre: position, radius: 0.2, radiance: intensity },
        });
    }
    let direction = Vec3::NEG_Y;
    made.lights.push(Light::Directional { direction, illuminance: Vec3::ONE, angular_radius: 0.0 });
}

/// Everything of the above, and what moves: a lamp and a glowing block that swing, and a ball that changes its shape.
pub fn everything() -> Scene {
    let mut made = empty("everything");
    surfaces(&mut made);
    lamps(&mut made, 40, Vec3::new(8.0, 3.0, 8.0));
    // Nodes: of a lamp, of the block, of the ball.
    let node = |x: f64, y: f64, z: f64| Node {
        local: Local::Trs {
            translation: DVec3::new(x, y, z),
            rotation: glam::DQuat::IDENTITY,
            scale: DVec3::new(1.0, 0.5, 1.0),
        },
        ..Node::default()
    };
    made.nodes = vec![node(0.0, 3.0, 0.0), node(0.0, 4.0, -5.0), node(-2.0, 2.0, 2.0)];
    made.light_nodes = vec![Some(0)];
    add(&mut made, bumpy(), glow(4.0, false), Affine3A::IDENTITY);
    let (block, ball) = (3, made.instances.len() - 1);
    for (instance, node) in [(block, 1), (ball, 2)] {
        made.instances[instance].node = Some(node);
        made.instances[instance].world_from_object = made.nodes[node as usize].local.affine();
    }
    let channel = |node, property, values: &[f32]| Channel {
        node,
        property,
        interpolation: Interpolation::Linear,
        times: vec![0.0, 1.0, 2.0],
        values: values.to_vec(),
    };
    let channels = vec![
        channel(0, Property::Translation, &[0.0, 3.0, 0.0, 3.0, 1.0, -2.0, 0.0, 3.0, 0.0]),
        channel(1, Property::Translation, &[0.0, 4.0, -5.0, 6.0, 2.0, 6.0, 0.0, 4.0, -5.0]),
        channel(2, Property::Weights, &[0.0, 1.0, 0.0]),
    ];
    made.animations.push(Animation { name: "swing".to_owned(), duration: 2.0, channels });
    made
}
