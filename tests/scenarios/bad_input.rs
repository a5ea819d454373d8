//! Whatever is wrong with the input is one line that names the mend.

use crate::common::{BLIND, ROOT, boresight, refused, rendering, stderr};
use std::path::{Path, PathBuf};
use std::process::Command;
use tempfile::TempDir;

/// `boresight run` of a scenario without images into a folder of its own.
fn blind(folder: &Path, scenario: impl AsRef<Path>) -> Command {
    let mut command = boresight();
    command.arg("run").arg(scenario.as_ref()).args(BLIND);
    command.arg("--out").arg(folder.join("out"));
    command
}

/// `urban_intercept`'s text with `from` replaced, as a file of its own, and the line of the change.
fn altered(folder: &Path, from: &str, to: &str) -> (PathBuf, usize) {
    let text = std::fs::read_to_string(Path::new(ROOT).join("scenarios/urban_intercept.toml"));
    let text = text.unwrap();
    let at = text
        .find(from)
        .unwrap_or_else(|| panic!("the demo has no '{from}'"));
    let path = folder.join("altered.toml");
    std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
    (path, 1 + text[..at].matches('\n').count())
}

#[test]
fn a_bad_scenario_is_one_error_that_names_the_place() {
    let folder = TempDir::new().unwrap();
    let folder = folder.path();
    // What is replaced, by what, and what the error must say beside file and line.
    let cases: [(&str, &str, &[&str]); 7] = [
        (
            "duration_s = 25.0",
            "duration_s = 25.0\nwatts = 3",
            &["watts", "unknown key", "expected"],
        ),
        (
            "duration_s = 25.0",
            "duration_s = \"long\"",
            &["duration_s", "a number"],
        ),
        (
            "\"phantom4\"",
            "\"phantom9\"",
            &["uavs[0].model", "did you mean 'phantom4'"],
        ),
        (
            "[search]",
            "[station.cameras.precise]\nrate_hz = 7\n[search]",
            &[
                "station.cameras.precise.rate_hz",
                "does not divide tick_hz",
                "nearest",
            ],
        ),
        ("LSZH 200850Z 24005KT", "LSZH it rains", &["weather.metar"]),
        (
            "47.3769",
            "473769.0",
            &["site.latitude_deg", "must be from"],
        ),
        (
            "kind = \"straight\"",
            "kind = \"teleport\"",
            &["uavs[0].trajectory", "teleport"],
        ),
    ];
    for (from, to, wanted) in cases {
        let (path, line) = altered(folder, from, to);
        let line = line + to.matches('\n').count().min(1);
        let place = format!("altered.toml:{line}: ");
        let wanted = [&[&place[..]], wanted].concat();
        refused(&mut blind(folder, &path), &wanted);
        refused(boresight().arg("check").arg(&path), &wanted);
    }
    // Cut inside a string.
    let path = folder.join("cut.toml");
    let text = std::fs::read(Path::new(ROOT).join("scenarios/urban_intercept.toml")).unwrap();
    let cut = text.windows(4).position(|w| w == b"LSZH").unwrap();
    std::fs::write(&path, &text[..cut]).unwrap();
    refused(&mut blind(folder, &path), &["cut.toml:", "not TOML"]);
    refused(
        &mut blind(folder, folder.join("absent.toml")),
        &["absent.toml", "cannot be read"],
    );
    // Not UTF-8.
    std::fs::write(&path, [0xff, 0xfe, 0x00]).unwrap();
    refused(&mut blind(folder, &path), &["cut.toml"]);

    let demo = "scenarios/urban_intercept.toml";
    for (set, wanted) in [
        ("uavs.0.model=phantom9", "uavs[0].model"),
        ("duration_s", "expected key=value"),
        ("uavs.7.model=fpv5", "no entry '7'"),
        ("duration_s=-1", "duration_s"),
        ("duration_s=nan", "finite"),
        (
            "operator=[{ t_s = 1.0, designate = 'nobody' }]",
            "operator[0].designate",
        ),
        (
            "operator=[{ t_s = 1.0, fire = true, slew_deg = [3, 4] }]",
            "operator[0].slew_deg: this order already holds 'fire'",
        ),
        (
            "operator=[{ t_s = 1.0, law = 'lqq' }]",
            "operator[0].law: no law 'lqq' - did you mean 'lqg'?",
        ),
        (
            "operator=[{ t_s = 1.0, law = 'lqg' }, { t_s = 2.0, gains = { gimbal_per_s = 4.0 } }]",
            "operator[1].gains: the law 'lqg' cannot take these",
        ),
        (
            "operator=[{ t_s = 1.0, slew_deg = [0, 120] }]",
            "operator[0].slew_deg[1]: found 120, must be from -90 to 90",
        ),
        (
            "operator=[{ t_s = 1.0, weather = { wind_speed_mps = -3.0 } }]",
            "operator[0].weather.wind_speed_mps: found -3, must be from 0 to 60",
        ),
    ] {
        refused(
            blind(folder, demo).args(["--set", set]),
            &["--set", set, wanted],
        );
    }
}

