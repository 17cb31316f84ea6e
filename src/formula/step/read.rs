//! Reading step files: their descriptions, examples and parameters, with the range of each value checked.

use rhai::AST;

use super::{Growth, ParamKind, ParamValue, REMEMBERING, ScalarRule, StateWidth, Step, StepExample, StepParam};
use crate::diag::{Diagnostic, Diagnostics, SourceId, Span};
use crate::formula::decode::{Fields, FromValue, check_range, entries};
use crate::formula::script::{is_reserved, reserved};
use crate::formula::shape::{ShapeDistance, check_shape, has_distance};
use crate::formula::value::{Value, ValueKind};

pub(super) fn decode_step(
    name: &str,
    text: SourceId,
    ast: AST,
    description: &Value,
    d: &mut Diagnostics,
) -> Option<Step> {
    let errors = d.error_count();
    let mut fields = Fields::new(description, "a step's description", d)?;
    let group = fields.or("group", "own".to_string(), d);
    let summary = fields.or("summary", String::new(), d);
    let inventor = fields.or("inventor", String::new(), d);
    let year = fields.optional::<u32>("year", d);
    let source = fields.or("source", String::new(), d);
    let notes = fields.or("notes", String::new(), d);
    let state = fields.or("state", StateWidth::Three, d);
    let growth = fields.optional::<Growth>("growth", d);
    let scalar_rule = fields.optional::<ScalarRule>("scalar_rule", d);
    let differentiable = fields.or("differentiable", true, d);
    let distance = fields.optional::<ShapeDistance>("distance", d);
    let params: Vec<StepParam> = fields.or("params", Vec::new(), d);
    let example_values: Vec<Value> = fields.or("examples", Vec::new(), d);
    fields.finish(d);
    let examples: Vec<StepExample> =
        example_values.iter().filter_map(|v| decode_example(v, &params, (state, distance.is_some()), d)).collect();
    let remembers = ast.iter_functions().any(|f| f.name == "step" && f.params.len() == REMEMBERING.0);
    if !remembers && examples.iter().any(|e| e.before.is_some() || e.before_dr != 0.0) {
        let message = "an example gives `before`, but the step does not remember";
        let help = "a step that remembers has `fn step(z, c, p, before)`";
        d.push(Diagnostic::error(message).label(description.span, "").help(help));
    }
    match distance {
        Some(_) => check_shape(&ast, description.span, scalar_rule.is_some(), d),
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
    let has =
        |name: &str, arguments: usize| ast.iter_functions().any(|f| f.name == name && f.params.len() == arguments);
    let (plain, remembers) = (has("step", 3), has("step", REMEMBERING.0));
    let has_step = plain || remembers;
    let rule = if remembers { "derivative(z, dr, p, before, before_dr)" } else { "derivative(z, dr, p)" };
    let rule_arguments = if remembers { REMEMBERING.1 } else { 3 };
    if plain && remembers {
        let message = "there are both `fn step(z, c, p)` and `fn step(z, c, p, before)`";
        d.push(Diagnostic::error(message).label(span, "").help("keep the one that is meant"));
    }
    if !has_step && has_distance(ast) {
        let message = "there is a `fn distance(z, p)`, but `distance` does not say whether it is exact";
        d.push(Diagnostic::error(message).label(span, "").help("`distance` is \"exact\" or \"bound\""));
    } else if !has_step {
        let message = "the file has no `fn step(z, c, p)`, nor `fn step(z, c, p, before)`";
        d.push(Diagnostic::error(message).label(span, "described here"));
    }
    if has("derivative", rule_arguments) != has_rule {
        let message = if has_rule {
            format!("`scalar_rule` is given, but there is no `fn {rule}`")
        } else {
            format!("there is a `fn {rule}`, but `scalar_rule` does not say whether it is exact")
        };
        d.push(Diagnostic::error(message).label(span, "").help("`scalar_rule` is \"exact\" or \"heuristic\""));
    }
    for (name, arguments) in RULES {
        let found = ast.iter_functions().filter(|f| f.name == name).map(|f| f.params.join(", ")).next();
        if let Some(found) = found.filter(|_| !has(name, arguments.split(", ").count())) {
            let message =
                format!("a rule for proofs must be `fn {name}({arguments})`, but there is `fn {name}({found})`");
            d.push(
                Diagnostic::error(message).label(span, "").help("correct its arguments, or rename it if it is no rule"),
            );
        }
    }
}

/// The functions that state bounds for proofs, and their arguments.
const RULES: [(&str, &str); 6] = [
    ("growth", "z, e, p"),
    ("stretch", "z, e, p"),
    ("bend", "z, u, e, p"),
    ("tube", "z, u, e, w, p"),
    ("chord", "z, v, l, e, p"),
    ("pull_back", "t, p"),
];

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
    let before = fields.optional::<Vec<f64>>("before", d);
    let before_dr = fields.or("before_dr", 0.0, d);
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
    if before.as_ref().is_some_and(|before| before.len() != z.len()) {
        d.push(Diagnostic::error("`before` needs as many components as `z`").label(value.span, ""));
        return None;
    }
    if !fits {
        d.push(Diagnostic::error("`z` and `expect` need three or four components each").label(value.span, ""));
        return None;
    }
    Some(StepExample { z, c, before, params: values, expect, dr: dr.zip(expect_dr), before_dr, tolerance })
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
    let in_range =
        |x: f64, d: &mut Diagnostics| check_range(x, param.min, param.max, &format!("`{}`", param.name), value.span, d);
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
        ParamKind::Point => match &value.kind {
            ValueKind::List(items) | ValueKind::Tuple { name: None, items } if items.len() == 4 => {
                let parts = items.iter().map(|item| f64::from_value(item, d)).collect::<Option<Vec<_>>>()?;
                let v = [parts[0], parts[1], parts[2], parts[3]];
                v.iter().all(|&x| in_range(x, d)).then_some(ParamValue::Point(v))
            }
            _ => {
                let v = <[f64; 3]>::from_value(value, d)?;
                v.iter().all(|&x| in_range(x, d)).then_some(ParamValue::Vector(v))
            }
        },
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
        let help = fields.or("help", String::new(), d);
        fields.finish(d);
        if let Some(name) = name.as_deref().filter(|name| *name != "n" && is_reserved(name)) {
            d.push(Diagnostic::error(reserved(name)).label(value.span, "a parameter").help("choose another name"));
        }
        let kind = match kind.as_str() {
            "float" => ParamKind::Float,
            "int" => ParamKind::Int,
            "bool" => ParamKind::Bool,
            "angle" => ParamKind::Angle,
            "vec3" => ParamKind::Vec3,
            "point" => ParamKind::Point,
            "mat3" => ParamKind::Mat3,
            "choice" => ParamKind::Choice(choices),
            other => {
                d.push(
                    Diagnostic::error(format!("unknown parameter type \"{other}\""))
                        .label(value.span, "")
                        .help("types are: float, int, bool, angle, vec3, point, mat3, choice"),
                );
                return None;
            }
        };
        let mut param = StepParam { name: name?, kind, default: ParamValue::Bool(false), min, max, unit, help };
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
