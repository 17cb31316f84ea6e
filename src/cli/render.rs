//! `bulbfold render`: a picture of a fractal.

use std::io::Write;
use std::path::{Path, PathBuf};
#[cfg(feature = "chart")]
use std::time::Instant;

use bulbfold::engine::{Done, Error, Job, Request};
use bulbfold::files::Target;
use bulbfold::film::PngFile;
use bulbfold::graph::Camera;
use bulbfold::render::{PathTracing, Sampling};
use bulbfold::shade::Size;
use clap::{Args, ValueEnum};

use super::arguments::{AutoArgs, BackendArg, FormulaArgs, PicturePrecision, parse_size};
use super::camera::{CameraArgs, flags, usual_size};
use super::matter::LookArgs;
use super::output::{Content, check_output, not_written, refuse_both};
use super::preview::Preview;
use super::progress::short;
use super::session::{refuse_plane, talk};
use super::sweep::{self, SweepArgs};
#[cfg(feature = "chart")]
use super::view::{self, ViewArg};
use super::{Failure, Outcome, Session, stats};

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
  bulbfold render box_bulb --view error --stats -o box_bulb_error.png
  bulbfold render mandelbulb --set 'plane=(center: (0, 0, 0.2), height: 2.6)' -o slice.png
  bulbfold render mandelbulb --sweep power=2..12 --sweep turn=0..90 --frames 48 -o bulb_%04d.png")]
pub struct Arguments {
    #[command(flatten)]
    pub(super) formula: FormulaArgs,
    /// The picture to write; - is stdout [default: NAME.png]
    #[arg(short, long, value_name = "OUT.png")]
    pub(super) output: Option<PathBuf>,
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
    /// What is changed in the formula.
    pub(super) fn changes(&self, session: &mut Session) -> Result<Vec<(String, String)>, Failure> {
        let mut changes = self.formula.changes();
        changes.extend(self.look.changes(session, self.path.is_asked())?);
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
    let output = output_path(arguments);
    let output = check_output(&output, Some("png"), Content::Bytes)?;
    if arguments.json {
        refuse_both(&output, "--json")?;
    }
    arguments.prepare();
    let mut request = arguments.request();
    // Before anything is read: what contradicts itself is told at once.
    request.first_precision().map_err(|error| session.failed(error))?;
    let changes = arguments.changes(session)?;
    let formula = session.open(&arguments.formula.file, &changes)?;
    session.spare_inputs(&output)?;
    request.size = arguments.size_for(formula.graph().scene.camera);
    if !arguments.is_plain() {
        refuse_plane(formula.graph(), "`--view`")?;
    }
    let mut watch = session.watch(arguments.quiet);
    let job = session.engine.settle(&formula, &request, &mut watch).map_err(|error| session.failed(error))?;
    drop(watch);
    if let Some(camera) = job.camera.filter(|_| request.camera.is_move() && !arguments.quiet) {
        flags(&camera, formula.graph().scene.camera).iter().for_each(|line| talk(line));
    }
    #[cfg(feature = "chart")]
    if let Some(ViewArg(view)) = arguments.view {
        let start = Instant::now();
        let image = view::render(session, view, &job, (arguments.quiet, arguments.stats))?;
        image.write_png_to(&output).map_err(|error| not_written(&output, &error))?;
        if !arguments.quiet {
            talk(&format!("{} ({})", output.path().display(), short(start.elapsed())));
        }
        return Ok(());
    }
    write_picture(arguments, session, &job, &output, out)
}

/// Renders a settled picture into its file, and says what was chosen and counted where that is asked for.
fn write_picture(arguments: &Arguments, session: &Session, job: &Job, output: &Target, out: &mut dyn Write) -> Outcome {
    let mut file = PngFile::at(output, job.size(), None);
    let done = rendered(arguments, session, job, &mut file);
    let written = match &done {
        // The file has the cause.
        Ok(_) | Err(Error::Sink(_)) => Some(file.finish().map_err(|error| not_written(output, &error))),
        Err(_) => None,
    };
    let encode = written.transpose()?;
    let (done, encode) = (done.map_err(|error| session.failed(error))?, encode.unwrap_or_default());
    let composed = job.composed().map_err(|error| session.failed(error))?;
    let report = stats::Report {
        fractal: &composed.graph.name,
        backend: &done.backend,
        settings: &composed.settings,
        pipeline: &composed.pipeline,
        calibration: job.calibration.as_deref(),
        composing: composed.took,
        stats: &done.stats,
        encode,
    };
    if arguments.json {
        writeln!(out, "{}", report.json())?;
    }
    if arguments.stats {
        talk(report.table().trim_end());
    }
    if !arguments.quiet {
        talk(&format!("{} ({})", output.path().display(), short(done.stats.render)));
    }
    Ok(())
}

/// Renders a job into its file, and shows it in the terminal where that is asked for.
fn rendered(arguments: &Arguments, session: &Session, job: &Job, file: &mut PngFile) -> Result<Done, Error> {
    let mut watch = session.watch(arguments.quiet);
    if arguments.preview
        && let Some(mut preview) = Preview::new(file, job.size())
    {
        let done = session.engine.render(job, job.rows(), &mut preview, &mut watch)?;
        preview.show();
        return Ok(done);
    }
    session.engine.render(job, job.rows(), file, &mut watch)
}

/// The picture's path: what was given, else the formula's name in the current folder.
fn output_path(arguments: &Arguments) -> PathBuf {
    arguments.output.clone().unwrap_or_else(|| {
        let stem = Path::new(&arguments.formula.file).file_stem().unwrap_or_default();
        let mut name = stem.to_os_string();
        name.push(".png");
        PathBuf::from(name)
    })
}
