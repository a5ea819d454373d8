#![doc = include_str!("../README.md")]

use std::{
    collections::BTreeMap,
    fs::File,
    io::{self, BufWriter, Write},
    net::SocketAddr,
    num::NonZeroU32,
    ops::Range,
    path::{Path, PathBuf},
    sync::{Arc, mpsc},
    thread::JoinHandle,
};

use crate::media::image::{ImageError, encode_within};
use boresight_common::warning::Warning;
use foxglove::{
    Encode, Schema,
    messages::{
        self as fg, CameraCalibration, Color, CompressedImage, FrameTransforms, ImageAnnotations,
        LocationFix, Point2, Point3, Pose, Quaternion, SceneUpdate, Timestamp, Vector3,
        line_primitive, location_fix, points_annotation,
    },
};
use mcap::{
    Attachment, Compression, McapError, WriteOptions, Writer,
    records::{MessageHeader, Metadata},
    write::NoSeek,
};

pub mod film;
pub mod live;
pub mod media;
pub mod read;
pub mod timeline;

use live::{Live, LiveError};

pub use foxglove::messages::log::Level as LogLevel;

/// The project's own messages, generated from `proto/boresight.proto`.
pub mod proto {
    include!(concat!(env!("OUT_DIR"), "/boresight.rs"));
}

/// The descriptor set of [`proto`], which every own channel carries as its schema.
const DESCRIPTORS: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/boresight.bin"));

/// Simulated time after which a chunk is closed and handed to the system: what a killed run loses.
const CHUNK_NS: u64 = 250_000_000; // [ns]
/// Encoded size after which a chunk is closed early, so that images do not pile up in memory.
const CHUNK_BYTES: usize = 1 << 20; // [byte]

/// Why a recording could not be made.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file could not be created.
    #[error("{}: the recording cannot be created: {source}; name a folder that can be written with --out", path.display())]
    Create {
        /// The file asked for.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// There is no room left where the recording lies.
    #[error("{}: the disk is full, and the recording cut short; make room, or name another folder with --out", path.display())]
    DiskFull {
        /// The recording.
        path: PathBuf,
    },
    /// Writing failed for another reason.
    #[error("{}: the recording cannot be written: {source}; name a folder that can be written with --out", path.display())]
    Write {
        /// The recording.
        path: PathBuf,
        /// What the MCAP writer said.
        source: McapError,
    },
    /// A message could not be encoded.
    #[error("a message cannot be encoded: {0}; this is a fault of the program: please report it")]
    Encode(#[from] prost::EncodeError),
    /// A message is older than the last one.
    #[error(
        "message of tick {tick} after tick {last}: a recording runs forwards; this is a fault of the program: please report it"
    )]
    Backwards {
        /// Tick of the late message.
        tick: u64,
        /// Newest tick written.
        last: u64,
    },
    /// It cannot be served.
    #[error(transparent)]
    Live(#[from] LiveError),
    /// A picture could not be encoded.
    #[error("a picture cannot be recorded: {0}; this is a fault of the program: please report it")]
    Picture(#[from] ImageError),
    /// The thread that writes could not be started.
    #[error(
        "the thread that writes the recording cannot be started: {0}; let the system have more threads (ulimit -u)"
    )]
    Thread(io::Error),
    /// It has failed before.
    #[error("the recording has ended; the error before this one says why")]
    Ended,
}

/// What a recording says about its run, written before the first message so that a killed run has it.
#[derive(Clone, Copy, Debug)]
pub struct Meta<'a> {
    /// Name of the scenario.
    pub scenario_name: &'a str,
    /// The whole scenario file.
    pub scenario_toml: &'a str,
    /// The `key=value` overrides it was run with.
    pub overrides: &'a [String],
    /// Seed of every random stream.
    pub seed: u64,
    /// Whether its cameras render.
    pub pictures: bool,
    /// Version of the program.
    pub version: &'a str,
    /// UTC time of tick 0 since 1970-01-01 \[ns\].
    pub epoch_unix_ns: u64,
    /// Ticks per simulated second \[Hz\].
    pub tick_hz: NonZeroU32,
    /// Names of the cameras: first part of their topics, frame of their images, `camera` of the own messages.
    pub cameras: &'a [&'a str],
    /// Names of the stations after the first, whose states have topics of their own.
    pub more_stations: &'a [&'a str],
    /// Topics of a caller's own.
    pub own_topics: &'a [OwnTopic],
}

