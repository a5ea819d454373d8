//! What of a city something has flown into.

use super::{BuildingKind, City};
use crate::maths::polygon;
use glam::{DVec2, DVec3};
use std::collections::BTreeMap;

/// What stands at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Met {
    /// The building of this number, from 0 in the order of the city's.
    Building(usize),
    /// A tree.
    Tree,
    /// Ground or water.
    Ground,
    /// What stands so high above the ground and is none of these [m].
    Solid(f64),
}

impl City {
    /// What stands within `reach_m` [m] beside or below a place [m, ENU]; the nearest building, if any.
    pub fn met(&self, r_enu_m: DVec3, reach_m: f64) -> Met {
        self.met_among(
            r_enu_m,
            reach_m,
            0..self.buildings.len(),
            0..self.trees.len(),
        )
    }

    /// The same where only buildings and trees of these numbers may be near, which are in order.
    fn met_among(
        &self,
        r_enu_m: DVec3,
        reach_m: f64,
        buildings: impl Iterator<Item = usize>,
        mut trees: impl Iterator<Item = usize>,
    ) -> Met {
        let at_m = r_enu_m.truncate();
        let near = buildings.filter_map(|index| {
            let building = &self.buildings[index];
            let apart_m = apart_m(building.footprint_enu_m(), at_m);
            let top_m = building.base_m + building.height_m() + reach_m;
            (apart_m <= reach_m && r_enu_m.z <= top_m).then_some((index, apart_m))
        });
        let nearest = near.min_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
        let above_m = r_enu_m.z - self.dsm.terrain_m(at_m.x, at_m.y);
        match nearest {
            // Beside a wall it may as well be the ground.
            Some((index, apart_m)) if apart_m <= 0.0 || above_m > reach_m => {
                return Met::Building(index);
            }
            _ => {}
        }
        let in_crown = trees.any(|index| {
            let tree = &self.trees[index];
            let foot_m = tree.base_enu_m;
            let apart_m = foot_m.truncate().distance(at_m);
            apart_m <= tree.crown_radius_m + reach_m
                && r_enu_m.z <= foot_m.z + tree.height_m + reach_m
        });
        let surface_m = self.dsm.surface_m(at_m.x, at_m.y);
        let stands_m = surface_m - self.dsm.terrain_m(at_m.x, at_m.y);
        match nearest {
            // Under a crown that reaches down, too.
            _ if in_crown && above_m.max(stands_m) > reach_m => Met::Tree,
            _ if above_m <= reach_m => Met::Ground,
            Some((index, _)) => Met::Building(index),
            None => Met::Solid(stands_m.max(0.0)),
        }
    }
}

/// Where in a city buildings and trees stand, for those who ask [`City::met`] for many places.
#[derive(Clone, Debug, Default)]
pub struct Standing {
    /// Numbers of buildings and of trees that reach into a square, in their order.
    squares: BTreeMap<[i32; 2], [Vec<usize>; 2]>,
}

impl Standing {
    /// Side of a square [m].
    const SQUARE_M: f64 = 25.0;
    /// Farthest that is asked beside a place [m].
    const REACH_M: f64 = 2.0;

    /// Of a city.
    pub fn of(city: &City) -> Self {
        let mut standing = Self::default();
        for (index, building) in city.buildings.iter().enumerate() {
            let outline = building.footprint_enu_m();
            let low = outline.iter().copied().reduce(DVec2::min);
            let high = outline.iter().copied().reduce(DVec2::max);
            if let (Some(low), Some(high)) = (low, high) {
                standing.add(0, index, [low, high]);
            }
        }
        for (index, tree) in city.trees.iter().enumerate() {
            let middle = tree.base_enu_m.truncate();
            let around = DVec2::splat(tree.crown_radius_m);
            standing.add(1, index, [middle - around, middle + around]);
        }
        standing
    }

    fn square(at_m: DVec2) -> [i32; 2] {
        (at_m / Self::SQUARE_M).floor().as_ivec2().to_array()
    }

    fn add(&mut self, kind: usize, index: usize, [low, high]: [DVec2; 2]) {
        let [first, last] = [low - Self::REACH_M, high + Self::REACH_M].map(Self::square);
        for x in first[0]..=last[0] {
            for y in first[1]..=last[1] {
                self.squares.entry([x, y]).or_default()[kind].push(index);
            }
        }
    }

