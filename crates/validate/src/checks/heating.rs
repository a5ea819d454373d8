//! Heat in the walls of a target.

use crate::check::{Check, Fault, Tolerance, a_fifth_more, times};
use boresight_models::laser::target::{Film, HeatGrid, Layer, Material, Skin, material};
use std::f64::consts::PI;

const AIR_K: f64 = 293.15; // [K]

/// Conducts alike in all directions; neither radiates nor leaves.
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
const ABS: Material = Material {
    emissivity: 0.0,
    ..material::ABS
};
const POLYCARBONATE: Material = Material {
    emissivity: 0.0,
    ..material::POLYCARBONATE
};

const SLAB: Skin = wall(&[of(&ABS, 2e-3)]);
const THICK: Skin = wall(&[of(&BLOCK, 4.8e-3)]);
const SHELL: Skin = wall(&[of(&POLYCARBONATE, 1.5e-3)]);

const fn wall(layers: &'static [Layer]) -> Skin {
    Skin {
        name: "wall",
        layers,
        is_painted: false,
        fails_at: (0, 0.5),
        limit_k: 400.0,
    }
}

const fn of(material: &'static Material, thickness_m: f64) -> Layer {
    Layer {
        material,
        thickness_m,
        gap_m: 0.0,
    }
}

/// A grid of a wall, cold; `absorptivity` of its face.
fn grid(skin: &Skin, absorptivity: f64, side: usize, cell_m: f64) -> HeatGrid {
    HeatGrid::new(skin, absorptivity, cell_m, vec![true; side * side], AIR_K)
}

fn no_face() -> Fault {
    Fault::Model("nothing is left of the wall".into())
}

/// Rise of a thick ABS wall an eighth of a millimetre deep after 1.5 s under 8 W/cm² [K].
fn thick_k(absorptivity: f64) -> Result<f64, Fault> {
    const DT_S: f64 = 0.01; // [s]
    let mut wall = grid(&SLAB, absorptivity, 1, 1.0);
    for _ in 0..150 {
        wall.dose_jpm2()[0] = 8e4 * DT_S;
        wall.advance(DT_S, AIR_K, 0.0);
    }
    Ok(wall.face_k(0).ok_or_else(no_face)? - AIR_K)
}

/// Rise of the face of a block in the middle of a Gaussian spot of 6 mm after 0.5 s [K]; 20 W/cm² in its middle.
fn spot_k(absorptivity: f64) -> Result<f64, Fault> {
    const DT_S: f64 = 0.005; // [s]
    const SIDE: usize = 25;
    let mut block = grid(&THICK, absorptivity, SIDE, 1e-3);
    let off_mm = |at: usize| at as f64 - 12.0;
    for _ in 0..100 {
        for (column, dose) in block.dose_jpm2().iter_mut().enumerate() {
            let r2_mm2 = off_mm(column % SIDE).powi(2) + off_mm(column / SIDE).powi(2);
            *dose = DT_S * 2e5 * (-2.0 * r2_mm2 / 36.0).exp();
        }
        block.advance(DT_S, AIR_K, 0.0);
    }
    // The face lies half a cell of 0.6 mm above the first middle.
    Ok(block.hottest_k() - AIR_K + absorptivity * 2e5 * 0.3e-3 / BLOCK.through_wpmk)
}

/// Time to burn through 1.5 mm of polycarbonate under 300 W/cm² times so much [s].
fn through_s(more: f64) -> f64 {
    const DT_S: f64 = 1.0 / 60.0; // [s]
    let mut wall = grid(&SHELL, 0.9, 1, 1.0);
    let mut t_s = 0.0;
    while wall.hole_m2() == 0.0 && t_s < 20.0 {
        wall.dose_jpm2()[0] = more * 3e6 * DT_S;
        wall.advance(DT_S, AIR_K, 0.0);
        t_s += DT_S;
    }
    t_s
}

