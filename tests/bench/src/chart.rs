//! Line charts as SVG.
use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::prelude::*;
use plotters::series::DashedLineSeries;
use std::fmt::Display;

/// Width and height, pixels.
const SIZE: (u32, u32) = (900, 540);
const TITLE: i32 = 20;
const TEXT: i32 = 15;
/// Width of the legend beside the plot, pixels.
const LEGEND: i32 = 285;

/// Drawing a chart failed.
#[derive(Debug, thiserror::Error)]
#[error("chart `{title}`: {message}")]
pub struct ChartError {
    /// Title of the chart.
    title: String,
    /// The error of plotters.
    message: String,
}

/// One axis.
#[derive(Clone, Copy)]
pub struct Axis {
    /// Quantity and unit, as the axis is labelled.
    pub name: &'static str,
    /// Whether the axis is logarithmic.
    pub log: bool,
}

/// A line of a chart.
pub struct Line {
    /// Text in the legend.
    pub label: String,
    /// Colour of the line.
    pub colour: Colour,
    /// Whether the line is dashed.
    pub dashed: bool,
    /// Stroke width, pixels; tells lines of the same colour and style apart.
    pub width: u32,
    /// Points in order of x.
    pub points: Vec<(f64, f64)>,
}

/// A line chart with a legend.
pub struct Chart {
    /// Text above the plot.
    pub title: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Lines in the order of the legend.
    pub lines: Vec<Line>,
}

/// A colour from a palette for colour-blind readers (Okabe and Ito 2008).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Colour(u8, u8, u8);

impl Colour {
    /// Blue.
    pub const BLUE: Self = Self(0, 114, 178);
    /// Vermilion.
    pub const VERMILION: Self = Self(213, 94, 0);
    /// Bluish green.
    pub const GREEN: Self = Self(0, 158, 115);
    /// Reddish purple.
    pub const PURPLE: Self = Self(204, 121, 167);

    fn rgb(self) -> RGBColor {
        RGBColor(self.0, self.1, self.2)
    }
}

/// Formats an axis label with three significant digits, so that no two ticks read the same.
fn number(value: &f64) -> String {
    let decimals = (2.0 - value.abs().max(1e-6).log10().floor()).clamp(0.0, 6.0) as usize;
    let text = format!("{value:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

impl Chart {
    /// Range of one coordinate with a margin; a linear vertical axis begins at zero.
    fn range(&self, axis: Axis, pick: fn(&(f64, f64)) -> f64) -> std::ops::Range<f64> {
        let values = self.lines.iter().flat_map(|l| &l.points).map(pick).filter(|v| v.is_finite());
        let (lo, hi) = values.fold((f64::MAX, 0.0_f64), |(lo, hi), v| (lo.min(v), hi.max(v)));
        let hi = if hi > 0.0 { hi } else { 1.0 };
        if axis.log { lo.clamp(1e-6, hi / 1.5) / 1.2..hi * 1.2 } else { 0.0..hi * 1.08 }
    }

    /// The chart as SVG.
    ///
    /// # Errors
    /// [`ChartError`].
    pub fn svg(&self) -> Result<String, ChartError> {
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
            let style = line.colour.rgb().stroke_width(line.width);
            let points = line.points.iter().copied();
            let dashed = line.dashed;
            if dashed {
                chart.draw_series(DashedLineSeries::new(points, 7, 5, style)).map_err(self.failed())?;
            } else {
                chart.draw_series(LineSeries::new(points, style)).map_err(self.failed())?;
            }
            let dots = line.points.iter().map(|&p| Circle::new(p, 3, line.colour.rgb().filled()));
            chart.draw_series(dots).map_err(self.failed())?;
        }
        self.legend(root)?;
        root.present().map_err(self.failed())
    }
}

impl Chart {
    /// Draws the legend beside the plot.
    fn legend(&self, root: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>) -> Result<(), ChartError> {
        let left = SIZE.0 as i32 - LEGEND + 14;
        for (line, at) in self.lines.iter().zip(0..) {
            let (y, style) = (56 + 24 * at, line.colour.rgb().stroke_width(line.width));
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
    fn numbers_are_short_and_ticks_apart() {
        let shown: Vec<String> = [0.0, 1000.0, 20.0, 23.4, 2.5, 0.1, 0.25, 0.045, 0.0005].iter().map(number).collect();
        assert_eq!(shown, ["0", "1000", "20", "23.4", "2.5", "0.1", "0.25", "0.045", "0.0005"]);
    }
}
