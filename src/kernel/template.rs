//! Kernels that differ in their numbers only, joined into one that takes the numbers as uniforms.
//!
//! Frames of an animation, or positions of a slider, are composed like any picture, each by itself, with every number
//! known: so bounding radii, folded products and whatever else follows from a parameter are right for each frame, and the
//! composer knows nothing of animation. In come their kernels ([`Templates::add`]); kernels of the same structure are then
//! one family. A number that is the same in all of a family stays the constant that it is, and the others become uniforms,
//! one for each distinct row of values ([`Templates::finish`]; this is G. Plotkin's least general generalisation, 1970, where
//! only numbers may differ). What a parameter does to the structure (a whole power becomes products, a number that is 0
//! or 1 is folded away, a limit of iterations changes) makes another family.
//!
//! ```
//! use std::sync::Arc;
//! use bulbfold::expr::{Arena, Function, Port, Type};
//! use bulbfold::kernel::{Backend, Kernel, cpu::Cpu, template::Templates};
//! use bulbfold::math::Precision;
//!
//! let mut templates = Templates::default();
//! for scale in [2.0, 3.0] {
//!     let arena = Arc::new(Arena::default());
//!     let mut f = Function::new("f", vec![Port::new("x", Type::F)]);
//!     f.output("y", arena.input(0, Type::F) * scale + 1.0);
//!     templates.add(&arena, &Kernel::Map(f));
//! }
//! let joined = templates.finish();
//! assert_eq!(joined.families.len(), 1);
//! assert_eq!(joined.frames[1].uniforms, [3.0]);
//! let cpu = Cpu::new(Precision::F64);
//! let kernel = cpu.prepare(&joined.families[0].arena, &joined.families[0].kernel).unwrap();
//! let second = cpu.bind(&kernel, &joined.frames[1].uniforms).unwrap();
//! let result = cpu.run(&second, &[&cpu.upload(&[vec![5.0]]).unwrap()]).unwrap();
//! assert_eq!(cpu.download(&result).unwrap(), [[16.0]]);
//! ```

use std::collections::HashMap;
use std::sync::Arc;

use super::{Backend, BackendError, Estimator, Kernel, March, Orbit};
use crate::expr::ops::Operator;
use crate::expr::{Arena, Function, Node, NodeId, Op};

/// Kernels of frames, gathered into families.
#[derive(Default)]
pub struct Templates {
    gathered: Vec<Gathered>,
    /// Family of each frame, and its place there.
    frames: Vec<(usize, usize)>,
}

/// Frames whose kernels have one structure.
struct Gathered {
    key: Vec<u8>,
    arena: Arc<Arena>,
    kernel: Kernel,
    /// The numbers of each frame, in the order in which the kernel reads them.
    rows: Vec<Vec<f64>>,
}

/// A kernel that serves several frames.
pub struct Family {
    /// Where its nodes are.
    pub arena: Arc<Arena>,
    /// The kernel; what differs from frame to frame is a uniform.
    pub kernel: Kernel,
}

/// What a frame runs.
#[derive(Clone, PartialEq, Debug)]
pub struct Frame {
    /// Number of its family.
    pub family: usize,
    /// Values of the family's uniforms, by number.
    pub uniforms: Vec<f64>,
}

/// Families, and the frames in the order in which they were added.
pub struct Joined {
    /// The kernels to compile.
    pub families: Vec<Family>,
    /// What each frame runs.
    pub frames: Vec<Frame>,
}

impl Templates {
    /// Adds the kernel of the next frame. Only the first of a family is kept.
    pub fn add(&mut self, arena: &Arc<Arena>, kernel: &Kernel) {
        let Shape { key, numbers } = Shape::new(arena, kernel);
        let known = self.gathered.iter().position(|family| family.key == key);
        let family = known.unwrap_or_else(|| {
            let (arena, kernel) = (arena.clone(), kernel.clone());
            self.gathered.push(Gathered { key, arena, kernel, rows: Vec::new() });
            self.gathered.len() - 1
        });
        self.frames.push((family, self.gathered[family].rows.len()));
        self.gathered[family].rows.push(numbers);
    }

