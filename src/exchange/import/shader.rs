//! Fragmentarium's additions to GLSL: uniforms with sliders, presets and includes.

use std::cell::RefCell;
use std::collections::HashSet;

use super::ask::Ask;
use super::value::{Value, number};
use crate::diag::{Diagnostic, Diagnostics, SourceId, Sources, Span};

/// A value with its place.
#[derive(Clone, Debug)]
pub struct Given {
    /// Name of the uniform.
    pub name: String,
    /// Its value, numbers with commas between them.
    pub text: String,
    /// Place of the value.
    pub span: Span,
}

/// Named values.
#[derive(Clone, Debug)]
pub struct Preset {
    /// Name.
    pub name: String,
    /// Values.
    pub values: Vec<Given>,
}

/// What a shader says about itself.
#[derive(Clone, Debug, Default)]
pub struct Shader {
    /// Names of included files, in lower case.
    pub includes: Vec<String>,
    /// Uniforms of the shader with their defaults.
    pub uniforms: Vec<Given>,
    /// Presets.
    pub presets: Vec<Preset>,
    /// Values of the chosen preset.
    pub chosen: Vec<Given>,
    asked: RefCell<HashSet<String>>,
}

impl Shader {
    /// Reads a shader. Errors: each is pushed, with its place.
    pub fn read(sources: &Sources, id: SourceId, d: &mut Diagnostics) -> Shader {
        let mut shader = Shader::default();
        let mut open: Option<(Preset, Span)> = None;
        let mut at = 0;
        for raw in sources.text(id).split_inclusive('\n') {
            let start = at + raw.len() - raw.trim_start().len();
            at += raw.len();
            let line = raw.trim();
            let span = Span::new(id, start, start + line.len());
            if let Some(name) = line.strip_prefix("#preset") {
                let preset = Preset { name: name.trim().to_string(), values: Vec::new() };
                if let Some((unfinished, _)) = open.replace((preset, span)) {
                    shader.presets.push(unfinished);
                }
            } else if line.to_lowercase().starts_with("#endpreset") {
                match open.take() {
                    Some((preset, _)) => shader.presets.push(preset),
                    None => d.push(
                        Diagnostic::error("a preset ends that has not begun").label(span, "no `#preset` is open"),
                    ),
                }
            } else if let Some((preset, _)) = &mut open {
                preset.values.extend(preset_line(line, span, d));
            } else if let Some(name) = line.strip_prefix("#include") {
                shader.includes.push(name.trim().trim_matches('"').to_lowercase());
            } else if let Some(rest) = line.strip_prefix("uniform") {
                shader.uniforms.extend(uniform(rest, line, id, start, d));
            }
        }
        if let Some((preset, span)) = open {
            let message = format!("the preset `{}` does not end", preset.name);
            d.push(Diagnostic::error(message).label(span, "`#endpreset` is missing"));
        }
        shader
    }

    /// Takes the values of a preset: the named one, else the one called default, else the first.
    pub fn choose(&mut self, name: Option<&str>, d: &mut Diagnostics) {
        let named = |wanted: &str| self.presets.iter().find(|preset| preset.name.eq_ignore_ascii_case(wanted));
        let found = match name {
            Some(name) => named(name),
            None => named("default").or(self.presets.first()),
        };
        match (found, name) {
            (Some(preset), _) => self.chosen = preset.values.clone(),
            (None, Some(name)) => {
                let names: Vec<&str> = self.presets.iter().map(|preset| preset.name.as_str()).collect();
                let mut diagnostic = Diagnostic::error(format!("the file has no preset `{name}`"));
                diagnostic = diagnostic.did_you_mean(name, names.iter().copied());
                d.push(match names.is_empty() {
                    true => diagnostic.help("it has no presets at all: leave --preset out"),
                    false => diagnostic.help(format!("its presets are: {}", names.join(", "))),
                });
            }
            (None, None) => {}
        }
    }

    /// The value of a uniform: the preset's, else the slider's default. It counts as read.
    pub fn given(&self, name: &str) -> Option<&Given> {
        self.asked.borrow_mut().insert(name.to_string());
        let last = |list: &'_ [Given]| list.iter().rposition(|given| given.name == name);
        last(&self.chosen).map(|i| &self.chosen[i]).or_else(|| last(&self.uniforms).map(|i| &self.uniforms[i]))
    }

