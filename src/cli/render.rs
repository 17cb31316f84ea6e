//! `bulbfold render`: a picture of a fractal.

use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;
#[cfg(feature = "chart")]
use std::time::Instant;

use bulbfold::engine::{Done, Error, Job, Recipe, Request};
use bulbfold::files::{FileId, Target};
use bulbfold::film::{Pictures, is_picture};
use bulbfold::graph::Camera;
use bulbfold::render::PathTracing;
use bulbfold::shade::Size;
use clap::parser::ValueSource;
use clap::{ArgMatches, Args};

use super::again::{self, Asked};
use super::camera::flags;
use super::farm::part::{How, PartArg};
use super::kept::Kept;
use super::output::{not_written, opened, refuse_both, spared};
use super::picture_args::PictureArgs;
use super::picture_key::job_key;
use super::pictures::{Wanted, has_layers};
use super::preview::Preview;
use super::progress::short;
use super::session::{asked_files, is_stdin, refuse_plane, talk};
use super::sweep::{self, SweepArgs};
#[cfg(feature = "chart")]
use super::view::{self, ViewArg};
use super::{Failure, Outcome, Session, farm, message, stats, usage};

/// Arguments of `render`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold render mandelbulb
  bulbfold render mandelbox.ron -o box.png --size 1920x1080 --samples 3 --stats
  bulbfold render mandelbox --palette lagoon --material wax -o wax.png
  bulbfold render mandelbulb --palette random --seed 7 -o random.png
  bulbfold render mandelbulb --set power=6 --camera 1.5,-2,1 --fov 30 -o close.png
  bulbfold render mandelbox --zoom 20 --at 0.4,0.6 -o close.png
  bulbfold render menger --lens equirectangular --camera 0.1,0.2,0 --target 1,0,0 -o around.png
  bulbfold render close.png -o large.png --size 4k
  bulbfold render mandelbox menger mandelbulb --scale 0.5 -o pictures/
  bulbfold vary mandelbox --count 6 && bulbfold render mandelbox_vary -o pictures/
  cat flower.ron | bulbfold render - -o - > flower.png
  bulbfold render box_bulb --view error --stats -o box_bulb_error.png
  bulbfold render mandelbulb --set 'plane=(center: (0, 0, 0.2), height: 2.6)' -o slice.png
  bulbfold render bulb_job --part 3/8
  bulbfold render mandelbulb --sweep power=2..12 --sweep turn=0..90 --frames 48 -o bulb_%04d.png")]
pub struct Arguments {
    #[command(flatten)]
    pub(super) picture: PictureArgs,
    /// Show what the march did instead, with a legend below the picture
    #[cfg(feature = "chart")]
    #[arg(long, value_enum, value_name = "VIEW", conflicts_with_all = ["samples", "sampling", "json"])]
    view: Option<ViewArg>,
    #[command(flatten)]
    sweep: SweepArgs,
    /// Keep finished rows beside the picture, in OUT.part, and go on with those of an earlier run that was stopped. Of a sweep: keep
    /// the frames that an earlier run of the same settings has made; all others are named and rendered again
    #[arg(long, conflicts_with = "view")]
    resume: bool,
    /// Render a part of a job that `bulbfold job` has written, such as 3/96, or FRAME,TILE,SAMPLES: a part that is there is kept, and one
    /// that was stopped goes on
    #[arg(long, value_name = "I/N", value_parser = farm::part::parse_part)]
    part: Option<PartArg>,
    /// Say progress as the engines of Open Job Description read it, on stderr
    #[arg(long, requires = "part")]
    openjd: bool,
    /// Show the picture in the terminal, too
    #[arg(long)]
    preview: bool,
    /// Open the picture with the system's viewer
    #[arg(long, conflicts_with = "ranges")]
    open: bool,
    /// More formulas, folders of them, or patterns such as 'a*.ron': each has its own picture, and -o is a folder
    #[arg(value_name = "FILE")]
    more: Vec<PathBuf>,
    /// Names of the arguments that were given.
    #[arg(skip)]
    given: BTreeSet<String>,
}

