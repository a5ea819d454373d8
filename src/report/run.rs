//! The page of a run.

use super::ReportError;
use super::chart::{Across, Chart, Scale, Series};
use super::page::{Head, data_url, note, page, table, tiles};
use super::states::{StateSpan, states};
use super::statistics::MissStats;
use super::uavs::{self, Light, UavSummary};
use crate::media::image::encode_jpeg;
use crate::media::labels;
use crate::output;
use maud::{Markup, html};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Room for the images of the contact sheet, before base64; keeps the report below 2 MB.
const IMAGE_BUDGET: usize = 1_100_000; // [byte]

/// Everything that the report shows.
#[derive(Clone, Debug, Default)]
pub struct ReportData {
    /// Heading of the page.
    pub title: String,
    /// Name of the scenario.
    pub scenario: String,
    /// Version of the program.
    pub version: String,
    /// Seed of every random stream.
    pub seed: u64,
    /// Hash of the final state, 16 hexadecimal digits.
    pub state_hash: String,
    /// How the run ended.
    pub outcome: String,
    /// Whether that is what the scenario is for; colours the outcome.
    pub succeeded: bool,
    /// Rows (label, value with unit) of the summary.
    pub summary: Vec<(String, String)>,
    /// What each station did.
    pub stations: Vec<StationReport>,
    /// Sun and daylight.
    pub light: Light,
    /// What became of each UAV.
    pub uavs: Vec<UavSummary>,
    /// The objects that the stations' network knew, each a row: identity, first and last followed, longest gap,
    /// stations that followed it, stations that engaged it.
    pub objects: Vec<[String; 6]>,
    /// Images of the run, in order.
    pub frames: Vec<ContactFrame>,
}

/// What a station did.
#[derive(Clone, Debug, Default)]
pub struct StationReport {
    /// Its name.
    pub name: String,
    /// Miss distance of the coarse camera \[px\].
    pub miss_coarse_px: Series,
    /// Miss distance of the precise camera \[px\].
    pub miss_precise_px: Series,
    /// Irradiance on the target \[W/m^2\].
    pub irradiance_wpm2: Series,
    /// Power in the bucket \[W\].
    pub power_in_bucket_w: Series,
    /// Temperature of the target's skin \[K\].
    pub skin_temperature_k: Series,
    /// Temperature at which the skin fails \[K\].
    pub failure_temperature_k: Option<f64>,
    /// Angle between the line of sight and the target \[urad\].
    pub los_error_urad: Series,
    /// What speaks for the target's being a UAV, as log-odds, by its name.
    pub belief: Vec<(&'static str, Series)>,
    /// States of the acquisition, tracking and pointing machine, in order.
    pub states: Vec<StateSpan>,
}

/// One image of the contact sheet.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ContactFrame {
    /// Name of the camera.
    pub camera: String,
    /// Time of exposure \[s\].
    pub time_s: f64,
    /// Width \[px\].
    pub width: u16,
    /// Height \[px\].
    pub height: u16,
    /// Rows of red, green, blue bytes; they are not part of a record.
    #[serde(skip)]
    pub rgb8: Vec<u8>,
    /// What is marked in it, the least important first.
    pub boxes: Vec<ContactBox>,
    /// Boresight \[px\].
    pub reticle_px: [f64; 2],
    /// What it shows.
    pub caption: String,
}

/// One marked box.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ContactBox {
    /// Text at the box.
    pub label: String,
    /// Box as x0, y0, x1, y1 \[px\].
    pub rect_px: [f64; 4],
    /// Red, green, blue.
    pub colour: [u8; 3],
}

/// Writes the report as one HTML file that loads nothing else.
pub fn write_report(path: &Path, data: &ReportData) -> Result<(), ReportError> {
    let jpegs = encode_frames(&data.frames)?;
    let seed = data.seed.to_string();
    let head = Head {
        title: &data.title,
        heading: &data.title,
        facts: &[
            ("Scenario", &data.scenario),
            ("Seed", &seed),
            ("State hash", &data.state_hash),
            ("Version", &data.version),
        ],
        ..Head::default()
    };
    Ok(output::write(path, page(&head, &body(data, &jpegs)))?)
}

/// The frames as JPEG, of the best quality that fits; the last ones are left out if none does.
fn encode_frames(frames: &[ContactFrame]) -> Result<Vec<Vec<u8>>, ReportError> {
    let mut jpegs = Vec::new();
    for quality in [85, 70, 50, 30] {
        jpegs = frames
            .iter()
            .enumerate()
            .map(|(index, frame)| {
                encode_jpeg(&frame.rgb8, frame.width, frame.height, quality)
                    .map_err(|source| ReportError::Frame { index, source })
            })
            .collect::<Result<_, _>>()?;
        if jpegs.iter().map(Vec::len).sum::<usize>() <= IMAGE_BUDGET {
            return Ok(jpegs);
        }
    }
    let mut room = IMAGE_BUDGET;
    let fitting = jpegs.iter().take_while(|jpeg| {
        let fits = jpeg.len() <= room;
        room = room.saturating_sub(jpeg.len());
        fits
    });
    let count = fitting.count();
    jpegs.truncate(count);
    Ok(jpegs)
}

