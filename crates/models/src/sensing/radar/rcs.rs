//! How much of a radar's wave a thing sends back: its radar cross-section (RCS), as a mean over aspects at X to K band.

use crate::flight::distractor::DistractorKind;

/// RCS of a UAV with an extent of 0.35 m [m²], and the power of the extent with which it grows: from −19 dBsm (Mavic Pro) to
/// −8 dBsm (Matrice 600), the ends of five multirotors at 24 GHz (IEICE ComEX 9 (7), 2020, 262).
const UAV_RCS_M2: f64 = 0.0123;
const UAV_EXTENT_M: f64 = 0.35;
const UAV_POWER: f64 = 1.6;
/// RCS of a bird of 0.6 m length [m²]: Skolnik, "Introduction to Radar Systems", 3rd ed. 2001, table 2.1, has 0.001 to 0.01 for
/// birds. It grows with the area.
const BIRD_RCS_M2: f64 = 0.01;
const BIRD_LENGTH_M: f64 = 0.6;
/// RCS of aircraft [m²]: the same table has 40 for a large jet, 2 for a four-seat jet, 1 for a small single-engined aeroplane, 3
/// for a helicopter; a regional aeroplane stands between.
const AIRLINER_RCS_M2: f64 = 40.0;
const TURBOPROP_RCS_M2: f64 = 15.0;
const LIGHT_AIRCRAFT_RCS_M2: f64 = 1.0;
const HELICOPTER_RCS_M2: f64 = 3.0;
/// RCS of a balloon's skin and string, and of a leaf [m²]. Chosen: no published value.
const BALLOON_RCS_M2: f64 = 1e-3;
const LEAF_RCS_M2: f64 = 1e-5;

/// Mean RCS of a UAV whose longest side is so long [m], in m².
pub fn of_uav_m2(extent_m: f64) -> f64 {
    UAV_RCS_M2 * (extent_m / UAV_EXTENT_M).powf(UAV_POWER)
}

/// Mean RCS of something else that flies [m²].
pub fn of_distractor_m2(kind: DistractorKind) -> f64 {
    match kind {
        DistractorKind::Aeroplane | DistractorKind::Contrail => AIRLINER_RCS_M2,
        DistractorKind::Turboprop => TURBOPROP_RCS_M2,
        DistractorKind::LightAircraft => LIGHT_AIRCRAFT_RCS_M2,
        DistractorKind::Helicopter => HELICOPTER_RCS_M2,
        DistractorKind::Balloon => BALLOON_RCS_M2,
        DistractorKind::Leaf => LEAF_RCS_M2,
        _ => {
            let length_m = kind.species().map_or(0.0, |species| species.length_m);
            BIRD_RCS_M2 * (length_m / BIRD_LENGTH_M).powi(2)
        }
    }
}

/// Whether parts of it move so fast that a radar sees it where the whole stands still: rotors, propellers, wings.
pub fn is_modulated(kind: DistractorKind) -> bool {
    !kind.drifts()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uavs_meet_the_published_ends_and_birds_their_range() {
        let dbsm = |rcs_m2: f64| 10.0 * rcs_m2.log10();
        assert!((dbsm(of_uav_m2(0.35)) + 19.1).abs() < 0.5);
        // A Matrice 600 is 1.67 m wide.
        assert!((dbsm(of_uav_m2(1.67)) + 8.1).abs() < 0.5);
        let birds = DistractorKind::ALL
            .into_iter()
            .filter(|kind| kind.species().is_some());
        for kind in birds {
            let rcs_m2 = of_distractor_m2(kind);
            assert!((5e-4..0.03).contains(&rcs_m2), "{kind:?}: {rcs_m2}");
            assert!(is_modulated(kind));
        }
        assert!(!is_modulated(DistractorKind::Balloon));
    }
}
