//! How much the box of a track flutters: the noise of its place and size, measured from the box itself.
//!
//! A detector's error depends on what it sees. A box that clings now to a bird's wing, now to its body,
//! errs by many times the noise that one number for all boxes allows for, and a filter that does not know
//! it breaks the track. The second difference of three successive places tells noise from flight: white
//! noise of variance σ² gives it 6σ² at equal steps, while an acceleration of 20 m/s² at 400 m moves it by
//! 14 µrad in a sixtieth of a second, a sixth of a pixel of the default coarse camera. The estimate is the mean of an
//! inverse-gamma posterior: it starts at what the camera's specification says and moves with the evidence.

use glam::DVec2;

use crate::maths::kinematics::wrap_pi;

/// Weight of the specification, in sightings.
const PRIOR: f64 = 6.0;
/// Memory [s]: some beats of a gull's wings (three a second).
const MEMORY_S: f64 = 0.7;
/// Sightings further apart than this do not tell flight from noise [s].
const LONGEST_STEP_S: f64 = 0.12;
/// Most that one sighting counts, in variances: an exchange of identities is not noise.
const MOST: f64 = 36.0;
/// Relative error of a box's side that does not shrink with the box.
const SIZE_SIGMA: f64 = 0.04;

/// A sighting as its noise is judged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Time of the exposure [s].
    pub t_s: f64,
    /// Azimuth and elevation [rad].
    pub az_el_rad: DVec2,
    /// Standard deviation by the camera's specification [rad].
    pub sigma_rad: f64,
    /// Larger side of the box [rad].
    pub size_rad: f64,
}

impl Place {
    /// Standard deviation of the size's logarithm that a rigid body's box has.
    fn size_sigma(&self) -> f64 {
        SIZE_SIGMA.hypot(self.sigma_rad / self.size_rad)
    }
}

/// Variance over its specified value.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Excess {
    weight: f64,
    sum: f64,
}

impl Excess {
    fn take(&mut self, squares: f64, step_s: f64) {
        let kept = (-step_s / MEMORY_S).exp();
        self.weight = kept * self.weight + 1.0;
        self.sum = kept * self.sum + squares.min(MOST);
    }

    /// Standard deviation over its specified value.
    fn ratio(&self) -> f64 {
        ((PRIOR + self.sum) / (PRIOR + self.weight)).sqrt()
    }
}

/// The flutter of a track's box in one camera.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Flutter {
    /// The last two sightings, older first.
    before: [Option<Place>; 2],
    place: Excess,
    size: Excess,
}

impl Flutter {
    /// Takes a sighting in. One that is not newer than the last tells nothing.
    pub fn on_sighting(&mut self, now: Place) {
        let [older, newer] = self.before;
        let step_s = newer.map_or(f64::INFINITY, |newer| now.t_s - newer.t_s);
        if step_s <= 0.0 {
            return;
        }
        self.before = [newer, Some(now)];
        let Some(newer) = newer.filter(|_| step_s <= LONGEST_STEP_S) else {
            return;
        };
        let change = (now.size_rad / newer.size_rad).ln();
        let expected = now.size_sigma().powi(2) + newer.size_sigma().powi(2);
        self.size.take(change * change / expected, step_s);
        let Some(older) = older.filter(|older| newer.t_s - older.t_s <= LONGEST_STEP_S) else {
            return;
        };
        let share = step_s / (newer.t_s - older.t_s);
        let cos_el = now.az_el_rad.y.cos();
        let moved =
            |from: DVec2, to: DVec2| DVec2::new(wrap_pi(to.x - from.x) * cos_el, to.y - from.y);
        let bend =
            moved(newer.az_el_rad, now.az_el_rad) - share * moved(older.az_el_rad, newer.az_el_rad);
        let variance = now.sigma_rad.powi(2)
            + ((1.0 + share) * newer.sigma_rad).powi(2)
            + (share * older.sigma_rad).powi(2);
        self.place
            .take(0.5 * bend.length_squared() / variance, step_s);
    }

    /// Standard deviation of its places over the specified one; never below 1: the pointing errs, too.
    pub fn place_ratio(&self) -> f64 {
        self.place.ratio().max(1.0)
    }

    /// Standard deviation of its size's logarithm over that of a rigid body's box.
    pub fn size_ratio(&self) -> f64 {
        self.size.ratio()
    }

    /// Either of the two, whichever is larger.
    pub fn ratio(&self) -> f64 {
        self.place.ratio().max(self.size.ratio())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths::rng::Stream;

    /// Ratios of a box seen for two seconds at 60 Hz with so much noise of place and size.
    fn ratios(place: f64, size: f64, accel_radps2: f64) -> [f64; 2] {
        let mut rng = Stream::new(1, 0, "test");
        let mut flutter = Flutter::default();
        for i in 0..120 {
            let t_s = f64::from(i) / 60.0;
            let sigma_rad = 4e-5;
            let at = 0.01 * t_s + 0.5 * accel_radps2 * t_s * t_s;
            let noise = DVec2::new(rng.normal(), rng.normal());
            flutter.on_sighting(Place {
                t_s,
                az_el_rad: DVec2::new(at, 0.1) + place * sigma_rad * noise,
                sigma_rad,
                size_rad: 1e-3 * (size * SIZE_SIGMA.hypot(0.04) * rng.normal()).exp(),
            });
        }
        [flutter.place_ratio(), flutter.size_ratio()]
    }

    #[test]
    fn noise_is_measured_and_flight_is_none() {
        let [place, size] = ratios(1.0, 1.0, 0.0);
        assert!((1.0..1.2).contains(&place) && (0.8..1.2).contains(&size));
        let [place, size] = ratios(4.0, 4.0, 0.0);
        assert!(
            (2.5..5.0).contains(&place) && (2.5..5.0).contains(&size),
            "{place} {size}"
        );
        // 20 m/s² at 400 m.
        let [place, _] = ratios(1.0, 1.0, 0.05);
        assert!((1.0..1.2).contains(&place), "{place}");
    }

    #[test]
    fn one_jump_is_no_flutter() {
        let mut flutter = Flutter::default();
        for i in 0..60 {
            let jumped = if i < 30 { 0.0 } else { 2e-3 };
            flutter.on_sighting(Place {
                t_s: f64::from(i) / 60.0,
                az_el_rad: DVec2::new(jumped, 0.0),
                sigma_rad: 4e-5,
                size_rad: 1e-3,
            });
        }
        assert!(flutter.place_ratio() < 2.0, "{}", flutter.place_ratio());
    }
}
