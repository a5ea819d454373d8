//! Birds of several species: hull, and wings of an arm and a hand that are joined at the wrist.

use glam::{DAffine3, DMat3, DQuat, DVec3};

use super::parts::{hull_forward, section};
use super::style::{BLACK, DARK, GREY, ORANGE, WHITE, YELLOW};
use super::{RotorMount, UavMesh};
use crate::flight::bird::Species;
use crate::flight::distractor::DistractorKind;
use crate::maths::rng::Stream;
use crate::shape::mesh::{MeshData, Paint};

const BROWN: [f32; 3] = [0.12, 0.075, 0.045];
const BUFF: [f32; 3] = [0.33, 0.25, 0.17];
const SOOT: [f32; 3] = [0.035, 0.032, 0.03];

/// What a bird looks like.
#[derive(Clone, Copy, Debug)]
struct Plumage {
    /// Back, and upper side of the wings.
    back: [f32; 3],
    /// Head and underside of the body.
    belly: [f32; 3],
    /// Underside of the wings.
    under: [f32; 3],
    /// Wing tips from above and below.
    tips: [f32; 3],
    bill: [f32; 3],
    /// Share of the light on their upper side that the wings let through; 0: they are opaque.
    translucence: f32,
}

/// Sections of a hull over the bird's length: x, half width, half height, height of the centre.
type Hull = &'static [[f64; 4]];
/// From the shoulder to the tip, the wrist third: place along the wing, leading edge before the
/// shoulder and chord, all over the wing's length.
type Wing = [[f64; 3]; 6];

#[rustfmt::skip]
const PLUMP: Hull = &[
    [-0.50, 0.10, 0.008, 0.015], [-0.28, 0.06, 0.05, 0.0], [-0.08, 0.117, 0.108, 0.0],
    [0.15, 0.117, 0.108, 0.0], [0.28, 0.067, 0.07, 0.017], [0.37, 0.075, 0.075, 0.025],
    [0.42, 0.04, 0.04, 0.025],
];
#[rustfmt::skip]
const FAN_TAILED: Hull = &[
    [-0.50, 0.17, 0.006, 0.015], [-0.26, 0.07, 0.05, 0.0], [-0.08, 0.125, 0.115, 0.0],
    [0.18, 0.135, 0.12, 0.0], [0.32, 0.08, 0.08, 0.01], [0.40, 0.085, 0.08, 0.015],
    [0.46, 0.045, 0.045, 0.01],
];
#[rustfmt::skip]
const TORPEDO: Hull = &[
    [-0.50, 0.06, 0.008, 0.0], [-0.28, 0.05, 0.04, 0.0], [-0.02, 0.11, 0.10, 0.0],
    [0.22, 0.12, 0.11, 0.0], [0.38, 0.09, 0.085, 0.0], [0.47, 0.04, 0.04, -0.01],
];
#[rustfmt::skip]
const LONG_NECKED: Hull = &[
    [-0.50, 0.06, 0.01, 0.015], [-0.42, 0.07, 0.05, 0.0], [-0.25, 0.12, 0.11, 0.0],
    [0.0, 0.125, 0.115, -0.01], [0.15, 0.05, 0.05, 0.01], [0.30, 0.03, 0.03, 0.02],
    [0.38, 0.037, 0.04, 0.025], [0.44, 0.025, 0.025, 0.02],
];

