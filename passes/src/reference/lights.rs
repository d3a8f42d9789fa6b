//! Tables for sampling lights: alias tables by power. The probabilities do not bias the result as long as they are positive; they only affect
//! noise.
use glam::DVec3;
use magpie::scene::light_sampling::{UNIFORM_FRACTION, add_emitters, alias_table, luminance};
use magpie::scene::{Animator, Environment, Light, Pose, Scene};
use magpie_shaders::Address;
use magpie_shaders::reference::{AreaLight, CHOICE_EMITTER, LightChoice, LightTables};
use std::f64::consts::PI;

/// Columns and rows of cells of an analytic sky.
const SKY_CELLS: [u32; 2] = [64, 32];
/// Greatest number of columns and rows of cells of an environment map.
const MAP_CELLS: [u32; 2] = [256, 128];

/// The tables in one block of bytes, which begins with [`LightTables`]. Addresses in `root` are offsets from the beginning of the block.
pub struct Tables {
    block: Vec<u8>,
    root: LightTables,
}

impl Tables {
    /// The tables of a scene at `time`, seconds.
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
        // Lights without power are left out: rays do not hit them.
        let sized = |choice: &&LightChoice| choice.probability > 0.0 && has_size(choice, &pose);
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
            sky_count: sky.len() as u32,
            sky_cells,
        };
        tables
    }

    fn add<T: bytemuck::Pod>(&mut self, items: &[T]) -> Address {
        let offset = self.block.len() as u64;
        self.block.extend_from_slice(bytemuck::cast_slice(items));
        Address::new(offset)
    }

    /// Size of the block, bytes.
    pub fn bytes(&self) -> u64 {
        self.block.len() as u64
    }

    /// The block with its offsets turned into addresses, for an upload to `at`.
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

/// Emitted power of a local light, as luminance; 0 for directional lights.
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

/// Weight of each cell of the sky by its luminance, and the number of columns and rows; none without a sky. Rows have equal steps of
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
        // The mean over the texels whose centres are in a cell, but at least the texel at the centre of the cell.
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
            let at_centre = luminance(map.radiance[texel_at(map, direction(cells, x, y))]);
            f64::max(at_centre, if *count > 0.0 { sum / count } else { 0.0 }) * f64::from(map.scale)
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
    weights.iter_mut().for_each(|w| *w = (1.0 - UNIFORM_FRACTION) * *w + UNIFORM_FRACTION * mean);
    (weights, cells)
}

/// World direction of a texel's centre, by the convention of [`Environment`].
fn texel_direction(map: &Environment, texel: u32) -> DVec3 {
    let (x, y) = (f64::from(texel % map.width) + 0.5, f64::from(texel / map.width) + 0.5);
    let p = 2.0 * PI * (x / f64::from(map.width) - 0.5) - f64::from(map.turn);
    let (sin, cos) = (PI * y / f64::from(map.height)).sin_cos();
    DVec3::new(p.sin() * sin, cos, -p.cos() * sin)
}

/// Index of the texel in a world direction.
fn texel_at(map: &Environment, d: DVec3) -> usize {
    let p = d.x.atan2(-d.z) + f64::from(map.turn);
    let u = (p / (2.0 * PI) + 0.5).rem_euclid(1.0);
    let v = d.y.clamp(-1.0, 1.0).acos() / PI;
    let at = |x: f64, n: u32| ((x * f64::from(n)) as usize).min(n as usize - 1);
    at(v, map.height) * map.width as usize + at(u, map.width)
}