/// Coefficient of convection of a plate of 0.2 m, so much warmer than the air, in a wind [W/(m² K)].
fn convection_wpm2k(excess_k: f64, wind_mps: f64) -> f64 {
    let film = Film {
        air_k: AIR_K,
        wind_mps,
        length_m: 0.2,
    };
    film.convection_wpm2k(AIR_K + excess_k)
}

pub fn checks() -> Vec<Check> {
    const INCROPERA: &str = "Incropera et al., 7th ed., air at 293 K by tables, by hand";
    const JAEGER: &str = "Carslaw and Jaeger, 2nd ed.";
    let through_jpkg = POLYCARBONATE.specific_heat_jpkgk * (POLYCARBONATE.ablates_k - AIR_K)
        + POLYCARBONATE.ablation_jpkg;
    vec![
        Check {
            model: "skin-heating",
            name: "forced convection, plate of 0.2 m in 10 m/s",
            reference: INCROPERA,
            value: 27.66,
            unit: "W/(m² K)",
            tolerance: Tolerance::Relative(0.02),
            mutation: a_fifth_more("wind"),
            run: |scale| Ok(convection_wpm2k(50.0, scale.of(10.0))),
        },
        Check {
            model: "skin-heating",
            name: "natural convection, plate of 0.2 m, 50 K warmer than the air",
            reference: INCROPERA,
            value: 6.08,
            unit: "W/(m² K)",
            tolerance: Tolerance::Relative(0.02),
            mutation: times("excess temperature", 1.5),
            run: |scale| Ok(convection_wpm2k(scale.of(50.0), 0.0)),
        },
        Check {
            model: "skin-heating",
            name: "thick ABS wall that absorbs 4 W/cm², 0.125 mm deep after 1.5 s",
            reference: JAEGER,
            value: thick_reference_k(),
            unit: "K",
            tolerance: Tolerance::Relative(0.02),
            mutation: a_fifth_more("absorptivity"),
            run: |scale| thick_k(scale.of(0.5)),
        },
        Check {
            model: "skin-heating",
            name: "block under a Gaussian spot of 6 mm, its face after 0.5 s",
            reference: JAEGER,
            value: spot_reference_k(),
            unit: "K",
            tolerance: Tolerance::Relative(0.03),
            mutation: a_fifth_more("absorptivity"),
            run: |scale| spot_k(scale.of(0.5)),
        },
        Check {
            model: "skin-heating",
            name: "burning through 1.5 mm of polycarbonate under 300 W/cm²",
            reference: "heat to gasify it, over what char absorbs",
            value: POLYCARBONATE.density_kgpm3 * 1.5e-3 * through_jpkg / (0.9 * 3e6),
            unit: "s",
            tolerance: Tolerance::Relative(0.05),
            mutation: a_fifth_more("irradiance"),
            run: |scale| Ok(through_s(scale.of(1.0))),
        },
    ]
}

/// 2 q sqrt(αt)/k ierfc(x/(2 sqrt(αt))) (2.9, eq. 7), the integral by the midpoint rule.
fn thick_reference_k() -> f64 {
    let alpha = ABS.through_wpmk / ABS.capacity_jpm3k();
    let spread_m = (alpha * 1.5).sqrt();
    let z = 0.125e-3 / (2.0 * spread_m);
    const STEP: f64 = 1e-4;
    let terms = (0..80_000).map(|i| {
        let s = (f64::from(i) + 0.5) * STEP;
        s * (-(s + z).powi(2)).exp() * STEP
    });
    let ierfc = 2.0 / PI.sqrt() * terms.sum::<f64>();
    2.0 * 4e4 * spread_m / ABS.through_wpmk * ierfc
}

/// q a/(k sqrt(π)) atan(sqrt(4αt)/a) in the middle of exp(-r²/a²) (10.5).
fn spot_reference_k() -> f64 {
    let alpha = BLOCK.through_wpmk / BLOCK.capacity_jpm3k();
    let a_m = 6e-3 / 2f64.sqrt();
    1e5 * a_m / (BLOCK.through_wpmk * PI.sqrt()) * ((4.0 * alpha * 0.5).sqrt() / a_m).atan()
}
