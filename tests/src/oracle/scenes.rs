//! Small scenes that converge quickly, for comparing the reference on the device with the CPU path tracer.
use crate::fixtures::{add, block, camera, material, plane, scene};
use glam::{Affine3A, DVec3, Quat, Vec2, Vec3};
use magpie::scene::{
    ColourSpace, Environment, Light, Material, Mesh, Sampler, Scene, Sphere, Texture, TextureUse, Wrap, builtin,
};
use std::f32::consts::{FRAC_PI_2, PI};

/// All six.
pub fn all() -> Vec<Scene> {
    vec![area_light(), environment_map(), glossy_metal(), rough_dielectric(), glass_ball(), many_lights()]
}

/// One procedural sphere around the origin.
fn ball(radius: f32) -> Mesh {
    Mesh { name: "ball".to_owned(), spheres: vec![Sphere { centre: Vec3::ZERO, radius }], ..Mesh::default() }
}

fn at(x: f32, y: f32, z: f32) -> Affine3A {
    Affine3A::from_translation(Vec3::new(x, y, z))
}

fn matte(colour: [f32; 3]) -> Material {
    material(colour, 0.0, 0.9)
}

/// Glass of index 1.5 that is the boundary of a volume.
fn glass(roughness: f32) -> Material {
    Material { transmission: 1.0, thickness: 1.0, ..material([1.0; 3], 0.0, roughness) }
}

/// A room with coloured walls, a block and a glossy sphere under a rectangular light.
pub fn area_light() -> Scene {
    // Slightly off-axis: seen straight on, edges of the room would pass through pixel centres.
    let mut s = scene("area light", camera([0.07, 1.04, 3.6], [0.01, 0.99, 0.0]));
    let wall = |x: f32, y: f32, z: f32, turn: Quat| Affine3A::from_rotation_translation(turn, Vec3::new(x, y, z));
    add(&mut s, plane(1.0), matte([0.7, 0.7, 0.7]), at(0.0, 0.0, 0.0));
    add(&mut s, plane(1.0), matte([0.7, 0.7, 0.7]), wall(0.0, 2.0, 0.0, Quat::from_rotation_x(PI)));
    add(&mut s, plane(1.0), matte([0.7, 0.7, 0.7]), wall(0.0, 1.0, -1.0, Quat::from_rotation_x(FRAC_PI_2)));
    add(&mut s, plane(1.0), matte([0.6, 0.1, 0.1]), wall(-1.0, 1.0, 0.0, Quat::from_rotation_z(-FRAC_PI_2)));
    add(&mut s, plane(1.0), matte([0.1, 0.5, 0.1]), wall(1.0, 1.0, 0.0, Quat::from_rotation_z(FRAC_PI_2)));
    let turned = Affine3A::from_rotation_translation(Quat::from_rotation_y(0.4), Vec3::new(-0.4, 0.5, -0.35));
    add(&mut s, block(Vec3::new(0.25, 0.5, 0.25)), matte([0.8, 0.75, 0.6]), turned);
    let coated = Material { clearcoat: 0.8, clearcoat_roughness: 0.3, ..material([0.2, 0.3, 0.7], 0.0, 0.5) };
    add(&mut s, ball(0.35), coated, at(0.4, 0.36, 0.25));
    s.lights.push(Light::Rectangle {
        centre: DVec3::new(0.0, 1.98, 0.0),
        half_u: Vec3::X * 0.35,
        half_v: Vec3::Z * 0.35,
        radiance: Vec3::new(14.0, 12.0, 9.0),
    });
    s
}

/// An environment map of a few colours, brighter above.
fn surroundings() -> Environment {
    let texels = [
        [2.0, 2.2, 3.0],
        [2.4, 2.2, 2.0],
        [3.0, 2.0, 1.2],
        [2.2, 2.2, 2.2],
        [0.6, 0.9, 1.6],
        [1.8, 0.7, 0.4],
        [3.2, 2.6, 1.4],
        [0.5, 1.1, 0.8],
        [0.3, 0.3, 0.3],
        [0.5, 0.4, 0.2],
        [0.4, 0.3, 0.3],
        [0.2, 0.3, 0.4],
    ];
    Environment {
        name: "surroundings".to_owned(),
        width: 4,
        height: 3,
        radiance: texels.map(Vec3::from).into(),
        scale: 0.35,
        turn: 0.7,
    }
}

