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
    /// Why it cannot be read; reported if it is needed.
    pub broken: Option<Box<Diagnostic>>,
}

/// Named values.
#[derive(Clone, Debug, Default)]
pub struct Preset {
    /// Name.
    pub name: String,
    /// Values.
    pub values: Vec<Given>,
    /// Lines that cannot be read; reported if the preset is chosen.
    pub broken: Vec<Diagnostic>,
}

/// What a shader says about itself.
#[derive(Clone, Debug, Default)]
pub struct Shader {
    /// Names of included files, in lower case.
    pub includes: Vec<String>,
    /// Uniforms of the shader with their defaults.
    pub uniforms: Vec<Given>,
    /// Types of uniforms, also of those without a default.
    pub types: Vec<(String, String)>,
    /// Lines of presets that are animations: an easing curve, as FragM writes it.
    pub animations: Vec<String>,
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
                let preset = Preset { name: name.trim().to_string(), ..Preset::default() };
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
                match preset_line(line, span) {
                    Some(Line::Value(given)) => preset.values.push(given),
                    Some(Line::Animation) => shader.animations.push(format!("{line} (preset {})", preset.name)),
                    Some(Line::Broken(diagnostic)) => preset.broken.push(diagnostic),
                    None => {}
                }
            } else if let Some(name) = line.strip_prefix("#include") {
                shader.includes.push(name.trim().trim_matches('"').to_lowercase());
            } else if let Some(rest) = line.strip_prefix("uniform") {
                let mut words = rest.split(|c: char| c.is_whitespace() || c == ';').filter(|word| !word.is_empty());
                if let (Some(kind), Some(name)) = (words.next(), words.next()) {
                    shader.types.push((name.to_string(), kind.to_string()));
                }
                shader.uniforms.extend(uniform(rest, line, id, start));
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
            (Some(preset), _) => {
                self.chosen = preset.values.clone();
                d.extend(preset.broken.iter().cloned());
            }
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
        self.peek(name)
    }

    /// The value of a uniform, which does not count as read.
    pub fn peek(&self, name: &str) -> Option<&Given> {
        let last = |list: &'_ [Given]| list.iter().rposition(|given| given.name == name);
        last(&self.chosen).map(|i| &self.chosen[i]).or_else(|| last(&self.uniforms).map(|i| &self.uniforms[i]))
    }

    /// Values of the preset that were not read, and uniforms that are not in it.
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
        if let Some(broken) = &given.broken {
            d.push((**broken).clone());
            return default.clone();
        }
        Value::read_like(&given.text.replace(',', " "), default).unwrap_or_else(|expected| {
            let message = format!("`{name}` needs {expected}, found `{}`", given.text);
            d.push(Diagnostic::error(message).label(given.span, format!("expected {expected}")));
            default.clone()
        })
    }
}

/// What a line of a preset says.
enum Line {
    Value(Given),
    Animation,
    Broken(Diagnostic),
}

/// `Name = value` of a preset, or `Name1:Curve:1:2:...`, an easing curve; comments and empty lines are nothing.
fn preset_line(line: &str, span: Span) -> Option<Line> {
    if line.is_empty() || line.starts_with("//") || line.starts_with('#') {
        return None;
    }
    let Some((name, value)) = line.split_once('=') else {
        let parts: Vec<&str> = line.split(':').collect();
        let is_curve =
            parts.len() >= 4 && parts[2..].iter().all(|part| part.trim().is_empty() || number(part.trim()).is_some());
        if is_curve {
            return Some(Line::Animation);
        }
        let diagnostic = Diagnostic::error("a line of a preset has no `=`").label(span, "write `Name = value`");
        return Some(Line::Broken(diagnostic));
    };
    let value = value.split("//").next().unwrap_or("").trim();
    let value = ["NotLocked", "NotLockable", "Locked", "AlwaysLocked"]
        .iter()
        .find_map(|word| value.strip_suffix(word))
        .unwrap_or(value)
        .trim();
    let name = name.trim().to_string();
    if value.is_empty() {
        let diagnostic =
            Diagnostic::error(format!("`{name}` has no value")).label(span, "a value belongs behind the `=`");
        return Some(Line::Broken(diagnostic));
    }
    Some(Line::Value(Given { name, text: value.to_string(), span, broken: None }))
}

/// `float Scale; slider[0,2,4]`: the type, the name and the default in the middle. Uniforms without a widget have no
/// default and are left out.
fn uniform(rest: &str, line: &str, id: SourceId, start: usize) -> Option<Given> {
    let (declaration, widget) = rest.split_once(';')?;
    let mut words = declaration.split_whitespace();
    let (kind, name) = (words.next()?, words.next()?);
    let widget = widget.trim();
    let open = widget.find('[')?;
    let inside_at = start + line.len() - widget.len() + open + 1;
    let place = |at: usize, length: usize| Span::new(id, inside_at + at, inside_at + at + length);
    let broken = |diagnostic: Diagnostic, span: Span| {
        let broken = Some(Box::new(diagnostic));
        Some(Given { name: name.to_string(), text: String::new(), span, broken })
    };
    let Some(length) = widget[open..].find(']').map(|end| end - 1) else {
        let message = format!("the widget of `{name}` does not end");
        return broken(Diagnostic::error(message).label(place(0, 0), "`]` is missing"), place(0, 0));
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
        Some(text) => Some(Given { name: name.to_string(), text, span: place(0, length), broken: None }),
        None => {
            let message = format!("the widget of `{name}` has no default value");
            let form = "expected least, default and greatest value, such as slider[0,2,4] or slider[(0,0),(1,1),(2,2)]";
            broken(Diagnostic::error(message).label(place(0, length), form), place(0, length))
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
