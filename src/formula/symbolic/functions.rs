//! Functions of scripts beside the operators of the table.

use rhai::{Dynamic, Engine, FLOAT, INT, NativeCallContext};

use super::operators::{apply, of_numbers};
use super::{Fallible, Part, mark, to_part};
use crate::expr::noise::MOST_OCTAVES;
use crate::expr::ops::Operator;
use crate::expr::{Arena, Expr, Type};

/// Functions of step scripts beside the operators: how each is called, and what it gives.
pub const FUNCTIONS: &[(&str, &str)] = &[
    ("tan(a)", "The tangent of an angle in radians."),
    ("atan(y, x)", "The angle of the point (x, y), as `atan2`; `atan(a)` is the inverse tangent in radians."),
    ("sinh(a)", "The hyperbolic sine, accurate near 0 too."),
    ("cosh(a)", "The hyperbolic cosine."),
    ("tanh(a)", "The hyperbolic tangent: -1 and 1 far out."),
    ("log(a)", "The natural logarithm, as `ln`."),
    ("log2(a)", "The logarithm to the base 2."),
    ("exp2(a)", "2 to the power of the argument."),
    ("inversesqrt(a)", "1 by the square root."),
    ("fract(a)", "The part behind the decimal point: a - floor(a)."),
    ("ceil(a)", "The smallest whole number not below the argument."),
    ("trunc(a)", "The argument without the part behind its decimal point."),
    ("round(a)", "The nearest whole number; of two equally near ones the even one."),
    ("step(edge, a)", "0 where a is below the edge, else 1."),
    (
        "smoothstep(low, high, a)",
        "0 below `low`, 1 above `high`, and smooth between: 3 t t - 2 t t t of the share t of the way.",
    ),
    ("saturate(a)", "The argument moved into the range from 0 to 1."),
    ("mix(a, b, t)", "a + (b - a) t: a where t is 0, b where t is 1."),
    ("radians(a)", "Degrees in radians."),
    ("degrees(a)", "Radians in degrees."),
    ("vec2(x, y)", "A vector of two numbers."),
    (
        "vec3(x, y, z)",
        "A vector of three numbers; numbers and vectors may be mixed, as in vec3(z.xy, 0.0), and vec3(1.0) has three equal ones.",
    ),
    ("vec4(x, y, z, w)", "A vector of four numbers, as vec3: vec4(v, w) takes the first three from a vector."),
    ("length(v)", "The length of a vector."),
    ("normalize(v)", "The vector of length 1 in the same direction; 0 for the zero vector."),
    ("dot(a, b)", "The scalar product of two vectors."),
    ("cross(a, b)", "The vector product of two vectors of three components."),
    ("reflect(v, n)", "The vector mirrored in the plane through 0 whose normal has length 1: v - 2 dot(n, v) n."),
    ("mat_mul(rows, v)", "A matrix, given as a list of its rows, times a vector."),
    (
        "noise(v)",
        "Smooth noise at a point of three components, about from -1 to 1, with features of size 1; the same on every back end.",
    ),
    (
        "fbm(v, octaves)",
        "A sum of 1 to 8 noises, each of half the size and half the height of the one before; about from -1.5 to 1.5.",
    ),
    ("is_constant(a)", "Whether the value is known while the script runs, so that `if` may ask for it."),
];

/// A vector argument.
fn to_vector<'g>(arena: &'g Arena, value: &Dynamic, function: &str) -> Fallible<Part<'g>> {
    let part = to_part(arena, value)?;
    match part.is_vector() {
        true => Ok(part),
        false => Err(format!("`{function}` needs a vector, found a {}", part.type_name()).into()),
    }
}

/// Two vectors of one width.
fn to_vectors<'g>(arena: &'g Arena, a: &Dynamic, b: &Dynamic, function: &str) -> Fallible<[Part<'g>; 2]> {
    let (a, b) = (to_vector(arena, a, function)?, to_vector(arena, b, function)?);
    match a.width() == b.width() {
        true => Ok([a, b]),
        false => Err(format!("`{function}` cannot combine a {} with a {}", a.type_name(), b.type_name()).into()),
    }
}

