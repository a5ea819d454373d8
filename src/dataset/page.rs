//! What a set holds, as the paper's Figure 6 shows it: a page.

use super::coco::{Picture, SceneRecord};
use super::error::DatasetError;
use super::statistics::{SIZES, Statistics, columns, long_px, named};
use crate::media::image::encode_jpeg;
use crate::report::page::{Escaped, STYLE};
use base64::{Engine as _, prelude::BASE64_STANDARD};
use image::imageops;
use std::collections::BTreeMap;
use std::fmt::{self, Write as _};
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
    let sheet = sheet(records, out)?;
    let mut page = String::new();
    // Writing to a string cannot fail.
    let _ = html(&mut page, records, &sheet, description);
    Ok(page)
}

fn html(out: &mut String, records: &[&SceneRecord], sheet: &str, description: &str) -> fmt::Result {
    let all = Statistics::of(records);
    writeln!(
        out,
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\n\
         <title>Boresight: dataset</title>\n<style>{STYLE}</style>\n</head>\n<body>\n\
         <header>\n<h1>A set of annotated pictures</h1>\n<p class=\"meta\"><span>{}</span>\
         <span>Version <code>{}</code></span></p>\n</header>\n<dl class=\"tiles\">",
        Escaped(description),
        crate::VERSION
    )?;
    let [low, _, median, _, high] = all.long_side_px;
    for (name, value) in [
        ("pictures", all.images.to_string()),
        ("boxes", all.annotations.to_string()),
        ("pictures without a UAV", all.negatives.to_string()),
        ("scenes", records.len().to_string()),
        ("median long side", format!("{median:.1} px")),
        ("5 to 95 %", format!("{low:.1} to {high:.1} px")),
        (
            "commonest, of the width",
            format!("{:.1} %", 100.0 * all.mode_width_share),
        ),
        ("median range", format!("{:.0} m", all.range_m[2])),
    ] {
        writeln!(out, "<div><dt>{name}</dt><dd>{value}</dd></div>")?;
    }
    out.push_str("</dl>\n<h2>Labels</h2>\n<div class=\"charts\">\n");
    let counted = |map: &BTreeMap<&'static str, usize>| -> Vec<(String, usize)> {
        map.iter().map(|(name, n)| ((*name).into(), *n)).collect()
    };
    let owned = |map: &BTreeMap<String, usize>| -> Vec<(String, usize)> {
        map.iter().map(|(name, n)| (name.clone(), *n)).collect()
    };
    let sizes = SIZES.map(|(name, _)| (name.to_owned(), all.sizes[name]));
    bars(out, "boxes by category", &counted(&all.categories))?;
    bars(out, "boxes by model", &owned(&all.models))?;
    bars(out, "boxes by long side", &sizes)?;
    bars(out, "pictures by background", &owned(&all.backgrounds))?;
    bars(out, "pictures by motion", &owned(&all.motions))?;
    bars(out, "pictures by light", &counted(&all.light))?;
    out.push_str("</div>\n<h2>Positions and sizes</h2>\n<div class=\"charts\">\n");
    let columns = columns(records);
    for (i, j) in [(0, 1), (2, 3)] {
        map(out, [AXES[i], AXES[j]], [&columns[i], &columns[j]], i == 0)?;
    }
    for (name, column) in AXES.iter().zip(&columns) {
        distribution(out, name, column)?;
    }
    for (i, j) in [(0, 2), (0, 3), (1, 2), (1, 3)] {
        map(out, [AXES[i], AXES[j]], [&columns[i], &columns[j]], false)?;
    }
    out.push_str("</div>\n<h2>Correlations</h2>\n<div class=\"scroll\"><table>\n<tr><th></th>");
    for name in AXES {
        write!(out, "<th>{name}</th>")?;
    }
    for (name, row) in AXES.iter().zip(all.correlations) {
        write!(out, "</tr>\n<tr><td>{name}</td>")?;
        for value in row {
            write!(out, "<td class=\"n\">{value:.2}</td>")?;
        }
    }
    out.push_str(
        "</tr>\n</table></div>\n<p class=\"note\">x and y are the boxes' centres, all over the \
         picture's width and height.</p>\n<h2>Pictures</h2>\n",
    );
    writeln!(
        out,
        "<div class=\"sheet\">\n{sheet}</div>\n</body>\n</html>"
    )
}

