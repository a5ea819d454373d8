//! A picture that is drawn on: smooth lines and areas by tiny-skia, words in one of the window's fonts by ab_glyph.

use super::error::FilmError;
use ab_glyph::{Font, FontRef, PxScale, ScaleFont, point};
use boresight_common::palette::{Colour, PAPER};
use image::RgbImage;
use tiny_skia::{FillRule, LineCap, LineJoin, Paint, Path, PathBuilder, Pixmap, Stroke, Transform};

/// How much the plate behind words covers of the picture: they stay readable on any.
const PLATE: f32 = 0.6;

/// A picture that is drawn on.
#[derive(Clone)]
pub struct Canvas {
    pixels: Pixmap,
    font: FontRef<'static>,
}

/// A colour, and how much of what lies below it covers, 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ink(pub Colour, pub f32);

impl From<Colour> for Ink {
    fn from(colour: Colour) -> Self {
        Self(colour, 1.0)
    }
}

fn paint(Ink([r, g, b], share): Ink) -> Paint<'static> {
    let mut paint = Paint::default();
    paint.set_color_rgba8(r, g, b, (255.0 * share) as u8);
    paint
}

/// A line through points, closed or not; none through fewer than two.
fn path(points: &[[f64; 2]], closed: bool) -> Option<Path> {
    let mut builder = PathBuilder::new();
    let (first, rest) = points.split_first()?;
    builder.move_to(first[0] as f32, first[1] as f32);
    for [x, y] in rest {
        builder.line_to(*x as f32, *y as f32);
    }
    if closed {
        builder.close();
    }
    builder.finish()
}

impl Canvas {
    /// A canvas of one colour.
    pub fn new([width, height]: [u32; 2], [r, g, b]: Colour) -> Result<Self, FilmError> {
        let no_canvas = || FilmError::Canvas { width, height };
        let mut pixels = Pixmap::new(width, height).ok_or_else(no_canvas)?;
        pixels.fill(tiny_skia::Color::from_rgba8(r, g, b, 255));
        let font = FontRef::try_from_slice(epaint_default_fonts::HACK_REGULAR);
        Ok(Self {
            pixels,
            font: font.map_err(|_| no_canvas())?,
        })
    }

    /// Width and height [px].
    pub fn size_px(&self) -> [u32; 2] {
        [self.pixels.width(), self.pixels.height()]
    }

    /// Fills an outline.
    pub fn fill(&mut self, corners_px: &[[f64; 2]], ink: impl Into<Ink>) {
        if let Some(path) = path(corners_px, true) {
            let rule = FillRule::Winding;
            (self.pixels).fill_path(&path, &paint(ink.into()), rule, Transform::identity(), None);
        }
    }

    /// Draws a line through points.
    pub fn line(&mut self, points_px: &[[f64; 2]], width_px: f32, ink: impl Into<Ink>) {
        self.stroke(path(points_px, false), width_px, ink.into());
    }

    /// Draws an outline.
    pub fn outline(&mut self, corners_px: &[[f64; 2]], width_px: f32, ink: impl Into<Ink>) {
        self.stroke(path(corners_px, true), width_px, ink.into());
    }

    fn stroke(&mut self, path: Option<Path>, width_px: f32, ink: Ink) {
        let stroke = Stroke {
            width: width_px,
            line_cap: LineCap::Round,
            line_join: LineJoin::Round,
            ..Stroke::default()
        };
        if let Some(path) = path {
            (self.pixels).stroke_path(&path, &paint(ink), &stroke, Transform::identity(), None);
        }
    }

    /// Draws a disc.
    pub fn dot(&mut self, [x, y]: [f64; 2], radius_px: f32, ink: impl Into<Ink>) {
        if let Some(path) = PathBuilder::from_circle(x as f32, y as f32, radius_px) {
            let rule = FillRule::Winding;
            (self.pixels).fill_path(&path, &paint(ink.into()), rule, Transform::identity(), None);
        }
    }

    /// Width and height of a line of words in letters of a size [px].
    pub fn words_px(&self, height_px: f32, words: &str) -> [f64; 2] {
        let font = self.font.as_scaled(PxScale::from(height_px));
        let advance = |letter| font.h_advance(font.glyph_id(letter));
        let width: f32 = words.chars().map(advance).sum();
        [width.into(), height_px.into()]
    }

