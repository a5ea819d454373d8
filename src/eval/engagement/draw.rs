//! One engagement, drawn from its recipe: what is in it, and the scenario that `boresight run` repeats.
//!
//! A draw is a function of recipe, seed and number alone. Each of its parts has a stream of its own, so
//! that a change to one leaves the others as they are.

use super::recipe::{
    Background, Flight, KindDraw, Light, Nearness, Recipe, SearchDraw, UavDraw, drawn, metar,
};
use crate::eval::EvalError;
use crate::models::air::sun::{Sun, SunError};
use crate::models::flight::trajectory::{CompiledTrajectory, Trajectory};
use crate::models::ground::city::{City, CityError, CityParams};
use crate::models::ground::dsm::{Dsm, LineOfSight};
use crate::models::maths::kinematics::{az_el_to_los, los_to_az_el};
use crate::models::maths::rng::Stream;
use crate::parameters::environment::{folder, placed_in_city};
use crate::scenario::{
    Backstop, Cue, DistractorConfig, InputError, RadarConfig, Scenario, SearchSector, Site,
    UavConfig, WeatherConfig, catalogue, gnss_sigma_m,
};
use chrono::{DateTime, Duration, TimeZone as _, Utc};
use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Why an engagement cannot be drawn.
#[derive(Debug, thiserror::Error)]
pub enum DrawError {
    /// No place for the flight.
    #[error(
        "draw {index}: no place for a {flight:?} flight before {background:?} was found; give the recipe a \
         wider uav.range_m, or other flights and backgrounds"
    )]
    NoPlace {
        /// Number of the draw.
        index: u32,
        /// The flight.
        flight: Flight,
        /// The background.
        background: Background,
    },
    /// Its UAV.
    #[error("draw {index}: {source}")]
    Uav {
        /// Number of the draw.
        index: u32,
        /// What is wrong.
        source: catalogue::UavError,
    },
    /// Its city.
    #[error("draw {index}: {source}")]
    City {
        /// Number of the draw.
        index: u32,
        /// What is wrong.
        source: CityError,
    },
    /// Its real city.
    #[error("draw {index}: {source}")]
    Real {
        /// Number of the draw.
        index: u32,
        /// What is wrong.
        source: InputError,
    },
    /// Its sun.
    #[error("draw {index}: {source}")]
    Sun {
        /// Number of the draw.
        index: u32,
        /// What is wrong.
        source: SunError,
    },
    /// No rules of fire.
    #[error("draw {index}: the recipe has no rules with a share above 0; give one")]
    NoRules {
        /// Number of the draw.
        index: u32,
    },
    /// Its scenario.
    #[error("draw {index}: {source}")]
    Text {
        /// Number of the draw.
        index: u32,
        /// What is wrong.
        source: toml::ser::Error,
    },
}

impl From<DrawError> for EvalError {
    fn from(error: DrawError) -> Self {
        Self::own(error)
    }
}

/// What is in an engagement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Facts {
    /// Number of the draw.
    pub index: u32,
    /// The UAV, as a scenario names it.
    pub model: String,
    /// Whether it is held out.
    pub held_out: bool,
    /// The real city, by its scenario's name; none: a generated one.
    pub real: Option<String>,
    /// Name of the rules of fire.
    pub rules: String,
    /// How it flies.
    pub flight: Flight,
    /// Range at the start [m].
    pub range_m: f64,
    /// What stands behind it.
    pub background: Background,
    /// Where the sun stands.
    pub light: Light,
    /// The weather report.
    pub metar: String,
    /// Whether clouds show.
    pub cloud_texture: bool,
    /// Whether a radar cues the search.
    pub cued: bool,
    /// How near something else flies.
    pub nearness: Nearness,
    /// The recipe's name of what that is.
    pub distractor: Option<String>,
}

/// An engagement and its scenario.
pub struct Draw {
    /// What is in it.
    pub facts: Facts,
    /// The scenario, as TOML.
    pub scenario: String,
}

