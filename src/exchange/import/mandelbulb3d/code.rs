//! Mandelbulb3D's parameters as bytes: the letters of a text block, and where a number stands among the bytes.
//!
//! A block is `Mandelbulb3Dv18{` letters `}`; each letter is six bits, lowest first, with `.` for 0, then `/`, digits, capitals
//! and small letters. Four letters are three bytes: a header of 840 and the hybrid's formulas, 188 each (record `TMandHeader11`
//! and `THeaderCustomAddon` of the program's published source).

/// Bytes of the header.
pub const HEADER: usize = 840;

/// Bytes of the formulas: eight of all, and six times 188.
pub const ADDON: usize = 8 + FORMULAS * FORMULA;

/// Bytes of a formula.
pub const FORMULA: usize = 188;

/// Formulas of a hybrid.
pub const FORMULAS: usize = 6;

/// A block of a text.
#[derive(Clone, PartialEq, Debug)]
pub struct Block<'t> {
    /// First byte of the block in the text.
    pub start: usize,
    /// The version in its first line, such as 18.
    pub version: f64,
    /// First byte of the letters.
    pub letters_at: usize,
    /// Its letters, with line ends.
    pub letters: &'t str,
    /// What `{Titel: ...}` behind it says.
    pub title: Option<&'t str>,
}

/// The first block of a text; nothing if it has none.
pub fn block(text: &str) -> Option<Block<'_>> {
    const NAME: &str = "Mandelbulb3Dv";
    let start = text.find(NAME)?;
    let version_at = start + NAME.len();
    let open = version_at + text[version_at..].find('{')?;
    let version = text[version_at..open].trim().parse().ok()?;
    let letters_at = open + 1;
    let length = text[letters_at..].find('}').unwrap_or(text.len() - letters_at);
    let behind = &text[letters_at + length..];
    let title = behind.find("{Titel:").map(|at| &behind[at + "{Titel:".len()..]);
    let title = title.map(|rest| rest.split(['}', '\n', '\r']).next().unwrap_or("").trim());
    Some(Block { start, version, letters_at, letters: &text[letters_at..letters_at + length], title })
}

/// The bytes of letters. The error is the place of a letter that is none, counted from the first.
pub fn bytes(letters: &str) -> Result<Vec<u8>, usize> {
    let mut found = Vec::with_capacity(letters.len() * 3 / 4);
    let (mut bits, mut count) = (0_u32, 0);
    let mut push = |value: u32| {
        bits |= value << (6 * count);
        count += 1;
        if count == 4 {
            found.extend_from_slice(&bits.to_le_bytes()[..3]);
            (bits, count) = (0, 0);
        }
    };
    for (at, letter) in letters.char_indices() {
        match letter {
            _ if letter.is_whitespace() && letter != '\u{85}' => {}
            // Word processors make one sign of three points.
            '\u{2026}' | '\u{85}' => (0..3).for_each(|_| push(0)),
            '.'..='9' => push(u32::from(letter) - 46),
            'A'..='Z' => push(u32::from(letter) - 53),
            'a'..='z' => push(u32::from(letter) - 59),
            _ => return Err(at),
        }
    }
    Ok(found)
}

/// Bytes with numbers at known places; what lies beyond the end is 0.
pub struct Record(pub Vec<u8>);

impl Record {
    fn array<const N: usize>(&self, at: usize) -> [u8; N] {
        std::array::from_fn(|i| self.0.get(at + i).copied().unwrap_or(0))
    }

    /// A byte.
    pub fn byte(&self, at: usize) -> u8 {
        self.array::<1>(at)[0]
    }

    /// A whole number of four bytes.
    pub fn whole(&self, at: usize) -> i32 {
        i32::from_le_bytes(self.array(at))
    }

    /// A number of eight bytes.
    pub fn number(&self, at: usize) -> f64 {
        f64::from_le_bytes(self.array(at))
    }

    /// Three numbers in a row.
    pub fn vector(&self, at: usize) -> [f64; 3] {
        std::array::from_fn(|i| self.number(at + 8 * i))
    }

    /// A text that ends with a zero.
    pub fn text(&self, at: usize, length: usize) -> String {
        let bytes = (at..at + length).map(|i| self.byte(i)).take_while(|byte| *byte != 0);
        bytes.map(char::from).collect::<String>().trim().to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::{Record, block, bytes};

    #[test]
    fn letters_are_six_bits_each() {
        // 1, 64 and 4096 times 63: the last letter of all is z.
        assert_eq!(bytes("zzzz"), Ok(vec![0xff; 3]));
        assert_eq!(bytes("/... A\n..."), Ok(vec![1, 0, 0, 12, 0, 0]));
        assert_eq!(bytes("\u{2026}/"), Ok(vec![0, 0, 4]));
        assert_eq!(bytes("ab!"), Err(2));
        assert_eq!(Record(vec![0, 0, 0, 0, 0, 0, 0xf0, 0x3f]).number(0), 1.0);
    }

    #[test]
    fn a_block_stands_anywhere_in_a_text() {
        let found = block("Have fun\nMandelbulb3Dv18{\nab\n}\n{Titel: x y}\n").unwrap();
        assert_eq!((found.version, found.letters.trim(), found.title), (18.0, "ab", Some("x y")));
        assert_eq!(block("Mandelbulb3D"), None);
    }
}
