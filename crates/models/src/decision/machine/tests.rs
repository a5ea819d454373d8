//! Engagements without a run: cameras that show what a test says.

use super::*;
use crate::decision::situation::{MOVING_RADPS, patience_s};
use crate::decision::tracker::TrackerParams;
use crate::decision::tuning::TrackerTuning;
use crate::ground::dsm::Dsm;
use crate::ground::height_grid::HeightGrid;
use crate::maths::kinematics::{az_el_to_los, los_to_az_el};
use crate::optics::tier::PerTier;
use crate::tracking::evidence::EvidenceParams;
use crate::tracking::recognition::Recognition;
use crate::tracking::table::{CameraLook, Lased, Occlusion, Sighting};
use glam::{DVec2, DVec3};

const TICK_HZ: u32 = 960;
/// Ticks from one frame of the cameras to the next.
const FRAME: u32 = 16;

fn params() -> TrackerParams {
    TrackerParams {
        nearest_to_centre: false,
        linear_angles: false,
        centre_sigma_px: 0.5,
        centre_sigma_rel: 0.0,
        start_score: 0.0,
        reads: EvidenceParams::default(),
        precise_field_rad: f64::INFINITY,
        switch_ratio: 2.0,
        r_asset_enu_m: DVec3::ZERO,
        moving_radps: MOVING_RADPS,
        open_sky: true,
        aim: None,
        lock_radius_px: 5.0,
        lock_dwell_s: 0.1,
        break_radius_px: 20.0,
        min_uav_probability: 0.95,
        max_span_m: 4.0,
        patience_s: PerTier::of(|_| patience_s(60.0)),
        tuning: TrackerTuning::default(),
    }
}

fn tuning() -> TrackerTuning {
    TrackerTuning::default()
}

fn situation(params: &TrackerParams, tick: u32) -> Situation<'_> {
    Situation {
        tick: u64::from(tick),
        tick_hz: TICK_HZ,
        params,
        dsm: None,
        r_station_enu_m: DVec3::ZERO,
        cues: &[],
        by_radar: true,
        mount: None,
        tasking: None,
        within: None,
    }
}

/// A precise error of a box of 8 px.
fn seen_at(tick: u64, offset_px: DVec2) -> BoresightError {
    BoresightError {
        exposure_tick: tick,
        available_tick: tick,
        angle_rad: DVec2::ZERO,
        offset_px,
        half_side_px: 4.0,
    }
}

/// A frame of the precise camera that shows UAVs where they are, their ranges known.
fn see(tracker: &mut Tracker, t_s: f64, uavs_enu_m: &[DVec3]) {
    see_by(3e-5, tracker, t_s, uavs_enu_m);
}

/// As `see`, by a camera of this angle a pixel [rad].
fn see_by(ifov_rad: f64, tracker: &mut Tracker, t_s: f64, uavs_enu_m: &[DVec3]) {
    let sighting = |r_enu_m: &DVec3| Sighting {
        az_el_rad: los_to_az_el(*r_enu_m),
        sigma_rad: 1e-5,
        size_rad: 6e-4,
        score: 0.9,
        label: 0,
        weak: false,
    };
    tracker.table.update(&CameraLook {
        tier: Tier::Precise,
        t_s,
        ifov_rad,
        reads: &EvidenceParams::default(),
        sightings: &uavs_enu_m.iter().map(sighting).collect::<Vec<_>>(),
        in_view: &|_| true,
        start_tracks: true,
    });
    for track in &mut tracker.table.tracks {
        let los = az_el_to_los(track.filter.predicted(t_s).az_el_rad());
        if let Some(r_enu_m) = uavs_enu_m.iter().find(|r| r.angle_between(los) < 1e-3) {
            track.ranged(r_enu_m.length(), 0.5, t_s);
        }
    }
}

/// A UAV 600 m away that sinks at `sink_mps`, is fired at for 0.2 s or not, and falls with `fall_mps2`
/// from then on for two seconds: why it is no target any more.
fn given_up(sink_mps: f64, fall_mps2: f64, fired: bool) -> Option<String> {
    let sunk_m = |t_s: f64| sink_mps * t_s + 0.5 * fall_mps2 * (t_s - 1.0).max(0.0).powi(2);
    given_up_on(sunk_m, fired)
}

