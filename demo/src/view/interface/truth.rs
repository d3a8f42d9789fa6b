//! The panel of the reference: how it is shown, and how far configurations are from it.

use egui::{Grid, ScrollArea, Ui};

use super::Model;
use crate::view::{
    action::{Action, TruthView},
    truth::Measured,
};

pub(super) fn show(ui: &mut Ui, model: &Model<'_>, view: &mut TruthView, actions: &mut Vec<Action>) {
    match model.truth {
        Some(truth) if truth.samples > 0 => ui.label(format!("path traced, {} samples per pixel", truth.samples)),
        _ => ui.weak("the reference waits until the camera stands still"),
    };
    if model.plays {
        ui.weak("it starts again with every frame while time goes on");
    }
    ui.horizontal(|ui| {
        for (choice, name, about) in [
            (TruthView::Split, "split", "The picture left of the line, the reference right of it"),
            (TruthView::Error, "error", "FLIP of each pixel: black is equal, white is far apart"),
            (TruthView::Numbers, "numbers", "The picture alone"),
        ] {
            ui.selectable_value(view, choice, name).on_hover_text(about);
        }
        let export = ui.add_enabled(!model.measured.is_empty(), egui::Button::new("export"));
        if export.on_hover_text("Writes these numbers to a JSON file in the current folder").clicked() {
            let name = super::super::action::free_names(std::path::Path::new(""), ["truth.json"]);
            actions.extend(name.map(|[path]| Action::ExportTruth(path)));
        }
    });
    ui.separator();
    ScrollArea::both().auto_shrink(false).show(ui, |ui| table(ui, model.measured));
}

/// One row per configuration, the newest first.
fn table(ui: &mut Ui, measured: &[Measured]) {
    if measured.is_empty() {
        ui.weak("nothing has been measured yet");
        return;
    }
    Grid::new("measured").striped(true).num_columns(4).show(ui, |ui| {
        for (head, about) in [
            ("FLIP", "Mean difference as displayed, 0 to 1"),
            ("relMSE", "Relative mean squared error of radiance"),
            ("GPU ms", "Median of a frame with this configuration"),
            ("configuration", "What differs from the defaults"),
        ] {
            ui.strong(head).on_hover_text(about);
        }
        ui.end_row();
        for row in measured {
            ui.monospace(format!("{:.4}", row.flip));
            let noise = format!(
                "The noise that the reference still has after {} samples per pixel makes {:.2e} of it",
                row.samples, row.relmse_of_reference
            );
            ui.monospace(format!("{:.2e}", row.relmse)).on_hover_text(noise);
            ui.monospace(row.gpu_ms.map_or_else(|| "-".to_owned(), |ms| format!("{ms:.2}")));
            ui.label(&row.config);
            ui.end_row();
        }
    });
}
