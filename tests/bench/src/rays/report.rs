//! Results of `magpie bench rays`: rows of one format for every measurement, as JSON, CSV and a table.
use magpie::gpu::DeviceReport;
use magpie_shaders::Rays;
use serde::Serialize;
use std::fmt::Write;
use std::thread::available_parallelism;

/// Results of a run.
#[derive(Clone, Debug, Serialize)]
pub struct RayReport {
    /// Version of Magpie.
    pub magpie: &'static str,
    /// Commit of the build.
    pub commit: String,
    /// The device.
    pub device: DeviceLine,
    /// CPU threads of the machine, which matter for software BVH builds.
    pub threads: usize,
    /// Whether it was a quick run.
    pub quick: bool,
    /// Rays per dispatch of scenes; on a CPU device the set-ups have an eighth of them.
    pub size: u32,
    /// Names of the backends that were measured.
    pub rays: Vec<&'static str>,
    /// The measurements.
    pub rows: Vec<Row>,
    /// Software over hardware rates for the same rays.
    pub ratios: Vec<Ratio>,
    /// Comparisons of the backends' hits for the same rays.
    pub agreement: Vec<Agreement>,
    /// Measurements that were not possible, with the reason.
    pub left_out: Vec<String>,
}

/// The device of a run.
#[derive(Clone, Debug, Serialize)]
pub struct DeviceLine {
    /// Name of the device.
    pub name: String,
    /// Name and version of its driver.
    pub driver: String,
    /// `cpu`, `integrated`, `discrete` and such.
    pub kind: &'static str,
}

/// A measured quantity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Millions of rays per second.
    Rate,
    /// Milliseconds to build bottom levels.
    BuildBottom,
    /// Milliseconds to compact bottom levels.
    Compact,
    /// Milliseconds to build the top level.
    BuildTop,
    /// Milliseconds to refit the top level.
    RefitTop,
    /// Milliseconds to sort rays.
    Sort,
    /// Bytes of bottom levels.
    BottomBytes,
    /// Bytes of the top level.
    TopBytes,
    /// Bytes of scratch memory.
    ScratchBytes,
}

impl Quantity {
    /// The unit of its values.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Rate => "Mrays/s",
            Self::BuildBottom | Self::Compact | Self::BuildTop | Self::RefitTop | Self::Sort => "ms",
            Self::BottomBytes | Self::TopBytes | Self::ScratchBytes => "bytes",
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Rate => "rate",
            Self::BuildBottom => "build_bottom",
            Self::Compact => "compact",
            Self::BuildTop => "build_top",
            Self::RefitTop => "refit_top",
            Self::Sort => "sort",
            Self::BottomBytes => "bottom_bytes",
            Self::TopBytes => "top_bytes",
            Self::ScratchBytes => "scratch_bytes",
        }
    }
}

/// What a measurement is about.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Case {
    /// Set-up: `scene`, `triangles`, `instances` or `moving`.
    pub setup: &'static str,
    /// Name of the scene, shape or placement.
    pub subject: String,
    /// Independent variable: triangles of a mesh or scene, number of instances, or mean distance moved in diameters of an instance.
    pub x: f64,
    /// Kind of rays, or build options of the acceleration structures.
    pub variant: String,
}

impl Case {
    /// From its parts.
    pub fn new(setup: &'static str, subject: impl Into<String>, x: f64, variant: impl Into<String>) -> Self {
        Self { setup, subject: subject.into(), x, variant: variant.into() }
    }
}

/// One measurement.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// The measured case.
    #[serde(flatten)]
    pub case: Case,
    /// Name of the backend, or `driver` for what the two hardware backends share.
    pub rays: &'static str,
    /// The measured quantity.
    pub quantity: Quantity,
    /// Its unit.
    pub unit: &'static str,
    /// Median.
    pub median: f64,
    /// Minimum.
    pub min: f64,
    /// Maximum.
    pub max: f64,
    /// Number of values.
    pub samples: usize,
    /// Rays per dispatch; 0 for other quantities.
    pub count: u64,
}

