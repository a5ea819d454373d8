//! Playing recordings back: time moves as the user says, and what was recorded then takes its place.

use crate::components::beam::BeamState;
use crate::components::capture::SensorCamera;
use crate::components::flight::{Flight, HeatedSkin, Uav, UavStatus};
use crate::components::mount::{CameraView, Station};
use crate::components::run::SimClock;
use crate::components::view::{
    CameraShown, Curve, CurveLine, Estimate, Estimates, Found, Pacing, Picture, Pictures, PlayStep,
    Playback,
};
use crate::media::image::decode;
use crate::recording::timeline::{CameraTrack, StationTrack, Timeline};
use bevy::prelude::*;
use bevy_egui::input::EguiWantsInput;
use glam::DVec2;
use std::collections::BTreeMap;
use std::sync::Arc;

impl Playback {
    /// Recordings from their beginning.
    pub fn new(timelines: Vec<Timeline>) -> Self {
        let mut events_s: Vec<f64> = timelines.iter().flat_map(events_s).collect();
        events_s.sort_by(f64::total_cmp);
        events_s.dedup();
        let curves = curves(&timelines);
        let mut playback = Self {
            timelines,
            t_s: 0.0,
            backwards: false,
            step: None,
            span_s: [0.0, 1.0],
            events_s,
            curves,
        };
        playback.span_s = [0.0, playback.end_s()];
        playback
    }

    /// Plays, or pauses; what stands at its end begins again.
    pub fn toggle(&mut self, pacing: &mut Pacing) {
        pacing.paused = !pacing.paused;
        let ends_s = [0.0, self.end_s()];
        let [from_s, to_s] = if self.backwards {
            [ends_s[1], ends_s[0]]
        } else {
            ends_s
        };
        if !pacing.paused && self.t_s == to_s {
            self.t_s = from_s;
        }
    }

    /// The time to which a step leads [s].
    fn stepped_s(&self, step: PlayStep, forwards: bool) -> f64 {
        let Some(first) = self.timelines.first() else {
            return self.t_s;
        };
        let tick = first.tick_at(self.t_s);
        let nearest = |times_s: &mut dyn Iterator<Item = f64>| {
            let beyond = times_s.filter(|t_s| (*t_s > self.t_s + 1e-9) == forwards);
            let apart = |t_s: &f64| (t_s - self.t_s).abs();
            beyond
                .filter(|t_s| apart(t_s) > 1e-9)
                .min_by(|a, b| apart(a).total_cmp(&apart(b)))
        };
        let to_s = match step {
            PlayStep::Tick if forwards => Some(first.t_s(tick + 1)),
            PlayStep::Tick => Some(first.t_s(tick.saturating_sub(1))),
            PlayStep::Frame => nearest(&mut self.timelines.iter().flat_map(|timeline| {
                let tick = timeline.tick_at(self.t_s);
                frame_ticks(timeline, tick, forwards)
                    .into_iter()
                    .map(|tick| timeline.t_s(tick))
            })),
            PlayStep::Event => nearest(&mut self.events_s.iter().copied()),
            PlayStep::End => None,
        };
        let end_s = if forwards { self.end_s() } else { 0.0 };
        to_s.unwrap_or(end_s).clamp(0.0, self.end_s())
    }
}

/// The ticks of the next pictures, or of the next states where there are none.
fn frame_ticks(timeline: &Timeline, tick: u64, forwards: bool) -> Vec<u64> {
    fn next<T>(
        series: &crate::recording::timeline::Series<T>,
        tick: u64,
        forwards: bool,
    ) -> Option<u64> {
        if forwards {
            series.after(tick)
        } else {
            series.before(tick)
        }
    }
    let cameras = timeline.cameras.iter();
    let pictures: Vec<u64> = cameras
        .filter_map(|camera| next(&camera.pictures, tick, forwards))
        .collect();
    if !pictures.is_empty() {
        return pictures;
    }
    let states = timeline.stations.iter();
    states
        .filter_map(|station| next(&station.track, tick, forwards))
        .collect()
}

/// When something is logged, or a laser begins or ends to fire [s].
fn events_s(timeline: &Timeline) -> Vec<f64> {
    let logged = timeline.events.iter().map(|event| event.tick);
    let shots = timeline.stations.iter().flat_map(|station| {
        let pairs = station.beam.entries().windows(2);
        pairs
            .filter(|pair| pair[0].1.firing != pair[1].1.firing)
            .map(|pair| pair[1].0)
    });
    logged.chain(shots).map(|tick| timeline.t_s(tick)).collect()
}

