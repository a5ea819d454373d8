//! Whether a picture file is whole.

/// Whether a JPEG lacks its end (ITU T.81, B.1): a picture inside its metadata has one of its own.
pub fn is_cut_off(jpeg: &[u8]) -> bool {
    if !jpeg.starts_with(&[0xff, 0xd8]) {
        return false;
    }
    let mut at = 2;
    while let Some([0xff, marker, rest @ ..]) = jpeg.get(at..) {
        match (*marker, rest) {
            // Bytes that fill up, and markers without a length.
            (0xff, _) => at += 1,
            (0x01 | 0xd0..=0xd7, _) => at += 2,
            (0xd9, _) => return false,
            // The picture itself.
            (0xda, _) => return !rest.windows(2).any(|pair| pair == [0xff, 0xd9]),
            (_, [high, low, ..]) => at += 2 + usize::from(u16::from_be_bytes([*high, *low])),
            _ => return true,
        }
    }
    at + 2 > jpeg.len()
}
