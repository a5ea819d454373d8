//! Messages on the wire: the length in bytes, four bytes, little endian, and the message.

use prost::Message;
use std::io::{self, Read};

/// What is taken from a stream at once, and the first memory that a message gets \[byte\].
const CHUNK_BYTES: usize = 64 << 10;

/// Bytes of a length.
const HEAD: usize = 4;

/// Why no message can be read.
#[derive(Debug, thiserror::Error)]
pub enum FramingError {
    /// The other side has closed the connection between two messages.
    #[error("the connection is closed")]
    Closed,
    /// It has closed it in the middle of one.
    #[error("the connection ended in the middle of a message: {have} of {wanted} bytes came")]
    Cut {
        /// Bytes that came, those of the length among them.
        have: usize,
        /// Bytes that should have come, as far as known.
        wanted: usize,
    },
    /// A message is announced that is too long.
    #[error(
        "a message of {announced} bytes is announced, at most {limit} are read: does the other side write the length \
         as four bytes, little endian, before each message?"
    )]
    TooLong {
        /// What is announced \[byte\].
        announced: usize,
        /// What is read at most \[byte\].
        limit: usize,
    },
    /// The bytes are no message.
    #[error(
        "a message of {bytes} bytes cannot be read: {source}; is it of lockstep.proto, version 1?"
    )]
    Malformed {
        /// Its length \[byte\].
        bytes: usize,
        /// What is wrong.
        source: prost::DecodeError,
    },
    /// The connection fails.
    #[error("the connection failed: {0}")]
    Io(#[from] io::Error),
}

/// A message as it goes over the wire.
pub fn encode(message: &impl Message) -> Vec<u8> {
    let length = message.encoded_len();
    let mut bytes = Vec::with_capacity(HEAD + length);
    // What is longer than a length can say no reader takes anyway.
    bytes.extend_from_slice(&u32::try_from(length).unwrap_or(u32::MAX).to_le_bytes());
    // A vector grows: nothing can fail.
    let _ = message.encode(&mut bytes);
    bytes
}

/// Reads messages from a stream. Of a long one, memory is taken only for what has come.
pub struct Reader<R> {
    stream: R,
    limit: usize,
    /// What has been taken from the stream and not been given out.
    waiting: Vec<u8>,
}

impl<R: Read> Reader<R> {
    /// Messages of at most `limit` bytes.
    pub fn new(stream: R, limit: usize) -> Self {
        Self {
            stream,
            limit,
            waiting: Vec::new(),
        }
    }

    /// Another limit from the next message on \[byte\].
    pub fn set_limit(&mut self, limit: usize) {
        self.limit = limit;
    }

    /// The stream itself.
    pub fn stream(&self) -> &R {
        &self.stream
    }

    /// The next message, and its length \[byte\]; waits for it.
    pub fn read<M: Message + Default>(&mut self) -> Result<(M, usize), FramingError> {
        let wanted = loop {
            if let Some(length) = self.announced()? {
                if self.waiting.len() >= HEAD + length {
                    break HEAD + length;
                }
                self.fill(HEAD + length)?;
            } else {
                self.fill(HEAD)?;
            }
        };
        let body = &self.waiting[HEAD..wanted];
        let message = M::decode(body).map_err(|source| FramingError::Malformed {
            bytes: body.len(),
            source,
        });
        self.waiting.drain(..wanted);
        // What a long message took is given back.
        if self.waiting.capacity() > 4 * CHUNK_BYTES && self.waiting.len() <= CHUNK_BYTES {
            self.waiting.shrink_to(CHUNK_BYTES);
        }
        Ok((message?, wanted - HEAD))
    }

    /// Length of the message that begins, as soon as it is known.
    fn announced(&self) -> Result<Option<usize>, FramingError> {
        let Some(head) = self.waiting.first_chunk::<HEAD>() else {
            return Ok(None);
        };
        let announced = u32::from_le_bytes(*head) as usize;
        if announced > self.limit {
            return Err(FramingError::TooLong {
                announced,
                limit: self.limit,
            });
        }
        Ok(Some(announced))
    }

