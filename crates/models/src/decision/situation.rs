//! What the state machine looks at, and what it makes of the tracks.

use super::tasking::{Task, Tasking};
use super::tracker::{Tracker, TrackerParams};
use crate::engage::allocation::LOCKED_S;
use crate::engage::interlock::FAR_M;
use crate::engage::threat::time_to_asset_s;
use crate::ground::dsm::Dsm;
use crate::maths::kinematics::az_el_to_los;
use crate::optics::tier::Tier;
use crate::tracking::cartesian::TargetCue;
use crate::tracking::evidence::{logit, probability};
use crate::tracking::recognition::{CLASSES, Recognition, TrackClass};
use crate::tracking::search::{Sector, SlewLimits};
use crate::tracking::table::{JUDGED_HITS, Track, TrackTable, separation_rad};
use glam::{DVec2, DVec3};

/// Hits that confirm a target to the next camera.
pub const CONFIRM_HITS: u32 = 4;
/// How often tracks are judged, threats compared and occlusions foreseen [Hz].
pub const WEIGHING_HZ: u32 = 10;
/// Hits after which a search track may become the target.
const CANDIDATE_HITS: u32 = 6;
/// Log-odds from which on a track is chosen: four to one where its class can be named, less for one that
/// only a closer look can tell; and from which on one takes the place of a target that is held.
const CHOSEN: f64 = 1.5;
const CHOSEN_SMALL: f64 = -0.15;
const RIVAL: f64 = 4.0;
/// The same of such a one in clear sky, where there is little else to look at.
const CHOSEN_SMALL_IN_SKY: f64 = -0.6;
/// Share of the frames that must show it for that: a chain of false alarms is seen in fewer.
const SHOWN_SHARE: f64 = 0.5;
/// Sizes up to which only a closer look can tell what something is, and from which on none is needed [px].
const CLOSER_LOOK_PX: [f64; 2] = [8.0, 16.0];
/// Least rate on the sky that counts as flight [rad/s], and its least significance: scenery keeps
/// still, a flickering facade does not move far.
pub const MOVING_RADPS: f64 = 1.0e-3;
const MOVING_SIGMAS: f64 = 6.0;
/// How long a track must move to be a candidate in front of scenery, and to have flown for good [s].
const MOVED_S: f64 = 0.2;
const FLOWN_S: f64 = 0.5;
/// How long what stands still must do so to be learned as scenery [s].
const LEARNED_S: f64 = 0.8;
/// Faster across the sight line than any UAV of the catalogue flies [m/s], at the nearest it may be; and
/// what that says, a look.
const FASTEST_MPS: f64 = 70.0;
const TOO_FAST: f64 = -2.0;
/// Probability of a UAV by the recogniser, for what is seen well and for the smallest, or deviations from a radar's cue, for
/// which one that stands before scenery is taken for a hovering UAV.
const HOVER_PROBABILITY: f64 = 0.9;
const HOVER_SMALL: f64 = 0.5;
const HOVER_SIGMAS: f64 = 2.0;
/// Probability of a UAV by the recogniser, log-odds by the detector and length in the picture [px] from which on looks outweigh a
/// distance: what hovers beside a crown echoes from as far as the crown does.
const PLAIN_PROBABILITY: f64 = 0.95;
const PLAIN_LOG_ODDS: f64 = 4.0;
const PLAIN_PX: f64 = 24.0;
/// What never flew and is nearer to the city's surface behind it than this [m], or as little beyond it, is part of it: the
/// raster's cells and crowns err by some metres.
const SURFACE_M: f64 = 8.0;
/// Age up to which an echo is the last of a pulse train [s]: the range finder sends ten a second.
const NEW_ECHO_S: f64 = 0.25;
/// Clear sky that must lie below a candidate that does not move [rad].
const SKY_MARGIN_RAD: f64 = 4e-3;
/// A range less sure than this, over the range, comes from the size alone; the spans of the catalogue's UAVs
/// part from the one assumed by this, in the logarithm.
const MEASURED_REL: f64 = 0.3;
const SPANS_SIGMA_REL: f64 = 0.8;
/// What a radar's cue adds at most to the log-odds of a track at its place, and takes from one elsewhere; and what it adds to
/// those of one that has flown and flies as the radar's target does, at rates above so many deviations: by chance few do.
const CUE_FOR: f64 = 1.0;
const CUE_AGAINST: f64 = -3.0;
const CUE_FOR_FLYING: f64 = 2.0;
const FLYING_SIGMAS: f64 = 3.0;
/// A target's squared distance from the cue at which that says nothing: the mean of three Gaussian degrees
/// of freedom, doubled; and the mean of that of its two rates, below which they say nothing.
const CUE_NEUTRAL: f64 = 6.0;
const RATES_EXPECTED: f64 = 2.0;
/// The one that a target exceeds once in a thousand times: chi-squared of three degrees of freedom (direction and
/// range), and what its rates add.
const CUE_ELSEWHERE: f64 = 16.0;
/// Squared distance of a hovering UAV's rates from the radar's that is exceeded once in a hundred times.
const RATES_MOST: f64 = 9.2;

