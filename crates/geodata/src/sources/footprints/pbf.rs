//! The blobs of an `.osm.pbf` file: every compression that writers have, as the one that `osmpbf` reads; what the header asks for.

use crate::sources::error::Fault;
use osmpbf::{BlobDecode, BlobReader};
use prost::Message;
use std::borrow::Cow;
use std::io::{Cursor, Read};

/// Most bytes of an unpacked blob, by the format.
const MOST_BYTES: usize = 32 << 20; // [B]
/// Most bytes of all blobs, unpacked.
const MOST_OUT: usize = 4 << 30; // [B]
/// What a file may ask for of its reader.
const KNOWN: [&str; 3] = ["OsmSchema-V0.6", "DenseNodes", "LocationsOnWays"];

/// What stands before each blob.
#[derive(Clone, PartialEq, Message)]
struct BlobHeader {
    #[prost(string, tag = "1")]
    kind: String,
    #[prost(bytes = "vec", optional, tag = "2")]
    index: Option<Vec<u8>>,
    #[prost(int32, tag = "3")]
    size: i32,
}

/// A part of the file, packed in one of several ways.
#[derive(Clone, PartialEq, Message)]
struct Blob {
    #[prost(bytes = "vec", optional, tag = "1")]
    raw: Option<Vec<u8>>,
    #[prost(int32, optional, tag = "2")]
    raw_size: Option<i32>,
    #[prost(bytes = "vec", optional, tag = "3")]
    zlib: Option<Vec<u8>>,
    #[prost(bytes = "vec", optional, tag = "4")]
    lzma: Option<Vec<u8>>,
    #[prost(bytes = "vec", optional, tag = "5")]
    bzip2: Option<Vec<u8>>,
    #[prost(bytes = "vec", optional, tag = "6")]
    lz4: Option<Vec<u8>>,
    #[prost(bytes = "vec", optional, tag = "7")]
    zstd: Option<Vec<u8>>,
}

/// The same file with its blobs plain or in zlib.
///
/// Fails where it is cut off, where a blob is damaged, or where it is packed in a way that is not read.
pub fn readable(bytes: &[u8]) -> Result<Cow<'_, [u8]>, Fault> {
    let mut out: Option<Vec<u8>> = None;
    let mut at = 0;
    while at < bytes.len() {
        let start = at;
        let place = format!("byte {start}");
        let cut = || Fault::new(&place, "the file is cut off", "fetch the extract again");
        let broken = |what: &str| Fault::new(&place, what, "fetch the extract again");
        let mut take = |length: usize| {
            let part = bytes.get(at..at.checked_add(length)?)?;
            at += length;
            Some(part)
        };
        let length = take(4).and_then(|four| <[u8; 4]>::try_from(four).ok());
        let length = u32::from_be_bytes(length.ok_or_else(cut)?) as usize;
        // A header is at most 64 KiB by the format.
        if length > 64 << 10 {
            return Err(broken(
                "no header of a blob: it is no .osm.pbf file, or damaged",
            ));
        }
        let header = BlobHeader::decode(take(length).ok_or_else(cut)?)
            .map_err(|_| broken("no header of a blob: it is no .osm.pbf file, or damaged"))?;
        let size = usize::try_from(header.size).map_err(|_| broken("a blob of negative length"))?;
        let blob =
            Blob::decode(take(size).ok_or_else(cut)?).map_err(|_| broken("a blob is damaged"))?;
        let end = at;
        // Other kinds are for other readers.
        let ours = ["OSMHeader", "OSMData"].contains(&header.kind.as_str());
        let unpacked = if ours { unpacked(&blob, &place)? } else { None };
        match (&mut out, unpacked) {
            (None, None) => {}
            (Some(out), None) => out.extend_from_slice(&bytes[start..end]),
            (_, Some(raw)) => {
                let out = out.get_or_insert_with(|| bytes[..start].to_vec());
                frame(out, &header.kind, raw);
                if out.len() > MOST_OUT {
                    let mend = "cut the extract to the city (osmium extract)";
                    let what = "its blobs unpack to more than 4 GiB";
                    return Err(Fault::new(&place, what, mend));
                }
            }
        }
    }
    Ok(out.map_or(Cow::Borrowed(bytes), Cow::Owned))
}

/// Writes a plain blob.
fn frame(out: &mut Vec<u8>, kind: &str, raw: Vec<u8>) {
    let blob = Blob {
        raw: Some(raw),
        ..Blob::default()
    }
    .encode_to_vec();
    let header = BlobHeader {
        kind: kind.into(),
        index: None,
        size: blob.len() as i32,
    }
    .encode_to_vec();
    out.extend_from_slice(&(header.len() as u32).to_be_bytes());
    out.extend_from_slice(&header);
    out.extend_from_slice(&blob);
}

/// What a blob holds, where `osmpbf` does not unpack it.
fn unpacked(blob: &Blob, place: &str) -> Result<Option<Vec<u8>>, Fault> {
    let again = "write it anew (osmium cat city.osm.pbf -o new.osm.pbf)";
    let broken = |kind: &str| {
        Fault::new(
            place,
            format!("a blob in {kind} is damaged"),
            "fetch the extract again",
        )
    };
    let refused = |kind: &str| {
        Fault::new(
            place,
            format!("its blobs are compressed by {kind}, which is not read"),
            again,
        )
    };
    let size = blob.raw_size.and_then(|size| usize::try_from(size).ok());
    let size = size.filter(|size| *size <= MOST_BYTES);
    Ok(match blob {
        Blob { raw: Some(_), .. } | Blob { zlib: Some(_), .. } => None,
        Blob {
            lz4: Some(data), ..
        } => {
            let size = size.ok_or_else(|| broken("LZ4"))? as i32;
            let data = lz4::block::decompress(data, Some(size));
            Some(data.map_err(|_| broken("LZ4"))?)
        }
        Blob {
            zstd: Some(data), ..
        } => {
            let decoder = ruzstd::decoding::StreamingDecoder::new(&data[..]);
            let mut raw = Vec::new();
            let decoder = decoder.map_err(|_| broken("Zstandard"))?;
            let read = decoder.take(MOST_BYTES as u64).read_to_end(&mut raw);
            read.map_err(|_| broken("Zstandard"))?;
            Some(raw)
        }
        Blob { lzma: Some(_), .. } => return Err(refused("LZMA")),
        Blob { bzip2: Some(_), .. } => return Err(refused("bzip2")),
        _ => {
            return Err(Fault::new(
                place,
                "a blob is empty, or compressed in a way that is not known",
                again,
            ));
        }
    })
}

/// An error that names what a header asks for and this reader has not.
pub fn check_features(bytes: &[u8]) -> Result<(), Fault> {
    for blob in BlobReader::new(Cursor::new(bytes)) {
        // Damage is found when the elements are read.
        let Ok(blob) = blob else { return Ok(()) };
        let Ok(BlobDecode::OsmHeader(header)) = blob.decode() else {
            continue;
        };
        let unknown = |name: &&String| !KNOWN.contains(&name.as_str());
        let Some(name) = header.required_features().iter().find(unknown) else {
            continue;
        };
        let (what, mend) = match name.as_str() {
            "HistoricalInformation" => (
                "it holds the history of all elements (HistoricalInformation)".to_string(),
                "take one moment of it (osmium time-filter city.osh.pbf -o city.osm.pbf)",
            ),
            name => (
                format!("it requires the feature {name}, which is not read"),
                "write it anew (osmium cat city.osm.pbf -o new.osm.pbf)",
            ),
        };
        return Err(Fault::new("header", what, mend));
    }
    Ok(())
}
