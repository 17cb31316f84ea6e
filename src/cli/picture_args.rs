//! Arguments of pictures, and of films, which are many of them.

use bulbfold::engine::{MOST_EDGE, Request};
use bulbfold::film::is_picture;
use bulbfold::graph::Camera;
use bulbfold::render::{MIRRORS, PathTracing, Sampling};
use bulbfold::shade::Size;
use clap::{Args, ValueEnum};

use super::arguments::{AutoArgs, BackendArg, FilmArgs, FormulaArgs, PicturePrecision};
use super::camera::{CameraArgs, usual_size};
use super::matter::LookArgs;
use super::pictures::OutputArgs;
use super::session::is_stdin;
use super::sizes::parse_size;
use super::{Failure, Outcome, Session, usage};

/// A picture, however many of it are wanted.
#[derive(Args, Clone, Debug)]
pub struct PictureArgs {
    #[command(flatten)]
    pub formula: FormulaArgs,
    #[command(flatten)]
    pub output: OutputArgs,
    /// Columns and rows, or a name such as 4k, square or a4@300dpi [default: 1280x720]
    #[arg(long, value_name = "WxH", value_parser = parse_size, help_heading = "Picture")]
    pub size: Option<Size>,
    /// Multiply columns and rows by a number from 0.01 to 100
    #[arg(long, value_name = "F", value_parser = parse_scale, help_heading = "Picture")]
    pub scale: Option<f64>,
    /// Samples along each edge of a pixel: 1 is fastest, 2 takes 4 a pixel, 3 takes 9
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=16), help_heading = "Picture")]
    samples: u32,
    /// Which pixels get all samples: those that differ from their neighbours, or every pixel
    #[arg(long, value_enum, default_value_t = SamplingArg::Adaptive, help_heading = "Picture")]
    sampling: SamplingArg,
    /// Print choices and counts to stderr
    #[arg(short = 'v', long, visible_alias = "verbose")]
    pub stats: bool,
    /// Print choices and counts to stdout, as one JSON object
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub camera: CameraArgs,
    #[command(flatten)]
    path: PathArgs,
    #[command(flatten)]
    pub look: LookArgs,
    #[command(flatten)]
    film: FilmArgs,
    /// Where to compute
    #[arg(long, value_enum, default_value_t = BackendArg::Auto, help_heading = "Computing")]
    pub backend: BackendArg,
    /// Precision; f64 is slower and runs on the CPU
    #[arg(long, value_enum, default_value_t = PicturePrecision::Auto, help_heading = "Computing")]
    pub precision: PicturePrecision,
    /// Threads of the CPU back end [default: all cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024), help_heading = "Computing")]
    threads: Option<u32>,
    /// March every ray by itself, by steps no longer than an estimate, and every orbit to its end: what the short cuts (beams,
    /// boxes, longer steps, early ends of orbits) are compared with
    #[arg(long, help_heading = "Computing")]
    exact_rays: bool,
    #[command(flatten)]
    pub estimate: AutoArgs,
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
    ///
    /// Errors: `--scale` makes it too large.
    pub fn size_for(&self, own: Option<Camera>) -> Result<Size, Failure> {
        self.scaled(self.size.unwrap_or_else(|| usual_size(&self.camera.change(), own)))
    }

    /// A size multiplied as is asked for.
    pub fn scaled(&self, size: Size) -> Result<Size, Failure> {
        let edge = |edge: u32| (f64::from(edge) * self.scale.unwrap_or(1.0)).round().max(1.0) as u32;
        let scaled = Size { width: edge(size.width), height: edge(size.height) };
        match scaled.width.max(scaled.height) <= MOST_EDGE {
            true => Ok(scaled),
            false => {
                let text = format!("a picture of {}x{} is too large", scaled.width, scaled.height);
                Err(usage(text, &format!("columns and rows go up to {MOST_EDGE}: choose a smaller `--scale`")))
            }
        }
    }

    /// Takes changes of the formula that are the camera's.
    pub fn take_changes(&mut self) {
        let camera = &mut self.camera;
        self.formula.take_changes(|path, value| camera.takes(path, value));
    }

    /// Refuses to begin with a picture, or with what can be read once alone.
    pub fn want_file(&self, what: &str) -> Outcome {
        if is_stdin(&self.formula.file) {
            return Err(usage(
                format!("{what} reads its formula more than once, and stdin can be read once"),
                "name a file",
            ));
        }
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
            denoise: self.path.denoise,
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
#[command(next_help_heading = "Light")]
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
    /// Filter the noise of paths, and keep the edges of surfaces; asks for `--integrator path`
    #[arg(long)]
    pub denoise: bool,
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
        let is_meant = self.denoise || self.paths.is_some() || self.bounces.is_some() || self.noise.is_some();
        self.integrator == IntegratorArg::Path || is_meant
    }

    /// How light is followed along paths; none where it comes straight.
    pub fn tracing(&self, seed: u64) -> Option<PathTracing> {
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

fn parse_scale(text: &str) -> Result<f64, String> {
    let scale = super::arguments::parse_number(text)?;
    if (0.01..=100.0).contains(&scale) { Ok(scale) } else { Err("it must be from 0.01 to 100".into()) }
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
