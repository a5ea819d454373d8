//! The search: gazes over the sector or about the radar's cue, ever closer where nothing was found.

use crate::components::capture::Tier;
use crate::components::control::{Glance, Glanced, Pass, SearchScan};
use crate::components::mount::Gimbal;
use crate::components::run::SimClock;
use crate::components::track::Tracker;
use crate::models::tracking::cartesian::TargetCue;
use crate::models::tracking::search::{Gaze, SearchPattern, Sector};
use crate::models::tracking::table::{JUDGED_HITS, Track, separation_rad};
use glam::DVec2;

/// A gaze begins when the mount is this close to it [rad], a fiftieth of the search camera's field,
/// and moves with it but for this [rad/s]: below half a pixel in a 5 ms exposure, and the rest of it dies within 0.1 s.
const SETTLED_RAD: f64 = 2e-3;
const SETTLED_RADPS: f64 = 15e-3;
/// Least duration of a gaze [s], and least number of frames in it. A candidate needs 6 hits
/// (`systems::track`): 15 frames leave room for misses, and within half a second
/// a rate of 1 mrad/s stands six deviations out of the noise of 0.5 px of the search camera.
const GAZE_S: f64 = 0.5;
const GAZE_FRAMES: f64 = 15.0;
/// Share of a gaze after which it is left where no track lives in it but known scenery: nine frames, and those in which the
/// mount comes to rest, so that what moves shows (`models::sensing::moving`).
const EMPTY_SHARE: f64 = 0.6;
/// How long a gaze lasts at most while something in it looks like a target [s].
const LONGEST_GAZE_S: f64 = 2.0;
/// Log-odds that make a track worth a longer gaze: even, or less for what the recogniser has judged, of which a dot may
/// still be chosen, and less again for what a finer camera shows by now: the recogniser's second is still full of dots.
const PROMISING: f64 = 0.0;
const PROMISING_JUDGED: f64 = -0.6;
const PROMISING_CLOSE: f64 = GLANCED;
/// Probability by the recogniser that makes it worth one wherever it stands: a UAV that hovers before scenery is
/// only chosen once the recogniser is sure.
const PROMISING_PROBABILITY: f64 = 0.5;
/// Share of the field by which neighbouring gazes overlap: a target at the edge of one is whole in
/// the next, up to 25 px of 640; a larger one shows all the same.
const OVERLAP: f64 = 0.04;
/// Share of the field by which the mount may be off a gaze that a plot has moved before it begins anew.
const FOLLOW_FIELDS: f64 = 0.25;
/// A pass with a finer camera, in whose field a target is larger, is made where so many gazes cover the area:
/// as a rule about a radar's cue. It goes outward from the middle, in gazes of so many frames, and reads about as
/// many a second as the search camera [Hz].
const MOST_CLOSER_GAZES: usize = 20;
const CLOSER_FRAMES: f64 = 10.0;
const CLOSER_HZ: f64 = 30.0;

/// A glance: what a gaze showed is turned to, so that the finer cameras show what it is, for so long after the mount
/// has come to rest on it [s], or so long while it looks like a target [s], so long while the recogniser, whose second must
/// first fill with it, finds it more likely a UAV than not [s], and so long in all at most [s].
const GLANCE_S: f64 = 0.25;
const LONGEST_GLANCE_S: f64 = 1.0;
const LIKELY_GLANCE_S: f64 = 2.0;
const GLANCE_TIMEOUT_S: f64 = 2.5;
/// Least log-odds of what is glanced at, and before scenery the least share of its frames that show it: a chain of false
/// alarms is seen in fewer.
const GLANCED: f64 = -2.0;
const GLANCED_SHARE: f64 = 0.6;
/// Without a cue, what stands before scenery must move besides, this fast [rad/s] and surely [standard deviations], or be a UAV
/// with this probability by the recogniser, or without its word with these log-odds by the evidence: the networks box much of a
/// wood that stands still.
const GLANCED_RADPS: f64 = 1e-3;
const GLANCED_SIGMAS: f64 = 2.0;
const GLANCED_PROBABILITY: f64 = 0.25;
const GLANCED_EVIDENCE: f64 = 0.0;
/// Most glances a gaze; what stands within this of one [rad] is not glanced at again for so long [s].
const MOST_GLANCES: usize = 2;
const GLANCED_RAD: f64 = 2e-3;
const GLANCED_FOR_S: f64 = 10.0;

