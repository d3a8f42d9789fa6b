//! An animated file with a skin and morph targets, and the ways in which it can be invalid.
use super::{glb, load_bytes, load_json, set};
use crate::scene::{Animator, Interpolation, Light, Local, Property, Scene, deform, supply_missing};
use glam::{DAffine3, DQuat, DVec3, Vec3};
use proptest::prelude::*;
use serde_json::{Value, json};

/// A binary chunk under construction, with its views and accessors.
#[derive(Default)]
struct File {
    bin: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl File {
    fn view(&mut self, bytes: &[u8]) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        self.views.push(json!({ "buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len() }));
        self.bin.extend(bytes);
        self.views.len() - 1
    }

    fn accessor(&mut self, component: u32, shape: &str, count: usize, bytes: &[u8]) -> usize {
        let view = self.view(bytes);
        let normalised = component != 5126 && shape != "SCALAR";
        self.accessors.push(json!({
            "bufferView": view, "componentType": component, "count": count, "type": shape, "normalized": normalised,
        }));
        self.accessors.len() - 1
    }

    fn floats(&mut self, shape: &str, values: &[f32]) -> usize {
        let width = match shape {
            "SCALAR" => 1,
            "VEC3" => 3,
            "MAT4" => 16,
            _ => 4,
        };
        let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
        self.accessor(5126, shape, values.len() / width, &bytes)
    }
}

const POSITION: usize = 0;
const JOINTS: usize = 2;
const WEIGHTS: usize = 3;
const JOINTS_1: usize = 4;
const WEIGHTS_1: usize = 5;
const DELTAS: usize = 6;
const BINDS: usize = 8;
const TIMES: usize = 9;
const MOVES: usize = 10;
const TURNS: usize = 11;
const SHAPES: usize = 12;
const SIZES: usize = 13;

/// A square that two joints and two morph targets deform. The upper joint is animated and carries a light; the weights and the
/// scale of the node that shows the square are animated too.
fn moving() -> (Value, Vec<u8>) {
    let mut f = File::default();
    let square = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0];
    assert_eq!(f.floats("VEC3", &square), POSITION);
    f.floats("VEC3", &[0.0, 0.0, 1.0].repeat(4));
    assert_eq!(f.accessor(5121, "VEC4", 4, &[0, 9, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0]), JOINTS);
    f.accessors[JOINTS]["normalized"] = json!(false);
    let weights = [255, 0, 0, 0, 255, 0, 0, 0, 204, 51, 0, 0, 0, 0, 0, 0];
    assert_eq!(f.accessor(5121, "VEC4", 4, &weights), WEIGHTS);
    let joints: Vec<u8> =
        [[0_u16; 4], [0; 4], [0; 4], [1, 0, 0, 0]].as_flattened().iter().flat_map(|j| j.to_le_bytes()).collect();
    assert_eq!(f.accessor(5123, "VEC4", 4, &joints), JOINTS_1);
    f.accessors[JOINTS_1]["normalized"] = json!(false);
    let weights: Vec<u8> = [[0_u16; 4], [0; 4], [65535, 0, 0, 0], [40000, 0, 0, 0]]
        .as_flattened()
        .iter()
        .flat_map(|w| w.to_le_bytes())
        .collect();
    assert_eq!(f.accessor(5123, "VEC4", 4, &weights), WEIGHTS_1);
    // A sparse target that moves only vertex 2.
    let (place, value) =
        (f.view(&[2, 0]), f.view(&[0_f32, 0.0, 2.0].iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<_>>()));
    f.accessors.push(json!({ "componentType": 5126, "count": 4, "type": "VEC3", "sparse": {
        "count": 1, "indices": { "bufferView": place, "componentType": 5123 }, "values": { "bufferView": value },
    } }));
    assert_eq!(f.floats("VEC3", &[1.0, 0.0, 0.0].repeat(4)), DELTAS + 1);
    let identity = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    let mut down = identity;
    down[13] = -1.0;
    assert_eq!(f.floats("MAT4", &[identity, down, identity].concat()), BINDS);
    assert_eq!(f.floats("SCALAR", &[0.5, 1.5]), TIMES);
    assert_eq!(f.floats("VEC3", &[0.0, 1.0, 0.0, 0.0, 3.0, 0.0]), MOVES);
    // 0 and 180 degrees about z, as normalised i16.
    let turns: Vec<u8> = [0, 0, 0, 32767, 0, 0, 32767, 0].iter().flat_map(|x: &i16| x.to_le_bytes()).collect();
    assert_eq!(f.accessor(5122, "VEC4", 2, &turns), TURNS);
    assert_eq!(f.accessor(5121, "SCALAR", 4, &[0, 255, 255, 51]), SHAPES);
    f.accessors[SHAPES]["normalized"] = json!(true);
    let sizes = [[0.0; 3], [1.0; 3], [0.0; 3], [0.0; 3], [2.0; 3], [0.0; 3]].concat();
    assert_eq!(f.floats("VEC3", &sizes), SIZES);
    let indices: Vec<u8> = [0_u16, 1, 2, 0, 2, 3].iter().flat_map(|x| x.to_le_bytes()).collect();
    let indices = f.accessor(5123, "SCALAR", 6, &indices);
    let root = json!({
        "asset": { "version": "2.0" },
        "scenes": [{ "nodes": [0, 4] }],
        "nodes": [
            { "name": "root", "children": [1, 2], "translation": [5, 0, 0] },
            { "name": "shown", "mesh": 0, "skin": 0, "weights": [0.5, 0.25] },
            { "name": "lower", "children": [3] },
            { "name": "upper", "translation": [0, 1, 0], "camera": 0, "extensions": { "KHR_lights_punctual": { "light": 0 } } },
            { "name": "stiff", "mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 4, 1] },
            { "name": "elsewhere" },
        ],
        "skins": [{ "name": "bones", "joints": [2, 3], "inverseBindMatrices": BINDS }],
        "cameras": [{ "type": "perspective", "perspective": { "yfov": 0.8, "znear": 0.1 } }],
        "extensions": { "KHR_lights_punctual": { "lights": [{ "type": "point" }] } },
        "meshes": [{ "name": "square", "weights": [0.0, 1.0], "primitives": [{
            "attributes": {
                "POSITION": POSITION, "NORMAL": 1,
                "JOINTS_0": JOINTS, "WEIGHTS_0": WEIGHTS, "JOINTS_1": JOINTS_1, "WEIGHTS_1": WEIGHTS_1,
            },
            "indices": indices,
            "targets": [{ "POSITION": DELTAS }, { "POSITION": DELTAS + 1, "NORMAL": DELTAS + 1 }],
        }] }],
        "animations": [{
            "name": "all",
            "samplers": [
                { "input": TIMES, "output": MOVES },
                { "input": TIMES, "output": TURNS, "interpolation": "LINEAR" },
                { "input": TIMES, "output": SHAPES, "interpolation": "STEP" },
                { "input": TIMES, "output": SIZES, "interpolation": "CUBICSPLINE" },
            ],
            "channels": [
                { "sampler": 0, "target": { "node": 3, "path": "translation" } },
                { "sampler": 1, "target": { "node": 3, "path": "rotation" } },
                { "sampler": 2, "target": { "node": 1, "path": "weights" } },
                { "sampler": 3, "target": { "node": 1, "path": "scale" } },
            ],
        }],
        "accessors": f.accessors,
        "bufferViews": f.views,
        "buffers": [{ "byteLength": f.bin.len() }],
        "extensionsUsed": ["KHR_lights_punctual"],
    });
    (root, f.bin)
}

fn changed(changes: &[(&str, Value)]) -> Result<Scene, crate::scene::SceneError> {
    let (mut root, bin) = moving();
    for (pointer, value) in changes {
        set(&mut root, pointer, value.clone());
    }
    load_json(&root, &bin)
}

#[test]
fn everything_that_moves_is_read() {
    let scene = changed(&[]).unwrap();
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    // Parents before children, in the order of the traversal, without nodes outside the scene.
    let nodes: Vec<_> = scene.nodes.iter().map(|n| (n.name.as_str(), n.parent)).collect();
    assert_eq!(nodes, [("root", None), ("shown", Some(0)), ("lower", Some(0)), ("upper", Some(2)), ("stiff", None)]);
    assert!(matches!(scene.nodes[4].local, Local::Matrix(m) if m == DAffine3::from_translation(DVec3::Z * 4.0)));
    assert_eq!(scene.nodes[1].weights, [0.5, 0.25]);
    let [shown, stiff] = &scene.instances[..] else { panic!("{:?}", scene.instances) };
    assert_eq!((shown.mesh, shown.node, shown.skin), (0, Some(1), Some(0)));
    assert_eq!((stiff.mesh, stiff.node, stiff.skin), (0, Some(4), None));
    assert_eq!((&scene.light_nodes[..], &scene.camera_nodes[..]), (&[Some(3)][..], &[Some(3)][..]));

    let skin = &scene.skins[0];
    assert_eq!((skin.name.as_str(), &skin.joints[..]), ("bones", &[2, 3][..]));
    assert_eq!(skin.inverse_bind, [DAffine3::IDENTITY, DAffine3::from_translation(DVec3::NEG_Y)]);
    let mesh = &scene.meshes[0];
    assert_eq!((mesh.influences_per_vertex(), &mesh.weights[..]), (8, &[0.0, 1.0][..]));
    let part =
        |vertex: usize, k: usize| (mesh.influences[8 * vertex + k].joint, mesh.influences[8 * vertex + k].weight);
    assert_eq!((part(0, 0), part(0, 1)), ((0, 1.0), (0, 0.0)), "a joint without weight may be any");
    // The weights of both sets sum to 0.8 + 0.2 + 1.
    assert_eq!((part(2, 0), part(2, 1), part(2, 4)), ((1, 0.4), (0, 0.1), (0, 0.5)));
    assert_eq!((part(3, 0), part(3, 4)), ((1, 0.0), (1, 1.0)));
    assert_eq!(mesh.targets[0].positions, [Vec3::ZERO, Vec3::ZERO, Vec3::Z * 2.0, Vec3::ZERO]);
    assert_eq!((mesh.targets[1].normals.len(), mesh.targets[0].normals.len()), (4, 0));

    let animation = &scene.animations[0];
    assert_eq!((animation.name.as_str(), animation.duration), ("all", 1.5));
    let kinds: Vec<_> = animation.channels.iter().map(|c| (c.node, c.property, c.interpolation)).collect();
    assert_eq!(
        kinds,
        [
            (3, Property::Translation, Interpolation::Linear),
            (3, Property::Rotation, Interpolation::Linear),
            (1, Property::Weights, Interpolation::Step),
            (1, Property::Scale, Interpolation::CubicSpline),
        ]
    );
    assert_eq!(animation.channels[2].values, [0.0, 1.0, 1.0, 0.2]);
}

#[test]
fn a_pose_of_the_file_by_hand() {
    let scene = changed(&[]).unwrap();
    let animator = Animator::new(&scene);
    assert!(animator.moves(0) && animator.changes(0) && animator.deforms(1) && !animator.changes(1));
    // Halfway: the upper joint is 2 m up and turned by 90 degrees, and the node is scaled by 1.5.
    let pose = animator.pose(1.0);
    assert_eq!(pose.weights, [vec![0.0, 1.0], vec![0.0, 1.0]]);
    assert!(pose.instances[0].abs_diff_eq(
        DAffine3::from_scale_rotation_translation(DVec3::splat(1.5), DQuat::IDENTITY, DVec3::X * 5.0),
        1e-12
    ));
    let got = deform(&scene.meshes[0], &pose.joints[0], &pose.weights[0]).positions;
    let world: Vec<_> = got.iter().map(|p| pose.instances[0].transform_point3(p.as_dvec3()).as_vec3()).collect();
    // The second target first moves everything by 1 in x. Vertex 3, (1, 1, 0), follows the upper joint: it is (1, 0, 0) from the
    // joint, hence (0, 1, 0) after the turn, plus 2 m up and 5 to the side. Vertex 2, (2, 1, 0), follows it by 0.4: 0.6 (7, 1, 0)
    // + 0.4 (5, 4, 0).
    let wanted = [[6.0, 0.0, 0.0], [7.0, 0.0, 0.0], [6.2, 2.2, 0.0], [5.0, 3.0, 0.0]];
    for (got, wanted) in world.iter().zip(wanted) {
        assert!(got.abs_diff_eq(wanted.into(), 1e-4), "{got} {wanted:?}");
    }
    let Light::Point { position, .. } = pose.lights[0] else { panic!() };
    assert!(position.abs_diff_eq(DVec3::new(5.0, 2.0, 0.0), 1e-5) && pose.cameras[0].eye() == position);
    // Before the first key it holds that key's value, and properties without a channel keep the transform of the file.
    assert_eq!(animator.pose(0.2), animator.pose(0.5));
}

#[test]
fn every_fault_of_what_moves_is_named() {
    let accessor = |i: usize, key: &str| format!("/accessors/{i}/{key}");
    let attribute = |name: &str| format!("/meshes/0/primitives/0/attributes/{name}");
    let sampler = |i: usize, key: &str| format!("/animations/0/samplers/{i}/{key}");
    let huge = 1_u64 << 40;
    let cases: &[(String, Value, &[&str])] = &[
        (attribute("WEIGHTS_0"), Value::Null, &["mesh 0 primitive 0", "WEIGHTS_0 is missing"]),
        (attribute("JOINTS_1"), Value::Null, &["mesh 0 primitive 0", "JOINTS_1 is missing"]),
        (attribute("JOINTS_0"), json!(99), &["mesh 0 primitive 0 JOINTS_0", "accessor 99 of"]),
        (accessor(JOINTS, "componentType"), json!(5126), &["JOINTS_0", "F32", "VEC4 of u8 or u16"]),
        (accessor(JOINTS, "normalized"), json!(true), &["JOINTS_0", "normalised U8"]),
        (accessor(JOINTS, "count"), json!(3), &["JOINTS_0", "3 elements, wanted 4"]),
        (accessor(WEIGHTS, "count"), json!(huge), &["WEIGHTS_0", "elements, wanted 4"]),
        (accessor(WEIGHTS, "normalized"), json!(false), &["WEIGHTS_0", "U8", "normalised u8 or u16"]),
        (accessor(WEIGHTS, "bufferView"), json!(77), &["WEIGHTS_0", "buffer view 77"]),
        ("/skins/0/joints".into(), json!([2]), &["node 1 mesh 0 primitive 0 JOINTS", "joint 1 of 1"]),
        ("/skins/0/joints".into(), json!([]), &["skin 0", "a joint is missing"]),
        ("/skins/0/joints".into(), json!([2, 3, 99]), &["skin 0", "node 99 of 6"]),
        ("/skins/0/joints".into(), json!([2, 3, 2, 3]), &["skin 0 inverseBindMatrices", "3 elements, wanted 4"]),
        ("/nodes/1/skin".into(), json!(4), &["node 1", "skin 4 of 1"]),
        (accessor(BINDS, "count"), json!(huge), &["skin 0 inverseBindMatrices", "the limit is 65536"]),
        (accessor(BINDS, "type"), json!("VEC4"), &["skin 0 inverseBindMatrices", "wanted MAT4"]),
        ("/skins/0/inverseBindMatrices".into(), json!(50), &["skin 0 inverseBindMatrices", "accessor 50 of"]),
        (accessor(DELTAS, "count"), json!(5), &["mesh 0 primitive 0 target 0 POSITION", "5 elements, wanted 4"]),
        (accessor(DELTAS, "sparse/indices/bufferView"), json!(70), &["target 0 POSITION", "buffer view 70"]),
        (
            "/meshes/0/primitives/0/targets".into(),
            json!(vec![json!({ "POSITION": 0, "NORMAL": 0, "TANGENT": 0 }); 12_000]),
            &["mesh 0", "the number of weights", "12000 morph targets"],
        ),
        ("/meshes/0/weights".into(), json!([1.0]), &["mesh 0", "the number of weights is 1 for 2"]),
        ("/nodes/1/weights".into(), json!([1.0, 2.0, 3.0]), &["node 1", "the number of weights is 3 for 2"]),
        ("/nodes/1/weights".into(), json!([1.0, 1e39]), &["node 1 weights", "element 1 is not finite"]),
        ("/nodes/1/weights".into(), json!([1e25, 0.0]), &["node shown in the rest pose", "world coordinate"]),
        ("/animations/0/channels/0/sampler".into(), json!(9), &["animation 0 channel 0", "sampler 9 of 4"]),
        ("/animations/0/channels/0/target/node".into(), json!(9), &["animation 0 channel 0", "node 9 of 6"]),
        (sampler(0, "input"), json!(90), &["animation 0 channel 0 input", "accessor 90 of"]),
        (sampler(0, "output"), json!(90), &["animation 0 channel 0 output", "accessor 90 of"]),
        (sampler(0, "interpolation"), json!("SMOOTH"), &["animation 0 channel 0", "interpolation is unknown"]),
        (sampler(0, "interpolation"), json!("CUBICSPLINE"), &["channel 0 output", "2 elements, wanted 6"]),
        (sampler(0, "output"), json!(TIMES), &["channel 0 output", "wanted VEC3"]),
        (sampler(0, "input"), json!(SHAPES), &["channel 0 output", "2 elements, wanted 4"]),
        (accessor(SHAPES, "count"), json!(3), &["channel 2 output", "3 elements, wanted 4"]),
        (accessor(TURNS, "componentType"), json!(5125), &["channel 1 output", "U32"]),
        (accessor(TURNS, "normalized"), json!(false), &["channel 1 output", "normalised 8 and 16 bit"]),
        (accessor(TURNS, "bufferView"), Value::Null, &["channel 1 output", "rotation", "unit quaternion"]),
        (accessor(MOVES, "componentType"), json!(5122), &["channel 0 output", "I16", "wanted f32"]),
        (accessor(TIMES, "count"), json!(huge), &["channel 0 output", "2 elements, wanted 1099511627776"]),
        (accessor(TIMES, "count"), json!(0), &["channel 0 output", "wanted 0"]),
    ];
    for (pointer, value, wanted) in cases {
        let got = match changed(&[(pointer, value.clone())]) {
            Ok(scene) => panic!("{pointer} = {value} was taken: {:?}", scene.warnings),
            Err(e) => e.to_string(),
        };
        for part in wanted.iter().chain(&["bad.glb"]) {
            assert!(got.contains(part), "{pointer} = {value}: {got}, wanted {part:?}");
        }
    }
    // Sizes that are consistent but too large.
    let sizes = [json!(1_u64 << 27), json!(1_u64 << 27)];
    let got = changed(&[(&accessor(TIMES, "count"), sizes[0].clone()), (&accessor(MOVES, "count"), sizes[1].clone())]);
    let got = got.unwrap_err().to_string();
    assert!(got.contains("animation 0 channel 0: 536870912 numbers in keys, the limit is 134217728"), "{got}");
    let target = json!({ "POSITION": 0, "NORMAL": 0, "TANGENT": 0 });
    let got = changed(&[
        ("/meshes/0/primitives/0/targets", json!(vec![target; 3])),
        (&accessor(POSITION, "count"), json!(1 << 25)),
    ]);
    let got = got.unwrap_err().to_string();
    assert!(got.contains("mesh 0 primitive 0: 301989888 vectors of morph targets, the limit is 134217728"), "{got}");
    let got = changed(&[(&accessor(POSITION, "count"), json!((1 << 25) + 1))]).unwrap_err().to_string();
    assert!(got.contains("mesh 0 primitive 0: 268435464 influences of joints, the limit is 268435456"), "{got}");
}

#[test]
fn faulty_numbers_of_what_moves_are_named() {
    let (root, bin) = moving();
    let offset = |accessor: usize| {
        let view = root["accessors"][accessor]["bufferView"].as_u64().unwrap() as usize;
        root["bufferViews"][view]["byteOffset"].as_u64().unwrap() as usize
    };
    for (accessor, at, value, wanted) in [
        (TIMES, 1, 0.25_f32, "animation 0 channel 0 input: the time of a key is 0.25 after 0.5"),
        (TIMES, 0, -1.0, "animation 0 channel 0 input: the time of key 0 is -1"),
        (TIMES, 1, f32::NAN, "animation 0 channel 0 input: element 1 is not finite"),
        (MOVES, 4, f32::INFINITY, "animation 0 channel 0 output: element 1 is not finite"),
        (BINDS, 20, f32::NAN, "skin 0 inverseBindMatrices: element 1 is not finite"),
        (BINDS, 15, 0.5, "skin 0 inverseBindMatrices: the last row of a matrix is [0, 0, 0, 0.5]"),
    ] {
        let mut bin = bin.clone();
        let at = offset(accessor) + 4 * at;
        bin[at..at + 4].copy_from_slice(&value.to_le_bytes());
        let got = load_json(&root, &bin).map(|s| panic!("{wanted}: {:?}", s.warnings)).unwrap_err().to_string();
        assert!(got.contains(wanted), "{got}, wanted {wanted}");
    }
    // A negative weight, which float accessors can hold.
    let (mut root, mut bin) = moving();
    let start = bin.len();
    bin.extend([-0.5_f32; 16].iter().flat_map(|x| x.to_le_bytes()));
    root["bufferViews"].as_array_mut().unwrap().push(json!({ "buffer": 0, "byteOffset": start, "byteLength": 64 }));
    let view = root["bufferViews"].as_array().unwrap().len() - 1;
    root["buffers"][0]["byteLength"] = json!(bin.len());
    root["accessors"][WEIGHTS] = json!({ "bufferView": view, "componentType": 5126, "count": 4, "type": "VEC4" });
    let got = load_json(&root, &bin).unwrap_err().to_string();
    assert!(got.contains("mesh 0 primitive 0 WEIGHTS_0: a weight is -0.5, wanted at least 0"), "{got}");
}

#[test]
fn what_cannot_be_carried_out_is_said() {
    let warned = |changes: &[(&str, Value)], wanted: &str| {
        let scene = changed(changes).unwrap();
        assert!(scene.warnings.iter().any(|w| w.contains(wanted)), "{:?}, wanted {wanted}", scene.warnings);
        scene
    };
    let target = |c: usize| format!("/animations/0/channels/{c}/target");
    let scene =
        warned(&[(&target(0), json!({ "node": 4, "path": "translation" }))], "all: 1 channel for nodes with a matrix");
    assert_eq!(scene.animations[0].channels.len(), 3);
    warned(
        &[(&target(0), json!({ "node": 5, "path": "translation" }))],
        "all: 1 channel for nodes that are not in the scene",
    );
    warned(&[(&target(0), json!({ "node": 3, "path": "pointer" }))], "all: 1 channel for unknown properties");
    warned(&[(&target(2), json!({ "node": 0, "path": "weights" }))], "all: 1 channel for nodes without morph targets");
    let scene =
        warned(&[(&target(0), json!({ "path": "pointer" }))], "1 channels of animations without a node: ignored");
    assert_eq!(scene.animations[0].channels.len(), 3);
    let again = json!({ "sampler": 1, "target": { "node": 3, "path": "rotation" } });
    let scene = warned(&[("/animations/0/channels/0", again)], "all: 1 channel for what another channel moves");
    assert_eq!(scene.animations[0].channels.len(), 3);
    let scene = warned(&[("/animations/0/channels", json!([]))], "animation all moves nothing in the scene: ignored");
    assert!(scene.animations.is_empty() && !Animator::new(&scene).is_animated());
    let scene =
        warned(&[("/skins/0/joints/1", json!(5))], "skin bones: its joint, node 5, is not in the scene: ignored");
    assert!(scene.skins.is_empty() && scene.instances[0].skin.is_none());
    let primitive = "/meshes/0/primitives/0/attributes";
    let scene =
        warned(&[(primitive, json!({ "POSITION": 0 }))], "shown with a skin, but has no joints: follows its node");
    assert!(scene.instances[0].skin.is_none());
    // Flat normals: every table is expanded, and deltas of normals are dropped because the file has no normals.
    assert_eq!((scene.meshes[0].positions.len(), scene.meshes[0].targets[0].positions.len()), (6, 6));
    assert!(scene.meshes[0].targets[1].normals.is_empty());
    let four = json!({ "POSITION": 0, "NORMAL": 1, "JOINTS_0": JOINTS, "WEIGHTS_0": WEIGHTS });
    let scene = warned(&[(primitive, four)], "WEIGHTS_0: 1 vertices without weights follow their first joint");
    assert_eq!((scene.meshes[0].influences[12].joint, scene.meshes[0].influences[12].weight), (1, 1.0));
    // A skinned mesh ignores a singular node, and an animated node may be singular.
    let scene = changed(&[
        ("/nodes/1/scale", json!([0, 1, 1])),
        ("/animations/0/channels/3", json!({ "sampler": 2, "target": { "node": 1, "path": "weights" } })),
    ])
    .unwrap();
    assert_eq!((scene.instances.len(), scene.instances[0].world_from_object), (2, DAffine3::IDENTITY));
    let flat = [("/nodes/1/scale", json!([0, 1, 1])), ("/nodes/1/skin", Value::Null)];
    assert_eq!(changed(&flat).unwrap().instances.len(), 2, "an animation gives it a size");
    let scene = warned(&[&flat[..], &[("/animations", json!([]))]].concat(), "node 1 (shown) has a singular transform");
    assert_eq!(scene.instances.len(), 1);
}

#[test]
fn a_skin_may_have_no_matrices() {
    let scene = changed(&[("/skins/0", json!({ "joints": [2, 3] }))]).unwrap();
    assert_eq!(scene.skins[0].inverse_bind, [DAffine3::IDENTITY; 2]);
    assert_eq!(scene.skins[0].name, "skin 0");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2500, failure_persistence: None, ..ProptestConfig::default() })]

