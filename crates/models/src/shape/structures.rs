//! Structures that stand against the sky where a UAV might be looked for: cranes, masts, antennas,
//! lamp posts, flags, pylons, mastheads, bare trees, treelines. Each is drawn about its foot, z up; sizes are assumptions, typical of the
//! kind.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};

use crate::maths::rng::Stream;
use crate::shape::mesh::{MeshData, Paint, Surface};

/// Kind of static structure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StructureKind {
    /// A tower crane with jib, trolley, line and hook, 25 to 70 m high.
    Crane,
    /// A lattice mast with dishes, panels and lamps, 25 to 60 m high.
    Mast,
    /// A roof antenna with cross bars, a dish or whips, 2 to 6 m high.
    Antenna,
    /// A street lamp, 6 to 12 m high.
    LampPost,
    /// A flag on its pole, 6 to 14 m high.
    Flag,
    /// A power pylon with stubs of its lines, 20 to 45 m high.
    Pylon,
    /// A thin pole, as of a boat or a weather station, whose head carries lamps, cups and domes, 6 to
    /// 20 m high.
    Masthead,
    /// A tree without leaves, 5 to 25 m high.
    BareTree,
    /// A line of trees with gaps, 40 to 80 m long and up to 27 m high.
    Treeline,
}

impl StructureKind {
    /// Every kind.
    pub const ALL: [Self; 9] = [
        Self::Crane,
        Self::Mast,
        Self::Antenna,
        Self::LampPost,
        Self::Flag,
        Self::Pylon,
        Self::Masthead,
        Self::BareTree,
        Self::Treeline,
    ];
}

const STEEL: [f32; 3] = [0.28, 0.28, 0.29];
const DARK: [f32; 3] = [0.05, 0.05, 0.055];
const WHITE: [f32; 3] = [0.7, 0.7, 0.68];
const YELLOW: [f32; 3] = [0.62, 0.38, 0.03];
const RED: [f32; 3] = [0.5, 0.04, 0.03];
const BLUE: [f32; 3] = [0.03, 0.08, 0.35];
const GREEN: [f32; 3] = [0.04, 0.25, 0.07];
const BARK: [f32; 3] = [0.09, 0.068, 0.05];

/// A structure of drawn size and colour about its foot [m], z up; its long side lies in a drawn
/// direction.
pub fn structure_mesh(kind: StructureKind, rng: &mut Stream) -> MeshData {
    let mut mesh = MeshData::new(DVec3::ZERO);
    let turn = DVec2::from_angle(rng.range(0.0, TAU));
    match kind {
        StructureKind::Crane => crane(&mut mesh, turn, rng),
        StructureKind::Mast => mast(&mut mesh, rng),
        StructureKind::Antenna => antenna(&mut mesh, turn, rng),
        StructureKind::LampPost => lamp_post(&mut mesh, turn, rng),
        StructureKind::Flag => flag(&mut mesh, turn, rng),
        StructureKind::Pylon => pylon(&mut mesh, turn, rng),
        StructureKind::Masthead => masthead(&mut mesh, turn, rng),
        StructureKind::BareTree => bare_tree(&mut mesh, DVec3::ZERO, rng.range(7.0, 20.0), 4, rng),
        StructureKind::Treeline => treeline(&mut mesh, turn, rng),
    }
    mesh
}

fn bar(mesh: &mut MeshData, from: DVec3, to: DVec3, radius_m: f64, albedo: [f32; 3]) {
    mesh.frustum((from, radius_m), (to, radius_m), 4, Paint::plain(albedo));
}

/// A lattice girder: chords from one end's corners to the other's, one diagonal a bay and side.
fn lattice(
    mesh: &mut MeshData,
    ends: [&[DVec3]; 2],
    bays: usize,
    [chord_m, brace_m]: [f64; 2],
    albedo: impl Fn(usize) -> [f32; 3],
) {
    let n = ends[0].len();
    let at = |corner: usize, k: usize| {
        ends[0][corner % n].lerp(ends[1][corner % n], k as f64 / bays as f64)
    };
    for k in 0..bays {
        for corner in 0..n {
            bar(mesh, at(corner, k), at(corner, k + 1), chord_m, albedo(k));
            let (low, high) = (at(corner + k % 2, k), at(corner + 1 - k % 2, k + 1));
            bar(mesh, low, high, brace_m, albedo(k));
        }
    }
}

