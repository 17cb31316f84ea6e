//! `bulbfold render`: a picture of a fractal.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use bulbfold::calibrate::Calibration;
use bulbfold::compose::{Composer, choose};
use bulbfold::expr::Arena;
use bulbfold::film::Image;
use bulbfold::graph::{Camera, ValidGraph};
use bulbfold::kernel::{Backend, BackendError};
use bulbfold::render::{Pipeline, RenderSettings, Renderer, Stats, compose_planned};
use bulbfold::shade::{self, Size, frame_automatically};
use clap::Args;

use super::arguments::{AutoArgs, BackendArg, FormulaArgs, PrecisionArg, parse_fov, parse_size, parse_vector};
use super::backend::{Job, Wanted, run_job};
use super::calibration::{Wish, choose_estimate};
use super::progress::{Progress, short};
use super::session::{check_output, talk};
use super::{Failure, Outcome, Session, message, stats, usage};

/// Arguments of `render`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold render mandelbulb
  bulbfold render mandelbox.ron -o box.png --size 1920x1080 --samples 3 --stats
  bulbfold render mandelbulb --set power=6 --camera 1.5,-2,1 --fov 30 -o close.png")]
pub struct Arguments {
    #[command(flatten)]
    formula: FormulaArgs,
    /// The picture to write [default: NAME.png]
    #[arg(short, long, value_name = "OUT.png")]
    output: Option<PathBuf>,
    /// Columns and rows
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = parse_size)]
    size: Size,
    /// Samples along each edge of a pixel: 1 is fastest, 2 takes 4 a pixel, 3 takes 9
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=16))]
    samples: u32,
    /// Where to compute
    #[arg(long, value_enum, default_value_t = BackendArg::Auto)]
    backend: BackendArg,
    /// Precision; f64 is slower and runs on the CPU [default: f32]
    #[arg(long, value_enum)]
    precision: Option<PrecisionArg>,
    #[command(flatten)]
    estimate: AutoArgs,
    #[command(flatten)]
    view: ViewArgs,
    /// Print what was chosen and counted, to stderr
    #[arg(long)]
    stats: bool,
    /// Print what was chosen and counted, to stdout as one JSON object
    #[arg(long)]
    json: bool,
    /// Threads of the CPU back end [default: all cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    threads: Option<u32>,
    /// No progress and no word on success
    #[arg(short, long)]
    quiet: bool,
}

/// What replaces parts of the file's camera.
#[derive(Args, Clone, Copy, Debug)]
struct ViewArgs {
    /// Position of the camera, in world units
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse_vector)]
    camera: Option<[f64; 3]>,
    /// The point in the middle of the picture
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse_vector)]
    target: Option<[f64; 3]>,
    /// Roughly upwards
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse_vector)]
    up: Option<[f64; 3]>,
    /// Angle from the bottom to the top of the picture, in degrees
    #[arg(long, value_name = "DEG", value_parser = parse_fov)]
    fov: Option<f64>,
}

impl ViewArgs {
    fn is_empty(&self) -> bool {
        self.camera.is_none() && self.target.is_none() && self.up.is_none() && self.fov.is_none()
    }

    /// `base` with what was given in its place.
    fn apply(&self, base: Camera) -> Result<Camera, Failure> {
        let camera = Camera {
            position: self.camera.unwrap_or(base.position),
            target: self.target.unwrap_or(base.target),
            up: self.up.unwrap_or(base.up),
            fov: self.fov.map_or(base.fov, f64::to_radians),
        };
        let frame = shade::CameraFrame::new(&camera);
        if [frame.right, frame.up, frame.forward].iter().flatten().all(|x| x.is_finite()) {
            return Ok(camera);
        }
        let help = "move --camera away from --target, or choose another --up";
        Err(usage("the camera's position, target and up direction lie on one line", help))
    }
}

