//! The tracker of a run, fed with the frames of a clip.
//!
//! It is that of a run with its table, its filter and its states. The clip is to it the coarse camera of
//! a station under an open sky, which turns as the scenery in its pictures says, and stands still where none shows. A
//! nominal pinhole turns pixels into angles, for the filter's motion is one of angles. Latency is none.

use super::figures::State;
use crate::components::mount::{OpticalPath, Pointing};
use crate::components::run::SimClock;
use crate::eval::EvalError;
use crate::eval::shared::{confirmed, seen};
use crate::inference::OnnxRecogniser;
use crate::models::decision::gallery::Gallery;
use crate::models::decision::look::{Shown, take_in};
use crate::models::decision::machine::step;
use crate::models::decision::situation::{Situation, patience_s};
use crate::models::decision::tracker::{Tracker, TrackerParams};
use crate::models::decision::tuning::TrackerTuning;
use crate::models::maths::kinematics::az_el_to_los;
use crate::models::optics::camera::{CameraError, Pinhole};
use crate::models::optics::detection::Detection;
use crate::models::optics::registration::Registration;
use crate::models::optics::tier::{PerTier, Tier};
use crate::models::tracking::evidence::{EvidenceParams, ScoreModel};
use crate::models::tracking::recognition::{Sequence, WINDOW_S};
use crate::models::tracking::table::{JoinedTrack, Track};
use crate::scenario;
use glam::{DVec2, DVec3};
use std::path::PathBuf;

/// Ticks of the tracker's clock a second: whole numbers of them for all usual rates.
const TICK_HZ: u32 = 90_000;

/// Horizontal field of view that the tracker counts on where nothing else is said [deg].
pub const FOV_DEG: f64 = 1.0; // [deg]
/// Standard deviation of a detection's centre that it counts on [px]; on real pixels it is larger than the 0.5 px of a run.
pub const CENTRE_SIGMA_PX: f64 = 2.0; // [px]

/// What a follower is told.
#[derive(Clone, Debug)]
pub struct Following {
    /// Horizontal field of view that the tracker counts on [deg].
    pub fov_deg: f64,
    /// Standard deviation of a detection's centre that it counts on [px].
    pub centre_sigma_px: f64,
    /// Least score from which on a detection starts a track.
    pub start_score: f64,
    /// Score of a detection that speaks neither for a UAV nor against it.
    pub neutral_score: f64,
    /// The network that says what the tracks are, if any does.
    pub recogniser: Option<PathBuf>,
    /// Least probability with which its word counts as "a UAV".
    pub uav_probability: f64,
    /// Whether the last second of every track is kept, for [`Follower::sequences`].
    pub keeps: bool,
}

/// The run's tracker at work on a clip.
pub struct Follower {
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
    /// How the pictures move, and where something of its own showed in the last.
    registration: Registration,
    apart_px: Vec<[f64; 4]>,
    /// Where the camera looks, and the last frame whose motion is not known [s].
    pointing: Pointing,
    lost_s: f64,
    /// The last frame that showed scenery [s].
    scenery_s: f64,
    /// Probability from which on a track is taken for a UAV, and those held as such in the last frame.
    uav_probability: f64,
    held: Vec<u32>,
}

/// How often the recogniser looks at tracks [s], and at how many: those of a run.
const RECOGNISES_EVERY_S: f64 = 1.0 / 16.0; // [s]
const RECOGNISED: usize = 8;

/// Least motion over the scenery that counts as flight [px/s]: that of a run in its search camera.
const MOVING_PXPS: f64 = 6.0; // [px/s]

/// A track in a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Followed {
    /// Identity.
    pub id: u32,
    /// Where the filter has it [px].
    pub px: DVec2,
    /// Larger side of its box [px].
    pub side_px: f64,
    /// Its detection's box in this frame [px].
    pub seen_px: Option<[f64; 4]>,
    /// Mean score.
    pub score: f64,
    /// Probability that it is a UAV, once the recogniser has looked at it.
    pub p_uav: Option<f64>,
    /// Whether it is held as a UAV.
    pub as_uav: bool,
}

