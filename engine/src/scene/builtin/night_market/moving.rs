//! What moves, in a loop: lanterns that swing, a drone that flies over the street, a cart that drives along it.
use super::super::shapes::{Shape, block, curve, lathe, line};
use super::super::stage::{dielectric, sampled, smooth, wave};
use super::batch::{pipe, rod};
use super::lamps::{Kind, SHOWN, cone_flux, shown, spread};
use super::{Market, along};
use crate::scene::{Interpolation, Light, Local, Material, Mesh, Property, Sphere};
use glam::{Affine3A, DQuat, DVec3, Quat, Vec3};
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// Length of the loop, seconds.
pub const LOOP: f32 = 20.0;

pub fn animation(market: &mut Market) {
    market.stage.animation("loop");
}

fn moved(translation: Vec3) -> Local {
    Local::Trs { translation: translation.as_dvec3(), rotation: DQuat::IDENTITY, scale: DVec3::ONE }
}

/// A mesh of one ball around the origin that shows a lamp.
pub fn ball(market: &mut Market, radius: f32) -> u32 {
    balls(market, vec![Sphere { centre: Vec3::ZERO, radius: SHOWN * radius }])
}

fn balls(market: &mut Market, spheres: Vec<Sphere>) -> u32 {
    let meshes = &mut market.stage.scene.meshes;
    meshes.push(Mesh { name: "moving lamps".to_owned(), spheres, ..Mesh::default() });
    meshes.len() as u32 - 1
}

/// Adds a light that follows a node. Such lights come before those that stand still.
fn follow(market: &mut Market, node: u32, light: impl FnOnce(DVec3) -> Light) {
    let at = market.stage.world(node).translation;
    market.stage.scene.lights.push(light(at));
    market.stage.scene.light_nodes.push(Some(node));
}

/// Meshes of lanterns that swing, with their materials.
pub struct LanternMeshes {
    pub balls: [(u32, u32); 3],
    pub frame: (u32, u32),
    pub tassel: (u32, u32),
}

/// A lantern that swings.
pub struct Swing {
    pub hook: Vec3,
    /// From the hook down to its middle, metres.
    pub drop: f32,
    pub hue: usize,
    pub radius: f32,
    pub glow: Vec3,
}

pub fn swing(market: &mut Market, meshes: &LanternMeshes, lantern: &Swing) {
    let number = market.stage.scene.nodes.len() as f32;
    let stage = &mut market.stage;
    let hook = stage.node("hook", None, moved(lantern.hook));
    // Neighbours swing at other times, and some a little faster.
    let (phase, turns) = (0.37 * number, 6.0 + number % 3.0);
    let keys = smooth(LOOP, 64, |t| {
        let gust = 0.6 + 0.4 * wave(t, 0.13 * number);
        let (x, z) = (0.10 * gust * wave(turns * t, phase), 0.17 * gust * wave(turns * t, phase + 0.2));
        Quat::from_euler(glam::EulerRot::XYZ, x, 0.0, z).to_array()
    });
    stage.channel(hook, Property::Rotation, Interpolation::CubicSpline, keys);
    let node = stage.node("lantern", Some(hook), moved(Vec3::NEG_Y * lantern.drop));
    for (mesh, material) in [meshes.balls[lantern.hue], meshes.frame, meshes.tassel] {
        stage.put_on(mesh, material, node);
    }
    let (radius, radiance) = (lantern.radius, lantern.glow);
    follow(market, node, |centre| Light::Sphere { centre, radius, radiance });
}

/// Lamps of the drone: a spot, and one at the end of each arm.
pub const DRONE_LAMPS: usize = 5;
const BEAM: Vec3 = Vec3::new(17.0, 21.0, 26.0);
const BEAM_ANGLES: [f32; 2] = [9.0, 20.0];
const TIP: Kind = Kind { count: 4, radius: 0.028, radiance: 22.0 };
const TIP_HUES: [[f32; 3]; 2] = [[0.15, 1.0, 0.35], [1.0, 0.10, 0.12]];

