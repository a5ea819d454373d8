//! Reading recordings: of this version, of another, of a run that was killed.

use boresight_scenario::{InputError, Loaded};
use mcap::records::Record;
use mcap::{McapError, Message, MessageStream};
use prost_reflect::{DescriptorPool, DynamicMessage, MessageDescriptor, SerializeOptions};
use serde_json::Value;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

/// Why a recording cannot be read. Each prints as one line.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {source}; name a recording", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// It is no MCAP file.
    #[error("{}: is no MCAP recording: {source}; name one that `boresight run` left (run.mcap)", path.display())]
    NotMcap {
        /// The file.
        path: PathBuf,
        /// What the reader says.
        source: McapError,
    },
    /// It lacks what every recording of Boresight begins with.
    #[error("{}: lacks {what}; only recordings of `boresight run` and `view` can be used", path.display())]
    NotOurs {
        /// The file.
        path: PathBuf,
        /// What is not there.
        what: &'static str,
    },
    /// What it holds is not what was written.
    #[error("{}: is damaged: {source}; make the run again", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What the reader says.
        source: McapError,
    },
}

/// A recording in memory.
#[derive(Debug)]
pub struct Recorded {
    /// The file.
    pub path: PathBuf,
    /// The scenario file as it was read.
    pub scenario_toml: String,
    /// The changes by `--set`.
    pub overrides: Vec<String>,
    /// Seed of the run.
    pub seed: u64,
    /// Version of the program that made it.
    pub version: String,
    /// Ticks per simulated second \[Hz\].
    pub tick_hz: u32,
    /// UTC time of tick 0 since 1970-01-01 \[ns\].
    pub epoch_unix_ns: u64,
    /// Whether its cameras rendered, where it says so.
    pictures: Option<bool>,
    bytes: Vec<u8>,
}

