//! The page and the pictures of the evaluation.

use super::mot;
use super::results::{Budget, Evaluation, LosFigures, Manoeuvre, Table2};
use crate::eval::EvalError;
use crate::eval::statistics::DWELL_S;
use crate::media::image::{ImageError, encode_jpeg};
use crate::output::put;
use crate::report::chart::{Across, Chart, Scale, Series};
use crate::report::page::{Head, data_url, note, number, page, table};
use crate::report::statistics::MissStats;
use maud::{Markup, html};
use std::path::Path;

const STYLE: &str = ".shots{display:flex;flex-wrap:wrap;gap:1rem}\
    .shots img{image-rendering:pixelated;width:16rem;border-radius:6px}";

/// Writes `tracking.html`, an SVG file for every chart, and the last pictures.
pub(super) fn write(folder: &Path, evaluation: &Evaluation) -> Result<(), EvalError> {
    let charts = Charts::of(&evaluation.table2);
    for (name, svg) in charts.files() {
        put(&folder.join(name), svg)?;
    }
    let mut pictures = Vec::new();
    for row in &evaluation.table2 {
        pictures.extend(pictures_of(row)?);
    }
    for (name, jpeg) in &pictures {
        put(&folder.join(name), jpeg)?;
    }
    let head = Head {
        title: "Boresight: tracking",
        heading: "Acquisition, tracking and pointing",
        facts: &[("Version", evaluation.version), ("", &evaluation.command)],
        style: STYLE,
    };
    let body = body(evaluation, &charts, &pictures);
    Ok(put(&folder.join("tracking.html"), page(&head, &body))?)
}

/// Name of a row of Table 2 in files.
fn file_stem(row: &Table2) -> String {
    format!(
        "{}-{}-{}-{}",
        row.cameras, row.uav, row.detector, row.controller
    )
}

/// The last pictures of a rendered row, as JPEG with their names.
fn pictures_of(row: &Table2) -> Result<Vec<(String, Vec<u8>)>, ImageError> {
    row.pictures
        .iter()
        .map(|frame| {
            let [width, height] = frame.size_px.map(|side| side as u16);
            let jpeg = encode_jpeg(&frame.rgb8, width, height, 90)?;
            Ok((format!("{}-{}.jpg", file_stem(row), frame.camera), jpeg))
        })
        .collect()
}

fn body(evaluation: &Evaluation, charts: &Charts, pictures: &[(String, Vec<u8>)]) -> Markup {
    html! {
        (targets(evaluation))
        @if !evaluation.table2.is_empty() {
            (table2(&evaluation.table2))
            div .charts { (charts.figures()) }
            div .shots {
                @for (name, jpeg) in pictures {
                    figure {
                        img alt=(name) src=(data_url(jpeg));
                        figcaption { (name) }
                    }
                }
            }
        }
        @if !evaluation.precision.is_empty() { (precision(evaluation)) }
        (manoeuvre("Weave of 3 m/s²", &evaluation.weave, false))
        (manoeuvre("Hidden for a second", &evaluation.occlusion, true))
        @if !evaluation.suite.is_empty() { (suite(evaluation)) }
        @if !evaluation.search.is_empty() { (search(evaluation)) }
        @if !evaluation.budget.is_empty() { (budgets(&evaluation.budget)) }
        h2 { "Runs" }
        (note("tracking.json names the command and all seeds of every row."))
    }
}

fn targets(evaluation: &Evaluation) -> Markup {
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
    html! {
        h2 { "Targets" }
        (table(&["target", "measured", "at most", "", "largest cause"], &rows))
        @for why in &evaluation.not_run { (note(&format!("Not run: {why}"))) }
    }
}

