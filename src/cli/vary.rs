//! `bulbfold vary`: variations of a formula, on a contact sheet and as files.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bulbfold::engine::{Formula, Request};
use bulbfold::explore::{Draft, Found, Judge, Parent, Variation, search, vary};
use bulbfold::files::Target;
use bulbfold::film::Image;
use bulbfold::shade::Size;
use clap::Args;

use super::arguments::{AutoArgs, BackendArg, FormulaArgs};
use super::contact::{self, Cell, columns_of};
use super::output::{Content, check_output, refuse_both};
use super::session::refuse_plane;
use super::sizes::parse_size;
use super::{Failure, Outcome, Session, message, usage};

/// Arguments of `vary`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold vary mandelbox
  bulbfold vary mandelbulb --seed 7 --count 12 --amount 0.6 -o bulbs.png
  bulbfold vary flower.ron --structure --count 40
  bulbfold render mandelbox_vary/mandelbox_03.ron     one of them, larger

Numbers of the formula and of its nodes move within their ranges; with --structure steps are exchanged, inserted,
removed and put into another order, too. What is empty, full, dust, plain, cut by the frame, takes over five times the
estimates of its parent or cannot be estimated within the error budget, or looks like another one, is rejected and counted. The same seed makes the same files.")]
pub struct Arguments {
    #[command(flatten)]
    formula: FormulaArgs,
    #[command(flatten)]
    pub(super) brood: BroodArgs,
    /// How far numbers move: about this share of themselves
    #[arg(long, value_name = "SHARE", default_value_t = 0.3, value_parser = parse_amount)]
    amount: f64,
    /// Vary the steps as well as the numbers
    #[arg(long)]
    structure: bool,
}

/// Arguments of commands that make formulas.
#[derive(Args, Debug)]
pub struct BroodArgs {
    /// Formulas that are wanted
    #[arg(long, value_name = "N", default_value_t = 24, value_parser = clap::value_parser!(u32).range(1..=999))]
    pub count: u32,
    /// Other seeds make other formulas
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// The contact sheet to write; - is stdout [default: NAME_vary.png]
    #[arg(short, long, value_name = "OUT.png")]
    output: Option<PathBuf>,
    /// Folder for the formula files; created if missing [default: the sheet's name without its ending]
    #[arg(long, value_name = "DIR")]
    files: Option<PathBuf>,
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
/// Lines of changes below a picture.
const NOTES: usize = 4;

pub(super) fn parse_amount(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(share) if share > 0.0 && share <= 1.0 => Ok(share),
        _ => Err("write a share above 0, up to 1, such as 0.3".into()),
    }
}

/// Runs the command.
pub fn run(arguments: &Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    let Arguments { formula, brood, .. } = arguments;
    let name = stem_of(&formula.file);
    let places = Places::new(brood, &format!("{name}_vary"))?;
    let (formula, parent) = parent(session, &formula.file, &formula.changes(), "`vary`")?;
    let variation = Variation { seed: brood.seed, amount: arguments.amount, structure: arguments.structure };
    let draw = |number: u64| vary(&parent, &variation, number);
    raise(session, brood, (&places, &name), (&[formula], &[&parent]), draw, out)
}

/// The stem of a file's name, or the name of a built-in fractal.
pub(super) fn stem_of(file: &Path) -> String {
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    stem.chars().map(|c| if c.is_ascii_alphanumeric() || "-_".contains(c) { c } else { '_' }).collect()
}

/// A formula that others are made of.
pub(super) fn parent(
    session: &mut Session,
    file: &Path,
    set: &[(String, String)],
    what: &str,
) -> Result<(Arc<Formula>, Parent), Failure> {
    let formula = session.open(file, set)?;
    refuse_plane(formula.graph(), what)?;
    let parent = Parent::of(&formula, &stem_of(file)).map_err(|error| session.failed(error))?;
    Ok((formula, parent))
}

/// Where sheet and files go.
pub(super) struct Places {
    sheet: Target,
    folder: PathBuf,
}

