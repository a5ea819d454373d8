//! The recorder: what happened in a tick becomes messages, and the tick is handed on when it is over.

use crate::annotations::{BoxAnnotation, annotations};
use crate::error::RecordingError;
use crate::file::Mcap;
use crate::live::Live;
use crate::scene::{FrameTransform, SceneEntity, quaternion, vector};
use crate::sink::{Content, OneTick, Picture, Sink, Written};
use crate::topics::{
    ANNOTATIONS, CALIBRATION, CAMERAS, IMAGE, LOCATION, LOG, Meta, OwnMessage, SCENE, TF, channels,
    encoding,
};
use crate::{LogLevel, OF_STATION, OWN_CHANNELS};
use foxglove::Schema;
use foxglove::messages::{
    self as fg, CameraCalibration, CompressedImage, FrameTransforms, LocationFix, SceneUpdate,
    Timestamp, location_fix,
};
use std::net::SocketAddr;
use std::num::NonZeroU32;
use std::path::Path;
use std::sync::mpsc;
use std::thread::JoinHandle;

/// Ticks that may wait for being written: a killed run loses them.
const WAITING_TICKS: usize = 16;

/// Nanoseconds in a second.
pub(crate) const NS: u64 = 1_000_000_000;

/// Simulated time of a tick \[ns\], rounded down, exact for any tick.
pub fn log_time_ns(tick: u64, tick_hz: NonZeroU32) -> u64 {
    let ns = u128::from(tick) * 1_000_000_000 / u128::from(tick_hz.get());
    u64::try_from(ns).unwrap_or(u64::MAX)
}

/// Makes one recording.
///
/// Every method takes the tick of the message; ticks may not decrease. Dropping it closes the file as
/// [`Recorder::finish`] does, without saying whether that worked.
pub struct Recorder {
    /// Takes the ticks that are over; `None` once closed.
    ticks: Option<mpsc::SyncSender<OneTick>>,
    /// What writes them; `None` once its result is known.
    writer: Option<JoinHandle<Result<Written, RecordingError>>>,
    live_address: Option<SocketAddr>,
    epoch_unix_ns: u64,
    tick_hz: NonZeroU32,
    cameras: Vec<String>,
    more_stations: usize,
    tick: Option<u64>,
    messages: Vec<(usize, Content)>,
    encoded: Vec<u8>,
}

impl Recorder {
    /// Listens on the address `live` and creates the file, with the run's scenario, seed and version already on the
    /// disk on return; each where it is asked for.
    pub fn create(
        file: Option<&Path>,
        live: Option<SocketAddr>,
        meta: &Meta,
    ) -> Result<Self, RecordingError> {
        let serve = |address| {
            let with_encoding = |(topic, schema): (String, Option<Schema>)| {
                (topic, encoding(schema.as_ref()), schema)
            };
            let channels = channels(meta).into_iter().map(with_encoding).collect();
            Live::start(address, meta.scenario_name, meta.epoch_unix_ns, channels)
        };
        let sink = Sink {
            live: live.map(serve).transpose()?,
            file: file.map(|path| Mcap::create(path, meta)).transpose()?,
            written: Written::default(),
        };
        Self::into_sink(sink, meta)
    }

    /// Starts the thread that writes.
    pub(crate) fn into_sink(sink: Sink, meta: &Meta) -> Result<Self, RecordingError> {
        let live_address = sink.live.as_ref().map(Live::address);
        let (ticks, to_write) = mpsc::sync_channel(WAITING_TICKS);
        let writer = std::thread::Builder::new()
            .name("recorder".into())
            .spawn(move || sink.run(to_write))
            .map_err(RecordingError::Thread)?;
        Ok(Self {
            ticks: Some(ticks),
            writer: Some(writer),
            live_address,
            epoch_unix_ns: meta.epoch_unix_ns,
            tick_hz: meta.tick_hz,
            cameras: meta.cameras.iter().map(ToString::to_string).collect(),
            more_stations: meta.more_stations.len(),
            tick: None,
            messages: Vec::new(),
            encoded: Vec::new(),
        })
    }

    /// Where it is served, if it is.
    pub fn live_address(&self) -> Option<SocketAddr> {
        self.live_address
    }

    /// Records the frames that moved.
    pub fn frame_transforms(
        &mut self,
        tick: u64,
        transforms: &[FrameTransform],
    ) -> Result<(), RecordingError> {
        let timestamp = self.timestamp(tick);
        let transforms = transforms
            .iter()
            .map(|transform| fg::FrameTransform {
                timestamp,
                parent_frame_id: transform.parent.to_owned(),
                child_frame_id: transform.child.to_owned(),
                translation: Some(vector(transform.translation_m)),
                rotation: Some(quaternion(transform.rotation)),
            })
            .collect();
        self.push(tick, TF, &FrameTransforms { transforms })
    }

