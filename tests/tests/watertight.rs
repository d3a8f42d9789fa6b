//! No ray leaves a closed mesh: rays from inside at edges and vertices always hit with the software traversal. Leaks of the driver's
//! structures are printed only, as Vulkan guarantees watertightness for single edges of one geometry only.
//!
//! Meshes are rotated, scaled, mirrored and far from the origin. Every ray is aimed at a vertex or at a point of an edge, exactly in `f32`
//! or a few representable floats beside it.
#![allow(clippy::unwrap_used, reason = "the helpers of tests fail as tests do")]
use anyhow::{Result, ensure};
use glam::{Affine3A, DVec3, Vec3};
use magpie::gpu::Gpu;
use magpie::prelude::Rays;
use magpie_bench::rays::{
    Change, Placed, Question, Random, RayTable, Shape, Target, Tracer, World, WorldOptions, rotation,
};
use magpie_shaders::rays::RayTask;
use magpie_shaders::scene::INSTANCE_MASK_ALL;
use magpie_tests::harness::{asset, gpu};
use magpie_tests::oracle::rays::{double, is_inside};
use std::collections::HashMap;
use std::env;
use std::f32::consts::TAU;

/// Rays over all meshes; ten times as many with MAGPIE_FULL.
const RAYS: usize = 1_000_000;
/// Transforms per mesh.
const PLACINGS: usize = 10;
/// Points inside a mesh at which rays start.
const POINTS: usize = 20;
/// Least distance of these points from every vertex, relative to the size of the mesh, so that rounding of a transform does not matter.
const MARGIN: f32 = 0.01;
/// Greatest translation relative to the size of the mesh: `f32` then moves a point by less than 1e-3 of the size.
const OFFSET: f32 = 3000.0;

/// A sphere from an icosahedron, with every triangle split in four `splits` times.
fn icosphere(splits: u32) -> Shape {
    let g = (1.0 + 5_f32.sqrt()) / 2.0;
    let base: [[f32; 3]; 12] = [
        [-1.0, g, 0.0],
        [1.0, g, 0.0],
        [-1.0, -g, 0.0],
        [1.0, -g, 0.0],
        [0.0, -1.0, g],
        [0.0, 1.0, g],
        [0.0, -1.0, -g],
        [0.0, 1.0, -g],
        [g, 0.0, -1.0],
        [g, 0.0, 1.0],
        [-g, 0.0, -1.0],
        [-g, 0.0, 1.0],
    ];
    let mut positions: Vec<Vec3> = base.map(|p| Vec3::from(p).normalize()).to_vec();
    let mut indices: Vec<u32> = vec![
        0, 11, 5, 0, 5, 1, 0, 1, 7, 0, 7, 10, 0, 10, 11, 1, 5, 9, 5, 11, 4, 11, 10, 2, 10, 7, 6, 7, 1, 8, 3, 9, 4, 3,
        4, 2, 3, 2, 6, 3, 6, 8, 3, 8, 9, 4, 9, 5, 2, 4, 11, 6, 2, 10, 8, 6, 7, 9, 8, 1,
    ];
    for _ in 0..splits {
        let mut middles = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                positions.push((positions[a as usize] + positions[b as usize]).normalize());
                positions.len() as u32 - 1
            })
        };
        let split = indices.as_chunks::<3>().0.iter().flat_map(|&[a, b, c]| {
            let (d, e, f) = (middle(a, b), middle(b, c), middle(c, a));
            [a, d, f, d, b, e, f, e, c, d, e, f]
        });
        indices = split.collect();
    }
    Shape { positions, indices }
}

/// A tube along a (2, 3) torus knot.
fn knot(along: u32, around: u32) -> Shape {
    let centre = |i: u32| {
        let a = TAU * i as f32 / along as f32;
        let r = 2.0 + (3.0 * a).cos();
        Vec3::new(r * (2.0 * a).cos(), r * (2.0 * a).sin(), (3.0 * a).sin())
    };
    let mut positions = Vec::new();
    for i in 0..along {
        let tangent = (centre((i + 1) % along) - centre((i + along - 1) % along)).normalize();
        let side = tangent.cross(Vec3::Z).normalize();
        let up = side.cross(tangent);
        for j in 0..around {
            let b = TAU * j as f32 / around as f32;
            positions.push(centre(i) + 0.4 * (b.cos() * side + b.sin() * up));
        }
    }
    let vertex = |i: u32, j: u32| i % along * around + j % around;
    let quad = |i: u32, j: u32| {
        let [a, b, c, d] = [vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)];
        [a, b, c, a, c, d]
    };
    let indices = (0..along).flat_map(|i| (0..around).flat_map(move |j| quad(i, j))).collect();
    Shape { positions, indices }
}

