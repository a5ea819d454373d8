//! Charts of series over time or frequency, as SVG.
//!
//! They are written here: the plotting crates round to whole pixels and fix their colours, which neither
//! follows a dark page nor scales to a phone.

pub use super::axis::Scale;
use super::axis::{ValueAxis, linear_ticks};
use super::page::STYLE;
use maud::{Markup, PreEscaped, html};
use std::fmt::Write as _;

/// Most points drawn per series.
const MAX_POINTS: usize = 2000;
/// Number of means drawn over the extremes of a dense series.
const MEANS: usize = 240;
/// Samples beyond which a line would fill an area, so that the mean is drawn over it.
const DENSE: usize = 4 * MEANS;

/// Samples (simulated time \[s\], value); a value that is not a number is a gap in the line.
pub type Series = Vec<(f64, f64)>;

/// Series drawn over one another.
#[derive(Clone, Copy, Debug)]
pub struct Chart<'a> {
    /// What is drawn.
    pub title: &'a str,
    /// Unit of the values.
    pub unit: &'a str,
    /// How values become heights.
    pub scale: Scale,
    /// Name (empty for a single series), and samples.
    pub series: &'a [(&'a str, &'a Series)],
    /// Name and value of a line across the chart.
    pub limit: Option<(&'a str, f64)>,
}

/// What a chart's values are drawn over.
pub struct Across<'a> {
    label: &'a str,
    axis: ValueAxis,
}

impl<'a> Across<'a> {
    /// From zero to `end`, such as a time [s].
    pub fn from_zero(label: &'a str, end: f64) -> Self {
        let axis = ValueAxis {
            log: false,
            low: 0.0,
            high: end.max(f64::MIN_POSITIVE),
            ticks: linear_ticks(0.0, end, 6),
        };
        Self { label, axis }
    }

    /// From `low` to `high`; logarithmic where they lie more than a factor of 20 apart, and of `whole` numbers with ticks
    /// at such alone.
    pub fn values(label: &'a str, low: f64, high: f64, whole: bool) -> Self {
        let axis = match low > 0.0 && high / low > 20.0 {
            true => ValueAxis::log(low, high),
            false if whole => ValueAxis::whole(low, high),
            false => ValueAxis::linear(low, high),
        };
        Self { label, axis }
    }

    /// Frequency, logarithmic [Hz].
    pub fn frequency(low_hz: f64, high_hz: f64) -> Self {
        Self {
            label: "frequency [Hz]",
            axis: ValueAxis::log(low_hz, high_hz),
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

/// Maps samples to places in the drawing.
struct Layout<'a> {
    across: &'a Across<'a>,
    axis: ValueAxis,
    /// What values are divided by, for the prefix of their unit.
    factor: f64,
}

impl Layout<'_> {
    fn x(&self, t: f64) -> f64 {
        LEFT + self.across.axis.place(t) * (WIDTH - LEFT - RIGHT)
    }

    /// Vertical place of a value in the unit without prefix.
    fn y(&self, y: f64) -> f64 {
        self.height(y / self.factor)
    }

    /// Vertical place of a value in the unit with its prefix.
    fn height(&self, y: f64) -> f64 {
        HEIGHT - BOTTOM - self.axis.place(y) * (HEIGHT - TOP - BOTTOM)
    }
}

impl Chart<'_> {
    /// The chart as a figure of a page, with title and key above it.
    pub fn figure(&self, across: &Across) -> Markup {
        let dense = self.series.iter().any(|(_, series)| series.len() > DENSE);
        let named = (self.series.iter().enumerate()).filter(|(_, (name, _))| !name.is_empty());
        html! {
            figure {
                figcaption {
                    b { (self.heading()) }
                    @for (i, (name, _)) in named {
                        span .key style=(format_args!("--c:var(--s{i})")) { (name) }
                    }
                    @if dense {
                        span .note { "mean and extremes" }
                    }
                    @if let Some((name, y)) = self.limit {
                        span class="key dash" style="--c:var(--s1)" {
                            (name) (format_args!(" at {y:.0} {}", self.unit))
                        }
                    }
                }
                @if let Some(drawing) = self.drawing(across) {
                    svg viewBox=(format_args!("0 0 {WIDTH} {HEIGHT}")) role="img"
                        aria-label=(format_args!("{} over {}", self.title, across.label))
                    {
                        (drawing)
                    }
                } @else {
                    p .note { "no samples" }
                }
            }
        }
    }

