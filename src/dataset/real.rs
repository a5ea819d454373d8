//! Pictures of real cameras: frames of clips whose boxes people drew, tightened and thinned.

use super::coco::{Annotation, Origin, Picture, SceneRecord};
use super::error::{DatasetError, RealFault};
use super::recipe::Real;
use super::shares::Split;
use super::shoot::png;
use super::store::{record_path, write};
use super::thin::{Look, look, thin};
use crate::media::clip_boxes::{self, LabelledClip, LabelledFrame};
use crate::media::video::{Clip, ClipFrame};
use crate::models::flight::class::ObjectClass;
use crate::models::optics::camera::PixelRect;
use crate::models::optics::chip::{CHIP_PX, chip};
use crate::models::optics::tighten::{NotTight, TightenParams, tighten};
use crate::models::tracking::recognition::TrackClass;
use crate::stop;
use crate::warning;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// File of the boxes in a folder of clips.
const BOXES: &str = "boxes.json";
/// Rate that is taken for a clip of numbered pictures [Hz]; no picture depends on it.
pub const RATE_HZ: f64 = 30.0; // [Hz]
/// How much larger than a box the chip is that tells frames apart, and by how many pixels more.
const CHIP_SHARE: f64 = 1.5;
const CHIP_MORE_PX: f64 = 4.0; // [px]
/// Frames on either side that say how large a thing is, and by which factor and by how many pixels a tight box may differ
/// from their median: what differs more has caught a twig or lost a wing.
const STEADY_FRAMES: usize = 10;
const STEADY_FACTOR: f64 = 1.6;
const STEADY_PX: f64 = 2.5; // [px]

/// A folder of real clips, and what of it goes into the set.
pub struct Clips {
    folder: PathBuf,
    real: Real,
    /// By the names of their files.
    clips: Vec<Taken>,
    /// What the folder's boxes are, for the digest.
    text: String,
}

/// A clip that goes into the set.
struct Taken {
    labelled: LabelledClip,
    split: Split,
    /// Most pictures of it.
    pictures: usize,
}

/// What of a frame is known.
struct Known {
    index: usize,
    annotations: Vec<Annotation>,
    look: Look,
}

/// A clip to be played.
pub struct Filmed<'a> {
    /// Its file.
    pub path: PathBuf,
    /// The part of a set that it belongs to.
    pub split: Split,
    labelled: &'a LabelledClip,
}

impl Filmed<'_> {
    /// Its name.
    pub fn name(&self) -> &str {
        name(&self.labelled.file)
    }
}