/// Log-odds below which what is held as a UAV no longer is.
const LET_GO: f64 = -2.0;
/// What standing before scenery says, as log-odds: where a camera that moves takes much for a UAV, nine to one must outweigh it.
const BEFORE_SCENERY: f64 = -2.2;

/// Whether what may be a target is held as a UAV: from when the recogniser says so on, until the evidence is such that a run gives
/// its target up.
fn is_held(before: bool, log_odds: f64, recognised: bool) -> bool {
    if before {
        log_odds >= LET_GO
    } else {
        log_odds > 0.0 && recognised
    }
}

/// The field of view does not fit the clip's pictures.
#[derive(Debug, thiserror::Error)]
#[error("--fov-deg: {0}; give another angle")]
struct FieldOfView(CameraError);

impl Follower {
    /// A tracker for pictures of a size at a rate, whose detections have these classes.
    pub fn new(
        [width, height]: [u32; 2],
        rate_hz: f64,
        classes: &[String],
        following: &Following,
    ) -> Result<Self, EvalError> {
        let pinhole = Pinhole::from_hfov(width, height, following.fov_deg.to_radians())
            .map_err(|why| EvalError::own(FieldOfView(why)))?;
        let defaults = scenario::TrackerConfig::default();
        Ok(Self {
            clock: SimClock {
                tick: 0,
                tick_hz: TICK_HZ,
            },
            params: TrackerParams {
                nearest_to_centre: false,
                linear_angles: false,
                centre_sigma_px: following.centre_sigma_px,
                centre_sigma_rel: 0.0,
                start_score: following.start_score,
                reads: EvidenceParams {
                    min_quality: defaults.min_quality,
                    score: ScoreModel::Network(following.neutral_score),
                    ..EvidenceParams::default()
                },
                precise_field_rad: 0.0,
                switch_ratio: defaults.switch_ratio,
                r_asset_enu_m: DVec3::ZERO,
                moving_radps: MOVING_PXPS * pinhole.ifov_rad(),
                open_sky: true,
                aim: None,
                // There is no precise camera to lock.
                lock_radius_px: 0.0,
                lock_dwell_s: f64::INFINITY,
                break_radius_px: 0.0,
                min_uav_probability: 0.0,
                max_span_m: f64::INFINITY,
                patience_s: PerTier::of(|_| patience_s(rate_hz)),
                tuning: TrackerTuning {
                    before_scenery: BEFORE_SCENERY,
                    ..TrackerTuning::default()
                },
            },
            tracker: Tracker::default(),
            pinhole,
            gallery: Gallery {
                wanted: following.keeps || following.recogniser.is_some(),
                ..Gallery::default()
            },
            recogniser: (following.recogniser.as_deref())
                .map(|path| OnnxRecogniser::load(path, "--recogniser"))
                .transpose()?,
            recognises_s: 0.0,
            classes: classes.to_vec(),
            registration: Registration::default(),
            apart_px: Vec::new(),
            pointing: Pointing::default(),
            lost_s: f64::NEG_INFINITY,
            scenery_s: f64::NEG_INFINITY,
            uav_probability: following.uav_probability,
            held: Vec::new(),
        })
    }

