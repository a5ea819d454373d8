//! Who takes part in a run: nobody joins or leaves after the set-up.

use crate::components::flight::Uav;
use crate::components::mount::Stations;
use bevy::prelude::*;

/// The entities that views are made of, looked up once.
#[derive(Resource, Default)]
pub(super) struct Cast {
    /// The stations, in the order of the scenario.
    pub(super) stations: Vec<Entity>,
    /// UAVs and distractors, by their index.
    pub(super) flying: Vec<Entity>,
}

impl Cast {
    /// Those of a run that is set up.
    pub(super) fn of(world: &mut World) -> Self {
        let mut flying: Vec<_> = (world.query::<(Entity, &Uav)>().iter(world))
            .map(|(entity, uav)| (uav.index, entity))
            .collect();
        flying.sort_unstable_by_key(|(index, _)| *index);
        Self {
            stations: world.resource::<Stations>().0.clone(),
            flying: flying.into_iter().map(|(_, entity)| entity).collect(),
        }
    }
}
