//! Operators of scripts, and how functions apply component by component.

use std::sync::Arc;

use rhai::{Dynamic, Engine, FLOAT, INT, ImmutableString, NativeCallContext};

use super::{Fallible, Part, Symbol, mark, to_part};
use crate::expr::ops::Operator;
use crate::expr::{Arena, Expr};

/// Applies a function component by component after its arguments' widths were compared: numbers combine with vectors.
pub(super) fn componentwise<'g>(
    name: &str,
    parts: &[Part<'g>],
    f: impl Fn(&[Expr<'g>]) -> Expr<'g>,
) -> Fallible<Dynamic> {
    let width = parts.iter().map(|part| part.width()).max().unwrap_or(1);
    if let Some(odd) = parts.iter().find(|part| part.width() != 1 && part.width() != width) {
        let message = format!("`{name}` cannot combine a {} with a vector of {width} components", odd.type_name());
        return Err(message.into());
    }
    if width != 2 {
        let exprs: Vec<Expr<'g>> = parts.iter().map(|part| part.expr).collect();
        return Ok(Part { expr: f(&exprs), is_pair: false }.to_dynamic());
    }
    let component = |i: u8| {
        let exprs: Vec<Expr<'g>> =
            parts.iter().map(|part| if part.is_pair { part.expr.component(i) } else { part.expr }).collect();
        f(&exprs)
    };
    Ok(Part::of(&[component(0), component(1)]).to_dynamic())
}

/// A function of numbers and vectors, component by component.
pub(super) fn of_numbers<'g>(
    arena: &'g Arena,
    name: &str,
    args: &[Dynamic],
    f: impl Fn(&[Expr<'g>]) -> Expr<'g>,
) -> Fallible<Dynamic> {
    let parts = args.iter().map(|a| to_part(arena, a)).collect::<Fallible<Vec<_>>>()?;
    if let Some(odd) = parts.iter().find(|part| part.expr.ty().is_bool) {
        return Err(format!("`{name}` needs a number or vector here, found a {}", odd.type_name()).into());
    }
    componentwise(name, &parts, f)
}

/// Applies an operator after checking what a script may have got wrong.
pub(super) fn apply(arena: &Arena, operator: Operator, args: &[Dynamic]) -> Fallible<Dynamic> {
    let info = operator.info();
    let parts = args.iter().map(|a| to_part(arena, a)).collect::<Fallible<Vec<_>>>()?;
    for (i, part) in parts.iter().enumerate() {
        let wants_bool = info.bool_arguments >> i & 1 == 1;
        if part.expr.ty().is_bool != wants_bool && !(operator == Operator::Select && i > 0) {
            let expected = if wants_bool { "a boolean" } else { "a number or vector" };
            return Err(format!("`{}` needs {expected} here, found a {}", info.name, part.type_name()).into());
        }
    }
    if operator == Operator::Select && parts[1].expr.ty().is_bool != parts[2].expr.ty().is_bool {
        return Err("`select` needs two values of one kind".into());
    }
    componentwise(info.name, &parts, |exprs| Expr::apply(operator, exprs))
}

pub(super) fn register(engine: &mut Engine) {
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
        register_binary(engine, symbol, move |arena, a, b| apply(arena, operator, &[a, b]));
    }
    register_binary(engine, ">", |arena, a, b| apply(arena, Operator::Lt, &[b, a]));
    register_binary(engine, ">=", |arena, a, b| apply(arena, Operator::Le, &[b, a]));
    register_binary(engine, "!=", |arena, a, b| {
        let equal = apply(arena, Operator::Eq, &[a, b])?;
        apply(arena, Operator::Not, &[equal])
    });
    register_binary(engine, "**", |arena, a, b| apply(arena, Operator::Pow, &[a, b]));
    engine.register_fn("/", |a: INT, b: INT| a as FLOAT / b as FLOAT);
    for operator in ["==", "!=", "<", ">", "<=", ">="] {
        let message = "a value of the orbit cannot be compared with a text";
        engine.register_fn(operator, move |_: Symbol, _: ImmutableString| -> Fallible<bool> { Err(message.into()) });
        engine.register_fn(operator, move |_: ImmutableString, _: Symbol| -> Fallible<bool> { Err(message.into()) });
    }
    for (symbol, operator) in [("-", Operator::Neg), ("!", Operator::Not)] {
        engine.register_fn(symbol, move |context: NativeCallContext, a: Symbol| -> Fallible<Dynamic> {
            apply(&*mark(&context)?, operator, &[Dynamic::from(a)])
        });
    }
}

type Binary = dyn Fn(&Arena, Dynamic, Dynamic) -> Fallible<Dynamic> + Send + Sync;

/// Registers an operator for a symbol on either side and symbols or plain values on the other.
fn register_binary(
    engine: &mut Engine,
    symbol: &str,
    f: impl Fn(&Arena, Dynamic, Dynamic) -> Fallible<Dynamic> + Send + Sync + 'static,
) {
    let f: Arc<Binary> = Arc::new(f);
    macro_rules! pair {
        ($a:ty, $b:ty) => {{
            let f = f.clone();
            engine.register_fn(symbol, move |context: NativeCallContext, a: $a, b: $b| -> Fallible<Dynamic> {
                f(&*mark(&context)?, Dynamic::from(a), Dynamic::from(b))
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
