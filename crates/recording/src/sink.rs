//! Where the messages of a tick go: to the file and to who listens, pictures encoded on the way.

use crate::error::{RecordingError, write_error};
use crate::file::Mcap;
use crate::live::Live;
use crate::media::image::encode_within;
use boresight_common::warning::Warning;
use foxglove::messages::CompressedImage;
use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, mpsc};

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
pub(crate) enum Content {
    /// Where it lies among the encoded messages of the tick.
    Encoded(Range<usize>),
    /// A picture still to be encoded, and its message without it.
    Picture(Picture, Box<CompressedImage>),
}

/// The messages of one tick, in the order of their channels.
pub(crate) struct OneTick {
    pub(crate) log_time_ns: u64,
    pub(crate) messages: Vec<(usize, Content)>,
    pub(crate) encoded: Vec<u8>,
}

/// Where messages go.
pub(crate) struct Sink {
    pub(crate) file: Option<Mcap>,
    pub(crate) live: Option<Live>,
    pub(crate) written: Written,
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
    pub(crate) fn run(mut self, ticks: mpsc::Receiver<OneTick>) -> Result<Written, RecordingError> {
        let written = ticks.into_iter().try_for_each(|tick| self.write(tick));
        let closed = self.file.map_or(Ok(0), Mcap::close);
        written.and(closed).map(|bytes| Written {
            bytes,
            ..self.written
        })
    }
}
