//! Annotated pictures in COCO's format, from the folder layouts in use.

use super::metrics::Truth;
use crate::media::image::decode;
use crate::models::flight::class::ObjectClass;
use clap::ValueEnum;
use image::RgbImage;
use serde::{Deserialize, Deserializer};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// The layouts that `Coco::load` takes, for messages.
const LAYOUTS: &str = "give the JSON file itself, or a folder that holds annotations.json, one other .json \
     file, or annotations/ with one .json file";

/// Why a set of annotated pictures cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CocoError {
    /// A file or folder cannot be read.
    #[error("{path}: cannot be read ({why}); {LAYOUTS}")]
    Unreadable {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        why: String,
    },
    /// There is no annotation file, or more than one.
    #[error("{path}: {why}; {LAYOUTS}")]
    Layout {
        /// The folder.
        path: PathBuf,
        /// What was found.
        why: String,
    },
    /// The file is no JSON or not of COCO's form.
    #[error("{path}: {source}")]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: ContentError,
    },
    /// The categories that count are not named.
    #[error("{path}: categories: {why}; name those that count with --category")]
    Category {
        /// The file.
        path: PathBuf,
        /// What was found.
        why: String,
    },
    /// A picture is missing, or its file holds none.
    #[error("{path}: {why}; a PNG or JPEG file of this name must lie {}", beside(.looked))]
    Picture {
        /// The picture.
        path: PathBuf,
        /// What is wrong.
        why: String,
        /// Folders in which it was looked for.
        looked: Vec<PathBuf>,
    },
}

fn beside(looked: &[PathBuf]) -> String {
    let folders: Vec<_> = looked.iter().map(|f| f.display().to_string()).collect();
    match folders.len() {
        0 => "there".into(),
        _ => format!("in {}", folders.join(" or ")),
    }
}

/// What is wrong in an annotation file.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum ContentError {
    /// No JSON, a key missing or of another type.
    #[error("{0}; expected COCO's keys images, annotations and categories")]
    Json(String),
    /// A value that cannot be.
    #[error("{list}[{index}].{key}: {why}")]
    Value {
        /// List of the file.
        list: &'static str,
        /// Index in it.
        index: usize,
        /// Key in the entry.
        key: &'static str,
        /// What is wrong, and what would be right.
        why: String,
    },
}

/// An annotation file before it is checked.
#[derive(Debug, Deserialize)]
struct File {
    images: Vec<Picture>,
    annotations: Vec<Annotation>,
    categories: Vec<Category>,
}

/// A picture of the set.
#[derive(Clone, Debug, Deserialize, PartialEq)]
pub struct Picture {
    /// Its id in the file.
    pub id: i64,
    /// Its file's name, perhaps with folders.
    pub file_name: String,
    /// Width [px].
    pub width: u32,
    /// Height [px].
    pub height: u32,
    /// The scene or clip that it is of, where the file says so.
    #[serde(default, deserialize_with = "name")]
    pub scene: Option<String>,
}

impl Picture {
    /// Width and height [px].
    pub fn size_px(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// What pictures of one scene share: its name, or the file's name without the number at its end.
    pub fn clip(&self) -> &str {
        if let Some(scene) = &self.scene {
            return scene;
        }
        let stem = (self.file_name.rsplit_once('.')).map_or(&*self.file_name, |(stem, _)| stem);
        let clip = stem.trim_end_matches(|c: char| c.is_ascii_digit());
        match clip.trim_end_matches(['_', '-', '.']) {
            "" => &self.file_name,
            clip => clip,
        }
    }
}

#[derive(Debug, Deserialize)]
struct Annotation {
    image_id: i64,
    category_id: i64,
    bbox: [f64; 4],
    area: Option<f64>,
    #[serde(default, deserialize_with = "flag")]
    iscrowd: bool,
    #[serde(default, deserialize_with = "flag")]
    ignore: bool,
    #[serde(default = "yes", deserialize_with = "flag")]
    tight: bool,
}

#[derive(Debug, Deserialize)]
struct Category {
    id: i64,
    name: String,
    #[serde(default)]
    supercategory: Option<String>,
}

fn yes() -> bool {
    true
}

/// Files have flags as `true` and as 1.
fn flag<'de, D: Deserializer<'de>>(from: D) -> Result<bool, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged, expecting = "expected true, false, 1 or 0")]
    enum Flag {
        Bool(bool),
        Number(u8),
    }
    match Flag::deserialize(from)? {
        Flag::Bool(flag) => Ok(flag),
        Flag::Number(number @ 0..=1) => Ok(number == 1),
        Flag::Number(_) => Err(serde::de::Error::custom("expected true, false, 1 or 0")),
    }
}

