//! What a material reads and returns with certain parameters, found by tracing it once.

use std::sync::Arc;

use super::{INPUTS, Material, OUTPUTS};
use crate::diag::{Diagnostic, Sources};
use crate::expr::{Arena, Expr, Function, Port};
use crate::formula::script::ScriptEngine;
use crate::formula::step::ParamValue;

/// What a material reads and returns.
#[derive(Clone, PartialEq, Debug)]
pub struct Study {
    /// Whether it reads each of [`INPUTS`].
    pub reads: Vec<bool>,
    /// Of each of [`OUTPUTS`]: nothing where the material leaves it out, else its value where that is the same everywhere.
    pub returns: Vec<Option<Option<[f64; 3]>>>,
}

impl Study {
    /// Whether an input is read.
    pub fn reads(&self, input: &str) -> bool {
        INPUTS.iter().zip(&self.reads).any(|((name, ..), reads)| *name == input && *reads)
    }

    /// The value of an output that is the same everywhere, also where the material leaves it out.
    pub fn constant(&self, output: usize) -> Option<[f64; 3]> {
        self.returns[output].unwrap_or(Some([OUTPUTS[output].2; 3]))
    }
}

impl Material {
    /// Traces the material with parameters, and looks at what came of it.
    ///
    /// Errors: those of its script, with their place.
    pub fn study(
        &self,
        engine: &ScriptEngine,
        sources: &Sources,
        params: &[(String, ParamValue)],
    ) -> Result<Study, Diagnostic> {
        let arena = Arc::new(Arena::default());
        let ports = INPUTS.iter().map(|(name, ty, _)| Port::new(*name, *ty)).collect();
        let mut function = Function::new("material", ports);
        let inputs = function.input_exprs(&arena);
        let outputs = self.trace((engine, sources), &arena, &inputs, &self.script_params(&arena, params))?;
        for (output, (name, ..)) in outputs.iter().zip(OUTPUTS) {
            if let Some(value) = output {
                function.output(*name, *value);
            }
        }
        let constant = |value: Expr<'_>| {
            let c = value.as_constant()?;
            Some(if value.ty().width == 1 { [c[0]; 3] } else { [c[0], c[1], c[2]] })
        };
        Ok(Study {
            reads: (0..INPUTS.len()).map(|i| function.reads(&arena, i)).collect(),
            returns: outputs.iter().map(|output| output.map(constant)).collect(),
        })
    }
}
