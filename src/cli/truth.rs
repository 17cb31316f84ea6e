//! `bulbfold truth`: where rays really meet the set, by brute force, and how the march of an estimate compares.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use bulbfold::calibrate::Budget;
use bulbfold::check::exact::Limit;
use bulbfold::check::truth::{End, Judgement, Ray, Scale, Truth, Truths, candidate, march_rays, view_rays};
use bulbfold::compose::{Composer, Plan};
use bulbfold::engine::{Observer, Request, Settling, Work};
use bulbfold::expr::Arena;
use bulbfold::graph::ValidGraph;
use bulbfold::kernel::template::Kept;
use bulbfold::kernel::{Backend, BackendError, Kernel};
use bulbfold::march::MarchSettings;
use bulbfold::math::Precision;
use bulbfold::render::camera_of;
use bulbfold::shade::Size;
use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use super::arguments::{AutoArgs, BackendArg, ChangeArgs, precision_parser};
use super::points::read_rows;
use super::progress::{Progress, short};
use super::session::formula_files;
use super::sizes::parse_size;
use super::{Failure, Outcome, Session, truth_table, usage};

/// Version of what `--json` writes.
const JSON_VERSION: u32 = 1;
/// Distance at which a ray counts as meeting a limit set that is known.
const EXACT_EPS: f64 = 1e-6;

/// Arguments of `truth`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold truth mandelbulb
  bulbfold truth my_hybrid.ron --rays 1000 --size 640x360 --de scalar --fudge 0.8
  bulbfold truth menger --rays-file rays.csv --json > truth.jsonl
  bulbfold truth formulas/fractals --rays 2000 --markdown > table.md

Brute force walks the rays in f64, by steps of a quarter of a pixel or less, and only tests membership.
Then the rays are marched with the estimate, and both answers are compared. A hit is missed if the march
passes it. A stop is early if it is in front of the truth by more than 0.5 % of the bounding radius.

Several formulas, or --markdown, give a table with a line for each. The exit code is 1 if one of them
breaks the error budget, or if no ray of a view hits anything.")]
pub struct Arguments {
    /// Formula files (.ron), folders of them, graph scripts (.rhai) or names of built-in fractals
    #[arg(required = true, value_name = "FILE")]
    pub(super) files: Vec<PathBuf>,
    #[command(flatten)]
    changes: ChangeArgs,
    /// Random rays through the picture
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub(super) rays: u32,
    /// Rays to take instead, a line `ox,oy,oz,dx,dy,dz` each; directions may have any length
    #[arg(long, value_name = "FILE.csv", conflicts_with_all = ["rays", "seed"])]
    rays_file: Option<PathBuf>,
    /// Size of the picture, which sets how fine a pixel is
    #[arg(long, value_name = "WxH", default_value = "320x240", value_parser = parse_size)]
    pub(super) size: Size,
    /// Which random rays
    #[arg(long, value_name = "N", default_value_t = 4)]
    seed: u64,
    /// Write JSON lines, one for each ray and one for the summary; of several formulas the summaries alone
    #[arg(long)]
    pub(super) json: bool,
    /// Print the table as Markdown
    #[arg(long, conflicts_with = "json")]
    pub(super) markdown: bool,
    /// Whether orbits of the truth end where a pixel shows nothing of what they would still do; `never` runs them to the
    /// iteration limit, and shares nothing with the march
    #[arg(long, value_enum, default_value_t = TruthEnds::Measured)]
    truth_ends: TruthEnds,
    #[command(flatten)]
    pub(super) estimate: AutoArgs,
    /// Precision of the compared march [default: f64]
    #[arg(long, value_parser = precision_parser())]
    precision: Option<Precision>,
    /// Where the compared march runs
    #[arg(long, value_enum, default_value_t = BackendArg::Auto)]
    backend: BackendArg,
}