pub fn drone_flux() -> f32 {
    let tips = TIP.count as f32 * TIP.radiance * 4.0 * (PI * TIP.radius).powi(2);
    tips + cone_flux(BEAM, BEAM_ANGLES[1])
}

/// A drone with four rotors and a beam that points down.
pub fn drone(market: &mut Market) {
    let shell = market.paint.white;
    let dark = market.paint.rubber;
    let stage = &mut market.stage;
    let node = stage.node("drone", None, moved(Vec3::ZERO));
    let path = smooth(LOOP, 32, |t| {
        let s = 4.2 + 7.0 * wave(t, 0.0);
        (along(s, 0.9 * wave(2.0 * t, 0.12), 3.15 + 0.22 * wave(3.0 * t, 0.0)).translation).to_array()
    });
    stage.channel(node, Property::Translation, Interpolation::CubicSpline, path);
    let lean = smooth(LOOP, 32, |t| Quat::from_rotation_x(-0.16 * wave(t, 0.25)).to_array());
    stage.channel(node, Property::Rotation, Interpolation::CubicSpline, lean);
    let body = lathe(&[curve(&[[0.0, -0.055], [0.11, -0.045], [0.155, 0.0], [0.11, 0.05], [0.0, 0.065]], 4)], 24);
    stage.hang("drone", body, shell, node);
    let mut arms = Shape::default();
    let tip = |i: usize| {
        let (s, c) = ((i as f32 + 0.5) / 4.0 * TAU).sin_cos();
        Vec3::new(0.36 * c, 0.0, 0.36 * s)
    };
    for i in 0..4 {
        arms.join(&rod(0.3 * tip(i), tip(i), 0.014, 6), Affine3A::IDENTITY);
        let hub = lathe(&[line(&[[0.022, -0.02], [0.022, 0.05]]), line(&[[0.022, 0.05], [0.0, 0.05]])], 10);
        arms.join(&hub, Affine3A::from_translation(tip(i)));
        let guard: Vec<Vec3> = (0..=20)
            .map(|k| (k as f32 / 20.0 * TAU).sin_cos())
            .map(|(s, c)| tip(i) + Vec3::new(0.15 * c, 0.02, 0.15 * s))
            .collect();
        arms.join(&pipe(&guard, 0.006, 4), Affine3A::IDENTITY);
        arms.join(&block(0.26, 0.004, 0.022, 0.0), Affine3A::from_translation(tip(i) + Vec3::Y * 0.04));
    }
    stage.hang("drone arms", arms, dark, node);
    for (k, hue) in TIP_HUES.into_iter().enumerate() {
        let glow = TIP.glow(hue);
        let material = market.stage.material(shown("drone lamps", glow));
        let mesh = ball(market, TIP.radius);
        // Ahead the one colour, behind the other.
        for i in [2 * k, 2 * k + 1] {
            let place = market.stage.node("drone lamp", Some(node), moved(tip(i) - Vec3::Y * 0.05));
            market.stage.put_on(mesh, material, place);
            follow(market, place, |centre| Light::Sphere { centre, radius: TIP.radius, radiance: glow });
        }
    }
    // A spot on a node shines along its -z.
    let rotation = DQuat::from_rotation_x(f64::from(-FRAC_PI_2));
    let down = Local::Trs { translation: DVec3::new(0.0, -0.075, 0.0), rotation, scale: DVec3::ONE };
    let lens = market.stage.node("drone beam", Some(node), down);
    let [inner, outer] = BEAM_ANGLES.map(f32::to_radians);
    follow(market, lens, |position| Light::Spot {
        position,
        direction: Vec3::NEG_Y,
        intensity: BEAM,
        range: None,
        inner,
        outer,
    });
}

