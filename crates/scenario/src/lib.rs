#![doc = include_str!("../README.md")]

mod air;
mod cameras;
pub mod catalogue;
pub mod check;
mod control;
mod detector;
mod docs;
mod engage;
mod expect;
mod lights;
pub mod load;
pub mod mistaken;
mod mount;
mod network;
mod orders;
mod places;
mod recogniser;
mod record;
mod search;
mod site;
mod skin;
mod stand_in;
mod station;
mod swarms;
mod targets;
#[cfg(test)]
mod tests;
mod text;
mod tracker;

pub use air::{Turbulence, TurbulenceProfile, UNREPORTED_WEATHER, WeatherConfig};
pub use cameras::{
    AutoWord, CameraChanges, CameraConfig, CameraPath, CameraPreset, Cameras, Exposure, LaserGate,
    MoreCamera, Mosaic, ReadoutMode, ResolvedCamera, Shutter, WhiteBalance,
};
pub use control::{ControllerConfig, Gains, PAPER};
pub use detector::{DetectorConfig, MEASURED, ONNX, Provider, RECORDED, TRUTH, TruthErrorsConfig};
pub use docs::{docs_markdown, json_schema};
pub use engage::{Backstop, Engage, KeepOut};
pub use expect::{Bound, Expect, Never, Seeds, ShareConfig};
pub use lights::LightConfig;
pub use load::{Faults, InputError, Place, Places, TEXT, suggestion};
pub use mount::{
    BaseMotionConfig, BasePreset, BaseSpectrum, BaseValues, GyroConfig, GyroPreset, GyroValues,
    MountConfig,
};
pub use network::NetworkConfig;
pub use orders::{
    CameraOrder, DriveOrder, FlyOrder, GainsOrder, OrderConfig, OrderError, WeatherOrder,
};
pub use places::{Above, GivenPlace};
pub use recogniser::RecogniserConfig;
pub use record::{Images, Record};
pub use search::{Cue, CueKind, RadarConfig, SearchSector};
pub use site::Site;
pub use skin::SkinKind;
pub use station::{Focus, LaserConfig, ResolvedStation, Station, TargetWord};
pub use swarms::{SwarmConfig, SwarmLanding, SwarmOrigin, SwarmSplit, SwarmTakeOff};
pub use targets::{DistractorConfig, UavConfig, gnss_sigma_m};
pub use tracker::{AssociationRule, TrackerConfig};

use std::fmt;
use std::path::{Path, PathBuf};

use chrono::{DateTime, Utc};
use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use toml::de::{DeTable, DeValue};

use boresight_common::data;
use boresight_common::warning::Warning;
use boresight_models::air::atmosphere::pressure_at_pa;
use boresight_models::air::sun::Sun;
use boresight_models::air::weather::Weather;
use boresight_models::flight::trajectory::Trajectory;
use boresight_models::ground::city::CityParams;
use check::{Check, MAX_DURATION_S, TICK_HZ};
use load::{Checked, Parsed};
use mistaken::Mistaken;
use places::Written;

