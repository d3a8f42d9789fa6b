//! A synthetic sweep, for tests.
use crate::compose::{Composer, Parts};
use crate::display::Display;
use crate::metrics::{Comparison, Picture};
use crate::plan::Plan;
use crate::report::{Combination, Report};
use crate::results::{Cost, Errors, Folder, Measurement, Run, StageCost};
use crate::truth::TruthInfo;
use magpie::config::{Catalogue, Config};
use magpie::slot::{ImplementationInfo, SettingSpec, SlotInfo};
use std::collections::BTreeMap;
use std::fmt::Debug;
use std::path::Path;

/// Debug text with numbers to nine digits, since a file may change the last one.
pub fn digits(thing: &impl Debug) -> String {
    format!("{thing:.9?}")
}

/// Slots with shadows in three qualities and off, gi in two and off, and a tone curve.
pub fn catalogue() -> Catalogue {
    let implementation = |name: &str, settings: Vec<SettingSpec>| ImplementationInfo {
        name: name.to_owned(),
        about: "About.".to_owned(),
        settings,
    };
    let slot = |name: &str, implementations: Vec<ImplementationInfo>| {
        let default = implementations[0].name.clone();
        SlotInfo { name: name.to_owned(), about: "About.".to_owned(), default, implementations, presets: Vec::new() }
    };
    let rays = SettingSpec::integer("rays", "per pixel", "About.", 4, 1..=16).sweep([16, 4, 1]);
    let precision = SettingSpec::among("precision", "bits", "About.", 32, &[32, 16]).sweep_all();
    let exposure = SettingSpec::float("exposure", "stops", "About.", 0.0, -8.0..=8.0);
    Catalogue::new(vec![
        slot("shadows", vec![implementation("ray-traced", vec![rays]), implementation("off", vec![])]),
        slot("gi", vec![implementation("sky", vec![precision]), implementation("off", vec![])]),
        slot("post", vec![implementation("standard", vec![exposure])]),
    ])
}

/// The run of that catalogue.
pub fn run() -> Run {
    Run {
        scene: "made up".to_owned(),
        size: [8, 4],
        samples: 16,
        frames: vec![1, 8],
        rounds: 3,
        timed: 4,
        plan: Plan::new(&catalogue(), &Config::default(), &[], false).unwrap(),
        ..Run::default()
    }
}

/// Synthetic effect of a setup on the picture and on its slot's time: (slot, error, milliseconds).
fn effect_of(label: &str) -> (&'static str, f32, f64) {
    match label {
        "default" => ("", 0.0, 0.0),
        "shadows: ray-traced, rays 16" => ("shadows", -0.05, 12.0),
        "shadows: ray-traced, rays 1" => ("shadows", 0.1, -3.0),
        "shadows: off" => ("shadows", 0.5, -4.0),
        "gi: sky, precision 16" => ("gi", 0.001, -0.5),
        "gi: off" => ("gi", 0.3, -2.0),
        other => panic!("{other} was not made up"),
    }
}

fn picture(value: impl Fn(usize) -> f32) -> Picture {
    Picture { width: 8, height: 4, pixels: (0..32).map(|i| [value(i); 3]).collect() }
}

fn truth() -> Picture {
    picture(|i| 0.5 + 0.01 * i as f32)
}

/// Synthetic picture: the default is off by 0.1 everywhere; shadows err in even pixels, gi in odd ones.
pub fn rendered(label: &str) -> Picture {
    let (slot, change, _) = effect_of(label);
    let place = match slot {
        "shadows" => 0,
        _ => 1,
    };
    let truth = truth();
    picture(|i| truth.pixels[i][0] + 0.1 + if i % 2 == place { change } else { 0.0 })
}

/// Synthetic measurement of a setup in a round. Later rounds are slower.
pub fn measurement(run: &Run, setup: &str, round: u32) -> Measurement {
    let setup = run.plan.find(setup).unwrap();
    let (slot, _, change) = effect_of(&setup.label);
    let busy = f64::from(round.max(1));
    let mut cost = Cost { frame_ms: busy * (20.0 + change), frame_min_ms: 19.0 + change, ..Cost::default() };
    for (stage, ms) in [("shadows", 4.0), ("gi", 2.0)] {
        let ms = busy * (ms + if stage == slot { change } else { 0.0 });
        if ms > 0.0 {
            let stage_cost = StageCost { ms, min_ms: ms, trace_ms: ms, passes: 1, ..StageCost::default() };
            cost.stages.insert(stage.to_owned(), stage_cost);
        }
    }
    let found = Comparison::of(&rendered(&setup.label), &truth()).unwrap();
    let slots: BTreeMap<String, Comparison> = setup.slots.iter().map(|s| (s.clone(), found)).collect();
    let errors = |frame: &u32| Errors { frame: *frame, picture: found, slots: slots.clone() };
    let errors = if round == 0 { run.frames.iter().map(errors).collect() } else { Vec::new() };
    Measurement { setup: setup.id.clone(), round, cost, errors, moving: None }
}

/// A folder with all measurements.
pub fn folder() -> Folder {
    let run = run();
    let all = run.plan.setups.iter().flat_map(|s| (0..=run.rounds).map(|round| measurement(&run, &s.id, round)));
    let floor = Comparison::of(&truth(), &truth()).unwrap();
    let truths = ["all", "shadows", "gi"].map(|only| TruthInfo {
        only: only.to_owned(),
        hash: format!("hash of {only}"),
        samples: 16,
        standard_error: 0.001,
        mean: 0.6,
        floor,
    });
    Folder { measurements: all.collect(), truths: truths.to_vec(), run }
}

/// A composer of its pictures.
pub fn composer() -> Composer {
    let run = run();
    let others = run.plan.setups.iter().filter(|s| s.label != "default");
    let parts = others.map(|s| (s.id.clone(), Parts::of_whole(rendered(&s.label)))).collect();
    Composer::new(truth(), Display::PLAIN, rendered("default"), None, parts)
}

/// Its report, with the combination of its pictures.
pub fn report() -> Report {
    let folder = folder();
    let mut report = Report::build(&folder, Path::new("nowhere")).unwrap();
    let mut setups: Vec<_> = folder.run.plan.setups.iter().collect();
    setups.sort_by_key(|s| s.label != "default");
    let pictures: Vec<Picture> = setups.iter().map(|s| rendered(&s.label)).collect();
    let ids = setups.iter().map(|s| s.id.clone()).collect();
    report.combination = Some(Combination::of(ids, &truth(), &pictures));
    report
}
