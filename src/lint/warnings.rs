//! What a scenario may hold and what makes no sense in it.

use std::f64::consts::PI;

use glam::DVec3;

use super::{Body, Flown, Scene, Seeing, times_s};
use crate::models::air::atmosphere::transmittance;
use crate::models::engage::outcome::Outcome;
use crate::models::laser::beam::{Laser, power_in_bucket_w};
use crate::models::laser::range_finder::{LitSurface, REFLECTANCE, RangeFinderParams};
use crate::models::laser::target::{CHAR_ABSORPTIVITY, FAILS_RADIUS_M};
use crate::scenario::{Bound, Focus, SkinKind, TRUTH};
use crate::warning::Warning;

/// A speed this much above a kind's greatest is no slip of rounding or of a corner.
const SPEED_MARGIN: f64 = 1.1;
/// A flight is followed so many times as long as the run, to tell what a longer one would show, but no longer than
/// [`LATEST_S`].
const LONGER: f64 = 20.0;
/// Latest time at which a flight is followed beyond the run's end [s].
const LATEST_S: f64 = 1_800.0; // [s]
/// Below this elevation of the sun [deg] no daylight is left on the ground: the end of civil twilight.
const DARK_DEG: f64 = -6.0;
/// What fills less than this of a pixel is not to be found [px].
const LEAST_PX: f64 = 1.0;

/// What is possible but senseless, in the file's order.
pub fn warnings(scene: &Scene<'_>) -> Vec<Warning> {
    let mut lint = Lint {
        stations: scene.stations(),
        uavs: scene.uavs(),
        distractors: scene.distractors(),
        times_s: scene.times_s(),
        scene,
        found: Vec::new(),
    };
    lint.speeds();
    lint.starts();
    lint.crashes();
    lint.sights();
    lint.sectors();
    lint.duration();
    lint.darkness();
    lint.lasers();
    lint.orders();
    lint.expectations();
    scene.loaded.warnings(lint.found)
}

struct Lint<'a> {
    scene: &'a Scene<'a>,
    stations: Vec<Seeing<'a>>,
    uavs: Vec<Flown>,
    distractors: Vec<Flown>,
    times_s: Vec<f64>,
    /// Path of a value, what is wrong with it, what mends it.
    found: Vec<[String; 3]>,
}

