//! The track table: sightings of all cameras become tracks with one identity each.

use crate::models::estimation::{Gating, LosFilter, LosFilterParams, LosState};
use glam::DVec2;

/// A detection as a direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// Azimuth and elevation [rad].
    pub az_el_rad: DVec2,
    /// Standard deviation on the sky [rad].
    pub sigma_rad: f64,
    /// Larger side of the box [rad].
    pub size_rad: f64,
    /// Confidence of the detector.
    pub score: f64,
}

/// What one frame saw.
pub struct Look<'a> {
    /// Index of the camera, 0 (wide) to 2 (narrow).
    pub tier: usize,
    /// Time of the exposure [s].
    pub t_s: f64,
    /// The detections.
    pub sightings: &'a [Sighting],
    /// Whether a direction (azimuth, elevation) lay in the pixels that were read out.
    pub in_view: &'a dyn Fn(DVec2) -> bool,
    /// Whether sightings that fit no track start new ones.
    pub start_tracks: bool,
}

/// One object that is followed.
#[derive(Clone, Debug)]
pub struct Track {
    /// Identity; never used again.
    pub id: u32,
    /// Estimate of its line of sight.
    pub filter: LosFilter,
    /// Frames of each camera that saw it.
    pub hits: [u32; 3],
    /// Frames in a row that should have seen it and did not.
    pub misses: u32,
    /// Time of the last exposure of each camera that saw it [s].
    pub last_hit_s: [Option<f64>; 3],
    /// Larger side of its box [rad], smoothed.
    pub size_rad: f64,
}

impl Track {
    /// Hits of all cameras.
    pub fn total_hits(&self) -> u32 {
        self.hits.iter().sum()
    }

    /// Rate on the sky [rad/s] and how many standard deviations it differs from zero.
    pub fn motion(&self, t_s: f64) -> (f64, f64) {
        let los = self.filter.predicted(t_s);
        let cos_el = los.el_rad.cos();
        let rate = DVec2::new(los.az_rate_radps * cos_el, los.el_rate_radps);
        let sigma = DVec2::new(
            los.covariance[0][(1, 1)].sqrt() * cos_el,
            los.covariance[1][(1, 1)].sqrt(),
        );
        (rate.length(), (rate / sigma).length())
    }
}

/// Settings of the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TableParams {
    /// Filter of every track.
    pub filter: LosFilterParams,
    /// A sighting belongs to no track that is further away than this many standard deviations.
    pub gate_sigmas: f64,
    /// A track goes after this many misses in a row, or as many as it has hits if that is less.
    pub max_misses: u32,
    /// A track that no camera looked at goes after this time [s].
    pub max_coast_s: f64,
    /// Tracks kept; the ones with the fewest hits go first.
    pub max_tracks: usize,
}

impl Default for TableParams {
    fn default() -> Self {
        Self {
            filter: LosFilterParams::default(),
            gate_sigmas: 4.0,
            max_misses: 30,
            max_coast_s: 3.0, // [s]
            max_tracks: 64,
        }
    }
}

/// All tracks, oldest first.
#[derive(Clone, Debug, Default)]
pub struct TrackTable {
    /// Settings.
    pub params: TableParams,
    /// The tracks.
    pub tracks: Vec<Track>,
    next_id: u32,
}

/// Great-circle distance of two nearby directions [rad].
pub fn separation_rad(a: DVec2, b: DVec2) -> f64 {
    let d = crate::models::kinematics::wrap_pi(a.x - b.x) * (0.5 * (a.y + b.y)).cos();
    d.hypot(a.y - b.y)
}

impl TrackTable {
    /// The track of an identity.
    pub fn get(&self, id: u32) -> Option<&Track> {
        self.tracks.iter().find(|track| track.id == id)
    }