/// Corners of a square of side `side_m` about a point, its first side across `axis`.
fn square(center: DVec3, axis: DVec2, side_m: f64) -> [DVec3; 4] {
    [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)]
        .map(|(x, y)| center + ((axis * x + axis.perp() * y) * side_m / 2.0).extend(0.0))
}

fn crane(mesh: &mut MeshData, turn: DVec2, rng: &mut Stream) {
    let height = rng.range(25.0, 70.0);
    let reach = rng.range(30.0, 60.0);
    let back = 0.3 * reach;
    let colour = rng.pick(&[YELLOW, YELLOW, RED, WHITE, STEEL, BLUE]);
    let side = 1.7; // [m]
    let (foot, top) = (DVec3::ZERO, DVec3::Z * height);
    lattice(
        mesh,
        [&square(foot, turn, side), &square(top, turn, side)],
        (height / 2.4) as usize,
        [0.09, 0.045],
        |_| colour,
    );
    let along = turn.extend(0.0);
    let across = turn.perp().extend(0.0);
    let deck = top + DVec3::Z * 0.6;
    // A jib of triangular section, two chords below and one above.
    let triangle = |at: f64, half: f64, rise: f64| {
        let p = deck + along * at;
        [p + across * half, p - across * half, p + DVec3::Z * rise]
    };
    lattice(
        mesh,
        [&triangle(0.8, 0.65, 1.2), &triangle(reach, 0.5, 0.7)],
        (reach / 2.2) as usize,
        [0.075, 0.035],
        |_| colour,
    );
    lattice(
        mesh,
        [&triangle(-0.8, 0.65, 0.8), &triangle(-back, 0.65, 0.8)],
        (back / 2.6) as usize,
        [0.075, 0.035],
        |_| colour,
    );
    let apex = deck + DVec3::Z * rng.range(4.0, 7.0);
    lattice(
        mesh,
        [&square(deck, turn, 1.4), &square(apex, turn, 0.3)],
        3,
        [0.08, 0.04],
        |_| colour,
    );
    for tie in [0.45 * reach, 0.85 * reach, -0.9 * back] {
        bar(
            mesh,
            apex,
            deck + along * tie + DVec3::Z * 0.8,
            0.035,
            STEEL,
        );
    }
    let ballast = deck - along * (back - 1.5) - DVec3::Z * 1.4;
    let half = DVec3::new(1.2, 1.2, 1.5);
    mesh.cuboid(
        ballast - half,
        ballast + half,
        Paint::plain([0.3, 0.29, 0.28]),
    );
    let cab = deck + across * 1.5 - DVec3::Z * 1.2;
    let half = DVec3::new(0.9, 0.9, 1.1);
    mesh.cuboid(cab - half, cab + half, Paint::plain(WHITE));
    // Trolley, two falls of the line, hook block.
    let trolley = deck + along * reach * rng.range(0.2, 0.95) - DVec3::Z * 0.3;
    let half = DVec3::new(0.7, 0.7, 0.2);
    mesh.cuboid(trolley - half, trolley + half, Paint::plain(DARK));
    let hook = trolley - DVec3::Z * height * rng.range(0.08, 0.7);
    for side in [-0.3, 0.3] {
        bar(
            mesh,
            trolley + across * side,
            hook + across * 0.3 * side,
            0.022,
            DARK,
        );
    }
    let half = DVec3::new(0.3, 0.3, 0.55);
    mesh.cuboid(hook - half, hook + half, Paint::plain(YELLOW));
}

fn mast(mesh: &mut MeshData, rng: &mut Stream) {
    let height = rng.range(25.0, 60.0);
    let striped = rng.uniform() < 0.5;
    let wide = rng.range(0.8, 3.5);
    let top = DVec3::Z * height;
    let bays = (height / 2.5) as usize;
    lattice(
        mesh,
        [
            &square(DVec3::ZERO, DVec2::X, wide),
            &square(top, DVec2::X, 0.6),
        ],
        bays,
        [0.08, 0.04],
        |k| match (striped, k * 7 / bays % 2) {
            (false, _) => STEEL,
            (true, 0) => RED,
            (true, _) => WHITE,
        },
    );
    for _ in 0..(2.0 + 5.0 * rng.uniform()) as usize {
        let out = DVec2::from_angle(rng.range(0.0, TAU)).extend(0.0);
        let at = DVec3::Z * height * rng.range(0.55, 0.97) + out * 0.7;
        if rng.uniform() < 0.5 {
            let radius = rng.range(0.3, 0.9);
            mesh.frustum(
                (at, radius),
                (at + out * 0.35, radius),
                12,
                Paint::plain(WHITE),
            );
        } else {
            bar(mesh, at - DVec3::Z, at + DVec3::Z, 0.16, WHITE);
        }
    }
    bar(mesh, top, top + DVec3::Z * rng.range(2.0, 6.0), 0.04, STEEL);
    mesh.icosphere(
        top + DVec3::Z * 0.3,
        DVec3::splat(0.2),
        0,
        Paint::plain(RED),
    );
}

