//! The laser: propagation of the beam and heating of the target.

use crate::components::beam::{
    BeamSeeing, BeamState, FireCommand, LaserPauses, LaserSource, Propagations,
};
use crate::components::mount::Station;
use crate::components::run::{PartError, RunScenario, Seed, SetUp, SimClock, Tick, TickSet};
use crate::models::laser::beam::Laser;
use crate::models::laser::propagation::{PROPAGATIONS, PropagationContext, WaveSettings};
use crate::models::optics::seeing::{FrozenAir, Pupil, SEEING_STREAM};
use crate::plugins::run::fallible;
use crate::scenario::{Focus, suggestion};
use crate::systems::beam as systems;

use bevy::prelude::*;
use glam::DVec2;
use std::sync::Arc;

/// Adds the domain to both schedules, in [`TickSet::Beam`].
pub struct BeamPlugin;

impl Plugin for BeamPlugin {
    fn build(&self, app: &mut App) {
        let mut known = Propagations::default();
        for (name, make) in PROPAGATIONS {
            known.add(name, make);
        }
        app.insert_resource(known)
            .add_systems(SetUp, fallible(set_up).in_set(TickSet::Beam))
            .add_systems(
                Tick,
                (
                    systems::propagate,
                    systems::count_distractors,
                    systems::heat,
                )
                    .chain()
                    .in_set(TickSet::Beam),
            );
    }
}

/// Gives the stations their lasers.
fn set_up(
    mut commands: Commands,
    loaded: Res<RunScenario>,
    seed: Res<Seed>,
    clock: Res<SimClock>,
    propagations: Res<Propagations>,
    stations: Query<(Entity, &Station)>,
) -> Result<(), PartError> {
    let known = loaded.scenario.stations();
    let turbulence = &loaded.scenario.turbulence;
    for (entity, station) in &stations {
        let laser = &known[station.index].config.laser;
        let key = station.index as u64;
        let context = PropagationContext {
            seed: seed.0,
            station: key,
            tick_hz: clock.tick_hz,
            scales_m: [turbulence.outer_scale_m, turbulence.inner_scale_m],
            paper: [turbulence.paper_drift, turbulence.paper_volatility],
            wave: WaveSettings {
                rate_hz: turbulence.wave.rate_hz,
                clear_ratio: turbulence.wave.clear_ratio,
            },
        };
        let name = &turbulence.propagation;
        let made = propagations.make(name, &context).unwrap_or_else(|| {
            let known: Vec<&str> = propagations.names().collect();
            let hint = suggestion(name, &known);
            Err(format!("no propagation '{name}'{hint}").into())
        });
        let propagation = made.map_err(|error| loaded.refuse("turbulence.propagation", error))?;
        let source = LaserSource {
            laser: Laser {
                power_w: laser.power_w,
                wavelength_m: laser.wavelength_nm * 1e-9,
                aperture_radius_m: laser.aperture_radius_m,
                m2: laser.m2,
            },
            focus_m: match laser.focus {
                Focus::Metres(range_m) => Some(range_m),
                Focus::Target(_) => None,
            },
            jitter_rad: laser.jitter_urad * 1e-6,
            propagation,
            outer_m: turbulence.outer_scale_m,
            // The same as the cameras': what moves the image turns the beam.
            seeing: turbulence.imaging.then(|| {
                let mut rng = seed.stream(key, SEEING_STREAM);
                let outer_m = turbulence.outer_scale_m;
                BeamSeeing {
                    air: Arc::new(FrozenAir::new(&mut rng, outer_m)),
                    pupil: Pupil::gaussian(laser.aperture_radius_m),
                    ripples: None,
                    turned: DVec2::ZERO,
                }
            }),
            jitter_rng: seed.stream(key, "beam jitter"),
            path: None,
        };
        let pauses = LaserPauses {
            full_w: laser.power_w,
            share: 0.0,
        };
        commands.entity(entity).insert((
            source,
            pauses,
            FireCommand::default(),
            BeamState::default(),
        ));
    }
    Ok(())
}