/// A topic of a caller's own, whose messages are JSON.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OwnTopic {
    /// Its name, such as `/mine/wind`.
    pub topic: String,
    /// Name of its schema.
    pub schema_name: String,
    /// The JSON Schema of its messages, as text.
    pub schema: String,
}

/// The pose of `child` in `parent`.
#[derive(Clone, Copy, Debug)]
pub struct FrameTransform<'a> {
    /// Parent frame.
    pub parent: &'a str,
    /// Child frame.
    pub child: &'a str,
    /// Origin of `child` in `parent` \[m\].
    pub translation_m: [f64; 3],
    /// Unit quaternion (x, y, z, w) that rotates a `child` vector into `parent`.
    pub rotation: [f64; 4],
}

/// A red, green, blue, alpha colour, 0 to 1 each.
pub type Rgba = [f64; 4];

/// One shape of a scene entity, in the entity's frame.
#[derive(Clone, Debug)]
pub enum SceneShape<'a> {
    /// A cuboid.
    Cube {
        /// Centre \[m\].
        centre_m: [f64; 3],
        /// Unit quaternion (x, y, z, w) from the cuboid's axes to the frame's.
        rotation: [f64; 4],
        /// Edge lengths \[m\].
        size_m: [f64; 3],
        /// Colour.
        colour: Rgba,
    },
    /// A sphere.
    Sphere {
        /// Centre \[m\].
        centre_m: [f64; 3],
        /// Diameter \[m\].
        diameter_m: f64,
        /// Colour.
        colour: Rgba,
    },
    /// A line through points.
    Line {
        /// Points \[m\].
        points_m: &'a [[f64; 3]],
        /// Width \[m\].
        width_m: f64,
        /// Colour.
        colour: Rgba,
    },
}

/// One thing of the three-dimensional scene; a later one with the same `id` replaces it.
#[derive(Clone, Debug)]
pub struct SceneEntity<'a> {
    /// Identity within the scene.
    pub id: &'a str,
    /// Frame of its shapes.
    pub frame: &'a str,
    /// How long it is shown \[tick\]; 0 is for ever.
    pub lifetime_ticks: u32,
    /// What it is made of.
    pub shapes: &'a [SceneShape<'a>],
}

/// One labelled box on an image.
#[derive(Clone, Copy, Debug)]
pub struct BoxAnnotation<'a> {
    /// Class of what it holds.
    pub label: &'a str,
    /// Box as x0, y0, x1, y1 \[px\].
    pub rect_px: [f64; 4],
    /// Score of the detection, 0 to 1.
    pub score: f64,
    /// Whether that is below the threshold.
    pub weak: bool,
}

/// Name of the city among the things of the scene.
pub const CITY: &str = "city";

/// Colours of what counts by itself, and of what does not.
const STRONG: Rgba = [0.0, 0.62, 0.45, 1.0];
const WEAK: Rgba = [0.6, 0.6, 0.6, 0.35];

/// What the annotation of a box says besides, by key.
const CLASS: &str = "class";
const SCORE: &str = "score";
const COUNTS: &str = "counts";

impl BoxAnnotation<'_> {
    fn metadata(&self) -> Vec<fg::KeyValuePair> {
        let pair = |key: &str, value: String| fg::KeyValuePair {
            key: key.to_owned(),
            value,
        };
        vec![
            pair(CLASS, self.label.to_owned()),
            pair(SCORE, format!("{:.3}", self.score)),
            pair(COUNTS, (!self.weak).to_string()),
        ]
    }
}

