//! The air on the beam's path.

use crate::common::{scenario, station};
use boresight::components::flight::UavStatus;

/// The operator has the beam turned from one UAV to the other while both fly.
#[test]
fn the_air_on_the_beams_path_is_renewed_ten_times_a_second() {
    let set = [
        "detector.kind=truth",
        "engage.authorised=false",
        // Beside the first, 14 mrad away: never both in the cone about the beam's axis.
        "uavs.1.trajectory={ kind = 'straight', start_enu_m = [-707, 570, 117.8], \
         velocity_enu_mps = [5.657, 5.657, 0] }",
        "operator=[{ t_s = 3.03, designate = 'far' }]",
    ];
    let mut run = scenario("crossing_pair", &set).open().unwrap();
    // Tick and UAV of every tick in which the air on the path was worked out.
    let mut renewed: Vec<(u64, usize)> = Vec::new();
    let mut before = None;
    for _ in 0..8 * 960 {
        run.step(1).unwrap();
        let (tick, station) = (run.view().tick(), station(&run));
        let Some(aimed) = station.beam().aimed else {
            continue;
        };
        let path = station.beam_path().unwrap();
        assert_eq!(path.index, aimed, "the air is that to another UAV");
        if before != Some(path.air.turbulence) {
            renewed.push((tick, aimed));
        }
        before = Some(path.air.turbulence);
    }
    let targets: Vec<usize> = renewed.iter().map(|(_, aimed)| *aimed).collect();
    let turned = targets.windows(2).filter(|pair| pair[0] != pair[1]).count();
    assert!(
        targets[0] == 0 && targets.ends_with(&[1]) && turned == 1,
        "{targets:?}"
    );
    assert!(renewed.len() > 40, "{renewed:?}");
    // On the tenths of a second, and at once where the beam turns to a UAV: here in between.
    for (i, (tick, aimed)) in renewed.iter().enumerate() {
        let new = i == 0 || renewed[i - 1].1 != *aimed;
        assert_eq!(new, !tick.is_multiple_of(96), "{tick} in {renewed:?}");
    }
    // None is left out while the beam stays.
    for pair in renewed.windows(2).filter(|pair| pair[0].1 == pair[1].1) {
        assert!(pair[1].0 - pair[0].0 <= 96, "{pair:?}");
    }
}

/// A UAV that comes head-on has its camera before the hull.
#[test]
fn behind_a_camera_that_is_gone_the_hull_burns() {
    let set = [
        "detector.kind=truth",
        "uavs.0.model=mavic2",
        "uavs.0.trajectory={ kind = 'straight', start_enu_m = [-466, 381, 80], \
         velocity_enu_mps = [3.9, -3.2, 0] }",
        "duration_s=12",
    ];
    let mut run = scenario("urban_intercept", &set).open().unwrap();
    while !run.step(96).unwrap() {}
    let uav = run.view().uavs().next().unwrap();
    assert_eq!(uav.lost(), ["camera", "body"]);
    assert_ne!(uav.status(), UavStatus::Flying);
}

/// Between roofs and hills the sky shows through gaps that a line of sight crosses within milliseconds.
#[test]
fn the_laser_waits_for_sky_that_stays() {
    let builder = scenario("rooftops", &["detector.kind=truth"]);
    let mut run = builder.open().unwrap();
    let (mut bursts, mut burst, mut gaps, mut cleared) = (Vec::new(), 0, 0, false);
    for _ in 0..12 * 960 {
        run.step(1).unwrap();
        let station = station(&run);
        // Sky behind the target now, and something solid a moment later.
        let passing = station.interlocks() == ["solid backstop ahead"];
        gaps += usize::from(passing && !cleared);
        cleared = passing;
        let firing = station.beam().firing;
        burst += usize::from(firing);
        if burst > 0 && !firing {
            bursts.push(burst);
            burst = 0;
        }
    }
    assert!(gaps > 0, "no gap: the case is gone");
    assert!(
        !bursts.is_empty() && bursts.iter().all(|ticks| *ticks > 96),
        "{bursts:?}"
    );
}
