//! Whether what the tracker believes of its tracks is right: how often what it holds to be a UAV with some probability is one, and
//! what each term is worth beside the others.

use super::job::Outcome;
use super::verdict::{Believed, What};
use crate::models::decision::belief::{Belief, Term};
use crate::models::maths::logistic::{Case, weights};
use crate::models::maths::statistics::Rate;
use serde::Serialize;

/// Bounds of the probabilities that are counted together.
const BOUNDS: [f64; 9] = [0.0, 0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.98, 1.0];
/// What speaks stronger than this counts as this: beyond, nothing is decided by it.
const MOST: f64 = 8.0;
/// A term that says something in fewer beliefs has no weight.
const LEAST_SAID: usize = 20;
/// Numbers of a case: one, and each term.
const NUMBERS: usize = 1 + Term::ALL.len();

impl Believed {
    /// What was believed of what is so.
    pub fn new(what: What, belief: &Belief) -> Self {
        let terms = belief.0.map(|says| (100.0 * says).round() / 100.0);
        Self { what, terms }
    }

    fn is_uav(&self) -> bool {
        self.what == What::Uav
    }

    fn probability(&self) -> f64 {
        Belief(self.terms).probability()
    }

    fn case(&self) -> Case<NUMBERS> {
        let of = |i: usize| match i {
            0 => 1.0,
            term => self.terms[term - 1].clamp(-MOST, MOST),
        };
        (std::array::from_fn(of), self.is_uav())
    }
}

/// How right the beliefs were.
#[derive(Serialize)]
pub struct Calibration {
    /// By what was believed: from and to which probability, and how many were UAVs.
    pub bins: Vec<Bin>,
    /// What each term is worth.
    pub terms: Vec<TermWorth>,
}

/// Beliefs of about the same probability.
#[derive(Serialize)]
pub struct Bin {
    /// Lower and upper bound.
    pub probability: [f64; 2],
    /// Mean.
    pub mean: f64,
    /// How many of them were UAVs; cases of one track are alike, so that the interval is too narrow.
    pub uavs: Rate,
}

/// What a term is worth.
#[derive(Serialize)]
pub struct TermWorth {
    /// Its name; "prior" for what there is without any.
    pub name: &'static str,
    /// How many beliefs it says something in, and how many of them are of UAVs.
    pub says: Rate,
    /// By what its log-odds should be multiplied beside the others (the prior: added), and half of its 95 % interval, the
    /// engagements being the groups; absent where the data do not tell, or in too few beliefs.
    pub weight: Option<[f64; 2]>,
}

impl Calibration {
    /// That of all beliefs of some engagements.
    pub fn of(draws: &[Outcome]) -> Self {
        let all = || draws.iter().flat_map(|draw| &draw.record.beliefs);
        let bins = BOUNDS.windows(2).filter_map(|bounds| {
            let [from, to] = [bounds[0], bounds[1]];
            let within = |p: f64| p >= from && (p < to || to >= 1.0);
            let (mut sum, mut uavs) = (0.0, Vec::new());
            for believed in all() {
                let p = believed.probability();
                if within(p) {
                    sum += p;
                    uavs.push(believed.is_uav());
                }
            }
            (!uavs.is_empty()).then(|| Bin {
                probability: [from, to],
                mean: sum / uavs.len() as f64,
                uavs: Rate::count(uavs),
            })
        });
        let says = |term: Option<Term>| {
            let said = all().filter(|b| term.is_none_or(|term| b.terms[term as usize] != 0.0));
            Rate::count(said.map(Believed::is_uav))
        };
        let named = [("prior", None)]
            .into_iter()
            .chain(Term::ALL.map(|term| (term.name(), Some(term))));
        let cases = |draw: &Outcome| draw.record.beliefs.iter().map(Believed::case).collect();
        let groups: Vec<Vec<Case<NUMBERS>>> = draws.iter().map(cases).collect();
        let found = weights(&groups);
        let terms = named.enumerate().map(|(i, (name, term))| {
            let says = says(term);
            let told = found.as_ref().filter(|_| says.trials >= LEAST_SAID);
            TermWorth {
                name,
                weight: told.map(|weights| [weights[i].value, weights[i].half_95]),
                says,
            }
        });
        Self {
            bins: bins.collect(),
            terms: terms.collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::maths::logistic::probability;
    use crate::models::maths::rng::Stream;

    /// Draws of tracks whose looks are right, whose radar says twice what it should, and whose other terms say nothing.
    fn draws() -> Vec<Outcome> {
        let mut rng = Stream::new(1, 0, "belief");
        let mut believed = || {
            let (looks, radar) = (2.0 * rng.normal(), rng.normal());
            let p = probability(looks + radar);
            let what = if rng.uniform() < p {
                What::Uav
            } else {
                What::Scenery
            };
            Believed::new(what, &Belief([looks, 0.0, 2.0 * radar, 0.0]))
        };
        (0..200)
            .map(|_| {
                let mut outcome = super::super::results::tests::outcome(0, "default", false, true);
                outcome.record.beliefs = (0..20).map(|_| believed()).collect();
                outcome
            })
            .collect()
    }

    #[test]
    fn each_term_is_worth_what_it_tells() {
        let calibration = Calibration::of(&draws());
        let worth = |name: &str| {
            let found = calibration.terms.iter().find(|term| term.name == name);
            found.unwrap_or_else(|| panic!("{name}"))
        };
        for (name, truth) in [("prior", 0.0), ("looks", 1.0), ("radar", 0.5)] {
            let [value, half] = worth(name).weight.unwrap();
            assert!(
                (value - truth).abs() < 1.5 * half && half < 0.15,
                "{name}: {value} {half}"
            );
        }
        assert_eq!(worth("place").weight, None);
        assert_eq!(
            (worth("place").says.trials, worth("prior").says.trials),
            (0, 4000)
        );
        let counted: usize = calibration.bins.iter().map(|bin| bin.uavs.trials).sum();
        assert_eq!(counted, 4000);
        // Where the radar overstates, the surest are less often UAVs than they are believed to be.
        let last = calibration.bins.last().unwrap();
        assert!(last.uavs.rate.unwrap() < last.mean);
    }
}
