//! `tracks`: what the recogniser is given of the tracks of runs and of real clips, with what they truly are.
//!
//! A run is that of `run`, cameras, detector and tracker included; its tracks' last seconds are taken
//! from the very history that the recogniser looks at. Each scenario leaves a folder with `chips.npy`
//! (8-bit RGB, `[M, 24, 24, 3]`), `index.npy` (i32 `[N, 16]`: the chip of each step, -1 where the track
//! was not seen), `features.npy` (f32 `[N, 16, F]`) and `sequences.json`, which is written last: what
//! each of the N sequences is, and what made them.

mod clips;
mod take;

use super::DatasetError;
use super::kept::refuse_kept;
use crate::components::capture::UavInFrame;
use crate::components::detect::DetectionQueue;
use crate::components::flight::{Distractor, Uav};
use crate::components::mount::first_station;
use crate::components::run::SimClock;
use crate::components::track::{Gallery, Tracker};
use crate::models::tracking::recognition::TrackClass;
use crate::scenario::Scenario;
use crate::simulation::{Builder, Options};
use crate::stop;
use bevy::prelude::World;
use clap::Args;
use clips::Wanted;
use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use take::{InFrame, KEPT_S, Of, Take};

/// What `tracks` is told.
#[derive(Args, Debug)]
pub struct Arguments {
    /// Scenario files (TOML).
    #[arg(required_unless_present = "real", value_name = "SCENARIO")]
    scenarios: Vec<PathBuf>,
    /// Folder of clips of real cameras with their boxes.json, whose tracks are made, too.
    #[arg(long, value_name = "FOLDER", requires = "recipe")]
    real: Option<PathBuf>,
    /// Recipe whose table `real` says what the clips' labels are and which clips are for validation.
    #[arg(long, value_name = "RECIPE", requires = "real")]
    recipe: Option<PathBuf>,
    /// Detector for the clips (default: that of scenarios).
    #[arg(long, value_name = "ONNX", requires = "real")]
    model: Option<PathBuf>,
    /// Folder for the tracks, a folder in it for each scenario and seed; what is whole is kept.
    #[arg(long)]
    out: PathBuf,
    /// Change a value of the scenarios, such as `engage.authorised=false`; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE", requires = "scenarios")]
    set: Vec<String>,
    /// Seed instead of the scenarios'.
    #[arg(long, requires = "scenarios")]
    seed: Option<u64>,
    /// Times a second that every track is written [Hz].
    #[arg(long, default_value_t = 4)]
    rate_hz: u32,
    /// Worker threads (default: all cores); changes no sequence.
    #[arg(long)]
    threads: Option<usize>,
}

/// Makes the sequences of every scenario; what to tell the user.
pub fn tracks(arguments: &Arguments) -> Result<String, DatasetError> {
    let mut said = String::new();
    for path in &arguments.scenarios {
        let loaded = Scenario::load(path, &arguments.set)?;
        refuse_kept(&loaded)?;
        let seed = arguments.seed.unwrap_or(loaded.scenario.seed);
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let folder = arguments.out.join(format!("{stem}-{seed}"));
        let of = Of::Run {
            scenario: path.clone(),
            overrides: arguments.set.clone(),
            seed,
            rate_hz: arguments.rate_hz,
        };
        if of.is_whole(&folder)? {
            said += &format!("{}: whole\n", folder.display());
            continue;
        }
        let options = Options {
            seed: Some(seed),
            threads: arguments.threads,
            capture: true,
            ..Options::default()
        };
        let mut run = Builder::loaded(loaded).options(options).open()?;
        let mut galleries = run.world_mut().query::<(&mut Gallery, &Tracker)>();
        for (mut gallery, _) in galleries.iter_mut(run.world_mut()) {
            gallery.wanted = true;
        }
        let mut take = Take::of(objects(run.world_mut()));
        loop {
            let over = run.step(1)?;
            look(&mut take, run.world(), arguments.rate_hz);
            for (mut gallery, tracker) in galleries.iter_mut(run.world_mut()) {
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
        let count = take.write(&folder, of)?;
        said += &format!("{}: {count} sequences\n", folder.display());
    }
    if let (Some(clips), Some(recipe)) = (&arguments.real, &arguments.recipe) {
        said += &clips::tracks(&Wanted {
            clips,
            recipe,
            out: &arguments.out,
            model: arguments.model.as_deref(),
            rate_hz: arguments.rate_hz,
            threads: arguments.threads.and_then(NonZeroUsize::new),
        })?;
    }
    Ok(said)
}

/// Name and class of each UAV and distractor of a run, by its index.
fn objects(world: &mut World) -> BTreeMap<usize, (String, TrackClass)> {
    let mut flying = world.query::<(&Uav, Option<&Distractor>)>();
    (flying.iter(world))
        .map(|(uav, distractor)| {
            let class =
                distractor.map_or(TrackClass::Uav, |distractor| distractor.kind.class().into());
            (uav.index, (uav.name.clone(), class))
        })
        .collect()
}

/// What of the truth of a frame can be seen in it.
fn shown(truth: &[UavInFrame]) -> Vec<InFrame> {
    let in_frame = |seen: &UavInFrame| {
        let box_px = match &seen.rendered {
            Some(rendered) => rendered.box_px?,
            None => seen.clear.then_some(seen.box_px)?,
        };
        Some(InFrame {
            object: seen.uav,
            box_px,
            range_m: Some(seen.range_m),
        })
    };
    truth.iter().filter_map(in_frame).collect()
}

/// Looks at a run after a tick.
fn look(take: &mut Take, world: &World, rate_hz: u32) {
    let clock = world.resource::<SimClock>();
    let queue = first_station::<DetectionQueue>(world);
    for batch in queue.iter().flat_map(|queue| &queue.arrived) {
        let frame = &batch.frame;
        take.frames
            .push_back((frame.tick, frame.tier, shown(&frame.truth)));
    }
    if !clock.due(rate_hz) {
        return;
    }
    let kept_ticks = clock.ticks_of(KEPT_S);
    (take.frames).retain(|(tick, ..)| tick + kept_ticks > clock.tick);
    let (Some(tracker), Some(gallery)) = (
        first_station::<Tracker>(world),
        first_station::<Gallery>(world),
    ) else {
        return;
    };
    for track in &tracker.table.tracks {
        if let Some(sequence) = gallery.sequence(track, clock.t_s(), true) {
            let target = tracker.target == Some(track.id);
            take.keep(track, &sequence, clock.t_s(), target);
        }
    }
}
