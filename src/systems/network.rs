//! The stations' network: reports, the picture made of them, and who takes which target.

use crate::components::beam::LaserSource;
use crate::components::control::Radar;
use crate::components::engage::Rules;
use crate::components::environment::Environment;
use crate::components::mount::{Mount, Station};
use crate::components::network::{
    Holding, Holdings, Link, Network, NetworkState, ObjectState, Report, SharedPicture, Surveyed,
    Task, Tasking, TrackReport,
};
use crate::components::record::{OwnTopics, Recording};
use crate::components::run::{PartError, SimClock};
use crate::components::track::{Tracker, TrackerParams};
use crate::models::engage::allocation::{
    AllocationRule, Bid, LOCKED_S, Offer, allocate, allocate_apart, watch,
};
use crate::models::engage::threat::time_to_asset_s;
use crate::models::laser::target::{ABS_SHELL, CHAR_ABSORPTIVITY};
use crate::models::maths::kinematics::los_to_az_el;
use crate::models::tracking::cartesian::{Bearing, CartesianTrack};
use crate::models::tracking::picture::{Fix, Follower, Measured, Sensor, SharedObject};
use crate::models::tracking::search::SlewLimits;
use crate::models::tracking::table::Track;
use crate::systems::beam::expected_irradiance_wpm2;
use crate::systems::engage::Way;
use bevy::ecs::query::QueryData;
use bevy::prelude::*;
use glam::DVec3;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Hits that make a track worth reporting, and the log-odds below which it is not.
const REPORTED_HITS: u32 = 6;
const REPORTED: f64 = -2.0;
/// How often targets are assigned, and offers worked out anew [Hz].
const ASSIGNED_HZ: u32 = 10;
const OFFERS_HZ: u32 = 5;
/// How far ahead lines of sight are looked up, and in what steps [s].
const FORESIGHT_S: f64 = 6.0;
const STEP_S: f64 = 0.25;
/// A station as it reports.
#[derive(QueryData)]
#[query_data(mutable)]
pub struct Reporting {
    station: &'static Station,
    mount: &'static Mount,
    laser: &'static LaserSource,
    rules: &'static Rules,
    tracker: &'static Tracker,
    radar: &'static Radar,
    picture: &'static SharedPicture,
    surveyed: &'static Surveyed,
    link: &'static mut Link,
}

/// Every station sends what it has measured since its last report, and its offers; to itself, too, so that all know
/// the same at the same time.
pub fn report(
    clock: Res<SimClock>,
    network: Option<Res<Network>>,
    environment: Res<Environment>,
    mut stations: Query<Reporting>,
) {
    let Some(network) = network.filter(|network| clock.due(network.rate_hz)) else {
        return;
    };
    let stations_enu_m: Vec<DVec3> = (stations.iter())
        .map(|station| station.mount.r_enu_m)
        .collect();
    let number = clock.tick * u64::from(network.rate_hz) / u64::from(clock.tick_hz);
    let renews = number.is_multiple_of(u64::from((network.rate_hz / OFFERS_HZ).max(1)));
    let reports: Vec<Arc<Report>> = (stations.iter_mut())
        .map(|station| report_of(&clock, &environment, &stations_enu_m, renews, station))
        .map(Arc::new)
        .collect();
    let arrives = clock.tick + network.latency_ticks;
    for mut station in &mut stations {
        let link = &mut *station.link;
        for report in &reports {
            let own = report.station == station.station.index;
            let lost = !own && link.rng.uniform() < network.loss;
            if !lost {
                link.inbox.push_back((arrives, report.clone()));
            }
        }
    }
}

