//! The search: gazes over the sector or about the radar's cue, ever closer where nothing was found.

use crate::components::capture::Tier;
use crate::components::control::{Pass, SearchScan};
use crate::components::mount::Gimbal;
use crate::components::run::SimClock;
use crate::components::track::Tracker;
use crate::models::tracking::cartesian::TargetCue;
use crate::models::tracking::search::{Gaze, SearchPattern, Sector};
use crate::models::tracking::table::{Track, separation_rad};
use glam::DVec2;

/// A gaze begins when the mount is this close to it [rad], a fiftieth of the search camera's field,
/// and moves with it but for this [rad/s]: below a fifth of a pixel in a 5 ms exposure.
const SETTLED_RAD: f64 = 2e-3;
const SETTLED_RADPS: f64 = 5e-3;
/// Least duration of a gaze [s], and least number of frames in it. A candidate needs 6 hits
/// (`systems::track`): 15 frames leave room for misses, and within half a second
/// a rate of 1 mrad/s stands six deviations out of the noise of 0.5 px of the search camera.
const GAZE_S: f64 = 0.5;
const GAZE_FRAMES: f64 = 15.0;
/// How long a gaze lasts at most while something in it looks like a target [s].
const LONGEST_GAZE_S: f64 = 2.0;
/// Hits that make a track worth a longer gaze, and log-odds: even, or less for what the recogniser has
/// judged, of which a dot may still be chosen.
const PROMISING_HITS: u32 = 3;
const PROMISING: f64 = 0.0;
const PROMISING_JUDGED: f64 = -0.6;
/// Probability by the recogniser that makes it worth one wherever it stands: a UAV that hovers before scenery is
/// only chosen once the recogniser is sure.
const PROMISING_PROBABILITY: f64 = 0.5;
/// Share of the field by which neighbouring gazes overlap: a target at the edge of one is whole in
/// the next.
const OVERLAP: f64 = 0.1;
/// Share of the field by which the mount may be off a gaze that a plot has moved before it begins anew.
const FOLLOW_FIELDS: f64 = 0.25;
/// A pass with a finer camera, in whose field a target is larger, is made where so many gazes cover the area:
/// as a rule about a radar's cue. It goes outward from the middle, in gazes of so many frames, of which
/// [`PROMISING_HITS`] make it longer, and reads about as many a second as the search camera [Hz].
const MOST_CLOSER_GAZES: usize = 20;
const CLOSER_FRAMES: f64 = 10.0;
const CLOSER_HZ: f64 = 30.0;

/// Of how many of its exposures a camera of `frame_s` [s] a frame reads one in its pass.
pub(super) fn read_every(tier: Tier, frame_s: f64) -> u64 {
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
            let read_s = frame_s * read_every(*tier, *frame_s) as f64;
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
            index: 0,
            settled_since: None,
        };
        scan.follow(cue, 0.0);
        scan.begin(0);
        scan
    }

    /// What the camera of the present pass is for.
    pub fn tier(&self) -> Tier {
        self.passes[self.pass].tier
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

    /// Gazes of a pass over the area, from its centre [rad].
    fn laid_out(&self, pass: usize) -> Vec<DVec2> {
        let centre = DVec2::new(self.area.centre_azimuth_rad, self.area.centre_elevation_rad);
        let pattern = match (pass, self.pattern) {
            (1.., SearchPattern::Raster) => SearchPattern::Spiral,
            (_, pattern) => pattern,
        };
        pattern
            .gazes(&self.area, self.passes[pass].field_rad, OVERLAP)
            .into_iter()
            .map(|gaze| DVec2::from(gaze) - centre)
            .collect()
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
            self.begin(0);
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
            self.begin(0);
        }
    }

    /// Begins a pass.
    fn begin(&mut self, pass: usize) {
        self.pass = pass;
        self.offsets_rad = self.laid_out(pass);
        self.index = 0;
        self.settled_since = None;
    }

    /// Goes on to the next gaze; after the last of a pass to the next finer camera, whose pass takes in less of
    /// the area at a time, and back to the search camera.
    fn advance(&mut self) {
        self.settled_since = None;
        self.index += 1;
        if self.index < self.offsets_rad.len() {
            return;
        }
        let next = self.pass + 1;
        let closer = next < self.passes.len() && self.laid_out(next).len() <= MOST_CLOSER_GAZES;
        self.begin(if closer { next } else { 0 });
    }
}

