//! The picture that several stations share: objects in Cartesian coordinates, made of what each station's
//! cameras, range finder and radar measured.
//!
//! A follower is a station's track of one thing: a number of its track table, or of its radar. Its fixes come one
//! after the other; once they fit an object several rounds in a row, and none of the same station's other
//! followers does better, it is one of the object's followers, until its fixes have missed it several times
//! in a row. Two followers of different stations whose directions cross start an object; so does one whose
//! range was measured.
//!
//! An object's identity is the follower it was first made of. Stations tell each other what they call an
//! object; the lesser name wins, so that all come to one name whatever the link lost.

use crate::maths::assignment::{Pair, assign};
use crate::tracking::cartesian::{Bearing, CartesianTrack, FIRST_VELOCITY_SIGMA_MPS, crossing};
use glam::DVec3;
use nalgebra::Matrix3;
use std::collections::{BTreeMap, BTreeSet};

/// What of a station follows an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Sensor {
    /// Its cameras and range finder: a track of its table.
    Cameras,
    /// Its radar.
    Radar,
}

/// A station's track of one thing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Follower {
    /// The station's number.
    pub station: usize,
    /// What follows.
    pub sensor: Sensor,
    /// Its own number of the track.
    pub number: u32,
}

impl Follower {
    /// Its name, that of its station given.
    pub fn named(&self, station: &str) -> String {
        match self.sensor {
            Sensor::Cameras => format!("{station}/{}", self.number),
            Sensor::Radar => format!("{station}/radar {}", self.number),
        }
    }
}

/// What a follower measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Measured {
    /// A direction.
    Bearing(Bearing),
    /// A position [m] and its covariance [m²].
    Position(DVec3, Matrix3<f64>),
    /// A range from a place [m], with its standard deviation [m].
    Range(DVec3, f64, f64),
}

/// A measurement of a follower.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fix {
    /// Whose.
    pub follower: Follower,
    /// When it was measured [s].
    pub t_s: f64,
    /// What was measured.
    pub measured: Measured,
}

/// What is known of an object's follower.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Followed {
    /// Time of its last fix that fitted [s].
    pub last_s: f64,
    /// Fixes in a row that did not.
    misfits: u32,
    /// Log-odds that it is a UAV, as the station last judged.
    pub log_odds: f64,
}

/// An object of the picture.
#[derive(Clone, Debug, PartialEq)]
pub struct SharedObject {
    /// Its name among the stations.
    pub identity: Follower,
    /// Where it is and how it moves.
    pub track: CartesianTrack,
    /// Who follows it.
    pub followers: BTreeMap<Follower, Followed>,
    /// A station saw it fall.
    pub dealt_with: bool,
}

/// A follower that belongs to no object yet.
#[derive(Clone, Debug, PartialEq)]
struct Loose {
    fix: Fix,
    /// Its last range, from where and how sure [m].
    range: Option<(DVec3, f64, f64)>,
    log_odds: f64,
    /// Whether there was a fix since the last round.
    fresh: bool,
    /// What it may be of: an object or another loose follower, by name, and for how many rounds.
    suits: Option<(Follower, u32)>,
}

/// The objects that a station knows of, in the order in which it learned of them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// The objects.
    pub objects: Vec<SharedObject>,
    loose: BTreeMap<Follower, Loose>,
    /// Objects that may be one, and for how many rounds.
    alike: BTreeMap<(Follower, Follower), u32>,
}

/// Squared distance beyond which a fix does not fit the object that its follower follows (five deviations).
const GATE: f64 = 25.0;
/// Squared distance below which it may be a fix of an object that it does not follow yet: 99.9 % of a direction's
/// two degrees of freedom; a position's third makes it 99.7 %.
const FITS: f64 = 13.8;
/// Squared distance of six degrees of freedom below which two objects may be one: 99 %.
const ALIKE: f64 = 16.8;
/// Rounds in a row that make a follower one of an object's, and two objects one.
const ROUNDS: u32 = 5;
/// Fixes in a row that end that.
const MISFITS: u32 = 3;
/// Time without a fix after which a follower has gone, and an object without one [s]; and after which another of the
/// same station may take its place [s].
const SILENT_S: f64 = 3.0;
const REPLACED_S: f64 = 1.0;

