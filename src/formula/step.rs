//! Step files: one map of the orbit state, its scalar rule, its description and its worked examples.

mod read;
mod rules;

pub use read::{decode_param, unknown_param};

use std::sync::Arc;

use rhai::{AST, Dynamic, Map};

use super::script::{Places, ScriptEngine, Spot, base_scope, returned_span, to_value, type_name};
use super::shape::ShapeDistance;
use super::symbolic::{Symbol, to_dynamic};
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
    /// What its scalar rule is worth; `None` if it states none.
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
    /// Three numbers, or four for orbits of four components: scripts see as many as z has.
    Point,
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
    /// Four numbers, of a parameter that may have three.
    Point([f64; 4]),
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
    /// What a step that remembers had before; 0 if it is not given.
    pub before: Option<Vec<f64>>,
    /// Parameters that differ from the defaults.
    pub params: Vec<(String, ParamValue)>,
    /// State after.
    pub expect: Vec<f64>,
    /// Running derivative before and after.
    pub dr: Option<(f64, f64)>,
    /// Running derivative of what a step that remembers had before.
    pub before_dr: f64,
    /// Absolute tolerance near 0, relative elsewhere, in f64.
    pub tolerance: f64,
}

/// What a traced step made of the state.
#[derive(Clone, Copy)]
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
            engine.trace(&Arc::new(Arena::default()), sources, text);
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
        let places = Places::of(&ast);
        let description = to_value(&description, &Spot::Own { place: places.result(), sources, text });
        read::decode_step(name, text, ast, &description, diagnostics)
    }

    /// Everything that a step's text names and that means nothing; `step` is what could be read of it.
    pub(super) fn unknown_names(
        engine: &ScriptEngine,
        sources: &Sources,
        text: SourceId,
        step: Option<&Step>,
    ) -> Vec<Diagnostic> {
        let Ok(ast) = engine.compile(sources, text) else { return Vec::new() };
        let params: Option<Vec<&str>> = step.map(|step| step.params.iter().map(|p| p.name.as_str()).collect());
        engine.unknown_names((sources, text), &ast, (&[], &[]), params.as_deref())
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
        arena: &'g Arc<Arena>,
        inputs: StepInputs<'g>,
        params: &Map,
    ) -> Result<Traced<'g>, Diagnostic> {
        engine.trace(arena, sources, self.text);
        let full = inputs.z;
        let narrow = self.state == StateWidth::Three && full.ty().width == 4;
        let embeds = self.state == StateWidth::Embeds;
        let (z, c) = if narrow || embeds { (full.xyz(), inputs.c.xyz()) } else { (full, inputs.c) };
        let script = |e: Expr<'g>| Dynamic::from(Symbol::new(e));
        let params = &self.as_wide(arena, params, z.ty().width);
        let mut args = vec![script(z), script(c), Dynamic::from(params.clone())];
        let before = inputs.before.map_or(z.lift(0.0), |before| if narrow { before.z.xyz() } else { before.z });
        if self.remembers() {
            args.push(script(before));
        }
        let result = engine.call(sources, self.text, &self.ast, "step", args)?;
        let image = if embeds { Type::V4 } else { z.ty() };
        let mut after = self.returned(sources, arena, &result, image, "step")?;
        if narrow {
            let parts = after.components();
            after = arena.compose(&[parts[0], parts[1], parts[2], full.component(3)]);
        }
        let dr = match (inputs.dr, self.scalar_rule) {
            (Some(dr), Some(_)) => {
                let mut args = vec![script(z), script(dr), Dynamic::from(params.clone())];
                if self.remembers() {
                    let before_dr = inputs.before.and_then(|before| before.dr).unwrap_or_else(|| arena.f(0.0));
                    args.extend([script(before), script(before_dr)]);
                }
                let result = engine.call(sources, self.text, &self.ast, "derivative", args)?;
                Some(self.returned(sources, arena, &result, Type::F, "derivative")?)
            }
            _ => None,
        };
        // What is built after the step is not the step's.
        arena.set_span(Span::NONE);
        Ok(Traced { z: after, dr })
    }

    /// The parameters with points of as many components as the state that the step acts on has.
    fn as_wide(&self, arena: &Arc<Arena>, params: &Map, width: u8) -> Map {
        let mut params = params.clone();
        for param in self.params.iter().filter(|param| param.kind == ParamKind::Point && width == 3) {
            if let Some(value) = params.get_mut(param.name.as_str()) {
                let wide = value.read_lock::<Symbol>().and_then(|symbol| symbol.expr(arena));
                if let Some(wide) = wide.filter(|wide| wide.ty() == Type::V4) {
                    *value = Dynamic::from(Symbol::new(wide.xyz()));
                }
            }
        }
        params
    }

    /// Whether the step reads what state it had the last time that it ran: its function has a fourth argument.
    pub fn remembers(&self) -> bool {
        self.has_function("step", REMEMBERING.0)
    }

    /// True if the step file has a function of this name and number of arguments.
    pub fn has_function(&self, name: &str, arguments: usize) -> bool {
        self.ast.iter_functions().any(|f| f.name == name && f.params.len() == arguments)
    }

    pub(super) fn returned<'g>(
        &self,
        sources: &Sources,
        arena: &'g Arc<Arena>,
        value: &Dynamic,
        expected: Type,
        function: &str,
    ) -> Result<Expr<'g>, Diagnostic> {
        let found = match (value.read_lock::<Symbol>(), value.as_float(), value.as_int()) {
            (Some(symbol), _, _) => match symbol.expr_of(arena, expected) {
                Some(expr) => return Ok(expr),
                None => symbol.type_name(arena),
            },
            (None, Ok(x), _) if expected == Type::F => return Ok(arena.f(x)),
            (None, _, Ok(x)) if expected == Type::F => return Ok(arena.f(x as f64)),
            _ => type_name(value.type_name()),
        };
        let found = if found == "nothing" { found } else { format!("a {found}") };
        let message = format!("`{function}` must return a {expected}, but returns {found}");
        let span = returned_span(sources, self.text, &self.ast, function);
        Err(Diagnostic::error(message)
            .label(span, format!("in step `{}`", self.name))
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
    /// State and running derivative that went in the last time, for steps that remember them; 0 if there is none.
    pub before: Option<Traced<'g>>,
}

