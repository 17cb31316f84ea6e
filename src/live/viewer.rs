//! Pictures of what is wanted last, each finer than the one before.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::diag::Diagnostic;
use crate::engine::{CameraChange, Engine, Error, Formula, Job, Observer, Request, Stage};
use crate::film::{Image, Layers};
use crate::graph::Camera;
use crate::shade::Size;

/// Pixels of the first picture, at most: 320x180 of them.
const FIRST: u64 = 320 * 180;
/// How many times as many pixels the next picture has.
const FINER: u64 = 4;

/// What is to be seen.
#[derive(Clone)]
pub struct Wanted {
    /// The formula.
    pub formula: Arc<Formula>,
    /// The whole picture.
    pub request: Request,
    /// Where the camera was moved to; none is the request's.
    pub camera: Option<Camera>,
    /// Whether it will move at once again: then only the first picture is rendered.
    pub is_moving: bool,
}

/// How fine a picture is.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Part {
    /// The first one: small, by rules, with one sample a pixel.
    First,
    /// One between.
    Finer,
    /// The whole picture, as `render` makes it.
    Whole,
}

/// A picture.
pub struct Shown {
    /// Number of the wish that it fulfils.
    pub wish: u64,
    /// How fine it is.
    pub part: Part,
    /// Itself.
    pub image: Image,
    /// Where it was seen from; none of a plane.
    pub camera: Option<Camera>,
    /// Time since it was wished for.
    pub took: Duration,
}

/// Receives pictures and what is to be said of them.
pub trait Screen: Send + 'static {
    /// A picture is done.
    fn show(&mut self, shown: Shown);
    /// The share of a stage that is done, from 0 to 1.
    fn progress(&mut self, _wish: u64, _stage: Stage, _share: f64) {}
    /// Something that a user should know of a wish.
    fn warn(&mut self, wish: u64, warning: Diagnostic);
    /// A wish cannot be fulfilled.
    fn fail(&mut self, wish: u64, error: Error);
}

/// Renders what is wanted last. Dropping it ends its thread.
pub struct Viewer {
    wishes: Arc<Wishes>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Default)]
struct Wishes {
    last: Mutex<Last>,
    changed: Condvar,
}

#[derive(Default)]
struct Last {
    number: u64,
    wanted: Option<(Wanted, Instant)>,
    is_over: bool,
}