fn table2(rows: &[Table2]) -> Markup {
    const HEAD: [&str; 11] = [
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
    ];
    let stats = |stats: &Option<MissStats>| match stats {
        Some(s) => [s.mean, s.rms, s.p50, s.p95, s.p99]
            .map(|px| number(Some(px), 3))
            .into_iter()
            .chain([s.n.to_string()])
            .collect::<Vec<_>>(),
        None => vec!["–".into(); 6],
    };
    let cells = |pick: fn(&Table2) -> &Option<MissStats>| -> Vec<Vec<String>> {
        let cells = rows.iter().map(|row| {
            let names = [row.cameras, row.uav, row.detector, row.controller];
            let names = names.map(String::from).to_vec();
            [names, stats(pick(row)), vec![number(row.precise_s, 2)]].concat()
        });
        cells.collect()
    };
    html! {
        h2 { "Table 2: miss distance" }
        h3 { "Precise camera [px]" }
        (table(&HEAD, &cells(|row| &row.precise_px)))
        h3 { "Coarse camera [px]" }
        (table(&HEAD, &cells(|row| &row.coarse_px)))
        (note(
            "Distance of the aim point from the image centre, by truth, in frames in which the tracker \
             claims the target, from the first precise lock on. Fewer frames than asked for: the lock came \
             late or was lost. The detector “truth” has 1 px noise, 5 % misses and 30 ms latency.",
        ))
    }
}

/// The charts of Table 2: for each UAV, cameras and detector, and for either tracking camera, the
/// controllers over one another.
struct Charts<'a>(Vec<Table2Chart<'a>>);

struct Table2Chart<'a> {
    title: String,
    file: String,
    end_s: f64,
    series: Vec<(&'a str, &'a Series)>,
}

impl<'a> Charts<'a> {
    fn of(rows: &'a [Table2]) -> Self {
        let same = |a: &Table2, b: &Table2| {
            (a.cameras, a.uav, a.detector) == (b.cameras, b.uav, b.detector)
        };
        let mut charts = Vec::new();
        for (index, row) in rows.iter().enumerate() {
            if rows[..index].iter().any(|other| same(other, row)) {
                continue;
            }
            for (tier, camera) in [(1, "precise"), (0, "coarse")] {
                let series: Vec<(&str, &Series)> = (rows.iter())
                    .filter(|other| same(other, row))
                    .map(|other| (other.controller, &other.curves[tier]))
                    .collect();
                let last_s = |series: &Series| series.last().map_or(0.0, |(t_s, _)| *t_s);
                charts.push(Table2Chart {
                    title: format!("{}, {}, {}, {camera}", row.uav, row.cameras, row.detector),
                    file: format!("{}-{}-{}-{camera}.svg", row.cameras, row.uav, row.detector),
                    end_s: series.iter().map(|(_, s)| last_s(s)).fold(0.0, f64::max),
                    series,
                });
            }
        }
        Self(charts)
    }

    fn figures(&self) -> Markup {
        html! {
            @for chart in &self.0 { (chart.chart().figure(&chart.across())) }
        }
    }

    /// Names and texts of the SVG files.
    fn files(&self) -> impl Iterator<Item = (&str, String)> {
        (self.0.iter())
            .filter_map(|chart| Some((&*chart.file, chart.chart().svg_file(&chart.across())?)))
    }
}

impl Table2Chart<'_> {
    fn chart(&self) -> Chart<'_> {
        Chart {
            title: &self.title,
            unit: "px",
            scale: Scale::Log,
            series: &self.series,
            limit: None,
        }
    }

    fn across(&self) -> Across<'static> {
        Across::from_zero("simulated time [s]", self.end_s)
    }
}

const POINTING: [&str; 6] = [
    "rms [µrad]",
    "peak [µrad]",
    "beam rms [µrad]",
    "precise [%]",
    "mirror at stop [%]",
    "time [s]",
];

fn pointing(figures: &LosFigures) -> Vec<String> {
    vec![
        number(figures.rms_urad, 2),
        number(figures.peak_urad, 1),
        number(figures.beam_rms_urad, 2),
        number(Some(100.0 * figures.precise_share), 2),
        number(Some(100.0 * figures.saturated_share), 2),
        number(Some(figures.seconds), 0),
    ]
}

