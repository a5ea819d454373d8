//! What a run leaves for people and scripts: a self-contained HTML report and the summary's numbers.
//!
//! The charts are written as SVG here: the plotting crates round to whole pixels and fix their colours,
//! which neither follows a dark page nor scales to a phone.

use std::{
    fmt::{self, Display, Write as _},
    fs, io,
    path::{Path, PathBuf},
};

use base64::{Engine as _, prelude::BASE64_STANDARD};
use serde::Serialize;

use crate::recording::encode_jpeg;

/// Most points drawn per series.
const MAX_POINTS: usize = 2000;
/// Number of means drawn over the extremes of a dense series.
const MEANS: usize = 240;
/// Samples beyond which a line would fill an area, so that the mean is drawn over it.
const DENSE: usize = 4 * MEANS;
/// Room for the images of the contact sheet, before base64; keeps the report below 2 MB.
const IMAGE_BUDGET: usize = 1_100_000; // [byte]

/// Why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The file could not be written.
    #[error("cannot write the report {}: {source}", path.display())]
    Write {
        /// The file asked for.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A frame of the contact sheet is no image.
    #[error("frame {index} of the contact sheet: {source}")]
    Frame {
        /// Its place in the sheet.
        index: usize,
        /// What the JPEG encoder said.
        source: jpeg_encoder::EncodingError,
    },
}

/// Statistics of the miss distance \[px\]; quantiles interpolate linearly between the sorted samples
/// (Hyndman and Fan's rule 7).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MissStats {
    /// Arithmetic mean: what eq. 12 prints.
    pub mean: f64,
    /// Root mean square: what the text of eq. 12 says.
    pub rms: f64,
    /// Median.
    pub p50: f64,
    /// 95 % quantile.
    pub p95: f64,
    /// 99 % quantile.
    pub p99: f64,
    /// Number of samples.
    pub n: usize,
}

impl MissStats {
    /// Statistics of the finite samples, `None` without any.
    pub fn of(samples_px: impl IntoIterator<Item = f64>) -> Option<Self> {
        let mut sorted: Vec<f64> = samples_px.into_iter().filter(|x| x.is_finite()).collect();
        sorted.sort_unstable_by(f64::total_cmp);
        let (&last, n) = (sorted.last()?, sorted.len());
        let quantile = |p: f64| {
            let at = p * (n - 1) as f64;
            let low = at as usize;
            let next = sorted.get(low + 1).copied().unwrap_or(last);
            sorted[low] + (next - sorted[low]) * at.fract()
        };
        Some(Self {
            mean: sorted.iter().sum::<f64>() / n as f64,
            rms: (sorted.iter().map(|x| x * x).sum::<f64>() / n as f64).sqrt(),
            p50: quantile(0.5),
            p95: quantile(0.95),
            p99: quantile(0.99),
            n,
        })
    }
}

/// The numbers of one run, as `summary.json` has them; its keys do not change.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Name of the scenario.
    pub scenario: String,
    /// Version of the program.
    pub version: String,
    /// Seed of every random stream.
    pub seed: u64,
    /// How the run ended, in one word.
    pub outcome: String,
    /// Why it ended so.
    pub reason: String,
    /// Hash of the final state, 16 hexadecimal digits.
    pub state_hash: String,
    /// Simulated time \[s\].
    pub simulated_s: f64,
    /// Simulated over elapsed time.
    pub real_time_factor: f64,
    /// Time of the first Coarse state: the coarse camera had confirmed a target \[s\].
    pub time_to_acquire_s: Option<f64>,
    /// Time at which the last target failed \[s\].
    pub time_to_neutralise_s: Option<f64>,
    /// Distance between the target and the boresight \[px\].
    pub miss_distance_px: MissDistances,
    /// Time for which the firing beam's centre lay on the aim point \[s\].
    pub dwell_s: f64,
    /// Time for which the firing beam's axis lay on a bird or balloon [s].
    pub distractor_s: f64,
    /// Energy that left the laser \[J\].
    pub energy_j: f64,
    /// The same for each UAV brought down by it \[J\]; `None` without any.
    pub energy_per_neutralised_j: Option<f64>,
    /// Each UAV, in the order of the scenario.
    pub uavs: Vec<UavSummary>,
    /// Where the elapsed time went.
    pub share: Shares,
}

