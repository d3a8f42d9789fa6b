//! Test shapes and random numbers.
use crate::oracle::{Facet, Soup};
use glam::{DVec3, Vec3};

/// SplitMix64 (Steele, Lea and Flood 2014).
pub struct Random(pub u64);

impl Random {
    pub fn unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f32 / (1_u32 << 24) as f32
    }

    pub fn range(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    /// In the cube from -1 to 1.
    pub fn vector(&mut self) -> Vec3 {
        Vec3::new(self.range(-1.0, 1.0), self.range(-1.0, 1.0), self.range(-1.0, 1.0))
    }
}

/// Loose triangles of mixed sizes in the cube from -1 to 1.
pub fn random_soup(random: &mut Random, triangles: usize) -> Soup {
    let mut positions = Vec::new();
    for _ in 0..triangles {
        let (centre, size) = (random.vector(), random.range(0.05, 0.6));
        positions.extend((0..3).map(|_| centre + size * random.vector()));
    }
    let indices = (0..positions.len() as u32).collect();
    Soup { positions, indices }
}

/// A closed unit sphere of `2 * n * (2 * n - 2)` triangles that share their corners, counter-clockwise from outside.
pub fn sphere(n: u32) -> Soup {
    let around = 2 * n;
    let mut positions = vec![Vec3::Y];
    for ring in 1..n {
        let (sin, cos) = (std::f32::consts::PI * ring as f32 / n as f32).sin_cos();
        for step in 0..around {
            let (s, c) = (std::f32::consts::TAU * step as f32 / around as f32).sin_cos();
            positions.push(Vec3::new(sin * s, cos, sin * c));
        }
    }
    positions.push(Vec3::NEG_Y);
    let last = positions.len() as u32 - 1;
    let at = |ring: u32, step: u32| 1 + (ring - 1) * around + step % around;
    let mut indices = Vec::new();
    for step in 0..around {
        indices.extend([0, at(1, step), at(1, step + 1)]);
        for ring in 1..n - 1 {
            let [a, b, c, d] = [at(ring, step), at(ring + 1, step), at(ring + 1, step + 1), at(ring, step + 1)];
            indices.extend([a, b, c, a, c, d]);
        }
        indices.extend([at(n - 1, step), last, at(n - 1, step + 1)]);
    }
    Soup { positions, indices }
}

/// From -1 to 1 on each axis, counter-clockwise from outside.
pub fn cube() -> Soup {
    let positions = (0..8).map(|i| Vec3::from([1, 2, 4].map(|bit| if i & bit == 0 { -1.0 } else { 1.0 }))).collect();
    let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    Soup { positions, indices: faces.iter().flat_map(|&[a, b, c, d]| [a, b, c, a, c, d]).collect() }
}

/// Whether a ray passes an edge of a triangle within `tolerance`, as a part of the triangle's size.
pub fn grazes(facet: &Facet, origin: DVec3, direction: DVec3, tolerance: f64) -> bool {
    let [a, b, c] = facet.corners;
    let normal = (b - a).cross(c - a);
    let t = normal.dot(a - origin) / normal.dot(direction);
    let p = origin + t * direction;
    let weights = [(b, c), (c, a), (a, b)].map(|(u, v)| (v - u).cross(p - u).dot(normal) / normal.length_squared());
    let least = weights.iter().copied().fold(f64::INFINITY, f64::min);
    least.abs() <= tolerance
}
