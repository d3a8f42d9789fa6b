//! ReSTIR DI (Bitterli et al. 2020, algorithm 5) on a floor with point lights and boxes that cast shadows.
//!
//! A sample is the index of a light. Directions and distances are kept as tables, so that thousands of frames take
//! seconds.

use super::mis::{Input, Weights, merge};
use super::reservoir::Reservoir;
use super::ris::{Candidate, pick, streaming};
use glam::DVec3;
use std::f64::consts::FRAC_1_PI;

/// A white diffuse surface that a pixel shows.
#[derive(Clone, Copy, Debug)]
pub struct Surface {
    /// Metres.
    pub position: DVec3,
    /// Unit.
    pub normal: DVec3,
}

/// A point light.
#[derive(Clone, Copy, Debug)]
pub struct PointLight {
    /// Metres.
    pub position: DVec3,
    /// Candela.
    pub intensity: f64,
}

/// A box that casts shadows.
#[derive(Clone, Copy, Debug)]
pub struct Block {
    /// Corner of least coordinates.
    pub min: DVec3,
    /// Corner of greatest coordinates.
    pub max: DVec3,
}

impl Block {
    /// Whether the segment passes through the box.
    fn hides(&self, from: DVec3, to: DVec3) -> bool {
        let slope = (to - from).recip();
        let (a, b) = ((self.min - from) * slope, (self.max - from) * slope);
        let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
        enter.max(0.0) < leave.min(1.0)
    }
}

/// What each pixel gets from each light.
#[derive(Clone, Debug)]
pub struct Scene {
    /// What the pixels show, row by row; `None` is sky.
    pub pixels: Vec<Option<Surface>>,
    /// Pixels per row.
    pub width: usize,
    /// The lights. Samples are indices into these.
    pub lights: Vec<PointLight>,
    unshadowed: Vec<Vec<f64>>,
    visible: Vec<Vec<bool>>,
}

impl Scene {
    /// Makes the tables.
    pub fn new(pixels: Vec<Option<Surface>>, width: usize, lights: Vec<PointLight>, blocks: &[Block]) -> Self {
        let reflected = |surface: &Surface, light: &PointLight| {
            let to_light = light.position - surface.position;
            let cosine = surface.normal.dot(to_light.normalize()).max(0.0);
            FRAC_1_PI * light.intensity * cosine / to_light.length_squared()
        };
        let seen = |surface: &Surface, light: &PointLight| {
            !blocks.iter().any(|block| block.hides(surface.position, light.position))
        };
        let unshadowed = pixels.iter().map(|p| lights.iter().map(|l| p.map_or(0.0, |p| reflected(&p, l))).collect());
        let visible = pixels.iter().map(|p| lights.iter().map(|l| p.is_some_and(|p| seen(&p, l))).collect());
        Self { unshadowed: unshadowed.collect(), visible: visible.collect(), pixels, width, lights }
    }

    /// Light reflected at a pixel if nothing were in between, `ρ L_e G`.
    pub fn unshadowed(&self, pixel: usize, light: usize) -> f64 {
        self.unshadowed[pixel][light]
    }

    /// Whether nothing is between a pixel's surface and a light; false for sky.
    pub fn visible(&self, pixel: usize, light: usize) -> bool {
        self.visible[pixel][light]
    }

    /// The integrand `f = ρ L_e G V`.
    pub fn reflected(&self, pixel: usize, light: usize) -> f64 {
        if self.visible(pixel, light) { self.unshadowed(pixel, light) } else { 0.0 }
    }

    /// The sum over all lights.
    pub fn truth(&self, pixel: usize) -> f64 {
        (0..self.lights.len()).map(|light| self.reflected(pixel, light)).sum()
    }

    /// The probability of drawing each light as a candidate.
    pub fn source(&self, pixel: usize, source: Source) -> Vec<f64> {
        let Some(surface) = self.pixels[pixel] else { return Vec::new() };
        let raw = |light: &PointLight| match source {
            Source::Uniform => 1.0,
            Source::Intensity => light.intensity,
            Source::Distance => light.intensity / light.position.distance_squared(surface.position),
        };
        let sum: f64 = self.lights.iter().map(raw).sum();
        self.lights.iter().map(|light| raw(light) / sum).collect()
    }
}

/// How candidates are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// Each light alike.
    Uniform,
    /// In proportion to intensity.
    Intensity,
    /// In proportion to intensity over squared distance.
    Distance,
}

