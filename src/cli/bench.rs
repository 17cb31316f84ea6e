//! `bulbfold bench`: how fast a formula is on this machine, by back end, precision, method and number of threads.

mod report;

use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use bulbfold::check::measure::peak::peak_mul_adds;
use bulbfold::check::measure::speed::{Speed, Times, Timing, march_speed};
use bulbfold::compose::{Composer, Plan, choose};
use bulbfold::engine::Settling;
use bulbfold::expr::Arena;
use bulbfold::graph::{EstimateSettings, Method, ValidGraph};
use bulbfold::kernel::cost::MarchCost;
use bulbfold::kernel::cpu::Cpu;
#[cfg(feature = "gpu")]
use bulbfold::kernel::gpu::{AdapterWanted, Gpu};
use bulbfold::kernel::{Backend, BackendError};
use bulbfold::math::Precision;
use bulbfold::render::{Pipeline, RenderSettings, Renderer, compose_planned};
use bulbfold::shade::Size;
use clap::Args;

use super::arguments::{AutoArgs, BackendArg, ChangeArgs, parse_positive, precision_parser};
#[cfg(feature = "gpu")]
use super::backend::tried_adapters;
use super::sizes::parse_size;
use super::{Failure, Outcome, Session, message, usage};

/// Arguments of `bench`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold bench my_hybrid.ron
  bulbfold bench mandelbulb mandelbox --backend cpu --time 3 --csv > speed.csv
  bulbfold bench box_bulb --methods --size 640x480

The rays are those of the file's own camera. Other work on the machine shows as spread: the median's distance from the
fastest run.")]
pub struct Arguments {
    /// Formula files (.ron), graph scripts (.rhai) or names of built-in fractals
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    #[command(flatten)]
    changes: ChangeArgs,
    /// Columns and rows of the picture whose rays are marched
    #[arg(long, value_name = "WxH", default_value = "320x240", value_parser = parse_size)]
    size: Size,
    /// Measure every method that applies, instead of the one that a render takes
    #[arg(long, conflicts_with = "de")]
    methods: bool,
    /// Back ends: auto takes the CPU and any adapter, also one in software
    #[arg(long, value_enum, default_value_t = BackendArg::Auto)]
    backend: BackendArg,
    /// Only this precision [default: both]
    #[arg(long, value_parser = precision_parser())]
    precision: Option<Precision>,
    /// Seconds to measure each fractal for, about
    #[arg(long, value_name = "SECONDS", default_value = "6", value_parser = parse_positive)]
    time: f64,
    #[command(flatten)]
    estimate: AutoArgs,
    /// Print one JSON object instead of tables
    #[arg(long, conflicts_with = "csv")]
    json: bool,
    /// Print lines of CSV instead of tables
    #[arg(long)]
    csv: bool,
}

/// What marches.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Engine {
    /// The CPU at its best: machine code where the processor has it.
    Cpu(Precision),
    /// The CPU's interpreter.
    Tape(Precision),
    /// An adapter.
    Gpu,
}

/// The baseline: one ray at a time, interpreted.
const BASELINE: Engine = Engine::Tape(Precision::F64);

impl Engine {
    fn precision(self) -> Precision {
        match self {
            Engine::Cpu(precision) | Engine::Tape(precision) => precision,
            Engine::Gpu => Precision::F32,
        }
    }

    fn cpu(self) -> Option<Cpu> {
        match self {
            Engine::Cpu(precision) => Some(Cpu::new(precision)),
            Engine::Tape(precision) => Some(Cpu::new(precision).interpreted()),
            Engine::Gpu => None,
        }
    }
}

/// One line of the result.
struct Row {
    engine: Engine,
    backend: String,
    method: String,
    cost: MarchCost,
    speed: Speed,
    /// Operations a second as a share of the core's products and sums in one; nothing for a GPU.
    of_peak: Option<f64>,
}

/// What was measured of a fractal.
struct Measured {
    fractal: String,
    estimate: String,
    rows: Vec<Row>,
    /// Threads and the march of the first row on so many.
    threads: Vec<(usize, Speed)>,
    /// The whole picture on all threads.
    picture: Times,
}

/// Products and sums in one that are possible in a second.
struct Peaks {
    /// In f32, by one thread.
    single: f64,
    /// In f64, by one thread.
    double: f64,
    /// In f32, by all threads together, and their number.
    all: (usize, f64),
}

impl Peaks {
    fn measure() -> Peaks {
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        Peaks {
            single: peak_mul_adds(Precision::F32, 1),
            double: peak_mul_adds(Precision::F64, 1),
            all: (threads, peak_mul_adds(Precision::F32, threads)),
        }
    }
}

/// The GPU, opened once.
struct Machine {
    #[cfg(feature = "gpu")]
    gpu: Option<Gpu>,
    peaks: Peaks,
}

