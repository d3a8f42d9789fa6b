//! Environment maps: radiance from all directions, from an image.
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

/// Largest radiance of a texel, scale included, so that its square still fits into an `f32`.
const MAX_RADIANCE: f32 = 1e18;
/// Least number of columns and rows for integrating the irradiance. They are finer than the texels of small images, because
/// radiance is interpolated between texels.
const QUADRATURE: [u32; 2] = [256, 128];

/// An environment map: radiance in every direction, in an equirectangular (latitude-longitude) image.
///
/// The direction of texture coordinates (u, v), before `turn`, is `(sin p sin t, cos t, -cos p sin t)` with `p = 2 pi (u - 1/2)`
/// and `t = pi v`: the middle of the image is -z, where a camera without rotation looks, and its top edge is +y. Radiance is
/// bilinear in (u, v) between the centres of texels, wraps around in u, and is constant beyond the first and last row of centres.
#[derive(Clone, Debug, PartialEq)]
pub struct Environment {
    /// Name, for messages.
    pub name: String,
    /// Number of columns, at least 1.
    pub width: u32,
    /// Number of rows, at least 1.
    pub height: u32,
    /// Radiance of each texel, linear Rec.709, finite and at least 0; rows from top to bottom.
    pub radiance: Arc<[Vec3]>,
    /// Factor on the radiance, at least 0.
    pub scale: f32,
    /// Rotation about +y, counter-clockwise as seen from above, radians.
    pub turn: f32,
}

/// An invalid environment map.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EnvironmentError {
    /// The file is neither Radiance HDR nor OpenEXR.
    #[error("neither Radiance HDR nor OpenEXR")]
    Kind,
    /// The file cannot be decoded.
    #[error("cannot be decoded: {0}")]
    Image(String),
    /// A size is above a limit.
    #[error("{got} {what}, the limit is {limit}")]
    Limit {
        /// What exceeds the limit, such as `texels`.
        what: &'static str,
        /// The number found.
        got: u64,
        /// The limit.
        limit: u64,
    },
    /// The number of texels is not width times height.
    #[error("an environment map of {width}x{height} texels holds {got}")]
    Texels {
        /// Number of columns.
        width: u32,
        /// Number of rows.
        height: u32,
        /// Number of texels that there are.
        got: usize,
    },
    /// The radiance of a texel is negative, not finite, or too large.
    #[error("pixel ({x}, {y}) has the radiance {got}, wanted numbers from 0 to {limit:e}")]
    Pixel {
        /// Column, from the left.
        x: u32,
        /// Row, from the top.
        y: u32,
        /// Its radiance.
        got: Vec3,
        /// The largest radiance that is allowed.
        limit: f32,
    },
    /// The scale or the turn is invalid.
    #[error("{what} is {got}, wanted {wanted}")]
    Number {
        /// `scale` or `turn`.
        what: &'static str,
        /// The value found.
        got: f32,
        /// The values that are allowed, in words.
        wanted: &'static str,
    },
}

impl Environment {
    /// Checks all conditions on the fields.
    ///
    /// # Errors
    /// [`EnvironmentError`], for the first texel or number that is invalid.
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
        // A scale below 1 does not allow larger texels, because they are uploaded without the scale.
        self.limit_to(MAX_RADIANCE / self.scale.max(1.0))
    }

    /// Checks that all components of all texels are between 0 and `limit`.
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

    /// Unit direction in the world, for texture coordinates from 0 to 1 with the origin at the top left of the image.
    pub fn direction(&self, uv: Vec2) -> Vec3 {
        let (p, t) = (TAU * (f64::from(uv.x) - 0.5), PI * f64::from(uv.y));
        self.world_from_image(DVec3::new(p.sin() * t.sin(), t.cos(), -p.cos() * t.sin())).as_vec3()
    }

    /// Texture coordinates of a direction in the world, of any length above 0: the inverse of [`Environment::direction`]. At the
    /// poles u is one half.
    pub fn uv(&self, direction: Vec3) -> Vec2 {
        self.place(direction).as_vec2()
    }

    /// Whether no light comes from any direction.
    pub fn is_black(&self) -> bool {
        self.scale == 0.0 || self.radiance.iter().all(|texel| texel.max_element() <= 0.0)
    }

    /// Radiance from a direction in the world, of any length above 0, scale included.
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

    /// Bilinear interpolation of the texels around texture coordinates.
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

    /// Irradiance in order-2 spherical harmonics, with the order and the cosine lobe of [`Sky::irradiance_sh`].
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
        // The rows are summed in order, so that the result is deterministic.
        let all: Vec<[DVec3; 9]> = (0..rows).into_par_iter().map(row).collect();
        let mut sum = [DVec3::ZERO; 9];
        for row in all {
            for (sum, c) in sum.iter_mut().zip(row) {
                *sum += c;
            }
        }
        cosine_lobe(sum).map(|c| (c * f64::from(self.scale)).as_vec3())
    }

    /// The struct that shaders read. There is no disc, ground or analytic sky besides the image.
    pub(super) fn to_gpu(&self, environment: SampledImage, environment_sampler: SamplerId) -> Sky {
        let (sin, cos) = f64::from(self.turn).sin_cos();
        Sky {
            to_sun: Vec3::Y.to_array(),
            // A cosine that no direction reaches, so that there is no disc.
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
