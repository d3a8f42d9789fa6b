//! Scenes built in code: planes, spheres, boxes, a sun.
use glam::{Affine3A, DAffine3, DVec3, Vec2, Vec3, Vec4};
use magpie::scene::{Camera, Environment, Instance, Light, Material, Mesh, Scene, Sphere};
use std::f32::consts::{PI, TAU};

/// A mesh of triangles with one normal per vertex, white, without texture coordinates.
pub fn mesh(name: &str, positions: Vec<Vec3>, normals: Vec<Vec3>, indices: Vec<u32>) -> Mesh {
    let n = positions.len();
    let tangents = normals.iter().map(|n| n.any_orthonormal_vector().extend(1.0)).collect();
    let name = name.to_owned();
    let (uv0, uv1, colours) = (vec![Vec2::ZERO; n], vec![Vec2::ZERO; n], vec![Vec4::ONE; n]);
    Mesh { name, positions, normals, tangents, uv0, uv1, colours, indices, ..Mesh::default() }
}

/// A horizontal square around the origin that faces up; `half` is half its side, metres.
pub fn plane(half: f32) -> Mesh {
    let corners = [[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]];
    let positions = corners.iter().map(|[x, z]| Vec3::new(*x, 0.0, *z) * half).collect();
    mesh("plane", positions, vec![Vec3::Y; 4], vec![0, 1, 2, 0, 2, 3])
}

/// A unit sphere around the origin with smooth normals; `rings` from pole to pole.
pub fn sphere(rings: u32) -> Mesh {
    let sectors = 2 * rings;
    let (mut points, mut indices) = (Vec::new(), Vec::new());
    for ring in 0..=rings {
        for sector in 0..=sectors {
            let (down, round) = (PI * ring as f32 / rings as f32, TAU * sector as f32 / sectors as f32);
            points.push(Vec3::new(down.sin() * round.cos(), down.cos(), down.sin() * round.sin()).normalize());
            if ring < rings && sector < sectors {
                let (a, b) = (ring * (sectors + 1) + sector, (ring + 1) * (sectors + 1) + sector);
                indices.extend([a, a + 1, b, b, a + 1, b + 1]);
            }
        }
    }
    mesh("sphere", points.clone(), points, indices)
}

/// A box around the origin with flat normals; `half` is half its extent, metres.
pub fn block(half: Vec3) -> Mesh {
    let (mut positions, mut normals, mut indices) = (Vec::new(), Vec::new(), Vec::new());
    for axis in 0..3 {
        for side in [-1.0, 1.0] {
            let (mut n, mut u) = (Vec3::ZERO, Vec3::ZERO);
            (n[axis], u[(axis + 1) % 3]) = (side, 1.0);
            let v = n.cross(u);
            let first = positions.len() as u32;
            positions
                .extend([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[s, t]| (n + u * s + v * t) * half));
            normals.extend([n; 4]);
            indices.extend([0, 1, 2, 0, 2, 3].map(|i| first + i));
        }
    }
    mesh("block", positions, normals, indices)
}

/// An empty scene with a camera.
pub fn scene(name: &str, camera: Camera) -> Scene {
    Scene { name: name.to_owned(), cameras: vec![camera], ..Scene::default() }
}

/// A camera with a vertical angle of view of 40 degrees.
///
/// # Panics
/// If eye and target coincide.
pub fn camera(eye: impl Into<DVec3>, target: impl Into<DVec3>) -> Camera {
    let (eye, target) = (eye.into(), target.into());
    let up = if (target - eye).normalize().y.abs() > 0.99 { Vec3::Z } else { Vec3::Y };
    Camera::look_at("test", eye, target, up, 40_f32.to_radians()).unwrap_or_else(|e| panic!("{e}"))
}

/// Adds one instance of a mesh with its own material.
pub fn add(scene: &mut Scene, mesh: Mesh, material: Material, world_from_object: Affine3A) {
    let (m, n) = (scene.materials.len() as u32, scene.meshes.len() as u32);
    scene.instances.push(Instance::fixed(mesh.name.clone(), n, m, world_from_object));
    scene.meshes.push(mesh);
    scene.materials.push(material);
}

/// A material without textures.
pub fn material(base_colour: [f32; 3], metalness: f32, roughness: f32) -> Material {
    let base_colour = Vec3::from(base_colour).extend(1.0);
    Material { base_colour, metalness, roughness, ..Material::default() }
}

/// A directional light from this direction with an illuminance of pi.
pub fn sun(towards: Vec3) -> Light {
    Light::Directional { direction: -towards.normalize(), illuminance: Vec3::splat(PI), angular_radius: 0.0 }
}

/// An environment map of eight by four texels: a ground, a sky that is bluer at the top and redder to the right, and one bright texel
/// ahead, above the horizon and to the right.
pub fn environment() -> Environment {
    let texel = |x: u32, y: u32| match (x, y) {
        (5, 1) => Vec3::new(30.0, 26.0, 20.0),
        (_, 0 | 1) => Vec3::new(0.2 + 0.1 * x as f32, 0.6, 1.6 - 0.5 * y as f32),
        _ => Vec3::new(0.3, 0.25 + 0.02 * x as f32, 0.2),
    };
    let radiance = (0..32).map(|i| texel(i % 8, i / 8)).collect();
    Environment { name: "made".to_owned(), width: 8, height: 4, radiance, scale: 1.0, turn: 0.0 }
}

/// A furnace: a ball of radius 1 in the origin, seen from a distance on the z axis, with light of 1 from all around.
pub fn ball_under_an_even_sky(name: &str, material: Material, distance: f64) -> Scene {
    let mut made = scene(name, camera(DVec3::new(0.0, 0.0, distance), DVec3::ZERO));
    let spheres = vec![Sphere { centre: Vec3::ZERO, radius: 1.0 }];
    add(&mut made, Mesh { name: "ball".to_owned(), spheres, ..Mesh::default() }, material, Affine3A::IDENTITY);
    let radiance = vec![Vec3::ONE; 8].into();
    made.environment =
        Some(Environment { name: "even".to_owned(), width: 4, height: 2, radiance, scale: 1.0, turn: 0.0 });
    made
}

/// Moves and scales everything, lamps of points and balls with it, so that the picture stays the same.
pub fn placed(mut s: Scene, by: DAffine3) -> Scene {
    let scale = by.matrix3.x_axis.length();
    for instance in &mut s.instances {
        instance.world_from_object = by * instance.world_from_object;
    }
    for light in &mut s.lights {
        match light {
            Light::Sphere { centre, radius, .. } => {
                (*centre, *radius) = (by.transform_point3(*centre), *radius * scale as f32);
            }
            Light::Point { position, intensity, .. } => {
                (*position, *intensity) = (by.transform_point3(*position), *intensity * (scale * scale) as f32);
            }
            _ => {}
        }
    }
    let camera = &mut s.cameras[0];
    camera.world_from_camera.translation = by.transform_point3(camera.world_from_camera.translation);
    camera.near *= scale as f32;
    s
}
