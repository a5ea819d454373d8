//! How the buildings of a city slow the wind: roughness length and displacement height.
//!
//! Grimmond and Oke, "Aerodynamic properties of urban areas derived from analysis of surface form",
//! J. Appl. Meteorol. 38 (1999), compare the methods: the rule of thumb (a tenth and 0.7 of the mean height), and
//! the one of Macdonald, Griffiths and Hall, Atmos. Environ. 32 (1998), eq. 23 and 26, from the shares of plan and
//! frontal area.

/// What is known of the shape of a city's buildings.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Roughness {
    /// Mean height of the buildings [m].
    pub mean_height_m: f64,
    /// Shares of the built area; absent: the rule of thumb.
    pub shares: Option<AreaShares>,
}

/// Shares of the area that buildings stand on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AreaShares {
    /// Their plan area to all area, 0..1.
    pub plan: f64,
    /// The area that they turn to the wind to all area, the mean of several winds.
    pub frontal: f64,
}

impl Roughness {
    /// That of buildings of these heights [m], by the rule of thumb.
    pub fn of_heights(heights_m: impl ExactSizeIterator<Item = f64>) -> Self {
        let count = heights_m.len().max(1);
        Self {
            mean_height_m: heights_m.sum::<f64>() / count as f64,
            shares: None,
        }
    }

    /// Height of the zero plane of the wind profile over the ground [m].
    pub fn displacement_m(&self) -> f64 {
        /// Macdonald's constant of staggered cubes.
        const A: f64 = 4.43;
        match self.shares {
            None => 0.7 * self.mean_height_m,
            Some(AreaShares { plan, .. }) => {
                self.mean_height_m * (1.0 + A.powf(-plan) * (plan - 1.0))
            }
        }
    }

    /// Roughness length [m], within what land can have.
    pub fn length_m(&self) -> f64 {
        /// Drag coefficient of a cube, and von Kármán's constant.
        const DRAG: f64 = 1.2;
        const KARMAN: f64 = 0.4;
        let length_m = match self.shares {
            None => 0.1 * self.mean_height_m,
            Some(AreaShares { frontal, .. }) => {
                let above = 1.0 - self.displacement_m() / self.mean_height_m.max(1e-9);
                let drag = 0.5 * DRAG / KARMAN.powi(2) * above * frontal;
                self.mean_height_m * above * (-drag.max(1e-9).powf(-0.5)).exp()
            }
        };
        length_m.clamp(0.03, 2.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rule_of_thumb_is_a_tenth_and_seven_tenths() {
        let flat = Roughness::of_heights([10.0, 20.0].into_iter());
        assert_eq!(flat.mean_height_m, 15.0);
        assert!((flat.length_m() - 1.5).abs() < 1e-12);
        assert!((flat.displacement_m() - 10.5).abs() < 1e-12);
        assert_eq!(Roughness::of_heights([].into_iter()).length_m(), 0.03);
    }

    /// Macdonald et al. (1998), figure 6: staggered cubes, both shares alike: z0/H peaks at some 0.15 near a
    /// share of 0.15 to 0.2, d/H there is a third or so, and both go to 0 and 1 at the ends.
    #[test]
    fn macdonalds_curve_peaks_where_published() {
        let of = |share: f64| Roughness {
            mean_height_m: 10.0,
            shares: Some(AreaShares {
                plan: share,
                frontal: share,
            }),
        };
        let best = (1..60).max_by(|a, b| {
            let length_m = |k: i32| of(f64::from(k) / 100.0).length_m();
            length_m(*a).total_cmp(&length_m(*b))
        });
        assert!((14..=24).contains(&best.unwrap()), "{best:?}");
        let peak = of(0.18).length_m() / 10.0;
        assert!((0.11..0.16).contains(&peak), "{peak}");
        // By hand: 1 + 4.43^-0.25 · (0.25 - 1) = 0.4831.
        assert!((of(0.25).displacement_m() - 4.831).abs() < 2e-3);
        assert!(of(0.99).displacement_m() > 9.9);
        assert_eq!(of(0.0).displacement_m(), 0.0);
    }
}
