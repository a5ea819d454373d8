//! Conduction against Carslaw and Jaeger, energy, burning through, and light on a plate.

use super::grid::HeatGrid;
use super::material::{ABS, Material, POLYCARBONATE};
use super::skin::Layer;
use super::*;
use crate::laser::propagation::{Across, Shape};
use crate::shape::mesh::MeshData;
use glam::{DQuat, DVec2, DVec3};
use std::f64::consts::{FRAC_PI_2, PI};

const AIR_K: f64 = 293.15;
const STILL: Film = Film {
    air_k: AIR_K,
    wind_mps: 10.0,
    length_m: 0.2,
};

/// Conducts alike in all directions, neither radiates nor leaves.
const BLOCK: Material = Material {
    name: "block",
    density_kgpm3: 2200.0,
    specific_heat_jpkgk: 1000.0,
    through_wpmk: 5.0,
    along_wpmk: 5.0,
    emissivity: 0.0,
    absorptivity: 1.0,
    absorptivity_per_k: 0.0,
    chars: false,
    softens_k: 1e6,
    ablates_k: 1e6,
    ablation_jpkg: 1.0,
};
const DULL_ABS: Material = Material {
    emissivity: 0.0,
    ..ABS
};
const DULL_PC: Material = Material {
    emissivity: 0.0,
    ..POLYCARBONATE
};

const fn single(layers: &'static [Layer]) -> Skin {
    Skin {
        name: "test",
        layers,
        is_painted: false,
        fails_at: (0, 0.5),
        limit_k: 400.0,
    }
}

const THICK: Skin = single(&[Layer {
    material: &BLOCK,
    thickness_m: 4.8e-3,
    gap_m: 0.0,
}]);
const SLAB: Skin = single(&[Layer {
    material: &DULL_ABS,
    thickness_m: 2e-3,
    gap_m: 0.0,
}]);
const WALL: Skin = single(&[Layer {
    material: &DULL_PC,
    thickness_m: 1.5e-3,
    gap_m: 0.0,
}]);

fn grid(skin: &Skin, side: usize, cell_m: f64) -> HeatGrid {
    HeatGrid::new(skin, 1.0, cell_m, vec![true; side * side], AIR_K)
}

/// Integral of the complementary error function from `z` on.
fn ierfc(z: f64) -> f64 {
    // ierfc(z) = 2/sqrt(pi) times the integral of (s - z) exp(-s²) from z on.
    let step = 1e-4;
    let terms = (0..80_000).map(|i| {
        let s = (f64::from(i) + 0.5) * step;
        s * (-(s + z).powi(2)).exp() * step
    });
    2.0 / PI.sqrt() * terms.sum::<f64>()
}

#[test]
fn a_thick_wall_under_a_steady_flux_warms_as_carslaw_and_jaeger_say() {
    // Conduction of Heat in Solids, 2nd ed., 2.9 (7): 2 q sqrt(alpha t)/k ierfc(x/(2 sqrt(alpha t))).
    let (flux_wpm2, dt_s, steps) = (4e4, 0.01, 150);
    let mut wall = grid(&SLAB, 1, 1.0);
    for _ in 0..steps {
        wall.dose_jpm2()[0] = flux_wpm2 * dt_s;
        wall.advance(dt_s, AIR_K, 0.0);
    }
    let alpha = ABS.through_wpmk / ABS.capacity_jpm3k();
    let spread_m = (alpha * dt_s * f64::from(steps)).sqrt();
    // The first cell's middle lies half of a quarter of a millimetre deep.
    let exact_k =
        2.0 * flux_wpm2 * spread_m / ABS.through_wpmk * ierfc(0.125e-3 / (2.0 * spread_m));
    let found_k = wall.face_k(0).expect("a face") - AIR_K;
    assert!(
        (found_k / exact_k - 1.0).abs() < 0.02,
        "{found_k} {exact_k}"
    );
}

