//! Why a UAV is not brought down: what the cameras showed of it, what hid it, what it flew into. Truth, for summary and report.

use crate::components::capture::{SensorCamera, UavInFrame};
use crate::components::detect::{DetectionBatch, DetectionQueue, DetectorInUse};
use crate::components::environment::Environment;
use crate::components::flight::{Flight, HeatedSkin, Uav, UavStatus};
use crate::components::mount::{Mount, Station};
use crate::components::record::{CameraHistory, Crash, Fates, History};
use crate::components::run::SimClock;
use crate::models::ground::city::Met;
use crate::models::ground::dsm::LineOfSight;
use crate::models::optics::clutter::{Contrast, contrast};
use bevy::prelude::*;
use glam::DVec3;

/// How often the sight lines from the stations are looked at [Hz].
const SIGHT_LINE_HZ: u32 = 4;
/// How often a camera's pictures are measured for contrast, at most [1/s].
const CONTRAST_HZ: u32 = 10;
/// A UAV of which less than this share shows is hidden.
const HIDDEN_SHARE: f64 = 0.1;
/// A camera that has not exposed for so many of its periods has idled meanwhile.
const IDLE_PERIODS: u64 = 8;
/// How far a UAV that has flown into the city is put beside it, besides half its size [m].
const BESIDE_M: f64 = 2.5;
/// What is as near to a station's head as this has met the station [m].
const AT_STATION_M: f64 = 4.0;

/// Sums up what the pictures that have arrived show of each UAV.
pub fn keep_sights(
    clock: Res<SimClock>,
    detector: Res<DetectorInUse>,
    queues: Query<&DetectionQueue>,
    mut cameras: Query<(&SensorCamera, &mut CameraHistory)>,
) {
    for batch in queues.iter().flat_map(|queue| &queue.arrived) {
        let Ok((camera, mut history)) = cameras.get_mut(batch.frame.camera) else {
            continue;
        };
        let tick = batch.frame.tick;
        let gap = (history.arrived_tick.replace(tick)).map(|last| tick.saturating_sub(last));
        let idle = |gap: &u64| *gap > IDLE_PERIODS * camera.period_ticks;
        let shown_ticks = gap.filter(|gap| !idle(gap)).unwrap_or(camera.period_ticks);
        let shown_s = clock.at_s(shown_ticks);
        let pictures_apart = clock.ticks_of(1.0 / f64::from(CONTRAST_HZ)) / camera.period_ticks;
        let measured = batch.frame.number.is_multiple_of(pictures_apart.max(1));
        let threshold = detector.reading.start_score;
        for (place, seen) in batch.frame.truth.iter().enumerate() {
            if !seen.distractor && is_within(batch, seen) {
                let sight = history.sights.entry(seen.uav).or_default();
                let hidden = is_hidden(seen);
                sight.pictures += 1;
                sight.in_view_s += shown_s;
                sight.hidden_s += if hidden { shown_s } else { 0.0 };
                let found = (batch.detections.iter())
                    .any(|found| found.score >= threshold && found.lies_on(seen.box_px));
                sight.found += u32::from(found);
                let [x0, y0, x1, y1] = seen.box_px;
                sight.size_px.add((x1 - x0).max(y1 - y0));
                let best = batch.best_scores.get(place).copied().flatten();
                sight.best_score = [sight.best_score, best]
                    .into_iter()
                    .flatten()
                    .reduce(f64::max);
                if measured
                    && !hidden
                    && let Some(found) = measure(batch, seen)
                {
                    sight.contrast.add(found.ratio());
                    sight.grey.add(found.around);
                }
            }
        }
    }
}

/// Whether the middle of a UAV lies in the pixels that were read.
fn is_within(batch: &DetectionBatch, seen: &UavInFrame) -> bool {
    let rect = &batch.frame.rect;
    [0, 1].iter().all(|&axis| {
        let from = f64::from(rect.offset_px[axis]);
        (from..from + f64::from(rect.size_px[axis])).contains(&seen.aim_px[axis])
    })
}

/// Whether something hides a UAV from a camera.
fn is_hidden(seen: &UavInFrame) -> bool {
    seen.rendered.map_or(!seen.clear, |rendered| {
        rendered.visible_fraction < HIDDEN_SHARE
    })
}

