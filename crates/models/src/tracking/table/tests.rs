use super::belief::PART_OF_AIRCRAFT;
use super::*;
use crate::ground::dsm::Dsm;
use crate::maths::kinematics::los_to_az_el;
use crate::maths::rng::Stream;
use crate::optics::tier::Tier;
use crate::tracking::evidence::{EvidenceParams, EvidenceTuning, ScoreModel};
use crate::tracking::recognition::Recognition;
use glam::{DVec2, DVec3};

fn sighting(az: f64, el: f64) -> Sighting {
    Sighting {
        az_el_rad: DVec2::new(az, el),
        sigma_rad: 3e-5,
        size_rad: 3e-4,
        score: 0.9,
        label: 0,
        weak: false,
    }
}

const READS: EvidenceParams = EvidenceParams {
    min_quality: 0.6,
    score: ScoreModel::Network(0.289),
    other_classes: 0,
    tuning: EvidenceTuning::DEFAULT,
};

fn look<'a>(t_s: f64, sightings: &'a [Sighting]) -> CameraLook<'a> {
    CameraLook {
        tier: Tier::Search,
        t_s,
        ifov_rad: 1e-4,
        reads: &READS,
        sightings,
        in_view: &|_| true,
        start_tracks: true,
    }
}

#[test]
fn two_targets_that_cross_keep_their_identities() {
    let mut table = TrackTable::default();
    let mut rng = Stream::new(1, 0, "test");
    let mut noise = || 3e-5 * rng.normal();
    let at = |t: f64| [(0.008 * (t - 1.0), 1e-4), (-0.008 * (t - 1.0), -1e-4)];
    for i in 0..=120 {
        let t = f64::from(i) / 60.0;
        let seen = at(t).map(|(az, el)| sighting(az + noise(), el + noise()));
        table.update(&look(t, &seen));
    }
    assert_eq!(table.tracks.len(), 2);
    for (track, (az, _)) in table.tracks.iter().zip(at(2.0)) {
        let los = track.filter.predicted(2.0);
        assert!((los.az_rad - az).abs() < 2e-4, "{} {az}", los.az_rad);
    }
}

#[test]
fn what_is_small_by_the_range_finder_is_no_helicopter() {
    // A track of 0.75 mrad that may be a UAV, a bird or a helicopter, with an echo from this range.
    let p_uav = |range_m: Option<f64>, [uav, bird, helicopter]: [f64; 3]| {
        let mut table = TrackTable::default();
        let seen = Sighting {
            size_rad: 7.5e-4,
            ..sighting(0.0, 0.0)
        };
        table.update(&look(0.0, &[seen]));
        let track = &mut table.tracks[0];
        track.recognition = Some(Recognition {
            probabilities: [uav, bird, 0.0, helicopter, 0.0, 0.0],
            t_s: 0.0,
        });
        track.lased = range_m.map(|range_m| Lased {
            t_s: 0.0,
            range_m,
            sigma_m: 0.5,
        });
        track.found().unwrap().p_uav()
    };
    let near = |p: f64, expected: f64| assert!((p - expected).abs() < 1e-12, "{p} {expected}");
    let doubtful = [0.9, 0.02, 0.08];
    // 0.75 m, then 3.75 m; without an echo it may be of any size.
    near(
        p_uav(Some(1_000.0), doubtful),
        0.9 / (0.92 + 0.08 * PART_OF_AIRCRAFT),
    );
    near(p_uav(Some(5_000.0), doubtful), 0.9);
    near(p_uav(None, doubtful), 0.9);
    // A bird is as small, and what looks like nothing else is still most likely a part of one.
    near(p_uav(Some(1_000.0), [0.5, 0.5, 0.0]), 0.5);
    assert!(p_uav(Some(1_000.0), [0.001, 0.0, 0.999]) < 0.05);
}