/// Whether the truth's orbits end at the footprint.
#[derive(ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
enum TruthEnds {
    /// Where members were found within the threshold wherever orbits end that early
    Measured,
    /// Nowhere: members alone count
    Never,
}

/// Runs the command.
pub fn run(arguments: &Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    let files = formula_files(&arguments.files)?;
    if files.len() > 1 || arguments.markdown {
        return truth_table::run(arguments, &files, session, out);
    }
    let measured = measure(arguments, session, &files[0])?;
    match arguments.json {
        true => measured.json(out)?,
        false => measured.text(out)?,
    }
    match measured.complaint(&arguments.estimate.error_budget) {
        None => Ok(()),
        Some(why) => Err(truth_table::broken(&format!("{}: {why}", files[0].display()))),
    }
}

/// Walks and marches the rays of one formula.
pub(super) fn measure(arguments: &Arguments, session: &mut Session, file: &Path) -> Result<Measured, Failure> {
    let request = Request {
        backend: arguments.backend.choice(),
        precision: arguments.precision,
        ..arguments.estimate.request(arguments.size)
    };
    let precision = request.precision_or(Precision::F64).map_err(|error| session.failed(error))?;
    let given = arguments.rays_file.as_ref().map(|path| read_rays(path)).transpose()?;
    let graph = session.load_solid(file, &arguments.changes.changes(), "`truth`")?;
    let arena = Arc::new(Arena::default());
    let settling = Settling { library: &session.library, arena: &arena, request: &request };
    let settled = settling.seen(graph).and_then(|graph| {
        let plan = settling.plan(&graph)?;
        let plan = settling.estimate(&graph, plan, precision, &mut session.watch())?.plan;
        Ok((graph, plan))
    });
    let (graph, plan) = settled.map_err(|error| session.failed(error))?;
    let composer = Composer { arena: &arena, library: &session.library, graph: &graph };
    let camera = camera_of(&composer, &plan);
    let scale = Scale::of_view(&camera, arguments.size, plan.bounding_radius);
    let rays = given.unwrap_or_else(|| view_rays(&camera, arguments.size, arguments.rays as usize, arguments.seed));

    let start = Instant::now();
    let mut progress = Progress::new(false);
    let exact = plan.clone().with_late_ends();
    let judges = if arguments.truth_ends == TruthEnds::Never { &exact } else { &plan };
    let truths = Truths::find(&composer, &judges.choices, &rays, scale, &mut |share| {
        progress.update(share);
        true
    });
    progress.finish();
    let truths = truths.map_err(|error| session.failure(error))?;
    let time = start.elapsed();

    let plan = plan.in_precision(precision);
    let settings = MarchSettings::of_plan(&plan, scale.pixel, precision);
    let march = candidate(&composer, &plan.choices, &settings).map_err(|error| session.failure(error))?;
    let mut job = MarchJob { arena: &arena, march: &march, rays: &truths.rays, radius: scale.bounding_radius };
    let backends = session.engine.backends();
    let done = backends.run(request.backend, precision, &mut job, &mut session.watch());
    let (backend, ends) = done.map_err(|error| session.failed(error))?;
    let is_view = arguments.rays_file.is_none();
    Ok(Measured { graph, plan, truths, ends, backend, time, is_view })
}

fn read_rays(path: &std::path::Path) -> Result<Vec<Ray>, Failure> {
    let rows = read_rows::<6>(path, "an origin and a direction: ox,oy,oz,dx,dy,dz")?;
    let ray = |(i, row): (usize, [f64; 6])| {
        let direction = glam::DVec3::new(row[3], row[4], row[5]).try_normalize().ok_or_else(|| {
            let text = format!("{}: ray {} has a direction of length 0", path.display(), i + 1);
            usage(text, "a direction is any vector but 0,0,0")
        })?;
        Ok(([row[0], row[1], row[2]], direction.to_array()))
    };
    rows.into_iter().enumerate().map(ray).collect()
}

