//! Textures made by code: wet setts, bricks, stained plaster, curtains behind lit windows.
use crate::scene::{ColourSpace, Texture};
use glam::{IVec2, UVec2, Vec2, Vec3};
use rayon::prelude::*;

/// Width and length of the piece of paving that repeats, metres.
pub const SETTS_SIZE: Vec2 = Vec2::new(5.4, 16.0);
const SETTS_TEXELS: [u32; 2] = [704, 2048];
/// Of the piece of brickwork.
pub const BRICKS_SIZE: Vec2 = Vec2::new(1.0, 0.75);
const BRICKS_TEXELS: [u32; 2] = [256, 192];
/// Of the piece of plaster.
pub const PLASTER_SIZE: Vec2 = Vec2::new(5.0, 6.0);
const PLASTER_TEXELS: [u32; 2] = [160, 192];
const WINDOW_TEXELS: [u32; 2] = [96, 128];

/// Base colour, roughness and normals of one piece of ground or wall.
pub struct Maps {
    pub base_colour: Texture,
    pub roughness: Texture,
    pub normals: Texture,
}

/// One texel: linear albedo, perceptual roughness, and how much the height changes over a metre to the right and downwards.
struct Texel {
    albedo: Vec3,
    roughness: f32,
    slope: Vec2,
}

/// Uniform from 0 to 1, a hash of a lattice point by PCG (Jarzynski and Olano 2020, "Hash Functions for GPU Rendering").
fn hash(cell: IVec2, seed: u32) -> f32 {
    let key = (cell.x as u32).wrapping_mul(0x9e37_79b1) ^ (cell.y as u32).wrapping_mul(0x85eb_ca77) ^ (seed << 16);
    let state = key.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (((word >> 22) ^ word) >> 8) as f32 / 16_777_216.0
}

/// Value noise from 0 to 1 over a lattice of `cells` that repeats; `at` from 0 to 1 is one period.
fn noise(at: Vec2, cells: IVec2, seed: u32) -> f32 {
    let p = at * cells.as_vec2();
    let (corner, f) = (p.floor().as_ivec2(), p - p.floor());
    let f = f * f * (3.0 - 2.0 * f);
    let value = |x: i32, y: i32| hash((corner + IVec2::new(x, y)).rem_euclid(cells), seed);
    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
    mix(mix(value(0, 0), value(1, 0), f.x), mix(value(0, 1), value(1, 1), f.x), f.y)
}

/// Sum of octaves of [`noise`], each twice as fine and half as strong, from 0 to 1.
fn octaves(at: Vec2, cells: IVec2, seed: u32, count: u32) -> f32 {
    let (mut sum, mut weights) = (0.0, 0.0);
    for octave in 0..count {
        let weight = 0.5_f32.powi(octave as i32);
        sum += weight * noise(at, cells * (1 << octave), seed + octave);
        weights += weight;
    }
    sum / weights
}

fn smoothstep(from: f32, to: f32, x: f32) -> f32 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// A brick bond: the stone at a point, and where in it the point is, from -1 to 1. `stones` is their number across and along.
fn bond(at: Vec2, stones: IVec2) -> (IVec2, Vec2) {
    let row = (at.y * stones.y as f32).floor();
    let shifted = Vec2::new(at.x * stones.x as f32 + 0.5 * (row % 2.0), at.y * stones.y as f32);
    let stone = shifted.floor().as_ivec2().rem_euclid(stones);
    (stone, 2.0 * (shifted - shifted.floor()) - 1.0)
}

/// Renders three maps from a function of texture coordinates from 0 to 1.
fn maps(name: &str, [width, height]: [u32; 2], texel: impl Fn(Vec2) -> Texel + Sync) -> Maps {
    let rows: Vec<[Vec<u8>; 3]> = (0..height)
        .into_par_iter()
        .map(|y| {
            let mut row: [Vec<u8>; 3] = Default::default();
            for x in 0..width {
                let size = Vec2::new(width as f32, height as f32);
                let t = texel((Vec2::new(x as f32, y as f32) + 0.5) / size);
                // The y axis of a normal map points up the texture.
                let normal = Vec3::new(-t.slope.x, t.slope.y, 1.0).normalize();
                row[0].extend(srgb(t.albedo));
                row[1].extend([255, code(t.roughness), 0, 255]);
                row[2].extend([
                    code(0.5 + 0.5 * normal.x),
                    code(0.5 + 0.5 * normal.y),
                    code(0.5 + 0.5 * normal.z),
                    255,
                ]);
            }
            row
        })
        .collect();
    let texture = |map: usize, what: &str, space: ColourSpace| {
        let bytes = rows.iter().flat_map(|row| row[map].iter().copied()).collect();
        Texture::new(format!("{name} {what}"), [width, height], space, bytes)
    };
    Maps {
        base_colour: texture(0, "colour", ColourSpace::Srgb),
        roughness: texture(1, "roughness", ColourSpace::Linear),
        normals: texture(2, "normals", ColourSpace::Linear),
    }
}

