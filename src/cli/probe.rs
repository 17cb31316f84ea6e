//! `bulbfold probe`: what a formula says at points and along rays, a line of text or JSON each, in input order.

use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;

use bulbfold::compose::{Choice, Composer, Plan, Purpose, choose, compose_estimator};
use bulbfold::engine::{Observer, Request, Settling, Work};
use bulbfold::expr::Arena;
use bulbfold::graph::{Method, ValidGraph};
use bulbfold::kernel::records::{Marched, Ray};
use bulbfold::kernel::template::Kept;
use bulbfold::kernel::{Backend, BackendError, Estimator, Kernel, inwards};
use bulbfold::march::{MarchSettings, compose_march};
use bulbfold::math::Precision;
use bulbfold::render::RenderSettings;
use clap::{ArgGroup, Args};
use serde_json::{Map, Value, json};

use super::arguments::{AutoArgs, BackendArg, FormulaArgs, parse_positive, parse_vector, precision_parser};
use super::points::read_rows;
use super::{Failure, Outcome, Session, usage};

/// Arguments of `probe`.
#[derive(Args, Debug)]
#[command(group = ArgGroup::new("input").required(true).args(["point", "points", "rays"]))]
#[command(after_help = "\
Examples:
  bulbfold probe mandelbulb --point 1.3,0,0 --point -0.5,0.2,1
  bulbfold probe mandelbox --points points.csv --precision f32 --json
  bulbfold probe mandelbulb --rays rays.csv --pixel-radius 0.0005 --de gradient

A point gives p, escaped, iterations, z, r and de (every method that applies); primitives alone p, inside and de.
A ray gives hit, t (null on a miss), estimates and iterations.
Numbers that are not finite are null.")]
pub struct Arguments {
    #[command(flatten)]
    formula: FormulaArgs,
    /// A point in world units; may be given several times
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse_vector)]
    point: Vec<[f64; 3]>,
    /// Points, a line `x,y,z` each
    #[arg(long, value_name = "FILE.csv", conflicts_with = "point")]
    points: Option<PathBuf>,
    /// Rays, a line `ox,oy,oz,dx,dy,dz` each; directions may have any length
    #[arg(long, value_name = "FILE.csv", conflicts_with_all = ["point", "points"])]
    rays: Option<PathBuf>,
    /// Direction of the ray through each point, for the methods that look along it [default: to the origin]
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, conflicts_with = "rays", value_parser = parse_vector)]
    direction: Option<[f64; 3]>,
    /// Write one JSON object a line instead of text
    #[arg(long)]
    json: bool,
    /// Precision [default: f64]
    #[arg(long, value_parser = precision_parser())]
    precision: Option<Precision>,
    /// Where to compute
    #[arg(long, value_enum, default_value_t = BackendArg::Auto)]
    backend: BackendArg,
    #[command(flatten)]
    estimate: AutoArgs,
    /// Hit threshold of rays in world units, the same at every distance
    #[arg(long, value_name = "E", conflicts_with = "pixel_radius", value_parser = parse_positive)]
    hit_eps: Option<f64>,
    /// Hit threshold of rays per unit of distance [default: 0.001]
    #[arg(long, value_name = "R", value_parser = parse_positive)]
    pixel_radius: Option<f64>,
}

/// Runs the command.
pub fn run(arguments: &Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    let request = Request {
        backend: arguments.backend.choice(),
        precision: arguments.precision,
        ..arguments.estimate.request(RenderSettings::default().size)
    };
    let precision = request.precision_or(Precision::F64).map_err(|error| session.failed(error))?;
    let graph = session.load(&arguments.formula.file, &arguments.formula.changes())?.graph;
    let arena = Arc::new(Arena::default());
    let probe = Probe { arguments, session, graph: &graph, arena: &arena, request: &request, precision };
    match &arguments.rays {
        Some(path) => {
            let rays = read_rows::<6>(path, "an origin and a direction: ox,oy,oz,dx,dy,dz")?;
            probe.rays(&rays, out)
        }
        None => {
            let points = match &arguments.points {
                Some(path) => read_rows::<3>(path, "a point: x,y,z")?,
                None => arguments.point.clone(),
            };
            probe.points(&points, out)
        }
    }
}

