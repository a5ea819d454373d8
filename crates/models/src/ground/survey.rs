//! A real city from its triangles: rasters of surface and ground, what sight lines meet, buildings, wind, the land around.

use crate::ground::city::{CityParams, GroundMap, RealCity, STATION_MAST_M};
use crate::ground::dsm::{Dsm, HeightGrid, Solids};
use crate::ground::footprints;
use crate::ground::lattice::Lattice;
use crate::ground::raster::{self, GroundFilter, RasterFrame};
use crate::ground::triangles::TriangleTree;
use crate::shape::mesh::MeshData;
use crate::shape::textured::TexturedMesh;
use glam::{DVec2, DVec3};

/// Cells that the surface raster has at most.
const MOST_CELLS: f64 = 12e6;
/// Linear RGB albedo of ground of which nothing is known: dry grass and asphalt.
const PLAIN_GROUND: [f32; 3] = [0.14, 0.14, 0.1];
/// Cells along a side of the raster of colours.
const COLOUR_CELLS: usize = 48;
/// What rises less than this above the ground shows it [m].
const GROUND_RISE_M: f64 = 1.0;
/// How far beyond the border the land has the mean colour [m]: the border's own would make stripes to the horizon.
const COLOUR_FADES_M: f64 = 300.0;

/// What is known of a place.
#[derive(Clone, Debug, Default)]
pub struct Evidence {
    /// Its triangles, ground and all that stands on it [m, ENU].
    pub triangles: Vec<[DVec3; 3]>,
    /// Linear RGB albedo of each.
    pub albedo: Vec<[f32; 3]>,
    /// The bare ground, where a source says which it is [m, ENU].
    pub terrain: Option<HeightGrid>,
    /// Coarse triangles of the land around [m, ENU] that the tiles show too.
    pub far: Vec<[DVec3; 3]>,
    /// Coarse triangles of the land around [m, ENU] that nothing else shows: another height raster.
    pub horizon: Vec<[DVec3; 3]>,
}

impl Evidence {
    /// Adds the triangles of a mesh whose parent frame [m] `to_enu` takes into the site's.
    pub fn add(&mut self, mesh: &TexturedMesh, to_enu: impl Fn(DVec3) -> DVec3) {
        for triangle in mesh.indices.as_chunks::<3>().0 {
            if triangle.iter().any(|i| *i as usize >= mesh.positions.len()) {
                continue;
            }
            self.triangles
                .push(triangle.map(|i| to_enu(mesh.vertex_m(i))));
            self.albedo.push(albedo(mesh, triangle));
        }
    }

    /// How the triangles face as seen from above: 1 all up, -1 all down, 0 as many as that, as of closed solids.
    pub fn facing(&self) -> f64 {
        let area = |[a, b, c]: &[DVec3; 3]| (b - a).truncate().perp_dot((c - a).truncate());
        let areas = self
            .triangles
            .iter()
            .map(area)
            .filter(|area| area.is_finite());
        let [up, all] = areas.fold([0.0; 2], |[up, all], area| [up + area, all + area.abs()]);
        if all > 0.0 { up / all } else { 0.0 }
    }
}

/// Linear RGB albedo in the middle of a triangle.
fn albedo(mesh: &TexturedMesh, triangle: &[u32; 3]) -> [f32; 3] {
    let look = &mesh.look;
    let mut rgb = [look.base_color[0], look.base_color[1], look.base_color[2]];
    if !mesh.colors.is_empty() {
        for (c, value) in rgb.iter_mut().enumerate() {
            let of = |i: &u32| mesh.colors.get(*i as usize).map_or(1.0, |color| color[c]);
            *value *= triangle.iter().map(of).sum::<f32>() / 3.0;
        }
    }
    if let Some(texture) = &look.texture
        && !texture.rgba.is_empty()
    {
        let place = |axis: usize| {
            let of = |i: &u32| mesh.uv.get(*i as usize).map_or(0.0, |uv| uv[axis]);
            let x = triangle.iter().map(of).sum::<f32>() / 3.0;
            let x = if look.repeats {
                x.rem_euclid(1.0)
            } else {
                x.clamp(0.0, 1.0)
            };
            let size = texture.size_px[axis];
            ((x * size as f32) as u32).min(size.saturating_sub(1)) as usize
        };
        let pixel = 4 * (place(1) * texture.size_px[0] as usize + place(0));
        for (c, value) in rgb.iter_mut().enumerate() {
            let code = texture.rgba.get(pixel + c).copied().unwrap_or(128);
            *value *= linear(f32::from(code) / 255.0);
        }
    }
    rgb
}

