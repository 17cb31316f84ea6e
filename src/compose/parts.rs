//! An iteration taken apart: each of its steps, the constant and the escape test as functions of their own, to say what
//! each costs. Kernels are made of whole iterations, which share what their steps have in common.

use super::orbit::{Carried, Constants, OrbitBuilder, State};
use super::{Choice, ComposeResult, Composer, FieldOrbit, Purpose};
use crate::expr::{Expr, Function, Port, Type};
use crate::graph::{Constant, IterationMap, MapTree, NodeKind, NodeRef, resolve_schedule};

/// A piece of an iteration as functions of state, frozen values and `n`.
#[derive(Clone, Debug)]
pub struct Part {
    /// The node's name, or what the composer adds.
    pub name: String,
    /// The step's name; empty for what is no step.
    pub step: String,
    /// z alone.
    pub value: Function,
    /// z and what the method carries with it: derivatives, or the orbits of shifted points.
    pub all: Function,
}

/// One of an orbit's distinct iterations.
#[derive(Clone, Debug)]
pub struct IterationParts {
    /// Its steps in order, then the constant and the escape test. Blends and choices list the steps of both sides; what
    /// joins them is no part.
    pub parts: Vec<Part>,
    /// The whole iteration.
    pub whole: Part,
}

/// Takes the iterations of an orbit apart, in the order of the items of its kernel. Proofs carry bounds that belong to no
/// single step: their parts are z alone.
pub fn iteration_parts(composer: &Composer, orbit: &FieldOrbit, choice: &Choice) -> ComposeResult<Vec<IterationParts>> {
    let settings = &orbit.settings;
    let (maps, _) = resolve_schedule(composer.graph, orbit.root, settings.constant, settings.max_iterations);
    let width = composer.graph.state_width(orbit.root, &orbit.settings);
    let (root, frame, purpose) = (orbit.root, &orbit.frame, Purpose::March);
    let with = |carried| OrbitBuilder { composer, settings, root, frame, width, carried, choice, purpose };
    let (value, all) = (with(Carried::NOTHING), with(Carried::of(choice, purpose)));
    let taker = Taker { value: Opened::new(&value, &maps)?, all: Opened::new(&all, &maps)? };
    maps.iter().map(|map| taker.take(composer, map)).collect()
}

/// What a part ends in.
#[derive(Clone, Copy, PartialEq, Eq)]
enum End {
    State,
    Escape,
    Both,
}

/// The same orbit without and with what is carried besides z.
struct Taker<'a> {
    value: Opened<'a>,
    all: Opened<'a>,
}

impl Taker<'_> {
    fn take(&self, composer: &Composer, map: &IterationMap) -> ComposeResult<IterationParts> {
        let mut parts = Vec::new();
        for node in leaves(&map.map) {
            let place = composer.graph.node(node);
            let step = match &place.kind {
                NodeKind::Step { step, .. } => step.name.as_str(),
                _ => "",
            };
            let alone = IterationMap { map: MapTree::Step(node), constant: Constant::Off };
            parts.push(self.part(&place.name, step, &alone, End::State)?);
        }
        let nothing = |constant| IterationMap { map: MapTree::Identity, constant };
        if map.constant != Constant::Off {
            parts.push(self.part("constant", "", &nothing(map.constant), End::State)?);
        }
        parts.push(self.part("escape test", "", &nothing(Constant::Off), End::Escape)?);
        Ok(IterationParts { parts, whole: self.part("iteration", "", map, End::Both)? })
    }

    fn part(&self, name: &str, step: &str, map: &IterationMap, end: End) -> ComposeResult<Part> {
        let (value, all) = (self.value.function(name, map, end)?, self.all.function(name, map, end)?);
        Ok(Part { name: name.into(), step: step.into(), value, all })
    }
}

/// A builder with its state and constants as inputs.
struct Opened<'a> {
    builder: &'a OrbitBuilder<'a>,
    state: State<'a>,
    constants: Constants<'a>,
    ports: Vec<Port>,
    n: Expr<'a>,
}

impl<'a> Opened<'a> {
    fn new(builder: &'a OrbitBuilder<'a>, maps: &[IterationMap]) -> ComposeResult<Opened<'a>> {
        let (start, constants) = builder.start()?;
        let (_, frozen, constants) = builder.freeze("part", &start, constants, maps);
        let state = start.as_inputs(0);
        let mut ports = state.ports();
        ports.extend(frozen);
        let n = builder.composer.arena.input(ports.len() as u16, Type::F);
        ports.push(Port::new("n", Type::F));
        Ok(Opened { builder, state, constants, ports, n })
    }

    fn function(&self, name: &str, map: &IterationMap, end: End) -> ComposeResult<Function> {
        let mut function = Function::new(name, self.ports.clone());
        let next = self.builder.iterate(map, &self.state, &self.constants, self.n)?;
        if end != End::Escape {
            next.parts().into_iter().for_each(|(name, value)| function.output(name, value));
        }
        if end != End::State {
            function.output("escaped", self.builder.has_ended(&next, self.constants.hit_eps));
        }
        Ok(function)
    }
}

/// The step nodes of a map, in order, as often as they run.
fn leaves(map: &MapTree) -> Vec<NodeRef> {
    match map {
        MapTree::Identity => Vec::new(),
        MapTree::Step(node) => vec![*node],
        MapTree::Sequence(parts) => parts.iter().flat_map(leaves).collect(),
        MapTree::Repeat(of, times) => (0..*times).flat_map(|_| leaves(of)).collect(),
        MapTree::Blend(a, b, _) | MapTree::Choose(_, a, b) => leaves(a).into_iter().chain(leaves(b)).collect(),
    }
}
