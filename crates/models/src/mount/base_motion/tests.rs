use super::*;

const DT: f64 = 1.0 / 960.0;

fn only(mode: TiltMode) -> BaseMotionParams {
    let quiet = TiltMode {
        rms_rad: [0.0; 3],
        ..mode
    };
    BaseMotionParams {
        sway: quiet,
        mast: mode,
        broadband: quiet,
    }
}

#[test]
fn psd_integrates_to_one_and_peaks_at_resonance() {
    let mode = BaseMotionParams::default().mast;
    let step = 1e-3;
    let sum: f64 = (0..4_000_000)
        .map(|k| mode.psd_unit_per_hz((f64::from(k) + 0.5) * step) * step)
        .sum();
    // The tail above 4 kHz is below 1e-8.
    assert!((sum - 1.0).abs() < 1e-6, "{sum}");
    // Peak at f0 √(1 − 2ζ²), height 2·4ζω³/(4ζ²ω⁴(1−ζ²)) = 2/(ζω(1−ζ²)).
    let z2 = mode.damping.powi(2);
    let peak = mode.psd_unit_per_hz(12.0 * (1.0 - 2.0 * z2).sqrt());
    assert!((peak * mode.damping * TAU * 12.0 * (1.0 - z2) / 2.0 - 1.0).abs() < 1e-12);
}

#[test]
fn ensemble_is_stationary_from_the_first_step() {
    let params = BaseMotionParams::default();
    let rms: [f64; 3] = std::array::from_fn(|i| {
        (params.sway.rms_rad[i].powi(2)
            + params.mast.rms_rad[i].powi(2)
            + params.broadband.rms_rad[i].powi(2))
        .sqrt()
    });
    let n = 4000;
    for steps in [1, 2, 700] {
        let mut sum = DVec3::ZERO;
        let mut rate_sum = 0.0;
        for run in 0..n {
            let mut rng = Stream::new(1, run, "base");
            let mut base = BaseMotion::new(&params, DT).unwrap();
            let mut tilt = DVec3::ZERO;
            for _ in 0..steps {
                tilt = base.step(&mut rng);
            }
            sum += tilt * tilt;
            rate_sum += base.rate_radps().x.powi(2);
        }
        // Five standard errors of a variance estimate.
        let bound = 5.0 * (2.0 / n as f64).sqrt();
        for (s, r) in sum.to_array().iter().zip(rms) {
            assert!((s / n as f64 / (r * r) - 1.0).abs() < bound, "{steps}");
        }
        let rate = |m: &TiltMode| (TAU * m.frequency_hz * m.rms_rad[0]).powi(2);
        let rate2 = rate(&params.sway) + rate(&params.mast) + rate(&params.broadband);
        assert!((rate_sum / n as f64 / rate2 - 1.0).abs() < bound, "{steps}");
    }
}

#[test]
fn spectrum_follows_the_closed_form() {
    let mode = BaseMotionParams::default().mast;
    let mut base = BaseMotion::new(&only(mode), DT).unwrap();
    let mut rng = Stream::new(3, 0, "base");
    // Averaged periodogram over 1 s blocks with a Hann window at three frequencies.
    let block = 960;
    let blocks = 1500;
    let probes = [6.0, 12.0, 24.0]; // [Hz]
    let mut power = [0.0; 3];
    for _ in 0..blocks {
        let mut re = [0.0; 3];
        let mut im = [0.0; 3];
        for k in 0..block {
            let x = base.step(&mut rng).x / mode.rms_rad[0];
            let t = f64::from(k) * DT;
            let hann = 1.0 - (TAU * f64::from(k) / f64::from(block)).cos();
            for (i, f) in probes.iter().enumerate() {
                re[i] += hann * x * (TAU * f * t).cos();
                im[i] += hann * x * (TAU * f * t).sin();
            }
        }
        for i in 0..3 {
            // One-sided: 2 |X|² dt / Σ w², and Σ w² = 3/2 per sample.
            power[i] += 2.0 * (re[i].powi(2) + im[i].powi(2)) * DT / (1.5 * f64::from(block));
        }
    }
    for (i, f) in probes.iter().enumerate() {
        // The window's smoothing kernel in frequency has lines (1/6, 2/3, 1/6) at 1 Hz
        // spacing only for line spectra; average the closed form over the main lobe instead.
        let kernel = |u: f64| {
            let sinc = |x: f64| {
                if x.abs() < 1e-9 {
                    1.0
                } else {
                    (x * TAU / 2.0).sin() / (x * TAU / 2.0)
                }
            };
            (sinc(u) + 0.5 * (sinc(u - 1.0) + sinc(u + 1.0))).powi(2) / 1.5
        };
        let du = 0.01;
        let expected: f64 = (-800..=800)
            .map(|k| f64::from(k) * du)
            .map(|u| kernel(u) * mode.psd_unit_per_hz((f + u).abs()) * du)
            .sum();
        let ratio = power[i] / f64::from(blocks) / expected;
        // Each estimate averages 1500 exponential variables: 5/√1500 = 0.13.
        assert!((ratio - 1.0).abs() < 0.13, "{f} {ratio}");
    }
    assert!(power[1] > 10.0 * power[0] && power[1] > 10.0 * power[2]);
}

