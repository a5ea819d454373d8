use super::blur::{fried, resolution};
use super::pupil::bessel;
use super::*;
use crate::air::atmosphere::Cn2Profile;
use crate::air::turbulence::{AirPath, PathTurbulence};
use crate::maths::rng::Stream;
use crate::optics::camera::PixelRect;
use glam::{DVec2, DVec3};
use half::f16;
use std::f64::consts::TAU;
use std::sync::Arc;

/// An ordinary day's Cn² [m^(-2/3)].
const CN2: f64 = 1e-14;

fn air(seed: u64, outer_m: f64) -> FrozenAir {
    FrozenAir::new(&mut Stream::new(seed, 0, "seeing"), outer_m)
}

/// A look to the north in a cross wind, at a time [s], at what stands still.
fn look(t_s: f64) -> Look {
    Look {
        axes_enu: [DVec3::X, -DVec3::Z, DVec3::Y],
        t_s,
        exposure_s: 0.0,
        winds_enu_mps: [DVec3::new(5.0, 0.0, 0.0); LAYERS],
        seen_enu_mps: DVec3::ZERO,
    }
}

/// Mean of a figure over airs.
fn mean<T: std::iter::Sum<T> + std::ops::Div<f64, Output = T>>(
    count: u64,
    of: impl Fn(u64) -> T,
) -> T {
    (0..count).map(of).sum::<T>() / count as f64
}

/// Correlation of the tilts [rad²], right and down, of two sources a small angle [rad] apart to the right, by quadrature over
/// von Kármán's spectrum: ½ ∫ κ² F² (J0 ∓ J2) W 2π κ dκ, for each layer.
fn by_quadrature(sight: &Sight, diameter_m: f64, outer_m: f64, apart_rad: f64) -> DVec2 {
    let kappa0 = TAU / outer_m;
    const STEPS: usize = 400;
    let (low, high) = (1e-4f64.ln(), 3e3f64.ln());
    let step = (high - low) / STEPS as f64;
    let mut sum = DVec2::ZERO;
    for slab in sight.slabs.iter().filter(|slab| slab.strength > 0.0) {
        for i in 0..STEPS {
            let kappa = (low + (i as f64 + 0.5) * step).exp();
            let spectrum = TAU * 0.033 * (kappa * kappa + kappa0 * kappa0).powf(-11.0 / 6.0);
            let x = 0.5 * kappa * slab.gamma * diameter_m;
            let seen = slab.gamma * 2.0 * bessel(1, x) / x;
            let energy = slab.strength * spectrum * TAU * kappa.powi(4) * step * seen * seen;
            let apart = kappa * slab.z_m * apart_rad;
            let (j0, j2) = (bessel(0, apart), bessel(2, apart));
            sum += 0.5 * energy * DVec2::new(j0 - j2, j0 + j2);
        }
    }
    sum
}

#[test]
fn frieds_parameter_is_that_of_the_path() {
    let profile = Cn2Profile::Urban {
        cn2_ref: CN2,
        height_ref_m: 10.0,
        displacement_m: 10.0,
        day: true,
    };
    for (length_m, h1_m) in [(300.0, 40.0), (1_000.0, 90.0), (2_500.0, 150.0)] {
        let path = AirPath {
            length_m,
            h0_m: 30.0,
            h1_m,
        };
        let sight = Sight::new(length_m, |z_m| {
            profile.cn2(30.0 + (h1_m - 30.0) * z_m / length_m)
        });
        let known = PathTurbulence::new(&profile, &path, 550e-9, f64::INFINITY).fried_spherical_m;
        let found = sight.fried_m(550e-9);
        assert!((found / known - 1.0).abs() < 5e-3, "{found} {known}");
    }
}