impl SharedObject {
    /// Log-odds that it is a UAV: what the stations' cameras say, each of which sees it from its own side.
    pub fn log_odds(&self) -> f64 {
        const MOST: f64 = 5.0;
        let cameras = self.of(Sensor::Cameras);
        cameras
            .map(|(_, followed)| followed.log_odds.clamp(-MOST, MOST))
            .sum()
    }

    /// Its followers of a kind.
    fn of(&self, sensor: Sensor) -> impl Iterator<Item = (&Follower, &Followed)> {
        (self.followers.iter()).filter(move |(follower, _)| follower.sensor == sensor)
    }

    /// The number that a station's track table has for it.
    pub fn number_at(&self, station: usize) -> Option<u32> {
        let mut own = self
            .of(Sensor::Cameras)
            .filter(|(f, _)| f.station == station);
        // The latest, where a track has taken another's place.
        let first = own.next()?;
        let latest = own.fold(first, |a, b| if b.1.last_s > a.1.last_s { b } else { a });
        Some(latest.0.number)
    }

    /// Squared distance of a fix from where the object is expected.
    fn distance2(&self, fix: &Fix) -> f64 {
        match &fix.measured {
            Measured::Bearing(bearing) => self.track.bearing_distance2(fix.t_s, bearing),
            Measured::Position(r_enu_m, covariance) => {
                self.track.position_distance2(fix.t_s, *r_enu_m, covariance)
            }
            Measured::Range(..) => 0.0,
        }
    }

    /// A station saw it fall.
    fn fell(&mut self) {
        self.dealt_with = true;
        self.track.falls();
    }

    /// Takes another object in, which it is.
    fn absorb(&mut self, other: Self) {
        self.identity = self.identity.min(other.identity);
        if other.track.sigma_m() < self.track.sigma_m() {
            self.track = other.track;
        }
        self.followers.extend(other.followers);
    }

    /// Takes in a fix of one of its followers; false if that does not follow it any more.
    fn take(&mut self, fix: &Fix) -> bool {
        let far = self.distance2(fix) > GATE;
        let Some(followed) = self.followers.get_mut(&fix.follower) else {
            return false;
        };
        if far {
            followed.misfits += 1;
            return followed.misfits < MISFITS;
        }
        followed.misfits = 0;
        followed.last_s = followed.last_s.max(fix.t_s);
        match &fix.measured {
            Measured::Bearing(bearing) => self.track.take_bearing(fix.t_s, bearing),
            Measured::Position(r_enu_m, covariance) => {
                self.track.take_position(fix.t_s, *r_enu_m, covariance);
            }
            Measured::Range(from_enu_m, range_m, sigma_m) => {
                self.track
                    .take_range(fix.t_s, *from_enu_m, *range_m, *sigma_m);
            }
        }
        true
    }
}

impl Picture {
    /// The object of an identity.
    pub fn get(&self, identity: Follower) -> Option<&SharedObject> {
        (self.objects.iter()).find(|object| object.identity == identity)
    }

    /// The object that a follower follows.
    pub fn of(&self, follower: Follower) -> Option<&SharedObject> {
        (self.objects.iter()).find(|object| object.followers.contains_key(&follower))
    }

    fn of_mut(&mut self, follower: Follower) -> Option<&mut SharedObject> {
        (self.objects.iter_mut()).find(|object| object.followers.contains_key(&follower))
    }

    /// Takes in a fix; fixes come in the order of their times.
    pub fn take(&mut self, fix: &Fix) {
        if let Some(object) = self.of_mut(fix.follower) {
            if !object.take(fix) {
                object.followers.remove(&fix.follower);
            }
            return;
        }
        match (fix.measured, self.loose.get_mut(&fix.follower)) {
            (Measured::Range(from_enu_m, range_m, sigma_m), Some(loose)) => {
                loose.range = Some((from_enu_m, range_m, sigma_m));
            }
            (Measured::Range(..), None) => {}
            (_, Some(loose)) => (loose.fix, loose.fresh) = (*fix, true),
            (_, None) => {
                let loose = Loose {
                    fix: *fix,
                    range: None,
                    log_odds: 0.0,
                    fresh: true,
                    suits: None,
                };
                self.loose.insert(fix.follower, loose);
            }
        }
    }

