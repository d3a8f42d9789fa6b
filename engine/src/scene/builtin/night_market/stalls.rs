//! Market stalls: posts, a counter, a striped awning, goods, a shelf at the back.
use super::super::foliage::Random;
use super::super::shapes::block;
use super::batch::{rod, sheet, tilt};
use super::goods::{self, Goods};
use super::lamps::Panel;
use super::lettering::{bowl, tea};
use super::neon::{tubes_of, word};
use super::{Market, PAVEMENT, SUNK, Side};
use glam::{Affine3A, Vec2, Vec3};
use std::f32::consts::PI;

/// From the middle of the street to the middle of a stall, metres.
const FROM_MIDDLE: f32 = 3.5;
/// Height of counters, metres.
pub const COUNTER: f32 = 0.86;

/// A stall: a place in the middle of its foot, x along the counter, z to the street.
pub struct Stall {
    pub at: Affine3A,
    pub width: f32,
}

impl Stall {
    pub fn on(&self, x: f32, y: f32, z: f32) -> Affine3A {
        self.at * Affine3A::from_translation(Vec3::new(x, y, z))
    }

    pub fn point(&self, x: f32, y: f32, z: f32) -> Vec3 {
        self.at.transform_point3(Vec3::new(x, y, z))
    }
}

/// Side, place along the street, width, goods, and the two colours of the awning.
const STALLS: [(Side, f32, f32, Goods, [usize; 2]); 17] = [
    (Side::Right, -6.2, 2.4, Goods::Pottery, [2, 3]),
    (Side::Right, -3.2, 2.2, Goods::Tea, [4, 1]),
    (Side::Right, 0.3, 2.5, Goods::Fruit, [0, 1]),
    (Side::Right, 3.4, 2.3, Goods::Dumplings, [2, 3]),
    (Side::Right, 6.6, 2.4, Goods::Cloth, [6, 7]),
    (Side::Right, 9.7, 2.2, Goods::Tea, [5, 0]),
    (Side::Right, 20.5, 2.4, Goods::Fruit, [4, 1]),
    (Side::Right, 24.0, 2.4, Goods::Dumplings, [0, 3]),
    (Side::Right, 28.0, 2.4, Goods::Cloth, [2, 1]),
    (Side::Left, -7.4, 2.4, Goods::Fruit, [6, 1]),
    (Side::Left, -4.2, 2.3, Goods::Cloth, [0, 5]),
    (Side::Left, 4.9, 2.4, Goods::Pottery, [5, 1]),
    (Side::Left, 7.8, 2.3, Goods::Fruit, [2, 3]),
    (Side::Left, 10.8, 2.4, Goods::Dumplings, [0, 1]),
    (Side::Left, 13.9, 2.3, Goods::Tea, [4, 3]),
    (Side::Left, 20.0, 2.4, Goods::Pottery, [6, 7]),
    (Side::Left, 24.0, 2.4, Goods::Cloth, [0, 1]),
];

pub fn stalls(market: &mut Market) {
    let mut random = Random::new(77);
    for (number, (side, s, width, goods, cloth)) in STALLS.into_iter().enumerate() {
        let stall = Stall { at: side.facing(s, FROM_MIDDLE, PAVEMENT - SUNK), width };
        let colours = cloth.map(|i| market.paint.cloth[i]);
        frame(market, &stall, number);
        awning(market, &stall, colours);
        goods::lay_out(market, &stall, goods, &mut random);
        sites(market, &stall, goods, number);
    }
}

/// Posts, rails, counter and shelf.
fn frame(market: &mut Market, stall: &Stall, number: usize) {
    let paint = &market.paint;
    let planks = [paint.wood, paint.pale_wood, paint.dark_wood][number % 3];
    let (dark, iron) = (paint.dark_wood, paint.iron);
    let (w, batch) = (stall.width, &mut market.batch);
    for x in [-0.5 * w, 0.5 * w] {
        batch.add(&block(0.06, 2.62, 0.06, 0.0), dark, stall.on(x, 0.0, -0.62));
        batch.add(&block(0.06, 2.28, 0.06, 0.0), dark, stall.on(x, 0.0, 0.62));
        batch.add(&rod(Vec3::new(x, 2.60, -0.62), Vec3::new(x, 2.10, 1.22), 0.018, 6), iron, stall.at);
    }
    for (y, z) in [(2.60, -0.62), (2.27, 0.62), (2.10, 1.22)] {
        batch.add(&rod(Vec3::new(-0.5 * w, y, z), Vec3::new(0.5 * w, y, z), 0.020, 6), iron, stall.at);
    }
    // The counter: a top, and boards before it.
    batch.add(&block(w - 0.05, 0.05, 0.86, 0.012), planks, stall.on(0.0, COUNTER - 0.05, 0.24));
    for i in 0..5 {
        let y = 0.06 + 0.15 * i as f32;
        batch.add(&block(w - 0.10, 0.135, 0.03, 0.0), planks, stall.on(0.0, y, 0.63));
    }
    for x in [-0.5 * w + 0.05, 0.5 * w - 0.05] {
        batch.add(&block(0.03, 0.78, 0.80, 0.0), planks, stall.on(x, 0.02, 0.22));
    }
    // The shelf at the back.
    batch.add(&block(w - 0.06, 2.0, 0.03, 0.0), dark, stall.on(0.0, 0.1, -0.66));
    for y in [0.95, 1.40, 1.85] {
        batch.add(&block(w - 0.06, 0.03, 0.26, 0.0), planks, stall.on(0.0, y, -0.52));
    }
}

