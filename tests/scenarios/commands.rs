//! Evaluation, tuning and sets of annotated pictures.

use crate::common::{BLIND, ROOT, boresight, on_display, refused, rendering, stderr};
use boresight::models::flight::class::ObjectClass;
use boresight::models::maths::rng::Stream;
use boresight::recording::media::video::Clip;
use glam::DVec2;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::process::Output;
use std::time::Instant;
use tempfile::TempDir;

/// Runs a command that leaves a JSON file and a page in `folder`, and returns both.
fn measured(folder: &Path, args: &[&str], name: &str) -> (Value, String) {
    let mut command = boresight();
    let output = command
        .args(args)
        .arg("--out")
        .arg(folder)
        .output()
        .unwrap();
    assert!(output.status.success(), "{args:?}: {}", stderr(&output));
    let read = |kind: &str| std::fs::read_to_string(folder.join(format!("{name}.{kind}"))).unwrap();
    let page = read("html");
    assert!(page.starts_with("<!DOCTYPE html>") && page.trim_end().ends_with("</html>"));
    // Pictures are letters at random; names of XML namespaces are the only addresses.
    let mut parts = page.split(";base64,");
    let mut loads = parts.next().unwrap().replace("http://www.w3.org/", "");
    for part in parts {
        loads.push_str(part.split_once('"').unwrap().1);
    }
    for marker in ["http://", "https://", "src=\"/", "<link", "@import", "NaN"] {
        assert!(!loads.contains(marker), "{name}.html has {marker}");
    }
    (serde_json::from_str(&read("json")).unwrap(), page)
}

#[test]
fn the_evaluation_of_the_pointing_runs_to_its_end() {
    let folder = TempDir::new().unwrap();
    let args = ["eval", "tracking", "--quick", "--only", "precision"];
    let (json, page) = measured(folder.path(), &args, "tracking");
    assert_eq!(
        json["command"],
        "boresight eval tracking --quick --only precision"
    );
    assert!(json["quick"] == true && json["not_run"] == serde_json::json!([]));
    assert!(page.contains(json["version"].as_str().unwrap()));
    let number = |pointer: &str| json.pointer(pointer).and_then(Value::as_f64).unwrap();
    for (index, controller) in ["paper", "tuned", "lqg"].into_iter().enumerate() {
        let at = |key: &str| format!("/precision/{index}/{key}");
        assert_eq!(json.pointer(&at("controller")).unwrap(), controller);
        let pointing = |key: &str| number(&at(&format!("pointing/{key}")));
        let [rms_urad, peak_urad] = ["rms_urad", "peak_urad"].map(pointing);
        assert!(
            0.0 < rms_urad && rms_urad < peak_urad,
            "{rms_urad}, {peak_urad}"
        );
        assert!(pointing("beam_rms_urad") > 0.0 && pointing("seconds") > 0.0);
        assert!((0.0..=1.0).contains(&pointing("saturated_share")));
        // What made the figure can be made again.
        assert_eq!(
            json.pointer(&at("source/seeds")).unwrap(),
            &serde_json::json!([1, 2])
        );
        let command = json
            .pointer(&at("source/command"))
            .unwrap()
            .as_str()
            .unwrap();
        assert!(
            command.starts_with("boresight run scenarios/eval/"),
            "{command}"
        );
        assert!(page.contains(controller));
    }
    let targets = json["targets"].as_array().unwrap();
    assert_eq!(targets.len(), 6);
    for target in targets {
        let [limit, value] = ["limit", "value"].map(|key| target[key].as_f64().unwrap());
        assert_eq!(target["met"], value <= limit, "{target}");
    }
    // What was not asked for is empty, not absent.
    for section in ["table2", "weave", "occlusion", "suite", "search", "budget"] {
        assert_eq!(json[section], serde_json::json!([]), "{section}");
    }
}

#[test]
fn models_are_held_to_their_references() {
    let folder = TempDir::new().unwrap();
    let out = folder.path().join("validation");
    let args = ["validate", "--only", "geodesy", "--only", "beam", "--out"];
    let output = boresight().args(args).arg(&out).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    let table = String::from_utf8_lossy(&output.stdout);
    assert!(
        table.contains("9 of 9 checks green") && table.contains("6.774"),
        "{table}"
    );
    let read = |name: &str| std::fs::read_to_string(out.join(name)).unwrap();
    let json: Value = serde_json::from_str(&read("checks.json")).unwrap();
    let checks = json["checks"].as_array().unwrap();
    assert_eq!(checks.len(), 9);
    for check in checks {
        let of = |key: &str| check[key].as_f64().unwrap();
        assert!(
            (of("ours") - of("value")).abs() <= of("tolerance"),
            "{check}"
        );
        assert!(
            check["reference"]
                .as_str()
                .is_some_and(|text| !text.is_empty())
        );
    }
    let page = read("report.html");
    assert!(page.starts_with("<!DOCTYPE html>") && page.contains("EPSG Guidance Note 7-2"));
    refused(
        boresight().args(["validate", "--only", "moon"]),
        &["--only", "'moon'", "geodesy"],
    );
}