/// A cart that drives up and down the street by itself, with lamps around its edges.
pub fn cart(market: &mut Market, lamps: &Kind) {
    const HALF: Vec3 = Vec3::new(0.30, 0.28, 0.42);
    let (paint, rubber, steel) = (market.paint.glaze[4], market.paint.rubber, market.paint.steel);
    let white = market.paint.white;
    let eyes = market
        .stage
        .material(Material { emission: Vec3::new(0.8, 9.0, 11.0), ..dielectric("eyes of the cart", [0.02; 3], 0.1) });
    let stage = &mut market.stage;
    let node = stage.node("cart", None, moved(Vec3::ZERO));
    let at = |t: f32| (7.4 - 5.2 * wave(t, 0.0), -0.95 * wave(t, 0.25));
    let path = smooth(LOOP, 48, |t| {
        let (s, across) = at(t);
        along(s, across, 0.0).translation.to_array()
    });
    stage.channel(node, Property::Translation, Interpolation::CubicSpline, path);
    // It looks ahead: its front is at -z.
    let mut heading = Vec::new();
    let mut before = 0.0_f32;
    for k in 0..=48 {
        let t = k as f32 / 48.0;
        let [a, b] = [t - 0.002, t + 0.002].map(at);
        let angle = (-(b.1 - a.1)).atan2(b.0 - a.0);
        let turns = ((before - angle) / TAU).round();
        before = angle + turns * TAU;
        heading.push(before);
    }
    let turned = sampled(LOOP, 48, |t| Quat::from_rotation_y(heading[(t * 48.0).round() as usize]).to_array());
    stage.channel(node, Property::Rotation, Interpolation::Linear, turned);
    let mut body = Shape::default();
    let up = |y: f32| Affine3A::from_translation(Vec3::Y * y);
    body.join(&block(2.0 * HALF.x, 2.0 * HALF.y, 2.0 * HALF.z, 0.07), up(0.17));
    stage.hang("cart", body, paint, node);
    let mut lid = Shape::default();
    lid.join(&block(0.56, 0.06, 0.80, 0.025), up(0.725));
    stage.hang("lid of the cart", lid, white, node);
    let mut wheels = Shape::default();
    for [x, z] in [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]] {
        let (inside, outside) = (Vec3::new(0.25 * x, 0.13, 0.27 * z), Vec3::new(0.34 * x, 0.13, 0.27 * z));
        wheels.join(&rod(inside, outside, 0.13, 18), Affine3A::IDENTITY);
    }
    stage.hang("wheels of the cart", wheels, rubber, node);
    let mast = rod(Vec3::new(0.2, 0.7, 0.3), Vec3::new(0.2, 1.25, 0.3), 0.010, 6);
    stage.hang("mast of the cart", mast, steel, node);
    let mut face = Shape::default();
    for x in [-0.11, 0.11] {
        let eye: Vec<Vec3> = (0..=16)
            .map(|k| (k as f32 / 16.0 * TAU).sin_cos())
            .map(|(s, c)| Vec3::new(x + 0.045 * c, 0.52 + 0.06 * s, -HALF.z - 0.008))
            .collect();
        face.join(&pipe(&eye, 0.012, 6), Affine3A::IDENTITY);
    }
    stage.hang("eyes of the cart", face, eyes, node);
    edge_lamps(market, lamps, node, HALF);
}

/// Lamps around the lid and the foot of the cart, and one on its mast.
fn edge_lamps(market: &mut Market, lamps: &Kind, node: u32, half: Vec3) {
    const HUE: [f32; 3] = [1.0, 0.66, 0.30];
    let out = half + Vec3::splat(lamps.radius + 0.012);
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]];
    let around = |y: f32| corners.map(|[x, z]| Vec3::new(x * out.x, y, z * out.z)).to_vec();
    let edges = spread(&[around(0.70), around(0.22)], lamps.count.saturating_sub(1) as usize);
    let mut places: Vec<Vec3> = edges.into_iter().map(|(_, place)| place).collect();
    places.push(Vec3::new(0.2, 1.26 + lamps.radius, 0.3));
    let glow = lamps.glow(HUE);
    let material = market.stage.material(shown("lamps of the cart", glow));
    let spheres = places.iter().map(|centre| Sphere { centre: *centre, radius: SHOWN * lamps.radius }).collect();
    let mesh = balls(market, spheres);
    market.stage.put_on(mesh, material, node);
    for place in places {
        let lamp = market.stage.node("cart lamp", Some(node), moved(place));
        follow(market, lamp, |centre| Light::Sphere { centre, radius: lamps.radius, radiance: glow });
    }
}
