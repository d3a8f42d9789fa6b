//! Valid and invalid files, generated here.
use super::*;
use crate::scene::{AlphaMode, ColourSpace, Light, supply_missing};
use glam::{DVec3, Vec2, Vec3, Vec4};
use proptest::prelude::*;
use serde_json::{Value, json};
use std::f32::consts::FRAC_1_SQRT_2;

mod layers;
mod motion;

/// Bytes of a 2x1 PNG.
fn png() -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let image = image::RgbaImage::from_raw(2, 1, vec![255, 0, 0, 255, 0, 0, 255, 128]).unwrap();
    image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

/// Two triangles with every kind of data: 4 positions, normals, texture coordinates, 6 indices, and an image.
fn good() -> (Value, Vec<u8>) {
    let mut bin = Vec::new();
    for v in [[0.0_f32, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]] {
        bin.extend(v.iter().flat_map(|x| x.to_le_bytes()));
    }
    for _ in 0..4 {
        bin.extend([0.0_f32, 0.0, 1.0].iter().flat_map(|x| x.to_le_bytes()));
    }
    for v in [[0.0_f32, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]] {
        bin.extend(v.iter().flat_map(|x| x.to_le_bytes()));
    }
    bin.extend([0_u16, 1, 2, 0, 2, 3].iter().flat_map(|x| x.to_le_bytes()));
    let png = png();
    let image_at = bin.len();
    bin.extend(&png);
    while bin.len() % 4 != 0 {
        bin.push(0);
    }
    let root = json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0, 2] }],
        "nodes": [
            { "name": "turned", "children": [1], "rotation": [0.0, FRAC_1_SQRT_2, 0.0, FRAC_1_SQRT_2] },
            { "name": "moved", "mesh": 0, "translation": [1.0, 2.0, 3.0] },
            { "name": "plain", "mesh": 0 },
        ],
        "meshes": [{ "name": "square", "primitives": [{
            "attributes": { "POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2 }, "indices": 3, "material": 0,
        }] }],
        "materials": [{
            "name": "paint",
            "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 }, "metallicFactor": 0.25, "roughnessFactor": 0.5 },
            "emissiveTexture": { "index": 0 },
            "normalTexture": { "index": 0, "extensions": { "KHR_texture_transform": { "scale": [2, 2] } } },
            "alphaMode": "MASK", "alphaCutoff": 0.3, "doubleSided": true,
            "emissiveFactor": [1, 0.5, 0],
            "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 4 } },
        }],
        "textures": [{ "source": 0, "sampler": 0 }],
        "samplers": [{ "wrapS": 33071, "minFilter": 9729 }],
        "images": [{ "bufferView": 4, "mimeType": "image/png" }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3" },
            { "bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC3" },
            { "bufferView": 2, "componentType": 5126, "count": 4, "type": "VEC2" },
            { "bufferView": 3, "componentType": 5123, "count": 6, "type": "SCALAR" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": 48 },
            { "buffer": 0, "byteOffset": 48, "byteLength": 48 },
            { "buffer": 0, "byteOffset": 96, "byteLength": 32 },
            { "buffer": 0, "byteOffset": 128, "byteLength": 12 },
            { "buffer": 0, "byteOffset": image_at, "byteLength": png.len() },
        ],
        "buffers": [{ "byteLength": bin.len() }],
        "extensionsUsed": ["KHR_texture_transform", "KHR_materials_emissive_strength", "KHR_lights_punctual"],
    });
    (root, bin)
}

fn glb(root: &Value, bin: &[u8]) -> Vec<u8> {
    let mut text = root.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut out = b"glTF".to_vec();
    out.extend(2_u32.to_le_bytes());
    out.extend(((12 + 8 + text.len() + 8 + bin.len()) as u32).to_le_bytes());
    out.extend((text.len() as u32).to_le_bytes());
    out.extend(b"JSON");
    out.extend(&text);
    out.extend((bin.len() as u32).to_le_bytes());
    out.extend(b"BIN\0");
    out.extend(bin);
    out
}

fn load_bytes(bytes: &[u8]) -> Result<Scene, SceneError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bad.glb");
    std::fs::write(&path, bytes).unwrap();
    load(&path)
}

