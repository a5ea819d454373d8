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
/// Share of the field that lit windows fill at night, which the eye adapts to: a fifth of the windows in some tenth of it.
const LIT_SHARE: f64 = 0.02;
/// Luminance of a lit window [kcd/m^2], as in the scene.
const LIT_KCD_M2: f64 = 0.08;
/// Least luminance adapted to [kcd/m^2]: an overcast moonless night's ground.
const DARKEST_KCD_M2: f64 = 1e-7;

/// The exposure [m^2/kcd] in light of so much illuminance of level ground [klx]; `lit`: with a city's lit windows about.
fn exposure(ground_klx: f64, lit: bool) -> f64 {
    let lamps_kcd_m2 = if lit { LIT_SHARE * LIT_KCD_M2 } else { 0.0 };
    let adapted_kcd_m2 = GREY * ground_klx / PI + lamps_kcd_m2;
    let adapted_kcd_m2 = adapted_kcd_m2.max(DARKEST_KCD_M2);
    let key = 1.03 - 2.0 / (2.0 + (1e3 * adapted_kcd_m2 + 1.0).log10());
    MIDDLE * key / adapted_kcd_m2
}

/// What the window's camera needs to show the scene in its light. The view has no place for the gains of the white balance
/// but its colour grading, whose saturations nothing else reads.
pub fn shown_in(environment: &Environment) -> (Exposure, ColorGrading) {
    let sky = &environment.backdrop.sky;
    let lit = !environment.city.buildings.is_empty() && environment.tiles.is_none();
    let light_klx = sky.illuminant_klx();
    let gains = white_balance(light_klx);
    let balanced_klx = luminance([0, 1, 2].map(|i| gains[i] * light_klx[i]));
    // The balance changes the colour of a grey card, not its brightness.
    let dimmed = luminance(light_klx) / balanced_klx;
    let dimmed = if dimmed.is_finite() { dimmed } else { 1.0 };
    let exposure = dimmed * exposure(sky.global_illuminance_klx(), lit);
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

/// Follows the weather that orders change.
pub fn expose_window(
    environment: Res<Environment>,
    mut cameras: Query<(&mut Exposure, &mut ColorGrading), With<WindowCamera>>,
) {
    for (mut exposure, mut grading) in &mut cameras {
        (*exposure, *grading) = shown_in(&environment);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a grey card comes out at.
    fn grey(ground_klx: f64, lit: bool) -> f64 {
        exposure(ground_klx, lit) * GREY * ground_klx / PI
    }

    #[test]
    fn day_is_shown_bright_dusk_darker_and_night_dark() {
        // A clear noon, an overcast day, sunset, the end of civil dusk, moonlight.
        let shown = [100.0, 10.0, 0.4, 3.4e-3, 2e-4].map(|klx| grey(klx, false));
        println!("{shown:.4?}");
        assert!((0.19..0.22).contains(&shown[0]), "{shown:?}");
        assert!(shown.windows(2).all(|pair| pair[1] < pair[0]), "{shown:?}");
        assert!((0.015..0.06).contains(&shown[3]), "{shown:?}");
        assert!((0.005..0.02).contains(&shown[4]), "{shown:?}");
    }

    #[test]
    fn lit_windows_stay_windows_at_night() {
        // Seen from afar a front averages its windows: a fifth are lit, and glass is some two fifths of it.
        let exposure = exposure(1e-6, true);
        let (window, front) = (exposure * LIT_KCD_M2, exposure * 0.08 * LIT_KCD_M2);
        assert!((1.0..4.0).contains(&window), "{window}");
        assert!(front < 0.3, "{front}");
        // By day they change nothing.
        assert!((grey(50.0, true) / grey(50.0, false) - 1.0).abs() < 1e-3);
    }
}
