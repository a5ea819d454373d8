//! The laser: propagation of the beam and heating of the target.

use crate::components::beam::{BeamState, Channel, FireCommand, LaserSource};
use crate::components::mount::Station;
use crate::components::run::{RunScenario, Seed, SetUp, Tick, TickSet};
use crate::models::air::turbulence::{GammaGamma, PaperIntensity, Scintillation, Wander};
use crate::models::laser::beam::Laser;
use crate::scenario::{Focus, IntensityModel};
use crate::systems::beam as systems;
use crate::systems::run::nothing_failed;
use bevy::prelude::*;

/// Adds the domain to both schedules, in [`TickSet::Beam`].
pub struct BeamPlugin;

impl Plugin for BeamPlugin {
    fn build(&self, app: &mut App) {
        app.add_systems(SetUp, set_up.in_set(TickSet::Beam).run_if(nothing_failed))
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
    stations: Query<(Entity, &Station)>,
) {
    let known = loaded.scenario.stations();
    for (entity, station) in &stations {
        let laser = &known[station.index].config.laser;
        let key = station.index as u64;
        let turbulence = &loaded.scenario.turbulence;
        let wavelength_m = laser.wavelength_nm * 1e-9;
        let mut scintillation_rng = seed.stream(key, "scintillation");
        let mut wander_rng = seed.stream(key, "beam wander");
        // Both are retuned to the path when the first target is aimed at.
        let calm = GammaGamma::new(1e-3, 0.0);
        let channel = match turbulence.intensity {
            IntensityModel::Physical => Channel::Physical(Box::new(Scintillation::new(
                calm,
                1e-3,
                &mut scintillation_rng,
            ))),
            IntensityModel::Paper => Channel::Paper(PaperIntensity::new(
                turbulence.paper_drift,
                turbulence.paper_volatility,
            )),
        };
        let source = LaserSource {
            laser: Laser {
                power_w: laser.power_w,
                wavelength_m,
                aperture_radius_m: laser.aperture_radius_m,
                m2: laser.m2,
            },
            focus_m: match laser.focus {
                Focus::Metres(range_m) => Some(range_m),
                Focus::Target(_) => None,
            },
            jitter_rad: laser.jitter_urad * 1e-6,
            channel,
            wander: Wander::new(0.0, 1e-2, &mut wander_rng),
            scintillation_rng,
            wander_rng,
            jitter_rng: seed.stream(key, "beam jitter"),
            path: None,
        };
        commands
            .entity(entity)
            .insert((source, FireCommand::default(), BeamState::default()));
    }
}
