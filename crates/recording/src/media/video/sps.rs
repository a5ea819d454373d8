//! What a sequence parameter set of H.264 says of its pictures beside what the decoder reads (ITU-T H.264, 7.3.2.1.1 and E.1.1).

use rusty_h264_common::BitReader;
use rusty_h264_common::nal::emulation_unprevent;

/// Profiles whose sets carry chroma format, bit depths and scaling lists.
const HIGH_PROFILES: [u32; 13] = [100, 110, 122, 244, 44, 83, 86, 118, 128, 138, 139, 134, 135];
/// Aspects of pixels by their number (table E-1).
const ASPECTS: [[u32; 2]; 17] = [
    [1, 1],
    [1, 1],
    [12, 11],
    [10, 11],
    [16, 11],
    [40, 33],
    [24, 11],
    [20, 11],
    [32, 11],
    [80, 33],
    [18, 11],
    [15, 11],
    [64, 33],
    [160, 99],
    [4, 3],
    [3, 2],
    [2, 1],
];

/// What a parameter set says of its pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Stated {
    /// Columns and rows that are cut off left and at the top [px].
    pub(super) corner_px: [u32; 2],
    /// Width over height of a pixel, where it is said.
    pub(super) aspect: Option<[u32; 2]>,
    /// Whether brightness and colours fill 0 to 255, where it is said.
    pub(super) full_range: Option<bool>,
    /// Code of the transfer characteristics, where it is said (table E-4).
    pub(super) transfer: Option<u16>,
    /// Code of the matrix of colours, where it is said (table E-5).
    pub(super) matrix: Option<u16>,
}

/// What a parameter set says, given with its head; nothing where it is damaged or of a kind that the decoder refuses.
pub(super) fn stated(unit: &[u8]) -> Option<Stated> {
    if unit.first()? & 0x1f != 7 {
        return None;
    }
    let rbsp = emulation_unprevent(&unit[1..]);
    let mut bits = BitReader::new(&rbsp);
    read(&mut bits)
}

fn skip_scaling_list(bits: &mut BitReader<'_>, size: usize) -> Option<()> {
    let (mut last, mut next) = (8_i64, 8_i64);
    for _ in 0..size {
        if next != 0 {
            next = (last + i64::from(bits.read_se().ok()?) + 256).rem_euclid(256);
        }
        last = if next == 0 { last } else { next };
    }
    Some(())
}

fn read(bits: &mut BitReader<'_>) -> Option<Stated> {
    let profile = bits.read_bits(8).ok()?;
    bits.read_bits(16).ok()?;
    bits.read_ue().ok()?;
    if HIGH_PROFILES.contains(&profile) {
        let chroma = bits.read_ue().ok()?;
        if chroma == 3 {
            bits.read_bit().ok()?;
        }
        bits.read_ue().ok()?;
        bits.read_ue().ok()?;
        bits.read_bit().ok()?;
        if bits.read_bit().ok()? {
            for i in 0..if chroma == 3 { 12 } else { 8 } {
                if bits.read_bit().ok()? {
                    skip_scaling_list(bits, if i < 6 { 16 } else { 64 })?;
                }
            }
        }
    }
    bits.read_ue().ok()?;
    match bits.read_ue().ok()? {
        0 => {
            bits.read_ue().ok()?;
        }
        1 => {
            bits.read_bit().ok()?;
            bits.read_se().ok()?;
            bits.read_se().ok()?;
            for _ in 0..bits.read_ue().ok()?.min(255) {
                bits.read_se().ok()?;
            }
        }
        _ => {}
    }
    // References, gaps, width and height.
    bits.read_ue().ok()?;
    bits.read_bit().ok()?;
    bits.read_ue().ok()?;
    bits.read_ue().ok()?;
    let frames_only = bits.read_bit().ok()?;
    if !frames_only {
        bits.read_bit().ok()?;
    }
    bits.read_bit().ok()?;
    let mut stated = Stated::default();
    if bits.read_bit().ok()? {
        let mut sides = [0; 4];
        for side in &mut sides {
            *side = bits.read_ue().ok()?;
        }
        let rows = if frames_only { 2 } else { 4 };
        stated.corner_px = [sides[0].checked_mul(2)?, sides[2].checked_mul(rows)?];
    }
    if bits.read_bit().ok()? {
        usability(bits, &mut stated);
    }
    Some(stated)
}

/// Reads the usability information up to the colours; stops where it ends.
fn usability(bits: &mut BitReader<'_>, stated: &mut Stated) -> Option<()> {
    if bits.read_bit().ok()? {
        let number = bits.read_bits(8).ok()?;
        stated.aspect = match number {
            255 => Some([bits.read_bits(16).ok()?, bits.read_bits(16).ok()?]),
            0 => None,
            _ => ASPECTS.get(number as usize).copied(),
        };
    }
    if bits.read_bit().ok()? {
        bits.read_bit().ok()?;
    }
    if bits.read_bit().ok()? {
        bits.read_bits(3).ok()?;
        stated.full_range = Some(bits.read_bit().ok()?);
        if bits.read_bit().ok()? {
            bits.read_bits(8).ok()?;
            stated.transfer = Some(bits.read_bits(8).ok()? as u16);
            stated.matrix = Some(bits.read_bits(8).ok()? as u16);
        }
    }
    Some(())
}
