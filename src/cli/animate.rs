//! `bulbfold animate`: a film of a scene, as numbered pictures or as one file.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::Instant;

use bulbfold::engine::{Moments, Request};
use bulbfold::graph::motion::{Motion, Rate};
use bulbfold::load::Loaded;
use bulbfold::motion::Moves;
use bulbfold::shade::Size;
use clap::Args;

use super::camera::CameraArgs;
use super::encode::{self, Encoder};
use super::film::{self, Film, Report};
use super::frames::{Names, refuse_json};
use super::moments::{Clock, FilmMoments, Loader, Way, way_of};
use super::picture_args::PictureArgs;
use super::progress::short;
use super::session::talk;
use super::sweep::RangeArgs;
use super::{Failure, Outcome, Session, flicker, manifest, usage};

/// Arguments of `animate`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold animate flight.ron -o flight.mp4
  bulbfold animate flight.ron -o frames/flight_%05d.exr --frames 1..48
  bulbfold animate mandelbulb --way turntable --seconds 6 -o bulb.webm
  bulbfold animate mandelbox --way 'Dive(zoom: 10000)' --seconds 12 --shutter 180 -o dive.mp4
  bulbfold animate mandelbulb --sweep power=4.5..8 --seconds 5 --preview -o morph.gif
  bulbfold animate flight.ron --check

Keys, curves and ways of the camera stand in the file's `animation: (...)`: docs/films.md.")]
pub struct Arguments {
    #[command(flatten)]
    picture: PictureArgs,
    #[command(flatten)]
    shot: ShotArgs,
    /// Small and fast: 320 columns, one sample a pixel, no motion blur
    #[arg(long, help_heading = "Film")]
    preview: bool,
    /// Keep the frames of a film that is one file, in FILM.frames
    #[arg(long, help_heading = "Film")]
    keep_frames: bool,
    /// Render frames again that are there
    #[arg(long, help_heading = "Film")]
    again: bool,
    /// Look for flicker in small pictures of neighbouring frames, and write no film
    #[arg(long, help_heading = "Film", conflicts_with_all = ["preview", "json"])]
    check: bool,
}

/// A film: what moves, which frames of it, and for how long the shutter is open.
#[derive(Args, Clone, Debug)]
pub struct ShotArgs {
    #[command(flatten)]
    film: FilmArgs,
    /// Render these frames alone, counted from 1, such as 25..48
    #[arg(long, value_name = "A..B", value_parser = parse_frames, help_heading = "Film")]
    frames: Option<[u32; 2]>,
    /// Render every Nth frame alone
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..), help_heading = "Film")]
    every: u32,
    /// Motion blur: how long the shutter is open, in degrees of a frame; 180 is usual [default: the file's, else 0]
    #[arg(long, value_name = "DEG", value_parser = parse_shutter, help_heading = "Film")]
    shutter: Option<f64>,
    /// Pictures that a frame with motion blur is the average of [default: the file's, else 8]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=256), help_heading = "Film")]
    shutter_samples: Option<u32>,
    /// A sound file for the film [default: the file's]
    #[arg(long, value_name = "FILE", help_heading = "Film")]
    audio: Option<PathBuf>,
}

/// What moves in a film, and for how long.
#[derive(Args, Clone, Debug)]
pub struct FilmArgs {
    #[command(flatten)]
    ranges: RangeArgs,
    /// Length of the film [default: the file's, else 4]
    #[arg(long, value_name = "S", value_parser = super::arguments::parse_positive, help_heading = "Film")]
    seconds: Option<f64>,
    /// Frames a second, such as 24 or 29.97 [default: the file's, else 24]
    #[arg(long, value_name = "N", value_parser = parse_rate, help_heading = "Film")]
    fps: Option<Rate>,
    /// The camera's way instead of the file's: turntable, orbit, dolly or dive, or as in a file: 'Turntable(turns: 2)'
    #[arg(long, value_name = "WAY", help_heading = "Film")]
    way: Option<String>,
}

fn parse_rate(text: &str) -> Result<Rate, String> {
    let fps = super::arguments::parse_positive(text)?;
    Rate::of(fps).ok_or_else(|| format!("it must be at most {}", Rate::MOST))
}

fn parse_shutter(text: &str) -> Result<f64, String> {
    let degrees = super::arguments::parse_number(text)?;
    if (0.0..=360.0).contains(&degrees) { Ok(degrees / 360.0) } else { Err("it must be from 0 to 360".into()) }
}

/// Reads `A..B`, or one number.
fn parse_frames(text: &str) -> Result<[u32; 2], String> {
    let (from, to) = text.split_once("..").unwrap_or((text, text));
    let number = |text: &str| text.trim().trim_start_matches('=').parse::<u32>().ok().filter(|n| *n > 0);
    match (number(from), number(to)) {
        (Some(from), Some(to)) if from <= to => Ok([from, to]),
        _ => Err("write the first and the last frame, counted from 1, such as 25..48".into()),
    }
}

/// Columns of a preview.
const PREVIEW: u32 = 320;
/// Length of a film that says nothing, in seconds.
const SECONDS: f64 = 4.0;

