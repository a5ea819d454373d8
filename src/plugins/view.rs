//! The window.

use crate::components::run::{SetUp, TickSet};
use crate::components::view::{DrawAndTick, Insets, Pacing, WindowFrame};
use crate::plugins::render::renders;
use crate::systems::view as systems;
use bevy::ecs::schedule::ScheduleLabel;
use bevy::prelude::*;
use bevy::winit::WinitSettings;
use bevy_egui::{
    EguiGlobalSettings, EguiPlugin, EguiPostUpdateSet, EguiPreUpdateSet, EguiPrimaryContextPass,
};

/// The window: it drives the ticks and draws between them.
pub struct ViewPlugin;

impl Plugin for ViewPlugin {
    fn build(&self, app: &mut App) {
        let in_window = |frame: Res<WindowFrame>| frame.active;
        app.add_plugins(EguiPlugin::default())
            .insert_resource(EguiGlobalSettings {
                // The first camera is a sensor's; the panels belong to the window's.
                auto_create_primary_context: false,
                ..default()
            })
            .insert_resource(WinitSettings::continuous())
            .init_resource::<WindowFrame>()
            .init_resource::<Pacing>()
            .init_resource::<Insets>()
            .configure_sets(
                PreUpdate,
                (EguiPreUpdateSet::ProcessInput, EguiPreUpdateSet::BeginPass).run_if(in_window),
            )
            .configure_sets(
                PostUpdate,
                (
                    EguiPostUpdateSet::EndPass,
                    EguiPostUpdateSet::ProcessOutput,
                    EguiPostUpdateSet::PostProcessOutput,
                )
                    .run_if(in_window),
            )
            .add_systems(
                SetUp,
                systems::camera::spawn_window_camera
                    .after(TickSet::Record)
                    .run_if(renders),
            )
            .add_systems(
                Update,
                (
                    systems::obey_keys,
                    systems::camera::fly_camera,
                    systems::insets::upload_pictures,
                )
                    .chain()
                    .run_if(in_window),
            )
            .add_systems(
                EguiPrimaryContextPass,
                (
                    systems::overlay::draw_overlay,
                    systems::panel::draw_panel,
                    systems::insets::draw_insets,
                )
                    .chain(),
            )
            .add_systems(DrawAndTick, systems::frame);
        // The window's update is not Bevy's: ticks run Bevy's main schedule for sensor frames.
        app.main_mut().update_schedule = Some(DrawAndTick.intern());
    }
}
