//! Renders predicted choices to confirm them.
use super::{Choice, Goal, Tuner};
use crate::AccuracyError;
use crate::front::middle;
use crate::measure::{Bench, PICTURE};
use crate::metric::Metric;
use crate::plan::Setup;
use crate::report::Report;
use crate::results::Run;
use crate::sweep::Subject;
use crate::truth::{PathTracer, Truth, TruthSource};
use magpie::config::Config;
use magpie::prelude::Rays;
use magpie_passes::reference::{Only, ReferenceOptions, single_scattering};
use std::collections::BTreeMap;
use std::path::Path;

/// Most combinations that are rendered per goal.
const MAX_RENDERED: usize = 8;
/// Rounds in which a choice and the default are timed alternately.
const ROUNDS: u32 = 5;

/// Measured result of a choice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// GPU time per frame, milliseconds, at the machine's speed during the report: the default's time there, times the ratio of the two in
    /// the same rounds now.
    pub ms: f64,
    /// Error of the picture.
    pub error: f64,
    /// Mean brightness relative to the ground truth, stops; negative if darker.
    pub stops: f64,
}

/// Renders a configuration and measures it.
pub type Render<'a> = &'a mut dyn FnMut(&Config) -> Result<Found, AccuracyError>;

/// Renders choices under the conditions of a report.
pub struct Confirmer<'a> {
    bench: Bench<'a>,
    run: Run,
    truths: BTreeMap<String, Truth>,
    default: Setup,
    frame_ms: f64,
    metric: Metric,
}

impl<'a> Confirmer<'a> {
    /// For this report; `folder` is named in messages.
    ///
    /// # Errors
    /// [`AccuracyError::Different`] if scene or camera are not those of the report.
    pub fn new(
        subject: &Subject<'a>,
        report: &Report,
        tuner: &Tuner<'_>,
        folder: &Path,
        rays: Rays,
    ) -> Result<Self, AccuracyError> {
        let run = &report.run;
        let [width, height] = run.size;
        let single_scattering = run.plan.default_setup().is_some_and(|setup| single_scattering(&setup.config));
        let (seed, time) = (run.seed, run.time);
        let options =
            ReferenceOptions { width, height, seed, time, rays, single_scattering, ..ReferenceOptions::default() };
        let tracer = PathTracer::new(subject.gpu, subject.scene, subject.camera, options);
        let (got, wanted) = (run.subject.clone(), tracer.subject(Only::All));
        if got != wanted {
            let what = "the scene or its camera";
            return Err(AccuracyError::Different { path: folder.to_owned(), what, got, wanted });
        }
        let lacks = |lacks: &str| AccuracyError::NotTunable { path: folder.to_owned(), lacks: lacks.to_owned() };
        let info = report.truths.first().cloned().ok_or_else(|| lacks("nothing is known of its truths"))?;
        let truth = Truth { picture: tuner.composer.truth().clone(), info };
        let default = run.plan.default_setup().ok_or_else(|| lacks("the default was not measured"))?;
        Ok(Self {
            bench: Bench::new(subject.gpu, subject.scene, subject.camera, rays, subject.slots),
            // No race: all frames at rest are timed.
            run: Run { minutes: None, ..run.clone() },
            truths: BTreeMap::from([(PICTURE.to_owned(), truth)]),
            default: Setup { slots: Vec::new(), turns: false, ..default.clone() },
            frame_ms: tuner.frame_ms,
            metric: tuner.metric,
        })
    }

    /// Renders a configuration, alternating with the default.
    ///
    /// # Errors
    /// Any error of rendering.
    pub fn render(&mut self, config: &Config) -> Result<Found, AccuracyError> {
        let setup =
            Setup { id: "tuned".to_owned(), label: "tuned".to_owned(), config: config.clone(), ..self.default.clone() };
        let (first, _) = self.bench.measure(&setup, 0, &self.run, &self.truths)?;
        let lacks = || AccuracyError::Lacks { setup: setup.label.clone(), frame: 1, what: "an error".to_owned() };
        let picture = first.errors.last().ok_or_else(lacks)?.picture;
        let mut ratios = Vec::new();
        for round in 1..=ROUNDS {
            let mut time = |setup: &Setup| -> Result<f64, AccuracyError> {
                Ok(self.bench.measure(setup, round, &self.run, &self.truths)?.0.cost.frame_ms)
            };
            ratios.push(time(&setup)? / time(&self.default)?);
        }
        Ok(Found {
            ms: middle(&ratios) * self.frame_ms,
            error: self.metric.of(&picture),
            stops: (picture.mean_test / picture.mean_reference).log2(),
        })
    }
}

/// Chooses for a goal, renders the choice, and repeats with the measured result until the choice has been rendered.
///
/// # Errors
/// [`AccuracyError::Unreachable`], and any error of `render`.
pub fn confirmed(tuner: &mut Tuner<'_>, goal: Goal, render: Render<'_>) -> Result<Choice, AccuracyError> {
    for _ in 0..MAX_RENDERED {
        let choice = tuner.choose(goal)?;
        if choice.found.is_some() {
            return Ok(choice);
        }
        let found = render(&tuner.config(&choice))?;
        tuner.record_result(&choice, found);
    }
    // Out of attempts: the best of those that were rendered.
    tuner.choose_rendered(goal)
}
