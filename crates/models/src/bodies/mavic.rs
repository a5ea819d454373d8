//! The Mavics: a flat hull, front arms at shoulder height, rear arms folded out from below.

use glam::{DVec2, DVec3};

use super::kit::Kit;
use super::parts::{arm, block, camera, hull_forward, motor};
use super::style::{BLACK, DARK, LENS};
use crate::shape::mesh::{MeshData, Paint};

/// Adds the airframe and returns the heights of its hubs [m].
pub(super) fn mavic(mesh: &mut MeshData, kit: &Kit) -> Vec<f64> {
    let [l, w, h] = kit.size_m;
    let coat = &kit.coat;
    #[rustfmt::skip]
    hull_forward(mesh, &[
        [-0.34 * l, 0.10 * w, 0.16 * h, 0.0], [-0.31 * l, 0.17 * w, 0.29 * h, 0.0],
        [-0.05 * l, 0.19 * w, 0.36 * h, 0.02 * h], [0.2 * l, 0.175 * w, 0.32 * h, 0.04 * h],
        [0.31 * l, 0.14 * w, 0.24 * h, 0.06 * h], [0.34 * l, 0.09 * w, 0.14 * h, 0.07 * h],
    ], 3.6, Paint::plain(coat.shell));
    // The battery forms the rear of the back.
    let back = [0.34 * l, 0.26 * w, 0.14 * h];
    block(mesh, kit.battery_body_m, back, coat.shell.map(|c| c * 0.85));
    let heights = kit
        .hubs
        .iter()
        .map(|&hub| motor_arm(mesh, kit, hub))
        .collect();
    camera(mesh, kit.camera_body_m, 0.2 * h, DARK);
    let eyes = DVec3::new(0.335 * l, 0.0, 0.14 * h);
    block(mesh, eyes, [0.03 * l, 0.2 * w, 0.1 * h], LENS);
    let belly = DVec3::new(-0.02 * l, 0.0, -0.34 * h);
    block(mesh, belly, [0.25 * l, 0.2 * w, 0.06 * h], BLACK);
    heights
}

/// An arm with its motor and leg; returns the height of the hub [m].
fn motor_arm(mesh: &mut MeshData, kit: &Kit, hub: DVec2) -> f64 {
    let [l, w, h] = kit.size_m;
    let (coat, motor_m) = (&kit.coat, kit.motor_m);
    let (top, foot) = (0.42 * h, -0.58 * h);
    let front = hub.x > 0.0;
    let trim = coat.arm(hub);
    // Front arms swing out at shoulder height, rear arms fold under the hull.
    let root = |x: f64, z: f64| DVec3::new(x * l, 0.15 * w * hub.y.signum(), z * h);
    let (root, z, hub_top) = if front {
        (root(0.24, 0.12), 0.16 * h, top)
    } else {
        (root(-0.2, -0.12), -0.04 * h, 0.22 * h)
    };
    let size = [[0.05 * l, 0.15 * h], [0.032 * l, 0.1 * h]];
    arm(mesh, root, hub.extend(z), size, trim);
    mesh.frustum(
        (hub.extend(z - 0.14 * h), motor_m * 0.9),
        (hub.extend(z + 0.1 * h), motor_m),
        12,
        trim,
    );
    motor(mesh, hub, [z + 0.1 * h, hub_top], motor_m, coat.motor);
    let leg = if front { foot } else { -0.5 * h };
    if kit.lowered {
        let size = [[0.022 * l, 0.03 * l], [0.012 * l, 0.018 * l]];
        let paint = Paint::plain(coat.gear);
        arm(mesh, hub.extend(z), hub.extend(leg), size, paint);
    }
    hub_top
}