/// Shape and plumage of an adult.
fn looks(kind: DistractorKind) -> (Hull, Wing, Plumage) {
    let plain = |tone: [f32; 3], bill| Plumage {
        back: tone,
        belly: tone,
        under: tone,
        tips: tone,
        bill,
        translucence: 0.0,
    };
    #[rustfmt::skip]
    let wing = match kind {
        DistractorKind::Crow => [
            [0.0, 0.12, 0.42], [0.25, 0.15, 0.44], [0.45, 0.16, 0.42], [0.7, 0.11, 0.36],
            [0.9, 0.02, 0.26], [1.0, -0.08, 0.10],
        ],
        DistractorKind::Pigeon => [
            [0.0, 0.12, 0.40], [0.25, 0.18, 0.40], [0.42, 0.20, 0.36], [0.7, 0.08, 0.24],
            [0.88, -0.08, 0.12], [1.0, -0.22, 0.02],
        ],
        DistractorKind::Swift => [
            [0.0, 0.06, 0.20], [0.2, 0.10, 0.21], [0.32, 0.10, 0.20], [0.6, 0.02, 0.16],
            [0.85, -0.16, 0.09], [1.0, -0.34, 0.015],
        ],
        DistractorKind::Goose => [
            [0.0, 0.10, 0.34], [0.25, 0.13, 0.34], [0.45, 0.14, 0.31], [0.7, 0.06, 0.24],
            [0.9, -0.03, 0.14], [1.0, -0.10, 0.03],
        ],
        DistractorKind::Raptor => [
            [0.0, 0.13, 0.44], [0.25, 0.15, 0.46], [0.48, 0.17, 0.45], [0.7, 0.13, 0.40],
            [0.9, 0.05, 0.30], [1.0, -0.03, 0.16],
        ],
        _ => [
            [0.0, 0.08, 0.27], [0.25, 0.13, 0.30], [0.45, 0.15, 0.26], [0.7, 0.06, 0.19],
            [0.88, -0.05, 0.11], [1.0, -0.16, 0.02],
        ],
    };
    let (hull, plumage) = match kind {
        DistractorKind::Crow => (PLUMP, plain(BLACK, BLACK)),
        DistractorKind::Pigeon => (
            PLUMP,
            Plumage {
                under: WHITE.map(|c| 0.7 * c),
                tips: DARK,
                ..plain(GREY.map(|c| 0.8 * c), DARK)
            },
        ),
        DistractorKind::Swift => (TORPEDO, plain(SOOT, SOOT)),
        DistractorKind::Goose => (
            LONG_NECKED,
            Plumage {
                back: BROWN.map(|c| 1.6 * c),
                belly: BUFF,
                tips: SOOT,
                ..plain(GREY, ORANGE)
            },
        ),
        DistractorKind::Raptor => (
            FAN_TAILED,
            Plumage {
                under: BUFF,
                tips: SOOT,
                ..plain(BROWN, DARK)
            },
        ),
        _ => (
            PLUMP,
            Plumage {
                back: GREY,
                belly: WHITE,
                under: WHITE,
                tips: BLACK,
                bill: YELLOW,
                translucence: 0.3,
            },
        ),
    };
    (hull, wing, plumage)
}

/// An adult bird of `kind`.
pub(super) fn bird(kind: DistractorKind, species: &Species) -> UavMesh {
    let (hull, wing, plumage) = looks(kind);
    build(species, hull, &wing, &plumage)
}

/// A bird of `kind` of drawn size and plumage: within 12 % of the species' size, darker or brighter,
/// a third of the gulls young and brown, wings that the sun shines through or not.
pub(super) fn drawn_bird(kind: DistractorKind, species: &Species, rng: &mut Stream) -> UavMesh {
    let (hull, wing, mut plumage) = looks(kind);
    let size = rng.range(0.88, 1.12);
    if kind == DistractorKind::Bird && rng.uniform() < 0.33 {
        plumage = Plumage {
            back: BROWN,
            belly: BUFF,
            under: BUFF,
            tips: SOOT,
            bill: DARK,
            ..plumage
        };
    }
    plumage.translucence *= rng.range(0.0, 2.0) as f32;
    let tone = rng.range(0.7, 1.2) as f32;
    for part in [
        &mut plumage.back,
        &mut plumage.belly,
        &mut plumage.under,
        &mut plumage.tips,
    ] {
        *part = part.map(|c| (c * tone).min(0.85));
    }
    let species = Species {
        length_m: species.length_m * size,
        span_m: species.span_m * size,
        ..*species
    };
    build(&species, hull, &wing, &plumage)
}

