//! Statistics of the miss distance.

use crate::models::maths::quantile::quantile;
use serde::Serialize;

/// Statistics of the miss distance \[px\]; quantiles interpolate linearly between the sorted samples
/// (Hyndman and Fan's rule 7).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
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
        let n = sorted.len();
        Some(Self {
            mean: sorted.iter().sum::<f64>() / n as f64,
            rms: (sorted.iter().map(|x| x * x).sum::<f64>() / n as f64).sqrt(),
            p50: quantile(&sorted, 0.5)?,
            p95: quantile(&sorted, 0.95)?,
            p99: quantile(&sorted, 0.99)?,
            n,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn miss_statistics_match_their_definition() {
        // 1 to 100: mean 50.5, rms sqrt(3383.5); rule 7 puts the quantile p at 1 + 99 p.
        let stats = MissStats::of((1..=100).rev().map(f64::from)).unwrap();
        assert!((stats.mean - 50.5).abs() < 1e-12);
        assert!((stats.rms - 3383.5f64.sqrt()).abs() < 1e-12);
        for (quantile, p) in [(stats.p50, 0.5), (stats.p95, 0.95), (stats.p99, 0.99)] {
            assert!(
                (quantile - (1.0 + 99.0 * p)).abs() < 1e-9,
                "{quantile} at {p}"
            );
        }
        assert_eq!(stats.n, 100);
        let one = MissStats::of([f64::NAN, 3.0]).unwrap();
        assert_eq!((one.n, one.p50, one.p99, one.rms), (1, 3.0, 3.0, 3.0));
        assert_eq!(MissStats::of([f64::NAN]), None);
    }
}
