//! GLSL's own functions, and those of Fragmentarium's `MathUtils.frag` that formulas use.

use super::run::joined;
use super::value::{Failure, Value, arithmetic, dot, size_of};

/// The value of a function that the shader does not define itself.
pub fn call(name: &str, arguments: &[Value]) -> Result<Value, Failure> {
    if size_of(name).is_some() {
        return Value::construct(name, arguments);
    }
    let unknown = || format!("the function `{name}` is neither in the file nor one of GLSL's that are known here");
    match arguments {
        [a] => one(name, a).ok_or_else(unknown)?,
        [a, b] => two(name, a, b).ok_or_else(unknown)?,
        [a, b, c] => three(name, a, b, c).ok_or_else(unknown)?,
        _ => Err(unknown()),
    }
}

/// A function of each component.
fn by_part(a: &Value, f: impl Fn(f64) -> f64) -> Value {
    match a {
        Value::Vector(parts) => Value::Vector(parts.iter().map(|x| f(*x)).collect()),
        other => Value::of(other.components().into_iter().map(f).collect()),
    }
}

fn one(name: &str, a: &Value) -> Option<Result<Value, Failure>> {
    let f: fn(f64) -> f64 = match name {
        "abs" => f64::abs,
        "sign" => |x| if x == 0.0 { 0.0 } else { x.signum() },
        "floor" => f64::floor,
        "ceil" => f64::ceil,
        "fract" => |x| x - x.floor(),
        "round" => f64::round,
        "trunc" => f64::trunc,
        "sqrt" => f64::sqrt,
        "inversesqrt" => |x| 1.0 / x.sqrt(),
        "exp" => f64::exp,
        "exp2" => f64::exp2,
        "log" => f64::ln,
        "log2" => f64::log2,
        "sin" => f64::sin,
        "cos" => f64::cos,
        "tan" => f64::tan,
        "asin" => f64::asin,
        "acos" => f64::acos,
        "atan" => f64::atan,
        "sinh" => f64::sinh,
        "cosh" => f64::cosh,
        "tanh" => f64::tanh,
        "radians" => f64::to_radians,
        "degrees" => f64::to_degrees,
        _ => return of_whole(name, a),
    };
    if let (Value::Int(number), "abs") = (a, name) {
        return Some(Ok(Value::Int(number.abs())));
    }
    Some(Ok(by_part(a, f)))
}

/// Functions of one vector or matrix.
fn of_whole(name: &str, a: &Value) -> Option<Result<Value, Failure>> {
    let parts = a.components();
    let length = dot(&parts, &parts).sqrt();
    Some(Ok(match (name, a) {
        ("length", _) => Value::Float(length),
        ("normalize", _) => by_part(a, |x| x / length),
        ("transpose", Value::Matrix(columns)) => {
            let rows = columns.first().map_or(0, Vec::len);
            Value::Matrix((0..rows).map(|row| columns.iter().map(|column| column[row]).collect()).collect())
        }
        ("any", _) => Value::Bool(parts.iter().any(|part| *part != 0.0)),
        ("all", _) => Value::Bool(parts.iter().all(|part| *part != 0.0)),
        ("rotationMatrixXYZ", _) if parts.len() == 3 => {
            let about = |axis: [f64; 3], angle: f64| rotation(axis, angle);
            let [x, y, z] =
                [about([1.0, 0.0, 0.0], parts[0]), about([0.0, 1.0, 0.0], parts[1]), about([0.0, 0.0, 1.0], parts[2])];
            return Some(arithmetic("*", &x, &y).and_then(|xy| arithmetic("*", &xy, &z)));
        }
        _ => return None,
    }))
}

fn two(name: &str, a: &Value, b: &Value) -> Option<Result<Value, Failure>> {
    let f: fn(f64, f64) -> f64 = match name {
        "min" => f64::min,
        "max" => f64::max,
        "pow" => f64::powf,
        "mod" => |x, y| x - y * (x / y).floor(),
        "atan" => f64::atan2,
        "step" => |edge, x| if x < edge { 0.0 } else { 1.0 },
        "lessThan" => |x, y| f64::from(u8::from(x < y)),
        "greaterThan" => |x, y| f64::from(u8::from(x > y)),
        _ => return of_two(name, a, b),
    };
    if let (Value::Int(a), Value::Int(b), "min" | "max") = (a, b, name) {
        return Some(Ok(Value::Int(if name == "min" { *a.min(b) } else { *a.max(b) })));
    }
    Some(joined(a, b, f))
}

/// Functions of two vectors.
fn of_two(name: &str, a: &Value, b: &Value) -> Option<Result<Value, Failure>> {
    let (x, y) = (a.components(), b.components());
    Some(match (name, x.len(), y.len()) {
        ("dot", n, m) if n == m => Ok(Value::Float(dot(&x, &y))),
        ("distance", n, m) if n == m => {
            let apart: Vec<f64> = x.iter().zip(&y).map(|(a, b)| a - b).collect();
            Ok(Value::Float(dot(&apart, &apart).sqrt()))
        }
        ("cross", 3, 3) => {
            Ok(Value::Vector(vec![x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]]))
        }
        ("reflect", n, m) if n == m => {
            let along = 2.0 * dot(&x, &y);
            Ok(Value::of(x.iter().zip(&y).map(|(v, n)| v - along * n).collect()))
        }
        ("matrixCompMult", ..) => joined(a, b, |x, y| x * y),
        // Fragmentarium's own: an axis and an angle in degrees; the columns are the rows of the turn.
        ("rotationMatrix3", 3, 1) => Ok(rotation([x[0], x[1], x[2]], y[0])),
        _ => return None,
    })
}

fn three(name: &str, a: &Value, b: &Value, c: &Value) -> Option<Result<Value, Failure>> {
    Some(match name {
        "clamp" => joined(a, b, f64::max).and_then(|value| joined(&value, c, f64::min)),
        "mix" => {
            arithmetic("-", b, a).and_then(|way| arithmetic("*", &way, c)).and_then(|part| arithmetic("+", a, &part))
        }
        "smoothstep" => arithmetic("-", c, a)
            .and_then(|over| arithmetic("-", b, a).and_then(|width| arithmetic("/", &over, &width)))
            .map(|t| by_part(&t, |t| t.clamp(0.0, 1.0)))
            .map(|t| by_part(&t, |t| t * t * (3.0 - 2.0 * t))),
        _ => return None,
    })
}

fn rotation(axis: [f64; 3], degrees: f64) -> Value {
    let (s, c) = degrees.to_radians().sin_cos();
    let [x, y, z] = axis;
    let k = 1.0 - c;
    Value::Matrix(vec![
        vec![c + k * x * x, k * x * y - s * z, k * x * z + s * y],
        vec![k * x * y + s * z, c + k * y * y, k * y * z - s * x],
        vec![k * x * z - s * y, k * y * z + s * x, c + k * z * z],
    ])
}