impl<'g> StepInputs<'g> {
    /// Inputs of a step that runs for the first time.
    pub fn first(z: Expr<'g>, c: Expr<'g>, dr: Option<Expr<'g>>) -> StepInputs<'g> {
        StepInputs { z, c, dr, before: None }
    }
}

/// Arguments of `fn step(z, c, p, before)` and `fn derivative(z, dr, p, before, before_dr)`.
const REMEMBERING: (usize, usize) = (4, 5);

/// A parameter's value as its step's script sees it: radians, rows as vectors.
pub fn script_value(arena: &Arena, kind: &ParamKind, value: &ParamValue) -> Dynamic {
    let vector = |v: &[f64; 3]| Dynamic::from(Symbol::new(arena.v3(*v)));
    let point = |v: [f64; 4]| Dynamic::from(Symbol::new(arena.constant(Type::V4, v)));
    match value {
        ParamValue::Number(x) if *kind == ParamKind::Angle => Dynamic::from_float(x.to_radians()),
        ParamValue::Number(x) if *kind == ParamKind::Int => Dynamic::from_int(*x as i64),
        ParamValue::Number(x) => Dynamic::from_float(*x),
        ParamValue::Bool(b) => Dynamic::from_bool(*b),
        ParamValue::Vector([x, y, z]) if *kind == ParamKind::Point => point([*x, *y, *z, 0.0]),
        ParamValue::Vector(v) => vector(v),
        ParamValue::Point(v) => point(*v),
        ParamValue::Matrix(rows) => Dynamic::from_array(rows.iter().map(vector).collect()),
        ParamValue::Word(word) => Dynamic::from(word.clone()),
    }
}

/// A symbolic parameter as its step's script sees it.
pub fn script_expr(kind: &ParamKind, value: Expr<'_>) -> Dynamic {
    let value = if *kind == ParamKind::Angle { value * (std::f64::consts::PI / 180.0) } else { value };
    to_dynamic(value)
}
