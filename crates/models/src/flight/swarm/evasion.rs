//! Evasion: when a member evades, and how it jinks.

use super::behaviour::Behaviour;
use super::member::Steering;
use glam::{DVec2, DVec3};

/// Acceleration of a jink [m/s²], and the longest time to one side [s].
const JINK_MPS2: f64 = 5.0;
const JINK_S: f64 = 1.2;
/// How long a member goes on evading after the beam has left it [s].
const EVADING_S: f64 = 2.0;
/// Irradiance that a UAV notices [W/m²]: ten suns.
const NOTICED_WPM2: f64 = 1e4;

impl Steering {
    /// Whether it evades, now that its skin senses so much [W/m²].
    pub(super) fn evading(
        &mut self,
        behaviour: &Behaviour,
        t_s: f64,
        irradiance_wpm2: f64,
    ) -> bool {
        if irradiance_wpm2 > NOTICED_WPM2 && !behaviour.evasion.is_empty() {
            self.evades_until_s = t_s + EVADING_S;
        }
        t_s < self.evades_until_s
    }

    /// Its sideways acceleration in a jink [m/s²].
    pub(super) fn jink_mps2(&mut self, t_s: f64) -> DVec3 {
        if t_s >= self.jink.1 {
            let side = if self.rng.uniform() < 0.5 { -1.0 } else { 1.0 };
            self.jink = (side * JINK_MPS2, t_s + self.rng.range(0.4, JINK_S));
        }
        let v_enu_mps = self.reference.v_enu_mps;
        let left = v_enu_mps.truncate().normalize_or(DVec2::Y).perp();
        self.jink.0 * left.extend(0.0)
    }
}
