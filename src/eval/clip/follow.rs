//! The tracker of a run, fed with the frames of a clip.
//!
//! It is that of a run with its table, its filter and its states. The clip is to it the coarse camera of
//! a station under an open sky, which turns as the scenery in its pictures says, and stands still where none shows. A
//! nominal pinhole turns pixels into angles, for the filter's motion is one of angles. Latency is none.

use super::arguments::Arguments;
use super::figures::State;
use crate::components::capture::{ExposedFrame, Tier};
use crate::components::detect::DetectionBatch;
use crate::components::mount::{OpticalPath, Pointing};
use crate::components::run::SimClock;
use crate::components::track::{Gallery, Tracker, TrackerParams};
use crate::eval::EvalError;
use crate::eval::shared::{confirmed, seen};
use crate::inference::OnnxRecogniser;
use crate::models::maths::kinematics::az_el_to_los;
use crate::models::optics::camera::Pinhole;
use crate::models::optics::detection::Detection;
use crate::models::optics::registration::Registration;
use crate::models::optics::tier::PerTier;
use crate::models::tracking::evidence::EvidenceParams;
use crate::models::tracking::recognition::WINDOW_S;
use crate::models::tracking::table::{JoinedTrack, Track};
use crate::scenario;
use crate::systems::track::recognise::Hung;
use crate::systems::track::{GIVEN_UP, Situation, patience_s, step, take_in};
use glam::{DVec2, DVec3};
use std::collections::BTreeMap;
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
    /// How the pictures move, and where something of its own showed in the last.
    registration: Registration,
    apart_px: Vec<[f64; 4]>,
    /// Where the camera looks, and the last frame whose motion is not known [s].
    pointing: Pointing,
    lost_s: f64,
    /// The last frame that showed scenery [s].
    scenery_s: f64,
    /// Share of the last second in which each track moved over the scenery, of those whose motion is known.
    moved: BTreeMap<u32, f64>,
    /// Probability from which on a track is taken for a UAV, and those held as such in the last frame.
    uav_probability: f64,
    believed: Vec<Followed>,
}

/// How often the recogniser looks at tracks [s], and at how many: those of a run.
const RECOGNISES_EVERY_S: f64 = 1.0 / 16.0; // [s]
const RECOGNISED: usize = 8;

/// Least motion over the scenery that counts as flight [px/s]: that of a run in its search camera.
const MOVING_PXPS: f64 = 6.0; // [px/s]

/// How far a small target moves from frame to frame at most, for what is called no UAV to go on with it [px].
const NEAR_PX: f64 = 12.0; // [px]

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
    /// Whether it is held as a UAV.
    pub(super) as_uav: bool,
}

