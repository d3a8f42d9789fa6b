//! Signs: words and pictures of glowing tubes on boards that stand out from the fronts, and a gate across the street.
use super::super::shapes::{Shape, block, lathe, line};
use super::super::stage::dielectric;
use super::batch::{pipe, rod};
use super::lettering::{Stroke, arrow, bowl, letter, magpie, market as market_sign, night, ring, tea, without_corners};
use super::{FRONT, KERB, Market, PAVEMENT, SUNK, Side, along, turn};
use crate::scene::Material;
use glam::{Affine3A, Vec2, Vec3};

/// Radius of a tube and its distance from the board, metres.
const TUBE: f32 = 0.017;
const BEFORE: f32 = 0.055;

/// Colours of the tubes.
struct Colours {
    cyan: u32,
    magenta: u32,
    blue: u32,
    green: u32,
    amber: u32,
    white: u32,
}

fn colours(market: &mut Market) -> Colours {
    let mut neon = |name: &str, glow: [f32; 3]| {
        let glass = dielectric(name, [0.05; 3], 0.15);
        market.stage.material(Material { emission: Vec3::from(glow), ..glass })
    };
    Colours {
        cyan: neon("cyan neon", [1.2, 15.0, 17.0]),
        magenta: neon("magenta neon", [21.0, 1.5, 10.5]),
        blue: neon("blue neon", [2.4, 5.0, 27.0]),
        green: neon("green neon", [2.2, 15.0, 4.2]),
        amber: neon("amber neon", [21.0, 7.4, 0.9]),
        white: neon("white neon", [10.0, 11.5, 14.0]),
    }
}

/// Neon along strokes; the unit box of the strokes is `size` wide and high, and begins at `at` on the board.
fn tubes(strokes: &[Stroke], at: Vec2, size: Vec2) -> Shape {
    tubes_of(TUBE, strokes, at, size)
}

/// Tubes of another radius.
pub fn tubes_of(radius: f32, strokes: &[Stroke], at: Vec2, size: Vec2) -> Shape {
    let mut shape = Shape::default();
    for part in strokes.iter().flat_map(|line| without_corners(line)) {
        let points: Vec<Vec3> = part.iter().map(|p| (at + *p * size).extend(BEFORE)).collect();
        shape.join(&pipe(&points, radius, 6), Affine3A::IDENTITY);
    }
    shape
}

/// A row of letters of such tubes around the middle of the board.
pub fn word(radius: f32, text: &str, y: f32, size: Vec2, gap: f32) -> Shape {
    let mut shape = Shape::default();
    let count = text.chars().count() as f32;
    for (i, c) in text.chars().enumerate() {
        let x = (i as f32 - 0.5 * count) * (size.x + gap) + 0.5 * gap;
        shape.join(&tubes_of(radius, &letter(c), Vec2::new(x, y), size), Affine3A::IDENTITY);
    }
    shape
}

/// A column of letters, from this height down.
fn column(text: &str, top: f32, size: Vec2, gap: f32) -> Shape {
    let mut shape = Shape::default();
    for (i, c) in text.chars().enumerate() {
        let y = top - (i as f32 + 1.0) * size.y - i as f32 * gap;
        shape.join(&tubes(&letter(c), Vec2::new(-0.5 * size.x, y), size), Affine3A::IDENTITY);
    }
    shape
}

/// Puts tubes on both faces of a board.
fn on_both_faces(market: &mut Market, tubes: &Shape, colour: u32, at: Affine3A) {
    market.batch.add(tubes, colour, at * Affine3A::from_translation(Vec3::Z * 0.05));
    market.batch.add(tubes, colour, at * turn(180.0) * Affine3A::from_translation(Vec3::Z * 0.05));
}

