//! ReSTIR GI (Ouyang et al. 2021, algorithms 2 to 4) in a corner of glowing walls under a sky.
//!
//! A sample is a point that sends light, or a direction into the sky. Densities are per solid angle of the pixel that
//! keeps the sample.

use super::direct::Surface;
use super::mis::{Input, Weights, merge};
use super::reservoir::Reservoir;
use super::ris::{Candidate, streaming};
use crate::oracle::path::random::{frame as frame_of, from_polar};
use glam::DVec3;
use std::f64::consts::{FRAC_1_PI, TAU};

/// A rectangle that sends light from its front, the same in all directions. Its back is black.
#[derive(Clone, Copy, Debug)]
pub struct Patch {
    /// A corner.
    pub corner: DVec3,
    /// Edge along which the radiance changes.
    pub u: DVec3,
    /// The other edge, at a right angle. The front is where `u × v` points.
    pub v: DVec3,
    /// Radiance at the beginning and the end of `u`.
    pub radiance: [f64; 2],
}

impl Patch {
    /// Unit normal of the front.
    pub fn normal(&self) -> DVec3 {
        self.u.cross(self.v).normalize()
    }

    /// Distance in units of `direction` to a hit before `end`, with the place along `u`.
    fn hit(&self, origin: DVec3, direction: DVec3, end: f64) -> Option<(f64, f64)> {
        let normal = self.u.cross(self.v);
        let along = direction.dot(normal);
        let t = (self.corner - origin).dot(normal) / along;
        if !(t > SURFACE && t < end) {
            return None;
        }
        let inside = origin + t * direction - self.corner;
        let (s, r) = (inside.dot(self.u) / self.u.length_squared(), inside.dot(self.v) / self.v.length_squared());
        ((0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&r)).then_some((t, s))
    }
}

/// Hits closer than this to either end of a segment, in units of its direction, do not count.
const SURFACE: f64 = 1e-7;

/// A point or direction that light comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sample {
    /// A point `x_s` of a surface.
    Point {
        /// Position.
        position: DVec3,
        /// Unit normal `n_s`.
        normal: DVec3,
        /// Radiance `L_o` that leaves it, in all directions.
        radiance: f64,
    },
    /// A direction in which a ray hits nothing.
    Sky {
        /// Unit, towards the sky.
        direction: DVec3,
        /// Radiance from there.
        radiance: f64,
    },
}

/// Factor `|J|` by which the solid angle of a surface element at `position` grows when it is seen from `receiver` in
/// place of `generator` (Ouyang et al. 2021, equation 11): `cos_r / cos_g · d_g² / d_r²`, with cosines against the
/// element's normal. A contribution weight is multiplied by it, a density divided. It is infinite or NaN where an
/// observer touches the element.
pub fn jacobian(generator: DVec3, receiver: DVec3, position: DVec3, normal: DVec3) -> f64 {
    let (from, to) = (generator - position, receiver - position);
    let (near, far) = (from.length_squared(), to.length_squared());
    let cosines = (normal.dot(to).abs() * near.sqrt()) / (normal.dot(from).abs() * far.sqrt());
    cosines * near / far
}

impl Sample {
    /// [`jacobian`] of moving the sample; 1 for a direction.
    pub fn jacobian(&self, generator: DVec3, receiver: DVec3) -> f64 {
        match self {
            Self::Point { position, normal, .. } => jacobian(generator, receiver, *position, *normal),
            Self::Sky { .. } => 1.0,
        }
    }
}

/// Patches and sky, and what the pixels show of them.
#[derive(Clone, Debug)]
pub struct Scene {
    /// All surfaces that rays hit.
    pub patches: Vec<Patch>,
    /// Radiance of the sky straight up and straight down; between them it goes with the cosine.
    pub sky: [f64; 2],
    /// What the pixels show, in one row; `None` is sky.
    pub pixels: Vec<Option<Surface>>,
}

impl Scene {
    /// The sample that a ray finds.
    pub fn trace(&self, origin: DVec3, direction: DVec3) -> Sample {
        let mut end = f64::INFINITY;
        let mut found = None;
        for patch in &self.patches {
            if let Some((t, s)) = patch.hit(origin, direction, end) {
                end = t;
                let front = patch.normal().dot(direction) < 0.0;
                let radiance = if front { patch.radiance[0] * (1.0 - s) + patch.radiance[1] * s } else { 0.0 };
                found = Some(Sample::Point { position: origin + t * direction, normal: patch.normal(), radiance });
            }
        }
        let upwards = 0.5 + 0.5 * direction.z;
        let radiance = self.sky[0] * upwards + self.sky[1] * (1.0 - upwards);
        found.unwrap_or(Sample::Sky { direction, radiance })
    }

    /// Whether nothing is between a surface and a sample.
    pub fn visible(&self, surface: &Surface, sample: &Sample) -> bool {
        let (direction, end) = match sample {
            Sample::Point { position, .. } => (*position - surface.position, 1.0 - SURFACE),
            Sample::Sky { direction, .. } => (*direction, f64::INFINITY),
        };
        !self.patches.iter().any(|patch| patch.hit(surface.position, direction, end).is_some())
    }

