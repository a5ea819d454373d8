//! Pictures of real cameras in data sets and tracks: boxes against those drawn by hand, and clips made for the purpose.

use crate::common::{ROOT, boresight, refused, stderr};
use boresight::media::video::Clip;
use boresight::models::optics::tighten::{TightenParams, tighten};
use image::{Rgb, RgbImage};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// The training clips of the data beside the repository; `None`, with a word, where they are absent.
fn real_clips() -> Option<PathBuf> {
    let path = Path::new(ROOT).join("../shared/data/real-uav/train/visible");
    let there = path.join("boxes.json").exists();
    if !there {
        println!("skipped: {} is not there", path.display());
    }
    there.then_some(path)
}

fn corners(xywh: &Value) -> [f64; 4] {
    let side = |k: usize| xywh[k].as_f64().unwrap();
    [side(0), side(1), side(0) + side(2), side(1) + side(3)]
}

fn iou(a: [f64; 4], b: [f64; 4]) -> f64 {
    let side = |k: usize| (a[k + 2].min(b[k + 2]) - a[k].max(b[k])).max(0.0);
    let area = |c: [f64; 4]| (c[2] - c[0]) * (c[3] - c[1]);
    let inner = side(0) * side(1);
    inner / (area(a) + area(b) - inner)
}

/// Of the boxes drawn by hand every second was used to choose three settings; held to are the others.
#[test]
fn boxes_are_tightened_as_by_hand() {
    let Some(folder) = real_clips() else {
        return;
    };
    let text = std::fs::read_to_string(Path::new(ROOT).join("tests/data/hand_boxes.json"));
    let rows: Vec<Value> = serde_json::from_str(&text.unwrap()).unwrap();
    let mut by_clip: BTreeMap<String, Vec<Value>> = BTreeMap::new();
    for row in rows
        .into_iter()
        .filter(|row| row["hand"].is_array() && row["chosen_on"] == false)
    {
        let file = row["file"].as_str().unwrap().to_owned();
        by_clip.entry(file).or_default().push(row);
    }
    let mut found = Vec::new();
    for (file, rows) in by_clip {
        let mut clip = Clip::open(&folder.join(file), 30.0).unwrap();
        let last = rows
            .iter()
            .map(|row| row["frame"].as_u64().unwrap())
            .max()
            .unwrap();
        for index in 0..=last {
            let frame = clip.next_frame().unwrap().unwrap();
            for row in rows.iter().filter(|row| row["frame"] == index) {
                let others: Vec<[f64; 4]> = row["others_xywh"]
                    .as_array()
                    .unwrap()
                    .iter()
                    .map(corners)
                    .collect();
                let tight = tighten(
                    frame.picture.as_raw(),
                    frame.size_px(),
                    corners(&row["loose_xywh"]),
                    &others,
                    &TightenParams::default(),
                );
                let hand: Vec<f64> = (row["hand"].as_array().unwrap().iter())
                    .map(|v| v.as_f64().unwrap())
                    .collect();
                found.push(tight.map_or(0.0, |tight| iou(tight.box_px, hand.try_into().unwrap())));
            }
        }
    }
    found.sort_by(f64::total_cmp);
    let share =
        |least: f64| found.iter().filter(|iou| **iou >= least).count() as f64 / found.len() as f64;
    let mean = found.iter().sum::<f64>() / found.len() as f64;
    let median = found[found.len() / 2];
    println!(
        "{} boxes: IoU mean {mean:.3}, median {median:.3}, 0.5 and more {:.3}",
        found.len(),
        share(0.5)
    );
    assert!(
        found.len() >= 45 && mean >= 0.75 && median >= 0.8 && share(0.5) >= 0.9,
        "{mean} {median} {}",
        share(0.5)
    );
}

/// Two clips of 60 pictures of 192 × 128 px in folders: a dark bar of 14 × 5 px crosses, boxes loose by 6 px about it.
fn made_clips(folder: &Path) {
    let mut list = Vec::new();
    for (name, label, rows) in [("V_A", "drone", 40.0), ("V_B", "bird", 80.0)] {
        std::fs::create_dir_all(folder.join(name)).unwrap();
        let mut boxes = Vec::new();
        for k in 0..60u32 {
            let (left, top) = (20.0 + 2.0 * f64::from(k), rows);
            let picture = RgbImage::from_fn(192, 128, |x, y| {
                let inside = (left..left + 14.0).contains(&f64::from(x))
                    && (top..top + 5.0).contains(&f64::from(y));
                let grain = ((x * 7 + y * 13 + k * 5) % 5) as u8;
                let grey = if inside { 40 } else { 150 + (y / 4) as u8 } + grain;
                Rgb([grey - 10, grey, grey + 10])
            });
            picture
                .save(folder.join(name).join(format!("{k:04}.png")))
                .unwrap();
            boxes.push(json!({ label: [[left - 6.0, top - 6.0, 26.0, 17.0]] }));
        }
        list.push(json!({ "file": name, "frames": 60, "boxes_xywh": boxes }));
    }
    std::fs::write(folder.join("boxes.json"), json!(list).to_string()).unwrap();
}

