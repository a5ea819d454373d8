//! The annotation file of a set in COCO's format: what it says, checked entry for entry.

use crate::eval::detector::metrics::Truth;
use crate::models::flight::class::ObjectClass;
use crate::sources::json::without_nan;
use crate::warning::Notes;
use serde::de::IgnoredAny;
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;

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
    images: Vec<Entry<RawPicture>>,
    annotations: Vec<Entry<Annotation>>,
    #[serde(default)]
    categories: Option<Vec<Entry<RawCategory>>>,
}

/// An entry of a list, or what is none.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Entry<T> {
    Read(T),
    Other(IgnoredAny),
}

impl<T> Entry<T> {
    /// What an entry holds; one that is no object is said to the notes.
    fn read(self, list: &str, index: usize, notes: &mut Notes) -> Option<T> {
        match self {
            Self::Read(read) => Some(read),
            Self::Other(_) => {
                notes.leave_out("entries that are no objects", format!("{list}[{index}]"));
                None
            }
        }
    }
}

/// What a file calls a picture or a category: a number, or a text.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(untagged)]
pub enum Id {
    /// A whole number.
    Number(i64),
    /// A text.
    Text(String),
}

impl Default for Id {
    fn default() -> Self {
        Self::Number(0)
    }
}

impl std::fmt::Display for Id {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Number(number) => write!(f, "{number}"),
            Self::Text(text) => write!(f, "{text:?}"),
        }
    }
}

impl Id {
    /// The id that a value is; whole numbers may be written as floats.
    fn of(value: &Value) -> Option<Self> {
        let whole = |x: &f64| x.fract() == 0.0 && x.abs() < 2.0_f64.powi(53);
        match value {
            Value::Number(number) => {
                let float = || number.as_f64().filter(whole).map(|x| x as i64);
                number.as_i64().or_else(float).map(Self::Number)
            }
            Value::String(text) => Some(Self::Text(text.clone())),
            _ => None,
        }
    }

    /// What a map has under this id, or under the same as text for a number and the other way about.
    fn among<T: Copy>(&self, known: &BTreeMap<Self, T>) -> Option<(Self, T)> {
        let other = match self {
            Self::Number(number) => Some(Self::Text(number.to_string())),
            Self::Text(text) => text.trim().parse().ok().map(Self::Number),
        };
        let found = |id: &Self| known.get(id).map(|value| (id.clone(), *value));
        found(self).or_else(|| other.as_ref().and_then(found))
    }
}

/// A picture of the set.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Its id in the file.
    pub id: Id,
    /// Its file's name, perhaps with folders.
    pub file_name: String,
    /// Width [px]; 0 where the file does not say it, until the picture's own is known.
    pub width: u32,
    /// Height [px], likewise.
    pub height: u32,
    /// The scene or clip that it is of, where the file says so.
    pub scene: Option<String>,
    /// Where it comes from, such as `rendered` or `real`, where the file says so.
    pub source: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct RawPicture {
    id: Value,
    file_name: Value,
    width: Value,
    height: Value,
    scene: Value,
    source: Value,
}

