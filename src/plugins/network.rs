//! The stations' network.

use crate::components::capture::SensorCamera;
use crate::components::control::Radar;
use crate::components::mount::{Mount, Station};
use crate::components::network::{Holdings, Link, Network, SharedPicture, Surveyed, Tasking};
use crate::components::record::OwnTopics;
use crate::components::run::{RunScenario, Seed, SetUp, SimClock, Tick, TickSet};
use crate::components::track::TrackStage;
use crate::models::tracking::picture::{OwnFrame, SurveyErrors};
use crate::plugins::run::fallible;
use crate::systems::network as systems;
use crate::systems::run::nothing_failed;
use bevy::prelude::*;
use std::collections::{BTreeMap, VecDeque};

/// Adds the domain to the ticks, in [`TrackStage::Share`]: what arrives tells the tracker which target to take.
pub struct NetworkPlugin;

impl Plugin for NetworkPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<Holdings>()
            // Once the radars are there.
            .add_systems(SetUp, set_up.run_if(nothing_failed).in_set(TickSet::Engage))
            .add_systems(
                Tick,
                (
                    systems::report,
                    systems::receive,
                    systems::assign_targets,
                    systems::note_holdings,
                    fallible(systems::record_pictures),
                )
                    .chain()
                    .in_set(TrackStage::Share),
            );
    }
}

/// A station is not counted on after so long without a report [s], or so many that did not come.
const SILENT_S: f64 = 1.0;
const SILENT_REPORTS: f64 = 3.0;

/// By how many deviations two clocks may differ without a measurement's coming too late.
const CLOCK_SIGMAS: f64 = 4.0;

fn set_up(
    mut commands: Commands,
    loaded: Res<RunScenario>,
    seed: Res<Seed>,
    clock: Res<SimClock>,
    mut topics: ResMut<OwnTopics>,
    cameras: Query<&SensorCamera>,
    radars: Query<&Radar>,
    stations: Query<(Entity, &Station, &Mount)>,
) {
    let scenario = &loaded.scenario;
    let config = scenario.network();
    let errors = (config.as_ref()).map_or(SurveyErrors::default(), |config| SurveyErrors {
        position_m: config.position_sigma_m,
        turn_rad: config.alignment_deg.to_radians(),
        clock_s: config.clock_sigma_s,
    });
    for (entity, station, mount) in &stations {
        let number = station.index as u64;
        let link = Link {
            inbox: VecDeque::new(),
            rng: seed.stream(number, "link"),
            waiting: Vec::new(),
            latest: BTreeMap::new(),
            sent_s: BTreeMap::new(),
            offers: BTreeMap::new(),
        };
        let mut drawn = seed.stream(number, "survey");
        let frame = OwnFrame::drawn(errors, mount.r_enu_m, &mut drawn);
        let own = (
            link,
            Surveyed(frame),
            SharedPicture::default(),
            Tasking::default(),
        );
        commands.entity(entity).insert(own);
    }
    let Some(config) = config else {
        return;
    };
    let period_s = 1.0 / f64::from(config.rate_hz);
    // The longest way of a measurement: camera and detector, or radar; the wait for the next report; the link.
    let latencies = cameras.iter().map(|camera| camera.latency_ticks);
    let latencies = latencies.chain(radars.iter().map(|radar| radar.latency_ticks));
    let known_s = clock.at_s(latencies.max().unwrap_or_default());
    commands.insert_resource(Network {
        rate_hz: config.rate_hz,
        latency_ticks: clock.ticks_of(config.latency_s),
        silent_ticks: clock.ticks_of(config.latency_s + SILENT_S.max(SILENT_REPORTS * period_s)),
        loss: config.loss,
        hold_s: known_s + period_s + config.latency_s + CLOCK_SIGMAS * config.clock_sigma_s,
        rule: config.assignment,
        hysteresis: config.hysteresis,
        topic: topics.add("/boresight/network"),
    });
}
