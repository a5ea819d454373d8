//! What is kept for judging, and so must not be in what networks learn from.

use crate::models::ground::city::JUDGED_SEEDS;
use crate::scenario::{InputError, Loaded, catalogue};

/// Refuses a scenario to learn from that shows a city or a UAV which is kept for judging.
pub fn refuse_kept(loaded: &Loaded) -> Result<(), InputError> {
    let city = &loaded.scenario.city;
    if !city.is_real() && JUDGED_SEEDS.contains(&city.seed) {
        let why = format!(
            "city {} is kept for judging: nothing learns from {} to {}; give another seed",
            city.seed,
            JUDGED_SEEDS.start,
            JUDGED_SEEDS.end - 1
        );
        return Err(loaded.refuse("city.seed", why));
    }
    for (index, uav) in loaded.scenario.uavs.iter().enumerate() {
        // One that cannot be read is refused by the run, with its line.
        if catalogue::load(&uav.model).is_ok_and(|model| model.held_out) {
            let why = catalogue::held_out_words(&uav.model);
            return Err(loaded.refuse(&format!("uavs[{index}].model"), why));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