/// Runs the command.
pub fn run(arguments: &Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    let output = output_path(arguments);
    check_output(&output, Some("png"))?;
    let wanted = Wanted { backend: arguments.backend, precision: arguments.precision };
    let precision = wanted.precision(PrecisionArg::F32)?;
    if let Some(threads) = arguments.threads {
        // Fails only when threads are running already, and then the number stays what it was.
        let _ = rayon::ThreadPoolBuilder::new().num_threads(threads as usize).build_global();
    }
    let graph = session.load(&arguments.formula.file, &arguments.formula.set)?.graph;
    let settings = RenderSettings {
        size: arguments.size,
        samples: arguments.samples,
        min_difference: precision.min_difference(),
        estimate: arguments.estimate.estimate.settings(),
        ..RenderSettings::default()
    };
    let arena = Rc::new(Arena::default());
    let (pipeline, calibration) = compose(session, &arena, graph.clone(), &settings, arguments, precision)?;
    let mut job = RenderJob { arena: &arena, pipeline: &pipeline, settings: &settings, quiet: arguments.quiet };
    let (backend, (image, stats)) = run_job(session, arguments.backend, precision, &mut job)?;
    image
        .write_png(&output)
        .map_err(|error| Failure::Work(message(&format!("cannot write {}: {error}", output.display()), "")))?;
    let report = stats::Report {
        fractal: &graph.name,
        backend: &backend,
        settings: &settings,
        pipeline: &pipeline,
        calibration: &calibration,
        stats: &stats,
    };
    if arguments.json {
        writeln!(out, "{}", report.json())?;
    }
    if arguments.stats {
        talk(report.table().trim_end());
    }
    if !arguments.quiet {
        talk(&format!("{} ({})", output.display(), short(stats.render)));
    }
    Ok(())
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

/// Chooses the estimate for the view, and composes the picture's kernels with it.
fn compose(
    session: &Session,
    arena: &Rc<Arena>,
    graph: ValidGraph,
    settings: &RenderSettings,
    arguments: &Arguments,
    precision: PrecisionArg,
) -> Result<(Pipeline, Calibration), Failure> {
    let failed = |diagnostic| session.failure(diagnostic);
    let graph = match (arguments.view.is_empty(), graph.camera) {
        (true, _) => graph,
        (false, Some(camera)) => graph.with_camera(arguments.view.apply(camera)?),
        (false, None) => {
            let plan = choose(&Composer { arena, library: &session.library, graph: &graph }, &settings.estimate);
            let base = frame_automatically(plan.map_err(failed)?.bounding_radius);
            graph.with_camera(arguments.view.apply(base)?)
        }
    };
    let wish = Wish {
        estimate: &arguments.estimate,
        size: settings.size,
        camera: graph.camera,
        precision,
        primary_rays: u64::from(settings.size.width)
            * u64::from(settings.size.height)
            * u64::from(settings.samples).pow(2),
        quiet: arguments.quiet,
    };
    let calibration = choose_estimate(session, &graph, arena, &wish)?;
    let composer = Composer { arena, library: &session.library, graph: &graph };
    let pipeline = compose_planned(&composer, settings, calibration.plan.clone()).map_err(failed)?;
    Ok((pipeline, calibration))
}

struct RenderJob<'a> {
    arena: &'a Arena,
    pipeline: &'a Pipeline,
    settings: &'a RenderSettings,
    quiet: bool,
}

impl Job for RenderJob<'_> {
    type Output = (Image, Stats);

    fn run<B: Backend>(&mut self, backend: &B) -> Result<(Image, Stats), BackendError> {
        let mut renderer = Renderer::new(backend, self.arena, self.pipeline, self.settings)?;
        let mut progress = Progress::new(self.quiet);
        let image = renderer.render(&mut |share| {
            progress.update(share);
            true
        });
        progress.finish();
        let image = image?.expect("nothing stops this render early");
        Ok((image, renderer.stats))
    }
}
