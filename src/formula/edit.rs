//! Changes of a formula file's text that leave everything else in it as it is, comments included.
//!
//! In come a text, the value that was read from it (which knows the place of every part) and the fields to set; out comes
//! the new text. What is read again from it differs in those fields alone.

use std::ops::Range;

use super::value::{Value, ValueKind};
use crate::diag::Span;

/// Name and text of each field that is set, in order.
pub type Entries<'a> = &'a [(&'a str, String)];

/// Texts that take the place of others.
#[derive(Default)]
pub struct Edits {
    all: Vec<(Range<usize>, String)>,
}

impl Edits {
    /// Whether nothing changes.
    pub fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    fn push(&mut self, range: Range<usize>, text: impl Into<String>) {
        self.all.push((range, text.into()));
    }

    /// The text with all changes made. They must not overlap.
    pub fn apply(mut self, text: &str) -> String {
        self.all.sort_by_key(|(range, _)| (range.start, range.end));
        let mut out = String::with_capacity(text.len() + 256);
        let mut at = 0;
        for (range, new) in self.all {
            out.push_str(&text[at..range.start]);
            out.push_str(&new);
            at = range.end;
        }
        out.push_str(&text[at..]);
        out
    }

    /// Sets `entries` in the struct `name: (...)` among the fields of `host`, and removes its fields that are in `dropped`;
    /// others stay. Where there is no such struct, it is added: after the last field of `after` that there is, else at the
    /// end. Does nothing unless `host` has fields.
    pub fn set_struct(
        &mut self,
        text: &str,
        host: &Value,
        name: &str,
        entries: Entries,
        dropped: &[&str],
        after: &[&str],
    ) {
        let ValueKind::Struct { fields, .. } = &host.kind else { return };
        match fields.iter().find(|(field, _)| field.text == name) {
            Some((_, value)) => self.change(text, value, entries, dropped),
            None if entries.is_empty() => {}
            None => {
                let anchor = fields.iter().rev().find(|(field, _)| after.contains(&field.text.as_str()));
                let Some((field, value)) = anchor.or(fields.last()) else { return };
                let added = format!("{name}: ({})", joined(entries));
                self.add_after(text, field.span.range().start, value.span.range().end, &added);
            }
        }
    }

    /// Sets the part of a value that names and numbers lead to, as `--set` reaches it; a field that a struct or a bare name lacks is
    /// added. Returns whether there is such a place.
    pub fn set_part(&mut self, text: &str, value: &Value, path: &[&str], new: &str) -> bool {
        let range = value.span.range();
        let Some((first, rest)) = path.split_first() else {
            self.push(range, new);
            return true;
        };
        let added = format!("{first}: {new}");
        match &value.kind {
            ValueKind::Struct { fields, .. } => {
                match (fields.iter().find(|(name, _)| name.text == *first), fields.last()) {
                    (Some((_, inner)), _) => return self.set_part(text, inner, rest, new),
                    (None, Some((field, last))) if rest.is_empty() => {
                        self.add_after(text, field.span.range().start, last.span.range().end, &added);
                    }
                    _ => return false,
                }
            }
            ValueKind::Variant(name) if rest.is_empty() => self.push(range, format!("{}({added})", name.text)),
            ValueKind::Tuple { name: Some(name), items } if items.is_empty() && rest.is_empty() => {
                self.push(range, format!("{}({added})", name.text));
            }
            ValueKind::Unit if rest.is_empty() => self.push(range, format!("({added})")),
            ValueKind::List(items) | ValueKind::Tuple { items, .. } => {
                let letter = ["x", "y", "z", "w"].iter().position(|letter| letter == first);
                let item = letter.or_else(|| first.parse().ok()).and_then(|i| items.get(i));
                return item.is_some_and(|item| self.set_part(text, item, rest, new));
            }
            _ => return field(value, first).is_some_and(|inner| self.set_part(text, inner, rest, new)),
        }
        true
    }

    /// Sets an entry of the table `name: { "key": value }` among the fields of `host`. Where there is no such table, it is added with the entry on a line of
    /// its own: behind the first field of `after` that there is, else at the end. Returns whether `host` has a place for it.
    pub fn set_entry(
        &mut self,
        text: &str,
        host: &Value,
        (name, after): (&str, &[&str]),
        (key, new): (&str, &str),
    ) -> bool {
        let ValueKind::Struct { fields, .. } = &host.kind else { return false };
        match fields.iter().find(|(field, _)| field.text == name).map(|(_, table)| table) {
            Some(table) if field(table, key).is_some() => return self.set_part(text, table, &[key], new),
            Some(Value { kind: ValueKind::Map(items), span }) => match items.last() {
                Some((last, value)) => {
                    let added = format!("{key:?}: {new}");
                    self.add_after(text, last.span.range().start, value.span.range().end, &added);
                }
                None => self.push(span.range(), format!("{{ {key:?}: {new} }}")),
            },
            Some(_) => return false,
            None => {
                let anchor = after.iter().find_map(|name| fields.iter().find(|(field, _)| field.text == *name));
                let Some((field, value)) = anchor.or(fields.last()) else { return false };
                let start = field.span.range().start;
                let line = text[..start].rfind('\n').map_or(0, |at| at + 1);
                let indent = if text[line..start].trim().is_empty() { &text[line..start] } else { "" };
                let added = format!("{name}: {{\n{indent}    {key:?}: {new},\n{indent}}}");
                self.add_after(text, start, value.span.range().end, &added);
            }
        }
        true
    }

    /// Changes the fields of a struct that is there.
    fn change(&mut self, text: &str, value: &Value, entries: Entries, dropped: &[&str]) {
        let range = value.span.range();
        let ValueKind::Struct { fields, .. } = &value.kind else {
            // `()`, or something that reading has refused.
            return self.push(range, format!("({})", joined(entries)));
        };
        let is_dropped = |name: &str| dropped.contains(&name) || entries.iter().any(|(entry, _)| *entry == name);
        let kept = fields.iter().filter(|(field, _)| !is_dropped(&field.text)).count();
        for (i, (field, old)) in fields.iter().enumerate().filter(|(_, (field, _))| is_dropped(&field.text)) {
            let end = match fields.get(i + 1) {
                // Up to the next field on the same line; comments between two lines stay.
                Some((next, _)) if !text[old.span.range().end..next.span.range().start].contains('\n') => {
                    next.span.range().start
                }
                _ => after_comma(text, old.span.range().end),
            };
            self.push(field.span.range().start..end, "");
        }
        let Some((first, _)) = fields.first() else { return };
        let at = first.span.range().start;
        match (entries.is_empty(), kept) {
            (true, _) => {}
            (false, 0) => self.push(at..at, joined(entries)),
            (false, _) => self.push(at..at, format!("{}, ", joined(entries))),
        }
    }

    /// Adds a field behind another: on a line of its own where the other one ends its line, else beside it.
    fn add_after(&mut self, text: &str, start: usize, end: usize, added: &str) {
        let line_start = text[..start].rfind('\n').map_or(0, |at| at + 1);
        let indent = &text[line_start..start];
        let comma = after_comma(text, end);
        let has_comma = comma > end;
        let rest = text[comma..].split('\n').next().unwrap_or("");
        let is_line_end = text[comma..].contains('\n') && (rest.trim().is_empty() || rest.trim().starts_with("//"));
        if !(is_line_end && indent.trim().is_empty() && has_comma) {
            return self.push(end..end, format!(", {added}"));
        }
        let at = comma + rest.trim_end_matches('\r').len();
        let line_end = if rest.ends_with('\r') { "\r\n" } else { "\n" };
        self.push(at..at, format!("{line_end}{indent}{added},"));
    }
}

/// The place behind a value's comma, or behind the value where none follows.
fn after_comma(text: &str, end: usize) -> usize {
    let rest = &text[end..];
    let blank = rest.len() - rest.trim_start_matches([' ', '\t']).len();
    if rest[blank..].starts_with(',') { end + blank + 1 } else { end }
}

fn joined(entries: Entries) -> String {
    entries.iter().map(|(name, value)| format!("{name}: {value}")).collect::<Vec<_>>().join(", ")
}

/// The field of a struct, or the entry of a map.
pub fn field<'v>(of: &'v Value, name: &str) -> Option<&'v Value> {
    let is_key = |key: &Value| matches!(&key.kind, ValueKind::Str(text) if text == name);
    match &of.kind {
        ValueKind::Struct { fields, .. } => fields.iter().find(|(n, _)| n.text == name).map(|(_, value)| value),
        ValueKind::Map(items) => items.iter().find(|(key, _)| is_key(key)).map(|(_, value)| value),
        _ => None,
    }
}

