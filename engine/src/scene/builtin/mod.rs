//! Built-in scenes, made by code, so that no download is needed to render something.
use super::Scene;
use super::coverage::preserve_coverage;

mod carousel;
mod cornell;
mod courtyard;
mod foliage;
mod night_market;
mod parameters;
mod shapes;
mod stage;

pub use parameters::{BuiltinError, BuiltinParameter, builtin_parameters};

/// Name and description of every built-in scene, the default first.
pub const BUILTIN: &[(&str, &str)] = &[
    ("courtyard", "a small courtyard in the sun: fountain, pergola, arcade, plants; matte, glossy and metal things"),
    (
        "carousel",
        "a small fairground where everything moves, in a loop of 4 s: rigid, skinned and morphing things, spheres, a lamp",
    ),
    ("cornell", "the Cornell box (Goral et al. 1984) with its area light, 5.5 m wide"),
    (
        "night-market",
        "a market street at night after rain: lanterns, stalls, neon and puddles; ten to a hundred thousand lamps, some of which move",
    ),
];

/// A built-in scene, with cameras and lights: `NAME`, or `NAME?KEY=VALUE&KEY=VALUE` with [parameters](builtin_parameters). A scene is
/// called by what was asked for.
///
/// # Errors
/// There is no such scene, it has no such parameter, or a value is out of range.
pub fn builtin(wanted: &str) -> Result<Scene, BuiltinError> {
    let parameters::Wanted { name, values } = parameters::parse(wanted)?;
    let mut scene = match (name, &values[..]) {
        ("courtyard", _) => courtyard::scene(),
        ("carousel", _) => carousel::scene(),
        ("cornell", _) => cornell::scene(),
        ("night-market", [lights]) => night_market::scene(*lights),
        _ => return Err(BuiltinError::Name { name: wanted.to_owned() }),
    };
    scene.name = wanted.to_owned();
    preserve_coverage(&mut scene);
    Ok(scene)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Light;

    #[test]
    fn built_in_scenes_are_whole() {
        for (name, _) in BUILTIN {
            let scene = builtin(name).unwrap();
            assert_eq!(&scene.name, name);
            assert!(!scene.instances.is_empty() && !scene.cameras.is_empty() && !scene.lights.is_empty(), "{name}");
            for mesh in &scene.meshes {
                let n = mesh.positions.len();
                let tables =
                    [mesh.normals.len(), mesh.tangents.len(), mesh.uv0.len(), mesh.uv1.len(), mesh.colours.len()];
                assert_eq!(tables, [n; 5], "{name}: {}", mesh.name);
                assert!(mesh.indices.len() % 3 == 0 && mesh.indices.iter().all(|i| (*i as usize) < n), "{}", mesh.name);
                assert!(mesh.positions.iter().all(|p| p.is_finite()) && mesh.uv0.iter().all(|u| u.is_finite()));
                for (normal, tangent) in mesh.normals.iter().zip(&mesh.tangents) {
                    assert!((normal.length() - 1.0).abs() < 1e-4, "{}: {normal}", mesh.name);
                    assert!((tangent.truncate().length() - 1.0).abs() < 1e-4, "{}: {tangent}", mesh.name);
                    assert!(tangent.truncate().dot(*normal).abs() < 1e-3, "{}", mesh.name);
                }
            }
            for instance in &scene.instances {
                assert!((instance.mesh as usize) < scene.meshes.len(), "{name}");
                assert!((instance.material as usize) < scene.materials.len(), "{name}");
                assert!(instance.world_from_object.matrix3.determinant() > 0.0, "{name}: {}", instance.name);
            }
            for material in &scene.materials {
                assert!(material.base_colour.max_element() <= 1.0 && material.base_colour.min_element() >= 0.0);
                for t in [material.base_colour_texture, material.normal_texture].into_iter().flatten() {
                    assert!((t.texture as usize) < scene.textures.len() && (t.sampler as usize) < scene.samplers.len());
                }
            }
        }
        assert!(builtin("nothing").is_err());
    }

    #[test]
    fn faces_turn_the_way_their_normals_point() {
        for (name, _) in BUILTIN {
            let scene = builtin(name).unwrap();
            for mesh in &scene.meshes {
                let double = scene.instances.iter().any(|i| {
                    std::ptr::eq(&scene.meshes[i.mesh as usize], mesh)
                        && scene.materials[i.material as usize].double_sided
                });
                if double {
                    continue;
                }
                for t in mesh.indices.chunks_exact(3) {
                    let [a, b, c] = [t[0], t[1], t[2]].map(|i| mesh.positions[i as usize]);
                    let face = (b - a).cross(c - a);
                    let mean: glam::Vec3 = t.iter().map(|i| mesh.normals[*i as usize]).sum();
                    assert!(
                        face.length() > 0.0 && face.normalize().dot(mean) > 0.0,
                        "{name}: {} {a} {b} {c}",
                        mesh.name
                    );
                }
            }
        }
    }

    #[test]
    fn the_courtyard_has_what_it_is_to_have() {
        let scene = builtin("courtyard").unwrap();
        let triangles: usize = scene.instances.iter().map(|i| scene.meshes[i.mesh as usize].indices.len() / 3).sum();
        assert!((20_000..=80_000).contains(&triangles), "{triangles} triangles");
        assert!(scene.meshes.len() * 2 < scene.instances.len(), "things are instanced");
        let names: Vec<_> = scene.cameras.iter().map(|c| c.name.as_str()).collect();
        assert_eq!(names, ["default", "close", "alcove"]);
        let daylight = scene.daylight.as_ref().unwrap();
        assert!(
            matches!(scene.lights[0], Light::Directional { direction, .. } if direction.abs_diff_eq(-daylight.to_sun, 1e-6))
        );
        assert!(scene.lights.iter().any(|l| matches!(l, Light::Point { .. })));
        assert!(scene.materials.iter().any(|m| m.metalness == 1.0));
        assert!(scene.materials.iter().any(|m| matches!(m.alpha, crate::scene::AlphaMode::Mask(_))));
    }

    #[test]
    fn the_box_light_shines_down() {
        let scene = builtin("cornell").unwrap();
        let Light::Rectangle { half_u, half_v, centre, .. } = &scene.lights[0] else { panic!("no rectangle") };
        assert!(half_u.cross(*half_v).normalize().y < -0.999 && centre.y > 5.0);
        assert!(scene.daylight.is_none());
        assert_eq!(scene.instances.len(), 8);
    }
}