/// A striped cloth that sags a little between its rails, with a scalloped hem.
fn awning(market: &mut Market, stall: &Stall, colours: [u32; 2]) {
    const STRIPES: usize = 10;
    const STEPS: usize = 6;
    let width = stall.width + 0.24;
    let stripe = width / STRIPES as f32;
    // Points from the hem to the back, of a line along the stripe at this share of its width.
    let line = |x: f32, t: f32| {
        let hem = 0.13 + 0.07 * (PI * t).sin();
        let mut line = vec![Vec3::new(x, 2.11 - hem, 1.30), Vec3::new(x, 2.11, 1.29)];
        line.extend((1..=STEPS).map(|i| {
            let along = i as f32 / STEPS as f32;
            let sag = 0.05 * (PI * along).sin() + 0.012 * (PI * t).sin();
            Vec3::new(x, 2.11 + 0.54 * along - sag, 1.29 - 1.98 * along)
        }));
        line
    };
    for i in 0..STRIPES {
        let from = -0.5 * width + stripe * i as f32;
        let lines: Vec<Vec<Vec3>> = (0..=4).map(|k| k as f32 / 4.0).map(|t| line(from + stripe * t, t)).collect();
        let rows: Vec<Vec<Vec3>> = (0..lines[0].len()).map(|r| lines.iter().map(|line| line[r]).collect()).collect();
        market.batch.add(&sheet(&rows), colours[i % 2], stall.at);
    }
}

/// Where lamps may hang, and a few lamps of their own: a lit board, a lamp over the goods.
fn sites(market: &mut Market, stall: &Stall, goods: Goods, number: usize) {
    let half = 0.5 * stall.width;
    let sites = &mut market.sites;
    for side in [-1.0, 1.0] {
        sites.stall_hooks.push(stall.point(side * (half - 0.06), 2.09, 1.18));
    }
    sites.bulbs.push([-half + 0.2, half - 0.2].map(|x| stall.point(x, 2.02, 0.45)).to_vec());
    sites.bulbs.push([-half + 0.15, half - 0.15].map(|x| stall.point(x, 2.06, 1.10)).to_vec());
    // Along the hem, and along the edges of the roof.
    let hem = [-half - 0.1, half + 0.1].map(|x| stall.point(x, 2.13, 1.345));
    sites.strings.push(hem.to_vec());
    for x in [-half - 0.10, half + 0.10] {
        sites.fairy.push(vec![stall.point(x, 2.16, 1.28), stall.point(x, 2.69, -0.66)]);
    }
    for i in 0..8 {
        let x = -half + stall.width * (i as f32 + 0.5) / 8.0;
        sites.fairy.push(vec![stall.point(x, 2.19, 1.28), stall.point(x, 2.70, -0.64)]);
    }
    if [2, 4, 12].contains(&number) {
        sites.spots.push(stall.point(0.35, 1.95, 0.28));
    }
    if [3, 5, 13, 14].contains(&number) {
        let at = stall.at * Affine3A::from_translation(Vec3::new(0.0, 1.81, 1.03)) * tilt(12.0);
        lit_board(market, at, goods);
    }
    let string = rod(Vec3::new(-half, 2.06, 0.45), Vec3::new(half, 2.06, 0.45), 0.006, 4);
    market.batch.add(&string, market.paint.rubber, stall.at);
}

/// A lit board with a picture and a word before it.
fn lit_board(market: &mut Market, at: Affine3A, goods: Goods) {
    const HALF: Vec2 = Vec2::new(0.50, 0.17);
    let case = block(2.0 * HALF.x + 0.05, 2.0 * HALF.y + 0.05, 0.06, 0.008);
    let behind = Affine3A::from_translation(Vec3::new(0.0, -HALF.y - 0.025, -0.036));
    market.batch.add(&case, market.paint.board, at * behind);
    let (picture, text, size) = match goods {
        Goods::Tea => (tea(), "TEA", Vec2::new(0.13, 0.2)),
        _ => (bowl()[0].clone(), "NOODLES", Vec2::new(0.062, 0.17)),
    };
    let mut front = tubes_of(0.009, &picture, Vec2::new(-0.46, -0.125), Vec2::splat(0.25));
    front.join(&word(0.009, text, -0.5 * size.y, size, 0.025), Affine3A::from_translation(Vec3::X * 0.13));
    market.batch.add(&front, market.paint.door, at * Affine3A::from_translation(Vec3::Z * -0.03));
    market.sites.panels.push(Panel { at, half: HALF, glow: Vec3::new(2.9, 2.3, 1.5) });
}
