//! Colours, text and panels that overlay and panels share.

use crate::components::flight::UavStatus;
use bevy_egui::egui::{self, Align2, Color32, FontId, Pos2, vec2};

pub const GREEN: Color32 = Color32::from_rgb(60, 220, 150);
pub const AMBER: Color32 = Color32::from_rgb(255, 190, 70);
pub const RED: Color32 = Color32::from_rgb(255, 70, 60);
pub const GREY: Color32 = Color32::from_rgb(165, 170, 180);
pub const DARK: Color32 = Color32::from_rgba_premultiplied(10, 12, 16, 235);
pub fn status_colour(status: UavStatus) -> Color32 {
    match status {
        UavStatus::Flying => AMBER,
        UavStatus::Falling | UavStatus::Down => GREEN,
        UavStatus::Struck | UavStatus::Crashed | UavStatus::Landed => GREY,
    }
}

/// Text with a dark rim, so that it reads over sky and city.
pub fn rimmed(painter: &egui::Painter, at: Pos2, align: Align2, text: &str, colour: Color32) {
    let font = FontId::proportional(13.0);
    for rim in [
        vec2(1.0, 1.0),
        vec2(-1.0, -1.0),
        vec2(1.0, -1.0),
        vec2(-1.0, 1.0),
    ] {
        painter.text(
            at + rim,
            align,
            text,
            font.clone(),
            Color32::from_black_alpha(160),
        );
    }
    painter.text(at, align, text, font, colour);
}

/// The region that panels take their place from.
pub fn screen_ui(ctx: &egui::Context) -> egui::Ui {
    let layer = egui::UiBuilder::new()
        .layer_id(egui::LayerId::background())
        .max_rect(ctx.viewport_rect());
    egui::Ui::new(ctx.clone(), "window".into(), layer)
}

pub fn panel_frame() -> egui::Frame {
    egui::Frame::new().fill(DARK).inner_margin(10.0)
}

/// A row of the panel: name left, value right.
pub fn row(ui: &mut egui::Ui, name: &str, value: String) {
    ui.horizontal(|ui| {
        ui.colored_label(GREY, name);
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            ui.label(egui::RichText::new(value).color(Color32::WHITE));
        });
    });
}

pub fn heading(ui: &mut egui::Ui, text: &str) {
    ui.add_space(8.0);
    ui.label(egui::RichText::new(text).strong().color(AMBER));
}
