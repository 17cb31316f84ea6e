//! Bytes of files to text, in whatever encoding another program wrote them.

/// Largest file that is read, in bytes.
pub const MAX_BYTES: u64 = 64 << 20;

/// A file's text, with `\n` or `\r\n` at the ends of its lines.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Decoded {
    /// The text.
    pub text: String,
    /// What it was read as, where that is not UTF-8.
    pub encoding: Option<&'static str>,
}

/// Reads UTF-8 and UTF-16, both with or without a byte order mark; what is neither is read as Latin-1, where every byte is a
/// character. Never fails: broken pairs of UTF-16 become replacement characters.
pub fn decode(bytes: &[u8]) -> Decoded {
    let utf16 = |bytes: &[u8], read: fn([u8; 2]) -> u16| {
        let units = bytes.chunks_exact(2).map(|pair| read([pair[0], pair[1]]));
        char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect::<String>()
    };
    let (text, encoding) = match bytes {
        [0xef, 0xbb, 0xbf, rest @ ..] => match std::str::from_utf8(rest) {
            Ok(text) => (text.to_string(), None),
            Err(_) => (latin1(rest), Some("Latin-1")),
        },
        [0xff, 0xfe, rest @ ..] => (utf16(rest, u16::from_le_bytes), Some("UTF-16")),
        [0xfe, 0xff, rest @ ..] => (utf16(rest, u16::from_be_bytes), Some("UTF-16")),
        // ASCII in UTF-16 without a mark has a zero in every second place.
        [first, 0, ..] if *first != 0 => (utf16(bytes, u16::from_le_bytes), Some("UTF-16")),
        [0, second, ..] if *second != 0 => (utf16(bytes, u16::from_be_bytes), Some("UTF-16")),
        _ => match std::str::from_utf8(bytes) {
            Ok(text) => (text.to_string(), None),
            Err(_) => (latin1(bytes), Some("Latin-1")),
        },
    };
    let text = if text.contains('\r') && !text.contains('\n') { text.replace('\r', "\n") } else { text };
    Decoded { text, encoding }
}

fn latin1(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| char::from(*byte)).collect()
}

#[cfg(test)]
mod tests {
    use super::decode;

    #[test]
    fn the_same_text_in_every_encoding() {
        let text = "# caf\u{e9}\nN 5;\n";
        let units: Vec<u16> = text.encode_utf16().collect();
        let little: Vec<u8> = units.iter().flat_map(|unit| unit.to_le_bytes()).collect();
        let big: Vec<u8> = units.iter().flat_map(|unit| unit.to_be_bytes()).collect();
        let forms: [Vec<u8>; 7] = [
            text.as_bytes().to_vec(),
            [&[0xef, 0xbb, 0xbf], text.as_bytes()].concat(),
            text.chars().map(|c| c as u8).collect(),
            [&[0xff, 0xfe][..], &little].concat(),
            [&[0xfe, 0xff][..], &big].concat(),
            little,
            big,
        ];
        for form in forms {
            assert_eq!(decode(&form).text, text);
        }
        assert_eq!(decode(b"a\rb\r").text, "a\nb\n");
    }
}
