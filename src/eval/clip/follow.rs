//! The tracker of a run, fed with the frames of a clip.
//!
//! It is that of a run with its table, its filter and its states. The clip is to it the coarse camera of
//! a station that stands still under an open sky. A nominal pinhole turns pixels into angles, for the
//! filter's motion is one of angles. Latency is none.

use super::arguments::Arguments;
use super::figures::State;
use crate::components::capture::{ExposedFrame, Tier};
use crate::components::detect::DetectionBatch;
use crate::components::run::SimClock;
use crate::components::track::{Gallery, Tracker, TrackerParams};
use crate::eval::EvalError;
use crate::eval::shared::confirmed;
use crate::inference::OnnxRecogniser;
use crate::models::maths::kinematics::az_el_to_los;
use crate::models::optics::camera::Pinhole;
use crate::models::optics::detection::Detection;
use crate::models::optics::tier::PerTier;
use crate::models::tracking::evidence::EvidenceParams;
use crate::models::tracking::table::{JoinedTrack, Track};
use crate::scenario;
use crate::systems::track::recognise::Hung;
use crate::systems::track::{Situation, patience_s, step, take_in};
use glam::{DVec2, DVec3};
use std::sync::Arc;

/// Ticks of the tracker's clock a second: whole numbers of them for all usual rates.
const TICK_HZ: u32 = 90_000;

/// The run's tracker at work on a clip.
pub(super) struct Follower {
    clock: SimClock,
    params: TrackerParams,
    tracker: Tracker,
    pinhole: Pinhole,
    /// What says what the tracks are, if anything does, and when it does so next [s].
    recogniser: Option<OnnxRecogniser>,
    recognises_s: f64,
    gallery: Gallery,
    /// The detector's classes.
    classes: Vec<String>,
}

/// How often the recogniser looks at tracks [s], and at how many: those of a run.
const RECOGNISES_EVERY_S: f64 = 0.125; // [s]
const RECOGNISED: usize = 8;

/// A track in a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Followed {
    /// Identity.
    pub(super) id: u32,
    /// Where the filter has it [px].
    pub(super) px: DVec2,
    /// Larger side of its box [px].
    pub(super) side_px: f64,
    /// Its detection's box in this frame [px].
    pub(super) seen_px: Option<[f64; 4]>,
    /// Mean score.
    pub(super) score: f64,
    /// Probability that it is a UAV, once the recogniser has looked at it.
    pub(super) p_uav: Option<f64>,
}

impl Follower {
    pub(super) fn new(
        [width, height]: [u32; 2],
        rate_hz: f64,
        classes: &[String],
        arguments: &Arguments,
    ) -> Result<Self, EvalError> {
        let pinhole = Pinhole::from_hfov(width, height, arguments.fov_deg.to_radians())
            .map_err(EvalError::FieldOfView)?;
        let defaults = scenario::TrackerConfig::default();
        Ok(Self {
            clock: SimClock {
                tick: 0,
                tick_hz: TICK_HZ,
            },
            params: TrackerParams {
                nearest_to_centre: false,
                linear_angles: false,
                centre_sigma_px: arguments.centre_sigma_px,
                centre_sigma_rel: 0.0,
                start_score: 0.0,
                reads: EvidenceParams {
                    min_quality: defaults.min_quality,
                    ..EvidenceParams::default()
                },
                precise_field_rad: 0.0,
                switch_ratio: defaults.switch_ratio,
                r_asset_enu_m: DVec3::ZERO,
                aim: None,
                // There is no precise camera to lock.
                lock_radius_px: 0.0,
                lock_dwell_s: f64::INFINITY,
                break_radius_px: 0.0,
                fire_belief: 0.0,
                max_span_m: f64::INFINITY,
                patience_s: PerTier::of(|_| patience_s(rate_hz)),
            },
            tracker: Tracker::default(),
            pinhole,
            gallery: Gallery {
                wanted: arguments.recogniser.is_some(),
                ..Gallery::default()
            },
            recogniser: (arguments.recogniser.as_deref())
                .map(|path| OnnxRecogniser::load(path, "--recogniser"))
                .transpose()?,
            recognises_s: 0.0,
            classes: classes.to_vec(),
        })
    }

