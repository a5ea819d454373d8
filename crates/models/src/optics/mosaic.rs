//! The colour filters of a sensor, and colour from one value a pixel.

/// Which light a pixel counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mosaic {
    /// Red, green and blue at every pixel, as three chips behind a prism do.
    #[default]
    None,
    /// Bayer's: red and green in even rows, green and blue in odd ones.
    Rggb,
    /// No filters: every pixel counts all light, and the picture is grey.
    Mono,
}

impl Mosaic {
    /// How many times the light of one filter a pixel counts, where the light is white.
    pub fn filters(self) -> f64 {
        match self {
            Self::None | Self::Rggb => 1.0,
            Self::Mono => 3.0,
        }
    }

    /// The channels that the pixels at (`x`, `y`) of the whole sensor count.
    pub fn channels(self, x: usize, y: usize) -> std::ops::Range<usize> {
        match self {
            Self::None => 0..3,
            Self::Mono => 0..1,
            Self::Rggb => {
                let channel = x % 2 + y % 2;
                channel..channel + 1
            }
        }
    }
}

/// Sums of neighbours, kept from row to row.
#[derive(Clone, Debug, Default)]
pub struct Neighbours {
    /// Means of the pixels left and right, above and below, of those four, of the corners.
    means: [Vec<u16>; 4],
}

/// Red, green and blue of a row, interpolated linearly from the nearest pixels that count them, as
/// the channels' tables `codes` show them. `rows` are the raw codes of the rows above, at and below
/// it, each with one more at either end; the row begins at (`x`, `y`) of the whole sensor.
pub fn interpolate<const CODES: usize>(
    rows: [&[u16]; 3],
    x: usize,
    y: usize,
    codes: &[[u8; CODES]; 3],
    neighbours: &mut Neighbours,
    out: &mut [u8],
) {
    let width = out.len() / 3;
    let [up, own, down] = rows.map(|row| &row[..width + 2]);
    let [level, upright, cross, corners] = &mut neighbours.means;
    for means in [&mut *level, upright, cross, corners] {
        means.resize(width, 0);
    }
    let (left, right) = (&own[..width], &own[2..]);
    let (above, below) = (&up[1..=width], &down[1..=width]);
    // Each on its own, so that they run on vectors.
    mean_of_two(left, right, level);
    mean_of_two(above, below, upright);
    for (i, mean) in cross.iter_mut().enumerate() {
        *mean = (left[i] + right[i] + above[i] + below[i] + 2) >> 2;
    }
    let (up_right, down_right) = (&up[2..], &down[2..]);
    for (i, mean) in corners.iter_mut().enumerate() {
        *mean = (up[i] + up_right[i] + down[i] + down_right[i] + 2) >> 2;
    }
    let own = &own[1..=width];
    // The colour that a row's not green pixels count, and the other one.
    let (this, other) = if y.is_multiple_of(2) { (0, 2) } else { (2, 0) };
    let code = |channel: usize, raw: u16| codes[channel][raw as usize % CODES];
    let green = |i: usize, rgb: &mut [u8]| {
        rgb[this] = code(this, level[i]);
        rgb[1] = code(1, own[i]);
        rgb[other] = code(other, upright[i]);
    };
    let coloured = |i: usize, rgb: &mut [u8]| {
        rgb[this] = code(this, own[i]);
        rgb[1] = code(1, cross[i]);
        rgb[other] = code(other, corners[i]);
    };
    let first_green = (x + y) % 2;
    for (i, rgb) in out
        .chunks_exact_mut(3)
        .enumerate()
        .skip(1 - first_green)
        .step_by(2)
    {
        green(i, rgb);
    }
    for (i, rgb) in out
        .chunks_exact_mut(3)
        .enumerate()
        .skip(first_green)
        .step_by(2)
    {
        coloured(i, rgb);
    }
}

/// The rounded means of `a` and `b`.
fn mean_of_two(a: &[u16], b: &[u16], out: &mut [u16]) {
    for (out, (a, b)) in out.iter_mut().zip(a.iter().zip(b)) {
        *out = (a + b + 1) >> 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mosaic of an even picture with a slope, interpolated.
    fn interpolated(of: impl Fn(usize, usize, usize) -> u16, x: usize, y: usize) -> Vec<[u8; 3]> {
        let row = |y: usize| -> Vec<u16> {
            let at = |i| of(x + i, y, Mosaic::Rggb.channels(x + i, y).start);
            (0..12).map(at).collect()
        };
        let rows = [row(y), row(y + 1), row(y + 2)];
        let mut out = vec![0; 3 * 10];
        let mut scratch = Neighbours::default();
        let codes = [std::array::from_fn::<u8, 256, _>(|raw| raw as u8); 3];
        let rows = rows.each_ref().map(|row| &row[..]);
        interpolate(rows, x + 1, y + 1, &codes, &mut scratch, &mut out);
        out.as_chunks().0.to_vec()
    }

    #[test]
    fn every_phase_gives_each_colour_its_own() {
        for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let flat = interpolated(|_, _, channel| [240, 200, 100][channel], x, y);
            assert!(flat.iter().all(|rgb| *rgb == [240, 200, 100]), "{flat:?}");
            // A plane is linear: linear interpolation keeps it.
            let plane = |x: usize, y: usize| 40 + 8 * x as u16 + 4 * y as u16;
            let slope = interpolated(|x, y, _| plane(x, y), x, y);
            for (i, rgb) in slope.iter().enumerate() {
                assert_eq!(*rgb, [plane(x + 1 + i, y + 1) as u8; 3], "{i}");
            }
        }
    }
}
