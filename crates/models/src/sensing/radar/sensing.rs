//! Which plots a small scanning radar makes of what is about it.
//!
//! A thing's echo has the mean signal-to-noise ratio of the radar equation, S = S₀ (σ/σ₀) (R₀/R)⁴. It fluctuates from look to
//! look as Swerling's first case: the power in a cell, noise included, is exponential of mean 1 + S, so that it passes the
//! threshold −ln P_fa with the probability P_fa^(1/(1+S)) (M. A. Richards, "Fundamentals of Radar Signal Processing", 2nd ed. 2014,
//! sec. 6.3.3). What stands in the same cell of range, speed and beam adds up to one plot between its parts. The error of a
//! direction is its beam over 1.6 √(2 S), of a range its cell over √(2 S) (D. K. Barton, "Radar System Analysis and Modeling", 2005,
//! ch. 8), beside what the radar's alignment and calibration leave.

use super::{Plot, RadarErrors};
use crate::maths::kinematics::los_to_az_el;
use crate::maths::rng::Stream;
use crate::tracking::cartesian::LEAST_RANGE_M;
use crate::tracking::search::Sector;
use glam::{DVec2, DVec3};
use std::f64::consts::LN_2;

/// RCS for which a radar's range is stated [m²]: that of a small UAV, as makers state it.
pub const STATED_RCS_M2: f64 = 0.01;
/// Slope of a monopulse discriminator (Barton, as above).
const MONOPULSE_SLOPE: f64 = 1.6;

/// Something that sends the radar's wave back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Echo {
    /// Place relative to the radar [m, enu].
    pub r_enu_m: DVec3,
    /// Velocity [m/s, enu].
    pub v_enu_mps: DVec3,
    /// Mean radar cross-section [m²].
    pub rcs_m2: f64,
    /// Whether parts of it move so fast that it shows where the whole stands still.
    pub modulated: bool,
}

/// A scanning radar.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RadarParams {
    /// Standard deviations that a strong echo keeps.
    pub errors: RadarErrors,
    /// Range in which a small UAV ([`STATED_RCS_M2`]) is detected in half of the looks [m].
    pub half_range_m: f64,
    /// Farthest range [m].
    pub farthest_m: f64,
    /// Width of its beam, both axes [rad].
    pub beam_rad: f64,
    /// Its cells in range [m] and in speed along the line of sight [m/s].
    pub cell_m: f64,
    pub cell_mps: f64,
    /// Chance that noise alone passes the threshold in a cell.
    pub false_alarm: f64,
    /// What is slower along the line of sight, and has no fast parts, goes with the clutter of the ground [m/s].
    pub least_mps: f64,
    /// Fastest speed along the line of sight that it tells from a slower one [m/s].
    pub most_mps: f64,
    /// A plot with a greater apparent RCS is no small UAV's and is dropped [m²].
    pub most_rcs_m2: f64,
    /// Where it looks.
    pub field: Sector,
    /// How far its axes are turned against the station's, azimuth and elevation [rad].
    pub turned_rad: DVec2,
}

impl RadarParams {
    /// Power over that of the noise below which nothing is a detection.
    fn threshold(&self) -> f64 {
        -self.false_alarm.ln()
    }

    /// Mean signal-to-noise ratio of an RCS [m²] at a range [m].
    pub fn mean_snr(&self, rcs_m2: f64, range_m: f64) -> f64 {
        // In half of the looks where 1 + S is the threshold over ln 2.
        let at_half = self.threshold() / LN_2 - 1.0;
        at_half * (rcs_m2 / STATED_RCS_M2) * (self.half_range_m / range_m).powi(4)
    }

    /// RCS [m²] that an echo of so much power at a range [m] seems to come from.
    fn apparent_rcs_m2(&self, snr: f64, range_m: f64) -> f64 {
        STATED_RCS_M2 * snr / self.mean_snr(STATED_RCS_M2, range_m)
    }

    /// Chance that a look detects an RCS [m²] at a range [m].
    pub fn detection_chance(&self, rcs_m2: f64, range_m: f64) -> f64 {
        self.false_alarm
            .powf(1.0 / (1.0 + self.mean_snr(rcs_m2, range_m)))
    }

    /// Standard deviations of a plot of such a signal-to-noise ratio.
    fn errors_at(&self, snr: f64) -> RadarErrors {
        let root = (2.0 * snr).sqrt();
        let by_noise_rad = self.beam_rad / (MONOPULSE_SLOPE * root);
        RadarErrors {
            sigma_rad: self.errors.sigma_rad.hypot(by_noise_rad),
            range_sigma_m: self.errors.range_sigma_m.hypot(self.cell_m / root),
        }
    }

