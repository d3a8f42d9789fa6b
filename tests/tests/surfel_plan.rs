//! What a frame with surfels is made of, without a device: what runs beside the G-buffer, and what runs not at all.
use anyhow::{Context, Result, ensure};
use magpie::graph::plan::{Batch, Packed};
use magpie::graph::{Extent, Plan, Queues, Switches, plan};
use magpie::prelude::Rays;
use magpie::scene::Scene;
use magpie_passes::Slots;
use magpie_passes::plan::{FramePlan, plan_frame};
use magpie_tests::harness::{builtin, config};

fn planned(scene: &Scene) -> Result<FramePlan> {
    let config = config(&["stages.gi=surfels", "post.anti_aliasing=taa"])?;
    let camera = &scene.cameras[0];
    Ok(plan_frame(scene, camera, &Slots::default(), &config, Rays::Software, Extent::new(320, 180))?)
}

/// Batches that must be done before one begins, itself included: those of its queue before it, and those that any of them waits for.
fn before(plan: &Plan, batch: usize) -> Vec<bool> {
    let mut needed = vec![false; plan.batches.len()];
    let mut open = vec![batch];
    while let Some(at) = open.pop() {
        if needed[at] {
            continue;
        }
        needed[at] = true;
        open.extend(plan.waits[plan.batches[at].waits.range()].iter().map(|w| *w as usize));
        open.extend((0..at).filter(|other| plan.batches[*other].queue == plan.batches[at].queue));
    }
    needed
}

/// What surfels do with what the last frame left needs nothing of this frame's picture: on a queue of its own it runs beside the G-buffer and the
/// shadow maps, and neither waits for the other.
#[test]
fn last_frames_surfels_run_beside_the_gbuffer() -> Result<()> {
    let scene = builtin("courtyard")?;
    let declared = planned(&scene)?.declaration;
    let queues = Queues { async_compute: true, transfer: false };
    let plan = plan(&declared, &Switches::default(), queues, &mut Packed);
    let batch_of = |name: &str| -> Result<usize> {
        let runs =
            |batch: &Batch| plan.order[batch.passes.range()].iter().any(|pass| declared.pass_name(*pass) == name);
        plan.batches.iter().position(runs).with_context(|| format!("`{name}` does not run"))
    };
    let gbuffer = batch_of("gbuffer.draw")?;
    for early in ["gi.begin", "gi.place", "gi.count", "gi.sort", "gi.list_surfels", "gi.trace"] {
        let batch = batch_of(early)?;
        ensure!(plan.batches[batch].queue != plan.batches[gbuffer].queue, "`{early}` is on the queue of the G-buffer");
        ensure!(!before(&plan, batch)[gbuffer], "`{early}` waits for the G-buffer");
        ensure!(!before(&plan, gbuffer)[batch], "the G-buffer waits for `{early}`");
    }
    // The picture is asked afterwards.
    ensure!(before(&plan, batch_of("gi.spawn")?)[gbuffer], "surfels are spawned without a picture");
    Ok(())
}

/// Where nothing scatters light diffusely there is no pass of the slot.
#[test]
fn scenes_without_diffuse_surfaces_have_no_pass() -> Result<()> {
    let passes = |change: fn(&mut magpie::scene::Material)| -> Result<usize> {
        let mut scene = builtin("cornell")?;
        scene.materials.iter_mut().for_each(change);
        let frame = planned(&scene)?;
        let runs = frame.plan.order.iter().map(|pass| frame.declaration.pass_name(*pass).to_owned());
        Ok(runs.filter(|name| name.starts_with("gi.")).count())
    };
    ensure!(passes(|_| ())? > 0, "surfels have no pass in the Cornell box");
    ensure!(passes(|m| m.metalness = 1.0)? == 0, "passes where all is metal");
    ensure!(passes(|m| m.base_colour = glam::Vec4::W)? == 0, "passes where all is black");
    ensure!(passes(|m| m.unlit = true)? == 0, "passes where all is unlit");
    Ok(())
}