#[test]
fn a_steady_gaussian_spot_on_a_block_warms_as_carslaw_and_jaeger_say() {
    // 10.5 (for exp(-r²/a²) at the middle): q a/(k sqrt(pi)) atan(sqrt(4 alpha t)/a).
    let (peak_wpm2, w_m, cell_m, side) = (1e5_f64, 6e-3_f64, 1e-3, 25);
    let (dt_s, steps) = (0.005, 100);
    let mut block = grid(&THICK, side, cell_m);
    let off_m = |at: usize| cell_m * (at as f64 - 0.5 * (side - 1) as f64);
    for _ in 0..steps {
        for column in 0..side * side {
            let r2_m2 = off_m(column % side).powi(2) + off_m(column / side).powi(2);
            block.dose_jpm2()[column] = dt_s * peak_wpm2 * (-2.0 * r2_m2 / (w_m * w_m)).exp();
        }
        block.advance(dt_s, AIR_K, 0.0);
    }
    let alpha = BLOCK.through_wpmk / BLOCK.capacity_jpm3k();
    let a_m = w_m / 2f64.sqrt();
    let t_s = dt_s * f64::from(steps);
    let exact_k = peak_wpm2 * a_m / (BLOCK.through_wpmk * PI.sqrt())
        * ((4.0 * alpha * t_s).sqrt() / a_m).atan();
    // The face lies half a cell of 0.6 mm above the first middle.
    let face_k = peak_wpm2 * 0.3e-3 / BLOCK.through_wpmk;
    let found_k = block.hottest_k() - AIR_K + face_k;
    assert!(
        (found_k / exact_k - 1.0).abs() < 0.03,
        "{found_k} {exact_k}"
    );
}

#[test]
fn heat_spreads_along_a_sheet_by_twice_its_diffusivity() {
    let (side, cell_m, w_m) = (41, 2e-3, 8e-3_f64);
    let mut sheet = grid(&ALUMINIUM, side, cell_m);
    let off_m = |at: usize| cell_m * (at as f64 - 0.5 * (side - 1) as f64);
    for column in 0..side * side {
        let r2_m2 = off_m(column % side).powi(2) + off_m(column / side).powi(2);
        sheet.dose_jpm2()[column] = 2e5 * (-2.0 * r2_m2 / (w_m * w_m)).exp();
    }
    // Variance about an axis of what has been warmed [m²].
    let variance_m2 = |sheet: &HeatGrid| {
        let excess = |column: usize| sheet.face_k(column).expect("a face") - AIR_K;
        let (sum, moment) = (0..side * side).fold((0.0, 0.0), |(sum, moment), column| {
            let e = excess(column);
            (sum + e, moment + e * off_m(column % side).powi(2))
        });
        moment / sum
    };
    sheet.advance(1e-6, AIR_K, 0.0);
    let before_m2 = variance_m2(&sheet);
    for _ in 0..20 {
        sheet.advance(0.01, AIR_K, 0.0);
    }
    let grown_m2 = variance_m2(&sheet) - before_m2;
    let expected_m2 = 2.0 * 167.0 / (2700.0 * 896.0) * 0.2;
    assert!(
        (grown_m2 / expected_m2 - 1.0).abs() < 0.02,
        "{grown_m2} {expected_m2}"
    );
}

#[test]
fn energy_is_kept_while_a_wall_burns() {
    let mut wall = HeatGrid::new(&SHELLED_POUCH, 0.25, 2e-3, vec![true; 81], AIR_K);
    let before_j = wall.heat_j();
    for _ in 0..200 {
        for column in 0..81 {
            let off = |at: usize| at as f64 - 4.0;
            let r2 = off(column % 9).powi(2) + off(column / 9).powi(2);
            wall.dose_jpm2()[column] = 5e4 * (-r2 / 8.0).exp();
        }
        wall.step(1.0 / 60.0, &STILL);
    }
    let [absorbed_j, lost_j, gone_j] = wall.spent_j;
    let kept_j = wall.heat_j() - before_j;
    assert!(wall.hole_m2() > 0.0 && lost_j > 0.0 && gone_j > 0.0);
    // What leaves takes its heat from 0 K on with it.
    let balance_j = absorbed_j - lost_j - gone_j - kept_j;
    assert!(
        balance_j.abs() < 1e-9 * absorbed_j,
        "{balance_j} {absorbed_j}"
    );
}

