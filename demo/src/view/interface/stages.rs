//! The panel of stages: what fills each slot, its settings, and what is idle and why.

use egui::{ComboBox, DragValue, RichText, ScrollArea, Slider, Ui};
use magpie::{
    config::Value,
    slot::{Range, SettingSpec, SlotInfo},
};

use super::{Action, Model};

/// Ranges over which a slider has one thousand times its least step are logarithmic, or a field to drag in.
const WIDE: f64 = 1000.0;

pub(super) fn show(ui: &mut Ui, model: &Model<'_>, actions: &mut Vec<Action>) {
    ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
        for slot in &model.catalogue.slots {
            let Some(chosen) = model.config.stages.get(&slot.name) else { continue };
            let report = model.slots.iter().find(|report| report.slot == slot.name);
            let idle = report.is_some_and(|report| !report.runs);
            let title = RichText::new(format!("{}: {chosen}", slot.name));
            let title = if idle { title.weak() } else { title };
            egui::CollapsingHeader::new(title).id_salt(&slot.name).show(ui, |ui| {
                ui.weak(&slot.about);
                if let Some(reason) = report.and_then(|report| report.reason.as_deref()).filter(|_| idle) {
                    ui.label(format!("idle: {reason}"));
                }
                choose(ui, slot, chosen, actions);
                let settings = slot.implementation(chosen).map_or(&[][..], |i| &i.settings);
                for spec in settings {
                    let value = model.config.settings.get(&slot.name).and_then(|values| values.get(spec.key));
                    setting(ui, slot, spec, value.unwrap_or(&spec.default), actions);
                }
                for part in report.iter().flat_map(|report| &report.parts).filter(|part| !part.runs) {
                    let reason = part.reason.as_deref().unwrap_or_default();
                    ui.weak(format!("{} is idle: {reason}", part.part));
                }
                if ui.button("defaults").on_hover_text("The default implementation and settings").clicked() {
                    actions.push(Action::Reset(slot.name.clone()));
                }
            });
        }
    });
}

/// The implementations and presets of a slot.
fn choose(ui: &mut Ui, slot: &SlotInfo, chosen: &str, actions: &mut Vec<Action>) {
    ComboBox::from_id_salt(("choice", &slot.name)).selected_text(chosen).show_ui(ui, |ui| {
        for implementation in &slot.implementations {
            let label = ui.selectable_label(implementation.name == chosen, &implementation.name);
            if label.on_hover_text(&implementation.about).clicked() {
                actions.push(Action::Set(format!("stages.{}={}", slot.name, implementation.name)));
            }
        }
        for preset in &slot.presets {
            let settings: Vec<String> = preset.settings.iter().map(|(key, value)| format!("{key} {value}")).collect();
            let about = format!("{} with {}", preset.implementation, settings.join(", "));
            if ui.selectable_label(false, format!("{} (preset)", preset.name)).on_hover_text(about).clicked() {
                // A preset says what all settings are.
                actions.push(Action::Reset(slot.name.clone()));
                actions.push(Action::Set(format!("stages.{}={}", slot.name, preset.name)));
            }
        }
    });
}

/// One setting, with its unit, range and what it does.
fn setting(ui: &mut Ui, slot: &SlotInfo, spec: &SettingSpec, value: &Value, actions: &mut Vec<Action>) {
    let about = || {
        let unit = if spec.unit.is_empty() { String::new() } else { format!(", {}", spec.unit) };
        format!("{}\n\n{}.{}: {}{unit}; {} by default", spec.about, slot.name, spec.key, spec.range, spec.default)
    };
    let mut set = |value: String| actions.push(Action::Set(format!("{}.{}={value}", slot.name, spec.key)));
    let suffix = if spec.unit.is_empty() { String::new() } else { format!(" {}", spec.unit) };
    ui.horizontal(|ui| {
        match (value, &spec.range) {
            (Value::Bool(on), _) => {
                let mut on = *on;
                if ui.checkbox(&mut on, spec.key).on_hover_text(about()).changed() {
                    set(on.to_string());
                }
                return;
            }
            (Value::Text(text), Range::OneOf(names)) => {
                ComboBox::from_id_salt((&slot.name, spec.key)).selected_text(text).show_ui(ui, |ui| {
                    for name in *names {
                        if ui.selectable_label(name == text, *name).clicked() {
                            set((*name).to_owned());
                        }
                    }
                });
            }
            (Value::Text(text), _) => {
                let mut text = text.clone();
                if ui.text_edit_singleline(&mut text).lost_focus() {
                    set(text);
                }
            }
            (Value::Integer(number), Range::Among(numbers)) => {
                let id = (&slot.name, spec.key);
                ComboBox::from_id_salt(id).selected_text(number.to_string()).show_ui(ui, |ui| {
                    for choice in *numbers {
                        if ui.selectable_label(choice == number, choice.to_string()).clicked() {
                            set(choice.to_string());
                        }
                    }
                });
            }
            (Value::Integer(number), range) => {
                let mut number = *number;
                let changed = match range {
                    Range::Integer { min, max } if (max - min) as f64 <= WIDE => {
                        ui.add(Slider::new(&mut number, *min..=*max).suffix(&suffix)).changed()
                    }
                    Range::Integer { min, max } => {
                        ui.add(Slider::new(&mut number, *min..=*max).suffix(&suffix).logarithmic(true)).changed()
                    }
                    _ => ui.add(DragValue::new(&mut number).suffix(&suffix)).changed(),
                };
                if changed {
                    set(number.to_string());
                }
            }
            (Value::Float(number), range) => {
                let mut number = *number;
                let changed = match range {
                    Range::Float { min, max } => {
                        let wide = *min >= 0.0 && *max > WIDE;
                        ui.add(Slider::new(&mut number, *min..=*max).suffix(&suffix).logarithmic(wide)).changed()
                    }
                    _ => ui.add(DragValue::new(&mut number).suffix(&suffix)).changed(),
                };
                if changed {
                    // With a point, so that it is read as a number of the same kind.
                    set(format!("{number:?}"));
                }
            }
        }
        ui.label(spec.key).on_hover_text(about());
    });
}
