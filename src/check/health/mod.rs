//! What is wrong in a formula, found by sampling: `bulbfold check`.
//!
//! In comes a formula ([`check_formula`]) or one step ([`check_step`]); out comes a [`Health`]: what was measured, and
//! [`Finding`]s, each with its place and what to do. Measured are, for every step with the parameters it has in the
//! formula: continuity (with the point where it jumps), its scalar rule against the true stretch, its growth; for every
//! orbit: the form of its estimate against the growth of r, the declared radius of the attractor and of the bounding
//! sphere against members of the set, and the iteration limit against a pixel's footprint.
//!
//! Sampling finds what is common: a clean report is no proof.

mod continuity;
mod detail;
mod extent;
mod rule;

use std::fmt;

pub use self::rule::check_step;

use super::subject::Subject;
use crate::diag::{Diagnostic, Sources, Span};
use crate::formula::library::Library;
use crate::formula::step::{ParamValue, Step};
use crate::graph::{NodeKind, ParamInput, ValidGraph};
use crate::shade::Size;

/// How bad a finding is.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub enum Severity {
    /// Worth knowing.
    Note,
    /// Costs time or detail, or is a known weakness.
    Warning,
    /// Estimates or pictures are wrong because of it.
    Wrong,
}

impl Severity {
    /// The word for it.
    pub fn name(self) -> &'static str {
        match self {
            Severity::Note => "note",
            Severity::Warning => "warning",
            Severity::Wrong => "wrong",
        }
    }
}

/// What a finding is about.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Kind {
    /// A step jumps.
    Jump,
    /// A step stretches without bound.
    Stretch,
    /// A step gives something that is not a number.
    NotANumber,
    /// A scalar rule and the true stretch.
    Rule,
    /// The growth that a step declares.
    Growth,
    /// The form of an estimate.
    Form,
    /// The radius of the linear form.
    Radius,
    /// The bounding sphere.
    Bounds,
    /// The iteration limit.
    Iterations,
    /// What a file says about itself.
    Description,
}

impl Kind {
    /// The name in listings and JSON.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Jump => "jump",
            Kind::Stretch => "stretch",
            Kind::NotANumber => "not_a_number",
            Kind::Rule => "rule",
            Kind::Growth => "growth",
            Kind::Form => "form",
            Kind::Radius => "radius",
            Kind::Bounds => "bounds",
            Kind::Iterations => "iterations",
            Kind::Description => "description",
        }
    }
}

/// Something found, with what to do.
#[derive(Clone, Debug)]
pub struct Finding {
    /// How bad.
    pub severity: Severity,
    /// What about.
    pub kind: Kind,
    /// The step or node.
    pub subject: String,
    /// What is wrong, in one sentence without a full stop.
    pub message: String,
    /// What to do.
    pub help: String,
    /// The place in a file, as far as there is one.
    pub span: Span,
    /// The state (formula units) or point (world units) where it shows most.
    pub point: Option<Vec<f64>>,
}

impl Finding {
    /// The finding as a message with its source line: an error where it is wrong, else a warning.
    pub fn diagnostic(&self) -> Diagnostic {
        let diagnostic = match self.severity {
            Severity::Wrong => Diagnostic::error(&self.message),
            _ => Diagnostic::warning(&self.message),
        };
        diagnostic.label(self.span, "").help(&self.help)
    }

    /// `file:line` of the place.
    pub fn place(&self, sources: &Sources) -> Option<String> {
        let (line, _) = sources.line_col(self.span)?;
        Some(format!("{}:{line}", sources.name(self.span.source)))
    }
}

/// One thing that was measured.
#[derive(Clone, PartialEq, Debug)]
pub struct Measure {
    /// The step, node or whole that it was measured of.
    pub subject: String,
    /// What was measured.
    pub what: &'static str,
    /// The result, as text with its unit.
    pub value: String,
}

/// A formula's report.
#[derive(Clone, Debug, Default)]
pub struct Health {
    /// What was measured, in order.
    pub measures: Vec<Measure>,
    /// What was found, in order.
    pub findings: Vec<Finding>,
}

impl Health {
    /// Findings that make estimates or pictures wrong.
    pub fn wrong(&self) -> impl Iterator<Item = &Finding> {
        self.findings.iter().filter(|f| f.severity == Severity::Wrong)
    }

