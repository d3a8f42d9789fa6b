//! A table with a still life.
use super::super::shapes::{Shape, curve, lathe, line, sphere};
use super::super::stage::{Stage, at, dielectric};
use super::{Palette, SUNK};
use glam::{Affine3A, Vec3};
use std::f32::consts::PI;

/// A table with a still life, in the foreground.
pub(super) fn table(stage: &mut Stage, p: &Palette) {
    let place = at(2.05, -SUNK, 3.25, 0.0);
    let top = 0.74;
    let stand = lathe(
        &[
            line(&[[0.0, 0.0], [0.36, 0.0]]),
            line(&[[0.36, 0.0], [0.36, 0.05]]),
            curve(&[[0.36, 0.05], [0.22, 0.09], [0.12, 0.18], [0.10, 0.40], [0.13, 0.60], [0.24, 0.69]], 3),
            line(&[[0.24, 0.69], [0.66, 0.69]]),
            curve(&[[0.66, 0.69], [0.685, 0.70], [0.69, 0.72], [0.68, 0.737], [0.66, top]], 3),
            line(&[[0.66, top], [0.0, top]]),
        ],
        48,
    );
    stage.add("table", stand, p.pale, place);
    let on = |x: f32, z: f32| place * Affine3A::from_translation(Vec3::new(x, top - 0.001, z));

    // A tall glazed vase.
    let vase = lathe(
        &[
            line(&[[0.0, 0.0], [0.062, 0.0]]),
            curve(
                &[
                    [0.062, 0.0],
                    [0.085, 0.03],
                    [0.128, 0.15],
                    [0.105, 0.27],
                    [0.045, 0.37],
                    [0.040, 0.42],
                    [0.062, 0.46],
                ],
                5,
            ),
            curve(&[[0.062, 0.46], [0.060, 0.464], [0.055, 0.46]], 2),
            curve(&[[0.055, 0.46], [0.034, 0.42], [0.036, 0.37], [0.0, 0.34]], 2),
        ],
        32,
    );
    let vase = stage.mesh("vase", vase);
    stage.put(vase, p.cobalt, on(-0.30, -0.26));

    // A copper kettle: body with lid, spout, and a bail of iron.
    let mut kettle = lathe(
        &[
            line(&[[0.0, 0.0], [0.095, 0.0]]),
            curve(&[[0.095, 0.0], [0.118, 0.012], [0.142, 0.065], [0.132, 0.125], [0.090, 0.168], [0.062, 0.178]], 3),
            curve(&[[0.062, 0.178], [0.066, 0.186], [0.050, 0.198], [0.016, 0.207]], 3),
            curve(&[[0.016, 0.207], [0.010, 0.216], [0.020, 0.228], [0.017, 0.239], [0.0, 0.243]], 3),
        ],
        30,
    );
    let spout = tube(&[[0.115, 0.070], [0.175, 0.085], [0.200, 0.140], [0.245, 0.195]], [0.032, 0.013], 12, 12);
    kettle.join(&spout, Affine3A::IDENTITY);
    let bail = tube(
        &[
            [-0.098, 0.160],
            [-0.112, 0.235],
            [-0.070, 0.300],
            [0.0, 0.322],
            [0.070, 0.300],
            [0.112, 0.235],
            [0.098, 0.160],
        ],
        [0.0085, 0.0085],
        24,
        8,
    );
    let kettle_at = on(0.20, -0.16) * Affine3A::from_rotation_y(0.5);
    stage.add("kettle", kettle, p.copper, kettle_at);
    stage.add("bail", bail, p.iron, kettle_at);
    let cup = lathe(
        &[
            line(&[[0.0, 0.0], [0.026, 0.0]]),
            curve(&[[0.026, 0.0], [0.040, 0.015], [0.049, 0.045], [0.053, 0.070]], 3),
            curve(&[[0.053, 0.070], [0.052, 0.072], [0.049, 0.070]], 2),
            curve(&[[0.049, 0.070], [0.044, 0.042], [0.032, 0.018], [0.0, 0.012]], 2),
        ],
        26,
    );
    let cup = stage.mesh("cup", cup);
    stage.put(cup, p.white, on(0.42, 0.12));
    stage.put(cup, p.cobalt, on(0.27, 0.30));

    // A bowl of oranges.
    let bowl = lathe(
        &[
            line(&[[0.0, 0.0], [0.075, 0.0]]),
            curve(&[[0.075, 0.0], [0.13, 0.025], [0.185, 0.075], [0.205, 0.125]], 4),
            curve(&[[0.205, 0.125], [0.204, 0.129], [0.199, 0.126]], 2),
            curve(&[[0.199, 0.126], [0.178, 0.080], [0.12, 0.032], [0.0, 0.014]], 4),
        ],
        36,
    );
    stage.add("steel bowl", bowl, p.steel, on(-0.20, 0.20));
    let orange = stage.material(dielectric("orange peel", [0.83, 0.30, 0.025], 0.35));
    let lemon = stage.material(dielectric("lemon peel", [0.86, 0.66, 0.06], 0.35));
    let fruit = stage.mesh("fruit", sphere(0.05, 12, 18));
    for (x, y, z, peel) in [
        (-0.062, 0.076, 0.02, orange),
        (0.052, 0.078, 0.045, orange),
        (0.0, 0.076, -0.068, lemon),
        (-0.012, 0.147, 0.0, orange),
    ] {
        stage.put(fruit, peel, on(-0.20 + x, 0.20 + z) * Affine3A::from_translation(Vec3::Y * y));
    }
    let red = stage.material(dielectric("red lacquer", [0.58, 0.022, 0.018], 0.08));
    let ball = sphere(0.075, 16, 26);
    stage.add("red ball", ball, red, on(0.06, 0.42) * Affine3A::from_translation(Vec3::Y * 0.075));

    // Two stools.
    let stool = lathe(
        &[
            line(&[[0.0, 0.0], [0.17, 0.0]]),
            curve(&[[0.17, 0.0], [0.21, 0.08], [0.235, 0.22], [0.21, 0.36], [0.175, 0.43]], 3),
            curve(&[[0.175, 0.43], [0.165, 0.445], [0.14, 0.45]], 3),
            line(&[[0.14, 0.45], [0.0, 0.45]]),
        ],
        30,
    );
    let stool = stage.mesh("stool", stool);
    stage.put(stool, p.cobalt, at(3.2, -SUNK, 2.75, 0.0));
    stage.put(stool, p.terracotta, at(2.0, -SUNK, 2.1, 0.0));
}

