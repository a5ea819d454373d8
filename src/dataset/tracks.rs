//! `tracks`: what the recogniser is given of the tracks of runs, with what they truly are.
//!
//! A run is that of `run`, cameras, detector and tracker included; its tracks' last seconds are taken
//! from the very history that the recogniser looks at. Each scenario leaves a folder with `chips.npy`
//! (8-bit RGB, `[M, 24, 24, 3]`), `index.npy` (i32 `[N, 16]`: the chip of each step, -1 where the track
//! was not seen), `features.npy` (f32 `[N, 16, F]`) and `sequences.json`, which is written last: what
//! each of the N sequences is, and what made them.

use super::DatasetError;
use crate::app::{self, Options};
use crate::components::capture::{Tier, UavInFrame};
use crate::components::detect::DetectionQueue;
use crate::components::flight::{Distractor, Uav};
use crate::components::mount::first_station;
use crate::components::run::{Seed, SimClock};
use crate::components::track::{Gallery, Tracker};
use crate::models::optics::chip::{CHIP_PX, Chip};
use crate::models::tracking::recognition::{FEATURES, STEPS, Sequence, Step, TrackClass};
use crate::models::tracking::table::Track;
use crate::output;
use crate::scenario::Scenario;
use crate::stop;
use bevy::prelude::World;
use clap::Args;
use glam::DVec2;
use serde::Serialize;
use std::collections::{BTreeMap, HashMap, VecDeque};
use std::path::{Path, PathBuf};

/// What `tracks` is told.
#[derive(Args, Debug)]
pub struct Arguments {
    /// Scenario files (TOML).
    #[arg(required = true, value_name = "SCENARIO")]
    scenarios: Vec<PathBuf>,
    /// Folder for the tracks, a folder in it for each scenario and seed; what is whole is kept.
    #[arg(long)]
    out: PathBuf,
    /// Change a value of the scenarios, such as `engage.authorised=false`; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Seed instead of the scenarios'.
    #[arg(long)]
    seed: Option<u64>,
    /// Times a second that every track is written [Hz].
    #[arg(long, default_value_t = 4)]
    rate_hz: u32,
    /// Worker threads (default: all cores); changes no sequence.
    #[arg(long)]
    threads: Option<usize>,
}

/// What a folder holds, as `sequences.json` has it.
#[derive(Serialize)]
struct Sheet {
    version: &'static str,
    scenario: PathBuf,
    overrides: Vec<String>,
    seed: u64,
    rate_hz: u32,
    features: Vec<&'static str>,
    chips: usize,
    sequences: Vec<Labelled>,
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

/// Makes the sequences of every scenario; what to tell the user.
pub fn tracks(arguments: &Arguments) -> Result<String, DatasetError> {
    let mut said = String::new();
    for path in &arguments.scenarios {
        let loaded = Scenario::load(path, &arguments.set)?;
        let seed = arguments.seed.unwrap_or(loaded.scenario.seed);
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let folder = arguments.out.join(format!("{stem}-{seed}"));
        if folder.join("sequences.json").exists() {
            said += &format!("{}: whole\n", folder.display());
            continue;
        }
        let options = Options {
            seed: Some(seed),
            threads: arguments.threads,
            capture: true,
            ..Options::default()
        };
        let mut app = app::build_with(&loaded, &options, |_| {})?;
        let mut galleries = app.world_mut().query::<(&mut Gallery, &Tracker)>();
        for (mut gallery, _) in galleries.iter_mut(app.world_mut()) {
            gallery.wanted = true;
        }
        let mut take = Take::new(app.world_mut());
        loop {
            let over = app::step(app.world_mut())?;
            take.tick(app.world(), arguments.rate_hz);
            for (mut gallery, tracker) in galleries.iter_mut(app.world_mut()) {
                gallery.tidy(&tracker.table);
            }
            if over {
                break;
            }
        }
        if let Some(stopped) =
            stop::said("folders that are whole stay; the same command goes on with the others")
        {
            return Ok(said + &stopped);
        }
        let sheet = Sheet {
            version: crate::VERSION,
            scenario: path.clone(),
            overrides: arguments.set.clone(),
            seed: app.world().resource::<Seed>().0,
            rate_hz: arguments.rate_hz,
            features: FEATURES.to_vec(),
            chips: take.chips.len(),
            sequences: std::mem::take(&mut take.labelled),
        };
        take.write(&folder, &sheet)?;
        said += &format!(
            "{}: {} sequences\n",
            folder.display(),
            sheet.sequences.len()
        );
    }
    Ok(said)
}

/// How long the truth of frames is kept [s]: the last second and what a batch may be late.
const KEPT_S: f64 = 3.0; // [s]
/// A detection's middle counts as on an object up to this far out of its box: this share of the box's
/// size, and so many pixels.
const OUTSIDE_SHARE: f64 = 0.25;
const OUTSIDE_PX: f64 = 3.0; // [px]
/// Share of a sequence's steps that must lie on one thing; what is more mixed is not written.
const PURE_SHARE: f64 = 0.7;

/// What is gathered in a run.
struct Take {
    /// Name and class of each UAV and distractor, by its index.
    objects: BTreeMap<usize, (String, TrackClass)>,
    /// Truth of the last frames: tick, camera, what was in front of it.
    frames: VecDeque<(u64, Tier, Vec<UavInFrame>)>,
    chips: Vec<Chip>,
    /// Where a chip, which is kept there and so keeps its address, stands.
    places: HashMap<*const u8, i32>,
    index: Vec<i32>,
    features: Vec<f32>,
    labelled: Vec<Labelled>,
}

impl Take {
    fn new(world: &mut World) -> Self {
        let mut objects = BTreeMap::new();
        let mut flying = world.query::<(&Uav, Option<&Distractor>)>();
        for (uav, distractor) in flying.iter(world) {
            let class =
                distractor.map_or(TrackClass::Uav, |distractor| distractor.kind.class().into());
            objects.insert(uav.index, (uav.name.clone(), class));
        }
        Self {
            objects,
            frames: VecDeque::new(),
            chips: Vec::new(),
            places: HashMap::new(),
            index: Vec::new(),
            features: Vec::new(),
            labelled: Vec::new(),
        }
    }

