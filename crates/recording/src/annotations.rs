//! What is drawn on a picture: labelled boxes and the reticle.

use crate::scene::{Rgba, colour};
use foxglove::messages::{self as fg, ImageAnnotations, Point2, Timestamp, points_annotation};

/// One labelled box on an image.
#[derive(Clone, Copy, Debug)]
pub struct BoxAnnotation<'a> {
    /// Class of what it holds.
    pub label: &'a str,
    /// Box as x0, y0, x1, y1 \[px\].
    pub rect_px: [f64; 4],
    /// Score of the detection, 0 to 1.
    pub score: f64,
    /// Whether that is below the threshold.
    pub weak: bool,
}

/// Colours of what counts by itself, and of what does not.
const STRONG: Rgba = [0.0, 0.62, 0.45, 1.0];
const WEAK: Rgba = [0.6, 0.6, 0.6, 0.35];

/// What the annotation of a box says besides, by key.
pub(crate) const CLASS: &str = "class";
pub(crate) const SCORE: &str = "score";
pub(crate) const COUNTS: &str = "counts";

impl BoxAnnotation<'_> {
    fn metadata(&self) -> Vec<fg::KeyValuePair> {
        let pair = |key: &str, value: String| fg::KeyValuePair {
            key: key.to_owned(),
            value,
        };
        vec![
            pair(CLASS, self.label.to_owned()),
            pair(SCORE, format!("{:.3}", self.score)),
            pair(COUNTS, (!self.weak).to_string()),
        ]
    }
}

/// Boxes and the reticle \[px\] on an image of that time.
pub(crate) fn annotations(
    timestamp: Option<Timestamp>,
    boxes: &[BoxAnnotation],
    reticle_px: [f64; 2],
) -> ImageAnnotations {
    let mut message = ImageAnnotations {
        timestamp,
        ..Default::default()
    };
    let mut boxes: Vec<&BoxAnnotation> = boxes.iter().collect();
    // What is drawn later covers what was drawn before.
    boxes.sort_by(|a, b| b.weak.cmp(&a.weak).then(a.score.total_cmp(&b.score)));
    for annotation in boxes {
        let [x0, y0, x1, y1] = annotation.rect_px;
        let outline = if annotation.weak { WEAK } else { STRONG };
        message.points.push(fg::PointsAnnotation {
            timestamp,
            r#type: points_annotation::Type::LineLoop.into(),
            points: [[x0, y0], [x1, y0], [x1, y1], [x0, y1]].map(point2).into(),
            outline_color: Some(colour(outline)),
            thickness: 1.0, // [px]
            metadata: annotation.metadata(),
            ..Default::default()
        });
        // A text of what does not count would lie on those of what does.
        if !annotation.weak {
            message.texts.push(fg::TextAnnotation {
                timestamp,
                position: Some(point2([x0, y0 - 2.0])),
                text: annotation.label.to_owned(),
                font_size: 12.0, // [px]
                text_color: Some(colour(outline)),
                ..Default::default()
            });
        }
    }
    let [x, y] = reticle_px;
    // A cross with an open centre, so that it never hides a target of a few pixels.
    const ARMS_PX: [[f64; 2]; 8] = [
        [-16.0, 0.0],
        [-6.0, 0.0],
        [6.0, 0.0],
        [16.0, 0.0],
        [0.0, -16.0],
        [0.0, -6.0],
        [0.0, 6.0],
        [0.0, 16.0],
    ];
    message.points.push(fg::PointsAnnotation {
        timestamp,
        r#type: points_annotation::Type::LineList.into(),
        points: ARMS_PX.map(|[dx, dy]| point2([x + dx, y + dy])).into(),
        outline_color: Some(colour([1.0, 1.0, 1.0, 0.8])),
        thickness: 1.0, // [px]
        ..Default::default()
    });
    message
}

fn point2([x, y]: [f64; 2]) -> Point2 {
    Point2 { x, y }
}
