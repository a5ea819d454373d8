//! Annotated pictures in COCO's format, from the folder layouts in use.

mod content;

use super::metrics::Truth;
use crate::eval::EvalError;
use crate::media::image::decode;
use crate::warning::{Notes, Warning};
use clap::ValueEnum;
use content::Content;
pub use content::{ContentError, Id, Picture, UAVS, is_other};
use image::RgbImage;
use std::collections::BTreeMap;
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
    #[error("{path}: {why}; {}", mend(.looked))]
    Picture {
        /// The picture.
        path: PathBuf,
        /// What is wrong.
        why: String,
        /// Folders in which it was looked for.
        looked: Vec<PathBuf>,
    },
}

impl From<CocoError> for EvalError {
    fn from(error: CocoError) -> Self {
        Self::own(error)
    }
}

/// What mends a picture: one that was not found is looked for in some folders, another is there and damaged.
fn mend(looked: &[PathBuf]) -> String {
    let folders: Vec<_> = looked.iter().map(|f| f.display().to_string()).collect();
    match folders.len() {
        0 => "put a whole PNG or JPEG of that size there, or take it out of the annotations".into(),
        _ => format!(
            "a PNG or JPEG file of this name must lie in {}",
            folders.join(" or ")
        ),
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
    pub category: Vec<Vec<Id>>,
    /// Ids and names of the chosen categories.
    pub categories: BTreeMap<Id, String>,
    /// Boxes of all other categories, in the order of `pictures`.
    pub others: Vec<Vec<Other>>,
    /// Ids of these categories by their names.
    pub other_ids: BTreeMap<String, Id>,
    folders: Vec<PathBuf>,
    /// What was left out.
    notes: Notes,
}

impl Coco {
    /// Reads the annotations at `path`, a JSON file or a folder, with the boxes of the
    /// `categories` named; those of other categories are kept apart. No picture is opened yet.
    pub fn load(path: &Path, categories: &[String]) -> Result<Self, CocoError> {
        let file = annotation_file(path)?;
        let bytes = std::fs::read(&file).map_err(|error| unreadable(&file, &error))?;
        let content = Content::parse(&String::from_utf8_lossy(&bytes)).map_err(|source| {
            CocoError::Content {
                path: file.clone(),
                source,
            }
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
        let others: BTreeMap<&Id, &String> = (content.categories.iter())
            .filter(|category| !chosen.contains_key(&category.id))
            .map(|category| (&category.id, &category.name))
            .collect();
        let other_ids = others
            .iter()
            .map(|(id, name)| ((*name).clone(), (*id).clone()));
        let other_ids = other_ids.collect();
        let other = |(category, truth): &(Id, Truth)| {
            Some(Other {
                name: (*others.get(category)?).clone(),
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
        let mut coco = Self {
            folders: picture_folders(&file),
            file,
            pictures: content.pictures,
            truth,
            category,
            categories: chosen,
            others,
            other_ids,
            notes: content.notes,
        };
        coco.measure();
        Ok(coco)
    }

    /// Takes the size of pictures whose entries say none from their files; without either they are left out.
    fn measure(&mut self) {
        let sizes: Vec<Option<(u32, u32)>> = (self.pictures.iter())
            .map(|picture| match picture.size_px() {
                [0, _] | [_, 0] => image::image_dimensions(self.path(picture).ok()?).ok(),
                [width, height] => Some((width, height)),
            })
            .collect();
        for (picture, size) in self.pictures.iter_mut().zip(&sizes) {
            match size {
                Some((width, height)) => [picture.width, picture.height] = [*width, *height],
                None => (self.notes).leave_out("images without a size", &picture.file_name),
            }
        }
        self.keep(|place, _| sizes[place].is_some());
        self.fit();
    }

    /// Leaves out boxes outside their pictures, and notes those that reach beyond them by more than a rounding.
    fn fit(&mut self) {
        const SLACK_PX: f64 = 2.0; // [px]
        let mut beyond = (0_usize, None);
        for (place, picture) in self.pictures.iter().enumerate() {
            let [width, height] = picture.size_px().map(f64::from);
            let mut fits = |[x0, y0, x1, y1]: [f64; 4]| {
                let inside = x0 < width && y0 < height && x1 > 0.0 && y1 > 0.0;
                let over = [-x0, -y0, x1 - width, y1 - height];
                if !inside {
                    (self.notes).leave_out("boxes outside their pictures", &picture.file_name);
                } else if over.iter().any(|px| *px > SLACK_PX) {
                    beyond.0 += 1;
                    beyond.1.get_or_insert(&picture.file_name);
                }
                inside
            };
            let kept: Vec<bool> = self.truth[place]
                .iter()
                .map(|truth| fits(truth.box_px))
                .collect();
            self.others[place].retain(|other| fits(other.box_px));
            let (mut a, mut b) = (kept.iter(), kept.iter());
            self.truth[place].retain(|_| a.next() == Some(&true));
            self.category[place].retain(|_| b.next() == Some(&true));
        }
        let corners = || {
            self.truth
                .iter()
                .flatten()
                .map(|truth| truth.box_px[2].max(truth.box_px[3]))
        };
        if corners().next().is_some() && corners().all(|far_px| far_px <= 1.0) {
            let what = "all lie within one pixel, as shares of the picture would";
            self.notes.assume("boxes", what, "write them in pixels");
        }
        if let (count, Some(first)) = beyond {
            let what = format!("{count} reach beyond their pictures (first {first})");
            let mend = "write them as x, y, width, height";
            self.notes.assume("boxes", what, mend);
        }
    }

    /// Leaves out pictures whose files are not there, unless none is: then the first says where it was looked for.
    pub fn leave_out_absent(&mut self) {
        let there: Vec<bool> = (self.pictures.iter())
            .map(|picture| self.path(picture).is_ok())
            .collect();
        if !there.contains(&true) {
            return;
        }
        for (picture, there) in self.pictures.iter().zip(&there) {
            if !there {
                (self.notes).leave_out("images without a file", &picture.file_name);
            }
        }
        self.keep(|place, _| there[place]);
    }

    /// What was left out, and what was taken for granted.
    pub fn warnings(&self) -> Vec<Warning> {
        self.notes.clone().warnings(&self.file)
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
            // A whole path is often that of another machine.
            .chain((self.folders.iter()).filter_map(|folder| {
                let name = Path::new(&picture.file_name);
                let whole = name.is_absolute() || picture.file_name.get(1..2) == Some(":");
                whole.then_some(folder.join(name.file_name()?))
            }))
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
mod tests;