/// The sRGB curve (IEC 61966-2-1).
fn linear(code: f32) -> f32 {
    if code <= 0.04045 {
        code / 12.92
    } else {
        ((code + 0.055) / 1.055).powf(2.4)
    }
}

/// How a place is surveyed.
#[derive(Clone, Debug)]
pub struct SurveyOptions {
    /// Half the side of the square about the site point in which triangles count [m].
    pub radius_m: f64,
    /// Whether the Earth's curvature shows in it: not in a model with a flat ground of its own.
    pub curved: bool,
    /// How bare ground is told where no source says which it is.
    pub filter: GroundFilter,
}

/// Why a place cannot be surveyed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SurveyError {
    /// No triangle near the site point.
    #[error(
        "has no triangle within {radius_m} m of the site point (it reaches from {from} to {to}, east, north, up \
         in m); move the site, or raise radius_m"
    )]
    Nothing {
        /// How far was looked [m].
        radius_m: f64,
        /// South-western lower corner of what there is [m].
        from: DVec3,
        /// North-eastern upper corner [m].
        to: DVec3,
    },
}

/// The city that some triangles show; `params` names what it was made from.
pub fn survey(
    mut evidence: Evidence,
    params: CityParams,
    options: &SurveyOptions,
) -> Result<RealCity, SurveyError> {
    let reach = DVec2::splat(options.radius_m);
    let near = |triangle: &[DVec3; 3]| {
        let [a, b, c] = triangle.map(DVec3::truncate);
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        triangle.iter().all(|r| r.is_finite()) && low.cmple(reach).all() && high.cmpge(-reach).all()
    };
    let bounds = |triangles: &[[DVec3; 3]]| {
        let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        (triangles.iter().flatten()).fold(none, |(low, high), r| (low.min(*r), high.max(*r)))
    };
    let (from, to) = bounds(&evidence.triangles);
    let kept: Vec<bool> = evidence.triangles.iter().map(near).collect();
    let mut keep = kept.iter();
    evidence
        .triangles
        .retain(|_| keep.next().copied().unwrap_or(false));
    let mut keep = kept.iter();
    evidence
        .albedo
        .retain(|_| keep.next().copied().unwrap_or(false));
    if evidence.triangles.is_empty() {
        let radius_m = options.radius_m;
        return Err(SurveyError::Nothing { radius_m, from, to });
    }
    let (low, high) = bounds(&evidence.triangles);
    let (low, high) = (low.truncate().max(-reach), high.truncate().min(reach));
    let cell_m = cell_m(high - low);
    let frame = RasterFrame::covering(low, high, cell_m);
    let (top, lowest) = raster::hits(&frame, evidence.triangles.iter().copied());
    let terrain = terrain(&evidence, &frame, lowest, &options.filter);
    let shows_ground = coverage(&top, &terrain);
    let mut surface = top;
    for k in 0..surface.heights_m.len() {
        if !surface.heights_m[k].is_finite() {
            let p = frame.middle_m(k % surface.nx, k / surface.nx);
            surface.heights_m[k] = terrain.bilinear_m(p.x, p.y) as f32;
        }
    }

    let far = [&evidence.far, &evidence.horizon].map(|far| far_heights(far));
    let far_m = |p: DVec2| {
        far.iter().flatten().find_map(|grid| {
            let k = grid.cell_index(p.x, p.y)?;
            grid.heights_m[k]
                .is_finite()
                .then(|| grid.bilinear_m(p.x, p.y))
        })
    };
    let longest_m = (high - low).max_element();
    let step_m = (2.0 * terrain.cell_m).max(longest_m / 160.0);
    let land = Lattice::around(&terrain, step_m, options.curved, far_m);
    let colours = Colours::new(&evidence, &frame, &terrain);
    let of_tiles = far[0].as_ref();
    let shown_near = |p: DVec2| {
        let k = shows_ground.cell_index(p.x, p.y);
        k.is_some_and(|k| shows_ground.heights_m[k] > 0.5)
    };
    let shown = |p: DVec2| {
        let far = || {
            let grid = of_tiles?;
            Some(grid.heights_m[grid.cell_index(p.x, p.y)?].is_finite())
        };
        shown_near(p) || (surface.cell_index(p.x, p.y).is_none() && far().unwrap_or(false))
    };
    let around = land.meshes(cell_m, shown, |p| colours.at(p));
    // Sight lines meet the land beyond the near tiles whoever shows it.
    let solid_land = match of_tiles {
        Some(_) => land.meshes(cell_m, shown_near, |_| PLAIN_GROUND),
        None => around.clone(),
    };
    let mut triangles = std::mem::take(&mut evidence.triangles);
    triangles.extend(solid_land.iter().flat_map(MeshData::corners_m));

    let ground_m = |e: f64, n: f64| terrain.bilinear_m(e, n);
    let buildings = footprints::buildings(&surface, ground_m);
    let roughness = footprints::roughness(&surface, ground_m, |_| true);
    let dsm = Dsm::new(terrain, surface, 0.0).with_solids(Solids {
        triangles: TriangleTree::new(triangles),
        land,
    });
    Ok(RealCity {
        station_enu_m: DVec3::Z * (dsm.surface_m(0.0, 0.0) + STATION_MAST_M),
        dsm,
        buildings,
        roughness,
        ground_map: GroundMap {
            size_px: 1,
            extent_m: longest_m,
            rgb: vec![[128; 3]],
        },
        around,
        params,
    })
}

