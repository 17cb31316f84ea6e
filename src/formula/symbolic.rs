//! Symbolic values for Rhai: what a step's script computes with while it is traced.
//!
//! A script runs once; each operation on a [`Symbol`] adds a node to the current [`Arena`] and remembers the line and
//! column of the call. A result that turns out to be a known scalar goes back to the script as a plain number or
//! boolean, so `if`, loops and array indices work on everything that is known.

use std::cell::{Cell, RefCell};
use std::rc::Rc;

use rhai::{Dynamic, Engine, EvalAltResult, FLOAT, INT, ImmutableString, NativeCallContext, Position};

use crate::diag::{SourceId, Sources, Span};
use crate::expr::ops::Operator;
use crate::expr::{Arena, Expr, NodeId, Type};

/// What scripts see as the type's name.
pub const SYMBOL_NAME: &str = "symbolic value";
/// Nodes that one formula may have.
pub const MAX_NODES: usize = 200_000;

/// A value that is known only when the kernel runs: a node of the arena.
#[derive(Clone)]
pub struct Symbol {
    arena: Rc<Arena>,
    id: NodeId,
}

impl Symbol {
    /// The value of an expression of `arena`.
    pub fn new(arena: &Rc<Arena>, expr: Expr<'_>) -> Symbol {
        Symbol { arena: arena.clone(), id: expr.id }
    }

    /// The expression.
    pub fn expr(&self) -> Expr<'_> {
        self.arena.expr(self.id)
    }
}

type Fallible<T> = Result<T, Box<EvalAltResult>>;

/// Functions of step scripts beside the operators: how each is called, and what it gives.
pub const FUNCTIONS: &[(&str, &str)] = &[
    ("tan(a)", "The tangent of an angle in radians."),
    ("fract(a)", "The part behind the decimal point: a - floor(a)."),
    ("mix(a, b, t)", "a + (b - a) t: a where t is 0, b where t is 1."),
    ("vec3(x, y, z)", "A vector of three numbers."),
    ("vec4(x, y, z, w)", "A vector of four numbers; vec4(v, w) takes the first three from a vector."),
    ("length(v)", "The length of a vector."),
    ("normalize(v)", "The vector of length 1 in the same direction; NaN for the zero vector."),
    ("dot(a, b)", "The scalar product of two vectors."),
    ("cross(a, b)", "The vector product of two vectors of three components."),
    ("mat_mul(rows, v)", "A matrix, given as a list of its rows, times a vector."),
    ("is_constant(a)", "Whether the value is known while the script runs, so that `if` may ask for it."),
];

/// The state of a trace: where nodes go and which text the positions belong to.
#[derive(Default)]
pub struct Tracer {
    arena: RefCell<Rc<Arena>>,
    text: RefCell<Option<(SourceId, Vec<u32>)>>,
    last_position: Cell<Position>,
    functions: RefCell<Vec<&'static str>>,
}

impl Tracer {
    /// Nodes go to `arena` from now on, with positions in the text `id`.
    pub fn start(&self, arena: &Rc<Arena>, sources: &Sources, id: SourceId) {
        let mut lines = vec![0];
        lines.extend(sources.text(id).match_indices('\n').map(|(at, _)| at as u32 + 1));
        *self.arena.borrow_mut() = arena.clone();
        *self.text.borrow_mut() = Some((id, lines));
        self.last_position.set(Position::NONE);
    }

    /// Place of the last traced call; errors that carry no position of their own are reported there.
    pub fn last_position(&self) -> Position {
        self.last_position.get()
    }

    /// Names of the functions that work on symbolic values.
    pub fn functions(&self) -> Vec<&'static str> {
        self.functions.borrow().clone()
    }

    fn mark(&self, context: &NativeCallContext) -> Fallible<Rc<Arena>> {
        let position = context.call_position();
        let arena = self.arena.borrow().clone();
        if let (Some((id, lines)), Some(line)) = (&*self.text.borrow(), position.line()) {
            let start = lines.get(line - 1).copied().unwrap_or(0) + position.position().unwrap_or(1) as u32 - 1;
            arena.set_span(Span { source: *id, start, end: start + 1 });
            self.last_position.set(position);
        }
        if arena.len() > MAX_NODES {
            return Err(format!("the formula has more than {MAX_NODES} operations; unroll fewer loops").into());
        }
        Ok(arena)
    }
}

