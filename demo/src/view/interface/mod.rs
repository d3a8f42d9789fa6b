//! What is seen of the viewer: the picture, and panels about it. It reads the [`Model`] and says what to do by [`Action`]s.

mod graph;
mod inspect;
mod profiler;
mod stages;
mod truth;

use egui::{
    Align, Align2, CentralPanel, Color32, FontId, Frame, Key, Layout, Panel as Side, PointerButton, RichText, Sense,
    Stroke, Ui,
};
use magpie::{
    config::{Catalogue, Config},
    gpu::PresentMode,
    measure::{FrameSample, Report, SlotReport},
};

pub(super) use graph::Planned;
pub(super) use inspect::format_of;

use super::{
    action::{Action, Panel, TruthView},
    meshes::{ERROR, OTHER, PICTURE, TRUTH},
    navigation::{Flight, Navigation},
    remembered::Panels,
    truth::{Measured, TruthState},
};

use crate::session;

/// What the interface shows.
pub(super) struct Model<'a> {
    /// Every slot with its implementations and settings.
    pub catalogue: &'a Catalogue,
    /// The configuration in use, nothing left open.
    pub config: &'a Config,
    /// What runs of the newest finished frame.
    pub slots: &'a [SlotReport],
    /// The newest finished frames, the oldest first.
    pub frames: &'a [FrameSample],
    /// The plan of the newest.
    pub planned: Option<Planned<'a>>,
    /// Statistics of these; `None` before the first.
    pub report: Option<&'a Report>,
    /// Name of the scene.
    pub scene: &'a str,
    /// Names of its cameras.
    pub cameras: &'a [String],
    /// Scenes that were shown before, the newest first.
    pub recent: &'a [String],
    /// How pictures go to the display, and what else it offers.
    pub mode: PresentMode,
    pub modes: &'a [PresentMode],
    pub is_light: bool,
    /// Name of the device.
    pub device: &'a str,
    /// Whether time goes on.
    pub plays: bool,
    /// Whether there is a second configuration.
    pub compares: bool,
    /// Whether the path of the camera is recorded.
    pub records: bool,
    /// The reference, where it is shown.
    pub truth: Option<TruthState>,
    /// What was measured against it from here.
    pub measured: &'a [Measured],
    /// Median CPU time of the panels, milliseconds: of `egui`, of the overlay, of statistics.
    pub costs: [f64; 3],
    /// What goes on beside the frames.
    pub progress: Option<&'a str>,
    /// What went wrong last.
    pub message: Option<&'a str>,
}

/// Which parts are shown, and what was typed into them.
#[derive(Clone, Debug)]
pub(super) struct Interface {
    pub stages: bool,
    pub profiler: bool,
    pub graph: bool,
    pub help: bool,
    /// The reference, and how it is shown.
    pub truth: bool,
    pub truth_view: TruthView,
    /// Everything but the picture.
    pub panels: bool,
    /// How much of the picture shows the configuration that is edited, where there is a second one: 0 to 1, from the left.
    pub split: f32,
    /// What is shown in place of the picture.
    pub inspector: inspect::Inspector,
    frozen: Option<profiler::Frozen>,
}

/// The place of the picture, in points.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    pub rect: egui::Rect,
}

/// Keys, for people.
const KEYS: [(&str, &str); 17] = [
    ("left drag", "look around"),
    ("right drag", "turn about the point ahead"),
    ("middle drag", "move across"),
    ("click", "look at what was clicked, and turn about it"),
    ("wheel", "towards the point ahead, and back"),
    ("W A S D", "fly ahead, left, back, right"),
    ("Q E", "fly down, up"),
    ("shift", "fly faster"),
    ("shift wheel", "change the speed"),
    ("space", "stop time, and let it go on"),
    ("F1", "these keys"),
    ("F2", "hide all panels"),
    ("F3, F4, F7", "hide or show the stages, the profiler, the graph"),
    ("F5", "exchange the two configurations that are compared"),
    ("F6", "record the path of the camera, and end that"),
    ("F8", "show the reference beside the picture, or hide it"),
    ("F12", "write the window to a PNG and the radiance to an EXR"),
];

impl Interface {
    pub(super) fn new(panels: bool, shown: Panels) -> Self {
        Self {
            stages: shown.stages,
            profiler: shown.profiler,
            graph: shown.graph,
            help: false,
            truth: false,
            truth_view: TruthView::default(),
            panels,
            split: 0.5,
            inspector: inspect::Inspector::default(),
            frozen: None,
        }
    }

