//! Toy scenes: a floor for direct light, a corner for indirect light.

use super::direct::{self, Block, PointLight, Surface};
use super::indirect::{self, Patch};
use glam::DVec3;

fn light(x: f64, y: f64, z: f64, intensity: f64) -> PointLight {
    PointLight { position: DVec3::new(x, y, z), intensity }
}

/// Ten lights of 1 to 80 candela around the floor of [`floor`]; each is behind a box or below the horizon for some
/// pixels.
pub fn floor_lights() -> Vec<PointLight> {
    vec![
        light(0.3, 0.2, 1.0, 4.0),
        light(-1.0, 0.5, 1.5, 9.0),
        light(3.2, -1.0, 0.7, 30.0),
        light(0.5, 1.5, 2.0, 12.0),
        light(4.0, 3.0, 3.0, 80.0),
        light(-0.4, -0.6, 0.4, 1.0),
        light(1.4, 2.5, 0.8, 25.0),
        light(1.6, -0.2, -1.0, 5.0),
        light(2.1, 0.4, 0.5, 2.0),
        light(-2.0, -2.0, 1.0, 20.0),
    ]
}

/// A wall across the floor, a beam above it, and a small box.
pub fn floor_blocks() -> Vec<Block> {
    let block = |min: [f64; 3], max: [f64; 3]| Block { min: min.into(), max: max.into() };
    vec![
        block([1.2, -3.0, 0.0], [1.3, 0.75, 0.6]),
        block([0.0, 0.9, 0.9], [3.0, 1.0, 1.4]),
        block([-0.2, -0.4, 0.0], [-0.1, 0.2, 0.5]),
    ]
}

/// Six by three pixels over a floor, half a metre apart. The third of each row faces sideways, the last one is sky.
pub fn floor(lights: Vec<PointLight>, blocks: &[Block]) -> direct::Scene {
    const SIZE: (u32, u32) = (6, 3);
    let pixel = |i: u32| {
        let (x, y) = (i % SIZE.0, i / SIZE.0);
        let position = DVec3::new(0.5 * f64::from(x), 0.5 * f64::from(y), 0.0);
        let normal = if x == 2 { DVec3::new(-1.0, 0.2, 0.3).normalize() } else { DVec3::Z };
        (i + 1 < SIZE.0 * SIZE.1).then_some(Surface { position, normal })
    };
    direct::Scene::new((0..SIZE.0 * SIZE.1).map(pixel).collect(), SIZE.0 as usize, lights, blocks)
}

/// The patches of [`corner`]: two walls that glow where they meet the floor, the floor, and a dark panel that hides a
/// part of the walls.
pub fn corner_patches() -> Vec<Patch> {
    let patch = |corner: [f64; 3], u: [f64; 3], v: [f64; 3], radiance| Patch {
        corner: corner.into(),
        u: u.into(),
        v: v.into(),
        radiance,
    };
    vec![
        // Faces +x, brightest at the floor.
        patch([0.0, 1.0, 0.0], [0.0, 0.0, 1.5], [0.0, -2.0, 0.0], [6.0, 1.0]),
        // Faces -y.
        patch([2.0, 1.0, 0.0], [0.0, 0.0, 1.5], [-2.0, 0.0, 0.0], [3.0, 0.5]),
        // Faces +z, brightest at the wall.
        patch([0.0, -1.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [2.0, 0.2]),
        // A panel, black on both sides.
        patch([0.5, -0.5, 0.15], [0.0, 1.0, 0.0], [0.0, 0.0, 0.5], [0.0, 0.0]),
    ]
}

/// A row of pixels down a wall and along the floor of a corner, the last one sky, in front of walls that glow, under a
/// faint sky. `shift` moves all of them sideways, metres.
pub fn corner(shift: f64) -> indirect::Scene {
    let wall = [1.2, 0.6, 0.3, 0.1, 0.04].map(|z| (DVec3::new(0.0, shift, z), DVec3::X));
    let floor = [0.04, 0.1, 0.2, 0.35, 0.6, 0.9, 1.3, 1.8].map(|x| (DVec3::new(x, shift, 0.0), DVec3::Z));
    let surface = |&(position, normal): &(DVec3, DVec3)| Some(Surface { position, normal });
    let pixels = wall.iter().chain(&floor).map(surface).chain([None]).collect();
    indirect::Scene { patches: corner_patches(), sky: [0.5, 0.1], pixels }
}
