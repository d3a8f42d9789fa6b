//! Tables of rays: through a camera's pixels, from their hits, and random ones. Deterministic.
use super::{Question, RayTable};
use glam::{Affine3A, Vec3};
use magpie::graph::Extent;
use magpie::scene::{Camera, Light, Scene};
use magpie_shaders::bench::RayAnswer;
use magpie_shaders::rays::RayTask;
use magpie_shaders::scene::INSTANCE_MASK_ALL;
use rayon::prelude::*;
use std::f32::consts::{PI, TAU};

/// Side of the tiles in which threads trace, rays.
const TILE: u32 = 8;
/// Length of ambient-occlusion rays relative to the diagonal of the scene.
const AO_REACH: f32 = 0.05;
/// Offset of ray origins from the surface, relative to the diagonal of the scene.
const LIFT: f32 = 1e-5;
/// `t_max` of unlimited rays, metres.
const FAR: f32 = 1e30;
/// Share of its length by which a shadow ray ends before the light, whose own surface would occlude it.
const LIGHT_MARGIN: f32 = 1e-3;

/// A random number generator (splitmix64: Steele, Lea and Flood 2014, "Fast Splittable Pseudorandom Number Generators").
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    /// Equal seeds give equal sequences.
    pub fn new(seed: u64) -> Self {
        let mut random = Self(seed.wrapping_mul(0xd134_2543_de82_ef95));
        random.bits();
        random
    }

    /// 64 uniform random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1 << 24) as f32
    }

    /// Uniform from `lo` to `hi`.
    pub fn range(&mut self, lo: f32, hi: f32) -> f32 {
        lo + (hi - lo) * self.unit()
    }

    /// Uniform in a box.
    pub fn point(&mut self, lo: Vec3, hi: Vec3) -> Vec3 {
        Vec3::new(self.range(lo.x, hi.x), self.range(lo.y, hi.y), self.range(lo.z, hi.z))
    }

    /// A unit vector, uniform on the sphere.
    pub fn direction(&mut self) -> Vec3 {
        let (z, round) = (self.range(-1.0, 1.0), self.range(0.0, TAU));
        let across = (1.0 - z * z).sqrt();
        Vec3::new(across * round.cos(), across * round.sin(), z)
    }

    /// A cosine-weighted unit vector around `normal`.
    pub fn cosine(&mut self, normal: Vec3) -> Vec3 {
        // A uniform point on the unit sphere that touches the surface, seen from the point of contact.
        (normal + self.direction()).try_normalize().unwrap_or(normal)
    }
}

/// A table size of about `count` rays, twice as wide as high, in whole tiles.
pub fn extent_of(count: u32) -> Extent {
    let height = ((f64::from(count) / 2.0).sqrt() / f64::from(TILE)).round().max(1.0) as u32 * TILE;
    Extent::new(2 * height, height)
}

fn task(origin: Vec3, t_min: f32, direction: Vec3, t_max: f32) -> RayTask {
    let (origin, direction) = (origin.to_array(), direction.to_array());
    RayTask { origin, t_min, direction, t_max, mask: INSTANCE_MASK_ALL, cull: 0 }
}

/// Rays through the centres of a camera's pixels.
pub fn primary(camera: &Camera, extent: Extent) -> RayTable {
    let (width, height) = (extent.width as f32, extent.height as f32);
    let (tangent, eye) = ((camera.vertical_fov / 2.0).tan(), camera.eye().as_vec3());
    let ray = |index: u32| {
        let (x, y) = ((index % extent.width) as f32 + 0.5, (index / extent.width) as f32 + 0.5);
        let across = (2.0 * x / width - 1.0) * tangent * width / height;
        let direction = Vec3::new(across, (1.0 - 2.0 * y / height) * tangent, -1.0);
        task(
            eye,
            camera.near,
            camera.world_from_camera.transform_vector3(direction.as_dvec3()).normalize().as_vec3(),
            FAR,
        )
    };
    let rays = (0..extent.width * extent.height).into_par_iter().map(ray).collect();
    RayTable { rays, extent, question: Question::Closest }
}

/// Rays from random points in a box in random directions.
pub fn random([lo, hi]: [Vec3; 2], extent: Extent, seed: u64) -> RayTable {
    let ray = |index: u32| {
        let mut random = Random::new(seed << 32 | u64::from(index));
        let origin = random.point(lo, hi);
        task(origin, 0.0, random.direction(), FAR)
    };
    let rays = (0..extent.width * extent.height).into_par_iter().map(ray).collect();
    RayTable { rays, extent, question: Question::Closest }
}

