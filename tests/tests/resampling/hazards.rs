//! What goes wrong with direct light while things change: caps, lights that change their index, what moves, pixels
//! without a surface.
use crate::direct::{SETTINGS, last_of, pixels_are_true, scene, still, truth};
use crate::{is_darker, is_truth, row};
use glam::DVec3;
use magpie_tests::oracle::path::random::Random;
use magpie_tests::resampling::direct::{Block, Frame, PointLight, Remap, Scene, Settings, Visibility, frame};
use magpie_tests::resampling::estimate::Estimate;
use magpie_tests::resampling::mis::Weights;
use magpie_tests::resampling::reservoir::Reservoir;
use magpie_tests::resampling::scenes::{floor, floor_blocks, floor_lights};

/// Temporal reuse alone.
const TEMPORAL: Settings = Settings { iterations: 0, weights: Weights::Pairwise, ..SETTINGS };

/// H7, F20: with a cap of 20 the confidence of four candidates a frame stays at 84. Without one it grows by four a
/// frame, and with spatial reuse, which adds that of neighbours, by a factor a frame: past what a 32-bit float holds
/// within forty frames.
#[test]
fn caps_bound_confidence() {
    let scene = scene();
    let greatest = |settings: &Settings, frames: usize| {
        let mut random = Random::new(1, 0);
        let mut before: Option<Frame<'_>> = None;
        let same = Remap::same(scene.lights.len());
        for _ in 0..frames {
            let history = before.as_ref().map(|frame| (frame, &same));
            before = Some(frame(&scene, history, settings, &mut || random.unit()));
        }
        before.unwrap().reservoirs.iter().map(|r| r.confidence).fold(0.0, f64::max)
    };
    let uncapped = Settings { cap: f64::INFINITY, ..SETTINGS };
    for frames in [10, 40, 100] {
        assert_eq!(greatest(&TEMPORAL, frames), 4.0 * (frames as f64).min(21.0));
        assert_eq!(greatest(&Settings { iterations: 0, ..uncapped }, frames), 4.0 * frames as f64);
        // Sixteen inputs after two iterations of three neighbours.
        assert!(greatest(&SETTINGS, frames) <= 84.0 * 16.0);
    }
    let grown = greatest(&uncapped, 40);
    println!("confidence after 40 frames without a cap: {grown:e}");
    assert!(grown > f64::from(f32::MAX));
}

/// H7: a history without a cap does not give way to what is new. A lamp that is lit after 300 frames is found late, and
/// the error stays several times as large.
#[test]
fn without_a_cap_a_history_is_slow_to_adapt() {
    let old = scene();
    let mut lights = floor_lights();
    lights[5].intensity = 60.0;
    let new = floor(lights, &floor_blocks());
    let mut scenes = still(&old, 300);
    scenes.extend(still(&new, 30));
    let error = |cap| last_of(&scenes, &Settings { cap, weights: Weights::Support, ..TEMPORAL }, 60, 700).squared_error;
    let [capped, uncapped] = [20.0, f64::INFINITY].map(error);
    println!("squared error 30 frames after a lamp is lit: {capped:.3}, without a cap {uncapped:.3}");
    assert!(uncapped > 2.0 * capped);
}

/// F18: without temporal reuse a frame does not depend on the one before.
#[test]
fn frames_without_temporal_reuse_are_independent() {
    let scene = scene();
    let settings = Settings { temporal: false, ..SETTINGS };
    let of = |before: Option<(&Frame<'_>, &Remap)>, seed, settings: &Settings| {
        let mut random = Random::new(seed, 0);
        frame(&scene, before, settings, &mut || random.unit())
    };
    let same = Remap::same(scene.lights.len());
    let first = of(None, 1, &settings);
    assert_eq!(of(Some((&first, &same)), 2, &settings).reservoirs, of(None, 2, &settings).reservoirs);
    assert_ne!(of(Some((&first, &same)), 2, &SETTINGS).reservoirs, of(None, 2, &SETTINGS).reservoirs);
}

/// F19: at rest the error falls from frame to frame until the cap.
#[test]
fn error_falls_with_frames() {
    let scene = scene();
    let errors = [1, 2, 4, 16].map(|frames| {
        let found = last_of(&still(&scene, frames), &TEMPORAL, 1500, 710 + frames as u64);
        pixels_are_true(&scene, &found);
        found.squared_error
    });
    println!("squared error after 1, 2, 4, 16 frames: {errors:.3?}");
    assert!(errors.windows(2).all(|two| two[1] < 0.9 * two[0]), "{errors:?}");
}

/// The lights after a lamp was removed, one that lit no pixel of the floor, and another took its index; two others
/// changed places.
fn changed_lights() -> (Vec<PointLight>, Remap) {
    let mut lights = floor_lights();
    lights[7] = PointLight { position: DVec3::new(0.8, 0.3, 0.7), intensity: 10.0 };
    lights.swap(2, 3);
    let mut remap = Remap::same(lights.len());
    remap.0.swap(2, 3);
    remap.0[7] = None;
    (lights, remap)
}

