//! The lamps: how many of each kind there are, how strong they are, and where they hang.
//!
//! First come lanterns, then the bulbs of stalls, then strings of lamps over the street, then fairy lights on fronts, awnings and trees. All
//! together are always as strong, so that the picture keeps its exposure.
use super::super::foliage::Random;
use super::super::shapes::{Shape, curve, lathe, line};
use super::super::stage::dielectric;
use super::batch::{hanging, hung, pipe, rod};
use super::moving::{self, Swing};
use super::{BEGIN, FRONT, Market, point};
use crate::scene::{Light, Material};
use glam::{Affine3A, Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// Flux of all lamps together, the mean of its three channels: radiance times pi times area.
pub const FLUX: f32 = 950.0;
/// Size of the ball that shows a lamp, over the lamp's own: it must not hide the lamp.
pub const SHOWN: f32 = 0.98;
/// From this number on there are lamps of other shapes, and things that drive and fly.
const MANY: u32 = 100;
/// Intensity of a spot lamp on its axis, and the angles where its light begins to fade and ends, degrees.
const SPOT: Vec3 = Vec3::new(1.9, 1.6, 1.2);
const SPOT_ANGLES: [f32; 2] = [20.0, 44.0];

/// A lit board: its middle, from where z points the way it shines, half its edges, and its radiance.
pub struct Panel {
    pub at: Affine3A,
    pub half: Vec2,
    pub glow: Vec3,
}

/// Where lamps may hang.
#[derive(Default)]
pub struct Sites {
    /// Points that lanterns hang from: on cables over the street by rounds, at the gate, at stalls and at houses.
    pub cable_hooks: Vec<Vec3>,
    pub gate_hooks: Vec<Vec3>,
    pub stall_hooks: Vec<Vec3>,
    pub house_hooks: Vec<Vec3>,
    /// Lines along which lamps hang.
    pub bulbs: Vec<Vec<Vec3>>,
    pub strings: Vec<Vec<Vec3>>,
    pub fairy: Vec<Vec<Vec3>>,
    /// Lit boards and spot lamps.
    pub panels: Vec<Panel>,
    pub spots: Vec<Vec3>,
    /// Ledges of the houses, from end to end, for neon.
    pub ledges: Vec<[Vec3; 2]>,
}

/// How many lamps of each kind there are.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Counts {
    lanterns: u32,
    /// On what drives.
    cart: u32,
    bulbs: u32,
    strings: u32,
    fairy: u32,
    /// Whether there are lit boards, spot lamps and a drone.
    others: bool,
}

/// Divides `lights` among the kinds, with no more lanterns than hooks. `others`: how many there are of other shapes.
fn counts(lights: u32, hooks: u32, others: u32) -> Counts {
    let decades = (lights as f32 / 10.0).log10().max(0.0);
    let is_many = lights >= MANY;
    let mut left = if is_many { lights - others } else { lights };
    let mut take = |wanted: f32, most: u32| {
        let taken = (wanted.round() as u32).min(most).min(left);
        left -= taken;
        taken
    };
    let lanterns = take(10.0 + 45.0 * decades, hooks);
    let cart = if is_many { take(4.0 + lights as f32 / 50.0, 2_000) } else { 0 };
    let bulbs = take(40.0 * decades * decades, 700);
    let strings = take(40.0 * (lights as f32).powf(0.42), u32::MAX);
    Counts { lanterns, cart, bulbs, strings, fairy: left, others: is_many }
}

/// Lamps of one kind, all of the same strength and size.
#[derive(Clone, Copy)]
pub struct Kind {
    pub count: u32,
    pub radius: f32,
    /// Mean of the channels of its radiance.
    pub radiance: f32,
}

impl Kind {
    /// `count` spheres that have this flux together: as large as makes them shine with `radiance`, between two radii.
    fn new(count: u32, flux: f32, radiance: f32, [least, most]: [f32; 2]) -> Self {
        let area = flux / (PI * 4.0 * PI) / count.max(1) as f32;
        let radius = (area / radiance).sqrt().clamp(least, most);
        Self { count, radius, radiance: area / (radius * radius) }
    }

