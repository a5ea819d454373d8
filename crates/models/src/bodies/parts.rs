//! The pieces that airframes and distractors are made of.

use std::f64::consts::TAU;

use glam::{DAffine3, DVec2, DVec3};

use super::style::{BLACK, GREY, LENS};
use crate::shape::mesh::{MeshData, Paint};

/// Points of a superellipse with semi-axes along `a` and `b`, counter-clockwise seen against a × b.
pub(super) fn section(
    center: DVec3,
    a: DVec3,
    b: DVec3,
    exponent: f64,
    sides: usize,
) -> Vec<DVec3> {
    let power = |x: f64| x.signum() * x.abs().powf(2.0 / exponent);
    (0..sides)
        .map(|k| {
            let (sin, cos) = (TAU * (k as f64 + 0.5) / sides as f64).sin_cos();
            center + a * power(cos) + b * power(sin)
        })
        .collect()
}

/// A rounded hull stacked upward: (z, half length, half width) per section.
pub(super) fn hull_up(
    mesh: &mut MeshData,
    at: DVec2,
    sections: &[[f64; 3]],
    exponent: f64,
    paint: Paint,
) {
    let rings: Vec<Vec<DVec3>> = sections
        .iter()
        .map(|&[z, x, y]| section(at.extend(z), DVec3::X * x, DVec3::Y * y, exponent, 16))
        .collect();
    mesh.loft(&rings, paint);
}

/// A rounded hull lofted forward: (x, half width, half height, centre height) per section.
pub(super) fn hull_forward(
    mesh: &mut MeshData,
    sections: &[[f64; 4]],
    exponent: f64,
    paint: Paint,
) {
    let rings: Vec<Vec<DVec3>> = sections
        .iter()
        .map(|&[x, y, h, z]| {
            section(
                DVec3::new(x, 0.0, z),
                DVec3::Y * y,
                DVec3::Z * h,
                exponent,
                16,
            )
        })
        .collect();
    mesh.loft(&rings, paint);
}

/// An arm of elliptic section that tapers; `size` is (half width, half height) at each end.
pub(super) fn arm(mesh: &mut MeshData, from: DVec3, to: DVec3, size: [[f64; 2]; 2], paint: Paint) {
    let along = (to - from).normalize_or(DVec3::X);
    let side = DVec3::Z.cross(along).normalize_or(DVec3::Y);
    let up = along.cross(side);
    let ring = |at: DVec3, [w, h]: [f64; 2]| section(at, side * w, up * h, 2.6, 8);
    mesh.loft(&[ring(from, size[0]), ring(to, size[1])], paint);
}

/// A straight round tube.
pub(super) fn tube(mesh: &mut MeshData, from: DVec3, to: DVec3, radius: f64, paint: Paint) {
    mesh.frustum((from, radius), (to, radius), 6, paint);
}

/// A motor bell on an arm's end.
pub(super) fn motor(
    mesh: &mut MeshData,
    at: DVec2,
    [low, top]: [f64; 2],
    radius: f64,
    albedo: [f32; 3],
) {
    let split = low + 0.45 * (top - low);
    mesh.frustum(
        (at.extend(low), radius),
        (at.extend(split), radius),
        12,
        Paint::plain(albedo),
    );
    mesh.frustum(
        (at.extend(split), radius * 0.93),
        (at.extend(top), radius * 0.8),
        12,
        Paint::plain(GREY),
    );
}

/// A box by its centre and full size.
pub(super) fn block(mesh: &mut MeshData, center: DVec3, size: [f64; 3], albedo: [f32; 3]) {
    let half = DVec3::from(size) / 2.0;
    mesh.cuboid(center - half, center + half, Paint::plain(albedo));
}

/// A gimbal camera looking forward: yoke, ball and lens.
pub(super) fn camera(mesh: &mut MeshData, at: DVec3, radius: f64, albedo: [f32; 3]) {
    let side = DVec3::Y * radius * 1.15;
    let top = DVec3::Z * radius * 1.5;
    tube(
        mesh,
        at + side,
        at + side + top,
        radius * 0.22,
        Paint::plain(GREY),
    );
    tube(
        mesh,
        at + side + top,
        at - side + top,
        radius * 0.25,
        Paint::plain(GREY),
    );
    mesh.icosphere(
        at,
        DVec3::new(1.0, 1.05, 0.95) * radius,
        1,
        Paint::plain(albedo),
    );
    let lens = at + DVec3::X * radius * 0.6;
    mesh.frustum(
        (lens, radius * 0.62),
        (lens + DVec3::X * radius * 0.55, radius * 0.55),
        10,
        Paint::plain(LENS),
    );
}

