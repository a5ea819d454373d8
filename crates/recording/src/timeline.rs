//! A recording by time: what films and playback show of it.

use super::read::Recorded;
use super::{CITY, CLASS, COUNTS, SCORE, proto};
use foxglove::messages::{
    CameraCalibration, CompressedImage, CubePrimitive, FrameTransforms, ImageAnnotations, Log,
    SceneUpdate, Timestamp, points_annotation::Type,
};
use glam::{DQuat, DVec2, DVec3};
use mcap::Message;
use prost::Message as _;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

/// Values by tick, in the order of time.
#[derive(Clone, Debug)]
pub struct Series<T>(Vec<(u64, T)>);

impl<T> Default for Series<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<T> FromIterator<(u64, T)> for Series<T> {
    fn from_iter<I: IntoIterator<Item = (u64, T)>>(entries: I) -> Self {
        let mut series = Self::default();
        for (tick, value) in entries {
            series.push(tick, value);
        }
        series
    }
}

impl<T> Series<T> {
    /// The last value up to a tick.
    pub fn at(&self, tick: u64) -> Option<&T> {
        self.entry_at(tick).map(|(_, value)| value)
    }

    /// The last value up to a tick; before the first one, that.
    pub fn at_or_first(&self, tick: u64) -> Option<&T> {
        let first = || self.0.first().map(|(_, value)| value);
        self.at(tick).or_else(first)
    }

    /// The last value up to a tick, and its own tick.
    pub fn entry_at(&self, tick: u64) -> Option<(u64, &T)> {
        let after = self.0.partition_point(|(of, _)| *of <= tick);
        let (of, value) = self.0.get(after.checked_sub(1)?)?;
        Some((*of, value))
    }

    /// All of them with their ticks.
    pub fn entries(&self) -> &[(u64, T)] {
        &self.0
    }

    /// The tick of the first entry after a tick.
    pub fn after(&self, tick: u64) -> Option<u64> {
        let next = self.0.partition_point(|(of, _)| *of <= tick);
        self.0.get(next).map(|(of, _)| *of)
    }

    /// The tick of the last entry before a tick.
    pub fn before(&self, tick: u64) -> Option<u64> {
        let here = self.0.partition_point(|(of, _)| *of < tick);
        self.0.get(here.checked_sub(1)?).map(|(of, _)| *of)
    }

    /// Adds a value; a file that runs backwards is not believed.
    fn push(&mut self, tick: u64, value: T) {
        if self.0.last().is_none_or(|(last, _)| *last <= tick) {
            self.0.push((tick, value));
        }
    }
}

/// A UAV or distractor at a time.
#[derive(Clone, Debug)]
pub struct UavAt {
    /// Position \[m\].
    pub r_enu_m: DVec3,
    /// Rotates a body vector into ENU.
    pub q_enu_body: DQuat,
    /// Temperature of the hottest skin element \[K\]; not a number for a distractor.
    pub skin_k: f64,
    /// What has become of it, or what a distractor is.
    pub status: Arc<str>,
}

/// What is drawn on a picture.
#[derive(Clone, Debug, Default)]
pub struct Marks {
    /// What the detector found, the weakest first.
    pub boxes: Vec<Mark>,
    /// Where the camera's boresight is \[px\].
    pub reticle_px: Option<[f64; 2]>,
}

/// A box on a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Mark {
    /// x0, y0, x1, y1 \[px\].
    pub rect_px: [f64; 4],
    /// Class and score.
    pub label: String,
    /// Whether its score is below the threshold.
    pub weak: bool,
}

/// What a camera left.
#[derive(Clone, Debug, Default)]
pub struct CameraTrack {
    /// Its name, such as `ctv` or `east/ctv`.
    pub name: String,
    /// JPEG files.
    pub pictures: Series<Arc<Vec<u8>>>,
    /// Width and height of its pictures \[px\].
    pub sizes_px: Series<[u32; 2]>,
    /// Its position \[m\] and attitude in ENU.
    pub poses: Series<(DVec3, DQuat)>,
    /// Distance of the target from its boresight \[px\].
    pub miss_px: Series<f64>,
    /// Marks by the time stamps of their pictures.
    marks: BTreeMap<(u32, u32), Marks>,
    /// Time stamps of its pictures.
    stamps: Series<(u32, u32)>,
}