fn body(data: &ReportData, jpegs: &[Vec<u8>]) -> Markup {
    let end_s = end_of_run_s(data);
    html! {
        p .outcome .good[data.succeeded] { (data.outcome) }
        h2 { "Summary" }
        (tiles(&data.summary))
        @if !data.uavs.is_empty() {
            h2 { "UAVs" }
            (uavs::tables(&data.uavs, &data.light))
        }
        @for station in &data.stations {
            @let heading = |what: &str| match &data.stations[..] {
                [_] => what.to_owned(),
                _ => format!("{}: {what}", station.name),
            };
            h2 { (heading("Miss distance")) }
            (miss_table(station))
            h2 { (heading("Time histories")) }
            (charts(station, end_s))
            h2 { (heading("States")) }
            (states(&station.states, end_s))
        }
        @if !data.objects.is_empty() {
            h2 { "Objects of the network" }
            (table(&OBJECTS, &rows(&data.objects)))
        }
        h2 { "Contact sheet" }
        (contact_sheet(&data.frames, jpegs))
    }
}

/// Columns of the network's objects.
const OBJECTS: [&str; 6] = [
    "object",
    "from",
    "to",
    "longest gap",
    "followed by",
    "engaged by",
];

fn rows(objects: &[[String; 6]]) -> Vec<Vec<String>> {
    objects.iter().map(|row| row.to_vec()).collect()
}

fn charts(data: &StationReport, end_s: f64) -> Markup {
    let chart = |title, unit, scale, series| Chart {
        title,
        unit,
        scale,
        series,
        limit: None,
    };
    let miss = [
        ("coarse", &data.miss_coarse_px),
        ("precise", &data.miss_precise_px),
    ];
    let los = [("", &data.los_error_urad)];
    let irradiance = [("", &data.irradiance_wpm2)];
    let power = [("", &data.power_in_bucket_w)];
    let belief: Vec<_> = (data.belief.iter())
        .map(|(name, series)| (*name, series))
        .collect();
    let skin = [("target", &data.skin_temperature_k)];
    let charts = [
        chart("Miss distance", "px", Scale::Log, &miss[..]),
        chart("Line-of-sight error", "µrad", Scale::Log, &los),
        chart("What speaks for a UAV", "log-odds", Scale::Linear, &belief),
        chart(
            "Mean irradiance within 5 cm",
            "W/m²",
            Scale::Prefixed,
            &irradiance,
        ),
        chart("Power in the bucket", "W", Scale::Prefixed, &power),
        Chart {
            limit: data.failure_temperature_k.map(|k| ("failure", k)),
            ..chart("Hottest of what would fail", "K", Scale::Linear, &skin)
        },
    ];
    let across = Across::from_zero("simulated time [s]", end_s);
    html! {
        div .charts {
            @for chart in &charts { (chart.figure(&across)) }
        }
    }
}

/// Latest time that anything in the report has \[s\].
fn end_of_run_s(data: &ReportData) -> f64 {
    data.stations.iter().map(end_s).fold(0.0, f64::max)
}

/// Latest time that anything of a station has \[s\].
fn end_s(data: &StationReport) -> f64 {
    [
        &data.miss_coarse_px,
        &data.miss_precise_px,
        &data.irradiance_wpm2,
        &data.power_in_bucket_w,
        &data.skin_temperature_k,
        &data.los_error_urad,
    ]
    .into_iter()
    .filter_map(|series| series.last().map(|&(t, _)| t))
    .chain(data.states.last().map(|span| span.t1_s))
    .filter(|t| t.is_finite())
    .fold(0.0, f64::max)
}

fn miss_table(data: &StationReport) -> Markup {
    let rows = [
        ("coarse", &data.miss_coarse_px),
        ("precise", &data.miss_precise_px),
    ]
    .map(|(name, series)| (name, MissStats::of(series.iter().map(|&(_, px)| px))));
    html! {
        div .scroll {
            table {
                tr {
                    th { "Camera" }
                    @for label in ["mean", "rms", "p50", "p95", "p99"] {
                        th .n { (label) " [px]" }
                    }
                    th .n { "samples" }
                }
                @for (name, stats) in &rows {
                    tr {
                        td { (name) }
                        @if let Some(stats) = stats {
                            @for px in [stats.mean, stats.rms, stats.p50, stats.p95, stats.p99] {
                                td .n { (format_args!("{px:.3}")) }
                            }
                            td .n { (stats.n) }
                        } @else {
                            td .n colspan="6" { "no samples" }
                        }
                    }
                }
            }
        }
    }
}

