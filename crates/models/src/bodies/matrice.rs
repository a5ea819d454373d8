//! The Matrices: round arms on a dark hull, receivers on masts, gear on raked struts.

use std::f64::consts::{PI, TAU};

use glam::{DAffine3, DVec2, DVec3};

use super::kit::Kit;
use super::parts::{Skid, arm, block, camera, hull_forward, hull_up, motor, skid, tube};
use super::style::{BLACK, CARBON, DARK, GREY, LENS, RED};
use crate::shape::mesh::{MeshData, Paint};

/// Adds the quadcopter and returns the heights of its hubs [m].
pub(super) fn matrice_200(mesh: &mut MeshData, kit: &Kit) -> Vec<f64> {
    const HUB_Z_M: f64 = 0.078;
    let dark = Paint::plain(kit.coat.shell);
    #[rustfmt::skip]
    hull_forward(mesh, &[
        [-0.19, 0.05, 0.032, 0.01], [-0.17, 0.075, 0.05, 0.01], [-0.04, 0.085, 0.062, 0.015],
        [0.1, 0.075, 0.056, 0.012], [0.17, 0.055, 0.04, 0.0], [0.2, 0.03, 0.022, -0.005],
    ], 3.2, dark);
    for y in [-1.0, 1.0] {
        side_200(mesh, kit, y);
    }
    for &hub in kit.hubs {
        arm_200(mesh, kit, hub, HUB_Z_M);
    }
    camera(mesh, kit.camera_body_m, 0.042, DARK);
    mesh.frustum(
        (DVec3::new(0.15, 0.0, -0.058), 0.03),
        (DVec3::new(0.15, 0.0, -0.03), 0.036),
        10,
        Paint::plain(CARBON),
    );
    block(mesh, DVec3::new(0.19, 0.0, 0.02), [0.03, 0.06, 0.018], LENS);
    vec![HUB_Z_M; kit.hubs.len()]
}

/// What the quadcopter has on a side `y`, -1 or 1: battery, skid, receiver.
fn side_200(mesh: &mut MeshData, kit: &Kit, y: f64) {
    let height = kit.size_m[2];
    let (top, foot) = (0.27 * height, -0.73 * height);
    // Twin batteries at the back.
    let battery = DVec3::new(1.0, y, 1.0) * kit.battery_body_m;
    block(mesh, battery, [0.09, 0.062, 0.07], GREY);
    if kit.lowered {
        let knee = DVec3::new(-0.02, y * 0.13, foot + 0.012);
        let hip = DVec3::new(-0.02, y * 0.06, -0.03);
        let size = Skid {
            radii_m: [0.011, 0.008, 0.012],
            half_m: 0.15,
            pad_at_m: 0.13,
            pad_half_m: 0.03,
        };
        skid(mesh, [hip, knee], size, Paint::plain(kit.coat.gear));
    }
    // Antennas of the positioning receivers.
    let mast = DVec3::new(-0.07, y * 0.05, 0.05);
    let tip = mast + DVec3::Z * (top - 0.056);
    tube(mesh, mast, tip, 0.006, Paint::plain(CARBON));
    mesh.frustum(
        (DVec3::new(mast.x, mast.y, top - 0.014), 0.022),
        (DVec3::new(mast.x, mast.y, top), 0.018),
        10,
        Paint::plain(kit.coat.shell),
    );
}

/// An arm of the quadcopter with its motor, up to `top` [m], and its lamp.
fn arm_200(mesh: &mut MeshData, kit: &Kit, hub: DVec2, top: f64) {
    let dark = Paint::plain(kit.coat.shell);
    let out = hub.normalize();
    let (root, joint) = ((out * 0.07).extend(0.012), (out * 0.14).extend(0.02));
    arm(mesh, root, joint, [[0.032, 0.03], [0.02, 0.02]], dark);
    let from = (out * 0.12).extend(0.018);
    tube(mesh, from, hub.extend(0.03), 0.0145, kit.coat.arm(hub));
    mesh.frustum(
        (hub.extend(0.008), 0.024),
        (hub.extend(0.046), 0.028),
        12,
        dark,
    );
    motor(mesh, hub, [0.046, top], 0.029, kit.coat.motor);
    let lamp = if hub.x > 0.0 { RED } else { [0.1, 0.45, 0.1] };
    block(mesh, hub.extend(0.004), [0.02, 0.02, 0.01], lamp);
}