/// Bounds of a scene, lower and upper corner, world space, metres.
pub fn bounds(scene: &Scene) -> [Vec3; 2] {
    let mut all = [Vec3::MAX, Vec3::MIN];
    for instance in &scene.instances {
        if let Some([lo, hi]) = scene.meshes[instance.mesh as usize].bounds() {
            for corner in 0..8 {
                let pick = |bit: u32, axis: usize| if corner & bit == 0 { lo[axis] } else { hi[axis] };
                let p = Vec3::new(pick(1, 0), pick(2, 1), pick(4, 2)).as_dvec3();
                let p = instance.world_from_object.transform_point3(p).as_vec3();
                all = [all[0].min(p), all[1].max(p)];
            }
        }
    }
    all
}

/// Hits of primary rays, tile by tile.
pub struct Surfaces {
    points: Vec<Point>,
    /// Diagonal of the scene's bounds, metres.
    diagonal: f32,
}

#[derive(Clone, Copy)]
struct Point {
    position: Vec3,
    /// Geometric normal, towards the ray's origin.
    normal: Vec3,
    seed: u64,
}

impl Surfaces {
    /// The hits of `rays`, given by their `answers`.
    pub fn new(scene: &Scene, rays: &RayTable, answers: &[RayAnswer]) -> Self {
        let [lo, hi] = bounds(scene);
        let Extent { width, height } = rays.extent;
        let in_tiles = (0..height.div_ceil(TILE)).into_par_iter().flat_map_iter(|row| {
            let tiles = (0..width.div_ceil(TILE)).flat_map(|column| (0..TILE * TILE).map(move |i| (column, i)));
            tiles.filter_map(move |(column, i)| {
                let (x, y) = (column * TILE + i % TILE, row * TILE + i / TILE);
                let at = (x < width && y < height).then_some((y * width + x) as usize)?;
                point(scene, &rays.rays[at], &answers[at], at as u64)
            })
        });
        Self { points: in_tiles.collect(), diagonal: (hi - lo).length() }
    }

    /// One ray per point, in tiles. Points without a ray, and those of an incomplete tile, are left out.
    fn table(&self, question: Question, ray: impl Fn(&Point, f32) -> Option<RayTask> + Sync) -> RayTable {
        let lift = LIFT * self.diagonal;
        let listed: Vec<RayTask> = self.points.par_iter().filter_map(|p| ray(p, lift)).collect();
        let tiles = listed.len() as u32 / (TILE * TILE);
        let across = f64::from(tiles).sqrt() as u32;
        let down = tiles.checked_div(across).unwrap_or(0);
        let extent = Extent::new(across * TILE, down * TILE);
        let place = |index: u32| {
            let (x, y) = (index % extent.width, index / extent.width);
            let tile = y / TILE * across + x / TILE;
            listed[(tile * TILE * TILE + y % TILE * TILE + x % TILE) as usize]
        };
        RayTable { rays: (0..extent.width * extent.height).map(place).collect(), extent, question }
    }

    /// Rays to a light, from points that face it.
    pub fn shadow(&self, light: &Light) -> RayTable {
        self.table(Question::Any, |p, lift| {
            let origin = p.position + lift * p.normal;
            let towards = |position: Vec3| (position - origin, 1.0 - LIGHT_MARGIN);
            let (direction, t_max) = match light {
                Light::Directional { direction, .. } => (-*direction, FAR),
                Light::Point { position, .. } | Light::Spot { position, .. } => towards(position.as_vec3()),
                Light::Rectangle { centre, .. } | Light::Disc { centre, .. } | Light::Sphere { centre, .. } => {
                    towards(centre.as_vec3())
                }
            };
            (direction.dot(p.normal) > 0.0).then(|| task(origin, 0.0, direction, t_max))
        })
    }

    /// Short cosine-weighted rays.
    pub fn occlusion(&self) -> RayTable {
        self.table(Question::Any, |p, lift| {
            let direction = Random::new(p.seed).cosine(p.normal);
            Some(task(p.position + lift * p.normal, 0.0, direction, AO_REACH * self.diagonal))
        })
    }

    /// Unlimited cosine-weighted rays.
    pub fn bounce(&self) -> RayTable {
        self.table(Question::Closest, |p, lift| {
            let direction = Random::new(!p.seed).cosine(p.normal);
            Some(task(p.position + lift * p.normal, 0.0, direction, FAR))
        })
    }
}