fn load_json(root: &Value, bin: &[u8]) -> Result<Scene, SceneError> {
    load_bytes(&glb(root, bin))
}

/// The error message for the valid file with one value replaced; `Value::Null` removes the value.
fn message(pointer: &str, value: Value) -> String {
    let (mut root, bin) = good();
    set(&mut root, pointer, value);
    load_json(&root, &bin).map(|s| panic!("{pointer} was taken: {:?}", s.warnings)).unwrap_err().to_string()
}

fn set(root: &mut Value, pointer: &str, value: Value) {
    let (parent, key) = pointer.rsplit_once('/').unwrap();
    match root.pointer_mut(parent).unwrap() {
        Value::Object(map) if value.is_null() => {
            map.remove(key).unwrap();
        }
        Value::Object(map) => {
            map.insert(key.to_owned(), value);
        }
        Value::Array(list) => list[key.parse::<usize>().unwrap()] = value,
        other => panic!("{pointer}: {other}"),
    }
}

#[test]
fn a_good_file_is_read_whole() {
    let (root, bin) = good();
    let scene = load_json(&root, &bin).unwrap();
    assert_eq!((scene.meshes.len(), scene.instances.len(), scene.materials.len()), (1, 2, 1));
    let mesh = &scene.meshes[0];
    assert_eq!((mesh.positions.len(), mesh.indices.len()), (4, 6));
    assert!(mesh.tangents.iter().all(|t| t.abs_diff_eq(Vec4::new(1.0, 0.0, 0.0, 1.0), 1e-6)));
    assert!(mesh.colours.iter().all(|c| *c == Vec4::ONE));
    let moved = scene.instances[0].world_from_object.transform_point3(DVec3::ZERO);
    assert!(moved.abs_diff_eq(DVec3::new(3.0, 2.0, -1.0), 1e-5), "{moved}");
    let material = &scene.materials[0];
    assert_eq!(material.emission, Vec3::new(4.0, 2.0, 0.0));
    assert_eq!((material.metalness, material.roughness, material.double_sided), (0.25, 0.5, true));
    assert_eq!(material.alpha, AlphaMode::Mask(0.3));
    assert_eq!(material.normal_texture.unwrap().rows[0], Vec3::X * 2.0);
    // One image in two colour spaces makes two textures, not three.
    assert_eq!(material.base_colour_texture.unwrap().texture, material.emission_texture.unwrap().texture);
    assert_eq!(scene.textures.len(), 2);
    assert_eq!(scene.textures[0].colour_space, ColourSpace::Srgb);
    assert_eq!(scene.textures[0].mips, [vec![255, 0, 0, 255, 0, 0, 255, 128], vec![188, 0, 188, 192]]);
    assert!(!scene.samplers[0].mips && scene.samplers.len() == 1);
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
}

