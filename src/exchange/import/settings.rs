//! The text form of Mandelbulber's settings: sections in brackets, and `name value;` a line.

use std::cell::RefCell;
use std::collections::HashSet;

use super::ask::Ask;
use super::value::Value;
use crate::diag::{Diagnostic, Diagnostics, SourceId, Sources, Span};

/// First words of a settings file.
const TITLE: &str = "Mandelbulber settings file";

/// The first version whose kaleidoscopic IFS turns only where `IFS_rotation_enabled` says so (found by trying 2.02 to 2.20).
const FIRST_ROTATION_SWITCH: f64 = 2.07;

/// One line.
#[derive(Clone, Debug)]
pub struct Entry {
    /// The setting's name.
    pub name: String,
    /// What stands behind it, without the semicolon.
    pub value: String,
    /// Place of the value.
    pub span: Span,
}

/// The lines between two headings.
#[derive(Clone, Debug, Default)]
pub struct Section {
    /// The heading, without brackets.
    pub name: String,
    /// Its lines.
    pub entries: Vec<Entry>,
    asked: RefCell<HashSet<String>>,
}

/// A settings file.
#[derive(Clone, Debug)]
pub struct Settings {
    /// All sections that hold settings.
    pub sections: Vec<Section>,
    /// Headings of those that hold something else, such as frames of an animation.
    pub others: Vec<String>,
}

impl Settings {
    /// Reads a file. Errors: each is pushed, with its place.
    pub fn read(sources: &Sources, id: SourceId, d: &mut Diagnostics) -> Option<Settings> {
        let text = sources.text(id);
        if !is_settings(text) {
            d.push(not_settings(text, sources, id));
            return None;
        }
        let mut settings = Settings { sections: Vec::new(), others: Vec::new() };
        let mut holds_settings = false;
        let mut at = 0;
        for raw in text.split_inclusive('\n') {
            let (start, line) = (at, raw.trim());
            at += raw.len();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            if let Some(name) = line.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')) {
                holds_settings = name == "main_parameters" || name.starts_with("fractal_");
                match holds_settings {
                    true => settings.sections.push(Section { name: name.to_string(), ..Section::default() }),
                    false => settings.others.push(name.to_string()),
                }
                continue;
            }
            let Some(section) = settings.sections.last_mut().filter(|_| holds_settings) else { continue };
            let indent = raw.len() - raw.trim_start().len();
            match entry(line, id, start + indent) {
                Ok(entry) => section.entries.push(entry),
                Err(diagnostic) => d.push(diagnostic),
            }
        }
        if version(sources.text(id)).parse::<f64>().is_ok_and(|version| version < FIRST_ROTATION_SWITCH) {
            settings.sections.iter_mut().for_each(Section::switch_rotation_on);
        }
        Some(settings)
    }

    /// The section of that name; an empty one where the file has none.
    pub fn section(&self, name: &str) -> Section {
        self.sections.iter().find(|section| section.name == name).cloned().unwrap_or_default()
    }
}

/// The version that the file says it was written by.
pub fn version(text: &str) -> &str {
    text.lines().find_map(|line| line.strip_prefix("# version ")).unwrap_or("2").trim()
}

impl Section {
    /// What the program does with files of the time when a kaleidoscopic IFS had no switch for its rotation.
    fn switch_rotation_on(&mut self) {
        let switch = "IFS_rotation_enabled";
        if let Some(rotation) = self.entries.iter().find(|entry| entry.name == "IFS_rotation")
            && !self.has(switch)
        {
            self.entries.push(Entry { name: switch.into(), value: "true".into(), span: rotation.span });
            // The file does not say it, so nobody needs to hear that it is not read.
            self.asked.borrow_mut().insert(switch.into());
        }
    }

    /// Whether the file gives a setting.
    pub fn has(&self, name: &str) -> bool {
        self.entries.iter().any(|entry| entry.name == name)
    }

    /// The text of a setting. It counts as read.
    pub fn raw(&self, name: &str) -> Option<&Entry> {
        self.asked.borrow_mut().insert(name.to_string());
        self.entries.iter().rev().find(|entry| entry.name == name)
    }

    /// Lines that nobody has asked for.
    pub fn unasked(&self) -> impl Iterator<Item = &Entry> {
        self.entries.iter().filter(|entry| !self.asked.borrow().contains(&entry.name))
    }
}

impl Ask for Section {
    fn ask(&self, name: &str, default: &Value, d: &mut Diagnostics) -> Value {
        let Some(entry) = self.raw(name) else { return default.clone() };
        Value::read_like(&entry.value, default).unwrap_or_else(|expected| {
            let message = format!("`{name}` needs {expected}, found `{}`", entry.value);
            d.push(Diagnostic::error(message).label(entry.span, format!("expected {expected}")));
            default.clone()
        })
    }
}

fn is_settings(text: &str) -> bool {
    text.lines().take_while(|line| line.starts_with('#')).any(|line| line.contains(TITLE))
        || text.lines().any(|line| line.trim() == "[main_parameters]")
}

/// Says why a text is no settings file.
fn not_settings(text: &str, sources: &Sources, id: SourceId) -> Diagnostic {
    let start = sources.span_at(id, 1, 1);
    if text.starts_with("Mandelbulber 1.") {
        return Diagnostic::error("these are settings of Mandelbulber 1, whose form is another one")
            .label(start, "only files of version 2 can be read")
            .help("open them in Mandelbulber 2 and save them again");
    }
    Diagnostic::error("this is not a settings file of Mandelbulber")
        .label(start, format!("such files start with `# {TITLE}`"))
        .help("save the settings in Mandelbulber with File > Save settings; pictures and queues cannot be imported")
}

/// Reads `name value;`, which starts at byte `start`.
fn entry(line: &str, id: SourceId, start: usize) -> Result<Entry, Diagnostic> {
    let end = start + line.len();
    let Some(body) = line.strip_suffix(';') else {
        return Err(Diagnostic::error("a setting does not end with `;`")
            .label(Span::new(id, end, end), "`;` is missing here")
            .help("each line is a name, a value and a semicolon"));
    };
    let (name, value) = body.split_once(char::is_whitespace).unwrap_or((body, ""));
    let value = value.trim();
    if value.is_empty() && !may_be_empty(name) {
        let message = format!("the setting `{name}` has no value");
        return Err(Diagnostic::error(message).label(Span::new(id, start + body.len(), end), "a value belongs here"));
    }
    let from = start + body.len() - body[name.len()..].trim_start().len();
    Ok(Entry { name: name.to_string(), value: value.to_string(), span: Span::new(id, from, from + value.len()) })
}

/// Texts may be empty: names of files, folders and materials, and descriptions.
fn may_be_empty(name: &str) -> bool {
    ["file", "texture", "dir", "path", "name", "description", "postfix", "map", "prefix", "text", "gradient", "palette"]
        .iter()
        .any(|part| name.contains(part))
}
