use super::*;

const KNOT_MPS: f64 = 1852.0 / 3600.0; // [m/s]

fn open_field(speed_10m_mps: f64) -> MeanWind {
    MeanWind::new(speed_10m_mps, 270.0, 0.03, 0.0).unwrap()
}

#[test]
fn mean_wind_follows_the_log_law() {
    let wind = MeanWind::new(5.0, 270.0, 0.1, 0.0).unwrap();
    // A westerly blows to the east.
    let at_10m = wind.mean_wind_enu_mps(10.0);
    assert!((at_10m - DVec3::new(5.0, 0.0, 0.0)).length() < 1e-12);
    // ln(100/0.1)/ln(10/0.1) = 1.5.
    assert!((wind.mean_wind_enu_mps(100.0).x - 7.5).abs() < 1e-12);
    assert_eq!(wind.mean_wind_enu_mps(0.0), wind.mean_wind_enu_mps(1.0));
    assert!(wind.mean_wind_enu_mps(1.0).x < wind.mean_wind_enu_mps(1.1).x);
    // The displacement height lifts the profile.
    let city = MeanWind::new(5.0, 0.0, 1.0, 14.0).unwrap();
    assert!((city.mean_wind_enu_mps(24.0).y + 5.0).abs() < 1e-12);
}

#[test]
fn a_reported_wind_is_slowed_and_roughened_by_a_city() {
    // EN 1991-1-4, terrain category IV: kr = 0.19 (1/0.05)^0.07 = 0.234, cr(10 m) = kr ln 10 =
    // 0.540, Iv = 1 / ln 10; category II: cr = 0.19 ln 200 = 1.007.
    let (mean_mps, gust_mps) = over_rough_ground(10.0, Some(16.0), 1.0);
    assert!((mean_mps / 10.0 - 0.540 / 1.007).abs() < 1e-3, "{mean_mps}");
    assert!((gust_mps.unwrap() - mean_mps - 6.0 * 0.2343 / 0.19).abs() < 0.01);
    let (open_mps, no_gust) = over_rough_ground(7.0, None, OPEN_GROUND_M);
    assert!((open_mps - 7.0).abs() < 1e-12 && no_gust.is_none());
    let city = MeanWind::new(mean_mps, 270.0, 1.0, 14.0).unwrap();
    let gusts = DrydenGust::new(&city, &mut Stream::new(1, 0, "gust"));
    let sigma_u_mps = dryden_scales(10.0, gusts.w20_mps).sigma_u_mps;
    // MIL-F-8785C has 0.907 of EN's turbulence over open ground, and so over the city.
    let intensity = sigma_u_mps / mean_mps;
    assert!(
        (intensity * 10f64.ln() - 0.907).abs() < 0.002,
        "{intensity}"
    );
}

#[test]
fn gusts_go_on_in_another_wind() {
    let mean = open_field(5.0);
    let mut rng = Stream::new(1, 0, "gust");
    let gusts = DrydenGust::new(&mean, &mut rng);
    // Hardly any time, so that the states stay as they are.
    let now = |gusts: &DrydenGust| gusts.clone().step(1e-9, 50.0, 5.0, &mut rng.clone());
    // From the south instead of the west: what blew along east blows along north.
    let turned = mean.changed(10.0, 180.0).unwrap();
    let before = now(&gusts);
    let after = now(&gusts.carried_by(&turned));
    let expected = 2.0 * DVec3::new(-before.y, before.x, before.z);
    assert!(
        (after - expected).length() < 1e-3 * expected.length(),
        "{after} {expected}"
    );
}

#[test]
fn bad_winds_are_refused() {
    assert!(matches!(
        MeanWind::new(-1.0, 0.0, 0.1, 0.0),
        Err(WindError::Speed(_))
    ));
    assert!(matches!(
        MeanWind::new(1.0, f64::NAN, 0.1, 0.0),
        Err(WindError::Direction(_))
    ));
    assert!(matches!(
        MeanWind::new(1.0, 0.0, 0.0, 0.0),
        Err(WindError::Roughness(_))
    ));
    assert!(matches!(
        MeanWind::new(1.0, 0.0, 0.1, -1.0),
        Err(WindError::Displacement(_))
    ));
}

#[test]
fn dryden_scales_match_the_published_values() {
    let scales = dryden_scales(10.0, 15.0 * KNOT_MPS);
    assert!((scales.l_u_m - 67.37).abs() < 0.01);
    assert!((scales.l_w_m - 10.0).abs() < 1e-9);
    assert!((scales.sigma_w_mps - 0.7717).abs() < 1e-4);
    assert!((scales.sigma_u_mps - 1.4574).abs() < 1e-4);
}

#[test]
fn still_air_has_no_gusts() {
    let mut rng = Stream::new(1, 0, "gust");
    let mut gust = DrydenGust::new(&open_field(0.0), &mut rng);
    assert_eq!(gust.step(0.1, 10.0, 12.0, &mut rng), DVec3::ZERO);
}

