//! What a recording holds: its run and its topics, in the order of their channels.

use crate::{OF_STATION, OWN_CHANNELS};
use foxglove::messages::{
    self as fg, CameraCalibration, CompressedImage, FrameTransforms, ImageAnnotations, LocationFix,
    SceneUpdate,
};
use foxglove::{Encode, Schema};
use std::num::NonZeroU32;

/// The descriptor set of [`proto`](crate::proto), which every own channel carries as its schema.
const DESCRIPTORS: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/boresight.bin"));

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

/// One of the project's own messages with its place among the channels.
pub trait OwnMessage: prost::Message {
    /// Its index among the own channels.
    const INDEX: usize;
}

// Places of the other channels; each camera has three in a row.
pub(crate) const TF: usize = 0;
pub(crate) const SCENE: usize = 1;
pub(crate) const LOCATION: usize = 2;
pub(crate) const LOG: usize = 3;
pub(crate) const CAMERAS: usize = 4;
pub(crate) const IMAGE: usize = 0;
pub(crate) const ANNOTATIONS: usize = 1;
pub(crate) const CALIBRATION: usize = 2;

/// Every topic with its schema, in the order of their channels.
pub(crate) fn channels(meta: &Meta) -> Vec<(String, Option<Schema>)> {
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
pub(crate) fn encoding(schema: Option<&Schema>) -> &'static str {
    if schema.is_some_and(|schema| schema.encoding == "jsonschema") {
        "json"
    } else {
        "protobuf"
    }
}
