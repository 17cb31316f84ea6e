//! Step files: one map of the orbit state, its scalar rule, its description and its worked examples.

mod rules;

use std::rc::Rc;

use rhai::{AST, Dynamic, Map};

use super::decode::{Fields, FromValue, entries};
use super::script::{ScriptEngine, base_scope, to_value};
use super::shape::ShapeDistance;
use super::symbolic::{Symbol, to_dynamic};
use super::value::{Value, ValueKind};
use crate::diag::{Diagnostic, Diagnostics, SourceId, Sources, Span};
use crate::expr::{Arena, Expr, Type};

/// A step, read from its file.
pub struct Step {
    /// Name, same as the file's.
    pub name: String,
    /// Its text.
    pub text: SourceId,
    /// Heading that listings show it under.
    pub group: String,
    /// What it does, in one line.
    pub summary: String,
    /// Who found it, where that is known.
    pub inventor: String,
    /// When, where that is known.
    pub year: Option<u32>,
    /// Where it was published, and what this version changes.
    pub source: String,
    /// Trouble spots.
    pub notes: String,
    /// Components of the orbit state that it acts on.
    pub state: StateWidth,
    /// How r grows under it far out; `None` for isometries and folds.
    pub growth: Option<Growth>,
    /// What its scalar rule is worth; `None` where it states none.
    pub scalar_rule: Option<ScalarRule>,
    /// False where differentiating it makes no sense, so that finite differences must be used.
    pub differentiable: bool,
    /// Parameters in the order of the file.
    pub params: Vec<StepParam>,
    /// Of a shape what its distance is worth; `None` for maps.
    pub distance: Option<ShapeDistance>,
    /// Worked examples.
    pub examples: Vec<StepExample>,
    pub(super) ast: AST,
}

/// Components of the state that a step acts on.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum StateWidth {
    /// x, y and z; w is left alone.
    Three,
    /// Four.
    Four,
    /// Whatever the orbit has.
    Any,
    /// Three become four: how orbits of four components start.
    Embeds,
}

/// Growth of r far out.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Growth {
    /// By a constant factor.
    Linear,
    /// By a power.
    Power,
}

/// What a scalar rule is worth.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum ScalarRule {
    /// The true stretch, or a true bound of it.
    Exact,
    /// Can be exceeded.
    Heuristic,
}

/// A parameter of a step or of a fractal.
#[derive(Clone, Debug)]
pub struct StepParam {
    /// Name.
    pub name: String,
    /// Type.
    pub kind: ParamKind,
    /// Value where a node gives none.
    pub default: ParamValue,
    /// Least value of a number or component.
    pub min: f64,
    /// Greatest value.
    pub max: f64,
    /// Unit, as text.
    pub unit: String,
    /// What it does.
    pub help: String,
}

/// Type of a parameter.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum ParamKind {
    /// A number.
    Float,
    /// A whole number.
    Int,
    /// A truth value.
    Bool,
    /// Degrees in files, radians in scripts.
    Angle,
    /// Three numbers.
    Vec3,
    /// Three rows of three numbers.
    Mat3,
    /// One of these words.
    Choice(Vec<String>),
}

/// Value of a parameter, in the units of files.
#[derive(Clone, PartialEq, Debug)]
pub enum ParamValue {
    /// A number (also of an int or angle).
    Number(f64),
    /// A truth value.
    Bool(bool),
    /// Three numbers.
    Vector([f64; 3]),
    /// Rows.
    Matrix([[f64; 3]; 3]),
    /// A word.
    Word(String),
}

/// A worked example of a step: inputs and the outputs to expect.
#[derive(Clone, Debug)]
pub struct StepExample {
    /// State before; as many components as the step acts on.
    pub z: Vec<f64>,
    /// Constant that the step may read.
    pub c: Option<Vec<f64>>,
    /// Parameters that differ from the defaults.
    pub params: Vec<(String, ParamValue)>,
    /// State after.
    pub expect: Vec<f64>,
    /// Running derivative before and after.
    pub dr: Option<(f64, f64)>,
    /// Absolute tolerance near 0, relative elsewhere, in f64.
    pub tolerance: f64,
}