/// One run of the simulator: where, when, in what weather, with what equipment, against what.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// Short name; recordings and reports carry it.
    pub name: String,
    /// What the scenario shows, for people.
    #[serde(default)]
    pub description: String,
    /// Seed of every random stream: the same seed gives the same run, bit for bit.
    #[serde(default = "default_seed")]
    pub seed: u64,
    /// Simulated time to run.
    pub duration_s: f64,
    /// Rate of the simulation clock. Every camera's and recorder's rate must divide it.
    #[serde(default = "default_tick_hz")]
    pub tick_hz: u32,
    /// The origin of the local east-north-up frame on the WGS-84 ellipsoid.
    pub site: Site,
    /// Time at the start of the run, as TOML's own date-time or as an RFC 3339 string; it places
    /// the sun.
    #[serde(deserialize_with = "site::date_time")]
    pub time_utc: DateTime<Utc>,
    /// Wind, visibility, clouds and rain.
    #[serde(default)]
    pub weather: WeatherConfig,
    /// Optical turbulence along the line of sight.
    #[serde(default)]
    pub turbulence: Turbulence,
    /// The city around the station: generated, or real.
    #[serde(default)]
    pub city: CityParams,
    /// The protected station: mount, cameras and laser.
    #[serde(default)]
    pub station: Station,
    /// Several stations in place of the one: each is as `[station]` but for what it gives itself.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stations: Vec<Station>,
    /// The link between the stations, and how targets are assigned to them; absent: the defaults for several
    /// stations, none for one.
    pub network: Option<NetworkConfig>,
    /// Where the station looks for targets.
    pub search: SearchSector,
    /// The UAVs; none makes a false-alarm run.
    #[serde(default, serialize_with = "targets::named_uavs")]
    pub uavs: Vec<UavConfig>,
    /// Swarms of UAVs: each adds its members to the UAVs.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub swarms: Vec<SwarmConfig>,
    /// Birds, balloons, aircraft and leaves, which a detector may take for UAVs.
    #[serde(default, serialize_with = "targets::named_distractors")]
    pub distractors: Vec<DistractorConfig>,
    /// Searchlights and dazzlers that shine on a station.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lights: Vec<LightConfig>,
    /// What finds UAVs in the images.
    #[serde(default)]
    pub detector: DetectorConfig,
    /// What says over time what a track is.
    #[serde(default)]
    pub recogniser: RecogniserConfig,
    /// How detections become tracks and which of them becomes the target.
    #[serde(default)]
    pub tracker: TrackerConfig,
    /// What an operator orders during the run, in order of time.
    #[serde(default)]
    pub operator: Vec<OrderConfig>,
    /// The tracking loops.
    #[serde(default)]
    pub controller: ControllerConfig,
    /// When the laser may fire.
    #[serde(default)]
    pub engage: Engage,
    /// What is written down.
    #[serde(default)]
    pub record: Record,
    /// What runs of it must show, for `boresight test`.
    #[serde(rename = "expect")]
    pub expected: Option<Expect>,
}

fn default_seed() -> u64 {
    1
}

fn default_tick_hz() -> u32 {
    960
}

impl Scenario {
    /// The paths and addresses that count from the scenario's folder: of the city's files and of recorded flights.
    pub fn paths_mut(&mut self) -> Vec<&mut String> {
        let uavs = self.uavs.iter_mut().map(|uav| &mut uav.trajectory);
        let others = self.distractors.iter_mut();
        let flights = uavs.chain(others.map(|other| &mut other.trajectory));
        let recorded = flights.filter_map(|trajectory| match trajectory {
            Trajectory::Recorded { file, .. } => Some(file),
            _ => None,
        });
        let answers = self.detector.answers.iter_mut();
        let city = self.city.paths_mut().into_iter();
        city.chain(recorded).chain(answers).collect()
    }

    /// Reads, parses and checks a scenario file, which may be one that the program brings along; `overrides` are `key=value` texts as for
    /// [`Scenario::parse`].
    pub fn load(path: &Path, overrides: &[String]) -> Result<Loaded, InputError> {
        Self::load_all(path, overrides).map_err(Faults::first)
    }

    /// As [`Scenario::load`], with all errors that the file shows, in its order.
    pub fn load_all(path: &Path, overrides: &[String]) -> Result<Loaded, Faults> {
        let path = data::found(path);
        Loaded::parse_all(load::read(&path)?, path, overrides.to_vec())
    }

    /// Parses and checks a scenario; `file_name` appears in errors.
    ///
    /// An override `uavs.0.model=fpv5` replaces one value, or adds it with the tables around it.
    /// Its right side is TOML, or a string where it is not.
    pub fn parse(text: &str, file_name: &str, overrides: &[String]) -> Result<Self, InputError> {
        let parsed = parse(text, file_name, overrides).map_err(Faults::first);
        parsed.map(|(parsed, _)| parsed.value)
    }

    /// The stations in their order.
    pub fn stations(&self) -> Vec<ResolvedStation<'_>> {
        let one = [(&self.station, "station".to_owned())];
        let several = (self.stations.iter().enumerate())
            .map(|(index, station)| (station, format!("stations[{index}]")));
        (one.into_iter().filter(|_| self.stations.is_empty()))
            .chain(several)
            .map(|(config, place)| ResolvedStation {
                name: config.name.clone(),
                place,
                config,
                search: config.search.as_ref().unwrap_or(&self.search),
            })
            .collect()
    }

    /// How the stations are linked; `None` where they are not.
    pub fn network(&self) -> Option<NetworkConfig> {
        let several = self.stations.len() > 1;
        (self.network.clone()).or_else(|| several.then(NetworkConfig::default))
    }

    /// Names of all that flies, in the order of their indices: UAVs, then distractors.
    pub fn flying(&self) -> impl Iterator<Item = &str> {
        let uavs = self.uavs.iter().map(|uav| uav.name.as_str());
        uavs.chain(self.distractors.iter().map(|other| other.name.as_str()))
    }
}