#[test]
fn tilts_have_the_published_variance() {
    let star = Sight {
        range_m: f64::INFINITY,
        ..Sight::new(1_000.0, |_| 0.0)
    };
    // A plane wave through one layer, and a point source 1 km away in even air.
    let mut plane = star;
    plane.slabs[7] = super::sight::Slab {
        z_m: 1_000.0,
        gamma: 1.0,
        strength: CN2 * 1_000.0,
    };
    let point = Sight::new(1_000.0, |_| CN2);
    let lambda_m: f64 = 550e-9;
    let k = TAU / lambda_m;
    // A&P ch. 6: r0 of plane and spherical waves in even air.
    let plane_m = (0.423 * k * k * CN2 * 1_000.0).powf(-0.6);
    let point_m = plane_m * (3.0f64 / 8.0).powf(-0.6);
    for (sight, fried_m) in [(plane, plane_m), (point, point_m)] {
        for diameter_m in [0.02, 0.045, 0.15] {
            let published =
                0.170 * (lambda_m / diameter_m).powi(2) * (diameter_m / fried_m).powf(5.0 / 3.0);
            let pupil = Pupil::disc(diameter_m);
            let over_phases = mean(600, |seed| {
                Ripples::new(
                    &air(seed, f64::INFINITY),
                    &sight,
                    &pupil,
                    &look(0.0),
                    &Lens::ANGLES,
                )
                .variance_px2()
            });
            // What is seen at some time in some direction, too.
            let seen = mean(4_000, |seed| {
                let ripples = Ripples::new(
                    &air(seed, f64::INFINITY),
                    &sight,
                    &pupil,
                    &look(seed as f64),
                    &Lens::ANGLES,
                );
                let shift = ripples.at(DVec2::new(1e-3, 2e-3) * (seed % 7) as f64);
                shift * shift
            });
            let theory = sight.tilt_variance_rad2(diameter_m);
            println!("{diameter_m}: {over_phases} {seen} {theory:e} of {published:e}");
            for found in [over_phases, seen] {
                for axis in found.to_array() {
                    assert!((axis / published - 1.0).abs() < 0.05, "{axis} {published}");
                }
            }
            assert!((theory / published - 1.0).abs() < 5e-3);
        }
    }
}

#[test]
fn tilts_of_two_directions_are_correlated_as_quadrature_says() {
    let (diameter_m, outer_m) = (0.045, 20.0);
    let sight = Sight::new(1_000.0, |_| CN2);
    let pupil = Pupil::disc(diameter_m);
    let whole = by_quadrature(&sight, diameter_m, outer_m, 0.0);
    // The outer scale takes from the variance.
    let share = whole.x / sight.tilt_variance_rad2(diameter_m);
    assert!((0.70..0.90).contains(&share), "{share}");
    for apart_rad in [0.0, 1e-4, 5e-4, 2e-3, 1e-2, 5e-2] {
        let expected = by_quadrature(&sight, diameter_m, outer_m, apart_rad);
        let found = mean(6_000, |seed| {
            let ripples = Ripples::new(
                &air(seed, outer_m),
                &sight,
                &pupil,
                &look(3.0),
                &Lens::ANGLES,
            );
            let here = DVec2::new(0.01, -0.02);
            ripples.at(here) * ripples.at(here + apart_rad * DVec2::X)
        });
        println!("{apart_rad}: {} of {}", found / whole.x, expected / whole.x);
        let off = (found - expected).abs() / whole.x;
        assert!(off.max_element() < 0.05, "{apart_rad}: {found} {expected}");
    }
}

/// Power of a series at a frequency [Hz], through Hann's window.
fn power(series: &[f64], dt_s: f64, hz: f64) -> f64 {
    let n = series.len() as f64;
    let (mut re, mut im) = (0.0, 0.0);
    for (i, value) in series.iter().enumerate() {
        let window = 0.5 - 0.5 * (TAU * (i as f64 + 0.5) / n).cos();
        let (sin, cos) = (TAU * hz * i as f64 * dt_s).sin_cos();
        re += window * value * cos;
        im += window * value * sin;
    }
    (re * re + im * im) * dt_s / n
}

