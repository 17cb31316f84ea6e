//! The Rhai engine as formulas use it: limits, and errors turned into messages with a place.

use std::collections::HashSet;
use std::sync::{Arc, OnceLock};

use rhai::packages::Package;
use rhai::{AST, Dynamic, Engine, EvalAltResult, OptimizationLevel, ParseError, ParseErrorType, Position, Scope};

use super::symbolic;
use super::value::{Name, Value, ValueKind};
use crate::diag::{Diagnostic, SourceId, Sources, Span};
use crate::expr::Arena;

mod limits;
mod names;
mod places;
pub(super) mod words;

pub use places::{Places, Spot};
pub use words::{is_reserved, reserved, type_name};

/// Operations that one script may execute.
const MAX_OPERATIONS: u64 = 2_000_000;
/// How deep functions of a script may call each other.
const MAX_CALL_LEVELS: usize = 32;
/// Characters of one text of a script, or of all texts in one list.
const MAX_TEXT: usize = 100_000;
/// Items of one list, with those of the lists in it.
const MAX_ITEMS: usize = 10_000;
/// Fields of one `#{ ... }`, with those inside.
const MAX_FIELDS: usize = 1_000;
/// Variables that a script may declare in all.
const MAX_DECLARED: usize = 5000;
/// Variables that a script, or one of its functions, may have at a time.
const MAX_VARIABLES: usize = 1_000;
/// Values beside variables.
const VALUES: [&str; 1] = ["PI"];

/// A Rhai engine with the symbolic type. Many threads may use one: what a run has traced and used is its thread's own.
pub struct ScriptEngine {
    engine: Engine,
    /// Names of the functions that work on symbolic values.
    traced: Vec<&'static str>,
    /// Names of all functions, collected when they are first asked for.
    functions: OnceLock<HashSet<String>>,
}

impl ScriptEngine {
    /// An engine for step files and parameter expressions.
    pub fn new() -> ScriptEngine {
        let mut engine = Engine::new_raw();
        register_packages(&mut engine);
        engine
            .set_fast_operators(false)
            .set_fail_on_invalid_map_property(true)
            // Literals that are folded into values would lose the places of their parts.
            .set_optimization_level(OptimizationLevel::None)
            .set_max_operations(MAX_OPERATIONS)
            .set_max_call_levels(MAX_CALL_LEVELS)
            .set_max_expr_depths(64, 48)
            .set_max_string_size(MAX_TEXT)
            .set_max_array_size(MAX_ITEMS)
            .set_max_map_size(MAX_FIELDS)
            .set_max_variables(MAX_VARIABLES)
            .set_max_functions(200)
            .set_max_modules(0);
        engine.disable_symbol("switch").disable_symbol("eval").disable_symbol("import");
        let mut constants = rhai::Module::new();
        constants.set_var("PI", std::f64::consts::PI);
        engine.register_global_module(constants.into());
        let traced = symbolic::register(&mut engine);
        limits::limit(&mut engine);
        ScriptEngine { engine, traced, functions: OnceLock::new() }
    }

    /// Names of the functions that work on symbolic values.
    pub fn traced(&self) -> &[&'static str] {
        &self.traced
    }

    /// What this thread runs from now on belongs to another formula, whose traces may take as long as those of any.
    pub fn begin_formula(&self) {
        limits::begin();
    }

    /// Scripts that this thread runs from now on make nodes of `arena`, with positions in the text `id`.
    pub fn trace(&self, arena: &Arc<Arena>, sources: &Sources, id: SourceId) {
        symbolic::start_trace(arena, sources, id);
    }

    /// The engine, to register more.
    pub fn engine_mut(&mut self) -> &mut Engine {
        &mut self.engine
    }

    /// Parses a script.
    pub fn compile(&self, sources: &Sources, id: SourceId) -> Result<AST, Diagnostic> {
        let text = sources.text(id);
        if text.len() > 1 << 20 {
            return Err(Diagnostic::error("the script is larger than 1 MiB").label(sources.span_at(id, 1, 1), ""));
        }
        // The parser looks every name up among all variables before it, which takes long where there are many.
        if text.matches("let ").nth(MAX_DECLARED).is_some() {
            let message = format!("the script declares more than {MAX_DECLARED} variables");
            let place = sources.span_at(id, 1, 1);
            return Err(Diagnostic::error(message).label(place, "").help("keep values in arrays or maps"));
        }
        self.engine.compile_with_scope(&base_scope(), text).map_err(|error| parse_error(sources, id, &error))
    }