#[test]
fn a_wide_beam_burns_through_when_its_energy_says() {
    let (flux_wpm2, dt_s) = (3e6, 1.0 / 60.0);
    let mut wall = grid(&WALL, 1, 1.0);
    let mut t_s = 0.0;
    while wall.hole_m2() == 0.0 && t_s < 10.0 {
        wall.dose_jpm2()[0] = flux_wpm2 * dt_s;
        wall.advance(dt_s, AIR_K, 0.0);
        t_s += dt_s;
    }
    let each_jpkg = POLYCARBONATE.specific_heat_jpkgk * (POLYCARBONATE.ablates_k - AIR_K)
        + POLYCARBONATE.ablation_jpkg;
    let energy_jpm2 = POLYCARBONATE.density_kgpm3 * 1.5e-3 * each_jpkg;
    // It turns black at once and absorbs nine tenths from then on.
    let expected_s = energy_jpm2 / (0.9 * flux_wpm2);
    assert!((t_s / expected_s - 1.0).abs() < 0.05, "{t_s} {expected_s}");
}

#[test]
fn paint_and_wavelength_decide_how_much_is_absorbed() {
    let of = |albedo: f64, wavelength_m: f64| ABS_SHELL.absorptivity(albedo, wavelength_m);
    assert!((of(0.78, 1.064e-6) - 0.22).abs() < 1e-12);
    assert!((of(0.04, 1.064e-6) - 0.93).abs() < 1e-12);
    assert!((of(0.78, 2e-6) - 0.9).abs() < 1e-12);
    assert!(of(0.78, 1.6e-6) > 0.5 && of(0.78, 1.6e-6) < 0.6);
    assert_eq!(CARBON_EPOXY.absorptivity(0.78, 1.064e-6), 0.8);
}

#[test]
fn a_hollow_arm_fails_by_its_wall() {
    let arm = ABS_SHELL.before(Room::Hollow);
    assert_eq!((arm.layers.len(), arm.limit_k), (1, 378.0));
    assert_eq!(ABS_SHELL.before(Room::Board), ABS_SHELL);
    // A cell has no room behind it.
    assert_eq!(LIPO_POUCH.before(Room::Hollow), LIPO_POUCH);
}

/// A plate of half a side [m] across the x axis at a place.
fn plate(x_m: f32, half_m: f32) -> MeshData {
    let corner = |y: f32, z: f32| [x_m, y * half_m, z * half_m];
    MeshData {
        origin_enu_m: DVec3::ZERO,
        positions: vec![
            corner(-1.0, -1.0),
            corner(1.0, -1.0),
            corner(1.0, 1.0),
            corner(-1.0, 1.0),
        ],
        normals: vec![[-1.0, 0.0, 0.0]; 4],
        colors: vec![[0.78, 0.78, 0.78, 1.0]; 4],
        uv: vec![[0.0; 2]; 4],
        surface: vec![[0.0; 2]; 4],
        indices: vec![0, 2, 1, 0, 3, 2],
    }
}

fn spot(radius_m: f64) -> Across {
    Across {
        power_w: 1000.0,
        centre_m: DVec2::ZERO,
        shape: Shape::Gaussian { radius_m },
        relative: 1.0,
    }
}

/// A beam along x, turned about z.
fn beam(across: &Across, turned_rad: f64) -> Falls<'_> {
    let turn = DQuat::from_rotation_z(turned_rad);
    Falls {
        across,
        origin_m: DVec2::ZERO,
        axes_body: [-DVec3::Y, -DVec3::Z, DVec3::X].map(|axis| turn * axis),
        dt_s: 1e-3,
    }
}

