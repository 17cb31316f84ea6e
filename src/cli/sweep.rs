//! `bulbfold render --sweep`: frames between two values.

use std::io::Write;
use std::sync::OnceLock;
use std::time::Instant;

use bulbfold::engine::Request;
use bulbfold::graph::motion::Rate;
use clap::Args;

use super::film::{self, Film};
use super::frames::{Names, refuse_json};
use super::moments::{Clock, FilmMoments, Loader, Way};
use super::picture_args::{DEFAULT_SIZE, PictureArgs};
use super::progress::short;
use super::range::Range;
use super::session::talk;
use super::{Failure, Outcome, Session, usage};

/// What makes a picture an animation.
#[derive(Args, Default, Debug)]
pub struct SweepArgs {
    #[command(flatten)]
    ranges: RangeArgs,
    /// Number of frames, that of the values where there is a list; -o is then a name with a place for the frame's number, such as frame_%04d.png
    #[arg(long, value_name = "N", requires = "ranges", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    frames: Option<u32>,
}

/// Values that move from the first to the last frame.
#[derive(Args, Clone, Default, Debug)]
pub struct RangeArgs {
    /// Move what --set sets from frame to frame, or the view: camera, target, up, fov, or turn (degrees around the target);
    /// vectors are X,Y,Z..X,Y,Z. Or a list with a value for each frame, such as seed=3,7,18. May be given several times
    #[arg(long = "sweep", value_name = "NAME=FROM..TO", allow_hyphen_values = true)]
    pub ranges: Vec<Range>,
}

impl RangeArgs {
    /// How many frames there are: what is asked for, else that of the lists; none where nobody says.
    ///
    /// Errors: lists of another length.
    pub fn frames(&self, asked: Option<u32>) -> Result<Option<u32>, Failure> {
        let listed = self.ranges.iter().find_map(|range| range.frames().map(|count| count as u32));
        let Some(frames) = asked.or(listed) else { return Ok(None) };
        let odd = |range: &&Range| range.frames().is_some_and(|count| count != frames as usize);
        match self.ranges.iter().find(odd) {
            None => Ok(Some(frames)),
            Some(range) => {
                let count = range.frames().unwrap_or_default();
                let text = format!("the sweep of `{}` lists {count} values for {frames} frames", range.name);
                Err(usage(text, "list a value for each frame, or leave out --frames"))
            }
        }
    }
}

impl SweepArgs {
    /// Whether a single picture is asked for.
    pub fn is_empty(&self) -> bool {
        self.ranges.ranges.is_empty()
    }

    /// How many frames there are; none if a single picture is asked for.
    pub fn frames(&self) -> Result<Option<u32>, Failure> {
        let Some(first) = self.ranges.ranges.first() else { return Ok(None) };
        match self.ranges.frames(self.frames)? {
            Some(frames) => Ok(Some(frames)),
            None => {
                let text = format!("the sweep of `{}` does not say how many frames there are", first.name);
                Err(usage(text, "give their number: --frames 48"))
            }
        }
    }
}

/// Renders all frames.
pub fn run(
    arguments: &PictureArgs,
    sweep: &SweepArgs,
    (frames, resumes): (u32, bool),
    session: &mut Session,
    out: &mut dyn Write,
) -> Outcome {
    arguments.want_file("a sweep")?;
    let names = Names::new(&arguments.output, &arguments.formula.file, "a sweep")?;
    if arguments.json {
        refuse_json(&names)?;
    }
    if resumes {
        names.refuse_stream()?;
    }
    arguments.prepare();
    let size = arguments.scaled(arguments.size.unwrap_or(DEFAULT_SIZE))?;
    let request = Request { size, ..arguments.request() };
    request.first_precision().map_err(|error| session.failed(error))?;
    let start = Instant::now();
    let changes = arguments.changes(session)?;
    let file = &arguments.formula.file;
    // Told once: warnings, and what is wrong with the file itself.
    session.load(file, &changes)?;
    let session = session.keeping_kernels();
    let moments = FilmMoments {
        loader: Loader { library: session.library.clone(), file: file.clone() },
        changes,
        camera: arguments.camera,
        ranges: sweep.ranges.ranges.clone(),
        moves: None,
        way: Way::Still,
        clock: Clock { rate: Rate::FILM, frames, blur: 1, shutter: 0.0 },
        still: OnceLock::new(),
    };
    let film = Film {
        picture: arguments,
        request,
        moments: &moments,
        blur: 1,
        frames: (0..frames).collect(),
        names: &names,
        keeps: resumes,
    };
    let report = film::render(film, session)?;
    if arguments.json {
        writeln!(out, "{}", report.json())?;
    }
    if arguments.stats {
        talk(report.table().trim_end());
    }
    session.say(&format!("{} ({})", names.shown(frames), short(start.elapsed())));
    Ok(())
}