#[test]
fn what_something_passes_is_to_be_recognised_anew() {
    // Two recognised tracks at these rates to the right [rad/s], which meet after a second and part again.
    let after = |rates_radps: [f64; 2], both_fly: bool| {
        let mut table = TrackTable::default();
        let mut passed_s = Vec::new();
        for i in 0..=96 {
            let t_s = f64::from(i) / 60.0;
            for (index, track) in table.tracks.iter_mut().enumerate() {
                track.conduct.flown = both_fly || index == 0;
                if i == 30 {
                    track.recognition = Some(Recognition {
                        probabilities: [0.95, 0.01, 0.01, 0.01, 0.01, 0.01],
                        t_s,
                    });
                }
            }
            let seen = [(rates_radps[0], 1e-4), (rates_radps[1], -1e-4)]
                .map(|(rate_radps, el)| sighting(rate_radps * (t_s - 1.0), el));
            table.update(&look(t_s, &seen));
            if !table.passed.is_empty() {
                assert_eq!(table.passed, [0, 1]);
                passed_s.push(t_s);
            }
        }
        let known = table.tracks.iter().map(|track| track.recognition.is_some());
        (known.collect::<Vec<_>>(), passed_s)
    };
    let (known, passed_s) = after([0.008, -0.008], true);
    assert_eq!(known, [false, false]);
    // Boxes of 0.3 mrad that close at 16 mrad/s touch for 35 ms.
    assert!(
        passed_s.iter().all(|t_s| (t_s - 1.0).abs() < 0.02),
        "{passed_s:?}"
    );
    // Scenery is passed by what flies all the time; what flies in company is no other a moment later.
    assert_eq!(after([0.008, -0.008], false), (vec![true, true], vec![]));
    assert_eq!(after([0.008, 0.0078], true), (vec![true, true], vec![]));
}

#[test]
fn a_flicker_does_not_last() {
    let mut table = TrackTable::default();
    table.update(&look(0.0, &[sighting(0.1, 0.1)]));
    for i in 1..4 {
        table.update(&look(f64::from(i) / 30.0, &[]));
    }
    assert!(table.tracks.is_empty());
}

#[test]
fn a_young_track_outlasts_cameras_that_have_not_seen_it_yet() {
    let kept = |tier: Tier| {
        let mut table = TrackTable::default();
        for i in 0..8 {
            table.update(&look(f64::from(i) / 30.0, &[sighting(0.1, 0.1)]));
        }
        for i in 0..12 {
            let t_s = 0.25 + f64::from(i) / 120.0;
            let unseen = CameraLook {
                tier,
                start_tracks: false,
                ..look(t_s, &[])
            };
            table.update(&unseen);
        }
        table.tracks.len()
    };
    assert_eq!([Tier::Precise, Tier::Search].map(kept), [1, 0]);
}

#[test]
fn a_camera_that_never_saw_a_track_does_not_make_it_seen_less() {
    // The coarse camera shows it in four frames of five, at 10 Hz; the search camera, at 30 Hz, in none.
    let mut table = TrackTable::default();
    for i in 0..60 {
        let t_s = f64::from(i) / 30.0;
        if i % 3 == 0 {
            let seen = [sighting(0.1, 0.1)];
            let coarse = CameraLook {
                tier: Tier::Coarse,
                ..look(t_s, if i % 15 == 12 { &[] } else { &seen })
            };
            table.update(&coarse);
        }
        table.update(&look(t_s, &[]));
    }
    let [track] = &table.tracks[..] else {
        panic!("{} tracks", table.tracks.len())
    };
    assert!(
        (track.seen_share() - 0.8).abs() < 1e-12,
        "{}",
        track.seen_share()
    );
    assert!(track.filter.quality() < 0.4, "{}", track.filter.quality());
}