/// A box with ends that are triangle fans: slivers a thousand times as long as wide.
fn slivers(count: u32) -> Shape {
    // A prism over a rectangle with many vertices on its long side.
    let mut outline = vec![Vec3::new(-10.0, -0.5, 0.0), Vec3::new(10.0, -0.5, 0.0)];
    // Not quite straight, so that no triangle of the fan is degenerate.
    let along = |i: u32| 20.0 * i as f32 / count as f32 - 10.0;
    outline.extend((0..=count).rev().map(|i| Vec3::new(along(i), 0.5 - 1e-3 * along(i).powi(2) / 10.0, 0.0)));
    let n = outline.len() as u32;
    let mut positions: Vec<Vec3> = outline.iter().map(|p| *p - Vec3::Z).collect();
    positions.extend(outline.iter().map(|p| *p + Vec3::Z));
    let mut indices = Vec::new();
    for i in 1..n - 1 {
        indices.extend([0, i + 1, i, n, n + i, n + i + 1]);
    }
    for i in 0..n {
        let j = (i + 1) % n;
        indices.extend([i, j, n + j, i, n + j, n + i]);
    }
    Shape { positions, indices }
}

/// Whether every edge has its opposite; coincident vertices are merged.
fn is_closed(shape: &Shape) -> bool {
    let key = |i: u32| shape.positions[i as usize].to_array().map(|x| (x + 0.0).to_bits());
    let mut edges: HashMap<_, i32> = HashMap::new();
    for t in shape.indices.as_chunks::<3>().0 {
        for k in 0..3 {
            let (a, b) = (key(t[k]), key(t[(k + 1) % 3]));
            if a != b {
                *edges.entry((a.min(b), a.max(b))).or_default() += if a < b { 1 } else { -1 };
            }
        }
    }
    !edges.is_empty() && edges.values().all(|n| *n == 0)
}

fn size(shape: &Shape) -> (Vec3, Vec3) {
    shape.positions.iter().fold((Vec3::MAX, Vec3::MIN), |(lo, hi), p| (lo.min(*p), hi.max(*p)))
}

/// Points well inside the mesh; empty if there are none.
fn inner_points(shape: &Shape, random: &mut Random) -> Vec<Vec3> {
    let (lo, hi) = size(shape);
    let margin = MARGIN * (hi - lo).length();
    let inside = |p: Vec3| is_inside(&shape.positions, &shape.indices, p.as_dvec3());
    // Small steps in all directions stay inside as well.
    let steps = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| [axis * margin, -axis * margin]);
    let well_inside = |p: Vec3| inside(p) && steps.iter().flatten().all(|s| inside(p + *s));
    (0..4000).map(|_| random.point(lo, hi)).filter(|p| well_inside(*p)).take(POINTS).collect()
}

/// A random rotation, scale, mirroring and translation; the first is the identity.
fn placing(number: usize, span: f32, random: &mut Random) -> Affine3A {
    if number == 0 {
        return Affine3A::IDENTITY;
    }
    let scale = 10_f32.powf(random.range(-3.0, 3.0));
    let mut scales = Vec3::new(random.range(0.5, 2.0), random.range(0.5, 2.0), random.range(0.5, 2.0)) * scale;
    if number % 2 == 1 {
        scales.x = -scales.x;
    }
    let far = if number.is_multiple_of(3) { OFFSET * 0.25 * span * scale } else { 2.0 * span * scale };
    Affine3A::from_scale_rotation_translation(scales, rotation(random), random.direction() * far)
}

/// `x` moved by a few representable floats.
fn nudge(x: f32, random: &mut Random) -> f32 {
    let steps = (random.bits() % 7) as i32 - 3;
    f32::from_bits((x.to_bits() as i32 + steps).max(0) as u32)
}

/// A ray from a point inside to a vertex or a point of an edge.
fn ray(shape: &Shape, points: &[Vec3], world: &Affine3A, random: &mut Random) -> RayTask {
    let exact = double(world);
    let pick = |n: usize, random: &mut Random| (random.bits() % n as u64) as usize;
    let triangle = 3 * pick(shape.indices.len() / 3, random);
    let edge = pick(3, random);
    let corner = |k: usize| shape.positions[shape.indices[triangle + k % 3] as usize].as_dvec3();
    let along = [0.0, 0.5, f64::from(random.unit())][pick(3, random)];
    let target: DVec3 = exact.transform_point3(corner(edge).lerp(corner(edge + 1), along));
    let mut target = target.as_vec3();
    if random.bits().is_multiple_of(2) {
        target = Vec3::new(nudge(target.x, random), nudge(target.y, random), nudge(target.z, random));
    }
    let origin = exact.transform_point3(points[pick(points.len(), random)].as_dvec3()).as_vec3();
    RayTask {
        origin: origin.to_array(),
        t_min: 0.0,
        direction: (target - origin).to_array(),
        t_max: 1e30,
        mask: INSTANCE_MASK_ALL,
        cull: 0,
    }
}

