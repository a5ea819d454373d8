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
use crate::warning::{self, Notes};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// File of the boxes in a folder of clips.
const BOXES: &str = "boxes.json";
/// Rate that is taken for a clip of numbered pictures [Hz]: no picture depends on it, rates of tracks do.
pub const RATE_HZ: f64 = 30.0; // [Hz]
/// How much larger than a box the chip is that tells frames apart, and by how many pixels more: as much of the background as
/// makes another frame of it (judged).
const CHIP_SHARE: f64 = 1.5;
const CHIP_MORE_PX: f64 = 4.0; // [px]
/// Frames on either side that say how large a thing is, and by which factor and by how many pixels a tight box may differ
/// from their median: what differs more has caught a twig or lost a wing (judged on contact sheets of training clips).
const STEADY_FRAMES: usize = 10;
const STEADY_FACTOR: f64 = 1.6;
const STEADY_PX: f64 = 2.5; // [px]
/// Overlap from which on two tight boxes of a frame are of one thing: that of a hit.
const SAME_THING: f64 = 0.5;

/// A folder of real clips, and what of it goes into the set.
pub struct Clips {
    folder: PathBuf,
    real: Real,
    /// By the names of their files.
    clips: Vec<LabelledClip>,
    /// Those that go into the set, by their index, and the most pictures of each.
    taken: Vec<(usize, usize)>,
    /// What the folder holds, for the digest.
    text: String,
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
        self.clips.iter().map(|labelled| self.film(labelled))
    }

    fn film<'a>(&self, labelled: &'a LabelledClip) -> Filmed<'a> {
        let kept = self.real.val.iter().any(|val| val == name(&labelled.file));
        Filmed {
            path: self.folder.join(&labelled.file),
            split: if kept { Split::Val } else { Split::Train },
            labelled,
        }
    }

    /// Opens a clip, whose list must be as long as it is.
    pub fn open(&self, filmed: &Filmed) -> Result<Clip, DatasetError> {
        let clip = Clip::open(&filmed.path, RATE_HZ)?;
        let (listed, frames) = (filmed.labelled.frames.len(), clip.frames());
        if listed == frames {
            return Ok(clip);
        }
        Err(self.wrong(RealFault::Length {
            clip: filmed.labelled.file.clone(),
            listed,
            frames,
        }))
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
            let mut labels = objects.iter();
            let known = labels.find(|(_, (label, _))| label.to_lowercase() == seen.model);
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
        if let Some(at) = (1..names.len()).find(|at| names[..*at].contains(&names[*at])) {
            let same = names.iter().position(|name| *name == names[at]);
            return Err(wrong(RealFault::SameName {
                files: [same.unwrap_or(at), at].map(|at| labelled[at].file.clone()),
            }));
        }
        if let Some(unknown) = real.val.iter().find(|val| !names.contains(&val.as_str())) {
            return Err(wrong(RealFault::Val {
                clip: unknown.clone(),
            }));
        }
        let classes = (labelled.iter())
            .map(|clip| real.class_of_clip(clip))
            .collect::<Result<Vec<_>, _>>()
            .map_err(wrong)?;
        let pictures = shared_out(real, &classes);
        let mut notes = Notes::default();
        for (clip, pictures) in labelled.iter().zip(&pictures) {
            if *pictures == 0 {
                let kind = "clips for which the recipe's real.pictures and shares leave no picture";
                notes.leave_out(kind, &clip.file);
            }
        }
        warning::tell(&notes.warnings(&folder.join(BOXES)))?;
        let taken = (pictures.into_iter().enumerate()).filter(|(_, pictures)| *pictures > 0);
        let mut clips = Self {
            folder: folder.into(),
            real: real.clone(),
            clips: labelled,
            taken: taken.collect(),
            text,
        };
        // What cannot be read is told before the work.
        let mut sizes = String::new();
        for filmed in clips.filmed() {
            let clip = clips.open(&filmed)?;
            warning::tell(clip.warnings())?;
            let bytes = std::fs::metadata(&filmed.path).map_or(0, |about| about.len());
            sizes += &format!(" {bytes}");
        }
        clips.text += &sizes;
        Ok(Some(clips))
    }

    /// Number of clips that go into the set.
    pub fn len(&self) -> u32 {
        self.taken.len() as u32
    }

    /// The text that tells these clips and boxes from others.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Takes the frames of clip `number`, which is scene `scene` of the set, and writes them, their record last.
    pub fn make(&self, number: u32, scene: u32, out: &Path) -> Result<(), DatasetError> {
        let (index, pictures) = self.taken[number as usize];
        let filmed = self.film(&self.clips[index]);
        let mut known = self.know(&filmed)?;
        unsteady(&mut known);
        let wanted = worth_keeping(&mut known, pictures);
        let mut images = Vec::new();
        let mut clip = self.open(&filmed)?;
        let last = wanted.keys().last().map_or(0, |last| last + 1);
        for index in 0..last {
            let Some(frame) = clip.next_frame()? else {
                break;
            };
            let Some(k) = wanted.get(&index) else {
                continue;
            };
            let file_name = format!("images/{}_{index:04}.png", filmed.name());
            let file = out.join(filmed.split.name()).join(&file_name);
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
            split: filmed.split,
            origin: Origin::Real {
                clip: filmed.name().into(),
            },
            sequence: None,
            images,
        };
        write(&record_path(out, scene), &serde_json::to_vec(&record)?)
    }

    /// What is known of the frames of a clip that have boxes.
    fn know(&self, filmed: &Filmed) -> Result<Vec<Known>, DatasetError> {
        let mut clip = self.open(filmed)?;
        let mut known = Vec::new();
        for (index, boxes) in filmed.labelled.frames.iter().enumerate() {
            let Some(frame) = clip.next_frame()? else {
                break;
            };
            if stop::asked().is_some() {
                return Err(DatasetError::Stopped);
            }
            let annotations =
                annotations(&self.real, boxes, &frame).map_err(|fault| self.wrong(fault))?;
            let counts = annotations.iter().find(|seen| !seen.ignore);
            let Some(first) = counts.or(annotations.first()) else {
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

/// At most `count` frames that ask for something, those that differ most: their place in `known` by their index in the clip. What
/// asks for nothing would be the greatest novelty, since a loose box is three times as long.
fn worth_keeping(known: &mut Vec<Known>, count: usize) -> BTreeMap<usize, usize> {
    known.retain(|frame| frame.annotations.iter().any(|seen| !seen.ignore));
    let looks: Vec<Look> = known.iter().map(|frame| frame.look.clone()).collect();
    (thin(&looks, count).into_iter())
        .map(|k| (known[k].index, k))
        .collect()
}

/// How many pictures each clip gives, by the class of each: every class its share of all, its clips alike, and what rounding
/// leaves to those that it took most from (the method of largest remainders).
fn shared_out(real: &Real, classes: &[Option<ObjectClass>]) -> Vec<usize> {
    let mut clips_of: BTreeMap<&str, usize> = BTreeMap::new();
    let mut total = 0.0;
    for class in classes.iter().flatten() {
        let clips = clips_of.entry(Real::shared(*class)).or_default();
        *clips += 1;
        if *clips == 1 {
            total += real.share(*class);
        }
    }
    let wanted: Vec<f64> = (classes.iter())
        .map(|class| {
            let Some(class) = class.filter(|_| total > 0.0) else {
                return 0.0;
            };
            let all = f64::from(real.pictures) * real.share(class) / total;
            all / clips_of[Real::shared(class)] as f64
        })
        .collect();
    let mut pictures: Vec<usize> = wanted
        .iter()
        .map(|wanted| wanted.floor() as usize)
        .collect();
    let left = (wanted.iter().sum::<f64>().round() as usize).saturating_sub(pictures.iter().sum());
    let mut order: Vec<usize> = (0..wanted.len()).collect();
    order.sort_by(|a, b| {
        wanted[*b]
            .fract()
            .total_cmp(&wanted[*a].fract())
            .then(a.cmp(b))
    });
    for at in order.into_iter().take(left) {
        pictures[at] += 1;
    }
    pictures
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

/// The things of a frame. What cannot be tightened is neither asked for nor a false alarm, but for an aeroplane that goes on
/// beyond its box: with a contrail the box as it was drawn stays. Nor are two that were tightened to the same thing.
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
                Err(NotTight::GoesOn) => class != ObjectClass::Aeroplane,
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
    for k in 1..annotations.len() {
        let (before, [own, ..]) = annotations.split_at_mut(k) else {
            continue;
        };
        for other in before {
            if iou(own.bbox, other.bbox) > SAME_THING {
                own.ignore = true;
                other.ignore = true;
            }
        }
    }
    Ok(annotations)
}

/// Intersection over union of two boxes, x, y, width, height.
fn iou([ax, ay, aw, ah]: [f64; 4], [bx, by, bw, bh]: [f64; 4]) -> f64 {
    let along = |a: f64, a_side: f64, b: f64, b_side: f64| {
        ((a + a_side).min(b + b_side) - a.max(b)).max(0.0)
    };
    let both = along(ax, aw, bx, bw) * along(ay, ah, by, bh);
    both / (aw * ah + bw * bh - both)
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

/// Ignores, of frames with one thing, those whose tight box is not about as long as those shortly before and after.
fn unsteady(known: &mut [Known]) {
    let long_px = |frame: &Known| match frame.annotations.as_slice() {
        [one] if !one.ignore => Some(one.bbox[2].max(one.bbox[3])),
        _ => None,
    };
    let lengths: Vec<Option<f64>> = known.iter().map(long_px).collect();
    let indices: Vec<usize> = known.iter().map(|frame| frame.index).collect();
    for (i, frame) in known.iter_mut().enumerate() {
        let Some(own_px) = lengths[i] else {
            continue;
        };
        let at = indices[i];
        let mut near: Vec<f64> = (indices.iter().zip(&lengths))
            .filter(|(index, _)| index.abs_diff(at) <= STEADY_FRAMES)
            .filter_map(|(_, length)| *length)
            .collect();
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

    #[test]
    fn a_frame_whose_box_failed_is_no_novelty() {
        let mut known: Vec<Known> = (0..40)
            .map(|i| Known {
                look: vec![0.1 * i as f64],
                ..frame(i, 10.0)
            })
            .collect();
        for k in [3, 9, 20, 33, 39] {
            known[k].annotations[0].ignore = true;
            known[k].look = vec![99.0 + k as f64];
        }
        let wanted = worth_keeping(&mut known, 5);
        assert_eq!(wanted.len(), 5);
        assert!(
            wanted
                .keys()
                .all(|index| ![3, 9, 20, 33, 39].contains(index))
        );
        assert!(wanted.iter().all(|(index, k)| known[*k].index == *index));
    }

    /// A grey picture with dark rectangles, and boxes of a label.
    fn seen(rects: &[[u32; 4]], label: &str, boxes: &[[f64; 4]]) -> Vec<Annotation> {
        let within = |[x0, y0, x1, y1]: [u32; 4], x, y| x >= x0 && x < x1 && y >= y0 && y < y1;
        let picture = image::RgbImage::from_fn(160, 120, |x, y| {
            let dark = rects.iter().any(|rect| within(*rect, x, y));
            image::Rgb(
                [if dark {
                    40
                } else {
                    150 + ((7 * x + 13 * y) % 3) as u8
                }; 3],
            )
        });
        let frame = ClipFrame {
            picture,
            t_s: 0.0,
            file: None,
        };
        let labelled = LabelledFrame::from([(label.to_owned(), boxes.to_vec())]);
        annotations(&Real::default(), &labelled, &frame).unwrap()
    }

    #[test]
    fn what_touches_a_mast_is_not_asked_for_but_an_aeroplane_with_its_trail_is() {
        let (bar, mast) = ([60, 50, 74, 55], [66, 0, 69, 120]);
        let loose_px = [54.0, 44.0, 80.0, 61.0];
        assert!(!seen(&[bar], "bird", &[loose_px])[0].ignore);
        assert!(seen(&[bar, mast], "bird", &[loose_px])[0].ignore);
        let aeroplane = &seen(&[bar, mast], "airplane", &[loose_px])[0];
        assert_eq!(
            (aeroplane.ignore, aeroplane.bbox),
            (false, [54.0, 44.0, 26.0, 17.0])
        );
    }

    #[test]
    fn one_thing_in_two_boxes_is_asked_for_by_neither() {
        let bar = [60, 50, 74, 55];
        let twice = [[54.0, 44.0, 80.0, 61.0], [52.0, 46.0, 82.0, 60.0]];
        assert!(seen(&[bar], "bird", &twice).iter().all(|seen| seen.ignore));
        let apart = [[54.0, 44.0, 80.0, 61.0], [104.0, 44.0, 130.0, 61.0]];
        let two = seen(&[bar, [110, 50, 124, 55]], "bird", &apart);
        assert!(two.len() == 2 && two.iter().all(|seen| !seen.ignore));
    }

    #[test]
    fn pictures_are_shared_out_to_the_last() {
        let real = Real {
            pictures: 20,
            ..Real::default()
        };
        let (uav, fpv, bird) = (ObjectClass::Quadcopter, ObjectClass::Fpv, ObjectClass::Bird);
        // UAVs of two kinds have one share in common: 0.4 of 0.65.
        let shared = shared_out(&real, &[Some(uav), Some(fpv), Some(bird), None]);
        assert_eq!(shared, [6, 6, 8, 0]);
        let many: Vec<_> = (0..100)
            .map(|k| Some(if k < 50 { uav } else { bird }))
            .collect();
        let shared = shared_out(&real, &many);
        assert_eq!(shared.iter().sum::<usize>(), 20);
        assert_eq!(
            shared_out(&real, &[Some(ObjectClass::Other)]),
            [0],
            "its share is 0"
        );
    }
}