    /// Radiance in a colour whose channels have the mean 1.
    pub fn glow(&self, hue: [f32; 3]) -> Vec3 {
        let hue = Vec3::from(hue);
        hue * (self.radiance * 3.0 / hue.element_sum())
    }
}

const LANTERN_HUES: [(&str, [f32; 3]); 3] = [
    ("red lanterns", [1.0, 0.045, 0.008]),
    ("orange lanterns", [1.0, 0.19, 0.02]),
    ("amber lanterns", [1.0, 0.40, 0.07]),
];
const BULB_HUES: [(&str, [f32; 3]); 2] = [("bulbs", [1.0, 0.70, 0.36]), ("pale bulbs", [1.0, 0.82, 0.56])];
const STRING_HUES: [(&str, [f32; 3]); 4] = [
    ("warm string lights", [1.0, 0.66, 0.30]),
    ("pale string lights", [1.0, 0.80, 0.52]),
    ("rose string lights", [1.0, 0.36, 0.46]),
    ("icy string lights", [0.46, 0.74, 1.0]),
];
const FAIRY_HUES: [(&str, [f32; 3]); 4] = [
    ("warm fairy lights", [1.0, 0.62, 0.26]),
    ("icy fairy lights", [0.42, 0.68, 1.0]),
    ("violet fairy lights", [0.72, 0.36, 1.0]),
    ("green fairy lights", [0.34, 1.0, 0.52]),
];

/// A material that shows a lamp to the camera.
pub fn shown(name: &str, glow: Vec3) -> Material {
    Material { emission: glow, shows_light: true, ..dielectric(name, [0.6, 0.5, 0.4], 0.4) }
}

/// A kind with one material per hue.
fn materials<const N: usize>(market: &mut Market, kind: &Kind, hues: [(&str, [f32; 3]); N]) -> [u32; N] {
    hues.map(|(name, hue)| market.stage.material(shown(name, kind.glow(hue))))
}

/// Cables over the street, with hooks for lanterns, and strings that zigzag between them.
pub fn cables(market: &mut Market) {
    const CABLES: usize = 16;
    /// Cables before the gate; none hangs right before its sign.
    const BEFORE: usize = 6;
    let rubber = market.paint.rubber;
    let mut random = Random::new(404);
    let spans: Vec<[Vec3; 2]> = (0..CABLES)
        .map(|i| {
            let s = if i < BEFORE { -7.4 + 2.9 * i as f32 } else { 13.9 + 2.9 * (i - BEFORE) as f32 };
            let mut end = |across: f32| point(s + random.range(-0.7, 0.7), across, random.range(4.9, 5.7));
            [end(-FRONT + 0.04), end(FRONT - 0.04)]
        })
        .collect();
    for [a, b] in &spans {
        market.batch.add_placed(&pipe(&hanging(*a, *b, 0.55, 14), 0.007, 4), rubber, a.lerp(*b, 0.5));
    }
    // A round at a time, over the whole street: few lanterns are spread as well as many.
    for place in [0.5, 0.30, 0.70, 0.14, 0.86] {
        for k in 0..CABLES {
            // In an order that spreads them from the first few on.
            let i = (5 * k + 4) % CABLES;
            let [a, b] = spans[i];
            market.sites.cable_hooks.push(hung(a, b, 0.55, place + random.range(-0.03, 0.03)));
        }
    }
    let mut before = None;
    for i in 0..22 {
        let s = BEGIN + 1.2 + 2.2 * i as f32;
        let across = if i % 2 == 0 { -FRONT + 0.06 } else { FRONT - 0.06 };
        let anchor = point(s, across, 3.75 + random.range(-0.15, 0.25));
        if let Some(before) = before {
            let line = hanging(before, anchor, 0.42, 16);
            market.batch.add_placed(&pipe(&line, 0.006, 4), rubber, line[8]);
            market.sites.strings.push(line.iter().map(|p| *p - Vec3::Y * 0.035).collect());
        }
        before = Some(anchor);
    }
}

