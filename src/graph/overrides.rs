//! Values of the command line that replace a file's.
//!
//! In come a file's value tree and `--set` pairs; the tree goes out with them in it, so that everything after reads and
//! checks them like the file's own.

use std::collections::HashMap;

use crate::diag::{Diagnostic, Diagnostics, Span};
use crate::formula::edit;
use crate::formula::value::{Name, Value, ValueKind};

/// A value of the command line that replaces a file's: `parameter`, `field`, `node.parameter`, or a path of any
/// length into the file, such as `look.fog`, `camera.position.x` or `nodes.turn.axis`.
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
    "end",
    "pre",
    "post",
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
    "clip",
    "cut",
    "look",
    "light",
    "environment",
    "atmosphere",
    "scene",
    "film",
    "animation",
];

/// Fields whose parts alone an override may set.
const TABLES: &[&str] = &["nodes", "objects", "params", "presets", "tests"];

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

/// A file's value with some of its values changed, and those of its parameters.
pub fn patched(value: &Value, overrides: &[Override], d: &mut Diagnostics) -> (Value, HashMap<String, Value>) {
    let (mut patched, mut params) = (value.clone(), HashMap::new());
    for change in overrides {
        apply_override(&mut patched, change, &mut params, d);
    }
    (patched, params)
}

/// Where the value that a path of `--set` names stands in a file: a parameter's default, a part of a node, or of another field.
pub fn place_of(tree: &Value, path: &str) -> Vec<String> {
    let parts: Vec<String> = path.split('.').map(ToString::to_string).collect();
    let has =
        |table: &str, name: &String| edit::field(tree, table).is_some_and(|table| edit::field(table, name).is_some());
    let within = |table: &str, parts: &[String]| [&[table.to_string()], parts].concat();
    match &parts[..] {
        [name] if has("params", name) => ["params", name, "default"].map(ToString::to_string).to_vec(),
        [table, name] if table == "params" => ["params", name, "default"].map(ToString::to_string).to_vec(),
        [node, ..] if has("nodes", node) => within("nodes", &parts),
        _ => parts,
    }
}

/// Puts an override into the value tree, or into `params` where it names a fractal's parameter.
fn apply_override(value: &mut Value, change: &Override, params: &mut HashMap<String, Value>, d: &mut Diagnostics) {
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
        Some((head, rest)) => {
            let parts: Vec<&str> = rest.split('.').collect();
            if head == "params" && parts.len() == 1 && names_of(root, "params").contains(&parts[0].to_string()) {
                params.insert(parts[0].to_string(), change.value.clone());
                return;
            }
            let known = names_of(root, "nodes");
            let set = if known.iter().any(|name| name == head) {
                let nodes = find(root, "nodes").and_then(|i| entry_mut(&mut root[i].1, head));
                nodes.map_or(Ok(()), |node| set_part(node, &parts, &change.value))
            } else if let Some(i) = find(root, head) {
                set_part(&mut root[i].1, &parts, &change.value)
            } else if FIELDS.contains(&head) {
                let mut value = Value::new(change.value.span, ValueKind::Unit);
                let set = set_part(&mut value, &parts, &change.value);
                root.push((Name::new(change.value.span, head), value));
                set
            } else {
                d.push(unknown_head(head, change.value.span, &known));
                return;
            };
            if let Err(wrong) = set {
                let diagnostic = Diagnostic::error(format!("`{}` cannot be set: {}", change.path, wrong.why));
                d.push(diagnostic.label(change.value.span, "").help(wrong.help));
            }
        }
    }
}

/// The message for a path whose first part is neither a node nor a field.
fn unknown_head(head: &str, span: Span, nodes: &[String]) -> Diagnostic {
    let names = nodes.iter().map(String::as_str).chain(FIELDS.iter().chain(TABLES).copied());
    let diagnostic = Diagnostic::error(format!("there is no node `{head}`, and no field of this name"))
        .label(span, "cannot be set")
        .did_you_mean(head, names);
    match diagnostic.help.is_empty() && !nodes.is_empty() {
        true => diagnostic.help(format!("the nodes are: {}", nodes.join(", "))),
        false => diagnostic,
    }
}

/// Why a part cannot be set.
struct Wrong {
    why: String,
    help: String,
}

/// Sets the part of a value that a path leads to; fields that are not there are added.
fn set_part(target: &mut Value, path: &[&str], new: &Value) -> Result<(), Wrong> {
    let Some((first, rest)) = path.split_first() else {
        *target = new.clone();
        return Ok(());
    };
    let name = target.name().cloned();
    match &mut target.kind {
        // What has no parts yet: a node without parameters, a field that the file leaves out.
        ValueKind::Unit | ValueKind::Variant(_) => {
            target.kind = ValueKind::Struct { name, fields: Vec::new() };
        }
        ValueKind::Tuple { items, .. } if items.is_empty() => {
            target.kind = ValueKind::Struct { name, fields: Vec::new() };
        }
        _ => {}
    }
    match &mut target.kind {
        ValueKind::Struct { fields, .. } => {
            drop_twin(fields, first);
            if let Some((_, value)) = fields.iter_mut().find(|(name, _)| name.text == *first) {
                return set_part(value, rest, new);
            }
            let mut value = Value::new(new.span, ValueKind::Unit);
            set_part(&mut value, rest, new)?;
            fields.push((Name::new(new.span, *first), value));
            Ok(())
        }
        ValueKind::Map(items) => {
            let names: Vec<String> = items.iter().filter_map(|(key, _)| string_of(key)).collect();
            match items.iter_mut().find(|(key, _)| string_of(key).as_deref() == Some(first)) {
                Some((_, value)) => set_part(value, rest, new),
                None => Err(Wrong {
                    why: format!("there is no `{first}`"),
                    help: format!("there is: {}", names.join(", ")),
                }),
            }
        }
        ValueKind::List(items) | ValueKind::Tuple { items, .. } => {
            let count = items.len();
            let letter = ["x", "y", "z", "w"].iter().position(|letter| letter == first).filter(|_| count <= 4);
            match letter.or_else(|| first.parse().ok()).filter(|i| *i < count) {
                Some(i) => set_part(&mut items[i], rest, new),
                None => Err(Wrong {
                    why: format!("there is no item `{first}`"),
                    help: format!("items are numbered from 0 to {}", count.saturating_sub(1)),
                }),
            }
        }
        ValueKind::Str(text) => Err(Wrong {
            why: format!("\"{text}\" has no parts"),
            help: format!("a node is reached by its own name: {text}.{}", path.join(".")),
        }),
        _ => Err(Wrong {
            why: format!("{} has no parts", target.describe()),
            help: format!("leave out `.{}`", path.join(".")),
        }),
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
