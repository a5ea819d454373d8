//! One plugin a domain: wiring and schedule, nothing else.

pub mod beam;
pub mod capture;
pub mod clock;
pub mod control;
pub mod detect;
pub mod engage;
pub mod environment;
pub mod flight;
pub mod mount;
pub mod record;
pub mod track;
pub mod view;

use bevy::app::PluginGroupBuilder;
use bevy::prelude::*;

/// Every domain of the tick.
pub struct SimulationPlugins;

impl PluginGroup for SimulationPlugins {
    fn build(self) -> PluginGroupBuilder {
        PluginGroupBuilder::start::<Self>()
            .add(clock::ClockPlugin)
            .add(environment::EnvironmentPlugin)
            .add(flight::FlightPlugin)
            .add(mount::MountPlugin)
            .add(beam::BeamPlugin)
            .add(capture::CapturePlugin)
            .add(detect::DetectPlugin)
            .add(track::TrackPlugin)
            .add(control::ControlPlugin)
            .add(engage::EngagePlugin)
            .add(record::RecordPlugin)
    }
}
