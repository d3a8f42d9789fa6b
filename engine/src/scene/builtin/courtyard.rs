//! A small courtyard in the afternoon sun: sand, terracotta and green against cobalt blue.
//!
//! The arcade is at the back (-z), a pergola on the left and a plastered wall on the right; the front is open. The sun is to the
//! left, behind the camera, so that the shadow of the pergola falls across the floor.
use super::foliage::{Random, climber, core, crown, leaf_texture};
use super::shapes::{Shape, arcade, block, curve, cushion, lathe, line, sphere};
use super::stage::{Stage, at, dielectric, matte, metal, scaled};
use crate::scene::{AlphaMode, Daylight, Light, Material, Sampler, Scene, TextureUse, Wrap};
use glam::{Affine3A, Quat, Vec3};
use std::f32::consts::PI;

/// Half the side of the paved square, metres.
const HALF: f32 = 6.0;
/// Depth to which objects are sunk into the ground, metres, so that no bottom face is coplanar with the floor.
const SUNK: f32 = 0.004;

struct Palette {
    plaster: u32,
    stone: u32,
    pale: u32,
    terracotta: u32,
    cobalt: u32,
    wood: u32,
    iron: u32,
    copper: u32,
    steel: u32,
    white: u32,
    leaves: u32,
    olive: u32,
    shade: u32,
    bark: u32,
    soil: u32,
}

fn palette(stage: &mut Stage) -> Palette {
    stage.scene.textures.push(leaf_texture());
    stage.scene.samplers.push(Sampler { wrap: [Wrap::Clamp; 2], ..Sampler::default() });
    let leaves = |name: &str, tint: [f32; 3]| Material {
        base_colour: Vec3::from(tint).extend(1.0),
        alpha: AlphaMode::Mask(0.4),
        double_sided: true,
        base_colour_texture: Some(TextureUse { texture: 0, sampler: 0, uv_set: 0, rows: [Vec3::X, Vec3::Y] }),
        ..dielectric(name, [1.0; 3], 0.55)
    };
    Palette {
        plaster: stage.material(matte("sand plaster", [0.66, 0.55, 0.41])),
        stone: stage.material(dielectric("limestone", [0.62, 0.57, 0.49], 0.75)),
        pale: stage.material(dielectric("pale limestone", [0.76, 0.72, 0.64], 0.65)),
        terracotta: stage.material(matte("terracotta plaster", [0.66, 0.31, 0.17])),
        cobalt: stage.material(dielectric("cobalt glaze", [0.022, 0.075, 0.42], 0.18)),
        wood: stage.material(dielectric("weathered wood", [0.33, 0.22, 0.13], 0.7)),
        iron: stage.material(metal("iron", [0.30, 0.29, 0.28], 0.55)),
        copper: stage.material(metal("copper", [0.955, 0.638, 0.538], 0.16)),
        steel: stage.material(metal("brushed steel", [0.67, 0.66, 0.64], 0.32)),
        white: stage.material(dielectric("white glaze", [0.80, 0.79, 0.75], 0.10)),
        leaves: stage.material(leaves("leaves", [0.90, 1.0, 0.80])),
        olive: stage.material(leaves("olive leaves", [0.85, 0.88, 0.95])),
        shade: stage.material(matte("inner leaves", [0.035, 0.060, 0.020])),
        bark: stage.material(matte("bark", [0.20, 0.14, 0.10])),
        soil: stage.material(matte("soil", [0.09, 0.06, 0.04])),
    }
}