fn contact_sheet(frames: &[ContactFrame], jpegs: &[Vec<u8>]) -> Markup {
    if frames.is_empty() {
        return note("no images");
    }
    html! {
        div .sheet {
            @for (frame, jpeg) in frames.iter().zip(jpegs) { (frame.figure(jpeg)) }
        }
        @if jpegs.len() < frames.len() {
            p .note { (frames.len() - jpegs.len()) " later images left out for size." }
        }
    }
}

impl ContactFrame {
    /// The image, as JPEG, with all that is marked in it, as a figure of a page.
    pub fn figure(&self, jpeg: &[u8]) -> Markup {
        let (w, h) = (self.width, self.height);
        // Everything drawn on an image is sized by it, for images of any size look alike on the sheet.
        let unit = f64::from(w) / 320.0;
        html! {
            figure {
                svg viewBox=(format_args!("0 0 {w} {h}"))
                    font-size=(format_args!("{:.2}", 12.0 * unit))
                    stroke-width=(format_args!("{:.2}", 1.5 * unit))
                {
                    image width=(w) height=(h) href=(data_url(jpeg)) {}
                    path fill="none" stroke="#fff" stroke-opacity=".8"
                        stroke-width=(format_args!("{unit:.2}")) d=(self.reticle(unit)) {}
                    @for (mark, label_px) in self.boxes.iter().zip(self.labels(unit)) {
                        (mark.drawing(unit, label_px))
                    }
                }
                figcaption {
                    b { (self.camera) }
                    span { (format_args!("{:.3} s", self.time_s)) }
                    span .note { (self.caption) }
                }
            }
        }
    }

    /// Four arms about the boresight.
    fn reticle(&self, unit: f64) -> String {
        let [x, y] = self.reticle_px;
        let (near, far) = (5.0 * unit, 14.0 * unit);
        format!(
            "M{:.1} {y:.1}H{:.1}M{:.1} {y:.1}H{:.1}M{x:.1} {:.1}V{:.1}M{x:.1} {:.1}V{:.1}",
            x - far,
            x - near,
            x + near,
            x + far,
            y - far,
            y - near,
            y + near,
            y + far
        )
    }
}

/// Width of a letter of a label, and height of a label, where a picture is 320 px wide [px].
const LABEL_PX: [f64; 2] = [7.0, 13.0];

impl ContactFrame {
    /// Where the labels of the boxes begin, on their base lines [px]; the boxes are the weakest first.
    fn labels(&self, unit: f64) -> Vec<Option<[f64; 2]>> {
        let strongest_first = || self.boxes.iter().rev();
        let boxes: Vec<_> = strongest_first().map(|mark| mark.padded(unit)).collect();
        let [wide, high] = LABEL_PX.map(|px| px * unit);
        let labels_px: Vec<_> = strongest_first()
            .map(|mark| [wide * mark.label.chars().count() as f64, high])
            .collect();
        let size_px = [self.width, self.height].map(f64::from);
        let mut places = labels::place(&boxes, &labels_px, size_px, 2.0 * unit);
        places.reverse();
        let on_line = |[x, y]: [f64; 2]| [x, y + 0.8 * high];
        places.into_iter().map(|place| place.map(on_line)).collect()
    }
}

impl ContactBox {
    /// The box, kept off a target of a few pixels.
    fn padded(&self, unit: f64) -> [f64; 4] {
        let [x0, y0, x1, y1] = self.rect_px;
        let pad = 2.0 * unit;
        [x0 - pad, y0 - pad, x1.max(x0) + pad, y1.max(y0) + pad]
    }

    /// The box with its label, where that has a place.
    fn drawing(&self, unit: f64, label_px: Option<[f64; 2]>) -> Markup {
        let [x0, y0, x1, y1] = self.padded(unit);
        let [r, g, b] = self.colour;
        let colour = format!("rgb({r},{g},{b})");
        html! {
            rect x=(format_args!("{x0:.1}"))
                y=(format_args!("{y0:.1}"))
                width=(format_args!("{:.1}", x1 - x0))
                height=(format_args!("{:.1}", y1 - y0))
                fill="none" stroke=(colour) {}
            @if let Some([x, y]) = label_px.filter(|_| !self.label.is_empty()) {
                text x=(format_args!("{x:.1}")) y=(format_args!("{y:.1}")) fill=(colour) { (self.label) }
            }
        }
    }
}

#[cfg(test)]
mod tests;
