//! The Rhai engine as formulas use it: limits, and errors turned into messages with a place.

use std::rc::Rc;

use rhai::{AST, Dynamic, Engine, EvalAltResult, ParseError, Position, Scope};

use super::symbolic::{self, FUNCTIONS, SYMBOL_NAME, Symbol, Tracer};
use super::value::{Name, Value, ValueKind};
use crate::diag::{Diagnostic, SourceId, Sources, Span};
use crate::expr::ops::Operator;

/// Operations that one script may execute.
const MAX_OPERATIONS: u64 = 2_000_000;
/// How deep functions of a script may call each other.
const MAX_CALL_LEVELS: usize = 32;

/// A Rhai engine with the symbolic type, and the tracer that its functions report to.
pub struct ScriptEngine {
    engine: Engine,
    /// Where nodes and positions go.
    pub tracer: Rc<Tracer>,
}

impl ScriptEngine {
    /// An engine for step files and parameter expressions.
    pub fn new() -> ScriptEngine {
        let mut engine = Engine::new();
        engine
            .set_fast_operators(false)
            .set_fail_on_invalid_map_property(true)
            .set_max_operations(MAX_OPERATIONS)
            .set_max_call_levels(MAX_CALL_LEVELS)
            .set_max_expr_depths(64, 48)
            .set_max_string_size(100_000)
            .set_max_array_size(10_000)
            .set_max_map_size(1_000)
            .set_max_functions(200)
            .set_max_modules(0);
        engine.disable_symbol("switch").disable_symbol("eval").disable_symbol("import");
        engine.on_print(|_| {}).on_debug(|_, _, _| {});
        let mut constants = rhai::Module::new();
        constants.set_var("PI", std::f64::consts::PI);
        engine.register_global_module(constants.into());
        let tracer = Rc::new(Tracer::default());
        symbolic::register(&mut engine, &tracer);
        ScriptEngine { engine, tracer }
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
        self.engine.compile_with_scope(&base_scope(), text).map_err(|error| parse_error(sources, id, &error))
    }

    /// Runs a script's own statements and returns the value of the last one.
    pub fn run(&self, sources: &Sources, id: SourceId, ast: &AST, scope: &mut Scope) -> Result<Dynamic, Diagnostic> {
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
        let options = rhai::CallFnOptions::new().eval_ast(false);
        self.engine
            .call_fn_with_options::<Dynamic>(options, &mut base_scope(), ast, name, args)
            .map_err(|error| self.runtime_error(sources, id, ast, name, &error))
    }

    /// Evaluates an expression with the given variables. The error is a plain sentence.
    pub fn expression(&self, text: &str, scope: &mut Scope) -> Result<Dynamic, String> {
        self.engine.eval_expression_with_scope::<Dynamic>(scope, text).map_err(|error| plain(&error))
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
        let diagnostic = Diagnostic::error(plain(inner));
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
                let last = self.tracer.last_position();
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
        if is_symbolic_condition(error) {
            return diagnostic.help("use `select(condition, a, b)`, and `and(a, b)`, `or(a, b)`, `not(a)`");
        }
        let EvalAltResult::ErrorFunctionNotFound(signature, _) = error else {
            return diagnostic;
        };
        let name = signature.split([' ', '(']).next().unwrap_or_default();
        if let Some(operator) = Operator::ALL.iter().map(|operator| operator.info()).find(|info| info.name == name) {
            return diagnostic.help(format!("`{name}` takes {} argument{}", operator.arity, plural(operator.arity)));
        }
        if let Some((call, _)) = FUNCTIONS.iter().find(|(call, _)| call.split('(').next() == Some(name)) {
            return diagnostic.help(format!("write `{call}`"));
        }
        let known = self.tracer.functions();
        let own = ast.iter_functions().map(|f| f.name);
        if ast.iter_functions().any(|f| f.name == name) {
            return diagnostic.help(format!("there is a `{name}`, but it takes other arguments"));
        }
        diagnostic.did_you_mean(name, known.iter().copied().chain(own))
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

fn plural(count: usize) -> &'static str {
    if count == 1 { "" } else { "s" }
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
    let text = error.err_type().to_string();
    let diagnostic = Diagnostic::error(text.clone()).label(span_of(sources, id, error.position()), "");
    match text.contains("'switch'") {
        true => diagnostic
            .help("`switch` is not available in formulas: use `if` on known values, `select` on symbolic ones"),
        false => diagnostic,
    }
}

fn is_symbolic_condition(error: &EvalAltResult) -> bool {
    // Conditions are reported with the Rust name of the type, other mismatches with the registered one.
    let rust_name = std::any::type_name::<Symbol>();
    matches!(error, EvalAltResult::ErrorMismatchDataType(_, actual, _) if actual == SYMBOL_NAME || actual == rust_name)
}

/// An engine error as a sentence without its position.
fn plain(error: &EvalAltResult) -> String {
    if is_symbolic_condition(error) {
        return "a value that is known only while rendering cannot decide what the script does".into();
    }
    match error {
        EvalAltResult::ErrorRuntime(value, _) => value.to_string(),
        EvalAltResult::ErrorTooManyOperations(_) => {
            format!("the script runs more than {MAX_OPERATIONS} operations")
        }
        EvalAltResult::ErrorStackOverflow(_) => "the script calls itself without end".into(),
        EvalAltResult::ErrorParsing(kind, _) => kind.to_string(),
        other => {
            let text = other.to_string();
            match text.rfind(" (line ") {
                Some(at) => text[..at].to_string(),
                None => text,
            }
        }
    }
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

/// A script's value as a value tree, the form in which RON files arrive too. `span` stands for all of it; fields found
/// in the text get their own place.
pub fn to_value(value: &Dynamic, span: &dyn Fn(Option<&str>) -> Span) -> Value {
    let kind = if value.is_unit() {
        ValueKind::Unit
    } else if let Some(kind) = plain_kind(value) {
        kind
    } else if let Some(items) = value.read_lock::<rhai::Array>() {
        ValueKind::List(items.iter().map(|item| to_value(item, span)).collect())
    } else if let Some(map) = value.read_lock::<rhai::Map>() {
        let mut fields = Vec::new();
        for (key, item) in map.iter() {
            let key = key.as_str();
            let inner = |name: Option<&str>| span(name.or(Some(key)));
            fields.push((Name::new(span(Some(key)), key), to_value(item, &inner)));
        }
        ValueKind::Struct { name: None, fields }
    } else if let Some(node) = value.read_lock::<Value>() {
        return node.clone();
    } else {
        ValueKind::Invalid
    };
    Value { span: span(None), kind }
}
