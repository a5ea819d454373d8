//! The keyboard as the panels' text fields take it.
//!
//! bevy_egui gives every key of a window frame the modifiers that hold at the frame's end. At the seven frames a second of a
//! software rasteriser a quick Ctrl-A begins and ends within one frame, and would be typed as an "a".

use bevy::input::ButtonState;
use bevy::input::keyboard::{Key, KeyboardFocusLost, KeyboardInput};
use bevy::prelude::*;
use bevy_egui::egui::{Event, Modifiers};
use bevy_egui::helpers::{bevy_to_egui_key, bevy_to_egui_physical_key};
use bevy_egui::input::EguiInputEvent;
use bevy_egui::{EguiContextSettings, EguiInputSystemSettings, PrimaryEguiContext};

/// The window's context leaves the keyboard to [`write_keys`].
pub fn context_settings() -> EguiContextSettings {
    EguiContextSettings {
        input_system_settings: EguiInputSystemSettings {
            run_write_keyboard_input_messages_system: false,
            ..default()
        },
        ..default()
    }
}

/// Passes on what was typed since the last window frame.
pub fn write_keys(
    mut inputs: MessageReader<KeyboardInput>,
    mut focus_lost: MessageReader<KeyboardFocusLost>,
    mut held: Local<Modifiers>,
    context: Query<Entity, With<PrimaryEguiContext>>,
    mut events: MessageWriter<EguiInputEvent>,
) {
    if focus_lost.read().count() > 0 {
        *held = Modifiers::NONE;
    }
    let typed = typed(&mut held, inputs.read());
    for context in &context {
        events.write_batch((typed.iter().cloned()).map(|event| EguiInputEvent { context, event }));
    }
}

/// What egui is told of keys, each with the modifiers `held` at its own time.
fn typed<'a>(held: &mut Modifiers, inputs: impl Iterator<Item = &'a KeyboardInput>) -> Vec<Event> {
    let mut events = Vec::new();
    for input in inputs {
        let pressed = input.state == ButtonState::Pressed;
        match input.logical_key {
            Key::Shift => held.shift = pressed,
            Key::Alt => held.alt = pressed,
            Key::Control => {
                held.ctrl = pressed;
                held.command = pressed && !cfg!(target_os = "macos");
            }
            Key::Super | Key::Meta if cfg!(target_os = "macos") => {
                (held.mac_cmd, held.command) = (pressed, pressed);
            }
            _ => {}
        }
        // Control and Alt together are AltGr, which writes.
        if pressed && (!held.command && !held.ctrl || held.ctrl && held.alt) {
            match &input.logical_key {
                Key::Character(text) if !text.chars().any(char::is_control) => {
                    events.push(Event::Text(text.to_string()));
                }
                Key::Space => events.push(Event::Text(" ".into())),
                _ => {}
            }
        }
        let physical_key = bevy_to_egui_physical_key(&input.key_code);
        // Where a layout has no Latin letters the place of the key tells.
        if let Some(key) = bevy_to_egui_key(&input.logical_key).or(physical_key) {
            events.push(Event::Key {
                key,
                pressed,
                repeat: input.repeat,
                modifiers: *held,
                physical_key,
            });
        }
    }
    events
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy_egui::egui;

    fn key(key_code: KeyCode, logical_key: Key, state: ButtonState) -> KeyboardInput {
        KeyboardInput {
            key_code,
            logical_key,
            state,
            text: None,
            repeat: false,
            window: Entity::PLACEHOLDER,
        }
    }

    #[test]
    fn a_quick_control_a_is_no_letter() {
        let control = |state| key(KeyCode::ControlLeft, Key::Control, state);
        let a = |state| key(KeyCode::KeyA, Key::Character("a".into()), state);
        let (down, up) = (ButtonState::Pressed, ButtonState::Released);
        let mut held = Modifiers::NONE;
        // All of it within one frame, and a plain letter after it.
        let inputs = [control(down), a(down), a(up), control(up), a(down)];
        let events = typed(&mut held, inputs.iter());
        let letters = |event: &&Event| matches!(event, Event::Text(text) if text == "a");
        assert_eq!(events.iter().filter(letters).count(), 1);
        let selects = events.iter().find_map(|event| match event {
            Event::Key {
                key: egui::Key::A,
                pressed: true,
                modifiers,
                ..
            } => Some(*modifiers),
            _ => None,
        });
        assert!(
            selects.is_some_and(|modifiers| modifiers.command),
            "{events:?}"
        );
        assert_eq!(held, Modifiers::NONE);
    }

    #[test]
    fn an_editor_selects_all_of_its_text() {
        let mut held = Modifiers::NONE;
        let down = ButtonState::Pressed;
        let inputs = [
            key(KeyCode::ControlLeft, Key::Control, down),
            key(KeyCode::KeyA, Key::Character("a".into()), down),
            key(
                KeyCode::KeyA,
                Key::Character("a".into()),
                ButtonState::Released,
            ),
            key(KeyCode::ControlLeft, Key::Control, ButtonState::Released),
            key(KeyCode::Digit7, Key::Character("7".into()), down),
        ];
        let ctx = egui::Context::default();
        let mut text = String::from("1234");
        let mut show = |events: Vec<Event>| {
            let input = egui::RawInput {
                events,
                ..default()
            };
            let _ = ctx.run_ui(input, |ui| {
                ui.text_edit_singleline(&mut text).request_focus();
            });
        };
        // The first frame gives it the focus.
        show(Vec::new());
        show(Vec::new());
        show(typed(&mut held, inputs.iter()));
        assert_eq!(text, "7");
    }
}
