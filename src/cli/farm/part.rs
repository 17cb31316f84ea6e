//! `bulbfold render JOB --part I/N`: a part of a job.

use std::path::Path;

use bulbfold::diag::printable;
use bulbfold::engine::{BackendChoice, Error, Job, Observer, Request, Sink, Stage};
use bulbfold::film::{Form, Format, Layers, Rows, Shutter};

use super::Told;
use super::bundle::{Bundle, Manifest, Place, make_folder};
use super::parts::{PartReader, Unfinished, layers_of};
use crate::cli::film::Part;
use crate::cli::output::cannot_write;
use crate::cli::session::talk;
use crate::cli::{Failure, Outcome, Session, usage};

/// A part, as the command line names it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum PartArg {
    /// By its number, of so many.
    Number(u32, u32),
    /// By the number of its frame, and of its rows and its samples, counted from 1.
    Place(u32, u32, u32),
}

/// Reads `I/N` or `FRAME,TILE,SAMPLES`.
pub fn parse_part(text: &str) -> Result<PartArg, String> {
    let numbers = |by: char| text.split(by).map(|n| n.trim().parse::<u32>().ok().filter(|n| *n > 0)).collect();
    let (of, at): (Option<Vec<u32>>, Option<Vec<u32>>) = (numbers('/'), numbers(','));
    match (of.as_deref(), at.as_deref()) {
        (Some(&[number, count]), _) if number <= count => Ok(PartArg::Number(number, count)),
        (_, Some(&[frame, tile, samples])) => Ok(PartArg::Place(frame, tile, samples)),
        _ => Err("write a part and their number, counted from 1, such as 3/96, or FRAME,TILE,SAMPLES".into()),
    }
}

impl PartArg {
    fn place(self, manifest: &Manifest) -> Result<Place, Failure> {
        let parts = manifest.parts();
        match self {
            PartArg::Number(number, count) if count == parts => Ok(manifest.place(number)),
            PartArg::Number(_, count) => {
                let text = format!("the job has {parts} parts, and not {count}");
                Err(usage(text, &format!("give --part from 1/{parts} to {parts}/{parts}")))
            }
            PartArg::Place(number, tile, samples) => {
                let frame = manifest.frames.iter().position(|frame| frame.number == number);
                let (Manifest { tiles, samples_split, .. }, frame) = (manifest, frame.map(|frame| frame as u32));
                match frame.filter(|_| tile <= *tiles && samples <= *samples_split) {
                    Some(frame) => Ok(manifest.place((frame * tiles + tile - 1) * samples_split + samples)),
                    None => {
                        let text = format!("the job has no part {number},{tile},{samples}");
                        let help =
                            format!("of each frame there are {tiles} parts of rows and {samples_split} of samples");
                        Err(usage(text, &help))
                    }
                }
            }
        }
    }
}

/// How a part is rendered.
#[derive(Clone, Copy)]
pub struct How {
    /// Where, if that is given.
    pub backend: Option<BackendChoice>,
    /// Whether an engine is told of progress.
    pub is_engine: bool,
}

/// Renders a part, unless it is there.
pub fn run(folder: &Path, part: PartArg, how: How, session: &mut Session) -> Outcome {
    Told::outcome(how.is_engine, render(folder, part, how, session))
}

fn render(folder: &Path, part: PartArg, how: How, session: &mut Session) -> Outcome {
    let bundle = Bundle::open(folder)?;
    let place = part.place(&bundle.manifest)?;
    let jobs = bundle.jobs(session, place.frame)?;
    let jobs = jobs.into_iter().map(|job| on_backend(job, how.backend)).collect::<Result<Vec<Job>, Failure>>()?;
    let path = bundle.part(place.number);
    if is_there(&bundle, place, &jobs[0], session.quiet) {
        return Ok(());
    }
    make_folder(&bundle.folder.join("parts"))?;
    let unfinished = bundle.unfinished(place.number);
    let failed = |error: std::io::Error| cannot_write(&unfinished, &error);
    let head = bundle.head(place.number);
    let (mut file, was_other) = Unfinished::open(&unfinished, &head, &jobs[0]).map_err(failed)?;
    if was_other {
        talk(&format!("{} was of another job and is begun anew", unfinished.display()));
    }
    if file.rows > 0 && !session.quiet {
        talk(&format!("{} goes on at row {}", path.display(), bundle.manifest.rows(place).start + file.rows + 1));
    }
    let session = if jobs.len() > 1 { session.keeping_kernels() } else { &*session };
    let mut told = Told::new(session, how.is_engine);
    told.status(&printable(&bundle.manifest.shown(place)));
    let mut work = Work { session, bundle: &bundle, jobs: &jobs, place, file: &mut file };
    work.run(&mut told).map_err(|error| match error {
        Error::Sink(error) => failed(error),
        error => session.failed(error),
    })?;
    file.finish(&path).map_err(|error| cannot_write(&path, &error))?;
    told.progress(Stage::Rendering, 1.0);
    session.say(&format!("{}: {}", path.display(), bundle.manifest.shown(place)));
    Ok(())
}