/// An experiment where a scenario is wanted, and the other way round: what it is, and the command that takes it.
#[test]
fn a_file_of_another_kind_is_named_with_its_command() {
    let folder = TempDir::new().unwrap();
    let folder = folder.path();
    let path = folder.join("my sweep.toml");
    let text = "name = 'x'\nscenario = 'none.toml'\n\n[[factors]]\nkey = 'station.laser.power_w'\nvalues = [1.0]\n";
    std::fs::write(&path, text).unwrap();
    let command = format!("`boresight sweep '{}' --out FOLDER`", path.display());
    let wanted = [
        "my sweep.toml:4: factors: this file is an experiment, not a scenario: ",
        &command,
    ];
    refused(&mut blind(folder, &path), &wanted);
    for command in ["check", "view", "tune"] {
        refused(boresight().arg(command).arg(&path), &wanted);
    }
    // A change of a key does not make it a scenario.
    let set = ["--set", "site.altitude_m=4"];
    refused(blind(folder, &path).args(set), &wanted);
    let demo = "scenarios/urban_intercept.toml";
    let out = folder.join("swept");
    refused(
        boresight().args(["sweep", demo, "--out"]).arg(&out),
        &[
            "urban_intercept.toml:",
            ": this file is a scenario, not an experiment: ",
            "`boresight run ",
        ],
    );
    assert!(!out.exists());
}

#[test]
fn a_bad_uav_is_one_error_that_names_its_place() {
    let folder = TempDir::new().unwrap();
    let folder = folder.path();
    let good = std::fs::read_to_string(Path::new(ROOT).join("examples/own_uav.toml")).unwrap();
    std::fs::write(folder.join("glass.glb"), "glass").unwrap();
    let own = folder.join("own.toml");
    let six = "hubs_body_m = [[1, 0.5, 0], [0, 1, 0], [-1, 0.5, 0], [-1, -0.5, 0], [0, -1, 0], [1, -0.5, 0]]";
    // What is replaced, by what, and what the error must say beside file and line.
    let cases: [(&str, String, &[&str]); 4] = [
        (
            "count = 6\n",
            String::new(),
            &["rotors.count: is missing: add 'count = ...'"],
        ),
        (
            "frame = \"ribbed\"",
            "frame = \"ribed\"".into(),
            &["did you mean 'ribbed'"],
        ),
        (
            "frame = \"ribbed\"",
            "gltf = \"glass.glb\"".into(),
            &["rotors.hubs_body_m: is missing"],
        ),
        (
            "lag_s = 0.045",
            format!("lag_s = 0.045\n{six}"),
            &[
                "shape.gltf: glass.glb: is no binary glTF",
                "export the shape as .glb",
            ],
        ),
    ];
    for (from, to, wanted) in cases {
        let text = good.replacen(from, &to, 1);
        let text = match to.contains("hubs") {
            true => text.replace("frame = \"ribbed\"", "gltf = \"glass.glb\""),
            false => text,
        };
        assert_ne!(text, good);
        std::fs::write(&own, text).unwrap();
        let set = format!("uavs.0.model={}", own.display());
        let wanted = [&["uavs[0].model: ", "own.toml:"], wanted].concat();
        let demo = "scenarios/urban_intercept.toml";
        refused(blind(folder, demo).args(["--set", &set]), &wanted);
        refused(
            boresight().arg("check").arg(demo).args(["--set", &set]),
            &wanted,
        );
    }
}

