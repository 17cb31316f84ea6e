//! Kernels: functions and the few loops around them, in a form that every back end can run.
//!
//! A [`Kernel`] is a straight-line [`Function`] applied to many elements, an [`Estimator`] (orbits iterated until they
//! escape, and what is made of their end states), or a [`March`] (an estimator called along rays). In come columns of
//! numbers, one a scalar of the kernel's inputs; out come columns of its outputs. A back end is a [`Backend`]: the
//! [`cpu`] interpreter in f64 or wide f32, and the `gpu` back end through generated [`wgsl`].

pub mod constants;
pub mod cost;
pub mod cpu;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod listing;
pub mod records;
pub mod tape;
pub mod template;
pub mod wgsl;
pub mod work;

use self::records::{Marched, Query, Ray};
use crate::expr::{Arena, Function, Port};
use crate::graph::Schedule;

/// One iterated system: what is carried, how it starts, the maps that iterate it, and what its end state says.
///
/// Conventions for the functions' ports: `init` takes [`Estimator::inputs`] and gives state then frozen values; every
/// item takes state, frozen values and `n` (iterations done before it) and gives state then `escaped: boolean`;
/// `finish` takes state, frozen values and `n` (iterations done at the end).
#[derive(Clone, Debug)]
pub struct Orbit {
    /// Name in generated code.
    pub name: String,
    /// Values that change each iteration.
    pub state: Vec<Port>,
    /// Values that `init` fixes for the orbit, such as `c`.
    pub frozen: Vec<Port>,
    /// Start values.
    pub init: Function,
    /// The distinct maps of one iteration.
    pub items: Vec<Function>,
    /// Which item runs at which iteration.
    pub schedule: Schedule,
    /// Values made of the end state.
    pub finish: Function,
    /// Iterations after which a point counts as inside.
    pub max_iterations: u32,
}

/// Orbits and what is made of them at a point: usually `de` and `inside`.
///
/// `combine` takes [`Estimator::inputs`], then for each orbit the outputs of its `finish`, `inside: boolean` and
/// `n: number` (iterations done).
#[derive(Clone, Debug)]
pub struct Estimator {
    /// The iterated systems.
    pub orbits: Vec<Orbit>,
    /// Joins their results; its outputs are the estimator's.
    pub combine: Function,
}

/// An estimator called along rays until each has hit, missed or run out of steps.
///
/// The estimator's outputs start with an [`Answer`](records::Answer). `locate` takes a [`Ray`] and a
/// [`MarchState`](records::MarchState) and gives a [`Query`]; `advance` takes the same and the answer, and gives the new state.
#[derive(Clone, Debug)]
pub struct March {
    /// What is called.
    pub estimator: Estimator,
    /// From ray and state to the point to estimate at.
    pub locate: Function,
    /// From ray, state and estimate to the new state.
    pub advance: Function,
    /// Estimates after which a ray counts as unfinished.
    pub max_march_steps: u32,
}

/// What a back end can run.
#[derive(Clone, Debug)]
pub enum Kernel {
    /// A function of each element.
    Map(Function),
    /// An estimator at each element.
    Estimate(Estimator),
    /// A march along each ray.
    March(March),
}

/// How a march ended, as its `status` column says it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Status {
    /// The ray reached the surface at `t`.
    Hit,
    /// The ray left the bounding sphere.
    Miss,
    /// Steps ran out.
    Unfinished,
}

impl Status {
    /// The number in the column while the march goes on.
    pub const RUNNING: f64 = 0.0;

    /// The number in the column.
    pub const fn code(self) -> f64 {
        match self {
            Status::Hit => 1.0,
            Status::Miss => 2.0,
            Status::Unfinished => 3.0,
        }
    }

    /// The status of a column's number; anything that is neither hit nor miss is unfinished.
    #[inline]
    pub fn from_code(code: f64) -> Status {
        match code as i32 {
            1 => Status::Hit,
            2 => Status::Miss,
            _ => Status::Unfinished,
        }
    }
}

impl Estimator {
    /// What goes in: a [`Query`].
    pub fn inputs() -> Vec<Port> {
        Query::ports()
    }

    /// True when any part depends on input `number` of [`Estimator::inputs`].
    pub fn reads(&self, arena: &Arena, number: usize) -> bool {
        self.combine.reads(arena, number) || self.orbits.iter().any(|orbit| orbit.init.reads(arena, number))
    }

    /// The same estimator with one of its outputs alone, by number.
    #[must_use]
    pub fn only(mut self, output: usize) -> Estimator {
        self.combine.outputs = vec![self.combine.outputs.swap_remove(output)];
        self
    }

    /// Columns of [`Estimator::inputs`]. `directions` and `h` have an entry for each point, or one for all.
    pub fn columns(points: &[[f64; 3]], directions: &[[f64; 3]], h: &[f64], hit_eps: f64) -> Vec<Vec<f64>> {
        let count = points.len();
        let mut columns: Vec<Vec<f64>> = (0..3).map(|k| points.iter().map(|p| p[k]).collect()).collect();
        columns.extend((0..3).map(|k| directions.iter().map(|d| d[k]).cycle().take(count).collect()));
        columns.push(h.iter().copied().cycle().take(count).collect());
        columns.push(vec![hit_eps; count]);
        columns
    }
}