fn precision(evaluation: &Evaluation) -> Markup {
    let rows: Vec<_> = evaluation
        .precision
        .iter()
        .map(|row| [vec![row.controller.into()], pointing(&row.pointing)].concat())
        .collect();
    html! {
        h2 { "Line-of-sight error with a fine detector" }
        (table(&[&["controller"], &POINTING[..]].concat(), &rows))
        (note(
            "Truth detector with 0.1 px noise and no misses, default base motion, wind of 2 m/s, 8 m/s \
             straight past 1 km. The error is the angle of the laser's axis from the aim point at every \
             tick, from 1 s after the first precise track on.",
        ))
    }
}

fn manoeuvre(title: &str, rows: &[Manoeuvre], hides: bool) -> Markup {
    if rows.is_empty() {
        return html! {};
    }
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
    html! {
        h2 { (title) }
        (table(&head, &cells))
        (note(
            "Truth detector with 1 px noise, 5 % misses and 30 ms latency. Rates with their 95 % Wilson \
             interval over seeds; times count from the instant the line of sight clears, median and 95 % \
             quantile.",
        ))
    }
}

fn suite(evaluation: &Evaluation) -> Markup {
    const HEAD: [&str; 7] = [
        "scenario",
        "rule",
        "runs with a lock",
        "locks lost",
        "runs without a lock that lasts",
        "switches",
        "false lock [s a run]",
    ];
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
    let remark = format!(
        "Both rules drive the same controller. The first UAV that stays within 1 mrad of the claimed line of \
         sight for {DWELL_S} s is locked. Its lock is lost when the tracker stays on anything else for {DWELL_S} s, \
         or does not hold it when the run ends. A switch is every change from one thing to another; the false lock \
         time is the time on anything but the UAV locked first. HOTA, IDF1 and identity switches come from \
         TrackEval: python tests/score_mot.py on the folder of this page scores mot/. There, boxes are squares \
         about the aim point of the larger side, at least {} px, one frame for each tick of the coarse camera's \
         clock from the first coarse track on. The set “all” has all UAVs in the field against the confirmed \
         tracks (the paper's rule knows one), the set “lock” the UAV locked first against the locked object.",
        mot::MIN_SIDE_PX
    );
    html! {
        h2 { "Several targets" }
        (table(&HEAD, &rows))
        (note(&remark))
    }
}

fn search(evaluation: &Evaluation) -> Markup {
    const HEAD: [&str; 7] = [
        "pattern",
        "acquired",
        "first on something else",
        "mean [s]",
        "50 % [s]",
        "95 % [s]",
        "within [s]",
    ];
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
    html! {
        h2 { "Search" }
        (table(&HEAD, &rows))
        (note(
            "One UAV 1 km away, anywhere within 50° of azimuth and 3° to 9° of elevation, across the line \
             of sight at 8 m/s; times of those acquired.",
        ))
    }
}

fn budgets(budgets: &[Budget]) -> Markup {
    html! {
        h2 { "Jitter budget" }
        @for budget in budgets { (one_budget(budget)) }
        (note(
            "Root mean squares over seeds, settled. “Goes with it” is the root of the variance that vanishes \
             when the cause is switched off; a minus sign: the error grows. “It alone” is what a source adds where \
             no other is; latency, structure and mirror add nothing themselves. The sum is of squares.",
        ))
    }
}

fn one_budget(budget: &Budget) -> Markup {
    const HEAD: [&str; 4] = [
        "cause",
        "without it [µrad]",
        "goes with it [µrad]",
        "it alone [µrad]",
    ];
    let mut rows: Vec<_> = budget
        .causes
        .iter()
        .map(|cause| {
            vec![
                cause.name.into(),
                number(cause.without_urad, 2),
                number(cause.removed_urad, 2),
                number(cause.alone_urad, 2),
            ]
        })
        .collect();
    let lone = |name: &str, urad: Option<f64>| {
        vec![
            name.to_string(),
            String::new(),
            String::new(),
            number(urad, 2),
        ]
    };
    rows.extend([
        lone("left without any source", budget.none_urad),
        lone("sum", budget.sum_urad),
        lone(
            "atmosphere and director jitter, on the beam only",
            budget.beam_urad,
        ),
    ]);
    html! {
        h3 {
            (budget.controller) " controller, " (budget.detector) " detector: "
            (number(budget.all.rms_urad, 2)) " µrad rms"
        }
        (table(&HEAD, &rows))
    }
}