#[test]
fn the_tuning_runs_to_its_end() {
    let folder = TempDir::new().unwrap();
    let args = ["tune", "scenarios/urban_intercept.toml"];
    let (json, page) = measured(folder.path(), &args, "tune");
    let texts = ["scenario", "version", "axis", "preset", "limited_by"];
    let [scenario, version, axis, preset, limit] = texts.map(|key| json[key].as_str().unwrap());
    assert_eq!(
        (scenario, axis, preset),
        ("urban_intercept", "azimuth", "tuned")
    );
    assert!(page.contains(version) && page.contains(limit));
    assert!(json["latency_s"].as_f64().unwrap() > 0.0);
    for gains in ["in_use", "derived"] {
        let gains = json[gains].as_array().unwrap();
        assert!(
            gains.iter().all(|gain| gain[1].as_f64().is_some()),
            "{gains:?}"
        );
    }
    let loops = json["loops"].as_array().unwrap();
    assert!(loops.len() >= 5, "{} loops", loops.len());
    for measured in loops {
        let name = measured["name"].as_str().unwrap();
        assert!(page.contains(name));
        // One value of each curve at each frequency, all finite: JSON has no NaN.
        let curve = |key: &str| {
            let values = measured[key].as_array().unwrap().iter().map(Value::as_f64);
            values
                .collect::<Option<Vec<f64>>>()
                .unwrap_or_else(|| panic!("{name}: {key}"))
        };
        let frequency_hz = curve("frequency_hz");
        assert!(frequency_hz.len() > 20 && frequency_hz.is_sorted());
        for key in ["open_db", "open_deg", "closed_db", "closed_deg"] {
            assert_eq!(curve(key).len(), frequency_hz.len(), "{name}: {key}");
        }
        let phase_deg = measured["phase_margin_deg"]["value"].as_f64().unwrap();
        assert!(phase_deg > 30.0, "{name}: {phase_deg}");
    }
}

/// A recipe for engagements of a few seconds.
const ENGAGEMENT: &str = "tests/data/engagement.toml";

#[test]
fn engagements_are_drawn_run_judged_and_not_made_twice() {
    let folder = TempDir::new().unwrap();
    let args = ["eval", "engagement", "--recipe", ENGAGEMENT, "--truth"];
    let made = |n: &str| {
        let args = [&args[..], &["--n", n]].concat();
        measured(folder.path(), &args, "results")
    };
    let (two, page) = made("2");
    assert_eq!(two["detector"], "truth detector");
    for line in two["headline"].as_array().unwrap() {
        let name = line["name"].as_str().unwrap();
        assert!(name.starts_with("truth detector: "), "{name}");
        let rate = |key: &str| {
            line.pointer(&format!("/rate/{key}"))
                .unwrap()
                .as_f64()
                .unwrap()
        };
        let [successes, trials] = ["successes", "trials"].map(rate);
        assert!(successes <= trials && trials <= 2.0, "{line}");
    }
    assert_eq!(two.pointer("/headline/0/rate/trials").unwrap(), 2);
    let draws = two["draws"].as_array().unwrap();
    assert_eq!(draws.len(), 2);
    for draw in draws {
        let number = |pointer: &str| draw.pointer(pointer).and_then(Value::as_f64).unwrap();
        // Cued, in plain sight, found by the truth: the UAV is acquired, whatever follows.
        assert_eq!(draw["verdict"]["acquired"], true, "{draw:#}");
        assert!(number("/record/acquired_s") < number("/record/end_s"));
        let [search_px, precise_px] = [0, 1].map(|k| number(&format!("/record/size_px/{k}")));
        assert!(search_px > 2.0 && (precise_px / search_px - 6.0).abs() < 0.1);
        // What was charged is no longer than what there was.
        let charged = draw["record"]["charges_s"].as_object().unwrap();
        let charged: f64 = charged.values().map(|s| s.as_f64().unwrap()).sum();
        assert!(charged <= number("/record/shown_s") + 1e-6, "{draw:#}");
        // The command repeats the run.
        let command = draw["command"].as_str().unwrap();
        let words: Vec<&str> = command.split_whitespace().collect();
        assert_eq!(words[..2], ["boresight", "run"]);
        let checked = boresight().args(["check", words[2]]).output().unwrap();
        assert!(checked.status.success(), "{}", stderr(&checked));
        if draw["verdict"]["cause"] != Value::Null {
            assert!(page.contains(command), "{command}");
        }
    }
    // A draw does not depend on their number, and is taken from its file.
    let record = folder.path().join("draws/00000.json");
    let written = || std::fs::metadata(&record).unwrap().modified().unwrap();
    let before = written();
    let (one, _) = made("1");
    assert_eq!(one["draws"][0], draws[0]);
    assert_eq!(written(), before);
    // That of another evaluation is not.
    let text = std::fs::read_to_string(&record).unwrap();
    let key = draws[0]["key"].as_str().unwrap();
    std::fs::write(&record, text.replace(key, "another")).unwrap();
    let (again, _) = made("1");
    assert_eq!(again["draws"][0], draws[0]);
}

