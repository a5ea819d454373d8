//! How bright and in which white the window shows the scene: as an eye or a camera that has adapted to it.
//!
//! The middle grey of the picture follows the luminance adapted to by the curve of Krawczyk, Myszkowski and Seidel
//! ("Perceptual effects in real-time tone mapping", SCCG 2005, eq. 11): bright scenes are shown bright, dusk darker, night
//! dark. White is balanced as the cameras' automatic balance does it. Highlights are rolled off in `lean.wgsl`.

use crate::components::environment::Environment;
use crate::components::view::WindowCamera;
use crate::models::air::daylight::luminance;
use crate::models::optics::exposure::white_balance;
use bevy::camera::Exposure;
use bevy::prelude::*;
use bevy::render::view::ColorGrading;
use std::f64::consts::PI;

/// Reflectance of a grey card.
const GREY: f64 = 0.18;
/// What the card comes out at, over the curve's key: 0.2 of white by day.
const MIDDLE: f64 = 0.3;
/// Least luminance adapted to [kcd/m^2]: an overcast moonless night's ground.
const DARKEST_KCD_M2: f64 = 1e-7;
/// Luminance at which half of the white balance is made [kcd/m^2]: eyes see lamps and a city's glow in their colours.
const BALANCED_KCD_M2: f64 = 1e-3;

/// What the ground throws back, as far as the picture follows it: by half, in stops, so that snow and white models stay bright.
fn followed(reflectance: f64) -> f64 {
    (GREY * reflectance.clamp(GREY, 1.0)).sqrt()
}

/// The exposure [m^2/kcd] in light of so much illuminance of level ground [klx] that reflects so much of it.
fn exposure(ground_klx: f64, reflectance: f64) -> f64 {
    let adapted_kcd_m2 = followed(reflectance) * ground_klx / PI;
    let adapted_kcd_m2 = adapted_kcd_m2.max(DARKEST_KCD_M2);
    let key = 1.03 - 2.0 / (2.0 + (1e3 * adapted_kcd_m2 + 1.0).log10());
    MIDDLE * key / adapted_kcd_m2
}

/// Gains of the white balance, and what they leave of the brightness of a grey card.
fn balance(light_klx: [f64; 3]) -> ([f64; 3], f64) {
    let grey_kcd_m2 = GREY * luminance(light_klx) / PI;
    let share = grey_kcd_m2 / (grey_kcd_m2 + BALANCED_KCD_M2);
    let gains = white_balance(light_klx).map(|gain| gain.powf(share));
    let balanced_klx = luminance([0, 1, 2].map(|i| gains[i] * light_klx[i]));
    let brighter = balanced_klx / luminance(light_klx);
    (gains, if brighter.is_finite() { brighter } else { 1.0 })
}

/// Mean reflectance of the ground: of tiles, that of the land around them, which has their colour.
fn reflectance(environment: &Environment) -> f64 {
    if environment.tiles.is_none() {
        return GREY;
    }
    let land = environment.city.chunks();
    let colours = || land.iter().flat_map(|mesh| &mesh.colors);
    let sum: f64 = colours()
        .map(|[r, g, b, _]| luminance([r, g, b].map(|channel| f64::from(*channel))))
        .sum();
    match colours().count() {
        0 => GREY,
        count => sum / count as f64,
    }
}

/// What the window's camera needs to show the scene in its light. The view has no place for the gains of the white balance
/// but its colour grading, whose saturations nothing else reads.
pub fn shown_in(environment: &Environment) -> (Exposure, ColorGrading) {
    let sky = &environment.backdrop.sky;
    let (gains, brighter) = balance(sky.illuminant_klx());
    let exposure = exposure(sky.global_illuminance_klx(), reflectance(environment)) / brighter;
    let mut grading = ColorGrading::default();
    let [r, g, b] = gains.map(|gain| gain as f32);
    grading.shadows.saturation = r;
    grading.midtones.saturation = g;
    grading.highlights.saturation = b;
    let exposure = Exposure {
        ev100: -(1.2 * exposure).log2() as f32,
    };
    (exposure, grading)
}

/// Follows the light, which orders of weather change. The schedule also runs for the sensors' pictures, without this system: whether
/// the surroundings have changed since its last run no run condition can tell.
pub fn expose_window(
    environment: Res<Environment>,
    mut cameras: Query<(&mut Exposure, &mut ColorGrading), With<WindowCamera>>,
    mut shown: Local<Option<[f64; 3]>>,
) {
    let light_klx = environment.backdrop.sky.illuminant_klx();
    if shown.replace(light_klx) == Some(light_klx) {
        return;
    }
    for (mut exposure, mut grading) in &mut cameras {
        (*exposure, *grading) = shown_in(&environment);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::air::daylight::daylight;

    /// What a grey card comes out at on grey ground.
    fn grey(ground_klx: f64) -> f64 {
        exposure(ground_klx, GREY) * GREY * ground_klx / PI
    }

    #[test]
    fn day_is_shown_bright_dusk_darker_and_night_dark() {
        // A clear noon, an overcast day, sunset, the end of civil dusk, moonlight.
        let shown = [100.0, 10.0, 0.4, 3.4e-3, 2e-4].map(grey);
        println!("{shown:.4?}");
        assert!((0.19..0.22).contains(&shown[0]), "{shown:?}");
        assert!(shown.windows(2).all(|pair| pair[1] < pair[0]), "{shown:?}");
        assert!((0.015..0.06).contains(&shown[3]), "{shown:?}");
        assert!((0.005..0.02).contains(&shown[4]), "{shown:?}");
    }

    #[test]
    fn white_ground_stays_below_white() {
        let ground = |reflectance: f64| exposure(50.0, reflectance) * reflectance * 50.0 / PI;
        // What a level white face comes out at, before the highlights roll off from 0.4 on.
        assert!((0.4..0.55).contains(&ground(1.0)), "{}", ground(1.0));
        assert!(ground(1.0) > 1.5 * ground(0.4));
        // Dark ground is no reason to expose for longer.
        assert_eq!(exposure(50.0, 0.05), exposure(50.0, GREY));
    }

    #[test]
    fn light_is_balanced_by_day_and_left_in_its_colour_at_night() {
        let warm = |klx: f64| daylight(0.35).map(|channel| klx * channel);
        let (day, _) = balance(warm(50.0));
        let grey = [0, 1, 2].map(|i| day[i] * daylight(0.35)[i]);
        assert!(
            grey.iter()
                .all(|channel| (channel / grey[1] - 1.0).abs() < 0.01),
            "{grey:?}"
        );
        let (night, brighter) = balance(warm(1e-5));
        assert!(
            night.iter().all(|gain| (gain - 1.0).abs() < 0.01),
            "{night:?}"
        );
        assert!((brighter - 1.0).abs() < 0.01);
        // The balance does not change how bright a grey card is.
        let (gains, brighter) = balance(warm(5.0));
        let card = luminance([0, 1, 2].map(|i| gains[i] * daylight(0.35)[i])) / brighter;
        assert!((card / luminance(daylight(0.35)) - 1.0).abs() < 1e-9);
        assert_eq!(balance([0.0; 3]), ([1.0; 3], 1.0));
    }
}
