//! Light of lasers and lamps in the exposures: which sources are on, and how a camera sees them.

use crate::components::beam::{BeamState, FireCommand, LaserPauses, LaserSource};
use crate::components::capture::{
    AutoExposure, Lamps, LaserGate, Readout, SensorCamera, StationCameras, StrayOptics,
};
use crate::components::environment::Environment;
use crate::components::flight::{Flight, HeatedSkin, Uav};
use crate::components::mount::{Optics, Station};
use crate::components::run::SimClock;
use crate::models::air::atmosphere::transmittance;
use crate::models::ground::dsm::LineOfSight;
use crate::models::laser::beam::Laser;
use crate::models::maths::kinematics::Pose;
use crate::models::optics::stray::beam::{BeamLight, BeamSight};
use crate::models::optics::stray::glint::{MASONRY, Reflecting, facing};
use crate::models::optics::stray::lamp::LampLight;
use crate::models::optics::stray::light::{PointLight, SeenBeam, StrayLight};
use crate::models::optics::stray::response::kcd_per_w;
use crate::models::optics::stray::scatter::ScatteringAir;
use bevy::ecs::system::SystemParam;
use bevy::prelude::*;
use glam::DVec3;
use std::sync::Arc;

/// Range at which a beam that meets nothing ends [m]: what is farther is a hundredth of a pixel wide.
const FAR_M: f64 = 5_000.0;
/// Light below this share of a full well in every pixel is left out: half of the read noise of the presets' cameras.
const LEAST_SHARE: f64 = 1e-4;
/// A beam that could bring no more than this share of that is not looked at.
const FAINT_SHARE: f64 = 0.1;
/// Wavelength at which the air dims white light [m].
const WHITE_M: f64 = 555e-9;

/// All that may shine.
#[derive(SystemParam)]
pub struct Sources<'w, 's> {
    lamps: Res<'w, Lamps>,
    stations: Query<
        'w,
        's,
        (
            Entity,
            &'static Station,
            &'static Optics,
            &'static LaserSource,
            &'static FireCommand,
            &'static BeamState,
        ),
    >,
    flying: Query<'w, 's, (&'static Uav, &'static Flight, Option<&'static HeatedSkin>)>,
}

/// A spot of a beam on something.
struct Spot {
    /// Where it is [m].
    r_enu_m: DVec3,
    /// Power on it [W].
    power_w: f64,
    /// Its 1/e² radius [m].
    radius_m: f64,
    /// What it lies on, and that surface's normal.
    surface: Reflecting,
    normal_enu: DVec3,
}

/// A beam that is on.
struct Beam {
    station: Entity,
    /// Where it leaves, and along what.
    pose: Pose,
    laser: Laser,
    focus_m: f64,
    /// Range at which it ends [m].
    end_m: f64,
    air: ScatteringAir,
    spot: Option<Spot>,
}

impl Beam {
    fn axis_enu(&self) -> DVec3 {
        self.pose.q_enu_cam * DVec3::Z
    }
}

/// A lamp that is on.
struct Shining {
    r_enu_m: DVec3,
    /// Where it is pointed at [m].
    at_enu_m: DVec3,
    /// Its number.
    lamp: usize,
}

/// The sources that are on in a tick.
pub(super) struct Lit<'a> {
    beams: Vec<Beam>,
    shining: Vec<Shining>,
    lamps: &'a Lamps,
}