fn struck() -> Struck {
    Struck {
        skin: ABS_SHELL,
        effect: Effect::PowerLost,
        part: "body",
        turns: false,
    }
}

#[test]
fn all_light_on_a_plate_is_counted_once() {
    let hull = Hull::new(&plate(0.0, 0.2)).expect("a plate");
    let across = spot(0.01);
    for turned_rad in [0.0, 0.6] {
        let falls = beam(&across, turned_rad);
        let meets = falls.meets(&hull).expect("it meets");
        assert!((meets.cosine - turned_rad.cos()).abs() < 1e-5);
        let mut patch = Patch::new(&falls, &meets, &hull, struck(), 1.064e-6, AIR_K);
        patch.light(&falls);
        let cell_m2 = patch.grid.cell_m.powi(2);
        let sum_j = patch.grid.dose_jpm2().iter().sum::<f64>() * cell_m2;
        // On the slanting plate a square metre takes the cosine's share.
        let expected_j = 1.0 * turned_rad.cos();
        assert!(
            (sum_j / expected_j - 1.0).abs() < 2e-3,
            "{sum_j} {expected_j}"
        );
        // Turned on within limits it stays the same patch, which still catches all.
        let further = beam(&across, turned_rad + 0.5);
        assert!(patch.holds(&further));
        assert!(!patch.holds(&beam(&across, turned_rad + 1.2)));
        patch.grid.dose_jpm2().fill(0.0);
        patch.light(&further);
        let still_j = patch.grid.dose_jpm2().iter().sum::<f64>() * cell_m2;
        assert!((still_j / sum_j - 1.0).abs() < 5e-3, "{still_j}");
    }
}

#[test]
fn light_goes_round_a_bell_that_turns() {
    let hull = Hull::new(&plate(0.0, 0.015)).expect("a plate");
    let across = spot(0.006);
    let falls = beam(&across, 0.0);
    let meets = falls.meets(&hull).expect("it meets");
    let bell = Struck {
        skin: MOTOR_BELL,
        effect: Effect::RotorOut(0),
        part: "motor",
        turns: true,
    };
    let mut patch = Patch::new(&falls, &meets, &hull, bell, 1.064e-6, AIR_K);
    patch.light(&falls);
    patch.light(&falls);
    let side = patch.grid.side;
    let cell_m2 = patch.grid.cell_m.powi(2);
    let dose = patch.grid.dose_jpm2().to_vec();
    // Two ticks of a joule over pi times the width that shows.
    let sum_j = dose.iter().sum::<f64>() * cell_m2;
    assert!((sum_j * PI / 2.0 - 1.0).abs() < 5e-3, "{sum_j}");
    let there = (0..side).filter(|at| patch.grid.is_there(side / 2 * side + at));
    let row: Vec<f64> = there.map(|at| dose[side / 2 * side + at]).collect();
    assert!(row.len() > 10 && row.iter().all(|value| *value == row[0]));
}

#[test]
fn light_beside_an_edge_passes_and_the_paint_counts() {
    let hull = Hull::new(&plate(0.0, 0.02)).expect("a plate");
    let across = spot(0.01);
    let mut falls = beam(&across, 0.0);
    // The plate's right edge lies in the middle of the beam.
    falls.origin_m = DVec2::new(-0.02, 0.0);
    let meets = falls.meets(&hull).expect("half of it meets");
    let mut patch = Patch::new(&falls, &meets, &hull, struck(), 1.064e-6, AIR_K);
    patch.light(&falls);
    let cell_m2 = patch.grid.cell_m.powi(2);
    let sum_j = patch.grid.dose_jpm2().iter().sum::<f64>() * cell_m2;
    assert!((sum_j - 0.5).abs() < 0.06, "{sum_j}");
    // What has passed is no part of the wall; white absorbs 22 %.
    let mut there = 0..patch.grid.side * patch.grid.side;
    assert!(there.any(|column| !patch.grid.is_there(column)));
    patch.step(1e-3, &STILL);
    assert!((patch.grid.spent_j[0] / sum_j - 0.22).abs() < 1e-3);
}

