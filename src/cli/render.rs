//! `bulbfold render`: a picture of a fractal.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::time::{Duration, Instant};

use bulbfold::calibrate::Calibration;
use bulbfold::check::Subject;
use bulbfold::compose::{Composer, Plan};
use bulbfold::expr::Arena;
#[cfg(feature = "chart")]
use bulbfold::film::Image;
use bulbfold::graph::{Camera, ValidGraph};
use bulbfold::precision::{LEAST_ULPS, Resolution, resolution};
use bulbfold::render::{Pipeline, RenderSettings, Sampling, compose_planned};
use bulbfold::shade::{self, Size};
use clap::{Args, ValueEnum};

use super::arguments::{
    AutoArgs, BackendArg, FormulaArgs, PicturePrecision, PrecisionArg, parse_fov, parse_size, parse_vector,
};
use super::backend::{Wanted, run_job};
use super::calibration::{Wish, settle_estimate};
use super::jobs::FileJob;
#[cfg(feature = "chart")]
use super::jobs::PictureJob;
use super::output::{Content, check_output, not_written, refuse_both};
use super::progress::short;
use super::seen::{self, framed};
use super::session::{refuse_plane, talk};
use super::sweep::{self, SweepArgs};
#[cfg(feature = "chart")]
use super::view::{self, Request, ViewArg};
use super::{Failure, Outcome, Session, stats, usage};

/// Arguments of `render`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold render mandelbulb
  bulbfold render mandelbox.ron -o box.png --size 1920x1080 --samples 3 --stats
  bulbfold render mandelbulb --set power=6 --camera 1.5,-2,1 --fov 30 -o close.png
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
    /// Which pixels get all of them: those that differ from their neighbours, or every one
    #[arg(long, value_enum, default_value_t = SamplingArg::Adaptive)]
    sampling: SamplingArg,
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
    sweep: SweepArgs,
    /// March every ray by itself, by steps no longer than an estimate, and every orbit to its end: what the short cuts (beams,
    /// boxes, longer steps, early ends of orbits) are compared with
    #[arg(long)]
    exact_rays: bool,
    /// Print what was chosen and counted, to stderr
    #[arg(long)]
    pub(super) stats: bool,
    /// Print what was chosen and counted, to stdout as one JSON object
    #[arg(long)]
    pub(super) json: bool,
    /// Threads of the CPU back end [default: all cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    threads: Option<u32>,
    /// No progress and no word on success
    #[arg(short, long)]
    pub(super) quiet: bool,
}

/// [`Sampling`] as a flag's value.
#[derive(ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
enum SamplingArg {
    /// Only pixels that differ from their neighbours; hard to tell from `full`
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
    /// What asks for a picture of a formula's own view, with everything else by default and without a word.
    #[cfg(feature = "chart")]
    pub(super) fn of_picture(
        file: &Path,
        size: Size,
        samples: u32,
        backend: BackendArg,
        estimate: AutoArgs,
    ) -> Arguments {
        Arguments {
            formula: FormulaArgs::unchanged(file),
            output: None,
            size: Some(size),
            view: None,
            samples,
            sampling: SamplingArg::Adaptive,
            backend,
            precision: PicturePrecision::Auto,
            estimate,
            camera: CameraArgs::default(),
            sweep: SweepArgs::default(),
            exact_rays: false,
            stats: false,
            json: false,
            threads: None,
            quiet: true,
        }
    }

    fn default_size(&self) -> Size {
        #[cfg(feature = "chart")]
        if let Some(view) = self.view {
            return view.default_size();
        }
        DEFAULT_SIZE
    }

    /// Whether this is a picture of the fractal, and not of what the march did.
    pub(super) fn is_plain(&self) -> bool {
        #[cfg(feature = "chart")]
        return self.view.is_none();
        #[cfg(not(feature = "chart"))]
        true
    }

    /// Starts the threads that were asked for, and gives the precision.
    pub(super) fn prepare(&self) -> Result<PrecisionArg, Failure> {
        if let Some(threads) = self.threads {
            // Fails only when threads are running already, and then the number stays what it was.
            let _ = rayon::ThreadPoolBuilder::new().num_threads(threads as usize).build_global();
        }
        Wanted { backend: self.backend, precision: self.precision.given() }.precision(PrecisionArg::F32)
    }

    /// What a calibration for one picture is to know.
    pub(super) fn wish(&self, graph: &ValidGraph, settings: &RenderSettings, precision: PrecisionArg) -> Wish<'_> {
        Wish {
            estimate: &self.estimate,
            size: settings.size,
            camera: graph.camera,
            precision,
            may_double: precision == PrecisionArg::F32
                && self.precision == PicturePrecision::Auto
                && self.backend != BackendArg::Gpu,
            effort: 1.0,
            quiet: self.quiet,
        }
    }

    /// What is asked of the picture, before anything is chosen.
    pub(super) fn settings(&self, precision: PrecisionArg) -> RenderSettings {
        RenderSettings {
            size: self.size.unwrap_or_else(|| self.default_size()),
            samples: self.samples,
            sampling: self.sampling.sampling(),
            min_difference: precision.min_difference(),
            estimate: self.estimate.estimate.settings(),
            plain: self.exact_rays,
            ..RenderSettings::default()
        }
    }
}