/// Where shadow rays are traced, besides the one that shades.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Visibility {
    /// For each evaluation of a target: `p̂ = ρ L_e G V`.
    InTarget,
    /// `p̂ = ρ L_e G`. The chosen sample is thrown away if it is occluded, of the initial candidates and after each
    /// merge; and a merge asks for each neighbour whether it sees the sample.
    Retraced,
    /// `p̂ = ρ L_e G`. Only the choice among the initial candidates is thrown away if it is occluded (algorithm 5,
    /// lines 5 to 7). Merges are then biased, whatever their weights: they take neighbours for able to make what they
    /// do not see.
    Reused,
}

/// Settings of a frame.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Initial candidates `M` per pixel.
    pub candidates: usize,
    /// Their distribution.
    pub source: Source,
    /// Weights of merging.
    pub weights: Weights,
    /// Shadow rays.
    pub visibility: Visibility,
    /// Whether the frame before is reused.
    pub temporal: bool,
    /// The most confidence of the frame before, in units of this frame's; infinite for no cap.
    pub cap: f64,
    /// Spatial iterations `n`.
    pub iterations: usize,
    /// Neighbours `k` per iteration.
    pub neighbours: usize,
    /// They are at most so many rows and columns away.
    pub radius: usize,
}

/// For each light of the frame before, its index now; `None` where it is gone.
#[derive(Clone, Debug)]
pub struct Remap(pub Vec<Option<usize>>);

impl Remap {
    /// Of lights that kept their indices.
    pub fn same(lights: usize) -> Self {
        Self((0..lights).map(Some).collect())
    }

    /// The index that a light had in the frame before; `None` for a new one.
    pub fn before(&self, light: usize) -> Option<usize> {
        self.0.iter().position(|&now| now == Some(light))
    }
}

/// The reservoirs of a frame, with the scene that they were chosen for.
#[derive(Clone, Debug)]
pub struct Frame<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// One per pixel; empty for sky.
    pub reservoirs: Vec<Reservoir<usize>>,
}

impl Frame<'_> {
    /// The estimate `f(y) W` of a pixel, its shadow ray included.
    pub fn shade(&self, pixel: usize) -> f64 {
        self.reservoirs[pixel].shade(|&light| self.scene.reflected(pixel, light))
    }

    /// The mean of the estimates over all pixels.
    pub fn mean(&self) -> f64 {
        (0..self.reservoirs.len()).map(|pixel| self.shade(pixel)).sum::<f64>() / self.reservoirs.len() as f64
    }
}

/// The target of a pixel for resampling its own reservoir.
fn own_target(scene: &Scene, pixel: usize, light: usize, visibility: Visibility) -> f64 {
    match visibility {
        Visibility::InTarget => scene.reflected(pixel, light),
        Visibility::Retraced | Visibility::Reused => scene.unshadowed(pixel, light),
    }
}

/// The target that a reservoir of another pixel or frame was chosen for, so far as merging knows it.
fn other_target(scene: &Scene, pixel: usize, light: usize, visibility: Visibility) -> f64 {
    match visibility {
        Visibility::InTarget | Visibility::Retraced => scene.reflected(pixel, light),
        Visibility::Reused => scene.unshadowed(pixel, light),
    }
}

/// Throws an occluded sample away.
fn test_visibility(scene: &Scene, pixel: usize, reservoir: &mut Reservoir<usize>) {
    if reservoir.sample.is_some_and(|light| !scene.visible(pixel, light)) {
        reservoir.discard();
    }
}

/// Draws candidates and chooses one (algorithm 5, lines 3 to 7): with `M` candidates, takes `M` uniform numbers for
/// drawing, then `M` for choosing.
pub fn initial(scene: &Scene, pixel: usize, settings: &Settings, next: &mut impl FnMut() -> f64) -> Reservoir<usize> {
    let pdfs = scene.source(pixel, settings.source);
    let mut draw = || {
        let light = pick(pdfs.iter().copied(), next()).unwrap_or(0);
        Candidate { sample: light, pdf: pdfs[light] }
    };
    let candidates: Vec<_> = (0..settings.candidates).map(|_| draw()).collect();
    let uniforms: Vec<f64> = (0..settings.candidates).map(|_| next()).collect();
    let target = |&light: &usize| own_target(scene, pixel, light, settings.visibility);
    let mut chosen = streaming(&candidates, target, &uniforms);
    if settings.visibility != Visibility::InTarget {
        test_visibility(scene, pixel, &mut chosen);
    }
    chosen
}