impl CameraTrack {
    /// What the detector found in the picture shown at a tick, once it was known.
    pub fn marks_at(&self, tick: u64) -> Option<&Marks> {
        self.marks.get(self.stamps.at(tick)?)
    }

    /// The largest picture of it \[px\].
    pub fn full_px(&self) -> [u32; 2] {
        let sizes = self.sizes_px.entries().iter().map(|(_, size)| *size);
        sizes.max_by_key(|[w, h]| w * h).unwrap_or_default()
    }
}

/// What a station left.
#[derive(Clone, Debug, Default)]
pub struct StationTrack {
    /// Its name.
    pub name: String,
    /// What its topics, cameras and log entries begin with: nothing for the first station.
    prefix: String,
    /// Gimbal, mirror, base.
    pub mount: Series<proto::MountState>,
    /// What its tracker believes.
    pub track: Series<proto::TrackState>,
    /// Its laser.
    pub beam: Series<proto::BeamState>,
}

impl StationTrack {
    /// Whether its laser fires.
    pub fn fires(&self, tick: u64) -> bool {
        self.beam.at(tick).is_some_and(|beam| beam.firing)
    }
}

/// A line of the log.
#[derive(Clone, Debug, PartialEq)]
pub struct Event {
    /// When.
    pub tick: u64,
    /// The part that says it, such as `tracker` or `east/operator`.
    pub part: String,
    /// What it says.
    pub text: String,
}

/// All that a recording shows.
#[derive(Clone, Debug, Default)]
pub struct Timeline {
    /// The file.
    pub path: PathBuf,
    /// Ticks per simulated second \[Hz\].
    pub tick_hz: u32,
    /// The last tick that was recorded.
    pub last_tick: u64,
    /// Version of the program that made it.
    pub version: String,
    /// Whether the file ends as a finished one does.
    pub whole: bool,
    /// UAVs, then distractors, by the order in which they were recorded.
    pub uavs: Vec<(String, Series<UavAt>)>,
    /// The cameras.
    pub cameras: Vec<CameraTrack>,
    /// The stations.
    pub stations: Vec<StationTrack>,
    /// The log.
    pub events: Vec<Event>,
    /// The buildings: boxes on the ground as their corners, in order \[m, east and north\].
    pub buildings: Vec<[DVec2; 4]>,
}

impl Timeline {
    /// Sorts a recording by what it is about; messages that cannot be read are left out.
    pub fn of(recorded: &Recorded) -> Self {
        let mut timeline = Self {
            path: recorded.path.clone(),
            tick_hz: recorded.tick_hz,
            version: recorded.version.clone(),
            whole: recorded.is_whole(),
            ..Self::default()
        };
        let mut places = Places::default();
        for message in recorded.messages() {
            let tick = recorded.tick(&message);
            // A message whose schema has changed says nothing; the others still do.
            if timeline.take(&message, tick, &mut places).is_ok() {
                timeline.last_tick = timeline.last_tick.max(tick);
            }
        }
        // In its first tick a UAV's place is met before its name.
        timeline
            .cameras
            .retain(|camera| !places.uavs.contains_key(&camera.name));
        if let Ok(loaded) = recorded.scenario(&[])
            && let Some(first) = loaded.scenario.stations().first()
            && let Some(station) = timeline.stations.iter_mut().find(|s| s.prefix.is_empty())
        {
            station.name.clone_from(&first.name);
        }
        timeline
    }

    /// The tick nearest to a simulated time \[s\].
    pub fn tick_at(&self, t_s: f64) -> u64 {
        (t_s * f64::from(self.tick_hz)).round() as u64
    }

    /// Simulated time of a tick \[s\].
    pub fn t_s(&self, tick: u64) -> f64 {
        tick as f64 / f64::from(self.tick_hz)
    }