    /// Records new or changed things of the three-dimensional scene.
    pub fn scene_update(
        &mut self,
        tick: u64,
        entities: &[SceneEntity],
    ) -> Result<(), RecordingError> {
        let timestamp = self.timestamp(tick);
        let entities = entities
            .iter()
            .map(|entity| {
                // Rounded up by a nanosecond so that it covers the gap to the next tick.
                let lifetime = (entity.lifetime_ticks > 0)
                    .then(|| log_time_ns(entity.lifetime_ticks.into(), self.tick_hz) + 1)
                    .map(|ns| {
                        let s = i32::try_from(ns / NS).unwrap_or(i32::MAX);
                        fg::Duration::new(s, (ns % NS) as u32)
                    });
                let mut out = fg::SceneEntity {
                    timestamp,
                    frame_id: entity.frame.to_owned(),
                    id: entity.id.to_owned(),
                    lifetime,
                    ..Default::default()
                };
                for shape in entity.shapes {
                    shape.add_to(&mut out);
                }
                out
            })
            .collect();
        self.push(
            tick,
            SCENE,
            &SceneUpdate {
                deletions: Vec::new(),
                entities,
            },
        )
    }

    /// Records the picture that a camera, by its number, exposed at this tick.
    pub fn picture(
        &mut self,
        tick: u64,
        camera: usize,
        picture: Picture,
    ) -> Result<(), RecordingError> {
        self.begin(tick)?;
        let message = CompressedImage {
            timestamp: self.timestamp(tick),
            frame_id: self.cameras[camera].clone(),
            format: "jpeg".to_owned(),
            ..Default::default()
        };
        let message = Content::Picture(picture, Box::new(message));
        self.messages.push((CAMERAS + 3 * camera + IMAGE, message));
        Ok(())
    }

    /// Records boxes and the reticle \[px\] on the image that was exposed at `exposure_tick`.
    pub fn image_annotations(
        &mut self,
        tick: u64,
        exposure_tick: u64,
        camera: usize,
        boxes: &[BoxAnnotation],
        reticle_px: [f64; 2],
    ) -> Result<(), RecordingError> {
        let timestamp = self.timestamp(exposure_tick);
        let message = annotations(timestamp, boxes, reticle_px);
        self.push(tick, CAMERAS + 3 * camera + ANNOTATIONS, &message)
    }

    /// Records a camera's intrinsics: image size \[px\] and row-major K \[px\]; again on every zoom.
    pub fn camera_calibration(
        &mut self,
        tick: u64,
        camera: usize,
        width_px: u32,
        height_px: u32,
        k_px: [f64; 9],
    ) -> Result<(), RecordingError> {
        let [fx, s, cx, z0, fy, cy, z1, z2, w] = k_px;
        let message = CameraCalibration {
            timestamp: self.timestamp(tick),
            frame_id: self.cameras[camera].clone(),
            width: width_px,
            height: height_px,
            distortion_model: "plumb_bob".to_owned(),
            d: vec![0.0; 5],
            k: k_px.into(),
            r: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            p: vec![fx, s, cx, 0.0, z0, fy, cy, 0.0, z1, z2, w, 0.0],
        };
        self.push(tick, CAMERAS + 3 * camera + CALIBRATION, &message)
    }

    /// Records where `frame` lies on the Earth: WGS 84 latitude, longitude \[deg\], height \[m\].
    pub fn location_fix(
        &mut self,
        tick: u64,
        frame: &str,
        latitude_deg: f64,
        longitude_deg: f64,
        altitude_m: f64,
    ) -> Result<(), RecordingError> {
        let message = LocationFix {
            timestamp: self.timestamp(tick),
            frame_id: frame.to_owned(),
            latitude: latitude_deg,
            longitude: longitude_deg,
            altitude: altitude_m,
            position_covariance: vec![0.0; 9],
            position_covariance_type: location_fix::PositionCovarianceType::Known.into(),
            ..Default::default()
        };
        self.push(tick, LOCATION, &message)
    }

    /// Records an event of the part called `name`.
    pub fn log(
        &mut self,
        tick: u64,
        level: LogLevel,
        name: &str,
        text: &str,
    ) -> Result<(), RecordingError> {
        let message = fg::Log {
            timestamp: self.timestamp(tick),
            level: level.into(),
            message: text.to_owned(),
            name: name.to_owned(),
            ..Default::default()
        };
        self.push(tick, LOG, &message)
    }