/// What replaces parts of the file's camera.
#[derive(Args, Clone, Copy, Default, Debug)]
pub(super) struct CameraArgs {
    /// Position of the camera, in world units
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse_vector)]
    pub(super) camera: Option<[f64; 3]>,
    /// The point in the middle of the picture
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse_vector)]
    pub(super) target: Option<[f64; 3]>,
    /// Roughly upwards
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse_vector)]
    pub(super) up: Option<[f64; 3]>,
    /// Angle from the bottom to the top of the picture, in degrees
    #[arg(long, value_name = "DEG", value_parser = parse_fov)]
    pub(super) fov: Option<f64>,
    /// Angle of a turn around the target about the up direction, in radians: of sweeps.
    #[arg(skip)]
    pub(super) turn: Option<f64>,
}

impl CameraArgs {
    pub(super) fn is_empty(&self) -> bool {
        self.camera.is_none() && self.target.is_none() && self.up.is_none() && self.fov.is_none() && self.turn.is_none()
    }

    /// Takes a change of a file's camera, which then need not have one. An option of the same meaning wins.
    fn takes(&mut self, path: &str, value: &str) -> bool {
        let inner = value.strip_prefix('(').and_then(|text| text.strip_suffix(')')).unwrap_or(value);
        let vector = |known: &mut Option<[f64; 3]>| parse_vector(inner).map(|new| *known = known.or(Some(new))).is_ok();
        match path {
            "camera.position" => vector(&mut self.camera),
            "camera.target" => vector(&mut self.target),
            "camera.up" => vector(&mut self.up),
            "camera.fov" => parse_fov(value).map(|new| self.fov = self.fov.or(Some(new))).is_ok(),
            _ => false,
        }
    }