struct MarchJob<'a> {
    arena: &'a Arena,
    march: &'a Kernel,
    rays: &'a [Ray],
    radius: f64,
}

impl Work for MarchJob<'_> {
    type Output = Vec<End>;

    fn run<B: Backend>(
        &mut self,
        backend: &B,
        _: &mut Kept<B>,
        _: &mut dyn Observer,
    ) -> Result<Vec<End>, BackendError> {
        march_rays(backend, self.arena, self.march, self.rays, self.radius)
    }
}

/// How the truth compares with a known exact limit set.
struct ExactAnswer {
    name: String,
    /// Rays that meet the limit set.
    hits: usize,
    /// Of those, rays whose truth is a miss or lies behind the limit set.
    passed: usize,
    /// Largest exact distance from a true hit to the limit set: how much thicker finitely many iterations leave it.
    thickness: f64,
}

/// Everything that is found.
pub(super) struct Measured {
    /// The formula.
    pub(super) graph: ValidGraph,
    /// The estimate that marched.
    pub(super) plan: Plan,
    truths: Truths,
    ends: Vec<End>,
    backend: String,
    time: Duration,
    /// Whether the rays are those of a view, and not of a file.
    is_view: bool,
}

impl Measured {
    /// What is out of the budget. A view without hits says nothing of misses, so it keeps none; rays of a file are as they are.
    pub(super) fn complaint(&self, budget: &Budget) -> Option<String> {
        let judged = self.judged();
        truth_table::complaint(&judged, budget).filter(|_| self.is_view || judged.hits > 0)
    }

    /// How the march compares with the truth.
    pub(super) fn judged(&self) -> Judgement {
        self.truths.judge(&self.ends)
    }

    /// Rays that were walked.
    pub(super) fn rays(&self) -> usize {
        self.truths.rays.len()
    }

    fn exact(&self) -> Option<ExactAnswer> {
        let limit = Limit::of(&self.graph)?;
        let mut answer = ExactAnswer { name: limit.name().to_string(), hits: 0, passed: 0, thickness: 0.0 };
        for (ray, truth) in self.truths.rays.iter().zip(&self.truths.depths) {
            if let Truth::Hit(t) = truth {
                let distance = limit.distance(bulbfold::check::truth::point(*ray, *t));
                answer.thickness = answer.thickness.max(distance);
            }
            let far = glam::DVec3::from(ray.0).length() + self.plan.bounding_radius;
            let Some(depth) = limit.depth(*ray, far, EXACT_EPS) else { continue };
            answer.hits += 1;
            let is_behind = |t: f64| t > depth + self.truths.scale.footprint(depth);
            answer.passed += usize::from(match truth {
                Truth::Hit(t) => is_behind(*t),
                Truth::Miss => true,
                Truth::Ambiguous => false,
            });
        }
        Some(answer)
    }

    /// Method and form of each orbit.
    pub(super) fn method(&self) -> String {
        let of = |c: &bulbfold::compose::Choice| format!("{} {}", c.method.name(), c.form.name());
        let mut names: Vec<String> = self.plan.choices.iter().map(of).collect();
        names.dedup();
        if names.is_empty() { "own".into() } else { names.join(", ") }
    }

    fn text(&self, out: &mut dyn Write) -> Outcome {
        let [hits, misses, ambiguous] = self.truths.counts();
        let judged = self.judged();
        writeln!(out, "truth of {} rays by brute force in f64, in {}", self.truths.rays.len(), short(self.time))?;
        writeln!(out, "  hits       {hits:6}   of them {} thinner than half a pixel", self.truths.thin())?;
        writeln!(out, "  misses     {misses:6}")?;
        writeln!(out, "  ambiguous  {ambiguous:6}   finer steps kept changing the answer; left out below")?;
        if let Some(exact) = self.exact() {
            let ExactAnswer { name, hits, passed, thickness } = exact;
            writeln!(out, "  exact      {hits:6}   rays meet {name} itself; brute force passed {passed} of them")?;
            writeln!(out, "                      no true hit is further than {thickness:.2e} from it")?;
        }
        writeln!(out, "march by {}, fudge {}, on {}", self.method(), self.plan.fudge, self.backend)?;
        print_judgement(&judged, out)?;
        if self.is_proof() {
            let Judgement { undecided, disproven, .. } = judged;
            writeln!(
                out,
                "  undecided  {undecided:6}   rays crossed something unproven; hits passed by the others: {disproven}"
            )?;
        }
        Ok(())
    }

