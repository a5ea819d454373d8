//! The colours of daylight: the CIE daylight locus, in linear sRGB.

/// Luminance of a unit of each linear sRGB channel.
const LUMA: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// The luminance of a linear sRGB colour.
pub fn luminance(rgb: [f64; 3]) -> f64 {
    (0..3).map(|c| LUMA[c] * rgb[c]).sum()
}

/// Daylight of the chromaticity `x`, linear sRGB of unit luminance: y lies on the CIE daylight
/// locus, which CIE 15 gives for 4,000 K to 25,000 K (x from 0.25 to 0.38). A hue outside the gamut
/// is clipped.
pub fn daylight(x: f64) -> [f64; 3] {
    let y = (-3.0 * x + 2.870) * x - 0.275;
    let (big_x, big_z) = (x / y, (1.0 - x - y) / y);
    // XYZ to linear sRGB (IEC 61966-2-1), Y = 1.
    let rgb = [
        3.2406 * big_x - 1.5372 - 0.4986 * big_z,
        -0.9689 * big_x + 1.8758 + 0.0415 * big_z,
        0.0557 * big_x - 0.2040 + 1.0570 * big_z,
    ]
    .map(|channel| channel.max(0.0));
    let scale = 1.0 / luminance(rgb);
    rgb.map(|channel| channel * scale)
}

/// The CIE 1931 chromaticity x of a linear sRGB colour; none of black.
pub fn chromaticity_x([r, g, b]: [f64; 3]) -> Option<f64> {
    let big_x = 0.4124 * r + 0.3576 * g + 0.1805 * b;
    let big_y = luminance([r, g, b]);
    let big_z = 0.0193 * r + 0.1192 * g + 0.9505 * b;
    let sum = big_x + big_y + big_z;
    (sum > 0.0).then_some(big_x / sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn d65_is_white_and_the_locus_goes_from_orange_to_blue() {
        // D65 lies at x = 0.3127; its y on the locus is 0.3291 where the standard has 0.3290.
        assert!(daylight(0.3127).iter().all(|c| (c - 1.0).abs() < 5e-3));
        for x in [0.25, 0.28, 0.3127, 0.345, 0.38] {
            let colour = daylight(x);
            assert!((luminance(colour) - 1.0).abs() < 1e-12);
            assert!((chromaticity_x(colour).unwrap() - x).abs() < 2e-4);
            assert_eq!(colour[0] > colour[2], x > 0.3127 + 1e-3, "{x} {colour:?}");
        }
        assert_eq!(chromaticity_x([0.0; 3]), None);
    }
}
