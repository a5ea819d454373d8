//! What tracks are: the recogniser is shown their last seconds.

use crate::components::flight::{Distractor, Flight, Uav, UavShape};
use crate::components::mount::Mount;
use crate::components::run::{Failure, SimClock};
use crate::components::track::{
    Gallery, Judge, MeasuredRecogniser, Recogniser, Recognitions, Tracker,
};
use crate::inference::RecogniserError;
use crate::models::decision::gallery::in_turn;
use crate::models::maths::kinematics::az_el_to_los;
use crate::models::sensing::measured::Draws;
use crate::models::tracking::held::on_sight;
use crate::models::tracking::recognition::{Recognition, TrackClass};
use crate::models::tracking::table::Track;
use bevy::prelude::*;
use glam::DVec3;

/// What flies: the truth, of which only a measured recogniser knows.
type Thing = (
    &'static Uav,
    &'static Flight,
    &'static UavShape,
    Option<&'static Distractor>,
);

/// Asks the recogniser what the tracks are, and gives them the answers that have arrived.
pub fn recognise(
    clock: Res<SimClock>,
    things: Query<Thing>,
    mut stations: Query<(
        &Mount,
        &mut Recogniser,
        &mut Recognitions,
        &mut Gallery,
        &mut Tracker,
    )>,
    mut failure: ResMut<Failure>,
) {
    for (mount, mut recogniser, mut waiting, mut gallery, mut tracker) in &mut stations {
        let on = |track: &Track| thing_on(&things, mount.r_enu_m, track, clock.t_s());
        let asked = ask(
            &clock,
            &mut recogniser,
            &mut waiting.0,
            (&mut gallery, &mut tracker),
            on,
        );
        if let Err(error) = asked {
            failure.set(error);
        }
    }
}

/// What truly flies on a track's line of sight from a station, and its index; of several the nearest to it.
fn thing_on(
    things: &Query<Thing>,
    from_enu_m: DVec3,
    track: &Track,
    t_s: f64,
) -> Option<(usize, TrackClass)> {
    let sight = az_el_to_los(track.filter.predicted(t_s).az_el_rad());
    let things = things.iter().map(|(uav, flight, shape, other)| {
        let what = (uav.index, Distractor::class_of(other));
        (what, flight.aim_enu_m() - from_enu_m, shape.radius_m)
    });
    on_sight(things, sight)
}

impl MeasuredRecogniser {
    /// What it says at a time [s] of a track of something, or of scenery.
    pub fn says(
        &self,
        track: &Track,
        on: Option<(usize, TrackClass)>,
        (tick, t_s): (u64, f64),
    ) -> Recognition {
        /// Far from every thing's index: tracks of scenery err each for itself.
        const SCENERY: u64 = 1 << 40;
        let thing = on.map_or(SCENERY + u64::from(track.id), |(index, _)| index as u64);
        let draws = Draws::new(self.seed, thing, t_s, tick);
        let (class, size_px) = (on.map(|(_, kind)| kind), track.evidence.best_px());
        Recognition {
            probabilities: self.model.recognised(class, size_px, &draws),
            t_s,
        }
    }
}

/// Asks a station's recogniser, when it is time, and takes in its answers.
fn ask(
    clock: &SimClock,
    recogniser: &mut Recogniser,
    waiting: &mut Vec<(u64, u32, Recognition)>,
    (gallery, tracker): (&mut Gallery, &mut Tracker),
    on: impl Fn(&Track) -> Option<(usize, TrackClass)>,
) -> Result<(), RecogniserError> {
    let (rate_hz, most) = (recogniser.rate_hz, recogniser.max_tracks);
    let Some(judge) = &mut recogniser.judge else {
        return Ok(());
    };
    if clock.due(rate_hz) {
        let (table, t_s) = (&tracker.table, clock.t_s());
        gallery.tidy(table);
        let arrives = clock.tick + recogniser.latency_ticks;
        match judge {
            Judge::Network(model) => {
                let (ids, seconds) = gallery.looked_at(table, tracker.target, most, (t_s, true));
                let answers = ids.into_iter().zip(model.recognise(&seconds, t_s)?);
                waiting.extend(answers.map(|(id, found)| (arrives, id, found)));
            }
            Judge::Measured(model) => {
                let tracks = in_turn(table, tracker.target, t_s).into_iter().take(most);
                waiting.extend(tracks.map(|track| {
                    let says = model.says(track, on(track), (clock.tick, t_s));
                    (arrives, track.id, says)
                }));
            }
        }
    }
    waiting.retain(|(arrives, id, found)| {
        let here = *arrives <= clock.tick;
        // An answer about what was seen before something passed it comes too late.
        let still = |track: &&mut Track| track.passed_s.is_none_or(|passed_s| passed_s < found.t_s);
        if here && let Some(track) = tracker.table.get_mut(*id).filter(still) {
            track.recognition = Some(match track.recognition {
                Some(before) => found.after(&before),
                None => *found,
            });
        }
        !here
    });
    Ok(())
}
