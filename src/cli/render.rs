//! `bulbfold render`: a picture of a fractal.

use std::collections::BTreeSet;
use std::io::Write;
use std::path::Path;
use std::time::Duration;
#[cfg(feature = "chart")]
use std::time::Instant;

use bulbfold::engine::{Done, Error, Job, Recipe, Request};
use bulbfold::files::{FileId, Target};
use bulbfold::film::{Pictures, is_picture};
use bulbfold::graph::Camera;
use bulbfold::render::{PathTracing, Sampling};
use bulbfold::shade::Size;
use clap::parser::ValueSource;
use clap::{ArgMatches, Args, ValueEnum};

use super::again::{self, Asked};
use super::arguments::{AutoArgs, BackendArg, FilmArgs, FormulaArgs, PicturePrecision, parse_size};
use super::camera::{CameraArgs, flags, usual_size};
use super::kept::Kept;
use super::matter::LookArgs;
use super::output::{not_written, refuse_both, spared};
use super::picture_key::job_key;
use super::pictures::{OutputArgs, Wanted, has_layers};
use super::preview::Preview;
use super::progress::short;
use super::session::{refuse_plane, talk};
use super::sweep::{self, SweepArgs};
#[cfg(feature = "chart")]
use super::view::{self, ViewArg};
use super::{Failure, Outcome, Session, stats, usage};

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
  bulbfold render close.png -o large.png --size 3840x2160
  bulbfold render box_bulb --view error --stats -o box_bulb_error.png
  bulbfold render mandelbulb --set 'plane=(center: (0, 0, 0.2), height: 2.6)' -o slice.png
  bulbfold render mandelbulb --sweep power=2..12 --sweep turn=0..90 --frames 48 -o bulb_%04d.png")]
pub struct Arguments {
    #[command(flatten)]
    pub(super) formula: FormulaArgs,
    /// Names of the arguments that were given.
    #[arg(skip)]
    given: BTreeSet<String>,
    #[command(flatten)]
    pub(super) output: OutputArgs,
    /// Columns and rows [default: 1280x720]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub(super) size: Option<Size>,
    /// Show what the march did instead, with a legend below the picture
    #[cfg(feature = "chart")]
    #[arg(long, value_enum, value_name = "VIEW", conflicts_with_all = ["samples", "sampling", "json"])]
    view: Option<ViewArg>,
    /// Samples along each edge of a pixel: 1 is fastest, 2 takes 4 a pixel, 3 takes 9
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=16))]
    pub(super) samples: u32,
    /// Which pixels get all samples: those that differ from their neighbours, or every pixel
    #[arg(long, value_enum, default_value_t = SamplingArg::Adaptive)]
    sampling: SamplingArg,
    #[command(flatten)]
    path: PathArgs,
    /// Where to compute
    #[arg(long, value_enum, default_value_t = BackendArg::Auto)]
    pub(super) backend: BackendArg,
    /// Precision; f64 is slower and runs on the CPU
    #[arg(long, value_enum, default_value_t = PicturePrecision::Auto)]
    pub(super) precision: PicturePrecision,
    #[command(flatten)]
    pub(super) estimate: AutoArgs,
    #[command(flatten)]
    pub(super) camera: CameraArgs,
    #[command(flatten)]
    pub(super) look: LookArgs,
    #[command(flatten)]
    film: FilmArgs,
    #[command(flatten)]
    sweep: SweepArgs,
    /// March every ray by itself, by steps no longer than an estimate, and every orbit to its end: what the short cuts (beams,
    /// boxes, longer steps, early ends of orbits) are compared with
    #[arg(long)]
    exact_rays: bool,
    /// Print choices and counts to stderr
    #[arg(long)]
    pub(super) stats: bool,
    /// Print choices and counts to stdout, as one JSON object
    #[arg(long)]
    pub(super) json: bool,
    /// Threads of the CPU back end [default: all cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    threads: Option<u32>,
    /// Show the picture in the terminal, too
    #[arg(long)]
    preview: bool,
    /// Print no progress and no message on success
    #[arg(short, long)]
    pub(super) quiet: bool,
}

/// [`Sampling`] as a flag's value.
#[derive(ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
enum SamplingArg {
    /// Only pixels that differ from their neighbours; looks almost like `full`
    Adaptive,
    /// Every pixel
    Full,
}

impl SamplingArg {
    fn sampling(self) -> Sampling {
        match self {
            SamplingArg::Adaptive => Sampling::Adaptive,
            SamplingArg::Full => Sampling::Full,
        }
    }
}