    /// Runs a script's own statements and returns the value of the last one.
    pub fn run(&self, sources: &Sources, id: SourceId, ast: &AST, scope: &mut Scope) -> Result<Dynamic, Diagnostic> {
        limits::start();
        self.engine
            .eval_ast_with_scope::<Dynamic>(scope, ast)
            .map_err(|error| self.runtime_error(sources, id, ast, "", &error))
    }

    /// Calls a function of a script.
    pub fn call(
        &self,
        sources: &Sources,
        id: SourceId,
        ast: &AST,
        name: &str,
        args: Vec<Dynamic>,
    ) -> Result<Dynamic, Diagnostic> {
        limits::start();
        let options = rhai::CallFnOptions::new().eval_ast(false);
        let result = self.engine.call_fn_with_options::<Dynamic>(options, &mut base_scope(), ast, name, args);
        limits::finish();
        result.map_err(|error| self.runtime_error(sources, id, ast, name, &error))
    }

    /// Evaluates an expression with the given variables.
    pub fn expression(&self, text: &str, scope: &mut Scope) -> Result<Dynamic, BadExpression> {
        limits::start();
        self.engine.eval_expression_with_scope::<Dynamic>(scope, text).map_err(|error| BadExpression::of(&error))
    }

    /// Everything that a script names and that means nothing. `values` are names that it may use beside its own,
    /// `constructors` functions to suggest beside those of step scripts, `params` the parameters of a step.
    pub fn unknown_names(
        &self,
        (sources, id): (&Sources, SourceId),
        ast: &AST,
        (values, constructors): (&[&str], &[&str]),
        params: Option<&[&str]>,
    ) -> Vec<Diagnostic> {
        let functions = self.functions.get_or_init(|| {
            self.engine.collect_fn_metadata(None, |f| Some(f.metadata.name.to_string()), true).into_iter().collect()
        });
        let values: Vec<&str> = values.iter().chain(&VALUES).copied().collect();
        let unknown = names::unknown_names(ast, &names::Known { functions, values: &values, params });
        let traced = &self.traced;
        let message = |found: &names::Unknown| {
            let near = || found.near.iter().map(String::as_str);
            let label = |text: String| Diagnostic::error(text).label(span_of(sources, id, found.position), "");
            let name = &found.name;
            match found.kind {
                names::UnknownKind::Function => {
                    let known = traced.iter().copied().chain(constructors.iter().copied()).chain(near());
                    words::suggest_function(label(format!("there is no function `{name}`")), name, known)
                }
                names::UnknownKind::Variable => {
                    label(format!("there is no variable `{name}`")).did_you_mean(name, near())
                }
                names::UnknownKind::Parameter => {
                    let list: Vec<&str> = near().collect();
                    let unknown = label(format!("the step has no parameter `{name}`")).did_you_mean(name, near());
                    match (unknown.help.is_empty(), list.is_empty()) {
                        (true, false) => unknown.help(format!("its parameters are: {}", list.join(", "))),
                        (true, true) => unknown.help("it has none: list it in `params`"),
                        _ => unknown,
                    }
                }
                names::UnknownKind::Component => {
                    let help = "components are x, y, z and w, and combinations of them such as z.xzy";
                    label(format!("a vector has no component `{name}`")).help(help)
                }
            }
        };
        unknown.iter().map(message).collect()
    }

    /// The message for an error; `function` was called from outside, or it is empty.
    fn runtime_error(
        &self,
        sources: &Sources,
        id: SourceId,
        ast: &AST,
        function: &str,
        error: &EvalAltResult,
    ) -> Diagnostic {
        let (mut inner, mut function) = (error, function);
        while let EvalAltResult::ErrorInFunctionCall(name, _, cause, _) = inner {
            (inner, function) = (cause, name);
        }
        let diagnostic = Diagnostic::error(words::plain(inner));
        match inner {
            EvalAltResult::ErrorTooManyOperations(_) => {
                let label = if function.is_empty() { "in this script" } else { "while this function ran" };
                let help =
                    format!("does a loop never end? A script may run {MAX_OPERATIONS} operations, all loops together");
                diagnostic.label(function_span(sources, id, function), label).help(help)
            }
            EvalAltResult::ErrorStackOverflow(_) => {
                let (span, label) = match self_call(sources, id, ast) {
                    Some(span) => (span, "a function calls itself here"),
                    None => (function_span(sources, id, function), "while this function ran"),
                };
                let help = format!(
                    "calls may be {MAX_CALL_LEVELS} deep; repeat something with a loop over a known number of times"
                );
                diagnostic.label(span, label).help(help)
            }
            _ => {
                let last = symbolic::last_position();
                let span = match (inner.position(), last) {
                    (at, _) if !at.is_none() => span_of(sources, id, at),
                    (_, last) if !last.is_none() => span_of(sources, id, last),
                    _ => function_span(sources, id, function),
                };
                self.with_help(diagnostic.label(span, ""), ast, inner)
            }
        }
    }