#[test]
fn a_track_is_of_the_class_its_detections_speak_for() {
    let mut table = TrackTable::default();
    // Two weak sightings for every strong one of another class; later ones outweigh the first.
    let seen = |label: u32, score: f64| Sighting {
        label,
        score,
        ..sighting(0.0, 0.0)
    };
    let mut t_s = 0.0;
    let mut label = |next: Sighting| {
        t_s += 1.0 / 30.0;
        table.update(&look(t_s, &[next]));
        table.tracks[0].label()
    };
    assert_eq!(label(seen(2, 0.3)), 2);
    label(seen(2, 0.3));
    assert_eq!(label(seen(0, 0.9)), 0);
    for _ in 0..20 {
        label(seen(1, 0.9));
    }
    assert_eq!(label(seen(0, 0.9)), 1);
}

#[test]
fn motion_is_significant_only_for_what_moves() {
    let mut table = TrackTable::default();
    let mut rng = Stream::new(2, 0, "test");
    for i in 0..20 {
        let t = f64::from(i) / 30.0;
        let mut noise = || 3e-5 * rng.normal();
        let seen = [
            sighting(noise(), noise()),
            sighting(0.1 + 0.008 * t + noise(), noise()),
        ];
        table.update(&look(t, &seen));
    }
    let (still, moving) = (table.tracks[0].motion(0.6), table.tracks[1].motion(0.6));
    assert!(still.1 < 5.0, "{still:?}");
    assert!(
        moving.1 > 10.0 && (moving.0 - 0.008).abs() < 0.002,
        "{moving:?}"
    );
}

#[test]
fn sizes_keep_apart_what_crosses_on_the_sky() {
    // One at 600 m, one at 1,000 m; for three frames the detector swaps the order and both lie
    // within the noise of each other.
    let mut table = TrackTable::default();
    let seen = |az: f64, size_rad: f64| Sighting {
        size_rad,
        ..sighting(az, 0.1)
    };
    for i in 0..30 {
        let t = f64::from(i) / 30.0;
        let x = 2e-3 - 2e-3 * t;
        table.update(&look(t, &[seen(-x, 6e-4), seen(x, 3e-4)]));
    }
    let (big, small) = (table.tracks[0].id, table.tracks[1].id);
    for i in 30..33 {
        let t = f64::from(i) / 30.0;
        let x = 2e-3 - 2e-3 * t;
        let assigned = table.update(&look(t, &[seen(x, 3e-4), seen(-x, 6e-4)]));
        assert_eq!(assigned, vec![Some(small), Some(big)]);
    }
}

#[test]
fn an_occlusion_is_foreseen() {
    // A wall from x = 50 to 60 m at y = 100 m; the target flies east at 10 m/s along y = 200 m.
    use crate::ground::dsm::HeightGrid;
    let origin = DVec2::splat(-500.0);
    let flat = HeightGrid::from_fn(origin, 10.0, [100, 100], |_, _| 0.0);
    let wall = HeightGrid::from_fn(origin, 1.0, [1000, 1000], |e, n| {
        if e > 50.0 && e < 60.0 && n > 100.0 && n < 101.0 {
            100.0
        } else {
            0.0
        }
    });
    let dsm = Dsm::new(flat, wall, 0.0);
    let eye = DVec3::new(0.0, 0.0, 10.0);
    let at = |t: f64| DVec3::new(80.0 + 10.0 * t, 200.0, 40.0);
    let mut table = TrackTable::default();
    for i in 0..=120 {
        let t = f64::from(i) / 120.0;
        let az_el_rad = los_to_az_el(at(t) - eye);
        let exact = Sighting {
            az_el_rad,
            sigma_rad: 1e-6,
            size_rad: 0.35 / at(t).distance(eye),
            score: 0.9,
            label: 0,
            weak: false,
        };
        table.update(&look(t, &[exact]));
    }
    let track = &mut table.tracks[0];
    let foreseen = track.foresee_occlusion(&dsm, eye, 1.0, 4.0);
    assert!(foreseen.is_none(), "its range is not known yet");
    // Laser samples of the same second teach range and closing speed.
    for i in 0..=100 {
        let t = 1.0 + f64::from(i) * 2e-3;
        track.ranged(at(t).distance(eye), 0.05, t);
    }
    let seen = track.foresee_occlusion(&dsm, eye, 1.2, 4.0).unwrap();
    // Hidden while x / 200 lies between 50/101 and 60/100: from 99.0 to 120 m.
    let (enter, exit) = ((200.0 * 50.0 / 101.0 - 80.0) / 10.0, 4.0);
    assert!((seen.enter_s - enter).abs() < 0.02, "{seen:?} {enter}");
    assert!(
        (seen.exit_s.unwrap() - exit).abs() < 0.05,
        "{seen:?} {exit}"
    );
    assert!(seen.hides(3.0) && !seen.hides(1.5) && !seen.hides(4.2));
}