fn code(x: f32) -> u8 {
    (x.clamp(0.0, 1.0) * 255.0).round() as u8
}

/// RGBA in sRGB, with the curve of a power of 2.2 in place of the standard's, which is near enough for colours that nobody measured.
fn srgb(c: Vec3) -> [u8; 4] {
    let [r, g, b] = c.to_array().map(|x| code(x.clamp(0.0, 1.0).powf(1.0 / 2.2)));
    [r, g, b, 255]
}

/// The stones across and along the piece of paving.
const STONES: IVec2 = IVec2::new(28, 102);

/// Height of the paving above its lowest joints, metres.
fn setts_height(at: Vec2) -> f32 {
    let (stone, inside) = bond(at, STONES);
    let half = 0.5 * SETTS_SIZE / STONES.as_vec2();
    // Metres to the joint, along the nearer of both axes.
    let edge = (half * (1.0 - inside.abs())).min_element();
    let dome = smoothstep(0.002, 0.032, edge) - 0.12 * inside.length_squared();
    let lean = inside * (Vec2::new(hash(stone, 11), hash(stone, 12)) - 0.5);
    0.011 * dome
        + 0.005 * hash(stone, 13)
        + 0.004 * (lean.x + lean.y)
        + 0.0012 * octaves(at, IVec2::new(240, 720), 14, 2)
}

/// Heights at the centres of texels, and how they change over a metre.
struct Relief {
    texels: [u32; 2],
    /// Edges of the piece, metres.
    size: Vec2,
    heights: Vec<f32>,
}

impl Relief {
    fn new(texels: [u32; 2], size: Vec2, height: impl Fn(Vec2) -> f32 + Sync) -> Self {
        let [width, rows] = texels;
        let at =
            |i: u32| (Vec2::new((i % width) as f32, (i / width) as f32) + 0.5) / Vec2::new(width as f32, rows as f32);
        let heights = (0..width * rows).into_par_iter().map(|i| height(at(i))).collect();
        Self { texels, size, heights }
    }

    /// Height and slope at a texel, given by its coordinates from 0 to 1.
    fn at(&self, at: Vec2) -> (f32, Vec2) {
        let texels = UVec2::from(self.texels);
        let here = (at * texels.as_vec2()).as_uvec2();
        let height = |p: UVec2| self.heights[((p.y % texels.y) * texels.x + p.x % texels.x) as usize];
        let step = |by: UVec2| height(here + by) - height(here + texels - by);
        let slope = Vec2::new(step(UVec2::X), step(UVec2::Y)) * texels.as_vec2() / (2.0 * self.size);
        (height(here), slope.clamp(Vec2::splat(-0.9), Vec2::splat(0.9)))
    }
}

/// Setts after rain. Where the street lies low, water stands on it, flat and smooth as a mirror; around it the stones are wet, and on higher
/// ground they begin to dry.
pub fn setts() -> Maps {
    let relief = Relief::new(SETTS_TEXELS, SETTS_SIZE, setts_height);
    maps("setts", SETTS_TEXELS, |at| {
        let (stone, _) = bond(at, STONES);
        // The ground itself, in metres; the street is lowest along its middle.
        let ground = 0.060 * octaves(at, IVec2::new(3, 8), 21, 4) + 0.010 * (2.0 * at.x - 1.0).abs();
        let (height, slope) = relief.at(at);
        let depth = 0.0385 - ground - height;
        let grain = octaves(at, IVec2::new(90, 270), 31, 3);
        let tone = 0.6 + 0.5 * hash(stone, 32) + 0.35 * (grain - 0.5);
        let hue = Vec3::new(1.0, 0.97, 0.93).lerp(Vec3::new(0.88, 0.96, 1.06), hash(stone, 33));
        let joint = 1.0 - smoothstep(0.002, 0.007, height);
        let dry = (hue * (0.15 * tone)).lerp(Vec3::splat(0.035), joint);
        // Dry from a centimetre above the water, in patches.
        let dryness = smoothstep(0.006, 0.022, -depth + 0.024 * (octaves(at, IVec2::new(10, 30), 41, 2) - 0.5));
        let albedo = dry * (0.50 + 0.50 * dryness);
        if depth > 0.0 {
            // The last millimetre of water bends up to the stone.
            let shore = smoothstep(0.0, 0.0015, depth);
            return Texel { albedo: albedo * 0.8, roughness: 0.12 - 0.10 * shore, slope: Vec2::ZERO };
        }
        // A film of water fills the pores of wet stone, which makes it smoother.
        let wet = 0.20 + 0.16 * grain;
        Texel { albedo, roughness: wet + (0.72 - wet) * dryness, slope: slope * (0.65 + 0.35 * dryness) }
    })
}

