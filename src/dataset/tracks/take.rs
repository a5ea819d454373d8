//! What is gathered of the tracks of a run or a clip, and the folder that it makes.

use crate::components::capture::Tier;
use crate::dataset::DatasetError;
use crate::models::optics::chip::{CHIP_PX, Chip};
use crate::models::tracking::recognition::{FEATURES, STEPS, Sequence, Step, TrackClass};
use crate::models::tracking::table::Track;
use crate::output;
use glam::DVec2;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, HashMap, VecDeque};
use std::path::{Path, PathBuf};

/// What a folder holds, as `sequences.json` has it.
#[derive(Serialize)]
struct Sheet {
    version: &'static str,
    #[serde(flatten)]
    of: Of,
    features: Vec<&'static str>,
    chips: usize,
    sequences: Vec<Labelled>,
}

/// What the tracks of a folder are of.
#[derive(Serialize, Deserialize, PartialEq)]
#[serde(untagged)]
pub(super) enum Of {
    /// A run.
    Run {
        scenario: PathBuf,
        overrides: Vec<String>,
        seed: u64,
        rate_hz: u32,
    },
    /// A clip of a real camera, and the part of a data set to which its recipe puts it.
    Clip {
        clip: String,
        split: String,
        model: PathBuf,
        rate_hz: u32,
    },
}

impl Of {
    /// Whether a folder holds the tracks of just this; one that holds others is refused.
    pub(super) fn is_whole(&self, folder: &Path) -> Result<bool, DatasetError> {
        let Ok(text) = std::fs::read_to_string(folder.join("sequences.json")) else {
            return Ok(false);
        };
        match serde_json::from_str::<Self>(&text) {
            Ok(found) if found == *self => Ok(true),
            _ => Err(DatasetError::OtherTracks {
                path: folder.into(),
            }),
        }
    }
}

/// One sequence.
#[derive(Serialize)]
struct Labelled {
    /// Identity of the track.
    track: u32,
    /// End of the second [s].
    t_s: f64,
    /// What it truly is.
    class: &'static str,
    /// Name of the object, if its detections lie on one.
    object: Option<String>,
    /// Share of the steps that lie on it, or on nothing.
    share: f64,
    /// Steps in which it was seen.
    seen: usize,
    /// Camera of the newest step.
    camera: &'static str,
    /// Larger side of its box in the newest step [px].
    size_px: f64,
    /// Distance of the object [m].
    range_m: Option<f64>,
    /// Whether it is the tracker's target.
    target: bool,
}

/// How long the truth of frames is kept [s]: the last second and what a batch may be late.
pub(super) const KEPT_S: f64 = 3.0; // [s]
/// A detection's middle counts as on an object up to this far out of its box: this share of the box's
/// size, and so many pixels.
const OUTSIDE_SHARE: f64 = 0.25;
const OUTSIDE_PX: f64 = 3.0; // [px]
/// Share of a sequence's steps that must lie on one thing; what is more mixed is not written.
const PURE_SHARE: f64 = 0.7;

/// Something in front of a camera when a frame was exposed.
#[derive(Clone, Copy, Debug)]
pub(super) struct InFrame {
    /// Its number among the objects.
    pub(super) object: usize,
    /// x0, y0, x1, y1 of what is seen of it [px].
    pub(super) box_px: [f64; 4],
    /// Distance [m], where it is known.
    pub(super) range_m: Option<f64>,
}

/// What is gathered of the tracks of a run or a clip.
#[derive(Default)]
pub(super) struct Take {
    /// Name and class of each object, by its number.
    objects: BTreeMap<usize, (String, TrackClass)>,
    /// Truth of the last frames: tick, camera, what was in front of it.
    pub(super) frames: VecDeque<(u64, Tier, Vec<InFrame>)>,
    chips: Vec<Chip>,
    /// Where a chip, which is kept there and so keeps its address, stands.
    places: HashMap<*const u8, i32>,
    index: Vec<i32>,
    features: Vec<f32>,
    labelled: Vec<Labelled>,
}

impl Take {
    /// Nothing yet, of tracks of these objects.
    pub(super) fn of(objects: BTreeMap<usize, (String, TrackClass)>) -> Self {
        Self {
            objects,
            ..Self::default()
        }
    }

    /// The object on which a step's detection lies, and how far away it is [m], or that it lies on none; `None` where the truth
    /// of its frame is not kept.
    fn object(&self, step: &Step) -> Option<Option<(usize, Option<f64>)>> {
        let glimpse = step.glimpses[0];
        let (.., truth) = self
            .frames
            .iter()
            .find(|(tick, tier, _)| *tick == glimpse.tick && *tier == glimpse.tier)?;
        let at = DVec2::from(glimpse.centre_px);
        let near = truth.iter().filter_map(|seen| {
            let [x0, y0, x1, y1] = seen.box_px;
            let middle = 0.5 * DVec2::new(x0 + x1, y0 + y1);
            let half = 0.5 * DVec2::new(x1 - x0, y1 - y0);
            let reach = half * (1.0 + 2.0 * OUTSIDE_SHARE) + DVec2::splat(OUTSIDE_PX);
            let off = (at - middle).abs();
            let on = off.x <= reach.x && off.y <= reach.y;
            on.then(|| (seen.object, seen.range_m, (off / reach).length()))
        });
        let nearest = near.min_by(|a, b| a.2.total_cmp(&b.2));
        Some(nearest.map(|(index, range_m, _)| (index, range_m)))
    }

