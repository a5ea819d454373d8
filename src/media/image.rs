//! Pictures of red, green and blue bytes: read from PNG and JPEG, written as JPEG.

use image::{ImageReader, Limits, RgbImage};
use std::io::Cursor;

/// Most bytes of a decoded picture, so that a damaged header asks for no more memory than there is.
const MAX_BYTES: u64 = 1 << 30; // [byte]

/// Why a picture cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// The bytes are not a picture that is understood.
    #[error("no picture ({0})")]
    Decode(#[from] image::ImageError),
    /// The pixels cannot be encoded.
    #[error("a picture cannot be encoded: {0}")]
    Encode(#[from] jpeg_encoder::EncodingError),
    /// A side is longer than JPEG allows.
    #[error(
        "a picture of {width} × {height} px cannot be encoded as JPEG, whose sides end at 65535 px; take a smaller one"
    )]
    TooLarge {
        /// Width [px].
        width: u32,
        /// Height [px].
        height: u32,
    },
}

/// Reads a PNG or JPEG file. Grey pictures become coloured ones, transparency is left out.
pub fn decode(bytes: &[u8]) -> Result<RgbImage, ImageError> {
    let reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format();
    let mut reader = reader.map_err(image::ImageError::from)?;
    let mut limits = Limits::default();
    limits.max_alloc = Some(MAX_BYTES);
    reader.limits(limits);
    Ok(reader.decode()?.into_rgb8())
}

/// Encodes rows of red, green and blue bytes as JPEG of the given quality, 1 to 100; below 90 the chroma
/// is halved.
///
/// The encoder is not that of `image`, which has neither SIMD nor halved chroma: it takes some seven times
/// as long for a file a tenth larger (`cargo bench -- jpeg`).
pub fn encode_jpeg(
    rgb8: &[u8],
    width: u16,
    height: u16,
    quality: u8,
) -> Result<Vec<u8>, ImageError> {
    let mut jpeg = Vec::with_capacity(rgb8.len() / 8);
    jpeg_encoder::Encoder::new(&mut jpeg, quality).encode(
        rgb8,
        width,
        height,
        jpeg_encoder::ColorType::Rgb,
    )?;
    Ok(jpeg)
}

/// Encodes a picture as JPEG of the given quality, 1 to 100.
pub fn jpeg_of(picture: &RgbImage, quality: u8) -> Result<Vec<u8>, ImageError> {
    let (width, height) = picture.dimensions();
    match (u16::try_from(width), u16::try_from(height)) {
        (Ok(width), Ok(height)) => encode_jpeg(picture.as_raw(), width, height, quality),
        _ => Err(ImageError::TooLarge { width, height }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{DynamicImage, GrayImage, ImageFormat, RgbaImage};
    use proptest::prelude::*;

    fn png(picture: impl Into<DynamicImage>) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        (picture.into())
            .write_to(&mut bytes, ImageFormat::Png)
            .expect("a PNG");
        bytes.into_inner()
    }

    fn grey() -> Vec<u8> {
        png(GrayImage::from_raw(3, 2, vec![1, 2, 3, 4, 5, 6]).expect("a picture"))
    }

    #[test]
    fn grey_and_transparent_pictures_are_read_in_colour() {
        let picture = decode(&grey()).expect("a picture");
        assert_eq!(picture.dimensions(), (3, 2));
        assert_eq!(picture.as_raw()[..6], [1, 1, 1, 2, 2, 2]);
        let clear = RgbaImage::from_raw(2, 1, vec![9, 8, 7, 255, 1, 2, 3, 0]).expect("a picture");
        let picture = decode(&png(clear)).expect("a picture");
        assert_eq!(*picture.as_raw(), [9, 8, 7, 1, 2, 3]);
        let jpeg = encode_jpeg(&[200; 16 * 8 * 3], 16, 8, 90).expect("a JPEG");
        let picture = decode(&jpeg).expect("a picture");
        assert_eq!(picture.dimensions(), (16, 8));
        assert!(picture.as_raw().iter().all(|&c| c.abs_diff(200) < 4));
    }

    #[test]
    fn what_cannot_be_encoded_is_told() {
        assert!(encode_jpeg(&[0; 5], 2, 1, 90).is_err());
    }

    proptest! {
        /// Any bytes are a picture or refused.
        #[test]
        fn any_bytes_are_a_picture_or_refused(
            bytes in prop::collection::vec(any::<u8>(), 0..200), at in 0..60_usize,
        ) {
            let _ = decode(&bytes);
            let mut png = grey();
            let n = png.len();
            png[at % n] ^= bytes.first().copied().unwrap_or(1);
            let _ = decode(&png);
        }
    }
}
