//! Distant light: sky and environment maps.
use super::lights::luminance;
use super::random::{Random, from_polar};
use glam::DVec3;
use magpie::scene::{Environment, Scene, SkyModel};
use std::f64::consts::{PI, TAU};

/// Least number of columns of the sampling table; half as many rows.
const COLUMNS: usize = 128;
/// Least weight of a cell of the sampling table, relative to the mean.
const FLOOR: f64 = 0.01;

enum Source {
    Daylight { model: SkyModel, to_sun: DVec3, disc: DVec3, cosine: f64 },
    Environment(Environment),
}

/// Sky or environment map, with a table for sampling. Its cells are uniform in longitude and latitude, with the pole at +y.
pub struct Sky {
    source: Source,
    columns: usize,
    rows: usize,
    /// Cumulative probabilities of the cells, row by row.
    sums: Vec<f64>,
}

impl Sky {
    /// The sky of a scene, if it has any.
    pub fn new(scene: &Scene) -> Option<Self> {
        let source = match (&scene.environment, &scene.daylight) {
            (Some(environment), _) => Source::Environment(environment.clone()),
            (None, Some(daylight)) => {
                let gpu = daylight.to_gpu();
                Source::Daylight {
                    model: daylight.model(),
                    to_sun: DVec3::from(gpu.to_sun.map(f64::from)).normalize(),
                    disc: DVec3::from(gpu.sun_radiance.map(f64::from)),
                    cosine: gpu.sun_cos_radius.into(),
                }
            }
            (None, None) => return None,
        };
        let columns = match &source {
            Source::Environment(e) => e.width as usize * COLUMNS.div_ceil(e.width as usize),
            Source::Daylight { .. } => COLUMNS,
        };
        let rows = match &source {
            Source::Environment(e) => e.height as usize * (COLUMNS / 2).div_ceil(e.height as usize),
            Source::Daylight { .. } => COLUMNS / 2,
        };
        let mut sky = Self { source, columns, rows, sums: Vec::new() };
        let cell = |i: usize| {
            let points = (0..9).map(|p| {
                let u = ((i % columns) as f64 + (p % 3) as f64 * 0.5) / columns as f64;
                let v = ((i / columns) as f64 + 0.05 + (p / 3) as f64 * 0.45) / rows as f64;
                luminance(sky.radiance(direction_of(u, v)))
            });
            points.sum::<f64>() / 9.0
        };
        let seen: Vec<f64> = (0..columns * rows).map(cell).collect();
        let floor = (FLOOR * seen.iter().sum::<f64>() / seen.len() as f64).max(f64::MIN_POSITIVE);
        let weights: Vec<f64> = (0..seen.len()).map(|i| (seen[i] + floor) * sky.solid_angle(i / columns)).collect();
        let total: f64 = weights.iter().sum();
        let mut sum = 0.0;
        sky.sums = weights
            .iter()
            .map(|w| {
                sum += w / total;
                sum
            })
            .collect();
        Some(sky)
    }

    /// Radiance from a unit direction, without the sun's disc.
    pub fn radiance(&self, direction: DVec3) -> DVec3 {
        match &self.source {
            Source::Daylight { model, .. } => model.radiance(direction.as_vec3()).as_dvec3(),
            Source::Environment(environment) => looked_up(environment, direction),
        }
    }

    /// Radiance that a camera sees, with the sun's disc.
    pub fn seen(&self, direction: DVec3) -> DVec3 {
        let sun = match &self.source {
            Source::Daylight { to_sun, disc, cosine, .. }
                if direction.y >= 0.0 && direction.dot(*to_sun) >= *cosine =>
            {
                *disc
            }
            _ => DVec3::ZERO,
        };
        self.radiance(direction) + sun
    }

    /// Samples a direction; returns it with its pdf per steradian.
    pub fn draw(&self, random: &mut Random) -> (DVec3, f64) {
        let x = random.unit();
        let cell = self.sums.partition_point(|s| *s <= x).min(self.sums.len() - 1);
        let u = ((cell % self.columns) as f64 + random.unit()) / self.columns as f64;
        let (top, bottom) = self.edges(cell / self.columns);
        let y = top + (bottom - top) * random.unit();
        let around = from_polar(y, TAU * (u - 0.5));
        // from_polar has its pole at +z; the middle of the image is at -z.
        let direction = DVec3::new(around.y, y, -around.x);
        (direction, self.of_cell(cell))
    }

    /// Pdf of [`draw`](Self::draw), per steradian.
    pub fn density(&self, direction: DVec3) -> f64 {
        let [u, v] = coordinates(direction);
        let column = ((u * self.columns as f64) as usize).min(self.columns - 1);
        let row = ((v * self.rows as f64) as usize).min(self.rows - 1);
        self.of_cell(row * self.columns + column)
    }

    fn of_cell(&self, cell: usize) -> f64 {
        let before = if cell > 0 { self.sums[cell - 1] } else { 0.0 };
        (self.sums[cell] - before) / self.solid_angle(cell / self.columns)
    }