/// A tube with closed ends along a curve in the plane z = 0. Its radius changes linearly from the first value to the last.
fn tube(points: &[[f32; 2]], radius: [f32; 2], rings: usize, segments: usize) -> Shape {
    let steps = rings.div_ceil(points.len() - 1);
    let path = curve_signed(points, steps);
    let mut shape = Shape::default();
    let mut before: Option<Vec<u32>> = None;
    let last = path.len() - 1;
    for (i, point) in path.iter().enumerate() {
        let along = (path[(i + 1).min(last)] - path[i.saturating_sub(1)]).normalize_or(glam::Vec2::X);
        let t = i as f32 / last as f32;
        let r = radius[0] + (radius[1] - radius[0]) * t;
        let side = Vec3::new(along.y, -along.x, 0.0);
        let ring: Vec<u32> = (0..=segments)
            .map(|j| {
                let (s, c) = (j as f32 / segments as f32 * 2.0 * PI).sin_cos();
                let normal = side * c + Vec3::Z * s;
                let uv = glam::Vec2::new(-(j as f32) / segments as f32, -t);
                shape.vertex(point.extend(0.0) + normal * r, normal, uv)
            })
            .collect();
        if let Some(before) = &before {
            for j in 0..segments {
                shape.triangle([before[j], ring[j], ring[j + 1]]);
                shape.triangle([before[j], ring[j + 1], before[j + 1]]);
            }
        }
        if i == 0 || i == last {
            let out = if i == 0 { -along } else { along }.extend(0.0);
            let middle = shape.vertex(point.extend(0.0), out, glam::Vec2::ZERO);
            let rim: Vec<u32> = ring
                .iter()
                .map(|k| {
                    let position = shape.mesh.positions[*k as usize];
                    shape.vertex(position, out, (position - point.extend(0.0)).truncate())
                })
                .collect();
            for pair in rim.windows(2) {
                shape.triangle(if i == 0 { [middle, pair[0], pair[1]] } else { [middle, pair[1], pair[0]] });
            }
        }
        before = Some(ring);
    }
    shape
}

/// [`curve`] for points whose first coordinate may be negative.
fn curve_signed(points: &[[f32; 2]], steps: usize) -> Vec<glam::Vec2> {
    const FAR: f32 = 10.0;
    let moved: Vec<[f32; 2]> = points.iter().map(|[x, y]| [x + FAR, *y]).collect();
    curve(&moved, steps).into_iter().map(|p| p - glam::Vec2::X * FAR).collect()
}