impl Sources<'_, '_> {
    /// What is on now.
    pub(super) fn lit(&self, clock: &SimClock, environment: &Environment) -> Lit<'_> {
        let mut beams: Vec<(usize, Beam)> = Vec::new();
        for (entity, station, optics, source, command, state) in &self.stations {
            if state.firing && source.laser.power_w > 0.0 {
                let beam = self.beam(environment, (entity, optics, source, command, state));
                beams.push((station.index, beam));
            }
        }
        beams.sort_by_key(|(index, _)| *index);
        Lit {
            beams: beams.into_iter().map(|(_, beam)| beam).collect(),
            shining: self.shining(clock.t_s()),
            lamps: &self.lamps,
        }
    }

    /// The beam of a station, up to what it meets.
    fn beam(
        &self,
        environment: &Environment,
        (station, optics, source, command, state): (
            Entity,
            &Optics,
            &LaserSource,
            &FireCommand,
            &BeamState,
        ),
    ) -> Beam {
        let pose = optics.laser;
        let axis_enu = pose.q_enu_cam * DVec3::Z;
        let laser = source.laser;
        let followed_m = (command.focus_range_m > 0.0).then_some(command.focus_range_m);
        let focus_m = source.focus_m.or(followed_m).unwrap_or(f64::INFINITY);
        let air = air_for(environment, laser.wavelength_m);
        let on_uav = self.spot_on_uav(&pose, state);
        let dsm = &environment.city.dsm;
        let spot = on_uav.or_else(|| {
            let range_m = dsm.first_hit(pose.r_enu_m, axis_enu, FAR_M)?;
            Some(Spot {
                r_enu_m: pose.r_enu_m + range_m * axis_enu,
                power_w: laser.power_w * transmittance(air.extinction_per_m, range_m),
                radius_m: laser.spot_radius_m(range_m, focus_m),
                surface: MASONRY,
                normal_enu: -axis_enu,
            })
        });
        let met_m = spot
            .as_ref()
            .map_or(FAR_M, |spot| spot.r_enu_m.distance(pose.r_enu_m));
        // In closed cloud nothing of it is seen from below.
        let cloud_m = (environment.weather.ceiling_m())
            .filter(|_| axis_enu.z > 0.0)
            .map_or(FAR_M, |base_m| {
                (base_m - pose.r_enu_m.z).max(0.0) / axis_enu.z
            });
        let end_m = met_m.min(cloud_m);
        Beam {
            station,
            pose,
            laser,
            focus_m,
            end_m,
            air,
            spot: spot.filter(|_| end_m == met_m),
        }
    }

    /// The spot on the aimed UAV, where the beam's centre lies on its body.
    fn spot_on_uav(&self, laser: &Pose, state: &BeamState) -> Option<Spot> {
        let aimed = state.aimed.filter(|_| state.power_at_target_w > 0.0)?;
        let (uav, flight, skin) = self.flying.iter().find(|(uav, ..)| uav.index == aimed)?;
        // The body about the aim point is at least as wide as it is high.
        let half_m = 0.5 * uav.size_m[2];
        if state.offset_m > half_m {
            return None;
        }
        let patch = skin?.patches.last()?;
        let absorptivity = patch.grid.middle_absorptivity();
        let r_enu_m = flight.aim_enu_m();
        let q = flight.state.q_enu_body;
        let to_laser = (laser.r_enu_m - r_enu_m).normalize_or_zero();
        Some(Spot {
            r_enu_m,
            power_w: state.power_at_target_w,
            radius_m: state.spot_radius_m.min(half_m),
            surface: Reflecting::of_absorptivity(absorptivity),
            normal_enu: facing([q * DVec3::X, q * DVec3::Y, q * DVec3::Z], to_laser),
        })
    }

    /// The lamps that are on.
    fn shining(&self, t_s: f64) -> Vec<Shining> {
        let lamps = self.lamps.0.iter().enumerate();
        lamps
            .filter(|(_, lamp)| (lamp.lit_s[0]..=lamp.lit_s[1]).contains(&t_s))
            .filter_map(|(number, lamp)| {
                let r_enu_m = match lamp.on {
                    None => lamp.r_enu_m,
                    Some(index) => {
                        let (_, flight, _) =
                            self.flying.iter().find(|(uav, ..)| uav.index == index)?;
                        flight.state.r_enu_m
                    }
                };
                let mut stations = self.stations.iter();
                let (_, _, optics, ..) = stations.find(|(_, at, ..)| at.index == lamp.at)?;
                Some(Shining {
                    r_enu_m,
                    at_enu_m: optics.laser.r_enu_m,
                    lamp: number,
                })
            })
            .collect()
    }
}

/// The air for light of a wavelength [m].
fn air_for(environment: &Environment, wavelength_m: f64) -> ScatteringAir {
    let weather = &environment.weather;
    let parts = [
        weather.aerosol_extinction_per_m(wavelength_m),
        weather.extinction_per_m(wavelength_m),
    ];
    ScatteringAir::new(weather.visibility_m, wavelength_m, parts)
}

