//! The time line below a playback: states, shots, events and figures over time, and where time stands.

use super::style::{
    GREY, RED, keep_above, line_colour, panel_frame, screen_ui, source_colour, state_colour,
};
use crate::components::view::{Curve, Pacing, PlayStep, Playback};
use bevy::prelude::*;
use bevy_egui::EguiContexts;
use bevy_egui::egui::{
    self, Align2, Color32, FontId, Painter, Pos2, Rect, Sense, Stroke, pos2, vec2,
};

const BAND_HEIGHT: f32 = 13.0;
const PLOT_HEIGHT: f32 = 46.0;
const GAP: f32 = 3.0;
/// Room for names at the left.
const NAMES_WIDTH: f32 = 110.0;
/// The shortest part of a run that fills the time line [s].
const LEAST_SPAN_S: f64 = 0.05;

/// From time to place.
#[derive(Clone, Copy)]
struct Axis {
    left: f32,
    right: f32,
    span_s: [f64; 2],
}

impl Axis {
    fn x(&self, t_s: f64) -> f32 {
        let [from_s, to_s] = self.span_s;
        let share = (t_s - from_s) / (to_s - from_s);
        self.left + share as f32 * (self.right - self.left)
    }

    fn t_s(&self, x: f32) -> f64 {
        let [from_s, to_s] = self.span_s;
        let share = f64::from((x - self.left) / (self.right - self.left));
        from_s + share.clamp(0.0, 1.0) * (to_s - from_s)
    }

    /// The part of a band between two times that is on the screen.
    fn part(&self, y: f32, [from_s, to_s]: [f64; 2]) -> Option<Rect> {
        let [x0, x1] = [from_s, to_s].map(|t_s| self.x(t_s).clamp(self.left, self.right));
        (x1 > x0).then(|| Rect::from_min_max(pos2(x0, y), pos2(x1, y + BAND_HEIGHT)))
    }
}

/// The span after a turn of the wheel over `at_s` [s]; it stays within the run.
fn zoomed([from_s, to_s]: [f64; 2], at_s: f64, factor: f64, end_s: f64) -> [f64; 2] {
    let length_s = (factor * (to_s - from_s)).clamp(LEAST_SPAN_S.min(end_s), end_s);
    let share = (at_s - from_s) / (to_s - from_s);
    let from_s = (at_s - share * length_s).clamp(0.0, end_s - length_s);
    [from_s, from_s + length_s]
}

/// Buttons, bands and curves.
pub fn draw_timeline(
    mut contexts: EguiContexts,
    mut pacing: ResMut<Pacing>,
    mut playback: ResMut<Playback>,
) -> Result {
    let ctx = contexts.ctx_mut()?;
    // It takes the whole width, whatever the panels left it before.
    keep_above(ctx, ctx.viewport_rect().bottom());
    let panel = egui::Panel::bottom("timeline")
        .resizable(false)
        .show_separator_line(false)
        .frame(panel_frame().inner_margin(8.0));
    let shown = panel.show(&mut screen_ui(ctx), |ui| {
        buttons(ui, &mut pacing, &mut playback);
        legend(ui, &mut playback.curves);
        let bands: usize = (playback.timelines.iter())
            .map(|timeline| timeline.stations.len())
            .sum();
        let height = bands as f32 * (BAND_HEIGHT + GAP)
            + 16.0
            + shown_curves(&playback).count() as f32 * (PLOT_HEIGHT + GAP);
        let size = vec2(ui.available_width(), height);
        let (area, response) = ui.allocate_exact_size(size, Sense::click_and_drag());
        let end_s = playback.end_s();
        let mut axis = Axis {
            left: area.left() + NAMES_WIDTH,
            right: area.right() - 4.0,
            span_s: playback.span_s,
        };
        if let Some(pointer) = response.interact_pointer_pos()
            && (response.dragged() || response.clicked())
        {
            playback.t_s = axis.t_s(pointer.x);
            pacing.paused = true;
        }
        if let Some(pointer) = response.hover_pos() {
            let wheel = f64::from(ui.input(|input| input.smooth_scroll_delta().y));
            if wheel != 0.0 {
                let factor = (-0.004 * wheel).exp();
                playback.span_s = zoomed(axis.span_s, axis.t_s(pointer.x), factor, end_s);
            }
        }
        if response.double_clicked() {
            playback.span_s = [0.0, end_s];
        }
        axis.span_s = playback.span_s;
        draw(&ui.painter_at(area), area, axis, &playback);
    });
    keep_above(ctx, shown.response.rect.top());
    Ok(())
}

