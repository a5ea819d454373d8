//! The catalogue's UAVs look as published.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use crate::catalogue;
use boresight_models::bodies::{
    Gear, Payload, RotorMount, UavMesh, UavStyle, styled_uav_mesh, uav_mesh,
};
use boresight_models::flight::shape::Shape;
use boresight_models::flight::uav::{AimPart, UavModel, aim_offset_enu_m};
use boresight_models::maths::rng::Stream;

/// The UAVs of makers and the racer, whatever has been added to the catalogue.
const SHIPPED: [&str; 6] = [
    "phantom4",
    "mavic2",
    "mavic_air",
    "matrice200",
    "matrice600",
    "fpv5",
];

/// Those that networks are judged by.
const HELD_OUT: [&str; 2] = ["hframe", "quadplane"];

fn shipped() -> impl Iterator<Item = UavModel> {
    SHIPPED.into_iter().map(uav)
}

fn uav(name: &str) -> UavModel {
    catalogue::load(name).unwrap()
}

/// Length, width and height of the body, of the body with turning propellers.
fn sizes_m(mesh: &UavMesh, radius: f64) -> [DVec3; 2] {
    let (low, high) = mesh.body.bounds_m().unwrap();
    let (mut wide_low, mut wide_high) = (low, high);
    for r in &mesh.rotors {
        let reach = DVec3::new(radius, radius, 0.0);
        wide_low = wide_low.min(r.hub_body_m - reach);
        wide_high = wide_high.max(r.hub_body_m + reach);
    }
    [high - low, wide_high - wide_low]
}

#[test]
fn sizes_match_the_published_ones() {
    for uav in shipped() {
        let (kind, mesh) = (&uav.id, uav_mesh(&uav));
        let [bare, turning] = sizes_m(&mesh, uav.propeller_diameter_m / 2.0);
        let published = DVec3::from(uav.size_m);
        let (got, want) = match &kind[..] {
            "matrice200" => (turning, published),
            // The flight model's hexagon is wider than long; the maker names no axis.
            "matrice600" => (turning, DVec3::new(published.y, published.x, published.z)),
            _ => (bare, published),
        };
        for (got, want) in got.to_array().into_iter().zip(want.to_array()) {
            assert!(
                (got / want - 1.0).abs() < 0.03,
                "{kind:?}: {got} m against {want} m"
            );
        }
    }
}

/// They are shown to no network, so that none of the shipped ones' parts are theirs.
#[test]
fn held_out_uavs_are_marked_have_their_sizes_and_a_shape_of_their_own() {
    for name in catalogue::names() {
        assert_eq!(uav(name).held_out, HELD_OUT.contains(&name), "{name}");
    }
    for uav in HELD_OUT.map(uav) {
        let (kind, mesh) = (&uav.id, uav_mesh(&uav));
        assert!(matches!(uav.shape, Shape::Own { .. }), "{kind}");
        let [bare, _] = sizes_m(&mesh, 0.0);
        let published = DVec3::from(uav.size_m);
        assert!(bare.abs_diff_eq(published, 0.001), "{kind}: {bare} m");
        for hub in mesh.rotors.iter().map(|r| r.hub_body_m.truncate()) {
            assert!(
                (hub.length() - uav.diagonal_m / 2.0).abs() < 1e-3,
                "{kind} {hub}"
            );
        }
        assert!(mesh.body.signed_volume_m3() > 0.0);
        assert!((400..=1500).contains(&mesh.body.triangle_count()), "{kind}");
    }
}

#[test]
fn hubs_lie_on_the_published_diagonal_in_the_flight_models_order() {
    for uav in shipped() {
        let (kind, mesh) = (&uav.id, uav_mesh(&uav));
        assert_eq!(mesh.rotors.len(), uav.rotor_count);
        for (i, r) in mesh.rotors.iter().enumerate() {
            let plan = r.hub_body_m.truncate();
            assert!(
                (plan.length() - uav.diagonal_m / 2.0).abs() < 1e-3,
                "{kind:?} {plan}"
            );
            let nominal = DVec2::from_angle(PI * (2 * i + 1) as f64 / uav.rotor_count as f64);
            assert!(plan.angle_to(nominal).abs() < 0.2, "{kind:?} {i} {plan}");
            assert_eq!(r.clockwise, i % 2 == 0);
        }
    }
}

