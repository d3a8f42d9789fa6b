//! What light is sampled, and how often: by power, as alias tables. Any positive odds are unbiased; good ones are less noisy.
use glam::{DVec3, Vec2, Vec3};
use magpie::scene::{Animator, Environment, Light, Material, Mesh, Pose, Scene, Texture, deform};
use magpie_shaders::Address;
use magpie_shaders::reference::{AreaLight, CHOICE_EMITTER, LightChoice, LightTables, NO_EMITTER};
use std::f64::consts::PI;

/// Cells of an analytic sky.
const SKY_CELLS: [u32; 2] = [64, 32];
/// Most cells of an environment map.
const MAP_CELLS: [u32; 2] = [256, 128];
/// Share of the odds that is spread evenly, so that nothing that shines is never sampled.
const EVEN: f64 = 0.05;
/// Points of a triangle at which its emission is looked up.
const LOOK_UPS: u32 = 4;

/// The tables, in one block of bytes: first the root, whose addresses are counted from the block's begin.
pub struct Tables {
    block: Vec<u8>,
    root: LightTables,
}

impl Tables {
    /// Those of a scene at a moment.
    pub fn new(scene: &Scene, time: f64) -> Self {
        let pose = Animator::new(scene).pose(time);
        let (mut near, mut far) = (Vec::new(), Vec::new());
        for (index, light) in pose.lights.iter().enumerate() {
            let choice = LightChoice { light: index as u32, ..LightChoice::default() };
            match light {
                Light::Directional { illuminance, .. } => far.push((luminance(*illuminance), choice)),
                _ => near.push((power(light), choice)),
            }
        }
        let mut emitters = Vec::with_capacity(scene.instances.len());
        for instance in 0..scene.instances.len() {
            emitters.push(add_emitters(scene, &pose, instance, &mut near));
        }
        let (near, far) = (alias_table(near), alias_table(far));
        let sized = |choice: &&LightChoice| has_size(choice, &pose);
        let areas: Vec<_> = near
            .iter()
            .chain(&far)
            .filter(sized)
            .map(|c| AreaLight { light: c.light, probability: c.probability })
            .collect();
        let (cells, sky_cells) = sky(scene);
        let sky = alias_table(cells.into_iter().map(|weight| (weight, LightChoice::default())).collect());

        let mut tables = Self { block: vec![0; size_of::<LightTables>()], root: LightTables::default() };
        tables.root = LightTables {
            near: tables.add(&near),
            far: tables.add(&far),
            areas: tables.add(&areas),
            emitters: tables.add(&emitters),
            sky: tables.add(&sky),
            near_count: near.len() as u32,
            far_count: far.len() as u32,
            area_count: areas.len() as u32,
            sky_cells,
        };
        tables
    }

    fn add<T: bytemuck::Pod>(&mut self, items: &[T]) -> Address {
        let offset = self.block.len() as u64;
        self.block.extend_from_slice(bytemuck::cast_slice(items));
        Address::new(offset)
    }

    /// How many bytes they are.
    pub fn bytes(&self) -> u64 {
        self.block.len() as u64
    }

    /// The block as it lies at an address.
    pub fn placed(&self, at: Address) -> Vec<u8> {
        let on = |offset: Address| at.offset(offset.get());
        let LightTables { near, far, areas, emitters, sky, .. } = self.root;
        let root = LightTables {
            near: on(near),
            far: on(far),
            areas: on(areas),
            emitters: on(emitters),
            sky: on(sky),
            ..self.root
        };
        let mut bytes = self.block.clone();
        bytes[..size_of::<LightTables>()].copy_from_slice(bytemuck::bytes_of(&root));
        bytes
    }
}

