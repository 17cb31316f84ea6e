//! `bulbfold mesh`: a fractal's surface as triangles.

use std::io::Write;
use std::path::PathBuf;

use bulbfold::engine::{Observer, Work};
use bulbfold::files::Target;
use bulbfold::kernel::template::Kept;
use bulbfold::kernel::{Backend, BackendError};
use bulbfold::mesh::format::Format;
use bulbfold::mesh::{Made, Order, Progress, Report, Survey, Trouble, make, survey};
use clap::Args;

use super::arguments::parse_positive;
use super::output::{Content, check_output, refuse_both, write_or_print};
use super::progress::short;
use super::solid::{Solid, SolidArgs, bytes, count, failure, passed};
use super::{Failure, Outcome, Session, message, usage};

/// Arguments of `mesh`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold mesh mandelbulb -o bulb.ply
  bulbfold mesh menger_cross --resolution 512 --scale 80mm -o sponge.3mf --report sponge.json
  bulbfold mesh julia_set --region -1,-1,0,1,1,1 -o half.glb

The ending says what is written: ply, obj, stl, glb or 3mf. What it will take is said before it starts.")]
pub struct Arguments {
    #[command(flatten)]
    solid: SolidArgs,
    /// The file to write
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Length of the mesh's longest edge, such as 80mm or 12cm: lengths are millimetres then, around the origin [default: the world's units]
    #[arg(long, value_name = "LENGTH", value_parser = parse_length)]
    scale: Option<f64>,
    /// Share of the triangles to keep, above 0 and at most 1: the mesh is held in memory then
    #[arg(long, value_name = "SHARE", default_value = "1", value_parser = parse_share)]
    simplify: f64,
    /// Make the body hollow, with a wall as thick as that; there is no hole to let resin out
    #[arg(long, value_name = "LENGTH", requires = "scale", value_parser = parse_length)]
    hollow: Option<f64>,
    /// Write what is known of the mesh as JSON, with what printers ask: walls, islands, overhangs; - is stdout
    #[arg(long, value_name = "FILE.json")]
    report: Option<PathBuf>,
    /// Memory that it may take, in GiB
    #[arg(long, value_name = "GIB", default_value = "2", value_parser = parse_positive)]
    memory: f64,
}

fn parse_share(text: &str) -> Result<f64, String> {
    let share = parse_positive(text)?;
    if share <= 1.0 { Ok(share) } else { Err("it must be above 0 and at most 1".into()) }
}

/// Reads a length in millimetres.
fn parse_length(text: &str) -> Result<f64, String> {
    let text = text.trim();
    let (number, factor) = match (text.strip_suffix("mm"), text.strip_suffix("cm"), text.strip_suffix('m')) {
        (Some(number), ..) => (number, 1.0),
        (_, Some(number), _) => (number, 10.0),
        (.., Some(number)) => (number, 1000.0),
        _ => return Err("write a length such as 80mm, 12cm or 0.1m".into()),
    };
    let length = parse_positive(number)? * factor;
    if (1e-3..=1e6).contains(&length) { Ok(length) } else { Err("it must be from 0.001mm to 1000m".into()) }
}

/// Runs the command.
pub fn run(arguments: &Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    let Some(format) = Format::of(&arguments.output) else {
        let endings = Format::ALL.map(Format::ending).join(", .");
        let text = format!("the ending of {} says no format", arguments.output.display());
        return Err(usage(text, &format!("write a file that ends in .{endings}")));
    };
    let output = check_output(&arguments.output, Some(format.ending()), Content::Bytes)?;
    let report = arguments.report.as_ref().map(|path| check_output(path, None, Content::Text)).transpose()?;
    if report.is_some() {
        refuse_both(&output, "--report")?;
    }
    let solid = arguments.solid.solid(session, "a mesh")?;
    session.spare_inputs(&output)?;
    report.iter().try_for_each(|report| session.spare_inputs(report))?;
    let order = Order {
        name: solid.name.clone(),
        grid: solid.grid,
        thickness: 0.0,
        longest_mm: arguments.scale,
        wall_mm: arguments.hollow,
        share: arguments.simplify,
        format,
        printability: report.is_some(),
    };
    let mut making = Making { arguments, solid: &solid, order, target: &output };
    let mut watch = session.watch();
    let backend = arguments.solid.backend.choice();
    let done = session.engine.backends().run(backend, solid.precision, &mut making, &mut watch);
    drop(watch);
    let made = done.map_err(|error| session.failed(error))?.1.map_err(|trouble| failure(trouble, &arguments.output))?;
    if let Some(target) = report {
        let text = serde_json::to_string_pretty(&made.report)
            .map_err(|error| Failure::Work(message(&error.to_string(), "")))?;
        write_or_print(Some(&target).filter(|target| !target.is_stdout()), format!("{text}\n").as_bytes(), out)?;
    }
    told(arguments, &made).iter().for_each(|line| session.say(line));
    Ok(())
}