fn build(species: &Species, hull: Hull, wing: &Wing, plumage: &Plumage) -> UavMesh {
    let l = species.length_m;
    let mut body = MeshData::new(DVec3::ZERO);
    let sections: Vec<[f64; 4]> = hull.iter().map(|s| s.map(|x| x * l)).collect();
    hull_forward(&mut body, &sections, 2.0, Paint::plain(plumage.back));
    underside(&mut body, DVec3::Z, plumage.belly, 0.0);
    let [x, _, h, z] = sections[sections.len() - 1];
    body.frustum(
        (DVec3::new(x - 0.01 * l, 0.0, z), 0.5 * h),
        (DVec3::new(0.5 * l, 0.0, z - 0.3 * h), 0.15 * h),
        6,
        Paint::plain(plumage.bill),
    );
    let shoulder_m = 0.065 * l; // to either side
    let wing_m = species.span_m / 2.0 - shoulder_m;
    let [arm, hand] = [&wing[..3], &wing[2..]].map(|part| feathers(part, wing_m, plumage));
    let wrist_m = wing[2][0] * wing_m;
    // The joints turn about the body's forward axis; x points to the left, so that a growing phase
    // lifts the left wing and a falling one its mirror image.
    let q_body_hub = DQuat::from_mat3(&DMat3::from_cols(DVec3::Y, DVec3::Z, DVec3::X));
    let [arm_rad, hand_rad] = species.reach_rad();
    let joint = |side: f64, hand: bool| RotorMount {
        hub_body_m: if hand {
            DVec3::X * side * wrist_m
        } else {
            DVec3::new(0.1 * l, side * shoulder_m, 0.04 * l)
        },
        q_body_hub: if hand { DQuat::IDENTITY } else { q_body_hub },
        sweep_rad: [-1.0, 1.0].map(|way| way * if hand { hand_rad } else { arm_rad }),
        clockwise: side < 0.0,
        blade: usize::from(side < 0.0) + 2 * usize::from(hand),
        parent: hand.then_some(usize::from(side < 0.0)),
    };
    let mirror = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    let mirrored = |part: &MeshData| {
        let mut other = MeshData::new(DVec3::ZERO);
        other.append(part, mirror);
        other
    };
    UavMesh {
        body,
        rotors: vec![
            joint(1.0, false),
            joint(-1.0, false),
            joint(1.0, true),
            joint(-1.0, true),
        ],
        blades: vec![arm.clone(), mirrored(&arm), hand.clone(), mirrored(&hand)],
    }
}

/// A part of a left wing of length `wing_m` about its inner end: x to the tip, y up, z forward.
fn feathers(stations: &[[f64; 3]], wing_m: f64, plumage: &Plumage) -> MeshData {
    let mut mesh = MeshData::new(DVec3::ZERO);
    let inner = stations[0][0];
    let rings: Vec<Vec<DVec3>> = stations
        .iter()
        .map(|[at, lead, chord]| {
            let half = 0.5 * chord * wing_m;
            let middle = DVec3::new((at - inner) * wing_m, 0.0, lead * wing_m - half);
            section(middle, DVec3::Y * (0.07 * half), DVec3::Z * half, 2.0, 8)
        })
        .collect();
    mesh.loft(&rings, Paint::plain(plumage.back));
    underside(&mut mesh, DVec3::Y, plumage.under, plumage.translucence);
    // The outer half of a hand has the colour of the tips.
    if inner > 0.0 {
        let from_m = (0.75 - inner) * wing_m;
        let [r, g, b] = plumage.tips;
        for (at, color) in mesh.positions.iter().zip(&mut mesh.colors) {
            if f64::from(at[0]) > from_m {
                *color = [r, g, b, color[3]];
            }
        }
    }
    mesh
}

/// Paints what faces away from `up`. A translucent part shines with the light on its other side, as
/// if it lay there, and with what the ground sends: a fifth of that (assumption).
fn underside(mesh: &mut MeshData, up: DVec3, tone: [f32; 3], translucence: f32) {
    for (normal, color) in mesh.normals.iter_mut().zip(&mut mesh.colors) {
        let n = DVec3::from(normal.map(f64::from));
        if n.dot(up) >= 0.0 {
            continue;
        }
        let share = if translucence > 0.0 {
            *normal = (n - 2.0 * n.dot(up) * up).as_vec3().to_array();
            0.2 + translucence
        } else {
            1.0
        };
        let [r, g, b] = tone.map(|c| c * share);
        *color = [r, g, b, color[3]];
    }
}