/// What became of a UAV, and what the laser spent on it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct UavSummary {
    /// Name in the scenario.
    pub name: String,
    /// Flying, falling, down or crashed.
    pub status: String,
    /// Energy emitted while the beam was aimed at it \[J\].
    pub energy_j: f64,
    /// Time for which the firing beam's centre lay on its aim point \[s\].
    pub dwell_s: f64,
    /// Time at which its skin failed \[s\].
    pub neutralised_s: Option<f64>,
}

/// Miss distance of both tracking cameras \[px\].
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MissDistances {
    /// Coarse camera.
    pub coarse: Option<MissStats>,
    /// Precise camera.
    pub precise: Option<MissStats>,
}

/// Shares of the elapsed time, 0 to 1 each.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Shares {
    /// Drawing the cameras' images.
    pub render: f64,
    /// The detector.
    pub inference: f64,
    /// Everything else.
    pub other: f64,
}

/// Samples (simulated time \[s\], value); a value that is not a number is a gap in the line.
pub type Series = Vec<(f64, f64)>;

/// Everything that the report shows.
#[derive(Clone, Debug, Default)]
pub struct ReportData {
    /// Heading.
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
    /// States of the acquisition, tracking and pointing machine, in order.
    pub states: Vec<StateSpan>,
    /// Images of the run, in order.
    pub frames: Vec<ContactFrame>,
}

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

/// One image of the contact sheet.
#[derive(Clone, Debug)]
pub struct ContactFrame {
    /// Name of the camera.
    pub camera: String,
    /// Time of exposure \[s\].
    pub time_s: f64,
    /// Width \[px\].
    pub width: u16,
    /// Height \[px\].
    pub height: u16,
    /// Rows of red, green, blue bytes.
    pub rgb8: Vec<u8>,
    /// What is marked in it.
    pub boxes: Vec<ContactBox>,
    /// Boresight \[px\].
    pub reticle_px: [f64; 2],
    /// What it shows.
    pub caption: String,
}

/// One marked box.
#[derive(Clone, Debug)]
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
    let mut page = String::new();
    // Writing to a string cannot fail; the typed error keeps the signature honest.
    page_html(&mut page, data, &jpegs)
        .map_err(io::Error::other)
        .and_then(|()| fs::write(path, page))
        .map_err(|source| ReportError::Write {
            path: path.to_owned(),
            source,
        })
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

/// Text made safe for HTML and SVG, in content and in quoted attributes.
pub(crate) struct Escaped<'a>(pub(crate) &'a str);

impl Display for Escaped<'_> {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        for c in self.0.chars() {
            match c {
                '&' => f.write_str("&amp;")?,
                '<' => f.write_str("&lt;")?,
                '>' => f.write_str("&gt;")?,
                '"' => f.write_str("&quot;")?,
                '\'' => f.write_str("&#39;")?,
                // The other control characters are not allowed in a page.
                c if c.is_control() && c != '\n' && c != '\t' => f.write_char('\u{fffd}')?,
                c => f.write_char(c)?,
            }
        }
        Ok(())
    }
}

