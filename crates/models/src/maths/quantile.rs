//! Quantiles of samples.

/// The quantile at `share`, 0 to 1, of samples in ascending order: Hyndman and Fan's rule 7 (Am.
/// Stat. 50, 361, 1996), linear between the samples at the ranks 0 to n - 1; `None` without any.
pub fn quantile(ascending: &[f64], share: f64) -> Option<f64> {
    let last = ascending.len().checked_sub(1)?;
    let rank = share.clamp(0.0, 1.0) * last as f64;
    let low = rank.floor() as usize;
    let (below, above) = (ascending[low], ascending[(low + 1).min(last)]);
    Some(below + rank.fract() * (above - below))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_rule_7() {
        // R: quantile(c(1, 2, 4, 8), c(0, 0.1, 0.5, 0.9, 1), type = 7).
        let samples = [1.0, 2.0, 4.0, 8.0];
        for (share, expected) in [(0.0, 1.0), (0.1, 1.3), (0.5, 3.0), (0.9, 6.8), (1.0, 8.0)] {
            let found = quantile(&samples, share).unwrap();
            assert!((found - expected).abs() < 1e-12, "{share}: {found}");
        }
        assert_eq!(quantile(&[5.0], 0.3), Some(5.0));
        assert_eq!(quantile(&[], 0.5), None);
    }
}