    /// Adds what to do about the error.
    fn with_help(&self, diagnostic: Diagnostic, ast: &AST, error: &EvalAltResult) -> Diagnostic {
        if words::is_symbolic_condition(error) {
            return diagnostic.help("use `select(condition, a, b)`, and `and(a, b)`, `or(a, b)`, `not(a)`");
        }
        let EvalAltResult::ErrorFunctionNotFound(signature, _) = error else {
            return diagnostic;
        };
        let name = words::called(signature);
        if let Some(call) = words::call_of(name) {
            return diagnostic.help(call);
        }
        if ast.iter_functions().any(|f| f.name == name) {
            return diagnostic.help(format!("there is a `{name}`, but it takes other arguments"));
        }
        match name.starts_with(|c: char| c.is_alphabetic() || c == '_') {
            true => {
                let own = ast.iter_functions().map(|f| f.name);
                words::suggest_function(diagnostic, name, self.traced.iter().copied().chain(own))
            }
            false => diagnostic,
        }
    }
}

/// What scripts can do beside formulas: lists, texts and plain numbers, but no clock and no sleep, which the script language
/// has among its first package.
fn register_packages(engine: &mut Engine) {
    use rhai::packages as p;
    let modules = [
        p::ArithmeticPackage::new().as_shared_module(),
        p::BasicStringPackage::new().as_shared_module(),
        p::BasicIteratorPackage::new().as_shared_module(),
        p::BasicFnPackage::new().as_shared_module(),
        p::BitFieldPackage::new().as_shared_module(),
        p::LogicPackage::new().as_shared_module(),
        p::BasicMathPackage::new().as_shared_module(),
        p::BasicArrayPackage::new().as_shared_module(),
        p::BasicMapPackage::new().as_shared_module(),
        p::MoreStringPackage::new().as_shared_module(),
    ];
    for module in modules {
        engine.register_global_module(module);
    }
}

/// Why an expression has no value.
#[derive(Debug)]
pub struct BadExpression {
    /// A plain sentence.
    pub message: String,
    /// The variable that there is not, where that is why.
    pub variable: Option<String>,
    /// What to do, where the sentence does not say it.
    pub help: Vec<String>,
}

impl BadExpression {
    fn of(error: &EvalAltResult) -> BadExpression {
        let mut inner = error;
        while let EvalAltResult::ErrorInFunctionCall(_, _, cause, _) = inner {
            inner = cause;
        }
        let diagnostic = Diagnostic::error(words::plain(inner));
        let variable = match inner {
            EvalAltResult::ErrorVariableNotFound(name, _) => Some(name.clone()),
            _ => None,
        };
        let diagnostic = match inner {
            EvalAltResult::ErrorFunctionNotFound(signature, _) => {
                let name = words::called(signature);
                match words::call_of(name) {
                    Some(call) => diagnostic.help(call),
                    None => words::suggest_function(
                        diagnostic,
                        name,
                        symbolic::FUNCTIONS.iter().filter_map(|f| f.0.split('(').next()),
                    ),
                }
            }
            _ => diagnostic,
        };
        BadExpression { message: diagnostic.message, variable, help: diagnostic.help }
    }
}

impl Default for ScriptEngine {
    fn default() -> Self {
        ScriptEngine::new()
    }
}

/// Names that every script knows.
pub fn base_scope() -> Scope<'static> {
    Scope::new()
}

fn span_of(sources: &Sources, id: SourceId, position: Position) -> Span {
    sources.span_at(id, position.line().unwrap_or(1), position.position().unwrap_or(1))
}

/// Place of a function's head; of the script's start where there is no such function.
fn function_span(sources: &Sources, id: SourceId, name: &str) -> Span {
    let head = format!("fn {name}(");
    match sources.text(id).find(&head) {
        Some(at) if !name.is_empty() => Span::new(id, at, at + head.len() - 1),
        _ => sources.span_at(id, 1, 1),
    }
}