    /// What a follower's station says of it: its log-odds of being a UAV, whether it has been seen to fall, and
    /// what the station calls the object.
    pub fn judge(
        &mut self,
        follower: Follower,
        log_odds: f64,
        fell: bool,
        called: Option<Follower>,
    ) {
        if let Some(loose) = self.loose.get_mut(&follower) {
            loose.log_odds = log_odds;
        }
        let taken = called.is_some_and(|name| self.get(name).is_some());
        let Some(object) = self.of_mut(follower) else {
            return;
        };
        if let Some(followed) = object.followers.get_mut(&follower) {
            followed.log_odds = log_odds;
        }
        if fell {
            object.fell();
        }
        if let Some(name) = called.filter(|name| !taken && *name < object.identity) {
            object.identity = name;
        }
    }

    /// One round at `t_s` [s]: loose followers join objects or start some, objects that are one become one, what has
    /// gone is forgotten.
    pub fn sort_out(&mut self, t_s: f64) {
        for object in &mut self.objects {
            object
                .followers
                .retain(|_, followed| t_s - followed.last_s < SILENT_S);
        }
        self.objects.retain(|object| !object.followers.is_empty());
        self.loose.retain(|_, loose| t_s - loose.fix.t_s < SILENT_S);
        self.unite();
        let news: Vec<Follower> = (self.loose.iter())
            .filter(|(_, loose)| loose.fresh)
            .map(|(follower, _)| *follower)
            .collect();
        let suited = self.join(&news);
        let left: Vec<Follower> = news.into_iter().filter(|f| !suited.contains(f)).collect();
        self.cross(&left);
        for loose in self.loose.values_mut() {
            loose.fresh = false;
        }
    }

    /// Followers with news that fit an object; those that have done so for long enough join it.
    fn join(&mut self, news: &[Follower]) -> BTreeSet<Follower> {
        let mut suited = BTreeSet::new();
        // The followers of one sensor see different things: they are assigned together.
        for own in news.chunk_by(|a, b| (a.station, a.sensor) == (b.station, b.sensor)) {
            let mut pairs = Vec::new();
            for (row, follower) in own.iter().enumerate() {
                let fix = &self.loose[follower].fix;
                for (column, object) in self.objects.iter().enumerate() {
                    let taken = object.followers.iter().any(|(other, followed)| {
                        (other.station, other.sensor) == (follower.station, follower.sensor)
                            && fix.t_s - followed.last_s < REPLACED_S
                    });
                    let cost = object.distance2(fix) - FITS;
                    // What is near one that falls may be its neighbour.
                    if !taken && !object.dealt_with && cost < 0.0 {
                        pairs.push(Pair { row, column, cost });
                    }
                }
            }
            let chosen = assign(own.len(), self.objects.len(), &pairs);
            for (follower, column) in own.iter().zip(chosen) {
                let Some(column) = column else { continue };
                suited.insert(*follower);
                let identity = self.objects[column].identity;
                if self.suits(*follower, identity) >= ROUNDS
                    && let Some(loose) = self.loose.remove(follower)
                {
                    self.objects[column]
                        .followers
                        .insert(*follower, loose.followed());
                }
            }
        }
        suited
    }

    /// For how many rounds in a row a loose follower has suited the same.
    fn suits(&mut self, follower: Follower, whom: Follower) -> u32 {
        let Some(loose) = self.loose.get_mut(&follower) else {
            return 0;
        };
        let rounds = match loose.suits {
            Some((before, rounds)) if before == whom => rounds + 1,
            _ => 1,
        };
        loose.suits = Some((whom, rounds));
        rounds
    }

