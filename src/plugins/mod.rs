//! One plugin a domain: its resources, its set-up from the scenario, its systems and their order.

pub mod beam;
pub mod capture;
pub mod control;
pub mod detect;
pub mod engage;
pub mod environment;
pub mod flight;
pub mod mount;
pub mod network;
pub mod operator;
pub mod record;
pub mod render;
pub mod run;
pub mod track;
pub mod view;

use bevy::app::PluginGroupBuilder;
use bevy::prelude::*;

/// Every domain of a run; what renders comes with [`render::ScenePlugin`].
pub struct SimulationPlugins;

impl PluginGroup for SimulationPlugins {
    fn build(self) -> PluginGroupBuilder {
        PluginGroupBuilder::start::<Self>()
            .add(run::RunPlugin)
            .add(environment::EnvironmentPlugin)
            .add(flight::FlightPlugin)
            .add(mount::MountPlugin)
            .add(beam::BeamPlugin)
            .add(capture::CapturePlugin)
            .add(detect::DetectPlugin)
            .add(track::TrackPlugin)
            .add(operator::OperatorPlugin)
            .add(network::NetworkPlugin)
            .add(control::ControlPlugin)
            .add(engage::EngagePlugin)
            .add(record::RecordPlugin)
    }
}
