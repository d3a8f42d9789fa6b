//! Directional albedo of the specular lobe by numerical integration, and the light that scatters more than once.
use super::shading::{smith_g2, smith_lambda};
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::TAU;
use std::sync::LazyLock;

/// The integrals of `D V n.l (1 - c)` and `D V n.l c` with `c = (1 - v.h)^5` over all directions of light, for a viewer at the cosine `n_v`,
/// above 0. They are summed over a grid of `grid` by `grid` visible normals (Heitz 2018, "Sampling the GGX Distribution of Visible Normals"),
/// which is densest where facets are steep: of smooth surfaces only those lose light.
pub fn split_sum(n_v: f64, alpha: f64, grid: u32) -> [f64; 2] {
    let v = DVec3::new((1.0 - n_v * n_v).max(0.0).sqrt(), 0.0, n_v);
    let stretched = DVec3::new(alpha * v.x, 0.0, v.z).normalize();
    let across = DVec3::Y;
    let up = stretched.cross(across);
    let masked = 1.0 + smith_lambda(n_v, alpha);
    let mut sums = [0.0; 2];
    for i in 0..grid {
        for j in 0..grid {
            let u = [i, j].map(|k| (f64::from(k) + 0.5) / f64::from(grid));
            let (rest, density) = (1.0 - u[0], 4.0 * (1.0 - u[0]).powi(3));
            let (radius, angle) = ((1.0 - rest.powi(4)).sqrt(), TAU * u[1]);
            let x = radius * angle.cos();
            let s = 0.5 * (1.0 + stretched.z);
            let y = (1.0 - s) * (1.0 - x * x).sqrt() + s * radius * angle.sin();
            let disc = x * across + y * up + (1.0 - x * x - y * y).max(0.0).sqrt() * stretched;
            let h = DVec3::new(alpha * disc.x, alpha * disc.y, disc.z.max(0.0)).normalize();
            let l = 2.0 * v.dot(h) * h - v;
            if l.z > 0.0 {
                let weight = density * masked * smith_g2(n_v, l.z, alpha);
                let c = (1.0 - v.dot(h)).clamp(0.0, 1.0).powi(5);
                sums[0] += weight * (1.0 - c);
                sums[1] += weight * c;
            }
        }
    }
    sums.map(|sum| sum / f64::from(grid * grid))
}

/// Entries of [`AGAIN`] along the fourth root of the cosine and along the root of alpha.
const COLUMNS: usize = 129;
const ROWS: usize = 65;
/// The least root of alpha.
static LEAST: LazyLock<f64> = LazyLock::new(|| super::shading::MIN_ALPHA.sqrt());

/// `1 / E - 1` at even steps of these roots, the first from 0, the second from its least, to 1.
static AGAIN: LazyLock<Vec<f64>> = LazyLock::new(|| {
    let one = |at: usize| {
        let [x, y] = [at % COLUMNS, at / COLUMNS].map(|k| k as f64);
        let (root, rough) = (x / (COLUMNS - 1) as f64, *LEAST + (1.0 - *LEAST) * y / (ROWS - 1) as f64);
        let [a, b] = split_sum(root.powi(4).max(1e-6), rough * rough, 128);
        1.0 / (a + b) - 1.0
    };
    (0..COLUMNS * ROWS).into_par_iter().map(one).collect()
});

/// Light that scatters more than once between microfacets that reflect all of it, over the light that scatters once: `1 / E - 1`.
pub fn again(n_v: f64, alpha: f64) -> f64 {
    let place = |x: f64, count: usize| {
        let x = x.clamp(0.0, 1.0) * (count - 1) as f64;
        let low = (x as usize).min(count - 2);
        (low, x - low as f64)
    };
    let ((column, right), (row, up)) =
        (place(n_v.max(0.0).sqrt().sqrt(), COLUMNS), place((alpha.sqrt() - *LEAST) / (1.0 - *LEAST), ROWS));
    let along = |row: usize| {
        let first = row * COLUMNS + column;
        AGAIN[first] * (1.0 - right) + AGAIN[first + 1] * right
    };
    along(row) * (1.0 - up) + along(row + 1) * up
}
