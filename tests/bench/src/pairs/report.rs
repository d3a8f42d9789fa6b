//! Results of `magpie bench pairs` as text, Markdown and JSON.
use super::{Cell, PairsOptions, SUSPICIOUS};
use magpie::gpu::Gpu;
use magpie::scene::Scene;
use serde::Serialize;
use std::fmt::Write;

/// Results of a run.
#[derive(Clone, Debug, Serialize)]
pub struct PairsReport {
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
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Names of the features, in the order of the table.
    pub features: Vec<&'static str>,
    /// Results without features, with each feature alone, and with every possible pair.
    pub cells: Vec<Cell>,
}

impl PairsReport {
    pub(super) fn new(
        gpu: &Gpu,
        scene: &Scene,
        options: &PairsOptions,
        features: Vec<&'static str>,
        cells: Vec<Cell>,
    ) -> Self {
        let report = gpu.report();
        Self {
            magpie: env!("CARGO_PKG_VERSION"),
            commit: options.commit.clone(),
            device: report.name.clone(),
            driver: report.driver.clone(),
            scene: scene.name.clone(),
            size: options.size,
            features,
            cells,
        }
    }

    /// The report as JSON.
    ///
    /// # Errors
    /// Any error of the serialiser.
    pub fn to_json(&self) -> Result<String, serde_json::Error> {
        serde_json::to_string_pretty(self)
    }

    fn cell(&self, a: &str, b: &str) -> Option<&Cell> {
        self.cells.iter().find(|c| c.features == [a, b] || c.features == [b, a])
    }

    /// Pairs whose error exceeds [`SUSPICIOUS`] times the root of the sum of squares of their features', or is not finite: names, and
    /// ratios at rest and in motion.
    #[must_use]
    pub fn suspicious(&self) -> Vec<([&'static str; 2], [f64; 2])> {
        let mut found = Vec::new();
        for pair in self.cells.iter().filter(|c| c.features[0] != c.features[1]) {
            let alone = pair.features.map(|f| self.cell(f, f));
            let both = |of: &dyn Fn(&Cell) -> f64| alone.iter().flatten().map(|c| of(c).powi(2)).sum::<f64>().sqrt();
            let ratios = [pair.still / both(&|c| c.still), pair.moving / both(&|c| c.moving)];
            if !ratios.iter().all(|r| *r <= SUSPICIOUS) {
                found.push((pair.features, ratios));
            }
        }
        found
    }

    /// A Markdown table: error at rest / in motion, in thousandths. A star marks suspicious pairs, a dash features that exclude each other.
    #[must_use]
    pub fn table(&self) -> String {
        let suspicious = self.suspicious();
        let cell_text = |cell: Option<&Cell>| {
            cell.map_or("-".to_owned(), |cell| {
                let star = if suspicious.iter().any(|(pair, _)| *pair == cell.features) { " *" } else { "" };
                format!("{:.1} / {:.1}{star}", 1e3 * cell.still, 1e3 * cell.moving)
            })
        };
        let mut text = format!("| | alone | {} |\n|---|---|", self.features.join(" | "));
        text.push_str(&"---|".repeat(self.features.len()));
        let _ = write!(text, "\n| nothing | {} |{}", cell_text(self.cell("", "")), " |".repeat(self.features.len()));
        for (at, row) in self.features.iter().enumerate() {
            let _ = write!(text, "\n| {row} | {} |", cell_text(self.cell(row, row)));
            for (column, name) in self.features.iter().enumerate() {
                let _ = match column.cmp(&at) {
                    std::cmp::Ordering::Less => write!(text, " {} |", cell_text(self.cell(row, name))),
                    _ => write!(text, " |"),
                };
            }
        }
        text.push('\n');
        for ([a, b], [still, moving]) in &suspicious {
            let _ = writeln!(text, "* {a} with {b}: {still:.2} still, {moving:.2} moving, times what the two make");
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(pair: [f64; 2]) -> PairsReport {
        let cell = |a, b, [still, moving]: [f64; 2]| Cell { features: [a, b], still, moving };
        let cells = vec![
            cell("", "", [0.01, 0.02]),
            cell("a", "a", [0.01, 0.03]),
            cell("a", "b", pair),
            cell("b", "b", [0.02, 0.02]),
        ];
        let text = String::new;
        let (magpie, size, features) = ("", [1, 1], vec!["a", "b"]);
        PairsReport { magpie, commit: text(), device: text(), driver: text(), scene: text(), size, features, cells }
    }

    #[test]
    fn a_pair_worse_than_both_is_told() {
        assert!(report([0.02, 0.03]).suspicious().is_empty());
        // The root of 0.01² + 0.02² is 0.0224, that of 0.03² + 0.02² is 0.0361.
        assert!(report([0.026, 0.043]).suspicious().is_empty());
        assert_eq!(report([0.028, 0.03]).suspicious().len(), 1);
        assert_eq!(report([0.02, 0.045]).suspicious()[0].0, ["a", "b"]);
        assert_eq!(report([f64::NAN, 0.02]).suspicious().len(), 1);
        let table = report([0.0335, 0.03]).table();
        assert!(
            table.contains("| b | 20.0 / 20.0 | 33.5 / 30.0 * |") && table.contains("1.50 still, 0.83 moving"),
            "{table}"
        );
    }
}