/// What a station sends; `renews`: its offers are worked out anew.
fn report_of(
    clock: &SimClock,
    environment: &Environment,
    stations_enu_m: &[DVec3],
    renews: bool,
    station: ReportingItem,
) -> Report {
    let (index, r_enu_m) = (station.station.index, station.mount.r_enu_m);
    let (picture, tracker, frame) = (station.picture, station.tracker, station.surveyed);
    let Link { sent_s, offers, .. } = station.link.into_inner();
    let worth = |track: &&Track| {
        track.fallen()
            || track.total_hits() >= REPORTED_HITS
                && track.log_odds() > REPORTED
                && !track.conduct.is_scenery()
    };
    let follower = |sensor: Sensor, number: u32| Follower {
        station: index,
        sensor,
        number,
    };
    // Numbers are never used again.
    sent_s.retain(|sent, _| match sent.sensor {
        Sensor::Cameras => tracker.table.get(sent.number).is_some(),
        Sensor::Radar => station.radar.tracks.get(sent.number as usize).is_some(),
    });
    // The newest measurement of a kind, if it has not been sent yet.
    let mut news = |follower: Follower, kind: usize, t_s: f64, measured: Measured| {
        let last_s = &mut sent_s.entry(follower).or_insert([f64::NEG_INFINITY; 2])[kind];
        let new = t_s > *last_s;
        *last_s = t_s;
        new.then(|| {
            frame.said(Fix {
                follower,
                t_s,
                measured,
            })
        })
    };
    let mut tracks = Vec::new();
    let mut add = |follower: Follower, fixes: [Option<Fix>; 2], log_odds: f64, fell: bool| {
        tracks.push(TrackReport {
            follower,
            identity: picture.of(follower).map(|object| object.identity),
            fixes: fixes.into_iter().flatten().collect(),
            log_odds,
            fell,
        });
    };
    for track in tracker.table.tracks.iter().filter(worth) {
        let follower = follower(Sensor::Cameras, track.id);
        let seen = track.sighted;
        let bearing = Measured::Bearing(Bearing {
            r_from_enu_m: r_enu_m,
            az_el_rad: seen.az_el_rad,
            sigma_rad: seen.sigma_rad,
        });
        let bearing = news(follower, 0, seen.t_s, bearing);
        let range = track.lased.and_then(|lased| {
            let range = Measured::Range(r_enu_m, lased.range_m, lased.sigma_m);
            news(follower, 1, lased.t_s, range)
        });
        add(follower, [bearing, range], track.log_odds(), track.fallen());
    }
    for (number, track) in station.radar.open() {
        let follower = follower(Sensor::Radar, number as u32);
        let plot = track.newest();
        let (r_plot_enu_m, covariance) = plot.converted(r_enu_m);
        let plot = news(
            follower,
            0,
            plot.t_s,
            Measured::Position(r_plot_enu_m, covariance),
        );
        add(follower, [plot, None], 0.0, false);
    }
    if renews {
        let bidder = Bidder {
            way: Way {
                rules: station.rules,
                environment,
                r_enu_m,
                stations_enu_m,
            },
            mount: station.mount,
            laser: station.laser,
            slew: SlewLimits::of(&station.mount.gimbal.params.azimuth),
        };
        *offers = (picture.objects.iter())
            .filter(|object| !object.dealt_with)
            // What it has left alone it would not take up.
            .filter(|object| {
                let own = object.number_at(index);
                let track = own.and_then(|id| tracker.table.get(id));
                track.is_none_or(|track| !track.is_barred(clock.t_s()))
            })
            .map(|object| {
                let held = tracker.target.is_some() && object.number_at(index) == tracker.target;
                let fired_s = held.then(|| clock.at_s(tracker.fired_ticks));
                let offer = bidder.offer(&frame.own(&object.track), clock.t_s(), fired_s);
                (object.identity, offer)
            })
            .collect();
    }
    Report {
        station: index,
        tick: clock.tick,
        tracks,
        offers: offers.clone(),
    }
}

/// What a station's offers depend on.
struct Bidder<'a> {
    way: Way<'a>,
    mount: &'a Mount,
    laser: &'a LaserSource,
    slew: SlewLimits,
}

