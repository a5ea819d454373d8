//! What detector and recogniser said of each thing in each frame: what `boresight fit-detector` learns from.

use crate::components::capture::ExposedFrame;
use crate::components::detect::{DetectionBatch, DetectionQueue, DetectorInUse, Surroundings};
use crate::components::environment::Environment;
use crate::components::flight::{Distractor, Uav};
use crate::components::run::SimClock;
use crate::components::track::{Recognitions, Tracker};
use crate::models::optics::detection::Detection;
use crate::models::sensing::measured::{FalseRow, FoundRow, FrameRow, LookRow, NamedRow, Row};
use crate::models::tracking::recognition::TrackClass;
use crate::models::tracking::table::Track;
use crate::systems::detect::appearance::{appearance, az_el_rad, shown_box_px};
use bevy::prelude::*;
use glam::DVec2;

/// Directions in a frame, across and down, that stand for what is behind it.
const RAYS: [u32; 2] = [6, 4];

/// The looks of a run.
pub struct Looks {
    around: Surroundings,
    /// What was said.
    pub rows: Vec<Row>,
}

impl Looks {
    /// Those of a run that is about to start.
    pub fn new(world: &mut World) -> Self {
        let mut things = world.query::<(&Uav, Option<&Distractor>)>();
        let kinds: Vec<(usize, TrackClass)> = (things.iter(world))
            .map(|(uav, other)| (uav.index, Distractor::class_of(other)))
            .collect();
        let tick_hz = 1.0 / world.resource::<SimClock>().dt_s();
        Self {
            around: Surroundings::new(world.resource::<Environment>(), kinds, tick_hz),
            rows: Vec::new(),
        }
    }

    /// Takes in what a tick brought a station; `on` says which thing is on a track's line of sight.
    pub fn tick(&mut self, world: &World, station: Entity, on: impl Fn(&Track) -> Option<usize>) {
        let (clock, detector) = (
            world.resource::<SimClock>(),
            world.resource::<DetectorInUse>(),
        );
        let queue = world.get::<DetectionQueue>(station);
        for batch in queue.iter().flat_map(|queue| &queue.arrived) {
            self.frame(batch, clock.at_s(batch.frame.tick), detector);
        }
        let (Some(waiting), Some(tracker)) = (
            world.get::<Recognitions>(station),
            world.get::<Tracker>(station),
        ) else {
            return;
        };
        for (_, id, says) in waiting
            .0
            .iter()
            .filter(|(.., says)| says.t_s == clock.t_s())
        {
            let Some(track) = tracker.table.get(*id) else {
                continue;
            };
            let thing = on(track);
            let kind = thing.map_or(TrackClass::Other, |thing| self.around.kind(thing));
            self.rows.push(Row::Named(NamedRow {
                track: *id,
                t_s: says.t_s,
                thing,
                kind: kind.name().into(),
                size_px: track.evidence.best_px(),
                probabilities: says.probabilities,
            }));
        }
    }

    fn frame(&mut self, batch: &DetectionBatch, t_s: f64, detector: &DetectorInUse) {
        let frame = &*batch.frame;
        let [width, height] = batch.look.size_px.map(f64::from);
        self.rows.push(Row::Frame(FrameRow {
            t_s,
            tier: frame.tier,
            area_mpx: width * height * 1e-6 / f64::from(batch.shrunk).powi(2),
            sky: self.sky(frame, batch),
            floor: detector.reading.weak_score,
            start: detector.reading.start_score,
        }));
        let shown: Vec<[f64; 4]> = (frame.truth.iter())
            .map(|seen| shown_box_px(frame, seen))
            .collect();
        for (seen, box_px) in frame.truth.iter().zip(&shown) {
            if !seen.clear || !batch.look.holds(seen.aim_px) {
                continue;
            }
            let on: Vec<&Detection> = batch
                .detections
                .iter()
                .filter(|found| found.lies_on(*box_px))
                .collect();
            let named = on
                .iter()
                .filter_map(|found| Some((*found, detector.named(found.label)?)));
            let surest = named.max_by(|a, b| a.0.score.total_cmp(&b.0.score));
            let [x0, y0, x1, y1] = *box_px;
            let middle = DVec2::new(0.5 * (x0 + x1), 0.5 * (y0 + y1));
            self.rows.push(Row::Look(LookRow {
                t_s,
                thing: seen.uav,
                kind: self.around.kind(seen.uav).name().into(),
                appearance: appearance(&self.around, frame, seen, batch.shrunk),
                box_px: [x1 - x0, y1 - y0],
                found: surest.map(|(found, name)| FoundRow {
                    score: found.score,
                    name: name.into(),
                    off_px: (DVec2::from(found.centre_px()) - middle).into(),
                    box_px: size_px(found),
                }),
                moving: on.iter().any(|found| detector.named(found.label).is_none()),
            }));
        }
        for found in &batch.detections {
            let Some(name) = detector.named(found.label) else {
                continue;
            };
            if shown.iter().any(|box_px| found.lies_on(*box_px)) {
                continue;
            }
            let centre_px = DVec2::from(found.centre_px());
            let ray_enu = frame.pose.q_enu_cam * frame.pinhole.ray(centre_px);
            self.rows.push(Row::False(FalseRow {
                t_s,
                tier: frame.tier,
                az_el_rad: az_el_rad(frame, centre_px).into(),
                ifov_rad: frame.pinhole.ifov_rad(),
                score: found.score,
                name: name.into(),
                box_px: size_px(found).map(|side| side / f64::from(batch.shrunk)),
                in_sky: self.around.is_sky(frame.pose.r_enu_m, ray_enu),
            }));
        }
    }

    /// Share of what the detector looked at that shows the sky.
    fn sky(&self, frame: &ExposedFrame, batch: &DetectionBatch) -> f64 {
        let at = |axis: usize, step: u32| {
            let share = (f64::from(step) + 0.5) / f64::from(RAYS[axis]);
            f64::from(batch.look.offset_px[axis]) + share * f64::from(batch.look.size_px[axis])
        };
        let rays = (0..RAYS[0])
            .flat_map(|right| (0..RAYS[1]).map(move |down| DVec2::new(at(0, right), at(1, down))));
        let sky = rays.filter(|px| {
            let ray_enu = frame.pose.q_enu_cam * frame.pinhole.ray(*px);
            self.around.is_sky(frame.pose.r_enu_m, ray_enu)
        });
        sky.count() as f64 / f64::from(RAYS[0] * RAYS[1])
    }
}

fn size_px(found: &Detection) -> [f64; 2] {
    let [x0, y0, x1, y1] = found.box_px;
    [x1 - x0, y1 - y0]
}
