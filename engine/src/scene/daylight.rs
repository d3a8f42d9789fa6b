//! Analytic daylight: A. J. Preetham, P. Shirley, B. Smits, "A Practical Analytic Model for Daylight", SIGGRAPH 1999.
//!
//! Luminance and chromaticity of the sky are `zenith * F(theta, gamma) / F(0, theta_sun)` with the function of Perez, `F(theta,
//! gamma) = (1 + A exp(B / cos theta)) (1 + C exp(D gamma) + E cos^2 gamma)`. Only the relative luminance is the paper's; it is
//! scaled so that the horizontal irradiance is [`Daylight::irradiance`].
use super::Light;
use glam::{DMat3, DVec3, Vec3};
use magpie_shaders::view::Sky;
use magpie_shaders::{SampledImage, SamplerId};
use std::f64::consts::PI;

/// Lower bound of `cos theta` in the function of Perez, so that the exponent stays finite at the horizon. The same bound is in
/// `shaders/lib/sky.glsl`.
const MIN_COS_THETA: f64 = 0.01;
/// Directions of the quadrature: rings of constant height, and steps around each.
const RINGS: usize = 64;
const STEPS: usize = 128;

/// A clear sky with a sun over a Lambertian ground.
#[derive(Clone, Debug, PartialEq)]
pub struct Daylight {
    /// Unit direction towards the sun. A sun below the horizon gives the sky of one on the horizon, and has no disc.
    pub to_sun: Vec3,
    /// Haze: 2 is very clear, 10 hazy. Clamped to the range of the model, 1.9 to 10.
    pub turbidity: f32,
    /// Irradiance of the horizontal plane from the sky alone, without the sun, in units of the scene's radiance times steradian.
    pub irradiance: f32,
    /// Diffuse reflectance of the ground, linear, 0 to 1.
    pub ground_albedo: Vec3,
    /// Illuminance from the sun at normal incidence, linear Rec.709.
    pub sun_illuminance: Vec3,
    /// Angular diameter of the sun's disc, radians.
    pub sun_angular_diameter: f32,
}

impl Default for Daylight {
    fn default() -> Self {
        Self {
            to_sun: Vec3::new(0.45, 0.766, 0.459).normalize(),
            turbidity: 2.8,
            irradiance: 1.1,
            ground_albedo: Vec3::splat(0.2),
            sun_illuminance: Vec3::new(4.8, 4.5, 4.1),
            sun_angular_diameter: 0.00929,
        }
    }
}

/// A [`Daylight`] with its coefficients precomputed, to evaluate many directions.
#[derive(Clone, Debug)]
pub struct SkyModel {
    to_sun: DVec3,
    /// Coefficients A to E of the function of Perez, for Y, x and y.
    perez: [[f64; 5]; 3],
    /// Zenith values of Y (scaled), x and y, divided by F at the zenith.
    zenith: DVec3,
    ground: DVec3,
}

impl Daylight {
    /// The sun as a directional light, with its angular size.
    pub fn sun(&self) -> Light {
        let angular_radius = 0.5 * self.sun_angular_diameter;
        Light::Directional { direction: -self.to_sun, illuminance: self.sun_illuminance, angular_radius }
    }

