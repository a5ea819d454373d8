use super::*;
use crate::flight::bird::Species;
use crate::flight::distractor::DistractorKind;
use crate::maths::rng::Stream;

/// Corners of the box around body and moving parts at phases [rad].
fn bounds_m(mesh: &UavMesh, phase_rad: &[f64]) -> [DVec3; 2] {
    let point = |p: &[f32; 3]| DVec3::from(p.map(f64::from));
    let (mut low, mut high) = mesh.body.bounds_m().unwrap();
    for (blade, at) in mesh.blades_at(phase_rad) {
        for p in blade.positions.iter().map(point) {
            let p = at.transform_point3(p);
            (low, high) = (low.min(p), high.max(p));
        }
    }
    [low, high]
}

#[test]
fn distractors_have_their_sizes() {
    for kind in DistractorKind::ALL {
        let mesh = distractor_mesh(kind);
        let [length_m, width_m, height_m] = kind.size_m();
        // Wings stretched level; a helicopter's four blades along and across.
        let [low, high] = bounds_m(&mesh, &[0.0; 4]);
        let got = high - low;
        for (got_m, want_m, slack) in [
            (got.x, length_m, 0.13),
            (got.y, width_m, 0.02),
            (
                got.z,
                height_m,
                if kind.species().is_some() { 0.7 } else { 0.13 },
            ),
        ] {
            let ratio = got_m / want_m;
            assert!(
                (ratio - 1.0).abs() < slack,
                "{kind:?}: {got_m} for {want_m} m"
            );
        }
        for part in mesh.blades.iter().chain([&mesh.body]) {
            assert!(part.signed_volume_m3() > 0.0, "{kind:?}");
            assert!(part.positions.iter().flatten().all(|x| x.is_finite()));
        }
        assert!(mesh.body.triangle_count() < 1500, "{kind:?}");
        // Whatever the phases, the outline's box holds it.
        let outline = mesh.outline_body_m();
        let reach = |axis: DVec3| outline.iter().map(|p| p.dot(axis)).fold(f64::MIN, f64::max);
        for k in 0..50 {
            let phases = kind.phases_rad(0.11 * f64::from(k), 0.3);
            let [low, high] = bounds_m(&mesh, &phases);
            for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                let slack_m = 0.03 * width_m;
                assert!(high.dot(axis) < reach(axis) + slack_m, "{kind:?} {axis}");
                assert!(-low.dot(axis) < reach(-axis) + slack_m, "{kind:?} {axis}");
            }
        }
    }
}

#[test]
fn wings_beat_alike_on_both_sides_and_bend_at_the_wrist() {
    let gull = DistractorKind::Bird;
    let mesh = distractor_mesh(gull);
    let tips = |arm_rad: f64, hand_rad: f64| {
        let phases = Species::joints(arm_rad, hand_rad);
        let placed = mesh.blades_at(&phases);
        // The outer end of each hand.
        [2, 3].map(|hand| {
            let (blade, at) = &placed[hand];
            let points = blade
                .positions
                .iter()
                .map(|p| DVec3::from(p.map(f64::from)));
            let tip = points
                .max_by(|a, b| a.x.abs().total_cmp(&b.x.abs()))
                .unwrap();
            at.transform_point3(tip)
        })
    };
    for (arm, hand) in [(0.0, 0.0), (0.5, 0.2), (-0.4, -0.3)] {
        let [left, right] = tips(arm, hand);
        let mirrored = DVec3::new(left.x, -left.y, left.z);
        assert!((mirrored - right).length() < 1e-6, "{left} {right}");
    }
    assert!(tips(0.3, 0.0)[0].z > tips(0.0, 0.0)[0].z + 0.1);
    assert!(tips(0.3, 0.3)[0].z > tips(0.3, 0.0)[0].z + 0.05);
    // Its tips lie behind its shoulders, its wings' undersides are bright.
    assert!(tips(0.0, 0.0)[0].x < -0.02);
    let arm = &mesh.blades[0];
    let tone = |above: bool| {
        let side = arm.positions.iter().zip(&arm.colors);
        let of: Vec<f32> = (side.filter(|(p, _)| (p[1] > 0.0) == above))
            .map(|(_, c)| c[0])
            .collect();
        of.iter().sum::<f32>() / of.len() as f32
    };
    assert!(
        tone(false) > 1.1 * tone(true),
        "{} {}",
        tone(false),
        tone(true)
    );
}

#[test]
fn aircraft_face_outward() {
    for kind in [
        DistractorKind::Aeroplane,
        DistractorKind::Contrail,
        DistractorKind::Turboprop,
        DistractorKind::LightAircraft,
        DistractorKind::Helicopter,
    ] {
        let mesh = distractor_mesh(kind);
        let at = |v: &[[f32; 3]], i: u32| DVec3::from(v[i as usize].map(f64::from));
        for part in mesh.blades.iter().chain([&mesh.body]) {
            for t in part.indices.chunks_exact(3) {
                let [a, b, c] = [t[0], t[1], t[2]].map(|i| at(&part.positions, i));
                let face = (b - a).cross(c - a).normalize_or_zero();
                for &i in t {
                    assert!(face.dot(at(&part.normals, i)) > -0.2, "{kind:?}");
                }
            }
        }
    }
}

#[test]
fn drawn_distractors_vary_and_repeat() {
    for (kind, [least, most], varies) in [
        (DistractorKind::Bird, [1.1, 1.6], 1.2),
        (DistractorKind::Raptor, [1.0, 1.5], 1.2),
        (DistractorKind::Balloon, [0.2, 1.1], 1.8),
        (DistractorKind::Aeroplane, [34.0, 71.0], 1.5),
        (DistractorKind::Contrail, [150.0, 540.0], 1.8),
        (DistractorKind::Turboprop, [18.0, 35.0], 1.5),
        (DistractorKind::LightAircraft, [7.0, 16.0], 1.5),
        (DistractorKind::Helicopter, [8.0, 19.0], 1.7),
        (DistractorKind::Leaf, [0.02, 0.36], 1.8),
    ] {
        let mut widths = Vec::new();
        for i in 0..40 {
            let draw = || drawn_distractor_mesh(kind, &mut Stream::new(3, i, "distractor"));
            let mesh = draw();
            assert_eq!(mesh.body.positions, draw().body.positions);
            assert!(mesh.body.signed_volume_m3() > 0.0, "{kind:?} {i}");
            let outline = mesh.outline_body_m();
            let across = |axis: DVec3| {
                let reach = outline.iter().map(|p| p.dot(axis));
                reach.clone().fold(f64::MIN, f64::max) - reach.fold(f64::MAX, f64::min)
            };
            let width = across(DVec3::Y).max(across(DVec3::X));
            assert!((least..most).contains(&width), "{kind:?} {width} m");
            widths.push(width);
        }
        let (low, high) = (
            widths.iter().copied().fold(f64::MAX, f64::min),
            widths.iter().copied().fold(0.0, f64::max),
        );
        assert!(high > varies * low, "{kind:?}: {low} to {high} m");
    }
}
