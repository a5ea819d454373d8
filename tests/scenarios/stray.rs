//! Lasers and lamps in the conditions of the cameras' exposures.

use crate::common::{scenario, station};
use boresight::components::capture::Tier;

/// Frames of the haze's crossing in which the laser fired, or did not: how many showed stray light, of how many.
struct Shown {
    firing: [usize; 2],
    quiet: [usize; 2],
    energy_j: f64,
    fired_s: f64,
}

/// The crossing of `haze_bare` with these values set, by the truth detector, until the laser has fired for a second.
fn crossing(set: &[&str], tier: Tier) -> Shown {
    let mut all = vec!["detector.kind=truth"];
    all.extend_from_slice(set);
    let mut run = scenario("haze_bare", &all).open().unwrap();
    let mut shown = Shown {
        firing: [0; 2],
        quiet: [0; 2],
        energy_j: 0.0,
        fired_s: 0.0,
    };
    for _ in 0..15 * 960 {
        run.step(1).unwrap();
        let firing = station(&run).beam().firing;
        let counts = if firing {
            &mut shown.firing
        } else {
            &mut shown.quiet
        };
        for frame in run.frames().filter(|frame| frame.tier() == tier) {
            counts[1] += 1;
            counts[0] += usize::from(frame.conditions().stray.is_some());
        }
        if firing {
            shown.fired_s += 1.0 / 960.0;
        }
        shown.energy_j = station(&run).beam().energy_j;
        if shown.fired_s >= 1.0 {
            break;
        }
    }
    assert!(shown.fired_s >= 1.0, "it fired for {} s", shown.fired_s);
    shown
}

#[test]
fn a_laser_is_in_the_frames_of_cameras_without_a_filter_while_it_fires() {
    let bare = crossing(&[], Tier::Precise);
    assert!(bare.firing[1] > 60, "{:?}", bare.firing);
    assert_eq!(bare.firing[0], bare.firing[1]);
    assert_eq!(bare.quiet[0], 0);
    assert!((bare.energy_j / bare.fired_s / 800.0 - 1.0).abs() < 1e-6);
}

#[test]
fn filter_pause_and_blanking_each_keep_it_out() {
    let filter = "station.cameras.precise.blocking_od=8";
    let filtered = crossing(&[filter], Tier::Precise);
    assert!(filtered.firing[1] > 60 && filtered.firing[0] == 0);
    // A laser that pauses loses the precise camera's share of its power.
    let paused = crossing(&["station.cameras.precise.laser_gate=pause"], Tier::Precise);
    assert!(paused.firing[1] > 60 && paused.firing[0] == 0);
    let mean_w = paused.energy_j / paused.fired_s;
    assert!((400.0..799.0).contains(&mean_w), "{mean_w}");
    // A blanked search camera takes no frames meanwhile.
    let blanked = crossing(&["station.cameras.search.laser_gate=blank"], Tier::Search);
    assert!(blanked.firing[1] == 0 && blanked.quiet[1] > 0);
}

#[test]
fn a_dazzler_is_in_the_frames_while_it_is_on() {
    let light = "lights=[{ name = 'dazzler', on = 'intruder', power_w = 1.0, beam_deg = 2.0, from_s = 2.0, \
                 to_s = 3.0 }]";
    let set = ["detector.kind=truth", "engage.authorised=false", light];
    let mut run = scenario("haze_bare", &set).open().unwrap();
    let mut counts = [[0; 2]; 2];
    for tick in 1..=4 * 960 {
        run.step(1).unwrap();
        let t_s = f64::from(tick) / 960.0;
        let on = usize::from((2.01..2.99).contains(&t_s));
        if on == 0 && (1.99..3.01).contains(&t_s) {
            continue;
        }
        for frame in run.frames().filter(|frame| !frame.truth().is_empty()) {
            counts[on][usize::from(frame.conditions().stray.is_some())] += 1;
        }
    }
    assert!(counts[0][1] == 0 && counts[0][0] > 30, "{counts:?}");
    assert!(counts[1][0] == 0 && counts[1][1] > 30, "{counts:?}");
    let wrong = "lights=[{ name = 'dazzler', on = 'nobody', power_w = 1.0 }]";
    let error = scenario("haze_bare", &[wrong]).open().err().unwrap();
    assert!(error.to_string().contains("nobody"), "{error}");
}