// Colours after Okabe and Ito, which the colour-blind can tell apart; the dark page lightens the blue.
pub(crate) const STYLE: &str = "
:root{color-scheme:light dark;--paper:#fff;--card:#f6f7f9;--ink:#16191d;--soft:#5a636e;--line:#d9dde3;
--s0:#0072b2;--s1:#d55e00;--s2:#009e73;--good:#00795a;--bad:#b34700}
@media(prefers-color-scheme:dark){:root{--paper:#12151a;--card:#1b2027;--ink:#e8ebef;--soft:#9aa5b1;
--line:#343c47;--s0:#56b4e9;--s1:#f0883e;--s2:#2fbf94;--good:#2fbf94;--bad:#f0883e}}
*{box-sizing:border-box}
body{margin:0 auto;max-width:76rem;padding:1.5rem clamp(.8rem,3vw,2.5rem) 4rem;background:var(--paper);
color:var(--ink);font:16px/1.5 system-ui,-apple-system,'Segoe UI',Roboto,'DejaVu Sans',sans-serif}
h1{font-size:1.75rem;line-height:1.2;margin:0 0 .4rem}
h2{font-size:1.15rem;margin:2.4rem 0 .8rem;padding-bottom:.3rem;border-bottom:1px solid var(--line)}
.meta{color:var(--soft);margin:0;display:flex;flex-wrap:wrap;gap:.2rem 1.4rem}
code{font:.92em ui-monospace,'DejaVu Sans Mono',monospace;color:var(--ink);overflow-wrap:anywhere}
.outcome{display:inline-block;margin:.9rem 0 0;padding:.25rem .8rem;border-radius:99px;font-weight:600;
border:2px solid var(--bad);color:var(--bad)}
.outcome.good{border-color:var(--good);color:var(--good)}
.tiles{display:grid;grid-template-columns:repeat(auto-fill,minmax(10.5rem,1fr));gap:.7rem;margin:0}
.tiles div{background:var(--card);border-radius:8px;padding:.6rem .8rem}
.tiles dt{color:var(--soft);font-size:.82rem}
.tiles dd{margin:0;font-size:1.15rem;font-weight:600;font-variant-numeric:tabular-nums;overflow-wrap:anywhere}
.charts{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,26rem),1fr));gap:1.2rem}
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
.scroll{overflow-x:auto}
table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums}
th,td{padding:.32rem .7rem;text-align:left;border-bottom:1px solid var(--line);vertical-align:top}
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

/// Okabe and Ito's palette without black and with the yellow last, for the states.
const STATE_COLOURS: [&str; 7] = [
    "#56b4e9", "#e69f00", "#009e73", "#d55e00", "#cc79a7", "#0072b2", "#f0e442",
];

fn page_html(out: &mut String, data: &ReportData, jpegs: &[Vec<u8>]) -> fmt::Result {
    writeln!(
        out,
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\n\
         <title>{title}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<header>\n<h1>{title}</h1>\n\
         <p class=\"meta\"><span>Scenario <code>{scenario}</code></span>\
         <span>Seed <code>{seed}</code></span><span>State hash <code>{hash}</code></span>\
         <span>Version <code>{version}</code></span></p>\n\
         <p class=\"outcome{good}\">{outcome}</p>\n</header>",
        title = Escaped(&data.title),
        scenario = Escaped(&data.scenario),
        seed = data.seed,
        hash = Escaped(&data.state_hash),
        version = Escaped(&data.version),
        good = if data.succeeded { " good" } else { "" },
        outcome = Escaped(&data.outcome),
    )?;

    out.push_str("<h2>Summary</h2>\n<dl class=\"tiles\">\n");
    for (label, value) in &data.summary {
        writeln!(
            out,
            "<div><dt>{}</dt><dd>{}</dd></div>",
            Escaped(label),
            Escaped(value)
        )?;
    }
    out.push_str("</dl>\n<h2>Miss distance</h2>\n");
    miss_table(out, data)?;

    out.push_str("<h2>Time histories</h2>\n<div class=\"charts\">\n");
    let charts = [
        Chart {
            title: "Miss distance",
            unit: "px",
            scale: Scale::Log,
            series: &[
                ("coarse", &data.miss_coarse_px),
                ("precise", &data.miss_precise_px),
            ],
            limit: None,
        },
        Chart {
            title: "Line-of-sight error",
            unit: "µrad",
            scale: Scale::Log,
            series: &[("", &data.los_error_urad)],
            limit: None,
        },
        Chart {
            title: "Irradiance on target",
            unit: "W/m²",
            scale: Scale::Prefixed,
            series: &[("", &data.irradiance_wpm2)],
            limit: None,
        },
        Chart {
            title: "Power in the bucket",
            unit: "W",
            scale: Scale::Prefixed,
            series: &[("", &data.power_in_bucket_w)],
            limit: None,
        },
        Chart {
            title: "Skin temperature",
            unit: "K",
            scale: Scale::Linear,
            series: &[("skin", &data.skin_temperature_k)],
            limit: data.failure_temperature_k.map(|k| ("failure", k)),
        },
    ];
    let end_s = end_of_run_s(data);
    let across = Across::time("simulated time [s]", end_s);
    for chart in &charts {
        chart.html(out, &across)?;
    }
    out.push_str("</div>\n<h2>States</h2>\n");
    states_html(out, &data.states, end_s)?;
    out.push_str("<h2>Contact sheet</h2>\n");
    contact_sheet(out, &data.frames, jpegs)?;
    out.push_str("</body>\n</html>\n");
    Ok(())
}

