use super::*;
use crate::fixture::{folder, measurement, run as fixture_run};
use std::collections::BTreeMap;

/// A machine that takes a fixed number of seconds for errors and a third of it for times, with synthetic measurements.
struct Machine {
    run: Run,
    seconds: f64,
    errors_take: f64,
    measured: Vec<(String, u32)>,
}

impl Measures for Machine {
    fn measure(&mut self, setup: &Setup, round: u32) -> Result<Measurement, AccuracyError> {
        self.seconds += if round == 0 { self.errors_take } else { self.errors_take / 3.0 };
        self.measured.push((setup.label.clone(), round));
        // Later rounds are slower; a race compares rows within a round.
        let mut found = measurement(&self.run, &setup.id, 1 + round % 3);
        if round == 0 {
            found.errors = measurement(&self.run, &setup.id, 0).errors;
        }
        Ok(Measurement { round, ..found })
    }

    fn seconds(&self) -> f64 {
        self.seconds
    }
}

fn go(minutes: f64, errors_take: f64) -> (Machine, Vec<Measurement>, Vec<Progress>) {
    let place = tempfile::tempdir().unwrap();
    let mut run = Run { minutes: Some(minutes), ..fixture_run() };
    let mut results = Results::open(place.path(), &mut run).unwrap();
    let mut machine = Machine { run: run.clone(), seconds: 0.0, errors_take, measured: Vec::new() };
    let setups: Vec<&Setup> = run.plan.setups.iter().collect();
    let mut at = Progress { all: Units::of(&run, &setups, 3).all, ..Progress::default() };
    let mut progress = Vec::new();
    let mut report = |at: &Progress| progress.push(at.clone());
    super::run(&run, &setups, &BTreeMap::new(), &mut results, &mut machine, &mut at, &mut report).unwrap();
    (machine, std::mem::take(&mut results.measurements), progress)
}

#[test]
fn a_race_measures_each_error_once_and_ends_when_every_place_is_clear() {
    let (machine, found, progress) = go(10.0, 1.0);
    let errors: Vec<&str> = machine.measured.iter().filter(|m| m.1 == 0).map(|m| m.0.as_str()).collect();
    assert_eq!(errors.len(), fixture_run().plan.setups.len());
    assert_eq!(errors[0], "default");
    let timed = machine.measured.len() - errors.len();
    let all_rounds = MAX_ROUNDS * fixture_run().plan.setups.len();
    assert!(timed < all_rounds / 2, "{timed} of {all_rounds}");
    assert!(machine.seconds < 60.0, "{}", machine.seconds);
    assert!(progress.last().unwrap().what.contains("clear") && progress.iter().all(|t| t.done <= t.all));
    // Each round of a race has at least two rows of one slot.
    for round in 1..=found.iter().map(|m| m.round).max().unwrap() {
        let runs: Vec<&(String, u32)> = machine.measured.iter().filter(|m| m.1 == round).collect();
        assert!(runs.len() >= 2, "round {round}: {runs:?}");
    }
}

#[test]
fn what_has_no_time_is_left_out_and_the_limit_is_kept() {
    // Four measurements of errors fit into nine tenths of a minute.
    let (machine, found, _) = go(1.0, 13.0);
    assert!(machine.seconds <= 60.0, "{}", machine.seconds);
    let errors: Vec<&str> = machine.measured.iter().filter(|m| m.1 == 0).map(|m| m.0.as_str()).collect();
    assert_eq!(errors, ["default", "shadows: off", "gi: off", "shadows: ray-traced, rays 16"]);

    let run = Run { minutes: Some(1.0), ..fixture_run() };
    let place = tempfile::tempdir().unwrap();
    let part = crate::results::Folder { measurements: found, run, ..folder() };
    let report = crate::report::Report::build(&part, place.path()).unwrap();
    let left: Vec<&str> = report.unreached.iter().map(|(_, label)| label.as_str()).collect();
    assert_eq!(left, ["ray-traced, rays 1", "sky, precision 16"]);
    assert_eq!(report.effect("shadows").unwrap().rows.len(), 3);
    // Less time than one configuration takes: only the default is measured.
    let (machine, _, _) = go(0.01, 13.0);
    assert_eq!(machine.measured, [("default".to_owned(), 0)]);
}

#[test]
fn without_a_limit_everything_has_all_its_rounds() {
    let place = tempfile::tempdir().unwrap();
    let mut run = fixture_run();
    let mut results = Results::open(place.path(), &mut run).unwrap();
    let mut machine = Machine { run: run.clone(), seconds: 0.0, errors_take: 1.0, measured: Vec::new() };
    let setups: Vec<&Setup> = run.plan.setups.iter().collect();
    let mut at = Progress { all: Units::of(&run, &setups, 0).all, ..Progress::default() };
    super::run(&run, &setups, &BTreeMap::new(), &mut results, &mut machine, &mut at, &mut |_| {}).unwrap();
    assert_eq!(machine.measured.len(), setups.len() * (1 + run.rounds as usize));
    assert_eq!(at.done, at.all);
}
