//! Charts of a report, as SVG.
use super::{Case, Quantity, RayReport, Row};
use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::prelude::*;
use plotters::series::DashedLineSeries;
use std::fmt::Display;

/// Width and height, pixels.
const SIZE: (u32, u32) = (900, 540);
const TITLE: i32 = 20;
const TEXT: i32 = 15;
/// Room for the legend beside the plot, where it hides nothing.
const LEGEND: i32 = 285;

/// A chart could not be drawn.
#[derive(Debug, thiserror::Error)]
#[error("chart `{title}`: {message}")]
pub struct ChartError {
    /// Its title.
    title: String,
    /// What plotters says.
    message: String,
}

/// One axis.
#[derive(Clone, Copy)]
struct Axis {
    name: &'static str,
    log: bool,
}

struct Line {
    label: String,
    rays: &'static str,
    dashed: bool,
    /// Of lines of one colour and style, the width tells them apart, pixels.
    width: u32,
    points: Vec<(f64, f64)>,
}

struct Chart {
    file: &'static str,
    title: String,
    x: Axis,
    y: Axis,
    lines: Vec<Line>,
}

/// The colour of a way to trace, the same in every chart, and told apart by the colour-blind (Okabe and Ito 2008).
fn colour(rays: &str) -> RGBColor {
    match rays {
        "software" => RGBColor(0, 114, 178),
        "query" => RGBColor(213, 94, 0),
        "pipeline" => RGBColor(0, 158, 115),
        _ => RGBColor(204, 121, 167),
    }
}

/// File names, without a folder, and SVG texts. A chart for which nothing was measured is left out.
///
/// # Errors
/// [`ChartError`].
pub fn charts(report: &RayReport) -> Result<Vec<(String, String)>, ChartError> {
    let all = [
        build_time(report),
        memory(report),
        triangles(report),
        instances(report),
        top_level(report),
        moving(report),
        refit_time(report),
    ];
    let drawn = all.into_iter().filter(|c| !c.lines.is_empty());
    drawn.map(|chart| Ok((format!("rays-{}.svg", chart.file), chart.svg()?))).collect()
}

const TRIANGLES: Axis = Axis { name: "triangles of the mesh", log: true };
const INSTANCES: Axis = Axis { name: "instances", log: true };
const PATH: Axis = Axis { name: "mean path of an instance, diameters", log: false };
const RATE: Axis = Axis { name: "Mrays/s", log: false };
const TIME: Axis = Axis { name: "milliseconds", log: true };

/// The lines of what `pick` names: the label without the way, whether dashed, and the width.
fn lines(
    report: &RayReport,
    setup: &str,
    quantity: Quantity,
    scale: f64,
    pick: impl Fn(&Case, &str) -> Option<(String, bool, u32)>,
) -> Vec<Line> {
    let mut lines: Vec<Line> = Vec::new();
    for row in report.rows.iter().filter(|r| r.case.setup == setup && r.quantity == quantity) {
        let Some((label, dashed, width)) = pick(&row.case, row.rays) else { continue };
        let label = if label.is_empty() { row.rays.to_owned() } else { format!("{}, {label}", row.rays) };
        let point = (row.case.x, row.median * scale);
        match lines.iter_mut().find(|l| l.label == label) {
            Some(line) => line.points.push(point),
            None => lines.push(Line { label, rays: row.rays, dashed, width, points: vec![point] }),
        }
    }
    // In the order of the report, so that thicker lines of more instances come later.
    lines.sort_by_key(|l| report.rays.iter().position(|r| *r == l.rays).unwrap_or(usize::MAX));
    lines
}

fn title(report: &RayReport, what: &str) -> String {
    let name = report.device.name.split('(').next().unwrap_or_default().trim();
    format!("{what} ({name})")
}

fn build_time(report: &RayReport) -> Chart {
    let lines = lines(report, "triangles", Quantity::BuildBottom, 1.0, |case, _| {
        (case.subject == "sphere").then_some(())?;
        match case.variant.as_str() {
            "build" => Some((String::new(), false, 2)),
            "build, fast build" => Some(("fast build".to_owned(), true, 2)),
            _ => None,
        }
    });
    Chart { file: "build", title: title(report, "Building a bottom level"), x: TRIANGLES, y: TIME, lines }
}