/// Adds the hexacopter and returns the heights of its hubs [m].
pub(super) fn matrice_600(mesh: &mut MeshData, kit: &Kit) -> Vec<f64> {
    const HUB_Z_M: f64 = 0.068;
    let height = kit.size_m[2];
    let (top, foot) = (0.25 * height, -0.75 * height);
    let dark = Paint::plain(kit.coat.shell);
    #[rustfmt::skip]
    hull_up(mesh, DVec2::ZERO, &[
        [-0.05, 0.11, 0.11], [-0.03, 0.17, 0.17], [0.03, 0.175, 0.175], [0.055, 0.14, 0.14],
        [0.09, 0.1, 0.1], [0.108, 0.05, 0.05],
    ], 2.0, dark);
    for i in 0..kit.hubs.len() {
        arm_600(mesh, kit, i, HUB_Z_M);
    }
    // Three receivers on masts.
    for k in 0..3 {
        let at = DVec2::from_angle(PI + TAU * f64::from(k) / 3.0) * 0.11;
        let carbon = Paint::plain(CARBON);
        tube(mesh, at.extend(0.05), at.extend(top - 0.012), 0.004, carbon);
        mesh.frustum(
            (at.extend(top - 0.018), 0.03),
            (at.extend(top), 0.026),
            12,
            dark,
        );
    }
    // Retractable gear, lowered.
    for &y in kit.skid_sides() {
        let knee = DVec3::new(0.0, y * 0.33, foot + 0.012);
        let hip = DVec3::new(0.0, y * 0.14, -0.035);
        let size = Skid {
            radii_m: [0.0125, 0.01, 0.012],
            half_m: 0.24,
            pad_at_m: 0.2,
            pad_half_m: 0.04,
        };
        skid(mesh, [hip, knee], size, Paint::plain(kit.coat.gear));
    }
    cinema_camera(mesh, kit.camera_body_m);
    vec![HUB_Z_M; kit.hubs.len()]
}

/// Arm `i` of the hexacopter with its motor, up to `top` [m], and a battery beside it.
fn arm_600(mesh: &mut MeshData, kit: &Kit, i: usize, top: f64) {
    let hub = kit.hubs[i];
    let out = hub.normalize();
    let at = |along_m: f64, z: f64| (out * along_m).extend(z);
    let paint = kit.coat.arm(hub);
    tube(mesh, at(0.13, 0.005), hub.extend(0.02), 0.0135, paint);
    // The folding joint, and a battery between each pair of arms.
    let dark = Paint::plain(kit.coat.shell);
    tube(mesh, at(0.17, 0.005), at(0.25, 0.008), 0.021, dark);
    let n = kit.hubs.len() as f64;
    let between = DVec2::from_angle(PI / n + TAU * i as f64 / n + PI / n);
    let mut battery = MeshData::new(DVec3::ZERO);
    let size = [0.07, 0.085, 0.085];
    block(&mut battery, kit.battery_body_m, size, GREY);
    mesh.append(&battery, DAffine3::from_rotation_z(between.to_angle()));
    let bell = if hub.x > 0.1 { RED } else { kit.coat.motor };
    motor(mesh, hub, [-0.008, top], 0.038, bell);
}

/// A three-axis gimbal with a cinema camera about `at` [m, body].
fn cinema_camera(mesh: &mut MeshData, at: DVec3) {
    let carbon = Paint::plain(CARBON);
    let behind = |x: f64, z: f64| DVec3::new(x, 0.0, z);
    tube(mesh, behind(0.0, -0.05), behind(0.0, -0.14), 0.02, carbon);
    tube(
        mesh,
        behind(-0.1, -0.14),
        behind(0.02, -0.14),
        0.016,
        carbon,
    );
    tube(
        mesh,
        behind(-0.1, -0.14),
        behind(-0.1, -0.25),
        0.016,
        carbon,
    );
    block(mesh, at, [0.15, 0.085, 0.1], BLACK);
    let lens = DVec3::new(0.075, 0.0, -0.25);
    mesh.frustum(
        (lens, 0.038),
        (lens + DVec3::X * 0.07, 0.042),
        12,
        Paint::plain(LENS),
    );
}
