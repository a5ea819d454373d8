//! What stands in a city: buildings made of extruded parts, and trees; their measures and colours.

use glam::{DVec2, DVec3};

use crate::shape::mesh::Surface;

/// Residential storey height [m]; facade windows repeat with it.
pub(super) const STOREY_M: f64 = 3.0;
/// Office storey height [m].
pub(super) const OFFICE_STOREY_M: f64 = 3.6;
/// Width of a window bay [m]; walls hold a whole number of them.
pub(super) const BAY_M: f64 = 3.0;

/// Linear RGB albedos of roof tiles.
pub(super) const TILES: [[f32; 3]; 5] = [
    [0.28, 0.085, 0.045],
    [0.22, 0.075, 0.045],
    [0.33, 0.13, 0.07],
    [0.14, 0.07, 0.05],
    [0.09, 0.09, 0.1],
];
/// Linear RGB albedos of flat roofs.
pub(super) const FLATS: [[f32; 3]; 5] = [
    [0.22, 0.21, 0.2],
    [0.12, 0.12, 0.125],
    [0.3, 0.29, 0.27],
    [0.17, 0.165, 0.15],
    [0.4, 0.4, 0.4],
];
/// Linear RGB albedos of the walls of houses and flats.
pub(super) const WALLS: [[f32; 3]; 9] = [
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
/// Linear RGB albedos of the walls of offices and towers.
pub(super) const OFFICES: [[f32; 3]; 6] = [
    [0.1, 0.14, 0.17],  // blue glass
    [0.16, 0.19, 0.19], // green glass
    [0.42, 0.42, 0.4],  // concrete
    [0.55, 0.53, 0.48], // light stone
    [0.2, 0.17, 0.14],  // bronze
    [0.34, 0.26, 0.2],  // brown stone
];

/// An albedo made darker or lighter, below that of snow.
pub(super) fn shaded(albedo: [f32; 3], factor: f64) -> [f32; 3] {
    albedo.map(|c| (c * factor as f32).min(0.9))
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
    /// One of a real city, of which only outline, base and top are known.
    Surveyed,
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

/// What walls and roof of a part look like.
#[derive(Clone, Copy, Debug)]
pub struct Finish {
    /// What the walls are.
    pub surface: Surface,
    /// Linear RGB albedo of the walls.
    pub albedo: [f32; 3],
    /// Linear RGB albedo of the roof.
    pub roof_albedo: [f32; 3],
    /// Whether edges 1 and 3 are party walls without windows.
    pub blind_ends: bool,
}

impl Finish {
    /// Windows of a kind in walls of one albedo, below a roof of another.
    pub(super) fn facade(surface: Surface, albedo: [f32; 3], roof_albedo: [f32; 3]) -> Self {
        Self {
            surface,
            albedo,
            roof_albedo,
            blind_ends: false,
        }
    }

    /// Walls without windows.
    pub(super) fn plain(albedo: [f32; 3], roof_albedo: [f32; 3]) -> Self {
        Self::facade(Surface::Plain, albedo, roof_albedo)
    }
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
    /// What walls and roof look like.
    pub finish: Finish,
}

impl Part {
    /// Highest point [m], the parapet included.
    pub fn top_m(&self) -> f64 {
        let (Roof::Flat(rise) | Roof::Gable(rise) | Roof::Hip(rise)) = self.roof;
        self.eaves_m + rise
    }

    /// Height of the roof over a point of the outline [m]; parapets are left out.
    pub(super) fn roof_m(&self, p: DVec2) -> f64 {
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
