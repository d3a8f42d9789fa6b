//! Poses, deformations and their bounds, against manual results and slow reference formulas.
use super::*;
use crate::scene::{Animation, Influence, Instance, Interpolation, Mesh, MorphTarget, builtin, deform, supply_missing};
use glam::Affine3A;
use glam::{DMat3, DQuat, Vec4};
use proptest::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI};

fn influence(joint: u32, weight: f32) -> Influence {
    Influence { joint, weight }
}

/// Vertices with normals along x and tangents along y.
fn points(positions: Vec<Vec3>) -> Mesh {
    let n = positions.len();
    Mesh { positions, normals: vec![Vec3::X; n], tangents: vec![Vec4::new(0.0, 1.0, 0.0, -1.0); n], ..Mesh::default() }
}

fn node(parent: Option<u32>, translation: DVec3) -> Node {
    let local = Local::Trs { translation, rotation: DQuat::IDENTITY, scale: DVec3::ONE };
    Node { parent, local, ..Node::default() }
}

fn channel(node: u32, property: Property, times: &[f32], values: &[f32]) -> Channel {
    let (times, values) = (times.to_vec(), values.to_vec());
    Channel { node, property, interpolation: Interpolation::Linear, times, values }
}

/// Two bones of one metre each along y, from the origin. The upper one bends from 0 to 90 degrees about z in two seconds. Node 0
/// shows the mesh.
fn arm() -> Scene {
    let mut mesh = points(vec![Vec3::ZERO, Vec3::Y * 1.5, Vec3::Y * 2.0]);
    let none = influence(0, 0.0);
    mesh.influences = [
        [influence(0, 1.0), none, none, none],
        [influence(0, 0.5), influence(1, 0.5), none, none],
        [influence(1, 1.0), none, none, none],
    ]
    .concat();
    let s = std::f32::consts::FRAC_1_SQRT_2;
    let bend = channel(2, Property::Rotation, &[0.0, 2.0], &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, s, s]);
    let mut instance = Instance::fixed("arm", 0, 0, Affine3A::IDENTITY);
    (instance.node, instance.skin) = (Some(0), Some(0));
    Scene {
        nodes: vec![node(None, DVec3::ZERO), node(None, DVec3::ZERO), node(Some(1), DVec3::Y)],
        skins: vec![Skin {
            name: "arm".into(),
            joints: vec![1, 2],
            inverse_bind: vec![DAffine3::IDENTITY, DAffine3::from_translation(DVec3::NEG_Y)],
        }],
        animations: vec![Animation { name: "bend".into(), duration: 2.0, channels: vec![bend] }],
        meshes: vec![mesh],
        instances: vec![instance],
        ..Scene::default()
    }
}

fn assert_near(got: &[Vec3], wanted: &[[f32; 3]]) {
    assert_eq!(got.len(), wanted.len());
    for (got, wanted) in got.iter().zip(wanted) {
        assert!(got.abs_diff_eq(Vec3::from(*wanted), 1e-6), "{got}, wanted {wanted:?}");
    }
}

#[test]
fn two_bones_by_hand() {
    let scene = arm();
    let animator = Animator::new(&scene);
    assert!(animator.is_animated() && animator.deforms(0) && animator.changes(0) && !animator.moves(0));
    let bent = |time| {
        let pose = animator.pose(time);
        deform(&scene.meshes[0], &pose.joints[0], &pose.weights[0])
    };
    assert_near(&bent(0.0).positions, &[[0.0, 0.0, 0.0], [0.0, 1.5, 0.0], [0.0, 2.0, 0.0]]);
    let s = std::f32::consts::FRAC_1_SQRT_2;
    let half = bent(1.0);
    assert_near(&half.positions, &[[0.0; 3], [-0.25 * s, 1.25 + 0.25 * s, 0.0], [-s, 1.0 + s, 0.0]]);
    assert_near(&half.normals[2..], &[[s, s, 0.0]]);
    assert_eq!(half.tangents[2].w, -1.0);
    assert_near(&[half.tangents[2].truncate()], &[[-s, s, 0.0]]);
    // The matrix of the middle vertex is the mean of the identity and a rotation, so its normal turns by half the angle.
    let (x, y) = (22.5_f32.to_radians().cos(), 22.5_f32.to_radians().sin());
    assert_near(&half.normals[1..2], &[[x, y, 0.0]]);
}

