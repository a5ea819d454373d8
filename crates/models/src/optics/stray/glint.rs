//! What a surface that a laser lights sends back: a diffuse part and a lobe about the mirror's direction.

use glam::DVec3;
use std::f64::consts::PI;

/// How a surface reflects.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reflecting {
    /// Share of the light that goes into all directions (Lambert).
    pub diffuse: f64,
    /// Share that its gloss reflects at right angles.
    pub gloss: f64,
    /// Root mean square slope of the gloss's facets.
    pub roughness: f64,
}

/// What a smooth dielectric of index 1.5 reflects at right angles (Fresnel).
const FRESNEL: f64 = 0.04;
/// Slope of the facets of injection-moulded or painted parts: chosen, a lobe some 17° wide.
const ROUGHNESS: f64 = 0.15;

/// Walls, roofs, soil: diffuse, of a reflectance usual at 1 µm.
pub const MASONRY: Reflecting = Reflecting {
    diffuse: 0.3,
    gloss: 0.0,
    roughness: ROUGHNESS,
};

impl Reflecting {
    /// The surface of a material that absorbs so much and lets nothing through.
    pub fn of_absorptivity(absorptivity: f64) -> Self {
        let reflected = (1.0 - absorptivity).clamp(0.0, 1.0);
        let gloss = FRESNEL.min(reflected);
        Self {
            diffuse: reflected - gloss,
            gloss,
            roughness: ROUGHNESS,
        }
    }

    /// Radiant intensity [W/sr] towards `to_eye` of a spot on which `power_w` [W] falls from `to_laser`; unit vectors away
    /// from the surface, `normal` its own. The spot is on the surface wholly.
    ///
    /// The gloss is Torrance and Sparrow's without shadowing (J. Opt. Soc. Am. 57, 1105, 1967), with Beckmann's slopes.
    pub fn intensity_wpsr(
        &self,
        power_w: f64,
        normal: DVec3,
        to_laser: DVec3,
        to_eye: DVec3,
    ) -> f64 {
        let [cos_in, cos_out] = [to_laser, to_eye].map(|way| normal.dot(way));
        if cos_in <= 0.0 || cos_out <= 0.0 {
            return 0.0;
        }
        let diffuse = self.diffuse * cos_out / PI;
        let cos_half_2 = normal.dot((to_laser + to_eye).normalize_or_zero()).powi(2);
        let gloss = if self.gloss > 0.0 && cos_half_2 > 0.0 {
            let slopes_2 = self.roughness * self.roughness;
            let tan_2 = (1.0 - cos_half_2) / cos_half_2;
            let facets_per_sr = (-tan_2 / slopes_2).exp() / (PI * slopes_2 * cos_half_2.powi(2));
            self.gloss * facets_per_sr / (4.0 * cos_in)
        } else {
            0.0
        };
        power_w * (diffuse + gloss)
    }
}

/// The face of a box, along the axes that `axes` holds, that a unit direction meets most squarely.
pub fn facing(axes: [DVec3; 3], towards: DVec3) -> DVec3 {
    let faces = axes.into_iter().map(|axis| {
        let cos = axis.dot(towards);
        (cos.abs(), axis * cos.signum())
    });
    faces
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map_or(towards, |(_, face)| face)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lambertian_disc_has_the_radiance_rho_e_over_pi() {
        let white = Reflecting {
            diffuse: 0.8,
            gloss: 0.0,
            roughness: 0.1,
        };
        // 100 W evenly on a disc of 0.1 m, seen 40° from its normal: L = I / (A cos 40°).
        let area_m2 = PI * 0.1 * 0.1;
        let eye = DVec3::new(40f64.to_radians().sin(), 0.0, 40f64.to_radians().cos());
        let intensity = white.intensity_wpsr(100.0, DVec3::Z, DVec3::Z, eye);
        let radiance = intensity / (area_m2 * eye.z);
        let expected = 0.8 * (100.0 / area_m2) / PI;
        assert!(
            (radiance / expected - 1.0).abs() < 1e-12,
            "{radiance} {expected}"
        );
        assert_eq!(
            white.intensity_wpsr(100.0, DVec3::Z, DVec3::Z, -DVec3::Z),
            0.0
        );
    }

    #[test]
    fn what_is_reflected_is_what_is_not_absorbed() {
        for (absorptivity, to_laser) in [
            (0.9, DVec3::Z),
            (0.5, DVec3::new(0.4, 0.0, 1.0).normalize()),
            (0.14, DVec3::Z),
        ] {
            let surface = Reflecting::of_absorptivity(absorptivity);
            let (rings, sectors) = (400, 400);
            let mut sum = 0.0;
            for i in 0..rings {
                let cos = (f64::from(i) + 0.5) / f64::from(rings);
                let sin = (1.0 - cos * cos).sqrt();
                for j in 0..sectors {
                    let (y, x) = (2.0 * PI * f64::from(j) / f64::from(sectors)).sin_cos();
                    let eye = DVec3::new(sin * x, sin * y, cos);
                    let sr = 2.0 * PI / f64::from(rings * sectors);
                    sum += sr * surface.intensity_wpsr(1.0, DVec3::Z, to_laser, eye);
                }
            }
            // The lobe's model leaves a few per cent of the gloss out or in.
            let expected = 1.0 - absorptivity;
            assert!(
                (sum - expected).abs() < 0.1 * surface.gloss,
                "{sum} {expected}"
            );
        }
    }

    #[test]
    fn gloss_flashes_when_the_mirrors_direction_meets_the_eye() {
        let shell = Reflecting::of_absorptivity(0.9);
        let turned = |deg: f64| {
            let normal = DVec3::new(deg.to_radians().sin(), 0.0, deg.to_radians().cos());
            shell.intensity_wpsr(1.0, normal, DVec3::Z, DVec3::Z)
        };
        assert!(
            turned(0.0) > 5.0 * turned(20.0),
            "{} {}",
            turned(0.0),
            turned(20.0)
        );
        let axes = [DVec3::X, DVec3::Y, DVec3::Z];
        assert_eq!(facing(axes, DVec3::new(0.1, -0.9, 0.3)), -DVec3::Y);
    }
}
