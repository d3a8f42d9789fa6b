//! House fronts: walls with windows, some of them lit, ledges, shutters, doors, balconies, pipes.
use super::super::foliage::Random;
use super::super::shapes::{Shape, block, lathe, line};
use super::batch::{hanging, pipe, rod};
use super::palette::PANE;
use super::{BEGIN, END, FRONT, Market, Side, point};
use glam::{Affine3A, Mat3, Vec3};

/// Height of the ground floor and of each floor above, metres.
const GROUND_FLOOR: f32 = 3.15;
const FLOOR: f32 = 2.75;

/// A house: a place in the middle of the foot of its front, x along the front to the right, z to the street.
struct House {
    at: Affine3A,
    width: f32,
    floors: u32,
    wall: u32,
}

impl House {
    fn height(&self) -> f32 {
        GROUND_FLOOR + FLOOR * self.floors as f32 + 0.35
    }

    fn on(&self, x: f32, y: f32, z: f32) -> Affine3A {
        self.at * Affine3A::from_translation(Vec3::new(x, y, z))
    }

    fn point(&self, x: f32, y: f32, z: f32) -> Vec3 {
        self.at.transform_point3(Vec3::new(x, y, z))
    }
}

/// A house between two points of the line of fronts, the left one first as seen from the street.
fn between(left: Vec3, right: Vec3, floors: u32, wall: u32) -> House {
    let across = (right - left).normalize();
    let axes = Mat3::from_cols(across, Vec3::Y, across.cross(Vec3::Y));
    let at = Affine3A::from_mat3_translation(axes, 0.5 * (left + right));
    House { at, width: left.distance(right), floors, wall }
}

pub fn houses(market: &mut Market) {
    let walls = market.paint.walls;
    for side in Side::BOTH {
        let mut random = Random::new(if side == Side::Left { 211 } else { 219 });
        let mut s = BEGIN;
        let mut number = if side == Side::Left { 0 } else { 3 };
        while s < END - 1.0 {
            let width = random.range(4.4, 6.2);
            let front = |s: f32| point(s, side.sign() * FRONT, 0.0);
            let (near, far) = (front(s), front(s + width));
            let [left, right] = if side == Side::Left { [near, far] } else { [far, near] };
            let floors = [2, 1, 3, 2, 2, 3, 1][number % 7];
            let house = between(left, right, floors, walls[number % walls.len()]);
            build(market, &house, &mut random);
            s += width;
            number += 1;
        }
    }
}

fn build(market: &mut Market, house: &House, random: &mut Random) {
    let (width, height) = (house.width, house.height());
    let paint = &market.paint;
    let (trim, frame, iron) = (paint.trim, paint.frame, paint.iron);
    let batch = &mut market.batch;
    batch.add(&block(width - 0.01, height, 3.0, 0.0), house.wall, house.on(0.0, -0.05, -1.5));
    // A ledge above the ground floor, quoins, and a cornice.
    batch.add(&block(width + 0.04, 0.16, 0.16, 0.02), trim, house.on(0.0, GROUND_FLOOR - 0.08, 0.06));
    batch.add(&block(width + 0.10, 0.22, 0.44, 0.03), trim, house.on(0.0, height - 0.25, 0.10));
    batch.add(&block(width + 0.04, 0.10, 0.30, 0.02), trim, house.on(0.0, height - 0.42, 0.06));
    for x in [-0.5 * width + 0.16, 0.5 * width - 0.16] {
        batch.add(&block(0.26, height - 0.4, 0.07, 0.015), trim, house.on(x, 0.0, 0.02));
    }
    // A pipe down the front.
    let x = 0.5 * width - 0.42;
    batch.add(&rod(Vec3::Y * 0.2, Vec3::Y * (height - 0.4), 0.05, 8), iron, house.on(x, 0.0, 0.10));
    for y in [1.1, 3.4, 5.6] {
        batch.add(&block(0.15, 0.05, 0.12, 0.0), iron, house.on(x, y, 0.08));
    }
    ground_floor(market, house, random);
    let count = ((width - 0.9) / 1.45).floor().max(1.0) as u32;
    let span = (width - 0.7) / count as f32;
    for floor in 0..house.floors {
        let sill = GROUND_FLOOR + FLOOR * floor as f32 + 0.72;
        let has_balcony = random.range(0.0, 1.0) < 0.25;
        for i in 0..count {
            let x = span * (i as f32 + 0.5) - 0.5 * span * count as f32;
            window(market, house, [x, sill], random);
            if !has_balcony && random.range(0.0, 1.0) < 0.20 {
                air_conditioner(market, house, [x, sill - 0.62]);
            }
        }
        if has_balcony {
            balcony(market, house, sill - 0.72, frame);
        }
    }
    wires(market, house, random);
    sites(market, house, random);
}