#[test]
fn every_fault_names_file_and_element() {
    let cases: &[(&str, Value, &[&str])] = &[
        (
            "/accessors/0/count",
            json!(40),
            &["mesh 0 primitive 0 POSITION", "accessor 0 reads bytes 0..480 of a 48 byte"],
        ),
        ("/accessors/0/count", json!(u64::MAX), &["mesh 0 primitive 0", "vertices, the limit is"]),
        (
            "/accessors/0/byteOffset",
            json!(u64::MAX - 3),
            &["POSITION", "accessor 0 reads bytes", "48 byte buffer view"],
        ),
        ("/accessors/0/componentType", json!(5125), &["mesh 0 primitive 0 POSITION", "U32"]),
        ("/accessors/0/componentType", json!(5122), &["POSITION", "I16", "KHR_mesh_quantization"]),
        ("/accessors/0/componentType", json!(7), &["mesh 0 primitive 0 POSITION", "unknown"]),
        ("/accessors/0/type", json!("VEC2"), &["mesh 0 primitive 0 POSITION", "Vec2", "VEC3"]),
        ("/accessors/1/count", json!(3), &["mesh 0 primitive 0 NORMAL", "accessor 1 has 3 elements, wanted 4"]),
        ("/accessors/3/componentType", json!(5126), &["mesh 0 primitive 0 indices", "F32"]),
        ("/accessors/3/count", json!(5), &["mesh 0 primitive 0 indices", "multiple of 3"]),
        ("/accessors/3/bufferView", json!(9), &["mesh 0 primitive 0 indices", "buffer view 9 of 5"]),
        ("/bufferViews/0/byteLength", json!(99999), &["POSITION", "buffer view 0 covers bytes 0..99999"]),
        ("/bufferViews/0/byteOffset", json!(u64::MAX), &["POSITION", "buffer view 0 covers"]),
        ("/bufferViews/0/byteStride", json!(8), &["POSITION", "stride of 8"]),
        ("/bufferViews/0/buffer", json!(3), &["POSITION", "buffer 3 of 1"]),
        ("/buffers/0/byteLength", json!(100_000), &["buffer 0", "truncated: 100000 bytes declared"]),
        ("/buffers/0/byteLength", json!(u64::MAX), &["buffer 0", "bytes of buffers, the limit is"]),
        ("/buffers/0/uri", json!("../up.bin"), &["buffer 0", "../up.bin", "leaves the scene's folder"]),
        ("/buffers/0/uri", json!("gone.bin"), &["buffer 0", "gone.bin", "cannot be read"]),
        ("/meshes/0/primitives/0/attributes/POSITION", Value::Null, &["mesh 0 primitive 0", "POSITION is missing"]),
        ("/meshes/0/primitives/0/attributes/NORMAL", json!(77), &["mesh 0 primitive 0 NORMAL", "accessor 77 of 4"]),
        ("/meshes/0/primitives/0/material", json!(5), &["mesh 0 primitive 0", "material 5 of 1"]),
        ("/meshes/0/primitives/0/mode", json!(17), &["mesh 0 primitive 0", "mode"]),
        ("/nodes/0/children", json!([0]), &["node 0", "own ancestor"]),
        ("/nodes/2/children", json!([1]), &["node 1", "child of both node 0 and node 2"]),
        ("/nodes/1/children", json!([0]), &["node 0", "own ancestor"]),
        ("/nodes/1/children", json!([9]), &["node 1", "node 9 of 3"]),
        ("/nodes/1/mesh", json!(4), &["node 1", "mesh 4 of 1"]),
        ("/nodes/1/translation", json!([1e39, 0, 0]), &["node 1", "translation"]),
        ("/nodes/1/translation", json!([1e30, 0, 0]), &["node 1", "world coordinate"]),
        ("/nodes/0/rotation", json!([0, 0, 0, 0]), &["node 0", "rotation"]),
        ("/nodes/2/matrix", json!([1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]), &["node 2", "last row"]),
        ("/scene", json!(2), &["default scene", "scene 2 of 1"]),
        ("/scenes/0/nodes", json!([0, 0]), &["node 0", "child of both"]),
        ("/scenes/0/nodes", json!([]), &["no geometry"]),
        ("/materials/0/alphaMode", json!("SOFT"), &["material 0", "alphaMode"]),
        ("/materials/0/emissiveFactor", json!([-1, 0, 0]), &["material 0", "emission"]),
        ("/materials/0/normalTexture/index", json!(8), &["material 0 normalTexture", "texture 8 of 1"]),
        ("/textures/0/source", json!(6), &["texture 0", "image 6 of 1"]),
        ("/textures/0/sampler", json!(6), &["texture 0", "sampler 6 of 1"]),
        ("/samplers/0/wrapS", json!(6), &["sampler 0", "wrapS"]),
        ("/images/0/bufferView", json!(0), &["image 0", "neither PNG nor JPEG"]),
        ("/images/0/bufferView", Value::Null, &["image 0", "URI or buffer view is missing"]),
        ("/bufferViews/4/byteLength", json!(40), &["image 0", "cannot be decoded"]),
        ("/extensionsRequired", json!(["KHR_draco_mesh_compression"]), &["requires KHR_draco_mesh_compression"]),
        ("/asset/version", json!("1.0"), &["version \"1.0\""]),
        ("/asset", Value::Null, &["not a glTF 2.0 scene", "asset"]),
    ];
    for (pointer, value, wanted) in cases {
        let got = message(pointer, value.clone());
        for part in wanted.iter().chain(&["bad.glb"]) {
            assert!(got.contains(part), "{pointer} = {value}: {got}, wanted {part:?}");
        }
    }
}

