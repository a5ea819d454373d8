//! What a tile shows, whatever format it is stored in: b3dm, i3dm, pnts and cmpt (3D Tiles 1.0, OGC 18-053r2),
//! glTF 2.0 with its extensions (3D Tiles 1.1, OGC 22-025r4), any of them inside gzip. `docs/tile-content.md` says
//! which library reads what.

mod b3dm;
mod bytes;
mod draco;
mod error;
mod gltf;
mod i3dm;
mod metadata;
mod model;
mod picture;
mod place;
mod pnts;
mod semantic;
mod table;

#[cfg(test)]
mod tests;

pub use boresight_models::shape::textured::UpAxis;
pub use error::{ContentError, Fault};
pub use model::{Content, Fetch, Rows};

use bytes::{part, u32_at};
use flate2::read::MultiGzDecoder;
use glam::DAffine3;
use model::{Context, MAX_DECODED};
use std::io::Read;

/// Decodes the bytes of a content. `up_axis` is that of its glTF models, `fetch` reads what it refers to (images,
/// buffers, models of instances, schemas of metadata); its error is passed on in words.
pub fn decode(bytes: &[u8], up_axis: UpAxis, fetch: Fetch) -> Result<Content, ContentError> {
    /// Composites inside composites.
    const DEPTH: usize = 8;
    const GZIP: [u8; 2] = [0x1f, 0x8b];
    let context = Context::new(up_axis, fetch);
    if bytes.starts_with(&GZIP) {
        let unpacked = gunzip(bytes, &context)?;
        return tile(&unpacked, &context, DEPTH);
    }
    tile(bytes, &context, DEPTH)
}

/// What gzip packed, up to the limit.
fn gunzip(bytes: &[u8], context: &Context) -> Result<Vec<u8>, ContentError> {
    let mut unpacked = Vec::new();
    let mut reader = MultiGzDecoder::new(bytes).take(MAX_DECODED + 1);
    (reader.read_to_end(&mut unpacked))
        .map_err(|why| ContentError::damaged("gzip", why.to_string()))?;
    context.spend(unpacked.len(), "gzip")?;
    Ok(unpacked)
}

/// Decodes a tile by what it begins with; composites to a depth.
fn tile(bytes: &[u8], context: &Context, depth: usize) -> Result<Content, ContentError> {
    let magic = bytes.first_chunk::<4>();
    let name = match magic {
        Some(b"b3dm") => "b3dm",
        Some(b"i3dm") => "i3dm",
        Some(b"pnts") => "pnts",
        Some(b"cmpt") => "cmpt",
        Some(b"vctr" | b"geom") => {
            let what = "vector tiles (vctr, geom) were never standardized - write them as glTF";
            return Err(ContentError::unsupported("content", what));
        }
        Some(b"glTF") => return model(bytes, context),
        _ if bytes.trim_ascii_start().starts_with(b"{") => {
            refuse_other_json(bytes)?;
            return model(bytes, context);
        }
        _ => {
            let begin = String::from_utf8_lossy(&bytes[..bytes.len().min(4)]).into_owned();
            return Err(ContentError::new("content", Fault::Unknown(begin)));
        }
    };
    let body = || {
        let version = u32_at(bytes, 4, "header")?;
        if version != 1 {
            let what = format!("version {version} - version 1 is what there is");
            return Err(ContentError::unsupported("header", what));
        }
        let length = u32_at(bytes, 8, "header")? as usize;
        let bytes = part(bytes, 0, length, "header")?;
        match name {
            "b3dm" => b3dm::decode(bytes, context),
            "i3dm" => i3dm::decode(bytes, context),
            "pnts" => pnts::decode(bytes, context),
            _ => composite(bytes, context, depth),
        }
    };
    body().map_err(|why| why.within(name))
}

/// A glTF model that is a content by itself.
fn model(bytes: &[u8], context: &Context) -> Result<Content, ContentError> {
    let setting = gltf::Setting {
        outer: DAffine3::IDENTITY,
        inner: model::up(context.up_axis),
        rows: Vec::new(),
    };
    gltf::decode(bytes, setting, context)
}

/// JSON that is no glTF: an external tileset, which is no content but a tree, or GeoJSON.
fn refuse_other_json(bytes: &[u8]) -> Result<(), ContentError> {
    #[derive(serde::Deserialize, Default)]
    #[serde(default)]
    struct Kind {
        root: Option<serde::de::IgnoredAny>,
        #[serde(rename = "type")]
        kind: Option<serde::de::IgnoredAny>,
    }
    let kind: Kind = bytes::json(bytes, "JSON")?;
    let what = match kind {
        Kind { root: Some(_), .. } => "a tileset where a content belongs",
        Kind { kind: Some(_), .. } => "GeoJSON in tiles - write it as glTF",
        _ => return Ok(()),
    };
    Err(ContentError::unsupported("content", what))
}

/// Decodes a composite: tiles one behind the other, all of them one content.
fn composite(bytes: &[u8], context: &Context, depth: usize) -> Result<Content, ContentError> {
    const HEADER: usize = 16; // [byte]
    const INNER: usize = 12; // [byte]: magic, version and length
    let count = u32_at(bytes, 12, "header")? as usize;
    if depth == 0 {
        return Err(ContentError::unsupported(
            "tile 0",
            "composites nested this deep",
        ));
    }
    let mut content = Content::default();
    let mut at = HEADER;
    for index in 0..count {
        let place = format!("tile {index}");
        part(bytes, at, INNER, &place)?;
        let length = u32_at(bytes, at + 8, &place)? as usize;
        if length < INNER {
            let why = format!("its length is {length}");
            return Err(ContentError::damaged(place, why));
        }
        let inner = part(bytes, at, length, &place)?;
        let inner = tile(inner, context, depth - 1).map_err(|why| why.within(&place))?;
        content.append(inner);
        at += length;
    }
    Ok(content)
}