    fn measure(&mut self, subject: &str, what: &'static str, value: impl fmt::Display) {
        self.measures.push(Measure { subject: subject.to_string(), what, value: value.to_string() });
    }
}

/// Checks everything about a formula. `size` is that of the picture whose pixels decide about the iteration limit;
/// `progress` hears the share that is done. Fails only where a step's script does.
pub fn check_formula(subject: &Subject, size: Size, progress: &mut dyn FnMut(f64)) -> Result<Health, Diagnostic> {
    let mut health = Health::default();
    let steps = steps_in_use(subject.library, subject.graph);
    let count = steps.len() as f64 + 3.0;
    for (i, (name, step, params)) in steps.iter().enumerate() {
        rule::check_node(subject.library, step, name, params, &mut health)?;
        progress((i + 1) as f64 / count);
    }
    extent::check_forms(subject, &mut health)?;
    extent::check_radius(subject, &mut health)?;
    progress((count - 2.0) / count);
    extent::check_bounds(subject, &mut health)?;
    progress((count - 1.0) / count);
    detail::check_iterations(subject, size, &mut health)?;
    progress(1.0);
    health.findings.sort_by_key(|finding| std::cmp::Reverse(finding.severity));
    Ok(health)
}

/// Checks the steps of a formula alone. Fails only where a step's script does.
pub fn check_steps(subject: &Subject) -> Result<Health, Diagnostic> {
    let mut health = Health::default();
    for (name, step, params) in steps_in_use(subject.library, subject.graph) {
        rule::check_node(subject.library, step, &name, &params, &mut health)?;
    }
    Ok(health)
}

/// Parameters by name.
type Params = Vec<(String, ParamValue)>;

/// The step and shape nodes of a graph, each kind of step once for every set of parameters, named for their first node. Parameters
/// that change with the iteration number have their first value.
fn steps_in_use<'a>(library: &Library, graph: &'a ValidGraph) -> Vec<(String, &'a Step, Params)> {
    let mut found: Vec<(String, &Step, Params)> = Vec::new();
    for node in &graph.nodes {
        let (NodeKind::Step { step, params } | NodeKind::Shape { step, params }) = &node.kind else { continue };
        let values = step.params.iter().zip(params).map(|(param, input)| {
            let value = match input {
                ParamInput::Known(value) => value.clone(),
                ParamInput::OfIteration(text) => first_value(library, graph, text).unwrap_or(param.default.clone()),
            };
            (param.name.clone(), value)
        });
        let values: Params = values.collect();
        if !found.iter().any(|(_, known, given)| known.name == step.name && *given == values) {
            found.push((node.name.clone(), step, values));
        }
    }
    found
}

fn first_value(library: &Library, graph: &ValidGraph, text: &str) -> Option<ParamValue> {
    let mut scope = crate::formula::script::base_scope();
    for param in &graph.params {
        scope.push_constant(param.name.clone(), param.value);
    }
    scope.push_constant("n", 0.0);
    let value = library.engine.expression(text, &mut scope).ok()?;
    value.as_float().ok().or_else(|| value.as_int().ok().map(|i| i as f64)).map(ParamValue::Number)
}

/// A vector with four digits a component.
fn shown(v: &[f64]) -> String {
    let parts: Vec<String> = v.iter().map(|x| number(*x)).collect();
    format!("({})", parts.join(", "))
}

/// A number with four digits.
fn number(x: f64) -> String {
    match x.abs() {
        0.0 => "0".into(),
        size if !(1e-3..1e5).contains(&size) => format!("{x:.2e}"),
        size => {
            let digits = (3 - size.log10().floor() as i32).clamp(0, 6) as usize;
            let text = format!("{x:.digits$}");
            if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_string() } else { text }
        }
    }
}

/// Unit vectors spread evenly over the sphere (Fibonacci lattice), turned by `turn`.
fn spread(count: usize, turn: f64) -> Vec<[f64; 3]> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let direction = |i: usize| {
        let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
        let ring = (1.0 - z * z).sqrt();
        let angle = golden * i as f64 + turn;
        [ring * angle.cos(), ring * angle.sin(), z]
    };
    (0..count).map(direction).collect()
}
