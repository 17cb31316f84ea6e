//! `bulbfold sheet`: formulas, presets, seeds and values of parameters side by side.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bulbfold::engine::{Formula, Request};
use bulbfold::explore::{Parent, Variation, vary};
use bulbfold::motion::Changes;
use bulbfold::shade::Size;
use clap::Args;

use super::arguments::{AutoArgs, BackendArg, ChangeArgs};
use super::contact::{self, Cell, columns_of};
use super::output::{Content, check_output};
use super::range::Range;
use super::session::formula_files;
use super::sizes::parse_size;
use super::vary::{picture, stem_of};
use super::{Failure, Outcome, Session, usage};

/// Arguments of `sheet`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold sheet mandelbox menger mandelbulb -o three.png
  bulbfold sheet mandelbulb --sweep power=2..9 --values 8
  bulbfold sheet mandelbox --sweep scale=1.6..3 --sweep min_radius=0.2..0.8 -o map.png
  bulbfold sheet mandelbulb --presets --seeds 4

The first sweep runs along the columns, the second one along the rows.")]
pub struct Arguments {
    /// Formula files (.ron), folders of them, graph scripts (.rhai) or names of built-in fractals
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    #[command(flatten)]
    changes: ChangeArgs,
    /// Values of what --set sets, from one to another, or a list such as power=2,3,8; twice at most
    #[arg(long = "sweep", value_name = "NAME=FROM..TO", allow_hyphen_values = true)]
    sweeps: Vec<Range>,
    /// Values of a sweep that does not list them
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(2..=50))]
    values: u32,
    /// Show each formula's presets, too
    #[arg(long)]
    presets: bool,
    /// Show so many variations of each formula's numbers, too, good or bad
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=200))]
    seeds: u32,
    /// How far these move numbers: about this share of themselves
    #[arg(long, value_name = "SHARE", default_value_t = 0.3, value_parser = super::vary::parse_amount)]
    amount: f64,
    /// The contact sheet to write; - is stdout
    #[arg(short, long, value_name = "OUT.png", default_value = "sheet.png")]
    output: PathBuf,
    /// Columns and rows of each picture
    #[arg(long, value_name = "WxH", default_value = "320x240", value_parser = parse_size)]
    size: Size,
    /// Where to compute
    #[arg(long, value_enum, default_value_t = BackendArg::Auto)]
    backend: BackendArg,
    #[command(flatten)]
    estimate: AutoArgs,
}

/// Samples along each edge of a pixel.
const SAMPLES: u32 = 2;
/// Most pictures of a sheet.
const MOST: usize = 2_000;

/// A formula with its captions.
struct Shown {
    formula: Arc<Formula>,
    caption: String,
    notes: Vec<String>,
}

/// Runs the command.
pub fn run(arguments: &Arguments, session: &mut Session, _: &mut dyn Write) -> Outcome {
    let target = check_output(&arguments.output, Some("png"), Content::Bytes)?;
    let files = formula_files(&arguments.files)?;
    let grid = Grid::new(arguments)?;
    let mut shown: Vec<Shown> = Vec::new();
    for file in &files {
        for set in variants(arguments, session, file)? {
            for (values, notes) in grid.places() {
                let set: Vec<(String, String)> = set.iter().cloned().chain(values).collect();
                shown.push(Shown { formula: session.open(file, &set)?, caption: caption(file, &set), notes });
            }
        }
        shown.extend(seeds(arguments, session, file)?);
        if shown.len() > MOST {
            return Err(usage(format!("a sheet has at most {MOST} pictures"), "ask for fewer values or files"));
        }
    }
    session.spare_inputs(&target)?;
    session.keeping_kernels();
    let request =
        Request { samples: SAMPLES, backend: arguments.backend.choice(), ..arguments.estimate.request(arguments.size) };
    let mut progress = session.progress();
    let (count, mut cells) = (shown.len(), Vec::new());
    for Shown { formula, caption, notes } in shown {
        let job = session.engine.settle(&formula, &request, &mut session.hushed());
        let job = job.map_err(|error| session.failed(error))?;
        cells.push(Cell { picture: Some(picture(session, &job)?), caption, notes, ..Cell::default() });
        progress.update(cells.len() as f64 / count as f64);
    }
    progress.finish();
    let columns = grid.columns().unwrap_or_else(|| columns_of(cells.len()));
    contact::write(&target, cells, arguments.size, columns, "Formulas")?;
    session.say(&target.path().display().to_string());
    Ok(())
}

