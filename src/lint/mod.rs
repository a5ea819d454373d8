//! What a scenario looks like before it is run: who is seen when and how large, what of it makes no sense, a map.
//!
//! Everything is found from the planned paths, without the spread that the seed draws: swarms are taken to fly straight on.

mod map;
mod sights;
mod warnings;

pub use map::svg;
pub use sights::table;
pub use warnings::warnings;

use std::path::Path;

use glam::{DVec2, DVec3};

use crate::models::air::weather::Weather;
use crate::models::flight::distractor::DistractorKind;
use crate::models::flight::trajectory::{CompiledTrajectory, Trajectory};
use crate::models::flight::uav::UavModel;
use crate::models::ground::city::City;
use crate::models::ground::dsm::LineOfSight;
use crate::models::maths::kinematics::los_to_az_el;
use crate::scenario::{CameraConfig, Loaded, ResolvedStation, catalogue};

/// Time between two looks at a path [s]: a fast UAV flies some metres.
const STEP_S: f64 = 0.25;
/// Looks at a path at most: longer runs are looked at less often.
const MOST_LOOKS: f64 = 1_200.0;

/// A scenario in its city.
#[derive(Clone, Debug)]
pub struct Scene<'a> {
    /// The scenario, its places as numbers.
    pub loaded: &'a Loaded,
    /// Its city.
    pub city: &'a City,
    /// Its weather at the start.
    pub weather: Weather,
    /// Direction to the sun at the start.
    pub sun_dir_enu: DVec3,
}

/// What a flying thing is.
#[derive(Clone, Debug)]
enum Body {
    /// A UAV of the catalogue, and the swarm that it belongs to.
    Uav(Box<UavModel>, Option<usize>),
    /// What is none.
    Distractor(DistractorKind),
}

/// A flying thing on its path.
#[derive(Clone, Debug)]
struct Flown {
    name: String,
    /// Where it stands in the scenario.
    place: String,
    plan: CompiledTrajectory,
    body: Body,
    /// Whether it moves with the air.
    drifts: bool,
}

/// A station, and where its axes cross [m, enu].
struct Seeing<'a> {
    station: ResolvedStation<'a>,
    r_enu_m: DVec3,
}

/// A flying thing as a station has it before itself.
#[derive(Clone, Copy, Debug)]
struct View {
    /// Slant range [m].
    range_m: f64,
    /// Azimuth and elevation [rad].
    az_el_rad: DVec2,
}

impl Scene<'_> {
    /// The times at which paths are looked at [s], up to the end of the run.
    fn times_s(&self) -> Vec<f64> {
        times_s(0.0, self.loaded.scenario.duration_s)
    }

    /// The stations where they stand.
    fn stations(&self) -> Vec<Seeing<'_>> {
        let stations = self.loaded.scenario.stations().into_iter();
        stations
            .map(|station| Seeing {
                r_enu_m: (station.config.position_enu_m)
                    .map_or_else(|| self.city.station_enu_m(), DVec3::from_array),
                station,
            })
            .collect()
    }

    /// The UAVs.
    fn uavs(&self) -> Vec<Flown> {
        let uavs = self.loaded.scenario.uavs.iter().enumerate();
        uavs.filter_map(|(index, uav)| {
            let swarm = uav.member.as_ref().map(|member| member.swarm);
            Some(Flown {
                name: uav.name.clone(),
                place: match swarm {
                    Some(swarm) => format!("swarms[{swarm}]"),
                    None => format!("uavs[{index}]"),
                },
                plan: self.plan(&uav.trajectory)?,
                body: Body::Uav(Box::new(catalogue::load(&uav.model).ok()?), swarm),
                drifts: false,
            })
        })
        .collect()
    }

    /// What flies and is no UAV; a swarm's decoys are left out.
    fn distractors(&self) -> Vec<Flown> {
        let others = self.loaded.scenario.distractors.iter().enumerate();
        let others = others.filter(|(_, other)| !other.decoy);
        others
            .filter_map(|(index, other)| {
                Some(Flown {
                    name: other.name.clone(),
                    place: format!("distractors[{index}]"),
                    plan: self.plan(&other.trajectory)?,
                    body: Body::Distractor(other.kind),
                    drifts: other.kind.drifts(),
                })
            })
            .collect()
    }

    /// A path; `None` where the set-up refuses it.
    fn plan(&self, trajectory: &Trajectory) -> Option<CompiledTrajectory> {
        let folder = self.loaded.path.parent().unwrap_or(Path::new("."));
        trajectory
            .compile(|name: &str| std::fs::read_to_string(folder.join(name)))
            .ok()
    }

    /// Whether neither city nor cloud stands between two points [m, enu].
    fn clear(&self, from_enu_m: DVec3, to_enu_m: DVec3) -> bool {
        let sight = self.city.dsm.line_of_sight(from_enu_m, to_enu_m);
        let sight = match self.weather.ceiling_m() {
            Some(base_m) => sight.below(base_m, from_enu_m, to_enu_m),
            None => sight,
        };
        sight == LineOfSight::Clear
    }

    /// The wind [m/s, enu], as it is reported.
    fn wind_enu_mps(&self) -> DVec3 {
        let (sin, cos) = self.weather.wind_from_rad.sin_cos();
        -self.weather.wind_speed_mps * DVec3::new(sin, cos, 0.0)
    }
}

/// Times from one to another [s].
fn times_s(from_s: f64, to_s: f64) -> Vec<f64> {
    let step_s = STEP_S.max((to_s - from_s) / MOST_LOOKS);
    let count = ((to_s - from_s) / step_s).floor().max(0.0) as usize;
    (0..=count).map(|k| from_s + step_s * k as f64).collect()
}

impl Flown {
    /// Its largest measure across the line of sight [m].
    fn size_m(&self) -> f64 {
        let [length_m, width_m, _] = match &self.body {
            Body::Uav(model, _) => model.size_m,
            Body::Distractor(kind) => kind.size_m(),
        };
        f64::max(length_m, width_m)
    }

    /// Whether it belongs to a swarm.
    fn swarm(&self) -> Option<usize> {
        match self.body {
            Body::Uav(_, swarm) => swarm,
            Body::Distractor(_) => None,
        }
    }

    /// Where it is at a time [m, enu].
    fn at(&self, t_s: f64) -> DVec3 {
        self.plan.sample(t_s).r_enu_m
    }
}

impl Seeing<'_> {
    /// How a point [m, enu] lies before it.
    fn view(&self, r_enu_m: DVec3) -> View {
        let line_m = r_enu_m - self.r_enu_m;
        View {
            range_m: line_m.length(),
            az_el_rad: los_to_az_el(line_m),
        }
    }
}

impl View {
    /// What something of a size [m] measures in a camera [px].
    fn size_px(&self, size_m: f64, camera: &CameraConfig) -> f64 {
        let px_per_rad = camera.focal_length_m() / (1e-6 * camera.pixel_pitch_um);
        size_m / self.range_m.max(1.0) * px_per_rad
    }

    /// Azimuth, clockwise from north, 0 to 360, and elevation [deg].
    fn az_el_deg(&self) -> [f64; 2] {
        let [az, el] = [self.az_el_rad.x, self.az_el_rad.y].map(f64::to_degrees);
        [az.rem_euclid(360.0), el]
    }
}

#[cfg(test)]
mod tests;