#[test]
fn an_engagement_is_judged_on_rendered_pixels() {
    let _one = rendering();
    let folder = TempDir::new().unwrap();
    let args = ["eval", "engagement", "--recipe", ENGAGEMENT, "--n", "1"];
    let blind = [
        "duration_s=1.2",
        "tracker.tuning.candidate_hits=100",
        "tracker.tuning.chosen=100",
        "tracker.tuning.chosen_small=100",
    ];
    let blind: Vec<&str> = blind.iter().flat_map(|set| ["--set", *set]).collect();
    let args = [&args[..], &blind].concat();
    let (json, page) = measured(folder.path(), &args, "results");
    assert_eq!(json["detector"], "rendered pixels");
    let looks = json.pointer("/draws/0/record/looks/0").unwrap();
    let count = |key: &str| looks[key].as_u64().unwrap();
    assert!(
        0 < count("found") && count("found") <= count("frames"),
        "{looks}"
    );
    // What is found is never chosen: a failure, with the pictures that show it.
    let cause = json.pointer("/draws/0/verdict/cause").unwrap();
    assert!(cause.is_string(), "{json:#}");
    let pictures = json
        .pointer("/draws/0/pictures")
        .unwrap()
        .as_array()
        .unwrap();
    assert!(!pictures.is_empty());
    assert_eq!(
        page.matches("data:image/jpeg;base64,").count(),
        pictures.len()
    );
}

#[test]
fn an_ablation_pairs_engagements_with_all_rules_and_without_each() {
    let folder = TempDir::new().unwrap();
    let rules = folder.path().join("rules.toml");
    let file = |blind: &str| {
        format!(
            "[[without]]\nname = \"nothing\"\ndoes = \"-\"\nset = [\"tracker.tuning.rival_s=1\"]\n\
             [[without]]\nname = \"{blind}\"\ndoes = \"-\"\nset = [\"tracker.tuning.candidate_hits=100\", \
             \"tracker.tuning.chosen=100\", \"tracker.tuning.chosen_small=100\"]\n"
        )
    };
    std::fs::write(&rules, file("choice")).unwrap();
    let rules = rules.to_str().unwrap();
    let args = ["eval", "ablation", "--recipe", ENGAGEMENT, "--rules", rules];
    let args = [&args[..], &["--n", "2"]].concat();
    let (json, page) = measured(folder.path(), &args, "ablation");
    assert_eq!(
        (&json["detector"], &json["draws"]),
        (&"measured detector".into(), &2.into())
    );
    let effect = |index: usize, pointer: &str| {
        let rule = &json["rules"][index];
        rule.pointer(pointer).unwrap_or_else(|| panic!("{rule:#}"))
    };
    // What has its default is as it was; what is never chosen is never acquired.
    assert_eq!(effect(0, "/changed"), 0);
    assert_eq!(effect(0, "/acquired/difference"), 0.0);
    assert_eq!(effect(1, "/changed"), 2);
    assert_eq!(effect(1, "/acquired/only"), &json!([2, 0]));
    assert_eq!(effect(1, "/acquired/difference"), -1.0);
    assert!(page.contains("choice"));
    let refuses = |text: String, only: &str, wanted: &[&str]| {
        std::fs::write(rules, text).unwrap();
        let mut command = boresight();
        command.args(&args).args(["--only", only, "--out"]);
        refused(command.arg(folder.path().join("bad")), wanted);
    };
    refuses(file("choice"), "chance", &["--only", "chance", "choice"]);
    refuses(file("nothing"), "nothing", &["rules.toml:6", "twice"]);
    refuses(file("No thing"), "nothing", &["rules.toml:6", "lower-case"]);
}

