use super::formation::tests::nearest_m;
use super::member::Pad;
use super::*;
use crate::flight::multirotor::Setpoint;
use crate::maths::rng::Stream;

fn member(middle_enu_m: DVec3) -> Member {
    Member {
        swarm: 0,
        slot_m: DVec3::ZERO,
        middle_enu_m,
        begins_s: 0.0,
        detour: None,
        take_off: None,
        landing: None,
    }
}

/// Members in their slots 400 m south of the goal; forward is north, left is west.
fn swarm(behaviour: &Behaviour, slots: &[DVec3]) -> Vec<Steering> {
    let start = DVec3::new(0.0, -400.0, 80.0);
    let begin = |(index, slot): (usize, &DVec3)| {
        let reference = Setpoint {
            r_enu_m: start + DVec3::new(-slot.y, slot.x, slot.z),
            v_enu_mps: DVec3::Y * behaviour.speed_mps,
            a_enu_mps2: DVec3::ZERO,
            yaw_rad: 0.0,
        };
        let member = Member {
            slot_m: *slot,
            ..member(start)
        };
        Steering::new(member, reference, Stream::new(1, index as u64, "steering"))
    };
    slots.iter().enumerate().map(begin).collect()
}

const STEP_S: f64 = 0.05; // [s]

/// Flies members by their reference points alone between two times [s].
fn fly(
    members: &mut [Steering],
    behaviour: &Behaviour,
    [from_s, end_s]: [f64; 2],
    surface_m: impl Fn(DVec2) -> f64,
    irradiance_wpm2: f64,
    mut look: impl FnMut(&[Steering]),
) {
    let steps = |t_s: f64| (t_s / STEP_S).round() as usize;
    for step in steps(from_s)..steps(end_s) {
        let t_s = step as f64 * STEP_S;
        let all: Vec<Mate> = (members.iter())
            .map(|member| Mate {
                group: member.group(),
                r_enu_m: member.reference.r_enu_m,
                v_enu_mps: member.reference.v_enu_mps,
            })
            .collect();
        for (index, member) in members.iter_mut().enumerate() {
            let own = all[index];
            let near = |mate: &Mate| mate.r_enu_m.distance(own.r_enu_m) < behaviour.reach_m();
            let others = all.iter().enumerate().filter(|(other, _)| *other != index);
            let mates: Vec<Mate> = others.map(|(_, mate)| *mate).filter(near).collect();
            member.takes_off(t_s);
            member.steer(behaviour, t_s, &own, &mates, &surface_m, irradiance_wpm2);
            member.advance(STEP_S);
        }
        look(members);
    }
}

/// Where members are after so long [s], and how near they came [m].
fn flown(behaviour: &Behaviour, slots: &[DVec3], end_s: f64, heated: bool) -> (Vec<DVec3>, f64) {
    let mut members = swarm(behaviour, slots);
    let irradiance_wpm2 = if heated { 1e6 } else { 0.0 };
    let mut least_m = f64::INFINITY;
    let look = |members: &[Steering]| least_m = least_m.min(nearest_m(&places(members)));
    fly(
        &mut members,
        behaviour,
        [0.0, end_s],
        |_| 0.0,
        irradiance_wpm2,
        look,
    );
    (places(&members), least_m)
}

fn places(members: &[Steering]) -> Vec<DVec3> {
    members
        .iter()
        .map(|member| member.reference.r_enu_m)
        .collect()
}

fn behaviour() -> Behaviour {
    Behaviour {
        goal_enu_m: DVec3::new(0.0, 0.0, 80.0),
        speed_mps: 12.0,
        separation_m: 6.0,
        keeps_formation: true,
        above_ground_m: None,
        pop_up: None,
        evasion: Vec::new(),
    }
}

#[test]
fn a_formation_arrives_as_it_left() {
    let behaviour = behaviour();
    let slots = Formation::Wedge.slots_m(15, 10.0, &mut Stream::new(1, 0, "formation"));
    let (places, least_m) = flown(&behaviour, &slots, 60.0, false);
    assert!(least_m > 9.0, "{least_m} m");
    let centre = places.iter().sum::<DVec3>() / 15.0;
    assert!((centre - behaviour.goal_enu_m).length() < 2.0, "{centre}");
}