impl Arguments {
    /// The picture's size: what is given, else that of the picture that is rendered again, or one that suits the lens, or the view.
    fn size_for(&self, own: Option<Camera>, recipe: Option<&Recipe>) -> Result<Size, Failure> {
        #[cfg(feature = "chart")]
        if let Some(view) = self.view {
            return self.picture.scaled(self.picture.size.unwrap_or_else(|| view.default_size()));
        }
        match recipe.filter(|_| self.picture.size.is_none()) {
            Some(recipe) => self.picture.scaled(recipe.job.request.size),
            None => self.picture.size_for(own),
        }
    }

    /// Whether this is a picture of the fractal, and not of what the march did.
    fn is_plain(&self) -> bool {
        #[cfg(feature = "chart")]
        return self.view.is_none();
        #[cfg(not(feature = "chart"))]
        true
    }

    /// Renders a part of a job, of which everything is settled but where it is computed.
    fn part(&self, part: PartArg, session: &mut Session) -> Outcome {
        const OPEN: [&str; 8] = ["file", "part", "openjd", "backend", "threads", "quiet", "trust", "step_folders"];
        // Names of groups begin with capitals.
        let is_settled = |name: &&String| name.starts_with(char::is_lowercase) && !OPEN.contains(&name.as_str());
        if let Some(name) = self.given.iter().find(is_settled) {
            let text = format!("`--{}` is settled in a job", name.replace('_', "-"));
            return Err(usage(text, "give it to `bulbfold job`"));
        }
        self.picture.prepare();
        let backend = self.given.contains("backend").then(|| self.picture.backend.choice());
        let how = How { backend, is_engine: self.openjd };
        farm::part::run(&self.picture.formula.file, part, how, session)
    }

    /// Notes which arguments were given: a picture that is rendered again keeps all else.
    pub(super) fn note_given(&mut self, matches: &ArgMatches) {
        let is_given = |id: &&clap::Id| matches.value_source(id.as_str()) == Some(ValueSource::CommandLine);
        self.given = matches.ids().filter(is_given).map(ToString::to_string).collect();
    }
}

/// Runs the command.
pub fn run(arguments: &mut Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    arguments.picture.take_changes();
    if let Some(part) = arguments.part {
        return arguments.part(part, session);
    }
    let files = asked_files(&arguments.picture.formula.file, &arguments.more)?;
    match &files[..] {
        [file] => {
            arguments.picture.formula.file.clone_from(file);
            render(arguments, session, out)
        }
        _ => render_all(arguments, &files, session, out),
    }
}

/// Renders each formula into a picture of its own. One that fails stops no other.
fn render_all(arguments: &mut Arguments, files: &[PathBuf], session: &mut Session, out: &mut dyn Write) -> Outcome {
    if !arguments.sweep.is_empty() {
        return Err(usage(
            "a sweep has one formula",
            "give its name alone; `bulbfold sheet` shows several formulas side by side",
        ));
    }
    arguments.picture.output.want_folder()?;
    let mut failed: Vec<Failure> = Vec::new();
    for file in files {
        arguments.picture.formula.file.clone_from(file);
        match render(arguments, session, out) {
            Ok(()) => {}
            Err(Failure::ClosedPipe) => return Err(Failure::ClosedPipe),
            Err(failure) => failed.push(failure),
        }
    }
    let is_bad_input = failed.iter().any(|failure| matches!(failure, Failure::Usage(_)));
    let texts: Vec<String> = failed.into_iter().map(|failure| failure.text().trim_end().to_string()).collect();
    let text = format!(
        "{}\n{}",
        texts.join("\n"),
        message(&format!("{} of {} pictures failed", texts.len(), files.len()), "")
    );
    match (texts.is_empty(), is_bad_input) {
        (true, _) => Ok(()),
        (false, true) => Err(Failure::Usage(text)),
        (false, false) => Err(Failure::Work(text)),
    }
}