/// Size of a picture where none is given.
pub(super) const DEFAULT_SIZE: Size = Size { width: 1280, height: 720 };

impl Arguments {
    fn default_size(&self) -> Size {
        #[cfg(feature = "chart")]
        if let Some(view) = self.view {
            return view.default_size();
        }
        DEFAULT_SIZE
    }

    /// The picture's size: what is given, else one that suits the lens.
    fn size_for(&self, own: Option<Camera>) -> Size {
        let usual = || if self.is_plain() { usual_size(&self.camera.change(), own) } else { self.default_size() };
        self.size.unwrap_or_else(usual)
    }

    /// Whether this is a picture of the fractal, and not of what the march did.
    pub(super) fn is_plain(&self) -> bool {
        #[cfg(feature = "chart")]
        return self.view.is_none();
        #[cfg(not(feature = "chart"))]
        true
    }

    /// Notes which arguments were given: a picture that is rendered again keeps all else.
    pub(super) fn note_given(&mut self, matches: &ArgMatches) {
        let is_given = |id: &&clap::Id| matches.value_source(id.as_str()) == Some(ValueSource::CommandLine);
        self.given = matches.ids().filter(is_given).map(ToString::to_string).collect();
    }

    /// Refuses to begin with a picture.
    pub(super) fn refuse_picture(&self) -> Outcome {
        match is_picture(&self.formula.file) {
            false => Ok(()),
            true => Err(usage(
                "a sweep begins with a formula and not with a picture",
                "take the formula out of the picture: `bulbfold new NAME --from PICTURE`",
            )),
        }
    }

    /// Starts the threads that were asked for.
    pub(super) fn prepare(&self) {
        if let Some(threads) = self.threads {
            // Fails only when threads are running already, and then the number stays what it was.
            let _ = rayon::ThreadPoolBuilder::new().num_threads(threads as usize).build_global();
        }
    }

    /// The picture that is asked for.
    pub(super) fn request(&self) -> Request {
        Request {
            samples: self.samples,
            sampling: self.sampling.sampling(),
            camera: self.camera.change(),
            backend: self.backend.choice(),
            precision: self.precision.given(),
            exact_rays: self.exact_rays,
            path: self.path.tracing(self.look.seed.unwrap_or(0)),
            ..self.estimate.request(self.size.unwrap_or_else(|| self.default_size()))
        }
    }
}

/// How light is followed.
#[derive(Args, Clone, Copy, Debug)]
pub(super) struct PathArgs {
    /// Where light comes from: straight from lights and surroundings (fast, without noise), or along paths from surface to surface
    #[arg(long, value_enum, default_value_t = IntegratorArg::Direct)]
    integrator: IntegratorArg,
    /// Paths through each pixel at most; asks for `--integrator path`
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=65536))]
    paths: Option<u32>,
    /// Surfaces that a path meets at most; asks for `--integrator path`
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=24))]
    bounces: Option<u32>,
    /// Noise at which a tile of the picture is done, such as 2%; asks for `--integrator path`
    #[arg(long, value_name = "SHARE", value_parser = parse_share)]
    noise: Option<f64>,
}

/// Where light comes from, as a flag's value.
#[derive(ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
enum IntegratorArg {
    /// Straight from lights and surroundings
    Direct,
    /// Along paths from surface to surface
    Path,
}

/// Paths through a pixel at most where noise says when it is done.
const MOST_PATHS: u32 = 4096;

impl PathArgs {
    /// Whether paths are asked for.
    fn is_asked(&self) -> bool {
        let is_meant = self.paths.is_some() || self.bounces.is_some() || self.noise.is_some();
        self.integrator == IntegratorArg::Path || is_meant
    }

    fn tracing(&self, seed: u64) -> Option<PathTracing> {
        if !self.is_asked() {
            return None;
        }
        let default = PathTracing::default();
        let most = if self.noise.is_some() { MOST_PATHS } else { default.samples };
        Some(PathTracing {
            samples: self.paths.unwrap_or(most),
            bounces: self.bounces.unwrap_or(default.bounces),
            noise: self.noise.unwrap_or(0.0),
            seed: seed as u32,
        })
    }
}

