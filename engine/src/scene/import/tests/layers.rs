//! Transmission, index of refraction, specular, volume and clear coat.
use super::*;

fn layered() -> (Value, Vec<u8>) {
    let (mut root, bin) = good();
    let moved = json!({ "index": 0, "extensions": { "KHR_texture_transform": { "offset": [0.25, 0] } } });
    root["materials"][0]["extensions"] = json!({
        "KHR_materials_transmission": { "transmissionFactor": 0.75, "transmissionTexture": moved },
        "KHR_materials_ior": { "ior": 1.33 },
        "KHR_materials_specular": {
            "specularFactor": 0.25, "specularTexture": moved,
            "specularColorFactor": [0.5, 2, 0], "specularColorTexture": { "index": 0, "texCoord": 1 },
        },
        "KHR_materials_volume": {
            "thicknessFactor": 0.5, "attenuationDistance": 2, "attenuationColor": [0.25, 0.5, 1],
        },
        "KHR_materials_clearcoat": {
            "clearcoatFactor": 0.5, "clearcoatRoughnessFactor": 0.125,
            "clearcoatTexture": moved, "clearcoatRoughnessTexture": { "index": 0, "texCoord": 1 },
        },
    });
    let used = ["transmission", "ior", "specular", "volume", "clearcoat"].map(|e| format!("KHR_materials_{e}"));
    root["extensionsRequired"] = json!(used);
    root["extensionsUsed"].as_array_mut().unwrap().extend(used.map(|e| json!(e)));
    (root, bin)
}

#[test]
fn layers_are_read_whole() {
    let (root, bin) = layered();
    let scene = load_json(&root, &bin).unwrap();
    let m = &scene.materials[0];
    assert_eq!((m.transmission, m.ior, m.thickness), (0.75, 1.33, 0.5));
    assert_eq!((m.specular, m.specular_colour), (0.25, Vec3::new(0.5, 2.0, 0.0)));
    assert_eq!((m.attenuation_distance, m.attenuation_colour), (2.0, Vec3::new(0.25, 0.5, 1.0)));
    assert_eq!((m.clearcoat, m.clearcoat_roughness), (0.5, 0.125));
    assert!(m.is_layered());
    // Beer-Lambert law: e^(-absorption * distance) is the attenuation colour.
    let left = (-m.absorption() * 2.0).map(f32::exp);
    assert!(left.abs_diff_eq(m.attenuation_colour, 1e-6), "{left}");
    let [transmission, coat] = [m.transmission_texture, m.clearcoat_texture].map(Option::unwrap);
    let rough = m.clearcoat_roughness_texture.unwrap();
    assert_eq!((transmission.rows[0].z, coat.rows[0].z, rough.rows[0].z), (0.25, 0.25, 0.0));
    assert_eq!((transmission.uv_set, rough.uv_set), (0, 1));
    let [strength, colour] = [m.specular_texture, m.specular_colour_texture].map(Option::unwrap);
    assert_eq!((strength.rows[0].z, strength.uv_set, colour.uv_set), (0.25, 0, 1));
    assert_eq!(strength.texture, transmission.texture);
    assert_eq!(scene.textures[colour.texture as usize].colour_space, ColourSpace::Srgb);
    // One image in linear colour space, shared with the normal map.
    for used in [transmission, coat, rough] {
        assert_eq!(used.texture, m.normal_texture.unwrap().texture);
        assert_eq!(scene.textures[used.texture as usize].colour_space, ColourSpace::Linear);
    }
    assert_eq!(scene.warnings.len(), 1, "{:?}", scene.warnings);
    assert!(scene.warnings[0].contains("transmission are drawn opaque") && scene.warnings[0].contains("paint"));
}

#[test]
fn without_the_extensions_there_are_no_layers() {
    let (root, bin) = good();
    let m = load_json(&root, &bin).unwrap().materials.remove(0);
    assert!(!m.is_layered() && m.absorption() == Vec3::ZERO);
    // Extensions that are present but empty.
    let (mut root, bin) = layered();
    for (_, extension) in root["materials"][0]["extensions"].as_object_mut().unwrap() {
        *extension = json!({});
    }
    let scene = load_json(&root, &bin).unwrap();
    assert!(!scene.materials[0].is_layered() && scene.warnings.is_empty(), "{:?}", scene.warnings);
}

/// A material with its own specular reflection counts as layered; a strength texture suffices.
#[test]
fn a_reflection_alone_makes_a_layer() {
    for (extension, own) in [
        (json!({}), false),
        (json!({ "specularFactor": 1, "specularColorFactor": [1, 1, 1] }), false),
        (json!({ "specularFactor": 0 }), true),
        (json!({ "specularColorFactor": [1, 1, 0.5] }), true),
        (json!({ "specularTexture": { "index": 0 } }), true),
        (json!({ "specularColorTexture": { "index": 0 } }), true),
    ] {
        let (mut root, bin) = good();
        root["materials"][0]["extensions"] = json!({ "KHR_materials_specular": extension });
        root["extensionsUsed"].as_array_mut().unwrap().push(json!("KHR_materials_specular"));
        let scene = load_json(&root, &bin).unwrap();
        let m = &scene.materials[0];
        assert_eq!((m.has_own_specular(), m.is_layered()), (own, own), "{extension}");
        assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    }
}