/// Of how many of its exposures a camera of `frame_s` [s] a frame reads one in its pass.
pub(super) fn every_in_pass(tier: Tier, frame_s: f64) -> u64 {
    match tier {
        Tier::Search => 1,
        Tier::Coarse | Tier::Precise => (1.0 / (CLOSER_HZ * frame_s)).round().max(1.0) as u64,
    }
}

impl SearchScan {
    /// A scan with cameras of these tiers, fields (horizontal, vertical) [rad] and times from frame to frame [s],
    /// wide to narrow, one at least; with a cue it begins about it.
    pub fn new(
        pattern: SearchPattern,
        sector: Sector,
        cameras: &[(Tier, [f64; 2], f64)],
        cue: Option<TargetCue>,
    ) -> Self {
        let passes = cameras.iter().enumerate();
        let passes = passes.map(|(index, (tier, field_rad, frame_s))| {
            let read_s = frame_s * every_in_pass(*tier, *frame_s) as f64;
            Pass {
                tier: *tier,
                field_rad: *field_rad,
                gaze_s: match index {
                    0 => GAZE_S.max(GAZE_FRAMES * read_s),
                    _ => CLOSER_FRAMES * read_s,
                },
            }
        });
        let mut scan = Self {
            pattern,
            sector,
            passes: passes.collect(),
            pass: 0,
            area: sector,
            area_s: 0.0,
            drift_radps: DVec2::ZERO,
            cued: false,
            slew_rad: None,
            offsets_rad: Vec::new(),
            between: false,
            index: 0,
            settled_since: None,
            glance: None,
            glanced: Vec::new(),
        };
        scan.follow(cue, 0.0);
        scan.begin(0, false);
        scan
    }

    /// Whether it looks with a camera now: that of the present pass, or in a glance with every finer one than the first.
    pub fn looks_with(&self, tier: Tier) -> bool {
        match self.glance {
            Some(_) => self.passes[1..].iter().any(|pass| pass.tier == tier),
            None => self.passes[self.pass].tier == tier,
        }
    }

    /// The present gaze at `t_s` [s].
    pub fn gaze(&self, t_s: f64) -> Gaze {
        let centre = DVec2::new(self.area.centre_azimuth_rad, self.area.centre_elevation_rad);
        Gaze {
            az_el_rad: centre
                + self.drift_radps * (t_s - self.area_s)
                + self.offsets_rad[self.index],
            rates_radps: self.drift_radps,
        }
    }

    /// How long a gaze of the present pass lasts where nothing is promising [s].
    pub fn gaze_s(&self) -> f64 {
        self.passes[self.pass].gaze_s
    }

    /// How long one lasts in which no track lives but known scenery [s].
    pub fn empty_gaze_s(&self) -> f64 {
        match self.pass {
            0 => EMPTY_SHARE * self.gaze_s(),
            _ => self.gaze_s(),
        }
    }

    /// Gazes of a pass over the area, from its centre [rad]. Every second pass of the first camera over a large one looks
    /// between the gazes of the one before: the coarse camera, in the middle of the field, sees there what that missed.
    fn laid_out(&self, pass: usize) -> Vec<DVec2> {
        let centre = DVec2::new(self.area.centre_azimuth_rad, self.area.centre_elevation_rad);
        let pattern = match (pass, self.pattern) {
            (1.., SearchPattern::Raster) => SearchPattern::Spiral,
            (_, pattern) => pattern,
        };
        let gazes = pattern.gazes(&self.area, self.passes[pass].field_rad, OVERLAP);
        let gazes: Vec<DVec2> = gazes
            .into_iter()
            .map(|gaze| DVec2::from(gaze) - centre)
            .collect();
        if pass == 0 && self.between && pattern == SearchPattern::Raster {
            between(&gazes)
        } else {
            gazes
        }
    }

    /// One field of the first pass about a direction (azimuth, elevation) [rad].
    pub fn about(&self, az_el_rad: DVec2) -> Sector {
        // That is two deviations to either side of it.
        Sector::about(az_el_rad, DVec2::from(self.passes[0].field_rad) / 4.0)
    }

