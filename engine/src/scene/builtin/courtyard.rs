//! A small courtyard in the afternoon sun: sand, terracotta and green against cobalt blue.
//!
//! The arcade is at the back (-z), a pergola on the left and a plastered wall on the right; the front is open. Behind the outer arches are
//! alcoves with saffron walls, which get little but the light that the floor sends up. A fountain stands in the middle, a still basin in front of it. The sun is to the left, behind the camera, so that the shadow of the pergola falls across
//! the floor.
use super::foliage::{Random, climber, core, crown, leaf_texture};
use super::shapes::{Shape, arcade, block, curve, cushion, lathe, line, sphere};
use super::stage::{Stage, at, dielectric, matte, metal, scaled};
use crate::scene::{AlphaMode, Daylight, Light, Material, Sampler, Scene, TextureUse, Wrap};
use glam::{Affine3A, Quat, Vec3};
use std::f32::consts::PI;

mod table;
mod water;

/// Half the side of the paved square, metres.
const HALF: f32 = 6.0;
/// Depth to which objects are sunk into the ground, metres, so that no bottom face is coplanar with the floor.
const SUNK: f32 = 0.004;

struct Palette {
    plaster: u32,
    stone: u32,
    pale: u32,
    terracotta: u32,
    saffron: u32,
    cobalt: u32,
    wood: u32,
    iron: u32,
    copper: u32,
    silver: u32,
    steel: u32,
    white: u32,
    water: u32,
    /// Tones of one glaze.
    tiles: [u32; 4],
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
        saffron: stage.material(matte("saffron plaster", [0.72, 0.36, 0.06])),
        cobalt: stage.material(dielectric("cobalt glaze", [0.022, 0.075, 0.42], 0.18)),
        wood: stage.material(dielectric("weathered wood", [0.33, 0.22, 0.13], 0.7)),
        iron: stage.material(metal("iron", [0.30, 0.29, 0.28], 0.55)),
        // F0 of copper and silver: Akenine-Möller et al. 2018, "Real-Time Rendering", 4th ed., table 9.2.
        copper: stage.material(metal("copper", [0.955, 0.638, 0.538], 0.38)),
        silver: stage.material(metal("polished silver", [0.972, 0.960, 0.915], 0.16)),
        steel: stage.material(metal("brushed steel", [0.67, 0.66, 0.64], 0.32)),
        white: stage.material(dielectric("white glaze", [0.80, 0.79, 0.75], 0.10)),
        // The colour is that of the dark bottom and of what water scatters: nothing below the surface is modelled.
        water: stage.material(Material { ior: 1.33, ..dielectric("water", [0.006, 0.020, 0.022], 0.0) }),
        tiles: [
            ("bottle", [0.010, 0.110, 0.075], 0.05),
            ("emerald", [0.016, 0.170, 0.105], 0.07),
            ("sea", [0.012, 0.130, 0.125], 0.06),
            ("pine", [0.020, 0.090, 0.050], 0.09),
        ]
        .map(|(tone, colour, roughness)| stage.material(dielectric(&format!("{tone} glaze"), colour, roughness))),
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
    alcoves(&mut stage, &p);
    pergola(&mut stage, &p);
    water::fountain(&mut stage, &p);
    water::basin(&mut stage, &p);
    table::table(&mut stage, &p);
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
    stage.camera("alcove", [2.35, 1.55, -4.3], [4.2, 1.6, -7.5], 55.0);
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

/// Two alcoves behind the outer arches, with a passage to the garden between them, under one roof.
fn alcoves(stage: &mut Stage, p: &Palette) {
    const DEPTH: f32 = 1.3;
    let inside = -HALF - 0.25;
    let (middle, back) = (inside - 0.5 * DEPTH, inside - DEPTH);
    let rear = stage.mesh("alcove rear", block(4.55, 3.6, 0.2, 0.01));
    let side = stage.mesh("alcove side", block(0.2, 3.6, DEPTH + 0.1, 0.01));
    for x in [-1.0, 1.0] {
        stage.put(rear, p.saffron, at(x * 3.925, -SUNK, back, 0.0));
        for wall in [1.75, 6.1] {
            stage.put(side, p.saffron, at(x * wall, -SUNK, middle, 0.0));
        }
    }
    stage.add("alcove floor", block(12.4, 0.10, DEPTH + 0.3, 0.008), p.pale, at(0.0, -0.101, middle, 0.0));
    stage.add("alcove roof", block(12.6, 0.22, DEPTH + 0.4, 0.02), p.pale, at(0.0, 3.6 - 2.0 * SUNK, middle, 0.0));
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