/// Matte, glossy, metallic and textured objects under an environment map.
pub fn environment_map() -> Scene {
    let mut s = scene("environment map", camera([0.0, 1.4, 4.2], [0.0, 0.4, 0.0]));
    let rgba: Vec<u8> = (0..16_u32)
        .flat_map(|i| [(40 + 13 * i) as u8, (230 - 11 * i) as u8, (60 + (i * 97) % 160) as u8, 255])
        .collect();
    s.textures.push(Texture::new("squares".to_owned(), [4, 4], ColourSpace::Srgb, rgba));
    s.samplers.push(Sampler { wrap: [Wrap::Mirror, Wrap::Repeat], ..Sampler::default() });
    let rows = [Vec3::new(1.5, 0.4, 0.1), Vec3::new(-0.4, 1.5, 0.3)];
    let base_colour_texture = Some(TextureUse { texture: 0, sampler: 0, uv_set: 0, rows });
    let mut floor = plane(2.0);
    floor.uv0 = floor.positions.iter().map(|p| Vec2::new(p.x, p.z)).collect();
    add(&mut s, floor, Material { base_colour_texture, ..matte([0.9; 3]) }, at(0.0, 0.0, 0.0));
    add(&mut s, ball(0.5), matte([0.8, 0.6, 0.5]), at(-1.1, 0.5, 0.0));
    add(&mut s, ball(0.5), material([0.3, 0.5, 0.2], 0.0, 0.3), at(0.0, 0.5, 0.3));
    add(&mut s, ball(0.5), material([0.95, 0.8, 0.5], 1.0, 0.4), at(1.1, 0.5, 0.0));
    s.environment = Some(surroundings());
    s
}

/// Metal spheres from smooth to rough under a rectangular and a spherical light.
pub fn glossy_metal() -> Scene {
    let mut s = scene("glossy metal", camera([0.0, 1.6, 4.4], [0.0, 0.3, 0.0]));
    add(&mut s, plane(2.2), material([0.5; 3], 0.0, 0.6), at(0.0, 0.0, 0.0));
    let metals = [([0.95, 0.93, 0.88], 0.15), ([1.0, 0.78, 0.34], 0.3), ([0.95, 0.64, 0.54], 0.5), ([0.9; 3], 0.8)];
    for (i, (colour, roughness)) in (0_u8..).zip(metals) {
        add(&mut s, ball(0.36), material(colour, 1.0, roughness), at(f32::from(i) * 0.8 - 1.2, 0.37, 0.0));
    }
    s.lights.push(Light::Rectangle {
        centre: DVec3::new(-0.5, 2.2, 0.8),
        half_u: Vec3::new(0.7, 0.0, 0.0),
        half_v: Vec3::new(0.0, -0.2, 0.6),
        radiance: Vec3::new(9.0, 9.0, 11.0),
    });
    let radiance = Vec3::new(12.0, 9.0, 6.0);
    s.lights.push(Light::Sphere { centre: DVec3::new(1.6, 1.3, 1.2), radius: 0.35, radiance });
    s
}

/// A slab and a sphere of rough glass, and a thin sheet, lit by a rectangular light.
pub fn rough_dielectric() -> Scene {
    let mut s = scene("rough dielectric", camera([0.0, 1.5, 4.2], [0.0, 0.55, 0.0]));
    add(&mut s, plane(4.0), matte([0.7, 0.6, 0.5]), at(0.0, 0.0, 0.0));
    let upright = Affine3A::from_rotation_translation(Quat::from_rotation_x(FRAC_PI_2), Vec3::new(0.0, 0.0, -2.5));
    add(&mut s, plane(4.0), matte([0.3, 0.5, 0.8]), upright);
    let slab = Affine3A::from_rotation_translation(Quat::from_rotation_y(0.5), Vec3::new(-0.8, 0.65, 0.0));
    add(&mut s, block(Vec3::new(0.4, 0.6, 0.12)), glass(0.5), slab);
    let tinted = Material { attenuation_colour: Vec3::new(0.5, 0.9, 0.6), attenuation_distance: 0.8, ..glass(0.6) };
    add(&mut s, ball(0.5), tinted, at(0.6, 0.55, 0.2));
    let sheet = Material { transmission: 0.8, double_sided: true, ..material([0.9, 0.7, 0.7], 0.0, 0.35) };
    let stands = Affine3A::from_rotation_translation(Quat::from_rotation_x(FRAC_PI_2), Vec3::new(1.5, 0.6, -0.3));
    add(&mut s, plane(0.4), sheet, stands);
    s.lights.push(Light::Rectangle {
        centre: DVec3::new(0.0, 2.8, 0.2),
        half_u: Vec3::X * 1.8,
        half_v: Vec3::Z * 1.2,
        radiance: Vec3::new(3.0, 2.8, 2.5),
    });
    s
}

/// Dielectric reflections by KHR_materials_specular: none, strong, coloured, of a half metal and of glass.
pub fn own_reflections() -> Scene {
    let mut s = scene("own reflections", camera([0.0, 1.5, 4.4], [0.0, 0.35, 0.0]));
    let with = |m: Material, ior: f32, specular: f32, colour: [f32; 3]| {
        let specular_colour = Vec3::from(colour);
        Material { ior, specular, specular_colour, ..m }
    };
    add(&mut s, plane(2.2), with(matte([0.6; 3]), 1.5, 0.0, [1.0; 3]), at(0.0, 0.0, 0.0));
    let things = [
        with(material([0.2, 0.3, 0.7], 0.0, 0.4), 1.5, 1.0, [15.0, 5.0, 1.0]),
        with(material([0.8, 0.5, 0.3], 0.0, 0.5), 2.0, 0.6, [0.3, 1.0, 6.0]),
        with(material([0.9, 0.7, 0.4], 0.5, 0.4), 1.5, 0.3, [1.0, 0.0, 4.0]),
        with(glass(0.45), 1.5, 0.4, [1.0, 3.0, 8.0]),
    ];
    for (i, m) in (0_u8..).zip(things) {
        add(&mut s, ball(0.36), m, at(f32::from(i) * 0.8 - 1.2, 0.4, 0.0));
    }
    s.environment = Some(surroundings());
    s
}