pub(super) fn scene() -> Scene {
    let mut stage = Stage::new("courtyard");
    let p = palette(&mut stage);
    ground(&mut stage);
    walls(&mut stage, &p);
    pergola(&mut stage, &p);
    fountain(&mut stage, &p);
    table(&mut stage, &p);
    bench(&mut stage, &p);
    pots(&mut stage, &p);
    plants(&mut stage, &p);

    let to_sun = Vec3::new(-0.62, 0.72, 0.46).normalize();
    let daylight = Daylight {
        to_sun,
        turbidity: 2.6,
        ground_albedo: Vec3::new(0.30, 0.26, 0.20),
        sun_illuminance: Vec3::new(5.0, 4.5, 3.8),
        ..Daylight::default()
    };
    let sun = daylight.sun();
    stage.scene.lights.insert(0, sun);
    stage.scene.daylight = Some(daylight);
    stage.camera("default", [-1.55, 1.72, 8.1], [0.33, 1.2, -0.9], 40.0);
    stage.camera("close", [0.70, 1.36, 5.35], [1.92, 0.86, 3.2], 36.0);
    stage.scene
}

/// Slabs with open joints on a bed of sand, with dry grass around.
fn ground(stage: &mut Stage) {
    let tones = [[0.52, 0.46, 0.38], [0.58, 0.52, 0.43], [0.46, 0.41, 0.35], [0.60, 0.50, 0.39], [0.50, 0.47, 0.43]];
    let tones: Vec<u32> = (0..)
        .zip(tones)
        .map(|(i, c)| stage.material(dielectric(&format!("paving {i}"), c, 0.72 + 0.04 * i as f32)))
        .collect();
    let bed = stage.material(matte("joints", [0.27, 0.23, 0.18]));
    let grass = stage.material(matte("dry grass", [0.30, 0.29, 0.13]));
    let slab = stage.mesh("slab", block(0.985, 0.10, 0.985, 0.008));
    let mut random = Random::new(7);
    for z in 0..12 {
        for x in 0..12 {
            let tone = tones[(random.range(0.0, 4.999)) as usize];
            // Slabs are slightly uneven.
            let height = -0.10 - random.range(0.0, 0.003);
            stage.put(slab, tone, at(x as f32 - HALF + 0.5, height, z as f32 - HALF + 0.5, 0.0));
        }
    }
    let plane = |size: f32| {
        let mut shape = Shape::default();
        let h = 0.5 * size;
        shape.quad([Vec3::new(-h, 0.0, h), Vec3::new(h, 0.0, h), Vec3::new(h, 0.0, -h), Vec3::new(-h, 0.0, -h)]);
        shape
    };
    stage.add("bed", block(12.2, 0.10, 12.2, 0.02), bed, at(0.0, -0.115, 0.0, 0.0));
    stage.add("grass", plane(160.0), grass, at(0.0, -0.06, 0.0, 0.0));
}

fn walls(stage: &mut Stage, p: &Palette) {
    // The arcade at the back, three arches wide.
    let openings = [[-3.7, 1.05], [0.0, 1.45], [3.7, 1.05]];
    stage.add("arcade", arcade(12.4, 4.1, 0.5, &openings, 1.75), p.plaster, at(0.0, -SUNK, -HALF, 0.0));
    stage.add("arcade coping", block(12.7, 0.16, 0.74, 0.03), p.pale, at(0.0, 4.1 - 2.0 * SUNK, -HALF, 0.0));
    let impost = stage.mesh("impost", block(0.26, 0.12, 0.62, 0.02));
    for [centre, half] in openings {
        for side in [-1.0, 1.0] {
            stage.put(impost, p.pale, at(centre + side * (half + 0.06), 1.66, -HALF, 0.0));
        }
    }
    // The terracotta wall on the right with a cobalt door.
    stage.add("right wall", block(0.4, 3.1, 11.5, 0.02), p.terracotta, at(HALF + 0.1, -SUNK, -0.02, 0.0));
    stage.add("right coping", block(0.62, 0.14, 11.7, 0.03), p.pale, at(HALF + 0.1, 3.1 - 2.0 * SUNK, -0.02, 0.0));
    stage.add("door frame", block(0.16, 2.35, 1.36, 0.02), p.pale, at(HALF - 0.13, -SUNK, -2.2, 0.0));
    stage.add("door", block(0.10, 2.18, 1.08, 0.015), p.cobalt, at(HALF - 0.19, -SUNK, -2.2, 0.0));
    let panel = stage.mesh("door panel", block(0.03, 0.82, 0.36, 0.012));
    for (y, z) in [(0.22, -2.46), (0.22, -1.94), (1.18, -2.46), (1.18, -1.94)] {
        stage.put(panel, p.cobalt, at(HALF - 0.245, y, z, 0.0));
    }
    stage.add("door knob", sphere(0.035, 10, 16), p.copper, at(HALF - 0.275, 1.08, -1.76, 0.0));
    stage.add("step", block(0.55, 0.12, 1.5, 0.02), p.stone, at(HALF - 0.35, -SUNK, -2.2, 0.0));
    // A low wall on the left, behind the pergola.
    stage.add("left wall", block(0.36, 0.95, 11.5, 0.02), p.plaster, at(-HALF - 0.1, -SUNK, -0.02, 0.0));
    stage.add("left coping", block(0.54, 0.10, 11.7, 0.025), p.pale, at(-HALF - 0.1, 0.95 - 2.0 * SUNK, -0.02, 0.0));
}

