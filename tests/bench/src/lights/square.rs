//! The scene of `magpie bench lights`: a square of floor with balls on it under any number of lamps.
use glam::{Affine3A, DVec3, Vec2, Vec3, Vec4};
use magpie::scene::{Camera, Instance, Light, Material, Mesh, Scene, Sphere};
use std::f32::consts::PI;

/// Half the side of the square, metres.
const HALF: f32 = 10.0;
/// Balls along each side.
const BALLS: u8 = 5;
/// Radius of a ball, metres.
const BALL: f32 = 0.7;
/// Radius of a lamp, metres.
const LAMP: f32 = 0.02;
/// Power of all lamps together, in the unit of radiance times square metres times steradians.
const POWER: f32 = 3000.0;
/// The golden ratio less 1, and the two numbers that do the same in the plane: multiples are spread evenly.
const GOLDEN: f64 = 0.618_034;
const PLASTIC: [f64; 2] = [0.754_878, 0.569_840];

fn floor() -> Mesh {
    let corners = [[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]];
    Mesh {
        name: "floor".to_owned(),
        positions: corners.iter().map(|[x, z]| Vec3::new(*x, 0.0, *z) * HALF).collect(),
        normals: vec![Vec3::Y; 4],
        tangents: vec![Vec4::new(1.0, 0.0, 0.0, 1.0); 4],
        uv0: vec![Vec2::ZERO; 4],
        uv1: vec![Vec2::ZERO; 4],
        colours: vec![Vec4::ONE; 4],
        indices: vec![0, 1, 2, 0, 2, 3],
        ..Mesh::default()
    }
}

/// Adds one instance of a mesh with its own material.
fn add(scene: &mut Scene, mesh: Mesh, material: Material, at: Vec3) {
    let (m, n) = (scene.materials.len() as u32, scene.meshes.len() as u32);
    scene.instances.push(Instance::fixed(mesh.name.clone(), n, m, Affine3A::from_translation(at)));
    scene.meshes.push(mesh);
    scene.materials.push(material);
}

/// The square under this many lamps, small spheres 0.4 to 3 metres over the floor, of many colours, whose power adds up to the same. `None` if the
/// camera cannot be.
pub fn square(lamps: u32) -> Option<Scene> {
    let eye = DVec3::new(7.5, 5.0, 8.5);
    let camera = Camera::look_at("square", eye, DVec3::new(-0.5, 0.3, -0.5), Vec3::Y, 40_f32.to_radians()).ok()?;
    let mut scene = Scene { name: format!("square with {lamps} lamps"), cameras: vec![camera], ..Scene::default() };
    let matte = Material { base_colour: Vec3::splat(0.6).extend(1.0), roughness: 0.7, ..Material::default() };
    add(&mut scene, floor(), matte, Vec3::ZERO);
    for k in 0..BALLS * BALLS {
        let [x, z] = [k % BALLS, k / BALLS].map(|n| 3.4 * (f32::from(n) - 0.5 * f32::from(BALLS - 1)));
        let ball = vec![Sphere { centre: Vec3::ZERO, radius: BALL }];
        let hue = |phase: f32| 0.5 + 0.3 * (1.3 * f32::from(k) + phase).sin();
        let material = Material {
            base_colour: Vec3::new(hue(0.0), hue(2.1), hue(4.2)).extend(1.0),
            metalness: f32::from(u8::from(k % 4 == 1)),
            roughness: 0.25 + 0.15 * f32::from(k % 5),
            ..Material::default()
        };
        let mesh = Mesh { name: format!("ball {k}"), spheres: ball, ..Mesh::default() };
        add(&mut scene, mesh, material, Vec3::new(x, BALL, z));
    }
    for k in 0..lamps {
        let n = f64::from(k) + 0.5;
        let place = |step: f64| 2.0 * f64::from(HALF) * ((n * step).fract() - 0.5);
        let height = 0.4 + 2.6 * (0.95 + n * GOLDEN).fract();
        let hue = |phase: f32| 0.55 + 0.45 * (0.7 * k as f32 + phase).sin();
        let power = Vec3::new(hue(0.0), hue(2.1), hue(4.2)) * (POWER / lamps as f32);
        scene.lights.push(Light::Sphere {
            centre: DVec3::new(place(PLASTIC[0]), height, place(PLASTIC[1])),
            radius: LAMP,
            radiance: power / (4.0 * PI * PI * LAMP * LAMP),
        });
    }
    Some(scene)
}