#[test]
fn faulty_data_is_named() {
    let (root, mut bin) = good();
    bin[12..16].copy_from_slice(&f32::NAN.to_le_bytes());
    let got = load_json(&root, &bin).unwrap_err().to_string();
    assert!(got.contains("mesh 0 primitive 0 POSITION: element 1 is not finite"), "{got}");
    let (root, mut bin) = good();
    bin[130] = 200;
    let got = load_json(&root, &bin).unwrap_err();
    assert!(
        matches!(&got, SceneError::Element { fault: Fault::IndexValue { at: 1, value: 200, count: 4 }, .. }),
        "{got}"
    );
    assert!(got.to_string().contains("mesh 0 primitive 0 indices"), "{got}");
}

#[test]
fn faulty_containers_are_named() {
    let (root, bin) = good();
    let whole = glb(&root, &bin);
    for length in [4, 11, 12, 19, 40, whole.len() - 1] {
        let got = load_bytes(&whole[..length]).unwrap_err();
        assert!(matches!(got, SceneError::Truncated { .. }), "{length}: {got}");
    }
    let change = |at: usize, to: &[u8]| {
        let mut bytes = whole.clone();
        bytes[at..at + to.len()].copy_from_slice(to);
        load_bytes(&bytes).unwrap_err()
    };
    assert!(matches!(change(4, &[1]), SceneError::NotGltf { .. }));
    assert!(matches!(change(16, b"BIN\0"), SceneError::NotGltf { .. }));
    assert!(matches!(change(12, &[255, 255, 255, 255]), SceneError::Truncated { .. }));
    assert!(matches!(change(0, b"GLTF"), SceneError::NotGltf { .. }));
    assert!(matches!(change(8, &[3, 0, 0, 0]), SceneError::Truncated { .. } | SceneError::NotGltf { .. }));
    assert!(matches!(load(Path::new("/none/such.gltf")), Err(SceneError::Read { .. })));
    assert!(matches!(load(&std::env::temp_dir()), Err(SceneError::Read { .. })));
}

#[test]
fn too_deep_is_an_error_and_deep_is_not() {
    for (levels, fine) in [(1000, true), (1100, false)] {
        let (mut root, bin) = good();
        let mut nodes: Vec<Value> = (0..levels - 1).map(|i| json!({ "children": [i + 1] })).collect();
        nodes.push(json!({ "mesh": 0 }));
        root["nodes"] = json!(nodes);
        root["scenes"] = json!([{ "nodes": [0] }]);
        let got = load_json(&root, &bin);
        assert_eq!(got.is_ok(), fine, "{levels}");
        if let Err(e) = got {
            assert!(e.to_string().contains("node 1024: nested more than 1024 levels deep"), "{e}");
        }
    }
}

#[test]
fn absurd_numbers_of_instances_and_vertices_are_refused() {
    let (mut root, bin) = good();
    root["nodes"] = (0..3000).map(|_| json!({ "mesh": 0 })).collect();
    root["scenes"] = json!([{ "nodes": (0..3000).collect::<Vec<u32>>() }]);
    let primitive = json!({ "attributes": { "POSITION": 0, "NORMAL": 1 }, "indices": 3 });
    root["meshes"][0]["primitives"] = (0..2000).map(|_| primitive.clone()).collect();
    let got = load_json(&root, &bin).unwrap_err().to_string();
    assert!(got.contains("6000000 instances"), "{got}");
    // Many primitives that share one accessor without data.
    root["accessors"][0] = json!({ "componentType": 5126, "count": 1 << 24, "type": "VEC3" });
    let got = load_json(&root, &bin).unwrap_err().to_string();
    assert!(got.contains("mesh 0 primitive 4: 67108") || got.contains("vertices, the limit is 67108864"), "{got}");
}

#[test]
fn a_singular_node_is_skipped_with_a_notice() {
    let (mut root, bin) = good();
    root["nodes"][1]["scale"] = json!([0, 1, 1]);
    let scene = load_json(&root, &bin).unwrap();
    assert_eq!(scene.instances.len(), 1);
    assert!(scene.warnings[0].contains("node 1 (moved) has a singular transform"), "{:?}", scene.warnings);
}