/// One of the project's own messages with its place among the channels.
pub trait OwnMessage: prost::Message {
    /// Its index among the own channels.
    const INDEX: usize;
}

// One for each message of the proto file that is a topic.
include!(concat!(env!("OUT_DIR"), "/topics.rs"));

// Places of the other channels; each camera has three in a row.
const TF: usize = 0;
const SCENE: usize = 1;
const LOCATION: usize = 2;
const LOG: usize = 3;
const CAMERAS: usize = 4;
const IMAGE: usize = 0;
const ANNOTATIONS: usize = 1;
const CALIBRATION: usize = 2;

/// Every topic with its schema, in the order of their channels.
fn channels(meta: &Meta) -> Vec<(String, Option<Schema>)> {
    let json = |own: &OwnTopic| {
        let schema = own.schema.clone().into_bytes();
        let schema = Schema::new(own.schema_name.clone(), "jsonschema", schema);
        (own.topic.clone(), Some(schema))
    };
    let mut channels = vec![
        ("/tf".to_owned(), FrameTransforms::get_schema()),
        ("/scene".to_owned(), SceneUpdate::get_schema()),
        ("/site/location".to_owned(), LocationFix::get_schema()),
        ("/log".to_owned(), fg::Log::get_schema()),
    ];
    for camera in meta.cameras {
        channels.extend([
            (format!("/{camera}/image"), CompressedImage::get_schema()),
            (
                format!("/{camera}/annotations"),
                ImageAnnotations::get_schema(),
            ),
            (
                format!("/{camera}/calibration"),
                CameraCalibration::get_schema(),
            ),
        ]);
    }
    let own = |name: &str| Some(Schema::new(name, "protobuf", DESCRIPTORS));
    channels.extend(OWN_CHANNELS.map(|(topic, name)| (topic.to_owned(), own(name))));
    for station in meta.more_stations {
        channels.extend(OWN_CHANNELS[OF_STATION].iter().map(|(topic, name)| {
            let topic = topic.replacen("/boresight/", &format!("/boresight/{station}/"), 1);
            (topic, own(name))
        }));
    }
    channels.extend(meta.own_topics.iter().map(json));
    channels
}

/// Message encoding of a channel with that schema.
fn encoding(schema: Option<&Schema>) -> &'static str {
    if schema.is_some_and(|schema| schema.encoding == "jsonschema") {
        "json"
    } else {
        "protobuf"
    }
}

/// Simulated time of a tick \[ns\], rounded down, exact for any tick.
pub fn log_time_ns(tick: u64, tick_hz: NonZeroU32) -> u64 {
    let ns = u128::from(tick) * 1_000_000_000 / u128::from(tick_hz.get());
    u64::try_from(ns).unwrap_or(u64::MAX)
}

/// A picture to be recorded as JPEG.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Rows of red, green and blue bytes.
    pub rgb8: Arc<Vec<u8>>,
    /// Width and height \[px\].
    pub size_px: [u16; 2],
    /// The best JPEG quality, 1 to 100.
    pub quality: u8,
    /// Most bytes that it takes, in a lower quality if need be.
    pub most_bytes: usize,
}

/// A message to be written.
enum Content {
    /// Where it lies among the encoded messages of the tick.
    Encoded(Range<usize>),
    /// A picture still to be encoded, and its message without it.
    Picture(Picture, Box<CompressedImage>),
}

/// The messages of one tick, in the order of their channels.
struct OneTick {
    log_time_ns: u64,
    messages: Vec<(usize, Content)>,
    encoded: Vec<u8>,
}

/// Where messages go.
struct Sink {
    file: Option<Mcap>,
    live: Option<Live>,
    written: Written,
}

/// How large a recording has become.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Written {
    /// Length of the file; 0 without one \[byte\].
    pub bytes: u64,
    /// Length of the pictures in it, and in what was served \[byte\].
    pub picture_bytes: u64,
}