    /// Writes a line of words in letters of a size [px], its upper left corner at a place.
    pub fn words(&mut self, [x, y]: [f64; 2], height_px: f32, words: &str, colour: Colour) {
        let [width, height] = self.words_px(height_px, words);
        let (right, below) = (x + width, y + height);
        let plate = [[x, y], [right, y], [right, below], [x, below]];
        self.fill(&plate, Ink(PAPER, PLATE));
        let scale = PxScale::from(height_px);
        let font = self.font.clone();
        let (scaled, [mut x, y]) = (font.as_scaled(scale), [x as f32, y as f32]);
        for letter in words.chars() {
            let id = scaled.glyph_id(letter);
            let glyph = id.with_scale_and_position(scale, point(x, y + scaled.ascent()));
            x += scaled.h_advance(id);
            let Some(outlined) = font.outline_glyph(glyph) else {
                continue;
            };
            let corner = outlined.px_bounds().min;
            outlined.draw(|dx, dy, covered| {
                let at = [
                    corner.x as i64 + i64::from(dx),
                    corner.y as i64 + i64::from(dy),
                ];
                self.blend(at, colour, covered.min(1.0));
            });
        }
    }

    /// Covers a share of a pixel.
    fn blend(&mut self, [x, y]: [i64; 2], colour: Colour, share: f32) {
        let [width, height] = self.size_px().map(i64::from);
        if (0..width).contains(&x) && (0..height).contains(&y) {
            let first = 4 * (y * width + x) as usize;
            // All pixels are opaque, so that colours are not weighed by anything.
            for (below, above) in self.pixels.data_mut()[first..first + 3]
                .iter_mut()
                .zip(colour)
            {
                let mixed = f32::from(*below) + share * (f32::from(above) - f32::from(*below));
                *below = mixed.round() as u8;
            }
        }
    }

    /// Lays a picture upon it, its upper left corner at a place; what stands out is cut.
    pub fn lay(&mut self, [left, top]: [u32; 2], picture: &RgbImage) {
        let [width, height] = self.size_px();
        for (x, y, pixel) in picture.enumerate_pixels() {
            let [x, y] = [left + x, top + y];
            if x < width && y < height {
                let first = 4 * (y * width + x) as usize;
                self.pixels.data_mut()[first..first + 3].copy_from_slice(&pixel.0);
            }
        }
    }

    /// What was drawn.
    pub fn picture(&self) -> RgbImage {
        let [width, height] = self.size_px();
        let colours = self.pixels.data().as_chunks::<4>().0;
        let rgb = colours.iter().flat_map(|[r, g, b, _]| [*r, *g, *b]);
        RgbImage::from_raw(width, height, rgb.collect()).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use boresight_common::palette::INK;

    /// Sum of what was drawn over black, in pixels of full ink.
    fn drawn(canvas: &Canvas) -> f64 {
        let picture = canvas.picture();
        let sum: u64 = picture.pixels().map(|pixel| u64::from(pixel.0[0])).sum();
        sum as f64 / 255.0
    }

    #[test]
    fn areas_and_lines_cover_what_they_should() {
        let black = || Canvas::new([100, 80], [0; 3]).unwrap();
        let white = [255; 3];
        let mut canvas = black();
        // Half pixels at its edges are half covered.
        canvas.fill(
            &[[10.5, 20.5], [30.5, 20.5], [30.5, 40.5], [10.5, 40.5]],
            white,
        );
        assert!((drawn(&canvas) - 400.0).abs() < 4.0, "{}", drawn(&canvas));
        let mut canvas = black();
        canvas.line(&[[10.0, 40.0], [70.0, 40.0]], 2.0, Ink(white, 0.5));
        // 60 px by 2 px and two half discs, at half strength.
        let wanted = 0.5 * (120.0 + std::f64::consts::PI);
        assert!((drawn(&canvas) - wanted).abs() < 3.0, "{}", drawn(&canvas));
        let mut canvas = black();
        canvas.dot([50.0, 40.0], 10.0, white);
        // Its edge is made of short curves that lie a little inside.
        assert!((drawn(&canvas) - 314.2).abs() < 8.0, "{}", drawn(&canvas));
    }

    #[test]
    fn words_lie_where_they_are_put_and_no_letter_is_lost() {
        let mut canvas = Canvas::new([200, 60], [0; 3]).unwrap();
        let words = "über 1,000 µrad";
        let [width, _] = canvas.words_px(16.0, words);
        assert!((80.0..140.0).contains(&width), "{width}");
        canvas.words([20.0, 30.0], 16.0, words, INK);
        let picture = canvas.picture();
        let inked = |x: u32, y: u32| picture.get_pixel(x, y).0[0] > 60;
        let across: Vec<u32> = (0..200).filter(|x| (0..60).any(|y| inked(*x, y))).collect();
        let down: Vec<u32> = (0..60).filter(|y| (0..200).any(|x| inked(x, *y))).collect();
        assert!(across[0] >= 20 && f64::from(across[across.len() - 1]) <= 20.0 + width + 1.0);
        assert!(down[0] >= 30 && down[down.len() - 1] <= 30 + 18, "{down:?}");
    }

    #[test]
    fn a_picture_that_stands_out_is_cut() {
        let mut canvas = Canvas::new([10, 10], [0; 3]).unwrap();
        canvas.lay([6, 6], &RgbImage::from_pixel(20, 20, image::Rgb([255; 3])));
        assert_eq!(drawn(&canvas), 16.0);
    }
}
