//! What the script engine says, in the words of this program.

use rhai::{EvalAltResult, ParseErrorType};

use crate::diag::Diagnostic;
use crate::expr::ops::Operator;
use crate::formula::symbolic::{FUNCTIONS, SYMBOL_NAME, Symbol};

/// Names of other languages, and what stands for them here.
const FOREIGN: &[(&str, &str)] = &[
    ("lerp", "mix(a, b, t)"),
    ("frac", "fract(a)"),
    ("rsqrt", "inversesqrt(a)"),
    ("arcsin", "asin(a)"),
    ("arccos", "acos(a)"),
    ("arctan", "atan(a)"),
    ("arctan2", "atan2(y, x)"),
    ("fmod", "mod(a, b)"),
    ("fabs", "abs(a)"),
    ("power", "pow(a, b)"),
    ("distance", "length(a - b)"),
    ("fma", "a * b + c"),
    ("lessThan", "a < b"),
    ("greaterThan", "a > b"),
    ("any", "or(a, b)"),
    ("all", "and(a, b)"),
    ("float2", "vec2(x, y)"),
    ("float3", "vec3(x, y, z)"),
    ("float4", "vec4(x, y, z, w)"),
    ("mat3", "mat_mul([row, row, row], v)"),
    ("cbrt", "sign(a) * pow(abs(a), 1.0 / 3.0)"),
    ("asinh", "ln(a + sqrt(a * a + 1.0))"),
    ("acosh", "ln(a + sqrt(a * a - 1.0))"),
    ("atanh", "0.5 * ln((1.0 + a) / (1.0 - a))"),
];

/// Functions that would make a script's result depend on when and where it runs.
const CLOCKS: [&str; 5] = ["sleep", "timestamp", "time", "now", "elapsed"];

/// Where all functions are listed.
pub(super) const LIST: &str = "docs/operators.md lists the functions of scripts";

/// A type of the script language in the user's words.
pub fn type_name(name: &str) -> String {
    let name = name.trim_start_matches('&').trim_start_matches("mut ");
    let word = match name {
        "i64" | "INT" => "whole number",
        "f64" | "FLOAT" => "number",
        "bool" => "boolean",
        "string" | "ImmutableString" | "String" | "str" => "text",
        "char" => "character",
        "array" | "Array" => "list",
        "blob" => "list of bytes",
        "map" | "Map" => "set of fields #{ ... }",
        "()" => "nothing",
        "Fn" | "FnPtr" => "function",
        name if name == std::any::type_name::<Symbol>() => SYMBOL_NAME,
        name if name.contains("Range") => "range",
        name => name.rsplit("::").next().unwrap_or(name),
    };
    word.to_string()
}

fn quoted(text: &str) -> Vec<&str> {
    text.split('\'').skip(1).step_by(2).collect()
}

/// Name and argument types of a signature such as `clamp (f64, f64)`.
fn signature(text: &str) -> (&str, Vec<String>) {
    let (name, rest) = text.split_once(" (").unwrap_or((text, ""));
    let types = rest.trim_end_matches(')').split(", ").filter(|ty| !ty.is_empty());
    (name.trim(), types.map(type_name).collect())
}

/// The name in a signature.
pub(super) fn called(text: &str) -> &str {
    signature(text).0
}

fn no_such_function(text: &str) -> String {
    let (name, types) = signature(text);
    let list = if types.is_empty() { "no arguments".to_string() } else { types.join(", ") };
    let is_operator = !name.starts_with(|c: char| c.is_alphabetic() || c == '_');
    match (is_operator, is_function(name)) {
        (true, _) => format!("`{name}` cannot be applied to: {list}"),
        (false, true) => format!("`{name}` cannot take: {list}"),
        (false, false) => format!("there is no function `{name}`"),
    }
}

/// Whether step scripts have a function of this name.
fn is_function(name: &str) -> bool {
    call_of(name).is_some()
}

/// How a function of step scripts is called.
pub(super) fn call_of(name: &str) -> Option<String> {
    if let Some((call, _)) = FUNCTIONS.iter().find(|(call, _)| call.split('(').next() == Some(name)) {
        return Some(format!("write `{call}`"));
    }
    let operator = Operator::ALL.iter().map(|operator| operator.info()).find(|info| info.name == name)?;
    let plural = if operator.arity == 1 { "" } else { "s" };
    Some(format!("`{name}` takes {} argument{plural}", operator.arity))
}

