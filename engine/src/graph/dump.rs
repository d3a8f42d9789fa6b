//! The plan in words, as data, as a graph and as a page with a picture.
//!
//! | form | for | file |
//! |---|---|---|
//! | text | reading in a terminal, comparing two plans line by line | `text` |
//! | JSON | programs | `json` |
//! | DOT | Graphviz | `dot` |
//! | HTML | looking at: queues, memory, what the graph gained | `html` |
//!
//! All of them are functions of the declaration and its plan: equal plans give equal dumps.

mod dot;
mod gains;
mod html;
mod json;
mod text;
mod words;

use super::{declaration::Declaration, plan::Plan};

pub use gains::Gains;

/// A plan to be shown, with what was measured of it.
#[derive(Clone, Copy, Debug)]
pub struct Dump<'a> {
    /// What was declared.
    pub declaration: &'a Declaration,
    /// How it runs.
    pub plan: &'a Plan,
    /// What the graph gained.
    pub gains: Gains,
}

impl<'a> Dump<'a> {
    /// A plan of which nothing was measured.
    pub fn new(declaration: &'a Declaration, plan: &'a Plan) -> Self {
        Self { declaration, plan, gains: Gains::of(plan) }
    }

    /// With the time that queues saved by working beside each other, milliseconds.
    #[must_use]
    pub fn overlap(mut self, ms: Option<f64>) -> Self {
        self.gains.overlap_ms = ms;
        self
    }

    /// In words: passes in order with all they wait for, what is left out and why, where everything lies in memory.
    pub fn text(&self) -> String {
        text::text(self)
    }

    /// As data.
    pub fn json(&self) -> String {
        json::json(self)
    }

    /// For Graphviz: passes are boxes in the frames of their batches, versions of resources ellipses; what is left out is dashed.
    pub fn dot(&self) -> String {
        dot::dot(self)
    }

    /// As a page that needs nothing else, without scripts.
    pub fn html(&self) -> String {
        html::html(self)
    }
}

/// [`Dump::text`] of a plan of which nothing was measured.
pub fn text(declaration: &Declaration, plan: &Plan) -> String {
    Dump::new(declaration, plan).text()
}

/// [`Dump::json`] of a plan of which nothing was measured.
pub fn json(declaration: &Declaration, plan: &Plan) -> String {
    Dump::new(declaration, plan).json()
}

/// [`Dump::dot`] of a plan.
pub fn dot(declaration: &Declaration, plan: &Plan) -> String {
    Dump::new(declaration, plan).dot()
}

/// [`Dump::html`] of a plan of which nothing was measured.
pub fn html(declaration: &Declaration, plan: &Plan) -> String {
    Dump::new(declaration, plan).html()
}

/// Tests the examples of the page on the graph.
#[cfg(doctest)]
#[doc = include_str!("../../../docs/frame-graph.md")]
mod page {}

#[cfg(test)]
#[path = "dump_tests.rs"]
mod tests;
