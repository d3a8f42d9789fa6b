//! Things that stand about: crates, barrels, plants, trees, a bicycle.
use super::super::foliage::{Random, core, crown};
use super::super::shapes::{Shape, block, curve, lathe, line};
use super::super::stage::{at as placed, scaled};
use super::batch::{pipe, rod};
use super::goods::crate_of_slats;
use super::lamps::Panel;
use super::{KERB, Market, PAVEMENT, SUNK, Side, along, turn};
use glam::{Affine3A, Vec2, Vec3};
use std::f32::consts::TAU;

pub fn clutter(market: &mut Market) {
    crates(market);
    barrels(market);
    bicycle(market, along(1.45, -3.08, PAVEMENT) * turn(97.0) * Affine3A::from_rotation_x(-0.10));
    plants(market);
    trees(market);
    vending_machine(market, Side::Left.facing(0.35, 3.92, PAVEMENT - SUNK));
    vending_machine(market, Side::Right.facing(13.6, 3.92, PAVEMENT - SUNK));
}

/// Stacks of crates beside the stalls.
fn crates(market: &mut Market) {
    let (pale, wood) = (market.paint.pale_wood, market.paint.wood);
    let mut random = Random::new(5);
    let shape = crate_of_slats(0.52, 0.28, 0.38);
    for (s, across, count) in [
        (-1.55, 2.98, 2),
        (1.95, 3.05, 3),
        (5.05, 3.0, 1),
        (3.35, -2.98, 2),
        (9.2, -3.0, 2),
        (12.4, -3.0, 2),
        (11.4, 3.0, 3),
    ] {
        let up = if f32::abs(across) > KERB { PAVEMENT } else { 0.0 };
        for i in 0..count {
            let at = along(s + random.range(-0.04, 0.04), across, up - SUNK + 0.285 * i as f32);
            market.batch.add(&shape, if i % 2 == 0 { pale } else { wood }, at * turn(80.0 + random.range(-12.0, 12.0)));
        }
    }
}

/// Barrels with iron hoops, some of them tables.
fn barrels(market: &mut Market) {
    let (wood, iron, glaze) = (market.paint.wood, market.paint.iron, market.paint.glaze);
    let barrel = lathe(
        &[
            curve(&[[0.25, 0.0], [0.29, 0.2], [0.305, 0.43], [0.29, 0.66], [0.25, 0.86]], 2),
            line(&[[0.25, 0.86], [0.23, 0.86]]),
            line(&[[0.23, 0.86], [0.23, 0.83]]),
            line(&[[0.23, 0.83], [0.0, 0.83]]),
        ],
        24,
    );
    let hoop = |r: f32, y: f32| lathe(&[line(&[[r, y], [r, y + 0.045]])], 24);
    let cup = lathe(&[line(&[[0.03, 0.0], [0.036, 0.09]]), line(&[[0.036, 0.09], [0.0, 0.085]])], 14);
    for (s, across, colour) in [(2.45, -3.02, 0), (3.15, -3.08, 2), (14.9, 3.1, 1), (18.8, 3.1, 3)] {
        let at = along(s, across, PAVEMENT - SUNK);
        market.batch.add(&barrel, wood, at);
        for (r, y) in [(0.268, 0.07), (0.302, 0.27), (0.303, 0.55), (0.266, 0.76)] {
            market.batch.add(&hoop(r, y), iron, at);
        }
        market.batch.add(&cup, glaze[colour], at * placed(0.08, 0.828, 0.05, 0.0));
        market.batch.add(&cup, glaze[colour + 1], at * placed(-0.09, 0.828, -0.03, 0.0));
    }
}

fn ring(radius: f32, tube: f32, steps: usize) -> Shape {
    let around = |i: usize| (i as f32 / steps as f32 * TAU).sin_cos();
    let line: Vec<Vec3> = (0..=steps).map(around).map(|(s, c)| Vec3::new(radius * c, radius * s, 0.0)).collect();
    pipe(&line, tube, 8)
}

