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
    /// Where its pictures come from.
    pub origin: Origin,
    /// Name of its sequence, where it is one.
    pub sequence: Option<String>,
    /// Its pictures.
    pub images: Vec<Picture>,
}

/// Where the pictures of a scene come from.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(tag = "source", rename_all = "snake_case")]
pub enum Origin {
    /// They are rendered.
    Rendered(Setting),
    /// They are frames of a clip of a real camera.
    Real {
        /// The clip's name.
        clip: String,
    },
}

impl SceneRecord {
    /// Whether its pictures are those of a real camera.
    pub fn is_real(&self) -> bool {
        matches!(self.origin, Origin::Real { .. })
    }

    /// The surroundings of what is rendered.
    pub fn setting(&self) -> Option<&Setting> {
        match &self.origin {
            Origin::Rendered(setting) => Some(setting),
            Origin::Real { .. } => None,
        }
    }
}

/// The surroundings of a rendered scene.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Setting {
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
    /// How its UAVs fly, where that is known.
    pub motion: Option<Motion>,
    /// Its UAVs and distractors.
    pub annotations: Vec<Annotation>,
}

impl Picture {
    /// Its UAVs.
    pub fn uavs(&self) -> impl Iterator<Item = &Annotation> {
        (self.annotations.iter()).filter(|seen| seen.class.is_uav())
    }

    /// Number of birds and the like that have a box.
    fn distractors(&self) -> usize {
        self.annotations.len() - self.uavs().count()
    }
}

/// Something in a picture.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Annotation {
    /// Its model in the catalogue, or the kind of what is none; in real pictures its label.
    pub model: String,
    /// Its class.
    pub class: ObjectClass,
    /// Whether so little of it is seen, or so faintly, that it is neither asked for nor a false alarm.
    pub ignore: bool,
    /// x, y, width, height of what is seen of it [px].
    pub bbox: [f64; 4],
    /// Area of what is seen of it [px^2].
    pub area: f64,
    /// Contrast to its surroundings over the noise of a pixel: rms over the silhouette, of real pictures the strongest.
    pub contrast: f64,
    /// What only the renderer knows.
    pub rendered: Option<Truth>,
    /// Tells apart the things of a scene, of a real one those of a picture.
    pub track_id: u32,
}

impl Annotation {
    /// Whether at least this share of its silhouette is seen, as far as anybody knows.
    pub fn shows(&self, share: f64) -> bool {
        self.rendered
            .is_none_or(|truth| truth.visible_fraction >= share)
    }
}

/// What only the renderer knows of something in a picture.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Truth {
    /// Where the laser would aim: the projection of the body's middle [px].
    pub aim: [f64; 2],
    /// Distance [m].
    pub range_m: f64,
    /// Share of its silhouette that is seen.
    pub visible_fraction: f64,
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
            let mut about = json!({
                "id": id,
                "file_name": image.file_name,
                "width": image.width,
                "height": image.height,
                "scene": record.scene,
                "distractors": image.distractors(),
            });
            let keys = match &record.origin {
                Origin::Rendered(setting) => json!({
                    "source": "rendered",
                    "sequence": record.sequence,
                    "background": setting.background,
                    "motion": image.motion,
                    "camera": setting.camera,
                    "sun_elevation_deg": setting.sun_elevation_deg,
                    "visibility_m": setting.visibility_m,
                }),
                Origin::Real { clip } => json!({ "source": "real", "clip": clip }),
            };
            extend(&mut about, keys);
            images.push(about);
            for seen in &image.annotations {
                let mut about = json!({
                    "id": annotations.len() + 1,
                    "image_id": id,
                    "category_id": seen.class.category_id(),
                    "bbox": seen.bbox.map(milli),
                    "area": milli(seen.area),
                    "iscrowd": 0,
                    "ignore": u8::from(seen.ignore),
                    "model": seen.model,
                    "contrast": milli(seen.contrast),
                    "track_id": seen.track_id,
                });
                if let Some(truth) = seen.rendered {
                    let keys = json!({
                        "aim": truth.aim.map(milli),
                        "range_m": milli(truth.range_m),
                        "visible_fraction": milli(truth.visible_fraction),
                    });
                    extend(&mut about, keys);
                }
                annotations.push(about);
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
        "info": { "description": "UAVs, rendered by Boresight or filmed" },
        "categories": categories,
        "images": images,
        "annotations": annotations,
    })
}

/// Adds the keys of one JSON object to another.
fn extend(object: &mut Value, more: Value) {
    if let (Value::Object(object), Value::Object(more)) = (object, more) {
        object.extend(more);
    }
}

/// Makes the folders of a sequence.
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
                seen.rendered.map_or(1.0, |truth| truth.visible_fraction)
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
            motion: Some(Motion::Level),
            annotations: vec![Annotation {
                model: "mavic2".into(),
                class: ObjectClass::Quadcopter,
                ignore: false,
                bbox: [10.0, 20.0, 30.0, 10.0],
                area: 120.0,
                contrast: 8.0,
                rendered: Some(Truth {
                    aim: [25.0, 25.0],
                    range_m: 300.0,
                    visible_fraction: 0.75,
                }),
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
            origin: Origin::Rendered(Setting {
                background: Background::Urban,
                sun_elevation_deg: 30.0,
                visibility_m: 10_000.0,
                cloud_cover: 0.5,
                camera: CameraRecord {
                    hfov_deg: 4.0,
                    r_enu_m: [0.0; 3],
                },
            }),
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
        assert_eq!(file["images"][0]["source"], "rendered");
        assert_eq!(file["annotations"][0]["range_m"], 300.0);
    }

    #[test]
    fn a_real_picture_says_its_clip_and_nothing_of_what_nobody_knows() {
        let mut image = image();
        image.motion = None;
        image.annotations[0].rendered = None;
        let record = SceneRecord {
            scene: 2,
            split: Split::Train,
            origin: Origin::Real { clip: "V_1".into() },
            sequence: None,
            images: vec![image],
        };
        let text = serde_json::to_string(&record).unwrap();
        let record: SceneRecord = serde_json::from_str(&text).unwrap();
        let file = file(&[&record]);
        assert_eq!(file["images"][0]["source"], "real");
        assert_eq!(file["images"][0]["clip"], "V_1");
        let keys = |value: &Value, key: &str| value[0].as_object().unwrap().contains_key(key);
        assert!(!keys(&file["images"], "background") && !keys(&file["annotations"], "range_m"));
    }
}
