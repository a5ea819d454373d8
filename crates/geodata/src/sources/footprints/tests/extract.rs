//! Writes small OpenStreetMap extracts in every variant of the format.

use prost::Message;
use std::io::Write;

#[derive(Clone, PartialEq, Message)]
struct BlobHeader {
    #[prost(string, tag = "1")]
    kind: String,
    #[prost(int32, tag = "3")]
    size: i32,
}

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
    #[prost(bytes = "vec", optional, tag = "6")]
    lz4: Option<Vec<u8>>,
    #[prost(bytes = "vec", optional, tag = "7")]
    zstd: Option<Vec<u8>>,
}

#[derive(Clone, PartialEq, Message)]
struct Header {
    #[prost(string, repeated, tag = "4")]
    required: Vec<String>,
    #[prost(string, repeated, tag = "5")]
    optional: Vec<String>,
}

#[derive(Clone, PartialEq, Message)]
struct Strings {
    #[prost(bytes = "vec", repeated, tag = "1")]
    all: Vec<Vec<u8>>,
}

#[derive(Clone, PartialEq, Message)]
struct Node {
    #[prost(sint64, tag = "1")]
    id: i64,
    #[prost(uint32, repeated, tag = "2")]
    keys: Vec<u32>,
    #[prost(uint32, repeated, tag = "3")]
    values: Vec<u32>,
    #[prost(sint64, tag = "8")]
    lat: i64,
    #[prost(sint64, tag = "9")]
    lon: i64,
}

#[derive(Clone, PartialEq, Message)]
struct Dense {
    #[prost(sint64, repeated, tag = "1")]
    ids: Vec<i64>,
    #[prost(sint64, repeated, tag = "8")]
    lats: Vec<i64>,
    #[prost(sint64, repeated, tag = "9")]
    lons: Vec<i64>,
}

#[derive(Clone, PartialEq, Message)]
struct Way {
    #[prost(int64, tag = "1")]
    id: i64,
    #[prost(uint32, repeated, tag = "2")]
    keys: Vec<u32>,
    #[prost(uint32, repeated, tag = "3")]
    values: Vec<u32>,
    #[prost(sint64, repeated, tag = "8")]
    refs: Vec<i64>,
    #[prost(sint64, repeated, tag = "9")]
    lats: Vec<i64>,
    #[prost(sint64, repeated, tag = "10")]
    lons: Vec<i64>,
}

#[derive(Clone, PartialEq, Message)]
struct Group {
    #[prost(message, repeated, tag = "1")]
    nodes: Vec<Node>,
    #[prost(message, optional, tag = "2")]
    dense: Option<Dense>,
    #[prost(message, repeated, tag = "3")]
    ways: Vec<Way>,
}

#[derive(Clone, PartialEq, Message)]
struct Block {
    #[prost(message, optional, tag = "1")]
    strings: Option<Strings>,
    #[prost(message, repeated, tag = "2")]
    groups: Vec<Group>,
    #[prost(int32, optional, tag = "17")]
    granularity: Option<i32>,
    #[prost(int32, optional, tag = "18")]
    date_granularity: Option<i32>,
    #[prost(int64, optional, tag = "19")]
    lat_offset: Option<i64>,
    #[prost(int64, optional, tag = "20")]
    lon_offset: Option<i64>,
}

/// How blobs are packed.
#[derive(Clone, Copy, Debug)]
pub enum Packed {
    Raw,
    Zlib,
    Lz4,
    Zstd,
    Lzma,
}

/// Where the places of corners are written.
#[derive(Clone, Copy, Debug)]
pub enum Places {
    Nodes,
    Dense,
    Ways,
}

/// A variant of the format.
#[derive(Clone, Debug)]
pub struct Variant {
    pub packed: Packed,
    pub places: Places,
    /// Unit of coordinates [1e-9 deg].
    pub granularity: i32,
    /// Added to latitudes and longitudes [1e-9 deg].
    pub offset: [i64; 2],
    pub required: Vec<String>,
    /// The number of the first way and node; the others count downwards.
    pub first_id: i64,
}

impl Default for Variant {
    fn default() -> Self {
        Self {
            packed: Packed::Zlib,
            places: Places::Dense,
            granularity: 100,
            offset: [0; 2],
            required: vec!["OsmSchema-V0.6".into(), "DenseNodes".into()],
            first_id: 1_000_000,
        }
    }
}

/// A closed way: corners (longitude, latitude) [1e-9 deg], tags.
pub type House<'h> = (Vec<[i64; 2]>, &'h [(&'h str, &'h str)]);

