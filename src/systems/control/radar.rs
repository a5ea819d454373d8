//! The radar looks, and what it saw becomes its tracks.

use crate::components::control::{Look, Radar, RadarKind};
use crate::components::environment::Environment;
use crate::components::flight::{Distractor, Flight, Uav, UavStatus};
use crate::components::mount::Mount;
use crate::components::operator::Operator;
use crate::components::run::SimClock;
use crate::components::track::{Tracker, TrackerParams, TrackingState};
use crate::models::engage::threat::time_to_asset_s;
use crate::models::ground::dsm::LineOfSight;
use crate::models::sensing::radar::RadarTrack;
use crate::models::sensing::radar::rcs;
use crate::models::sensing::radar::sensing::Echo;
use crate::models::tracking::cartesian::TargetCue;
use crate::models::tracking::table::separation_rad;
use bevy::ecs::query::QueryData;
use bevy::prelude::*;
use glam::{DVec2, DVec3};

/// What flies, as a radar meets it.
#[derive(QueryData)]
pub struct Flying {
    uav: &'static Uav,
    flight: &'static Flight,
    status: Option<&'static UavStatus>,
    distractor: Option<&'static Distractor>,
}

impl FlyingItem<'_, '_> {
    /// What it sends back, relative to a radar at `r_radar_enu_m` [m]. Before the start, at a `t_s` [s] below 0, it came as it
    /// flies then.
    fn echo(&self, r_radar_enu_m: DVec3, t_s: f64) -> Echo {
        let state = &self.flight.state;
        let r_enu_m = state.r_enu_m + t_s.min(0.0) * state.v_enu_mps;
        let (rcs_m2, modulated) = match self.distractor {
            Some(other) => (
                rcs::of_distractor_m2(other.kind),
                rcs::is_modulated(other.kind),
            ),
            // What has no rotors turning falls too fast to be taken for ground.
            None => (
                rcs::of_uav_m2(self.uav.size_m.into_iter().fold(0.0, f64::max)),
                true,
            ),
        };
        Echo {
            r_enu_m: r_enu_m - r_radar_enu_m,
            v_enu_mps: state.v_enu_mps,
            rcs_m2,
            modulated,
        }
    }
}

impl Radar {
    /// Looks at `t_s` [s] from `r_enu_m` [m] at what flies, in the scenario's order.
    fn look(
        &mut self,
        t_s: f64,
        r_enu_m: DVec3,
        environment: &Environment,
        flying: &Query<Flying>,
    ) -> Option<Look> {
        let mut airborne: Vec<FlyingItem> = (flying.iter())
            .filter(|one| !one.status.is_some_and(|status| status.grounded()))
            .collect();
        airborne.sort_by_key(|one| one.uav.index);
        match self.kind.as_mut()? {
            RadarKind::Scanning(scanning) => {
                let (params, traffic) = &mut **scanning;
                let dsm = &environment.city.dsm;
                let ground_m = |e_m, n_m| dsm.terrain_m(e_m, n_m);
                let reach = (&params.field, params.farthest_m);
                let mut echoes = traffic.echoes(t_s, reach, r_enu_m, ground_m);
                echoes.extend(airborne.iter().map(|one| one.echo(r_enu_m, t_s)));
                echoes.retain(|echo| {
                    echo.r_enu_m.length() < params.farthest_m
                        && dsm.line_of_sight(r_enu_m, r_enu_m + echo.r_enu_m) == LineOfSight::Clear
                });
                Some(Look::Plots(params.look(t_s, &echoes, &mut self.rng)))
            }
            RadarKind::Truth {
                errors,
                target,
                all,
            } => {
                let mut seen: Vec<(usize, DVec3)> = (airborne.iter())
                    .filter(|one| one.distractor.is_none())
                    .map(|one| (one.uav.index, one.flight.state.r_enu_m - r_enu_m))
                    .filter(|(index, _)| target.is_none_or(|target| target == *index))
                    .filter(|(index, _)| !self.dismissed.contains(index))
                    .collect();
                if !*all {
                    seen.truncate(1);
                }
                // The errors of one are drawn whether there is a target or not.
                if seen.is_empty() {
                    errors.plot(DVec3::Y, t_s, &mut self.rng);
                }
                let plot = |(index, r_enu_m)| (index, errors.plot(r_enu_m, t_s, &mut self.rng));
                Some(Look::Known(seen.into_iter().map(plot).collect()))
            }
        }
    }