/// A window with its frame and sill; some are lit.
fn window(market: &mut Market, house: &House, [x, sill]: [f32; 2], random: &mut Random) {
    let paint = &market.paint;
    let chance = random.range(0.0, 1.0);
    let pane = match chance {
        c if c < 0.25 => paint.lit[0],
        c if c < 0.42 => paint.lit[1],
        c if c < 0.50 => paint.lit[2],
        _ => paint.glass,
    };
    let (w, h) = (0.5 * PANE.x, PANE.y);
    let mut glass = Shape::default();
    // The texture of the pane begins at its upper left corner.
    glass.quad([[-w, 0.0], [w, 0.0], [w, h], [-w, h]].map(|[x, y]| Vec3::new(x, y, 0.0)));
    for uv in &mut glass.mesh.uv0 {
        uv.y += h;
    }
    let batch = &mut market.batch;
    batch.add(&glass, pane, house.on(x, sill, 0.02));
    let mut frame = Shape::default();
    let at = |x: f32, y: f32| Affine3A::from_translation(Vec3::new(x, y, 0.0));
    for side in [-1.0, 1.0] {
        frame.join(&block(0.07, h + 0.12, 0.10, 0.0), at(side * (w + 0.02), -0.06));
    }
    frame.join(&block(2.0 * w, 0.07, 0.10, 0.0), at(0.0, h - 0.02));
    frame.join(&block(2.0 * w, 0.05, 0.06, 0.0), at(0.0, 0.64 * h));
    frame.join(&block(0.045, h, 0.06, 0.0), at(0.0, 0.0));
    batch.add(&frame, paint.frame, house.on(x, sill, 0.04));
    batch.add(&block(2.0 * w + 0.26, 0.08, 0.24, 0.015), paint.trim, house.on(x, sill - 0.10, 0.08));
    batch.add(&block(2.0 * w + 0.22, 0.12, 0.12, 0.015), paint.trim, house.on(x, sill + h + 0.05, 0.05));
}

/// A box with a grille and a fan.
fn air_conditioner(market: &mut Market, house: &House, [x, y]: [f32; 2]) {
    let paint = &market.paint;
    let mut fan = Shape::default();
    for r in [0.09, 0.18] {
        let ring: Vec<Vec3> = (0..=14)
            .map(|i| (i as f32 / 14.0 * std::f32::consts::TAU).sin_cos())
            .map(|(s, c)| Vec3::new(r * c, r * s, 0.0))
            .collect();
        fan.join(&pipe(&ring, 0.006, 3), Affine3A::IDENTITY);
    }
    market.batch.add(&block(0.74, 0.50, 0.28, 0.02), paint.white, house.on(x, y, 0.20));
    market.batch.add(&fan, paint.iron, house.on(x - 0.12, y + 0.25, 0.345));
}

/// A slab with a railing along the whole front.
fn balcony(market: &mut Market, house: &House, y: f32, railing: u32) {
    let width = house.width - 0.5;
    market.batch.add(&block(width, 0.10, 0.74, 0.02), market.paint.trim, house.on(0.0, y, 0.37));
    let mut bars = Shape::default();
    let count = (width / 0.16) as usize;
    for i in 0..=count {
        let x = (i as f32 / count as f32 - 0.5) * (width - 0.1);
        bars.join(&rod(Vec3::new(x, 0.1, 0.68), Vec3::new(x, 0.92, 0.68), 0.011, 4), Affine3A::IDENTITY);
    }
    for y in [0.16, 0.92] {
        let end = 0.5 * width - 0.05;
        bars.join(&rod(Vec3::new(-end, y, 0.68), Vec3::new(end, y, 0.68), 0.020, 6), Affine3A::IDENTITY);
    }
    market.batch.add(&bars, railing, house.on(0.0, y, 0.0));
}

