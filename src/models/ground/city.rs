//! A procedural city: terrain, streets, blocks, buildings, trees, a river, and the meshes, ground
//! map and surface model made from them.
//!
//! Streets are the seams of a smoothly warped grid cut by one diagonal avenue; each convex block
//! between them is built over by its district's habit: towers, perimeter rows, free-standing
//! slabs, houses in gardens, halls. The same `Part`s make the meshes and the surface raster, so
//! that what is seen and what blocks a sight line agree.

use glam::{DQuat, DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::models::ground::dsm::{Dsm, HeightGrid};
use crate::models::maths::rng::Stream;
use crate::models::shape::mesh::{MeshData, Paint, Surface, rectangle};

/// What a city looks like.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CityParams {
    /// Side of the built square about the site point [m].
    pub extent_m: f64,
    /// Seed of the layout.
    pub seed: u64,
    /// Share of lots that are built on, 0..1.
    pub building_density: f64,
    /// Height of the tallest downtown towers [m].
    pub max_height_m: f64,
    /// Peak height of the terrain's undulation [m].
    pub relief_m: f64,
    /// Whether a river crosses the city north of the site point.
    pub river: bool,
    /// Share of the area given to the main park, 0..0.3.
    pub park_share: f64,
    /// Most trees planted in a city; woods of `forest_share` have up to 15,000 of their own.
    pub max_trees: u32,
    /// Roof height of the station's tower [m].
    pub station_height_m: f64,
    /// Share of the land under woods, 0..1. Above 0 there is open country in place of the city: woods,
    /// fields, a road and a few houses, more of them with `building_density`; the station then has no
    /// tower and stands on the open ground at the site point.
    pub forest_share: f64,
}

impl Default for CityParams {
    fn default() -> Self {
        Self {
            extent_m: 2400.0,
            seed: 1,
            building_density: 0.93,
            max_height_m: 120.0,
            relief_m: 9.0,
            river: true,
            park_share: 0.04,
            max_trees: 2000,
            station_height_m: 45.0,
            forest_share: 0.0,
        }
    }
}

/// Why a city cannot be generated.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum CityError {
    /// A parameter is outside its range.
    #[error("city {field} = {value} is outside {low}..{high}")]
    OutOfRange {
        /// Parameter name.
        field: &'static str,
        /// Its value.
        value: f64,
        /// Least value.
        low: f64,
        /// Greatest value.
        high: f64,
    },
}

/// What a building is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BuildingKind {
    /// Detached house.
    House,
    /// Block of flats.
    Apartment,
    /// Office building.
    Office,
    /// Downtown high-rise.
    Tower,
    /// Hall or warehouse.
    Industrial,
    /// The tower that carries the counter-UAV station.
    Station,
    /// A bridge deck.
    Bridge,
}

/// A roof over a part; pitched ones need four corners and have their ridge along the first edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Roof {
    /// Level, inside a parapet of this height [m] (0: none).
    Flat(f64),
    /// Two slopes up to this height above the eaves [m].
    Gable(f64),
    /// Four slopes up to this height above the eaves [m].
    Hip(f64),
}

/// One extruded piece of a building.
#[derive(Clone, Debug)]
pub struct Part {
    /// Outline, counter-clockwise [m, ENU].
    pub outline_enu_m: Vec<DVec2>,
    /// Foot of the walls [m].
    pub bottom_m: f64,
    /// Top of the walls [m].
    pub eaves_m: f64,
    /// The roof.
    pub roof: Roof,
    /// What the walls are.
    pub surface: Surface,
    /// Linear RGB albedo of the walls.
    pub albedo: [f32; 3],
    /// Linear RGB albedo of the roof.
    pub roof_albedo: [f32; 3],
    /// Whether edges 1 and 3 are party walls without windows.
    pub blind_ends: bool,
}

impl Part {
    /// Highest point [m], the parapet included.
    pub fn top_m(&self) -> f64 {
        let (Roof::Flat(rise) | Roof::Gable(rise) | Roof::Hip(rise)) = self.roof;
        self.eaves_m + rise
    }

    /// Height of the roof over a point of the outline [m]; parapets are left out.
    fn roof_m(&self, p: DVec2) -> f64 {
        let o = &self.outline_enu_m;
        if o.len() != 4 {
            return self.eaves_m;
        }
        let from_edge = |i: usize| {
            let (a, b) = (o[i], o[(i + 1) % 4]);
            (b - a).normalize_or_zero().perp_dot(p - a).max(0.0)
        };
        let slope = |a: f64, b: f64| 2.0 * a.min(b) / (a + b).max(1e-9);
        match self.roof {
            Roof::Flat(_) => self.eaves_m,
            Roof::Gable(rise) => self.eaves_m + rise * slope(from_edge(0), from_edge(2)),
            Roof::Hip(rise) => {
                let (a, b) = (from_edge(0), from_edge(2));
                let end = 2.0 * from_edge(1).min(from_edge(3)) / (a + b).max(1e-9);
                self.eaves_m + rise * slope(a, b).min(end)
            }
        }
    }
}

/// A building: one or more parts.
#[derive(Clone, Debug)]
pub struct Building {
    /// What it is.
    pub kind: BuildingKind,
    /// Ground level, where facade coordinates start [m].
    pub base_m: f64,
    /// Random number in 0..1 that varies the facade.
    pub variant: f32,
    /// Its parts, main body first.
    pub parts: Vec<Part>,
}

impl Building {
    /// Outline of the main body, counter-clockwise [m, ENU].
    pub fn footprint_enu_m(&self) -> &[DVec2] {
        self.parts.first().map_or(&[], |p| &p.outline_enu_m)
    }

    /// Highest point above the base [m].
    pub fn height_m(&self) -> f64 {
        self.parts
            .iter()
            .map(Part::top_m)
            .fold(0.0, |top, z| f64::max(top, z - self.base_m))
    }
}

/// What a tree is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TreeKind {
    /// A broadleaf in leaf.
    Broadleaf,
    /// A broadleaf in autumn.
    Autumn,
    /// A broadleaf without leaves.
    Bare,
    /// A spruce or fir.
    Conifer,
}

/// A tree.
#[derive(Clone, Copy, Debug)]
pub struct Tree {
    /// What it is.
    pub kind: TreeKind,
    /// Whether it stands inside a wood, where only its top is seen.
    pub inner: bool,
    /// Foot of the trunk [m].
    pub base_enu_m: DVec3,
    /// Height [m].
    pub height_m: f64,
    /// Radius of the crown [m].
    pub crown_radius_m: f64,
    /// Random number in 0..1.
    pub variant: f32,
}

/// The ground seen from above, 8-bit sRGB; row 0 is the north edge, column 0 the west edge.
#[derive(Clone, Debug, PartialEq)]
pub struct GroundMap {
    /// Pixels per side.
    pub size_px: usize,
    /// RGB, row by row.
    pub rgb: Vec<[u8; 3]>,
}

/// A generated city.
#[derive(Clone, Debug)]
pub struct City {
    /// Heights and sight lines.
    pub dsm: Dsm,
    /// All buildings and bridges.
    pub buildings: Vec<Building>,
    /// All trees.
    pub trees: Vec<Tree>,
    /// Ground albedo over the built square, with the shadows last baked.
    pub ground_map: GroundMap,
    unshaded: GroundMap,
    /// What it was generated from.
    pub params: CityParams,
    river: Option<River>,
}

/// Residential storey height [m]; facade windows repeat with it.
const STOREY_M: f64 = 3.0;
/// Office storey height [m].
const OFFICE_STOREY_M: f64 = 3.6;
/// Width of a window bay [m]; walls hold a whole number of them.
const BAY_M: f64 = 3.0;
/// Side of a mesh tile [m].
const TILE_M: f64 = 300.0;
/// Spacing of the terrain mesh [m].
const TERRAIN_STEP_M: f64 = 25.0;
/// Reach of the land around the city [m].
const APRON_M: f64 = 8000.0;
/// Height of the sensors above the station's roof [m].
const STATION_MAST_M: f64 = 3.0;
/// Level of the river above the plain [m]; it runs between low walls.
const WATER_M: f64 = 0.25;
/// Ground-map resolution [px].
const MAP_PX: usize = 2048;

const TILES: [[f32; 3]; 5] = [
    [0.28, 0.085, 0.045],
    [0.22, 0.075, 0.045],
    [0.33, 0.13, 0.07],
    [0.14, 0.07, 0.05],
    [0.09, 0.09, 0.1],
];
const FLATS: [[f32; 3]; 5] = [
    [0.22, 0.21, 0.2],
    [0.12, 0.12, 0.125],
    [0.3, 0.29, 0.27],
    [0.17, 0.165, 0.15],
    [0.4, 0.4, 0.4],
];
const WALLS: [[f32; 3]; 9] = [
    [0.3, 0.12, 0.075], // brick
    [0.24, 0.1, 0.07],  // dark brick
    [0.6, 0.52, 0.38],  // cream plaster
    [0.55, 0.38, 0.2],  // ochre plaster
    [0.66, 0.63, 0.57], // white plaster
    [0.47, 0.4, 0.3],   // sandstone
    [0.4, 0.4, 0.38],   // concrete
    [0.5, 0.33, 0.26],  // pink plaster
    [0.38, 0.42, 0.38], // grey-green plaster
];
const OFFICES: [[f32; 3]; 6] = [
    [0.1, 0.14, 0.17],  // blue glass
    [0.16, 0.19, 0.19], // green glass
    [0.42, 0.42, 0.4],  // concrete
    [0.55, 0.53, 0.48], // light stone
    [0.2, 0.17, 0.14],  // bronze
    [0.34, 0.26, 0.2],  // brown stone
];

/// A river along n = f(e).
#[derive(Clone, Debug)]
struct River {
    center_n_m: f64,
    swing_m: f64,
    phase: f64,
    half_width_m: f64,
}

impl River {
    const WAVE_M: f64 = 420.0;

    fn north_m(&self, e: f64) -> f64 {
        self.center_n_m + self.swing_m * (e / Self::WAVE_M + self.phase).sin()
    }

    fn slope(&self, e: f64) -> f64 {
        self.swing_m / Self::WAVE_M * (e / Self::WAVE_M + self.phase).cos()
    }

    /// Unit normal of the river's course, pointing north.
    fn normal(&self, e: f64) -> DVec2 {
        DVec2::new(-self.slope(e), 1.0).normalize()
    }

    /// Distance to the centre line [m], positive north of it.
    fn offset_m(&self, p: DVec2) -> f64 {
        (p.y - self.north_m(p.x)) * self.normal(p.x).y
    }
}

/// Smooth value noise on a periodic lattice, -1..1.
struct Noise(Vec<f64>);

impl Noise {
    fn new(seed: u64) -> Self {
        let mut rng = Stream::new(seed, 0, "city-noise");
        Self((0..64 * 64).map(|_| rng.range(-1.0, 1.0)).collect())
    }

    fn at(&self, p: DVec2) -> f64 {
        let cell = p.floor();
        let f = p - cell;
        let f = f * f * (DVec2::splat(3.0) - 2.0 * f);
        let value = |di: i64, dj: i64| {
            let i = (cell.x as i64 + di).rem_euclid(64) as usize;
            let j = (cell.y as i64 + dj).rem_euclid(64) as usize;
            self.0[j * 64 + i]
        };
        let south = value(0, 0) + (value(1, 0) - value(0, 0)) * f.x;
        let north = value(0, 1) + (value(1, 1) - value(0, 1)) * f.x;
        south + (north - south) * f.y
    }
}

fn smoothstep(low: f64, high: f64, x: f64) -> f64 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

fn pick<T: Copy>(rng: &mut Stream, of: &[T]) -> T {
    of[((rng.uniform() * of.len() as f64) as usize).min(of.len() - 1)]
}

