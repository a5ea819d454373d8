//! Pictures of red, green and blue bytes: read from PNG and JPEG, written as JPEG.

use boresight_common::jpeg::is_cut_off;
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
    /// A JPEG without its end: decoders show grey for what is missing.
    #[error("the JPEG is cut off")]
    CutOff,
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
    if is_cut_off(bytes) {
        return Err(ImageError::CutOff);
    }
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

/// Qualities below the wanted one that [`encode_within`] takes, a fifth to a third of the bytes apart.
const LOWER: [u8; 9] = [80, 70, 60, 50, 40, 30, 20, 10, 5];

/// Encodes as [`encode_jpeg`] does, in the best of a few qualities up to `quality` with which it takes at most `most_bytes`;
/// in the least of them where none does. The same picture gives the same bytes.
pub fn encode_within(
    rgb8: &[u8],
    size_px: [u16; 2],
    quality: u8,
    most_bytes: usize,
) -> Result<Vec<u8>, ImageError> {
    let [width, height] = size_px;
    let best = encode_jpeg(rgb8, width, height, quality)?;
    if best.len() <= most_bytes {
        return Ok(best);
    }
    let lower: Vec<u8> = LOWER.into_iter().filter(|lower| *lower < quality).collect();
    // Bytes grow with the quality: the first of these qualities that fits is searched by halving.
    let (mut low, mut high) = (0, lower.len());
    let mut fits = None;
    while low < high {
        let middle = (low + high) / 2;
        let jpeg = encode_jpeg(rgb8, width, height, lower[middle])?;
        if jpeg.len() <= most_bytes {
            high = middle;
            fits = Some(jpeg);
        } else {
            low = middle + 1;
        }
    }
    match (fits, lower.last()) {
        (Some(jpeg), _) => Ok(jpeg),
        (None, Some(least)) => encode_jpeg(rgb8, width, height, *least),
        (None, None) => Ok(best),
    }
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

    #[test]
    fn a_jpeg_without_its_end_is_refused() {
        let rgb8: Vec<u8> = (0..3 * 64 * 64).map(|k| (k * 7 % 251) as u8).collect();
        let jpeg = encode_jpeg(&rgb8, 64, 64, 90).unwrap();
        assert!(decode(&jpeg).is_ok());
        // A picture in the metadata has an end of its own, and blanks may follow the file's.
        let mut app1 = vec![0xff, 0xd8, 0xff, 0xe1, 0, 6, 0xff, 0xd9, 0, 0];
        app1.extend(&jpeg[2..]);
        app1.extend([0; 9]);
        assert!(decode(&app1).is_ok());
        for length in [3, 30, app1.len() / 2, app1.len() - 12] {
            let cut = decode(&app1[..length]).unwrap_err().to_string();
            assert_eq!(cut, "the JPEG is cut off", "{length}");
        }
        assert!(!is_cut_off(b"\x89PNG") && !is_cut_off(b""));
    }
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

    /// Grey noise of this deviation about a plain picture.
    fn noise(deviation: f64, size_px: [u16; 2]) -> Vec<u8> {
        let mut rng = boresight_models::maths::rng::Stream::new(1, 0, "noise");
        let values = 3 * usize::from(size_px[0]) * usize::from(size_px[1]);
        (0..values)
            .map(|_| (30.0 + deviation * rng.normal()).round() as u8)
            .collect()
    }

    #[test]
    fn noise_is_kept_within_its_bytes_and_a_clean_picture_in_its_quality() {
        let size_px = [320, 240];
        let [width, height] = size_px;
        let clean = noise(0.0, size_px);
        let whole = encode_jpeg(&clean, width, height, 90).unwrap();
        assert_eq!(encode_within(&clean, size_px, 90, 9_600).unwrap(), whole);
        for deviation in [3.0, 8.0, 20.0] {
            let noisy = noise(deviation, size_px);
            let free = encode_jpeg(&noisy, width, height, 90).unwrap();
            for most_bytes in [38_400, 19_200, 9_600] {
                let jpeg = encode_within(&noisy, size_px, 90, most_bytes).unwrap();
                assert!(
                    jpeg.len() <= most_bytes,
                    "{deviation}: {} of {most_bytes}",
                    jpeg.len()
                );
                // No coarser than it need be: the next quality would not have fitted, or it is the wanted one.
                let next = (LOWER.iter().rev().copied().chain([90]))
                    .map(|quality| encode_jpeg(&noisy, width, height, quality).unwrap())
                    .find(|larger| larger.len() > jpeg.len());
                assert!(next.is_none_or(|next| next.len() > most_bytes));
                assert_eq!(decode(&jpeg).unwrap().dimensions(), (320, 240));
            }
            assert_eq!(
                encode_within(&noisy, size_px, 90, usize::MAX).unwrap(),
                free
            );
        }
        // Nothing fits into nothing: the least quality is taken.
        let least = encode_within(&noise(8.0, size_px), size_px, 90, 10).unwrap();
        assert!(least.len() > 10 && decode(&least).is_ok());
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