/// Runs the command.
pub fn run(arguments: &mut Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    arguments.picture.take_changes();
    let arguments = &*arguments;
    arguments.picture.want_file("a film")?;
    let start = Instant::now();
    let encoder = encode::encoder(&arguments.picture.output, arguments.check)?;
    let names = match &encoder {
        Some(encoder) => Names::inside(&encoder.folder()),
        None if arguments.check => Names::inside(Path::new("")),
        None => Names::new(&arguments.picture.output, &arguments.picture.formula.file, "a film")?,
    };
    if arguments.picture.json {
        refuse_json(&names)?;
    }
    arguments.picture.prepare();
    let request = arguments.request();
    let quick = Quick { is_small: arguments.preview, has_shutter: !arguments.preview && !arguments.check };
    let Shot { moments, frames, request, audio } =
        arguments.shot.shot((&arguments.picture, request), quick, session)?;
    let session = session.keeping_kernels();
    if arguments.check {
        return flicker::check(session, (&moments, &frames), &request, out);
    }
    if let Some(encoder) = &encoder {
        encoder.prepare(audio.as_deref())?;
    }
    let (blur, rate, count) = (moments.clock.blur, moments.clock.rate, frames.len() as u32);
    let settings = request.clone();
    let film = Film {
        picture: &arguments.picture,
        request,
        moments: &moments,
        blur,
        frames,
        names: &names,
        keeps: !arguments.again,
    };
    let report = film::render(film, session)?;
    if !matches!(names, Names::One(_)) {
        manifest::write_manifest(&names, (&arguments.picture, &settings), (&moments.clock, &report))?;
    }
    if let Some(encoder) = &encoder {
        // The sound of some frames begins where the first of them does.
        let begin = arguments.shot.begin(rate);
        encoder.join(
            &report.written,
            (rate, arguments.shot.every()),
            audio.as_deref().map(|audio| (audio, begin)),
            arguments.keep_frames,
            session.progress(),
        )?;
    }
    arguments.tell(&report, out)?;
    session.say(&format!("{} ({})", shown(&names, encoder.as_ref(), count), short(start.elapsed())));
    Ok(())
}

/// What was written, as people read it.
fn shown(names: &Names, encoder: Option<&Encoder>, frames: u32) -> String {
    match encoder {
        Some(encoder) => format!("{frames} frames to {}", encoder.target().display()),
        None => names.shown(frames),
    }
}

impl Arguments {
    fn tell(&self, report: &Report, out: &mut dyn Write) -> Outcome {
        if self.picture.json {
            writeln!(out, "{}", report.json())?;
        }
        if self.picture.stats {
            talk(report.table().trim_end());
        }
        Ok(())
    }

    fn request(&self) -> Request {
        let request = self.picture.request();
        if self.preview { Request { samples: 1, ..request } } else { request }
    }
}

/// What is left out of a film that is to be quick.
#[derive(Clone, Copy)]
pub struct Quick {
    /// Whether its pictures are small.
    pub is_small: bool,
    /// Whether it has motion blur where that is asked for.
    pub has_shutter: bool,
}

/// A film whose frames can be settled.
pub struct Shot {
    /// What it shows.
    pub moments: FilmMoments,
    /// The frames that are wanted, counted from 0.
    pub frames: Vec<u32>,
    /// The request, with the size of its pictures.
    pub request: Request,
    /// Its sound.
    pub audio: Option<PathBuf>,
}

impl ShotArgs {
    /// Whether anything is said of a film.
    pub fn is_given(&self) -> bool {
        let is_moved = !self.film.ranges.ranges.is_empty() || self.film.way.is_some();
        let is_timed = self.film.seconds.is_some() || self.film.fps.is_some();
        let is_cut = self.frames.is_some() || self.every > 1;
        is_moved || is_timed || is_cut || self.shutter.is_some() || self.audio.is_some()
    }

    /// When the first frame that is wanted begins, in seconds.
    pub fn begin(&self, rate: Rate) -> f64 {
        f64::from(self.frames.map_or(0, |[first, _]| first - 1)) * f64::from(rate.seconds) / f64::from(rate.frames)
    }

    /// Frames from one that is rendered to the next.
    pub fn every(&self) -> u32 {
        self.every
    }

    /// The film of a formula, with pictures as they are asked for.
    pub fn shot(
        &self,
        (picture, request): (&PictureArgs, Request),
        quick: Quick,
        session: &mut Session,
    ) -> Result<Shot, Failure> {
        request.first_precision().map_err(|error| session.failed(error))?;
        let changes = picture.changes(session)?;
        let file = &picture.formula.file;
        let mut moments = self.film.moments(session, (file, changes), picture.camera, &request)?;
        if quick.has_shutter {
            self.open_shutter(&mut moments.clock, moments.moves.as_ref());
        }
        let frames = self.chosen(moments.clock.frames)?;
        let first = moments.moment(0).map_err(|error| session.failed(error))?;
        let size = picture.size_for(first.formula.graph().scene.camera)?;
        let size = match quick.is_small && size.width > PREVIEW {
            true => Size { width: PREVIEW, height: (size.height * PREVIEW / size.width).max(2) / 2 * 2 },
            false => size,
        };
        let own = || moments.moves.as_ref().and_then(|moves| moves.audio().map(Path::to_path_buf));
        let audio = self.audio.clone().or_else(own);
        Ok(Shot { moments, frames, request: Request { size, ..request }, audio })
    }