/// Files name scenes by text or by number; anything else names none.
fn name<'de, D: Deserializer<'de>>(from: D) -> Result<Option<String>, D::Error> {
    Ok(match serde_json::Value::deserialize(from)? {
        serde_json::Value::String(name) => Some(name),
        serde_json::Value::Number(number) => Some(number.to_string()),
        _ => None,
    })
}

/// Categories that are UAVs unless others are named.
pub const UAVS: [&str; 8] = [
    "uav",
    "drone",
    "fpv",
    "quadcopter",
    "hexacopter",
    "octocopter",
    "multirotor",
    "fixed_wing",
];
/// Categories that are no UAVs unless named, beside [`ObjectClass`]'s own.
pub const OTHERS: [&str; 2] = ["plane", "kite"];

/// Whether a category of this name is no UAV unless named.
pub fn is_other(name: &str) -> bool {
    ObjectClass::of_name(name).is_some_and(|class| !class.is_uav())
        || OTHERS.iter().any(|other| other.eq_ignore_ascii_case(name))
}

/// The content of an annotation file, checked.
#[derive(Debug)]
pub struct Content {
    /// Pictures in the order of their ids.
    pub pictures: Vec<Picture>,
    /// Category and box of every annotation, in the order of `pictures`.
    boxes: Vec<Vec<(i64, Truth)>>,
    categories: Vec<Category>,
}

impl Content {
    /// Reads the text of an annotation file. Annotations with `iscrowd`, `ignore` or
    /// `tight: false` become regions that are ignored.
    pub fn parse(text: &str) -> Result<Self, ContentError> {
        let mut file: File =
            serde_json::from_str(text).map_err(|error| ContentError::Json(error.to_string()))?;
        let wrong = |list, index, key, why: String| ContentError::Value {
            list,
            index,
            key,
            why,
        };
        let mut categories = BTreeSet::new();
        for (i, category) in file.categories.iter().enumerate() {
            if !categories.insert(category.id) {
                let why = format!("{} is given twice", category.id);
                return Err(wrong("categories", i, "id", why));
            }
        }
        let mut seen = BTreeSet::new();
        for (i, picture) in file.images.iter().enumerate() {
            if picture.width == 0 || picture.height == 0 {
                let why = "0, must be the picture's size in pixels".into();
                return Err(wrong("images", i, "width, height", why));
            }
            if picture.file_name.is_empty() {
                return Err(wrong("images", i, "file_name", "is empty".into()));
            }
            if !seen.insert(picture.id) {
                let why = format!("{} is given twice", picture.id);
                return Err(wrong("images", i, "id", why));
            }
        }
        file.images.sort_by_key(|picture| picture.id);
        let places: BTreeMap<i64, usize> = (file.images.iter().enumerate())
            .map(|(place, picture)| (picture.id, place))
            .collect();
        let mut boxes = vec![Vec::new(); file.images.len()];
        for (i, annotation) in file.annotations.iter().enumerate() {
            let wrong = |key, why: String| wrong("annotations", i, key, why);
            let Some(&place) = places.get(&annotation.image_id) else {
                let why = format!("{} is no id in images", annotation.image_id);
                return Err(wrong("image_id", why));
            };
            if !categories.contains(&annotation.category_id) {
                let why = format!("{} is no id in categories", annotation.category_id);
                return Err(wrong("category_id", why));
            }
            let [x, y, width, height] = annotation.bbox;
            let corner = [x + width, y + height];
            if !(width > 0.0 && height > 0.0 && corner.iter().all(|c| c.is_finite())) {
                let why = format!(
                    "[{x}, {y}, {width}, {height}], must be x, y, width and height with sides \
                     above 0 px"
                );
                return Err(wrong("bbox", why));
            }
            let area_px2 = annotation.area.unwrap_or(width * height);
            if area_px2 < 0.0 || area_px2.is_nan() {
                return Err(wrong("area", format!("{area_px2}, must be at least 0 px²")));
            }
            let truth = Truth {
                box_px: [x, y, corner[0], corner[1]],
                area_px2,
                ignored: annotation.iscrowd || annotation.ignore || !annotation.tight,
            };
            boxes[place].push((annotation.category_id, truth));
        }
        Ok(Self {
            pictures: file.images,
            boxes,
            categories: file.categories,
        })
    }

