use super::*;
use crate::air::daylight::daylight;
use crate::optics::exposure::{ExposureControl, white_balance};
use crate::optics::stray::light::PointLight;
use glam::{DVec2, DVec3};

const W: usize = 640;
const H: usize = 480;

/// A camera without a pattern, losses or filters.
fn params() -> SensorParams {
    SensorParams {
        f_number: 4.0,
        pixel_pitch_m: 4.8e-6,
        transmission: 0.9,
        quantum_efficiency: 0.6,
        full_well_e: 10_000.0,
        read_noise_e: 6.0,
        dark_current_eps: 0.0,
        dsnu_e: 0.0,
        prnu: 0.0,
        pattern_key: 3,
        size_px: [W as u32, H as u32],
        // So long that cos^4 is 1.
        focal_px: 1e6,
        vignetting: 0.0,
        mosaic: Mosaic::None,
        shutter: Shutter::Global,
        motion_blur: true,
        glare: 1.0,
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
static MILLISECOND: LazyLock<Conditions> = LazyLock::new(Conditions::default);

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

/// The mean luminance of the first channel, of every row, without noise.
fn mean_rows(params: &SensorParams, rgba16f: &[u8], width: usize, height: usize) -> Vec<Vec<f32>> {
    let sensor = Sensor::new(params).unwrap();
    let mut scratch = Scratch::default();
    let frame = frame(rgba16f, width, height);
    let (radius, length) = (sensor.taps.len() - 1, 2 * sensor.taps.len() - 1);
    (0..height)
        .map(|y| {
            sensor.blur_rows(&frame, y, y == 0, &mut scratch);
            let mut halves = [vec![0.0; width.div_ceil(2)], vec![0.0; width / 2]];
            for (parity, half) in halves.iter_mut().enumerate() {
                let ring = &scratch.ring;
                let row = |k: usize| (y + k).saturating_sub(radius).min(height - 1) % length;
                weigh(&sensor.taps, |k| &ring[row(k)][parity], half);
            }
            (0..width).map(|x| halves[x % 2][x / 2]).collect()
        })
        .collect()
}

#[test]
fn one_lux_of_555_nm() {
    // 1/683 W over 3.5792e-19 J.
    assert!((PHOTONS_PER_LUX_S_M2 / 4.0907e15 - 1.0).abs() < 1e-4);
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
    let rendered = render(61, 47, |x, y| ((x * 7 + y * 13) % 11) as f32 * 0.4);
    let blurred = SensorParams {
        blur_sigma_px: 1.3,
        transfer: Transfer::Srgb,
        ..params()
    };
    for params in [blurred, real()] {
        splits(&params, &rendered);
    }
}

fn splits(params: &SensorParams, rendered: &[u8]) {
    let whole = expose(params, rendered, 61, 47);
    assert_eq!(whole, expose(params, rendered, 61, 47));
    let sensor = Sensor::new(params).unwrap();
    let mut parts = vec![0; whole.len()];
    let mut scratch = Scratch::default();
    for rows in [30..47, 0..5, 5..6, 6..30] {
        let out = &mut parts[3 * 61 * rows.start..3 * 61 * rows.end];
        sensor
            .expose(&frame(rendered, 61, 47), rows, 42, &mut scratch, out)
            .unwrap();
    }
    assert_eq!(whole, parts);
    let mut other = vec![0; whole.len()];
    sensor
        .expose(
            &frame(rendered, 61, 47),
            0..47,
            43,
            &mut scratch,
            &mut other,
        )
        .unwrap();
    assert_ne!(whole, other);
}

/// All that a camera does.
fn real() -> SensorParams {
    SensorParams {
        dark_current_eps: 500.0,
        dsnu_e: 3.0,
        prnu: 0.01,
        size_px: [64, 48],
        focal_px: 300.0,
        vignetting: 0.2,
        mosaic: Mosaic::Rggb,
        white_balance: [1.4, 1.0, 1.2],
        blur_sigma_px: 0.7,
        transfer: Transfer::Srgb,
        ..params()
    }
}

#[test]
fn a_window_has_the_pixels_and_noise_of_its_place() {
    let scene = |x: usize, y: usize| ((x * 7 + y * 13) % 11) as f32 * 0.3;
    let conditions = Conditions {
        motion: ImageMotion {
            still_pxps: DVec2::new(1500.0, -600.0),
            boxes: vec![([20.0, 15.0, 30.0, 25.0], DVec2::new(-300.0, 0.0))],
        },
        sun: Some(SunGlare {
            sun_cam: DVec3::new(0.1, -0.2, 1.0).normalize(),
            sun_klx: [80.0, 75.0, 60.0],
            focal_px: 300.0,
            centre_px: [32.0, 24.0],
        }),
        ..Conditions::default()
    };
    for (params, margin) in [
        (
            SensorParams {
                size_px: [64, 48],
                ..params()
            },
            4,
        ),
        // The kernel's radius of 3, the smear's reach of 2 and its interpolation's of 2, the mosaic.
        (real(), 8),
    ] {
        let sensor = Sensor::new(&params).unwrap();
        let shown = |x0: usize, y0: usize, width: usize, height: usize| {
            let rendered = render(width, height, |x, y| scene(x0 + x, y0 + y));
            let frame = RenderedFrame {
                origin_px: [x0 as u32, y0 as u32],
                conditions: &conditions,
                ..frame(&rendered, width, height)
            };
            let mut out = vec![0; 3 * width * height];
            sensor
                .expose(&frame, 0..height, 42, &mut Scratch::default(), &mut out)
                .unwrap();
            out
        };
        let whole = shown(0, 0, 64, 48);
        for (x0, y0) in [(10, 6), (13, 7), (12, 9), (15, 10)] {
            let window = shown(x0, y0, 33, 30);
            let same = (margin..30 - margin).all(|y| {
                let part =
                    |rgb8: &[u8], at: usize| rgb8[3 * at..3 * (at + 33 - 2 * margin)].to_vec();
                let there = (y0 + y) * 64 + x0 + margin;
                part(&window, y * 33 + margin) == part(&whole, there)
            });
            assert!(same, "{x0} {y0} {:?}", params.mosaic);
        }
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
            for (x, value) in row.iter().enumerate() {
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
                for (i, row) in rows.iter().enumerate().take(120).skip(40) {
                    let value = f64::from(if upright { row[80] } else { rows[80][i] });
                    let (sin, cos) = (std::f64::consts::TAU * f * i as f64).sin_cos();
                    real += value * cos;
                    imaginary += value * sin;
                }
                let mtf = real.hypot(imaginary) / 40.0 / 2.0;
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
        conditions: &Conditions {
            exposure,
            ..Conditions::default()
        },
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
    let illuminant = daylight(0.34);
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
        .flat_map(|_| [illuminant[0], illuminant[1], illuminant[2], 0.0])
        .map(|c| f16::from_f64(c * metered_kcd_m2))
        .flat_map(f16::to_le_bytes)
        .collect();
    let frame = RenderedFrame {
        conditions: &Conditions {
            exposure: control.setting(wanted_s),
            ..Conditions::default()
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
        assert!(
            (mean - 255.0 * 0.5 * illuminant[0]).abs() < 0.6,
            "{means:?}"
        );
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

/// A camera measured as EMVA 1288 (release 3.1) says, from raw codes: pairs of frames for the
/// temporal noise, the mean of many for what stays.
struct Emva {
    sensor: Sensor,
}

const SIDE: usize = 256;
/// Frames of a stack.
const STACK: u64 = 32;

impl Emva {
    fn new(mosaic: Mosaic) -> Self {
        let params = SensorParams {
            full_well_e: 22_000.0,
            read_noise_e: 4.0,
            dark_current_eps: 2_000.0,
            dsnu_e: 1.6,
            prnu: 0.006,
            size_px: [SIDE as u32; 2],
            mosaic,
            ..params()
        };
        Self {
            sensor: Sensor::new(&params).unwrap(),
        }
    }

    /// The raw codes of an even field of `kcd_m2`.
    fn shoot(&self, kcd_m2: f32, exposure: Exposure, seed: u64) -> Vec<f64> {
        let rendered = render(SIDE, SIDE, |_, _| kcd_m2);
        let frame = RenderedFrame {
            conditions: &Conditions {
                exposure,
                ..Conditions::default()
            },
            ..frame(&rendered, SIDE, SIDE)
        };
        let raw = self.sensor.raw(&frame, seed, &mut Scratch::default());
        raw.unwrap().into_iter().map(f64::from).collect()
    }

    /// Mean and temporal variance of two frames (EMVA 1288, eqs. 9 and 12).
    fn pair(&self, kcd_m2: f32, exposure: Exposure) -> (f64, f64) {
        // Noise of its own for each level.
        let seed = u64::from(kcd_m2.to_bits());
        let (a, b) = (
            self.shoot(kcd_m2, exposure, seed),
            self.shoot(kcd_m2, exposure, !seed),
        );
        let (mean_a, mean_b) = (moments(a.iter().copied()).0, moments(b.iter().copied()).0);
        let n = a.len() as f64;
        let square: f64 = a.iter().zip(&b).map(|(a, b)| (a - b).powi(2)).sum();
        let variance = 0.5 * (square / n - (mean_a - mean_b).powi(2));
        (0.5 * (mean_a + mean_b), variance)
    }

    /// Spatial variance of a stack's mean, less what its temporal noise leaves (section 8.1).
    fn spatial_variance(&self, kcd_m2: f32, exposure: Exposure) -> f64 {
        let mut sum = vec![0.0; SIDE * SIDE];
        for seed in 0..STACK {
            for (sum, code) in sum.iter_mut().zip(self.shoot(kcd_m2, exposure, 100 + seed)) {
                *sum += code / STACK as f64;
            }
        }
        let temporal = self.pair(kcd_m2, exposure).1;
        moments(sum.iter().copied()).1 - temporal / STACK as f64
    }

    /// Photons a pixel for a luminance.
    fn photons(&self, kcd_m2: f32, exposure: &Exposure) -> f64 {
        let params = self.sensor.params();
        f64::from(kcd_m2) * params.electrons_per_kcd_m2_s() * exposure.time_s
            / params.quantum_efficiency
    }
}

#[test]
fn emva_1288_finds_what_was_set() {
    let emva = Emva::new(Mosaic::Rggb);
    let params = *emva.sensor.params();
    for gain in [1.0, 4.0] {
        let exposure = Exposure { time_s: 1e-3, gain };
        let full_kcd_m2 = (params.saturation_kcd_s_m2() / (exposure.time_s * exposure.gain)) as f32;
        // Photon transfer, from 5 to 70 % of saturation: K is the slope of variance over mean.
        let (dark, dark_variance) = emva.pair(0.0, exposure);
        let points = [0.05f32, 0.2, 0.4, 0.7].map(|share| {
            let kcd_m2 = share * full_kcd_m2;
            let (mean, variance) = emva.pair(kcd_m2, exposure);
            (
                emva.photons(kcd_m2, &exposure),
                mean - dark,
                variance - dark_variance,
            )
        });
        let slope = |x: fn(&(f64, f64, f64)) -> f64, y: fn(&(f64, f64, f64)) -> f64| {
            let (xy, xx) = points.iter().fold((0.0, 0.0), |(xy, xx), p| {
                (xy + x(p) * y(p), xx + x(p) * x(p))
            });
            xy / xx
        };
        let k_dn_per_e = slope(|p| p.1, |p| p.2);
        let responsivity = slope(|p| p.0, |p| p.1);
        let near = |name: &str, found: f64, set: f64, tolerance: f64| {
            println!("gain {gain}: {name} {found:.4}, set {set:.4}");
            assert!(
                (found / set - 1.0).abs() < tolerance,
                "{name}: {found} for {set}"
            );
        };
        near(
            "K [DN/e]",
            k_dn_per_e,
            emva.sensor.codes_per_e(&exposure),
            0.02,
        );
        near(
            "quantum efficiency",
            responsivity / k_dn_per_e,
            params.quantum_efficiency,
            0.02,
        );
        // Dark noise less quantisation's 1/12; two electrons of dark current have noise of their own.
        let dark_e = (dark_variance - 1.0 / 12.0).sqrt() / k_dn_per_e;
        near(
            "temporal dark noise [e]",
            dark_e,
            (16.0f64 + 2.0).sqrt(),
            0.03,
        );
        let late = emva
            .pair(
                0.0,
                Exposure {
                    time_s: 11e-3,
                    gain,
                },
            )
            .0;
        let current_eps = (late - dark) / k_dn_per_e / 10e-3;
        near(
            "dark current [e/s]",
            current_eps,
            params.dark_current_eps,
            0.03,
        );
        let dsnu_e = emva.spatial_variance(0.0, exposure).sqrt() / k_dn_per_e;
        near("DSNU1288 [e]", dsnu_e, params.dsnu_e, 0.04);
        let half = 0.5 * full_kcd_m2;
        let bright = emva.pair(half, exposure).0;
        let prnu = (emva.spatial_variance(half, exposure) - (dsnu_e * k_dn_per_e).powi(2)).sqrt();
        near("PRNU1288", prnu / (bright - dark), params.prnu, 0.04);
        // The saturation capacity: the variance is largest where clipping begins to cut it.
        let most = (60..130)
            .map(|percent| {
                let kcd_m2 = 0.01 * percent as f32 * full_kcd_m2;
                (
                    emva.pair(kcd_m2, exposure).1,
                    emva.photons(kcd_m2, &exposure),
                )
            })
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap();
        let capacity_e = most.1 * params.quantum_efficiency;
        near(
            "saturation capacity [e]",
            capacity_e,
            params.full_well_e / gain,
            0.06,
        );
        // The signal-to-noise ratio of one photon count is as EMVA's model has it.
        let photons = points[2].0;
        let snr = points[2].1 / (points[2].2 + dark_variance).sqrt();
        let mean_e = params.quantum_efficiency * photons;
        let model = mean_e / (mean_e + 18.0 + 1.0 / 12.0 / k_dn_per_e.powi(2)).sqrt();
        near("SNR at 40 %", snr, model, 0.02);
    }
}

#[test]
fn every_effect_can_be_switched_off() {
    // Without noise, pattern, losses and motion a flat field is flat, with a mosaic or without.
    for mosaic in [Mosaic::None, Mosaic::Rggb, Mosaic::Mono] {
        let params = SensorParams {
            full_well_e: 1e9,
            read_noise_e: 0.0,
            mosaic,
            size_px: [40, 30],
            ..params()
        };
        let half_white = (0.5 * params.saturation_kcd_s_m2() / 1e-3) as f32;
        let codes = expose(&params, &render(40, 30, |_, _| half_white.min(6e4)), 40, 30);
        assert!(codes.iter().all(|code| *code == codes[0]), "{mosaic:?}");
    }
}

#[test]
fn without_filters_a_pixel_counts_all_light_and_shows_no_colour() {
    let rggb = Emva::new(Mosaic::Rggb);
    let mono = Emva::new(Mosaic::Mono);
    let exposure = Exposure {
        time_s: 1e-4,
        ..Exposure::default()
    };
    // A white field: three times the signal, and so the root of three times the ratio to its noise.
    let signal = |emva: &Emva| {
        let (mean, variance) = emva.pair(2.0, exposure);
        let (dark, _) = emva.pair(0.0, exposure);
        (mean - dark, (mean - dark) / variance.sqrt())
    };
    let ((least, noisy), (most, clean)) = (signal(&rggb), signal(&mono));
    assert!((most / least - 3.0).abs() < 0.05, "{least} {most}");
    assert!(
        (clean / noisy - 3f64.sqrt()).abs() < 0.15,
        "{noisy} {clean}"
    );
    // Red light and blue light of the same strength are the same grey.
    let params = SensorParams {
        mosaic: Mosaic::Mono,
        read_noise_e: 0.0,
        full_well_e: 1e9,
        ..params()
    };
    let half = (0.5 * params.saturation_kcd_s_m2() / 1e-3) as f32;
    let shown = |rgb: [f32; 3]| {
        let mut rendered = render(16, 16, |_, _| 0.0);
        for pixel in rendered.chunks_exact_mut(8) {
            for (place, value) in pixel.chunks_exact_mut(2).zip(rgb) {
                place.copy_from_slice(&f16::from_f32(value.min(6e4)).to_le_bytes());
            }
        }
        expose(&params, &rendered, 16, 16)
    };
    let (red, blue) = (shown([half, 0.0, 0.0]), shown([0.0, 0.0, half]));
    assert_eq!(red, blue);
    assert!(
        red.iter().all(|code| *code == red[0]) && red[0] > 20,
        "{}",
        red[0]
    );
}

#[test]
fn corners_lose_what_the_lens_takes() {
    let params = SensorParams {
        full_well_e: 1e7,
        read_noise_e: 0.0,
        focal_px: 500.0,
        vignetting: 0.3,
        ..params()
    };
    let luminance = (0.8 * params.saturation_kcd_s_m2() / 1e-3) as f32;
    let codes = expose(&params, &render(W, H, |_, _| luminance), W, H);
    let at = |x: usize, y: usize| f64::from(codes[3 * (y * W + x)]);
    let centre = at(W / 2, H / 2);
    // 400 px from the axis to the corner, 0.8 of the focal length.
    let cos_4 = 1.0 / (1.0 + 0.64f64).powi(2);
    assert!(
        (at(0, 0) / centre - 0.7 * cos_4).abs() < 0.012,
        "{}",
        at(0, 0) / centre
    );
    // Half way it is a quarter of the mounts' loss.
    let half = 0.925 / (1.0 + 0.16f64).powi(2);
    assert!((at(W / 4, H / 4) / centre - half).abs() < 0.012);
}

#[test]
fn a_rolling_shutter_leans_what_stands_upright() {
    // A bright column while the image moves right: every row is exposed 10 us after the last.
    let params = SensorParams {
        shutter: Shutter::Rolling(10e-6),
        size_px: [80, 60],
        ..params()
    };
    let rendered = render(80, 60, |x, _| if (38..42).contains(&x) { 4.0 } else { 0.0 });
    let conditions = Conditions {
        exposure: Exposure {
            time_s: 1e-4,
            gain: 8.0,
        },
        motion: ImageMotion {
            still_pxps: DVec2::new(20_000.0, 0.0),
            boxes: Vec::new(),
        },
        sun: None,
        stray: None,
    };
    let frame = RenderedFrame {
        conditions: &conditions,
        ..frame(&rendered, 80, 60)
    };
    let mut out = vec![0; 3 * 80 * 60];
    let sensor = Sensor::new(&params).unwrap();
    sensor
        .expose(&frame, 0..60, 1, &mut Scratch::default(), &mut out)
        .unwrap();
    let centroid = |y: usize| {
        let row = out[240 * y..240 * (y + 1)].iter().step_by(3);
        let (sum, first) = row.enumerate().fold((0.0, 0.0), |(sum, first), (x, code)| {
            let light = f64::from(code.saturating_sub(3));
            (sum + light, first + light * (x as f64 + 0.5))
        });
        first / sum
    };
    for y in [2, 20, 29, 30, 45, 57] {
        let expected = 40.0 + 0.2 * (y as f64 + 0.5 - 30.0);
        assert!(
            (centroid(y) - expected).abs() < 0.15,
            "{y}: {} {expected}",
            centroid(y)
        );
    }
}

#[test]
fn glare_of_the_sun_falls_off_and_reaches_all_colours() {
    let params = SensorParams {
        read_noise_e: 0.0,
        size_px: [64, 48],
        focal_px: 400.0,
        ..params()
    };
    let rendered = render(64, 48, |_, _| 0.0);
    let conditions = Conditions {
        sun: Some(SunGlare {
            sun_cam: DVec3::new(0.0, -0.1, 1.0).normalize(),
            sun_klx: [8.0; 3],
            focal_px: 400.0,
            centre_px: [32.0, 24.0],
        }),
        ..Conditions::default()
    };
    let frame = RenderedFrame {
        conditions: &conditions,
        ..frame(&rendered, 64, 48)
    };
    let sensor = Sensor::new(&params).unwrap();
    let mut out = vec![0; 3 * 64 * 48];
    sensor
        .expose(&frame, 0..48, 1, &mut Scratch::default(), &mut out)
        .unwrap();
    let white = params.saturation_kcd_s_m2() / 1e-3;
    // From 2.5 deg to 9 deg from the sun.
    for y in [1usize, 24, 47] {
        let below_rad = (y as f64 + 0.5 - 24.0) / 400.0;
        let theta_deg = (0.1f64.atan() + below_rad.atan()).to_degrees();
        let expected = 255.0 * 8.0 / (theta_deg * theta_deg) / white;
        let row = out[3 * (64 * y + 28)..3 * (64 * y + 36)]
            .iter()
            .map(|c| f64::from(*c));
        let found = moments(row).0;
        assert!(
            (found / expected - 1.0).abs() < 0.08,
            "{y}: {found} for {expected}"
        );
    }
}

/// A picture of a grey scene with a point of light of `klx` in its middle.
fn with_point(params: &SensorParams, klx: f64) -> Vec<u8> {
    let rendered = render(64, 48, |_, _| 1.0);
    let conditions = Conditions {
        stray: Some(Arc::new(StrayLight {
            focal_px: 36_000.0,
            centre_px: [32.0, 24.0],
            blur_px: 0.8,
            glare: 1.0,
            least_kcd_m2: 0.0,
            beams: Vec::new(),
            points: vec![PointLight {
                dir_cam: DVec3::new(0.5 / 36_000.0, 0.5 / 36_000.0, 1.0).normalize(),
                klx: [klx; 3],
                radius_rad: 1e-5,
            }],
        })),
        ..Conditions::default()
    };
    let frame = RenderedFrame {
        conditions: &conditions,
        ..frame(&rendered, 64, 48)
    };
    let mut out = vec![0; 3 * 64 * 48];
    Sensor::new(params)
        .unwrap()
        .expose(&frame, 0..48, 42, &mut Scratch::default(), &mut out)
        .unwrap();
    out
}

#[test]
fn a_point_of_light_saturates_its_pixels_and_veils_the_rest() {
    let params = SensorParams {
        size_px: [64, 48],
        ..params()
    };
    let rendered = render(64, 48, |_, _| 1.0);
    let without = expose(&params, &rendered, 64, 48);
    assert_eq!(
        with_point(&params, 0.0),
        without,
        "no light changes no code"
    );
    let white = params.saturation_kcd_s_m2() / 1e-3;
    let pixel_sr = 36_000f64.powi(-2);
    // Of three pixels' full wells the middle one takes 0.22: it is dimmer than white. Of three thousand it is white.
    for (wells, saturated) in [(3.0, 0), (3e3, 9)] {
        let out = with_point(&params, wells * white * pixel_sr);
        let full = out.iter().step_by(3).filter(|code| **code == 255).count();
        assert!(
            full >= saturated && (saturated > 0 || full == 0),
            "{wells}: {full}"
        );
        assert_eq!(out[3 * (64 * 24 + 32)] == 255, saturated > 0);
    }
    // The veil of 2 deg² core and klx: a corner gets g E/(theta² + core²) more.
    let klx = 0.01 * white;
    let out = with_point(&params, klx);
    let mean = |out: &[u8]| {
        let corner = (0..8).flat_map(|y| (0..12).map(move |x| out[3 * (64 * y + x)]));
        moments(corner.map(f64::from).collect::<Vec<_>>().into_iter()).0
    };
    let theta_deg = (26.5f64.hypot(20.5) / 36_000.0).to_degrees();
    let expected = 255.0 * (klx / white) / (theta_deg * theta_deg + 0.02 * 0.02);
    let found = mean(&out) - mean(&without);
    assert!(out.len() == without.len() && expected > 100.0);
    let clipped = (mean(&without) + expected).min(255.0) - mean(&without);
    assert!((found / clipped - 1.0).abs() < 0.1, "{found} {clipped}");
}