impl Places {
    pub(super) fn new(brood: &BroodArgs, default: &str) -> Result<Places, Failure> {
        let output = brood.output.clone().unwrap_or_else(|| PathBuf::from(format!("{default}.png")));
        let sheet = check_output(&output, Some("png"), Content::Bytes)?;
        refuse_both(&sheet, "the list of formulas")?;
        let folder = match &brood.files {
            Some(folder) => folder.clone(),
            None if sheet.is_stream() => {
                return Err(usage("a stream has no name that the folder of files could have", "say --files DIR"));
            }
            None => output.with_extension(""),
        };
        std::fs::create_dir_all(&folder).map_err(|error| {
            usage(format!("cannot make the folder {}: {error}", folder.display()), "choose another one with --files")
        })?;
        Ok(Places { sheet, folder })
    }
}

/// Finds formulas, writes them, and shows them on a sheet.
pub(super) fn raise(
    session: &mut Session,
    brood: &BroodArgs,
    (places, name): (&Places, &str),
    (formulas, parents): (&[Arc<Formula>], &[&Parent]),
    draw: impl Fn(u64) -> Result<Draft, bulbfold::engine::Error>,
    out: &mut dyn Write,
) -> Outcome {
    session.spare_inputs(&places.sheet)?;
    session.keeping_kernels();
    let request = Request { samples: SAMPLES, backend: brood.backend.choice(), ..brood.estimate.request(brood.size) };
    let judge = Judge::of(&session.engine, formulas, &request).map_err(|error| session.failed(error))?;
    let mut progress = session.progress();
    let count = brood.count as usize;
    let mut tell = |done: usize| progress.update(0.8 * done as f64 / count as f64);
    let found = search(&session.engine, (&judge, parents[0]), count, draw, &mut tell);
    let found = found.map_err(|error| session.failed(error))?;
    if found.survivors.is_empty() {
        return Err(none_left(session, found));
    }
    for (file, text) in parents.iter().flat_map(|parent| parent.steps()) {
        session.write(&places.folder.join(format!("{file}.rhai")), text.as_bytes())?;
    }
    let digits = found.survivors.len().to_string().len().max(2);
    let mut cells = Vec::new();
    for (i, survivor) in found.survivors.iter().enumerate() {
        let file = format!("{name}_{:0digits$}", i + 1);
        let path = places.folder.join(format!("{file}.ron"));
        let text = survivor.text().map_err(|error| session.failed(error))?;
        session.write(&path, text.as_bytes())?;
        let changes = &survivor.draft.changes;
        writeln!(out, "{}  hits {:.0} %  {}", path.display(), 100.0 * survivor.accepted.hits, changes.join("; "))?;
        let picture = Some(picture(session, &survivor.accepted.job)?);
        let notes = changes.iter().take(NOTES).cloned().collect();
        cells.push(Cell { picture, caption: file, notes, ..Cell::default() });
        progress.update(0.8 + 0.2 * (i + 1) as f64 / found.survivors.len() as f64);
    }
    progress.finish();
    let columns = columns_of(cells.len());
    contact::write(&places.sheet, cells, brood.size, columns, &format!("Formulas of {name}"))?;
    writeln!(out, "{} of {count} found, {}", found.survivors.len(), found.rejections())?;
    session.say(&places.sheet.path().display().to_string());
    Ok(())
}

/// The failure of a search that found nothing.
fn none_left(session: &Session, found: Found) -> Failure {
    let all = found.rejected.iter().sum::<usize>();
    match found.broken {
        Some(error) if found.rejected[0] == all => session.failed(error),
        _ => {
            let text = format!("no formula is left: {}", found.rejections());
            Failure::Work(message(&text, "try another --seed, or another --amount"))
        }
    }
}

/// The picture of a job.
pub(super) fn picture(session: &Session, job: &bulbfold::engine::Job) -> Result<Image, Failure> {
    let mut image = Image { size: job.size(), rgb: Vec::new() };
    let done = session.engine.render(job, job.rows(), &mut image, &mut ());
    done.map_err(|error| session.failed(error))?;
    Ok(image)
}