/// A scenario, and the places in it that need a city to be found: those are put where they would be over level ground
/// at the site point.
fn parse(
    text: &str,
    file: &str,
    overrides: &[String],
) -> Result<(Parsed<Scenario>, Vec<Written>), Faults> {
    let at = Places::new(text, file, overrides);
    let (written, faults) = places::find(text, overrides, &at);
    // A scenario without a site has that error, and its places stand anywhere.
    let nowhere = Site {
        latitude_deg: 0.0,
        longitude_deg: 0.0,
        altitude_m: 0.0,
    };
    let site = places::site(text, overrides).unwrap_or_else(|| nowhere.frame());
    let spots: Vec<_> = (written.iter())
        .map(|written| (written, written.place.in_site(&site)))
        .collect();
    let (text, overrides) = places::put(text, overrides, &spots);
    let parsed = load::parse_all(&text, file, &overrides, faults)?;
    Ok((parsed, written))
}

impl Checked for Scenario {
    fn mistaken(document: &DeTable) -> Option<Mistaken> {
        Mistaken::experiment(document)
    }

    fn inherit(document: &mut DeTable) {
        let Some(DeValue::Table(common)) = document.get("station").map(|s| s.get_ref().clone())
        else {
            return;
        };
        if let Some(stations) = document.get_mut("stations")
            && let DeValue::Array(stations) = stations.get_mut()
        {
            for station in stations.iter_mut() {
                if let DeValue::Table(own) = station.get_mut() {
                    load::fill(own, &common);
                }
            }
        }
    }

    fn complete(&mut self) {
        let asset_enu_m = self.tracker.asset_enu_m;
        for (number, swarm) in self.swarms.iter().enumerate() {
            let (uavs, decoys) = swarm.members(number, asset_enu_m, self.seed);
            self.uavs.extend(uavs);
            self.distractors.extend(decoys);
        }
    }

    fn check(&self, check: &mut Check) {
        check.name("name", &self.name, &[]);
        check.positive("duration_s", self.duration_s);
        check.within("duration_s", self.duration_s, 0.0..=MAX_DURATION_S);
        check.within("tick_hz", self.tick_hz.into(), TICK_HZ);
        check.table("site", |check| self.site.check(check));
        check.table("weather", |check| self.weather.check(check));
        check.table("turbulence", |check| self.turbulence.check(check));
        check.table("city", |check| {
            for (key, value, range) in self.city.ranges() {
                check.within(key, value, range);
            }
            if let Some((key, why)) = self.city.contradiction() {
                check.that(false, key, || why);
            }
        });
        if self.stations.is_empty() {
            check.table("station", |check| {
                self.station.check(check, self.tick_hz, &self.uavs);
            });
        }
        for (index, station) in self.stations.iter().enumerate() {
            check.table(&format!("stations[{index}]"), |check| {
                station.check(check, self.tick_hz, &self.uavs);
            });
        }
        station::check_apart(&self.stations, check);
        if let Some(network) = &self.network {
            check.table("network", |check| network.check(check, self.tick_hz));
        }
        check.table("search", |check| self.search.check(check, &self.uavs));
        let mut names: Vec<&str> = Vec::new();
        for (index, swarm) in self.swarms.iter().enumerate() {
            check.table(&format!("swarms[{index}]"), |check| {
                check.name("name", &swarm.name, &names);
                swarm.check(check, self.tracker.asset_enu_m.is_some());
            });
            names.push(&swarm.name);
        }
        let (mut uavs, mut distractors) = (&self.uavs[..], &self.distractors[..]);
        if check.found_in("swarms[") {
            // Members follow from their swarm and stand behind what the file names: they would only repeat its problem.
            let own = uavs.iter().take_while(|uav| uav.member.is_none());
            uavs = &uavs[..own.count()];
            let own = distractors.iter().take_while(|other| !other.decoy);
            distractors = &distractors[..own.count()];
        }
        targets::check(uavs, distractors, check);
        check.table("detector", |check| self.detector.check(check));
        check.table("recogniser", |check| {
            self.recogniser.check(check, self.tick_hz);
        });
        check.table("tracker", |check| self.tracker.check(check));
        let stations = self.stations();
        let flying: Vec<&str> = self.flying().collect();
        let named: Vec<&str> = stations.iter().map(|station| &station.name[..]).collect();
        lights::check(&self.lights, &flying, &named, check);
        self.check_orders(&stations, check);
        check.table("controller", |check| self.controller.check(check));
        check.table("engage", |check| self.engage.check(check));
        check.table("record", |check| self.record.check(check, self.tick_hz));
        if let Some(expect) = &self.expected {
            check.table("expect", |check| expect.check(check));
        }
    }
}

