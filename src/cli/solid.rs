//! What meshes and volumes share: arguments that place a grid over a body, and the body's kernels.

use std::sync::Arc;

use bulbfold::compose::{Bounds, Composer, Plan, Reach, Sides};
use bulbfold::diag::printable;
use bulbfold::engine::{Error, Request, Settling};
use bulbfold::expr::Arena;
use bulbfold::graph::{EstimateSettings, ValidGraph};
use bulbfold::kernel::BackendError;
use bulbfold::math::Precision;
use bulbfold::mesh::{CELLS, Grid, Kernels, Trouble};
use clap::Args;

use super::arguments::{BackendArg, EstimateArgs, FormulaArgs, parse_number, precision_parser};
use super::{Failure, Session, message, usage};

/// The body and the grid over it.
#[derive(Args, Debug)]
pub struct SolidArgs {
    #[command(flatten)]
    pub formula: FormulaArgs,
    /// Cells along the longest edge of the region, from 4 to 4096
    #[arg(short, long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u32).range(i64::from(*CELLS.start())..=i64::from(*CELLS.end())))]
    pub resolution: u32,
    /// The box to look at, by its least and its largest coordinates [default: what is proven to hold the set]
    #[arg(long, value_name = "X,Y,Z,X,Y,Z", allow_hyphen_values = true, value_parser = parse_region)]
    region: Option<[f64; 6]>,
    /// Make a body of all that is within so many cells of the set, from 0 to 8 [default: 0; 0.5 where the set is thin]
    #[arg(long, value_name = "CELLS", value_parser = parse_thickness)]
    pub thicken: Option<f64>,
    /// Where to compute
    #[arg(long, value_enum, default_value_t = BackendArg::Cpu)]
    pub backend: BackendArg,
    /// Precision [default: f32 where cells are coarse enough for it]
    #[arg(long, value_parser = precision_parser())]
    precision: Option<Precision>,
    #[command(flatten)]
    estimate: EstimateArgs,
}

fn parse_region(text: &str) -> Result<[f64; 6], String> {
    let numbers = text.split(',').map(parse_number).collect::<Result<Vec<f64>, String>>()?;
    let region = <[f64; 6]>::try_from(numbers);
    let region = region.map_err(|_| "write six numbers such as -1,-1,-1,1,1,1".to_string())?;
    if (0..3).all(|k| region[k] < region[k + 3]) { Ok(region) } else { Err("each edge must be longer than 0".into()) }
}

fn parse_thickness(text: &str) -> Result<f64, String> {
    let cells = parse_number(text)?;
    if (0.0..=8.0).contains(&cells) { Ok(cells) } else { Err("it must be from 0 to 8".into()) }
}

/// A body that is ready to be asked.
pub struct Solid {
    /// Its kernels.
    pub kernels: Kernels,
    /// The points.
    pub grid: Grid,
    /// What it is computed in.
    pub precision: Precision,
    /// Its name.
    pub name: String,
}

/// Least numbers of single precision that a cell has to span.
const ULPS: f64 = 256.0;

impl SolidArgs {
    /// Loads the formula and composes its kernels.
    pub fn solid(&self, session: &mut Session, what: &str) -> Result<Solid, Failure> {
        let graph = session.load(&self.formula.file, &self.formula.changes())?.graph;
        if graph.scene.plane.is_some() {
            return Err(usage(
                format!("{what} is of a body, and `{}` is a formula of a plane", graph.name),
                "`bulbfold render` draws it; take a formula of space, such as mandelbulb",
            ));
        }
        let arena = Arc::new(Arena::default());
        let request = Request {
            estimate: self.estimate.settings(),
            backend: self.backend.choice(),
            precision: self.precision,
            ..Request::default()
        };
        let settling = Settling { library: &session.library, arena: &arena, request: &request };
        let (graph, plan) = planned(&settling, graph).map_err(|error| session.failed(error))?;
        plan.warnings.iter().for_each(|warning| session.warn(warning));
        let composer = Composer { arena: &arena, library: &session.library, graph: &graph };
        let grid = self.grid(self.region(&composer, &plan, session)?)?;
        let precision = self.precision(&request, &grid).map_err(|error| session.failed(error))?;
        let radius = if plan.reach == Reach::Endless { f64::INFINITY } else { plan.bounding_radius };
        let kernels = Kernels::new(&composer, &plan, radius, precision).map_err(|message| session.failure(message))?;
        Ok(Solid { kernels, grid, precision, name: printable(&graph.name).to_string() })
    }

