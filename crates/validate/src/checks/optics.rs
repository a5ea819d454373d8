//! Cameras: geometry, calibration, sensor, exposure, glare.

use crate::check::{Check, Fault, Tolerance, a_fifth_more};
use boresight_models::maths::rng::Stream;
use boresight_models::optics::calibration::{estimate, measure};
use boresight_models::optics::camera::Pinhole;
use boresight_models::optics::exposure::{ExposureControl, metered};
use boresight_models::optics::glare::SunGlare;
use boresight_models::optics::mosaic::Mosaic;
use boresight_models::optics::motion::Shutter;
use boresight_models::optics::sensor::{
    Conditions, RenderedFrame, Scratch, Sensor, SensorParams, Transfer,
};
use glam::{DVec2, DVec3};
use half::f16;
use std::f64::consts::{PI, TAU};

pub fn checks() -> Vec<Check> {
    [geometry(), calibration(), sensor(), exposure()].concat()
}

fn pinhole(hfov_deg: f64) -> Result<Pinhole, Fault> {
    Pinhole::from_hfov(640, 480, hfov_deg.to_radians()).map_err(Fault::of)
}

fn geometry() -> Vec<Check> {
    vec![
        Check {
            model: "camera-geometry",
            name: "focal length of 640 px over 120°",
            reference: "320/tan 60°",
            value: 320.0 / 3f64.sqrt(),
            unit: "px",
            tolerance: Tolerance::Relative(1e-12),
            mutation: a_fifth_more("field of view"),
            run: |scale| Ok(pinhole(scale.of(120.0))?.focal_px),
        },
        Check {
            model: "camera-geometry",
            name: "error of the printed eq. 8 half way out in 120°",
            reference: "atan(tan(60°)/2) - 30°",
            value: (0.5 * 3f64.sqrt()).atan().to_degrees() - 30.0,
            unit: "deg",
            tolerance: Tolerance::Relative(1e-9),
            mutation: a_fifth_more("field of view"),
            run: |scale| {
                let camera = pinhole(scale.of(120.0))?;
                let px = camera.centre_px() + DVec2::new(160.0, 0.0);
                Ok((camera.angles(px).x - camera.angles_linear(px).x).to_degrees())
            },
        },
        Check {
            model: "camera-geometry",
            name: "image of 1 m right and 2 m down at 100 m in 30°: column",
            reference: "320 + 320/tan 15° · 0.01",
            value: 320.0 + 3.2 / 15f64.to_radians().tan(),
            unit: "px",
            tolerance: Tolerance::Relative(1e-12),
            mutation: a_fifth_more("field of view"),
            run: |scale| {
                let seen = pinhole(scale.of(30.0))?.project(DVec3::new(1.0, 2.0, 100.0));
                Ok(seen.ok_or(Fault::Nothing("Pinhole::project"))?.x)
            },
        },
    ]
}

/// Mean square of a calibration's error across the line of sight over its stated one, for centroids of a noise [px] that is
/// taken for 0.2 px.
fn calibrated(sigma_px: f64) -> Result<f64, Fault> {
    const RUNS: u64 = 1000;
    let rotation_rad = DVec3::new(50e-6, -120e-6, 90e-6);
    let camera = pinhole(1.0)?;
    let mut sum = 0.0;
    for run in 0..RUNS {
        let mut rng = Stream::new(run, 0, "calibration");
        let centroids = measure(&camera, rotation_rad, 50, sigma_px, &mut rng);
        let found = estimate(&camera, &centroids, 0.2).map_err(Fault::of)?;
        let z = (found.rotation_rad - rotation_rad) / found.standard_error_rad;
        sum += 0.5 * (z.x * z.x + z.y * z.y) / RUNS as f64;
    }
    Ok(sum)
}

