//! What a detector may take for a UAV: birds, balloons, aeroplanes, leaves.

use glam::{DQuat, DVec3};

use super::aeroplane::{airliner, light_aircraft};
use super::parts::{hull_forward, section};
use super::style::{BLACK, BLUE, DARK, GREEN, GREY, ORANGE, RED, SILVER, WHITE, YELLOW};
use super::{RotorMount, UavMesh};
use crate::models::flight::distractor::{
    AIRLINER_SIZE_M, BALLOON_RADIUS_M, BIRD_LENGTH_M, BIRD_SPAN_M, DistractorKind, LEAF_SIZE_M,
    LIGHT_AIRCRAFT_SIZE_M, WING_BEAT_RAD, WING_MEAN_RAD,
};
use crate::models::maths::rng::Stream;
use crate::models::shape::mesh::{MeshData, Paint};

/// Body and wings of a distractor; a bird's wings are its rotors.
pub fn distractor_mesh(kind: DistractorKind) -> UavMesh {
    match kind {
        DistractorKind::Bird => bird(&GULL),
        DistractorKind::Balloon => balloon(BALLOON_RADIUS_M, RED),
        DistractorKind::Aeroplane => solid(airliner(AIRLINER_SIZE_M, WHITE, BLUE)),
        DistractorKind::Leaf => solid(leaf(LEAF_SIZE_M, [0.16, 0.1, 0.03])),
    }
}

/// A distractor of drawn species, size and colour: gulls, crows and pigeons; balloons; airliners of
/// 35 to 70 m and light aircraft; leaves and scraps of 5 to 35 cm.
pub fn drawn_distractor_mesh(kind: DistractorKind, rng: &mut Stream) -> UavMesh {
    let colours = [WHITE, WHITE, WHITE, SILVER, GREY, BLUE, RED, ORANGE, GREEN];
    match kind {
        DistractorKind::Bird => {
            let species = match rng.uniform() {
                u if u < 0.4 => GULL,
                u if u < 0.75 => CROW,
                _ => PIGEON,
            };
            let size = rng.range(0.88, 1.12);
            let tone = rng.range(0.7, 1.2) as f32;
            bird(&Bird {
                length_m: species.length_m * size,
                span_m: species.span_m * size,
                tones: species.tones.map(|c| c.map(|c| (c * tone).min(0.85))),
                ..species
            })
        }
        DistractorKind::Balloon => {
            let colour = rng.pick(&[RED, BLUE, YELLOW, WHITE, GREEN, ORANGE, SILVER]);
            balloon(rng.range(0.12, 0.5), colour)
        }
        DistractorKind::Aeroplane => {
            let [shell, tail] = [rng.pick(&colours[..5]), rng.pick(&colours)];
            if rng.uniform() < 0.6 {
                let size = rng.range(35.0, 70.0) / AIRLINER_SIZE_M[0];
                solid(airliner(AIRLINER_SIZE_M.map(|x| x * size), shell, tail))
            } else {
                let size = rng.range(0.85, 1.15);
                solid(light_aircraft(
                    LIGHT_AIRCRAFT_SIZE_M.map(|x| x * size),
                    shell,
                    tail,
                ))
            }
        }
        DistractorKind::Leaf => {
            let length_m = 0.05 * 7.0_f64.powf(rng.uniform());
            let width_m = length_m * rng.range(0.45, 0.9);
            let autumn = [[0.16, 0.1, 0.03], [0.1, 0.06, 0.03], [0.28, 0.2, 0.04]];
            let albedo = if rng.uniform() < 0.6 {
                rng.pick(&autumn)
            } else {
                rng.pick(&colours)
            };
            solid(leaf([length_m, width_m, 0.2 * length_m], albedo))
        }
    }
}

/// A body without moving parts.
pub(super) fn solid(body: MeshData) -> UavMesh {
    UavMesh {
        body,
        rotors: Vec::new(),
        rotor: MeshData::new(DVec3::ZERO),
    }
}

/// A species of bird.
#[derive(Clone, Copy, Debug)]
struct Bird {
    length_m: f64,
    /// From wing tip to wing tip [m].
    span_m: f64,
    /// Width of body and wings over the gull's.
    breadth: f64,
    /// Body, wings, wing tips and bill.
    tones: [[f32; 3]; 4],
}

const GULL: Bird = Bird {
    length_m: BIRD_LENGTH_M,
    span_m: BIRD_SPAN_M,
    breadth: 1.0,
    tones: [WHITE, GREY, BLACK, YELLOW],
};
// Carrion crow and feral pigeon: length and span of the species' handbook ranges (recalled).
const CROW: Bird = Bird {
    length_m: 0.47,
    span_m: 0.92,
    breadth: 1.3,
    tones: [BLACK, BLACK, BLACK, BLACK],
};
const PIGEON: Bird = Bird {
    length_m: 0.33,
    span_m: 0.67,
    breadth: 1.25,
    tones: [GREY, GREY, DARK, DARK],
};

