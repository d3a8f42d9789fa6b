//! What the stalls sell.
use super::super::foliage::Random;
use super::super::shapes::{Shape, block, curve, cushion, lathe, line};
use super::batch::{rod, sheet, tilt};
use super::stalls::{COUNTER, Stall};
use super::{Market, turn};
use glam::{Affine3A, Vec3};
use std::f32::consts::TAU;

/// Kinds of goods.
#[derive(Clone, Copy, PartialEq)]
pub enum Goods {
    Fruit,
    Tea,
    Dumplings,
    Cloth,
    Pottery,
}

pub fn lay_out(market: &mut Market, stall: &Stall, goods: Goods, random: &mut Random) {
    match goods {
        Goods::Fruit => fruit(market, stall, random),
        Goods::Tea => tea(market, stall, random),
        Goods::Dumplings => dumplings(market, stall),
        Goods::Cloth => cloth(market, stall, random),
        Goods::Pottery => pottery(market, stall, random),
    }
}

/// An open crate of slats, a place in the middle of its bottom.
pub fn crate_of_slats(width: f32, height: f32, depth: f32) -> Shape {
    let mut shape = Shape::default();
    let mut board = |w: f32, h: f32, d: f32, x: f32, y: f32, z: f32| {
        shape.join(&block(w, h, d, 0.0), Affine3A::from_translation(Vec3::new(x, y, z)));
    };
    board(width, 0.015, depth, 0.0, 0.0, 0.0);
    let rows = (height / 0.085).round().max(1.0) as usize;
    for i in 0..rows {
        let y = 0.018 + height * i as f32 / rows as f32;
        let tall = height / rows as f32 - 0.016;
        for side in [-1.0, 1.0] {
            board(width, tall, 0.014, 0.0, y, side * (0.5 * depth - 0.007));
            board(0.014, tall, depth - 0.03, side * (0.5 * width - 0.007), y, 0.0);
        }
    }
    for [x, z] in [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]] {
        let place = |edge: f32, sign: f32| sign * (0.5 * edge - 0.028);
        board(0.028, height + 0.02, 0.028, place(width, x), 0.005, place(depth, z));
    }
    shape
}

/// A heap of balls in a crate.
fn heap(market: &mut Market, at: Affine3A, [width, depth]: [f32; 2], radius: f32, kind: u32, random: &mut Random) {
    for layer in 0..3 {
        let inset = 0.02 + 0.55 * radius * layer as f32;
        let across = ((width - 2.0 * inset) / (2.05 * radius)) as usize;
        let along = ((depth - 2.0 * inset) / (2.05 * radius)) as usize;
        for i in 0..across {
            for k in 0..along {
                let place = |n: usize, count: usize| (n as f32 + 0.5 - 0.5 * count as f32) * 2.05 * radius;
                let jitter = 0.12 * radius;
                let wobble = Vec3::new(random.range(-jitter, jitter), 0.0, random.range(-jitter, jitter));
                let y = 0.02 + radius + 1.35 * radius * layer as f32;
                let centre = at.transform_point3(Vec3::new(place(i, across), y, place(k, along)) + wobble);
                market.batch.ball(centre, radius * random.range(0.92, 1.04), kind);
            }
        }
    }
}

/// Radii of the kinds of fruit, metres.
const RADII: [f32; 6] = [0.040, 0.038, 0.028, 0.034, 0.026, 0.037];