#[test]
fn a_reported_gust_is_what_ten_minutes_bring() {
    // An anemometer 10 m up, 3 s means, the highest of ten minutes, over 400 such spells.
    const DT_S: f64 = 0.25; // [s]
    for (wind_mps, gust_mps) in [(5.0, 11.0), (8.0, 16.0), (15.0, 26.0)] {
        let mean = open_field(wind_mps);
        let mut rng = Stream::new(5, 0, "gust");
        let mut gusts = DrydenGust::new(&mean, &mut rng).reaching(Some(gust_mps));
        let mut highest_mps = 0.0;
        let mut squares = 0.0;
        for _ in 0..400 {
            let along: Vec<f64> = (0..2400)
                .map(|_| gusts.step(DT_S, 10.0, 0.0, &mut rng).x)
                .collect();
            squares += along.iter().map(|u| u * u).sum::<f64>() / 2400.0;
            let three_seconds = along.windows(12).map(|w| w.iter().sum::<f64>() / 12.0);
            highest_mps += three_seconds.fold(0.0, f64::max);
        }
        let got = wind_mps + highest_mps / 400.0;
        assert!((got / gust_mps - 1.0).abs() < 0.03, "{got} of {gust_mps}");
        let sigma_mps = dryden_scales(10.0, gusts.w20_mps).sigma_u_mps;
        let rms_mps = (squares / 400.0).sqrt();
        assert!(
            (rms_mps / sigma_mps - 1.0).abs() < 0.02,
            "{rms_mps} {sigma_mps}"
        );
    }
}

#[test]
fn a_gust_below_the_mean_winds_own_changes_nothing() {
    let mut rng = Stream::new(6, 0, "gust");
    let plain = DrydenGust::new(&open_field(8.0), &mut rng);
    for gust_mps in [None, Some(8.0), Some(9.0)] {
        assert_eq!(plain.clone().reaching(gust_mps).w20_mps, plain.w20_mps);
    }
    // In a calm, gusts come past at the least pace and do not freeze.
    let calm = MeanWind::new(0.0, 270.0, 0.03, 0.0).unwrap();
    let mut gusts = DrydenGust::new(&calm, &mut rng).reaching(Some(5.0));
    let mut step = || gusts.step(10.0, 10.0, 0.0, &mut rng);
    assert_ne!(step(), step());
}

#[test]
fn noise_keeps_its_digits_at_a_short_tick() {
    // Leading terms of the covariance series: x, x^2/4, x^3/12 with x = 2 tau.
    let tau = 1e-6_f64;
    let x = 2.0 * tau;
    let step = TransverseStep::new(tau);
    assert!((step.l11.powi(2) / x - 1.0).abs() < 1e-5);
    assert!((step.l11 * step.l21 / (x * x / 4.0) - 1.0).abs() < 1e-5);
    let q22 = step.l21.powi(2) + step.l22.powi(2);
    assert!((q22 / (x.powi(3) / 12.0) - 1.0).abs() < 1e-5);
    // And the two branches of the gamma function meet.
    for n in [2, 3] {
        let (below, above) = (erlang_cdf(n, 1.0), erlang_cdf(n, 1.0 + 1e-12));
        assert!((below - above).abs() < 1e-11);
    }
}

/// Sigma of each component and correlations a distance `lag` ticks on, against
/// `exp(-r/L)` and `exp(-r/L) (1 - r/2L)`, the Dryden autocorrelations.
/// `together` takes the noise that neighbours share.
fn check_statistics(dt_s: f64, ticks: usize, lag: usize, airspeed_mps: f64, together: bool) {
    let mean = open_field(8.0);
    let mut rng = Stream::new(3, 0, "gust");
    let mut gust = DrydenGust::new(&mean, &mut rng);
    let h_m = 30.0;
    let trace: Vec<DVec3> = (0..ticks)
        .map(|tick| {
            if together {
                let noise = SharedNoise::draw(1, &mut rng);
                let r_enu_m = DVec3::new(tick as f64 * dt_s * airspeed_mps, 50.0, h_m);
                gust.step_together(dt_s, r_enu_m, h_m, airspeed_mps, &noise)
            } else {
                gust.step(dt_s, h_m, airspeed_mps, &mut rng)
            }
        })
        .collect();
    let n = ticks as f64;
    let variance = trace.iter().map(|g| *g * *g).sum::<DVec3>() / n;
    let pairs = trace.iter().zip(&trace[lag..]);
    let covariance = pairs.map(|(a, b)| *a * *b).sum::<DVec3>() / (n - lag as f64);
    let correlation = covariance / variance;

    let scales = dryden_scales(h_m, gust.w20_mps);
    let speed_mps = airspeed_mps.max(mean.mean_wind_enu_mps(h_m).length());
    let r_u = speed_mps * dt_s * lag as f64 / scales.l_u_m;
    let r_w = speed_mps * dt_s * lag as f64 / scales.l_w_m;
    // The westerly's longitudinal axis is east, the lateral north.
    for (got, want) in [
        (variance.x.sqrt(), scales.sigma_u_mps),
        (variance.y.sqrt(), scales.sigma_u_mps),
        (variance.z.sqrt(), scales.sigma_w_mps),
    ] {
        assert!((got / want - 1.0).abs() < 0.03, "sigma {got} {want}");
    }
    for (got, want) in [
        (correlation.x, (-r_u).exp()),
        (correlation.y, (-r_u).exp() * (1.0 - r_u / 2.0)),
        (correlation.z, (-r_w).exp() * (1.0 - r_w / 2.0)),
    ] {
        assert!((got - want).abs() < 0.03, "correlation {got} {want}");
    }
}

