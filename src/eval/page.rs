//! The page and the pictures of an evaluation.

use super::statistics::DWELL_S;
use super::{Evaluation, Manoeuvre, Pointing, Table2, mot};
use crate::app::RunError;
use crate::recording::encode_jpeg;
use crate::report::{Across, Chart, Escaped, MissStats, STYLE, Scale, Series};
use base64::{Engine as _, prelude::BASE64_STANDARD};
use std::fmt::{self, Write as _};
use std::io;
use std::path::Path;

/// Writes `tracking.html` and an SVG file for every chart.
pub fn write(folder: &Path, evaluation: &Evaluation) -> Result<(), RunError> {
    let mut page = String::new();
    let mut pictures = Vec::new();
    html(&mut page, &mut pictures, evaluation)
        .map_err(io::Error::other)
        .map_err(|source| RunError::Output {
            path: folder.into(),
            source,
        })?;
    for (name, svg) in pictures {
        mot::put(&folder.join(name), &svg)?;
    }
    for row in &evaluation.table2 {
        for (name, jpeg) in pictures_of(row)? {
            let path = folder.join(name);
            std::fs::write(&path, jpeg).map_err(|source| RunError::Output { path, source })?;
        }
    }
    mot::put(&folder.join("tracking.html"), &page)
}

/// Name of a row of Table 2 in files.
fn file_stem(row: &Table2) -> String {
    format!(
        "{}-{}-{}-{}",
        row.cameras, row.uav, row.detector, row.controller
    )
}

/// The last pictures of a rendered row, as JPEG.
fn pictures_of(row: &Table2) -> Result<Vec<(String, Vec<u8>)>, RunError> {
    row.pictures
        .iter()
        .map(|frame| {
            let [width, height] = frame.size_px.map(|side| side as u16);
            let jpeg = encode_jpeg(&frame.rgb8, width, height, 90)
                .map_err(|error| RunError::Image(error.to_string()))?;
            Ok((
                format!("{}-{}.jpg", file_stem(row), frame.tier.name()),
                jpeg,
            ))
        })
        .collect()
}

pub(super) fn number(value: Option<f64>, decimals: usize) -> String {
    value.map_or("–".into(), |value| format!("{value:.decimals$}"))
}

/// A table: its head, and rows of cells as text; cells after the first that begin with a digit, a
/// sign or a dash stand right.
pub(super) fn table(out: &mut String, head: &[&str], rows: &[Vec<String>]) -> fmt::Result {
    out.push_str("<div class=\"scroll\"><table>\n<tr>");
    for cell in head {
        write!(out, "<th>{}</th>", Escaped(cell))?;
    }
    out.push_str("</tr>\n");
    for row in rows {
        out.push_str("<tr>");
        for (column, cell) in row.iter().enumerate() {
            let first = cell.chars().next();
            let figure =
                column > 0 && first.is_some_and(|c| c.is_ascii_digit() || "-–".contains(c));
            let class = if figure { " class=\"n\"" } else { "" };
            write!(out, "<td{class}>{}</td>", Escaped(cell))?;
        }
        out.push_str("</tr>\n");
    }
    out.push_str("</table></div>\n");
    Ok(())
}

pub(super) fn note(out: &mut String, text: &str) -> fmt::Result {
    writeln!(out, "<p class=\"note\">{}</p>", Escaped(text))
}

/// The drawing of a chart as a file of its own, with title and key in it.
pub(super) fn standalone(chart: &Chart, figure: &str) -> Option<String> {
    let drawing = &figure[figure.find("<svg")?..figure.find("</svg>")? + 6];
    let (_, body) = drawing.split_once('>')?;
    let style = STYLE.replace(".charts ", "");
    let key = chart.series.iter().enumerate().map(|(i, (name, _))| {
        format!(
            "<tspan dx=\"12\" fill=\"var(--s{i})\">{}</tspan>",
            Escaped(name)
        )
    });
    Some(format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"960\" height=\"500\" \
         viewBox=\"0 -20 480 250\">\n<style>{style}svg{{background:var(--card);\
         font:12px system-ui,sans-serif}}text{{fill:var(--soft)}}</style>\n\
         <text x=\"52\" y=\"-4\">{} [{}]{}</text>{body}\n",
        Escaped(chart.title),
        Escaped(chart.unit),
        key.collect::<String>()
    ))
}

