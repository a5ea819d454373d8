//! A city while it is being made: where things may stand, and what has been placed so far.

use glam::DVec2;

use super::ground_map::GroundMap;
use super::params::CityParams;
use super::parts::{Building, Tree, TreeKind};
use super::river::River;
use crate::maths::curve::smoothstep;
use crate::maths::noise::ValueNoise;
use crate::maths::rng::Stream;

/// The city while it is being made.
pub(super) struct Draft<'a> {
    pub params: &'a CityParams,
    /// Draws of the layout.
    pub rng: Stream,
    /// The smooth field behind terrain, districts and woods.
    pub noise: ValueNoise,
    pub river: Option<River>,
    pub map: GroundMap,
    pub buildings: Vec<Building>,
    pub trees: Vec<Tree>,
}

/// The smooth field of a city's seed.
pub(super) fn city_noise(seed: u64) -> ValueNoise {
    ValueNoise::new(&mut Stream::new(seed, 0, "city-noise"))
}

impl<'a> Draft<'a> {
    /// Bare ground.
    pub(super) fn new(params: &'a CityParams) -> Self {
        let mut rng = Stream::new(params.seed, 0, "city-layout");
        let river = params
            .river
            .then(|| River::drawn(params.extent_m, &mut rng));
        Self {
            params,
            rng,
            noise: city_noise(params.seed),
            river,
            map: GroundMap::new(params.extent_m, [92, 92, 94]),
            buildings: Vec::new(),
            trees: Vec::new(),
        }
    }
}

impl Draft<'_> {
    /// Height of the ground [m].
    pub(super) fn ground_m(&self, p: DVec2) -> f64 {
        let edge = self.params.extent_m / 2.0 - p.abs().max_element();
        let relief = |p: DVec2| {
            self.noise.at(p / 640.0) + 0.35 * self.noise.at(p / 230.0 + DVec2::ONE * 9.3)
        };
        let river = self.river.as_ref().map_or(1.0, |r| {
            smoothstep(
                r.half_width_m + 40.0,
                r.half_width_m + 320.0,
                r.offset_m(p).abs(),
            )
        });
        self.params.relief_m * (relief(p) - relief(DVec2::ZERO)) / 1.35
            * smoothstep(40.0, 420.0, edge)
            * river
    }

    /// Lowest ground below the corners of an outline [m].
    pub(super) fn lowest_m(&self, outline: &[DVec2]) -> f64 {
        outline
            .iter()
            .map(|&p| self.ground_m(p))
            .fold(f64::INFINITY, f64::min)
    }

    /// How much downtown a place is, 0..1.
    pub(super) fn downtown(&self, p: DVec2) -> f64 {
        let extent = self.params.extent_m;
        let from = p - DVec2::new(-0.19, -0.17) * extent;
        (-0.5 * from.length_squared() / (0.105 * extent).powi(2)).exp()
    }

    /// Greatest height allowed so that the station keeps its view [m].
    pub(super) fn height_cap_m(&self, p: DVec2) -> f64 {
        let near = self.params.station_height_m - 16.0;
        near + (p.length() - 260.0).max(0.0) * 0.5
    }

    /// Paints a convex outline on the ground map.
    pub(super) fn paint(&mut self, outline: &[DVec2], rgb: [u8; 3]) {
        self.map.paint(outline, rgb, 1.0);
    }

    /// Plants a street or garden tree of `size` times the usual height, unless water or the end of
    /// the city is there.
    pub(super) fn plant(&mut self, p: DVec2, size: f64) {
        if !self.can_grow(p) {
            return;
        }
        let height_m = size * self.rng.range(7.0, 12.5);
        let tree = Tree {
            kind: TreeKind::Broadleaf,
            inner: false,
            base_enu_m: p.extend(self.ground_m(p)),
            height_m,
            crown_radius_m: height_m * self.rng.range(0.27, 0.4),
            variant: self.rng.uniform() as f32,
        };
        self.trees.push(tree);
    }

    /// Whether a tree can stand at a place: away from the water and the end of the city.
    pub(super) fn can_grow(&self, p: DVec2) -> bool {
        !self.wet(p, 3.0) && p.abs().max_element() <= self.params.extent_m / 2.0 - 6.0
    }

    /// Whether a place lies within `margin_m` [m] of the river.
    pub(super) fn wet(&self, p: DVec2, margin_m: f64) -> bool {
        let river = self.river.as_ref();
        river.is_some_and(|r| r.offset_m(p).abs() < r.half_width_m + margin_m)
    }
}