#[test]
fn a_bad_recipe_of_engagements_is_one_error_with_its_line() {
    let folder = TempDir::new().unwrap();
    let text = std::fs::read_to_string(Path::new(ROOT).join(ENGAGEMENT)).unwrap();
    let path = folder.path().join("bad.toml");
    let refuses = |from: &str, to: &str, wanted: &[&str]| {
        assert!(text.contains(from), "{from}");
        std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
        let line = 1 + text[..text.find(from).unwrap()].matches('\n').count();
        let place = format!("bad.toml:{line}: ");
        let mut command = boresight();
        command.args(["eval", "engagement", "--truth", "--n", "1", "--out"]);
        command
            .arg(folder.path().join("out"))
            .arg("--recipe")
            .arg(&path);
        refused(&mut command, &[&[&place[..]], wanted].concat());
    };
    refuses("day = 1.0", "noon = 1.0", &["noon", "day"]);
    refuses("[400.0, 500.0]", "[500.0, 400.0]", &["uav.range_m"]);
    refuses("24005KT", "windy", &["weather.reports[0]", "windy"]);
    refuses("\"phantom4\"", "\"hframe\"", &["uav.models[0]", "held out"]);
}

/// A dark blob that crosses noisy sky, as numbered pictures with a COCO file beside them: a box
/// around it in each, with `flags`, or none without.
fn blob_clip(folder: &Path, frames: usize, flags: Option<Value>) -> PathBuf {
    const SIDES_PX: [u32; 2] = [320, 240];
    let mut rng = Stream::new(3, 0, "blob");
    std::fs::create_dir(folder).unwrap();
    let (mut images, mut annotations) = (Vec::new(), Vec::new());
    for k in 0..frames {
        let centre = DVec2::new(60.0 + 2.0 * k as f64, 160.0 - 0.5 * k as f64);
        let picture = image::RgbImage::from_fn(SIDES_PX[0], SIDES_PX[1], |x, y| {
            let off = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) - centre;
            // Six pixels by three and a half, with soft edges.
            let cover = ((1.15 - (off / DVec2::new(6.0, 3.5)).length()) / 0.3).clamp(0.0, 1.0);
            let sky = 170.0 + 0.1 * f64::from(y) + 2.0 * rng.normal();
            let grey = sky + cover * (45.0 - sky);
            image::Rgb([grey - 10.0, grey, grey + 12.0].map(|c| c as u8))
        });
        let name = format!("{k:04}.png");
        picture.save(folder.join(&name)).unwrap();
        images.push(serde_json::json!({
            "id": k, "file_name": name, "width": SIDES_PX[0], "height": SIDES_PX[1],
        }));
        if let Some(flags) = &flags {
            let mut annotation = serde_json::json!({
                "id": k, "image_id": k, "category_id": 1,
                "bbox": [centre.x - 9.0, centre.y - 7.0, 18.0, 14.0],
            });
            let entries = annotation.as_object_mut().unwrap();
            entries.extend(flags.as_object().unwrap().clone());
            annotations.push(annotation);
        }
    }
    let coco = serde_json::json!({
        "images": images,
        "annotations": annotations,
        "categories": [{ "id": 1, "name": "drone" }],
    });
    let path = folder.join("boxes.json");
    std::fs::write(&path, coco.to_string()).unwrap();
    path
}

