//! Values of the command line in the place of a file's.
//!
//! In come a file's value tree and `--set` pairs; the tree goes out with them in it, so that everything after reads and
//! checks them like the file's own.

use std::collections::HashMap;

use crate::diag::{Diagnostic, Diagnostics, Span};
use crate::formula::value::{Name, Value, ValueKind};

/// A value that the command line puts in the place of a file's: `parameter`, `field` or `node.parameter`.
#[derive(Clone, Debug)]
pub struct Override {
    /// What to replace.
    pub path: String,
    /// The new value.
    pub value: Value,
}

/// Fields of a fractal that an override may set as a whole.
const FIELDS: &[&str] = &[
    "name",
    "summary",
    "group",
    "inventor",
    "year",
    "source",
    "output",
    "constant",
    "start",
    "escape",
    "escape_radius",
    "max_iterations",
    "slice",
    "estimate",
    "camera",
    "plane",
    "bounding_radius",
    "cuts",
    "look",
];

fn unknown_override(path: &str, span: Span, params: &[String]) -> Diagnostic {
    let names = params.iter().map(String::as_str).chain(FIELDS.iter().copied());
    let message = format!("there is no parameter `{path}`");
    let diagnostic = Diagnostic::error(message).label(span, "cannot be set").did_you_mean(path, names);
    match (diagnostic.help.is_empty(), params.is_empty()) {
        (true, false) => diagnostic.help(format!("the fractal's parameters are: {}", params.join(", "))),
        (true, true) => diagnostic.help("the fractal has no parameters; `node.parameter=value` sets a node's"),
        _ => diagnostic,
    }
}

/// Puts an override into the value tree, or into `params` where it names a fractal's parameter.
pub(super) fn apply_override(
    value: &mut Value,
    change: &Override,
    params: &mut HashMap<String, Value>,
    d: &mut Diagnostics,
) {
    let root = match &mut value.kind {
        ValueKind::Struct { fields, .. } => fields,
        _ => return, // told of when the graph is read
    };
    let find = |fields: &[(Name, Value)], name: &str| fields.iter().position(|(n, _)| n.text == name);
    let names_of = |fields: &[(Name, Value)], field: &str| -> Vec<String> {
        let table = find(fields, field).map(|i| &fields[i].1.kind);
        match table {
            Some(ValueKind::Map(items)) => items.iter().filter_map(|(k, _)| string_of(k)).collect(),
            Some(ValueKind::Struct { fields, .. }) => fields.iter().map(|(n, _)| n.text.clone()).collect(),
            _ => Vec::new(),
        }
    };
    if !change.path.contains('.') {
        drop_twin(root, &change.path);
    }
    match change.path.split_once('.') {
        None if names_of(root, "params").contains(&change.path) => {
            params.insert(change.path.clone(), change.value.clone());
        }
        None => match find(root, &change.path) {
            Some(i) if FIELDS.contains(&change.path.as_str()) => root[i].1 = change.value.clone(),
            None if FIELDS.contains(&change.path.as_str()) => {
                root.push((Name::new(change.value.span, &*change.path), change.value.clone()));
            }
            _ => d.push(unknown_override(&change.path, change.value.span, &names_of(root, "params"))),
        },
        Some((node, parameter)) => {
            let known = names_of(root, "nodes");
            let target = find(root, "nodes").and_then(|i| entry_mut(&mut root[i].1, node));
            let Some(target) = target else {
                let mut diagnostic = Diagnostic::error(format!("there is no node `{node}`"))
                    .label(change.value.span, "cannot be set")
                    .did_you_mean(node, known.iter().map(String::as_str));
                if diagnostic.help.is_empty() && !known.is_empty() {
                    diagnostic = diagnostic.help(format!("the nodes are: {}", known.join(", ")));
                }
                d.push(diagnostic);
                return;
            };
            set_field(target, parameter, change, d);
        }
    }
}

fn set_field(target: &mut Value, parameter: &str, change: &Override, d: &mut Diagnostics) {
    if let ValueKind::Tuple { name, items } = &target.kind
        && items.is_empty()
    {
        target.kind = ValueKind::Struct { name: name.clone(), fields: Vec::new() };
    }
    if let ValueKind::Variant(name) = &target.kind {
        target.kind = ValueKind::Struct { name: Some(name.clone()), fields: Vec::new() };
    }
    match &mut target.kind {
        ValueKind::Struct { fields, .. } => {
            drop_twin(fields, parameter);
            match fields.iter_mut().find(|(n, _)| n.text == parameter) {
                Some((_, value)) => *value = change.value.clone(),
                None => fields.push((Name::new(change.value.span, parameter), change.value.clone())),
            }
        }
        _ => {
            let message = format!("the node of `{}` has no parameters", change.path);
            d.push(Diagnostic::error(message).label(change.value.span, ""));
        }
    }
}

/// Leaves out the other spelling of an orbit's escape test: the one that is set is meant alone.
fn drop_twin(fields: &mut Vec<(Name, Value)>, set: &str) {
    let twin = match set {
        "escape" => "escape_radius",
        "escape_radius" => "escape",
        _ => return,
    };
    fields.retain(|(name, _)| name.text != twin);
}

fn string_of(value: &Value) -> Option<String> {
    match &value.kind {
        ValueKind::Str(text) => Some(text.clone()),
        _ => None,
    }
}

fn entry_mut<'v>(table: &'v mut Value, name: &str) -> Option<&'v mut Value> {
    match &mut table.kind {
        ValueKind::Map(items) => items.iter_mut().find(|(k, _)| string_of(k).as_deref() == Some(name)).map(|(_, v)| v),
        ValueKind::Struct { fields, .. } => fields.iter_mut().find(|(n, _)| n.text == name).map(|(_, v)| v),
        _ => None,
    }
}