impl Lint<'_> {
    fn warn(&mut self, path: impl ToString, what: impl ToString, mend: impl ToString) {
        let warning = [path.to_string(), what.to_string(), mend.to_string()];
        // Members of a swarm share what is wrong with them.
        if !self
            .found
            .iter()
            .any(|[path, what, _]| [path, what] == [&warning[0], &warning[1]])
        {
            self.found.push(warning);
        }
    }

    /// What flies faster than its kind can.
    fn speeds(&mut self) {
        let wind_enu_mps = self.scene.wind_enu_mps();
        let mut found = Vec::new();
        for flown in self.uavs.iter().chain(&self.distractors) {
            let through_air = |t_s: &f64| {
                let v_enu_mps = flown.plan.sample(*t_s).v_enu_mps;
                let wind = if flown.drifts {
                    DVec3::ZERO
                } else {
                    wind_enu_mps
                };
                [v_enu_mps.length(), (v_enu_mps - wind).length()]
            };
            // What a head wind or a tail wind makes too fast is no slip.
            let fastest = (self.times_s.iter().map(through_air))
                .max_by(|a, b| a[0].min(a[1]).total_cmp(&b[0].min(b[1])));
            let Some([ground_mps, air_mps]) = fastest else {
                continue;
            };
            let (kind, most_mps) = match &flown.body {
                Body::Uav(model, _) => (model.name.as_str(), model.v_max_mps),
                Body::Distractor(kind) => (kind.name(), kind.v_max_mps()),
            };
            if ground_mps.min(air_mps) <= SPEED_MARGIN * most_mps {
                continue;
            }
            let key = match flown.swarm() {
                Some(_) => "speed_mps",
                None => "trajectory",
            };
            let what = format!(
                "'{}' flies {ground_mps:.0} m/s, {air_mps:.0} m/s through the air, and a {kind} reaches {most_mps:.0} m/s at most",
                swarm_or_name(flown)
            );
            let mend = "lower the speed of the path, or choose what flies as fast";
            found.push((format!("{}.{key}", flown.place), what, mend));
        }
        for (path, what, mend) in found {
            self.warn(path, what, mend);
        }
    }

    /// What begins in something solid, or where nobody looks.
    fn starts(&mut self) {
        let dsm = &self.scene.city.dsm;
        let surface = dsm.surface();
        let mut found = Vec::new();
        for flown in self.uavs.iter().chain(&self.distractors) {
            // A swarm's members are put above ground and on their pads.
            if flown.swarm().is_some() {
                continue;
            }
            let path = format!("{}.trajectory", flown.place);
            let r = flown.at(0.0);
            let under_m = dsm.terrain_m(r.x, r.y) - r.z;
            let roof_m = dsm.surface_m(r.x, r.y);
            let raise = "raise it, or give the place as { east_m = ..., north_m = ..., height_m = ..., above = \"roof\" }";
            if under_m > 0.0 {
                let what = format!("'{}' begins {under_m:.1} m below the ground", flown.name);
                found.push((path, what, raise));
            } else if dsm.inside(r) {
                let what = format!(
                    "'{}' begins {:.1} m up, below what reaches up to {roof_m:.1} m there",
                    flown.name, r.z
                );
                found.push((path, what, raise));
            } else if matches!(flown.body, Body::Uav(..))
                && surface.cell_index(r.x, r.y).is_none()
                && !self.stations.iter().any(|station| looks_at(station, r))
            {
                let what = format!(
                    "'{}' begins outside the city, which is {:.0} m by {:.0} m, and outside every search sector",
                    flown.name,
                    surface.nx as f64 * surface.cell_m,
                    surface.ny as f64 * surface.cell_m
                );
                let mend = "move its start, or turn [search] towards it";
                found.push((path, what, mend));
            }
        }
        for (path, what, mend) in found {
            self.warn(path, what, mend);
        }
    }

    /// Paths that lead into the city; what has come to the asset before may fall on it.
    fn crashes(&mut self) {
        let dsm = &self.scene.city.dsm;
        let tracker = &self.scene.loaded.scenario.tracker;
        let arrived = |r_enu_m: DVec3| {
            let asset = tracker.asset_enu_m.map(DVec3::from_array);
            asset.is_some_and(|asset| r_enu_m.distance(asset) <= tracker.asset_radius_m)
        };
        let mut found = Vec::new();
        for flown in &self.uavs {
            if flown.swarm().is_some() || dsm.inside(flown.at(0.0)) {
                continue;
            }
            let hit = (self.times_s.windows(2).map(|pair| [pair[0], pair[1]]))
                .take_while(|[from_s, _]| !arrived(flown.at(*from_s)))
                .find(|[from_s, to_s]| dsm.meets(flown.at(*from_s), flown.at(*to_s)));
            if let Some([_, t_s]) = hit {
                let r = flown.at(t_s);
                let what = format!(
                    "the path of '{}' leads into the city after {t_s:.1} s, at {:.0} m east, {:.0} m north, {:.0} m up, where it reaches up to {:.0} m",
                    flown.name,
                    r.x,
                    r.y,
                    r.z,
                    dsm.surface_m(r.x, r.y)
                );
                found.push((format!("{}.trajectory", flown.place), what));
            }
        }
        for (path, what) in found {
            self.warn(
                path,
                what,
                "raise the path or lead it around, or end the run before",
            );
        }
    }

    /// What no camera can show, and what is hidden as long as the run lasts.
    fn sights(&mut self) {
        let mut found = Vec::new();
        for flown in &self.uavs {
            let mut largest = (0.0, 0.0);
            let mut nearest_m = f64::INFINITY;
            for t_s in &self.times_s {
                for seeing in &self.stations {
                    let view = seeing.view(flown.at(*t_s));
                    nearest_m = f64::min(nearest_m, view.range_m);
                    for camera in seeing.station.config.cameras.all() {
                        let size_px = view.size_px(flown.size_m(), &camera.config);
                        if size_px > largest.0 {
                            largest = (size_px, view.range_m);
                        }
                    }
                }
            }
            let who = swarm_or_name(flown);
            let key = match flown.swarm() {
                Some(_) => flown.place.clone(),
                None => format!("{}.trajectory", flown.place),
            };
            if largest.0 < LEAST_PX {
                let what = format!(
                    "'{who}' comes no nearer than {nearest_m:.0} m, where it fills {:.2} px of the finest camera",
                    largest.0
                );
                found.push((
                    key,
                    what,
                    "lead it nearer, or give a camera a narrower hfov_deg",
                ));
                continue;
            }
            let seen_by = |t_s: &f64| {
                let r = flown.at(*t_s);
                self.stations
                    .iter()
                    .any(|seeing| self.scene.clear(seeing.r_enu_m, r))
            };
            if self.times_s.iter().any(seen_by) {
                continue;
            }
            let duration_s = self.scene.loaded.scenario.duration_s;
            let later_s = times_s(
                duration_s,
                (LONGER * duration_s).min(LATEST_S.max(duration_s)),
            );
            match later_s.iter().find(|t_s| seen_by(t_s)) {
                Some(t_s) => {
                    let what = format!(
                        "the run ends after {duration_s:.0} s, before any station has a clear sight of '{who}', after {t_s:.0} s"
                    );
                    found.push((
                        "duration_s".to_owned(),
                        what,
                        "let the run last longer, or begin the flight nearer",
                    ));
                }
                None => {
                    let what = format!(
                        "no station has a clear sight of '{who}' in the whole run: the city or cloud hides it"
                    );
                    found.push((key, what, "raise its path, or move the station"));
                }
            }
        }
        for (path, what, mend) in found {
            self.warn(path, what, mend);
        }
    }

    /// Search sectors in which none of the UAVs ever is.
    fn sectors(&mut self) {
        if self.uavs.is_empty() || self.stations.iter().any(|s| s.station.search.cue.is_some()) {
            return;
        }
        let mut found = Vec::new();
        for flown in &self.uavs {
            let ever = (self.times_s.iter())
                .any(|t_s| self.stations.iter().any(|s| looks_at(s, flown.at(*t_s))));
            if ever {
                continue;
            }
            let Some(seeing) = self.stations.first() else {
                continue;
            };
            let [from, to] = [0.0, self.scene.loaded.scenario.duration_s]
                .map(|t_s| seeing.view(flown.at(t_s)).az_el_deg());
            let what = format!(
                "the sector never contains '{}', which goes from azimuth {:.0}°, elevation {:.0}° to {:.0}°, {:.0}°",
                swarm_or_name(flown),
                from[0],
                from[1],
                to[0],
                to[1]
            );
            let path = match seeing.station.config.search {
                Some(_) => format!("{}.search", seeing.station.place),
                None => "search".to_owned(),
            };
            found.push((path, what));
        }
        for (path, what) in found {
            self.warn(
                path,
                what,
                "turn or widen the sector, or give it a radar's cue",
            );
        }
    }

    /// Runs that end before the asset is reached.
    fn duration(&mut self) {
        let scenario = &self.scene.loaded.scenario;
        let Some(asset) = scenario.tracker.asset_enu_m.map(DVec3::from_array) else {
            return;
        };
        let (radius_m, duration_s) = (scenario.tracker.asset_radius_m, scenario.duration_s);
        let reaches = |flown: &Flown, t_s: f64| flown.at(t_s).distance(asset) <= radius_m;
        let later_s = times_s(
            duration_s,
            (LONGER * duration_s).min(LATEST_S.max(duration_s)),
        );
        let mut firsts = Vec::new();
        for flown in &self.uavs {
            if self.times_s.iter().any(|t_s| reaches(flown, *t_s)) {
                return;
            }
            firsts.extend(later_s.iter().copied().find(|t_s| reaches(flown, *t_s)));
        }
        if let Some(first_s) = firsts.into_iter().min_by(f64::total_cmp) {
            let what = format!(
                "the run ends after {duration_s:.0} s, before any UAV could reach the asset, after {first_s:.0} s"
            );
            self.warn(
                "duration_s",
                what,
                "let the run last longer, or begin the flights nearer",
            );
        }
    }

    /// Cameras of visible light where there is none.
    fn darkness(&mut self) {
        let elevation_deg = self
            .scene
            .sun_dir_enu
            .z
            .clamp(-1.0, 1.0)
            .asin()
            .to_degrees();
        let scenario = &self.scene.loaded.scenario;
        let looks = scenario.detector.kind != TRUTH && !self.uavs.is_empty();
        if looks && elevation_deg < DARK_DEG {
            let what = format!(
                "the sun stands {:.0}° below the horizon, and every camera sees visible light only",
                -elevation_deg
            );
            let mend = "choose a time of day, or expect little: the detector sees what city light and noise leave";
            self.warn("time_utc", what, mend);
        }
    }

    /// Lasers that never heat a skin to its limit.
    fn lasers(&mut self) {
        let scenario = &self.scene.loaded.scenario;
        let may_fire = scenario.engage.authorised
            || scenario
                .operator
                .iter()
                .any(|order| order.fire == Some(true));
        if !may_fire || self.uavs.is_empty() {
            return;
        }
        let (mut found, mut silent) = (Vec::new(), Vec::new());
        for seeing in &self.stations {
            let power_w = seeing.station.config.laser.power_w;
            // None at all is meant so.
            if power_w <= 0.0 {
                continue;
            }
            let nearest = (self.uavs.iter())
                .filter_map(|flown| self.echo(seeing, flown))
                .max_by(|a, b| a.0.total_cmp(&b.0));
            if let Some((_, range_m, name)) = nearest.filter(|nearest| nearest.0 < 1.0) {
                let path = match scenario.stations.is_empty() {
                    true => "station.position_enu_m".to_owned(),
                    false => format!("{}.position_enu_m", seeing.station.place),
                };
                silent.push((path, format!(
                    "no UAV gives the range finder an echo, without which no laser fires: '{name}' comes to {range_m:.0} m at best"
                )));
                continue;
            }
            let best = (self.uavs.iter())
                .filter_map(|flown| self.heated(seeing, flown))
                .max_by(|a, b| a.0.total_cmp(&b.0));
            let Some((share, range_m, name)) = best.filter(|best| best.0 < 1.0) else {
                continue;
            };
            let path = match scenario.stations.is_empty() {
                true => "station.laser.power_w".to_owned(),
                false => format!("{}.laser.power_w", seeing.station.place),
            };
            let what = format!(
                "{power_w} W bring nothing down: held on '{name}' at {range_m:.0} m from its first sight to the end, they bring {:.0} % of the energy that destroys it",
                100.0 * share
            );
            found.push((path, what));
        }
        for (path, what) in silent {
            self.warn(
                path,
                what,
                "lead the flight nearer, move the station, or clear the air",
            );
        }
        for (path, what) in found {
            self.warn(
                path,
                what,
                "raise the power or the visibility, lead the flight nearer, let the run last longer, or set engage.authorised = false for a run that only tracks",
            );
        }
    }

    /// How much stronger than it must be the echo of a UAV is at its nearest after it is first seen, with that range [m] and its name.
    /// None where it is never seen.
    fn echo(&self, seeing: &Seeing<'_>, flown: &Flown) -> Option<(f64, f64, String)> {
        let Body::Uav(model, _) = &flown.body else {
            return None;
        };
        let range_m = self.nearest_m(seeing, flown)?.1;
        let [_, width_m, height_m] = model.size_m;
        let finder = RangeFinderParams::default();
        let surface = LitSurface {
            range_m,
            share: finder.share(width_m * height_m, range_m, 0.0),
            reflectance: REFLECTANCE,
        };
        let extinction_per_m = self.scene.weather.extinction_per_m(finder.wavelength_m);
        let margin = finder.margin(&surface, extinction_per_m);
        Some((margin, range_m, flown.name.clone()))
    }

    /// When a UAV is first seen [s], and how near it comes from then on [m].
    fn nearest_m(&self, seeing: &Seeing<'_>, flown: &Flown) -> Option<(f64, f64)> {
        let first = (self.times_s.iter().copied())
            .find(|t_s| self.scene.clear(seeing.r_enu_m, flown.at(*t_s)))?;
        let after = self.times_s.iter().filter(|t_s| **t_s >= first);
        let range_m = after.map(|t_s| seeing.view(flown.at(*t_s)).range_m);
        Some((first, range_m.fold(f64::INFINITY, f64::min).max(1.0)))
    }

    /// How much of the energy that destroys a UAV a station's laser could bring: held on it at its nearest from the first
    /// sight on, without turbulence, jitter and losses. None where it is never seen.
    fn heated(&self, seeing: &Seeing<'_>, flown: &Flown) -> Option<(f64, f64, String)> {
        let scenario = &self.scene.loaded.scenario;
        let Body::Uav(model, _) = &flown.body else {
            return None;
        };
        let (first, range_m) = self.nearest_m(seeing, flown)?;
        let config = &seeing.station.config.laser;
        let laser = Laser {
            power_w: config.power_w,
            wavelength_m: 1e-9 * config.wavelength_nm,
            aperture_radius_m: config.aperture_radius_m,
            m2: config.m2,
        };
        let focus_m = match config.focus {
            Focus::Metres(focus_m) => focus_m,
            Focus::Target(_) => range_m,
        };
        let extinction_per_m = self.scene.weather.extinction_per_m(laser.wavelength_m);
        let power_w = laser.power_w * transmittance(extinction_per_m, range_m);
        let spot_m = laser.spot_radius_m(range_m, focus_m);
        let within_w = power_in_bucket_w(power_w, spot_m, 0.0, FAILS_RADIUS_M);
        let irradiance_wpm2 = within_w / (PI * FAILS_RADIUS_M.powi(2));
        let skin = (scenario.uavs.iter().find(|uav| uav.name == flown.name))
            .and_then(|uav| uav.skin)
            .map_or_else(|| model.part_skin(scenario.engage.aim), SkinKind::skin);
        let air_k = self.scene.weather.temperature_k;
        let lasts_s = (scenario.duration_s - first).max(0.0);
        let energy_jpm2 = CHAR_ABSORPTIVITY * irradiance_wpm2 * lasts_s;
        let share = energy_jpm2 / skin.energy_jpm2(air_k).max(1.0);
        Some((share, range_m, flown.name.clone()))
    }

    /// Orders that never come due.
    fn orders(&mut self) {
        let scenario = &self.scene.loaded.scenario;
        for (index, order) in scenario.operator.iter().enumerate() {
            if order.t_s > scenario.duration_s {
                let what = format!(
                    "{} s is after the end of the run, {} s",
                    order.t_s, scenario.duration_s
                );
                self.warn(
                    format!("operator[{index}].t_s"),
                    what,
                    "give the order earlier, or let the run last longer",
                );
            }
        }
    }

    /// Expectations that no run can meet.
    fn expectations(&mut self) {
        let scenario = &self.scene.loaded.scenario;
        let Some(expect) = &scenario.expected else {
            return;
        };
        let mut claims = vec![("expect".to_owned(), expect.outcome, &expect.values)];
        let shares = expect.shares.iter().enumerate();
        claims.extend(shares.map(|(index, share)| {
            (
                format!("expect.shares[{index}]"),
                share.outcome,
                &share.values,
            )
        }));
        let mut found = Vec::new();
        for (table, outcome, values) in claims {
            if let Some(why) = outcome.and_then(|outcome| self.never_ends(outcome)) {
                found.push((format!("{table}.outcome"), why));
            }
            for (key, bound) in values {
                let contradicts = outcome.and_then(|outcome| contradicts(outcome, key, bound));
                if let Some(why) = self.never_met(key, bound).or(contradicts) {
                    found.push((format!("{table}.values.{key}"), why));
                }
            }
        }
        for (path, what) in found {
            self.warn(path, what, "correct what is expected, or the scenario");
        }
    }

    /// Why no run ends so.
    fn never_ends(&self, outcome: Outcome) -> Option<String> {
        let scenario = &self.scene.loaded.scenario;
        let word = outcome.name();
        let shot = matches!(outcome, Outcome::Neutralised | Outcome::PartlyNeutralised);
        let armed = self
            .stations
            .iter()
            .any(|s| s.station.config.laser.power_w > 0.0);
        let may_fire = scenario.engage.authorised
            || scenario
                .operator
                .iter()
                .any(|order| order.fire == Some(true));
        match outcome {
            Outcome::NotAcquired => None,
            _ if self.uavs.is_empty() && outcome != Outcome::Tracked => {
                Some(format!("no run ends {word} without UAVs"))
            }
            _ if shot && !may_fire => Some(format!(
                "no run ends {word} while engage.authorised is false"
            )),
            _ if shot && !armed => Some(format!("no run ends {word} without a laser's power")),
            Outcome::PartlyNeutralised if self.uavs.len() == 1 => {
                Some(format!("one UAV alone is never {word}"))
            }
            _ => None,
        }
    }

    /// Why a bound is never met.
    fn never_met(&self, key: &str, bound: &Bound) -> Option<String> {
        let duration_s = self.scene.loaded.scenario.duration_s;
        let name = key.rsplit('.').next().unwrap_or(key);
        // Figures of these kinds are never negative; times lie within the run.
        let counts = ["leakers", "count", "energy_j"].contains(&name);
        let time = name.ends_with("_s");
        // These are summed over the stations.
        let summed = ["dwell_s", "distractor_s", "keep_out_s", "wrong_object_s"].contains(&name);
        let stations = if summed {
            self.scene.stations().len().max(1)
        } else {
            1
        };
        let most_s = duration_s * stations as f64;
        let least = bound.at_least.filter(|least| time && *least > most_s);
        if let Some(least) = least {
            return Some(match stations {
                1 => format!("at_least = {least} s is beyond the end of the run, {duration_s} s"),
                n => {
                    format!("at_least = {least} s is more than {n} stations have in {duration_s} s")
                }
            });
        }
        let most = bound.at_most.filter(|most| (counts || time) && *most < 0.0);
        most.map(|most| format!("at_most = {most}, and it is never below 0"))
    }
}

