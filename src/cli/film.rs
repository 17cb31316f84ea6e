//! Films: moments rendered into numbered files, with as few kernels as their structures allow.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use bulbfold::calibrate::cache::hash;
use bulbfold::diag::Diagnostic;
use bulbfold::engine::{Animation, Done, Error, Job, Moments, Observer, Recipe, Request, Stage};
use bulbfold::files::Target;
use bulbfold::film::{Form, PictureFile, Shutter};
use bulbfold::kernel::Compiling;
use bulbfold::render::Stats;
use serde_json::json;

use super::frames::{Names, why_not};
use super::output::not_written;
use super::picture_args::PictureArgs;
use super::picture_key::job_key;
use super::pictures::has_layers;
use super::render::kind_of;
use super::session::talk;
use super::{Failure, Outcome, Session, message};

/// Frames that are named one by one where they are rendered again.
const MOST_NAMED: usize = 20;

/// A film that is to be rendered.
pub struct Film<'a> {
    /// What its pictures are like.
    pub picture: &'a PictureArgs,
    /// What they are asked for: size and samples of pictures may be others than the arguments say.
    pub request: Request,
    /// What it shows: moments of each frame follow each other.
    pub moments: &'a dyn Moments,
    /// Moments that each frame is the average of.
    pub blur: u32,
    /// The frames to render, counted from 0.
    pub frames: Vec<u32>,
    /// Where they go.
    pub names: &'a Names,
    /// Whether frames are kept that are whole and of these settings.
    pub keeps: bool,
}

/// A frame that is there.
pub struct Written {
    /// Its number, counted from 0.
    pub frame: u32,
    /// Its file.
    pub path: PathBuf,
    /// What its pixels follow from, as a hash.
    pub key: String,
    /// Time that it took; none where it was kept.
    pub took: Option<Duration>,
}

/// Renders the frames that are missing.
pub fn render(mut film: Film, session: &Session) -> Result<Report, Failure> {
    let start = Instant::now();
    let failed = |error| session.failed(error);
    film.settle_request(session)?;
    let targets = film.names.targets(session, &film.frames)?;
    let mut watch = session.watch();
    let mut animation = Animation::settle(film.moments, &film.request, &mut watch).map_err(failed)?;
    announce(session, &film, &mut animation)?;
    let (mut report, mut named) = (Report::default(), 0);
    for (i, (&frame, target)) in film.frames.iter().zip(&targets).enumerate() {
        let begun = Instant::now();
        let jobs = film.jobs(&mut animation, frame).map_err(failed)?;
        let key = key_of(&jobs, &film.picture.output.forms()).map_err(failed)?;
        report.composing += begun.elapsed();
        let path = target.path().to_path_buf();
        let missing = if film.keeps { why_not(target, &key, film.request.size) } else { Some(None) };
        let Some(why) = missing else {
            report.written.push(Written { frame, path, key, took: None });
            continue;
        };
        if let Some(why) = why {
            named += 1;
            tell_again(&path, &why, named);
        }
        let mut part = Part { observer: &mut watch, done: i as f64, count: film.frames.len() as f64 };
        let done = render_frame(session, &film, (&jobs, &key), target, &mut part)?;
        report.add(&done);
        report.written.push(Written { frame, path, key, took: Some(begun.elapsed()) });
    }
    watch.progress(Stage::Rendering, 1.0);
    if named > MOST_NAMED {
        talk(&format!("{} more frames are rendered again", named - MOST_NAMED));
    }
    let backends = session.engine.backends();
    (report.compiled, report.structures) = (backends.compiled(), backends.structures());
    report.took = start.elapsed();
    Ok(report)
}

/// Settles the film, and hands on the jobs of each frame: those that it is the average of.
pub fn settle(mut film: Film, session: &Session, take: &mut dyn FnMut(u32, Vec<Job>) -> Outcome) -> Outcome {
    let failed = |error| session.failed(error);
    film.settle_request(session)?;
    let mut watch = session.watch();
    let mut animation = Animation::settle(film.moments, &film.request, &mut watch).map_err(failed)?;
    film.frames.iter().try_for_each(|&frame| take(frame, film.jobs(&mut animation, frame).map_err(failed)?))
}

