//! What a set holds, as the paper's Figure 6 shows it: a page.

use super::coco::{Annotation, Origin, Picture, SceneRecord};
use super::error::DatasetError;
use super::statistics::{SIZES, Statistics, columns, long_px, named};
use crate::media::image::jpeg_of;
use crate::report::page::{Head, data_url, note, page as whole_page, table, tiles};
use boresight_common::palette;
use image::imageops;
use maud::{Markup, html};
use std::collections::BTreeMap;
use std::path::Path;

/// Bins of a distribution, and of a side of a map.
const BINS: usize = 40;
/// Pictures of the contact sheet.
const SHEET: usize = 24;
/// The variables of the maps: centre and size of a box over the picture's.
const AXES: [&str; 4] = ["x", "y", "width", "height"];

/// The page of a set in `out`: `statistics.html`'s text.
pub fn page(
    records: &[&SceneRecord],
    out: &Path,
    description: &str,
) -> Result<String, DatasetError> {
    let head = Head {
        title: "Boresight: dataset",
        heading: "A set of annotated pictures",
        facts: &[(description, ""), ("Version", crate::VERSION)],
        ..Head::default()
    };
    let sources = sources(records);
    let sheet = sheet(&sources, out)?;
    Ok(whole_page(&head, &body(&sources, &sheet)))
}

/// The scenes of one source.
struct Source<'a> {
    /// What its figures are called; nothing where it is the only one.
    name: &'static str,
    statistics: Statistics,
    columns: [Vec<f64>; 4],
    scenes: usize,
    records: Vec<&'a SceneRecord>,
}

/// The sources that a set has: simulated, real, or both.
fn sources<'a>(records: &[&'a SceneRecord]) -> Vec<Source<'a>> {
    let split: (Vec<&SceneRecord>, Vec<&SceneRecord>) = records
        .iter()
        .copied()
        .partition(|record| !record.is_real());
    let both = !split.0.is_empty() && !split.1.is_empty();
    let named = [("simulated", split.0), ("real", split.1)];
    (named.into_iter())
        .filter(|(_, records)| !records.is_empty())
        .map(|(name, records)| Source {
            name: if both { name } else { "" },
            statistics: Statistics::of(&records),
            columns: columns(&records),
            scenes: records.len(),
            records,
        })
        .collect()
}

fn body(sources: &[Source], sheet: &[SheetPicture]) -> Markup {
    html! {
        @for source in sources {
            @if !source.name.is_empty() { h2 { (source.name) } }
            (tiles(&summary(&source.statistics, source.scenes)))
        }
        h2 { "Labels" }
        div .charts { (labels(sources)) }
        h2 { "Positions and sizes" }
        div .charts { (positions(sources)) }
        h2 { "Correlations" }
        @for source in sources {
            @if !source.name.is_empty() { h3 { (source.name) } }
            (correlations(&source.statistics))
        }
        (note("x and y are the boxes' centres, all over the picture's width and height."))
        h2 { "Pictures" }
        div .sheet {
            @for shot in sheet { (shot.figure()) }
        }
    }
}

/// The numbers at the top, with their names.
fn summary(all: &Statistics, scenes: usize) -> Vec<(String, String)> {
    let [low, _, median, _, high] = all.long_side_px;
    let mut numbers = vec![
        ("pictures", all.images.to_string()),
        ("UAVs", all.annotations.to_string()),
        ("distractors", all.distractors.to_string()),
        ("boxes not asked for", all.ignored.to_string()),
        ("pictures without a UAV", all.negatives.to_string()),
        ("scenes", scenes.to_string()),
        ("median long side", format!("{median:.1} px")),
        ("5 to 95 %", format!("{low:.1} to {high:.1} px")),
        (
            "commonest, of the width",
            format!("{:.1} %", 100.0 * all.mode_width_share),
        ),
    ];
    if all.range_m[2] > 0.0 {
        numbers.push(("median range", format!("{:.0} m", all.range_m[2])));
    }
    let named = numbers
        .into_iter()
        .map(|(name, value)| (name.to_owned(), value));
    named.collect()
}

