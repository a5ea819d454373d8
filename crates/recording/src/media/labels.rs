//! Where the labels of marks in a picture go, so that none covers another.

/// A rectangle as x0, y0, x1, y1 [px].
pub type Rect = [f64; 4];

/// The upper left corners of labels [px], for boxes in a picture of `size_px`, the most important first, whose labels
/// have `labels_px` of width and height. Each goes above its box or, where a label is or the picture ends, below it or
/// beside it; one that finds no room is left out. `gap_px` lies between box and label.
pub fn place(
    boxes: &[Rect],
    labels_px: &[[f64; 2]],
    size_px: [f64; 2],
    gap_px: f64,
) -> Vec<Option<[f64; 2]>> {
    place_clear(boxes, labels_px, size_px, gap_px, &[])
}

/// As [`place`], with labels that also leave the rectangles `clear` alone, such as other boxes and what stands in a corner.
/// The first of these belong to the boxes, in their order: a label may touch its own.
pub fn place_clear(
    boxes: &[Rect],
    labels_px: &[[f64; 2]],
    size_px: [f64; 2],
    gap_px: f64,
    clear: &[Rect],
) -> Vec<Option<[f64; 2]>> {
    let mut taken: Vec<Rect> = Vec::new();
    (boxes.iter().zip(labels_px).enumerate())
        .map(|(number, ([x0, y0, x1, y1], [width, height]))| {
            if *width <= 0.0 {
                return None;
            }
            let (left, right) = (*x0, x1 - width);
            let (above, below) = (y0 - gap_px - height, y1 + gap_px);
            let middle = 0.5 * (y0 + y1 - height);
            let (after, before) = (x1 + gap_px, x0 - gap_px - width);
            let places = [
                [left, above],
                [left, below],
                [right, above],
                [right, below],
                [after, middle],
                [before, middle],
                // At its corners, where it is crowded.
                [after, above],
                [after, below],
                [before, above],
                [before, below],
            ];
            let free = |corner: &[f64; 2]| {
                let [x, y] = *corner;
                let label = [x, y, x + width, y + height];
                let inside =
                    x >= 0.0 && y >= 0.0 && label[2] <= size_px[0] && label[3] <= size_px[1];
                let others = clear.iter().enumerate().filter(|(of, _)| *of != number);
                inside
                    && !taken.iter().any(|other| meet(&label, other))
                    && !others
                        .map(|(_, other)| other)
                        .any(|other| meet(&label, other))
            };
            let [x, y] = places.into_iter().find(free)?;
            taken.push([x, y, x + width, y + height]);
            Some([x, y])
        })
        .collect()
}

/// Whether two rectangles share an area.
fn meet(a: &Rect, b: &Rect) -> bool {
    a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SIZE_PX: [f64; 2] = [320.0, 240.0];

    #[test]
    fn the_first_stands_above_and_the_next_gives_way() {
        let boxes = [[100.0, 100.0, 110.0, 108.0], [102.0, 101.0, 112.0, 109.0]];
        let found = place(&boxes, &[[40.0, 12.0]; 2], SIZE_PX, 2.0);
        assert_eq!(found, [Some([100.0, 86.0]), Some([102.0, 111.0])]);
        // At the upper right corner it goes below and to the left.
        let corner = [[310.0, 2.0, 318.0, 10.0]];
        let found = place(&corner, &[[40.0, 12.0]], SIZE_PX, 2.0);
        assert_eq!(found, [Some([278.0, 12.0])]);
        // Larger than the picture: none.
        assert_eq!(place(&corner, &[[400.0, 12.0]], SIZE_PX, 2.0), [None]);
    }

    #[test]
    fn labels_leave_clear_what_is_to_be_seen() {
        let boxes = [[100.0, 100.0, 108.0, 108.0]];
        let labels_px = [[40.0, 12.0]];
        let of = |clear: &[Rect]| place_clear(&boxes, &labels_px, SIZE_PX, 2.0, clear);
        // Its own box is no hindrance, another above it is: it goes below.
        assert_eq!(of(&boxes), [Some([100.0, 86.0])]);
        let above = [boxes[0], [120.0, 90.0, 128.0, 98.0]];
        assert_eq!(of(&above), [Some([100.0, 110.0])]);
        // Others above and below on both sides: beside it.
        let around = [
            boxes[0],
            [90.0, 86.0, 118.0, 98.0],
            [90.0, 110.0, 118.0, 122.0],
        ];
        assert_eq!(of(&around), [Some([110.0, 98.0])]);
        // No room at all: it is left out.
        assert_eq!(of(&[boxes[0], [0.0, 0.0, 320.0, 240.0]]), [None]);
    }

    proptest! {
        /// No label covers another or leaves the picture, and the first is there wherever it fits.
        #[test]
        fn labels_never_cover_each_other(
            at in prop::collection::vec((0.0..300.0_f64, 0.0..220.0_f64, 1.0..20.0_f64), 1..40),
        ) {
            let boxes: Vec<Rect> = at.iter().map(|(x, y, side)| [*x, *y, x + side, y + side]).collect();
            let labels_px = vec![[50.0, 12.0]; boxes.len()];
            let found = place(&boxes, &labels_px, SIZE_PX, 2.0);
            prop_assert!(found[0].is_some());
            let rects: Vec<Rect> = (found.iter().flatten())
                .map(|[x, y]| [*x, *y, x + 50.0, y + 12.0])
                .collect();
            for (index, a) in rects.iter().enumerate() {
                prop_assert!(a[0] >= 0.0 && a[1] >= 0.0 && a[2] <= 320.0 && a[3] <= 240.0);
                prop_assert!(!rects[index + 1..].iter().any(|b| meet(a, b)));
            }
        }
    }
}