/// Runs the command.
pub fn run(arguments: &Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    let machine = Machine::open(arguments)?;
    let mut graphs = Vec::new();
    for file in &arguments.files {
        graphs.push(session.load(file, &arguments.changes.changes())?.graph);
    }
    let mut progress = session.progress();
    let mut all = Vec::new();
    for (i, graph) in graphs.iter().enumerate() {
        let of = graphs.len() as f64;
        let bench = Bench { arguments, session, graph, machine: &machine };
        all.push(bench.measure(&mut |share| progress.update((i as f64 + share) / of))?);
    }
    progress.finish();
    let text = match (arguments.json, arguments.csv) {
        (true, _) => format!("{}\n", report::json(&all, &machine.peaks, arguments.size)),
        (_, true) => report::csv(&all, arguments.size),
        _ => report::table(&all, &machine.peaks, arguments.size),
    };
    Ok(out.write_all(text.as_bytes())?)
}

impl Machine {
    fn open(arguments: &Arguments) -> Result<Machine, Failure> {
        if arguments.backend == BackendArg::Gpu && arguments.precision == Some(Precision::F64) {
            let help = "drop one of them: f64 is measured on the CPU";
            return Err(usage("GPUs compute in f32: `--backend gpu` and `--precision f64` exclude each other", help));
        }
        let peaks = Peaks::measure();
        #[cfg(feature = "gpu")]
        return match arguments.backend {
            BackendArg::Cpu => Ok(Machine { gpu: None, peaks }),
            BackendArg::Auto if tried_adapters().1.is_some() => Ok(Machine { gpu: None, peaks }),
            wanted => match Gpu::new(AdapterWanted::Any) {
                Ok(gpu) => Ok(Machine { gpu: Some(gpu), peaks }),
                Err(error) if wanted == BackendArg::Gpu => Err(no_gpu(&error.to_string())),
                Err(_) => Ok(Machine { gpu: None, peaks }),
            },
        };
        #[cfg(not(feature = "gpu"))]
        match arguments.backend {
            BackendArg::Gpu => Err(no_gpu("this bulbfold was built without the feature `gpu`")),
            _ => Ok(Machine { peaks }),
        }
    }

    fn has_gpu(&self) -> bool {
        #[cfg(feature = "gpu")]
        return self.gpu.is_some();
        #[cfg(not(feature = "gpu"))]
        false
    }
}

fn no_gpu(why: &str) -> Failure {
    Failure::Work(message(&format!("no GPU can be measured: {why}"), "`--backend cpu` measures the CPU alone"))
}

/// One fractal's measurement in the making.
struct Bench<'a> {
    arguments: &'a Arguments,
    session: &'a Session,
    graph: &'a ValidGraph,
    machine: &'a Machine,
}