struct Probe<'a> {
    arguments: &'a Arguments,
    session: &'a Session,
    graph: &'a ValidGraph,
    arena: &'a Arc<Arena>,
    request: &'a Request,
    precision: Precision,
}

impl Probe<'_> {
    fn composer(&self) -> Composer<'_> {
        Composer { arena: self.arena, library: &self.session.library, graph: self.graph }
    }

    fn plan(&self) -> Result<Plan, Failure> {
        let plan = choose(&self.composer(), &self.arguments.estimate.estimate.settings());
        let plan = plan.map_err(|diagnostic| self.session.failure(diagnostic))?;
        for warning in &plan.warnings {
            self.session.warn(warning);
        }
        Ok(plan)
    }

    fn work<W: Work>(&self, work: &mut W) -> Result<W::Output, Failure> {
        let backends = self.session.engine.backends();
        let done = backends.run(self.request.backend, self.precision, work, &mut self.session.hushed());
        done.map(|(_, output)| output).map_err(|error| self.session.failed(error))
    }

    fn rays(&self, rays: &[[f64; 6]], out: &mut dyn Write) -> Outcome {
        let settling = Settling { library: &self.session.library, arena: self.arena, request: self.request };
        let calibration = settling
            .plan(self.graph)
            .and_then(|plan| settling.estimate(self.graph, plan, self.precision, &mut self.session.hushed()));
        let plan = calibration.map_err(|error| self.session.failed(error))?.plan;
        let plan = plan.in_precision(self.precision);
        let estimator = compose_estimator(&self.composer(), &plan.choices, Purpose::Estimate);
        let estimator = estimator.map_err(|diagnostic| self.session.failure(diagnostic))?;
        let default = if self.arguments.hit_eps.is_some() { 0.0 } else { 1e-3 };
        let pixel_radius = self.arguments.pixel_radius.unwrap_or(default);
        let settings = MarchSettings::of_plan(&plan, pixel_radius, self.precision);
        let settings = MarchSettings { hit_eps: self.arguments.hit_eps.unwrap_or(settings.hit_eps), ..settings };
        let kernel = Kernel::March(compose_march(self.arena, estimator, &settings));
        let columns = ray_columns(rays, plan.bounding_radius)?;
        let results = self.work(&mut KernelJob { arena: self.arena, kernel: &kernel, columns: &columns })?;
        for end in Marched::of(&results).rays() {
            let line = json!({
                "hit": end.depth().is_some(),
                "t": end.depth().map_or(Value::Null, Value::from),
                "estimates": end.steps as u64,
                "iterations": end.iterations as u64,
            });
            self.write_line(&line, out)?;
        }
        Ok(())
    }

    fn points(&self, points: &[[f64; 3]], out: &mut dyn Write) -> Outcome {
        let plan = self.plan()?;
        let smallest = self.precision.min_difference();
        let first_step = vec![(plan.bounding_radius * 1e-4).max(smallest); points.len()];
        let mut estimates: Vec<(&str, Vec<f64>)> = Vec::new();
        let mut orbits = None;
        for method in plan.applicable() {
            let answers = match method {
                // The step of finite differences follows from the estimate itself.
                _ if method.is_difference() => {
                    self.rounds(&plan, (method, points, &first_step), 2, |answers, steps| {
                        let length = |de: &f64| plan.difference_step.length(*de, smallest);
                        steps.iter_mut().zip(&answers[0]).for_each(|(step, de)| *step = length(de));
                    })?
                }
                _ if method.is_certified() => self.prove(&plan, method, points)?,
                _ => self.rounds(&plan, (method, points, &first_step), 1, |_, _| {})?,
            };
            let Some(last) = answers.into_iter().next_back() else { continue };
            estimates.push((method.name(), last[0].clone()));
            // The orbit itself is the same with every method.
            orbits.get_or_insert(last);
        }
        let Some(orbits) = orbits else {
            return Err(usage("no method applies to all orbits", "ask `explain` which apply to each"));
        };
        let width = self.state_width();
        for (i, p) in points.iter().enumerate() {
            let de: Map<String, Value> = estimates.iter().map(|(name, de)| (name.to_string(), de[i].into())).collect();
            if plan.choices.is_empty() {
                // Primitives are not iterated.
                self.write_line(&json!({ "p": p, "inside": orbits[1][i] > 0.5, "de": de }), out)?;
                continue;
            }
            let z: Vec<f64> = orbits[4..4 + width].iter().map(|column| column[i]).collect();
            let line = json!({
                "p": p, "escaped": orbits[1][i] < 0.5, "iterations": orbits[2][i] as u64, "z": z, "r": orbits[3][i], "de": de,
            });
            self.write_line(&line, out)?;
        }
        Ok(())
    }

    /// The largest proofs found: from far too much down to what holds, then up again in small steps.
    fn prove(&self, plan: &Plan, method: Method, points: &[[f64; 3]]) -> Result<Vec<Answers>, Failure> {
        const ROUNDS: usize = 6;
        let first = vec![plan.bounding_radius; points.len()];
        let rounds = self.rounds(plan, (method, points, &first), ROUNDS, |answers, steps| {
            for (step, proven) in steps.iter_mut().zip(&answers[0]) {
                *step = if *proven > 0.0 { (proven * 1.5).min(*step) } else { *step * 0.25 };
            }
        })?;
        let best = rounds.into_iter().reduce(|mut best, answers| {
            best[0].iter_mut().zip(&answers[0]).for_each(|(a, b)| *a = a.max(*b));
            best
        });
        Ok(best.into_iter().collect())
    }

    /// Writes an answer as JSON or as text.
    fn write_line(&self, line: &Value, out: &mut dyn Write) -> Outcome {
        match (self.arguments.json, line) {
            (false, Value::Object(fields)) => {
                let fields: Vec<String> =
                    fields.iter().map(|(name, value)| format!("{name} {}", as_text(value))).collect();
                writeln!(out, "{}", fields.join("  "))?;
            }
            _ => writeln!(out, "{line}")?,
        }
        Ok(())
    }

    /// Components of the state of the first orbit.
    fn state_width(&self) -> usize {
        let orbits = bulbfold::compose::field_orbits(&self.composer());
        orbits.first().map_or(3, |orbit| self.graph.state_width(orbit.root, &orbit.settings) as usize)
    }

    /// Columns `de, inside, n, r, z` of a method at all points, once for each round: between two rounds `next` makes the
    /// steps of the later one from the answers of the earlier one.
    fn rounds(
        &self,
        plan: &Plan,
        (method, points, steps): (Method, &[[f64; 3]], &[f64]),
        count: usize,
        next: impl Fn(&Answers, &mut [f64]),
    ) -> Result<Vec<Answers>, Failure> {
        let choices: Vec<Choice> = plan.choices.iter().map(|c| Choice { method, ..c.clone() }).collect();
        let estimator = compose_estimator(&self.composer(), &choices, Purpose::Probe);
        let kernel = Kernel::Estimate(estimator.map_err(|diagnostic| self.session.failure(diagnostic))?);
        let direction = |p: &[f64; 3]| self.arguments.direction.map_or_else(|| inwards(p), |d| inwards(&d.map(|x| -x)));
        let directions: Vec<[f64; 3]> = points.iter().map(direction).collect();
        let columns = |steps: &[f64]| Estimator::columns(points, &directions, steps, 0.0);
        self.work(&mut Rounds { arena: self.arena, kernel: &kernel, columns, steps, count, next })
    }
}