/// The expression of a number, boolean, vector or symbol.
fn to_expr<'g>(arena: &'g Rc<Arena>, value: &Dynamic) -> Fallible<Expr<'g>> {
    if let Some(symbol) = value.read_lock::<Symbol>() {
        if !Rc::ptr_eq(&symbol.arena, arena) {
            return Err("this value belongs to another formula".into());
        }
        return Ok(arena.expr(symbol.id));
    }
    if let Ok(x) = value.as_float() {
        return Ok(arena.f(x));
    }
    if let Ok(x) = value.as_int() {
        return Ok(arena.f(x as f64));
    }
    if let Ok(x) = value.as_bool() {
        return Ok(arena.bool(x));
    }
    Err(format!("expected a number or a vector, found {}", value.type_name()).into())
}

/// The script's view of an expression: plain where it is a known scalar.
pub fn to_dynamic(arena: &Rc<Arena>, expr: Expr<'_>) -> Dynamic {
    match (expr.as_constant(), expr.ty()) {
        (Some(c), Type::F) => Dynamic::from_float(c[0]),
        (Some(c), Type::B) => Dynamic::from_bool(c[0] != 0.0),
        _ => Dynamic::from(Symbol::new(arena, expr)),
    }
}

/// Applies an operator after checking what a script may have got wrong.
fn apply(arena: &Rc<Arena>, operator: Operator, args: &[Dynamic]) -> Fallible<Dynamic> {
    let info = operator.info();
    let exprs = args.iter().map(|a| to_expr(arena, a)).collect::<Fallible<Vec<_>>>()?;
    for (i, expr) in exprs.iter().enumerate() {
        let wants_bool = info.bool_arguments >> i & 1 == 1;
        if expr.ty().is_bool != wants_bool && !(operator == Operator::Select && i > 0) {
            let expected = if wants_bool { "a boolean" } else { "a number or vector" };
            return Err(format!("`{}` needs {expected} here, found a {}", info.name, expr.ty()).into());
        }
    }
    let width = exprs.iter().map(|e| e.ty().width).max().unwrap_or(1);
    if let Some(odd) = exprs.iter().find(|e| e.ty().width != 1 && e.ty().width != width) {
        return Err(format!("`{}` cannot combine a {} with a vector of {width} components", info.name, odd.ty()).into());
    }
    if operator == Operator::Select && exprs[1].ty().is_bool != exprs[2].ty().is_bool {
        return Err("`select` needs two values of one kind".into());
    }
    Ok(to_dynamic(arena, Expr::apply(operator, &exprs)))
}

/// A vector argument of at least three components.
fn to_vector<'g>(arena: &'g Rc<Arena>, value: &Dynamic, function: &str) -> Fallible<Expr<'g>> {
    let expr = to_expr(arena, value)?;
    match expr.ty() {
        ty if ty.width > 1 && !ty.is_bool => Ok(expr),
        ty => Err(format!("`{function}` needs a vector, found a {ty}").into()),
    }
}

fn to_scalar<'g>(arena: &'g Rc<Arena>, value: &Dynamic, function: &str) -> Fallible<Expr<'g>> {
    let expr = to_expr(arena, value)?;
    match expr.ty() {
        Type::F => Ok(expr),
        ty => Err(format!("`{function}` needs numbers, found a {ty}").into()),
    }
}

/// Teaches an engine the symbolic type, its operators and functions.
pub fn register(engine: &mut Engine, tracer: &Rc<Tracer>) {
    engine.register_type_with_name::<Symbol>(SYMBOL_NAME);
    for (symbol, operator) in [
        ("+", Operator::Add),
        ("-", Operator::Sub),
        ("*", Operator::Mul),
        ("/", Operator::Div),
        ("%", Operator::Mod),
        ("<", Operator::Lt),
        ("<=", Operator::Le),
        ("==", Operator::Eq),
        ("&", Operator::And),
        ("|", Operator::Or),
    ] {
        register_binary(engine, tracer, symbol, move |arena, a, b| apply(arena, operator, &[a, b]));
    }
    register_binary(engine, tracer, ">", |arena, a, b| apply(arena, Operator::Lt, &[b, a]));
    register_binary(engine, tracer, ">=", |arena, a, b| apply(arena, Operator::Le, &[b, a]));
    register_binary(engine, tracer, "!=", |arena, a, b| {
        let equal = apply(arena, Operator::Eq, &[a, b])?;
        apply(arena, Operator::Not, &[equal])
    });
    register_binary(engine, tracer, "**", |arena, a, b| apply(arena, Operator::Pow, &[a, b]));
    engine.register_fn("/", |a: INT, b: INT| a as FLOAT / b as FLOAT);
    for operator in ["==", "!=", "<", ">", "<=", ">="] {
        let message = "a symbolic value cannot be compared with a string";
        engine.register_fn(operator, move |_: Symbol, _: ImmutableString| -> Fallible<bool> { Err(message.into()) });
        engine.register_fn(operator, move |_: ImmutableString, _: Symbol| -> Fallible<bool> { Err(message.into()) });
    }
    register_unary_operators(engine, tracer);
    register_functions(engine, tracer);
    register_vectors(engine, tracer);
    register_components(engine, tracer);
}

