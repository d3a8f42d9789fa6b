//! Charts of a report, as SVG.
use super::{Case, Quantity, RayReport, Row};
use crate::chart::{Axis, Chart, ChartError, Colour, Line};

/// Colour of a backend, the same in every chart.
fn colour(rays: &str) -> Colour {
    match rays {
        "software" => Colour::BLUE,
        "query" => Colour::VERMILION,
        "pipeline" => Colour::GREEN,
        _ => Colour::PURPLE,
    }
}

/// Charts as file names without a folder and SVG texts. Charts without data are left out.
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
    let drawn = all.into_iter().filter(|(_, chart)| !chart.lines.is_empty());
    drawn.map(|(file, chart)| Ok((format!("rays-{file}.svg"), chart.svg()?))).collect()
}

const TRIANGLES: Axis = Axis { name: "triangles of the mesh", log: true };
const INSTANCES: Axis = Axis { name: "instances", log: true };
const PATH: Axis = Axis { name: "mean path of an instance, diameters", log: false };
const RATE: Axis = Axis { name: "Mrays/s", log: false };
const TIME: Axis = Axis { name: "milliseconds", log: true };

/// The lines of the rows that `pick` selects; it returns the label without the backend, whether it is dashed, and the width.
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
            None => lines.push(Line { label, colour: colour(row.rays), dashed, width, points: vec![point] }),
        }
    }
    // In the order of the report, so that thicker lines for more instances come later.
    lines.sort_by_key(|l| report.rays.iter().position(|r| colour(r) == l.colour).unwrap_or(usize::MAX));
    lines
}

fn title(report: &RayReport, what: &str) -> String {
    let name = report.device.name.split('(').next().unwrap_or_default().trim();
    format!("{what} ({name})")
}

fn build_time(report: &RayReport) -> (&'static str, Chart) {
    let lines = lines(report, "triangles", Quantity::BuildBottom, 1.0, |case, _| {
        (case.subject == "sphere").then_some(())?;
        match case.variant.as_str() {
            "build" => Some((String::new(), false, 2)),
            "build, fast build" => Some(("fast build".to_owned(), true, 2)),
            _ => None,
        }
    });
    ("build", Chart { title: title(report, "Building a bottom level"), x: TRIANGLES, y: TIME, lines })
}

fn memory(report: &RayReport) -> (&'static str, Chart) {
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
    ("memory", Chart { title: title(report, "Memory of a bottom level"), x, y, lines })
}

fn triangles(report: &RayReport) -> (&'static str, Chart) {
    let lines = lines(report, "triangles", Quantity::Rate, 1.0, |case, _| {
        let rough = case.subject != "sphere";
        (case.variant == "primary").then(|| (case.subject.clone(), rough, 2))
    });
    let what = "Primary rays through 1152 instances of one mesh";
    ("triangles", Chart { title: title(report, what), x: TRIANGLES, y: RATE, lines })
}

fn instances(report: &RayReport) -> (&'static str, Chart) {
    let lines = lines(report, "instances", Quantity::Rate, 1.0, |case, _| {
        Some((case.subject.clone(), case.subject != "regular", 2))
    });
    let what = "Rays that miss every instance";
    ("instances", Chart { title: title(report, what), x: INSTANCES, y: Axis { log: true, ..RATE }, lines })
}

fn top_level(report: &RayReport) -> (&'static str, Chart) {
    let lines = lines(report, "instances", Quantity::BuildTop, 1.0, |case, _| {
        Some((case.subject.clone(), case.subject != "regular", 2))
    });
    ("top-level", Chart { title: title(report, "Building a top level"), x: INSTANCES, y: TIME, lines })
}

/// Line style of a moving crowd: all or part of it moves; more instances give a thicker line.
fn crowd(subject: &str) -> (String, bool, u32) {
    let count: u32 = subject.split(' ').next().and_then(|n| n.parse().ok()).unwrap_or(0);
    (subject.to_owned(), subject.contains('%'), 1 + count / 700)
}

fn moving(report: &RayReport) -> (&'static str, Chart) {
    let refitted = |case: &Case| case.variant == "primary, refitted";
    let mut lines =
        lines(report, "moving", Quantity::Rate, 1.0, |case, _| refitted(case).then(|| crowd(&case.subject)));
    // Relative to the rate after a rebuild for the same instances.
    for line in &mut lines {
        let (rays, subject) = line.label.split_once(", ").unwrap_or((&line.label, ""));
        for point in &mut line.points {
            let case = Case::new("moving", subject, point.0, "primary, rebuilt");
            let rebuilt = report.row(&case, rays, Quantity::Rate).map_or(f64::NAN, |r: &Row| r.median);
            point.1 *= 100.0 / rebuilt;
        }
    }
    let y = Axis { name: "rate after refits, % of that of a new top level", log: false };
    let what = "Rays after instances have moved";
    ("moving", Chart { title: title(report, what), x: PATH, y, lines })
}

fn refit_time(report: &RayReport) -> (&'static str, Chart) {
    let mut all = lines(report, "moving", Quantity::BuildTop, 1.0, |case, _| {
        let (label, _, width) = crowd(&case.subject);
        (!label.contains('%')).then(|| (format!("{label}, rebuild"), false, width))
    });
    all.extend(lines(report, "moving", Quantity::RefitTop, 1.0, |case, _| {
        let (label, _, width) = crowd(&case.subject);
        (!label.contains('%')).then(|| (format!("{label}, refit"), true, width))
    }));
    let what = "A top level that follows its instances";
    ("refit", Chart { title: title(report, what), x: PATH, y: TIME, lines: all })
}