fn calibration() -> Vec<Check> {
    vec![
        Check {
            model: "boresight-calibration",
            name: "stated error of 200 centroids of 0.2 px, over σ/(f √N)",
            reference: "least squares across the line of sight",
            value: 1.0,
            unit: "",
            tolerance: Tolerance::Relative(0.05),
            mutation: a_fifth_more("noise of a centroid"),
            run: |scale| {
                let camera = pinhole(1.0)?;
                let mut rng = Stream::new(1, 0, "calibration");
                let centroids = measure(&camera, DVec3::ZERO, 200, 0.2, &mut rng);
                let stated = estimate(&camera, &centroids, scale.of(0.2)).map_err(Fault::of)?;
                Ok(stated.standard_error_rad.x / (0.2 / camera.focal_px / 200f64.sqrt()))
            },
        },
        Check {
            model: "boresight-calibration",
            name: "mean square of the error over the stated one, 1,000 calibrations",
            reference: "χ² of one degree of freedom",
            value: 1.0,
            unit: "",
            // Five standard errors of 2,000 samples.
            tolerance: Tolerance::Absolute(0.16),
            mutation: a_fifth_more("noise of a centroid"),
            run: |scale| calibrated(scale.of(0.2)),
        },
    ]
}

const SIDE: usize = 320;

/// A camera without a pattern, losses or filters.
const CAMERA: SensorParams = SensorParams {
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
    size_px: [SIDE as u32; 2],
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
};

/// Codes of the first channel of a frame of 1 ms, of the luminance `kcd_m2` in each column.
fn exposed(params: &SensorParams, kcd_m2: impl Fn(usize) -> f64) -> Result<Vec<f64>, Fault> {
    let rgba16f: Vec<u8> = (0..SIDE * SIDE)
        .flat_map(|at| [f16::from_f64(kcd_m2(at % SIDE)); 4])
        .flat_map(f16::to_le_bytes)
        .collect();
    let conditions = Conditions::default();
    let frame = RenderedFrame {
        rgba16f: &rgba16f,
        width: SIDE,
        height: SIDE,
        origin_px: [0, 0],
        conditions: &conditions,
    };
    let mut out = vec![0; 3 * SIDE * SIDE];
    let sensor = Sensor::new(params).map_err(Fault::of)?;
    let exposed = sensor.expose(&frame, 0..SIDE, 42, &mut Scratch::default(), &mut out);
    exposed.map_err(Fault::of)?;
    Ok(out.iter().step_by(3).map(|code| f64::from(*code)).collect())
}

fn mean_and_variance(values: &[f64]) -> [f64; 2] {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let square: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    [mean, square / (n - 1.0)]
}

/// Slope of the variance of a sensor's codes over their mean.
fn photon_transfer(params: &SensorParams) -> Result<f64, Fault> {
    let [low, high] = [0.375, 3.0].map(|kcd_m2| exposed(params, |_| kcd_m2));
    let [low, high] = [mean_and_variance(&low?), mean_and_variance(&high?)];
    Ok((high[1] - low[1]) / (high[0] - low[0]))
}

/// Contrast that a blur [px] leaves of a sine of 0.2 cycles a pixel.
fn contrast_left(blur_sigma_px: f64) -> Result<f64, Fault> {
    let params = SensorParams {
        blur_sigma_px,
        ..CAMERA
    };
    let phase = |x: usize| TAU * 0.2 * x as f64;
    let codes = exposed(&params, |x| 2.0 + phase(x).cos())?;
    // Away from the edges, over whole periods.
    let (mut real, mut imaginary, mut mean) = (0.0, 0.0, 0.0);
    for row in codes.chunks_exact(SIDE) {
        for (x, code) in row.iter().enumerate().take(SIDE - 40).skip(40) {
            real += code * phase(x).cos();
            imaginary += code * phase(x).sin();
            mean += code;
        }
    }
    // Of a mean of 2 and an amplitude of 1.
    Ok(4.0 * f64::hypot(real, imaginary) / mean)
}

