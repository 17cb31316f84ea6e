//! The text form of Mandelbulber's settings: sections in brackets, and `name value;` a line.

use std::cell::RefCell;
use std::collections::HashSet;

use super::ask::Ask;
use super::value::Value;
use crate::diag::{Diagnostic, Diagnostics, SourceId, Sources, Span};

/// First words of a settings file.
const TITLE: &str = "Mandelbulber settings file";

/// Most settings of a section; the program has some 1,500.
const MAX_ENTRIES: usize = 50_000;

/// One line.
#[derive(Clone, Debug)]
pub struct Entry {
    /// The setting's name.
    pub name: String,
    /// What stands behind it, up to the semicolon.
    pub value: String,
    /// What stands between the first semicolon and the last: a script that gives the value frame by frame.
    pub script: String,
    /// Place of the value.
    pub span: Span,
    /// Why the line cannot be read; reported if the setting is needed.
    pub broken: Option<Box<Diagnostic>>,
}

/// The lines between two headings.
#[derive(Clone, Debug, Default)]
pub struct Section {
    /// The heading, without brackets.
    pub name: String,
    /// Its lines.
    pub entries: Vec<Entry>,
    asked: RefCell<HashSet<String>>,
    told: RefCell<HashSet<String>>,
}

/// A settings file.
#[derive(Clone, Debug)]
pub struct Settings {
    /// All sections that hold settings.
    pub sections: Vec<Section>,
    /// Headings of those that hold something else, such as frames of an animation.
    pub others: Vec<String>,
    /// The version that the file says it was written by.
    pub version: Version,
}

/// A version of the program.
#[derive(Clone, PartialEq, Debug)]
pub struct Version {
    /// As the file states it; empty if it does not.
    pub text: String,
    /// As a number, such as 2.35; 0 if the file states none, as the program takes it.
    pub number: f64,
    /// Its place.
    pub span: Span,
}

impl Version {
    /// Whether the file is older than a version.
    pub fn before(&self, number: f64) -> bool {
        self.number < number
    }
}

impl Settings {
    /// Reads a file. Errors: each is pushed, with its place.
    pub fn read(sources: &Sources, id: SourceId, d: &mut Diagnostics) -> Option<Settings> {
        let text = sources.text(id);
        if !is_settings(text) {
            d.push(not_settings(text, sources, id));
            return None;
        }
        let mut settings = Settings { sections: Vec::new(), others: Vec::new(), version: version(text, sources, id) };
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
            if section.entries.len() >= MAX_ENTRIES {
                let message = format!("a section has more than {MAX_ENTRIES} settings");
                d.push(Diagnostic::error(message).label(Span::new(id, start, start + 1), "one of them too many"));
                return None;
            }
            section.entries.push(entry(line, id, start + indent));
        }
        Some(settings)
    }

    /// The section of that name; an empty one where the file has none.
    pub fn section(&self, name: &str) -> Section {
        self.sections.iter().find(|section| section.name == name).cloned().unwrap_or_default()
    }

    /// The section of that name; a new one where the file has none.
    pub fn section_mut(&mut self, name: &str) -> &mut Section {
        let at = self.sections.iter().position(|section| section.name == name).unwrap_or_else(|| {
            self.sections.push(Section { name: name.to_string(), ..Section::default() });
            self.sections.len() - 1
        });
        &mut self.sections[at]
    }
}

fn version(text: &str, sources: &Sources, id: SourceId) -> Version {
    let head = text.lines().enumerate().take_while(|(_, line)| !line.starts_with('[')).take(100);
    for (row, line) in head {
        if let Some(stated) = line.trim().strip_prefix('#').and_then(|rest| rest.trim().strip_prefix("version")) {
            let stated = stated.trim();
            let digits = stated.find(|c: char| !(c.is_ascii_digit() || c == '.')).map_or(stated, |end| &stated[..end]);
            let start = sources.span_at(id, row + 1, 1);
            let span = Span::new(id, start.start as usize, start.start as usize + line.len());
            return Version { text: stated.to_string(), number: digits.parse().unwrap_or(0.0), span };
        }
    }
    Version { text: String::new(), number: 0.0, span: sources.span_at(id, 1, 1) }
}

