//! `bulbfold look`: views that are worth it, on a contact sheet.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bulbfold::engine::{CameraChange, Formula, Request};
use bulbfold::film::Image;
use bulbfold::graph::Camera;
use bulbfold::live::with_view;
use bulbfold::render::{FoundView, Search};
use bulbfold::shade::Size;
use clap::Args;

use super::arguments::{AutoArgs, BackendArg, FormulaArgs};
use super::camera::flags;
use super::contact::{self, Cell, columns_of};
use super::output::{Content, cannot_write, check_output, refuse_both};
use super::session::{refuse_plane, talk};
use super::sizes::parse_size;
use super::{Failure, Outcome, Session, message, usage};

/// Arguments of `look`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold look mandelbox
  bulbfold look menger --interior --count 6 --seed 3 -o inside.png
  bulbfold look my_hybrid.ron --keep 2=gate --keep 5=hall
  bulbfold render mandelbox --camera=... --target=... --up=... --fov 50    a line of the list, as it is

Each view is printed with its number on the sheet, its worth and its share of hits, and the arguments that render it.")]
pub struct Arguments {
    #[command(flatten)]
    formula: FormulaArgs,
    /// Look in cavities, rather than from outside
    #[arg(long)]
    interior: bool,
    /// Write a view into FILE (.ron) as a preset, such as 2=gate; may be given several times
    #[arg(long, value_name = "N=NAME", value_parser = parse_keep)]
    keep: Vec<(usize, String)>,
    /// Views, at most
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = clap::value_parser!(u32).range(1..=99))]
    count: u32,
    /// Print a JSON object for each view, a line each
    #[arg(long)]
    json: bool,
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
}

/// Samples along each edge of a pixel.
const SAMPLES: u32 = 2;

fn parse_keep(text: &str) -> Result<(usize, String), String> {
    let is_word = |name: &str| !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || "_-".contains(c));
    match text.split_once('=').map(|(number, name)| (number.parse(), name)) {
        Some((Ok(number), name)) if number > 0 && is_word(name) => Ok((number, name.to_string())),
        _ => Err("write the number of a view and a name of letters, digits, _ and -, such as 2=gate".into()),
    }
}

/// Runs the command.
pub fn run(arguments: &Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    let stem = Path::new(&arguments.formula.file).file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let output = arguments.output.clone().unwrap_or_else(|| PathBuf::from(format!("{stem}_look.png")));
    let output = check_output(&output, Some("png"), Content::Bytes)?;
    refuse_both(&output, "the list of views")?;
    refuse_keep(arguments)?;
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
    let request = Request { camera: CameraChange::to(closest.camera), ..base };
    let pictures = pictures(arguments, session, &formula, (&request, &views))?;
    let numbered = pictures.into_iter().enumerate();
    let cell = |(i, picture)| Cell { picture: Some(picture), corner: format!("{}", i + 1), ..Cell::default() };
    let cells: Vec<Cell> = numbered.map(cell).collect();
    let columns = columns_of(cells.len()).min(4);
    contact::write(&output, cells, arguments.size, columns, "Views")?;
    for (number, view) in views.iter().enumerate() {
        let flags = flags(&view.camera, own).join(" ");
        if arguments.json {
            let told =
                Told { number: number + 1, worth: view.score, hits: view.hits, arguments: &flags, camera: view.camera };
            writeln!(out, "{}", serde_json::to_string(&told).map_err(std::io::Error::from)?)?;
            continue;
        }
        let (worth, hits) = ((100.0 * view.score).round(), (100.0 * view.hits).round());
        writeln!(out, "{:>2}  worth {worth:>2}, hits {hits:>2} %  {flags}", number + 1)?;
    }
    keep(arguments, &views)?;
    session.say(&output.path().display().to_string());
    Ok(())
}

/// A view as JSON.
#[derive(serde::Serialize)]
struct Told<'a> {
    number: usize,
    /// From 0 to 1.
    worth: f64,
    /// Share of the picture, from 0 to 1.
    hits: f64,
    /// What renders it.
    arguments: &'a str,
    camera: Camera,
}

/// The file that views are kept in, looked at before any work is done.
fn refuse_keep(arguments: &Arguments) -> Outcome {
    let file = &arguments.formula.file;
    if arguments.keep.is_empty() {
        return Ok(());
    }
    if !file.is_file() || file.extension().is_none_or(|end| !end.eq_ignore_ascii_case("ron")) {
        let help = "`bulbfold new NAME --from FORMULA` writes a file to keep views in";
        return Err(usage(format!("{} is no formula file that views could be kept in", file.display()), help));
    }
    match arguments.formula.changes().is_empty() {
        true => Ok(()),
        false => Err(usage(
            "views of a changed formula cannot be kept in its file",
            "change the file, or drop --set and --preset",
        )),
    }
}

/// Writes views into the formula's file as presets.
fn keep(arguments: &Arguments, views: &[FoundView]) -> Outcome {
    let file = &arguments.formula.file;
    if arguments.keep.is_empty() {
        return Ok(());
    }
    let failed = |error: std::io::Error| cannot_write(file, &error);
    let mut text = std::fs::read_to_string(file).map_err(failed)?;
    for (number, name) in &arguments.keep {
        let Some(view) = views.get(number - 1) else {
            return Err(usage(
                format!("there is no view {number}: {} were found", views.len()),
                "choose one of the list",
            ));
        };
        let help = if arguments.interior { "A view from inside" } else { "A view from near by" };
        text = with_view(&text, (name, help), &view.camera).map_err(|error| usage(error, "add the preset yourself"))?;
    }
    bulbfold::files::write(file, text.as_bytes()).map_err(failed)?;
    talk(&format!("wrote {}", file.display()));
    Ok(())
}

/// The pictures of views, with what a request chooses.
fn pictures(
    arguments: &Arguments,
    session: &Session,
    formula: &Arc<Formula>,
    (request, views): (&Request, &[FoundView]),
) -> Result<Vec<Image>, Failure> {
    let mut watch = session.watch();
    let job = session.engine.settle(formula, request, &mut watch).map_err(|error| session.failed(error))?;
    drop(watch);
    let mut progress = session.progress();
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
