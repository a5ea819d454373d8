//! What an aperture makes of the air's waves: tilts over its field.

use super::air::{FrozenAir, LayerWinds};
use super::pupil::Pupil;
use super::sight::Sight;
use glam::{DVec2, DVec3};

/// Waves whose square is less than this share of the variance that an aperture of [`NOMINAL_M`] sees are left out [-]: all of
/// them have less than half a per cent of it.
const LEAST_SHARE: f64 = 2e-5;
/// An aperture as cameras have [m].
const NOMINAL_M: f64 = 0.05;

/// When and where an aperture looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// Its axes, east, north, up: right, down and ahead.
    pub axes_enu: [DVec3; 3],
    /// Time of the middle of the exposure since the start [s].
    pub t_s: f64,
    /// Time of the exposure [s].
    pub exposure_s: f64,
    /// What carries the layers [m/s].
    pub winds_enu_mps: LayerWinds,
    /// Velocity of what is seen [m/s]: the sight's rays sweep over the air with it.
    pub seen_enu_mps: DVec3,
}

/// What turns angles into pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Focal length [px]; 1: angles stay angles.
    pub focal_px: f64,
    /// Where the axis meets the picture [px].
    pub centre_px: DVec2,
    /// Pitch of the map of shifts [px], whose nodes lie at its multiples; 0: all waves are kept.
    pub pitch_px: f64,
    /// Time from one row to the next [s].
    pub line_s: f64,
}

impl Lens {
    /// One that leaves angles as they are, from the axis on.
    pub const ANGLES: Self = Self {
        focal_px: 1.0,
        centre_px: DVec2::ZERO,
        pitch_px: 0.0,
        line_s: 0.0,
    };
}

/// A wave of shift over the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ripple {
    /// Amplitude [px], right and down.
    pub shift_px: DVec2,
    /// Its phase's growth [rad/px], right and down.
    pub per_px: DVec2,
    /// Phase at the axis [rad], and its growth [rad/s].
    pub phase_rad: f64,
    pub rate_radps: f64,
}

/// The shift of the picture as a sum of waves over it.
#[derive(Clone, Debug, PartialEq)]
pub struct Ripples {
    pub(super) waves: Vec<Ripple>,
    lens: Lens,
    /// Variance about each axis, on the average over both, of the shifts that exposure and pitch average out: they blur [px²].
    pub blurred_px2: f64,
}

impl Ripples {
    /// Those of what lies at the range of `sight`.
    pub fn new(air: &FrozenAir, sight: &Sight, pupil: &Pupil, look: &Look, lens: &Lens) -> Self {
        let [right, down, ahead] = look.axes_enu;
        let mut waves = Vec::with_capacity(air.layers.iter().map(Vec::len).sum());
        let mut blurred_px2 = 0.0;
        let variance_rad2 = sight.tilt_variance_rad2(NOMINAL_M);
        let least_px2 = LEAST_SHARE * variance_rad2 * lens.focal_px.powi(2);
        for ((layer, slab), wind) in air.layers.iter().zip(&sight.slabs).zip(look.winds_enu_mps) {
            if slab.strength == 0.0 {
                continue;
            }
            let scale_px = slab.strength.sqrt() * slab.gamma * lens.focal_px;
            let swept_mps = wind - slab.z_m / sight.range_m * look.seen_enu_mps;
            let middle_m = slab.z_m * ahead - look.t_s * wind;
            for wave in layer {
                let k = wave.k_enu_radpm;
                let across = DVec2::new(k.dot(right), k.dot(down));
                let seen = pupil.average(slab.gamma * across.length());
                let whole_px = wave.amplitude_m * scale_px * seen * across;
                if whole_px.length_squared() < least_px2 {
                    continue;
                }
                let mean = sinc(0.5 * look.exposure_s * k.dot(swept_mps));
                let mut per_px = across * (slab.z_m / lens.focal_px);
                per_px.y -= lens.line_s * k.dot(wind);
                let (fine, kept) = resolved(per_px * lens.pitch_px);
                let shift_px = mean * fine * whole_px;
                let shows = shift_px.length_squared() >= least_px2;
                let shown = if shows { mean * mean * kept } else { 0.0 };
                blurred_px2 += 0.25 * whole_px.length_squared() * (1.0 - shown);
                if shows {
                    waves.push(Ripple {
                        shift_px,
                        per_px,
                        phase_rad: k.dot(middle_m) + wave.phase_rad,
                        rate_radps: -k.dot(wind),
                    });
                }
            }
        }
        Self {
            waves,
            lens: *lens,
            blurred_px2,
        }
    }

    /// By how much what belongs at a place of the picture [px] is shifted there [px].
    pub fn at(&self, place_px: DVec2) -> DVec2 {
        self.later(place_px, 0.0)
    }

    /// The same some time later [s].
    pub fn later(&self, place_px: DVec2, after_s: f64) -> DVec2 {
        let from_px = place_px - self.lens.centre_px;
        let waves = self.waves.iter();
        waves
            .map(|wave| {
                let phase_rad = wave.phase_rad + wave.rate_radps * after_s;
                wave.shift_px * (phase_rad + wave.per_px.dot(from_px)).sin()
            })
            .sum()
    }

    /// Mean square of the shift about each axis over all phases [px²].
    pub fn variance_px2(&self) -> DVec2 {
        let waves = self.waves.iter();
        waves.map(|wave| 0.5 * wave.shift_px * wave.shift_px).sum()
    }

    /// The lens that they are for.
    pub fn lens(&self) -> &Lens {
        &self.lens
    }
}

/// What a map of a pitch keeps of a wave whose phase grows so much over a pitch [rad]: the factor of its nodes, smoothed by a
/// Gaussian of half a pitch, and the mean square of what is interpolated linearly between them.
fn resolved(per_pitch: DVec2) -> (f64, f64) {
    // (2 + cos x)/3 is exp(-x²/6) up to x⁶, before which the smoothing leaves nothing.
    let root = (-per_pitch.length_squared() / 24.0).exp();
    (root.powi(3), root.powi(10))
}

/// sin(x)/x.
fn sinc(x: f64) -> f64 {
    if x.abs() < 1e-4 {
        1.0 - x * x / 6.0
    } else {
        x.sin() / x
    }
}