/// Makes the lamps.
pub fn lamps(market: &mut Market, lights: u32) {
    let sites = std::mem::take(&mut market.sites);
    let hooks = lantern_hooks(&sites);
    let others = sites.panels.len() + sites.spots.len() + moving::DRONE_LAMPS;
    let counts = counts(lights, hooks.len() as u32, others as u32);
    let mut flux = FLUX;
    if counts.others {
        flux -= sites.panels.iter().map(panel_flux).sum::<f32>()
            + sites.spots.len() as f32 * spot_flux()
            + moving::drone_flux();
    }
    // A kind comes in by degrees as its lamps become many.
    let weight = |full: f32, count: u32, half: f32| full * count as f32 / (count as f32 + half);
    let weights = [
        0.42,
        weight(0.03, counts.cart, 10.0),
        weight(0.24, counts.bulbs, 20.0),
        weight(0.17, counts.strings, 150.0),
        weight(0.12, counts.fairy, 900.0),
    ];
    let whole: f32 = weights.iter().sum();
    let share = |kind: usize| flux * weights[kind] / whole;
    let lanterns = Kind::new(counts.lanterns, share(0), 1.7, [0.17, 0.34]);
    let cart = Kind::new(counts.cart, share(1), 12.0, [0.006, 0.03]);
    let bulbs = Kind::new(counts.bulbs, share(2), 24.0, [0.025, 0.055]);
    let strings = Kind::new(counts.strings, share(3), 15.0, [0.010, 0.030]);
    let fairy = Kind::new(counts.fairy, share(4), 7.0, [0.004, 0.014]);

    moving::animation(market);
    if counts.others {
        moving::drone(market);
        moving::cart(market, &cart);
    }
    hang_lanterns(market, &lanterns, &hooks);
    scatter(market, &bulbs, BULB_HUES, &sites.bulbs, |_, lamp| usize::from(lamp % 5 == 3));
    scatter(market, &strings, STRING_HUES, &sites.strings, |line, lamp| match line % 7 {
        2 => 2,
        5 => 3,
        _ => lamp % 2,
    });
    scatter(market, &fairy, FAIRY_HUES, &sites.fairy, |line, _| [0, 0, 1, 0, 0, 2, 1, 0, 3][line / 14 % 9]);
    if counts.others {
        sites.panels.iter().for_each(|board| panel(market, board));
        sites.spots.iter().for_each(|at| spot(market, *at));
    }
}

/// What lanterns hang from, the most important first, and whether they may swing there.
fn lantern_hooks(sites: &Sites) -> Vec<(Vec3, bool)> {
    let cables = |range: std::ops::Range<usize>| sites.cable_hooks[range].iter().map(|p| (*p, true));
    let fixed = |hooks: &[Vec3]| hooks.iter().map(|p| (*p, false)).collect::<Vec<_>>();
    let mut hooks: Vec<_> = cables(0..16).collect();
    hooks.extend(fixed(&sites.gate_hooks));
    hooks.extend(cables(16..48));
    // Every second of the stalls' hooks, then the others, then those at the houses.
    let [even, odd] = [0, 1].map(|k| sites.stall_hooks.iter().skip(k).step_by(2).copied().collect::<Vec<_>>());
    hooks.extend(fixed(&even));
    hooks.extend(cables(48..80));
    hooks.extend(fixed(&odd));
    hooks.extend(fixed(&sites.house_hooks));
    hooks
}

/// Adds a lamp that stands still.
fn lamp(market: &mut Market, centre: Vec3, kind: &Kind, hue: [f32; 3], material: u32) {
    let radius = kind.radius;
    market.batch.ball(centre, radius * SHOWN, material);
    market.stage.scene.lights.push(Light::Sphere { centre: centre.into(), radius, radiance: kind.glow(hue) });
}

/// Most lanterns that swing.
const MOST_SWINGING: usize = 24;

