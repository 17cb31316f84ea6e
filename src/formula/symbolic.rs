//! Symbolic values for Rhai: what a step's script computes with while it is traced.
//!
//! A script runs once; each operation on a [`Symbol`] adds a node to the current [`Arena`] and remembers the line and
//! column of the call. A result that turns out to be a known scalar goes back to the script as a plain number or
//! boolean, so `if`, loops and array indices work on everything that is known.

use std::cell::{Cell, RefCell};
use std::sync::Arc;

use rhai::{Dynamic, Engine, EvalAltResult, NativeCallContext, Position};

use crate::diag::{SourceId, Sources, Span};
use crate::expr::{Arena, Expr, NodeId, Type};

mod components;
mod functions;
mod operators;

pub(super) use components::swizzle;
pub use functions::FUNCTIONS;

/// What messages call such a value.
pub const SYMBOL_NAME: &str = "number or vector of the orbit";
/// Nodes that one step may make.
pub const MAX_NODES: usize = 200_000;

/// A value that is known only when the kernel runs: a node of the arena. A vector of two components is a node of three whose
/// last is 0, so that no back end has to know of it.
#[derive(Clone)]
pub struct Symbol {
    /// Address of the arena: values of different formulas must not meet.
    arena: usize,
    id: NodeId,
    is_pair: bool,
}

impl Symbol {
    /// The value of an expression.
    pub fn new(expr: Expr<'_>) -> Symbol {
        Symbol { arena: address(expr.arena), id: expr.id, is_pair: false }
    }

    /// The expression in the arena that it was made in. Fails in another arena.
    fn part<'g>(&self, arena: &'g Arena) -> Fallible<Part<'g>> {
        if self.arena != address(arena) {
            return Err("this value belongs to another formula".into());
        }
        Ok(Part { expr: arena.expr(self.id), is_pair: self.is_pair })
    }

    /// The expression in the arena that it was made in; none in another arena.
    pub fn expr<'g>(&self, arena: &'g Arena) -> Option<Expr<'g>> {
        self.part(arena).ok().map(|part| part.expr)
    }

    /// Its type as scripts write it.
    pub fn type_name(&self, arena: &Arena) -> String {
        self.part(arena).map_or_else(|_| SYMBOL_NAME.to_string(), Part::type_name)
    }

    /// The expression where it is of this type.
    pub fn expr_of<'g>(&self, arena: &'g Arena, ty: Type) -> Option<Expr<'g>> {
        let part = self.part(arena).ok()?;
        (!part.is_pair && part.expr.ty() == ty).then_some(part.expr)
    }
}

/// What tells arenas apart.
fn address(arena: &Arena) -> usize {
    std::ptr::from_ref(arena).addr()
}

type Fallible<T> = Result<T, Box<EvalAltResult>>;

/// The state of a trace: where nodes go and which text the positions belong to.
#[derive(Default)]
struct Trace {
    arena: RefCell<Arc<Arena>>,
    text: RefCell<Option<(SourceId, Vec<u32>)>>,
    last_position: Cell<Position>,
    /// Nodes that the arena may have when the trace is done.
    most: Cell<usize>,
}

thread_local! {
    /// What this thread traces. A script runs on one thread from its start to its end, and one at a time, so an engine needs no
    /// trace of its own and can serve many threads.
    static TRACE: Trace = Trace::default();
}

/// Nodes that this thread makes go to `arena` from now on, with positions in the text `id`.
pub fn start_trace(arena: &Arc<Arena>, sources: &Sources, id: SourceId) {
    let mut lines = vec![0];
    lines.extend(sources.text(id).match_indices('\n').map(|(at, _)| at as u32 + 1));
    TRACE.with(|trace| {
        *trace.arena.borrow_mut() = arena.clone();
        *trace.text.borrow_mut() = Some((id, lines));
        trace.last_position.set(Position::NONE);
        trace.most.set(arena.len() + MAX_NODES);
    });
}

/// Place of the last traced call of this thread; errors that carry no position of their own are reported there.
pub fn last_position() -> Position {
    TRACE.with(|trace| trace.last_position.get())
}