/// What a traced step made of the state.
pub struct Traced<'g> {
    /// State after.
    pub z: Expr<'g>,
    /// Running derivative after, where one went in and the step has a rule.
    pub dr: Option<Expr<'g>>,
}

impl Step {
    /// Reads a step file whose text is already in `sources`.
    pub fn read(
        engine: &ScriptEngine,
        sources: &Sources,
        text: SourceId,
        name: &str,
        diagnostics: &mut Diagnostics,
    ) -> Option<Step> {
        let result = engine.compile(sources, text).and_then(|ast| {
            engine.tracer.start(&Rc::new(Arena::default()), sources, text);
            let description = engine.run(sources, text, &ast, &mut base_scope())?;
            Ok((ast, description))
        });
        let (ast, description) = match result {
            Ok(parts) => parts,
            Err(error) => {
                diagnostics.push(error);
                return None;
            }
        };
        let start = sources.text(text).rfind("\n#{").map_or(0, |at| at + 1);
        let place = |field: Option<&str>| description_span(sources, text, start, field);
        let description = to_value(&description, &place);
        decode_step(name, text, ast, &description, diagnostics)
    }

    /// The parameter of this name.
    pub fn param(&self, name: &str) -> Option<&StepParam> {
        self.params.iter().find(|p| p.name == name)
    }

    /// Traces the step: `z` has the state's width (3 or 4), `dr` is followed where the step has a rule.
    /// `params` are script values for every parameter (see [`script_value`]).
    pub fn trace<'g>(
        &self,
        engine: &ScriptEngine,
        sources: &Sources,
        arena: &'g Rc<Arena>,
        inputs: StepInputs<'g>,
        params: &Map,
    ) -> Result<Traced<'g>, Diagnostic> {
        engine.tracer.start(arena, sources, self.text);
        let full = inputs.z;
        let narrow = self.state == StateWidth::Three && full.ty().width == 4;
        let embeds = self.state == StateWidth::Embeds;
        let (z, c) = if narrow || embeds { (full.xyz(), inputs.c.xyz()) } else { (full, inputs.c) };
        let script = |e: Expr<'g>| Dynamic::from(Symbol::new(arena, e));
        let args = vec![script(z), script(c), Dynamic::from(params.clone())];
        let result = engine.call(sources, self.text, &self.ast, "step", args)?;
        let image = if embeds { Type::V4 } else { z.ty() };
        let mut after = self.returned(sources, arena, &result, image, "step")?;
        if narrow {
            let parts = after.components();
            after = arena.compose(&[parts[0], parts[1], parts[2], full.component(3)]);
        }
        let dr = match (inputs.dr, self.scalar_rule) {
            (Some(dr), Some(_)) => {
                let args = vec![script(z), script(dr), Dynamic::from(params.clone())];
                let result = engine.call(sources, self.text, &self.ast, "derivative", args)?;
                Some(self.returned(sources, arena, &result, Type::F, "derivative")?)
            }
            _ => None,
        };
        // What is built after the step is not the step's.
        arena.set_span(Span::NONE);
        Ok(Traced { z: after, dr })
    }

    /// True where the step file has a function of this name and number of arguments.
    pub fn has_function(&self, name: &str, arguments: usize) -> bool {
        self.ast.iter_functions().any(|f| f.name == name && f.params.len() == arguments)
    }

    pub(super) fn returned<'g>(
        &self,
        sources: &Sources,
        arena: &'g Rc<Arena>,
        value: &Dynamic,
        expected: Type,
        function: &str,
    ) -> Result<Expr<'g>, Diagnostic> {
        let found = match (value.read_lock::<Symbol>(), value.as_float(), value.as_int()) {
            (Some(symbol), _, _) if symbol.expr().ty() == expected => return Ok(arena.expr(symbol.expr().id)),
            (None, Ok(x), _) if expected == Type::F => return Ok(arena.f(x)),
            (None, _, Ok(x)) if expected == Type::F => return Ok(arena.f(x as f64)),
            (Some(symbol), _, _) => symbol.expr().ty().to_string(),
            _ => value.type_name().to_string(),
        };
        let at = sources.text(self.text).find(&format!("fn {function}")).unwrap_or(0);
        Err(Diagnostic::error(format!("`{function}` must return a {expected}, but returns a {found}"))
            .label(Span::new(self.text, at, at + 3 + function.len()), format!("in step `{}`", self.name))
            .help("the last expression of a function, without a semicolon, is what it returns"))
    }
}

