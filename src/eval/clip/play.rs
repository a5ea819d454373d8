//! A clip played to its end: detector and tracker on every frame, and what is gathered of them.

use super::arguments::Arguments;
use super::draw::{draw, inset};
use super::figures::{ClipFigures, Tally, TrackFigures, inside};
use super::follow::{Followed, Follower, Following};
use super::truth::{BoxFile, FrameTruth};
use crate::eval::EvalError;
use crate::eval::detector::metrics::{AnnotatedImage, Truth};
use crate::eval::shared::progress;
use crate::inference::OnnxDetector;
use crate::media::image::jpeg_of;
use crate::media::video::{Clip, ClipFrame, Writer};
use crate::models::optics::detection::Detection;
use crate::models::tracking::table::JoinedTrack;
use crate::output;
use crate::output::put;
use crate::report::chart::Series;
use crate::scenario::DetectorConfig;
use crate::stop;
use glam::DVec2;
use image::RgbImage;
use std::collections::{BTreeMap, BTreeSet, btree_map::Entry};
use std::fmt::Write as _;
use std::path::Path;
use std::time::{Duration, Instant};

/// Length of a held target's way that is drawn [s].
const TRAIL_S: f64 = 2.0;
/// Pictures of the contact sheet.
pub(super) const SHEET: usize = 24;

/// A clip that has been played.
pub(super) struct Played {
    pub(super) clip: ClipFigures,
    pub(super) tally: Tally,
    pub(super) curves: Curves,
    /// Time of the last frame [s].
    pub(super) end_s: f64,
    pub(super) sheet: Vec<Sheet>,
}

/// What is drawn over time.
#[derive(Default)]
pub(super) struct Curves {
    /// Miss distance of detector and tracker [px].
    pub(super) miss_px: [Series; 2],
    /// Best score on a UAV (without truth: anywhere), and elsewhere.
    pub(super) score: [Series; 2],
}

/// A picture of the contact sheet.
pub(super) struct Sheet {
    pub(super) t_s: f64,
    /// Index of the frame.
    pub(super) frame: usize,
    pub(super) caption: String,
    pub(super) jpeg: Vec<u8>,
}

/// What is gathered of a track while it lasts.
#[derive(Clone, Copy)]
struct Life {
    start_s: f64,
    end_s: f64,
    frames: usize,
    on_uav: usize,
    /// Frames in a region to ignore, which speak neither for it nor against it.
    ignored: usize,
    last: Followed,
}

/// A frame, and what detector and tracker make of it.
struct Moment {
    index: usize,
    t_s: f64,
    boxes: FrameTruth,
    /// Detections of any score, most confident first.
    found: Vec<Detection>,
    /// Number of those that count.
    sure: usize,
    followed: Vec<Followed>,
    /// Identity of the target that is held.
    held: Option<u32>,
}

impl Moment {
    /// The detections that count.
    fn sure(&self) -> &[Detection] {
        &self.found[..self.sure]
    }

    /// The target that is held, if it is in view.
    fn target(&self) -> Option<&Followed> {
        (self.followed.iter()).find(|track| Some(track.id) == self.held)
    }

    fn box_at(&self, px: DVec2, ignored: bool) -> Option<&Truth> {
        (self.boxes.uavs.iter()).find(|truth| truth.ignored == ignored && inside(truth.box_px, px))
    }

    /// The UAV's box in which a place lies.
    fn uav_at(&self, px: DVec2) -> Option<&Truth> {
        self.box_at(px, false)
    }

    /// Whether a place lies neither in a UAV's box nor in a region to ignore.
    fn is_elsewhere(&self, px: DVec2) -> bool {
        self.uav_at(px).is_none() && self.box_at(px, true).is_none()
    }

    /// The best score of the detections whose place is wanted; not a number without any.
    fn best(&self, wanted: impl Fn(DVec2) -> bool) -> f64 {
        let mut found = self.found.iter();
        let best = found.find(|found| wanted(found.centre_px().into()));
        best.map_or(f64::NAN, |best| best.score)
    }