#[test]
fn tilt_changes_with_the_published_spectrum() {
    // One layer in 5 m/s across 0.2 m: the knee lies near 0.3 V/D = 8 Hz (Tyler, JOSA A 11, 358, 1994).
    let (diameter_m, dt_s, count) = (0.2, 1e-3, 4_096);
    let mut sight = Sight::new(1_000.0, |_| 0.0);
    sight.range_m = f64::INFINITY;
    sight.slabs[3] = super::sight::Slab {
        z_m: 200.0,
        gamma: 1.0,
        strength: 1e-11,
    };
    let pupil = Pupil::disc(diameter_m);
    let hz: [f64; 4] = [0.6, 2.4, 60.0, 240.0];
    let mut powers = [0.0; 4];
    for seed in 0..400 {
        let air = air(seed, f64::INFINITY);
        let ripples = Ripples::new(&air, &sight, &pupil, &look(0.0), &Lens::ANGLES);
        // The wind carries the layer over the aperture: a step of time is a step of the angle.
        let step_rad = 5.0 * dt_s / 200.0;
        let tilts = (0..count).map(|i| ripples.at(DVec2::new(-step_rad * i as f64, 0.0)).x);
        let series: Vec<f64> = tilts.collect();
        if seed == 0 {
            let later = Ripples::new(&air, &sight, &pupil, &look(0.5), &Lens::ANGLES);
            let off = (later.at(DVec2::ZERO).x - series[500]).abs();
            assert!(off < 1e-6 * later.variance_px2().x.sqrt(), "{off}");
        }
        for (power_at, hz) in powers.iter_mut().zip(hz) {
            // Over a third of an octave.
            for k in -4..=4 {
                *power_at += power(&series, dt_s, hz * 2f64.powf(f64::from(k) / 24.0));
            }
        }
    }
    let slope = |a: usize, b: usize| (powers[b] / powers[a]).ln() / (hz[b] / hz[a]).ln();
    let (low, high) = (slope(0, 1), slope(2, 3));
    println!("slopes {low} {high}");
    assert!((low + 2.0 / 3.0).abs() < 0.15, "{low}");
    assert!((high + 11.0 / 3.0).abs() < 0.25, "{high}");
}

#[test]
fn an_exposure_averages_tilt_into_blur() {
    let sight = Sight::new(1_000.0, |_| CN2);
    let pupil = Pupil::disc(0.045);
    let at = |exposure_s: f64, pitch_px: f64| {
        mean(200, |seed| {
            let look = Look {
                exposure_s,
                ..look(1.0)
            };
            let lens = Lens {
                focal_px: 36_667.0,
                pitch_px,
                ..Lens::ANGLES
            };
            let ripples = Ripples::new(&air(seed, 20.0), &sight, &pupil, &look, &lens);
            let left = ripples.variance_px2().element_sum() / 2.0;
            DVec2::new(left, ripples.blurred_px2)
        })
    };
    let (short, ms, long) = (at(0.0, 0.0), at(1e-3, 0.0), at(10.0, 0.0));
    // Nothing is lost: what does not shift blurs.
    assert_eq!(short.y, 0.0);
    for exposed in [ms, long] {
        assert!((exposed.element_sum() / short.x - 1.0).abs() < 1e-9);
    }
    // D/v is 9 ms.
    assert!(
        ms.x > 0.97 * short.x && long.x < 0.15 * short.x,
        "{ms} {long}"
    );
    // A map of 4 px has most of the shifts.
    let mapped = at(0.0, 4.0);
    assert!(mapped.y > 0.0 && mapped.y < 0.45 * short.x, "{mapped}");
}

#[test]
fn resolution_is_frieds() {
    // Fried 1966: a long exposure through a large lens resolves as r0 does; a short one in the near field 3.5 times as much
    // at D = 3.8 r0, and no more anywhere.
    let over = |d_r0: f64, near: f64| {
        8.0 * d_r0 * d_r0 * resolution(|u| fried(3.44 * d_r0.powf(5.0 / 3.0), near, u))
    };
    assert!((8.0 * resolution(|_| 1.0) - 1.0).abs() < 2e-3);
    let long = over(10.0, 0.0);
    assert!((0.85..1.0).contains(&long), "{long}");
    let best = (10..80).map(|k| 0.1 * f64::from(k));
    let best = best
        .max_by(|a, b| over(*a, 1.0).total_cmp(&over(*b, 1.0)))
        .unwrap();
    println!("long {long} best {best} {}", over(best, 1.0));
    assert!((best - 3.8).abs() < 0.3, "{best}");
    assert!((over(best, 1.0) - 3.5).abs() < 0.2, "{}", over(best, 1.0));
}

