//! Reading what an orbit adds in each iteration.

use super::Reader;
use crate::diag::Diagnostic;
use crate::formula::decode::Fields;
use crate::formula::value::{Value, ValueKind};
use crate::graph::settings::Constant;

impl Reader<'_> {
    /// `Mandelbrot`, `Julia((x, y, z))`, `Mix(julia: (x, y, z), amount: t)` or `Off`; points may have four components.
    pub(in crate::graph) fn constant(&mut self, value: &Value) -> Option<Constant> {
        match &value.kind {
            ValueKind::Variant(name) if name.text == "Mandelbrot" => Some(Constant::Mandelbrot),
            ValueKind::Variant(name) if name.text == "Off" => Some(Constant::Off),
            ValueKind::Tuple { name: Some(name), items } if name.text == "Julia" => match items.as_slice() {
                [point] => self.point(point).map(Constant::Julia),
                [_, _, _] | [_, _, _, _] => {
                    let point = Value::new(value.span, ValueKind::List(items.clone()));
                    self.point(&point).map(Constant::Julia)
                }
                _ => {
                    self.d.push(Diagnostic::error("`Julia` needs a point").label(value.span, "write Julia((x, y, z))"));
                    None
                }
            },
            ValueKind::Struct { name: Some(name), .. } if name.text == "Mix" => {
                let mut fields = Fields::new(value, "a mixed constant", self.d)?;
                let julia = fields.optional_value("julia").and_then(|v| self.point(v));
                let amount = fields.optional_value("amount").and_then(|v| self.number(v, 0.0, 1.0));
                let span = fields.span();
                fields.finish(self.d);
                if julia.is_none() || amount.is_none() {
                    self.d.push(Diagnostic::error("`Mix` needs `julia: (x, y, z)` and `amount: 0.5`").label(span, ""));
                }
                Some(Constant::Mix(julia?, amount?))
            }
            _ => {
                let expected = "Mandelbrot, Julia((x, y, z)), Mix(julia: (x, y, z), amount: 0.5) or Off";
                let message = format!("expected a constant, found {}", value.describe());
                self.d
                    .push(Diagnostic::error(message).label(value.span, "").help(format!("constants are: {expected}")));
                None
            }
        }
    }
}
