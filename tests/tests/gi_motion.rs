//! Denoised indirect light where lamps go on, off, or elsewhere: how soon it follows, by `magpie bench motion`.
use anyhow::{Context, Result, ensure};
use magpie::config::Config;
use magpie_bench::motion::{Course, MotionOptions, paths, paths_of_light, walk};
use magpie_tests::harness::gpu_without_validation;
use magpie_tests::rooms;

const SIZE: [u32; 2] = [64, 48];
const FRAMES: u32 = 48;

/// Of a change, what may be missing after 4 and 12 frames beside what is never found: of one that happens at once, and of one within six frames.
const LATE: [[f64; 2]; 2] = [[0.18, 0.06], [0.35, 0.15]];

const CONTESTANTS: [&str; 4] = ["svgf", "pica-pica, raw", "blur", "svgf, cache of surfels"];

/// What is missing after 4, 12 and 40 frames of a path, and at the end, of each contestant.
fn missing(path: &str, only: &[&str], changes: &[&str]) -> Result<Vec<([f64; 3], f64)>> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(Vec::new()) };
    let scene = rooms::coloured_lamp();
    let paths = [paths(&scene, FRAMES), paths_of_light(&scene, FRAMES, "door")].concat();
    let path = paths.iter().find(|found| found.name == path).context("no such path")?;
    let mut config = Config::default();
    for change in changes {
        config.set(change)?;
    }
    let options = MotionOptions {
        slot: "gi".to_owned(),
        only: only.iter().map(|label| (*label).to_owned()).collect(),
        size: SIZE,
        frames: FRAMES,
        config,
        ..MotionOptions::default()
    };
    let courses = walk(&gpu, path, &options, &|_, _, _| Ok(0.0))?;
    let of = |label: &&str| {
        let course = courses.iter().find(|course: &&Course| course.label == *label).context("took no part")?;
        let [a, b, c] = [4, 12, 40].map(|frame| course.missing_in(frame).context("too few frames"));
        let (after, end) = ([a?, b?, c?], course.missing_at_the_end().context("no change")?);
        println!("{}, {label} {changes:?}: missing after 4, 12, 40: {after:.3?}, at the end {end:.3}", path.name);
        Ok((after, end))
    };
    only.iter().map(of).collect()
}

#[test]
fn denoised_light_follows_lamps() -> Result<()> {
    for (path, late) in [("switch", LATE[0]), ("off", LATE[0]), ("aside", LATE[1])] {
        for ((after, end), label) in missing(path, &CONTESTANTS, &[])?.into_iter().zip(CONTESTANTS) {
            for (found, most) in after.into_iter().zip(late) {
                ensure!((found - end).abs() <= most, "{path}, {label}: {after:?} is missing, at the end {end}");
            }
        }
    }
    Ok(())
}

/// What the test above would find if nothing looked for changes.
#[test]
fn without_looking_for_changes_it_is_late() -> Result<()> {
    for ((after, end), label) in
        missing("switch", &["svgf", "blur"], &["gi.adaptive=false"])?.into_iter().zip(["svgf", "blur"])
    {
        ensure!(after[1] - end > 0.2, "{label}: only {after:?} is missing, at the end {end}");
    }
    Ok(())
}
