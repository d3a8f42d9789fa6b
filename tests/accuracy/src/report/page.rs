//! The HTML page: a single file with numbers, pictures, style and script embedded.
use super::{Metric, Report};
use crate::AccuracyError;
use crate::pictures::base64;
use crate::sweep::image_name;
use crate::truth::truth_of;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");
const CHARTS: &str = include_str!("charts.js");

/// Data for the script: the report and what only the page needs.
#[derive(Serialize)]
struct Data<'a> {
    report: &'a Report,
    metrics: Vec<(&'static str, &'static str)>,
    /// Name of the ground truth by slot.
    truths: BTreeMap<&'a str, &'static str>,
    /// PNGs in base 64 by file name.
    images: BTreeMap<String, String>,
}

impl Report {
    /// The report as a page. `folder` holds the pictures; missing ones are left out.
    ///
    /// # Errors
    /// [`AccuracyError::Json`] if the numbers cannot be serialised.
    pub fn to_html(&self, folder: &Path) -> Result<String, AccuracyError> {
        let mut names: Vec<String> = self.truths.iter().map(|t| format!("truth.{}.png", t.only)).collect();
        for variant in &self.run.plan.variants {
            let slot = if truth_of(&variant.slot).is_some() { variant.slot.as_str() } else { "" };
            for slot in [slot, ""] {
                names.extend(["png", "flip.png"].map(|what| image_name(&variant.setup, slot, what)));
            }
        }
        let slots = self.effects.iter().map(|e| e.slot.as_str());
        let data = Data {
            report: self,
            metrics: Metric::ALL.map(|m| (m.key(), m.name())).to_vec(),
            truths: slots.filter_map(|slot| Some((slot, truth_of(slot)?.name()))).collect(),
            images: names.into_iter().filter_map(|n| Some((n.clone(), base64(&folder.join(&n))?))).collect(),
        };
        let data = serde_json::to_string(&data).map_err(AccuracyError::json(Path::new("page"), 0))?;
        // In a script element only its end tag is special.
        let data = data.replace("</", "<\\/");
        let title = format!("What accuracy costs: {}", escaped(&self.run.scene));
        Ok(format!(
            "<!doctype html>\n<html lang=\"en-GB\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{title}</title>\n\
             <style>\n{STYLE}</style>\n</head>\n<body>\n<main id=\"page\"></main>\n\
             <noscript>This page draws its charts with a script inside of it. The numbers are in report.json and report.csv.</noscript>\n\
             <script type=\"application/json\" id=\"data\">{data}</script>\n<script>\n{CHARTS}{SCRIPT}</script>\n</body>\n</html>\n"
        ))
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
