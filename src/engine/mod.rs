//! The front door: from a formula to a picture, as the program makes it.
//!
//! In comes a [`Formula`] and a [`Request`], plain data. [`Engine::settle`] chooses what the request leaves open (camera, iterations,
//! precision, estimate) and gives a [`Job`], which can be sent to another machine. [`Engine::render`] computes rows of it into
//! a [`Sink`] and tells an [`Observer`]; [`Engine::start`] does it on a thread of its own, which can be cancelled.
//!
//! ```
//! use bulbfold::engine::{Engine, Request};
//! use bulbfold::shade::Size;
//!
//! let engine = Engine::new();
//! let formula = engine.open("mandelbulb")?;
//! let request = Request { size: Size { width: 32, height: 24 }, ..Request::default() };
//! let image = engine.picture(&formula, &request, &mut ())?;
//! assert_eq!(image.rgb.len(), 32 * 24 * 3);
//! # Ok::<(), bulbfold::engine::Error>(())
//! ```

mod anaglyph;
mod animation;
mod backend;
mod camera;
mod denoised;
mod error;
mod job;
mod observer;
pub mod path;
mod recipe;
mod request;
mod running;
mod samples;
mod settle;
mod sink;

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

pub use animation::{Animation, Moment, Moments};
pub use backend::{Backends, Work};
pub use camera::{CameraChange, Zoom};
pub use error::{Error, FormulaMessages};
pub use job::{Composed, Job};
pub use observer::{Cancel, Observer, Stage};
pub use recipe::{Recipe, changed};
pub use request::{BackendChoice, MOST_EDGE, MOST_SAMPLES, Request};
pub use running::{Done, Running};
pub use samples::JoinedSamples;
pub use settle::{Settled, Settling, Viewed};
pub use sink::Sink;

pub use crate::check::Formula;
use crate::diag::Diagnostics;
use crate::expr::Arena;
use crate::film::Image;
use crate::formula::library::Library;
use crate::graph::Camera;
use crate::kernel::BackendError;
#[cfg(feature = "gpu")]
use crate::kernel::gpu::Gpu;
use crate::load::{Loaded, load, load_text};
use crate::render::{Clearance, FoundView, Search};

/// Steps, back ends and the kernels that they have compiled. Threads may share it.
pub struct Engine {
    library: Library,
    backends: Backends,
}

impl Default for Engine {
    fn default() -> Engine {
        Engine::new()
    }
}

impl Engine {
    /// An engine with the built-in steps. A GPU is opened when work first asks for one.
    pub fn new() -> Engine {
        Engine { library: Library::builtin(), backends: Backends::default() }
    }

    /// An engine that reads the steps (`*.rhai`) of these folders too.
    ///
    /// Errors: [`Error::Formula`] where one of them is broken.
    pub fn with_steps(folders: &[PathBuf]) -> Result<Engine, Error> {
        let (mut library, mut messages) = (Library::builtin(), Diagnostics::default());
        folders.iter().for_each(|folder| library.add_folder(folder, &mut messages));
        match messages.has_errors() {
            true => Err(Error::Formula(Box::new(FormulaMessages { messages, sources: library.sources }))),
            false => Ok(Engine { library, backends: Backends::default() }),
        }
    }

    /// The engine with one more step, from the text of its file.
    ///
    /// Errors: [`Error::Formula`] where it is broken.
    pub fn with_step(mut self, name: &str, text: &str) -> Result<Engine, Error> {
        let mut messages = Diagnostics::default();
        self.library.add_step_text(Path::new(&format!("{name}.rhai")), text.to_string(), &mut messages);
        match messages.has_errors() {
            true => Err(Error::Formula(Box::new(FormulaMessages { messages, sources: self.library.sources }))),
            false => Ok(self),
        }
    }

    /// The engine that asks before it opens a GPU which nobody asked for by name: whether there is hardware whose driver works. A
    /// program that can start a process for the question survives drivers that crash.
    #[must_use]
    pub fn trying_hardware(mut self, works: fn() -> Result<bool, BackendError>) -> Engine {
        self.backends.try_hardware(works);
        self
    }

    /// The engine with a device that its caller has opened.
    #[cfg(feature = "gpu")]
    #[must_use]
    pub fn with_gpu(mut self, gpu: Gpu) -> Engine {
        self.backends.use_gpu(gpu);
        self
    }

    /// The engine as a program wants it that renders again and again: kernels are kept. A job whose numbers alone differ from those of
    /// an earlier one compiles its kernels once more the first time that a number moves, and then none.
    #[must_use]
    pub fn keeping_kernels(mut self) -> Engine {
        self.backends.keep_kernels();
        self
    }