/// The same of one that has sunk so far [m] at a time [s].
fn given_up_on(sunk_m: impl Fn(f64) -> f64, fired: bool) -> Option<String> {
    let params = params();
    let mut tracker = Tracker::default();
    for frame in 0..180_u32 {
        let t_s = f64::from(frame) / 60.0;
        see(
            &mut tracker,
            t_s,
            &[DVec3::new(0.0, 600.0, 80.0 - sunk_m(t_s))],
        );
        if frame == 30 {
            let id = tracker.table.tracks[0].id;
            tracker.acquire(u64::from(frame * FRAME), id, "test");
            tracker.change(u64::from(frame * FRAME), TrackingState::Engage, "test");
            tracker.lased = true;
        }
        for tick in frame * FRAME..(frame + 1) * FRAME {
            if frame > 30 && tracker.target.is_some() {
                let now = situation(&params, tick);
                let silent = seen_at(now.tick, DVec2::ZERO);
                tracker.error = PerTier::of(|_| Some(silent));
                tracker.locked_since.get_or_insert(0);
                step(
                    &now,
                    &mut tracker,
                    fired && (48..60).contains(&frame),
                    false,
                );
            }
        }
        if frame > 30 && tracker.target.is_none() {
            return tracker.changes.last().map(|change| change.reason.clone());
        }
    }
    None
}

#[test]
fn a_lost_target_gives_way_to_a_greater_threat() {
    let params = params();
    let mut tracker = Tracker::default();
    let (mut first, mut changed_s) = (0, None);
    for frame in 0..240_u32 {
        let t_s = f64::from(frame) / 60.0;
        // One flies away and is hidden from 1 s on, the other comes straight at the asset.
        let leaves = DVec3::new(60.0, 700.0 + 5.0 * t_s, 80.0);
        let comes = DVec3::new(-60.0, 500.0 - 20.0 * t_s, 80.0);
        let both = [comes, leaves];
        see(&mut tracker, t_s, &both[..if frame < 60 { 2 } else { 1 }]);
        if frame == 59 {
            let right = |track: &&Track| track.filter.predicted(t_s).az_el_rad().x > 0.0;
            first = tracker.table.tracks.iter().find(right).unwrap().id;
            tracker.acquire(u64::from(frame * FRAME), first, "test");
            tracker.change(u64::from(frame * FRAME), TrackingState::Lost, "test");
        }
        if frame > 59 && changed_s.is_none() {
            step(
                &situation(&params, frame * FRAME),
                &mut tracker,
                false,
                true,
            );
            if tracker.target != Some(first) {
                changed_s = Some(t_s);
            }
        }
    }
    assert_eq!(
        tracker.state,
        TrackingState::Acquire,
        "{:?}",
        tracker.changes
    );
    let waited_s = changed_s.unwrap() - 1.0;
    assert!(
        (tuning().rival_s..tuning().rival_s + 0.1).contains(&waited_s),
        "{waited_s}"
    );
}

#[test]
fn a_dot_that_the_recogniser_doubts_is_looked_at_closer() {
    let params = params();
    // 20 and 4 px long.
    for (ifov_rad, dot) in [(3e-5, false), (1.5e-4, true)] {
        let mut tracker = Tracker::default();
        for frame in 0..12_u32 {
            let r_enu_m = DVec3::new(0.0, 600.0, 80.0);
            see_by(ifov_rad, &mut tracker, f64::from(frame) / 60.0, &[r_enu_m]);
        }
        tracker.table.tracks[0].conduct.in_sky = true;
        let now = situation(&params, 12 * FRAME);
        for (p_uav, chosen) in [(0.05, false), (0.45, dot), (0.9, true)] {
            judge(&mut tracker, p_uav);
            let found = now.candidate(&tracker).is_some();
            assert_eq!(found, chosen, "{dot} {p_uav}");
        }
    }
}

/// What a recogniser's word counts on what has no name.
const DOT_SHARE: f64 = 0.3;

#[test]
fn what_is_seen_well_and_not_recognised_is_left() {
    // With this probability, with a radar's cue or without, by a camera of this angle a pixel [rad].
    let held_by_s = |ifov_rad: f64, p_uav: f64, cued: bool| {
        let held = Held {
            ifov_rad,
            state: TrackingState::Engage,
            from: 60,
            frames: 640,
            ..Held::default()
        };
        let cue = cued.then(|| hovers_at(held.r_enu_m));
        let left = Held { cue, ..held }.left_after_s(|_, tracker| judge(tracker, p_uav));
        left.map(|(after_s, _)| after_s)
    };
    let held_s = |p_uav: f64, cued: bool| held_by_s(3e-5, p_uav, cued);
    let about = |left_s: Option<f64>, expected_s: f64| {
        let left_s = left_s.unwrap();
        let within = expected_s..expected_s + 0.1;
        assert!(within.contains(&left_s), "{left_s} {expected_s}");
    };
    let worth_s = tuning().worth_s;
    // At odds of three and six to one, of one to four, and hardly any.
    about(held_s(0.75, false), 3.0 * worth_s);
    about(held_s(6.0 / 7.0, false), 6.0 * worth_s);
    about(held_s(1.0 / 3.0, false), 0.5 * worth_s);
    about(held_s(0.02, false), tuning().least_doubt_s);
    assert_eq!(held_s(0.99, false), None);
    // Where the radar points, only what is less likely than not costs anything; its word multiplies the odds.
    assert_eq!(held_s(0.75, true), None);
    about(held_s(0.2, true), 0.25 * tuning().cue_for.exp() * worth_s);
    // A dot, 4 px long.
    about(
        held_by_s(1.5e-4, 0.75, false),
        3.0_f64.powf(DOT_SHARE) * worth_s,
    );
}

