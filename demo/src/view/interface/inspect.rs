//! The panel of an inspected pass: its outputs, how the chosen one is shown, and the values in it.

use std::collections::BTreeMap;

use egui::{
    Color32, ComboBox, DragValue, FontId, Grid, Painter, Rect, Response, RichText, ScrollArea, Slider, Stroke,
    StrokeKind, Ui, pos2, vec2,
};
use magpie::graph::{Declaration, Format, Shape};
use magpie_passes::parts::inspect::{Channel, Colours, Inspected, Inspection, Look, Pick, PixelValue};

use super::{Action, Model};
use crate::{
    exit::Failure,
    view::look::{LookChange, MOST_ZOOM},
};

/// Stops by which the slider of the exposure brightens and darkens.
const STOPS: f32 = 16.0;

/// What is inspected.
#[derive(Clone, Debug, Default)]
pub(in super::super) struct Inspector {
    chosen: Option<Inspection>,
    /// The newest that was found in it.
    found: Option<Inspected>,
    /// How images were shown that were looked at before, by pass and output.
    looks: BTreeMap<(String, String), Look>,
    /// The pixel that is read wherever the pointer is.
    pinned: Option<[u32; 2]>,
    /// Whether the range is to be that of the next values.
    fits: bool,
}

impl Inspector {
    /// What the next frame looks into.
    pub fn inspection(&self) -> Option<&Inspection> {
        self.chosen.as_ref()
    }

    /// The pass.
    pub fn pass(&self) -> Option<&str> {
        self.chosen.as_ref().map(|chosen| chosen.pass.as_str())
    }

    /// Looks into an output of a pass, whose format may be known from an earlier frame.
    pub fn choose(&mut self, pass: String, output: String, format: Option<Format>) {
        self.close();
        let mut chosen = Inspection::of(&pass, &output, format);
        let known = self.looks.get(&(pass, output));
        self.fits = known.is_none() && format.is_some_and(Look::wants_fit);
        chosen.look = known.copied().unwrap_or(chosen.look);
        self.chosen = Some(chosen);
    }

    /// Shows the picture again.
    pub fn close(&mut self) {
        if let Some(Inspection { pass, output, look, .. }) = self.chosen.take() {
            self.looks.insert((pass, output), look);
        }
        (self.found, self.pinned, self.fits) = (None, None, false);
    }

    /// Changes how it is shown.
    pub fn change(&mut self, change: &LookChange) -> Result<(), Failure> {
        let none = || Failure::bad("no image is inspected");
        change.apply(self.chosen.as_mut().ok_or_else(none)?)?;
        self.fits = change.fit;
        Ok(())
    }

    /// Reads a pixel wherever the pointer is, or no longer.
    pub fn pin(&mut self, pixel: Option<[u32; 2]>) {
        self.pinned = pixel;
        if let Some(chosen) = &mut self.chosen {
            chosen.pick = pixel.map(Pick::Pixel);
        }
    }

    /// Takes what a finished frame has found.
    pub fn take(&mut self, found: Option<Inspected>) {
        let Some(chosen) = &mut self.chosen else { return };
        // Frames that were in flight may have looked into something else.
        self.found = found.filter(|found| (&found.pass, &found.output) == (&chosen.pass, &chosen.output));
        if let Some(found) = self.found.as_ref().filter(|_| self.fits) {
            chosen.look = chosen.look.fitted(found);
            self.fits = false;
        }
    }

    /// Follows the pointer over the picture where that is an inspected image. Returns whether a click in it is meant for the image.
    pub fn follow(&mut self, ui: &Ui, rect: Rect, response: &Response, actions: &mut Vec<Action>) -> bool {
        let (Some(chosen), Some(found)) = (&mut self.chosen, &self.found) else { return false };
        let pointer = response.hover_pos().map(|at| (at - rect.min) / rect.size());
        chosen.pick = self.pinned.map(Pick::Pixel).or_else(|| pointer.map(|at| Pick::Under([at.x, at.y])));
        let zoom = ui.input(|input| input.zoom_delta());
        if let Some(at) = pointer.filter(|_| zoom != 1.0) {
            zoom_about(chosen, found, [at.x, at.y], zoom);
        }
        let Some(pixel) = found.pixel else { return true };
        let place = texel(chosen, found, pixel.at, rect);
        let painter = ui.painter_at(rect);
        if rect.intersects(place) {
            mark(&painter, place, found.format, &pixel);
        }
        if response.clicked() {
            actions.push(Action::Pick((self.pinned != Some(pixel.at)).then_some(pixel.at)));
        }
        true
    }
}