#[test]
fn strips_fans_and_other_modes() {
    for (mode, indices) in [(5, vec![0, 1, 2, 1, 3, 2]), (6, vec![1, 2, 0, 2, 3, 0])] {
        let (mut root, bin) = good();
        let primitive = &mut root["meshes"][0]["primitives"][0];
        primitive["mode"] = json!(mode);
        primitive.as_object_mut().unwrap().remove("indices");
        // Mirrored texture coordinates would duplicate vertices.
        primitive["attributes"].as_object_mut().unwrap().remove("TEXCOORD_0");
        assert_eq!(load_json(&root, &bin).unwrap().meshes[0].indices, indices, "mode {mode}");
    }
    for mode in 0..4 {
        let (mut root, bin) = good();
        let mut other = root["meshes"][0]["primitives"][0].clone();
        other["mode"] = json!(mode);
        root["meshes"][0]["primitives"].as_array_mut().unwrap().push(other);
        let scene = load_json(&root, &bin).unwrap();
        assert_eq!(scene.instances.len(), 2);
        assert!(scene.warnings[0].contains("mesh 0 primitive 1") && scene.warnings[0].contains("skipped"));
    }
}

#[test]
fn missing_normals_are_flat_and_the_default_material_is_made() {
    let (mut root, bin) = good();
    let primitive = &mut root["meshes"][0]["primitives"][0];
    primitive["attributes"].as_object_mut().unwrap().remove("NORMAL");
    primitive.as_object_mut().unwrap().remove("material");
    let scene = load_json(&root, &bin).unwrap();
    assert_eq!(scene.meshes[0].positions.len(), 6);
    assert!(scene.meshes[0].normals.iter().all(|n| *n == Vec3::Z));
    assert_eq!((scene.materials.len(), scene.instances[0].material), (2, 1));
    assert_eq!(scene.materials[1].metalness, 1.0);
}

