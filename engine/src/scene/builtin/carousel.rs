//! A fairground with everything that can move, in a loop of four seconds: a carousel (rigid), a stem that bends (skin), a blob
//! and a flag that change shape (morph targets), a cloud of spheres, a swinging lamp, a clock; and plants that stand still.
use super::foliage::{Random, core, crown, leaf_texture};
use super::shapes::{Shape, block, curve, cushion, lathe, line, sphere};
use super::stage::{Stage, at, dielectric, finish, matte, metal, sampled, smooth, wave};
use crate::scene::{
    AlphaMode, Camera, Daylight, Influence, Interpolation, Light, Local, Material, Mesh, MorphTarget, Property,
    Sampler, Scene, Skin, Sphere, TextureUse, Wrap,
};
use glam::{DAffine3, DQuat, DVec3, Quat, Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// Length of the loop, seconds.
const LOOP: f32 = 4.0;
/// Depth to which objects are sunk into the ground, metres, so that no bottom face is coplanar with it.
const SUNK: f32 = 0.004;

pub(super) fn scene() -> Scene {
    let mut stage = Stage::new("carousel");
    stage.animation("loop");
    ground(&mut stage);
    carousel(&mut stage);
    stem(&mut stage);
    blob(&mut stage);
    flag(&mut stage);
    spheres(&mut stage);
    plants(&mut stage);
    clock(&mut stage);
    let to_sun = Vec3::new(-0.50, 0.74, 0.62).normalize();
    let daylight =
        Daylight { to_sun, turbidity: 2.6, ground_albedo: Vec3::new(0.28, 0.27, 0.25), ..Daylight::default() };
    stage.scene.lights.push(daylight.sun());
    stage.scene.light_nodes.push(None);
    stage.scene.daylight = Some(daylight);
    lamp(&mut stage);
    stage.camera("default", [-0.35, 1.90, 7.0], [0.08, 1.24, 0.0], 35.0);
    stage.camera("close", [0.2, 1.25, 4.3], [-1.2, 0.95, 0.9], 40.0);
    ride(&mut stage);
    stage.scene
}

fn ground(stage: &mut Stage) {
    let grass = stage.material(matte("grass", [0.16, 0.21, 0.07]));
    let gravel = stage.material(matte("gravel", [0.34, 0.28, 0.21]));
    let plaster = stage.material(matte("plaster", [0.56, 0.40, 0.25]));
    let tile = stage.material(dielectric("roof tile", [0.48, 0.16, 0.09], 0.6));
    let mut plane = Shape::default();
    let h = 60.0;
    plane.quad([Vec3::new(-h, 0.0, h), Vec3::new(h, 0.0, h), Vec3::new(h, 0.0, -h), Vec3::new(-h, 0.0, -h)]);
    stage.add("grass", plane, grass, at(0.0, -0.03, 0.0, 0.0));
    let yard = lathe(&[line(&[[4.6, 0.0], [0.0, 0.0]])], 72);
    stage.add("yard", yard, gravel, at(0.0, 0.0, 0.0, 0.0));
    stage.add("wall", block(9.6, 3.0, 0.35, 0.02), plaster, at(0.0, -0.06, -3.1, 0.0));
    stage.add("coping", block(9.9, 0.14, 0.6, 0.03), tile, at(0.0, 2.93, -3.1, 0.0));
}

/// The platform turns once per loop. Its riders move up and down, and one of them changes its scale.
fn carousel(stage: &mut Stage) {
    let wood = stage.material(dielectric("painted wood", [0.055, 0.16, 0.30], 0.45));
    let cream = Material { double_sided: true, ..matte("cream cloth", [0.78, 0.70, 0.52]) };
    let red = Material { double_sided: true, ..matte("red cloth", [0.56, 0.05, 0.035]) };
    let cloth = [stage.material(cream), stage.material(red)];
    let gold = stage.material(metal("gold", [1.0, 0.71, 0.29], 0.25));

    let foot = stage.node("carousel", None, moved(DVec3::new(0.0, 0.0, -0.7)));
    let platform = stage.node("platform", Some(foot), Local::IDENTITY);
    let turn = sampled(LOOP, 8, |t| DQuat::from_rotation_y(f64::from(t * TAU)).as_quat().to_array());
    stage.channel(platform, Property::Rotation, Interpolation::Linear, turn);

    let deck = lathe(
        &[
            line(&[[1.50, -SUNK], [1.50, 0.12]]),
            curve(&[[1.50, 0.12], [1.56, 0.15], [1.58, 0.19], [1.55, 0.23], [1.48, 0.25]], 3),
            line(&[[1.48, 0.25], [0.0, 0.25]]),
        ],
        72,
    );
    stage.hang("deck", deck, wood, platform);
    let column = lathe(
        &[
            curve(&[[0.30, 0.24], [0.22, 0.32], [0.15, 0.6], [0.13, 1.4], [0.16, 2.1], [0.24, 2.32]], 4),
            curve(&[[0.10, 2.80], [0.13, 2.92], [0.09, 3.02], [0.0, 3.06]], 4),
        ],
        32,
    );
    stage.hang("column", column, gold, platform);
    let wedge = stage.mesh("canopy", wedge());
    for i in 0..12_u8 {
        let local = turned(DVec3::ZERO, f64::from(i) * std::f64::consts::TAU / 12.0);
        let node = stage.node("canopy", Some(platform), local);
        stage.put_on(wedge, cloth[usize::from(i % 2)], node);
    }

    let post = stage.mesh("post", lathe(&[line(&[[0.022, 0.24], [0.022, 2.34]])], 12));
    let colours = [[0.72, 0.10, 0.05], [0.04, 0.33, 0.30], [0.80, 0.47, 0.05], [0.32, 0.08, 0.36]];
    let riders = [
        ("cushion", cushion(Vec3::new(0.36, 0.20, 0.22), 0.5, 24, 40)),
        ("egg", sphere(0.25, 28, 44)),
        ("block", block(0.42, 0.42, 0.42, 0.04)),
        ("ball", sphere(0.24, 28, 44)),
    ];
    for (i, ((name, shape), colour)) in riders.into_iter().zip(colours).enumerate() {
        let paint = stage.material(dielectric(name, colour, 0.18 + 0.12 * i as f32));
        let angle = (i as f64 + 0.5) * std::f64::consts::FRAC_PI_2;
        let place = DQuat::from_rotation_y(angle) * DVec3::new(1.02, 0.0, 0.0);
        let stand = stage.node("stand", Some(platform), turned(place, angle));
        stage.put_on(post, gold, stand);
        let rider = stage.node(name, Some(stand), moved(DVec3::Y * 0.85));
        let phase = 0.25 * i as f32;
        let bob = smooth(LOOP, 8, |t| [0.0, 0.92 + 0.24 * wave(2.0 * t, phase), 0.0]);
        stage.channel(rider, Property::Translation, Interpolation::CubicSpline, bob);
        if name == "egg" {
            let stretch = sampled(LOOP, 16, |t| {
                let s = 0.30 * wave(2.0 * t, 0.25);
                [1.0 - 0.6 * s, 1.0 + s, 0.8 - 0.4 * s]
            });
            stage.channel(rider, Property::Scale, Interpolation::Linear, stretch);
        }
        stage.hang(name, shape, paint, rider);
    }
}

/// A twelfth of a cone with a hem, around +x.
fn wedge() -> Shape {
    const STEPS: usize = 6;
    let mut shape = Shape::default();
    let (rim, apex) = (Vec2::new(1.66, 2.28), Vec2::new(0.09, 2.86));
    let out = Vec2::new(apex.y - rim.y, rim.x - apex.x).normalize();
    let mut rows: Vec<[u32; 4]> = Vec::new();
    for i in 0..=STEPS {
        let t = i as f32 / STEPS as f32;
        let (s, c) = ((t - 0.5) * TAU / 12.0).sin_cos();
        let around = |p: Vec2| Vec3::new(p.x * c, p.y, -p.x * s);
        // The hem is lowest in the middle of the wedge.
        let hem = rim - Vec2::Y * (0.10 + 0.12 * (PI * t).sin());
        rows.push([
            shape.vertex(around(hem), around(Vec2::X), Vec2::new(t, 1.2)),
            shape.vertex(around(rim), around(Vec2::X), Vec2::new(t, 1.0)),
            shape.vertex(around(rim), around(out), Vec2::new(t, 1.0)),
            shape.vertex(around(apex), around(out), Vec2::new(t, 0.0)),
        ]);
    }
    for pair in rows.windows(2) {
        for k in [0, 2] {
            let [a, b, c, d] = [pair[0][k], pair[1][k], pair[1][k + 1], pair[0][k + 1]];
            shape.triangle([a, b, c]);
            shape.triangle([a, c, d]);
        }
    }
    shape
}

/// A swaying stem of six joints, each a little behind the one below.
fn stem(stage: &mut Stage) {
    const JOINTS: usize = 6;
    const HEIGHT: f32 = 1.75;
    let span = HEIGHT / JOINTS as f32;
    let green = stage.material(dielectric("stem", [0.13, 0.36, 0.10], 0.35));
    let profile =
        [[0.20, 0.0], [0.145, 0.12], [0.120, 0.5], [0.095, 1.0], [0.070, 1.4], [0.10, 1.62], [0.07, 1.72], [0.0, 1.75]];
    let mut mesh = finish("stem", lathe(&[curve(&profile, 10)], 32));
    for p in &mesh.positions {
        // Each joint influences one and a half spans on either side, which is smooth and never exceeds four joints per vertex.
        let along = p.y / span - 0.5;
        let weight = |k: usize| (1.0 - ((along - k as f32) / 1.5).powi(2)).max(0.0).powi(2);
        let mut parts: Vec<Influence> =
            (0..JOINTS).map(|k| Influence { joint: k as u32, weight: weight(k) }).filter(|i| i.weight > 0.0).collect();
        let sum: f32 = parts.iter().map(|i| i.weight).sum();
        parts.iter_mut().for_each(|i| i.weight /= sum);
        parts.resize(4, Influence::default());
        mesh.influences.extend(parts);
    }
    let root = stage.node("stem", None, moved(DVec3::new(-2.25, -0.004, 0.75)));
    let mut joints = Vec::new();
    let mut parent = root;
    for k in 0..JOINTS {
        let up = if k == 0 { 0.0 } else { f64::from(span) };
        let joint = stage.node("stem joint", Some(parent), moved(DVec3::Y * up));
        let reach = 0.09 + 0.045 * k as f32;
        let sway = sampled(LOOP, 16, |t| {
            let lag = -0.07 * k as f32;
            let (x, z) = (0.6 * wave(t, lag + 0.25), wave(t, lag));
            Quat::from_scaled_axis(Vec3::new(reach * x, 0.35 * reach * wave(t, 0.5), reach * z)).to_array()
        });
        stage.channel(joint, Property::Rotation, Interpolation::Linear, sway);
        joints.push(joint);
        parent = joint;
    }
    let inverse_bind =
        (0..JOINTS).map(|k| DAffine3::from_translation(DVec3::NEG_Y * (k as f64 * f64::from(span)))).collect();
    stage.scene.skins.push(Skin { name: "stem".to_owned(), joints, inverse_bind });
    stage.scene.meshes.push(mesh);
    stage.put_on(stage.scene.meshes.len() as u32 - 1, green, root);
    if let Some(instance) = stage.scene.instances.last_mut() {
        instance.skin = Some(0);
    }
}

/// A ball that morphs into a pear and into a star.
fn blob(stage: &mut Stage) {
    let stone = stage.material(matte("pedestal", [0.55, 0.52, 0.47]));
    let glaze = stage.material(dielectric("glaze", [0.62, 0.11, 0.21], 0.12));
    let place = DVec3::new(2.15, 0.0, 0.7);
    let pedestal = lathe(
        &[
            line(&[[0.34, -SUNK], [0.34, 0.08]]),
            curve(&[[0.34, 0.08], [0.27, 0.14], [0.24, 0.3], [0.27, 0.44], [0.33, 0.48]], 4),
            line(&[[0.33, 0.48], [0.33, 0.53]]),
            line(&[[0.33, 0.53], [0.0, 0.53]]),
        ],
        48,
    );
    stage.add("pedestal", pedestal, stone, at(place.x as f32, 0.0, place.z as f32, 0.0));
    const RADIUS: f32 = 0.42;
    let pear = |d: Vec3| {
        let width = 1.0 - 0.42 * d.y;
        RADIUS * Vec3::new(d.x * width, 1.32 * d.y + 0.12, d.z * width)
    };
    let star = |d: Vec3| {
        let bumps = (3.0 * d.z.atan2(d.x)).cos() * (1.0 - d.y * d.y) * (1.0 - d.y * d.y);
        d * (RADIUS * (0.94 + 0.34 * bumps + 0.10 * d.y * d.y))
    };
    let mut mesh = finish("blob", sphere(RADIUS, 56, 96));
    mesh.targets = vec![target(&mesh, &pear), target(&mesh, &star)];
    stage.scene.meshes.push(mesh);
    let node = stage.node("blob", None, moved(place + DVec3::Y * 1.04));
    let weights = smooth(LOOP, 8, |t| [0.5 + 0.5 * wave(t, -0.25), (0.35 + 0.65 * wave(t, 0.1)).max(0.0).powi(2)]);
    stage.channel(node, Property::Weights, Interpolation::CubicSpline, weights);
    let turn = sampled(LOOP, 8, |t| Quat::from_rotation_y(0.5 * wave(t, 0.0)).to_array());
    stage.channel(node, Property::Rotation, Interpolation::Linear, turn);
    stage.put_on(stage.scene.meshes.len() as u32 - 1, glaze, node);
}

/// The morph target from a sphere to a shape, which is given by its position in each direction.
fn target(mesh: &Mesh, shape: &dyn Fn(Vec3) -> Vec3) -> MorphTarget {
    const STEP: f32 = 0.01;
    let mut target = MorphTarget::default();
    for (p, n) in mesh.positions.iter().zip(&mesh.normals) {
        let d = p.normalize();
        let (u, v) = d.any_orthonormal_pair();
        let along = |w: Vec3| shape((d + w * STEP).normalize()) - shape((d - w * STEP).normalize());
        target.positions.push(shape(d) - *p);
        target.normals.push(along(u).cross(along(v)).normalize_or(*n) - *n);
    }
    target
}

/// A cloth in the wind. Its travelling wave is the sum of two standing waves, a quarter of a period apart.
fn flag(stage: &mut Stage) {
    const SIZE: Vec2 = Vec2::new(1.5, 0.9);
    const GRID: [usize; 2] = [60, 24];
    let pole = stage.material(metal("pole", [0.60, 0.60, 0.58], 0.35));
    let cloth = Material { double_sided: true, ..matte("flag", [0.05, 0.20, 0.46]) };
    let cloth = stage.material(cloth);
    let place = at(-3.15, 0.0, -1.5, 0.0);
    let shaft =
        lathe(&[line(&[[0.035, -SUNK], [0.030, 2.95]]), curve(&[[0.03, 2.95], [0.06, 3.0], [0.0, 3.06]], 4)], 20);
    stage.add("flag pole", shaft, pole, place);

    let mut shape = Shape::default();
    let mut targets = [MorphTarget::default(), MorphTarget::default()];
    for j in 0..=GRID[1] {
        for i in 0..=GRID[0] {
            let (u, v) = (i as f32 / GRID[0] as f32, j as f32 / GRID[1] as f32);
            let x = u * SIZE.x;
            shape.vertex(Vec3::new(x, (0.5 - v) * SIZE.y, 0.0), Vec3::Z, Vec2::new(u, v));
            // The height is grow * x * sin(k x + slant), with its derivatives. The other target is a quarter of a period ahead.
            let (grow, k, slant) = (0.11, 7.5, 0.9 * v);
            for (target, ahead) in targets.iter_mut().zip([0.0, 0.5 * PI]) {
                let (s, c) = (k * x + slant + ahead).sin_cos();
                let slope = [grow * (s + k * x * c), grow * x * c * -0.9 / SIZE.y];
                target.positions.push(Vec3::Z * (grow * x * s));
                target.normals.push(Vec3::new(-slope[0], -slope[1], 0.0));
                target.tangents.push(Vec3::Z * slope[0]);
            }
        }
    }
    let row = GRID[0] as u32 + 1;
    for j in 0..GRID[1] as u32 {
        for i in 0..GRID[0] as u32 {
            let a = j * row + i;
            shape.triangle([a + row, a + row + 1, a + 1]);
            shape.triangle([a + row, a + 1, a]);
        }
    }
    let mut mesh = finish("flag", shape);
    mesh.targets = targets.into();
    mesh.weights = vec![1.0, 0.0];
    stage.scene.meshes.push(mesh);
    let node = stage.node("flag", None, moved(DVec3::new(-3.12, 2.45, -1.5)));
    let run = smooth(LOOP, 16, |t| [wave(2.0 * t, 0.25), -wave(2.0 * t, 0.0)]);
    stage.channel(node, Property::Weights, Interpolation::CubicSpline, run);
    stage.put_on(stage.scene.meshes.len() as u32 - 1, cloth, node);
}

/// A floating and turning cloud of sixty spheres, in several sizes and three colours.
fn spheres(stage: &mut Stage) {
    let node = stage.node("cloud", None, moved(DVec3::new(-0.75, 0.62, 1.95)));
    let float = smooth(LOOP, 8, |t| [-0.75, 0.62 + 0.07 * wave(t, 0.0), 1.95]);
    stage.channel(node, Property::Translation, Interpolation::CubicSpline, float);
    let turn = sampled(LOOP, 8, |t| Quat::from_rotation_y(-t * TAU).to_array());
    stage.channel(node, Property::Rotation, Interpolation::Linear, turn);
    let paints = [
        stage.material(metal("copper spheres", [0.955, 0.638, 0.538], 0.15)),
        stage.material(dielectric("white spheres", [0.78, 0.77, 0.74], 0.12)),
        stage.material(dielectric("teal spheres", [0.02, 0.30, 0.33], 0.35)),
    ];
    let mut random = Random::new(23);
    let mut placed: Vec<Sphere> = Vec::new();
    let mut tries = 0;
    while placed.len() < 60 && tries < 20_000 {
        tries += 1;
        // Large spheres first; none overlaps another.
        let radius = [0.13, 0.085, 0.055, 0.035][(placed.len() / 8).min(3)] * random.range(0.85, 1.15);
        let centre = random.direction() * random.range(0.0, 0.52);
        if placed.iter().all(|s| s.centre.distance(centre) > s.radius + radius) {
            placed.push(Sphere { centre, radius });
        }
    }
    for (k, paint) in paints.into_iter().enumerate() {
        let spheres = placed.iter().skip(k).step_by(3).copied().collect();
        stage.scene.meshes.push(Mesh { name: "spheres".to_owned(), spheres, ..Mesh::default() });
        stage.put_on(stage.scene.meshes.len() as u32 - 1, paint, node);
    }
}

fn plants(stage: &mut Stage) {
    stage.scene.textures.push(leaf_texture());
    stage.scene.samplers.push(Sampler { wrap: [Wrap::Clamp; 2], ..Sampler::default() });
    let leaves = stage.material(Material {
        alpha: AlphaMode::Mask(0.4),
        double_sided: true,
        base_colour_texture: Some(TextureUse { texture: 0, sampler: 0, uv_set: 0, rows: [Vec3::X, Vec3::Y] }),
        ..dielectric("leaves", [0.90, 1.0, 0.80], 0.55)
    });
    let shade = stage.material(matte("inner leaves", [0.035, 0.060, 0.020]));
    let clay = stage.material(matte("clay", [0.50, 0.21, 0.11]));
    let pot = lathe(
        &[
            line(&[[0.22, -SUNK], [0.30, 0.36]]),
            line(&[[0.30, 0.36], [0.34, 0.36]]),
            line(&[[0.34, 0.36], [0.35, 0.46]]),
            line(&[[0.35, 0.46], [0.30, 0.46]]),
            line(&[[0.30, 0.46], [0.0, 0.40]]),
        ],
        36,
    );
    let (pot, half) = (stage.mesh("pot", pot), Vec3::new(0.50, 0.58, 0.50));
    let (crown, core) = (stage.mesh("crown", crown(5, half, 420, 0.27)), stage.mesh("core", core(half * 0.66)));
    for (x, z, turn) in [(2.75, -1.35, 0.0), (3.55, -0.45, 130.0), (-2.35, -2.2, 240.0)] {
        stage.put(pot, clay, at(x, 0.0, z, turn));
        stage.put(core, shade, at(x, 0.98, z, turn));
        stage.put(crown, leaves, at(x, 0.98, z, turn));
    }
}

/// The hand jumps by an eighth of a turn and then stands still.
fn clock(stage: &mut Stage) {
    let face = stage.material(dielectric("clock face", [0.75, 0.72, 0.62], 0.4));
    let iron = stage.material(metal("clock iron", [0.20, 0.19, 0.19], 0.5));
    let upright = DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2);
    let place = DVec3::new(3.45, 2.22, -2.925);
    let local = Local::Trs { translation: place, rotation: upright, scale: DVec3::ONE };
    let dial = stage.node("clock", None, local);
    let disc = lathe(&[line(&[[0.40, 0.0], [0.40, 0.04]]), line(&[[0.40, 0.04], [0.0, 0.04]])], 56);
    stage.hang("dial", disc, face, dial);
    let ring = curve(&[[0.40, 0.0], [0.45, 0.02], [0.44, 0.06], [0.40, 0.055]], 4);
    stage.hang("clock ring", lathe(&[ring], 56), iron, dial);
    let hand = stage.node("clock hand", Some(dial), moved(DVec3::Y * 0.045));
    let tick = sampled(LOOP, 8, |t| Quat::from_rotation_y(-t * TAU).to_array());
    stage.channel(hand, Property::Rotation, Interpolation::Step, tick);
    let mut shape = Shape::default();
    shape.join(&block(0.035, 0.02, 0.36, 0.004), at(0.0, 0.0, -0.12, 0.0));
    stage.hang("clock hand", shape, iron, hand);
}

