//! What shows where nothing solid stands: the sky, clouds on it, and the sun's disc.
//!
//! Clouds are value noise of seven octaves on a plane over the site, as seen from the ground
//! (assumption: no published spectrum; they give sensors something to look at). They shade nothing but
//! the sun's disc, since the sky's light is that of the mean cover already.

use super::sky::Sky;
use crate::maths::curve::smoothstep;
use crate::maths::noise::ValueNoise;
use crate::maths::rng::Stream;
use glam::{DVec2, DVec3};
use std::f64::consts::PI;

/// The sun's disc fades out between these angles from its centre [rad]: 0.27 deg is its radius.
const DISC_RAD: [f64; 2] = [0.003_74, 0.005_48];
/// Radiance of the sun's disc over its illuminance [1/sr], dimmer than the true 1 / 6.8e-5 sr, and its
/// limit [kcd/m^2]: half floats end at 65504.
const DISC_PER_SR: f64 = 15.0;
const DISC_LIMIT_KCD_M2: f64 = 30_000.0;

/// What a camera sees in a direction without a surface.
#[derive(Clone, Debug)]
pub struct Backdrop {
    /// Light of sun and sky.
    pub sky: Sky,
    /// Unit vector to the sun.
    pub sun_dir_enu: DVec3,
    clouds: Option<Clouds>,
}

impl Backdrop {
    /// A sky whose sun stands towards `sun_dir_enu` (unit), without clouds.
    pub fn new(sky: Sky, sun_dir_enu: DVec3) -> Self {
        Self {
            sky,
            sun_dir_enu,
            clouds: None,
        }
    }

    /// The same with clouds over the share `cover` (0 to 1) of it, placed by `seed`; without one they are not drawn.
    pub fn with_clouds(self, cover: f64, seed: Option<u64>) -> Self {
        let clouds = seed.filter(|_| cover > 0.0);
        Self {
            clouds: clouds.map(|seed| Clouds::new(cover, seed)),
            ..self
        }
    }

    /// Whether clouds are drawn: they have finer detail than the sky.
    pub fn is_clouded(&self) -> bool {
        self.clouds.is_some()
    }

    /// Radiance towards `dir_enu` (unit) without the sun's disc, linear sRGB [kcd/m^2], in detail down to the angle
    /// `detail_rad`.
    pub fn radiance(&self, dir_enu: DVec3, detail_rad: f64) -> [f64; 3] {
        self.clouded(dir_enu, self.sky.radiance(dir_enu), detail_rad)
            .0
    }

    /// `sky`, the radiance towards `dir_enu` without clouds [kcd/m^2], as it is with them, in detail down
    /// to the angle `detail_rad`; and what they leave of the sun's disc, 0 to 1.
    pub fn clouded(&self, dir_enu: DVec3, sky: [f64; 3], detail_rad: f64) -> ([f64; 3], f64) {
        match &self.clouds {
            Some(clouds) => clouds.over(&self.sky, self.sun_dir_enu, dir_enu, sky, detail_rad),
            None => (sky, 1.0),
        }
    }

    /// The sun's disc towards `dir_enu` [kcd/m^2], 0 beside it.
    pub fn disc(&self, dir_enu: DVec3) -> [f64; 3] {
        let off_rad = dir_enu.angle_between(self.sun_dir_enu);
        let share = smoothstep(DISC_RAD[1], DISC_RAD[0], off_rad);
        let sun = self.sky.sun_illuminance();
        sun.map(|klx| share * (DISC_PER_SR * klx).min(DISC_LIMIT_KCD_M2))
    }

    /// Whether the sun's disc may show within `radius_rad` of `dir_enu` (unit).
    pub fn disc_near(&self, dir_enu: DVec3, radius_rad: f64) -> bool {
        let shines = self.sky.sun_illuminance().iter().any(|klx| *klx > 0.0);
        shines && dir_enu.angle_between(self.sun_dir_enu) < radius_rad + DISC_RAD[1]
    }
}

/// Clouds on a plane over the site.
#[derive(Clone, Debug)]
struct Clouds {
    cover: f64,
    noise: ValueNoise,
}

impl Clouds {
    fn new(cover: f64, seed: u64) -> Self {
        Self {
            cover: cover.min(1.0),
            noise: ValueNoise::new(&mut Stream::new(seed, 0, "clouds")),
        }
    }

    /// Density towards `dir_enu`, about -0.5 to 0.5; octaves end where `detail_rad` holds more than half a
    /// cell.
    fn density(&self, dir_enu: DVec3, detail_rad: f64) -> f64 {
        // Lengths of the cloud plane's height to a cell of the coarsest noise (assumption), and what keeps
        // the plane's horizon finite.
        const SCALE: f64 = 0.9;
        const CURVED: f64 = 0.07;
        const OCTAVES: usize = 7;
        let height = dir_enu.z.max(0.0) + CURVED;
        let flat = dir_enu.truncate();
        // How fast the plane goes by when the direction turns, radially and across.
        let radial = (dir_enu.z.max(0.0) * height + flat.length_squared()) / (height * height);
        let width = (detail_rad * SCALE * radial.hypot(1.0 / height)).max(1e-5);
        let (mut at, mut density) = (flat * (SCALE / height), 0.0);
        let (mut amplitude, mut frequency) = (0.25, 1.0);
        // A turn by 37 degrees hides the lattice.
        let turn = DVec2::new(0.8, 0.6);
        for _ in 0..OCTAVES {
            let share = amplitude * (2.0 - 4.0 * frequency * width).clamp(0.0, 1.0);
            if share <= 0.0 {
                break;
            }
            density += share * self.noise.at(at);
            at = 2.3 * turn.rotate(at) + DVec2::splat(17.7);
            frequency *= 2.3;
            amplitude *= 0.5;
        }
        density
    }

