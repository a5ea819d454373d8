//! How a track is coded, and what its description says of its pictures (`stsd`; ISO/IEC 14496-12 and -15, QuickTime).

use super::boxes::{Broken, child, children, format, u32_at};
use super::sps::{Stated, stated};

/// What the pictures of a track are to be.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Description {
    /// Bytes of the length before each unit of a sample.
    pub(super) length_bytes: usize,
    /// Parameter sets, with start codes.
    pub(super) head: Vec<u8>,
    /// What the first sequence parameter set says; nothing where the sets stand in the frames.
    pub(super) stated: Option<Stated>,
    /// Matrix of colours, transfer characteristics and whether they fill 0 to 255, where the container says so.
    pub(super) colours: Option<([u16; 2], Option<bool>)>,
    /// Width over height of a pixel, where the container says so.
    pub(super) aspect: Option<[u32; 2]>,
    /// What of the picture is shown, where that is said.
    pub(super) aperture: Option<Aperture>,
    /// Whether a frame is of two fields.
    pub(super) fields: bool,
}

/// The part of a picture that is shown (`clap`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Aperture {
    /// Width and height [px].
    pub(super) size_px: [f64; 2],
    /// Its middle right of and below that of the picture [px].
    pub(super) middle_px: [f64; 2],
}

impl Aperture {
    fn read(clap: &[u8]) -> Option<Self> {
        let ratio = |at: usize| {
            let (top, bottom) = (u32_at(clap, at)?, u32_at(clap, at + 4)?);
            (bottom != 0).then(|| f64::from(top.cast_signed()) / f64::from(bottom.cast_signed()))
        };
        Some(Self {
            size_px: [ratio(0)?, ratio(8)?],
            middle_px: [ratio(16)?, ratio(24)?],
        })
    }

    /// Left, top, width and height in a picture of a size [px]; none where it does not lie in the picture.
    pub(super) fn rectangle(self, size_px: [u32; 2]) -> Option<[u32; 4]> {
        let side = |i: usize| {
            let (whole, wanted) = (f64::from(size_px[i]), self.size_px[i].round());
            let from = (0.5 * (whole - wanted) + self.middle_px[i]).round();
            let inside = wanted >= 1.0 && from >= 0.0 && from + wanted <= whole;
            inside.then_some((from as u32, wanted as u32))
        };
        let ([left, width], [top, height]) =
            (side(0).map(|(a, b)| [a, b])?, side(1).map(|(a, b)| [a, b])?);
        Some([left, top, width, height])
    }
}

/// The name of a coding that is not H.264.
fn coding(kind: &[u8; 4]) -> &'static str {
    match kind {
        b"hvc1" | b"hev1" | b"hvc2" | b"hev2" => "H.265 (HEVC)",
        b"vvc1" | b"vvi1" => "H.266 (VVC)",
        b"dvh1" | b"dvhe" | b"dva1" | b"dvav" => "Dolby Vision",
        b"av01" => "AV1",
        b"vp08" | b"vp09" => "VP8 or VP9",
        b"mp4v" => "MPEG-4 Part 2",
        b"mp1v" | b"m1v " | b"mp2v" | b"m2v1" | b"mpg2" | b"hdv1" | b"hdv2" | b"hdv3" => {
            "MPEG-1 or MPEG-2"
        }
        b"s263" | b"h263" | b"H263" => "H.263",
        b"jpeg" | b"mjpg" | b"MJPG" | b"mjpa" | b"mjpb" => "Motion JPEG",
        b"mjp2" => "Motion JPEG 2000",
        b"apco" | b"apcs" | b"apcn" | b"apch" | b"ap4h" | b"ap4x" => "ProRes",
        b"AVdn" | b"AVdh" => "DNxHD",
        b"dvc " | b"dvcp" | b"dvpp" | b"dv5n" | b"dv5p" | b"dvh5" | b"dvh6" => "DV",
        b"SVQ1" | b"SVQ3" => "Sorenson Video",
        b"raw " | b"2vuy" | b"yuv2" | b"v210" | b"uncv" => "uncompressed",
        b"rle " => "QuickTime Animation",
        b"png " => "PNG",
        _ => "of another kind",
    }
}