fn memory(report: &RayReport) -> Chart {
    let lines = lines(report, "triangles", Quantity::BottomBytes, 1.0 / 1024.0, |case, by| {
        (case.subject == "sphere").then_some(())?;
        match (case.variant.as_str(), by) {
            ("build", "software") => Some((String::new(), false, 2)),
            ("build", _) => Some(("compacted".to_owned(), false, 2)),
            ("build, not compacted", _) => Some(("as built".to_owned(), true, 2)),
            _ => None,
        }
    });
    let (x, y) = (Axis { log: false, ..TRIANGLES }, Axis { name: "KiB", log: false });
    Chart { file: "memory", title: title(report, "Memory of a bottom level"), x, y, lines }
}

fn triangles(report: &RayReport) -> Chart {
    let lines = lines(report, "triangles", Quantity::Rate, 1.0, |case, _| {
        let rough = case.subject != "sphere";
        (case.variant == "primary").then(|| (case.subject.clone(), rough, 2))
    });
    let what = "Primary rays through 1152 instances of one mesh";
    Chart { file: "triangles", title: title(report, what), x: TRIANGLES, y: RATE, lines }
}

fn instances(report: &RayReport) -> Chart {
    let lines = lines(report, "instances", Quantity::Rate, 1.0, |case, _| {
        Some((case.subject.clone(), case.subject != "regular", 2))
    });
    let what = "Rays that miss every instance";
    Chart { file: "instances", title: title(report, what), x: INSTANCES, y: Axis { log: true, ..RATE }, lines }
}

fn top_level(report: &RayReport) -> Chart {
    let lines = lines(report, "instances", Quantity::BuildTop, 1.0, |case, _| {
        Some((case.subject.clone(), case.subject != "regular", 2))
    });
    Chart { file: "top-level", title: title(report, "Building a top level"), x: INSTANCES, y: TIME, lines }
}

/// Lines of one setting apart from the others: all move, or a part; more instances are thicker.
fn crowd(subject: &str) -> (String, bool, u32) {
    let count: u32 = subject.split(' ').next().and_then(|n| n.parse().ok()).unwrap_or(0);
    (subject.to_owned(), subject.contains('%'), 1 + count / 700)
}

fn moving(report: &RayReport) -> Chart {
    let refitted = |case: &Case| case.variant == "primary, refitted";
    let mut lines =
        lines(report, "moving", Quantity::Rate, 1.0, |case, _| refitted(case).then(|| crowd(&case.subject)));
    // Over the rate of a new tree for the same instances.
    for line in &mut lines {
        let subject = line.label.split_once(", ").map_or("", |(_, subject)| subject);
        for point in &mut line.points {
            let case = Case::new("moving", subject, point.0, "primary, rebuilt");
            let rebuilt = report.row(&case, line.rays, Quantity::Rate).map_or(f64::NAN, |r: &Row| r.median);
            point.1 *= 100.0 / rebuilt;
        }
    }
    let y = Axis { name: "rate after refits, % of that of a new top level", log: false };
    let what = "Rays after instances have moved";
    Chart { file: "moving", title: title(report, what), x: PATH, y, lines }
}

fn refit_time(report: &RayReport) -> Chart {
    let mut all = lines(report, "moving", Quantity::BuildTop, 1.0, |case, _| {
        let (label, _, width) = crowd(&case.subject);
        (!label.contains('%')).then(|| (format!("{label}, rebuild"), false, width))
    });
    all.extend(lines(report, "moving", Quantity::RefitTop, 1.0, |case, _| {
        let (label, _, width) = crowd(&case.subject);
        (!label.contains('%')).then(|| (format!("{label}, refit"), true, width))
    }));
    Chart {
        file: "refit",
        title: title(report, "A top level that follows its instances"),
        x: PATH,
        y: TIME,
        lines: all,
    }
}

