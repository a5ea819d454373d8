//! The MCAP file of a recording, chunk by chunk.

use crate::error::{RecordingError, write_error};
use crate::topics::{Meta, channels, encoding};
use mcap::{
    Attachment, Compression, McapError, WriteOptions, Writer,
    records::{MessageHeader, Metadata},
    write::NoSeek,
};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// Simulated time after which a chunk is closed and handed to the system: what a killed run loses.
const CHUNK_NS: u64 = 250_000_000; // [ns]
/// Encoded size after which a chunk is closed early, so that images do not pile up in memory.
const CHUNK_BYTES: usize = 1 << 20; // [byte]

/// The file of a recording.
pub(crate) struct Mcap {
    pub(crate) path: PathBuf,
    /// It never seeks: a chunk reaches the file whole or not at all.
    pub(crate) writer: Writer<NoSeek<BufWriter<File>>>,
    /// MCAP id and next sequence number of each channel.
    pub(crate) channels: Vec<(u16, u32)>,
    chunk_start_ns: Option<u64>,
    chunk_bytes: usize,
}

impl Mcap {
    pub(crate) fn create(path: &Path, meta: &Meta) -> Result<Self, RecordingError> {
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

    pub(crate) fn write(
        &mut self,
        channel: usize,
        log_time: u64,
        message: &[u8],
    ) -> Result<(), McapError> {
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
    pub(crate) fn end_tick(&mut self, log_time: u64) -> Result<(), McapError> {
        let start = *self.chunk_start_ns.get_or_insert(log_time);
        if log_time - start >= CHUNK_NS || self.chunk_bytes >= CHUNK_BYTES {
            self.writer.flush()?;
            self.chunk_start_ns = None;
            self.chunk_bytes = 0;
        }
        Ok(())
    }

    /// Writes the end; the length of the file [byte].
    pub(crate) fn close(mut self) -> Result<u64, RecordingError> {
        let finished = self.writer.finish();
        let mut file = self.writer.into_inner().into_inner();
        let flushed = file.flush();
        finished
            .map(drop)
            .and_then(|()| Ok(flushed.and_then(|()| Ok(file.get_ref().metadata()?.len()))?))
            .map_err(|source| write_error(&self.path, source))
    }
}
