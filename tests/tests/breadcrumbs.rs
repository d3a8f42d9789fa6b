//! A device that is lost during a frame is reported with the names of the passes. A real loss cannot be provoked, so frames stop in a pass
//! as if it had hung, and the error is made from the markers that the device had written by then.
use anyhow::{Context, Result, ensure};
use magpie::graph::execute::{ExecuteError, ExecuteOptions, Executed, QueueProgress};
use magpie::graph::{Extent, Plan, Queue, Switches};
use magpie::scene::{ResidentOptions, ResidentScene, Scene, SharedScene};
use magpie_tests::bench::{Bench, Shot};
use magpie_tests::harness::{builtin, config, gpu};

const EXTENT: Extent = Extent { width: 48, height: 27 };

fn options(queues: u8, breadcrumbs: bool) -> ExecuteOptions {
    let switches = Switches { queues: Some(queues), ..Switches::default() };
    ExecuteOptions { switches, breadcrumbs, ..ExecuteOptions::default() }
}

fn frame(bench: &mut Bench, scene: &Scene, resident: &SharedScene) -> Result<Executed> {
    let shot = Shot { scene: resident, camera: &scene.cameras[0], extent: EXTENT };
    Ok(bench.frame(shot, &config(&[])?, &[])?.clean()?.executed)
}

/// The expected progress if the pass at `stop` began, everything before it in the plan ended, and nothing after it began.
fn expected(ran: &Executed, stop: usize) -> Vec<QueueProgress> {
    let plan: &Plan = &ran.plan;
    let name = |position: usize| ran.declaration.pass_name(plan.order[position]).to_owned();
    let positions = |queue: Queue| -> Vec<usize> {
        plan.batches.iter().filter(|b| b.queue == queue).flat_map(|b| b.passes.range()).collect()
    };
    Queue::ALL
        .into_iter()
        .map(|queue| (queue, positions(queue)))
        .filter(|(_, own)| !own.is_empty())
        .map(|(queue, own)| QueueProgress {
            queue,
            last_begun: own.iter().rfind(|p| **p <= stop).map(|p| name(*p)),
            first_unfinished: own.iter().find(|p| **p >= stop).map(|p| name(*p)),
        })
        .collect()
}

#[test]
fn every_pass_of_a_whole_frame_leaves_its_crumbs() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    let resident = ResidentScene::new(&gpu, &scene, ResidentOptions::default())?.shared();
    let mut bench = Bench::new(&gpu)?;
    for queues in [1, 3] {
        bench.executor.set_options(options(queues, true));
        let ran = frame(&mut bench, &scene, &resident)?;
        let progress = &ran.progress;
        ensure!(*progress == expected(&ran, ran.plan.order.len()), "{progress:?}");
        ensure!(progress.iter().all(|p| p.first_unfinished.is_none() && p.last_begun.is_some()), "{progress:?}");
        ensure!(queues == 1 || progress.len() > 1, "only one queue was used");
        // By default only devices that can write markers cheaply do so.
        bench.executor.set_options(options(queues, false));
        let ran = frame(&mut bench, &scene, &resident)?;
        ensure!(ran.progress.is_empty() != gpu.has_markers(), "{:?}", ran.progress);
    }
    Ok(())
}

#[test]
fn a_frame_that_stops_names_the_pass_whichever_it_is() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    let resident = ResidentScene::new(&gpu, &scene, ResidentOptions::default())?.shared();
    let mut bench = Bench::new(&gpu)?;
    for queues in [1, 3] {
        bench.executor.set_options(options(queues, true));
        let ran = frame(&mut bench, &scene, &resident)?;
        for stop in 0..ran.plan.order.len() {
            let name = ran.declaration.pass_name(ran.plan.order[stop]);
            bench.executor.lose_device_in(name);
            let error = frame(&mut bench, &scene, &resident).err().with_context(|| format!("{name}: it went on"))?;
            let Some(ExecuteError::Lost { progress, .. }) = error.downcast_ref() else { return Err(error) };
            ensure!(*progress == expected(&ran, stop), "{name}: {progress:?}");
            ensure!(error.to_string().contains(&format!("{name} began last and did not end")), "{error}");
            if stop == ran.plan.order.len() / 2 {
                println!("{error}");
            }
        }
        let ran = frame(&mut bench, &scene, &resident)?;
        ensure!(ran.progress.iter().all(|p| p.first_unfinished.is_none()), "the next frame is whole again");
    }
    Ok(())
}

#[test]
fn a_loss_without_crumbs_says_how_to_lay_them() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    let resident = ResidentScene::new(&gpu, &scene, ResidentOptions::default())?.shared();
    let mut bench = Bench::new(&gpu)?;
    bench.executor.set_options(ExecuteOptions { measure: false, ..options(1, false) });
    bench.executor.lose_device_in("gbuffer.draw");
    let error = frame(&mut bench, &scene, &resident).err().context("it went on")?;
    let Some(ExecuteError::Lost { progress, .. }) = error.downcast_ref() else { return Err(error) };
    ensure!(progress.is_empty() && error.to_string().contains("--breadcrumbs"), "{error}");
    Ok(())
}