fn antenna(mesh: &mut MeshData, turn: DVec2, rng: &mut Stream) {
    let height = rng.range(2.0, 6.0);
    let tone = rng.pick(&[STEEL, DARK, WHITE]);
    let top = DVec3::Z * height;
    bar(mesh, DVec3::ZERO, top, 0.03, tone);
    let (along, across) = (turn.extend(0.0), turn.perp().extend(0.0));
    match rng.uniform() {
        u if u < 0.5 => {
            // A boom with cross bars that grow shorter.
            let boom = top - DVec3::Z * 0.1;
            bar(mesh, boom - along * 0.7, boom + along * 0.9, 0.015, tone);
            for k in 0..9 {
                let at = boom + along * (0.18 * f64::from(k) - 0.6);
                let half = 0.45 - 0.03 * f64::from(k);
                bar(mesh, at - across * half, at + across * half, 0.009, tone);
            }
        }
        u if u < 0.75 => {
            let dish = top - DVec3::Z * 0.2;
            let radius = rng.range(0.3, 0.6);
            mesh.frustum(
                (dish, 0.3 * radius),
                (dish + along * 0.18, radius),
                14,
                Paint::plain(WHITE),
            );
            let feed = dish + along * 0.6;
            bar(mesh, dish, feed, 0.012, tone);
        }
        _ => {
            for k in 0..3 {
                let at = top + across * 0.4 * f64::from(k - 1) - DVec3::Z * 0.4;
                bar(mesh, at, at + DVec3::Z * rng.range(0.8, 2.2), 0.012, tone);
            }
            let arm = top - DVec3::Z * 0.4;
            bar(mesh, arm - across * 0.45, arm + across * 0.45, 0.02, tone);
        }
    }
}

fn lamp_post(mesh: &mut MeshData, turn: DVec2, rng: &mut Stream) {
    let height = rng.range(6.0, 12.0);
    let tone = rng.pick(&[STEEL, STEEL, DARK, GREEN]);
    let top = DVec3::Z * height;
    let paint = Paint::plain(tone);
    mesh.frustum((DVec3::ZERO, 0.11), (top, 0.055), 6, paint);
    let sides: &[f64] = if rng.uniform() < 0.7 {
        &[1.0]
    } else {
        &[1.0, -1.0]
    };
    let reach = rng.range(0.6, 2.2);
    for side in sides {
        let out = turn.extend(0.0) * *side;
        let end = top + out * reach + DVec3::Z * 0.35;
        bar(mesh, top, end, 0.035, tone);
        mesh.frustum(
            (end, 0.1),
            (end + out * 0.7 - DVec3::Z * 0.04, 0.06),
            6,
            paint,
        );
    }
}

fn flag(mesh: &mut MeshData, turn: DVec2, rng: &mut Stream) {
    let height = rng.range(6.0, 14.0);
    let top = DVec3::Z * height;
    mesh.frustum((DVec3::ZERO, 0.06), (top, 0.03), 6, Paint::plain(WHITE));
    let (wide, tall) = (rng.range(1.2, 2.6), rng.range(0.8, 1.5));
    // From slack along the pole to stretched, in waves; both sides are seen.
    let droop = rng.range(0.1, 1.2);
    let phase = rng.range(0.0, TAU);
    let stripes = [
        rng.pick(&[RED, BLUE, GREEN]),
        rng.pick(&[WHITE, YELLOW, RED]),
    ];
    const PIECES: usize = 8;
    let at = |k: usize, drop: f64| {
        let s = k as f64 / PIECES as f64;
        let wave = 0.12 * wide * s * (1.5 * TAU * s + phase).sin();
        let out = turn * (wide * s * droop.cos()) + turn.perp() * wave;
        out.extend(height - 0.1 - drop * tall - wide * s * droop.sin())
    };
    for k in 0..PIECES {
        for (band, drops) in [
            (0, [0.0, 1.0 / 3.0]),
            (1, [1.0 / 3.0, 2.0 / 3.0]),
            (0, [2.0 / 3.0, 1.0]),
        ] {
            let [high, low] = drops;
            let quad = [at(k, low), at(k + 1, low), at(k + 1, high), at(k, high)];
            let paint = Paint::plain(stripes[band]);
            for t in [[0, 1, 2], [0, 2, 3]] {
                let [a, b, c] = t.map(|i: usize| quad[i]);
                mesh.face(&[a, b, c], paint);
                mesh.face(&[a, c, b], paint);
            }
        }
    }
}

