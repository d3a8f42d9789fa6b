//! Surfels where light and things change: how soon they follow, what is left of light that is gone, and how much they flicker at rest.
use anyhow::{Context, Result, ensure};
use glam::DVec3;
use magpie::gpu::Gpu;
use magpie::scene::Scene;
use magpie_passes::reference::{Only, ReferenceOptions};
use magpie_tests::against::{Shown, blocks, truth_of};
use magpie_tests::gi::{DENOISED, Frames, SURFELS, Way, mean};
use magpie_tests::harness::gpu_without_validation;
use magpie_tests::rooms;
use std::env;

const SIZE: [u32; 2] = [48, 36];
const FRAME: f64 = 1.0 / 60.0;

fn is_full() -> bool {
    env::var_os("MAGPIE_FULL").is_some()
}

/// A change of a scene: from some time and strength of its lamp to others, step by step. A second lamp, where there is one, is off as far as the first is on.
struct Change {
    name: &'static str,
    scene: Scene,
    before: (f64, f32),
    /// Frames in which the change happens, the last of them with the state that stays.
    steps: Vec<(f64, f32)>,
    /// Greatest share of it that may be missing in the picture after 12 and 40 frames.
    missing: [f64; 2],
}

/// 90 % of each is to be seen within 12 frames. What is never found is a part of what is missing; what is late is bounded apart.
fn changes() -> Vec<Change> {
    let moving = || (1..=8).map(|k| (FRAME * f64::from(k), 1.0)).collect();
    vec![
        Change {
            name: "lamp switched on",
            scene: rooms::coloured_lamp(),
            before: (0.0, 0.0),
            steps: vec![(0.0, 1.0)],
            missing: [0.1, 0.02],
        },
        Change {
            name: "lamp switched off",
            scene: rooms::coloured_lamp(),
            before: (0.0, 1.0),
            steps: vec![(0.0, 0.0)],
            missing: [0.06, 0.01],
        },
        Change {
            name: "lamp moves",
            scene: rooms::moving_lamp(),
            before: (0.0, 1.0),
            steps: moving(),
            missing: [0.1, 0.02],
        },
        Change {
            name: "lamp changes colour",
            scene: rooms::lamp_of_two_colours(),
            before: (0.0, 1.0),
            steps: vec![(0.0, 0.0)],
            missing: [0.1, 0.02],
        },
        Change {
            name: "door opens",
            scene: rooms::opening_door(),
            before: (0.0, 1.0),
            steps: moving(),
            missing: [0.1, 0.02],
        },
    ]
}

/// Greatest share of what is seen at rest that may be missing after 40 frames.
const LATE: f64 = 0.01;

/// What was found of a change.
#[derive(Debug)]
struct Answer {
    /// Frame after the change, from 1, in which 90 % of it have been seen and are seen in all later ones; none if not in the frames that were looked at.
    seen: Option<u32>,
    /// Share of the change that is missing in the picture after 12 and 40 frames.
    missing: [f64; 2],
    /// Share of what is seen of the change at rest that is missing after 40 frames: light that is late, without what surfels never find. None
    /// where no frames at rest were looked at.
    late: Option<f64>,
    /// Share of the change that is missing in the mean of the picture after 12 and 40 frames.
    missing_of_mean: [f64; 2],
    /// Mean over pixels of the variance over time at rest, over the square of the mean.
    flicker: f64,
}

const WARM_UP: u32 = 60;
/// Frames at rest over which the variance is taken.
const REST: [u32; 2] = [200, 232];

fn truth(gpu: &Gpu, scene: &Scene, (time, factor): (f64, f32)) -> Result<Vec<DVec3>> {
    let mut scene = scene.clone();
    scene.lights = match (scene.lights.as_slice(), factor == 0.0) {
        ([_], true) => return Ok(vec![DVec3::ZERO; (SIZE[0] * SIZE[1]) as usize]),
        ([_, second], true) => vec![second.clone()],
        (lights, _) => vec![lights[0].clone()],
    };
    let options = ReferenceOptions { only: Only::Gi, ..ReferenceOptions::default() };
    Ok(truth_of(options, gpu, &scene, Shown { size: SIZE, time }, 256)?.mean)
}

/// How much of the way from one picture to another a third one has gone, by blocks of 4x4 pixels.
fn share(found: &[DVec3], from: &[DVec3], to: &[DVec3]) -> f64 {
    let [found, from, to] = [found, from, to].map(|image| blocks(image, SIZE, 4));
    let way = || to.iter().zip(&from).map(|(b, a)| *b - *a);
    let gone: f64 = found.iter().zip(&from).zip(way()).map(|((f, a), w)| (*f - *a).dot(w)).sum();
    gone / way().map(|w| w.length_squared()).sum::<f64>()
}

/// Share of a change in each frame after it, the same of the mean of the picture, and frames at rest.
struct Course {
    shares: Vec<f64>,
    of_mean: Vec<f64>,
    rest: Vec<Vec<DVec3>>,
}