/// What goes into a step while it is traced.
#[derive(Clone, Copy)]
pub struct StepInputs<'g> {
    /// Orbit state.
    pub z: Expr<'g>,
    /// Constant, of the state's width.
    pub c: Expr<'g>,
    /// Running derivative, where it is followed.
    pub dr: Option<Expr<'g>>,
}

/// A parameter's value as its step's script sees it: radians, rows as vectors.
pub fn script_value(arena: &Rc<Arena>, kind: &ParamKind, value: &ParamValue) -> Dynamic {
    let vector = |v: &[f64; 3]| Dynamic::from(Symbol::new(arena, arena.v3(*v)));
    match value {
        ParamValue::Number(x) if *kind == ParamKind::Angle => Dynamic::from_float(x.to_radians()),
        ParamValue::Number(x) if *kind == ParamKind::Int => Dynamic::from_int(*x as i64),
        ParamValue::Number(x) => Dynamic::from_float(*x),
        ParamValue::Bool(b) => Dynamic::from_bool(*b),
        ParamValue::Vector(v) => vector(v),
        ParamValue::Matrix(rows) => Dynamic::from_array(rows.iter().map(vector).collect()),
        ParamValue::Word(word) => Dynamic::from(word.clone()),
    }
}

/// A symbolic parameter as its step's script sees it.
pub fn script_expr(arena: &Rc<Arena>, kind: &ParamKind, value: Expr<'_>) -> Dynamic {
    let value = if *kind == ParamKind::Angle { value * (std::f64::consts::PI / 180.0) } else { value };
    to_dynamic(arena, value)
}

/// Place of a field of the description that starts there: its first mention, else the start.
fn description_span(sources: &Sources, id: SourceId, start: usize, field: Option<&str>) -> Span {
    let text = sources.text(id);
    let found = field.and_then(|f| text[start..].find(&format!("{f}:")).map(|at| (start + at, f.len())));
    let (at, len) = found.unwrap_or((start, 2.min(text.len() - start)));
    Span::new(id, at, at + len)
}

fn decode_step(name: &str, text: SourceId, ast: AST, description: &Value, d: &mut Diagnostics) -> Option<Step> {
    let errors = d.error_count();
    let mut fields = Fields::new(description, "a step's description", d)?;
    let group = fields.required::<String>("group", d).unwrap_or_default();
    let summary = fields.required::<String>("summary", d).unwrap_or_default();
    let inventor = fields.or("inventor", String::new(), d);
    let year = fields.optional::<u32>("year", d);
    let source = fields.required::<String>("source", d).unwrap_or_default();
    let notes = fields.or("notes", String::new(), d);
    let state = fields.or("state", StateWidth::Three, d);
    let growth = fields.optional::<Growth>("growth", d);
    let scalar_rule = fields.optional::<ScalarRule>("scalar_rule", d);
    let differentiable = fields.or("differentiable", true, d);
    let distance = fields.optional::<ShapeDistance>("distance", d);
    let params: Vec<StepParam> = fields.or("params", Vec::new(), d);
    let example_values: Vec<Value> = fields.or("examples", Vec::new(), d);
    fields.finish(d);
    let examples =
        example_values.iter().filter_map(|v| decode_example(v, &params, (state, distance.is_some()), d)).collect();
    match distance {
        Some(_) => super::shape::check_shape(&ast, description.span, scalar_rule.is_some(), d),
        None => check_functions(&ast, description.span, scalar_rule.is_some(), d),
    }
    (d.error_count() == errors).then(|| Step {
        name: name.to_string(),
        text,
        group,
        summary,
        inventor,
        year,
        source,
        notes,
        state,
        growth,
        scalar_rule,
        differentiable,
        params,
        distance,
        examples,
        ast,
    })
}