impl Bidder<'_> {
    /// What the station offers for an object, at which it has fired for so long [s] if it is its target: slew, settling,
    /// and the dwell, for which the way there and what lies behind must stay open, as far as that can be foreseen. What
    /// is hidden in between is heated anew.
    fn offer(&self, object: &CartesianTrack, t_s: f64, fired_s: Option<f64>) -> Offer {
        let (r_enu_m, v_enu_mps) = object.advanced(t_s).motion_enu();
        let from_m = self.mount.r_enu_m;
        let at = los_to_az_el(r_enu_m - from_m);
        let off_rad = self
            .mount
            .gimbal
            .params
            .error_rad(at, self.mount.measured_az_el_rad());
        let ready_s = match fired_s {
            Some(fired_s) if fired_s > 0.0 => 0.0,
            _ => self.slew.slew_s(off_rad.abs().max_element()) + LOCKED_S,
        };
        let dwell_s = self.dwell_s(r_enu_m - from_m);
        let mut wanted_s = (dwell_s - fired_s.unwrap_or(0.0)).max(STEP_S);
        let (mut open_s, mut ahead_s, mut ever, mut steady) = (0.0, ready_s, false, true);
        while open_s < wanted_s && ahead_s < ready_s + FORESIGHT_S {
            if self.way.is_open(r_enu_m + ahead_s * v_enu_mps) {
                open_s += STEP_S;
                ever = true;
            } else {
                (open_s, wanted_s, steady) = (0.0, dwell_s, false);
            }
            ahead_s += STEP_S;
        }
        // What lies beyond the foresight is taken to be open.
        let engaged_s = if ever {
            ahead_s + (wanted_s - open_s).max(0.0)
        } else {
            f64::INFINITY
        };
        Offer { engaged_s, steady }
    }

    /// Time for which the laser would heat a common shell so far away [m] until what lies behind it fails [s].
    fn dwell_s(&self, to_enu_m: DVec3) -> f64 {
        const LONGEST_S: f64 = 60.0;
        /// A pale face throws light back until it is black, heat runs off, and the beam strays: `urban_intercept` and both
        /// beams of `two_stations` need 1.05 to 1.45 times as long.
        const LONGER: f64 = 1.3;
        let way = &self.way;
        let irradiance_wpm2 =
            expected_irradiance_wpm2(self.laser, way.environment, way.r_enu_m, to_enu_m);
        let air_k = way.environment.weather.temperature_k;
        let fails_s = ABS_SHELL.energy_jpm2(air_k) / (CHAR_ABSORPTIVITY * irradiance_wpm2);
        (LONGER * fails_s).min(LONGEST_S)
    }
}

/// Reports that have arrived go into each station's picture, in the order of the measurements' times.
pub fn receive(
    clock: Res<SimClock>,
    network: Option<Res<Network>>,
    mut stations: Query<(&Surveyed, &mut Link, &mut SharedPicture)>,
) {
    let Some(network) = network else { return };
    for (surveyed, mut link, mut picture) in &mut stations {
        let mut news = false;
        while let Some((_, report)) = link.inbox.pop_front_if(|(tick, _)| *tick <= clock.tick) {
            for track in &report.tracks {
                link.waiting.extend(&track.fixes);
                picture.judge(track.follower, track.log_odds, track.fell, track.identity);
            }
            link.latest.insert(report.station, report);
            news = true;
        }
        if !news {
            continue;
        }
        let until_s = surveyed.clock_s(clock.t_s()) - network.hold_s;
        let mut due: Vec<Fix> = link
            .waiting
            .extract_if(.., |fix| fix.t_s <= until_s)
            .collect();
        due.sort_by(|a, b| a.t_s.total_cmp(&b.t_s).then(a.follower.cmp(&b.follower)));
        for fix in &due {
            picture.take(fix);
        }
        picture.sort_out(until_s);
    }
}

