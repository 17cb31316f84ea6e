//! `bulbfold join`: the picture or the film of a job's parts.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use bulbfold::engine::{Error, Job, JoinedSamples, Observer, Recipe, Stage};
use bulbfold::files::Target;
use bulbfold::film::{LightSum, PictureFile, Pictures};
use clap::Args;

use super::encode;
use super::farm::Told;
use super::farm::bundle::{Bundle, Place, Reel};
use super::farm::parts::{PartReader, Piece, layers_of};
use super::film::{Written, key_of};
use super::frames::{Names, why_not};
use super::output::not_written;
use super::picture_key::job_key;
use super::pictures::OutputArgs;
use super::progress::{Progress, short};
use super::render::kind_of;
use super::{Failure, Outcome, Session, message, usage};

/// Arguments of `join`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold join bulb_job
  bulbfold join bulb_job -o bulb.png
  bulbfold join flight_job -o flight.mp4 --mix-backends

Parts that are missing or broken are named, and nothing is written: docs/farm.md.")]
pub struct Arguments {
    /// The folder of the job, which `bulbfold job` has written
    #[arg(value_name = "JOB")]
    job: PathBuf,
    /// The picture or film to write, instead of the one that the job names
    #[arg(short, long, value_name = "OUT")]
    output: Vec<PathBuf>,
    /// Join parts that different back ends have made; their pixels differ a little
    #[arg(long)]
    mix_backends: bool,
    /// Replace a picture by another one
    #[arg(long)]
    force: bool,
    /// Keep the frames of a film that is one file, in FILM.frames
    #[arg(long)]
    keep_frames: bool,
    /// Say progress as the engines of Open Job Description read it, on stderr
    #[arg(long)]
    openjd: bool,
}

/// Parts that are named one by one.
const MOST_NAMED: usize = 20;

/// Runs the command.
pub fn run(arguments: &Arguments, session: &mut Session) -> Outcome {
    let joined = || {
        let start = Instant::now();
        let bundle = Bundle::open(&arguments.job)?;
        let backend = arguments.check(&bundle, session)?;
        let mut told = Told::new(session, arguments.openjd);
        let mut join = Join { session, bundle: &bundle, backend, told: &mut told, done: 0 };
        let names = match &bundle.manifest.film {
            Some(reel) => arguments.film(&mut join, reel)?,
            None => arguments.still(&mut join)?,
        };
        told.progress(Stage::Rendering, 1.0);
        session.say(&format!("{names} ({})", short(start.elapsed())));
        Ok(())
    };
    Told::outcome(arguments.openjd, joined())
}

impl Arguments {
    /// Looks at all parts before anything is written; gives the back end that made them, in words.
    fn check(&self, bundle: &Bundle, session: &Session) -> Result<String, Failure> {
        let (manifest, mut odd) = (&bundle.manifest, Vec::new());
        let mut made: BTreeMap<String, Vec<u32>> = BTreeMap::new();
        // All frames have the same layers.
        let layers = layers_of(bundle.jobs(session, 0)?[0].request.layers);
        for number in 1..=manifest.parts() {
            let rows = manifest.rows(manifest.place(number)).len() as u32;
            let part = PartReader::open(bundle, number, layers).and_then(|part| part.check(manifest.size.width, rows));
            match part {
                Ok(backends) => backends.into_iter().for_each(|backend| made.entry(backend).or_default().push(number)),
                Err(why) => odd.push((number, why)),
            }
        }
        if !odd.is_empty() {
            return Err(Failure::Work(unusable(bundle, &odd)));
        }
        if made.len() > 1 && !self.mix_backends {
            let first = |(backend, parts): (&String, &Vec<u32>)| {
                let numbers: Vec<String> = parts.iter().take(MOST_NAMED).map(u32::to_string).collect();
                let more = if parts.len() > MOST_NAMED { ", ..." } else { "" };
                format!("{backend} (parts {}{more})", numbers.join(", "))
            };
            let all: Vec<String> = made.iter().map(first).collect();
            let text = format!("different back ends made the parts: {}", all.join("; "));
            return Err(usage(text, "render them on one, or join them as they are: --mix-backends"));
        }
        // As the pictures of one machine say it.
        let mut kinds: Vec<String> = made.keys().map(|backend| kind_of(backend)).collect();
        kinds.dedup();
        Ok(kinds.join("; "))
    }

