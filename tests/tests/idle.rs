//! Slots that are idle take nothing: no pass, no pipeline, no bytes. In a process of its own, since pipelines belong to the device.
use anyhow::{Context, Result, ensure};
use magpie::measure::SlotReport;
use magpie_tests::harness::{config, gpu, render};
use std::collections::BTreeSet;

#[path = "needs/scenes.rs"]
#[allow(dead_code)]
mod scenes;
use scenes::{SIZE, plan, scenes};

/// And the plan that is made without a device is that of the frame that ran.
#[test]
fn what_is_idle_takes_nothing() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    // From few effects to many: a pipeline of an effect that was idle before must not have been made.
    let mut scenes = scenes()?;
    scenes.retain(|(name, ..)| *name != "carousel"); // it moves, which a plan without a device leaves out
    scenes.sort_by_key(|(_, _, reasons)| reasons.iter().filter(|reason| reason.is_none()).count());
    let mut ran = BTreeSet::<String>::new();
    for (name, scene, _) in scenes {
        let frame = render(&gpu, &scene, &config(&[])?, SIZE, 3, None).with_context(|| name.to_owned())?;
        let (planned, reports) = (plan(&scene, &[])?, frame.what_runs());
        for planned in &planned.slots {
            let report = reports.iter().find(|report| report.slot == planned.slot);
            let report = report.with_context(|| format!("{name}: no slot {}", planned.slot))?;
            let passes = |r: &SlotReport| r.passes.clone();
            ensure!(passes(planned) == passes(report), "{name}: planned {planned:?}, ran {report:?}");
            ensure!((planned.bytes, planned.transient_bytes) == (report.bytes, report.transient_bytes), "{name}");
            if report.runs {
                ran.insert(report.slot.clone());
                continue;
            }
            let SlotReport { bytes, transient_bytes, history_bytes, passes, .. } = report;
            ensure!(passes.is_empty() && [*bytes, *transient_bytes, *history_bytes] == [0; 3], "{name}: {report:?}");
        }
        for slot in ["shadows", "ao", "direct", "gi", "reflections", "compose", "sky"] {
            let made = gpu.pipelines().made().iter().any(|pipeline| pipeline.starts_with(&format!("{slot}/")));
            ensure!(made == ran.contains(slot), "{name}: pipelines of {slot}: {:?}", gpu.pipelines().made());
        }
    }
    ensure!(ran.len() >= 9, "{ran:?}");
    Ok(())
}
