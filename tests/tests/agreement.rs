//! Every backend finds the same hit, and so does a double-precision search through all triangles.
//!
//! Every ray falls into one class, and the counts are printed:
//!
//! - *same*: instance, primitive and side equal those of the software traversal;
//! - *in one place*: both surfaces are crossed, in double precision, at distances that `f32` cannot tell apart, such as decals, the bottom
//!   of a box on the floor, and the two triangles at an edge. Which one is hit first is unspecified;
//! - *outline*: one backend hits a triangle whose edge the ray passes within rounding, or an alpha-tested one near its cutoff; the other
//!   continues behind it;
//! - *unexplained*: an error.
//!
//! Distances of equal hits agree to a relative 1e-4, or to the rounding of the coordinates: the latter for hits much nearer than the scene
//! is large, and for rays that graze a surface. Those are counted too.
#![allow(clippy::unwrap_used, reason = "the helpers of tests fail as tests do")]
use anyhow::{Context, Result, ensure};
use glam::Vec3;
use magpie::gpu::Gpu;
use magpie::prelude::Rays;
use magpie::scene::{ResidentOptions, ResidentScene, Scene, SharedScene};
use magpie_bench::rays::{Question, RayTable, Target, Tracer, bounds, extent_of, random};
use magpie_shaders::bench::RayAnswer;
use magpie_shaders::rays::RayTask;
use magpie_tests::harness::{asset, builtin, gpu};
use magpie_tests::oracle::rays::{Crossing, Triangles};
use rayon::prelude::*;
use std::env;

/// Least share of the rays with the same hit, or another in the same place.
const AGREE: f64 = 0.9999;
/// Greatest share of the rays with another hit in the same place: boxes that stand on a floor.
const IN_ONE_PLACE: f64 = 0.01;
/// Relative difference up to which distances count as equal.
const DISTANCE: f64 = 1e-4;
/// Bound of the accumulated `f32` rounding of transform and intersection.
const ROUNDINGS: f64 = 32.0 * f32::EPSILON as f64;
/// Barycentric coordinate, negated, down to which missing an edge counts as rounding.
const EDGE: f64 = 1e-3;

fn full() -> bool {
    env::var_os("MAGPIE_FULL").is_some()
}

#[derive(Clone, Copy, Debug, Default)]
struct Classes {
    rays: u64,
    hits: u64,
    in_one_place: u64,
    outline: u64,
    unexplained: u64,
    /// Equal hits whose distances differ by more than [`DISTANCE`], but within rounding.
    rounded: u64,
    worst: f64,
}

/// Bound of the rounding error of a distance: that of the corners relative to the ray, larger at grazing angles and along slivers, whose
/// barycentric weights are small differences.
fn rounding(crossing: &Crossing, ray: &RayTask, reach: f64) -> f64 {
    let length = f64::from(Vec3::from(ray.direction).length());
    let largest = reach.max(f64::from(Vec3::from(ray.origin).abs().max_element()));
    ROUNDINGS * (largest / length + crossing.t) / crossing.cosine.max(1e-9) * crossing.slender
}

fn name(answer: &RayAnswer) -> String {
    if answer.instance == u32::MAX {
        return "nothing".to_owned();
    }
    format!("{}/{} at {}", answer.instance, answer.primitive, answer.t)
}

