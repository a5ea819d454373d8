//! How good detections are: average precision as COCO defines it (Lin et al. 2014, the evaluation
//! of `pycocotools`), recall at a rate of false alarms, and the miss distance (eq. 12).

use crate::models::optics::detection::Detection;

/// Most detections that count in one image.
pub const MAX_DETECTIONS: usize = 100;
/// Number of recalls at which the precision is read, 0 to 1 in steps of 0.01.
pub const RECALLS: usize = 101;

/// A box that an annotator drew.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truth {
    /// x0, y0, x1, y1 [px].
    pub box_px: [f64; 4],
    /// Area that decides on its size band [px²].
    pub area_px2: f64,
    /// Whether detections in it count neither as hits nor as false alarms; any number may lie in it.
    pub ignored: bool,
}

impl Truth {
    /// Centre of the box [px].
    pub fn centre_px(&self) -> [f64; 2] {
        let [x0, y0, x1, y1] = self.box_px;
        [0.5 * (x0 + x1), 0.5 * (y0 + y1)]
    }
}

/// An image with its boxes and detections, both in its own pixels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AnnotatedImage {
    /// What an annotator drew.
    pub truth: Vec<Truth>,
    /// Detections, in any order.
    pub found: Vec<Detection>,
}

/// When a detection hits a box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Criterion {
    /// Intersection over union of at least this; with an ignored box, intersection over the
    /// detection's area.
    Iou(f64),
    /// The detection's centre lies in the box, whose size may then be loose.
    Centre,
}

/// Areas of boxes that count, both ends included [px²].
pub type Band = [f64; 2];

/// All sizes.
pub const ALL: Band = [0.0, 1e10];

/// The size bands by the root of the area: below 8, 8 to 16, 16 to 32 and above 32 px.
pub const BANDS: [Band; 4] = [
    [0.0, 64.0],
    [64.0, 256.0],
    [256.0, 1024.0],
    [1024.0, ALL[1]],
];

/// COCO's ten thresholds, 0.5 to 0.95.
pub fn iou_thresholds() -> impl Iterator<Item = f64> {
    (0..10).map(|i| {
        if i == 9 {
            0.95
        } else {
            0.5 + f64::from(i) * ((0.95 - 0.5) / 9.0)
        }
    })
}

/// The recall of index `i`.
pub fn recall_level(i: usize) -> f64 {
    i as f64 * 0.01
}

/// How well a detection fits a box; hits are those of at least the criterion's threshold.
fn fit(criterion: Criterion, found: &Detection, truth: &Truth) -> f64 {
    let ([ax0, ay0, ax1, ay1], [bx0, by0, bx1, by1]) = (found.box_px, truth.box_px);
    match criterion {
        Criterion::Iou(_) => {
            let width = ax1.min(bx1) - ax0.max(bx0);
            let height = ay1.min(by1) - ay0.max(by0);
            if width <= 0.0 || height <= 0.0 {
                return 0.0;
            }
            let both = width * height;
            let area = (ax1 - ax0) * (ay1 - ay0);
            let whole = if truth.ignored {
                area
            } else {
                area + (bx1 - bx0) * (by1 - by0) - both
            };
            both / whole
        }
        Criterion::Centre => {
            let [x, y] = found.centre_px();
            if x < bx0 || x > bx1 || y < by0 || y > by1 {
                return 0.0;
            }
            1.0 / (1.0 + distance_px(found, truth))
        }
    }
}

fn distance_px(found: &Detection, truth: &Truth) -> f64 {
    let ([ax, ay], [bx, by]) = (found.centre_px(), truth.centre_px());
    (ax - bx).hypot(ay - by)
}

/// What became of one detection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mark {
    /// Its confidence.
    pub score: f64,
    /// Index of its image.
    pub image: usize,
    /// Its index in the image.
    pub found: usize,
    /// Index of the box that it hits.
    pub hit: Option<usize>,
    /// Whether it counts neither as a hit nor as a false alarm.
    pub ignored: bool,
}

impl Mark {
    /// Whether it hits a box that counts.
    pub fn is_hit(&self) -> bool {
        self.hit.is_some() && !self.ignored
    }

    /// Whether it is a false alarm.
    pub fn is_false_alarm(&self) -> bool {
        self.hit.is_none() && !self.ignored
    }
}

/// All detections of a set of images, matched with its boxes.
#[derive(Clone, Debug, PartialEq)]
pub struct Matching {
    /// The detections, most confident first; of equal ones, those of earlier images first.
    pub marks: Vec<Mark>,
    /// Boxes that count.
    pub boxes: usize,
    /// Number of images.
    pub images: usize,
}