    /// As [`City::met`] of the city that it is of, for a reach of 2 m at most.
    pub fn met(&self, city: &City, r_enu_m: DVec3, reach_m: f64) -> Met {
        let reach_m = reach_m.min(Self::REACH_M);
        let here = self.squares.get(&Self::square(r_enu_m.truncate()));
        let of = |kind: usize| {
            here.into_iter()
                .flat_map(move |of| of[kind].iter().copied())
        };
        city.met_among(r_enu_m, reach_m, of(0), of(1))
    }
}

impl BuildingKind {
    /// What it is, in words; nothing where that is not known.
    pub fn words(self) -> &'static str {
        match self {
            Self::House => "a house",
            Self::Apartment => "a block of flats",
            Self::Office => "an office building",
            Self::Tower => "a high-rise",
            Self::Industrial => "a hall",
            Self::Station => "the station's tower",
            Self::Bridge => "a bridge",
            Self::Surveyed => "",
        }
    }
}

/// How far a point lies outside an outline [m]; 0 within.
fn apart_m(outline: &[DVec2], p: DVec2) -> f64 {
    if polygon::encloses(outline, p) {
        return 0.0;
    }
    let ends = outline.iter().zip(outline.iter().cycle().skip(1));
    let apart = ends.map(|(from, to)| {
        let along = *to - *from;
        let share = (p - *from).dot(along) / along.length_squared().max(1e-12);
        p.distance(*from + along * share.clamp(0.0, 1.0))
    });
    apart.fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ground::city::CityParams;

    #[test]
    fn a_point_is_so_far_from_a_square() {
        let square = [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]].map(DVec2::from);
        for (at, wanted) in [([5.0, 5.0], 0.0), ([5.0, -2.0], 2.0), ([13.0, 14.0], 5.0)] {
            assert!((apart_m(&square, at.into()) - wanted).abs() < 1e-9);
        }
    }

    #[test]
    fn an_index_of_what_stands_finds_the_same() {
        let city = City::generate(&CityParams {
            extent_m: 800.0,
            seed: 5,
            ..CityParams::default()
        })
        .unwrap();
        let standing = Standing::of(&city);
        let mut kinds = [0; 3];
        for i in 0..120 {
            for j in 0..120 {
                let at = DVec2::new(f64::from(i) - 60.0, f64::from(j) - 60.0) * 6.2;
                let r = at.extend(city.dsm.surface_m(at.x, at.y) - f64::from((i + j) % 3));
                let met = city.met(r, 1.0);
                assert_eq!(standing.met(&city, r, 1.0), met, "{r}");
                kinds[match met {
                    Met::Building(_) => 0,
                    Met::Tree => 1,
                    Met::Ground | Met::Solid(_) => 2,
                }] += 1;
            }
        }
        assert!(kinds.into_iter().all(|count| count > 20), "{kinds:?}");
    }

    #[test]
    fn what_is_met_is_the_building_whose_wall_it_is() {
        let city = City::generate(&CityParams {
            extent_m: 800.0,
            seed: 3,
            ..CityParams::default()
        })
        .unwrap();
        let own =
            |b: &&super::super::Building| b.kind != BuildingKind::Bridge && b.height_m() > 8.0;
        let mut buildings = city.buildings.iter().enumerate().rev();
        let (index, building) = buildings.find(|(_, b)| own(b)).unwrap();
        let middle = polygon::centroid(building.footprint_enu_m());
        let roof = middle.extend(building.base_m + building.height_m() + 0.2);
        assert_eq!(city.met(roof, 0.7), Met::Building(index));
        // Half a metre off the middle of its first wall, half way up.
        let [a, b] = [0, 1].map(|i| building.footprint_enu_m()[i]);
        let out = -(b - a).perp().normalize();
        let wall = (0.5 * (a + b) + 0.5 * out).extend(building.base_m + 0.5 * building.height_m());
        assert_eq!(city.met(wall, 0.7), Met::Building(index));
        // High above all there is nothing; on free ground there is the ground.
        let open = (-40..40)
            .flat_map(|i| (-40..40).map(move |j| (4.9 * f64::from(i), 4.9 * f64::from(j))));
        let flat = |e: f64, n: f64| city.dsm.surface_m(e, n) - city.dsm.terrain_m(e, n) < 0.01;
        let free = |(e, n): &(f64, f64)| {
            let around = [(0.0, 0.0), (6.0, 0.0), (-6.0, 0.0), (0.0, 6.0), (0.0, -6.0)];
            around.iter().all(|(x, y)| flat(e + x, n + y))
        };
        let (e, n) = open.into_iter().find(free).unwrap();
        let ground = DVec3::new(e, n, city.dsm.terrain_m(e, n) + 0.2);
        assert_eq!(city.met(ground, 0.7), Met::Ground);
    }
}