impl Clips {
    /// All clips, to be played.
    pub fn filmed(&self) -> impl Iterator<Item = Filmed<'_>> {
        (self.clips.iter()).map(|taken| Filmed {
            path: self.folder.join(&taken.labelled.file),
            split: taken.split,
            labelled: &taken.labelled,
        })
    }

    /// The labels of a clip by number, and what they are: of two birds of a frame nobody says which is which.
    pub fn objects(
        &self,
        filmed: &Filmed,
    ) -> Result<BTreeMap<usize, (String, TrackClass)>, DatasetError> {
        let labels: BTreeSet<&String> = filmed
            .labelled
            .frames
            .iter()
            .flat_map(BTreeMap::keys)
            .collect();
        (labels.into_iter().enumerate())
            .map(|(number, label)| {
                let class = self.real.class(label).map_err(|fault| self.wrong(fault))?;
                Ok((number, (label.clone(), class.into())))
            })
            .collect()
    }

    /// What frame `index` of a clip holds: the numbers of its [`Self::objects`], and tight boxes, or loose ones where those
    /// are not to be had.
    pub fn boxes(
        &self,
        filmed: &Filmed,
        objects: &BTreeMap<usize, (String, TrackClass)>,
        index: usize,
        frame: &ClipFrame,
    ) -> Result<Vec<(usize, [f64; 4])>, DatasetError> {
        let Some(boxes) = filmed.labelled.frames.get(index) else {
            return Ok(Vec::new());
        };
        let found = annotations(&self.real, boxes, frame).map_err(|fault| self.wrong(fault))?;
        let number = |seen: &Annotation| {
            let known = objects
                .iter()
                .find(|(_, (label, _))| label.eq_ignore_ascii_case(&seen.model));
            known.map(|(number, _)| *number)
        };
        let corners = |[x, y, w, h]: [f64; 4]| [x, y, x + w, y + h];
        Ok((found.iter())
            .filter_map(|seen| Some((number(seen)?, corners(seen.bbox))))
            .collect())
    }

    fn wrong(&self, fault: RealFault) -> DatasetError {
        DatasetError::Real {
            path: self.folder.join(BOXES),
            fault,
        }
    }

    /// The clips of `folder` as the recipe has them; `None` where it wants none.
    pub fn load(real: &Real, folder: Option<&Path>) -> Result<Option<Self>, DatasetError> {
        let folder = match (folder, real.pictures) {
            (None, 0) => return Ok(None),
            (Some(_), 0) => return Err(DatasetError::RealUnasked),
            (None, pictures) => return Err(DatasetError::RealMissing { pictures }),
            (Some(folder), _) => folder,
        };
        let wrong = |fault: RealFault| DatasetError::Real {
            path: folder.join(BOXES),
            fault,
        };
        let text =
            std::fs::read_to_string(folder.join(BOXES)).map_err(|error| wrong(error.into()))?;
        let mut labelled = clip_boxes::parse(&text).map_err(|fault| wrong(fault.into()))?;
        labelled.sort_by(|a, b| a.file.cmp(&b.file));
        let names: Vec<&str> = labelled.iter().map(|clip| name(&clip.file)).collect();
        if let Some(unknown) = real.val.iter().find(|val| !names.contains(&val.as_str())) {
            return Err(wrong(RealFault::Val {
                clip: unknown.clone(),
            }));
        }
        let classes = (labelled.iter())
            .map(|clip| real.class_of_clip(clip))
            .collect::<Result<Vec<_>, _>>()
            .map_err(wrong)?;
        let mut of_class: BTreeMap<ObjectClass, usize> = BTreeMap::new();
        for class in classes.iter().flatten() {
            *of_class.entry(*class).or_default() += 1;
        }
        let total: f64 = of_class.keys().map(|class| real.share(*class)).sum();
        let pictures = |class: &Option<ObjectClass>| {
            let Some(class) = class.filter(|_| total > 0.0) else {
                return 0;
            };
            let all = f64::from(real.pictures) * real.share(class) / total;
            (all / of_class[&class] as f64).round() as usize
        };
        let pictures: Vec<usize> = classes.iter().map(pictures).collect();
        let clips = labelled
            .into_iter()
            .zip(pictures)
            .filter(|(_, pictures)| *pictures > 0);
        let clips = clips.map(|(labelled, pictures)| Taken {
            split: match real.val.iter().any(|val| val == name(&labelled.file)) {
                true => Split::Val,
                false => Split::Train,
            },
            labelled,
            pictures,
        });
        Ok(Some(Self {
            folder: folder.into(),
            real: real.clone(),
            clips: clips.collect(),
            text,
        }))
    }

    /// Number of clips that go into the set.
    pub fn len(&self) -> u32 {
        self.clips.len() as u32
    }

    /// The text that tells these boxes from others.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Takes the frames of clip `number`, which is scene `scene` of the set, and writes them, their record last.
    pub fn make(&self, number: u32, scene: u32, out: &Path) -> Result<(), DatasetError> {
        let taken = &self.clips[number as usize];
        let path = self.folder.join(&taken.labelled.file);
        let mut known = self.know(taken, &path)?;
        unsteady(&mut known);
        let looks: Vec<Look> = known.iter().map(|frame| frame.look.clone()).collect();
        let wanted: BTreeMap<usize, usize> = (thin(&looks, taken.pictures).into_iter())
            .map(|k| (known[k].index, k))
            .collect();
        let mut images = Vec::new();
        let mut clip = Clip::open(&path, RATE_HZ)?;
        let last = wanted.keys().last().map_or(0, |last| last + 1);
        for index in 0..last {
            let Some(frame) = clip.next_frame()? else {
                break;
            };
            let Some(k) = wanted.get(&index) else {
                continue;
            };
            let file_name = format!("images/{}_{index:04}.png", name(&taken.labelled.file));
            let file = out.join(taken.split.name()).join(&file_name);
            let size_px = frame.size_px();
            let bytes =
                png(frame.picture.as_raw(), size_px).map_err(|source| DatasetError::Picture {
                    path: file.clone(),
                    source,
                })?;
            write(&file, &bytes)?;
            images.push(Picture {
                file_name,
                width: size_px[0],
                height: size_px[1],
                motion: None,
                annotations: std::mem::take(&mut known[*k].annotations),
            });
        }
        let record = SceneRecord {
            scene,
            split: taken.split,
            origin: Origin::Real {
                clip: name(&taken.labelled.file).into(),
            },
            sequence: None,
            images,
        };
        write(&record_path(out, scene), &serde_json::to_vec(&record)?)
    }

    /// What is known of the frames of a clip that have boxes.
    fn know(&self, taken: &Taken, path: &Path) -> Result<Vec<Known>, DatasetError> {
        let mut clip = Clip::open(path, RATE_HZ)?;
        warning::tell(clip.warnings())?;
        let (listed, frames) = (taken.labelled.frames.len(), clip.frames());
        if listed != frames {
            return Err(self.wrong(RealFault::Length {
                clip: taken.labelled.file.clone(),
                listed,
                frames,
            }));
        }
        let mut known = Vec::new();
        for (index, boxes) in taken.labelled.frames.iter().enumerate() {
            let Some(frame) = clip.next_frame()? else {
                break;
            };
            if stop::asked().is_some() {
                return Err(DatasetError::Stopped);
            }
            let annotations =
                annotations(&self.real, boxes, &frame).map_err(|fault| self.wrong(fault))?;
            let Some(first) = annotations.first() else {
                continue;
            };
            known.push(Known {
                index,
                look: look_of(&frame, first.bbox),
                annotations,
            });
        }
        Ok(known)
    }
}