#[test]
fn a_new_track_that_continues_a_silent_one_takes_its_identity() {
    let mut table = TrackTable::default();
    let mut rng = Stream::new(4, 0, "test");
    let mut at = |t: f64| {
        // A turn while nobody looks puts it outside the gate of straight flight.
        let az = if t < 1.0 { 0.02 * t } else { 0.02 * t + 1.2e-3 };
        sighting(az + 3e-5 * rng.normal(), 3e-5 * rng.normal())
    };
    for i in 0..60 {
        table.update(&look(f64::from(i) / 60.0, &[at(f64::from(i) / 60.0)]));
    }
    let id = table.tracks[0].id;
    for i in 110..140 {
        table.update(&look(f64::from(i) / 60.0, &[at(f64::from(i) / 60.0)]));
    }
    assert_eq!(table.tracks.len(), 1);
    assert_eq!(table.tracks[0].id, id);
    // One that moves the other way does not continue it.
    for i in 170..200 {
        let t = f64::from(i) / 60.0;
        let back = sighting(0.02 * 2.8 + 1.2e-3 - 0.02 * (t - 2.8), 0.0);
        table.update(&look(t, &[back]));
    }
    assert!(
        table
            .tracks
            .iter()
            .any(|track| track.id != id && track.total_hits() > 20)
    );
}

#[test]
fn what_is_hidden_is_not_taken_for_what_flies_before_it() {
    let mut table = TrackTable::default();
    for i in 0..60 {
        table.update(&look(f64::from(i) / 60.0, &[sighting(0.1, 0.1)]));
    }
    let id = table.tracks[0].id;
    table.tracks[0].occlusion = Some(Occlusion {
        enter_s: 1.0,
        exit_s: Some(3.0),
        exit_az_el_rad: DVec2::new(0.1, 0.1),
    });
    let assigned = table.update(&look(1.5, &[sighting(0.1, 0.1)]));
    assert!(assigned[0].is_some_and(|other| other != id));
    // It outlives the time without a hit that would end any other.
    table.update(&look(2.9, &[]));
    assert!(table.get(id).is_some());
    let assigned = table.update(&look(3.1, &[sighting(0.1, 0.1)]));
    assert_eq!(assigned[0], Some(id));
}
#[test]
fn what_comes_up_while_a_track_is_hidden_does_not_take_its_identity() {
    for hidden in [true, false] {
        let mut table = TrackTable::default();
        for i in 0..60 {
            table.update(&look(f64::from(i) / 60.0, &[sighting(0.1, 0.1)]));
        }
        let id = table.tracks[0].id;
        table.tracks[0].occlusion = hidden.then_some(Occlusion {
            enter_s: 1.0,
            exit_s: Some(9.0),
            exit_az_el_rad: DVec2::new(0.1, 0.1),
        });
        // Begins in plain view, a second and a half later and a milliradian away.
        for i in 150..180 {
            let t = f64::from(i) / 60.0;
            table.update(&look(t, &[sighting(0.101, 0.1)]));
        }
        let ids: Vec<u32> = table.tracks.iter().map(|track| track.id).collect();
        assert_eq!(ids.len(), 1 + usize::from(hidden), "{ids:?}");
        assert_eq!(ids[0], id);
        assert_eq!(table.tracks[0].total_hits() > 60, !hidden);
    }
}