/// Columns of results.
type Answers = Vec<Vec<f64>>;

/// Runs one kernel several times; the steps of a run follow from the run before.
struct Rounds<'a, C, N> {
    arena: &'a Arena,
    kernel: &'a Kernel,
    /// The inputs with these steps.
    columns: C,
    /// The steps of the first run.
    steps: &'a [f64],
    count: usize,
    next: N,
}

impl<C: Fn(&[f64]) -> Answers, N: Fn(&Answers, &mut [f64])> Work for Rounds<'_, C, N> {
    type Output = Vec<Answers>;

    fn run<B: Backend>(
        &mut self,
        backend: &B,
        _: &mut Kept<B>,
        _: &mut dyn Observer,
    ) -> Result<Vec<Answers>, BackendError> {
        let prepared = backend.prepare(self.arena, self.kernel)?;
        let (mut steps, mut rounds) = (self.steps.to_vec(), Vec::new());
        for _ in 0..self.count {
            let columns = backend.upload(&(self.columns)(&steps))?;
            let answers = backend.download(&backend.run(&prepared, &[&columns])?)?;
            (self.next)(&answers, &mut steps);
            rounds.push(answers);
        }
        Ok(rounds)
    }
}

/// Origin, unit direction and the range inside the bounding sphere, by column. Rays that miss the sphere have an empty
/// range.
fn ray_columns(rays: &[[f64; 6]], radius: f64) -> Result<Vec<Vec<f64>>, Failure> {
    use glam::DVec3;
    let mut columns = vec![Vec::new(); Ray::WIDTH];
    for (i, ray) in rays.iter().enumerate() {
        let origin = DVec3::new(ray[0], ray[1], ray[2]);
        let given = DVec3::new(ray[3], ray[4], ray[5]);
        let Some(direction) = given.try_normalize() else {
            return Err(usage(
                format!("ray {} has the direction {given}", i + 1),
                "a direction is any vector but 0,0,0",
            ));
        };
        let middle = -origin.dot(direction);
        let half_sq = radius * radius - (origin + direction * middle).length_squared();
        let half = half_sq.max(0.0).sqrt();
        let near = (middle - half).max(0.0);
        let far = if half_sq < 0.0 { Ray::NOWHERE } else { middle + half };
        let values = origin.to_array().into_iter().chain(direction.to_array()).chain([near, far]);
        for (column, value) in columns.iter_mut().zip(values) {
            column.push(value);
        }
    }
    Ok(columns)
}

