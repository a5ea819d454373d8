//! A helicopter: cabin, tail boom, skids, a main and a tail rotor that turn.

use std::f64::consts::{FRAC_PI_2, TAU};

use glam::{DAffine3, DQuat, DVec3};

use super::parts::{block, hull_forward, section, spun, tube};
use super::style::{BLACK, DARK, GREY, LENS};
use super::{RotorMount, UavMesh};
use crate::flight::distractor::HELICOPTER_SIZE_M;
use crate::shape::mesh::{MeshData, Paint};

/// How a helicopter differs from others.
#[derive(Clone, Copy, Debug)]
pub(super) struct Helicopter {
    /// Its size over the standard one's.
    pub scale: f64,
    /// Blades of the main rotor.
    pub blades: u32,
    /// Width of the cabin over the standard one's.
    pub girth: f64,
    /// Whether it stands on skids; otherwise its wheels are retracted.
    pub skids: bool,
    pub shell: [f32; 3],
    pub tail: [f32; 3],
}

/// A helicopter about its rotor's mast, lengths those of [`HELICOPTER_SIZE_M`] times its scale.
pub(super) fn helicopter(style: &Helicopter) -> UavMesh {
    let radius_m = HELICOPTER_SIZE_M[1] / 2.0;
    let mut body = fuselage(style);
    let mut main = rotor(radius_m, 0.30, style.blades, 0.04);
    let mut tail = rotor(0.95, 0.2, 2 + style.blades / 3, 0.0);
    for mesh in [&mut body, &mut main, &mut tail] {
        let mut scaled = MeshData::new(DVec3::ZERO);
        scaled.append(mesh, DAffine3::from_scale(DVec3::splat(style.scale)));
        *mesh = scaled;
    }
    let mount = |hub_body_m: DVec3, q_body_hub: DQuat, blade: usize| RotorMount {
        hub_body_m: hub_body_m * style.scale,
        q_body_hub,
        sweep_rad: [0.0, TAU],
        clockwise: false,
        blade,
        parent: None,
    };
    UavMesh {
        body,
        rotors: vec![
            mount(DVec3::Z * 1.5, DQuat::IDENTITY, 0),
            // Its axis points to the left.
            mount(
                DVec3::new(-6.05, 0.32, 0.95),
                DQuat::from_rotation_x(-FRAC_PI_2),
                1,
            ),
        ],
        blades: vec![main, tail],
    }
}

fn fuselage(style: &Helicopter) -> MeshData {
    let mut mesh = MeshData::new(DVec3::ZERO);
    let (shell, trim) = (Paint::plain(style.shell), Paint::plain(style.tail));
    let wide = |sections: &[[f64; 4]]| -> Vec<[f64; 4]> {
        (sections.iter())
            .map(|&[x, y, h, z]| [x, y * style.girth, h, z])
            .collect()
    };
    #[rustfmt::skip]
    let cabin = wide(&[
        [-2.0, 0.25, 0.3, 0.35], [-1.4, 0.7, 0.75, 0.1], [-0.2, 0.95, 1.0, -0.15],
        [1.2, 0.95, 1.0, -0.3], [2.4, 0.85, 0.85, -0.45], [3.2, 0.55, 0.5, -0.62],
        [3.65, 0.15, 0.15, -0.7],
    ]);
    hull_forward(&mut mesh, &cabin, 2.4, shell);
    #[rustfmt::skip]
    let glass = wide(&[
        [0.9, 0.92, 0.6, 0.1], [1.5, 0.94, 0.72, 0.0], [2.4, 0.84, 0.62, -0.18],
        [3.1, 0.5, 0.34, -0.4],
    ]);
    hull_forward(&mut mesh, &glass, 2.4, Paint::plain(LENS));
    #[rustfmt::skip]
    let cowling = wide(&[
        [-2.2, 0.2, 0.2, 0.85], [-1.4, 0.55, 0.38, 0.9], [0.2, 0.6, 0.4, 0.9],
        [1.0, 0.3, 0.2, 0.8],
    ]);
    hull_forward(&mut mesh, &cowling, 2.4, trim);
    mesh.frustum(
        (DVec3::Z * 1.1, 0.16),
        (DVec3::Z * 1.5, 0.12),
        8,
        Paint::plain(GREY),
    );
    mesh.frustum(
        (DVec3::new(-1.4, 0.0, 0.3), 0.4),
        (DVec3::new(-6.1, 0.0, 0.75), 0.17),
        10,
        shell,
    );
    let fin = [(-5.5, 0.55, 1.0), (-6.2, 1.9, 0.6)].map(|(x, z, chord): (f64, f64, f64)| {
        section(
            DVec3::new(x - chord / 2.0, 0.0, z),
            DVec3::X * chord / 2.0,
            DVec3::Y * 0.07 * chord,
            2.0,
            8,
        )
    });
    mesh.loft(&fin, trim);
    block(
        &mut mesh,
        DVec3::new(-4.9, 0.0, 0.65),
        [0.6, 2.5, 0.07],
        style.tail,
    );
    if style.skids {
        for y in [-1.05, 1.05] {
            let rail = |x: f64| DVec3::new(x, y, -2.05);
            tube(&mut mesh, rail(-1.6), rail(2.3), 0.05, Paint::plain(DARK));
            for x in [-0.9, 1.2] {
                let hip = DVec3::new(x, 0.55 * y, -0.95);
                tube(&mut mesh, hip, rail(x), 0.045, Paint::plain(DARK));
            }
        }
    } else {
        block(
            &mut mesh,
            DVec3::new(0.2, 0.0, -1.3),
            [1.6, 1.7, 0.35],
            style.shell,
        );
    }
    mesh
}

/// A rotor about its hub, axis z: flat blades of chord `chord_m` that rise by `cone_rad` to their
/// tips.
fn rotor(radius_m: f64, chord_m: f64, blades: u32, cone_rad: f64) -> MeshData {
    let sections = [0.07, 0.16, 1.0].map(|r| {
        let half = if r < 0.1 { 0.2 } else { 0.5 } * chord_m;
        [
            DVec3::new(r * radius_m, 0.0, r * radius_m * cone_rad),
            DVec3::Y * half,
            DVec3::Z,
        ]
    });
    let mut mesh = spun(&sections, blades, Paint::plain(DARK));
    mesh.frustum(
        (DVec3::Z * -0.04 * radius_m, 0.07 * radius_m),
        (DVec3::Z * 0.05 * radius_m, 0.06 * radius_m),
        8,
        Paint::plain(BLACK),
    );
    mesh
}
