//! Kernels that differ in their numbers only: one is compiled, and takes what moves as uniforms.
//!
//! Frames of a film, or positions of a slider, are composed like any picture, each by itself, with every number
//! known: so bounding radii, folded products and whatever else follows from a parameter are right for each frame, and the
//! composer knows nothing of films. Kernels of the same structure then share one ([`Kept`]; this is G. Plotkin's least general
//! generalisation, 1970, where only numbers may differ): a number that has never moved stays the constant that it is, the others are
//! uniforms. What a parameter does to the structure (a whole power becomes products, a number that is 0
//! or 1 is folded away, a limit of iterations changes) makes another kernel.
//!
//! ```
//! use std::sync::Arc;
//! use bulbfold::expr::{Arena, Function, Port, Type};
//! use bulbfold::kernel::template::{Announced, Kept};
//! use bulbfold::kernel::{Backend, Kernel, cpu::Cpu};
//! use bulbfold::math::Precision;
//!
//! let map = |scale: f64| {
//!     let arena = Arc::new(Arena::default());
//!     let mut f = Function::new("f", vec![Port::new("x", Type::F)]);
//!     f.output("y", arena.input(0, Type::F) * scale + 1.0);
//!     (arena.clone(), Kernel::Map(f))
//! };
//! let (cpu, announced) = (Cpu::new(Precision::F64), Announced::default());
//! let mut kept = Kept::keeping(&announced);
//! let (arena, kernel) = map(3.0);
//! announced.add("f", &arena, &kernel);
//! for (scale, expected) in [(2.0, 11.0), (3.0, 16.0)] {
//!     let (arena, kernel) = map(scale);
//!     let ready = kept.prepare(&cpu, "f", &arena, &kernel).unwrap();
//!     let result = cpu.run(&ready, &[&cpu.upload(&[vec![5.0]]).unwrap()]).unwrap();
//!     assert_eq!(cpu.download(&result).unwrap(), [[expected]]);
//! }
//! assert_eq!(kept.compiled(), 1);
//! ```

use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, Mutex, PoisonError};

use super::{Backend, BackendError, Estimator, Kernel, March, Orbit};
use crate::expr::ops::Operator;
use crate::expr::{Arena, Function, Node, NodeId, Op};

/// Most kernels of one name that are kept.
const MOST_KEPT: usize = 8;

/// Kernels that will come, so that the numbers in which they differ from the first one are uniforms from the start. Clones share them.
#[derive(Clone, Default)]
pub struct Announced(Arc<Mutex<Vec<(&'static str, Shape)>>>);

impl Announced {
    /// Announces a kernel of a name.
    pub fn add(&self, name: &'static str, arena: &Arena, kernel: &Kernel) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push((name, Shape::new(arena, kernel)));
    }

    /// Which numbers of a kernel differ from those that are announced under its name with its structure; empty where none do.
    fn moves(&self, name: &str, own: &Shape) -> Vec<bool> {
        let known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let alike = known.iter().filter(|(other, shape)| *other == name && shape.key == own.key);
        let others: Vec<&Shape> = alike.map(|(_, shape)| shape).collect();
        let differs = |at: usize| others.iter().any(|other| other.numbers[at].to_bits() != own.numbers[at].to_bits());
        let moves: Vec<bool> = (0..own.numbers.len()).map(differs).collect();
        if moves.contains(&true) { moves } else { Vec::new() }
    }

    fn is_empty(&self) -> bool {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).is_empty()
    }
}

/// Prepared kernels that are kept for others of the same structure, whose numbers are not known beforehand.
///
/// A number that has been the same in all kernels of a structure, and in those that are announced, is a constant. When one moves, the kernel
/// is compiled again with a uniform in its place; from then on it moves without compiling.
pub struct Kept<B: Backend> {
    is_keeping: bool,
    announced: Announced,
    kernels: HashMap<&'static str, Vec<KeptKernel<B::Prepared>>>,
    compiled: usize,
    structures: BTreeMap<&'static str, usize>,
}

/// A kernel that is kept.
struct KeptKernel<P> {
    arena: Arc<Arena>,
    kernel: Kernel,
    /// Structure and numbers of `kernel`; found when there is something to compare them with.
    shape: Option<Shape>,
    /// Which numbers have moved.
    moves: Vec<bool>,
    prepared: P,
}

impl<B: Backend> Default for Kept<B> {
    /// Keeps nothing: for work that is done once.
    fn default() -> Kept<B> {
        Kept {
            is_keeping: false,
            announced: Announced::default(),
            kernels: HashMap::new(),
            compiled: 0,
            structures: BTreeMap::new(),
        }
    }
}

impl<B: Backend> Kept<B> {
    /// Keeps what it prepares.
    pub fn keeping(announced: &Announced) -> Kept<B> {
        Kept { is_keeping: true, announced: announced.clone(), ..Kept::default() }
    }

    /// Kernels that were compiled so far.
    pub fn compiled(&self) -> usize {
        self.compiled
    }

    /// How many structures the kernels of each name have had.
    pub fn structures(&self) -> &BTreeMap<&'static str, usize> {
        &self.structures
    }

    /// Drops all kernels: the device is another one.
    pub fn forget(&mut self) {
        self.kernels.clear();
    }

    /// A kernel ready to run, compiled only where no kept one of this name serves.
    pub fn prepare(
        &mut self,
        backend: &B,
        name: &'static str,
        arena: &Arc<Arena>,
        kernel: &Kernel,
    ) -> Result<B::Prepared, BackendError> {
        if !self.is_keeping {
            self.compiled += 1;
            return backend.prepare(arena, kernel);
        }
        let known = self.kernels.entry(name).or_default();
        let is_compared = !known.is_empty() || !self.announced.is_empty();
        let shape = is_compared.then(|| Shape::new(arena, kernel));
        if let Some(shape) = &shape
            && let Some(at) = known.iter_mut().position(|kept| kept.shape().key == shape.key)
        {
            // The one that was used last is the last to go.
            let kept = known.remove(at);
            known.push(kept);
            let kept = known.last_mut().expect("it was pushed");
            self.compiled += usize::from(kept.follow(backend, &shape.numbers)?);
            return backend.bind(&kept.prepared, &kept.uniforms(&shape.numbers));
        }
        self.compiled += 1;
        *self.structures.entry(name).or_default() += 1;
        let moves = shape.as_ref().map(|shape| self.announced.moves(name, shape)).unwrap_or_default();
        let prepared = backend.prepare(arena, &moving(arena, kernel, &moves))?;
        if known.len() == MOST_KEPT {
            known.remove(0);
        }
        let kept = KeptKernel { arena: arena.clone(), kernel: kernel.clone(), shape, moves, prepared };
        let numbers = kept.shape.as_ref().map_or(&[][..], |shape| &shape.numbers);
        let bound = backend.bind(&kept.prepared, &kept.uniforms(numbers))?;
        known.push(kept);
        Ok(bound)
    }
}