fn register_unary_operators(engine: &mut Engine, tracer: &Rc<Tracer>) {
    for (symbol, operator) in [("-", Operator::Neg), ("!", Operator::Not)] {
        let tracer = tracer.clone();
        engine.register_fn(symbol, move |context: NativeCallContext, a: Symbol| -> Fallible<Dynamic> {
            apply(&tracer.mark(&context)?, operator, &[Dynamic::from(a)])
        });
    }
}

type Binary = dyn Fn(&Rc<Arena>, Dynamic, Dynamic) -> Fallible<Dynamic>;

/// Registers an operator for a symbol on either side and symbols or plain values on the other.
fn register_binary(
    engine: &mut Engine,
    tracer: &Rc<Tracer>,
    symbol: &str,
    f: impl Fn(&Rc<Arena>, Dynamic, Dynamic) -> Fallible<Dynamic> + 'static,
) {
    let f: Rc<Binary> = Rc::new(f);
    macro_rules! pair {
        ($a:ty, $b:ty) => {{
            let (f, tracer) = (f.clone(), tracer.clone());
            engine.register_fn(symbol, move |context: NativeCallContext, a: $a, b: $b| -> Fallible<Dynamic> {
                f(&tracer.mark(&context)?, Dynamic::from(a), Dynamic::from(b))
            });
        }};
    }
    pair!(Symbol, Symbol);
    pair!(Symbol, FLOAT);
    pair!(FLOAT, Symbol);
    pair!(Symbol, INT);
    pair!(INT, Symbol);
    pair!(Symbol, bool);
    pair!(bool, Symbol);
}

fn register_functions(engine: &mut Engine, tracer: &Rc<Tracer>) {
    use Operator as O;
    macro_rules! function {
        ($name:literal, |$arena:ident, $($arg:ident),+| $body:expr) => {{
            tracer.functions.borrow_mut().push($name);
            let tracer = tracer.clone();
            engine.register_fn($name, move |context: NativeCallContext, $($arg: Dynamic),+| -> Fallible<Dynamic> {
                let $arena = &tracer.mark(&context)?;
                $body
            });
        }};
    }
    macro_rules! table {
        ($($name:literal $operator:ident ($($arg:ident),+);)*) => {
            $( function!($name, |arena, $($arg),+| apply(arena, O::$operator, &[$($arg),+])); )*
        };
    }
    table! {
        "abs" Abs(a); "sqrt" Sqrt(a); "floor" Floor(a); "sign" Sign(a); "sin" Sin(a); "cos" Cos(a);
        "asin" Asin(a); "acos" Acos(a); "exp" Exp(a); "ln" Ln(a); "not" Not(a);
        "min" Min(a, b); "max" Max(a, b); "pow" Pow(a, b); "atan2" Atan2(a, b); "mod" Mod(a, b);
        "and" And(a, b); "or" Or(a, b);
        "clamp" Clamp(a, b, c); "select" Select(a, b, c);
    }
    function!("tan", |arena, a| {
        let a = to_expr(arena, &a)?;
        Ok(to_dynamic(arena, a.sin() / a.cos()))
    });
    function!("fract", |arena, a| {
        let a = to_expr(arena, &a)?;
        Ok(to_dynamic(arena, a - a.floor()))
    });
    function!("mix", |arena, a, b, t| {
        let difference = apply(arena, O::Sub, &[b, a.clone()])?;
        let part = apply(arena, O::Mul, &[difference, t])?;
        apply(arena, O::Add, &[a, part])
    });
    function!("is_constant", |arena, a| {
        Ok(Dynamic::from_bool(to_expr(arena, &a).is_ok_and(|e| e.as_constant().is_some())))
    });
}

