use super::*;
use crate::fixture::{digits, folder, measurement, run};

#[test]
fn results_stay_and_a_line_that_is_cut_off_goes() {
    let place = tempfile::tempdir().unwrap();
    let mut run = run();
    let setup = run.plan.setups[0].id.clone();
    let mut results = Results::open(place.path(), &mut run).unwrap();
    results.push(measurement(&run, &setup, 0)).unwrap();
    results.push(measurement(&run, &setup, 1)).unwrap();
    drop(results);
    let path = place.path().join(RESULTS_FILE);
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, &text[..text.len() - 20]).unwrap();

    let mut later = run.clone();
    later.date = "another day".to_owned();
    let mut results = Results::open(place.path(), &mut later).unwrap();
    assert_eq!(later.date, run.date, "the day on which it began");
    assert!(results.has(&setup, 0) && !results.has(&setup, 1));
    assert_eq!(digits(&results.measurements), digits(&[measurement(&run, &setup, 0)]));
    results.push(measurement(&run, &setup, 1)).unwrap();
    drop(results);
    assert_eq!(std::fs::read_to_string(&path).unwrap(), text);

    // A complete but invalid line is reported with its number.
    std::fs::write(&path, text.clone() + "{}\n").unwrap();
    let message = Results::open(place.path(), &mut later).unwrap_err().to_string();
    assert!(message.contains(&format!("{RESULTS_FILE}:3")), "{message}");
}

#[test]
fn results_of_another_run_are_refused() {
    let place = tempfile::tempdir().unwrap();
    Results::open(place.path(), &mut run()).unwrap();
    type Change = fn(&mut Run);
    let changes: [(&str, Change); 5] = [
        ("the size", |r| r.size = [9, 4]),
        ("the seed", |r| r.seed = 1),
        ("the device", |r| r.device.name = "another".to_owned()),
        ("the scene", |r| r.subject = "another".to_owned()),
        ("the plan", |r| r.plan.variants.truncate(1)),
    ];
    for (what, change) in changes {
        let mut other = run();
        change(&mut other);
        let message = Results::open(place.path(), &mut other).unwrap_err().to_string();
        assert!(message.contains(what) && message.contains(RUN_FILE), "{message}");
    }
}

/// Writes a folder with the setups selected by `mine`.
fn write(path: &Path, all: &Folder, mine: impl Fn(usize) -> bool) {
    let mut run = all.run.clone();
    let mut results = Results::open(path, &mut run).unwrap();
    for (at, setup) in all.run.plan.setups.iter().enumerate().filter(|(at, _)| mine(*at)) {
        let _ = std::fs::write(path.join(IMAGES).join(format!("{at}.png")), [at as u8]);
        for one in all.measurements.iter().filter(|m| m.setup == setup.id) {
            results.push(one.clone()).unwrap();
        }
    }
    write_json(&path.join(TRUTHS_FILE), &all.truths).unwrap();
}

#[test]
fn shards_come_together_as_if_one_machine_had_done_it_all() {
    let place = tempfile::tempdir().unwrap();
    let mut all = folder();
    let paths: Vec<PathBuf> = (0..3).map(|i| place.path().join(i.to_string())).collect();
    for (index, path) in paths.iter().enumerate() {
        write(path, &all, |at| at % 3 == index);
    }
    let out = place.path().join("out");
    let message = merge(&paths[..2], &out).unwrap_err().to_string();
    assert!(message.contains("8 of 24 measurements are missing"), "{message}");
    let merged = merge(&paths, &out).unwrap();
    let place_of = |m: &Measurement| all.run.plan.setups.iter().position(|s| s.id == m.setup);
    all.measurements.sort_by_key(|m| (m.round, place_of(m)));
    assert_eq!(digits(&merged), digits(&all));
    assert_eq!(digits(&Folder::read(&out).unwrap()), digits(&all));
    assert_eq!(std::fs::read_dir(out.join(IMAGES)).unwrap().count(), 6);
    // The same folder twice changes nothing.
    let again = [&paths[..], &paths[1..2]].concat();
    assert_eq!(digits(&merge(&again, &out).unwrap()), digits(&all));

    let mut foreign = all.clone();
    foreign.truths[0].hash = "another".to_owned();
    let path = place.path().join("foreign");
    write(&path, &foreign, |_| true);
    let message = merge(&[paths[0].clone(), path], &out).unwrap_err().to_string();
    assert!(message.contains("a truth was another"), "{message}");
    assert!(matches!(merge(&[], &out), Err(AccuracyError::NothingToMerge)));
}
