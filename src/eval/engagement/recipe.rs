//! The recipe of an evaluation: which engagements are drawn, in which shares and ranges.

use crate::models::air::weather::Weather;
use crate::models::flight::distractor::DistractorKind;
use crate::models::ground::city::JUDGED_SEEDS;
use crate::models::maths::rng::Stream;
use crate::scenario::check::{Check, FRACTION};
use crate::scenario::load::{self, Checked};
use crate::scenario::{Backstop, CueKind, Engage, InputError, Site, catalogue};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// How often each of several things is drawn; the shares need not add up to 1, and what is not named is
/// never drawn.
pub type Shares<T> = BTreeMap<T, f64>;

/// A recipe.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// What it is for, for people.
    #[serde(default)]
    pub description: String,
    /// What the engagements are for.
    pub purpose: Purpose,
    /// Longest engagement [s]; one ends earlier when its UAV is neutralised.
    pub duration_s: f64,
    /// The origin of the local frame.
    pub site: Site,
    /// Number of cities, and of woods, that engagements take place in: from the first on of those that are for the purpose.
    pub places: u32,
    /// Real cities among them.
    #[serde(default)]
    pub real: RealDraw,
    /// Height of the station's mast above the ground of woods [m].
    pub mast_m: f64,
    /// The UAV.
    pub uav: UavDraw,
    /// What stands behind the UAV.
    pub backgrounds: Shares<Background>,
    /// Where the sun stands.
    pub light: Shares<Light>,
    /// Weather reports, visibility and clouds.
    pub weather: WeatherDraw,
    /// Where the station looks.
    pub search: SearchDraw,
    /// What else flies.
    pub distractors: DistractorDraw,
    /// Rules of fire, of which each engagement has one.
    pub rules: Vec<Rules>,
}

/// What engagements are for. Networks learn from other cities and airframes than those by which they are judged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Purpose {
    /// To judge by: generated cities are those kept for it ([`JUDGED_SEEDS`]).
    Judging,
    /// To learn from: cities are others, and no UAV is held out.
    Learning,
}

impl Purpose {
    /// Seed of the first city that is for it.
    pub fn first_seed(self) -> u64 {
        match self {
            Self::Judging => JUDGED_SEEDS.start,
            Self::Learning => 1,
        }
    }
}

/// Most places that a recipe may have: as many cities lie before those that are kept for judging.
const MOST_PLACES: u64 = JUDGED_SEEDS.start - 1;

/// Real cities.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RealDraw {
    /// Share of the engagements that take place in one.
    pub share: f64,
    /// Scenarios, all equally likely, whose site, city and place of the station are taken.
    pub scenarios: Vec<PathBuf>,
}

/// The UAV and its flight.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UavDraw {
    /// Models as a scenario names them, all equally likely.
    pub models: Vec<String>,
    /// Share of the engagements with one of those models that are held out; absent: as many as there are.
    pub held_out: Option<f64>,
    /// Nearest and farthest range at the start, even over its logarithm [m].
    pub range_m: [f64; 2],
    /// Slowest and fastest flight; no model flies faster than 0.7 of its greatest speed [m/s].
    pub speed_mps: [f64; 2],
    /// How it flies.
    pub flights: Shares<Flight>,
}

/// How a UAV flies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Flight {
    /// Straight, more across the line of sight than along it.
    Crossing,
    /// Straight towards the station, within 30°.
    Approach,
    /// To and fro about a straight line.
    Weave,
    /// A level circle.
    Orbit,
    /// In one place.
    Hover,
    /// Round three corners.
    Waypoints,
    /// Rises from behind something and hovers.
    PopUp,
}

/// What stands behind the UAV.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Background {
    /// Nothing but sky, a degree below it too.
    Sky,
    /// Buildings or the ground between them.
    City,
    /// Trees and fields.
    Woods,
}

/// Where the sun stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Light {
    /// 15 to 60° high.
    Day,
    /// 2 to 12° high.
    LowSun,
    /// From 5° below to 1° above the horizon.
    Dusk,
}

impl Light {
    /// Lowest and highest sun [deg].
    pub fn elevation_deg(self) -> [f64; 2] {
        match self {
            Self::Day => [15.0, 60.0],
            Self::LowSun => [2.0, 12.0],
            Self::Dusk => [-5.0, 1.0],
        }
    }
}