impl<P> KeptKernel<P> {
    fn shape(&mut self) -> &Shape {
        self.shape.get_or_insert_with(|| Shape::new(&self.arena, &self.kernel))
    }

    /// Compiles the kernel again where numbers differ from its own that have not moved before; true if it did.
    fn follow<B: Backend<Prepared = P>>(&mut self, backend: &B, numbers: &[f64]) -> Result<bool, BackendError> {
        let own = self.shape().numbers.clone();
        self.moves.resize(own.len(), false);
        let differs = |at: usize| own[at].to_bits() != numbers[at].to_bits();
        let new: Vec<usize> = (0..own.len()).filter(|&at| differs(at) && !self.moves[at]).collect();
        if new.is_empty() {
            return Ok(false);
        }
        new.into_iter().for_each(|at| self.moves[at] = true);
        self.prepared = backend.prepare(&self.arena, &moving(&self.arena, &self.kernel, &self.moves))?;
        Ok(true)
    }

    /// The numbers that move.
    fn uniforms(&self, numbers: &[f64]) -> Vec<f64> {
        self.moves.iter().zip(numbers).filter(|(moves, _)| **moves).map(|(_, x)| *x).collect()
    }
}

/// The structure of a kernel, as bytes that are equal where structures are, and its numbers.
#[derive(Default)]
struct Shape {
    key: Vec<u8>,
    numbers: Vec<f64>,
}

impl Shape {
    fn new(arena: &Arena, kernel: &Kernel) -> Shape {
        let mut shape = Shape::default();
        match kernel {
            Kernel::Map(_) => shape.say(&"map"),
            Kernel::Estimate(estimator) => shape.estimator(estimator),
            Kernel::March(march) => {
                shape.say(&march.max_march_steps);
                shape.estimator(&march.estimator);
            }
        }
        kernel.functions().into_iter().for_each(|function| shape.function(arena, function));
        shape
    }

    /// Appends what has no numbers that may differ.
    fn say(&mut self, what: &dyn std::fmt::Debug) {
        self.key.extend(format!("{what:?};").bytes());
    }

    fn estimator(&mut self, estimator: &Estimator) {
        for orbit in &estimator.orbits {
            self.say(&(&orbit.name, &orbit.state, &orbit.frozen, &orbit.schedule, orbit.max_iterations));
        }
    }

    fn function(&mut self, arena: &Arena, function: &Function) {
        self.say(&(&function.name, &function.inputs, function.output_ports()));
        let mut places: HashMap<NodeId, u32> = HashMap::new();
        for id in function.nodes(arena) {
            let node = arena.node(id);
            if node.constant().is_some() {
                continue;
            }
            places.insert(id, places.len() as u32);
            self.say(&(node.op, node.ty));
            if let Op::Lookup(number) = node.op {
                self.key.extend(arena.table(number).key().to_le_bytes());
            }
            arguments(arena, &node).into_iter().for_each(|arg| self.reference(arena, arg, &places));
        }
        function.outputs.iter().for_each(|(_, id)| self.reference(arena, *id, &places));
    }

