//! A complete sweep at a tiny size: ground truths, measurements, report, two shards of it, and the configuration that it recommends.
use anyhow::{Context, Result, ensure};
use magpie::config::Config;
use magpie::prelude::Rays;
use magpie::slot::{SettingSpec, Slot};
use magpie_accuracy::agreement::Agreement;
use magpie_accuracy::display::Display;
use magpie_accuracy::metrics::Picture;
use magpie_accuracy::report::{Image, Judge, Metric, REPORT_CSV, REPORT_HTML, REPORT_JSON, Report};
use magpie_accuracy::results::{Folder, RESULTS_FILE, merge};
use magpie_accuracy::sweep::{Options, Progress, Shard, Subject, sweep};
use magpie_accuracy::tune::{Confirmer, Goal, Tuner, confirmed};
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_tests::harness::{builtin, gpu};
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

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

/// Magpie's slots with fewer variants: hard shadows at full or half resolution, or none; light of the sky, or none. All variants would take minutes.
fn slots() -> Slots {
    let all = Slots::default();
    let original = all.shadows.clone();
    let off = all.shadows.clone();
    let resolution = SettingSpec::choice("resolution", "Of rays.", "full", &["full", "half"]).sweep_all();
    let shadows = Slot::new("shadows")
        .about("Hard shadows.")
        .with("hard", "Rays to the middle of lights.", &[resolution], move |build, settings| {
            let mut values = settings.values().clone();
            values.insert("edges".to_owned(), "hard".into());
            original.choose(build, "ray-traced", &values)
        })
        .with("off", "None.", &[], move |build, _| off.choose(build, "off", &BTreeMap::new()));
    let precision = SettingSpec::among("precision", "bits", "Of radiance.", 16, &[32, 16]).sweep_all();
    let (sky, none) = (all.gi.clone(), all.gi.clone());
    let gi = Slot::new("gi")
        .about("The sky.")
        .with("sky", "The light of the sky.", &[precision], move |build, settings| {
            sky.choose(build, "sky", settings.values())
        })
        .with("off", "None.", &[], move |build, _| none.choose(build, "off", &BTreeMap::new()));
    Slots { shadows, gi, ..all }
}

#[test]
fn a_sweep_is_measured_resumed_split_merged_and_tuned() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let (scene, slots, config) = (builtin("cornell")?, slots(), Config::default());
    let subject = Subject { gpu: &gpu, scene: &scene, camera: &scene.cameras[0], slots: &slots, config: &config };
    let place = tempfile::tempdir()?;
    let whole = place.path().join("whole");
    let mut progress = Vec::new();
    let folder = sweep(&subject, &options(&whole, None), &mut |at: &Progress| progress.push(at.clone()))?;
    let last = progress.last().context("no progress")?;
    ensure!(last.done == last.all && last.skipped == 0, "{last}");
    ensure!(progress.windows(2).all(|pair| pair[0].done <= pair[1].done), "progress goes back");

    let report = Report::build(&folder, &whole)?;
    report.write(&whole)?;
    for file in [REPORT_JSON, REPORT_CSV, REPORT_HTML] {
        ensure!(std::fs::metadata(whole.join(file))?.len() > 1000, "{file}");
    }
    // Compared to nine digits, as reading a number back may change its last one.
    let read = Report::read(&whole)?;
    ensure!(format!("{read:.9?}") == format!("{report:.9?}"), "the JSON does not read back");
    rows_are_plausible(&report)?;

    // A second sweep has nothing left to do.
    let before = std::fs::read(whole.join(RESULTS_FILE))?;
    let mut skipped = 0;
    sweep(&subject, &options(&whole, None), &mut |at: &Progress| skipped = at.skipped)?;
    ensure!(skipped == last.all, "{skipped} of {}", last.all);
    ensure!(std::fs::read(whole.join(RESULTS_FILE))? == before, "something was measured again");

    // In two shards: the errors are the same.
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

    // The cheapest configuration comes out as predicted.
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

