//! A frame's seeing: what of the air lies before each thing in it.

use super::air::FrozenAir;
use super::blur::{near_field, short_exposure_sigma_rad};
use super::pupil::Pupil;
use super::ripples::{Lens, Look, Ripples};
use super::sight::Sight;
use super::warp::{Part, ShiftMap};
use crate::optics::camera::PixelRect;
use glam::{DVec2, DVec3};
use std::sync::Arc;

/// Wavelength of the blur [m].
const WAVELENGTH_M: f64 = 550e-9;
/// Shifts of which three standard deviations are less than this do not show [px].
const MIN_SHIFT_PX: f64 = 0.05;
/// Blur below this does not show [px].
const MIN_BLUR_PX: f64 = 0.15;
/// Pixels about what flies that move as it does, beyond its blur.
const MARGIN_PX: f64 = 3.0;

/// A camera as the air sees it.
#[derive(Clone, Debug)]
pub struct SeeingOptics {
    /// The air of its station.
    pub air: Arc<FrozenAir>,
    /// Its aperture.
    pub pupil: Pupil,
    /// Diameter of the aperture [m].
    pub diameter_m: f64,
    /// Its lens.
    pub lens: Lens,
}

/// Something that is seen through the air.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenThrough {
    /// Its number.
    pub index: usize,
    /// Its box [px, whole sensor].
    pub box_px: [f64; 4],
    /// Its place on the sensor [px].
    pub place_px: DVec2,
    /// The air before it.
    pub sight: Sight,
    /// Its velocity against the station [m/s].
    pub v_enu_mps: DVec3,
}

/// The seeing of one frame.
#[derive(Clone, Debug)]
pub struct FrameSeeing {
    /// The camera.
    pub optics: Arc<SeeingOptics>,
    /// When and where it looks, at what stands still.
    pub look: Look,
    /// What flies in the frame.
    pub flying: Vec<SeenThrough>,
}

impl FrameSeeing {
    /// By how much the image of something that flies is shifted [px].
    pub fn shift_px(&self, index: usize) -> DVec2 {
        let seen = self.flying.iter().find(|seen| seen.index == index);
        seen.filter(|seen| self.shows(&seen.sight).0)
            .map_or(DVec2::ZERO, |seen| {
                self.ripples(&seen.sight, seen.v_enu_mps).at(seen.place_px)
            })
    }

    /// The parts of a rectangle of the sensor, what stands still first, the air before which is `behind`; none where nothing
    /// shows.
    pub fn parts(&self, rect: PixelRect, behind: &Sight) -> Vec<Part> {
        let flying = self.flying.iter();
        let mut far_first: Vec<_> = flying
            .filter(|seen| self.shows_at_all(&seen.sight))
            .collect();
        far_first.sort_by(|a, b| b.sight.range_m.total_cmp(&a.sight.range_m));
        let mut parts = Vec::new();
        if self.shows_at_all(behind) {
            parts.push(self.part(rect, behind, DVec3::ZERO));
        }
        for seen in far_first {
            let margin_px = MARGIN_PX + 3.0 * self.blur_px(&seen.sight);
            let [x0, y0, x1, y1] = seen.box_px;
            let clip = |low: f64, high: f64, i: usize| {
                let from = f64::from(rect.offset_px[i]);
                let to = from + f64::from(rect.size_px[i]);
                let within = |px: f64| px.clamp(from, to) as u32;
                [
                    within((low - margin_px).floor()),
                    within((high + margin_px).ceil()),
                ]
            };
            let ([left, right], [top, bottom]) = (clip(x0, x1, 0), clip(y0, y1, 1));
            if left < right && top < bottom {
                let own = PixelRect {
                    offset_px: [left, top],
                    size_px: [right - left, bottom - top],
                };
                parts.push(self.part(own, &seen.sight, seen.v_enu_mps));
            }
        }
        parts
    }

    fn part(&self, rect: PixelRect, sight: &Sight, seen_enu_mps: DVec3) -> Part {
        let ripples = self.ripples(sight, seen_enu_mps);
        let blur_px = self.blur_px(sight).hypot(ripples.blurred_px2.sqrt());
        Part {
            rect,
            map: ShiftMap::new(&ripples, rect),
            blur_px,
        }
    }

    fn ripples(&self, sight: &Sight, seen_enu_mps: DVec3) -> Ripples {
        let SeeingOptics {
            air, pupil, lens, ..
        } = &*self.optics;
        let look = Look {
            seen_enu_mps,
            ..self.look
        };
        Ripples::new(air, sight, pupil, &look, lens)
    }

    /// Standard deviation of the blur of a short exposure [px].
    fn blur_px(&self, sight: &Sight) -> f64 {
        let SeeingOptics {
            diameter_m, lens, ..
        } = &*self.optics;
        let near_field = near_field(*diameter_m, WAVELENGTH_M, sight.range_m);
        let fried_m = sight.fried_m(WAVELENGTH_M);
        lens.focal_px * short_exposure_sigma_rad(*diameter_m, WAVELENGTH_M, fried_m, near_field)
    }

    /// Whether the shifts and the blur through some air show. The blur is no more than that of a long exposure by its seeing
    /// disc, 0.98 λ/r0 wide.
    fn shows(&self, sight: &Sight) -> (bool, bool) {
        let SeeingOptics {
            diameter_m, lens, ..
        } = &*self.optics;
        let shift_px = lens.focal_px * sight.tilt_variance_rad2(*diameter_m).sqrt();
        let blur_px = lens.focal_px * 0.98 * WAVELENGTH_M / sight.fried_m(WAVELENGTH_M) / 2.355;
        (3.0 * shift_px > MIN_SHIFT_PX, blur_px > MIN_BLUR_PX)
    }

    fn shows_at_all(&self, sight: &Sight) -> bool {
        let (shift, blur) = self.shows(sight);
        shift || blur
    }
}