    /// Takes an operator's word where the area is, in place of the radar's, and begins there; without one the
    /// radar's counts again.
    pub(super) fn slew(&mut self, slew_rad: Option<DVec2>, cue: Option<TargetCue>, t_s: f64) {
        if self.slew_rad != slew_rad {
            self.slew_rad = slew_rad;
            self.follow(cue.filter(|_| slew_rad.is_none()), t_s);
            self.begin(0, false);
        }
    }

    /// Takes the radar's word where the area is and how it moves. The gazes of a pass move with it; they begin
    /// anew where the radar finds a target, or loses it.
    fn follow(&mut self, cue: Option<TargetCue>, t_s: f64) {
        // Two deviations to either side of the cue, or the sector.
        self.area = cue.map_or(self.sector, |cue| {
            let about = Sector::about(cue.az_el_rad, cue.sigma_rad);
            Sector {
                width_rad: about.width_rad.min(self.sector.width_rad),
                height_rad: about.height_rad.min(self.sector.height_rad),
                ..about
            }
        });
        if let Some(slew_rad) = self.slew_rad {
            self.area = self.about(slew_rad);
        }
        self.area_s = t_s;
        self.drift_radps = cue.map_or(DVec2::ZERO, |cue| {
            cue.rate_radps / DVec2::new(cue.az_el_rad.y.cos().max(0.1), 1.0)
        });
        if cue.is_some() != self.cued {
            self.cued = cue.is_some();
            self.begin(0, false);
        }
    }

    /// Begins a pass, or one between its gazes.
    fn begin(&mut self, pass: usize, between: bool) {
        self.glance = None;
        self.between = between;
        self.pass = pass;
        self.offsets_rad = self.laid_out(pass);
        self.index = 0;
        self.settled_since = None;
    }

    /// Goes on to the next gaze; after the last of a pass to the next finer camera, whose pass takes in less of
    /// the area at a time, and back to the search camera.
    fn advance(&mut self) {
        self.settled_since = None;
        // A gaze that was cut short begins anew.
        if self.glance.take().is_some_and(|glance| glance.cut_short) {
            return;
        }
        self.index += 1;
        if self.index < self.offsets_rad.len() {
            return;
        }
        let next = self.pass + 1;
        let closer = next < self.passes.len() && self.laid_out(next).len() <= MOST_CLOSER_GAZES;
        if closer {
            self.begin(next, false);
        } else {
            self.begin(0, self.pass == 0 && !self.between);
        }
    }

    /// Whether a finer camera than the first turns with it.
    fn has_closer(&self) -> bool {
        self.passes.len() > 1
    }

    /// What it glances at, while that is remembered and the glance's time is not up: nobody sees it while the mount turns.
    fn glanced_at<'t>(&self, clock: &SimClock, tracker: &'t Tracker) -> Option<&'t Track> {
        let glance = self.glance?;
        let in_time = clock.at_s(clock.tick - glance.since) < GLANCE_TIMEOUT_S;
        tracker.table.get(glance.track).filter(|_| in_time)
    }

    /// How long the mount has rested at a gaze, or moved with it [s].
    fn rested_s(&mut self, clock: &SimClock, gimbal: &Gimbal, gaze: &Gaze) -> f64 {
        let state = &gimbal.state;
        let error_rad = (gimbal.params)
            .error_rad(gaze.az_el_rad, state.encoder_az_el_rad())
            .length();
        let off_radps = (state.gyro_rates_radps() - gaze.rates_radps).length();
        if self.settled_since.is_none() && error_rad < SETTLED_RAD && off_radps < SETTLED_RADPS {
            self.settled_since = Some(clock.tick);
        } else if error_rad > FOLLOW_FIELDS * self.passes[self.pass].field_rad[1] {
            self.settled_since = None;
        }
        self.settled_since
            .map_or(0.0, |since| clock.at_s(clock.tick - since))
    }

    /// Turns to the likeliest of what shows that was not glanced at lately; whether there is any, and a glance left for
    /// the present gaze, which may be `cut_short` by it.
    fn glances(&mut self, clock: &SimClock, shown: &[&Track], cut_short: bool) -> bool {
        let t_s = clock.t_s();
        let (count, cut_short) = match &self.glance {
            Some(last) => (last.count + 1, last.cut_short),
            None => (1, cut_short),
        };
        if count > MOST_GLANCES || !self.has_closer() {
            return false;
        }
        self.glanced
            .retain(|glanced| t_s - glanced.t_s < GLANCED_FOR_S);
        let at_rad = |track: &Track| track.filter.predicted(t_s).az_el_rad();
        let known = |track: &Track| {
            self.glanced.iter().any(|glanced| {
                glanced.track == track.id
                    || separation_rad(glanced.az_el_rad, at_rad(track)) < GLANCED_RAD
            })
        };
        // Slewed by hand, it leaves what lies elsewhere.
        let here = |track: &Track| self.slew_rad.is_none() || self.area.contains(at_rad(track));
        let likeliest = (shown.iter())
            .filter(|track| {
                may_be_glanced_at(track, self.cued, t_s) && here(track) && !known(track)
            })
            .max_by(|a, b| {
                let order = a.log_odds().total_cmp(&b.log_odds());
                order.then(b.id.cmp(&a.id))
            });
        let Some(track) = likeliest else {
            return false;
        };
        self.settled_since = None;
        self.glance = Some(Glance {
            track: track.id,
            since: clock.tick,
            count,
            cut_short,
        });
        self.glanced.push(Glanced {
            track: track.id,
            az_el_rad: at_rad(track),
            t_s,
        });
        true
    }
}