    /// Keeps a sequence whose steps lie on one thing.
    pub(super) fn keep(&mut self, track: &Track, sequence: &Sequence, t_s: f64, target: bool) {
        let steps: Vec<&Step> = sequence.steps.iter().flatten().collect();
        let Some(newest) = steps.last().map(|step| step.glimpses[0]) else {
            return;
        };
        let on: Vec<Option<(usize, Option<f64>)>> =
            steps.iter().filter_map(|step| self.object(step)).collect();
        let mut votes: BTreeMap<Option<usize>, usize> = BTreeMap::new();
        for object in &on {
            *votes.entry(object.map(|(index, _)| index)).or_default() += 1;
        }
        let Some((object, count)) = votes.into_iter().max_by_key(|(_, count)| *count) else {
            return;
        };
        let share = count as f64 / on.len() as f64;
        if share < PURE_SHARE {
            return;
        }
        let named = object.and_then(|index| self.objects.get(&index));
        self.labelled.push(Labelled {
            track: track.id,
            t_s,
            class: named.map_or(TrackClass::Other, |(_, class)| *class).name(),
            object: named.map(|(name, _)| name.clone()),
            share,
            seen: steps.len(),
            camera: newest.tier.name(),
            size_px: newest.size_px[0].max(newest.size_px[1]),
            range_m: (on.iter().rev().flatten())
                .find(|(index, _)| Some(*index) == object)
                .and_then(|(_, range_m)| *range_m),
            target,
        });
        self.features.extend(sequence.features.iter().flatten());
        for step in &sequence.steps {
            let at = step.as_ref().map_or(-1, |step| self.place(&step.chip));
            self.index.push(at);
        }
    }

    /// Where a chip stands among those that are written; it is added if it is new.
    fn place(&mut self, chip: &Chip) -> i32 {
        *self.places.entry(chip.as_ptr()).or_insert_with(|| {
            self.chips.push(chip.clone());
            (self.chips.len() - 1) as i32
        })
    }

    /// Writes all that was gathered, what it is of last; the number of sequences.
    pub(super) fn write(self, folder: &Path, of: Of) -> Result<usize, DatasetError> {
        output::create_dir(folder)?;
        let count = self.labelled.len();
        let chips: Vec<u8> = self
            .chips
            .iter()
            .flat_map(|chip| chip.iter().copied())
            .collect();
        let shape = [self.chips.len(), CHIP_PX, CHIP_PX, 3];
        output::write(&folder.join("chips.npy"), npy("|u1", &shape, &chips))?;
        let index: Vec<u8> = self.index.iter().flat_map(|i| i.to_le_bytes()).collect();
        output::write(
            &folder.join("index.npy"),
            npy("<i4", &[count, STEPS], &index),
        )?;
        let features: Vec<u8> = self.features.iter().flat_map(|x| x.to_le_bytes()).collect();
        let shape = [count, STEPS, FEATURES.len()];
        output::write(&folder.join("features.npy"), npy("<f4", &shape, &features))?;
        let sheet = Sheet {
            version: crate::VERSION,
            of,
            features: FEATURES.to_vec(),
            chips: self.chips.len(),
            sequences: self.labelled,
        };
        let text = serde_json::to_string(&sheet)?;
        output::write(&folder.join("sequences.json"), text + "\n")?;
        Ok(count)
    }
}

/// An array in NumPy's format 1.0 (numpy.lib.format), C order.
fn npy(kind: &str, shape: &[usize], bytes: &[u8]) -> Vec<u8> {
    const ALIGN: usize = 64;
    const HEAD: usize = 10;
    let sides: Vec<String> = shape.iter().map(|side| format!("{side},")).collect();
    let mut text = format!(
        "{{'descr': '{kind}', 'fortran_order': False, 'shape': ({}), }}",
        sides.join(" ")
    );
    // The text ends with a line break where the data are aligned.
    let filled = (HEAD + text.len() + 1).next_multiple_of(ALIGN) - HEAD - 1;
    text += &" ".repeat(filled - text.len());
    text.push('\n');
    let mut out = b"\x93NUMPY\x01\x00".to_vec();
    out.extend((text.len() as u16).to_le_bytes());
    out.extend(text.as_bytes());
    out.extend(bytes);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_array_has_numpys_head() {
        let bytes = npy("<i4", &[2, 3], &[7; 24]);
        assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00");
        let length = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
        assert_eq!((10 + length) % 64, 0);
        let text = std::str::from_utf8(&bytes[10..10 + length]).unwrap();
        assert!(text.starts_with("{'descr': '<i4', 'fortran_order': False, 'shape': (2, 3,), }"));
        assert!(text.ends_with('\n'));
        assert_eq!(bytes.len(), 10 + length + 24);
    }
}
