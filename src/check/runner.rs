//! Finds formula and step files and runs what each has to be tested for.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::backends::{Backends, Target};
use super::cases::{Case, applies, label};
use super::materials::MaterialCase;
use super::report::{Outcome, Report, Verdict};
use super::steps::StepCase;
use super::subject::Subject;
use super::truth::Budget;
use crate::diag::{Diagnostics, SourceId, Sources, Span};
use crate::expr::Arena;
use crate::files::{Chosen, MAX_TEXT, read_text};
use crate::formula::library::Library;
use crate::formula::material::{Material, is_material_text};
use crate::formula::shape::is_step_text;
use crate::formula::step::{ScalarRule, Step};
use crate::graph::{NodeKind, PRESET, Preset, ValidGraph};
use crate::kernel::wgsl;
use crate::load::load;
use crate::math::Precision;
use crate::render::{RenderSettings, compose_pipeline};
use crate::shade::Size;

/// Set to 1, a machine without a GPU adapter fails its tests instead of leaving them out.
pub const REQUIRE_GPU: &str = "BULBFOLD_REQUIRE_GPU";

/// What to run.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Options {
    /// Only tests whose names contain this.
    pub filter: Option<String>,
    /// Whether to look for a GPU.
    pub gpu: bool,
}

impl Default for Options {
    fn default() -> Self {
        Options { filter: None, gpu: true }
    }
}

/// Runs the tests of all formula files (`*.ron`), step files (`*.rhai` with `fn step`) and material files (`fn material`) among `paths` and in its folders.
///
/// A file that does not load is a failed test with its messages. A path that does not exist is one, too.
pub fn run_paths(library: &mut Library, paths: &[PathBuf], options: &Options) -> Report {
    run_paths_with(library, paths, options, &mut |_| {})
}

/// As [`run_paths`]; `progress` receives each test as it ends.
pub fn run_paths_with(
    library: &mut Library,
    paths: &[PathBuf],
    options: &Options,
    progress: &mut dyn FnMut(&Outcome),
) -> Report {
    let mut runner = Runner::new(options, progress);
    for path in paths {
        let mut files = Vec::new();
        find_files(path, &mut files);
        if files.is_empty() {
            let why =
                if path.exists() { "it holds no formula or step file" } else { "there is no such file or folder" };
            runner.run(path.display().to_string(), None, || Err(why.into()));
        }
        for file in files {
            runner.file(library, &file, &shown_name(path, &file));
        }
    }
    runner.finish()
}

/// Runs the tests of one graph, whose file is called `name`.
pub fn run_graph(library: &Library, graph: &ValidGraph, name: &str, options: &Options) -> Report {
    let mut progress = |_: &Outcome| {};
    let mut runner = Runner::new(options, &mut progress);
    runner.graph(library, graph, name);
    runner.finish()
}

/// `*.ron` and step files of a folder and the folders in it, in order; a file is itself.
fn find_files(path: &Path, files: &mut Vec<PathBuf>) {
    if path.is_dir() {
        let mut entries: Vec<_> = std::fs::read_dir(path).into_iter().flatten().flatten().map(|e| e.path()).collect();
        entries.sort();
        for entry in entries {
            // A link may lead back up; formula folders have no need of them.
            let wanted = entry.is_dir() || entry.extension().is_some_and(|e| e == "ron") || is_step(&entry);
            if wanted && !entry.is_symlink() {
                find_files(&entry, files);
            }
        }
    } else if path.is_file() {
        files.push(path.to_path_buf());
    }
}

fn is_step(path: &Path) -> bool {
    path.extension().is_some_and(|e| e == "rhai")
        && read_text(path, MAX_TEXT, Chosen::Found).is_ok_and(|text| is_step_text(&text) || is_material_text(&text))
}

/// A file's name below the folder that was asked for; the path as given where it is that file.
fn shown_name(asked: &Path, file: &Path) -> String {
    match file.strip_prefix(asked) {
        Ok(rest) if rest.components().next().is_some() => rest.display().to_string(),
        _ => file.display().to_string(),
    }
}

/// `file:line` of a place.
fn place_of(sources: &Sources, span: Span) -> Option<String> {
    let (line, _) = sources.line_col(span)?;
    Some(format!("{}:{line}", sources.name(span.source)))
}

struct Runner<'a> {
    options: &'a Options,
    backends: Backends,
    report: Report,
    start: Instant,
    progress: &'a mut dyn FnMut(&Outcome),
}

