//! Snapshots: a run's state, to go back to.
//!
//! What changes in a run is its components and resources; who takes part in it never does. So a snapshot is a copy of
//! each component and resource that a tick may change, and going back puts the copies where they came from.

use super::error::SimulationError;
use super::events::Watch;
use crate::components::beam::{BeamState, Dose, FireCommand, LaserPauses, LaserSource};
use crate::components::capture::{
    AutoExposure, ExposedFrame, Exposures, Frames, Readout, SensorCamera,
};
use crate::components::control::{Controller, Radar, SearchScan};
use crate::components::detect::{DetectionQueue, Moving};
use crate::components::engage::{Burst, Interlocks, Rules};
use crate::components::environment::Environment;
use crate::components::flight::{Air, Flight, Guidance, HeatedSkin, UavStatus, Wreck};
use crate::components::mount::{Boresight, CameraView, Mount, MountCommand, Optics, PanTilt};
use crate::components::network::{Holdings, Link, SharedPicture, Tasking};
use crate::components::operator::Operator;
use crate::components::record::{CameraHistory, Fates, History, Logged, StateHash};
use crate::components::run::{RunEnd, SimClock};
use crate::components::track::{Gallery, RangeFinder, Recognitions, Tracker, TrackerParams};
use bevy::ecs::component::Mutable;
use bevy::prelude::{Component, Entity, Resource, World};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// The state of a run between two ticks, to go back to by [`super::Simulation::restore`]. It belongs to the run that it
/// was taken of.
#[derive(Clone)]
pub struct Snapshot {
    pub(super) of: RunId,
    pub(super) tick: u64,
    pub(super) state: State,
    pub(super) frames: BTreeMap<usize, Arc<ExposedFrame>>,
    pub(super) watch: Watch,
    world: Arc<Vec<Box<dyn Kept>>>,
}

impl Snapshot {
    /// Ticks from the start of the run.
    pub fn tick(&self) -> u64 {
        self.tick
    }
}

/// How far a run is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum State {
    Goes,
    Over,
    Failed,
}

/// What tells a run from all others of the process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct RunId(u64);

impl RunId {
    pub(super) fn new() -> Self {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        Self(NEXT.fetch_add(1, Ordering::Relaxed))
    }
}

/// Copies of one kind, to be put back.
trait Kept: Send + Sync {
    fn restore(&self, world: &mut World);
}

/// Each entity's own of a component.
struct Components<C>(Vec<(Entity, C)>);

impl<C: Component<Mutability = Mutable> + Clone> Components<C> {
    fn boxed(world: &mut World) -> Box<dyn Kept> {
        let mut query = world.query::<(Entity, &C)>();
        Box::new(Self(
            query
                .iter(world)
                .map(|(entity, own)| (entity, own.clone()))
                .collect(),
        ))
    }
}

impl<C: Component<Mutability = Mutable> + Clone> Kept for Components<C> {
    fn restore(&self, world: &mut World) {
        for (entity, own) in &self.0 {
            if let Some(mut now) = world.get_mut::<C>(*entity) {
                *now = own.clone();
            }
        }
    }
}

/// A resource; `None` where a run has none.
struct One<R>(Option<R>);

impl<R: Resource<Mutability = Mutable> + Clone> One<R> {
    fn boxed(world: &mut World) -> Box<dyn Kept> {
        Box::new(Self(world.get_resource::<R>().cloned()))
    }
}

impl<R: Resource<Mutability = Mutable> + Clone> Kept for One<R> {
    fn restore(&self, world: &mut World) {
        if let (Some(kept), Some(mut now)) = (&self.0, world.get_resource_mut::<R>()) {
            *now = kept.clone();
        }
    }
}

/// Makes the copies of one kind.
type Keep = fn(&mut World) -> Box<dyn Kept>;

/// Everything that a tick may change. The structure test holds it against the components and resources there are.
const KINDS: &[Keep] = &[
    // Environment and flight.
    One::<SimClock>::boxed,
    One::<RunEnd>::boxed,
    One::<StateHash>::boxed,
    One::<Environment>::boxed,
    Components::<Air>::boxed,
    Components::<Flight>::boxed,
    Components::<Guidance>::boxed,
    Components::<HeatedSkin>::boxed,
    Components::<UavStatus>::boxed,
    Components::<Wreck>::boxed,
    // Mount and beam.
    Components::<Mount>::boxed,
    Components::<MountCommand>::boxed,
    Components::<Optics>::boxed,
    Components::<PanTilt>::boxed,
    Components::<Boresight>::boxed,
    Components::<CameraView>::boxed,
    Components::<LaserSource>::boxed,
    Components::<BeamState>::boxed,
    Components::<Dose>::boxed,
    // Cameras and their detections.
    One::<Frames>::boxed,
    Components::<SensorCamera>::boxed,
    Components::<Readout>::boxed,
    Components::<Exposures>::boxed,
    Components::<AutoExposure>::boxed,
    Components::<Moving>::boxed,
    Components::<DetectionQueue>::boxed,
    // Tracker, network, operator.
    Components::<Tracker>::boxed,
    Components::<TrackerParams>::boxed,
    Components::<RangeFinder>::boxed,
    Components::<Gallery>::boxed,
    Components::<Recognitions>::boxed,
    Components::<Link>::boxed,
    Components::<SharedPicture>::boxed,
    Components::<Tasking>::boxed,
    One::<Holdings>::boxed,
    Components::<Operator>::boxed,
    // Control and engagement.
    Components::<Controller>::boxed,
    Components::<SearchScan>::boxed,
    Components::<Radar>::boxed,
    Components::<Rules>::boxed,
    Components::<Interlocks>::boxed,
    Components::<Burst>::boxed,
    Components::<FireCommand>::boxed,
    Components::<LaserPauses>::boxed,
    // What is kept for the record.
    One::<Fates>::boxed,
    Components::<Logged>::boxed,
    Components::<CameraHistory>::boxed,
    Components::<History>::boxed,
];

impl Snapshot {
    /// A copy of a run in which no question to the detector waits for its answer.
    pub(super) fn of(
        of: RunId,
        world: &mut World,
        state: State,
        frames: &BTreeMap<usize, Arc<ExposedFrame>>,
        watch: &Watch,
    ) -> Self {
        Self {
            of,
            tick: world.resource::<SimClock>().tick,
            state,
            frames: frames.clone(),
            watch: watch.clone(),
            world: Arc::new(KINDS.iter().map(|keep| keep(world)).collect()),
        }
    }

    /// Puts everything back.
    pub(super) fn put_back(&self, world: &mut World) {
        for kept in self.world.iter() {
            kept.restore(world);
        }
    }
}

/// Why a run does not go back.
pub(super) fn refused(
    snapshot: &Snapshot,
    of: RunId,
    state: State,
    recorded: bool,
) -> Result<(), SimulationError> {
    if snapshot.of != of {
        return Err(SimulationError::OtherRun);
    }
    if state == State::Failed {
        return Err(SimulationError::Failed);
    }
    if recorded {
        return Err(SimulationError::Recorded);
    }
    Ok(())
}
