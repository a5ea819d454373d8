//! Open country in place of the city: fields, a road, farms, woods and hedges.

use glam::DVec2;

use super::blocks::split_lots;
use super::build::Extrusion;
use super::ground_map::srgb8;
use super::parts::{BuildingKind, Finish, Roof, TILES, Tree, TreeKind, WALLS, shaded};
use super::plan::Draft;
use crate::ground::dsm::HeightGrid;
use crate::maths::curve::smoothstep;
use crate::maths::noise::ValueNoise;
use crate::maths::polygon::{clip, main_axis, rectangle, span};
use crate::shape::mesh::Surface;

/// Spacing of the raster that tells wood from field [m].
const STAND_CELL_M: f64 = 10.0;
/// Most trees in the woods.
const MAX_FOREST_TREES: f64 = 15_000.0;
/// Ground around the site point that no tree stands on [m].
pub(super) const GLADE_M: f64 = 25.0;

/// The time of year in the country, drawn once.
#[derive(Clone, Copy)]
struct Season {
    /// Share of broadleaf trees that are bare.
    bare: f64,
    /// Share of broadleaf trees in autumn colours.
    autumn: f64,
    /// Linear RGB albedo of most fields, dimmed and tinted from field to field.
    fields: [[f32; 3]; 5],
}

/// Summer, winter and autumn.
const SEASONS: [Season; 3] = [
    Season {
        bare: 0.02,
        autumn: 0.0,
        fields: [
            [0.07, 0.12, 0.03],
            [0.1, 0.15, 0.04],
            [0.21, 0.18, 0.075],
            [0.05, 0.095, 0.025],
            [0.13, 0.14, 0.055],
        ],
    },
    Season {
        bare: 0.9,
        autumn: 0.05,
        fields: [
            [0.075, 0.11, 0.03],
            [0.12, 0.095, 0.06],
            [0.09, 0.07, 0.045],
            [0.055, 0.095, 0.025],
            [0.17, 0.15, 0.085],
        ],
    },
    Season {
        bare: 0.3,
        autumn: 0.45,
        fields: [
            [0.08, 0.1, 0.03],
            [0.14, 0.1, 0.06],
            [0.2, 0.16, 0.08],
            [0.06, 0.095, 0.025],
            [0.1, 0.075, 0.045],
        ],
    },
];

/// A road that bends past the site point.
struct Road {
    /// Unit vector of its general direction.
    heading: DVec2,
    /// Distance of its middle course from the site point [m].
    aside_m: f64,
    /// How far it bends to either side [m].
    bend_m: f64,
    /// Where in its bends it passes the site point [rad].
    phase_rad: f64,
}

impl Road {
    /// The point on the road at a distance along its general direction [m].
    fn at(&self, s: f64) -> DVec2 {
        self.heading * s
            + self.heading.perp()
                * (self.aside_m + self.bend_m * (s / 170.0 + self.phase_rad).sin())
    }

    /// Distance of a place from the road [m], square to its general direction.
    fn distance_m(&self, p: DVec2) -> f64 {
        let s = p.dot(self.heading);
        (p - self.at(s)).dot(self.heading.perp()).abs()
    }
}

/// A tree of the woods and hedges before it is planted.
struct WildTree {
    at: DVec2,
    height_m: f64,
    /// Least radius of its crown [m].
    least_radius_m: f64,
    season: Season,
    conifer: bool,
    /// Whether it stands inside a wood, where only its top is seen.
    inner: bool,
}