/// The formula itself, and its presets where these are wanted: what is set of each.
fn variants(arguments: &Arguments, session: &mut Session, file: &Path) -> Result<Vec<Vec<(String, String)>>, Failure> {
    let own = arguments.changes.changes();
    let mut all = vec![own.clone()];
    if arguments.presets {
        let presets = session.load_again(file, &own)?.graph.presets.clone();
        let with = |preset: &bulbfold::graph::Preset| {
            [vec![("preset".to_string(), format!("\"{}\"", preset.name))], own.clone()].concat()
        };
        all.extend(presets.iter().map(with));
    }
    Ok(all)
}

/// The file's name, with its preset.
fn caption(file: &Path, set: &[(String, String)]) -> String {
    let stem = stem_of(file);
    match set.iter().find(|(path, _)| path == "preset") {
        Some((_, preset)) => format!("{stem}, {}", preset.trim_matches('"')),
        None => stem,
    }
}

/// Variations of a formula's numbers, whatever they show.
fn seeds(arguments: &Arguments, session: &mut Session, file: &Path) -> Result<Vec<Shown>, Failure> {
    if arguments.seeds == 0 {
        return Ok(Vec::new());
    }
    let formula = session.open(file, &arguments.changes.changes())?;
    let parent = Parent::of(&formula, &stem_of(file)).map_err(|error| session.failed(error))?;
    let variation = Variation { seed: 1, amount: arguments.amount, structure: false };
    let one = |number: u32| {
        let draft = vary(&parent, &variation, u64::from(number))?;
        let formula = parent.read(&draft.text())?;
        Ok(Shown { formula, caption: format!("{}, draft {number}", parent.name), notes: draft.changes })
    };
    let all: Result<Vec<Shown>, bulbfold::engine::Error> = (1..=arguments.seeds).map(one).collect();
    all.map_err(|error| session.failed(error))
}

/// Values on two axes.
struct Grid<'a> {
    axes: Vec<(&'a Range, u32)>,
}

impl Grid<'_> {
    fn new(arguments: &Arguments) -> Result<Grid<'_>, Failure> {
        if let Some(view) = arguments.sweeps.iter().find(|range| range.is_of_view()) {
            let help = "sweep a parameter, a node's or a field of the file; `bulbfold look` finds views";
            return Err(usage(format!("a sheet cannot move `{}`", view.name), help));
        }
        if arguments.sweeps.len() > 2 {
            return Err(usage("a sheet has two axes, for two sweeps at most", "drop one of them"));
        }
        let count = |range: &Range| range.frames().map_or(arguments.values, |count| count as u32);
        Ok(Grid { axes: arguments.sweeps.iter().map(|range| (range, count(range))).collect() })
    }

    fn columns(&self) -> Option<usize> {
        self.axes.first().map(|(_, count)| *count as usize)
    }

    /// What is set at each place, row by row, and how that reads.
    fn places(&self) -> Vec<(Changes, Vec<String>)> {
        let mut places = vec![Vec::new()];
        for (range, count) in self.axes.iter().rev() {
            let values = |place: Changes| {
                let value = move |i: u32| (range.name.clone(), range.ron(i, *count));
                (0..*count).map(move |i| place.iter().cloned().chain([value(i)]).collect())
            };
            places = places.into_iter().flat_map(values).collect();
        }
        let read = |(name, value): &(String, String)| format!("{name} {value}");
        let both = |place: Changes| {
            let notes = place.iter().rev().map(read).collect();
            (place, notes)
        };
        places.into_iter().map(both).collect()
    }
}
