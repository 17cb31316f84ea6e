//! What a graph will be composed of, counted before anything is made: a node that is wired twice is composed twice.
//!
//! Every command reads graphs through here, so all of them take and refuse the same formulas.

use std::collections::HashMap;
use std::sync::Arc;

use rhai::Map;

use super::schedule::depends_on_iteration;
use super::{Graph, NodeKind, NodeRef, ParamInput, Tiling};
use crate::diag::{Diagnostic, Diagnostics};
use crate::expr::{Arena, Type};
use crate::formula::embedded;
use crate::formula::library::Library;
use crate::formula::step::{StateWidth, Step, StepInputs, StepParam, script_value};
use crate::formula::symbolic::to_dynamic;

/// Expressions that the maps and fields of one formula may have, each counted wherever it is composed.
pub(super) const MAX_EXPRESSIONS: f64 = 2_400.0;
/// Nodes that the maps of all iterations may have together, where they are not all the same.
const MAX_SCHEDULED: f64 = 2e6;
/// Expressions of a primitive, of a part that is joined, and of a way into another frame, about.
const PRIMITIVE: f64 = 8.0;
const JOINED: f64 = 2.0;
const PLACED: f64 = 4.0;
/// How often the map of a warp is composed: for the way in and for the way of the distance back.
const WARPED: f64 = 5.0;
/// Built-in steps are traced for their size only where a graph holds more than so many of them.
const FEW: f64 = 16.0;

/// Whether a graph without cycles is within the budget; reports the node where it is not.
pub(super) fn check(library: &Library, graph: &Graph, d: &mut Diagnostics) -> bool {
    let mut count = Count { library, graph, exact: false, known: HashMap::new(), mistakes: Vec::new() };
    let is_few = count.node(graph.output, false).total() <= FEW;
    if !is_few || graph.nodes.iter().any(|node| step_of(&node.kind).is_some_and(|step| !is_builtin(library, step))) {
        count = Count { exact: true, known: HashMap::new(), ..count };
    }
    count.node(graph.output, false);
    if !count.mistakes.is_empty() {
        d.extend(count.mistakes);
        return false;
    }
    // Of all that are too large the one that holds no other: the first where wires meet too often.
    let too_large = |size: &Size| size.expressions > MAX_EXPRESSIONS || size.scheduled > MAX_SCHEDULED;
    let found = count.known.iter().filter(|(_, size)| too_large(size)).map(|((node, _), size)| (*node, *size));
    let Some((node, size)) = found.min_by(|a, b| a.1.total().total_cmp(&b.1.total()).then(a.0.cmp(&b.0))) else {
        return true;
    };
    let node = graph.node(node);
    let message = format!("the node `{}` is made of {}", node.name, size);
    let help = match step_of(&node.kind) {
        Some(_) => "unroll fewer loops in the step",
        None => "a node that is wired several times is composed as often: use Repeat less, or wire less",
    };
    d.push(Diagnostic::error(message).label(node.span, format!("{MAX_EXPRESSIONS} are allowed")).help(help));
    false
}

/// What a node is composed of.
#[derive(Clone, Copy, Default)]
struct Size {
    /// Expressions.
    expressions: f64,
    /// Nodes of the maps of all iterations.
    scheduled: f64,
    /// Steps in the map.
    steps: f64,
}

impl Size {
    fn of(expressions: f64, steps: f64) -> Size {
        Size { expressions, scheduled: 0.0, steps }
    }

    fn total(self) -> f64 {
        self.expressions.max(self.scheduled * (MAX_EXPRESSIONS / MAX_SCHEDULED))
    }

    fn times(self, factor: f64) -> Size {
        Size { expressions: self.expressions * factor, scheduled: self.scheduled * factor, steps: self.steps * factor }
    }

    fn and(self, other: Size) -> Size {
        Size {
            expressions: self.expressions + other.expressions,
            scheduled: self.scheduled + other.scheduled,
            steps: self.steps + other.steps,
        }
    }
}

impl std::fmt::Display for Size {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let shown = |x: f64| if x < 1e9 { format!("{x:.0}") } else { format!("{x:.1e}") };
        match self.expressions > MAX_EXPRESSIONS {
            true => write!(f, "{} expressions, more than a formula may have", shown(self.expressions)),
            false => write!(f, "{} nodes in all iterations together", shown(self.scheduled)),
        }
    }
}

/// The step of a node that is one.
fn step_of(kind: &NodeKind) -> Option<&Step> {
    match kind {
        NodeKind::Step { step, .. } | NodeKind::Shape { step, .. } => Some(step),
        _ => None,
    }
}

fn is_builtin(library: &Library, step: &Step) -> bool {
    let text = library.sources.text(step.text);
    embedded::STEPS.iter().any(|(name, known)| *name == step.name && *known == text)
}

struct Count<'a> {
    library: &'a Library,
    graph: &'a Graph,
    /// Whether steps are traced for their size; else each counts as one.
    exact: bool,
    /// Sizes by node, and by whether its orbits are unrolled.
    known: HashMap<(NodeRef, bool), Size>,
    /// What is wrong in steps that were traced.
    mistakes: Vec<Diagnostic>,
}

