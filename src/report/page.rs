//! What all pages share: head, style, tables and notes.

use base64::{Engine as _, prelude::BASE64_STANDARD};
use maud::{DOCTYPE, Markup, PreEscaped, html};

/// The style of every page. Colours are after Okabe and Ito, which the colour-blind can tell apart; the dark page has those of
/// [`boresight_common::palette`], as window and films have.
pub(super) const STYLE: &str = "
:root{color-scheme:light dark;--paper:#fff;--card:#f6f7f9;--ink:#16191d;--soft:#5a636e;--line:#d9dde3;
--s0:#0072b2;--s1:#d55e00;--s2:#009e73;--good:#00795a;--bad:#b34700}
@media(prefers-color-scheme:dark){:root{--paper:#12151a;--card:#1b2027;--ink:#e8ebef;--soft:#9aa5b1;
--line:#343c47;--s0:#56b4e9;--s1:#f06e32;--s2:#2fbf94;--good:#2fbf94;--bad:#f06e32}}
*{box-sizing:border-box}
body{margin:0 auto;max-width:76rem;padding:1.5rem clamp(.8rem,3vw,2.5rem) 4rem;background:var(--paper);
color:var(--ink);font:16px/1.5 system-ui,-apple-system,'Segoe UI',Roboto,'DejaVu Sans',sans-serif}
h1{font-size:1.75rem;line-height:1.2;margin:0 0 .4rem}
h2{font-size:1.15rem;margin:2.4rem 0 .8rem;padding-bottom:.3rem;border-bottom:1px solid var(--line)}
h3{font-size:.95rem;margin:1.2rem 0 .3rem}
.meta{color:var(--soft);margin:0;display:flex;flex-wrap:wrap;gap:.2rem 1.4rem}
code{font:.92em ui-monospace,'DejaVu Sans Mono',monospace;color:var(--ink);overflow-wrap:anywhere}
.outcome{display:inline-block;margin:.9rem 0 0;padding:.25rem .8rem;border-radius:99px;font-weight:600;
border:2px solid var(--bad);color:var(--bad)}
.outcome.good{border-color:var(--good);color:var(--good)}
.tiles{display:grid;grid-template-columns:repeat(auto-fill,minmax(11.5rem,1fr));gap:.7rem;margin:0}
.tiles div{background:var(--card);border-radius:8px;padding:.6rem .8rem}
.tiles dt{color:var(--soft);font-size:.82rem}
.tiles dd{margin:0;font-size:1.15rem;font-weight:600;font-variant-numeric:tabular-nums;overflow-wrap:break-word}
.charts{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,26rem),1fr));gap:1.2rem}
figure{margin:0;min-width:0}
.charts figure{background:var(--card);border-radius:8px;padding:.8rem .8rem .4rem}
figcaption{display:flex;flex-wrap:wrap;gap:.1rem 1rem;align-items:baseline}
figcaption b{font-weight:600}
.key{color:var(--soft);font-size:.85rem;white-space:nowrap}
.key::before{content:'';display:inline-block;width:1.3em;margin-right:.4em;vertical-align:.28em;
border-top:3px solid var(--c)}
.key.dash::before{border-top-style:dashed}
svg{display:block;width:100%;height:auto}
.charts svg{font:12px system-ui,-apple-system,'Segoe UI',Roboto,'DejaVu Sans',sans-serif;
font-variant-numeric:tabular-nums}
.charts text{fill:var(--soft)}
.grid{stroke:var(--line);stroke-width:1}
.s{fill:none;stroke-width:1.4;stroke-linejoin:round;stroke-linecap:round}
.faint{stroke-opacity:.35;stroke-width:1}
.limit{stroke:var(--s1);stroke-width:1.6;stroke-dasharray:6 4}
.scroll{overflow-x:auto;margin-bottom:1.4rem}
table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums}
th,td{padding:.32rem .5rem;text-align:left;border-bottom:1px solid var(--line);vertical-align:top}
th{color:var(--soft);font-size:.82rem;font-weight:600;white-space:nowrap}
.n{text-align:right;white-space:nowrap}
.bar{position:relative;height:2.2rem;border-radius:6px;overflow:hidden;background:var(--card)}
.bar i{position:absolute;top:0;bottom:0;border-left:1px solid var(--paper)}
.ticks{position:relative;height:1.5rem;color:var(--soft);font-size:.8rem;margin-bottom:.6rem;
font-variant-numeric:tabular-nums}
.ticks span{position:absolute;transform:translateX(-50%);white-space:nowrap}
.ticks span:first-child{transform:none}
.ticks span:last-child{transform:translateX(-100%)}
.dot{display:inline-block;width:.8em;height:.8em;border-radius:3px;margin-right:.5em;vertical-align:-.04em}
.sheet{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,19rem),1fr));gap:1.1rem}
.sheet svg{border-radius:6px;background:#000}
.sheet figcaption{font-size:.88rem;padding-top:.3rem}
.sheet text{paint-order:stroke;stroke:#000;stroke-opacity:.55;font-weight:600;font-family:system-ui,'DejaVu Sans',sans-serif}
.note{color:var(--soft);font-size:.85rem}
.states td:first-child{white-space:nowrap}
.states td:last-child{min-width:12rem}
@media(max-width:30rem){.charts svg{font-size:15px}th,td{padding:.3rem .45rem}}
";

/// The head of a page.
#[derive(Clone, Copy, Debug, Default)]
pub struct Head<'a> {
    /// Title of the window.
    pub title: &'a str,
    /// Heading of the page.
    pub heading: &'a str,
    /// Label and value of what stands below the heading; either may be empty, and a fact of neither is left out.
    pub facts: &'a [(&'a str, &'a str)],
    /// Rules of this page besides those of every page.
    pub style: &'a str,
}

/// A whole page that loads nothing else.
pub fn page(head: &Head, body: &Markup) -> String {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width,initial-scale=1";
                title { (head.title) }
                style { (PreEscaped(STYLE)) (PreEscaped(head.style)) }
            }
            body {
                header {
                    h1 { (head.heading) }
                    p .meta {
                        @for (label, value) in head.facts.iter().filter(|fact| **fact != ("", "")) {
                            span {
                                @if !label.is_empty() { (label) " " }
                                @if !value.is_empty() { code { (value) } }
                            }
                        }
                    }
                }
                (body)
            }
        }
    }
    .into_string()
}

