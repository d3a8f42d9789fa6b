//! Directional albedo of the specular lobe by numerical integration.
use super::shading::{smith_g2, smith_lambda};
use glam::DVec3;
use std::f64::consts::TAU;

/// The integrals of `D V n.l (1 - c)` and `D V n.l c` with `c = (1 - v.h)^5` over all directions of light, for a viewer at the cosine `n_v`,
/// above 0. They are summed over a regular grid of `grid` by `grid` visible normals (Heitz 2018, "Sampling the GGX Distribution of Visible
/// Normals").
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
            let (radius, angle) = (u[0].sqrt(), TAU * u[1]);
            let x = radius * angle.cos();
            let s = 0.5 * (1.0 + stretched.z);
            let y = (1.0 - s) * (1.0 - x * x).sqrt() + s * radius * angle.sin();
            let disc = x * across + y * up + (1.0 - x * x - y * y).max(0.0).sqrt() * stretched;
            let h = DVec3::new(alpha * disc.x, alpha * disc.y, disc.z.max(0.0)).normalize();
            let l = 2.0 * v.dot(h) * h - v;
            if l.z > 0.0 {
                let weight = masked * smith_g2(n_v, l.z, alpha);
                let c = (1.0 - v.dot(h)).clamp(0.0, 1.0).powi(5);
                sums[0] += weight * (1.0 - c);
                sums[1] += weight * c;
            }
        }
    }
    sums.map(|sum| sum / f64::from(grid * grid))
}