/// A number as axes show it.
fn number(value: &f64) -> String {
    let text = match value.abs() {
        v if v >= 10.0 => return format!("{value:.0}"),
        v if v >= 1.0 => format!("{value:.1}"),
        v if v >= 0.01 => format!("{value:.2}"),
        _ => format!("{value:.4}"),
    };
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

impl Chart {
    /// From the least to the greatest of one coordinate, with some air; a linear axis of values begins at zero.
    fn range(&self, axis: Axis, pick: fn(&(f64, f64)) -> f64) -> std::ops::Range<f64> {
        let values = self.lines.iter().flat_map(|l| &l.points).map(pick).filter(|v| v.is_finite());
        let (lo, hi) = values.fold((f64::MAX, 0.0_f64), |(lo, hi), v| (lo.min(v), hi.max(v)));
        let hi = if hi > 0.0 { hi } else { 1.0 };
        if axis.log { lo.clamp(1e-6, hi / 1.5) / 1.2..hi * 1.2 } else { 0.0..hi * 1.08 }
    }

    fn svg(&self) -> Result<String, ChartError> {
        let mut text = String::new();
        {
            let root = SVGBackend::with_string(&mut text, SIZE).into_drawing_area();
            let (x, y) = (self.range(self.x, |p| p.0), self.range(self.y, |p| p.1));
            match (self.x.log, self.y.log) {
                (false, false) => self.draw(&root, x, y),
                (false, true) => self.draw(&root, x, y.log_scale()),
                (true, false) => self.draw(&root, x.log_scale(), y),
                (true, true) => self.draw(&root, x.log_scale(), y.log_scale()),
            }?;
        }
        Ok(text)
    }

    fn failed<E: Display>(&self) -> impl Fn(E) -> ChartError {
        let title = self.title.clone();
        move |error| ChartError { title: title.clone(), message: error.to_string() }
    }

    fn draw<X, Y>(
        &self,
        root: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>,
        x: X,
        y: Y,
    ) -> Result<(), ChartError>
    where
        X: AsRangedCoord<Value = f64>,
        Y: AsRangedCoord<Value = f64>,
        X::CoordDescType: ValueFormatter<f64>,
        Y::CoordDescType: ValueFormatter<f64>,
    {
        root.fill(&WHITE).map_err(self.failed())?;
        let mut chart = ChartBuilder::on(root)
            .caption(&self.title, ("sans-serif", TITLE))
            .margin(14)
            .margin_right(LEGEND)
            .x_label_area_size(48)
            .y_label_area_size(72)
            .build_cartesian_2d(x, y)
            .map_err(self.failed())?;
        chart
            .configure_mesh()
            .x_desc(self.x.name)
            .y_desc(self.y.name)
            .x_label_formatter(&number)
            .y_label_formatter(&number)
            .label_style(("sans-serif", TEXT))
            .axis_desc_style(("sans-serif", TEXT))
            .light_line_style(TRANSPARENT)
            .bold_line_style(RGBColor(222, 222, 222))
            .draw()
            .map_err(self.failed())?;
        for line in &self.lines {
            let style = colour(line.rays).stroke_width(line.width);
            let points = line.points.iter().copied();
            let dashed = line.dashed;
            if dashed {
                chart.draw_series(DashedLineSeries::new(points, 7, 5, style)).map_err(self.failed())?;
            } else {
                chart.draw_series(LineSeries::new(points, style)).map_err(self.failed())?;
            }
            let dots = line.points.iter().map(|&p| Circle::new(p, 3, colour(line.rays).filled()));
            chart.draw_series(dots).map_err(self.failed())?;
        }
        self.legend(root)?;
        root.present().map_err(self.failed())
    }
}

impl Chart {
    /// What each line is, beside the plot.
    fn legend(&self, root: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>) -> Result<(), ChartError> {
        let left = SIZE.0 as i32 - LEGEND + 14;
        for (line, at) in self.lines.iter().zip(0..) {
            let (y, style) = (56 + 24 * at, colour(line.rays).stroke_width(line.width));
            let dashes: &[(i32, i32)] = if line.dashed { &[(0, 7), (12, 19), (24, 28)] } else { &[(0, 28)] };
            for (from, to) in dashes {
                let dash = PathElement::new(vec![(left + from, y), (left + to, y)], style);
                root.draw(&dash).map_err(self.failed())?;
            }
            let text = Text::new(line.label.clone(), (left + 35, y - 8), ("sans-serif", TEXT - 1));
            root.draw(&text).map_err(self.failed())?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        let shown: Vec<String> = [0.0, 1000.0, 23.4, 2.5, 3.0, 0.1, 0.25, 0.0005].iter().map(number).collect();
        assert_eq!(shown, ["0", "1000", "23", "2.5", "3", "0.1", "0.25", "0.0005"]);
    }
}