#[test]
fn a_flock_keeps_apart_and_arrives() {
    let flock = Behaviour {
        keeps_formation: false,
        ..behaviour()
    };
    let slots = Formation::Cloud.slots_m(30, 8.0, &mut Stream::new(1, 0, "formation"));
    let (places, least_m) = flown(&flock, &slots, 60.0, false);
    assert!(least_m > 1.5, "{least_m} m");
    let centre = places.iter().sum::<DVec3>() / 30.0;
    assert!((centre - flock.goal_enu_m).length() < 10.0, "{centre}");
}

#[test]
fn heights_follow_the_ground_and_a_beam_is_evaded() {
    let low = Behaviour {
        above_ground_m: Some(30.0),
        ..behaviour()
    };
    let slots = Formation::Line.slots_m(3, 10.0, &mut Stream::new(1, 0, "formation"));
    let (places, _) = flown(&low, &slots, 20.0, false);
    assert!(
        places.iter().all(|place| (place.z - 30.0).abs() < 1.0),
        "{places:?}"
    );
    let straight = flown(&behaviour(), &slots, 8.0, true).0;
    for evasion in [Evasion::Jink, Evasion::Dive, Evasion::Spread] {
        let evading = Behaviour {
            evasion: vec![evasion],
            ..behaviour()
        };
        let (places, _) = flown(&evading, &slots, 8.0, true);
        let most_m = places.iter().zip(&straight).map(|(a, b)| a.distance(*b));
        let most_m = most_m.fold(0.0, f64::max);
        assert!(most_m > 1.0, "{evasion:?}: {most_m} m");
    }
}

#[test]
fn groups_part_and_meet_again() {
    let slots = Formation::Line.slots_m(9, 8.0, &mut Stream::new(1, 0, "formation"));
    for keeps_formation in [true, false] {
        let behaviour = Behaviour {
            keeps_formation,
            ..behaviour()
        };
        let mut members = swarm(&behaviour, &slots);
        for (index, member) in members.iter_mut().enumerate() {
            // The line's first is its rightmost.
            let group = 2 - index / 3;
            member.member.detour = Some(Detour {
                group,
                bearing_rad: [-40.0, 0.0, 40.0_f64][group].to_radians(),
                begins_m: 50.0,
                ends_m: 300.0,
                pace: 40.0_f64.to_radians().cos(),
            });
        }
        let centres = |members: &[Steering]| {
            [0, 1, 2].map(|group| {
                let of = (members.iter()).filter(|member| member.group() == group);
                of.map(|member| member.reference.r_enu_m).sum::<DVec3>() / 3.0
            })
        };
        // Halfway of the detour: 50 m at 12 m/s, 125 m at 9.2 m/s.
        fly(&mut members, &behaviour, [0.0, 17.8], |_| 0.0, 0.0, |_| ());
        let [left, middle, right] = centres(&members);
        let aside_m = 125.0 * 40.0_f64.to_radians().tan();
        for (centre, wanted_m) in [(left, -aside_m), (middle, 0.0), (right, aside_m)] {
            let line_m = if wanted_m == 0.0 {
                0.0
            } else {
                24.0 * wanted_m.signum()
            };
            let off_m = centre.x - wanted_m - line_m;
            assert!(
                off_m.abs() < 15.0,
                "{keeps_formation}: {centre}, {wanted_m} m"
            );
            assert!((centre.y - middle.y).abs() < 10.0, "{centre} {middle}");
        }
        // 300 m after 31 s, the goal 100 m on.
        fly(&mut members, &behaviour, [17.8, 34.0], |_| 0.0, 0.0, |_| ());
        let [left, middle, right] = centres(&members);
        for centre in [left, right] {
            let off_m = (centre - middle).length();
            assert!(off_m < 35.0, "{keeps_formation}: {centre} {middle}");
        }
        fly(&mut members, &behaviour, [34.0, 60.0], |_| 0.0, 0.0, |_| ());
        let centre = places(&members).iter().sum::<DVec3>() / 9.0;
        assert!((centre - behaviour.goal_enu_m).length() < 6.0, "{centre}");
    }
}