/// Adds one ray to its class.
fn classify(triangles: &Triangles, ray: &RayTask, a: &RayAnswer, b: &RayAnswer, classes: &mut Classes) {
    let at = |answer: &RayAnswer| triangles.crossing(ray, answer.instance, answer.primitive);
    let reach = triangles.reach();
    classes.rays += 1;
    classes.hits += u64::from(a.instance != u32::MAX);
    let apart = (f64::from(a.t) - f64::from(b.t)).abs();
    if (a.instance, a.primitive) == (b.instance, b.primitive) {
        if a.front != b.front {
            classes.unexplained += 1;
            println!("side: {ray:?}: {} from the front {} against {}", name(a), a.front, b.front);
            return;
        }
        if a.t == b.t {
            return;
        }
        let relative = apart / f64::from(a.t).abs();
        if relative <= DISTANCE {
            classes.worst = classes.worst.max(relative);
        } else if at(a).is_some_and(|c| apart <= 2.0 * rounding(&c, ray, reach)) {
            classes.rounded += 1;
        } else {
            classes.unexplained += 1;
            println!("distance: {ray:?}: {} against {}; in f64 {:?}", name(a), name(b), at(a));
        }
        return;
    }
    let near = if a.t <= b.t { at(a) } else { at(b) };
    let place = |a: &Crossing, b: &Crossing| (a.t - b.t).abs() <= rounding(a, ray, reach) + rounding(b, ray, reach);
    match (at(a), at(b), near) {
        (Some(a), Some(b), _) if place(&a, &b) && a.inside > -EDGE && b.inside > -EDGE => classes.in_one_place += 1,
        (_, _, Some(near)) if near.tested || near.inside.abs() < EDGE => classes.outline += 1,
        _ => {
            classes.unexplained += 1;
            println!("{ray:?}: {} against {}; nearest is {near:?}", name(a), name(b));
        }
    }
}

/// The scene for every backend.
struct Ways {
    tracer: Tracer,
    software: SharedScene,
    driver: Option<SharedScene>,
}

impl Ways {
    fn new(gpu: &Gpu, scene: &Scene) -> Result<Self> {
        let ways = gpu.rays();
        let resident = |rays| {
            ResidentScene::new(gpu, scene, ResidentOptions { rays, ..Default::default() }).map(ResidentScene::shared)
        };
        let driver = ways.iter().copied().find(|w| *w != Rays::Software);
        Ok(Self {
            tracer: Tracer::new(gpu, &ways)?,
            software: resident(Rays::Software)?,
            driver: driver.map(resident).transpose()?,
        })
    }

    /// The closest hits of each backend, software first; each is checked against its own any-hit rays.
    fn answers(&mut self, table: &RayTable) -> Result<Vec<(Rays, Vec<RayAnswer>)>> {
        let closest = self.tracer.upload(table)?;
        let any = self.tracer.upload(&RayTable { question: Question::Any, ..table.clone() })?;
        let mut all = Vec::new();
        for rays in self.tracer.ways() {
            let resident = if rays == Rays::Software { Some(&self.software) } else { self.driver.as_ref() };
            let target = Target::Scene(resident.context("no driver's structures")?);
            let answers = self.tracer.closest(rays, target, &closest)?;
            let met = self.tracer.any(rays, target, &any)?;
            let differ = answers.iter().zip(&met).filter(|(a, any)| (a.instance != u32::MAX) != **any).count();
            ensure!(differ == 0, "{rays}: trace_any and trace_closest differ for {differ} rays");
            all.push((rays, answers));
        }
        Ok(all)
    }
}

/// Whether the search through all triangles allows an answer: the first opaque hit, an alpha-tested one before it, one in the same place,
/// or one whose edge is within rounding.
fn allowed(triangles: &Triangles, ray: &RayTask, answer: &RayAnswer) -> bool {
    let crossings = triangles.crossings(ray, EDGE);
    let sure = crossings.iter().find(|c| !c.tested && c.inside > EDGE);
    if answer.instance == u32::MAX {
        return sure.is_none();
    }
    let reach = triangles.reach();
    let found = crossings.iter().find(|c| (c.instance, c.primitive) == (answer.instance, answer.primitive));
    let Some(found) = found else { return false };
    let error = (found.t - f64::from(answer.t)).abs();
    let distance = error <= (DISTANCE * found.t).max(rounding(found, ray, reach));
    let first = sure.is_none_or(|s| found.t <= s.t + rounding(found, ray, reach) + rounding(s, ray, reach));
    distance && first
}

