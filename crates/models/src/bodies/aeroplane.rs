//! Aeroplanes: an airliner, also with its contrail, a turboprop and a light aircraft.

use std::f64::consts::{FRAC_PI_2, TAU};

use glam::{DQuat, DVec3};

use super::parts::{block, hull_forward, propeller, section, tube};
use super::style::{BLACK, DARK, SILVER, WHITE};
use super::{RotorMount, UavMesh};
use crate::shape::mesh::{MeshData, Paint};

/// An end of a wing or fin: the middle of its leading edge, and its chord.
struct WingEnd {
    /// Over the aeroplane's length, forward.
    x: f64,
    /// To the side [m].
    side_m: f64,
    /// Up [m].
    z_m: f64,
    /// Over the aeroplane's length.
    chord: f64,
}

/// Root and tip of a wing or fin, each (x, side, z, chord) as in [`WingEnd`].
fn ends(root: [f64; 4], tip: [f64; 4]) -> [WingEnd; 2] {
    [root, tip].map(|[x, side_m, z_m, chord]| WingEnd {
        x,
        side_m,
        z_m,
        chord,
    })
}

/// An aeroplane while it is being built.
struct Builder {
    mesh: MeshData,
    length_m: f64,
}

impl Builder {
    /// A point beside the middle plane, on the side `y`, -1 or 1 [m, body].
    fn at(&self, x: f64, y: f64, side_m: f64, z_m: f64) -> DVec3 {
        DVec3::new(x * self.length_m, y * side_m, z_m)
    }

    /// A wing or fin of thin elliptic sections on the side `y`, its thickness along `up` and over the
    /// chord.
    fn wing(&mut self, y: f64, ends: [WingEnd; 2], thickness: f64, up: DVec3, paint: Paint) {
        let ends = ends.map(|end| {
            let lead = self.at(end.x, y, end.side_m, end.z_m);
            (lead, end.chord * self.length_m)
        });
        let ring = |(lead, chord): (DVec3, f64)| {
            let half = DVec3::X * chord / 2.0;
            section(lead - half, half, up * thickness * chord / 2.0, 2.0, 8)
        };
        // Rings run counter-clockwise about the direction from root to tip.
        let along = ends[1].0 - ends[0].0;
        let mut rings = ends.map(ring);
        if DVec3::X.cross(up).dot(along) < 0.0 {
            for ring in &mut rings {
                ring.reverse();
            }
        }
        self.mesh.loft(&rings, paint);
    }
}

/// A twin-jet airliner of length, span and height `size_m` [m], centred on its box's plan.
pub(super) fn airliner(size_m: [f64; 3], shell: [f32; 3], tail: [f32; 3]) -> MeshData {
    let [l, span, h] = size_m;
    let mut plane = Builder {
        mesh: MeshData::new(DVec3::ZERO),
        length_m: l,
    };
    let r = 0.053 * l;
    let (fin, silver) = (Paint::plain(tail), Paint::plain(SILVER));
    #[rustfmt::skip]
    hull_forward(&mut plane.mesh, &[
        [-0.5 * l, 0.1 * r, 0.15 * r, 0.55 * r], [-0.4 * l, 0.55 * r, 0.6 * r, 0.35 * r],
        [-0.2 * l, r, r, 0.0], [0.38 * l, r, r, 0.0], [0.45 * l, 0.75 * r, 0.75 * r, -0.1 * r],
        [0.5 * l, 0.12 * r, 0.12 * r, -0.25 * r],
    ], 2.0, Paint::plain(shell));
    for y in [-1.0, 1.0] {
        let tip_z = 0.035 * span - 0.5 * r;
        let main = ends(
            [0.12, 0.0, -0.5 * r, 0.2],
            [-0.12, span / 2.0, tip_z, 0.045],
        );
        plane.wing(y, main, 0.11, DVec3::Z, silver);
        let tailplane = ends(
            [-0.39, 0.0, 0.4 * r, 0.1],
            [-0.46, 0.17 * span, 0.6 * r, 0.035],
        );
        plane.wing(y, tailplane, 0.1, DVec3::Z, silver);
        let engine = plane.at(0.075, y, 0.16 * span, -1.15 * r);
        plane.mesh.frustum(
            (engine - DVec3::X * 0.1 * l, 0.38 * r),
            (engine, 0.55 * r),
            12,
            fin,
        );
    }
    let top = h - 2.2 * r;
    let fin_ends = ends([-0.35, 0.0, 0.5 * r, 0.15], [-0.455, 0.0, top, 0.045]);
    plane.wing(1.0, fin_ends, 0.1, DVec3::Y, fin);
    plane.mesh
}

