//! The ICC profile of Display P3, for the formats that name their colour space so (ICC.1:2022).

use super::primaries::{D50, D65, P3, adapted, xyz_from, xyz_of};

/// What PNG files write instead: the primaries of P3 with the white of daylight, the curve of sRGB, RGB, full range
/// (ITU-T H.273, as the chunk `cICP` has them).
pub(super) const CODE_POINTS: [u8; 4] = [12, 13, 0, 1];

/// A profile of version 4: matrix and curve. Always the same bytes.
pub(super) fn display_p3() -> Vec<u8> {
    let adapt = adapted(D65, D50);
    let primaries = adapt * xyz_from(P3);
    let [red, green, blue] = [0, 1, 2].map(|i| xyz(primaries.col(i).to_array()));
    let curve = curve();
    let tags: [(&[u8; 4], Vec<u8>); 9] = [
        (b"desc", text("Display P3")),
        (b"cprt", text("Public domain")),
        (b"wtpt", xyz(xyz_of(D50).to_array())),
        (b"chad", chromatic(&adapt.transpose().to_cols_array())),
        (b"rXYZ", red),
        (b"gXYZ", green),
        (b"bXYZ", blue),
        (b"rTRC", curve.clone()),
        (b"gTRC", curve.clone()),
    ];
    let mut table = Vec::new();
    let mut data = Vec::new();
    let count = tags.len() + 1;
    let start = 128 + 4 + 12 * count;
    let mut entry = |name: &[u8; 4], at: usize, length: usize| {
        table.extend_from_slice(name);
        table.extend_from_slice(&(at as u32).to_be_bytes());
        table.extend_from_slice(&(length as u32).to_be_bytes());
    };
    for (name, bytes) in &tags {
        entry(name, start + data.len(), bytes.len());
        data.extend_from_slice(bytes);
        data.resize(data.len().next_multiple_of(4), 0);
    }
    // Blue shares the last curve.
    entry(b"bTRC", start + data.len() - curve.len().next_multiple_of(4), curve.len());
    let mut profile = header((start + data.len()) as u32);
    profile.extend_from_slice(&(count as u32).to_be_bytes());
    profile.extend_from_slice(&table);
    profile.extend_from_slice(&data);
    profile
}

fn header(size: u32) -> Vec<u8> {
    let mut header = vec![0; 128];
    let mut put = |at: usize, bytes: &[u8]| header[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &size.to_be_bytes());
    put(8, &[4, 0x40, 0, 0]);
    put(12, b"mntrRGB XYZ ");
    // A date is asked for; that of the standard.
    put(24, &[0x07, 0xE6, 0, 5, 0, 1]);
    put(36, b"acsp");
    let white = xyz_of(D50).to_array().map(fixed).concat();
    put(68, &white);
    header
}

/// A number with 16 bits behind the point.
fn fixed(x: f64) -> [u8; 4] {
    ((x * 65536.0).round() as i32).to_be_bytes()
}

fn xyz(values: [f64; 3]) -> Vec<u8> {
    [*b"XYZ ", [0; 4]].into_iter().chain(values.map(fixed)).flatten().collect()
}

fn chromatic(values: &[f64; 9]) -> Vec<u8> {
    [*b"sf32", [0; 4]].into_iter().chain(values.map(fixed)).flatten().collect()
}

/// The curve of sRGB: a power above a line.
fn curve() -> Vec<u8> {
    let parameters = [2.4, 1.0 / 1.055, 0.055 / 1.055, 1.0 / 12.92, 0.04045];
    [*b"para", [0; 4], [0, 3, 0, 0]].into_iter().chain(parameters.map(fixed)).flatten().collect()
}

/// A text in English.
fn text(text: &str) -> Vec<u8> {
    let utf16: Vec<u8> = text.encode_utf16().flat_map(u16::to_be_bytes).collect();
    let mut bytes = [*b"mluc", [0; 4], 1_u32.to_be_bytes(), 12_u32.to_be_bytes(), *b"enUS"].concat();
    bytes.extend_from_slice(&(utf16.len() as u32).to_be_bytes());
    bytes.extend_from_slice(&28_u32.to_be_bytes());
    bytes.extend_from_slice(&utf16);
    bytes
}
