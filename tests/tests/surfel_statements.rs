//! What is said of surfels in general: where they come from, what feedback adds, what no change resets, and what they cost at rest.
use anyhow::{Context, Result, ensure};
use glam::DVec3;
use magpie_tests::gi::{Frames, SURFELS, mean};
use magpie_tests::harness::{builtin, gpu_without_validation};
use magpie_tests::rooms;
use std::env;

const SIZE: [u32; 2] = [64, 48];

fn is_full() -> bool {
    env::var_os("MAGPIE_FULL").is_some()
}

/// The first frame spawns what the picture asks for, later ones where it lacks some, and then the number stays.
#[test]
fn surfels_are_spawned_where_coverage_is_lacking() -> Result<()> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    let mut frames = Frames::new(&gpu, &builtin("cornell")?, SURFELS, &[], SIZE)?;
    let mut live = Vec::new();
    for _ in 0..64 {
        live.push(frames.counted()?.1.live);
    }
    println!("surfels in frames 1, 2, 8, 32, 64: {:?}", [0, 1, 7, 31, 63].map(|at: usize| live[at]));
    ensure!(live[0] > 100.0 && live[7] > live[0], "{live:?}");
    ensure!((live[63] / live[31] - 1.0).abs() < 0.02, "the number goes on from {} to {}", live[31], live[63]);
    Ok(())
}

/// Surfels at the hits of paths add bounces, and need no rays for them: paths end there.
#[test]
fn feedback_adds_light_and_no_rays() -> Result<()> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    let scene = rooms::white();
    let run = |feedback: &str| -> Result<[f64; 2]> {
        let changes = [feedback, "gi.bounces=1", "gi.surfel_radius=0.05"];
        let mut frames = Frames::new(&gpu, &scene, SURFELS, &changes, SIZE)?;
        frames.after(46)?;
        let (light, counters) = frames.counted()?;
        Ok([mean(&light), f64::from(counters.rays) / f64::from(counters.live)])
    };
    let ([with, rays_with], [without, rays_without]) = (run("gi.feedback=true")?, run("gi.feedback=false")?);
    println!(
        "light {with:.3} with {rays_with:.2} rays per surfel, {without:.3} with {rays_without:.2} without feedback"
    );
    ensure!(with > 1.5 * without && without > 0.0, "{with} with feedback, {without} without");
    ensure!(rays_with < 1.02 * rays_without, "{rays_with} rays with feedback, {rays_without} without");
    Ok(())
}

/// A camera that moves leaves what surfels have gathered.
#[test]
fn moving_the_camera_resets_nothing() -> Result<()> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    let mut frames = Frames::new(&gpu, &scene, SURFELS, &[], SIZE)?;
    let samples = |frames: &mut Frames| -> Result<f64> {
        let result = frames.frame(Some("gi.show:state"))?;
        let values = result.images.context("no image")?.linear.values();
        let counts: Vec<f64> = values.iter().map(|v| f64::from(v[1])).filter(|n| *n > 0.0).collect();
        Ok(counts.iter().sum::<f64>() / counts.len() as f64)
    };
    frames.after(47)?;
    let before = samples(&mut frames)?;
    let aside = scene.cameras[0].world_from_camera.x_axis;
    for _ in 0..16 {
        frames.camera.world_from_camera.translation += 0.03 * aside;
        frames.light()?;
    }
    let after = samples(&mut frames)?;
    println!("mean number of samples {before:.1} before, {after:.1} after 16 frames of motion");
    ensure!(before > 30.0 && after > 0.9 * before, "{before} samples before, {after} after");
    Ok(())
}

/// The side of a white block that faces a red wall is red, and the floor before the wall more than that beside it.
#[test]
fn a_red_wall_tints_what_is_beside_it() -> Result<()> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    let light = Frames::new(&gpu, &builtin("cornell")?, SURFELS, &[], SIZE)?.after(31)?;
    // Of the floor in front of the blocks, which is white: a row of pixels, at the red wall and at the green one.
    let row = SIZE[1] - 4;
    let of = |columns: std::ops::Range<u32>| -> DVec3 { columns.map(|x| light[(row * SIZE[0] + x) as usize]).sum() };
    let (left, right) = (of(12..18), of(46..52));
    let ratio = |c: DVec3| c.x / c.y;
    println!("red over green: {:.2} beside the red wall, {:.2} beside the green one", ratio(left), ratio(right));
    ensure!(ratio(left) > 1.5 * ratio(right), "{left} on the left, {right} on the right");
    Ok(())
}

