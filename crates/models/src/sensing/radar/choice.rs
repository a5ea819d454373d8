//! Which of its tracks a radar points the search at.
//!
//! The one that is soonest at the asset, by a cost that grows with the time for which the search has looked there in vain: a bird
//! or a false track is left for the next, and come back to. A round in the order of threat was rejected: it leaves a UAV that the
//! cameras do not find at once for as long as all others take.

use std::collections::BTreeMap;

/// Time of looking in vain that doubles a track's cost [s]: a gaze or two of each camera. Chosen.
const IN_VAIN_S: f64 = 4.0;
/// Another must be cheaper by this factor. Chosen.
const HYSTERESIS: f64 = 1.5;

/// What a radar points at.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CueChoice {
    /// The track that it points at.
    pub chosen: Option<usize>,
    /// How long the search has looked at each in vain [s].
    in_vain_s: BTreeMap<usize, f64>,
}

impl CueChoice {
    /// Counts time that was searched at the chosen track without a target [s].
    pub fn searched(&mut self, passed_s: f64) {
        if let Some(chosen) = self.chosen {
            *self.in_vain_s.entry(chosen).or_default() += passed_s;
        }
    }

    /// Chooses among tracks, each with its number and the time until it is at the asset [s].
    pub fn choose(&mut self, tracks: &[(usize, f64)]) {
        let known = |number: &usize| tracks.iter().any(|(track, _)| track == number);
        self.in_vain_s.retain(|number, _| known(number));
        self.chosen = self.chosen.filter(known);
        let cost_s = |(number, threat_s): &(usize, f64)| {
            let in_vain_s = self.in_vain_s.get(number).copied().unwrap_or_default();
            let present = if self.chosen == Some(*number) {
                1.0 / HYSTERESIS
            } else {
                1.0
            };
            present * threat_s * (1.0 + in_vain_s / IN_VAIN_S)
        };
        let cheapest =
            (tracks.iter()).min_by(|a, b| cost_s(a).total_cmp(&cost_s(b)).then(a.0.cmp(&b.0)));
        self.chosen = cheapest.map(|(number, _)| *number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_threat_first_and_what_is_looked_at_in_vain_later() {
        let mut choice = CueChoice::default();
        let tracks = [(4, 60.0), (7, 30.0)];
        choice.choose(&tracks);
        assert_eq!(choice.chosen, Some(7));
        let mut turns = Vec::new();
        for _ in 0..600 {
            choice.searched(0.1);
            choice.choose(&tracks);
            if turns.last() != choice.chosen.as_ref() {
                turns.extend(choice.chosen);
            }
        }
        assert!(turns.starts_with(&[7, 4, 7]), "{turns:?}");
        assert!(turns.len() < 12, "{turns:?}");
        choice.choose(&[]);
        assert_eq!(choice.chosen, None);
    }
}