    /// Light reflected at a white diffuse surface per solid angle if nothing were in between (Ouyang et al. 2021,
    /// equation 9).
    pub fn reflected(&self, surface: &Surface, sample: &Sample) -> f64 {
        let (direction, radiance) = match sample {
            Sample::Point { position, normal, radiance } => {
                let direction = (*position - surface.position).normalize();
                (direction, if normal.dot(direction) < 0.0 { *radiance } else { 0.0 })
            }
            Sample::Sky { direction, radiance } => (*direction, *radiance),
        };
        FRAC_1_PI * radiance * surface.normal.dot(direction).max(0.0)
    }

    /// The integral at a pixel, by `side` times `side` rays over the hemisphere, each for the same share of the cosine.
    /// 0 for sky.
    pub fn truth(&self, pixel: usize, side: u32) -> f64 {
        let Some(surface) = self.pixels[pixel] else { return 0.0 };
        let middle = |k: u32| (f64::from(k) + 0.5) / f64::from(side);
        let ray = |i: u32| {
            let direction = Directions::Cosine.direction(surface.normal, [middle(i / side), middle(i % side)]);
            match self.trace(surface.position, direction) {
                Sample::Point { radiance, .. } | Sample::Sky { radiance, .. } => radiance,
            }
        };
        (0..side * side).map(ray).sum::<f64>() / f64::from(side * side)
    }
}

/// How initial directions are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Directions {
    /// Uniform over the hemisphere.
    Uniform,
    /// In proportion to the cosine against the normal.
    Cosine,
}

impl Directions {
    /// A direction around a normal.
    pub fn direction(self, normal: DVec3, u: [f64; 2]) -> DVec3 {
        let cosine = match self {
            Self::Uniform => 1.0 - u[0],
            Self::Cosine => (1.0 - u[0]).sqrt(),
        };
        frame_of(normal) * from_polar(cosine, TAU * u[1])
    }

    /// Its density per solid angle.
    pub fn pdf(self, normal: DVec3, direction: DVec3) -> f64 {
        match self {
            Self::Uniform => 1.0 / TAU,
            Self::Cosine => normal.dot(direction) * FRAC_1_PI,
        }
    }
}

/// What is done with the Jacobian; all but the first are mistakes, kept to measure them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shift {
    /// Weights are multiplied by it.
    Multiplied,
    /// Nothing.
    Left,
    /// Weights are divided by it.
    Divided,
}

/// Settings of a frame.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Of the initial ray.
    pub directions: Directions,
    /// Weights of merging.
    pub weights: Weights,
    /// Use of the Jacobian.
    pub shift: Shift,
    /// Samples whose Jacobian is above this, below its inverse or not a number are not moved.
    pub limit: f64,
    /// Whether a merge asks, for each neighbour, if it sees the sample.
    pub neighbours_see: bool,
    /// The most confidence of the frame before; 0 for no temporal reuse.
    pub cap: f64,
    /// Neighbours per frame.
    pub neighbours: usize,
    /// They are at most so many pixels away.
    pub radius: usize,
    /// Least cosine between the normals of a pixel and a neighbour.
    pub least_cosine: f64,
}

/// Why neighbours were left out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Neighbours that were looked at.
    pub neighbours: u64,
    /// Their normal differs too much.
    pub unlike: u64,
    /// The Jacobian of their sample is out of range, infinite or not a number.
    pub jacobian: u64,
    /// Their sample is occluded.
    pub occluded: u64,
}

/// The reservoirs of a frame.
#[derive(Clone, Debug)]
pub struct Frame<'a> {
    /// The scene that they were chosen for.
    pub scene: &'a Scene,
    /// After temporal reuse, which is what the next frame begins with; empty for sky.
    pub temporal: Vec<Reservoir<Sample>>,
    /// After spatial reuse, which is what is shaded.
    pub spatial: Vec<Reservoir<Sample>>,
    /// Of spatial reuse.
    pub counts: Counts,
}

impl Frame<'_> {
    /// The estimate `f(y) W` of a pixel.
    pub fn shade(&self, pixel: usize) -> f64 {
        let Some(surface) = self.scene.pixels[pixel] else { return 0.0 };
        self.spatial[pixel].shade(|sample| lit(self.scene, &surface, sample))
    }

    /// The mean of the estimates over all pixels.
    pub fn mean(&self) -> f64 {
        (0..self.spatial.len()).map(|pixel| self.shade(pixel)).sum::<f64>() / self.spatial.len() as f64
    }
}

/// The integrand: what is reflected if the sample is visible.
fn lit(scene: &Scene, surface: &Surface, sample: &Sample) -> f64 {
    let reflected = scene.reflected(surface, sample);
    if reflected > 0.0 && scene.visible(surface, sample) { reflected } else { 0.0 }
}