/// What is found in a region to ignore speaks neither for the tracker nor against it.
#[test]
fn a_clips_regions_to_ignore_are_neither_hits_nor_false_alarms() {
    const FRAMES: usize = 40;
    let root = TempDir::new().unwrap();
    let played = |name: &str, flags: Option<Value>| {
        let clip = root.path().join(name);
        let boxes = blob_clip(&clip, FRAMES, flags);
        let out = root.path().join(format!("{name}-out"));
        let [clip, boxes] = [&clip, &boxes].map(|path| path.to_str().unwrap());
        let model = [
            "--model",
            "assets/models/saliency.onnx",
            "--threshold",
            "0.5",
        ];
        let air = ["--centre-sigma-px", "0.5", "--boxes", boxes];
        let args = [&["eval", "clip", clip][..], &model, &air].concat();
        measured(&out, &args, "clip").0
    };
    let number = |json: &Value, pointer: &str| {
        let value = json.pointer(pointer).and_then(Value::as_f64);
        value.unwrap_or_else(|| panic!("{pointer} is no number in {json:#}"))
    };
    let share = "/clips/0/tracks/0/on_uav_share";

    let counted = played("counted", Some(serde_json::json!({})));
    assert!(number(&counted, "/recall") > 0.9, "{counted:#}");
    assert!(number(&counted, share) > 0.9, "{counted:#}");

    let ignored = played("ignored", Some(serde_json::json!({ "ignore": true })));
    assert_eq!(number(&ignored, "/boxes"), 0.0);
    // The detector and the tracker did the same as before.
    for key in ["/detections", "/locked_share", "/clips/0/tracks/0/frames"] {
        assert_eq!(ignored.pointer(key), counted.pointer(key), "{key}");
    }
    assert!(number(&ignored, "/locked_share") > 0.5, "{ignored:#}");
    for key in ["/false_alarms", "/false_lock_share", "/duplicates"] {
        assert_eq!(number(&ignored, key), 0.0, "{key}");
    }
    for key in ["/recall", "/on_target_share", share] {
        assert_eq!(ignored.pointer(key), Some(&Value::Null), "{key}");
    }

    let bare = played("bare", None);
    assert!(
        number(&bare, "/false_alarms") > 0.9 * FRAMES as f64,
        "{bare:#}"
    );
    assert!(number(&bare, "/false_lock_share") > 0.5, "{bare:#}");
    assert_eq!(number(&bare, share), 0.0);
}

/// A picture of the window that `view` opens on a virtual display.
fn window(args: &[&str], at_s: &str) -> image::RgbImage {
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("window.png");
    let started = Instant::now();
    let output = on_display()
        .arg("view")
        .args(args)
        .arg("--screenshot")
        .arg(&file)
        .arg(at_s)
        .output()
        .unwrap_or_else(|error| panic!("xvfb-run: {error}; ./setup.sh installs it (xvfb, xauth)"));
    assert!(
        output.status.success(),
        "{}: {}",
        output.status,
        stderr(&output)
    );
    println!("the window: {:.1} s", started.elapsed().as_secs_f64());
    let picture = image::open(&file).unwrap().to_rgb8();
    assert_eq!(picture.dimensions(), (1280, 800));
    picture
}

/// Mean and spread of the grey levels of a part: left, top, right, bottom.
fn grey(picture: &image::RgbImage, [x0, y0, x1, y1]: [u32; 4]) -> (f64, f64) {
    let pixels = (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y)));
    let grey: Vec<f64> = pixels
        .map(|(x, y)| {
            let sum: f64 = picture
                .get_pixel(x, y)
                .0
                .iter()
                .map(|c| f64::from(*c))
                .sum();
            sum / 3.0
        })
        .collect();
    let mean = grey.iter().sum::<f64>() / grey.len() as f64;
    let square = grey.iter().map(|grey| (grey - mean).powi(2)).sum::<f64>();
    (mean, (square / grey.len() as f64).sqrt())
}

/// Opens the window on a virtual display and looks at what it shows: the controls at the top, the panel on the left, the
/// city and the sky beside it.
#[test]
fn the_window_shows_panel_and_scene() {
    let _one = rendering();
    let args = [
        "scenarios/urban_intercept.toml",
        "--set",
        "detector.kind=truth",
    ];
    let picture = window(&args, "0.5");
    let (bar, panel, sky, city) = (
        grey(&picture, [4, 4, 1_240, 68]),
        grey(&picture, [4, 76, 240, 796]),
        grey(&picture, [300, 84, 900, 140]),
        grey(&picture, [300, 400, 900, 740]),
    );
    println!("grey levels: bar {bar:.1?}, panel {panel:.1?}, sky {sky:.1?}, city {city:.1?}");
    // Dark, with light text on it.
    for dark in [bar, panel] {
        assert!(dark.0 < 90.0 && dark.1 > 15.0, "no panel: {dark:?}");
    }
    assert!(sky.0 > panel.0 + 50.0 && sky.1 < 10.0, "no sky: {sky:?}");
    assert!(city.1 > 15.0, "one colour: {city:?}");
}

