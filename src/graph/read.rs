//! From a file's value tree to a [`ValidGraph`], reporting everything that is wrong with it.

mod constant;
mod estimate;

use std::collections::HashMap;
use std::sync::Arc;

use rhai::Scope;

use super::objects::{Imports, field};
use super::overrides::{Override, patched};
use super::presets::read_presets;
use super::scene::{has_orbits, read_scene};
use super::settings::{EndShape, IterationLimit, NO_ESCAPE, OrbitSettings};
use super::tests_of_formula::read_test;
use super::validate::{ValidGraph, validate};
use super::{FractalParam, Graph, Node, NodeKind, NodeRef};
use crate::colour::Panorama;
use crate::diag::{Diagnostic, Diagnostics, Severity, Span};
use crate::formula::decode::{Fields, FromValue, check_range, entries};
use crate::formula::library::Library;
use crate::formula::script::{BadExpression, base_scope, is_reserved};
use crate::formula::value::{Name, Value, ValueKind};

/// Nodes that a graph may have.
const MAX_GRAPH_NODES: usize = 1000;

/// Reads a graph, and checks each of its presets by reading it with that. `name` stands in where the file gives none.
pub fn read(
    library: &Library,
    value: &Value,
    name: &str,
    (overrides, imports): (&[Override], &Imports),
    d: &mut Diagnostics,
) -> Option<ValidGraph> {
    let graph = read_once(library, value, name, (overrides, imports), d)?;
    let errors = d.error_count();
    let mut try_with = |changes: &[Override], what: &str| {
        let mut own = Diagnostics::default();
        read_once(library, value, name, (changes, imports), &mut own);
        for error in own.iter().filter(|diagnostic| diagnostic.severity == Severity::Error) {
            d.push(error.clone().help(format!("this is with {what}")));
        }
        own.has_errors()
    };
    for preset in &graph.presets {
        try_with(&preset.changes, &format!("the preset `{}`", preset.name));
    }
    let ends = graph.scene.motion.iter().flat_map(|motion| motion.ends()).filter(|ends| !ends.is_empty());
    for ends in ends {
        // What is wrong with both ends is told once.
        if try_with(&ends, "the values of the animation's tracks") {
            break;
        }
    }
    (d.error_count() == errors).then_some(graph)
}

/// Reads a graph with some of its values changed.
fn read_once(
    library: &Library,
    value: &Value,
    name: &str,
    (overrides, imports): (&[Override], &Imports),
    d: &mut Diagnostics,
) -> Option<ValidGraph> {
    let errors = d.error_count();
    let (patched, params) = patched(value, overrides, d);
    let (params_read, nodes, inline) = (Vec::new(), Vec::new(), Vec::new());
    let panorama = imports.panorama.clone();
    let has_look = field(value, "look").or_else(|| field(field(value, "scene")?, "look")).is_some();
    let mut reader = Reader {
        library,
        d,
        params: params_read,
        nodes,
        names: HashMap::new(),
        inline,
        four: None,
        panorama,
        has_look,
    };
    let graph = reader.graph(&patched, name, &params, imports)?;
    let d = reader.d;
    if d.error_count() > errors {
        return None;
    }
    validate(library, graph, d)
}

/// The state of reading one file.
pub(super) struct Reader<'a> {
    /// Steps that may be used.
    pub library: &'a Library,
    /// Where messages go.
    pub d: &'a mut Diagnostics,
    /// The fractal's parameters, known before the first node is read.
    pub params: Vec<FractalParam>,
    pub(super) nodes: Vec<Option<Node>>,
    names: HashMap<String, usize>,
    inline: Vec<String>,
    /// Where a value of four components was read, until what holds it takes this.
    pub(super) four: Option<Span>,
    /// The picture that surrounds everything, where it was read.
    pub(super) panorama: Option<Arc<Panorama>>,
    /// Whether the file itself has a look: what changes a part of it leaves the rest as the file has it.
    pub(super) has_look: bool,
}

