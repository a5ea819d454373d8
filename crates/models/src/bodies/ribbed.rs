//! Self-built frames, as the 450 and 550 mm kits are.

use glam::{DVec2, DVec3};

use super::kit::Kit;
use super::parts::{arm, block, hull_up, motor};
use super::style::{BLACK, DARK};
use crate::shape::mesh::{MeshData, Paint};

/// Adds a self-built frame on the model's hubs and returns their heights [m]. Sizes are in units of
/// a 450 mm diagonal.
pub(super) fn ribbed(mesh: &mut MeshData, kit: &Kit) -> Vec<f64> {
    let unit = kit.diagonal_m / 0.45;
    for z in [-0.022, 0.020] {
        let plate = [z, z + 0.004].map(|z| [z * unit, 0.062 * unit, 0.055 * unit]);
        hull_up(mesh, DVec2::ZERO, &plate, 3.0, Paint::plain(BLACK));
    }
    // Battery between or on the plates, controller and receiver dome above.
    let battery = [0.12 * unit, 0.042 * unit, 0.036 * unit];
    block(mesh, DVec3::ZERO, battery, DARK);
    #[rustfmt::skip]
    hull_up(mesh, DVec2::ZERO, &[
        [0.024 * unit, 0.05 * unit, 0.042 * unit], [0.045 * unit, 0.044 * unit, 0.036 * unit],
        [0.058 * unit, 0.022 * unit, 0.018 * unit],
    ], 2.4, Paint::plain(kit.coat.shell));
    let top = 0.046 * unit;
    for &hub in kit.hubs {
        motor_arm(mesh, kit, hub, top);
    }
    vec![top; kit.hubs.len()]
}

/// A ribbed arm with its foot, motor, up to `top` [m], and speed controller.
fn motor_arm(mesh: &mut MeshData, kit: &Kit, hub: DVec2, top: f64) {
    let unit = kit.diagonal_m / 0.45;
    // Slender arms carry small motors.
    let motor_m = kit.motor_m.clamp(0.3 * 0.014 * unit, 0.014 * unit);
    let out = hub.normalize();
    let paint = kit.coat.arm(hub);
    let (root, tip) = (out * 0.045 * unit, hub);
    let slim = |w: f64, h: f64| [w * unit, h * unit];
    let at = |p: DVec2, z: f64| p.extend(z * unit);
    // A flat top rail, a lower one that sweeps up to it, and the end that goes down to a foot.
    let size = [slim(0.017, 0.006), slim(0.013, 0.006)];
    arm(mesh, at(root, 0.014), at(tip, 0.014), size, paint);
    let size = [slim(0.008, 0.006), slim(0.008, 0.006)];
    arm(mesh, at(root, -0.018), at(tip, -0.008), size, paint);
    let size = [slim(0.005, 0.006), slim(0.005, 0.006)];
    let (low, high) = (root.lerp(tip, 0.5), root.lerp(tip, 0.62));
    arm(mesh, at(low, -0.014), at(high, 0.012), size, paint);
    mesh.frustum(
        (at(tip, -0.02), 0.011 * unit),
        (at(tip, 0.018), motor_m.max(0.012 * unit)),
        8,
        paint,
    );
    if kit.lowered {
        let foot = at(tip - out * 0.004 * unit, -0.075);
        let size = [slim(0.011, 0.008), slim(0.007, 0.006)];
        let gear = Paint::plain(kit.coat.gear);
        arm(mesh, at(tip, -0.016), foot, size, gear);
    }
    motor(mesh, hub, [0.018 * unit, top], motor_m, kit.coat.motor);
    let controller = root.lerp(tip, 0.45).extend(0.0);
    let size = [0.024 * unit, 0.024 * unit, 0.01 * unit];
    block(mesh, controller, size, BLACK);
}
