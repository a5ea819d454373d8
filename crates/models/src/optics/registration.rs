//! How a camera's picture moved from frame to frame, read off the scenery in it.
//!
//! Blocks with corners (the lesser eigenvalue of the gradient's second moments: J. Shi and C. Tomasi, Good features
//! to track, CVPR 1994) are sought in the next frame by least squared difference, first at a quarter of the
//! resolution, then at full, and to parts of a pixel along the gradients. Of their shifts the one counts on which most agree:
//! branches sway, clouds drift, and what flies moves by itself.

use glam::{DMat2, DVec2};

/// Pixels of the picture for one of the coarse level.
const SHRUNK: usize = 4;
/// Side of a block, and distance from one to the next [px].
const BLOCK: usize = 16;
const GRID: usize = 16;
/// Blocks that are sought at most: those with the strongest corners.
const BLOCKS: usize = 48;
/// Least mean square of the gradient along the weaker direction [grey levels² per px²]: half of what noise of two grey levels makes,
/// for haze leaves little more, and compressed video has less noise.
const CORNER: f64 = 1.0;
/// How far blocks are sought on the coarse level, and about what that found [px of the level].
const REACH: [isize; 2] = [8, 4];
/// Steps to parts of a pixel.
const STEPS: usize = 4;
/// Shifts that agree differ by less [px].
const AGREES_PX: f64 = 1.0;
/// Blocks that must agree, and their least share: noise agrees by chance only.
const LEAST_BLOCKS: usize = 6;
const LEAST_SHARE: f64 = 0.25;

/// Grey levels of a picture.
#[derive(Clone, Debug)]
struct Grey {
    width: usize,
    height: usize,
    levels: Vec<u8>,
}

impl Grey {
    fn of(rgb8: &[u8], [width, height]: [u32; 2]) -> Self {
        let mean = |rgb: &[u8]| (rgb.iter().map(|level| u16::from(*level)).sum::<u16>() / 3) as u8;
        Self {
            width: width as usize,
            height: height as usize,
            levels: rgb8.chunks_exact(3).map(mean).collect(),
        }
    }

    fn shrunk(&self) -> Self {
        let (width, height) = (self.width / SHRUNK, self.height / SHRUNK);
        let mean = |x: usize, y: usize| {
            let rows = (0..SHRUNK).map(|row| (SHRUNK * y + row) * self.width + SHRUNK * x);
            let sum: u32 = rows
                .flat_map(|at| &self.levels[at..at + SHRUNK])
                .map(|level| u32::from(*level))
                .sum();
            (sum / (SHRUNK * SHRUNK) as u32) as u8
        };
        let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        Self {
            width,
            height,
            levels: places.map(|(x, y)| mean(x, y)).collect(),
        }
    }

    fn row(&self, x: usize, y: usize, length: usize) -> &[u8] {
        &self.levels[y * self.width + x..][..length]
    }

    /// Sum of squared differences between a block of this picture and one of another; `None` where the other has none.
    fn difference(
        &self,
        [x, y]: [usize; 2],
        side: usize,
        other: &Self,
        shift: [isize; 2],
    ) -> Option<u32> {
        let to_x = x.checked_add_signed(shift[0])?;
        let to_y = y.checked_add_signed(shift[1])?;
        let inside = |grey: &Self, x, y| x + side <= grey.width && y + side <= grey.height;
        if !inside(self, x, y) || !inside(other, to_x, to_y) {
            return None;
        }
        let of_row = |row: usize| -> u32 {
            let pairs = self
                .row(x, y + row, side)
                .iter()
                .zip(other.row(to_x, to_y + row, side));
            pairs.map(|(a, b)| u32::from(a.abs_diff(*b)).pow(2)).sum()
        };
        Some((0..side).map(of_row).sum())
    }

