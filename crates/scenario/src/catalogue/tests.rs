mod flight;
mod mesh;

use super::*;
use boresight_models::bodies::uav_mesh;
use boresight_models::flight::uav::AimPart;
use boresight_models::laser::target;
use boresight_models::maths::kinematics::GRAVITY_MPS2;
use proptest::prelude::*;

const PHANTOM: &str = include_str!("../../../../assets/uavs/phantom4.toml");

/// The error of a text beside which there are no files; empty if it has none.
fn error(text: &str) -> String {
    let none = |_: &Path| Err(io::Error::from(io::ErrorKind::NotFound));
    let parsed = parse(text, "own", "own.toml", none);
    parsed
        .err()
        .map(|error| error.to_string())
        .unwrap_or_default()
}

/// The error of the Phantom with a part of its text replaced, and the line where it should be.
fn refused(from: &str, to: &str) -> String {
    assert!(PHANTOM.contains(from), "{from}");
    error(&PHANTOM.replacen(from, to, 1))
}

#[test]
fn a_file_becomes_a_model_in_si_units() {
    let uav = load("phantom4").unwrap();
    assert_eq!(
        (uav.id.as_str(), uav.name.as_str()),
        ("phantom4", "DJI Phantom 4")
    );
    assert_eq!(uav.class, ObjectClass::Quadcopter);
    assert_eq!(
        (uav.rotor_count, uav.mass_kg, uav.rotor_lag_s),
        (4, 1.38, 0.035)
    );
    assert_eq!(uav.propeller_diameter_m, 9.4 * 0.0254);
    assert_eq!(uav.max_tilt_rad, 42.0_f64.to_radians());
    assert_eq!(uav.max_rate_radps, 250.0_f64.to_radians());
    assert_eq!(uav.battery.at_body_m, DVec3::new(-0.07, 0.0, 0.004));
    assert_eq!(uav.part_skin(AimPart::Battery), target::SHELLED_POUCH);
    assert_eq!(uav.part_skin(AimPart::RotorHub), target::MOTOR_BELL);
    assert!(matches!(uav.shape, Shape::Frame(Frame::Phantom)));
    // A racer's battery is strapped on bare; its body is of carbon.
    let racer = load("fpv5").unwrap();
    assert_eq!(racer.part_skin(AimPart::Battery), target::LIPO_POUCH);
    assert_eq!(racer.part_skin(AimPart::Body), target::CARBON_EPOXY);
}

#[test]
fn the_catalogue_is_possible() {
    assert!(names().len() >= 6 && names().is_sorted());
    for name in names() {
        let uav = load(name).unwrap();
        // All the mass lies within half the largest size.
        let reach_m = uav.size_m.iter().copied().fold(uav.diagonal_m, f64::max) / 2.0;
        assert!(
            uav.inertia_kgm2[2] < uav.mass_kg * reach_m * reach_m,
            "{name}"
        );
        let mesh = uav_mesh(&uav);
        assert_eq!(mesh.rotors.len(), uav.rotor_count, "{name}");
        assert!(mesh.body.triangle_count() > 0, "{name}");
    }
}

#[test]
fn drag_area_closes_the_balance_at_top_speed() {
    for name in names() {
        let uav = load(name).unwrap();
        let drag_n = 0.5 * 1.225 * uav.drag_area_m2 * uav.v_max_mps.powi(2);
        let lift_n = uav.mass_kg * GRAVITY_MPS2 * uav.max_tilt_rad.tan();
        // The Matrice 600's tabulated area is 1.1 % above its balance.
        assert!((drag_n / lift_n - 1.0).abs() < 0.015, "{name}");
    }
}

