//! Spaces of colours.

use crate::expr::Expr;

/// A linear colour: red, green and blue with the primaries of sRGB, 1 is white.
pub type Rgb = [f64; 3];

/// Linear RGB to the responses of the three cones, and their cube roots to OKLab (B. Ottosson, "A perceptual color space for image
/// processing", 2020, revised matrices of 2021).
const CONES_FROM_RGB: [[f64; 3]; 3] = [
    [0.412_221_470_8, 0.536_332_536_3, 0.051_445_992_9],
    [0.211_903_498_2, 0.680_699_545_1, 0.107_396_956_6],
    [0.088_302_461_9, 0.281_718_837_6, 0.629_978_700_5],
];
const LAB_FROM_ROOTS: [[f64; 3]; 3] = [
    [0.210_454_255_3, 0.793_617_785_0, -0.004_072_046_8],
    [1.977_998_495_1, -2.428_592_205_0, 0.450_593_709_9],
    [0.025_904_037_1, 0.782_771_766_2, -0.808_675_766_0],
];
/// The ways back.
const ROOTS_FROM_LAB: [[f64; 3]; 3] = [
    [1.0, 0.396_337_777_4, 0.215_803_757_3],
    [1.0, -0.105_561_345_8, -0.063_854_172_8],
    [1.0, -0.089_484_177_5, -1.291_485_548_0],
];
const RGB_FROM_CONES: [[f64; 3]; 3] = [
    [4.076_741_662_1, -3.307_711_591_3, 0.230_969_929_2],
    [-1.268_438_004_6, 2.609_757_401_1, -0.341_319_396_5],
    [-0.004_196_086_3, -0.703_418_614_7, 1.707_614_701_0],
];

fn times(rows: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    rows.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

/// The linear value of a value of sRGB between 0 and 1 (IEC 61966-2-1).
pub fn linear(srgb: f64) -> f64 {
    if srgb <= 0.04045 { srgb / 12.92 } else { ((srgb + 0.055) / 1.055).powf(2.4) }
}

/// The value of sRGB of a linear one between 0 and 1.
pub fn srgb(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// Lightness from 0 to 1, and the two axes from green to red and from blue to yellow.
pub fn oklab(rgb: Rgb) -> [f64; 3] {
    times(&LAB_FROM_ROOTS, times(&CONES_FROM_RGB, rgb).map(f64::cbrt))
}

/// The colour of OKLab coordinates; components that no screen has come out below 0 or above 1.
pub fn from_oklab(lab: [f64; 3]) -> Rgb {
    times(&RGB_FROM_CONES, times(&ROOTS_FROM_LAB, lab).map(|root| root * root * root))
}

/// The colour of this lightness (0 to 1), chroma (0 to about 0.37) and hue in degrees; of chromas that no screen has the largest that
/// there is.
pub fn from_oklch(lightness: f64, chroma: f64, hue_deg: f64) -> Rgb {
    let (sin, cos) = hue_deg.to_radians().sin_cos();
    let of = |chroma: f64| from_oklab([lightness.clamp(0.0, 1.0), chroma * cos, chroma * sin]);
    let is_shown = |rgb: &Rgb| rgb.iter().all(|part| (-1e-6..=1.0 + 1e-6).contains(part));
    let whole = of(chroma);
    if is_shown(&whole) {
        return whole.map(|part| part.clamp(0.0, 1.0));
    }
    let (mut low, mut high) = (0.0, chroma);
    for _ in 0..24 {
        let middle = (low + high) / 2.0;
        if is_shown(&of(middle)) { low = middle } else { high = middle }
    }
    of(low).map(|part| part.clamp(0.0, 1.0))
}

/// A colour as `#rrggbb`; what no screen shows takes the nearest end.
pub fn hex(rgb: Rgb) -> String {
    let [r, g, b] = rgb.map(|part| (srgb(part.clamp(0.0, 1.0)) * 255.0).round() as u8);
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// [`from_oklab`] as an expression, without components below 0.
pub(super) fn compose_from_oklab(lab: Expr<'_>) -> Expr<'_> {
    let roots = compose_times(&ROOTS_FROM_LAB, lab);
    compose_times(&RGB_FROM_CONES, roots * roots * roots).max(lab.lift(0.0))
}

fn compose_times<'g>(rows: &[[f64; 3]; 3], v: Expr<'g>) -> Expr<'g> {
    v.arena.compose(&rows.map(|row| v.dot(v.arena.v3(row))))
}

#[cfg(test)]
mod tests {
    use super::{from_oklab, hex, linear, oklab, srgb};

    /// White, and the primaries as B. Ottosson's page lists them.
    #[test]
    fn oklab_of_known_colours() {
        let near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 2e-3);
        assert!(near(oklab([1.0; 3]), [1.0, 0.0, 0.0]));
        assert!(near(oklab([1.0, 0.0, 0.0]), [0.628, 0.225, 0.126]));
        assert!(near(oklab([0.0, 0.0, 1.0]), [0.452, -0.032, -0.312]));
    }

    #[test]
    fn the_ways_back_lead_back() {
        for rgb in [[0.2, 0.5, 0.9], [0.0; 3], [1.0, 0.03, 0.0]] {
            let back = from_oklab(oklab(rgb));
            assert!(rgb.iter().zip(back).all(|(a, b)| (a - b).abs() < 1e-6), "{rgb:?} {back:?}");
        }
        for value in [0.0, 0.02, 0.5, 1.0] {
            assert!((linear(srgb(value)) - value).abs() < 1e-9);
        }
        assert_eq!(hex([linear(18.0 / 255.0), 1.0, 0.0]), "#12ff00");
    }
}
