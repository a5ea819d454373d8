//! The records of a set, and their COCO and YOLO forms.

use super::shares::{Background, Motion, Split};
use crate::models::flight::class::ObjectClass;
use crate::output::{self, OutputError};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::Path;

/// What is written down about a finished scene.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SceneRecord {
    /// Its number.
    pub scene: u32,
    /// The part of the set that it belongs to.
    pub split: Split,
    /// What stands behind its targets.
    pub background: Background,
    /// Height of the sun [deg].
    pub sun_elevation_deg: f64,
    /// Meteorological visibility [m].
    pub visibility_m: f64,
    /// Covered share of the sky.
    pub cloud_cover: f64,
    /// Its camera and where it stands.
    pub camera: CameraRecord,
    /// Name of its clip, where it is one.
    pub sequence: Option<String>,
    /// Its pictures.
    pub images: Vec<Picture>,
}

/// The camera of a scene.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct CameraRecord {
    /// Horizontal field of view [deg].
    pub hfov_deg: f64,
    /// Where it stands [m, enu].
    pub r_enu_m: [f64; 3],
}

/// A picture.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Picture {
    /// Its file, from the split's folder.
    pub file_name: String,
    /// Width [px].
    pub width: u32,
    /// Height [px].
    pub height: u32,
    /// How its UAVs fly.
    pub motion: Motion,
    /// Birds and the like in it.
    pub distractors: usize,
    /// Its UAVs and distractors.
    pub annotations: Vec<Annotation>,
}

impl Picture {
    /// Its UAVs.
    pub fn uavs(&self) -> impl Iterator<Item = &Annotation> {
        (self.annotations.iter()).filter(|seen| seen.class.is_uav())
    }
}

/// Something in a picture.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Annotation {
    /// Its model in the catalogue, or the kind of what is none.
    pub model: String,
    /// Its class.
    pub class: ObjectClass,
    /// Whether so little of it is seen, or so faintly, that it is neither asked for nor a false alarm.
    pub ignore: bool,
    /// x, y, width, height of what is seen of it [px].
    pub bbox: [f64; 4],
    /// Area of what is seen of it [px^2].
    pub area: f64,
    /// Where the laser would aim: the projection of the body's middle [px].
    pub aim: [f64; 2],
    /// Distance [m].
    pub range_m: f64,
    /// Share of its silhouette that is seen.
    pub visible_fraction: f64,
    /// Contrast to its surroundings over the noise of a pixel.
    pub contrast: f64,
    /// Tells apart the UAVs of a scene.
    pub track_id: u32,
}

/// Rounds to three decimals.
fn milli(x: f64) -> f64 {
    (1e3 * x).round() / 1e3
}

/// The COCO file of some scenes.
pub fn file(records: &[&SceneRecord]) -> Value {
    let (mut images, mut annotations) = (Vec::new(), Vec::new());
    for record in records {
        for image in &record.images {
            let id = images.len() + 1;
            images.push(json!({
                "id": id,
                "file_name": image.file_name,
                "width": image.width,
                "height": image.height,
                "scene": record.scene,
                "sequence": record.sequence,
                "background": record.background,
                "motion": image.motion,
                "distractors": image.distractors,
                "camera": record.camera,
                "sun_elevation_deg": record.sun_elevation_deg,
                "visibility_m": record.visibility_m,
            }));
            for seen in &image.annotations {
                annotations.push(json!({
                    "id": annotations.len() + 1,
                    "image_id": id,
                    "category_id": seen.class.category_id(),
                    "bbox": seen.bbox,
                    "area": seen.area,
                    "aim": seen.aim.map(milli),
                    "iscrowd": 0,
                    "ignore": u8::from(seen.ignore),
                    "model": seen.model,
                    "range_m": milli(seen.range_m),
                    "visible_fraction": milli(seen.visible_fraction),
                    "contrast": milli(seen.contrast),
                    "track_id": seen.track_id,
                }));
            }
        }
    }
    let categories = ObjectClass::ALL.map(|class| {
        json!({
            "id": class.category_id(),
            "name": class.name(),
            "supercategory": if class.is_uav() { "uav" } else { "distractor" },
        })
    });
    json!({
        "info": { "description": "UAVs rendered by Boresight" },
        "categories": categories,
        "images": images,
        "annotations": annotations,
    })
}