#[test]
fn step_size_does_not_change_the_process() {
    // Two steps of dt have the transition and the noise of one step of 2 dt.
    let mode = BaseMotionParams::default().mast;
    let fine = ModeState::new(&mode, DT).unwrap();
    let coarse = ModeState::new(&mode, 2.0 * DT).unwrap();
    let f = fine.transition;
    let [l11, l21, l22] = fine.noise;
    let q = [[l11 * l11, l11 * l21], [l11 * l21, l21 * l21 + l22 * l22]];
    let mut sum = q;
    for i in 0..2 {
        for j in 0..2 {
            for a in 0..2 {
                for b in 0..2 {
                    sum[i][j] += f[i][a] * q[a][b] * f[j][b];
                }
            }
        }
    }
    let [m11, m21, m22] = coarse.noise;
    assert!((sum[0][0] / (m11 * m11) - 1.0).abs() < 1e-9);
    assert!((sum[0][1] / (m11 * m21) - 1.0).abs() < 1e-9);
    assert!((sum[1][1] / (m21 * m21 + m22 * m22) - 1.0).abs() < 1e-9);
}

#[test]
fn spectrum_integrates_power_laws() {
    // Flat, then f⁻², then 1/f, by hand.
    let spectrum = Spectrum::new(&[[1.0, 2.0], [10.0, 2.0], [100.0, 0.02], [200.0, 0.01]]);
    let spectrum = spectrum.unwrap();
    assert!((spectrum.power_rad2(1.0, 10.0) - 18.0).abs() < 1e-12);
    // ∫ 200 f⁻² = 200 (1/10 − 1/100).
    assert!((spectrum.power_rad2(10.0, 100.0) - 18.0).abs() < 1e-12);
    // ∫ 2/f = 2 ln 2.
    assert!((spectrum.power_rad2(100.0, 1e9) - 2.0 * 2.0f64.ln()).abs() < 1e-12);
    assert!((spectrum.power_rad2(5.0, 20.0) - (10.0 + 10.0)).abs() < 1e-12);
    assert_eq!(Spectrum::new(&[[1.0, 1.0]]), Err(SpectrumError::TooShort));
    let falls = Spectrum::new(&[[2.0, 1.0], [1.0, 1.0]]);
    assert_eq!(falls, Err(SpectrumError::Frequency(1.0)));
    let empty = Spectrum::new(&[[1.0, 1.0], [2.0, 0.0]]);
    assert_eq!(empty, Err(SpectrumError::Density(0.0)));
}

#[test]
fn synthesis_has_the_given_spectrum() {
    // A mast at 10 Hz above a falling background [rad²/Hz].
    let points = [
        [0.2, 1e-9],
        [8.0, 2e-11],
        [10.0, 1e-9],
        [13.0, 2e-11],
        [200.0, 1e-14],
    ];
    let spectrum = Spectrum::new(&points).unwrap();
    let mut rng = Stream::new(11, 0, "base motion");
    let mut base = BaseMotion::from_spectrum(&spectrum, DT, &mut rng);
    // Mean square over 400 s: cross terms of neighbouring lines fade with their spacing times
    // the time, below 2 % here; and none of it depends on the axis.
    let n = 960 * 400;
    let mut sum = DVec3::ZERO;
    let mut kept = Vec::new();
    for k in 0..n {
        let tilt = base.step(&mut rng);
        sum += tilt * tilt;
        // 120 Hz is enough for the bands below.
        if k % 8 == 0 {
            kept.push(tilt.x);
        }
    }
    // The rate is the derivative: by the trapezium over a short step.
    let dt = DT / 64.0;
    let mut fine = BaseMotion::from_spectrum(&spectrum, dt, &mut rng);
    for _ in 0..1000 {
        let (before, rate) = (fine.tilt_rad(), fine.rate_radps());
        let slope = (fine.step(&mut rng) - before) / dt;
        let mean = 0.5 * (rate + fine.rate_radps());
        assert!((slope - mean).length() < 1e-7);
    }
    let total = spectrum.power_rad2(0.2, 200.0);
    for axis in (sum / f64::from(n)).to_array() {
        assert!((axis / total - 1.0).abs() < 0.02, "{}", axis / total);
    }
    // Power between band edges, by projection on every multiple of 1/400 Hz in between.
    let edge = |k: i32| 0.2 * 1000.0f64.powf(f64::from(k) / 96.0);
    for (low, high) in [(30, 40), (50, 56), (56, 60)] {
        let (from, to) = ((edge(low) * 400.0) as i32, (edge(high) * 400.0) as i32);
        let mut power = 0.0;
        for j in from..to {
            let turn = 8.0 * TAU * f64::from(j) / f64::from(n);
            let (mut re, mut im) = (0.0, 0.0);
            let (mut c, mut s) = (1.0, 0.0);
            let (dc, ds) = (turn.cos(), turn.sin());
            for x in &kept {
                (re, im) = (re + x * c, im + x * s);
                (c, s) = (c * dc - s * ds, s * dc + c * ds);
            }
            power += 2.0 * (re * re + im * im) / (kept.len() as f64).powi(2);
        }
        let expected = spectrum.power_rad2(edge(low), edge(high));
        // What leaks over the edges of a band with no window.
        assert!(
            (power / expected - 1.0).abs() < 0.03,
            "{low} {}",
            power / expected
        );
    }
    // The same seed gives the same motion.
    let again = |seed| {
        let mut rng = Stream::new(seed, 0, "base motion");
        BaseMotion::from_spectrum(&spectrum, DT, &mut rng)
    };
    assert_eq!(again(3), again(3));
    assert_ne!(again(3), again(4));
}

#[test]
fn bad_parameters_are_refused() {
    let mut params = BaseMotionParams::default();
    params.mast.rms_rad[1] = -1.0;
    assert!(BaseMotion::new(&params, DT).is_err());
    params = BaseMotionParams::default();
    params.sway.frequency_hz = 0.0;
    assert!(BaseMotion::new(&params, DT).is_err());
}