/// What a recording takes of a disk in a simulated second before its user is warned \[byte/s\]: 14 GB an hour.
const MUCH_BYTES_PER_S: f64 = 4e6;
/// What a shorter run takes says little: city and first pictures weigh more in it \[s\].
const SHORT_S: f64 = 2.0;

impl Written {
    /// A warning where so much was written in `simulated_s` \[s\] that it should not go on so for long.
    pub fn warning(&self, path: &Path, simulated_s: f64) -> Option<Warning> {
        let [all, pictures] = [self.bytes, self.picture_bytes].map(|bytes| bytes as f64);
        let rate = all / simulated_s;
        let much = all > MUCH_BYTES_PER_S * simulated_s.max(SHORT_S);
        (much && simulated_s > 0.0).then(|| Warning {
            file: path.to_owned(),
            place: "size".into(),
            what: format!(
                "{:.0} MB, {:.1} MB a simulated second, {:.0} % of it pictures",
                1e-6 * all,
                1e-6 * rate,
                100.0 * pictures / all
            ),
            mend: "keep fewer or coarser ones by record.images = { every = 4 } or a lower record.picture_bits_per_px"
                .into(),
        })
    }
}

impl Sink {
    fn write(&mut self, tick: OneTick) -> Result<(), RecordingError> {
        let log_time_ns = tick.log_time_ns;
        if let Some(live) = &mut self.live {
            live.set_clock(log_time_ns);
        }
        for (channel, message) in tick.messages {
            match message {
                Content::Encoded(range) => self.send(channel, log_time_ns, &tick.encoded[range])?,
                Content::Picture(picture, mut message) => {
                    let Picture {
                        rgb8,
                        size_px,
                        quality,
                        most_bytes,
                    } = picture;
                    let jpeg = encode_within(&rgb8, size_px, quality, most_bytes)?;
                    self.written.picture_bytes += jpeg.len() as u64;
                    message.data = jpeg.into();
                    let message = prost::Message::encode_to_vec(&*message);
                    self.send(channel, log_time_ns, &message)?;
                }
            }
        }
        self.file.as_mut().map_or(Ok(()), |file| {
            let ended = file.end_tick(log_time_ns);
            ended.map_err(|source| write_error(&file.path, source))
        })
    }

    fn send(
        &mut self,
        channel: usize,
        log_time_ns: u64,
        message: &[u8],
    ) -> Result<(), RecordingError> {
        if let Some(live) = &mut self.live {
            live.send(channel, log_time_ns, message);
        }
        self.file.as_mut().map_or(Ok(()), |file| {
            let written = file.write(channel, log_time_ns, message);
            written.map_err(|source| write_error(&file.path, source))
        })
    }

    /// Writes ticks until there are no more, and closes the file.
    fn run(mut self, ticks: mpsc::Receiver<OneTick>) -> Result<Written, RecordingError> {
        let written = ticks.into_iter().try_for_each(|tick| self.write(tick));
        let closed = self.file.map_or(Ok(0), Mcap::close);
        written.and(closed).map(|bytes| Written {
            bytes,
            ..self.written
        })
    }
}

/// Ticks that may wait for being written: a killed run loses them.
const WAITING_TICKS: usize = 16;

/// The file of a recording.
struct Mcap {
    path: PathBuf,
    /// It never seeks: a chunk reaches the file whole or not at all.
    writer: Writer<NoSeek<BufWriter<File>>>,
    /// MCAP id and next sequence number of each channel.
    channels: Vec<(u16, u32)>,
    chunk_start_ns: Option<u64>,
    chunk_bytes: usize,
}

impl Mcap {
    fn create(path: &Path, meta: &Meta) -> Result<Self, RecordingError> {
        let file = File::create(path).map_err(|source| RecordingError::Create {
            path: path.to_owned(),
            source,
        })?;
        Self::start(file, path, meta).map_err(|source| write_error(path, source))
    }

