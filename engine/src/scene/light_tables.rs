//! Tables by which lights are sampled: by power, as alias tables, for the reference and for effects that sample every kind of light.
//! Any positive probabilities are unbiased; good ones have less variance.
use super::light_sampling::{UNIFORM_FRACTION, add_emitters, alias_table, luminance};
use super::{Animator, Environment, Light, Pose, Scene};
use glam::DVec3;
use magpie_shaders::Address;
use magpie_shaders::light_sampling::{AreaLight, CHOICE_EMITTER, LightChoice, LightTables, NO_EMITTER};
use std::f64::consts::PI;

/// Columns and rows of cells of an analytic sky.
const SKY_CELLS: [u32; 2] = [64, 32];
/// Greatest number of columns and rows of cells of an environment map.
const MAP_CELLS: [u32; 2] = [256, 128];

/// What the probability of each light is made of. A scene on the device keeps it, so that tables can be made when an effect asks for them.
pub struct LightWeights {
    /// Local lights, then emissive triangles and spheres.
    near: Vec<(f64, LightChoice)>,
    /// How many local lights there are.
    local: usize,
    /// Of each instance the index in `near` of its first emissive primitive, or [`NO_EMITTER`].
    first_emitters: Vec<u32>,
    far: Vec<(f64, LightChoice)>,
    /// Of each light, whether a ray can hit it.
    has_size: Vec<bool>,
    sky: Vec<f64>,
    sky_cells: [u32; 2],
}

impl LightWeights {
    /// For one moment of the animation, seconds.
    #[must_use]
    pub fn new(scene: &Scene, time: f64) -> Self {
        let animator = Animator::new(scene);
        Self::of_pose(scene, &animator.pose(time), None)
    }

    /// For all moments of the animation: weights are those of the rest pose, but nothing that moves has a weight of 0 because it is
    /// small there.
    #[must_use]
    pub fn of_animation(scene: &Scene) -> Self {
        let animator = Animator::new(scene);
        Self::of_pose(scene, &animator.pose(0.0), Some(&animator))
    }

    fn of_pose(scene: &Scene, pose: &Pose, moving: Option<&Animator>) -> Self {
        let (mut near, mut far) = (Vec::new(), Vec::new());
        for (index, light) in pose.lights.iter().enumerate() {
            let choice = LightChoice { light: index as u32, ..LightChoice::default() };
            match light {
                Light::Directional { illuminance, .. } => far.push((luminance(*illuminance), choice)),
                _ => near.push((power(light), choice)),
            }
        }
        let local = near.len();
        let first_emitters = add_all_emitters(scene, pose, moving, &mut near);
        let (sky, sky_cells) = sky(scene);
        let has_size = pose.lights.iter().map(has_size).collect();
        Self { near, local, first_emitters, far, has_size, sky, sky_cells }
    }

    /// Of each instance the entry of its first emissive primitive, or [`NO_EMITTER`].
    pub(super) fn first_emitters(&self) -> &[u32] {
        &self.first_emitters
    }

    /// Tables of every light.
    #[must_use]
    pub fn tables(&self) -> Tables {
        let (near, far) = (alias_table(self.near.clone()), alias_table(self.far.clone()));
        // Lights without power are not hit either.
        let can_be_hit = |(choice, _): &(&LightChoice, u32)| {
            choice.probability > 0.0 && choice.light != CHOICE_EMITTER && self.has_size[choice.light as usize]
        };
        let areas: Vec<_> = near
            .iter()
            .zip(0..)
            .chain(far.iter().zip(0..))
            .filter(can_be_hit)
            .map(|(c, entry)| AreaLight { light: c.light, probability: c.probability, entry })
            .collect();
        let sky = alias_table(self.sky.iter().map(|weight| (*weight, LightChoice::default())).collect());

        let mut tables = Tables::empty();
        tables.root = LightTables {
            near: tables.add(&near),
            far: tables.add(&far),
            areas: tables.add(&areas),
            emitters: tables.add(&self.first_emitters),
            sky: tables.add(&sky),
            near_count: near.len() as u32,
            far_count: far.len() as u32,
            tree: Address::default(),
            area_count: areas.len() as u32,
            first_far_area: near.iter().zip(0..).filter(can_be_hit).count() as u32,
            sky_count: sky.len() as u32,
            sky_cells: self.sky_cells,
        };
        tables
    }