fn deltas(values: impl Iterator<Item = i64>) -> Vec<i64> {
    let mut last = 0;
    values
        .map(|value| value - std::mem::replace(&mut last, value))
        .collect()
}

fn put(out: &mut Vec<u8>, kind: &str, raw: Vec<u8>, packed: Packed) {
    let raw_size = Some(raw.len() as i32);
    let mut blob = Blob::default();
    match packed {
        Packed::Raw => blob.raw = Some(raw),
        Packed::Zlib => {
            let mut encoder =
                flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::new(6));
            encoder.write_all(&raw).unwrap();
            blob = Blob {
                raw_size,
                zlib: Some(encoder.finish().unwrap()),
                ..blob
            };
        }
        Packed::Lz4 => {
            let data = lz4::block::compress(&raw, None, false).unwrap();
            blob = Blob {
                raw_size,
                lz4: Some(data),
                ..blob
            };
        }
        Packed::Zstd => {
            let level = ruzstd::encoding::CompressionLevel::Fastest;
            let data = ruzstd::encoding::compress_to_vec(&raw[..], level);
            blob = Blob {
                raw_size,
                zstd: Some(data),
                ..blob
            };
        }
        Packed::Lzma => {
            blob = Blob {
                raw_size,
                lzma: Some(raw),
                ..blob
            }
        }
    }
    let blob = blob.encode_to_vec();
    let header = BlobHeader {
        kind: kind.into(),
        size: blob.len() as i32,
    }
    .encode_to_vec();
    out.extend((header.len() as u32).to_be_bytes());
    out.extend(header);
    out.extend(blob);
}

/// An extract of closed ways.
pub fn extract(houses: &[House], variant: &Variant) -> Vec<u8> {
    let mut strings: Vec<Vec<u8>> = vec![Vec::new()];
    let mut of = |text: &str| {
        strings.push(text.as_bytes().to_vec());
        strings.len() as u32 - 1
    };
    let stored = |value: i64, axis: usize| {
        let off = value - variant.offset[axis];
        assert_eq!(
            off % i64::from(variant.granularity),
            0,
            "the unit holds the place"
        );
        off / i64::from(variant.granularity)
    };
    let mut id = variant.first_id;
    let mut next = || {
        id -= 1;
        id
    };
    let (mut nodes, mut ways) = (Vec::new(), Vec::new());
    for (ring, tags) in houses {
        let mut refs: Vec<i64> = ring.iter().map(|_| next()).collect();
        let corners = refs.iter().zip(ring);
        nodes.extend(corners.map(|(id, [lon, lat])| (*id, stored(*lat, 0), stored(*lon, 1))));
        refs.push(refs[0]);
        let places = || {
            ring.iter()
                .chain(&ring[..1])
                .filter(|_| matches!(variant.places, Places::Ways))
        };
        ways.push(Way {
            id: next(),
            keys: tags.iter().map(|(key, _)| of(key)).collect(),
            values: tags.iter().map(|(_, value)| of(value)).collect(),
            lats: deltas(places().map(|[_, lat]| stored(*lat, 0))),
            lons: deltas(places().map(|[lon, _]| stored(*lon, 1))),
            refs: deltas(refs.into_iter()),
        });
    }
    let mut group = Group::default();
    match variant.places {
        Places::Nodes => {
            let node = |(id, lat, lon)| Node {
                id,
                lat,
                lon,
                ..Node::default()
            };
            group.nodes = nodes.into_iter().map(node).collect();
        }
        Places::Dense => {
            nodes.sort();
            group.dense = Some(Dense {
                ids: deltas(nodes.iter().map(|node| node.0)),
                lats: deltas(nodes.iter().map(|node| node.1)),
                lons: deltas(nodes.iter().map(|node| node.2)),
            });
        }
        Places::Ways => {}
    }
    let ways = Group {
        ways,
        ..Group::default()
    };
    let block = Block {
        strings: Some(Strings { all: strings }),
        groups: vec![group, ways],
        granularity: Some(variant.granularity),
        date_granularity: Some(500),
        lat_offset: Some(variant.offset[0]),
        lon_offset: Some(variant.offset[1]),
    };
    let header = Header {
        required: variant.required.clone(),
        optional: vec!["Sort.Type_then_ID".into()],
    };
    let mut out = Vec::new();
    put(
        &mut out,
        "OSMHeader",
        header.encode_to_vec(),
        variant.packed,
    );
    put(&mut out, "OSMData", block.encode_to_vec(), variant.packed);
    out
}
