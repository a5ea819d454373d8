//! Whether a track is a UAV, term by term.
//!
//! Each term is a log-odds by a sense of its own, so that they add up: what the cameras' looks make of it
//! ([`Track::log_odds`](crate::tracking::table::Track::log_odds)), where it stands, where a radar has a target, and how far
//! off it is by the range finder.

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

    /// What all but one say together.
    pub fn without(&self, term: Term) -> f64 {
        self.log_odds() - self.0[term as usize]
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
