//! Turns the text of a number into its value.

/// Why a text is no number.
#[derive(Debug, PartialEq)]
pub(super) enum NumberError {
    /// It is not spelled like one.
    Malformed,
    /// It is beyond `f64`, or beyond the type that its suffix names.
    TooLarge,
    /// It is NaN or infinity, by name.
    NotFinite,
}

/// Number types that may stand at the end of a number, and their least and greatest value.
const SUFFIXES: [(&str, f64, f64); 12] = [
    ("f32", -f32::MAX as f64, f32::MAX as f64),
    ("f64", -f64::MAX, f64::MAX),
    ("i8", i8::MIN as f64, i8::MAX as f64),
    ("i16", i16::MIN as f64, i16::MAX as f64),
    ("i32", i32::MIN as f64, i32::MAX as f64),
    ("i64", i64::MIN as f64, i64::MAX as f64),
    ("i128", i128::MIN as f64, i128::MAX as f64),
    ("u8", 0.0, u8::MAX as f64),
    ("u16", 0.0, u16::MAX as f64),
    ("u32", 0.0, u32::MAX as f64),
    ("u64", 0.0, u64::MAX as f64),
    ("u128", 0.0, u128::MAX as f64),
];

/// Whether an identifier is one of RON's names for NaN and infinity.
pub(super) fn is_not_finite_name(name: &str) -> bool {
    let bare = name.strip_suffix("f32").or(name.strip_suffix("f64")).unwrap_or(name);
    matches!(bare, "NaN" | "inf")
}

/// Reads sign, prefix, digits, underscores, fraction, exponent and suffix.
///
/// Precision: nearest `f64`; with the suffix `f32` nearest `f32`. Integers above 2^53 are rounded.
pub(super) fn parse_number(text: &str) -> Result<f64, NumberError> {
    let (sign, body) = match text.as_bytes().first() {
        Some(b'-') => (-1.0, &text[1..]),
        Some(b'+') => (1.0, &text[1..]),
        _ => (1.0, text),
    };
    if is_not_finite_name(body) {
        return Err(NumberError::NotFinite);
    }
    let radix = match body.get(..2) {
        Some("0x") => Some((16, &body[2..])),
        Some("0o") => Some((8, &body[2..])),
        Some("0b") => Some((2, &body[2..])),
        _ => None,
    };
    let (digits, suffix) = split_suffix(body, radix.is_some_and(|(radix, _)| radix == 16));
    let magnitude = match radix {
        Some((radix, _)) => parse_integer(&digits[2..], radix)?,
        None => parse_decimal(digits)?,
    };
    let number = sign * magnitude;
    let Some((name, least, greatest)) = suffix else {
        return if number.is_finite() { Ok(number) } else { Err(NumberError::TooLarge) };
    };
    if name.starts_with('f') {
        if radix.is_some() {
            return Err(NumberError::Malformed);
        }
    } else if digits.contains('.') || (radix.is_none() && digits.contains(['e', 'E'])) {
        return Err(NumberError::Malformed);
    }
    let number = if name == "f32" { f64::from(number as f32) } else { number };
    if (least..=greatest).contains(&number) { Ok(number) } else { Err(NumberError::TooLarge) }
}

/// Splits off the type at the end. In hexadecimal `f32` is digits.
fn split_suffix(body: &str, is_hex: bool) -> (&str, Option<(&'static str, f64, f64)>) {
    let suffixes = SUFFIXES.into_iter().filter(|(name, ..)| !is_hex || !name.starts_with('f'));
    for suffix in suffixes {
        if let Some(digits) = body.strip_suffix(suffix.0) {
            return (digits, Some(suffix));
        }
    }
    (body, None)
}

/// Reads digits of a radix other than ten.
fn parse_integer(digits: &str, radix: u32) -> Result<f64, NumberError> {
    if !digits.starts_with(|c: char| c.is_digit(radix)) {
        return Err(NumberError::Malformed);
    }
    let mut number = Some(0_u128);
    for c in digits.chars().filter(|c| *c != '_') {
        let digit = c.to_digit(radix).ok_or(NumberError::Malformed)?;
        number = number.and_then(|n| n.checked_mul(radix.into())?.checked_add(digit.into()));
    }
    number.map(|n| n as f64).ok_or(NumberError::TooLarge)
}

/// Reads decimal digits with fraction and exponent. Underscores may follow digits and the `e`.
fn parse_decimal(digits: &str) -> Result<f64, NumberError> {
    let mut plain = String::with_capacity(digits.len());
    for c in digits.chars() {
        match c {
            '_' if plain.ends_with(|p: char| p.is_ascii_digit() || matches!(p, 'e' | 'E')) => {}
            '0'..='9' | '.' | 'e' | 'E' | '+' | '-' => plain.push(c),
            _ => return Err(NumberError::Malformed),
        }
    }
    if !plain.starts_with(|c: char| c.is_ascii_digit() || c == '.') {
        return Err(NumberError::Malformed);
    }
    let number: f64 = plain.parse().map_err(|_| NumberError::Malformed)?;
    if number.is_finite() { Ok(number) } else { Err(NumberError::TooLarge) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_every_spelling() {
        for (text, number) in [
            ("0", 0.0),
            ("-0", -0.0),
            ("+7", 7.0),
            ("1_000", 1000.0),
            ("1.5", 1.5),
            (".5", 0.5),
            ("5.", 5.0),
            ("-2.5e-3", -0.0025),
            ("1E+2", 100.0),
            ("0xFF", 255.0),
            ("-0x1f", -31.0),
            ("0b1010_1010", 170.0),
            ("0o17", 15.0),
            ("0x1f32", 7986.0),
            ("1.0f32", 1.0),
            ("0.1f32", f64::from(0.1_f32)),
            ("2f64", 2.0),
            ("255u8", 255.0),
            ("-128i8", -128.0),
            ("0x7Fi8", 127.0),
            ("1e_3", 1000.0),
            ("1e-999", 0.0),
            ("18446744073709551615", 18_446_744_073_709_551_615.0),
        ] {
            let read = parse_number(text).unwrap_or(f64::NAN);
            assert_eq!(read.to_bits(), number.to_bits(), "{text}: {read}");
        }
    }

    #[test]
    fn what_is_no_number() {
        use NumberError::{Malformed, NotFinite, TooLarge};
        for (text, error) in [
            ("", Malformed),
            ("-", Malformed),
            (".", Malformed),
            ("--1", Malformed),
            ("1..2", Malformed),
            ("1.2.3", Malformed),
            ("1e", Malformed),
            ("0x", Malformed),
            ("0x_1", Malformed),
            ("0b12", Malformed),
            ("12abc", Malformed),
            ("1._5", Malformed),
            ("_1", Malformed),
            ("1.5u8", Malformed),
            ("f32", Malformed),
            ("0b1f32", Malformed),
            ("-infinity", Malformed),
            ("1e999", TooLarge),
            ("-1e999", TooLarge),
            ("1e39f32", TooLarge),
            ("256u8", TooLarge),
            ("-1u32", TooLarge),
            ("inf", NotFinite),
            ("-inf", NotFinite),
            ("+NaN", NotFinite),
            ("NaNf64", NotFinite),
        ] {
            assert_eq!(parse_number(text), Err(error), "{text}");
        }
        assert_eq!(parse_number(&format!("0x1{}", "0".repeat(40))), Err(TooLarge));
        assert_eq!(parse_number(&"9".repeat(400)), Err(TooLarge));
    }
}
