//! Results of `magpie bench motion` as a table, JSON and charts.
use super::MotionOptions;
use super::course::{Course, LATE};
use crate::chart::{Axis, Chart, ChartError, Colour, Line};
use magpie::gpu::Gpu;
use magpie::scene::Scene;
use serde::Serialize;
use std::fmt::Write;

/// Share of a switch's change at which it counts as visible.
const SEEN: f64 = 0.9;
/// Frames after a lasting change for which the table says how much of it is missing.
const LATER: [usize; 2] = [12, LATE];
/// First frames of a path, in which a denoiser may be no better than its input as it has no history.
pub const UNKNOWN: usize = 3;

/// Results of a run.
#[derive(Clone, Debug, Serialize)]
pub struct MotionReport {
    /// Version of Magpie.
    pub magpie: &'static str,
    /// Commit of the build.
    pub commit: String,
    /// Name of the device.
    pub device: String,
    /// Name and version of its driver.
    pub driver: String,
    /// Name of the scene.
    pub scene: String,
    /// Name of the slot.
    pub slot: String,
    /// Whether the picture at the end of the frame was compared in place of the slot's image.
    pub picture: bool,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Runs that the results are means of.
    pub seeds: u32,
    /// Results of every contestant on every path.
    pub courses: Vec<Course>,
}

impl MotionReport {
    pub(super) fn new(gpu: &Gpu, scene: &Scene, options: &MotionOptions, courses: Vec<Course>) -> Self {
        let report = gpu.report();
        Self {
            magpie: env!("CARGO_PKG_VERSION"),
            commit: options.commit.clone(),
            device: report.name.clone(),
            driver: report.driver.clone(),
            scene: scene.name.clone(),
            slot: options.slot.clone(),
            picture: options.picture,
            size: options.size,
            seeds: options.seeds,
            courses,
        }
    }

    /// The report as JSON.
    ///
    /// # Errors
    /// Any error of the serialiser.
    pub fn to_json(&self) -> Result<String, serde_json::Error> {
        serde_json::to_string_pretty(self)
    }