impl Row {
    /// Statistics of values; none without values.
    pub fn new(case: &Case, rays: &'static str, quantity: Quantity, mut values: Vec<f64>, count: u64) -> Option<Self> {
        values.sort_by(f64::total_cmp);
        let (min, max) = (*values.first()?, *values.last()?);
        let half = values.len() / 2;
        let median = if values.len() % 2 == 1 { values[half] } else { (values[half - 1] + values[half]) / 2.0 };
        let (case, unit, samples) = (case.clone(), quantity.unit(), values.len());
        Some(Self { case, rays, quantity, unit, median, min, max, samples, count })
    }
}

/// Ratio of two rates.
#[derive(Clone, Debug, Serialize)]
pub struct Ratio {
    /// The measured case.
    #[serde(flatten)]
    pub case: Case,
    /// Name of the hardware backend.
    pub driver: &'static str,
    /// Median software rate over median hardware rate.
    pub software_over_driver: f64,
}

/// Comparison of the hits of two backends.
#[derive(Clone, Debug, Serialize)]
pub struct Agreement {
    /// The measured case.
    #[serde(flatten)]
    pub case: Case,
    /// Name of one backend.
    pub first: String,
    /// Name of the other backend.
    pub second: String,
    /// Number of rays.
    pub count: u64,
    /// Rays whose instance, primitive or side differ; for any-hit rays, whose result differs.
    pub differ: u64,
    /// Those of `differ` whose distances agree within 1e-4: coincident surfaces, or an edge.
    pub differ_at_same_distance: u64,
    /// Greatest relative difference in distance of hits that agree otherwise.
    pub worst_distance: f64,
}

impl Agreement {
    /// Share of rays with the same hit, or another one at the same distance.
    pub fn share(&self) -> f64 {
        1.0 - (self.differ - self.differ_at_same_distance) as f64 / self.count.max(1) as f64
    }
}

impl RayReport {
    /// An empty report.
    pub fn new(device: &DeviceReport, commit: &str, quick: bool, size: u32, ways: &[Rays]) -> Self {
        Self {
            magpie: env!("CARGO_PKG_VERSION"),
            commit: commit.to_owned(),
            device: DeviceLine { name: device.name.clone(), driver: device.driver.clone(), kind: device.kind },
            threads: available_parallelism().map_or(1, usize::from),
            quick,
            size,
            rays: ways.iter().map(|w| w.name()).collect(),
            rows: Vec::new(),
            ratios: Vec::new(),
            agreement: Vec::new(),
            left_out: Vec::new(),
        }
    }

    /// Adds a measurement.
    pub fn add(&mut self, case: &Case, rays: &'static str, quantity: Quantity, values: Vec<f64>, count: u64) {
        self.rows.extend(Row::new(case, rays, quantity, values, count));
    }

    /// The measurement of this case, if it exists.
    pub fn row(&self, case: &Case, rays: &str, quantity: Quantity) -> Option<&Row> {
        self.rows.iter().find(|r| r.case == *case && r.rays == rays && r.quantity == quantity)
    }

    /// Computes the ratios of all available rates.
    pub fn compare(&mut self) {
        let rates =
            |rays: &'static str| self.rows.iter().filter(move |r| r.quantity == Quantity::Rate && r.rays == rays);
        let mut ratios = Vec::new();
        for driver in [Rays::Query.name(), Rays::Pipeline.name()] {
            for row in rates(driver) {
                if let Some(own) = rates(Rays::Software.name()).find(|r| r.case == row.case) {
                    let software_over_driver = own.median / row.median;
                    ratios.push(Ratio { case: row.case.clone(), driver, software_over_driver });
                }
            }
        }
        self.ratios = ratios;
    }

    /// The report as JSON.
    ///
    /// # Errors
    /// A value that JSON cannot represent.
    pub fn to_json(&self) -> Result<String, serde_json::Error> {
        serde_json::to_string_pretty(self).map(|text| text + "\n")
    }

    /// The report as CSV with a header, a line per measurement.
    pub fn to_csv(&self) -> String {
        let mut text = String::from("setup,subject,x,variant,rays,quantity,unit,median,min,max,samples,count\n");
        let quoted = |word: &str| {
            let plain = !word.contains([',', '"', '\n']);
            if plain { word.to_owned() } else { format!("\"{}\"", word.replace('"', "\"\"")) }
        };
        for row in &self.rows {
            let Case { setup, subject, x, variant } = &row.case;
            let (subject, variant, quantity) = (quoted(subject), quoted(variant), row.quantity.name());
            let Row { rays, unit, median, min, max, samples, count, .. } = row;
            let _ = writeln!(
                text,
                "{setup},{subject},{x},{variant},{rays},{quantity},{unit},{median},{min},{max},{samples},{count}"
            );
        }
        text
    }