    /// Ids and names of the categories that count: those whose name or supercategory is in `names`. Without
    /// names, those called like a UAV ([`UAVS`]); a file's only category counts too, unless it is called
    /// like something else ([`is_other`]). An error says which categories there are.
    fn chosen(&self, names: &[String]) -> Result<BTreeMap<i64, String>, String> {
        let is = |category: &Category, name: &str| {
            let above = category.supercategory.as_deref();
            category.name.eq_ignore_ascii_case(name)
                || above.is_some_and(|above| above.eq_ignore_ascii_case(name))
        };
        let there = || {
            let names: Vec<_> = self.categories.iter().map(|c| c.name.as_str()).collect();
            names.join(", ")
        };
        if let Some(name) = (names.iter()).find(|name| !self.categories.iter().any(|c| is(c, name)))
        {
            return Err(format!("there is no '{name}' among {}", there()));
        }
        let only = names.is_empty() && self.categories.len() == 1;
        let chosen: BTreeMap<i64, String> = (self.categories.iter())
            .filter(|category| {
                let any = |names: &[&str]| names.iter().any(|name| is(category, name));
                match names {
                    [] => any(&UAVS) || only && !is_other(&category.name),
                    names => names.iter().any(|name| is(category, name)),
                }
            })
            .map(|category| (category.id, category.name.clone()))
            .collect();
        if chosen.is_empty() {
            return Err(format!(
                "which of them are targets is not clear ({})",
                there()
            ));
        }
        Ok(chosen)
    }
}

/// A box of what is no target.
#[derive(Clone, Debug, PartialEq)]
pub struct Other {
    /// Name of its category.
    pub name: String,
    /// x0, y0, x1, y1 [px].
    pub box_px: [f64; 4],
    /// Whether too little of it is seen to ask for it.
    pub ignored: bool,
}

/// A part of a set by the numbers of its clips: which pictures may be looked at while a detector is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Half {
    /// Clips with an even number, and pictures of none.
    Development,
    /// Clips with an odd number: for the last word, never for a choice.
    Unseen,
}

impl Half {
    /// The half that a clip belongs to, by the last number in its name.
    fn of(clip: &str) -> Self {
        let digits = clip.trim_end_matches(|c: char| !c.is_ascii_digit());
        match digits.bytes().last() {
            Some(digit) if digit % 2 == 1 => Self::Unseen,
            _ => Self::Development,
        }
    }
}

/// A set of annotated pictures.
#[derive(Debug)]
pub struct Coco {
    /// The annotation file.
    pub file: PathBuf,
    /// Pictures in the order of their ids.
    pub pictures: Vec<Picture>,
    /// Boxes of the chosen categories [px], in the order of `pictures`.
    pub truth: Vec<Vec<Truth>>,
    /// Category of each of these boxes.
    pub category: Vec<Vec<i64>>,
    /// Ids and names of the chosen categories.
    pub categories: BTreeMap<i64, String>,
    /// Boxes of all other categories, in the order of `pictures`.
    pub others: Vec<Vec<Other>>,
    /// Ids of these categories by their names.
    pub other_ids: BTreeMap<String, i64>,
    folders: Vec<PathBuf>,
}