    /// `base` with what was given in its place.
    fn apply(&self, base: Camera) -> Result<Camera, Failure> {
        let mut camera = Camera {
            position: self.camera.unwrap_or(base.position),
            target: self.target.unwrap_or(base.target),
            up: self.up.unwrap_or(base.up),
            fov: self.fov.map_or(base.fov, f64::to_radians),
        };
        if let Some(angle) = self.turn {
            camera = shade::turned(&camera, angle);
        }
        let frame = shade::CameraFrame::new(&camera);
        if [frame.right, frame.up, frame.forward].iter().flatten().all(|x| x.is_finite()) {
            return Ok(camera);
        }
        let help = "move --camera away from --target, or choose another --up";
        Err(usage("the camera's position, target and up direction lie on one line", help))
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
    let asked = arguments.prepare()?;
    let graph = session.load(&arguments.formula.file, &arguments.formula.changes())?.graph;
    session.spare_inputs(&output)?;
    if !arguments.is_plain() {
        refuse_plane(&graph, "`--view`")?;
    }
    let arena = Rc::new(Arena::default());
    let Fitted { graph, settings, pipeline, precision, calibration, composing } =
        fit(session, arguments, asked, &arena, graph)?;
    #[cfg(feature = "chart")]
    if let Some(ViewArg(view)) = arguments.view {
        let request = Request {
            view,
            composer: Composer { arena: &arena, library: &session.library, graph: &graph },
            pipeline: &pipeline,
            settings: &settings,
            backend: arguments.backend,
            precision,
            quiet: arguments.quiet,
            stats: arguments.stats,
        };
        let start = Instant::now();
        let image = view::render(session, &request)?;
        image.write_png_to(&output).map_err(|error| not_written(&output, &error))?;
        if !arguments.quiet {
            talk(&format!("{} ({})", output.path().display(), short(start.elapsed())));
        }
        return Ok(());
    }
    let mut job = FileJob::new(&arena, (&pipeline, &settings), &output, arguments.quiet);
    let (backend, (stats, written)) = run_job(session, arguments.backend, precision, &mut job)?;
    let encode = written.map_err(|error| not_written(&output, &error))?;
    let report = stats::Report {
        fractal: &graph.name,
        backend: &backend,
        settings: &settings,
        pipeline: &pipeline,
        calibration: &calibration,
        composing,
        stats: &stats,
        encode,
    };
    if arguments.json {
        writeln!(out, "{}", report.json())?;
    }
    if arguments.stats {
        talk(report.table().trim_end());
    }
    if !arguments.quiet {
        talk(&format!("{} ({})", output.path().display(), short(stats.render)));
    }
    Ok(())
}

/// A picture's kernels, with the estimate and the precision that its view needs.
struct Fitted {
    graph: ValidGraph,
    settings: RenderSettings,
    pipeline: Pipeline,
    precision: PrecisionArg,
    calibration: Calibration,
    /// Time to compose the kernels.
    composing: Duration,
}

/// Settles the view, then the precision that it needs (by rays of a march by rules), then the estimate.
fn fit(
    session: &Session,
    arguments: &Arguments,
    asked: PrecisionArg,
    arena: &Rc<Arena>,
    graph: ValidGraph,
) -> Result<Fitted, Failure> {
    let failed = |diagnostic| session.failure(diagnostic);
    let mut settings = arguments.settings(asked);
    let (mut graph, mut plan) = with_view(session, arena, graph, &settings, &arguments.camera)?;
    let wanted =
        seen::Wanted { size: settings.size, estimate: &settings.estimate, is_own: arguments.camera.is_empty() };
    if let Some(found) = seen::iterations(session, arena, &graph, wanted)? {
        (graph, plan) = (found.apply(&graph), None);
    }
    let composer = Composer { arena, library: &session.library, graph: &graph };
    let plan = plan.map_or_else(|| seen::plan_of(session, arena, &graph, &settings.estimate), Ok)?;
    let by_rules = compose_planned(&composer, &settings, plan.clone()).map_err(failed)?;
    let resolution = resolution(arena, &by_rules, settings.size);
    let mut precision = settle_precision(session, arguments, asked, &resolution);
    settings.min_difference = precision.min_difference();
    settings.boxed = true;
    let subject = || Subject { library: &session.library, graph: &graph, arena, plan: plan.clone() };
    let wish = arguments.wish(&graph, &settings, precision);
    let mut calibration = settle_estimate(session, subject(), &wish)?;
    if calibration.wants_double && wish.may_double {
        if !arguments.quiet {
            talk("single precision is too coarse for this formula's orbits; the CPU takes it in f64");
        }
        precision = PrecisionArg::F64;
        settings.min_difference = precision.min_difference();
        calibration = settle_estimate(session, subject(), &arguments.wish(&graph, &settings, precision))?;
    }
    let start = Instant::now();
    let pipeline = compose_planned(&composer, &settings, calibration.plan.clone()).map_err(failed)?;
    Ok(Fitted { composing: start.elapsed(), graph, settings, pipeline, precision, calibration })
}

/// The precision of the picture, with a word where the view is too close for one.
pub(super) fn settle_precision(
    session: &Session,
    arguments: &Arguments,
    asked: PrecisionArg,
    resolution: &Resolution,
) -> PrecisionArg {
    let fits = |precision: PrecisionArg| resolution.fits(precision.cpu());
    let grain = |precision: PrecisionArg| {
        let ulps = resolution.ulps(precision.cpu());
        let shown = if ulps < 0.01 { format!("{ulps:.1e}") } else { format!("{ulps:.2}") };
        format!("a pixel spans {shown} units of the last place of {} and should span {LEAST_ULPS}", precision.name())
    };
    if asked == PrecisionArg::F32 && !fits(asked) {
        let (is_auto, is_gpu) = (arguments.precision == PicturePrecision::Auto, arguments.backend == BackendArg::Gpu);
        let text = format!("this view is too close for f32: {}", grain(asked));
        match (is_auto, is_gpu) {
            (true, false) if !arguments.quiet => talk(&format!("{text}; the CPU takes it in f64")),
            (true, false) => {}
            (_, true) => session.warn(&format!("{text}; `--backend auto` takes the CPU, which has f64")),
            (false, false) => session.warn(&format!("{text}; `--precision auto` takes f64")),
        }
        if is_auto && !is_gpu {
            return settle_precision(session, arguments, PrecisionArg::F64, resolution);
        }
    }
    if asked == PrecisionArg::F64 && !fits(asked) {
        let times = (1.0 / resolution.room(asked.cpu())).max(1.0);
        session.warn(&format!(
            "this view is too close for f64: {}; the picture will show steps of rounding. Go {times:.1} times farther away",
            grain(asked)
        ));
    }
    asked
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

/// The graph with the camera that was asked for, and the plan where one was made that still holds.
pub(super) fn with_view(
    session: &Session,
    arena: &Rc<Arena>,
    graph: ValidGraph,
    settings: &RenderSettings,
    view: &CameraArgs,
) -> Result<(ValidGraph, Option<Plan>), Failure> {
    if graph.plane.is_some() && !view.is_empty() {
        let text = format!("a picture of `{}` shows a plane, which has no camera", graph.name);
        return Err(usage(text, "place the plane: --set 'plane=(center: (-0.5, 0.0), height: 2.5)'"));
    }
    let (graph, plan) = framed(session, arena, graph, &settings.estimate)?;
    match graph.camera.filter(|_| !view.is_empty()) {
        None => Ok((graph, plan)),
        // What the file's estimate was calibrated on is not seen any more.
        Some(base) => Ok((graph.with_camera(view.apply(base)?).without_calibration(), None)),
    }
}

/// A picture in memory of a formula that has been loaded.
#[cfg(feature = "chart")]
pub(super) fn picture(
    session: &Session,
    arguments: &Arguments,
    graph: ValidGraph,
    progress: &mut (dyn FnMut(f64) + Send),
) -> Result<Image, Failure> {
    let asked = arguments.prepare()?;
    let arena = Rc::new(Arena::default());
    let Fitted { settings, pipeline, precision, .. } = fit(session, arguments, asked, &arena, graph)?;
    let mut job = PictureJob { arena: &arena, pipeline: &pipeline, settings: &settings, progress };
    let (_, image) = run_job(session, arguments.backend, precision, &mut job)?;
    Ok(image)
}