fn course(gpu: &Gpu, change: &Change, way: Way, truths: [&[DVec3]; 2], (last, seed): (u32, u32)) -> Result<Course> {
    let mut frames = Frames::seeded(gpu, &change.scene, way, &[], SIZE, seed)?;
    let set = |frames: &mut Frames, (time, factor): (f64, f32)| {
        frames.time = time;
        frames.renderer.scale_light(0, factor);
        if change.scene.lights.len() > 1 {
            frames.renderer.scale_light(1, 1.0 - factor);
        }
    };
    set(&mut frames, change.before);
    frames.after(WARM_UP - 1)?;
    let (end, steps) = change.steps.split_last().context("a change without steps")?;
    for step in steps {
        set(&mut frames, *step);
        frames.light()?;
    }
    set(&mut frames, *end);
    let (mut shares, mut of_mean, mut rest) = (Vec::new(), Vec::new(), Vec::new());
    let [before, after] = truths.map(mean);
    for frame in 1..=last {
        let found = frames.light()?;
        shares.push(share(&found, truths[0], truths[1]));
        of_mean.push((mean(&found) - before) / (after - before));
        if frame >= REST[0] && frame < REST[1] {
            rest.push(found);
        }
    }
    Ok(Course { shares, of_mean, rest })
}

/// The mean over runs with different seeds: noise of one picture is as great as what is looked for.
fn answer(gpu: &Gpu, change: &Change, way: Way, truths: [&[DVec3]; 2], last: u32) -> Result<Answer> {
    let seeds = match is_full() {
        // Of a door that opens one run scatters by two and a half percent.
        true if way.label == SURFELS.label => 16,
        true => 4,
        false => 2,
    };
    let courses = (1..=seeds).map(|seed| course(gpu, change, way, truths, (last, seed))).collect::<Result<Vec<_>>>()?;
    let mean_of = |of: &dyn Fn(&Course) -> &[f64]| -> Vec<f64> {
        (0..last as usize).map(|at| courses.iter().map(|c| of(c)[at]).sum::<f64>() / f64::from(seeds)).collect()
    };
    let (shares, of_mean) = (mean_of(&|c| &c.shares), mean_of(&|c| &c.of_mean));
    let near = |share: &f64| (share - 1.0).abs() < 0.1;
    let seen = shares.iter().rposition(|share| !near(share)).map_or(1, |at| at as u32 + 2);
    let at_rest = shares.get(REST[0] as usize - 1..).map(|rest| rest.iter().sum::<f64>() / rest.len() as f64);
    let missing = |values: &[f64]| [12, 40].map(|frame: usize| 1.0 - values[frame - 1]);
    Ok(Answer {
        seen: (seen <= last).then_some(seen),
        missing: missing(&shares),
        late: at_rest.map(|at_rest| 1.0 - shares[39] / at_rest),
        missing_of_mean: missing(&of_mean),
        flicker: courses.iter().map(|c| flicker(&c.rest)).sum::<f64>() / f64::from(seeds),
    })
}

/// Mean over pixels of the variance over frames, over the square of the mean.
fn flicker(frames: &[Vec<DVec3>]) -> f64 {
    let Some(first) = frames.first() else { return f64::NAN };
    let count = frames.len() as f64;
    let variance: f64 = (0..first.len())
        .map(|at| {
            let centre = frames.iter().map(|f| f[at]).sum::<DVec3>() / count;
            frames.iter().map(|f| (f[at] - centre).length_squared()).sum::<f64>() / (3.0 * count)
        })
        .sum();
    let level = frames.iter().map(|f| mean(f)).sum::<f64>() / count;
    if level > 0.0 { variance / first.len() as f64 / level.powi(2) } else { 0.0 }
}

/// Changes are soon seen, light that is gone leaves no ghost, and at rest there is less flicker than of denoised rays.
#[test]
fn changes_are_followed() -> Result<()> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    let last = if is_full() { REST[1] } else { 41 };
    let mut failed = Vec::new();
    println!(
        "| change | way | 90 % in frame | missing after 12 | after 40 | late after 40 | of the mean after 12 | after 40 | variance at rest |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for change in changes() {
        let end = change.steps[change.steps.len() - 1];
        let [before, after] = [change.before, end].map(|state| truth(&gpu, &change.scene, state));
        let (before, after) = (before?, after?);
        let ways: &[Way] = if is_full() { &[SURFELS, DENOISED] } else { &[SURFELS] };
        let mut flickers = Vec::new();
        for way in ways {
            let a = answer(&gpu, &change, *way, [&before, &after], last)?;
            let [soon, late] = a.missing;
            println!(
                "| {} | {} | {} | {soon:.3} | {late:.4} | {} | {:.3} | {:.4} | {:.1e} |",
                change.name,
                way.label,
                a.seen.map_or("later".to_owned(), |frame| frame.to_string()),
                a.late.map_or(String::new(), |late| format!("{late:.4}")),
                a.missing_of_mean[0],
                a.missing_of_mean[1],
                a.flicker
            );
            flickers.push(a.flicker);
            ensure!(a.late.is_some() == is_full(), "{}: no frames at rest", change.name);
            // Written so that a value that is not a number fails.
            let is_in_time = soon.abs() <= change.missing[0]
                && late.abs() <= change.missing[1]
                && a.late.is_none_or(|late| late.abs() <= LATE);
            if way.label == SURFELS.label && !is_in_time {
                failed.push(format!("{}: {a:?}", change.name));
            }
        }
        // Where all is dark there is nothing to flicker.
        if let [surfels, denoised] = flickers[..]
            && mean(&after) > 0.0
            && (surfels.is_nan() || surfels > denoised)
        {
            failed.push(format!("{}: variance {surfels}, of denoised rays {denoised}", change.name));
        }
    }
    ensure!(failed.is_empty(), "{failed:#?}");
    Ok(())
}