type Pictures = Vec<(String, String)>;

fn html(out: &mut String, pictures: &mut Pictures, evaluation: &Evaluation) -> fmt::Result {
    writeln!(
        out,
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\n\
         <title>Boresight: tracking</title>\n<style>{STYLE}.shots{{display:flex;flex-wrap:wrap;gap:1rem}}\
         .shots img{{image-rendering:pixelated;width:16rem;border-radius:6px}}</style>\n</head>\n<body>\n\
         <header>\n<h1>Acquisition, tracking and pointing</h1>\n<p class=\"meta\">\
         <span>Version <code>{}</code></span><span><code>{}</code></span></p>\n</header>",
        evaluation.version,
        Escaped(&evaluation.command)
    )?;
    targets(out, evaluation)?;
    if !evaluation.table2.is_empty() {
        table2(out, pictures, evaluation)?;
    }
    if !evaluation.precision.is_empty() {
        out.push_str("<h2>Line-of-sight error with a fine detector</h2>\n");
        let rows: Vec<_> = evaluation
            .precision
            .iter()
            .map(|row| [vec![row.controller.into()], pointing(&row.pointing)].concat())
            .collect();
        table(out, &[&["controller"], &POINTING[..]].concat(), &rows)?;
        note(
            out,
            "Truth detector with 0.1 px noise and no misses, default base motion, wind of 2 m/s, 8 m/s straight \
             past 1 km. The error is the angle of the laser's axis from the aim point at every tick, from 1 s after \
             the first precise track on.",
        )?;
    }
    manoeuvre(out, "Weave of 3 m/s²", &evaluation.weave, false)?;
    manoeuvre(out, "Hidden for a second", &evaluation.occlusion, true)?;
    suite(out, evaluation)?;
    search(out, evaluation)?;
    budget(out, evaluation)?;
    out.push_str("<h2>Runs</h2>\n");
    note(
        out,
        "tracking.json names the command and all seeds of every row.",
    )?;
    out.push_str("</body>\n</html>\n");
    Ok(())
}

fn targets(out: &mut String, evaluation: &Evaluation) -> fmt::Result {
    out.push_str("<h2>Targets</h2>\n");
    let rows: Vec<Vec<String>> = evaluation
        .targets
        .iter()
        .map(|target| {
            vec![
                target.name.clone(),
                number(target.value, 3),
                format!("{} {}", target.limit, target.unit),
                match target.met {
                    Some(true) => "met",
                    Some(false) => "missed",
                    None => "not measured",
                }
                .into(),
                target.dominated_by.clone().unwrap_or_default(),
            ]
        })
        .collect();
    table(
        out,
        &["target", "measured", "at most", "", "largest cause"],
        &rows,
    )?;
    for why in &evaluation.not_run {
        note(out, &format!("Not run: {why}"))?;
    }
    Ok(())
}

