//! Flight, and Rapier for what falls.

use crate::components::clock::SimClock;
use crate::models::maths::kinematics::GRAVITY_MPS2;
use crate::plugins::clock::{Tick, TickSet};
use crate::systems::flight::{self as systems, Fall};
use bevy::prelude::*;
use bevy::transform::StaticTransformOptimizations;
use bevy_rapier3d::plugin::systems::sync_removals;
use bevy_rapier3d::prelude::*;
use bevy_rapier3d::rapier::prelude::IntegrationParameters;

/// Flight, and Rapier for what falls.
pub struct FlightPlugin;

impl Plugin for FlightPlugin {
    fn build(&self, app: &mut App) {
        let dt_s = app
            .world()
            .resource::<SimClock>()
            .at_s(systems::FALL_PERIOD_TICKS) as f32;
        app.init_schedule(Fall)
            // Rapier propagates transforms itself and needs what Bevy's plugin, which big_space
            // replaces, would have put here.
            .init_resource::<StaticTransformOptimizations>()
            .insert_resource(TimestepMode::Fixed {
                dt: dt_s,
                substeps: 1,
            })
            .add_plugins(
                RapierPhysicsPlugin::<NoUserData>::default()
                    .in_schedule(Fall)
                    .with_custom_initialization(
                        RapierContextInitialization::InitializeDefaultRapierContext {
                            integration_parameters: IntegrationParameters::default(),
                            rapier_configuration: RapierConfiguration {
                                gravity: Vec3::NEG_Z * GRAVITY_MPS2 as f32,
                                ..RapierConfiguration::new(1.0)
                            },
                        },
                    ),
            )
            .add_systems(
                Fall,
                (systems::drag_wrecks, sync_removals)
                    .chain()
                    .before(PhysicsSet::SyncBackend),
            )
            .add_systems(
                Tick,
                (
                    systems::fly,
                    systems::drift,
                    systems::drop_wrecks,
                    systems::fall,
                    systems::follow_wrecks,
                )
                    .chain()
                    .in_set(TickSet::Flight),
            );
    }
}