    /// The box that is asked for, else the one that is proven to hold the set.
    fn region(&self, composer: &Composer, plan: &Plan, session: &Session) -> Result<Sides, Failure> {
        if let Some([a, b, c, d, e, f]) = self.region {
            return Ok(Sides { low: [a, b, c], high: [d, e, f] });
        }
        if plan.reach == Reach::Endless {
            return Err(usage(
                format!("`{}` has no end, and a grid has", composer.graph.name),
                "name a box: --region X,Y,Z,X,Y,Z, by its least and its largest coordinates",
            ));
        }
        let bounds = Bounds::prove(composer, plan).map_err(|message| session.failure(message))?;
        let radius = bounds.radius;
        Ok(bounds.sides.unwrap_or(Sides { low: [-radius; 3], high: [radius; 3] }))
    }

    /// The grid; a region that follows from the set has room for what is thickened.
    fn grid(&self, region: Sides) -> Result<Grid, Failure> {
        let grid = Grid::new(region, self.resolution);
        let wider = self.thicken.unwrap_or(0.5) * grid.cell;
        let grid = match self.region {
            Some(_) => grid,
            None => Grid::new(
                Sides { low: region.low.map(|x| x - wider), high: region.high.map(|x| x + wider) },
                self.resolution,
            ),
        };
        let far = grid.region.low.iter().chain(&grid.region.high).fold(0.0f64, |far, x| far.max(x.abs()));
        // Vertices lie 64ths of a cell apart, and files have single precision.
        if grid.cell / 64.0 < far * f64::from(f32::EPSILON) {
            return Err(usage(
                "cells are too small for the single precision of files, so far from the origin",
                "take a smaller --resolution or a larger --region",
            ));
        }
        Ok(grid)
    }

    /// What is computed in.
    fn precision(&self, request: &Request, grid: &Grid) -> Result<Precision, Error> {
        let far = grid.region.low.iter().chain(&grid.region.high).fold(0.0f64, |far, x| far.max(x.abs()));
        let is_coarse = grid.cell > ULPS * far * f64::from(f32::EPSILON);
        request.precision_or(if is_coarse { Precision::F32 } else { Precision::F64 })
    }
}

/// The graph with the iterations of its own view, and a plan that is no proof: calibrated proofs are for rays. Points have proofs of balls
/// besides.
fn planned(settling: &Settling, graph: ValidGraph) -> Result<(ValidGraph, Plan), Error> {
    let graph = settling.seen(graph)?;
    let plan = settling.plan(&graph)?;
    if !plan.is_certified() {
        return Ok((graph, plan));
    }
    let graph = graph.without_calibration();
    let estimate = EstimateSettings { method: None, ..settling.request.estimate };
    let request = Request { estimate, ..settling.request.clone() };
    let plan = Settling { request: &request, ..*settling }.plan(&graph)?;
    Ok((graph, plan))
}

/// The result of work on a back end whose own failures are passed on, so that another one may take over.
pub fn passed<T>(done: Result<T, Trouble>) -> Result<Result<T, Trouble>, BackendError> {
    match done {
        Err(Trouble::Backend(error)) => Err(error),
        done => Ok(done),
    }
}

/// The failure of a mesh or volume that could not be made.
pub fn failure(trouble: Trouble, path: &std::path::Path) -> Failure {
    match trouble {
        Trouble::Backend(error) => Failure::Work(message(&error.to_string(), "")),
        Trouble::Write(error) => super::output::cannot_write(path, &error),
        Trouble::Refused { text, help } => usage(text, &help),
        Trouble::Cancelled => Failure::Work(message("the work was cancelled", "")),
    }
}

/// A count as people say it.
pub fn count(number: f64) -> String {
    match number {
        _ if number >= 1e9 => format!("{:.1} billion", number / 1e9),
        _ if number >= 1e6 => format!("{:.1} million", number / 1e6),
        _ if number >= 1e4 => format!("{:.0} thousand", number / 1e3),
        _ => format!("{number:.0}"),
    }
}

/// Bytes as people say them.
pub fn bytes(number: f64) -> String {
    const UNITS: [&str; 4] = ["KiB", "MiB", "GiB", "TiB"];
    let power = (number.max(1.0).log2() / 10.0).floor().clamp(1.0, 4.0);
    let value = number / 1024f64.powf(power);
    let unit = UNITS[power as usize - 1];
    if value < 10.0 { format!("{value:.1} {unit}") } else { format!("{value:.0} {unit}") }
}
