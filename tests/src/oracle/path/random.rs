//! Random numbers: SplitMix64 (Steele, Lea and Flood 2014, "Fast Splittable Pseudorandom Number Generators").
use glam::{DMat3, DVec3};
use std::f64::consts::TAU;

/// A stream of random numbers.
#[derive(Clone, Debug)]
pub struct Random(u64);

fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

impl Random {
    /// A stream by seed and number, such as a pixel's index.
    pub fn new(seed: u64, stream: u64) -> Self {
        Self(mix(mix(seed.wrapping_add(1)).wrapping_add(stream)))
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        (mix(self.0) >> 11) as f64 * (1.0 / (1_u64 << 53) as f64)
    }

    /// Uniform integer below `n`, which must not be 0.
    pub fn below(&mut self, n: usize) -> usize {
        ((self.unit() * n as f64) as usize).min(n - 1)
    }

    /// A unit vector, uniform over the sphere.
    pub fn direction(&mut self) -> DVec3 {
        from_polar(1.0 - 2.0 * self.unit(), TAU * self.unit())
    }
}

/// The unit vector with this cosine to +z, at this angle around it.
pub fn from_polar(cosine: f64, angle: f64) -> DVec3 {
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    DVec3::new(sine * angle.cos(), sine * angle.sin(), cosine)
}

/// A rotation that maps +z to a unit vector.
pub fn frame(z: DVec3) -> DMat3 {
    let x = z.any_orthonormal_vector();
    DMat3::from_cols(x, z.cross(x), z)
}
