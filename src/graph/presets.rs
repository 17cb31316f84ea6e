//! Presets: named sets of values that a fractal's file offers.
//!
//! In comes the field `presets` of a file's value tree; a preset goes out as the overrides that it stands for, so that
//! everything after reads and checks them like `--set` pairs. The override `preset` asks for one by name.

use super::overrides::Override;
use crate::diag::{Diagnostic, Diagnostics, Span};
use crate::formula::decode::{Fields, entries};
use crate::formula::edit::field;
use crate::formula::value::{Value, ValueKind};

/// The path of the override that asks for a preset.
pub const PRESET: &str = "preset";

/// Values that belong together, under a name.
#[derive(Clone, Debug)]
pub struct Preset {
    /// Name: letters, digits, `_` and `-`.
    pub name: String,
    /// What it shows.
    pub help: String,
    /// Place of its name.
    pub span: Span,
    /// What it changes, each as `--set` would.
    pub changes: Vec<Override>,
}

/// What a preset of a file's value tree changes, as `--set` would: paths and values. None where there is no such preset.
pub fn preset_values<'v>(tree: &'v Value, name: &str) -> Option<Vec<(String, &'v Value)>> {
    let preset = field(field(tree, "presets")?, name)?;
    let mut values = Vec::new();
    if let Some(Value { kind: ValueKind::Map(items), .. }) = field(preset, "set") {
        values.extend(items.iter().filter_map(|(key, value)| match &key.kind {
            ValueKind::Str(path) => Some((path.clone(), value)),
            _ => None,
        }));
    }
    values.extend(OF_SCENES.iter().filter_map(|part| Some((part.to_string(), field(preset, part)?))));
    Some(values)
}

/// Fields of presets that replace those of the file's scene.
const OF_SCENES: [&str; 4] = ["camera", "plane", "look", "film"];

/// Reads `presets: { "name": (help: "...", set: { "power": 5.0 }, camera: (...), look: (...)) }`.
pub(super) fn read_presets(value: &Value, d: &mut Diagnostics) -> Vec<Preset> {
    let mut presets = Vec::new();
    for (name, value) in entries(value, "presets", d) {
        let is_word = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
        if name.text.is_empty() || !name.text.chars().all(is_word) {
            let message = format!("`{}` cannot be the name of a preset", name.text);
            d.push(Diagnostic::error(message).label(name.span, "").help("use letters, digits, _ and -"));
        }
        let Some(mut fields) = Fields::new(value, "a preset", d) else { continue };
        let help = fields.or("help", String::new(), d);
        let mut changes = Vec::new();
        if let Some(set) = fields.optional_value("set") {
            let given = entries(set, "values of a preset", d);
            changes.extend(given.into_iter().map(|(path, value)| Override { path: path.text, value: value.clone() }));
        }
        for field in OF_SCENES {
            let given = fields.optional_value(field);
            changes.extend(given.map(|value| Override { path: field.into(), value: value.clone() }));
        }
        fields.finish(d);
        if changes.is_empty() {
            let help = "give it values: `set: { \"power\": 5.0 }`, a `camera`, a `plane`, a `look` or a `film`";
            d.push(
                Diagnostic::error(format!("the preset `{}` changes nothing", name.text))
                    .label(name.span, "")
                    .help(help),
            );
        }
        presets.push(Preset { name: name.text, help, span: name.span, changes });
    }
    presets
}

/// The overrides with the preset that they ask for in its values; what else they say comes after it, and wins.
///
/// Nothing is returned where there is no such preset, which is reported with the closest name.
pub fn expand_presets(value: &Value, overrides: &[Override], d: &mut Diagnostics) -> Option<Vec<Override>> {
    let (asked, others): (Vec<&Override>, Vec<&Override>) = overrides.iter().partition(|change| change.path == PRESET);
    if asked.is_empty() {
        return Some(overrides.to_vec());
    }
    let ValueKind::Struct { fields, .. } = &value.kind else { return Some(overrides.to_vec()) };
    let field = fields.iter().find(|(name, _)| name.text == "presets");
    // What is wrong with them is told when the file is read.
    let presets = field.map(|(_, value)| read_presets(value, &mut Diagnostics::default())).unwrap_or_default();
    let mut changes = Vec::new();
    for change in asked {
        let name = match &change.value.kind {
            ValueKind::Str(text) => text.as_str(),
            _ => change.value.name().map_or("", |name| name.text.as_str()),
        };
        match presets.iter().find(|preset| preset.name == name) {
            Some(preset) => changes.extend(preset.changes.iter().cloned()),
            None => {
                d.push(unknown_preset(name, change.value.span, &presets));
                return None;
            }
        }
    }
    changes.extend(others.into_iter().cloned());
    Some(changes)
}

fn unknown_preset(name: &str, span: Span, presets: &[Preset]) -> Diagnostic {
    let names: Vec<&str> = presets.iter().map(|preset| preset.name.as_str()).collect();
    let diagnostic = Diagnostic::error(format!("there is no preset `{name}`"))
        .label(span, "not a preset of this fractal")
        .did_you_mean(name, names.iter().copied());
    match (diagnostic.help.is_empty(), names.is_empty()) {
        (true, true) => {
            diagnostic.help("the fractal has no presets; a file holds them in `presets: { \"name\": (set: { ... }) }`")
        }
        (true, false) => diagnostic.help(format!("the presets are: {}", names.join(", "))),
        _ => diagnostic,
    }
}
