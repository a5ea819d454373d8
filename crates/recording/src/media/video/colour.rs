//! Red, green and blue from 4:2:0 pictures, and back by BT.601 in limited range.

use image::{Rgb, RgbImage};
use rusty_h264_common::YuvFrame;

/// How brightness and colour differences are made of red, green and blue.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Colours {
    /// Shares of red and blue in the brightness.
    shares: [f64; 2],
    /// Whether they fill 0 to 255 rather than 16 to 235 and 240.
    full: bool,
}

/// BT.601 in limited range.
const BT601: Colours = Colours {
    shares: [0.299, 0.114],
    full: false,
};

impl Colours {
    /// Those of a matrix by its code (ITU-T H.273, table 4); none of one that is no matrix of brightness and colour
    /// differences, or of a constant luminance. What is not said is BT.601.
    pub(super) fn of(matrix: Option<u16>, full: bool) -> Option<Self> {
        let shares = match matrix {
            Some(1) => [0.2126, 0.0722],
            Some(4) => [0.30, 0.11],
            Some(7) => [0.212, 0.087],
            Some(9) => [0.2627, 0.0593],
            None | Some(2 | 3 | 5 | 6) => BT601.shares,
            _ => return None,
        };
        Some(Self { shares, full })
    }
}

/// Red, green, blue of a 4:2:0 picture, in 16-bit fixed point.
pub(super) fn rgb_of(frame: &YuvFrame, colours: Colours) -> RgbImage {
    let [red, blue] = colours.shares;
    let green = 1.0 - red - blue;
    let (luma, chroma, black) = match colours.full {
        true => (1.0, 1.0, 0),
        false => (255.0 / 219.0, 255.0 / 224.0, 16),
    };
    let fixed = |factor: f64| (65_536.0 * factor).round() as i32;
    let of_luma = fixed(luma);
    let [red_v, blue_u] = [red, blue].map(|share| fixed(2.0 * (1.0 - share) * chroma));
    let [green_v, green_u] =
        [red, blue].map(|share| fixed(2.0 * (1.0 - share) * share / green * chroma));
    let width = frame.chroma_width();
    RgbImage::from_fn(frame.width as u32, frame.height as u32, |i, j| {
        let [i, j] = [i, j].map(|at| at as usize);
        let at = j / 2 * width + i / 2;
        let y = of_luma * (i32::from(frame.y[j * frame.width + i]) - black);
        let u = i32::from(frame.u[at]) - 128;
        let v = i32::from(frame.v[at]) - 128;
        let byte = |x: i32| ((x + (1 << 15)) >> 16).clamp(0, 255) as u8;
        Rgb([
            byte(y + red_v * v),
            byte(y - green_u * u - green_v * v),
            byte(y + blue_u * u),
        ])
    })
}

/// The 4:2:0 picture of a coloured one; by BT.601 in limited range: the inverse of [`rgb_of`] but for the mean of the colours of
/// four pixels. An odd last row or column is left out.
pub(super) fn yuv_of(picture: &RgbImage) -> YuvFrame {
    let [width, height] = [picture.width(), picture.height()].map(|side| side as usize & !1);
    let mut frame = YuvFrame::black(width, height);
    let pixel = |i: usize, j: usize| picture.get_pixel(i as u32, j as u32).0.map(i32::from);
    let dot = |[r, g, b]: [i32; 3], [kr, kg, kb]: [i32; 3]| kr * r + kg * g + kb * b;
    for j in 0..height {
        for i in 0..width {
            let y = dot(pixel(i, j), [16_829, 33_039, 6_416]);
            frame.y[j * width + i] = (16 + ((y + (1 << 15)) >> 16)) as u8;
        }
    }
    for j in 0..height / 2 {
        for i in 0..width / 2 {
            let four = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(a, b)| pixel(2 * i + a, 2 * j + b));
            let sum = [0, 1, 2].map(|c| four.iter().map(|p| p[c]).sum::<i32>());
            let byte = |x: i32| (128 + ((x + (1 << 17)) >> 18)).clamp(0, 255) as u8;
            let at = j * (width / 2) + i;
            frame.u[at] = byte(dot(sum, [-9_714, -19_070, 28_784]));
            frame.v[at] = byte(dot(sum, [28_784, -24_103, -4_681]));
        }
    }
    frame
}