    /// Precomputes the coefficients, scale and ground.
    pub fn model(&self) -> SkyModel {
        let t = self.turbidity.clamp(1.9, 10.0) as f64;
        let sun = self.to_sun.as_dvec3();
        let height = sun.y.max(0.0);
        // A sun straight below has no azimuth, so any will do.
        let around = DVec3::new(sun.x, 0.0, sun.z).try_normalize().unwrap_or(DVec3::X);
        let to_sun = around * (1.0 - height * height).max(0.0).sqrt() + DVec3::Y * height;
        let theta = height.min(1.0).acos();

        // The tables of appendix A.2; each row is slope and offset over turbidity.
        let linear = |rows: [[f64; 2]; 5]| rows.map(|[slope, offset]| slope * t + offset);
        let perez = [
            linear([[0.1787, -1.4630], [-0.3554, 0.4275], [-0.0227, 5.3251], [0.1206, -2.5771], [-0.0670, 0.3703]]),
            linear([[-0.0193, -0.2592], [-0.0665, 0.0008], [-0.0004, 0.2125], [-0.0641, -0.8989], [-0.0033, 0.0452]]),
            linear([[-0.0167, -0.2608], [-0.0950, 0.0092], [-0.0079, 0.2102], [-0.0441, -1.6537], [-0.0109, 0.0529]]),
        ];
        let chroma = |m: [[f64; 4]; 3]| {
            let row = |r: [f64; 4]| ((r[0] * theta + r[1]) * theta + r[2]) * theta + r[3];
            (row(m[0]) * t + row(m[1])) * t + row(m[2])
        };
        let x = chroma([
            [0.00166, -0.00375, 0.00209, 0.0],
            [-0.02903, 0.06377, -0.03202, 0.00394],
            [0.11693, -0.21196, 0.06052, 0.25886],
        ]);
        let y = chroma([
            [0.00275, -0.00610, 0.00317, 0.0],
            [-0.04214, 0.08970, -0.04153, 0.00516],
            [0.15346, -0.26756, 0.06670, 0.26688],
        ]);
        let at_zenith = |k: usize| perez_function(&perez[k], 1.0, theta.cos());
        let zenith = DVec3::new(1.0 / at_zenith(0), x / at_zenith(1), y / at_zenith(2));
        let mut model = SkyModel { to_sun, perez, zenith, ground: DVec3::ZERO };

        let mut horizontal = 0.0;
        let mut coloured = DVec3::ZERO;
        for (direction, solid_angle) in hemisphere() {
            let weight = direction.y * solid_angle;
            horizontal += model.xyy(direction).x * weight;
            coloured += model.sky(direction) * weight;
        }
        let scale = self.irradiance as f64 / horizontal;
        model.zenith.x *= scale;
        let sunlight = self.sun_illuminance.as_dvec3() * sun.y.max(0.0);
        model.ground = self.ground_albedo.as_dvec3() * (coloured * scale + sunlight) / PI;
        model
    }

    /// Radiance from a direction (which need not be unit length), linear Rec.709, at least 0, without the sun's disc. Below the
    /// horizon it is that of the ground. For many directions, evaluate [`Daylight::model`] instead.
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        self.model().radiance(direction)
    }

    /// The struct that shaders read, with the irradiance of sky and ground (without the sun's disc) in spherical harmonics.
    pub fn to_gpu(&self) -> Sky {
        let model = self.model();
        let radius = 0.5 * self.sun_angular_diameter as f64;
        let solid_angle = 2.0 * PI * (1.0 - radius.cos());
        let has_disc = self.to_sun.y > 0.0 && solid_angle > 0.0;
        let disc = if has_disc { self.sun_illuminance.as_dvec3() / solid_angle } else { DVec3::ZERO };
        let floats = |k: usize| model.perez[k].map(|v| v as f32);
        Sky {
            to_sun: model.to_sun.as_vec3().to_array(),
            perez_y_luminance: floats(0),
            perez_x: floats(1),
            perez_y: floats(2),
            zenith: model.zenith.as_vec3().to_array(),
            ground: model.ground.as_vec3().to_array(),
            sun_radiance: disc.as_vec3().to_array(),
            sun_cos_radius: if has_disc { radius.cos() as f32 } else { 2.0 },
            environment: SampledImage::NONE,
            environment_sampler: SamplerId::default(),
            environment_scale: 0.0,
            environment_turn: [0.0, 1.0],
            irradiance_sh: model.irradiance_sh().map(|c| c.as_vec3().to_array()),
        }
    }
}