/// Whether what may be a target is held as a UAV: from when the recogniser says so on, until the evidence is such that a run gives
/// its target up.
fn is_held(before: bool, log_odds: f64, recognised: bool) -> bool {
    if before {
        log_odds >= GIVEN_UP
    } else {
        log_odds > 0.0 && recognised
    }
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
                start_score: arguments.threshold.unwrap_or(0.0),
                reads: EvidenceParams {
                    min_quality: defaults.min_quality,
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
            registration: Registration::default(),
            apart_px: Vec::new(),
            pointing: Pointing::default(),
            lost_s: f64::NEG_INFINITY,
            scenery_s: f64::NEG_INFINITY,
            moved: BTreeMap::new(),
            uav_probability: arguments.uav_probability,
            believed: Vec::new(),
        })
    }

    /// Takes a frame's detections in; returns the tracks in view that are confirmed, or held as UAVs. `rgb8`: its pixels.
    pub(super) fn look(
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
        let frame = ExposedFrame {
            tick,
            pose,
            believed: pose,
            rgb8: (self.gallery.wanted).then(|| Arc::new(rgb8.to_vec())),
            ..ExposedFrame::bare(Tier::Coarse, self.pinhole)
        };
        let q_enu_cam = pose.q_enu_cam;
        let batch = DetectionBatch {
            available_tick: tick,
            look: frame.rect,
            frame: Arc::new(frame),
            detections: detections.to_vec(),
            shrunk: 1,
            best_scores: Vec::new(),
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
        let followed: Vec<Followed> = (self.tracker.table.tracks.iter())
            .filter_map(|track| {
                let p_uav = track.recognition.map(|found| found.p_uav());
                let before = self.believed.iter().any(|known| known.id == track.id);
                let as_uav = seen(track, t_s)
                    && now.may_be_target(track)
                    && is_held(
                        before,
                        track.log_odds(),
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
        let believed = followed.iter().filter(|track| track.as_uav);
        self.believed = believed.copied().collect();
        Ok(followed)
    }

    /// Whether a detection lies on a track that was held as a UAV in the last frame.
    pub(super) fn believes_in(&self, found: &Detection) -> bool {
        let centre_px = DVec2::from(found.centre_px());
        let near = |track: &Followed| track.px.distance(centre_px) < track.side_px.max(NEAR_PX);
        self.believed.iter().any(near)
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
        self.moved.retain(|id, _| table.get(*id).is_some());
        let sky_known = t_s - self.lost_s > WINDOW_S;
        let (first, at) = (self.tracker.target, (t_s, sky_known));
        let found = (self.gallery).recognise(model, table, first, RECOGNISED, at)?;
        for (id, found) in found {
            if let Some(track) = table.get_mut(id) {
                let sequence = self.gallery.sequence(track, t_s, sky_known);
                if let Some(flight) = sequence.and_then(|sequence| sequence.flight) {
                    // A young track must have come further than its places err.
                    let least_rad = self.params.centre_sigma_px * self.pinhole.ifov_rad();
                    let rate_radps = flight.rate_radps.length();
                    let moves = rate_radps > self.params.moving_radps
                        && rate_radps * flight.span_s > least_rad;
                    let moves = f64::from(u8::from(moves));
                    let moved = self.moved.entry(id).or_insert(moves);
                    *moved += RECOGNISES_EVERY_S / WINDOW_S * (moves - *moved);
                    // What stands still over scenery is part of it: in a clip no radar and no closer look says otherwise.
                    if *moved < 0.5 {
                        let again_s = t_s + 2.0 * RECOGNISES_EVERY_S;
                        track.barred_until_s = track.barred_until_s.max(again_s);
                    }
                }
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
    use std::num::NonZeroUsize;
    use std::path::{Path, PathBuf};

    const SIZE_PX: [u32; 2] = [320, 240];

    fn follower() -> Follower {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/models");
        let arguments = Arguments {
            files: Vec::new(),
            model: root.join("boresight-p2-roi.onnx"),
            out: PathBuf::new(),
            threshold: Some(0.2),
            boxes: None,
            category: Vec::new(),
            recogniser: Some(root.join("recogniser.onnx")),
            uav_probability: 0.5,
            fov_deg: 1.0,
            centre_sigma_px: 2.0,
            rate_hz: 30.0,
            threads: NonZeroUsize::new(1),
        };
        let classes = ["quadcopter".to_string()];
        Follower::new(SIZE_PX, 30.0, &classes, &arguments).unwrap()
    }

    /// A camera that pans by 3 px a frame over scenery, or over a bare sky, and two detections: one of something that stays where
    /// the scenery has it, one that flies 3 px a frame the other way. Whether each is left alone at the end.
    fn left_alone(scenery: bool) -> [bool; 2] {
        let [width, height] = SIZE_PX;
        let mut follower = follower();
        for k in 0..36 {
            let panned_px = 3.0 * f64::from(k);
            let places = [[220.0 - panned_px, 150.0], [60.0 + panned_px, 60.0]];
            let mut rgb8 = Vec::new();
            for y in 0..height {
                for x in 0..width {
                    let (x, y) = (f64::from(x), f64::from(y));
                    let u = x + panned_px;
                    let waves = [
                        0.31 * u + 0.12 * y,
                        0.13 * u - 0.29 * y,
                        0.07 * u + 0.45 * y,
                    ];
                    let texture: f64 = waves.iter().map(|phase| 15.0 * phase.sin()).sum();
                    let dark = (places.iter()).any(|[px, py]| (x - px).hypot(y - py) < 6.0);
                    let level = if dark {
                        30.0
                    } else {
                        140.0 + if scenery { texture } else { 0.0 }
                    };
                    rgb8.extend([level as u8; 3]);
                }
            }
            let found =
                places.map(|[x, y]| Detection::new([x - 6.0, y - 6.0, x + 6.0, y + 6.0], 0.9, 0));
            follower.look(f64::from(k) / 30.0, &rgb8, &found).unwrap();
        }
        let t_s = follower.clock.t_s();
        let cam_enu = (follower
            .pointing
            .pose(DVec3::ZERO, OpticalPath::OnGimbal, DVec3::ZERO))
        .q_enu_cam
        .inverse();
        [[220.0 - 105.0, 150.0], [60.0 + 105.0, 60.0]].map(|place| {
            let near = |track: &&Track| {
                let los_enu = az_el_to_los(track.filter.predicted(t_s).az_el_rad());
                let px = follower.pinhole.project(cam_enu * los_enu).unwrap();
                px.distance(place.into()) < 8.0
            };
            follower
                .tracker
                .table
                .tracks
                .iter()
                .find(near)
                .unwrap()
                .is_barred(t_s)
        })
    }

    #[test]
    fn what_stands_still_over_scenery_is_no_target_however_the_camera_pans() {
        assert_eq!(left_alone(true), [true, false]);
        // Without scenery nobody knows which of the two moves.
        assert_eq!(left_alone(false), [false, false]);
    }

    #[test]
    fn a_uav_is_held_until_a_run_would_give_it_up() {
        assert!(is_held(false, 0.1, true));
        assert!(!is_held(false, 0.1, false) && !is_held(false, -0.1, true));
        assert!(is_held(true, GIVEN_UP, false) && !is_held(true, GIVEN_UP - 0.1, true));
    }

    #[test]
    fn what_is_called_no_uav_goes_on_with_what_is_taken_for_one() {
        let mut follower = follower();
        let found = |x: f64| Detection::new([x - 6.0, 50.0, x + 6.0, 62.0], 0.5, 1);
        let track = Followed {
            id: 0,
            px: DVec2::new(100.0, 56.0),
            side_px: 10.0,
            seen_px: None,
            score: 0.5,
            p_uav: Some(0.9),
            as_uav: true,
        };
        assert!(!follower.believes_in(&found(104.0)));
        follower.believed = vec![track];
        assert!(follower.believes_in(&found(104.0)) && !follower.believes_in(&found(130.0)));
    }
}