#[test]
fn a_bad_file_is_one_error_with_its_line_and_its_mend() {
    let no_battery = PHANTOM
        .lines()
        .position(|l| l == "[parts.battery]")
        .unwrap()
        + 1;
    for (from, to, line, words) in [
        (
            "count = 4\n",
            "",
            16,
            "rotors.count: is missing: add 'count = ...'",
        ),
        (
            "count = 4",
            "count = 3",
            17,
            "rotors.count: found 3, must be 4 or 6",
        ),
        (
            "count = 4",
            "count = 6",
            6,
            "class: has 4 rotors, but rotors.count is 6",
        ),
        (
            "mass_kg = 1.380",
            "mass_kg = -1",
            7,
            "mass_kg: found -1, must be from 0.01",
        ),
        (
            "mass_kg",
            "mass_g",
            7,
            "mass_g: unknown key - did you mean 'mass_kg'?",
        ),
        (
            "\"abs_shell\"",
            "\"abs_shel\"",
            23,
            "unknown skin 'abs_shel' - did you mean 'abs_shell'?",
        ),
        (
            "\"phantom\"",
            "\"fantom\"",
            37,
            "unknown frame 'fantom' - did you mean 'phantom'?",
        ),
        (
            "frame = \"phantom\"",
            "",
            36,
            "shape: has no shape: add 'frame",
        ),
        (
            "frame",
            "gltf = 'a.glb'\nframe",
            37,
            "shape.gltf: stands beside 'frame'",
        ),
        (
            "at_body_m = [-0.07, 0.0, 0.004]\n",
            "",
            no_battery,
            "parts.battery.at_body_m: is missing",
        ),
        (
            "at_body_m = [-0.07,",
            "at_body_m = [-70.0,",
            no_battery + 1,
            "must be from -0.35",
        ),
        (
            "size_m = [0.289, 0.289",
            "size_m = [0.2, 0.2",
            9,
            "size_m: no four hubs",
        ),
        (
            "[7.4e-3, 9.0e-3",
            "[1e-3, 1e-3",
            10,
            "inertia_kgm2: no body has",
        ),
        (
            "thrust_to_weight = 2.2",
            "thrust_to_weight = 1.3",
            19,
            "must be at least 1.61",
        ),
        (
            "shell = [0.78",
            "shell = [78",
            40,
            "shape.paint.shell[0]: found 78",
        ),
        (
            "count = 4",
            "count = 4\nhubs_body_m = []",
            18,
            "rotors.hubs_body_m: belongs to",
        ),
    ] {
        let error = refused(from, to);
        let place = format!("own.toml:{line}: ");
        assert!(
            error.starts_with(&place) && error.contains(words),
            "{to}: {error}"
        );
    }
    assert!(error("").starts_with("own.toml"));
    assert!(error("=").contains("not TOML"));
}

/// The Phantom with a shape of its own and these places for its rotors.
fn shaped(hubs: &str) -> String {
    let text = PHANTOM.replace("frame = \"phantom\"", "gltf = 'own.glb'");
    text.replace("lag_s", &format!("hubs_body_m = [{hubs}]\nlag_s"))
}

const HUBS: &str =
    "[0.12, 0.12, 0.05], [-0.12, 0.12, 0.05], [-0.12, -0.12, 0.05], [0.12, -0.12, 0.05]";

/// A binary glTF file of one triangle with its corner at the origin, 0.3 m long and wide, 0.2 m high.
fn triangle(scale: f32) -> Vec<u8> {
    let json = r#"{"asset":{"version":"2.0"},"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],"meshes":[{
        "primitives":[{"attributes":{"POSITION":0}}]}],"buffers":[{"byteLength":36}],"bufferViews":[{
        "buffer":0,"byteLength":36}],"accessors":[{"bufferView":0,"componentType":5126,"count":3,
        "type":"VEC3","min":[0,0,0],"max":[1,1,1]}]}"#;
    let json = format!("{json:<0$}", json.len().next_multiple_of(4));
    let corners = [[0.0_f32, 0.0, 0.0], [0.3, 0.2, 0.0], [0.0, 0.0, 0.3]];
    let corners = corners
        .iter()
        .flatten()
        .flat_map(|x| (x * scale).to_le_bytes());
    let word = |x: usize| (x as u32).to_le_bytes();
    let mut file = [&b"glTF"[..], &word(2), &word(12 + 8 + json.len() + 8 + 36)].concat();
    file.extend(
        [
            &word(json.len())[..],
            b"JSON",
            json.as_bytes(),
            &word(36),
            b"BIN\0",
        ]
        .concat(),
    );
    file.extend(corners);
    file
}

#[test]
fn a_shape_of_its_own_has_its_rotors_where_the_file_says() {
    let read = |name: &Path| {
        assert_eq!(name, Path::new("own.glb"));
        Ok(triangle(1.0))
    };
    let uav = parse(&shaped(HUBS), "own", "own.toml", read).unwrap();
    let mesh = uav_mesh(&uav);
    assert_eq!(mesh.body.triangle_count(), 1);
    let hubs: Vec<DVec3> = mesh.rotors.iter().map(|rotor| rotor.hub_body_m).collect();
    assert_eq!(hubs[1], DVec3::new(-0.12, 0.12, 0.05));
    assert_eq!(mesh.part_body_m(&uav, AimPart::RotorHub), hubs[0]);
}

#[test]
fn a_bad_shape_is_one_error_with_its_line_and_its_mend() {
    let refused = |hubs: &str, file: io::Result<Vec<u8>>| {
        let error = parse(&shaped(hubs), "own", "own.toml", |_: &Path| file);
        error.unwrap_err().to_string()
    };
    let absent = || Err(io::Error::from(io::ErrorKind::NotFound));
    let three = HUBS.rsplit_once(", [").unwrap().0;
    let turned = format!("[0.12, -0.12, 0.05], {three}");
    for (hubs, file, line, words) in [
        (HUBS, absent(), 38, "shape.gltf: own.glb: cannot be read"),
        (
            HUBS,
            Ok(b"glass".to_vec()),
            38,
            "own.glb: is no binary glTF 2.0 file; export",
        ),
        (
            HUBS,
            Ok(triangle(1e3)),
            38,
            "measures [300.000, 300.000, 200.000] m",
        ),
        (
            three,
            absent(),
            20,
            "rotors.hubs_body_m: has 3 places for 4 rotors",
        ),
        (
            &turned,
            absent(),
            20,
            "rotors.hubs_body_m[0]: is out of turn: start at the front left",
        ),
        (
            "[0.0, 0.0, 0.0], [1, 1, 1], [1, 1, 1], [1, 1, 1]",
            absent(),
            20,
            "is out of turn",
        ),
    ] {
        let error = refused(hubs, file);
        let place = format!("own.toml:{line}: ");
        assert!(
            error.starts_with(&place) && error.contains(words),
            "{error}"
        );
    }
    let without = shaped(HUBS).replace("hubs_body_m", "# hubs_body_m");
    assert!(error(&without).contains("rotors.hubs_body_m: is missing: add"));
}

