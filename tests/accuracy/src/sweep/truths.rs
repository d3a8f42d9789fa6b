//! Ground truths of a sweep: which ones, and the share of time for each.
use super::Progress;
use crate::AccuracyError;
use crate::compose::TRUTH_PICTURES;
use crate::display::Display;
use crate::measure::{AREA, MOVING, MOVING_AREA, PICTURE};
use crate::pictures;
use crate::plan::Setup;
use crate::results::{IMAGES, Run, TRUTHS_FILE, read_json, write_json};
use crate::truth::{PathTracer, SHARES, Truth, TruthCache, TruthInfo, truth_of};
use magpie_passes::reference::Only;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

/// Cost of a sample of a ground truth in frames of a measurement, for the estimate of the remaining time.
pub const SAMPLE_UNITS: u64 = 8;
/// Share of a limited time that ground truths may take.
pub const SHARE_OF_TIME: f64 = 0.38;

/// A ground truth to trace.
pub struct Wanted {
    /// Key under which configurations look it up: the slot, or one of those of the whole picture.
    key: String,
    only: Only,
    /// Index of the tracer.
    tracer: usize,
    /// Its relative share of the time.
    weight: f64,
}

/// The ground truths that these setups need, those of the whole picture first.
pub fn wanted(setups: &[&Setup], moves: bool) -> Vec<Wanted> {
    let picture = |key: &str, tracer, weight| Wanted { key: key.to_owned(), only: Only::All, tracer, weight };
    let has = |slot: &str| setups.iter().any(|s| s.slots.iter().any(|w| w == slot));
    let moves = moves && setups.iter().any(|s| s.turns);
    let mut wanted = vec![picture(PICTURE, 0, 4.0)];
    wanted.extend(has(AREA).then(|| picture(AREA, 1, 3.0)));
    // Configurations with motion are compared with this one, whatever their slot is.
    wanted.extend(moves.then(|| picture(MOVING, 2, 3.0)));
    wanted.extend((moves && has(AREA)).then(|| picture(MOVING_AREA, 3, 2.0)));
    for slot in setups.iter().flat_map(|s| &s.slots) {
        if let Some(only) = truth_of(slot)
            && !wanted.iter().any(|w| w.key == *slot)
        {
            wanted.push(Wanted { key: slot.clone(), only, tracer: 0, weight: 1.0 });
        }
    }
    wanted
}

/// Traces ground truths.
pub struct Finder<'a> {
    pub cache: TruthCache,
    /// At pixel centres, averaged over pixels, and both again with the moved camera.
    pub tracers: [PathTracer<'a>; 4],
    pub run: &'a Run,
    pub display: Display,
    pub out: &'a Path,
    pub start: Instant,
    /// Whether existing ground truths get no further samples.
    pub is_frozen: bool,
}

impl Finder<'_> {
    /// Traces them, and writes their pictures and quality to the folder.
    pub fn find(
        &mut self,
        wanted: &[Wanted],
        at: &mut Progress,
        progress: &mut dyn FnMut(&Progress),
    ) -> Result<BTreeMap<String, Truth>, AccuracyError> {
        let mut truths = BTreeMap::new();
        let path = self.out.join(TRUTHS_FILE);
        let mut infos: Vec<TruthInfo> = if path.exists() { read_json(&path)? } else { Vec::new() };
        let limit = self.run.minutes.map(|minutes| 60.0 * minutes * SHARE_OF_TIME);
        let all: f64 = wanted.iter().map(|w| w.weight).sum();
        let mut weight = 0.0;
        for Wanted { key, only, tracer, weight: own } in wanted {
            weight += own;
            let name = name(*only, *tracer);
            let (before, samples_of_all) = (at.done, u64::from(self.run.samples));
            at.what = format!("truth: {name}");
            let (mut first, start, is_frozen) = (true, self.start, self.is_frozen);
            let display = if SHARES.contains(&key.as_str()) { Display::PLAIN } else { self.display };
            let mut truth = self.cache.get(&mut self.tracers[*tracer], *only, &display, &mut |samples| {
                let seconds = start.elapsed().as_secs_f64();
                let is_first = std::mem::take(&mut first);
                match limit {
                    Some(_) => at.done = seconds as u64,
                    None => {
                        at.done = before + samples * SAMPLE_UNITS;
                        at.skipped += if is_first { samples * SAMPLE_UNITS } else { 0 };
                    }
                }
                progress(at);
                !is_frozen && limit.is_none_or(|limit| seconds < limit * weight / all)
            })?;
            if limit.is_none() {
                at.done = before + samples_of_all * SAMPLE_UNITS;
            }
            truth.info.only = name.clone();
            let images = self.out.join(IMAGES);
            pictures::write_shown(&images.join(format!("truth.{name}.png")), &truth.picture, &display)?;
            let file = format!("truth.{name}.exr");
            if TRUTH_PICTURES.contains(&file.as_str()) {
                pictures::write_exr(&images.join(file), &truth.picture)?;
            }
            infos.retain(|i| i.only != truth.info.only);
            infos.push(truth.info.clone());
            truths.insert(key.clone(), truth);
        }
        write_json(&path, &infos)?;
        Ok(truths)
    }
}

/// Name of a ground truth in files and reports.
fn name(only: Only, tracer: usize) -> String {
    format!("{}{}", only.name(), ["", "_area", "_moving", "_moving_area"][tracer])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn setup(slots: &[&str], turns: bool) -> Setup {
        let slots = slots.iter().map(|s| (*s).to_owned()).collect();
        Setup { id: "s".to_owned(), label: "s".to_owned(), config: Default::default(), slots, moving: false, turns }
    }

    #[test]
    fn truths_are_those_that_something_is_compared_with() {
        let keys = |setups: &[Setup], moves| {
            wanted(&setups.iter().collect::<Vec<_>>(), moves).into_iter().map(|w| w.key).collect::<Vec<_>>()
        };
        assert_eq!(keys(&[setup(&["gbuffer"], false)], true), [PICTURE]);
        assert_eq!(keys(&[setup(&["gi", "shadows"], false), setup(&["gi"], false)], true), [PICTURE, "gi", "shadows"]);
        assert_eq!(keys(&[setup(&["gi"], false), setup(&["post"], true)], false), [PICTURE, AREA, "gi"]);
        let all = keys(&[setup(&["shadows", "post"], true)], true);
        assert_eq!(all, [PICTURE, AREA, MOVING, MOVING_AREA, "shadows"]);
        assert_eq!(name(Only::All, 3), "all_moving_area");
        assert_eq!(name(Only::Gi, 0), Only::Gi.name());
    }
}
