//! Raising a building: its extruded parts, and what stands on their roofs.

use glam::DVec2;

use super::parts::{Building, BuildingKind, Finish, Part, Roof, shaded};
use super::plan::Draft;
use crate::maths::polygon::{area_m2, centroid, encloses, main_axis, rectangle};

/// An extruded piece of a building that has no ground yet.
pub(super) struct Extrusion {
    /// Outline, counter-clockwise [m, ENU].
    pub outline_enu_m: Vec<DVec2>,
    /// Foot of the walls above the building's base [m].
    pub foot_m: f64,
    /// Top of the walls above the building's base [m].
    pub eaves_m: f64,
    pub roof: Roof,
}

impl Extrusion {
    /// A piece between two heights above the building's base [m].
    pub(super) fn between(
        [foot_m, eaves_m]: [f64; 2],
        outline_enu_m: impl Into<Vec<DVec2>>,
        roof: Roof,
    ) -> Self {
        Self {
            outline_enu_m: outline_enu_m.into(),
            foot_m,
            eaves_m,
            roof,
        }
    }

    /// A piece from the ground up.
    pub(super) fn up_to(eaves_m: f64, outline_enu_m: impl Into<Vec<DVec2>>, roof: Roof) -> Self {
        Self::between([0.0, eaves_m], outline_enu_m, roof)
    }
}

impl Draft<'_> {
    /// Adds a building on the lowest ground below its first piece, with roof fittings drawn for it.
    pub(super) fn build(
        &mut self,
        kind: BuildingKind,
        finish: Finish,
        pieces: impl IntoIterator<Item = Extrusion>,
    ) {
        let pieces: Vec<Extrusion> = pieces.into_iter().collect();
        let base_m = pieces
            .first()
            .map_or(0.0, |p| self.lowest_m(&p.outline_enu_m));
        let mut parts: Vec<Part> = pieces
            .into_iter()
            .map(|piece| Part {
                outline_enu_m: piece.outline_enu_m,
                bottom_m: base_m + piece.foot_m,
                eaves_m: base_m + piece.eaves_m,
                roof: piece.roof,
                finish,
            })
            .collect();
        let mut fittings = Vec::new();
        for part in &parts {
            if matches!(part.roof, Roof::Flat(_)) {
                fittings.extend(self.roof_plant(part));
            } else {
                fittings.extend(self.chimney(part));
            }
        }
        parts.extend(fittings);
        let variant = self.rng.uniform() as f32;
        self.buildings.push(Building {
            kind,
            base_m,
            variant,
            parts,
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
        (self.rng.uniform() < 0.4).then(|| Part {
            outline_enu_m: rectangle(at, axis, half).to_vec(),
            bottom_m: roof.eaves_m,
            eaves_m: roof.top_m() + 0.9,
            roof: Roof::Flat(0.0),
            finish: Finish::plain([0.3, 0.14, 0.1], [0.05; 3]),
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
            let corner = self.rng.pick(&roof.outline_enu_m);
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
            if !outline.iter().all(|&p| encloses(&roof.outline_enu_m, p)) {
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
                finish: Finish::plain(albedo, shaded(albedo, 0.9)),
            })
            .collect()
    }
}