/// The present gaze, or glance; moves on when it has lasted, and along with the radar's cue.
pub(super) fn search(
    clock: &SimClock,
    tracker: &Tracker,
    cue: Option<TargetCue>,
    scan: &mut SearchScan,
    gimbal: &Gimbal,
) -> Gaze {
    let t_s = clock.t_s();
    let glances = scan.glance.is_some();
    let glanced = scan.glanced_at(clock, tracker);
    let gaze = glanced.map_or(scan.gaze(t_s), |track| along(track, t_s));
    let rested_s = scan.rested_s(clock, gimbal, &gaze);
    let fresh: Vec<&Track> = (tracker.table.tracks.iter())
        .filter(|track| tracker.target != Some(track.id) && is_fresh(track, t_s))
        .collect();
    let is_promising = |track: &Track| is_promising(track, cue.as_ref(), t_s);
    let promising = fresh.iter().any(|track| is_promising(track));
    let longest_s = match glanced {
        Some(track) if is_fresh(track, t_s) && is_likely(track, t_s) => LIKELY_GLANCE_S,
        Some(track) if is_fresh(track, t_s) && is_promising(track) => LONGEST_GLANCE_S,
        Some(_) => GLANCE_S,
        // What it was to see is forgotten.
        None if glances => f64::NEG_INFINITY,
        None if promising && !scan.has_closer() => LONGEST_GAZE_S,
        None if fresh.iter().all(|track| track.conduct.is_scenery()) => scan.empty_gaze_s(),
        None => scan.gaze_s(),
    };
    let over = rested_s > longest_s;
    // What the recogniser finds likely only now, from what a glance showed beside its object, is not left to the next pass.
    let likely = fresh.iter().copied().filter(|track| is_likely(track, t_s));
    let turns = !glances && scan.glances(clock, &likely.collect::<Vec<_>>(), !over);
    if over && !turns && !scan.glances(clock, &fresh, false) {
        scan.advance();
    }
    // A promising gaze drifts on as it did: a plot would move it off what it looks at.
    if scan.glance.is_none() && (over || !promising) {
        scan.follow(cue, t_s);
    }
    scan.glanced_at(clock, tracker)
        .map_or(scan.gaze(t_s), |track| along(track, t_s))
}

/// The middles between the neighbours of each row; a row of one, as it is.
fn between(gazes: &[DVec2]) -> Vec<DVec2> {
    let rows = gazes.chunk_by(|a, b| a.y == b.y);
    rows.flat_map(|row| match row {
        [alone] => vec![*alone],
        _ => row
            .windows(2)
            .map(|pair| pair[0].midpoint(pair[1]))
            .collect(),
    })
    .collect()
}