/// What only the set-up of a run can find, its check finds too, with the line.
#[test]
fn a_check_finds_what_the_set_up_refuses() {
    let folder = TempDir::new().unwrap();
    let folder = folder.path();
    let small = Path::new(ROOT).join("tests/data/models/fixed_size.onnx");
    let detector = format!("[detector]\nonnx_model = {small:?}\n[search]");
    // What comes before `[search]`, its line counted from there, and what the error must say.
    let cases: [(&str, usize, &[&str]); 4] = [
        (
            "[station.mount]\nstructural_mode_hz = 5.0\nbacklash_urad = 1e5\n[search]",
            0,
            &["station.mount: no gimbal gain keeps"],
        ),
        (
            "[station.cameras.precise]\nrate_hz = 7\n[search]",
            1,
            &["station.cameras.precise.rate_hz: 7 Hz does not divide tick_hz"],
        ),
        (
            &detector,
            1,
            &[
                "detector.onnx_model: ",
                "at most 200 x 100 px, not 640 x 480",
            ],
        ),
        (
            "[[distractors]]\nname = \"b\"\nkind = \"bird\"\n\
             trajectory = { kind = \"recorded\", file = \"none.csv\" }\n[search]",
            3,
            &["distractors[0].trajectory: ", "none.csv"],
        ),
    ];
    for (to, after, wanted) in cases {
        let (path, line) = altered(folder, "[search]", to);
        let place = format!("altered.toml:{}: ", line + after);
        let wanted = [&[&place[..]], wanted].concat();
        refused(boresight().arg("check").arg(&path), &wanted);
    }
}

#[test]
fn a_bad_recorded_flight_is_one_error_that_names_the_row() {
    let folder = TempDir::new().unwrap();
    let folder = folder.path();
    let from = "{ kind = \"straight\", start_enu_m = [-776.4, 635.0, 80.0], \
                velocity_enu_mps = [5.657, 5.657, 0.0] }";
    let (path, _) = altered(
        folder,
        from,
        "{ kind = \"recorded\", file = \"flight.csv\" }",
    );
    let good = "t_s,east_m,north_m,up_m\n0,-776,635,90\n1,-770,641,90\n2,-764,647,90\n";
    let at = ["altered.toml", "uavs[0].trajectory"];
    refused(
        &mut blind(folder, &path),
        &[&at[..], &["flight.csv"]].concat(),
    );
    for (row, wanted) in [
        ("3,-760,north,90", "line: 5"),
        ("1.5,-760,650,90", "data row 4"),
        ("3,-760", "line: 5"),
    ] {
        std::fs::write(folder.join("flight.csv"), format!("{good}{row}\n")).unwrap();
        let wanted = [&at[..], &["flight.csv", wanted]].concat();
        refused(&mut blind(folder, &path), &wanted);
        refused(boresight().arg("check").arg(&path), &wanted);
    }
    std::fs::write(folder.join("flight.csv"), good).unwrap();
    let output = boresight().arg("check").arg(&path).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
}

#[test]
fn a_bad_measured_detector_is_one_error_that_names_the_file() {
    let folder = TempDir::new().unwrap();
    let folder = folder.path();
    let draws = folder.join("draws");
    std::fs::create_dir(&draws).unwrap();
    std::fs::write(draws.join("00000.looks.jsonl"), "{\"row\":\"frame\"}\n").unwrap();
    for (file, wanted) in [("absent.json", "No such file"), ("Cargo.toml", "expected")] {
        let mut command = blind(folder, "scenarios/urban_intercept.toml");
        let set = [
            "detector.kind=measured".into(),
            format!("detector.measured={file}"),
        ];
        command.args(set.iter().flat_map(|value| ["--set", value]));
        refused(
            &mut command,
            &["detector.measured", file, wanted, "fit-detector"],
        );
    }
    let mut fit = boresight();
    let out = folder.join("measured.json");
    fit.arg("fit-detector").arg(folder).arg("--out").arg(&out);
    refused(&mut fit, &["00000.looks.jsonl:1", "missing field"]);
    let wren = r#"{"row":"false","t_s":0,"tier":"search","az_el_rad":[0,0],"ifov_rad":1e-4,"score":0.2,"name":"wren","box_px":[4,4],"in_sky":true}"#;
    std::fs::write(draws.join("00000.looks.jsonl"), wren).unwrap();
    refused(&mut fit, &["00000.looks.jsonl:1", "'wren'", "--model"]);
    std::fs::write(draws.join("00000.looks.jsonl"), "").unwrap();
    refused(&mut fit, &["no look at a UAV", "--looks"]);
    let judged = std::fs::read_to_string("scenarios/urban_intercept.toml").unwrap();
    let judged = format!("{judged}\n[city]\nseed = 1000003\n");
    std::fs::write(draws.join("00000.toml"), judged).unwrap();
    refused(
        &mut fit,
        &["00000.toml", "city.seed", "kept for judging", "--looks"],
    );
    let mut fit = boresight();
    fit.arg("fit-detector")
        .arg(folder.join("absent"))
        .arg("--out")
        .arg(&out);
    refused(&mut fit, &["absent", "No such file", "--looks"]);
    assert!(!out.exists());
}