/// An engine error as a sentence without its position.
pub(super) fn plain(error: &EvalAltResult) -> String {
    use EvalAltResult as E;
    if is_symbolic_condition(error) {
        return "a value that is known only while rendering cannot decide what the script does".into();
    }
    match error {
        E::ErrorRuntime(value, _) => value.to_string(),
        E::ErrorTerminated(value, _) => value.to_string(),
        E::ErrorTooManyOperations(_) => format!("the script runs more than {} operations", super::MAX_OPERATIONS),
        E::ErrorTooManyVariables(_) => format!("the script has more than {} variables at a time", super::MAX_VARIABLES),
        E::ErrorStackOverflow(_) => "the script calls itself endlessly".into(),
        E::ErrorDataTooLarge(what, _) => {
            let (what, most) = match (what.contains("string"), what.contains("map")) {
                (true, _) => ("text", super::MAX_TEXT),
                (_, true) => ("set of fields", super::MAX_FIELDS),
                _ => ("list", super::MAX_ITEMS),
            };
            format!("a {what} of the script, with all that it holds, is longer than {most}")
        }
        E::ErrorParsing(kind, _) => parse_message(kind),
        E::ErrorFunctionNotFound(text, _) => no_such_function(text),
        E::ErrorVariableNotFound(name, _) => format!("there is no variable `{name}`"),
        E::ErrorPropertyNotFound(name, _) => format!("there is no field `{name}`"),
        E::ErrorDotExpr(text, _) => match quoted(text)[..] {
            [name, ty] => format!("a {} has no part `{name}`", type_name(ty)),
            _ => "nothing of this name can be read or set here".into(),
        },
        E::ErrorIndexNotFound(index, _) => format!("there is no item `{index}`"),
        E::ErrorIndexingType(..) => "this value has no items to take by [ ]".into(),
        E::ErrorArrayBounds(count, index, _) => format!("item {index} is asked of a list of {count}, counted from 0"),
        E::ErrorStringBounds(count, index, _) => {
            format!("character {index} is asked of a text of {count}, counted from 0")
        }
        E::ErrorFor(_) => "`for` runs over a range such as 0..3, or over a list".into(),
        E::ErrorMismatchDataType(wanted, found, _) | E::ErrorMismatchOutputType(wanted, found, _) => {
            match (wanted.as_str(), found.as_str()) {
                ("", found) => format!("a {} does not fit here", type_name(found)),
                (wanted, "") => format!("expected a {}", type_name(wanted)),
                (wanted, found) => format!("expected a {}, found a {}", type_name(wanted), type_name(found)),
            }
        }
        E::ErrorAssignmentToConstant(name, _) => format!("`{name}` is constant and cannot be set"),
        E::ErrorNonPureMethodCallOnConstant(..) => "a constant cannot be changed".into(),
        other => unpositioned(&other.to_string()),
    }
}

/// The text of an error without its position.
fn unpositioned(text: &str) -> String {
    text.rfind(" (line ").map_or(text, |at| &text[..at]).to_string()
}

/// Whether a value of the orbit stands where a script decides.
pub(super) fn is_symbolic_condition(error: &EvalAltResult) -> bool {
    // Conditions are reported with the Rust name of the type, other mismatches with the registered one.
    let rust_name = std::any::type_name::<Symbol>();
    matches!(error, EvalAltResult::ErrorMismatchDataType(_, actual, _) if actual == SYMBOL_NAME || actual == rust_name)
}

/// Adds what stands here for a function that there is not.
pub(super) fn suggest_function<'a>(
    diagnostic: Diagnostic,
    name: &str,
    candidates: impl IntoIterator<Item = &'a str>,
) -> Diagnostic {
    if let Some((_, call)) = FOREIGN.iter().find(|(foreign, _)| *foreign == name) {
        return diagnostic.help(format!("write `{call}`"));
    }
    if CLOCKS.contains(&name) {
        return diagnostic.help("scripts have no clock: the same script always makes the same formula");
    }
    let near = diagnostic.did_you_mean(name, candidates);
    if near.help.is_empty() { near.help(LIST) } else { near }
}

/// A mistake in the text of a script.
pub(super) fn parse_message(kind: &ParseErrorType) -> String {
    use ParseErrorType as P;
    match kind {
        P::Reserved(word) => reserved(word),
        P::VariableExpected => "expected the name of a variable".into(),
        P::PropertyExpected => "expected the name of a field".into(),
        P::MissingToken(token, _) => format!("`{token}` is missing here"),
        P::ExprExpected(_) => "an expression must stand here".into(),
        P::DuplicatedProperty(name) => format!("the field `{name}` is there twice"),
        P::UnexpectedEOF => "the script ends too early: a bracket or a text is not closed".into(),
        P::LiteralTooLarge(..) => "a text or list of the script is too long".into(),
        P::ExprTooDeep => "the expression is nested too deep".into(),
        P::TooManyFunctions => "the script has too many functions".into(),
        other => other.to_string(),
    }
}

/// The message about a word that cannot be a name.
pub fn reserved(word: &str) -> String {
    format!("`{word}` is a reserved word of the script language and cannot be a name")
}

/// Words that cannot be names in scripts and expressions.
pub fn is_reserved(word: &str) -> bool {
    const OTHERS: [&str; 6] = ["PI", "n", "true", "false", "switch", "eval"];
    OTHERS.contains(&word) || is_keyword(word)
}

/// Words that the script language keeps for itself.
pub(super) fn is_keyword(word: &str) -> bool {
    !word.is_empty() && rhai::Engine::new_raw().compile_expression(format!("{word} + 1")).is_err()
}