impl SkyModel {
    /// Radiance from a direction (which need not be unit length), linear Rec.709, at least 0.
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        let direction = direction.as_dvec3().normalize_or(DVec3::Y);
        (if direction.y < 0.0 { self.ground } else { self.sky(direction) }).as_vec3()
    }

    fn xyy(&self, direction: DVec3) -> DVec3 {
        let cos_gamma = direction.dot(self.to_sun);
        self.zenith * DVec3::from_array(self.perez.map(|c| perez_function(&c, direction.y, cos_gamma)))
    }

    fn sky(&self, direction: DVec3) -> DVec3 {
        let v = self.xyy(direction);
        let xyz = DVec3::new(v.y, v.z, 1.0 - v.y - v.z) * (v.x / v.z);
        let xyz = DVec3::new(xyz.x, v.x, xyz.z);
        // XYZ to linear Rec.709 with white point D65 (IEC 61966-2-1). Negative components of colours outside the gamut are clipped.
        let rec709_from_xyz = DMat3::from_cols(
            DVec3::new(3.2404542, -0.9692660, 0.0556434),
            DVec3::new(-1.5371385, 1.8760108, -0.2040259),
            DVec3::new(-0.4985314, 0.0415560, 1.0572252),
        );
        (rec709_from_xyz * xyz).max(DVec3::ZERO)
    }

    /// Order-2 coefficients `c` with `E(n) = sum c_i Y_i(n)`: Ramamoorthi and Hanrahan, "An Efficient Representation for
    /// Irradiance Environment Maps", SIGGRAPH 2001. The order is [`sh_basis`]'s.
    fn irradiance_sh(&self) -> [DVec3; 9] {
        let mut c = [DVec3::ZERO; 9];
        for (up, solid_angle) in hemisphere() {
            for (direction, radiance) in [(up, self.sky(up)), (DVec3::new(up.x, -up.y, up.z), self.ground)] {
                for (c, y) in c.iter_mut().zip(sh_basis(direction)) {
                    *c += radiance * (y * solid_angle);
                }
            }
        }
        cosine_lobe(c)
    }
}

/// Irradiance from radiance, both in coefficients in the order of [`sh_basis`]: multiplies each with A_l of the clamped cosine,
/// equation 8 of the paper: pi, 2 pi / 3, pi / 4.
pub(super) fn cosine_lobe(mut c: [DVec3; 9]) -> [DVec3; 9] {
    for (i, c) in c.iter_mut().enumerate() {
        *c *= [PI, 2.0 * PI / 3.0, 0.25 * PI][[0, 1, 1, 1, 2, 2, 2, 2, 2][i]];
    }
    c
}

/// F of Perez, for the cosines of the angles to the zenith and to the sun.
fn perez_function(&[a, b, c, d, e]: &[f64; 5], cos_theta: f64, cos_gamma: f64) -> f64 {
    let cos_gamma = cos_gamma.clamp(-1.0, 1.0);
    (1.0 + a * (b / cos_theta.max(MIN_COS_THETA)).exp())
        * (1.0 + c * (d * cos_gamma.acos()).exp() + e * cos_gamma * cos_gamma)
}

/// Real spherical harmonics up to order 2 of a unit direction, in the order
/// `1, y, z, x, xy, yz, 3 z^2 - 1, xz, x^2 - y^2` (l, m from -l to l).
pub(super) fn sh_basis(d: DVec3) -> [f64; 9] {
    [
        0.282095,
        0.488603 * d.y,
        0.488603 * d.z,
        0.488603 * d.x,
        1.092548 * d.x * d.y,
        1.092548 * d.y * d.z,
        0.315392 * (3.0 * d.z * d.z - 1.0),
        1.092548 * d.x * d.z,
        0.546274 * (d.x * d.x - d.y * d.y),
    ]
}