/// The weather.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WeatherDraw {
    /// Bodies of METARs, from the wind on, all equally likely.
    pub reports: Vec<String>,
    /// Worst and best visibility where a report says 10 km or more, even over its logarithm [m].
    pub visibility_m: [f64; 2],
    /// Share of the engagements whose clouds show as clouds.
    pub cloud_texture: f64,
}

/// Where the station looks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SearchDraw {
    /// Share of the engagements that a radar cues.
    pub cued: f64,
    /// What the radar's plots come from.
    #[serde(default)]
    pub cue_kind: CueKind,
    /// Best and worst standard deviation of the radar's direction [deg].
    pub cue_sigma_deg: [f64; 2],
    /// Narrowest and widest sector of an uncued search [deg].
    pub width_deg: [f64; 2],
    /// Lowest and highest sector [deg].
    pub height_deg: [f64; 2],
}

/// What else flies.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DistractorDraw {
    /// How near to the UAV something else flies, if at all.
    pub nearness: Shares<Nearness>,
    /// Least and greatest angle from the UAV of what is near, even over its logarithm [deg].
    pub near_deg: [f64; 2],
    /// The same of what is far [deg].
    pub far_deg: [f64; 2],
    /// What it is.
    #[serde(default)]
    pub kinds: Vec<KindDraw>,
}

/// How near to the UAV something else flies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Nearness {
    /// Nothing else flies.
    None,
    /// Something flies in another part of the picture, or outside it.
    Far,
    /// Something flies beside the UAV.
    Near,
}

/// A kind of distractor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KindDraw {
    /// Name in the figures.
    pub name: String,
    /// What it is.
    pub kind: DistractorKind,
    /// Share among the kinds.
    pub share: f64,
    /// Fewest and most of them.
    pub count: [u32; 2],
    /// Standard deviation of their places about their middle, each axis [m].
    pub spread_m: f64,
    /// Nearest and farthest range, even over its logarithm [m].
    pub range_m: [f64; 2],
    /// Slowest and fastest flight; what has no speed of its own keeps its place in the air [m/s].
    pub speed_mps: [f64; 2],
}

/// Rules of fire: what may lie behind the target. What they leave out is as in a scenario that says nothing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rules {
    /// Name in the figures.
    pub name: String,
    /// Share of the engagements that have them.
    pub share: f64,
    /// As in a scenario.
    #[serde(default = "default_backstop")]
    pub allow_backstop: Vec<Backstop>,
    /// As in a scenario [m].
    #[serde(default = "default_clear_m")]
    pub min_clear_range_m: f64,
}

fn default_backstop() -> Vec<Backstop> {
    Engage::default().allow_backstop
}

fn default_clear_m() -> f64 {
    Engage::default().min_clear_range_m
}

impl Rules {
    /// In a line, for people.
    pub fn text(&self) -> String {
        let words = |backstop: &Backstop| match backstop {
            Backstop::Sky => "sky",
            Backstop::Ground => "ground",
            Backstop::Building => "building",
        };
        let behind: Vec<&str> = self.allow_backstop.iter().map(words).collect();
        let far = match self.allow_backstop.iter().all(|b| *b == Backstop::Sky) {
            true => String::new(),
            false => format!(" {} m behind the target", self.min_clear_range_m),
        };
        format!("{}: {}{far}", self.name, behind.join(", "))
    }
}

/// All of a recipe's UAVs are held out.
#[derive(Debug, thiserror::Error)]
#[error("uav.models: all are kept for judging; name one that may be learned from")]
pub struct NothingToLearn;

/// No rules of a recipe have a name that was asked for.
#[derive(Debug, thiserror::Error)]
#[error("--rules: the recipe has no `{name}`; it has {}", .names.join(", "))]
pub struct NoSuchRules {
    name: String,
    names: Vec<String>,
}

impl Recipe {
    /// Reads and checks a recipe file.
    pub fn load(path: &Path) -> Result<Self, InputError> {
        let path = crate::data::found(path);
        Self::parse(&load::read(&path)?, &path.display().to_string())
    }