    /// The panels that will be shown the next time.
    pub(super) fn panels_shown(&self) -> Panels {
        Panels { stages: self.stages, profiler: self.profiler, graph: self.graph }
    }

    /// The frames that the profiler holds, and their statistics.
    pub(super) fn frozen(&self) -> Option<(&[FrameSample], &Report)> {
        self.frozen.as_ref().map(profiler::Frozen::held)
    }

    /// Shows or hides a panel.
    pub(super) fn toggle(&mut self, panel: Panel) {
        let shown = match panel {
            Panel::Stages => &mut self.stages,
            Panel::Profiler => &mut self.profiler,
            Panel::Graph => &mut self.graph,
            Panel::Help => &mut self.help,
        };
        *shown = !*shown;
    }

    /// Shows everything, moves the camera, and adds what is to be done. `seconds` is the time since the last frame.
    pub(super) fn show(
        &mut self,
        ui: &mut Ui,
        model: &Model<'_>,
        navigation: &mut Navigation,
        seconds: f64,
        actions: &mut Vec<Action>,
    ) -> Place {
        self.keys(ui, model, actions);
        if self.panels {
            Side::top("bar").show(ui, |ui| self.bar(ui, model, navigation.speed(), actions));
            if self.profiler {
                Side::bottom("profiler").resizable(true).default_size(220.0).show(ui, |ui| {
                    profiler::show(ui, model, &mut self.frozen, self.inspector.pass(), actions);
                });
            }
            if self.graph {
                Side::bottom("graph")
                    .resizable(true)
                    .default_size(280.0)
                    .min_size(240.0)
                    .show(ui, |ui| graph::show(ui, model, self.inspector.pass(), actions));
            }
            if self.truth {
                Side::right("truth").resizable(true).default_size(300.0).show(ui, |ui| {
                    truth::show(ui, model, &mut self.truth_view, actions);
                });
            }
            if self.stages {
                Side::left("stages").resizable(true).default_size(300.0).show(ui, |ui| {
                    stages::show(ui, model, actions);
                });
            }
            if self.inspector.inspection().is_some() {
                Side::right("inspect").resizable(true).default_size(330.0).show(ui, |ui| {
                    inspect::show(ui, model, &mut self.inspector, actions);
                });
            }
        }
        let truth = model.truth.filter(|truth| truth.samples > 0);
        let beside = match (truth, self.truth_view) {
            (Some(_), TruthView::Split) => Some(Beside { image: TRUTH, names: ["frame", "reference"] }),
            (Some(_), TruthView::Error) => None,
            _ => model.compares.then_some(Beside { image: OTHER, names: ["A", "B"] }),
        };
        let has_map = self.truth_view == TruthView::Error && truth.is_some_and(|truth| truth.has_map);
        let shown = if has_map { ERROR } else { PICTURE };
        let place = CentralPanel::default().frame(Frame::NONE);
        let shown = Shown { image: shown, beside, split: &mut self.split };
        let place = place.show(ui, |ui| picture(ui, shown, &mut self.inspector, navigation, seconds, actions));
        if self.panels {
            notes(ui, place.inner.rect, model);
        }
        if self.help {
            let mut open = true;
            egui::Window::new("Keys").open(&mut open).resizable(false).show(ui.ctx(), |ui| {
                egui::Grid::new("keys").striped(true).show(ui, |ui| {
                    for (key, what) in KEYS {
                        ui.monospace(key);
                        ui.label(what);
                        ui.end_row();
                    }
                });
            });
            self.help = open;
        }
        place.inner
    }