    /// The files: those that are asked for, else those that the job names, in its folder.
    fn outputs(&self, bundle: &Bundle) -> OutputArgs {
        let output = &bundle.manifest.output;
        let names = match self.output.is_empty() {
            true => output.names().iter().map(|name| bundle.folder.join(name)).collect(),
            false => self.output.clone(),
        };
        output.with_names(names, self.force)
    }

    /// Joins a picture; gives the names of its files.
    fn still(&self, join: &mut Join) -> Result<String, Failure> {
        let output = self.outputs(join.bundle);
        let wanted = output.wanted(Path::new(""))?;
        let jobs = join.bundle.jobs(join.session, 0)?;
        let key = job_key(&jobs[0]).map_err(|error| join.session.failed(error))?;
        let mut files = output.open(join.session, &wanted, &jobs[0], &key)?;
        let names: Vec<String> = files.0.iter().map(|file| file.target().path().display().to_string()).collect();
        check_layers(&files, &jobs[0])?;
        join.frame(0, &jobs, &mut files)?;
        join.finish(files, &jobs)?;
        Ok(names.join(", "))
    }

    /// Joins a film; gives the name of its file, or those of its first and last picture.
    fn film(&self, join: &mut Join, reel: &Reel) -> Result<String, Failure> {
        let output = self.outputs(join.bundle);
        let encoder = encode::encoder(&output, false)?;
        let names = match &encoder {
            Some(encoder) => Names::inside(&encoder.folder()),
            None => Names::new(&output, Path::new(&join.bundle.manifest.name), "a film")?,
        };
        let sound = reel.sound.as_ref().map(|name| join.bundle.folder.join(name));
        if let Some(encoder) = &encoder {
            encoder.prepare(sound.as_deref())?;
        }
        let numbers: Vec<u32> = join.bundle.manifest.frames.iter().map(|frame| frame.number - 1).collect();
        let targets = names.targets(join.session, &numbers)?;
        let mut written = Vec::new();
        for (index, target) in targets.iter().enumerate() {
            let key = join.film_frame(index, (&output, &names), target)?;
            written.push(Written { frame: numbers[index], path: target.path().to_path_buf(), key, took: None });
        }
        let count = numbers.len() as u32;
        let Some(encoder) = &encoder else {
            let ends =
                [written.first(), written.last()].map(|frame| frame.map(|frame| frame.path.display().to_string()));
            return Ok(ends.map(Option::unwrap_or_default).join(" to "));
        };
        // The sound of some frames begins where the first of them does.
        let begin =
            f64::from(numbers.first().copied().unwrap_or(0)) * f64::from(reel.rate[1]) / f64::from(reel.rate[0]);
        let sound = sound.as_deref().map(|sound| (sound, begin));
        let progress = Progress::new(join.session.quiet || self.openjd);
        encoder.join(&written, (reel.rate(), reel.every), sound, self.keep_frames, progress)?;
        Ok(format!("{count} frames to {}", encoder.target().display()))
    }
}

/// What is wrong with parts, and what to do.
fn unusable(bundle: &Bundle, odd: &[(u32, String)]) -> String {
    let parts = bundle.manifest.parts();
    let mut text = format!("{} of {parts} parts cannot be joined", odd.len());
    for (number, why) in odd.iter().take(MOST_NAMED) {
        let place = bundle.manifest.shown(bundle.manifest.place(*number));
        text.push_str(&format!("\n  {number}/{parts} ({place}) {why}"));
    }
    if odd.len() > MOST_NAMED {
        text.push_str(&format!("\n  and {} more", odd.len() - MOST_NAMED));
    }
    let folder = bundle.folder.display();
    message(&text, &format!("render them: `bulbfold render {folder} --part {}/{parts}`", odd[0].0))
}

/// Refuses files that want what the parts do not have.
fn check_layers(files: &Pictures, job: &Job) -> Outcome {
    let has = layers_of(job.request.layers);
    match files.wanted().iter().find(|layer| !has.has(*layer)) {
        None => Ok(()),
        Some(layer) => {
            let text = format!("the parts have no layer `{}`", layer.name());
            Err(usage(text, "make the job with --picture NAME.exr, or with --layers"))
        }
    }
}

/// A job that is being joined.
struct Join<'a, 'b> {
    session: &'a Session,
    bundle: &'a Bundle,
    /// What made the parts.
    backend: String,
    told: &'a mut Told<'b>,
    /// Parts that are joined.
    done: u32,
}

