//! The land around the built square: fields, woods, scattered houses, hills on the horizon.

use glam::{DVec2, DVec3};

use super::buildings::add_part;
use super::params::CityParams;
use super::parts::{
    Building, BuildingKind, Finish, Part, Roof, TILES, Tree, TreeKind, WALLS, shaded,
};
use super::plan::city_noise;
use super::river::River;
use super::trees::add_tree;
use crate::maths::curve::smoothstep;
use crate::maths::noise::ValueNoise;
use crate::maths::polygon::rectangle;
use crate::maths::rng::Stream;
use crate::shape::mesh::{MeshData, Paint, Surface};

/// Reach of the land around the city [m].
pub(super) const APRON_M: f64 = 8000.0;
/// Meshes that the land is cut into, by direction from the site point.
const SECTORS: usize = 8;
/// Cells along a side of each ring.
const RING_CELLS: u32 = 24;

/// Linear RGB albedo of fields and meadows.
const FIELDS: [[f32; 3]; 6] = [
    [0.085, 0.125, 0.035],
    [0.12, 0.14, 0.05],
    [0.19, 0.165, 0.075],
    [0.07, 0.105, 0.03],
    [0.14, 0.11, 0.07],
    [0.035, 0.062, 0.022],
];

/// The meshes of the land around a city.
pub(super) fn meshes(params: &CityParams, river: Option<&River>) -> Vec<MeshData> {
    let mut apron = Apron {
        params,
        river,
        noise: city_noise(params.seed),
        rng: Stream::new(params.seed, 0, "city-apron"),
        chunks: (0..SECTORS).map(|_| MeshData::new(DVec3::ZERO)).collect(),
    };
    let half = params.extent_m / 2.0;
    let mut inner = half;
    while inner < APRON_M {
        apron.ring(inner, inner == half);
        inner *= 2.0;
    }
    apron.chunks
}

/// The land while it is being made.
struct Apron<'a> {
    params: &'a CityParams,
    river: Option<&'a River>,
    noise: ValueNoise,
    rng: Stream,
    /// One mesh a sector.
    chunks: Vec<MeshData>,
}

/// A square cell of a ring.
struct Cell {
    /// South-western corner [m].
    low: DVec2,
    side_m: f64,
    /// Index of its mesh.
    sector: usize,
}

impl Cell {
    fn center(&self) -> DVec2 {
        self.low + self.side_m / 2.0
    }
}