/// Two rows of columns with beams, rafters and a climber, and the lantern.
fn pergola(stage: &mut Stage, p: &Palette) {
    let shaft = curve(&[[0.150, 0.20], [0.152, 0.9], [0.140, 1.6], [0.120, 2.24]], 2);
    let column = lathe(
        &[
            line(&[[0.0, 0.0], [0.22, 0.0]]),
            line(&[[0.22, 0.0], [0.22, 0.10]]),
            curve(&[[0.22, 0.10], [0.205, 0.15], [0.165, 0.18], [0.150, 0.20]], 2),
            shaft,
            curve(&[[0.120, 2.24], [0.140, 2.27], [0.185, 2.33], [0.20, 2.38]], 2),
            line(&[[0.20, 2.38], [0.20, 2.46]]),
            line(&[[0.20, 2.46], [0.0, 2.46]]),
        ],
        20,
    );
    let column = stage.mesh("column", column);
    let beam = stage.mesh("beam", block(0.14, 0.18, 8.1, 0.012));
    let rafter = stage.mesh("rafter", block(3.1, 0.13, 0.085, 0.01));
    let rows = [-5.35, -3.15];
    for x in rows {
        for i in 0..4 {
            stage.put(column, p.pale, at(x, -SUNK, -4.3 + 2.45 * i as f32, 0.0));
        }
        stage.put(beam, p.wood, at(x, 2.45, -0.62, 0.0));
    }
    for i in 0..18 {
        stage.put(rafter, p.wood, at(-4.25, 2.62, -4.45 + 0.45 * i as f32, 0.0));
    }
    let vine = stage.mesh("vine", climber(3, Vec3::new(1.3, 0.16, 1.1), Vec3::Y, 220, 0.32));
    for (x, z, turn) in [(-4.5, -3.6, 0.0), (-4.1, -2.1, 120.0), (-4.6, 2.5, 200.0), (-3.7, 2.7, 40.0)] {
        stage.put(vine, p.leaves, at(x, 2.80, z, turn));
    }
    // A garland that hangs into the picture at the top left.
    let garland = stage.mesh("garland", climber(11, Vec3::new(0.22, 0.55, 0.35), Vec3::X, 110, 0.24));
    stage.put(garland, p.leaves, at(-3.12, 2.30, 2.9, 0.0));
    stage.put(garland, p.leaves, at(-3.12, 2.36, 0.65, 75.0));

    let centre = Vec3::new(-3.15, 2.02, -0.85);
    let radius = 0.085;
    let emission = Vec3::new(42.0, 25.0, 9.0);
    let mut glow = dielectric("lantern glass", [0.8, 0.7, 0.5], 0.3);
    glow.emission = emission;
    glow.shows_light = true;
    let glow = stage.material(glow);
    stage.add("lantern glass", sphere(radius, 14, 24), glow, Affine3A::from_translation(centre));
    let cap = lathe(
        &[
            line(&[[0.0, 0.07], [0.10, 0.07]]),
            curve(&[[0.10, 0.07], [0.105, 0.085], [0.06, 0.13], [0.016, 0.155]], 4),
            line(&[[0.016, 0.155], [0.010, 0.44]]),
            line(&[[0.010, 0.44], [0.0, 0.44]]),
        ],
        24,
    );
    stage.add("lantern cap", cap, p.iron, Affine3A::from_translation(centre));
    stage.scene.lights.push(Light::Point {
        // Just below the glass, which would otherwise block its light.
        position: (centre - Vec3::Y * (radius + 0.01)).into(),
        intensity: emission * (PI * radius * radius),
        range: Some(6.0),
    });
}

