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
    /// What arrived last; none where the laser did not emit.
    spot: Option<Arc<Spot>>,
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

    /// Takes out the path's screens: those of before where they hold this beam too, or else new ones.
    fn take_path(
        &mut self,
        sent: &Sent,
        aperture: &Aperture,
    ) -> Result<Path, Box<dyn Error + Send + Sync>> {
        let layers = &sent.air.layers;
        let holds = |path: &Path| {
            Sampling::of(path.wave.grid(), aperture, layers, sent.range_m)
                .check()
                .is_ok()
        };
        let mut path = match self.path.take().filter(holds) {
            Some(path) => path,
            None => {
                let grid = Sampling::grid(aperture, layers, sent.range_m).map_err(|error| {
                    format!(
                        "turbulence.propagation: no grid of 'wave' holds the beam to {:.0} m ({error}); \
                         take 'scaling', or a path that is longer or less turbulent",
                        sent.range_m
                    )
                })?;
                let rng = &mut self.rng;
                let mut normal = || rng.normal();
                let (layers, length_m) = (layers.clone(), sent.range_m);
                Path {
                    wave: Wave::new(grid, &self.spectrum, layers, length_m, 1, &mut normal),
                    spot: None,
                }
            }
        };
        if path.wave.layers() != layers {
            path.wave.retune(layers.clone(), sent.range_m);
        }
        Ok(path)
    }
}

impl Propagation for WavePropagation {
    fn cross(&mut self, sent: &Sent) -> Result<Across, Box<dyn Error + Send + Sync>> {
        let air = absorbing(sent);
        let fired = self.path.as_ref().is_some_and(|path| path.spot.is_some());
        let is_due = self.ticks.is_multiple_of(self.every) || fired != sent.fires;
        let dt_s = f64::from(self.ticks) * sent.dt_s;
        self.ticks = if is_due { 1 } else { self.ticks + 1 };
        if !sent.fires {
            // A beam that is off costs no propagation: its spot is theory's, and the air goes on.
            if let Some(path) = self.path.as_mut().filter(|_| is_due) {
                let rng = &mut self.rng;
                path.wave.carry(dt_s, &mut || rng.normal());
                path.wave.rest(&air, dt_s);
                path.spot = None;
            }
            let expected = sent.expected();
            return Ok(Across {
                power_w: expected.power_w,
                centre_m: DVec2::ZERO,
                relative: 1.0,
                shape: Shape::Gaussian {
                    radius_m: expected.short_m,
                },
            });
        }
        let aperture = self.aperture(sent);
        let mut path = self.take_path(sent, &aperture)?;
        let spot = match path.spot.take().filter(|_| !is_due) {
            Some(spot) => spot,
            None => {
                let rng = &mut self.rng;
                path.wave.carry(dt_s, &mut || rng.normal());
                let extinction_pm = sent.air.warmed.extinction_per_m;
                Arc::new(path.wave.heat(&aperture, extinction_pm, &air, dt_s))
            }
        };
        path.spot = Some(spot.clone());
        self.path = Some(path);
        let w_m = sent.laser.spot_radius_m(sent.range_m, sent.focus_m);
        let arrives_w = sent.expected().power_w;
        Ok(Across {
            power_w: spot.power_w(),
            centre_m: DVec2::from(spot.centroid_m()),
            relative: spot.peak_wpm2() / peak_irradiance_wpm2(arrives_w, w_m),
            shape: Shape::Map(spot),
        })
    }

    fn boxed(&self) -> Box<dyn Propagation> {
        Box::new(self.clone())
    }
}

/// The air of a path as it takes up heat.
fn absorbing(sent: &Sent) -> Absorbing {
    let warmed = &sent.air.warmed;
    Absorbing {
        absorption_pm: warmed.absorption_per_m,
        temperature_k: warmed.temperature_k,
        pressure_pa: PRESSURE_PA,
        refractivity: refractivity(sent.laser.wavelength_m, warmed.temperature_k),
    }
}