/// Brickwork.
pub fn bricks() -> Maps {
    const BRICKS: IVec2 = IVec2::new(4, 10);
    let relief = Relief::new(BRICKS_TEXELS, BRICKS_SIZE, |at| {
        let (brick, inside) = bond(at, BRICKS);
        let half = 0.5 * BRICKS_SIZE / BRICKS.as_vec2();
        let edge = (half * (1.0 - inside.abs())).min_element();
        0.006 * smoothstep(0.004, 0.009, edge)
            + 0.002 * hash(brick, 51)
            + 0.001 * octaves(at, IVec2::new(48, 36), 52, 2)
    });
    maps("bricks", BRICKS_TEXELS, |at| {
        let (brick, _) = bond(at, BRICKS);
        let (height, slope) = relief.at(at);
        let tone = 0.62 + 0.5 * hash(brick, 53) + 0.3 * (octaves(at, IVec2::new(32, 24), 54, 3) - 0.5);
        let red = Vec3::new(0.74, 0.42, 0.32) * tone;
        let albedo = Vec3::new(0.62, 0.58, 0.54).lerp(red, smoothstep(0.001, 0.004, height));
        Texel { albedo, roughness: 0.85, slope }
    })
}

/// Plaster with streaks that rain has left: a factor on its colour.
pub fn plaster() -> Texture {
    let stained = maps("plaster", PLASTER_TEXELS, |at| {
        let streaks = octaves(at, IVec2::new(48, 5), 61, 3);
        let patches = octaves(at, IVec2::new(6, 7), 62, 4);
        let tone = 0.98 - 0.30 * smoothstep(0.5, 0.85, streaks) - 0.35 * smoothstep(0.52, 0.80, patches);
        Texel { albedo: Vec3::splat(tone), roughness: 1.0, slope: Vec2::ZERO }
    });
    stained.base_colour
}

/// What shines through a window: a lamp in the room, curtains in folds to both sides, a plant on the sill. A factor on its emission.
pub fn window() -> Texture {
    let lit = maps("window", WINDOW_TEXELS, |at| {
        let lamp = (-4.0 * (at - Vec2::new(0.58, 0.34)).length_squared()).exp();
        let mut light = 0.20 + 0.75 * lamp;
        // The curtains hang in folds, and part in the middle.
        let from_side = (at.x.min(1.0 - at.x) - 0.05 * (3.0 * at.y).sin()) / 0.24;
        if from_side < 1.0 {
            light = 0.22 + 0.30 * lamp + 0.10 * (70.0 * at.x + 2.0 * at.y).sin();
        }
        let leaves = octaves(at, IVec2::new(14, 18), 71, 2) - 1.6 * (at.x - 0.42).abs();
        let is_plant = at.y > 0.62 && leaves > 1.02 - 0.95 * at.y;
        light *= if is_plant || at.y > 0.94 { 0.12 } else { 1.0 };
        let warm = Vec3::new(1.0, 0.82 + 0.14 * lamp, 0.6 + 0.3 * lamp);
        Texel { albedo: warm * light, roughness: 1.0, slope: Vec2::ZERO }
    });
    lit.base_colour
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Roughness of the paving, and whether its normal is straight up.
    fn paving() -> Vec<(f32, bool)> {
        let maps = setts();
        let (rough, normals) = (&maps.roughness.mips[0], &maps.normals.mips[0]);
        let one = |(r, n): (&[u8], &[u8])| (f32::from(r[1]) / 255.0, n[..2] == [128, 128]);
        rough.chunks_exact(4).zip(normals.chunks_exact(4)).map(one).collect()
    }

    #[test]
    fn puddles_are_mirrors_among_rough_stones() {
        let texels = paving();
        let share = |is: &dyn Fn(&(f32, bool)) -> bool| {
            texels.iter().filter(|texel| is(texel)).count() as f64 / texels.len() as f64
        };
        let (mirrors, rough) = (share(&|(r, flat)| *r < 0.04 && *flat), share(&|(r, _)| *r > 0.5));
        assert!((0.10..0.45).contains(&mirrors) && (0.10..0.6).contains(&rough), "{mirrors} {rough}");
        assert!(share(&|(r, flat)| *r > 0.15 && !*flat) > 0.3, "the rest is bumpy");
    }

    #[test]
    fn patterns_repeat_without_a_seam() {
        for at in [Vec2::new(0.3, 0.4), Vec2::new(0.71, 0.05), Vec2::new(0.02, 0.93)] {
            for period in [Vec2::X, Vec2::Y] {
                let (here, there) =
                    (octaves(at, IVec2::new(3, 8), 21, 4), octaves(at + period, IVec2::new(3, 8), 21, 4));
                assert!((here - there).abs() < 1e-3, "{at} {here} {there}");
            }
            assert!((setts_height(at) - setts_height(at + Vec2::X)).abs() < 1e-3);
        }
    }
}
