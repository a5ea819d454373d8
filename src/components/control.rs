//! Controllers, the search scan and the radar that cues it.

use crate::components::run::Registry;
use crate::models::control::law::HandOver;
use crate::models::control::paper::{PaperLaw, PaperPid};
use crate::models::control::pointing::PointingLaw;
use crate::models::control::tuning::MountPlant;
use crate::models::maths::rng::Stream;
use crate::models::optics::tier::Tier;
use crate::models::sensing::radar::choice::CueChoice;
use crate::models::sensing::radar::sensing::RadarParams;
use crate::models::sensing::radar::tracks::RadarTracks;
use crate::models::sensing::radar::traffic::Traffic;
use crate::models::sensing::radar::{Plot, RadarErrors};
use crate::models::tracking::search::{SearchPattern, Sector};
use bevy::prelude::*;
use glam::DVec2;
use std::collections::VecDeque;

/// The control law of a run.
#[derive(Component, Clone, Debug)]
pub enum Controller {
    /// Eqs. 8 to 10 as printed, frame by frame.
    Paper(Box<PaperController>),
    /// A law on the predicted line of sight.
    Pointing(Box<PointingController>),
}

/// A pointing law and what carries it over from one stage to the next.
#[derive(Clone, Debug)]
pub struct PointingController {
    /// The law's name.
    pub name: String,
    /// The law, with its memory.
    pub law: Box<dyn PointingLaw>,
    /// Keeps commands from jumping.
    pub hand_over: HandOver,
}

/// The pointing laws that a scenario may name, each made for a mount.
#[derive(Resource, Default, Deref, DerefMut)]
pub struct PointingLaws(pub Registry<MountPlant, dyn PointingLaw>);

/// Laws and memory of the paper's two loops.
#[derive(Clone, Debug)]
pub struct PaperController {
    /// Eq. 9.
    pub coarse_law: PaperLaw,
    /// Eq. 10.
    pub precise_law: PaperLaw,
    /// Memory of the coarse loop.
    pub coarse: PaperPid,
    /// Memory of the precise loop.
    pub precise: PaperPid,
    /// Exposures last used by each loop.
    pub used_tick: [Option<u64>; 2],
    /// Rates that perform the last coarse increment [rad/s].
    pub rates_radps: [f64; 2],
    /// The track that the loops have been closed on.
    pub target: Option<u32>,
}

impl PaperController {
    /// Loops at rest.
    pub fn new(coarse_law: PaperLaw, precise_law: PaperLaw) -> Self {
        Self {
            coarse_law,
            precise_law,
            coarse: PaperPid::default(),
            precise: PaperPid::default(),
            used_tick: [None; 2],
            rates_radps: [0.0; 2],
            target: None,
        }
    }
}

/// A pass of the search with one of the cameras that the gimbal turns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pass {
    /// What the camera is for.
    pub tier: Tier,
    /// Its field of view, horizontal and vertical [rad].
    pub field_rad: [f64; 2],
    /// How long a gaze without anything promising lasts [s].
    pub gaze_s: f64,
}

/// The search scan: what it covers, its gazes and where it stands.
#[derive(Component, Clone, Debug)]
pub struct SearchScan {
    /// How an area is covered.
    pub pattern: SearchPattern,
    /// The sector that is searched without a cue; a cue's area is never larger.
    pub sector: Sector,
    /// The passes, each with a finer camera than the one before.
    pub passes: Vec<Pass>,
    /// The present one.
    pub pass: usize,
    /// The area that is searched, as it was at [`Self::area_s`].
    pub area: Sector,
    /// That time [s].
    pub area_s: f64,
    /// Rates of its centre, azimuth (x) and elevation (y) [rad/s].
    pub drift_radps: DVec2,
    /// Whether that is where a radar has its target.
    pub cued: bool,
    /// Azimuth (x) and elevation (y) to which an operator slewed the station [rad]: its area is then one field
    /// of the first pass about that.
    pub slew_rad: Option<DVec2>,
    /// The pass's gazes, from the centre of the area (azimuth, elevation) [rad].
    pub offsets_rad: Vec<DVec2>,
    /// Whether this pass looks between the gazes of the one before.
    pub between: bool,
    /// The present gaze.
    pub index: usize,
    /// Since when the mount rests at it, or moves with it.
    pub settled_since: Option<u64>,
    /// What the mount has turned to instead, to see it closer.
    pub glance: Option<Glance>,
    /// What it turned to so lately.
    pub glanced: Vec<Glanced>,
}

/// A closer look at one track between two gazes of a search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Glance {
    /// The track.
    pub track: u32,
    /// Tick in which the mount began to turn to it.
    pub since: u64,
    /// Which glance of its gaze it is, from 1.
    pub count: usize,
    /// Whether that gaze is to begin anew.
    pub cut_short: bool,
}

/// A track that was glanced at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Glanced {
    /// The track.
    pub track: u32,
    /// Where it was then, azimuth (x) and elevation (y) [rad].
    pub az_el_rad: DVec2,
    /// That time [s].
    pub t_s: f64,
}

/// What a radar's plots come from.
#[derive(Clone, Debug)]
pub enum RadarKind {
    /// A scanning radar, and what drives through its field.
    Scanning(Box<(RadarParams, Traffic)>),
    /// The truth plus an error.
    Truth {
        /// Errors of its plots.
        errors: RadarErrors,
        /// Scenario index of the UAV that it tracks; otherwise the first that is in the air, or all.
        target: Option<usize>,
        /// Whether it tracks all that is in the air.
        all: bool,
    },
}

/// What a radar measured in one look.
#[derive(Clone, Debug, PartialEq)]
pub enum Look {
    /// Plots of nobody knows what.
    Plots(Vec<Plot>),
    /// Plots with the scenario indices of their UAVs.
    Known(Vec<(usize, Plot)>),
}

/// The radar at the station that cues the search.
#[derive(Component, Clone, Debug)]
pub struct Radar {
    /// What it is; `None` without a radar.
    pub kind: Option<RadarKind>,
    /// Ticks between looks.
    pub period_ticks: u64,
    /// Ticks from a measurement to its plot at the station.
    pub latency_ticks: u64,
    /// Numbers of tracks that it no longer speaks of, as they have been dealt with.
    pub dismissed: Vec<usize>,
    /// Stream of its errors.
    pub rng: Stream,
    /// Looks on their way, with the tick they arrive in.
    pub waiting: VecDeque<(u64, Look)>,
    /// Its tracks; of the truth they have the scenario indices of their UAVs.
    pub tracks: RadarTracks,
    /// Which of them the search is pointed at.
    pub choice: CueChoice,
}
