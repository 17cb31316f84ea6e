//! Colour spaces as matrices: primaries, white points, adaptation from one white to another.

use glam::{DMat3, DVec3};

/// Chromaticities (CIE 1931) of red, green and blue.
pub(super) type Primaries = [[f64; 2]; 3];

/// ITU-R BT.709, which sRGB has too.
pub(super) const SRGB: Primaries = [[0.64, 0.33], [0.30, 0.60], [0.15, 0.06]];
/// SMPTE EG 432-1 (P3 D65), which Display P3 has.
pub(super) const P3: Primaries = [[0.680, 0.320], [0.265, 0.690], [0.150, 0.060]];
/// Daylight of 6504 K.
pub(super) const D65: [f64; 2] = [0.3127, 0.3290];
/// The white of ICC profiles.
pub(super) const D50: [f64; 2] = [0.345_703, 0.358_539];

/// XYZ of a chromaticity at luminance 1.
pub(super) fn xyz_of([x, y]: [f64; 2]) -> DVec3 {
    DVec3::new(x / y, 1.0, (1.0 - x - y) / y)
}

/// Linear colours of these primaries, whose white is that of daylight, to XYZ.
pub(super) fn xyz_from(primaries: Primaries) -> DMat3 {
    let [r, g, b] = primaries.map(xyz_of);
    let columns = DMat3::from_cols(r, g, b);
    columns * DMat3::from_diagonal(columns.inverse() * xyz_of(D65))
}

/// XYZ under one white to XYZ under another (Bradford's adaptation; Lam, 1985; coefficients as in ICC.1:2022, annex E).
pub(super) fn adapted(from: [f64; 2], to: [f64; 2]) -> DMat3 {
    let cones = DMat3::from_cols_array(&[0.8951, -0.7502, 0.0389, 0.2664, 1.7135, -0.0685, -0.1614, 0.0367, 1.0296]);
    let gain = (cones * xyz_of(to)) / (cones * xyz_of(from));
    cones.inverse() * DMat3::from_diagonal(gain) * cones
}

/// The chromaticity of a black body, for 1667 to 25000 K (cubic splines of Kim et al., US patent 7024034, 2006).
fn black_body(kelvin: f64) -> [f64; 2] {
    let cubic = |[a, b, c, d]: [f64; 4], t: f64| ((a * t + b) * t + c) * t + d;
    let inverse = 1e3 / kelvin;
    let x = match kelvin < 4000.0 {
        true => cubic([-0.266_123_9, -0.234_358_9, 0.877_695_6, 0.179_910], inverse),
        false => cubic([-3.025_846_9, 2.107_037_9, 0.222_634_7, 0.240_390], inverse),
    };
    let y = match kelvin {
        k if k < 2222.0 => cubic([-1.106_381_4, -1.348_110_2, 2.185_558_32, -0.202_196_83], x),
        k if k < 4000.0 => cubic([-0.954_947_6, -1.374_185_93, 2.091_370_15, -0.167_488_67], x),
        _ => cubic([3.081_758, -5.873_386_7, 3.751_129_97, -0.370_014_83], x),
    };
    [x, y]
}

/// Linear sRGB in which light of this colour temperature becomes as white as that of the other: rows of a matrix.
pub(super) fn balanced(kelvin: f64, white: f64) -> [[f64; 3]; 3] {
    let xyz = xyz_from(SRGB);
    rows(xyz.inverse() * adapted(black_body(kelvin), black_body(white)) * xyz)
}

/// Linear sRGB to linear Display P3: rows of a matrix.
pub(super) fn p3_from_srgb() -> [[f64; 3]; 3] {
    rows(xyz_from(P3).inverse() * xyz_from(SRGB))
}

fn rows(matrix: DMat3) -> [[f64; 3]; 3] {
    matrix.transpose().to_cols_array_2d()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(a: &[f64], b: &[f64], most: f64) {
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < most), "{a:?} and {b:?}");
    }

    /// The matrix of IEC 61966-2-1, and that of CSS Color 4 for Display P3.
    #[test]
    fn spaces_are_those_of_their_standards() {
        let srgb = xyz_from(SRGB).transpose().to_cols_array();
        near(&srgb, &[0.4124, 0.3576, 0.1805, 0.2126, 0.7152, 0.0722, 0.0193, 0.1192, 0.9505], 1e-4);
        let p3 = p3_from_srgb().concat();
        near(&p3, &[0.822_462, 0.177_538, 0.0, 0.033_194, 0.966_806, 0.0, 0.017_083, 0.072_397, 0.910_520], 1e-4);
        // Bradford from D65 to D50, as CSS Color 4 has it, whose D50 has four digits.
        let bradford = adapted(D65, D50).transpose().to_cols_array();
        let known =
            [1.047_93, 0.022_947, -0.050_192, 0.029_628, 0.990_434, -0.017_074, -0.009_243, 0.015_055, 0.751_874];
        near(&bradford, &known, 3e-4);
    }

    #[test]
    fn black_bodies_have_their_colours() {
        // Planck's law through the observer of 1931: illuminant A, and two points of the locus.
        for (kelvin, known) in [(2856.0, [0.4476, 0.4074]), (1667.0, [0.5646, 0.4029]), (10_000.0, [0.2807, 0.2884])] {
            near(&black_body(kelvin), &known, 1.5e-3);
        }
        let neutral = balanced(6500.0, 6500.0).concat();
        near(&neutral, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], 1e-12);
        // Candle light that is to look white takes red away and adds blue.
        let [red, _, blue] = balanced(2000.0, 6500.0).map(|row| row.iter().sum::<f64>());
        assert!(red < 0.6 && blue > 4.0, "{red} {blue}");
    }
}