fn table2(out: &mut String, pictures: &mut Pictures, evaluation: &Evaluation) -> fmt::Result {
    out.push_str("<h2>Table 2: miss distance</h2>\n");
    let stats = |stats: &Option<MissStats>| match stats {
        Some(s) => [s.mean, s.rms, s.p50, s.p95, s.p99]
            .map(|px| number(Some(px), 3))
            .into_iter()
            .chain([s.n.to_string()])
            .collect::<Vec<_>>(),
        None => vec!["–".into(); 6],
    };
    for (tier, camera) in [(1, "Precise"), (0, "Coarse")] {
        writeln!(out, "<h3>{camera} camera [px]</h3>")?;
        let rows: Vec<_> = evaluation
            .table2
            .iter()
            .map(|row| {
                let px = if tier == 1 {
                    &row.precise_px
                } else {
                    &row.coarse_px
                };
                let names = [row.cameras, row.uav, row.detector, row.controller];
                let names = names.map(String::from).to_vec();
                [names, stats(px), vec![number(row.precise_s, 2)]].concat()
            })
            .collect();
        table(
            out,
            &[
                "cameras",
                "UAV",
                "detector",
                "controller",
                "mean",
                "rms",
                "50 %",
                "95 %",
                "99 %",
                "frames",
                "locked [s]",
            ],
            &rows,
        )?;
    }
    note(
        out,
        "Distance of the aim point from the image centre, by truth, in frames in which the tracker claims the \
         target, from the first precise lock on. Fewer frames than asked for: the lock came late or was lost. The \
         detector “truth” has 1 px noise, 5 % misses and 30 ms latency.",
    )?;
    out.push_str("<div class=\"charts\">\n");
    let same =
        |a: &Table2, b: &Table2| (a.cameras, a.uav, a.detector) == (b.cameras, b.uav, b.detector);
    for (index, row) in evaluation.table2.iter().enumerate() {
        if evaluation.table2[..index]
            .iter()
            .any(|other| same(other, row))
        {
            continue;
        }
        for (tier, camera) in [(1, "precise"), (0, "coarse")] {
            let series: Vec<(&str, &Series)> = evaluation
                .table2
                .iter()
                .filter(|other| same(other, row))
                .map(|other| (other.controller, &other.curves[tier]))
                .collect();
            let last = |series: &Series| series.last().map_or(0.0, |(t_s, _)| *t_s);
            let end_s = series.iter().map(|(_, s)| last(s)).fold(0.0, f64::max);
            let title = format!("{}, {}, {}, {camera}", row.uav, row.cameras, row.detector);
            let mut figure = String::new();
            let chart = Chart {
                title: &title,
                unit: "px",
                scale: Scale::Log,
                series: &series,
                limit: None,
            };
            chart.html(&mut figure, &Across::time("simulated time [s]", end_s))?;
            let name = format!("{}-{}-{}-{camera}.svg", row.cameras, row.uav, row.detector);
            pictures.extend(standalone(&chart, &figure).map(|svg| (name, svg)));
            out.push_str(&figure);
        }
    }
    out.push_str("</div>\n<div class=\"shots\">\n");
    for row in &evaluation.table2 {
        // A picture that cannot be encoded fails where the files are written.
        for (name, jpeg) in pictures_of(row).unwrap_or_default() {
            writeln!(
                out,
                "<figure><img alt=\"{name}\" src=\"data:image/jpeg;base64,{}\"><figcaption>{name}</figcaption></figure>",
                BASE64_STANDARD.encode(jpeg)
            )?;
        }
    }
    out.push_str("</div>\n");
    Ok(())
}

const POINTING: [&str; 6] = [
    "rms [µrad]",
    "peak [µrad]",
    "beam rms [µrad]",
    "precise [%]",
    "mirror at stop [%]",
    "time [s]",
];

fn pointing(pointing: &Pointing) -> Vec<String> {
    vec![
        number(pointing.rms_urad, 2),
        number(pointing.peak_urad, 1),
        number(pointing.beam_rms_urad, 2),
        number(Some(100.0 * pointing.precise_share), 2),
        number(Some(100.0 * pointing.saturated_share), 2),
        number(Some(pointing.seconds), 0),
    ]
}

fn manoeuvre(out: &mut String, title: &str, rows: &[Manoeuvre], hides: bool) -> fmt::Result {
    if rows.is_empty() {
        return Ok(());
    }
    writeln!(out, "<h2>{title}</h2>")?;
    let span = |stats: &Option<MissStats>| {
        stats.map_or("–".into(), |s| {
            format!("{:.2} (95 %: {:.2})", s.p50, s.p95)
        })
    };
    let cells: Vec<_> = rows
        .iter()
        .map(|row| {
            let hidden = row.hidden_s;
            let mut cells = vec![row.controller.into(), row.success.text()];
            if hides {
                cells.extend([
                    hidden.map_or("–".into(), |[a, b]| format!("{a:.2}–{b:.2}")),
                    span(&row.reacquired_s),
                    span(&row.precise_again_s),
                ]);
            }
            cells.extend(pointing(&row.pointing));
            cells
        })
        .collect();
    let mut head = vec!["controller", "same identity to the end"];
    if hides {
        head.extend([
            "hidden [s]",
            "seen again after [s]",
            "precise again after [s]",
        ]);
    }
    head.extend(POINTING);
    table(out, &head, &cells)?;
    note(
        out,
        "Truth detector with 1 px noise, 5 % misses and 30 ms latency. Rates with their 95 % Wilson interval over \
         seeds; times count from the instant the line of sight clears, median and 95 % quantile.",
    )
}

