//! How a picture is turned and mirrored before it is shown (matrices of `tkhd` and `mvhd`).

use super::boxes::{Broken, format, u32_at};
use image::RgbImage;
use image::imageops::{flip_horizontal_in_place, flip_vertical_in_place};

/// A turn by quarters, with or without a mirror.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Turn {
    /// Whether rows become columns, first of all.
    swapped: bool,
    /// Whether left and right change places then.
    mirrored: bool,
    /// Whether top and bottom do.
    upside_down: bool,
}

/// Share of a matrix's largest number below which another counts as none.
const NONE: f64 = 0.01;

/// The turning part of the matrix at `at` of a box: `[a, b, c, d]` of x' = a x + c y, y' = b x + d y, right and down.
/// One that is missing or empty turns nothing.
pub(super) fn matrix(data: &[u8], at: usize) -> [f64; 4] {
    let number = |i: usize| Some(f64::from(u32_at(data, at + 4 * i)?.cast_signed()) / 65_536.0);
    let read = || Some([number(0)?, number(1)?, number(3)?, number(4)?]);
    match read() {
        Some(matrix) if matrix != [0.0; 4] => matrix,
        _ => [1.0, 0.0, 0.0, 1.0],
    }
}

impl Turn {
    /// The turn by the matrix of a track, and then by that of its movie.
    pub(super) fn of(track: [f64; 4], movie: [f64; 4]) -> Result<Self, Broken> {
        let [a, b, c, d] = track;
        let [e, f, g, h] = movie;
        let [a, b, c, d] = [a * e + b * g, a * f + b * h, c * e + d * g, c * f + d * h];
        let none = NONE
            * [a, b, c, d]
                .into_iter()
                .fold(0.0, |most, x| x.abs().max(most));
        let is_none = |x: f64| x.abs() <= none;
        match [a, b, c, d].map(is_none) {
            [false, true, true, false] => Ok(Self {
                swapped: false,
                mirrored: a < 0.0,
                upside_down: d < 0.0,
            }),
            [true, false, false, true] => Ok(Self {
                swapped: true,
                mirrored: c < 0.0,
                upside_down: b < 0.0,
            }),
            _ => Err(format(format!(
                "its picture is turned by {:.0}° or sheared",
                b.atan2(a).to_degrees()
            ))),
        }
    }

    /// The picture as it is shown.
    pub(super) fn apply(self, picture: RgbImage) -> RgbImage {
        let mut picture = match self.swapped {
            false => picture,
            true => RgbImage::from_fn(picture.height(), picture.width(), |i, j| {
                *picture.get_pixel(j, i)
            }),
        };
        if self.mirrored {
            flip_horizontal_in_place(&mut picture);
        }
        if self.upside_down {
            flip_vertical_in_place(&mut picture);
        }
        picture
    }
}
