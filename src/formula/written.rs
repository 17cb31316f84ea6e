//! A step as a formula for readers: traced with its parameters as symbols wherever its script allows.
//!
//! A script may choose its form by a parameter's value (a loop, `if p.power == 8.0`). Such parameters keep their values, all
//! others stand in the formula by name. Angles stand in radians. What a step remembers is z_{n-1}.

use std::sync::Arc;

use rhai::Map;

use super::library::Library;
use super::step::{ParamKind, ParamValue, StateWidth, Step, StepInputs, Traced, script_expr, script_value};
use crate::diag::Diagnostic;
use crate::expr::{Arena, Differentiator, Function, Port, Type};

/// A step's formulas; inputs are z, c, dr, a direction v, and the parameters that stay symbols.
pub struct Written {
    /// z' of z.
    pub value: Function,
    /// dr' of z and dr, where the step has a rule.
    pub rule: Option<Function>,
    /// J v: how much z' moves where z moves by v, and what is remembered by v_{n-1}.
    pub tangent: Function,
    /// Parameters that have their values in the formulas.
    pub known: Vec<String>,
}

/// The formulas of a step; parameters that are not `given` have their defaults where they cannot be symbols.
pub fn written(
    library: &Library,
    step: &Step,
    arena: &Arc<Arena>,
    given: &[(String, ParamValue)],
) -> Result<Written, Diagnostic> {
    let can_be =
        |kind: &ParamKind| matches!(kind, ParamKind::Float | ParamKind::Angle | ParamKind::Vec3 | ParamKind::Point);
    let mut symbolic: Vec<bool> = step.params.iter().map(|param| can_be(&param.kind)).collect();
    let trial = |symbolic: &[bool]| traced(library, step, &Arc::new(Arena::default()), given, symbolic).map(|_| ());
    if trial(&symbolic).is_err() {
        let wanted = symbolic.clone();
        symbolic.fill(false);
        for i in (0..wanted.len()).filter(|i| wanted[*i]) {
            symbolic[i] = true;
            symbolic[i] = trial(&symbolic).is_ok();
        }
    }
    let (ports, traced) = traced(library, step, arena, given, &symbolic)?;
    let function = |name: &str| Function::new(name, ports.clone());
    let mut value = function("value");
    value.output(if step.is_shape() { "d" } else { "z'" }, traced.z);
    let rule = traced.dr.map(|dr| {
        let mut rule = function("rule");
        rule.output("dr'", dr);
        rule
    });
    let (z, v) = (arena.input(0, ports[0].ty), arena.input(3, ports[3].ty));
    let mut tangent = function("tangent");
    let mut seeds = vec![(z, v)];
    if step.remembers() {
        seeds.push((arena.input(4, ports[4].ty), arena.input(6, ports[6].ty)));
    }
    tangent.output("J v", Differentiator::new(arena, &seeds).derivative(traced.z));
    let known = step.params.iter().zip(&symbolic).filter(|(_, symbolic)| !**symbolic);
    Ok(Written { value, rule, tangent, known: known.map(|(param, _)| param.name.clone()).collect() })
}

fn traced<'g>(
    library: &Library,
    step: &Step,
    arena: &'g Arc<Arena>,
    given: &[(String, ParamValue)],
    symbolic: &[bool],
) -> Result<(Vec<Port>, Traced<'g>), Diagnostic> {
    let ty = if step.state == StateWidth::Four { Type::V4 } else { Type::V3 };
    let mut ports = vec![Port::new("z", ty), Port::new("c", ty), Port::new("dr", Type::F), Port::new("v", ty)];
    if step.remembers() {
        ports.extend([("z_{n-1}", ty), ("dr_{n-1}", Type::F), ("v_{n-1}", ty)].map(|(name, ty)| Port::new(name, ty)));
    }
    let mut params = Map::new();
    for (param, symbolic) in step.params.iter().zip(symbolic) {
        let value = given.iter().find(|(name, _)| *name == param.name).map_or(&param.default, |(_, value)| value);
        let value = if *symbolic {
            let ty = match param.kind {
                ParamKind::Vec3 => Type::V3,
                ParamKind::Point => ty,
                _ => Type::F,
            };
            let input = arena.input(ports.len() as u16, ty);
            ports.push(Port::new(param.name.clone(), ty));
            script_expr(&ParamKind::Float, input)
        } else {
            script_value(arena, &param.kind, value)
        };
        params.insert(param.name.as_str().into(), value);
    }
    if step.is_shape() {
        let z = step.trace_distance(&library.engine, &library.sources, arena, arena.input(0, ty), &params)?;
        return Ok((ports, Traced { z, dr: None }));
    }
    let before = step.remembers().then(|| Traced { z: arena.input(4, ty), dr: Some(arena.input(5, Type::F)) });
    let inputs = StepInputs { z: arena.input(0, ty), c: arena.input(1, ty), dr: Some(arena.input(2, Type::F)), before };
    let traced = step.trace(&library.engine, &library.sources, arena, inputs, &params)?;
    Ok((ports, traced))
}