/// A number, or a dash where there is none.
pub fn number(value: Option<f64>, decimals: usize) -> String {
    value.map_or("–".into(), |value| format!("{value:.decimals$}"))
}

/// A share as a percentage, or a dash where there is none.
pub fn percent(share: Option<f64>) -> String {
    share.map_or("–".into(), |share| format!("{:.1} %", 100.0 * share))
}

/// A table: its head, and rows of cells as text; cells after the first that begin with a digit, a
/// sign or a dash are aligned right.
pub fn table(head: &[&str], rows: &[Vec<String>]) -> Markup {
    let is_number = |column: usize, cell: &str| {
        let first = cell.chars().next();
        column > 0 && first.is_some_and(|c| c.is_ascii_digit() || "-–".contains(c))
    };
    // A head stands over its numbers.
    let of_numbers = |column: usize| {
        let mut cells = rows.iter().filter_map(|row| row.get(column));
        cells.any(|cell| is_number(column, cell))
    };
    html! {
        div .scroll {
            table {
                tr {
                    @for (column, cell) in head.iter().enumerate() {
                        th class=[of_numbers(column).then_some("n")] { (cell) }
                    }
                }
                @for row in rows {
                    tr {
                        @for (column, cell) in row.iter().enumerate() {
                            td class=[is_number(column, cell).then_some("n")] { (cell) }
                        }
                    }
                }
            }
        }
    }
}

/// A remark in small print.
pub fn note(text: &str) -> Markup {
    html! { p .note { (text) } }
}

/// Labels and values side by side.
pub fn tiles<'a>(rows: impl IntoIterator<Item = &'a (String, String)>) -> Markup {
    html! {
        dl .tiles {
            @for (label, value) in rows {
                div {
                    dt { (label) }
                    dd { (value) }
                }
            }
        }
    }
}

/// A JPEG file as the address of an image of a page.
pub fn data_url(jpeg: &[u8]) -> String {
    format!("data:image/jpeg;base64,{}", BASE64_STANDARD.encode(jpeg))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_escaped_and_numbers_stand_right() {
        let rows = [vec!["<b>".into(), "-1.5".into(), "x".into()]];
        let text = table(&["a & b", "c", "d"], &rows).into_string();
        assert!(text.contains("<th>a &amp; b</th>") && text.contains("<td>&lt;b&gt;</td>"));
        assert!(text.contains("<td class=\"n\">-1.5</td>") && text.contains("<td>x</td>"));
        let head = Head {
            title: "</title>",
            facts: &[("Model", "\"m\""), ("", "run"), ("A & B", "")],
            ..Head::default()
        };
        let page = page(&head, &note("<i>"));
        assert!(page.starts_with("<!DOCTYPE html><html lang=\"en\">"));
        assert!(page.contains("<title>&lt;/title&gt;</title>"));
        assert!(page.contains("Model <code>&quot;m&quot;</code>"));
        assert!(page.contains("<span><code>run</code></span><span>A &amp; B </span>"));
        assert!(page.contains("<p class=\"note\">&lt;i&gt;</p>"));
    }
}