/// A hit as an origin of rays. For deforming meshes the normal is that of the rest pose, which is accurate enough here.
fn point(scene: &Scene, ray: &RayTask, answer: &RayAnswer, seed: u64) -> Option<Point> {
    let instance = scene.instances.get(answer.instance as usize)?;
    let mesh = &scene.meshes[instance.mesh as usize];
    let (origin, direction) = (Vec3::from(ray.origin), Vec3::from(ray.direction));
    let position = origin + answer.t * direction;
    let world = |p: Vec3| instance.world_from_object.transform_point3(p.as_dvec3()).as_vec3();
    let outwards = match mesh.spheres.get(answer.primitive as usize) {
        Some(sphere) => position - world(sphere.centre),
        None => {
            let corners = mesh.indices.get(3 * answer.primitive as usize..)?.first_chunk::<3>()?;
            let [a, b, c] = corners.map(|i| world(mesh.positions[i as usize]));
            (b - a).cross(c - a)
        }
    };
    let normal = outwards.try_normalize()?;
    let normal = if normal.dot(direction) > 0.0 { -normal } else { normal };
    Some(Point { position, normal, seed })
}

/// A uniformly random rotation (Shoemake 1992, "Uniform Random Rotations").
pub fn rotation(random: &mut Random) -> glam::Quat {
    let (u, a, b) = (random.unit(), TAU * random.unit(), TAU * random.unit());
    let (p, q) = ((1.0 - u).sqrt(), u.sqrt());
    glam::Quat::from_xyzw(p * a.sin(), p * a.cos(), q * b.sin(), q * b.cos()).normalize()
}

/// A camera at a point, looking along -z, with a full vertical angle of view in radians.
pub(super) fn camera_at(eye: Vec3, vertical_fov: f32) -> Camera {
    let world_from_camera = Affine3A::from_translation(eye);
    Camera {
        name: "bench".to_owned(),
        world_from_camera: magpie::scene::double(&world_from_camera),
        vertical_fov: vertical_fov.min(PI - 0.01),
        near: 1e-3,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_twice_as_wide_as_high_in_whole_tiles() {
        for (count, wanted) in [(8_000_000, (4000, 2000)), (262_144, (720, 360)), (1, (16, 8)), (2048, (64, 32))] {
            let extent = extent_of(count);
            assert_eq!((extent.width, extent.height), wanted, "{count}");
        }
    }

    #[test]
    fn random_directions_have_no_favourite() {
        let mut random = Random::new(1);
        let (mut sum, mut square, n) = (Vec3::ZERO, Vec3::ZERO, 100_000);
        for _ in 0..n {
            let d = random.direction();
            assert!((d.length() - 1.0).abs() < 1e-5);
            (sum, square) = (sum + d, square + d * d);
        }
        // Standard deviations: 1/sqrt(3 n) of the mean, sqrt(4/45/n) of the mean square.
        assert!((sum / n as f32).abs().max_element() < 5.0 * (1.0 / 3.0 / n as f32).sqrt(), "{sum}");
        assert!((square / n as f32 - 1.0 / 3.0).abs().max_element() < 5.0 * (4.0 / 45.0 / n as f32).sqrt(), "{square}");
    }

    #[test]
    fn cosine_directions_have_its_mean() {
        let (mut random, normal, n) = (Random::new(2), Vec3::new(0.6, 0.0, -0.8), 100_000);
        let cosines: Vec<f32> = (0..n).map(|_| random.cosine(normal).dot(normal)).collect();
        assert!(cosines.iter().all(|c| *c >= -1e-5));
        // Mean 2/3, variance 1/18.
        let mean = cosines.iter().sum::<f32>() / n as f32;
        assert!((mean - 2.0 / 3.0).abs() < 5.0 * (1.0 / 18.0 / n as f32).sqrt(), "{mean}");
    }

    #[test]
    fn primary_rays_go_through_the_corners_of_the_picture() {
        let table = primary(&camera_at(Vec3::ONE, PI / 2.0), Extent::new(1600, 800));
        let first = Vec3::from(table.rays[0].direction);
        assert!((first / -first.z - Vec3::new(-2.0, 1.0, -1.0)).length() < 0.01, "{first}");
        let last = Vec3::from(table.rays[1600 * 800 - 1].direction);
        assert!((last / -last.z - Vec3::new(2.0, -1.0, -1.0)).length() < 0.01, "{last}");
    }
}