impl<'a> Runner<'a> {
    fn new(options: &'a Options, progress: &'a mut dyn FnMut(&Outcome)) -> Runner<'a> {
        let start = Instant::now();
        let backends = if options.gpu { Backends::new() } else { Backends::cpu_only() };
        let mut runner = Runner { options, backends, report: Report::default(), start, progress };
        if let (true, Some(why)) = (options.gpu, runner.backends.why_no_gpu().map(str::to_string)) {
            let required = std::env::var(REQUIRE_GPU).is_ok_and(|v| v == "1");
            let verdict = if required { Verdict::Failed(why) } else { Verdict::Skipped(why) };
            runner.record("gpu".into(), None, verdict, Duration::ZERO);
        }
        runner
    }

    fn finish(mut self) -> Report {
        self.report.time = self.start.elapsed();
        self.report
    }

    fn record(&mut self, name: String, place: Option<String>, verdict: Verdict, time: Duration) {
        let outcome = Outcome { name, verdict, time, place };
        (self.progress)(&outcome);
        self.report.outcomes.push(outcome);
    }

    fn run(&mut self, name: String, place: Option<String>, test: impl FnOnce() -> Result<(), String>) {
        if self.options.filter.as_ref().is_some_and(|filter| !name.contains(filter)) {
            return;
        }
        let start = Instant::now();
        let verdict = test().map_or_else(Verdict::Failed, |()| Verdict::Passed);
        self.record(name, place, verdict, start.elapsed());
    }

    /// Whether any test of a file can pass the filter; a filter may name a file or what comes after it.
    fn wants(&self, names: &[String]) -> bool {
        self.options.filter.as_ref().is_none_or(|filter| names.iter().any(|name| name.contains(filter)))
    }

    fn file(&mut self, library: &mut Library, file: &Path, name: &str) {
        if is_step(file) {
            return self.step_file(library, file, name);
        }
        let mut d = Diagnostics::default();
        match load(library, file, &[], &mut d) {
            Some(loaded) => {
                self.graph(library, &loaded.graph, name);
                for preset in &loaded.graph.presets {
                    self.preset(library, file, preset, &format!("{name}::preset {}", preset.name));
                }
            }
            None => self.run(format!("{name}::loads"), None, || Err(d.render(&library.sources, false))),
        }
    }

    /// Loads and composes a file with one of its presets, and validates its shaders.
    fn preset(&mut self, library: &mut Library, file: &Path, preset: &Preset, name: &str) {
        let place = place_of(&library.sources, preset.span);
        self.run(name.into(), place, || {
            let set = [(PRESET.to_string(), format!("{:?}", preset.name))];
            let mut d = Diagnostics::default();
            let loaded = load(library, file, &set, &mut d);
            let loaded = loaded.ok_or_else(|| d.render(&library.sources, false))?;
            let arena = Arc::new(Arena::default());
            let subject =
                Subject::new(library, &loaded.graph, &arena).map_err(|error| error.rendered(&library.sources))?;
            check_wgsl(&subject)
        });
    }

    fn graph(&mut self, library: &Library, graph: &ValidGraph, name: &str) {
        let targets = self.backends.targets();
        let wgsl_name = format!("{name}::wgsl");
        let mut cases = Vec::new();
        for test in &graph.tests {
            for target in targets.iter().filter(|target| applies(&test.kind, **target)) {
                cases.push((format!("{name}::{}::{}", label(&test.kind), target.name()), test, *target));
            }
        }
        let calibrated_name = format!("{name}::calibrated::{}", Target::CPU_F64.name());
        let is_calibrated = has_calibrated_estimate(graph);
        let names: Vec<String> = cases
            .iter()
            .map(|(name, ..)| name.clone())
            .chain([wgsl_name.clone()])
            .chain(is_calibrated.then(|| calibrated_name.clone()))
            .collect();
        if !self.wants(&names) {
            return;
        }
        let arena = Arc::new(Arena::default());
        let subject = match Subject::new(library, graph, &arena) {
            Ok(subject) => subject,
            Err(error) => return self.run(format!("{name}::composes"), None, || Err(error.rendered(&library.sources))),
        };
        self.run(wgsl_name, None, || check_wgsl(&subject));
        if is_calibrated {
            self.run(calibrated_name, None, || check_calibration(&subject));
        }
        for (name, test, target) in cases {
            let place = place_of(&library.sources, test.span);
            let backends = std::mem::replace(&mut self.backends, Backends::cpu_only());
            let case = Case { subject: &subject, backends: &backends, target };
            self.run(name, place, || case.check(&test.kind));
            self.backends = backends;
        }
    }

    fn step_file(&mut self, library: &mut Library, file: &Path, name: &str) {
        let mut d = Diagnostics::default();
        library.add_step_file(file, &mut d);
        library.add_beside(file.parent().unwrap_or(Path::new(".")), &mut d);
        let stem = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let text = read_text(file, MAX_TEXT, Chosen::Found).unwrap_or_default();
        if is_material_text(&text) {
            let is_it = |material: &&Arc<Material>| library.sources.text(material.text) == text;
            return match library.material(&stem).filter(is_it).cloned() {
                Some(material) => self.material(library, &material, name),
                None => self.run(format!("{name}::loads"), None, || Err(d.render(&library.sources, false))),
            };
        }
        let step = library.step(&stem).filter(|step| library.sources.text(step.text) == text).cloned();
        match step {
            Some(step) => self.step(library, &step, name),
            None => self.run(format!("{name}::loads"), None, || Err(d.render(&library.sources, false))),
        }
    }

    fn material(&mut self, library: &Library, material: &Material, name: &str) {
        let backends = std::mem::replace(&mut self.backends, Backends::cpu_only());
        let case = MaterialCase { library, material, backends: &backends };
        if material.examples.is_empty() {
            let why = "expected at least one worked example, found none";
            self.run(format!("{name}::examples"), None, || Err(why.into()));
        }
        for (i, example) in material.examples.iter().enumerate() {
            for target in backends.targets() {
                let place = Some(example_place(library, material.text, i));
                let name = format!("{name}::example {}::{}", i + 1, target.name());
                self.run(name, place, || case.example(example, target));
            }
        }
        for target in backends.targets() {
            self.run(format!("{name}::places::{}", target.name()), None, || case.places(target));
        }
        self.backends = backends;
    }

    fn step(&mut self, library: &Library, step: &Step, name: &str) {
        let backends = std::mem::replace(&mut self.backends, Backends::cpu_only());
        let case = StepCase { library, step, backends: &backends };
        if step.examples.is_empty() {
            self.run(format!("{name}::examples"), None, || {
                Err("expected at least one worked example, found none".into())
            });
        }
        for (i, example) in step.examples.iter().enumerate() {
            for target in backends.targets() {
                let place = Some(example_place(library, step.text, i));
                let name = format!("{name}::example {}::{}", i + 1, target.name());
                self.run(name, place, || case.example(example, target));
            }
        }
        if step.differentiable {
            self.run(format!("{name}::derivative::cpu_f64"), None, || case.derivative());
        }
        if step.is_shape() {
            self.run(format!("{name}::slope::cpu_f64"), None, || case.slope());
        }
        if step.scalar_rule == Some(ScalarRule::Exact) && step.differentiable {
            self.run(format!("{name}::rule_is_bound::cpu_f64"), None, || case.bound());
        }
        self.backends = backends;
    }
}

