use super::*;
use crate::models::optics::exposure::{ExposureControl, white_balance};

const W: usize = 640;
const H: usize = 480;

fn params() -> SensorParams {
    SensorParams {
        f_number: 4.0,
        pixel_pitch_m: 4.8e-6,
        transmission: 0.9,
        quantum_efficiency: 0.6,
        full_well_e: 10_000.0,
        read_noise_e: 6.0,
        white_balance: [1.0; 3],
        blur_sigma_px: 0.0,
        transfer: Transfer::Linear,
    }
}

/// A rendered frame of the luminance `kcd_m2` at each pixel.
fn render(width: usize, height: usize, kcd_m2: impl Fn(usize, usize) -> f32) -> Vec<u8> {
    (0..height)
        .flat_map(|y| (0..width).map(move |x| (x, y)))
        .flat_map(|(x, y)| [f16::from_f32(kcd_m2(x, y)); 4])
        .flat_map(f16::to_le_bytes)
        .collect()
}

fn frame(rgba16f: &[u8], width: usize, height: usize) -> RenderedFrame<'_> {
    RenderedFrame {
        rgba16f,
        width,
        height,
        origin_px: [0, 0],
        conditions: &MILLISECOND,
    }
}

/// A millisecond without gain.
const MILLISECOND: Conditions = Conditions {
    exposure: Exposure {
        time_s: 1e-3,
        gain: 1.0,
    },
};

fn expose(params: &SensorParams, rgba16f: &[u8], width: usize, height: usize) -> Vec<u8> {
    let mut out = vec![0; 3 * width * height];
    Sensor::new(params)
        .unwrap()
        .expose(
            &frame(rgba16f, width, height),
            0..height,
            42,
            &mut Scratch::default(),
            &mut out,
        )
        .unwrap();
    out
}

fn moments(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let n = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / n;
    (
        mean,
        values.map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0),
    )
}

/// The mean electrons of every row, without noise.
fn mean_rows(params: &SensorParams, rgba16f: &[u8], width: usize, height: usize) -> Vec<Vec<f32>> {
    let sensor = Sensor::new(params).unwrap();
    let mut scratch = Scratch::default();
    (0..height)
        .map(|y| {
            sensor.mean_row(&frame(rgba16f, width, height), y, y == 0, &mut scratch);
            scratch.mean_e.clone()
        })
        .collect()
}

#[test]
fn one_lux_of_555_nm() {
    // 1/683 W over 3.5792e-19 J.
    assert!((PHOTONS_PER_LUX_S_M2 / 4.0907e15 - 1.0).abs() < 1e-4);
}

#[test]
fn noise_table_is_a_unit_normal() {
    let (mean, variance) = moments(NOISE.iter().map(|q| f64::from(*q)));
    assert!(mean.abs() < 1e-7);
    assert!((2.0 * variance - 1.0).abs() < 2e-3);
    // The published quantile of 0.975, between two entries: 1.959964 before the scaling,
    // which only makes up for the table's cut tails.
    let at = 0.975 * QUANTILES as f64 - 0.5;
    let between = f64::from(NOISE[at as usize])
        + at.fract() * f64::from(NOISE[at as usize + 1] - NOISE[at as usize]);
    assert!(
        (between * 2_f64.sqrt() - 1.959_964).abs() < 4e-3,
        "{between}"
    );
    // The sum of two picks: shares beyond 1, 2 and 3 sigma, and the kurtosis.
    let bits = |i: u64| hash(hash(7).wrapping_add(i.wrapping_mul(GOLDEN))) as usize;
    let draws: Vec<f64> = (0..1_000_000)
        .map(|i| bits(i) >> 4)
        .map(|b| f64::from(NOISE[b % QUANTILES] + NOISE[b / QUANTILES % QUANTILES]))
        .collect();
    for (sigmas, share) in [(1.0, 0.317_311), (2.0, 0.045_500), (3.0, 0.002_700)] {
        let found = draws.iter().filter(|d| d.abs() > sigmas).count() as f64 / 1e6;
        assert!(
            (found / share - 1.0).abs() < 0.08,
            "{found} beyond {sigmas} sigma"
        );
    }
    let (_, variance) = moments(draws.iter().copied());
    let fourth = draws.iter().map(|d| d.powi(4)).sum::<f64>() / 1e6;
    assert!((fourth / variance.powi(2) - 3.0).abs() < 0.05);
}

