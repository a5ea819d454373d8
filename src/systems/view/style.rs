//! Colours, text and panels that overlay and panels share.

use crate::components::flight::UavStatus;
use bevy_egui::egui::{self, Align2, Color32, FontId, Pos2, vec2};
use boresight_common::palette;

pub const GREEN: Color32 = of(palette::GOOD);
pub const AMBER: Color32 = of(palette::FLYING);
pub const RED: Color32 = of(palette::BAD);
pub const GREY: Color32 = Color32::from_rgb(165, 170, 180);
pub const DARK: Color32 = Color32::from_rgba_premultiplied(10, 12, 16, 235);

/// A colour of films and pages, too.
const fn of([red, green, blue]: palette::Colour) -> Color32 {
    Color32::from_rgb(red, green, blue)
}

/// Colours of two recordings: marks, names and curves.
pub fn source_colour(source: usize) -> Color32 {
    match source {
        0 => AMBER,
        _ => of(palette::SECOND),
    }
}

/// The colour of a line of a plot, by its recording and its number among that recording's.
pub fn line_colour(source: usize, number: usize) -> Color32 {
    // The first recording's are warm, the second's cold, the first of each the recording's own.
    const LINES: [[[u8; 3]; 6]; 2] = [
        [
            [255, 190, 70],
            [240, 110, 50],
            [205, 225, 90],
            [245, 140, 200],
            [205, 150, 110],
            [255, 240, 170],
        ],
        [
            [86, 180, 233],
            [175, 140, 255],
            [80, 225, 205],
            [205, 215, 255],
            [120, 230, 130],
            [110, 140, 190],
        ],
    ];
    let [r, g, b] = LINES[source.min(1)][number % 6];
    Color32::from_rgb(r, g, b)
}

/// The colour of a tracking state, by its name.
pub fn state_colour(state: &str) -> Color32 {
    match state {
        "engage" => Color32::from_rgb(200, 90, 60),
        "precise" => GREEN,
        "coarse" => Color32::from_rgb(40, 150, 110),
        "acquire" => AMBER,
        "search" => Color32::from_rgb(90, 100, 120),
        _ => Color32::from_rgb(120, 60, 90),
    }
}

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

/// Where egui keeps what the bars at top and bottom leave of the window to the panels between them.
fn room() -> egui::Id {
    egui::Id::new("room between the bars")
}

/// Gives the panels that are drawn after this what lies above a height [points].
pub fn keep_above(ctx: &egui::Context, y: f32) {
    let mut rect = ctx.viewport_rect();
    rect.max.y = y;
    ctx.data_mut(|data| data.insert_temp(room(), rect));
}

/// Keeps them below a height [points] as well.
pub fn keep_below(ctx: &egui::Context, y: f32) {
    let kept: Option<egui::Rect> = ctx.data(|data| data.get_temp(room()));
    let mut rect = kept.unwrap_or(ctx.viewport_rect());
    rect.min.y = y;
    ctx.data_mut(|data| data.insert_temp(room(), rect));
}

/// The region that panels take their place from.
pub fn screen_ui(ctx: &egui::Context) -> egui::Ui {
    let rect = ctx.data(|data| data.get_temp(room()));
    let layer = egui::UiBuilder::new()
        .layer_id(egui::LayerId::background())
        .max_rect(rect.unwrap_or(ctx.viewport_rect()));
    egui::Ui::new(ctx.clone(), "window".into(), layer)
}

/// The panel on the left, in light grey on dark, that scrolls where it is too long.
pub fn left_panel(ctx: &egui::Context, contents: impl FnOnce(&mut egui::Ui)) {
    fixed_panel(ctx, |ui| {
        egui::ScrollArea::vertical().show(ui, contents);
    });
}

/// The same without scrolling.
pub fn fixed_panel(ctx: &egui::Context, contents: impl FnOnce(&mut egui::Ui)) {
    const WIDTH: f32 = 250.0;
    let panel = egui::Panel::left("panel")
        .exact_size(WIDTH)
        .resizable(false)
        .show_separator_line(false)
        .frame(panel_frame());
    panel.show(&mut screen_ui(ctx), |ui| {
        ui.spacing_mut().item_spacing.y = 3.0;
        ui.visuals_mut().override_text_color = Some(Color32::from_gray(200));
        contents(ui);
    });
}

/// A list of a set height [points] that scrolls within it, whatever it holds; whether the pointer is over it.
pub fn list<R>(
    ui: &mut egui::Ui,
    name: &str,
    height: f32,
    contents: impl FnOnce(&mut egui::Ui) -> R,
) -> (R, bool) {
    let shown = egui::ScrollArea::vertical()
        .id_salt(name)
        .max_height(height)
        .min_scrolled_height(height)
        .auto_shrink(false)
        .show(ui, contents);
    let pointed_at = ui.rect_contains_pointer(shown.inner_rect);
    (shown.inner, pointed_at)
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
