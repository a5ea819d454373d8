//! The mesh of a building's part.

use super::parts::{BAY_M, Building, Part, Roof};
use crate::shape::mesh::{MeshData, Paint};
use glam::DVec2;

/// Walls, parapet and roof of a part.
pub(super) fn add_part(mesh: &mut MeshData, part: &Part, building: &Building) {
    let o = &part.outline_enu_m;
    let n = o.len();
    let wall = Paint {
        albedo: part.finish.albedo,
        surface: part.finish.surface,
        variant: building.variant,
    };
    let plain = Paint::plain(part.finish.albedo);
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
        let blind = bays < 1.0 || (part.finish.blind_ends && k % 2 == 1);
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
    add_roof(mesh, part, building.variant);
}

/// Parapet and roof of a part.
fn add_roof(mesh: &mut MeshData, part: &Part, variant: f32) {
    let o = &part.outline_enu_m;
    let n = o.len();
    let plain = Paint::plain(part.finish.albedo);
    let cover = Paint {
        variant,
        ..Paint::plain(part.finish.roof_albedo)
    };
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