/// The gaze that stays on a track, and moves with it where its rate is known.
fn along(track: &Track, t_s: f64) -> Gaze {
    const KNOWN_SIGMAS: f64 = 3.0;
    let los = track.filter.predicted(t_s);
    let moves = track.motion(t_s).1 > KNOWN_SIGMAS;
    Gaze {
        rates_radps: if moves {
            DVec2::new(los.az_rate_radps, los.el_rate_radps)
        } else {
            DVec2::ZERO
        },
        ..Gaze::still(los.az_el_rad())
    }
}

/// Whether a track was seen so lately that it is still about where it is thought to be.
fn is_fresh(track: &Track, t_s: f64) -> bool {
    track.filter.coast_s(t_s) < 0.3
}

/// Whether a track may be worth a glance: seen steadily, not known for scenery, and not surely something else; what is seen
/// so in clear sky, once anyway. Without a cue, which says that there is something, what stands before scenery must stand out
/// of that.
fn may_be_glanced_at(track: &Track, cued: bool, t_s: f64) -> bool {
    track.total_hits() >= JUDGED_HITS
        && !track.is_barred(t_s)
        && match (track.conduct.in_sky, track.seen_share() > GLANCED_SHARE) {
            (true, true) if is_only_seen_from_afar(track) => true,
            (in_sky, steady) => {
                let may_fly = in_sky || steady && (cued || stands_out(track, t_s));
                may_fly && track.log_odds() > GLANCED
            }
        }
        && (!track.conduct.is_scenery() || is_likely(track, t_s))
}

/// Whether a track before scenery differs from that: it moves, or looks somewhat like a UAV.
fn stands_out(track: &Track, t_s: f64) -> bool {
    let (rate_radps, sigmas) = track.motion(t_s);
    let looks = match track.found() {
        Some(found) => found.p_uav() > GLANCED_PROBABILITY,
        None => track.log_odds() > GLANCED_EVIDENCE,
    };
    looks || rate_radps > GLANCED_RADPS && sigmas > GLANCED_SIGMAS
}

/// Whether no finer camera has seen a track but by chance.
fn is_only_seen_from_afar(track: &Track) -> bool {
    track.hits[Tier::Coarse] + track.hits[Tier::Precise] < JUDGED_HITS
}

/// Whether the recogniser finds a track more likely a UAV than not, and it is not left alone.
fn is_likely(track: &Track, t_s: f64) -> bool {
    !track.is_barred(t_s)
        && track
            .found()
            .is_some_and(|found| found.p_uav() > PROMISING_PROBABILITY)
}