    /// The shutter that is asked for, else the file's.
    fn open_shutter(&self, clock: &mut Clock, moves: Option<&Moves>) {
        let own = moves.map(Moves::motion);
        let shutter = self.shutter.or(own.map(|motion| motion.shutter)).unwrap_or(0.0);
        let samples = self.shutter_samples.or(own.map(|motion| motion.samples)).unwrap_or(1);
        if shutter > 0.0 {
            (clock.shutter, clock.blur) = (shutter, samples);
        }
    }

    /// The frames that are wanted, counted from 0.
    fn chosen(&self, count: u32) -> Result<Vec<u32>, Failure> {
        let [first, last] = self.frames.unwrap_or([1, count]);
        if last > count {
            let text = format!("there is no frame {last}: the film has {count}");
            return Err(usage(text, "give other --frames, or more --seconds"));
        }
        Ok((first - 1..last).step_by(self.every as usize).collect())
    }
}

impl FilmArgs {
    /// The moments of a film of a formula, without motion blur.
    pub fn moments(
        &self,
        session: &mut Session,
        (file, mut changes): (&Path, Vec<(String, String)>),
        camera: CameraArgs,
        request: &Request,
    ) -> Result<FilmMoments, Failure> {
        let mut loaded = session.load(file, &changes)?;
        if let Some(way) = self.written_way() {
            changes.push(match loaded.graph.scene.motion {
                Some(_) => ("animation.camera".to_string(), way),
                None => {
                    ("animation".to_string(), format!("(seconds: {}, camera: {way})", self.seconds.unwrap_or(SECONDS)))
                }
            });
            loaded = session.load_again(file, &changes)?;
        }
        let motion = self.motion(file, &loaded)?;
        let way = motion.camera.clone();
        let loader = Loader { library: session.library.clone(), file: file.to_path_buf() };
        let failed = |error| session.failed(error);
        let seconds = motion.seconds;
        let formula = loader.open(&changes).map_err(failed)?;
        let way = match &way {
            Some(way) => {
                let of = (&formula, &changes[..]);
                way_of((&session.engine, &loader), of, request, (way, seconds)).map_err(failed)?
            }
            None => Way::Still,
        };
        let touching = if let Way::Path(path) = &way { path.tightest() } else { None };
        if let Some(share) = touching {
            let text =
                format!("the camera's path comes to the set as close as {:.0} % of its clearance", 100.0 * share);
            session.warn(&format!("{text}\nmove the views, or add one between them; `bulbfold path` shows where"));
        }
        let frames = motion.frames();
        self.ranges.frames(Some(frames))?;
        let clock = Clock { rate: motion.rate, frames, blur: 1, shutter: 0.0 };
        let mut library = session.library.clone();
        let moves = Moves::open(&mut library, &loaded, motion);
        let moves = moves.map_err(|message| failed(loader.failed(message)))?;
        let loader = Loader { library, file: file.to_path_buf() };
        let ranges = self.ranges.ranges.clone();
        Ok(FilmMoments { loader, changes, camera, ranges, moves: Some(moves), way, clock, still: OnceLock::new() })
    }

    /// The camera's way as a file writes it.
    fn written_way(&self) -> Option<String> {
        let way = self.way.as_ref()?;
        let name = match way.as_str() {
            "turntable" => "Turntable(turns: 1)",
            "orbit" => "Orbit(turns: 1)",
            "dolly" => "Dolly(to: 0.4)",
            "dive" => "Dive(zoom: 100)",
            written => written,
        };
        Some(name.to_string())
    }

    /// The file's motion, with what is asked for instead.
    fn motion(&self, file: &Path, loaded: &Loaded) -> Result<Motion, Failure> {
        let own = loaded.graph.scene.motion.clone();
        let is_script = file.extension().is_some_and(|end| end == "rhai");
        if own.is_none() && self.ranges.ranges.is_empty() && !is_script {
            let text = format!("nothing moves in `{}`", loaded.graph.name);
            let help = "add `animation: (seconds: 4, tracks: {...})` to the file, or give --way turntable or --sweep NAME=FROM..TO";
            return Err(usage(text, help));
        }
        let listed = self.ranges.frames(None)?;
        let rate = self.fps.or(own.as_ref().map(|motion| motion.rate)).unwrap_or(Rate::FILM);
        let mut motion =
            own.unwrap_or_else(|| Motion::still(listed.map_or(SECONDS, |n| rate.time(f64::from(n))), rate));
        motion.rate = rate;
        motion.seconds = self.seconds.unwrap_or(motion.seconds);
        if motion.seconds * rate.fps() > f64::from(Motion::MOST_FRAMES) {
            let text = format!("the film has more than {} frames", Motion::MOST_FRAMES);
            return Err(usage(text, "give less --seconds or a lower --fps"));
        }
        Ok(motion)
    }
}