    fn start(file: File, path: &Path, meta: &Meta) -> Result<Self, McapError> {
        let mut writer = WriteOptions::new()
            .profile("boresight")
            .library("boresight")
            .compression(Some(Compression::Lz4))
            .chunk_size(None)
            .disable_seeking(true)
            .create(NoSeek::new(BufWriter::new(file)))?;
        for (name, media_type, text) in [
            ("scenario.toml", "application/toml", meta.scenario_toml),
            (
                "overrides.txt",
                "text/plain",
                meta.overrides.join("\n").as_str(),
            ),
            ("seed.txt", "text/plain", meta.seed.to_string().as_str()),
            ("version.txt", "text/plain", meta.version),
        ] {
            writer.attach(&Attachment {
                log_time: meta.epoch_unix_ns,
                create_time: meta.epoch_unix_ns,
                name: name.to_owned(),
                media_type: media_type.to_owned(),
                data: text.as_bytes().into(),
            })?;
        }
        writer.write_metadata(&Metadata {
            name: "boresight".to_owned(),
            metadata: BTreeMap::from(
                [
                    ("scenario", meta.scenario_name.to_owned()),
                    ("seed", meta.seed.to_string()),
                    ("version", meta.version.to_owned()),
                    ("epoch_unix_ns", meta.epoch_unix_ns.to_string()),
                    ("tick_hz", meta.tick_hz.to_string()),
                    ("pictures", meta.pictures.to_string()),
                    // A change may hold a line break.
                    ("overrides", serde_json::json!(meta.overrides).to_string()),
                ]
                .map(|(key, value)| (key.to_owned(), value)),
            ),
        })?;
        writer.flush()?;
        let mut ids = Vec::new();
        for (topic, schema) in channels(meta) {
            let schema_id = match &schema {
                Some(schema) => writer.add_schema(&schema.name, &schema.encoding, &schema.data)?,
                None => 0,
            };
            let encoding = encoding(schema.as_ref());
            let id = writer.add_channel(schema_id, &topic, encoding, &BTreeMap::new())?;
            ids.push((id, 0));
        }
        Ok(Self {
            path: path.to_owned(),
            writer,
            channels: ids,
            chunk_start_ns: None,
            chunk_bytes: 0,
        })
    }

    fn write(&mut self, channel: usize, log_time: u64, message: &[u8]) -> Result<(), McapError> {
        let (channel_id, sequence) = &mut self.channels[channel];
        let header = MessageHeader {
            channel_id: *channel_id,
            sequence: *sequence,
            log_time,
            publish_time: log_time,
        };
        *sequence = sequence.wrapping_add(1);
        self.chunk_bytes += message.len();
        self.writer.write_to_known_channel(&header, message)
    }

    /// Closes the chunk when it is long enough.
    fn end_tick(&mut self, log_time: u64) -> Result<(), McapError> {
        let start = *self.chunk_start_ns.get_or_insert(log_time);
        if log_time - start >= CHUNK_NS || self.chunk_bytes >= CHUNK_BYTES {
            self.writer.flush()?;
            self.chunk_start_ns = None;
            self.chunk_bytes = 0;
        }
        Ok(())
    }