    /// Opens a formula: the path of a file, or the name of a built-in fractal where there is no such file.
    ///
    /// Errors: [`Error::Formula`], whose messages have file, line and column.
    pub fn open(&self, what: impl AsRef<Path>) -> Result<Arc<Formula>, Error> {
        self.open_with(what, &[])
    }

    /// Opens a formula with some of its values changed: pairs of a path such as `power` and a value in RON.
    pub fn open_with(&self, what: impl AsRef<Path>, set: &[(String, String)]) -> Result<Arc<Formula>, Error> {
        self.load(|library, messages| load(library, what, set, messages))
    }

    /// Reads a formula from its text; the file name tells RON (`.ron`) from scripts (`.rhai`), and its stem names the fractal.
    pub fn read(&self, name: &str, text: &str, set: &[(String, String)]) -> Result<Arc<Formula>, Error> {
        self.load(|library, messages| load_text(library, name, text, set, messages))
    }

    fn load(&self, read: impl FnOnce(&mut Library, &mut Diagnostics) -> Option<Loaded>) -> Result<Arc<Formula>, Error> {
        let (mut library, mut messages) = (self.library.clone(), Diagnostics::default());
        match read(&mut library, &mut messages).filter(|_| !messages.has_errors()) {
            Some(loaded) => Ok(Arc::new(Formula::of(library, loaded))),
            None => Err(Error::Formula(Box::new(FormulaMessages { messages, sources: library.sources }))),
        }
    }

    /// Settles what the request leaves open.
    ///
    /// Errors: [`Error::Formula`], [`Error::Request`].
    pub fn settle(&self, formula: &Arc<Formula>, request: &Request, observer: &mut dyn Observer) -> Result<Job, Error> {
        let arena = Arc::new(Arena::default());
        let settling = Settling { library: formula.library(), arena: &arena, request };
        let settled = settling.all(formula.graph().clone(), observer)?;
        Ok(Job::new(formula.clone(), request.clone(), settled))
    }

    /// Renders rows of a job into a sink, from the top. The rows are the same as those of the whole picture, on whatever machine.
    ///
    /// Errors: [`Error::Formula`], [`Error::Backend`], [`Error::Sink`], and [`Error::Cancelled`] where the observer ends it.
    pub fn render(
        &self,
        job: &Job,
        rows: Range<u32>,
        sink: &mut dyn Sink,
        observer: &mut dyn Observer,
    ) -> Result<Done, Error> {
        match anaglyph::eyes(job) {
            Some(eyes) => anaglyph::render(&self.backends, &eyes, rows, sink, observer),
            None if denoised::is_asked(job) => denoised::render(&self.backends, job, rows, sink, observer),
            None => running::render(&self.backends, job, running::Piece { rows, samples: None }, sink, observer),
        }
    }

    /// Settles and renders a whole picture into memory.
    pub fn picture(
        &self,
        formula: &Arc<Formula>,
        request: &Request,
        observer: &mut dyn Observer,
    ) -> Result<Image, Error> {
        let job = self.settle(formula, request, observer)?;
        let mut image = Image { size: request.size, rgb: Vec::new() };
        self.render(&job, job.rows(), &mut image, observer)?;
        Ok(image)
    }

    /// The camera of a formula's own view, after the request's changes: the file's, or one that frames what is there. None of a plane.
    ///
    /// Errors: [`Error::Formula`], [`Error::Request`].
    pub fn camera(&self, formula: &Formula, request: &Request) -> Result<Option<Camera>, Error> {
        let arena = Arc::new(Arena::default());
        let settling = Settling { library: formula.library(), arena: &arena, request };
        Ok(settling.viewed(formula.graph().clone())?.graph.scene.camera)
    }

    /// What estimates how far points are from a formula's surface; of the request, what is fixed of the estimate counts.
    ///
    /// Errors: [`Error::Formula`].
    pub fn clearance(&self, formula: &Formula, request: &Request) -> Result<Clearance, Error> {
        let arena = Arc::new(Arena::default());
        let settling = Settling { library: formula.library(), arena: &arena, request };
        settling.clearance(formula.graph().clone())
    }

    /// Finds views of a formula that are worth it, the best first; of the request, what is fixed of the estimate counts.
    ///
    /// Errors: [`Error::Formula`].
    pub fn views(&self, formula: &Arc<Formula>, request: &Request, search: &Search) -> Result<Vec<FoundView>, Error> {
        let arena = Arc::new(Arena::default());
        let settling = Settling { library: formula.library(), arena: &arena, request };
        settling.found(formula.graph().clone(), search)
    }

    /// The back ends, for work of other kinds.
    pub fn backends(&self) -> &Backends {
        &self.backends
    }
}