/// Latest time that anything in the report has \[s\].
fn end_of_run_s(data: &ReportData) -> f64 {
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

fn miss_table(out: &mut String, data: &ReportData) -> fmt::Result {
    out.push_str(
        "<div class=\"scroll\"><table>\n<tr><th>Camera</th><th class=\"n\">mean [px]</th>\
         <th class=\"n\">rms [px]</th><th class=\"n\">p50 [px]</th><th class=\"n\">p95 [px]</th>\
         <th class=\"n\">p99 [px]</th><th class=\"n\">samples</th></tr>\n",
    );
    for (name, series) in [
        ("coarse", &data.miss_coarse_px),
        ("precise", &data.miss_precise_px),
    ] {
        write!(out, "<tr><td>{name}</td>")?;
        match MissStats::of(series.iter().map(|&(_, px)| px)) {
            Some(stats) => {
                for px in [stats.mean, stats.rms, stats.p50, stats.p95, stats.p99] {
                    write!(out, "<td class=\"n\">{px:.3}</td>")?;
                }
                writeln!(out, "<td class=\"n\">{}</td></tr>", stats.n)?;
            }
            None => out.push_str("<td class=\"n\" colspan=\"6\">no samples</td></tr>\n"),
        }
    }
    out.push_str("</table></div>\n");
    Ok(())
}

/// How a chart's values are mapped to its height.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Scale {
    Linear,
    /// Linear from zero, with the unit's prefix chosen by size.
    Prefixed,
    /// Logarithmic; values of zero or less are gaps.
    Log,
}

pub(crate) struct Chart<'a> {
    pub(crate) title: &'a str,
    pub(crate) unit: &'a str,
    pub(crate) scale: Scale,
    /// Name, empty for an only one, and samples.
    pub(crate) series: &'a [(&'a str, &'a Series)],
    pub(crate) limit: Option<(&'a str, f64)>,
}

/// What a chart's values are drawn over.
pub(crate) struct Across<'a> {
    label: &'a str,
    axis: Axis,
}

impl<'a> Across<'a> {
    /// Time from zero [s].
    pub(crate) fn time(label: &'a str, end_s: f64) -> Self {
        let axis = Axis {
            log: false,
            low: 0.0,
            high: end_s.max(f64::MIN_POSITIVE),
            ticks: linear_ticks(0.0, end_s, 6),
        };
        Self { label, axis }
    }

    /// Frequency, logarithmic [Hz].
    pub(crate) fn frequency(low_hz: f64, high_hz: f64) -> Self {
        Self {
            label: "frequency [Hz]",
            axis: Axis::log(low_hz, high_hz),
        }
    }
}