/// Films are made of recordings with and without pictures, and refused where there is nothing to show.
#[test]
fn a_film_shows_what_was_recorded() {
    let folder = TempDir::new().unwrap();
    let mut run = boresight();
    run.args([
        "run",
        "scenarios/urban_intercept.toml",
        "--set",
        "duration_s=1",
    ]);
    let output = run.args(BLIND).arg("--out").arg(folder.path()).output();
    assert!(output.unwrap().status.success());
    let film = |args: &[&str]| {
        let output = boresight()
            .arg("video")
            .args(["run.mcap", "film.mp4"])
            .args(args)
            .current_dir(folder.path())
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        (output.status.code(), said, stderr(&output))
    };
    let (code, said, _) = film(&["--layout", "map", "--rate-hz", "10"]);
    assert_eq!(code, Some(0));
    assert!(said.contains("(11 pictures)"), "{said}");
    let bytes = std::fs::read(folder.path().join("film.mp4")).unwrap();
    assert_eq!(&bytes[4..8], b"ftyp");
    let (code, _, error) = film(&["--layout", "map", "--rate-hz", "2", "--size", "800x600"]);
    assert_eq!(code, Some(0), "{error}");
    let mut clip = Clip::open(&folder.path().join("film.mp4"), 30.0).unwrap();
    assert_eq!(clip.next_frame().unwrap().unwrap().size_px(), [800, 600]);
    for (size, wanted) in [("large", "such as 1280x720"), ("801x600", "take 800x600")] {
        let (code, _, error) = film(&["--size", size]);
        assert_eq!(code, Some(2), "{size}");
        assert!(
            error.contains("--size") && error.contains(wanted),
            "{error}"
        );
    }
    for (args, names) in [
        (["--layout", "cameras"], "has no pictures"),
        (["--speed", "0"], "--speed"),
        (["--rate-hz", "0"], "--rate-hz"),
    ] {
        let (code, _, error) = film(&args);
        assert_eq!(code, Some(2), "{args:?}");
        assert!(
            error.contains(names) && error.lines().count() == 1,
            "{error}"
        );
    }
}

/// A recording is played back: its pictures stand beside the scene, its states on the time line; a recording
/// that was cut short opens too, and a second one beside it.
#[test]
fn recordings_are_played_back_in_the_window() {
    let _one = rendering();
    let folder = TempDir::new().unwrap();
    let out = folder.path().join("run");
    let mut command = boresight();
    command.args(["run", "scenarios/urban_intercept.toml"]);
    command.args(["--set", "detector.kind=truth", "--set", "duration_s=1.5"]);
    let output = command.arg("--out").arg(&out).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    let whole = out.join("run.mcap");
    let bytes = std::fs::read(&whole).unwrap();
    let cut = folder.path().join("cut.mcap");
    std::fs::write(&cut, &bytes[..bytes.len() * 3 / 4]).unwrap();
    let path = |path: &Path| path.to_str().unwrap().to_owned();

    let (whole, cut) = (path(&whole), path(&cut));
    let picture = window(&[&whole], "1.0");
    let sky = grey(&picture, [300, 20, 900, 80]);
    let inset = grey(&picture, [980, 40, 1_260, 160]);
    // The time line's states, as bright as colours are, and nothing of the scene behind its plots.
    let line = |picture: &image::RgbImage| grey(picture, [130, 600, 1_260, 796]);
    println!(
        "grey levels: sky {sky:.1?}, picture {inset:.1?}, line {:.1?}",
        line(&picture)
    );
    assert!(sky.1 < 10.0, "no sky: {sky:?}");
    assert!(inset.0 > 60.0, "no picture: {inset:?}");
    assert!(
        line(&picture).0 < 60.0 && line(&picture).1 > 12.0,
        "no line"
    );
    let two = window(&[&cut, &whole], "0.8");
    assert!(line(&two).1 > 12.0, "no line of two");
    // Two columns of pictures.
    let columns = [[850, 40, 1_040, 90], [1_070, 40, 1_260, 90]].map(|part| grey(&two, part));
    assert!(columns.iter().all(|column| column.0 > 30.0), "{columns:?}");

    for option in ["--seed=3", "--live=localhost:0", "--out=nowhere"] {
        let mut refused = boresight();
        let refused = refused.args(["view", &whole, option]).output().unwrap();
        assert_eq!(refused.status.code(), Some(2), "{option}");
        let said = stderr(&refused);
        assert!(said.contains("--simulate"), "{option}: {said}");
    }
    let mut refused = boresight();
    let refused = refused
        .args(["view", "scenarios/urban_intercept.toml", &whole])
        .output()
        .unwrap();
    assert_eq!(refused.status.code(), Some(2));
    assert!(
        stderr(&refused).contains("two of them"),
        "{}",
        stderr(&refused)
    );
}