/// A station as its task is found.
#[derive(QueryData)]
#[query_data(mutable)]
pub struct Tasked {
    station: &'static Station,
    mount: &'static Mount,
    params: &'static TrackerParams,
    link: &'static Link,
    picture: &'static SharedPicture,
    surveyed: &'static Surveyed,
    tasking: &'static mut Tasking,
}

/// Finds out, at every station by itself and so at all alike, which object each is to engage, and which to watch.
pub fn assign_targets(
    clock: Res<SimClock>,
    network: Option<Res<Network>>,
    mut stations: Query<Tasked>,
) {
    let Some(network) = network.filter(|_| clock.due(ASSIGNED_HZ)) else {
        return;
    };
    let stations_enu_m: Vec<DVec3> = (stations.iter())
        .map(|station| station.mount.r_enu_m)
        .collect();
    for station in &mut stations {
        assign_at(&clock, &network, &stations_enu_m, station);
    }
}

/// Finds the task of one of the stations, which stand there [m].
fn assign_at(clock: &SimClock, network: &Network, stations_enu_m: &[DVec3], station: TaskedItem) {
    let count = stations_enu_m.len();
    let TaskedItem {
        station,
        mount: _,
        params,
        link,
        picture,
        surveyed,
        mut tasking,
    } = station;
    let own = station.index;
    let now_s = surveyed.clock_s(clock.t_s());
    let open: Vec<&SharedObject> = (picture.objects.iter())
        .filter(|object| !object.dealt_with)
        .collect();
    let index_of = |identity: &Follower| open.iter().position(|o| o.identity == *identity);
    let expected_s: Vec<f64> = (open.iter())
        .map(|object| {
            let (r_enu_m, v_enu_mps) = object.track.advanced(now_s).motion_enu();
            let threat_s = time_to_asset_s(r_enu_m, v_enu_mps, params.r_asset_enu_m);
            threat_s * (1.0 + (-object.log_odds()).exp())
        })
        .collect();
    let heard = |report: &&Arc<Report>| clock.tick - report.tick < network.silent_ticks;
    let bids: Vec<Bid> = (link.latest.values().filter(heard))
        .flat_map(|report| {
            let of = |(identity, offer): (&Follower, &Offer)| {
                Some(Bid {
                    station: report.station,
                    target: index_of(identity)?,
                    offer: *offer,
                })
            };
            report.offers.iter().filter_map(of)
        })
        .collect();
    let before: Vec<Option<usize>> = (tasking.assigned.iter())
        .map(|identity| identity.as_ref().and_then(index_of))
        .collect();
    let (rule, hysteresis) = (network.rule, network.hysteresis);
    let places = open.iter().map(|o| o.track.advanced(now_s));
    let targets_enu_m: Vec<DVec3> = places.map(|track| track.motion_enu().0).collect();
    let share_out = |bids: &[Bid]| allocate(rule, count, &expected_s, bids, &before, hysteresis);
    let assigned = match rule {
        AllocationRule::None => share_out(&bids),
        AllocationRule::LeastCost | AllocationRule::Greedy => {
            allocate_apart(stations_enu_m, &targets_enu_m, &bids, share_out)
        }
    };
    let mut present = vec![None; count];
    present[own] = (tasking.task.as_ref()).and_then(|task| index_of(&task.identity));
    let watches = || watch(&assigned, &expected_s, &bids, &present, hysteresis)[own];
    tasking.task = assigned[own].or_else(watches).map(|target| Task {
        identity: open[target].identity,
        engages: assigned[own].is_some(),
        track: open[target].number_at(own),
        object: surveyed.own(&open[target].track),
    });
    let task = tasking.task.map(|task| task.identity);
    tasking.spared = (picture.objects.iter())
        .filter(|object| task != Some(object.identity))
        // Who chooses for itself leaves alone only what falls.
        .filter(|object| rule != AllocationRule::None || object.dealt_with)
        .filter_map(|object| object.number_at(own))
        .collect();
    let mut waiting: Vec<usize> = (0..open.len())
        .filter(|target| !assigned.contains(&Some(*target)))
        .collect();
    waiting.sort_by(|a, b| expected_s[*a].total_cmp(&expected_s[*b]).then(a.cmp(b)));
    let identity = |target: usize| open[target].identity;
    tasking.queue = waiting.into_iter().map(identity).collect();
    tasking.assigned = (assigned.iter())
        .map(|target| target.map(identity))
        .collect();
}