// The drawing, in SVG units that are pixels when it is shown at its own width.
const WIDTH: f64 = 480.0;
const HEIGHT: f64 = 230.0;
const LEFT: f64 = 52.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 12.0;
const BOTTOM: f64 = 38.0;

impl Chart<'_> {
    pub(crate) fn html(&self, out: &mut String, across: &Across) -> fmt::Result {
        let usable = |y: f64| y.is_finite() && (self.scale != Scale::Log || y > 0.0);
        let (low, high) = self
            .series
            .iter()
            .flat_map(|(_, series)| series.iter().map(|&(_, y)| y))
            .chain(self.limit.map(|(_, y)| y))
            .filter(|&y| usable(y))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), y| {
                (low.min(y), high.max(y))
            });
        let (factor, prefix) = match self.scale {
            Scale::Prefixed => prefix(high),
            _ => (1.0, ""),
        };
        write!(
            out,
            "<figure><figcaption><b>{} [{prefix}{}]</b>",
            self.title, self.unit
        )?;
        for (i, (name, _)) in self
            .series
            .iter()
            .enumerate()
            .filter(|(_, (name, _))| !name.is_empty())
        {
            write!(
                out,
                "<span class=\"key\" style=\"--c:var(--s{i})\">{name}</span>"
            )?;
        }
        if self.series.iter().any(|(_, series)| series.len() > DENSE) {
            out.push_str("<span class=\"note\">mean and extremes</span>");
        }
        if let Some((name, y)) = self.limit {
            write!(
                out,
                "<span class=\"key dash\" style=\"--c:var(--s1)\">{name} at {y:.0} {}</span>",
                self.unit
            )?;
        }
        out.push_str("</figcaption>\n");
        if low > high {
            out.push_str("<p class=\"note\">no samples</p></figure>\n");
            return Ok(());
        }
        let axis = Axis::new(self.scale, low / factor, high / factor);
        let x_of = |t: f64| LEFT + across.axis.place(t) * (WIDTH - LEFT - RIGHT);
        let y_of = |y: f64| HEIGHT - BOTTOM - axis.place(y) * (HEIGHT - TOP - BOTTOM);
        writeln!(
            out,
            "<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{} over {}\">",
            self.title, across.label
        )?;
        for (y, label) in &axis.ticks {
            let py = y_of(*y);
            writeln!(
                out,
                "<line class=\"grid\" x1=\"{LEFT}\" x2=\"{}\" y1=\"{py:.1}\" y2=\"{py:.1}\"/>\
                 <text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{label}</text>",
                WIDTH - RIGHT,
                LEFT - 7.0,
                py + 4.0
            )?;
        }
        let floor = HEIGHT - BOTTOM;
        for (t, label) in &across.axis.ticks {
            let px = x_of(*t);
            writeln!(
                out,
                "<line class=\"grid\" x1=\"{px:.1}\" x2=\"{px:.1}\" y1=\"{floor}\" y2=\"{}\"/>\
                 <text x=\"{px:.1}\" y=\"{}\" text-anchor=\"middle\">{label}</text>",
                floor + 4.0,
                floor + 18.0
            )?;
        }
        writeln!(
            out,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
            (LEFT + WIDTH - RIGHT) / 2.0,
            HEIGHT - 4.0,
            across.label
        )?;
        if let Some((_, y)) = self.limit {
            let py = y_of(y / factor);
            writeln!(
                out,
                "<line class=\"limit\" x1=\"{LEFT}\" x2=\"{}\" y1=\"{py:.1}\" y2=\"{py:.1}\"/>",
                WIDTH - RIGHT
            )?;
        }
        for (i, (_, series)) in self.series.iter().enumerate() {
            let dense = series.len() > DENSE;
            // Of a dense series the faint line has the extremes and the full one the mean.
            let lines = [
                (if dense { "s faint" } else { "s" }, decimate(series)),
                ("s", if dense { means(series) } else { Vec::new() }),
            ];
            for (class, points) in lines.iter().filter(|(_, points)| !points.is_empty()) {
                write!(out, "<path class=\"{class}\" stroke=\"var(--s{i})\" d=\"")?;
                let mut pen = 'M';
                for &(t, y) in points {
                    if usable(y) && t.is_finite() {
                        write!(out, "{pen}{:.1} {:.1}", x_of(t), y_of(y / factor))?;
                        pen = 'L';
                    } else {
                        pen = 'M';
                    }
                }
                out.push_str("\"/>\n");
            }
        }
        out.push_str("</svg></figure>\n");
        Ok(())
    }
}

