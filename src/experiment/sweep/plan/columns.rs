//! The columns of an experiment's table: figures that are kept, and no two of one name.

use super::factor::Factor;
use super::file::Experiment;
use crate::experiment::figures::{self, Kind};
use crate::experiment::sweep::run::OWN_COLUMNS;
use crate::scenario::{InputError, Places, Scenario};
use std::collections::BTreeSet;

/// What is kept where the file does not say it.
const USUAL: [&str; 9] = [
    "outcome",
    "time_to_acquire_s",
    "time_to_neutralise_s",
    "miss_distance_px.precise.mean",
    "dwell_s",
    "energy_j",
    "distractor_s",
    "wrong_object_s",
    "simulated_s",
];

/// Refuses two columns of one name.
pub(super) fn columns_apart(
    factors: &[Factor],
    figures: &[(String, Kind)],
    places: &Places,
) -> Result<(), InputError> {
    let mut taken: BTreeSet<&str> = OWN_COLUMNS.into_iter().collect();
    let kept = (figures.iter().enumerate())
        .map(|(index, (key, _))| (format!("keep[{index}]"), key.as_str(), "leave it out"));
    let factors = (factors.iter().enumerate()).map(|(index, factor)| {
        let place = format!("factors[{index}].name");
        (place, factor.name.as_str(), "give the factor another name")
    });
    for (place, name, mend) in kept.chain(factors) {
        if !taken.insert(name) {
            let what = format!("the table has a column '{name}' already: {mend}");
            return Err(places.refuse(&place, what));
        }
    }
    Ok(())
}

/// The figures that an experiment keeps, with their kinds.
pub(super) fn kept(
    experiment: &Experiment,
    scenario: &Scenario,
    places: &Places,
) -> Result<Vec<(String, Kind)>, InputError> {
    let usual = || USUAL.iter().map(|key| (*key).to_owned()).collect();
    let keys: Vec<String> = match experiment.keep.is_empty() {
        true => usual(),
        false => experiment.keep.clone(),
    };
    let kind = |(index, key): (usize, String)| {
        let kind = figures::kind(&key, scenario)
            .map_err(|wrong| places.refuse(&format!("keep[{index}]"), wrong))?;
        Ok((key, kind))
    };
    keys.into_iter().enumerate().map(kind).collect()
}