/// Slivers of a blade: as many places at which it is seen during an exposure. Sixteen took a fifth more of
/// a run's time than sharp blades, these 3 %.
const SLIVERS: u32 = 8;

/// Blades about z, the first along x: centre, half chord and normal of each section from root to tip.
///
/// Along its chord a blade is cut into slivers, which [`super::sliver_turn_rad`] spreads over what it sweeps
/// during an exposure: the texture coordinates are a sliver's place on the half chord, from -1 to 1, and the
/// angle of the half chord about the hub [rad]; the surface's variant is the angle from blade to blade [rad],
/// beyond which nothing is smeared. Slivers have no thickness: apart, each would show its own.
pub(super) fn spun(sections: &[[DVec3; 3]], blades: u32, paint: Paint) -> MeshData {
    let mut blade = MeshData::new(DVec3::ZERO);
    let spacing_rad = TAU / f64::from(blades.max(1));
    let paint = Paint {
        variant: spacing_rad as f32,
        ..paint
    };
    let edge = |k: u32| 2.0 * f64::from(k) / f64::from(SLIVERS) - 1.0;
    for (sliver, side) in (0..SLIVERS).flat_map(|k| [(k, 1.0), (k, -1.0)]) {
        let edges = [sliver, sliver + 1].map(edge);
        let share = 0.5 * (edges[0] + edges[1]);
        let first = blade.positions.len() as u32;
        for &[centre, half_chord, normal] in sections {
            let [radius_m, half_m] = [centre, half_chord].map(|v| v.truncate().length());
            let uv = [share as f32, half_m.atan2(radius_m) as f32];
            for edge in edges {
                let at = centre + edge * half_chord;
                blade.vertex(at, side * normal, uv, 1.0, paint);
            }
        }
        for k in 1..sections.len() as u32 {
            let [a, b, d, c] = [0, 1, 2, 3].map(|i| first + 2 * (k - 1) + i);
            for [p, q, r] in [[a, d, c], [a, c, b]] {
                let facing = if side > 0.0 { [p, q, r] } else { [p, r, q] };
                blade.indices.extend(facing);
            }
        }
    }
    let mut rotor = MeshData::new(DVec3::ZERO);
    for k in 0..blades {
        let turn_rad = spacing_rad * f64::from(k);
        rotor.append(&blade, DAffine3::from_rotation_z(turn_rad));
    }
    rotor
}

/// A propeller: twisted thin blades of constant pitch, 0.5 of the diameter.
pub(super) fn propeller(radius: f64, blades: u32, albedo: [f32; 3]) -> MeshData {
    let pitch_m = 0.5 * 2.0 * radius;
    let sections = [(0.08, 0.05), (0.3, 0.12), (0.9, 0.075), (1.0, 0.02)].map(|(r, chord)| {
        let beta = (pitch_m / (TAU * r * radius)).atan().min(0.6);
        // Turning from x to y, the leading edge is the one at +y, and it is the higher one.
        let along = DVec3::new(0.0, beta.cos(), beta.sin());
        let up = DVec3::X.cross(along);
        [DVec3::X * r * radius, along * chord * radius, up]
    });
    let mut rotor = spun(&sections, blades, Paint::plain(albedo));
    let (low, high) = (DVec3::Z * -0.03 * radius, DVec3::Z * 0.05 * radius);
    rotor.frustum(
        (low, 0.09 * radius),
        (high, 0.06 * radius),
        8,
        Paint::plain(GREY),
    );
    rotor
}

/// Measures of a skid [m].
#[derive(Clone, Copy)]
pub(super) struct Skid {
    /// Radii of strut, rail and pads.
    pub radii_m: [f64; 3],
    /// Half length of the rail.
    pub half_m: f64,
    /// Where the pads' middles lie, before and behind the rail's.
    pub pad_at_m: f64,
    /// Half length of the pads.
    pub pad_half_m: f64,
}

/// A strut from hip to knee and a rail along x with two soft pads.
pub(super) fn skid(mesh: &mut MeshData, [hip, knee]: [DVec3; 2], size: Skid, paint: Paint) {
    let [strut_m, rail_m, pad_radius_m] = size.radii_m;
    let Skid {
        half_m,
        pad_at_m,
        pad_half_m,
        ..
    } = size;
    tube(mesh, hip, knee, strut_m, paint);
    let x = DVec3::X;
    tube(mesh, knee - x * half_m, knee + x * half_m, rail_m, paint);
    for at in [-pad_at_m, pad_at_m] {
        let (from, to) = (knee + x * (at - pad_half_m), knee + x * (at + pad_half_m));
        tube(mesh, from, to, pad_radius_m, Paint::plain(BLACK));
    }
}
