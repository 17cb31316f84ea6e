//! `bulbfold chart`: what every estimate costs and how right it is, as SVG, PNG or CSV.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use bulbfold::calibrate::{Options, calibrate};
use bulbfold::chart::cost::CostChart;
use bulbfold::chart::depth::DepthChart;
use bulbfold::chart::step_size::StepChart;
use bulbfold::chart::{Drawing, cost, depth, raster, step_size, svg};
use bulbfold::check::measure::{Candidate, Measurer, View, depth as depths, find_truths, step_size as steps};
use bulbfold::check::truth::Truths;
use bulbfold::check::{Backends, Subject, Target};
use bulbfold::compose::Plan;
use bulbfold::expr::Arena;
use bulbfold::files::{STDOUT, Target as Output};
use bulbfold::film::Image;
use bulbfold::graph::{Method, ValidGraph};
use bulbfold::kernel::cpu::Cpu;
use bulbfold::math::Precision;
use bulbfold::render::{RenderSettings, Renderer, compose_pipeline};
use bulbfold::shade::Size;
use clap::{Args, ValueEnum};

use super::arguments::{BackendArg, ChangeArgs, parse_number, precision_parser};
use super::backend::try_hardware;
use super::output::{self, Content, check_output};
use super::sizes::parse_size;
use super::{Failure, Outcome, Session, message, usage};

/// What to draw.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
enum Kind {
    /// Cost against error of every method, precision and step multiplier.
    Cost,
    /// Error of finite differences against their step.
    StepSize,
    /// Depth error against zoom.
    Depth,
}

/// Arguments of `chart`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold chart box_bulb -o box_bulb.svg
  bulbfold chart mandelbulb mandelbox -o both.png --rays 1000 --fudge 0.5,0.7,1
  bulbfold chart my_hybrid.ron --kind step-size -o steps.csv

The output's ending chooses the format: .svg, .png or .csv.")]
pub struct Arguments {
    /// Formula files (.ron), graph scripts (.rhai) or names of built-in fractals
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// The chart to write: .svg, .png or .csv [default: NAME.svg]
    #[arg(short, long, value_name = "OUT")]
    output: Option<PathBuf>,
    /// What to draw
    #[arg(long, value_enum, default_value_t = Kind::Cost)]
    kind: Kind,
    #[command(flatten)]
    changes: ChangeArgs,
    /// Rays of the view to sample, from 16 to 100000
    #[arg(long, value_name = "N", default_value_t = 1600, value_parser = clap::value_parser!(u32).range(16..=100_000))]
    rays: u32,
    /// Picture size, which sets the size of a footprint
    #[arg(long, value_name = "WxH", default_value = "640x360", value_parser = parse_size)]
    size: Size,
    /// Step multipliers, above 0 and at most 1, with commas
    #[arg(long, value_name = "F,F,...", default_value = "0.25,0.5,0.7,0.85,1", value_parser = parse_fudges)]
    fudge: Fudges,
    /// Back ends: auto adds a hardware GPU to the CPU, gpu any adapter
    #[arg(long, value_enum, default_value_t = BackendArg::Auto)]
    backend: BackendArg,
    /// Only this precision [default: both]
    #[arg(long, value_parser = precision_parser())]
    precision: Option<Precision>,
    /// Decades of zoom of `--kind depth`
    #[arg(long, value_name = "N", default_value_t = 14, value_parser = clap::value_parser!(u32).range(1..=15))]
    decades: u32,
    /// Pixels of a PNG for each unit of the page
    #[arg(long, value_name = "S", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=8))]
    scale: u32,
}

/// Step multipliers in rising order.
#[derive(Clone, PartialEq, Debug)]
struct Fudges(Vec<f64>);

fn parse_fudges(text: &str) -> Result<Fudges, String> {
    let mut fudges = text.split(',').map(parse_number).collect::<Result<Vec<f64>, String>>()?;
    if fudges.iter().any(|f| !(*f > 0.0 && *f <= 1.0)) {
        return Err("each must be above 0 and at most 1".into());
    }
    if fudges.len() > 20 {
        return Err("at most 20 of them".into());
    }
    fudges.sort_by(f64::total_cmp);
    fudges.dedup();
    Ok(Fudges(fudges))
}

/// What is written.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Format {
    Svg,
    Png,
    Csv,
}

/// A chart as a drawing or as lines of CSV.
struct Sheet {
    drawing: Drawing,
    csv: String,
}