const RECIPE: &str = "scenes = 0\n[real]\npictures = 20\nval = [\"V_B\"]\n";

#[test]
fn real_clips_join_a_data_set_and_leave_tracks() {
    let folder = TempDir::new().unwrap();
    let clips = folder.path().join("clips");
    made_clips(&clips);
    let recipe = folder.path().join("real.toml");
    std::fs::write(&recipe, RECIPE).unwrap();
    let command = |out: &str, args: &[&str]| {
        let mut command = boresight();
        command
            .arg("dataset")
            .arg(&recipe)
            .arg("--out")
            .arg(folder.path().join(out))
            .args(args);
        command
    };
    let real = clips.to_str().unwrap();
    for (out, threads) in [("one", "1"), ("two", "2")] {
        let output = command(out, &["--real", real, "--threads", threads])
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", stderr(&output));
    }
    let read = |path: &str| std::fs::read_to_string(folder.path().join(path)).unwrap();
    for part in ["train", "val"] {
        let [one, two] = ["one", "two"].map(|out| read(&format!("{out}/{part}/annotations.json")));
        assert_eq!(one, two);
        let coco: Value = serde_json::from_str(&one).unwrap();
        let images = coco["images"].as_array().unwrap();
        let (clip, category, row) = if part == "train" {
            ("V_A", 2, 40.0)
        } else {
            ("V_B", 4, 80.0)
        };
        assert!(
            (4..=13).contains(&images.len()),
            "{part}: {} pictures",
            images.len()
        );
        for (image, seen) in images.iter().zip(coco["annotations"].as_array().unwrap()) {
            let name = image["file_name"].as_str().unwrap();
            assert!(name.starts_with(&format!("images/{clip}_")), "{name}");
            assert_eq!(
                (&image["source"], &image["clip"]),
                (&json!("real"), &json!(clip))
            );
            assert_eq!(
                (&seen["category_id"], &seen["ignore"]),
                (&json!(category), &json!(0))
            );
            let number: f64 = name[11..15].parse().unwrap();
            let left = 20.0 + 2.0 * number;
            let wanted = [left, row, left + 14.0, row + 5.0];
            assert!(iou(corners(&seen["bbox"]), wanted) > 0.85, "{name}: {seen}");
        }
    }
    assert!(read("one/statistics.html").contains("quadcopter"));

    // The same clips as tracks: the bar that is called a drone is a UAV, the other a bird, whatever the detector says.
    let mut tracks = boresight();
    tracks
        .args(["tracks", "--real", real, "--recipe"])
        .arg(&recipe)
        .args(["--model", "assets/models/saliency.onnx", "--out"])
        .arg(folder.path().join("tracks"));
    let output = tracks.output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    for (clip, split, class) in [("V_A", "train", "uav"), ("V_B", "val", "bird")] {
        let sheet: Value =
            serde_json::from_str(&read(&format!("tracks/{clip}/sequences.json"))).unwrap();
        assert_eq!(
            (&sheet["clip"], &sheet["split"]),
            (&json!(clip), &json!(split))
        );
        let sequences = sheet["sequences"].as_array().unwrap();
        assert!(
            !sequences.is_empty() && sequences.iter().all(|seen| seen["class"] == class),
            "{sheet}"
        );
    }

    // Tracks that are there are kept, but not for others.
    let again = tracks.output().unwrap();
    assert!(String::from_utf8_lossy(&again.stdout).contains("V_A: whole"));
    refused(
        tracks.args(["--rate-hz", "2"]),
        &["V_A", "another detector, rate", "--out"],
    );

    refused(&mut command("bad", &[]), &["real.pictures", "--real"]);
    let write = |text: &str| std::fs::write(&recipe, text).unwrap();
    write("scenes = 1\n");
    refused(
        &mut command("bad", &["--real", real]),
        &["--real", "no real pictures"],
    );
    write(&RECIPE.replace("V_B", "V_C"));
    refused(
        &mut command("bad", &["--real", real]),
        &["boxes.json", "no clip 'V_C'", "real.val"],
    );
    write(RECIPE);
    let text = std::fs::read_to_string(clips.join("boxes.json")).unwrap();
    std::fs::write(clips.join("boxes.json"), text.replace("drone", "thing")).unwrap();
    refused(
        &mut command("bad", &["--real", real]),
        &["'thing'", "real.labels.thing"],
    );
    std::fs::write(clips.join("boxes.json"), text.replace("V_B", "V_A.1")).unwrap();
    refused(
        &mut command("bad", &["--real", real]),
        &["V_A and V_A.1", "rename one"],
    );
    std::fs::write(clips.join("boxes.json"), text).unwrap();
    std::fs::remove_file(clips.join("V_A/0059.png")).unwrap();
    refused(
        &mut command("bad", &["--real", real]),
        &["lists 60 frames of V_A", "59"],
    );
}
