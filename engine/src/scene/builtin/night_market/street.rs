//! The ground: setts with puddles, kerbs, pavements, covers over drains, bollards.
use super::super::shapes::{Shape, block, curve, lathe, line};
use super::batch::sheet;
use super::{BEGIN, END, FRONT, KERB, Market, PAVEMENT, SUNK, along, point};
use glam::{Affine3A, Vec2, Vec3};

/// Metres of a strip between two rows of its vertices.
const STEP: f32 = 0.7;

/// A strip of ground along the street between two distances from its middle; its texture coordinates are metres across and along.
fn strip(from: f32, to: f32, up: f32, ends: [f32; 2]) -> Shape {
    let [begin, end] = ends;
    let steps = ((end - begin) / STEP).ceil() as usize;
    let rows: Vec<Vec<Vec3>> = (0..=steps)
        .map(|i| begin + (end - begin) * i as f32 / steps as f32)
        .map(|s| [from, to].map(|across| point(s, across, up)).to_vec())
        .collect();
    let mut shape = sheet(&rows);
    for (i, uv) in shape.mesh.uv0.iter_mut().enumerate() {
        let s = begin + (end - begin) * (i / 2) as f32 / steps as f32;
        *uv = Vec2::new(if i % 2 == 0 { from } else { to }, -s);
    }
    shape
}

/// Metres by which the pattern of the paving is shifted, so that a large puddle lies before the first camera.
const SHIFT: Vec2 = Vec2::new(3.45, 4.3);

pub fn street(market: &mut Market) {
    let (setts, granite) = (market.paint.setts, market.paint.granite);
    // In pieces, so that each has tight bounds.
    let mut begin = BEGIN - 4.0;
    while begin < END {
        let ends = [begin, (begin + 7.0).min(END)];
        for (from, to, up) in [(-KERB, KERB, 0.0), (-FRONT - 0.3, -KERB, PAVEMENT), (KERB, FRONT + 0.3, PAVEMENT)] {
            let mut shape = strip(from, to, up, ends);
            shape.mesh.uv0.iter_mut().for_each(|uv| *uv += SHIFT);
            market.batch.add_placed(&shape, setts, point(ends[0] + 3.5, 0.5 * (from + to), 0.0));
        }
        begin = ends[1];
    }
    kerbs(market, granite);
    covers(market);
    bollards(market);
    let mut plane = Shape::default();
    let h = 90.0;
    plane.quad([Vec3::new(-h, 0.0, h), Vec3::new(h, 0.0, h), Vec3::new(h, 0.0, -h), Vec3::new(-h, 0.0, -h)]);
    let asphalt = market.paint.asphalt;
    market.batch.add(&plane, asphalt, Affine3A::from_translation(Vec3::new(0.0, -0.03, -15.0)));
}

/// Stones along the pavements.
fn kerbs(market: &mut Market, granite: u32) {
    let stone = block(0.16, PAVEMENT + 0.06, 0.98, 0.012);
    let mut s = BEGIN;
    while s < END {
        for across in [-KERB, KERB] {
            market.batch.add(&stone, granite, along(s, across, -0.05));
        }
        s += 1.0;
    }
}

/// Iron covers in the street.
fn covers(market: &mut Market) {
    let mut cover = lathe(&[line(&[[0.36, -0.01], [0.36, 0.012]]), line(&[[0.36, 0.012], [0.0, 0.012]])], 28);
    for (r, turn) in [(0.12, 0.0), (0.22, 0.3), (0.31, 0.0)] {
        for i in 0..12 {
            let angle = turn + i as f32 / 12.0 * std::f32::consts::TAU;
            let at = Affine3A::from_rotation_y(angle) * Affine3A::from_translation(Vec3::new(r, 0.010, 0.0));
            cover.join(&block(0.030, 0.007, 0.030, 0.0), at);
        }
    }
    for (s, across) in [(-0.9, 1.05), (9.5, -0.9), (20.0, 0.6)] {
        market.batch.add(&cover, market.paint.iron, along(s, across, 0.0));
    }
}

/// Posts along the kerbs, where no stall stands.
fn bollards(market: &mut Market) {
    let post = lathe(
        &[
            line(&[[0.085, 0.0], [0.085, 0.06]]),
            curve(&[[0.085, 0.06], [0.062, 0.10], [0.055, 0.40], [0.052, 0.70]], 2),
            curve(&[[0.052, 0.70], [0.070, 0.73], [0.070, 0.76], [0.050, 0.79]], 2),
            curve(&[[0.050, 0.79], [0.062, 0.84], [0.045, 0.89], [0.0, 0.905]], 3),
        ],
        16,
    );
    for (s, across) in [(-1.9, -2.42), (0.6, -2.42), (3.1, -2.42), (13.2, 2.42), (15.8, 2.42), (18.4, -2.42)] {
        market.batch.add(&post, market.paint.iron, along(s, across, -SUNK));
    }
}