#[test]
fn what_is_larger_than_a_uav_is_left() {
    // A box of 0.6 mrad, at this range by the range finder [m].
    let left = |range_m: f64| {
        let held = Held {
            r_enu_m: DVec3::new(0.0, range_m, 80.0),
            state: TrackingState::Engage,
            ..Held::default()
        };
        held.left_after_s(|frame, tracker| {
            tracker.table.tracks[0].lased = Some(echo(frame, range_m));
        })
    };
    // 3.9 and 4.2 m.
    assert_eq!(left(6500.0), None);
    let (after_s, barred_s) = left(7000.0).unwrap();
    let expected_s = tuning().least_doubt_s..tuning().least_doubt_s + 0.1;
    assert!(expected_s.contains(&after_s), "{after_s}");
    assert!(
        (barred_s - tuning().disproved_barred_s).abs() < 1e-9,
        "{barred_s}"
    );
}

#[test]
fn the_recogniser_must_be_sure_for_some_time_before_fire() {
    let params = params();
    let mut tracker = Tracker::default();
    let mut sure_s = None;
    for frame in 0..240_u32 {
        let t_s = f64::from(frame) / 60.0;
        see(&mut tracker, t_s, &[DVec3::new(0.0, 600.0, 80.0)]);
        // Sure for a quarter of a second, then not, and sure from 2 s on.
        let spell = (60..75).contains(&frame) || frame >= 120;
        judge(&mut tracker, if spell { 0.99 } else { 0.6 });
        let tick = u64::from(frame * FRAME);
        if frame == 30 {
            let id = tracker.table.tracks[0].id;
            tracker.acquire(tick, id, "test");
            tracker.change(tick, TrackingState::Precise, "test");
        }
        if frame > 30 {
            tracker.error = PerTier::of(|_| Some(seen_at(tick, DVec2::ZERO)));
            let now = situation(&params, frame * FRAME);
            step(&now, &mut tracker, false, frame.is_multiple_of(6));
        }
        if sure_s.is_none()
            && tracker
                .target_uav_probability()
                .is_some_and(|belief| belief >= 0.95)
        {
            sure_s = Some(t_s - 2.0);
        }
    }
    // 0.99 is 4.6, 0.95 2.9, and before it is at 0.4: 1 − e^(−t / 0.5 s) = 0.60, t = 0.46 s, in steps of 0.1 s.
    let sure_s = sure_s.unwrap();
    assert!((0.35..0.6).contains(&sure_s), "{sure_s}");
    // No longer sure, it is not fired at from then on.
    judge(&mut tracker, 0.6);
    assert!(tracker.target_uav_probability().unwrap() < 0.65);
}

/// Something that stays where it is and becomes the target.
struct Held<'a> {
    r_enu_m: DVec3,
    /// Angle a pixel of the camera that sees it [rad].
    ifov_rad: f64,
    /// In this state, from this frame on, for so many.
    state: TrackingState,
    from: u32,
    frames: u32,
    /// What is known besides.
    dsm: Option<&'a Dsm>,
    cue: Option<TargetCue>,
    by_radar: bool,
    /// Whether it is judged as it is held, ten times a second.
    weighed: bool,
}

impl Default for Held<'_> {
    fn default() -> Self {
        Self {
            r_enu_m: DVec3::new(0.0, 600.0, 80.0),
            ifov_rad: 3e-5,
            state: TrackingState::Precise,
            from: 30,
            frames: 150,
            dsm: None,
            cue: None,
            by_radar: true,
            weighed: false,
        }
    }
}

impl Held<'_> {
    /// After how long it is left, and for how long it is barred then [s]; `each` says what is known of it in a frame.
    fn left_after_s(&self, each: impl Fn(u32, &mut Tracker)) -> Option<(f64, f64)> {
        let params = params();
        let mut tracker = Tracker::default();
        for frame in 0..=self.from + self.frames {
            let (t_s, tick) = (f64::from(frame) / 60.0, u64::from(frame * FRAME));
            see_by(self.ifov_rad, &mut tracker, t_s, &[self.r_enu_m]);
            if frame == self.from {
                let id = tracker.table.tracks[0].id;
                tracker.acquire(tick, id, "test");
                tracker.change(tick, self.state, "test");
            }
            each(frame, &mut tracker);
            if frame > self.from {
                tracker.error = PerTier::of(|_| Some(seen_at(tick, DVec2::ZERO)));
                let now = Situation {
                    dsm: self.dsm,
                    cues: self.cue.as_slice(),
                    by_radar: self.by_radar,
                    ..situation(&params, frame * FRAME)
                };
                let weighs = self.weighed && frame.is_multiple_of(6);
                step(&now, &mut tracker, false, weighs);
                if tracker.target.is_none() {
                    let held_s = t_s - f64::from(self.from) / 60.0;
                    return Some((held_s, tracker.table.tracks[0].barred_until_s - t_s));
                }
            }
        }
        None
    }
}