#[test]
fn an_echo_counts_within_the_gate_or_after_silence() {
    let mut table = TrackTable::default();
    table.update(&look(0.0, &[sighting(0.1, 0.1)]));
    let track = &mut table.tracks[0];
    track.ranged(800.0, 15.0, 0.0);
    // A bird half way is no target; the target itself is.
    assert!(!track.range_gate(0.1).contains(&400.0) && track.range_gate(0.1).contains(&810.0));
    track.ranged(805.0, 0.5, 0.1);
    for _ in 0..4 {
        track.unanswered();
    }
    // The estimate was wrong: what answers now is believed at once.
    assert!(track.range_gate(0.6).contains(&400.0));
    track.ranged(400.0, 0.5, 0.6);
    let (range_m, sigma_m) = track.range.range_m(0.6).unwrap();
    assert!(
        (range_m - 400.0).abs() < 1.0 && sigma_m < 1.0,
        "{range_m} {sigma_m}"
    );
    assert!(!track.range_gate(0.7).contains(&805.0));
}

#[test]
fn what_keeps_answering_before_the_gate_is_the_target() {
    let mut table = TrackTable::default();
    table.update(&look(0.0, &[sighting(0.1, 0.1)]));
    let track = &mut table.tracks[0];
    // The hill behind it.
    track.ranged(6112.0, 0.5, 0.0);
    for (pulse, first_m) in [1010.0, 1012.0, 1014.0, 1016.0, 1018.0]
        .into_iter()
        .enumerate()
    {
        assert!(!track.range_gate(0.1).contains(&first_m));
        let t_s = 0.1 * pulse as f64;
        track.met_first(Some(first_m), t_s);
        // The hill answers as well.
        if pulse < 4 {
            track.ranged(6112.0, 0.5, t_s);
        }
    }
    assert!(track.range_gate(0.5).contains(&1020.0));
    track.ranged(1020.0, 0.5, 0.5);
    track.met_first(Some(1020.0), 0.6);
    assert!(!track.range_gate(0.6).contains(&6112.0));
    // Things that cross, each at its own distance, and an echo of its own between.
    for first_m in [400.0, 500.0, 400.0, 1020.0, 400.0, 400.0, 400.0, 400.0] {
        track.met_first(Some(first_m), 0.6);
    }
    assert!(!track.range_gate(0.6).contains(&400.0));
    // Where the radar has it, what stands before it is another thing.
    track.ranged_by_radar(1020.0, 15.0, 0.7);
    for _ in 0..9 {
        track.met_first(Some(400.0), 0.7);
    }
    assert!(!track.range_gate(0.7).contains(&400.0));
}

#[test]
fn a_weak_detection_goes_on_with_a_track_and_starts_none() {
    let weak = |az: f64| Sighting {
        score: 0.08,
        weak: true,
        // No dot: it spans ten pixels.
        size_rad: 1e-3,
        ..sighting(az, 0.1)
    };
    let mut table = TrackTable::default();
    table.update(&look(0.0, &[weak(0.1)]));
    assert!(table.tracks.is_empty());
    let strong = Sighting {
        size_rad: 1e-3,
        ..sighting(0.1, 0.1)
    };
    table.update(&look(0.0, &[strong]));
    assert_eq!(table.update(&look(0.03, &[weak(0.1)])), [None]);
    for i in 2..10 {
        table.update(&look(f64::from(i) / 30.0, &[strong]));
    }
    let id = table.tracks[0].id;
    assert_eq!(table.update(&look(10.0 / 30.0, &[weak(0.1)])), [Some(id)]);
}