/// Renders one formula.
fn render(arguments: &Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    if let Some(frames) = arguments.sweep.frames()? {
        if !arguments.is_plain() {
            return Err(usage("a sweep renders pictures, not views of error", "drop `--view` or `--sweep`"));
        }
        return sweep::run(&arguments.picture, &arguments.sweep, (frames, arguments.resume), session, out);
    }
    if !arguments.is_plain() {
        arguments.picture.output.only("`--view`")?;
        arguments.picture.output.refuse_forms("`--view`")?;
    }
    let file = &arguments.picture.formula.file;
    let recipe = if is_picture(file) { Some(again::recipe(session, file)?) } else { None };
    let stem = match &recipe {
        _ if is_stdin(file) => Some("formula".into()),
        Some(recipe) => Path::new(&recipe.job.formula.bundle().name).file_stem().map(ToOwned::to_owned),
        None => file.file_stem().map(ToOwned::to_owned),
    };
    let wanted = arguments.picture.output.wanted(Path::new(&stem.unwrap_or_default()))?;
    if arguments.picture.json {
        wanted.iter().try_for_each(|file| refuse_both(&file.target, "--json"))?;
    }
    arguments.picture.prepare();
    let job = settled(arguments, session, recipe, &wanted)?;
    #[cfg(feature = "chart")]
    if let (Some(ViewArg(view)), Some(Wanted { target, .. })) = (arguments.view, wanted.first()) {
        let start = Instant::now();
        let image = view::render(session, view, &job, arguments.picture.stats)?;
        image.write_png_to(target).map_err(|error| not_written(target, &error))?;
        session.say(&format!("{} ({})", target.path().display(), short(start.elapsed())));
        return Ok(());
    }
    write_picture(arguments, session, &job, &wanted, out)
}

/// The job of a formula, or of a picture that is rendered again.
fn settled(
    arguments: &Arguments,
    session: &mut Session,
    recipe: Option<Recipe>,
    wanted: &[Wanted],
) -> Result<Job, Failure> {
    let file = &arguments.picture.formula.file;
    let mut request = arguments.picture.request();
    // Before anything is read: what contradicts itself is told at once.
    request.first_precision().map_err(|error| session.failed(error))?;
    // A palette that is the user's usual one, and not asked for, is not that of a picture which is rendered again.
    let keeps_palette = recipe.is_some() && !arguments.given.contains("palette");
    let changes = arguments.picture.changes(session)?;
    let changes: Vec<_> = changes.into_iter().filter(|(path, _)| !(keeps_palette && path == "look.palette")).collect();
    let formula = match &recipe {
        Some(recipe) => recipe.job.formula.clone(),
        None => session.open(file, &changes)?,
    };
    request.size = arguments.size_for(formula.graph().scene.camera, recipe.as_ref())?;
    let picture = recipe.as_ref().and_then(|_| FileId::of(file));
    if let Some(path) = recipe.as_ref().and_then(|recipe| recipe.job.request.path)
        && arguments.given.contains("seed")
    {
        request.path =
            request.path.or(Some(PathTracing { seed: arguments.picture.look.seed.unwrap_or(0) as u32, ..path }));
    }
    let traces = match &recipe {
        Some(recipe) => request.path.or(recipe.job.request.path),
        None => request.path,
    };
    let have_layers = has_layers(&formula.graph().scene, &Request { path: traces, ..request.clone() });
    for file in wanted {
        session.spare_inputs(&file.target)?;
        if picture.as_ref().is_some_and(|picture| file.target.is_file(picture)) {
            return Err(spared(&file.target));
        }
        request.layers = request.layers.or(arguments.picture.output.layers(file.format, have_layers)?);
    }
    if !arguments.is_plain() {
        refuse_plane(formula.graph(), "`--view`")?;
    }
    let mut watch = session.watch();
    let is_told = request.camera.is_move() && !session.quiet;
    let job = match recipe {
        Some(recipe) => {
            let layers = request.layers;
            let asked = Asked { request, given: &arguments.given, changes: &changes, layers };
            again::job(session, recipe, asked, &mut watch)?
        }
        None => session.engine.settle(&formula, &request, &mut watch).map_err(|error| session.failed(error))?,
    };
    drop(watch);
    if let Some(camera) = job.camera.filter(|_| is_told) {
        flags(&camera, formula.graph().scene.camera).iter().for_each(|line| talk(line));
    }
    Ok(job)
}