/// Makes the tiny set, or the part of it that `args` ask for, in `folder`.
fn dataset(folder: &Path, args: &[&str]) -> Output {
    let mut command = boresight();
    command.args(["dataset", "recipes/tiny.toml", "--out"]);
    let output = command.arg(folder).args(args).output().unwrap();
    assert!(output.status.success(), "{args:?}: {}", stderr(&output));
    output
}

/// Every file below a folder with its bytes, in order.
fn files(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    let mut waiting = vec![folder.to_path_buf()];
    while let Some(at) = waiting.pop() {
        for entry in std::fs::read_dir(&at).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                waiting.push(path);
            } else {
                let name = path.strip_prefix(folder).unwrap().to_path_buf();
                found.push((name, std::fs::read(&path).unwrap()));
            }
        }
    }
    found.sort();
    found
}

fn same_files(a: &Path, b: &Path) {
    let (a, b) = (files(a), files(b));
    let names =
        |files: &[(PathBuf, Vec<u8>)]| files.iter().map(|f| f.0.clone()).collect::<Vec<_>>();
    assert_eq!(names(&a), names(&b));
    for ((name, a), (_, b)) in a.iter().zip(&b) {
        assert!(a == b, "{} differs", name.display());
    }
}

#[test]
fn tracks_are_written_with_their_truth_whatever_the_threads() {
    let _one = rendering();
    let run = |threads: &str| {
        let folder = TempDir::new().unwrap();
        let mut command = boresight();
        command.args(["tracks", "scenarios/urban_intercept.toml", "--rate-hz", "8"]);
        command.args(["--set", "duration_s=1.5", "--threads", threads, "--out"]);
        let output = command.arg(folder.path()).output().unwrap();
        assert!(output.status.success(), "{}", stderr(&output));
        folder
    };
    let folders = ["1", "8"].map(run);
    let folder = folders[0].path().join("urban_intercept-1");
    let read = |name: &str| std::fs::read(folder.join(name)).unwrap();
    same_files(folders[0].path(), folders[1].path());
    let sheet: Value = serde_json::from_slice(&read("sequences.json")).unwrap();
    let sequences = sheet["sequences"].as_array().unwrap();
    let of_uav = |row: &&Value| row["object"] == "intruder";
    assert!(sequences.iter().filter(of_uav).count() >= 3, "{sheet:#}");
    for row in sequences {
        let class = if of_uav(&row) { "uav" } else { "other" };
        assert_eq!(row["class"], class, "{row}");
    }
    // The shapes are those that the sheet says: a head of 128 bytes and the data.
    let length = |name: &str| read(name).len() - 128;
    let chips = sheet["chips"].as_u64().unwrap() as usize;
    assert_eq!(length("chips.npy"), chips * 24 * 24 * 3);
    assert_eq!(length("index.npy"), sequences.len() * 16 * 4);
}

#[test]
fn a_dataset_is_the_same_however_it_is_made() {
    let _one = rendering();
    let (whole, parts) = (TempDir::new().unwrap(), TempDir::new().unwrap());
    dataset(whole.path(), &[]);
    // Other scenes first, in processes of their own, with another number of threads.
    dataset(parts.path(), &["--scenes", "2..5", "--threads", "1"]);
    let output = dataset(parts.path(), &["--scenes", "1..2"]);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(said.contains("4 of 5 scenes are there"), "{said}");
    dataset(parts.path(), &[]);
    same_files(whole.path(), parts.path());
    // What is lost is made again, and nothing else is touched.
    let kept = parts.path().join("scenes/00003.json");
    let before = std::fs::metadata(&kept).unwrap().modified().unwrap();
    std::fs::remove_file(parts.path().join("scenes/00001.json")).unwrap();
    let lost = files(parts.path())
        .into_iter()
        .find(|(name, _)| name.to_string_lossy().contains("s00002_0001.png"));
    std::fs::remove_file(parts.path().join(lost.unwrap().0)).unwrap();
    dataset(parts.path(), &[]);
    assert_eq!(
        std::fs::metadata(&kept).unwrap().modified().unwrap(),
        before
    );
    same_files(whole.path(), parts.path());
    well_formed(whole.path());

    // Another recipe in the same folder, a bad range and a bad recipe.
    let other = whole.path().join("other.toml");
    std::fs::write(&other, "scenes = 2\n").unwrap();
    let command = |recipe: &Path, args: &[&str]| {
        let mut command = boresight();
        command
            .arg("dataset")
            .arg(recipe)
            .arg("--out")
            .arg(whole.path());
        command.args(args);
        command
    };
    refused(
        &mut command(&other, &[]),
        &["holds a set of another recipe", "--out"],
    );
    let tiny = Path::new("recipes/tiny.toml");
    refused(
        &mut command(tiny, &["--scenes", "3..9"]),
        &["--scenes", "FROM..TO within 0..5"],
    );
    std::fs::write(&other, "scenes = 2\n[camera]\nzoom = 3\n").unwrap();
    refused(
        &mut command(&other, &[]),
        &["other.toml:3", "camera.zoom: unknown key"],
    );
    refused(
        &mut command(Path::new("recipes/none.toml"), &[]),
        &["recipes/none.toml: cannot be read"],
    );
}

