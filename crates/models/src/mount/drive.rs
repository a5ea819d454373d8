//! What the bearings and the motor of an axis do to its torque: dry friction, before and in sliding,
//! and cogging.

/// Dry friction of an axis's bearings and seals, at the rotor.
///
/// Bristles stand for the contacts, as in the LuGre model (Canudas de Wit, Olsson, Åström and
/// Lischinsky 1995): their mean deflection z follows dz/dt = ω − σ |ω| z/g(ω), and the torque is
/// σ z + σ₁ dz/dt. At rest the axis is held by a spring that gives way more and more up to breakaway; in
/// sliding the torque is g(ω). The bristles' damping σ₁ fades with Stribeck's Gaussian, so that it never
/// makes friction a source of energy (passivity: Barabanov and Ortega 2000).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Friction {
    /// Torque in motion [N m].
    pub coulomb_nm: f64,
    /// Torque at rest, which must be overcome to move [N m].
    pub breakaway_nm: f64,
    /// Rate over which the torque falls from the one to the other [rad/s].
    pub stribeck_radps: f64,
    /// Deflection of the bristles at breakaway [rad]; 0 holds the axis rigidly until it breaks away.
    pub presliding_rad: f64,
    /// Damping of the bristles at rest [N m s/rad].
    pub bristle_nms: f64,
}

impl Friction {
    /// Most torque [N m] that dry friction opposes to a rotor at `rate_radps`: Stribeck's curve
    /// with a Gaussian, g = F_C + (F_S − F_C) exp(−(ω/ω_S)²) (Armstrong-Hélouvry, Dupont and Canudas
    /// de Wit 1994).
    pub fn level_nm(&self, rate_radps: f64) -> f64 {
        let x = rate_radps / self.stribeck_radps;
        self.coulomb_nm + (self.breakaway_nm - self.coulomb_nm) * (-x * x).exp()
    }

    /// Torque [N m] over a substep of `dt_s` [s] and the bristles' deflection [rad] at its end, from their
    /// deflection and the rotor's rate [rad/s] at its start.
    ///
    /// The rotor's rate at the end is `free_radps` less `gain` times the torque: the torque is the one that this
    /// end demands (implicit, so that a true state of rest exists), at most the level.
    pub(super) fn torque_nm(
        &self,
        bristle_rad: f64,
        rate_radps: f64,
        free_radps: f64,
        gain: f64,
        dt_s: f64,
    ) -> (f64, f64) {
        let most_nm = self.level_nm(rate_radps);
        if self.presliding_rad == 0.0 || self.breakaway_nm == 0.0 {
            return ((free_radps / gain).clamp(-most_nm, most_nm), 0.0);
        }
        let stiffness = self.breakaway_nm / self.presliding_rad;
        let slow = (-(rate_radps / self.stribeck_radps).powi(2)).exp();
        // dz/dt by the end's rate, the wear |ω|/g by the start's.
        let damping = self.bristle_nms * slow / dt_s;
        let spring = stiffness + damping;
        let wear = 1.0 + dt_s * stiffness * rate_radps.abs() / most_nm;
        let per_rate = spring * dt_s / wear;
        let held_nm = spring * bristle_rad / wear - damping * bristle_rad;
        let torque_nm = (held_nm + per_rate * free_radps) / (1.0 + per_rate * gain);
        let torque_nm = torque_nm.clamp(-most_nm, most_nm);
        (torque_nm, (torque_nm + damping * bristle_rad) / spring)
    }
}

/// Cogging of a motor: a torque that comes again with every pole as the rotor turns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cogging {
    /// Amplitude [N m].
    pub torque_nm: f64,
    /// Periods in a turn: the least common multiple of slots and poles.
    pub per_turn: f64,
}

impl Cogging {
    /// Torque [N m] on a rotor at `angle_rad` from the base.
    pub fn at_nm(&self, angle_rad: f64) -> f64 {
        self.torque_nm * (self.per_turn * angle_rad).sin()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bearings_without_friction_give_none() {
        let none = Friction {
            coulomb_nm: 0.0,
            breakaway_nm: 0.0,
            stribeck_radps: 2e-3,
            presliding_rad: 2e-4,
            bristle_nms: 0.0,
        };
        assert_eq!(none.torque_nm(0.0, 0.0, 0.1, 1e-4, 1e-3), (0.0, 0.0));
        assert_eq!(none.torque_nm(0.0, 0.1, 0.1, 1e-4, 1e-3), (0.0, 0.0));
    }
}