fn agree(gpu: &Gpu, label: &str, scene: &Scene) -> Result<()> {
    let count = if full() { 1_000_000 } else { 100_000 };
    let table = random(bounds(scene), extent_of(count), 0x5eed);
    let mut ways = Ways::new(gpu, scene)?;
    let answers = ways.answers(&table)?;
    let triangles = Triangles::new(scene);
    let (_, software) = &answers[0];
    for (rays, driver) in &answers[1..] {
        let mut classes = Classes::default();
        for ((ray, a), b) in table.rays.iter().zip(software).zip(driver) {
            classify(&triangles, ray, a, b, &mut classes);
        }
        let Classes { rays: count, hits, in_one_place, outline, unexplained, rounded, worst } = classes;
        println!(
            "{label}, software and {rays}: {count} rays, {hits} hits, {in_one_place} in one place, {outline} at an outline, \
             {unexplained} unexplained; distances to {worst:.1e}, {rounded} by rounding"
        );
        let share = |n: u64| n as f64 / count as f64;
        ensure!(hits > count / 10, "{label}: only {hits} of {count} rays meet anything");
        ensure!(unexplained == 0, "{label}, {rays}: {unexplained} rays met something else for no reason");
        ensure!(1.0 - share(outline) >= AGREE, "{label}, {rays}: {outline} of {count} rays differ at outlines");
        ensure!(share(in_one_place) <= IN_ONE_PLACE, "{label}, {rays}: {in_one_place} of {count} met another surface");
        ensure!(share(rounded) <= 0.01, "{label}, {rays}: {rounded} of {count} distances differ by rounding");
    }

    let sample = if full() { 2000 } else { 500 };
    let step = table.rays.len() / sample;
    for (rays, answers) in &answers {
        let wrong: Vec<_> = (0..sample)
            .into_par_iter()
            .map(|i| i * step)
            .filter(|&i| !allowed(&triangles, &table.rays[i], &answers[i]))
            .collect();
        for &i in wrong.iter().take(4) {
            let crossings = triangles.crossings(&table.rays[i], EDGE);
            println!("{:?}: {}, but {:?}", table.rays[i], name(&answers[i]), &crossings[..crossings.len().min(3)]);
        }
        println!("{label}, {rays} and the search through all triangles: {} of {sample} differ", wrong.len());
        ensure!(wrong.is_empty(), "{label}, {rays}: {} of {sample} rays met what the search does not", wrong.len());
    }
    Ok(())
}

#[test]
fn built_in_scenes() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for name in ["cornell", "courtyard"] {
        agree(&gpu, name, &builtin(name)?)?;
    }
    Ok(())
}

#[test]
fn real_scenes() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for file in magpie_tests::harness::REAL_SCENES {
        let Some(scene) = asset(file)? else { return Ok(()) };
        agree(&gpu, file, &scene)?;
    }
    Ok(())
}

#[test]
fn a_difference_without_a_reason_is_seen() -> Result<()> {
    let scene = builtin("cornell")?;
    let triangles = Triangles::new(&scene);
    let table = random(bounds(&scene), extent_of(2000), 1);
    let exact = |ray: &RayTask| {
        let first = triangles.crossings(ray, 0.0).first().copied();
        first.map_or(RayAnswer { t: ray.t_max, instance: u32::MAX, primitive: u32::MAX, ..Default::default() }, |c| {
            RayAnswer { t: c.t as f32, instance: c.instance, primitive: c.primitive, ..Default::default() }
        })
    };
    let miss = RayAnswer { t: 1e30, instance: u32::MAX, primitive: u32::MAX, ..Default::default() };
    let (mut fine, mut through, mut far) = (Classes::default(), Classes::default(), Classes::default());
    let mut refused = 0;
    for ray in &table.rays {
        let answer = exact(ray);
        classify(&triangles, ray, &answer, &answer, &mut fine);
        classify(&triangles, ray, &answer, &miss, &mut through);
        classify(&triangles, ray, &answer, &RayAnswer { t: answer.t * 1.01, ..answer }, &mut far);
        assert!(allowed(&triangles, ray, &answer), "{ray:?}: {answer:?}");
        refused += u64::from(!allowed(&triangles, ray, &miss));
    }
    assert_eq!((fine.in_one_place, fine.outline, fine.unexplained), (0, 0, 0));
    let most = fine.hits * 95 / 100;
    assert!(through.unexplained > most && far.unexplained > most && refused > most, "{through:?} {far:?} {refused}");
    Ok(())
}