/// A bird: body, bill, tail and two wings, alike fore and aft.
fn bird(species: &Bird) -> UavMesh {
    // The gull's own measures, in units of its length and span.
    let (l, breadth) = (species.length_m / BIRD_LENGTH_M, species.breadth);
    let b = l * breadth;
    let [tone, feather, tip_tone, bill] = species.tones;
    let mut body = MeshData::new(DVec3::ZERO);
    #[rustfmt::skip]
    let hull = [
        [-0.30, 0.07, 0.006, 0.01], [-0.17, 0.035, 0.03, 0.0], [-0.05, 0.07, 0.065, 0.0],
        [0.09, 0.07, 0.065, 0.0], [0.17, 0.04, 0.042, 0.01], [0.22, 0.045, 0.045, 0.015],
        [0.25, 0.025, 0.025, 0.015],
    ].map(|[x, w, h, z]| [x * l, w * b, h * b, z * l]);
    hull_forward(&mut body, &hull, 2.0, Paint::plain(tone));
    body.frustum(
        (DVec3::new(0.245, 0.0, 0.012) * l, 0.013 * l),
        (DVec3::new(0.30, 0.0, 0.004) * l, 0.004 * l),
        6,
        Paint::plain(bill),
    );
    let shoulder_m = 0.04 * l; // to either side
    let length_m = species.span_m / 2.0 - shoulder_m;
    let mut wing = MeshData::new(DVec3::ZERO);
    // Along x to the tip, thickness along y, chord along z.
    let ring = |r: f64, chord_m: f64| {
        let half = 0.5 * chord_m * b;
        section(
            DVec3::X * r * length_m,
            DVec3::Y * (0.08 * half),
            DVec3::Z * half,
            2.0,
            8,
        )
    };
    let feathers = [(0.0, 0.17), (0.25, 0.21), (0.5, 0.18), (0.8, 0.10)];
    wing.loft(&feathers.map(|(r, c)| ring(r, c)), Paint::plain(feather));
    let tip = [(0.8, 0.10), (0.93, 0.05), (1.0, 0.01)];
    wing.loft(&tip.map(|(r, c)| ring(r, c)), Paint::plain(tip_tone));
    // The hinge lies along the body: the wing's x points outward, a growing phase lifts it.
    let wings = [1.0, -1.0].map(|side| RotorMount {
        hub_body_m: DVec3::new(0.06 * l, side * shoulder_m, 0.035 * l),
        q_body_hub: DQuat::from_mat3(&glam::DMat3::from_cols(
            side * DVec3::Y,
            DVec3::Z,
            side * DVec3::X,
        )),
        sweep_rad: [WING_MEAN_RAD - WING_BEAT_RAD, WING_MEAN_RAD + WING_BEAT_RAD],
        clockwise: false,
    });
    UavMesh {
        body,
        rotors: wings.into(),
        rotor: wing,
    }
}

/// A latex balloon with its knot.
fn balloon(radius_m: f64, albedo: [f32; 3]) -> UavMesh {
    let mut body = MeshData::new(DVec3::ZERO);
    let paint = Paint::plain(albedo);
    body.icosphere(DVec3::ZERO, DVec3::splat(radius_m), 3, paint);
    body.frustum(
        (DVec3::Z * -(radius_m + 0.04), 0.03),
        (DVec3::Z * -(radius_m - 0.01), 0.012),
        8,
        paint,
    );
    solid(body)
}

/// A bent thin plate, pointed at both ends, of length, width and bend `size_m` [m].
fn leaf(size_m: [f64; 3], albedo: [f32; 3]) -> MeshData {
    let [length, width, bend] = size_m;
    let mut mesh = MeshData::new(DVec3::ZERO);
    let rings: Vec<Vec<DVec3>> = [
        (-0.5, 0.06),
        (-0.3, 0.7),
        (-0.05, 1.0),
        (0.25, 0.75),
        (0.5, 0.06),
    ]
    .iter()
    .map(|&(x, w): &(f64, f64)| {
        section(
            DVec3::new(x * length, 0.0, bend * (4.0 * x * x - 0.5)),
            // Six corners at 30 degrees off the axis reach its cosine.
            DVec3::Y * w * width / 3.0_f64.sqrt(),
            DVec3::Z * 0.01 * length,
            2.0,
            6,
        )
    })
    .collect();
    mesh.loft(&rings, Paint::plain(albedo));
    mesh
}
