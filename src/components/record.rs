//! What a run leaves behind.

use crate::components::capture::ExposedFrame;
use crate::models::decision::belief::Belief;
use crate::models::maths::spread::Spread;
use crate::models::optics::detection::Detection;
use crate::recording::{OwnTopic, Recorder};
use bevy::platform::cell::SyncCell;
use bevy::prelude::*;
use glam::DVec3;
use schemars::JsonSchema;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;
use std::marker::PhantomData;
use std::sync::Arc;

/// Hash of the whole state after the last tick; each tick's hash covers the one before.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StateHash(pub u64);

/// The recording of this run, to a file or to whoever looks on, if there is one, and what goes into it.
#[derive(Resource)]
pub struct Recording {
    /// Takes the messages.
    pub recorder: Option<SyncCell<Recorder>>,
    /// Ticks between recorded states.
    pub state_period_ticks: u64,
    /// Every n-th image of each camera is kept; 0 keeps none.
    pub image_every: u64,
    /// The best JPEG quality.
    pub jpeg_quality: u8,
    /// Most bits to a pixel of a picture.
    pub picture_bits_per_px: f64,
}

/// What of a station the recording's log has.
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct Logged {
    /// State changes.
    pub changes: usize,
    /// Operator's orders.
    pub orders: usize,
}

/// Topics of a caller's own, and what is to be recorded on them in this tick. Messages are JSON.
#[derive(Resource, Default)]
pub struct OwnTopics {
    topics: Vec<OwnTopic>,
    waiting: Vec<(usize, Vec<u8>)>,
}

/// A topic of a caller's own, and its type of message.
pub struct TopicOf<M> {
    index: usize,
    message: PhantomData<fn(M)>,
}

impl<M> Clone for TopicOf<M> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<M> Copy for TopicOf<M> {}

impl<M> fmt::Debug for TopicOf<M> {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "topic {}", self.index)
    }
}

impl OwnTopics {
    /// Adds a topic such as `/mine/wind`; before the set-up, which opens the recording.
    pub fn add<M: Serialize + JsonSchema>(&mut self, topic: &str) -> TopicOf<M> {
        let schema = schemars::schema_for!(M);
        self.topics.push(OwnTopic {
            topic: topic.to_owned(),
            schema_name: M::schema_name().into_owned(),
            schema: schema.as_value().to_string(),
        });
        TopicOf {
            index: self.topics.len() - 1,
            message: PhantomData,
        }
    }

    /// Records a message in this tick, if the run is recorded.
    pub fn publish<M: Serialize>(
        &mut self,
        topic: TopicOf<M>,
        message: &M,
    ) -> Result<(), serde_json::Error> {
        let json = serde_json::to_vec(message)?;
        self.waiting.push((topic.index, json));
        Ok(())
    }

    /// The topics, in the order in which they were added.
    pub fn topics(&self) -> &[OwnTopic] {
        &self.topics
    }

    /// Takes what is to be recorded: number of the topic and JSON.
    pub fn take(&mut self) -> Vec<(usize, Vec<u8>)> {
        std::mem::take(&mut self.waiting)
    }
}

/// How a UAV flew into something.
#[derive(Clone, Debug, PartialEq)]
pub struct Crash {
    /// When [s].
    pub t_s: f64,
    /// Where [m].
    pub r_enu_m: DVec3,
    /// Into what, in words.
    pub into: String,
}

/// What has become of a UAV, and when.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Fate {
    /// A camera of a station first held it [s].
    pub acquired_s: Option<f64>,
    /// How it crashed.
    pub crash: Option<Crash>,
    /// The hottest that its skin has been [K].
    pub hottest_k: f64,
    /// Its skin failed [s].
    pub neutralised_s: Option<f64>,
    /// It came within the asset's radius unharmed [s].
    pub at_asset_s: Option<f64>,
}

/// The fate of each UAV, by scenario index.
#[derive(Resource, Clone, Debug, Default)]
pub struct Fates {
    /// The protected asset [m], and how near to it a UAV has got through [m].
    pub r_asset_enu_m: DVec3,
    pub asset_radius_m: f64,
    /// The fates.
    pub uavs: Vec<Fate>,
}

