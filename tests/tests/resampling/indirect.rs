//! ReSTIR GI in a corner of glowing walls.
use crate::{is_darker, is_truth, row, runs};
use glam::DVec3;
use magpie_tests::oracle::path::random::Random;
use magpie_tests::resampling::direct::Surface;
use magpie_tests::resampling::estimate::Estimate;
use magpie_tests::resampling::indirect::{
    Counts, Directions, Other, Patch, Sample, Scene, Settings, Shift, frame, initial, jacobian, reuse,
};
use magpie_tests::resampling::mis::{Input, Weights, merge};
use magpie_tests::resampling::reservoir::Reservoir;
use magpie_tests::resampling::scenes::corner;
use std::f64::consts::TAU;

const SETTINGS: Settings = Settings {
    directions: Directions::Cosine,
    weights: Weights::Support,
    shift: Shift::Multiplied,
    limit: 10.0,
    neighbours_see: true,
    cap: 8.0,
    neighbours: 3,
    radius: 3,
    least_cosine: 0.9,
};

/// Rays on each side of the hemisphere for the truth: errors below 0.1 %.
const SIDE: u32 = 256;

/// The truth of each pixel.
fn truths(scene: &Scene) -> Vec<f64> {
    (0..scene.pixels.len()).map(|pixel| scene.truth(pixel, SIDE)).collect()
}

/// Mean of the truths of all pixels.
fn mean(truths: &[f64]) -> f64 {
    truths.iter().sum::<f64>() / truths.len() as f64
}

/// The last of some frames over independent runs: the mean of the picture, each pixel, and what was left out.
struct Found {
    mean: Estimate,
    pixels: Vec<Estimate>,
    counts: Counts,
}

impl Found {
    /// By how many standard errors the pixel is off that is most so, of those that are lit.
    fn worst(&self, truths: &[f64]) -> f64 {
        let lit = self.pixels.iter().zip(truths).filter(|&(_, &truth)| truth > 0.0);
        lit.map(|(estimate, &truth)| estimate.deviate(truth).abs()).fold(0.0, f64::max)
    }
}

fn last_of(scenes: &[&Scene], settings: &Settings, runs: u64, seed: u64) -> Found {
    let pixels = vec![Estimate::default(); scenes[0].pixels.len()];
    let mut found = Found { mean: Estimate::default(), pixels, counts: Counts::default() };
    for run in 0..runs {
        let mut random = Random::new(seed, run);
        let mut before = None;
        for scene in scenes {
            before = Some(frame(scene, before.as_ref(), settings, &mut || random.unit()));
        }
        let end = before.unwrap();
        found.mean.add(end.mean());
        found.pixels.iter_mut().enumerate().for_each(|(pixel, e)| e.add(end.shade(pixel)));
        found.counts.neighbours += end.counts.neighbours;
        found.counts.unlike += end.counts.unlike;
        found.counts.jacobian += end.counts.jacobian;
        found.counts.occluded += end.counts.occluded;
    }
    found
}

/// The picture's mean is the truth within three standard errors, each pixel within four.
#[track_caller]
fn picture_is_true(name: &str, truths: &[f64], found: &Found) {
    is_truth(name, &found.mean, mean(truths));
    assert!(found.worst(truths) < 4.0, "{name}: {}", found.worst(truths));
}

/// The patch test: a unit square around the origin, seen from two places.
const GENERATOR: DVec3 = DVec3::new(0.3, 0.2, 0.7);
const RECEIVER: DVec3 = DVec3::new(-0.5, 0.4, 1.5);

/// Points of the square and their shares of its area.
fn square(side: u32) -> impl Iterator<Item = (DVec3, f64)> {
    let middle = move |k: u32| (f64::from(k) + 0.5) / f64::from(side) - 0.5;
    let area = 1.0 / f64::from(side * side);
    (0..side * side).map(move |i| (DVec3::new(middle(i / side), middle(i % side), 0.0), area))
}

/// Solid angle per area at a point of the square.
fn solid_angle(eye: DVec3, point: DVec3) -> f64 {
    let to_eye = eye - point;
    to_eye.normalize().z / to_eye.length_squared()
}