    fn over(
        &self,
        sky: &Sky,
        sun_dir_enu: DVec3,
        dir_enu: DVec3,
        radiance: [f64; 3],
        detail_rad: f64,
    ) -> ([f64; 3], f64) {
        let cover = self.cover;
        let density = self.density(dir_enu, detail_rad);
        let floor = 0.3 - 0.64 * cover;
        let thickness = smoothstep(floor, floor + 0.4, density);
        let mask = smoothstep(floor, floor + 0.12, density) * smoothstep(0.0, 0.09, dir_enu.z);
        let facing = dir_enu.dot(sun_dir_enu);
        let edge = (0.75 + 0.25 * facing - 0.7 * thickness).clamp(0.08, 1.0)
            + 0.5 * facing.max(0.0).powi(24) * (1.0 - thickness);
        let (sun, ambient) = (sky.sun_illuminance(), sky.ambient_down());
        let grey = (0.2126 * ambient[0] + 0.7152 * ambient[1] + 0.0722 * ambient[2]) / PI;
        let dimmed = (1.0 - 0.9 * density).clamp(0.6, 1.4);
        let mixed = std::array::from_fn(|c| {
            let lit = 0.6 * grey + 0.4 * ambient[c] / PI;
            let diffuse = (lit + (radiance[c] - lit) * cover * cover) * dimmed;
            let cloud = diffuse + 0.2 * edge * sun[c] / (1.0 - cover).max(0.1);
            radiance[c] + (cloud - radiance[c]) * mask
        });
        (mixed, 1.0 - mask * smoothstep(0.0, 0.3, thickness))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn backdrop(cover: f64) -> Backdrop {
        let sun_dir_enu = DVec3::new(0.5, -0.6, 0.62).normalize();
        let sky = Sky::new(sun_dir_enu, 20_000.0, cover, 0.18);
        Backdrop::new(sky, sun_dir_enu).with_clouds(cover, Some(7))
    }

    /// Directions spread evenly over the sky above 10 degrees.
    fn directions() -> impl Iterator<Item = DVec3> {
        (0..4000).map(|i| {
            let z = 0.17 + 0.83 * (f64::from(i) + 0.5) / 4000.0;
            let level = DVec2::from_angle(2.399_963 * f64::from(i)) * (1.0 - z * z).sqrt();
            level.extend(z)
        })
    }

    #[test]
    fn more_cover_hides_more_of_the_sky() {
        let hidden = |cover: f64| {
            let backdrop = backdrop(cover);
            let left = |dir| backdrop.clouded(dir, backdrop.sky.radiance(dir), 1e-3).1;
            1.0 - directions().map(left).sum::<f64>() / 4000.0
        };
        assert_eq!(hidden(0.0), 0.0);
        let [few, half, most] = [0.2, 0.5, 0.9].map(hidden);
        assert!(
            few > 0.0 && few < half && half < most,
            "{few} {half} {most}"
        );
    }

    #[test]
    fn coarse_detail_is_the_mean_of_fine_detail() {
        let backdrop = backdrop(0.5);
        let clouds = backdrop.clouds.as_ref().unwrap();
        let difference = |detail_rad: f64| {
            let change = |dir| (clouds.density(dir, detail_rad) - clouds.density(dir, 1e-5)).abs();
            directions().map(change).sum::<f64>() / 4000.0
        };
        let [fine, coarse] = [1e-3, 1e-2].map(difference);
        assert!(fine < coarse && coarse < 0.05, "{fine} {coarse}");
    }

    #[test]
    fn the_disc_is_the_suns_size() {
        let backdrop = backdrop(0.0);
        let at = |off_deg: f64| {
            let side = backdrop.sun_dir_enu.any_orthonormal_vector();
            let (sin, cos) = off_deg.to_radians().sin_cos();
            backdrop.disc(backdrop.sun_dir_enu * cos + side * sin)[1]
        };
        assert!(at(0.1) > 0.0 && at(0.2) == at(0.0));
        // Half of it at the true radius, 0.266 degrees.
        assert!(
            (at(0.266) / at(0.0) - 0.5).abs() < 0.1,
            "{}",
            at(0.266) / at(0.0)
        );
        assert_eq!(at(0.4), 0.0);
        assert!(backdrop.disc_near(backdrop.sun_dir_enu, 0.0));
        assert!(!backdrop.disc_near(-backdrop.sun_dir_enu, 0.5));
    }
}
