//! Maps applied to a state, and what their steps remember of the time before.

use std::sync::Arc;

use rhai::Map;

use super::{ComposeResult, Composer};
use crate::expr::{Arena, Expr, Function, Type};
use crate::formula::script::base_scope;
use crate::formula::step::{ParamKind, ScalarRule, Step, StepInputs, Traced, script_expr, script_value};
use crate::formula::symbolic::to_dynamic;
use crate::graph::{Condition, Constant, MapTree, NodeKind, NodeRef, ParamInput, resolve_schedule};

/// The steps of a node and of all it is wired to.
pub(super) fn steps_of<'g>(composer: &'g Composer, root: NodeRef) -> Vec<&'g Step> {
    step_nodes(composer, root).into_iter().map(|(_, step)| step).collect()
}

/// Nodes of the steps that remember what they had before.
pub(super) fn remembering(composer: &Composer, root: NodeRef) -> Vec<NodeRef> {
    step_nodes(composer, root).into_iter().filter(|(_, step)| step.remembers()).map(|(node, _)| node).collect()
}

fn step_nodes<'g>(composer: &'g Composer, root: NodeRef) -> Vec<(NodeRef, &'g Step)> {
    let mut stack = vec![root];
    let mut seen = vec![false; composer.graph.nodes.len()];
    let mut steps = Vec::new();
    while let Some(of) = stack.pop() {
        if std::mem::replace(&mut seen[of.0], true) {
            continue;
        }
        let kind = &composer.graph.node(of).kind;
        if let NodeKind::Step { step, .. } = kind {
            steps.push((of, &**step));
        }
        stack.extend(kind.wires());
    }
    steps
}

/// The weakest scalar rule of a map's steps; `None` if one of them has none.
pub fn scalar_rules(composer: &Composer, root: NodeRef) -> Option<ScalarRule> {
    let rules = steps_of(composer, root).into_iter().map(|s| s.scalar_rule).collect::<Option<Vec<_>>>()?;
    Some(if rules.contains(&ScalarRule::Heuristic) { ScalarRule::Heuristic } else { ScalarRule::Exact })
}

/// Value and scalar derivative of a map.
pub(super) type Moved<'g> = Traced<'g>;

/// What went into each step that remembers the last time that it ran.
#[derive(Clone)]
pub(super) struct Memory<'g> {
    steps: Vec<(NodeRef, Moved<'g>)>,
    /// Coordinates whose folds are followed: 0 if the last one that moved it found it on the positive side, 1 on the negative.
    pub(super) sides: Vec<(u8, Expr<'g>)>,
}

impl<'g> Memory<'g> {
    pub(super) fn of(values: impl Iterator<Item = (NodeRef, Moved<'g>)>) -> Memory<'g> {
        Memory { steps: values.collect(), sides: Vec::new() }
    }

    /// Zeros for the steps of a map, of the types that `like` has.
    pub(super) fn nothing(composer: &Composer<'g>, root: NodeRef, like: Moved<'g>) -> Memory<'g> {
        let zero = Moved { z: like.z.lift(0.0), dr: like.dr.map(|dr| dr.lift(0.0)) };
        Memory::of(remembering(composer, root).into_iter().map(|node| (node, zero)))
    }

    /// In the order in which they were given.
    pub(super) fn values(&self) -> impl Iterator<Item = Moved<'g>> {
        self.steps.iter().map(|(_, value)| *value)
    }

    /// Remembers what goes into a node, and gives what went in before; `None` if the node does not remember.
    fn swap(&mut self, node: NodeRef, now: Moved<'g>) -> Option<Moved<'g>> {
        let (_, value) = self.steps.iter_mut().find(|(known, _)| *known == node)?;
        Some(std::mem::replace(value, now))
    }

    /// Notes on which side of a fold coordinates were that it moved.
    fn note_fold(&mut self, from: Expr<'g>, to: Expr<'g>) {
        for (axis, side) in &mut self.sides {
            let (from, to) = (from.component(*axis), to.component(*axis));
            let found = |x: f64| side.lift(x);
            *side = to.lt(from).select(found(0.0), from.lt(to).select(found(1.0), *side));
        }
    }

    /// Where `holds` is false, what the other branch left.
    fn choose(&mut self, holds: Expr<'g>, other: &Memory<'g>) {
        for ((_, side), (_, otherwise)) in self.sides.iter_mut().zip(&other.sides) {
            *side = holds.select(*side, *otherwise);
        }
        for ((_, value), otherwise) in self.steps.iter_mut().zip(other.values()) {
            if value.z.id != otherwise.z.id || value.dr.map(|dr| dr.id) != otherwise.dr.map(|dr| dr.id) {
                *value = chosen(holds, *value, otherwise);
            }
        }
    }
}

/// What an iteration adds, from the start point's constant.
pub(super) fn fixed_constant<'a>(arena: &'a Arena, constant: Constant, c: Expr<'a>) -> Expr<'a> {
    let fixed = |v: [f64; 4]| arena.constant(c.ty(), v);
    match constant {
        Constant::Mandelbrot => c,
        Constant::Julia(v) => fixed(v),
        Constant::Mix(v, amount) => c * (1.0 - amount) + fixed(v) * amount,
        Constant::Off => c.lift(0.0),
    }
}

/// Applies maps one after the other, each as its first iteration.
pub(super) fn apply_all<'a>(
    composer: &Composer<'a>,
    nodes: &[NodeRef],
    mut moved: Moved<'a>,
    c: Expr<'a>,
) -> ComposeResult<Moved<'a>> {
    let n = composer.arena.f(0.0);
    for node in nodes {
        let (maps, _) = resolve_schedule(composer.graph, *node, Constant::Off, 1);
        let mut memory = Memory::nothing(composer, *node, moved);
        moved = apply(composer, &maps[0].map, moved, c, n, &mut memory)?;
    }
    Ok(moved)
}