/// A radar's target that hovers at a place.
fn hovers_at(r_enu_m: DVec3) -> TargetCue {
    TargetCue {
        az_el_rad: los_to_az_el(r_enu_m),
        sigma_rad: DVec2::splat(0.01),
        range_m: r_enu_m.length(),
        range_sigma_m: 15.0,
        rate_radps: DVec2::ZERO,
        rate_sigma_radps: DVec2::splat(5e-3),
    }
}

/// An echo of the range finder from so far away [m].
fn echo(frame: u32, range_m: f64) -> Lased {
    Lased {
        t_s: f64::from(frame) / 60.0,
        range_m,
        sigma_m: 0.5,
    }
}

#[test]
fn what_is_no_further_off_than_the_wall_behind_it_is_left() {
    // A wall from 600 m to the north on, 200 m high.
    let heights = |wall_m: f64| {
        let height_m = move |_: f64, n_m: f64| if n_m > 600.0 { wall_m } else { 0.0 };
        HeightGrid::from_fn(DVec2::new(-100.0, 500.0), 2.0, [100, 100], height_m)
    };
    let dsm = Dsm::new(heights(0.0), heights(200.0), 0.0);
    // What never flew, so far to the north by the range finder, whose echo is so old [s]; seen by a camera of this angle a
    // pixel [rad].
    let left_seen_by = |ifov_rad: f64, north_m: f64, flown: bool, age_s: f64| {
        let held = Held {
            r_enu_m: DVec3::new(0.0, north_m, 80.0),
            ifov_rad,
            state: TrackingState::Engage,
            dsm: Some(&dsm),
            ..Held::default()
        };
        held.left_after_s(|frame, tracker| {
            judge(tracker, 0.97);
            let track = &mut tracker.table.tracks[0];
            (track.conduct.in_scenery, track.conduct.flown) = (true, flown);
            let fresh = echo(frame, held.r_enu_m.length());
            track.lased = Some(Lased {
                t_s: fresh.t_s - age_s,
                ..fresh
            });
        })
    };
    // 20 px long.
    let left = |north_m, flown, age_s| left_seen_by(3e-5, north_m, flown, age_s);
    let (after_s, barred_s) = left(597.0, false, 0.0).unwrap();
    let expected_s = tuning().least_doubt_s..tuning().least_doubt_s + 0.1;
    assert!(expected_s.contains(&after_s), "{after_s}");
    assert!(
        (barred_s - tuning().disproved_barred_s).abs() < 1e-9,
        "{barred_s}"
    );
    // Well before it, or known to fly, or by an old echo.
    assert_eq!(left(580.0, false, 0.0), None);
    assert_eq!(left(597.0, true, 0.0), None);
    assert_eq!(left(597.0, false, 0.5), None);
    // Beyond an edge of which it stands clear: it is no part of that.
    assert_eq!(left(650.0, false, 0.0), None);
    // 60 px long and plainly a UAV.
    assert_eq!(left_seen_by(1e-5, 597.0, false, 0.0), None);
}

#[test]
fn what_was_hardly_seen_is_not_waited_for_behind_a_building_as_long_as_what_is_known() {
    let waited_s = |followed_s: f64| {
        let params = params();
        let mut tracker = Tracker::default();
        let last = (followed_s * 60.0) as u32;
        for frame in 0..=last {
            let t_s = f64::from(frame) / 60.0;
            see_by(3e-5, &mut tracker, t_s, &[DVec3::new(0.0, 600.0, 80.0)]);
        }
        let (id, tick) = (tracker.table.tracks[0].id, u64::from(last * FRAME));
        tracker.acquire(tick, id, "test");
        tracker.change(tick, TrackingState::Lost, "test");
        tracker.table.tracks[0].occlusion = Some(Occlusion {
            enter_s: followed_s,
            exit_s: None,
            exit_az_el_rad: DVec2::ZERO,
        });
        let left = (last + 1..last + 900).find(|frame| {
            step(
                &situation(&params, frame * FRAME),
                &mut tracker,
                false,
                false,
            );
            tracker.target.is_none()
        });
        left.map(|frame| f64::from(frame - last) / 60.0).unwrap()
    };
    for followed_s in [1.0, 5.0] {
        let expected_s = tuning().lost_timeout_s + followed_s;
        assert!(
            (waited_s(followed_s) - expected_s).abs() < 0.05,
            "{expected_s}"
        );
    }
}

