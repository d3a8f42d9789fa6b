//! Masks, culling, ends of rays: small scenes with known results, with every backend.
#![allow(clippy::unwrap_used, reason = "the helpers of tests fail as tests do")]
use anyhow::Result;
use glam::{Affine3A, Vec3};
use magpie::gpu::Gpu;
use magpie::prelude::Rays;
use magpie_bench::rays::{Placed, Question, RayTable, Shape, Target, Tracer, World, WorldOptions};
use magpie_shaders::bench::RayAnswer;
use magpie_shaders::rays::RayTask;
use magpie_tests::harness::gpu;

const CULL_BACK: u32 = 1;
const CULL_FRONT: u32 = 2;

/// A square of edge 2 in the plane z = 0, facing +z.
fn square() -> Shape {
    let positions = vec![
        Vec3::new(-1.0, -1.0, 0.0),
        Vec3::new(1.0, -1.0, 0.0),
        Vec3::new(1.0, 1.0, 0.0),
        Vec3::new(-1.0, 1.0, 0.0),
    ];
    Shape { positions, indices: vec![0, 1, 2, 0, 2, 3] }
}

fn at(x: f32, z: f32, scale: Vec3) -> Placed {
    Placed::new(0, Affine3A::from_scale_rotation_translation(scale, glam::Quat::IDENTITY, Vec3::new(x, 0.0, z)))
}

/// A ray down -z from 5 m above, or up +z from 5 m below, beside the diagonal.
fn ray(x: f32, from_front: bool) -> RayTask {
    let z = if from_front { 5.0 } else { -5.0 };
    RayTask {
        origin: [x + 0.5, 0.25, z],
        t_min: 0.0,
        direction: [0.0, 0.0, -z / 5.0],
        t_max: 100.0,
        mask: 255,
        cull: 0,
    }
}

/// Traces rays with every backend, checks any-hit rays against them, and returns each backend's answers.
fn answers(gpu: &Gpu, placed: &[Placed], rays: &[RayTask]) -> Result<Vec<(Rays, Vec<RayAnswer>)>> {
    let mut tracer = Tracer::new(gpu, &gpu.rays())?;
    let mut all = Vec::new();
    for way in tracer.ways() {
        let world = World::new(gpu, &mut tracer.executor, &[square()], placed, WorldOptions::new(way))?;
        let rows = magpie::graph::Extent::new(rays.len() as u32, 1);
        let table = RayTable { rays: rays.to_vec(), extent: rows, question: Question::Closest };
        let closest = tracer.upload(&table)?;
        let any = tracer.upload(&RayTable { question: Question::Any, ..table })?;
        let answers = tracer.closest(way, Target::World(&world), &closest)?;
        let met = tracer.any(way, Target::World(&world), &any)?;
        for (i, (answer, met)) in answers.iter().zip(met).enumerate() {
            assert_eq!(answer.instance != u32::MAX, met, "{way}, ray {i}: {answer:?}");
        }
        all.push((way, answers));
    }
    Ok(all)
}

/// Compares with the expected hits: instance and distance.
fn expect(gpu: &Gpu, placed: &[Placed], rays: &[(RayTask, Option<(u32, f32)>)]) -> Result<()> {
    let tasks: Vec<RayTask> = rays.iter().map(|(ray, _)| *ray).collect();
    for (way, answers) in answers(gpu, placed, &tasks)? {
        for (i, (answer, (ray, wanted))) in answers.iter().zip(rays).enumerate() {
            match wanted {
                None => {
                    assert_eq!(answer.instance, u32::MAX, "{way}, ray {i}: {ray:?} met {answer:?}");
                    assert_eq!(answer.t, ray.t_max, "{way}, ray {i}: a miss ends where the ray does");
                }
                Some((instance, t)) => {
                    assert_eq!(answer.instance, *instance, "{way}, ray {i}: {ray:?} met {answer:?}");
                    assert!((answer.t - t).abs() < 1e-5 * t, "{way}, ray {i}: at {} instead of {t}", answer.t);
                }
            }
        }
    }
    Ok(())
}