#[test]
fn morphing_comes_before_skinning() {
    let mut mesh = points(vec![Vec3::X]);
    mesh.influences = vec![influence(0, 1.0), influence(0, 0.0), influence(0, 0.0), influence(0, 0.0)];
    mesh.targets = vec![
        MorphTarget { positions: vec![Vec3::Y * 2.0], normals: vec![Vec3::Y], tangents: vec![Vec3::Z] },
        MorphTarget { positions: vec![Vec3::Z], ..MorphTarget::default() },
    ];
    let quarter = DAffine3::from_rotation_z(FRAC_PI_2);
    let got = deform(&mesh, &[quarter], &[0.5, 3.0]);
    assert_near(&got.positions, &[[-1.0, 1.0, 3.0]]);
    // (1, 0.5, 0) rotated; the wrong order would give (0.5, 1, 0).
    let n = Vec3::new(-0.5, 1.0, 0.0).normalize();
    assert_near(&got.normals, &[n.to_array()]);
    let t = Vec3::new(-1.0, 0.0, 0.5);
    assert_near(&[got.tangents[0].truncate()], &[(t - n * n.dot(t)).normalize().to_array()]);
    // Without a skin, and with fewer weights than targets.
    assert_near(&deform(&mesh, &[], &[]).positions, &[[1.0, 0.0, 0.0]]);
    assert_near(&deform(&mesh, &[], &[1.0]).positions, &[[1.0, 2.0, 0.0]]);
}

#[test]
fn a_lost_normal_is_that_of_the_mesh() {
    let mut mesh = points(vec![Vec3::X]);
    mesh.influences = vec![influence(0, 1.0); 1];
    let got = deform(&mesh, &[DAffine3::from_scale(DVec3::ZERO)], &[]);
    assert_eq!((got.positions[0], got.normals[0]), (Vec3::ZERO, Vec3::X));
    assert!((got.tangents[0].truncate().length() - 1.0).abs() < 1e-6);
}

#[test]
fn the_animation_loops_and_is_the_same_every_time() {
    let scene = arm();
    let animator = Animator::new(&scene);
    assert_eq!(animator.duration(), 2.0);
    for time in [0.0, 0.25, 1.75] {
        let pose = animator.pose(time);
        assert_eq!(pose, animator.pose(time + 2.0));
        assert_eq!(pose, animator.pose(time - 6.0));
        assert_eq!(pose, Animator::with_animation(&scene, "bend").unwrap().pose(time));
        assert_eq!(pose, Animator::with_animation(&scene, "0").unwrap().pose(time));
    }
    assert_ne!(animator.pose(0.25), animator.pose(0.75));
    let still = Animator::still(&scene);
    assert!(still.deforms(0) && !still.changes(0) && !still.is_animated());
    assert_eq!(still.pose(0.7), animator.pose(0.0));
    let message = Animator::with_animation(&scene, "1").unwrap_err().to_string();
    assert!(message.contains("\"1\"") && message.contains("bend"), "{message}");
}

/// A node that turns about y and moves, with a child two metres in front of it that has an instance, lights and a camera.
fn hung() -> Scene {
    let s = std::f32::consts::FRAC_1_SQRT_2;
    let channels = vec![
        channel(1, Property::Rotation, &[0.0, 1.0], &[0.0, 0.0, 0.0, 1.0, 0.0, s, 0.0, s]),
        channel(1, Property::Translation, &[0.0, 1.0], &[0.0, 0.0, 0.0, 0.0, 4.0, 0.0]),
        channel(1, Property::Scale, &[0.0, 1.0], &[1.0, 1.0, 1.0, 1.0, 3.0, 1.0]),
    ];
    let at = |position: DVec3| Light::Point { position, intensity: Vec3::ONE, range: None };
    let camera = |name: &str, z: f32| Camera {
        name: name.into(),
        world_from_camera: DAffine3::from_translation(DVec3::Z * f64::from(z)),
        vertical_fov: 1.0,
        near: 0.1,
    };
    let mut moving = Instance::fixed("moving", 0, 0, Affine3A::from_translation(Vec3::Z * -2.0));
    moving.node = Some(2);
    let mut still = moving.clone();
    still.node = Some(0);
    Scene {
        nodes: vec![node(None, DVec3::ZERO), node(None, DVec3::ZERO), node(Some(1), DVec3::Z * -2.0)],
        animations: vec![Animation { name: "turn".into(), duration: 1.0, channels }],
        meshes: vec![points(vec![Vec3::X])],
        instances: vec![moving, still, Instance::fixed("fixed", 0, 0, Affine3A::from_scale(Vec3::splat(3.0)))],
        lights: vec![
            at(DVec3::ONE),
            at(DVec3::Z * -2.0),
            Light::Directional { direction: Vec3::NEG_Z, illuminance: Vec3::ONE, angular_radius: 0.0 },
            Light::Rectangle {
                centre: DVec3::new(1.0, 0.0, -2.0),
                half_u: Vec3::X * 0.5,
                half_v: Vec3::Y * 0.5,
                radiance: Vec3::ONE,
            },
            at(DVec3::ZERO),
        ],
        light_nodes: vec![Some(0), Some(2), Some(2), Some(2)],
        cameras: vec![camera("own", 5.0), camera("rides", -2.0)],
        camera_nodes: vec![None, Some(2)],
        ..Scene::default()
    }
}

