//! Reading and changing value trees.

use crate::diag::Span;
pub(super) use crate::formula::edit::field;
use crate::formula::value::{Name, Value, ValueKind};

/// What stays true of a formula whose numbers have moved.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Keeps {
    /// What its parameters say: radii that are written as expressions of them, and its camera.
    Expressions,
    /// Its camera.
    Camera,
    /// Nothing.
    Nothing,
}

pub(super) fn value(kind: ValueKind) -> Value {
    Value::new(Span::NONE, kind)
}

pub(super) fn number(x: f64) -> Value {
    value(ValueKind::Number(x))
}

pub(super) fn string(text: impl Into<String>) -> Value {
    value(ValueKind::Str(text.into()))
}

pub(super) fn list(items: Vec<Value>) -> Value {
    value(ValueKind::List(items))
}

/// `name(items)`.
pub(super) fn tuple(name: &str, items: Vec<Value>) -> Value {
    value(ValueKind::Tuple { name: Some(Name::new(Span::NONE, name)), items })
}

/// `name(field: value)`.
pub(super) fn fields_of(name: &str, fields: Vec<(&str, Value)>) -> Value {
    let fields = fields.into_iter().map(|(field, value)| (Name::new(Span::NONE, field), value)).collect();
    value(ValueKind::Struct { name: Some(Name::new(Span::NONE, name)), fields })
}

pub(super) fn field_mut<'v>(of: &'v mut Value, name: &str) -> Option<&'v mut Value> {
    match &mut of.kind {
        ValueKind::Struct { fields, .. } => fields.iter_mut().find(|(n, _)| n.text == name).map(|(_, value)| value),
        ValueKind::Map(items) => items.iter_mut().find(|(key, _)| is_key(key, name)).map(|(_, value)| value),
        _ => None,
    }
}

fn is_key(key: &Value, name: &str) -> bool {
    matches!(&key.kind, ValueKind::Str(text) if text == name)
}

/// Names and values of a table, whether it is written as a map or as a struct.
pub(super) fn entries_mut(table: &mut Value) -> Vec<(String, &mut Value)> {
    match &mut table.kind {
        ValueKind::Struct { fields, .. } => fields.iter_mut().map(|(n, value)| (n.text.clone(), value)).collect(),
        ValueKind::Map(items) => {
            items.iter_mut().filter_map(|(key, value)| string_of(key).map(|text| (text, value))).collect()
        }
        _ => Vec::new(),
    }
}

pub(super) fn string_of(value: &Value) -> Option<String> {
    match &value.kind {
        ValueKind::Str(text) => Some(text.clone()),
        _ => None,
    }
}

pub(super) fn number_of(value: &Value) -> Option<f64> {
    match value.kind {
        ValueKind::Number(x) => Some(x),
        _ => None,
    }
}

/// Sets the field of a struct, or the entry of a map.
pub(super) fn set(of: &mut Value, name: &str, new: Value) {
    if let Some(value) = field_mut(of, name) {
        *value = new;
        return;
    }
    match &mut of.kind {
        ValueKind::Struct { fields, .. } => fields.push((Name::new(Span::NONE, name), new)),
        ValueKind::Map(items) => items.push((string(name), new)),
        _ => {}
    }
}

pub(super) fn set_text(of: &mut Value, name: &str, text: String) {
    set(of, name, string(text));
}

/// Removes fields of a struct; true if one was there.
pub(super) fn remove(of: &mut Value, names: &[&str]) -> bool {
    let ValueKind::Struct { fields, .. } = &mut of.kind else { return false };
    let before = fields.len();
    fields.retain(|(name, _)| !names.contains(&name.text.as_str()));
    fields.len() < before
}

/// What a calibration chose, which holds for the parent alone.
const OUTCOME: [&str; 6] = ["method", "fudge", "least_step", "most_step", "late_ends", "calibrated"];

/// Removes what was said of the parent and may be wrong now: tests, presets, measured estimates, radii, the camera.
pub(super) fn forget(tree: &mut Value, keeps: Keeps) {
    remove(tree, &["tests", "presets", "name"]);
    let is_cut = matches!(field(tree, "cuts").map(|value| &value.kind), Some(ValueKind::Bool(true)));
    let is_written = |value: Option<&Value>| value.is_some_and(|value| string_of(value).is_some());
    let keeps_radius = keeps == Keeps::Expressions && is_written(field(tree, "bounding_radius"));
    if !keeps_radius && !is_cut {
        remove(tree, &["bounding_radius"]);
    }
    if keeps == Keeps::Nothing && field(tree, "plane").is_none() {
        remove(tree, &["camera"]);
    }
    walk(tree, &mut |value| {
        let Some(estimate) = field_mut(value, "estimate") else { return };
        if field(estimate, "calibrated").is_some() {
            remove(estimate, &OUTCOME);
        }
        if keeps != Keeps::Expressions || !is_written(field(estimate, "radius")) {
            remove(estimate, &["radius"]);
        }
        if matches!(&estimate.kind, ValueKind::Struct { fields, .. } if fields.is_empty()) {
            remove(value, &["estimate"]);
        }
    });
}

/// Visits a value and all that it is made of.
pub(super) fn walk(value: &mut Value, visit: &mut dyn FnMut(&mut Value)) {
    visit(value);
    match &mut value.kind {
        ValueKind::List(items) | ValueKind::Tuple { items, .. } => items.iter_mut().for_each(|item| walk(item, visit)),
        ValueKind::Struct { fields, .. } => fields.iter_mut().for_each(|(_, value)| walk(value, visit)),
        ValueKind::Map(items) => items.iter_mut().for_each(|(_, value)| walk(value, visit)),
        _ => {}
    }
}