/// The value at a place, anywhere in a tree.
pub fn find(value: &Value, span: Span) -> Option<&Value> {
    if value.span == span {
        return Some(value);
    }
    let inner: Vec<&Value> = match &value.kind {
        ValueKind::List(items) | ValueKind::Tuple { items, .. } => items.iter().collect(),
        ValueKind::Struct { fields, .. } => fields.iter().map(|(_, value)| value).collect(),
        ValueKind::Map(entries) => entries.iter().flat_map(|(key, value)| [key, value]).collect(),
        _ => Vec::new(),
    };
    inner.into_iter().find_map(|value| find(value, span))
}

#[cfg(test)]
mod tests {
    use super::Edits;
    use crate::diag::{Diagnostics, Sources};
    use crate::formula::ron::{Limits, read_ron};

    fn set(text: &str, entries: &[(&str, &str)], dropped: &[&str]) -> String {
        let mut sources = Sources::default();
        let id = sources.add("a.ron", text);
        let mut d = Diagnostics::default();
        let value = read_ron(&sources, id, &Limits::default(), &mut d).unwrap();
        let entries: Vec<(&str, String)> = entries.iter().map(|(k, v)| (*k, v.to_string())).collect();
        let mut edits = Edits::default();
        edits.set_struct(text, &value, "estimate", &entries, dropped, &["nodes", "output", "limit"]);
        let new = edits.apply(text);
        let id = sources.add("b.ron", new.as_str());
        read_ron(&sources, id, &Limits::default(), &mut d);
        assert!(!d.has_errors(), "{new}\n{}", d.render(&sources, false));
        new
    }