/// Crates of fruit in rows that rise from the street, and on the shelf.
fn fruit(market: &mut Market, stall: &Stall, random: &mut Random) {
    let kinds = market.paint.fruit;
    let pale = market.paint.pale_wood;
    let count = 4;
    let width = (stall.width - 0.2) / count as f32 - 0.03;
    let first = random.range(0.0, 5.99) as usize;
    for i in 0..count {
        let x = (i as f32 + 0.5 - 0.5 * count as f32) * (width + 0.03);
        for (row, (y, z)) in [(COUNTER + 0.02, 0.44), (COUNTER + 0.16, 0.05)].into_iter().enumerate() {
            let at = stall.on(x, y, z) * tilt(14.0);
            market.batch.add(&crate_of_slats(width, 0.085, 0.36), pale, at);
            let kind = (first + i + 3 * row) % kinds.len();
            heap(market, at, [width - 0.02, 0.33], RADII[kind], kinds[kind], random);
        }
        // A lower row before the counter.
        let at = stall.on(x, 0.40, 0.86) * tilt(24.0);
        market.batch.add(&crate_of_slats(width, 0.085, 0.36), pale, at);
        let kind = (first + 2 * i + 1) % kinds.len();
        heap(market, at, [width - 0.02, 0.33], RADII[kind], kinds[kind], random);
        market.batch.add(&crate_of_slats(width, 0.17, 0.24), pale, stall.on(x, 0.98, -0.50));
        let at = stall.on(x, 1.02, -0.50);
        heap(market, at, [width - 0.02, 0.22], 0.036, kinds[(first + i) % kinds.len()], random);
    }
    // What the lower row stands on, and a hanging scale.
    let wood = market.paint.wood;
    for x in [-0.5 * stall.width + 0.2, 0.0, 0.5 * stall.width - 0.2] {
        market.batch.add(&block(0.06, 0.33, 0.34, 0.0), wood, stall.on(x, -0.08, 0.86));
    }
    let steel = market.paint.steel;
    let pan = lathe(
        &[
            curve(&[[0.0, -0.05], [0.10, -0.04], [0.15, 0.0]], 3),
            curve(&[[0.15, 0.0], [0.10, -0.034], [0.0, -0.044]], 3),
        ],
        20,
    );
    let x = 0.5 * stall.width - 0.32;
    market.batch.add(&pan, steel, stall.on(x, 1.42, 0.5));
    market.batch.add(
        &lathe(&[line(&[[0.08, 0.0], [0.08, 0.10]]), line(&[[0.08, 0.10], [0.0, 0.12]])], 16),
        steel,
        stall.on(x, 1.72, 0.5),
    );
    for [dx, dz] in [[0.13, 0.0], [-0.065, 0.113], [-0.065, -0.113]] {
        let string = rod(Vec3::new(dx, 0.0, dz), Vec3::new(0.0, 0.32, 0.0), 0.003, 3);
        market.batch.add(&string, steel, stall.on(x, 1.42, 0.5));
    }
}

/// A bottle of this height.
fn bottle(height: f32) -> Shape {
    let r = 0.135 * height;
    lathe(
        &[
            line(&[[0.0, 0.0], [0.9 * r, 0.0]]),
            line(&[[0.9 * r, 0.0], [r, 0.04 * height]]),
            curve(
                &[
                    [r, 0.04 * height],
                    [r, 0.3 * height],
                    [r, 0.55 * height],
                    [0.4 * r, 0.75 * height],
                    [0.34 * r, height],
                ],
                2,
            ),
            line(&[[0.34 * r, height], [0.0, height]]),
        ],
        10,
    )
}

/// A jar with a lid.
fn jar(radius: f32, height: f32) -> Shape {
    lathe(
        &[
            line(&[[0.0, 0.0], [0.8 * radius, 0.0]]),
            curve(
                &[[0.8 * radius, 0.0], [radius, 0.25 * height], [radius, 0.6 * height], [0.62 * radius, 0.82 * height]],
                2,
            ),
            line(&[[0.68 * radius, 0.82 * height], [0.68 * radius, 0.9 * height]]),
            curve(
                &[[0.68 * radius, 0.9 * height], [0.5 * radius, 0.96 * height], [0.12 * radius, height], [0.0, height]],
                1,
            ),
        ],
        16,
    )
}

/// Jars and tins of tea, bottles at the back, a kettle.
fn tea(market: &mut Market, stall: &Stall, random: &mut Random) {
    let (glaze, bottles) = (market.paint.glaze, market.paint.bottles);
    let (copper, brass, white) = (market.paint.copper, market.paint.brass, market.paint.white);
    let half = 0.5 * stall.width - 0.16;
    for (y, z, step) in [(0.98, -0.52, 0.15), (1.43, -0.52, 0.13), (1.88, -0.52, 0.17)] {
        let mut x = -half;
        while x < half {
            let height = random.range(0.22, 0.32);
            let colour = bottles[random.range(0.0, 2.99) as usize];
            market.batch.add(&bottle(height), colour, stall.on(x, y, z + random.range(-0.04, 0.04)));
            x += step;
        }
    }
    for (row, z) in [0.05, 0.32].into_iter().enumerate() {
        let count = 7 - row;
        for i in 0..count {
            let x = (i as f32 + 0.5 - 0.5 * count as f32) * (2.0 * half / count as f32);
            let colour = glaze[random.range(0.0, 5.99) as usize];
            let shape = jar(0.085, random.range(0.20, 0.27) - 0.04 * row as f32);
            market.batch.add(&shape, colour, stall.on(x, COUNTER, z));
        }
    }
    let cup = lathe(
        &[
            line(&[[0.0, 0.0], [0.018, 0.0]]),
            curve(&[[0.018, 0.0], [0.032, 0.018], [0.036, 0.045]], 3),
            curve(&[[0.036, 0.045], [0.030, 0.018], [0.0, 0.010]], 3),
        ],
        16,
    );
    for i in 0..6 {
        market.batch.add(&cup, white, stall.on(0.35 + 0.10 * (i % 3) as f32, COUNTER, 0.50 + 0.10 * (i / 3) as f32));
    }
    let kettle = lathe(
        &[
            line(&[[0.0, 0.0], [0.10, 0.0]]),
            curve(&[[0.10, 0.0], [0.135, 0.03], [0.145, 0.10], [0.09, 0.19], [0.05, 0.20]], 3),
            curve(&[[0.055, 0.205], [0.03, 0.22], [0.0, 0.25]], 3),
        ],
        24,
    );
    market.batch.add(&kettle, copper, stall.on(-0.45, COUNTER, 0.52));
    let spout = rod(Vec3::new(0.11, 0.09, 0.0), Vec3::new(0.22, 0.20, 0.0), 0.018, 8);
    market.batch.add(&spout, copper, stall.on(-0.45, COUNTER, 0.52));
    market.batch.add(
        &lathe(&[line(&[[0.11, 0.0], [0.11, 0.012]]), line(&[[0.11, 0.012], [0.0, 0.012]])], 20),
        brass,
        stall.on(0.02, COUNTER, 0.54),
    );
}