/// A mesh in the making.
struct Making<'a> {
    arguments: &'a Arguments,
    solid: &'a Solid,
    order: Order,
    target: &'a Target,
}

impl Work for Making<'_> {
    type Output = Result<Made, Trouble>;

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
    fn made<B: Backend>(&mut self, backend: &B, observer: &mut dyn Observer) -> Result<Made, Trouble> {
        let (arguments, kernels) = (self.arguments, &self.solid.kernels);
        let wanted = (self.order.format, self.order.printability, self.order.share);
        let mut nobody = ();
        let mut unseen = Progress::new(&mut nobody, 1.0);
        let found = survey(&self.order.grid, arguments.solid.thicken, (kernels, backend), wanted, &mut unseen)?;
        self.order.thickness = found.thickness;
        self.state(&found, observer);
        let most = arguments.memory * 1024f64.powi(3);
        if found.forecast.memory > most {
            return Err(Trouble::Refused {
                text: format!("it needs {} of memory, and may take {}", bytes(found.forecast.memory), bytes(most)),
                help: "allow more, such as `--memory 8`, or take a smaller --resolution or --region".into(),
            });
        }
        make(&self.order, (kernels, backend), self.target, &mut Progress::new(observer, found.forecast.points))
    }

    /// Says what it will be like, before it starts.
    fn state(&self, found: &Survey, observer: &mut dyn Observer) {
        let (grid, forecast) = (&self.order.grid, &found.forecast);
        if found.is_thin {
            let what = format!(
                "the set is thin: the mesh is of all that is within {} cells of it, by the estimate",
                found.thickness
            );
            observer.note(&format!("{what} (--thicken)"));
        }
        let how = match self.solid.kernels.prove() {
            true => "proofs, and near the surface the estimate with a margin",
            false => "the estimate with a margin, since there are no proofs",
        };
        observer.note(&format!("what is empty is found by {how}"));
        observer.note(&format!(
            "{} cells of {:.3e}: about {} triangles, a file of {}, {} of memory, {}",
            self.arguments.solid.resolution,
            grid.cell,
            count(forecast.triangles),
            bytes(forecast.file),
            bytes(forecast.memory),
            short(forecast.time)
        ));
    }
}

/// What is told of a mesh in the end.
fn told(arguments: &Arguments, made: &Made) -> Vec<String> {
    let Report { vertices, triangles, area, volume, low, high, .. } = &made.report;
    let unit = if arguments.scale.is_some() { " mm" } else { "" };
    let size = [0, 1, 2].map(|k| format!("{:.4}", high[k] - low[k])).join(" x ");
    let mut lines = vec![
        format!("{}: {vertices} vertices, {triangles} triangles", arguments.output.display()),
        format!("size {size}{unit}, area {area:.6}, volume {volume:.6}"),
        format!(
            "of the grid {:.1} % proven empty, {:.1} % empty by the estimate, {:.1} % opened",
            100.0 * made.report.proven_empty,
            100.0 * made.report.estimated_empty,
            100.0 * made.report.opened
        ),
    ];
    if arguments.hollow.is_some() && !made.is_hollow {
        lines.push("it is nowhere thick enough to be hollow".to_string());
    }
    if let Some(printed) = &made.report.printability {
        let wall = |wall: Option<f64>| wall.map_or("over 64 cells".to_string(), |wall| format!("{wall:.4}{unit}"));
        let (thinnest, thin) = (wall(printed.thinnest_wall), wall(printed.thin_wall));
        lines.push(format!("{} islands; walls: thinnest {thinnest}, one in a hundred below {thin}", printed.islands));
        lines.push(format!("{:.1} % of the area hangs over by more than 45 degrees", 100.0 * printed.overhang));
    }
    lines
}