#[test]
fn what_is_lost_and_seen_again_by_turns_is_doubted_all_the_same() {
    let left = |p_uav: f64| {
        Held::default().left_after_s(|frame, tracker| {
            judge(tracker, p_uav);
            if frame > 30 && frame.is_multiple_of(12) {
                let turns = [TrackingState::Precise, TrackingState::Lost];
                let tick = u64::from(frame * FRAME);
                tracker.change(tick, turns[frame as usize / 12 % 2], "test");
            }
        })
    };
    let (after_s, _) = left(0.01).unwrap();
    let expected_s = tuning().least_doubt_s..tuning().least_doubt_s + 0.1;
    assert!(expected_s.contains(&after_s), "{after_s}");
    assert_eq!(left(0.8), None);
}

#[test]
fn one_that_flies_among_birds_is_taken_for_one_of_them() {
    let params = params();
    // What is left of such a belief after three seconds beside a bird or a balloon, so far above [m], judged so, at this
    // speed [m/s].
    let believed_beside =
        |p_uav: f64, above_m: f64, p_other: f64, speed_mps: f64, balloon: bool| {
            let mut tracker = Tracker::default();
            for frame in 0..180_u32 {
                let t_s = f64::from(frame) / 60.0;
                let flies = DVec3::new(12.0 * t_s, 600.0, 80.0);
                let other = DVec3::new(speed_mps * t_s, 600.0, 80.0 + above_m);
                see(&mut tracker, t_s, &[flies, other]);
                for (track, p_uav) in tracker.table.tracks.iter_mut().zip([p_uav, p_other]) {
                    let [bird, balloon] = if balloon && p_uav < 0.5 {
                        [0.0, 1.0 - p_uav]
                    } else {
                        [1.0 - p_uav, 0.0]
                    };
                    track.recognition = Some(Recognition {
                        probabilities: [p_uav, bird, 0.0, 0.0, balloon, 0.0],
                        t_s,
                    });
                }
                if frame.is_multiple_of(6) {
                    let now = situation(&params, frame * FRAME);
                    now.weigh(&mut tracker.table, 0.1);
                }
            }
            assert_eq!(tracker.table.tracks.len(), 2);
            tracker.table.tracks[0].uav_belief()
        };
    let believed =
        |p_other: f64, speed_mps: f64| believed_beside(0.97, 10.0, p_other, speed_mps, false);
    // Were it there for ever, 0.728: (1 − s) 0.97 + s 0.398 with s = 0.42, the share that it is one of them.
    let among = believed(0.02, 11.0);
    assert!((0.72..0.77).contains(&among), "{among}");
    // By how much depends on how much it looks like one of them itself.
    assert!(believed_beside(0.8, 10.0, 0.02, 11.0, false) < 0.35);
    assert!(believed_beside(0.997, 10.0, 0.02, 11.0, false) > 0.95);
    assert!(believed_beside(0.97, 10.0, 0.02, 11.0, true) > 0.96);
    // A part of itself says nothing.
    assert!((believed_beside(0.97, 0.5, 0.02, 11.9, false) - 0.97).abs() < 1e-6);
    // One that goes its own way, or another UAV, says nothing.
    assert!((believed(0.02, 8.0) - 0.97).abs() < 1e-6);
    assert!((believed(0.98, 11.0) - 0.97).abs() < 1e-6);
    // One that nothing is known of hardly counts.
    assert!(believed(0.45, 11.0) > 0.96);
}

#[test]
fn a_doubted_target_gives_way_to_a_uav() {
    let params = params();
    // Seen in so many pixels, with these probabilities of being a UAV.
    let weighed = |size_px: f64, p_target: f64, p_other: f64| {
        let mut tracker = Tracker::default();
        let mut first = 0;
        for frame in 0..120_u32 {
            let t_s = f64::from(frame) / 60.0;
            // Both come at the same speed, the target from nearer by.
            let target = DVec3::new(-60.0, 500.0 - 20.0 * t_s, 80.0);
            let other = DVec3::new(60.0, 600.0 - 20.0 * t_s, 80.0);
            see_by(6e-4 / size_px, &mut tracker, t_s, &[target, other]);
            for track in &mut tracker.table.tracks {
                let held = track.filter.predicted(t_s).az_el_rad().x < 0.0;
                let p_uav = if held { p_target } else { p_other };
                first = if held { track.id } else { first };
                track.recognition = Some(Recognition {
                    probabilities: [p_uav, 1.0 - p_uav, 0.0, 0.0, 0.0, 0.0],
                    t_s,
                });
            }
            let tick = u64::from(frame * FRAME);
            if frame == 10 {
                tracker.acquire(tick, first, "test");
                tracker.change(tick, TrackingState::Precise, "test");
            }
            if frame > 10 {
                let now = situation(&params, frame * FRAME);
                step(&now, &mut tracker, false, true);
            }
            if tracker.target.is_some_and(|id| id != first) {
                return Some(t_s - 10.0 / 60.0);
            }
        }
        None
    };
    assert_eq!(weighed(20.0, 0.95, 0.95), None);
    // What a close look speaks against is given up after its odds.
    let changed_s = weighed(20.0, 0.3, 0.95).unwrap();
    assert!((0.4..0.55).contains(&changed_s), "{changed_s}");
    // What would not be chosen is no rival, and a dot is held for its odds, too.
    assert_eq!(weighed(20.0, 0.3, 0.6), None);
    for p_target in [0.3, 0.6] {
        let odds: f64 = p_target / (1.0 - p_target);
        let held_s = odds.powf(DOT_SHARE) * tuning().worth_s;
        let changed_s = weighed(6.0, p_target, 0.65).unwrap();
        assert!((held_s..held_s + 0.1).contains(&changed_s), "{changed_s}");
    }
}

