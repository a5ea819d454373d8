//! The axes of charts: their ranges, and round ticks.

/// How a chart's values are mapped to its height.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// Linear over the range of the samples.
    Linear,
    /// The same of whole numbers, or of means of such: ticks at whole numbers alone.
    Whole,
    /// Linear from zero, with the unit's prefix chosen by size.
    Prefixed,
    /// Logarithmic; values of zero or less are gaps.
    Log,
}

/// An axis of a chart.
pub(super) struct ValueAxis {
    pub(super) log: bool,
    pub(super) low: f64,
    pub(super) high: f64,
    pub(super) ticks: Vec<(f64, String)>,
}

impl ValueAxis {
    pub(super) fn new(scale: Scale, low: f64, high: f64) -> Self {
        match scale {
            Scale::Log => Self::log(low, high),
            Scale::Prefixed => Self::linear(low.min(0.0), high),
            Scale::Linear => Self::linear(low, high),
            Scale::Whole => Self::whole(low, high),
        }
    }

    pub(super) fn linear(low: f64, high: f64) -> Self {
        let (low, high) = padded(low, high);
        Self {
            log: false,
            low,
            high,
            ticks: linear_ticks(low, high, MOST_TICKS),
        }
    }

    /// A linear axis of whole numbers, of which it holds at least two.
    pub(super) fn whole(low: f64, high: f64) -> Self {
        let (low, high) = (low.floor(), high.ceil());
        let (low, high) = padded(low, high.max(low + 1.0));
        let step = step(low, high, MOST_TICKS).unwrap_or(1.0).max(1.0);
        Self {
            log: false,
            low,
            high,
            ticks: ticks(low, high, step),
        }
    }

    pub(super) fn log(low: f64, high: f64) -> Self {
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
    pub(super) fn place(&self, y: f64) -> f64 {
        if self.log {
            (y / self.low).log10() / (self.high / self.low).log10()
        } else {
            (y - self.low) / (self.high - self.low)
        }
    }
}

/// Ticks of an axis, about.
const MOST_TICKS: usize = 6;

/// A range with a twentieth more at each end, but nothing below zero where no value is.
fn padded(low: f64, high: f64) -> (f64, f64) {
    // A constant still needs an axis with a height.
    let pad = if high > low {
        0.05 * (high - low)
    } else {
        0.5 * high.abs().max(1.0)
    };
    let below = match low >= 0.0 {
        true => (low - pad).max(0.0),
        false => low - pad,
    };
    (below, high + pad)
}

/// A tick label of a round number, without the noise of binary fractions.
fn short(x: f64) -> String {
    let text = format!("{x:.6}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// At most `count` or so round values within the range, with their labels.
pub(super) fn linear_ticks(low: f64, high: f64, count: usize) -> Vec<(f64, String)> {
    match step(low, high, count) {
        Some(step) => ticks(low, high, step),
        None => vec![(low, short(low))],
    }
}

/// The round step that goes at most `count` times or so into a range; `None` where that has no length.
fn step(low: f64, high: f64, count: usize) -> Option<f64> {
    let raw = (high - low) / count as f64;
    if !(raw.is_finite() && raw > 0.0) {
        return None;
    }
    let decade = 10f64.powf(raw.log10().floor());
    let mut round = [1.0, 2.0, 5.0, 10.0].map(|m| m * decade).into_iter();
    let enough = round.find(|step| *step >= raw * 0.999);
    Some(enough.unwrap_or(10.0 * decade))
}

/// The multiples of a step within a range, with their labels.
fn ticks(low: f64, high: f64, step: f64) -> Vec<(f64, String)> {
    let (first, last) = ((low / step).ceil() as i64, (high / step).floor() as i64);
    let decimals = (-step.log10().floor()).clamp(0.0, 9.0) as usize;
    (first..=last)
        .map(|i| (i as f64 * step, format!("{:.decimals$}", i as f64 * step)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(ticks: Vec<(f64, String)>) -> Vec<String> {
        ticks.into_iter().map(|tick| tick.1).collect()
    }

    #[test]
    fn ticks_are_round_and_within_the_range() {
        assert_eq!(
            labels(linear_ticks(0.0, 1.0, 5)),
            ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]
        );
        assert_eq!(labels(linear_ticks(285.0, 940.0, 6)), ["400", "600", "800"]);
        assert_eq!(labels(linear_ticks(0.0, 0.0, 6)), ["0"]);
        assert_eq!(
            labels(ValueAxis::log(0.3, 20.0).ticks),
            ["0.3", "1", "3", "10"]
        );
    }

    #[test]
    fn whole_numbers_have_whole_ticks_and_at_least_two() {
        let of = |low: f64, high: f64| labels(ValueAxis::whole(low, high).ticks);
        assert_eq!(of(1.0, 3.0), ["1", "2", "3"]);
        // Means of counts between two of them, and of a count that is always the same.
        assert_eq!(of(0.1, 0.35), ["0", "1"]);
        assert_eq!(of(2.0, 2.0), ["2", "3"]);
        assert_eq!(of(-1.2, 0.5), ["-2", "-1", "0", "1"]);
        assert_eq!(of(0.0, 64.0), ["0", "20", "40", "60"]);
        let axis = ValueAxis::whole(0.2, 2.4);
        for (tick, _) in &axis.ticks {
            assert!(tick.fract() == 0.0 && (axis.low..=axis.high).contains(tick));
        }
        // Those of other figures are as they were.
        assert_eq!(
            labels(ValueAxis::linear(1.0, 3.0).ticks),
            ["1.0", "1.5", "2.0", "2.5", "3.0"]
        );
    }

    #[test]
    fn no_axis_goes_below_zero_without_a_value_there() {
        assert_eq!(ValueAxis::linear(0.01, 1.0).low, 0.0);
        assert_eq!(ValueAxis::whole(1.0, 40.0).low, 0.0);
        assert!((ValueAxis::linear(10.0, 12.0).low - 9.9).abs() < 1e-12);
        assert!((ValueAxis::linear(-1.0, 1.0).low + 1.1).abs() < 1e-12);
    }
}
