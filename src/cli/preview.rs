//! A picture in the terminal: by kitty's graphics where the terminal has them, else in half blocks of 24-bit colour.

use std::io::{self, IsTerminal, Write};

use bulbfold::engine::Sink;
use bulbfold::film::{Image, Layers, Rows};
use bulbfold::shade::Size;
use console::Term;

/// Most columns of pixels that are sent.
const MOST_PIXELS: u32 = 960;
/// Least lines that are left for other talk.
const LEFT: u32 = 4;

/// Hands rows on and keeps a small copy of the picture.
pub struct Preview<'a> {
    sink: &'a mut dyn Sink,
    size: Size,
    /// Size of the copy.
    small: Size,
    /// Sums of colours and counts, a pixel of the copy each.
    sums: Vec<[u32; 4]>,
    /// Pixels that came.
    come: usize,
    is_kitty: bool,
}

impl<'a> Preview<'a> {
    /// A preview on stderr; `None` where that is no terminal.
    pub fn new(sink: &'a mut dyn Sink, size: Size) -> Option<Preview<'a>> {
        let variable = |name: &str| std::env::var(name).unwrap_or_default();
        let is_kitty = variable("TERM").contains("kitty")
            || ["kitty", "ghostty", "WezTerm"].contains(&variable("TERM_PROGRAM").as_str());
        let (lines, columns) = Term::stderr().size();
        let cells = Size { width: u32::from(columns), height: u32::from(lines).saturating_sub(LEFT) };
        io::stderr().is_terminal().then(|| Preview::within(sink, size, cells, is_kitty))
    }

    /// A preview in a terminal of so many columns and lines.
    fn within(sink: &'a mut dyn Sink, size: Size, cells: Size, is_kitty: bool) -> Preview<'a> {
        let most = match is_kitty {
            true => Size { width: MOST_PIXELS, height: MOST_PIXELS },
            // A cell holds two pixels, one above the other.
            false => Size { width: cells.width.max(1), height: (2 * cells.height).max(2) },
        };
        let small = fitted(size, most);
        Preview { sink, size, small, sums: vec![[0; 4]; (small.width * small.height) as usize], come: 0, is_kitty }
    }

    /// What shows the picture in the terminal.
    pub fn shown(&self) -> Vec<u8> {
        let colours: Vec<[u8; 3]> =
            self.sums.iter().map(|[r, g, b, n]| [r, g, b].map(|sum| (sum / n.max(&1)) as u8)).collect();
        if self.is_kitty { kitty(&colours, self.small) } else { half_blocks(&colours, self.small.width as usize) }
    }

    /// Shows the picture.
    pub fn show(&self) {
        let _ = io::stderr().write_all(&self.shown());
    }
}

/// Shows a picture in the terminal in place of what is there; does nothing where stderr is none.
pub fn show(image: &Image) {
    let mut nowhere = |_: Rows| Ok(());
    if let Some(mut preview) = Preview::new(&mut nowhere, image.size) {
        let _ = preview.push(Rows { srgb: image.rgb.clone(), ..Rows::default() });
        let _ = io::stderr().write_all(b"\x1b[H\x1b[2J");
        preview.show();
    }
}

impl Sink for Preview<'_> {
    fn layers(&self) -> Layers {
        self.sink.layers()
    }

    fn push(&mut self, rows: Rows) -> io::Result<()> {
        let Size { width, height } = self.size;
        for rgb in rows.srgb.chunks_exact(3) {
            let (x, y) = (self.come as u64 % u64::from(width), self.come as u64 / u64::from(width));
            let at =
                |x: u64, small: u32, large: u32| (x * u64::from(small) / u64::from(large)).min(u64::from(small) - 1);
            let place = at(y, self.small.height, height) * u64::from(self.small.width) + at(x, self.small.width, width);
            let sum = &mut self.sums[place as usize];
            (0..3).for_each(|k| sum[k] += u32::from(rgb[k]));
            sum[3] += 1;
            self.come += 1;
        }
        self.sink.push(rows)
    }
}

/// The largest size of a picture's shape within another, and no larger than the picture.
fn fitted(size: Size, most: Size) -> Size {
    let [width, height] = [size.width, size.height].map(f64::from);
    let scale = (f64::from(most.width) / width).min(f64::from(most.height) / height).min(1.0);
    let of = |edge: f64, most: u32| ((edge * scale).round() as u32).clamp(1, most);
    Size { width: of(width, most.width), height: of(height, most.height) }
}

/// Lines of upper half blocks: the letter's colour is the upper pixel's, the ground's the lower one's.
fn half_blocks(colours: &[[u8; 3]], width: usize) -> Vec<u8> {
    let mut text = String::new();
    let rows: Vec<&[[u8; 3]]> = colours.chunks(width).collect();
    for pair in rows.chunks(2) {
        for (x, [r, g, b]) in pair[0].iter().enumerate() {
            text += &format!("\x1b[38;2;{r};{g};{b}m");
            text += &match pair.get(1) {
                Some(below) => format!("\x1b[48;2;{};{};{}m\u{2580}", below[x][0], below[x][1], below[x][2]),
                None => "\x1b[49m\u{2580}".to_string(),
            };
        }
        text += "\x1b[0m\n";
    }
    text.into_bytes()
}

/// Most bytes of a part, as the protocol has it.
const PART: usize = 4096;

/// The picture by kitty's graphics protocol (<https://sw.kovidgoyal.net/kitty/graphics-protocol/>): RGB in base64, in parts.
fn kitty(colours: &[[u8; 3]], size: Size) -> Vec<u8> {
    let encoded = base64(colours.as_flattened());
    let mut text = Vec::new();
    let count = encoded.len().div_ceil(PART);
    for (number, part) in encoded.chunks(PART).enumerate() {
        let head = match number {
            0 => format!("a=T,f=24,s={},v={},", size.width, size.height),
            _ => String::new(),
        };
        text.extend(format!("\x1b_G{head}m={};", u8::from(number + 1 < count)).into_bytes());
        text.extend(part);
        text.extend(b"\x1b\\");
    }
    text.push(b'\n');
    text
}

/// Base64 with padding (RFC 4648).
fn base64(bytes: &[u8]) -> Vec<u8> {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = Vec::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let bits = (0..3).fold(0u32, |bits, k| bits << 8 | u32::from(three.get(k).copied().unwrap_or(0)));
        let letter = |k: usize| LETTERS[(bits >> (18 - 6 * k)) as usize & 63];
        text.extend((0..4).map(|k| if k <= three.len() { letter(k) } else { b'=' }));
    }
    text
}