    /// How a block shifted, whose shift is about `near`, to a pixel.
    fn sought(
        &self,
        at: [usize; 2],
        side: usize,
        other: &Self,
        near: [isize; 2],
        reach: isize,
    ) -> Option<[isize; 2]> {
        let mut best: Option<(u32, [isize; 2])> = None;
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                let shift = [near[0] + dx, near[1] + dy];
                let Some(found) = self.difference(at, side, other, shift) else {
                    continue;
                };
                if best.is_none_or(|(least, _)| found < least) {
                    best = Some((found, shift));
                }
            }
        }
        let (_, [x, y]) = best?;
        // At the edge of what was looked at the least lies beyond it.
        let inside = (x - near[0]).abs() < reach && (y - near[1]).abs() < reach;
        inside.then_some([x, y])
    }

    /// Gradient at a pixel [grey levels per px].
    fn gradient(&self, x: usize, y: usize) -> DVec2 {
        let level = |x: usize, y: usize| f64::from(self.levels[y * self.width + x]);
        0.5 * DVec2::new(
            level(x + 1, y) - level(x - 1, y),
            level(x, y + 1) - level(x, y - 1),
        )
    }

    /// The level between pixels; `None` beyond the last ones.
    fn between(&self, at: DVec2) -> Option<f64> {
        let (x, y) = (at.x.floor(), at.y.floor());
        if x < 0.0 || y < 0.0 || x as usize + 1 >= self.width || y as usize + 1 >= self.height {
            return None;
        }
        let first = y as usize * self.width + x as usize;
        let level = |index: usize| f64::from(self.levels[index]);
        let (right, down) = (at.x - x, at.y - y);
        let along = |index: usize| level(index) + right * (level(index + 1) - level(index));
        Some(along(first) + down * (along(first + self.width) - along(first)))
    }

    /// A block's shift to a part of a pixel, from one to a pixel on: Gauss and Newton's steps (Lucas and Kanade, IJCAI 1981).
    fn refined(&self, [x0, y0]: [usize; 2], other: &Self, start: [isize; 2]) -> Option<DVec2> {
        let start = DVec2::new(start[0] as f64, start[1] as f64);
        let mut shift = start;
        for _ in 0..STEPS {
            let (mut moments, mut pull) = (DMat2::ZERO, DVec2::ZERO);
            for y in y0..y0 + BLOCK {
                for x in x0..x0 + BLOCK {
                    let gradient = self.gradient(x, y);
                    let found = other.between(DVec2::new(x as f64, y as f64) + shift)?;
                    let differs = f64::from(self.levels[y * self.width + x]) - found;
                    moments += DMat2::from_cols(gradient * gradient.x, gradient * gradient.y);
                    pull += differs * gradient;
                }
            }
            shift += moments.inverse() * pull;
        }
        ((shift - start).length() < 1.5).then_some(shift)
    }

    /// Mean square of the gradient along its weaker direction in a block.
    fn corner(&self, [x0, y0]: [usize; 2]) -> f64 {
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for y in y0..y0 + BLOCK {
            for x in x0..x0 + BLOCK {
                let gradient = self.gradient(x, y);
                xx += gradient.x * gradient.x;
                xy += gradient.x * gradient.y;
                yy += gradient.y * gradient.y;
            }
        }
        let weaker = 0.5 * (xx + yy) - (0.25 * (xx - yy).powi(2) + xy * xy).sqrt();
        weaker / (BLOCK * BLOCK) as f64
    }
}

/// Tells how the pictures of a camera move.
#[derive(Clone, Debug, Default)]
pub struct Registration {
    before: Option<[Grey; 2]>,
}

impl Registration {
    /// How the scenery shifted since the picture before, right and down [px]; `None` for the first picture, one of
    /// another size or without all its pixels, and where too little scenery shows. `rgb8`: 8-bit RGB rows; `apart_px`: boxes (x0, y0, x1, y1) of the
    /// picture before in which things move by themselves.
    pub fn shift_px(
        &mut self,
        rgb8: &[u8],
        size_px: [u32; 2],
        apart_px: &[[f64; 4]],
    ) -> Option<DVec2> {
        if rgb8.len() != 3 * size_px[0] as usize * size_px[1] as usize {
            self.before = None;
            return None;
        }
        let fine = Grey::of(rgb8, size_px);
        let coarse = fine.shrunk();
        let [fine_before, coarse_before] = self.before.replace([fine, coarse])?;
        let [fine, coarse] = self.before.as_ref()?;
        if (fine.width, fine.height) != (fine_before.width, fine_before.height) {
            return None;
        }
        let shifts: Vec<DVec2> = fine_before
            .corners(apart_px)
            .into_iter()
            .filter_map(|at| {
                // A block of the coarse level shows twice as much to a side, about the same middle.
                let wide = 2 * BLOCK / SHRUNK;
                let sides = [coarse.width, coarse.height];
                let first = |axis: usize| {
                    let first = (at[axis] / SHRUNK).saturating_sub(wide / 4);
                    first.min(sides[axis].saturating_sub(wide))
                };
                let from = [first(0), first(1)];
                let about = coarse_before.sought(from, wide, coarse, [0, 0], REACH[0])?;
                let about = about.map(|side| side * SHRUNK as isize);
                let whole = fine_before.sought(at, BLOCK, fine, about, REACH[1])?;
                fine_before.refined(at, fine, whole)
            })
            .collect();
        agreed(&shifts)
    }
}