/// A scenario together with the text it came from.
#[derive(Clone, Debug, PartialEq)]
pub struct Loaded {
    /// The checked scenario, overrides applied.
    pub scenario: Scenario,
    /// The scenario's text, as read.
    pub source: String,
    /// The overrides, as given.
    pub overrides: Vec<String>,
    /// The file's path, as given; of a text that is no file the path that it would have in its folder.
    pub path: PathBuf,
    /// Where the values stand in the text and the overrides.
    places: Places,
    /// Places that need a city to be found.
    written: Vec<Written>,
}

impl Loaded {
    /// Parses and checks the text of the scenario file at `path`, with overrides as for
    /// [`Scenario::parse`]; `path` is not read.
    pub fn parse(
        source: String,
        path: PathBuf,
        overrides: Vec<String>,
    ) -> Result<Self, InputError> {
        Self::parse_all(source, path, overrides).map_err(Faults::first)
    }

    /// As [`Loaded::parse`], with all errors that the text shows, in its order.
    pub fn parse_all(
        source: String,
        path: PathBuf,
        overrides: Vec<String>,
    ) -> Result<Self, Faults> {
        let file = path.display().to_string();
        Self::named(source, path, &file, overrides)
    }

    /// Parses and checks a scenario that is no file, with overrides as for [`Scenario::parse`]. Paths in it lead on from
    /// `folder`. Errors call it [`TEXT`].
    pub fn text(source: String, folder: &Path, overrides: Vec<String>) -> Result<Self, InputError> {
        Self::named(source, folder.join(TEXT), TEXT, overrides).map_err(Faults::first)
    }

    fn named(
        source: String,
        path: PathBuf,
        file: &str,
        overrides: Vec<String>,
    ) -> Result<Self, Faults> {
        let (Parsed { value, places }, written) = parse(&source, file, &overrides)?;
        Ok(Self {
            scenario: value,
            source,
            overrides,
            path,
            places,
            written,
        })
    }

    /// The weather, the pressure at the site [Pa] and the sun above it.
    pub fn weather_and_sun(&self) -> Result<(Weather, f64, Sun), InputError> {
        let scenario = &self.scenario;
        let weather =
            (scenario.weather.resolved()).map_err(|error| self.refuse("weather.metar", error))?;
        let pressure_pa = pressure_at_pa(weather.pressure_pa, scenario.site.altitude_m);
        let (time, site) = (&scenario.time_utc, scenario.site.frame());
        let sun = Sun::new(time, site.origin(), pressure_pa, weather.temperature_k)
            .map_err(|error| self.refuse("time_utc", error))?;
        Ok((weather, pressure_pa, sun))
    }

    /// The scenario with its places by latitude and longitude, above ground and roofs, where `place` says they are
    /// [m, ENU]; `None` where it has none of these.
    pub fn placed(
        &self,
        place: impl Fn(&GivenPlace) -> Result<DVec3, String>,
    ) -> Result<Option<Self>, InputError> {
        if self.written.is_empty() {
            return Ok(None);
        }
        let file = self.places.file();
        let at = Places::new(&self.source, file, &self.overrides);
        let found = |written| -> Result<(&Written, DVec3), InputError> {
            let written: &Written = written;
            let spot = place(&written.place).map_err(|why| written.refuse(&at, &why))?;
            Ok((written, spot))
        };
        let spots: Vec<_> = self.written.iter().map(found).collect::<Result<_, _>>()?;
        let (text, overrides) = places::put(&self.source, &self.overrides, &spots);
        let Parsed { value, places } = load::parse(&text, file, &overrides)?;
        Ok(Some(Self {
            scenario: value,
            places,
            written: Vec::new(),
            source: self.source.clone(),
            overrides: self.overrides.clone(),
            path: self.path.clone(),
        }))
    }

    /// The error for the value at `path`, such as `station.mount`, that a part of the run refuses.
    ///
    /// It names the line of the value, or of the innermost table around it that stands in the
    /// file, or the override that gave it.
    pub fn refuse(&self, path: &str, message: impl fmt::Display) -> InputError {
        self.places.refuse(path, message)
    }

    /// Warnings of values by their paths, each with what is wrong and what mends it: with their lines, in the file's order.
    pub fn warnings(&self, said: Vec<[String; 3]>) -> Vec<Warning> {
        self.places.warnings(said)
    }
}