/// A table that has followed a box for three seconds, which errs by so many specified deviations and shrinks
/// to a part now and then, and the number of identities it took.
fn fluttering(deviations: f64) -> (TrackTable, usize) {
    let mut table = TrackTable::default();
    let mut rng = Stream::new(7, 0, "test");
    let mut ids = std::collections::BTreeSet::new();
    let noise = deviations * 3e-5;
    for i in 0..180 {
        let t_s = f64::from(i) / 60.0;
        let place = [(); 2].map(|()| noise * rng.normal());
        let seen = Sighting {
            size_rad: if i % 7 < 3 { 1e-3 } else { 2e-3 },
            ..sighting(0.01 * t_s + place[0], 0.1 + place[1])
        };
        ids.extend(table.update(&look(t_s, &[seen])).into_iter().flatten());
    }
    (table, ids.len())
}

#[test]
fn a_fluttering_box_does_not_break_its_track() {
    // A gull's box errs by one to two pixels where half a one is specified.
    let (table, identities) = fluttering(3.0);
    assert_eq!(identities, 1);
    let track = &table.tracks[0];
    let los = track.filter.predicted(3.0);
    assert!((los.az_rad - 0.03).abs() < 1e-4, "{}", los.az_rad);
    // Scores and shape alone: what flutters so speaks less for a UAV than what holds still.
    let says = |flutter| READS.of_hit(0.5, 0, 20.0, flutter);
    assert!(
        track.flutter[Tier::Search].ratio() > 2.0
            && says(track.flutter[Tier::Search].ratio()) < says(1.0) - 0.5
    );
}

#[test]
fn what_began_in_scenery_is_scenery_until_it_flies() {
    let mut table = TrackTable::default();
    table.scenery.learn(DVec2::new(0.1, 0.1), 0.0);
    table.update(&look(1.0, &[sighting(0.1, 0.1), sighting(0.2, 0.1)]));
    let scenery: Vec<bool> = (table.tracks.iter())
        .map(|track| track.conduct.is_scenery())
        .collect();
    assert_eq!(scenery, [true, false]);
    table.tracks[0].conduct.flown = true;
    assert!(!table.tracks[0].conduct.is_scenery());
}

#[test]
fn a_camera_that_never_saw_a_track_does_not_talk_it_down() {
    let log_odds = |finer: bool| {
        let mut table = TrackTable::default();
        let mut id = 0;
        for i in 0..120_u32 {
            let t_s = f64::from(i) / 60.0;
            let seen = Sighting {
                size_rad: 1e-3,
                score: 0.5,
                ..sighting(0.1, 0.1)
            };
            id = table.update(&look(t_s, &[seen]))[0].expect("a track");
            for half in 0..if finer && i > 60 { 2 } else { 0 } {
                let unseen = CameraLook {
                    tier: Tier::Precise,
                    ifov_rad: 3e-5,
                    start_tracks: false,
                    ..look(t_s + f64::from(half) / 120.0, &[])
                };
                table.update(&unseen);
            }
        }
        table.get(id).expect("the track").log_odds()
    };
    let (alone, doubted) = (log_odds(false), log_odds(true));
    assert!(
        alone > 2.0 && (0.0..alone).contains(&doubted),
        "{alone} {doubted}"
    );
}

#[test]
fn a_box_that_a_track_would_refuse_takes_none_from_it() {
    let mut table = TrackTable::default();
    let sigma_rad = 6e-5;
    let seen = |az| Sighting {
        sigma_rad,
        ..sighting(az, 0.1)
    };
    for i in 0..30 {
        table.update(&look(f64::from(i) / 60.0, &[seen(0.1), seen(0.1002)]));
    }
    assert_eq!(table.tracks.len(), 2);
    let right = table.tracks[1].id;
    // The right one is seen where it is, the left one not at all; a false box lies 6.5σ to the right.
    let spread_rad = table.tracks[1].filter.predicted(0.5).sigma_rad().x;
    let false_az = 0.1002 + 6.5 * spread_rad.hypot(sigma_rad) / 0.1_f64.cos();
    let assigned = table.update(&look(0.5, &[seen(0.1002), seen(false_az)]));
    assert_eq!(assigned[0], Some(right));
}