    fn bar(&mut self, ui: &mut Ui, model: &Model<'_>, speed: f64, actions: &mut Vec<Action>) {
        ui.horizontal(|ui| {
            ui.menu_button(model.scene, |ui| scenes(ui, model, actions)).response.on_hover_text("Shows another scene");
            ui.menu_button("display", |ui| display(ui, model, actions));
            if !model.cameras.is_empty() {
                egui::ComboBox::from_id_salt("camera").selected_text("camera").show_ui(ui, |ui| {
                    for name in model.cameras {
                        if ui.selectable_label(false, name).clicked() {
                            actions.push(Action::Camera(name.clone()));
                        }
                    }
                });
            }
            let time = if model.plays { "stop" } else { "play" };
            if ui.button(time).on_hover_text("Stops the time of the scene, or lets it go on (space)").clicked() {
                actions.push(Action::Play(!model.plays));
            }
            let mut compares = model.compares;
            let about = "Shows a second configuration beside this one. It begins as a copy of it";
            if ui.toggle_value(&mut compares, "compare").on_hover_text(about).changed() {
                actions.push(Action::Compare(compares));
            }
            if compares && ui.button("swap").on_hover_text("Exchanges the two, to edit the other one (F5)").clicked() {
                actions.push(Action::Swap);
            }
            let mut records = model.records;
            if ui.toggle_value(&mut records, "record").on_hover_text("Records the path of the camera (F6)").changed() {
                actions.push(Action::ToggleRecording);
            }
            let mut truth = self.truth;
            let about = "Traces the reference while the camera stands still, and measures the picture against it (F8)";
            if ui.toggle_value(&mut truth, "truth").on_hover_text(about).changed() {
                actions.push(Action::Truth(truth));
            }
            ui.toggle_value(&mut self.stages, "stages");
            ui.toggle_value(&mut self.profiler, "profiler");
            ui.toggle_value(&mut self.graph, "graph");
            ui.toggle_value(&mut self.help, "keys");
            ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
                ui.weak(format!("{speed:.2} m/s")).on_hover_text("Speed of flight: shift and the wheel change it");
                ui.add(egui::Label::new(RichText::new(model.device).weak()).truncate());
            });
        });
    }

    fn keys(&mut self, ui: &Ui, model: &Model<'_>, actions: &mut Vec<Action>) {
        let typing = ui.ctx().egui_wants_keyboard_input();
        ui.input(|input| {
            for (key, panel) in
                [(Key::F1, Panel::Help), (Key::F3, Panel::Stages), (Key::F4, Panel::Profiler), (Key::F7, Panel::Graph)]
            {
                if input.key_pressed(key) {
                    actions.push(Action::Panel(panel));
                }
            }
            for (key, action) in [
                (Key::F2, Action::Panels),
                (Key::F5, Action::Swap),
                (Key::F6, Action::ToggleRecording),
                (Key::F8, Action::Truth(!self.truth)),
                (Key::F12, Action::Snapshot),
            ] {
                if input.key_pressed(key) {
                    actions.push(action);
                }
            }
            if input.key_pressed(Key::Space) && !typing {
                actions.push(Action::Play(!model.plays));
            }
        });
    }
}

/// Scenes that can be opened: those that were shown before, and the built-in ones.
fn scenes(ui: &mut Ui, model: &Model<'_>, actions: &mut Vec<Action>) {
    let mut open = |ui: &mut Ui, scene: &str, about: &str| {
        if ui.button(scene).on_hover_text(about).clicked() {
            actions.push(Action::Open(scene.into()));
            ui.close();
        }
    };
    let known = session::scenes();
    for scene in model.recent.iter().filter(|scene| known.iter().all(|(name, _)| name != *scene)) {
        open(ui, scene, "Shown before");
    }
    ui.separator();
    for (scene, about) in known {
        open(ui, &scene, about);
    }
    ui.separator();
    ui.weak("or drop a .gltf, .glb, .hdr, .exr or .toml on the window");
}

/// How all of it looks.
fn display(ui: &mut Ui, model: &Model<'_>, actions: &mut Vec<Action>) {
    for mode in model.modes {
        if ui.radio(*mode == model.mode, mode.name()).on_hover_text(about_mode(*mode)).clicked() {
            actions.push(Action::Present(mode.name().to_owned()));
        }
    }
    ui.separator();
    let mut light = model.is_light;
    if ui.checkbox(&mut light, "light").changed() {
        actions.push(Action::Light(light));
    }
    let mut scale = ui.ctx().zoom_factor();
    let about = "Size of letters and panels (ctrl and +, -, 0)";
    if ui.add(egui::Slider::new(&mut scale, 0.5..=3.0).step_by(0.1).text("size")).on_hover_text(about).drag_stopped() {
        ui.ctx().set_zoom_factor(scale);
    }
}

fn about_mode(mode: PresentMode) -> &'static str {
    match mode {
        PresentMode::Vsync => "Every picture at a refresh of the display: no tearing, no more frames than it shows",
        PresentMode::Newest => "The newest picture at each refresh: no tearing, and frames as fast as they come",
        PresentMode::Immediate => "Pictures at once: they may tear",
    }
}

/// What is shown right of a line, and the names of both sides.
#[derive(Clone, Copy)]
struct Beside {
    image: egui::TextureId,
    names: [&'static str; 2],
}

/// What is shown where the picture is.
struct Shown<'a> {
    image: egui::TextureId,
    beside: Option<Beside>,
    /// The place of the line: 0 to 1, from the left.
    split: &'a mut f32,
}