/// The keys of a scenario that an engagement sets.
#[derive(Serialize)]
struct Draft {
    name: String,
    description: String,
    seed: u64,
    duration_s: f64,
    time_utc: String,
    site: Site,
    weather: WeatherConfig,
    city: CityParams,
    #[serde(skip_serializing_if = "Option::is_none")]
    station: Option<DraftStation>,
    search: SearchSector,
    engage: DraftEngage,
    uavs: Vec<UavConfig>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    distractors: Vec<DistractorConfig>,
}

#[derive(Serialize)]
struct DraftStation {
    position_enu_m: [f64; 3],
}

#[derive(Serialize)]
struct DraftEngage {
    allow_backstop: Vec<Backstop>,
    min_clear_range_m: f64,
}

impl Draw {
    /// Draws engagement `index` under `seed`.
    pub fn new(recipe: &Recipe, seed: u64, index: u32) -> Result<Self, DrawError> {
        let stream =
            |part: &str| Stream::new(seed, u64::from(index), &format!("engagement {part}"));
        let background = named(
            &recipe.backgrounds,
            &mut stream("background"),
            Background::Sky,
        );
        let place = Place::drawn(recipe, index, background, &stream)?;
        // There are no woods to choose in a real city: what is solid there is buildings or ground.
        let background = match (&place.real, background) {
            (Some(_), Background::Woods) => Background::City,
            _ => background,
        };
        let station_enu_m = place.station_enu_m;
        let mut rng = stream("flight");
        let flight = named(&recipe.uav.flights, &mut rng, Flight::Crossing);
        let models = match recipe.uav.held_out {
            Some(share) => recipe.uav.which(stream("airframe").uniform() < share),
            None => recipe.uav.models.iter().map(String::as_str).collect(),
        };
        let model = rng.pick(&models);
        let uav = catalogue::load(model).map_err(|source| DrawError::Uav { index, source })?;
        let stage = Stage {
            dsm: &place.city.dsm,
            station_enu_m,
            duration_s: recipe.duration_s,
        };
        let no_place = || DrawError::NoPlace {
            index,
            flight,
            background,
        };
        let (trajectory, plan) = stage
            .flight(&recipe.uav, uav.v_max_mps, flight, background, &mut rng)
            .ok_or_else(no_place)?;
        let mut rng = stream("distractors");
        let (nearness, kind, distractors) = stage.distractors(recipe, &plan, &mut rng);
        let mut rng = stream("light");
        let light = named(&recipe.light, &mut rng, Light::Day);
        let time_utc = time(&place.site, light, &mut rng)
            .map_err(|source| DrawError::Sun { index, source })?;
        let weather = weather(recipe, time_utc, &mut stream("weather"));
        let start_enu_m = plan.sample(0.0).r_enu_m - station_enu_m;
        let search = search(&recipe.search, start_enu_m, &mut stream("search"));
        let mut rng = stream("rules");
        let rules = drawn(recipe.rules.iter().map(|r| (r, r.share)), &mut rng);
        let rules = rules.ok_or(DrawError::NoRules { index })?;
        let facts = Facts {
            index,
            model: model.to_owned(),
            held_out: uav.held_out,
            real: place.real.clone(),
            rules: rules.name.clone(),
            flight,
            range_m: start_enu_m.length().round(),
            background,
            light,
            metar: weather.metar.clone().unwrap_or_default(),
            cloud_texture: weather.cloud_texture,
            cued: search.cue.is_some(),
            nearness,
            distractor: kind.map(|kind| kind.name.clone()),
        };
        let draft = Draft {
            name: format!("engagement_{index:05}"),
            description: format!(
                "Draw {index} under seed {seed}: {model}, {flight:?}, {background:?}, {light:?}, \
                 distractors {nearness:?}."
            ),
            // TOML's numbers have a sign.
            seed: stream("run").bits() >> 16,
            duration_s: recipe.duration_s,
            time_utc: time_utc.format("%Y-%m-%dT%H:%M:%SZ").to_string(),
            site: place.site,
            weather,
            station: place.written.then(|| DraftStation {
                position_enu_m: station_enu_m.to_array(),
            }),
            city: place.params,
            search,
            engage: DraftEngage {
                allow_backstop: rules.allow_backstop.clone(),
                min_clear_range_m: rules.min_clear_range_m,
            },
            uavs: vec![intruder(model, trajectory)],
            distractors,
        };
        let scenario =
            toml::to_string(&draft).map_err(|source| DrawError::Text { index, source })?;
        Ok(Self { facts, scenario })
    }
}