fn pylon(mesh: &mut MeshData, turn: DVec2, rng: &mut Stream) {
    let height = rng.range(20.0, 45.0);
    let waist = DVec3::Z * 0.6 * height;
    let top = DVec3::Z * height;
    let base = 0.16 * height;
    let steel = |_| STEEL;
    let (foot, neck) = (
        square(DVec3::ZERO, turn, base),
        square(waist, turn, 0.28 * base),
    );
    lattice(mesh, [&foot, &neck], 6, [0.09, 0.05], steel);
    lattice(
        mesh,
        [&neck, &square(top, turn, 0.05 * base)],
        6,
        [0.07, 0.04],
        steel,
    );
    let (along, across) = (turn.extend(0.0), turn.perp().extend(0.0));
    for (share, half) in [(0.62, 0.17), (0.74, 0.21), (0.86, 0.15)] {
        for side in [-1.0, 1.0] {
            let root = DVec3::Z * share * height;
            let end = root + across * side * half * height;
            bar(mesh, root, end, 0.06, STEEL);
            bar(mesh, root + DVec3::Z * 0.05 * height, end, 0.06, STEEL);
            let clamp = end - DVec3::Z * 0.04 * height;
            bar(mesh, end, clamp, 0.06, DARK);
            // The lines sag away on both sides, over half a span.
            for way in [-1.0, 1.0] {
                let at = |k: i32| {
                    let s = f64::from(k) / 6.0;
                    clamp + along * way * 120.0 * s - DVec3::Z * 0.16 * height * s * (2.0 - s)
                };
                for k in 0..6 {
                    let line = Paint::plain(DARK);
                    mesh.frustum((at(k), 0.02), (at(k + 1), 0.02), 3, line);
                }
            }
        }
    }
}

fn masthead(mesh: &mut MeshData, turn: DVec2, rng: &mut Stream) {
    let height = rng.range(6.0, 18.0);
    let tone = rng.pick(&[STEEL, DARK, WHITE]);
    let top = DVec3::Z * height;
    mesh.frustum((DVec3::ZERO, 0.07), (top, 0.035), 6, Paint::plain(tone));
    let across = turn.extend(0.0);
    for _ in 0..1 + (2.0 * rng.uniform()) as u32 {
        // A cross-tree with something on each end, as a UAV has its rotors.
        let at = top - DVec3::Z * rng.range(0.0, 0.15) * height;
        let half = rng.range(0.25, 0.9);
        bar(mesh, at - across * half, at + across * half, 0.025, tone);
        let paint = Paint::plain(rng.pick(&[DARK, WHITE, STEEL]));
        let size = rng.range(0.06, 0.16);
        for end in [at - across * half, at + across * half] {
            let radii = DVec3::new(1.0, 1.0, rng.range(0.4, 1.6)) * size;
            mesh.icosphere(end + DVec3::Z * size, radii, 1, paint);
        }
    }
    let size = rng.range(0.1, 0.35);
    let radii = DVec3::new(size, size, size * rng.range(0.3, 1.0));
    mesh.icosphere(
        top,
        radii,
        1,
        Paint::plain(rng.pick(&[WHITE, DARK, RED, STEEL])),
    );
    bar(mesh, top, top + DVec3::Z * rng.range(0.3, 1.8), 0.012, DARK);
}

/// A trunk that forks `depth` times.
fn bare_tree(mesh: &mut MeshData, foot: DVec3, height_m: f64, depth: u32, rng: &mut Stream) {
    let lean = DVec2::from_angle(rng.range(0.0, TAU)) * rng.range(0.0, 0.08);
    let way = lean.extend(1.0).normalize();
    let length_m = 0.36 * height_m;
    branch(mesh, foot, way * length_m, 0.016 * height_m, depth, rng);
}

