//! What a detector may take for a UAV: birds, balloons, aeroplanes, helicopters, leaves.

use glam::DVec3;

use super::aeroplane::{LightAircraft, airliner, contrail, light_aircraft, turboprop};
use super::birds::{bird, drawn_bird};
use super::helicopter::{Helicopter, helicopter};
use super::parts::section;
use super::style::{BLUE, DARK, GREEN, GREY, ORANGE, RED, SILVER, WHITE, YELLOW};
use super::{RotorMount, UavMesh};
use crate::flight::distractor::{
    AIRLINER_SIZE_M, BALLOON_RADIUS_M, CONTRAIL_M, DistractorKind, LEAF_SIZE_M,
    LIGHT_AIRCRAFT_SIZE_M, TURBOPROP_SIZE_M,
};
use crate::maths::rng::Stream;
use crate::shape::mesh::{MeshData, Paint};

/// Body and moving parts of a distractor; a bird's wings are its rotors.
pub fn distractor_mesh(kind: DistractorKind) -> UavMesh {
    match kind {
        DistractorKind::Balloon => balloon(BALLOON_RADIUS_M, RED),
        DistractorKind::Aeroplane => solid(airliner(AIRLINER_SIZE_M, WHITE, BLUE)),
        DistractorKind::Contrail => solid(contrail(AIRLINER_SIZE_M, CONTRAIL_M, WHITE, BLUE)),
        DistractorKind::Turboprop => turboprop(TURBOPROP_SIZE_M, WHITE, DARK),
        DistractorKind::LightAircraft => light_aircraft(&LightAircraft {
            size_m: LIGHT_AIRCRAFT_SIZE_M,
            low_wing: false,
            shell: WHITE,
            tail: RED,
        }),
        DistractorKind::Helicopter => helicopter(&Helicopter {
            scale: 1.0,
            blades: 4,
            girth: 1.0,
            skids: true,
            shell: YELLOW,
            tail: DARK,
        }),
        DistractorKind::Leaf => solid(leaf(LEAF_SIZE_M, [0.16, 0.1, 0.03])),
        _ => match kind.species() {
            Some(species) => bird(kind, species),
            None => solid(MeshData::new(DVec3::ZERO)),
        },
    }
}

/// A distractor of drawn size and colour: birds within 12 % of their species' size; balloons;
/// airliners of 35 to 70 m, turboprops of 19 to 34 m, light aircraft and helicopters from two-seaters to large ones; leaves and
/// scraps of 5 to 35 cm.
pub fn drawn_distractor_mesh(kind: DistractorKind, rng: &mut Stream) -> UavMesh {
    let colours = [WHITE, WHITE, WHITE, SILVER, GREY, BLUE, RED, ORANGE, GREEN];
    match kind {
        DistractorKind::Balloon => {
            let colour = rng.pick(&[RED, BLUE, YELLOW, WHITE, GREEN, ORANGE, SILVER]);
            balloon(rng.range(0.12, 0.5), colour)
        }
        DistractorKind::Aeroplane => {
            let [shell, tail] = [rng.pick(&colours[..5]), rng.pick(&colours)];
            let size = rng.range(35.0, 70.0) / AIRLINER_SIZE_M[0];
            solid(airliner(AIRLINER_SIZE_M.map(|x| x * size), shell, tail))
        }
        DistractorKind::Contrail => {
            let [shell, tail] = [rng.pick(&colours[..5]), rng.pick(&colours)];
            let size = rng.range(35.0, 70.0) / AIRLINER_SIZE_M[0];
            let size_m = AIRLINER_SIZE_M.map(|x| x * size);
            solid(contrail(size_m, rng.range(150.0, 500.0), shell, tail))
        }
        DistractorKind::Turboprop => {
            let [shell, tail] = [rng.pick(&colours[..5]), rng.pick(&colours)];
            let size = rng.range(0.7, 1.25);
            turboprop(TURBOPROP_SIZE_M.map(|x| x * size), shell, tail)
        }
        DistractorKind::LightAircraft => {
            let size = rng.range(0.75, 1.4);
            light_aircraft(&LightAircraft {
                size_m: LIGHT_AIRCRAFT_SIZE_M.map(|x| x * size),
                low_wing: rng.uniform() < 0.5,
                shell: rng.pick(&colours[..5]),
                tail: rng.pick(&colours),
            })
        }
        DistractorKind::Helicopter => {
            let shells = [WHITE, YELLOW, RED, BLUE, GREY, DARK, DARK, GREEN, ORANGE];
            helicopter(&Helicopter {
                scale: rng.range(0.7, 1.5),
                blades: 2 + (4.0 * rng.uniform()) as u32,
                girth: rng.range(0.75, 1.1),
                skids: rng.uniform() < 0.6,
                shell: rng.pick(&shells),
                tail: rng.pick(&shells),
            })
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
        _ => match kind.species() {
            Some(species) => drawn_bird(kind, species, rng),
            None => solid(MeshData::new(DVec3::ZERO)),
        },
    }
}

/// A body without moving parts.
pub(super) fn solid(body: MeshData) -> UavMesh {
    UavMesh {
        body,
        rotors: Vec::<RotorMount>::new(),
        blades: Vec::new(),
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