/// Factor and SI prefix that bring a largest value between 1 and 1000.
fn prefix(high: f64) -> (f64, &'static str) {
    [
        (1e9, "G"),
        (1e6, "M"),
        (1e3, "k"),
        (1.0, ""),
        (1e-3, "m"),
        (1e-6, "µ"),
    ]
    .into_iter()
    .find(|&(factor, _)| high >= factor)
    .unwrap_or((1.0, ""))
}

struct Axis {
    log: bool,
    low: f64,
    high: f64,
    ticks: Vec<(f64, String)>,
}

impl Axis {
    fn new(scale: Scale, low: f64, high: f64) -> Self {
        match scale {
            Scale::Log => Self::log(low, high),
            Scale::Prefixed => Self::linear(low.min(0.0), high),
            Scale::Linear => Self::linear(low, high),
        }
    }

    fn linear(low: f64, high: f64) -> Self {
        // A constant still needs an axis with a height.
        let pad = if high > low {
            0.05 * (high - low)
        } else {
            0.5 * high.abs().max(1.0)
        };
        let low = if low == 0.0 { 0.0 } else { low - pad };
        let high = high + pad;
        Self {
            log: false,
            low,
            high,
            ticks: linear_ticks(low, high, 6),
        }
    }

    fn log(low: f64, high: f64) -> Self {
        let (low, high) = (low / 1.2, high * 1.2);
        let decades = high.log10() - low.log10();
        let steps: &[f64] = match decades {
            d if d > 3.0 => &[1.0],
            d if d > 1.5 => &[1.0, 3.0],
            _ => &[1.0, 2.0, 5.0],
        };
        // Beyond six decades every second one is enough.
        let stride = (decades / 6.0).ceil().max(1.0) as usize;
        let ticks = (low.log10().floor() as i32..=high.log10().ceil() as i32)
            .step_by(stride)
            .flat_map(|exponent| steps.iter().map(move |step| step * 10f64.powi(exponent)))
            .filter(|tick| (low..=high).contains(tick))
            .map(|tick| {
                let label = if (1e-3..1e5).contains(&tick) {
                    short(tick)
                } else {
                    format!("{tick:.0e}")
                };
                (tick, label)
            })
            .collect();
        Self {
            log: true,
            low,
            high,
            ticks,
        }
    }

    /// Height of a value, 0 at the bottom and 1 at the top.
    fn place(&self, y: f64) -> f64 {
        if self.log {
            (y / self.low).log10() / (self.high / self.low).log10()
        } else {
            (y - self.low) / (self.high - self.low)
        }
    }
}

