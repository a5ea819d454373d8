//! The street grid: where streets, blocks, the diagonal avenue and the bridges lie.

use glam::DVec2;

use super::blocks::BlockUse;
use super::parts::{Building, BuildingKind, Finish, Part, Roof};
use super::plan::Draft;
use super::river::WATER_M;
use crate::maths::noise::ValueNoise;
use crate::maths::polygon::{centroid, clip, contains, inset, rectangle};
use crate::maths::rng::Stream;

/// Street width from which a street counts as an avenue [m].
const AVENUE_M: f64 = 20.0;
/// Half the width of the diagonal avenue [m].
const DIAGONAL_HALF_M: f64 = 14.0;

/// One of the two families of grid lines.
struct StreetLines {
    /// Their coordinates before the grid is warped [m].
    at_m: Vec<f64>,
    /// Width of the street along each [m].
    width_m: Vec<f64>,
}

impl StreetLines {
    /// Lines out to `reach_m` [m] on both sides of the site point, which lies between two of them.
    fn drawn(rng: &mut Stream, reach_m: f64) -> Self {
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

/// A piece of street between two crossings.
#[derive(Clone, Copy)]
struct Street {
    /// The crossings' middles [m].
    ends: [DVec2; 2],
    width_m: f64,
}

/// Coordinates along and across a piece of street.
struct Strip {
    from: DVec2,
    axis: DVec2,
    length_m: f64,
    width_m: f64,
    /// Length at either end that belongs to the crossing [m].
    clear_m: f64,
}

impl Strip {
    fn at(&self, along_m: f64, left_m: f64) -> DVec2 {
        self.from + self.axis * along_m + self.axis.perp() * left_m
    }

    fn is_avenue(&self) -> bool {
        self.width_m > AVENUE_M
    }
}

/// A warped grid of streets: lines of equal u run about north, lines of equal v about east.
struct StreetGrid {
    us: StreetLines,
    vs: StreetLines,
    /// Crossings [m], row by row of equal v.
    nodes: Vec<DVec2>,
}

impl StreetGrid {
    /// A grid turned by `angle_rad` whose lines reach `reach_m` [m], bent by the noise so that the
    /// site point stays where it is.
    fn drawn(angle_rad: f64, reach_m: f64, noise: &ValueNoise, rng: &mut Stream) -> Self {
        let us = StreetLines::drawn(rng, reach_m);
        let vs = StreetLines::drawn(rng, reach_m);
        let shift = |p: DVec2| {
            DVec2::new(
                noise.at(p / 520.0),
                noise.at(p / 520.0 + DVec2::new(17.0, 41.0)),
            ) * 48.0
        };
        let zero = shift(DVec2::ZERO);
        let (ni, nj) = (us.at_m.len(), vs.at_m.len());
        let nodes = (0..ni * nj)
            .map(|k| {
                let p = DVec2::new(us.at_m[k % ni], vs.at_m[k / ni]);
                DVec2::from_angle(angle_rad).rotate(p + shift(p) - zero)
            })
            .collect();
        Self { us, vs, nodes }
    }

    /// Number of lines of equal u, of equal v.
    fn size(&self) -> [usize; 2] {
        [self.us.at_m.len(), self.vs.at_m.len()]
    }

    fn at(&self, i: usize, j: usize) -> DVec2 {
        self.nodes[j * self.us.at_m.len() + i]
    }

    /// Corners of a block, counter-clockwise from the south-western one [m].
    fn corners(&self, i: usize, j: usize) -> [DVec2; 4] {
        [
            self.at(i, j),
            self.at(i + 1, j),
            self.at(i + 1, j + 1),
            self.at(i, j + 1),
        ]
    }

    /// Widths of the streets along a block's edges, in the order of its corners [m].
    fn widths_m(&self, i: usize, j: usize) -> [f64; 4] {
        [
            self.vs.width_m[j],
            self.us.width_m[i + 1],
            self.vs.width_m[j + 1],
            self.us.width_m[i],
        ]
    }

    /// All pieces of street, crossing by crossing.
    fn streets(&self) -> Vec<Street> {
        let [ni, nj] = self.size();
        let mut streets = Vec::new();
        for j in 0..nj {
            for i in 0..ni {
                if i + 1 < ni {
                    streets.push(Street {
                        ends: [self.at(i, j), self.at(i + 1, j)],
                        width_m: self.vs.width_m[j],
                    });
                }
                if j + 1 < nj {
                    streets.push(Street {
                        ends: [self.at(i, j), self.at(i, j + 1)],
                        width_m: self.us.width_m[i],
                    });
                }
            }
        }
        streets
    }
}

/// The main park: the blocks whose middle lies in a circle.
struct Park {
    center: DVec2,
    radius_m: f64,
}

impl Park {
    /// Whether the block (i, j) of the grid, if there is one, belongs to it.
    fn holds(&self, grid: &StreetGrid, i: isize, j: isize) -> bool {
        let [ni, nj] = grid.size();
        let exists = i >= 0 && j >= 0 && i + 1 < ni as isize && j + 1 < nj as isize;
        exists
            && centroid(&grid.corners(i as usize, j as usize)).distance(self.center) < self.radius_m
    }
}

/// The avenue that cuts through the grid.
struct Diagonal {
    /// A point on its middle line [m].
    through: DVec2,
    /// Unit vector along it.
    course: DVec2,
}

impl Diagonal {
    /// Whether an outline lies clear of it, or spans it so widely that no corner is near.
    fn is_clear_of(&self, outline: &[DVec2]) -> bool {
        outline
            .iter()
            .all(|p| (*p - self.through).dot(self.course.perp()).abs() > DIAGONAL_HALF_M)
    }
}

impl Draft<'_> {
    /// Lays out streets, blocks, avenue trees, river banks and bridges.
    pub(super) fn layout(&mut self) {
        let extent = self.params.extent_m;
        let angle_rad = self.rng.range(0.12, 0.4);
        let grid = StreetGrid::drawn(angle_rad, extent * 0.74, &self.noise, &mut self.rng);
        // The diagonal avenue passes the station at some distance.
        let heading_rad = angle_rad + 0.25 * std::f64::consts::PI + self.rng.range(-0.1, 0.1);
        let course = DVec2::from_angle(heading_rad);
        let diagonal = Diagonal {
            through: -course.perp() * 230.0,
            course,
        };
        let park = Park {
            center: DVec2::new(0.21, -0.1) * extent,
            radius_m: extent * (self.params.park_share / std::f64::consts::PI).sqrt(),
        };
        let streets = grid.streets();
        for &street in &streets {
            self.street(street);
        }
        let [ni, nj] = grid.size();
        for j in 0..nj - 1 {
            for i in 0..ni - 1 {
                self.grid_block(&grid, [i, j], &park, &diagonal);
            }
        }
        self.diagonal_trees(&diagonal, &park);
        self.river_banks();
        for &street in &streets {
            if street.width_m > AVENUE_M {
                self.bridge(street);
            }
        }
    }

    /// Builds over one block of the grid; the diagonal avenue cuts it in two where it runs through.
    fn grid_block(
        &mut self,
        grid: &StreetGrid,
        [i, j]: [usize; 2],
        park: &Park,
        diagonal: &Diagonal,
    ) {
        let (si, sj) = (i as isize, j as isize);
        let corners = grid.corners(i, j);
        let in_park = park.holds(grid, si, sj);
        let beside = [(0, -1), (1, 0), (0, 1), (-1, 0)];
        let widths_m = grid.widths_m(i, j);
        // No street runs between two blocks of the park.
        let mut kerb = inset(&corners, |k| {
            let joined = in_park && park.holds(grid, si + beside[k].0, sj + beside[k].1);
            if joined { 0.0 } else { widths_m[k] / 2.0 }
        });
        let half = self.params.extent_m / 2.0 - 4.0;
        for normal in [DVec2::X, DVec2::Y, DVec2::NEG_X, DVec2::NEG_Y] {
            kerb = clip(&kerb, -normal * half, normal);
        }
        let block = if contains(&corners, DVec2::ZERO) {
            BlockUse::Station
        } else if in_park {
            BlockUse::Park
        } else {
            BlockUse::District
        };
        if block != BlockUse::District || diagonal.is_clear_of(&kerb) {
            if !kerb.is_empty() {
                self.block(&kerb, block);
            }
            return;
        }
        for normal in [diagonal.course.perp(), -diagonal.course.perp()] {
            let piece = clip(&kerb, diagonal.through + normal * DIAGONAL_HALF_M, normal);
            self.block(&piece, block);
        }
    }

    /// Trees along both sides of the diagonal avenue, but in the park.
    fn diagonal_trees(&mut self, diagonal: &Diagonal, park: &Park) {
        let Diagonal { through, course } = *diagonal;
        let extent = self.params.extent_m;
        let mut s = -extent * 0.7;
        while s < extent * 0.7 {
            for side in [-1.0, 1.0] {
                let p = through + course * s + course.perp() * side * (DIAGONAL_HALF_M - 2.0);
                if p.distance(park.center) > park.radius_m {
                    self.plant(p, 0.9);
                }
            }
            s += 13.0;
        }
    }

    /// A street between two crossings: markings, parked cars, avenue trees.
    fn street(
        &mut self,
        Street {
            ends: [a, b],
            width_m,
        }: Street,
    ) {
        let half = self.params.extent_m / 2.0;
        if a.abs().max_element() > half && b.abs().max_element() > half {
            return;
        }
        let strip = Strip {
            from: a,
            axis: (b - a).normalize_or(DVec2::X),
            length_m: a.distance(b),
            width_m,
            clear_m: width_m * 0.75,
        };
        self.markings(&strip);
        for side in [-1.0, 1.0] {
            self.parked_cars(&strip, side);
            if strip.is_avenue() {
                self.avenue_trees(&strip, side);
            }
        }
    }

    /// Lane markings and zebra crossings.
    fn markings(&mut self, strip: &Strip) {
        const WHITE: [u8; 3] = [226, 224, 216];
        let (from_m, to_m) = (strip.clear_m, strip.length_m - strip.clear_m);
        // Dashes of 3 m every 9 m are near the map's resolution; they read as a broken line.
        let lanes: &[f64] = if strip.is_avenue() {
            &[-3.4, 3.4]
        } else {
            &[0.0]
        };
        for &lane in lanes {
            let mut s = from_m;
            while s + 3.0 < to_m {
                let dash = [strip.at(s, lane), strip.at(s + 3.0, lane)];
                self.map.stroke(dash, 0.3, WHITE, 1.0);
                s += 9.0;
            }
        }
        if strip.is_avenue() {
            let line = [strip.at(from_m, 0.0), strip.at(to_m, 0.0)];
            self.map.stroke(line, 0.35, WHITE, 0.9);
        }
        let kerb_m = strip.width_m / 2.0 - 0.35;
        for s in [from_m - 3.0, to_m + 3.0] {
            // A zebra crossing: half of it is paint.
            let across = [strip.at(s, 0.35 - strip.width_m / 2.0), strip.at(s, kerb_m)];
            self.map.stroke(across, 3.2, WHITE, 0.45);
        }
    }

    /// Cars at the kerb of a side (-1 right, 1 left), in a bit more than half of the places.
    fn parked_cars(&mut self, strip: &Strip, side: f64) {
        const COLOURS: [[u8; 3]; 5] = [
            [28, 29, 32],
            [205, 206, 208],
            [120, 124, 130],
            [116, 28, 26],
            [36, 52, 92],
        ];
        let from_kerb_m = if strip.is_avenue() { 4.7 } else { 4.4 };
        let lane = side * (strip.width_m / 2.0 - from_kerb_m);
        let mut s = strip.clear_m + 4.0;
        while s < strip.length_m - strip.clear_m - 5.0 {
            if self.rng.uniform() < 0.55 {
                let colour = self.rng.pick(&COLOURS);
                let car = [strip.at(s, lane), strip.at(s + 4.3, lane)];
                self.map.stroke(car, 1.9, colour, 1.0);
            }
            s += 5.6;
        }
    }

    /// A row of trees along a side (-1 right, 1 left).
    fn avenue_trees(&mut self, strip: &Strip, side: f64) {
        let mut s = strip.clear_m;
        while s < strip.length_m - strip.clear_m {
            self.plant(strip.at(s, side * (strip.width_m / 2.0 - 1.6)), 0.85);
            s += self.rng.range(12.0, 16.0);
        }
    }

    /// The bridge of a street that crosses the river.
    fn bridge(
        &mut self,
        Street {
            ends: [a, b],
            width_m,
        }: Street,
    ) {
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
            finish: Finish::plain([0.42, 0.4, 0.36], [0.13, 0.13, 0.132]),
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

    /// The water, its paved banks, and the trees along them.
    pub(super) fn river_banks(&mut self) {
        let Some(river) = self.river.clone() else {
            return;
        };
        let half = self.params.extent_m / 2.0;
        let steps = 200;
        let at = |k: usize, off: f64| {
            let e = -half + 2.0 * half * k as f64 / steps as f64;
            river.beside(e, off)
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
}