/// The recogniser finds the first track a UAV with this probability.
fn judge(tracker: &mut Tracker, p_uav: f64) {
    tracker.table.tracks[0].recognition = Some(Recognition {
        probabilities: [p_uav, 1.0 - p_uav, 0.0, 0.0, 0.0, 0.0],
        t_s: 0.2,
    });
}

#[test]
fn the_radar_vouches_for_what_the_range_finder_meets_and_flies_alike() {
    let params = params();
    let mut tracker = Tracker::default();
    let flies = |t_s: f64| DVec3::new(12.0 * t_s, 600.0, 80.0);
    for frame in 0..60_u32 {
        let t_s = f64::from(frame) / 60.0;
        see(&mut tracker, t_s, &[flies(t_s)]);
    }
    let r_enu_m = flies(1.0);
    let cue = |range_m: f64, rate_radps: f64| TargetCue {
        az_el_rad: los_to_az_el(r_enu_m),
        sigma_rad: DVec2::splat(0.01),
        range_m,
        range_sigma_m: 15.0,
        rate_radps: DVec2::new(rate_radps, 0.0),
        rate_sigma_radps: DVec2::splat(2e-3),
    };
    let vouches = |tracker: &Tracker, cue, by_radar| {
        let now = Situation {
            cues: &[cue],
            by_radar,
            ..situation(&params, 60 * FRAME)
        };
        now.vouches(&tracker.table.tracks[0])
    };
    let (range_m, rate_radps) = (r_enu_m.length(), 12.0 / 600.0);
    let right = cue(range_m, rate_radps);
    // Nothing has come back yet.
    assert_eq!(vouches(&tracker, right, true), 0.0);
    let echo = Lased {
        t_s: 0.9,
        range_m,
        sigma_m: 0.5, // [m]
    };
    let track = &mut tracker.table.tracks[0];
    track.lased = Some(echo);
    track.ranged(range_m, echo.sigma_m, echo.t_s);
    assert_eq!(vouches(&tracker, right, true), 1.0);
    for (cue, by_radar) in [
        (right, false),
        (cue(range_m + 50.0, rate_radps), true),
        (cue(range_m, -rate_radps), true),
        (cue(range_m + 150.0, rate_radps), false),
    ] {
        assert_eq!(vouches(&tracker, cue, by_radar), 0.0, "{cue:?}");
    }
    // What is there by chance at another range is all the less to be fired at.
    let nearer = cue(range_m - 150.0, rate_radps);
    assert_eq!(vouches(&tracker, nearer, true), -3.0);
}

#[test]
fn scenery_may_hover_where_the_recogniser_or_the_radar_says_so() {
    let params = params();
    let mut tracker = Tracker::default();
    let r_enu_m = DVec3::new(0.0, 600.0, 80.0);
    for frame in 0..12_u32 {
        see(&mut tracker, f64::from(frame) / 60.0, &[r_enu_m]);
    }
    tracker.table.tracks[0].conduct.in_scenery = true;
    let at = los_to_az_el(r_enu_m);
    let cue = |off_rad: f64, rate_radps: f64| TargetCue {
        az_el_rad: at + DVec2::new(off_rad, 0.0),
        sigma_rad: DVec2::splat(0.01),
        range_m: r_enu_m.length(),
        range_sigma_m: 15.0,
        rate_radps: DVec2::new(rate_radps, 0.0),
        rate_sigma_radps: DVec2::splat(5e-3),
    };
    let chosen = |tracker: &Tracker, cue: Option<TargetCue>| {
        let now = Situation {
            cues: cue.as_slice(),
            ..situation(&params, 12 * FRAME)
        };
        now.candidate(tracker).is_some()
    };
    assert!(!chosen(&tracker, None) && !chosen(&tracker, Some(cue(0.03, 0.0))));
    assert!(chosen(&tracker, Some(cue(0.01, 0.005))));
    // What the radar sees fly does not stand there.
    assert!(!chosen(&tracker, Some(cue(0.01, 0.03))));
    for (p_uav, may) in [(0.85, false), (0.95, true)] {
        judge(&mut tracker, p_uav);
        assert_eq!(chosen(&tracker, None), may, "{p_uav}");
    }
    // Four pixels long, it is worth a closer look before that.
    let mut tracker = Tracker::default();
    for frame in 0..12_u32 {
        see_by(1.5e-4, &mut tracker, f64::from(frame) / 60.0, &[r_enu_m]);
    }
    tracker.table.tracks[0].conduct.in_scenery = true;
    for (p_uav, may) in [(0.3, false), (0.55, true)] {
        judge(&mut tracker, p_uav);
        assert_eq!(chosen(&tracker, None), may, "{p_uav}");
    }
}