fn buttons(ui: &mut egui::Ui, pacing: &mut Pacing, playback: &mut Playback) {
    let mut playing = false;
    ui.horizontal(|ui| {
        let mut step = |ui: &mut egui::Ui, word: &str, hint: &str, step, forwards| {
            if ui.button(word).on_hover_text(hint).clicked() {
                playback.step = Some((step, forwards));
            }
        };
        step(ui, "⏮", "to the beginning (Home)", PlayStep::End, false);
        step(
            ui,
            "- event",
            "event before (Page up)",
            PlayStep::Event,
            false,
        );
        step(
            ui,
            "- frame",
            "picture before (left)",
            PlayStep::Frame,
            false,
        );
        step(ui, "- tick", "tick before (comma)", PlayStep::Tick, false);
        let word = if pacing.paused {
            "▶ play"
        } else {
            "⏸ pause"
        };
        if ui.button(word).on_hover_text("space").clicked() {
            playing = true;
        }
        step(ui, "+ tick", "next tick (full stop)", PlayStep::Tick, true);
        step(ui, "+ frame", "next picture (right)", PlayStep::Frame, true);
        step(
            ui,
            "+ event",
            "next event (Page down)",
            PlayStep::Event,
            true,
        );
        step(ui, "⏭", "to the end (End)", PlayStep::End, true);
        if playing {
            playback.toggle(pacing);
        }
        ui.checkbox(&mut playback.backwards, "backwards")
            .on_hover_text("R");
        let slider = egui::Slider::new(&mut pacing.speed, 0.01..=100.0)
            .logarithmic(true)
            .suffix("×");
        ui.add(slider).on_hover_text("speed: [ and ]");
        let at = format!("{:.4} of {:.2} s", playback.t_s, playback.end_s());
        ui.monospace(at);
    });
}

/// The names of all lines in their colours; the user chooses which are plotted.
fn legend(ui: &mut egui::Ui, curves: &mut [Curve]) {
    ui.horizontal_wrapped(|ui| {
        for curve in curves {
            ui.colored_label(GREY, curve.title);
            for line in &mut curve.lines {
                let colour = line_colour(line.source, line.number);
                let name = egui::RichText::new(&line.name).color(colour);
                ui.checkbox(&mut line.shown, name);
            }
            ui.add_space(10.0);
        }
    });
}

/// The curves of which the user wants a line.
fn shown_curves(playback: &Playback) -> impl Iterator<Item = &Curve> {
    playback.curves.iter().filter(|curve| curve.shown())
}

fn draw(painter: &Painter, area: Rect, axis: Axis, playback: &Playback) {
    let mut y = area.top() + GAP;
    let small = FontId::proportional(11.0);
    let name = |y: f32, text: &str, colour: Color32| {
        let at = pos2(area.left(), y);
        painter.text(at, Align2::LEFT_TOP, text, small.clone(), colour);
    };
    for (source, timeline) in playback.timelines.iter().enumerate() {
        for station in &timeline.stations {
            name(y, &station.name, source_colour(source));
            bands(painter, axis, y, timeline, station);
            y += BAND_HEIGHT + GAP;
        }
    }
    for t_s in &playback.events_s {
        let x = axis.x(*t_s);
        if (axis.left..=axis.right).contains(&x) {
            let mark = [pos2(x, y), pos2(x, y + 5.0)];
            painter.line_segment(mark, Stroke::new(1.0, GREY));
        }
    }
    name(y, "events", GREY);
    for t_s in round_times(axis.span_s) {
        let at = pos2(axis.x(t_s), y + 5.0);
        let text = format!("{t_s:.10}");
        let text = text.trim_end_matches('0').trim_end_matches('.');
        painter.text(at, Align2::CENTER_TOP, text, small.clone(), GREY);
    }
    y += 16.0;
    for curve in shown_curves(playback) {
        let plot = Rect::from_min_max(pos2(axis.left, y), pos2(axis.right, y + PLOT_HEIGHT));
        name(y, curve.title, GREY);
        let [low, high] = curve.range.map(|value| format!("{value:.3e}"));
        name(y + 13.0, &tidy(&high), Color32::from_gray(120));
        name(y + PLOT_HEIGHT - 13.0, &tidy(&low), Color32::from_gray(120));
        painter.rect_filled(plot, 0.0, Color32::from_gray(22));
        for line in curve.lines.iter().filter(|line| line.shown) {
            let stroke = Stroke::new(1.0, line_colour(line.source, line.number));
            let line = polyline(curve, &line.points, axis, plot);
            painter.add(egui::Shape::line(line, stroke));
        }
        y += PLOT_HEIGHT + GAP;
    }
    let x = axis.x(playback.t_s);
    if (axis.left..=axis.right).contains(&x) {
        let cursor = [pos2(x, area.top()), pos2(x, area.bottom())];
        painter.line_segment(cursor, Stroke::new(1.5, Color32::WHITE));
    }
}

/// A number of three digits without needless ones.
fn tidy(scientific: &str) -> String {
    scientific
        .parse::<f64>()
        .map_or(scientific.to_owned(), |value| value.to_string())
}