#[test]
fn photon_transfer_curve() {
    let params = params();
    let gain_e = params.full_well_e / 255.0;
    let mut points = Vec::new();
    for kcd_m2 in [0.375_f32, 0.75, 1.5, 3.0] {
        let mean_e =
            f64::from(kcd_m2) * params.electrons_per_kcd_m2_s() * MILLISECOND.exposure.time_s;
        let codes = expose(&params, &render(W, H, |_, _| kcd_m2), W, H);
        let (mean, variance) = moments(codes.iter().map(|c| f64::from(*c)));
        // The 12-bit code's own rounding shifts the mean by up to 1/32 of a code.
        assert!(
            (mean - mean_e / gain_e).abs() < 0.04,
            "{mean} for {}",
            mean_e / gain_e
        );
        // Shot, read and quantisation noise, the last of 1/12 code^2.
        let expected = (mean_e + 36.0) / gain_e.powi(2) + 1.0 / 12.0;
        assert!(
            (variance / expected - 1.0).abs() < 0.02,
            "{variance} for {expected}"
        );
        points.push((mean, variance));
    }
    // The slope of variance over mean is 1/gain, to 2 %.
    let (first, last) = (points[0], points[3]);
    let slope = (last.1 - first.1) / (last.0 - first.0);
    assert!(
        (slope * gain_e - 1.0).abs() < 0.02,
        "gain {} e/code",
        1.0 / slope
    );
}

#[test]
fn rows_may_be_split_and_frames_repeat() {
    let params = SensorParams {
        blur_sigma_px: 1.3,
        transfer: Transfer::Srgb,
        ..params()
    };
    let rendered = render(61, 47, |x, y| ((x * 7 + y * 13) % 11) as f32 * 0.4);
    let whole = expose(&params, &rendered, 61, 47);
    assert_eq!(whole, expose(&params, &rendered, 61, 47));
    let sensor = Sensor::new(&params).unwrap();
    let mut parts = vec![0; whole.len()];
    let mut scratch = Scratch::default();
    for rows in [30..47, 0..5, 5..6, 6..30] {
        let out = &mut parts[3 * 61 * rows.start..3 * 61 * rows.end];
        sensor
            .expose(&frame(&rendered, 61, 47), rows, 42, &mut scratch, out)
            .unwrap();
    }
    assert_eq!(whole, parts);
    let mut other = vec![0; whole.len()];
    sensor
        .expose(
            &frame(&rendered, 61, 47),
            0..47,
            43,
            &mut scratch,
            &mut other,
        )
        .unwrap();
    assert_ne!(whole, other);
}

#[test]
fn a_window_has_the_noise_of_its_place() {
    let whole = expose(&params(), &render(40, 30, |_, _| 2.0), 40, 30);
    let rendered = render(10, 8, |_, _| 2.0);
    let window = RenderedFrame {
        origin_px: [25, 17],
        ..frame(&rendered, 10, 8)
    };
    let mut out = vec![0; 3 * 10 * 8];
    Sensor::new(&params())
        .unwrap()
        .expose(&window, 0..8, 42, &mut Scratch::default(), &mut out)
        .unwrap();
    for (y, row) in out.chunks_exact(30).enumerate() {
        let at = 3 * ((17 + y) * 40 + 25);
        assert_eq!(row, &whole[at..at + 30]);
    }
}