    /// Any bytes give an error, or a scene with valid indices that can be posed at any time.
    #[test]
    fn no_bytes_that_move_make_it_panic(changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6), digits in any::<bool>(), time in -10.0_f64..10.0) {
        let (root, bin) = moving();
        let mut bytes = glb(&root, &bin);
        for (at, to) in changes {
            let at = at.index(bytes.len());
            bytes[at] = if digits && bytes[at].is_ascii_digit() { b'0' + to % 10 } else { to };
        }
        if let Ok(mut scene) = load_bytes(&bytes) {
            supply_missing(&mut scene);
            prop_assert!(scene.cameras.iter().all(|c| c.world_from_camera.is_finite()));
            for (i, node) in scene.nodes.iter().enumerate() {
                prop_assert!(node.parent.is_none_or(|p| (p as usize) < i));
            }
            let mut animators = vec![Animator::still(&scene)];
            for (i, a) in scene.animations.iter().enumerate() {
                prop_assert!(a.duration.is_finite() && a.duration >= 0.0);
                for c in &a.channels {
                    prop_assert!((c.node as usize) < scene.nodes.len() && !c.times.is_empty());
                    prop_assert!(c.values.iter().chain(&c.times).all(|x| x.is_finite()));
                }
                animators.push(Animator::with_animation(&scene, &i.to_string()).unwrap());
            }
            for (still, animator) in animators.iter().enumerate().map(|(i, a)| (i == 0, a)) {
                let pose = animator.pose(time);
                prop_assert_eq!(pose.lights.len(), scene.lights.len());
                for (i, instance) in scene.instances.iter().enumerate() {
                    let mesh = &scene.meshes[instance.mesh as usize];
                    let n = mesh.positions.len();
                    prop_assert_eq!(mesh.influences.len(), mesh.influences_per_vertex() * n);
                    for t in &mesh.targets {
                        prop_assert!([&t.positions, &t.normals, &t.tangents].iter().all(|t| t.is_empty() || t.len() == n));
                    }
                    prop_assert_eq!(animator.deforms(i), pose.bounds[i].is_some());
                    let Some([lo, hi]) = pose.bounds[i] else { continue };
                    let got = deform(mesh, &pose.joints[i], &pose.weights[i]);
                    if still || lo.is_finite() && hi.is_finite() {
                        prop_assert!(got.positions.iter().all(|p| p.cmpge(lo).all() && p.cmple(hi).all()), "{lo} {hi} {got:?}");
                    }
                }
            }
        }
    }
}