#[test]
fn instances_lights_and_cameras_follow_their_nodes() {
    let scene = hung();
    let animator = Animator::new(&scene);
    assert_eq!([0, 1, 2].map(|i| animator.moves(i)), [true, false, false]);
    assert!((0..3).all(|i| !animator.deforms(i) && !animator.changes(i)));
    let rest = animator.pose(0.0);
    assert_eq!((&rest.lights, &rest.cameras), (&scene.lights, &scene.cameras));
    assert!(rest.instances.iter().zip(&scene.instances).all(|(a, b)| *a == b.world_from_object));

    // Just before the end: turned by 90 degrees, 4 m up, and scaled by three in height.
    let pose = animator.pose(1.0 - 1e-9);
    let near = |a: Vec3, b: [f32; 3]| assert!(a.abs_diff_eq(Vec3::from(b), 1e-6), "{a}, wanted {b:?}");
    near(pose.instances[0].transform_point3(DVec3::new(0.0, 1.0, 0.0)).as_vec3(), [-2.0, 7.0, 0.0]);
    assert_eq!(pose.instances[1..], rest.instances[1..]);
    assert_eq!(
        (&pose.lights[0], &pose.lights[4], &pose.cameras[0]),
        (&rest.lights[0], &rest.lights[4], &rest.cameras[0])
    );
    let Light::Point { position, .. } = pose.lights[1] else { panic!() };
    near(position.as_vec3(), [-2.0, 4.0, 0.0]);
    let Light::Directional { direction, .. } = pose.lights[2] else { panic!() };
    near(direction, [-1.0, 0.0, 0.0]);
    let Light::Rectangle { centre, half_u, half_v, .. } = pose.lights[3] else { panic!() };
    near(centre.as_vec3(), [-2.0, 4.0, -1.0]);
    near(half_u, [0.0, 0.0, -0.5]);
    near(half_v, [0.0, 1.5, 0.0]);
    near(pose.cameras[1].eye().as_vec3(), [-2.0, 4.0, 0.0]);
    near(pose.cameras[1].forward(), [-1.0, 0.0, 0.0]);
    assert!((pose.cameras[1].world_from_camera.matrix3.determinant() - 1.0).abs() < 1e-6);
}

#[test]
fn what_has_no_animation_is_said_not_to_move() {
    for scene in [builtin("courtyard").unwrap(), Scene { animations: Vec::new(), ..hung() }, Scene::default()] {
        let animator = Animator::new(&scene);
        assert!(!animator.is_animated() && animator.duration() == 0.0);
        let pose = animator.pose(3.0);
        assert!(pose.bounds.iter().all(Option::is_none) && pose.joints.iter().all(Vec::is_empty));
        assert!(pose.instances.iter().zip(&scene.instances).all(|(a, b)| *a == b.world_from_object));
    }
}

#[test]
fn morph_weights_come_from_channel_node_or_mesh() {
    let mut scene = hung();
    scene.meshes[0].targets = vec![MorphTarget::default(); 2];
    assert!(!Animator::new(&scene).deforms(0), "no weight, no channel");
    scene.meshes[0].weights = vec![0.5];
    scene.nodes[0].weights = vec![0.0, 2.0];
    scene.animations[0].channels.push(channel(2, Property::Weights, &[0.0, 1.0], &[0.0, 1.0, 1.0, 3.0]));
    let animator = Animator::new(&scene);
    assert_eq!(animator.pose(0.5).weights, [vec![0.5, 2.0], vec![0.0, 2.0], vec![0.5, 0.0]]);
    assert_eq!([0, 1, 2].map(|i| animator.changes(i)), [true, false, false]);
    assert!((0..3).all(|i| animator.deforms(i)));
}

