//! `wave`: the wave itself, through screens that the wind carries.

use super::crossing::{Across, Propagation, PropagationContext, Sent, Shape, WaveSettings};
use crate::laser::beam::{PRESSURE_PA, peak_irradiance_wpm2, refractivity};
use crate::maths::rng::Stream;
use boresight_wave::{Absorbing, Aperture, Sampling, Spot, VonKarman, Wave};
use glam::DVec2;
use std::error::Error;
use std::sync::Arc;

/// A path's screens and the spot that its beam made last.
#[derive(Clone, Debug)]
pub struct WavePropagation {
    settings: WaveSettings,
    spectrum: VonKarman,
    /// Ticks between two spots.
    every: u32,
    /// Ticks since the last spot.
    ticks: u32,
    rng: Stream,
    path: Option<Path>,
}

#[derive(Clone, Debug)]
struct Path {
    wave: Wave,
    /// What arrived last; none where the laser did not emit, which costs no propagation.
    spot: Option<Arc<Spot>>,
    /// Peak without turbulence and blooming [W/m²].
    still_wpm2: f64,
}

impl WavePropagation {
    /// One without a path.
    ///
    /// # Errors
    /// Its rate is no divisor of the tick rate.
    pub fn new(context: &PropagationContext) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let settings = context.wave;
        if settings.rate_hz == 0 || !context.tick_hz.is_multiple_of(settings.rate_hz) {
            let told = format!(
                "turbulence.wave.rate_hz of {} does not divide the tick rate of {} Hz; give 60, 120 or 240",
                settings.rate_hz, context.tick_hz
            );
            return Err(told.into());
        }
        let [outer_m, inner_m] = context.scales_m;
        Ok(Self {
            settings,
            spectrum: VonKarman { outer_m, inner_m },
            every: context.tick_hz / settings.rate_hz,
            ticks: 0,
            rng: context.stream("screens"),
            path: None,
        })
    }

    fn aperture(&self, sent: &Sent) -> Aperture {
        Aperture {
            power_w: sent.laser.power_w,
            radius_m: sent.laser.aperture_radius_m,
            clear_radius_m: self.settings.clear_ratio * sent.laser.aperture_radius_m,
            wavelength_m: sent.laser.wavelength_m,
            m2: sent.laser.m2,
            focus_m: sent.focus_m,
        }
    }
}

impl Propagation for WavePropagation {
    fn cross(&mut self, sent: &Sent) -> Result<Across, Box<dyn Error + Send + Sync>> {
        let aperture = self.aperture(sent);
        let layers = &sent.air.layers;
        let rng = &mut self.rng;
        let mut normal = || rng.normal();
        // What the samples of one path hold, those of another may not.
        let grid = match &self.path {
            Some(path)
                if Sampling::of(path.wave.grid(), &aperture, layers, sent.range_m)
                    .check()
                    .is_ok() =>
            {
                path.wave.grid()
            }
            _ => {
                self.path = None;
                Sampling::grid(&aperture, layers, sent.range_m)?
            }
        };
        let fired = (self.path.as_ref()).is_some_and(|path| path.spot.is_some());
        let is_due =
            self.ticks.is_multiple_of(self.every) || self.path.is_none() || fired != sent.fires;
        let dt_s = f64::from(self.ticks) * sent.dt_s;
        self.ticks = if is_due { 1 } else { self.ticks + 1 };
        let extinction_pm = sent.air.warmed.extinction_per_m;
        let path = match &mut self.path {
            Some(path) => {
                if sent.is_new {
                    path.wave.retune(layers.clone(), sent.range_m);
                }
                path
            }
            none => {
                let wave = Wave::new(
                    grid,
                    &self.spectrum,
                    layers.clone(),
                    sent.range_m,
                    1,
                    &mut normal,
                );
                none.insert(Path {
                    wave,
                    spot: None,
                    still_wpm2: 1.0,
                })
            }
        };
        let expected = sent.expected();
        if is_due {
            path.wave.carry(dt_s, &mut normal);
            let warmed = &sent.air.warmed;
            let air = Absorbing {
                absorption_pm: warmed.absorption_per_m,
                temperature_k: warmed.temperature_k,
                pressure_pa: PRESSURE_PA,
                refractivity: refractivity(sent.laser.wavelength_m, warmed.temperature_k),
            };
            path.spot = match sent.fires {
                true => Some(Arc::new(path.wave.heat(
                    &aperture,
                    extinction_pm,
                    &air,
                    dt_s,
                ))),
                false => {
                    path.wave.rest(&air, dt_s);
                    None
                }
            };
            let w_m = sent.laser.spot_radius_m(sent.range_m, sent.focus_m);
            path.still_wpm2 = peak_irradiance_wpm2(expected.power_w, w_m);
        }
        Ok(match &path.spot {
            Some(spot) => Across {
                power_w: spot.power_w(),
                centre_m: DVec2::from(spot.centroid_m()),
                relative: spot.peak_wpm2() / path.still_wpm2,
                shape: Shape::Map(spot.clone()),
            },
            None => Across {
                power_w: expected.power_w,
                centre_m: DVec2::ZERO,
                relative: 1.0,
                shape: Shape::Gaussian {
                    radius_m: expected.short_m,
                },
            },
        })
    }

    fn boxed(&self) -> Box<dyn Propagation> {
        Box::new(self.clone())
    }
}