    /// The recipe with the rules of this name alone, which leaves everything else as it is drawn.
    pub fn under(mut self, name: &str) -> Result<Self, NoSuchRules> {
        let Some(rules) = self.rules.iter().find(|rules| rules.name == name) else {
            return Err(NoSuchRules {
                name: name.to_owned(),
                names: self.rules.into_iter().map(|rules| rules.name).collect(),
            });
        };
        self.rules = vec![Rules {
            share: 1.0,
            ..rules.clone()
        }];
        Ok(self)
    }

    /// The recipe with cities and UAVs that may be learned from.
    pub fn to_learn_from(mut self) -> Result<Self, NothingToLearn> {
        let known = self.uav.which(false).into_iter().map(str::to_owned);
        let models: Vec<String> = known.collect();
        if models.is_empty() {
            return Err(NothingToLearn);
        }
        self.purpose = Purpose::Learning;
        self.real = RealDraw::default();
        self.uav.models = models;
        self.uav.held_out = None;
        Ok(self)
    }

    /// Reads and checks a recipe; `file` is named in errors.
    pub fn parse(text: &str, file: &str) -> Result<Self, InputError> {
        load::parse(text, file, &[]).map(|parsed| parsed.value)
    }
}

/// A whole METAR: a body, from the wind on, and day, hour and minute such as `171230`.
pub fn metar(body: &str, time: &str) -> String {
    // ICAO's letters for a place without a location indicator.
    format!("ZZZZ {time}Z {body}")
}

/// One of several things, in the proportions of their shares; `shares` must not be empty.
pub fn drawn<T: Copy>(shares: impl IntoIterator<Item = (T, f64)>, rng: &mut Stream) -> Option<T> {
    let shares: Vec<(T, f64)> = shares.into_iter().filter(|(_, s)| *s > 0.0).collect();
    let mut rest = rng.uniform() * shares.iter().map(|(_, share)| share).sum::<f64>();
    let chosen = shares.iter().find(|(_, share)| {
        rest -= share;
        rest < 0.0
    });
    chosen.or(shares.last()).map(|(thing, _)| *thing)
}

/// Ranges of distances [m].
const DISTANCE_M: std::ops::RangeInclusive<f64> = 10.0..=30_000.0;

impl Checked for Recipe {
    fn check(&self, check: &mut Check) {
        check.within("duration_s", self.duration_s, 0.5..=600.0);
        check.table("site", |check| {
            check.within("latitude_deg", self.site.latitude_deg, -65.0..=65.0);
            check.within("longitude_deg", self.site.longitude_deg, -180.0..=180.0);
            check.within("altitude_m", self.site.altitude_m, -500.0..=9000.0);
        });
        check.within("places", self.places.into(), 1.0..=MOST_PLACES as f64);
        check.table("real", |check| self.real.check(check, self.purpose));
        check.within("mast_m", self.mast_m, 5.0..=200.0);
        check.table("uav", |check| self.uav.check(check, self.purpose));
        check_shares(check, "backgrounds", self.backgrounds.values());
        check_shares(check, "light", self.light.values());
        check.table("weather", |check| {
            not_empty(check, "reports", self.weather.reports.len());
            for (index, report) in self.weather.reports.iter().enumerate() {
                if let Err(error) = Weather::from_metar(&metar(report, "011200")) {
                    let key = format!("reports[{index}]");
                    check.that(false, &key, || error.to_string());
                }
            }
            check.not_descending("visibility_m", self.weather.visibility_m, 100.0..=200_000.0);
            check.within("cloud_texture", self.weather.cloud_texture, FRACTION);
        });
        check.table("search", |check| {
            check.within("cued", self.search.cued, FRACTION);
            check.not_descending("cue_sigma_deg", self.search.cue_sigma_deg, 0.0..=20.0);
            check.not_descending("width_deg", self.search.width_deg, 1.0..=360.0);
            check.not_descending("height_deg", self.search.height_deg, 1.0..=90.0);
        });
        check.table("distractors", |check| self.distractors.check(check));
        check_shares(check, "rules", self.rules.iter().map(|rules| &rules.share));
        for (index, rules) in self.rules.iter().enumerate() {
            let again = self.rules[..index].iter().any(|r| r.name == rules.name);
            check.table(&format!("rules[{index}]"), |check| {
                check.that(!rules.name.trim().is_empty() && !again, "name", || {
                    "is empty, or taken by earlier rules: give each a name of its own".to_owned()
                });
                let clear_m = rules.min_clear_range_m;
                check.within("min_clear_range_m", clear_m, 0.0..=10_000.0);
            });
        }
    }
}