    /// The cameras of a station.
    pub fn cameras_of<'a>(
        &'a self,
        station: &'a StationTrack,
    ) -> impl Iterator<Item = &'a CameraTrack> {
        let own = |camera: &&CameraTrack| match camera.name.split_once('/') {
            Some((prefix, _)) => prefix == station.prefix,
            None => station.prefix.is_empty(),
        };
        self.cameras.iter().filter(own)
    }

    /// Where a station stands \[m\]: with its cameras.
    pub fn r_enu_m(&self, station: &StationTrack) -> Option<DVec3> {
        let mut poses = self.cameras_of(station).map(|camera| &camera.poses);
        poses.find_map(|poses| Some(poses.entries().first()?.1.0))
    }

    /// Puts one message into its place.
    fn take(
        &mut self,
        message: &Message,
        tick: u64,
        places: &mut Places,
    ) -> Result<(), prost::DecodeError> {
        let topic = message.channel.topic.as_str();
        let data = &message.data[..];
        match topic {
            "/tf" => {
                for transform in FrameTransforms::decode(data)?.transforms {
                    let (Some(r), Some(q)) = (transform.translation, transform.rotation) else {
                        continue;
                    };
                    let name = transform.child_frame_id;
                    if places.uavs.contains_key(&name) {
                        continue;
                    }
                    let pose = (
                        DVec3::new(r.x, r.y, r.z),
                        DQuat::from_xyzw(q.x, q.y, q.z, q.w),
                    );
                    self.camera(&name, places).poses.push(tick, pose);
                }
            }
            // The city is recorded once, before anything moves.
            "/scene" if tick == 0 && self.buildings.is_empty() => {
                let entities = SceneUpdate::decode(data)?.entities;
                let city = entities.into_iter().filter(|entity| entity.id == CITY);
                self.buildings = city
                    .flat_map(|city| city.cubes)
                    .filter_map(ground_plan)
                    .collect();
            }
            "/log" => {
                let log = Log::decode(data)?;
                self.events.push(Event {
                    tick,
                    part: log.name,
                    text: log.message,
                });
            }
            "/boresight/uav_state" => {
                let state = proto::UavState::decode(data)?;
                let place = *places.uavs.entry(state.name.clone()).or_insert_with(|| {
                    self.uavs.push((state.name.clone(), Series::default()));
                    self.uavs.len() - 1
                });
                let series = &mut self.uavs[place].1;
                // Thousands of equal words are one.
                let status = match series.0.last() {
                    Some((_, last)) if *last.status == *state.status => last.status.clone(),
                    _ => state.status.into(),
                };
                let r = state.r_enu_m.unwrap_or_default();
                let q = state.q_enu_body.unwrap_or_default();
                let at = UavAt {
                    r_enu_m: DVec3::new(r.x, r.y, r.z),
                    q_enu_body: DQuat::from_xyzw(q.x, q.y, q.z, q.w),
                    skin_k: state.skin_temperature_k,
                    status,
                };
                series.push(tick, at);
            }
            "/boresight/miss_distance" => {
                let miss = proto::MissDistance::decode(data)?;
                let camera = self.camera(&miss.camera, places);
                camera.miss_px.push(tick, miss.miss_px);
            }
            _ => self.take_by_owner(topic, data, tick, places)?,
        }
        Ok(())
    }

    /// Messages whose topics name a station or camera.
    fn take_by_owner(
        &mut self,
        topic: &str,
        data: &[u8],
        tick: u64,
        places: &mut Places,
    ) -> Result<(), prost::DecodeError> {
        let Some((owner, kind)) = topic.strip_prefix('/').and_then(|t| t.rsplit_once('/')) else {
            return Ok(());
        };
        let station = owner.strip_prefix("boresight").map(|s| s.trim_matches('/'));
        match (station, kind) {
            (Some(prefix), "mount_state") => {
                let state = proto::MountState::decode(data)?;
                self.station(prefix).mount.push(tick, state);
            }
            (Some(prefix), "track_state") => {
                let state = proto::TrackState::decode(data)?;
                self.station(prefix).track.push(tick, state);
            }
            (Some(prefix), "beam_state") => {
                let state = proto::BeamState::decode(data)?;
                self.station(prefix).beam.push(tick, state);
            }
            (None, "image") => {
                let image = CompressedImage::decode(data)?;
                let camera = self.camera(owner, places);
                camera.stamps.push(tick, stamp(image.timestamp));
                camera.pictures.push(tick, Arc::new(image.data.to_vec()));
            }
            (None, "calibration") => {
                let calibration = CameraCalibration::decode(data)?;
                let size_px = [calibration.width, calibration.height];
                self.camera(owner, places).sizes_px.push(tick, size_px);
            }
            (None, "annotations") => {
                let annotations = ImageAnnotations::decode(data)?;
                let stamp = stamp(annotations.timestamp);
                let camera = self.camera(owner, places);
                camera.marks.insert(stamp, marks(annotations));
            }
            _ => {}
        }
        Ok(())
    }

    fn camera(&mut self, name: &str, places: &mut Places) -> &mut CameraTrack {
        let place = *places.cameras.entry(name.to_owned()).or_insert_with(|| {
            self.cameras.push(CameraTrack {
                name: name.to_owned(),
                ..CameraTrack::default()
            });
            self.cameras.len() - 1
        });
        &mut self.cameras[place]
    }

    fn station(&mut self, prefix: &str) -> &mut StationTrack {
        let found = self.stations.iter().position(|s| s.prefix == prefix);
        let place = found.unwrap_or_else(|| {
            self.stations.push(StationTrack {
                name: prefix.to_owned(),
                prefix: prefix.to_owned(),
                ..StationTrack::default()
            });
            self.stations.len() - 1
        });
        &mut self.stations[place]
    }
}

