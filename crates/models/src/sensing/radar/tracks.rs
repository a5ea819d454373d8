//! Which plots are one thing's: the radar's own tracker.
//!
//! Plots go to tracks by the least sum of squared distances within a gate (global nearest neighbour); what is left starts a
//! track. One is confirmed by so many plots in so many looks, and dropped where too few come (M of N; S. Blackman and R. Popoli,
//! "Design and Analysis of Modern Tracking Systems", 1999, sec. 6.2).

use super::{Plot, RadarTrack};
use crate::maths::assignment::{Pair, assign};
use std::collections::BTreeMap;

/// Squared distance within which a plot may be a track's: 99.9 % of three degrees of freedom.
const GATE: f64 = 16.3;
/// Plots that confirm a track, of the looks since its first. Chosen: false plots hardly ever do, a UAV of nine detections in ten
/// does after three looks in three of four cases.
const CONFIRMED: u32 = 3;
const CONFIRMED_LOOKS: u32 = 4;
/// Looks in a row without a plot that end a confirmed track. Chosen.
const MOST_MISSES: u32 = 4;

/// A track that the radar keeps.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Kept {
    track: RadarTrack,
    plots: u32,
    looks: u32,
    misses: u32,
    confirmed: bool,
}

/// All tracks of a radar; a number is never used again.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RadarTracks {
    kept: BTreeMap<usize, Kept>,
    next: usize,
}

impl RadarTracks {
    /// The confirmed tracks with their numbers.
    pub fn iter(&self) -> impl Iterator<Item = (usize, &RadarTrack)> {
        let confirmed = self.kept.iter().filter(|(_, kept)| kept.confirmed);
        confirmed.map(|(number, kept)| (*number, &kept.track))
    }

    /// A confirmed track.
    pub fn get(&self, number: usize) -> Option<&RadarTrack> {
        let kept = self.kept.get(&number).filter(|kept| kept.confirmed);
        kept.map(|kept| &kept.track)
    }

    /// Takes in the plots of one look.
    pub fn take(&mut self, plots: &[Plot]) {
        let mut pairs = Vec::new();
        for (row, kept) in self.kept.values().enumerate() {
            for (column, plot) in plots.iter().enumerate() {
                let cost = kept.track.distance2(plot) - GATE;
                if cost < 0.0 {
                    pairs.push(Pair { row, column, cost });
                }
            }
        }
        let chosen = assign(self.kept.len(), plots.len(), &pairs);
        let mut free = vec![true; plots.len()];
        for (kept, column) in self.kept.values_mut().zip(chosen) {
            kept.looks += 1;
            match column {
                Some(column) => {
                    kept.track.update(&plots[column]);
                    free[column] = false;
                    kept.plots += 1;
                    kept.misses = 0;
                    kept.confirmed |= kept.plots >= CONFIRMED;
                }
                None => kept.misses += 1,
            }
        }
        self.kept.retain(|_, kept| match kept.confirmed {
            true => kept.misses < MOST_MISSES,
            false => kept.looks < CONFIRMED_LOOKS,
        });
        for (plot, _) in plots.iter().zip(free).filter(|(_, free)| *free) {
            let kept = Kept {
                track: RadarTrack::start(plot),
                plots: 1,
                looks: 1,
                misses: 0,
                confirmed: false,
            };
            self.kept.insert(self.next, kept);
            self.next += 1;
        }
    }

    /// Takes in plots of which the radar is told whose they are; a track without a plot ends.
    pub fn take_known(&mut self, plots: &[(usize, Plot)]) {
        (self.kept).retain(|number, _| plots.iter().any(|(known, _)| known == number));
        for (number, plot) in plots {
            match self.kept.get_mut(number) {
                Some(kept) => kept.track.update(plot),
                None => {
                    let kept = Kept {
                        track: RadarTrack::start(plot),
                        plots: 1,
                        looks: 1,
                        misses: 0,
                        confirmed: true,
                    };
                    self.kept.insert(*number, kept);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::sensing::tests::{radar, uav};
    use super::*;
    use crate::maths::rng::Stream;
    use glam::DVec3;

    #[test]
    fn one_that_flies_is_one_track_and_noise_is_hardly_ever() {
        let radar = radar();
        let (mut confirmed_by_noise, mut numbers) = (0, Vec::new());
        for seed in 0..40 {
            let mut rng = Stream::new(seed, 0, "test");
            let mut tracks = RadarTracks::default();
            for look in 0..40 {
                let t_s = 0.5 * f64::from(look);
                let echo = uav(DVec3::new(100.0, 900.0 - 5.0 * t_s, 60.0));
                tracks.take(&radar.look(t_s, &[echo], &mut rng));
                let at = |track: &RadarTrack| track.motion_enu(t_s).0.distance(echo.r_enu_m);
                let near = |(_, track): &(usize, &RadarTrack)| at(track) < 60.0;
                numbers.extend(tracks.iter().filter(near).map(|(number, _)| (seed, number)));
                confirmed_by_noise += tracks.iter().filter(|found| !near(found)).count();
            }
        }
        numbers.sort_unstable();
        let seen = numbers.len();
        numbers.dedup();
        assert!(seen > 40 * 34, "tracked in {seen} looks of {}", 40 * 40);
        assert!(numbers.len() < 48, "{} tracks of 40 flights", numbers.len());
        assert!(confirmed_by_noise < 20, "{confirmed_by_noise}");
    }
}
