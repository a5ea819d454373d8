//! Recall and false alarms over the threshold, what false alarms lie on, and what distractors are
//! taken for; intervals by clip, since pictures of one clip resemble each other.

use super::coco::{Coco, Other};
use super::metrics::{AnnotatedImage, Mark, Matching};
use crate::models::flight::class::ObjectClass;
use crate::models::maths::quantile::quantile;
use crate::models::maths::rng::Stream;
use crate::models::optics::detection::Detection;
use serde::Serialize;
use std::collections::BTreeMap;

/// Thresholds of the table.
const STEPS: usize = 19;
/// Draws of the bootstrap.
const DRAWS: u64 = 1_000;
/// A false alarm lies on something if its middle is this close to the box [px].
const NEAR_PX: f64 = 3.0;

/// A figure with its 95 % interval over clips.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Figure {
    /// The figure of all pictures; null without any to measure it on.
    pub value: Option<f64>,
    /// 2.5 and 97.5 % of the figures of as many clips drawn with replacement (Efron, Ann. Stat. 7
    /// (1979) 1); null with fewer than two clips.
    pub interval_95: Option<[f64; 2]>,
}

impl Figure {
    /// The ratio of two sums, whose parts are given clip by clip.
    fn ratio(parts: &[[f64; 2]], draws: &[Vec<usize>]) -> Self {
        let of = |clips: &mut dyn Iterator<Item = usize>| {
            let [above, below] = clips.fold([0.0; 2], |[a, b], clip| {
                [a + parts[clip][0], b + parts[clip][1]]
            });
            (below > 0.0).then_some(above / below)
        };
        let mut drawn: Vec<f64> = (draws.iter())
            .filter_map(|clips| of(&mut clips.iter().copied()))
            .collect();
        drawn.sort_by(f64::total_cmp);
        let interval = || Some([quantile(&drawn, 0.025)?, quantile(&drawn, 0.975)?]);
        Self {
            value: of(&mut (0..parts.len())),
            interval_95: if parts.len() > 1 { interval() } else { None },
        }
    }

    /// The figure and its interval with so many decimals.
    pub(super) fn text(&self, decimals: usize) -> String {
        match (self.value, self.interval_95) {
            (None, _) => "–".into(),
            (Some(value), None) => format!("{value:.decimals$}"),
            (Some(value), Some([low, high])) => {
                format!("{value:.decimals$} ({low:.decimals$}–{high:.decimals$})")
            }
        }
    }
}

/// Recall and false alarms from a score on.
#[derive(Clone, Debug, Serialize)]
pub struct AtThreshold {
    /// The score.
    pub threshold: f64,
    /// Share of the boxes that are hit at an IoU of 0.5.
    pub recall: Figure,
    /// False alarms a frame.
    pub false_alarms_per_frame: Figure,
}

/// What became of the distractors of a category.
#[derive(Clone, Debug, Serialize)]
pub struct Taken {
    /// Boxes that show enough of it.
    pub boxes: usize,
    /// Share of them that a detection from the threshold on calls a UAV.
    pub as_uav: Figure,
    /// Share that only detections of other classes meet, whatever their score.
    pub as_other: Figure,
    /// Share that one of its own class meets, among these.
    pub rightly: Figure,
}

/// The figures of this file.
#[derive(Clone, Debug, Serialize)]
pub struct Operating {
    /// Clips or scenes that the pictures are of.
    pub clips: usize,
    /// Over the threshold.
    pub over_threshold: Vec<AtThreshold>,
    /// False alarms a frame from the threshold on by what they lie on.
    pub alarms_on: BTreeMap<String, Figure>,
    /// Distractors by category.
    pub distractors: BTreeMap<String, Taken>,
}

/// What all this is counted from.
pub(super) struct Counted<'a> {
    pub coco: &'a Coco,
    /// Pictures with the detections that are called UAVs.
    pub images: &'a [AnnotatedImage],
    /// The others of every picture.
    pub named: &'a [Vec<Detection>],
    /// Names of the model's classes.
    pub classes: &'a [String],
    /// Matching at an IoU of 0.5.
    pub half: &'a Matching,
    pub threshold: f64,
}