/// The line of an example: examples are counted by their `expect:` fields.
fn example_place(library: &Library, id: SourceId, index: usize) -> String {
    let text = library.sources.text(id);
    let at = text.match_indices("expect:").nth(index).map_or(0, |(at, _)| at);
    let line = text[..at].matches('\n').count() + 1;
    format!("{}:{line}", library.sources.name(id))
}

/// Rays of a small picture that an estimate which a file calls calibrated is checked on.
const CALIBRATED_RAYS: usize = 600;
const CALIBRATED_SIZE: Size = Size { width: 320, height: 240 };

fn has_calibrated_estimate(graph: &ValidGraph) -> bool {
    let calibrated =
        |kind: &NodeKind| matches!(kind, NodeKind::Orbit { settings, .. } if settings.estimate.calibrated.is_some());
    graph.nodes.iter().any(|node| calibrated(&node.kind))
}

/// Marches the view of a file that carries a calibrated estimate as the file says, and compares with the truth: what
/// `bulbfold test` asks of such a file. `Err` says what is out of the budget by more than chance.
pub fn check_calibration(subject: &Subject) -> Result<(), String> {
    let settings = RenderSettings { size: CALIBRATED_SIZE, precision: Precision::F64, ..RenderSettings::default() };
    let judged = super::truth::judge(subject, CALIBRATED_RAYS, &settings)?;
    let budget = Budget::default();
    if !judged.is_evidence_against(&budget) {
        return Ok(());
    }
    Err(format!(
        "the estimate is said to be calibrated, but of {} hits {:.2} % are missed (allowed are {:.2} %), {:.2} % of the stops \
         are early ({:.2} %), and the median depth error is {:.3} footprints ({}); `bulbfold calibrate` measures it anew",
        judged.hits,
        100.0 * judged.missed,
        100.0 * budget.missed,
        100.0 * judged.early,
        100.0 * budget.early,
        judged.median_error,
        budget.error
    ))
}

/// Writes all kernels of a picture as WGSL and lets naga validate them.
fn check_wgsl(subject: &Subject) -> Result<(), String> {
    let composer = subject.composer();
    let pipeline = compose_pipeline(&composer, &RenderSettings::default())
        .map_err(|error| error.rendered(&subject.library.sources))?;
    for (name, kernel) in pipeline.kernels() {
        wgsl::validate(&wgsl::write(subject.arena, kernel)).map_err(|error| format!("kernel {name}: {error}"))?;
    }
    Ok(())
}