    /// Values of the preset that nobody has asked for, and uniforms that are not in it.
    pub fn unasked(&self) -> Vec<&Given> {
        let is_left = |given: &&Given| !self.asked.borrow().contains(&given.name);
        let in_preset = |given: &&Given| self.chosen.iter().any(|other| other.name == given.name);
        self.chosen
            .iter()
            .filter(is_left)
            .chain(self.uniforms.iter().filter(is_left).filter(|u| !in_preset(u)))
            .collect()
    }
}

impl Ask for Shader {
    fn ask(&self, name: &str, default: &Value, d: &mut Diagnostics) -> Value {
        let Some(given) = self.given(name) else { return default.clone() };
        Value::read_like(&given.text.replace(',', " "), default).unwrap_or_else(|expected| {
            let message = format!("`{name}` needs {expected}, found `{}`", given.text);
            d.push(Diagnostic::error(message).label(given.span, format!("expected {expected}")));
            default.clone()
        })
    }
}

/// `Name = value` of a preset; comments and empty lines are nothing.
fn preset_line(line: &str, span: Span, d: &mut Diagnostics) -> Option<Given> {
    if line.is_empty() || line.starts_with("//") {
        return None;
    }
    let Some((name, value)) = line.split_once('=') else {
        d.push(Diagnostic::error("a line of a preset has no `=`").label(span, "write `Name = value`"));
        return None;
    };
    let value = value.split("//").next().unwrap_or("").trim();
    let value = value.strip_suffix("Locked").or_else(|| value.strip_suffix("NotLocked")).unwrap_or(value).trim();
    if value.is_empty() {
        d.push(
            Diagnostic::error(format!("`{}` has no value", name.trim())).label(span, "a value belongs behind the `=`"),
        );
        return None;
    }
    Some(Given { name: name.trim().to_string(), text: value.to_string(), span })
}

/// `float Scale; slider[0,2,4]`: the type, the name and the default in the middle. Uniforms without a widget have no
/// default and are left out.
fn uniform(rest: &str, line: &str, id: SourceId, start: usize, d: &mut Diagnostics) -> Option<Given> {
    let (declaration, widget) = rest.split_once(';')?;
    let mut words = declaration.split_whitespace();
    let (kind, name) = (words.next()?, words.next()?);
    let widget = widget.trim();
    let open = widget.find('[')?;
    let inside_at = start + line.len() - widget.len() + open + 1;
    let place = |at: usize, length: usize| Span::new(id, inside_at + at, inside_at + at + length);
    let Some(length) = widget[open..].find(']').map(|end| end - 1) else {
        d.push(Diagnostic::error(format!("the widget of `{name}` does not end")).label(place(0, 0), "`]` is missing"));
        return None;
    };
    let inside = &widget[open + 1..open + 1 + length];
    let text = match &widget[..open] {
        "slider" | "logslider" => slider(inside).map(str::to_string),
        "checkbox" => Some(inside.trim().to_string()),
        "color" | "floatcolor" => Some(inside.trim().to_string()),
        _ => return None,
    };
    let is_number = |text: &str| kind == "bool" || text.split(',').all(|part| number(part.trim()).is_some());
    match text.filter(|text| is_number(text)) {
        Some(text) => Some(Given { name: name.to_string(), text, span: place(0, length) }),
        None => {
            let message = format!("the widget of `{name}` has no default value");
            let form = "expected least, default and greatest value, such as slider[0,2,4] or slider[(0,0),(1,1),(2,2)]";
            d.push(Diagnostic::error(message).label(place(0, length), form));
            None
        }
    }
}

/// The middle of `least,default,greatest`; vectors stand in brackets.
fn slider(inside: &str) -> Option<&str> {
    if !inside.contains('(') {
        let parts: Vec<&str> = inside.split(',').collect();
        return (parts.len() == 3).then(|| parts[1].trim());
    }
    let vectors: Vec<&str> = inside.split('(').skip(1).filter_map(|part| part.split(')').next()).collect();
    (vectors.len() == 3).then(|| vectors[1].trim())
}