    /// Appends a constant's type and numbers, or the place of any other node.
    fn reference(&mut self, arena: &Arena, id: NodeId, places: &HashMap<NodeId, u32>) {
        let node = arena.node(id);
        match node.constant() {
            Some(values) if node.ty.is_bool => self.say(&(node.ty, values)),
            Some(values) => {
                self.say(&node.ty);
                self.numbers.extend(&values[..usize::from(node.ty.width)]);
            }
            None => self.key.extend(places[&id].to_le_bytes()),
        }
    }
}

/// A node's arguments; of sums and products the constant is last, wherever equal constants elsewhere have put it.
fn arguments(arena: &Arena, node: &Node) -> Vec<NodeId> {
    let mut args = node.args().to_vec();
    let is_commutative = matches!(node.op, Op::Dot | Op::Apply(Operator::Add | Operator::Mul));
    if is_commutative && arena.node(args[0]).constant().is_some() {
        args.swap(0, 1);
    }
    args
}

/// A kernel with uniforms instead of the numbers that move; itself where none does.
fn moving(arena: &Arena, kernel: &Kernel, moves: &[bool]) -> Kernel {
    if !moves.contains(&true) {
        return kernel.clone();
    }
    let mut next = 0;
    let number = |&moves: &bool| {
        moves.then(|| {
            next += 1;
            next - 1
        })
    };
    with_uniforms(arena, kernel, &moves.iter().map(number).collect::<Vec<Option<u16>>>())
}

/// A kernel with uniforms instead of some of its numbers.
fn with_uniforms(arena: &Arena, kernel: &Kernel, uniforms: &[Option<u16>]) -> Kernel {
    let mut rebuild = Rebuild { arena, left: uniforms };
    match kernel {
        Kernel::Map(function) => Kernel::Map(rebuild.function(function)),
        Kernel::Estimate(estimator) => Kernel::Estimate(rebuild.estimator(estimator)),
        Kernel::March(march) => {
            let locate = rebuild.function(&march.locate);
            let estimator = rebuild.estimator(&march.estimator);
            let advance = rebuild.function(&march.advance);
            Kernel::March(March { estimator, locate, advance, max_march_steps: march.max_march_steps })
        }
    }
}

/// Goes through functions in the order of [`Kernel::functions`] and takes uniforms from the list.
struct Rebuild<'a> {
    arena: &'a Arena,
    left: &'a [Option<u16>],
}

impl Rebuild<'_> {
    fn estimator(&mut self, estimator: &Estimator) -> Estimator {
        let orbits = estimator.orbits.iter().map(|orbit| self.orbit(orbit)).collect();
        Estimator { orbits, combine: self.function(&estimator.combine) }
    }

    fn orbit(&mut self, orbit: &Orbit) -> Orbit {
        let init = self.function(&orbit.init);
        let items = orbit.items.iter().map(|item| self.function(item)).collect();
        Orbit { init, items, finish: self.function(&orbit.finish), ..orbit.clone() }
    }

    fn function(&mut self, function: &Function) -> Function {
        let mut rebuilt: HashMap<NodeId, NodeId> = HashMap::new();
        for id in function.nodes(self.arena) {
            let node = self.arena.node(id);
            if node.constant().is_none() {
                let args = arguments(self.arena, &node);
                let args: Vec<NodeId> = args.into_iter().map(|arg| self.reference(arg, &rebuilt)).collect();
                rebuilt.insert(id, self.arena.with_args(&node, &args));
            }
        }
        let outputs = function.outputs.iter().map(|(port, id)| (port.clone(), self.reference(*id, &rebuilt))).collect();
        Function { outputs, ..function.clone() }
    }

    fn reference(&mut self, id: NodeId, rebuilt: &HashMap<NodeId, NodeId>) -> NodeId {
        let node = self.arena.node(id);
        let Some(values) = node.constant() else { return rebuilt[&id] };
        if node.ty.is_bool {
            return id;
        }
        let (own, left) = self.left.split_at(usize::from(node.ty.width));
        self.left = left;
        if own.iter().all(Option::is_none) {
            return id;
        }
        let part = |(uniform, value): (&Option<u16>, &f64)| match uniform {
            Some(number) => self.arena.uniform(*number),
            None => self.arena.f(*value),
        };
        let parts: Vec<_> = own.iter().zip(&values).map(part).collect();
        if parts.len() == 1 { parts[0].id } else { self.arena.compose(&parts).id }
    }
}

#[cfg(test)]
mod tests;
