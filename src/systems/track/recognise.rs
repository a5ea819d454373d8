//! What tracks are: the recogniser is shown their last seconds.

use crate::components::run::{Failure, SimClock};
use crate::components::track::{Gallery, Recogniser, Recognitions, Tracker};
use crate::inference::RecogniserError;
use crate::models::tracking::recognition::Recognition;
use crate::models::tracking::table::Track;
use bevy::prelude::*;

/// Asks the recogniser what the tracks are, and gives them the answers that have arrived.
pub fn recognise(
    clock: Res<SimClock>,
    mut stations: Query<(
        &mut Recogniser,
        &mut Recognitions,
        &mut Gallery,
        &mut Tracker,
    )>,
    mut failure: ResMut<Failure>,
) {
    for (mut recogniser, mut waiting, mut gallery, mut tracker) in &mut stations {
        let asked = ask(
            &clock,
            &mut recogniser,
            &mut waiting.0,
            &mut gallery,
            &mut tracker,
        );
        if let Err(error) = asked {
            failure.set(error);
        }
    }
}

/// Asks a station's recogniser, when it is time, and takes in its answers.
fn ask(
    clock: &SimClock,
    recogniser: &mut Recogniser,
    waiting: &mut Vec<(u64, u32, Recognition)>,
    gallery: &mut Gallery,
    tracker: &mut Tracker,
) -> Result<(), RecogniserError> {
    let Some(model) = &mut recogniser.model else {
        return Ok(());
    };
    if clock.due(recogniser.rate_hz) {
        gallery.tidy(&tracker.table);
        let most = recogniser.max_tracks;
        let at = (clock.t_s(), true);
        let (ids, seconds) = gallery.looked_at(&tracker.table, tracker.target, most, at);
        let found = model.recognise(&seconds, at.0)?;
        let arrives = clock.tick + recogniser.latency_ticks;
        let answers = ids.into_iter().zip(found);
        waiting.extend(answers.map(|(id, found)| (arrives, id, found)));
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