#[test]
fn bodies_face_outward_within_the_triangle_budget() {
    for uav in shipped() {
        let (kind, mesh) = (&uav.id, uav_mesh(&uav));
        let total = mesh.body.triangle_count();
        assert!(
            (400..=1500).contains(&total),
            "{kind:?} has {total} triangles"
        );
        for part in [&mesh.body, &mesh.blades[0]] {
            assert!(part.signed_volume_m3() > 0.0);
            let at = |v: &[[f32; 3]], i: u32| DVec3::from(v[i as usize].map(f64::from));
            for t in part.indices.chunks_exact(3) {
                let [a, b, c] = [t[0], t[1], t[2]].map(|i| at(&part.positions, i));
                let face = (b - a).cross(c - a).normalize_or_zero();
                for &i in t {
                    assert!(face.dot(at(&part.normals, i)) > -0.2, "{kind:?} {i}");
                }
            }
        }
    }
}

#[test]
fn propellers_are_round_and_climb_into_their_turn() {
    for uav in shipped() {
        let kind = &uav.id;
        let rotor = uav_mesh(&uav).blades.swap_remove(0);
        let reach = rotor
            .positions
            .iter()
            .map(|p| f64::from(p[0]).hypot(f64::from(p[1])))
            .fold(0.0, f64::max);
        assert!(
            (reach / (uav.propeller_diameter_m / 2.0) - 1.0).abs() < 0.01,
            "{kind:?}"
        );
        // On the blade along +x the edge at +y leads a counter-clockwise turn: it is higher.
        let r = uav.propeller_diameter_m / 2.0;
        let outer: Vec<_> = rotor
            .positions
            .iter()
            .filter(|p| f64::from(p[0]) > 0.5 * r)
            .collect();
        let slope: f64 = outer
            .iter()
            .map(|p| f64::from(p[1]) * f64::from(p[2]))
            .sum();
        assert!(slope > 0.0, "{kind:?}");
    }
}

#[test]
fn parts_lie_where_the_mesh_has_them() {
    for uav in shipped() {
        let (kind, mesh) = (&uav.id, uav_mesh(&uav));
        for part in [AimPart::Battery, AimPart::RotorHub, AimPart::Camera] {
            let at = mesh.part_body_m(&uav, part);
            // Vertices on both sides of the middle, within a battery's half length.
            let near: Vec<_> = mesh
                .body
                .positions
                .iter()
                .map(|p| DVec3::from(p.map(f64::from)) - at)
                .filter(|r| r.length() < 0.11 * uav.diagonal_m.max(0.6))
                .collect();
            for axis in [DVec3::X, DVec3::Y] {
                let beyond = |sign: f64| near.iter().any(|r| sign * r.dot(axis) > 0.004);
                assert!(beyond(1.0) && beyond(-1.0), "{kind:?} {part:?}");
            }
        }
    }
}

/// Middle of the outline's box, and its width [m, body].
fn silhouette(mesh: &UavMesh) -> (DVec3, f64) {
    let outline = mesh.outline_body_m();
    let low = outline.iter().copied().fold(DVec3::MAX, DVec3::min);
    let high = outline.iter().copied().fold(DVec3::MIN, DVec3::max);
    (0.5 * (low + high), high.y - low.y)
}