fn check_functions(ast: &AST, span: Span, has_rule: bool, d: &mut Diagnostics) {
    let has = |name: &str| ast.iter_functions().any(|f| f.name == name && f.params.len() == 3);
    if !has("step") && super::shape::has_distance(ast) {
        let message = "there is a `fn distance(z, p)`, but `distance` does not say what it is worth";
        d.push(Diagnostic::error(message).label(span, "").help("`distance` is \"exact\" or \"bound\""));
    } else if !has("step") {
        d.push(Diagnostic::error("the file has no `fn step(z, c, p)`").label(span, "described here"));
    }
    if has("derivative") != has_rule {
        let message = if has_rule {
            "`scalar_rule` is given, but there is no `fn derivative(z, dr, p)`"
        } else {
            "there is a `fn derivative(z, dr, p)`, but `scalar_rule` does not say what it is worth"
        };
        d.push(Diagnostic::error(message).label(span, "").help("`scalar_rule` is \"exact\" or \"heuristic\""));
    }
}

fn decode_example(
    value: &Value,
    params: &[StepParam],
    (state, is_shape): (StateWidth, bool),
    d: &mut Diagnostics,
) -> Option<StepExample> {
    let mut fields = Fields::new(value, "an example", d)?;
    let z = fields.required::<Vec<f64>>("z", d);
    let c = fields.optional::<Vec<f64>>("c", d);
    let expect = match is_shape {
        true => fields.required::<f64>("expect", d).map(|distance| vec![distance]),
        false => fields.required::<Vec<f64>>("expect", d),
    };
    let dr = fields.optional::<f64>("dr", d);
    let expect_dr = fields.optional::<f64>("expect_dr", d);
    let tolerance = fields.or("tolerance", 1e-6, d);
    let given = fields.optional_value("params");
    fields.finish(d);
    let mut values = Vec::new();
    for (name, value) in given.map(|v| entries(v, "parameters", d)).unwrap_or_default() {
        match params.iter().find(|p| p.name == name.text) {
            Some(param) => values.extend(decode_param(param, value, d).map(|v| (name.text.clone(), v))),
            None => d.push(unknown_param(&name.text, name.span, params)),
        }
    }
    let (z, expect) = (z?, expect?);
    let fits = match state {
        StateWidth::Embeds => z.len() == 3 && expect.len() == 4,
        _ => (3..=4).contains(&z.len()) && (is_shape || z.len() == expect.len()),
    };
    if !fits {
        d.push(Diagnostic::error("`z` and `expect` need three or four components each").label(value.span, ""));
        return None;
    }
    Some(StepExample { z, c, params: values, expect, dr: dr.zip(expect_dr), tolerance })
}

/// The message for a parameter that a step does not have.
pub fn unknown_param(name: &str, span: Span, params: &[StepParam]) -> Diagnostic {
    let names: Vec<&str> = params.iter().map(|p| p.name.as_str()).collect();
    let diagnostic =
        Diagnostic::error(format!("unknown parameter `{name}`")).label(span, "").did_you_mean(name, names.clone());
    match (diagnostic.help.is_empty(), names.is_empty()) {
        (true, false) => diagnostic.help(format!("its parameters are: {}", names.join(", "))),
        (true, true) => diagnostic.help("it has no parameters"),
        _ => diagnostic,
    }
}