/// Whether a part is whole; says so, or why one that is there is not.
fn is_there(bundle: &Bundle, place: Place, job: &Job, quiet: bool) -> bool {
    let path = bundle.part(place.number);
    if !path.exists() {
        return false;
    }
    let rows = bundle.manifest.rows(place).len() as u32;
    let part = PartReader::open(bundle, place.number, layers_of(job.request.layers));
    match part.and_then(|part| part.check(job.size().width, rows)) {
        Ok(_) if quiet => true,
        Ok(_) => {
            talk(&format!("{} is there", path.display()));
            true
        }
        Err(why) => {
            talk(&format!("{} is rendered again: it {why}", path.display()));
            false
        }
    }
}

/// The job on the back end that is asked for, where it leaves that open.
fn on_backend(job: Job, backend: Option<BackendChoice>) -> Result<Job, Failure> {
    let Some(backend) = backend.filter(|backend| *backend != job.request.backend) else { return Ok(job) };
    if job.request.backend != BackendChoice::Auto {
        let help = "make the job without --backend, and join its parts with --mix-backends";
        return Err(usage("the job says where it is computed", help));
    }
    let (formula, request) = (job.formula.clone(), Request { backend, ..job.request.clone() });
    Ok(job.with_request(formula, request))
}

/// A part in the making.
struct Work<'a> {
    session: &'a Session,
    bundle: &'a Bundle,
    jobs: &'a [Job],
    place: Place,
    file: &'a mut Unfinished,
}

impl Work<'_> {
    /// Renders the rows that are missing.
    fn run(&mut self, observer: &mut dyn Observer) -> Result<(), Error> {
        let manifest = &self.bundle.manifest;
        let (all, samples) = (manifest.rows(self.place), manifest.samples(self.place));
        let rows = all.start + self.file.rows..all.end;
        if rows.is_empty() {
            return Ok(());
        }
        let (there, left) = (f64::from(self.file.rows), rows.len() as f64);
        let mut part = Part { observer, done: there / left, count: (there + left) / left };
        let engine = &self.session.engine;
        match (self.jobs, samples) {
            ([job], None) => engine.render(job, rows, self.file, &mut part).map(drop),
            ([job], Some(samples)) => engine.render_samples(job, (rows, samples), self.file, &mut part).map(drop),
            _ => {
                let step = self.file.most_rows().unwrap_or(u32::MAX);
                let tops = rows.clone().step_by(step as usize);
                let bands = tops.map(|top| top..rows.end.min(top.saturating_add(step)));
                bands.into_iter().try_for_each(|band| self.blurred(band, part.observer))
            }
        }
    }

    /// The average of the moments of some rows.
    fn blurred(&mut self, rows: std::ops::Range<u32>, observer: &mut dyn Observer) -> Result<(), Error> {
        let (first, all) = (&self.jobs[0], self.bundle.manifest.rows(self.place));
        let scene = &first.composed()?.graph.scene;
        let form = self.bundle.manifest.output.form(Format::Exr, &first.request, scene, "");
        let form = Form { layers: first.request.layers, transparent: false, ..form };
        let mut shutter = Shutter::new(&form, rows.start).map_err(Error::Sink)?;
        let (each, count) = (rows.len() as f64 / all.len() as f64, self.jobs.len() as f64);
        for (i, job) in self.jobs.iter().enumerate() {
            shutter.open();
            let before = f64::from(rows.start - all.start) / rows.len() as f64;
            let mut part = Part { observer: &mut *observer, done: before * count + i as f64, count: count / each };
            let mut sink = OpenShutter { shutter: &mut shutter, file: self.file };
            self.session.engine.render(job, rows.clone(), &mut sink, &mut part)?;
        }
        let rows = shutter.close().map_err(Error::Sink)?;
        self.file.push(rows).map_err(Error::Sink)
    }
}

/// Takes the rows of a moment, and tells the part's file what made them.
struct OpenShutter<'a> {
    shutter: &'a mut Shutter,
    file: &'a mut Unfinished,
}

impl Sink for OpenShutter<'_> {
    fn layers(&self) -> Layers {
        self.shutter.wanted()
    }

    fn begin(&mut self, backend: &str) {
        self.file.begin(backend);
    }

    fn push(&mut self, rows: Rows) -> std::io::Result<()> {
        self.shutter.push(rows);
        Ok(())
    }
}