impl Coco {
    /// Reads the annotations at `path`, a JSON file or a folder, with the boxes of the
    /// `categories` named; those of other categories are kept apart. No picture is opened yet.
    pub fn load(path: &Path, categories: &[String]) -> Result<Self, CocoError> {
        let file = annotation_file(path)?;
        let text = std::fs::read_to_string(&file).map_err(|error| unreadable(&file, &error))?;
        let content = Content::parse(&text).map_err(|source| CocoError::Content {
            path: file.clone(),
            source,
        })?;
        if content.pictures.is_empty() {
            return Err(CocoError::Layout {
                path: file,
                why: "it lists no images".into(),
            });
        }
        let chosen = content
            .chosen(categories)
            .map_err(|why| CocoError::Category {
                path: file.clone(),
                why,
            })?;
        let other_ids: BTreeMap<String, i64> = (content.categories.iter())
            .filter(|category| !chosen.contains_key(&category.id))
            .map(|category| (category.name.clone(), category.id))
            .collect();
        let other = |(category, truth): &(i64, Truth)| {
            let (name, _) = other_ids.iter().find(|(_, id)| *id == category)?;
            Some(Other {
                name: name.clone(),
                box_px: truth.box_px,
                ignored: truth.ignored,
            })
        };
        let others = (content.boxes.iter())
            .map(|boxes| boxes.iter().filter_map(other).collect())
            .collect();
        let (category, truth) = (content.boxes.into_iter())
            .map(|boxes| {
                (boxes.into_iter())
                    .filter(|(category, _)| chosen.contains_key(category))
                    .unzip()
            })
            .unzip();
        Ok(Self {
            folders: picture_folders(&file),
            file,
            pictures: content.pictures,
            truth,
            category,
            categories: chosen,
            others,
            other_ids,
        })
    }

    /// Keeps the first `count` pictures.
    pub fn truncate(&mut self, count: usize) {
        self.keep(|place, _| place < count);
    }

    /// Keeps the pictures of a half.
    pub fn halve(&mut self, half: Half) {
        self.keep(|_, picture| Half::of(picture.clip()) == half);
    }

    fn keep(&mut self, wanted: impl Fn(usize, &Picture) -> bool) {
        let kept: Vec<bool> = (self.pictures.iter().enumerate())
            .map(|(place, picture)| wanted(place, picture))
            .collect();
        fn filter<T>(list: &mut Vec<T>, kept: &[bool]) {
            let mut kept = kept.iter();
            list.retain(|_| kept.next() == Some(&true));
        }
        filter(&mut self.pictures, &kept);
        filter(&mut self.truth, &kept);
        filter(&mut self.category, &kept);
        filter(&mut self.others, &kept);
    }

    /// Where a picture's file is.
    pub fn path(&self, picture: &Picture) -> Result<PathBuf, CocoError> {
        (self.folders.iter())
            .map(|folder| folder.join(&picture.file_name))
            .find(|path| path.is_file())
            .ok_or_else(|| CocoError::Picture {
                path: PathBuf::from(&picture.file_name),
                why: "not found".into(),
                looked: self.folders.clone(),
            })
    }

    /// A picture of the set, read from its file.
    pub fn image(&self, picture: &Picture) -> Result<RgbImage, CocoError> {
        let path = self.path(picture)?;
        let wrong = |why: String| CocoError::Picture {
            path: path.clone(),
            why,
            looked: Vec::new(),
        };
        let bytes = std::fs::read(&path).map_err(|error| wrong(error.to_string()))?;
        let image = decode(&bytes).map_err(|error| wrong(error.to_string()))?;
        let (width, height) = image.dimensions();
        if [width, height] != picture.size_px() {
            return Err(wrong(format!(
                "it is {width} × {height} px, but images[].width and height say {} × {}",
                picture.width, picture.height
            )));
        }
        Ok(image)
    }
}

fn unreadable(path: &Path, error: &std::io::Error) -> CocoError {
    CocoError::Unreadable {
        path: path.into(),
        why: error.to_string(),
    }
}

/// The annotation file at or in `path`.
fn annotation_file(path: &Path) -> Result<PathBuf, CocoError> {
    let about = std::fs::metadata(path).map_err(|error| unreadable(path, &error))?;
    if !about.is_dir() {
        return Ok(path.into());
    }
    let usual = path.join("annotations.json");
    if usual.is_file() {
        return Ok(usual);
    }
    for folder in [path.to_path_buf(), path.join("annotations")] {
        if !folder.is_dir() {
            continue;
        }
        let entries = std::fs::read_dir(&folder).map_err(|error| unreadable(&folder, &error))?;
        let mut files: Vec<PathBuf> = (entries.flatten())
            .map(|entry| entry.path())
            .filter(|path| path.is_file() && path.extension().is_some_and(|e| e == "json"))
            .collect();
        files.sort();
        match files.len() {
            0 => {}
            1 => return Ok(files.swap_remove(0)),
            n => {
                return Err(CocoError::Layout {
                    path: folder,
                    why: format!("it holds {n} .json files"),
                });
            }
        }
    }
    Err(CocoError::Layout {
        path: path.into(),
        why: "it holds no annotation file".into(),
    })
}