    /// Loose followers that fit no object start some: alone where the range is known, otherwise two whose directions
    /// cross.
    fn cross(&mut self, news: &[Follower]) {
        for follower in news {
            let loose = &self.loose[follower];
            let Some((r_enu_m, covariance)) = loose.position() else {
                continue;
            };
            // A track may be another's that will suit soon: only a radar is believed at once.
            if follower.sensor == Sensor::Radar || self.suits(*follower, *follower) >= ROUNDS {
                self.start(&[*follower], r_enu_m, &covariance);
            }
        }
        let left: Vec<Follower> = (news.iter().copied())
            .filter(|f| {
                self.loose
                    .get(f)
                    .is_some_and(|loose| loose.position().is_none())
            })
            .collect();
        let groups: Vec<&[Follower]> = left.chunk_by(|a, b| a.station == b.station).collect();
        for (i, first) in groups.iter().enumerate() {
            for second in &groups[i + 1..] {
                self.cross_two(first, second);
            }
        }
    }

    /// Starts objects where the directions of two stations' followers cross.
    fn cross_two(&mut self, first: &[Follower], second: &[Follower]) {
        let mut pairs = Vec::new();
        let mut places = BTreeMap::new();
        for (row, a) in first.iter().enumerate() {
            for (column, b) in second.iter().enumerate() {
                let (Some(a), Some(b)) = (self.loose.get(a), self.loose.get(b)) else {
                    continue;
                };
                let (Measured::Bearing(of_a), Measured::Bearing(of_b)) =
                    (a.fix.measured, b.fix.measured)
                else {
                    continue;
                };
                let moved_m = FIRST_VELOCITY_SIGMA_MPS[0] * (a.fix.t_s - b.fix.t_s).abs();
                if let Some(place) = crossing(&of_a, &of_b, moved_m) {
                    // Which of several crosses best is left to the rounds: the likelier are UAVs.
                    let cost = -1.0 - 1.0 / (1.0 + (-a.log_odds - b.log_odds).exp());
                    pairs.push(Pair { row, column, cost });
                    places.insert((row, column), place);
                }
            }
        }
        let chosen = assign(first.len(), second.len(), &pairs);
        for (row, column) in chosen.into_iter().enumerate() {
            let Some(column) = column else { continue };
            let (a, b) = (first[row], second[column]);
            let rounds = self.suits(a, b).min(self.suits(b, a));
            if rounds >= ROUNDS
                && let Some((r_enu_m, covariance)) = places.get(&(row, column))
            {
                self.start(&[a, b], *r_enu_m, covariance);
            }
        }
    }

    /// Starts an object of loose followers.
    fn start(&mut self, followers: &[Follower], r_enu_m: DVec3, covariance_m2: &Matrix3<f64>) {
        let loose: BTreeMap<Follower, Loose> = (followers.iter())
            .filter_map(|follower| self.loose.remove_entry(follower))
            .collect();
        let t_s = (loose.values()).fold(f64::NEG_INFINITY, |t_s, loose| t_s.max(loose.fix.t_s));
        let Some(identity) = loose.keys().next().copied() else {
            return;
        };
        self.objects.push(SharedObject {
            identity,
            track: CartesianTrack::start(t_s, r_enu_m, covariance_m2),
            followers: loose
                .iter()
                .map(|(f, loose)| (*f, loose.followed()))
                .collect(),
            dealt_with: false,
        });
    }

    /// Makes one of objects that have been alike for long enough: the lesser name, and the surer estimate.
    fn unite(&mut self) {
        let mut near = Vec::new();
        for (second, b) in self.objects.iter().enumerate() {
            for (first, a) in self.objects[..second].iter().enumerate() {
                let apart2 = apart2(a, b);
                if apart2 < ALIKE {
                    near.push((apart2, first, second));
                }
            }
        }
        near.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let (mut paired, mut alike, mut gone) = (BTreeSet::new(), BTreeMap::new(), Vec::new());
        for (_, first, second) in near {
            if paired.contains(&first) || paired.contains(&second) {
                continue;
            }
            paired.extend([first, second]);
            let names = (self.objects[first].identity, self.objects[second].identity);
            let rounds = self.alike.get(&names).map_or(1, |rounds| rounds + 1);
            if rounds < ROUNDS {
                alike.insert(names, rounds);
            } else {
                let b = self.objects[second].clone();
                self.objects[first].absorb(b);
                gone.push(names.1.max(names.0));
            }
        }
        self.alike = alike;
        self.objects
            .retain(|object| !gone.contains(&object.identity));
    }
}

