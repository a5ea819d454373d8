//! The state machine of an engagement moves.

use crate::components::beam::BeamState;
use crate::components::control::{Radar, SearchScan};
use crate::components::environment::Environment;
use crate::components::mount::Mount;
use crate::components::network::Tasking;
use crate::components::operator::Operator;
use crate::components::run::SimClock;
use crate::components::track::{Tracker, TrackerParams, TrackingState};
use crate::models::decision::machine::{points_at, step, take_radar_range};
use crate::models::decision::situation::{Situation, WEIGHING_HZ};
use crate::models::tracking::cartesian::TargetCue;
use crate::models::tracking::search::SlewLimits;
use bevy::ecs::query::QueryData;
use bevy::prelude::*;

/// A station as its state machine moves.
#[derive(QueryData)]
#[query_data(mutable)]
pub struct Deciding {
    params: &'static TrackerParams,
    mount: &'static Mount,
    beam: &'static BeamState,
    tasking: &'static Tasking,
    operator: &'static Operator,
    scan: &'static SearchScan,
    radar: &'static mut Radar,
    tracker: &'static mut Tracker,
}

/// Moves the state machine.
pub fn decide(clock: Res<SimClock>, environment: Res<Environment>, mut stations: Query<Deciding>) {
    for station in &mut stations {
        let DecidingItem {
            params,
            mount,
            beam,
            tasking,
            operator,
            scan,
            mut radar,
            mut tracker,
        } = station;
        let tracker = &mut tracker.0;
        let t_s = clock.t_s();
        // Slewed by hand, a station leaves the radar's targets and those of the defence alone.
        let within = operator.slew_rad.map(|at_rad| scan.about(at_rad));
        let free = within.is_none();
        let tasked = tasking.cue(mount.r_enu_m, t_s);
        let by_radar = tasked.is_none();
        let cues: Vec<TargetCue> = match (free, tasked) {
            (false, _) => Vec::new(),
            (true, Some(tasked)) => vec![tasked],
            (true, None) => radar.cues(t_s).map(|(_, cue)| cue).collect(),
        };
        let now = Situation {
            tick: clock.tick,
            tick_hz: clock.tick_hz,
            params,
            dsm: Some(&environment.city.dsm),
            r_station_enu_m: mount.r_enu_m,
            cues: &cues,
            by_radar,
            mount: Some((
                mount.measured_az_el_rad(),
                SlewLimits::of(&mount.gimbal.params.azimuth),
            )),
            tasking: free.then_some(&tasking.0),
            within,
        };
        let before = tracker.target;
        let searched = tracker.state == TrackingState::Search;
        step(&now, tracker, beam.firing, clock.due(WEIGHING_HZ));
        if searched
            && let (Some(id), Some(cue)) = (
                tracker.target,
                tracker.target_track().and_then(|track| now.cue_of(track)),
            )
        {
            take_radar_range(cue, &mut tracker.table, id, t_s);
        }
        // The radar is told that what it tracks has been dealt with.
        if let Some(track) = before.and_then(|id| tracker.table.get(id))
            && tracker.target.is_none()
            && track.fallen()
            && let at = track.filter.predicted(t_s).az_el_rad()
            && let Some((index, cue)) = radar.nearest(at, t_s)
            && points_at(&cue, track, t_s)
        {
            radar.dismiss(index);
        }
    }
}