/// A board that stands out from a front on two arms, and its middle: x to the right and z to who comes along the street.
fn board(market: &mut Market, side: Side, s: f32, up: f32, size: Vec2) -> Affine3A {
    let across = side.sign() * (FRONT - 0.22 - 0.5 * size.x);
    let at = along(s, across, up);
    let centred = Affine3A::from_translation(Vec3::new(0.0, -0.5 * size.y, 0.0));
    market.batch.add(&block(size.x, size.y, 0.10, 0.02), market.paint.board, at * centred);
    for y in [-0.36, 0.36] {
        let out = side.sign() * 0.5 * size.x;
        let (from, to) = (Vec3::new(out, y * size.y, 0.0), Vec3::new(out + side.sign() * 0.26, y * size.y, 0.0));
        market.batch.add(&rod(from, to, 0.025, 6), market.paint.iron, at);
    }
    at
}

/// A frame of tubes along the edge of a board.
fn border(size: Vec2) -> Shape {
    let half = 0.5 * size - 0.05;
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]];
    let line: Stroke = corners.iter().map(|c| Vec2::from(*c) * half).collect();
    tubes(&[line], Vec2::ZERO, Vec2::ONE)
}

pub fn signs(market: &mut Market) {
    let c = colours(market);
    // To the left: noodles with a bowl, tea in a ring.
    let size = Vec2::new(1.25, 1.95);
    let at = board(market, Side::Left, 6.4, 4.35, size);
    let [dish, steam] = bowl();
    on_both_faces(market, &border(size), c.blue, at);
    on_both_faces(market, &tubes(&dish, Vec2::new(-0.40, -0.10), Vec2::new(0.80, 0.85)), c.amber, at);
    on_both_faces(market, &tubes(&steam, Vec2::new(-0.34, -0.12), Vec2::new(0.80, 0.92)), c.cyan, at);
    on_both_faces(market, &word(TUBE, "NOODLES", -0.62, Vec2::new(0.105, 0.26), 0.035), c.magenta, at);

    let size = Vec2::new(1.0, 1.0);
    let at = board(market, Side::Left, 12.6, 4.0, size);
    on_both_faces(market, &tubes(&ring(), Vec2::splat(-0.42), Vec2::splat(0.84)), c.green, at);
    on_both_faces(market, &tubes(&tea(), Vec2::splat(-0.24), Vec2::splat(0.48)), c.white, at);

    // To the right: the magpie, a hotel, an arrow down to a bar.
    let size = Vec2::new(1.45, 1.35);
    let at = board(market, Side::Right, 5.2, 3.95, size);
    let [bird, wing] = magpie();
    on_both_faces(market, &tubes(&bird, Vec2::new(-0.58, -0.50), Vec2::new(1.16, 1.06)), c.cyan, at);
    on_both_faces(market, &tubes(&wing, Vec2::new(-0.58, -0.50), Vec2::new(1.16, 1.06)), c.magenta, at);

    let size = Vec2::new(0.62, 2.5);
    let at = board(market, Side::Right, 10.4, 4.9, size);
    on_both_faces(market, &column("HOTEL", 1.10, Vec2::new(0.30, 0.36), 0.085), c.blue, at);
    on_both_faces(market, &border(size), c.magenta, at);

    let size = Vec2::new(0.9, 0.9);
    let at = board(market, Side::Right, 24.5, 4.2, size);
    on_both_faces(market, &tubes(&arrow(), Vec2::splat(-0.32), Vec2::splat(0.64)), c.green, at);
    let size = Vec2::new(0.70, 1.5);
    let at = board(market, Side::Left, 25.0, 4.3, size);
    on_both_faces(market, &column("TEA", 0.65, Vec2::new(0.34, 0.36), 0.10), c.magenta, at);

    ledges(market, &c);
    gate(market, &c);
}

/// Tubes along the ledges of a few houses.
fn ledges(market: &mut Market, c: &Colours) {
    let colours = [(2, c.cyan), (4, c.magenta), (12, c.blue), (14, c.magenta), (15, c.cyan)];
    for (house, colour) in colours {
        let Some([a, b]) = market.sites.ledges.get(house).copied() else { continue };
        market.batch.add_placed(&rod(a, b, 1.2 * TUBE, 6), colour, a.lerp(b, 0.5));
    }
}