/// One of several named things; `otherwise` where the recipe names none, which its check refuses.
fn named<T: Copy>(
    shares: &std::collections::BTreeMap<T, f64>,
    rng: &mut Stream,
    otherwise: T,
) -> T {
    drawn(shares.iter().map(|(thing, share)| (*thing, *share)), rng).unwrap_or(otherwise)
}

/// Where an engagement takes place.
struct Place {
    city: Arc<City>,
    /// Its parameters, as a scenario has them wherever its file lies.
    params: CityParams,
    site: Site,
    /// Where the station stands [m, ENU].
    station_enu_m: DVec3,
    /// Whether the scenario says so: it is not where the city would put it.
    written: bool,
    /// The real city's name.
    real: Option<String>,
}

impl Place {
    fn drawn(
        recipe: &Recipe,
        index: u32,
        background: Background,
        stream: &impl Fn(&str) -> Stream,
    ) -> Result<Self, DrawError> {
        let mut rng = stream("real");
        if rng.uniform() < recipe.real.share && !recipe.real.scenarios.is_empty() {
            let paths: Vec<&Path> = recipe.real.scenarios.iter().map(PathBuf::as_path).collect();
            return Self::real(rng.pick(&paths))
                .map_err(|source| DrawError::Real { index, source });
        }
        let city = Self::generated(recipe, background, &mut stream("place"));
        city.map_err(|source| DrawError::City { index, source })
    }

    /// One of the cities that are for the recipe's purpose.
    fn generated(
        recipe: &Recipe,
        background: Background,
        rng: &mut Stream,
    ) -> Result<Self, CityError> {
        let params = CityParams {
            seed: recipe.purpose.first_seed() + rng.bits() % u64::from(recipe.places),
            ..CityParams::default()
        };
        let woods = background == Background::Woods;
        let params = if woods {
            CityParams {
                forest_share: 0.5,
                building_density: 0.1,
                ..params
            }
        } else {
            params
        };
        let city = City::generate(&params)?;
        let station_enu_m = if woods {
            DVec3::Z * rounded(city.dsm.terrain_m(0.0, 0.0) + recipe.mast_m)
        } else {
            city.station_enu_m()
        };
        Ok(Self {
            city: Arc::new(city),
            params,
            site: recipe.site.clone(),
            station_enu_m,
            written: woods,
            real: None,
        })
    }

    /// That of a scenario, whose station keeps its place.
    fn real(path: &Path) -> Result<Self, InputError> {
        let loaded = Scenario::load(&crate::data::found(path), &[])?;
        if !loaded.scenario.city.is_real() {
            let why =
                "is generated: name scenarios with a real city in the recipe's real.scenarios";
            return Err(loaded.refuse("city", why));
        }
        let mut params = loaded.scenario.city.clone();
        for path in params.paths_mut() {
            let beside = folder(&loaded).join(&*path);
            // An address is no path; where the working directory is unknown, paths stay as they are.
            if !path.contains("://")
                && let Ok(whole) = std::path::absolute(beside)
            {
                *path = whole.to_string_lossy().into_owned();
            }
        }
        let (loaded, city) = placed_in_city(loaded)?;
        let Scenario {
            site,
            station,
            name,
            ..
        } = loaded.scenario;
        let given = station.position_enu_m.map(DVec3::from);
        Ok(Self {
            station_enu_m: given.unwrap_or_else(|| city.station_enu_m()),
            city,
            params,
            site,
            written: given.is_some(),
            real: Some(name),
        })
    }
}

/// The UAV as a scenario has it.
fn intruder(model: &str, trajectory: Trajectory) -> UavConfig {
    UavConfig {
        name: "intruder".into(),
        model: model.to_owned(),
        trajectory,
        skin: None,
        spread_m: [0.0; 2],
        spread_s: 0.0,
        gnss_sigma_m: gnss_sigma_m(),
        member: None,
    }
}

/// To a tenth: what stands in a scenario is for people too.
fn rounded(value: f64) -> f64 {
    (10.0 * value).round() / 10.0
}

