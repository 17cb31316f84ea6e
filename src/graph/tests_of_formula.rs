//! The tests that a formula file holds.

use super::Method;
use super::read::Reader;
use crate::diag::{Diagnostic, Span};
use crate::formula::decode::{Fields, FromValue};
use crate::formula::value::{Value, ValueKind};

/// One test with its place in the file.
#[derive(Clone, Debug)]
pub struct FormulaTest {
    /// Place in the file.
    pub span: Span,
    /// What is tested.
    pub kind: TestKind,
}

/// A point of space, and its fourth component where a test gives one.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct TestPoint {
    /// The point.
    pub at: [f64; 3],
    /// Its w; replaces the orbit's `slice`.
    pub w: Option<f64>,
}

impl TestPoint {
    /// All components that are given.
    pub fn components(&self) -> Vec<f64> {
        self.at.into_iter().chain(self.w).collect()
    }
}

impl TestKind {
    /// The fourth component of the point that is tested, where it has one.
    pub fn w(&self) -> Option<f64> {
        match self {
            TestKind::Inside(point) | TestKind::Outside(point) => point.w,
            TestKind::Orbit { point, .. } | TestKind::Estimate { point, .. } => point.w,
            TestKind::Ray { origin, .. } => origin.w,
            TestKind::Symmetric(_) | TestKind::AgreesOnBackends | TestKind::NeverAbove { .. } => None,
        }
    }
}

/// What a test asks for.
#[derive(Clone, PartialEq, Debug)]
pub enum TestKind {
    /// The orbit of the point does not escape.
    Inside(TestPoint),
    /// The orbit of the point escapes.
    Outside(TestPoint),
    /// The state after this many iterations (of an orbit that is not stopped by escaping).
    Orbit {
        /// The point.
        point: TestPoint,
        /// Iterations done.
        iterations: u32,
        /// Right answer.
        expect: Vec<f64>,
        /// Greatest difference: absolute below 1, relative above.
        tolerance: f64,
    },
    /// The distance estimate at a point.
    Estimate {
        /// The point.
        point: TestPoint,
        /// Method; the chosen one where absent.
        method: Option<Method>,
        /// Right answer.
        expect: f64,
        /// Greatest difference: absolute below 1, relative above.
        tolerance: f64,
    },
    /// The depth at which a ray hits; `None` for a miss.
    Ray {
        /// Start of the ray.
        origin: TestPoint,
        /// Unit direction of the ray.
        direction: [f64; 3],
        /// Right answer.
        expect: Option<f64>,
        /// Greatest difference: absolute below 1, relative above.
        tolerance: f64,
    },
    /// The set is the same after this change of a point, tested at random points.
    Symmetric(Symmetry),
    /// Estimates, membership and depths agree on every back end.
    AgreesOnBackends,
    /// No estimate is above `1 + factor` times the distance that brute force finds.
    NeverAbove {
        /// Greatest excess over the true distance, as a share of it.
        factor: f64,
    },
}

/// A change of a point that leaves the set as it is.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Symmetry {
    /// One coordinate changes its sign.
    Mirror(u8),
    /// Two coordinates change places.
    Swap(u8, u8),
    /// A turn about an axis of length 1, in radians.
    Turn([f64; 3], f64),
}

/// Kinds of test, as messages list them.
const KINDS: &[&str] =
    &["Inside", "Outside", "Orbit", "Estimate", "Ray", "Symmetric", "AgreesOnBackends", "NeverAbove"];

/// Reads one test.
pub(super) fn read_test(reader: &mut Reader, value: &Value) -> Option<FormulaTest> {
    let Some(name) = value.name() else {
        let message = format!("expected a test, found {}", value.describe());
        reader
            .d
            .push(Diagnostic::error(message).label(value.span, "").help(format!("tests are: {}", KINDS.join(", "))));
        return None;
    };
    let kind = match name.text.as_str() {
        "Inside" => TestKind::Inside(only_point(reader, value)?),
        "Outside" => TestKind::Outside(only_point(reader, value)?),
        "AgreesOnBackends" => TestKind::AgreesOnBackends,
        "Symmetric" => TestKind::Symmetric(read_symmetry(reader, value)?),
        "Orbit" | "Estimate" | "Ray" | "NeverAbove" => read_fields(reader, &name.text, value)?,
        other => {
            let diagnostic = Diagnostic::error(format!("unknown test `{other}`"))
                .label(name.span, "")
                .did_you_mean(other, KINDS.iter().copied())
                .help(format!("tests are: {}", KINDS.join(", ")));
            reader.d.push(diagnostic);
            return None;
        }
    };
    Some(FormulaTest { span: value.span, kind })
}