#[test]
fn quantised_and_sparse_attributes_are_read() {
    let (mut root, mut bin) = good();
    root["extensionsUsed"].as_array_mut().unwrap().push(json!("KHR_mesh_quantization"));
    root["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    let mut view = |bytes: &[u8], stride: Option<usize>| {
        let mut v = json!({ "buffer": 0, "byteOffset": bin.len(), "byteLength": bytes.len() });
        if let Some(stride) = stride {
            v["byteStride"] = json!(stride);
        }
        bin.extend(bytes);
        bin.resize(bin.len().next_multiple_of(4), 0);
        let views = root["bufferViews"].as_array_mut().unwrap();
        views.push(v);
        views.len() - 1
    };
    // Normalised i16 positions, 8 bytes apart.
    let positions: Vec<u8> = [[0_i16, 0, 0], [32767, 0, 0], [32767, -32768, 0], [0, 32767, 0]]
        .iter()
        .flat_map(|v| [v[0], v[1], v[2], 99].into_iter().flat_map(i16::to_le_bytes))
        .collect();
    let p = view(&positions[..positions.len() - 2], Some(8));
    let n = view(&[0, 0, 127, 0, 0, 0, 129, 0, 0, 0, 127, 0, 127, 0, 0, 0], Some(4));
    let uv = view(&[0, 0, 3, 0, 3, 7, 0, 7], None);
    let places = view(&[1, 0, 3, 0], None);
    let values = view(&[5, 6, 8, 9], None);
    let colours = view(&[255, 0, 0, 51, 255, 0, 0, 0, 255, 1, 1, 1], None);
    root["accessors"] = json!([
        { "bufferView": p, "componentType": 5122, "normalized": true, "count": 4, "type": "VEC3" },
        { "bufferView": n, "componentType": 5120, "normalized": true, "count": 4, "type": "VEC3" },
        { "bufferView": uv, "componentType": 5121, "count": 4, "type": "VEC2", "sparse": {
            "count": 2,
            "indices": { "bufferView": places, "componentType": 5123 },
            "values": { "bufferView": values },
        } },
        { "bufferView": 3, "componentType": 5123, "count": 6, "type": "SCALAR" },
        { "bufferView": colours, "componentType": 5121, "normalized": true, "count": 4, "type": "VEC3" },
    ]);
    root["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(4);
    root["buffers"][0]["byteLength"] = json!(bin.len());
    let mesh = load_json(&root, &bin).unwrap().meshes.remove(0);
    assert_eq!(mesh.positions[2], Vec3::new(1.0, -1.0, 0.0));
    assert_eq!(mesh.normals[1], Vec3::NEG_Z);
    assert_eq!(mesh.normals[3], Vec3::X);
    assert_eq!(mesh.uv0[..4], [Vec2::ZERO, Vec2::new(5.0, 6.0), Vec2::new(3.0, 7.0), Vec2::new(8.0, 9.0)]);
    assert!(mesh.colours[1].abs_diff_eq(Vec4::new(0.2, 1.0, 0.0, 1.0), 1e-6));

    for (pointer, value, wanted) in [
        (
            "/accessors/2/sparse/indices/componentType",
            json!(5125),
            "accessor 2 reads bytes 0..8 of a 4 byte buffer view",
        ),
        ("/accessors/2/sparse/count", json!(5), "5 sparse elements, the limit is 4"),
        ("/accessors/2/sparse/indices/bufferView", json!(values), "index 0 is 1541, there are 4 vertices"),
        ("/accessors/2/sparse/values/bufferView", json!(99), "refers to buffer view 99"),
    ] {
        let mut bad = root.clone();
        set(&mut bad, pointer, value);
        let got = load_json(&bad, &bin).unwrap_err().to_string();
        assert!(got.contains("mesh 0 primitive 0 TEXCOORD_0") && got.contains(wanted), "{pointer}: {got}");
    }
}

#[test]
fn lights_and_cameras_stand_in_the_world() {
    let (mut root, bin) = good();
    root["extensions"] = json!({ "KHR_lights_punctual": { "lights": [
        { "type": "directional", "color": [1, 0.5, 0], "intensity": 3 },
        { "type": "point", "range": 7 },
        { "type": "spot", "intensity": 2, "spot": { "outerConeAngle": 0.5 } },
    ] } });
    root["cameras"] = json!([
        { "type": "perspective", "name": "eye", "perspective": { "yfov": 0.8, "znear": 0.1 } },
        { "type": "orthographic", "orthographic": { "xmag": 1, "ymag": 1, "zfar": 9, "znear": 1 } },
    ]);
    let nodes = root["nodes"].as_array_mut().unwrap();
    nodes[0]["camera"] = json!(0);
    nodes[0]["scale"] = json!([2, 3, 4]);
    nodes[2]["camera"] = json!(1);
    for (node, light) in [(0, 0), (1, 1), (2, 2)] {
        nodes[node]["extensions"] = json!({ "KHR_lights_punctual": { "light": light } });
    }
    let scene = load_json(&root, &bin).unwrap();
    let Light::Directional { direction, illuminance, .. } = &scene.lights[0] else { panic!("{:?}", scene.lights) };
    assert!(direction.abs_diff_eq(Vec3::NEG_X, 1e-6) && *illuminance == Vec3::new(3.0, 1.5, 0.0));
    assert!(matches!(scene.lights[1], Light::Point { range: Some(7.0), .. }));
    assert!(matches!(scene.lights[2], Light::Spot { outer: 0.5, inner: 0.0, .. }));
    assert_eq!(scene.cameras.len(), 1);
    assert!(scene.cameras[0].forward().abs_diff_eq(Vec3::NEG_X, 1e-6));
    assert!((scene.cameras[0].world_from_camera.matrix3.determinant() - 1.0).abs() < 1e-5);
    assert!(scene.warnings.iter().any(|n| n.contains("orthographic")));

    for (pointer, value, wanted) in [
        ("/extensions/KHR_lights_punctual/lights/2/spot", Value::Null, "light 2: spot is missing"),
        ("/extensions/KHR_lights_punctual/lights/2/spot/outerConeAngle", json!(3), "light 2: the cone"),
        ("/extensions/KHR_lights_punctual/lights/0/intensity", json!(-1), "light 0: intensity"),
        ("/extensions/KHR_lights_punctual/lights/0/type", json!("moon"), "light 0: type"),
        ("/nodes/1/extensions/KHR_lights_punctual/light", json!(3), "node 1: refers to light 3 of 3"),
        ("/cameras/0/perspective/yfov", json!(4), "camera 0: yfov"),
        ("/cameras/0/perspective/yfov", json!(1e-30), "camera 0: yfov"),
        ("/cameras/0/perspective/znear", json!(0), "camera 0: znear"),
        ("/cameras/0/perspective/znear", json!(1e-38), "camera 0: znear"),
        ("/cameras/0/perspective", Value::Null, "camera 0: perspective is missing"),
        ("/nodes/0/camera", json!(7), "node 0: refers to camera 7 of 2"),
    ] {
        let mut bad = root.clone();
        set(&mut bad, pointer, value);
        let got = load_json(&bad, &bin).unwrap_err().to_string();
        assert!(got.contains(wanted), "{pointer}: {got}");
    }
}

#[test]
fn unknown_extensions_and_blending_are_said() {
    let (mut root, bin) = good();
    root["extensionsUsed"].as_array_mut().unwrap().push(json!("KHR_materials_iridescence"));
    root["materials"][0]["alphaMode"] = json!("BLEND");
    let scene = load_json(&root, &bin).unwrap();
    assert_eq!(scene.materials[0].alpha, AlphaMode::Blend);
    assert!(scene.warnings[0].contains("KHR_materials_iridescence is present but not supported"));
    assert!(scene.warnings[1].contains("alpha-tested at 0.5") && scene.warnings[1].contains("paint"));
}

#[test]
fn external_files_and_data_uris_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let (mut root, bin) = good();
    root["buffers"][0]["uri"] = json!("the%20bytes.bin");
    root["images"] = json!([{ "uri": "sub/a.png" }]);
    std::fs::write(folder.path().join("the bytes.bin"), &bin).unwrap();
    std::fs::create_dir(folder.path().join("sub")).unwrap();
    std::fs::write(folder.path().join("sub/a.png"), png()).unwrap();
    let path = folder.path().join("s.gltf");
    std::fs::write(&path, root.to_string()).unwrap();
    let scene = load(&path).unwrap();
    assert_eq!((scene.name.as_str(), scene.textures[0].size), ("s", [2, 1]));
    // A huge image in a small file is refused by its header.
    let mut bytes = png();
    bytes[16..20].copy_from_slice(&20_000_u32.to_be_bytes());
    std::fs::write(folder.path().join("sub/a.png"), bytes).unwrap();
    let got = load(&path).unwrap_err().to_string();
    assert!(got.contains("image 0") && got.contains("s.gltf"), "{got}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1500, failure_persistence: None, ..ProptestConfig::default() })]

    /// Any bytes give an error or a scene with valid indices.
    #[test]
    fn no_bytes_make_it_panic(changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6), cut in 0_usize..40, digits in any::<bool>()) {
        let (root, bin) = good();
        let mut bytes = glb(&root, &bin);
        for (at, to) in changes {
            let at = at.index(bytes.len());
            // Replacing digits by digits keeps the JSON valid and gets further.
            bytes[at] = if digits && bytes[at].is_ascii_digit() { b'0' + to % 10 } else { to };
        }
        let keep = if cut > 20 { bytes.len() * cut / 40 } else { bytes.len() };
        if let Ok(mut scene) = load_bytes(&bytes[..keep]) {
            supply_missing(&mut scene);
            for i in &scene.instances {
                prop_assert!((i.material as usize) < scene.materials.len());
                prop_assert!(i.world_from_object.is_finite());
                let mesh = &scene.meshes[i.mesh as usize];
                let n = mesh.positions.len();
                prop_assert!(mesh.indices.iter().all(|k| (*k as usize) < n));
                prop_assert_eq!([mesh.normals.len(), mesh.tangents.len(), mesh.uv0.len(), mesh.uv1.len(), mesh.colours.len()], [n; 5]);
                prop_assert!(mesh.positions.iter().chain(&mesh.normals).all(|p| p.is_finite()));
                prop_assert!(mesh.tangents.iter().all(|t| t.is_finite()));
            }
            prop_assert!(scene.cameras[0].world_from_camera.is_finite());
        }
    }
}