/// A sphere of smooth, tinted glass under an environment map.
pub fn glass_ball() -> Scene {
    let mut s = scene("glass ball", camera([0.0, 1.1, 3.4], [0.0, 0.6, 0.0]));
    add(&mut s, plane(1.6), matte([0.6, 0.6, 0.55]), at(0.0, 0.0, 0.0));
    let tinted = Material { attenuation_colour: Vec3::new(0.9, 0.6, 0.4), attenuation_distance: 1.0, ..glass(0.0) };
    add(&mut s, ball(0.55), tinted, at(0.0, 0.65, 0.0));
    s.environment = Some(surroundings());
    s
}

/// About seventy lights of all kinds over a floor with blocks.
pub fn many_lights() -> Scene {
    let mut s = scene("many lights", camera([0.0, 2.4, 4.6], [0.0, 0.2, 0.0]));
    add(&mut s, plane(2.5), matte([0.7; 3]), at(0.0, 0.0, 0.0));
    for i in 0..5_u8 {
        let (x, z) = (f32::from(i) * 0.9 - 1.8, f32::from(i * 3 % 5) * 0.5 - 1.2);
        let colour = [0.3 + 0.1 * f32::from(i), 0.6, 0.8 - 0.1 * f32::from(i)];
        let turned = Affine3A::from_rotation_translation(Quat::from_rotation_y(f32::from(i)), Vec3::new(x, 0.25, z));
        add(&mut s, block(Vec3::new(0.2, 0.25, 0.2)), material(colour, 0.0, 0.5), turned);
    }
    for i in 0..64_u8 {
        let (column, row) = (f64::from(i % 8), f64::from(i / 8));
        let place = DVec3::new(column * 0.6 - 2.1, 0.9 + 0.1 * f64::from(i % 5), row * 0.6 - 2.1);
        let hue = f32::from(i) * 2.4;
        let colour = Vec3::new(1.0 + hue.sin(), 1.0 + (hue + 2.1).sin(), 1.0 + (hue + 4.2).sin());
        let aside = Vec3::new(0.4 * hue.cos(), -1.0, 0.4 * hue.sin()).normalize();
        s.lights.push(match i % 4 {
            0 => Light::Point { position: place, intensity: colour * 0.15, range: Some(2.5) },
            1 => Light::Spot {
                position: place,
                direction: aside,
                intensity: colour * 0.4,
                range: None,
                inner: 0.3,
                outer: 0.8,
            },
            2 => Light::Sphere { centre: place, radius: 0.08, radiance: colour * 6.0 },
            _ => Light::Disc { centre: place, normal: aside, radius: 0.12, radiance: colour * 6.0 },
        });
    }
    for i in 0..3_u8 {
        let emits = Material { emission: Vec3::new(2.0, 1.5, 3.0 - f32::from(i)), ..matte([0.1; 3]) };
        let down = Quat::from_rotation_x(PI - 0.6);
        let place = Vec3::new(f32::from(i) * 1.4 - 1.4, 1.5, -1.5);
        add(&mut s, plane(0.25), emits, Affine3A::from_rotation_translation(down, place));
    }
    s
}

/// The built-in Cornell box, purely Lambertian: an index of refraction of 1 has no specular reflection, which makes the diffuse part
/// Lambert's.
pub fn cornell_diffuse() -> Scene {
    let mut s = builtin("cornell").unwrap_or_default();
    s.name = "cornell diffuse".to_owned();
    for material in &mut s.materials {
        material.ior = 1.0;
    }
    s
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scenes_are_whole_and_small() {
        for s in all().into_iter().chain([cornell_diffuse()]) {
            let triangles: usize = s.instances.iter().map(|i| s.meshes[i.mesh as usize].indices.len() / 3).sum();
            assert!(triangles > 0 && triangles < 200, "{}: {triangles}", s.name);
            assert!(s.cameras.len() == 1 && (!s.lights.is_empty() || s.environment.is_some()), "{}", s.name);
            for mesh in &s.meshes {
                for t in mesh.indices.as_chunks::<3>().0 {
                    let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
                    let face = (b - a).cross(c - a).normalize();
                    assert!(face.dot(mesh.normals[t[0] as usize]) > 0.99, "{}: {}", s.name, mesh.name);
                }
            }
        }
    }
}
