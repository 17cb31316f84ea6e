//! What a step's file states for proofs: functions that return bounds.

use std::sync::Arc;

use rhai::{Array, Dynamic, Map};

use super::{StateWidth, Step};
use crate::diag::{Diagnostic, Sources, Span};
use crate::expr::{Arena, Expr, Type};
use crate::formula::script::ScriptEngine;
use crate::formula::symbolic::Symbol;

impl Step {
    /// Traces one of the step's functions that return a number: `stretch` and `growth` of `(z, e, p)`, `bend` of
    /// `(z, u, e, p)`, `tube` of `(z, u, e, w, p)` or `pull_back` of `(t, p)`. `None` if the file has none of this name. In a
    /// four-component orbit a step of three components sees the first three.
    pub fn trace_number<'g>(
        &self,
        engine: &ScriptEngine,
        sources: &Sources,
        arena: &'g Arc<Arena>,
        function: &str,
        arguments: &[Expr<'g>],
        params: &Map,
    ) -> Result<Option<Expr<'g>>, Diagnostic> {
        let Some(result) = self.call(engine, sources, arena, function, arguments, params)? else { return Ok(None) };
        let number = self.returned(sources, arena, &result, Type::F, function);
        arena.set_span(Span::NONE);
        number.map(Some)
    }

    /// Traces `chord` of `(z, v, l, e, p)`, which returns a list of a vector and a number. `None` if the file has none,
    /// and of steps that leave a component of their argument alone.
    pub fn trace_chord<'g>(
        &self,
        engine: &ScriptEngine,
        sources: &Sources,
        arena: &'g Arc<Arena>,
        arguments: &[Expr<'g>; 4],
        params: &Map,
    ) -> Result<Option<[Expr<'g>; 2]>, Diagnostic> {
        let wide = arguments[0].ty();
        if self.state == StateWidth::Three && wide.width == 4 {
            return Ok(None);
        }
        let Some(result) = self.call(engine, sources, arena, "chord", arguments, params)? else { return Ok(None) };
        let parts: Array = result.into_array().unwrap_or_default();
        let part = |i: usize, ty: Type| {
            let value = parts.get(i).cloned().unwrap_or(Dynamic::UNIT);
            self.returned(sources, arena, &value, ty, "chord")
        };
        let chord = [part(0, wide), part(1, Type::F)];
        arena.set_span(Span::NONE);
        let [middle, radius] = chord;
        Ok(Some([middle?, radius?]))
    }

    fn call<'g>(
        &self,
        engine: &ScriptEngine,
        sources: &Sources,
        arena: &'g Arc<Arena>,
        function: &str,
        arguments: &[Expr<'g>],
        params: &Map,
    ) -> Result<Option<Dynamic>, Diagnostic> {
        if !self.has_function(function, arguments.len() + 1) {
            return Ok(None);
        }
        engine.trace(arena, sources, self.text);
        let narrow = |e: &Expr<'g>| if self.state == StateWidth::Three && e.ty().width == 4 { e.xyz() } else { *e };
        let mut args: Vec<Dynamic> = arguments.iter().map(|e| Dynamic::from(Symbol::new(narrow(e)))).collect();
        args.push(Dynamic::from(params.clone()));
        engine.call(sources, self.text, &self.ast, function, args).map(Some)
    }
}
