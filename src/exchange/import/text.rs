//! The text of a graph file, put together from parts that are texts already.

use super::value::{written, written_vector};
use crate::graph::Camera;

/// The parts of a graph file.
#[derive(Clone, Debug, Default)]
pub struct GraphText {
    /// Comment lines above everything.
    pub comment: Vec<String>,
    /// One line about it.
    pub summary: String,
    /// Where it comes from.
    pub source: String,
    /// Parameters: name, value and what it does.
    pub params: Vec<(String, f64, String)>,
    /// Nodes: name and text.
    pub nodes: Vec<(String, String)>,
    /// The node that is drawn.
    pub output: String,
    /// Settings of the file, as `name: value`.
    pub settings: Vec<String>,
    /// Where to look from.
    pub camera: Option<Camera>,
    /// Light and colour, as `name: value`.
    pub look: Vec<String>,
}

impl GraphText {
    /// The whole text.
    pub fn write(&self) -> String {
        let mut text = String::new();
        let mut line = |line: String| {
            text.push_str(&line);
            text.push('\n');
        };
        self.comment.iter().for_each(|comment| line(format!("// {comment}")));
        line("(".into());
        line(format!("    summary: {:?},", self.summary));
        line(format!("    source: {:?},", self.source));
        if !self.params.is_empty() {
            line("    params: {".into());
            for (name, value, help) in &self.params {
                line(format!("        \"{name}\": (default: {}, help: {help:?}),", written(*value)));
            }
            line("    },".into());
        }
        line("    nodes: {".into());
        self.nodes.iter().for_each(|(name, node)| line(format!("        \"{name}\": {node},")));
        line("    },".into());
        line(format!("    output: \"{}\",", self.output));
        self.settings.iter().for_each(|setting| line(format!("    {setting},")));
        if let Some(camera) = &self.camera {
            line("    camera: (".into());
            line(format!("        position: {},", written_vector(&camera.position)));
            line(format!("        target: {},", written_vector(&camera.target)));
            line(format!("        up: {},", written_vector(&camera.up)));
            line(format!("        fov: {},", written(camera.fov.to_degrees())));
            line("    ),".into());
        }
        if !self.look.is_empty() {
            line("    look: (".into());
            self.look.iter().for_each(|setting| line(format!("        {setting},")));
            line("    ),".into());
        }
        line(")".into());
        text
    }
}

/// Nodes of one iteration as one node.
pub fn sequence(steps: &[String]) -> String {
    match steps {
        // Nothing at all is a shift by nothing.
        [] => "translate()".into(),
        [step] if !step.contains("), ") => step.clone(),
        _ => format!("Sequence([{}])", steps.join(", ")),
    }
}

/// A name of a file or formula as a name of a node or file: letters, digits and `_`.
pub fn as_name(text: &str) -> String {
    let mut name = String::new();
    for c in text.chars().flat_map(char::to_lowercase) {
        match c.is_ascii_alphanumeric() {
            true => name.push(c),
            false if !name.is_empty() && !name.ends_with('_') => name.push('_'),
            false => {}
        }
    }
    let name = name.trim_end_matches('_');
    match name.starts_with(|c: char| c.is_ascii_digit()) || name.is_empty() {
        true => format!("formula_{name}").trim_end_matches('_').to_string(),
        false => name.to_string(),
    }
}