impl Count<'_> {
    /// The size of a node; of orbits inside end shapes with every iteration apart.
    fn node(&mut self, of: NodeRef, unrolled: bool) -> Size {
        if let Some(size) = self.known.get(&(of, unrolled)) {
            return *size;
        }
        let graph = self.graph;
        let size = match &graph.node(of).kind {
            NodeKind::Step { step, params } | NodeKind::Shape { step, params } => {
                Size::of(if self.exact { self.traced(of, step, params) } else { 1.0 }, 1.0)
            }
            kind => self.kind(kind, unrolled),
        };
        self.known.insert((of, unrolled), size);
        size
    }

    fn kind(&mut self, kind: &NodeKind, unrolled: bool) -> Size {
        let all = |count: &mut Self, wires: &[NodeRef], each: f64| {
            let sum = |sum: Size, wire: &NodeRef| sum.and(count.node(*wire, unrolled)).and(Size::of(each, 0.0));
            wires.iter().fold(Size::default(), sum)
        };
        match kind {
            NodeKind::Primitive(_) => Size::of(if self.exact { PRIMITIVE } else { 1.0 }, 0.0),
            NodeKind::Repeat { of, times } => all(self, &[*of], 0.0).times(f64::from(*times)),
            NodeKind::Transform { of, .. } => all(self, &[*of], PLACED),
            NodeKind::Tile { of, tiling } => all(self, &[*of], PLACED).times(copies(*tiling)),
            NodeKind::Warp { of, by } => all(self, &[*by], 0.0).times(WARPED).and(all(self, &[*of], 0.0)),
            NodeKind::Orbit { of, settings } => {
                let iterations = f64::from(settings.max_iterations.max(1));
                let mut map = self.node(*of, unrolled);
                if depends_on_iteration(self.graph, *of) {
                    map.scheduled += map.steps * iterations;
                }
                let map = if unrolled { map.times(iterations) } else { map };
                let around: Vec<NodeRef> = settings.pre.iter().chain(&settings.post).copied().collect();
                let end = settings.shape.map(|shape| {
                    let levels = shape.levels.map_or(1.0, |_| iterations);
                    self.node(shape.field, true).times(if unrolled { levels } else { 1.0 })
                });
                map.and(all(self, &around, 0.0)).and(end.unwrap_or_default())
            }
            other => all(self, &other.wires(), JOINED),
        }
    }

    /// Expressions that a step makes. Errors in its functions are kept, so that those of all steps are reported together.
    fn traced(&mut self, node: NodeRef, step: &Step, params: &[ParamInput]) -> f64 {
        // A step of any width may be meant for four components alone.
        let widths: &[u8] = match step.state {
            StateWidth::Four => &[4],
            StateWidth::Any => &[3, 4],
            _ => &[3],
        };
        let mut first = None;
        for width in widths {
            let arena = Arc::new(Arena::default());
            let errors = self.trace(&arena, Type::F.with_width(*width), step, params);
            if errors.is_empty() {
                return arena.len() as f64;
            }
            first.get_or_insert(errors);
        }
        let place = self.graph.node(node);
        let label = |error: Diagnostic| error.label(place.span, format!("used by the node `{}`", place.name));
        let is_known = |new: &Diagnostic| self.mistakes.iter().any(|old| old.span() == new.span());
        let new: Vec<Diagnostic> = first.into_iter().flatten().filter(|error| !is_known(error)).map(label).collect();
        self.mistakes.extend(new);
        1.0
    }

    /// Traces a step's function, and its rule where it has one; gives what is wrong with them.
    fn trace(&self, arena: &Arc<Arena>, ty: Type, step: &Step, params: &[ParamInput]) -> Vec<Diagnostic> {
        let Library { engine, sources, .. } = self.library;
        let (z, c) = (arena.input(0, ty), arena.input(1, ty));
        let map = script_params(arena, step, params);
        if step.is_shape() {
            return step.trace_distance(engine, sources, arena, z, &map).err().into_iter().collect();
        }
        let error = step.trace(engine, sources, arena, StepInputs::first(z, c, None), &map).err();
        if error.is_some() || step.scalar_rule.is_none() {
            return error.into_iter().collect();
        }
        // In an arena of its own, so that the rule's expressions are not counted.
        let arena = Arc::new(Arena::default());
        let (z, c, dr) = (arena.input(0, ty), arena.input(1, ty), arena.input(3, Type::F));
        let map = script_params(&arena, step, params);
        step.trace(engine, sources, &arena, StepInputs::first(z, c, Some(dr)), &map).err().into_iter().collect()
    }
}

/// A step's parameters as its script sees them.
fn script_params(arena: &Arena, step: &Step, params: &[ParamInput]) -> Map {
    let value = |(param, value): (&StepParam, &ParamInput)| {
        let value = match value {
            ParamInput::Known(value) => script_value(arena, &param.kind, value),
            ParamInput::OfIteration(_) => to_dynamic(arena.input(2, Type::F)),
        };
        (param.name.as_str().into(), value)
    };
    step.params.iter().zip(params).map(value).collect()
}

/// Copies that a tile is looked up in.
fn copies(tiling: Tiling) -> f64 {
    let axes = tiling.period.iter().filter(|period| **period > 0.0 && !tiling.mirror).count();
    f64::from(1u32 << axes)
}
