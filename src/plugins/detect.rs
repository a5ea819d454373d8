//! The detector; detections and their latency.

use crate::components::capture::{SensorCamera, Tier};
use crate::components::detect::{
    DetectionQueue, DetectorContext, DetectorInUse, Detectors, Moving, Surroundings,
};
use crate::components::environment::Environment;
use crate::components::flight::{Distractor, Uav};
use crate::components::mount::Station;
use crate::components::run::{
    Options, PartError, RunScenario, Seed, SetUp, SimClock, Tick, TickSet,
};
use crate::models::sensing::moving::MovingDots;
use crate::plugins::run::fallible;
use crate::scenario;
use crate::systems::detect as systems;
use bevy::prelude::*;
use std::sync::Arc;

/// Adds the domain to both schedules, in [`TickSet::Detect`].
pub struct DetectPlugin;

impl Plugin for DetectPlugin {
    fn build(&self, app: &mut App) {
        app.insert_resource(known())
            .add_systems(SetUp, fallible(set_up).in_set(TickSet::Detect))
            .add_systems(
                Tick,
                (systems::ask, systems::find_moving, systems::answer)
                    .chain()
                    .in_set(TickSet::Detect),
            );
    }
}

/// The detectors that every run knows.
fn known() -> Detectors {
    let mut detectors = Detectors::default();
    for (name, make) in systems::DETECTORS {
        detectors.add(name, make);
    }
    detectors
}

fn set_up(
    mut commands: Commands,
    loaded: Res<RunScenario>,
    seed: Res<Seed>,
    options: Res<Options>,
    detectors: Res<Detectors>,
    stations: Query<Entity, With<Station>>,
    cameras: Query<(Entity, &SensorCamera)>,
    (clock, environment): (Res<SimClock>, Res<Environment>),
    things: Query<(&Uav, Option<&Distractor>)>,
) -> Result<(), PartError> {
    for station in &stations {
        commands.entity(station).insert(DetectionQueue::default());
    }
    let sensors_px: Vec<[u32; 2]> = (cameras.iter())
        .map(|(_, camera)| [camera.pinhole.width_px, camera.pinhole.height_px])
        .collect();
    let context = DetectorContext {
        loaded: loaded.0.clone(),
        options: options.clone(),
        seed: *seed,
        sensors_px,
        surroundings: Arc::new(Surroundings::new(
            &environment,
            (things.iter()).map(|(uav, other)| (uav.index, Distractor::class_of(other))),
            1.0 / clock.dt_s(),
        )),
    };
    let kind = &loaded.scenario.detector.kind;
    let detector = detectors.make(kind, &context).ok_or_else(|| {
        let known: Vec<&str> = detectors.names().collect();
        let hint = scenario::suggestion(kind, &known);
        loaded.refuse("detector.kind", format!("no detector '{kind}'{hint}"))
    })?;
    let detector = DetectorInUse::new(detector?);
    for (entity, camera) in &cameras {
        // To the finer cameras, which follow, the scenery moves; beside a detector without pictures nothing looks at any.
        let looks = loaded.scenario.detector.moving
            && camera.tier == Tier::Search
            && detector.detector.wants_pictures();
        let moving = Moving(looks.then(MovingDots::default));
        commands.entity(entity).insert(moving);
    }
    commands.insert_resource(detector);
    Ok(())
}