fn rounded3(value: DVec3) -> [f64; 3] {
    value.to_array().map(rounded)
}

/// A draw between two limits, even over the logarithm.
fn log_range([from, to]: [f64; 2], rng: &mut Stream) -> f64 {
    rng.range(from.ln(), to.ln()).exp()
}

/// A level direction from an azimuth [rad].
fn level(azimuth_rad: f64) -> DVec3 {
    az_el_to_los(DVec2::new(azimuth_rad, 0.0))
}

/// A time at which the sun stands as the light wants it.
fn time(site: &Site, light: Light, rng: &mut Stream) -> Result<DateTime<Utc>, SunError> {
    const TRIES: usize = 60;
    const STEP_MIN: i64 = 4;
    let geodetic = site.geodetic();
    let [low_deg, high_deg] = light.elevation_deg();
    let new_year = Utc.timestamp_opt(1_735_689_600, 0).single(); // 2025-01-01
    let new_year = new_year.unwrap_or_default();
    let mut nearest: Option<(f64, DateTime<Utc>)> = None;
    for _ in 0..TRIES {
        let wanted_deg = rng.range(low_deg, high_deg);
        let day = new_year + Duration::days((rng.uniform() * 365.0) as i64);
        // Up in the morning or down in the evening, whichever comes first from a time drawn on.
        let from_min = (rng.uniform() * 1440.0) as i64;
        for k in 0..1440 / STEP_MIN {
            let at = day + Duration::minutes((from_min + STEP_MIN * k) % 1440);
            let sun = Sun::new(&at, geodetic, 101_325.0, 288.15)?; // [Pa], [K]
            let off_deg = (sun.elevation_rad.to_degrees() - wanted_deg).abs();
            if nearest.is_none_or(|(least, _)| off_deg < least) {
                nearest = Some((off_deg, at));
            }
            if off_deg < 0.5 {
                return Ok(at);
            }
        }
    }
    Ok(nearest.map_or(new_year, |(_, at)| at))
}

/// The weather at `time_utc`.
fn weather(recipe: &Recipe, time_utc: DateTime<Utc>, rng: &mut Stream) -> WeatherConfig {
    let reports: Vec<&str> = recipe.weather.reports.iter().map(String::as_str).collect();
    let body = rng.pick(&reports);
    let visibility_m = log_range(recipe.weather.visibility_m, rng);
    let open = ["9999", "CAVOK"].iter().any(|word| body.contains(word));
    WeatherConfig {
        metar: Some(metar(body, &time_utc.format("%d%H%M").to_string())),
        visibility_m: open.then_some(visibility_m.round()),
        cloud_texture: rng.uniform() < recipe.weather.cloud_texture,
        ..WeatherConfig::default()
    }
}

/// A sector with the start of the flight in it, seen from the station; the cue, if there is one.
fn search(draw: &SearchDraw, start_enu_m: DVec3, rng: &mut Stream) -> SearchSector {
    // The UAV stands in the sector's inner nine tenths.
    let mut within = |width_deg: f64| 0.45 * width_deg * rng.range(-1.0, 1.0);
    let at = los_to_az_el(start_enu_m);
    let (across, up) = (within(1.0), within(1.0));
    let width_deg = rng.range(draw.width_deg[0], draw.width_deg[1]);
    let height_deg = rng.range(draw.height_deg[0], draw.height_deg[1]);
    let centre_deg = (at.x.to_degrees() - across * width_deg).rem_euclid(360.0);
    let cue = Cue {
        kind: draw.cue_kind,
        radar: RadarConfig::default(),
        sigma_deg: rounded(10.0 * rng.range(draw.cue_sigma_deg[0], draw.cue_sigma_deg[1])) / 10.0,
        range_sigma_m: 15.0, // [m]
        rate_hz: 2.0,        // [Hz]
        latency_s: 0.3,      // [s]
        target: None,
        all: false,
    };
    SearchSector {
        centre_azimuth_deg: rounded(centre_deg),
        width_deg: rounded(width_deg),
        elevation_deg: rounded(at.y.to_degrees() - up * height_deg),
        height_deg: rounded(height_deg),
        pattern: Default::default(),
        cue: (rng.uniform() < draw.cued).then_some(cue),
    }
}

