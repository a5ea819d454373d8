//! `scaling` against `wave` over range, Cn², aperture and wind, with blooming.

use crate::check::Fault;
use boresight_common::parallel::in_parallel;
use boresight_models::air::atmosphere::Cn2Profile;
use boresight_models::air::turbulence::{AirPath, PathTurbulence};
use boresight_models::laser::beam::{BloomingAir, Laser};
use boresight_models::laser::propagation::{
    BeamAir, PROPAGATIONS, PropagationContext, Sent, WaveSettings,
};
use boresight_wave::even_layers;
use glam::DVec2;
use serde::Serialize;

/// Greatest D/r0 that counts as weak.
const WEAK_D_OVER_R0: f64 = 2.0;
/// What is wanted where turbulence is weak, and where it is strong.
const WANTED: [f64; 2] = [0.10, 0.25];
/// Ticks a second: in one the wind carries the air by less than the beam's radius.
const TICK_HZ: u32 = 240; // [Hz]
/// Power that warms the air [W].
const POWER_W: f64 = 3000.0; // [W]

/// A beam and its path.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Case {
    /// Range and focal distance \[m\].
    pub range_m: f64,
    /// Cn² along the path \[m^-2/3\].
    pub cn2: f64,
    /// 1/e² radius at the exit \[m\].
    pub w0_m: f64,
    /// Wind across the beam \[m/s\].
    pub wind_mps: f64,
}

/// What two propagations make of a case: means over time.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Compared {
    /// The beam and its path.
    pub case: Case,
    /// The exit's diameter over Fried's parameter.
    pub d_over_r0: f64,
    /// Gebhardt's distortion number.
    pub distortion: f64,
    /// Mean irradiance on the axis of `scaling` over that of `wave`, less 1.
    pub peak: f64,
    /// Mean power within the long-term radius of theory, likewise.
    pub power: f64,
    /// What is wanted of both.
    pub wanted: f64,
}

impl Compared {
    /// Whether both are as wanted.
    pub fn met(&self) -> bool {
        self.peak.abs() <= self.wanted && self.power.abs() <= self.wanted
    }
}

/// Range × Cn² × aperture × wind.
pub fn cases() -> Vec<Case> {
    let mut all = Vec::new();
    for range_m in [600.0, 1200.0] {
        for cn2 in [2e-15, 1e-14, 5e-14] {
            for w0_m in [0.03, 0.06] {
                for wind_mps in [2.0, 6.0] {
                    all.push(Case {
                        range_m,
                        cn2,
                        w0_m,
                        wind_mps,
                    });
                }
            }
        }
    }
    all
}

impl Case {
    fn laser(&self) -> Laser {
        Laser {
            power_w: POWER_W,
            wavelength_m: 1.064e-6,
            aperture_radius_m: self.w0_m,
            m2: 1.0,
        }
    }

    fn air(&self, outer_m: f64) -> BeamAir {
        let path = AirPath {
            length_m: self.range_m,
            h0_m: 30.0,
            h1_m: 30.0,
        };
        let profile = Cn2Profile::Constant(self.cn2);
        BeamAir {
            turbulence: PathTurbulence::new(&profile, &path, 1.064e-6, outer_m),
            layers: even_layers(self.range_m, 10, |_| (self.cn2, [self.wind_mps, 0.0])),
            warmed: BloomingAir {
                absorption_per_m: 1e-5,
                extinction_per_m: 1e-4,
                temperature_k: 290.0,
                crosswind_mps: self.wind_mps,
                slew_radps: 0.0,
            },
        }
    }

    /// Mean irradiance on the axis [W/m²] and mean power within the long-term radius of theory [W] of a propagation, over
    /// `ticks` ticks of each of `runs` runs, after the air has been warmed.
    fn means(&self, name: &str, runs: u64, ticks: u32) -> Result<[f64; 2], Fault> {
        const OUTER_M: f64 = 20.0; // [m]
        let known = PROPAGATIONS.iter().find(|(known, _)| *known == name);
        let (_, make) = known.ok_or(Fault::Nothing("PROPAGATIONS"))?;
        let (laser, air) = (self.laser(), self.air(OUTER_M));
        // The beam's diameter passes four times before the first tick that counts.
        let warming = (8.0 * self.w0_m / self.wind_mps * f64::from(TICK_HZ)).ceil() as u32;
        let mut sums = [0.0; 2];
        for seed in 0..runs {
            let mut propagation = make(&PropagationContext {
                seed,
                station: 0,
                tick_hz: TICK_HZ,
                scales_m: [OUTER_M, 0.0],
                paper: [0.0, 0.1],
                wave: WaveSettings {
                    rate_hz: TICK_HZ,
                    clear_ratio: 1e3,
                },
            })?;
            for tick in 0..warming + ticks {
                let sent = Sent {
                    laser: &laser,
                    fires: true,
                    range_m: self.range_m,
                    focus_m: self.range_m,
                    air: &air,
                    is_new: tick == 0,
                    turned: None,
                    dt_s: 1.0 / f64::from(TICK_HZ),
                };
                let across = propagation.cross(&sent)?;
                if tick >= warming {
                    let long_m = sent.expected().long_m;
                    sums[0] += across.at_wpm2(DVec2::ZERO);
                    sums[1] += across.power_in_bucket_w(DVec2::ZERO, long_m);
                }
            }
        }
        Ok(sums.map(|sum| sum / (runs as f64 * f64::from(ticks))))
    }

    /// Both propagations of this case; `wave` over `runs` runs of `ticks` ticks.
    fn compared(&self, runs: u64, ticks: u32) -> Result<Compared, Fault> {
        let wave = self.means("wave", runs, ticks)?;
        let scaling = self.means("scaling", 200, 400)?;
        let air = self.air(20.0);
        let d_over_r0 = 2.0 * self.w0_m / air.turbulence.fried_spherical_m;
        let weak = d_over_r0 <= WEAK_D_OVER_R0;
        Ok(Compared {
            case: *self,
            d_over_r0,
            distortion: (self.laser()).distortion_number(self.range_m, self.range_m, &air.warmed),
            peak: scaling[0] / wave[0] - 1.0,
            power: scaling[1] / wave[1] - 1.0,
            wanted: WANTED[usize::from(!weak)],
        })
    }
}

/// `scaling` against `wave` for each case, on so many threads.
///
/// # Errors
/// A path that no grid of `wave` holds.
pub fn compare(cases: &[Case], threads: usize) -> Result<Vec<Compared>, Fault> {
    in_parallel(cases, threads, |case| case.compared(6, 160))
}
