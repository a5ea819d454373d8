//! Pictures of textures: PNG, JPEG and WebP through `image`, KTX2 (Basis Universal) through `basisu`.

use crate::tiles::content::error::{ContentError, Fault};
use basisu::{DecodeFlags, Supercompression, TargetFormat, Transcoder};
use boresight_models::shape::textured::Texture;
use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Longest side of a picture [px].
const MAX_SIDE: u32 = 16_384;
/// Most pixels of a picture.
const MAX_PIXELS: u64 = 1 << 26;

/// An error where a picture is too large or empty.
fn check_size([columns, rows]: [u32; 2], place: &str) -> Result<(), ContentError> {
    let too_large = |what, amount: u64, limit: u64| {
        let fault = Fault::TooLarge {
            what,
            amount,
            limit,
        };
        Err(ContentError::new(place, fault))
    };
    let pixels = u64::from(columns) * u64::from(rows);
    if pixels == 0 {
        return Err(ContentError::damaged(place, "it has no pixels"));
    }
    if columns.max(rows) > MAX_SIDE {
        return too_large("pixels a side", columns.max(rows).into(), MAX_SIDE.into());
    }
    if pixels > MAX_PIXELS {
        return too_large("pixels", pixels, MAX_PIXELS);
    }
    Ok(())
}

/// Columns and rows of a picture [px], before it is decoded.
pub(crate) fn size(bytes: &[u8], place: &str) -> Result<[u32; 2], ContentError> {
    let size = match bytes.starts_with(&KTX2) {
        true => {
            let field = |at| crate::tiles::content::bytes::u32_at(bytes, at, place);
            [field(20)?, field(24)?]
        }
        false => {
            let reader = image::ImageReader::new(Cursor::new(bytes)).with_guessed_format();
            let found = (reader.map_err(image::ImageError::from))
                .and_then(image::ImageReader::into_dimensions);
            found.map_err(|why| fault(&why, place))?.into()
        }
    };
    check_size(size, place)?;
    Ok(size)
}

/// What the library says of a picture that it does not read.
fn fault(why: &image::ImageError, place: &str) -> ContentError {
    match why {
        image::ImageError::Unsupported(why) => ContentError::unsupported(
            place,
            format!("{why} - use PNG, JPEG, WebP or KTX2 with Basis Universal"),
        ),
        why => ContentError::damaged(place, why.to_string()),
    }
}

/// What a KTX2 file begins with (KTX File Format Specification 2.0, 3.1).
const KTX2: [u8; 12] = *b"\xabKTX 20\xbb\r\n\x1a\n";

/// Decodes a picture.
pub(crate) fn decode(bytes: &[u8], place: &str) -> Result<Texture, ContentError> {
    let size_px = size(bytes, place)?;
    if bytes.starts_with(&KTX2) {
        // A port that is young: what it does not foresee shall cost one tile, not the program.
        let found = catch_unwind(AssertUnwindSafe(|| basis(bytes, size_px, place)));
        let gave_up = || {
            Err(ContentError::damaged(
                place,
                "the KTX2 decoder gave up on it",
            ))
        };
        return found.unwrap_or_else(|_| gave_up());
    }
    let mut reader = image::ImageReader::new(Cursor::new(bytes));
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(MAX_SIDE);
    limits.max_image_height = Some(MAX_SIDE);
    reader.limits(limits);
    let found = (reader.with_guessed_format())
        .map_err(image::ImageError::from)
        .and_then(image::ImageReader::decode);
    let rgba = found.map_err(|why| fault(&why, place))?.into_rgba8();
    Ok(Texture {
        size_px: rgba.dimensions().into(),
        rgba: rgba.into_raw(),
    })
}

/// Decodes the first level of a KTX2 file.
fn basis(bytes: &[u8], size_px: [u32; 2], place: &str) -> Result<Texture, ContentError> {
    let refused = |why: basisu::Error| ContentError::damaged(place, format!("{why:?}"));
    // The first level's length when unpacked, in the level index behind the header (3.4): no more than its blocks.
    const LEVEL_INDEX: usize = 80; // [byte]
    const BLOCK: u64 = 16; // [byte] for 4 × 4 pixels
    let unpacked = bytes
        .get(LEVEL_INDEX + 16..)
        .and_then(|b| b.first_chunk::<8>());
    let unpacked = u64::from_le_bytes(unpacked.copied().unwrap_or_default());
    let [columns, rows] = size_px.map(|side| u64::from(side.div_ceil(4)));
    if unpacked > columns * rows * BLOCK {
        return Err(ContentError::damaged(
            place,
            "its level is longer than its pixels",
        ));
    }
    let texture = Transcoder::new(bytes).map_err(refused)?;
    if let Supercompression::Other(scheme) = texture.supercompression() {
        let what = format!("KTX2 with supercompression {scheme} - use Basis Universal");
        return Err(ContentError::unsupported(place, what));
    }
    let rgba = texture.transcode(0, TargetFormat::Rgba32, DecodeFlags::NONE);
    Ok(Texture {
        size_px,
        rgba: rgba.map_err(refused)?,
    })
}