impl Recorded {
    /// Reads a file and what it says about its run.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let bytes = std::fs::read(path).map_err(|source| ReadError::File {
            path: path.into(),
            source,
        })?;
        let broken = |source| ReadError::NotMcap {
            path: path.into(),
            source,
        };
        let lacks = |what| ReadError::NotOurs {
            path: path.into(),
            what,
        };
        if !bytes.starts_with(mcap::MAGIC) {
            return Err(broken(McapError::BadMagic));
        }
        let mut texts: BTreeMap<String, String> = BTreeMap::new();
        let mut metadata = BTreeMap::new();
        let options = mcap::read::Options::IgnoreEndMagic.into();
        // What describes the run stands before the first chunk.
        for record in mcap::read::LinearReader::new_with_options(&bytes, options).map_err(broken)? {
            match record {
                Ok(Record::Attachment { header, data, .. }) => {
                    let text = String::from_utf8_lossy(&data).into_owned();
                    texts.insert(header.name, text);
                }
                Ok(Record::Metadata(found)) if found.name == "boresight" => {
                    metadata = found.metadata;
                    break;
                }
                Ok(Record::Chunk { .. }) => break,
                // Of a run that was killed at once this is all.
                Err(error) if was_cut(&error) => break,
                Err(source) => {
                    return Err(ReadError::Damaged {
                        path: path.into(),
                        source,
                    });
                }
                Ok(_) => {}
            }
        }
        let number = |key: &str| metadata.get(key)?.parse::<u64>().ok();
        let scenario_toml = texts.remove("scenario.toml").ok_or(lacks("its scenario"))?;
        let seed = number("seed").ok_or(lacks("its seed"))?;
        let epoch_unix_ns = number("epoch_unix_ns").ok_or(lacks("its time"))?;
        let tick_hz = number("tick_hz").and_then(|hz| u32::try_from(hz).ok());
        let tick_hz = tick_hz.filter(|hz| *hz > 0).ok_or(lacks("its tick rate"))?;
        let overrides =
            (metadata.get("overrides")).and_then(|text| serde_json::from_str(text).ok());
        // Recordings of earlier versions have them one a line.
        let lines = texts.remove("overrides.txt").unwrap_or_default();
        let overrides = overrides.unwrap_or_else(|| lines.lines().map(str::to_owned).collect());
        let pictures = metadata.get("pictures").map(|text| text == "true");
        Ok(Self {
            path: path.into(),
            scenario_toml,
            overrides,
            pictures,
            seed,
            version: metadata.remove("version").unwrap_or_default(),
            tick_hz,
            epoch_unix_ns,
            bytes,
        })
    }

    /// Whether the file ends as a finished one does; a killed run lacks its last moments.
    pub fn is_whole(&self) -> bool {
        self.bytes.ends_with(mcap::MAGIC)
    }

    /// The scenario of the run, with further changes.
    pub fn scenario(&self, changes: &[String]) -> Result<Loaded, InputError> {
        let changes = self.overrides.iter().chain(changes).cloned();
        Loaded::parse(
            self.scenario_toml.clone(),
            self.path.clone(),
            changes.collect(),
        )
    }

    /// Whether cameras rendered in the run.
    pub fn has_pictures(&self) -> bool {
        // Recordings of earlier versions show it by their images alone.
        self.pictures.unwrap_or_else(|| {
            let mut messages = self.messages();
            messages.any(|message| message.channel.topic.ends_with("/image"))
        })
    }

    /// Whether all that is there can be read; a file that was cut short may end anywhere.
    pub fn check(&self) -> Result<(), ReadError> {
        let options = mcap::read::Options::IgnoreEndMagic | mcap::read::Options::ValidateChunkCrcs;
        let messages = MessageStream::new_with_options(&self.bytes, options);
        let found =
            messages.and_then(|mut messages| messages.try_for_each(|message| message.map(drop)));
        match found {
            Err(source) if self.is_whole() || !was_cut(&source) => Err(ReadError::Damaged {
                path: self.path.clone(),
                source,
            }),
            _ => Ok(()),
        }
    }

    /// The messages in their order, as far as the file can be read.
    pub fn messages(&self) -> impl Iterator<Item = Message<'static>> {
        let options = mcap::read::Options::IgnoreEndMagic.into();
        let stream = MessageStream::new_with_options(&self.bytes, options);
        // The chunk that was being written when the process died is lost.
        (stream.into_iter().flatten()).map_while(Result::ok)
    }

    /// The tick of a message.
    pub fn tick(&self, message: &Message) -> u64 {
        let ns = u128::from(message.log_time.saturating_sub(self.epoch_unix_ns));
        // Log times are rounded down.
        let tick = (ns * u128::from(self.tick_hz)).div_ceil(1_000_000_000);
        u64::try_from(tick).unwrap_or(u64::MAX)
    }

    /// Simulated time of a tick \[s\].
    pub fn t_s(&self, tick: u64) -> f64 {
        tick as f64 / f64::from(self.tick_hz)
    }
}

/// Whether a file that ends early is read so.
fn was_cut(error: &McapError) -> bool {
    // A record may be said to be longer than all that is left of a file.
    matches!(
        error,
        McapError::UnexpectedEof | McapError::UnexpectedEoc | McapError::RecordTooLarge { .. }
    )
}

/// Decodes the messages of one recording by the schemas that their channels carry.
#[derive(Default)]
pub struct Decoder {
    /// By channel.
    known: BTreeMap<u16, Option<MessageDescriptor>>,
}

impl Decoder {
    /// The fields of a message by name, as JSON; `None` where its schema cannot be read.
    pub fn decode(&mut self, message: &Message) -> Option<Value> {
        let schema = message.channel.schema.as_ref()?;
        if message.channel.message_encoding == "json" {
            return serde_json::from_slice(&message.data).ok();
        }
        if schema.encoding != "protobuf" {
            return None;
        }
        let descriptor = self.known.entry(message.channel.id).or_insert_with(|| {
            let pool = DescriptorPool::decode(&schema.data[..]).ok()?;
            pool.get_message_by_name(&schema.name)
        });
        let decoded = DynamicMessage::decode(descriptor.clone()?, &message.data[..]).ok()?;
        let options = SerializeOptions::new()
            .skip_default_fields(false)
            .stringify_64_bit_integers(false)
            .use_proto_field_name(true);
        decoded
            .serialize_with_options(serde_json::value::Serializer, &options)
            .ok()
    }
}