fn sensor() -> Vec<Check> {
    // Image illuminance of 1 kcd/m² [lux], photons of 555 nm in a lux second [1/m²], area of a pixel, share detected.
    let lux = 1000.0 * PI * CAMERA.transmission / (4.0 * CAMERA.f_number.powi(2));
    let electrons = lux * 4.0907e15 * CAMERA.pixel_pitch_m.powi(2) * CAMERA.quantum_efficiency;
    vec![
        Check {
            model: "sensor",
            name: "electrons of 1 kcd/m² in 1 ms at f/4",
            reference: "πτL/(4N²), 1/683 W over the energy of a photon of 555 nm",
            value: 1e-3 * electrons,
            unit: "e",
            tolerance: Tolerance::Relative(1e-4),
            mutation: a_fifth_more("f-number"),
            run: |scale| {
                let params = SensorParams {
                    f_number: scale.of(CAMERA.f_number),
                    ..CAMERA
                };
                Ok(1e-3 * params.electrons_per_kcd_m2_s())
            },
        },
        Check {
            model: "sensor",
            name: "slope of the codes' variance over their mean",
            reference: "photon transfer, EMVA 1288: codes an electron",
            value: 255.0 / CAMERA.full_well_e,
            unit: "",
            tolerance: Tolerance::Relative(0.03),
            mutation: a_fifth_more("full well"),
            run: |scale| {
                photon_transfer(&SensorParams {
                    full_well_e: scale.of(CAMERA.full_well_e),
                    ..CAMERA
                })
            },
        },
        Check {
            model: "sensor",
            name: "contrast that a blur of 0.8 px leaves of 0.2 cycles a pixel",
            reference: "Gaussian's transfer: exp(-2 (πσf)²)",
            value: (-2.0 * (PI * 0.8 * 0.2f64).powi(2)).exp(),
            unit: "",
            tolerance: Tolerance::Absolute(0.01),
            mutation: a_fifth_more("blur"),
            run: |scale| contrast_left(scale.of(0.8)),
        },
    ]
}

fn exposure() -> Vec<Check> {
    vec![
        Check {
            model: "sensor",
            name: "metered luminance of a field half of 8 kcd/m², half nearly dark",
            reference: "mean in the fourth power: 8 (1/2)^(1/4)",
            value: 8.0 * 0.5f64.powf(0.25),
            unit: "kcd/m²",
            tolerance: Tolerance::Relative(1e-6),
            mutation: a_fifth_more("luminance"),
            run: |scale| Ok(metered([1e-2, scale.of(8.0)].into_iter())),
        },
        Check {
            model: "sensor",
            name: "stops left of four after one settling time of the exposure",
            reference: "exponential approach: 4/e",
            value: 4.0 / std::f64::consts::E,
            unit: "stops",
            tolerance: Tolerance::Relative(1e-9),
            mutation: a_fifth_more("settling time"),
            run: |scale| {
                let control = ExposureControl {
                    level: 0.5,
                    time_s: [1e-5, 4e-3],
                    max_gain: 16.0,
                    settling_s: scale.of(0.25),
                };
                Ok((16e-3 / control.approach_s(1e-3, 16e-3, 0.25)).log2())
            },
        },
        Check {
            model: "sensor",
            name: "veiling glare 2° from the sun, over its illuminance",
            reference: "CIE 146:2002, shape: 1/θ²",
            value: 0.25,
            unit: "cd/m²/lx",
            tolerance: Tolerance::Relative(0.02),
            mutation: a_fifth_more("angle from the sun"),
            run: |scale| {
                let (sin, cos) = scale.of(2.0).to_radians().sin_cos();
                let sun = SunGlare {
                    sun_cam: DVec3::new(sin, 0.0, cos),
                    sun_klx: [80.0, 75.0, 70.0],
                    focal_px: 6000.0,
                    centre_px: [320.5, 240.5],
                };
                let mut out = [0.0; 1];
                sun.half_row(1.0, 320, 240, &mut out);
                Ok(f64::from(out[0]))
            },
        },
    ]
}