impl Film<'_> {
    /// The jobs of a frame.
    fn jobs(&self, animation: &mut Animation, frame: u32) -> Result<Vec<Job>, Error> {
        (0..self.blur).map(|k| animation.job((frame * self.blur + k) as usize)).collect()
    }

    /// Settles what the frames' files want of each pixel, and reads the moments, so that a value out of range is told before anything is rendered.
    fn settle_request(&mut self, session: &Session) -> Outcome {
        let failed = |error| session.failed(error);
        let first = self.moments.moment(0).map_err(failed)?;
        let have_layers = has_layers(&first.formula.graph().scene, &self.request);
        self.request.layers = self.picture.output.layers(self.names.format(), have_layers)?;
        if let Some(path) = &mut self.request.path {
            // The moments of a frame share its paths.
            path.samples = path.samples.div_ceil(self.blur);
        }
        for moment in spread(self.moments.count()) {
            self.moments.moment(moment).map_err(failed)?;
        }
        Ok(())
    }
}

/// Most moments that are read before the first is rendered.
const MOST_READ: usize = 500;

/// Moments, evenly spread where there are many.
fn spread(count: usize) -> impl Iterator<Item = usize> {
    let read = count.min(MOST_READ);
    (0..read).map(move |i| i * (count - 1) / (read - 1).max(1))
}

/// Tells the engine what moves, so that it is a uniform from the start.
fn announce(session: &Session, film: &Film, animation: &mut Animation) -> Outcome {
    let mut moments = animation.key_moments();
    moments.push(1.min(film.moments.count() - 1));
    for moment in moments {
        let job = animation.job(moment).map_err(|error| session.failed(error))?;
        let composed = job.composed().map_err(|error| session.failed(error))?;
        session.engine.backends().announce(composed);
    }
    Ok(())
}

/// The key of a frame: that of its picture, or a hash of those that it is the average of and of what is said of its file.
pub fn key_of(jobs: &[Job], forms: &str) -> Result<String, Error> {
    let keys = jobs.iter().map(job_key).collect::<Result<Vec<String>, Error>>()?;
    match &keys[..] {
        [only] if forms.is_empty() => Ok(only.clone()),
        many => Ok(format!("{:032x}", hash(format!("{} {forms}", many.join(" ")).as_bytes()))),
    }
}

fn tell_again(path: &Path, why: &str, named: usize) {
    if named <= MOST_NAMED {
        talk(&format!("{} is rendered again: {why}", path.display()));
    }
}

/// Renders a frame into its file.
fn render_frame(
    session: &Session,
    film: &Film,
    (jobs, key): (&[Job], &str),
    target: &Target,
    observer: &mut Part,
) -> Result<Done, Failure> {
    let failed = |error| session.failed(error);
    let scene = &jobs[0].composed().map_err(failed)?.graph.scene;
    let form = film.picture.output.form(film.names.format(), &film.request, scene, key);
    let mut file = PictureFile::new(target, form.clone()).map_err(|error| not_written(target, &error))?;
    let done = match jobs {
        [job] => session.engine.render(job, job.rows(), &mut file, observer),
        many => blurred(session, many, &form, &mut file, observer),
    };
    let recipe = |done: &Done| Recipe { backend: kind_of(&done.backend), job: jobs[0].clone() }.text();
    match done {
        Ok(done) => {
            let recipe = (jobs.len() == 1).then(|| recipe(&done));
            file.finish(recipe.as_deref()).map_err(|error| not_written(target, &error))?;
            Ok(done)
        }
        Err(Error::Sink(error)) => match file.finish(None) {
            Err(cause) => Err(not_written(target, &cause)),
            Ok(_) => Err(not_written(target, &error)),
        },
        Err(error) => Err(failed(error)),
    }
}

/// Renders the moments of a frame, and gives their average to its file.
fn blurred(
    session: &Session,
    jobs: &[Job],
    form: &Form,
    file: &mut PictureFile,
    observer: &mut Part,
) -> Result<Done, Error> {
    let mut shutter = Shutter::new(form, 0).map_err(Error::Sink)?;
    let mut all: Option<Done> = None;
    for (i, job) in jobs.iter().enumerate() {
        shutter.open();
        let parts = jobs.len() as f64;
        let (done, count) = (observer.done * parts + i as f64, observer.count * parts);
        let mut part = Part { done, count, observer: &mut *observer.observer };
        let done = session.engine.render(job, job.rows(), &mut shutter, &mut part)?;
        match &mut all {
            Some(all) => sum(&mut all.stats, &done.stats),
            None => all = Some(done),
        }
    }
    file.push(&shutter.close().map_err(Error::Sink)?).map_err(Error::Sink)?;
    all.ok_or(Error::Cancelled)
}