    /// Tables of the emissive triangles and spheres alone. `None` if nothing emits, not counting surfaces that only show a light.
    #[must_use]
    pub fn emitters(&self) -> Option<Tables> {
        let near = alias_table(self.near[self.local..].to_vec());
        if near.is_empty() {
            return None;
        }
        let first = |index: &u32| if *index == NO_EMITTER { NO_EMITTER } else { index - self.local as u32 };
        let first: Vec<u32> = self.first_emitters.iter().map(first).collect();
        let mut tables = Tables::empty();
        tables.root.near_count = near.len() as u32;
        tables.root.near = tables.add(&near);
        tables.root.emitters = tables.add(&first);
        Some(tables)
    }
}

/// The tables in one block of bytes. The root comes first; its addresses are offsets from the start of the block, but for that of the tree.
pub struct Tables {
    block: Vec<u8>,
    root: LightTables,
}

impl Tables {
    fn empty() -> Self {
        Self { block: vec![0; size_of::<LightTables>()], root: LightTables::default() }
    }

    /// Offset of the items in the block.
    fn add<T: bytemuck::Pod>(&mut self, items: &[T]) -> Address {
        let offset = self.block.len() as u64;
        self.block.extend_from_slice(bytemuck::cast_slice(items));
        Address::new(offset)
    }

    /// Lets local lights and emitters be chosen by a light tree of the same scene, at this address.
    #[must_use]
    pub fn with_tree(mut self, tree: Address) -> Self {
        self.root.tree = tree;
        self
    }

    /// Size of the block.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.block.len() as u64
    }

    /// The block for a buffer at this address.
    #[must_use]
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

/// Adds the emissive triangles and spheres of all instances. Returns the index of the first for each instance, or
/// [`NO_EMITTER`]. Of instances that `moving` moves, each emitter gets a fraction
/// [`UNIFORM_FRACTION`] of the mean weight besides its own: in the pose it may have no area, as a lamp that grows from nothing.
fn add_all_emitters(
    scene: &Scene,
    pose: &Pose,
    moving: Option<&Animator>,
    entries: &mut Vec<(f64, LightChoice)>,
) -> Vec<u32> {
    let begin = entries.len();
    let first = (0..scene.instances.len()).map(|i| add_emitters(scene, pose, i, entries)).collect();
    let Some(animator) = moving else { return first };
    let emitters = &mut entries[begin..];
    let sum: f64 = emitters.iter().map(|(weight, _)| weight.max(0.0)).sum();
    let least = if sum > 0.0 { UNIFORM_FRACTION * sum / emitters.len() as f64 } else { 1.0 };
    for (weight, choice) in emitters {
        if animator.moves(choice.instance as usize) || animator.changes(choice.instance as usize) {
            *weight = weight.max(0.0) + least;
        }
    }
    first
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

fn has_size(light: &Light) -> bool {
    match light {
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
        // All texels that fall into a cell, and where none does, the one at its centre. Columns and rows are found apart.
        let column = |x: u32| {
            let d = texel_direction(map, map.height / 2 * map.width + x);
            let around = d.z.atan2(d.x).rem_euclid(2.0 * PI) / (2.0 * PI);
            ((around * f64::from(cells[0])) as u32).min(cells[0] - 1)
        };
        let row = |y: u32| {
            let d = texel_direction(map, y * map.width);
            (((0.5 - 0.5 * d.y) * f64::from(cells[1])) as u32).min(cells[1] - 1)
        };
        let columns: Vec<u32> = (0..map.width).map(column).collect();
        let cell_count = (cells[0] * cells[1]) as usize;
        let (mut sums, mut counts) = (vec![0.0; cell_count], vec![0.0; cell_count]);
        for (y, texels) in (0..).zip(map.radiance.chunks_exact(map.width as usize)) {
            let first = row(y) * cells[0];
            for (column, radiance) in columns.iter().zip(texels) {
                let cell = (first + column) as usize;
                sums[cell] += luminance(*radiance);
                counts[cell] += 1.0;
            }
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