#[test]
fn what_lies_outside_is_moved_in_and_said() {
    type Get = fn(&crate::scene::Material) -> f32;
    let cases: &[(&str, Value, Get, f32, &str)] = &[
        ("transmission/transmissionFactor", json!(1.5), |m| m.transmission, 1.0, "transmissionFactor 1.5"),
        ("transmission/transmissionFactor", json!(-1), |m| m.transmission, 0.0, "transmissionFactor -1"),
        ("ior/ior", json!(0.5), |m| m.ior, 1.0, "ior 0.5 is below 1"),
        ("ior/ior", json!(0), |m| m.ior, 1.5, "an ior of 0 is not supported"),
        ("specular/specularFactor", json!(1.25), |m| m.specular, 1.0, "specularFactor 1.25 lies outside 0 to 1"),
        ("specular/specularFactor", json!(-2), |m| m.specular, 0.0, "specularFactor -2 lies outside 0 to 1"),
        (
            "specular/specularColorFactor",
            json!([1, -0.5, 1]),
            |m| m.specular_colour.y,
            0.0,
            "specularColorFactor -0.5 is below 0",
        ),
        ("volume/thicknessFactor", json!(-2), |m| m.thickness, 0.0, "thicknessFactor -2"),
        ("volume/attenuationColor", json!([0.5, 3, 0]), |m| m.attenuation_colour.y, 1.0, "attenuationColor 3"),
        ("clearcoat/clearcoatFactor", json!(7), |m| m.clearcoat, 1.0, "clearcoatFactor 7"),
        (
            "clearcoat/clearcoatRoughnessFactor",
            json!(-7),
            |m| m.clearcoat_roughness,
            0.0,
            "clearcoatRoughnessFactor -7",
        ),
        (
            "clearcoat/clearcoatNormalTexture",
            json!({ "index": 0 }),
            |m| m.clearcoat,
            0.5,
            "clearcoatNormalTexture is ignored",
        ),
        ("volume/thicknessTexture", json!({ "index": 0 }), |m| m.thickness, 0.5, "thicknessTexture is ignored"),
    ];
    for (pointer, value, get, wanted, notice) in cases {
        let (mut root, bin) = layered();
        set(&mut root, &format!("/materials/0/extensions/KHR_materials_{pointer}"), value.clone());
        let scene = load_json(&root, &bin).unwrap();
        assert_eq!(get(&scene.materials[0]), *wanted, "{pointer} = {value}");
        let said = scene.warnings.iter().any(|w| w.contains("material paint") && w.contains(notice));
        assert!(said, "{pointer} = {value}: {:?}", scene.warnings);
    }
}

#[test]
fn what_cannot_be_repaired_is_an_error() {
    for (pointer, value, wanted) in [
        ("transmission/transmissionFactor", json!(1e39), "material 0: transmissionFactor is inf"),
        (
            "transmission/transmissionTexture",
            json!({ "index": 8 }),
            "material 0 transmissionTexture: refers to texture 8 of 1",
        ),
        ("ior/ior", json!(1e39), "material 0: ior is inf"),
        ("specular/specularFactor", json!(1e39), "material 0: specularFactor is inf"),
        ("specular/specularColorFactor", json!([0, 0, 1e39]), "material 0: specularColorFactor is inf"),
        ("specular/specularTexture", json!({ "index": 7 }), "material 0 specularTexture: refers to texture 7 of 1"),
        (
            "specular/specularColorTexture",
            json!({ "index": 1 }),
            "material 0 specularColorTexture: refers to texture 1 of 1",
        ),
        ("volume/thicknessFactor", json!(1e39), "material 0: thicknessFactor is inf"),
        ("volume/attenuationDistance", json!(0), "material 0: attenuationDistance is 0, wanted a number above 0"),
        ("volume/attenuationDistance", json!(-1), "material 0: attenuationDistance is -1"),
        ("volume/attenuationColor", json!([1e39, 0, 0]), "material 0: attenuationColor is inf"),
        ("clearcoat/clearcoatFactor", json!("thick"), "material 0: KHR_materials_clearcoat is"),
        ("clearcoat/clearcoatRoughnessFactor", json!(1e39), "material 0: clearcoatRoughnessFactor is inf"),
        ("clearcoat/clearcoatTexture", json!({ "index": 9 }), "material 0 clearcoatTexture: refers to texture 9 of 1"),
        ("clearcoat/clearcoatRoughnessTexture", json!({}), "material 0: KHR_materials_clearcoat is"),
    ] {
        let (mut root, bin) = layered();
        set(&mut root, &format!("/materials/0/extensions/KHR_materials_{pointer}"), value.clone());
        let got = load_json(&root, &bin).map(|s| panic!("{pointer} = {value} was taken: {:?}", s.warnings));
        let got = got.unwrap_err().to_string();
        assert!(got.contains(wanted) && got.contains("bad.glb"), "{pointer} = {value}: {got}");
    }
}