/// Time without a hit after which a camera of `rate_hz` [Hz] has lost the target [s]: a slow one may
/// miss a frame, as the faster ones may miss several.
pub fn patience_s(rate_hz: f64) -> f64 {
    const LEAST_S: f64 = 0.25; // [s]
    const FRAMES: f64 = 2.5;
    LEAST_S.max(FRAMES / rate_hz)
}

/// How much a track that the recogniser has judged and most frames show is so small that only a closer look can tell
/// what it is, 0 to 1.
pub(super) fn wants_closer_look(track: &Track) -> f64 {
    if track.recognition.is_some() && track.seen_share() > SHOWN_SHARE {
        let size_px = track.evidence.best_px();
        1.0 - ((size_px - CLOSER_LOOK_PX[0]) / (CLOSER_LOOK_PX[1] - CLOSER_LOOK_PX[0]))
            .clamp(0.0, 1.0)
    } else {
        0.0
    }
}

/// What flies along with a track: within this angle [rad], but not so few of its sizes away that it may be a part of it,
/// on a course of its own [rad/s], at rates that differ by no more than this share. It is told by so long a time [s].
const COMPANY_RAD: f64 = 0.05;
const COMPANY_SIZES: f64 = 2.0;
const COMPANY_RADPS: f64 = 3.0e-3;
const COMPANY_RATES: f64 = 0.2;
const COMPANY_S: f64 = 1.0;

