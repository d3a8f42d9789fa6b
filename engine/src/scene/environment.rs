//! Light from all around, from an image.
use super::daylight::{cosine_lobe, sh_basis};
use glam::{DVec2, DVec3, Vec2, Vec3};
use magpie_shaders::view::Sky;
use magpie_shaders::{SampledImage, SamplerId};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

mod file;
#[cfg(test)]
mod tests;

/// Greatest radiance of a texel, scale included: its square is still a 32-bit number.
const MAX_RADIANCE: f32 = 1e18;
/// Columns and rows at least that the irradiance is integrated with: finer than the texels where those are few, because the light
/// between two of them is blended.
const QUADRATURE: [u32; 2] = [256, 128];

/// An environment map: radiance in every direction, latitude over longitude.
///
/// The direction of texture coordinates (u, v), before `turn`, is `(sin p sin t, cos t, -cos p sin t)` with `p = 2 pi (u - 1/2)` and
/// `t = pi v`: the middle of the image is -z, where a camera without rotation looks, and its top edge is +y. Between the centres of
/// texels radiance is bilinear in (u, v), around the seam, and constant beyond the centres of the first and the last row.
#[derive(Clone, Debug, PartialEq)]
pub struct Environment {
    /// Name for messages.
    pub name: String,
    /// Texels from left to right, at least 1.
    pub width: u32,
    /// Texels from top to bottom, at least 1.
    pub height: u32,
    /// Radiance of each texel, linear Rec.709, finite and at least 0; rows from the top.
    pub radiance: Arc<[Vec3]>,
    /// What the radiance is multiplied with, at least 0.
    pub scale: f32,
    /// Angle about +y by which the image is turned counter-clockwise as seen from above, radians.
    pub turn: f32,
}

/// What is wrong with an environment map.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EnvironmentError {
    /// The file is of another kind.
    #[error("neither Radiance HDR nor OpenEXR")]
    Kind,
    /// The file cannot be decoded.
    #[error("cannot be decoded: {0}")]
    Image(String),
    /// More than Magpie takes.
    #[error("{got} {what}, the limit is {limit}")]
    Limit {
        /// What is counted.
        what: &'static str,
        /// The number found.
        got: u64,
        /// The largest number that is taken.
        limit: u64,
    },
    /// Width and height do not go with the table of texels.
    #[error("an environment map of {width}x{height} texels holds {got}")]
    Texels {
        /// Texels from left to right.
        width: u32,
        /// Texels from top to bottom.
        height: u32,
        /// Length of the table.
        got: usize,
    },
    /// The radiance of a texel is no such thing, or too much.
    #[error("pixel ({x}, {y}) has the radiance {got}, wanted numbers from 0 to {limit:e}")]
    Pixel {
        /// Texels from the left.
        x: u32,
        /// Texels from the top.
        y: u32,
        /// What it holds.
        got: Vec3,
        /// The greatest number that is taken.
        limit: f32,
    },
    /// Scale or turn cannot be used.
    #[error("{what} is {got}, wanted {wanted}")]
    Number {
        /// The property.
        what: &'static str,
        /// The value found.
        got: f32,
        /// What is allowed.
        wanted: &'static str,
    },
}

impl Environment {
    /// Checks everything that is said of the fields.
    ///
    /// # Errors
    /// [`EnvironmentError`], naming the first pixel or number that is at fault.
    pub fn validate(&self) -> Result<(), EnvironmentError> {
        let (width, height, got) = (self.width, self.height, self.radiance.len());
        if width == 0 || height == 0 || got as u64 != u64::from(width) * u64::from(height) {
            return Err(EnvironmentError::Texels { width, height, got });
        }
        if !(self.scale.is_finite() && self.scale >= 0.0) {
            let wanted = "a finite number of at least 0";
            return Err(EnvironmentError::Number { what: "scale", got: self.scale, wanted });
        }
        if !self.turn.is_finite() {
            let wanted = "a finite angle in radians";
            return Err(EnvironmentError::Number { what: "turn", got: self.turn, wanted });
        }
        // A scale below 1 does not make room for more: texels go to the device without it.
        self.limit_to(MAX_RADIANCE / self.scale.max(1.0))
    }

    /// Every number of every texel lies in 0 to this.
    fn limit_to(&self, limit: f32) -> Result<(), EnvironmentError> {
        // A NaN is in no range.
        let fine = |texel: &Vec3| texel.to_array().iter().all(|c| (0.0..=limit).contains(c));
        match self.radiance.par_iter().position_first(|texel| !fine(texel)) {
            None => Ok(()),
            Some(at) => {
                let (x, y) = ((at % self.width as usize) as u32, (at / self.width as usize) as u32);
                Err(EnvironmentError::Pixel { x, y, got: self.radiance[at], limit })
            }
        }
    }