/// Applies a map to a state; steps that remember find what they had in `memory`, and leave there what they have now.
pub(super) fn apply<'a>(
    composer: &Composer<'a>,
    map: &MapTree,
    input: Moved<'a>,
    c: Expr<'a>,
    n: Expr<'a>,
    memory: &mut Memory<'a>,
) -> ComposeResult<Moved<'a>> {
    match map {
        MapTree::Identity => Ok(input),
        MapTree::Step(node) => apply_step(composer, *node, input, c, n, memory),
        MapTree::Sequence(parts) => {
            parts.iter().try_fold(input, |moved, part| apply(composer, part, moved, c, n, memory))
        }
        MapTree::Repeat(of, times) => (0..*times).try_fold(input, |moved, _| apply(composer, of, moved, c, n, memory)),
        MapTree::Blend(a, b, weight) => {
            let a = apply(composer, a, input, c, n, memory)?;
            let b = apply(composer, b, input, c, n, memory)?;
            let z = a.z * (1.0 - weight) + b.z * *weight;
            let dr = a.dr.zip(b.dr).map(|(a, b)| a * (1.0 - weight).abs() + b * weight.abs());
            Ok(Moved { z, dr })
        }
        MapTree::Choose(when, then, otherwise) => {
            let holds = condition(*when, input.z);
            let mut other = memory.clone();
            let then = apply(composer, then, input, c, n, memory)?;
            let otherwise = apply(composer, otherwise, input, c, n, &mut other)?;
            memory.choose(holds, &other);
            Ok(chosen(holds, then, otherwise))
        }
    }
}

fn chosen<'g>(holds: Expr<'g>, then: Moved<'g>, otherwise: Moved<'g>) -> Moved<'g> {
    let dr = then.dr.zip(otherwise.dr).map(|(a, b)| holds.select(a, b));
    Moved { z: holds.select(then.z, otherwise.z), dr }
}

pub(super) fn condition<'g>(when: Condition, z: Expr<'g>) -> Expr<'g> {
    let arena = z.arena;
    match when {
        Condition::RadiusBelow(limit) => z.dot(z).lt(arena.f(limit * limit)),
        Condition::RadiusAbove(limit) => arena.f(limit * limit).lt(z.dot(z)),
        Condition::Negative(axis) => z.component(axis.min(z.ty().width - 1)).lt(arena.f(0.0)),
        Condition::Positive(axis) => arena.f(0.0).lt(z.component(axis.min(z.ty().width - 1))),
        // Conditions on the iteration number were decided by the schedule.
        Condition::IterationBelow(_) | Condition::IterationEvery(_) => arena.bool(true),
    }
}