impl Lit<'_> {
    /// Whether a camera takes no frame because its station's laser fires.
    pub(super) fn blanks(&self, station: Entity, stray: &StrayOptics) -> bool {
        stray.gate == LaserGate::Blank && self.beams.iter().any(|beam| beam.station == station)
    }

    /// What a camera sees of it; none where that is nothing.
    pub(super) fn seen(
        &self,
        station: Entity,
        (camera, stray): (&SensorCamera, &StrayOptics),
        environment: &Environment,
        pose: &Pose,
    ) -> Option<Arc<StrayLight>> {
        if self.beams.is_empty() && self.shining.is_empty() {
            return None;
        }
        let params = camera.sensor.params();
        let eye = Eye {
            camera,
            stray,
            environment,
            pose,
        };
        // A laser that pauses for this camera is off while it exposes.
        let is_out = |beam: &&Beam| beam.station != station || stray.gate != LaserGate::Pause;
        let beams: Vec<&Beam> = self.beams.iter().filter(is_out).collect();
        // At the longest exposure without gain; what gain would show lies below the noise.
        let white_kcd_m2 = params.saturation_kcd_s_m2() / camera.control.time_s[1];
        let least_kcd_m2 = LEAST_SHARE * white_kcd_m2;
        let light = StrayLight {
            focal_px: camera.pinhole.focal_px,
            centre_px: camera.pinhole.centre_px().to_array(),
            blur_px: params.blur_sigma_px,
            glare: params.glare,
            least_kcd_m2,
            beams: (beams.iter())
                .filter_map(|beam| eye.beam(beam, station, FAINT_SHARE * least_kcd_m2))
                .collect(),
            points: (beams.iter().filter_map(|beam| eye.glint(beam)))
                .chain((self.shining.iter()).filter_map(|lamp| eye.lamp(lamp, self.lamps)))
                .collect(),
        };
        light.shows().then(|| Arc::new(light))
    }
}

/// A camera that looks.
struct Eye<'a> {
    camera: &'a SensorCamera,
    stray: &'a StrayOptics,
    environment: &'a Environment,
    pose: &'a Pose,
}