/// Frames a pixel, and writes its values below it on the right, as far as there is room.
fn mark(painter: &Painter, place: Rect, format: Format, pixel: &PixelValue) {
    painter.rect_stroke(place.expand(1.0), 0.0, Stroke::new(1.0, Color32::BLACK), StrokeKind::Outside);
    painter.rect_stroke(place, 0.0, Stroke::new(1.0, Color32::WHITE), StrokeKind::Outside);
    let text = format!("{}, {}: {}", pixel.at[0], pixel.at[1], values(format, pixel).join("  "));
    let galley = painter.layout_no_wrap(text, FontId::monospace(12.0), Color32::WHITE);
    let rect = painter.clip_rect();
    let most = rect.max - galley.size() - vec2(4.0, 4.0);
    let at = place.right_bottom() + vec2(6.0, 6.0);
    let label = Rect::from_min_size(pos2(at.x.min(most.x), at.y.min(most.y)).max(rect.min), galley.size());
    painter.rect_filled(label.expand(3.0), 2.0, Color32::from_black_alpha(200));
    painter.galley(label.min, galley, Color32::WHITE);
}

/// Changes the zoom so that what is under the pointer stays there.
fn zoom_about(chosen: &mut Inspection, found: &Inspected, at: [f32; 2], factor: f32) {
    let zoom = (chosen.zoom * factor).clamp(1.0, MOST_ZOOM);
    let [left, top, width, height] = chosen.place(found.extent, found.picture);
    let picture = [found.picture.width as f32, found.picture.height as f32];
    for (axis, (start, side)) in [(left, width), (top, height)].into_iter().enumerate() {
        let under = (at[axis] * picture[axis] - start) / side;
        let new_side = side * zoom / chosen.zoom;
        chosen.centre[axis] = (under + (0.5 - at[axis]) * picture[axis] / new_side).clamp(0.0, 1.0);
    }
    chosen.zoom = zoom;
}

/// Where a pixel of the image lies, in points.
fn texel(chosen: &Inspection, found: &Inspected, [x, y]: [u32; 2], rect: Rect) -> Rect {
    let [left, top, width, height] = chosen.place(found.extent, found.picture);
    let point = |x: u32, y: u32| {
        let across = (left + width * x as f32 / found.extent.width as f32) / found.picture.width as f32;
        let down = (top + height * y as f32 / found.extent.height as f32) / found.picture.height as f32;
        rect.min + vec2(across, down) * rect.size()
    };
    Rect::from_min_max(point(x, y), point(x + 1, y + 1))
}

/// The values of a pixel, one text for each channel of the format.
fn values(format: Format, pixel: &PixelValue) -> Vec<String> {
    let of = |bits: &u32| match format.is_uint() {
        true => format!("{bits} (0x{bits:x})"),
        false => number(f32::from_bits(*bits).into()),
    };
    pixel.bits[..format.channels() as usize].iter().map(of).collect()
}

/// A number in few digits, of which six count.
fn number(value: f64) -> String {
    match value.abs() {
        _ if value.is_nan() => "NaN".to_owned(),
        _ if value.is_infinite() => (if value > 0.0 { "+inf" } else { "-inf" }).to_owned(),
        0.0 => "0".to_owned(),
        size if (1e-3..1e6).contains(&size) => {
            let decimals = (5 - size.log10().floor() as i32).max(0) as usize;
            format!("{value:.decimals$}")
        }
        _ => format!("{value:.5e}"),
    }
}

/// The same of a value of a format, of which integers are written in full.
fn end_of_range(format: Format, value: f64) -> String {
    if format.is_uint() { format!("{value:.0}") } else { number(value) }
}

/// What a click on a pass does: its first image is inspected, or if it is inspected, the picture is shown again.
pub(super) fn click(model: &Model<'_>, inspected: Option<&str>, pass: &str) -> Action {
    if inspected == Some(pass) {
        return Action::InspectNothing;
    }
    let declaration = model.planned.map(|planned| planned.declaration);
    let first = declaration.and_then(|declaration| {
        declaration.images_of(index_of(declaration, pass)?).into_iter().next().map(|output| output.name)
    });
    Action::Inspect(pass.to_owned(), first.unwrap_or_default())
}

/// Index of a pass.
fn index_of(declaration: &Declaration, pass: &str) -> Option<u32> {
    (0..declaration.passes.len() as u32).find(|&index| declaration.pass_name(index) == pass)
}

/// Format of an image that a pass writes.
pub(in super::super) fn format_of(declaration: &Declaration, pass: &str, output: &str) -> Option<Format> {
    let images = declaration.images_of(index_of(declaration, pass)?);
    let image = images.into_iter().find(|image| image.name == output)?;
    match declaration.resources[image.resource as usize].shape {
        Shape::Image { format, .. } => Some(format),
        Shape::Buffer { .. } | Shape::Accel { .. } => None,
    }
}