/// Where an engagement takes place.
struct Stage<'a> {
    dsm: &'a Dsm,
    station_enu_m: DVec3,
    duration_s: f64,
}

/// Tries to find a flight or a place.
const TRIES: usize = 3_000;
/// No flight comes nearer to the station than this [m].
const NEAREST_M: f64 = 100.0;
/// Least height of a flight over what stands below it [m].
const CLEARANCE_M: f64 = 8.0;
/// Angle by which open sky reaches below a UAV before it [rad].
const SKY_BELOW_RAD: f64 = 1f64.to_radians();
/// Kinds that are tried until one has a place.
const KINDS: usize = 20;
/// Share of a flight that is in clear sight, and before its background.
const LEAST_SHARE: f64 = 0.8;
/// A pop-up has risen after this share of the engagement.
const RISEN: f64 = 0.35;

impl Stage<'_> {
    /// A flight before a background, and its plan.
    fn flight(
        &self,
        draw: &UavDraw,
        v_max_mps: f64,
        flight: Flight,
        background: Background,
        rng: &mut Stream,
    ) -> Option<(Trajectory, CompiledTrajectory)> {
        let range_m = log_range(draw.range_m, rng);
        let fastest_mps = (0.7 * v_max_mps).max(draw.speed_mps[0]);
        let speed_mps = rng.range(draw.speed_mps[0], draw.speed_mps[1].min(fastest_mps));
        (0..TRIES).find_map(|attempt| {
            // Where nothing fits at this range, others are tried.
            let range_m = match attempt {
                _ if attempt < TRIES / 4 => range_m,
                _ => log_range(draw.range_m, rng),
            };
            let at = self.start(range_m, background, rng);
            let trajectory = self.trajectory(flight, at, rounded(speed_mps), rng);
            let plan = trajectory.compile(|_| Ok(String::new())).ok()?;
            self.fits(&plan, flight, background)
                .then_some((trajectory, plan))
        })
    }

    /// A place to begin at, seen from the station [m].
    fn start(&self, range_m: f64, background: Background, rng: &mut Stream) -> DVec3 {
        let elevation_deg = match background {
            // Low over the roofs is where UAVs are looked for.
            Background::Sky => 1.0 + 19.0 * rng.uniform().powi(2),
            Background::City | Background::Woods => rng.range(-3.0, 4.0),
        };
        let azimuth_rad = rng.range(0.0, TAU);
        range_m * az_el_to_los(DVec2::new(azimuth_rad, elevation_deg.to_radians()))
    }

    /// A flight that begins, or for a pop-up ends, at a place seen from the station.
    fn trajectory(
        &self,
        flight: Flight,
        at: DVec3,
        speed_mps: f64,
        rng: &mut Stream,
    ) -> Trajectory {
        let start = self.station_enu_m + at;
        let away_rad = los_to_az_el(at).x;
        let side = if rng.uniform() < 0.5 { 1.0 } else { -1.0 };
        let across_rad = away_rad + side * rng.range(0.25 * PI, 0.75 * PI);
        let climb_mps = rng.range(-0.1, 0.1) * speed_mps * DVec3::Z;
        let start_enu_m = rounded3(start);
        let heading_deg = rounded(rng.range(0.0, 360.0));
        let line = |azimuth_rad: f64| rounded3(speed_mps * level(azimuth_rad) + climb_mps);
        match flight {
            Flight::Crossing => Trajectory::Straight {
                start_enu_m,
                velocity_enu_mps: line(across_rad),
            },
            Flight::Approach => {
                let aside_rad = rng.range(-30.0, 30.0).to_radians();
                Trajectory::Straight {
                    start_enu_m,
                    velocity_enu_mps: line(away_rad + PI + aside_rad),
                }
            }
            Flight::Weave => Trajectory::Weave {
                start_enu_m,
                velocity_enu_mps: line(across_rad),
                lateral_acceleration_mps2: rounded(rng.range(1.0, 3.0)),
                period_s: rounded(rng.range(3.0, 7.0)),
            },
            Flight::Orbit => {
                let radius_m = rounded(rng.range(30.0, 100.0).max(speed_mps * speed_mps / 3.0));
                let bearing_rad = rng.range(0.0, TAU);
                Trajectory::Orbit {
                    centre_enu_m: rounded3(start - radius_m * level(bearing_rad)),
                    radius_m,
                    speed_mps,
                    clockwise: side > 0.0,
                    start_bearing_deg: rounded(bearing_rad.to_degrees()),
                }
            }
            Flight::Hover => Trajectory::Hover {
                position_enu_m: start_enu_m,
                heading_deg,
            },
            Flight::Waypoints => {
                let leg_m = speed_mps * rng.range(5.0, 8.0);
                let corner = leg_m * level(across_rad);
                let turn_rad = across_rad + side * rng.range(0.4 * PI, 0.7 * PI);
                let next = corner + leg_m * level(turn_rad);
                Trajectory::Waypoints {
                    points_enu_m: [DVec3::ZERO, corner, next]
                        .map(|leg| rounded3(start + leg))
                        .to_vec(),
                    speed_mps,
                    closed: true,
                    corner_acceleration_mps2: 4.0, // [m/s²]
                }
            }
            Flight::PopUp => {
                let low_m = self.dsm.surface_m(start.x, start.y) + CLEARANCE_M;
                Trajectory::PopUp {
                    position_enu_m: start_enu_m,
                    hide_height_m: rounded(low_m.max(start.z - rng.range(15.0, 40.0))),
                    pop_time_s: rounded(rng.range(0.5, 2.5)),
                    rise_speed_mps: rounded(speed_mps.min(8.0)),
                    heading_deg,
                }
            }
        }
    }

    /// Whether a flight hits nothing, is seen, and has its background.
    fn fits(&self, plan: &CompiledTrajectory, flight: Flight, background: Background) -> bool {
        const STEPS: u32 = 48;
        let risen = if flight == Flight::PopUp { RISEN } else { 0.0 };
        let (mut seen, mut before, mut counted) = (0, 0, 0);
        for step in 0..=STEPS {
            let share = f64::from(step) / f64::from(STEPS);
            let r_enu_m = plan.sample(share * self.duration_s).r_enu_m;
            let low = r_enu_m.z < self.dsm.surface_m(r_enu_m.x, r_enu_m.y) + CLEARANCE_M - 0.1;
            if low || r_enu_m.distance(self.station_enu_m) < NEAREST_M {
                return false;
            }
            if share < risen {
                continue;
            }
            counted += 1;
            let clear = self.clear(r_enu_m);
            let right = clear && self.is_before(r_enu_m, background);
            // It is seen, and before its background, when it first shows.
            if counted == 1 && !right {
                return false;
            }
            seen += u32::from(clear);
            before += u32::from(right);
        }
        let enough = |count: u32| f64::from(count) >= LEAST_SHARE * f64::from(counted);
        enough(seen) && enough(before)
    }

    fn clear(&self, r_enu_m: DVec3) -> bool {
        self.dsm.line_of_sight(self.station_enu_m, r_enu_m) == LineOfSight::Clear
    }

    /// Whether a point in clear sight has this background.
    fn is_before(&self, r_enu_m: DVec3, background: Background) -> bool {
        const FAR_M: f64 = 8_000.0; // [m]
        let at = los_to_az_el(r_enu_m - self.station_enu_m);
        let hit = |below_rad: f64| {
            let direction = az_el_to_los(at - DVec2::new(0.0, below_rad));
            (self.dsm)
                .first_hit(self.station_enu_m, direction, FAR_M)
                .is_some()
        };
        match background {
            Background::Sky => !hit(0.0) && !hit(SKY_BELOW_RAD),
            Background::City | Background::Woods => hit(0.0),
        }
    }

    /// What else flies: how near, of which kind, and as a scenario has it.
    fn distractors<'r>(
        &self,
        recipe: &'r Recipe,
        plan: &CompiledTrajectory,
        rng: &mut Stream,
    ) -> (Nearness, Option<&'r KindDraw>, Vec<DistractorConfig>) {
        let draw = &recipe.distractors;
        let nearness = named(&draw.nearness, rng, Nearness::None);
        let apart_deg = match nearness {
            Nearness::None => return (nearness, None, Vec::new()),
            Nearness::Near => draw.near_deg,
            Nearness::Far => draw.far_deg,
        };
        // A kind that has no place in clear sight there, such as an aeroplane before a wall, gives way to
        // another.
        let placed = (0..KINDS).find_map(|_| {
            let shares = draw.kinds.iter().map(|kind| (kind, kind.share));
            let kind = drawn(shares, rng)?;
            let speed_mps = rng.range(kind.speed_mps[0], kind.speed_mps[1]);
            // In the first third of the engagement they are that near; what drifts with the wind, at once.
            let meet_s = rng.uniform() * self.duration_s / 3.0;
            let meet_s = if speed_mps > 0.0 { meet_s } else { 0.0 };
            let uav = plan.sample(meet_s).r_enu_m - self.station_enu_m;
            let middle = self.beside(uav, kind, apart_deg, rng)?;
            Some((kind, speed_mps, meet_s, middle))
        });
        let Some((kind, speed_mps, meet_s, middle)) = placed else {
            return (Nearness::None, None, Vec::new());
        };
        let course_rad = rng.range(0.0, TAU);
        let velocity = speed_mps * (level(course_rad) + rng.range(-0.08, 0.08) * DVec3::Z);
        let [fewest, most] = kind.count;
        let count = fewest + (rng.uniform() * f64::from(most - fewest + 1)) as u32;
        let others = (0..count.min(most)).map(|member| {
            let offset = match member {
                // The first is where it was put.
                0 => DVec3::ZERO,
                _ => kind.spread_m * rng.normal3(),
            };
            let start_enu_m = rounded3(middle + offset - meet_s * velocity);
            let trajectory = if speed_mps > 0.0 {
                Trajectory::Straight {
                    start_enu_m,
                    velocity_enu_mps: rounded3(velocity),
                }
            } else {
                Trajectory::Hover {
                    position_enu_m: start_enu_m,
                    heading_deg: 0.0,
                }
            };
            DistractorConfig {
                name: format!("{} {}", kind.name, member + 1),
                kind: kind.kind,
                variant: None,
                trajectory,
                spread_m: [0.0; 2],
                spread_s: 0.0,
                decoy: false,
            }
        });
        (nearness, Some(kind), others.collect())
    }

    /// A place in clear sight so many degrees beside the UAV [m, enu].
    fn beside(
        &self,
        uav: DVec3,
        kind: &KindDraw,
        apart_deg: [f64; 2],
        rng: &mut Stream,
    ) -> Option<DVec3> {
        const TRIES: usize = 50;
        let direction = uav.normalize();
        let right = direction.cross(DVec3::Z).normalize_or(DVec3::X);
        let up = right.cross(direction);
        (0..TRIES).find_map(|_| {
            let apart_rad = log_range(apart_deg, rng).to_radians();
            let (sin, cos) = rng.range(0.0, TAU).sin_cos();
            let beside = direction + apart_rad.tan() * (cos * right + sin * up);
            let place = self.station_enu_m + log_range(kind.range_m, rng) * beside.normalize();
            self.clear(place).then_some(place)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::ground::city::JUDGED_SEEDS;

    const SHIPPED: &str = include_str!("../../../recipes/engagement.toml");

    fn recipe(text: &str) -> Recipe {
        Recipe::parse(text, "r.toml").unwrap()
    }

    /// Few draws: generating their cities takes the time.
    #[test]
    fn a_draw_repeats_is_a_scenario_and_keeps_what_it_promises() {
        let recipe = recipe(SHIPPED);
        let again = Draw::new(&recipe, 5, 0).unwrap();
        let other = Draw::new(&recipe, 6, 0).unwrap();
        for index in 0..6 {
            let draw = Draw::new(&recipe, 5, index).unwrap();
            let facts = &draw.facts;
            if index == 0 {
                assert_eq!((&again.scenario, &again.facts), (&draw.scenario, facts));
                assert_ne!(other.scenario, draw.scenario);
            }

            let scenario = Scenario::parse(&draw.scenario, "draw.toml", &[]).unwrap();
            assert!(JUDGED_SEEDS.contains(&scenario.city.seed));
            let model = catalogue::load(&facts.model).unwrap();
            assert_eq!(facts.held_out, model.held_out);
            let rules = recipe.rules.iter().find(|r| r.name == facts.rules).unwrap();
            assert_eq!(scenario.engage.allow_backstop, rules.allow_backstop);
            let city = City::generate(&scenario.city).unwrap();
            let station_enu_m = match scenario.station.position_enu_m {
                Some(position) => position.into(),
                None => city.station_enu_m(),
            };
            let plan = |flight: &Trajectory| flight.compile(|_| Ok(String::new())).unwrap();
            let uav = plan(&scenario.uavs[0].trajectory);
            let direction = |plan: &CompiledTrajectory, t_s: f64| {
                (plan.sample(t_s).r_enu_m - station_enu_m).normalize()
            };
            // The start lies in the sector.
            let at = los_to_az_el(direction(&uav, 0.0)).map(f64::to_degrees);
            let off_deg =
                (at.x - scenario.search.centre_azimuth_deg + 540.0).rem_euclid(360.0) - 180.0;
            assert!(
                off_deg.abs() < 0.5 * scenario.search.width_deg,
                "{facts:?}: {off_deg}"
            );
            let up_deg = at.y - scenario.search.elevation_deg;
            assert!(
                up_deg.abs() < 0.5 * scenario.search.height_deg,
                "{facts:?}: {up_deg}"
            );
            // What is near comes within 3°, what is far does not begin there.
            let nearest_deg = |other: &DistractorConfig| {
                let other = plan(&other.trajectory);
                (0..=80)
                    .map(|k| f64::from(k) * recipe.duration_s / 240.0)
                    .map(|t_s| direction(&uav, t_s).angle_between(direction(&other, t_s)))
                    .fold(f64::INFINITY, f64::min)
                    .to_degrees()
            };
            let nearest_deg = scenario
                .distractors
                .iter()
                .map(nearest_deg)
                .reduce(f64::min);
            match facts.nearness {
                Nearness::None => assert_eq!(nearest_deg, None),
                Nearness::Near => assert!(nearest_deg.unwrap() < 3.1, "{facts:?} {nearest_deg:?}"),
                Nearness::Far => assert!(nearest_deg.is_some()),
            }
            // The sun stands where the light says.
            let geodetic = scenario.site.geodetic();
            let sun = Sun::new(&scenario.time_utc, geodetic, 95_000.0, 288.15).unwrap();
            let [low_deg, high_deg] = facts.light.elevation_deg();
            let sun_deg = sun.elevation_rad.to_degrees();
            assert!(
                (low_deg - 1.0..high_deg + 1.0).contains(&sun_deg),
                "{sun_deg}"
            );
        }
    }

    #[test]
    fn a_part_of_a_recipe_changes_its_own_part_of_a_draw() {
        let cued = recipe(&SHIPPED.replace("cued = 0.7", "cued = 1.0"));
        let alone = SHIPPED.replace("none = 0.3", "none = 1.0");
        let alone = recipe(
            &alone
                .replace("far = 0.2", "far = 0.0")
                .replace("near = 0.5", "near = 0.0"),
        );
        let by = ["default", "loose"].map(|rules| {
            let recipe = recipe(SHIPPED).under(rules).unwrap();
            let draw = Draw::new(&recipe, 1, 3).unwrap();
            assert_eq!(draw.facts.rules, rules);
            Scenario::parse(&draw.scenario, "d.toml", &[]).unwrap()
        });
        assert_ne!(by[0].engage, by[1].engage);
        let engage = by[1].engage.clone();
        let [strict, loose] = by;
        assert_eq!(Scenario { engage, ..strict }, loose);
        let [cued, alone] = [cued, alone].map(|recipe| Draw::new(&recipe, 1, 3).unwrap());
        assert!(cued.facts.cued && alone.facts.nearness == Nearness::None);
        let scenarios =
            [&cued, &alone].map(|d| Scenario::parse(&d.scenario, "d.toml", &[]).unwrap());
        assert_eq!(scenarios[0].uavs, scenarios[1].uavs);
        assert_eq!(scenarios[0].time_utc, scenarios[1].time_utc);
        assert_eq!(scenarios[0].weather, scenarios[1].weather);
    }
}