    /// Whether some orbit is proven and not estimated: then rays may be undecided.
    fn is_proof(&self) -> bool {
        self.plan.choices.iter().any(|choice| choice.method.is_certified())
    }

    fn json(&self, out: &mut dyn Write) -> Outcome {
        let truths = &self.truths;
        for (i, ((ray, truth), end)) in truths.rays.iter().zip(&truths.depths).zip(&self.ends).enumerate() {
            let kind = match truth {
                Truth::Hit(_) => "hit",
                Truth::Miss => "miss",
                Truth::Ambiguous => "ambiguous",
            };
            let thin = truth.depth().map(|_| !truths.thick[i]);
            let line = json!({
                "origin": ray.0, "direction": ray.1, "truth": kind, "t": truth.depth(), "thin": thin,
                "march": end.depth(), "estimates": end.estimates, "iterations": end.iterations,
                "undecided": self.is_proof().then_some(end.undecided),
            });
            writeln!(out, "{line}")?;
        }
        self.summary(out)
    }

    /// The summary as a line of JSON.
    pub(super) fn summary(&self, out: &mut dyn Write) -> Outcome {
        let (truths, j) = (&self.truths, self.judged());
        let exact = self.exact().map_or(
            Value::Null,
            |e| json!({ "set": e.name, "hits": e.hits, "passed": e.passed, "largest_distance": e.thickness }),
        );
        let line = json!({ "summary": {
            "fractal": self.graph.name,
            "version": JSON_VERSION, "rays": truths.rays.len(), "hits": j.hits, "misses": j.misses,
            "ambiguous": j.ambiguous, "thin": j.thin, "seconds": self.time.as_secs_f64(), "exact": exact,
            "method": self.method(), "fudge": self.plan.fudge, "backend": self.backend, "missed": j.missed,
            "missed_thin": j.missed_thin, "early": j.early, "finer": j.finer, "median_error": j.median_error,
            "unfinished": j.unfinished, "nan": j.nan, "estimates": j.estimates, "iterations": j.iterations,
            "undecided": self.is_proof().then_some(j.undecided), "disproven": self.is_proof().then_some(j.disproven),
        } });
        writeln!(out, "{line}")?;
        Ok(())
    }
}

fn print_judgement(judged: &Judgement, out: &mut dyn Write) -> Outcome {
    let percent = |share: f64| format!("{:6.2} %", 100.0 * share);
    let thin = percent(judged.missed_thin);
    writeln!(
        out,
        "  missed   {}   of the hits were passed (of the thin ones {})",
        percent(judged.missed),
        thin.trim()
    )?;
    writeln!(out, "  early    {}   of the stops are in front of the truth", percent(judged.early))?;
    if judged.finer > 0 {
        let count = judged.finer;
        writeln!(out, "                      {count} more are on something thinner than the brute force's steps")?;
    }
    writeln!(out, "  error    {:8.4}   footprints, the median depth error", judged.median_error)?;
    writeln!(out, "  cost     {:8.1}   estimates and {:.1} iterations a ray", judged.estimates, judged.iterations)?;
    for (count, what) in [(judged.unfinished, "ran out of steps"), (judged.nan, "met an estimate that is not a number")]
    {
        if count > 0 {
            writeln!(out, "  {count} rays {what}")?;
        }
    }
    Ok(())
}