    /// Cosines of the polar angles at which a row begins and ends.
    fn edges(&self, row: usize) -> (f64, f64) {
        let cosine = |row: usize| (PI * row as f64 / self.rows as f64).cos();
        (cosine(row), cosine(row + 1))
    }

    /// Solid angle of each cell in a row.
    fn solid_angle(&self, row: usize) -> f64 {
        let (top, bottom) = self.edges(row);
        TAU * (top - bottom) / self.columns as f64
    }
}

/// Longitude and latitude, 0 to 1: the middle is -z, the top is +y.
fn coordinates(direction: DVec3) -> [f64; 2] {
    let u = direction.x.atan2(-direction.z) / TAU + 0.5;
    [u, direction.y.clamp(-1.0, 1.0).acos() / PI]
}

fn direction_of(u: f64, v: f64) -> DVec3 {
    let ((sin_p, cos_p), (sin_t, cos_t)) = ((TAU * (u - 0.5)).sin_cos(), (PI * v).sin_cos());
    DVec3::new(sin_p * sin_t, cos_t, -cos_p * sin_t)
}

/// Bilinear lookup between texel centres, repeated horizontally; the first and last row extend to the poles.
fn looked_up(environment: &Environment, direction: DVec3) -> DVec3 {
    let (s, c) = f64::from(environment.turn).sin_cos();
    // The inverse rotation: a positive turn takes z to x, so this takes x to z.
    let image = DVec3::new(c * direction.x - s * direction.z, direction.y, s * direction.x + c * direction.z);
    let [u, v] = coordinates(image);
    let (width, height) = (environment.width as i64, environment.height as i64);
    let (x, y) = (u * width as f64 - 0.5, v * height as f64 - 0.5);
    let texel = |x: i64, y: i64| {
        let at = y.clamp(0, height - 1) * width + x.rem_euclid(width);
        environment.radiance[at as usize].as_dvec3()
    };
    let (column, row) = (x.floor() as i64, y.floor() as i64);
    let across = |row: i64| texel(column, row).lerp(texel(column + 1, row), x - x.floor());
    across(row).lerp(across(row + 1), y - y.floor()) * f64::from(environment.scale)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, Vec3};
    use magpie::scene::Daylight;

    fn environment(width: u32, height: u32, turn: f32) -> Environment {
        let radiance = (0..width * height).map(|i| Vec3::new((i * 7 % 5) as f32, (i % 3) as f32, 0.5)).collect();
        Environment { name: "test".into(), width, height, radiance, scale: 1.5, turn }
    }

    #[test]
    fn the_middle_of_the_image_is_ahead() {
        let e = environment(8, 4, 0.0);
        // Between the four texels around the middle.
        let around = [(3, 1), (4, 1), (3, 2), (4, 2)].map(|(x, y)| e.radiance[y * 8 + x].as_dvec3());
        let want = around.into_iter().sum::<DVec3>() * 0.25 * 1.5;
        assert!(looked_up(&e, DVec3::NEG_Z).abs_diff_eq(want, 1e-12));
        // The centre of one texel.
        let at = looked_up(&e, direction_of(6.5 / 8.0, 1.5 / 4.0));
        assert!(at.abs_diff_eq(e.radiance[8 + 6].as_dvec3() * 1.5, 1e-12), "{at}");
        assert!(direction_of(0.75, 0.5).abs_diff_eq(DVec3::X, 1e-12));
        // Rotated, the image gives the same in a direction that is rotated likewise.
        let turned = Environment { turn: 0.7, ..e.clone() };
        let d = DVec3::new(0.3, 0.4, -0.5).normalize();
        let there = DQuat::from_rotation_y(f64::from(0.7_f32)) * d;
        assert!(looked_up(&turned, there).abs_diff_eq(looked_up(&e, d), 1e-9));
    }

    #[test]
    fn directions_are_drawn_as_their_density_says() {
        let daylight = Scene { daylight: Some(Daylight::default()), ..Scene::default() };
        let image = Scene { environment: Some(environment(6, 3, 0.4)), ..Scene::default() };
        for scene in [daylight, image] {
            let sky = Sky::new(&scene).unwrap();
            let (n, mut random) = (200_000, Random::new(3, 0));
            // Integrals of 1, x + 1 and radiance, by importance sampling and by uniform sampling.
            let (mut sums, mut plain) = ([0.0; 3], DVec3::ZERO);
            for _ in 0..n {
                let (d, density) = sky.draw(&mut random);
                assert!((sky.density(d) / density - 1.0).abs() < 1e-9, "{d}");
                sums[0] += 1.0 / density;
                sums[1] += (d.x + d.y + 1.0) / density;
                sums[2] += luminance(sky.radiance(d)) / density;
                plain += sky.radiance(random.direction()) * 4.0 * PI;
            }
            let means = sums.map(|s| s / f64::from(n));
            for mean in &means[..2] {
                assert!((mean / (4.0 * PI) - 1.0).abs() < 0.03, "{means:?}");
            }
            let want = luminance(plain) / f64::from(n);
            assert!((means[2] / want - 1.0).abs() < 0.01, "{means:?}, {want}");
        }
    }
}