/// States of a station in their colours, and red where it fires.
fn bands(
    painter: &Painter,
    axis: Axis,
    y: f32,
    timeline: &crate::recording::timeline::Timeline,
    station: &crate::recording::timeline::StationTrack,
) {
    let end_s = timeline.t_s(timeline.last_tick);
    let fill = |from_s: f64, to_s: f64, colour: Color32, slim: f32| {
        if let Some(part) = axis.part(y, [from_s, to_s]) {
            painter.rect_filled(part.shrink2(vec2(0.0, slim)), 0.0, colour);
        }
    };
    let states = station.track.entries();
    for run in states.chunk_by(|a, b| a.1.state == b.1.state) {
        let (from, track) = &run[0];
        let last = run[run.len() - 1].0;
        let to_s = station
            .track
            .after(last)
            .map_or(end_s, |next| timeline.t_s(next));
        fill(timeline.t_s(*from), to_s, state_colour(&track.state), 0.0);
    }
    let beams = station.beam.entries();
    for run in beams.chunk_by(|a, b| a.1.firing == b.1.firing) {
        if run[0].1.firing {
            let last = run[run.len() - 1].0;
            let to_s = station
                .beam
                .after(last)
                .map_or(end_s, |next| timeline.t_s(next));
            fill(timeline.t_s(run[0].0), to_s, RED, 3.0);
        }
    }
}

/// Round times within a span, some eight of them [s].
fn round_times([from_s, to_s]: [f64; 2]) -> Vec<f64> {
    let raw_s = (to_s - from_s).max(1e-6) / 8.0;
    let decade_s = 10f64.powf(raw_s.log10().floor());
    let steps = [1.0, 2.0, 5.0, 10.0].map(|n| n * decade_s);
    let step_s = steps
        .into_iter()
        .find(|s| *s >= 0.999 * raw_s)
        .unwrap_or(raw_s);
    // What rounding moved past an end still stands at it.
    const SLACK: f64 = 1e-6;
    let first = (from_s / step_s - SLACK).ceil() as i64;
    let last = (to_s / step_s + SLACK).floor() as i64;
    (first..=last).map(|n| n as f64 * step_s).collect()
}

/// A line through points, thinned to the lowest and highest of each column of the screen.
fn polyline(curve: &Curve, points: &[[f64; 2]], axis: Axis, plot: Rect) -> Vec<Pos2> {
    let scale = |value: f64| if curve.logarithmic { value.ln() } else { value };
    let [low, high] = curve.range.map(scale);
    let at = |[t_s, value]: [f64; 2]| {
        let value = value.clamp(curve.range[0], curve.range[1]);
        let share = ((scale(value) - low) / (high - low)) as f32;
        pos2(axis.x(t_s), plot.bottom() - share * plot.height())
    };
    let from = points.partition_point(|point| point[0] < axis.span_s[0]);
    let to = points.partition_point(|point| point[0] <= axis.span_s[1]);
    let mut line = Vec::new();
    let seen = points[from..to].iter().map(|point| at(*point));
    let seen: Vec<Pos2> = seen.collect();
    for column in seen.chunk_by(|a, b| a.x.floor() == b.x.floor()) {
        let by_height = |a: &&Pos2, b: &&Pos2| a.y.total_cmp(&b.y);
        line.extend(column.first());
        line.extend(column.iter().min_by(by_height));
        line.extend(column.iter().max_by(by_height));
        line.extend(column.last());
    }
    line.dedup();
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zooming_keeps_the_time_under_the_pointer() {
        let span_s = zoomed([0.0, 20.0], 5.0, 0.5, 20.0);
        assert_eq!(span_s, [2.5, 12.5]);
        let axis = |span_s| Axis {
            left: 0.0,
            right: 100.0,
            span_s,
        };
        assert_eq!(axis([0.0, 20.0]).x(5.0), axis(span_s).x(5.0));
        // Out again, and never beyond the run.
        assert_eq!(zoomed(span_s, 5.0, 100.0, 20.0), [0.0, 20.0]);
        let [from_s, to_s] = zoomed(span_s, 5.0, 1e-9, 20.0);
        assert!((to_s - from_s - LEAST_SPAN_S).abs() < 1e-12);
    }

    #[test]
    fn the_axis_is_labelled_at_round_times() {
        assert_eq!(
            round_times([0.0, 8.0]),
            [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]
        );
        let fine = round_times([1.23, 1.31]);
        assert!(fine.len() >= 4 && (fine[0] - 1.23).abs() < 1e-9, "{fine:?}");
    }

    #[test]
    fn a_peak_within_a_column_stays_on_the_plot() {
        let points: Vec<[f64; 2]> = (0..10_000)
            .map(|i| [f64::from(i) * 1e-3, if i == 5_003 { 9.0 } else { 1.0 }])
            .collect();
        let curve = Curve {
            title: "",
            logarithmic: false,
            lines: Vec::new(),
            range: [0.0, 9.0],
        };
        let plot = Rect::from_min_max(pos2(0.0, 0.0), pos2(100.0, 90.0));
        let axis = Axis {
            left: 0.0,
            right: 100.0,
            span_s: [0.0, 10.0],
        };
        let line = polyline(&curve, &points, axis, plot);
        assert!(line.len() < 500, "{}", line.len());
        assert!(line.iter().any(|point| point.y == 0.0));
    }
}
