//! The window.

use crate::components::render::LeanPaint;
use crate::components::run::{SetUp, TickSet};
use crate::components::view::{
    ChosenStation, DrawAndTick, Estimates, Insets, Pacing, Pictures, Playback, ShowWeak, Sight,
    TrackRows, WindowFrame,
};
use crate::plugins::render::renders;
use crate::systems::render::city_tiles::hide_behind_horizon;
use crate::systems::view as systems;
use bevy::ecs::schedule::ScheduleLabel;
use bevy::prelude::*;
use bevy::winit::WinitSettings;
use bevy_egui::{
    EguiGlobalSettings, EguiInputSet, EguiPlugin, EguiPostUpdateSet, EguiPreUpdateSet,
    EguiPrimaryContextPass,
};
use boresight_tiles::FollowTiles;
use boresight_tiles::{stream::stream, watch::watch};

/// The window: it drives the ticks and draws between them, or shows a [`Playback`] if there is one.
pub struct ViewPlugin;

impl Plugin for ViewPlugin {
    fn build(&self, app: &mut App) {
        let in_window = |frame: Res<WindowFrame>| frame.active;
        let waits = |frame: Res<WindowFrame>| frame.waiting;
        let shows = |frame: Res<WindowFrame>| frame.active && !frame.waiting;
        let plays_back = || resource_exists::<Playback>;
        let simulates = || not(resource_exists::<Playback>);
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
            .init_resource::<ShowWeak>()
            .init_resource::<Pictures>()
            .init_resource::<Estimates>()
            .init_resource::<Sight>()
            .init_resource::<ChosenStation>()
            .init_resource::<TrackRows>()
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
            // Sensor frames run Bevy's main schedule too, and have their tiles already.
            .configure_sets(PostUpdate, FollowTiles.run_if(shows))
            .add_systems(
                PostUpdate,
                hide_behind_horizon
                    .in_set(FollowTiles)
                    .after(watch)
                    .before(stream::<LeanPaint>),
            )
            .add_systems(Startup, systems::camera::spawn_window_camera)
            .add_systems(
                SetUp,
                systems::camera::place_window_camera
                    .after(TickSet::Record)
                    .run_if(renders),
            )
            .add_systems(
                PreUpdate,
                systems::keys::write_keys.in_set(EguiInputSet::ReadBevyMessages),
            )
            .add_systems(
                Update,
                (
                    systems::obey_keys.run_if(simulates()),
                    systems::playback::obey_keys.run_if(plays_back()),
                    systems::camera::fly_camera,
                    systems::insets::look_at_cameras.run_if(simulates()),
                    systems::overlay::look_at_tracks.run_if(simulates()),
                    systems::tracks::follow_tracks.run_if(simulates()),
                    systems::exposure::expose_window,
                    systems::insets::upload_pictures,
                )
                    .chain()
                    .run_if(shows),
            )
            .add_systems(
                EguiPrimaryContextPass,
                (
                    systems::overlay::draw_overlay,
                    systems::timeline::draw_timeline.run_if(plays_back()),
                    systems::controls::draw_controls.run_if(simulates()),
                    systems::panel::draw_panel.run_if(simulates()),
                    systems::recorded::draw_recorded.run_if(plays_back()),
                    systems::insets::draw_insets,
                )
                    .chain()
                    .run_if(shows),
            )
            .add_systems(
                EguiPrimaryContextPass,
                systems::panel::draw_waiting.run_if(waits),
            )
            .add_systems(DrawAndTick, systems::frame);
        // The window's update is not Bevy's: ticks run Bevy's main schedule for sensor frames.
        app.main_mut().update_schedule = Some(DrawAndTick.intern());
    }
}