/// The cell size for a rectangle [m]: 0.5 m to 2 m, or as few cells as are allowed.
fn cell_m(size: DVec2) -> f64 {
    let plain = if size.max_element() <= 1_000.0 {
        0.5
    } else {
        1.0
    };
    let least = (size.x.max(1.0) * size.y.max(1.0) / MOST_CELLS).sqrt();
    if least <= plain {
        plain
    } else {
        // Halves of metres keep rasters of one place alike.
        (2.0 * least).ceil() / 2.0
    }
}

/// Bare ground over a frame, at about 2 m: what a source says it is, or what is left of the lowest hits.
fn terrain(
    evidence: &Evidence,
    frame: &RasterFrame,
    lowest: HeightGrid,
    filter: &GroundFilter,
) -> HeightGrid {
    let factor = (2.0 / frame.cell_m).round().max(1.0) as usize;
    let coarse = RasterFrame {
        cell_m: frame.cell_m * factor as f64,
        size: frame.size.map(|n| n.div_ceil(factor)),
        ..*frame
    };
    if let Some(known) = &evidence.terrain {
        // Its cells where it has some; its border's heights go on.
        return HeightGrid::from_fn(coarse.origin_m, coarse.cell_m, coarse.size, |e, n| {
            known.bilinear_m(e, n)
        });
    }
    let [nx, ny] = coarse.size;
    let mut heights_m = vec![f32::INFINITY; nx * ny];
    for (k, height_m) in lowest.heights_m.iter().enumerate() {
        let block = &mut heights_m[k / lowest.nx / factor * nx + k % lowest.nx / factor];
        *block = block.min(*height_m);
    }
    let lowest = HeightGrid {
        cell_m: coarse.cell_m,
        nx,
        ny,
        heights_m,
        ..lowest
    };
    raster::ground(&lowest, filter)
}