/// Time until a board behind an ABS shell fails in a beam of a radius [m]; infinite beyond half a minute.
fn fails_s(radius_m: f64) -> f64 {
    let hull = Hull::new(&plate(0.0, 0.2)).expect("a plate");
    let across = spot(radius_m);
    let falls = Falls {
        dt_s: 1.0 / 60.0,
        ..beam(&across, 0.0)
    };
    let meets = falls.meets(&hull).expect("it meets");
    let mut patch = Patch::new(&falls, &meets, &hull, struck(), 1.064e-6, AIR_K);
    for step in 1..=1800 {
        patch.light(&falls);
        if patch.step(1.0 / 60.0, &STILL) {
            return f64::from(step) / 60.0;
        }
    }
    f64::INFINITY
}

#[test]
fn the_spot_decides_how_long_it_takes() {
    let found_s = [0.008, 0.015, 0.03, 0.06].map(fails_s);
    let [tight, fair, wide, broad] = found_s;
    assert!(tight > 0.2 && tight < fair && fair < wide && wide < broad);
    assert!(wide > 3.0 * fair, "{found_s:?}");
    // The shell's energy at the middle of the beam bounds it from below.
    let peak = 2.0 * 1000.0 / (PI * 0.03 * 0.03);
    assert!(wide > ABS_SHELL.energy_jpm2(AIR_K) / peak, "{wide}");
}

#[test]
fn a_ray_strikes_the_part_it_passes() {
    let hub_m = 0.12;
    let hubs = [1.0, 3.0, 5.0, 7.0].map(|k: f64| {
        let way = DVec2::from_angle(k * FRAC_PI_2 / 2.0);
        (way * hub_m * 2f64.sqrt()).extend(0.02)
    });
    let parts = Parts {
        battery: (DVec3::new(-0.07, 0.0, 0.0), SHELLED_POUCH),
        camera: (DVec3::new(0.055, 0.0, -0.078), POLYCARBONATE_SHELL),
        hubs: (hubs.to_vec(), MOTOR_BELL),
        body: ABS_SHELL,
        arms: ABS_SHELL,
        diagonal_m: 0.34,
    };
    // Looking to the left, from the right side.
    let with = |lost: Option<Effect>, [x_m, y_m, z_m]: [f64; 3]| {
        let meets = Meets {
            r_body_m: DVec3::new(x_m, y_m, z_m),
            along_m: 1.0,
            cosine: 1.0,
            albedo: 0.5,
        };
        parts.struck(&meets, DVec3::Y, |effect| Some(effect) == lost)
    };
    let struck_at = |x_m, y_m, z_m| with(None, [x_m, y_m, z_m]);
    assert_eq!(struck_at(0.12, -0.13, 0.02).effect, Effect::RotorOut(3));
    assert_eq!(struck_at(0.055, -0.02, -0.08).effect, Effect::CameraBlind);
    assert_eq!(struck_at(-0.07, -0.04, 0.0).part, "battery");
    let arm = struck_at(0.08, -0.085, 0.01);
    assert_eq!((arm.part, arm.effect), ("arm", Effect::RotorOut(3)));
    assert_eq!(struck_at(0.02, -0.05, 0.03).part, "body");
    // Behind what is gone is the hull, or what lies in it.
    let behind = |lost, at_m| with(Some(lost), at_m).effect;
    assert_eq!(
        behind(Effect::CameraBlind, [0.055, -0.02, -0.08]),
        Effect::PowerLost
    );
    assert_eq!(
        behind(Effect::RotorOut(3), [0.08, -0.085, 0.01]),
        Effect::PowerLost
    );
    assert_eq!(
        behind(Effect::RotorOut(0), [0.12, -0.13, 0.02]),
        Effect::RotorOut(3)
    );
}