/// Why a bound and an outcome exclude each other.
fn contradicts(outcome: Outcome, key: &str, bound: &Bound) -> Option<String> {
    let bounded =
        bound.at_least.is_some() || bound.at_most.is_some() || bound.present == Some(true);
    let absent = bound.present == Some(false);
    let why = |has: &str| Some(format!("a run that ends {} {has} it", outcome.name()));
    match (outcome, key) {
        (Outcome::NotAcquired, "time_to_acquire_s" | "time_to_neutralise_s") if bounded => {
            why("lacks")
        }
        (Outcome::Tracked | Outcome::Crashed, "time_to_neutralise_s") if bounded => why("lacks"),
        (Outcome::Neutralised, "time_to_acquire_s" | "time_to_neutralise_s") if absent => {
            why("has")
        }
        _ => None,
    }
}

/// The name of what flies, or of the swarm whose member it is.
fn swarm_or_name(flown: &Flown) -> &str {
    match flown.swarm() {
        // Members are called after the swarm and their number.
        Some(_) => flown
            .name
            .rsplit_once('_')
            .map_or(&flown.name, |(swarm, _)| swarm),
        None => &flown.name,
    }
}

/// Whether a point [m, enu] lies in a station's search sector, with half the widest camera's field around; a radar's cue leads
/// the search anywhere.
fn looks_at(seeing: &Seeing<'_>, r_enu_m: DVec3) -> bool {
    let search = seeing.station.search;
    if search.cue.is_some() {
        return true;
    }
    let cameras = seeing.station.config.cameras.all();
    let field_deg = cameras
        .iter()
        .map(|camera| camera.config.hfov_deg)
        .fold(0.0, f64::max);
    let [az_deg, el_deg] = seeing.view(r_enu_m).az_el_deg();
    let off_deg = (az_deg - search.centre_azimuth_deg + 180.0).rem_euclid(360.0) - 180.0;
    off_deg.abs() <= 0.5 * (search.width_deg + field_deg)
        && (el_deg - search.elevation_deg).abs() <= 0.5 * (search.height_deg + field_deg)
}