fn apply_step<'a>(
    composer: &Composer<'a>,
    node: NodeRef,
    input: Moved<'a>,
    c: Expr<'a>,
    n: Expr<'a>,
    memory: &mut Memory<'a>,
) -> ComposeResult<Moved<'a>> {
    let place = composer.graph.node(node);
    let NodeKind::Step { step, params } = &place.kind else {
        return Ok(input); // the schedule makes `MapTree::Step` of step nodes only
    };
    let map = param_map(composer, step, params, n);
    let narrow = step.state == crate::formula::step::StateWidth::Three && input.z.ty().width == 4;
    let before = input.dr;
    let remembered = memory.swap(node, input);
    let inputs = StepInputs { z: input.z, c, dr: input.dr, before: remembered };
    let library = composer.library;
    let mut moved = step
        .trace(&library.engine, &library.sources, composer.arena, inputs, &map)
        .map_err(|error| error.label(place.span, format!("used by the node `{}`", place.name)))?;
    if step.group == "fold" {
        memory.note_fold(input.z, moved.z);
    }
    if narrow {
        // w is left as it was, so the derivative cannot shrink below what it had.
        moved.dr = moved.dr.zip(before).map(|(after, before)| after.max(before));
    }
    Ok(moved)
}

/// Whether the map of a step node depends on the constant, with the parameters that it has. `width` is the state's.
pub(super) fn reads_constant(composer: &Composer, node: NodeRef, width: u8) -> ComposeResult<bool> {
    // Other arenas would number their nodes otherwise.
    let arena = Arc::new(Arena::default());
    let composer = Composer { arena: &arena, library: composer.library, graph: composer.graph };
    let ty = if width == 4 { Type::V4 } else { Type::V3 };
    let input = Moved { z: arena.input(0, ty), dr: None };
    let c = arena.input(1, ty);
    let mut memory = Memory::nothing(&composer, node, input);
    let moved = apply_step(&composer, node, input, c, arena.input(2, Type::F), &mut memory)?;
    let mut function = Function::new("read", Vec::new());
    function.output("z", moved.z);
    Ok(function.nodes(&arena).contains(&c.id))
}

/// A step's parameters as its script sees them.
pub(super) fn param_map<'a>(composer: &Composer<'a>, step: &Step, params: &[ParamInput], n: Expr<'a>) -> Map {
    // Expressions of the iteration number are traced, too, and before the step is.
    composer.library.engine.trace(composer.arena, &composer.library.sources, step.text);
    let mut map = Map::new();
    for (param, value) in step.params.iter().zip(params) {
        map.insert(param.name.as_str().into(), param_value(composer, &param.kind, value, n));
    }
    map
}

fn param_value<'a>(composer: &Composer<'a>, kind: &ParamKind, value: &ParamInput, n: Expr<'a>) -> rhai::Dynamic {
    match value {
        ParamInput::Known(value) => script_value(composer.arena, kind, value),
        ParamInput::OfIteration(text) => {
            let mut scope = base_scope();
            for param in &composer.graph.params {
                scope.push_constant(param.name.clone(), param.value);
            }
            scope.push_constant_dynamic("n", to_dynamic(n));
            let value = composer.library.engine.expression(text, &mut scope).unwrap_or(rhai::Dynamic::UNIT);
            match (value.read_lock::<crate::formula::symbolic::Symbol>(), value.as_float()) {
                (Some(symbol), _) => match symbol.expr(composer.arena) {
                    Some(expr) => script_expr(kind, expr),
                    None => rhai::Dynamic::from_float(f64::NAN),
                },
                (None, Ok(x)) => script_expr(kind, composer.arena.f(x)),
                _ => rhai::Dynamic::from_float(value.as_int().map_or(f64::NAN, |i| i as f64)),
            }
        }
    }
}