/// A vector of so many components from numbers and vectors one after the other, or from one number.
fn compose(arena: &Arena, width: usize, args: &[Dynamic]) -> Fallible<Dynamic> {
    let mut numbers: Vec<Expr<'_>> = Vec::new();
    for arg in args {
        let part = to_part(arena, arg)?;
        if part.expr.ty().is_bool {
            return Err(format!("`vec{width}` needs numbers, found a {}", part.type_name()).into());
        }
        numbers.extend(part.components());
    }
    if let [one] = numbers[..] {
        numbers = vec![one; width];
    }
    // A longer vector alone is cut, as shaders have it.
    if args.len() == 1 && numbers.len() > width {
        numbers.truncate(width);
    }
    if numbers.len() != width {
        return Err(format!("`vec{width}` needs {width} numbers, found {}", numbers.len()).into());
    }
    Ok(Part::of(&numbers).to_dynamic())
}

/// Registers a function for any arguments; what is computed with arguments that are all known is folded.
macro_rules! function {
    ($engine:ident, $names:ident, $name:literal, |$arena:ident, $($arg:ident),+| $body:expr) => {{
        $names.push($name);
        $engine.register_fn($name, move |context: NativeCallContext, $($arg: Dynamic),+| -> Fallible<Dynamic> {
            let $arena = &*mark(&context)?;
            $body
        });
    }};
}

/// Registers all functions and gives their names.
pub(super) fn register(engine: &mut Engine) -> Vec<&'static str> {
    let mut names = Vec::new();
    register_operators(engine, &mut names);
    register_numbers(engine, &mut names);
    register_vectors(engine, &mut names);
    // The script language has other ideas of these: a logarithm to the base 10, halves away from 0.
    engine.register_fn("log", |a: FLOAT| a.ln());
    engine.register_fn("log", |a: INT| (a as FLOAT).ln());
    engine.register_fn("round", FLOAT::round_ties_even);
    engine.register_fn("atan", FLOAT::atan2);
    names
}

/// The operators that are called by their names.
fn register_operators(engine: &mut Engine, names: &mut Vec<&'static str>) {
    use Operator as O;
    macro_rules! table {
        ($($name:literal $operator:ident ($($arg:ident),+);)*) => {
            $( function!(engine, names, $name, |arena, $($arg),+| apply(arena, O::$operator, &[$($arg),+])); )*
        };
    }
    table! {
        "abs" Abs(a); "sqrt" Sqrt(a); "floor" Floor(a); "sign" Sign(a); "sin" Sin(a); "cos" Cos(a);
        "asin" Asin(a); "acos" Acos(a); "exp" Exp(a); "ln" Ln(a); "not" Not(a);
        "min" Min(a, b); "max" Max(a, b); "pow" Pow(a, b); "atan2" Atan2(a, b); "mod" Mod(a, b);
        "and" And(a, b); "or" Or(a, b);
        "clamp" Clamp(a, b, c); "select" Select(a, b, c);
    }
}

/// Functions of numbers, or of vectors component by component.
fn register_numbers(engine: &mut Engine, names: &mut Vec<&'static str>) {
    macro_rules! table {
        ($($name:literal ($($arg:ident),+) $body:expr;)*) => {
            $( function!(engine, names, $name, |arena, $($arg),+| {
                of_numbers(arena, $name, &[$($arg),+], |args| { let [$($arg),+] = *args else { unreachable!("as many as given") }; $body })
            }); )*
        };
    }
    table! {
        "tan"(a) a.sin() / a.cos();
        "atan"(a) a.atan();
        "atan"(y, x) y.atan2(x);
        "sinh"(a) a.sinh();
        "cosh"(a) a.cosh();
        "tanh"(a) a.tanh();
        "log"(a) a.ln();
        "log2"(a) a.ln() * std::f64::consts::LOG2_E;
        "exp2"(a) (a * std::f64::consts::LN_2).exp();
        "inversesqrt"(a) 1.0 / a.sqrt();
        "fract"(a) a - a.floor();
        "ceil"(a) -((-a).floor());
        "trunc"(a) a.trunc();
        "round"(a) a.round();
        "step"(edge, a) a.lt(edge).select(a.arena.f(0.0), a.arena.f(1.0));
        "smoothstep"(low, high, a) a.smoothstep(low, high);
        "saturate"(a) a.clamp(a.arena.f(0.0), a.arena.f(1.0));
        "mix"(a, b, t) a.mix(b, t);
        "radians"(a) a * (std::f64::consts::PI / 180.0);
        "degrees"(a) a * (180.0 / std::f64::consts::PI);
    }
    function!(engine, names, "is_constant", |arena, a| {
        Ok(Dynamic::from_bool(to_part(arena, &a).is_ok_and(|part| part.expr.as_constant().is_some())))
    });
}

