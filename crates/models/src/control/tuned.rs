//! The tuned pointing law: from a predicted line of sight to gimbal and mirror commands.
//!
//! Both actuators work against the *same* prediction in the *same* estimated base frame in which
//! the camera's measurements were turned into lines of sight, so a small constant error of the
//! encoders, the base attitude or the camera's mounting cancels to first order: it is in the
//! measurement and in the command alike. An offset between laser and precise camera does not.
//!
//! - Gimbal: rate of the predicted line of sight seen from the moving base, plus a proportional
//!   term on the angle still to turn.
//! - Mirror: the whole deflection from where the gimbal will look to the predicted line of sight. It
//!   needs no integrator. Because the gimbal closes on the line of sight itself and not on
//!   the camera's residual, the mirror is unloaded (returns to its centre) at the rate of the gimbal's
//!   proportional gain without a separate path.
//! - Both start and stop without a jump: see [`HandOver`](super::law::HandOver).
//!
//! Measured in the closed loop of the tests of `pointing` (`tuning_study` and `error_budget`: 1 km, 8 m/s
//! straight, 120 Hz, 27 µrad noise per axis, 30 ms latency, default base motion and mount), rms of the
//! true error in µrad: this law 8.8; without the mirror 9.8; without the gyro 68; without
//! prediction over the latency 280; without feed-forward and mirror 520; the paper's eq. 9 through
//! the same servo 1,680. With a tenth of a pixel of noise it is 1.8. What is then left is mostly the
//! walk of the base gyro, which comes in through the filter.

use super::law::{Aim, HandOver, PointingInput, PointingOutput};
use super::pointing::PointingLaw;
use crate::mount::gimbal::{GimbalCommand, GimbalParams};

/// Gains of the tuned pointing law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TunedPointing {
    /// Gimbal rate per angle still to turn [1/s].
    pub gimbal_gain_per_s: f64,
    /// Time from a tick's command to the moment for which it aims the line of sight [s]: a whole
    /// number of ticks, one unless the mirror is slow.
    pub lead_s: f64,
    /// What of the mirror's motion remains after the lead.
    pub mirror_left: MirrorRemainder,
}

/// What remains of a mirror's motion after the lead under a held command: its offset from the command
/// is then `offset` times the present one plus `rate_s` times the present rate.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MirrorRemainder {
    /// Share of the offset.
    pub offset: f64,
    /// Offset for each unit of the rate [s].
    pub rate_s: f64,
}

impl PointingLaw for TunedPointing {
    fn lead_s(&self) -> f64 {
        self.lead_s
    }

    fn command(
        &mut self,
        hand_over: &mut HandOver,
        gimbal: &GimbalParams,
        input: &PointingInput,
    ) -> PointingOutput {
        let aim = Aim::new(gimbal, input, self.lead_s);
        let gains = [self.gimbal_gain_per_s; 2];
        let rates = hand_over.gimbal_rates(gimbal, gains, &aim, input.gimbal_rates_radps);
        // The command that, held over the lead, leaves the mirror at the set deflection.
        let set = hand_over.mirror(aim.deflection_rad);
        let MirrorRemainder { offset, rate_s } = self.mirror_left;
        let mirror_rad =
            (set - offset * input.mirror_rad - rate_s * input.mirror_rates_radps) / (1.0 - offset);
        PointingOutput {
            gimbal: GimbalCommand {
                rate_radps: rates.to_array(),
            },
            mirror_rad,
        }
    }

    fn gimbal_gain_per_s(&mut self) -> Option<&mut f64> {
        Some(&mut self.gimbal_gain_per_s)
    }

    fn gains(&self) -> Vec<(&'static str, f64)> {
        vec![
            ("gimbal gain [1/s]", self.gimbal_gain_per_s),
            ("lead [s]", self.lead_s),
            ("mirror offset left", self.mirror_left.offset),
            ("mirror rate left [s]", self.mirror_left.rate_s),
        ]
    }
}
