//! Which frames of a clip are worth keeping: those that differ most.

/// What a frame looks like, as numbers whose distance says how far two frames are apart: the chip of its first box at a
/// few pixels, where it lies, and how large it is.
pub type Look = Vec<f64>;

/// Side of the chip that is compared, in blocks of pixels of a chip.
const BLOCKS: usize = 12;
/// Weights of a block's colour (0 to 1), of a place over the picture's size and of a size's logarithm: a box that crosses a
/// tenth of the picture is as new as one a seventh longer, or as a chip all of whose blocks change by 2 %.
const COLOUR: f64 = 0.5;
const PLACE: f64 = 2.0;
const SIZE: f64 = 1.5;
/// Frames nearer to each other than this are the same but for noise.
const SAME: f64 = 0.063;

/// The look of a frame: an 8-bit RGB chip of `chip_px` a side around a box, x0, y0, x1, y1 [px], in a picture of `size_px`.
pub fn look(chip: &[u8], chip_px: usize, box_px: [f64; 4], size_px: [u32; 2]) -> Look {
    let block_px = (chip_px / BLOCKS).max(1);
    let blocks = chip_px / block_px;
    let mut look = vec![0.0; 3 * blocks * blocks];
    let weight = COLOUR / (255.0 * (block_px * block_px) as f64);
    for (i, rgb) in chip.chunks_exact(3).enumerate() {
        let (x, y) = (i % chip_px / block_px, i / chip_px / block_px);
        if x < blocks && y < blocks {
            for (k, value) in rgb.iter().enumerate() {
                look[3 * (y * blocks + x) + k] += weight * f64::from(*value);
            }
        }
    }
    let [x0, y0, x1, y1] = box_px;
    look.push(PLACE * 0.5 * (x0 + x1) / f64::from(size_px[0]));
    look.push(PLACE * 0.5 * (y0 + y1) / f64::from(size_px[1]));
    look.push(SIZE * (x1 - x0).max(y1 - y0).max(1.0).ln());
    look
}

/// At most `count` of the frames, in order: the first, then always the one that is furthest from all that are taken (Gonzalez
/// 1985), until those left are copies of them.
pub fn thin(looks: &[Look], count: usize) -> Vec<usize> {
    let apart = |a: &Look, b: &Look| -> f64 {
        let squares = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b));
        squares.sum::<f64>().sqrt()
    };
    let mut taken = Vec::new();
    let mut nearest = vec![f64::INFINITY; looks.len()];
    while taken.len() < count {
        let next =
            (nearest.iter().enumerate()).max_by(|a, b| a.1.total_cmp(b.1).then(b.0.cmp(&a.0)));
        let Some((next, _)) = next.filter(|(_, distance)| **distance > SAME) else {
            break;
        };
        taken.push(next);
        for (nearest, look) in nearest.iter_mut().zip(looks) {
            *nearest = nearest.min(apart(look, &looks[next]));
        }
    }
    taken.sort_unstable();
    taken
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_differs_most_is_taken_and_copies_are_not() {
        let grey = |level: u8| vec![level; 24 * 24 * 3];
        let at =
            |level: u8, x: f64| look(&grey(level), 24, [x, 100.0, x + 20.0, 110.0], [640, 512]);
        let looks = vec![
            at(100, 50.0),
            at(100, 50.5),
            at(100, 300.0),
            at(100, 51.0),
            at(200, 50.0),
            at(100, 600.0),
        ];
        assert_eq!(thin(&looks, 2), [0, 4]);
        assert_eq!(thin(&looks, 99), [0, 2, 4, 5]);
        assert_eq!(thin(&looks, 0), [0; 0]);
        assert_eq!(thin(&[], 5), [0; 0]);
    }
}