/// Marks of the detections in one image: the most confident chooses first, a box that counts
/// before an ignored one (`COCOeval.evaluateImg`).
fn match_image(
    index: usize,
    image: &AnnotatedImage,
    criterion: Criterion,
    band: Band,
    out: &mut Vec<Mark>,
) -> usize {
    let outside = |area_px2: f64| area_px2 < band[0] || area_px2 > band[1];
    let mut truth: Vec<(usize, bool)> = (image.truth.iter().enumerate())
        .map(|(i, truth)| (i, truth.ignored || outside(truth.area_px2)))
        .collect();
    truth.sort_by_key(|&(_, ignored)| ignored);
    let mut found: Vec<usize> = (0..image.found.len()).collect();
    found.sort_by(|&a, &b| image.found[b].score.total_cmp(&image.found[a].score));
    found.truncate(MAX_DETECTIONS);
    let least = match criterion {
        Criterion::Iou(threshold) => threshold.min(1.0 - 1e-10),
        Criterion::Centre => f64::MIN_POSITIVE,
    };
    let mut taken = vec![false; image.truth.len()];
    for i in found {
        let detection = &image.found[i];
        let mut best: Option<(usize, bool)> = None;
        let mut best_fit = least;
        for &(k, ignored) in &truth {
            let box_k = &image.truth[k];
            if taken[k] && !box_k.ignored {
                continue;
            }
            if ignored && best.is_some_and(|(_, ignored)| !ignored) {
                break;
            }
            let fit = fit(criterion, detection, box_k);
            if fit >= best_fit {
                best_fit = fit;
                best = Some((k, ignored));
            }
        }
        if let Some((k, _)) = best {
            taken[k] = true;
        }
        let [x0, y0, x1, y1] = detection.box_px;
        out.push(Mark {
            score: detection.score,
            image: index,
            found: i,
            hit: best.map(|(k, _)| k),
            ignored: best.map_or_else(|| outside((x1 - x0) * (y1 - y0)), |(_, ignored)| ignored),
        });
    }
    truth.iter().filter(|(_, ignored)| !ignored).count()
}

impl Matching {
    /// Matches the detections of each image with the boxes whose area is in `band`; other boxes
    /// are ignored, and so are detections of other sizes that hit nothing.
    pub fn of(images: &[AnnotatedImage], criterion: Criterion, band: Band) -> Self {
        let mut marks = Vec::new();
        let boxes = (images.iter().enumerate())
            .map(|(i, image)| match_image(i, image, criterion, band, &mut marks))
            .sum();
        marks.sort_by(|a, b| b.score.total_cmp(&a.score));
        Self {
            marks,
            boxes,
            images: images.len(),
        }
    }

    /// Precision at the recalls of `recall_level`, each the highest at this or a larger recall
    /// (`COCOeval.accumulate`), 0 where the recall is not reached; `None` without boxes.
    pub fn precision(&self) -> Option<[f64; RECALLS]> {
        if self.boxes == 0 {
            return None;
        }
        let (mut hits, mut alarms) = (0.0, 0.0);
        let mut curve: Vec<[f64; 2]> = (self.marks.iter())
            .filter(|mark| !mark.ignored)
            .map(|mark| {
                if mark.is_hit() {
                    hits += 1.0;
                } else {
                    alarms += 1.0;
                }
                [hits / self.boxes as f64, hits / (hits + alarms)]
            })
            .collect();
        let mut highest = 0.0_f64;
        for [_, precision] in curve.iter_mut().rev() {
            highest = highest.max(*precision);
            *precision = highest;
        }
        Some(std::array::from_fn(|i| {
            let at = curve.partition_point(|[recall, _]| *recall < recall_level(i));
            curve.get(at).map_or(0.0, |[_, precision]| *precision)
        }))
    }

    /// Average precision: the mean of `precision`.
    pub fn average_precision(&self) -> Option<f64> {
        self.precision()
            .map(|precision| precision.iter().sum::<f64>() / RECALLS as f64)
    }

