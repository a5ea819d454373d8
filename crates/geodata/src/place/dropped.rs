//! Buildings of a real city that its survey does not find: too small for its cells, or too low.

use crate::tiles::content::Rows;
use boresight_common::warning::Warning;
use boresight_models::ground::city::City;
use boresight_models::ground::footprints::{LEAST_AREA_M2, LEAST_HEIGHT_M};
use boresight_models::shape::textured::{NO_FEATURE, TexturedMesh};
use glam::{DVec2, DVec3, IVec2};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// Buildings that a warning names.
const NAMED: usize = 3;
/// Side of the squares by which boxes are found [m].
const SQUARE_M: f64 = 100.0;
/// What stands up less is ground, a road or a lawn, whatever its table calls it [m].
const FLAT_M: f64 = 0.5;
/// Properties that name a feature, the first that it has.
const NAMES: [&str; 8] = [
    "id",
    "gml:id",
    "gml_id",
    "identifier",
    "GlobalId",
    "@id",
    "name",
    "Name",
];

/// A box that stands upright [m, ENU].
#[derive(Clone, Copy, Debug)]
struct Upright {
    low_m: DVec3,
    high_m: DVec3,
}

impl Upright {
    const NONE: Self = Self {
        low_m: DVec3::INFINITY,
        high_m: DVec3::NEG_INFINITY,
    };

    fn with(self, r_enu_m: DVec3) -> Self {
        Self {
            low_m: self.low_m.min(r_enu_m),
            high_m: self.high_m.max(r_enu_m),
        }
    }

    fn overlaps(&self, low_m: DVec2, high_m: DVec2) -> bool {
        self.low_m.truncate().cmple(high_m).all() && self.high_m.truncate().cmpge(low_m).all()
    }

    fn height_m(&self) -> f64 {
        self.high_m.z - self.low_m.z
    }
}

/// The features of a city's tiles, as far as their tables tell them apart.
#[derive(Debug, Default)]
pub(super) struct Features {
    found: BTreeMap<(usize, u32), (Upright, String)>,
}

impl Features {
    /// Adds the features of a mesh of content number `content`, which knows `rows` of them.
    pub(super) fn add(
        &mut self,
        content: usize,
        (mesh, rows): (&TexturedMesh, &Rows),
        to_enu: impl Fn(DVec3) -> DVec3,
    ) {
        for index in &mesh.indices {
            let feature = mesh
                .features
                .get(*index as usize)
                .copied()
                .unwrap_or(NO_FEATURE);
            if feature == NO_FEATURE || *index as usize >= mesh.positions.len() {
                continue;
            }
            let known = self.found.entry((content, feature)).or_insert_with(|| {
                let row = rows.get(feature as usize);
                let name = row.and_then(|row| NAMES.iter().find_map(|key| named(row.get(*key)?)));
                (Upright::NONE, name.unwrap_or_default())
            });
            known.0 = known.0.with(to_enu(mesh.vertex_m(*index)));
        }
    }

    /// The warning that counts and names those within `radius_m` [m] of the site that the survey found no building of;
    /// `file` is what the city was read from. None where it found all.
    pub(super) fn dropped(&self, city: &City, radius_m: f64, file: &Path) -> Option<Warning> {
        let cell_m = city.dsm.surface().cell_m;
        let reach = DVec2::splat(radius_m);
        let stands = |(upright, _): &&(Upright, String)| {
            upright.height_m() > FLAT_M && upright.overlaps(-reach, reach)
        };
        let all: Vec<&(Upright, String)> = self.found.values().filter(stands).collect();
        let squares = squares(city);
        let lost = all
            .iter()
            .filter(|(upright, _)| !is_found(upright, &squares, cell_m));
        let (mut low, mut small) = (Vec::new(), Vec::new());
        for (upright, name) in lost {
            let middle = 0.5 * (upright.low_m + upright.high_m);
            let name = match name.is_empty() {
                false => format!("'{name}'"),
                true => format!("the one {:.0} m east, {:.0} m north", middle.x, middle.y),
            };
            match upright.height_m() <= LEAST_HEIGHT_M {
                true => low.push(name),
                false => small.push(name),
            }
        }
        let count = low.len() + small.len();
        if count == 0 {
            return None;
        }
        let because = [
            (
                small,
                format!("cover less than {LEAST_AREA_M2} m² in cells of {cell_m} m"),
            ),
            (low, format!("rise less than {LEAST_HEIGHT_M} m")),
        ];
        let reasons = because.into_iter().filter(|(names, _)| !names.is_empty());
        let reasons: Vec<String> = reasons.map(|(names, why)| said(&names, &why)).collect();
        let mend = match cell_m > 0.5 {
            true => {
                "they hide what is behind them, but slow no wind and are on no map; lower city.radius_m for smaller cells"
            }
            false => "they hide what is behind them, but slow no wind and are on no map",
        };
        Some(Warning {
            file: file.into(),
            place: "buildings".into(),
            what: format!(
                "{count} of {} are none to the survey: {}",
                all.len(),
                reasons.join(", ")
            ),
            mend: mend.into(),
        })
    }
}

/// How many do something, and who the first are.
fn said(names: &[String], why: &str) -> String {
    let shown = names.iter().take(NAMED).cloned().collect::<Vec<_>>();
    let more = if names.len() > NAMED { ", …" } else { "" };
    format!("{} {why} ({}{more})", names.len(), shown.join(", "))
}