/// Reads a plain value for a parameter and checks its range.
pub fn decode_param(param: &StepParam, value: &Value, d: &mut Diagnostics) -> Option<ParamValue> {
    let in_range = |x: f64, d: &mut Diagnostics| {
        super::decode::check_range(x, param.min, param.max, &format!("`{}`", param.name), value.span, d)
    };
    match &param.kind {
        ParamKind::Bool => bool::from_value(value, d).map(ParamValue::Bool),
        ParamKind::Float | ParamKind::Angle => {
            let x = f64::from_value(value, d)?;
            in_range(x, d).then_some(ParamValue::Number(x))
        }
        ParamKind::Int => {
            let x = f64::from_value(value, d)?;
            if x.fract() != 0.0 {
                let message = format!("`{}` must be a whole number", param.name);
                d.push(Diagnostic::error(message).label(value.span, format!("found {x}")));
                return None;
            }
            in_range(x, d).then_some(ParamValue::Number(x))
        }
        ParamKind::Vec3 => {
            let v = <[f64; 3]>::from_value(value, d)?;
            v.iter().all(|&x| in_range(x, d)).then_some(ParamValue::Vector(v))
        }
        ParamKind::Mat3 => {
            let rows = Vec::<[f64; 3]>::from_value(value, d)?;
            let Ok(matrix) = <[[f64; 3]; 3]>::try_from(rows) else {
                d.push(Diagnostic::error(format!("`{}` needs three rows", param.name)).label(value.span, ""));
                return None;
            };
            matrix.iter().flatten().all(|&x| in_range(x, d)).then_some(ParamValue::Matrix(matrix))
        }
        ParamKind::Choice(words) => {
            let word = match &value.kind {
                ValueKind::Variant(name) => name.text.clone(),
                _ => String::from_value(value, d)?,
            };
            if !words.contains(&word) {
                let message = format!("`{word}` is not a value of `{}`", param.name);
                d.push(
                    Diagnostic::error(message)
                        .label(value.span, "")
                        .help(format!("its values are: {}", words.join(", "))),
                );
                return None;
            }
            Some(ParamValue::Word(word))
        }
    }
}

impl FromValue for StepParam {
    const EXPECTED: &'static str = "a parameter's description";

    fn from_value(value: &Value, d: &mut Diagnostics) -> Option<StepParam> {
        let mut fields = Fields::new(value, "a parameter's description", d)?;
        let name = fields.required::<String>("name", d);
        let kind = fields.or("type", "float".to_string(), d);
        let choices = fields.or("choices", Vec::<String>::new(), d);
        let default = fields.optional_value("default");
        let min = fields.or("min", -1e6, d);
        let max = fields.or("max", 1e6, d);
        let unit = fields.or("unit", String::new(), d);
        let help = fields.required::<String>("help", d);
        fields.finish(d);
        let kind = match kind.as_str() {
            "float" => ParamKind::Float,
            "int" => ParamKind::Int,
            "bool" => ParamKind::Bool,
            "angle" => ParamKind::Angle,
            "vec3" => ParamKind::Vec3,
            "mat3" => ParamKind::Mat3,
            "choice" => ParamKind::Choice(choices),
            other => {
                d.push(
                    Diagnostic::error(format!("unknown parameter type \"{other}\""))
                        .label(value.span, "")
                        .help("types are: float, int, bool, angle, vec3, mat3, choice"),
                );
                return None;
            }
        };
        let mut param = StepParam { name: name?, kind, default: ParamValue::Bool(false), min, max, unit, help: help? };
        let Some(default) = default else {
            d.push(Diagnostic::error(format!("parameter `{}` has no default", param.name)).label(value.span, ""));
            return None;
        };
        param.default = decode_param(&param, default, d)?;
        Some(param)
    }
}

macro_rules! words {
    ($type:ty, $expected:literal, $($pattern:pat => $value:expr),+) => {
        impl FromValue for $type {
            const EXPECTED: &'static str = $expected;
            fn from_value(value: &Value, d: &mut Diagnostics) -> Option<Self> {
                let word = match &value.kind {
                    ValueKind::Str(text) => text.clone(),
                    ValueKind::Number(x) => x.to_string(),
                    _ => String::new(),
                };
                match word.as_str() {
                    $($pattern => Some($value),)+
                    _ => {
                        d.push(Diagnostic::error(format!("expected {}, found {}", $expected, value.describe()))
                            .label(value.span, ""));
                        None
                    }
                }
            }
        }
    };
}

words!(StateWidth, "3, 4, \"any\" or \"3 to 4\"", "3" => StateWidth::Three, "4" => StateWidth::Four,
    "any" => StateWidth::Any, "3 to 4" => StateWidth::Embeds);
words!(ShapeDistance, "\"exact\" or \"bound\"", "exact" => ShapeDistance::Exact, "bound" => ShapeDistance::Bound);
words!(Growth, "\"linear\" or \"power\"", "linear" => Growth::Linear, "power" => Growth::Power);
words!(ScalarRule, "\"exact\" or \"heuristic\"", "exact" => ScalarRule::Exact, "heuristic" => ScalarRule::Heuristic);
