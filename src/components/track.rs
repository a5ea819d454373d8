//! The tracker: tracks, state, target.

use crate::inference::OnnxRecogniser;
use crate::models::decision::{gallery, tracker};
use crate::models::laser::range_finder::RangeFinderParams;
use crate::models::maths::rng::Stream;
use crate::models::sensing::measured::Measured;
use crate::models::tracking::recognition::Recognition;
use bevy::prelude::*;

/// What [`crate::components::run::TickSet::Track`] walks in every tick. A stage's systems can be removed
/// (`App::remove_systems_in_set`) and others put in their place.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TrackStage {
    /// Detections that have arrived become tracks of the table.
    Associate,
    /// What each track is.
    Recognise,
    /// The range finder asks for the target's range.
    Range,
    /// The part aimed at, and what will hide the tracks.
    Foresee,
    /// The operator's orders.
    Obey,
    /// The stations tell each other what they see, and share the targets out.
    Share,
    /// The state machine: which track is the target, and how it is held.
    Decide,
}

pub use crate::models::decision::tracker::{BoresightError, StateChange, TrackingState};

/// How a station's detections become tracks, and tracks targets.
#[derive(Component, Clone, Copy, Debug, PartialEq, Deref, DerefMut)]
pub struct TrackerParams(pub tracker::TrackerParams);

/// A station's tracker.
#[derive(Component, Clone, Debug, Default, Deref, DerefMut)]
pub struct Tracker(pub tracker::Tracker);

/// The laser range finder, on the laser's axis.
#[derive(Component, Clone, Debug)]
pub struct RangeFinder {
    /// Rating, field and error.
    pub params: RangeFinderParams,
    /// Stream of its errors.
    pub rng: Stream,
}

/// What each track of a station looked like in its last second.
#[derive(Component, Clone, Debug, Default, Deref, DerefMut)]
pub struct Gallery(pub gallery::Gallery);

/// What says what tracks are.
pub enum Judge {
    /// A network, which looks at pictures.
    Network(OnnxRecogniser),
    /// What such a network was measured to say.
    Measured(Box<MeasuredRecogniser>),
}

/// What a recogniser was measured to say: it knows the truth, and draws errors.
pub struct MeasuredRecogniser {
    /// The numbers.
    pub model: Measured,
    /// Seed of the run.
    pub seed: u64,
}

/// What says what tracks are; without it nothing is recognised.
#[derive(Component, Default)]
pub struct Recogniser {
    /// The network, or its likeness.
    pub judge: Option<Judge>,
    /// Times a second that it is asked, and tracks that it looks at each time.
    pub rate_hz: u32,
    pub max_tracks: usize,
    /// From a question to its answer.
    pub latency_ticks: u64,
}

/// The recogniser's answers on their way: the tick in which they arrive, and the track of each.
#[derive(Component, Clone, Debug, Default)]
pub struct Recognitions(pub Vec<(u64, u32, Recognition)>);
