//! The Phantom: a rounded shell, arms that grow out of it, fixed skids.

use glam::{DVec2, DVec3};

use super::kit::Kit;
use super::parts::{arm, block, camera, hull_up, motor, tube};
use super::style::{GREY, LENS, RED, SILVER};
use crate::shape::mesh::{MeshData, Paint};

/// Adds the airframe and returns the heights of its hubs [m].
pub(super) fn phantom(mesh: &mut MeshData, kit: &Kit) -> Vec<f64> {
    let height = kit.size_m[2];
    let (top, foot) = (0.28 * height, -0.72 * height);
    #[rustfmt::skip]
    hull_up(mesh, DVec2::ZERO, &[
        [-0.034, 0.045, 0.035], [-0.026, 0.074, 0.056], [-0.006, 0.087, 0.066],
        [0.014, 0.084, 0.063], [0.032, 0.062, 0.046], [0.042, 0.03, 0.024],
    ], 2.8, Paint::plain(kit.coat.shell));
    for &hub in kit.hubs {
        motor_arm(mesh, kit, hub, top);
    }
    for &y in kit.skid_sides() {
        landing_skid(mesh, Paint::plain(kit.coat.gear), y, foot);
    }
    camera(mesh, kit.camera_body_m, 0.024, GREY);
    block(mesh, kit.battery_body_m, [0.05, 0.075, 0.036], SILVER);
    let eyes = DVec3::new(0.082, 0.0, 0.0);
    block(mesh, eyes, [0.012, 0.06, 0.014], LENS);
    vec![top; kit.hubs.len()]
}

/// An arm with its motor, up to `top` [m], and its lamp.
fn motor_arm(mesh: &mut MeshData, kit: &Kit, hub: DVec2, top: f64) {
    let (motor_m, paint) = (kit.motor_m, kit.coat.arm(hub));
    let root = (hub.normalize() * 0.035).extend(0.002);
    arm(
        mesh,
        root,
        hub.extend(0.016),
        [[0.042, 0.026], [0.019, 0.013]],
        paint,
    );
    mesh.frustum(
        (hub.extend(0.0), motor_m * 0.8),
        (hub.extend(0.032), motor_m),
        12,
        paint,
    );
    motor(mesh, hub, [0.032, top], motor_m, kit.coat.motor);
    let lamp = if hub.x > 0.0 { RED } else { [0.25, 0.5, 0.2] };
    let below = (hub * 0.93).extend(-0.002);
    block(mesh, below, [0.016, 0.012, 0.006], lamp);
}

/// The skid of a side `y`, -1 or 1, that stands on `foot` [m].
fn landing_skid(mesh: &mut MeshData, paint: Paint, y: f64, foot: f64) {
    let foot_at = |x: f64| DVec3::new(x, y * 0.083, foot + 0.006);
    for x in [-1.0, 1.0] {
        let hip = DVec3::new(x * 0.045, y * 0.05, -0.018);
        let size = [[0.009, 0.007], [0.006, 0.006]];
        arm(mesh, hip, foot_at(x * 0.062), size, paint);
    }
    tube(mesh, foot_at(-0.078), foot_at(0.078), 0.006, paint);
}