    /// The chart as an SVG file of its own, with title and key in it; `None` without samples.
    pub fn svg_file(&self, across: &Across) -> Option<String> {
        let drawing = self.drawing(across)?;
        let file = html! {
            svg xmlns="http://www.w3.org/2000/svg" width="960" height="500" viewBox="0 -20 480 250" {
                style {
                    (PreEscaped(STYLE.replace(".charts ", "")))
                    "svg{background:var(--card);font:12px system-ui,sans-serif}text{fill:var(--soft)}"
                }
                text x="52" y="-4" {
                    (self.heading())
                    @for (i, (name, _)) in self.series.iter().enumerate() {
                        tspan dx="12" fill=(format_args!("var(--s{i})")) { (name) }
                    }
                }
                (drawing)
            }
        };
        Some(file.into_string() + "\n")
    }

    /// Title, and unit with its prefix.
    fn heading(&self) -> String {
        let (_, prefix) = self.prefix();
        match format!("{prefix}{}", self.unit).as_str() {
            "" => self.title.to_owned(),
            unit => format!("{} [{unit}]", self.title),
        }
    }

    /// Whether a value can be drawn.
    fn usable(&self, y: f64) -> bool {
        y.is_finite() && (self.scale != Scale::Log || y > 0.0)
    }

    /// Smallest and largest value; the former is the larger one without any.
    fn extent(&self) -> (f64, f64) {
        let values = (self.series.iter()).flat_map(|(_, series)| series.iter().map(|&(_, y)| y));
        (values.chain(self.limit.map(|(_, y)| y)))
            .filter(|&y| self.usable(y))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), y| {
                (low.min(y), high.max(y))
            })
    }

    fn prefix(&self) -> (f64, &'static str) {
        match self.scale {
            Scale::Prefixed => prefix(self.extent().1),
            Scale::Linear | Scale::Whole | Scale::Log => (1.0, ""),
        }
    }

    /// Grid, labels and lines; `None` without samples.
    fn drawing(&self, across: &Across) -> Option<Markup> {
        let (low, high) = self.extent();
        if low > high {
            return None;
        }
        let (factor, _) = self.prefix();
        let layout = Layout {
            across,
            axis: ValueAxis::new(self.scale, low / factor, high / factor),
            factor,
        };
        Some(html! {
            (grid(&layout))
            @if let Some((_, y)) = self.limit {
                @let y = format!("{:.1}", layout.y(y));
                line .limit x1=(LEFT) x2=(WIDTH - RIGHT) y1=(y) y2=(y) {}
            }
            @for (i, (_, series)) in self.series.iter().enumerate() {
                (self.lines(&layout, i, series))
            }
        })
    }

    /// The lines of series `i`.
    fn lines(&self, layout: &Layout, i: usize, series: &Series) -> Markup {
        let dense = series.len() > DENSE;
        // Of a dense series the faint line has the extremes and the full one the mean.
        let lines = [
            (if dense { "s faint" } else { "s" }, decimate(series)),
            ("s", if dense { means(series) } else { Vec::new() }),
        ];
        html! {
            @for (class, points) in lines.iter().filter(|(_, points)| !points.is_empty()) {
                path class=(class) stroke=(format_args!("var(--s{i})")) d=(self.path(layout, points)) {}
            }
        }
    }

    /// A line through points, broken where a value cannot be drawn.
    fn path(&self, layout: &Layout, points: &[(f64, f64)]) -> String {
        let mut path = String::new();
        let mut pen = 'M';
        for &(t, y) in points {
            if self.usable(y) && t.is_finite() {
                // Writing to a string cannot fail.
                let _ = write!(path, "{pen}{:.1} {:.1}", layout.x(t), layout.y(y));
                pen = 'L';
            } else {
                pen = 'M';
            }
        }
        path
    }
}

