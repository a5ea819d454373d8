//! The colour filters of a sensor, and colour from one value a pixel.

/// Which light a pixel counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mosaic {
    /// Red, green and blue at every pixel, as three chips behind a prism do.
    #[default]
    None,
    /// Bayer's: red and green in even rows, green and blue in odd ones.
    Rggb,
}

impl Mosaic {
    /// The channels that the pixels at (`x`, `y`) of the whole sensor count.
    pub fn channels(self, x: usize, y: usize) -> std::ops::Range<usize> {
        match self {
            Self::None => 0..3,
            Self::Rggb => {
                let channel = x % 2 + y % 2;
                channel..channel + 1
            }
        }
    }
}

/// Red, green and blue codes of a row, interpolated linearly from the nearest pixels that count
/// them. `rows` are the codes of the rows above, at and below it, each with one more at either end;
/// the row begins at (`x`, `y`) of the whole sensor.
pub fn interpolate(
    rows: [&[u16]; 3],
    x: usize,
    y: usize,
    scratch: &mut [Vec<u16>; 4],
    out: &mut [[u16; 3]],
) {
    let width = out.len();
    let [up, own, down] = rows.map(|row| &row[..width + 2]);
    for values in scratch.iter_mut() {
        values.resize(width, 0);
    }
    let [level, upright, cross, corners] = scratch;
    // Each on its own, so that they run on vectors.
    for i in 0..width {
        level[i] = (own[i] + own[i + 2] + 1) >> 1;
    }
    for i in 0..width {
        upright[i] = (up[i + 1] + down[i + 1] + 1) >> 1;
    }
    for i in 0..width {
        cross[i] = (own[i] + own[i + 2] + up[i + 1] + down[i + 1] + 2) >> 2;
    }
    for i in 0..width {
        corners[i] = (up[i] + up[i + 2] + down[i] + down[i + 2] + 2) >> 2;
    }
    let own = &own[1..=width];
    // The colour that a row's not green pixels count, and the other one.
    let (this, other) = if y.is_multiple_of(2) { (0, 2) } else { (2, 0) };
    for (i, rgb) in out.iter_mut().enumerate() {
        let green = (x + i + y) % 2 == 1;
        rgb[1] = if green { own[i] } else { cross[i] };
        rgb[this] = if green { level[i] } else { own[i] };
        rgb[other] = if green { upright[i] } else { corners[i] };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mosaic of an even picture with a slope, interpolated.
    fn interpolated(of: impl Fn(usize, usize, usize) -> u16, x: usize, y: usize) -> Vec<[u16; 3]> {
        let row = |y: usize| -> Vec<u16> {
            let at = |i| of(x + i, y, Mosaic::Rggb.channels(x + i, y).start);
            (0..12).map(at).collect()
        };
        let rows = [row(y), row(y + 1), row(y + 2)];
        let mut out = vec![[0; 3]; 10];
        let mut scratch = Default::default();
        interpolate(
            rows.each_ref().map(|r| &r[..]),
            x + 1,
            y + 1,
            &mut scratch,
            &mut out,
        );
        out
    }

    #[test]
    fn every_phase_gives_each_colour_its_own() {
        for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let flat = interpolated(|_, _, channel| [300, 200, 100][channel], x, y);
            assert!(flat.iter().all(|rgb| *rgb == [300, 200, 100]), "{flat:?}");
            // A plane is linear: linear interpolation keeps it.
            let plane = |x: usize, y: usize| 40 + 8 * x as u16 + 4 * y as u16;
            let slope = interpolated(|x, y, _| plane(x, y), x, y);
            for (i, rgb) in slope.iter().enumerate() {
                assert_eq!(*rgb, [plane(x + 1 + i, y + 1); 3], "{i}");
            }
        }
    }
}