/// Roller shutters, a door, or a shop window with light behind it.
fn ground_floor(market: &mut Market, house: &House, random: &mut Random) {
    let paint = &market.paint;
    let shutter = paint.shutters[(random.range(0.0, 2.99)) as usize];
    let door_x = if random.range(0.0, 1.0) < 0.5 { -0.5 * house.width + 0.95 } else { 0.5 * house.width - 1.15 };
    let (door, frame, trim) = (paint.door, paint.frame, paint.trim);
    let batch = &mut market.batch;
    batch.add(&block(1.06, 2.34, 0.10, 0.01), trim, house.on(door_x, 0.05, 0.02));
    batch.add(&block(0.86, 2.20, 0.10, 0.01), door, house.on(door_x, 0.07, 0.05));
    for y in [0.30, 1.20] {
        batch.add(&block(0.62, 0.72, 0.03, 0.012), door, house.on(door_x, y, 0.10));
    }
    let width = house.width - 2.3;
    let middle = if door_x < 0.0 { 0.55 } else { -0.55 };
    if random.range(0.0, 1.0) < 0.55 {
        let mut ribs = Shape::default();
        for i in 0..24 {
            ribs.join(&block(width, 0.094, 0.05, 0.0), Affine3A::from_translation(Vec3::Y * (0.1 * i as f32)));
        }
        batch.add(&ribs, shutter, house.on(middle, 0.10, 0.03));
        batch.add(&block(width + 0.1, 0.26, 0.22, 0.02), shutter, house.on(middle, 2.48, 0.10));
    } else {
        // Panes as wide as those of windows show one room after another.
        let count = (width / PANE.x).floor().max(1.0) as u32;
        for i in 0..count {
            let x = middle + (i as f32 + 0.5 - 0.5 * count as f32) * PANE.x;
            let mut glass = Shape::default();
            let (w, h) = (0.5 * PANE.x - 0.03, PANE.y);
            glass.quad([[-w, 0.0], [w, 0.0], [w, h], [-w, h]].map(|[x, y]| Vec3::new(x, y, 0.0)));
            glass.mesh.uv0.iter_mut().for_each(|uv| uv.y += h);
            batch.add(&glass, paint.lit[1], house.on(x, 0.95, 0.03));
            batch.add(&block(0.06, 1.42, 0.08, 0.01), frame, house.on(x + 0.5 * PANE.x, 0.92, 0.04));
        }
        let span = count as f32 * PANE.x;
        batch.add(&block(span + 0.2, 0.10, 0.14, 0.015), frame, house.on(middle, 2.29, 0.05));
        batch.add(&block(span + 0.2, 0.85, 0.08, 0.015), shutter, house.on(middle, 0.08, 0.02));
    }
}

/// Cables along the front.
fn wires(market: &mut Market, house: &House, random: &mut Random) {
    let rubber = market.paint.rubber;
    for _ in 0..2 {
        let y = GROUND_FLOOR + random.range(0.12, 0.5);
        let half = 0.5 * house.width;
        let line = hanging(Vec3::new(-half, y, 0.07), Vec3::new(half, y + random.range(-0.2, 0.2), 0.07), 0.10, 6);
        market.batch.add(&pipe(&line, 0.012, 4), rubber, house.at);
    }
}

/// Where lamps may hang: a lantern on either side, and fairy lights down the front and along ledges.
fn sites(market: &mut Market, house: &House, random: &mut Random) {
    let half = 0.5 * house.width;
    let iron = market.paint.iron;
    for x in [-half + 0.55, half - 0.75] {
        let (wall, tip) = (Vec3::new(x, 2.86, 0.02), Vec3::new(x, 2.90, 0.52));
        market.batch.add(&rod(wall, tip, 0.014, 5), iron, house.at);
        market.sites.house_hooks.push(house.at.transform_point3(tip));
    }
    let top = house.height() - 0.5;
    // Strands beside the windows, over the whole height, and three along ledges.
    let count = (house.width / 0.42) as usize;
    for i in 0..=count {
        let x = -half + 0.28 + (house.width - 0.56) * i as f32 / count as f32;
        let low = GROUND_FLOOR - random.range(0.05, 0.75);
        market.sites.fairy.push([top, low].map(|y| house.point(x, y, 0.19)).to_vec());
    }
    market.sites.ledges.push([-half + 0.15, half - 0.15].map(|x| house.point(x, GROUND_FLOOR + 0.02, 0.17)));
    for (y, z) in [(GROUND_FLOOR + 0.12, 0.20), (top + 0.10, 0.30), (top - 0.06, 0.25)] {
        market.sites.fairy.push([-half + 0.1, half - 0.1].map(|x| house.point(x, y, z)).to_vec());
    }
    // A water tank or a chimney on the roof.
    let tank = lathe(&[line(&[[0.55, 0.0], [0.55, 1.0]]), line(&[[0.55, 1.0], [0.0, 1.18]])], 20);
    let (x, back) = (random.range(-1.0, 1.0), -1.4);
    if random.range(0.0, 1.0) < 0.5 {
        market.batch.add(&tank, market.paint.steel, house.on(x, house.height() - 0.06, back));
    } else {
        market.batch.add(&block(0.6, 1.1, 0.6, 0.02), house.wall, house.on(x, house.height() - 0.06, back));
    }
}
