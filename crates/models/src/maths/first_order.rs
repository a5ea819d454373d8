//! First-order lags stepped exactly.

/// (e⁻ˣ, (1 − e⁻ˣ)/x, (x − 1 + e⁻ˣ)/x²) for x ≥ 0: a first-order lag and its first two integrals,
/// accurate down to x = 0.
pub fn lag_integrals(x: f64) -> [f64; 3] {
    if x < 0.05 {
        // ψ = Σ (−x)ᵏ/(k+2)!, exact to rounding after eight terms here; then back up.
        let mut term = 0.5;
        let mut psi = 0.0;
        for k in 3..11 {
            psi += term;
            term *= -x / f64::from(k);
        }
        let phi = 1.0 - x * psi;
        [1.0 - x * phi, phi, psi]
    } else {
        let phi = -(-x).exp_m1() / x;
        [(-x).exp(), phi, (1.0 - phi) / x]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lag_integrals_match_their_definitions() {
        for x in [0.0f64, 1e-9, 1e-3, 0.0499, 0.0501, 1.0, 20.0] {
            let [e, phi, psi] = lag_integrals(x);
            assert!((e - (-x).exp()).abs() < 1e-15);
            // phi = ∫₀¹ e^{−xs} ds and psi = ∫₀¹ (1 − s) e^{−xs} ds, by Simpson.
            let n = 2000;
            let (mut a, mut b) = (0.0, 0.0);
            for k in 0..=n {
                let s = f64::from(k) / f64::from(n);
                let w = if k == 0 || k == n {
                    1.0
                } else {
                    f64::from(2 + 2 * (k % 2))
                };
                a += w * (-x * s).exp();
                b += w * (1.0 - s) * (-x * s).exp();
            }
            let h = 1.0 / (3.0 * f64::from(n));
            assert!(
                (phi - a * h).abs() < 1e-11 && (psi - b * h).abs() < 1e-11,
                "{x}"
            );
        }
    }
}