/// Squared distance of two objects in six degrees of freedom; infinite where one sensor follows both, and of one
/// that falls.
fn apart2(a: &SharedObject, b: &SharedObject) -> f64 {
    let sensors = |object: &SharedObject| -> BTreeSet<(usize, Sensor)> {
        let of = |f: &Follower| (f.station, f.sensor);
        object.followers.keys().map(of).collect()
    };
    if a.dealt_with || b.dealt_with || !sensors(a).is_disjoint(&sensors(b)) {
        return f64::INFINITY;
    }
    let t_s = a.track.t_s().max(b.track.t_s());
    a.track.advanced(t_s).apart2(&b.track.advanced(t_s))
}

impl Loose {
    fn followed(&self) -> Followed {
        Followed {
            last_s: self.fix.t_s,
            misfits: 0,
            log_odds: self.log_odds,
        }
    }

    /// Its position [m] and that's covariance [m²], where its range is known.
    fn position(&self) -> Option<(DVec3, Matrix3<f64>)> {
        match (self.fix.measured, self.range) {
            (Measured::Position(r_enu_m, covariance), _) => Some((r_enu_m, covariance)),
            (Measured::Bearing(bearing), Some((_, range_m, sigma_m))) => {
                Some(bearing.at_range(range_m, sigma_m))
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths::kinematics::los_to_az_el;
    use crate::maths::rng::Stream;
    use glam::DVec2;

    const STATIONS: [DVec3; 2] = [DVec3::ZERO, DVec3::new(300.0, 0.0, 10.0)];
    const SIGMA_RAD: f64 = 5e-5;

    fn cameras(station: usize, number: u32) -> Follower {
        Follower {
            station,
            sensor: Sensor::Cameras,
            number,
        }
    }

    fn seen(follower: Follower, t_s: f64, r_enu_m: DVec3, rng: &mut Stream) -> Fix {
        let from_m = STATIONS[follower.station];
        let at = los_to_az_el(r_enu_m - from_m);
        let noise = SIGMA_RAD * rng.normal3();
        Fix {
            follower,
            t_s,
            measured: Measured::Bearing(Bearing {
                r_from_enu_m: from_m,
                az_el_rad: at + DVec2::new(noise.x / at.y.cos(), noise.y),
                sigma_rad: SIGMA_RAD,
            }),
        }
    }

    /// Four UAVs that fly abreast, 25 m apart.
    fn uav(index: u32, t_s: f64) -> DVec3 {
        let x = 25.0 * f64::from(index);
        DVec3::new(-100.0 + x, 700.0 - 12.0 * t_s, 80.0 + 0.3 * x)
    }

    /// A round: which station's track of which UAV saw it.
    fn round(picture: &mut Picture, k: u32, tracks: &[(Follower, u32)], rng: &mut Stream) {
        let t_s = 0.05 * f64::from(k);
        for (follower, index) in tracks {
            picture.take(&seen(*follower, t_s, uav(*index, t_s), rng));
        }
        picture.sort_out(t_s);
    }

    /// Both stations track all four, the second under other numbers.
    fn all() -> Vec<(Follower, u32)> {
        let both = (0..4).flat_map(|i| [(cameras(0, i), i), (cameras(1, 9 - i), i)]);
        let mut tracks: Vec<_> = both.collect();
        tracks.sort();
        tracks
    }

    #[test]
    fn directions_of_two_stations_become_objects() {
        let mut rng = Stream::new(1, 0, "picture");
        let mut picture = Picture::default();
        for k in 0..40 {
            round(&mut picture, k, &all(), &mut rng);
        }
        assert_eq!(picture.objects.len(), 4);
        for i in 0..4 {
            let object = picture.of(cameras(0, i)).unwrap();
            assert_eq!(object.identity, cameras(0, i));
            assert_eq!(object.number_at(1), Some(9 - i));
            let (r_enu_m, _) = object.track.advanced(2.0).motion_enu();
            assert!(r_enu_m.distance(uav(i, 2.0)) < 1.0, "{i}: {r_enu_m}");
        }
    }

    #[test]
    fn an_object_keeps_its_identity_while_one_of_the_two_sees_it() {
        let mut rng = Stream::new(2, 0, "picture");
        let mut picture = Picture::default();
        let tracks = all();
        // The first station is blind from 2 s to 6 s, and comes back with new numbers.
        for k in 0..160 {
            let t_s = 0.05 * f64::from(k);
            let now: Vec<_> = (tracks.iter().copied())
                .filter(|(f, _)| f.station == 1 || !(2.0..6.0).contains(&t_s))
                .map(|(f, i)| match f.station {
                    0 if t_s >= 6.0 => (cameras(0, f.number + 20), i),
                    _ => (f, i),
                })
                .collect();
            round(&mut picture, k, &now, &mut rng);
        }
        assert_eq!(picture.objects.len(), 4);
        for i in 0..4 {
            let object = picture.get(cameras(0, i)).unwrap();
            assert_eq!(object.number_at(0), Some(20 + i));
        }
    }

    #[test]
    fn a_range_makes_an_object_of_one_stations_track() {
        let mut rng = Stream::new(3, 0, "picture");
        let mut picture = Picture::default();
        for k in 0..10 {
            round(&mut picture, k, &[(cameras(0, 7), 1)], &mut rng);
            assert!(picture.objects.is_empty());
        }
        let range = Fix {
            follower: cameras(0, 7),
            t_s: 0.45,
            measured: Measured::Range(DVec3::ZERO, uav(1, 0.45).length(), 0.5),
        };
        picture.take(&range);
        for k in 10..30 {
            round(&mut picture, k, &[(cameras(0, 7), 1)], &mut rng);
        }
        assert_eq!(picture.objects.len(), 1);
        // The other station's track of it joins, and one of another UAV does not.
        for k in 30..40 {
            let tracks = [(cameras(0, 7), 1), (cameras(1, 1), 1), (cameras(1, 2), 3)];
            round(&mut picture, k, &tracks, &mut rng);
        }
        let object = picture.of(cameras(0, 7)).unwrap();
        assert_eq!(object.number_at(1), Some(1));
        assert_eq!(picture.objects.len(), 1);
    }

    #[test]
    fn two_names_of_one_object_become_the_lesser() {
        let mut rng = Stream::new(4, 0, "picture");
        let mut picture = Picture::default();
        for k in 0..20 {
            round(&mut picture, k, &all(), &mut rng);
        }
        let lesser = cameras(0, 0);
        picture.judge(cameras(1, 6), 2.0, false, Some(lesser));
        // That name is another's here; a free one is taken.
        assert!(picture.get(cameras(0, 3)).is_some());
        let radar = Follower {
            sensor: Sensor::Radar,
            ..cameras(0, 3)
        };
        picture.judge(cameras(1, 6), 2.0, true, Some(radar));
        assert!(picture.get(cameras(0, 3)).is_some(), "a greater name");
        let object = picture.of(cameras(1, 6)).unwrap();
        assert!(object.dealt_with && (object.log_odds() - 2.0).abs() < 1e-12);
    }

    #[test]
    fn objects_that_two_radars_started_become_one() {
        let mut rng = Stream::new(5, 0, "picture");
        let mut picture = Picture::default();
        let errors = crate::tracking::radar::RadarErrors {
            sigma_rad: 0.012,
            range_sigma_m: 15.0,
        };
        let far = |i: u32, t_s: f64| uav(i, t_s) + DVec3::X * 150.0 * f64::from(i);
        for k in 0..200 {
            let t_s = 0.05 * f64::from(k);
            for (station, from_m) in STATIONS.into_iter().enumerate() {
                for i in 0..3 {
                    if k % 20 == 0 {
                        let plot = errors.plot(far(i, t_s) - from_m, t_s, &mut rng);
                        let (r_enu_m, covariance) = errors.converted(&plot, from_m);
                        let follower = Follower {
                            station,
                            sensor: Sensor::Radar,
                            number: i,
                        };
                        picture.take(&Fix {
                            follower,
                            t_s,
                            measured: Measured::Position(r_enu_m, covariance),
                        });
                    }
                }
            }
            picture.sort_out(t_s);
        }
        assert_eq!(picture.objects.len(), 3);
        for object in &picture.objects {
            let numbers: BTreeSet<u32> = object.followers.keys().map(|f| f.number).collect();
            assert_eq!((object.followers.len(), numbers.len()), (2, 1));
        }
    }
}