    const NEW: &[(&str, &str)] = &[("fudge", "0.7"), ("calibrated", "true")];

    #[test]
    fn a_missing_struct_is_added_behind_its_anchor() {
        let before = "// top\n(\n    output: \"a\", // why\n    limit: 3,\n    camera: (1, 2),\n    // end\n)\n";
        let after = "// top\n(\n    output: \"a\", // why\n    limit: 3,\n    estimate: (fudge: 0.7, calibrated: true),\n    camera: (1, 2),\n    // end\n)\n";
        assert_eq!(set(before, NEW, &[]), after);
        let with_comment = before.replace("limit: 3,", "limit: 3, // three");
        assert_eq!(set(&with_comment, NEW, &[]), after.replace("limit: 3,", "limit: 3, // three"));
        let windows = before.replace('\n', "\r\n");
        assert_eq!(set(&windows, NEW, &[]), after.replace('\n', "\r\n"));
    }

    #[test]
    fn short_files_stay_on_their_line() {
        assert_eq!(set("(limit: 3)", NEW, &[]), "(limit: 3, estimate: (fudge: 0.7, calibrated: true))");
        assert_eq!(set("(limit: 3, b: 1,)", NEW, &[]), "(limit: 3, estimate: (fudge: 0.7, calibrated: true), b: 1,)");
        assert_eq!(set("(\n  b: 1\n)", NEW, &[]), "(\n  b: 1, estimate: (fudge: 0.7, calibrated: true)\n)");
    }

    #[test]
    fn fields_that_are_not_set_stay() {
        let before = "(estimate: (radius: \"2 * a\" /* why */, fudge: 1))";
        assert_eq!(set(before, NEW, &[]), "(estimate: (fudge: 0.7, calibrated: true, radius: \"2 * a\" /* why */, ))");
        let before = "(estimate: (fudge: 1, radius: 2), b: 1)";
        assert_eq!(set(before, NEW, &[]), "(estimate: (fudge: 0.7, calibrated: true, radius: 2), b: 1)");
        assert_eq!(set("(estimate: ())", NEW, &[]), "(estimate: (fudge: 0.7, calibrated: true))");
    }

    #[test]
    fn setting_twice_is_setting_once() {
        let before = "(\n  limit: 3,\n  estimate: (\n    // a\n    radius: 2, // b\n    fudge: 1, // c\n  ),\n)";
        let once = set(before, NEW, &[]);
        assert_eq!(set(&once, NEW, &[]), once);
        for comment in ["// a", "// b", "// c"] {
            assert!(once.contains(comment), "{once}");
        }
        let dropped = set(&once, &[], &["fudge", "calibrated"]);
        assert!(dropped.contains("radius: 2") && !dropped.contains("fudge"), "{dropped}");
    }
}