#[test]
fn a_low_approach_goes_around_towers_and_over_rows_and_then_up() {
    let low = Behaviour {
        keeps_formation: false,
        pop_up: Some(PopUp {
            at_m: 100.0,
            low_m: 6.0,
        }),
        ..behaviour()
    };
    // A tower in the way, then a row of houses across it.
    let surface_m = |at: DVec2| match (at.x.abs(), at.y) {
        (east_m, north_m) if east_m < 15.0 && (-300.0..-270.0).contains(&north_m) => 70.0,
        (_, north_m) if (-200.0..-185.0).contains(&north_m) => 20.0,
        _ => 0.0,
    };
    let mut members = swarm(&low, &[DVec3::ZERO]);
    members[0].reference.r_enu_m.z = 6.0;
    let (mut highest_m, mut least_m) = (0.0_f64, f64::INFINITY);
    let look = |members: &[Steering]| {
        let r_m = members[0].reference.r_enu_m;
        least_m = least_m.min(r_m.z - surface_m(r_m.truncate()));
        if r_m.truncate().length() > 105.0 {
            highest_m = highest_m.max(r_m.z);
        }
    };
    fly(&mut members, &low, [0.0, 60.0], surface_m, 0.0, look);
    assert!(least_m > 2.0, "{least_m} m over the ground");
    assert!((22.0..32.0).contains(&highest_m), "{highest_m} m");
    let place = members[0].reference.r_enu_m;
    assert!((place - low.goal_enu_m).length() < 4.0, "{place}");
}

#[test]
fn members_rise_from_their_pads_and_come_down_on_them() {
    let behaviour = Behaviour {
        above_ground_m: Some(30.0),
        ..behaviour()
    };
    let slots = Formation::Line.slots_m(3, 10.0, &mut Stream::new(1, 0, "formation"));
    let mut members = swarm(&behaviour, &slots);
    for (index, member) in members.iter_mut().enumerate() {
        member.reference.r_enu_m = DVec3::new(3.0 * index as f64, -400.0, 0.1);
        member.reference.v_enu_mps = DVec3::ZERO;
        member.pad = Pad::Waits;
        member.member.begins_s = 10.0;
        member.member.take_off = Some(TakeOff {
            at_s: 0.0,
            to_enu_m: 20.0,
        });
        member.member.landing = Some(Landing {
            at_s: 60.0,
            pad_enu_m: DVec3::new(3.0 * index as f64, 0.0, 0.1),
        });
    }
    let over_pads = |members: &[Steering]| members.iter().all(Steering::over_pad);
    fly(
        &mut members,
        &behaviour,
        [0.0, 5.0],
        |_| 0.0,
        0.0,
        |members| {
            assert!(over_pads(members));
        },
    );
    assert!(places(&members).iter().all(|place| place.z > 8.0));
    fly(&mut members, &behaviour, [5.0, 60.0], |_| 0.0, 0.0, |_| ());
    for (place, slot) in places(&members).iter().zip(&slots) {
        assert!(
            (place.x + slot.y).abs() < 2.0 && place.y.abs() < 2.0,
            "{place}"
        );
        assert!((place.z - 30.0).abs() < 1.0, "{place}");
    }
    // The ground would carry them once they touch it.
    let mut touched = [false; 3];
    fly(
        &mut members,
        &behaviour,
        [60.0, 90.0],
        |_| 0.0,
        0.0,
        |members| {
            for (touched, member) in touched.iter_mut().zip(members) {
                let (r_m, pad) = (
                    member.reference.r_enu_m,
                    member.member.landing.unwrap().pad_enu_m,
                );
                if r_m.z < pad.z && !*touched {
                    assert!(
                        member.lands() && (r_m - pad).truncate().length() < 0.7,
                        "{r_m}"
                    );
                    let sink_mps = -member.reference.v_enu_mps.z;
                    assert!((0.2..0.7).contains(&sink_mps), "{sink_mps} m/s");
                    *touched = true;
                }
            }
        },
    );
    assert_eq!(touched, [true; 3]);
}
