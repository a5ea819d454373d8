//! The pages of the evaluation, and its figures as text.

use super::arguments::folder_names;
use super::draw::COLOURS;
use super::figures::{ClipFigures, Evaluation, Figures};
use super::play::{Curves, Played};
use crate::output::columns;
use crate::report::chart::{Across, Chart, Scale, Series};
use crate::report::page::{Head, data_url, note, number, page, percent, table};
use crate::report::states::{StateSpan, states};
use maud::{Markup, html};
use std::fmt::Write as _;

impl Figures {
    /// The figures with their names.
    fn rows(&self) -> Vec<(&'static str, String)> {
        let count = |n: Option<usize>| n.map_or("–".into(), |n| n.to_string());
        vec![
            ("frames", self.frames.to_string()),
            ("detections", self.detections.to_string()),
            ("boxes of UAVs", count(self.boxes)),
            ("recall", number(self.recall, 4)),
            ("recall at an IoU of 0.5", number(self.recall_iou_0_5, 4)),
            (
                "false alarms a frame",
                number(self.false_alarms_per_frame, 4),
            ),
            ("false alarms", count(self.false_alarms)),
            ("further detections in a box", count(self.duplicates)),
            (
                "detector's miss distance: mean / rms / median",
                self.miss_distance_px.detector.to_string(),
            ),
            (
                "tracker's miss distance: mean / rms / median",
                self.miss_distance_px.tracker.to_string(),
            ),
            ("target held", percent(Some(self.locked_share))),
            (
                "a UAV held, of frames with one",
                percent(self.on_target_share),
            ),
            ("something else held", percent(self.false_lock_share)),
            (
                "a track held as a UAV by the recogniser",
                percent(self.held_as_uav_share),
            ),
            (
                "on a UAV, of frames with one",
                percent(self.uav_held_as_uav_share),
            ),
            ("on something else", percent(self.other_held_as_uav_share)),
            ("frames a second, CPU", format!("{:.1}", self.frames_per_s)),
        ]
    }
}

/// Head of the table of clips.
const COLUMNS: [&str; 10] = [
    "clip",
    "frames",
    "recall",
    "false alarms a frame",
    "UAV held",
    "else held",
    "UAV recognised",
    "else taken for one",
    "detector mean [px]",
    "tracker mean [px]",
];

impl Evaluation {
    /// A row for each clip, and one for all.
    fn summary(&self) -> Vec<Vec<String>> {
        let row = |name: String, figures: &Figures| {
            vec![
                name,
                figures.frames.to_string(),
                number(figures.recall, 4),
                number(figures.false_alarms_per_frame, 4),
                percent(figures.on_target_share),
                percent(figures.false_lock_share),
                percent(figures.uav_held_as_uav_share),
                percent(figures.other_held_as_uav_share),
                number(figures.miss_distance_px.detector.mean, 2),
                number(figures.miss_distance_px.tracker.mean, 2),
            ]
        };
        let names = folder_names(
            &self
                .clips
                .iter()
                .map(|c| c.file.clone())
                .collect::<Vec<_>>(),
        );
        let clips = self.clips.iter().zip(names);
        let mut rows: Vec<_> = clips.map(|(clip, name)| row(name, &clip.figures)).collect();
        if rows.len() > 1 {
            let labels = self.by_label.iter();
            rows.extend(labels.map(|(label, of)| row(format!("all with a {label}"), of)));
            rows.push(row("all".into(), &self.figures));
        }
        rows
    }

    /// The figures as lines of text.
    pub fn text(&self) -> String {
        let mut text = String::new();
        if self.clips.len() > 1 {
            text += &columns(&COLUMNS, &self.summary(), 1);
            text.push('\n');
        }
        for (name, value) in self.figures.rows() {
            let _ = writeln!(text, "{name:<48} {value}");
        }
        if let Some(stopped) = &self.stopped {
            let _ = writeln!(text, "{stopped}");
        }
        text
    }
}

/// A page of an evaluation.
fn whole(evaluation: &Evaluation, heading: &str, body: &Markup) -> String {
    let title = format!("Boresight: {heading}");
    let model = evaluation.model.display().to_string();
    let threshold = evaluation.threshold.to_string();
    let boxes = evaluation.boxes_file.as_ref();
    let boxes = boxes.map_or("none".into(), |boxes| boxes.display().to_string());
    let head = Head {
        title: &title,
        heading,
        facts: &[
            ("Model", &model),
            ("Threshold", &threshold),
            ("Truth", &boxes),
            ("Version", evaluation.version),
            ("", &evaluation.command),
            (evaluation.stopped.as_deref().unwrap_or_default(), ""),
        ],
        style: ".sheet img,video{width:100%;display:block;border-radius:6px}",
    };
    page(&head, body)
}

