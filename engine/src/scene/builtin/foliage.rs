//! Plants: cards with a leaf texture around a dark core.
use super::shapes::{Shape, sphere};
use crate::scene::{ColourSpace, Texture};
use glam::{Quat, Vec2, Vec3};
use std::f32::consts::TAU;

/// Width and height of the leaf texture, texels.
const EDGE: usize = 128;

/// A small pseudo-random generator (PCG, O'Neill 2014), so that every run has the same plants.
pub(super) struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        let mut random = Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15));
        random.next();
        random
    }

    fn next(&mut self) -> u32 {
        let old = self.0;
        self.0 = old.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let mixed = (((old >> 18) ^ old) >> 27) as u32;
        mixed.rotate_right((old >> 59) as u32)
    }

    /// Uniform from `lo` to `hi`.
    pub fn range(&mut self, lo: f32, hi: f32) -> f32 {
        lo + (hi - lo) * (self.next() >> 8) as f32 / 16_777_216.0
    }

    /// A uniformly distributed unit vector.
    pub fn direction(&mut self) -> Vec3 {
        let y = self.range(-1.0, 1.0);
        let (s, c) = self.range(0.0, TAU).sin_cos();
        let r = (1.0 - y * y).max(0.0).sqrt();
        Vec3::new(r * c, y, r * s)
    }
}

/// A twig with seven leaves. The colour covers all texels and alpha only the leaves, so that filtering does not make dark fringes.
pub(super) fn leaf_texture() -> Texture {
    let leaves: Vec<(Vec2, f32, f32)> = (0..7)
        .map(|i| {
            let side = if i % 2 == 0 { 1.0 } else { -1.0 };
            let height = 0.90 - 0.115 * i as f32;
            let (angle, size) =
                if i == 6 { (0.0, 0.17) } else { (side * (1.05 - 0.07 * i as f32), 0.21 - 0.008 * i as f32) };
            (Vec2::new(0.5, height), angle, size)
        })
        .collect();
    let mut rgba = Vec::with_capacity(EDGE * EDGE * 4);
    for y in 0..EDGE {
        for x in 0..EDGE {
            let p = (Vec2::new(x as f32, y as f32) + 0.5) / EDGE as f32;
            // The stem, and then the nearest leaf.
            let mut cover: f32 = if (p.x - 0.5).abs() < 0.012 && p.y > 0.2 { 1.0 } else { 0.0 };
            let (mut rib, mut shade) = (0.0_f32, 0.5_f32);
            for (i, (root, angle, size)) in leaves.iter().enumerate() {
                let (s, c) = angle.sin_cos();
                let axis = Vec2::new(s, -c);
                let q = p - *root;
                let (along, across) = (q.dot(axis) / (2.0 * size), q.perp_dot(axis).abs() / size);
                if !(0.0..=1.0).contains(&along) {
                    continue;
                }
                // Pointed at the end, and widest below the middle.
                let width = 0.62 * along.powf(0.6) * (1.0 - along).powf(0.85) * 1.35;
                let inside = ((width - across) * size * EDGE as f32 + 0.5).clamp(0.0, 1.0);
                if inside > 0.0 {
                    cover = cover.max(inside);
                    rib = (1.0 - across * 14.0).max(0.0);
                    shade = 0.35 + 0.09 * i as f32 + 0.25 * along;
                }
            }
            let tone = (shade + 0.35 * rib).clamp(0.0, 1.0);
            let green = Vec3::new(58.0, 96.0, 34.0).lerp(Vec3::new(132.0, 164.0, 66.0), tone);
            rgba.extend([green.x as u8, green.y as u8, green.z as u8, (cover * 255.0) as u8]);
        }
    }
    Texture::new("leaves".to_owned(), [EDGE as u32; 2], ColourSpace::Srgb, rgba)
}

/// Leaf cards scattered over an ellipsoid around the origin, with normals pointing outwards. Needs a double-sided material.
pub(super) fn crown(seed: u64, half: Vec3, cards: usize, size: f32) -> Shape {
    let mut random = Random::new(seed);
    let mut shape = Shape::default();
    for _ in 0..cards {
        let out = random.direction();
        // A few bumps on the ellipsoid give it an irregular outline.
        let lump = 1.0 + 0.10 * (5.0 * out.x + 1.0).sin() * (4.0 * out.y).cos() + 0.06 * (7.0 * out.z + 2.0).sin();
        let centre = out * half * lump * random.range(0.80, 1.0);
        let normal = (out / half).normalize();
        let size = size * random.range(0.75, 1.25);
        // Twigs point outwards and upwards, with some randomness.
        let up = (normal * 0.6 + Vec3::Y * 0.5 + random.direction() * 0.7).normalize_or(Vec3::Y);
        let right = up.cross(random.direction()).normalize_or(Vec3::X);
        card(&mut shape, centre, right * (0.5 * size), up * (0.5 * size), normal);
    }
    shape
}

/// Leaf cards in a box around the origin: a climber on a wall (thin in z) or on a pergola (thin in y).
pub(super) fn climber(seed: u64, half: Vec3, outward: Vec3, cards: usize, size: f32) -> Shape {
    let mut random = Random::new(seed);
    let mut shape = Shape::default();
    for _ in 0..cards {
        // Denser in the middle than at the edges.
        let mut bell = || 0.5 * (random.range(-1.0, 1.0) + random.range(-1.0, 1.0));
        let centre = half * Vec3::new(bell(), bell(), bell()) * 1.2;
        let turn = Quat::from_axis_angle(outward, random.range(0.0, TAU));
        let normal = (outward + random.direction() * 0.55).normalize_or(outward);
        let right = turn * normal.any_orthonormal_vector();
        let right = (right - normal * normal.dot(right)).normalize_or(normal.any_orthonormal_vector());
        let size = 0.5 * size * random.range(0.75, 1.25);
        card(&mut shape, centre, right * size, normal.cross(right) * size, normal);
    }
    shape
}

/// A leaf card that faces the side of its shading normal.
fn card(shape: &mut Shape, centre: Vec3, right: Vec3, up: Vec3, normal: Vec3) {
    let right = if right.cross(up).dot(normal) < 0.0 { -right } else { right };
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
        .map(|(x, y)| shape.vertex(centre + right * x + up * y, normal, Vec2::new(0.5 + 0.5 * x, 0.5 - 0.5 * y)));
    shape.triangle([corners[0], corners[1], corners[2]]);
    shape.triangle([corners[0], corners[2], corners[3]]);
}

/// The dark core inside a crown, so that one cannot see through it.
pub(super) fn core(half: Vec3) -> Shape {
    let mut shape = sphere(1.0, 8, 12);
    for (p, n) in shape.mesh.positions.iter_mut().zip(&mut shape.mesh.normals) {
        *p *= half;
        *n = (*n / half).normalize();
    }
    shape
}