    /// Takes a frame's detections in; returns the confirmed tracks in view. `rgb8`: its pixels.
    pub(super) fn look(
        &mut self,
        t_s: f64,
        rgb8: &[u8],
        detections: &[Detection],
    ) -> Result<Vec<Followed>, EvalError> {
        let tick = (t_s * f64::from(TICK_HZ)).round() as u64;
        self.clock.tick = tick;
        let t_s = self.clock.t_s();
        let frame = ExposedFrame {
            tick,
            rgb8: (self.gallery.wanted).then(|| Arc::new(rgb8.to_vec())),
            ..ExposedFrame::bare(Tier::Coarse, self.pinhole)
        };
        let q_enu_cam = frame.pose.q_enu_cam;
        let batch = DetectionBatch {
            available_tick: tick,
            look: frame.rect,
            frame: Arc::new(frame),
            detections: detections.to_vec(),
            shrunk: 1,
            moving: Vec::new(),
            answered: true,
        };
        let (tracker, params) = (&mut self.tracker, &self.params);
        let assigned = take_in(tracker, params, &batch, t_s);
        let hung = Hung {
            batch: &batch,
            t_s,
            assigned: &assigned,
        };
        let class = |label: u32| {
            let name = self.classes.get(label as usize);
            Some(name.map_or("uav", String::as_str))
        };
        self.gallery.hang(&hung, &tracker.table, class);
        self.recognise(t_s)?;
        let now = Situation {
            tick,
            clock: &self.clock,
            params: &self.params,
            dsm: None,
            r_station_enu_m: DVec3::ZERO,
            cue: None,
            by_radar: true,
            mount: None,
            tasking: None,
            within: None,
        };
        step(&now, &mut self.tracker, false, true);
        let found = |track: &Track| {
            let index = assigned.iter().position(|id| *id == Some(track.id))?;
            detections.get(index).map(|detection| detection.box_px)
        };
        let followed = (self.tracker.table.tracks.iter())
            .filter(|track| confirmed(track, t_s))
            .filter_map(|track| {
                let los_enu = az_el_to_los(track.filter.predicted(t_s).az_el_rad());
                let px = (self.pinhole).project(q_enu_cam.inverse() * los_enu)?;
                Some(Followed {
                    id: track.id,
                    px,
                    side_px: track.size_rad / self.pinhole.ifov_rad(),
                    seen_px: found(track),
                    score: track.score,
                    p_uav: track.recognition.map(|found| found.p_uav()),
                })
            })
            .filter(|followed| self.pinhole.contains(followed.px));
        Ok(followed.collect())
    }

    /// Asks the recogniser what the tracks are, when it is time; how a clip's camera moves is not known.
    fn recognise(&mut self, t_s: f64) -> Result<(), EvalError> {
        let table = &mut self.tracker.table;
        let Some(model) = self
            .recogniser
            .as_mut()
            .filter(|_| t_s >= self.recognises_s)
        else {
            return Ok(());
        };
        self.recognises_s = t_s + RECOGNISES_EVERY_S;
        self.gallery.tidy(table);
        let (first, at) = (self.tracker.target, (t_s, false));
        let found = (self.gallery).recognise(model, table, first, RECOGNISED, at)?;
        for (id, found) in found {
            if let Some(track) = table.get_mut(id) {
                track.recognition = Some(found);
            }
        }
        Ok(())
    }

    /// The target that is held.
    pub(super) fn held(&self) -> Option<u32> {
        let held = self.tracker.state.holds(Tier::Coarse);
        self.tracker.target.filter(|_| held)
    }

    /// Young tracks that turned out to be old ones in the last frame: both identities.
    pub(super) fn joined(&self) -> &[JoinedTrack] {
        &self.tracker.table.joined
    }

    /// The states that the tracker went through.
    pub(super) fn into_states(self) -> Vec<State> {
        let changes = self.tracker.changes.into_iter();
        changes
            .map(|change| State {
                name: change.to.name(),
                start: change.tick as f64 / f64::from(TICK_HZ),
                reason: change.reason,
            })
            .collect()
    }
}
