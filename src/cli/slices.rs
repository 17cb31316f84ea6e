//! `bulbfold slices`: a fractal's body as a volume of numbers.

use std::io::Write;
use std::path::{Path, PathBuf};

use bulbfold::engine::{Observer, Work};
use bulbfold::files::Target;
use bulbfold::kernel::template::Kept;
use bulbfold::kernel::{Backend, BackendError};
use bulbfold::mesh::format::Format;
use bulbfold::mesh::volume::{Place, Values, memory, volume};
use bulbfold::mesh::{Grid, Progress, Trouble, survey};
use clap::{Args, ValueEnum};

use super::arguments::parse_positive;
use super::output::{Content, check_output};
use super::solid::{Solid, SolidArgs, bytes, failure, passed};
use super::{Failure, Outcome, Session, usage, vdb};

/// Arguments of `slices`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold slices mandelbulb --resolution 200 -o slices/
  bulbfold slices menger_cross --values distance -o sponge.npy
  bulbfold slices mandelbox --resolution 400 -o box.vdb

A folder gets a PNG a slice, the lowest first, white inside. A .npy is an array of shape (z, y, x), a .raw its numbers alone.
A .vdb holds signed distances for Blender and Houdini, by Python's openvdb (Debian: python3-openvdb).")]
pub struct Arguments {
    #[command(flatten)]
    solid: SolidArgs,
    /// The folder or file to write: FOLDER/, .npy, .raw or .vdb
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// What is said of each point [default: inside; distance in .vdb]
    #[arg(long, value_enum, value_name = "VALUES")]
    values: Option<ValuesArg>,
    /// Memory that it may take, in GiB
    #[arg(long, value_name = "GIB", default_value = "2", value_parser = parse_positive)]
    memory: f64,
    /// The Python that knows openvdb
    #[arg(long, value_name = "PROGRAM", default_value = "python3")]
    python: PathBuf,
}

/// What is said of a point.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
enum ValuesArg {
    /// A byte: 255 inside, 0 outside.
    Inside,
    /// A float: the distance from the surface in units of the world, negative inside.
    Distance,
}

/// What is written.
enum Kind {
    Slices(PathBuf),
    Raw(Target),
    Npy(Target),
    Vdb(Target),
}

impl Kind {
    fn of(path: &Path) -> Result<Kind, Failure> {
        let target = |ending: &str| check_output(path, Some(ending), Content::Bytes);
        match path.extension().and_then(|ending| ending.to_str()) {
            Some("raw") => Ok(Kind::Raw(target("raw")?)),
            Some("npy") => Ok(Kind::Npy(target("npy")?)),
            Some("vdb") => Ok(Kind::Vdb(target("vdb")?)),
            None if path.as_os_str() != "-" && (path.is_dir() || !path.exists()) => {
                Ok(Kind::Slices(path.to_path_buf()))
            }
            _ => {
                let text = format!("{} is neither a folder nor a file of a known ending", path.display());
                Err(usage(text, "write a folder such as slices/, or a file that ends in .npy, .raw or .vdb"))
            }
        }
    }

    /// What is said of points.
    fn values(&self, wanted: Option<ValuesArg>) -> Result<Values, Failure> {
        match (self, wanted) {
            (Kind::Slices(_), Some(ValuesArg::Distance)) => {
                Err(usage("pictures of slices show what is inside", "write distances into a .npy, .raw or .vdb"))
            }
            (Kind::Vdb(_), Some(ValuesArg::Inside)) => {
                Err(usage("a .vdb holds distances", "drop `--values inside`, or write a .npy"))
            }
            (Kind::Vdb(_), _) | (_, Some(ValuesArg::Distance)) => Ok(Values::Distance),
            _ => Ok(Values::Inside),
        }
    }
}

