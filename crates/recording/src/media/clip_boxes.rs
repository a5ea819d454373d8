//! Boxes of clips by label: a list of `{file, frames, boxes_xywh}`, as it is published beside video.

use serde::Deserialize;
use std::collections::BTreeMap;

/// Boxes of one frame by label: x0, y0, x1, y1 [px].
pub type LabelledFrame = BTreeMap<String, Vec<[f64; 4]>>;

/// The boxes of a clip.
#[derive(Clone, Debug, PartialEq)]
pub struct LabelledClip {
    /// Name of the clip's file, without folders.
    pub file: String,
    /// Boxes of each of its frames.
    pub frames: Vec<LabelledFrame>,
}

/// What is wrong with a list of boxes.
#[derive(Debug, thiserror::Error)]
pub enum ListFault {
    /// The file cannot be read.
    #[error("cannot be read: {0}; name an existing file")]
    Unreadable(#[from] std::io::Error),
    /// No JSON, a key missing or of another type.
    #[error("{0}; expected a list of {{file, frames, boxes_xywh}}")]
    Json(#[from] serde_json::Error),
    /// A value that cannot be.
    #[error("[{index}] ({file}): {why}")]
    Value {
        /// Index in the list.
        index: usize,
        /// The clip's file.
        file: String,
        /// What is wrong, and what would be right.
        why: String,
    },
}

/// A clip as the list has it.
#[derive(Debug, Deserialize)]
struct Listed {
    file: String,
    frames: usize,
    boxes_xywh: Vec<BTreeMap<String, Vec<[f64; 4]>>>,
}

/// Reads a list of clips with their boxes.
pub fn parse(text: &str) -> Result<Vec<LabelledClip>, ListFault> {
    let listed: Vec<Listed> = serde_json::from_str(text)?;
    let mut clips: Vec<LabelledClip> = Vec::with_capacity(listed.len());
    for (index, clip) in listed.into_iter().enumerate() {
        let wrong = |why: String| ListFault::Value {
            index,
            file: clip.file.clone(),
            why,
        };
        if clip.boxes_xywh.len() != clip.frames {
            let (found, frames) = (clip.boxes_xywh.len(), clip.frames);
            return Err(wrong(format!(
                "boxes_xywh has {found} entries, frames says {frames}"
            )));
        }
        if clips.iter().any(|other| other.file == clip.file) {
            return Err(wrong("the file is listed twice".into()));
        }
        let frames = (clip.boxes_xywh.iter().enumerate())
            .map(|(i, boxes)| frame(boxes).map_err(|why| wrong(format!("frame {i}: {why}"))))
            .collect::<Result<_, _>>()?;
        clips.push(LabelledClip {
            file: clip.file,
            frames,
        });
    }
    Ok(clips)
}

/// The boxes of a frame by their corners, or what is wrong with them.
fn frame(labels: &BTreeMap<String, Vec<[f64; 4]>>) -> Result<LabelledFrame, String> {
    let corners = |[x, y, width, height]: [f64; 4]| {
        let box_px = [x, y, x + width, y + height];
        let good = width > 0.0 && height > 0.0 && box_px.iter().all(|c| c.is_finite());
        good.then_some(box_px).ok_or_else(|| {
            format!(
                "the box [{x}, {y}, {width}, {height}] must be x, y, width and height with sides \
                 above 0 px"
            )
        })
    };
    (labels.iter())
        .map(|(label, boxes)| {
            let boxes = boxes
                .iter()
                .map(|given| corners(*given))
                .collect::<Result<_, _>>()?;
            Ok((label.clone(), boxes))
        })
        .collect()
}