    /// Writes the end; the length of the file [byte].
    fn close(mut self) -> Result<u64, RecordingError> {
        let finished = self.writer.finish();
        let mut file = self.writer.into_inner().into_inner();
        let flushed = file.flush();
        finished
            .map(drop)
            .and_then(|()| Ok(flushed.and_then(|()| Ok(file.get_ref().metadata()?.len()))?))
            .map_err(|source| write_error(&self.path, source))
    }
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
    fn into_sink(sink: Sink, meta: &Meta) -> Result<Self, RecordingError> {
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
        let mut message = ImageAnnotations {
            timestamp,
            ..Default::default()
        };
        let mut boxes: Vec<&BoxAnnotation> = boxes.iter().collect();
        // What is drawn later covers what was drawn before.
        boxes.sort_by(|a, b| b.weak.cmp(&a.weak).then(a.score.total_cmp(&b.score)));
        for annotation in boxes {
            let [x0, y0, x1, y1] = annotation.rect_px;
            let outline = if annotation.weak { WEAK } else { STRONG };
            message.points.push(fg::PointsAnnotation {
                timestamp,
                r#type: points_annotation::Type::LineLoop.into(),
                points: [[x0, y0], [x1, y0], [x1, y1], [x0, y1]].map(point2).into(),
                outline_color: Some(colour(outline)),
                thickness: 1.0, // [px]
                metadata: annotation.metadata(),
                ..Default::default()
            });
            // A text of what does not count would lie on those of what does.
            if !annotation.weak {
                message.texts.push(fg::TextAnnotation {
                    timestamp,
                    position: Some(point2([x0, y0 - 2.0])),
                    text: annotation.label.to_owned(),
                    font_size: 12.0, // [px]
                    text_color: Some(colour(outline)),
                    ..Default::default()
                });
            }
        }
        let [x, y] = reticle_px;
        // A cross with an open centre, so that it never hides a target of a few pixels.
        const ARMS_PX: [[f64; 2]; 8] = [
            [-16.0, 0.0],
            [-6.0, 0.0],
            [6.0, 0.0],
            [16.0, 0.0],
            [0.0, -16.0],
            [0.0, -6.0],
            [0.0, 6.0],
            [0.0, 16.0],
        ];
        message.points.push(fg::PointsAnnotation {
            timestamp,
            r#type: points_annotation::Type::LineList.into(),
            points: ARMS_PX.map(|[dx, dy]| point2([x + dx, y + dy])).into(),
            outline_color: Some(colour([1.0, 1.0, 1.0, 0.8])),
            thickness: 1.0, // [px]
            ..Default::default()
        });
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

impl SceneShape<'_> {
    fn add_to(&self, entity: &mut fg::SceneEntity) {
        const UPRIGHT: [f64; 4] = [0.0, 0.0, 0.0, 1.0];
        match *self {
            Self::Cube {
                centre_m,
                rotation,
                size_m,
                colour: rgba,
            } => {
                entity.cubes.push(fg::CubePrimitive {
                    pose: Some(pose(centre_m, rotation)),
                    size: Some(vector(size_m)),
                    color: Some(colour(rgba)),
                });
            }
            Self::Sphere {
                centre_m,
                diameter_m,
                colour: rgba,
            } => {
                entity.spheres.push(fg::SpherePrimitive {
                    pose: Some(pose(centre_m, UPRIGHT)),
                    size: Some(vector([diameter_m; 3])),
                    color: Some(colour(rgba)),
                });
            }
            Self::Line {
                points_m,
                width_m,
                colour: rgba,
            } => {
                entity.lines.push(fg::LinePrimitive {
                    r#type: line_primitive::Type::LineStrip.into(),
                    pose: Some(pose([0.0; 3], UPRIGHT)),
                    thickness: width_m,
                    points: points_m
                        .iter()
                        .map(|&[x, y, z]| Point3 { x, y, z })
                        .collect(),
                    color: Some(colour(rgba)),
                    ..Default::default()
                });
            }
        }
    }
}

/// Nanoseconds in a second.
const NS: u64 = 1_000_000_000;

fn vector([x, y, z]: [f64; 3]) -> Vector3 {
    Vector3 { x, y, z }
}

fn quaternion([x, y, z, w]: [f64; 4]) -> Quaternion {
    Quaternion { x, y, z, w }
}

fn pose(position_m: [f64; 3], rotation: [f64; 4]) -> Pose {
    Pose {
        position: Some(vector(position_m)),
        orientation: Some(quaternion(rotation)),
    }
}

fn point2([x, y]: [f64; 2]) -> Point2 {
    Point2 { x, y }
}

fn colour([r, g, b, a]: Rgba) -> Color {
    Color { r, g, b, a }
}

fn write_error(path: &Path, source: McapError) -> RecordingError {
    let path = path.to_owned();
    match source {
        McapError::Io(error) if error.kind() == io::ErrorKind::StorageFull => {
            RecordingError::DiskFull { path }
        }
        source => RecordingError::Write { path, source },
    }
}

#[cfg(test)]
mod tests;