/// A bicycle in the plane z = 0 of `at`, its front wheel at +x.
fn bicycle(market: &mut Market, at: Affine3A) {
    const WHEEL: f32 = 0.33;
    let paint = &market.paint;
    let (rubber, steel, colour, dark) = (paint.rubber, paint.steel, paint.glaze[5], paint.iron);
    let p = |x: f32, y: f32| Vec3::new(x, y, 0.0);
    let batch = &mut market.batch;
    for x in [-0.52, 0.52] {
        let wheel = at * Affine3A::from_translation(p(x, WHEEL));
        batch.add(&ring(WHEEL - 0.018, 0.018, 28), rubber, wheel);
        batch.add(&ring(WHEEL - 0.045, 0.010, 28), steel, wheel);
        for i in 0..10 {
            let (s, c) = (i as f32 / 10.0 * TAU).sin_cos();
            let spoke = rod(p(0.0, 0.0), p((WHEEL - 0.05) * c, (WHEEL - 0.05) * s), 0.0025, 3);
            batch.add(&spoke, steel, wheel);
        }
        batch.add(&rod(Vec3::Z * -0.05, Vec3::Z * 0.05, 0.022, 8), steel, wheel);
    }
    let (rear, front, crank) = (p(-0.52, WHEEL), p(0.52, WHEEL), p(-0.08, 0.29));
    let (saddle, head, fork) = (p(-0.22, 0.80), p(0.36, 0.84), p(0.40, 0.66));
    let mut frame = Shape::default();
    for (a, b, r) in [
        (crank, saddle, 0.016),
        (saddle, p(0.37, 0.78), 0.014),
        (crank, fork, 0.017),
        (rear, crank, 0.010),
        (rear, p(-0.20, 0.74), 0.009),
        (head, fork, 0.018),
        (fork, front, 0.012),
    ] {
        frame.join(&rod(a, b, r, 8), Affine3A::IDENTITY);
    }
    batch.add(&frame, colour, at);
    let bar = [
        Vec3::new(0.26, 0.98, -0.27),
        Vec3::new(0.36, 0.99, -0.16),
        Vec3::new(0.36, 0.96, 0.0),
        Vec3::new(0.36, 0.99, 0.16),
        Vec3::new(0.26, 0.98, 0.27),
    ];
    batch.add(&pipe(&bar, 0.012, 8), steel, at);
    batch.add(&rod(head, p(0.36, 0.96), 0.012, 8), steel, at);
    batch.add(&block(0.26, 0.05, 0.14, 0.02), dark, at * Affine3A::from_translation(p(-0.24, 0.82)));
    batch.add(&rod(saddle, p(-0.225, 0.83), 0.012, 6), steel, at);
    let basket = crate_of_slats(0.32, 0.20, 0.26);
    batch.add(&basket, paint.bamboo, at * Affine3A::from_translation(p(0.60, 0.72)));
}

/// Pots with bushes.
fn plants(market: &mut Market) {
    let pot = lathe(
        &[
            line(&[[0.0, 0.0], [0.13, 0.0]]),
            curve(&[[0.13, 0.0], [0.17, 0.10], [0.205, 0.24], [0.215, 0.33]], 2),
            line(&[[0.215, 0.33], [0.235, 0.33]]),
            line(&[[0.235, 0.33], [0.235, 0.37]]),
            line(&[[0.235, 0.37], [0.20, 0.37]]),
            line(&[[0.20, 0.37], [0.20, 0.34]]),
        ],
        24,
    );
    let soil = lathe(&[line(&[[0.203, 0.345], [0.0, 0.35]])], 20);
    let half = Vec3::new(0.30, 0.34, 0.30);
    let stage = &mut market.stage;
    let bush = stage.mesh("bush", crown(31, half, 130, 0.21));
    let inside = stage.mesh("bush core", core(half * 0.68));
    let paint = &market.paint;
    for (i, (s, across, size)) in [
        (-2.6, -3.75, 1.15),
        (-1.95, -3.9, 0.9),
        (-0.85, -3.9, 1.1),
        (1.6, -4.0, 0.9),
        (12.6, 4.05, 0.9),
        (15.2, -3.8, 1.2),
        (19.0, -3.9, 1.0),
        (15.2, 3.8, 1.2),
    ]
    .into_iter()
    .enumerate()
    {
        let place = along(s, across, PAVEMENT - SUNK) * scaled(0.0, 0.0, 0.0, 67.0 * i as f32, size);
        let glaze = [paint.clay, paint.glaze[0], paint.glaze[1]][i % 3];
        // A batch takes no scale.
        let still = along(s, across, PAVEMENT - SUNK);
        market.batch.add(&pot, glaze, still);
        market.batch.add(&soil, paint.soil, still);
        let above = place * Affine3A::from_translation(Vec3::Y * 0.60 / size);
        stage.put(bush, paint.leaves, above);
        stage.put(inside, paint.shade, above);
    }
}