/// An airliner as [`airliner`], and behind each engine a trail that grows as it is left behind, and ends in a point
/// `trail_m` behind the middle [m].
pub(super) fn contrail(
    size_m: [f64; 3],
    trail_m: f64,
    shell: [f32; 3],
    tail: [f32; 3],
) -> MeshData {
    let [l, span, _] = size_m;
    let mut mesh = airliner(size_m, shell, tail);
    for y in [-1.0, 1.0] {
        // Vapour freezes some lengths behind the engine.
        let along = [1.0 * l, 0.3 * trail_m, trail_m];
        let radii_m = [0.02 * l, 0.06 * l, 0.0];
        let at = |x_m: f64| DVec3::new(-x_m, y * 0.16 * span, -0.06 * l);
        for k in [1, 0] {
            mesh.frustum(
                (at(along[k + 1]), radii_m[k + 1]),
                (at(along[k]), radii_m[k]),
                10,
                Paint::plain(WHITE),
            );
        }
    }
    mesh
}

/// A regional airliner of length, span and height `size_m` [m] and its two propellers.
pub(super) fn turboprop(size_m: [f64; 3], shell: [f32; 3], tail: [f32; 3]) -> UavMesh {
    let [l, span, h] = size_m;
    let mut plane = Builder {
        mesh: MeshData::new(DVec3::ZERO),
        length_m: l,
    };
    let r = 0.051 * l;
    let (white, fin) = (Paint::plain(shell), Paint::plain(tail));
    #[rustfmt::skip]
    hull_forward(&mut plane.mesh, &[
        [-0.5 * l, 0.1 * r, 0.15 * r, 0.55 * r], [-0.33 * l, 0.6 * r, 0.65 * r, 0.3 * r],
        [-0.12 * l, r, r, 0.0], [0.36 * l, r, r, 0.0], [0.44 * l, 0.78 * r, 0.75 * r, -0.12 * r],
        [0.5 * l, 0.12 * r, 0.12 * r, -0.3 * r],
    ], 2.0, white);
    let top = h - r;
    let mut rotors = Vec::new();
    for y in [-1.0, 1.0] {
        let main = ends([0.1, 0.0, r, 0.1], [0.07, span / 2.0, 1.05 * r, 0.06]);
        plane.wing(y, main, 0.14, DVec3::Z, white);
        let tailplane = ends([-0.42, 0.0, top, 0.08], [-0.44, 0.135 * span, top, 0.05]);
        plane.wing(y, tailplane, 0.1, DVec3::Z, fin);
        let nacelle = [-0.02, 0.16].map(|x| plane.at(x, y, 0.15 * span, 0.7 * r));
        plane
            .mesh
            .frustum((nacelle[0], 0.3 * r), (nacelle[1], 0.38 * r), 12, white);
        rotors.push(RotorMount {
            hub_body_m: nacelle[1] + DVec3::X * 0.01 * l,
            // Its axis points forward.
            q_body_hub: DQuat::from_rotation_y(FRAC_PI_2),
            sweep_rad: [0.0, TAU],
            clockwise: false,
            blade: 0,
            parent: None,
        });
    }
    let fin_ends = ends([-0.33, 0.0, 0.5 * r, 0.17], [-0.41, 0.0, top, 0.09]);
    plane.wing(1.0, fin_ends, 0.1, DVec3::Y, fin);
    UavMesh {
        body: plane.mesh,
        rotors,
        blades: vec![propeller(0.0725 * l, 6, DARK)],
    }
}