impl Reader<'_> {
    fn graph(
        &mut self,
        value: &Value,
        name: &str,
        params: &HashMap<String, Value>,
        imports: &Imports,
    ) -> Option<Graph> {
        let mut fields = Fields::new(value, "a fractal", self.d)?;
        let title = fields.or("name", name.to_string(), self.d);
        let summary = fields.or("summary", String::new(), self.d);
        let group = fields.or("group", String::new(), self.d);
        let inventor = fields.or("inventor", String::new(), self.d);
        let year = fields.optional::<u32>("year", self.d);
        let source = fields.or("source", String::new(), self.d);
        let given = fields.optional_value("params");
        let given = given.map(|v| entries(v, "parameters", self.d)).unwrap_or_default();
        self.params = given.into_iter().filter_map(|(name, value)| self.param(&name, value, params)).collect();
        let nodes = fields.optional_value("nodes");
        let nodes = nodes.map(|v| entries(v, "nodes", self.d)).unwrap_or_default();
        let objects = fields.optional_value("objects");
        let objects = objects.map(|v| entries(v, "objects", self.d)).unwrap_or_default();
        self.declare(&nodes);
        self.declare_objects(&objects);
        for (i, (name, value)) in nodes.iter().enumerate() {
            self.inline.push(name.text.clone());
            let kind = self.node_kind(value);
            self.inline.pop();
            let span = value.span;
            self.nodes[i] = kind.map(|kind| Node { name: name.text.clone(), span, kind });
        }
        let has_objects = !objects.is_empty();
        let objects = self.read_objects(nodes.len(), &objects, imports);
        let output = match fields.optional_value("output") {
            Some(value) => self.wire(value),
            None if !objects.shown.is_empty() => {
                Some(self.added("objects", fields.span(), NodeKind::Union(objects.shown.clone())))
            }
            // What is wrong with each of them has been told.
            None if has_objects => None,
            None => self.default_output(&nodes, fields.span()),
        };
        let has_orbits = output.is_some_and(|output| has_orbits(&self.nodes, output));
        let output = self.clipped(output, &mut fields);
        let orbit = self.orbit_settings(&mut fields, &OrbitSettings::default());
        let bounding_radius = fields.optional_value("bounding_radius").and_then(|v| self.number(v, 1e-6, 1e6));
        let cuts = fields.or("cuts", false, self.d);
        let mut scene = read_scene(self, &mut fields, has_orbits);
        scene.take_objects(objects);
        let presets = fields.optional_value("presets").map(|v| read_presets(v, self.d)).unwrap_or_default();
        let test_values: Vec<Value> = fields.or("tests", Vec::new(), self.d);
        let tests = test_values.iter().filter_map(|v| read_test(self, v)).collect();
        fields.finish(self.d);
        let nodes: Option<Vec<Node>> = std::mem::take(&mut self.nodes).into_iter().collect();
        Some(Graph {
            name: title,
            summary,
            group,
            inventor,
            year,
            source,
            params: std::mem::take(&mut self.params),
            nodes: nodes?,
            output: output?,
            orbit,
            bounding_radius,
            cuts,
            scene,
            presets,
            tests,
        })
    }

    fn declare(&mut self, nodes: &[(Name, &Value)]) {
        for (i, (name, _)) in nodes.iter().enumerate() {
            self.names.insert(name.text.clone(), i);
            self.nodes.push(None);
        }
        if nodes.len() > MAX_GRAPH_NODES {
            self.d.push(Diagnostic::error(format!(
                "a graph may have {MAX_GRAPH_NODES} nodes, this one has {}",
                nodes.len()
            )));
        }
    }

    /// Makes the name of one more node known.
    pub(super) fn declare_one(&mut self, name: &Name) {
        let number = self.nodes.len();
        if self.names.insert(name.text.clone(), number).is_some() {
            let message = format!("there are two nodes called `{}`", name.text);
            self.d.push(Diagnostic::error(message).label(name.span, "").help("objects and nodes share their names"));
        }
        self.nodes.push(None);
    }

    /// Fills the place of a node that was declared.
    pub(super) fn fill(&mut self, number: usize, node: Node) {
        self.nodes[number] = Some(node);
    }

    /// Nodes so far.
    pub(super) fn count(&self) -> usize {
        self.nodes.len()
    }

    /// Adds a node.
    pub(super) fn add(&mut self, node: Node) -> NodeRef {
        self.nodes.push(Some(node));
        NodeRef(self.nodes.len() - 1)
    }

    /// Begins and ends what inline nodes are named for.
    pub(super) fn enter(&mut self, name: &str) {
        self.inline.push(name.to_string());
    }

    /// See [`Reader::enter`].
    pub(super) fn leave(&mut self) {
        self.inline.pop();
    }

    /// The only node, where a file leaves out `output`.
    fn default_output(&mut self, nodes: &[(Name, &Value)], span: Span) -> Option<NodeRef> {
        if nodes.len() == 1 {
            return Some(NodeRef(0));
        }
        let names: Vec<&str> = nodes.iter().map(|(n, _)| n.text.as_str()).collect();
        let help = match names.is_empty() {
            true => "add `nodes: { \"fold\": box_fold() }` and `output: \"fold\"`".to_string(),
            false => format!("add `output: \"...\"`, one of: {}", names.join(", ")),
        };
        self.d.push(
            Diagnostic::error("the file does not say which node is drawn")
                .label(span, "`output` is missing")
                .help(help),
        );
        None
    }

    fn param(&mut self, name: &Name, value: &Value, overrides: &HashMap<String, Value>) -> Option<FractalParam> {
        if is_reserved(&name.text) {
            let message = format!("a parameter cannot be called `{}`", name.text);
            let label = match name.text.as_str() {
                "n" => "in expressions `n` is the number of the iteration",
                _ => "a reserved word of expressions",
            };
            self.d.push(Diagnostic::error(message).label(name.span, label).help("choose another name"));
        }
        let mut fields = Fields::new(value, "a parameter", self.d)?;
        let default = fields.required::<f64>("default", self.d);
        let min = fields.or("min", -1e6, self.d);
        let max = fields.or("max", 1e6, self.d);
        let unit = fields.or("unit", String::new(), self.d);
        let help = fields.or("help", String::new(), self.d);
        fields.finish(self.d);
        let default = default?;
        check_range(default, min, max, &format!("`{}`", name.text), value.span, self.d);
        let given = overrides.get(&name.text).and_then(|change| {
            let given = f64::from_value(change, self.d)?;
            check_range(given, min, max, &format!("`{}`", name.text), change.span, self.d).then_some(given)
        });
        // After an error the default stands in, so that nothing else goes wrong for the same reason.
        let given = given.unwrap_or(default);
        Some(FractalParam { name: name.text.clone(), value: given, default, min, max, unit, help })
    }

    /// Resolves a wire: a node's name, or a node written in place.
    pub(super) fn wire(&mut self, value: &Value) -> Option<NodeRef> {
        if let ValueKind::Str(name) = &value.kind {
            if let Some(&i) = self.names.get(name) {
                return Some(NodeRef(i));
            }
            let names: Vec<&str> = self.names.keys().map(String::as_str).collect();
            let mut diagnostic = Diagnostic::error(format!("there is no node `{name}`"))
                .label(value.span, "not a node of this graph")
                .did_you_mean(name, names.iter().copied());
            if diagnostic.help.is_empty() {
                let mut names = names;
                names.sort_unstable();
                diagnostic = diagnostic.help(format!("the nodes are: {}", names.join(", ")));
            }
            self.d.push(diagnostic);
            return None;
        }
        if self.nodes.len() >= MAX_GRAPH_NODES {
            self.d.push(Diagnostic::error(format!("a graph may have {MAX_GRAPH_NODES} nodes")).label(value.span, ""));
            return None;
        }
        let i = self.nodes.len();
        self.nodes.push(None);
        let owner = self.inline.join("/");
        self.inline.push(format!("{}", i));
        let kind = self.node_kind(value);
        self.inline.pop();
        let name = format!("{owner}/{}", i);
        self.nodes[i] = kind.map(|kind| Node { name, span: value.span, kind });
        Some(NodeRef(i))
    }

    /// Resolves a list of wires; at least one.
    pub(super) fn wires(&mut self, value: &Value) -> Option<Vec<NodeRef>> {
        let ValueKind::List(items) = &value.kind else {
            crate::formula::decode::wrong_type(value, "a list of nodes such as [\"fold\", \"scale\"]", self.d);
            return None;
        };
        if items.is_empty() {
            self.d.push(Diagnostic::error("the list of nodes is empty").label(value.span, "name at least one node"));
            return None;
        }
        let wires: Vec<Option<NodeRef>> = items.iter().map(|item| self.wire(item)).collect();
        wires.into_iter().collect()
    }

    /// A wire that must be there.
    pub(super) fn required_wire(&mut self, fields: &mut Fields, name: &'static str) -> Option<NodeRef> {
        match fields.optional_value(name) {
            Some(value) => self.wire(value),
            None => {
                let message = format!("the field `{name}` is missing");
                let label = "it names the node to take";
                self.d.push(Diagnostic::error(message).label(fields.span(), label));
                None
            }
        }
    }

    /// The variables of parameter expressions.
    pub(super) fn scope(&self) -> Scope<'static> {
        let mut scope = base_scope();
        for param in &self.params {
            scope.push_constant(param.name.clone(), param.value);
        }
        scope
    }

    /// A number, or an expression of the fractal's parameters that gives one.
    pub(super) fn number(&mut self, value: &Value, min: f64, max: f64) -> Option<f64> {
        let number = match &value.kind {
            ValueKind::Str(text) => {
                let known = self.library.engine.expression(text, &mut self.scope());
                match known.map(|v| v.as_float().or(v.as_int().map(|i| i as f64))) {
                    Ok(Ok(x)) if x.is_finite() => x,
                    Ok(_) => {
                        self.d.push(
                            Diagnostic::error("the expression does not give a finite number").label(value.span, ""),
                        );
                        return None;
                    }
                    Err(error) => {
                        self.bad_expression(error, value.span);
                        return None;
                    }
                }
            }
            _ => f64::from_value(value, self.d)?,
        };
        check_range(number, min, max, "the value", value.span, self.d).then_some(number)
    }

    pub(super) fn bad_expression(&mut self, error: BadExpression, span: Span) {
        let mut diagnostic = Diagnostic::error(error.message).label(span, "in this expression");
        diagnostic.help = error.help;
        if let Some(name) = &error.variable {
            diagnostic = Diagnostic::error(format!("unknown parameter `{name}`"))
                .label(span, "in this expression")
                .did_you_mean(name, self.params.iter().map(|p| p.name.as_str()));
            if diagnostic.help.is_empty() {
                let names: Vec<&str> = self.params.iter().map(|p| p.name.as_str()).collect();
                diagnostic = diagnostic.help(match names.is_empty() {
                    true => format!("declare it: `params: {{ \"{name}\": (default: 1.0) }}`"),
                    false => format!("the fractal's parameters are: {}", names.join(", ")),
                });
            }
        }
        self.d.push(diagnostic);
    }

    /// Three numbers, each a number or an expression.
    pub(super) fn vector(&mut self, value: &Value, min: f64, max: f64) -> Option<[f64; 3]> {
        match &value.kind {
            ValueKind::List(items) | ValueKind::Tuple { name: None, items } if items.len() == 3 => {
                let parts: Vec<Option<f64>> = items.iter().map(|item| self.number(item, min, max)).collect();
                Some([parts[0]?, parts[1]?, parts[2]?])
            }
            _ => <[f64; 3]>::from_value(value, self.d),
        }
    }

    /// A direction: three numbers that are not all 0, made to length 1.
    pub(super) fn direction(&mut self, value: &Value) -> Option<[f64; 3]> {
        let v = self.vector(value, -1e6, 1e6)?;
        let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
        if length == 0.0 {
            self.d.push(Diagnostic::error("a direction cannot be (0, 0, 0)").label(value.span, ""));
            return None;
        }
        Some(v.map(|x| x / length))
    }

    /// The orbit's settings among `fields`; `base` holds for those that are not given.
    pub(super) fn orbit_settings(&mut self, fields: &mut Fields, base: &OrbitSettings) -> OrbitSettings {
        let mut settings = base.clone();
        let outer = self.four.take();
        if let Some(value) = fields.optional_value("constant") {
            settings.constant = self.constant(value).unwrap_or(settings.constant);
        }
        for (name, list) in [("pre", &mut settings.pre), ("post", &mut settings.post)] {
            if let Some(value) = fields.optional_value(name) {
                *list = self.wires(value).unwrap_or_default();
            }
        }
        if let Some(value) = fields.optional_value("start") {
            settings.start = self.point(value);
        }
        let escapes = self.escape(fields, &mut settings);
        if let Some(value) = fields.optional_value("max_iterations") {
            let limit = self.number(value, 0.0, 10_000.0);
            settings.max_iterations = limit.map_or(settings.max_iterations, |n| n as u32);
            settings.limit = IterationLimit::Stated;
        }
        if let Some(value) = fields.optional_value("slice") {
            settings.slice = self.number(value, -1e6, 1e6).unwrap_or(settings.slice);
        }
        if let Some(value) = fields.optional_value("end") {
            settings.shape = self.wire(value).map(|field| EndShape { field, levels: None });
            settings.escape_radius = if escapes { settings.escape_radius } else { NO_ESCAPE };
        }
        if let Some(value) = fields.optional_value("estimate") {
            settings.estimate = self.estimate(value).unwrap_or_default();
        }
        settings.four = self.four.take().or(settings.four);
        self.four = outer;
        settings
    }

    /// One of several words, in quotes or not, in any case.
    pub(super) fn word<T: Copy>(&mut self, value: &Value, what: &str, words: &[(&str, T)]) -> Option<T> {
        let text = match &value.kind {
            ValueKind::Str(text) => text.clone(),
            ValueKind::Variant(name) => name.text.clone(),
            _ => String::new(),
        };
        // Words without quotes cannot hold a hyphen.
        let hyphened = text.replace('_', "-");
        if let Some((_, result)) = words.iter().find(|(word, _)| word.eq_ignore_ascii_case(&hyphened)) {
            return Some(*result);
        }
        let list: Vec<&str> = words.iter().map(|(word, _)| *word).collect();
        let message = format!("`{text}` is not a {what}");
        self.d
            .push(Diagnostic::error(message).label(value.span, "").help(format!("choose one of: {}", list.join(", "))));
        None
    }

    pub(super) fn unknown_node(&mut self, name: &Name) {
        let mut candidates: Vec<&str> = super::nodes::KEYWORDS.to_vec();
        candidates.extend(self.library.names());
        let mut diagnostic = Diagnostic::error(format!("unknown step or node kind `{}`", name.text))
            .label(name.span, "not found")
            .did_you_mean(&name.text, candidates);
        if diagnostic.help.is_empty() {
            diagnostic =
                diagnostic.help("`bulbfold list` shows all steps; a step of your own is one file, see --steps");
        }
        self.d.push(diagnostic);
    }
}

pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// A node kind that the reader may return.
pub(super) type Kind = Option<NodeKind>;