/// Whether a track that is seen is worth a longer look: it flies, stands in the sky or where the radar points, or is more likely a
/// UAV than not.
fn is_promising(track: &Track, cue: Option<&TargetCue>, t_s: f64) -> bool {
    let (rate, sigmas) = track.motion(t_s);
    let least = match track.recognition {
        Some(_) if !is_only_seen_from_afar(track) => PROMISING_CLOSE,
        Some(_) => PROMISING_JUDGED,
        None => PROMISING,
    };
    let cued = || {
        cue.is_some_and(|cue| {
            let at = track.filter.predicted(t_s).az_el_rad();
            separation_rad(at, cue.az_el_rad) < cue.sigma_rad.max_element()
        })
    };
    let stands_out = || track.conduct.in_sky || rate > 1e-3 && sigmas > 3.0 || cued();
    track.total_hits() >= JUDGED_HITS
        && (is_likely(track, t_s)
            || !track.conduct.is_scenery() && track.log_odds() > least && stands_out())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::maths::kinematics::wrap_pi;
    use crate::models::maths::rng::Stream;
    use crate::models::mount::gimbal::{GimbalParams, GimbalState};
    use crate::models::mount::gyro::{Gyro, GyroParams};
    use crate::models::tracking::evidence::EvidenceParams;
    use crate::models::tracking::recognition::Recognition;
    use crate::models::tracking::table::{CameraLook, Sighting, TrackTable};
    use glam::DVec3;

    const FIELDS_RAD: [[f64; 2]; 3] = [[0.105, 0.079], [0.052, 0.039], [0.0175, 0.0131]];
    const SECTOR: Sector = Sector {
        centre_azimuth_rad: -3.0,
        centre_elevation_rad: 0.1,
        width_rad: 0.6,
        height_rad: 0.15,
    };

    fn cue(az_el_rad: [f64; 2], sigma_rad: f64, rate_radps: f64) -> TargetCue {
        TargetCue {
            az_el_rad: az_el_rad.into(),
            sigma_rad: DVec2::splat(sigma_rad),
            range_m: 600.0,
            range_sigma_m: 15.0,
            rate_radps: DVec2::new(rate_radps, 0.0),
            rate_sigma_radps: DVec2::splat(5e-3),
        }
    }

    /// The cameras, the search camera with this time from frame to frame [s].
    fn cameras(search_s: f64) -> [(Tier, [f64; 2], f64); 3] {
        let frames_s = [search_s, 1.0 / 60.0, 1.0 / 120.0];
        [0, 1, 2].map(|i| (Tier::ALL[i], FIELDS_RAD[i], frames_s[i]))
    }

    fn scan(cue: Option<TargetCue>) -> SearchScan {
        SearchScan::new(SearchPattern::Raster, SECTOR, &cameras(1.0 / 30.0), cue)
    }

    /// Tier and number of gazes of the first passes.
    fn passes(scan: &mut SearchScan) -> Vec<(Tier, usize)> {
        (0..4)
            .map(|_| {
                let (tier, gazes) = (scan.passes[scan.pass].tier, scan.offsets_rad.len());
                (0..gazes).for_each(|_| scan.advance());
                (tier, gazes)
            })
            .collect()
    }

    #[test]
    fn a_small_area_is_searched_ever_closer() {
        use Tier::{Coarse, Precise, Search};
        // Two deviations to either side: 1.4°, then 5.7°.
        let mut near = scan(Some(cue([1.0, 0.1], 6e-3, 0.0)));
        let ever_closer = [(Search, 1), (Coarse, 1), (Precise, 4), (Search, 1)];
        assert_eq!(passes(&mut near), ever_closer);
        let mut wide = scan(Some(cue([1.0, 0.1], 25e-3, 0.0)));
        let not_closest = [(Search, 2), (Coarse, 6), (Search, 2), (Coarse, 6)];
        assert_eq!(passes(&mut wide), not_closest);
        // A sector is too large for that.
        let sector = [(Search, 12), (Search, 10), (Search, 12), (Search, 10)];
        assert_eq!(passes(&mut scan(None)), sector);
    }

    #[test]
    fn the_gazes_move_with_the_cue() {
        let mut scan = scan(Some(cue([1.0, 0.1], 6e-3, 0.02)));
        let before = scan.gaze(0.0);
        let along = DVec2::new(0.02 / 0.1f64.cos(), 0.0);
        assert!((before.rates_radps - along).length() < 1e-12);
        let later = scan.gaze(2.0);
        assert!((later.az_el_rad - before.az_el_rad - 2.0 * along).length() < 1e-12);
        // The next plot puts it elsewhere; the pass goes on.
        scan.begin(2, false);
        (scan.index, scan.settled_since) = (2, Some(7));
        let off = scan.offsets_rad[2];
        scan.follow(Some(cue([1.05, 0.1], 6e-3, 0.0)), 2.0);
        assert_eq!((scan.index, scan.settled_since), (2, Some(7)));
        let centre = DVec2::new(1.05, 0.1);
        assert!((scan.gaze(2.0).az_el_rad - off - centre).length() < 1e-12);
        // Without a radar's track it is the sector again.
        scan.follow(None, 3.0);
        assert_eq!((scan.pass, scan.offsets_rad.len()), (0, 12));
    }

    #[test]
    fn a_sector_may_lie_south() {
        // Offsets do not wrap where the azimuth does.
        let scan = scan(None);
        let widest = scan
            .offsets_rad
            .iter()
            .map(|o| o.x.abs())
            .fold(0.0, f64::max);
        assert!(widest < 0.3, "{widest}");
        assert!(wrap_pi(scan.gaze(0.0).az_el_rad.x + 3.0).abs() < 0.3);
    }

    #[test]
    fn a_gaze_has_frames_enough() {
        let slow = SearchScan::new(SearchPattern::Raster, SECTOR, &cameras(0.1), None);
        let gaze_s = DVec3::from([0, 1, 2].map(|pass| slow.passes[pass].gaze_s));
        let off_s = gaze_s - DVec3::new(1.5, 1.0 / 3.0, 1.0 / 3.0);
        assert!(off_s.abs().max_element() < 1e-9);
        let every = |frame_s| every_in_pass(Tier::Coarse, frame_s);
        assert_eq!([1.0 / 120.0, 1.0 / 60.0, 0.1].map(every), [4, 2, 1]);
    }

    /// The search camera sees this, a bird or with this probability a UAV.
    fn see(table: &mut TrackTable, az_el_rad: DVec2, judged: f64, t_s: f64) {
        let sighting = Sighting {
            az_el_rad,
            sigma_rad: 1e-4,
            size_rad: 6e-4,
            score: 0.6,
            label: 0,
            weak: false,
        };
        table.update(&CameraLook {
            tier: Tier::Search,
            t_s,
            ifov_rad: 1.6e-4,
            reads: &EvidenceParams::default(),
            sightings: &[sighting],
            in_view: &|_| true,
            start_tracks: true,
        });
        for track in &mut table.tracks {
            track.recognition = Some(Recognition {
                probabilities: [judged, 1.0 - judged, 0.0, 0.0, 0.0, 0.0],
                t_s,
            });
        }
    }

    /// As `looked_with`, not before clear sky and the mount at once where it is told to be.
    fn looked(
        cameras: &[(Tier, [f64; 2], f64)],
        seen_az_el_rad: Option<DVec2>,
        judged: f64,
        until_s: f64,
    ) -> Vec<(DVec2, f64)> {
        looked_with(0.0, false, 0, cameras, seen_az_el_rad, judged, until_s)
    }

    /// Runs a scan for so long [s] over its sector, with a mount that turns for `turn_s` [s], while the search camera, at rest,
    /// sees this, which the coarse one has seen in so many frames; where the mount was told to look and since when [s].
    fn looked_with(
        turn_s: f64,
        in_sky: bool,
        closely: u32,
        cameras: &[(Tier, [f64; 2], f64)],
        seen_az_el_rad: Option<DVec2>,
        judged: f64,
        until_s: f64,
    ) -> Vec<(DVec2, f64)> {
        let mut scan = SearchScan::new(SearchPattern::Raster, SECTOR, cameras, None);
        let mut tracker = Tracker::default();
        let gyros = Gyro::new(GyroParams::FIBRE, Stream::new(0, 0, "gyro"));
        let mut gimbal = Gimbal::new(GimbalParams::default(), gyros);
        let mut looked: Vec<(DVec2, f64)> = Vec::new();
        let tick_hz = 960;
        for tick in 0..(until_s * f64::from(tick_hz)) as u64 {
            let clock = SimClock { tick, tick_hz };
            let t_s = clock.t_s();
            let rests = |looked: &[(DVec2, f64)]| {
                let last = looked.last();
                last.is_none_or(|(_, since_s)| t_s - since_s >= turn_s)
            };
            let shown = seen_az_el_rad.filter(|_| rests(&looked) && clock.due(30));
            if let Some(az_el_rad) = shown {
                see(&mut tracker.table, az_el_rad, judged, t_s);
                for track in &mut tracker.table.tracks {
                    track.conduct.in_sky = in_sky;
                    track.hits[Tier::Coarse] = closely;
                }
            }
            let gaze = search(&clock, &tracker, None, &mut scan, &gimbal);
            let moved = |last: &(DVec2, f64)| separation_rad(last.0, gaze.az_el_rad) > 5e-4;
            if looked.last().is_none_or(moved) {
                looked.push((gaze.az_el_rad, t_s));
            }
            if rests(&looked) {
                gimbal.state = GimbalState::at_rest(gaze.az_el_rad);
            }
        }
        looked
    }

    #[test]
    fn what_a_gaze_shows_is_glanced_at_once() {
        let all = cameras(1.0 / 30.0);
        let gazes = looked(&all, None, 0.0, 12.0);
        // Where nothing shows a gaze is shorter; two rows of six, then between them, then again.
        let quick_s = gazes[1].1;
        assert!((quick_s - EMPTY_SHARE * GAZE_S).abs() < 5e-3, "{quick_s}");
        assert_eq!(gazes[12].0, gazes[0].0.midpoint(gazes[1].0));
        assert_eq!(gazes[12 + 10].0, gazes[0].0);
        let at = gazes[0].0 + DVec2::new(0.02, 0.01);
        let with = looked(&all, Some(at), 0.3, GLANCED_FOR_S);
        let [_, glance, next] = [0, 1, 2].map(|i| with[i]);
        assert!(separation_rad(glance.0, at) < 5e-4);
        assert!((glance.1 - GAZE_S).abs() < 5e-3, "{}", glance.1);
        assert_eq!(next.0, gazes[1].0);
        let lasted_s = next.1 - glance.1;
        assert!((lasted_s - GLANCE_S).abs() < 5e-3, "{lasted_s}");
        let glances = |looked: &[(DVec2, f64)]| {
            let close = looked.iter().filter(|l| separation_rad(l.0, at) < 5e-4);
            close.count()
        };
        assert_eq!(glances(&with), 1, "not again within {GLANCED_FOR_S} s");
        // What is surely none, even for a dot, is not worth it but in clear sky; without a finer camera there is nothing to see.
        assert_eq!(glances(&looked(&all, Some(at), 1e-4, 3.0)), 0);
        assert_eq!(
            glances(&looked_with(0.0, true, 0, &all, Some(at), 1e-4, 3.0)),
            1
        );
        assert_eq!(glances(&looked(&all[..1], Some(at), 0.3, 3.0)), 0);
        // What looks like a target is looked at for longer: the tracker would have it by then.
        let likely = looked(&all, Some(at), 0.8, 4.0);
        let lasted_s = likely[2].1 - likely[1].1;
        assert!((lasted_s - LIKELY_GLANCE_S).abs() < 5e-3, "{lasted_s}");
        // It is turned to as soon as that is known, and the gaze begins anew.
        assert!(likely[1].1 < 0.5 * GAZE_S, "{}", likely[1].1);
        assert_eq!(likely[2].0, gazes[0].0);
        // What a finer camera shows is waited for longer before it is left for none.
        for (closely, expected_s) in [(0, GLANCE_S), (JUDGED_HITS, LONGEST_GLANCE_S)] {
            let looked = looked_with(0.0, true, closely, &all, Some(at), 0.01, 3.0);
            let lasted_s = looked[2].1 - looked[1].1;
            assert!((lasted_s - expected_s).abs() < 5e-3, "{lasted_s}");
        }
    }

    #[test]
    fn what_hangs_still_before_scenery_is_glanced_at_on_a_cue_or_if_it_looks_like_a_uav() {
        // The second probability is 0.24 for a dot as small as this.
        for (rate_radps, judged, cued, expected) in [
            (0.0, 0.3, false, true),
            (0.0, 0.02, false, false),
            (0.0, 0.02, true, true),
            (5e-3, 0.02, false, true),
        ] {
            let mut table = TrackTable::default();
            let mut t_s = 0.0;
            for _ in 0..15 {
                t_s += 1.0 / 30.0;
                see(&mut table, DVec2::new(rate_radps * t_s, 0.1), judged, t_s);
            }
            let may_be = may_be_glanced_at(&table.tracks[0], cued, t_s);
            assert_eq!(may_be, expected, "{rate_radps} {judged} {cued}");
        }
    }

    #[test]
    fn a_glance_waits_for_the_mount() {
        // Longer than what nobody sees counts as fresh.
        const TURN_S: f64 = 0.4;
        let all = cameras(1.0 / 30.0);
        let at = scan(None).gaze(0.0).az_el_rad + DVec2::new(0.02, 0.01);
        let looked = looked_with(TURN_S, false, 0, &all, Some(at), 0.3, 3.0);
        assert!(separation_rad(looked[1].0, at) < 5e-4);
        let lasted_s = looked[2].1 - looked[1].1;
        assert!((lasted_s - TURN_S - GLANCE_S).abs() < 5e-3, "{lasted_s}");
    }

    #[test]
    fn without_a_search_camera_the_next_finer_one_begins() {
        let two = &cameras(1.0 / 30.0)[1..];
        let cue = cue([1.0, 0.1], 6e-3, 0.0);
        let mut scan = SearchScan::new(SearchPattern::Raster, SECTOR, two, Some(cue));
        assert!((scan.gaze_s() - 0.5).abs() < 1e-12);
        let coarse_first = [(Tier::Coarse, 1), (Tier::Precise, 4)];
        assert_eq!(passes(&mut scan)[..2], coarse_first);
    }
}
