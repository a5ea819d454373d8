//! Implicit tiling: where a tile of a quadtree or octree lies, and which of them there are
//! (OGC 22-025r4, section 7.2, "Implicit tiling").

use crate::tiles::volume::{BoundingVolume, width_rad};
use glam::{DMat3, DVec3};

/// Into how many a tile is divided.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scheme {
    /// Into four: west and east, south and north.
    Quadtree,
    /// Into eight: below and above as well.
    Octree,
}

impl Scheme {
    /// Dimensions that are halved.
    pub fn dimensions(self) -> u32 {
        match self {
            Self::Quadtree => 2,
            Self::Octree => 3,
        }
    }

    /// Tiles of a whole level, the root's being 0; `None`: more than 2⁶³.
    pub fn level_tiles(self, level: u32) -> Option<u64> {
        let bits = self.dimensions().checked_mul(level)?;
        (bits < 64).then(|| 1 << bits)
    }

    /// Tiles of a tree of so many whole levels; `None`: more than 2⁶³.
    pub fn tree_tiles(self, levels: u32) -> Option<u64> {
        Some((self.level_tiles(levels)? - 1) / (self.level_tiles(1)? - 1))
    }
}

/// Where a tile stands in a tiling: its level and its place in it, counted from west, south and below.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Coordinates {
    /// 0 for the root.
    pub level: u32,
    /// Below 2^level each; the third is 0 in a quadtree.
    pub xyz: [u64; 3],
}

impl Coordinates {
    /// One of its children, by its place in Morton order.
    pub fn child(self, child: u64) -> Self {
        let bit = |i: usize| 2 * self.xyz[i] + (child >> i & 1);
        Self {
            level: self.level + 1,
            xyz: [bit(0), bit(1), bit(2)],
        }
    }

    /// A descendant so many levels below, by its place in Morton order among them.
    pub fn descendant(self, scheme: Scheme, levels: u32, morton: u64) -> Self {
        let bits = scheme.dimensions();
        let down =
            |tile: Self, level: u32| tile.child(morton >> (bits * level) & ((1 << bits) - 1));
        let tile = (0..levels).rev().fold(self, down);
        match scheme {
            Scheme::Octree => tile,
            Scheme::Quadtree => Self {
                xyz: [tile.xyz[0], tile.xyz[1], 0],
                ..tile
            },
        }
    }

    /// Its place in Morton order among all tiles of its level.
    pub fn morton(self, scheme: Scheme) -> u64 {
        let bits = scheme.dimensions();
        let mut index = 0;
        for level in 0..self.level {
            for axis in 0..bits {
                let bit = self.xyz[axis as usize] >> level & 1;
                index |= bit.checked_shl(bits * level + axis).unwrap_or(0);
            }
        }
        index
    }

    /// A template URI with the tile's numbers for `{level}`, `{x}`, `{y}` and `{z}`.
    pub fn fill(self, template: &str) -> String {
        let [x, y, z] = self.xyz.map(|n| n.to_string());
        (template.replace("{level}", &self.level.to_string()))
            .replace("{x}", &x)
            .replace("{y}", &y)
            .replace("{z}", &z)
    }

    /// The part of the root's volume that is the tile's. Boxes are halved along their first two axes, regions in
    /// longitude and latitude; octrees halve the third axis or the heights too. A ball is not halved.
    pub fn volume(self, scheme: Scheme, root: &BoundingVolume) -> BoundingVolume {
        let parts = (-f64::from(self.level)).exp2();
        // Of an interval: its start and length become those of the tile's share.
        let share = |start: f64, length: f64, axis: usize| {
            (
                start + length * parts * self.xyz[axis] as f64,
                length * parts,
            )
        };
        let whole_z = scheme == Scheme::Quadtree;
        match *root {
            BoundingVolume::Box {
                center_m,
                half_axes_m,
            } => {
                let at = |axis: usize| {
                    let (start, length) = share(-1.0, 2.0, axis);
                    start + 0.5 * length
                };
                let z = if whole_z { 0.0 } else { at(2) };
                let half = DVec3::new(parts, parts, if whole_z { 1.0 } else { parts });
                BoundingVolume::Box {
                    center_m: center_m + half_axes_m * DVec3::new(at(0), at(1), z),
                    half_axes_m: half_axes_m * DMat3::from_diagonal(half),
                }
            }
            BoundingVolume::Region {
                west_south_east_north_rad: [west, south, east, north],
                height_m: [low_m, high_m],
            } => {
                let (x, width) = share(west, width_rad(west, east), 0);
                let (y, height) = share(south, north - south, 1);
                let (z, deep_m) = if whole_z {
                    (low_m, high_m - low_m)
                } else {
                    share(low_m, high_m - low_m, 2)
                };
                BoundingVolume::Region {
                    west_south_east_north_rad: [x, y, x + width, y + height],
                    height_m: [z, z + deep_m],
                }
            }
            ball => ball,
        }
    }
}