    /// Makes the kernels.
    pub fn finish(self) -> Joined {
        let columns: Vec<Columns> = self.gathered.iter().map(|family| Columns::new(&family.rows)).collect();
        let frame = |&(family, at): &(usize, usize)| {
            let row: &[f64] = &self.gathered[family].rows[at];
            Frame { family, uniforms: columns[family].first.iter().map(|&place| row[place]).collect() }
        };
        let frames = self.frames.iter().map(frame).collect();
        let family = |(gathered, columns): (&Gathered, &Columns)| {
            let kernel = with_uniforms(&gathered.arena, &gathered.kernel, &columns.uniforms);
            Family { arena: gathered.arena.clone(), kernel }
        };
        Joined { families: self.gathered.iter().zip(&columns).map(family).collect(), frames }
    }
}

/// Most kernels of one name that are kept.
const MOST_KEPT: usize = 8;

/// Prepared kernels that are kept for others of the same structure, whose numbers are not known beforehand.
///
/// A number that has been the same in all kernels of a structure is a constant. When one moves, the kernel is compiled again with a
/// uniform in its place; from then on it moves without compiling.
pub struct Kept<B: Backend> {
    is_keeping: bool,
    kernels: HashMap<&'static str, Vec<KeptKernel<B::Prepared>>>,
    compiled: usize,
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
        Kept { is_keeping: false, kernels: HashMap::new(), compiled: 0 }
    }
}

impl<B: Backend> Kept<B> {
    /// Keeps what it prepares.
    pub fn keeping() -> Kept<B> {
        Kept { is_keeping: true, ..Kept::default() }
    }

    /// Kernels that were compiled so far.
    pub fn compiled(&self) -> usize {
        self.compiled
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
        let shape = (!known.is_empty()).then(|| Shape::new(arena, kernel));
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
        let prepared = backend.prepare(arena, kernel)?;
        let bound = backend.bind(&prepared, &[])?;
        if known.len() == MOST_KEPT {
            known.remove(0);
        }
        known.push(KeptKernel { arena: arena.clone(), kernel: kernel.clone(), shape, moves: Vec::new(), prepared });
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
        let mut next = 0;
        let number = |&moves: &bool| {
            moves.then(|| {
                next += 1;
                next - 1
            })
        };
        let uniforms: Vec<Option<u16>> = self.moves.iter().map(number).collect();
        self.prepared = backend.prepare(&self.arena, &with_uniforms(&self.arena, &self.kernel, &uniforms))?;
        Ok(true)
    }

    /// The numbers that move.
    fn uniforms(&self, numbers: &[f64]) -> Vec<f64> {
        self.moves.iter().zip(numbers).filter(|(moves, _)| **moves).map(|(_, x)| *x).collect()
    }
}

/// Which numbers of a family differ from frame to frame.
struct Columns {
    /// For each number the uniform that takes its place.
    uniforms: Vec<Option<u16>>,
    /// For each uniform the first number whose place it takes.
    first: Vec<usize>,
}

impl Columns {
    fn new(rows: &[Vec<f64>]) -> Columns {
        let mut known: HashMap<Vec<u64>, u16> = HashMap::new();
        let mut columns = Columns { uniforms: Vec::new(), first: Vec::new() };
        for place in 0..rows.first().map_or(0, Vec::len) {
            let column: Vec<u64> = rows.iter().map(|row| row[place].to_bits()).collect();
            let uniform = column.iter().any(|bits| *bits != column[0]).then(|| {
                *known.entry(column).or_insert_with(|| {
                    columns.first.push(place);
                    columns.first.len() as u16 - 1
                })
            });
            columns.uniforms.push(uniform);
        }
        columns
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