pub(super) fn show(ui: &mut Ui, model: &Model<'_>, inspector: &mut Inspector, actions: &mut Vec<Action>) {
    let Some(chosen) = &mut inspector.chosen else { return };
    ui.horizontal(|ui| {
        ui.strong(&chosen.pass);
        if ui.button("close").on_hover_text("Shows the picture again").clicked() {
            actions.push(Action::InspectNothing);
        }
    });
    ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
        outputs(ui, model, chosen, actions);
        let Some(found) = &inspector.found else { return };
        ui.separator();
        controls(ui, chosen, found, &mut inspector.fits);
        ui.separator();
        table(ui, chosen, found);
        if inspector.pinned.is_none() {
            ui.weak("A click in the image pins a pixel.");
        }
        if let Some([x, y]) = inspector.pinned {
            ui.horizontal(|ui| {
                ui.label(format!("pixel {x}, {y} is pinned"));
                if ui.button("release").on_hover_text("Reads the pixel under the pointer again").clicked() {
                    actions.push(Action::Pick(None));
                }
            });
        }
    });
}

/// What the pass writes, or why nothing can be seen of it.
fn outputs(ui: &mut Ui, model: &Model<'_>, chosen: &Inspection, actions: &mut Vec<Action>) {
    let Some(declaration) = model.planned.map(|planned| planned.declaration) else { return };
    let Some(pass) = index_of(declaration, &chosen.pass) else {
        ui.label(absent(model, &chosen.pass));
        return;
    };
    let images = declaration.images_of(pass);
    for image in &images {
        let Shape::Image { format, extent, mips, layers } = declaration.resources[image.resource as usize].shape else {
            continue;
        };
        let mut text = format!("{}  {format:?}, {}x{}", image.name, extent.width, extent.height);
        if mips > 1 {
            text += &format!(", {mips} mips");
        }
        if layers > 1 {
            text += &format!(", {layers} layers");
        }
        if ui.selectable_label(chosen.output == image.name, text).clicked() && chosen.output != image.name {
            actions.push(Action::Inspect(chosen.pass.clone(), image.name.clone()));
        }
    }
    for output in declaration.outputs_of(pass) {
        if let Shape::Buffer { bytes } = declaration.resources[output.resource as usize].shape {
            ui.weak(format!("{}  buffer, {bytes} bytes", output.name));
        }
    }
    if images.is_empty() {
        ui.label("It writes no image, so the picture is shown.");
    } else if !images.iter().any(|image| image.name == chosen.output) {
        ui.label(format!("It writes no image `{}`, so the picture is shown.", chosen.output));
    }
}

/// Why a pass is not in the newest frame.
fn absent(model: &Model<'_>, pass: &str) -> String {
    let stage = pass.split('.').next().unwrap_or(pass);
    let report = model.slots.iter().find(|report| report.slot == stage);
    let reason = report.map_or_else(String::new, |report| match &report.reason {
        Some(reason) if !report.runs => format!(" {stage} is idle: {reason}."),
        _ => format!(" {stage} is filled by {}, which has no such pass now.", report.implementation),
    });
    format!("The frame has no pass of this name, so the picture is shown.{reason}")
}

/// How the image is shown.
fn controls(ui: &mut Ui, chosen: &mut Inspection, found: &Inspected, fits: &mut bool) {
    let look = &mut chosen.look;
    let about = "Stops by which values are brightened before all else";
    ui.add(Slider::new(&mut look.exposure, -STOPS..=STOPS).text("exposure").suffix(" EV")).on_hover_text(about);
    ui.horizontal(|ui| {
        ComboBox::from_id_salt("channel").width(90.0).selected_text(look.channel.name()).show_ui(ui, |ui| {
            for channel in Channel::ALL.into_iter().filter(|channel| channel.is_of(found.format)) {
                ui.selectable_value(&mut look.channel, channel, channel.name());
            }
        });
        ComboBox::from_id_salt("colours").width(90.0).selected_text(look.colours.name()).show_ui(ui, |ui| {
            for colours in Colours::ALL {
                ui.selectable_value(&mut look.colours, colours, colours.name());
            }
        });
        let about = "Encodes plain colours as sRGB, as linear ones must be for a display";
        ui.checkbox(&mut look.encodes, "sRGB").on_hover_text(about);
    });
    ui.horizontal(|ui| {
        let speed = f64::from(look.range[1] - look.range[0]).abs().max(1e-6) / 200.0;
        for (at, name) in ["from ", "to "].into_iter().enumerate() {
            ui.add(DragValue::new(&mut look.range[at]).speed(speed).max_decimals(6).prefix(name));
        }
        if ui.button("fit").on_hover_text("Sets the range to that of the values").clicked() {
            *fits = true;
        }
        if ui.button("defaults").clicked() {
            *look = Look::of(found.format);
        }
    });
    if found.mips > 1 {
        ui.add(Slider::new(&mut chosen.mip, 0..=found.mips - 1).text("mip"));
    }
    if found.layers > 1 {
        ui.add(Slider::new(&mut chosen.layer, 0..=found.layers - 1).text("layer"));
    }
    let about = "Control and the wheel over the image do the same";
    ui.add(Slider::new(&mut chosen.zoom, 1.0..=MOST_ZOOM).logarithmic(true).text("zoom")).on_hover_text(about);
}

