//! The panel of times: frames, queues, and a table of passes.

use std::path::Path;

use egui::{Align2, Color32, FontId, Grid, Rect, ScrollArea, Sense, Stroke, StrokeKind, Ui, pos2, vec2};
use magpie::measure::{FrameSample, PassReport, Report, Spread};

use super::{Action, Model};
use crate::view::action::free_names;

/// Frames and statistics that are kept while the panel is frozen.
#[derive(Clone, Debug)]
pub(super) struct Frozen {
    frames: Vec<FrameSample>,
    report: Report,
}

/// Height of a bar, points.
const BAR: f32 = 18.0;

pub(super) fn show(ui: &mut Ui, model: &Model<'_>, frozen: &mut Option<Frozen>, actions: &mut Vec<Action>) {
    let held = frozen.clone();
    let (frames, report) = match (&held, model.report) {
        (Some(held), _) => (held.frames.as_slice(), &held.report),
        (None, Some(report)) => (model.frames, report),
        (None, None) => {
            ui.weak("no frame has been measured yet");
            return;
        }
    };
    ui.horizontal_wrapped(|ui| {
        let mut is_frozen = held.is_some();
        if ui.toggle_value(&mut is_frozen, "freeze").on_hover_text("Keeps these numbers while frames go on").changed() {
            *frozen = is_frozen.then(|| Frozen { frames: frames.to_vec(), report: report.clone() });
        }
        let export = |ui: &mut Ui| {
            for (name, ending) in [("JSON", "json"), ("CSV", "csv"), ("Chrome trace", "trace.json")] {
                if ui.button(name).clicked() {
                    actions.extend(free_names(Path::new(""), [ending]).map(|[path]| Action::Export(path)));
                    ui.close();
                }
            }
        };
        ui.add_enabled_ui(held.is_none(), |ui| ui.menu_button("export", export));
        if let Some(gpu) = report.frame.gpu_ms {
            ui.label(format!("GPU {:.2} ms, 99 % under {:.2} ms", gpu.median, gpu.p99));
        }
        ui.label(format!("CPU {:.2} ms", report.frame.cpu_ms.median));
        let graph = &report.graph;
        ui.label(format!(
            "declare {:.0}, plan {:.0}, bind {:.0}, record {:.0}, submit {:.0}, wait {:.0} us",
            graph.declare_us, graph.plan_us, graph.bind_us, graph.record_us, graph.submit_us, graph.wait_us
        ));
        let memory = &report.memory;
        let mebibytes = |bytes: u64| bytes as f64 / f64::from(1 << 20);
        ui.label(format!(
            "transient {:.1}, history {:.1}, scene {:.1}, trees {:.1} MiB",
            mebibytes(memory.transient_bytes),
            mebibytes(memory.history_bytes),
            mebibytes(memory.scene_bytes),
            mebibytes(memory.acceleration_bytes)
        ));
    });
    frame_times(ui, frames);
    if let Some(last) = frames.last() {
        queues(ui, last);
    }
    ScrollArea::both().auto_shrink(false).show(ui, |ui| passes(ui, frames, report));
}

/// The GPU time of each frame as a line.
fn frame_times(ui: &mut Ui, frames: &[FrameSample]) {
    let (rect, response) = ui.allocate_exact_size(vec2(ui.available_width(), 3.0 * BAR), Sense::hover());
    let times: Vec<f32> = frames.iter().filter_map(|f| Some(f.gpu_ns? as f32 / 1e6)).collect();
    let most = times.iter().copied().fold(0.0, f32::max);
    let painter = ui.painter_at(rect);
    painter.rect_filled(rect, 2.0, ui.visuals().extreme_bg_color);
    if most <= 0.0 {
        return;
    }
    let step = rect.width() / (times.len().max(2) - 1) as f32;
    let point = |(at, ms): (usize, &f32)| {
        pos2(rect.left() + at as f32 * step, rect.bottom() - (rect.height() - 2.0) * ms / most)
    };
    let line: Vec<_> = times.iter().enumerate().map(point).collect();
    painter.line(line, Stroke::new(1.5, ui.visuals().selection.bg_fill));
    let text = ui.visuals().weak_text_color();
    painter.text(rect.left_top(), Align2::LEFT_TOP, format!("{most:.2} ms"), FontId::proportional(11.0), text);
    if let Some(at) = response.hover_pos() {
        let index = ((at.x - rect.left()) / step).round() as usize;
        if let Some(ms) = times.get(index) {
            response.on_hover_text(format!("{ms:.2} ms, {} frames ago", times.len() - 1 - index));
        }
    }
}