/// Pixels of surfaces that no surfel covers yet, because the pool is too small for all, are finite and not black.
#[test]
fn what_no_surfel_covers_has_light_too() -> Result<()> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    let black = |light: &[DVec3]| light.iter().filter(|l| l.element_sum() == 0.0).count() as f64 / light.len() as f64;
    // Behind the box there is nothing, and its lamp reflects nothing.
    let mut frames = Frames::new(&gpu, &scene, SURFELS, &[], SIZE)?;
    frames.after(10)?;
    let (covered, all) = frames.counted()?;
    ensure!(all.uncovered == 0.0, "uncovered {}", all.uncovered);
    let changes = ["gi.surfels=1024", "gi.surfel_radius=0.01"];
    let mut frames = Frames::new(&gpu, &scene, SURFELS, &changes, SIZE)?;
    frames.after(10)?;
    let (light, counters) = frames.counted()?;
    ensure!(light.iter().all(|l| l.is_finite()), "not finite");
    ensure!(counters.live <= 1024.0, "{} surfels", counters.live);
    let [least, found] = [black(&covered), black(&light)];
    println!("uncovered {:.3}; black {found:.3}, with room for all {least:.3}", counters.uncovered);
    ensure!(counters.uncovered > 0.05 && found < least + 0.01, "uncovered {}, black {found}", counters.uncovered);
    Ok(())
}

/// Nothing moves: the more samples surfels have, the fewer rays a frame has, down to a floor of about a quarter. Noise is never taken for a change of light, with
/// which they would grow.
#[test]
fn still_scenes_trace_ever_fewer_rays() -> Result<()> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    for radius in [0.055, 0.06, 0.065] {
        let radius = format!("gi.surfel_radius={radius}");
        let mut frames = Frames::new(&gpu, &scene, SURFELS, &[&radius], SIZE)?;
        let mut rays = Vec::new();
        for _ in 0..640 {
            rays.push(f64::from(frames.counted()?.1.rays));
        }
        let over = |frames: std::ops::Range<usize>| rays[frames.clone()].iter().sum::<f64>() / frames.len() as f64;
        let steps: Vec<f64> = (1..20).map(|k| over(32 * k..32 * (k + 1))).collect();
        println!("{radius}: rays per frame, each a mean over 32 frames from frame 32 on: {steps:.0?}");
        ensure!(steps.windows(2).all(|pair| pair[1] < 1.02 * pair[0]), "{radius}: they grow: {steps:?}");
        let [first, half, last] = [steps[0], steps[4], steps[18]];
        ensure!(half < 0.6 * first && last < 0.6 * half, "{radius}: {steps:?}");
        ensure!(last > 0.15 * first && (last / steps[17] - 1.0).abs() < 0.05, "{radius}: no floor: {steps:?}");
    }
    Ok(())
}

/// No frame has more rays than the budget, from its first to a camera that jumps, at the sizes that people use.
#[test]
fn the_budget_holds_at_any_size() -> Result<()> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    let scene = builtin("courtyard")?;
    let sizes: &[[u32; 2]] = if is_full() { &[[320, 180], [1920, 1080]] } else { &[[320, 180]] };
    for &size in sizes {
        for budget in [20_000.0, 250_000.0] {
            let mut frames = Frames::new(&gpu, &scene, SURFELS, &[&format!("gi.budget={budget}")], size)?;
            let mut most = 0.0_f32;
            for frame in 0..6 {
                if frame == 4 {
                    frames.camera = scene.cameras[1].clone();
                }
                let counters = frames.counted()?.1;
                most = most.max(counters.rays);
                ensure!(counters.rays <= budget, "{size:?}, frame {frame}: {} rays of {budget}", counters.rays);
            }
            println!("{size:?}: at most {most} rays of {budget}");
            ensure!(most > 0.0, "no rays");
        }
    }
    Ok(())
}

/// The statistics of the last pass over surfels have the counters of the frame, the same as its picture of counters.
#[test]
fn surfels_stand_in_the_statistics() -> Result<()> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(()) };
    let mut frames = Frames::new(&gpu, &builtin("cornell")?, SURFELS, &[], SIZE)?;
    for frame in 1..=3 {
        let result = frames.frame(Some("gi.show:counters"))?;
        let shown = result.images.context("no image")?.linear.values();
        let pass = result.sample.passes.iter().find(|pass| pass.name == "gi.keep").context("no pass `gi.keep`")?;
        let names = ["surfels", "wanted", "spawned", "recycled", "dropped", "uncovered", "visible"];
        ensure!(pass.counts.iter().map(|(name, _)| *name).eq(names), "{:?}", pass.counts);
        let differs = pass.counts.iter().zip(&shown).any(|((_, count), shown)| *count as f32 != shown[0]);
        ensure!(!differs && pass.counts[0].1 > 0, "frame {frame}: {:?}, shown {shown:?}", pass.counts);
    }
    Ok(())
}