/// What went wrong and what goes on, over the picture, so that its size does not change.
fn notes(ui: &Ui, rect: egui::Rect, model: &Model<'_>) {
    if model.message.is_none() && model.progress.is_none() {
        return;
    }
    egui::Area::new(egui::Id::unique("notes")).fixed_pos(rect.min).interactable(false).show(ui.ctx(), |ui| {
        Frame::popup(ui.style()).show(ui, |ui| {
            ui.set_max_width((rect.width() - 16.0).max(50.0));
            if let Some(message) = model.message {
                let red = if ui.visuals().dark_mode { Color32::LIGHT_RED } else { Color32::DARK_RED };
                ui.label(RichText::new(message).color(red));
            }
            if let Some(progress) = model.progress {
                ui.label(progress);
            }
        });
    });
}

/// Draws another picture right of a line that can be dragged.
fn show_beside(ui: &mut Ui, rect: egui::Rect, beside: Beside, split: &mut f32) {
    let line_at = |split: f32| rect.left() + split * rect.width();
    let handle = egui::Rect::from_x_y_ranges(line_at(*split) - 4.0..=line_at(*split) + 4.0, rect.y_range());
    let response = ui.interact(handle, ui.scope_id().with("split"), Sense::drag());
    if response.dragged() {
        *split = (*split + response.drag_delta().x / rect.width().max(1.0)).clamp(0.0, 1.0);
    }
    if response.hovered() || response.dragged() {
        ui.ctx().set_cursor_icon(egui::CursorIcon::ResizeHorizontal);
    }
    let at = line_at(*split);
    let right = egui::Rect::from_min_max(egui::pos2(at, rect.top()), rect.max);
    let uv = egui::Rect::from_min_max(egui::pos2(*split, 0.0), egui::pos2(1.0, 1.0));
    let painter = ui.painter_at(rect);
    painter.image(beside.image, right, uv, Color32::WHITE);
    painter.vline(at, rect.y_range(), Stroke::new(1.0, Color32::WHITE));
    let [left, right] = beside.names;
    for (text, place, align) in [(left, -6.0, Align2::RIGHT_TOP), (right, 6.0, Align2::LEFT_TOP)] {
        painter.text(egui::pos2(at + place, rect.top() + 4.0), align, text, FontId::proportional(16.0), Color32::WHITE);
    }
}

/// The picture, and the camera that is moved in it.
fn picture(
    ui: &mut Ui,
    shown: Shown<'_>,
    inspector: &mut inspect::Inspector,
    navigation: &mut Navigation,
    seconds: f64,
    actions: &mut Vec<Action>,
) -> Place {
    let (rect, response) = ui.allocate_exact_size(ui.available_size(), Sense::click_and_drag());
    let whole = egui::Rect::from_min_max(egui::pos2(0.0, 0.0), egui::pos2(1.0, 1.0));
    ui.painter().image(shown.image, rect, whole, Color32::WHITE);
    if let Some(beside) = shown.beside {
        show_beside(ui, rect, beside, shown.split);
    }
    let scale = f64::from(ui.ctx().pixels_per_point());
    let drag = response.drag_delta();
    let drag = [f64::from(drag.x) * scale, f64::from(drag.y) * scale];
    if response.dragged_by(PointerButton::Primary) {
        navigation.look(drag);
    } else if response.dragged_by(PointerButton::Secondary) {
        navigation.orbit(drag);
    } else if response.dragged_by(PointerButton::Middle) {
        navigation.pan(drag, f64::from(rect.height()) * scale);
    }
    let is_inspected = inspector.follow(ui, rect, &response, actions);
    if response.clicked()
        && !is_inspected
        && let Some(at) = response.interact_pointer_pos()
    {
        let at = (at - rect.min) / rect.size();
        actions.push(Action::LookAt([at.x, at.y]));
    }
    if response.hovered() {
        // egui gives the wheel in points, 40 or so per notch.
        let (wheel, shift) = ui.input(|input| (input.smooth_scroll_delta(), input.modifiers.shift));
        let notches = f64::from(if wheel.y == 0.0 { wheel.x } else { wheel.y }) / 40.0;
        if notches != 0.0 {
            if shift { navigation.change_speed(notches) } else { navigation.zoom(notches) }
        }
    }
    if !ui.ctx().egui_wants_keyboard_input() {
        let flight = ui.input(|input| {
            let axis = |more: Key, less: Key| {
                f64::from(u8::from(input.key_down(more))) - f64::from(u8::from(input.key_down(less)))
            };
            Flight {
                right: axis(Key::D, Key::A),
                up: axis(Key::E, Key::Q),
                ahead: axis(Key::W, Key::S),
                hurries: input.modifiers.shift,
            }
        });
        navigation.fly(flight, seconds.min(0.1));
    }
    Place { rect }
}