/// Renders a settled picture into its files, and says what was chosen and counted where that is asked for.
fn write_picture(
    arguments: &Arguments,
    session: &Session,
    job: &Job,
    wanted: &[Wanted],
    out: &mut dyn Write,
) -> Outcome {
    let failed = |error| session.failed(error);
    let key = job_key(job).map_err(failed)?;
    let files = arguments.picture.output.open(session, wanted, job, &key)?;
    let names: Vec<String> = files.0.iter().map(|file| file.target().path().display().to_string()).collect();
    let mut files = match arguments.resume {
        true => Kept::resumed(files, (&key, job.size().width))?,
        false => Kept::without(files),
    };
    let done = rendered(arguments, session, job, &mut files);
    let (files, part) = files.split();
    let (done, encode) = finished(session, job, files, done)?;
    Kept::remove(part)?;
    let composed = job.composed().map_err(failed)?;
    let report = stats::Report {
        fractal: &composed.graph.name,
        backend: &done.backend,
        settings: &composed.settings,
        pipeline: &composed.pipeline,
        calibration: job.calibration.as_deref(),
        composing: composed.took,
        stats: &done.stats,
        encode,
        files: &names,
    };
    if arguments.picture.json {
        writeln!(out, "{}", report.json())?;
    }
    if arguments.picture.stats {
        talk(report.table().trim_end());
    }
    session.say(&format!("{} ({})", names.join(", "), short(done.stats.render)));
    if arguments.open {
        let shown = wanted.iter().zip(&names).find(|(file, _)| !file.target.is_stream());
        shown.map_or(Ok(()), |(_, name)| opened(name.as_ref())).unwrap_or_else(|error| session.warn(&error));
    }
    Ok(())
}

/// Renders the rows that are missing into the files, and shows the picture in the terminal where that is asked for.
fn rendered(arguments: &Arguments, session: &Session, job: &Job, files: &mut Kept) -> Result<Done, Error> {
    let mut watch = session.watch();
    let rows = files.first.min(job.size().height)..job.size().height;
    if arguments.preview
        && let Some(mut preview) = Preview::new(files, job.size())
    {
        let done = session.engine.render(job, rows, &mut preview, &mut watch)?;
        preview.show();
        return Ok(done);
    }
    session.engine.render(job, rows, files, &mut watch)
}

/// Gives the files of a render their names, and the time that it took; the files have the cause where they took no more.
fn finished(
    session: &Session,
    job: &Job,
    files: Pictures,
    done: Result<Done, Error>,
) -> Result<(Done, Duration), Failure> {
    let written = |failed: Box<(Target, std::io::Error)>| not_written(&failed.0, &failed.1);
    match done {
        Ok(done) => {
            let recipe = Recipe { backend: kind_of(&done.backend), job: job.clone() }.text();
            let encode = files.finish(Some(&recipe)).map_err(written)?;
            Ok((done, encode))
        }
        Err(Error::Sink(error)) => {
            let cause = files.finish(None).err();
            Err(cause.map_or_else(|| session.failed(Error::Sink(error)), written))
        }
        Err(error) => Err(session.failed(error)),
    }
}

/// What of a back end's description decides its pictures: not whether the CPU interprets kernels or runs them as machine code.
pub(super) fn kind_of(backend: &str) -> String {
    let parts: Vec<&str> = backend.split(", ").collect();
    match parts[..] {
        ["cpu", precision, ..] => format!("cpu, {precision}"),
        _ => backend.to_string(),
    }
}
