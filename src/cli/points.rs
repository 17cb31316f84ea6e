//! Reading points and rays from CSV files.

use std::path::Path;

use bulbfold::files::{Chosen, read_text};

use super::{Failure, usage};

/// Most bytes of a file of rows.
const MAX_BYTES: u64 = 64 << 20;
/// Most rows of one.
const MAX_ROWS: usize = 2_000_000;

/// Reads rows of `N` numbers. A first line that starts with a letter is a header; empty lines, spaces and CRLF are
/// fine; lines that start with `#` are comments.
pub fn read_rows<const N: usize>(path: &Path, columns: &str) -> Result<Vec<[f64; N]>, Failure> {
    let shown = path.display();
    let text = read_text(path, MAX_BYTES, Chosen::Named)
        .map_err(|error| usage(format!("cannot read {shown}: {error}"), ""))?;
    parse_rows(&text).map_err(|(line, what)| {
        let place = if line == 0 { shown.to_string() } else { format!("{shown}:{line}") };
        usage(format!("{place}: {what}"), &format!("each line holds {columns}"))
    })
}

/// The rows of a text, or the number of the line that is wrong (0 for the whole) and why.
fn parse_rows<const N: usize>(text: &str) -> Result<Vec<[f64; N]>, (usize, String)> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut rows = Vec::new();
    let mut may_be_header = true;
    for (i, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let is_header = std::mem::take(&mut may_be_header) && is_header(line);
        if !is_header {
            if rows.len() == MAX_ROWS {
                return Err((i + 1, format!("there are more than {MAX_ROWS} rows")));
            }
            rows.push(parse_row(line).map_err(|what| (i + 1, what))?);
        }
    }
    if rows.is_empty() { Err((0, "there are no rows".into())) } else { Ok(rows) }
}

/// True if no field is a number (`nan` counts as one) and each starts with a letter or a quote.
fn is_header(line: &str) -> bool {
    line.split(',').all(|field| {
        let field = field.trim();
        field.parse::<f64>().is_err() && field.starts_with(|c: char| c.is_alphabetic() || c == '"' || c == '\'')
    })
}

fn parse_row<const N: usize>(line: &str) -> Result<[f64; N], String> {
    let fields: Vec<&str> = line.split(',').collect();
    if fields.len() != N {
        return Err(format!("expected {N} numbers, found {}", fields.len()));
    }
    let mut row = [0.0; N];
    for (number, field) in row.iter_mut().zip(fields) {
        *number = super::arguments::parse_number(field)?;
    }
    Ok(row)
}

#[cfg(test)]
mod tests {
    use super::parse_rows;

    #[test]
    fn headers_blanks_spaces_and_crlf_are_tolerated() {
        let text = "\u{feff}x, y, z\r\n\r\n 1 , -2,3e0\r\n# comment\n4,5,6";
        assert_eq!(parse_rows::<3>(text), Ok(vec![[1.0, -2.0, 3.0], [4.0, 5.0, 6.0]]));
    }

    #[test]
    fn bad_lines_are_named() {
        let line = |text: &str| parse_rows::<3>(text).err().map(|(line, _)| line);
        assert_eq!(line("1,2,3\n\n1,2\n"), Some(3));
        assert_eq!(line("1,2,3\nx,y,z\n"), Some(2));
        assert_eq!(line("x,y,z\n1,nan,3\n"), Some(2));
        assert_eq!(line("nan,nan,nan\n"), Some(1));
        assert_eq!(line("\n\n"), Some(0));
    }
}
