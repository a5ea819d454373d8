//! What stands on a block between streets: each district has its habit.

use glam::DVec2;

use super::build::Extrusion;
use super::parts::{
    Building, BuildingKind, FLATS, Finish, OFFICE_STOREY_M, OFFICES, Part, Roof, STOREY_M, TILES,
    WALLS, shaded,
};
use super::plan::Draft;
use crate::maths::curve::smoothstep;
use crate::maths::polygon::{
    OrientedRectangle, area_m2, centroid, clip, contains, inner_rectangle, inset, main_axis,
    rectangle, simplified, span,
};
use crate::maths::rng::Stream;
use crate::shape::mesh::Surface;

/// What a block is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum BlockUse {
    /// What its district makes of it.
    District,
    /// A piece of the main park.
    Park,
    /// The square with the station's tower.
    Station,
}

/// Splits a convex block across its longer side until its lots are smaller than some 1 to 1.7 times
/// `lot_m2` [m²], and adds them to `lots`.
pub(super) fn split_lots(
    outline: Vec<DVec2>,
    lot_m2: f64,
    rng: &mut Stream,
    lots: &mut Vec<Vec<DVec2>>,
) {
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

impl Draft<'_> {
    /// Builds over a block inside its kerbs, on both banks where the river crosses it.
    pub(super) fn block(&mut self, kerb: &[DVec2], block: BlockUse) {
        let Some(river) = self.river.clone() else {
            return self.dry_block(kerb, block);
        };
        let near = centroid(kerb);
        let normal = river.normal(near.x);
        let on_line = DVec2::new(near.x, river.north_m(near.x));
        let bank = river.half_width_m + 13.0;
        if kerb.iter().all(|&p| (p - on_line).dot(normal).abs() > bank) {
            return self.dry_block(kerb, block);
        }
        for side in [-1.0, 1.0] {
            let shore = clip(kerb, on_line + normal * bank * side, normal * side);
            self.dry_block(&shore, block);
        }
    }

    /// Builds over a block by its district's habit.
    fn dry_block(&mut self, kerb: &[DVec2], block: BlockUse) {
        if kerb.len() < 3 || area_m2(kerb) < 500.0 {
            return self.paint(kerb, [140, 136, 128]);
        }
        self.paint(kerb, [150, 146, 139]);
        match block {
            BlockUse::Station => return self.station_block(kerb),
            BlockUse::Park => return self.park_block(kerb),
            BlockUse::District => {}
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
                let wall = self.rng.pick(&WALLS);
                let wall = shaded(wall, self.rng.range(0.8, 1.1));
                let pitched = if self.rng.uniform() < 0.85 {
                    pitched
                } else {
                    !pitched
                };
                let (roof, cover) = if pitched {
                    let tile = self.rng.pick(&TILES);
                    (
                        Roof::Gable(self.rng.range(3.2, 4.8)),
                        shaded(tile, self.rng.range(0.8, 1.15)),
                    )
                } else {
                    (Roof::Flat(0.8), self.rng.pick(&FLATS))
                };
                let finish = Finish {
                    blind_ends: true,
                    ..Finish::facade(Surface::FacadeResidential, wall, cover)
                };
                let house = Extrusion::up_to(eaves, quad, roof);
                self.build(BuildingKind::Apartment, finish, [house]);
            }
        }
        for _ in 0..(area_m2(&inner) / 900.0) as usize {
            let at = centroid(&inner).lerp(self.rng.pick(&inner), self.rng.range(0.0, 0.65));
            self.plant(at, 0.9);
        }
    }

    /// Free-standing L-, U- and I-shaped blocks of flats or small offices on green lots.
    fn free_block(&mut self, outline: &[DVec2], lot_m2: f64) {
        self.paint(outline, [92, 112, 66]);
        let mut lots = Vec::new();
        split_lots(outline.to_vec(), lot_m2, &mut self.rng, &mut lots);
        for lot in lots {
            let OrientedRectangle {
                center_m,
                axis,
                half_m,
            } = inner_rectangle(&lot, main_axis(&lot));
            let half = half_m - DVec2::splat(3.0);
            if half.min_element() < 5.0 || self.rng.uniform() > self.params.building_density {
                self.plant(center_m, 1.0);
                continue;
            }
            let d = self.rng.range(11.0, 13.0);
            let place = |x: f64, y: f64| center_m + axis * x + axis.perp() * y;
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
            let height = (floors * STOREY_M).min(self.height_cap_m(center_m));
            let wall = self.rng.pick(&WALLS[2..]);
            let cover = self.rng.pick(&FLATS);
            let wall = shaded(wall, self.rng.range(0.85, 1.15));
            let finish = Finish::facade(Surface::FacadeResidential, wall, cover);
            let slab = Extrusion::up_to(height, shape, Roof::Flat(0.8));
            self.build(BuildingKind::Apartment, finish, [slab]);
            for _ in 0..2 {
                let at = self
                    .rng
                    .pick(&lot)
                    .lerp(center_m, self.rng.range(0.1, 0.25));
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
            let albedo = self.rng.pick(&OFFICES);
            let wall = shaded(albedo, self.rng.range(0.85, 1.2));
            let finish = Finish::facade(Surface::FacadeOffice, wall, self.rng.pick(&FLATS));
            if height < 42.0 {
                let office = Extrusion::up_to(height, lot, Roof::Flat(1.0));
                self.build(BuildingKind::Office, finish, [office]);
                continue;
            }
            let podium = storeys(self.rng.range(10.0, 17.0));
            let inner = inner_rectangle(&inset(&lot, |_| 2.0), main_axis(&lot));
            let half = inner.half_m.min(DVec2::splat(19.0));
            let waist = storeys(podium + (height - podium) * self.rng.range(0.55, 0.8));
            let shaft = |heights: [f64; 2], scale: f64, parapet: f64| {
                let outline = rectangle(inner.center_m, inner.axis, half * scale);
                Extrusion::between(heights, outline, Roof::Flat(parapet))
            };
            let mut pieces = vec![Extrusion::up_to(podium, lot, Roof::Flat(1.0))];
            if self.rng.uniform() < 0.5 {
                pieces.push(shaft([podium, waist], 1.0, 1.0));
                pieces.push(shaft([waist, height], 0.72, 1.2));
            } else {
                pieces.push(shaft([podium, height], 0.95, 1.2));
            }
            self.build(BuildingKind::Tower, finish, pieces);
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
            let OrientedRectangle {
                center_m,
                axis,
                half_m,
            } = inner_rectangle(&lot, main_axis(&lot));
            if self.rng.uniform() > self.params.building_density || half_m.min_element() < 5.0 {
                self.plant(center_m, 0.8);
                continue;
            }
            let half = (half_m - DVec2::splat(2.5)).min(DVec2::new(
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
            let wall = self.rng.pick(&WALLS);
            let tile = self.rng.pick(&TILES);
            let at = center_m + axis.perp() * self.rng.range(-1.5, 1.5);
            let wall = shaded(wall, self.rng.range(0.9, 1.15));
            let cover = shaded(tile, self.rng.range(0.8, 1.2));
            let finish = Finish::facade(Surface::FacadeResidential, wall, cover);
            let house = Extrusion::up_to(eaves, rectangle(at, axis, half), roof);
            self.build(BuildingKind::House, finish, [house]);
            if self.rng.uniform() < 0.55 {
                let at = self.rng.pick(&lot).lerp(center_m, 0.2);
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
            let OrientedRectangle {
                center_m,
                axis,
                half_m,
            } = inner_rectangle(&lot, main_axis(&lot));
            let half = half_m - DVec2::splat(5.0);
            if half.min_element() < 8.0 {
                continue;
            }
            let tone = self.rng.range(0.3, 0.62) as f32;
            let wall = [tone, tone, tone * self.rng.range(0.9, 1.08) as f32];
            let height = self.rng.range(6.5, 11.0);
            let finish = Finish::plain(wall, self.rng.pick(&FLATS));
            let outline = rectangle(center_m, axis, half);
            let hall = Extrusion::up_to(height, outline, Roof::Flat(0.5));
            self.build(BuildingKind::Industrial, finish, [hall]);
        }
    }

    /// Lawn, crossing paths and groups of trees.
    fn park_block(&mut self, outline: &[DVec2]) {
        self.paint(outline, [84, 112, 52]);
        let n = outline.len();
        let center = centroid(outline);
        for k in 0..n {
            let middle = outline[k].lerp(outline[(k + 1) % n], 0.5);
            self.map.stroke([middle, center], 3.0, [176, 164, 138], 1.0);
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
        let part = |outline_enu_m, [bottom_m, eaves_m]: [f64; 2], parapet, finish| Part {
            outline_enu_m,
            bottom_m,
            eaves_m,
            roof: Roof::Flat(parapet),
            finish,
        };
        let deck = top - 4.0;
        let roof = [0.24, 0.24, 0.24];
        let office = Finish::facade(Surface::FacadeOffice, [0.42, 0.42, 0.4], roof);
        self.buildings.push(Building {
            kind: BuildingKind::Station,
            base_m,
            variant: 0.4,
            parts: vec![
                part(shaft, [base_m, deck], 0.9, office),
                part(
                    platform,
                    [deck, top],
                    0.0,
                    Finish::plain([0.3, 0.3, 0.3], roof),
                ),
            ],
        });
        for k in 0..lawn.len() {
            let (a, b) = (lawn[k], lawn[(k + 1) % lawn.len()]);
            for t in 0..6 {
                self.plant(a.lerp(b, (f64::from(t) + 0.5) / 6.0), 0.9);
            }
        }
    }
}
