//! What the state machine looks at.

use super::tasking::{Task, Tasking};
use super::tracker::{Tracker, TrackerParams};
use super::tuning::TrackerTuning;
use crate::engage::threat::time_to_asset_s;
use crate::ground::dsm::Dsm;
use crate::optics::tier::Tier;
use crate::tracking::cartesian::TargetCue;
use crate::tracking::search::{Sector, SlewLimits};
use crate::tracking::table::Track;
use glam::{DVec2, DVec3};

/// Hits that confirm a target to the next camera.
pub const CONFIRM_HITS: u32 = 4;
/// How often tracks are judged, threats compared and occlusions foreseen [Hz].
pub const WEIGHING_HZ: u32 = 10;
/// Least rate on the sky that counts as flight [rad/s]: scenery keeps still, a flickering facade does not move far.
pub const MOVING_RADPS: f64 = 1.0e-3;

/// Time without a hit after which a camera of `rate_hz` [Hz] has lost the target [s]: a slow one may
/// miss a frame, as the faster ones may miss several.
pub fn patience_s(rate_hz: f64) -> f64 {
    const LEAST_S: f64 = 0.25; // [s]
    const FRAMES: f64 = 2.5;
    LEAST_S.max(FRAMES / rate_hz)
}

/// What the state machine looks at.
pub struct Situation<'a> {
    /// The tick.
    pub tick: u64,
    /// Ticks a second [Hz].
    pub tick_hz: u32,
    /// How the tracker works.
    pub params: &'a TrackerParams,
    /// The city's heights; `None` under an open sky.
    pub dsm: Option<&'a Dsm>,
    /// Where the station is [m].
    pub r_station_enu_m: DVec3,
    /// Where the target of the defence is, or the radar's are.
    pub cues: &'a [TargetCue],
    /// The radar alone says where that is: the defence knows it from the station's own cameras, too.
    pub by_radar: bool,
    /// Where the mount points, azimuth and elevation [rad], and how fast it turns; `None` where nothing turns.
    pub mount: Option<(DVec2, SlewLimits)>,
    /// What the defence wants of this station, if it is one of several.
    pub tasking: Option<&'a Tasking>,
    /// Where an operator has the station search by hand: it takes up nothing elsewhere.
    pub within: Option<Sector>,
}

impl Situation<'_> {
    /// Duration of so many ticks [s].
    pub fn at_s(&self, ticks: u64) -> f64 {
        ticks as f64 / f64::from(self.tick_hz)
    }

    pub(super) fn t_s(&self) -> f64 {
        self.at_s(self.tick)
    }

    /// What decisions are tuned by.
    pub(super) fn tuning(&self) -> &TrackerTuning {
        &self.params.tuning
    }

    /// The object that the station is to follow.
    pub(super) fn task(&self) -> Option<&Task> {
        self.tasking?.task.as_ref()
    }

    /// Whether a track is to be left to others.
    pub(super) fn spares(&self, id: u32) -> bool {
        (self.tasking).is_some_and(|tasking| tasking.spared.contains(&id))
    }

    /// Time without news of a hit of the target by a camera [s].
    fn silent_s(&self, tracker: &Tracker, tier: Tier) -> f64 {
        tracker.error[tier].map_or(f64::INFINITY, |error| {
            self.at_s(self.tick - error.available_tick)
        })
    }

    /// Whether a camera has had no news of the target for so long that it has lost it.
    pub(super) fn lost_by(&self, tracker: &Tracker, tier: Tier) -> bool {
        self.silent_s(tracker, tier) > self.params.patience_s[tier]
    }

    /// Whether a track was seen so lately by any camera that it may still be there.
    pub(super) fn fresh(&self, track: &Track) -> bool {
        let longest_s = self
            .params
            .patience_s
            .each()
            .into_iter()
            .fold(0.0, f64::max);
        self.t_s() - track.seen_s() <= longest_s
    }

    /// Speed with which a track loses height [m/s].
    pub(super) fn sink_mps(&self, track: &Track) -> f64 {
        track
            .position_enu(self.r_station_enu_m, self.t_s())
            .map_or(0.0, |(_, v_enu_mps)| -v_enu_mps.z)
    }

    /// Time that a track needs to reach the asset [s].
    pub(super) fn threat_s(&self, track: &Track) -> f64 {
        track
            .position_enu(self.r_station_enu_m, self.t_s())
            .map_or(f64::INFINITY, |(r_enu_m, v_enu_mps)| {
                time_to_asset_s(r_enu_m, v_enu_mps, self.params.r_asset_enu_m)
            })
    }
}