    /// Records one of the project's own messages on its topic, the first station's where each has one.
    pub fn own<M: OwnMessage>(&mut self, tick: u64, message: &M) -> Result<(), RecordingError> {
        self.push(tick, self.first_own() + M::INDEX, message)
    }

    /// Records the state of a station, by its number.
    pub fn of_station<M: OwnMessage>(
        &mut self,
        tick: u64,
        station: usize,
        message: &M,
    ) -> Result<(), RecordingError> {
        if station == 0 || !OF_STATION.contains(&M::INDEX) {
            return self.own(tick, message);
        }
        let further = OF_STATION.len() * (station - 1) + M::INDEX - OF_STATION.start;
        self.push(
            tick,
            self.first_own() + OWN_CHANNELS.len() + further,
            message,
        )
    }

    /// Records a message on a topic of a caller's own, by its number; `json` is its text.
    pub fn json(&mut self, tick: u64, topic: usize, json: &[u8]) -> Result<(), RecordingError> {
        let own = OWN_CHANNELS.len() + OF_STATION.len() * self.more_stations;
        self.place(tick, self.first_own() + own + topic, |encoded| {
            encoded.extend_from_slice(json);
            Ok(())
        })
    }

    /// Place of the first own channel.
    fn first_own(&self) -> usize {
        CAMERAS + 3 * self.cameras.len()
    }

    /// Writes what is left and closes the file; how large it has become.
    pub fn finish(mut self) -> Result<Written, RecordingError> {
        self.close()
    }

    fn unix_ns(&self, tick: u64) -> u64 {
        self.epoch_unix_ns
            .saturating_add(log_time_ns(tick, self.tick_hz))
    }

    fn timestamp(&self, tick: u64) -> Option<Timestamp> {
        let ns = self.unix_ns(tick);
        u32::try_from(ns / NS)
            .ok()
            .map(|s| Timestamp::new(s, (ns % NS) as u32))
    }

    /// Encodes a message and keeps it until its tick is over.
    fn push(
        &mut self,
        tick: u64,
        channel: usize,
        message: &impl prost::Message,
    ) -> Result<(), RecordingError> {
        self.place(tick, channel, |encoded| Ok(message.encode(encoded)?))
    }

    /// Keeps what `encode` appends until its tick is over.
    fn place(
        &mut self,
        tick: u64,
        channel: usize,
        encode: impl FnOnce(&mut Vec<u8>) -> Result<(), RecordingError>,
    ) -> Result<(), RecordingError> {
        self.begin(tick)?;
        let start = self.encoded.len();
        encode(&mut self.encoded)?;
        let message = Content::Encoded(start..self.encoded.len());
        self.messages.push((channel, message));
        Ok(())
    }

    /// Goes on to a tick, if it is a new one.
    fn begin(&mut self, tick: u64) -> Result<(), RecordingError> {
        match self.tick {
            Some(last) if tick < last => Err(RecordingError::Backwards { tick, last }),
            Some(last) if tick == last => Ok(()),
            _ => {
                self.end_tick()?;
                self.tick = Some(tick);
                Ok(())
            }
        }
    }

    /// Hands on the messages of the tick that is over.
    fn end_tick(&mut self) -> Result<(), RecordingError> {
        let Some(tick) = self.tick else {
            return Ok(());
        };
        let mut messages = std::mem::take(&mut self.messages);
        messages.sort_by_key(|(channel, _)| *channel);
        let over = OneTick {
            log_time_ns: self.unix_ns(tick),
            messages,
            encoded: std::mem::take(&mut self.encoded),
        };
        match self.ticks.as_ref().map(|ticks| ticks.send(over)) {
            Some(Ok(())) => Ok(()),
            // The thread has ended before its time, and says why.
            Some(Err(_)) | None => self.ended().and(Err(RecordingError::Ended)),
        }
    }

    /// Waits for the end of what has been handed on.
    fn ended(&mut self) -> Result<Written, RecordingError> {
        drop(self.ticks.take());
        let result = self.writer.take().map(JoinHandle::join);
        result.map_or(Ok(Written::default()), |result| {
            result.unwrap_or(Err(RecordingError::Ended))
        })
    }

    fn close(&mut self) -> Result<Written, RecordingError> {
        if self.writer.is_none() {
            return Err(RecordingError::Ended);
        }
        self.end_tick()?;
        self.ended()
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        // `finish` reports failures; nobody is left to be told here.
        let _ = self.close();
    }
}
