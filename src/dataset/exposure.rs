//! From rendered luminance to the picture: what moves and glares before the sensor, and exposure.

use super::recipe::Recipe;
use super::scene::Scene;
use super::stage::{CONTROL, Rendered};
use crate::components::capture::Conditions;
use crate::models::air::daylight;
use crate::models::bodies::raster::Masks;
use crate::models::maths::kinematics::Pose;
use crate::models::maths::rng::Stream;
use crate::models::optics::exposure::ExposureControl;
use crate::models::optics::motion::ImageMotion;
use crate::systems::capture::conditions::sun_glare;
use crate::systems::capture::metering;
use glam::DVec2;
use std::f64::consts::{PI, TAU};

/// One channel of a pixel of half-float RGBA rows.
fn channel(pixels: &[u8], index: usize, channel: usize) -> f64 {
    let at = 8 * index + 2 * channel;
    half::f16::from_le_bytes([pixels[at], pixels[at + 1]]).to_f64()
}

/// Luminance of a pixel of half-float RGBA rows [kcd/m^2].
pub fn luminance(pixels: &[u8], index: usize) -> f64 {
    daylight::luminance([0, 1, 2].map(|c| channel(pixels, index, c)))
}

/// How a frame is exposed, `more_stops` brighter than the scene's others. Before it is rendered there are no
/// `pixels`, and every camera meters the model's light.
pub fn conditions(
    scene: &Scene,
    pose: &Pose,
    pixels: Option<&[u8]>,
    more_stops: f64,
) -> Conditions {
    let camera = &scene.camera;
    let error = camera.exposure_error_stops + more_stops;
    let saturation = camera.sensor.saturation_kcd_s_m2();
    let control = ExposureControl {
        time_s: [CONTROL.time_s[0], camera.max_exposure_s],
        ..CONTROL
    };
    let metered_kcd_m2 = if let Some(pixels) = pixels.filter(|_| camera.metered) {
        const EVERY: usize = 37; // [px]
        let values = (0..pixels.len() / 8)
            .step_by(EVERY)
            .map(|index| luminance(pixels, index));
        let (sum, count) = values.fold((0.0, 0.0), |(sum, n), l| (sum + l, n + 1.0));
        // The mean at 0.21 of the white level, as cameras do that do not weight the highlights.
        control.level / 0.21 * sum / count
    } else {
        metering::metered_kcd_m2(&scene.environment, &camera.pinhole, pose)
    };
    Conditions {
        exposure: control.setting(control.wanted_s(metered_kcd_m2, saturation) * error.exp2()),
        motion: ImageMotion::default(),
        sun: sun_glare(&scene.environment, &camera.pinhole, pose),
        stray: None,
    }
}

/// How a UAV's silhouette stands out from its surroundings: the root mean square of its luminance
/// against their mean, softened by the blur, over the noise of a pixel. Luminance above white
/// counts as white.
pub fn contrast(
    scene: &Scene,
    rendered: &Rendered,
    pixels: &[u8],
    masks: &Masks,
    box_px: [f64; 4],
) -> f64 {
    let (params, exposure) = (&scene.camera.sensor, &rendered.frame.conditions.exposure);
    let [width, height] = rendered.frame.rect.size_px.map(f64::from);
    let long_px = (box_px[2] - box_px[0]).max(box_px[3] - box_px[1]);
    let margin = (0.5 * long_px).max(3.0);
    let span = |low: f64, high: f64, size: f64| {
        let clip = |x: f64| x.clamp(0.0, size) as u32;
        clip((low - margin).floor())..clip((high + margin).ceil())
    };
    let rows = span(box_px[1], box_px[3], height);
    let columns = span(box_px[0], box_px[2], width);
    let electrons = params.electrons_per_kcd_m2_s() * exposure.time_s;
    let white_e = params.full_well_e / exposure.gain;
    let white = white_e / electrons;
    let at = |x: u32, y: u32| luminance(pixels, (y * width as u32 + x) as usize).min(white);
    let (mut sum, mut count) = (0.0, 0.0);
    for y in rows.clone() {
        for x in columns.clone().filter(|x| masks.at(*x, y) == 0) {
            sum += at(x, y);
            count += 1.0;
        }
    }
    if count == 0.0 {
        return f64::INFINITY;
    }
    let around = sum / count;
    let (mut square, mut area) = (0.0, 0.0);
    for y in rows {
        for x in columns.clone() {
            let covered = f64::from(masks.at(x, y).count_ones()) / 64.0;
            square += covered * (at(x, y) - around).powi(2);
            area += covered;
        }
    }
    // A Gaussian blur spreads the light of a spot of this area over 4 pi sigma^2 more.
    let soft = area / (area + 4.0 * PI * params.blur_sigma_px.powi(2));
    let rounding_e = white_e / 4095.0;
    let noise_e =
        (electrons * around + params.read_noise_e.powi(2) + rounding_e.powi(2) / 12.0).sqrt();
    (square / area.max(1e-9)).sqrt() * soft * electrons / noise_e
}