fn shaded(albedo: [f32; 3], factor: f64) -> [f32; 3] {
    albedo.map(|c| (c * factor as f32).min(0.9))
}

// ---- Convex polygons -------------------------------------------------------------------------

/// The part of a convex polygon on the side `normal` points to.
fn clip(outline: &[DVec2], through: DVec2, normal: DVec2) -> Vec<DVec2> {
    let side = |p: DVec2| (p - through).dot(normal);
    let mut kept = Vec::with_capacity(outline.len() + 1);
    for (k, &a) in outline.iter().enumerate() {
        let b = outline[(k + 1) % outline.len()];
        let (sa, sb) = (side(a), side(b));
        if sa >= 0.0 {
            kept.push(a);
        }
        if (sa >= 0.0) != (sb >= 0.0) {
            kept.push(a.lerp(b, sa / (sa - sb)));
        }
    }
    kept
}

/// A convex polygon moved inward by a distance per edge.
fn inset(outline: &[DVec2], by_m: impl Fn(usize) -> f64) -> Vec<DVec2> {
    let n = outline.len();
    (0..n).fold(outline.to_vec(), |rest, k| {
        let (a, b) = (outline[k], outline[(k + 1) % n]);
        let inward = (b - a).perp().normalize_or_zero();
        clip(&rest, a + inward * by_m(k), inward)
    })
}

/// Merges corners closer than `gap_m`.
fn simplified(outline: &[DVec2], gap_m: f64) -> Vec<DVec2> {
    let mut kept: Vec<DVec2> = Vec::with_capacity(outline.len());
    for &p in outline {
        if kept.iter().all(|q| q.distance(p) > gap_m) {
            kept.push(p);
        }
    }
    kept
}

fn area_m2(outline: &[DVec2]) -> f64 {
    let n = outline.len();
    (0..n)
        .map(|k| 0.5 * outline[k].perp_dot(outline[(k + 1) % n]))
        .sum()
}

fn centroid(outline: &[DVec2]) -> DVec2 {
    let first = outline.first().copied().unwrap_or_default();
    let (mut sum, mut area) = (DVec2::ZERO, 0.0);
    for k in 2..outline.len() {
        let (a, b) = (outline[k - 1] - first, outline[k] - first);
        let twice = a.perp_dot(b);
        sum += (a + b) * twice / 3.0;
        area += twice;
    }
    if area.abs() > 1e-9 {
        first + sum / area
    } else {
        first
    }
}

fn contains(outline: &[DVec2], p: DVec2) -> bool {
    (0..outline.len()).all(|k| {
        let (a, b) = (outline[k], outline[(k + 1) % outline.len()]);
        (b - a).perp_dot(p - a) >= 0.0
    })
}

/// Direction of the longest edge.
fn main_axis(outline: &[DVec2]) -> DVec2 {
    let n = outline.len();
    (0..n)
        .map(|k| outline[(k + 1) % n] - outline[k])
        .fold(DVec2::ZERO, |best, e| {
            if e.length() > best.length() { e } else { best }
        })
        .normalize_or(DVec2::X)
}

/// Least and greatest coordinate along an axis.
fn span(outline: &[DVec2], axis: DVec2) -> [f64; 2] {
    outline
        .iter()
        .map(|p| p.dot(axis))
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| {
            [low.min(x), high.max(x)]
        })
}

/// Splits a convex block across its longer side until its lots are small enough.
fn split_lots(outline: Vec<DVec2>, lot_m2: f64, rng: &mut Stream, lots: &mut Vec<Vec<DVec2>>) {
    if area_m2(&outline) < lot_m2 * rng.range(1.0, 1.7) {
        lots.push(outline);
        return;
    }
    let axis = main_axis(&outline);
    let extent = |axis: DVec2| span(&outline, axis)[1] - span(&outline, axis)[0];
    let across = if extent(axis) >= extent(axis.perp()) {
        axis
    } else {
        axis.perp()
    };
    let at = centroid(&outline) + across * extent(across) * rng.range(-0.09, 0.09);
    split_lots(clip(&outline, at, across), lot_m2, rng, lots);
    split_lots(clip(&outline, at, -across), lot_m2, rng, lots);
}

/// A large rectangle inside a convex polygon about its centroid: centre, axis and half sizes.
fn inner_rectangle(outline: &[DVec2], axis: DVec2) -> (DVec2, DVec2, DVec2) {
    let center = centroid(outline);
    let half = |axis: DVec2| {
        let [low, high] = span(outline, axis);
        (high - center.dot(axis)).min(center.dot(axis) - low)
    };
    let mut half = DVec2::new(half(axis), half(axis.perp()));
    for _ in 0..30 {
        if rectangle(center, axis, half)
            .iter()
            .all(|&c| contains(outline, c))
        {
            break;
        }
        half *= 0.95;
    }
    (center, axis, half)
}

// ---- Ground map ------------------------------------------------------------------------------

impl GroundMap {
    fn pixel_m(&self, extent_m: f64) -> f64 {
        extent_m / self.size_px as f64
    }

    /// Blends a convex polygon in, anti-aliased by the distance to its edges.
    fn paint(&mut self, extent_m: f64, outline: &[DVec2], rgb: [u8; 3], alpha: f64) {
        let px = self.pixel_m(extent_m);
        let half = extent_m / 2.0;
        let n = outline.len();
        if n < 3 {
            return;
        }
        // Clipping may leave edges without length, which have no inside.
        let edges: Vec<(DVec2, DVec2)> = (0..n)
            .filter_map(|k| {
                let (a, b) = (outline[k], outline[(k + 1) % n]);
                Some((a, (b - a).perp().try_normalize()?))
            })
            .collect();
        let clamp = |x: f64| x.clamp(0.0, self.size_px as f64) as usize;
        let [e0, e1] = span(outline, DVec2::X);
        let [n0, n1] = span(outline, DVec2::Y);
        let columns = clamp((e0 + half) / px - 1.0)..clamp((e1 + half) / px + 2.0);
        for row in clamp((half - n1) / px - 1.0)..clamp((half - n0) / px + 2.0) {
            let y = half - (row as f64 + 0.5) * px;
            for column in columns.clone() {
                let p = DVec2::new((column as f64 + 0.5) * px - half, y);
                let inside = edges
                    .iter()
                    .map(|&(a, inward)| (p - a).dot(inward))
                    .fold(f64::INFINITY, f64::min);
                let cover = (inside / px + 0.5).clamp(0.0, 1.0) * alpha;
                if cover > 0.0 {
                    let pixel = &mut self.rgb[row * self.size_px + column];
                    for (old, new) in pixel.iter_mut().zip(rgb) {
                        *old = (f64::from(*old) + (f64::from(new) - f64::from(*old)) * cover)
                            .round() as u8;
                    }
                }
            }
        }
    }

    /// Paints a line of some width; what is thinner than a pixel blends by its share of it.
    fn stroke(
        &mut self,
        extent_m: f64,
        [a, b]: [DVec2; 2],
        width_m: f64,
        rgb: [u8; 3],
        alpha: f64,
    ) {
        let px = self.pixel_m(extent_m);
        let axis = (b - a).normalize_or(DVec2::X);
        let half = DVec2::new(a.distance(b) / 2.0, width_m.max(px) / 2.0);
        self.paint(
            extent_m,
            &rectangle((a + b) / 2.0, axis, half),
            rgb,
            alpha * (width_m / px).min(1.0),
        );
    }
}

// ---- Generation ------------------------------------------------------------------------------

/// The city while it is being made.
struct Plan<'a> {
    params: &'a CityParams,
    rng: Stream,
    noise: Noise,
    river: Option<River>,
    map: GroundMap,
    buildings: Vec<Building>,
    trees: Vec<Tree>,
}

/// One of the two families of grid lines: coordinates and street widths [m].
struct Lines {
    at_m: Vec<f64>,
    width_m: Vec<f64>,
}

impl Lines {
    fn new(rng: &mut Stream, reach_m: f64) -> Self {
        let first = rng.range(96.0, 112.0);
        let mut at_m = vec![-first / 2.0, first / 2.0];
        while at_m[at_m.len() - 1] < reach_m {
            at_m.push(at_m[at_m.len() - 1] + rng.range(74.0, 132.0));
        }
        while at_m[0] > -reach_m {
            at_m.insert(0, at_m[0] - rng.range(74.0, 132.0));
        }
        let phase = (rng.uniform() * 4.0) as usize;
        let width_m = (0..at_m.len())
            .map(|k| {
                if k % 4 == phase {
                    27.0
                } else {
                    rng.range(12.5, 16.0)
                }
            })
            .collect();
        Self { at_m, width_m }
    }
}

/// Street width from which a street counts as an avenue [m].
const AVENUE_M: f64 = 20.0;