/// The present gaze; moves on when it has lasted, and along with the radar's cue.
pub(super) fn search(
    clock: &SimClock,
    tracker: &Tracker,
    cue: Option<TargetCue>,
    scan: &mut SearchScan,
    gimbal: &Gimbal,
) -> Gaze {
    let t_s = clock.t_s();
    let gaze = scan.gaze(t_s);
    let state = &gimbal.state;
    let error_rad = (gimbal.params)
        .error_rad(gaze.az_el_rad, state.encoder_az_el_rad())
        .length();
    let off_radps = (state.gyro_rates_radps() - gaze.rates_radps).length();
    if scan.settled_since.is_none() && error_rad < SETTLED_RAD && off_radps < SETTLED_RADPS {
        scan.settled_since = Some(clock.tick);
    } else if error_rad > FOLLOW_FIELDS * scan.passes[scan.pass].field_rad[1] {
        scan.settled_since = None;
    }
    let rested_s = scan
        .settled_since
        .map_or(0.0, |since| clock.at_s(clock.tick - since));
    let promising = tracker
        .table
        .tracks
        .iter()
        .filter(|track| tracker.target != Some(track.id))
        .any(|track| is_promising(track, cue.as_ref(), t_s));
    let longest_s = if promising {
        LONGEST_GAZE_S
    } else {
        scan.gaze_s()
    };
    if rested_s > longest_s {
        scan.advance();
    }
    // A promising gaze drifts on as it did: a plot would move it off what it looks at.
    if !promising || rested_s > longest_s {
        scan.follow(cue, t_s);
    }
    scan.gaze(t_s)
}

/// Whether a track is worth a longer gaze: it flies, stands in the sky or where the radar points, or is more likely a
/// UAV than not.
fn is_promising(track: &Track, cue: Option<&TargetCue>, t_s: f64) -> bool {
    let fresh = track.filter.coast_s(t_s) < 0.3;
    let (rate, sigmas) = track.motion(t_s);
    let judged = track.recognition.is_some();
    let least = if judged { PROMISING_JUDGED } else { PROMISING };
    let cued = || {
        cue.is_some_and(|cue| {
            let at = track.filter.predicted(t_s).az_el_rad();
            separation_rad(at, cue.az_el_rad) < cue.sigma_rad.max_element()
        })
    };
    let likely = t_s >= track.barred_until_s
        && (track.recognition).is_some_and(|found| found.p_uav() > PROMISING_PROBABILITY);
    let stands_out = || track.conduct.in_sky || rate > 1e-3 && sigmas > 3.0 || cued();
    fresh
        && track.total_hits() >= PROMISING_HITS
        && (likely || !track.conduct.is_scenery() && track.log_odds() > least && stands_out())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::maths::kinematics::wrap_pi;
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
                let (tier, gazes) = (scan.tier(), scan.offsets_rad.len());
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
        let not_closest = [(Search, 2), (Coarse, 9), (Search, 2), (Coarse, 9)];
        assert_eq!(passes(&mut wide), not_closest);
        // A sector is too large for that.
        assert!(
            passes(&mut scan(None))
                .iter()
                .all(|pass| *pass == (Search, 14))
        );
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
        scan.begin(2);
        (scan.index, scan.settled_since) = (2, Some(7));
        let off = scan.offsets_rad[2];
        scan.follow(Some(cue([1.05, 0.1], 6e-3, 0.0)), 2.0);
        assert_eq!((scan.index, scan.settled_since), (2, Some(7)));
        let centre = DVec2::new(1.05, 0.1);
        assert!((scan.gaze(2.0).az_el_rad - off - centre).length() < 1e-12);
        // Without a radar's track it is the sector again.
        scan.follow(None, 3.0);
        assert_eq!((scan.tier(), scan.offsets_rad.len()), (Tier::Search, 14));
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
        let every = |frame_s| read_every(Tier::Coarse, frame_s);
        assert_eq!([1.0 / 120.0, 1.0 / 60.0, 0.1].map(every), [4, 2, 1]);
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