/// A pseudo-random generator of numbers in a range (Knuth's MMIX constants).
fn dice(seed: u64) -> impl FnMut(f64, f64) -> f64 {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    move |lo, hi| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        lo + (hi - lo) * (state >> 11) as f64 / (1_u64 << 53) as f64
    }
}

fn vector(roll: &mut impl FnMut(f64, f64) -> f64, size: f64) -> DVec3 {
    DVec3::new(roll(-size, size), roll(-size, size), roll(-size, size))
}

fn affine(roll: &mut impl FnMut(f64, f64) -> f64) -> DAffine3 {
    let rotation = DQuat::from_scaled_axis(vector(roll, 3.0));
    let mut scale = vector(roll, 1.5);
    scale += scale.signum() * 0.2;
    DAffine3::from_scale_rotation_translation(scale, rotation, vector(roll, 4.0))
}

/// A mesh with random vertices, targets and influences.
fn random_mesh(seed: u64, per_vertex: usize) -> Mesh {
    let mut roll = dice(seed);
    let n = 40;
    let mut mesh = points((0..n).map(|_| vector(&mut roll, 2.0).as_vec3()).collect());
    mesh.normals = (0..n).map(|_| vector(&mut roll, 1.0).normalize().as_vec3()).collect();
    mesh.tangents = (0..n)
        .map(|i| {
            let side = if i % 3 == 0 { -1.0 } else { 1.0 };
            mesh.normals[i].cross(vector(&mut roll, 1.0).as_vec3()).normalize().extend(side)
        })
        .collect();
    for k in 0..3 {
        let mut table = |size| (0..n).map(|_| vector(&mut roll, size).as_vec3()).collect::<Vec<_>>();
        let (positions, normals, tangents) = (table(1.0), table(0.4), table(0.4));
        let normals = if k == 1 { Vec::new() } else { normals };
        mesh.targets.push(MorphTarget { positions, normals, tangents });
    }
    for _ in 0..n {
        let mut parts: Vec<f64> = (0..per_vertex).map(|_| roll(-0.5, 1.0).max(0.0)).collect();
        parts[0] += 0.1;
        let sum: f64 = parts.iter().sum();
        mesh.influences.extend(parts.iter().map(|w| influence(roll(0.0, 5.999) as u32, (w / sum) as f32)));
    }
    mesh
}