impl Wishes {
    fn last(&self) -> MutexGuard<'_, Last> {
        self.last.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for a wish; none when the viewer is dropped.
    fn next(&self) -> Option<(u64, Wanted, Instant)> {
        let mut last = self.last();
        loop {
            if last.is_over {
                return None;
            }
            if let Some((wanted, since)) = last.wanted.take() {
                return Some((last.number, wanted, since));
            }
            last = self.changed.wait(last).unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn is_past(&self, number: u64) -> bool {
        let last = self.last();
        last.is_over || last.number != number
    }
}

impl Viewer {
    /// Starts the thread. The engine should keep its kernels ([`Engine::keeping_kernels`]).
    pub fn start(engine: Arc<Engine>, mut screen: impl Screen) -> Viewer {
        let wishes = Arc::new(Wishes::default());
        let own = wishes.clone();
        let thread = std::thread::spawn(move || {
            let mut held = None;
            while let Some((number, wanted, since)) = own.next() {
                let mut wish =
                    Wish { engine: &engine, wishes: &own, number, since, screen: &mut screen, held: &mut held };
                match wish.fulfil(&wanted) {
                    Ok(()) | Err(Error::Cancelled) => {}
                    Err(error) => screen.fail(number, error),
                }
            }
        });
        Viewer { wishes, thread: Some(thread) }
    }

    /// Wants something else than before, from now on; returns the number of the wish.
    pub fn show(&self, wanted: Wanted) -> u64 {
        self.show_since(wanted, Instant::now())
    }

    /// The same of a wish that is older than this call.
    pub fn show_since(&self, wanted: Wanted, since: Instant) -> u64 {
        let mut last = self.wishes.last();
        last.number += 1;
        last.wanted = Some((wanted, since));
        self.wishes.changed.notify_one();
        last.number
    }
}

impl Drop for Viewer {
    fn drop(&mut self) {
        self.wishes.last().is_over = true;
        self.wishes.changed.notify_one();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// A wish that is being fulfilled.
struct Wish<'a, S> {
    engine: &'a Engine,
    wishes: &'a Wishes,
    number: u64,
    since: Instant,
    screen: &'a mut S,
    /// The job of which the last whole picture was made, or was to be made.
    held: &'a mut Option<Job>,
}

impl<S: Screen> Wish<'_, S> {
    fn fulfil(&mut self, wanted: &Wanted) -> Result<(), Error> {
        let size = wanted.request.size;
        let first = self.first_job(wanted)?;
        self.render(&first, Part::First)?;
        if wanted.is_moving || self.wishes.is_past(self.number) {
            return Ok(());
        }
        let job = self.settled(wanted)?;
        let mut finer = within(size, FINER * pixels(first.size()));
        while finer != size {
            let request = quick(&job.request, finer);
            self.render(&job.with_request(job.formula.clone(), request), Part::Finer)?;
            finer = within(size, FINER * pixels(finer));
        }
        self.render(&job, Part::Whole)
    }

    /// The job of the first picture: with what was settled for this formula before, or by rules alone.
    fn first_job(&self, wanted: &Wanted) -> Result<Job, Error> {
        let request = quick(&wanted.request, within(wanted.request.size, FIRST));
        if let Some(held) = self.held.as_ref().filter(|held| Arc::ptr_eq(&held.formula, &wanted.formula)) {
            let job = held.with_request(wanted.formula.clone(), request);
            return Ok(wanted.camera.map_or(job.clone(), |camera| job.with_camera(camera)));
        }
        let request = Request { calibrate: false, ..request };
        self.engine.settle(&wanted.formula, &seen_from(request, wanted.camera), &mut ())
    }

    /// The job of the whole picture, as `render` settles it.
    fn settled(&mut self, wanted: &Wanted) -> Result<Job, Error> {
        let request = seen_from(wanted.request.clone(), wanted.camera);
        let engine = self.engine;
        let job = engine.settle(&wanted.formula, &request, &mut self.telling())?;
        *self.held = Some(job.clone());
        Ok(job)
    }

    fn render(&mut self, job: &Job, part: Part) -> Result<(), Error> {
        let mut image = Image { size: job.size(), rgb: Vec::new() };
        let engine = self.engine;
        // The first picture is soon there: were it ended by the next wish, a camera that moves would show none.
        match part {
            Part::First => engine.render(job, job.rows(), &mut image, &mut ())?,
            _ => engine.render(job, job.rows(), &mut image, &mut self.telling())?,
        };
        let shown = Shown { wish: self.number, part, image, camera: job.camera, took: self.since.elapsed() };
        self.screen.show(shown);
        Ok(())
    }

    fn telling(&mut self) -> Telling<'_, S> {
        Telling { wishes: self.wishes, number: self.number, screen: self.screen }
    }
}

/// Hands on what a job says, and ends it where something else is wanted.
struct Telling<'a, S> {
    wishes: &'a Wishes,
    number: u64,
    screen: &'a mut S,
}

impl<S: Screen> Observer for Telling<'_, S> {
    fn progress(&mut self, stage: Stage, share: f64) {
        self.screen.progress(self.number, stage, share);
    }

    fn warn(&mut self, warning: Diagnostic) {
        self.screen.warn(self.number, warning);
    }

    fn is_cancelled(&self) -> bool {
        self.wishes.is_past(self.number)
    }
}

/// A request for a picture that is soon there.
fn quick(request: &Request, size: Size) -> Request {
    Request { size, samples: 1, path: None, layers: Layers::NONE, ..request.clone() }
}

/// A request whose camera is this one.
fn seen_from(request: Request, camera: Option<Camera>) -> Request {
    match camera {
        Some(camera) => Request { camera: CameraChange::to(camera), ..request },
        None => request,
    }
}

fn pixels(size: Size) -> u64 {
    u64::from(size.width) * u64::from(size.height)
}

/// The size of the same proportions with at most so many pixels.
fn within(size: Size, most: u64) -> Size {
    let scale = (most as f64 / pixels(size) as f64).sqrt();
    if scale > 0.75 {
        return size;
    }
    let edge = |edge: u32| ((f64::from(edge) * scale).round() as u32).max(1);
    Size { width: edge(size.width), height: edge(size.height) }
}