/// Names and counts of a chart.
type Counts = Vec<(String, usize)>;
/// A chart's title, and what it counts.
type Chart = (&'static str, fn(&Statistics) -> Counts);

/// What the boxes and pictures are of, as bars, each source's beside the other's.
fn labels(sources: &[Source]) -> Markup {
    fn sizes(counts: &BTreeMap<&'static str, usize>) -> Counts {
        let named = SIZES.map(|(name, _)| (name.to_owned(), counts[name]));
        named.into()
    }
    fn owned<N: ToString>(counts: &BTreeMap<N, usize>) -> Counts {
        counts
            .iter()
            .map(|(name, count)| (name.to_string(), *count))
            .collect()
    }
    let charts: [Chart; 7] = [
        ("boxes by category", |of| owned(&of.categories)),
        ("boxes by model", |of| owned(&of.models)),
        ("distractors by long side", |of| sizes(&of.distractor_sizes)),
        ("UAVs by long side", |of| sizes(&of.sizes)),
        ("pictures by background", |of| owned(&of.backgrounds)),
        ("pictures by motion", |of| owned(&of.motions)),
        ("pictures by light", |of| owned(&of.light)),
    ];
    html! {
        @for (title, counts) in charts {
            @for source in sources {
                @let counts = counts(&source.statistics);
                @if !counts.is_empty() { (bars(&of_source(title, source), &counts)) }
            }
        }
    }
}

/// A figure's title with its source's name.
fn of_source(title: &str, source: &Source) -> String {
    match source.name {
        "" => title.to_owned(),
        name => format!("{title}, {name}"),
    }
}

/// Where the boxes lie and how large they are, as maps and distributions, each source's beside the other's on the same axes.
fn positions(sources: &[Source]) -> Markup {
    let reaches: Vec<f64> = (AXES.iter().enumerate())
        .map(|(axis, name)| {
            let all = sources.iter().flat_map(|source| &source.columns[axis]);
            reach(name, all.copied())
        })
        .collect();
    let maps = [([0, 1], true), ([2, 3], false)];
    let more = [[0, 2], [0, 3], [1, 2], [1, 3]].map(|axes| (axes, false));
    html! {
        @for (axes, down) in maps {
            @for source in sources { (map(source.name, axes, &source.columns, &reaches, down)) }
        }
        @for (axis, name) in AXES.iter().enumerate() {
            @for source in sources {
                (distribution(&of_source(name, source), &source.columns[axis], reaches[axis]))
            }
        }
        @for (axes, down) in more {
            @for source in sources { (map(source.name, axes, &source.columns, &reaches, down)) }
        }
    }
}

fn correlations(all: &Statistics) -> Markup {
    let head: Vec<&str> = [""].into_iter().chain(AXES).collect();
    let rows: Vec<Vec<String>> = (AXES.iter().zip(all.correlations))
        .map(|(name, row)| {
            let values = row.map(|value| format!("{value:.2}"));
            [(*name).to_owned()].into_iter().chain(values).collect()
        })
        .collect();
    table(&head, &rows)
}

/// A drawing 480 wide below its caption; `label` tells what it is to those who cannot see it.
fn figure(caption: &Markup, label: &str, height: usize, drawing: &Markup) -> Markup {
    html! {
        figure {
            figcaption { (caption) }
            svg viewBox=(format_args!("0 0 480 {height}")) role="img" aria-label=(label) {
                (drawing)
            }
        }
    }
}

/// A number of a drawing, with the one decimal that matters.
fn px(value: f64) -> String {
    format!("{value:.1}")
}

/// Horizontal bars with their counts.
fn bars(title: &str, counts: &[(String, usize)]) -> Markup {
    const ROW: usize = 26;
    let most = counts.iter().map(|(_, n)| *n).max().unwrap_or(0).max(1) as f64;
    let total = counts.iter().map(|(_, n)| *n).sum::<usize>().max(1) as f64;
    let drawing = html! {
        @for (row, (name, count)) in counts.iter().enumerate() {
            @let y = ROW * row + 3;
            @let share = format!("{:.0} %", 100.0 * *count as f64 / total);
            @let length = 250.0 * *count as f64 / most;
            text x="118" y=(y + 15) text-anchor="end" { (name) }
            rect x="125" y=(y) width=(px(length)) height=(ROW - 6) fill="var(--s0)" {}
            text x=(px(132.0 + length)) y=(y + 15) { (count) " (" (share) ")" }
        }
    };
    let height = ROW * counts.len() + 6;
    figure(&html! { b { (title) } }, title, height, &drawing)
}

/// How far a value's axis reaches: positions over the whole picture, sizes as far as there are any.
fn reach(name: &str, values: impl Iterator<Item = f64>) -> f64 {
    match name {
        "x" | "y" => 1.0,
        _ => values.fold(0.01, f64::max),
    }
}

fn bin(value: f64, reach: f64) -> usize {
    ((value / reach * BINS as f64) as usize).min(BINS - 1)
}

/// A distribution as columns, over an axis from 0 to `reach`.
fn distribution(name: &str, values: &[f64], reach: f64) -> Markup {
    const STEP: f64 = 440.0 / BINS as f64;
    let mut counts = [0usize; BINS];
    for value in values {
        counts[bin(*value, reach)] += 1;
    }
    let most = counts.iter().max().copied().unwrap_or(0).max(1) as f64;
    let drawing = html! {
        @for (i, count) in counts.iter().enumerate().filter(|(_, n)| **n > 0) {
            @let height = 145.0 * *count as f64 / most;
            rect x=(px(20.0 + STEP * i as f64)) y=(px(155.0 - height))
                width=(px(STEP - 1.0)) height=(px(height)) fill="var(--s0)" {}
        }
        @for share in [0.0, 0.25, 0.5, 0.75, 1.0] {
            text x=(px(20.0 + 440.0 * share)) y="172" text-anchor="middle" {
                (format_args!("{:.2}", reach * share))
            }
        }
    };
    let caption = html! { b { (name) } span .note { "of the boxes, over the picture's" } };
    figure(&caption, &format!("distribution of {name}"), 180, &drawing)
}

/// How often two values of a source come together, each axis up to its `reaches`; `down`: the second grows downward, as a
/// picture's.
fn map(
    source: &str,
    axes: [usize; 2],
    columns: &[Vec<f64>; 4],
    reaches: &[f64],
    down: bool,
) -> Markup {
    const WIDE: f64 = 400.0 / BINS as f64;
    const HIGH: f64 = 320.0 / BINS as f64;
    let ([a, b], values) = (axes.map(|i| AXES[i]), axes.map(|i| &columns[i]));
    let reaches = axes.map(|axis| reaches[axis]);
    let mut counts = vec![0usize; BINS * BINS];
    for (a, b) in values[0].iter().zip(values[1]) {
        counts[bin(*b, reaches[1]) * BINS + bin(*a, reaches[0])] += 1;
    }
    let most = counts.iter().max().copied().unwrap_or(0).max(1) as f64;
    let drawing = html! {
        rect .grid x="60" y="6" width="400" height="320" fill="none" {}
        @for (i, count) in counts.iter().enumerate().filter(|(_, n)| **n > 0) {
            @let row = if down { i / BINS } else { BINS - 1 - i / BINS };
            rect x=(px(60.0 + WIDE * (i % BINS) as f64)) y=(px(6.0 + HIGH * row as f64))
                width=(px(WIDE)) height=(px(HIGH)) fill="var(--s0)"
                fill-opacity=(format_args!("{:.2}", (*count as f64 / most).sqrt())) {}
        }
        @for share in [0.0, 0.5, 1.0] {
            @let up = if down { share } else { 1.0 - share };
            text x=(px(60.0 + 400.0 * share)) y="344" text-anchor="middle" {
                (format_args!("{:.2}", reaches[0] * share))
            }
            text x="54" y=(px(10.0 + 320.0 * up)) text-anchor="end" {
                (format_args!("{:.2}", reaches[1] * share))
            }
        }
    };
    let caption = html! {
        b { (a) " and " (b) @if !source.is_empty() { ", " (source) } }
        span .note { (b) @if down { " downward" } @else { " upward" } }
    };
    figure(&caption, &format!("map of {a} and {b}"), 360, &drawing)
}

/// A picture of the contact sheet.
struct SheetPicture<'a> {
    record: &'a SceneRecord,
    image: &'a Picture,
    jpeg: Vec<u8>,
}