#[cfg(test)]
mod tests {
    use bulbfold::engine::Sink;
    use bulbfold::film::{Image, Rows};
    use bulbfold::shade::Size;

    use super::{Preview, base64, fitted};

    #[test]
    fn base64_is_that_of_the_rfc() {
        let text = |bytes: &str| String::from_utf8(base64(bytes.as_bytes())).unwrap();
        assert_eq!(["", "f", "fo", "foo", "foobar"].map(text), ["", "Zg==", "Zm8=", "Zm9v", "Zm9vYmFy"]);
    }

    #[test]
    fn pictures_fit_into_terminals_and_keep_their_colours() {
        let of = |width, height| Size { width, height };
        assert_eq!(fitted(of(1280, 720), of(80, 40)), of(71, 40));
        assert_eq!(fitted(of(10, 5), of(80, 40)), of(10, 5));
        assert_eq!(fitted(of(16384, 1), of(80, 40)), of(80, 1));
        for is_kitty in [false, true] {
            let mut image = Image { size: of(4, 4), rgb: Vec::new() };
            let mut preview = Preview::within(&mut image, of(4, 4), of(4, 2), is_kitty);
            let rows = [[255, 0, 0], [0, 0, 255]].map(|colour: [u8; 3]| [colour; 8].concat());
            for srgb in rows {
                preview.push(Rows { srgb, ..Rows::default() }).unwrap();
            }
            let shown = String::from_utf8(preview.shown()).unwrap();
            match is_kitty {
                true => assert!(shown.starts_with("\x1b_Ga=T,f=24,s=4,v=4,m=0;/wAA"), "{shown:?}"),
                false => {
                    assert_eq!(shown.lines().count(), 2);
                    assert!(shown.contains("\x1b[38;2;255;0;0m\x1b[48;2;255;0;0m\u{2580}"), "{shown:?}");
                    assert!(shown.contains("\x1b[38;2;0;0;255m"), "{shown:?}");
                }
            }
            assert_eq!(image.rgb.len(), 48);
        }
    }
}