    /// The report as text: rates side by side with their ratios, then times and bytes.
    pub fn table(&self) -> String {
        let DeviceLine { name, driver, kind } = &self.device;
        let mut text = format!("{name} ({kind}, {driver}), {} threads\n", self.threads);
        let head = |what: &str| format!("{what:<9} {:<22} {:>9} {:<22}", "subject", "x", "variant");
        let _ = write!(text, "\n{}", head("rates"));
        for way in &self.rays {
            let _ = write!(text, " {way:>24}");
        }
        let _ = writeln!(text, "   software over query, pipeline");
        let mut cases: Vec<&Case> = Vec::new();
        for row in self.rows.iter().filter(|r| r.quantity == Quantity::Rate) {
            if !cases.contains(&&row.case) {
                cases.push(&row.case);
            }
        }
        for case in cases {
            text.push_str(&line(case));
            for way in &self.rays {
                let rate = self.row(case, way, Quantity::Rate).map(rate).unwrap_or_default();
                let _ = write!(text, " {rate:>24}");
            }
            for ratio in self.ratios.iter().filter(|r| r.case == *case) {
                let _ = write!(text, "   {:5.2}", ratio.software_over_driver);
            }
            text.push('\n');
        }
        let _ = writeln!(text, "\n{} {:<9} {:<14} {:>30}", head("built"), "by", "what", "median (least to most)");
        for row in self.rows.iter().filter(|r| r.quantity != Quantity::Rate) {
            let value = match row.unit {
                "bytes" => format!("{} B", row.median),
                _ => format!("{:.3} ms ({:.3} to {:.3})", row.median, row.min, row.max),
            };
            let _ = writeln!(text, "{} {:<9} {:<14} {value:>30}", line(&row.case), row.rays, row.quantity.name());
        }
        self.agreement_table(&mut text);
        for why in &self.left_out {
            let _ = writeln!(text, "left out: {why}");
        }
        text
    }

    /// Comparisons summed over the cases of a set-up; the JSON has each.
    fn agreement_table(&self, text: &mut String) {
        let _ = writeln!(
            text,
            "\n{:<10} {:<36} {:>10} {:>7} {:>11} {:>16}",
            "the same", "between", "rays", "differ", "at equal t", "worst t, share"
        );
        let mut groups: Vec<(&str, &str, &str)> = Vec::new();
        for a in &self.agreement {
            let group = (a.case.setup, a.first.as_str(), a.second.as_str());
            if !groups.contains(&group) {
                groups.push(group);
            }
        }
        for group in groups {
            let (setup, first, second) = group;
            let of = || self.agreement.iter().filter(|a| (a.case.setup, a.first.as_str(), a.second.as_str()) == group);
            let sum = |pick: fn(&Agreement) -> u64| of().map(pick).sum::<u64>();
            let (count, differ, same) = (sum(|a| a.count), sum(|a| a.differ), sum(|a| a.differ_at_same_distance));
            let worst = of().map(|a| a.worst_distance).fold(0.0, f64::max);
            let between = format!("{first} and {second}");
            let _ = writeln!(text, "{setup:<10} {between:<36} {count:>10} {differ:>7} {same:>11} {worst:>16.1e}");
        }
    }
}

fn line(case: &Case) -> String {
    format!("{:<9} {:<22} {:>9} {:<22}", case.setup, case.subject, case.x, case.variant)
}

/// Median with its spread, in a suitable unit.
fn rate(row: &Row) -> String {
    let (unit, scale) = if row.median >= 1000.0 { ("G", 1e-3) } else { ("M", 1.0) };
    let spread = 50.0 * (row.max - row.min) / row.median;
    format!("{:.3} {unit}rays/s ±{spread:.0} %", row.median * scale)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_lie_between() {
        let case = Case::new("scene", "a, \"b\"", 1.0, "primary");
        let row = Row::new(&case, "software", Quantity::Rate, vec![3.0, 1.0, 2.0, 10.0], 5).unwrap();
        assert_eq!((row.median, row.min, row.max, row.samples), (2.5, 1.0, 10.0, 4));
        assert!(Row::new(&case, "software", Quantity::Rate, Vec::new(), 5).is_none());
    }
}
