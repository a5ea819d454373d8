//! Red, green and blue from 4:2:0 pictures and back, by BT.601 in limited range.

use image::{Rgb, RgbImage};
use rusty_h264_common::YuvFrame;

/// Red, green, blue of a 4:2:0 picture by BT.601 in limited range, in 16-bit fixed point.
pub(super) fn rgb_of(frame: &YuvFrame) -> RgbImage {
    let chroma = frame.chroma_width();
    RgbImage::from_fn(frame.width as u32, frame.height as u32, |i, j| {
        let [i, j] = [i, j].map(|at| at as usize);
        let at = j / 2 * chroma + i / 2;
        let y = 76_309 * (i32::from(frame.y[j * frame.width + i]) - 16); // 255/219
        let u = i32::from(frame.u[at]) - 128;
        let v = i32::from(frame.v[at]) - 128;
        let byte = |x: i32| ((x + (1 << 15)) >> 16).clamp(0, 255) as u8;
        Rgb([
            byte(y + 104_597 * v), // 1.402 · 255/224
            byte(y - 25_675 * u - 53_279 * v),
            byte(y + 132_201 * u), // 1.772 · 255/224
        ])
    })
}

/// The 4:2:0 picture of a coloured one; the inverse of [`rgb_of`] but for the mean of the colours of
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