impl Real {
    /// The class of a label in any case, or what is wrong with it.
    fn class(&self, label: &str) -> Result<ObjectClass, RealFault> {
        let named = (self.labels.iter()).find(|(name, _)| name.eq_ignore_ascii_case(label));
        (named.map(|(_, class)| *class))
            .or_else(|| ObjectClass::of_name(label))
            .ok_or_else(|| RealFault::Label {
                label: label.into(),
            })
    }

    /// The class that most boxes of a clip have; none of a clip without boxes.
    fn class_of_clip(&self, clip: &LabelledClip) -> Result<Option<ObjectClass>, RealFault> {
        let mut counts: BTreeMap<ObjectClass, usize> = BTreeMap::new();
        for (label, boxes) in clip.frames.iter().flatten() {
            *counts.entry(self.class(label)?).or_default() += boxes.len();
        }
        Ok((counts.into_iter().max_by_key(|(_, count)| *count)).map(|(class, _)| class))
    }
}

/// A clip's name: that of its file without what follows the last dot.
fn name(file: &str) -> &str {
    Path::new(file)
        .file_stem()
        .and_then(|stem| stem.to_str())
        .unwrap_or(file)
}

/// The things of a frame. What cannot be tightened is neither asked for nor a false alarm, but for what goes on beyond its box
/// and is no UAV: of an aeroplane and its contrail the box as it was drawn stays.
fn annotations(
    real: &Real,
    boxes: &LabelledFrame,
    frame: &ClipFrame,
) -> Result<Vec<Annotation>, RealFault> {
    let size_px = frame.size_px();
    let [width, height] = size_px.map(f64::from);
    let all: Vec<[f64; 4]> = boxes.values().flatten().copied().collect();
    let mut annotations: Vec<Annotation> = Vec::new();
    for (label, boxes) in boxes {
        let class = real.class(label)?;
        for loose_px in boxes {
            let [x0, y0, x1, y1] = *loose_px;
            let inside_px = [x0.max(0.0), y0.max(0.0), x1.min(width), y1.min(height)];
            if inside_px[0] >= inside_px[2] || inside_px[1] >= inside_px[3] {
                continue;
            }
            let others: Vec<[f64; 4]> = all
                .iter()
                .filter(|other| *other != loose_px)
                .copied()
                .collect();
            let rgb8 = frame.picture.as_raw();
            let tight = tighten(rgb8, size_px, inside_px, &others, &TightenParams::default());
            let ignore = match tight {
                Ok(_) => false,
                Err(NotTight::GoesOn) => class.is_uav(),
                Err(_) => true,
            };
            let [x0, y0, x1, y1] = tight.map_or(inside_px, |tight| tight.box_px);
            annotations.push(Annotation {
                model: label.to_lowercase(),
                class,
                ignore,
                bbox: [x0, y0, x1 - x0, y1 - y0],
                area: tight.map_or((x1 - x0) * (y1 - y0), |tight| tight.area_px2),
                contrast: tight.map_or(0.0, |tight| tight.contrast),
                rendered: None,
                track_id: annotations.len() as u32 + 1,
            });
        }
    }
    Ok(annotations)
}