#[test]
fn what_flies_as_the_radars_target_does_is_looked_at_closely() {
    const SPEED_MPS: f64 = 12.0;
    let params = params();
    let mut tracker = Tracker::default();
    let at = |t_s: f64| DVec3::new(SPEED_MPS * t_s, 600.0, 80.0);
    for frame in 0..=60_u32 {
        let t_s = f64::from(frame) / 60.0;
        see(&mut tracker, t_s, &[at(t_s)]);
    }
    tracker.table.tracks[0].conduct.flown = true;
    judge(&mut tracker, 0.3);
    let range_m = at(1.0).length();
    let cue = |rate_radps: f64| TargetCue {
        az_el_rad: los_to_az_el(at(1.0)),
        sigma_rad: DVec2::splat(0.01),
        range_m,
        range_sigma_m: 15.0,
        rate_radps: DVec2::new(rate_radps, 0.0),
        rate_sigma_radps: DVec2::splat(5e-3),
    };
    let chosen = |tracker: &Tracker, rate_radps: f64, by_radar: bool| {
        let now = Situation {
            cues: &[cue(rate_radps)],
            by_radar,
            ..situation(&params, 60 * FRAME)
        };
        now.candidate(tracker).is_some()
    };
    let rate_radps = SPEED_MPS / range_m;
    assert!(chosen(&tracker, rate_radps, true));
    assert!(!chosen(&tracker, rate_radps, false));
    assert!(!chosen(&tracker, -rate_radps, true));
    // At rates that might be none it does not count, nor for what has not flown.
    assert!(!chosen(&tracker, 0.6 * rate_radps, true));
    tracker.table.tracks[0].conduct.flown = false;
    tracker.table.tracks[0].conduct.moving_s = 1.0;
    assert!(!chosen(&tracker, rate_radps, true));
}

#[test]
fn what_the_radar_points_at_and_vouches_for_is_doubted_later() {
    let doubted_s = |cue: Option<TargetCue>, radar_log_odds: f64| {
        let held = Held {
            state: TrackingState::Acquire,
            cue,
            ..Held::default()
        };
        let left = held.left_after_s(|_, tracker| {
            judge(tracker, 0.25);
            // The precise camera has not seen it yet.
            tracker.hits_in_state = PerTier::default();
            tracker.radar_log_odds = radar_log_odds;
        });
        left.map(|(after_s, _)| after_s)
    };
    let cue = Some(hovers_at(Held::default().r_enu_m));
    let alone_s = tuning().worth_s / 3.0;
    assert_eq!(doubted_s(cue, 1.0), None);
    for (cue, expected_s) in [(None, alone_s), (cue, 1.0_f64.exp() * alone_s)] {
        let radar_log_odds = 0.0;
        let left_s = doubted_s(cue, radar_log_odds).unwrap();
        let within = expected_s..expected_s + 0.1;
        assert!(within.contains(&left_s), "{left_s} {expected_s}");
    }
}

#[test]
fn a_target_that_stands_before_scenery_must_go_on_to_look_like_a_uav() {
    let cue = hovers_at(Held::default().r_enu_m);
    let given_up_s = |p_uav: f64, in_scenery: bool, cue: Option<TargetCue>| {
        let held = Held {
            cue,
            ..Held::default()
        };
        let left = held.left_after_s(|_, tracker| {
            judge(tracker, p_uav);
            let conduct = &mut tracker.table.tracks[0].conduct;
            (conduct.in_scenery, conduct.in_sky) = (in_scenery, !in_scenery);
        });
        left.map(|(after_s, _)| after_s)
    };
    let after = |left_s: Option<f64>, odds: f64| {
        let (left_s, expected_s) = (left_s.unwrap(), odds * tuning().worth_s);
        let within = expected_s.max(tuning().least_doubt_s)..expected_s.max(0.3) + 0.1;
        assert!(within.contains(&left_s), "{left_s} {expected_s}");
    };
    let stands = tuning().before_scenery.exp();
    after(given_up_s(0.6, true, None), 1.5 * stands);
    // Sure of it, in the sky, or pointed at by the radar.
    assert_eq!(given_up_s(0.98, true, None), None);
    after(given_up_s(0.6, false, None), 1.5);
    assert_eq!(given_up_s(0.6, true, Some(cue)), None);
    // The radar follows its target elsewhere: in another direction, at another range.
    let beside = TargetCue {
        az_el_rad: cue.az_el_rad + DVec2::new(0.05, 0.0),
        ..cue
    };
    let before = TargetCue {
        range_m: 500.0,
        ..cue
    };
    for other in [beside, before] {
        after(given_up_s(0.97, true, Some(other)), 0.0);
        assert_eq!(given_up_s(0.97, false, Some(other)), None);
    }
}

