//! Little-endian bytes with their lengths checked, and the kinds of numbers that 3D Tiles stores in them.

use crate::tiles::content::error::{ContentError, Fault};
use serde_json::{Number, Value};

/// A kind of number in binary data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Kind {
    /// By its name in a feature or batch table.
    pub fn of_table(name: &str) -> Option<Self> {
        Some(match name {
            "BYTE" => Self::I8,
            "UNSIGNED_BYTE" => Self::U8,
            "SHORT" => Self::I16,
            "UNSIGNED_SHORT" => Self::U16,
            "INT" => Self::I32,
            "UNSIGNED_INT" => Self::U32,
            "FLOAT" => Self::F32,
            "DOUBLE" => Self::F64,
            _ => return None,
        })
    }

    /// By its name in metadata (3D Metadata Specification).
    pub fn of_metadata(name: &str) -> Option<Self> {
        Some(match name {
            "INT8" => Self::I8,
            "UINT8" => Self::U8,
            "INT16" => Self::I16,
            "UINT16" => Self::U16,
            "INT32" => Self::I32,
            "UINT32" => Self::U32,
            "INT64" => Self::I64,
            "UINT64" => Self::U64,
            "FLOAT32" => Self::F32,
            "FLOAT64" => Self::F64,
            _ => return None,
        })
    }

    /// By its number in glTF.
    pub fn of_gltf(code: u32) -> Option<Self> {
        Some(match code {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5124 => Self::I32,
            5125 => Self::U32,
            5126 => Self::F32,
            5130 => Self::F64,
            _ => return None,
        })
    }

    /// Length of a number [byte].
    pub fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    /// The number that `bytes` begins with; 0 where they are too short.
    pub fn number(self, bytes: &[u8]) -> f64 {
        match self {
            Self::I8 => f64::from(i8::from_le_bytes(first(bytes))),
            Self::U8 => f64::from(u8::from_le_bytes(first(bytes))),
            Self::I16 => f64::from(i16::from_le_bytes(first(bytes))),
            Self::U16 => f64::from(u16::from_le_bytes(first(bytes))),
            Self::I32 => f64::from(i32::from_le_bytes(first(bytes))),
            Self::U32 => f64::from(u32::from_le_bytes(first(bytes))),
            Self::I64 => i64::from_le_bytes(first(bytes)) as f64,
            Self::U64 => u64::from_le_bytes(first(bytes)) as f64,
            Self::F32 => f64::from(f32::from_le_bytes(first(bytes))),
            Self::F64 => f64::from_le_bytes(first(bytes)),
        }
    }

    /// The same as JSON has it: whole numbers stay whole; what JSON cannot say is null.
    pub fn json(self, bytes: &[u8]) -> Value {
        match self {
            Self::F32 | Self::F64 => {
                Number::from_f64(self.number(bytes)).map_or(Value::Null, Value::Number)
            }
            Self::I64 => i64::from_le_bytes(first(bytes)).into(),
            Self::U64 => u64::from_le_bytes(first(bytes)).into(),
            _ => (self.number(bytes) as i64).into(),
        }
    }

    /// What an integer is divided by to become one of 0..1 or -1..1; 1 for floating-point numbers.
    pub fn unit(self) -> f64 {
        match self {
            Self::I8 => f64::from(i8::MAX),
            Self::U8 => f64::from(u8::MAX),
            Self::I16 => f64::from(i16::MAX),
            Self::U16 => f64::from(u16::MAX),
            Self::I32 => f64::from(i32::MAX),
            Self::U32 => f64::from(u32::MAX),
            Self::I64 => i64::MAX as f64,
            Self::U64 => u64::MAX as f64,
            Self::F32 | Self::F64 => 1.0,
        }
    }

    /// A whole number, which a file may also have written as a floating-point one; `None` if it is none of 0..2³².
    pub fn whole(self, bytes: &[u8]) -> Option<u32> {
        let number = self.number(bytes);
        let fits = number >= 0.0 && number <= f64::from(u32::MAX) && number.fract() == 0.0;
        fits.then_some(number as u32)
    }
}

/// The first `N` bytes, zeros where there are fewer.
fn first<const N: usize>(bytes: &[u8]) -> [u8; N] {
    (bytes.first_chunk::<N>().copied()).unwrap_or([0; N])
}

/// The whole number of four bytes at an offset, with a name of what is being read.
pub(crate) fn u32_at(bytes: &[u8], at: usize, place: &str) -> Result<u32, ContentError> {
    Ok(u32::from_le_bytes(first(part(bytes, at, 4, place)?)))
}

/// A part of some bytes, with a name of what is being read.
pub(crate) fn part<'b>(
    bytes: &'b [u8],
    start: usize,
    length: usize,
    place: &str,
) -> Result<&'b [u8], ContentError> {
    let end = start.checked_add(length);
    end.and_then(|end| bytes.get(start..end)).ok_or_else(|| {
        let needed = (start as u64).saturating_add(length as u64);
        let have = bytes.len() as u64;
        ContentError::new(place, Fault::Short { needed, have })
    })
}

/// The bytes of `count` elements of `size` bytes every `stride` bytes, all of which are there.
pub(crate) fn elements<'b>(
    bytes: &'b [u8],
    [start, stride, size, count]: [usize; 4],
    place: &str,
) -> Result<impl Iterator<Item = &'b [u8]> + use<'b>, ContentError> {
    if count > 0 && (size == 0 || stride < size) {
        let why = format!("elements of {size} bytes every {stride} bytes");
        return Err(ContentError::damaged(place, why));
    }
    let length = (count.saturating_sub(1))
        .saturating_mul(stride)
        .saturating_add(if count > 0 { size } else { 0 });
    let bytes = part(bytes, start, length, place)?;
    Ok((0..count).map(move |i| &bytes[i * stride..][..size]))
}

/// JSON of an object; spaces and zeros around it are padding.
pub(crate) fn json<T: serde::de::DeserializeOwned>(
    bytes: &[u8],
    place: &str,
) -> Result<T, ContentError> {
    let padding = |byte: &u8| *byte == 0 || byte.is_ascii_whitespace();
    let end = bytes.iter().rposition(|byte| !padding(byte));
    let text = &bytes[..end.map_or(0, |end| end + 1)];
    serde_json::from_slice(text).map_err(|why| ContentError::damaged(place, why.to_string()))
}
