//! Rules of engagement, interlocks and fire.

use crate::components::beam::LaserSource;
use crate::components::engage::{Burst, Interlocks, Rules};
use crate::components::run::{PartError, RunScenario, SetUp, Tick, TickSet};
use crate::plugins::run::fallible;
use crate::scenario::Backstop;
use crate::systems::engage as systems;
use bevy::prelude::*;

/// Adds the domain to both schedules, in [`TickSet::Engage`].
pub struct EngagePlugin;

impl Plugin for EngagePlugin {
    fn build(&self, app: &mut App) {
        app.add_systems(SetUp, fallible(set_up).in_set(TickSet::Engage))
            .add_systems(Tick, systems::decide_fire.in_set(TickSet::Engage));
    }
}

fn set_up(
    mut commands: Commands,
    loaded: Res<RunScenario>,
    stations: Query<(Entity, &LaserSource)>,
) -> Result<(), PartError> {
    let engage = &loaded.scenario.engage;
    let mut keep_out = Vec::new();
    for (index, zone) in engage.keep_out.iter().enumerate() {
        let place = format!("engage.keep_out[{index}]");
        keep_out.push((zone.zone()).ok_or_else(|| loaded.refuse(&place, "has no shape"))?);
    }
    for (station, source) in &stations {
        let rules = Rules {
            authorised: engage.authorised,
            keep_out: keep_out.clone(),
            sun_exclusion_rad: engage.sun_exclusion_deg.to_radians(),
            min_uav_probability: engage.min_uav_probability,
            max_span_m: engage.max_span_m,
            look_ahead_s: engage.look_ahead_s,
            beam_radius_m: source.laser.aperture_radius_m,
            allow_sky: engage.allow_backstop.contains(&Backstop::Sky),
            allow_ground: engage.allow_backstop.contains(&Backstop::Ground),
            allow_building: engage.allow_backstop.contains(&Backstop::Building),
            min_clear_range_m: engage.min_clear_range_m,
            max_burst_s: engage.max_burst_s,
            pause_s: 1.0, // [s]
        };
        commands
            .entity(station)
            .insert((rules, Interlocks::default(), Burst::default()));
    }
    Ok(())
}
