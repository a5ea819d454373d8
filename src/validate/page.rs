//! The page of a validation, and its plots as files.

use super::found::{COMPARED, Validation, cells, number, verdict};
use crate::report::chart::{Across, Chart, Scale, Series};
use crate::report::page::{Head, note, page as whole, table};
use boresight_validate::{Axis, Finding, Plot, Verdict};
use maud::{Markup, html};

const STYLE: &str = "
.model td{padding-top:1.1rem;font-weight:600}
.green{color:var(--good)}.red{color:var(--bad);font-weight:600}
.off{width:5.5rem;height:1.1rem}
.off line{stroke:var(--line)}.off .zero{stroke:var(--soft)}
.off .green{fill:var(--good)}.off .red{fill:var(--bad)}
";

/// The whole page.
pub fn page(validation: &Validation) -> String {
    let summary = validation.summary();
    let head = Head {
        title: "Validation",
        heading: "Boresight's models against closed forms and published values",
        facts: &[("Version", validation.version), ("", &summary)],
        style: STYLE,
    };
    let outcome = match validation.red() {
        0 => "outcome good",
        _ => "outcome",
    };
    let body = html! {
        p class=(outcome) { (summary) }
        @if !validation.plots.is_empty() {
            h2 { "Curves" }
            div .charts {
                @for plot in &validation.plots { (with_chart(plot, |chart, across| chart.figure(across))) }
            }
        }
        @if !validation.scaling_against_wave.is_empty() {
            h2 { "scaling against wave" }
            @let rows: Vec<Vec<String>> = validation.scaling_against_wave.iter().map(cells).collect();
            (table(&COMPARED, &rows))
            (note(
                "Mean irradiance on the axis and mean power within the long-term radius of scaling over those of wave, \
                 less 1; 3 kW of 1.064 µm focused on the target, absorption 0.01 /km. N: Gebhardt's distortion number.",
            ))
        }
        h2 { "Checks" }
        (checks(&validation.checks))
        (note(
            "Off by: how far ours is from the value, the ends being the tolerance to either side. Below a check \
             stands the change of a constant that makes it red.",
        ))
    };
    whole(&head, &body)
}

/// The plots as files: name and text.
pub fn files(validation: &Validation) -> Vec<(String, String)> {
    let file = |plot: &Plot| {
        let text = with_chart(plot, |chart, across| chart.svg_file(across))?;
        Some((format!("{}.svg", plot.file), text))
    };
    validation.plots.iter().filter_map(file).collect()
}

/// Draws a plot.
fn with_chart<T>(plot: &Plot, draw: impl Fn(&Chart, &Across) -> T) -> T {
    let series: Vec<(&str, &Series)> = (plot.lines.iter())
        .map(|line| (line.name, &line.points))
        .collect();
    let places = series.iter().flat_map(|(_, series)| series.iter());
    let (low, high) = places.fold((f64::INFINITY, f64::NEG_INFINITY), |ends, (x, _)| {
        (ends.0.min(*x), ends.1.max(*x))
    });
    let chart = Chart {
        title: plot.title,
        unit: plot.unit,
        scale: match plot.axis {
            Axis::Linear => Scale::Linear,
            Axis::Log => Scale::Log,
        },
        series: &series,
        limit: None,
    };
    draw(&chart, &Across::values(plot.across, low, high, false))
}

fn checks(findings: &[Finding]) -> Markup {
    html! {
        div .scroll {
            table {
                tr {
                    th { "Check" } th { "Reference" }
                    th .n { "Value" } th .n { "Ours" } th .n { "Tolerance" }
                    th { "Off by" } th { "Verdict" }
                }
                @for of_model in findings.chunk_by(|a, b| a.model == b.model) {
                    @if let Some(first) = of_model.first() {
                        tr .model { td colspan="7" { (first.model) } }
                    }
                    @for finding in of_model { (row(finding)) }
                }
            }
        }
    }
}

fn row(finding: &Finding) -> Markup {
    let class = match finding.verdict {
        Verdict::Green => "green",
        Verdict::Red => "red",
    };
    let with_unit = |x: f64| format!("{} {}", number(x), finding.unit);
    html! {
        tr {
            td {
                (finding.name)
                div .note { "red: " (finding.mutation.constant) " × " (number(finding.mutation.factor)) }
                @if let Some(why) = &finding.refused { div .red { (why) } }
            }
            td { (finding.reference) }
            td .n { (with_unit(finding.value)) }
            td .n { (finding.ours.map_or("–".to_owned(), with_unit)) }
            td .n { "± " (number(finding.tolerance)) }
            td { (off(finding, class)) }
            td class=(class) { (verdict(finding.verdict)) }
        }
    }
}

/// Where a value lies between the ends of its tolerance.
fn off(finding: &Finding, class: &str) -> Markup {
    let share = finding
        .ours
        .map(|ours| ((ours - finding.value) / finding.tolerance).clamp(-1.15, 1.15));
    html! {
        svg .off viewBox="-60 -10 120 20" role="img" aria-label="off by" {
            line x1="-50" x2="50" y1="0" y2="0" {}
            line x1="-50" x2="-50" y1="-6" y2="6" {}
            line x1="50" x2="50" y1="-6" y2="6" {}
            line .zero x1="0" x2="0" y1="-3" y2="3" {}
            @if let Some(share) = share.filter(|share| share.is_finite()) {
                circle class=(class) cx=(format_args!("{:.1}", 50.0 * share)) cy="0" r="5" {}
            }
        }
    }
}