impl Draft<'_> {
    /// Open country: fields cut by a road, woods where a smooth field of numbers is highest, a few
    /// farms. The ground about the site point stays open.
    pub(super) fn countryside(&mut self) {
        let season = self.rng.pick(&SEASONS);
        // Everything is laid out to beyond the square's corners.
        let reach_m = self.params.extent_m / 2.0 * 1.42;
        let lots = self.parcel(reach_m);
        for lot in &lots {
            self.field(lot, season);
        }
        let road = self.road(reach_m);
        let yards = self.farms(&road);
        if self.river.is_some() {
            self.river_banks();
        }
        self.woods(season, |p| {
            road.distance_m(p) < 7.0 || yards.iter().any(|y| y.distance(p) < 22.0)
        });
        for lot in &lots {
            self.hedges(lot, &road, season);
        }
    }

    /// Fields, in one direction as land is parcelled out: strips, cut into lots.
    fn parcel(&mut self, reach_m: f64) -> Vec<Vec<DVec2>> {
        let axis = DVec2::from_angle(self.rng.range(0.0, 1.57));
        let half = DVec2::splat(self.params.extent_m / 2.0);
        let square = rectangle(DVec2::ZERO, DVec2::X, half);
        let mut lots = Vec::new();
        let strips = self.rng.range(90.0, 220.0);
        let mut from = -reach_m;
        while from < reach_m {
            let width = strips * self.rng.range(0.7, 1.3);
            let strip = clip(&square, axis * from, axis);
            let strip = clip(&strip, axis * (from + width), -axis);
            if strip.len() > 2 {
                split_lots(strip, strips * strips * 1.6, &mut self.rng, &mut lots);
            }
            from += width;
        }
        lots
    }

    /// Paints a field, some with tramlines or swaths, wider than a pixel of the map.
    fn field(&mut self, lot: &[DVec2], season: Season) {
        let tone = self.rng.range(0.75, 1.2);
        let albedo = shaded(self.rng.pick(&season.fields), tone);
        self.paint(lot, srgb8(albedo));
        let along = main_axis(lot);
        let rows = self.rng.uniform() < 0.5;
        let [low, high] = span(lot, along.perp());
        let step = self.rng.range(6.0, 14.0);
        let mut at = low + step;
        while rows && at < high - step {
            let band = clip(lot, along.perp() * at, along.perp());
            let band = clip(&band, along.perp() * (at + 1.4), -along.perp());
            self.map.paint(&band, srgb8(shaded(albedo, 0.72)), 0.8);
            at += step;
        }
    }

    /// Draws and paints the road.
    fn road(&mut self, reach_m: f64) -> Road {
        let road = Road {
            heading: DVec2::from_angle(self.rng.range(0.0, 6.3)),
            aside_m: self.rng.range(28.0, 70.0),
            bend_m: self.rng.range(-40.0, 40.0),
            phase_rad: self.rng.range(0.0, 6.3),
        };
        let paved = self.rng.uniform() < 0.6;
        let rgb = if paved {
            [104, 104, 106]
        } else {
            [158, 142, 116]
        };
        let point = |k: usize| road.at(-reach_m + 20.0 * k as f64);
        for k in 0..(2.0 * reach_m / 20.0) as usize {
            let (a, b) = (point(k), point(k + 1));
            self.map.stroke([a, b + (b - a) * 0.02], 5.5, rgb, 1.0);
        }
        road
    }

    /// Farms along the road; returns where they stand.
    fn farms(&mut self, road: &Road) -> Vec<DVec2> {
        let extent = self.params.extent_m;
        let half = extent / 2.0;
        let count = (extent * extent * 1e-6 * (4.0 + 60.0 * self.params.building_density)) as usize;
        let mut yards: Vec<DVec2> = Vec::new();
        for _ in 0..count {
            let s = self.rng.range(-half, half);
            let side = if self.rng.uniform() < 0.5 { 1.0 } else { -1.0 };
            let at = road.at(s) + road.heading.perp() * side * self.rng.range(18.0, 45.0);
            let clear = at.length() > 60.0 && yards.iter().all(|y| y.distance(at) > 26.0);
            if clear && at.abs().max_element() < half - 20.0 && !self.wet(at, 8.0) {
                self.farm(at, road.heading);
                yards.push(at);
            }
        }
        yards
    }

    /// Lone trees and hedges along some edges of a field.
    fn hedges(&mut self, lot: &[DVec2], road: &Road, season: Season) {
        for k in 0..lot.len() {
            if self.rng.uniform() > 0.12 {
                continue;
            }
            let (a, b) = (lot[k], lot[(k + 1) % lot.len()]);
            let count = (a.distance(b) / self.rng.range(9.0, 30.0)) as usize;
            for i in 0..count {
                let at = a.lerp(b, (i as f64 + self.rng.uniform()) / count as f64);
                if at.length() > 1.5 * GLADE_M && road.distance_m(at) > 7.0 {
                    let height_m = self.rng.range(4.0, 15.0);
                    self.plant_wild(WildTree {
                        at,
                        height_m,
                        least_radius_m: 0.0,
                        season,
                        conifer: false,
                        inner: false,
                    });
                }
            }
        }
    }

    /// A house, often with a barn beside it.
    fn farm(&mut self, at: DVec2, axis: DVec2) {
        let house = DVec2::new(self.rng.range(5.5, 8.5), self.rng.range(4.0, 5.5));
        let barn = DVec2::new(self.rng.range(8.0, 14.0), self.rng.range(5.0, 7.0));
        let with_barn = self.rng.uniform() < 0.6;
        let barn_walls = [[0.27, 0.05, 0.035], [0.2, 0.13, 0.08], [0.35, 0.34, 0.32]];
        let walls = [self.rng.pick(&WALLS), self.rng.pick(&barn_walls)];
        for (is_barn, center, half) in [(false, at, house), (true, at + axis * 24.0, barn)] {
            if is_barn && !with_barn {
                continue;
            }
            let eaves = if is_barn {
                4.5
            } else {
                self.rng.range(3.2, 6.0)
            };
            let rise = half.y * self.rng.range(0.6, 0.95);
            let (kind, surface) = if is_barn {
                (BuildingKind::Industrial, Surface::Plain)
            } else {
                (BuildingKind::House, Surface::FacadeResidential)
            };
            let wall = walls[usize::from(is_barn)];
            let finish = Finish::facade(surface, wall, self.rng.pick(&TILES));
            let outline = rectangle(center, axis, half);
            let house = Extrusion::up_to(eaves, outline, Roof::Gable(rise));
            self.build(kind, finish, [house]);
        }
    }

    /// The stands: a jittered grid of trees over the share of the land where the field of numbers is
    /// highest; `free` says where none may stand.
    fn woods(&mut self, season: Season, free: impl Fn(DVec2) -> bool) {
        let extent = self.params.extent_m;
        let half = extent / 2.0;
        let n = (extent / STAND_CELL_M).ceil() as usize;
        let lie = DVec2::new(self.rng.range(0.0, 60.0), self.rng.range(0.0, 60.0));
        let clearing = self.rng.range(60.0, 150.0);
        let fit = |noise: &ValueNoise, p: DVec2| {
            let open = 2.5 * (1.0 - smoothstep(0.35 * clearing, clearing, p.length()));
            noise.at(p / 240.0 + lie) + 0.4 * noise.at(p / 75.0 + lie) - open
        };
        let field = HeightGrid::from_fn(DVec2::splat(-half), STAND_CELL_M, [n, n], |e, y| {
            fit(&self.noise, DVec2::new(e, y))
        });
        let mut ranked = field.heights_m.clone();
        ranked.sort_by(f32::total_cmp);
        let open = ((1.0 - self.params.forest_share) * ranked.len() as f64) as usize;
        let edge = ranked.get(open).map_or(f64::INFINITY, |&x| f64::from(x));
        // The floor of the woods: litter and moss.
        let depth = |p: DVec2| field.bilinear_m(p.x, p.y) - edge;
        self.map.blend(srgb8([0.05, 0.042, 0.022]), |p| {
            smoothstep(-0.03, 0.03, depth(p)) * 0.9
        });
        self.plant_stands(season, |p| field.bilinear_m(p.x, p.y) > edge, free);
    }

    /// Trees of the woods on a jittered grid, wherever a place is `inside` the woods and not `free`.
    fn plant_stands(
        &mut self,
        season: Season,
        inside: impl Fn(DVec2) -> bool,
        free: impl Fn(DVec2) -> bool,
    ) {
        let extent = self.params.extent_m;
        let half = extent / 2.0;
        let area_m2 = self.params.forest_share * extent * extent;
        let spacing = (area_m2 / MAX_FOREST_TREES).sqrt().max(6.0);
        let count = (extent / spacing) as usize;
        // A tree is inner when the field stays inside for the first rows around it.
        let rows = 2.5 * spacing;
        for k in 0..count * count {
            let jitter = DVec2::new(self.rng.range(-0.45, 0.45), self.rng.range(-0.45, 0.45));
            let at = DVec2::new((k % count) as f64, (k / count) as f64) + 0.5 + jitter;
            let p = at * spacing - half;
            if !inside(p) || p.length() < GLADE_M || free(p) {
                continue;
            }
            let around = [DVec2::X, DVec2::Y, DVec2::NEG_X, DVec2::NEG_Y].map(|d| p + d * rows);
            let inner = around.iter().all(|&q| inside(q) && !free(q));
            // Stands differ in age; single trees in them less.
            let age = 0.5 + 0.5 * self.noise.at(p / 130.0 + DVec2::splat(13.0));
            let height_m = (8.0 + 15.0 * age + 2.2 * self.rng.normal()).clamp(8.0, 25.0);
            let conifer = self.noise.at(p / 160.0 + DVec2::new(3.0, 27.0));
            let conifer = self.rng.uniform() < smoothstep(-0.3, 0.3, conifer);
            // Crowns close the canopy, whatever the spacing.
            self.plant_wild(WildTree {
                at: p,
                height_m,
                least_radius_m: 0.52 * spacing,
                season,
                conifer,
                inner,
            });
        }
    }

    /// Plants a tree of the woods and hedges, unless water or the end of the land is there.
    fn plant_wild(&mut self, wild: WildTree) {
        let dice = self.rng.uniform();
        let (slim, variant) = (self.rng.uniform(), self.rng.uniform() as f32);
        if !self.can_grow(wild.at) {
            return;
        }
        let kind = match dice {
            _ if wild.conifer => TreeKind::Conifer,
            u if u < wild.season.bare => TreeKind::Bare,
            u if u < wild.season.bare + wild.season.autumn => TreeKind::Autumn,
            _ => TreeKind::Broadleaf,
        };
        let width = match kind {
            TreeKind::Conifer => 0.13 + 0.07 * slim,
            _ => 0.2 + 0.13 * slim,
        };
        self.trees.push(Tree {
            kind,
            inner: wild.inner,
            base_enu_m: wild.at.extend(self.ground_m(wild.at)),
            height_m: wild.height_m,
            crown_radius_m: (wild.height_m * width).max(wild.least_radius_m),
            variant,
        });
    }
}
