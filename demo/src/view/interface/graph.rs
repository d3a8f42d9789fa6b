//! The panel of the frame graph: passes on lanes of their queues, transients over their memory, and what was left out and why.

use std::fmt::Write as _;

use egui::{Align2, Color32, FontId, Rect, ScrollArea, Sense, Stroke, StrokeKind, Ui, pos2, vec2};
use magpie::graph::{Declaration, Plan, Queue, plan::Transient};

use super::{Action, Model, inspect::click, profiler::stage_colours};

/// Least width of a pass, points.
const COLUMN: f32 = 14.0;
/// Height of a lane, points.
const LANE: f32 = 20.0;
/// Height of all heaps together, points.
const HEAPS: f32 = 180.0;

/// A frame that was planned.
#[derive(Clone, Copy)]
pub(in super::super) struct Planned<'a> {
    pub declaration: &'a Declaration,
    pub plan: &'a Plan,
}

/// Shows the plan, and adds what a click on a pass of `inspected` or another one does.
pub(super) fn show(ui: &mut Ui, model: &Model<'_>, inspected: Option<&str>, actions: &mut Vec<Action>) {
    let Some(planned) = model.planned else {
        ui.weak("no frame has been planned yet");
        return;
    };
    let Planned { declaration, plan } = planned;
    let mebibytes = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    ui.label(format!(
        "{} passes, {} left out, {} barriers; transients take {:.1} MiB, {:.1} without sharing, {:.1} at least",
        plan.order.len(),
        plan.culled.len(),
        plan.barriers.len(),
        mebibytes(plan.heaps.iter().map(|heap| heap.bytes).sum()),
        mebibytes(plan.memory.unaliased),
        mebibytes(plan.memory.lower_bound),
    ));
    let mut clicked = None;
    ScrollArea::both().auto_shrink(false).show(ui, |ui| {
        let step = (ui.available_width() / plan.order.len().max(1) as f32).max(COLUMN);
        for queue in Queue::ALL {
            clicked = lane(ui, planned, queue, step).or(clicked);
        }
        let all: u64 = plan.heaps.iter().map(|heap| heap.bytes).sum();
        for (heap, size) in plan.heaps.iter().enumerate() {
            let height = (HEAPS * size.bytes as f32 / all.max(1) as f32).max(LANE);
            memory(ui, planned, heap as u32, step, vec2(step * plan.order.len() as f32, height));
        }
        ui.add_space(6.0);
        for culled in &plan.culled {
            let name = declaration.pass_name(culled.pass);
            let text = egui::RichText::new(format!("{name}: {}", culled.reason)).weak();
            if ui.selectable_label(inspected == Some(name), text).clicked() {
                clicked = Some(name);
            }
        }
        for report in model.slots.iter().filter(|report| !report.runs) {
            ui.weak(format!(
                "{}, {}: {}",
                report.slot,
                report.implementation,
                report.reason.as_deref().unwrap_or("idle")
            ));
        }
    });
    actions.extend(clicked.map(|pass| click(model, inspected, pass)));
}

/// The passes of one queue, each in the column of its place in the plan. Returns one that was clicked.
fn lane<'a>(ui: &mut Ui, Planned { declaration, plan }: Planned<'a>, queue: Queue, step: f32) -> Option<&'a str> {
    if !plan.batches.iter().any(|batch| batch.queue == queue) {
        return None;
    }
    let (rect, response) = ui.allocate_exact_size(vec2(step * plan.order.len() as f32, LANE), Sense::click());
    let mut clicked = None;
    let painter = ui.painter_at(rect);
    painter.rect_filled(rect, 0.0, ui.visuals().extreme_bg_color);
    for batch in plan.batches.iter().filter(|batch| batch.queue == queue) {
        for position in batch.passes.range() {
            let pass = plan.order[position];
            let left = rect.left() + step * position as f32;
            let cell = Rect::from_min_size(pos2(left, rect.top()), vec2(step - 1.0, LANE));
            let (fill, ink) = stage_colours(declaration.stage(pass));
            painter.rect_filled(cell, 2.0, fill);
            let name = declaration.pass_name(pass);
            painter.with_clip_rect(cell).text(
                cell.left_center() + vec2(2.0, 0.0),
                Align2::LEFT_CENTER,
                name,
                FontId::proportional(10.0),
                ink,
            );
            if response.hover_pos().is_some_and(|at| cell.contains(at)) {
                response.clone().on_hover_text(about_pass(declaration, pass, queue));
                if response.clicked() {
                    clicked = Some(name);
                }
            }
        }
    }
    clicked
}

/// What a pass reads and writes.
fn about_pass(declaration: &Declaration, pass: u32, queue: Queue) -> String {
    let mut text = format!("{} on {}", declaration.pass_name(pass), queue.name());
    for u in declaration.uses_of(pass) {
        // Writing to a String cannot fail.
        let _ = write!(text, "\n{}: {}", declaration.resource_name(u.resource), u.access);
    }
    text
}

/// The transients of a heap: from their first to their last pass, over the bytes that they take.
fn memory(ui: &mut Ui, planned: Planned<'_>, heap: u32, step: f32, size: egui::Vec2) {
    let Planned { declaration, plan } = planned;
    let (rect, response) = ui.allocate_exact_size(size, Sense::hover());
    let painter = ui.painter_at(rect);
    painter.rect_filled(rect, 0.0, ui.visuals().extreme_bg_color);
    let scale = rect.height() / plan.heaps[heap as usize].bytes.max(1) as f32;
    for transient in plan.transients.iter().filter(|transient| transient.heap == heap) {
        let &Transient { resource, offset, bytes, .. } = transient;
        let Some(life) = plan.lifetimes[resource as usize] else { continue };
        let place = Rect::from_min_size(
            pos2(rect.left() + step * life.first as f32, rect.top() + scale * offset as f32),
            vec2(step * (life.last + 1 - life.first) as f32 - 1.0, (scale * bytes as f32).max(1.0)),
        );
        let name = declaration.resource_name(resource);
        let (fill, _) = stage_colours(name.split('.').next().unwrap_or_default());
        painter.rect_filled(place, 0.0, fill.gamma_multiply(0.8));
        painter.rect_stroke(place, 0.0, Stroke::new(0.5, Color32::BLACK), StrokeKind::Inside);
        if place.height() > 10.0 && place.width() > 30.0 {
            let at = place.left_center() + vec2(2.0, 0.0);
            let font = FontId::proportional(10.0);
            painter.with_clip_rect(place).text(at, Align2::LEFT_CENTER, &name, font, Color32::BLACK);
        }
        if response.hover_pos().is_some_and(|at| place.contains(at)) {
            let pass = |position: u32| declaration.pass_name(plan.order[position as usize]);
            let (first, last) = (pass(life.first), pass(life.last));
            response.clone().on_hover_text(format!("{name}: {bytes} bytes at {offset}, from {first} to {last}"));
        }
    }
}