impl Bench<'_> {
    fn measure(&self, progress: &mut dyn FnMut(f64)) -> Result<Measured, Failure> {
        let arena = Arc::new(Arena::default());
        let composer = Composer { arena: &arena, library: &self.session.library, graph: self.graph };
        let plans = self.plans(&composer)?;
        let engines = self.engines();
        let counts = thread_counts();
        let share = 1.0 / (plans.len() * engines.len() + counts.len() + 1) as f64;
        let enough = Duration::from_secs_f64(self.arguments.time * share);
        let mut done = 0.0;
        let mut step = || {
            done += share;
            progress(done);
        };
        let mut rows = Vec::new();
        for plan in &plans {
            for &engine in &engines {
                rows.push(self.row(&composer, plan, engine, enough)?);
                step();
            }
        }
        let chosen = Cpu::new(self.precision(engines[0]));
        let (_, pipeline) = self.pipeline(&composer, &plans[0], chosen.precision())?;
        let mut threads = Vec::new();
        for &count in &counts {
            let speed = on_threads(&chosen, count, composer.arena, &pipeline, self.arguments.size, enough);
            threads.push((count, speed.map_err(failed)?));
            step();
        }
        let picture = self.picture(&composer, &plans[0], &chosen, enough)?;
        Ok(Measured { fractal: self.graph.name.clone(), estimate: names(&plans[0]), rows, threads, picture })
    }

    /// What a render takes, or every method that applies.
    fn plans(&self, composer: &Composer) -> Result<Vec<Plan>, Failure> {
        let request = self.arguments.estimate.request(self.arguments.size);
        let settling = Settling { library: composer.library, arena: composer.arena, request: &request };
        let precision = self.arguments.precision.unwrap_or(Precision::F32);
        let calibration = settling
            .plan(self.graph)
            .and_then(|plan| settling.estimate(self.graph, plan, precision, &mut self.session.hushed()));
        let plan = calibration.map_err(|error| self.session.failed(error))?.plan;
        if !self.arguments.methods {
            return Ok(vec![plan]);
        }
        let applies = |method: &Method| plan.choices.iter().any(|choice| choice.applicable.contains(method));
        let with = |method| EstimateSettings { method: Some(method), ..self.arguments.estimate.estimate.settings() };
        let plans: Result<Vec<Plan>, _> =
            Method::ALL.into_iter().filter(applies).map(|method| choose(composer, &with(method))).collect();
        let plans = plans.map_err(|diagnostic| self.session.failure(diagnostic))?;
        Ok(if plans.is_empty() { vec![plan] } else { plans })
    }

    /// The baseline last: everything is compared with it.
    fn engines(&self) -> Vec<Engine> {
        let mut engines = Vec::new();
        if self.arguments.backend != BackendArg::Gpu {
            engines.extend([Engine::Cpu(Precision::F32), Engine::Cpu(Precision::F64)]);
            if Cpu::new(Precision::F32).compiles() {
                engines.push(Engine::Tape(Precision::F32));
            } else {
                engines.retain(|engine| *engine != Engine::Cpu(Precision::F64));
            }
        }
        if self.machine.has_gpu() {
            engines.push(Engine::Gpu);
        }
        let wanted = |engine: &Engine| match self.arguments.precision {
            None => true,
            Some(precision) => precision == engine.precision(),
        };
        engines.retain(wanted);
        engines.push(BASELINE);
        engines
    }

    fn precision(&self, engine: Engine) -> Precision {
        self.arguments.precision.unwrap_or(engine.precision())
    }

    fn pipeline(
        &self,
        composer: &Composer,
        plan: &Plan,
        precision: Precision,
    ) -> Result<(RenderSettings, Pipeline), Failure> {
        let settings = RenderSettings { size: self.arguments.size, precision, ..RenderSettings::default() };
        let pipeline = compose_planned(composer, &settings, plan.clone());
        Ok((settings, pipeline.map_err(|diagnostic| self.session.failure(diagnostic))?))
    }

    fn row(&self, composer: &Composer, plan: &Plan, engine: Engine, enough: Duration) -> Result<Row, Failure> {
        let (_, pipeline) = self.pipeline(composer, plan, engine.precision())?;
        let march = pipeline.march();
        let cost = MarchCost::of(composer.arena, march);
        let size = self.arguments.size;
        let (backend, speed) = match engine.cpu() {
            Some(cpu) => (cpu.description(), on_threads(&cpu, 1, composer.arena, &pipeline, size, enough)),
            None => self.on_gpu(composer.arena, &pipeline, enough),
        };
        let speed = speed.map_err(failed)?;
        let peak = match engine {
            Engine::Gpu => None,
            engine if engine.precision() == Precision::F32 => Some(self.machine.peaks.single),
            _ => Some(self.machine.peaks.double),
        };
        let seconds = speed.times.fastest().as_secs_f64();
        let of_peak = peak.map(|peak| cost.operations(speed.estimates, speed.iterations) / seconds / peak);
        Ok(Row { engine, backend, method: names(plan), cost, speed, of_peak })
    }

    #[cfg(feature = "gpu")]
    fn on_gpu(&self, arena: &Arena, pipeline: &Pipeline, enough: Duration) -> (String, Result<Speed, BackendError>) {
        let gpu = self.machine.gpu.as_ref().expect("the GPU is measured only where there is one");
        let timing = Timing { enough, is_device: true };
        let run = |kernel: &_, rays: &_| gpu.run(kernel, &[rays]);
        let speed = march_speed(gpu, arena, pipeline, self.arguments.size, timing, &run);
        (format!("gpu, f32, {}", gpu.adapter().name), speed)
    }

    #[cfg(not(feature = "gpu"))]
    fn on_gpu(&self, _: &Arena, _: &Pipeline, _: Duration) -> (String, Result<Speed, BackendError>) {
        (String::new(), Err(BackendError::NoAdapter(String::new())))
    }

    fn picture(&self, composer: &Composer, plan: &Plan, cpu: &Cpu, enough: Duration) -> Result<Times, Failure> {
        let (settings, pipeline) = self.pipeline(composer, plan, cpu.precision())?;
        let mut renderer = Renderer::new(cpu, composer.arena, &pipeline, &settings).map_err(failed)?;
        Times::of(enough, || {
            renderer.render(&mut |_| true)?;
            Ok(renderer.stats.render)
        })
        .map_err(failed)
    }
}

/// Marches on a number of threads.
fn on_threads(
    cpu: &Cpu,
    count: usize,
    arena: &Arena,
    pipeline: &Pipeline,
    size: Size,
    enough: Duration,
) -> Result<Speed, BackendError> {
    let timing = Timing { enough, is_device: false };
    // Without threads of its own the pool of the program does the work.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(count).build().ok();
    let run = |kernel: &_, rays: &_| match &pool {
        Some(pool) => pool.install(|| cpu.run(kernel, &[rays])),
        None => cpu.run(kernel, &[rays]),
    };
    march_speed(cpu, arena, pipeline, size, timing, &run)
}

/// 1, 2, 4 ... and all threads of the machine.
fn thread_counts() -> Vec<usize> {
    let all = std::thread::available_parallelism().map_or(1, usize::from);
    let mut counts: Vec<usize> = std::iter::successors(Some(1), |n| Some(n * 2)).take_while(|n| *n < all).collect();
    counts.push(all);
    counts
}

/// Methods of a plan's orbits.
fn names(plan: &Plan) -> String {
    let names: Vec<&str> = plan.choices.iter().map(|choice| choice.method.name()).collect();
    if names.is_empty() { "own".into() } else { names.join(" + ") }
}

fn failed(error: BackendError) -> Failure {
    Failure::Work(message(&error.to_string(), "`--backend cpu` measures the CPU alone"))
}