impl Apron<'_> {
    /// Distance to the river's centre line [m].
    fn river_offset_m(&self, p: DVec2) -> f64 {
        self.river.map_or(f64::INFINITY, |r| r.offset_m(p).abs())
    }

    /// Height of the hills [m].
    fn hill_m(&self, p: DVec2) -> f64 {
        let far = smoothstep(4200.0, 7600.0, p.length())
            * smoothstep(300.0, 1800.0, self.river_offset_m(p));
        far * (70.0 + 55.0 * self.noise.at(p / 1300.0))
    }

    /// Squares of cells around a square of half side `inner_m` [m], twice as wide, so that they get
    /// coarser outwards. Something stands on the innermost ring only.
    fn ring(&mut self, inner_m: f64, innermost: bool) {
        let outer_m = inner_m * 2.0;
        let side_m = 2.0 * outer_m / f64::from(RING_CELLS);
        for k in 0..RING_CELLS * RING_CELLS {
            let place = DVec2::new(f64::from(k % RING_CELLS), f64::from(k / RING_CELLS));
            let low = place * side_m - outer_m;
            let center = low + side_m / 2.0;
            if center.abs().max_element() < inner_m {
                continue;
            }
            let turn = center.to_angle() / std::f64::consts::TAU + 1.0;
            let cell = Cell {
                low,
                side_m,
                sector: (turn * 8.0) as usize % SECTORS,
            };
            self.field(&cell, center.abs().max_element() > outer_m - side_m);
            if !innermost {
                continue;
            }
            if self.params.is_country() {
                self.wood(&cell);
            } else {
                self.settlement(&cell);
            }
        }
    }

    /// A field; those at the outer seam of a ring, whose grid differs from the next, have skirts that
    /// hide it.
    fn field(&mut self, cell: &Cell, at_seam: bool) {
        let albedo = shaded(self.rng.pick(&FIELDS), self.rng.range(0.85, 1.15));
        let paint = Paint::plain(albedo);
        let quad = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|corner| {
            let p = cell.low + DVec2::from(corner) * cell.side_m;
            p.extend(self.hill_m(p))
        });
        let mesh = &mut self.chunks[cell.sector];
        mesh.face(&[quad[0], quad[1], quad[2]], paint);
        mesh.face(&[quad[0], quad[2], quad[3]], paint);
        if at_seam {
            for s in 0..4 {
                let (a, b) = (quad[s], quad[(s + 1) % 4]);
                let down = DVec3::Z * 12.0;
                mesh.face(&[a - down, b - down, b, a], paint);
            }
        }
    }

    /// A wood, where the noise has one.
    fn wood(&mut self, cell: &Cell) {
        let center = cell.center();
        let wooded =
            self.noise.at(center / 380.0 + DVec2::new(3.1, 8.7)) > 0.5 - self.params.forest_share;
        if wooded && self.river_offset_m(center) > 70.0 + cell.side_m {
            let mesh = &mut self.chunks[cell.sector];
            add_canopy(mesh, cell.low, cell.side_m, &mut self.rng);
        }
    }

    /// A few houses and trees, or trees alone.
    fn settlement(&mut self, cell: &Cell) {
        let settled = self.noise.at(cell.center() / 420.0 + DVec2::splat(7.0)) > -0.1;
        for _ in 0..if settled { 4 } else { 3 } {
            let place = DVec2::new(self.rng.uniform(), self.rng.uniform());
            let at = cell.low + place * cell.side_m;
            if self.river_offset_m(at) < 70.0 {
                continue;
            }
            let axis = DVec2::from_angle(self.rng.range(0.0, 6.3));
            if settled && self.rng.uniform() < 0.6 {
                self.house(cell.sector, at, axis);
            } else {
                self.tree(cell.sector, at);
            }
        }
    }

    fn house(&mut self, sector: usize, at: DVec2, axis: DVec2) {
        let rng = &mut self.rng;
        let half = DVec2::new(rng.range(6.0, 11.0), 5.0);
        let part = Part {
            outline_enu_m: rectangle(at, axis, half).to_vec(),
            bottom_m: 0.0,
            eaves_m: rng.range(3.5, 8.0),
            roof: Roof::Gable(3.6),
            finish: Finish {
                surface: Surface::FacadeResidential,
                albedo: rng.pick(&WALLS),
                roof_albedo: rng.pick(&TILES),
                blind_ends: true,
            },
        };
        let house = Building {
            kind: BuildingKind::House,
            base_m: 0.0,
            variant: rng.uniform() as f32,
            parts: Vec::new(),
        };
        add_part(&mut self.chunks[sector], &part, &house);
    }

    fn tree(&mut self, sector: usize, at: DVec2) {
        let rng = &mut self.rng;
        let tree = Tree {
            kind: TreeKind::Broadleaf,
            inner: false,
            base_enu_m: at.extend(0.0),
            height_m: rng.range(8.0, 15.0),
            crown_radius_m: rng.range(2.8, 4.6),
            variant: rng.uniform() as f32,
        };
        add_tree(&mut self.chunks[sector], &tree, false);
    }
}

/// A wood seen from afar: a bumpy roof over a square of side `cell_m` [m], closed at its sides.
fn add_canopy(mesh: &mut MeshData, low: DVec2, cell_m: f64, rng: &mut Stream) {
    let n = (cell_m / 9.0).ceil() as usize; // crowns of 9 m
    let step = cell_m / n as f64;
    let mean_m = rng.range(12.0, 18.0);
    let tone = rng.range(0.6, 1.3);
    let top: Vec<DVec3> = (0..=n)
        .flat_map(|j| (0..=n).map(move |i| DVec2::new(i as f64, j as f64) * step))
        .map(|p| (low + p).extend(mean_m * rng.range(0.6, 1.25)))
        .collect();
    let hues = [
        [0.045, 0.075, 0.022],
        [0.03, 0.05, 0.022],
        [0.075, 0.06, 0.04],
    ];
    let mut paint = || Paint {
        surface: Surface::Foliage,
        ..Paint::plain(shaded(rng.pick(&hues), tone))
    };
    let at = |i: usize, j: usize| top[j * (n + 1) + i];
    let ground = |p: DVec3| p.truncate().extend(-2.0);
    for j in 0..n {
        for i in 0..n {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            let paint = paint();
            let uv = |p: DVec3| [p.x - low.x + 1.0, p.y - low.y + 1.0].map(|x| x as f32);
            for [p, q, r] in [[a, b, c], [a, c, d]] {
                mesh.face_with(&[p, q, r], &[uv(p), uv(q), uv(r)], &[1.0; 3], paint);
            }
        }
    }
    for k in 0..n {
        let sides = [
            (at(k, 0), at(k + 1, 0)),
            (at(n, k), at(n, k + 1)),
            (at(n - k, n), at(n - k - 1, n)),
            (at(0, n - k), at(0, n - k - 1)),
        ];
        for (a, b) in sides {
            let ao = [0.4, 0.4, 1.0, 1.0];
            let corners = [ground(a), ground(b), b, a];
            let uv = corners.map(|p| [p.x - low.x + p.y - low.y, p.z + 3.0].map(|x| x as f32));
            mesh.face_with(&corners, &uv, &ao, paint());
        }
    }
}
