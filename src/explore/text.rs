//! Value trees as the text of formula files.

use std::fmt::Write;

use crate::formula::value::{Value, ValueKind};

/// Longest line that is not broken.
const WIDTH: usize = 110;

/// A tree as a file's text, behind comments.
pub(super) fn written(tree: &Value, comments: &[String]) -> String {
    let mut text = String::new();
    for line in comments {
        let line: String = line.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
        let _ = writeln!(text, "// {}", line.trim_end());
    }
    let ValueKind::Struct { name: None, fields } = &tree.kind else {
        let _ = writeln!(text, "{}", tree.kind);
        return text;
    };
    text.push_str("(\n");
    for (name, value) in fields {
        let _ = writeln!(text, "    {}: {},", name.text, broken(value, 4));
    }
    text.push_str(")\n");
    text
}

/// A value whose long tables and lists have an entry a line, indented from `at`.
fn broken(value: &Value, at: usize) -> String {
    let whole = value.kind.to_string();
    let is_table = matches!(&value.kind, ValueKind::Map(items) if !items.is_empty());
    if !is_table && at + whole.len() <= WIDTH {
        return whole;
    }
    let inner = at + 4;
    let lines = |open: String, entries: Vec<String>, close: &str| {
        let mut text = format!("{open}\n");
        for entry in entries {
            let _ = writeln!(text, "{:inner$}{entry},", "");
        }
        let _ = write!(text, "{:at$}{close}", "");
        text
    };
    match &value.kind {
        ValueKind::Map(items) => {
            let entry = |(key, value): &(Value, Value)| format!("{}: {}", key.kind, broken(value, inner));
            lines("{".into(), items.iter().map(entry).collect(), "}")
        }
        ValueKind::Struct { name, fields } => {
            let open = format!("{}(", name.as_ref().map_or("", |name| &name.text));
            let entries = fields.iter().map(|(name, value)| format!("{}: {}", name.text, broken(value, inner)));
            lines(open, entries.collect(), ")")
        }
        ValueKind::List(items) if !items.is_empty() => {
            lines("[".into(), items.iter().map(|item| broken(item, inner)).collect(), "]")
        }
        _ => whole,
    }
}