impl RawPicture {
    /// The picture, or what it lacks.
    pub(super) fn checked(self) -> Result<Picture, &'static str> {
        let side = |value: &Value| number(value).map_or(0, |x| x.clamp(0.0, 1e9) as u32);
        // Files name scenes by text or by number; anything else names none.
        let scene = match self.scene {
            Value::String(name) => Some(name),
            Value::Number(number) => Some(number.to_string()),
            _ => None,
        };
        Ok(Picture {
            id: Id::of(&self.id).ok_or("images without an id")?,
            file_name: (self.file_name.as_str())
                .filter(|name| !name.is_empty())
                .ok_or("images without a file name")?
                .replace('\\', "/"),
            width: side(&self.width),
            height: side(&self.height),
            scene,
            source: self.source.as_str().map(str::to_owned),
        })
    }
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

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Annotation {
    image_id: Value,
    category_id: Value,
    bbox: Value,
    area: Value,
    iscrowd: Value,
    ignore: Value,
    tight: Value,
    /// x0, y0, x1, y1 about its polygons [px].
    #[serde(deserialize_with = "extent")]
    segmentation: Option<[f64; 4]>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct RawCategory {
    id: Value,
    name: Value,
    supercategory: Value,
}

/// A category of a file.
#[derive(Debug)]
pub(super) struct Category {
    pub id: Id,
    pub name: String,
    supercategory: Option<String>,
}

/// A number, perhaps as text.
fn number(value: &Value) -> Option<f64> {
    let number = match value {
        Value::String(text) => text.trim().parse().ok(),
        value => value.as_f64(),
    };
    number.filter(|x| x.is_finite())
}

/// A flag: files have them as `true`, as 1, as 1.0 and as text; anything else is none.
fn flag(value: &Value) -> Option<bool> {
    match value {
        Value::Bool(flag) => Some(*flag),
        Value::String(text) if text.eq_ignore_ascii_case("true") => Some(true),
        value => number(value).map(|x| x != 0.0),
    }
}

/// x0, y0, x1, y1 about all polygons of a segmentation [px]; `None` for run lengths and without one.
fn extent<'de, D: Deserializer<'de>>(from: D) -> Result<Option<[f64; 4]>, D::Error> {
    let value = Value::deserialize(from)?;
    let start = [
        f64::INFINITY,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::NEG_INFINITY,
    ];
    let mut found = start;
    for polygon in value.as_array().into_iter().flatten() {
        let all = polygon.as_array().into_iter().flatten();
        let numbers: Vec<f64> = all.filter_map(number).collect();
        for [x, y] in numbers.as_chunks::<2>().0 {
            let [x0, y0, x1, y1] = found;
            found = [x0.min(*x), y0.min(*y), x1.max(*x), y1.max(*y)];
        }
    }
    Ok(Some(found).filter(|found| found[0].is_finite()))
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
const OTHERS: [&str; 2] = ["plane", "kite"];

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
    pub(super) boxes: Vec<Vec<(Id, Truth)>>,
    pub(super) categories: Vec<Category>,
    /// What was left out.
    pub(super) notes: Notes,
}

/// An error of a value.
fn wrong(list: &'static str, index: usize, key: &'static str, why: String) -> ContentError {
    ContentError::Value {
        list,
        index,
        key,
        why,
    }
}

impl Content {
    /// Reads the text of an annotation file. Annotations with `iscrowd`, `ignore` or
    /// `tight: false` become regions that are ignored. Entries that are odd are left out and noted.
    ///
    /// Fails where it is no such file, where one id means two things, or where all of some annotations would be left out.
    pub fn parse(text: &str) -> Result<Self, ContentError> {
        let text = text.trim_start_matches('\u{feff}');
        let read = serde_json::from_str(&without_nan(text));
        let file: File = read.map_err(|error| ContentError::Json(error.to_string()))?;
        let mut notes = Notes::default();
        let categories = categories(file.categories.unwrap_or_default(), &mut notes)?;
        let pictures = pictures(file.images, &mut notes)?;
        let places: BTreeMap<Id, usize> = (pictures.iter().enumerate())
            .map(|(place, picture)| (picture.id.clone(), place))
            .collect();
        let known: BTreeMap<Id, ()> = categories.iter().map(|c| (c.id.clone(), ())).collect();
        let mut boxes = vec![Vec::new(); pictures.len()];
        let mut first = None;
        for (i, entry) in file.annotations.into_iter().enumerate() {
            let Some(annotation) = entry.read("annotations", i, &mut notes) else {
                continue;
            };
            match annotation.checked(&places, &known, &mut notes, i) {
                Ok((place, category, truth)) => boxes[place].push((category, truth)),
                Err(Odd { kind, key, why }) => {
                    notes.leave_out(kind, format!("annotations[{i}].{key}: {why}"));
                    first.get_or_insert(wrong("annotations", i, key, why));
                }
            }
        }
        match first {
            Some(first) if boxes.iter().all(Vec::is_empty) => Err(first),
            _ => Ok(Self {
                pictures,
                boxes,
                categories,
                notes,
            }),
        }
    }

    /// Ids and names of the categories that count: those whose name or supercategory is in `names`. Without
    /// names, those called like a UAV ([`UAVS`]); a file's only category counts too, unless it is called
    /// like something else ([`is_other`]). An error says which categories there are.
    pub(super) fn chosen(&self, names: &[String]) -> Result<BTreeMap<Id, String>, String> {
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
        let chosen: BTreeMap<Id, String> = (self.categories.iter())
            .filter(|category| {
                let any = |names: &[&str]| names.iter().any(|name| is(category, name));
                match names {
                    [] => any(&UAVS) || only && !is_other(&category.name),
                    names => names.iter().any(|name| is(category, name)),
                }
            })
            .map(|category| (category.id.clone(), category.name.clone()))
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

/// The categories of a file, each id once.
fn categories(
    entries: Vec<Entry<RawCategory>>,
    notes: &mut Notes,
) -> Result<Vec<Category>, ContentError> {
    let mut found: Vec<Category> = Vec::new();
    for (i, entry) in entries.into_iter().enumerate() {
        let Some(raw) = entry.read("categories", i, notes) else {
            continue;
        };
        let Some(id) = Id::of(&raw.id) else {
            notes.leave_out("categories without an id", format!("categories[{i}]"));
            continue;
        };
        let text = |value: &Value| value.as_str().map(str::to_string);
        let name = text(&raw.name).unwrap_or_else(|| format!("category {id}"));
        match found.iter().find(|known| known.id == id) {
            Some(known) if known.name == name => {}
            Some(known) => {
                let why = format!("{id} is given twice, to {} and {name}", known.name);
                return Err(wrong("categories", i, "id", why));
            }
            None => found.push(Category {
                id,
                name,
                supercategory: text(&raw.supercategory),
            }),
        }
    }
    Ok(found)
}

/// The pictures of a file in the order of their ids, each id once.
fn pictures(
    entries: Vec<Entry<RawPicture>>,
    notes: &mut Notes,
) -> Result<Vec<Picture>, ContentError> {
    let mut found: BTreeMap<Id, Picture> = BTreeMap::new();
    for (i, entry) in entries.into_iter().enumerate() {
        let Some(raw) = entry.read("images", i, notes) else {
            continue;
        };
        match raw.checked() {
            Err(kind) => notes.leave_out(kind, format!("images[{i}]")),
            Ok(picture) => match found.get(&picture.id) {
                Some(known) if known.file_name == picture.file_name => {
                    notes.leave_out("images that are given twice", format!("images[{i}]"));
                }
                Some(known) => {
                    let (id, a, b) = (&picture.id, &known.file_name, &picture.file_name);
                    let why = format!("{id} is given twice, to {a} and {b}");
                    return Err(wrong("images", i, "id", why));
                }
                None => {
                    found.insert(picture.id.clone(), picture);
                }
            },
        }
    }
    Ok(found.into_values().collect())
}

/// Why an annotation is left out.
struct Odd {
    /// What such annotations are, in the plural.
    kind: &'static str,
    /// The key at fault.
    key: &'static str,
    why: String,
}

impl Odd {
    fn new(kind: &'static str, key: &'static str, why: String) -> Self {
        Self { kind, key, why }
    }
}

impl Annotation {
    /// The place of its picture, its category and its box.
    fn checked(
        &self,
        places: &BTreeMap<Id, usize>,
        known: &BTreeMap<Id, ()>,
        notes: &mut Notes,
        index: usize,
    ) -> Result<(usize, Id, Truth), Odd> {
        let absent = |value: &Value, list: &str| format!("{value} is no id in {list}");
        let place = Id::of(&self.image_id).and_then(|id| id.among(places));
        let (_, place) = place.ok_or_else(|| {
            let why = absent(&self.image_id, "images");
            Odd::new("annotations of images that are not there", "image_id", why)
        })?;
        let category = Id::of(&self.category_id).and_then(|id| id.among(known));
        let (category, ()) = category.ok_or_else(|| {
            let kind = "annotations of categories that are not there";
            Odd::new(kind, "category_id", absent(&self.category_id, "categories"))
        })?;
        let [x, y, width, height] = self.bbox_px(notes)?;
        let corner = [x + width, y + height];
        if !(width > 0.0 && height > 0.0 && corner.iter().all(|c| c.is_finite())) {
            let why = format!("[{x}, {y}, {width}, {height}], must have sides above 0 px");
            return Err(Odd::new("boxes without width or height", "bbox", why));
        }
        let area_px2 = number(&self.area).filter(|area| *area >= 0.0);
        if area_px2.is_none() && !self.area.is_null() {
            let place = format!("annotations[{index}].area");
            let kind = "areas that are no numbers from 0, the box's in their place";
            notes.leave_out(kind, place);
        }
        let truth = Truth {
            box_px: [x, y, corner[0], corner[1]],
            area_px2: area_px2.unwrap_or(width * height),
            ignored: flag(&self.iscrowd).unwrap_or(false)
                || flag(&self.ignore).unwrap_or(false)
                || !flag(&self.tight).unwrap_or(true),
        };
        Ok((place, category, truth))
    }

    /// x, y, width and height [px]: its box, or where it has none that about its polygons.
    fn bbox_px(&self, notes: &mut Notes) -> Result<[f64; 4], Odd> {
        let numbers: Option<Vec<f64>> = (self.bbox.as_array())
            .filter(|all| !all.is_empty())
            .map(|all| all.iter().map_while(number).collect());
        match (numbers.as_deref(), self.segmentation) {
            (Some(&[x, y, width, height]), _) => Ok([x, y, width, height]),
            (None, Some([x0, y0, x1, y1])) => {
                let what = "annotations without a box get the one about their polygons";
                notes.assume("bbox", what, "state it");
                Ok([x0, y0, x1 - x0, y1 - y0])
            }
            (None, None) => {
                let kind = "annotations without a box";
                Err(Odd::new(kind, "bbox", "absent".into()))
            }
            _ => {
                let why = format!("{}, must be four numbers", self.bbox);
                Err(Odd::new("boxes that are no four numbers", "bbox", why))
            }
        }
    }
}
