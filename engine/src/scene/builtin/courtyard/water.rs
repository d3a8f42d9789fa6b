//! The fountain, the still basin, and the glazed tiles of both.
use super::super::foliage::Random;
use super::super::shapes::{Shape, block, curve, lathe, line, sphere};
use super::super::stage::{Stage, at};
use super::{Palette, SUNK};
use glam::{Affine3A, Quat, Vec3};
use std::f32::consts::TAU;

/// Thickness of a tile, metres.
const TILE: f32 = 0.022;

/// The fountain in the middle: a round basin, a bowl on a foot, and a polished ball.
pub(super) fn fountain(stage: &mut Stage, p: &Palette) {
    let place = at(0.75, -SUNK, -1.25, 0.0);
    let basin = lathe(
        &[
            line(&[[0.0, 0.0], [1.62, 0.0]]),
            line(&[[1.62, 0.0], [1.62, 0.10]]),
            line(&[[1.62, 0.10], [1.50, 0.13]]),
            line(&[[1.50, 0.13], [1.47, 0.40]]),
            curve(
                &[[1.47, 0.40], [1.56, 0.42], [1.60, 0.47], [1.56, 0.52], [1.48, 0.535], [1.36, 0.53], [1.31, 0.50]],
                3,
            ),
            line(&[[1.31, 0.50], [1.29, 0.12]]),
            line(&[[1.29, 0.12], [0.0, 0.12]]),
        ],
        60,
    );
    stage.add("fountain basin", basin, p.stone, place);
    // Tiles stand around it, as the side leans.
    let lean = Affine3A::from_rotation_x(-(0.03_f32 / 0.27).atan());
    let around = (0..64).map(|i| {
        let turn = Affine3A::from_rotation_y(i as f32 / 64.0 * TAU);
        place * turn * Affine3A::from_translation(Vec3::new(0.0, 0.127, 1.503)) * lean
    });
    tiles(stage, p, 11, [0.143, 0.262], around);
    let disc = lathe(&[line(&[[1.302, 0.43], [0.0, 0.43]])], 60);
    stage.add("water", disc, p.water, place);
    let foot = lathe(
        &[
            line(&[[0.34, 0.10], [0.34, 0.50]]),
            curve(&[[0.34, 0.50], [0.28, 0.55], [0.15, 0.66], [0.12, 0.82], [0.16, 0.98], [0.26, 1.05]], 3),
            curve(&[[0.26, 1.05], [0.50, 1.10], [0.70, 1.22], [0.76, 1.33]], 3),
            curve(&[[0.76, 1.33], [0.765, 1.35], [0.745, 1.36], [0.72, 1.345]], 2),
            curve(&[[0.72, 1.345], [0.62, 1.24], [0.40, 1.16], [0.0, 1.14]], 3),
        ],
        40,
    );
    stage.add("bowl on a foot", foot, p.pale, place);
    let disc = lathe(&[line(&[[0.70, 1.315], [0.0, 1.315]])], 48);
    stage.add("upper water", disc, p.water, place);
    let holder = lathe(
        &[curve(&[[0.16, 1.12], [0.13, 1.24], [0.07, 1.36], [0.09, 1.44]], 4), line(&[[0.09, 1.44], [0.0, 1.44]])],
        28,
    );
    stage.add("holder", holder, p.pale, place);
    stage.add("polished ball", sphere(0.30, 24, 44), p.silver, place * Affine3A::from_translation(Vec3::Y * 1.72));
}

/// A still basin on the axis of the fountain, with a low tiled kerb.
pub(super) fn basin(stage: &mut Stage, p: &Palette) {
    const HALF: [f32; 2] = [0.73, 1.48];
    const KERB: f32 = 0.16;
    let place = at(0.75, -SUNK, 2.5, 0.0);
    let [x, z] = HALF;
    let (long, short) = (2.0 * z, 2.0 * (x - KERB));
    let sides = |across: f32| [(across, 0.0), (-across, 0.0)];
    let ends = |along: f32| [(0.0, along), (0.0, -along)];
    let mut pair = |name: &str, shape: Shape, material: u32, y: f32, places: [(f32, f32); 2]| {
        let mesh = stage.mesh(name, shape);
        for (x, z) in places {
            stage.put(mesh, material, place * Affine3A::from_translation(Vec3::new(x, y, z)));
        }
    };
    pair("kerb side", block(KERB, 0.16, long, 0.0), p.stone, 0.0, sides(x - 0.5 * KERB));
    pair("kerb end", block(short, 0.16, KERB, 0.0), p.stone, 0.0, ends(z - 0.5 * KERB));
    // The coping stands out on both sides.
    let wide = KERB + 0.07;
    pair("coping side", block(wide, 0.045, long + 0.07, 0.008), p.pale, 0.159, sides(x - 0.5 * KERB));
    pair("coping end", block(short - 0.07, 0.045, wide, 0.008), p.pale, 0.159, ends(z - 0.5 * KERB));

    let (x_in, z_in) = (x - 0.9 * KERB, z - 0.9 * KERB);
    let mut water = Shape::default();
    water.quad([(-x_in, z_in), (x_in, z_in), (x_in, -z_in), (-x_in, -z_in)].map(|(x, z)| Vec3::new(x, 0.135, z)));
    stage.add("still water", water, p.water, place);

    // From the front, looking at it from all four sides.
    let side = |turn: f32, out: f32, count: usize, width: f32| {
        (0..count).map(move |i| {
            let along = (i as f32 + 0.5 - 0.5 * count as f32) * width / count as f32;
            place * at(0.0, 0.008, 0.0, turn) * Affine3A::from_translation(Vec3::new(along, 0.0, out + 0.006))
        })
    };
    let rows = side(0.0, z, 10, 1.46)
        .chain(side(90.0, x, 20, 2.96))
        .chain(side(180.0, z, 10, 1.46))
        .chain(side(270.0, x, 20, 2.96));
    tiles(stage, p, 12, [0.146, 0.147], rows);
}

/// The visible faces of a tile on the plane y = 0, centred on the y axis: a front towards +z with slanted sides, and no back.
fn tile(width: f32, height: f32) -> Shape {
    const SLANT: f32 = 0.005;
    let corners = |inset: f32, z: f32| {
        let x = 0.5 * width - inset;
        [(-x, inset), (x, inset), (x, height - inset), (-x, height - inset)].map(|(x, y)| Vec3::new(x, y, z))
    };
    let (front, back) = (corners(SLANT, 0.5 * TILE), corners(0.0, -0.5 * TILE));
    let mut shape = Shape::default();
    shape.quad(front);
    for side in 0..4 {
        let next = (side + 1) % 4;
        shape.quad([back[side], back[next], front[next], front[side]]);
    }
    shape
}

/// Hand-made tiles of this width and height with joints between: no two have quite the same tone, and none is quite in the plane of
/// its neighbours.
fn tiles(stage: &mut Stage, p: &Palette, seed: u64, size: [f32; 2], places: impl Iterator<Item = Affine3A>) {
    let mesh = stage.mesh("tile", tile(size[0] - 0.004, size[1] - 0.004));
    let mut random = Random::new(seed);
    for place in places {
        let tone = p.tiles[random.range(0.0, 3.999) as usize];
        let tilt =
            Quat::from_rotation_y(random.range(-0.010, 0.010)) * Quat::from_rotation_x(random.range(-0.008, 0.008));
        stage.put(mesh, tone, place * Affine3A::from_quat(tilt));
    }
}
