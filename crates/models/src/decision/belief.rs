//! Whether a track is a UAV, term by term.
//!
//! Each term is a log-odds by a sense of its own, so that they add up: what the cameras' looks make of it
//! ([`Track::log_odds`](crate::tracking::table::Track::log_odds)), where it stands, where a radar has a target, and how far
//! off it is by the range finder.

use crate::tracking::evidence::probability;

/// What the terms are by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Term {
    /// The cameras' looks: the detector's answers, or what the recogniser makes of them, and of what flies along.
    Looks,
    /// Where it stands: before scenery, without having flown.
    Place,
    /// Whether the radar has its target there.
    Radar,
    /// Its size, and what is behind it, by the range finder.
    Echo,
}

impl Term {
    /// All, as [`Belief`] has them.
    pub const ALL: [Self; 4] = [Self::Looks, Self::Place, Self::Radar, Self::Echo];

    /// What it is called.
    pub fn name(self) -> &'static str {
        match self {
            Self::Looks => "looks",
            Self::Place => "place",
            Self::Radar => "radar",
            Self::Echo => "echo",
        }
    }

    /// What it says against a track.
    pub fn against(self) -> &'static str {
        match self {
            Self::Looks => "it is not surely a UAV",
            Self::Place => "it stands before scenery",
            Self::Radar => "the radar has its target elsewhere",
            Self::Echo => {
                "it is too large, or a part of what stands behind it, by the range finder"
            }
        }
    }
}

/// Whether a track is a UAV, as log-odds by [`Term`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Belief(pub [f64; Term::ALL.len()]);

impl Belief {
    /// Of nothing: no numbers.
    pub const UNKNOWN: Self = Self([f64::NAN; Term::ALL.len()]);

    /// What all say together.
    pub fn log_odds(&self) -> f64 {
        self.0.iter().sum()
    }

    /// The probability of a UAV.
    pub fn probability(&self) -> f64 {
        probability(self.log_odds())
    }

    /// What all but one say together.
    pub fn without(&self, term: Term) -> f64 {
        self.log_odds() - self.0[term as usize]
    }

    /// In words: the probability, and each term that says something.
    pub fn in_words(&self) -> String {
        const LEAST: f64 = 0.05;
        let terms = Term::ALL.into_iter().zip(self.0);
        let says: Vec<String> = terms
            .filter(|(_, says)| says.abs() >= LEAST)
            .map(|(term, says)| format!("{} {says:+.1}", term.name()))
            .collect();
        let sure = 100.0 * self.probability();
        if says.is_empty() {
            format!("{sure:.0} %")
        } else {
            format!("{sure:.0} %: {}", says.join(", "))
        }
    }

    /// The term that speaks against it most, unless it is the looks' want of certainty alone.
    pub fn against(&self) -> Term {
        let mut least = Term::Looks;
        for term in Term::ALL {
            if self.0[term as usize] < self.0[least as usize].min(0.0) {
                least = term;
            }
        }
        least
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_name_what_says_something() {
        let belief = Belief([2.2, -0.7, 0.0, 0.01]);
        assert_eq!(belief.in_words(), "82 %: looks +2.2, place -0.7");
        assert_eq!(Belief::default().in_words(), "50 %");
    }

    #[test]
    fn the_term_against_is_the_least_below_zero() {
        assert_eq!(Belief([1.0, -3.0, -1.0, 0.0]).against(), Term::Place);
        assert_eq!(Belief([0.2, 0.0, 1.0, 0.0]).against(), Term::Looks);
        assert_eq!(Belief([-4.0, -3.0, 0.0, 0.0]).against(), Term::Looks);
    }
}