/// Makes the folders of a clip.
pub fn sequence_folder(out: &Path, name: &str) -> Result<(), OutputError> {
    let folder = out.join("sequences").join(name);
    output::create_dir(&folder.join("img1"))?;
    output::create_dir(&folder.join("gt"))
}

/// The truth and the description of a clip in MOTChallenge's form: frame and identity from 1, left,
/// top, width, height, 1 (0: no UAV, not to be followed), class, visible share.
pub fn mot(record: &SceneRecord, name: &str, rate_hz: f64) -> (String, String) {
    let mut truth = String::new();
    for (frame, image) in record.images.iter().enumerate() {
        for seen in &image.annotations {
            let [x, y, w, h] = seen.bbox;
            // Writing to a string cannot fail.
            let _ = writeln!(
                truth,
                "{},{},{x:.3},{y:.3},{w:.3},{h:.3},{},{},{:.3}",
                frame + 1,
                seen.track_id,
                u8::from(seen.class.is_uav()),
                seen.class.category_id(),
                seen.visible_fraction
            );
        }
    }
    let [width, height] = (record.images.first()).map_or([0, 0], |i| [i.width, i.height]);
    let about = format!(
        "[Sequence]\nname={name}\nimDir=img1\nframeRate={rate_hz}\nseqLength={}\nimWidth={width}\n\
         imHeight={height}\nimExt=.png\n",
        record.images.len()
    );
    (truth, about)
}

/// The YOLO file of a picture: its name and its lines of class, centre and size.
pub fn yolo(image: &Picture) -> (String, String) {
    let stem = image
        .file_name
        .trim_start_matches("images/")
        .trim_end_matches(".png");
    let (width, height) = (f64::from(image.width), f64::from(image.height));
    let mut lines = String::new();
    for seen in image.annotations.iter().filter(|seen| !seen.ignore) {
        let [x, y, w, h] = seen.bbox;
        // Writing to a string cannot fail.
        let _ = writeln!(
            lines,
            "{} {:.6} {:.6} {:.6} {:.6}",
            seen.class.category_id() - 1,
            (x + 0.5 * w) / width,
            (y + 0.5 * h) / height,
            w / width,
            h / height,
        );
    }
    (format!("{stem}.txt"), lines)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image() -> Picture {
        Picture {
            file_name: "images/s00001_0002.png".into(),
            width: 200,
            height: 100,
            motion: Motion::Level,
            distractors: 1,
            annotations: vec![Annotation {
                model: "mavic2".into(),
                class: ObjectClass::Quadcopter,
                ignore: false,
                bbox: [10.0, 20.0, 30.0, 10.0],
                area: 120.0,
                aim: [25.0, 25.0],
                range_m: 300.0,
                visible_fraction: 0.75,
                contrast: 8.0,
                track_id: 4,
            }],
        }
    }

    #[test]
    fn yolo_counts_classes_from_0_and_gives_centre_and_size() {
        let (name, lines) = yolo(&image());
        assert_eq!(name, "s00001_0002.txt");
        assert_eq!(lines, "1 0.125000 0.250000 0.150000 0.100000\n");
    }

    #[test]
    fn mot_counts_frames_from_1() {
        let record = SceneRecord {
            scene: 1,
            split: Split::Val,
            background: Background::Urban,
            sun_elevation_deg: 30.0,
            visibility_m: 10_000.0,
            cloud_cover: 0.5,
            camera: CameraRecord {
                hfov_deg: 4.0,
                r_enu_m: [0.0; 3],
            },
            sequence: Some("c0001".into()),
            images: vec![image(), image()],
        };
        let (truth, about) = mot(&record, "c0001", 30.0);
        let last = "2,4,10.000,20.000,30.000,10.000,1,2,0.750";
        assert_eq!(truth.lines().last(), Some(last));
        assert!(
            about.contains("seqLength=2\nimWidth=200\nimHeight=100\n"),
            "{about}"
        );
        assert!(
            about.contains("name=c0001\nimDir=img1\nframeRate=30\n"),
            "{about}"
        );
        let file = file(&[&record]);
        assert_eq!(file["images"][1]["id"], 2);
        assert_eq!(file["annotations"][1]["image_id"], 2);
        assert_eq!(file["annotations"][1]["model"], "mavic2");
        assert_eq!(file["images"][0]["sequence"], "c0001");
    }
}