/// A machine that sells drinks: cans in rows before a lit back, in a case that is open to the street.
fn vending_machine(market: &mut Market, at: Affine3A) {
    let (white, dark, colours) = (market.paint.white, market.paint.iron, market.paint.glaze);
    let on = |x: f32, y: f32, z: f32| at * Affine3A::from_translation(Vec3::new(x, y, z));
    let batch = &mut market.batch;
    batch.add(&block(1.04, 1.90, 0.50, 0.02), white, on(0.0, 0.03, -0.12));
    for x in [-0.48, 0.48] {
        batch.add(&block(0.08, 1.90, 0.24, 0.015), white, on(x, 0.03, 0.24));
    }
    for (y, height) in [(0.03, 0.62), (1.83, 0.10)] {
        batch.add(&block(0.90, height, 0.24, 0.015), white, on(0.0, y, 0.24));
    }
    batch.add(&block(0.56, 0.16, 0.02, 0.005), dark, on(-0.08, 0.26, 0.36));
    let can = lathe(
        &[
            line(&[[0.0, 0.0], [0.030, 0.0]]),
            line(&[[0.033, 0.012], [0.033, 0.115]]),
            line(&[[0.028, 0.125], [0.0, 0.125]]),
        ],
        12,
    );
    for row in 0..4 {
        let y = 0.70 + 0.285 * row as f32;
        batch.add(&block(0.88, 0.02, 0.14, 0.0), dark, on(0.0, y - 0.02, 0.27));
        for i in 0..9 {
            let colour = colours[(5 * row + i * i) % colours.len()];
            batch.add(&can, colour, on(0.095 * (i as f32 - 4.0), y, 0.27));
        }
    }
    let face = on(0.0, 1.24, 0.14);
    market.sites.panels.push(Panel { at: face, half: Vec2::new(0.44, 0.58), glow: Vec3::new(1.1, 1.7, 2.15) });
}

/// Two small trees in square beds.
fn trees(market: &mut Market) {
    let half = Vec3::new(0.92, 0.85, 0.92);
    let paint = &market.paint;
    let stage = &mut market.stage;
    let leaves = stage.mesh("tree crown", crown(8, half, 420, 0.33));
    let inside = stage.mesh("tree core", core(half * 0.62));
    let trunk = pipe(
        &[Vec3::ZERO, Vec3::new(0.03, 0.8, 0.02), Vec3::new(-0.02, 1.7, 0.04), Vec3::new(0.02, 2.6, 0.0)],
        0.075,
        10,
    );
    for (s, across) in [(2.75, -3.85), (14.2, 3.75)] {
        let at = along(s, across, PAVEMENT - SUNK);
        market.batch.add(&trunk, paint.bark, at);
        market.batch.add(&block(0.8, 0.05, 0.8, 0.01), paint.soil, at);
        let centre = at * Affine3A::from_translation(Vec3::Y * 3.05);
        stage.put(leaves, paint.leaves, centre);
        stage.put(inside, paint.shade, centre);
        // A strand that winds around the crown and down the trunk.
        let strand = (0..=160).map(|i| i as f32 / 160.0).map(|t| {
            let (s, c) = (9.0 * TAU * t).sin_cos();
            let y = 0.98 - 1.85 * t;
            let out = (1.0 - y * y).max(0.0).sqrt();
            centre.transform_point3(Vec3::new(half.x * out * c, half.y * y, half.z * out * s) * 1.04)
        });
        market.sites.fairy.push(strand.collect());
        let down = (0..=90).map(|i| i as f32 / 90.0).map(|t| {
            let (s, c) = (14.0 * TAU * t).sin_cos();
            at.transform_point3(Vec3::new(0.11 * c, 2.1 - 1.9 * t, 0.11 * s))
        });
        market.sites.fairy.push(down.collect());
    }
}