    /// What the picture of the contact sheet enlarges: the target, else a UAV, else the best detection.
    fn of_interest(&self) -> Option<DVec2> {
        (self.target().map(|target| target.px))
            .or_else(|| Some(self.boxes.uavs.first()?.centre_px().into()))
            .or_else(|| Some(self.sure().first()?.centre_px().into()))
    }
}

/// What is gathered over a clip.
struct Notes {
    tally: Tally,
    curves: Curves,
    images: Vec<AnnotatedImage>,
    lives: BTreeMap<u32, Life>,
    /// Where the target was held, since it is held without a gap [px].
    trail: Vec<DVec2>,
    /// Text of `tracks.txt`.
    lines: String,
    /// What boxes are called.
    labels: BTreeSet<String>,
    sheet: Vec<Sheet>,
}

/// Plays a clip; writes its overlay and its tracks into `folder`.
pub(super) fn play(
    model: &mut OnnxDetector,
    file: &Path,
    name: &str,
    truth: Option<&BoxFile>,
    arguments: &Arguments,
    folder: &Path,
) -> Result<Played, EvalError> {
    let mut clip = Clip::open(file, arguments.rate_hz)?;
    let (count, rate_hz) = (clip.frames(), clip.rate_hz());
    output::create_dir(folder)?;
    let mut notes = Notes::new(truth.is_some(), count);
    let mut at_work: Option<(Follower, Writer)> = None;
    let (mut size_px, mut end_s) = ([0, 0], 0.0);
    let mut shown = Instant::now();
    for index in 0..count {
        let started = Instant::now();
        let Some(mut frame) = clip.next_frame()? else {
            break;
        };
        notes.tally.busy += started.elapsed();
        (size_px, end_s) = (frame.size_px(), frame.t_s);
        let (follower, writer) = match &mut at_work {
            Some(at_work) => at_work,
            None => {
                // Memory is set up at the first picture of a size.
                model.detect(frame.picture.as_raw(), size_px, &mut Vec::new())?;
                let overlay = folder.join("overlay.mp4");
                at_work.insert((
                    Follower::new(
                        size_px,
                        rate_hz,
                        model.classes(),
                        &following(arguments, model.score_neutral()),
                    )?,
                    Writer::create(&overlay, size_px, rate_hz)?,
                ))
            }
        };
        let started = Instant::now();
        let mut moment = look(model, follower, arguments, index, &frame)?;
        notes.tally.busy += started.elapsed();
        if let Some(truth) = truth {
            moment.boxes = truth.of(file, index, &frame)?;
        }
        notes.take(&moment, follower.joined());
        notes.recognised(&moment, arguments.recogniser.is_some());
        notes.draw(&mut frame.picture, &moment, (TRAIL_S * rate_hz) as usize);
        writer.push(&frame.picture)?;
        if on_sheet(index, count) {
            notes.sheet.push(Sheet::of(frame.picture, &moment)?);
        }
        moment.found.truncate(moment.sure);
        notes.images.push(AnnotatedImage {
            truth: moment.boxes.uavs,
            found: moment.found,
        });
        if shown.elapsed() > Duration::from_secs(2) || index + 1 == count {
            shown = Instant::now();
            progress(&format!("{name}: {} of {count} frames", index + 1));
        }
        if stop::asked().is_some() {
            break;
        }
    }
    let mut states = Vec::new();
    if let Some((follower, writer)) = at_work {
        writer.finish(rate_hz)?;
        states = follower.into_states();
    }
    put(&folder.join("tracks.txt"), &notes.lines)?;
    let clip = ClipFigures {
        file: file.into(),
        size_px,
        rate_hz,
        labels: BTreeSet::new(),
        figures: Tally::default().figures(),
        tracks: Vec::new(),
        states,
    };
    Ok(notes.conclude(clip, end_s))
}