    /// Looks at the run after a tick.
    fn tick(&mut self, world: &World, rate_hz: u32) {
        let clock = world.resource::<SimClock>();
        let queue = first_station::<DetectionQueue>(world);
        for batch in queue.iter().flat_map(|queue| &queue.arrived) {
            let frame = &batch.frame;
            let known = (frame.tick, frame.tier, frame.truth.clone());
            self.frames.push_back(known);
        }
        if !clock.due(rate_hz) {
            return;
        }
        let kept_ticks = clock.ticks_of(KEPT_S);
        (self.frames).retain(|(tick, ..)| tick + kept_ticks > clock.tick);
        let (Some(tracker), Some(gallery)) = (
            first_station::<Tracker>(world),
            first_station::<Gallery>(world),
        ) else {
            return;
        };
        for track in &tracker.table.tracks {
            if let Some(sequence) = gallery.sequence(track, clock.t_s(), true) {
                let target = tracker.target == Some(track.id);
                self.keep(track, &sequence, clock.t_s(), target);
            }
        }
    }

    /// The object on which a step's detection lies, and how far away it is [m].
    fn object(&self, step: &Step) -> Option<(usize, f64)> {
        let glimpse = step.glimpses[0];
        let (.., truth) = self
            .frames
            .iter()
            .find(|(tick, tier, _)| *tick == glimpse.tick && *tier == glimpse.tier)?;
        let at = DVec2::from(glimpse.centre_px);
        let near = truth.iter().filter_map(|seen| {
            let shown = match &seen.rendered {
                Some(rendered) => rendered.box_px?,
                None => seen.clear.then_some(seen.box_px)?,
            };
            let [x0, y0, x1, y1] = shown;
            let middle = 0.5 * DVec2::new(x0 + x1, y0 + y1);
            let half = 0.5 * DVec2::new(x1 - x0, y1 - y0);
            let reach = half * (1.0 + 2.0 * OUTSIDE_SHARE) + DVec2::splat(OUTSIDE_PX);
            let off = (at - middle).abs();
            let on = off.x <= reach.x && off.y <= reach.y;
            on.then(|| (seen.uav, seen.range_m, (off / reach).length()))
        });
        near.min_by(|a, b| a.2.total_cmp(&b.2))
            .map(|(index, range_m, _)| (index, range_m))
    }

    /// Keeps a sequence whose steps lie on one thing.
    fn keep(&mut self, track: &Track, sequence: &Sequence, t_s: f64, target: bool) {
        let steps: Vec<&Step> = sequence.steps.iter().flatten().collect();
        let Some(newest) = steps.last().map(|step| step.glimpses[0]) else {
            return;
        };
        let on: Vec<Option<(usize, f64)>> = steps.iter().map(|step| self.object(step)).collect();
        let mut votes: BTreeMap<Option<usize>, usize> = BTreeMap::new();
        for object in &on {
            *votes.entry(object.map(|(index, _)| index)).or_default() += 1;
        }
        let Some((object, count)) = votes.into_iter().max_by_key(|(_, count)| *count) else {
            return;
        };
        let share = count as f64 / steps.len() as f64;
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
                .map(|(_, range_m)| *range_m),
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

    /// Writes all that was gathered; `sheet` last.
    fn write(&self, folder: &Path, sheet: &Sheet) -> Result<(), DatasetError> {
        output::create_dir(folder)?;
        let count = sheet.sequences.len();
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
        let text = serde_json::to_string(sheet)?;
        Ok(output::write(&folder.join("sequences.json"), text + "\n")?)
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
