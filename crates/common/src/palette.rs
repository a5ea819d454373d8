//! The colours of window, pages and films: one look. They follow Okabe and Ito, whose colours the colour-blind can tell
//! apart, lightened for a dark ground.

/// Red, green and blue, 0 to 255.
pub type Colour = [u8; 3];

/// What flies and has not been dealt with.
pub const FLYING: Colour = [255, 190, 70];
/// What went well: neutralised, obeyed, found.
pub const GOOD: Colour = [47, 191, 148];
/// What burns or went wrong: a firing beam, a refusal.
pub const BAD: Colour = [240, 110, 50];
/// A second thing beside the first.
pub const SECOND: Colour = [86, 180, 233];
/// Words.
pub const INK: Colour = [232, 235, 239];
/// Words of less weight.
pub const SOFT: Colour = [154, 165, 177];
/// The ground of a dark page.
pub const PAPER: Colour = [18, 21, 26];
/// What lies on that ground.
pub const CARD: Colour = [27, 32, 39];
/// Lines and edges upon both.
pub const LINE: Colour = [52, 60, 71];

/// As a page writes it: `#rrggbb`.
pub fn hex([red, green, blue]: Colour) -> String {
    format!("#{red:02x}{green:02x}{blue:02x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// sRGB to the cone responses of someone without the cones for medium wavelengths (Viénot, Brettel & Mollon,
    /// Color Res. Appl. 24, 243, 1999), back in linear RGB.
    fn as_a_deuteranope_sees([r, g, b]: Colour) -> [f64; 3] {
        let linear = |x: u8| (f64::from(x) / 255.0).powf(2.2);
        let [r, g, b] = [r, g, b].map(linear);
        let red = 0.29275 * r + 0.70725 * g;
        [red, red, -0.02234 * r + 0.02234 * g + b]
    }

    #[test]
    fn colours_with_a_meaning_differ_for_the_colour_blind() {
        let all = [FLYING, GOOD, BAD, SECOND, INK];
        for (number, a) in all.iter().enumerate() {
            for b in &all[number + 1..] {
                let [seen_a, seen_b] = [a, b].map(|colour| as_a_deuteranope_sees(*colour));
                let apart: f64 = (0..3).map(|i| (seen_a[i] - seen_b[i]).powi(2)).sum();
                assert!(apart.sqrt() > 0.15, "{a:?} and {b:?}: {}", apart.sqrt());
            }
        }
        assert_eq!(hex(SECOND), "#56b4e9");
    }
}