fn named(value: &Value) -> Option<String> {
    match value {
        Value::String(text) if !text.trim().is_empty() => Some(text.trim().to_owned()),
        Value::Number(number) => Some(number.to_string()),
        _ => None,
    }
}

/// The boxes of the surveyed buildings [m], by the squares that they lie in.
type Squares = BTreeMap<(i32, i32), Vec<[DVec2; 2]>>;

fn squares(city: &City) -> Squares {
    let mut squares = Squares::new();
    for building in &city.buildings {
        let none = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        let outline = building.footprint_enu_m().iter();
        let (low, high) = outline.fold(none, |(low, high), p| (low.min(*p), high.max(*p)));
        for square in between(low, high) {
            squares.entry(square).or_default().push([low, high]);
        }
    }
    squares
}

fn between(low_m: DVec2, high_m: DVec2) -> impl Iterator<Item = (i32, i32)> {
    let [low, high]: [IVec2; 2] = [low_m, high_m].map(|p| (p / SQUARE_M).floor().as_ivec2());
    (low.x..=high.x).flat_map(move |i| (low.y..=high.y).map(move |j| (i, j)))
}

/// Whether a surveyed building stands where a feature does.
fn is_found(upright: &Upright, squares: &Squares, cell_m: f64) -> bool {
    let [low, high] = [
        upright.low_m.truncate() - cell_m,
        upright.high_m.truncate() + cell_m,
    ];
    let inside = DVec2::splat(cell_m);
    let overlaps =
        |[from, to]: &[DVec2; 2]| upright.overlaps(*from - 0.5 * inside, *to + 0.5 * inside);
    // A stray corner stretches a box over more squares than there are.
    let across = ((high - low) / SQUARE_M).ceil() + 1.0;
    if across.x * across.y > squares.len() as f64 {
        return squares.values().flatten().any(overlaps);
    }
    let own = between(low, high).filter_map(|square| squares.get(&square));
    own.flatten().any(overlaps)
}

#[cfg(test)]
mod tests {
    use super::*;
    use boresight_models::ground::city::CityParams;
    use boresight_models::ground::raster::GroundFilter;
    use boresight_models::ground::survey::{Evidence, SurveyOptions, survey};
    use serde_json::{Map, json};

    /// A box of walls and a roof, as one feature.
    fn house(low: DVec3, size: DVec3, feature: u32) -> TexturedMesh {
        let corner = |k: u32| {
            let bit = |axis: u32| f64::from(k >> axis & 1);
            let r = low + size * DVec3::new(bit(0), bit(1), bit(2));
            r.as_vec3().to_array()
        };
        TexturedMesh {
            origin_m: DVec3::ZERO,
            positions: (0..8).map(corner).collect(),
            features: vec![feature; 8],
            indices: vec![
                4, 5, 7, 4, 7, 6, 0, 1, 5, 0, 5, 4, 1, 3, 7, 1, 7, 5, 3, 2, 6, 3, 6, 7, 2, 0, 4, 2,
                4, 6,
            ],
            ..TexturedMesh::default()
        }
    }

    fn surveyed(houses: &[TexturedMesh], rows: &Rows) -> Option<Warning> {
        let mut evidence = Evidence::default();
        let ground = TexturedMesh {
            positions: vec![
                [-600.0, -600.0, 0.0],
                [600.0, -600.0, 0.0],
                [600.0, 600.0, 0.0],
                [-600.0, 600.0, 0.0],
            ],
            indices: vec![0, 1, 2, 0, 2, 3],
            ..TexturedMesh::default()
        };
        let mut features = Features::default();
        for mesh in houses.iter().chain([&ground]) {
            evidence.add(mesh, |r| r);
            features.add(0, (mesh, rows), |r| r);
        }
        let options = SurveyOptions {
            radius_m: 600.0,
            curved: false,
            filter: GroundFilter::default(),
        };
        let city = City::real(survey(evidence, CityParams::default(), &options).unwrap());
        features.dropped(&city, 600.0, Path::new("town.city.json"))
    }

    #[test]
    fn what_the_survey_drops_is_counted_and_named() {
        let at = |e: f64, n: f64| DVec3::new(e, n, 0.0);
        let houses = [
            house(at(0.0, 0.0), DVec3::new(12.0, 10.0, 8.0), 0),
            house(at(50.0, 0.0), DVec3::new(3.0, 4.0, 4.0), 1),
            house(at(90.0, 0.0), DVec3::new(4.0, 4.0, 3.0), 2),
            house(at(50.0, 80.0), DVec3::new(20.0, 14.0, 2.0), 3),
        ];
        let row = |id: Value| Map::from_iter([("id".to_owned(), id)]);
        let rows = vec![
            row(json!("town hall")),
            row(json!("shed")),
            row(json!(17)),
            Map::new(),
        ];
        let warning = surveyed(&houses, &rows).unwrap().to_string();
        let want = "town.city.json: buildings: 3 of 4 are none to the survey: 2 cover less than 20 m² in cells of 1 m ('shed', \
                    '17'), 1 rise less than 2.5 m (the one 60 m east, 87 m north); they hide what is behind them, but slow \
                    no wind and are on no map; lower city.radius_m for smaller cells";
        assert_eq!(warning, want);
        assert_eq!(surveyed(&houses[..1], &rows), None);
    }
}
