//! All checks, by model.

mod air;
mod beam;
mod control;
mod flight;
mod heating;
mod light;
mod maths;
mod mount;
mod optics;
mod place;
pub(crate) mod screens;
mod tracking;
pub(crate) mod wave;

use crate::check::{Check, Fault};

/// Every check, models together in the order of the validation pages.
pub fn all() -> Vec<Check> {
    let mut all = [
        place::checks(),
        light::checks(),
        air::checks(),
        flight::checks(),
        beam::checks(),
        heating::checks(),
        wave::checks(),
        screens::checks(),
        optics::checks(),
        tracking::checks(),
        mount::checks(),
        control::checks(),
        maths::checks(),
    ]
    .concat();
    let models: Vec<&str> = all.iter().map(|check| check.model).collect();
    all.sort_by_key(|check| models.iter().position(|model| *model == check.model));
    all
}

/// The checks of some models, or all where none is named.
///
/// # Errors
/// A name that no check has.
pub fn of_models(names: &[String]) -> Result<Vec<Check>, Fault> {
    let all = all();
    for name in names {
        if !all.iter().any(|check| check.model == name) {
            let mut known: Vec<&str> = all.iter().map(|check| check.model).collect();
            known.dedup();
            return Err(Fault::Unknown {
                name: name.clone(),
                known: known.join(", "),
            });
        }
    }
    let wanted = |check: &Check| names.is_empty() || names.iter().any(|name| name == check.model);
    Ok(all.into_iter().filter(wanted).collect())
}
