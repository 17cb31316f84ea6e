//! Rows of a job on a back end, on the caller's thread or on one of their own.

use std::ops::Range;
use std::sync::Arc;
use std::thread::JoinHandle;

use super::{Backends, Cancel, Composed, Engine, Error, Job, Observer, Sink, Stage, Work};
use crate::diag::Diagnostic;
use crate::film;
use crate::kernel::template::Kept;
use crate::kernel::{Backend, BackendError, Kernel};
use crate::render::{Renderer, Stats};

/// What was rendered.
pub struct Done {
    /// The back end that did it.
    pub backend: String,
    /// What was counted.
    pub stats: Stats,
}

/// What is rendered of a job.
pub(super) struct Piece {
    pub rows: Range<u32>,
    /// Of pictures of paths: the samples; all without it.
    pub samples: Option<Range<u32>>,
}

/// Rows, and how many of them the sink has.
struct Rows<'a> {
    composed: Arc<Composed>,
    rows: Range<u32>,
    samples: Option<Range<u32>>,
    sink: &'a mut dyn Sink,
    /// Why the sink took no more.
    refused: Option<std::io::Error>,
    is_cancelled: bool,
}

impl Work for Rows<'_> {
    type Output = Stats;

    fn begin(&mut self, backend: &str) {
        self.sink.begin(backend);
    }

    fn run<B: Backend>(
        &mut self,
        backend: &B,
        kernels: &mut Kept<B>,
        observer: &mut dyn Observer,
    ) -> Result<Stats, BackendError> {
        let Composed { arena, settings, pipeline, .. } = &*self.composed;
        let prepare = |name: &'static str, kernel: &Kernel| kernels.prepare(backend, name, arena, kernel);
        let mut renderer = Renderer::with(backend, arena, pipeline, settings, prepare)?;
        if let Some(samples) = &self.samples {
            renderer.take_samples(samples.clone());
        }
        let bytes = 3 * settings.size.width as usize;
        let (rows, sink) = (&mut self.rows, &mut *self.sink);
        let (refused, is_cancelled) = (&mut self.refused, &mut self.is_cancelled);
        let wanted = rows.clone();
        let layers = sink.layers();
        // Where noise says when a tile is done, its pixels follow from all of it.
        let is_cut_freely = settings.path.is_none_or(|path| path.noise == 0.0);
        if let Some(most) = sink.most_rows().filter(|_| is_cut_freely) {
            renderer.cut.band = renderer.cut.band.min(most.max(1));
        }
        let mut take = |pixels: film::Rows| {
            rows.start += (pixels.srgb.len() / bytes) as u32;
            sink.push(pixels).map_err(|error| *refused = Some(error)).is_ok()
        };
        renderer.render_layers(wanted, layers, &mut take, &mut |share| {
            observer.progress(Stage::Rendering, share);
            *is_cancelled |= observer.is_cancelled();
            !*is_cancelled
        })?;
        Ok(renderer.stats)
    }
}

pub(super) fn render(
    backends: &Backends,
    job: &Job,
    Piece { rows, samples }: Piece,
    sink: &mut dyn Sink,
    observer: &mut dyn Observer,
) -> Result<Done, Error> {
    let height = job.size().height;
    if rows.start > rows.end || rows.end > height {
        let text = format!("the rows {}..{} are not in a picture of {height}", rows.start, rows.end);
        return Err(Error::request(text, format!("rows go from 0 to {height}")));
    }
    let missing = sink.layers().data().iter().find(|layer| !job.request.layers.has(*layer));
    if let Some(layer) = missing {
        let text = format!("the layer `{}` is wanted, and the job was settled without it", layer.name());
        return Err(Error::request(text, "name it in the request's `layers`"));
    }
    if job.request.path.is_some() && !sink.layers().data().is_empty() {
        return Err(Error::request("a picture of paths of light has no layers", "leave `path` or the layers out"));
    }
    let composed = job.composed()?.clone();
    let mut work = Rows { composed, rows, samples, sink, refused: None, is_cancelled: false };
    let (backend, stats) = backends.run(job.request.backend, job.precision, &mut work, observer)?;
    match (work.refused, work.is_cancelled) {
        (Some(error), _) => Err(Error::Sink(error)),
        (None, true) => Err(Error::Cancelled),
        (None, false) => {
            observer.progress(Stage::Rendering, 1.0);
            Ok(Done { backend, stats })
        }
    }
}

/// A part of the progress of work that has several.
pub(super) struct Part<'a> {
    pub observer: &'a mut dyn Observer,
    /// Where it begins.
    pub from: f64,
    /// How much of the whole it is.
    pub share: f64,
}

impl Observer for Part<'_> {
    fn progress(&mut self, stage: Stage, share: f64) {
        self.observer.progress(stage, self.from + share * self.share);
    }

    fn warn(&mut self, warning: Diagnostic) {
        self.observer.warn(warning);
    }

    fn note(&mut self, text: &str) {
        self.observer.note(text);
    }

    fn is_cancelled(&self) -> bool {
        self.observer.is_cancelled()
    }
}

/// A job that runs on a thread of its own. Dropping it cancels the job.
pub struct Running<S> {
    cancel: Cancel,
    thread: Option<JoinHandle<(S, Result<Done, Error>)>>,
}

impl<S> Running<S> {
    /// Ends the job at the next tile.
    pub fn cancel(&self) {
        self.cancel.cancel();
    }

    /// Whether there is nothing left to do.
    pub fn is_finished(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Waits for the end; the sink comes back with what came of the job.
    ///
    /// Panics where the job's thread did.
    pub fn join(mut self) -> (S, Result<Done, Error>) {
        let thread = self.thread.take().expect("a job is joined once");
        thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }
}

impl<S> Drop for Running<S> {
    fn drop(&mut self) {
        self.cancel.cancel();
    }
}

/// An observer that also ends where a job's handle asks for it.
struct Ending<O> {
    observer: O,
    cancel: Cancel,
}

impl<O: Observer> Observer for Ending<O> {
    fn progress(&mut self, stage: Stage, share: f64) {
        self.observer.progress(stage, share);
    }

    fn warn(&mut self, warning: Diagnostic) {
        self.observer.warn(warning);
    }

    fn note(&mut self, text: &str) {
        self.observer.note(text);
    }

    fn is_cancelled(&self) -> bool {
        self.cancel.is_cancelled() || self.observer.is_cancelled()
    }
}

impl Engine {
    /// Renders rows of a job on a thread of its own, and returns at once.
    pub fn start<S: Sink + 'static, O: Observer + 'static>(
        self: &Arc<Engine>,
        job: Job,
        rows: Range<u32>,
        mut sink: S,
        observer: O,
    ) -> Running<S> {
        let (engine, cancel) = (self.clone(), Cancel::default());
        let mut observer = Ending { observer, cancel: cancel.clone() };
        let thread = std::thread::spawn(move || {
            let done = engine.render(&job, rows, &mut sink, &mut observer);
            (sink, done)
        });
        Running { cancel, thread: Some(thread) }
    }
}