/// A tick label of a round number, without the noise of binary fractions.
fn short(x: f64) -> String {
    let text = format!("{x:.6}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// At most `count` or so round values within the range, with their labels.
fn linear_ticks(low: f64, high: f64, count: usize) -> Vec<(f64, String)> {
    let raw = (high - low) / count as f64;
    if !(raw.is_finite() && raw > 0.0) {
        return vec![(low, short(low))];
    }
    let decade = 10f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .map(|m| m * decade)
        .into_iter()
        .find(|step| *step >= raw * 0.999)
        .unwrap_or(10.0 * decade);
    let (first, last) = ((low / step).ceil() as i64, (high / step).floor() as i64);
    let decimals = (-step.log10().floor()).clamp(0.0, 9.0) as usize;
    (first..=last)
        .map(|i| (i as f64 * step, format!("{:.decimals$}", i as f64 * step)))
        .collect()
}

/// At most [`MAX_POINTS`] samples that keep the smallest and largest value, and gaps, of every stretch.
fn decimate(series: &[(f64, f64)]) -> Vec<(f64, f64)> {
    if series.len() <= MAX_POINTS {
        return series.to_vec();
    }
    // Three points a stretch at most: minimum, maximum and a gap.
    let stretch = series.len().div_ceil(MAX_POINTS / 3);
    let mut out = Vec::with_capacity(MAX_POINTS);
    for samples in series.chunks(stretch) {
        let finite = || samples.iter().copied().filter(|(_, y)| y.is_finite());
        let low = finite().min_by(|a, b| a.1.total_cmp(&b.1));
        let high = finite().max_by(|a, b| a.1.total_cmp(&b.1));
        if let (Some(low), Some(high)) = (low, high) {
            let (first, second) = if low.0 <= high.0 {
                (low, high)
            } else {
                (high, low)
            };
            out.push(first);
            if second.0 > first.0 {
                out.push(second);
            }
        }
        out.extend(samples.iter().copied().find(|(_, y)| !y.is_finite()));
    }
    out
}

/// The mean of every stretch of a series between its gaps, at the stretch's mean time.
fn means(series: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let stretch = series.len().div_ceil(MEANS);
    let mut out = Vec::new();
    for run in series.chunk_by(|a, b| a.1.is_finite() == b.1.is_finite()) {
        for samples in run.chunks(stretch) {
            let n = samples.len() as f64;
            let (t, y) = samples
                .iter()
                .fold((0.0, 0.0), |sum, at| (sum.0 + at.0, sum.1 + at.1));
            out.push((t / n, y / n));
        }
    }
    out
}

pub(crate) fn states_html(out: &mut String, states: &[StateSpan], end_s: f64) -> fmt::Result {
    if states.is_empty() {
        out.push_str("<p class=\"note\">no states</p>\n");
        return Ok(());
    }
    let mut names: Vec<&str> = Vec::new();
    for span in states {
        if !names.contains(&span.name.as_str()) {
            names.push(&span.name);
        }
    }
    let colour = |name: &str| {
        let at = names.iter().position(|known| *known == name).unwrap_or(0);
        STATE_COLOURS[at % STATE_COLOURS.len()]
    };
    let percent = |t: f64| 100.0 * t / end_s.max(f64::MIN_POSITIVE);
    out.push_str("<div class=\"bar\">");
    for span in states {
        write!(
            out,
            "<i style=\"left:{:.3}%;width:{:.3}%;background:{}\" title=\"{} {:.3} s to {:.3} s\"></i>",
            percent(span.t0_s),
            percent(span.t1_s - span.t0_s),
            colour(&span.name),
            Escaped(&span.name),
            span.t0_s,
            span.t1_s
        )?;
    }
    out.push_str("</div>\n<div class=\"ticks\">");
    // The end has its own label, which the last round value may not touch.
    for (t, label) in linear_ticks(0.0, end_s, 6)
        .iter()
        .filter(|(t, _)| *t < 0.9 * end_s)
    {
        write!(
            out,
            "<span style=\"left:{:.3}%\">{label}</span>",
            percent(*t)
        )?;
    }
    writeln!(out, "<span style=\"left:100%\">{end_s:.1} s</span></div>")?;
    out.push_str(
        "<div class=\"scroll\"><table class=\"states\">\n<tr><th>State</th><th class=\"n\">from [s]</th>\
         <th class=\"n\">to [s]</th><th class=\"n\">for [s]</th><th>Entered because</th></tr>\n",
    );
    for span in states {
        writeln!(
            out,
            "<tr><td><span class=\"dot\" style=\"background:{}\"></span>{}</td>\
             <td class=\"n\">{:.3}</td><td class=\"n\">{:.3}</td><td class=\"n\">{:.3}</td><td>{}</td></tr>",
            colour(&span.name),
            Escaped(&span.name),
            span.t0_s,
            span.t1_s,
            span.t1_s - span.t0_s,
            Escaped(&span.reason)
        )?;
    }
    out.push_str("</table></div>\n");
    Ok(())
}

fn contact_sheet(out: &mut String, frames: &[ContactFrame], jpegs: &[Vec<u8>]) -> fmt::Result {
    if frames.is_empty() {
        out.push_str("<p class=\"note\">no images</p>\n");
        return Ok(());
    }
    out.push_str("<div class=\"sheet\">\n");
    for (frame, jpeg) in frames.iter().zip(jpegs) {
        let (w, h) = (f64::from(frame.width), f64::from(frame.height));
        // Everything drawn on an image is sized by it, for images of any size look alike on the sheet.
        let unit = w / 320.0;
        writeln!(
            out,
            "<figure><svg viewBox=\"0 0 {w} {h}\" font-size=\"{:.2}\" stroke-width=\"{:.2}\">\
             <image width=\"{w}\" height=\"{h}\" href=\"data:image/jpeg;base64,{}\"/>",
            12.0 * unit,
            1.5 * unit,
            BASE64_STANDARD.encode(jpeg)
        )?;
        let [x, y] = frame.reticle_px;
        let (near, far) = (5.0 * unit, 14.0 * unit);
        writeln!(
            out,
            "<path fill=\"none\" stroke=\"#fff\" stroke-opacity=\".8\" stroke-width=\"{:.2}\" \
             d=\"M{:.1} {y:.1}H{:.1}M{:.1} {y:.1}H{:.1}M{x:.1} {:.1}V{:.1}M{x:.1} {:.1}V{:.1}\"/>",
            unit,
            x - far,
            x - near,
            x + near,
            x + far,
            y - far,
            y - near,
            y + near,
            y + far
        )?;
        for mark in &frame.boxes {
            let [x0, y0, x1, y1] = mark.rect_px;
            let [r, g, b] = mark.colour;
            // Kept off a target of a few pixels, and the label within the image.
            let pad = 2.0 * unit;
            let label_y = if y0 > 20.0 * unit {
                y0 - 5.0 * unit
            } else {
                y1 + 15.0 * unit
            };
            let (label_x, anchor) = if x0 < 0.6 * w {
                (x0 - pad, "start")
            } else {
                (x1 + pad, "end")
            };
            writeln!(
                out,
                "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"none\" \
                 stroke=\"rgb({r},{g},{b})\"/><text x=\"{label_x:.1}\" y=\"{label_y:.1}\" \
                 text-anchor=\"{anchor}\" fill=\"rgb({r},{g},{b})\">{}</text>",
                x0 - pad,
                y0 - pad,
                (x1 - x0).max(0.0) + 2.0 * pad,
                (y1 - y0).max(0.0) + 2.0 * pad,
                Escaped(&mark.label)
            )?;
        }
        writeln!(
            out,
            "</svg><figcaption><b>{}</b><span>{:.3} s</span><span class=\"note\">{}</span></figcaption>\
             </figure>",
            Escaped(&frame.camera),
            frame.time_s,
            Escaped(&frame.caption)
        )?;
    }
    out.push_str("</div>\n");
    if jpegs.len() < frames.len() {
        let left_out = frames.len() - jpegs.len();
        writeln!(
            out,
            "<p class=\"note\">{left_out} later images left out for size.</p>"
        )?;
    }
    Ok(())
}

#[cfg(test)]
mod tests;