impl Grey {
    /// Corners of the blocks that are worth seeking, the strongest first.
    fn corners(&self, apart_px: &[[f64; 4]]) -> Vec<[usize; 2]> {
        let apart = |[x, y]: [usize; 2]| {
            let (x, y, side) = (x as f64, y as f64, BLOCK as f64);
            (apart_px.iter())
                .any(|[x0, y0, x1, y1]| x < *x1 && x + side > *x0 && y < *y1 && y + side > *y0)
        };
        let places =
            |side: usize| (GRID / 4..(side.saturating_sub(BLOCK + 1)).max(GRID / 4)).step_by(GRID);
        let mut found: Vec<(f64, [usize; 2])> = places(self.height)
            .flat_map(|y| places(self.width).map(move |x| [x, y]))
            .filter(|at| !apart(*at))
            .map(|at| (self.corner(at), at))
            .filter(|(strength, _)| *strength > CORNER)
            .collect();
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        found.truncate(BLOCKS);
        found.into_iter().map(|(_, at)| at).collect()
    }
}

/// The mean of those shifts on which most agree.
fn agreed(shifts: &[DVec2]) -> Option<DVec2> {
    let with = |one: &DVec2| -> Vec<DVec2> {
        let near = |other: &&DVec2| (**other - *one).abs().max_element() < AGREES_PX;
        shifts.iter().filter(near).copied().collect()
    };
    let mut most = Vec::new();
    for one in shifts {
        let agree = with(one);
        if agree.len() > most.len() {
            most = agree;
        }
    }
    let enough =
        most.len() >= LEAST_BLOCKS && most.len() as f64 >= LEAST_SHARE * shifts.len() as f64;
    enough.then(|| most.iter().sum::<DVec2>() / most.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths::rng::Stream;

    const SIZE: [u32; 2] = [320, 240];

    /// Smooth random scenery in the lower part, whose origin is at `at`, sky above, noise of two grey levels, and a
    /// dark square that stays where it is.
    fn picture(at: DVec2, horizon: f64, noise: &mut Stream) -> Vec<u8> {
        let waves: Vec<[f64; 4]> = {
            let mut rng = Stream::new(4, 0, "scenery");
            (0..40)
                .map(|_| {
                    [
                        rng.range(-0.5, 0.5),
                        rng.range(-0.5, 0.5),
                        rng.range(0.0, 6.3),
                        rng.range(2.0, 9.0),
                    ]
                })
                .collect()
        };
        let mut rgb8 = Vec::new();
        for y in 0..SIZE[1] {
            for x in 0..SIZE[0] {
                let place = DVec2::new(f64::from(x), f64::from(y)) - at;
                let wave = |[u, v, phase, size]: &[f64; 4]| {
                    size * (u * place.x + v * place.y + phase).sin()
                };
                let scenery = (0.1 * (place.y - horizon)).clamp(0.0, 1.0);
                let ground = 110.0 + waves.iter().map(wave).sum::<f64>();
                let mut level = 180.0 + scenery * (ground - 180.0);
                if (100..130).contains(&x) && (20..50).contains(&y) {
                    level = 40.0 + 10.0 * f64::from((x / 3 + y / 3) % 7);
                }
                let level = (level + 2.0 * noise.normal()).clamp(0.0, 255.0) as u8;
                rgb8.extend([level; 3]);
            }
        }
        rgb8
    }

    #[test]
    fn scenery_tells_how_the_camera_turned_to_a_tenth_of_a_pixel() {
        let mut noise = Stream::new(1, 0, "noise");
        for step in [[0.0, 0.0], [0.3, -0.4], [7.6, 2.3], [-21.5, 9.0]].map(DVec2::from_array) {
            let mut registration = Registration::default();
            for k in 0..4 {
                let rgb8 = picture(f64::from(k) * step, 110.0, &mut noise);
                let found = registration.shift_px(&rgb8, SIZE, &[]);
                match found {
                    Some(found) => assert!((found - step).length() < 0.1, "{found} for {step}"),
                    None => assert_eq!(k, 0, "{step}"),
                }
            }
        }
    }

    #[test]
    fn the_sky_and_what_flies_before_it_tell_nothing() {
        let mut noise = Stream::new(2, 0, "noise");
        let mut registration = Registration::default();
        let own = [95.0, 15.0, 135.0, 55.0];
        for k in 0..3 {
            let rgb8 = picture(f64::from(k) * DVec2::X, 1e3, &mut noise);
            assert_eq!(registration.shift_px(&rgb8, SIZE, &[own]), None);
        }
        // Nor does a picture of another size, or one without pixels.
        assert_eq!(
            registration.shift_px(&[9; 3 * 64 * 48], [64, 48], &[]),
            None
        );
        assert_eq!(registration.shift_px(&[9; 3 * 64], [64, 48], &[]), None);
        assert_eq!(registration.shift_px(&[], [0, 0], &[]), None);
    }
}