/// The passes of a frame on lanes of their queues, over time.
fn queues(ui: &mut Ui, frame: &FrameSample) {
    let mut names: Vec<&str> = Vec::new();
    for pass in frame.passes.iter().filter(|p| p.gpu_start_ns.is_some()) {
        if !names.contains(&pass.queue) {
            names.push(pass.queue);
        }
    }
    let total = frame.gpu_ns.unwrap_or(0).max(1) as f32;
    for name in names {
        let (rect, response) = ui.allocate_exact_size(vec2(ui.available_width(), BAR), Sense::hover());
        let painter = ui.painter_at(rect);
        painter.rect_filled(rect, 0.0, ui.visuals().extreme_bg_color);
        let mut under = None;
        for pass in frame.passes.iter().filter(|p| p.queue == name) {
            let (Some(start), Some(time)) = (pass.gpu_start_ns, pass.gpu_ns) else { continue };
            let left = rect.left() + rect.width() * start as f32 / total;
            let width = (rect.width() * time as f32 / total).max(1.0);
            let bar = Rect::from_min_size(pos2(left, rect.top()), vec2(width, BAR));
            let (fill, ink) = stage_colours(&pass.stage);
            painter.rect_filled(bar, 0.0, fill);
            if width > 3.0 {
                painter.rect_stroke(bar, 0.0, Stroke::new(1.0, ui.visuals().panel_fill), StrokeKind::Inside);
            }
            if width > 50.0 {
                let clipped = painter.with_clip_rect(bar);
                let at = bar.left_center() + vec2(3.0, 0.0);
                clipped.text(at, Align2::LEFT_CENTER, &pass.name, FontId::proportional(11.0), ink);
            }
            if response.hover_pos().is_some_and(|at| bar.contains(at)) {
                under = Some(format!("{}: {:.3} ms on {name}", pass.name, time as f64 / 1e6));
            }
        }
        if let Some(text) = under {
            response.on_hover_text(text);
        }
    }
}

/// A colour for each stage, from its name, and one that is readable on it.
pub(super) fn stage_colours(stage: &str) -> (Color32, Color32) {
    let hash = stage.bytes().fold(0x811c_9dc5_u32, |hash, byte| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193));
    let hue = (hash >> 8) as f32 / (1 << 24) as f32;
    (egui::ecolor::Hsva::new(hue, 0.45, 0.75, 1.0).into(), Color32::BLACK)
}

/// The table: what each pass takes now, and over the frames.
fn passes(ui: &mut Ui, frames: &[FrameSample], report: &Report) {
    let total: f64 = report.passes.iter().filter_map(|p| Some(p.gpu_ms?.median)).sum();
    Grid::new("passes").striped(true).num_columns(8).show(ui, |ui| {
        for head in ["pass", "now ms", "median", "99 %", "share", "rays", "draws", "KiB"] {
            ui.strong(head);
        }
        ui.end_row();
        for pass in &report.passes {
            let PassReport { name, gpu_ms, rays, draws, bytes, .. } = pass;
            let now = frames.last().and_then(|f| f.passes.iter().find(|p| p.name == *name)).and_then(|p| p.gpu_ns);
            let Spread { median, p99, .. } = gpu_ms.unwrap_or_default();
            ui.label(name);
            ui.monospace(now.map_or_else(|| "-".to_owned(), |ns| format!("{:8.3}", ns as f64 / 1e6)));
            ui.monospace(format!("{median:8.3}"));
            ui.monospace(format!("{p99:8.3}"));
            ui.monospace(format!("{:5.1} %", if total > 0.0 { 100.0 * median / total } else { 0.0 }));
            ui.monospace(if rays.total() > 0 { rays.total().to_string() } else { String::new() });
            ui.monospace(if *draws > 0 { draws.to_string() } else { String::new() });
            ui.monospace(format!("{}", bytes / 1024));
            ui.end_row();
        }
    });
}
