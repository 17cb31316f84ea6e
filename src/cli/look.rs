//! `bulbfold look`: views that are worth it, on a contact sheet.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bulbfold::engine::{CameraChange, Formula, Request};
use bulbfold::film::Image;
use bulbfold::render::{FoundView, Search};
use bulbfold::shade::Size;
use clap::Args;

use super::arguments::{AutoArgs, BackendArg, FormulaArgs};
use super::camera::flags;
use super::contact::{self, Cell, columns_of};
use super::output::{Content, check_output, refuse_both};
use super::progress::Progress;
use super::session::{refuse_plane, talk};
use super::sizes::parse_size;
use super::{Failure, Outcome, Session, message};

/// Arguments of `look`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold look mandelbox
  bulbfold look menger --interior --count 6 --seed 3 -o inside.png
  bulbfold render mandelbox --camera=... --target=... --up=... --fov 50    a line of the list, as it is

Each view is printed with its number on the sheet, its worth and its share of hits, and the arguments that render it.")]
pub struct Arguments {
    #[command(flatten)]
    formula: FormulaArgs,
    /// Look in cavities, rather than from outside
    #[arg(long)]
    interior: bool,
    /// Views, at most
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = clap::value_parser!(u32).range(1..=99))]
    count: u32,
    /// Other seeds find other views
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// The contact sheet to write; - is stdout [default: NAME_look.png]
    #[arg(short, long, value_name = "OUT.png")]
    output: Option<PathBuf>,
    /// Columns and rows of each picture
    #[arg(long, value_name = "WxH", default_value = "384x240", value_parser = parse_size)]
    size: Size,
    /// Where to compute
    #[arg(long, value_enum, default_value_t = BackendArg::Auto)]
    backend: BackendArg,
    #[command(flatten)]
    estimate: AutoArgs,
    /// Print no progress
    #[arg(short, long)]
    quiet: bool,
}

/// Samples along each edge of a pixel.
const SAMPLES: u32 = 2;
/// Runs the command.
pub fn run(arguments: &Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    let stem = Path::new(&arguments.formula.file).file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let output = arguments.output.clone().unwrap_or_else(|| PathBuf::from(format!("{stem}_look.png")));
    let output = check_output(&output, Some("png"), Content::Bytes)?;
    refuse_both(&output, "the list of views")?;
    let formula = session.open(&arguments.formula.file, &arguments.formula.changes())?;
    session.spare_inputs(&output)?;
    refuse_plane(formula.graph(), "`look`")?;
    session.keeping_kernels();
    let base =
        Request { samples: SAMPLES, backend: arguments.backend.choice(), ..arguments.estimate.request(arguments.size) };
    let own = formula.graph().scene.camera;
    let search = Search {
        interior: arguments.interior,
        count: arguments.count as usize,
        seed: arguments.seed,
        size: arguments.size,
        up: own.map_or([0.0, 0.0, 1.0], |camera| camera.up),
    };
    let views = session.engine.views(&formula, &base, &search).map_err(|error| session.failed(error))?;
    let Some(closest) = views.iter().min_by(|a, b| a.camera.distance().total_cmp(&b.camera.distance())) else {
        let help = if arguments.interior { "try without --interior, or another --seed" } else { "try another --seed" };
        return Err(Failure::Work(message(&format!("no view of `{stem}` shows enough"), help)));
    };
    // The closest view is the most demanding one: what is chosen for it serves all.
    let request = Request { camera: seen_from(closest), ..base };
    let pictures = pictures(arguments, session, &formula, (&request, &views))?;
    let numbered = pictures.into_iter().enumerate();
    let cell = |(i, picture)| Cell { picture: Some(picture), corner: format!("{}", i + 1), ..Cell::default() };
    let cells: Vec<Cell> = numbered.map(cell).collect();
    let columns = columns_of(cells.len()).min(4);
    contact::write(&output, cells, arguments.size, columns, "Views")?;
    for (number, view) in views.iter().enumerate() {
        let (worth, hits) = ((100.0 * view.score).round(), (100.0 * view.hits).round());
        writeln!(out, "{:>2}  worth {worth:>2}, hits {hits:>2} %  {}", number + 1, flags(&view.camera, own).join(" "))?;
    }
    if !arguments.quiet {
        talk(&output.path().display().to_string());
    }
    Ok(())
}

/// The pictures of views, with what a request chooses.
fn pictures(
    arguments: &Arguments,
    session: &Session,
    formula: &Arc<Formula>,
    (request, views): (&Request, &[FoundView]),
) -> Result<Vec<Image>, Failure> {
    let mut watch = session.watch(arguments.quiet);
    let job = session.engine.settle(formula, request, &mut watch).map_err(|error| session.failed(error))?;
    drop(watch);
    let mut progress = Progress::new(arguments.quiet);
    let mut pictures = Vec::new();
    for view in views {
        let job = job.with_camera(view.camera);
        let mut image = Image { size: arguments.size, rgb: Vec::new() };
        let done = session.engine.render(&job, job.rows(), &mut image, &mut ());
        done.map_err(|error| session.failed(error))?;
        pictures.push(image);
        progress.update(pictures.len() as f64 / views.len() as f64);
    }
    progress.finish();
    Ok(pictures)
}

/// The change that gives a file's camera a view.
fn seen_from(view: &FoundView) -> CameraChange {
    let camera = view.camera;
    CameraChange {
        position: Some(camera.position),
        target: Some(camera.target),
        up: Some(camera.up),
        lens: Some(camera.lens),
        fov: Some(camera.fov),
        ..CameraChange::default()
    }
}