/// Merges a pixel's reservoir with that of the frame before (algorithm 5, lines 8 to 12), with two uniform numbers. The
/// earlier target is that of the earlier scene. The pixels have not moved.
pub fn temporal(
    scene: &Scene,
    pixel: usize,
    current: Reservoir<usize>,
    before: &Frame<'_>,
    remap: &Remap,
    settings: &Settings,
    uniforms: [f64; 2],
) -> Reservoir<usize> {
    let history = before.reservoirs[pixel].map(|light| remap.0[light]);
    let history = history.capped(settings.cap * current.confidence);
    let target = |i: usize, &light: &usize| match (i, remap.before(light)) {
        (0, _) => own_target(scene, pixel, light, settings.visibility),
        (_, Some(earlier)) => other_target(before.scene, pixel, earlier, settings.visibility),
        (_, None) => 0.0,
    };
    finished(scene, pixel, &[current.into(), history.into()], target, settings, &uniforms)
}

/// Merges a pixel's reservoir with those of other pixels (algorithm 5, lines 13 to 17), with one uniform number for it
/// and one for each neighbour. Reads one buffer and returns what belongs into another.
pub fn spatial(
    scene: &Scene,
    pixel: usize,
    reservoirs: &[Reservoir<usize>],
    neighbours: &[usize],
    settings: &Settings,
    uniforms: &[f64],
) -> Reservoir<usize> {
    let pixels: Vec<usize> = [pixel].iter().chain(neighbours).copied().collect();
    let inputs: Vec<Input<usize>> = pixels.iter().map(|&p| reservoirs[p].into()).collect();
    let target = |i: usize, &light: &usize| match i {
        0 => own_target(scene, pixel, light, settings.visibility),
        _ => other_target(scene, pixels[i], light, settings.visibility),
    };
    finished(scene, pixel, &inputs, target, settings, uniforms)
}

fn finished(
    scene: &Scene,
    pixel: usize,
    inputs: &[Input<usize>],
    target: impl Fn(usize, &usize) -> f64,
    settings: &Settings,
    uniforms: &[f64],
) -> Reservoir<usize> {
    let mut merged = merge(inputs, 0, settings.weights, target, uniforms);
    if settings.visibility == Visibility::Retraced {
        test_visibility(scene, pixel, &mut merged);
    }
    merged
}

/// A pixel within the radius, and within the picture, with two uniform numbers; `None` if it is the pixel itself or
/// sky.
fn neighbour(scene: &Scene, pixel: usize, radius: usize, u: [f64; 2]) -> Option<usize> {
    let height = scene.pixels.len() / scene.width;
    let near = |at: usize, size: usize, u: f64| {
        let (first, last) = (at.saturating_sub(radius), (at + radius).min(size - 1));
        first + (u * (last - first + 1) as f64) as usize
    };
    let (x, y) = (near(pixel % scene.width, scene.width, u[0]), near(pixel / scene.width, height, u[1]));
    let other = y * scene.width + x;
    (other != pixel && scene.pixels[other].is_some()).then_some(other)
}

/// A frame: initial candidates, temporal reuse, spatial iterations from buffer to buffer. `before` is the frame before
/// with what became of its lights. Uniform numbers are taken pixel by pixel within each of the three passes.
pub fn frame<'a>(
    scene: &'a Scene,
    before: Option<(&Frame<'_>, &Remap)>,
    settings: &Settings,
    next: &mut impl FnMut() -> f64,
) -> Frame<'a> {
    let surfaces: Vec<usize> = (0..scene.pixels.len()).filter(|&p| scene.pixels[p].is_some()).collect();
    let mut reservoirs = vec![Reservoir::empty(); scene.pixels.len()];
    for &pixel in &surfaces {
        reservoirs[pixel] = initial(scene, pixel, settings, next);
    }
    if let (Some((before, remap)), true) = (before, settings.temporal) {
        for &pixel in &surfaces {
            let uniforms = [next(), next()];
            reservoirs[pixel] = temporal(scene, pixel, reservoirs[pixel], before, remap, settings, uniforms);
        }
    }
    for _ in 0..settings.iterations {
        let mut written = vec![Reservoir::empty(); scene.pixels.len()];
        for &pixel in &surfaces {
            let mut one = |_| neighbour(scene, pixel, settings.radius, [next(), next()]);
            let neighbours: Vec<usize> = (0..settings.neighbours).filter_map(&mut one).collect();
            let uniforms: Vec<f64> = (0..=neighbours.len()).map(|_| next()).collect();
            written[pixel] = spatial(scene, pixel, &reservoirs, &neighbours, settings, &uniforms);
        }
        reservoirs = written;
    }
    Frame { scene, reservoirs }
}
