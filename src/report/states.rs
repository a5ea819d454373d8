//! States over time, as a bar and a table.

use super::axis::linear_ticks;
use super::page::note;
use maud::{Markup, html};

/// Okabe and Ito's palette without black and with the yellow last, for the states.
const STATE_COLOURS: [&str; 7] = [
    "#56b4e9", "#e69f00", "#009e73", "#d55e00", "#cc79a7", "#0072b2", "#f0e442",
];

/// One stay in a state.
#[derive(Clone, Debug)]
pub struct StateSpan {
    /// When it began \[s\].
    pub t0_s: f64,
    /// When it ended \[s\].
    pub t1_s: f64,
    /// Name of the state.
    pub name: String,
    /// Why it was entered.
    pub reason: String,
}

/// The states from 0 to `end_s`, as a bar of colours and a table.
pub fn states(spans: &[StateSpan], end_s: f64) -> Markup {
    if spans.is_empty() {
        return note("no states");
    }
    let mut names: Vec<&str> = Vec::new();
    for span in spans {
        if !names.contains(&span.name.as_str()) {
            names.push(&span.name);
        }
    }
    let colour = |name: &str| {
        let at = names.iter().position(|known| *known == name).unwrap_or(0);
        STATE_COLOURS[at % STATE_COLOURS.len()]
    };
    html! {
        (bar(spans, end_s, &colour))
        div .scroll {
            table .states {
                tr {
                    th { "State" }
                    @for label in ["from [s]", "to [s]", "for [s]"] { th .n { (label) } }
                    th { "Entered because" }
                }
                @for span in spans {
                    tr {
                        td {
                            span .dot style=(format_args!("background:{}", colour(&span.name))) {}
                            (span.name)
                        }
                        @for t_s in [span.t0_s, span.t1_s, span.t1_s - span.t0_s] {
                            td .n { (format_args!("{t_s:.3}")) }
                        }
                        td { (span.reason) }
                    }
                }
            }
        }
    }
}

fn bar(spans: &[StateSpan], end_s: f64, colour: &dyn Fn(&str) -> &'static str) -> Markup {
    let percent = |t: f64| 100.0 * t / end_s.max(f64::MIN_POSITIVE);
    // The end has its own label, which the last round value may not touch.
    let ticks = linear_ticks(0.0, end_s, 6);
    let ticks = ticks.iter().filter(|(t, _)| *t < 0.9 * end_s);
    html! {
        div .bar {
            @for span in spans {
                i style=(format_args!(
                    "left:{:.3}%;width:{:.3}%;background:{}",
                    percent(span.t0_s),
                    percent(span.t1_s - span.t0_s),
                    colour(&span.name)
                )) title=(format_args!(
                    "{} {:.3} s to {:.3} s",
                    span.name, span.t0_s, span.t1_s
                )) {}
            }
        }
        div .ticks {
            @for (t, label) in ticks {
                span style=(format_args!("left:{:.3}%", percent(*t))) { (label) }
            }
            span style="left:100%" { (format_args!("{end_s:.1} s")) }
        }
    }
}