#[test]
fn a_bad_detector_model_is_one_error_that_names_the_file() {
    let _one = rendering();
    let folder = TempDir::new().unwrap();
    let run = |model: &str| {
        let mut command = boresight();
        command
            .args(["run", "scenarios/urban_intercept.toml", "--out"])
            .arg(folder.path());
        command.args(["--set", &format!("detector.onnx_model=\"{model}\"")]);
        command
    };
    // The error points to the key to mend, or to the interface the model must have.
    for (model, wanted) in [
        ("absent.onnx", "detector.onnx_model"),
        ("tests/data/models", "directory"),
        (
            "tests/data/models/truncated.onnx",
            "not a usable ONNX model",
        ),
        (
            "tests/data/models/wrong_inputs.onnx",
            "expected one input `image`",
        ),
        ("tests/data/models/nan.onnx", "not finite"),
        ("tests/data/models/opset.onnx", "opset 99 is newer"),
        (
            "tests/data/models/classes_empty.onnx",
            "a JSON list of different names",
        ),
        ("tests/data/models/output_type.onnx", "i64 [N]"),
        (
            "tests/data/models/fixed_size.onnx",
            "at most 200 x 100 px, not 640 x 480",
        ),
        // It answers the probe, but not the first frame.
        ("tests/data/models/nan_later.onnx", "not finite"),
    ] {
        refused(&mut run(model), &["detector model", model, wanted]);
    }
    let mut command = run("assets/models/saliency.onnx");
    command.env("ORT_DYLIB_PATH", "/nonexistent/libonnxruntime.so");
    refused(
        &mut command,
        &["ONNX Runtime", "/nonexistent/libonnxruntime.so", "setup.sh"],
    );
    // A library, but another one.
    std::fs::write(folder.path().join("libonnxruntime.so"), "no library").unwrap();
    let mut command = run("assets/models/saliency.onnx");
    command.env("ORT_DYLIB_PATH", folder.path().join("libonnxruntime.so"));
    refused(&mut command, &["ONNX Runtime", "libonnxruntime.so"]);
    let mut command = run("assets/models/saliency.onnx");
    refused(
        command.arg("--no-capture"),
        &["--no-capture", "detector.kind=truth"],
    );
}

#[test]
fn a_machine_that_cannot_is_one_error_that_names_the_mend() {
    let folder = TempDir::new().unwrap();
    let folder = folder.path();
    let demo = "scenarios/urban_intercept.toml";
    let mut command = boresight();
    command
        .args(["run", demo, "--set", "detector.kind=truth", "--out"])
        .arg(folder);
    for key in ["VK_DRIVER_FILES", "VK_ICD_FILENAMES", "LIBGL_DRIVERS_PATH"] {
        command.env(key, "/nonexistent");
    }
    refused(
        &mut command,
        &["no Vulkan adapter", "apt-get install", "--no-capture"],
    );

    // A file where the folder, or the folder above it, should be; a folder where the file should.
    let file = folder.join("file");
    std::fs::write(&file, "").unwrap();
    for out in [file.clone(), file.join("out"), "/proc/boresight".into()] {
        let mut command = boresight();
        command
            .args(["run", demo])
            .args(BLIND)
            .arg("--out")
            .arg(&out);
        refused(
            &mut command,
            &["the folder cannot be made", out.to_str().unwrap(), "--out"],
        );
    }
    std::fs::create_dir_all(folder.join("out/run.mcap")).unwrap();
    refused(&mut blind(folder, demo), &["run.mcap"]);
}