/// The unit direction from a point to the world's origin: what points that no ray asks for take as their ray.
pub fn inwards(p: &[f64; 3]) -> [f64; 3] {
    let length = p.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length > 0.0 { p.map(|x| -x / length) } else { [1.0, 0.0, 0.0] }
}

impl Kernel {
    /// The columns that go in.
    pub fn inputs(&self) -> Vec<Port> {
        match self {
            Kernel::Map(function) => function.inputs.clone(),
            Kernel::Estimate(_) => Estimator::inputs(),
            Kernel::March(_) => Ray::ports(),
        }
    }

    /// The columns that come out.
    pub fn outputs(&self) -> Vec<Port> {
        match self {
            Kernel::Map(function) => function.output_ports(),
            Kernel::Estimate(estimator) => estimator.combine.output_ports(),
            Kernel::March(_) => Marched::ports(),
        }
    }
}

/// How a back end wants its work cut.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Batch {
    /// Elements of a run that keep it busy.
    pub elements: usize,
    /// Runs from several threads that it gains from at the same time; as many as there are threads where that is more.
    pub at_once: usize,
}

/// What a back end has prepared.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Compiling {
    /// Kernels that were asked for.
    pub kernels: u32,
    /// Kernels that were compiled: the others are equal to one of these.
    pub compiled: u32,
    /// Time of our own work: writing code and checking it.
    pub own: std::time::Duration,
    /// Time of the driver's compiler, summed over kernels, which it may compile at the same time.
    pub driver: std::time::Duration,
}

/// Columns of a result that are wanted, by number.
pub type Wanted<'a, C> = (&'a C, &'a [usize]);

/// Columns of results, as they are wanted, in the precision that the back end computes in.
#[derive(Clone, PartialEq, Debug)]
pub enum Results<'a> {
    /// Single precision.
    F32(Vec<Vec<&'a [f32]>>),
    /// Double precision.
    F64(Vec<Vec<&'a [f64]>>),
}

fn in_f64<T: Copy + Into<f64>>(column: &[T]) -> Vec<f64> {
    column.iter().map(|&x| x.into()).collect()
}

/// Something that runs kernels. Columns stay where the back end keeps them until they are downloaded.
pub trait Backend: Sync {
    /// A kernel made ready to run.
    type Prepared: Sync;
    /// Columns of equal length in the back end's memory.
    type Columns;

    /// How work is best cut.
    fn batch(&self) -> Batch;

    /// Compiles a kernel.
    fn prepare(&self, arena: &Arena, kernel: &Kernel) -> Result<Self::Prepared, BackendError>;
    /// A prepared kernel with other values of its uniforms, by number; nothing is compiled. They are 0 before, and those
    /// that the list lacks keep what they have.
    fn bind(&self, kernel: &Self::Prepared, uniforms: &[f64]) -> Result<Self::Prepared, BackendError>;
    /// What has been prepared so far, and how long it took; `None` if no account is kept.
    fn compiling(&self) -> Option<Compiling> {
        None
    }
    /// Copies columns of equal length in.
    fn upload(&self, columns: &[impl AsRef<[f64]>]) -> Result<Self::Columns, BackendError>;
    /// Copies columns out.
    fn download(&self, columns: &Self::Columns) -> Result<Vec<Vec<f64>>, BackendError>;
    /// Copies some of the columns out, by number, in this order.
    fn download_only(&self, columns: &Self::Columns, numbers: &[usize]) -> Result<Vec<Vec<f64>>, BackendError> {
        self.read(&[(columns, numbers)], |results| match results {
            Results::F32(results) => results[0].iter().map(|column| in_f64(column)).collect(),
            Results::F64(results) => results[0].iter().map(|column| in_f64(column)).collect(),
        })
    }
    /// Has some of the columns of several results read where they lie. A back end that has to be waited for is waited for once.
    fn read<R>(&self, wanted: &[Wanted<Self::Columns>], take: impl FnOnce(Results) -> R) -> Result<R, BackendError>;
    /// Runs a kernel on the columns of all inputs, in order. A device may still be at it when this returns.
    fn run(&self, kernel: &Self::Prepared, inputs: &[&Self::Columns]) -> Result<Self::Columns, BackendError>;
    /// Waits until all is done that was asked for: for whoever measures it.
    fn finish(&self) -> Result<(), BackendError> {
        Ok(())
    }
}

/// Why a back end could not do its work.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum BackendError {
    /// There is no adapter of the kind asked for; the text says what was looked for.
    NoAdapter(String),
    /// The device was lost or refused its work; the text is the driver's.
    DeviceLost(String),
    /// The device has too little memory.
    OutOfMemory(String),
    /// Generated WGSL was refused: our bug. The text names the place.
    InvalidWgsl(String),
}

impl std::fmt::Display for BackendError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            BackendError::NoAdapter(text) => write!(f, "no GPU adapter: {text}"),
            BackendError::DeviceLost(text) => write!(f, "the GPU device was lost: {text}"),
            BackendError::OutOfMemory(text) => write!(f, "the GPU has too little memory: {text}"),
            BackendError::InvalidWgsl(text) => {
                write!(
                    f,
                    "generated WGSL was refused, which is a bug in bulbfold; please report the formula file and this:\n{text}"
                )
            }
        }
    }
}

impl std::error::Error for BackendError {}