impl Section {
    /// Whether the file gives a setting.
    pub fn has(&self, name: &str) -> bool {
        self.entries.iter().any(|entry| entry.name == name)
    }

    /// The text of a setting. It counts as read.
    pub fn raw(&self, name: &str) -> Option<&Entry> {
        self.asked.borrow_mut().insert(name.to_string());
        self.entries.iter().rev().find(|entry| entry.name == name)
    }

    /// Adds a setting that follows from others, unless the file gives it. It is not listed where nothing reads it.
    pub fn imply(&mut self, name: &str, value: &str, span: Span) {
        if !self.has(name) {
            let (name, value) = (name.to_string(), value.to_string());
            self.asked.borrow_mut().insert(name.clone());
            self.entries.push(Entry { name, value, script: String::new(), span, broken: None });
        }
    }

    /// Names of settings that something has asked for and that a script gives, with their entries.
    pub fn scripted(&self) -> impl Iterator<Item = &Entry> {
        self.entries.iter().filter(|entry| !entry.script.is_empty() && self.asked.borrow().contains(&entry.name))
    }

    /// Says once why a line cannot be read.
    fn tell(&self, entry: &Entry, d: &mut Diagnostics) -> bool {
        let Some(broken) = &entry.broken else { return false };
        if self.told.borrow_mut().insert(entry.name.clone()) {
            d.push((**broken).clone());
        }
        true
    }

    /// Lines that were not read.
    pub fn unasked(&self) -> impl Iterator<Item = &Entry> {
        self.entries.iter().filter(|entry| !self.asked.borrow().contains(&entry.name))
    }
}

impl Ask for Section {
    fn ask(&self, name: &str, default: &Value, d: &mut Diagnostics) -> Value {
        let Some(entry) = self.raw(name) else { return default.clone() };
        if self.tell(entry, d) {
            return default.clone();
        }
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
        return Diagnostic::error("these are settings of Mandelbulber 1, which have another form")
            .label(start, "only files of version 2 can be read")
            .help("open them in Mandelbulber 2 and save them again");
    }
    Diagnostic::error("this is not a settings file of Mandelbulber")
        .label(start, format!("such files start with `# {TITLE}`"))
        .help("save the settings in Mandelbulber with File > Save settings; pictures and queues cannot be imported")
}

/// Reads `name value;` or `name value;script;`, which starts at byte `start`.
fn entry(line: &str, id: SourceId, start: usize) -> Entry {
    let end = start + line.len();
    let body = line.split(';').next().unwrap_or("");
    let (name, value) = body.split_once(char::is_whitespace).unwrap_or((body, ""));
    let value = value.trim();
    let from = start + body.len() - body[name.len()..].trim_start().len();
    let span = Span::new(id, from, from + value.len());
    let script = line[body.len()..].trim_matches(';').trim().to_string();
    let broken = if body.len() == line.len() {
        Some(
            Diagnostic::error("a setting does not end with `;`")
                .label(Span::new(id, end, end), "`;` is missing here")
                .help("each line is a name, a value and a semicolon"),
        )
    } else if value.is_empty() && !may_be_empty(name) {
        let message = format!("the setting `{name}` has no value");
        Some(Diagnostic::error(message).label(Span::new(id, start + body.len(), end), "a value belongs here"))
    } else {
        None
    };
    Entry { name: name.to_string(), value: value.to_string(), script, span, broken: broken.map(Box::new) }
}

/// Texts may be empty: names of files, folders and materials, and descriptions.
fn may_be_empty(name: &str) -> bool {
    ["file", "texture", "dir", "path", "name", "description", "postfix", "map", "prefix", "text", "gradient", "palette"]
        .iter()
        .any(|part| name.contains(part))
}