fn luminance(c: Vec3) -> f64 {
    c.as_dvec3().dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

/// Emitted power of a light at a place.
fn power(light: &Light) -> f64 {
    let square = |radius: &f32| f64::from(*radius).powi(2);
    match light {
        Light::Directional { .. } => 0.0,
        Light::Point { intensity, .. } => 4.0 * PI * luminance(*intensity),
        Light::Spot { intensity, outer, .. } => 2.0 * PI * (1.0 - f64::from(*outer).cos()) * luminance(*intensity),
        Light::Rectangle { half_u, half_v, radiance, .. } => {
            4.0 * PI * f64::from(half_u.cross(*half_v).length()) * luminance(*radiance)
        }
        Light::Disc { radius, radiance, .. } => PI * PI * square(radius) * luminance(*radiance),
        Light::Sphere { radius, radiance, .. } => 4.0 * PI * PI * square(radius) * luminance(*radiance),
    }
}

fn has_size(choice: &LightChoice, pose: &Pose) -> bool {
    if choice.light == CHOICE_EMITTER {
        return false;
    }
    match &pose.lights[choice.light as usize] {
        Light::Directional { angular_radius, .. } => *angular_radius > 0.0,
        Light::Point { .. } | Light::Spot { .. } => false,
        Light::Rectangle { .. } | Light::Disc { .. } | Light::Sphere { .. } => true,
    }
}

/// Adds the triangles or spheres of an instance that emits; gives where they begin.
fn add_emitters(scene: &Scene, pose: &Pose, instance: usize, near: &mut Vec<(f64, LightChoice)>) -> u32 {
    let shown = &scene.instances[instance];
    let (mesh, material) = (&scene.meshes[shown.mesh as usize], &scene.materials[shown.material as usize]);
    if material.emission == Vec3::ZERO || material.shows_light || material.unlit {
        return NO_EMITTER;
    }
    let first = near.len() as u32;
    let world = &pose.instances[instance];
    let sides = if material.double_sided { 2.0 } else { 1.0 };
    let mut push = |power: f64| {
        let primitive = near.len() as u32 - first;
        near.push((
            power,
            LightChoice { light: CHOICE_EMITTER, instance: instance as u32, primitive, ..Default::default() },
        ));
    };
    for sphere in &mesh.spheres {
        let radius = f64::from(sphere.radius) * world.matrix3.determinant().abs().cbrt();
        push(4.0 * PI * PI * radius * radius * luminance(material.emission));
    }
    let deformed =
        pose.bounds[instance].map(|_| deform(mesh, &pose.joints[instance], &pose.weights[instance]).positions);
    let positions = deformed.as_deref().unwrap_or(&mesh.positions);
    for corners in mesh.indices.chunks_exact(3) {
        let [a, b, c] = [0, 1, 2].map(|k| world.transform_point3(positions[corners[k] as usize].as_dvec3()));
        let area = 0.5 * (b - a).cross(c - a).length();
        push(PI * sides * area * emission(scene, material, mesh, corners));
    }
    first
}

/// Mean luminance that a triangle emits, roughly.
fn emission(scene: &Scene, material: &Material, mesh: &Mesh, corners: &[u32]) -> f64 {
    let full = luminance(material.emission);
    let Some(used) = material.emission_texture else { return full };
    let Some(texture) = scene.textures.get(used.texture as usize) else { return full };
    let uvs = if used.uv_set == 0 { &mesh.uv0 } else { &mesh.uv1 };
    let mut sum = 0.0;
    for i in 0..LOOK_UPS * LOOK_UPS {
        // A regular pattern in the square, folded into the triangle.
        let [x, y] = [i % LOOK_UPS, i / LOOK_UPS].map(|k| (k as f32 + 0.5) / LOOK_UPS as f32);
        let root = x.sqrt();
        let weights = [1.0 - root, root * (1.0 - y), root * y];
        let uv: Vec2 = (0..3).map(|k| uvs[corners[k] as usize] * weights[k]).sum();
        let place = uv.extend(1.0);
        sum += luminance(texel(texture, Vec2::new(used.rows[0].dot(place), used.rows[1].dot(place))));
    }
    full * (EVEN + (1.0 - EVEN) * sum / f64::from(LOOK_UPS * LOOK_UPS))
}

/// The texel there, tiled, of a mip that is small enough for few look-ups to see it all.
fn texel(texture: &Texture, uv: Vec2) -> Vec3 {
    let mip = texture.mips.len().saturating_sub(7);
    let [width, height] = texture.mip_size(mip);
    let at = |x: f32, n: u32| ((x.rem_euclid(1.0) * n as f32) as usize).min(n as usize - 1);
    let first = 4 * (at(uv.y, height) * width as usize + at(uv.x, width));
    let channel = |k: usize| {
        let x = f32::from(texture.mips[mip][first + k]) / 255.0;
        if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
    };
    Vec3::new(channel(0), channel(1), channel(2))
}

/// Luminance of each cell of the sky, and how many columns and rows there are; zero where there is no sky. Rows have equal steps of
/// height, as in `sky_direction` of `lib/light_sampling.glsl`.
fn sky(scene: &Scene) -> (Vec<f64>, [u32; 2]) {
    let direction = |[columns, rows]: [u32; 2], x: f64, y: f64| {
        let (angle, height) = (2.0 * PI * x / f64::from(columns), 1.0 - 2.0 * y / f64::from(rows));
        let flat = (1.0 - height * height).max(0.0).sqrt();
        DVec3::new(flat * angle.cos(), height, flat * angle.sin())
    };
    let centres = |cells: [u32; 2]| {
        (0..cells[1]).flat_map(move |y| (0..cells[0]).map(move |x| (f64::from(x) + 0.5, f64::from(y) + 0.5)))
    };
    let (mut weights, cells) = if let Some(map) = &scene.environment {
        let cells = [map.width.clamp(8, MAP_CELLS[0]), map.height.clamp(4, MAP_CELLS[1])];
        // All texels that fall into a cell, and where none does, the one at its centre.
        let (mut sums, mut counts) =
            (vec![0.0; (cells[0] * cells[1]) as usize], vec![0.0; (cells[0] * cells[1]) as usize]);
        for (at, radiance) in map.radiance.iter().enumerate() {
            let d = texel_direction(map, at as u32);
            let around = d.z.atan2(d.x).rem_euclid(2.0 * PI) / (2.0 * PI);
            let column = ((around * f64::from(cells[0])) as u32).min(cells[0] - 1);
            let row = (((0.5 - 0.5 * d.y) * f64::from(cells[1])) as u32).min(cells[1] - 1);
            let cell = (row * cells[0] + column) as usize;
            sums[cell] += luminance(*radiance);
            counts[cell] += 1.0;
        }
        let filled = centres(cells).zip(sums.iter().zip(&counts)).map(|((x, y), (sum, count))| {
            let own = luminance(map.radiance[texel_at(map, direction(cells, x, y))]);
            f64::max(own, if *count > 0.0 { sum / count } else { 0.0 }) * f64::from(map.scale)
        });
        (filled.collect::<Vec<_>>(), cells)
    } else if let Some(daylight) = &scene.daylight {
        let model = daylight.model();
        let look = |(x, y)| luminance(model.radiance(direction(SKY_CELLS, x, y).as_vec3()));
        (centres(SKY_CELLS).map(look).collect(), SKY_CELLS)
    } else {
        return (Vec::new(), [0, 0]);
    };
    let mean = weights.iter().sum::<f64>() / weights.len() as f64;
    weights.iter_mut().for_each(|w| *w = (1.0 - EVEN) * *w + EVEN * mean);
    (weights, cells)
}

/// Direction of a texel's centre; the convention is that of [`Environment`].
fn texel_direction(map: &Environment, texel: u32) -> DVec3 {
    let (x, y) = (f64::from(texel % map.width) + 0.5, f64::from(texel / map.width) + 0.5);
    let p = 2.0 * PI * (x / f64::from(map.width) - 0.5) - f64::from(map.turn);
    let (sin, cos) = (PI * y / f64::from(map.height)).sin_cos();
    DVec3::new(p.sin() * sin, cos, -p.cos() * sin)
}

/// The texel of a direction.
fn texel_at(map: &Environment, d: DVec3) -> usize {
    let p = d.x.atan2(-d.z) + f64::from(map.turn);
    let u = (p / (2.0 * PI) + 0.5).rem_euclid(1.0);
    let v = d.y.clamp(-1.0, 1.0).acos() / PI;
    let at = |x: f64, n: u32| ((x * f64::from(n)) as usize).min(n as usize - 1);
    at(v, map.height) * map.width as usize + at(u, map.width)
}

/// Fills in thresholds, aliases and probabilities (Vose 1991, "A Linear Algorithm for Generating Random Numbers with a Given
/// Distribution"). Where no weight is above 0, nothing is left to choose.
fn alias_table(entries: Vec<(f64, LightChoice)>) -> Vec<LightChoice> {
    let sum: f64 = entries.iter().map(|(weight, _)| weight).sum();
    if sum <= 0.0 {
        return Vec::new();
    }
    let n = entries.len() as f64;
    let mut shares: Vec<f64> = entries.iter().map(|(weight, _)| weight / sum * n).collect();
    let mut table: Vec<LightChoice> = entries
        .iter()
        .zip(0..)
        .map(|((weight, choice), own)| LightChoice {
            threshold: 1.0,
            alias: own,
            probability: (weight / sum) as f32,
            ..*choice
        })
        .collect();
    let (mut small, mut large): (Vec<usize>, Vec<usize>) = (0..shares.len()).partition(|i| shares[*i] < 1.0);
    while let (Some(poor), Some(rich)) = (small.pop(), large.last().copied()) {
        table[poor].threshold = shares[poor] as f32;
        table[poor].alias = rich as u32;
        shares[rich] -= 1.0 - shares[poor];
        if shares[rich] < 1.0 {
            large.pop();
            small.push(rich);
        }
    }
    table
}
