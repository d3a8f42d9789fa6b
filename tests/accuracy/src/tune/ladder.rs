//! Configurations for a series of budgets.
use super::{Choice, Goal, Render, Tuner, confirmed, figure};
use crate::AccuracyError;
use std::fmt::Write;

/// Budgets, milliseconds.
const MILLISECONDS: [f64; 6] = [1.0, 2.0, 4.0, 8.0, 16.0, 33.0];
/// Budgets for devices on which the default exceeds the last of those: shares of the default's time.
const SHARES: [f64; 6] = [0.125, 0.25, 0.5, 0.75, 1.0, 2.0];

/// A budget of the series.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// File name without extension.
    pub name: String,
    /// GPU time per frame, milliseconds.
    pub budget_ms: f64,
}

/// A budget with its choice, or the reason why there is none.
pub type Rung = (Step, Result<Choice, String>);

/// The budgets for a device on which the default takes `frame_ms`.
pub fn steps(frame_ms: f64) -> Vec<Step> {
    if frame_ms <= MILLISECONDS[5] {
        return MILLISECONDS.map(|ms| Step { name: format!("{ms}ms"), budget_ms: ms }).to_vec();
    }
    let micros = |ms: f64| (1e3 * ms).round() / 1e3;
    let share = |share: f64| Step { name: format!("{}-percent", 100.0 * share), budget_ms: micros(share * frame_ms) };
    SHARES.map(share).to_vec()
}

/// Chooses for each budget. Rendered results are reused for the next ones; without `render` all are predictions.
///
/// # Errors
/// Any error of `render`. A budget that nothing meets is no error.
pub fn ladder(tuner: &mut Tuner<'_>, mut render: Option<Render<'_>>) -> Result<Vec<Rung>, AccuracyError> {
    let mut rungs = Vec::new();
    for step in steps(tuner.frame_ms) {
        let goal = Goal::Budget(step.budget_ms);
        let choice = match &mut render {
            Some(render) => confirmed(tuner, goal, *render),
            None => tuner.choose(goal),
        };
        let choice = match choice {
            Err(AccuracyError::Unreachable { nearest, .. }) => Err(format!("nothing: the {nearest}")),
            other => Ok(other?),
        };
        rungs.push((step, choice));
    }
    Ok(rungs)
}

/// The budgets and choices as a table.
pub fn table(tuner: &Tuner<'_>, rungs: &[Rung]) -> String {
    let mut text = format!(
        "{:<14} {:>10} {:>10} {:>10} {:>8}  choices other than the defaults\n",
        "file",
        "budget ms",
        "ms",
        tuner.metric.name(),
        "stops"
    );
    for (step, choice) in rungs {
        let _ = write!(text, "{:<14} {:>10.3} ", format!("{}.toml", step.name), step.budget_ms);
        match choice {
            Ok(choice) => {
                let stops = choice.found.map_or("-".to_owned(), |f| format!("{:+.2}", f.stops));
                let error = figure(choice.error());
                let _ =
                    writeln!(text, "{:>10.3} {error:>10} {stops:>8}  {}", choice.ms(), tuner.describe_changes(choice));
            }
            Err(why) => {
                let _ = writeln!(text, "{why}");
            }
        }
    }
    text
}