    /// Takes a frame's detections in; returns the tracks in view that are confirmed, or held as UAVs. `rgb8`: its pixels.
    pub fn look(
        &mut self,
        t_s: f64,
        rgb8: &[u8],
        detections: &[Detection],
    ) -> Result<Vec<Followed>, EvalError> {
        let tick = (t_s * f64::from(TICK_HZ)).round() as u64;
        self.clock.tick = tick;
        let t_s = self.clock.t_s();
        self.turn(t_s, rgb8);
        // Where the picture shows scenery, it may be behind anything.
        self.params.open_sky = t_s - self.scenery_s > WINDOW_S;
        self.apart_px = detections.iter().map(|found| found.box_px).collect();
        let pose = (self.pointing).pose(DVec3::ZERO, OpticalPath::OnGimbal, DVec3::ZERO);
        let q_enu_cam = pose.q_enu_cam;
        let whole = Shown::whole(Tier::Coarse, self.pinhole, pose);
        let shown = Shown {
            tick,
            t_s,
            available_tick: tick,
            exposure_s: 1e-3, // [s]: by day
            detections,
            picture: (self.gallery.wanted).then_some((rgb8, whole.look)),
            ..whole
        };
        let assigned = take_in(&mut self.tracker, &self.params, &shown);
        let class = |label: u32| {
            let name = self.classes.get(label as usize);
            Some(name.map_or("uav", String::as_str))
        };
        (self.gallery).hang(&shown, &assigned, &self.tracker.table, class);
        self.recognise(t_s)?;
        let now = Situation {
            tick,
            tick_hz: self.clock.tick_hz,
            params: &self.params,
            dsm: None,
            r_station_enu_m: DVec3::ZERO,
            cues: &[],
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
        let followed: Vec<Followed> = (self.tracker.table.tracks.iter())
            .filter_map(|track| {
                let p_uav = track.recognition.map(|found| found.p_uav());
                let before = self.held.contains(&track.id);
                let as_uav = seen(track, t_s)
                    && now.may_be_target(track)
                    && is_held(
                        before,
                        now.belief(track).log_odds(),
                        p_uav >= Some(self.uav_probability),
                    );
                if !as_uav && !confirmed(track, t_s) {
                    return None;
                }
                let los_enu = az_el_to_los(track.filter.predicted(t_s).az_el_rad());
                let px = (self.pinhole).project(q_enu_cam.inverse() * los_enu)?;
                Some(Followed {
                    id: track.id,
                    px,
                    side_px: track.size_rad / self.pinhole.ifov_rad(),
                    seen_px: found(track),
                    score: track.score,
                    p_uav,
                    as_uav,
                })
            })
            .filter(|followed| self.pinhole.contains(followed.px))
            .collect();
        let held = followed.iter().filter(|track| track.as_uav);
        self.held = held.map(|track| track.id).collect();
        Ok(followed)
    }

    /// Every track with its last second, of which enough was seen.
    pub fn sequences(&mut self) -> Vec<(&Track, Sequence)> {
        let (table, t_s) = (&self.tracker.table, self.clock.t_s());
        self.gallery.tidy(table);
        let sky_known = t_s - self.lost_s > WINDOW_S;
        let last_second = |track| Some((track, self.gallery.sequence(track, t_s, sky_known)?));
        table.tracks.iter().filter_map(last_second).collect()
    }

    /// Ticks of a time on the tracker's clock [s].
    pub fn ticks_of(&self, span_s: f64) -> u64 {
        self.clock.ticks_of(span_s)
    }

    /// Tick of the last frame, on the tracker's clock.
    pub fn tick(&self) -> u64 {
        self.clock.tick
    }

    /// Turns the camera as the scenery moved since the picture before.
    fn turn(&mut self, t_s: f64, rgb8: &[u8]) {
        let size_px = [self.pinhole.width_px, self.pinhole.height_px];
        let shift_px = (self.registration).shift_px(rgb8, size_px, &self.apart_px);
        match shift_px {
            Some(shift_px) => {
                self.scenery_s = t_s;
                let turned_rad = DVec2::new(-shift_px.x, shift_px.y) * self.pinhole.ifov_rad();
                self.pointing.az_el_rad += turned_rad;
            }
            // The first picture has none before it.
            None if t_s > 0.0 => self.lost_s = t_s,
            None => {}
        }
    }

    /// Asks the recogniser what the tracks are, when it is time; where the camera's motion was not known throughout the
    /// last second, it is left out.
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
        let sky_known = t_s - self.lost_s > WINDOW_S;
        let (first, at) = (self.tracker.target, (t_s, sky_known));
        let (ids, seconds) = (self.gallery).looked_at(table, first, RECOGNISED, at);
        let found = model.recognise(&seconds, t_s)?;
        for (id, found) in ids.into_iter().zip(found) {
            if let Some(track) = table.get_mut(id) {
                track.recognition = Some(match track.recognition {
                    Some(before) => found.after(&before),
                    None => found,
                });
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_uav_is_held_until_a_run_would_give_it_up() {
        assert!(is_held(false, 0.1, true));
        assert!(!is_held(false, 0.1, false) && !is_held(false, -0.1, true));
        assert!(is_held(true, LET_GO, false) && !is_held(true, LET_GO - 0.1, true));
    }
}