/// The definition, one number at a time: without blended matrices, and with normals by an inverse.
fn slow(mesh: &Mesh, joints: &[DAffine3], weights: &[f32], i: usize) -> (DVec3, DVec3, DVec3) {
    let (mut p, mut n) = (mesh.positions[i].as_dvec3(), mesh.normals[i].as_dvec3());
    let mut t = mesh.tangents[i].truncate().as_dvec3();
    for (target, w) in mesh.targets.iter().zip(weights) {
        p += f64::from(*w) * target.positions[i].as_dvec3();
        n += f64::from(*w) * target.normals.get(i).copied().unwrap_or_default().as_dvec3();
        t += f64::from(*w) * target.tangents[i].as_dvec3();
    }
    let per_vertex = mesh.influences.len() / mesh.positions.len();
    let (mut moved, mut matrix, mut along) = (DVec3::ZERO, DMat3::ZERO, DVec3::ZERO);
    for part in &mesh.influences[i * per_vertex..(i + 1) * per_vertex] {
        let (joint, w) = (joints[part.joint as usize], f64::from(part.weight));
        moved += w * joint.transform_point3(p);
        along += w * joint.transform_vector3(t);
        matrix += w * joint.matrix3;
    }
    let normal = (matrix.inverse().transpose() * n * matrix.determinant().signum()).normalize();
    (moved, normal, (along - normal * normal.dot(along)).normalize())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn deforming_agrees_with_a_slow_formula_and_stays_in_its_bounds(seed in any::<u64>(), eight in any::<bool>(), far in 0.0_f64..1e4) {
        let mesh = random_mesh(seed, if eight { 8 } else { 4 });
        let mut roll = dice(seed ^ 1);
        let away = DAffine3::from_translation(vector(&mut roll, far));
        let joints: Vec<_> = (0..6).map(|_| away * affine(&mut roll)).collect();
        let weights = [roll(-1.0, 2.0) as f32, roll(-1.0, 2.0) as f32, 0.5];
        let got = deform(&mesh, &joints, &weights);
        let pose_bounds = PoseBounds::of(&mesh);
        let [lo, hi] = pose_bounds.bounds(&joints, &weights).unwrap();
        for i in 0..mesh.positions.len() {
            let (p, n, t) = slow(&mesh, &joints, &weights, i);
            prop_assert!(got.positions[i].as_dvec3().abs_diff_eq(p, 1e-7 * (20.0 + far)), "{} {p}", got.positions[i]);
            // A nearly singular matrix leaves little of the direction.
            prop_assert!(got.normals[i].as_dvec3().abs_diff_eq(n, 1e-5), "{} {n}", got.normals[i]);
            prop_assert!(got.tangents[i].truncate().as_dvec3().abs_diff_eq(t, 1e-5), "{} {t}", got.tangents[i]);
            prop_assert_eq!(got.tangents[i].w, mesh.tangents[i].w);
            prop_assert!(got.positions[i].cmpge(lo).all() && got.positions[i].cmple(hi).all(), "{i}: {lo} {hi}");
        }
        // Morph targets only.
        let got = deform(&mesh, &[], &weights);
        let [lo, hi] = pose_bounds.bounds(&[], &weights).unwrap();
        prop_assert!(got.positions.iter().all(|p| p.cmpge(lo).all() && p.cmple(hi).all()));
    }

    /// In world space, a skinned vertex is where glTF defines it, independent of the mesh's node.
    #[test]
    fn the_node_of_a_skinned_mesh_changes_nothing(seed in any::<u64>(), kind in 0..3) {
        let mut scene = arm();
        let mut roll = dice(seed);
        scene.nodes[1].local = Local::Matrix(affine(&mut roll));
        scene.skins[0].inverse_bind = vec![affine(&mut roll), affine(&mut roll)];
        let place = match kind {
            0 => affine(&mut roll),
            1 => DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0)),
            _ => DAffine3::IDENTITY,
        };
        scene.nodes[0].local = Local::Matrix(place);
        scene.instances[0].world_from_object = place;
        let time = roll(0.0, 2.0);
        let pose = Animator::new(&scene).pose(time);
        prop_assert_eq!(pose.instances[0], if kind == 1 { DAffine3::IDENTITY } else { place });
        let got = deform(&scene.meshes[0], &pose.joints[0], &[]);
        let lower = scene.nodes[1].local.affine();
        let upper = lower * DAffine3::from_rotation_translation(DQuat::from_rotation_z(0.25 * PI * time), DVec3::Y);
        for (i, p) in scene.meshes[0].positions.iter().enumerate() {
            let p = p.as_dvec3();
            let [a, b] = [lower * scene.skins[0].inverse_bind[0], upper * scene.skins[0].inverse_bind[1]].map(|m| m.transform_point3(p));
            let wanted = [a, 0.5 * (a + b), b][i];
            let world = pose.instances[0].transform_point3(got.positions[i].as_dvec3());
            prop_assert!(world.abs_diff_eq(wanted, 2e-5), "{world} {wanted}");
        }
    }
}

#[test]
fn far_from_the_origin_nothing_is_lost() {
    let near = arm();
    let mut far = arm();
    let away = DVec3::new(1e9, -3e8, 2e9);
    for i in 0..2 {
        far.nodes[i].local = Local::Matrix(DAffine3::from_translation(away));
    }
    far.instances[0].world_from_object = DAffine3::from_translation(away);
    let pose = |scene| Animator::new(scene).pose(0.7);
    let (a, b) = (pose(&near), pose(&far));
    assert_eq!(b.instances[0].translation, away);
    let [a, b] = [(&near, a), (&far, b)].map(|(s, p)| deform(&s.meshes[0], &p.joints[0], &[]).positions);
    for (a, b) in a.iter().zip(&b) {
        assert!(a.abs_diff_eq(*b, 1e-6), "{a} {b}");
    }
}

