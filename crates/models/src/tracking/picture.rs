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

mod association;
mod fix;
mod frame;
mod fusion;
mod known;
mod object;

pub use fix::{Fix, Follower, Measured, Sensor};
pub use frame::{OwnFrame, SurveyErrors};
pub use known::Picture;
pub use object::{Followed, SharedObject};

/// Time without a fix after which a follower has gone, and an object without one [s].
const SILENT_S: f64 = 3.0;

impl Picture {
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths::kinematics::los_to_az_el;
    use crate::maths::rng::Stream;
    use crate::tracking::cartesian::Bearing;
    use glam::{DVec2, DVec3};
    use nalgebra::Matrix3;
    use std::collections::BTreeSet;

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
        // Of a radar: 12 mrad and 15 m at some 700 m.
        let sigma_m = 10.0;
        let far = |i: u32, t_s: f64| uav(i, t_s) + DVec3::X * 150.0 * f64::from(i);
        for k in 0..200 {
            let t_s = 0.05 * f64::from(k);
            for station in 0..STATIONS.len() {
                for i in 0..3 {
                    if k % 20 == 0 {
                        let r_enu_m = far(i, t_s) + sigma_m * rng.normal3();
                        let covariance = Matrix3::identity() * (sigma_m * sigma_m);
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