/// Some of the pictures, as many of each source, spread evenly over it.
fn sheet<'a>(sources: &[Source<'a>], out: &Path) -> Result<Vec<SheetPicture<'a>>, DatasetError> {
    let mut sheet = Vec::new();
    for source in sources {
        let images: Vec<(&SceneRecord, &Picture)> = (source.records.iter().copied())
            .flat_map(|record| record.images.iter().map(move |image| (record, image)))
            .collect();
        let count = (SHEET / sources.len()).min(images.len());
        for k in 0..count {
            let (record, image) = images[(2 * k + 1) * images.len() / (2 * count)];
            let path = out.join(record.split.name()).join(&image.file_name);
            sheet.push(SheetPicture {
                record,
                image,
                jpeg: thumbnail(&path)?,
            });
        }
    }
    Ok(sheet)
}

/// A picture of the set at half its size, as JPEG.
fn thumbnail(path: &Path) -> Result<Vec<u8>, DatasetError> {
    let picture = image::open(path).map_err(|source| DatasetError::Picture {
        path: path.to_owned(),
        source,
    })?;
    let (width, height) = (picture.width() / 2, picture.height() / 2);
    let half = imageops::thumbnail(&picture.into_rgb8(), width, height);
    Ok(jpeg_of(&half, 80)?)
}