#[test]
fn a_pose_that_is_no_number_is_not_given_bounds_that_are() {
    let mesh = random_mesh(3, 4);
    let mut joints = vec![DAffine3::IDENTITY; 6];
    joints[2].translation.x = f64::NAN;
    assert!(PoseBounds::of(&mesh).bounds(&joints, &[]).unwrap()[0].is_nan());
    assert!(PoseBounds::of(&mesh).bounds(&[], &[f32::INFINITY]).unwrap()[0].is_nan());
    assert_eq!(PoseBounds::of(&Mesh::default()).bounds(&[], &[]), None);
}

#[test]
fn the_carousel_moves_in_every_way() {
    let mut scene = builtin("carousel").unwrap();
    let animator = Animator::new(&scene);
    assert_eq!(animator.duration(), 4.0);
    let (start, end) = (animator.pose(0.0), animator.pose(4.0 - 1e-6));
    for (a, b) in start.instances.iter().zip(&end.instances) {
        // A clock that stands still between two ticks is an eighth behind.
        let hand = scene.instances.iter().filter(|i| i.name == "clock hand").count();
        assert_eq!(hand, 1);
        assert!(a.translation.abs_diff_eq(b.translation, 1e-4), "{a} {b}");
    }
    for time in [0.0, 0.9, 1.7, 3.3] {
        let pose = animator.pose(time);
        for (i, instance) in scene.instances.iter().enumerate() {
            let mesh = &scene.meshes[instance.mesh as usize];
            assert!(pose.instances[i].matrix3.determinant() > 0.0, "{}", instance.name);
            assert_eq!(pose.bounds[i].is_some(), animator.deforms(i));
            let Some([lo, hi]) = pose.bounds[i] else { continue };
            let deformed = deform(mesh, &pose.joints[i], &pose.weights[i]);
            let (mut least, mut most) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
            for p in &deformed.positions {
                (least, most) = (least.min(*p), most.max(*p));
            }
            assert!(least.cmpge(lo).all() && most.cmple(hi).all(), "{}: {lo} {least} {most} {hi}", instance.name);
            // The bounds are conservative, but not useless.
            assert!((hi - lo).max_element() < 2.0 * (most - least).max_element(), "{}: {lo} {hi}", instance.name);
        }
    }
    let count = |f: &dyn Fn(usize) -> bool| (0..scene.instances.len()).filter(|i| f(*i)).count();
    assert!(count(&|i| animator.moves(i)) > 20 && count(&|i| animator.changes(i)) == 3);
    assert!(count(&|i| !animator.moves(i) && !animator.deforms(i)) > 8, "some things stand still");
    let of = |i: usize| &scene.meshes[scene.instances[i].mesh as usize];
    assert_eq!(count(&|i| scene.instances[i].skin.is_some()), 1);
    assert!(count(&|i| of(i).targets.len() >= 2) == 2);
    assert_eq!(scene.meshes.iter().map(|m| m.spheres.len()).sum::<usize>(), 60);
    let triangles: usize = (0..scene.instances.len()).map(|i| of(i).indices.len() / 3).sum();
    assert!((20_000..=60_000).contains(&triangles), "{triangles}");
    for mesh in &scene.meshes {
        let n = mesh.positions.len();
        assert!(mesh.influences.is_empty() || mesh.influences.len() == 4 * n, "{}", mesh.name);
        for vertex in mesh.influences.chunks(4) {
            assert!((vertex.iter().map(|i| i.weight).sum::<f32>() - 1.0).abs() < 1e-6);
        }
        for table in mesh.targets.iter().flat_map(|t| [&t.positions, &t.normals, &t.tangents]) {
            assert!(table.is_empty() || table.len() == n, "{}", mesh.name);
        }
    }
    // Lights and cameras in the rest pose are those of the nodes; one of each is animated.
    let rest = Animator::still(&scene).pose(0.0);
    assert_eq!((&rest.lights, &rest.cameras), (&scene.lights, &scene.cameras));
    let later = animator.pose(1.0);
    assert_eq!(start.lights.iter().zip(&later.lights).filter(|(a, b)| a != b).count(), 1);
    assert_eq!(start.cameras.iter().zip(&later.cameras).filter(|(a, b)| a != b).count(), 1);
    // A camera can be supplied for it, spheres included.
    scene.cameras.clear();
    supply_missing(&mut scene);
    assert!(scene.cameras[0].world_from_camera.is_finite());
}
