//! Birds: their measures, and how their wings move.
//!
//! Lengths and spans lie within the ranges of species' handbooks (Cramp & Simmons, Birds of the
//! Western Palearctic; recalled). Wingbeats follow Pennycuick, J. Exp. Biol. 199, 1613 (1996), within
//! the 0.6 to 1.1 of his formula that birds in cruise keep (test). Angles, shares of gliding and the
//! lengths of bouts are assumptions, typical of the species.

use crate::flight::multirotor::MAX_ROTORS;
use crate::maths::kinematics::GRAVITY_MPS2;
use std::f64::consts::TAU;

/// A species of bird.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Species {
    /// Bill to tail [m].
    pub length_m: f64,
    /// From wing tip to wing tip [m].
    pub span_m: f64,
    /// Wingbeats a second.
    pub wingbeat_hz: f64,
    /// Mean angle of the arms above the level while they beat [rad].
    pub mean_rad: f64,
    /// How far the arms beat to both sides of it [rad].
    pub beat_rad: f64,
    /// Angle of the arms above the level in a glide [rad].
    pub glide_rad: f64,
    /// Angle of the hands above the arms in a glide [rad].
    pub hand_rad: f64,
    /// Share of the time in which the wings beat.
    pub flap_share: f64,
    /// Time from one bout of beating to the next [s].
    pub bout_s: f64,
}

/// Herring gull.
pub const GULL: Species = Species {
    length_m: 0.60,
    span_m: 1.35,
    wingbeat_hz: 3.1,
    mean_rad: 0.14,
    beat_rad: 0.52,
    glide_rad: 0.20,
    hand_rad: -0.28,
    flap_share: 0.75,
    bout_s: 6.0,
};
/// Carrion crow.
pub const CROW: Species = Species {
    length_m: 0.47,
    span_m: 0.92,
    wingbeat_hz: 4.2,
    mean_rad: 0.10,
    beat_rad: 0.55,
    glide_rad: 0.08,
    hand_rad: 0.0,
    flap_share: 0.9,
    bout_s: 5.0,
};
/// Feral pigeon.
pub const PIGEON: Species = Species {
    length_m: 0.33,
    span_m: 0.67,
    wingbeat_hz: 6.0,
    mean_rad: 0.15,
    beat_rad: 0.75,
    glide_rad: 0.35,
    hand_rad: 0.0,
    flap_share: 0.85,
    bout_s: 4.0,
};
/// Common swift.
pub const SWIFT: Species = Species {
    length_m: 0.17,
    span_m: 0.42,
    wingbeat_hz: 8.0,
    mean_rad: 0.0,
    beat_rad: 0.6,
    glide_rad: -0.05,
    hand_rad: -0.08,
    flap_share: 0.5,
    bout_s: 1.6,
};
/// Greylag goose.
pub const GOOSE: Species = Species {
    length_m: 0.82,
    span_m: 1.64,
    wingbeat_hz: 4.0,
    mean_rad: 0.08,
    beat_rad: 0.45,
    glide_rad: -0.05,
    hand_rad: -0.10,
    flap_share: 1.0,
    bout_s: 10.0,
};
/// Common buzzard, soaring.
pub const BUZZARD: Species = Species {
    length_m: 0.54,
    span_m: 1.22,
    wingbeat_hz: 3.0,
    mean_rad: 0.10,
    beat_rad: 0.45,
    glide_rad: 0.17,
    hand_rad: 0.06,
    flap_share: 0.10,
    bout_s: 14.0,
};

impl Species {
    /// How much of its full beat it gives at `t_s` (0: it glides), and the rate of that [1/s];
    /// `phase_rad` (0 to 2 pi) shifts its bouts.
    pub fn effort(&self, t_s: f64, phase_rad: f64) -> [f64; 2] {
        if self.flap_share >= 1.0 {
            return [1.0, 0.0];
        }
        // It starts and stops within a beat.
        let ramp = 1.0 / (self.wingbeat_hz * self.bout_s);
        let at = (t_s / self.bout_s + phase_rad / TAU).rem_euclid(1.0);
        let smooth = |x: f64| {
            let x = x.clamp(0.0, 1.0);
            [x * x * (3.0 - 2.0 * x), 6.0 * x * (1.0 - x)]
        };
        let [rise, rising] = smooth(at / ramp);
        let [fall, falling] = smooth((at - self.flap_share + ramp) / ramp);
        let rate = rising * (1.0 - fall) - rise * falling;
        [rise * (1.0 - fall), rate / (ramp * self.bout_s)]
    }

    /// Phase of the wingbeat at `t_s` [rad]; 0: wings up.
    pub fn beat_rad(&self, t_s: f64, phase_rad: f64) -> f64 {
        phase_rad + TAU * self.wingbeat_hz * t_s
    }