#[test]
fn short_exposure_and_tilt_make_the_long_one() {
    let (diameter_m, lambda_m) = (0.05, 550e-9);
    for d_r0 in [0.5, 1.0, 2.0] {
        let fried_m = diameter_m / d_r0;
        let short = short_exposure_sigma_rad(diameter_m, lambda_m, fried_m, 1.0);
        let long = long_exposure_sigma_rad(diameter_m, lambda_m, fried_m);
        // Fried's short exposure is free of the Zernike tilt.
        let tilt = 0.182f64.sqrt() * lambda_m / diameter_m * d_r0.powf(5.0 / 6.0);
        let sum = short.hypot(tilt);
        println!("{d_r0}: {short:e} {tilt:e} {sum:e} {long:e}");
        assert!((sum / long - 1.0).abs() < 0.15, "{d_r0}: {sum} {long}");
    }
    assert_eq!(
        short_exposure_sigma_rad(0.05, lambda_m, f64::INFINITY, 1.0),
        0.0
    );
}

/// A camera like the precise one: 27 µrad a pixel, 45 mm.
fn optics(seed: u64) -> SeeingOptics {
    SeeingOptics {
        air: Arc::new(air(seed, 20.0)),
        pupil: Pupil::disc(0.045),
        diameter_m: 0.045,
        lens: Lens {
            focal_px: 36_667.0,
            centre_px: DVec2::new(320.0, 240.0),
            pitch_px: 4.0,
            line_s: 0.0,
        },
    }
}

const WINDOW: PixelRect = PixelRect {
    offset_px: [192, 112],
    size_px: [256, 256],
};

fn frame(seed: u64, t_s: f64, flying: Vec<SeenThrough>) -> FrameSeeing {
    FrameSeeing {
        optics: Arc::new(optics(seed)),
        look: Look {
            exposure_s: 1e-3,
            ..look(t_s)
        },
        flying,
    }
}

/// A picture, dark to the left of its middle and bright to the right.
fn edge(rect: PixelRect) -> Vec<u8> {
    let [width, height] = rect.size_px;
    let pixel = |x: u32| {
        let value = f16::from_f32(if 2 * x < width { 0.25 } else { 1.0 });
        [value, value, value, f16::ONE].map(f16::to_le_bytes)
    };
    let row: Vec<u8> = (0..width).flat_map(pixel).flatten().collect();
    row.repeat(height as usize)
}

/// Where the edge lies in a row [px], by its mean.
fn edge_px(rgba16f: &[u8], width: usize, row: usize) -> f64 {
    let line = &rgba16f[8 * width * row..8 * width * (row + 1)];
    let value = |x: usize| f64::from(f16::from_le_bytes([line[8 * x], line[8 * x + 1]]));
    (0..width).map(|x| (1.0 - value(x)) / 0.75).sum()
}

fn warped(frame: &FrameSeeing, rect: PixelRect, behind: &Sight) -> Vec<u8> {
    let mut pixels = edge(rect);
    let parts = frame.parts(rect, behind);
    let mut picture = Picture::default();
    picture.read(&pixels, rect);
    let rows = rect.size_px[1] as usize;
    picture.write(&parts, 0..rows, &mut WarpScratch::default(), &mut pixels);
    pixels
}

#[test]
fn a_straight_edge_waves_as_predicted() {
    let sight = Sight::new(1_500.0, |_| 5e-14);
    let (mut found, mut expected) = (0.0, 0.0);
    const AIRS: u64 = 120;
    for seed in 0..AIRS {
        let frame = frame(seed, seed as f64, Vec::new());
        let parts = frame.parts(WINDOW, &sight);
        assert_eq!(parts.len(), 1);
        let SeeingOptics {
            air, pupil, lens, ..
        } = &*frame.optics;
        let ripples = Ripples::new(air, &sight, pupil, &frame.look, lens);
        expected += ripples.variance_px2().x / AIRS as f64;
        // The edge lies on a column of nodes, and the rows beside nodes.
        let pixels = warped(&frame, WINDOW, &sight);
        let off = |row: usize| edge_px(&pixels, 256, row) - 128.0;
        let rows = (0..256).step_by(16).map(|row| off(row).powi(2));
        found += rows.sum::<f64>() / 16.0 / AIRS as f64;
    }
    println!("rms {} of {} px", found.sqrt(), expected.sqrt());
    assert!(expected > 0.15, "{expected}");
    assert!((found.sqrt() / expected.sqrt() - 1.0).abs() < 0.08);
}