/// How a light aircraft differs from others.
#[derive(Clone, Copy, Debug)]
pub(super) struct LightAircraft {
    /// Length, span and height [m].
    pub size_m: [f64; 3],
    /// Whether the wing lies below the cabin.
    pub low_wing: bool,
    pub shell: [f32; 3],
    pub tail: [f32; 3],
}

/// A single with fixed gear, and its propeller.
pub(super) fn light_aircraft(style: &LightAircraft) -> UavMesh {
    let [l, span, h] = style.size_m;
    let mut plane = Builder {
        mesh: MeshData::new(DVec3::ZERO),
        length_m: l,
    };
    let (white, trim) = (Paint::plain(style.shell), Paint::plain(style.tail));
    #[rustfmt::skip]
    hull_forward(&mut plane.mesh, &[
        [-0.47 * l, 0.008 * l, 0.02 * l, 0.02 * l], [-0.2 * l, 0.04 * l, 0.05 * l, 0.01 * l],
        [0.02 * l, 0.065 * l, 0.085 * l, 0.02 * l], [0.22 * l, 0.065 * l, 0.08 * l, 0.015 * l],
        [0.3 * l, 0.06 * l, 0.055 * l, -0.015 * l], [0.46 * l, 0.045 * l, 0.045 * l, -0.02 * l],
    ], 2.8, white);
    let (roof, belly) = (0.1 * l, -0.065 * l);
    let (root, rise) = if style.low_wing {
        (belly + 0.02 * l, 0.05 * span)
    } else {
        (roof, 0.015 * span)
    };
    for y in [-1.0, 1.0] {
        let main = ends(
            [0.23, 0.0, root, 0.19],
            [0.2, span / 2.0, root + rise, 0.14],
        );
        plane.wing(y, main, 0.12, DVec3::Z, white);
        let tailplane = ends(
            [-0.34, 0.0, 0.02 * l, 0.13],
            [-0.37, 0.16 * span, 0.02 * l, 0.09],
        );
        plane.wing(y, tailplane, 0.1, DVec3::Z, trim);
        if !style.low_wing {
            let strut = [
                plane.at(0.12, y, 0.06 * l, belly),
                plane.at(0.13, y, 0.26 * span, roof),
            ];
            tube(&mut plane.mesh, strut[0], strut[1], 0.006 * l, white);
        }
        let hip = plane.at(0.09, y, 0.05 * l, belly);
        let wheel = plane.at(0.09, y, 0.15 * l, 0.02 * l - 0.62 * h);
        tube(&mut plane.mesh, hip, wheel, 0.007 * l, white);
        let size = [0.07 * l, 0.02 * l, 0.05 * l];
        block(&mut plane.mesh, wheel, size, BLACK);
    }
    let mesh = &mut plane.mesh;
    let nose = DVec3::new(0.36 * l, 0.0, -0.05 * l);
    let wheel = nose - DVec3::Z * 0.12 * l;
    tube(mesh, nose, wheel, 0.006 * l, white);
    block(mesh, wheel, [0.06 * l, 0.02 * l, 0.05 * l], BLACK);
    let hub = DVec3::new(0.48 * l, 0.0, -0.02 * l);
    block(mesh, hub, [0.04 * l, 0.03 * l, 0.03 * l], style.tail);
    let tip_z = 0.4 * h + 0.02 * l;
    let fin = ends([-0.3, 0.0, 0.03 * l, 0.16], [-0.42, 0.0, tip_z, 0.08]);
    plane.wing(1.0, fin, 0.1, DVec3::Y, trim);
    UavMesh {
        body: plane.mesh,
        rotors: vec![RotorMount {
            hub_body_m: hub,
            // Its axis points forward.
            q_body_hub: DQuat::from_rotation_y(FRAC_PI_2),
            sweep_rad: [0.0, TAU],
            clockwise: false,
            blade: 0,
            parent: None,
        }],
        blades: vec![propeller(0.115 * l, 2, DARK)],
    }
}