/// Runs the command.
pub fn run(arguments: &Arguments, session: &mut Session) -> Outcome {
    let output = output_path(arguments);
    let format = format_of(&output)?;
    let content = if format == Format::Png { Content::Bytes } else { Content::Text };
    let target = check_output(&output, None, content)?;
    let backends = backends(arguments)?;
    let targets = targets(arguments, &backends);
    let mut graphs = Vec::new();
    for file in &arguments.files {
        graphs.push(session.load_solid(file, &arguments.changes.changes(), "`chart`")?);
    }
    session.spare_inputs(&target)?;
    let mut progress = session.progress();
    let mut sheets = Vec::new();
    for (i, graph) in graphs.iter().enumerate() {
        let (done, all) = (i as f64, graphs.len() as f64);
        let mut shown = |share: f64| progress.update((done + share) / all);
        let chart = Chart { arguments, session, graph, backends: &backends, targets: &targets };
        sheets.push(chart.sheet(&mut shown)?);
    }
    progress.finish();
    write(arguments, &target, format, sheets)?;
    if !target.is_stream() {
        session.say(&output.display().to_string());
    }
    Ok(())
}

fn output_path(arguments: &Arguments) -> PathBuf {
    arguments.output.clone().unwrap_or_else(|| {
        let stem = Path::new(&arguments.files[0]).file_stem().unwrap_or_default();
        let mut name = stem.to_os_string();
        name.push(".svg");
        PathBuf::from(name)
    })
}

fn format_of(path: &Path) -> Result<Format, Failure> {
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    match ending.as_str() {
        "" if path.as_os_str() == STDOUT => Ok(Format::Svg),
        "svg" => Ok(Format::Svg),
        "png" => Ok(Format::Png),
        "csv" => Ok(Format::Csv),
        _ => Err(usage(
            format!("the output {} must end in .svg, .png or .csv", path.display()),
            "the ending chooses the format: `-o NAME.svg`",
        )),
    }
}

fn backends(arguments: &Arguments) -> Result<Backends, Failure> {
    let f64_only = arguments.precision == Some(Precision::F64);
    let backends = match arguments.backend {
        BackendArg::Gpu if f64_only => {
            let help = "drop one of them: f64 is measured on the CPU";
            return Err(usage("GPUs compute in f32: `--backend gpu` and `--precision f64` exclude each other", help));
        }
        BackendArg::Cpu => Backends::cpu_only(),
        BackendArg::Auto if try_hardware().unwrap_or(false) => Backends::with_hardware(),
        BackendArg::Auto => Backends::cpu_only(),
        BackendArg::Gpu => Backends::new(),
    };
    match backends.why_no_gpu() {
        Some(why) if arguments.backend == BackendArg::Gpu => Err(Failure::Work(message(
            &format!("no GPU can be measured: {why}"),
            "`--backend cpu` measures the CPU alone",
        ))),
        _ => Ok(backends),
    }
}

fn targets(arguments: &Arguments, backends: &Backends) -> Vec<Target> {
    let wanted = |target: &Target| match arguments.precision {
        None => true,
        Some(Precision::F64) => *target == Target::CPU_F64,
        Some(Precision::F32) => *target != Target::CPU_F64,
    };
    let mut targets: Vec<Target> = backends.targets().into_iter().filter(wanted).collect();
    // f32 first: what renders take.
    targets.sort_by_key(|t| *t == Target::CPU_F64);
    targets
}

fn write(arguments: &Arguments, output: &Output, format: Format, sheets: Vec<Sheet>) -> Outcome {
    let failed = |error: String| Failure::Work(message(&format!("cannot draw the chart: {error}"), ""));
    let header = match arguments.kind {
        Kind::Cost => cost::CSV_HEADER,
        Kind::StepSize => step_size::CSV_HEADER,
        Kind::Depth => depth::CSV_HEADER,
    };
    if format == Format::Csv {
        let lines: String = sheets.into_iter().map(|s| s.csv).collect();
        return output::write(output, format!("{header}\n{lines}").as_bytes());
    }
    let mut drawings: Vec<Drawing> = sheets.into_iter().map(|s| s.drawing).collect();
    let drawing = if drawings.len() == 1 { drawings.remove(0) } else { Drawing::stack(drawings) };
    let written = match format {
        Format::Svg => output.write(svg(&drawing).map_err(failed)?.as_bytes()),
        _ => raster(&drawing, f64::from(arguments.scale)).map_err(failed)?.write_png_to(output),
    };
    written.map_err(|error| output::not_written(output, &error))
}

/// One formula's chart in the making.
struct Chart<'a> {
    arguments: &'a Arguments,
    session: &'a Session,
    graph: &'a ValidGraph,
    backends: &'a Backends,
    targets: &'a [Target],
}