/// F28: moving a sample to where it was made changes nothing, and moving it there and back neither.
#[test]
fn the_jacobian_of_a_way_and_its_return_is_1() {
    let mut random = Random::new(1, 0);
    for _ in 0..1000 {
        let mut point = || 2.0 * random.unit() * random.direction();
        let (q, r, at) = (point(), point(), point());
        let normal = random.direction();
        assert_eq!(jacobian(q, q, at, normal), 1.0);
        let both = jacobian(q, r, at, normal) * jacobian(r, q, at, normal);
        assert!((both - 1.0).abs() < 1e-9, "{both}");
        // It is the ratio of solid angles, receiver over generator.
        let angle = |eye: DVec3| normal.dot((eye - at).normalize()).abs() / (eye - at).length_squared();
        assert!((jacobian(q, r, at, normal) / (angle(r) / angle(q)) - 1.0).abs() < 1e-9);
    }
}

/// F28, H2: directions to a unit square, drawn at one place and moved to another, cover its solid angle there, 0.3263,
/// if weights are multiplied by the Jacobian. Divided by it they give 5.147, untouched 1.166.
#[test]
fn samples_of_a_patch_cover_its_solid_angle_elsewhere() {
    let true_angle: f64 = square(400).map(|(point, area)| solid_angle(RECEIVER, point) * area).sum();
    assert!((true_angle - 0.3263).abs() < 5e-5, "{true_angle}");
    let expected = |shift: Shift| -> f64 {
        let one = |(point, area): (DVec3, f64)| {
            let j = jacobian(GENERATOR, RECEIVER, point, DVec3::Z);
            let factor = [j, 1.0, 1.0 / j][shift as usize];
            // A sample has density 1 / (solid angle per area) per solid angle and area 1: its weight is the solid angle
            // per area.
            solid_angle(GENERATOR, point) * factor * area
        };
        square(400).map(one).sum()
    };
    let all = [Shift::Multiplied, Shift::Left, Shift::Divided].map(expected);
    println!("multiplied, left, divided: {all:.4?}");
    for (found, right) in all.into_iter().zip([0.3263, 1.166, 5.147]) {
        assert!((found / right - 1.0).abs() < 0.001, "{found}, not {right}");
    }
    // The same by reservoirs that are merged at the receiver, four samples into each.
    let found = runs(30_000, 800, |next| {
        let mut made = Reservoir::empty();
        for _ in 0..4 {
            let point = DVec3::new(next() - 0.5, next() - 0.5, 0.0);
            made.update(point, solid_angle(GENERATOR, point), next());
        }
        made.finish(1.0, 4.0);
        let jacobian = made.sample.map_or(0.0, |point| jacobian(GENERATOR, RECEIVER, point, DVec3::Z));
        let input = Input { reservoir: made, jacobian };
        merge(&[input], 0, Weights::Total, |_, _| 1.0, &[next()]).shade(|_| 1.0)
    });
    is_truth("solid angle of a patch from elsewhere", &found, true_angle);
}

/// The truth itself: what a floor gets from a wall has a closed form, a differential element and a rectangle at a right
/// angle (Howell, A Catalog of Radiation Heat Transfer Configuration Factors, B-3).
#[test]
fn rays_over_the_hemisphere_find_the_view_factor() {
    for distance in [0.1, 0.4, 1.0] {
        let (width, height) = (1.3, 0.8);
        // Front towards +x.
        let wall = Patch { corner: DVec3::ZERO, u: width * DVec3::Y, v: height * DVec3::Z, radiance: [1.0, 1.0] };
        let surface = Surface { position: DVec3::new(distance, 0.0, 0.0), normal: DVec3::Z };
        let scene = Scene { patches: vec![wall], sky: [0.0, 0.0], pixels: vec![Some(surface)] };
        // Corner of the wall opposite the element, with width along the common edge.
        let (y, x) = (distance / width, height / width);
        let long = (x * x + y * y).sqrt();
        let factor = (1.0 / TAU) * ((1.0 / y).atan() - y / long * (1.0 / long).atan());
        let found = scene.truth(0, 1000);
        assert!((found / factor - 1.0).abs() < 0.003, "{distance}: {found} for {factor}");
    }
}