/// Checks the COCO files of the tiny set, and the forms beside them.
fn well_formed(folder: &Path) {
    let mut scenes = Vec::new();
    let (mut pictures, mut boxes) = (0, 0);
    for split in ["train", "val"] {
        let text = std::fs::read_to_string(folder.join(split).join("annotations.json")).unwrap();
        let coco: Value = serde_json::from_str(&text).unwrap();
        let list = |key: &str| coco[key].as_array().unwrap().clone();
        let names: Vec<_> = list("categories")
            .iter()
            .map(|c| c["name"].clone())
            .collect();
        let classes = ObjectClass::ALL.map(|class| class.name());
        assert_eq!(names, classes);
        let images = list("images");
        for (i, image) in images.iter().enumerate() {
            assert_eq!(image["id"], i + 1);
            let path = folder
                .join(split)
                .join(image["file_name"].as_str().unwrap());
            let rgb = image::open(&path).unwrap().into_rgb8();
            assert_eq!(
                [image["width"].as_u64(), image["height"].as_u64()],
                [Some(320), Some(240)]
            );
            assert_eq!(rgb.dimensions(), (320, 240));
            // Neither black, nor white, nor one colour.
            let mean = rgb.iter().map(|v| f64::from(*v)).sum::<f64>() / rgb.as_raw().len() as f64;
            assert!((10.0..252.0).contains(&mean), "{}: {mean}", path.display());
            scenes.push((image["scene"].as_u64().unwrap(), split));
        }
        for (i, seen) in list("annotations").iter().enumerate() {
            assert_eq!(seen["id"], i + 1);
            let image = &images[seen["image_id"].as_u64().unwrap() as usize - 1];
            let side = |k: usize| seen["bbox"][k].as_f64().unwrap();
            assert!(
                side(0) >= 0.0 && side(1) >= 0.0 && side(2).max(side(3)) >= 2.0,
                "{seen}"
            );
            assert!(
                side(0) + side(2) <= 320.0 && side(1) + side(3) <= 240.0,
                "{seen}"
            );
            let fpv = seen["model"] == "fpv5";
            assert_eq!(seen["category_id"] == 1, fpv, "{seen}");
            assert!(seen["visible_fraction"].as_f64().unwrap() >= 0.1, "{seen}");
            assert!(image["file_name"].is_string());
        }
        pictures += images.len();
        boxes += list("annotations").len();
        let labels = std::fs::read_dir(folder.join(split).join("labels")).unwrap();
        let stills = images.iter().filter(|i| i["sequence"].is_null()).count();
        assert_eq!(labels.count(), stills);
    }
    assert_eq!(pictures, 4 * 3 + 3);
    assert!(boxes >= 8, "{boxes}");
    let train: Vec<u64> = scenes
        .iter()
        .filter(|s| s.1 == "train")
        .map(|s| s.0)
        .collect();
    assert!(
        scenes
            .iter()
            .filter(|s| s.1 == "val")
            .all(|s| !train.contains(&s.0))
    );
    assert!(train.len() < scenes.len() && !train.is_empty());
    let truth = std::fs::read_to_string(folder.join("sequences/c0000/gt/gt.txt")).unwrap();
    assert!(truth.lines().next().unwrap().starts_with("1,"), "{truth}");
    let about: Value =
        serde_json::from_str(&std::fs::read_to_string(folder.join("dataset.json")).unwrap())
            .unwrap();
    assert_eq!(about["complete"], true);
    let page = std::fs::read_to_string(folder.join("statistics.html")).unwrap();
    assert!(page.contains("boxes by category") && page.contains("data:image/jpeg;base64,"));
}