/// Horizontal lines with their values, and the labels below.
fn grid(layout: &Layout) -> Markup {
    let floor = HEIGHT - BOTTOM;
    html! {
        @for (y, label) in &layout.axis.ticks {
            @let y = layout.height(*y);
            @let line = format!("{y:.1}");
            line .grid x1=(LEFT) x2=(WIDTH - RIGHT) y1=(line) y2=(line) {}
            text x=(LEFT - 7.0) y=(format_args!("{:.1}", y + 4.0)) text-anchor="end" { (label) }
        }
        @for (t, label) in &layout.across.axis.ticks {
            @let x = format!("{:.1}", layout.x(*t));
            line .grid x1=(x) x2=(x) y1=(floor) y2=(floor + 4.0) {}
            text x=(x) y=(floor + 18.0) text-anchor="middle" { (label) }
        }
        text x=(format_args!("{:.1}", (LEFT + WIDTH - RIGHT) / 2.0))
            y=(format_args!("{:.1}", HEIGHT - 4.0)) text-anchor="middle" { (layout.across.label) }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimation_keeps_extremes_gaps_and_order() {
        let mut series: Series = (0..100_000)
            .map(|i| (f64::from(i), f64::from(i % 7)))
            .collect();
        series[31_234].1 = 99.0;
        series[77_777].1 = -99.0;
        series[50_000].1 = f64::NAN;
        let thin = decimate(&series);
        assert!(thin.len() <= MAX_POINTS, "{}", thin.len());
        assert!(thin.contains(&(31_234.0, 99.0)) && thin.contains(&(77_777.0, -99.0)));
        assert_eq!(thin.iter().filter(|(_, y)| y.is_nan()).count(), 1);
        let finite: Vec<_> = thin.iter().filter(|(_, y)| y.is_finite()).collect();
        assert!(finite.windows(2).all(|w| w[0].0 < w[1].0));
        assert_eq!(decimate(&series[..MAX_POINTS]).len(), MAX_POINTS);
    }

    #[test]
    fn means_stay_within_their_gaps() {
        let series: Series = (0..4800)
            .map(|i| {
                (
                    f64::from(i),
                    if i == 2400 {
                        f64::NAN
                    } else {
                        f64::from(i / 2400)
                    },
                )
            })
            .collect();
        let means = means(&series);
        assert_eq!(means[0], (9.5, 0.0)); // 4800 samples in 240 stretches of 20
        assert_eq!(means.iter().filter(|(_, y)| y.is_nan()).count(), 1);
        assert!(
            means
                .iter()
                .all(|&(_, y)| y == 0.0 || y == 1.0 || y.is_nan())
        );
    }

    #[test]
    fn the_largest_value_chooses_the_prefix() {
        assert_eq!(prefix(2.5e6), (1e6, "M"));
        assert_eq!(prefix(0.0), (1.0, ""));
    }

    #[test]
    fn a_chart_of_whole_numbers_has_whole_ticks_on_both_axes() {
        // Means of counts over counts: 1.0, 1.5, 2.0 would be ticks of both.
        let series: Series = vec![(1.0, 0.4), (2.0, 1.3), (3.0, 1.9)];
        let ticks = |scale: Scale, whole: bool| -> Vec<String> {
            let chart = Chart {
                title: "leakers",
                unit: "",
                scale,
                series: &[("", &series)],
                limit: None,
            };
            let across = Across::values("stations", 1.0, 3.0, whole);
            let figure = chart.figure(&across).into_string();
            let texts = figure
                .split("</text>")
                .filter_map(|part| part.rsplit('>').next());
            texts
                .map(str::to_owned)
                .filter(|text| text.parse::<f64>().is_ok())
                .collect()
        };
        assert_eq!(ticks(Scale::Whole, true), ["0", "1", "2", "1", "2", "3"]);
        let broken = ticks(Scale::Linear, false);
        assert!(broken.iter().any(|tick| tick.contains('.')), "{broken:?}");
    }

    #[test]
    fn a_chart_is_a_figure_and_a_file() {
        let series: Series = vec![(0.0, 1.0), (1.0, f64::NAN), (2.0, 3.0)];
        let chart = Chart {
            title: "Miss <distance>",
            unit: "px",
            scale: Scale::Linear,
            series: &[("coarse", &series)],
            limit: Some(("limit", 2.0)),
        };
        let across = Across::from_zero("time [s]", 2.0);
        let figure = chart.figure(&across).into_string();
        assert!(
            figure.contains("<b>Miss &lt;distance&gt; [px]</b>"),
            "{figure}"
        );
        assert!(figure.contains("limit at 2 px") && figure.contains("class=\"limit\""));
        // A gap begins a new line.
        let path = figure.split(" d=\"").nth(1).expect("a path");
        let path = path.split('"').next().expect("its end");
        assert_eq!(path.matches('M').count(), 2, "{path}");
        let file = chart.svg_file(&across).expect("a file");
        assert!(file.starts_with("<svg xmlns=") && file.ends_with("</svg>\n"));
        assert!(file.contains(">coarse</tspan>"));
        let none = Chart {
            series: &[],
            limit: None,
            ..chart
        };
        assert!(none.svg_file(&across).is_none());
        assert!(none.figure(&across).into_string().contains("no samples"));
    }
}