/// F42, F29: four frames with temporal and spatial reuse. With the Jacobian each pixel is what rays over the hemisphere
/// find, for all unbiased weights; left out or the wrong way round it is not.
#[test]
fn indirect_light_needs_its_jacobian() {
    let scene = corner(0.0);
    let truths = truths(&scene);
    for (i, weights) in Weights::UNBIASED.into_iter().enumerate() {
        let found = last_of(&[&scene; 4], &Settings { weights, ..SETTINGS }, 3000, 810 + i as u64);
        picture_is_true(&format!("GI, {weights:?}"), &truths, &found);
    }
    for shift in [Shift::Left, Shift::Divided] {
        for weights in [Weights::Support, Weights::Pairwise] {
            let found = last_of(&[&scene; 4], &Settings { shift, weights, ..SETTINGS }, 3000, 820);
            row(&format!("GI, {weights:?}, Jacobian {shift:?}"), &found.mean, mean(&truths));
            println!("worst pixel: {:.1} standard errors off", found.worst(&truths));
            assert!(found.worst(&truths) > 10.0);
        }
    }
}

/// F42: 1/M is too dark, and so is a merge that takes neighbours for able to make what they do not see.
#[test]
fn biased_indirect_light_is_measurably_darker() {
    let scene = corner(0.0);
    let truth = mean(&truths(&scene));
    for (name, weights, neighbours_see) in
        [("GI, Total", Weights::Total, true), ("GI, Support, neighbours not asked", Weights::Support, false)]
    {
        let settings = Settings { weights, neighbours_see, ..SETTINGS };
        is_darker(name, &last_of(&[&scene; 4], &settings, 5000, 830).mean, truth, 0.03);
    }
}

/// F26: directions drawn uniformly or by the cosine, with or without neighbours of other normals: the mean is the same.
#[test]
fn the_mean_does_not_depend_on_how_directions_are_drawn() {
    let scene = corner(0.0);
    let truths = truths(&scene);
    let settings = Settings { weights: Weights::Pairwise, ..SETTINGS };
    let uniform = Settings { directions: Directions::Uniform, ..settings };
    picture_is_true("GI, uniform directions", &truths, &last_of(&[&scene; 3], &uniform, 3000, 840));
    let any = last_of(&[&scene; 3], &Settings { least_cosine: -1.0, ..settings }, 3000, 850);
    picture_is_true("GI, neighbours of any normal", &truths, &any);
    // F31: around the edge between wall and floor neighbours are left out by their normals.
    let alike = last_of(&[&scene; 3], &settings, 100, 850).counts;
    assert!(any.counts.unlike == 0 && alike.unlike > alike.neighbours / 10, "{alike:?}");
}

/// A camera that moves: the history is moved from where the pixel's surface was to where it is, with a Jacobian of its
/// own. By 1/Z that varies far more than by weights that compare targets.
#[test]
fn a_moving_view_takes_its_history_along() {
    let scenes = [-0.3, -0.1, 0.1, 0.3].map(corner);
    let of = |weights| last_of(&scenes.each_ref(), &Settings { weights, ..SETTINGS }, 3000, 860);
    let [support, pairwise, balance] = Weights::UNBIASED.map(of);
    let truths = truths(&scenes[3]);
    picture_is_true("GI, moving view, Pairwise", &truths, &pairwise);
    picture_is_true("GI, moving view, Balance", &truths, &balance);
    row("GI, moving view, Support", &support.mean, mean(&truths));
    assert!(support.mean.variance() > 3.0 * pairwise.mean.variance());
}