impl Counted<'_> {
    pub(super) fn operating(&self) -> Operating {
        let mut clips: BTreeMap<&str, usize> = BTreeMap::new();
        let clip_of: Vec<usize> = (self.coco.pictures.iter())
            .map(|picture| {
                let next = clips.len();
                *clips.entry(picture.clip()).or_insert(next)
            })
            .collect();
        let clips = clips.len();
        let draws: Vec<Vec<usize>> = (0..DRAWS)
            .map(|draw| {
                let mut rng = Stream::new(1, draw, "clips");
                let mut pick = || (rng.uniform() * clips as f64) as usize;
                (0..clips).map(|_| pick().min(clips - 1)).collect()
            })
            .collect();
        Operating {
            clips,
            over_threshold: (1..=STEPS)
                .map(|step| step as f64 / (STEPS + 1) as f64)
                .map(|threshold| self.at(threshold, clips, &clip_of, &draws))
                .collect(),
            alarms_on: self.alarms_on(clips, &clip_of, &draws),
            distractors: self.distractors(clips, &clip_of, &draws),
        }
    }

    /// The marks from a score on.
    fn marks(&self, threshold: f64) -> impl Iterator<Item = &Mark> {
        (self.half.marks.iter()).take_while(move |mark| mark.score >= threshold)
    }

    fn at(
        &self,
        threshold: f64,
        clips: usize,
        clip_of: &[usize],
        draws: &[Vec<usize>],
    ) -> AtThreshold {
        let (mut hits, mut alarms) = (vec![[0.0; 2]; clips], vec![[0.0; 2]; clips]);
        for (image, clip) in self.images.iter().zip(clip_of) {
            hits[*clip][1] += image.truth.iter().filter(|t| !t.ignored).count() as f64;
            alarms[*clip][1] += 1.0;
        }
        for mark in self.marks(threshold) {
            let clip = clip_of[mark.image];
            hits[clip][0] += f64::from(u8::from(mark.is_hit()));
            alarms[clip][0] += f64::from(u8::from(mark.is_false_alarm()));
        }
        AtThreshold {
            threshold,
            recall: Figure::ratio(&hits, draws),
            false_alarms_per_frame: Figure::ratio(&alarms, draws),
        }
    }

    /// What a false alarm lies on.
    fn lies_on(&self, mark: &Mark) -> &str {
        let middle = self.images[mark.image].found[mark.found].centre_px();
        let on = (self.coco.others[mark.image].iter()).find(|other| near(other.box_px, middle));
        match on {
            Some(other) => &other.name,
            None if (self.images[mark.image].truth.iter()).any(|t| near(t.box_px, middle)) => {
                "a UAV, badly boxed or twice"
            }
            None => "scenery or sky",
        }
    }

    fn alarms_on(
        &self,
        clips: usize,
        clip_of: &[usize],
        draws: &[Vec<usize>],
    ) -> BTreeMap<String, Figure> {
        let mut frames = vec![[0.0; 2]; clips];
        for clip in clip_of {
            frames[*clip][1] += 1.0;
        }
        let mut parts: BTreeMap<String, Vec<[f64; 2]>> = (self.coco.other_ids.keys())
            .map(|name| (name.clone(), frames.clone()))
            .collect();
        for mark in self.marks(self.threshold).filter(|m| m.is_false_alarm()) {
            let on = parts.entry(self.lies_on(mark).into());
            on.or_insert_with(|| frames.clone())[clip_of[mark.image]][0] += 1.0;
        }
        (parts.into_iter())
            .map(|(on, parts)| (on, Figure::ratio(&parts, draws)))
            .collect()
    }

    fn distractors(
        &self,
        clips: usize,
        clip_of: &[usize],
        draws: &[Vec<usize>],
    ) -> BTreeMap<String, Taken> {
        let mut parts: BTreeMap<&str, [Vec<[f64; 2]>; 3]> = BTreeMap::new();
        for (image, others) in self.coco.others.iter().enumerate() {
            for other in others.iter().filter(|other| !other.ignored) {
                let of_kind = parts.entry(&other.name);
                let of_kind = of_kind.or_insert_with(|| [0; 3].map(|_| vec![[0.0; 2]; clips]));
                let [as_uav, as_other, rightly] = self.taken(image, other);
                let named = as_other && !as_uav;
                for (parts, yes) in of_kind.iter_mut().zip([as_uav, named, rightly && named]) {
                    parts[clip_of[image]][0] += f64::from(u8::from(yes));
                }
                for part in &mut of_kind[..2] {
                    part[clip_of[image]][1] += 1.0;
                }
                of_kind[2][clip_of[image]][1] += f64::from(u8::from(named));
            }
        }
        (parts.into_iter())
            .map(|(name, [as_uav, as_other, rightly])| {
                let taken = Taken {
                    boxes: as_uav.iter().map(|part| part[1] as usize).sum(),
                    as_uav: Figure::ratio(&as_uav, draws),
                    as_other: Figure::ratio(&as_other, draws),
                    rightly: Figure::ratio(&rightly, draws),
                };
                (name.to_owned(), taken)
            })
            .collect()
    }

    /// Whether a detection from the threshold on calls a distractor a UAV, whether one calls it
    /// something else, and whether that is right.
    fn taken(&self, image: usize, other: &Other) -> [bool; 3] {
        let on = |found: &&Detection| near(other.box_px, found.centre_px());
        let uavs = self.images[image].found.iter();
        let mut named = self.named[image].iter().filter(on);
        let class = ObjectClass::of_name(&other.name);
        let is_right = |found: &Detection| {
            let name = self.classes.get(found.label as usize);
            name.is_some_and(|name| class.is_some() && ObjectClass::of_name(name) == class)
        };
        [
            uavs.filter(on).any(|found| found.score >= self.threshold),
            named.clone().next().is_some(),
            named.any(is_right),
        ]
    }
}