impl RealDraw {
    fn check(&self, check: &mut Check, purpose: Purpose) {
        check.within("share", self.share, FRACTION);
        let some = self.share > 0.0;
        check.that(!some || !self.scenarios.is_empty(), "scenarios", || {
            "is empty: name scenarios with real cities, or set share = 0".to_owned()
        });
        check.that(!some || purpose == Purpose::Judging, "share", || {
            "real cities are kept for judging: set share = 0, or purpose = \"judging\"".to_owned()
        });
    }
}

impl UavDraw {
    /// Those of the models that are held out, or that are not.
    pub fn which(&self, held_out: bool) -> Vec<&str> {
        let models = self.models.iter().map(String::as_str);
        let is = |model: &&str| catalogue::load(model).is_ok_and(|uav| uav.held_out) == held_out;
        models.filter(is).collect()
    }

    fn check(&self, check: &mut Check, purpose: Purpose) {
        not_empty(check, "models", self.models.len());
        for (index, model) in self.models.iter().enumerate() {
            let key = format!("models[{index}]");
            match purpose {
                Purpose::Judging => catalogue::check(check, &key, model),
                Purpose::Learning => catalogue::check_learned(check, &key, model),
            }
        }
        if let Some(share) = self.held_out {
            check.within("held_out", share, FRACTION);
            let [held_out, known] = [true, false].map(|which| !self.which(which).is_empty());
            check.that((held_out || share <= 0.0) && (known || share >= 1.0), "held_out", || {
                "models has none of one kind: name a held-out model and one that is not, or leave this out".to_owned()
            });
        }
        check.not_descending("range_m", self.range_m, DISTANCE_M);
        check.not_descending("speed_mps", self.speed_mps, 0.5..=60.0);
        check_shares(check, "flights", self.flights.values());
    }
}

impl DistractorDraw {
    fn check(&self, check: &mut Check) {
        check_shares(check, "nearness", self.nearness.values());
        check.not_descending("near_deg", self.near_deg, 0.01..=90.0);
        check.not_descending("far_deg", self.far_deg, 0.01..=90.0);
        let some = self.nearness.iter();
        let some = some.filter(|(nearness, _)| **nearness != Nearness::None);
        if some.map(|(_, share)| share).sum::<f64>() > 0.0 {
            let shares = self.kinds.iter().map(|kind| &kind.share);
            check_shares(check, "kinds", shares);
        }
        for (index, kind) in self.kinds.iter().enumerate() {
            check.table(&format!("kinds[{index}]"), |check| {
                check.not_descending("count", kind.count.map(f64::from), 1.0..=50.0);
                check.within("spread_m", kind.spread_m, 0.0..=1000.0);
                check.not_descending("range_m", kind.range_m, DISTANCE_M);
                check.not_descending("speed_mps", kind.speed_mps, 0.0..=300.0);
            });
        }
    }
}

fn not_empty(check: &mut Check, key: &str, len: usize) {
    check.that(len > 0, key, || "is empty: give at least one".to_owned());
}