/// F27: merging one new sample with a history is to update it with weight `p̂ / p`, and `W = w_sum / (M p̂)`.
#[test]
fn temporal_reuse_is_an_update() {
    let scene = corner(0.0);
    let surface = scene.pixels[8].unwrap();
    let mut random = Random::new(3, 0);
    let mut merged = Reservoir::empty();
    let mut updated = Reservoir::<Sample>::empty();
    let target = |sample: &Sample| scene.reflected(&surface, sample);
    for _ in 0..20 {
        let new = initial(&scene, &surface, Directions::Cosine, [random.unit(), random.unit()]);
        let u = random.unit();
        if let Some(sample) = new.sample {
            // Of one candidate, W is 1/p.
            updated.update(sample, target(&sample) * new.weight, u);
        } else {
            updated.confidence += 1.0;
        }
        updated.finish(updated.sample.map_or(0.0, |sample| target(&sample)), updated.confidence);
        let inputs = [merged.into(), new.into()];
        merged = merge(&inputs, 0, Weights::Total, |_, sample| target(sample), &[0.0, u]);
        assert_eq!((merged.sample, merged.confidence), (updated.sample, updated.confidence));
        assert!((merged.weight - updated.weight).abs() <= 1e-12 * updated.weight);
    }
    assert!(merged.weight > 0.0);
}

/// H5, F30: a sample that was made at a grazing angle, or that the receiver touches, has a Jacobian without bounds. It
/// is left out and counted; what is left is the pixel's own sample, finite.
#[test]
fn unbounded_jacobians_are_left_out_and_counted() {
    let point = |position: DVec3| Sample::Point { position, normal: DVec3::X, radiance: 2.0 };
    let at = |x: f64, z: f64| Surface { position: DVec3::new(x, 0.0, z), normal: DVec3::Z };
    let wall = point(DVec3::new(0.0, 0.0, 0.5));
    let near = SETTINGS.factor(&at(0.5, 0.0), &at(0.6, 0.0), &wall);
    assert!(near.is_some_and(|j| (0.5..2.0).contains(&j)), "{near:?}");
    // Grazing: exactly, nearly, and the other way round. Touching: both ways.
    for (generator, receiver) in [
        (at(0.0, 0.0), at(0.5, 0.0)),
        (at(1e-9, 0.0), at(0.5, 0.0)),
        (at(0.5, 0.0), at(1e-9, 0.0)),
        (at(0.5, 0.0), at(0.0, 0.5)),
        (at(0.0, 0.5), at(0.5, 0.0)),
        (at(0.0, 0.5), at(0.0, 0.5)),
    ] {
        assert_eq!(SETTINGS.factor(&generator, &receiver, &wall), None, "{generator:?} {receiver:?}");
    }
    let scene = corner(0.0);
    let (far, touching) =
        (scene.pixels[10].unwrap(), Surface { position: DVec3::new(1e-7, 0.0, 0.0), normal: DVec3::Z });
    let own = initial(&scene, &far, Directions::Cosine, [0.9, 0.5]);
    let theirs = Reservoir { sample: Some(wall), weight_sum: 0.0, confidence: 1.0, weight: 3.0 };
    let other = Other { scene: &scene, surface: touching, reservoir: theirs };
    for weights in Weights::ALL {
        let mut counts = Counts::default();
        let settings = Settings { weights, ..SETTINGS };
        let merged = reuse(&scene, &far, own, &[other], &settings, &mut counts, &[0.5, 0.0]);
        assert_eq!((counts.jacobian, merged.sample, merged.confidence), (1, own.sample, 2.0));
        assert!(merged.weight.is_finite() && merged.weight > 0.0);
    }
    // In the corner some are left out. Moved all the same, they make the picture vary more.
    let settings = Settings { weights: Weights::Support, least_cosine: -1.0, ..SETTINGS };
    let limited = last_of(&[&scene; 2], &settings, 2000, 870);
    let all = last_of(&[&scene; 2], &Settings { limit: 1e12, ..settings }, 2000, 870);
    println!(
        "limit 10: {:?}, variance {:.3}; without {:.3}",
        limited.counts,
        limited.mean.variance(),
        all.mean.variance()
    );
    assert!(limited.counts.jacobian > all.counts.jacobian + 1000);
    assert!(all.mean.variance() > 1.5 * limited.mean.variance());
}