/// H10, F23: samples are indices of lights, which follow the lights. The frame in which they change expects the truth,
/// and so does the next. By index alone the mean still holds, if the history keeps its own lights, for an index is but
/// a name; with the new lights in place of its own it does not: it is taken for able to have chosen the new lamp.
#[test]
fn indices_follow_their_lights() {
    let old = scene();
    let (lights, remap) = changed_lights();
    let new = floor(lights, &floor_blocks());
    let same = Remap::same(new.lights.len());
    let after = |remap: &Remap, more: usize, settings: &Settings| {
        let mut scenes = still(&old, 4);
        scenes.push((&new, remap.clone()));
        scenes.extend(still(&new, more));
        last_of(&scenes, settings, 4000, 720)
    };
    for weights in [Weights::Support, Weights::Pairwise] {
        let settings = Settings { weights, iterations: 0, ..SETTINGS };
        let followed = after(&remap, 0, &settings);
        is_truth(&format!("DI, lamp exchanged, {weights:?}"), &followed.mean, truth(&new));
        pixels_are_true(&new, &followed);
        is_truth(&format!("DI, a frame later, {weights:?}"), &after(&remap, 1, &settings).mean, truth(&new));
        let by_index = after(&same, 0, &settings);
        row(&format!("DI, lamp exchanged, by index, {weights:?}"), &by_index.mean, truth(&new));
        println!("squared error {:.3}, by index {:.3}", followed.squared_error, by_index.squared_error);
    }
    // The mistake: the history's target is that of the new lights.
    let mut wrong = Estimate::default();
    for run in 0..2000 {
        let mut random = Random::new(730, run);
        let mut next = || random.unit();
        let settings = Settings { iterations: 0, ..SETTINGS };
        let mut before = frame(&old, None, &settings, &mut next);
        for _ in 0..3 {
            before = frame(&old, Some((&before, &same)), &settings, &mut next);
        }
        before.scene = &new;
        wrong.add(frame(&new, Some((&before, &same)), &settings, &mut next).mean());
    }
    is_darker("DI, lamp exchanged, by index, with the new lights", &wrong, truth(&new), 0.1);
}

/// H12, F23: when a wall and a lamp move, the history is weighted by what was visible then, and its sample is tested by
/// what is visible now. No light leaks and none is lost in the very next frame.
#[test]
fn what_moves_leaves_nothing_behind() {
    let old = scene();
    let mut lights = floor_lights();
    lights[2].position.x -= 2.0;
    let mut blocks = floor_blocks();
    blocks[0] = Block { min: DVec3::new(0.3, 0.2, 0.0), max: DVec3::new(0.4, 3.0, 0.6) };
    let new = floor(lights, &blocks);
    for (weights, visibility, iterations) in [
        (Weights::Support, Visibility::Retraced, 0),
        (Weights::Pairwise, Visibility::Retraced, 1),
        (Weights::Pairwise, Visibility::InTarget, 1),
    ] {
        let mut scenes = still(&old, 3);
        scenes.extend(still(&new, 1));
        let found = last_of(&scenes, &Settings { weights, visibility, iterations, ..SETTINGS }, 4000, 740);
        is_truth(&format!("DI, wall and lamp moved, {weights:?}, {visibility:?}"), &found.mean, truth(&new));
        pixels_are_true(&new, &found);
    }
}

/// H13, F24: sky keeps empty reservoirs, which nothing reuses. Surfaces that come out of the sky have no history, and
/// expect the truth at once.
#[test]
fn sky_keeps_empty_reservoirs() {
    let new = scene();
    let mut pixels = new.pixels.clone();
    for pixel in [0, 1, 6, 7, 8, 13] {
        pixels[pixel] = None;
    }
    let old = Scene::new(pixels, new.width, floor_lights(), &floor_blocks());
    let mut random = Random::new(1, 0);
    let first = frame(&old, None, &SETTINGS, &mut || random.unit());
    for (pixel, reservoir) in first.reservoirs.iter().enumerate() {
        assert_eq!(*reservoir == Reservoir::empty(), old.pixels[pixel].is_none(), "pixel {pixel}");
    }
    let mut scenes = still(&old, 2);
    scenes.extend(still(&new, 1));
    let found = last_of(&scenes, &Settings { weights: Weights::Pairwise, ..SETTINGS }, 2000, 750);
    is_truth("DI, surfaces out of the sky", &found.mean, truth(&new));
    pixels_are_true(&new, &found);
}

/// F02 for a whole frame: where no light shines, nothing is chosen and everything is finite.
#[test]
fn darkness_is_finite() {
    let mut lights = floor_lights();
    lights.iter_mut().for_each(|light| light.intensity = 1e-300);
    lights.iter_mut().take(5).for_each(|light| light.position.z = -2.0);
    let below = floor(lights.clone(), &[]);
    let all = |scene: &Scene, settings: &Settings| {
        let mut random = Random::new(1, 0);
        let same = Remap::same(scene.lights.len());
        let first = frame(scene, None, settings, &mut || random.unit());
        let second = frame(scene, Some((&first, &same)), settings, &mut || random.unit());
        second.reservoirs.iter().all(|r| r.weight.is_finite() && r.weight_sum.is_finite()) && second.mean() >= 0.0
    };
    let box_over_all = [Block { min: DVec3::new(-0.5, -0.5, 0.01), max: DVec3::new(9.0, 9.0, 0.02) }];
    for weights in Weights::ALL {
        let settings = Settings { weights, ..SETTINGS };
        assert!(all(&below, &settings));
        assert!(all(&floor(floor_lights(), &box_over_all), &settings));
    }
}