    /// How far the beat lifts the body [m], and how fast [m/s].
    ///
    /// The downstroke carries everything: lift is `m g (1 + sin(beat))`, so the body heaves by
    /// `-g/omega^2 sin(beat)`, 2.6 cm at 3.1 Hz (the lift's first harmonic; assumption).
    pub fn heave(&self, t_s: f64, phase_rad: f64) -> [f64; 2] {
        let omega_radps = TAU * self.wingbeat_hz;
        let (sin, cos) = self.beat_rad(t_s, phase_rad).sin_cos();
        let [effort, rate] = self.effort(t_s, phase_rad);
        let most_m = GRAVITY_MPS2 / (omega_radps * omega_radps);
        [
            -most_m * effort * sin,
            -most_m * (effort * omega_radps * cos + rate * sin),
        ]
    }

    /// Angles of its wings' joints [rad], as [`Self::joints`] numbers them.
    pub fn wings_rad(&self, t_s: f64, phase_rad: f64) -> [f64; MAX_ROTORS] {
        // The hands trail the arms by a sixth of a beat, and beat half as far again (assumption).
        const TRAIL_RAD: f64 = TAU / 6.0;
        const HAND: f64 = 0.5;
        let beat = self.beat_rad(t_s, phase_rad);
        let [effort, _] = self.effort(t_s, phase_rad);
        let mix = |rest: f64, mean: f64, swing: f64| rest + effort * (mean - rest + swing);
        Self::joints(
            mix(self.glide_rad, self.mean_rad, self.beat_rad * beat.cos()),
            mix(
                self.hand_rad,
                0.5 * self.hand_rad,
                HAND * self.beat_rad * (beat - TRAIL_RAD).cos(),
            ),
        )
    }

    /// Phases of the four joints of wings whose arms and hands are lifted so far [rad]: left arm,
    /// right arm, left hand, right hand.
    pub fn joints(arm_rad: f64, hand_rad: f64) -> [f64; MAX_ROTORS] {
        let mut phases = [0.0; MAX_ROTORS];
        phases[..4].copy_from_slice(&[arm_rad, -arm_rad, hand_rad, -hand_rad]);
        phases
    }

    /// The greatest angle of the arms and of the hands to either side of the level [rad].
    pub fn reach_rad(&self) -> [f64; 2] {
        let beat = self.mean_rad.abs() + self.beat_rad;
        [
            beat.max(self.glide_rad.abs()),
            0.5 * self.beat_rad + self.hand_rad.abs(),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wingbeats_are_the_published_ones() {
        // Pennycuick 1996: f = m^3/8 g^1/2 b^-23/24 S^-1/3 rho^-3/8 with handbook masses [kg] and
        // wing areas [m^2].
        for (species, mass_kg, area_m2) in [
            (GULL, 1.0_f64, 0.20_f64),
            (CROW, 0.5, 0.12),
            (PIGEON, 0.32, 0.063),
            (SWIFT, 0.042, 0.0165),
            (GOOSE, 3.3, 0.37),
            (BUZZARD, 0.9, 0.22),
        ] {
            let predicted_hz = mass_kg.powf(3.0 / 8.0)
                * GRAVITY_MPS2.sqrt()
                * species.span_m.powf(-23.0 / 24.0)
                * area_m2.powf(-1.0 / 3.0)
                * 1.225_f64.powf(-3.0 / 8.0);
            let share = species.wingbeat_hz / predicted_hz;
            assert!((0.6..1.1).contains(&share), "{species:?}: {predicted_hz}");
        }
    }

    #[test]
    fn wings_beat_for_their_share_of_the_time_and_rest_in_between() {
        for species in [GULL, CROW, PIGEON, SWIFT, GOOSE, BUZZARD] {
            let (mut beating, mut still) = (0.0, 0);
            const STEPS: u32 = 20_000;
            let [most_arm, most_hand] = species.reach_rad();
            for i in 0..STEPS {
                let t_s = 3.0 * species.bout_s * f64::from(i) / f64::from(STEPS);
                let [effort, rate] = species.effort(t_s, 1.0);
                let ahead = species.effort(t_s + 1e-6, 1.0)[0];
                assert!(((ahead - effort) / 1e-6 - rate).abs() < 0.05, "{species:?}");
                beating += effort / f64::from(STEPS);
                let [left, right, hand, _, rest, ..] = species.wings_rad(t_s, 1.0);
                assert!(left == -right && rest == 0.0);
                assert!(left.abs() <= most_arm + 1e-12 && hand.abs() <= most_hand + 1e-12);
                still += u32::from(effort == 0.0 && left == species.glide_rad);
            }
            let ramp = 1.0 / (species.wingbeat_hz * species.bout_s);
            let share = if species.flap_share < 1.0 {
                species.flap_share - ramp
            } else {
                1.0
            };
            assert!((beating - share).abs() < 0.01, "{species:?}: {beating}");
            assert_eq!(still > 0, species.flap_share < 1.0);
        }
    }
}