#[test]
fn an_unknown_name_is_one_error_with_a_suggestion() {
    let error = load("phantom9").unwrap_err().to_string();
    for words in [
        "unknown model 'phantom9'",
        "did you mean 'phantom4'",
        "fpv5",
        ".toml",
    ] {
        assert!(error.contains(words), "{error}");
    }
    let error = load("no/such.toml").unwrap_err().to_string();
    assert!(error.starts_with("no/such.toml: cannot be read"), "{error}");
}

/// A frame in other sizes is the same frame, larger, with its rotors on the diagonal.
#[test]
fn frames_grow_with_their_uav() {
    for frame in [
        "phantom",
        "mavic",
        "matrice200",
        "matrice600",
        "racer",
        "ribbed",
    ] {
        let text = |count: usize, scale: f64| {
            let [l, d] = [0.6 * scale, 0.7 * scale];
            let class = if count == 6 {
                "hexacopter"
            } else {
                "quadcopter"
            };
            PHANTOM
                .replace("0.289, 0.289, 0.196", &format!("{l}, {l}, {}", 0.3 * scale))
                .replace("0.350", &d.to_string())
                .replace("count = 4", &format!("count = {count}"))
                .replace("\"quadcopter\"", &format!("\"{class}\""))
                .replace("\"phantom\"", &format!("\"{frame}\""))
                .replace(
                    "[-0.07, 0.0, 0.004]",
                    &format!("[{}, 0.0, 0.0]", -0.1 * scale),
                )
                .replace(
                    "[0.055, 0.0, -0.078]",
                    &format!("[{}, 0.0, 0.0]", 0.1 * scale),
                )
        };
        for count in [4, 6] {
            let [one, two] = [1.0, 2.0].map(|scale| {
                let none = |_: &Path| Err(io::Error::from(io::ErrorKind::NotFound));
                uav_mesh(&parse(&text(count, scale), "own", "own.toml", none).unwrap())
            });
            assert_eq!(one.rotors.len(), count);
            for (a, b) in one.rotors.iter().zip(&two.rotors) {
                assert!(
                    (a.hub_body_m.truncate().length() - 0.35).abs() < 1e-6,
                    "{frame}"
                );
                assert!(
                    (2.0 * a.hub_body_m - b.hub_body_m).length() < 1e-6,
                    "{frame} {count}"
                );
            }
            let ratio = measured_m(&two.body) / measured_m(&one.body);
            assert!(
                (ratio - DVec3::splat(2.0)).length() < 1e-3,
                "{frame} {count} {ratio}"
            );
            assert!(one.body.signed_volume_m3() > 0.0, "{frame} {count}");
        }
    }
}

proptest! {
    /// Whatever stands for a value, the file is read, or refused with its name and line.
    #[test]
    fn any_change_of_a_value_is_read_or_refused(
        line in 0usize..60,
        value in prop_oneof![
            Just(String::new()),
            any::<f64>().prop_map(|x| x.to_string()),
            any::<i64>().prop_map(|x| x.to_string()),
            "\\PC{0,12}",
            "\"[a-z0-9_]{0,9}\"",
            "\\[(-?[0-9.]{1,4}, ){0,4}\\]",
        ],
    ) {
        let mut lines: Vec<String> = PHANTOM.lines().map(String::from).collect();
        let line = line % lines.len();
        if let Some((key, _)) = lines[line].clone().split_once('=') {
            lines[line] = format!("{key}= {value}");
        } else {
            lines[line] = value;
        }
        let none = |_: &Path| Err(io::Error::from(io::ErrorKind::NotFound));
        match parse(&lines.join("\n"), "own", "own.toml", none) {
            Ok(uav) => {
                let mesh = uav_mesh(&uav);
                prop_assert_eq!(mesh.rotors.len(), uav.rotor_count);
                let finite = |mesh: &MeshData| mesh.positions.iter().flatten().all(|x| x.is_finite());
                prop_assert!(finite(&mesh.body) && finite(&mesh.blades[0]));
            }
            Err(error) => prop_assert!(error.to_string().starts_with("own.toml"), "{}", error),
        }
    }
}