/// Runs one kernel on columns.
pub struct KernelJob<'a> {
    /// Where its nodes are.
    pub arena: &'a Arena,
    /// What runs.
    pub kernel: &'a Kernel,
    /// Its inputs.
    pub columns: &'a [Vec<f64>],
}

impl Work for KernelJob<'_> {
    type Output = Vec<Vec<f64>>;

    fn run<B: Backend>(
        &mut self,
        backend: &B,
        _: &mut Kept<B>,
        _: &mut dyn Observer,
    ) -> Result<Vec<Vec<f64>>, BackendError> {
        let prepared = backend.prepare(self.arena, self.kernel)?;
        let columns = backend.upload(self.columns)?;
        backend.download(&backend.run(&prepared, &[&columns])?)
    }
}

/// An answer's value for people: vectors in brackets, numbers to six digits.
fn as_text(value: &Value) -> String {
    match value {
        Value::Number(number) => match (number.as_u64(), number.as_f64()) {
            (Some(whole), _) => whole.to_string(),
            (_, Some(x)) if x != 0.0 && !(1e-4..1e7).contains(&x.abs()) => format!("{x:.5e}"),
            (_, x) => format!("{:.6}", x.unwrap_or(f64::NAN)),
        },
        Value::Array(items) => format!("({})", items.iter().map(as_text).collect::<Vec<_>>().join(", ")),
        Value::Object(fields) => {
            let fields: Vec<String> = fields.iter().map(|(name, value)| format!("{name} {}", as_text(value))).collect();
            format!("({})", fields.join(", "))
        }
        Value::Null => "none".into(),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::ray_columns;

    #[test]
    fn rays_are_clipped_to_the_sphere() {
        let rays = [[-4.0, 0.0, 0.0, 2.0, 0.0, 0.0], [0.0, 0.5, 0.0, 0.0, 1.0, 0.0], [0.0, 9.0, 0.0, 1.0, 0.0, 0.0]];
        let columns = ray_columns(&rays, 1.0).expect("no direction is zero");
        assert_eq!((columns[3][0], columns[6][0], columns[7][0]), (1.0, 3.0, 5.0));
        assert_eq!((columns[6][1], columns[7][1]), (0.0, 0.5));
        assert_eq!(columns[7][2], -1.0);
        assert!(ray_columns(&[[0.0; 6]], 1.0).is_err());
    }
}