/// Stacks of steamers, a pot on a burner, bowls; stools before the counter.
fn dumplings(market: &mut Market, stall: &Stall) {
    let paint = &market.paint;
    let (bamboo, steel, iron, wood) = (paint.bamboo, paint.steel, paint.iron, paint.wood);
    let (ivory, oxblood) = (paint.glaze[3], paint.glaze[2]);
    let steamer = lathe(
        &[
            line(&[[0.175, 0.0], [0.175, 0.030]]),
            line(&[[0.182, 0.030], [0.182, 0.048]]),
            line(&[[0.175, 0.048], [0.175, 0.092]]),
            line(&[[0.175, 0.092], [0.0, 0.092]]),
        ],
        28,
    );
    let lid =
        lathe(&[line(&[[0.182, 0.0], [0.182, 0.035]]), curve(&[[0.182, 0.035], [0.12, 0.055], [0.0, 0.064]], 3)], 28);
    let batch = &mut market.batch;
    for (x, z, count) in [(-0.80, 0.20, 5), (-0.40, 0.34, 3), (-0.42, -0.04, 4)] {
        for i in 0..count {
            batch.add(&steamer, bamboo, stall.on(x, COUNTER + 0.094 * i as f32, z) * turn(17.0 * i as f32));
        }
        batch.add(&lid, bamboo, stall.on(x, COUNTER + 0.094 * count as f32, z));
    }
    let pot = lathe(
        &[
            line(&[[0.0, 0.0], [0.20, 0.0]]),
            curve(&[[0.20, 0.0], [0.225, 0.02], [0.225, 0.24]], 2),
            line(&[[0.225, 0.24], [0.245, 0.245]]),
            line(&[[0.245, 0.245], [0.21, 0.25]]),
            line(&[[0.21, 0.25], [0.21, 0.20]]),
            line(&[[0.21, 0.20], [0.0, 0.20]]),
        ],
        30,
    );
    batch.add(&pot, steel, stall.on(0.22, COUNTER + 0.08, 0.18));
    batch.add(&block(0.46, 0.09, 0.46, 0.01), iron, stall.on(0.22, COUNTER - SMALL, 0.18));
    let bowl = lathe(
        &[
            line(&[[0.0, 0.0], [0.035, 0.0]]),
            curve(&[[0.035, 0.0], [0.06, 0.02], [0.085, 0.065]], 3),
            curve(&[[0.085, 0.065], [0.055, 0.022], [0.0, 0.012]], 3),
        ],
        20,
    );
    for (x, z, count, glaze) in
        [(0.68, 0.05, 7, ivory), (0.90, 0.10, 5, oxblood), (0.78, 0.40, 1, ivory), (0.55, 0.52, 1, oxblood)]
    {
        for i in 0..count {
            batch.add(&bowl, glaze, stall.on(x, COUNTER + 0.022 * i as f32, z));
        }
    }
    let seat = lathe(
        &[line(&[[0.0, 0.42], [0.16, 0.42]]), line(&[[0.16, 0.42], [0.16, 0.46]]), line(&[[0.16, 0.46], [0.0, 0.46]])],
        20,
    );
    for x in [-0.62, 0.0, 0.62] {
        batch.add(&seat, wood, stall.on(x, -0.10, 1.02));
        for leg in 0..3 {
            let (s, c) = (leg as f32 / 3.0 * TAU + 0.4).sin_cos();
            let foot = Vec3::new(0.15 * c, 0.0, 0.15 * s);
            batch.add(&rod(foot, Vec3::new(0.10 * c, 0.43, 0.10 * s), 0.012, 6), iron, stall.on(x, -0.10, 1.02));
        }
    }
}