fn read_fields(reader: &mut Reader, name: &str, value: &Value) -> Option<TestKind> {
    let mut fields = Fields::new(value, "a test", reader.d)?;
    let tolerance = fields.optional_value("tolerance").map_or(Some(1e-6), |v| reader.number(v, 0.0, 1e6))?;
    let point = |reader: &mut Reader, fields: &mut Fields, field: &'static str| match fields.optional_value(field) {
        Some(v) => read_point(reader, v),
        None => {
            reader.d.push(Diagnostic::error(format!("the test needs `{field}: (x, y, z)`")).label(fields.span(), ""));
            None
        }
    };
    let kind = match name {
        "Orbit" => {
            let point = point(reader, &mut fields, "point");
            let iterations = reader.required_number(&mut fields, "iterations", 0.0, 1000.0);
            let expect = fields.optional_value("expect").and_then(|v| components(reader, v));
            TestKind::Orbit { point: point?, iterations: iterations? as u32, expect: expect?, tolerance }
        }
        "Estimate" => {
            let point = point(reader, &mut fields, "point");
            let methods = Method::ALL.map(|m| (m.name(), m));
            let method = fields.optional_value("method").map(|v| reader.word(v, "method", &methods));
            let expect = reader.required_number(&mut fields, "expect", 0.0, 1e9);
            let method = match method {
                Some(None) => return None,
                other => other.flatten(),
            };
            TestKind::Estimate { point: point?, method, expect: expect?, tolerance }
        }
        "Ray" => {
            let origin = point(reader, &mut fields, "origin");
            let direction = fields.optional_value("direction").and_then(|v| reader.direction(v));
            let misses = fields.or("misses", false, reader.d);
            let expect = fields.optional_value("t").map(|v| reader.number(v, 0.0, 1e9));
            if misses == expect.is_some() || direction.is_none() {
                let message = "a `Ray` test needs `direction` and either `t: depth` or `misses: true`";
                reader.d.push(Diagnostic::error(message).label(fields.span(), ""));
                return None;
            }
            let expect = match expect {
                Some(None) => return None,
                other => other.flatten(),
            };
            TestKind::Ray { origin: origin?, direction: direction?, expect, tolerance }
        }
        _ => TestKind::NeverAbove { factor: reader.required_number(&mut fields, "factor", 0.0, 1e6)? },
    };
    fields.finish(reader.d);
    Some(kind)
}

/// A point of three or four components.
fn read_point(reader: &mut Reader, value: &Value) -> Option<TestPoint> {
    match &value.kind {
        ValueKind::List(items) | ValueKind::Tuple { name: None, items } if items.len() == 4 => {
            let w = reader.number(&items[3], -1e9, 1e9);
            let at = reader.vector(&Value::new(value.span, ValueKind::List(items[..3].to_vec())), -1e9, 1e9);
            Some(TestPoint { at: at?, w: Some(w?) })
        }
        _ => reader.vector(value, -1e9, 1e9).map(|at| TestPoint { at, w: None }),
    }
}

fn only_point(reader: &mut Reader, value: &Value) -> Option<TestPoint> {
    match &value.kind {
        ValueKind::Tuple { items, .. } if items.len() == 1 => read_point(reader, &items[0]),
        ValueKind::Tuple { items, .. } if matches!(items.len(), 3 | 4) => {
            read_point(reader, &Value::new(value.span, ValueKind::List(items.clone())))
        }
        _ => {
            reader.d.push(Diagnostic::error("the test needs a point").label(value.span, "such as Inside((0, 0, 0))"));
            None
        }
    }
}

fn components(reader: &mut Reader, value: &Value) -> Option<Vec<f64>> {
    match &value.kind {
        ValueKind::List(items) | ValueKind::Tuple { name: None, items } => {
            items.iter().map(|item| f64::from_value(item, reader.d)).collect()
        }
        _ => Vec::<f64>::from_value(value, reader.d),
    }
}

/// `Symmetric(Mirror("x"))`, `Symmetric(Swap("x", "y"))` or `Symmetric(Turn(axis: (0, 0, 1), angle: 90))`.
fn read_symmetry(reader: &mut Reader, value: &Value) -> Option<Symmetry> {
    let inner = match &value.kind {
        ValueKind::Tuple { items, .. } if items.len() == 1 => &items[0],
        _ => value,
    };
    let coordinates = [("x", 0), ("y", 1), ("z", 2)];
    match (&inner.kind, inner.name().map(|n| n.text.as_str())) {
        (ValueKind::Tuple { items, .. }, Some("Mirror")) if items.len() == 1 => {
            reader.word(&items[0], "coordinate", &coordinates).map(Symmetry::Mirror)
        }
        (ValueKind::Tuple { items, .. }, Some("Swap")) if items.len() == 2 => {
            let first = reader.word(&items[0], "coordinate", &coordinates);
            let second = reader.word(&items[1], "coordinate", &coordinates);
            Some(Symmetry::Swap(first?, second?))
        }
        (ValueKind::Struct { .. }, Some("Turn")) => {
            let mut fields = Fields::new(inner, "a turn", reader.d)?;
            let axis = fields.optional_value("axis").and_then(|v| reader.direction(v));
            let angle = reader.required_number(&mut fields, "angle", -360.0, 360.0);
            fields.finish(reader.d);
            Some(Symmetry::Turn(axis?, angle?.to_radians()))
        }
        _ => {
            let help = "write Symmetric(Mirror(\"x\")), Symmetric(Swap(\"x\", \"y\")) or Symmetric(Turn(axis: (0, 0, 1), angle: 90))";
            reader.d.push(Diagnostic::error("unknown symmetry").label(inner.span, "").help(help));
            None
        }
    }
}