impl Recording {
    /// Whether the picture of a frame is recorded.
    pub fn keeps(&self, frame: &ExposedFrame) -> bool {
        self.image_every > 0 && frame.number.is_multiple_of(self.image_every)
    }

    /// Most bytes of a picture of a size [px].
    pub fn most_bytes(&self, [width, height]: [u32; 2]) -> usize {
        (self.picture_bits_per_px / 8.0 * f64::from(width) * f64::from(height)) as usize
    }
}

/// A picture whose detections have arrived, for report and window.
#[derive(Clone, Debug)]
pub struct KeptFrame {
    /// Name of the camera that took it.
    pub camera: Arc<str>,
    /// Tick of the exposure.
    pub tick: u64,
    /// Time of the exposure [s].
    pub t_s: f64,
    /// Width and height [px].
    pub size_px: [u32; 2],
    /// 8-bit RGB rows.
    pub rgb8: Arc<Vec<u8>>,
    /// Upper left corner on the sensor [px].
    pub offset_px: [u32; 2],
    /// What the detector found in it, in sensor pixels.
    pub detections: Vec<Detection>,
    /// Boresight on the sensor [px].
    pub centre_px: [f64; 2],
    /// Name of the tracking state.
    pub state: &'static str,
}

/// What the pictures of a camera showed of a UAV, as far as their detections have arrived.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sight {
    /// Pictures in which it was.
    pub pictures: u32,
    /// The same as a time [s].
    pub in_view_s: f64,
    /// Of that the time for which something hid it [s].
    pub hidden_s: f64,
    /// Pictures in which a detection that counts lay on it.
    pub found: u32,
    /// The longer side of its box [px], hidden or not.
    pub size_px: Spread,
    /// Its signal-to-clutter ratio where it was not hidden.
    pub contrast: Spread,
    /// Grey level of what was around it, 0 to 255.
    pub grey: Spread,
    /// The best score of a detection on it.
    pub best_score: Option<f64>,
}

/// What a station had to do with a UAV.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Dealing {
    /// Time for which the UAV flew in its sight [s].
    pub clear_s: f64,
    /// Time for which it flew behind the city or in cloud [s].
    pub hidden_s: f64,
    /// Time for which a camera held it [s].
    pub held_s: f64,
    /// Of that the times for which the laser was not to fire, by the reason [s]; several may hold at once.
    pub refused_s: BTreeMap<&'static str, f64>,
}

/// What a camera leaves for summary, report and window.
#[derive(Component, Clone, Default)]
pub struct CameraHistory {
    /// What it showed of each UAV, by scenario index.
    pub sights: BTreeMap<usize, Sight>,
    /// Tick of its last picture whose detections have arrived.
    pub arrived_tick: Option<u64>,
    /// True distance of the target from the boresight while the camera holds it: (time [s], distance [px]).
    pub miss_px: Vec<(f64, f64)>,
    /// Last picture whose detections have arrived.
    pub latest: Option<KeptFrame>,
}

/// Time series and pictures of a station for summary and report.
#[derive(Component, Clone, Default)]
pub struct History {
    /// Irradiance on the aim point: (time [s], [W/m^2]).
    pub irradiance_wpm2: Vec<(f64, f64)>,
    /// Power in the bucket: (time [s], [W]).
    pub power_in_bucket_w: Vec<(f64, f64)>,
    /// The hottest of what would fail of the target: (time [s], [K]).
    pub skin_k: Vec<(f64, f64)>,
    /// True angle between the laser's axis and the target: (time [s], [urad]).
    pub los_error_urad: Vec<(f64, f64)>,
    /// What speaks for the target's being a UAV: (time [s], log-odds by term, not a number without a target).
    pub belief: Vec<(f64, Belief)>,
    /// Pictures for the contact sheet.
    pub frames: Vec<KeptFrame>,
    /// When a camera first held a target [s].
    pub acquired_s: Option<f64>,
    /// Time for which the firing beam's axis met a keep-out zone [s].
    pub keep_out_s: f64,
    /// Time for which the coarse or precise camera held what is no UAV [s].
    pub wrong_object_s: f64,
    /// What it had to do with each UAV, by scenario index.
    pub dealings: BTreeMap<usize, Dealing>,
    /// Every first shot at a UAV or distractor after one at another: time [s] and scenario index.
    pub shots: Vec<(f64, usize)>,
}