    /// Takes what the stream has, of a message that is `wanted` bytes long with its length.
    fn fill(&mut self, wanted: usize) -> Result<(), FramingError> {
        let have = self.waiting.len();
        // No more than doubles what has come.
        let room = (wanted - have).clamp(CHUNK_BYTES, CHUNK_BYTES.max(have));
        self.waiting.resize(have + room, 0);
        let taken = loop {
            match self.stream.read(&mut self.waiting[have..]) {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                taken => break taken,
            }
        };
        self.waiting.truncate(have + *taken.as_ref().unwrap_or(&0));
        match taken? {
            0 if have == 0 => Err(FramingError::Closed),
            0 => Err(FramingError::Cut { have, wanted }),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::proto::{Hello, Request, request::What};
    use proptest::prelude::*;

    fn hello(id: u64, name: &str) -> Request {
        Request {
            id,
            what: Some(What::Hello(Hello {
                version: 1,
                token: String::new(),
                name: name.to_owned(),
            })),
        }
    }

    /// A stream that gives its bytes in pieces.
    struct Pieces<'a>(&'a [u8], Vec<usize>);

    impl Read for Pieces<'_> {
        fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
            let piece = self.1.pop().unwrap_or(7).clamp(1, 4096);
            let count = piece.min(into.len()).min(self.0.len());
            let (now, later) = self.0.split_at(count);
            into[..count].copy_from_slice(now);
            self.0 = later;
            Ok(count)
        }
    }

    #[test]
    fn a_length_above_the_limit_is_one_error_and_takes_no_memory() {
        let mut bytes = (2u32 << 30).to_le_bytes().to_vec();
        bytes.extend([1; 100]);
        let mut reader = Reader::new(&bytes[..], crate::MAX_REQUEST_BYTES);
        let error = reader.read::<Request>().unwrap_err();
        assert!(
            error
                .to_string()
                .starts_with("a message of 2147483648 bytes is announced, at most 1048576"),
            "{error}"
        );
        assert!(reader.waiting.capacity() <= 2 * CHUNK_BYTES);
        // So does one within it of which nothing comes.
        let bytes = (1u32 << 20).to_le_bytes();
        let mut reader = Reader::new(&bytes[..], crate::MAX_REQUEST_BYTES);
        let error = reader.read::<Request>().unwrap_err();
        assert!(
            matches!(error, FramingError::Cut { have: 4, .. }),
            "{error}"
        );
        assert!(reader.waiting.capacity() <= 4 * CHUNK_BYTES);
    }

    #[test]
    fn half_a_message_and_none_are_told_apart() {
        let bytes = encode(&hello(1, "a"));
        let read = |bytes: &[u8]| Reader::new(bytes, 100).read::<Request>().map(|(of, _)| of);
        assert!(matches!(read(&[]), Err(FramingError::Closed)));
        for end in 1..bytes.len() {
            assert!(
                matches!(read(&bytes[..end]), Err(FramingError::Cut { .. })),
                "{end}"
            );
        }
        assert_eq!(read(&bytes).unwrap(), hello(1, "a"));
        let malformed = [3, 0, 0, 0, 0xff, 0xff, 0xff];
        assert!(matches!(
            read(&malformed),
            Err(FramingError::Malformed { bytes: 3, .. })
        ));
    }

    proptest! {
        #[test]
        fn what_is_written_is_read_however_it_comes(
            names in proptest::collection::vec(".{0,300}", 0..20),
            pieces in proptest::collection::vec(1usize..5000, 0..40),
        ) {
            let sent: Vec<Request> = (0..).zip(&names).map(|(id, name)| hello(id, name)).collect();
            let bytes: Vec<u8> = sent.iter().flat_map(encode).collect();
            let mut reader = Reader::new(Pieces(&bytes, pieces), 10_000);
            for request in &sent {
                let (read, length) = reader.read::<Request>().unwrap();
                prop_assert_eq!(&read, request);
                prop_assert_eq!(length, request.encoded_len());
            }
            prop_assert!(matches!(reader.read::<Request>(), Err(FramingError::Closed)));
        }

        #[test]
        fn whatever_comes_it_ends_without_a_panic_and_without_much_memory(
            bytes in proptest::collection::vec(any::<u8>(), 0..4000),
            pieces in proptest::collection::vec(1usize..500, 0..40),
            limit in 0usize..100_000,
        ) {
            let mut reader = Reader::new(Pieces(&bytes, pieces), limit);
            // Every message takes four bytes at least.
            for _ in 0..=bytes.len() / 4 {
                if reader.read::<Request>().is_err_and(|error| !matches!(error, FramingError::Malformed { .. })) {
                    break;
                }
            }
            prop_assert!(reader.read::<Request>().is_err() || bytes.len() > 4);
            prop_assert!(reader.waiting.capacity() <= 2 * (CHUNK_BYTES + bytes.len()));
        }
    }
}
