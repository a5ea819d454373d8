//! Buffer views that meshoptimizer compressed (`EXT_meshopt_compression`, `KHR_meshopt_compression`).

use super::schema::Meshopt;
use crate::tiles::content::error::ContentError;

/// A vertex of `N` bytes.
#[derive(Clone)]
struct Vertex<const N: usize>([u8; N]);

impl<const N: usize> Default for Vertex<N> {
    fn default() -> Self {
        Self([0; N])
    }
}

/// Vertices of `N` bytes.
fn vertices<const N: usize>(data: &[u8], count: usize) -> Option<Vec<u8>> {
    let vertices: Vec<Vertex<N>> = ::meshopt::decode_vertex_buffer(data, count).ok()?;
    Some(vertices.into_iter().flat_map(|vertex| vertex.0).collect())
}

/// Vertices of `stride` bytes: the library takes their length as a type.
fn attributes(data: &[u8], count: usize, stride: usize) -> Option<Vec<u8>> {
    macro_rules! sizes {
        ($($words:literal)*) => {
            match stride {
                $(n if n == 4 * $words => vertices::<{ 4 * $words }>(data, count),)*
                _ => None,
            }
        };
    }
    sizes!(1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30 31 32
        33 34 35 36 37 38 39 40 41 42 43 44 45 46 47 48 49 50 51 52 53 54 55 56 57 58 59 60 61 62 63 64)
}

/// Undoes a filter in place; `false` where there is none of the name for elements of `stride` bytes.
fn filter(name: &str, stride: usize, data: &mut [u8]) -> bool {
    fn words<const N: usize, T: Copy>(data: &[u8], word: fn([u8; N]) -> T) -> Vec<T> {
        let (words, _) = data.as_chunks::<N>();
        words.iter().map(|bytes| word(*bytes)).collect()
    }
    fn back<const N: usize, T: Copy>(data: &mut [u8], from: &[T], bytes: fn(T) -> [u8; N]) {
        let (words, _) = data.as_chunks_mut::<N>();
        for (word, value) in words.iter_mut().zip(from) {
            *word = bytes(*value);
        }
    }
    match (name, stride) {
        ("NONE", _) => {}
        ("OCTAHEDRAL", 4) => {
            let mut values = words(data, i8::from_le_bytes);
            ::meshopt::decode_filter_oct(values.as_chunks_mut::<4>().0);
            back(data, &values, i8::to_le_bytes);
        }
        ("OCTAHEDRAL", 8) => {
            let mut values = words(data, i16::from_le_bytes);
            ::meshopt::decode_filter_oct(values.as_chunks_mut::<4>().0);
            back(data, &values, i16::to_le_bytes);
        }
        ("QUATERNION", 8) => {
            let mut values = words(data, i16::from_le_bytes);
            ::meshopt::decode_filter_quat(values.as_chunks_mut::<4>().0);
            back(data, &values, i16::to_le_bytes);
        }
        ("EXPONENTIAL", _) if stride.is_multiple_of(4) => {
            let mut values = words(data, u32::from_le_bytes);
            ::meshopt::decode_filter_exp(values.as_chunks_mut::<1>().0);
            back(data, &values, u32::to_le_bytes);
        }
        ("COLOR", 4) => {
            let mut values = data.to_vec();
            ::meshopt::decode_filter_color(values.as_chunks_mut::<4>().0);
            data.copy_from_slice(&values);
        }
        ("COLOR", 8) => {
            let mut values = words(data, u16::from_le_bytes);
            ::meshopt::decode_filter_color(values.as_chunks_mut::<4>().0);
            back(data, &values, u16::to_le_bytes);
        }
        _ => return false,
    }
    true
}

/// The bytes that a compressed view stands for.
pub(crate) fn decode(data: &[u8], how: &Meshopt, place: &str) -> Result<Vec<u8>, ContentError> {
    /// What the vertex codec makes of one byte at most: 256 vertices of 4 equal bytes, and as much again for safety.
    const EXPANSION: usize = 2048;
    let (count, stride) = (how.count, how.byte_stride);
    let damaged = |why: &str| ContentError::damaged(place, why);
    let least = match how.mode.as_str() {
        "ATTRIBUTES" => count.saturating_mul(stride) / EXPANSION,
        "TRIANGLES" if count.is_multiple_of(3) => count / 3,
        "TRIANGLES" => return Err(damaged("triangles of no three corners")),
        _ => count,
    };
    if least > data.len() {
        return Err(damaged("more elements than its bytes can hold"));
    }
    let indices = |found: Option<Vec<u32>>| {
        let found = found?;
        Some(match stride {
            2 => found
                .iter()
                .flat_map(|i| (*i as u16).to_le_bytes())
                .collect(),
            _ => found.iter().flat_map(|i| i.to_le_bytes()).collect(),
        })
    };
    let whole = stride == 2 || stride == 4;
    let mut decoded = match how.mode.as_str() {
        "ATTRIBUTES" => attributes(data, count, stride),
        "TRIANGLES" if whole => indices(::meshopt::decode_index_buffer(data, count).ok()),
        "INDICES" if whole => indices(::meshopt::decode_index_sequence(data, count).ok()),
        _ => return Err(damaged(&format!("mode {} of {stride} bytes", how.mode))),
    }
    .ok_or_else(|| damaged("meshoptimizer refuses it"))?;
    let name = how.filter.as_deref().unwrap_or("NONE");
    if name != "NONE" && !filter(name, stride, &mut decoded) {
        return Err(damaged(&format!("filter {name} of {stride} bytes")));
    }
    Ok(decoded)
}