/// How much oftener two that fly along are of a kind because of that than two of any kinds by chance.
const COMPANY_OF_A_KIND: f64 = 15.0;

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
fn company(flyer: &Flyer, flyers: &[Flyer]) -> f64 {
    let apart_rad = COMPANY_SIZES * flyer.size_rad..COMPANY_RAD;
    let along = flyers.iter().filter(|other| {
        other.id != flyer.id
            && apart_rad.contains(&separation_rad(other.az_el_rad, flyer.az_el_rad))
            && (other.rate_radps - flyer.rate_radps).length()
                < COMPANY_RATES * flyer.rate_radps.length()
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
    let share = probability((COMPANY_OF_A_KIND * of_a_kind / count).ln());
    f64::min(logit(alone + share * (along - alone)) - logit(alone), 0.0)
}

/// What the state machine looks at.
pub struct Situation<'a> {
    /// The tick.
    pub tick: u64,
    /// Ticks a second [Hz].
    pub tick_hz: u32,
    /// How the tracker works.
    pub params: &'a TrackerParams,
    /// The city's heights; `None` under an open sky.
    pub dsm: Option<&'a Dsm>,
    /// Where the station is [m].
    pub r_station_enu_m: DVec3,
    /// Where the target of the defence is, or the radar's.
    pub cue: Option<TargetCue>,
    /// The radar alone says where that is: the defence knows it from the station's own cameras, too.
    pub by_radar: bool,
    /// Where the mount points, azimuth and elevation [rad], and how fast it turns; `None` where nothing turns.
    pub mount: Option<(DVec2, SlewLimits)>,
    /// What the defence wants of this station, if it is one of several.
    pub tasking: Option<&'a Tasking>,
    /// Where an operator has the station search by hand: it takes up nothing elsewhere.
    pub within: Option<Sector>,
}

/// Whether a track looks so much like a UAV, and is seen so well, that where it stands says nothing against it.
fn is_plainly_uav(track: &Track) -> bool {
    let found = |found: Recognition| found.p_uav() >= PLAIN_PROBABILITY;
    track.found().is_some_and(found)
        && track.evidence.log_odds() >= PLAIN_LOG_ODDS
        && track.evidence.best_px() >= PLAIN_PX
}

/// Whether a track has been looked at closely and is more likely no UAV: as a target it has no more right than any other.
pub(super) fn is_unlikely(track: &Track) -> bool {
    track.hits[Tier::Precise] >= CONFIRM_HITS
        && track.recognition.is_some()
        && track.log_odds() < 0.0
}

impl Situation<'_> {
    /// Duration of so many ticks [s].
    pub fn at_s(&self, ticks: u64) -> f64 {
        ticks as f64 / f64::from(self.tick_hz)
    }

    pub(super) fn t_s(&self) -> f64 {
        self.at_s(self.tick)
    }

    /// The object that the station is to follow.
    pub(super) fn task(&self) -> Option<&Task> {
        self.tasking?.task.as_ref()
    }

    /// Whether a track is to be left to others.
    pub(super) fn spares(&self, id: u32) -> bool {
        (self.tasking).is_some_and(|tasking| tasking.spared.contains(&id))
    }

    /// Time without news of a hit of the target by a camera [s].
    fn silent_s(&self, tracker: &Tracker, tier: Tier) -> f64 {
        tracker.error[tier].map_or(f64::INFINITY, |error| {
            self.at_s(self.tick - error.available_tick)
        })
    }

    /// Whether a camera has had no news of the target for so long that it has lost it.
    pub(super) fn lost_by(&self, tracker: &Tracker, tier: Tier) -> bool {
        self.silent_s(tracker, tier) > self.params.patience_s[tier]
    }

    /// Whether a track was seen so lately by any camera that it may still be there.
    pub(super) fn fresh(&self, track: &Track) -> bool {
        let longest_s = self
            .params
            .patience_s
            .each()
            .into_iter()
            .fold(0.0, f64::max);
        self.t_s() - track.seen_s() <= longest_s
    }

    /// Speed with which a track loses height [m/s].
    pub(super) fn sink_mps(&self, track: &Track) -> f64 {
        track
            .position_enu(self.r_station_enu_m, self.t_s())
            .map_or(0.0, |(_, v_enu_mps)| -v_enu_mps.z)
    }

    /// Time that a track needs to reach the asset [s].
    pub(super) fn threat_s(&self, track: &Track) -> f64 {
        track
            .position_enu(self.r_station_enu_m, self.t_s())
            .map_or(f64::INFINITY, |(r_enu_m, v_enu_mps)| {
                time_to_asset_s(r_enu_m, v_enu_mps, self.params.r_asset_enu_m)
            })
    }

    /// Whether there is clear sky behind a direction and some way below it.
    fn in_sky(&self, az_el_rad: DVec2) -> bool {
        let below = az_el_rad - DVec2::new(0.0, SKY_MARGIN_RAD);
        self.dsm.map_or(self.params.open_sky, |dsm| {
            dsm.first_hit(self.r_station_enu_m, az_el_to_los(below), FAR_M)
                .is_none()
        })
    }

    /// Judges the conduct of every track that is seen, over the `elapsed_s` since the last time; what
    /// stands still without being taken for a UAV is learned as scenery.
    pub(super) fn weigh(&self, table: &mut TrackTable, elapsed_s: f64) {
        let t_s = self.t_s();
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
            let says = flyer.map_or(0.0, |flyer| company(flyer, &flyers));
            track.conduct.company +=
                (1.0 - (-elapsed_s / COMPANY_S).exp()) * (says - track.conduct.company);
            let at = track.filter.predicted(t_s).az_el_rad();
            let (rate_radps, sigmas) = track.motion(t_s);
            let significant = sigmas > MOVING_SIGMAS;
            let nearest_m = track.range.nearest_m(t_s).unwrap_or(0.0);
            if significant && rate_radps * nearest_m > FASTEST_MPS {
                track.evidence.on_conduct(TOO_FAST, elapsed_s);
            }
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
            conduct.flown |= conduct.moving_s >= FLOWN_S;
            // A UAV may hover in the sky; before a wood or a wall what never flew is part of it.
            let part_of_it = !conduct.in_sky || doubted;
            if !conduct.flown && conduct.still_s >= LEARNED_S && part_of_it {
                conduct.in_scenery = true;
                scenery.learn(at, t_s);
            } else if conduct.in_sky && !doubted {
                conduct.in_scenery = false;
            }
        }
    }

    /// A track that the recogniser has judged and that flies.
    fn flyer(&self, track: &Track) -> Option<Flyer> {
        let (rate_radps, _) = track.rates(self.t_s());
        let flies = self.fresh(track) && rate_radps.length() > COMPANY_RADPS;
        Some(Flyer {
            id: track.id,
            az_el_rad: track.filter.predicted(self.t_s()).az_el_rad(),
            size_rad: track.size_rad,
            rate_radps,
            found: track.recognised().filter(|_| flies)?,
        })
    }

    /// What the radar's cue says for a track, as log-odds.
    fn cue_log_odds(&self, track: &Track) -> f64 {
        self.cue.map_or(0.0, |cue| {
            let distance2 = self.cue_distance2(&cue, track);
            (0.5 * (CUE_NEUTRAL - distance2)).clamp(CUE_AGAINST, CUE_FOR)
        })
    }

    /// What the radar adds to the log-odds of a track that has flown and flies as its target does: enough for a close look, no
    /// word on fire.
    pub(super) fn flying_log_odds(&self, track: &Track) -> f64 {
        let flies = |cue: &TargetCue| {
            cue.rate_radps.length() > FLYING_SIGMAS * cue.rate_sigma_radps.max_element()
        };
        let both_fly = track.conduct.flown && self.cue.as_ref().is_some_and(flies);
        if self.by_radar && both_fly && self.cued(track) {
            CUE_FOR_FLYING
        } else {
            0.0
        }
    }

    /// All that the radar says for a track that is no target yet, as log-odds.
    pub(super) fn pointed_log_odds(&self, track: &Track) -> f64 {
        self.cue_log_odds(track) + self.flying_log_odds(track)
    }

    /// What the radar says of a target for fire, as log-odds. It speaks for one that it has where the range finder's last
    /// echo came from, and sees fly alike: a bird that is there by chance flies its own way. It speaks against one from which
    /// the echo came from another range.
    pub(super) fn vouches(&self, track: &Track) -> f64 {
        match self.is_ranged_elsewhere(track) {
            Some(true) => CUE_AGAINST,
            Some(false) if self.cued(track) => self.cue_log_odds(track).max(0.0),
            _ => 0.0,
        }
    }

    /// Squared distance of a track from the radar's target, in deviations: of direction, range and, as far as
    /// they differ more than noise, rates.
    fn cue_distance2(&self, cue: &TargetCue, track: &Track) -> f64 {
        let los = track.filter.predicted(self.t_s());
        let apart_rad = separation_rad(los.az_el_rad(), cue.az_el_rad);
        let direction = apart_rad
            / cue
                .sigma_rad
                .max_element()
                .hypot(los.sigma_rad().max_element());
        let range = self.range_deviations(cue, track);
        let rates = (self.rates_distance2(cue, track) - RATES_EXPECTED).max(0.0);
        direction * direction + range * range + rates
    }

    /// How much further a track is than the radar's target, in deviations.
    fn range_deviations(&self, cue: &TargetCue, track: &Track) -> f64 {
        let range = track.range.range_m(self.t_s());
        range.map_or(0.0, |(range_m, sigma_m)| {
            let sigma_rel = sigma_m / range_m;
            let sigma_rel = if sigma_rel > MEASURED_REL {
                sigma_rel.max(SPANS_SIGMA_REL)
            } else {
                sigma_rel
            };
            let sigma = sigma_rel.hypot(cue.range_sigma_m / cue.range_m);
            (range_m / cue.range_m).ln() / sigma
        })
    }

    /// Squared distance of a track's rates on the sky from those that the radar sees, in deviations.
    fn rates_distance2(&self, cue: &TargetCue, track: &Track) -> f64 {
        let (rate_radps, sigma_radps) = track.rates(self.t_s());
        let variance = sigma_radps * sigma_radps + cue.rate_sigma_radps * cue.rate_sigma_radps;
        let off_radps = rate_radps - cue.rate_radps;
        (off_radps * off_radps / variance).element_sum()
    }

    /// Log-odds from which on a track is chosen.
    fn chosen(&self, track: &Track) -> f64 {
        let small = if track.conduct.in_sky {
            CHOSEN_SMALL_IN_SKY
        } else {
            CHOSEN_SMALL
        };
        CHOSEN - (CHOSEN - small) * wants_closer_look(track)
    }

    /// The most threatening track beside the target that looks like a UAV, each threat weighed with how
    /// likely it is one.
    pub(super) fn candidate<'t>(&self, tracker: &'t Tracker) -> Option<&'t Track> {
        let tracks = tracker.table.tracks.iter();
        tracks
            .filter(|track| Some(track.id) != tracker.target && self.may_be_target(track))
            .filter(|track| !self.spares(track.id))
            .filter_map(|track| {
                // Beside a target the radar's cue, which may be the target's own, says nothing.
                let (cue, least) = match tracker.target_track().filter(|t| !is_unlikely(t)) {
                    // One that is itself in doubt gives way to what would be chosen.
                    Some(target) if target.log_odds() < CHOSEN => (0.0, CHOSEN),
                    Some(_) => (0.0, RIVAL),
                    None => (self.pointed_log_odds(track), self.chosen(track)),
                };
                let log_odds = track.log_odds() + cue;
                if log_odds < least {
                    return None;
                }
                // The defence has weighed the threats.
                let tasked = self.task().is_some_and(|task| task.track == Some(track.id));
                let cost = self.cost(track, log_odds);
                Some((if tasked { 0.0 } else { cost }, track))
            })
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.id.cmp(&b.1.id)))
            .map(|(_, track)| track)
    }

    /// The tracks that would be targets if the present one were dealt with, the most pressing first.
    pub(super) fn queue(&self, tracker: &Tracker) -> Vec<u32> {
        let tracks = tracker.table.tracks.iter();
        let mut waiting: Vec<(f64, u32)> = tracks
            .filter(|track| Some(track.id) != tracker.target && self.may_be_target(track))
            .filter(|track| !self.spares(track.id) && track.log_odds() >= self.chosen(track))
            .map(|track| (self.cost(track, track.log_odds()), track.id))
            .collect();
        waiting.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        waiting.into_iter().map(|(_, id)| id).collect()
    }

    /// What taking a track for a target costs, as [`crate::models::engage::allocation`] has it [s²].
    fn cost(&self, track: &Track, log_odds: f64) -> f64 {
        let at = track.filter.predicted(self.t_s()).az_el_rad();
        let slew_s = self.mount.map_or(0.0, |(points_rad, slew)| {
            slew.slew_s(separation_rad(at, points_rad))
        });
        self.expected_s(track, log_odds) * (slew_s + LOCKED_S)
    }

    /// Time that a track needs to reach the asset over its probability of being a UAV [s].
    pub(super) fn expected_s(&self, track: &Track, log_odds: f64) -> f64 {
        self.threat_s(track) * (1.0 + (-log_odds).exp())
    }

    /// Whether a track has been seen long enough, and moves, stands in clear sky or may hover.
    pub fn may_be_target(&self, track: &Track) -> bool {
        let conduct = &track.conduct;
        let here = |area: &Sector| area.contains(track.filter.predicted(self.t_s()).az_el_rad());
        self.within.as_ref().is_none_or(here)
            && track.total_hits() >= CANDIDATE_HITS
            && !track.is_barred(self.t_s())
            && (track.misses == 0 || self.fresh(track))
            && (self.may_hover(track)
                || !conduct.is_scenery()
                    && (conduct.in_sky || conduct.flown || conduct.moving_s >= MOVED_S))
    }

    /// Whether a track may be a UAV though it stands before scenery: the recogniser is sure, or it
    /// looks like one where the radar has its target.
    fn may_hover(&self, track: &Track) -> bool {
        let least =
            HOVER_PROBABILITY - (HOVER_PROBABILITY - HOVER_SMALL) * wants_closer_look(track);
        let sure = |found: Recognition| found.p_uav() > least;
        let by_radar = || track.log_odds() + self.cue_log_odds(track) > CHOSEN;
        track.found().is_some_and(sure) || self.cued(track) && by_radar()
    }

    /// Whether the radar has its target where a track is, and sees it fly alike.
    pub(super) fn cued(&self, track: &Track) -> bool {
        let at = track.filter.predicted(self.t_s()).az_el_rad();
        self.cue.is_some_and(|cue| {
            separation_rad(at, cue.az_el_rad) < HOVER_SIGMAS * cue.sigma_rad.max_element()
                && self.rates_distance2(&cue, track) < RATES_MOST
        })
    }

    /// Whether a target has nothing that speaks for a UAV any more but having been chosen: it stands before
    /// scenery, the recogniser is no longer sure, and no radar points at it; or it merely looks like one, and the
    /// radar follows its target elsewhere.
    pub(super) fn is_mere_scenery(&self, track: &Track) -> bool {
        let may_hover = self.may_hover(track) || self.cued(track);
        track.conduct.is_scenery() && (self.elsewhere(track) || !may_hover)
    }

    /// Why a track is no UAV by the range finder: it is too large, or stands where the city's surface is behind it.
    pub(super) fn disproof(&self, track: &Track) -> Option<String> {
        let span_m = track.measured_span_m(self.t_s())?;
        if span_m > self.params.max_span_m {
            let reason = format!("too large for a UAV: {span_m:.1} m by the range finder");
            return Some(reason);
        }
        let part = track.conduct.is_scenery()
            && !self.cued(track)
            && !is_plainly_uav(track)
            && self.is_on_surface(track);
        part.then(|| "no further off than what stands behind it, by the range finder".into())
    }

    /// Whether a new echo of the range finder from a track comes from where the city's surface is, behind it or at its lower
    /// edge.
    fn is_on_surface(&self, track: &Track) -> bool {
        let t_s = self.t_s();
        let at = track.filter.predicted(t_s).az_el_rad();
        let edge = at - DVec2::new(0.0, 0.5 * track.size_rad);
        let behind_m = |az_el_rad: DVec2| {
            let los = az_el_to_los(az_el_rad);
            (self.dsm?).first_hit(self.r_station_enu_m, los, FAR_M)
        };
        (track.echo(t_s))
            .filter(|echo| t_s - echo.t_s < NEW_ECHO_S)
            .is_some_and(|echo| {
                let near_m = SURFACE_M + 3.0 * echo.sigma_m;
                [at, edge]
                    .into_iter()
                    .filter_map(behind_m)
                    .any(|range_m| (range_m - echo.range_m).abs() < near_m)
            })
    }

    /// Whether the radar's target is surely another: in another direction, at another range, or in flight.
    fn elsewhere(&self, track: &Track) -> bool {
        self.cue
            .is_some_and(|cue| self.cue_distance2(&cue, track) > CUE_ELSEWHERE)
    }

    /// Whether the range finder has a track at another range than the radar's target; `None` without an echo or a radar.
    pub(super) fn is_ranged_elsewhere(&self, track: &Track) -> Option<bool> {
        let cue = self.cue.filter(|_| self.by_radar)?;
        track.echo(self.t_s())?;
        Some(self.range_deviations(&cue, track).powi(2) > CUE_ELSEWHERE)
    }

    /// Why a track may be a UAV.
    pub(super) fn reason(&self, track: &Track) -> String {
        let (rate_radps, _) = track.motion(self.t_s());
        let belief = format!(
            "{:.0} % a UAV, seen in {:.0} % of its frames",
            100.0 * track.uav_belief(),
            100.0 * track.filter.quality()
        );
        if track.conduct.moving_s > 0.0 {
            format!("moves at {:.1} mrad/s, {belief}", 1e3 * rate_radps)
        } else if track.conduct.in_sky {
            format!("stands in clear sky, {belief}")
        } else {
            format!("seems to hover, {belief}")
        }
    }
}
