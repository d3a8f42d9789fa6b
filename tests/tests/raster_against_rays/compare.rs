//! Where two answers differ, and why.
use super::look::{Both, EXTENT, Seen};
use anyhow::{Result, ensure};
use magpie::scene::{AlphaMode, Animator, Camera, Scene};
use magpie_tests::oracle::gbuffer::Eye;
use std::collections::BTreeMap;

const ROUNDING: f64 = 2e-5;
const SNAP: f64 = 1.0 / 256.0;
const NORMAL: f64 = 1e-3;
/// Texture coordinates are rounded to 1/256 of a texel where texels are mixed, and alpha goes from 0 to 1 within one.
const ALPHA: f32 = 1.0 / 128.0;
/// Cosine below which a surface is seen edge-on: there the 1/256 of a pixel by which vertices are snapped also turn it.
const GRAZING: f64 = 0.02;

/// What two answers for a pixel differ in, and why.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Cause {
    /// Alpha is within its rounding of the cut-off.
    Alpha,
    /// Within a pixel of an edge of what is seen, or on an edge that two triangles share.
    Edge,
    /// The surface is seen edge-on.
    Slope,
    /// None of these.
    Other,
}

/// Pixels of one kind of thing.
#[derive(Clone, Debug, Default)]
pub struct Count {
    pub pixels: u32,
    /// Those that differ, by what and why.
    pub differ: BTreeMap<(Cause, &'static str), u32>,
    /// Those that show another triangle of the same instance: no difference, where the rest agrees.
    pub triangle: u32,
    /// Pixels that show such a thing, by raster and by rays.
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

/// Counts by kind. One thing may be of several kinds; `"all"` counts every pixel once.
pub type Counts = BTreeMap<&'static str, Count>;

/// What each instance of a scene is.
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

/// Depth of the plane of a pixel's surface as it is seen one pixel on in x and in y, over the depth at the pixel.
fn slope(eye: &Eye, seen: &Seen, x: f64, y: f64) -> [f64; 2] {
    let here = seen.normal.dot(eye.ray(x, y));
    [(1.0, 0.0), (0.0, 1.0)].map(|(dx, dy)| (seen.normal.dot(eye.ray(x + dx, y + dy) - eye.ray(x, y)) / here).abs())
}

/// What the two answers for a pixel differ in.
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
    let same_depth = (raster.depth / ray.depth - 1.0).abs() <= bound; // false for a NaN
    if !same_depth {
        return Some("depth");
    }
    None
}

/// Whether a pixel touches an edge of what is seen: within one pixel, in either answer, there is another instance, a crease
/// of more than 5 degrees, or a surface that is not where the plane of this one would be, by more than 1 % of the depth.
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
            let same_plane = (other.depth / expected - 1.0).abs() < 0.01; // false for a NaN
            centre.normal.dot(other.normal) < 5_f64.to_radians().cos() || !same_plane
        })
    })
}

/// Whether both answers are triangles of one instance with an edge in common: the pixel's centre lies on that edge.
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
    // The nearer one is there by one answer only.
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

/// Counts the pixels of one picture.
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
                let tell = |s: &Seen| format!("{} {} {} {:.4}", s.instance, s.primitive, s.depth, s.normal);
                println!("{label} ({x}, {y}) {what}: raster {}, ray {}", tell(raster), tell(ray));
            }
        }
    }
    counts
}

/// Share of the pixels that must agree.
const LEAST: f64 = 0.999;
/// The same for things of small triangles, where by the edges that these share, in 1/256 of a pixel, either triangle may be seen.
const LEAST_OF_SMALL: f64 = 0.995;

/// Prints the counts and fails where a kind disagrees too often or without a known cause.
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
        // Of few pixels a single one is a large share.
        let small = matches!(*kind, "skinned" | "morphed" | "moving");
        let least = if small { LEAST_OF_SMALL } else { LEAST };
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