fn branch(
    mesh: &mut MeshData,
    foot: DVec3,
    along: DVec3,
    radius_m: f64,
    forks: u32,
    rng: &mut Stream,
) {
    let end = foot + along;
    let tip_m = 0.6 * radius_m;
    mesh.frustum((foot, radius_m), (end, tip_m), 3, Paint::plain(BARK));
    if forks == 0 {
        return;
    }
    let (side, other) = along.normalize_or(DVec3::Z).any_orthonormal_pair();
    let turn = rng.range(0.0, TAU);
    let count = 3 + (2.0 * rng.uniform()) as u32;
    for k in 0..count {
        let (sin, cos) = (turn + TAU * f64::from(k) / f64::from(count)).sin_cos();
        let out = (side * cos + other * sin) * rng.range(0.35, 0.95);
        let way = (along.normalize_or(DVec3::Z) + out + 0.25 * DVec3::Z).normalize();
        let from = foot + along * rng.range(0.65, 1.0);
        let length_m = along.length() * rng.range(0.5, 0.75);
        branch(mesh, from, way * length_m, tip_m, forks - 1, rng);
    }
}

/// Trees along a line, some of them missing.
fn treeline(mesh: &mut MeshData, turn: DVec2, rng: &mut Stream) {
    let (long_m, step_m) = (rng.range(40.0, 80.0), rng.range(6.0, 10.0));
    let (tall_m, gaps, bare) = (
        rng.range(8.0, 18.0),
        rng.range(0.1, 0.5),
        rng.uniform() < 0.3,
    );
    let slim = rng.range(0.35, 1.0);
    let count = (long_m / step_m) as i32;
    for k in 0..count {
        // The first one stands, so that a line is never empty.
        if k > 0 && rng.uniform() < gaps {
            continue;
        }
        let along_m = step_m * (f64::from(k) - 0.5 * f64::from(count) + 0.3 * rng.normal());
        let foot = (turn * along_m + turn.perp() * rng.normal()).extend(0.0);
        let height_m = tall_m * rng.range(0.7, 1.3);
        if bare {
            bare_tree(mesh, foot, 0.85 * height_m, 3, rng);
            continue;
        }
        let tint = rng.uniform() as f32;
        let leaves = Paint {
            surface: Surface::Foliage,
            ..Paint::plain([0.045 + 0.05 * tint, 0.085 + 0.04 * tint, 0.03])
        };
        let crown = foot + DVec3::Z * 0.6 * height_m;
        let trunk = 0.02 * height_m;
        mesh.frustum((foot, trunk), (crown, 0.6 * trunk), 5, Paint::plain(BARK));
        for _ in 0..3 {
            let off = DVec3::new(rng.normal(), rng.normal(), 1.2 * rng.normal());
            let radii = DVec3::new(slim, slim, 1.1) * height_m * rng.range(0.18, 0.3);
            let at = crown + off * 0.06 * height_m;
            let most_m = 1.4 * tall_m - at.z;
            let radii = radii.min(DVec3::splat(most_m.max(0.5)));
            mesh.icosphere(at, radii, 1, leaves);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn structures_stand_on_their_foot_at_their_height() {
        for (kind, [least, most]) in [
            (StructureKind::Crane, [25.0, 80.0]),
            (StructureKind::Mast, [25.0, 67.0]),
            (StructureKind::Antenna, [2.0, 9.0]),
            (StructureKind::LampPost, [6.0, 12.6]),
            (StructureKind::Flag, [6.0, 14.1]),
            (StructureKind::Pylon, [20.0, 45.1]),
            (StructureKind::Masthead, [6.0, 20.0]),
            (StructureKind::BareTree, [4.5, 26.0]),
            (StructureKind::Treeline, [5.0, 27.0]),
        ] {
            for i in 0..30 {
                let draw = || structure_mesh(kind, &mut Stream::new(9, i, "clutter"));
                let mesh = draw();
                assert_eq!(mesh.positions, draw().positions);
                let (low, high) = mesh.bounds_m().unwrap();
                assert!(
                    (-0.2..0.1).contains(&low.z),
                    "{kind:?} {i}: foot at {}",
                    low.z
                );
                assert!((least..most).contains(&high.z), "{kind:?} {i}: {}", high.z);
                let triangles = mesh.triangle_count();
                assert!((20..12_000).contains(&triangles), "{kind:?}: {triangles}");
                assert!(mesh.positions.iter().flatten().all(|x| x.is_finite()));
            }
        }
    }

    #[test]
    fn a_crane_hangs_its_hook_from_its_jib() {
        let mesh = structure_mesh(StructureKind::Crane, &mut Stream::new(1, 0, "clutter"));
        let (low, high) = mesh.bounds_m().unwrap();
        let reach = (high - low).truncate().length();
        assert!((30.0..90.0).contains(&reach), "{reach}");
    }
}