fn suite(out: &mut String, evaluation: &Evaluation) -> fmt::Result {
    if evaluation.suite.is_empty() {
        return Ok(());
    }
    out.push_str("<h2>Several targets</h2>\n");
    let rows: Vec<_> = evaluation
        .suite
        .iter()
        .map(|row| {
            vec![
                row.scenario.into(),
                row.rule.into(),
                row.locked.text(),
                row.lost.text(),
                row.failed.text(),
                row.switches.to_string(),
                number(Some(row.false_lock_s), 2),
            ]
        })
        .collect();
    table(
        out,
        &[
            "scenario",
            "rule",
            "runs with a lock",
            "locks lost",
            "runs without a lock that lasts",
            "switches",
            "false lock [s a run]",
        ],
        &rows,
    )?;
    note(
        out,
        &format!(
            "Both rules drive the same controller. The first UAV that stays within 1 mrad of the claimed line of \
             sight for {DWELL_S} s is locked. Its lock is lost when the tracker stays on anything else for {DWELL_S} s, \
             or does not hold it when the run ends. A switch is every change from one thing to another; the false lock \
             time is the time on anything but the UAV locked first. HOTA, IDF1 and identity switches come from \
             TrackEval: python tests/score_mot.py on the folder of this page scores mot/. There, boxes are squares \
             about the aim point of the larger side, at least {} px, one frame for each tick of the coarse camera's \
             clock from the first coarse track on. The set “all” has all UAVs in the field against the confirmed \
             tracks (the paper's rule knows one), the set “lock” the UAV locked first against the locked object.",
            mot::MIN_SIDE_PX
        ),
    )
}

fn search(out: &mut String, evaluation: &Evaluation) -> fmt::Result {
    if evaluation.search.is_empty() {
        return Ok(());
    }
    out.push_str("<h2>Search</h2>\n");
    let rows: Vec<_> = evaluation
        .search
        .iter()
        .map(|row| {
            let time = |pick: fn(&MissStats) -> f64| number(row.time_s.as_ref().map(pick), 2);
            vec![
                row.pattern.into(),
                row.acquired.text(),
                row.wrong.to_string(),
                time(|s| s.mean),
                time(|s| s.p50),
                time(|s| s.p95),
                number(Some(row.limit_s), 0),
            ]
        })
        .collect();
    table(
        out,
        &[
            "pattern",
            "acquired",
            "first on something else",
            "mean [s]",
            "50 % [s]",
            "95 % [s]",
            "within [s]",
        ],
        &rows,
    )?;
    note(
        out,
        "One UAV 1 km away, anywhere within 50° of azimuth and 3° to 9° of elevation, across the line of sight at \
         8 m/s; times of those acquired.",
    )
}

fn budget(out: &mut String, evaluation: &Evaluation) -> fmt::Result {
    if evaluation.budget.is_empty() {
        return Ok(());
    }
    out.push_str("<h2>Jitter budget</h2>\n");
    for budget in &evaluation.budget {
        writeln!(
            out,
            "<h3>{} controller, {} detector: {} µrad rms</h3>",
            budget.controller,
            budget.detector,
            number(budget.all.rms_urad, 2)
        )?;
        let mut rows: Vec<_> = budget
            .causes
            .iter()
            .map(|cause| {
                vec![
                    cause.name.into(),
                    number(cause.without_urad, 2),
                    number(cause.removed_urad, 2),
                    number(cause.only_urad, 2),
                ]
            })
            .collect();
        let lone = |name: &str, urad: Option<f64>| {
            vec![
                name.to_string(),
                String::new(),
                number(urad, 2),
                String::new(),
            ]
        };
        rows.extend([
            lone("not accounted for", budget.residual_urad),
            lone("left with all of these off", budget.none_urad),
            lone(
                "atmosphere and director jitter, on the beam only",
                budget.beam_urad,
            ),
        ]);
        table(
            out,
            &[
                "cause",
                "without it [µrad]",
                "goes with it [µrad]",
                "it alone [µrad]",
            ],
            &rows,
        )?;
    }
    note(
        out,
        "Root mean squares over seeds, settled. “Goes with it” is the root of the variance that vanishes when the cause \
         is switched off; a minus sign: the error grows. Causes act together, so that their variances need not add up.",
    )
}
