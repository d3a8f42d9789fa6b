//! Differences between raster and rays, and their causes.
use super::look::{Both, EXTENT, Seen};
use anyhow::{Result, ensure};
use magpie::scene::{AlphaMode, Animator, Camera, Scene};
use magpie_tests::oracle::gbuffer::Eye;
use std::collections::BTreeMap;

const ROUNDING: f64 = 2e-5;
const SNAP: f64 = 1.0 / 256.0;
const NORMAL: f64 = 1e-3;
/// Tolerance for alpha near the cutoff: texture coordinates are quantised to 1/256 of a texel for filtering, and alpha may go from 0 to 1
/// within a texel.
const ALPHA: f32 = 1.0 / 128.0;
/// Cosine below which a surface counts as edge-on, where vertex snapping also changes its slope.
const GRAZING: f64 = 0.02;

/// Cause of a difference.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Cause {
    /// Alpha is within rounding of the cutoff.
    Alpha,
    /// Within a pixel of a visible edge, or on an edge shared by two triangles.
    Edge,
    /// The surface is seen edge-on.
    Slope,
    /// Unknown.
    Other,
}

/// Statistics of the pixels of one kind of geometry.
#[derive(Clone, Debug, Default)]
pub struct Count {
    pub pixels: u32,
    /// Number of differing pixels by cause and property.
    pub differ: BTreeMap<(Cause, &'static str), u32>,
    /// Pixels with another triangle of the same instance, which is no difference if everything else agrees.
    pub triangle: u32,
    /// Pixels that show this kind, by raster and by rays.
    pub cover: [u32; 2],
}

impl Count {
    pub fn disagree(&self) -> u32 {
        self.differ.values().sum()
    }

    pub fn agreement(&self) -> f64 {
        1.0 - f64::from(self.disagree()) / f64::from(self.pixels.max(1))
    }

    pub fn of(&self, cause: Cause) -> u32 {
        self.differ.iter().filter(|((c, _), _)| *c == cause).map(|(_, n)| n).sum()
    }

    pub fn add(&mut self, other: &Self) {
        self.pixels += other.pixels;
        self.triangle += other.triangle;
        self.cover = [0, 1].map(|i| self.cover[i] + other.cover[i]);
        for (key, n) in &other.differ {
            *self.differ.entry(*key).or_default() += n;
        }
    }
}

/// Statistics by kind. A pixel may count for several kinds; `"all"` has every pixel once.
pub type Counts = BTreeMap<&'static str, Count>;

/// The kinds of each instance.
pub struct Kinds(Vec<Vec<&'static str>>);

impl Kinds {
    pub fn new(scene: &Scene) -> Self {
        let animator = Animator::new(scene);
        let (rest, later) = (animator.pose(0.0), animator.pose(1.3));
        let kinds = scene.instances.iter().enumerate().map(|(i, instance)| {
            let (mesh, material) =
                (&scene.meshes[instance.mesh as usize], &scene.materials[instance.material as usize]);
            let is = [
                ("alpha-tested", material.alpha != AlphaMode::Opaque && mesh.spheres.is_empty()),
                ("opaque", material.alpha == AlphaMode::Opaque || !mesh.spheres.is_empty()),
                ("double-sided", material.double_sided),
                ("skinned", instance.skin.is_some()),
                ("morphed", !mesh.targets.is_empty()),
                ("spheres", !mesh.spheres.is_empty()),
                ("moving", rest.instances[i] != later.instances[i]),
            ];
            is.into_iter().filter(|(_, is)| *is).map(|(kind, _)| kind).collect()
        });
        Self(kinds.collect())
    }

    fn of(&self, seen: &Seen) -> &[&'static str] {
        (seen.instance as usize).checked_sub(1).and_then(|i| self.0.get(i)).map_or(&[], Vec::as_slice)
    }
}

/// Relative change of depth on the plane of a pixel's surface over one pixel in x and in y.
fn slope(eye: &Eye, seen: &Seen, x: f64, y: f64) -> [f64; 2] {
    let here = seen.normal.dot(eye.ray(x, y));
    [(1.0, 0.0), (0.0, 1.0)].map(|(dx, dy)| (seen.normal.dot(eye.ray(x + dx, y + dy) - eye.ray(x, y)) / here).abs())
}

/// The property in which the two answers for a pixel differ, if any.
fn difference(eye: &Eye, raster: &Seen, ray: &Seen, x: f64, y: f64) -> Option<&'static str> {
    if raster.instance != ray.instance {
        return Some("instance");
    }
    if raster.instance == 0 {
        return None;
    }
    if !(raster.normal.cross(ray.normal).length() <= NORMAL && raster.normal.dot(ray.normal) > 0.0) {
        return Some("normal");
    }
    let slope = slope(eye, ray, x, y);
    let bound = ROUNDING + SNAP * (slope[0] + slope[1]);
    let same_depth = (raster.depth / ray.depth - 1.0).abs() <= bound; // false for NaN
    if !same_depth {
        return Some("depth");
    }
    None
}

/// Whether a pixel touches a visible edge: within one pixel, in either answer, there is another instance, a crease of more than 5 degrees,
/// or a depth that differs by more than 1 % from the pixel's plane.
fn at_edge(eye: &Eye, both: &Both, x: i64, y: i64) -> bool {
    let (width, height) = (i64::from(EXTENT.width), i64::from(EXTENT.height));
    [&both.raster, &both.rays].into_iter().any(|image| {
        let centre = &image[(y * width + x) as usize];
        (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (x + dx, y + dy))).any(|(nx, ny)| {
            if !(0..width).contains(&nx) || !(0..height).contains(&ny) {
                return false;
            }
            let other = &image[(ny * width + nx) as usize];
            if other.instance != centre.instance {
                return true;
            }
            if centre.instance == 0 {
                return false;
            }
            let ray = |x: i64, y: i64| eye.ray(x as f64 + 0.5, y as f64 + 0.5);
            let expected = centre.depth * centre.normal.dot(ray(x, y)) / centre.normal.dot(ray(nx, ny));
            let same_plane = (other.depth / expected - 1.0).abs() < 0.01; // false for NaN
            centre.normal.dot(other.normal) < 5_f64.to_radians().cos() || !same_plane
        })
    })
}