    /// The largest recall with at most `rate` false alarms an image, and the score from which on
    /// detections count there (infinite if none may); `None` without boxes. Detections of one
    /// score count together, since no threshold parts them.
    pub fn recall_at(&self, rate: f64) -> Option<(f64, f64)> {
        if self.boxes == 0 {
            return None;
        }
        // Rounding must not forbid an alarm that the rate allows, as 0.1 of 30 images does.
        let allowed = rate * self.images as f64 * (1.0 + 1e-12);
        let (mut hits, mut alarms) = (0_usize, 0_usize);
        let mut best = (0_usize, f64::INFINITY);
        for group in self.marks.chunk_by(|a, b| a.score == b.score) {
            hits += group.iter().filter(|mark| mark.is_hit()).count();
            alarms += group.iter().filter(|mark| mark.is_false_alarm()).count();
            if alarms as f64 > allowed {
                break;
            }
            if hits > best.0 {
                best = (hits, group[0].score);
            }
        }
        Some((best.0 as f64 / self.boxes as f64, best.1))
    }

    /// Recall of the detections from `score` on, `None` without boxes, and their false alarms an
    /// image.
    pub fn at_score(&self, score: f64) -> (Option<f64>, f64) {
        let counted = |which: fn(&Mark) -> bool| {
            let marks = self.marks.iter().filter(|mark| mark.score >= score);
            marks.filter(|mark| which(mark)).count() as f64
        };
        let recall = counted(Mark::is_hit) / self.boxes as f64;
        (
            (self.boxes > 0).then_some(recall),
            counted(Mark::is_false_alarm) / self.images.max(1) as f64,
        )
    }

    /// Distance between the centres of each hit and its box [px], eq. 12's summands.
    pub fn miss_distances_px<'a>(
        &'a self,
        images: &'a [AnnotatedImage],
    ) -> impl Iterator<Item = f64> + 'a {
        self.marks
            .iter()
            .filter(|mark| !mark.ignored)
            .filter_map(|mark| {
                let image = images.get(mark.image)?;
                Some(distance_px(
                    image.found.get(mark.found)?,
                    image.truth.get(mark.hit?)?,
                ))
            })
    }
}