/// A share as `2%` or `0.02`, above 0 and at most 1.
fn parse_share(text: &str) -> Result<f64, String> {
    let (number, scale) = text.strip_suffix('%').map_or((text, 1.0), |number| (number, 0.01));
    let share = number.trim().parse::<f64>().map_err(|_| "expected a share such as 2% or 0.02".to_string())? * scale;
    match share > 0.0 && share <= 1.0 {
        true => Ok(share),
        false => Err("a share is above 0 and at most 1 (100%)".into()),
    }
}

impl Arguments {
    /// What is changed in the formula; an option of the same meaning wins over `--set`.
    pub(super) fn changes(&self, session: &mut Session) -> Result<Vec<(String, String)>, Failure> {
        let mut changes = self.formula.changes();
        changes.extend(self.look.changes(session, self.path.is_asked())?);
        changes.extend(self.film.changes());
        Ok(changes)
    }
}

/// Runs the command.
pub fn run(arguments: &mut Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    let camera = &mut arguments.camera;
    arguments.formula.take_changes(|path, value| camera.takes(path, value));
    let arguments = &*arguments;
    if let Some(frames) = arguments.sweep.frames()? {
        return sweep::run(arguments, &arguments.sweep, frames, session, out);
    }
    if !arguments.is_plain() {
        arguments.output.only("`--view`")?;
        arguments.output.refuse_forms("`--view`")?;
    }
    let file = &arguments.formula.file;
    let recipe = if is_picture(file) { Some(again::recipe(session, file)?) } else { None };
    let stem = match &recipe {
        Some(recipe) => Path::new(&recipe.job.formula.bundle().name).file_stem().map(ToOwned::to_owned),
        None => file.file_stem().map(ToOwned::to_owned),
    };
    let wanted = arguments.output.wanted(Path::new(&stem.unwrap_or_default()))?;
    if arguments.json {
        wanted.iter().try_for_each(|file| refuse_both(&file.target, "--json"))?;
    }
    arguments.prepare();
    let job = settled(arguments, session, recipe, &wanted)?;
    #[cfg(feature = "chart")]
    if let (Some(ViewArg(view)), Some(Wanted { target, .. })) = (arguments.view, wanted.first()) {
        let start = Instant::now();
        let image = view::render(session, view, &job, (arguments.quiet, arguments.stats))?;
        image.write_png_to(target).map_err(|error| not_written(target, &error))?;
        if !arguments.quiet {
            talk(&format!("{} ({})", target.path().display(), short(start.elapsed())));
        }
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
    let file = &arguments.formula.file;
    let mut request = arguments.request();
    // Before anything is read: what contradicts itself is told at once.
    request.first_precision().map_err(|error| session.failed(error))?;
    let changes = arguments.changes(session)?;
    let formula = match &recipe {
        Some(recipe) => recipe.job.formula.clone(),
        None => session.open(file, &changes)?,
    };
    request.size = arguments.size_for(formula.graph().scene.camera);
    let picture = recipe.as_ref().and_then(|_| FileId::of(file));
    if let Some(path) = recipe.as_ref().and_then(|recipe| recipe.job.request.path)
        && arguments.given.contains("seed")
    {
        request.path = request.path.or(Some(PathTracing { seed: arguments.look.seed.unwrap_or(0) as u32, ..path }));
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
        request.layers = request.layers.or(arguments.output.layers(file.format, have_layers)?);
    }
    if !arguments.is_plain() {
        refuse_plane(formula.graph(), "`--view`")?;
    }
    let mut watch = session.watch(arguments.quiet);
    let is_told = request.camera.is_move() && !arguments.quiet;
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
    let files = arguments.output.open(session, wanted, job, &key)?;
    let names: Vec<String> = files.0.iter().map(|file| file.target().path().display().to_string()).collect();
    let mut files = match arguments.sweep.resume {
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
    if arguments.json {
        writeln!(out, "{}", report.json())?;
    }
    if arguments.stats {
        talk(report.table().trim_end());
    }
    if !arguments.quiet {
        talk(&format!("{} ({})", names.join(", "), short(done.stats.render)));
    }
    Ok(())
}

/// Renders the rows that are missing into the files, and shows the picture in the terminal where that is asked for.
fn rendered(arguments: &Arguments, session: &Session, job: &Job, files: &mut Kept) -> Result<Done, Error> {
    let mut watch = session.watch(arguments.quiet);
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
fn kind_of(backend: &str) -> String {
    let parts: Vec<&str> = backend.split(", ").collect();
    match parts[..] {
        ["cpu", precision, ..] => format!("cpu, {precision}"),
        _ => backend.to_string(),
    }
}
