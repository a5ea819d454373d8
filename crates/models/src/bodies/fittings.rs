//! What a style adds to an airframe: gear, payload, guards, mast and antennas.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};

use super::parts::{Skid, block, camera, skid, tube};
use super::style::{BLACK, CARBON, CARDBOARD, GREEN, GREY, Gear, Payload, SILVER, UavStyle, WHITE};
use crate::flight::shape::Coat;
use crate::flight::uav::UavModel;
use crate::shape::mesh::{MeshData, Paint};

/// Adds what `style` asks for to a bare airframe with hubs at `hubs_body_m` [m, body].
pub(super) fn fit_out(
    mesh: &mut MeshData,
    hubs_body_m: &[DVec3],
    uav: &UavModel,
    style: &UavStyle,
    coat: &Coat,
) {
    if *style == UavStyle::standard() {
        return;
    }
    // Bottom and top of the hull, cameras included: what lies near the middle.
    let (floor, roof) = mesh
        .positions
        .iter()
        .map(|p| p.map(f64::from))
        .filter(|p| p[0].hypot(p[1]) < 0.2 * uav.diagonal_m)
        .fold((0.0, 0.0), |(low, high): (f64, f64), p| {
            (low.min(p[2]), high.max(p[2]))
        });
    let fittings = Fittings {
        unit: uav.diagonal_m / 0.35,
        floor,
        roof,
        hubs_body_m,
        coat,
    };
    fittings.gear(mesh, style.gear);
    fittings.payload(mesh, style.payload);
    if style.guards {
        fittings.guards(mesh, 1.07 * uav.propeller_diameter_m / 2.0);
    }
    if style.mast {
        fittings.mast(mesh);
    }
    if style.antennas {
        fittings.antennas(mesh);
    }
}

/// Where fittings are fixed.
struct Fittings<'a> {
    /// Scale of the fittings: the diagonal over 350 mm.
    unit: f64,
    /// Bottom of the hull [m, body].
    floor: f64,
    /// Top of the hull [m, body].
    roof: f64,
    hubs_body_m: &'a [DVec3],
    coat: &'a Coat,
}

impl Fittings<'_> {
    /// Skids or legs in place of the frame's own gear.
    fn gear(&self, mesh: &mut MeshData, gear: Gear) {
        let unit = self.unit;
        let paint = Paint::plain(self.coat.gear);
        match gear {
            Gear::Lowered | Gear::Raised => {}
            Gear::Skids => {
                let foot = (self.floor - 0.02 * unit).min(-0.1 * unit);
                let size = Skid {
                    radii_m: [0.007, 0.0055, 0.008].map(|r| r * unit),
                    half_m: 0.09 * unit,
                    pad_at_m: 0.07 * unit,
                    pad_half_m: 0.015 * unit,
                };
                for y in [-1.0, 1.0] {
                    let hip = DVec3::new(0.0, y * 0.04, -0.01) * unit;
                    let knee = DVec3::new(0.0, y * 0.085 * unit, foot);
                    skid(mesh, [hip, knee], size, paint);
                }
            }
            Gear::Legs => {
                let low = self.hubs_body_m.iter().map(|hub| hub.z).fold(0.0, f64::min);
                let foot = (low - 0.12 * unit).min(-0.07 * unit);
                for hub in self.hubs_body_m.iter().map(|hub| hub.truncate()) {
                    let (from, to) = ((hub * 0.9).extend(low), (hub * 0.93).extend(foot));
                    tube(mesh, from, to, 0.005 * unit, paint);
                }
            }
        }
    }

    /// What hangs below the hull.
    fn payload(&self, mesh: &mut MeshData, payload: Payload) {
        let unit = self.unit;
        let hang = |depth: f64| DVec3::Z * (self.floor - depth * unit);
        let grey = Paint::plain(GREY);
        match payload {
            Payload::None => {}
            Payload::Box => {
                let size = [0.12, 0.09, 0.06].map(|x| x * unit);
                block(mesh, hang(0.028), size, CARDBOARD);
            }
            Payload::Cylinder => {
                let half = DVec3::X * 0.085 * unit;
                let green = self.coat.shell == WHITE;
                mesh.frustum(
                    (hang(0.024) - half, 0.026 * unit),
                    (hang(0.024) + half, 0.026 * unit),
                    10,
                    Paint::plain(if green { GREEN } else { SILVER }),
                );
            }
            Payload::Camera => {
                tube(mesh, hang(-0.012), hang(0.02), 0.012 * unit, grey);
                let at = hang(0.048) + DVec3::X * 0.02 * unit;
                camera(mesh, at, 0.026 * unit, BLACK);
            }
            Payload::Parcel => {
                tube(mesh, hang(-0.012), hang(0.2), 0.0018 * unit, grey);
                let size = [0.1, 0.08, 0.075].map(|x| x * unit);
                block(mesh, hang(0.235), size, CARDBOARD);
            }
        }
    }

    /// A ring of radius `reach_m` [m] on three spokes about each propeller.
    fn guards(&self, mesh: &mut MeshData, reach_m: f64) {
        const CORNERS: usize = 14;
        let unit = self.unit;
        let paint = Paint::plain(self.coat.gear);
        for hub in self.hubs_body_m {
            let (plan, z) = (hub.truncate(), hub.z);
            let at = |k: usize| {
                let out = DVec2::from_angle(TAU * k as f64 / CORNERS as f64);
                (plan + out * reach_m).extend(z)
            };
            for k in 0..CORNERS {
                mesh.frustum((at(k), 0.004 * unit), (at(k + 1), 0.004 * unit), 4, paint);
                if k % 5 == 0 {
                    let below = plan.extend(z - 0.02 * unit);
                    mesh.frustum((below, 0.0035 * unit), (at(k), 0.0035 * unit), 4, paint);
                }
            }
        }
    }

    /// A point on the back of the hull, `y` units to the left [m, body].
    fn back(&self, y: f64) -> DVec3 {
        DVec3::new(
            -0.05 * self.unit,
            y * self.unit,
            self.roof - 0.012 * self.unit,
        )
    }

    /// A positioning receiver on a mast.
    fn mast(&self, mesh: &mut MeshData) {
        let unit = self.unit;
        let tip = self.back(0.0) + DVec3::Z * 0.085 * unit;
        tube(
            mesh,
            self.back(0.0),
            tip,
            0.003 * unit,
            Paint::plain(CARBON),
        );
        mesh.frustum(
            (tip, 0.028 * unit),
            (tip + DVec3::Z * 0.01 * unit, 0.02 * unit),
            10,
            Paint::plain(self.coat.shell),
        );
    }

    /// Two rod antennas that stick out at the back.
    fn antennas(&self, mesh: &mut MeshData) {
        let unit = self.unit;
        for y in [-0.025, 0.025] {
            let tip = self.back(y) + DVec3::new(-0.05, y, 0.06) * unit;
            tube(mesh, self.back(y), tip, 0.0025 * unit, Paint::plain(BLACK));
        }
    }
}
