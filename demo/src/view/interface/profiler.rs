//! The panel of times: frames, queues, and a table of passes.

use std::path::Path;

use egui::{Align2, Color32, FontId, Grid, Rect, ScrollArea, Sense, Stroke, StrokeKind, Ui, pos2, vec2};
use magpie::measure::{FrameSample, PassReport, Report, Spread};

use super::{Action, Model, inspect::click};
use crate::view::action::free_names;

/// Frames and statistics that are kept while the panel is frozen.
#[derive(Clone, Debug)]
pub(super) struct Frozen {
    frames: Vec<FrameSample>,
    report: Report,
}

impl Frozen {
    /// The frames, and their statistics.
    pub fn held(&self) -> (&[FrameSample], &Report) {
        (&self.frames, &self.report)
    }
}

/// Time of a frame at 60 frames per second, milliseconds.
const BUDGET_MS: f32 = 1000.0 / 60.0;
/// Height of a bar, points.
const BAR: f32 = 18.0;

pub(super) fn show(
    ui: &mut Ui,
    model: &Model<'_>,
    frozen: &mut Option<Frozen>,
    inspected: Option<&str>,
    actions: &mut Vec<Action>,
) {
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
        ui.menu_button("export", export);
        if let Some(gpu) = report.frame.gpu_ms {
            ui.label(format!("GPU {:.2} ms, 99 % under {:.2} ms", gpu.median, gpu.p99));
        }
        ui.label(format!("CPU {:.2} ms", report.frame.cpu_ms.median));
        let graph = &report.graph;
        ui.label(format!(
            "declare {:.0}, plan {:.0}, bind {:.0}, record {:.0}, submit {:.0}, wait {:.0} us",
            graph.declare_us, graph.plan_us, graph.bind_us, graph.record_us, graph.submit_us, graph.wait_us
        ));
        let [egui, overlay, statistics] = model.costs;
        let about = "CPU time of the panels: egui's layout and letters; making a pass of them; keeping frames and their statistics";
        ui.label(format!("panels {egui:.2} + {overlay:.2} + {statistics:.2} ms")).on_hover_text(about);
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
    ScrollArea::both().auto_shrink(false).show(ui, |ui| {
        if let Some(pass) = passes(ui, frames, report, inspected) {
            actions.push(click(model, inspected, &pass));
        }
    });
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
    if most > BUDGET_MS {
        let height = rect.bottom() - (rect.height() - 2.0) * BUDGET_MS / most;
        painter.hline(rect.x_range(), height, Stroke::new(1.0, ui.visuals().warn_fg_color));
    }
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

/// Heads of the table.
const HEADS: [&str; 8] = ["pass", "now ms", "median", "99 %", "share", "rays", "draws", "KiB"];

/// The table: what each pass takes now, and over the frames. Returns a pass that was clicked.
fn passes(ui: &mut Ui, frames: &[FrameSample], report: &Report, inspected: Option<&str>) -> Option<String> {
    let mut clicked = None;
    Grid::new("passes").striped(true).num_columns(HEADS.len()).show(ui, |ui| {
        for head in HEADS {
            ui.strong(head);
        }
        ui.end_row();
        for [name, numbers @ ..] in rows(frames, report) {
            let label = ui.selectable_label(inspected == Some(&*name), &name);
            if label.on_hover_text("Shows its output images").clicked() {
                clicked = Some(name);
            }
            for number in numbers {
                ui.monospace(number);
            }
            ui.end_row();
        }
    });
    clicked
}

/// The cells of the table, as they are shown. The numbers are those of the report, which `--timings` writes.
fn rows(frames: &[FrameSample], report: &Report) -> Vec<[String; HEADS.len()]> {
    let total: f64 = report.passes.iter().filter_map(|p| Some(p.gpu_ms?.median)).sum();
    let some = |count: u64| if count > 0 { count.to_string() } else { String::new() };
    let row = |pass: &PassReport| {
        let PassReport { name, gpu_ms, rays, draws, bytes, .. } = pass;
        let now = frames.last().and_then(|f| f.passes.iter().find(|p| p.name == *name)).and_then(|p| p.gpu_ns);
        let Spread { median, p99, .. } = gpu_ms.unwrap_or_default();
        [
            name.clone(),
            now.map_or_else(|| "-".to_owned(), |ns| format!("{:8.3}", ns as f64 / 1e6)),
            format!("{median:8.3}"),
            format!("{p99:8.3}"),
            format!("{:5.1} %", if total > 0.0 { 100.0 * median / total } else { 0.0 }),
            some(rays.total()),
            some(*draws),
            (bytes / 1024).to_string(),
        ]
    };
    report.passes.iter().map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use magpie::{
        config::Config,
        measure::{Device, PassTime, Recorder, Run},
    };

    /// What the panel shows of the newest frames is what `--timings` writes of the same.
    #[test]
    fn numbers_are_those_of_timings() {
        let (mut shown, mut all) = (Recorder::of_newest(120), Recorder::new(0));
        for frame in 0..40_u64 {
            let pass = |name: &str, ns: u64, draws: u32| PassTime {
                name: name.to_owned(),
                stage: name.split('.').next().unwrap_or_default().to_owned(),
                gpu_ns: Some(ns),
                rays_closest: 7 * u64::from(draws),
                draws,
                bytes: 5000,
                ..PassTime::default()
            };
            let passes = vec![
                pass("gbuffer.draw", 1_000_000 + 12_345 * (frame * 7 % 40), 3),
                pass("post.tone_map", 250_000 + frame, 0),
            ];
            let sample = FrameSample { passes, gpu_ns: Some(2_000_000 + frame), ..FrameSample::default() };
            shown.push(sample.clone());
            all.push(sample);
        }
        let run = Run {
            magpie: String::new(),
            commit: String::new(),
            device: Device { name: String::new(), driver: String::new(), kind: String::new() },
            rays: String::new(),
            scene: String::new(),
            size: [1, 1],
            config: Config::default(),
        };
        let written = all.report(run.clone()).unwrap();
        let rows = rows(shown.frames(), &shown.report(run).unwrap());
        assert_eq!(rows.len(), written.passes.len());
        let mut shares = 0.0;
        for (row, pass) in rows.iter().zip(&written.passes) {
            let number = |at: usize| row[at].trim().trim_end_matches(" %").parse::<f64>().unwrap();
            let spread = pass.gpu_ms.unwrap();
            assert_eq!(row[0], pass.name);
            assert!((number(2) - spread.median).abs() <= 0.000_5 && spread.median > 0.2, "{row:?} {spread:?}");
            assert!((number(3) - spread.p99).abs() <= 0.000_5 && spread.p99 >= spread.median, "{row:?} {spread:?}");
            let last = shown.frames().last().unwrap().passes.iter().find(|p| p.name == pass.name).unwrap();
            assert!((number(1) - last.gpu_ns.unwrap() as f64 / 1e6).abs() <= 0.000_5, "{row:?}");
            assert_eq!((row[5].parse().unwrap_or(0), row[6].parse().unwrap_or(0)), (pass.rays.total(), pass.draws));
            shares += number(4);
        }
        assert!((shares - 100.0).abs() < 0.2, "{shares}");
    }
}