#[test]
fn what_is_not_where_the_radar_has_its_target_must_surely_be_a_uav() {
    let there = hovers_at(Held::default().r_enu_m);
    let cue = |off_m: f64| {
        Some(TargetCue {
            range_m: there.range_m + off_m,
            ..there
        })
    };
    // An echo in every frame but those of each second half of a second.
    let given_up_s = |p_uav: f64, cue: Option<TargetCue>, by_radar: bool, echoes: bool| {
        let held = Held {
            cue,
            by_radar,
            frames: 210,
            weighed: true,
            ..Held::default()
        };
        let left = held.left_after_s(|frame, tracker| {
            judge(tracker, p_uav);
            let track = &mut tracker.table.tracks[0];
            track.conduct.in_sky = true;
            let meets = echoes && frame % 60 < 30;
            track.lased = meets.then(|| echo(frame, there.range_m));
        });
        left.map(|(after_s, _)| after_s)
    };
    let nearer = cue(-150.0);
    let waited_s = given_up_s(0.7, nearer, true, true).unwrap();
    assert!((2.0..2.6).contains(&waited_s), "{waited_s}");
    // Surely a UAV, where the radar has its target.
    assert_eq!(given_up_s(0.999, nearer, true, true), None);
    assert_eq!(given_up_s(0.7, cue(20.0), true, true), None);
    // Known by the defence, or without an echo.
    assert_eq!(given_up_s(0.7, nearer, false, true), None);
    assert_eq!(given_up_s(0.7, nearer, true, false), None);
    // Where nothing points, at odds of 7 to 3.
    let waited_s = given_up_s(0.7, None, true, true).unwrap();
    assert!((2.3..2.5).contains(&waited_s), "{waited_s}");
}

#[test]
fn a_box_that_flutters_about_the_reticle_is_locked() {
    let params = params();
    // The state after half a second of boxes whose middles are at these places in turn [px].
    let after = |offsets_px: [[f64; 2]; 2]| {
        let mut tracker = Tracker::default();
        for frame in 0..60_u32 {
            let t_s = f64::from(frame) / 60.0;
            see(&mut tracker, t_s, &[DVec3::new(0.0, 600.0, 80.0)]);
            let tick = u64::from(frame * FRAME);
            if frame == 30 {
                let id = tracker.table.tracks[0].id;
                tracker.acquire(tick, id, "test");
                tracker.change(tick, TrackingState::Precise, "test");
            }
            if frame > 30 {
                let offset_px = DVec2::from(offsets_px[frame as usize % 2]);
                tracker.error = PerTier::of(|_| Some(seen_at(tick, offset_px)));
                step(
                    &situation(&params, frame * FRAME),
                    &mut tracker,
                    false,
                    false,
                );
            }
        }
        tracker.state
    };
    let (locked, not) = (TrackingState::Engage, TrackingState::Precise);
    assert_eq!(after([[8.0, 0.0], [-8.0, 1.0]]), locked);
    assert_eq!(after([[8.0, 0.0], [6.0, 0.0]]), not);
    assert_eq!(after([[4.0, 0.0], [4.0, 0.0]]), locked);
}

#[test]
fn silence_begins_when_the_news_arrives() {
    let params = params();
    let mut tracker = Tracker::default();
    // Exposed at the start, known 0.4 s later: a slow detector is no lost target.
    tracker.error[Tier::Coarse] = Some(BoresightError {
        available_tick: 384,
        ..seen_at(0, DVec2::ZERO)
    });
    let lost = |tick| situation(&params, tick).lost_by(&tracker, Tier::Coarse);
    assert_eq!([390, 624, 625].map(lost), [false, false, true]);
}

#[test]
fn a_slow_camera_may_miss_a_frame() {
    assert_eq!([960.0, 60.0, 10.0].map(patience_s), [0.25; 3]);
    // At 4 Hz and below a quarter of a second holds no frame but the last.
    assert!(patience_s(4.0) > 2.0 / 4.0 && patience_s(1.0) > 2.0);
}

#[test]
fn only_what_was_fired_at_and_did_not_dive_before_falls() {
    assert_eq!(given_up(8.0, 0.0, true), None);
    assert_eq!(given_up(0.0, 0.0, true), None);
    assert_eq!(given_up(0.0, 9.8, false), None);
    // It rose to its place while it was fired at.
    let rises = |t_s: f64| -8.0 * t_s.min(2.0) + 4.0 * (t_s.min(2.0) - 1.0).max(0.0).powi(2);
    assert_eq!(given_up_on(rises, true), None);
    assert_eq!(
        given_up(0.0, 9.8, true).as_deref(),
        Some("the target falls")
    );
    assert_eq!(
        given_up(8.0, 9.8, true).as_deref(),
        Some("the target falls")
    );
}