/// Where triangles show the ground, above 0.5: under what stands on it, as next to that.
fn coverage(top: &HeightGrid, terrain: &HeightGrid) -> HeightGrid {
    let mut shows = top.clone();
    for (k, height_m) in shows.heights_m.iter_mut().enumerate() {
        let middle = |k: usize, origin: f64| origin + (k as f64 + 0.5) * top.cell_m;
        let e = middle(k % top.nx, top.origin_e_m);
        let n = middle(k / top.nx, top.origin_n_m);
        *height_m = if !height_m.is_finite() {
            0.0
        } else if f64::from(*height_m) - terrain.bilinear_m(e, n) < GROUND_RISE_M {
            1.0
        } else {
            f32::NAN
        };
    }
    raster::fill(&mut shows);
    shows
}

/// Heights of the land around at 100 m, no number where there are none.
fn far_heights(triangles: &[[DVec3; 3]]) -> Option<HeightGrid> {
    if triangles.is_empty() {
        return None;
    }
    let reach = DVec2::splat(super::lattice::REACH_M);
    let frame = RasterFrame::covering(-reach, reach, 100.0);
    let (top, _) = raster::hits(&frame, triangles.iter().copied());
    // Its border cells lean on neighbours without a number: these take theirs.
    let mut filled = top.clone();
    for (k, height_m) in filled.heights_m.iter_mut().enumerate() {
        if height_m.is_finite() {
            continue;
        }
        let (i, j) = ((k % top.nx) as isize, (k / top.nx) as isize);
        let around = (-1..=1).flat_map(|v| (-1..=1).map(move |u| (i + u, j + v)));
        let known = around.filter_map(|(i, j)| {
            let inside = i >= 0 && j >= 0 && (i as usize) < top.nx && (j as usize) < top.ny;
            let height_m = inside.then(|| top.heights_m[j as usize * top.nx + i as usize])?;
            height_m.is_finite().then_some(height_m)
        });
        let (sum, count) = known.fold((0.0, 0.0), |(sum, count), h| (sum + h, count + 1.0));
        *height_m = if count > 0.0 { sum / count } else { f32::NAN };
    }
    // Only cells with a number of their own are answered for; their neighbours' serve to interpolate.
    let first_ring = filled.clone();
    for (k, own) in top.heights_m.iter().enumerate() {
        filled.heights_m[k] = if own.is_finite() {
            *own
        } else {
            first_ring.heights_m[k]
        };
    }
    Some(filled)
}

/// What colour the ground has, coarsely.
struct Colours {
    /// Linear RGB albedo, a raster each.
    near: [HeightGrid; 3],
    /// Linear RGB albedo of all of it together, which the land far from it takes on.
    mean: [f32; 3],
}

impl Colours {
    fn new(evidence: &Evidence, frame: &RasterFrame, terrain: &HeightGrid) -> Self {
        let size = DVec2::new(frame.size[0] as f64, frame.size[1] as f64) * frame.cell_m;
        let cell_m = size.max_element() / COLOUR_CELLS as f64;
        let [nx, ny] = [size.x, size.y].map(|size| (size / cell_m).ceil().max(1.0) as usize);
        let mut sums = vec![[0.0_f64; 4]; nx * ny];
        for (triangle, albedo) in evidence.triangles.iter().zip(&evidence.albedo) {
            let [a, b, c] = *triangle;
            // By its area from above; what faces down is not seen there.
            let area = 0.5 * (b - a).truncate().perp_dot((c - a).truncate());
            let middle = (a + b + c) / 3.0;
            let at = (middle.truncate() - frame.origin_m) / cell_m;
            let inside =
                at.cmpge(DVec2::ZERO).all() && (at.x as usize) < nx && (at.y as usize) < ny;
            // Roofs have colours of their own.
            let low = middle.z - terrain.bilinear_m(middle.x, middle.y) < GROUND_RISE_M;
            if area > 0.0 && inside && low {
                let sum = &mut sums[at.y as usize * nx + at.x as usize];
                for (sum, value) in sum.iter_mut().zip(albedo) {
                    *sum += area * f64::from(*value);
                }
                sum[3] += area;
            }
        }
        let whole = |c: usize| sums.iter().map(|sum| sum[c]).sum::<f64>();
        let area = whole(3);
        let overall = [0, 1, 2].map(|c| match area > 0.0 {
            true => (whole(c) / area) as f32,
            false => PLAIN_GROUND[c],
        });
        // A cell of which little ground is seen takes its neighbours' colour.
        let least = 0.25 * cell_m * cell_m;
        let near = [0, 1, 2].map(|c| {
            let mean = |sum: &[f64; 4]| {
                if sum[3] > least {
                    (sum[c] / sum[3]) as f32
                } else {
                    f32::NAN
                }
            };
            let mut grid = HeightGrid {
                origin_e_m: frame.origin_m.x,
                origin_n_m: frame.origin_m.y,
                cell_m,
                nx,
                ny,
                heights_m: sums.iter().map(mean).collect(),
            };
            if grid.heights_m.iter().any(|value| value.is_finite()) {
                raster::fill(&mut grid);
            } else {
                grid.heights_m.fill(overall[c]);
            }
            grid
        });
        Self {
            near,
            mean: overall,
        }
    }

