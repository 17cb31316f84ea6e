//! Values of GLSL: numbers, truths, vectors and square matrices, computed in double precision.

/// A value.
#[derive(Clone, PartialEq, Debug)]
pub enum Value {
    /// `bool`.
    Bool(bool),
    /// `int`.
    Int(i64),
    /// `float`.
    Float(f64),
    /// `vec2` to `vec4`, also of whole numbers.
    Vector(Vec<f64>),
    /// `mat2` to `mat4`, as columns.
    Matrix(Vec<Vec<f64>>),
}

/// Why something cannot be computed: what it is about, in words for the user.
pub type Failure = String;

impl Value {
    /// The number, also that of a truth.
    pub fn number(&self) -> Result<f64, Failure> {
        match self {
            Value::Bool(truth) => Ok(f64::from(u8::from(*truth))),
            Value::Int(number) => Ok(*number as f64),
            Value::Float(number) => Ok(*number),
            Value::Vector(_) | Value::Matrix(_) => Err("expected a number, found a vector".into()),
        }
    }

    /// The truth.
    pub fn truth(&self) -> Result<bool, Failure> {
        match self {
            Value::Bool(truth) => Ok(*truth),
            other => Ok(other.number()? != 0.0),
        }
    }

    /// All components, columns of a matrix one after another.
    pub fn components(&self) -> Vec<f64> {
        match self {
            Value::Bool(truth) => vec![f64::from(u8::from(*truth))],
            Value::Int(number) => vec![*number as f64],
            Value::Float(number) => vec![*number],
            Value::Vector(parts) => parts.clone(),
            Value::Matrix(columns) => columns.concat(),
        }
    }

    /// A vector of components, or the number where it is one.
    pub fn of(parts: Vec<f64>) -> Value {
        match parts[..] {
            [number] => Value::Float(number),
            _ => Value::Vector(parts),
        }
    }

    /// The value of a type with all components 0, and what else is made of components: `vec3(...)`, `mat3(...)`, `float(...)`.
    pub fn construct(kind: &str, arguments: &[Value]) -> Result<Value, Failure> {
        let parts: Vec<f64> = arguments.iter().flat_map(Value::components).collect();
        let first = parts.first().copied().unwrap_or(0.0);
        let size = size_of(kind).ok_or_else(|| format!("the type `{kind}` is not known"))?;
        Ok(match (kind, size) {
            ("bool", _) => Value::Bool(first != 0.0),
            ("int" | "uint", _) => Value::Int(first as i64),
            ("float" | "double", _) => Value::Float(first),
            (_, (1, rows)) => match parts.len() {
                0 | 1 => Value::Vector(vec![first; rows]),
                _ if parts.len() >= rows => Value::Vector(parts[..rows].to_vec()),
                _ => return Err(format!("`{kind}` has too few components")),
            },
            (_, (columns, rows)) => Value::matrix(columns, rows, arguments, &parts)?,
        })
    }

    fn matrix(columns: usize, rows: usize, arguments: &[Value], parts: &[f64]) -> Result<Value, Failure> {
        let identity = |factor: f64, i: usize, j: usize| if i == j { factor } else { 0.0 };
        Ok(Value::Matrix(match (arguments, parts.len()) {
            ([Value::Matrix(other)], _) => (0..columns)
                .map(|i| {
                    let at = |j: usize| other.get(i).and_then(|column| column.get(j)).copied();
                    (0..rows).map(|j| at(j).unwrap_or(identity(1.0, i, j))).collect()
                })
                .collect(),
            (_, 0 | 1) => {
                let factor = parts.first().copied().unwrap_or(0.0);
                (0..columns).map(|i| (0..rows).map(|j| identity(factor, i, j)).collect()).collect()
            }
            (_, count) if count >= columns * rows => {
                parts[..columns * rows].chunks(rows).map(<[f64]>::to_vec).collect()
            }
            _ => return Err("a matrix has too few components".into()),
        }))
    }

    /// The value as a variable of a type holds it: whole numbers become numbers.
    pub fn into_kind(self, kind: &str) -> Result<Value, Failure> {
        match (kind, &self) {
            ("float" | "double", Value::Int(number)) => Ok(Value::Float(*number as f64)),
            ("int" | "uint", Value::Float(_)) => Err("expected a whole number".into()),
            _ => match (size_of(kind), &self) {
                (Some((1, 1)), Value::Vector(_) | Value::Matrix(_)) => Err(format!("a vector is given to a `{kind}`")),
                (Some((1, rows)), Value::Vector(parts)) if rows > 1 && parts.len() != rows => {
                    Err(format!("{} components are given to a `{kind}`", parts.len()))
                }
                _ => Ok(self),
            },
        }
    }
}