#[test]
fn gusts_have_dryden_statistics_at_a_long_tick() {
    check_statistics(1.0, 100_000, 5, 15.0, false);
    check_statistics(1.0, 100_000, 5, 15.0, true);
}

#[test]
fn gusts_of_a_hovering_uav_do_not_freeze() {
    check_statistics(1.0, 200_000, 5, 0.0, false);
}

#[test]
fn statistics_do_not_depend_on_the_tick() {
    check_statistics(1.0 / 960.0 * 96.0, 600_000, 20, 20.0, false);
    check_statistics(1.0 / 960.0 * 96.0, 600_000, 20, 20.0, true);
}

#[test]
fn coefficients_follow_height_and_speed() {
    let mut rng = Stream::new(4, 0, "gust");
    let mut gust = DrydenGust::new(&open_field(5.0), &mut rng);
    for k in 0..2000 {
        let (h_m, v_mps) = (10.0 + 0.05 * k as f64, 5.0 + 0.01 * k as f64);
        gust.step(1.0 / 960.0, h_m, v_mps, &mut rng);
        let c = gust.coefficients.unwrap();
        let speed_mps = v_mps.max(gust.mean.speed_mps(h_m));
        assert!((c.height_agl_m / h_m - 1.0).abs() < 0.0102);
        assert!((c.speed_mps / speed_mps - 1.0).abs() < 0.0102);
    }
}

/// Correlation of the gusts of UAVs that fly side by side, with the first one's: horizontal and upright, over `runs` runs
/// of `ticks` ticks.
fn beside(apart_m: &[f64], runs: u64, ticks: usize) -> Vec<[f64; 2]> {
    const H_M: f64 = 60.0; // [m]
    const DT_S: f64 = 0.02; // [s]
    let mean = open_field(8.0);
    let mut sums = vec![[0.0; 2]; apart_m.len()];
    let mut own = [0.0; 2];
    for run in 0..runs {
        let mut rng = Stream::new(8, run, "shared gusts");
        let start = SharedNoise::draw(256, &mut rng);
        let at = |d_m: &f64, t_s: f64| DVec3::new(12.0 * t_s, -300.0 + d_m, H_M);
        let mut gusts: Vec<DrydenGust> = (apart_m.iter())
            .map(|d_m| DrydenGust::new(&mean, &mut rng).started_together(at(d_m, 0.0), H_M, &start))
            .collect();
        for tick in 0..ticks {
            let noise = SharedNoise::draw(1, &mut rng);
            let t_s = tick as f64 * DT_S;
            let winds: Vec<DVec3> = (gusts.iter_mut().zip(apart_m))
                .map(|(gust, d_m)| gust.step_together(DT_S, at(d_m, t_s), H_M, 12.0, &noise))
                .collect();
            for (sum, wind) in sums.iter_mut().zip(&winds) {
                let product = *wind * winds[0];
                sum[0] += product.x + product.y;
                sum[1] += product.z;
            }
            let square = winds[0] * winds[0];
            own[0] += square.x + square.y;
            own[1] += square.z;
        }
    }
    let share = |sum: [f64; 2]| [sum[0] / own[0], sum[1] / own[1]];
    sums.into_iter().map(share).collect()
}

#[test]
fn neighbours_fly_through_the_same_gusts() {
    let apart_m = [0.0, 5.0, 20.0, 60.0, 2_000.0];
    let scales = dryden_scales(60.0, 1.0);
    // The second takes the state at the start alone.
    for (runs, ticks) in [(60, 2_000), (4_000, 1)] {
        let shared = beside(&apart_m, runs, ticks);
        for (d_m, got) in apart_m.iter().zip(shared) {
            println!("{d_m} m: {got:.3?}");
            for (got, l_m) in got.into_iter().zip([scales.l_u_m, scales.l_w_m]) {
                let wanted = (-d_m / l_m).exp();
                assert!((got - wanted).abs() < 0.1, "{d_m} m: {got}, {wanted}");
            }
        }
    }
}