    fn at(&self, p: DVec2) -> [f32; 3] {
        let grid = &self.near[0];
        let low = DVec2::new(grid.origin_e_m, grid.origin_n_m);
        let size = DVec2::new(grid.nx as f64, grid.ny as f64) * grid.cell_m;
        let away_m = p.distance(p.clamp(low, low + size));
        let far = (away_m / COLOUR_FADES_M).min(1.0) as f32;
        [0, 1, 2].map(|c| {
            let near = self.near[c].bilinear_m(p.x, p.y) as f32;
            (near + (self.mean[c] - near) * far).clamp(0.0, 0.9)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ground::dsm::{HitKind, LineOfSight};

    fn options() -> SurveyOptions {
        SurveyOptions {
            radius_m: 500.0,
            curved: false,
            filter: GroundFilter::default(),
        }
    }

    /// The walls and the roof of a box without a floor, and a floor.
    fn house(low: DVec3, size: DVec3, floor: bool) -> Vec<[DVec3; 3]> {
        let [x, y, z] = [size.x * DVec3::X, size.y * DVec3::Y, size.z * DVec3::Z];
        let quad = |a: DVec3, u: DVec3, v: DVec3| [[a, a + u, a + u + v], [a, a + u + v, a + v]];
        let mut all = [
            quad(low + z, x, y),
            quad(low, x, z),
            quad(low + y, z, x),
            quad(low, z, y),
            quad(low + x, y, z),
        ]
        .concat();
        if floor {
            all.extend(quad(low, y, x));
        }
        all
    }

    fn evidence(triangles: Vec<[DVec3; 3]>) -> Evidence {
        Evidence {
            albedo: vec![[0.2, 0.1, 0.05]; triangles.len()],
            triangles,
            ..Evidence::default()
        }
    }

    #[test]
    fn a_sheet_faces_up_or_down_and_a_solid_neither() {
        let size = DVec3::new(10.0, 8.0, 6.0);
        let solid = house(DVec3::ZERO, size, true);
        assert!(evidence(solid.clone()).facing().abs() < 1e-12);
        let open = evidence(house(DVec3::ZERO, size, false));
        assert!((open.facing() - 1.0).abs() < 1e-12);
        let floor = evidence(solid[10..].to_vec());
        assert!((floor.facing() + 1.0).abs() < 1e-12);
        assert_eq!(Evidence::default().facing(), 0.0);
    }

    #[test]
    fn houses_alone_stand_on_ground_at_their_floors() {
        let mut all = Vec::new();
        for k in 0..16 {
            let low = DVec3::new(
                f64::from(k % 4) * 60.0 - 100.0,
                f64::from(k / 4) * 60.0 - 100.0,
                0.0,
            );
            let floor_m = 30.0 + 0.02 * low.x;
            all.extend(house(
                low.with_z(floor_m),
                DVec3::new(15.0, 12.0, 9.0),
                true,
            ));
        }
        let city = survey(evidence(all), CityParams::default(), &options()).unwrap();
        assert_eq!(city.buildings.len(), 16);
        for building in &city.buildings {
            let low = building
                .footprint_enu_m()
                .iter()
                .fold(DVec2::INFINITY, |a, b| a.min(*b));
            let want = 30.0 + 0.02 * low.x;
            assert!(
                (building.base_m - want).abs() < 0.5,
                "{} {want}",
                building.base_m
            );
            assert!(
                (building.height_m() - 9.0).abs() < 0.6,
                "{}",
                building.height_m()
            );
        }
        assert!((city.dsm.terrain_m(-70.0, -70.0) - 28.6).abs() < 0.6);
        // Nothing shows the ground, so the land does, under the houses and between them.
        let down = |e: f64, n: f64| {
            let from = DVec3::new(e, n, 200.0);
            city.dsm.first_hit_kind(from, DVec3::NEG_Z, 400.0).unwrap()
        };
        assert_eq!(down(-93.0, -94.0).1, HitKind::Building);
        let (range_m, kind) = down(-70.0, -70.0);
        assert!(
            (range_m - 171.4).abs() < 0.8 && kind == HitKind::Ground,
            "{range_m}"
        );
        assert_eq!(down(5_000.0, 900.0).1, HitKind::Ground);
        let shares = city.roughness.shares.unwrap();
        assert!((city.roughness.mean_height_m - 9.0).abs() < 0.5);
        assert!(shares.plan > 0.04 && shares.plan < 0.12, "{}", shares.plan);
        // Their colour is the land's.
        assert!((city.around[0].colors[0][0] - 0.2).abs() < 0.15);
    }

    #[test]
    fn one_skin_over_houses_and_ground_is_parted() {
        // As photogrammetry sees it: a ground of 300 m with houses on it, no floors.
        let tilt = |e: f64| 100.0 + 0.05 * e;
        let at = |e: f64, n: f64| DVec3::new(e, n, tilt(e));
        let [a, b, c, d] = [
            at(-150.0, -150.0),
            at(150.0, -150.0),
            at(150.0, 150.0),
            at(-150.0, 150.0),
        ];
        let mut all = vec![[a, b, c], [a, c, d]];
        for k in 0..9 {
            let e = f64::from(k % 3) * 80.0 - 90.0;
            let n = f64::from(k / 3) * 80.0 - 90.0;
            all.extend(house(
                at(e, n) - DVec3::Z,
                DVec3::new(20.0, 14.0, 13.0),
                false,
            ));
        }
        let city = survey(evidence(all), CityParams::default(), &options()).unwrap();
        assert_eq!(city.buildings.len(), 9);
        for e in [-140.0, -80.0, -20.0, 40.0, 120.0] {
            let found = city.dsm.terrain_m(e, -80.0);
            assert!((found - tilt(e)).abs() < 0.6, "{found} {}", tilt(e));
        }
        // The land begins where the skin ends: no gap for a sight line just above its border.
        for k in 0..60 {
            let to = DVec3::new(149.0 + f64::from(k) * 0.1, 3.3, 0.0);
            let from = DVec3::new(100.0, 0.0, 130.0);
            let hit = city
                .dsm
                .first_hit(from, (to.with_z(90.0) - from).normalize(), 500.0);
            assert!(hit.is_some(), "{k}");
        }
        let (from, to) = (
            DVec3::new(-120.0, -83.0, 100.0),
            DVec3::new(-20.0, -83.0, 103.0),
        );
        assert!(matches!(
            city.dsm.line_of_sight(from, to),
            LineOfSight::BlockedAt(_)
        ));
        let meshes: usize = city.around.iter().map(|mesh| mesh.triangle_count()).sum();
        assert!((2_000..40_000).contains(&meshes), "{meshes}");
    }

    #[test]
    fn a_place_far_from_its_data_says_so() {
        let far = house(DVec3::new(5_000.0, 0.0, 0.0), DVec3::splat(10.0), true);
        let error = survey(evidence(far), CityParams::default(), &options());
        let text = error.map(|_| ()).unwrap_err().to_string();
        assert!(
            text.contains("within 500 m") && text.contains("5000"),
            "{text}"
        );
    }
}