/// The fountain in the middle: a round basin, a bowl on a foot, and a copper ball.
fn fountain(stage: &mut Stage, p: &Palette) {
    let place = at(0.75, -SUNK, -1.25, 0.0);
    let basin = lathe(
        &[
            line(&[[0.0, 0.0], [1.62, 0.0]]),
            line(&[[1.62, 0.0], [1.62, 0.10]]),
            line(&[[1.62, 0.10], [1.50, 0.13]]),
            line(&[[1.50, 0.13], [1.47, 0.40]]),
            curve(
                &[[1.47, 0.40], [1.56, 0.42], [1.60, 0.47], [1.56, 0.52], [1.48, 0.535], [1.36, 0.53], [1.31, 0.50]],
                3,
            ),
            line(&[[1.31, 0.50], [1.29, 0.12]]),
            line(&[[1.29, 0.12], [0.0, 0.12]]),
        ],
        60,
    );
    stage.add("basin", basin, p.stone, place);
    let water = stage.material(dielectric("water", [0.012, 0.065, 0.075], 0.03));
    let disc = lathe(&[line(&[[1.302, 0.43], [0.0, 0.43]])], 60);
    stage.add("water", disc, water, place);
    let foot = lathe(
        &[
            line(&[[0.34, 0.10], [0.34, 0.50]]),
            curve(&[[0.34, 0.50], [0.28, 0.55], [0.15, 0.66], [0.12, 0.82], [0.16, 0.98], [0.26, 1.05]], 3),
            curve(&[[0.26, 1.05], [0.50, 1.10], [0.70, 1.22], [0.76, 1.33]], 3),
            curve(&[[0.76, 1.33], [0.765, 1.35], [0.745, 1.36], [0.72, 1.345]], 2),
            curve(&[[0.72, 1.345], [0.62, 1.24], [0.40, 1.16], [0.0, 1.14]], 3),
        ],
        40,
    );
    stage.add("bowl on a foot", foot, p.pale, place);
    let disc = lathe(&[line(&[[0.70, 1.315], [0.0, 1.315]])], 48);
    stage.add("upper water", disc, water, place);
    let holder = lathe(
        &[curve(&[[0.16, 1.12], [0.13, 1.24], [0.07, 1.36], [0.09, 1.44]], 4), line(&[[0.09, 1.44], [0.0, 1.44]])],
        28,
    );
    stage.add("holder", holder, p.pale, place);
    stage.add("copper ball", sphere(0.30, 24, 40), p.copper, place * Affine3A::from_translation(Vec3::Y * 1.72));
}

