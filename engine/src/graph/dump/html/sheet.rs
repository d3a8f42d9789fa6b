//! The drawing surface: a fixed sheet with names on the left, and a scrolling sheet with one column per pass.

use std::fmt::Write;

use super::{super::Dump, escape};

/// Width of the sheet with the names, pixels.
pub(super) const NAMES: f64 = 184.0;
/// Margin beside the columns for marks on their edges, pixels.
const EDGE: f64 = 8.0;
/// Width that the columns fill when there are few of them, pixels. With names and margins, the page then fills a laptop screen.
pub(super) const ROOM: f64 = 1138.0;
/// Narrowest and widest column, pixels.
const COLUMN: (f64, f64) = (32.0, 126.0);
/// Average width of a letter of the passes' names, pixels.
const LETTER: f64 = 6.1;
/// Letters of a pass's name that are shown; the tooltip has all of it.
const MAX_LETTERS: usize = 40;

/// A rectangle, pixels.
#[derive(Clone, Copy)]
pub(super) struct Area {
    pub x: f64,
    pub y: f64,
    pub width: f64,
    pub height: f64,
}

impl Area {
    fn attributes(self) -> String {
        let Self { x, y, width, height } = self;
        format!("x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\"")
    }
}

/// Both sheets. They are drawn from top to bottom.
pub(super) struct Sheet {
    names: String,
    columns: String,
    /// Elements behind everything else, drawn once the height is known.
    behind: String,
    /// Width of a column, pixels.
    column: f64,
    count: usize,
    width: f64,
    /// Top of the next panel, pixels.
    pub y: f64,
}

impl Sheet {
    /// Draws the names of the passes over their columns. A further column stands for the end of the frame.
    pub fn new(dump: &Dump<'_>) -> Self {
        let plan = dump.plan;
        let count = plan.order.len() + 1;
        let column = (ROOM / count as f64).clamp(COLUMN.0, COLUMN.1);
        let name = |index: &u32| shortened(dump.declaration.pass_name(*index), MAX_LETTERS);
        let names: Vec<String> = plan.order.iter().map(name).chain(["end".to_owned()]).collect();
        let longest = names.iter().map(|n| n.chars().count()).max().unwrap_or(0) as f64 * LETTER;
        // Names that do not fit side by side are drawn diagonally.
        let climbs = longest > column - 8.0;
        let slope = 0.707;
        let (top, beyond) = if climbs { (longest * slope + 22.0, longest * slope) } else { (30.0, 8.0) };
        let width = count as f64 * column + beyond;
        let mut sheet =
            Self { names: String::new(), columns: String::new(), behind: String::new(), column, count, width, y: top };
        for (position, name) in names.iter().enumerate() {
            let (x, y) = (sheet.middle(position), top - 10.0);
            let attributes = match climbs {
                true => format!("class=\"head\" transform=\"translate({:.1} {y:.1}) rotate(-45)\"", x + 3.0),
                false => format!("class=\"head\" text-anchor=\"middle\" transform=\"translate({x:.1} {y:.1})\""),
            };
            let tooltip = plan.order.get(position).map_or("end of the frame", |p| dump.declaration.pass_name(*p));
            sheet.draw(&format!("<text {attributes}>{}<title>{}</title></text>", escape(name), escape(tooltip)));
        }
        sheet
    }

    /// Left edge of a column, pixels.
    pub fn left(&self, position: usize) -> f64 {
        position as f64 * self.column
    }

    /// Middle of a column, pixels.
    pub fn middle(&self, position: usize) -> f64 {
        (position as f64 + 0.5) * self.column
    }

    /// Width of a column, pixels.
    pub fn column(&self) -> f64 {
        self.column
    }

    /// Width of all columns, pixels.
    pub fn across(&self) -> f64 {
        self.count as f64 * self.column
    }

    /// Appends markup to the columns.
    pub fn draw(&mut self, markup: &str) {
        writeln!(self.columns, "{markup}").unwrap_or_default();
    }

    /// A rectangle in the columns, with a tooltip.
    pub fn area(&mut self, area: Area, attributes: &str, tooltip: &str) {
        let tooltip = if tooltip.is_empty() { String::new() } else { format!("<title>{}</title>", escape(tooltip)) };
        self.draw(&format!("<rect {} {attributes}>{tooltip}</rect>", area.attributes()));
    }

    /// Text in the columns. It takes no pointer events, so that the tooltip behind it shows.
    pub fn text(&mut self, (x, y): (f64, f64), attributes: &str, text: &str) {
        self.draw(&format!("<text x=\"{x:.1}\" y=\"{y:.1}\" {attributes}>{}</text>", escape(text)));
    }

    /// A right-aligned name on the left, with a tooltip.
    pub fn name(&mut self, y: f64, class: &str, text: &str, tooltip: &str) {
        let tooltip = if tooltip.is_empty() { String::new() } else { format!("<title>{}</title>", escape(tooltip)) };
        let x = NAMES - 12.0;
        let text = escape(text);
        writeln!(
            self.names,
            "<text class=\"{class}\" x=\"{x}\" y=\"{y:.1}\" text-anchor=\"end\">{text}{tooltip}</text>"
        )
        .unwrap_or_default();
    }

    /// A heading across the names and the columns.
    pub fn heading(&mut self, text: &str, more: &str) {
        let y = self.y + 15.0;
        writeln!(self.names, "<text class=\"heading\" x=\"0\" y=\"{y:.1}\">{}</text>", escape(text))
            .unwrap_or_default();
        self.text((4.0, y), "class=\"more\"", more);
        self.y += 26.0;
    }

    /// Vertical lines between columns over a range of heights, behind everything else.
    pub fn grid(&mut self, top: f64, bottom: f64) {
        for position in 0..=self.count {
            let x = self.left(position);
            writeln!(self.behind, "<path class=\"grid\" d=\"M{x:.1} {top:.1}V{bottom:.1}\"/>").unwrap_or_default();
        }
    }

    /// Both sheets side by side.
    pub fn finish(self) -> String {
        let (width, height) = (self.width + 2.0 * EDGE, self.y + 4.0);
        let Self { names, columns, behind, .. } = self;
        format!(
            "<figure><svg class=\"names\" width=\"{NAMES}\" height=\"{height:.0}\">\n{names}</svg>\
             <svg width=\"{width:.0}\" height=\"{height:.0}\" viewBox=\"-{EDGE} 0 {width:.0} {height:.0}\">\n\
             <defs><marker id=\"tip\" viewBox=\"0 0 8 8\" refX=\"7\" refY=\"4\" markerWidth=\"5\" markerHeight=\"5\" orient=\"auto\">\
             <path class=\"tip\" d=\"M0 0L8 4L0 8z\"/></marker></defs>\n{behind}{columns}</svg></figure>"
        )
    }
}

/// The text, cut to at most `letters` letters.
pub(super) fn shortened(text: &str, letters: usize) -> String {
    if text.chars().count() <= letters {
        return text.to_owned();
    }
    let head: String = text.chars().take(letters.saturating_sub(1)).collect();
    format!("{head}\u{2026}")
}