fn figures(figures: &Figures) -> Markup {
    let rows: Vec<Vec<String>> = (figures.rows().into_iter())
        .map(|(name, value)| vec![name.into(), value])
        .collect();
    html! {
        h2 { "Figures" }
        (table(&["figure", "value"], &rows))
        (note(
            "A detection hits when its centre lies in the box of a UAV; one in no such box is a false \
             alarm. Boxes may be loose: the IoU then says little. The target that is held counts as a UAV \
             when the place that the filter gives it lies in the box of one. Miss distances are those of \
             hits, to the centre of the box.",
        ))
    }
}

/// The page of several clips, whose pages are in folders of the given names.
pub(super) fn of_all(evaluation: &Evaluation, names: &[String]) -> String {
    let body = html! {
        h2 { "Clips" }
        (table(&COLUMNS, &evaluation.summary()))
        p {
            "Pages: "
            @for name in names {
                a href=(format_args!("{name}/clip.html")) { (name) } " "
            }
        }
        (figures(&evaluation.figures))
    };
    whole(evaluation, "Clips", &body)
}

/// The page of one clip.
pub(super) fn of_one(evaluation: &Evaluation, name: &str, played: &Played) -> String {
    let clip = &played.clip;
    let body = html! {
        (figures(&clip.figures))
        h2 { "Over time" }
        (charts(&played.curves, evaluation.boxes_file.is_some(), played.end_s))
        h2 { "States of the tracker" }
        (states(&spans(clip, played.end_s), played.end_s))
        h2 { "Confirmed tracks" }
        (tracks(clip))
        h2 { "Pictures" }
        p {
            a href="overlay.mp4" { "overlay.mp4" }
            ", tracks in MOTChallenge's form: "
            a href="tracks.txt" { "tracks.txt" }
        }
        (note(COLOURS))
        div .sheet {
            @for sheet in &played.sheet {
                figure {
                    img alt=(format_args!("frame {}", sheet.frame)) src=(data_url(&sheet.jpeg));
                    figcaption {
                        b { "frame " (sheet.frame) }
                        span { (format_args!("{:.2} s", sheet.t_s)) }
                        span .note { (sheet.caption) }
                    }
                }
            }
        }
    };
    whole(evaluation, name, &body)
}

fn charts(curves: &Curves, known: bool, end_s: f64) -> Markup {
    let across = Across::from_zero("time [s]", end_s);
    let [detector, tracker] = &curves.miss_px;
    let miss = [("detector", detector), ("tracker", tracker)];
    let [on, elsewhere] = &curves.score;
    let both = [("on a UAV", on), ("elsewhere", elsewhere)];
    let one = [("", on)];
    let score: &[(&str, &Series)] = if known { &both } else { &one };
    let chart = |title, unit, series| Chart {
        title,
        unit,
        scale: Scale::Linear,
        series,
        limit: None,
    };
    html! {
        div .charts {
            (chart("Miss distance", "px", &miss[..]).figure(&across))
            (chart("Best score", "1", score).figure(&across))
        }
    }
}

fn spans(clip: &ClipFigures, end_s: f64) -> Vec<StateSpan> {
    let ends = (clip.states.iter().skip(1).map(|state| state.start)).chain([end_s]);
    (clip.states.iter().zip(ends))
        .map(|(state, t1_s)| StateSpan {
            t0_s: state.start,
            t1_s,
            name: state.name.into(),
            reason: state.reason.clone(),
        })
        .collect()
}

fn tracks(clip: &ClipFigures) -> Markup {
    const HEAD: [&str; 8] = [
        "track",
        "from [s]",
        "to [s]",
        "for [s]",
        "frames",
        "score",
        "size [px]",
        "on a UAV",
    ];
    let rows: Vec<Vec<String>> = (clip.tracks.iter())
        .map(|track| {
            vec![
                track.id.to_string(),
                number(Some(track.start), 2),
                number(Some(track.end), 2),
                number(Some(track.length), 2),
                track.frames.to_string(),
                number(Some(track.score), 2),
                number(Some(track.size_px), 1),
                percent(track.on_uav_share),
            ]
        })
        .collect();
    table(&HEAD, &rows)
}