/// Mean of the average precision over COCO's ten thresholds; `None` without boxes.
pub fn mean_average_precision(images: &[AnnotatedImage], band: Band) -> Option<f64> {
    let sum: Option<f64> = iou_thresholds()
        .map(|iou| Matching::of(images, Criterion::Iou(iou), band).average_precision())
        .sum();
    sum.map(|sum| sum / 10.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::Value;

    fn detection(box_px: [f64; 4], score: f64) -> Detection {
        Detection::new(box_px, score, 0)
    }

    fn truth(box_px: [f64; 4]) -> Truth {
        let [x0, y0, x1, y1] = box_px;
        Truth {
            box_px,
            area_px2: (x1 - x0) * (y1 - y0),
            ignored: false,
        }
    }

    fn numbers(value: &Value) -> Vec<f64> {
        let list = value.as_array().expect("a list");
        list.iter().map(|x| x.as_f64().expect("a number")).collect()
    }

    /// The random set of `tests/score_coco.py`, with what pycocotools says of it.
    fn reference() -> (Vec<AnnotatedImage>, Value) {
        let text = include_str!("../../../tests/data/detections.json");
        let mut set: Value = serde_json::from_str(text).expect("JSON");
        let count = set["images"].as_u64().expect("a number") as usize;
        let mut images = vec![AnnotatedImage::default(); count];
        let corners = |value: &Value| {
            let b = numbers(value);
            [b[0], b[1], b[0] + b[2], b[1] + b[3]]
        };
        let place = |row: &Value| row[0].as_u64().expect("an image") as usize - 1;
        for row in set["boxes"].as_array().expect("boxes") {
            let b = numbers(&row[1]);
            images[place(row)].truth.push(Truth {
                area_px2: b[2] * b[3],
                ignored: row[2].as_bool().expect("a flag"),
                ..truth(corners(&row[1]))
            });
        }
        for row in set["detections"].as_array().expect("detections") {
            let score = row[2].as_f64().expect("a score");
            images[place(row)]
                .found
                .push(detection(corners(&row[1]), score));
        }
        (images, set["pycocotools"].take())
    }

    #[test]
    fn average_precision_is_that_of_pycocotools() {
        let (images, expected) = reference();
        let bands = [
            ("all", ALL),
            ("lt8", BANDS[0]),
            ("8to16", BANDS[1]),
            ("16to32", BANDS[2]),
            ("ge32", BANDS[3]),
        ];
        for (name, band) in bands {
            let ap50 = Matching::of(&images, Criterion::Iou(0.5), band).average_precision();
            let ap = mean_average_precision(&images, band);
            for (key, value) in [("ap50", ap50), ("ap50_95", ap)] {
                let theirs = expected[name][key].as_f64().expect("a number");
                let ours = value.expect("boxes");
                assert!(
                    (ours - theirs).abs() < 1e-3,
                    "{name} {key}: {ours} against {theirs}"
                );
            }
        }
        let curve = Matching::of(&images, Criterion::Iou(0.5), ALL)
            .precision()
            .expect("boxes");
        for (ours, theirs) in curve.iter().zip(numbers(&expected["precision50"])) {
            assert!((ours - theirs).abs() < 1e-6, "{ours} against {theirs}");
        }
    }

    /// Without ignored boxes the same set scores otherwise, so that the fixture does test them.
    #[test]
    fn ignored_boxes_matter() {
        let (mut images, _) = reference();
        let ap = |images: &[AnnotatedImage]| mean_average_precision(images, ALL).expect("boxes");
        let with = ap(&images);
        for image in &mut images {
            image.truth.retain(|truth| !truth.ignored);
        }
        assert!((ap(&images) - with).abs() > 5e-3, "{with}");
    }

    #[test]
    fn recall_stops_at_the_rate_of_false_alarms() {
        // Ten images allow one false alarm at 0.1. By score: hit 0.9, alarm 0.8, hit 0.7, hit and
        // alarm at 0.6 together, hit 0.5.
        let target = [10.0, 10.0, 20.0, 20.0];
        let far = [50.0, 50.0, 60.0, 60.0];
        let mut images = vec![AnnotatedImage::default(); 10];
        for (i, score) in [0.9, 0.7, 0.6, 0.5].into_iter().enumerate() {
            images[i].truth.push(truth(target));
            images[i].found.push(detection(target, score));
        }
        images[8].found.push(detection(far, 0.8));
        images[9].found.push(detection(far, 0.6));
        let matching = Matching::of(&images, Criterion::Iou(0.5), ALL);
        assert_eq!(matching.recall_at(0.1), Some((0.5, 0.7)));
        assert_eq!(matching.recall_at(0.0), Some((0.25, 0.9)));
        assert_eq!(matching.recall_at(0.2), Some((1.0, 0.5)));
        images[8].found[0].score = 0.95;
        let matching = Matching::of(&images, Criterion::Iou(0.5), ALL);
        assert_eq!(matching.recall_at(0.05), Some((0.0, f64::INFINITY)));
        assert_eq!(
            Matching::of(&[], Criterion::Centre, ALL).recall_at(1.0),
            None
        );
    }

    #[test]
    fn miss_distance_is_between_the_centres_of_hits() {
        let target = [10.0, 10.0, 30.0, 30.0];
        let images = [
            // 3 px and 4 px off: 5 px; beside it a false alarm and an ignored detection.
            AnnotatedImage {
                truth: vec![
                    truth(target),
                    Truth {
                        ignored: true,
                        ..truth([60.0, 60.0, 90.0, 90.0])
                    },
                ],
                found: vec![
                    detection([13.0, 14.0, 33.0, 34.0], 0.9),
                    detection([200.0, 14.0, 220.0, 34.0], 0.8),
                    detection([62.0, 62.0, 72.0, 72.0], 0.7),
                    detection([75.0, 75.0, 85.0, 85.0], 0.6),
                ],
            },
            AnnotatedImage {
                truth: vec![truth(target)],
                found: vec![detection([11.0, 10.0, 31.0, 30.0], 0.5)],
            },
        ];
        let centre = Matching::of(&images, Criterion::Centre, ALL);
        let distances: Vec<f64> = centre.miss_distances_px(&images).collect();
        assert_eq!(distances, [5.0, 1.0]);
        assert_eq!(centre.boxes, 2);
        let alarms = centre.marks.iter().filter(|mark| mark.is_false_alarm());
        assert_eq!(alarms.count(), 1);
        // 17 × 16 px in common of 528: 0.515.
        let loose = Matching::of(&images, Criterion::Iou(0.5), ALL);
        assert_eq!(loose.miss_distances_px(&images).count(), 2);
        let strict = Matching::of(&images, Criterion::Iou(0.6), ALL);
        assert_eq!(strict.miss_distances_px(&images).collect::<Vec<_>>(), [1.0]);
    }

    #[test]
    fn no_boxes_have_no_average_precision() {
        let images = [AnnotatedImage {
            truth: Vec::new(),
            found: vec![detection([0.0, 0.0, 5.0, 5.0], 0.9)],
        }];
        assert_eq!(mean_average_precision(&images, ALL), None);
    }
}