/// Detects and follows in a frame; its truth is not known yet.
fn look(
    model: &mut OnnxDetector,
    follower: &mut Follower,
    arguments: &Arguments,
    index: usize,
    frame: &ClipFrame,
) -> Result<Moment, EvalError> {
    let mut found = Vec::new();
    model.detect(frame.picture.as_raw(), frame.size_px(), &mut found)?;
    let weak_score = weak_score(arguments.threshold.unwrap_or(0.0));
    let tracked: Vec<Detection> = (found.iter().copied())
        .filter(|detection| detection.score >= weak_score)
        .collect();
    let followed = follower.look(frame.t_s, frame.picture.as_raw(), &tracked)?;
    found.retain(|detection| model.is_uav(detection.label));
    let sure = found.partition_point(|d| Some(d.score) >= arguments.threshold);
    Ok(Moment {
        index,
        t_s: frame.t_s,
        boxes: FrameTruth::default(),
        found,
        sure,
        followed,
        held: follower.held(),
    })
}

/// Least score of what the tracker gets, which starts tracks from `threshold` on: that of a run.
pub fn weak_score(threshold: f64) -> f64 {
    DetectorConfig::default().weak_share * threshold
}

/// What the tracker is told.
fn following(arguments: &Arguments, neutral_score: f64) -> Following {
    Following {
        fov_deg: arguments.fov_deg,
        centre_sigma_px: arguments.centre_sigma_px,
        start_score: arguments.threshold.unwrap_or(0.0),
        neutral_score,
        recogniser: arguments.recogniser.clone(),
        uav_probability: arguments.uav_probability,
        keeps: false,
    }
}

/// Whether a frame is shown on the contact sheet, whose pictures are spread evenly over the clip: it is the
/// one in the middle of its share.
fn on_sheet(index: usize, count: usize) -> bool {
    let shares = SHEET.min(count);
    (0..shares).any(|k| (2 * k + 1) * count / (2 * shares) == index)
}

impl Notes {
    fn new(known: bool, count: usize) -> Self {
        Self {
            tally: Tally {
                known,
                ..Tally::default()
            },
            curves: Curves::default(),
            images: Vec::with_capacity(count),
            lives: BTreeMap::new(),
            trail: Vec::new(),
            lines: String::new(),
            labels: BTreeSet::new(),
            sheet: Vec::new(),
        }
    }

    /// Takes in a frame; `joined` are identities of young tracks, and of the old ones that they are.
    fn take(&mut self, moment: &Moment, joined: &[JoinedTrack]) {
        self.labels.extend(moment.boxes.labels.iter().cloned());
        self.scores(moment);
        self.join(joined);
        self.tracks(moment);
        self.target(moment);
    }

    fn scores(&mut self, moment: &Moment) {
        let known = self.tally.known;
        let [on_uav, elsewhere] = &mut self.curves.score;
        let best = moment.best(|px| !known || moment.uav_at(px).is_some());
        on_uav.push((moment.t_s, best));
        if known {
            elsewhere.push((moment.t_s, moment.best(|px| moment.is_elsewhere(px))));
        }
    }

    fn join(&mut self, joined: &[JoinedTrack]) {
        for JoinedTrack { young, old } in joined {
            let Some(young) = self.lives.remove(young) else {
                continue;
            };
            match self.lives.entry(*old) {
                Entry::Vacant(entry) => {
                    entry.insert(young);
                }
                Entry::Occupied(entry) => {
                    let life = entry.into_mut();
                    life.start_s = life.start_s.min(young.start_s);
                    life.frames += young.frames;
                    life.on_uav += young.on_uav;
                    life.ignored += young.ignored;
                }
            }
        }
    }

    fn tracks(&mut self, moment: &Moment) {
        for track in &moment.followed {
            let life = self.lives.entry(track.id).or_insert(Life {
                start_s: moment.t_s,
                end_s: moment.t_s,
                frames: 0,
                on_uav: 0,
                ignored: 0,
                last: *track,
            });
            let on_uav = moment.uav_at(track.px).is_some();
            life.end_s = moment.t_s;
            life.frames += 1;
            life.on_uav += usize::from(on_uav);
            life.ignored += usize::from(!on_uav && !moment.is_elsewhere(track.px));
            life.last = *track;
            mot_line(&mut self.lines, moment.index, track);
        }
    }