/// Where the pictures of an annotation file are looked for: beside it, in `images` or `frames`
/// there, and for `annotations/instances_val.json` in `val` and `images/val` beside
/// `annotations` too.
fn picture_folders(file: &Path) -> Vec<PathBuf> {
    let here = file.parent().unwrap_or(Path::new(""));
    let mut roots = vec![here];
    if here.file_name().is_some_and(|name| name == "annotations") {
        roots.extend(here.parent());
    }
    let stem = file.file_stem().and_then(|stem| stem.to_str());
    let part = stem
        .and_then(|stem| stem.rsplit_once('_'))
        .map(|(_, part)| part);
    let mut folders: Vec<PathBuf> = (roots.into_iter())
        .flat_map(|root| {
            let mut folders = vec![root.into(), root.join("images"), root.join("frames")];
            folders.extend(part.map(|part| root.join(part)));
            folders.extend(part.map(|part| root.join("images").join(part)));
            folders
        })
        .collect();
    folders.retain(|folder| folder.as_os_str().is_empty() || folder.is_dir());
    folders
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::media::image::encode_jpeg;
    use image::{ImageFormat, Rgb};
    use proptest::prelude::*;
    use std::io::Cursor;

    const GOOD: &str = r#"{"images": [
            {"id": 4, "file_name": "b.png", "width": 3, "height": 2},
            {"id": 2, "file_name": "a.jpg", "width": 16, "height": 8}],
        "annotations": [
            {"id": 1, "image_id": 4, "category_id": 1, "bbox": [1, 0, 2, 1], "tight": true},
            {"id": 2, "image_id": 4, "category_id": 1, "bbox": [0, 0, 2, 1], "area": 1.5, "iscrowd": 1},
            {"id": 3, "image_id": 2, "category_id": 1, "bbox": [0, 0, 2, 1], "tight": false},
            {"id": 4, "image_id": 2, "category_id": 2, "bbox": [0, 0, 2, 1]}],
        "categories": [{"id": 1, "name": "Drone"}, {"id": 2, "name": "bird"}]}"#;

    fn write(folder: &Path, name: &str, bytes: &[u8]) {
        let path = folder.join(name);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("made");
        std::fs::write(path, bytes).expect("written");
    }

    /// A PNG file of 3 × 2 px.
    fn png() -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        let picture =
            RgbImage::from_fn(3, 2, |_, y| Rgb(if y == 0 { [9, 8, 7] } else { [1, 2, 3] }));
        (picture.write_to(&mut bytes, ImageFormat::Png)).expect("a PNG");
        bytes.into_inner()
    }

    #[test]
    fn layouts_and_flags_are_read() {
        let jpeg = encode_jpeg(&[200; 16 * 8 * 3], 16, 8, 90).expect("a JPEG");
        for (file, folder) in [
            ("annotations.json", "."),
            ("labels.json", "images"),
            ("annotations/instances_val.json", "images/val"),
            ("annotations/instances_val.json", "val"),
            ("annotations.json", "frames"),
        ] {
            let root = tempfile::tempdir().expect("a folder");
            write(root.path(), file, GOOD.as_bytes());
            write(root.path(), &format!("{folder}/b.png"), &png());
            write(root.path(), &format!("{folder}/a.jpg"), &jpeg);
            let coco = Coco::load(root.path(), &[]).expect("a set");
            assert_eq!(coco.categories, BTreeMap::from([(1, "Drone".to_string())]));
            let files: Vec<_> = coco.pictures.iter().map(|p| p.file_name.as_str()).collect();
            assert_eq!(files, ["a.jpg", "b.png"], "in the order of the ids");
            let ignored: Vec<Vec<bool>> = (coco.truth.iter())
                .map(|truth| truth.iter().map(|t| t.ignored).collect())
                .collect();
            assert_eq!(ignored, [vec![true], vec![false, true]]);
            assert_eq!(coco.truth[1][0].box_px, [1.0, 0.0, 3.0, 1.0]);
            assert_eq!(coco.truth[1][1].area_px2, 1.5);
            let image = coco.image(&coco.pictures[1]).expect("a picture");
            assert_eq!(image.dimensions(), (3, 2));
            assert_eq!((image[(0, 0)].0, image[(2, 1)].0), ([9, 8, 7], [1, 2, 3]));
            let grey = coco.image(&coco.pictures[0]).expect("a picture");
            assert!(grey.as_raw().iter().all(|&c| c.abs_diff(200) < 4));
        }
    }

    #[test]
    fn pictures_of_one_clip_share_its_name() {
        let clip = |file: &str, scene: &str| {
            let text = format!(
                r#"{{"id": 1, "file_name": "{file}", "width": 1, "height": 1, "scene": {scene}}}"#
            );
            let picture: Picture = serde_json::from_str(&text).expect("a picture");
            picture.clip().to_string()
        };
        assert_eq!(clip("V_DRONE_001_0015.jpg", "null"), "V_DRONE_001");
        assert_eq!(clip("a/img1/000001.png", "null"), "a/img1/");
        assert_eq!(clip("000001.png", "null"), "000001.png");
        assert_eq!(clip("x_1.png", "17"), "17");
        assert_eq!(clip("x_1.png", "\"s3\""), "s3");
    }

    #[test]
    fn errors_name_the_place_and_the_mend() {
        let told = |text: &str| {
            Content::parse(text)
                .err()
                .map_or_else(String::new, |e| e.to_string())
        };
        for (from, to, expected) in [
            (
                "\"bbox\": [1, 0, 2, 1]",
                "\"bbox\": [1, 0, 0, 1]",
                "annotations[0].bbox",
            ),
            (
                "\"image_id\": 2",
                "\"image_id\": 3",
                "annotations[2].image_id: 3 is no id",
            ),
            (
                "\"category_id\": 2",
                "\"category_id\": 3",
                "annotations[3].category_id",
            ),
            (
                "\"id\": 4, \"file",
                "\"id\": 2, \"file",
                "images[1].id: 2 is given twice",
            ),
            ("\"width\": 3", "\"width\": 0", "images[0].width"),
            ("\"tight\": false", "\"tight\": 2", "true, false, 1 or 0"),
            ("\"height\": 2", "\"hight\": 2", "missing field `height`"),
        ] {
            let text = GOOD.replace(from, to);
            assert_ne!(text, GOOD, "{from}");
            assert!(told(&text).contains(expected), "{to}: {}", told(&text));
        }
        let root = tempfile::tempdir().expect("a folder");
        let failed = |names: &[&str]| {
            let names: Vec<String> = names.iter().map(ToString::to_string).collect();
            Coco::load(root.path(), &names)
                .expect_err("refused")
                .to_string()
        };
        assert!(
            failed(&[]).contains("no annotation file"),
            "{}",
            failed(&[])
        );
        write(root.path(), "a.json", GOOD.as_bytes());
        assert!(failed(&["kite"]).contains("no 'kite' among Drone, bird"));
        let coco = Coco::load(root.path(), &["bird".into()]).expect("a set");
        assert_eq!(coco.truth[0].len(), 1);
        assert!(
            coco.image(&coco.pictures[0])
                .expect_err("none")
                .to_string()
                .contains("a.jpg: not found")
        );
        write(root.path(), "a.jpg", &png());
        let why = coco
            .image(&coco.pictures[0])
            .expect_err("another size")
            .to_string();
        assert!(why.contains("3 × 2 px, but"), "{why}");
        write(root.path(), "a.jpg", b"no picture");
        assert!(coco.image(&coco.pictures[0]).is_err());
        write(
            root.path(),
            "a.json",
            GOOD.replace("Drone", "kite").as_bytes(),
        );
        assert!(failed(&[]).contains("--category"), "{}", failed(&[]));
        write(root.path(), "b.json", b"{}");
        assert!(failed(&[]).contains("2 .json files"), "{}", failed(&[]));
    }

    proptest! {
        /// Any text is read or refused; so is a good file with a piece put in anywhere.
        #[test]
        fn any_text_is_read_or_refused(text in ".*", at in 0..GOOD.len(), cut in 0..40_usize) {
            let _ = Content::parse(&text);
            let end = (at + cut).min(GOOD.len());
            let spoiled = format!("{}{text}{}", &GOOD[..at], &GOOD[end..]);
            let _ = Content::parse(&spoiled);
            let _ = Content::parse(&format!("{}{}", &GOOD[..at], &GOOD[end..]));
        }
    }
}
