//! Text on its way to a terminal: nothing that came from a file moves its cursor, changes its colours or renames its window.

use std::io::{self, Write};

use bulbfold::diag::printable;

/// Passes text on with its control characters shown instead of sent, as messages do ([`printable`]).
pub struct Clean<W: Write> {
    to: W,
    /// Bytes of a character whose others have not come yet.
    begun: Vec<u8>,
}

impl<W: Write> Clean<W> {
    /// Text that goes on to `to`.
    pub fn new(to: W) -> Clean<W> {
        Clean { to, begun: Vec::new() }
    }
}

impl<W: Write> Write for Clean<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.begun.is_empty()
            && let Ok(text) = std::str::from_utf8(bytes)
        {
            self.to.write_all(printable(text).as_bytes())?;
            return Ok(bytes.len());
        }
        self.begun.extend_from_slice(bytes);
        let all = std::mem::take(&mut self.begun);
        let mut rest = &all[..];
        while !rest.is_empty() {
            let (good, bad) = match std::str::from_utf8(rest) {
                Ok(text) => (text, None),
                Err(error) => {
                    let (good, after) = rest.split_at(error.valid_up_to());
                    (std::str::from_utf8(good).unwrap_or_default(), Some((error.error_len(), after)))
                }
            };
            self.to.write_all(printable(good).as_bytes())?;
            match bad {
                None => break,
                // The rest of the character is still to come.
                Some((None, after)) => {
                    self.begun = after.to_vec();
                    break;
                }
                Some((Some(count), after)) => {
                    self.to.write_all("\u{fffd}".as_bytes())?;
                    rest = &after[count..];
                }
            }
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.to.flush()
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::Clean;

    #[test]
    fn control_characters_are_shown() {
        let mut clean = Clean::new(Vec::new());
        let text = "a\x1b[31mb\u{9b}c\td\n\x07ö€";
        text.as_bytes().chunks(1).for_each(|byte| clean.write_all(byte).expect("a vector takes all"));
        clean.write_all(b"\xff!").expect("a vector takes all");
        assert_eq!(String::from_utf8(clean.to).expect("text"), "a\u{241b}[31mb\u{fffd}c\td\n\u{2407}ö€\u{fffd}!");
    }
}