/// The corners of a box from above \[m, east and north\].
fn ground_plan(cube: CubePrimitive) -> Option<[DVec2; 4]> {
    let (pose, size) = (cube.pose?, cube.size?);
    let (r, q) = (pose.position?, pose.orientation?);
    let q = DQuat::from_xyzw(q.x, q.y, q.z, q.w);
    let corner = |(x, y): (f64, f64)| {
        let off_m = q * DVec3::new(0.5 * x * size.x, 0.5 * y * size.y, 0.0);
        DVec2::new(r.x + off_m.x, r.y + off_m.y)
    };
    Some([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(corner))
}

/// Places of UAVs and cameras by their names.
#[derive(Default)]
struct Places {
    uavs: BTreeMap<String, usize>,
    cameras: BTreeMap<String, usize>,
}

fn stamp(of: Option<Timestamp>) -> (u32, u32) {
    of.map_or((0, 0), |stamp| (stamp.sec(), stamp.nsec()))
}

/// Boxes and reticle of an annotation message.
fn marks(annotations: ImageAnnotations) -> Marks {
    let mut marks = Marks::default();
    let labels = annotations.texts.into_iter().map(|text| text.text);
    let mut labels = labels.chain(std::iter::repeat(String::new()));
    for shape in annotations.points {
        let points = shape.points.iter().map(|p| [p.x, p.y]);
        let [low, high] = points.fold([[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]], |b, p| {
            [
                [b[0][0].min(p[0]), b[0][1].min(p[1])],
                [b[1][0].max(p[0]), b[1][1].max(p[1])],
            ]
        });
        if shape.r#type == i32::from(Type::LineLoop) {
            let said = |key: &str| {
                let pair = shape.metadata.iter().find(|pair| pair.key == key)?;
                Some(pair.value.as_str())
            };
            let weak = said(COUNTS) == Some("false");
            // Recordings of earlier versions have a text for each box, and nothing else of it.
            let text = if weak { None } else { labels.next() };
            let score = said(SCORE).and_then(|score| score.parse::<f64>().ok());
            let class = said(CLASS).map(str::to_owned).or(text).unwrap_or_default();
            marks.boxes.push(Mark {
                rect_px: [low[0], low[1], high[0], high[1]],
                label: score.map_or(class.clone(), |score| format!("{class} {score:.2}")),
                weak,
            });
        } else if shape.r#type == i32::from(Type::LineList) {
            marks.reticle_px = Some([0, 1].map(|i| 0.5 * (low[i] + high[i])));
        }
    }
    marks
}