/// Whether a place lies in a box, or close to it [px].
fn near([x0, y0, x1, y1]: [f64; 4], [x, y]: [f64; 2]) -> bool {
    (x0 - NEAR_PX..=x1 + NEAR_PX).contains(&x) && (y0 - NEAR_PX..=y1 + NEAR_PX).contains(&y)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interval_is_that_of_clips_not_of_frames() {
        let draws = |clips: usize| -> Vec<Vec<usize>> {
            (0..500)
                .map(|draw| {
                    let mut rng = Stream::new(2, draw, "test");
                    (0..clips)
                        .map(|_| (rng.uniform() * clips as f64) as usize)
                        .collect()
                })
                .collect()
        };
        // Half of the clips always right, the others never: 100 frames each tell no more than one.
        let parts: Vec<[f64; 2]> = (0..20)
            .map(|clip| [100.0 * f64::from(clip % 2), 100.0])
            .collect();
        let figure = Figure::ratio(&parts, &draws(20));
        assert_eq!(figure.value, Some(0.5));
        // The standard error of 20 throws is 0.11.
        let [low, high] = figure.interval_95.unwrap();
        assert!(
            (0.2..0.36).contains(&low) && (0.64..0.8).contains(&high),
            "{low} {high}"
        );
        // Clips that agree leave no doubt; one clip says nothing of others.
        let same = Figure::ratio(&[[30.0, 60.0]; 9], &draws(9));
        assert_eq!(same.interval_95, Some([0.5, 0.5]));
        assert_eq!(Figure::ratio(&[[1.0, 4.0]], &draws(1)).interval_95, None);
        assert_eq!(Figure::ratio(&[[0.0, 0.0]; 3], &draws(3)).value, None);
        assert_eq!(same.text(2), "0.50 (0.50–0.50)");
    }
}