#[test]
fn a_race_keeps_its_time_and_says_how_sure_it_is() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let (scene, slots, config) = (builtin("cornell")?, slots(), Config::default());
    let subject = Subject { gpu: &gpu, scene: &scene, camera: &scene.cameras[0], slots: &slots, config: &config };
    let place = tempfile::tempdir()?;
    let out = place.path().join("race");
    let stages = ["shadows", "post"].map(str::to_owned).to_vec();
    let options = Options { minutes: Some(0.5), stages, ..options(&out, None) };
    let start = Instant::now();
    let folder = sweep(&subject, &options, &mut |_| {})?;
    let seconds = start.elapsed().as_secs_f64();
    // Measurements in progress are completed after the time limit.
    ensure!(seconds < 40.0, "{seconds} s of 30");
    let report = Report::build(&folder, &out)?;
    println!("{}in {seconds:.1} s", report.table());
    let post = report.effect("post").context("post")?;
    ensure!(post.judged_by == Image::Picture && post.rows.len() > 1, "{} rows of post", post.rows.len());
    for row in report.effects.iter().flat_map(|e| &e.rows) {
        let label = &row.variant.label;
        ensure!(!row.rounds.is_empty() && row.ms_interval >= 0.0 && (0.0..=1.0).contains(&row.sure), "{label}");
        // Only rows of slots with history, and the default, were measured in motion.
        ensure!(row.moving.is_some() == (row.variant.slot == "post" || row.variant.is_default), "{label}");
    }
    let same = Agreement::of(&report, &report);
    ensure!(same.error_tau.is_none_or(|tau| tau == 1.0), "{}", same.table());
    Ok(())
}

/// The display values of the default frame follow from its radiance.
#[test]
fn a_display_on_the_host_shows_what_the_frame_shows() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    let options = RenderOptions { width: 48, height: 32, rays: Rays::Software, ..RenderOptions::default() };
    for (curve, stops) in [("agx", 0.0), ("aces", 1.5), ("none", -1.0)] {
        let mut config = Config::default();
        config.set(&format!("post.tone_map={curve}"))?;
        config.set(&format!("post.exposure={stops}"))?;
        let config = Slots::default().catalogue().complete(&config);
        let mut renderer = Renderer::new(&gpu, &scene, &Slots::default(), &config, options)?;
        let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: true };
        let images = renderer.frame(request)?.and_then(|f| f.images).context("no frame")?;
        let shown = Display::of(&config).show(&Picture::from_numbers(&images.linear)?).to_srgb8();
        let wanted = images.display.context("no display")?;
        let wanted = wanted.bytes.chunks_exact(4).flat_map(|rgba| &rgba[..3]);
        let off = shown.iter().zip(wanted).map(|(a, b)| a.abs_diff(*b)).max().context("no pixel")?;
        ensure!(off <= 1, "{curve}: {off} of 255");
        ensure!(shown.iter().max() > shown.iter().min(), "{curve}: nothing is seen");
    }
    Ok(())
}

fn rows_are_plausible(report: &Report) -> Result<()> {
    let slots: Vec<&str> = report.effects.iter().map(|e| e.slot.as_str()).collect();
    ensure!(slots == ["gbuffer", "shadows", "gi"], "{slots:?}");
    let shadows = report.effect("shadows").context("shadows")?;
    let error = |at: usize, image| shadows.rows[at].error(image).map(|c| Metric::Rmse.of(c)).context("no error");
    // Full, half, off: increasing error, decreasing time.
    for image in [Image::Slot, Image::Picture] {
        let errors = [error(0, image)?, error(1, image)?, error(2, image)?];
        ensure!(errors[0] > 0.0 && errors[0] < errors[1] && errors[1] < errors[2], "{image:?}: {errors:?}");
    }
    let off = &shadows.rows[2];
    ensure!(off.variant.implementation == "off" && off.ms == 0.0 && shadows.is_front(off), "what costs nothing");
    ensure!(shadows.rows[0].is_front(Image::Slot, Metric::Rmse), "what is most accurate");
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