#[test]
fn noise_is_uncorrelated_between_neighbours_and_channels() {
    let codes = expose(&params(), &render(W, H, |_, _| 4.0), W, H);
    let (mean, variance) = moments(codes.iter().map(|c| f64::from(*c)));
    for lag in [1, 2, 3, 6, 3 * W, 3 * W + 3] {
        let pairs = codes.iter().zip(&codes[lag..]);
        let n = pairs.len() as f64;
        let covariance = pairs
            .map(|(a, b)| (f64::from(*a) - mean) * (f64::from(*b) - mean))
            .sum::<f64>()
            / n;
        assert!((covariance / variance).abs() < 5.0 / n.sqrt(), "lag {lag}");
    }
}

#[test]
fn blur_keeps_the_centroid_and_the_light() {
    // A spot between pixels, of the blur's own size.
    let (cx, cy) = (20.3_f64, 15.7_f64);
    let rendered = render(41, 33, |x, y| {
        let r2 = (x as f64 + 0.5 - cx).powi(2) + (y as f64 + 0.5 - cy).powi(2);
        (10.0 * (-r2 / 4.0).exp()) as f32
    });
    let centroid = |rows: &[Vec<f32>]| {
        let (mut sum, mut sx, mut sy) = (0.0, 0.0, 0.0);
        for (y, row) in rows.iter().enumerate() {
            for (x, value) in row.iter().step_by(3).enumerate() {
                sum += f64::from(*value);
                sx += f64::from(*value) * (x as f64 + 0.5);
                sy += f64::from(*value) * (y as f64 + 0.5);
            }
        }
        (sum, sx / sum, sy / sum)
    };
    let sharp = centroid(&mean_rows(&params(), &rendered, 41, 33));
    for blur_sigma_px in [0.2, 0.5, 0.7, 1.0, 1.4, 2.5] {
        let params = SensorParams {
            blur_sigma_px,
            ..params()
        };
        let blurred = centroid(&mean_rows(&params, &rendered, 41, 33));
        assert!((blurred.0 / sharp.0 - 1.0).abs() < 1e-3);
        assert!((blurred.1 - cx).hypot(blurred.2 - cy) < 0.01, "{blurred:?}");
    }
}

#[test]
fn blur_has_the_mtf_of_a_gaussian() {
    for sigma in [0.3_f64, 0.5, 0.6, 0.8, 1.2, 1.6, 3.0] {
        let params = SensorParams {
            blur_sigma_px: sigma,
            ..params()
        };
        for cycles in [8.0, 16.0, 32.0] {
            let f = cycles / 160.0; // [cycles/px]
            for upright in [true, false] {
                let rendered = render(160, 160, |x, y| {
                    let at = if upright { y } else { x } as f64;
                    (4.0 + 2.0 * (std::f64::consts::TAU * f * at).cos()) as f32
                });
                let rows = mean_rows(&params, &rendered, 160, 160);
                // Away from the edges, over whole periods of all three frequencies.
                let (mut real, mut imaginary) = (0.0, 0.0);
                for i in 40..120 {
                    let value = f64::from(if upright {
                        rows[i][240]
                    } else {
                        rows[80][3 * i]
                    });
                    let (sin, cos) = (std::f64::consts::TAU * f * i as f64).sin_cos();
                    real += value * cos;
                    imaginary += value * sin;
                }
                let per_kcd = params.electrons_per_kcd_m2_s() * MILLISECOND.exposure.time_s;
                let mtf = real.hypot(imaginary) / 40.0 / (2.0 * per_kcd);
                let gauss = (-2.0 * (std::f64::consts::PI * sigma * f).powi(2)).exp();
                assert!(
                    (mtf - gauss).abs() < 0.01,
                    "{mtf} for {gauss}: {sigma} px, {f}/px"
                );
            }
        }
    }
}