/// A bright square of 5 px on the middle of a window, as something that flies there.
fn square() -> (Vec<u8>, [f64; 4]) {
    let mut pixels = vec![0; 8 * 256 * 256];
    for (x, y) in (126..131).flat_map(|x| (126..131).map(move |y| (x, y))) {
        let at = 8 * (256 * y + x);
        pixels[at..at + 2].copy_from_slice(&f16::ONE.to_le_bytes());
    }
    let [left, top] = WINDOW.offset_px.map(f64::from);
    (
        pixels,
        [left + 126.0, top + 126.0, left + 131.0, top + 131.0],
    )
}

/// Sum and centroid of a window's red light [px].
fn centroid(rgba16f: &[u8]) -> (f64, DVec2) {
    let (mut sum, mut first) = (0.0, DVec2::ZERO);
    for (i, pixel) in rgba16f.chunks_exact(8).enumerate() {
        let value = f64::from(f16::from_le_bytes([pixel[0], pixel[1]]));
        sum += value;
        first += value * DVec2::new((i % 256) as f64 + 0.5, (i / 256) as f64 + 0.5);
    }
    (sum, first / sum)
}

#[test]
fn a_truth_detectors_shift_is_the_pictures() {
    let (mut off, mut whole) = (0.0, 0.0);
    for seed in 0..40 {
        let (mut pixels, box_px) = square();
        let seen = SeenThrough {
            index: 0,
            box_px,
            place_px: DVec2::from(WINDOW.offset_px.map(f64::from)) + 128.5,
            sight: Sight::new(1_200.0, |_| 3e-14),
            v_enu_mps: DVec3::X,
        };
        let frame = frame(seed, 1.0, vec![seen]);
        let parts = frame.parts(WINDOW, &Sight::new(2_000.0, |_| 3e-14));
        let mut picture = Picture::default();
        picture.read(&pixels, WINDOW);
        picture.write(&parts, 0..256, &mut WarpScratch::default(), &mut pixels);
        let (sum, centre) = centroid(&pixels);
        assert!((sum / 25.0 - 1.0).abs() < 0.3, "{sum}");
        let shift = frame.shift_px(0);
        off += (centre - 128.5 - shift).length_squared();
        whole += shift.length_squared();
    }
    println!(
        "off {} of {} px",
        (off / 40.0).sqrt(),
        (whole / 40.0).sqrt()
    );
    assert!(off < 0.3 * 0.3 * whole, "{off} {whole}");
}

#[test]
fn a_beam_wanders_with_the_image() {
    let (w0_m, diameter_m, outer_m, range_m) = (0.05, 0.045, 20.0, 1_000.0);
    let sight = Sight::new(range_m, |_| CN2);
    let pupils = [Pupil::disc(diameter_m), Pupil::gaussian(w0_m)];
    let sums = mean(4_000, |seed| {
        let air = air(seed, outer_m);
        let [image, beam] = pupils.each_ref().map(|pupil| {
            Ripples::new(&air, &sight, pupil, &look(2.0), &Lens::ANGLES).at(DVec2::ZERO)
        });
        DVec3::new(
            image.length_squared(),
            beam.length_squared(),
            image.dot(beam),
        )
    });
    let correlation = sums.z / (sums.x * sums.y).sqrt();
    // What theory gives the beam: by its long-term and short-term spot.
    let path = AirPath {
        length_m: range_m,
        h0_m: 1.0,
        h1_m: 1.0,
    };
    let turbulence = PathTurbulence::new(&Cn2Profile::Constant(CN2), &path, 1.064e-6, outer_m);
    let w_m = 1.064e-6 * range_m / (std::f64::consts::PI * w0_m);
    let (long_m, short_m) = (
        turbulence.long_term_radius_m(w_m),
        turbulence.short_term_radius_m(w_m),
    );
    let theory_rad = 0.5 * (long_m.powi(2) - short_m.powi(2)).sqrt() / range_m;
    let found_rad = (0.5 * sums.y).sqrt();
    println!("correlation {correlation}, {found_rad:e} of {theory_rad:e} rad");
    assert!((0.8..0.99).contains(&correlation), "{correlation}");
    assert!((found_rad / theory_rad - 1.0).abs() < 0.2);
}