/// A gate over the street, with the name of the market.
fn gate(market: &mut Market, c: &Colours) {
    const S: f32 = 12.35;
    /// Heights of the beam below the board, of the board's middle, and of the beam above, metres.
    const LOW: f32 = 3.42;
    const MIDDLE: f32 = 4.27;
    const HIGH: f32 = 4.92;
    let paint = &market.paint;
    let (red, granite, brass) = (paint.red, paint.granite, paint.brass);
    let (board_paint, half) = (paint.board, KERB + 0.36);
    let at = along(S, 0.0, 0.0);
    let on = |x: f32, y: f32, z: f32| at * Affine3A::from_translation(Vec3::new(x, y, z));
    let column = lathe(&[line(&[[0.17, 0.0], [0.155, HIGH]]), line(&[[0.155, HIGH], [0.0, HIGH]])], 20);
    let band = lathe(&[line(&[[0.180, 0.0], [0.180, 0.07]])], 20);
    let batch = &mut market.batch;
    for side in [-1.0, 1.0] {
        batch.add(&column, red, on(side * half, PAVEMENT - SUNK, 0.0));
        batch.add(&block(0.50, 0.42, 0.50, 0.03), granite, on(side * half, PAVEMENT - SUNK, 0.0));
        for y in [0.55, LOW - 0.2] {
            batch.add(&band, brass, on(side * half, y, 0.0));
        }
    }
    batch.add(&block(2.0 * half + 1.2, 0.22, 0.26, 0.02), red, on(0.0, LOW, 0.0));
    batch.add(&block(2.0 * half + 0.8, 0.20, 0.24, 0.02), red, on(0.0, HIGH, 0.0));
    batch.add(&block(3.3, HIGH - LOW - 0.24, 0.12, 0.02), board_paint, on(0.0, LOW + 0.23, 0.0));
    roof(market, at, [5.12, half + 0.85, 0.66]);
    let batch = &mut market.batch;
    // The sign on both faces, between bars.
    let size = Vec2::splat(0.98);
    for face in [0.0, 180.0] {
        let face = at * turn(face) * Affine3A::from_translation(Vec3::new(0.0, MIDDLE, 0.06));
        batch.add(&tubes(&night(), Vec2::new(-1.12, -0.49), size), c.magenta, face);
        batch.add(&tubes(&market_sign(), Vec2::new(0.14, -0.49), size), c.cyan, face);
        let bars = [-1.5, -1.4, 1.4, 1.5].map(|x| vec![Vec2::new(x, -0.52), Vec2::new(x, 0.52)]);
        batch.add(&tubes(&bars, Vec2::ZERO, Vec2::ONE), c.amber, face);
    }
    for x in [-1.0, -0.36, 0.36, 1.0] {
        market.sites.gate_hooks.push(at.transform_point3(Vec3::new(x * (half - 0.45), LOW, 0.20)));
    }
    for y in [LOW + 0.26, LOW - 0.03, HIGH + 0.24] {
        let end = |x: f32| at.transform_point3(Vec3::new(x, y, 0.20));
        market.sites.fairy.push(vec![end(-half), end(half)]);
    }
}

/// A roof of round tiles over the gate, whose ends rise: height of its eaves, half its width, half its depth.
fn roof(market: &mut Market, at: Affine3A, [eaves, reach, depth]: [f32; 3]) {
    const RIDGE: f32 = 0.42;
    let rise = |x: f32| 0.38 * (x.abs() / reach).powi(4);
    let mut slope = Shape::default();
    let count = (2.0 * reach / 0.2) as usize;
    for i in 0..=count {
        let x = (i as f32 / count as f32 * 2.0 - 1.0) * reach;
        for z in [-depth, depth] {
            let (top, eave) = (Vec3::new(x, eaves + rise(x) + RIDGE, 0.0), Vec3::new(x, eaves + rise(x), z));
            slope.join(&rod(top, eave, 0.108, 6), Affine3A::IDENTITY);
        }
    }
    market.batch.add(&slope, market.paint.tiles, at);
    let ridge: Vec<Vec3> = (0..=20)
        .map(|i| (i as f32 / 10.0 - 1.0) * reach)
        .map(|x| Vec3::new(x, eaves + rise(x) + RIDGE + 0.08, 0.0))
        .collect();
    market.batch.add(&pipe(&ridge, 0.11, 8), market.paint.dark_wood, at);
}