/// Lanterns on their hooks: those that swing first, since lights that move come first in the scene.
fn hang_lanterns(market: &mut Market, kind: &Kind, hooks: &[(Vec3, bool)]) {
    let paint = materials(market, kind, LANTERN_HUES);
    let hue = |i: usize| [0, 1, 0, 2, 1, 0, 2][i % 7];
    let cloth = market.paint.cloth[0];
    let frames = [fittings(kind.radius, 0.20), fittings(kind.radius, 0.05)];
    let tuft = tassel(kind.radius);
    let (iron, dark) = (market.paint.iron, market.paint.dark_wood);
    let chosen = &hooks[..kind.count as usize];
    let swings = |i: usize| chosen[i].1 && i.is_multiple_of(3);
    let swinging: Vec<usize> = (0..chosen.len()).filter(|i| swings(*i)).take(MOST_SWINGING).collect();
    let meshes = moving::LanternMeshes {
        balls: paint.map(|material| (moving::ball(market, kind.radius), material)),
        frame: (market.stage.mesh("lantern frame", fittings(kind.radius, 0.20)), dark),
        tassel: (market.stage.mesh("tassel", tassel(kind.radius)), cloth),
    };
    for i in &swinging {
        let glow = kind.glow(LANTERN_HUES[hue(*i)].1);
        let drop = 0.20 + kind.radius;
        moving::swing(market, &meshes, &Swing { hook: chosen[*i].0, drop, hue: hue(*i), radius: kind.radius, glow });
    }
    for (i, (hook, is_free)) in chosen.iter().enumerate() {
        if swinging.contains(&i) {
            continue;
        }
        let cord = if *is_free { 0.20 } else { 0.05 };
        let centre = *hook - Vec3::Y * (cord + kind.radius);
        let at = Affine3A::from_translation(centre);
        lamp(market, centre, kind, LANTERN_HUES[hue(i)].1, paint[hue(i)]);
        market.batch.add(&frames[usize::from(!is_free)], if *is_free { dark } else { iron }, at);
        market.batch.add(&tuft, cloth, at);
    }
}

/// Caps, ribs and the cord of a lantern around the origin.
fn fittings(radius: f32, cord: f32) -> Shape {
    let r = radius;
    let cap = |y: f32| {
        lathe(
            &[
                line(&[[0.0, y], [0.42 * r, y]]),
                line(&[[0.42 * r, y], [0.42 * r, y + 0.16 * r]]),
                line(&[[0.42 * r, y + 0.16 * r], [0.0, y + 0.16 * r]]),
            ],
            12,
        )
    };
    let mut shape = Shape::default();
    shape.join(&cap(0.90 * r), Affine3A::IDENTITY);
    shape.join(&cap(-1.06 * r), Affine3A::IDENTITY);
    for i in 0..7 {
        let (s, c) = (i as f32 / 7.0 * TAU).sin_cos();
        let rib: Vec<Vec3> = (0..=7)
            .map(|k| (0.13 + 0.74 * k as f32 / 7.0) * PI)
            .map(|angle| Vec3::new(c * angle.sin(), angle.cos(), s * angle.sin()) * (1.012 * r))
            .collect();
        shape.join(&pipe(&rib, 0.0035, 3), Affine3A::IDENTITY);
    }
    shape.join(&rod(Vec3::Y * 1.05 * r, Vec3::Y * (r + cord), 0.005, 4), Affine3A::IDENTITY);
    shape
}

/// A tassel below a lantern.
fn tassel(radius: f32) -> Shape {
    let r = radius;
    lathe(
        &[
            line(&[[0.0, -2.1 * r], [0.10 * r, -2.1 * r]]),
            curve(
                &[
                    [0.10 * r, -2.1 * r],
                    [0.085 * r, -1.5 * r],
                    [0.10 * r, -1.42 * r],
                    [0.03 * r, -1.32 * r],
                    [0.02 * r, -1.06 * r],
                ],
                2,
            ),
        ],
        10,
    )
}

/// Spreads lamps evenly over lines. `hue_of` has the index of a line and of a lamp.
fn scatter<const N: usize>(
    market: &mut Market,
    kind: &Kind,
    hues: [(&str, [f32; 3]); N],
    lines: &[Vec<Vec3>],
    hue_of: impl Fn(usize, usize) -> usize,
) {
    if kind.count == 0 {
        return;
    }
    let paint = materials(market, kind, hues);
    for (i, (line, centre)) in spread(lines, kind.count as usize).into_iter().enumerate() {
        let hue = hue_of(line, i);
        lamp(market, centre, kind, hues[hue].1, paint[hue]);
    }
}

