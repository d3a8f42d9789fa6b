//! Light where lamps go off or move: how soon each way to choose lights follows, with each denoiser, and the whole picture of the preset `high`, by `magpie bench
//! motion`.
use anyhow::{Context, Result, ensure};
use magpie::config::Config;
use magpie_bench::motion::{Course, MotionOptions, paths, paths_of_light, walk};
use magpie_tests::harness::gpu_without_validation;
use magpie_tests::rooms;

const SIZE: [u32; 2] = [48, 36];
const FRAMES: u32 = 48;

/// Frame after a change by which each has gone 90 % of the way, at most; and after so many frames, how much of it may be missing.
const WITHIN: usize = 4;
const MISSING: [(usize, f64); 2] = [(4, 0.1), (40, 0.05)];
/// The same for the picture with anti-aliasing: of what changes at once, and within six frames.
const PICTURE_WITHIN: [usize; 2] = [6, 4];
const PICTURE_MISSING: [(usize, f64); 2] = [(12, 0.07), (40, 0.07)];

/// What may be missing in the whole picture after 12 and 40 frames.
const WHOLE_MISSING: [f64; 2] = [0.06, 0.03];

const CONTESTANTS: [&str; 8] = [
    "tree, raw",
    "tree, svgf",
    "tree, pica-pica",
    "tree, blur",
    "restir, raw",
    "restir, svgf",
    "restir, pica-pica",
    "restir, blur",
];

#[test]
fn light_is_where_lamps_are() -> Result<()> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    let scene = rooms::coloured_lamp();
    let paths = [paths(&scene, FRAMES), paths_of_light(&scene, FRAMES, "door")].concat();
    for (name, picture) in ["switch", "off", "aside"].into_iter().flat_map(|name| [(name, false), (name, true)]) {
        let path = paths.iter().find(|path| path.name == name).context(name)?;
        let mut config = Config::default();
        config.set("stages.gi=off")?;
        if picture {
            config.set("post.anti_aliasing=taa")?;
        }
        let options = MotionOptions {
            slot: "direct".to_owned(),
            picture,
            only: CONTESTANTS.map(str::to_owned).to_vec(),
            size: SIZE,
            frames: FRAMES,
            config,
            ..MotionOptions::default()
        };
        let courses = walk(&gpu, path, &options, &|_, _, _| Ok(0.0))?;
        for label in CONTESTANTS {
            let course = courses.iter().find(|course: &&Course| course.label == label).context(label)?;
            let settled = course.settled_within(0.1);
            let missing = [4, 12, 40].map(|frame| course.missing_in(frame));
            let what = format!("{name}, {label}{}", if picture { ", with anti-aliasing" } else { "" });
            println!("{what}: 90 % in frame {settled:?}, missing after 4, 12, 40: {missing:.4?}");
            let (within, missing_at_most) = match (picture, name) {
                (false, _) => (WITHIN, MISSING),
                (true, "aside") => (PICTURE_WITHIN[1], PICTURE_MISSING),
                (true, _) => (PICTURE_WITHIN[0], PICTURE_MISSING),
            };
            ensure!(settled.is_some_and(|frame| frame <= within), "{what}: 90 % in frame {settled:?}");
            for (frame, most) in missing_at_most {
                let missing = course.missing_in(frame).context("too few frames")?;
                ensure!(missing.abs() <= most, "{what}: {missing} missing after {frame} frames");
            }
        }
    }
    Ok(())
}

/// All that ships together: denoised shadows and occlusion, surfels, reflections, anti-aliasing with four fifths of the pixels each way.
#[test]
fn the_whole_picture_follows_a_lamp() -> Result<()> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    let scene = rooms::coloured_lamp();
    let paths = paths_of_light(&scene, FRAMES, "door");
    let path = paths.iter().find(|path| path.name == "aside").context("no such path")?;
    let mut config = Config::default();
    for slot in ["shadows", "ao", "direct", "gi", "reflections", "post"] {
        config.set(&format!("stages.{slot}=high"))?;
    }
    let options = MotionOptions {
        slot: "gi".to_owned(),
        picture: true,
        only: vec!["surfels".to_owned()],
        size: [64, 48],
        frames: FRAMES,
        config,
        ..MotionOptions::default()
    };
    let courses = walk(&gpu, path, &options, &|_, _, _| Ok(0.0))?;
    let course = courses.first().context("surfels took no part")?;
    let (settled, missing) = (course.settled_within(0.1), [12, 40].map(|frame| course.missing_in(frame)));
    println!("90 % in frame {settled:?}, missing after 12 and 40: {missing:.4?}");
    ensure!(settled.is_some_and(|frame| frame <= 12), "90 % in frame {settled:?}");
    for (missing, most) in missing.into_iter().zip(WHOLE_MISSING) {
        ensure!(missing.is_some_and(|missing| missing.abs() <= most), "{missing:?} is missing");
    }
    Ok(())
}