/// What the values range over, those of one pixel, and what is not finite.
fn table(ui: &mut Ui, chosen: &Inspection, found: &Inspected) {
    let shown = if chosen.mip > 0 || found.layers > 1 {
        format!("{}x{}, mip {}, layer {}", found.extent.width, found.extent.height, found.mip, found.layer)
    } else {
        format!("{}x{} pixels", found.extent.width, found.extent.height)
    };
    ui.label(shown);
    let pixel = found.pixel.map(|pixel| (pixel.at, values(found.format, &pixel)));
    Grid::new("values").striped(true).num_columns(4).show(ui, |ui| {
        let at = pixel.as_ref().map_or_else(|| "pixel".to_owned(), |([x, y], _)| format!("{x}, {y}"));
        for head in ["", "least", "greatest", &at] {
            ui.strong(head);
        }
        ui.end_row();
        for (channel, range) in found.ranges.iter().enumerate() {
            ui.strong(["r", "g", "b", "a"][channel]);
            match range {
                Some(range) => range.iter().for_each(|end| drop(ui.monospace(end_of_range(found.format, *end)))),
                None => (0..2).for_each(|_| drop(ui.monospace("-"))),
            }
            let value = pixel.as_ref().map_or("", |(_, values)| values[channel].as_str());
            ui.monospace(value);
            ui.end_row();
        }
    });
    if found.format.is_float() {
        let text = format!("NaN in {}, +inf in {}, -inf in {} pixels", found.nan, found.above, found.below);
        let is_bad = found.nan + found.above + found.below > 0;
        ui.label(if is_bad { RichText::new(text).color(Color32::RED) } else { RichText::new(text).weak() });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_six_digits() {
        let texts = [0.0, 0.25, -1.0, 123_456.7, 0.001_234_567, 1e-9, 3e20, f64::NAN, f64::INFINITY, f64::NEG_INFINITY]
            .map(number);
        let wanted =
            ["0", "0.250000", "-1.00000", "123457", "0.00123457", "1.00000e-9", "3.00000e20", "NaN", "+inf", "-inf"];
        assert_eq!(texts, wanted);
        let pixel = PixelValue { at: [0; 2], bits: [255, f32::NAN.to_bits(), 0, 0] };
        assert_eq!(values(Format::R32Uint, &pixel), ["255 (0xff)"]);
        assert_eq!(end_of_range(Format::R32Uint, 4_294_967_295.0), "4294967295");
        assert_eq!(values(Format::Rg32Float, &pixel)[1], "NaN");
    }

    /// The place under the pointer stays there, until the edge of the image is met.
    #[test]
    fn zoom_keeps_what_is_under_the_pointer() {
        let (size, picture) = (magpie::graph::Extent::new(160, 120), magpie::graph::Extent::new(320, 240));
        let mut chosen = Inspection::of("a.b", "c", None);
        let found = Inspected {
            pass: "a.b".to_owned(),
            output: "c".to_owned(),
            format: Format::R32Float,
            extent: size,
            mip: 0,
            layer: 0,
            mips: 1,
            layers: 1,
            place: chosen.place(size, picture),
            picture,
            pixel: None,
            ranges: vec![None],
            nan: 0,
            above: 0,
            below: 0,
        };
        let at = [0.7, 0.3];
        let under = |place: [f32; 4]| [(224.0 - place[0]) / place[2], (72.0 - place[1]) / place[3]];
        for factor in [2.0, 1.5, 4.0, 0.5] {
            let before = under(chosen.place(size, picture));
            zoom_about(&mut chosen, &found, at, factor);
            let after = under(chosen.place(size, picture));
            assert!(before.iter().zip(after).all(|(a, b)| (a - b).abs() < 1e-4), "{before:?}, {after:?}");
        }
        zoom_about(&mut chosen, &found, at, 1e-3);
        assert_eq!(chosen.place(size, picture), [0.0, 0.0, 320.0, 240.0]);
    }
}
