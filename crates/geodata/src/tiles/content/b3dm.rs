//! Batched 3D models (b3dm): a glTF model and what is known of its parts.

use crate::tiles::content::bytes::{Kind, u32_at};
use crate::tiles::content::error::ContentError;
use crate::tiles::content::gltf::{self, Setting};
use crate::tiles::content::model::{Content, Context, up};
use crate::tiles::content::table::Parts;
use glam::{DAffine3, DVec3};

/// Length of the header [byte].
const HEADER: usize = 28;

/// The tables, the number of features, and the glTF model of a tile. Two older headers are known by the text that
/// begins where today's has lengths: no length is as large as four characters.
fn split(bytes: &[u8]) -> Result<(Parts<'_>, Option<usize>), ContentError> {
    const TEXT: u32 = 0x2200_0000; // the least number whose last byte is the character '"'
    let field = |at| u32_at(bytes, at, "header");
    let [a, b, c] = [field(12)?, field(16)?, field(20)?];
    if c >= TEXT {
        // magic, version, length, batch length, length of the batch table
        let parts = Parts::new(bytes, 20, [0, 0, b, 0], "header")?;
        return Ok((parts, Some(a as usize)));
    }
    let d = field(24)?;
    if d >= TEXT {
        // magic, version, length, length of the batch table's JSON and binary part, batch length
        let parts = Parts::new(bytes, 24, [0, 0, a, b], "header")?;
        return Ok((parts, Some(c as usize)));
    }
    Ok((Parts::new(bytes, HEADER, [a, b, c, d], "header")?, None))
}

/// Decodes a b3dm, whose bytes end where it does.
pub(crate) fn decode(bytes: &[u8], context: &Context) -> Result<Content, ContentError> {
    let (parts, legacy_count) = split(bytes)?;
    let count = match legacy_count {
        Some(count) => count,
        None => parts.features.count("BATCH_LENGTH")?.unwrap_or(0),
    };
    let center = parts.features.vector("RTC_CENTER", Kind::F32)?;
    let (rows, notes) = parts.batch.rows(count, bytes.len(), context)?;
    let setting = Setting {
        outer: DAffine3::from_translation(DVec3::from(center.unwrap_or_default())),
        inner: up(context.up_axis),
        rows,
    };
    let mut content = gltf::decode(parts.body, setting, context)?;
    for note in notes {
        content.note(note);
    }
    Ok(content)
}