/// Place of what a function returns; of its head where that is not known.
pub fn returned_span(sources: &Sources, id: SourceId, ast: &AST, function: &str) -> Span {
    match names::last_statement(ast, function) {
        Some(position) => span_of(sources, id, position),
        None => function_span(sources, id, function),
    }
}

/// Place where a function of the script calls itself, found in its text.
fn self_call(sources: &Sources, id: SourceId, ast: &AST) -> Option<Span> {
    let text = sources.text(id);
    ast.iter_functions().find_map(|function| {
        let start = text.find(&format!("fn {}(", function.name))? + 3 + function.name.len();
        let end = text[start..].find("\nfn ").map_or(text.len(), |at| start + at);
        let call = format!("{}(", function.name);
        let is_word = |at: usize| !text[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_');
        let found = text[start..end].match_indices(&call).map(|(at, _)| start + at).find(|at| is_word(*at))?;
        Some(Span::new(id, found, found + function.name.len()))
    })
}

fn parse_error(sources: &Sources, id: SourceId, error: &ParseError) -> Diagnostic {
    let span = span_of(sources, id, error.position());
    if let Some((span, word)) = misplaced_word(sources, id, error) {
        let diagnostic = Diagnostic::error(words::reserved(word)).label(span, "");
        let is_key = sources.text(id)[span.range().end..].trim_start().starts_with(':');
        return match (word, is_key) {
            ("switch", _) => Diagnostic::error("`switch` is not available in formulas")
                .label(span, "")
                .help("use `if` on known values, `select` on those of the orbit"),
            (_, true) => diagnostic.help(format!("as the name of a field, write it in quotes: \"{word}\": ...")),
            _ => diagnostic.help("choose another name"),
        };
    }
    Diagnostic::error(words::parse_message(error.err_type())).label(span, "")
}

/// The word of the script language that stands where a name belongs, if that is what is wrong.
fn misplaced_word<'a>(sources: &'a Sources, id: SourceId, error: &ParseError) -> Option<(Span, &'a str)> {
    use ParseErrorType as P;
    let is_asked = matches!(
        error.err_type(),
        P::Reserved(_)
            | P::VariableExpected
            | P::PropertyExpected
            | P::MissingToken(..)
            | P::BadInput(_)
            | P::FnMissingName
    );
    let (text, at) = (sources.text(id), span_of(sources, id, error.position()).range().start);
    let is_letter = |c: char| c.is_alphanumeric() || c == '_';
    // At the place itself, or just before where something is missing behind it.
    let here = text[at..].find(|c| !is_letter(c)).map_or(text.len(), |end| at + end);
    let before = text[..at].trim_end();
    let start = before.rfind(|c| !is_letter(c)).map_or(0, |i| i + before[i..].chars().next().map_or(1, char::len_utf8));
    let behind = matches!(error.err_type(), P::MissingToken(..)).then_some(start..before.len());
    let found = std::iter::once(at..here).chain(behind).find(|range| words::is_keyword(&text[range.clone()]))?;
    is_asked.then(|| (Span::new(id, found.start, found.end), &text[found]))
}

/// A boolean, number or string of a script; nothing for values that hold others.
pub fn plain_kind(value: &Dynamic) -> Option<ValueKind> {
    if let Ok(b) = value.as_bool() {
        return Some(ValueKind::Bool(b));
    }
    if let Ok(x) = value.as_float().or_else(|_| value.as_int().map(|i| i as f64)) {
        return Some(ValueKind::Number(x));
    }
    value.read_lock::<rhai::ImmutableString>().map(|text| ValueKind::Str(text.to_string()))
}

/// A script's value as a value tree, the form in which RON files arrive too.
pub fn to_value(value: &Dynamic, spot: &Spot) -> Value {
    let kind = if value.is_unit() {
        ValueKind::Unit
    } else if let Some(kind) = plain_kind(value) {
        kind
    } else if let Some(items) = value.read_lock::<rhai::Array>() {
        ValueKind::List(items.iter().enumerate().map(|(i, item)| to_value(item, &spot.item(i))).collect())
    } else if let Some(map) = value.read_lock::<rhai::Map>() {
        let mut fields = Vec::new();
        for (key, item) in map.iter() {
            let (name, inner) = spot.field(key.as_str());
            fields.push((Name::new(name, key.as_str()), to_value(item, &inner)));
        }
        ValueKind::Struct { name: None, fields }
    } else if let Some(node) = value.read_lock::<Value>() {
        return node.clone();
    } else {
        ValueKind::Invalid
    };
    Value { span: spot.span(), kind }
}