/// How a UAV stands out in a picture.
fn measure(batch: &DetectionBatch, seen: &UavInFrame) -> Option<Contrast> {
    let frame = &batch.frame;
    let [dx, dy] = frame.rect.offset_px.map(f64::from);
    let [x0, y0, x1, y1] = seen.rendered.and_then(|r| r.box_px).unwrap_or(seen.box_px);
    let box_px = [x0 - dx, y0 - dy, x1 - dx, y1 - dy];
    contrast(frame.rgb8.as_ref()?, frame.rect.size_px, box_px)
}

/// Sums up for how long each station could have seen each UAV that flies.
pub fn keep_dealings(
    clock: Res<SimClock>,
    environment: Res<Environment>,
    mut stations: Query<(&Mount, &mut History)>,
    uavs: Query<(&Uav, &Flight, &UavStatus), With<HeatedSkin>>,
) {
    if !clock.due(SIGHT_LINE_HZ) {
        return;
    }
    let lasts_s = clock.at_s(u64::from((clock.tick_hz / SIGHT_LINE_HZ).max(1)));
    for (mount, mut history) in &mut stations {
        for (uav, flight, status) in &uavs {
            if *status == UavStatus::Flying {
                let sight = environment.line_of_sight(mount.r_enu_m, flight.aim_enu_m());
                let dealing = history.dealings.entry(uav.index).or_default();
                match sight {
                    LineOfSight::Clear => dealing.clear_s += lasts_s,
                    LineOfSight::BlockedAt(_) => dealing.hidden_s += lasts_s,
                }
            }
        }
    }
}

/// A UAV that was just struck, as far as others matter to it.
struct Struck {
    index: usize,
    name: String,
    r_enu_m: DVec3,
    radius_m: f64,
}

/// Notes when and where a UAV flew into something, and into what.
pub fn note_crashes(
    clock: Res<SimClock>,
    environment: Res<Environment>,
    stations: Query<(&Station, &Mount)>,
    uavs: Query<(&Uav, &Flight, &UavStatus), With<HeatedSkin>>,
    mut fates: ResMut<Fates>,
) {
    let is_new = |uav: &Uav, status: &UavStatus| {
        let known = fates
            .uavs
            .get(uav.index)
            .is_some_and(|fate| fate.crash.is_some());
        matches!(status, UavStatus::Struck | UavStatus::Crashed) && !known
    };
    let struck: Vec<Struck> = (uavs.iter())
        .filter(|(uav, _, status)| is_new(uav, status))
        .map(|(uav, flight, _)| Struck {
            index: uav.index,
            name: uav.name.clone(),
            r_enu_m: flight.state.r_enu_m,
            radius_m: 0.5 * uav.size_m[0].max(uav.size_m[1]),
        })
        .collect();
    for own in &struck {
        let touches = |other: &&Struck| {
            let reach_m = own.radius_m + other.radius_m;
            // A tick of flight lies between touch and fall.
            other.index != own.index && own.r_enu_m.distance(other.r_enu_m) < 1.2 * reach_m
        };
        let other = struck.iter().find(touches);
        let at_station = stations
            .iter()
            .find(|(_, mount)| mount.r_enu_m.distance(own.r_enu_m) < AT_STATION_M + own.radius_m);
        let into = match (other, at_station) {
            (Some(other), _) => format!("the UAV {}", other.name),
            (None, Some((station, _))) => format!("the station {}", station.name),
            (None, None) => city_words(&environment, own),
        };
        if let Some(fate) = fates.uavs.get_mut(own.index) {
            fate.crash = Some(Crash {
                t_s: clock.t_s(),
                r_enu_m: own.r_enu_m,
                into,
            });
        }
    }
}

/// What of the city a UAV has flown into.
fn city_words(environment: &Environment, own: &Struck) -> String {
    let city = &environment.city;
    match city.met(own.r_enu_m, own.radius_m + BESIDE_M) {
        Met::Building(index) => {
            let building = &city.buildings[index];
            let kind = building.kind.words();
            let comma = if kind.is_empty() { "" } else { ", " };
            let height_m = building.height_m();
            format!("building {index} ({kind}{comma}{height_m:.0} m high)")
        }
        Met::Tree => "a tree".into(),
        Met::Ground => "the ground".into(),
        Met::Solid(height_m) => format!("what stands {height_m:.0} m above the ground there"),
    }
}