/// H6, F38: what comes from the sky is a direction, with a Jacobian of 1. A point at infinity has none.
#[test]
fn directions_into_the_sky_have_jacobian_1() {
    let sky = Sample::Sky { direction: DVec3::Z, radiance: 1.0 };
    assert_eq!(sky.jacobian(GENERATOR, RECEIVER), 1.0);
    assert!(jacobian(GENERATOR, RECEIVER, DVec3::INFINITY, -DVec3::Z).is_nan());
    let open = Scene { patches: Vec::new(), ..corner(0.0) };
    let even = Scene { sky: [0.7, 0.7], ..open.clone() };
    for weights in Weights::ALL {
        // Even light: each estimate is exact. Pixels of the wall share directions with those of the floor only where
        // both see them.
        let found = last_of(&[&even; 3], &Settings { weights, ..SETTINGS }, 50, 880);
        for (pixel, estimate) in found.pixels.iter().enumerate().filter(|&(pixel, _)| even.pixels[pixel].is_some()) {
            assert!((estimate.mean() - 0.7).abs() < 1e-9 && estimate.variance() < 1e-15, "{pixel}: {estimate:?}");
        }
        // The mean of a cosine over the hemisphere is two thirds, weighted by itself.
        let found = last_of(&[&open; 3], &Settings { weights, ..SETTINGS }, 2000, 890);
        let floor = Estimate::of(found.pixels[5..13].iter().map(Estimate::mean)).mean();
        let truth = open.sky[0] * 5.0 / 6.0 + open.sky[1] / 6.0;
        assert!((floor / truth - 1.0).abs() < 0.005, "{floor} for {truth}");
    }
}

/// F32: of two rooms only one is lit. Samples of the lit one are hidden from the other, and it stays black, whatever
/// its neighbours have.
#[test]
fn light_stays_in_its_room() {
    let patch = |corner: [f64; 3], u: [f64; 3], v: [f64; 3], radiance| Patch {
        corner: corner.into(),
        u: u.into(),
        v: v.into(),
        radiance,
    };
    // A wall between the rooms, dark, and a lit ceiling over one.
    let wall = patch([0.0, -5.0, 0.0], [0.0, 10.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0]);
    let ceiling = patch([0.0, -5.0, 1.0], [0.0, 10.0, 0.0], [5.0, 0.0, 0.0], [4.0, 4.0]);
    let floor = [-0.3, -0.2, -0.1, 0.1, 0.2, 0.3]
        .map(|x| Some(Surface { position: DVec3::new(x, 0.0, 0.0), normal: DVec3::Z }));
    let scene = Scene { patches: vec![wall, ceiling], sky: [0.0, 0.0], pixels: floor.to_vec() };
    for weights in Weights::ALL {
        let found = last_of(&[&scene; 3], &Settings { weights, ..SETTINGS }, 500, 895);
        for (pixel, estimate) in found.pixels.iter().enumerate() {
            let truth = scene.truth(pixel, SIDE);
            assert_eq!(truth > 0.5, pixel > 2);
            let dark = pixel < 3 && estimate.mean() == 0.0 && estimate.variance() == 0.0;
            assert!(dark || pixel > 2 && estimate.mean() > 0.3 * truth, "{pixel}: {estimate:?}");
        }
        assert!(found.counts.occluded > 500, "{:?}", found.counts);
    }
}

/// H13: sky keeps empty reservoirs, and nothing is taken from them.
#[test]
fn sky_is_left_out_of_indirect_light() {
    let scene = corner(0.0);
    let mut random = Random::new(1, 0);
    let first = frame(&scene, None, &SETTINGS, &mut || random.unit());
    let second = frame(&scene, Some(&first), &SETTINGS, &mut || random.unit());
    let sky = scene.pixels.len() - 1;
    assert_eq!(
        (second.temporal[sky], second.spatial[sky], second.shade(sky)),
        (Reservoir::empty(), Reservoir::empty(), 0.0)
    );
    let confidence = |reservoirs: &[Reservoir<Sample>]| reservoirs.iter().map(|r| r.confidence).fold(0.0, f64::max);
    // H7: two frames of one sample, and four inputs.
    assert_eq!(confidence(&second.temporal), 2.0);
    assert!(confidence(&second.spatial) <= 8.0);
    let mut last = second;
    for _ in 0..20 {
        last = frame(&scene, Some(&last), &SETTINGS, &mut || random.unit());
    }
    assert_eq!(confidence(&last.temporal), SETTINGS.cap + 1.0);
}