/// The arena that this thread's nodes go to; those made next carry the place of the call.
fn mark(context: &NativeCallContext) -> Fallible<Arc<Arena>> {
    let position = context.call_position();
    TRACE.with(|trace| {
        let arena = trace.arena.borrow().clone();
        if let (Some((id, lines)), Some(line)) = (&*trace.text.borrow(), position.line()) {
            let start = lines.get(line - 1).copied().unwrap_or(0) + position.position().unwrap_or(1) as u32 - 1;
            arena.set_span(Span { source: *id, start, end: start + 1 });
            trace.last_position.set(position);
        }
        if arena.len() > trace.most.get() {
            return Err(format!("the step has more than {MAX_NODES} operations; unroll fewer loops").into());
        }
        Ok(arena)
    })
}

/// An argument of a function.
#[derive(Clone, Copy)]
struct Part<'g> {
    expr: Expr<'g>,
    /// Two components, kept as three.
    is_pair: bool,
}

impl<'g> Part<'g> {
    fn type_name(self) -> String {
        if self.is_pair { "vec2".into() } else { self.expr.ty().to_string() }
    }

    /// Number of components.
    fn width(self) -> u8 {
        if self.is_pair { 2 } else { self.expr.ty().width }
    }

    fn is_vector(self) -> bool {
        self.width() > 1 && !self.expr.ty().is_bool
    }

    fn components(self) -> Vec<Expr<'g>> {
        (0..self.width()).map(|i| self.expr.component(i)).collect()
    }

    /// The script's view of it: plain where it is a known scalar.
    fn to_dynamic(self) -> Dynamic {
        if self.is_pair {
            return Dynamic::from(Symbol { is_pair: true, ..Symbol::new(self.expr) });
        }
        to_dynamic(self.expr)
    }

    /// A number or a vector from its components, one to four.
    fn of(parts: &[Expr<'g>]) -> Part<'g> {
        match parts {
            [one] => Part { expr: *one, is_pair: false },
            [x, y] => {
                // The value that stands in for the third component: 0, or false.
                let none = if x.ty().is_bool { x.arena.bool(false) } else { x.arena.f(0.0) };
                Part { expr: x.arena.compose(&[*x, *y, none]), is_pair: true }
            }
            more => Part { expr: more[0].arena.compose(more), is_pair: false },
        }
    }
}

/// The expression of a number, boolean, vector or symbol.
fn to_part<'g>(arena: &'g Arena, value: &Dynamic) -> Fallible<Part<'g>> {
    if let Some(symbol) = value.read_lock::<Symbol>() {
        return symbol.part(arena);
    }
    let plain = |expr| Ok(Part { expr, is_pair: false });
    if let Ok(x) = value.as_float() {
        return plain(arena.f(x));
    }
    if let Ok(x) = value.as_int() {
        return plain(arena.f(x as f64));
    }
    if let Ok(x) = value.as_bool() {
        return plain(arena.bool(x));
    }
    Err(format!("expected a number or a vector, found {}", super::script::words::type_name(value.type_name())).into())
}

/// The script's view of an expression: plain where it is a known scalar.
pub fn to_dynamic(expr: Expr<'_>) -> Dynamic {
    match (expr.as_constant(), expr.ty()) {
        (Some(c), Type::F) => Dynamic::from_float(c[0]),
        (Some(c), Type::B) => Dynamic::from_bool(c[0] != 0.0),
        _ => Dynamic::from(Symbol::new(expr)),
    }
}

/// Teaches an engine the symbolic type, its operators and functions; the names of the functions come back.
pub fn register(engine: &mut Engine) -> Vec<&'static str> {
    engine.register_type_with_name::<Symbol>(SYMBOL_NAME);
    operators::register(engine);
    components::register(engine);
    functions::register(engine)
}

#[cfg(test)]
mod tests {
    use super::FUNCTIONS;
    use crate::expr::ops::Operator;
    use crate::formula::script::ScriptEngine;

    #[test]
    fn every_function_is_documented() {
        let mut known = ScriptEngine::new().traced().to_vec();
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