/// Directions over the upper hemisphere with their solid angles: equal steps in the angle to the zenith, with exact weights.
fn hemisphere() -> impl Iterator<Item = (DVec3, f64)> {
    (0..RINGS).flat_map(|ring| {
        let edge = |i: usize| (i as f64 / RINGS as f64 * 0.5 * PI).cos();
        let (sin, cos) = ((ring as f64 + 0.5) / RINGS as f64 * 0.5 * PI).sin_cos();
        let solid_angle = 2.0 * PI * (edge(ring) - edge(ring + 1)) / STEPS as f64;
        (0..STEPS).map(move |step| {
            let (s, c) = ((step as f64 + 0.5) / STEPS as f64 * 2.0 * PI).sin_cos();
            (DVec3::new(sin * c, cos, sin * s), solid_angle)
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(elevation_degrees: f32, turbidity: f32) -> Daylight {
        let (s, c) = elevation_degrees.to_radians().sin_cos();
        let (sa, ca) = 0.6_f32.sin_cos();
        Daylight { to_sun: Vec3::new(c * ca, s, c * sa), turbidity, ..Daylight::default() }
    }

    /// Uniform directions over the sphere from a Fibonacci lattice, as a quadrature independent of the one under test.
    fn sphere(n: usize) -> impl Iterator<Item = Vec3> {
        (0..n).map(move |i| {
            let y = 1.0 - 2.0 * (i as f64 + 0.5) / n as f64;
            let (s, c) = (i as f64 * PI * (3.0 - 5.0_f64.sqrt())).sin_cos();
            let r = (1.0 - y * y).sqrt();
            DVec3::new(r * c, y, r * s).as_vec3()
        })
    }

    #[test]
    fn horizontal_irradiance_is_as_asked() {
        for (elevation, turbidity) in [(0.0, 2.0), (10.0, 3.0), (50.0, 2.5), (90.0, 6.0), (-20.0, 2.5)] {
            let daylight = Daylight { irradiance: 1.7, ..at(elevation, turbidity) };
            let model = daylight.model();
            let n = 100_000;
            let mut sum = 0.0_f64;
            for d in sphere(n).filter(|d| d.y > 0.0) {
                sum += model.radiance(d).dot(Vec3::new(0.2126, 0.7152, 0.0722)) as f64 * d.y as f64;
            }
            let got = sum * 4.0 * PI / n as f64;
            assert!((got / 1.7 - 1.0).abs() < 0.01, "{elevation} degrees, turbidity {turbidity}: {got}");
        }
    }

    #[test]
    fn every_direction_is_finite_and_not_negative() {
        for elevation in 0..=90 {
            for turbidity in [0.0, 1.9, 2.5, 6.0, 10.0, 50.0] {
                let daylight = at(elevation as f32, turbidity);
                let model = daylight.model();
                for d in sphere(400).chain([Vec3::Y, Vec3::X, -Vec3::Y, Vec3::Z, daylight.to_sun]) {
                    let r = model.radiance(d);
                    assert!(r.is_finite() && r.min_element() >= 0.0, "{elevation} {turbidity} {d}: {r}");
                }
            }
        }
    }

    #[test]
    fn harmonics_agree_with_brute_force() {
        for elevation in [15.0, 50.0, 80.0] {
            let daylight = at(elevation, 2.8);
            let (model, sky) = (daylight.model(), daylight.to_gpu());
            let n = 20_000;
            let radiance: Vec<(Vec3, Vec3)> = sphere(n).map(|d| (d, model.radiance(d))).collect();
            let greatest = 4.0 * PI as f32 / n as f32;
            let mut sum = 0.0;
            for normal in sphere(40) {
                let brute: Vec3 = radiance.iter().map(|(d, r)| *r * d.dot(normal).max(0.0)).sum::<Vec3>() * greatest;
                let basis = sh_basis(normal.as_dvec3());
                let ours: Vec3 = sky.irradiance_sh.iter().zip(basis).map(|(c, y)| Vec3::from(*c) * y as f32).sum();
                let error = ((ours - brute) / brute).abs().max_element();
                // Error bounds of the paper: 9 % at most, 3 % on average.
                assert!(error < 0.09, "{elevation} degrees, normal {normal}: {ours} against {brute}");
                sum += error;
            }
            assert!(sum / 40.0 < 0.03, "{elevation} degrees: mean error {}", sum / 40.0);
        }
    }

    #[test]
    fn the_disc_carries_the_suns_illuminance() {
        let daylight = at(40.0, 2.5);
        let sky = daylight.to_gpu();
        // The solid angle of a cap with angular radius r is 4 pi sin^2(r / 2).
        let solid_angle = 4.0 * PI * (0.25 * daylight.sun_angular_diameter as f64).sin().powi(2);
        let got = Vec3::from(sky.sun_radiance) * solid_angle as f32;
        assert!(got.abs_diff_eq(daylight.sun_illuminance, 1e-3), "{got}");
        assert!(sky.sun_cos_radius < 1.0);
        let night = at(-5.0, 2.5).to_gpu();
        assert!(night.sun_cos_radius > 1.0 && night.sun_radiance == [0.0; 3]);
    }

    #[test]
    fn the_sky_is_blue_and_brightest_around_the_sun() {
        let daylight = at(40.0, 2.5);
        let model = daylight.model();
        let zenith = model.radiance(Vec3::Y);
        assert!(zenith.z > 1.5 * zenith.x, "{zenith}");
        let away = Vec3::new(-daylight.to_sun.x, daylight.to_sun.y, -daylight.to_sun.z);
        assert!(model.radiance(daylight.to_sun).y > 2.0 * model.radiance(away).y);
    }
}