/// Notes how long the stations held each object, and who was assigned to it.
pub fn note_holdings(
    clock: Res<SimClock>,
    network: Option<Res<Network>>,
    stations: Query<(&Station, &SharedPicture, &Tracker, &Tasking)>,
    mut holdings: ResMut<Holdings>,
) {
    if network.is_none() {
        return;
    }
    let mut seen_s: BTreeMap<Follower, f64> = BTreeMap::new();
    for (station, picture, tracker, tasking) in &stations {
        for object in picture.objects.iter().filter(|object| !object.dealt_with) {
            let Some(track) =
                (object.number_at(station.index)).and_then(|id| tracker.table.get(id))
            else {
                continue;
            };
            let latest = seen_s.entry(object.identity).or_insert(f64::NEG_INFINITY);
            *latest = latest.max(track.seen_s());
            let holding = holdings
                .0
                .entry(object.identity)
                .or_insert_with(|| Holding {
                    from_s: clock.t_s(),
                    to_s: clock.t_s(),
                    ..default()
                });
            holding.stations.insert(station.index);
        }
        let task = tasking.task.filter(|task| task.engages);
        if let Some(holding) = task.and_then(|task| holdings.0.get_mut(&task.identity))
            && holding
                .engaged_by
                .last()
                .is_none_or(|(_, last)| *last != station.index)
        {
            holding.engaged_by.push((clock.t_s(), station.index));
        }
    }
    for (identity, seen_s) in seen_s {
        if let Some(holding) = holdings.0.get_mut(&identity) {
            // What ends with a last look has no gap behind it.
            holding.longest_gap_s = holding.longest_gap_s.max(seen_s - holding.to_s);
            holding.to_s = holding.to_s.max(seen_s);
        }
    }
}

/// Records every station's picture and task.
pub fn record_pictures(
    clock: Res<SimClock>,
    network: Option<Res<Network>>,
    stations: Query<(&Station, &SharedPicture, &Tasking)>,
    recording: Res<Recording>,
    mut topics: ResMut<OwnTopics>,
) -> Result<(), PartError> {
    let recorded = recording.recorder.is_some() && clock.due(ASSIGNED_HZ);
    let Some(network) = network.filter(|_| recorded) else {
        return Ok(());
    };
    let names: Vec<&str> = stations
        .iter()
        .map(|(station, ..)| station.name.as_str())
        .collect();
    let name = |follower: &Follower| {
        follower.named(names.get(follower.station).copied().unwrap_or_default())
    };
    for (station, picture, tasking) in &stations {
        let object = |object: &SharedObject| {
            let track = object.track.advanced(clock.t_s());
            let (r_enu_m, v_enu_mps) = track.motion_enu();
            ObjectState {
                identity: name(&object.identity),
                r_enu_m: r_enu_m.to_array(),
                v_enu_mps: v_enu_mps.to_array(),
                sigma_m: track.sigma_m(),
                log_odds: object.log_odds(),
                followers: object.followers.keys().map(name).collect(),
                dealt_with: object.dealt_with,
            }
        };
        let state = NetworkState {
            station: station.name.clone(),
            task: tasking.task.map(|task| name(&task.identity)),
            engages: tasking.task.is_some_and(|task| task.engages),
            queue: tasking.queue.iter().map(name).collect(),
            objects: picture.objects.iter().map(object).collect(),
        };
        topics.publish(network.topic, &state)?;
    }
    Ok(())
}