/// A CityJSON of one house at Delft and an object without geometry, whose system names no heights.
const CITY: &str = r#"{
  "type": "CityJSON", "version": "2.0",
  "metadata": { "referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/28992" },
  "transform": { "scale": [1.0, 1.0, 1.0], "translate": [84600.0, 447400.0, 0.0] },
  "CityObjects": {
    "house": { "type": "Building", "geometry": [{ "type": "Solid", "lod": "1.2", "boundaries": [[
      [[0, 3, 2, 1]], [[4, 5, 6, 7]], [[0, 1, 5, 4]], [[1, 2, 6, 5]], [[2, 3, 7, 6]], [[3, 0, 4, 7]]]] }] },
    "nothing": { "type": "Building", "geometry": [] },
    "ground": { "type": "LandUse", "geometry": [{ "type": "MultiSurface", "lod": "1", "boundaries": [[[8, 9, 10, 11]]] }] }
  },
  "vertices": [
    [0, 0, 1], [20, 0, 1], [20, 20, 1], [0, 20, 1], [0, 0, 13], [20, 0, 13], [20, 20, 13], [0, 20, 13],
    [-900, -900, 1], [900, -900, 1], [900, 900, 1], [-900, 900, 1]]
}"#;

#[test]
fn what_a_source_leaves_open_is_warned_of_and_an_error_where_asked() {
    let folder = TempDir::new().unwrap();
    let folder = folder.path();
    let city = folder.join("town.city.json");
    std::fs::write(&city, CITY).unwrap();
    let warned = |command: &mut Command, code: i32| {
        let output = command
            .env("BORESIGHT_CACHE", folder.join("cache"))
            .output()
            .unwrap();
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(code), "{command:?}: {text}");
        let warnings = (text.lines())
            .filter(|line| line.starts_with("warning: ") && line.contains("town.city.json"));
        let warnings: Vec<String> = warnings.map(str::to_owned).collect();
        assert_eq!(warnings.len(), 2, "{text}");
        for (line, words) in warnings
            .iter()
            .zip(["heights: ", "left out: 1 objects without geometry"])
        {
            assert!(line.contains(city.to_str().unwrap()), "{line}");
            assert!(line.contains(words) && line.contains("; "), "{line}");
        }
        text
    };
    let tiles = folder.join("tiles");
    let build = || {
        let mut command = boresight();
        command
            .args(["tiles", "build"])
            .arg(&city)
            .arg("--out")
            .arg(&tiles);
        command
    };
    // With the flag nothing is built; it stands before or behind the command.
    let text = warned(build().arg("--strict"), 2);
    assert!(
        text.lines().last().unwrap().starts_with("error: --strict "),
        "{text}"
    );
    assert!(!tiles.join("tileset.json").exists());
    warned(&mut build(), 0);
    assert!(tiles.join("tileset.json").exists());
    // A scenario's sources: the first time they are built, the second time their tiles are there.
    let demo =
        std::fs::read_to_string(Path::new(ROOT).join("scenarios/urban_intercept.toml")).unwrap();
    let scenario = folder.join("town.toml");
    let own = demo.split("[expect]").next().unwrap();
    let mut document: toml_edit::DocumentMut = own.parse().unwrap();
    document["duration_s"] = toml_edit::value(0.5);
    document["site"]["latitude_deg"] = toml_edit::value(52.0105);
    document["site"]["longitude_deg"] = toml_edit::value(4.3590);
    document["site"]["altitude_m"] = toml_edit::value(44.0);
    document["city"] = toml_edit::table();
    document["city"]["sources"] =
        toml_edit::value(toml_edit::Array::from_iter([city.to_str().unwrap()]));
    std::fs::write(&scenario, document.to_string()).unwrap();
    for command in ["check", "check", "run"] {
        let mut command_line = boresight();
        command_line
            .arg(command)
            .arg(&scenario)
            .args(["--set", "detector.kind=truth"]);
        if command == "run" {
            command_line
                .args(["--no-capture", "--out"])
                .arg(folder.join("out"));
        }
        warned(&mut command_line, 0);
    }
    let mut strict = boresight();
    let text = warned(strict.args(["--strict", "check"]).arg(&scenario), 2);
    let last = text.lines().last().unwrap();
    assert!(
        last.starts_with("error: ") && last.contains("city") && last.contains("--strict"),
        "{text}"
    );
}
