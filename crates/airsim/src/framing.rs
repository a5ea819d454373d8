//! Calls and answers on the wire: msgpack-rpc, one array after the other.

use crate::{MAX_CALL_BYTES, MAX_CALL_VALUES, MAX_DEPTH};
use rmp::Marker;
use rmpv::Value;
use std::io::{self, Read};

/// What is taken from a stream at once \[byte\].
const CHUNK_BYTES: usize = 64 << 10;

/// The first element of a message says what it is.
const REQUEST: u64 = 0;
const RESPONSE: u64 = 1;
const NOTIFICATION: u64 = 2;

/// Why no call can be read.
#[derive(Debug, thiserror::Error)]
pub enum FramingError {
    /// The other side has closed the connection between two calls.
    #[error("the connection is closed")]
    Closed,
    /// It has closed it in the middle of one.
    #[error("the connection ended in the middle of a call: {have} bytes of it came")]
    Cut {
        /// Bytes that came.
        have: usize,
    },
    /// A call is too long.
    #[error("a call of {announced} bytes is announced, at most {MAX_CALL_BYTES} are read")]
    TooLong {
        /// What is announced at least \[byte\].
        announced: u64,
    },
    /// A call holds too many values.
    #[error("a call of {announced} values is announced, at most {MAX_CALL_VALUES} are read")]
    TooMany {
        /// What is announced at least.
        announced: u64,
    },
    /// Values lie in values too deeply.
    #[error("values lie more than {MAX_DEPTH} deep in a call")]
    TooDeep,
    /// The bytes are no call.
    #[error("what came is no call of msgpack-rpc: {0}; does an AirSim client speak?")]
    NoCall(&'static str),
    /// The connection fails.
    #[error("the connection failed: {0}")]
    Io(#[from] io::Error),
}

/// What a client wants.
#[derive(Clone, Debug, PartialEq)]
pub struct Call {
    /// By which its answer is known; none wants no answer.
    pub id: Option<u32>,
    /// Name of the method.
    pub method: String,
    /// Its arguments.
    pub arguments: Vec<Value>,
}

impl Call {
    /// The call as it goes over the wire.
    pub fn encode(&self) -> Vec<u8> {
        let method = Value::from(self.method.as_str());
        let arguments = Value::Array(self.arguments.clone());
        let message = match self.id {
            Some(id) => vec![Value::from(REQUEST), Value::from(id), method, arguments],
            None => vec![Value::from(NOTIFICATION), method, arguments],
        };
        encode(&Value::Array(message))
    }

    fn of(message: Value) -> Result<Self, FramingError> {
        let no_call = FramingError::NoCall;
        let Value::Array(parts) = message else {
            return Err(no_call("it is no array"));
        };
        let mut parts = parts.into_iter();
        let id = match parts.next().and_then(|kind| kind.as_u64()) {
            Some(REQUEST) => {
                let id = parts.next().and_then(|id| id.as_u64());
                let id = id.and_then(|id| u32::try_from(id).ok());
                Some(id.ok_or(no_call("the number of a request is not of 32 bits"))?)
            }
            Some(NOTIFICATION) => None,
            Some(RESPONSE) => return Err(no_call("it is an answer")),
            _ => return Err(no_call("it is neither a request nor a notification")),
        };
        let method = match parts.next() {
            Some(Value::String(method)) => method.into_str(),
            Some(Value::Binary(method)) => String::from_utf8(method).ok(),
            _ => None,
        };
        let method = method.ok_or(no_call("the method is no text"))?;
        let Some(Value::Array(arguments)) = parts.next() else {
            return Err(no_call("the arguments are no array"));
        };
        match parts.next() {
            None => Ok(Self {
                id,
                method,
                arguments,
            }),
            Some(_) => Err(no_call("it has too many parts")),
        }
    }
}

fn encode(value: &Value) -> Vec<u8> {
    let mut bytes = Vec::new();
    // A vector grows: nothing can fail.
    let _ = rmpv::encode::write_value(&mut bytes, value);
    bytes
}

/// An answer as it goes over the wire.
pub fn reply(id: u32, result: Value) -> Vec<u8> {
    let answer = vec![Value::from(RESPONSE), id.into(), Value::Nil, result];
    encode(&Value::Array(answer))
}

/// An answer that says why there is none; the client raises it as an error.
pub fn refusal(id: u32, why: &str) -> Vec<u8> {
    let answer = vec![Value::from(RESPONSE), id.into(), why.into(), Value::Nil];
    encode(&Value::Array(answer))
}

/// How far a message has been looked through. It goes on where it stopped, whenever more bytes have come.
#[derive(Debug, Default)]
struct Scan {
    /// Bytes that are looked through.
    at: usize,
    /// Values that are still to come of every array and map which has begun.
    open: Vec<u64>,
    /// Values that have come or are announced.
    values: u64,
}

/// What a value is made of.
struct Head {
    /// Bytes before its contents.
    head: usize,
    /// Bytes of its contents.
    body: u64,
    /// Values in it.
    values: u64,
}

impl Head {
    /// Of the value that begins with `bytes`; none while too few have come.
    fn of(bytes: &[u8]) -> Result<Option<Self>, FramingError> {
        let Some(first) = bytes.first() else {
            return Ok(None);
        };
        let length = |bytes_of_length: usize| {
            let of = bytes.get(1..=bytes_of_length)?;
            Some(of.iter().fold(0, |sum, byte| sum << 8 | u64::from(*byte)))
        };
        let flat = |body: u64| {
            Some(Self {
                head: 1,
                body,
                values: 0,
            })
        };
        let data = |wide: usize| {
            Some(Self {
                head: 1 + wide,
                body: length(wide)?,
                values: 0,
            })
        };
        let many = |wide: usize, each: u64| {
            Some(Self {
                head: 1 + wide,
                body: 0,
                values: each * length(wide)?,
            })
        };
        Ok(match Marker::from_u8(*first) {
            Marker::FixPos(_) | Marker::FixNeg(_) | Marker::Null | Marker::True | Marker::False => {
                flat(0)
            }
            Marker::U8 | Marker::I8 => flat(1),
            Marker::U16 | Marker::I16 => flat(2),
            Marker::U32 | Marker::I32 | Marker::F32 => flat(4),
            Marker::U64 | Marker::I64 | Marker::F64 => flat(8),
            Marker::FixStr(bytes) => flat(bytes.into()),
            Marker::Str8 | Marker::Bin8 => data(1),
            Marker::Str16 | Marker::Bin16 => data(2),
            Marker::Str32 | Marker::Bin32 => data(4),
            Marker::FixArray(values) => Some(Self {
                head: 1,
                body: 0,
                values: values.into(),
            }),
            Marker::FixMap(pairs) => Some(Self {
                head: 1,
                body: 0,
                values: 2 * u64::from(pairs),
            }),
            Marker::Array16 => many(2, 1),
            Marker::Array32 => many(4, 1),
            Marker::Map16 => many(2, 2),
            Marker::Map32 => many(4, 2),
            _ => return Err(FramingError::NoCall("it holds an extension of msgpack")),
        })
    }
}

impl Scan {
    /// Length of the message that `bytes` begin with; none while it is not whole.
    fn length(&mut self, bytes: &[u8]) -> Result<Option<usize>, FramingError> {
        if self.at == 0 && self.open.is_empty() {
            self.open.push(1);
            self.values = 1;
        }
        while let Some(open) = self.open.last_mut() {
            if *open == 0 {
                self.open.pop();
                continue;
            }
            let Some(Head { head, body, values }) = Head::of(&bytes[self.at..])? else {
                return Ok(None);
            };
            if self.at == 0 && values == 0 {
                return Err(FramingError::NoCall("it is no array"));
            }
            let end = (self.at + head) as u64 + body;
            // Every value that is announced takes a byte at least.
            if end + values > MAX_CALL_BYTES as u64 {
                return Err(FramingError::TooLong {
                    announced: end + values,
                });
            }
            self.values += values;
            if self.values > MAX_CALL_VALUES as u64 {
                return Err(FramingError::TooMany {
                    announced: self.values,
                });
            }
            let end = end as usize;
            if bytes.len() < end {
                return Ok(None);
            }
            *open -= 1;
            self.at = end;
            if values > 0 {
                if self.open.len() > MAX_DEPTH {
                    return Err(FramingError::TooDeep);
                }
                self.open.push(values);
            }
        }
        Ok(Some(self.at))
    }
}

/// Reads calls from a stream. Of a long one, memory is taken only for what has come.
pub struct Reader<R> {
    stream: R,
    /// What has been taken from the stream and not been given out.
    waiting: Vec<u8>,
    scan: Scan,
}

impl<R: Read> Reader<R> {
    /// Of a stream.
    pub fn new(stream: R) -> Self {
        Self {
            stream,
            waiting: Vec::new(),
            scan: Scan::default(),
        }
    }

    /// The stream itself.
    pub fn stream(&self) -> &R {
        &self.stream
    }

    /// The next call, and its length \[byte\]; waits for it.
    pub fn read(&mut self) -> Result<(Call, usize), FramingError> {
        let (value, length) = self.read_value()?;
        Ok((Call::of(value)?, length))
    }

    /// The next message, whatever it is, such as an answer; and its length \[byte\].
    pub fn read_value(&mut self) -> Result<(Value, usize), FramingError> {
        let length = loop {
            match self.scan.length(&self.waiting)? {
                Some(length) => break length,
                None => self.fill()?,
            }
        };
        self.scan = Scan::default();
        let value =
            rmpv::decode::read_value_with_max_depth(&mut &self.waiting[..length], 2 * MAX_DEPTH);
        self.waiting.drain(..length);
        // What a long call took is given back.
        if self.waiting.capacity() > 4 * CHUNK_BYTES && self.waiting.len() <= CHUNK_BYTES {
            self.waiting.shrink_to(CHUNK_BYTES);
        }
        let value = value.map_err(|_| FramingError::NoCall("its values cannot be read"))?;
        Ok((value, length))
    }

    /// Takes what the stream has.
    fn fill(&mut self) -> Result<(), FramingError> {
        let have = self.waiting.len();
        self.waiting.resize(have + CHUNK_BYTES, 0);
        let taken = loop {
            match self.stream.read(&mut self.waiting[have..]) {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                taken => break taken,
            }
        };
        self.waiting.truncate(have + *taken.as_ref().unwrap_or(&0));
        match taken? {
            0 if have == 0 => Err(FramingError::Closed),
            0 => Err(FramingError::Cut { have }),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn call(id: u32, method: &str, arguments: Vec<Value>) -> Call {
        Call {
            id: Some(id),
            method: method.to_owned(),
            arguments,
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
    fn what_is_announced_takes_no_memory_before_it_has_come() {
        // A request whose method has 2 GiB, one with 2^32 arguments, and one whose arguments lie in one another.
        let long = [0x94, 0, 1, 0xdb, 0x80, 0, 0, 0, b'a'];
        let many = [0x94, 0, 1, 0xa1, b'p', 0xdd, 0xff, 0xff, 0xff, 0xff];
        let some = [0x94, 0, 1, 0xa1, b'p', 0xdd, 0, 2, 0, 0];
        let deep = [&[0x94, 0, 1, 0xa1, b'p'][..], &[0x91; 4000]].concat();
        for (bytes, words) in [
            (&long[..], "a call of 2147483656 bytes is announced"),
            (&many, "bytes is announced"),
            (&some, "values is announced"),
            (&deep, "more than 12 deep"),
            (b"GET / HTTP/1.1\r\n\r\n", "it is no array"),
            (&[0x94, 0, 1, 0xc7, 1, 1, 1], "an extension"),
            (&[0x93, 0, 1, 2], "the method is no text"),
            (&[0x94, 1, 1, 0xc0, 0xc0], "it is an answer"),
            (&[0x94, 0, 0xff, 0xa1, b'p', 0x90], "not of 32 bits"),
            (&[0x93, 2, 0xa1, b'p', 0xc0], "the arguments are no array"),
        ] {
            let mut reader = Reader::new(bytes);
            let error = reader.read().unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
            assert!(reader.waiting.capacity() <= 4 * CHUNK_BYTES);
        }
    }

    #[test]
    fn half_a_call_and_none_are_told_apart() {
        let sent = call(7, "simGetImages", vec![Value::from("a"), Value::from(1.5)]);
        let bytes = sent.encode();
        assert!(matches!(
            Reader::new(&[][..]).read(),
            Err(FramingError::Closed)
        ));
        for end in 1..bytes.len() {
            let cut = Reader::new(&bytes[..end]).read();
            assert!(
                matches!(cut, Err(FramingError::Cut { have }) if have == end),
                "{end}"
            );
        }
        assert_eq!(Reader::new(&bytes[..]).read().unwrap(), (sent, bytes.len()));
    }

    #[test]
    fn answers_are_arrays_of_four() {
        let answer = |bytes: Vec<u8>| Reader::new(&bytes[..]).read_value().unwrap().0;
        let parts = |of: [Value; 4]| Value::Array(of.to_vec());
        assert_eq!(
            answer(reply(3, true.into())),
            parts([1.into(), 3.into(), Value::Nil, true.into()])
        );
        assert_eq!(
            answer(refusal(3, "no")),
            parts([1.into(), 3.into(), "no".into(), Value::Nil])
        );
    }

    fn values() -> impl Strategy<Value = Value> {
        let leaf = prop_oneof![
            Just(Value::Nil),
            any::<bool>().prop_map(Value::from),
            any::<i64>().prop_map(Value::from),
            any::<f64>()
                .prop_filter("is itself", |x| !x.is_nan())
                .prop_map(Value::from),
            ".{0,40}".prop_map(Value::from),
            proptest::collection::vec(any::<u8>(), 0..300).prop_map(Value::from),
        ];
        leaf.prop_recursive(4, 40, 6, |inner| {
            prop_oneof![
                proptest::collection::vec(inner.clone(), 0..6).prop_map(Value::from),
                proptest::collection::vec((".{0,5}".prop_map(Value::from), inner), 0..6)
                    .prop_map(Value::from),
            ]
        })
    }

    proptest! {
        #[test]
        fn what_is_called_is_read_however_it_comes(
            arguments in proptest::collection::vec(proptest::collection::vec(values(), 0..4), 0..10),
            pieces in proptest::collection::vec(1usize..5000, 0..40),
        ) {
            let sent: Vec<Call> = (0..).zip(arguments).map(|(id, of)| call(id, "method", of)).collect();
            let bytes: Vec<u8> = sent.iter().flat_map(Call::encode).collect();
            let mut reader = Reader::new(Pieces(&bytes, pieces));
            for call in &sent {
                prop_assert_eq!(&reader.read().unwrap().0, call);
            }
            prop_assert!(matches!(reader.read(), Err(FramingError::Closed)));
        }

        #[test]
        fn whatever_comes_it_ends_without_a_panic_and_without_much_memory(
            bytes in proptest::collection::vec(any::<u8>(), 0..4000),
            pieces in proptest::collection::vec(1usize..500, 0..40),
        ) {
            let bytes = [&[0x94, 0, 1][..], &bytes].concat();
            let mut reader = Reader::new(Pieces(&bytes, pieces));
            for _ in 0..=bytes.len() {
                if reader.read().is_err() {
                    break;
                }
            }
            prop_assert!(reader.waiting.capacity() <= 2 * (CHUNK_BYTES + bytes.len()));
        }
    }
}
