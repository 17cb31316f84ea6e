//! Sizes of pictures as people say them.

use bulbfold::engine::MOST_EDGE;
use bulbfold::shade::Size;

/// Sizes with names.
const SIZES: [(&str, [u32; 2]); 9] = [
    ("hd", [1280, 720]),
    ("full-hd", [1920, 1080]),
    ("2k", [2560, 1440]),
    ("4k", [3840, 2160]),
    ("8k", [7680, 4320]),
    ("square", [1080, 1080]),
    ("portrait", [1080, 1350]),
    ("story", [1080, 1920]),
    ("cinema", [2048, 858]),
];
/// Sheets of paper, in millimetres (ISO 216).
const SHEETS: [(&str, [f64; 2]); 7] = [
    ("a0", [841.0, 1189.0]),
    ("a1", [594.0, 841.0]),
    ("a2", [420.0, 594.0]),
    ("a3", [297.0, 420.0]),
    ("a4", [210.0, 297.0]),
    ("a5", [148.0, 210.0]),
    ("a6", [105.0, 148.0]),
];

/// Reads the name of a size, or a sheet with its resolution: `4k`, `a4@300dpi`, `a3@150dpi-landscape`.
fn named_size(text: &str) -> Option<[u32; 2]> {
    let text = text.trim().to_ascii_lowercase();
    if let Some((_, size)) = SIZES.iter().find(|(name, _)| *name == text) {
        return Some(*size);
    }
    let (upright, is_wide) = text.strip_suffix("-landscape").map_or((&text[..], false), |rest| (rest, true));
    let (sheet, dpi) = upright.split_once('@')?;
    let dpi: f64 = dpi.strip_suffix("dpi")?.parse().ok().filter(|dpi| (1.0..=2400.0).contains(dpi))?;
    let (_, edges) = SHEETS.iter().find(|(name, _)| *name == sheet)?;
    let [width, height] = edges.map(|millimetres| (millimetres / 25.4 * dpi).round() as u32);
    Some(if is_wide { [height, width] } else { [width, height] })
}

/// Reads `WxH`, or a size by its name.
pub fn parse_size(text: &str) -> Result<Size, String> {
    if let Some([width, height]) = named_size(text) {
        return within(Size { width, height });
    }
    let names = SIZES.map(|(name, _)| name).join(", ");
    let expected = format!("write columns x rows such as 1280x720, a name ({names}), or a sheet such as a4@300dpi");
    let (width, height) = text.split_once(['x', 'X']).ok_or(expected.clone())?;
    let edge = |part: &str| part.trim().parse::<u32>().map_err(|_| expected.clone());
    within(Size { width: edge(width)?, height: edge(height)? })
}

/// A size that pictures may have.
fn within(size: Size) -> Result<Size, String> {
    let legal = 1..=MOST_EDGE;
    match legal.contains(&size.width) && legal.contains(&size.height) {
        true => Ok(size),
        false => Err(format!("columns and rows must be from 1 to {MOST_EDGE}")),
    }
}

#[cfg(test)]
mod tests {
    use super::parse_size;

    #[test]
    fn sizes_are_checked() {
        for (text, width, height) in
            [("64x48", 64, 48), ("4k", 3840, 2160), ("a4@300dpi", 2480, 3508), ("a4@300dpi-landscape", 3508, 2480)]
        {
            assert!(parse_size(text).is_ok_and(|s| s.width == width && s.height == height), "{text}");
        }
        for wrong in ["0x1", "16385x1", "64", "axb", "-1x4", "99999999999x1", "", "5k", "a4@x", "a0@2400dpi"] {
            assert!(parse_size(wrong).is_err(), "{wrong}");
        }
    }
}