    /// What it knows at the start: a radar that scans has been on for a while.
    pub fn warm_up(
        &mut self,
        period_s: f64,
        r_enu_m: DVec3,
        environment: &Environment,
        flying: &Query<Flying>,
    ) {
        /// Enough to confirm what is missed now and then. Chosen.
        const LOOKS: u32 = 12;
        let before = match self.kind {
            Some(RadarKind::Scanning(..)) => LOOKS - 1,
            _ => 0,
        };
        for look in (0..=before).rev() {
            let t_s = -period_s * f64::from(look);
            if let Some(seen) = self.look(t_s, r_enu_m, environment, flying) {
                self.take(&seen);
            }
        }
    }

    /// Takes what a look saw into the tracks.
    fn take(&mut self, look: &Look) {
        match look {
            Look::Plots(plots) => self.tracks.take(plots),
            Look::Known(plots) => self.tracks.take_known(plots),
        }
    }

    /// The tracks of what has not been dealt with, with their numbers.
    pub fn open(&self) -> impl Iterator<Item = (usize, &RadarTrack)> {
        let open = |(number, _): &(usize, &RadarTrack)| !self.dismissed.contains(number);
        self.tracks.iter().filter(open)
    }

    /// Chooses what the search is pointed at, at `t_s` [s]: of the truth the first, otherwise what is soonest at the asset
    /// [m, enu].
    pub fn choose(&mut self, t_s: f64, r_enu_m: DVec3, r_asset_enu_m: DVec3) {
        let threat_s = |track: &RadarTrack| {
            let (r_m, v_enu_mps) = track.motion_enu(t_s);
            time_to_asset_s(r_enu_m + r_m, v_enu_mps, r_asset_enu_m)
        };
        let tracks: Vec<(usize, f64)> = (self.open())
            .map(|(number, track)| (number, threat_s(track)))
            .collect();
        match self.kind {
            Some(RadarKind::Truth { .. }) => {
                self.choice.chosen = tracks.first().map(|(number, _)| *number);
            }
            _ => self.choice.choose(&tracks),
        }
    }

    /// Speaks no more of the track of what has been dealt with.
    pub fn dismiss(&mut self, number: usize) {
        self.dismissed.push(number);
    }

    /// Where its targets are at `t_s` [s], with their numbers.
    pub fn cues(&self, t_s: f64) -> impl Iterator<Item = (usize, TargetCue)> {
        (self.open()).map(move |(number, track)| (number, track.cue(t_s)))
    }

    /// The target whose direction at `t_s` [s] is nearest to this azimuth and elevation [rad].
    pub fn nearest(&self, az_el_rad: DVec2, t_s: f64) -> Option<(usize, TargetCue)> {
        self.cues(t_s).min_by(|a, b| {
            let off_rad = |cue: &TargetCue| separation_rad(cue.az_el_rad, az_el_rad);
            off_rad(&a.1).total_cmp(&off_rad(&b.1))
        })
    }

    /// Direction and range of the target that the search is pointed at, at `t_s` [s].
    pub fn cue(&self, t_s: f64) -> Option<TargetCue> {
        let track = self.tracks.get(self.choice.chosen?)?;
        Some(track.cue(t_s))
    }
}

/// The radars look, what has arrived updates their tracks, and each chooses what to point at.
pub fn track_by_radar(
    clock: Res<SimClock>,
    environment: Res<Environment>,
    flying: Query<Flying>,
    mut stations: Query<(&Mount, &TrackerParams, &Tracker, &Operator, &mut Radar)>,
) {
    for (mount, params, tracker, operator, mut radar) in &mut stations {
        if radar.kind.is_none() {
            continue;
        }
        let t_s = clock.t_s();
        if clock.tick.is_multiple_of(radar.period_ticks)
            && let Some(look) = radar.look(t_s, mount.r_enu_m, &environment, &flying)
        {
            let available = clock.tick + radar.latency_ticks;
            radar.waiting.push_back((available, look));
        }
        while let Some((_, look)) =
            (radar.waiting).pop_front_if(|(available, _)| *available <= clock.tick)
        {
            radar.take(&look);
        }
        if tracker.state == TrackingState::Search && operator.slew_rad.is_none() {
            radar.choice.searched(clock.dt_s());
        }
        radar.choose(t_s, mount.r_enu_m, params.r_asset_enu_m);
    }
}
