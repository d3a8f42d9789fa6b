//! Dumps of a plan: as text, JSON, Graphviz and an HTML page with a drawing.
//!
//! | form | for | file |
//! |---|---|---|
//! | text | reading in a terminal, comparing two plans line by line | `text` |
//! | JSON | programs | `json` |
//! | DOT | Graphviz | `dot` |
//! | HTML | looking at: queues, memory, the graph's savings | `html` |
//!
//! All of them are functions of the declaration and its plan: equal plans give equal dumps.

mod describe;
mod dot;
mod gains;
mod html;
mod json;
mod text;

use super::{declaration::Declaration, plan::Plan};

pub use gains::Gains;

/// A plan to be dumped, with what was measured of it.
#[derive(Clone, Copy, Debug)]
pub struct Dump<'a> {
    /// The declared frame.
    pub declaration: &'a Declaration,
    /// The plan of that frame.
    pub plan: &'a Plan,
    /// What the graph saved.
    pub gains: Gains,
}

impl<'a> Dump<'a> {
    /// A plan without measurements.
    pub fn new(declaration: &'a Declaration, plan: &'a Plan) -> Self {
        Self { declaration, plan, gains: Gains::of(plan) }
    }

    /// Adds the time that queues saved by overlapping, milliseconds.
    #[must_use]
    pub fn overlap(mut self, ms: Option<f64>) -> Self {
        self.gains.overlap_ms = ms;
        self
    }

    /// Text for people: passes in order with everything they wait for, culled passes with the reason, and the placement of
    /// everything in memory.
    pub fn text(&self) -> String {
        text::text(self)
    }

    /// JSON for programs.
    pub fn json(&self) -> String {
        json::json(self)
    }

    /// DOT for Graphviz: passes are boxes inside frames for their batches, versions of resources are ellipses, culled passes are dashed.
    pub fn dot(&self) -> String {
        dot::dot(self)
    }

    /// A self-contained HTML page without scripts.
    pub fn html(&self) -> String {
        html::html(self)
    }
}

/// [`Dump::text`] without measurements.
pub fn text(declaration: &Declaration, plan: &Plan) -> String {
    Dump::new(declaration, plan).text()
}

/// [`Dump::json`] without measurements.
pub fn json(declaration: &Declaration, plan: &Plan) -> String {
    Dump::new(declaration, plan).json()
}

/// [`Dump::dot`] of a plan.
pub fn dot(declaration: &Declaration, plan: &Plan) -> String {
    Dump::new(declaration, plan).dot()
}

/// [`Dump::html`] without measurements.
pub fn html(declaration: &Declaration, plan: &Plan) -> String {
    Dump::new(declaration, plan).html()
}

/// Compiles and runs the examples of `docs/frame-graph.md`.
#[cfg(doctest)]
#[doc = include_str!("../../../docs/frame-graph.md")]
mod page {}

#[cfg(test)]
#[path = "dump_tests.rs"]
mod tests;
