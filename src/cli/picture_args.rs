//! Arguments of pictures, and of films, which are many of them.

use bulbfold::engine::Request;
use bulbfold::film::is_picture;
use bulbfold::graph::Camera;
use bulbfold::render::{MIRRORS, PathTracing, Sampling};
use bulbfold::shade::Size;
use clap::{Args, ValueEnum};

use super::arguments::{AutoArgs, BackendArg, FilmArgs, FormulaArgs, PicturePrecision};
use super::camera::{CameraArgs, usual_size};
use super::matter::LookArgs;
use super::pictures::OutputArgs;
use super::sizes::parse_size;
use super::{Failure, Outcome, Session, usage};

/// A picture, however many of it are wanted.
#[derive(Args, Debug)]
pub struct PictureArgs {
    #[command(flatten)]
    pub formula: FormulaArgs,
    #[command(flatten)]
    pub output: OutputArgs,
    /// Columns and rows [default: 1280x720]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<Size>,
    /// Samples along each edge of a pixel: 1 is fastest, 2 takes 4 a pixel, 3 takes 9
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=16))]
    samples: u32,
    /// Which pixels get all samples: those that differ from their neighbours, or every pixel
    #[arg(long, value_enum, default_value_t = SamplingArg::Adaptive)]
    sampling: SamplingArg,
    #[command(flatten)]
    path: PathArgs,
    /// Where to compute
    #[arg(long, value_enum, default_value_t = BackendArg::Auto)]
    pub backend: BackendArg,
    /// Precision; f64 is slower and runs on the CPU
    #[arg(long, value_enum, default_value_t = PicturePrecision::Auto)]
    pub precision: PicturePrecision,
    #[command(flatten)]
    pub estimate: AutoArgs,
    #[command(flatten)]
    pub camera: CameraArgs,
    #[command(flatten)]
    pub look: LookArgs,
    #[command(flatten)]
    film: FilmArgs,
    /// March every ray by itself, by steps no longer than an estimate, and every orbit to its end: what the short cuts (beams,
    /// boxes, longer steps, early ends of orbits) are compared with
    #[arg(long)]
    exact_rays: bool,
    /// Print choices and counts to stderr
    #[arg(long)]
    pub stats: bool,
    /// Print choices and counts to stdout, as one JSON object
    #[arg(long)]
    pub json: bool,
    /// Threads of the CPU back end [default: all cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    threads: Option<u32>,
    /// Print no progress and no message on success
    #[arg(short, long)]
    pub quiet: bool,
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
pub const DEFAULT_SIZE: Size = Size { width: 1280, height: 720 };

impl PictureArgs {
    /// The picture's size: what is given, else one that suits the lens.
    pub fn size_for(&self, own: Option<Camera>) -> Size {
        self.size.unwrap_or_else(|| usual_size(&self.camera.change(), own))
    }

    /// Takes changes of the formula that are the camera's.
    pub fn take_changes(&mut self) {
        let camera = &mut self.camera;
        self.formula.take_changes(|path, value| camera.takes(path, value));
    }

    /// Refuses to begin with a picture.
    pub fn refuse_picture(&self, what: &str) -> Outcome {
        match is_picture(&self.formula.file) {
            false => Ok(()),
            true => Err(usage(
                format!("{what} begins with a formula and not with a picture"),
                "take the formula out of the picture: `bulbfold new NAME --from PICTURE`",
            )),
        }
    }

    /// Starts the threads that were asked for.
    pub fn prepare(&self) {
        if let Some(threads) = self.threads {
            // Fails only when threads are running already, and then the number stays what it was.
            let _ = rayon::ThreadPoolBuilder::new().num_threads(threads as usize).build_global();
        }
    }

    /// The picture that is asked for.
    pub fn request(&self) -> Request {
        Request {
            samples: self.samples,
            sampling: self.sampling.sampling(),
            camera: self.camera.change(),
            backend: self.backend.choice(),
            precision: self.precision.given(),
            exact_rays: self.exact_rays,
            path: self.path.tracing(self.look.seed.unwrap_or(0)),
            mirrors: self.path.mirrors,
            ..self.estimate.request(self.size.unwrap_or(DEFAULT_SIZE))
        }
    }

    /// What is changed in the formula; an option of the same meaning wins over `--set`.
    pub fn changes(&self, session: &mut Session) -> Result<Vec<(String, String)>, Failure> {
        let mut changes = self.formula.changes();
        changes.extend(self.look.changes(session, self.path.is_asked())?);
        changes.extend(self.film.changes());
        Ok(changes)
    }
}

/// How light is followed.
#[derive(Args, Clone, Copy, Debug)]
pub struct PathArgs {
    /// Where light comes from: straight from lights and surroundings (fast, without noise), or along paths from surface to surface
    #[arg(long, value_enum, default_value_t = IntegratorArg::Direct)]
    integrator: IntegratorArg,
    /// Paths through each pixel at most; asks for `--integrator path`
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=65536))]
    paths: Option<u32>,
    /// Surfaces that a path meets at most; asks for `--integrator path`
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=24))]
    bounces: Option<u32>,
    /// Mirrored rays that follow each other at most with `--integrator direct`; 0 shows the sky alone in mirrors
    #[arg(long, value_name = "N", default_value_t = MIRRORS, value_parser = clap::value_parser!(u32).range(0..=16))]
    mirrors: u32,
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