    /// False plots that noise alone makes in a look, as a mean.
    pub fn false_plots(&self) -> f64 {
        let directions = self.field.width_rad * self.field.height_rad / self.beam_rad.powi(2);
        let speeds = 2.0 * self.most_mps / self.cell_mps;
        self.false_alarm * directions * speeds * self.farthest_m / self.cell_m
    }

    /// The plots of one look at `t_s` [s] among `echoes` that nothing hides, in no order that tells whose they are.
    pub fn look(&self, t_s: f64, echoes: &[Echo], rng: &mut Stream) -> Vec<Plot> {
        let mut plots = Vec::new();
        for (r_enu_m, snr) in self.resolved(echoes) {
            let power = exponential(rng) * (1.0 + snr);
            let range_m = r_enu_m.length();
            if power > self.threshold() && self.apparent_rcs_m2(power, range_m) < self.most_rcs_m2 {
                plots.push(self.errors_at(power).plot(r_enu_m, t_s, rng));
            }
        }
        for _ in 0..rng.poisson(self.false_plots()) {
            let off = DVec2::new(rng.uniform() - 0.5, rng.uniform() - 0.5);
            plots.push(Plot {
                t_s,
                az_el_rad: DVec2::new(
                    self.field.centre_azimuth_rad + off.x * self.field.width_rad,
                    self.field.centre_elevation_rad + off.y * self.field.height_rad,
                ),
                range_m: rng.range(LEAST_RANGE_M, self.farthest_m),
                errors: self.errors_at(self.threshold() + exponential(rng)),
            });
        }
        for plot in &mut plots {
            plot.az_el_rad += self.turned_rad;
        }
        plots.sort_by(|a, b| a.range_m.total_cmp(&b.range_m));
        plots
    }

    /// Places [m] and mean signal-to-noise ratios of what the radar can tell apart: each echo, or those of one cell together.
    fn resolved(&self, echoes: &[Echo]) -> Vec<(DVec3, f64)> {
        let mut cells: Vec<Cell> = Vec::new();
        for echo in echoes {
            let range_m = echo.r_enu_m.length();
            let speed_mps = echo.v_enu_mps.dot(echo.r_enu_m) / range_m.max(LEAST_RANGE_M);
            let shows = echo.modulated || speed_mps.abs() >= self.least_mps;
            let within = (LEAST_RANGE_M..self.farthest_m).contains(&range_m)
                && self.field.contains(los_to_az_el(echo.r_enu_m));
            if !shows || !within {
                continue;
            }
            let snr = self.mean_snr(echo.rcs_m2, range_m);
            let shared = cells.iter_mut().find(|cell| {
                let [first_m, first_mps] = [cell.r_enu_m.length(), cell.speed_mps];
                (first_m - range_m).abs() < self.cell_m
                    && (first_mps - speed_mps).abs() < self.cell_mps
                    && cell.r_enu_m.angle_between(echo.r_enu_m) < self.beam_rad
            });
            match shared {
                Some(cell) => {
                    cell.weighted_enu_m += snr * echo.r_enu_m;
                    cell.snr += snr;
                }
                None => cells.push(Cell {
                    r_enu_m: echo.r_enu_m,
                    speed_mps,
                    weighted_enu_m: snr * echo.r_enu_m,
                    snr,
                }),
            }
        }
        let middle = |cell: Cell| (cell.weighted_enu_m / cell.snr, cell.snr);
        cells
            .into_iter()
            .filter(|cell| cell.snr > 0.0)
            .map(middle)
            .collect()
    }
}

/// Echoes that the radar cannot tell apart: the first's place [m] and speed [m/s], the sum of all.
struct Cell {
    r_enu_m: DVec3,
    speed_mps: f64,
    weighted_enu_m: DVec3,
    snr: f64,
}