impl Eye<'_> {
    fn to_cam(&self, v_enu: DVec3) -> DVec3 {
        self.pose.q_enu_cam.inverse() * v_enu
    }

    fn sees(&self, r_enu_m: DVec3) -> bool {
        let sight = self.environment.line_of_sight(self.pose.r_enu_m, r_enu_m);
        sight == LineOfSight::Clear
    }

    /// Luminance, or illuminance, over radiance, or irradiance, of a wavelength.
    fn kcd_per_w(&self, wavelength_m: f64) -> [f64; 3] {
        let mosaic = self.camera.sensor.params().mosaic;
        kcd_per_w(mosaic, &self.stray.filter, wavelength_m)
    }

    /// A beam in the air; none where it cannot bring so much light to any pixel [kcd/m²].
    fn beam(&self, beam: &Beam, station: Entity, faint_kcd_m2: f64) -> Option<SeenBeam> {
        let own = beam.station == station;
        let exit_enu_m = beam.pose.r_enu_m - self.pose.r_enu_m;
        let aside_enu_m = beam.pose.q_enu_cam * DVec3::X * self.stray.offset_m;
        let sight = BeamSight {
            laser: beam.laser,
            focus_m: beam.focus_m,
            end_m: beam.end_m,
            air: beam.air,
            exit_cam_m: self.to_cam(if own { -aside_enu_m } else { exit_enu_m }),
            axis_cam: self.to_cam(beam.axis_enu()),
            lens_m: self.stray.lens_m,
            blur_rad: self.camera.sensor.params().blur_sigma_px * self.camera.pinhole.ifov_rad(),
        };
        let kcd_per_w = self.kcd_per_w(beam.laser.wavelength_m);
        let greatest_kcd_per_w = kcd_per_w.into_iter().fold(0.0, f64::max);
        if greatest_kcd_per_w * sight.most_wpm2sr(own) < faint_kcd_m2 {
            return None;
        }
        let light = if own {
            // The cameras of a station are where its laser is, but for this: nothing hides what lies ahead of both.
            BeamLight::new(&sight.converged(beam.focus_m.min(beam.end_m)), |_| true)
        } else {
            // What hides parts of it is asked only where all of it would show.
            let open = BeamLight::new(&sight, |_| true);
            if greatest_kcd_per_w * open.most_radiance() < faint_kcd_m2 {
                return None;
            }
            BeamLight::new(&sight, |r_cam_m| {
                self.sees(self.pose.r_enu_m + self.pose.q_enu_cam * r_cam_m)
            })
        };
        Some(SeenBeam {
            light,
            kcd_per_w,
            along: own,
        })
    }

    /// The spot at a beam's end.
    fn glint(&self, beam: &Beam) -> Option<PointLight> {
        let spot = beam.spot.as_ref()?;
        let to_eye_m = self.pose.r_enu_m - spot.r_enu_m;
        let to_laser = (beam.pose.r_enu_m - spot.r_enu_m).normalize_or_zero();
        let range_m = to_eye_m.length();
        // What the beam has met hides what lies behind: the spot is looked at from just before it.
        let before_m = spot.r_enu_m + to_laser;
        if range_m <= 1.0 || !self.sees(before_m) {
            return None;
        }
        let to_eye = to_eye_m / range_m;
        let surface = &spot.surface;
        let intensity_wpsr =
            surface.intensity_wpsr(spot.power_w, spot.normal_enu, to_laser, to_eye);
        let left = transmittance(beam.air.extinction_per_m, range_m) / (range_m * range_m);
        let klx_per_wpm2 = self.kcd_per_w(beam.laser.wavelength_m);
        Some(PointLight {
            dir_cam: self.to_cam(-to_eye),
            klx: klx_per_wpm2.map(|klx| klx * intensity_wpsr * left),
            radius_rad: 0.5 * spot.radius_m / range_m,
        })
    }

    /// A lamp that shines on the camera.
    fn lamp(&self, shining: &Shining, lamps: &Lamps) -> Option<PointLight> {
        /// Radius of a lamp's mouth [m]: of a hand-held one, assumed.
        const MOUTH_M: f64 = 0.05;
        let lamp = lamps.0.get(shining.lamp)?;
        let to_eye_m = self.pose.r_enu_m - shining.r_enu_m;
        let range_m = to_eye_m.length();
        if range_m <= 1.0 || !self.sees(shining.r_enu_m) {
            return None;
        }
        let off_rad = to_eye_m.angle_between(shining.at_enu_m - shining.r_enu_m);
        let intensity = lamp.beam.intensity(off_rad);
        let (wavelength_m, klx) = match lamp.beam.light {
            LampLight::White(_) => (WHITE_M, [1e-3; 3]),
            LampLight::Line(_, wavelength_m) => (wavelength_m, self.kcd_per_w(wavelength_m)),
        };
        let air = self.environment.weather.extinction_per_m(wavelength_m);
        let left = transmittance(air, range_m) / (range_m * range_m);
        Some(PointLight {
            dir_cam: self.to_cam(-to_eye_m / range_m),
            klx: klx.map(|klx| klx * intensity * left),
            radius_rad: 0.5 * MOUTH_M / range_m,
        })
    }
}

/// Sets the mean power of lasers that pause for exposures, from the next tick on.
pub fn pause_lasers(
    clock: Res<SimClock>,
    mut stations: Query<(&StationCameras, &mut LaserSource, &mut LaserPauses)>,
    cameras: Query<(&SensorCamera, &StrayOptics, &Readout, &AutoExposure)>,
) {
    for (own, mut source, mut pauses) in &mut stations {
        let exposed = cameras.iter_many(own.entities()).filter_map(|camera| {
            let (camera, stray, readout, auto) = camera;
            let paused = stray.gate == LaserGate::Pause && *readout != Readout::Off;
            let (product_s, _) = auto.now.filter(|_| paused)?;
            let time_s = camera.control.setting(product_s).time_s;
            Some(time_s / clock.at_s(camera.period_ticks))
        });
        // Each camera's exposures by themselves: what coincides pauses the laser once, so that this is the most it loses.
        let share = exposed.sum::<f64>().min(1.0);
        if share != pauses.share {
            pauses.share = share;
            source.laser.power_w = pauses.full_w * (1.0 - share);
        }
    }
}