fn register_vectors(engine: &mut Engine, tracer: &Rc<Tracer>) {
    macro_rules! function {
        ($name:literal, |$arena:ident, $($arg:ident : $ty:ty),+| $body:expr) => {{
            tracer.functions.borrow_mut().push($name);
            let tracer = tracer.clone();
            engine.register_fn($name, move |context: NativeCallContext, $($arg: $ty),+| -> Fallible<Dynamic> {
                let $arena = &tracer.mark(&context)?;
                let expr = $body;
                Ok(to_dynamic($arena, expr))
            });
        }};
    }
    function!("vec3", |arena, x: Dynamic, y: Dynamic, z: Dynamic| {
        let parts = [x, y, z].iter().map(|v| to_scalar(arena, v, "vec3")).collect::<Fallible<Vec<_>>>()?;
        arena.compose(&parts)
    });
    function!("vec4", |arena, x: Dynamic, y: Dynamic, z: Dynamic, w: Dynamic| {
        let parts = [x, y, z, w].iter().map(|v| to_scalar(arena, v, "vec4")).collect::<Fallible<Vec<_>>>()?;
        arena.compose(&parts)
    });
    function!("vec4", |arena, v: Dynamic, w: Dynamic| {
        let v = to_vector(arena, &v, "vec4")?.components();
        arena.compose(&[v[0], v[1], v[2], to_scalar(arena, &w, "vec4")?])
    });
    function!("length", |arena, v: Dynamic| to_vector(arena, &v, "length")?.length());
    function!("normalize", |arena, v: Dynamic| to_vector(arena, &v, "normalize")?.normalize());
    function!("dot", |arena, a: Dynamic, b: Dynamic| {
        let (a, b) = (to_vector(arena, &a, "dot")?, to_vector(arena, &b, "dot")?);
        if a.ty() != b.ty() {
            return Err(format!("`dot` cannot combine a {} with a {}", a.ty(), b.ty()).into());
        }
        a.dot(b)
    });
    function!("cross", |arena, a: Dynamic, b: Dynamic| {
        let (a, b) = (to_vector(arena, &a, "cross")?, to_vector(arena, &b, "cross")?);
        if a.ty() != Type::V3 || b.ty() != Type::V3 {
            return Err("`cross` needs two vectors of three components".into());
        }
        a.cross(b)
    });
    function!("mat_mul", |arena, rows: rhai::Array, v: Dynamic| {
        let v = to_vector(arena, &v, "mat_mul")?;
        let rows = rows.iter().map(|r| to_vector(arena, r, "mat_mul")).collect::<Fallible<Vec<_>>>()?;
        if rows.len() != v.ty().width as usize || rows.iter().any(|r| r.ty() != v.ty()) {
            return Err(format!("`mat_mul` needs as many rows as the vector has components, each a {}", v.ty()).into());
        }
        let products: Vec<_> = rows.iter().map(|r| r.dot(v)).collect();
        arena.compose(&products)
    });
}

fn register_components(engine: &mut Engine, tracer: &Rc<Tracer>) {
    for (i, name) in ["x", "y", "z", "w"].into_iter().enumerate() {
        let get = tracer.clone();
        engine.register_get(name, move |context: NativeCallContext, v: &mut Symbol| -> Fallible<Dynamic> {
            let arena = get.mark(&context)?;
            Ok(to_dynamic(&arena, component(v, i, name)?))
        });
        let set = tracer.clone();
        engine.register_set(name, move |context: NativeCallContext, v: &mut Symbol, value: Dynamic| -> Fallible<()> {
            let arena = set.mark(&context)?;
            component(v, i, name)?;
            let mut parts = v.expr().components();
            parts[i] = to_scalar(&arena, &value, name)?;
            let id = arena.compose(&parts).id;
            v.id = id;
            Ok(())
        });
    }
    let get = tracer.clone();
    engine.register_get("xyz", move |context: NativeCallContext, v: &mut Symbol| -> Fallible<Dynamic> {
        let arena = get.mark(&context)?;
        component(v, 2, "xyz")?;
        Ok(to_dynamic(&arena, v.expr().xyz()))
    });
}

fn component<'g>(v: &'g Symbol, i: usize, name: &str) -> Fallible<Expr<'g>> {
    let ty = v.expr().ty();
    if ty.width == 1 || i >= ty.width as usize {
        return Err(format!("a {ty} has no component `{name}`").into());
    }
    Ok(v.expr().component(i as u8))
}

#[cfg(test)]
mod tests {
    use super::FUNCTIONS;
    use crate::expr::ops::Operator;
    use crate::formula::script::ScriptEngine;

    #[test]
    fn every_function_is_documented() {
        let mut known = ScriptEngine::new().tracer.functions();
        known.sort_unstable();
        known.dedup();
        let own: Vec<&str> = FUNCTIONS.iter().map(|(call, _)| call.split('(').next().unwrap_or_default()).collect();
        for name in &known {
            let is_operator = Operator::ALL.iter().any(|operator| operator.info().name == *name);
            assert!(is_operator != own.contains(name), "{name} must be an operator or stand in FUNCTIONS");
        }
        assert!(own.iter().all(|name| known.contains(name)), "FUNCTIONS holds a name that does not exist");
    }
}