/// Whether both answers are triangles of one instance with a common edge, on which the pixel's centre lies.
fn adjacent(scene: &Scene, a: &Seen, b: &Seen) -> bool {
    if a.instance != b.instance || a.instance == 0 {
        return false;
    }
    let mesh = &scene.meshes[scene.instances[a.instance as usize - 1].mesh as usize];
    if !mesh.spheres.is_empty() {
        return false;
    }
    let corners = |triangle: u32| [0, 1, 2].map(|k| mesh.positions[mesh.indices[3 * triangle as usize + k] as usize]);
    let (a, b) = (corners(a.primitive), corners(b.primitive));
    a.iter().filter(|p| b.contains(p)).count() == 2
}

/// Whether the surface of a pixel is seen edge-on.
fn grazing(eye: &Eye, seen: &Seen, x: f64, y: f64) -> bool {
    seen.instance != 0 && seen.normal.dot(eye.ray(x, y).normalize()).abs() < GRAZING
}

fn cause(scene: &Scene, eye: &Eye, both: &Both, x: u32, y: u32) -> Cause {
    let at = (y * EXTENT.width + x) as usize;
    let (raster, ray) = (&both.raster[at], &both.rays[at]);
    // Only one of the answers contains the nearer surface.
    let distance = |s: &Seen| if s.instance == 0 { f64::INFINITY } else { s.depth };
    let nearer = if distance(raster) <= distance(ray) { raster } else { ray };
    let centre = (f64::from(x) + 0.5, f64::from(y) + 0.5);
    if nearer.margin <= ALPHA {
        Cause::Alpha
    } else if at_edge(eye, both, x.into(), y.into()) || adjacent(scene, raster, ray) {
        Cause::Edge
    } else if [raster, ray].into_iter().any(|s| grazing(eye, s, centre.0, centre.1)) {
        Cause::Slope
    } else {
        Cause::Other
    }
}

/// Compares the pixels of one picture.
pub fn compare(scene: &Scene, kinds: &Kinds, camera: &Camera, both: &Both, label: &str) -> Counts {
    let eye = Eye::new(camera, EXTENT);
    let mut counts = Counts::new();
    let mut shown = 0;
    for y in 0..EXTENT.height {
        for x in 0..EXTENT.width {
            let at = (y * EXTENT.width + x) as usize;
            let (raster, ray) = (&both.raster[at], &both.rays[at]);
            let difference = difference(&eye, raster, ray, f64::from(x) + 0.5, f64::from(y) + 0.5);
            let why = difference.map(|what| (cause(scene, &eye, both, x, y), what));
            let (a, b) = (kinds.of(raster), kinds.of(ray));
            for kind in ["all"].iter().chain(a).chain(b.iter().filter(|k| !a.contains(k))) {
                let count = counts.entry(kind).or_default();
                count.pixels += 1;
                count.triangle += u32::from(raster.instance == ray.instance && raster.primitive != ray.primitive);
                count.cover[0] += u32::from(a.contains(kind));
                count.cover[1] += u32::from(b.contains(kind));
                if let Some(why) = why {
                    *count.differ.entry(why).or_default() += 1;
                }
            }
            if let Some((Cause::Other, what)) = why
                && shown < 8
            {
                shown += 1;
                let describe = |s: &Seen| format!("{} {} {} {:.4}", s.instance, s.primitive, s.depth, s.normal);
                println!("{label} ({x}, {y}) {what}: raster {}, ray {}", describe(raster), describe(ray));
            }
        }
    }
    counts
}

/// Least share of pixels that must agree.
const MIN_AGREEMENT: f64 = 0.999;
/// The same for objects with small triangles, whose shared edges are ambiguous to 1/256 of a pixel.
const MIN_AGREEMENT_OF_SMALL: f64 = 0.995;

/// Prints the statistics, and fails if a kind differs too often or without a known cause.
pub fn check(counts: &Counts, label: &str) -> Result<()> {
    for (kind, count) in counts {
        let causes: Vec<_> = count.differ.iter().map(|((cause, what), n)| format!("{cause:?} ({what}) {n}")).collect();
        println!(
            "{label}, {kind}: {:.4} % of {} pixels agree, {} show another triangle; {}",
            100.0 * count.agreement(),
            count.pixels,
            count.triangle,
            causes.join(", ")
        );
    }
    for (kind, count) in counts {
        // A single pixel is a large share of few.
        let small = matches!(*kind, "skinned" | "morphed" | "moving");
        let least = if small { MIN_AGREEMENT_OF_SMALL } else { MIN_AGREEMENT };
        let allowed = ((1.0 - least) * f64::from(count.pixels)).max(1.0);
        ensure!(
            f64::from(count.disagree()) <= allowed,
            "{label}, {kind}: {} pixels disagree: {count:?}",
            count.disagree()
        );
        ensure!(count.of(Cause::Other) == 0, "{label}, {kind}: pixels disagree without a known cause: {count:?}");
    }
    Ok(())
}