impl Plan<'_> {
    fn ground_m(&self, p: DVec2) -> f64 {
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

    fn lowest_m(&self, outline: &[DVec2]) -> f64 {
        outline
            .iter()
            .map(|&p| self.ground_m(p))
            .fold(f64::INFINITY, f64::min)
    }

    /// How much downtown a place is, 0..1.
    fn downtown(&self, p: DVec2) -> f64 {
        let extent = self.params.extent_m;
        let from = p - DVec2::new(-0.19, -0.17) * extent;
        (-0.5 * from.length_squared() / (0.105 * extent).powi(2)).exp()
    }

    /// Greatest height allowed so that the station keeps its view [m].
    fn height_cap_m(&self, p: DVec2) -> f64 {
        let near = self.params.station_height_m - 16.0;
        near + (p.length() - 260.0).max(0.0) * 0.5
    }

    fn paint(&mut self, outline: &[DVec2], rgb: [u8; 3]) {
        self.map.paint(self.params.extent_m, outline, rgb, 1.0);
    }

    fn plant(&mut self, p: DVec2, size: f64) {
        let half = self.params.extent_m / 2.0 - 6.0;
        let wet = self
            .river
            .as_ref()
            .is_some_and(|r| r.offset_m(p).abs() < r.half_width_m + 3.0);
        if wet || p.abs().max_element() > half {
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

    /// Adds a building made of upright parts (outline, foot above base, walls' top above base, roof).
    fn build(
        &mut self,
        kind: BuildingKind,
        surface: Surface,
        [albedo, roof_albedo]: [[f32; 3]; 2],
        parts: Vec<(Vec<DVec2>, f64, f64, Roof)>,
        blind_ends: bool,
    ) {
        let base_m = parts.first().map_or(0.0, |p| self.lowest_m(&p.0));
        let mut made: Vec<Part> = parts
            .into_iter()
            .map(|(outline_enu_m, low, high, roof)| Part {
                outline_enu_m,
                bottom_m: base_m + low,
                eaves_m: base_m + high,
                roof,
                surface,
                albedo,
                roof_albedo,
                blind_ends,
            })
            .collect();
        let mut extras = Vec::new();
        for part in &made {
            if matches!(part.roof, Roof::Flat(_)) {
                extras.extend(self.roof_plant(part));
            } else {
                extras.extend(self.chimney(part));
            }
        }
        made.extend(extras);
        let variant = self.rng.uniform() as f32;
        self.buildings.push(Building {
            kind,
            base_m,
            variant,
            parts: made,
        });
    }

    /// A chimney that pierces a pitched roof near its ridge.
    fn chimney(&mut self, roof: &Part) -> Option<Part> {
        let o = &roof.outline_enu_m;
        let axis = (o[1] - o[0]).normalize_or(DVec2::X);
        let along = self.rng.range(0.25, 0.75);
        let at = o[0]
            .lerp(o[1], along)
            .lerp(o[3].lerp(o[2], along), self.rng.range(0.36, 0.64));
        let half = DVec2::new(self.rng.range(0.4, 0.9), 0.35);
        let tone = [0.3, 0.14, 0.1];
        (self.rng.uniform() < 0.4).then(|| Part {
            outline_enu_m: rectangle(at, axis, half).to_vec(),
            bottom_m: roof.eaves_m,
            eaves_m: roof.top_m() + 0.9,
            roof: Roof::Flat(0.0),
            surface: Surface::Plain,
            albedo: tone,
            roof_albedo: [0.05; 3],
            blind_ends: false,
        })
    }

    /// Stair heads, machine rooms, ducts and masts on a flat roof.
    fn roof_plant(&mut self, roof: &Part) -> Vec<Part> {
        let area = area_m2(&roof.outline_enu_m);
        let height = roof.eaves_m - roof.bottom_m;
        let count = match area {
            a if a < 120.0 => 0,
            a if a < 300.0 => 1,
            a if a < 900.0 => 2,
            _ => 4,
        };
        let axis = main_axis(&roof.outline_enu_m);
        let center = centroid(&roof.outline_enu_m);
        let mut plants = Vec::new();
        for k in 0..count {
            let corner = pick(&mut self.rng, &roof.outline_enu_m);
            let at = center.lerp(
                corner,
                if k == 0 {
                    0.15
                } else {
                    self.rng.range(0.2, 0.6)
                },
            );
            let half = DVec2::new(self.rng.range(1.2, 3.4), self.rng.range(1.0, 2.2));
            let outline = rectangle(at, axis, half * if k == 0 { 1.3 } else { 0.8 });
            if !all_inside(&roof.outline_enu_m, &outline) {
                continue;
            }
            let rise = if k == 0 {
                self.rng.range(2.4, 3.6)
            } else {
                self.rng.range(0.9, 2.2)
            };
            let tone = self.rng.range(0.2, 0.55) as f32;
            plants.push((outline.to_vec(), rise, [tone, tone, tone * 0.97]));
        }
        if height > 40.0 || (area > 250.0 && self.rng.uniform() < 0.12) {
            let mast = rectangle(center + axis * 2.0, axis, DVec2::splat(0.18)).to_vec();
            plants.push((
                mast,
                self.rng.range(5.0, 6.0) + 0.08 * height,
                [0.35, 0.34, 0.33],
            ));
        }
        plants
            .into_iter()
            .map(|(outline_enu_m, rise, albedo)| Part {
                outline_enu_m,
                bottom_m: roof.eaves_m,
                eaves_m: roof.eaves_m + rise,
                roof: Roof::Flat(0.0),
                surface: Surface::Plain,
                albedo,
                roof_albedo: shaded(albedo, 0.9),
                blind_ends: false,
            })
            .collect()
    }

    /// Attached houses along the edges of a block around a court.
    fn perimeter_block(&mut self, outline: &[DVec2]) {
        let outline = simplified(outline, 9.0);
        let n = outline.len();
        let depth = self.rng.range(11.0, 13.5);
        let shrunk = inset(&outline, |_| depth + 5.0);
        if n < 3 || shrunk.len() < n || area_m2(&shrunk) < 250.0 {
            return self.free_block(&outline, 900.0);
        }
        // Mitred inner corner: where the offset lines of the two edges meet.
        let inward = |k: usize| {
            (outline[(k + 1) % n] - outline[k])
                .perp()
                .normalize_or_zero()
        };
        let inner: Vec<DVec2> = (0..n)
            .map(|k| {
                let (a, b) = (inward((k + n - 1) % n), inward(k));
                outline[k] + (a + b) * depth / (1.0 + a.dot(b)).max(0.25)
            })
            .collect();
        self.paint(&inner, [96, 108, 78]);
        let storeys = 4.0
            + 2.5 * smoothstep(0.02, 0.4, self.downtown(centroid(&outline)))
            + self.rng.range(0.0, 1.9);
        let pitched = self.rng.uniform() < 0.72;
        for k in 0..n {
            let l = (k + 1) % n;
            let length = outline[k].distance(outline[l]);
            let houses = (length / self.rng.range(17.0, 25.0)).round().max(1.0);
            for h in 0..houses as usize {
                let cut = |i: usize| i as f64 / houses;
                let (t, u) = (cut(h), cut(h + 1));
                let quad = vec![
                    outline[k].lerp(outline[l], t),
                    outline[k].lerp(outline[l], u),
                    inner[k].lerp(inner[l], u),
                    inner[k].lerp(inner[l], t),
                ];
                if self.rng.uniform() > self.params.building_density + 0.04 {
                    self.paint(&quad, [120, 116, 108]);
                    continue;
                }
                let floors = (storeys + self.rng.range(-0.9, 1.3)).round().max(2.0);
                let cap = self.height_cap_m(centroid(&quad));
                let eaves = (floors * STOREY_M + 0.6).min(cap);
                let wall = pick(&mut self.rng, &WALLS);
                let wall = shaded(wall, self.rng.range(0.8, 1.1));
                let pitched = if self.rng.uniform() < 0.85 {
                    pitched
                } else {
                    !pitched
                };
                let (roof, cover) = if pitched {
                    let tile = pick(&mut self.rng, &TILES);
                    (
                        Roof::Gable(self.rng.range(3.2, 4.8)),
                        shaded(tile, self.rng.range(0.8, 1.15)),
                    )
                } else {
                    (Roof::Flat(0.8), pick(&mut self.rng, &FLATS))
                };
                self.build(
                    BuildingKind::Apartment,
                    Surface::FacadeResidential,
                    [wall, cover],
                    vec![(quad, 0.0, eaves, roof)],
                    true,
                );
            }
        }
        for _ in 0..(area_m2(&inner) / 900.0) as usize {
            let at = centroid(&inner).lerp(pick(&mut self.rng, &inner), self.rng.range(0.0, 0.65));
            self.plant(at, 0.9);
        }
    }

    /// Free-standing L-, U- and I-shaped blocks of flats or small offices on green lots.
    fn free_block(&mut self, outline: &[DVec2], lot_m2: f64) {
        self.paint(outline, [92, 112, 66]);
        let mut lots = Vec::new();
        split_lots(outline.to_vec(), lot_m2, &mut self.rng, &mut lots);
        for lot in lots {
            let (center, axis, half) = inner_rectangle(&lot, main_axis(&lot));
            let half = half - DVec2::splat(3.0);
            if half.min_element() < 5.0 || self.rng.uniform() > self.params.building_density {
                self.plant(center, 1.0);
                continue;
            }
            let d = self.rng.range(11.0, 13.0);
            let place = |x: f64, y: f64| center + axis * x + axis.perp() * y;
            let (a, b) = (half.x, half.y);
            let shape: Vec<[f64; 2]> = match self.rng.uniform() {
                _ if b < d * 0.9 || a < d * 0.9 => vec![[-a, -b], [a, -b], [a, b], [-a, b]],
                r if r < 0.35 => vec![
                    [-a, -b],
                    [a, -b],
                    [a, d - b],
                    [d - a, d - b],
                    [d - a, b],
                    [-a, b],
                ],
                r if r < 0.6 && a > 1.3 * d => vec![
                    [-a, -b],
                    [a, -b],
                    [a, b],
                    [a - d, b],
                    [a - d, d - b],
                    [d - a, d - b],
                    [d - a, b],
                    [-a, b],
                ],
                _ => vec![[-a, -d / 2.0], [a, -d / 2.0], [a, d / 2.0], [-a, d / 2.0]],
            };
            let shape: Vec<DVec2> = shape.into_iter().map(|[x, y]| place(x, y)).collect();
            let tall = self.rng.uniform() < 0.14;
            let floors = if tall {
                self.rng.range(10.0, 15.0)
            } else {
                self.rng.range(4.0, 8.0)
            }
            .round();
            let height = (floors * STOREY_M).min(self.height_cap_m(center));
            let wall = pick(&mut self.rng, &WALLS[2..]);
            let cover = pick(&mut self.rng, &FLATS);
            let looks = [shaded(wall, self.rng.range(0.85, 1.15)), cover];
            self.build(
                BuildingKind::Apartment,
                Surface::FacadeResidential,
                looks,
                vec![(shape, 0.0, height, Roof::Flat(0.8))],
                false,
            );
            for _ in 0..2 {
                let at = pick(&mut self.rng, &lot).lerp(center, self.rng.range(0.1, 0.25));
                self.plant(at, 1.0);
            }
        }
    }

    /// Towers and offices that fill their lots, the tall ones with podium and set-backs.
    fn downtown_block(&mut self, outline: &[DVec2]) {
        self.paint(outline, [142, 138, 132]);
        let mut lots = Vec::new();
        split_lots(outline.to_vec(), 1500.0, &mut self.rng, &mut lots);
        for lot in lots {
            let lot = simplified(&inset(&lot, |_| 2.2), 3.0);
            if lot.len() < 3
                || area_m2(&lot) < 180.0
                || self.rng.uniform() > self.params.building_density
            {
                continue;
            }
            let center = centroid(&lot);
            let core = self.downtown(center);
            let cap = self.height_cap_m(center).min(self.params.max_height_m);
            let rank = self.rng.uniform().powf(1.8);
            let height = (18.0
                + (self.params.max_height_m - 18.0) * core.powf(1.3) * (0.22 + 0.78 * rank))
                .min(cap);
            let storeys = |h: f64| (h / OFFICE_STOREY_M).round().max(2.0) * OFFICE_STOREY_M;
            let height = storeys(height);
            let albedo = pick(&mut self.rng, &OFFICES);
            let looks = [
                shaded(albedo, self.rng.range(0.85, 1.2)),
                pick(&mut self.rng, &FLATS),
            ];
            let surface = Surface::FacadeOffice;
            if height < 42.0 {
                let parts = vec![(lot, 0.0, height, Roof::Flat(1.0))];
                self.build(BuildingKind::Office, surface, looks, parts, false);
                continue;
            }
            let podium = storeys(self.rng.range(10.0, 17.0));
            let (at, axis, half) = inner_rectangle(&inset(&lot, |_| 2.0), main_axis(&lot));
            let half = half.min(DVec2::splat(19.0));
            let waist = storeys(podium + (height - podium) * self.rng.range(0.55, 0.8));
            let shaft = |scale: f64| rectangle(at, axis, half * scale).to_vec();
            let parts = if self.rng.uniform() < 0.5 {
                vec![
                    (lot, 0.0, podium, Roof::Flat(1.0)),
                    (shaft(1.0), podium, waist, Roof::Flat(1.0)),
                    (shaft(0.72), waist, height, Roof::Flat(1.2)),
                ]
            } else {
                vec![
                    (lot, 0.0, podium, Roof::Flat(1.0)),
                    (shaft(0.95), podium, height, Roof::Flat(1.2)),
                ]
            };
            self.build(BuildingKind::Tower, surface, looks, parts, false);
        }
    }

    /// Houses in gardens.
    fn house_block(&mut self, outline: &[DVec2]) {
        self.paint(outline, [88, 112, 58]);
        let mut lots = Vec::new();
        split_lots(outline.to_vec(), 560.0, &mut self.rng, &mut lots);
        for lot in lots {
            let tint = self.rng.range(-10.0, 12.0);
            let grass = [86.0 + tint, 108.0 + tint, 60.0 + tint * 0.6].map(|c: f64| c as u8);
            self.paint(&inset(&lot, |_| 0.6), grass);
            let (center, axis, half) = inner_rectangle(&lot, main_axis(&lot));
            if self.rng.uniform() > self.params.building_density || half.min_element() < 5.0 {
                self.plant(center, 0.8);
                continue;
            }
            let half = (half - DVec2::splat(2.5)).min(DVec2::new(
                self.rng.range(5.5, 8.0),
                self.rng.range(4.2, 5.5),
            ));
            let eaves = if self.rng.uniform() < 0.6 {
                2.0 * STOREY_M
            } else {
                STOREY_M + 0.4
            };
            let rise = half.y * self.rng.range(0.6, 0.95);
            let roof = if self.rng.uniform() < 0.3 {
                Roof::Hip(rise)
            } else {
                Roof::Gable(rise)
            };
            let wall = pick(&mut self.rng, &WALLS);
            let tile = pick(&mut self.rng, &TILES);
            let at = center + axis.perp() * self.rng.range(-1.5, 1.5);
            let looks = [
                shaded(wall, self.rng.range(0.9, 1.15)),
                shaded(tile, self.rng.range(0.8, 1.2)),
            ];
            self.build(
                BuildingKind::House,
                Surface::FacadeResidential,
                looks,
                vec![(rectangle(at, axis, half).to_vec(), 0.0, eaves, roof)],
                false,
            );
            if self.rng.uniform() < 0.55 {
                let at = pick(&mut self.rng, &lot).lerp(center, 0.2);
                self.plant(at, 0.72);
            }
        }
    }

    /// Halls on paved yards.
    fn hall_block(&mut self, outline: &[DVec2]) {
        self.paint(outline, [128, 125, 120]);
        let mut lots = Vec::new();
        split_lots(outline.to_vec(), 3800.0, &mut self.rng, &mut lots);
        for lot in lots {
            let (center, axis, half) = inner_rectangle(&lot, main_axis(&lot));
            let half = half - DVec2::splat(5.0);
            if half.min_element() < 8.0 {
                continue;
            }
            let tone = self.rng.range(0.3, 0.62) as f32;
            let wall = [tone, tone, tone * self.rng.range(0.9, 1.08) as f32];
            let height = self.rng.range(6.5, 11.0);
            let looks = [wall, pick(&mut self.rng, &FLATS)];
            self.build(
                BuildingKind::Industrial,
                Surface::Plain,
                looks,
                vec![(
                    rectangle(center, axis, half).to_vec(),
                    0.0,
                    height,
                    Roof::Flat(0.5),
                )],
                false,
            );
        }
    }

    /// Lawn, crossing paths and groups of trees.
    fn park_block(&mut self, outline: &[DVec2]) {
        self.paint(outline, [84, 112, 52]);
        let n = outline.len();
        let extent = self.params.extent_m;
        let center = centroid(outline);
        for k in 0..n {
            let middle = outline[k].lerp(outline[(k + 1) % n], 0.5);
            self.map
                .stroke(extent, [middle, center], 3.0, [176, 164, 138], 1.0);
        }
        let [e0, e1] = span(outline, DVec2::X);
        let [n0, n1] = span(outline, DVec2::Y);
        for _ in 0..(area_m2(outline) / 260.0) as usize {
            let p = DVec2::new(self.rng.range(e0, e1), self.rng.range(n0, n1));
            if contains(outline, p) && self.noise.at(p / 45.0) > -0.15 {
                self.plant(p, 1.15);
            }
        }
    }

    /// The paved square with the station's tower at the site point.
    fn station_block(&mut self, outline: &[DVec2]) {
        self.paint(outline, [158, 152, 142]);
        let lawn = inset(outline, |_| 8.0);
        self.paint(&lawn, [90, 114, 60]);
        let axis = main_axis(outline);
        self.paint(
            &rectangle(DVec2::ZERO, axis, DVec2::splat(19.0)),
            [164, 158, 148],
        );
        // A shaft with a small platform on top: the sensors look down past its edge.
        let ground = self.ground_m(DVec2::ZERO);
        let top = ground + self.params.station_height_m;
        let shaft = rectangle(DVec2::ZERO, axis, DVec2::splat(10.5)).to_vec();
        let base_m = self.lowest_m(&shaft);
        let platform = rectangle(DVec2::ZERO, axis, DVec2::splat(3.0)).to_vec();
        let part = |outline_enu_m, bottom_m, eaves_m, parapet, surface, albedo| Part {
            outline_enu_m,
            bottom_m,
            eaves_m,
            roof: Roof::Flat(parapet),
            surface,
            albedo,
            roof_albedo: [0.24, 0.24, 0.24],
            blind_ends: false,
        };
        let deck = top - 4.0;
        let (office, light) = (Surface::FacadeOffice, [0.42, 0.42, 0.4]);
        self.buildings.push(Building {
            kind: BuildingKind::Station,
            base_m,
            variant: 0.4,
            parts: vec![
                part(shaft, base_m, deck, 0.9, office, light),
                part(platform, deck, top, 0.0, Surface::Plain, [0.3, 0.3, 0.3]),
            ],
        });
        for k in 0..lawn.len() {
            let (a, b) = (lawn[k], lawn[(k + 1) % lawn.len()]);
            for t in 0..6 {
                self.plant(a.lerp(b, (f64::from(t) + 0.5) / 6.0), 0.9);
            }
        }
    }

    /// A strip of roadway between two crossings: markings, parked cars, avenue trees.
    fn street(&mut self, [a, b]: [DVec2; 2], width_m: f64) {
        let extent = self.params.extent_m;
        let half = extent / 2.0;
        if a.abs().max_element() > half && b.abs().max_element() > half {
            return;
        }
        let axis = (b - a).normalize_or(DVec2::X);
        let length = a.distance(b);
        let avenue = width_m > AVENUE_M;
        let at = |along: f64, left: f64| a + axis * along + axis.perp() * left;
        let (white, clear) = ([226, 224, 216], width_m * 0.75);
        // Dashes of 3 m every 9 m are near the map's resolution; they read as a broken line.
        let lanes: &[f64] = if avenue { &[-3.4, 3.4] } else { &[0.0] };
        for &lane in lanes {
            let mut s = clear;
            while s + 3.0 < length - clear {
                self.map
                    .stroke(extent, [at(s, lane), at(s + 3.0, lane)], 0.3, white, 1.0);
                s += 9.0;
            }
        }
        if avenue {
            self.map.stroke(
                extent,
                [at(clear, 0.0), at(length - clear, 0.0)],
                0.35,
                white,
                0.9,
            );
        }
        for s in [clear - 3.0, length - clear + 3.0] {
            // A zebra crossing: half of it is paint.
            self.map.stroke(
                extent,
                [at(s, 0.35 - width_m / 2.0), at(s, width_m / 2.0 - 0.35)],
                3.2,
                white,
                0.45,
            );
        }
        for side in [-1.0, 1.0] {
            let mut s = clear + 4.0;
            while s < length - clear - 5.0 {
                let lane = side * (width_m / 2.0 - if avenue { 4.7 } else { 4.4 });
                if self.rng.uniform() < 0.55 {
                    let tone = pick(
                        &mut self.rng,
                        &[
                            [28, 29, 32],
                            [205, 206, 208],
                            [120, 124, 130],
                            [116, 28, 26],
                            [36, 52, 92],
                        ],
                    );
                    self.map
                        .stroke(extent, [at(s, lane), at(s + 4.3, lane)], 1.9, tone, 1.0);
                }
                s += 5.6;
            }
            if avenue {
                let mut s = clear;
                while s < length - clear {
                    self.plant(at(s, side * (width_m / 2.0 - 1.6)), 0.85);
                    s += self.rng.range(12.0, 16.0);
                }
            }
        }
    }

    fn block(&mut self, kerb: &[DVec2], park: bool, center: bool) {
        let Some(river) = self.river.clone() else {
            return self.dry_block(kerb, park, center);
        };
        let near = centroid(kerb);
        let normal = river.normal(near.x);
        let on_line = DVec2::new(near.x, river.north_m(near.x));
        let bank = river.half_width_m + 13.0;
        if kerb.iter().all(|&p| (p - on_line).dot(normal).abs() > bank) {
            return self.dry_block(kerb, park, center);
        }
        for side in [-1.0, 1.0] {
            let shore = clip(kerb, on_line + normal * bank * side, normal * side);
            self.dry_block(&shore, park, center);
        }
    }

    fn dry_block(&mut self, kerb: &[DVec2], park: bool, center: bool) {
        if kerb.len() < 3 || area_m2(kerb) < 500.0 {
            return self.paint(kerb, [140, 136, 128]);
        }
        self.paint(kerb, [150, 146, 139]);
        if center {
            return self.station_block(kerb);
        }
        if park {
            return self.park_block(kerb);
        }
        let lots = inset(kerb, |_| 3.4);
        if area_m2(&lots) < 350.0 {
            return;
        }
        let at = centroid(&lots);
        let out = at.length() / (self.params.extent_m / 2.0);
        let district = self.noise.at(at / 330.0 + DVec2::new(31.7, 5.2));
        let dice = self.rng.uniform();
        if dice < 0.025 {
            self.park_block(&lots);
        } else if self.downtown(at) > 0.32 {
            self.downtown_block(&lots);
        } else if out > 0.62 && district > 0.45 {
            self.hall_block(&lots);
        } else if out + 0.28 * district < 0.68 {
            if dice < 0.14 {
                self.free_block(&lots, 2300.0)
            } else {
                self.perimeter_block(&lots)
            }
        } else if dice < 0.2 {
            self.free_block(&lots, 2600.0);
        } else {
            self.house_block(&lots);
        }
    }

    fn bridge(&mut self, [a, b]: [DVec2; 2], width_m: f64) {
        let Some(river) = self.river.clone() else {
            return;
        };
        let (sa, sb) = (river.offset_m(a), river.offset_m(b));
        if sa * sb >= 0.0 {
            return;
        }
        let middle = a.lerp(b, sa / (sa - sb));
        if middle.abs().max_element() > self.params.extent_m / 2.0 - 60.0 {
            return;
        }
        let axis = (b - a).normalize_or(DVec2::Y);
        let across = axis.dot(river.normal(middle.x)).abs();
        // An avenue that runs along the river has no bridge.
        if across < 0.75 {
            return;
        }
        let reach = (river.half_width_m + 9.0) / across;
        let deck = |half: f64| rectangle(middle, axis, DVec2::new(reach, half)).to_vec();
        let part = |outline: Vec<DVec2>, bottom_m: f64, eaves_m: f64, parapet: f64| Part {
            outline_enu_m: outline,
            bottom_m,
            eaves_m,
            roof: Roof::Flat(parapet),
            surface: Surface::Plain,
            albedo: [0.42, 0.4, 0.36],
            roof_albedo: [0.13, 0.13, 0.132],
            blind_ends: false,
        };
        let mut parts = vec![part(deck(width_m / 2.0 - 2.0), 1.2, 2.3, 1.0)];
        for k in [-0.4, 0.0, 0.4] {
            let pier = rectangle(
                middle + axis * reach * k,
                axis,
                DVec2::new(1.5, width_m / 2.0 - 3.0),
            );
            parts.push(part(pier.to_vec(), WATER_M - 1.0, 1.2, 0.0));
        }
        self.buildings.push(Building {
            kind: BuildingKind::Bridge,
            base_m: 0.0,
            variant: 0.0,
            parts,
        });
    }

    fn river_banks(&mut self) {
        let Some(river) = self.river.clone() else {
            return;
        };
        let half = self.params.extent_m / 2.0;
        let steps = 200;
        let at = |k: usize, off: f64| {
            let e = -half + 2.0 * half * k as f64 / steps as f64;
            DVec2::new(e, river.north_m(e)) + river.normal(e) * off
        };
        for (reach, rgb) in [
            (river.half_width_m + 5.0, [150, 144, 132]),
            (river.half_width_m, [46, 58, 56]),
        ] {
            for k in 0..steps {
                let quad = [
                    at(k, -reach),
                    at(k + 1, -reach),
                    at(k + 1, reach),
                    at(k, reach),
                ];
                // A little longer than the step, so that no seam shows.
                let center = centroid(&quad);
                let quad = quad.map(|p| p + (p - center).normalize_or_zero() * 0.8);
                self.paint(&quad, rgb);
            }
        }
        for k in 0..steps {
            for side in [-1.0, 1.0] {
                if self.rng.uniform() < 0.5 {
                    self.plant(at(k, side * (river.half_width_m + 7.0)), 0.85);
                }
            }
        }
    }

    fn layout(&mut self) {
        let extent = self.params.extent_m;
        let reach = extent * 0.74;
        let angle = self.rng.range(0.12, 0.4);
        let (us, vs) = (
            Lines::new(&mut self.rng, reach),
            Lines::new(&mut self.rng, reach),
        );
        let shift = |noise: &Noise, p: DVec2| {
            DVec2::new(
                noise.at(p / 520.0),
                noise.at(p / 520.0 + DVec2::new(17.0, 41.0)),
            ) * 48.0
        };
        let zero = shift(&self.noise, DVec2::ZERO);
        let node = |noise: &Noise, i: usize, j: usize| {
            let p = DVec2::new(us.at_m[i], vs.at_m[j]);
            DVec2::from_angle(angle).rotate(p + shift(noise, p) - zero)
        };
        let (ni, nj) = (us.at_m.len(), vs.at_m.len());
        let nodes: Vec<DVec2> = (0..ni * nj)
            .map(|k| node(&self.noise, k % ni, k / ni))
            .collect();
        let at = |i: usize, j: usize| nodes[j * ni + i];

        // A diagonal avenue passes the station at some distance.
        let course =
            DVec2::from_angle(angle + 0.25 * std::f64::consts::PI + self.rng.range(-0.1, 0.1));
        let through = -course.perp() * 230.0;
        let avenue_half = 14.0;

        let park_center = DVec2::new(0.21, -0.1) * extent;
        let park_radius = extent * (self.params.park_share / std::f64::consts::PI).sqrt();
        let corners = |i: usize, j: usize| [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        let is_park = |i: isize, j: isize| {
            let inside = i >= 0 && j >= 0 && i + 1 < ni as isize && j + 1 < nj as isize;
            inside && centroid(&corners(i as usize, j as usize)).distance(park_center) < park_radius
        };

        for j in 0..nj {
            for i in 0..ni {
                if i + 1 < ni {
                    self.street([at(i, j), at(i + 1, j)], vs.width_m[j]);
                }
                if j + 1 < nj {
                    self.street([at(i, j), at(i, j + 1)], us.width_m[i]);
                }
            }
        }
        let half = extent / 2.0 - 4.0;
        for j in 0..nj - 1 {
            for i in 0..ni - 1 {
                let (si, sj) = (i as isize, j as isize);
                let park = is_park(si, sj);
                let beside = [(0, -1), (1, 0), (0, 1), (-1, 0)];
                let widths = [
                    vs.width_m[j],
                    us.width_m[i + 1],
                    vs.width_m[j + 1],
                    us.width_m[i],
                ];
                let mut kerb = inset(&corners(i, j), |k| {
                    let joined = park && is_park(si + beside[k].0, sj + beside[k].1);
                    if joined { 0.0 } else { widths[k] / 2.0 }
                });
                for normal in [DVec2::X, DVec2::Y, DVec2::NEG_X, DVec2::NEG_Y] {
                    kerb = clip(&kerb, -normal * half, normal);
                }
                let center = contains(&corners(i, j), DVec2::ZERO);
                let side = |p: &DVec2| (*p - through).dot(course.perp());
                if park || center || kerb.iter().all(|p| side(p).abs() > avenue_half) {
                    if !kerb.is_empty() {
                        self.block(&kerb, park, center);
                    }
                    continue;
                }
                for normal in [course.perp(), -course.perp()] {
                    let piece = clip(&kerb, through + normal * avenue_half, normal);
                    self.block(&piece, park, center);
                }
            }
        }
        let mut s = -extent * 0.7;
        while s < extent * 0.7 {
            for side in [-1.0, 1.0] {
                let p = through + course * s + course.perp() * side * (avenue_half - 2.0);
                if p.distance(park_center) > park_radius {
                    self.plant(p, 0.9);
                }
            }
            s += 13.0;
        }
        self.river_banks();
        for j in 0..nj {
            for i in 0..ni {
                if i + 1 < ni && vs.width_m[j] > AVENUE_M {
                    self.bridge([at(i, j), at(i + 1, j)], vs.width_m[j]);
                }
                if j + 1 < nj && us.width_m[i] > AVENUE_M {
                    self.bridge([at(i, j), at(i, j + 1)], us.width_m[i]);
                }
            }
        }
    }
}

/// Spacing of the raster that tells wood from field [m].
const STAND_CELL_M: f64 = 10.0;
/// Most trees in the woods.
const MAX_FOREST_TREES: f64 = 15_000.0;
/// Ground around the site point that no tree stands on [m].
const GLADE_M: f64 = 25.0;

/// The time of year in the country, drawn once.
#[derive(Clone, Copy)]
struct Season {
    /// Share of broadleaf trees that are bare, that are in autumn colours.
    bare: f64,
    autumn: f64,
    /// Linear RGB albedo of most fields, dimmed and tinted from field to field.
    fields: [[f32; 3]; 5],
}

const SUMMER: Season = Season {
    bare: 0.02,
    autumn: 0.0,
    fields: [
        [0.07, 0.12, 0.03],
        [0.1, 0.15, 0.04],
        [0.21, 0.18, 0.075],
        [0.05, 0.095, 0.025],
        [0.13, 0.14, 0.055],
    ],
};
const WINTER: Season = Season {
    bare: 0.9,
    autumn: 0.05,
    fields: [
        [0.075, 0.11, 0.03],
        [0.12, 0.095, 0.06],
        [0.09, 0.07, 0.045],
        [0.055, 0.095, 0.025],
        [0.17, 0.15, 0.085],
    ],
};
const AUTUMN: Season = Season {
    bare: 0.3,
    autumn: 0.45,
    fields: [
        [0.08, 0.1, 0.03],
        [0.14, 0.1, 0.06],
        [0.2, 0.16, 0.08],
        [0.06, 0.095, 0.025],
        [0.1, 0.075, 0.045],
    ],
};

/// 8-bit sRGB of a linear albedo.
fn srgb8(albedo: [f32; 3]) -> [u8; 3] {
    albedo.map(|c| (255.0 * c.clamp(0.0, 1.0).powf(1.0 / 2.2)) as u8)
}

impl Plan<'_> {
    /// Open country: fields cut by a road, woods where a smooth field of numbers is highest, a few
    /// farms. The ground about the site point stays open.
    fn countryside(&mut self) {
        let extent = self.params.extent_m;
        let half = extent / 2.0;
        let season = pick(&mut self.rng, &[SUMMER, WINTER, AUTUMN]);
        // Fields, in one direction as land is parcelled out.
        let axis = DVec2::from_angle(self.rng.range(0.0, 1.57));
        let square = rectangle(DVec2::ZERO, DVec2::X, DVec2::splat(half)).to_vec();
        let mut lots = Vec::new();
        let strips = self.rng.range(90.0, 220.0);
        let reach = half * 1.42;
        let mut from = -reach;
        while from < reach {
            let width = strips * self.rng.range(0.7, 1.3);
            let strip = clip(&square, axis * from, axis);
            let strip = clip(&strip, axis * (from + width), -axis);
            if strip.len() > 2 {
                split_lots(strip, strips * strips * 1.6, &mut self.rng, &mut lots);
            }
            from += width;
        }
        for lot in &lots {
            let tone = self.rng.range(0.75, 1.2);
            let albedo = shaded(pick(&mut self.rng, &season.fields), tone);
            self.paint(lot, srgb8(albedo));
            // Tramlines or swaths, wider than a pixel of the map.
            let along = main_axis(lot);
            let rows = self.rng.uniform() < 0.5;
            let [low, high] = span(lot, along.perp());
            let step = self.rng.range(6.0, 14.0);
            let mut at = low + step;
            while rows && at < high - step {
                let band = clip(lot, along.perp() * at, along.perp());
                let band = clip(&band, along.perp() * (at + 1.4), -along.perp());
                self.map
                    .paint(extent, &band, srgb8(shaded(albedo, 0.72)), 0.8);
                at += step;
            }
        }
        // A road that bends past the site point.
        let heading = DVec2::from_angle(self.rng.range(0.0, 6.3));
        let aside = self.rng.range(28.0, 70.0);
        let bend = self.rng.range(-40.0, 40.0);
        let phase = self.rng.range(0.0, 6.3);
        let road =
            |s: f64| heading * s + heading.perp() * (aside + bend * (s / 170.0 + phase).sin());
        let steps = (2.0 * reach / 20.0) as usize;
        let point = |k: usize| road(-reach + 20.0 * k as f64);
        let paved = self.rng.uniform() < 0.6;
        let rgb = if paved {
            [104, 104, 106]
        } else {
            [158, 142, 116]
        };
        for k in 0..steps {
            let (a, b) = (point(k), point(k + 1));
            self.map
                .stroke(extent, [a, b + (b - a) * 0.02], 5.5, rgb, 1.0);
        }
        let road_m = |p: DVec2| {
            let s = p.dot(heading);
            (p - road(s)).dot(heading.perp()).abs()
        };
        // Farms stand along it.
        let farms = (extent * extent * 1e-6 * (4.0 + 60.0 * self.params.building_density)) as usize;
        let mut yards: Vec<DVec2> = Vec::new();
        for _ in 0..farms {
            let s = self.rng.range(-half, half);
            let side = if self.rng.uniform() < 0.5 { 1.0 } else { -1.0 };
            let at = road(s) + heading.perp() * side * self.rng.range(18.0, 45.0);
            let clear = at.length() > 60.0 && yards.iter().all(|y| y.distance(at) > 26.0);
            if clear && at.abs().max_element() < half - 20.0 && !self.wet(at, 8.0) {
                self.farm(at, heading);
                yards.push(at);
            }
        }
        if self.river.is_some() {
            self.river_banks();
        }
        self.woods(season, |p| {
            road_m(p) < 7.0 || yards.iter().any(|y| y.distance(p) < 22.0)
        });
        // Lone trees and hedges between fields.
        for lot in &lots {
            for k in 0..lot.len() {
                if self.rng.uniform() > 0.12 {
                    continue;
                }
                let (a, b) = (lot[k], lot[(k + 1) % lot.len()]);
                let count = (a.distance(b) / self.rng.range(9.0, 30.0)) as usize;
                for i in 0..count {
                    let p = a.lerp(b, (i as f64 + self.rng.uniform()) / count as f64);
                    if p.length() > 1.5 * GLADE_M && road_m(p) > 7.0 {
                        let height_m = self.rng.range(4.0, 15.0);
                        self.plant_wild(p, [height_m, 0.0], season, false, false);
                    }
                }
            }
        }
    }

    /// Whether a place lies within `margin_m` [m] of the river.
    fn wet(&self, p: DVec2, margin_m: f64) -> bool {
        let river = self.river.as_ref();
        river.is_some_and(|r| r.offset_m(p).abs() < r.half_width_m + margin_m)
    }

    /// A house, often with a barn beside it.
    fn farm(&mut self, at: DVec2, axis: DVec2) {
        let house = DVec2::new(self.rng.range(5.5, 8.5), self.rng.range(4.0, 5.5));
        let barn = DVec2::new(self.rng.range(8.0, 14.0), self.rng.range(5.0, 7.0));
        let with_barn = self.rng.uniform() < 0.6;
        let barn_walls = [[0.27, 0.05, 0.035], [0.2, 0.13, 0.08], [0.35, 0.34, 0.32]];
        let wall = [
            pick(&mut self.rng, &WALLS),
            pick(&mut self.rng, &barn_walls),
        ];
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
            let looks = [wall[usize::from(is_barn)], pick(&mut self.rng, &TILES)];
            let outline = rectangle(center, axis, half).to_vec();
            self.build(
                kind,
                surface,
                looks,
                vec![(outline, 0.0, eaves, Roof::Gable(rise))],
                false,
            );
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
        let fit = |noise: &Noise, p: DVec2| {
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
        let floor = srgb8([0.05, 0.042, 0.022]);
        let px = self.map.pixel_m(extent);
        for row in 0..self.map.size_px {
            let y = half - (row as f64 + 0.5) * px;
            for column in 0..self.map.size_px {
                let e = (column as f64 + 0.5) * px - half;
                let alpha = smoothstep(-0.03, 0.03, field.bilinear_m(e, y) - edge) * 0.9;
                if alpha > 0.0 {
                    let pixel = &mut self.map.rgb[row * self.map.size_px + column];
                    for (old, new) in pixel.iter_mut().zip(floor) {
                        *old = (f64::from(*old) * (1.0 - alpha) + f64::from(new) * alpha) as u8;
                    }
                }
            }
        }
        let area_m2 = self.params.forest_share * extent * extent;
        let spacing = (area_m2 / MAX_FOREST_TREES).sqrt().max(6.0);
        let count = (extent / spacing) as usize;
        // A tree is inner when the field stays inside for the first rows around it.
        let rows = 2.5 * spacing;
        for k in 0..count * count {
            let jitter = DVec2::new(self.rng.range(-0.45, 0.45), self.rng.range(-0.45, 0.45));
            let at = DVec2::new((k % count) as f64, (k / count) as f64) + 0.5 + jitter;
            let p = at * spacing - half;
            let inside = |p: DVec2| field.bilinear_m(p.x, p.y) > edge;
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
            self.plant_wild(p, [height_m, 0.52 * spacing], season, conifer, inner);
        }
    }

    /// A tree of the woods and hedges; its crown has at least the given radius [m].
    fn plant_wild(
        &mut self,
        p: DVec2,
        [height_m, least_radius_m]: [f64; 2],
        season: Season,
        conifer: bool,
        inner: bool,
    ) {
        let dice = self.rng.uniform();
        let (slim, variant) = (self.rng.uniform(), self.rng.uniform() as f32);
        if self.wet(p, 3.0) || p.abs().max_element() > self.params.extent_m / 2.0 - 6.0 {
            return;
        }
        let kind = match dice {
            _ if conifer => TreeKind::Conifer,
            u if u < season.bare => TreeKind::Bare,
            u if u < season.bare + season.autumn => TreeKind::Autumn,
            _ => TreeKind::Broadleaf,
        };
        let width = match kind {
            TreeKind::Conifer => 0.13 + 0.07 * slim,
            _ => 0.2 + 0.13 * slim,
        };
        self.trees.push(Tree {
            kind,
            inner,
            base_enu_m: p.extend(self.ground_m(p)),
            height_m,
            crown_radius_m: (height_m * width).max(least_radius_m),
            variant,
        });
    }
}

/// Whether all points lie inside a simple outline (even-odd rule).
fn all_inside(outline: &[DVec2], points: &[DVec2]) -> bool {
    points.iter().all(|p| {
        let mut odd = false;
        for (k, &a) in outline.iter().enumerate() {
            let b = outline[(k + 1) % outline.len()];
            if (a.y > p.y) != (b.y > p.y) && p.x < a.x + (b.x - a.x) * (p.y - a.y) / (b.y - a.y) {
                odd = !odd;
            }
        }
        odd
    })
}

/// Raises the cells whose centre lies inside a simple outline.
fn raise(grid: &mut HeightGrid, outline: &[DVec2], height_m: impl Fn(DVec2) -> f64) {
    let clamp = |x: f64, n: usize| x.clamp(0.0, n as f64) as usize;
    let [n0, n1] = span(outline, DVec2::Y);
    let rows = clamp((n0 - grid.origin_n_m) / grid.cell_m, grid.ny)
        ..clamp((n1 - grid.origin_n_m) / grid.cell_m + 1.0, grid.ny);
    let mut crossings = Vec::new();
    for row in rows {
        let n = grid.origin_n_m + (row as f64 + 0.5) * grid.cell_m;
        crossings.clear();
        for (k, a) in outline.iter().enumerate() {
            let b = outline[(k + 1) % outline.len()];
            if (a.y > n) != (b.y > n) {
                crossings.push(a.x + (b.x - a.x) * (n - a.y) / (b.y - a.y));
            }
        }
        crossings.sort_by(f64::total_cmp);
        for pair in crossings.chunks_exact(2) {
            let column = |e: f64| clamp((e - grid.origin_e_m) / grid.cell_m + 0.5, grid.nx);
            for i in column(pair[0])..column(pair[1]) {
                let e = grid.origin_e_m + (i as f64 + 0.5) * grid.cell_m;
                let cell = &mut grid.heights_m[row * grid.nx + i];
                *cell = cell.max(height_m(DVec2::new(e, n)) as f32);
            }
        }
    }
}

impl City {
    /// Generates the city of some parameters; the same parameters give the same city.
    pub fn generate(params: &CityParams) -> Result<City, CityError> {
        let within = |field, value: f64, low, high| {
            if (low..=high).contains(&value) {
                Ok(())
            } else {
                Err(CityError::OutOfRange {
                    field,
                    value,
                    low,
                    high,
                })
            }
        };
        within("extent_m", params.extent_m, 800.0, 6000.0)?;
        within("building_density", params.building_density, 0.0, 1.0)?;
        within("max_height_m", params.max_height_m, 20.0, 400.0)?;
        within("relief_m", params.relief_m, 0.0, 60.0)?;
        within("park_share", params.park_share, 0.0, 0.3)?;
        within("station_height_m", params.station_height_m, 30.0, 120.0)?;
        within("forest_share", params.forest_share, 0.0, 1.0)?;

        let extent = params.extent_m;
        let mut rng = Stream::new(params.seed, 0, "city-layout");
        let river = params.river.then(|| River {
            center_n_m: 0.2 * extent,
            swing_m: 0.03 * extent,
            phase: rng.range(0.0, std::f64::consts::TAU),
            half_width_m: rng.range(30.0, 38.0),
        });
        let mut plan = Plan {
            params,
            rng,
            noise: Noise::new(params.seed),
            river,
            map: GroundMap {
                size_px: MAP_PX,
                rgb: vec![[92, 92, 94]; MAP_PX * MAP_PX],
            },
            buildings: Vec::new(),
            trees: Vec::new(),
        };
        if params.forest_share > 0.0 {
            plan.countryside();
        } else {
            plan.layout();
            thin(&mut plan.trees, params.max_trees as usize);
        }

        let half = extent / 2.0;
        let corner = DVec2::splat(-half);
        let cells = |cell: f64| [(extent / cell).ceil() as usize; 2];
        let terrain = HeightGrid::from_fn(corner, 8.0, cells(8.0), |e, n| {
            plan.ground_m(DVec2::new(e, n))
        });
        let cell = if extent > 3000.0 { 2.0 } else { 1.0 };
        let mut surface =
            HeightGrid::from_fn(corner, cell, cells(cell), |e, n| terrain.bilinear_m(e, n));
        for part in plan.buildings.iter().flat_map(|b| &b.parts) {
            raise(&mut surface, &part.outline_enu_m, |p| part.roof_m(p));
        }
        for tree in &plan.trees {
            let at = tree.base_enu_m.truncate();
            let crown = rectangle(at, DVec2::X, DVec2::splat(tree.crown_radius_m));
            raise(&mut surface, &crown, |p| {
                let r = p.distance(at) / tree.crown_radius_m;
                let z = tree.base_enu_m.z + tree.height_m * (1.0 - 0.3 * r * r);
                if r < 1.0 { z } else { f64::NEG_INFINITY }
            });
        }
        finish_map(
            &mut plan.map,
            extent,
            &terrain,
            &surface,
            &plan.noise,
            &mut plan.rng,
        );
        let Plan {
            map,
            buildings,
            trees,
            river,
            ..
        } = plan;
        Ok(City {
            dsm: Dsm::new(terrain, surface, 0.0),
            buildings,
            trees,
            unshaded: map.clone(),
            ground_map: map,
            params: params.clone(),
            river,
        })
    }

    /// Where the station's sensors stand: above the roof of the tower at the site point [m, ENU].
    pub fn station_enu_m(&self) -> DVec3 {
        DVec3::Z * (self.dsm.surface_m(0.0, 0.0) + STATION_MAST_M)
    }

    /// Bakes the sun's shadows into [`City::ground_map`], replacing those baked before.
    ///
    /// `sun_dir_enu` points to the sun. The surface is swept along lines away from it, carrying the
    /// height of the shadow; the map takes the mean of 2 × 2 samples per pixel. A full shadow keeps
    /// the skylight's share of the light.
    pub fn bake_shadows(&mut self, sun_dir_enu: DVec3) {
        // Skylight's share (assumed) of the global irradiance on open ground under a clear sky, bluish.
        const SKY: [f64; 3] = [0.27, 0.30, 0.35];
        let gain = |lit: f64| SKY.map(|s| (s + (1.0 - s) * lit).powf(1.0 / 2.2));
        self.ground_map = self.unshaded.clone();
        let away = -sun_dir_enu.truncate().normalize_or(DVec2::X);
        let flat = sun_dir_enu.truncate().length();
        if sun_dir_enu.z <= 0.02 * flat || !sun_dir_enu.is_finite() {
            let dark = gain(0.0);
            for pixel in &mut self.ground_map.rgb {
                *pixel = std::array::from_fn(|c| (f64::from(pixel[c]) * dark[c]) as u8);
            }
            return;
        }
        let half = self.params.extent_m / 2.0;
        let px = self.ground_map.pixel_m(self.params.extent_m);
        let step = px / 2.0;
        let n = (2.0 * half * std::f64::consts::SQRT_2 / step) as usize + 2;
        let reach = n as f64 * step / 2.0;
        let drop = step * sun_dir_enu.z / flat.max(1e-6);
        let mut lit = vec![true; n * n];
        for line in 0..n {
            let start = away.perp() * (line as f64 * step - reach) - away * reach;
            let mut shadow_m = f64::NEG_INFINITY;
            let mut ground_m = 0.0;
            for k in 0..n {
                let p = start + away * (k as f64 * step);
                if let Some(cell) = self.dsm.surface().cell_index(p.x, p.y) {
                    if k % 8 == 0 {
                        ground_m = self.dsm.terrain_m(p.x, p.y);
                    }
                    shadow_m -= drop;
                    lit[line * n + k] = shadow_m < ground_m + 0.4;
                    shadow_m = shadow_m.max(f64::from(self.dsm.surface().heights_m[cell]));
                }
            }
        }
        let gains = [0, 1, 2, 3, 4].map(|q| gain(f64::from(q) / 4.0));
        let size = self.ground_map.size_px;
        for row in 0..size {
            for column in 0..size {
                let mut sum = 0;
                for (dx, dy) in [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)] {
                    let p = DVec2::new(
                        (column as f64 + dx) * px - half,
                        half - (row as f64 + dy) * px,
                    );
                    let line = ((p.dot(away.perp()) + reach) / step + 0.5) as usize;
                    let k = ((p.dot(away) + reach) / step + 0.5) as usize;
                    sum += usize::from(lit[line.min(n - 1) * n + k.min(n - 1)]);
                }
                let pixel = &mut self.ground_map.rgb[row * size + column];
                *pixel = std::array::from_fn(|c| (f64::from(pixel[c]) * gains[sum][c]) as u8);
            }
        }
    }

    /// The city's meshes: one per tile for the terrain and one for what stands on it, the river,
    /// and the land around; each about its own origin, so that a renderer can cull them.
    pub fn chunks(&self) -> Vec<MeshData> {
        let extent = self.params.extent_m;
        let tiles = (extent / TILE_M).ceil() as usize;
        let tile_m = extent / tiles as f64;
        let middle = |k: usize| (k as f64 + 0.5) * tile_m - extent / 2.0;
        let mut built: Vec<MeshData> = (0..tiles * tiles)
            .map(|k| MeshData::new(DVec3::new(middle(k % tiles), middle(k / tiles), 0.0)))
            .collect();
        let tile_of = |p: DVec2| {
            let index = |x: f64| (((x + extent / 2.0) / tile_m) as usize).min(tiles - 1);
            index(p.y) * tiles + index(p.x)
        };
        for building in &self.buildings {
            let mesh = &mut built[tile_of(centroid(building.footprint_enu_m()))];
            for part in &building.parts {
                add_part(mesh, part, building);
            }
        }
        for tree in &self.trees {
            let mesh = &mut built[tile_of(tree.base_enu_m.truncate())];
            add_tree(mesh, tree, self.params.forest_share > 0.0);
        }
        let mut chunks: Vec<MeshData> = (0..tiles * tiles)
            .map(|k| self.terrain_tile(middle(k % tiles), middle(k / tiles), tile_m))
            .collect();
        chunks.extend(built);
        chunks.extend(self.river_meshes());
        chunks.extend(self.apron());
        chunks.retain(|c| !c.indices.is_empty());
        chunks
    }

    fn terrain_tile(&self, e: f64, n: f64, tile_m: f64) -> MeshData {
        let extent = self.params.extent_m;
        let mut mesh = MeshData::new(DVec3::new(e, n, 0.0));
        let paint = Paint {
            albedo: [1.0; 3],
            surface: Surface::Ground,
            variant: 0.0,
        };
        let cells = (tile_m / TERRAIN_STEP_M).ceil() as u32;
        let step = tile_m / f64::from(cells);
        for j in 0..=cells {
            for i in 0..=cells {
                let p =
                    DVec2::new(e, n) + DVec2::new(f64::from(i), f64::from(j)) * step - tile_m / 2.0;
                let z = |p: DVec2| self.dsm.terrain_m(p.x, p.y);
                let (dx, dy) = (DVec2::X * 8.0, DVec2::Y * 8.0);
                let normal =
                    DVec3::new(z(p - dx) - z(p + dx), z(p - dy) - z(p + dy), 16.0).normalize();
                let uv = [p.x / extent + 0.5, 0.5 - p.y / extent].map(|x| x as f32);
                mesh.vertex(p.extend(z(p)), normal, uv, 1.0, paint);
                if i < cells && j < cells {
                    let a = j * (cells + 1) + i;
                    let b = a + cells + 1;
                    mesh.indices.extend([a, a + 1, b + 1, a, b + 1, b]);
                }
            }
        }
        mesh
    }

    /// The water and its walls, out to the end of the land.
    fn river_meshes(&self) -> Vec<MeshData> {
        let Some(river) = &self.river else {
            return Vec::new();
        };
        let water = Paint {
            albedo: [0.02, 0.03, 0.03],
            surface: Surface::Water,
            variant: 0.0,
        };
        let stone = Paint::plain([0.36, 0.34, 0.3]);
        let step = 50.0;
        let pieces = 8;
        let count = (2.0 * APRON_M / step) as usize / pieces;
        (0..count)
            .map(|k| {
                let from = -APRON_M + (k * pieces) as f64 * step;
                let center = from + pieces as f64 * step / 2.0;
                let mut mesh = MeshData::new(DVec3::new(center, river.north_m(center), 0.0));
                for s in 0..pieces {
                    let at = |e: f64, off: f64, z: f64| {
                        (DVec2::new(e, river.north_m(e)) + river.normal(e) * off).extend(z)
                    };
                    let (e0, e1) = (from + s as f64 * step, from + (s + 1) as f64 * step);
                    let w = river.half_width_m;
                    mesh.face(
                        &[
                            at(e0, -w, WATER_M),
                            at(e1, -w, WATER_M),
                            at(e1, w, WATER_M),
                            at(e0, w, WATER_M),
                        ],
                        water,
                    );
                    // Far from the city the walls are too thin to see.
                    if e0.abs() > self.params.extent_m {
                        continue;
                    }
                    let top = 1.1;
                    for (near, far) in [(w, w + 0.8), (-w - 0.8, -w)] {
                        mesh.face(
                            &[
                                at(e0, near, top),
                                at(e1, near, top),
                                at(e1, far, top),
                                at(e0, far, top),
                            ],
                            stone,
                        );
                        mesh.face(
                            &[
                                at(e0, near, 0.0),
                                at(e1, near, 0.0),
                                at(e1, near, top),
                                at(e0, near, top),
                            ],
                            stone,
                        );
                        mesh.face(
                            &[
                                at(e1, far, 0.0),
                                at(e0, far, 0.0),
                                at(e0, far, top),
                                at(e1, far, top),
                            ],
                            stone,
                        );
                    }
                }
                mesh
            })
            .collect()
    }

    /// Fields, woods and scattered houses around the city, hills on the horizon.
    fn apron(&self) -> Vec<MeshData> {
        const FIELDS: [[f32; 3]; 6] = [
            [0.085, 0.125, 0.035],
            [0.12, 0.14, 0.05],
            [0.19, 0.165, 0.075],
            [0.07, 0.105, 0.03],
            [0.14, 0.11, 0.07],
            [0.035, 0.062, 0.022],
        ];
        let mut rng = Stream::new(self.params.seed, 0, "city-apron");
        let noise = Noise::new(self.params.seed);
        let half = self.params.extent_m / 2.0;
        let river_offset = |p: DVec2| {
            self.river
                .as_ref()
                .map_or(f64::INFINITY, |r| r.offset_m(p).abs())
        };
        let hill = |p: DVec2| {
            let far =
                smoothstep(4200.0, 7600.0, p.length()) * smoothstep(300.0, 1800.0, river_offset(p));
            far * (70.0 + 55.0 * noise.at(p / 1300.0))
        };
        let mut chunks: Vec<MeshData> = (0..8).map(|_| MeshData::new(DVec3::ZERO)).collect();
        let mut ring_half = half;
        while ring_half < APRON_M {
            // Squares of cells around the previous ring, coarser outwards.
            let cells = 24;
            let outer = ring_half * 2.0;
            let cell = 2.0 * outer / f64::from(cells);
            for k in 0..cells * cells {
                let low = DVec2::new(f64::from(k % cells), f64::from(k / cells)) * cell - outer;
                let center = low + cell / 2.0;
                if center.abs().max_element() < ring_half {
                    continue;
                }
                let sector = ((center.to_angle() / std::f64::consts::TAU + 1.0) * 8.0) as usize % 8;
                let corner = |x: f64, y: f64| {
                    let p = low + DVec2::new(x, y) * cell;
                    p.extend(hill(p))
                };
                let albedo = shaded(pick(&mut rng, &FIELDS), rng.range(0.85, 1.15));
                let quad = [
                    corner(0.0, 0.0),
                    corner(1.0, 0.0),
                    corner(1.0, 1.0),
                    corner(0.0, 1.0),
                ];
                chunks[sector].face(&[quad[0], quad[1], quad[2]], Paint::plain(albedo));
                chunks[sector].face(&[quad[0], quad[2], quad[3]], Paint::plain(albedo));
                // The grids of two rings differ along their seam: skirts hide it.
                if center.abs().max_element() > outer - cell {
                    for s in 0..4 {
                        let (a, b) = (quad[s], quad[(s + 1) % 4]);
                        let down = DVec3::Z * 12.0;
                        chunks[sector].face(&[a - down, b - down, b, a], Paint::plain(albedo));
                    }
                }
                if ring_half > half {
                    continue;
                }
                if self.params.forest_share > 0.0 {
                    let wooded = noise.at(center / 380.0 + DVec2::new(3.1, 8.7))
                        > 0.5 - self.params.forest_share;
                    if wooded && river_offset(center) > 70.0 + cell {
                        add_canopy(&mut chunks[sector], low, cell, &mut rng);
                    }
                    continue;
                }
                let settled = noise.at(center / 420.0 + DVec2::splat(7.0)) > -0.1;
                for _ in 0..if settled { 4 } else { 3 } {
                    let at = low + DVec2::new(rng.uniform(), rng.uniform()) * cell;
                    if river_offset(at) < 70.0 {
                        continue;
                    }
                    let axis = DVec2::from_angle(rng.range(0.0, 6.3));
                    if settled && rng.uniform() < 0.6 {
                        let part = Part {
                            outline_enu_m: rectangle(
                                at,
                                axis,
                                DVec2::new(rng.range(6.0, 11.0), 5.0),
                            )
                            .to_vec(),
                            bottom_m: 0.0,
                            eaves_m: rng.range(3.5, 8.0),
                            roof: Roof::Gable(3.6),
                            surface: Surface::FacadeResidential,
                            albedo: pick(&mut rng, &WALLS),
                            roof_albedo: pick(&mut rng, &TILES),
                            blind_ends: true,
                        };
                        let house = Building {
                            kind: BuildingKind::House,
                            base_m: 0.0,
                            variant: rng.uniform() as f32,
                            parts: Vec::new(),
                        };
                        add_part(&mut chunks[sector], &part, &house);
                    } else {
                        let tree = Tree {
                            kind: TreeKind::Broadleaf,
                            inner: false,
                            base_enu_m: at.extend(0.0),
                            height_m: rng.range(8.0, 15.0),
                            crown_radius_m: rng.range(2.8, 4.6),
                            variant: rng.uniform() as f32,
                        };
                        add_tree(&mut chunks[sector], &tree, false);
                    }
                }
            }
            ring_half = outer;
        }
        chunks
    }
}

/// Keeps `most` trees, evenly spread over the order they were planted in.
fn thin(trees: &mut Vec<Tree>, most: usize) {
    let count = trees.len();
    if count > most {
        let mut k = 0;
        trees.retain(|_| {
            k += 1;
            k * most / count != (k - 1) * most / count
        });
    }
}

/// Mottles the map, and darkens it where buildings close off the sky.
fn finish_map(
    map: &mut GroundMap,
    extent_m: f64,
    terrain: &HeightGrid,
    surface: &HeightGrid,
    noise: &Noise,
    rng: &mut Stream,
) {
    // Mean height of what stands around, in coarse cells, by two box blurs.
    let coarse = 6.0;
    let n = (extent_m / coarse).ceil() as usize;
    let mut mean = vec![0.0f32; n * n];
    let mut count = vec![0.0f32; n * n];
    for (k, &h) in surface.heights_m.iter().enumerate() {
        let e = (k % surface.nx) as f64 * surface.cell_m;
        let y = (k / surface.nx) as f64 * surface.cell_m;
        let cell = ((y / coarse) as usize).min(n - 1) * n + ((e / coarse) as usize).min(n - 1);
        mean[cell] += h;
        count[cell] += 1.0;
    }
    for (k, m) in mean.iter_mut().enumerate() {
        let at = |i: usize| (i as f64 + 0.5) * coarse - extent_m / 2.0;
        *m = *m / count[k].max(1.0) - terrain.bilinear_m(at(k % n), at(k / n)) as f32;
    }
    for stride in [1, n] {
        for _ in 0..2 {
            let old = mean.clone();
            for (k, m) in mean.iter_mut().enumerate() {
                let along = k / stride % n;
                let (low, high) = (along.saturating_sub(2), (along + 2).min(n - 1));
                let sum: f32 = (low..=high)
                    .map(|i| old[k - along * stride + i * stride])
                    .sum();
                *m = sum / (high - low + 1) as f32;
            }
        }
    }
    let openness = HeightGrid {
        origin_e_m: -extent_m / 2.0,
        origin_n_m: -extent_m / 2.0,
        cell_m: coarse,
        nx: n,
        ny: n,
        heights_m: mean
            .iter()
            .map(|m| 1.0 / (1.0 + m.max(0.0) / 26.0))
            .collect(),
    };
    let px = map.pixel_m(extent_m);
    for row in 0..map.size_px {
        let y = extent_m / 2.0 - (row as f64 + 0.5) * px;
        for column in 0..map.size_px {
            let p = DVec2::new((column as f64 + 0.5) * px - extent_m / 2.0, y);
            let grain =
                1.0 + 0.05 * noise.at(p / 19.0) + 0.05 * noise.at(p / 4.3) + rng.range(-0.04, 0.04);
            let factor = openness.bilinear_m(p.x, p.y).powf(0.7) * grain;
            for c in &mut map.rgb[row * map.size_px + column] {
                *c = (f64::from(*c) * factor).clamp(0.0, 255.0) as u8;
            }
        }
    }
}

/// Walls, parapet and roof of a part.
fn add_part(mesh: &mut MeshData, part: &Part, building: &Building) {
    let o = &part.outline_enu_m;
    let n = o.len();
    let wall = Paint {
        albedo: part.albedo,
        surface: part.surface,
        variant: building.variant,
    };
    let plain = Paint::plain(part.albedo);
    let cover = Paint {
        variant: building.variant,
        ..Paint::plain(part.roof_albedo)
    };
    let foot_ao = if part.bottom_m > building.base_m + 1.0 {
        0.9
    } else {
        0.6
    };
    let v = |z: f64| (z - building.base_m) as f32;
    for k in 0..n {
        let (a, b) = (o[k], o[(k + 1) % n]);
        let length = a.distance(b);
        let bays = (length / BAY_M).round();
        let blind = bays < 1.0 || (part.blind_ends && k % 2 == 1);
        let (u, paint) = if blind {
            (length, plain)
        } else {
            (bays * BAY_M, wall)
        };
        let (low, high) = (part.bottom_m, part.eaves_m);
        let corners = [a.extend(low), b.extend(low), b.extend(high), a.extend(high)];
        let u = u as f32;
        let uv = [[0.0, v(low)], [u, v(low)], [u, v(high)], [0.0, v(high)]];
        mesh.face_with(&corners, &uv, &[foot_ao, foot_ao, 1.0, 1.0], paint);
    }
    let ridge = |t: f64, rise: f64| {
        let middle = |a: DVec2, b: DVec2| a.lerp(b, 0.5);
        middle(o[3], o[0])
            .lerp(middle(o[1], o[2]), t)
            .extend(part.eaves_m + rise)
    };
    let up = |k: usize| o[k].extend(part.eaves_m);
    match part.roof {
        Roof::Flat(parapet) => {
            mesh.floor(
                o,
                part.eaves_m,
                if parapet > 0.0 { 0.93 } else { 1.0 },
                cover,
            );
            if parapet > 0.0 {
                let top = part.eaves_m + parapet;
                for k in 0..n {
                    let (a, b) = (o[k], o[(k + 1) % n]);
                    let (low, high) = (
                        [a.extend(part.eaves_m), b.extend(part.eaves_m)],
                        [a.extend(top), b.extend(top)],
                    );
                    mesh.face(&[low[0], low[1], high[1], high[0]], plain);
                    mesh.face(&[low[1], low[0], high[0], high[1]], plain);
                }
            }
        }
        Roof::Gable(rise) if n == 4 => {
            let (r0, r1) = (ridge(0.0, rise), ridge(1.0, rise));
            mesh.face(&[up(0), up(1), r1, r0], cover);
            mesh.face(&[up(2), up(3), r0, r1], cover);
            mesh.face(&[up(1), up(2), r1], plain);
            mesh.face(&[up(3), up(0), r0], plain);
        }
        Roof::Hip(rise) if n == 4 => {
            let inset = (0.5 * o[1].distance(o[2]) / o[0].distance(o[1]).max(1e-9)).min(0.49);
            let (r0, r1) = (ridge(inset, rise), ridge(1.0 - inset, rise));
            mesh.face(&[up(0), up(1), r1, r0], cover);
            mesh.face(&[up(2), up(3), r0, r1], cover);
            mesh.face(&[up(1), up(2), r1], cover);
            mesh.face(&[up(3), up(0), r0], cover);
        }
        Roof::Gable(_) | Roof::Hip(_) => mesh.floor(o, part.eaves_m, 1.0, cover),
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
        ..Paint::plain(shaded(pick(rng, &hues), tone))
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

/// Leaves' linear RGB albedo.
fn leaf_albedo(tree: &Tree) -> [f32; 3] {
    let tint = tree.variant;
    match tree.kind {
        TreeKind::Broadleaf => [
            0.045 + 0.05 * tint,
            0.085 + 0.045 * tint,
            0.025 + 0.012 * tint,
        ],
        TreeKind::Autumn => [0.11 + 0.12 * tint, 0.075 + 0.03 * tint, 0.02],
        TreeKind::Conifer => [
            0.02 + 0.02 * tint,
            0.038 + 0.028 * tint,
            0.018 + 0.01 * tint,
        ],
        TreeKind::Bare => [
            0.07 + 0.035 * tint,
            0.055 + 0.025 * tint,
            0.042 + 0.02 * tint,
        ],
    }
}

/// A tree: a trunk and a crown, or twigs, of some 10 to 90 triangles. A `leafy` crown carries metres
/// around and up it, from which the shader draws clumps of leaves.
fn add_tree(mesh: &mut MeshData, tree: &Tree, leafy: bool) {
    match tree.kind {
        TreeKind::Broadleaf | TreeKind::Autumn => add_broadleaf(mesh, tree, leafy),
        TreeKind::Conifer => add_conifer(mesh, tree, leafy),
        TreeKind::Bare => add_bare(mesh, tree),
    }
}

/// Bark of a trunk.
const BARK: [f32; 3] = [0.09, 0.065, 0.045];

/// Rings of a crown (height over the tree's, radius over the crown's), lumpy by the tree's own
/// number: no two crowns are alike. Ambient light fades toward its foot.
fn add_crown(mesh: &mut MeshData, tree: &Tree, leafy: bool, sides: usize, profile: &[(f64, f64)]) {
    let t = f64::from(tree.variant);
    let (foot, h, r) = (tree.base_enu_m, tree.height_m, tree.crown_radius_m);
    let leaves = Paint {
        albedo: leaf_albedo(tree),
        surface: Surface::Foliage,
        variant: tree.variant,
    };
    let first = mesh.positions.len();
    let rings: Vec<Vec<DVec3>> = profile
        .iter()
        .enumerate()
        .map(|(level, &(z, radius))| {
            (0..sides)
                .map(|k| {
                    let lump = (t * 57.0 + (k * (level + 3)) as f64 * 2.4).sin();
                    let angle = std::f64::consts::TAU * (k as f64 / sides as f64 + t);
                    let ring = DVec2::from_angle(angle) * r * radius * (1.0 + 0.16 * lump);
                    let sag = if radius > 0.0 { 0.03 * lump } else { 0.0 };
                    foot + ring.extend(h * (z + sag))
                })
                .collect()
        })
        .collect();
    mesh.loft(&rings, leaves);
    let foot_z = (foot.z - mesh.origin_enu_m.z) as f32;
    for (p, c) in mesh.positions[first..]
        .iter()
        .zip(&mut mesh.colors[first..])
    {
        c[3] = 0.35 + 0.65 * ((p[2] - foot_z) / h as f32).clamp(0.0, 1.0);
    }
    if !leafy {
        return;
    }
    // Around the crown there and back again, since a seam would show; no two trees alike.
    let turn_back = sides.div_ceil(2);
    let around = |k: usize| match k {
        k if k <= turn_back => k as f64,
        k => (turn_back * (sides - k)) as f64 / (sides - turn_back) as f64,
    };
    let side_m = std::f64::consts::TAU * r / sides as f64;
    for (i, uv) in mesh.uv[first..].iter_mut().enumerate() {
        let up_m = f64::from(mesh.positions[first + i][2] - foot_z).max(0.0);
        *uv = [around(i % sides) * side_m + 37.0 * t, up_m + 91.0 * t + 1.0].map(|x| x as f32);
    }
}

/// A trunk and a lumpy crown: 32 triangles.
fn add_broadleaf(mesh: &mut MeshData, tree: &Tree, leafy: bool) {
    let (foot, h) = (tree.base_enu_m, tree.height_m);
    if tree.inner {
        return add_crown(mesh, tree, leafy, 5, &[(0.4, 0.8), (0.75, 0.9), (1.0, 0.0)]);
    }
    mesh.frustum(
        (foot - DVec3::Z * 0.3, 0.035 * h),
        (foot + DVec3::Z * 0.38 * h, 0.02 * h),
        3,
        Paint::plain(BARK),
    );
    add_crown(
        mesh,
        tree,
        leafy,
        6,
        &[(0.24, 0.0), (0.45, 0.95), (0.78, 0.8), (1.0, 0.0)],
    );
}

/// Two or three tiers of drooping branches about a trunk.
fn add_conifer(mesh: &mut MeshData, tree: &Tree, leafy: bool) {
    let (foot, h) = (tree.base_enu_m, tree.height_m);
    if tree.inner {
        return add_crown(
            mesh,
            tree,
            leafy,
            5,
            &[(0.3, 0.95), (0.66, 0.5), (1.0, 0.0)],
        );
    }
    mesh.frustum(
        (foot - DVec3::Z * 0.3, 0.016 * h),
        (foot + DVec3::Z * 0.2 * h, 0.013 * h),
        3,
        Paint::plain(BARK),
    );
    add_crown(
        mesh,
        tree,
        leafy,
        7,
        &[(0.08, 0.8), (0.13, 1.0), (0.5, 0.42)],
    );
    add_crown(mesh, tree, leafy, 6, &[(0.42, 0.74), (0.75, 0.24)]);
    add_crown(mesh, tree, leafy, 5, &[(0.68, 0.44), (1.0, 0.0)]);
}

/// A trunk, its branches and twigs as blades that are seen from both sides.
fn add_bare(mesh: &mut MeshData, tree: &Tree) {
    let t = f64::from(tree.variant);
    let (foot, h, r) = (tree.base_enu_m, tree.height_m, tree.crown_radius_m);
    let wood = Paint::plain(leaf_albedo(tree));
    let up = DVec3::Z;
    mesh.frustum(
        (foot - up * 0.3, 0.017 * h),
        (foot + up * 0.8 * h, 0.005 * h),
        3,
        wood,
    );
    let mut blade = |from: DVec3, to: DVec3, width_m: f64, side: DVec3| {
        let across = (to - from).cross(side).normalize_or(side) * width_m / 2.0;
        mesh.face(&[from - across, from + across, to], wood);
        mesh.face(&[from + across, from - across, to], wood);
    };
    const GOLDEN_RAD: f64 = 2.399_963; // [rad]
    let branches = if tree.inner { 5 } else { 11 };
    for k in 0..branches {
        let share = (k as f64 + 0.5) / branches as f64;
        let out = DVec2::from_angle(GOLDEN_RAD * k as f64 + 6.3 * t).extend(0.0);
        let from = foot + up * h * (0.28 + 0.45 * share);
        // The crown's outline is an egg: widest at half height.
        let reach = r * (1.0 - (share - 0.35).powi(2) * 1.4);
        let rise = h * (0.16 + 0.12 * share + 0.05 * (t * 40.0 + k as f64).sin());
        let to = from + out * reach + up * rise;
        let side = out.cross(up);
        blade(from, to, 0.012 * h, side);
        for (along, turn) in [(0.45, 0.8), (0.7, -0.8)] {
            let twig = DQuat::from_rotation_z(turn) * out * 0.45 * reach + up * 0.13 * h;
            let knot = from.lerp(to, along);
            blade(knot, knot + twig, 0.008 * h, up);
        }
    }
}

#[cfg(test)]
mod tests;