impl Chart<'_> {
    fn sheet(&self, progress: &mut dyn FnMut(f64)) -> Result<Sheet, Failure> {
        let arena = Arc::new(Arena::default());
        let subject = Subject::new(&self.session.library, self.graph, &arena);
        let subject = subject.map_err(|diagnostic| self.session.failure(diagnostic))?;
        for warning in &subject.plan.warnings {
            self.session.warn(warning);
        }
        let view = View::sample(&subject, self.arguments.size, self.arguments.rays as usize);
        // The truth takes about half of the time.
        let truths = find_truths(&subject, &view, &mut |share| progress(share * 0.5)).map_err(work)?;
        if truths.counts()[0] == 0 {
            let text = format!("none of {} sampled rays of {} has a settled hit", view.rays.len(), self.graph.name);
            return Err(usage(text, "turn the camera towards the fractal, or sample more rays with --rays"));
        }
        let mut later = |share: f64| progress(0.5 + share * 0.5);
        match self.arguments.kind {
            Kind::Cost => self.cost(&subject, &view, &truths, &mut later),
            Kind::StepSize => {
                let gradient = |c: &bulbfold::compose::Choice| c.applicable.contains(&Method::Gradient);
                if !subject.plan.choices.iter().any(gradient) {
                    let text = format!("{} has no exact gradient to compare finite differences with", self.graph.name);
                    return Err(usage(text, "`--kind cost` and `--kind depth` work for every formula"));
                }
                let sizes = steps::measure(&subject, &truths, self.backends, self.targets, &mut later);
                let chart = StepChart { formula: self.graph.name.clone(), sizes: sizes.map_err(work)? };
                Ok(Sheet { drawing: chart.drawing(), csv: chart.csv() })
            }
            Kind::Depth => {
                let decades = self.arguments.decades;
                let found =
                    depths::measure(&subject, (&view, &truths), self.backends, self.targets, decades, &mut later);
                let chart = DepthChart { formula: self.graph.name.clone(), depths: found.map_err(work)? };
                Ok(Sheet { drawing: chart.drawing(), csv: chart.csv() })
            }
        }
    }

    fn cost(
        &self,
        subject: &Subject,
        view: &View,
        truths: &Truths,
        progress: &mut dyn FnMut(f64),
    ) -> Result<Sheet, Failure> {
        let options = Options {
            size: view.size,
            precision: self.targets[0].precision(),
            cache: None,
            ..Options::of_view(subject)
        };
        let calibration = calibrate(subject, &options, &mut |_| true);
        let calibration = calibration.map_err(|diagnostic| self.session.failure(diagnostic))?;
        calibration.warnings.iter().for_each(|warning| self.session.warn(warning));
        let (candidates, auto) = self.candidates(subject, &calibration.plan);
        let mut measurer = Measurer::new(subject, truths, self.backends);
        let mut points = Vec::new();
        for (i, candidate) in candidates.iter().enumerate() {
            points.push((*candidate, measurer.measure(candidate).map_err(work)?));
            progress((i + 1) as f64 / candidates.len() as f64);
        }
        let chart = CostChart {
            formula: self.graph.name.clone(),
            size: view.size,
            rays: view.rays.len(),
            hits: truths.counts()[0],
            ambiguous: truths.counts()[2],
            points,
            auto,
            picture: self.picture(subject)?,
        };
        Ok(Sheet { drawing: chart.drawing(), csv: chart.csv() })
    }

    /// Every method that applies, on every target, at every multiplier; and what `auto` takes.
    fn candidates(&self, subject: &Subject, plan: &Plan) -> (Vec<Candidate>, usize) {
        let choices = &subject.plan.choices;
        let form = choices.first().map(|c| c.form);
        let mut methods: Vec<Option<Method>> =
            Method::ALL.into_iter().filter(|m| choices.iter().any(|c| c.applicable.contains(m))).map(Some).collect();
        if methods.is_empty() {
            methods.push(None);
        }
        let mut candidates = Vec::new();
        for &method in &methods {
            for &target in self.targets {
                let with = |&fudge: &f64| Candidate { method, form, fudge, least_step: None, target };
                candidates.extend(self.arguments.fudge.0.iter().map(with));
            }
        }
        let auto = Candidate {
            method: plan.choices.first().map(|c| c.method),
            form: plan.choices.first().map(|c| c.form),
            fudge: plan.fudge,
            least_step: Some(plan.least_step),
            target: self.targets[0],
        };
        candidates.push(auto);
        let at = candidates.len() - 1;
        (candidates, at)
    }

    /// The fractal as `render` shows it, small.
    fn picture(&self, subject: &Subject) -> Result<Image, Failure> {
        let size = self.arguments.size;
        let height = (216.0 * f64::from(size.height) / f64::from(size.width)).round().clamp(20.0, 160.0) as u32;
        let settings = RenderSettings { size: Size { width: 216, height }, samples: 2, ..RenderSettings::default() };
        let pipeline = compose_pipeline(&subject.composer(), &settings);
        let pipeline = pipeline.map_err(|diagnostic| self.session.failure(diagnostic))?;
        let cpu = Cpu::new(Precision::F32);
        let image = Renderer::new(&cpu, subject.arena, &pipeline, &settings).and_then(|mut r| r.render(&mut |_| true));
        let image = image.map_err(|error| work(error.to_string()))?;
        Ok(image.expect("nothing stops this render early"))
    }
}

fn work(text: String) -> Failure {
    // A step's own message has its heading already.
    Failure::Work(if text.starts_with("error") { text } else { message(&text, "") })
}