/// Rays that leaked, by backend.
fn leaks(
    gpu: &Gpu,
    tracer: &mut Tracer,
    name: &str,
    shape: &Shape,
    count: usize,
) -> Result<HashMap<&'static str, (usize, usize)>> {
    ensure!(is_closed(shape), "{name} is not closed");
    let mut random = Random::new(0xc105ed);
    let points = inner_points(shape, &mut random);
    ensure!(!points.is_empty(), "{name} has no inside");
    let (lo, hi) = size(shape);
    let shapes = [shape.clone()];
    let at = [Placed::new(0, Affine3A::IDENTITY)];
    let ways = tracer.ways();
    let mut worlds = HashMap::new();
    for &rays in ways.iter().take(2) {
        let options = WorldOptions { refit: false, ..WorldOptions::new(rays) };
        worlds.insert(rays == Rays::Software, World::new(gpu, &mut tracer.executor, &shapes, &at, options)?);
    }
    let mut out: HashMap<_, (usize, usize)> = HashMap::new();
    for number in 0..PLACINGS {
        let world = placing(number, (hi - lo).length(), &mut random);
        for resident in worlds.values_mut() {
            resident.follow(&mut tracer.executor, &[Placed::new(0, world)], Change::Rebuild)?;
        }
        let rays = (0..count / PLACINGS).map(|_| ray(shape, &points, &world, &mut random)).collect();
        let table = RayTable::of(rays, Question::Closest);
        let on_device = tracer.upload(&table)?;
        for &way in &ways {
            let answers = tracer.closest(way, Target::World(&worlds[&(way == Rays::Software)]), &on_device)?;
            let missed: Vec<_> = answers.iter().zip(&table.rays).filter(|(a, _)| a.instance == u32::MAX).collect();
            for (_, ray) in missed.iter().take(if way == Rays::Software { 3 } else { 0 }) {
                println!("{name}, placing {number} {world:?}: {ray:?} got out");
            }
            let sum = out.entry(way.name()).or_default();
            *sum = (sum.0 + missed.len(), sum.1 + answers.len());
        }
    }
    println!("{name}, {} triangles: {out:?} rays got out, of so many", shape.indices.len() / 3);
    Ok(out)
}

/// Two closed meshes of the robot, the largest for which finding inside points is feasible.
fn robot() -> Result<Vec<(String, Shape)>> {
    let Some(scene) = asset("pica_pica_robot/robot_01.glb")? else { return Ok(Vec::new()) };
    let mut closed: Vec<(String, Shape)> = scene
        .meshes
        .iter()
        .map(|m| (m.name.clone(), Shape { positions: m.positions.clone(), indices: m.indices.clone() }))
        .filter(|(_, shape)| is_closed(shape))
        .collect();
    println!("the robot has {} meshes, {} of them closed", scene.meshes.len(), closed.len());
    closed.retain(|(_, shape)| shape.indices.len() < 60_000);
    closed.sort_by_key(|(_, shape)| std::cmp::Reverse(shape.indices.len()));
    closed.truncate(2);
    Ok(closed)
}

#[test]
fn no_ray_gets_out() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut tracer = Tracer::new(&gpu, &gpu.rays())?;
    let mut meshes = vec![
        ("icosphere".to_owned(), icosphere(4)),
        ("torus knot".to_owned(), knot(240, 16)),
        ("slivers".to_owned(), slivers(1000)),
    ];
    meshes.extend(robot()?);
    let full = env::var_os("MAGPIE_FULL").is_some();
    let count = if full { 10 * RAYS } else { RAYS }.div_ceil(meshes.len());
    let mut escaped = 0;
    let mut traced = 0;
    for (name, shape) in &meshes {
        let out = leaks(&gpu, &mut tracer, name, shape, count)?;
        let (missed, of) = out["software"];
        (escaped, traced) = (escaped + missed, traced + of);
    }
    println!("{escaped} of {traced} rays got out of the software walk");
    ensure!(escaped == 0, "{escaped} of {traced} rays got out");
    Ok(())
}

#[test]
fn a_hole_is_seen() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut open = icosphere(2);
    open.indices.truncate(open.indices.len() - 3);
    assert!(is_closed(&icosphere(2)) && !is_closed(&open));
    let mut tracer = Tracer::new(&gpu, &[Rays::Software])?;
    let shapes = [open];
    let options = WorldOptions::new(Rays::Software);
    let placed = [Placed::new(0, Affine3A::IDENTITY)];
    let world = World::new(&gpu, &mut tracer.executor, &shapes, &placed, options)?;
    let mut random = Random::new(2);
    let whole = icosphere(2);
    let rays = (0..100_000).map(|_| ray(&whole, &[Vec3::ZERO], &Affine3A::IDENTITY, &mut random)).collect();
    let table = tracer.upload(&RayTable::of(rays, Question::Closest))?;
    let answers = tracer.closest(Rays::Software, Target::World(&world), &table)?;
    // Two thirds of the rays at the missing triangle aim at its outline, which its neighbours share.
    assert!(answers.iter().filter(|a| a.instance == u32::MAX).count() > 10);
    Ok(())
}