/// Runs the command.
pub fn run(arguments: &Arguments, session: &mut Session, _: &mut dyn Write) -> Outcome {
    let kind = Kind::of(&arguments.output)?;
    let values = kind.values(arguments.values)?;
    if matches!(kind, Kind::Vdb(_)) {
        vdb::check(&arguments.python)?;
    }
    let solid = arguments.solid.solid(session, "a volume")?;
    state(arguments, session, &solid.grid, values)?;
    let mut making = Making { arguments, solid: &solid, kind: &kind, values };
    match &kind {
        Kind::Vdb(target) | Kind::Raw(target) | Kind::Npy(target) => session.spare_inputs(target)?,
        Kind::Slices(folder) => {
            std::fs::create_dir_all(folder).map_err(|error| super::output::cannot_write(folder, &error))?
        }
    }
    let mut watch = session.watch();
    let backend = arguments.solid.backend.choice();
    let done = session.engine.backends().run(backend, solid.precision, &mut making, &mut watch);
    drop(watch);
    done.map_err(|error| session.failed(error))?.1.map_err(|trouble| failure(trouble, &arguments.output))
}

/// Says what it will take, and refuses what is more than it may.
fn state(arguments: &Arguments, session: &Session, grid: &Grid, values: Values) -> Outcome {
    let needed = memory(grid, values) as f64;
    let most = arguments.memory * 1024f64.powi(3);
    if needed > most {
        let text = format!("it needs {} of memory, and may take {}", bytes(needed), bytes(most));
        return Err(usage(text, "allow more, such as `--memory 8`, or take a smaller --resolution or --region"));
    }
    let [x, y, z] = grid.points;
    let each = if values == Values::Distance { 4.0 } else { 1.0 };
    let size = bytes(f64::from(x) * f64::from(y) * f64::from(z) * each);
    let needed = bytes(needed);
    session.say(&format!("{x} x {y} x {z} points, {:.3e} apart: {size} of numbers, {needed} of memory", grid.cell));
    session.say(&format!("the first point is at {}", grid.origin.map(|x| format!("{x:.6}")).join(",")));
    Ok(())
}

/// A volume in the making.
struct Making<'a> {
    arguments: &'a Arguments,
    solid: &'a Solid,
    kind: &'a Kind,
    values: Values,
}

impl Work for Making<'_> {
    type Output = Result<(), Trouble>;

    fn run<B: Backend>(
        &mut self,
        backend: &B,
        _: &mut Kept<B>,
        observer: &mut dyn Observer,
    ) -> Result<Self::Output, BackendError> {
        passed(self.made(backend, observer))
    }
}

impl Making<'_> {
    fn made<B: Backend>(&self, backend: &B, observer: &mut dyn Observer) -> Result<(), Trouble> {
        let (grid, bodies) = (&self.solid.grid, (&self.solid.kernels, backend));
        let mut nobody = ();
        let wanted = (Format::Stl, false, 1.0);
        let found = survey(grid, self.arguments.solid.thicken, bodies, wanted, &mut Progress::new(&mut nobody, 1.0))?;
        if found.is_thin {
            observer.note(&format!(
                "the set is thin: the body is all that is within {} cells of it (--thicken)",
                found.thickness
            ));
        }
        let mut progress = Progress::new(observer, found.forecast.points);
        match self.kind {
            Kind::Slices(folder) => {
                volume(grid, found.thickness, bodies, (self.values, Place::Slices(folder)), &mut progress)
            }
            Kind::Raw(target) => {
                volume(grid, found.thickness, bodies, (self.values, Place::Raw(target)), &mut progress)
            }
            Kind::Npy(target) => {
                volume(grid, found.thickness, bodies, (self.values, Place::Npy(target)), &mut progress)
            }
            Kind::Vdb(target) => {
                let mut pipe = vdb::Pipe::new(&self.arguments.python, grid, &self.solid.name)?;
                volume(grid, found.thickness, bodies, (self.values, Place::Into(&mut pipe)), &mut progress)?;
                Ok(target.write(&pipe.finish()?)?)
            }
        }
    }
}