/// Adds what a picture counted, and its times.
fn sum(all: &mut Stats, stats: &Stats) {
    all.add(stats);
    all.render += stats.render;
    all.compile += stats.compile;
    all.compiling = stats.compiling;
}

/// Tells of a picture's progress as a part of the film's.
pub struct Part<'a> {
    /// Who is told.
    pub observer: &'a mut dyn Observer,
    /// What was done before, in pictures.
    pub done: f64,
    /// All that is to be done.
    pub count: f64,
}

impl Observer for Part<'_> {
    fn progress(&mut self, stage: Stage, share: f64) {
        if stage == Stage::Rendering {
            self.observer.progress(stage, ((self.done + share) / self.count).min(1.0 - 1e-9));
        }
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

/// What was counted in all frames.
#[derive(Default)]
pub struct Report {
    /// The frames that are there.
    pub written: Vec<Written>,
    /// Time of all.
    pub took: Duration,
    backend: String,
    composing: Duration,
    counted: Stats,
    compiling: Option<Compiling>,
    compiled: usize,
    structures: BTreeMap<&'static str, usize>,
}

impl Report {
    fn add(&mut self, done: &Done) {
        self.backend.clone_from(&done.backend);
        sum(&mut self.counted, &done.stats);
        self.compiling = done.stats.compiling;
    }

    fn rendered(&self) -> usize {
        self.written.iter().filter(|frame| frame.took.is_some()).count()
    }

    /// Kernels that a frame's structure changes, and how many of each there are.
    fn changing(&self) -> impl Iterator<Item = (&'static str, usize)> {
        self.structures.iter().filter(|(_, count)| **count > 1).map(|(name, count)| (*name, *count))
    }

    fn estimates(&self) -> u64 {
        let counted = &self.counted;
        counted.beam_estimates + counted.estimates + counted.shadow_estimates
    }

    /// The counts as one JSON object.
    pub fn json(&self) -> serde_json::Value {
        let counted = &self.counted;
        let changing: serde_json::Map<_, _> = self.changing().map(|(k, n)| (k.into(), n.into())).collect();
        json!({
            "version": 1,
            "backend": self.backend,
            "frames": self.rendered(),
            "skipped": self.written.len() - self.rendered(),
            "kernels_compiled": self.compiled,
            "structures": changing,
            "rays": counted.rays,
            "unfinished": counted.unfinished,
            "nan": counted.nan,
            "estimates": self.estimates(),
            "compose_seconds": self.composing.as_secs_f64(),
            "compile_seconds": counted.compile.as_secs_f64(),
            "render_seconds": counted.render.as_secs_f64(),
        })
    }

    /// The counts as people read them.
    pub fn table(&self) -> String {
        let counted = &self.counted;
        let mut text = format!("{:<20} {}\n", "back end", self.backend);
        let mut row = |name: &str, value: String| text.push_str(&format!("{name:<20} {value}\n"));
        row("frames", format!("{} rendered, {} kept", self.rendered(), self.written.len() - self.rendered()));
        let changing: Vec<String> = self.changing().map(|(name, n)| format!("{n} of {name}")).collect();
        let why = match changing.is_empty() {
            true => "every frame has the same".to_string(),
            false => format!("the structure changes: {}", changing.join(", ")),
        };
        row("kernels compiled", format!("{} for all frames; {why}", self.compiled));
        if let Some(compiling) = self.compiling {
            row("compiling", super::stats::compiling(&compiling));
        }
        row("estimates per ray", format!("{:.1}", self.estimates() as f64 / counted.rays.max(1) as f64));
        row("unfinished rays", counted.unfinished.to_string());
        row("NaN rays", counted.nan.to_string());
        row("compose time", format!("{:.3} s", self.composing.as_secs_f64()));
        row("compile time", format!("{:.3} s", counted.compile.as_secs_f64()));
        row("render time", format!("{:.3} s", counted.render.as_secs_f64()));
        text
    }
}

/// The failure of a film that cannot be put together.
pub fn not_joined(path: &Path, why: &str) -> Failure {
    Failure::Work(message(&format!("cannot make {}: {why}", path.display()), "its frames are kept beside it"))
}