impl SheetPicture<'_> {
    /// The picture with its boxes.
    fn figure(&self) -> Markup {
        let (width, height) = (self.image.width, self.image.height);
        html! {
            figure {
                svg viewBox=(format_args!("0 0 {width} {height}")) {
                    image width=(width) height=(height) href=(data_url(&self.jpeg)) {}
                    @for seen in &self.image.annotations { (outline(seen)) }
                }
                figcaption { (self.caption()) }
            }
        }
    }

    fn caption(&self) -> String {
        let seen = (self.image.uavs().next()).map_or("no UAV".into(), |seen| {
            let (uav, long_px) = (&seen.model, long_px(seen));
            let range = seen
                .rendered
                .map(|truth| format!(" at {:.0} m", truth.range_m));
            format!("{uav}, {long_px:.0} px{}", range.unwrap_or_default())
        });
        let (split, scene) = (self.record.split.name(), self.record.scene);
        let behind = match &self.record.origin {
            Origin::Rendered(setting) => named(setting.background),
            Origin::Real { clip } => clip.clone(),
        };
        format!("{split} {scene}: {behind}, {seen}")
    }
}

/// A frame around a UAV (orange) or a distractor (blue), somewhat larger than its box; dashed where it is not asked for.
fn outline(seen: &Annotation) -> Markup {
    const MARGIN_PX: f64 = 4.0;
    let [x, y, w, h] = seen.bbox;
    let colour = match seen.class.is_uav() {
        true => palette::hex(palette::BAD),
        false => palette::hex(palette::SECOND),
    };
    html! {
        rect x=(px(x - MARGIN_PX)) y=(px(y - MARGIN_PX))
            width=(px(w + 2.0 * MARGIN_PX)) height=(px(h + 2.0 * MARGIN_PX))
            fill="none" stroke=(colour) stroke-width="2"
            stroke-dasharray=[seen.ignore.then_some("6 4")] {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_are_as_long_as_their_counts() {
        let counts = [("<a>", 1), ("b", 3), ("c", 0)].map(|(name, count)| (name.to_owned(), count));
        let text = bars("letters", &counts).into_string();
        for part in [
            r#"viewBox="0 0 480 84""#,
            "&lt;a&gt;",
            r#"width="83.3""#,
            "1 (25 %)",
            r#"width="250.0""#,
            "3 (75 %)",
            r#"width="0.0""#,
            "0 (0 %)",
        ] {
            assert!(text.contains(part), "{part} is not in {text}");
        }
        let none = bars("letters", &[]).into_string();
        assert!(
            none.contains("0 0 480 6") && !none.contains("<rect"),
            "{none}"
        );
    }

    #[test]
    fn maps_of_places_hang_like_pictures_and_those_of_sizes_stand() {
        let columns = [[0.51, 0.52], [0.01, 0.01], [0.1, 0.2], [0.02, 0.04]].map(Vec::from);
        let reaches = [1.0, 1.0, 0.2, 0.04];
        // Both boxes lie in one cell of the upper row.
        let places = map("", [0, 1], &columns, &reaches, true).into_string();
        assert!(places.contains("y downward") && places.matches("<rect").count() == 2);
        assert!(
            places.contains(r#"x="260.0" y="6.0" width="10.0" height="8.0""#),
            "{places}"
        );
        // The larger box is the upper right end of the axes.
        let sizes = map("", [2, 3], &columns, &reaches, false).into_string();
        assert!(sizes.contains("height upward") && sizes.matches("<rect").count() == 3);
        assert!(sizes.contains(r#"x="450.0" y="6.0""#), "{sizes}");
        assert!(sizes.contains(r#"y="344" text-anchor="middle">0.20</text>"#));
        // A distribution of the same sizes has two columns of full height.
        let widths = distribution(AXES[2], &columns[2], 0.2).into_string();
        assert_eq!(widths.matches(r#"height="145.0""#).count(), 2, "{widths}");
    }
}