/// So many points at even distances along lines, one line after the other, each with the index of its line.
pub fn spread(lines: &[Vec<Vec3>], count: usize) -> Vec<(usize, Vec3)> {
    let pieces: Vec<(usize, Vec3, Vec3)> = lines
        .iter()
        .enumerate()
        .flat_map(|(line, points)| points.windows(2).map(move |pair| (line, pair[0], pair[1])))
        .collect();
    let whole: f64 = pieces.iter().map(|(_, a, b)| f64::from(a.distance(*b))).sum();
    let (mut found, mut passed) = (Vec::with_capacity(count), 0.0_f64);
    for (line, a, b) in pieces {
        let length = f64::from(a.distance(b));
        while found.len() < count {
            let at = (found.len() as f64 + 0.5) / count as f64 * whole;
            if at > passed + length {
                break;
            }
            found.push((line, a.lerp(b, ((at - passed) / length) as f32)));
        }
        passed += length;
    }
    // Rounding may leave the last point behind the end.
    if let Some(end) = lines.last().and_then(|line| line.last()) {
        found.resize(count, (lines.len() - 1, *end));
    }
    found
}

fn mean(c: Vec3) -> f32 {
    c.element_sum() / 3.0
}

fn panel_flux(panel: &Panel) -> f32 {
    PI * 4.0 * panel.half.x * panel.half.y * mean(panel.glow)
}

/// A lit board, a Lambertian rectangle.
fn panel(market: &mut Market, board: &Panel) {
    let (at, [x, y]) = (board.at, board.half.to_array());
    let mut face = Shape::default();
    face.quad([[-x, -y], [x, -y], [x, y], [-x, y]].map(|[x, y]| Vec3::new(x, y, 0.0)));
    let glow = market.stage.material(shown("lit boards", board.glow));
    market.batch.add(&face, glow, at);
    market.stage.scene.lights.push(Light::Rectangle {
        // Before the mesh that shows it.
        centre: at.transform_point3(Vec3::Z * 0.003).into(),
        half_u: at.transform_vector3(Vec3::X * x),
        half_v: at.transform_vector3(Vec3::Y * y),
        radiance: board.glow,
    });
}

/// Flux of a spot lamp with the full strength up to its edge.
pub fn cone_flux(intensity: Vec3, outer_degrees: f32) -> f32 {
    TAU * (1.0 - outer_degrees.to_radians().cos()) * mean(intensity)
}

fn spot_flux() -> f32 {
    cone_flux(SPOT, SPOT_ANGLES[1])
}

/// A lamp in a shade that shines down on the goods.
fn spot(market: &mut Market, at: Vec3) {
    let shade = lathe(
        &[
            line(&[[0.16, -0.02], [0.165, -0.02]]),
            curve(&[[0.165, -0.02], [0.12, 0.07], [0.04, 0.13], [0.0, 0.14]], 3),
            curve(&[[0.0, 0.128], [0.035, 0.12], [0.112, 0.065], [0.16, -0.02]], 3),
        ],
        20,
    );
    let place = Affine3A::from_translation(at);
    market.batch.add(&shade, market.paint.copper, place);
    market.batch.add(&rod(Vec3::Y * 0.13, Vec3::Y * 0.42, 0.006, 4), market.paint.rubber, place);
    let [inner, outer] = SPOT_ANGLES.map(f32::to_radians);
    // It has no size, and shines from just below the ball that shows it.
    market.stage.scene.lights.push(Light::Spot {
        position: (at - Vec3::Y * 0.01).into(),
        direction: Vec3::NEG_Y,
        intensity: SPOT,
        range: None,
        inner,
        outer,
    });
    let radius = 0.035;
    let glow = market.stage.material(shown("spot lamps", 25.0 * SPOT));
    market.batch.ball(at + Vec3::Y * radius, radius, glow);
}