/// One ray and what it finds (algorithm 2), with two uniform numbers: a reservoir of `M = 1` with `W = 1/p`.
pub fn initial(scene: &Scene, surface: &Surface, directions: Directions, u: [f64; 2]) -> Reservoir<Sample> {
    let direction = directions.direction(surface.normal, u);
    let sample = scene.trace(surface.position, direction);
    let candidate = Candidate { sample, pdf: directions.pdf(surface.normal, direction) };
    streaming(&[candidate], |sample| scene.reflected(surface, sample), &[0.0])
}

impl Settings {
    /// The factor for a weight that moves from `generator` to `receiver`; `None` where it must not.
    pub fn factor(&self, generator: &Surface, receiver: &Surface, sample: &Sample) -> Option<f64> {
        let jacobian = sample.jacobian(generator.position, receiver.position);
        let usable = jacobian <= self.limit && jacobian >= 1.0 / self.limit;
        usable.then_some(match self.shift {
            Shift::Multiplied => jacobian,
            Shift::Left => 1.0,
            Shift::Divided => 1.0 / jacobian,
        })
    }
}

/// A reservoir to be reused, with the scene and surface that it was chosen for.
#[derive(Clone, Copy, Debug)]
pub struct Other<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// The surface of its pixel.
    pub surface: Surface,
    /// The reservoir.
    pub reservoir: Reservoir<Sample>,
}

/// Merges a pixel's reservoir with others, of the frame before (algorithm 3) or of other pixels (algorithm 4), with one
/// uniform number for it and one for each of the others. A sample that must not be moved counts as one that the
/// receiver cannot have, in both directions, so that the mean stays.
pub fn reuse(
    scene: &Scene,
    surface: &Surface,
    own: Reservoir<Sample>,
    others: &[Other<'_>],
    settings: &Settings,
    counts: &mut Counts,
    uniforms: &[f64],
) -> Reservoir<Sample> {
    let mut inputs: Vec<Input<Sample>> = vec![own.into()];
    for other in others {
        let sample = other.reservoir.sample.filter(|_| other.reservoir.weight > 0.0);
        let factor = sample.map(|sample| settings.factor(&other.surface, surface, &sample));
        counts.jacobian += u64::from(factor == Some(None));
        counts.occluded += u64::from(sample.is_some_and(|sample| !scene.visible(surface, &sample)));
        let jacobian = factor.flatten().unwrap_or(0.0);
        inputs.push(Input { reservoir: other.reservoir, jacobian });
    }
    let target = |i: usize, sample: &Sample| {
        if i == 0 {
            return lit(scene, surface, sample);
        }
        let Other { scene, surface: theirs, .. } = &others[i - 1];
        let there = if settings.neighbours_see { lit(scene, theirs, sample) } else { scene.reflected(theirs, sample) };
        settings.factor(surface, theirs, sample).map_or(0.0, |factor| there * factor)
    };
    merge(&inputs, 0, settings.weights, target, uniforms)
}

/// A frame: one ray per pixel, temporal reuse, spatial reuse from the temporal reservoirs into others. Pixels that
/// moved since the frame `before` keep their index. Uniform numbers are taken pixel by pixel within each of the three
/// passes.
pub fn frame<'a>(
    scene: &'a Scene,
    before: Option<&Frame<'_>>,
    settings: &Settings,
    next: &mut impl FnMut() -> f64,
) -> Frame<'a> {
    let surfaces = || scene.pixels.iter().enumerate().filter_map(|(pixel, s)| s.map(|s| (pixel, s)));
    let mut temporal = vec![Reservoir::empty(); scene.pixels.len()];
    for (pixel, surface) in surfaces() {
        temporal[pixel] = initial(scene, &surface, settings.directions, [next(), next()]);
    }
    for (pixel, surface) in surfaces().filter(|_| settings.cap > 0.0) {
        let Some((frame, earlier)) = before.and_then(|frame| Some((frame, frame.scene.pixels[pixel]?))) else {
            continue;
        };
        let reservoir = frame.temporal[pixel].capped(settings.cap);
        let other = Other { scene: frame.scene, surface: earlier, reservoir };
        let uniforms = [next(), next()];
        let uncounted = &mut Counts::default();
        temporal[pixel] = reuse(scene, &surface, temporal[pixel], &[other], settings, uncounted, &uniforms);
    }
    let mut spatial = vec![Reservoir::empty(); scene.pixels.len()];
    let mut counts = Counts::default();
    for (pixel, surface) in surfaces() {
        let mut others = Vec::new();
        for _ in 0..settings.neighbours {
            let first = pixel.saturating_sub(settings.radius);
            let last = (pixel + settings.radius).min(scene.pixels.len() - 1);
            let other = first + (next() * (last - first + 1) as f64) as usize;
            let Some(theirs) = scene.pixels[other].filter(|_| other != pixel) else { continue };
            counts.neighbours += 1;
            if theirs.normal.dot(surface.normal) < settings.least_cosine {
                counts.unlike += 1;
                continue;
            }
            others.push(Other { scene, surface: theirs, reservoir: temporal[other] });
        }
        let uniforms: Vec<f64> = (0..=others.len()).map(|_| next()).collect();
        spatial[pixel] = reuse(scene, &surface, temporal[pixel], &others, settings, &mut counts, &uniforms);
    }
    Frame { scene, temporal, spatial, counts }
}