/// Metres by which things are sunk into what they stand on.
const SMALL: f32 = 0.005;

/// Folded cloth and rolls, scarves that hang from the rail.
fn cloth(market: &mut Market, stall: &Stall, random: &mut Random) {
    let colours = market.paint.cloth;
    let half = 0.5 * stall.width - 0.24;
    let folded = cushion(Vec3::new(0.15, 0.026, 0.19), 0.35, 4, 16);
    for i in 0..6 {
        let x = -half + 2.0 * half * i as f32 / 5.0;
        for layer in 0..random.range(3.0, 7.0) as usize {
            let colour = colours[random.range(0.0, 7.99) as usize];
            let y = COUNTER + 0.026 + 0.050 * layer as f32;
            let at = stall.on(x, y, 0.38) * turn(random.range(-5.0, 5.0));
            market.batch.add(&folded, colour, at);
        }
    }
    let roll = lathe(
        &[line(&[[0.0, 0.0], [0.045, 0.0]]), line(&[[0.045, 0.0], [0.045, 0.62]]), line(&[[0.045, 0.62], [0.0, 0.62]])],
        12,
    );
    for i in 0..16 {
        let x = -half + 2.0 * half * i as f32 / 15.0;
        let colour = colours[random.range(0.0, 7.99) as usize];
        market.batch.add(&roll, colour, stall.on(x, 0.98, -0.46) * tilt(-6.0));
    }
    for i in 0..5 {
        let x = -half + 2.0 * half * i as f32 / 4.0;
        let (width, length) = (0.20, random.range(0.55, 0.8));
        let colour = colours[random.range(0.0, 7.99) as usize];
        let rows: Vec<Vec<Vec3>> = (0..=5)
            .map(|r| {
                let down = r as f32 / 5.0;
                let wave = |c: usize| 0.018 * (c as f32 * 1.9 + 2.0 * down + i as f32).sin() * (0.3 + down);
                (0..=6).map(|c| Vec3::new(width * (c as f32 / 6.0 - 0.5), -length * down, wave(c))).collect()
            })
            .collect();
        market.batch.add(&sheet(&rows), colour, stall.on(x, 2.0, -0.16));
    }
}

/// Vases, bowls and plates.
fn pottery(market: &mut Market, stall: &Stall, random: &mut Random) {
    let glaze = market.paint.glaze;
    let vase = |scale: f32, neck: f32| {
        let p = |r: f32, y: f32| [r * scale, y * scale];
        lathe(
            &[
                line(&[p(0.0, 0.0), p(0.055, 0.0)]),
                curve(
                    &[
                        p(0.055, 0.0),
                        p(0.10, 0.08),
                        p(0.115, 0.17),
                        p(0.06, 0.28),
                        p(neck, 0.34),
                        p(neck + 0.025, 0.39),
                    ],
                    2,
                ),
                curve(&[p(neck + 0.020, 0.39), p(neck - 0.008, 0.33), p(0.0, 0.26)], 1),
            ],
            14,
        )
    };
    let plate = lathe(
        &[
            line(&[[0.05, 0.0], [0.13, 0.018]]),
            line(&[[0.13, 0.020], [0.05, 0.006]]),
            line(&[[0.05, 0.006], [0.0, 0.006]]),
        ],
        16,
    );
    let half = 0.5 * stall.width - 0.2;
    let pick = |random: &mut Random| glaze[random.range(0.0, 5.99) as usize];
    for (z, count) in [(0.02, 8), (0.30, 6), (0.54, 7)] {
        for i in 0..count {
            let x = -half + 2.0 * half * i as f32 / (count - 1) as f32;
            let colour = pick(random);
            let scale = random.range(0.55, 1.0) * (1.15 - z);
            market.batch.add(&vase(scale, random.range(0.025, 0.05)), colour, stall.on(x, COUNTER, z));
        }
    }
    for (y, count) in [(0.98, 8), (1.43, 9), (1.88, 7)] {
        for i in 0..count {
            let x = -half + 2.0 * half * i as f32 / (count - 1) as f32;
            let colour = pick(random);
            if i % 2 == 0 {
                market.batch.add(&plate, colour, stall.on(x, y + 0.13, -0.60) * tilt(78.0));
            } else {
                market.batch.add(&vase(random.range(0.5, 0.8), 0.03), colour, stall.on(x, y, -0.52));
            }
        }
    }
}