/// A lamp that swings on a cord, with the light inside it.
fn lamp(stage: &mut Stage) {
    let cord = 1.05;
    let radius = 0.11;
    let emission = Vec3::new(46.0, 27.0, 10.0);
    let mut glow = dielectric("lamp glass", [0.8, 0.7, 0.5], 0.3);
    glow.emission = emission;
    glow.shows_light = true;
    let glow = stage.material(glow);
    let iron = stage.material(metal("lamp iron", [0.25, 0.24, 0.24], 0.5));
    // A post with an arm that it hangs from.
    let post = lathe(
        &[
            line(&[[0.10, -SUNK], [0.06, 0.12]]),
            line(&[[0.06, 0.12], [0.045, 2.62]]),
            line(&[[0.045, 2.62], [0.0, 2.64]]),
        ],
        20,
    );
    stage.add("lamp post", post, iron, at(2.30, 0.0, -1.95, 0.0));
    stage.add("lamp arm", block(0.05, 0.05, 1.45, 0.008), iron, at(2.30, 2.53, -1.30, 0.0));
    let hook = stage.node("lamp hook", None, moved(DVec3::new(2.30, 2.54, -0.62)));
    let swing = smooth(LOOP, 8, |t| {
        Quat::from_euler(glam::EulerRot::XYZ, 0.22 * wave(t, 0.25), 0.0, 0.42 * wave(t, 0.0)).to_array()
    });
    stage.channel(hook, Property::Rotation, Interpolation::CubicSpline, swing);
    stage.hang("lamp cord", lathe(&[line(&[[0.008, radius - cord], [0.008, 0.0]])], 8), iron, hook);
    let globe = stage.node("lamp", Some(hook), moved(DVec3::NEG_Y * f64::from(cord)));
    stage.hang("lamp glass", sphere(radius, 20, 32), glow, globe);
    // Just below the glass, which would otherwise block its light.
    let light = stage.node("lamp light", Some(globe), moved(DVec3::NEG_Y * f64::from(radius + 0.01)));
    stage.scene.lights.push(Light::Point {
        position: stage.world(light).translation,
        intensity: emission * (PI * radius * radius),
        range: Some(6.0),
    });
    stage.scene.light_nodes.push(Some(light));
}

/// A camera that rides on the carousel and looks outwards.
fn ride(stage: &mut Stage) {
    let Some(platform) = stage.scene.nodes.iter().position(|n| n.name == "platform") else { return };
    let outwards = turned(DVec3::new(0.0, 1.3, 0.45), std::f64::consts::PI);
    let node = stage.node("ride", Some(platform as u32), outwards);
    let world_from_camera = stage.world(node);
    stage.scene.camera_nodes = vec![None; stage.scene.cameras.len()];
    stage.scene.cameras.push(Camera { name: "ride".to_owned(), world_from_camera, vertical_fov: 1.0, near: 0.05 });
    stage.scene.camera_nodes.push(Some(node));
}

fn moved(translation: DVec3) -> Local {
    turned(translation, 0.0)
}

/// A translation and a rotation about y, in radians.
fn turned(translation: DVec3, angle: f64) -> Local {
    Local::Trs { translation, rotation: DQuat::from_rotation_y(angle), scale: DVec3::ONE }
}
