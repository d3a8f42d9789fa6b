//! A whole sweep at a tiny size: truths, measurements, report, parts of it on two machines, and the configuration that it recommends.
use anyhow::{Context, Result, ensure};
use magpie::config::Config;
use magpie::prelude::Rays;
use magpie::stage::{SettingSpec, Stage};
use magpie_accuracy::report::{Image, Judge, Metric, REPORT_CSV, REPORT_HTML, REPORT_JSON, Report};
use magpie_accuracy::results::{Folder, RESULTS_FILE, merge};
use magpie_accuracy::sweep::{Options, Progress, Shard, Subject, sweep};
use magpie_accuracy::tune::{Confirmer, Goal, Tuner, confirmed};
use magpie_passes::Slots;
use magpie_tests::harness::{builtin, gpu};
use std::collections::BTreeMap;
use std::path::Path;

fn options(out: &Path, shard: Option<Shard>) -> Options {
    Options {
        out: out.to_owned(),
        truths: None,
        stages: ["gbuffer", "shadows", "gi"].map(str::to_owned).to_vec(),
        quick: true,
        minutes: None,
        judge: Judge::default(),
        size: Some([48, 32]),
        samples: Some(8),
        shard,
        seed: 0,
        rays: Rays::Software,
        commit: "of a test".to_owned(),
    }
}

/// Magpie's slots, but for shadows: hard ones, of full and of half resolution, or none. All that shadows can be would take minutes.
fn slots() -> Slots {
    let all = Slots::default();
    let original = all.shadows.clone();
    let off = all.shadows.clone();
    let resolution = SettingSpec::choice("resolution", "Of rays.", "full", &["full", "half"]).sweep_all();
    let shadows = Stage::new("shadows")
        .about("Hard shadows.")
        .with("hard", "Rays to the middle of lights.", &[resolution], move |build, settings| {
            let mut values = settings.values().clone();
            values.insert("edges".to_owned(), "hard".into());
            original.choose(build, "ray-traced", &values)
        })
        .with("off", "None.", &[], move |build, _| off.choose(build, "off", &BTreeMap::new()));
    Slots { shadows, ..all }
}

#[test]
fn a_sweep_is_measured_resumed_split_merged_and_tuned() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let (scene, slots, config) = (builtin("cornell")?, slots(), Config::default());
    let subject = Subject { gpu: &gpu, scene: &scene, camera: &scene.cameras[0], slots: &slots, config: &config };
    let place = tempfile::tempdir()?;
    let whole = place.path().join("whole");
    let mut told = Vec::new();
    let folder = sweep(&subject, &options(&whole, None), &mut |at: &Progress| told.push(at.clone()))?;
    let last = told.last().context("no progress")?;
    ensure!(last.done == last.all && last.skipped == 0, "{last}");
    ensure!(told.windows(2).all(|pair| pair[0].done <= pair[1].done), "progress goes back");

    let report = Report::build(&folder, &whole)?;
    report.write(&whole)?;
    for file in [REPORT_JSON, REPORT_CSV, REPORT_HTML] {
        ensure!(std::fs::metadata(whole.join(file))?.len() > 1000, "{file}");
    }
    // All of it to nine digits: the last one of a number may be another after it was in a file.
    let read = Report::read(&whole)?;
    ensure!(format!("{read:.9?}") == format!("{report:.9?}"), "the JSON does not read back");
    rows_are_plausible(&report)?;

    // Again: nothing is left to do.
    let before = std::fs::read(whole.join(RESULTS_FILE))?;
    let mut skipped = 0;
    sweep(&subject, &options(&whole, None), &mut |at: &Progress| skipped = at.skipped)?;
    ensure!(skipped == last.all, "{skipped} of {}", last.all);
    ensure!(std::fs::read(whole.join(RESULTS_FILE))? == before, "something was measured again");

    // In two parts: the same errors, whoever measured them.
    let parts: Vec<_> = (1..=2).map(|i| place.path().join(format!("part{i}"))).collect();
    for (index, part) in (1..).zip(&parts) {
        sweep(&subject, &options(part, Some(Shard { index, count: 2 })), &mut |_| {})?;
        ensure!(Report::build(&Folder::read(part)?, part).is_err(), "a part is no report");
    }
    let merged = place.path().join("merged");
    let merged = Report::build(&merge(&parts, &merged)?, &merged)?;
    for (a, b) in report.effects.iter().zip(&merged.effects) {
        for (a, b) in a.rows.iter().zip(&b.rows) {
            ensure!(a.errors == b.errors, "{}: errors differ between two runs", a.variant.label);
        }
    }
    let (a, b) = (report.combination.as_ref(), merged.combination.as_ref());
    ensure!(a.context("no pictures")?.setups == b.context("no pictures")?.setups, "pictures of both parts");

    // The cheapest configuration keeps its promise.
    let mut tuner = Tuner::new(&report, &whole, Metric::FlipLdr)?;
    let cheapest = tuner.front()[0].error();
    let mut confirmer = Confirmer::new(&subject, &report, &tuner, &whole, Rays::Software)?;
    let choice = confirmed(&mut tuner, Goal::Error(1.02 * cheapest), &mut |config| confirmer.render(config))?;
    let found = choice.found.context("not rendered")?;
    println!("predicted {:.4}, found {:.4}", choice.predicted_error, found.error);
    ensure!(
        (found.error / choice.predicted_error - 1.0).abs() < 0.15,
        "{} was predicted, {} found",
        choice.predicted_error,
        found.error
    );
    Ok(())
}

fn rows_are_plausible(report: &Report) -> Result<()> {
    let slots: Vec<&str> = report.effects.iter().map(|e| e.slot.as_str()).collect();
    ensure!(slots == ["gbuffer", "shadows", "gi"], "{slots:?}");
    let shadows = report.effect("shadows").context("shadows")?;
    let error = |at: usize, image| shadows.rows[at].error(image).map(|c| Metric::Rmse.of(c)).context("no error");
    // Full, half, off: more and more wrong, less and less dear.
    for image in [Image::Slot, Image::Picture] {
        let errors = [error(0, image)?, error(1, image)?, error(2, image)?];
        ensure!(errors[0] > 0.0 && errors[0] < errors[1] && errors[1] < errors[2], "{image:?}: {errors:?}");
    }
    let off = &shadows.rows[2];
    ensure!(off.variant.implementation == "off" && off.ms == 0.0 && shadows.is_front(off), "what costs nothing");
    ensure!(shadows.is_front(&shadows.rows[0]), "what is most accurate");
    let half = &shadows.rows[1].stage;
    ensure!(half.passes == 2 && half.denoise_ms > 0.0 && half.trace_ms > 0.0, "{half:?}");
    ensure!(shadows.rows[0].stage.rays_any > 3 * half.rays_any && half.rays_any > 0, "a quarter of the rays");
    for row in report.effects.iter().flat_map(|e| &e.rows) {
        let frames: Vec<u32> = row.errors.iter().map(|e| e.frame).collect();
        ensure!(frames == report.run.frames, "{}: {frames:?}", row.variant.label);
        ensure!(row.frame_ms > 0.0 && row.rounds_ms.len() == report.run.rounds as usize, "{}", row.variant.label);
    }
    Ok(())
}
