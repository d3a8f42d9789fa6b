//! Events of mouse and keyboard from a file of actions, as if they had come from the window.

use egui::{Event, Key, Modifiers, PointerButton, Pos2, Vec2, pos2};
use serde::{Deserialize, Serialize};

/// One event.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Input {
    /// The pointer goes to a place of the window: 0 to 1, from the left and from above.
    Move([f32; 2]),
    /// A button goes down.
    Press(Button),
    /// A button comes up.
    Release(Button),
    /// The wheel turns by so many notches, away from the user.
    Wheel(f32),
    /// A key is pressed and let go: `W`, `F4`, `Escape`.
    Key(String),
    /// Text is typed.
    Text(String),
}

/// A button of the mouse.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Button {
    /// The left one, unless hands are swapped.
    Primary,
    /// The right one.
    Secondary,
    /// The wheel.
    Middle,
}

/// Where the pointer of such events is.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pointer(Pos2);

impl Pointer {
    /// The same as events of `egui`, in a window of this size in points. Keys that do not exist are nothing.
    pub(super) fn events(&mut self, input: &Input, size: Vec2) -> Vec<Event> {
        let modifiers = Modifiers::default();
        let key = |key, pressed| Event::Key { key, physical_key: None, pressed, repeat: false, modifiers };
        let button = |pos, button: Button, pressed| {
            let button = match button {
                Button::Primary => PointerButton::Primary,
                Button::Secondary => PointerButton::Secondary,
                Button::Middle => PointerButton::Middle,
            };
            Event::PointerButton { pos, button, pressed, modifiers }
        };
        match input {
            Input::Move([x, y]) => {
                self.0 = pos2(x * size.x, y * size.y);
                vec![Event::PointerMoved(self.0)]
            }
            Input::Press(which) => vec![button(self.0, *which, true)],
            Input::Release(which) => vec![button(self.0, *which, false)],
            Input::Wheel(notches) => vec![Event::MouseWheel {
                unit: egui::MouseWheelUnit::Line,
                delta: Vec2::new(0.0, *notches),
                phase: egui::TouchPhase::Move,
                source: egui::MouseWheelSource::Wheel,
                modifiers,
            }],
            Input::Key(name) => {
                Key::from_name(name).map_or_else(Vec::new, |which| vec![key(which, true), key(which, false)])
            }
            Input::Text(text) => vec![Event::Text(text.clone())],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buttons_are_pressed_where_the_pointer_is() {
        let (mut pointer, size) = (Pointer::default(), Vec2::new(200.0, 100.0));
        pointer.events(&Input::Move([0.25, 0.5]), size);
        let [Event::PointerButton { pos, button, pressed: true, .. }] =
            pointer.events(&Input::Press(Button::Middle), size)[..]
        else {
            panic!("no button was pressed")
        };
        assert_eq!((pos, button), (pos2(50.0, 50.0), PointerButton::Middle));
        let keys = |name: &str| pointer.clone().events(&Input::Key(name.to_owned()), size).len();
        assert_eq!((keys("F4"), keys("W"), keys("nothing")), (2, 2, 0));
    }
}