/// Whether a track of an `stbl` box is H.264.
pub(super) fn is_h264(stbl: &[u8]) -> bool {
    let entry = child(stbl, b"stsd").and_then(|stsd| children(stsd.get(8..)?).next());
    entry.is_some_and(|(kind, _)| is_avc(&kind))
}

fn is_avc(kind: &[u8; 4]) -> bool {
    matches!(kind, b"avc1" | b"avc2" | b"avc3" | b"avc4")
}

/// The descriptions of an `stbl` box, in their order.
pub(super) fn descriptions(stbl: &[u8]) -> Result<Vec<Description>, Broken> {
    let entries = child(stbl, b"stsd")
        .and_then(|stsd| stsd.get(8..))
        .unwrap_or_default();
    let found: Result<Vec<_>, _> = children(entries)
        .map(|(kind, entry)| description(&kind, entry))
        .collect();
    match found {
        Ok(none) if none.is_empty() => Err(format("it does not say how its video is coded")),
        found => found,
    }
}

fn description(kind: &[u8; 4], entry: &[u8]) -> Result<Description, Broken> {
    if !is_avc(kind) {
        let name = String::from_utf8_lossy(kind).into_owned();
        if matches!(kind, b"encv" | b"drmi") {
            return Err(format(format!(
                "its video is encrypted ('{name}'): decrypt it first"
            )));
        }
        let what = coding(kind);
        return Err(format(format!("its video is {what} ('{name}'), not H.264")));
    }
    // 78 bytes of a visual sample entry come before its boxes.
    let boxes = entry.get(78..).unwrap_or_default();
    let avcc = child(boxes, b"avcC")
        .ok_or_else(|| format("it lacks the parameters of its H.264 video"))?;
    let (length_bytes, sets) =
        parameters(avcc).ok_or_else(|| format("the parameters of its H.264 video are damaged"))?;
    let mut head = Vec::new();
    for set in &sets {
        head.extend([0, 0, 0, 1]);
        head.extend(*set);
    }
    let u16_at = |data: &[u8], at: usize| Some(u16::from_be_bytes(*data.get(at..)?.first_chunk()?));
    let colours = |colr: &[u8]| {
        let full = match colr.get(..4)? {
            b"nclx" => Some(colr.get(10)? & 0x80 != 0),
            b"nclc" => None,
            _ => return None,
        };
        Some(([u16_at(colr, 8)?, u16_at(colr, 6)?], full))
    };
    let pasp = |pasp: &[u8]| Some([u32_at(pasp, 0)?, u32_at(pasp, 4)?]);
    Ok(Description {
        length_bytes,
        head,
        stated: sets.iter().find_map(|set| stated(set)),
        colours: children(boxes)
            .filter(|(kind, _)| kind == b"colr")
            .find_map(|(_, colr)| colours(colr)),
        aspect: child(boxes, b"pasp").and_then(pasp),
        aperture: child(boxes, b"clap").and_then(Aperture::read),
        fields: child(boxes, b"fiel").is_some_and(|fiel| fiel.first() == Some(&2)),
    })
}

/// Bytes of a unit's length, and the parameter sets.
fn parameters(avcc: &[u8]) -> Option<(usize, Vec<&[u8]>)> {
    let length_bytes = usize::from(avcc.get(4)? & 3) + 1;
    let mut sets = Vec::new();
    let mut rest = avcc.get(5..)?;
    for mask in [0x1f, 0xff] {
        let (count, after) = rest.split_first()?;
        rest = after;
        for _ in 0..count & mask {
            let (size, after) = rest.split_at_checked(2)?;
            let size = usize::from(size[0]) << 8 | usize::from(size[1]);
            let (set, after) = after.split_at_checked(size)?;
            sets.push(set);
            rest = after;
        }
    }
    Some((length_bytes, sets))
}
