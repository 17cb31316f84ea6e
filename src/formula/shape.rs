//! Step files that are shapes: `fn distance(z, p)` instead of `fn step(z, c, p)`, a field wherever one may stand.

use std::sync::Arc;

use rhai::{AST, Dynamic, Map};

use super::script::ScriptEngine;
use super::step::{StateWidth, Step};
use super::symbolic::Symbol;
use crate::diag::{Diagnostic, Diagnostics, Sources, Span};
use crate::expr::{Arena, Expr, Type};

/// What the distance of a shape is worth. Of both kinds the slope is nowhere above 1, so nothing of the shape is nearer.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum ShapeDistance {
    /// Outside it is the distance to the nearest point of the shape.
    Exact,
    /// It may be less.
    Bound,
}

/// Whether a text is that of a step file: it defines `fn step` or `fn distance`.
pub fn is_step_text(text: &str) -> bool {
    text.contains("fn step(") || text.contains("fn distance(")
}

impl Step {
    /// Whether the file describes a shape, not a map.
    pub fn is_shape(&self) -> bool {
        self.distance.is_some()
    }

    /// Traces the distance of a shape from `z`, negative inside; a shape of three components sees the first three of four.
    pub fn trace_distance<'g>(
        &self,
        engine: &ScriptEngine,
        sources: &Sources,
        arena: &'g Arc<Arena>,
        z: Expr<'g>,
        params: &Map,
    ) -> Result<Expr<'g>, Diagnostic> {
        engine.trace(arena, sources, self.text);
        let seen = if self.state == StateWidth::Three && z.ty().width == 4 { z.xyz() } else { z };
        let args = vec![Dynamic::from(Symbol::new(seen)), Dynamic::from(params.clone())];
        let result = engine.call(sources, self.text, &self.ast, "distance", args)?;
        let distance = self.returned(sources, arena, &result, Type::F, "distance");
        arena.set_span(Span::NONE);
        distance
    }
}

/// Whether a file has the function of a shape.
pub(super) fn has_distance(ast: &AST) -> bool {
    ast.iter_functions().any(|f| f.name == "distance" && f.params.len() == 2)
}

/// Reports a shape file that lacks its function, or that has those of a map.
pub(super) fn check_shape(ast: &AST, span: Span, has_rule: bool, d: &mut Diagnostics) {
    if !has_distance(ast) {
        d.push(Diagnostic::error("the file has no `fn distance(z, p)`").label(span, "described here as a shape"));
    }
    let has_step = ast.iter_functions().any(|f| f.name == "step" && (3..=4).contains(&f.params.len()));
    if has_step || has_rule {
        let message = "a file is either a map, with `fn step`, or a shape, with `fn distance`";
        d.push(Diagnostic::error(message).label(span, "").help("leave out `distance`, or `fn step` and `scalar_rule`"));
    }
}