/// What a line of the time line is named, and its values by tick.
type Series = Vec<(String, Vec<(u64, f64)>)>;

/// What the time line plots.
fn curves(timelines: &[Timeline]) -> Vec<Curve> {
    let lines = |of: &dyn Fn(&Timeline) -> Series| {
        let mut lines = Vec::new();
        for (source, timeline) in timelines.iter().enumerate() {
            for (number, (name, values)) in of(timeline).into_iter().enumerate() {
                let finite = values.into_iter().filter(|(_, value)| value.is_finite());
                lines.push(CurveLine {
                    name: if timelines.len() > 1 {
                        format!("{}: {name}", source + 1)
                    } else {
                        name
                    },
                    source,
                    number,
                    points: (finite.map(|(tick, value)| [timeline.t_s(tick), value])).collect(),
                    shown: true,
                });
            }
        }
        lines.retain(|line| !line.points.is_empty());
        lines
    };
    let miss = lines(&|timeline| {
        let cameras = timeline.cameras.iter();
        cameras
            .map(|camera| (camera.name.clone(), camera.miss_px.entries().to_vec()))
            .collect()
    });
    let irradiance = lines(&|timeline| {
        of_stations(timeline, |station| {
            let beams = station.beam.entries().iter();
            beams
                .map(|(tick, beam)| (*tick, 1e-4 * beam.irradiance_wpm2))
                .collect()
        })
    });
    let hottest = lines(&|timeline| {
        let mut by_tick: BTreeMap<u64, f64> = BTreeMap::new();
        for (tick, uav) in timeline.uavs.iter().flat_map(|(_, s)| s.entries()) {
            let hottest = by_tick.entry(*tick).or_insert(f64::NAN);
            *hottest = hottest.max(uav.skin_k - 273.15);
        }
        vec![("hottest of all".into(), by_tick.into_iter().collect())]
    });
    let mut range = lines(&|timeline| {
        of_stations(timeline, |station| {
            let tracks = station.track.entries().iter();
            tracks.map(|(tick, track)| (*tick, track.range_m)).collect()
        })
    });
    // The user may ask for it.
    range.iter_mut().for_each(|line| line.shown = false);
    [
        curve("miss distance (px)", true, miss),
        curve("irradiance (W/cm²)", false, irradiance),
        curve("skin (°C)", false, hottest),
        curve("range (m)", false, range),
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// A line a station.
fn of_stations(
    timeline: &Timeline,
    values: impl Fn(&StationTrack) -> Vec<(u64, f64)>,
) -> Vec<(String, Vec<(u64, f64)>)> {
    let stations = timeline.stations.iter();
    stations
        .map(|station| (station.name.clone(), values(station)))
        .collect()
}

/// A curve, if there is anything to plot.
fn curve(title: &'static str, logarithmic: bool, lines: Vec<CurveLine>) -> Option<Curve> {
    let values = || (lines.iter().flat_map(|line| &line.points)).map(|p| p[1]);
    let high = values().fold(f64::NEG_INFINITY, f64::max);
    let low = values().fold(f64::INFINITY, f64::min);
    let range = if logarithmic {
        [low.max(0.05), high.max(0.1)]
    } else {
        [low.min(0.0), high]
    };
    (range[1] > range[0]).then_some(Curve {
        title,
        logarithmic,
        lines,
        range,
    })
}

/// Moves time by `wall_s` more seconds of wall-clock time [s], or by the step that was asked for, and puts
/// everything where it was.
pub fn advance(world: &mut World, wall_s: f64) {
    world.resource_scope(|world, mut playback: Mut<Playback>| {
        let mut pacing = world.resource_mut::<Pacing>();
        if let Some((step, forwards)) = playback.step.take() {
            pacing.paused = true;
            playback.t_s = playback.stepped_s(step, forwards);
        } else if !pacing.paused {
            let moved_s = wall_s * pacing.speed;
            let signed_s = if playback.backwards {
                -moved_s
            } else {
                moved_s
            };
            let end_s = playback.end_s();
            let to_s = (playback.t_s + signed_s).clamp(0.0, end_s);
            playback.t_s = to_s;
            pacing.paused = to_s == if playback.backwards { 0.0 } else { end_s };
        }
        show(world, &playback);
    });
}

/// Puts UAVs, cameras and lasers where the recordings have them at their time.
fn show(world: &mut World, playback: &Playback) {
    let Some(first) = playback.timelines.first() else {
        return;
    };
    let tick = first.tick_at(playback.t_s);
    world.resource_mut::<SimClock>().tick = tick;
    let mut uavs = world.query::<(&Uav, &mut Flight, &mut UavStatus, Option<&mut HeatedSkin>)>();
    let mut numbers: BTreeMap<String, usize> = BTreeMap::new();
    let recorded: BTreeMap<&str, usize> = (first.uavs.iter().enumerate())
        .map(|(place, (name, _))| (name.as_str(), place))
        .collect();
    for (uav, mut flight, mut status, skin) in uavs.iter_mut(world) {
        numbers.insert(uav.name.clone(), uav.index);
        let Some(at) = recorded
            .get(uav.name.as_str())
            .and_then(|place| first.uavs[*place].1.at_or_first(tick))
        else {
            continue;
        };
        flight.state.r_enu_m = at.r_enu_m;
        flight.state.q_enu_body = at.q_enu_body;
        *status = UavStatus::named(&at.status).unwrap_or(UavStatus::Flying);
        if let Some(mut skin) = skin {
            skin.temperature_k = at.skin_k;
        }
    }
    let mut cameras = world.query::<(&SensorCamera, &mut CameraView)>();
    for (camera, mut view) in cameras.iter_mut(world) {
        let track = first
            .cameras
            .iter()
            .find(|track| *track.name == *camera.name);
        if let Some((r_enu_m, q_enu_cam)) = track.and_then(|track| track.poses.at_or_first(tick)) {
            view.pose.r_enu_m = *r_enu_m;
            view.pose.q_enu_cam = *q_enu_cam;
        }
    }
    let mut stations = world.query::<(&Station, &mut BeamState)>();
    for (station, mut beam) in stations.iter_mut(world) {
        let track = first
            .stations
            .iter()
            .find(|track| track.name == station.name);
        if let Some(track) = track {
            beam.firing = track.fires(tick);
            let target = track.track.at(tick).map(|track| track.target.as_str());
            beam.aimed = target.and_then(|name| numbers.get(name).copied());
        }
    }
    let estimates = playback.timelines.iter().enumerate();
    let estimates = estimates.flat_map(|(source, timeline)| {
        let tick = timeline.tick_at(playback.t_s);
        let stations = timeline.stations.iter();
        stations.filter_map(move |station| estimate(timeline, station, tick, source))
    });
    world.resource_mut::<Estimates>().0 = estimates.collect();
    world.resource_scope(|_, mut shown: Mut<Pictures>| {
        let before = std::mem::take(&mut shown.0);
        shown.0 = (playback.timelines.iter().enumerate())
            .map(|(column, timeline)| {
                let before = before.get(column).map_or(&[][..], Vec::as_slice);
                pictures(timeline, timeline.tick_at(playback.t_s), before)
            })
            .collect();
    });
}

/// Where a station believed its target.
fn estimate(
    timeline: &Timeline,
    station: &StationTrack,
    tick: u64,
    source: usize,
) -> Option<Estimate> {
    let track = station.track.at(tick)?;
    // Row-major over azimuth, elevation and their rates.
    let variance = |i: usize| track.los_covariance.get(5 * i).copied();
    let [azimuth, elevation] = [variance(0)?, variance(1)?];
    Some(Estimate {
        r_station_enu_m: timeline.r_enu_m(station)?,
        az_el_rad: DVec2::new(track.los_azimuth_rad, track.los_elevation_rad),
        sigma_rad: azimuth.max(elevation).sqrt(),
        range_m: Some(track.range_m).filter(|range_m| range_m.is_finite()),
        source,
    })
}

/// The cameras' pictures at a tick; what was shown `before` is not decoded again.
fn pictures(timeline: &Timeline, tick: u64, before: &[CameraShown]) -> Vec<CameraShown> {
    let with_pictures =
        (timeline.cameras.iter()).filter(|camera| !camera.pictures.entries().is_empty());
    with_pictures
        .map(|camera| {
            let state = (timeline.stations.iter())
                .find(|station| {
                    timeline
                        .cameras_of(station)
                        .any(|own| own.name == camera.name)
                })
                .and_then(|station| Some(station.track.at(tick)?.state.clone()));
            let shown = before.iter().find(|shown| shown.name == camera.name);
            let mut picture = picture(timeline, camera, tick, shown);
            let mut note = String::new();
            if let Some(picture) = &mut picture {
                picture.state = state.unwrap_or_default();
                note = format!("{:.3} s", picture.t_s);
            }
            CameraShown {
                name: camera.name.clone(),
                note,
                picture,
            }
        })
        .collect()
}

fn picture(
    timeline: &Timeline,
    camera: &CameraTrack,
    tick: u64,
    before: Option<&CameraShown>,
) -> Option<Picture> {
    let (taken, jpeg) = camera.pictures.entry_at(tick)?;
    let t_s = timeline.t_s(taken);
    let same = before.and_then(|before| before.picture.clone());
    let mut picture = match same.filter(|same| same.t_s == t_s) {
        Some(same) => same,
        None => {
            // A damaged picture is passed over: the one before it stays.
            let Ok(decoded) = decode(jpeg) else {
                return before.and_then(|before| before.picture.clone());
            };
            let size_px = [decoded.width(), decoded.height()];
            Picture {
                t_s,
                size_px,
                rgb8: Arc::new(decoded.into_raw()),
                part: size_px != camera.full_px(),
                found: Vec::new(),
                reticle_px: None,
                state: String::new(),
            }
        }
    };
    if let Some(marks) = camera.marks_at(tick) {
        let found = marks.boxes.iter().map(|mark| Found {
            box_px: mark.rect_px,
            caption: mark.label.clone(),
            weak: mark.weak,
        });
        picture.found = found.collect();
        picture.reticle_px = marks.reticle_px;
    }
    Some(picture)
}

/// Pace and steps of a playback from the keyboard.
pub fn obey_keys(
    keys: Res<ButtonInput<KeyCode>>,
    wants: Res<EguiWantsInput>,
    mut pacing: ResMut<Pacing>,
    mut playback: ResMut<Playback>,
) {
    if wants.wants_any_keyboard_input() {
        return;
    }
    if keys.just_pressed(KeyCode::Space) {
        playback.toggle(&mut pacing);
    }
    if keys.just_pressed(KeyCode::KeyR) {
        playback.backwards = !playback.backwards;
    }
    for (key, step, forwards) in [
        (KeyCode::Period, PlayStep::Tick, true),
        (KeyCode::Comma, PlayStep::Tick, false),
        (KeyCode::ArrowRight, PlayStep::Frame, true),
        (KeyCode::ArrowLeft, PlayStep::Frame, false),
        (KeyCode::PageDown, PlayStep::Event, true),
        (KeyCode::PageUp, PlayStep::Event, false),
        (KeyCode::End, PlayStep::End, true),
        (KeyCode::Home, PlayStep::End, false),
    ] {
        if keys.just_pressed(key) {
            playback.step = Some((step, forwards));
        }
    }
    for (key, factor) in [(KeyCode::BracketLeft, 0.5), (KeyCode::BracketRight, 2.0)] {
        if keys.just_pressed(key) {
            pacing.speed = (factor * pacing.speed).clamp(0.01, 100.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::{self, Options};
    use crate::recording::read::Recorded;
    use crate::scenario::{Loaded, Scenario};
    use glam::DVec3;
    use std::path::Path;

    const TICKS: u64 = 700;

    fn loaded() -> Loaded {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/urban_intercept.toml");
        Scenario::load(&path, &["detector.kind=truth".into()]).unwrap()
    }

    fn place(world: &mut World) -> DVec3 {
        let mut uavs = world.query::<(&Uav, &Flight)>();
        uavs.iter(world).next().unwrap().1.state.r_enu_m
    }

    #[test]
    fn what_was_recorded_comes_back_at_its_time_in_any_order() {
        let folder = tempfile::tempdir().unwrap();
        let options = Options {
            out: Some(folder.path().into()),
            ..Options::default()
        };
        let mut run = app::build(&loaded(), &options).unwrap();
        let mut truth = vec![place(run.world_mut())];
        for _ in 0..TICKS {
            app::step(run.world_mut()).unwrap();
            truth.push(place(run.world_mut()));
        }
        drop(run);
        let recorded = Recorded::open(&folder.path().join("run.mcap")).unwrap();
        let timeline = Timeline::of(&recorded);
        assert!(timeline.last_tick >= TICKS - 1);
        let states = &timeline.uavs[0].1;
        let playback = Playback::new(vec![timeline.clone(), timeline.clone()]);
        let (end_s, first_event_s) = (playback.end_s(), playback.events_s[0]);
        // Of two recordings each line says whose it is.
        let skin = (playback.curves.iter()).find(|curve| curve.title.starts_with("skin"));
        let names: Vec<&str> = (skin.unwrap().lines.iter())
            .map(|line| line.name.as_str())
            .collect();
        assert_eq!(names, ["1: hottest of all", "2: hottest of all"]);

        let mut app = app::build(&loaded(), &Options::default()).unwrap();
        let world = app.world_mut();
        world.insert_resource(playback);
        world.insert_resource(Pacing::default());
        world.init_resource::<Estimates>();
        world.init_resource::<Pictures>();
        let at_s = |world: &World| world.resource::<Playback>().t_s;
        for tick in [600, 3, 333, 0] {
            world.resource_mut::<Playback>().t_s = timeline.t_s(tick);
            world.resource_mut::<Pacing>().paused = true;
            advance(world, 0.1);
            // States are recorded every few ticks; the last one is shown, and before the first that.
            let of = states
                .entry_at(tick)
                .map_or(states.entries()[0].0, |(of, _)| of);
            assert_eq!(place(world), truth[of as usize], "tick {tick}");
            assert_eq!(world.resource::<SimClock>().tick, tick);
            assert!(world.resource::<Pacing>().paused);
        }
        // The second recording is the same run: so are its estimates.
        world.resource_mut::<Playback>().t_s = 0.6;
        advance(world, 0.0);
        let estimates = &world.resource::<Estimates>().0;
        assert_eq!(estimates.len(), 2);
        assert_eq!(estimates[0].az_el_rad, estimates[1].az_el_rad);

        // Forwards at twice the speed, backwards, and to both ends, where it stops.
        let mut pacing = world.resource_mut::<Pacing>();
        (pacing.paused, pacing.speed) = (false, 2.0);
        advance(world, 0.025);
        assert!((at_s(world) - 0.65).abs() < 1e-12);
        world.resource_mut::<Playback>().backwards = true;
        advance(world, 0.05);
        assert!((at_s(world) - 0.55).abs() < 1e-12);
        advance(world, 10.0);
        assert_eq!(at_s(world), 0.0);
        assert!(world.resource::<Pacing>().paused);

        let mut step = |step, forwards| {
            world.resource_mut::<Playback>().step = Some((step, forwards));
            advance(world, 0.0);
            world.resource::<Playback>().t_s
        };
        assert_eq!(step(PlayStep::Tick, true), timeline.t_s(1));
        assert_eq!(step(PlayStep::Tick, false), 0.0);
        assert_eq!(step(PlayStep::Tick, false), 0.0);
        // Without pictures a frame is a state.
        let state_s = step(PlayStep::Frame, true);
        assert_eq!(state_s, timeline.t_s(states.after(0).unwrap()));
        assert_eq!(step(PlayStep::Frame, false), 0.0);
        let event_s = step(PlayStep::Event, true);
        assert!(event_s > first_event_s && event_s < end_s, "{event_s}");
        assert_eq!(step(PlayStep::Event, false), first_event_s);
        assert_eq!(step(PlayStep::End, true), end_s);
        assert_eq!(step(PlayStep::Event, true), end_s);

        // Play at the end begins again, backwards from the other; elsewhere it goes on.
        let mut toggle = |at_s: f64, backwards: bool| {
            let world = &mut *world;
            world.resource_scope(|world, mut playback: Mut<Playback>| {
                (playback.t_s, playback.backwards) = (at_s, backwards);
                let mut pacing = world.resource_mut::<Pacing>();
                pacing.paused = true;
                playback.toggle(&mut pacing);
                assert!(!pacing.paused);
                let from_s = playback.t_s;
                playback.toggle(&mut pacing);
                assert!(pacing.paused);
                (from_s, playback.t_s)
            })
        };
        assert_eq!(toggle(end_s, false), (0.0, 0.0));
        assert_eq!(toggle(0.0, true), (end_s, end_s));
        assert_eq!(toggle(0.5, false), (0.5, 0.5));
        assert_eq!(toggle(0.0, false), (0.0, 0.0));
    }

    #[test]
    fn curves_are_named_after_whose_they_are() {
        let line = |number, values: &[f64]| CurveLine {
            name: format!("line {number}"),
            source: 0,
            number,
            points: (values.iter().zip(0..).map(|(v, t)| [f64::from(t), *v])).collect(),
            shown: true,
        };
        let shown = curve("", false, vec![line(0, &[2.0, 5.0]), line(1, &[-1.0])]);
        assert_eq!(shown.map(|curve| curve.range), Some([-1.0, 5.0]));
        assert_eq!(curve("", false, vec![line(0, &[0.0])]), None);
    }
}