#[test]
fn rays_see_instances_that_share_a_bit() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let masked = |z: f32, mask: u32| Placed { mask, ..at(0.0, z, Vec3::ONE) };
    // One behind the other: bits 1, 2, 4, none, and all.
    let placed = [masked(4.0, 1), masked(3.0, 2), masked(2.0, 4), masked(1.0, 0), masked(0.0, 255)];
    let with = |mask: u32| RayTask { mask, ..ray(0.0, true) };
    let rays = [
        (with(255), Some((0, 1.0))),
        (with(1), Some((0, 1.0))),
        (with(2), Some((1, 2.0))),
        (with(4), Some((2, 3.0))),
        (with(6), Some((1, 2.0))),
        (with(128), Some((4, 5.0))),
        (with(0), None),
    ];
    expect(&gpu, &placed, &rays)
}

#[test]
fn faces_are_culled_by_their_side_in_object_space() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let plain = Vec3::ONE;
    let placed = [
        at(0.0, 0.0, plain),
        at(10.0, 0.0, Vec3::new(-1.0, 1.0, 1.0)), // mirrored in x: still faces +z
        at(20.0, 0.0, Vec3::new(1.0, 1.0, -1.0)), // mirrored in z: faces -z
        Placed { double_sided: true, ..at(30.0, 0.0, plain) },
        Placed { double_sided: true, ..at(40.0, 0.0, Vec3::new(-1.0, 1.0, 1.0)) },
    ];
    let mut rays = Vec::new();
    for (instance, x, faces_up, double_sided) in [
        (0, 0.0, true, false),
        (1, 10.0, true, false),
        (2, 20.0, false, false),
        (3, 30.0, true, true),
        (4, 40.0, true, true),
    ] {
        for from_front in [true, false] {
            let front = from_front == faces_up;
            for (cull, gone) in [(0, false), (CULL_BACK, !front), (CULL_FRONT, front)] {
                let task = RayTask { cull, ..ray(x, from_front) };
                rays.push((task, (double_sided || !gone).then_some((instance, 5.0))));
            }
        }
    }
    expect(&gpu, &placed, &rays)?;
    // The side of the hit is reported.
    let tasks: Vec<RayTask> = rays.iter().map(|(ray, _)| RayTask { cull: 0, ..*ray }).collect();
    for (way, answers) in answers(&gpu, &placed, &tasks)? {
        for (i, answer) in answers.iter().enumerate() {
            let (from_front, faces_up) = (i % 6 < 3, i / 6 != 2);
            assert_eq!(answer.front == 1, from_front == faces_up, "{way}, ray {i}: {answer:?}");
        }
    }
    Ok(())
}

#[test]
fn culled_faces_do_not_hide_what_is_behind_them() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let placed = [at(0.0, 2.0, Vec3::new(1.0, 1.0, -1.0)), at(0.0, 0.0, Vec3::ONE)];
    let rays = [
        (ray(0.0, true), Some((0, 3.0))),
        (RayTask { cull: CULL_BACK, ..ray(0.0, true) }, Some((1, 5.0))),
        (RayTask { cull: CULL_FRONT, ..ray(0.0, true) }, Some((0, 3.0))),
        (RayTask { cull: CULL_FRONT, ..ray(0.0, false) }, Some((1, 5.0))),
    ];
    expect(&gpu, &placed, &rays)
}

#[test]
fn hits_count_between_both_ends_of_a_ray() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let placed = [at(0.0, 0.0, Vec3::ONE), at(0.0, -1.0, Vec3::ONE)];
    let between = |t_min: f32, t_max: f32| RayTask { t_min, t_max, ..ray(0.0, true) };
    let double = |task: RayTask| RayTask { direction: task.direction.map(|d| 2.0 * d), ..task };
    let rays = [
        (between(0.0, 100.0), Some((0, 5.0))),
        (between(4.99, 5.01), Some((0, 5.0))),
        (between(5.01, 100.0), Some((1, 6.0))),
        (between(5.01, 5.99), None),
        (between(0.0, 4.99), None),
        (between(6.01, 100.0), None),
        // `t` is in lengths of the direction.
        (double(between(0.0, 2.49)), None),
        (double(between(0.0, 2.51)), Some((0, 2.5))),
        (double(between(2.51, 100.0)), Some((1, 3.0))),
    ];
    expect(&gpu, &placed, &rays)
}