fn register_vectors(engine: &mut Engine, names: &mut Vec<&'static str>) {
    macro_rules! composed {
        ($($name:literal $width:literal ($($arg:ident),+);)*) => {
            $( function!(engine, names, $name, |arena, $($arg),+| compose(arena, $width, &[$($arg),+])); )*
        };
    }
    composed! {
        "vec2" 2 (a); "vec2" 2 (a, b);
        "vec3" 3 (a); "vec3" 3 (a, b); "vec3" 3 (a, b, c);
        "vec4" 4 (a); "vec4" 4 (a, b); "vec4" 4 (a, b, c); "vec4" 4 (a, b, c, d);
    }
    let number = |expr: Expr<'_>| Ok(super::to_dynamic(expr));
    function!(engine, names, "length", |arena, v| number(to_vector(arena, &v, "length")?.expr.length()));
    function!(engine, names, "normalize", |arena, v| {
        let part = to_vector(arena, &v, "normalize")?;
        Ok(Part { expr: part.expr.normalize(), ..part }.to_dynamic())
    });
    function!(engine, names, "dot", |arena, a, b| {
        let [a, b] = to_vectors(arena, &a, &b, "dot")?;
        number(a.expr.dot(b.expr))
    });
    function!(engine, names, "reflect", |arena, v, n| {
        let [v, n] = to_vectors(arena, &v, &n, "reflect")?;
        Ok(Part { expr: v.expr - n.expr * (v.expr.dot(n.expr) * 2.0), ..v }.to_dynamic())
    });
    function!(engine, names, "cross", |arena, a, b| {
        let [a, b] = to_vectors(arena, &a, &b, "cross")?;
        match a.width() {
            3 => number(a.expr.cross(b.expr)),
            _ => Err("`cross` needs two vectors of three components".into()),
        }
    });
    register_matrix(engine, names);
    register_noise(engine, names);
}

fn register_noise(engine: &mut Engine, names: &mut Vec<&'static str>) {
    function!(engine, names, "noise", |arena, v| Ok(super::to_dynamic(to_point(arena, &v, "noise")?.noise())));
    function!(engine, names, "fbm", |arena, v, octaves| {
        let count = octaves.as_int().unwrap_or(0);
        if !(1..=MOST_OCTAVES).contains(&count) {
            return Err(format!("`fbm` needs a whole number of octaves from 1 to {MOST_OCTAVES}").into());
        }
        Ok(super::to_dynamic(to_point(arena, &v, "fbm")?.octaves(count as u32)))
    });
}

/// A vector argument of three components.
fn to_point<'g>(arena: &'g Arena, value: &Dynamic, function: &str) -> Fallible<Expr<'g>> {
    let part = to_vector(arena, value, function)?;
    match part.width() {
        3 => Ok(part.expr),
        _ => Err(format!("`{function}` needs a vec3, found a {}", part.type_name()).into()),
    }
}

fn register_matrix(engine: &mut Engine, names: &mut Vec<&'static str>) {
    names.push("mat_mul");
    engine.register_fn(
        "mat_mul",
        move |context: NativeCallContext, rows: rhai::Array, v: Dynamic| -> Fallible<Dynamic> {
            let arena = &*mark(&context)?;
            let v = to_vector(arena, &v, "mat_mul")?;
            let rows = rows.iter().map(|r| to_vector(arena, r, "mat_mul")).collect::<Fallible<Vec<_>>>()?;
            if rows.len() != v.width() as usize || rows.iter().any(|r| r.width() != v.width()) {
                let name = v.type_name();
                return Err(format!("`mat_mul` needs as many rows as the vector has components, each a {name}").into());
            }
            let products: Vec<_> = rows.iter().map(|r| r.expr.dot(v.expr)).collect();
            debug_assert!(products.iter().all(|product| product.ty() == Type::F));
            Ok(Part::of(&products).to_dynamic())
        },
    );
}