    /// Names of the paths in order.
    fn paths(&self) -> Vec<&'static str> {
        let mut names: Vec<_> = self.courses.iter().map(|c| c.path).collect();
        names.dedup();
        names
    }

    fn of<'a>(&'a self, path: &'a str) -> impl Iterator<Item = &'a Course> {
        self.courses.iter().filter(move |c| c.path == path)
    }

    /// The report as a table, a line per path and contestant.
    #[must_use]
    pub fn table(&self) -> String {
        let what = if self.picture { "the picture, for " } else { "" };
        let mut text = format!("{what}{} of {}, {}x{}, RMSE\n", self.slot, self.scene, self.size[0], self.size[1]);
        let names =
            ["frame 1", "8", "32", "mean", "last", "flicker", "FLIP 1", "8", "32", "last", "ms", "B/px", "kept"];
        let _ = write!(text, "{:<8} {:<24}", "path", "");
        names.iter().for_each(|name| write!(text, " {name:>8}").unwrap_or_default());
        text.push('\n');
        for course in &self.courses {
            let (errors, end) = (&course.errors, course.errors.len() - 1);
            let mean_of = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
            let error = |k: usize| errors.get(k).copied();
            let perceived = |k: usize| course.perceived.get(k).copied().flatten();
            let small = [
                error(0),
                error(7),
                error(31),
                Some(mean_of(errors)),
                error(end),
                Some(mean_of(&course.flicker)),
                perceived(0),
                perceived(7),
                perceived(31),
                perceived(end),
            ];
            let cost = [course.cost.ms, Some(course.cost.traffic), Some(course.cost.kept)];
            let _ = write!(text, "{:<8} {:<24}", course.path, course.label);
            let mut cell = |value: Option<f64>, digits: usize| {
                let value = value.map_or("-".to_owned(), |value| format!("{value:.digits$}"));
                let _ = write!(text, " {value:>8}");
            };
            small.into_iter().for_each(|value| cell(value, 4));
            cost.into_iter().for_each(|value| cell(value, 1));
            if !course.gone.is_empty() {
                let frame = course.settled_within(1.0 - SEEN).map_or("later".to_owned(), |f| format!("in frame {f}"));
                let _ = write!(text, "  90 % {frame}");
                for after in LATER {
                    let Some(missing) = course.missing_in(after) else { continue };
                    let _ = write!(text, ", {:.1} % missing after {after}", 100.0 * missing);
                }
                if let Some(missing) = course.missing_at_the_end() {
                    let _ = write!(text, ", {:.1} % in the last quarter", 100.0 * missing);
                }
                if let Some((late, error)) = course.lateness() {
                    let error = error.map_or(String::new(), |error| format!(" ± {:.1}", 100.0 * error));
                    let _ = write!(text, ", {:.1}{error} % late after {LATE}", 100.0 * late);
                }
            } else if course.path == "switch" {
                let frame = course.frame_of(SEEN).map_or("later".to_owned(), |f| format!("in frame {f}"));
                let _ = write!(text, "  90 % {frame}");
            }
            text.push('\n');
        }
        text
    }

    /// Charts as file names without a folder and SVG texts.
    ///
    /// # Errors
    /// [`ChartError`].
    pub fn charts(&self) -> Result<Vec<(String, String)>, ChartError> {
        let mut charts = Vec::new();
        let mut add = |name: &str, y, title: String, pick: &dyn Fn(&Course) -> Vec<f64>, path: &str| {
            let colours = [Colour::PURPLE, Colour::BLUE, Colour::VERMILION, Colour::GREEN].into_iter().cycle();
            let line = |(course, colour): (&Course, Colour)| Line {
                label: course.label.to_owned(),
                colour,
                dashed: false,
                width: 2,
                points: (1..).map(f64::from).zip(pick(course)).collect(),
            };
            let lines = self.of(path).zip(colours).map(line).collect();
            let x = Axis { name: "frame", log: false };
            let chart = Chart { title, x, y: Axis { name: y, log: false }, lines };
            charts.push((format!("motion-{}-{path}{name}.svg", self.slot), chart.svg()?));
            Ok(())
        };
        for path in self.paths() {
            let when = match path {
                "still" => "while nothing moves",
                "camera" => "while the camera moves",
                "switch" => "after a switch",
                "lights" => "while lights move",
                "off" => "after the lights went out",
                "lamp" => "while a coloured lamp moves",
                "aside" => "after a coloured lamp has moved",
                "door" => "after a door has opened",
                _ => "while things move",
            };
            let title = format!("{} {when}: {}", self.slot, self.scene);
            add("", "RMSE", title.clone(), &|c| c.errors.clone(), path)?;
            if path == "switch" && self.of(path).all(|c| c.gone.is_empty()) {
                let share = |c: &Course| {
                    let end = c.true_means.last().copied().unwrap_or(1.0);
                    c.means.iter().map(|m| m / end).collect()
                };
                add("-seen", "share of the switch that is seen", title, &share, path)?;
            } else if self.of(path).any(|c| !c.gone.is_empty()) {
                add("-seen", "share of the change that is seen", title, &|c| c.gone.clone(), path)?;
            }
        }
        Ok(charts)
    }

    /// Frames after the third in which a denoised image is no better than its input: path, contestant, frame from 1.
    #[must_use]
    pub fn worse(&self) -> Vec<(&'static str, &'static str, usize)> {
        let mut worse = Vec::new();
        for path in self.paths() {
            let mut courses = self.of(path);
            let Some(noisy) = courses.next() else { continue };
            for course in courses.take(1) {
                let pairs = course.errors.iter().zip(&noisy.errors).enumerate().skip(UNKNOWN);
                let bad = pairs.filter(|(_, (denoised, noisy))| denoised >= noisy);
                worse.extend(bad.map(|(frame, _)| (course.path, course.label, frame + 1)));
            }
        }
        worse
    }
}