/// A table with a still life, in the foreground.
fn table(stage: &mut Stage, p: &Palette) {
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

    // A teapot: body, lid, spout and handle.
    let body = lathe(
        &[
            line(&[[0.0, 0.0], [0.075, 0.0]]),
            curve(&[[0.075, 0.0], [0.09, 0.012], [0.135, 0.075], [0.115, 0.145], [0.065, 0.175]], 4),
            curve(&[[0.065, 0.175], [0.072, 0.183], [0.055, 0.200], [0.018, 0.212]], 3),
            curve(&[[0.018, 0.212], [0.012, 0.222], [0.024, 0.236], [0.020, 0.250], [0.0, 0.255]], 3),
        ],
        32,
    );
    let mut pot = body;
    pot.join(
        &tube(&[[0.10, 0.055], [0.17, 0.075], [0.195, 0.13], [0.235, 0.185]], [0.030, 0.014], 12, 12),
        Affine3A::IDENTITY,
    );
    pot.join(
        &tube(
            &[[-0.105, 0.155], [-0.17, 0.165], [-0.205, 0.12], [-0.18, 0.06], [-0.115, 0.045]],
            [0.011, 0.011],
            20,
            10,
        ),
        Affine3A::IDENTITY,
    );
    let turn = Affine3A::from_rotation_y(0.5);
    stage.add("teapot", pot, p.white, on(0.22, -0.18) * turn);
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

fn bench(stage: &mut Stage, p: &Palette) {
    let place = at(-4.75, -SUNK, -0.6, 90.0);
    let foot = stage.mesh("bench foot", block(0.16, 0.40, 0.42, 0.015));
    for x in [-0.72, 0.72] {
        stage.put(foot, p.stone, place * at(x, 0.0, 0.0, 0.0));
    }
    stage.add("bench seat", block(1.9, 0.09, 0.5, 0.02), p.pale, place * at(0.0, 0.398, 0.0, 0.0));
    let coral = stage.material(matte("coral cloth", [0.70, 0.16, 0.10]));
    let blue = stage.material(matte("blue cloth", [0.05, 0.11, 0.36]));
    let cream = stage.material(matte("cream cloth", [0.74, 0.68, 0.55]));
    let cushion = stage.mesh("cushion", cushion(Vec3::new(0.23, 0.075, 0.21), 0.45, 14, 26));
    let lean = |x: f32, turn: f32| place * at(x, 0.66, -0.10, turn) * Affine3A::from_quat(Quat::from_rotation_x(1.15));
    stage.put(cushion, coral, lean(-0.55, 8.0));
    stage.put(cushion, cream, lean(-0.10, -6.0));
    stage.put(cushion, blue, place * at(0.52, 0.56, 0.0, 20.0));
}

/// Glazed pots with bushes beside the arches, and jars in the corners.
fn pots(stage: &mut Stage, p: &Palette) {
    let pot = lathe(
        &[
            line(&[[0.0, 0.0], [0.22, 0.0]]),
            curve(&[[0.22, 0.0], [0.29, 0.14], [0.345, 0.34], [0.36, 0.50]], 2),
            line(&[[0.36, 0.50], [0.40, 0.50]]),
            line(&[[0.40, 0.50], [0.41, 0.585]]),
            line(&[[0.41, 0.585], [0.345, 0.585]]),
            line(&[[0.345, 0.585], [0.335, 0.50]]),
        ],
        28,
    );
    let pot = stage.mesh("pot", pot);
    let soil = stage.mesh("soil", lathe(&[line(&[[0.342, 0.54], [0.0, 0.54]])], 28));
    let round = stage.mesh("round bush", crown(21, Vec3::new(0.42, 0.40, 0.42), 210, 0.26));
    let inside = stage.mesh("round bush core", core(Vec3::new(0.31, 0.29, 0.31)));
    for (x, z, turn, size, glaze) in [
        (-1.95, -5.15, 0.0, 1.0, p.cobalt),
        (1.95, -5.15, 110.0, 1.0, p.cobalt),
        (5.15, -3.75, 60.0, 1.05, p.terracotta),
        (5.15, -0.55, 200.0, 0.9, p.terracotta),
        (-2.45, 4.0, 300.0, 0.72, p.cobalt),
    ] {
        let place = scaled(x, -SUNK, z, turn, size);
        stage.put(pot, glaze, place);
        stage.put(soil, p.soil, place);
        let above = place * Affine3A::from_translation(Vec3::Y * 0.90);
        stage.put(round, p.leaves, above);
        stage.put(inside, p.shade, above);
    }
    let jar = lathe(
        &[
            line(&[[0.0, 0.0], [0.17, 0.0]]),
            curve(
                &[[0.17, 0.0], [0.24, 0.10], [0.36, 0.42], [0.30, 0.76], [0.17, 0.90], [0.16, 0.96], [0.22, 1.02]],
                2,
            ),
            curve(&[[0.22, 1.02], [0.215, 1.03], [0.195, 1.02]], 2),
            curve(&[[0.195, 1.02], [0.14, 0.96], [0.14, 0.88], [0.0, 0.80]], 2),
        ],
        32,
    );
    let jar = stage.mesh("jar", jar);
    stage.put(jar, p.stone, scaled(5.2, -SUNK, 1.35, 0.0, 1.0));
    stage.put(jar, p.white, scaled(4.75, -SUNK, 0.55, 40.0, 0.62));
    stage.put(jar, p.stone, scaled(-5.2, -SUNK, -5.2, 0.0, 0.9));
}

/// Trees and cypresses behind the walls, an olive tree in the yard, a climber on the terracotta wall.
fn plants(stage: &mut Stage, p: &Palette) {
    let trunk = lathe(
        &[
            curve(&[[0.22, 0.0], [0.15, 0.18], [0.115, 0.7], [0.09, 1.6], [0.05, 2.5]], 2),
            line(&[[0.05, 2.5], [0.0, 2.5]]),
        ],
        10,
    );
    let trunk = stage.mesh("trunk", trunk);
    let tree = stage.mesh("tree crown", crown(5, Vec3::new(1.45, 1.15, 1.4), 760, 0.49));
    let tree_core = stage.mesh("tree core", core(Vec3::new(1.02, 0.80, 0.98)));
    for (x, z, turn, size, leaves) in [
        (4.55, -4.35, 0.0, 1.0, p.olive),
        (-4.6, -9.5, 70.0, 1.55, p.leaves),
        (2.2, -11.5, 160.0, 1.75, p.leaves),
        (9.3, -5.0, 250.0, 1.7, p.olive),
        (-10.0, -3.5, 20.0, 1.5, p.leaves),
    ] {
        let place = scaled(x, -0.08, z, turn, size);
        stage.put(trunk, p.bark, place);
        let above = place * Affine3A::from_translation(Vec3::Y * 3.0);
        stage.put(tree, leaves, above);
        stage.put(tree_core, p.shade, above);
    }
    let cypress = stage.mesh("cypress", crown(9, Vec3::new(0.62, 2.7, 0.62), 540, 0.50));
    let cypress_core = stage.mesh("cypress core", core(Vec3::new(0.46, 2.2, 0.46)));
    for (x, z, turn, size) in
        [(-1.6, -9.0, 0.0, 1.1), (-8.4, -8.2, 90.0, 1.25), (6.4, -9.4, 200.0, 1.35), (0.3, -14.5, 310.0, 1.3)]
    {
        let place = scaled(x, 2.75 * size - 0.1, z, turn, size);
        stage.put(cypress, p.leaves, place);
        stage.put(cypress_core, p.shade, place);
        stage.put(trunk, p.bark, scaled(x, -0.08, z, 0.0, 0.8));
    }
    let climbing = climber(17, Vec3::new(0.10, 1.25, 1.3), Vec3::NEG_X, 420, 0.28);
    stage.add("wall climber", climbing, p.leaves, at(HALF - 0.16, 1.75, 1.6, 0.0));
    let hedge = stage.mesh("hedge bush", crown(33, Vec3::new(0.75, 0.55, 0.55), 200, 0.33));
    let hedge_core = stage.mesh("hedge core", core(Vec3::new(0.58, 0.42, 0.42)));
    let mut random = Random::new(4);
    for i in 0..9 {
        let place = scaled(
            -7.2 - random.range(0.0, 0.4),
            0.42,
            -5.4 + 1.3 * i as f32,
            random.range(0.0, 360.0),
            random.range(0.9, 1.25),
        );
        stage.put(hedge, p.olive, place);
        stage.put(hedge_core, p.shade, place);
    }
}