    fn target(&mut self, moment: &Moment) {
        let tally = &mut self.tally;
        let target = moment.target();
        let hit = target.and_then(|target| Some((target, moment.uav_at(target.px)?)));
        let has_uav = moment.boxes.uavs.iter().any(|truth| !truth.ignored);
        tally.locked += usize::from(target.is_some());
        tally.with_uav += usize::from(has_uav);
        tally.on_target += usize::from(hit.is_some());
        let elsewhere = target.is_some_and(|target| moment.is_elsewhere(target.px));
        tally.false_lock += usize::from(elsewhere);
        let miss_px = hit.map(|(target, truth)| target.px.distance(truth.centre_px().into()));
        tally.tracker_px.extend(miss_px);
        self.curves.miss_px[1].push((moment.t_s, miss_px.unwrap_or(f64::NAN)));
        match target {
            Some(target) => self.trail.push(target.px),
            None => self.trail.clear(),
        }
    }

    /// Counts the tracks that are held as UAVs, if there is a recogniser that says so.
    fn recognised(&mut self, moment: &Moment, is_there: bool) {
        self.tally.recognised = is_there;
        let mut seen = [false; 3];
        for track in moment.followed.iter().filter(|track| track.as_uav) {
            seen[0] = true;
            seen[1] |= moment.uav_at(track.px).is_some();
            seen[2] |= moment.is_elsewhere(track.px);
        }
        for (count, seen) in self.tally.as_uav.iter_mut().zip(seen) {
            *count += usize::from(seen);
        }
    }

    /// Draws a frame's boxes, detections and tracks, and the way of the target over the last `frames`.
    fn draw(&self, picture: &mut RgbImage, moment: &Moment, frames: usize) {
        let recent = self.trail.len().saturating_sub(frames);
        draw(
            picture,
            &moment.boxes,
            moment.sure(),
            &moment.followed,
            moment.held,
            &self.trail[recent..],
        );
    }

    /// Sums up: the figures and tracks of `clip`.
    fn conclude(self, clip: ClipFigures, end_s: f64) -> Played {
        let Self {
            mut tally,
            mut curves,
            images,
            lives,
            labels,
            sheet,
            ..
        } = self;
        tally.frames = images.len();
        tally.detections = images.iter().map(|image| image.found.len()).sum();
        curves.miss_px[0] = tally.judge(&images, &curves.miss_px[1]);
        let tracks = lives.into_iter();
        Played {
            clip: ClipFigures {
                labels,
                figures: tally.figures(),
                tracks: tracks
                    .map(|(id, life)| life.figures(id, tally.known))
                    .collect(),
                ..clip
            },
            tally,
            curves,
            end_s,
            sheet,
        }
    }
}

impl Life {
    fn figures(&self, id: u32, known: bool) -> TrackFigures {
        TrackFigures {
            id,
            start: self.start_s,
            end: self.end_s,
            length: self.end_s - self.start_s,
            frames: self.frames,
            score: self.last.score,
            size_px: self.last.side_px,
            on_uav_share: (known && self.frames > self.ignored)
                .then(|| self.on_uav as f64 / (self.frames - self.ignored) as f64),
        }
    }
}

impl Sheet {
    fn of(mut picture: RgbImage, moment: &Moment) -> Result<Self, EvalError> {
        if let Some(px) = moment.of_interest() {
            inset(&mut picture, px);
        }
        let found = moment.sure();
        let best = found.first().map_or("no detection".into(), |best| {
            format!("{} detections, best {:.2}", found.len(), best.score)
        });
        let target = moment.target();
        let target = target.map_or("no target".into(), |t| format!("track {}", t.id));
        Ok(Self {
            t_s: moment.t_s,
            frame: moment.index,
            caption: format!("{best}, {target}"),
            jpeg: jpeg_of(&picture, 80)?,
        })
    }
}

/// A line in MOTChallenge's form: frame and identity from 1, left, top, width, height, score.
fn mot_line(out: &mut String, index: usize, track: &Followed) {
    let half = 0.5 * track.side_px;
    let DVec2 { x, y } = track.px;
    let [x0, y0, x1, y1] = (track.seen_px).unwrap_or([x - half, y - half, x + half, y + half]);
    // Writing to a string cannot fail.
    let _ = writeln!(
        out,
        "{},{},{x0:.3},{y0:.3},{:.3},{:.3},{:.4},-1,-1,-1",
        index + 1,
        track.id + 1,
        x1 - x0,
        y1 - y0,
        track.score
    );
}
