//! How a film's picture is divided into cells, and where the letters of a cell go.

use super::canvas::Canvas;
use crate::media::labels;
use std::fmt;
use std::str::FromStr;

/// Width and height of a cell of a film whose size was not asked for [px].
const USUAL_PX: [u32; 2] = [480, 360];
/// The strip below all cells of it [px].
const STRIP_PX: u32 = 56;
/// Letters of what stands at its boxes and dots [px].
const SMALL_PX: f32 = 12.0;
/// Least and most of a film's width and height [px]: letters stay readable, and a level of H.264 (5.1, Table A-1 of
/// ITU-T H.264) holds it.
const LEAST_PX: [u32; 2] = [320, 240];
const MOST_PX: [u32; 2] = [4096, 2160];

/// Width and height of a film [px], as `1280x720`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size(pub [u32; 2]);

impl fmt::Display for Size {
    fn fmt(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        let [width, height] = self.0;
        write!(formatter, "{width}x{height}")
    }
}

impl FromStr for Size {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let sides = text.split_once('x');
        let sides =
            sides.and_then(|(width, height)| Some([width.parse().ok()?, height.parse().ok()?]));
        let sides: [u32; 2] = sides.ok_or("expected WIDTHxHEIGHT in pixels, such as 1280x720")?;
        if (0..2).any(|i| !(LEAST_PX[i]..=MOST_PX[i]).contains(&sides[i])) {
            let [least, most] = [LEAST_PX, MOST_PX].map(Self);
            return Err(format!("must be from {least} to {most}"));
        }
        if sides.iter().any(|side| side % 2 == 1) {
            let even = Self(sides.map(|side| side & !1));
            return Err(format!(
                "H.264 has even widths and heights alone: take {even}"
            ));
        }
        Ok(Self(sides))
    }
}

/// How a film's picture is divided: cells side by side, and a strip below them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Width and height of the picture [px].
    pub size_px: [u32; 2],
    /// Cells side by side.
    pub columns: u32,
    /// Each cell.
    pub cell: Cell,
}

impl Grid {
    /// That of so many cells, of a size or as large as they usually are.
    pub fn of(cells: usize, size: Option<Size>) -> Self {
        let columns = cells.clamp(1, 2) as u32;
        let rows = cells.div_ceil(2).max(1) as u32;
        let usual = [USUAL_PX[0] * columns, USUAL_PX[1] * rows + STRIP_PX];
        let size_px = size.map_or(usual, |size| size.0);
        let larger = [0, 1].map(|i| f64::from(size_px[i]) / f64::from(usual[i]));
        let zoom = larger[0].min(larger[1]);
        // Letters are not made smaller than they can be read.
        let zoom = zoom.max(LEAST_ZOOM);
        let strip_px = (f64::from(STRIP_PX) * zoom).round() as u32;
        let cell_px = [
            size_px[0] / columns,
            size_px[1].saturating_sub(strip_px) / rows,
        ];
        Self {
            size_px,
            columns,
            cell: Cell {
                size_px: cell_px,
                zoom,
            },
        }
    }

    /// Upper left corner of the cell of a number [px].
    pub fn corner(&self, cell: usize) -> [u32; 2] {
        let cell = cell as u32;
        let [width, height] = self.cell.size_px;
        [
            width * (cell % self.columns),
            height * (cell / self.columns),
        ]
    }

    /// Where the strip begins [px].
    pub fn strip_top(&self) -> f64 {
        f64::from(self.size_px[1]) - f64::from(STRIP_PX) * self.cell.zoom
    }
}

/// Least part of their usual size that letters have.
const LEAST_ZOOM: f64 = 0.75;

/// A cell of a film.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// Its width and height [px].
    pub size_px: [u32; 2],
    /// How large letters, lines and dots are in it; 1 as they usually are.
    pub zoom: f64,
}

impl Cell {
    /// A length that is so many pixels in a usual cell [px].
    pub fn px(&self, usual_px: f64) -> f64 {
        usual_px * self.zoom
    }

    /// The same of letters and lines.
    pub fn pen(&self, usual_px: f32) -> f32 {
        usual_px * self.zoom as f32
    }

    /// Letters of what stands at boxes and dots [px].
    pub fn small_px(&self) -> f32 {
        self.pen(SMALL_PX)
    }

    /// Where small texts go at boxes of the cell, the most important first; they leave `clear` rectangles alone.
    pub fn labels_of<'a>(
        &self,
        canvas: &Canvas,
        texts: impl Iterator<Item = &'a str>,
        boxes: &[labels::Rect],
        gap_px: f64,
        clear: &[labels::Rect],
    ) -> Vec<Option<[f64; 2]>> {
        let labels_px: Vec<[f64; 2]> = texts
            .map(|text| canvas.words_px(self.small_px(), text))
            .collect();
        let size_px = self.size_px.map(f64::from);
        labels::place_clear(boxes, &labels_px, size_px, gap_px, clear)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_size_is_two_even_sides_that_fit() {
        let size = |text: &str| text.parse::<Size>();
        assert_eq!(size("1280x720"), Ok(Size([1280, 720])));
        assert_eq!(size("1280x720").unwrap().to_string(), "1280x720");
        for (text, wanted) in [
            ("large", "such as 1280x720"),
            ("1280", "such as 1280x720"),
            ("1280x", "such as 1280x720"),
            ("-1280x720", "such as 1280x720"),
            ("1280x720x3", "such as 1280x720"),
            ("0x0", "from 320x240 to 4096x2160"),
            ("8000x720", "from 320x240 to 4096x2160"),
            ("1281x721", "take 1280x720"),
        ] {
            let error = size(text).unwrap_err();
            assert!(error.contains(wanted), "{text}: {error}");
        }
    }

    #[test]
    fn cells_fill_the_picture_and_grow_with_it() {
        // Without a size: cells of 480 by 360, and a strip of 56.
        for (cells, size_px) in [
            (1, [480, 416]),
            (2, [960, 416]),
            (3, [960, 776]),
            (4, [960, 776]),
        ] {
            let grid = Grid::of(cells, None);
            assert_eq!(grid.size_px, size_px, "{cells}");
            assert_eq!((grid.cell.size_px, grid.cell.zoom), ([480, 360], 1.0));
            assert_eq!(grid.strip_top(), f64::from(size_px[1] - 56));
        }
        // Four cells of 1920 by 1080: the height decides, 1080/776.
        let grid = Grid::of(4, Some(Size([1920, 1080])));
        assert!((grid.cell.zoom - 1080.0 / 776.0).abs() < 1e-12);
        assert_eq!(grid.cell.size_px, [960, 501]);
        assert_eq!(grid.corner(3), [960, 501]);
        assert!(f64::from(2 * 501) <= grid.strip_top());
        // Small ones keep their letters.
        let small = Grid::of(4, Some(Size([320, 240])));
        assert_eq!(small.cell.zoom, 0.75);
        assert_eq!(small.cell.size_px, [160, 99]);
    }
}