/// The motion during the exposure and a laser's flare, drawn; the flare is put into the pixels.
pub fn effects(
    recipe: &Recipe,
    scene: &Scene,
    rendered: &mut Rendered,
    pixels: &mut [u8],
    rng: &mut Stream,
) {
    let camera = &recipe.camera;
    let [width, height] = rendered.frame.rect.size_px.map(|n| n as usize);
    let (smears, flares) = (rng.uniform(), rng.uniform());
    let exposure = rendered.frame.conditions.exposure;
    if smears < camera.motion_blur_share && camera.motion_blur_px > 0.0 {
        let mut pxps = || {
            let length_px = rng.range(0.5f64.min(camera.motion_blur_px), camera.motion_blur_px);
            length_px / exposure.time_s * DVec2::from_angle(rng.range(0.0, TAU))
        };
        let (camera_pxps, uav_pxps) = (pxps(), pxps());
        let boxes = rendered.frame.truth.iter().map(|seen| seen.box_px);
        let own = |pxps: DVec2| boxes.map(|box_px| (box_px, pxps)).collect();
        // A shaken camera, one that follows its target, one that stands while the target flies by.
        let (still_pxps, boxes) = match rng.uniform() {
            u if u < 0.5 => (camera_pxps, Vec::new()),
            u if u < 0.8 => (camera_pxps, own(DVec2::ZERO)),
            _ => (DVec2::ZERO, own(uav_pxps)),
        };
        rendered.frame.conditions.motion = ImageMotion { still_pxps, boxes };
    }
    if flares < camera.flare_share {
        let truth = &rendered.frame.truth;
        let at = match truth.first() {
            Some(seen) if rng.uniform() < 0.5 => DVec2::from_array(seen.aim_px),
            _ => DVec2::new(rng.uniform() * width as f64, rng.uniform() * height as f64),
        };
        let white = scene.camera.sensor.saturation_kcd_s_m2() / (exposure.time_s * exposure.gain);
        flare(pixels, width, at, white, rng);
    }
}

fn put(pixel: &mut [u8], rgb: &[f32]) {
    for (bytes, value) in pixel.chunks_exact_mut(2).zip(rgb) {
        bytes.copy_from_slice(&half::f16::from_f32(value.min(65_000.0)).to_le_bytes());
    }
}

/// A bright spot with bloom and veiling glare at `at` [px]; `white` is the luminance of the
/// brightest code [kcd/m^2].
fn flare(pixels: &mut [u8], width: usize, at: DVec2, white: f64, rng: &mut Stream) {
    let tint = match (rng.uniform() * 3.0) as u32 {
        0 => [1.0, 1.0, 1.0],
        1 => [1.0, 0.72, 0.9],
        _ => [0.75, 1.0, 0.7],
    };
    let spot_px = rng.range(0.5, 2.5);
    let spot = white * rng.range(1.0, 12.0);
    let bloom_px = rng.range(3.0, 14.0);
    let bloom = white * rng.range(0.1, 0.8);
    let veil = white * rng.range(0.0, 0.12);
    for (index, pixel) in pixels.chunks_exact_mut(8).enumerate() {
        let p = DVec2::new((index % width) as f64 + 0.5, (index / width) as f64 + 0.5);
        let square = p.distance_squared(at);
        let light = spot * (-0.5 * square / (spot_px * spot_px)).exp()
            + bloom / (1.0 + square / (bloom_px * bloom_px)).powf(1.5)
            + veil;
        let rgb: [f32; 3] = std::array::from_fn(|c| {
            let own = half::f16::from_le_bytes([pixel[2 * c], pixel[2 * c + 1]]).to_f32();
            own + (light * tint[c]) as f32
        });
        put(pixel, &rgb);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 31;
    const HEIGHT: usize = 21;

    fn frame(value: impl Fn(usize, usize) -> f32) -> Vec<u8> {
        (0..WIDTH * HEIGHT)
            .flat_map(|i| {
                let v = value(i % WIDTH, i / WIDTH);
                [v, 2.0 * v, 0.5 * v, 25.0].map(half::f16::from_f32)
            })
            .flat_map(half::f16::to_le_bytes)
            .collect()
    }

    #[test]
    fn a_flare_only_adds_light_and_most_where_it_is() {
        let mut pixels = frame(|_, _| 1.0);
        let before = pixels.clone();
        let mut rng = Stream::new(4, 0, "test");
        flare(&mut pixels, WIDTH, DVec2::new(10.5, 5.5), 5.0, &mut rng);
        let brightest = (0..WIDTH * HEIGHT)
            .max_by(|a, b| luminance(&pixels, *a).total_cmp(&luminance(&pixels, *b)));
        assert_eq!(brightest, Some(5 * WIDTH + 10));
        for i in 0..WIDTH * HEIGHT {
            assert!(luminance(&pixels, i) >= luminance(&before, i));
            assert_eq!(channel(&pixels, i, 3), 25.0);
        }
    }
}