#[test]
fn still_air_leaves_every_bit() {
    let still = Sight::new(1_500.0, |_| 0.0);
    let seen = SeenThrough {
        index: 0,
        box_px: [300.0, 220.0, 330.0, 240.0],
        place_px: DVec2::new(315.0, 230.0),
        sight: still,
        v_enu_mps: DVec3::X,
    };
    let frame = frame(1, 2.0, vec![seen]);
    assert!(frame.parts(WINDOW, &still).is_empty());
    assert_eq!(frame.shift_px(0), DVec2::ZERO);
    assert_eq!(warped(&frame, WINDOW, &still), edge(WINDOW));
}

#[test]
fn what_flies_moves_with_its_own_air_and_a_window_is_cut_from_the_whole() {
    let behind = Sight::new(3_000.0, |_| 3e-14);
    let seen = SeenThrough {
        index: 4,
        box_px: [300.0, 220.0, 330.0, 240.0],
        place_px: DVec2::new(315.0, 230.0),
        sight: Sight::new(800.0, |_| 3e-14),
        v_enu_mps: DVec3::new(10.0, 0.0, 0.0),
    };
    let frame = frame(3, 7.0, vec![seen]);
    let parts = frame.parts(WINDOW, &behind);
    assert_eq!(parts.len(), 2);
    // Its truth is shifted as the picture is there.
    let own = frame.shift_px(4);
    assert!(own.length() > 0.05, "{own}");
    let whole = PixelRect {
        offset_px: [0; 2],
        size_px: [640, 480],
    };
    let (in_window, in_whole) = (
        warped(&frame, WINDOW, &behind),
        warped(&frame, whole, &behind),
    );
    assert_eq!(in_window, warped(&frame, WINDOW, &behind));
    let other = FrameSeeing {
        optics: Arc::new(optics(4)),
        ..frame.clone()
    };
    assert_ne!(in_window, warped(&other, WINDOW, &behind));
    // The edge lies elsewhere in the two: compare what the maps say.
    let maps = [WINDOW, whole].map(|rect| frame.parts(rect, &behind).remove(0).map);
    for place in [[200, 120], [320, 240], [400, 300]] {
        let at = |map: &ShiftMap| {
            let mut row = Vec::new();
            map.row(place[0], place[1], 1, &mut row);
            row[0]
        };
        let [a, b] = [at(&maps[0]), at(&maps[1])];
        assert!(
            (a[0] - b[0]).abs() < 1e-4 && (a[1] - b[1]).abs() < 1e-4,
            "{a:?} {b:?}"
        );
    }
    assert_eq!(in_whole.len(), 8 * 640 * 480);
}

#[test]
fn a_point_is_blurred_by_what_is_asked() {
    let rect = PixelRect {
        offset_px: [0; 2],
        size_px: [64, 64],
    };
    let mut pixels = vec![0; 8 * 64 * 64];
    let at = 8 * (32 * 64 + 32);
    pixels[at..at + 2].copy_from_slice(&f16::from_f32(1_000.0).to_le_bytes());
    let calm = frame(1, 0.0, Vec::new());
    let map = calm
        .parts(rect, &Sight::new(1_500.0, |_| 1e-13))
        .remove(0)
        .map;
    let part = Part {
        rect,
        map,
        blur_px: 2.0,
    };
    let mut picture = Picture::default();
    picture.read(&pixels, rect);
    // Two strips are one.
    let mut halves = pixels.clone();
    let (upper, lower) = halves.split_at_mut(8 * 64 * 32);
    let parts = [part];
    picture.write(&parts, 0..32, &mut WarpScratch::default(), upper);
    picture.write(&parts, 32..64, &mut WarpScratch::default(), lower);
    picture.write(&parts, 0..64, &mut WarpScratch::default(), &mut pixels);
    assert_eq!(pixels, halves);
    let (mut sum, mut first, mut second) = (0.0, DVec2::ZERO, 0.0);
    for y in 0..64 {
        for x in 0..64 {
            let i = 8 * (y * 64 + x);
            let value = f64::from(f16::from_le_bytes([pixels[i], pixels[i + 1]]));
            let place = DVec2::new(x as f64, y as f64);
            sum += value;
            first += value * place;
            second += value * place.length_squared();
        }
    }
    let centre = first / sum;
    let variance = 0.5 * (second / sum - centre.length_squared());
    println!("sum {sum} centre {centre} variance {variance}");
    assert!((sum / 1_000.0 - 1.0).abs() < 0.1, "{sum}");
    assert!((variance / 4.0 - 1.0).abs() < 0.2, "{variance}");
}