    /// Takes a frame in: nearest pairs of track and sighting first, each used once; what is left
    /// over starts a track or counts as a miss. Returns for each sighting the track it went to.
    pub fn update(&mut self, look: &Look) -> Vec<Option<u32>> {
        let mut assigned = vec![None; look.sightings.len()];
        let predicted: Vec<LosState> = self
            .tracks
            .iter()
            .map(|track| track.filter.predicted(look.t_s))
            .collect();
        let mut pairs = Vec::new();
        for (t, los) in predicted.iter().enumerate() {
            let spread = los.sigma_rad().max_element();
            for (s, sighting) in look.sightings.iter().enumerate() {
                let sigma = spread.hypot(sighting.sigma_rad);
                let distance = separation_rad(los.az_el_rad(), sighting.az_el_rad) / sigma;
                if distance < self.params.gate_sigmas {
                    pairs.push((distance, t, s));
                }
            }
        }
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)).then(a.2.cmp(&b.2)));
        let mut hit = vec![false; self.tracks.len()];
        for (_, t, s) in pairs {
            if hit[t] || assigned[s].is_some() {
                continue;
            }
            let (track, sighting) = (&mut self.tracks[t], &look.sightings[s]);
            let gating = track
                .filter
                .update(sighting.az_el_rad, sighting.sigma_rad, look.t_s);
            if matches!(gating, Gating::Accepted { .. }) {
                hit[t] = true;
                assigned[s] = Some(track.id);
                track.hits[look.tier] += 1;
                track.last_hit_s[look.tier] = Some(look.t_s);
                track.misses = 0;
                track.size_rad += 0.2 * (sighting.size_rad - track.size_rad);
            }
        }
        for (t, los) in predicted.iter().enumerate() {
            if !hit[t] && (look.in_view)(los.az_el_rad()) {
                self.tracks[t].misses += 1;
                self.tracks[t].filter.miss(look.t_s);
            }
        }
        let TableParams {
            max_misses,
            max_coast_s,
            max_tracks,
            ..
        } = self.params;
        self.tracks.retain(|track| {
            track.misses <= max_misses.min(track.total_hits())
                && track.filter.coast_s(look.t_s) < max_coast_s
        });
        if look.start_tracks {
            for (s, sighting) in look.sightings.iter().enumerate() {
                if assigned[s].is_none() {
                    assigned[s] = self.start(look, sighting);
                }
            }
            while self.tracks.len() > max_tracks {
                let Some(weakest) = (0..self.tracks.len())
                    .min_by_key(|i| (self.tracks[*i].total_hits(), self.tracks[*i].id))
                else {
                    break;
                };
                self.tracks.remove(weakest);
            }
        }
        assigned
    }

    fn start(&mut self, look: &Look, sighting: &Sighting) -> Option<u32> {
        let Sighting {
            az_el_rad,
            sigma_rad,
            size_rad,
            ..
        } = *sighting;
        let filter = LosFilter::start(self.params.filter, az_el_rad, sigma_rad, look.t_s).ok()?;
        let id = self.next_id;
        self.next_id += 1;
        let mut track = Track {
            id,
            filter,
            hits: [0; 3],
            misses: 0,
            last_hit_s: [None; 3],
            size_rad,
        };
        track.hits[look.tier] = 1;
        track.last_hit_s[look.tier] = Some(look.t_s);
        self.tracks.push(track);
        Some(id)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::rng::Stream;

    fn sighting(az: f64, el: f64) -> Sighting {
        Sighting {
            az_el_rad: DVec2::new(az, el),
            sigma_rad: 3e-5,
            size_rad: 3e-4,
            score: 0.9,
        }
    }

    fn look<'a>(t_s: f64, sightings: &'a [Sighting]) -> Look<'a> {
        Look {
            tier: 0,
            t_s,
            sightings,
            in_view: &|_| true,
            start_tracks: true,
        }
    }

    #[test]
    fn two_targets_that_cross_keep_their_identities() {
        let mut table = TrackTable::default();
        let mut rng = Stream::new(1, 0, "test");
        let mut noise = || 3e-5 * rng.normal();
        let at = |t: f64| [(0.008 * (t - 1.0), 1e-4), (-0.008 * (t - 1.0), -1e-4)];
        for i in 0..=120 {
            let t = f64::from(i) / 60.0;
            let seen = at(t).map(|(az, el)| sighting(az + noise(), el + noise()));
            table.update(&look(t, &seen));
        }
        assert_eq!(table.tracks.len(), 2);
        for (track, (az, _)) in table.tracks.iter().zip(at(2.0)) {
            let los = track.filter.predicted(2.0);
            assert!((los.az_rad - az).abs() < 2e-4, "{} {az}", los.az_rad);
        }
    }

    #[test]
    fn a_flicker_does_not_last() {
        let mut table = TrackTable::default();
        table.update(&look(0.0, &[sighting(0.1, 0.1)]));
        for i in 1..4 {
            table.update(&look(f64::from(i) / 30.0, &[]));
        }
        assert!(table.tracks.is_empty());
    }

    #[test]
    fn motion_is_significant_only_for_what_moves() {
        let mut table = TrackTable::default();
        let mut rng = Stream::new(2, 0, "test");
        for i in 0..20 {
            let t = f64::from(i) / 30.0;
            let mut noise = || 3e-5 * rng.normal();
            let seen = [
                sighting(noise(), noise()),
                sighting(0.1 + 0.008 * t + noise(), noise()),
            ];
            table.update(&look(t, &seen));
        }
        let (still, moving) = (table.tracks[0].motion(0.6), table.tracks[1].motion(0.6));
        assert!(still.1 < 5.0, "{still:?}");
        assert!(
            moving.1 > 10.0 && (moving.0 - 0.008).abs() < 0.002,
            "{moving:?}"
        );
    }
}