/// Which of some things there are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Availability {
    /// All or none.
    Constant(bool),
    /// A bit for each, the lowest of the first byte first.
    Bits(Vec<u8>),
}

impl Availability {
    /// Whether there is the thing of that number.
    pub fn has(&self, index: u64) -> bool {
        match self {
            Self::Constant(has) => *has,
            Self::Bits(bytes) => {
                let byte = usize::try_from(index / 8).ok().and_then(|i| bytes.get(i));
                byte.is_some_and(|byte| byte >> (index % 8) & 1 == 1)
            }
        }
    }

    /// How many of the first `count` there are.
    pub fn count(&self, count: u64) -> u64 {
        match self {
            Self::Constant(has) => u64::from(*has) * count,
            Self::Bits(_) => (0..count).map(|i| u64::from(self.has(i))).sum(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tiles::volume::Bounds;
    use glam::DAffine3;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    #[test]
    fn morton_order_is_that_of_the_specification() {
        // Its table of a quadtree's level 2, and x fastest, then y, then z in an octree.
        let at = |level, xyz| Coordinates { level, xyz };
        assert_eq!(at(2, [0, 0, 0]).morton(Scheme::Quadtree), 0);
        assert_eq!(at(2, [3, 0, 0]).morton(Scheme::Quadtree), 5);
        assert_eq!(at(2, [2, 3, 0]).morton(Scheme::Quadtree), 14);
        assert_eq!(at(1, [1, 0, 1]).morton(Scheme::Octree), 5);
        assert_eq!(at(3, [5, 6, 1]).morton(Scheme::Octree), 0b011_010_101);
    }

    #[test]
    fn tiles_of_a_tree() {
        assert_eq!(Scheme::Quadtree.tree_tiles(3), Some(21));
        assert_eq!(Scheme::Octree.tree_tiles(3), Some(73));
        assert_eq!(Scheme::Octree.tree_tiles(22), None);
        assert_eq!(Scheme::Quadtree.level_tiles(u32::MAX), None);
    }

    #[test]
    fn a_region_across_the_date_line_is_halved_there() {
        let region = BoundingVolume::Region {
            west_south_east_north_rad: [PI - 0.1, 0.0, -PI + 0.1, 0.2],
            height_m: [0.0, 8.0],
        };
        let east = Coordinates {
            level: 1,
            xyz: [1, 0, 1],
        }
        .volume(Scheme::Octree, &region);
        let BoundingVolume::Region {
            west_south_east_north_rad: edges,
            height_m,
        } = east
        else {
            panic!("{east:?}")
        };
        for (a, b) in edges.iter().zip([PI, 0.0, PI + 0.1, 0.1]) {
            assert!((a - b).abs() < 1e-12, "{edges:?}");
        }
        assert_eq!(height_m, [4.0, 8.0]);
    }

    proptest! {
        #[test]
        fn a_place_in_morton_order_leads_back(level in 0..20u32, seed: u64, octree: bool) {
            let scheme = if octree { Scheme::Octree } else { Scheme::Quadtree };
            let morton = seed % scheme.level_tiles(level).unwrap();
            let tile = Coordinates::default().descendant(scheme, level, morton);
            prop_assert_eq!(tile.level, level);
            prop_assert!(tile.xyz.iter().all(|n| *n < 1 << level));
            prop_assert_eq!(tile.morton(scheme), morton);
        }

        /// The children of a box fill it: any point of it lies in the child that its coordinates name.
        #[test]
        fn a_point_lies_in_its_tile(at in prop::array::uniform3(0.0..1.0f64), level in 0..8u32, octree: bool) {
            let scheme = if octree { Scheme::Octree } else { Scheme::Quadtree };
            let half_axes_m = DMat3::from_cols(DVec3::new(3.0, 4.0, 0.0), DVec3::new(-8.0, 6.0, 0.0), DVec3::Z);
            let root = BoundingVolume::Box { center_m: DVec3::new(7.0, 8.0, 9.0), half_axes_m };
            let number = |f: f64| (f * f64::from(1 << level)) as u64;
            let z = if octree { number(at[2]) } else { 0 };
            let tile = Coordinates { level, xyz: [number(at[0]), number(at[1]), z] };
            let point = DVec3::new(7.0, 8.0, 9.0) + half_axes_m * (2.0 * DVec3::from_array(at) - 1.0);
            let bounds = Bounds::of(&tile.volume(scheme, &root), &DAffine3::IDENTITY);
            prop_assert!(bounds.distance_m(point) < 1e-9);
        }
    }
}
