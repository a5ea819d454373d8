//! How tracks behave, and in what company.

use super::situation::Situation;
use super::tuning::TrackerTuning;
use crate::engage::interlock::FAR_M;
use crate::maths::kinematics::az_el_to_los;
use crate::tracking::evidence::{logit, probability};
use crate::tracking::recognition::{CLASSES, Recognition, TrackClass};
use crate::tracking::table::{JUDGED_HITS, Track, TrackTable, separation_rad};
use glam::DVec2;

/// A track that flies, as those see it that fly along with it.
struct Flyer {
    id: u32,
    az_el_rad: DVec2,
    size_rad: f64,
    rate_radps: DVec2,
    found: Recognition,
}

/// What those say of a flyer that fly along with it, as log-odds, 0 or less. Either it is of their kind, or it is there by chance:
/// what it looks like itself tells how likely the one is, and the other.
fn company(flyer: &Flyer, flyers: &[Flyer], tuning: &TrackerTuning) -> f64 {
    let apart_rad = tuning.company_sizes * flyer.size_rad..tuning.company_rad;
    let along = flyers.iter().filter(|other| {
        other.id != flyer.id
            && apart_rad.contains(&separation_rad(other.az_el_rad, flyer.az_el_rad))
            && (other.rate_radps - flyer.rate_radps).length()
                < tuning.company_rates * flyer.rate_radps.length()
    });
    let (mut count, mut both) = (0.0, [0.0; CLASSES]);
    for other in along {
        count += 1.0;
        for (kind, both) in both.iter_mut().enumerate() {
            *both += flyer.found.probabilities[kind] * other.found.probabilities[kind];
        }
    }
    let of_a_kind: f64 = both.iter().sum();
    if count == 0.0 || of_a_kind <= 0.0 {
        return 0.0;
    }
    let alone = flyer.found.p_uav();
    let along = both[TrackClass::Uav as usize] / of_a_kind;
    let share = probability((tuning.company_of_a_kind * of_a_kind / count).ln());
    f64::min(logit(alone + share * (along - alone)) - logit(alone), 0.0)
}

impl Situation<'_> {
    /// Judges the conduct of every track that is seen, over the `elapsed_s` since the last time; what
    /// stands still without being taken for a UAV is learned as scenery.
    pub(super) fn weigh(&self, table: &mut TrackTable, elapsed_s: f64) {
        let (t_s, tuning) = (self.t_s(), self.tuning());
        let TrackTable {
            tracks, scenery, ..
        } = table;
        let flyers: Vec<Flyer> = tracks
            .iter()
            .filter_map(|track| self.flyer(track))
            .collect();
        for track in tracks {
            if track.total_hits() < JUDGED_HITS || track.hidden(t_s) || !self.fresh(track) {
                continue;
            }
            let flyer = flyers.iter().find(|flyer| flyer.id == track.id);
            let says = flyer.map_or(0.0, |flyer| company(flyer, &flyers, tuning));
            track.conduct.company +=
                (1.0 - (-elapsed_s / tuning.company_s).exp()) * (says - track.conduct.company);
            let at = track.filter.predicted(t_s).az_el_rad();
            let (rate_radps, sigmas) = track.motion(t_s);
            let significant = sigmas > tuning.moving_sigmas;
            let doubted = track.log_odds() < 0.0;
            let conduct = &mut track.conduct;
            conduct.in_sky = self.in_sky(at);
            if significant && rate_radps > self.params.moving_radps {
                conduct.moving_s += elapsed_s;
                conduct.still_s = 0.0;
            } else {
                conduct.moving_s = (conduct.moving_s - elapsed_s).max(0.0);
                conduct.still_s += elapsed_s;
            }
            conduct.flown |= conduct.moving_s >= tuning.flown_s;
            // A UAV may hover in the sky; before a wood or a wall what never flew is part of it.
            let part_of_it = !conduct.in_sky || doubted;
            if !conduct.flown && conduct.still_s >= tuning.learned_s && part_of_it {
                conduct.in_scenery = true;
                scenery.learn(at, t_s);
            } else if conduct.in_sky && !doubted {
                conduct.in_scenery = false;
            }
        }
    }

    /// Whether there is clear sky behind a direction and some way below it.
    fn in_sky(&self, az_el_rad: DVec2) -> bool {
        let below = az_el_rad - DVec2::new(0.0, self.tuning().sky_margin_rad);
        self.dsm.map_or(self.params.open_sky, |dsm| {
            dsm.first_hit(self.r_station_enu_m, az_el_to_los(below), FAR_M)
                .is_none()
        })
    }

    /// A track that the recogniser has judged and that flies.
    fn flyer(&self, track: &Track) -> Option<Flyer> {
        let (rate_radps, _) = track.rates(self.t_s());
        let flies = self.fresh(track) && rate_radps.length() > self.tuning().company_radps;
        Some(Flyer {
            id: track.id,
            az_el_rad: track.filter.predicted(self.t_s()).az_el_rad(),
            size_rad: track.size_rad,
            rate_radps,
            found: track.recognised().filter(|_| flies)?,
        })
    }
}