impl Join<'_, '_> {
    /// Writes a frame of a film, unless it is there; gives its key.
    fn film_frame(
        &mut self,
        index: usize,
        (output, names): (&OutputArgs, &Names),
        target: &Target,
    ) -> Result<String, Failure> {
        let failed = |error| self.session.failed(error);
        let jobs = self.bundle.jobs(self.session, index)?;
        let key = key_of(&jobs, &output.forms()).map_err(failed)?;
        if why_not(target, &key, jobs[0].size()).is_none() {
            return Ok(key);
        }
        let scene = &jobs[0].composed().map_err(failed)?.graph.scene;
        let form = output.form(names.format(), &jobs[0].request, scene, &key);
        let file = PictureFile::new(target, form).map_err(|error| not_written(target, &error))?;
        let mut files = Pictures(vec![file]);
        check_layers(&files, &jobs[0])?;
        self.frame(index, &jobs, &mut files)?;
        self.finish(files, &jobs)?;
        Ok(key)
    }

    /// Gives files the rows of a frame.
    fn frame(&mut self, index: usize, jobs: &[Job], files: &mut Pictures) -> Outcome {
        let manifest = &self.bundle.manifest;
        let (split, of_frame) = (manifest.samples_split, manifest.tiles * manifest.samples_split);
        let joined = match split {
            1 => None,
            _ => Some(JoinedSamples::new(&jobs[0]).map_err(|error| self.session.failed(error))?),
        };
        let layers = layers_of(jobs[0].request.layers);
        let first = index as u32 * of_frame + 1;
        for number in (first..first + of_frame).step_by(split as usize) {
            let open = |number| PartReader::open(self.bundle, number, layers).map_err(|why| self.lost(number, &why));
            let mut parts = (number..number + split).map(open).collect::<Result<Vec<PartReader>, Failure>>()?;
            let place = manifest.place(number);
            match &joined {
                None => self.rows(place, &mut parts[0], files)?,
                Some(joined) => self.sums(place, (parts, joined), files)?,
            }
            self.done += split;
            self.told
                .progress(Stage::Rendering, f64::from(self.done) / f64::from(manifest.parts()).max(1.0) * (1.0 - 1e-9));
        }
        Ok(())
    }

    /// A part that was there when it was looked at.
    fn lost(&self, number: u32, why: &str) -> Failure {
        Failure::Work(message(&format!("part {number}/{} {why}", self.bundle.manifest.parts()), ""))
    }

    /// Hands on the rows of a part.
    fn rows(&self, place: Place, part: &mut PartReader, files: &mut Pictures) -> Outcome {
        while let Some(piece) = part.piece().map_err(|why| self.lost(place.number, &why))? {
            if let Piece::Rows(rows) = piece {
                files.push(&rows).map_err(|error| self.session.failed(Error::Sink(error)))?;
            }
        }
        Ok(())
    }

    /// Hands on the rows of parts of samples, as many at a time as all parts have there.
    fn sums(
        &self,
        place: Place,
        (mut parts, joined): (Vec<PartReader>, &JoinedSamples),
        files: &mut Pictures,
    ) -> Outcome {
        let mut left = self.bundle.manifest.size.width as usize * self.bundle.manifest.rows(place).len();
        let mut read: Vec<Vec<LightSum>> = parts.iter().map(|_| Vec::new()).collect();
        while left > 0 {
            for (k, (part, sums)) in parts.iter_mut().zip(&mut read).enumerate() {
                let lost = |why: &str| self.lost(place.number + k as u32, why);
                while sums.is_empty() {
                    match part.piece().map_err(|why| lost(&why))? {
                        Some(Piece::Sums(more)) => sums.extend(more),
                        Some(_) => {}
                        None => return Err(lost("is broken: it is cut off")),
                    }
                }
            }
            let count = read.iter().map(Vec::len).min().unwrap_or(0).min(left);
            let mut all = vec![LightSum::default(); count];
            for sums in &mut read {
                all.iter_mut().zip(sums.drain(..count)).for_each(|(all, part)| all.join(&part));
            }
            let rows = joined.rows(&all).map_err(|error| self.session.failed(error))?;
            files.push(&rows).map_err(|error| self.session.failed(Error::Sink(error)))?;
            left -= count;
        }
        Ok(())
    }

    /// Gives the files of a picture their names, and its recipe where it is no average.
    fn finish(&self, files: Pictures, jobs: &[Job]) -> Outcome {
        let recipe = |job: &Job| Recipe { backend: self.backend.clone(), job: job.clone() }.text();
        let recipe = if let [job] = jobs { Some(recipe(job)) } else { None };
        files.finish(recipe.as_deref()).map(drop).map_err(|failed| not_written(&failed.0, &failed.1))
    }
}