/// Columns and rows of a type.
pub fn size_of(kind: &str) -> Option<(usize, usize)> {
    let digit = |c: Option<char>| c.and_then(|c| c.to_digit(10)).filter(|n| (2..=4).contains(n)).map(|n| n as usize);
    match kind {
        "bool" | "int" | "uint" | "float" | "double" => Some((1, 1)),
        _ => {
            let stem = kind.trim_start_matches(['i', 'b', 'u', 'd']);
            let mut rest = stem.strip_prefix("vec").or_else(|| stem.strip_prefix("mat"))?.chars();
            let size = digit(rest.next())?;
            let is_whole = rest.next().is_none();
            is_whole.then_some(if stem.starts_with("vec") { (1, size) } else { (size, size) })
        }
    }
}

/// `a op b` with numbers, vectors and matrices in any mix that GLSL allows.
pub fn arithmetic(op: &str, a: &Value, b: &Value) -> Result<Value, Failure> {
    if let ("*", Value::Matrix(columns), Value::Vector(v)) = (op, a, b) {
        return product(columns, v).map(Value::of);
    }
    if let ("*", Value::Vector(v), Value::Matrix(columns)) = (op, a, b) {
        return Ok(Value::of(columns.iter().map(|column| dot(column, v)).collect()));
    }
    if let ("*", Value::Matrix(left), Value::Matrix(right)) = (op, a, b) {
        let columns: Result<Vec<Vec<f64>>, Failure> = right.iter().map(|column| product(left, column)).collect();
        return columns.map(Value::Matrix);
    }
    if let (Value::Int(a), Value::Int(b)) = (a, b) {
        return whole(op, *a, *b);
    }
    let apply = |x: f64, y: f64| match op {
        "+" => Ok(x + y),
        "-" => Ok(x - y),
        "*" => Ok(x * y),
        "/" => Ok(x / y),
        _ => Err(format!("`{op}` needs whole numbers")),
    };
    let rows = if let Value::Matrix(columns) = if matches!(a, Value::Matrix(_)) { a } else { b } {
        columns.first().map_or(1, Vec::len)
    } else {
        0
    };
    let parts = each(a, b, apply)?;
    Ok(if rows > 0 { Value::Matrix(parts.chunks(rows).map(<[f64]>::to_vec).collect()) } else { shaped(a, b, parts) })
}

/// Components of both, where one is a number that number with each component of the other.
pub fn each(a: &Value, b: &Value, f: impl Fn(f64, f64) -> Result<f64, Failure>) -> Result<Vec<f64>, Failure> {
    let (x, y) = (a.components(), b.components());
    let count = x.len().max(y.len());
    if x.len() != y.len() && x.len() != 1 && y.len() != 1 {
        return Err(format!("{} and {} components are joined", x.len(), y.len()));
    }
    (0..count).map(|i| f(x[i % x.len()], y[i % y.len()])).collect()
}

fn shaped(a: &Value, b: &Value, parts: Vec<f64>) -> Value {
    match (a, b) {
        (Value::Vector(_), _) | (_, Value::Vector(_)) => Value::Vector(parts),
        _ => Value::of(parts),
    }
}

fn whole(op: &str, a: i64, b: i64) -> Result<Value, Failure> {
    let value = match op {
        "+" => a.checked_add(b),
        "-" => a.checked_sub(b),
        "*" => a.checked_mul(b),
        "/" => a.checked_div(b),
        "%" => a.checked_rem(b),
        "&" => Some(a & b),
        "|" => Some(a | b),
        "^" => Some(a ^ b),
        "<<" => u32::try_from(b).ok().and_then(|b| a.checked_shl(b)),
        ">>" => u32::try_from(b).ok().and_then(|b| a.checked_shr(b)),
        _ => return Err(format!("`{op}` is not known")),
    };
    value.map(Value::Int).ok_or_else(|| "a whole number has no value".into())
}

/// Scalar product.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

fn product(columns: &[Vec<f64>], v: &[f64]) -> Result<Vec<f64>, Failure> {
    if columns.len() != v.len() {
        return Err("a matrix and a vector of other sizes are multiplied".into());
    }
    let rows = columns.first().map_or(0, Vec::len);
    Ok((0..rows).map(|row| columns.iter().zip(v).map(|(column, x)| column[row] * x).sum()).collect())
}