/// An exponential number of mean 1.
fn exponential(rng: &mut Stream) -> f64 {
    -(1.0 - rng.uniform()).ln()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// A radar without errors of its own or false plots, which looks north.
    pub(in crate::sensing::radar) fn radar() -> RadarParams {
        RadarParams {
            errors: RadarErrors {
                sigma_rad: 0.0,
                range_sigma_m: 0.0,
            },
            half_range_m: 1500.0,
            farthest_m: 3000.0,
            beam_rad: 5f64.to_radians(),
            cell_m: 5.0,
            cell_mps: 1.0,
            false_alarm: 1e-7,
            least_mps: 1.0,
            most_mps: 30.0,
            most_rcs_m2: 1.0,
            field: Sector {
                centre_azimuth_rad: 0.0,
                centre_elevation_rad: 0.0,
                width_rad: 0.67 * PI,
                height_rad: 0.25 * PI,
            },
            turned_rad: DVec2::ZERO,
        }
    }

    pub(in crate::sensing::radar) fn uav(r_enu_m: DVec3) -> Echo {
        Echo {
            r_enu_m,
            v_enu_mps: DVec3::new(0.0, -5.0, 0.0),
            rcs_m2: STATED_RCS_M2,
            modulated: true,
        }
    }

    /// Share of looks with a plot near an echo.
    fn share(radar: &RadarParams, echo: Echo, looks: usize) -> f64 {
        let mut rng = Stream::new(3, 0, "test");
        let near = |plot: &Plot| (plot.range_m - echo.r_enu_m.length()).abs() < 20.0;
        let seen = (0..looks).filter(|_| radar.look(0.0, &[echo], &mut rng).iter().any(near));
        seen.count() as f64 / looks as f64
    }

    #[test]
    fn a_small_uav_is_detected_as_richards_has_it() {
        let radar = radar();
        assert!((radar.detection_chance(STATED_RCS_M2, 1500.0) - 0.5).abs() < 1e-12);
        for range_m in [800.0, 1500.0, 2200.0] {
            let n = 4000;
            let expected = radar.detection_chance(STATED_RCS_M2, range_m);
            let found = share(&radar, uav(DVec3::new(0.0, range_m, 0.0)), n);
            // Five standard errors of a share.
            let bound = 5.0 * (expected * (1.0 - expected) / n as f64).sqrt();
            assert!(
                (found - expected).abs() < bound,
                "{range_m}: {found} {expected}"
            );
        }
    }

    #[test]
    fn what_stands_still_without_fast_parts_goes_with_the_clutter_and_what_is_large_is_dropped() {
        let near = DVec3::new(0.0, 300.0, 0.0);
        let still = Echo {
            v_enu_mps: DVec3::ZERO,
            modulated: false,
            ..uav(near)
        };
        // Noise alone is near by chance.
        assert!(share(&radar(), still, 200) < 0.03);
        let hovering = Echo {
            v_enu_mps: DVec3::ZERO,
            ..uav(near)
        };
        assert!(share(&radar(), hovering, 200) > 0.9);
        let airliner = Echo {
            rcs_m2: 40.0,
            ..uav(near)
        };
        // An exponential of mean 40 is below 1 in 2.5 % of the looks.
        assert!(share(&radar(), airliner, 400) < 0.06);
        let behind = uav(DVec3::new(0.0, -300.0, 0.0));
        assert!(share(&radar(), behind, 200) < 0.03);
    }

    #[test]
    fn two_in_one_cell_are_one_plot_between_them_and_a_beam_apart_two() {
        let mut rng = Stream::new(4, 0, "test");
        let pair = |apart_m: f64| {
            [
                uav(DVec3::new(0.0, 400.0, 0.0)),
                uav(DVec3::new(apart_m, 400.0, 0.0)),
            ]
        };
        let quiet = RadarParams {
            false_alarm: 1e-12,
            ..radar()
        };
        let mut counts = |apart_m: f64| {
            let looks = (0..200).map(|_| quiet.look(0.0, &pair(apart_m), &mut rng).len());
            looks.sum::<usize>() as f64 / 200.0
        };
        assert!(counts(20.0) <= 1.0);
        assert!(counts(80.0) > 1.7);
    }

    #[test]
    fn false_plots_come_as_often_as_the_cells_have_it() {
        let radar = radar();
        let mut rng = Stream::new(5, 0, "test");
        let n = 2000;
        let found: usize = (0..n).map(|_| radar.look(0.0, &[], &mut rng).len()).sum();
        let mean = radar.false_plots();
        // Five standard errors of a Poisson mean.
        let bound = 5.0 * (mean / n as f64).sqrt();
        assert!(
            (found as f64 / n as f64 - mean).abs() < bound,
            "{found} {mean}"
        );
    }

    #[test]
    fn weak_echoes_have_the_errors_they_state() {
        let radar = radar();
        let mut rng = Stream::new(6, 0, "test");
        let r_enu_m = DVec3::new(0.0, 1400.0, 0.0);
        let (mut sum, mut n) = (0.0, 0.0);
        for _ in 0..6000 {
            let plots = radar.look(0.0, &[uav(r_enu_m)], &mut rng);
            // Six deviations of the weakest.
            for plot in plots
                .iter()
                .filter(|plot| (plot.range_m - 1400.0).abs() < 6.0)
            {
                let off = plot.az_el_rad / plot.errors.sigma_rad;
                if off.length() < 8.0 {
                    sum += off.length_squared() / 2.0;
                    n += 1.0;
                }
            }
        }
        assert!(n > 1000.0);
        // Five standard errors of a variance over two axes.
        assert!((sum / n - 1.0).abs() < 5.0 / n.sqrt(), "{}", sum / n);
    }
}