    /// Unit direction in the world of texture coordinates, both 0 to 1 from the image's top left corner.
    pub fn direction(&self, uv: Vec2) -> Vec3 {
        let (p, t) = (TAU * (f64::from(uv.x) - 0.5), PI * f64::from(uv.y));
        self.world_from_image(DVec3::new(p.sin() * t.sin(), t.cos(), -p.cos() * t.sin())).as_vec3()
    }

    /// Texture coordinates of a direction in the world, of any length but 0: the inverse of [`Environment::direction`]. At the poles
    /// u is one half.
    pub fn uv(&self, direction: Vec3) -> Vec2 {
        self.place(direction).as_vec2()
    }

    /// Whether no light comes from any direction.
    pub fn is_black(&self) -> bool {
        self.scale == 0.0 || self.radiance.iter().all(|texel| texel.max_element() <= 0.0)
    }

    /// Radiance from a direction in the world, of any length but 0, scale included.
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        (self.texels_at(self.place(direction)) * f64::from(self.scale)).as_vec3()
    }

    fn place(&self, direction: Vec3) -> DVec2 {
        let (sin, cos) = f64::from(self.turn).sin_cos();
        let d = direction.as_dvec3();
        let (x, z) = (cos * d.x - sin * d.z, sin * d.x + cos * d.z);
        let around = if x == 0.0 && z == 0.0 { 0.0 } else { x.atan2(-z) };
        DVec2::new(around / TAU + 0.5, x.hypot(z).atan2(d.y) / PI)
    }

    fn world_from_image(&self, d: DVec3) -> DVec3 {
        let (sin, cos) = f64::from(self.turn).sin_cos();
        DVec3::new(cos * d.x + sin * d.z, d.y, cos * d.z - sin * d.x)
    }

    /// The blend of the four texels around texture coordinates.
    fn texels_at(&self, uv: DVec2) -> DVec3 {
        let at = uv * DVec2::new(self.width.into(), self.height.into()) - 0.5;
        let (corner, part) = (at.floor(), at - at.floor());
        let texel = |dx: i64, dy: i64| {
            let x = (corner.x as i64 + dx).rem_euclid(self.width.into());
            let y = (corner.y as i64 + dy).clamp(0, i64::from(self.height) - 1);
            self.radiance[(y * i64::from(self.width) + x) as usize].as_dvec3()
        };
        let row = |dy: i64| texel(0, dy).lerp(texel(1, dy), part.x);
        row(0).lerp(row(1), part.y)
    }

    /// Irradiance as order-2 spherical harmonics, in the order and with the cosine lobe of [`Sky::irradiance_sh`].
    pub fn irradiance_sh(&self) -> [Vec3; 9] {
        let fine = |texels: u32, least: u32| texels as usize * least.div_ceil(texels) as usize;
        let (columns, rows) = (fine(self.width, QUADRATURE[0]), fine(self.height, QUADRATURE[1]));
        let around: Vec<(f64, f64)> =
            (0..columns).map(|i| (TAU * ((i as f64 + 0.5) / columns as f64 - 0.5)).sin_cos()).collect();
        let row = |row: usize| {
            let edge = |i: usize| (PI * i as f64 / rows as f64).cos();
            let v = (row as f64 + 0.5) / rows as f64;
            let (sin, cos) = (PI * v).sin_cos();
            let mut sum = [DVec3::ZERO; 9];
            for (column, (x, z)) in around.iter().enumerate() {
                let radiance = self.texels_at(DVec2::new((column as f64 + 0.5) / columns as f64, v));
                let direction = self.world_from_image(DVec3::new(x * sin, cos, -z * sin));
                for (sum, y) in sum.iter_mut().zip(sh_basis(direction)) {
                    *sum += radiance * y;
                }
            }
            let solid_angle = TAU * (edge(row) - edge(row + 1)) / columns as f64;
            sum.map(|c| c * solid_angle)
        };
        // Rows are summed in their own order, so that the same image always gives the same numbers.
        let all: Vec<[DVec3; 9]> = (0..rows).into_par_iter().map(row).collect();
        let mut sum = [DVec3::ZERO; 9];
        for row in all {
            for (sum, c) in sum.iter_mut().zip(row) {
                *sum += c;
            }
        }
        cosine_lobe(sum).map(|c| (c * f64::from(self.scale)).as_vec3())
    }

    /// The struct that shaders read. There is no disc, ground or analytic sky beside the image.
    pub(super) fn to_gpu(&self, environment: SampledImage, environment_sampler: SamplerId) -> Sky {
        let (sin, cos) = f64::from(self.turn).sin_cos();
        Sky {
            to_sun: Vec3::Y.to_array(),
            // The cosine of no angle.
            sun_cos_radius: 2.0,
            environment,
            environment_sampler,
            environment_scale: self.scale,
            environment_turn: [sin as f32, cos as f32],
            irradiance_sh: self.irradiance_sh().map(|c| c.to_array()),
            ..Sky::default()
        }
    }
}