#[test]
fn expected_offsets_are_the_catalogues_means() {
    for part in [
        AimPart::Body,
        AimPart::Battery,
        AimPart::RotorHub,
        AimPart::Camera,
    ] {
        let mut sum = DVec3::ZERO;
        let mut worst = 0.0_f64;
        for uav in shipped() {
            let (kind, mesh) = (&uav.id, uav_mesh(&uav));
            let (middle, span_m) = silhouette(&mesh);
            // Northbound: forward is north, left is west, up is up.
            let body = mesh.part_body_m(&uav, part) - middle;
            let enu_m = DVec3::new(-body.y, body.x, body.z);
            let expected = aim_offset_enu_m(part, span_m, DVec3::new(0.0, 12.0, 1.0));
            let error = (enu_m - expected) / span_m;
            println!(
                "{part:?} {kind:?}: {:.3} error {:.3}",
                enu_m / span_m,
                error.length()
            );
            sum += error;
            worst = worst.max(error.length());
        }
        let mean = sum / SHIPPED.len() as f64;
        println!("{part:?}: mean {mean:.3}, worst {worst:.3}");
        assert!(mean.length() < 0.01, "{part:?}: {mean}");
        assert!(worst < 0.18, "{part:?}: {worst}");
        // Without a course only the height is left.
        let still = aim_offset_enu_m(part, 1.0, DVec3::new(0.1, 0.1, 3.0));
        assert_eq!(still.truncate(), DVec2::ZERO);
    }
    // A course turns the offset with it.
    let east = aim_offset_enu_m(AimPart::Camera, 0.5, DVec3::X * 9.0);
    let north = aim_offset_enu_m(AimPart::Camera, 0.5, DVec3::Y * 9.0);
    assert!((east.x - north.y).abs() < 1e-12 && east.x > 0.05, "{east}");
}

#[test]
fn drawn_styles_repeat_and_keep_the_published_size() {
    let mut changed = 0;
    for (i, kind) in SHIPPED.into_iter().cycle().take(120).enumerate() {
        let draw = || UavStyle::drawn(&mut Stream::new(5, i as u64, "look"));
        let style = draw();
        assert_eq!(style, draw());
        let uav = uav(kind);
        let (mesh, standard) = (styled_uav_mesh(&uav, &style), uav_mesh(&uav));
        changed += usize::from(mesh.body.colors != standard.body.colors);
        assert!((0.92..1.08).contains(&style.scale));
        assert!(mesh.body.signed_volume_m3() > 0.0 && mesh.blades[0].signed_volume_m3() > 0.0);
        assert!(mesh.body.triangle_count() < 3200, "{kind:?} {style:?}");
        // Hubs and propellers grow by the scale alone.
        for (hub, reference) in mesh.rotors.iter().zip(&standard.rotors) {
            let of = |r: &RotorMount| r.hub_body_m.truncate();
            assert!((of(hub) - of(reference) * style.scale).length() < 1e-9);
        }
        let radius = uav.propeller_diameter_m / 2.0 * style.scale;
        let [_, wide] = sizes_m(&mesh, radius);
        let [_, published] = sizes_m(&standard, uav.propeller_diameter_m / 2.0);
        let slack = if style.guards { 0.08 } else { 0.03 };
        for (got, want) in [(wide.x, published.x), (wide.y, published.y)] {
            let ratio = got / want / style.scale;
            assert!(
                (0.97..1.0 + slack).contains(&ratio),
                "{kind:?} {style:?} {ratio}"
            );
        }
        // What hangs from it and stands on it stays within twice its height and a line's length.
        assert!(wide.z < style.scale * (2.2 * uav.size_m[2] + 0.95 * uav.diagonal_m));
    }
    assert!(changed > 90, "{changed}");
    let standard = styled_uav_mesh(&uav("phantom4"), &UavStyle::standard());
    assert_eq!(
        standard.body.positions,
        uav_mesh(&uav("phantom4")).body.positions
    );
}

#[test]
fn styles_show_what_they_name() {
    let lowest = |style: UavStyle| {
        let mesh = styled_uav_mesh(&uav("phantom4"), &style);
        mesh.body.bounds_m().map_or(0.0, |(low, _)| low.z)
    };
    let standard = UavStyle::standard();
    let with = |gear, payload| {
        lowest(UavStyle {
            gear,
            payload,
            ..standard
        })
    };
    let raised = with(Gear::Raised, Payload::None);
    assert!(raised > with(Gear::Lowered, Payload::None) + 0.02);
    assert!(with(Gear::Skids, Payload::None) < raised - 0.01);
    assert!(with(Gear::Raised, Payload::Box) < raised - 0.05);
    assert!(with(Gear::Raised, Payload::Parcel) < raised - 0.2);
    let three = styled_uav_mesh(
        &uav("fpv5"),
        &UavStyle {
            blades: 3,
            ..standard
        },
    )
    .blades
    .swap_remove(0);
    let two = uav_mesh(&uav("fpv5")).blades.swap_remove(0);
    assert!(three.triangle_count() > two.triangle_count());
}