#[test]
fn saturates_and_survives_any_half() {
    let odd = [65504.0, f32::INFINITY];
    assert!(
        expose(&params(), &render(8, 8, |x, _| odd[x % 2]), 8, 8)
            .iter()
            .all(|c| *c == 255)
    );
    let dark = [f32::NAN, -1.0, f32::NEG_INFINITY, 0.0];
    assert!(
        expose(&params(), &render(8, 8, |x, _| dark[x % 4]), 8, 8)
            .iter()
            .all(|c| *c <= 1)
    );
    // A gain of 3.92 spreads 2,550 electrons over the codes.
    let params = SensorParams {
        read_noise_e: 0.0,
        ..params()
    };
    let half_white = 1275.0 / (params.electrons_per_kcd_m2_s() * MILLISECOND.exposure.time_s);
    let rendered = render(64, 64, |_, _| half_white as f32);
    let exposure = Exposure {
        gain: 10_000.0 / 2550.0,
        ..MILLISECOND.exposure
    };
    let frame = RenderedFrame {
        conditions: &Conditions { exposure },
        ..frame(&rendered, 64, 64)
    };
    let mut codes = vec![0; 3 * 64 * 64];
    Sensor::new(&params)
        .unwrap()
        .expose(&frame, 0..64, 42, &mut Scratch::default(), &mut codes)
        .unwrap();
    let (mean, _) = moments(codes.iter().map(|c| f64::from(*c)));
    assert!((mean - 127.5).abs() < 0.2, "{mean}");
}

#[test]
fn a_metered_scene_and_its_light_come_out_as_set() {
    // What is metered lies at the level, and what is as bright in another light is as grey.
    let illuminant = [1.1, 1.0, 0.8];
    let params = SensorParams {
        white_balance: white_balance(illuminant),
        ..params()
    };
    let control = ExposureControl {
        level: 0.5,
        time_s: [1e-6, 0.01],
        max_gain: 8.0,
        settling_s: 0.25,
    };
    let metered_kcd_m2 = 4.0;
    let wanted_s = control.wanted_s(metered_kcd_m2, params.saturation_kcd_s_m2());
    let rendered: Vec<u8> = (0..64 * 64)
        .flat_map(|_| [1.1f32, 1.0, 0.8, 0.0].map(|c| f16::from_f32(c * 4.0)))
        .flat_map(f16::to_le_bytes)
        .collect();
    let frame = RenderedFrame {
        conditions: &Conditions {
            exposure: control.setting(wanted_s),
        },
        ..frame(&rendered, 64, 64)
    };
    let mut codes = vec![0; 3 * 64 * 64];
    Sensor::new(&params)
        .unwrap()
        .expose(&frame, 0..64, 42, &mut Scratch::default(), &mut codes)
        .unwrap();
    let means =
        [0, 1, 2].map(|c| moments(codes.iter().skip(c).step_by(3).map(|c| f64::from(*c))).0);
    // Red is the largest part of the light and keeps its gain of 1.
    for mean in means {
        assert!((mean - 255.0 * 0.5 * 1.1).abs() < 0.6, "{means:?}");
    }
}

#[test]
fn bad_input_is_an_error() {
    let bad = SensorParams {
        f_number: f64::NAN,
        ..params()
    };
    assert!(matches!(
        Sensor::new(&bad),
        Err(SensorError::Parameter {
            name: "f_number",
            ..
        })
    ));
    let bad = SensorParams {
        blur_sigma_px: 20.0,
        ..params()
    };
    assert!(Sensor::new(&bad).is_err());
    let sensor = Sensor::new(&params()).unwrap();
    let rendered = render(4, 4, |_, _| 1.0);
    let run = |bytes: &[u8], rows: Range<usize>, out: usize| {
        let mut scratch = Scratch::default();
        sensor.expose(
            &frame(bytes, 4, 4),
            rows,
            0,
            &mut scratch,
            &mut vec![0; out],
        )
    };
    assert!(run(&rendered, 0..4, 48).is_ok());
    assert!(matches!(
        run(&rendered[1..], 0..4, 48),
        Err(SensorError::Buffer { .. })
    ));
    assert!(matches!(
        run(&rendered, 0..4, 47),
        Err(SensorError::Buffer { .. })
    ));
    assert!(matches!(
        run(&rendered, 2..5, 36),
        Err(SensorError::Rows { .. })
    ));
}
