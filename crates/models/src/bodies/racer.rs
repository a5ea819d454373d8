//! The racer: carbon plates, bare electronics, a battery strapped on top.

use glam::{DAffine3, DVec2, DVec3};

use super::kit::Kit;
use super::parts::{block, motor, tube};
use super::style::{BLACK, LENS, RED};
use crate::shape::mesh::{MeshData, Paint};

/// Albedo of circuit boards.
const BOARD: [f32; 3] = [0.02, 0.1, 0.05];

/// Adds the airframe and returns the heights of its hubs [m].
pub(super) fn racer(mesh: &mut MeshData, kit: &Kit) -> Vec<f64> {
    let height = kit.size_m[2];
    let low = -0.3 * height;
    let top = low + height;
    let deck = low + 0.005; // [m], the plate's thickness
    for &hub in kit.hubs {
        motor_arm(mesh, kit, hub, [low, deck]);
    }
    let upper = deck + 0.022;
    plates(mesh, kit.coat.shell, deck, upper);
    battery(mesh, kit.battery_body_m, [upper + 0.0015, top]);
    eye(mesh, kit.camera_body_m, deck);
    // The antenna.
    tube(
        mesh,
        DVec3::new(-0.06, 0.0, upper),
        DVec3::new(-0.085, 0.0, top - 0.006),
        0.002,
        Paint::plain(BLACK),
    );
    vec![deck + 0.02; kit.hubs.len()]
}

/// An arm between two heights [m], with its motor and speed controller.
fn motor_arm(mesh: &mut MeshData, kit: &Kit, hub: DVec2, [low, deck]: [f64; 2]) {
    let axis = hub.normalize();
    let mut beam = MeshData::new(DVec3::ZERO);
    let length = hub.length() + 0.004;
    beam.cuboid(
        DVec3::new(0.0, -0.0065, low),
        DVec3::new(length, 0.0065, deck),
        kit.coat.arm(hub),
    );
    mesh.append(&beam, DAffine3::from_rotation_z(axis.to_angle()));
    motor(mesh, hub, [deck, deck + 0.02], kit.motor_m, kit.coat.motor);
    let controller = (axis * hub.length() * 0.55).extend(deck + 0.0025);
    block(mesh, controller, [0.022, 0.014, 0.005], BOARD);
}

/// Lower and upper plate at their heights [m], the posts between them, the flight controller.
fn plates(mesh: &mut MeshData, shell: [f32; 3], deck: f64, upper: f64) {
    let at = |x: f64, z: f64| DVec3::new(x, 0.0, z);
    block(mesh, at(0.0, deck), [0.13, 0.038, 0.004], shell);
    block(mesh, at(-0.005, upper), [0.12, 0.032, 0.003], shell);
    for x in [-0.055, 0.045] {
        for y in [-0.013, 0.013] {
            let post = DVec2::new(x, y);
            let (foot, head) = (post.extend(deck), post.extend(upper));
            tube(mesh, foot, head, 0.0025, Paint::plain(RED));
        }
    }
    block(mesh, at(-0.005, deck + 0.01), [0.036, 0.028, 0.012], BOARD);
}

/// The bare battery about `at` between two heights [m], its strap and plug.
fn battery(mesh: &mut MeshData, at: DVec3, [floor, ceiling]: [f64; 2]) {
    let middle = (floor + ceiling) / 2.0;
    let cells = [0.076, 0.036, ceiling - floor - 0.001];
    block(mesh, at, cells, [0.05, 0.06, 0.2]);
    let strap = DVec3::new(-0.005, 0.0, middle);
    block(mesh, strap, [0.018, 0.0375, ceiling - floor], BLACK);
    let plug = DVec3::new(-0.046, 0.0, middle);
    block(mesh, plug, [0.008, 0.02, 0.012], [0.5, 0.35, 0.02]);
}

/// The camera at `at` between its side plates on the deck [m], tilted up.
fn eye(mesh: &mut MeshData, at: DVec3, deck: f64) {
    for y in [-0.012, 0.012] {
        let plate = DVec3::new(0.062, y, deck + 0.011);
        block(mesh, plate, [0.022, 0.002, 0.022], RED);
    }
    mesh.icosphere(at, DVec3::splat(0.0105), 1, Paint::plain(BLACK));
    mesh.frustum(
        (at, 0.007),
        (at + DVec3::new(0.013, 0.0, 0.007), 0.006),
        8,
        Paint::plain(LENS),
    );
}
