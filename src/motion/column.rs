//! Numbers over seconds in a table (CSV) or a list of objects (JSON).

use std::path::Path;

use crate::formula::library::Library;

/// Most rows of a file.
const MOST_ROWS: usize = 1_000_000;

/// Pairs of a time and a number. The file's ending tells JSON from tables.
///
/// Errors: why there are none, with the line.
pub fn read(library: &mut Library, path: &Path, (time, name): (&str, &str)) -> Result<Vec<(f64, f64)>, String> {
    let text = library.read_named(path).map_err(|error| format!("cannot be read: {error}"))?;
    let is_json = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("json"));
    let points = if is_json { of_json(&text, time, name)? } else { of_table(&text, time, name)? };
    match points.len() {
        0 => Err("there are no numbers in it".into()),
        1..=MOST_ROWS => Ok(points),
        _ => Err(format!("there are more than {MOST_ROWS} rows in it")),
    }
}

fn of_table(text: &str, time: &str, name: &str) -> Result<Vec<(f64, f64)>, String> {
    let separator =
        [b',', b';', b'\t'].into_iter().find(|&s| text.lines().next().is_some_and(|l| l.contains(s as char)));
    let mut table = csv::ReaderBuilder::new()
        .delimiter(separator.unwrap_or(b','))
        .comment(Some(b'#'))
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    let head = table.headers().map_err(|error| error.to_string())?.clone();
    let place = |name: &str| {
        let names: Vec<&str> = head.iter().collect();
        let found = names.iter().position(|known| *known == name);
        found.ok_or_else(|| format!("there is no column `{name}`; the columns are: {}", names.join(", ")))
    };
    let (at, of) = (place(time)?, place(name)?);
    let mut points = Vec::new();
    for row in table.records() {
        let row = row.map_err(|error| error.to_string())?;
        let line = row.position().map_or(0, csv::Position::line);
        let number = |column: usize, name: &str| {
            let text = row.get(column).unwrap_or_default();
            let number = text.parse::<f64>().ok().filter(|number| number.is_finite());
            number.ok_or_else(|| format!("line {line}: `{text}` in column `{name}` is no number"))
        };
        points.push((number(at, time)?, number(of, name)?));
    }
    Ok(points)
}

fn of_json(text: &str, time: &str, name: &str) -> Result<Vec<(f64, f64)>, String> {
    let whole: serde_json::Value = serde_json::from_str(text).map_err(|error| error.to_string())?;
    let rows = whole.as_array().ok_or_else(|| format!("expected a list such as [{{\"{time}\": 0, \"{name}\": 1}}]"))?;
    let number = |(i, row): (usize, &serde_json::Value), name: &str| {
        let number = row.get(name).and_then(serde_json::Value::as_f64);
        number.ok_or_else(|| format!("item {} has no number `{name}`", i + 1))
    };
    rows.iter().enumerate().map(|row| Ok((number(row, time)?, number(row, name)?))).collect()
}

#[cfg(test)]
mod tests {
    use super::{of_json, of_table};

    #[test]
    fn tables_and_lists_say_the_same() {
        let expected = Ok(vec![(0.0, 5.0), (1.5, -2.5)]);
        assert_eq!(of_table("t,power,x\n0,5,1\n# a remark\n1.5,-2.5,1\n", "t", "power"), expected);
        assert_eq!(of_table("x; t ;power\n0;0; 5\n0;1.5;-2.5\n", "t", "power"), expected);
        assert_eq!(of_json("[{\"t\": 0, \"power\": 5}, {\"t\": 1.5, \"power\": -2.5}]", "t", "power"), expected);
    }

    #[test]
    fn what_is_missing_is_told() {
        let told = |result: Result<_, String>, part: &str| {
            assert!(result.as_ref().is_err_and(|error: &String| error.contains(part)), "{result:?}");
        };
        told(of_table("t,power\n0,5\n", "t", "scale"), "the columns are: t, power");
        told(of_table("t,power\n0,5\n1,abc\n", "t", "power"), "line 3: `abc`");
        told(of_table("t,power\n0,5\n1\n", "t", "power"), "line");
        told(of_json("[{\"t\": 0}]", "t", "power"), "item 1 has no number `power`");
        told(of_json("{}", "t", "power"), "expected a list");
    }
}