/// Horizontal bars with their counts.
fn bars(out: &mut String, title: &str, counts: &[(String, usize)]) -> fmt::Result {
    const ROW: usize = 26;
    let most = counts.iter().map(|(_, n)| *n).max().unwrap_or(0).max(1);
    let total = counts.iter().map(|(_, n)| *n).sum::<usize>().max(1);
    let height = ROW * counts.len() + 6;
    writeln!(
        out,
        "<figure><figcaption><b>{title}</b></figcaption>\n\
         <svg viewBox=\"0 0 480 {height}\" role=\"img\" aria-label=\"{title}\">"
    )?;
    for (row, (name, count)) in counts.iter().enumerate() {
        let y = ROW * row + 3;
        let length = 250.0 * *count as f64 / most as f64;
        writeln!(
            out,
            "<text x=\"118\" y=\"{}\" text-anchor=\"end\">{}</text>\
             <rect x=\"125\" y=\"{y}\" width=\"{length:.1}\" height=\"{}\" fill=\"var(--s0)\"/>\
             <text x=\"{:.1}\" y=\"{}\">{count} ({:.0} %)</text>",
            y + 15,
            Escaped(name),
            ROW - 6,
            132.0 + length,
            y + 15,
            100.0 * *count as f64 / total as f64
        )?;
    }
    out.push_str("</svg></figure>\n");
    Ok(())
}

/// How far a value's axis reaches: positions over the whole picture, sizes as far as there are any.
fn reach(name: &str, values: &[f64]) -> f64 {
    match name {
        "x" | "y" => 1.0,
        _ => values.iter().copied().fold(0.01, f64::max),
    }
}

fn bin(value: f64, reach: f64) -> usize {
    ((value / reach * BINS as f64) as usize).min(BINS - 1)
}

/// A distribution as columns.
fn distribution(out: &mut String, name: &str, values: &[f64]) -> fmt::Result {
    let reach = reach(name, values);
    let mut counts = [0usize; BINS];
    for value in values {
        counts[bin(*value, reach)] += 1;
    }
    let most = counts.iter().max().copied().unwrap_or(0).max(1) as f64;
    writeln!(
        out,
        "<figure><figcaption><b>{name} of the boxes, of the picture's</b></figcaption>\n\
         <svg viewBox=\"0 0 480 180\" role=\"img\" aria-label=\"distribution of {name}\">"
    )?;
    let step = 440.0 / BINS as f64;
    for (i, count) in counts.iter().enumerate().filter(|(_, n)| **n > 0) {
        let height = 145.0 * *count as f64 / most;
        writeln!(
            out,
            "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{height:.1}\" fill=\"var(--s0)\"/>",
            20.0 + step * i as f64,
            155.0 - height,
            step - 1.0
        )?;
    }
    for k in 0..=4 {
        let share = f64::from(k) / 4.0;
        writeln!(
            out,
            "<text x=\"{:.1}\" y=\"172\" text-anchor=\"middle\">{:.2}</text>",
            20.0 + 440.0 * share,
            reach * share
        )?;
    }
    out.push_str("</svg></figure>\n");
    Ok(())
}