/// The look of a frame about a box, x, y, width, height [px].
fn look_of(frame: &ClipFrame, [x, y, w, h]: [f64; 4]) -> Look {
    let size_px = frame.size_px();
    let rect = PixelRect {
        offset_px: [0, 0],
        size_px,
    };
    let side_px = CHIP_SHARE * w.max(h) + CHIP_MORE_PX;
    let middle_px = [x + 0.5 * w, y + 0.5 * h];
    let chip = chip(frame.picture.as_raw(), rect, middle_px, side_px);
    look(&chip, CHIP_PX, [x, y, x + w, y + h], size_px)
}

/// Ignores, of frames with one thing, those whose tight box is not about as long as those before and after.
fn unsteady(known: &mut [Known]) {
    let long_px = |frame: &Known| match frame.annotations.as_slice() {
        [one] if !one.ignore => Some(one.bbox[2].max(one.bbox[3])),
        _ => None,
    };
    let lengths: Vec<Option<f64>> = known.iter().map(long_px).collect();
    for (i, frame) in known.iter_mut().enumerate() {
        let Some(own_px) = lengths[i] else {
            continue;
        };
        let near = i.saturating_sub(STEADY_FRAMES)..(i + STEADY_FRAMES + 1).min(lengths.len());
        let mut near: Vec<f64> = lengths[near].iter().flatten().copied().collect();
        near.sort_by(f64::total_cmp);
        let median_px = near[near.len() / 2];
        let factor = (own_px / median_px).max(median_px / own_px);
        if factor > STEADY_FACTOR && (own_px - median_px).abs() > STEADY_PX {
            frame.annotations[0].ignore = true;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(index: usize, long_px: f64) -> Known {
        Known {
            index,
            look: Look::new(),
            annotations: vec![Annotation {
                model: "drone".into(),
                class: ObjectClass::Quadcopter,
                ignore: false,
                bbox: [10.0, 10.0, long_px, 4.0],
                area: 20.0,
                contrast: 9.0,
                rendered: None,
                track_id: 1,
            }],
        }
    }

    #[test]
    fn a_box_that_jumps_is_not_asked_for() {
        let mut known: Vec<Known> = (0..9).map(|i| frame(i, 10.0 + i as f64)).collect();
        known[4] = frame(4, 31.0);
        unsteady(&mut known);
        let ignored: Vec<usize> = (known.iter())
            .filter(|frame| frame.annotations[0].ignore)
            .map(|frame| frame.index)
            .collect();
        assert_eq!(ignored, [4]);
    }
}
