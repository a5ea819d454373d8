//! Tracks of clips of real cameras: detector and tracker as on `eval clip`, truth by the clips' boxes.

use super::take::{InFrame, KEPT_S, Of, Take};
use crate::components::capture::Tier;
use crate::dataset::DatasetError;
use crate::dataset::real::{Clips, Filmed};
use crate::dataset::recipe::Recipe;
use crate::eval::clip::follow::{CENTRE_SIGMA_PX, FOV_DEG, Follower, Following};
use crate::eval::clip::weak_score;
use crate::inference::OnnxDetector;
use crate::models::optics::detection::Detection;
use crate::parallel::{in_parallel, threads};
use crate::scenario::DetectorConfig;
use crate::stop;
use std::num::NonZeroUsize;
use std::path::Path;

/// What is made of a folder of clips.
pub(super) struct Wanted<'a> {
    /// The folder, and the recipe that says what its labels are.
    pub(super) clips: &'a Path,
    pub(super) recipe: &'a Path,
    /// Where a folder is made for each clip.
    pub(super) out: &'a Path,
    /// The detector; that of scenarios by default.
    pub(super) model: Option<&'a Path>,
    /// Times a second that every track is written [Hz].
    pub(super) rate_hz: u32,
    /// Clips at once; all cores by default.
    pub(super) threads: Option<NonZeroUsize>,
}

/// Makes the tracks of every clip of a folder; what to tell the user.
pub(super) fn tracks(wanted: &Wanted) -> Result<String, DatasetError> {
    let (recipe, _) = Recipe::load(wanted.recipe)?;
    let Some(clips) = Clips::load(&recipe.real, Some(wanted.clips))? else {
        return Ok(String::new());
    };
    let model = match wanted.model {
        Some(model) => model.to_path_buf(),
        None => DetectorConfig::default().onnx_model,
    };
    // A model that cannot be used is told of before the work.
    OnnxDetector::load(&model, 1)?;
    let threads = threads(wanted.threads);
    let filmed: Vec<Filmed> = clips.filmed().collect();
    let made = in_parallel(&filmed, threads, |filmed| {
        let out = wanted.out.join(filmed.name());
        let of = Of::Clip {
            clip: filmed.name().into(),
            split: filmed.split.name().into(),
            model: model.clone(),
            rate_hz: wanted.rate_hz,
        };
        if of.is_whole(&out)? {
            return Ok::<_, DatasetError>(format!("{}: whole\n", out.display()));
        }
        let take = follow(filmed, &clips, &model, wanted.rate_hz)?;
        let count = take.write(&out, of)?;
        Ok(format!("{}: {count} sequences\n", out.display()))
    });
    match made {
        Ok(said) => Ok(said.concat()),
        Err(DatasetError::Stopped) => {
            let there = "clips that are whole stay; the same command goes on with the others";
            Ok(stop::said(there).unwrap_or_default())
        }
        Err(error) => Err(error),
    }
}

/// Detector and tracker over a clip, and what is gathered of its tracks.
fn follow(
    filmed: &Filmed,
    clips: &Clips,
    model: &Path,
    rate_hz: u32,
) -> Result<Take, DatasetError> {
    let mut model = OnnxDetector::load(model, 1)?;
    let threshold = model.score_threshold_video();
    let mut clip = clips.open(filmed)?;
    let objects = clips.objects(filmed)?;
    let mut take = Take::of(objects.clone());
    let mut at_work: Option<Follower> = None;
    let mut next_s = 1.0 / f64::from(rate_hz);
    for index in 0.. {
        let Some(frame) = clip.next_frame()? else {
            break;
        };
        if stop::asked().is_some() {
            return Err(DatasetError::Stopped);
        }
        let rgb8 = frame.picture.as_raw();
        let mut found: Vec<Detection> = Vec::new();
        model.detect(rgb8, frame.size_px(), &mut found)?;
        found.retain(|detection| detection.score >= weak_score(threshold));
        let follower = match &mut at_work {
            Some(follower) => follower,
            None => {
                let following = Following {
                    fov_deg: FOV_DEG,
                    centre_sigma_px: CENTRE_SIGMA_PX,
                    start_score: threshold,
                    neutral_score: model.score_neutral(),
                    recogniser: None,
                    uav_probability: 0.5,
                    keeps: true,
                };
                let rate_hz = clip.rate_hz();
                at_work.insert(Follower::new(
                    frame.size_px(),
                    rate_hz,
                    model.classes(),
                    &following,
                )?)
            }
        };
        follower.look(frame.t_s, rgb8, &found)?;
        let truth = (clips.boxes(filmed, &objects, index, &frame)?.into_iter())
            .map(|(object, box_px)| InFrame {
                object,
                box_px,
                range_m: None,
            })
            .collect();
        take.frames
            .push_back((follower.tick(), Tier::Coarse, truth));
        let kept_ticks = follower.ticks_of(KEPT_S);
        (take.frames).retain(|(tick, ..)| tick + kept_ticks > follower.tick());
        if frame.t_s + 1e-9 >= next_s {
            next_s += 1.0 / f64::from(rate_hz);
            for (track, sequence) in follower.sequences() {
                take.keep(track, &sequence, frame.t_s, false);
            }
        }
    }
    Ok(take)
}