/// How often two values come together; `down`: the second axis grows downward, as a picture's.
fn map(out: &mut String, names: [&str; 2], values: [&[f64]; 2], down: bool) -> fmt::Result {
    let reaches = [0, 1].map(|i| reach(names[i], values[i]));
    let mut counts = vec![0usize; BINS * BINS];
    for (a, b) in values[0].iter().zip(values[1]) {
        counts[bin(*b, reaches[1]) * BINS + bin(*a, reaches[0])] += 1;
    }
    let most = counts.iter().max().copied().unwrap_or(0).max(1) as f64;
    let [a, b] = names;
    writeln!(
        out,
        "<figure><figcaption><b>{a} and {b}</b><span class=\"note\">{b} {}</span></figcaption>\n\
         <svg viewBox=\"0 0 480 360\" role=\"img\" aria-label=\"map of {a} and {b}\">\
         <rect x=\"60\" y=\"6\" width=\"400\" height=\"320\" fill=\"none\" class=\"grid\"/>",
        if down { "downward" } else { "upward" }
    )?;
    let (wide, high) = (400.0 / BINS as f64, 320.0 / BINS as f64);
    for (i, count) in counts.iter().enumerate().filter(|(_, n)| **n > 0) {
        let (column, row) = (i % BINS, i / BINS);
        let row = if down { row } else { BINS - 1 - row };
        writeln!(
            out,
            "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{wide:.1}\" height=\"{high:.1}\" fill=\"var(--s0)\" \
             fill-opacity=\"{:.2}\"/>",
            60.0 + wide * column as f64,
            6.0 + high * row as f64,
            (*count as f64 / most).sqrt()
        )?;
    }
    for k in 0..=2 {
        let share = f64::from(k) / 2.0;
        let up = if down { share } else { 1.0 - share };
        writeln!(
            out,
            "<text x=\"{:.1}\" y=\"344\" text-anchor=\"middle\">{:.2}</text>\
             <text x=\"54\" y=\"{:.1}\" text-anchor=\"end\">{:.2}</text>",
            60.0 + 400.0 * share,
            reaches[0] * share,
            10.0 + 320.0 * up,
            reaches[1] * share
        )?;
    }
    out.push_str("</svg></figure>\n");
    Ok(())
}

/// Some of the pictures with their boxes, spread evenly over the set.
fn sheet(records: &[&SceneRecord], out: &Path) -> Result<String, DatasetError> {
    let images: Vec<(&SceneRecord, &Picture)> = records
        .iter()
        .flat_map(|record| record.images.iter().map(move |image| (*record, image)))
        .collect();
    let mut sheet = String::new();
    let count = SHEET.min(images.len());
    for k in 0..count {
        let (record, image) = images[(2 * k + 1) * images.len() / (2 * count)];
        let path = out.join(record.split.name()).join(&image.file_name);
        let jpeg = thumbnail(&path)?;
        let (width, height) = (image.width, image.height);
        let _ = writeln!(
            sheet,
            "<figure><svg viewBox=\"0 0 {width} {height}\"><image width=\"{width}\" height=\"{height}\" \
             href=\"data:image/jpeg;base64,{}\"/>",
            BASE64_STANDARD.encode(jpeg)
        );
        for seen in &image.annotations {
            let [x, y, w, h] = seen.bbox;
            const MARGIN_PX: f64 = 4.0;
            let _ = writeln!(
                sheet,
                "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"none\" \
                 stroke=\"#f0883e\" stroke-width=\"2\"/>",
                x - MARGIN_PX,
                y - MARGIN_PX,
                w + 2.0 * MARGIN_PX,
                h + 2.0 * MARGIN_PX
            );
        }
        let seen = image.annotations.first().map_or("no UAV".into(), |seen| {
            format!(
                "{}, {:.0} px at {:.0} m",
                named(seen.uav),
                long_px(seen),
                seen.range_m
            )
        });
        let _ = writeln!(
            sheet,
            "</svg><figcaption>{} {}: {}, {seen}</figcaption></figure>",
            record.split.name(),
            record.scene,
            named(record.background)
        );
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
    Ok(encode_jpeg(&half, width as u16, height as u16, 80)?)
}