/// Shares lie between 0 and 1, and one of them is above 0.
fn check_shares<'a>(check: &mut Check, key: &str, shares: impl Iterator<Item = &'a f64>) {
    let mut total = 0.0;
    for share in shares {
        let found = *share;
        total += found;
        check.that(FRACTION.contains(share), key, || {
            format!("a share is {found}, each must be from 0 to 1")
        });
    }
    check.that(total > 0.0, key, || {
        "has no share above 0: give one".to_owned()
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHIPPED: &str = include_str!("../../../recipes/engagement.toml");

    #[test]
    fn the_shipped_recipe_is_read_and_a_bad_one_refused_with_its_line() {
        let recipe = Recipe::parse(SHIPPED, "r.toml").unwrap();
        assert_eq!(recipe.uav.models.len(), 8);
        assert_eq!(recipe.uav.which(true), ["hframe", "quadplane"]);
        // One of its rules is what a scenario has that says nothing.
        let [default, loose] = &recipe.rules[..] else {
            panic!("{:?}", recipe.rules);
        };
        let engage = Engage::default();
        assert_eq!(default.name, "default");
        assert_eq!(default.allow_backstop, engage.allow_backstop);
        assert_eq!(default.min_clear_range_m, engage.min_clear_range_m);
        assert_eq!(default.text(), "default: sky");
        assert!(loose.allow_backstop.len() == 3 && loose.min_clear_range_m == 20.0);
        assert!(loose.text().ends_with("building 20 m behind the target"));
        let refused = |from: &str, to: &str| {
            assert!(SHIPPED.contains(from), "{from}");
            let text = SHIPPED.replacen(from, to, 1);
            let line = 1 + text.lines().position(|line| line.contains(to)).unwrap();
            let error = Recipe::parse(&text, "r.toml").unwrap_err().to_string();
            assert!(error.starts_with(&format!("r.toml:{line}: ")), "{error}");
            error
        };
        for (from, to, words) in [
            ("duration_s", "duration", "unknown key"),
            ("pop_up =", "popup =", "pop_up"),
            ("\"phantom4\"", "\"phantom5\"", "phantom4"),
            ("cued = 0.7", "cued = 7", "from 0 to 1"),
            ("20005KT", "20005XX", "20005XX"),
            ("kind = \"bird\"", "kind = \"brid\"", "bird"),
            ("\"judging\"", "\"juding\"", "judging"),
            ("places = 100000", "places = 1000000", "from 1 to 999999"),
            ("held_out = 0.5", "held_out = 1.5", "from 0 to 1"),
        ] {
            let error = refused(from, to);
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn a_recipe_under_one_of_its_rules_is_otherwise_the_same() {
        let recipe = || Recipe::parse(SHIPPED, "r.toml").unwrap();
        let under = recipe().under("loose").unwrap();
        assert_eq!((under.rules.len(), &under.rules[0].name[..]), (1, "loose"));
        let again = Recipe {
            rules: recipe().rules,
            ..under
        };
        assert_eq!(again, recipe());
        let twice = SHIPPED.replace("name = \"loose\"", "name = \"default\"");
        let error = Recipe::parse(&twice, "r.toml").unwrap_err().to_string();
        assert!(
            error.contains("rules[1].name: is empty, or taken"),
            "{error}"
        );
        let error = recipe().under("lose").unwrap_err().to_string();
        assert_eq!(
            error,
            "--rules: the recipe has no `lose`; it has default, loose"
        );
    }

    #[test]
    fn what_is_learned_from_shows_nothing_that_is_kept_for_judging() {
        let recipe = Recipe::parse(SHIPPED, "r.toml").unwrap();
        assert!(recipe.uav.models.iter().any(|model| model == "hframe"));
        let known = recipe.to_learn_from().unwrap();
        assert!(!JUDGED_SEEDS.contains(&known.purpose.first_seed()));
        assert!(!known.uav.models.is_empty() && known.uav.which(true).is_empty());
        assert_eq!((known.uav.held_out, known.real.share), (None, 0.0));
        let held_out = SHIPPED.replace(
            "\"phantom4\", \"mavic2\", \"mavic_air\", \"matrice200\", \"matrice600\", \"fpv5\", ",
            "",
        );
        let held_out = held_out.replace("held_out = 0.5", "held_out = 1.0");
        let none = Recipe::parse(&held_out, "r.toml").unwrap().to_learn_from();
        assert!(none.is_err());
    }

    #[test]
    fn a_share_of_held_out_uavs_needs_both_kinds() {
        let known = SHIPPED.replace(", \"hframe\", \"quadplane\"", "");
        let error = Recipe::parse(&known, "r.toml").unwrap_err().to_string();
        assert!(error.contains("uav.held_out: models has none"), "{error}");
    }

    #[test]
    fn shares_are_met_and_what_has_none_is_never_drawn() {
        let mut rng = Stream::new(1, 0, "test");
        let shares = Shares::from([('a', 0.5), ('b', 0.0), ('c', 1.0)]);
        let n = 30_000;
        let draws: Vec<char> = (0..n)
            .map(|_| drawn(shares.iter().map(|(k, s)| (*k, *s)), &mut rng).unwrap())
            .collect();
        let count = |kind| draws.iter().filter(|draw| **draw == kind).count() as f64;
        assert_eq!(count('b'), 0.0);
        // Five standard errors of a share of a third.
        let error = 5.0 * (n as f64 * (1.0 / 3.0) * (2.0 / 3.0)).sqrt();
        assert!((count('a') - n as f64 / 3.0).abs() < error);
    }
}
