//! A formula for unit tests: loaded in one line, asked in one line.

use std::fmt;
use std::path::Path;
use std::sync::{Arc, OnceLock};

use serde::{Deserialize, Serialize};

use super::backends::{Backends, Target};
use super::report::Report;
use super::runner::{Options, run_graph};
use super::subject::Subject;
use crate::compose::Plan;
use crate::diag::{Diagnostic, Diagnostics, SourceId};
use crate::expr::Arena;
use crate::formula::library::Library;
use crate::graph::{Method, ValidGraph};
use crate::kernel::wgsl;
use crate::load::{Bundle, Loaded, load, load_text};
use crate::render::{RenderSettings, compose_pipeline};

/// Hit threshold of [`Formula::ray`], in world units.
const RAY_EPS: f64 = 1e-6;

/// Why a formula did not load or compose: the messages as a user sees them.
#[derive(Clone, PartialEq, Eq)]
pub struct FormulaError(String);

impl fmt::Display for FormulaError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

// `unwrap` in a test prints the debug form: the same text, since it is made for people.
impl fmt::Debug for FormulaError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "\n{}", self.0)
    }
}

impl std::error::Error for FormulaError {}

/// A formula with everything it needs, computed on the CPU in f64. Threads may share it.
pub struct Formula {
    library: Library,
    loaded: Loaded,
    arena: Arc<Arena>,
    /// What is chosen by rules; made when it is first asked for.
    plan: OnceLock<Plan>,
}

impl Serialize for Formula {
    /// All its texts: see [`Bundle`].
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.bundle().serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Formula {
    /// Loads it from its texts alone.
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Formula, D::Error> {
        let bundle = Bundle::deserialize(deserializer)?;
        Formula::load(|library, d| bundle.load(library, d)).map_err(serde::de::Error::custom)
    }
}

impl Formula {
    /// A built-in fractal.
    pub fn builtin(name: &str) -> Result<Formula, FormulaError> {
        Formula::load(|library, d| load(library, name, &[], d))
    }

    /// A formula file. Steps that lie beside it are read too.
    pub fn open(path: impl AsRef<Path>) -> Result<Formula, FormulaError> {
        let path = path.as_ref().display().to_string();
        Formula::load(|library, d| match Path::new(&path).exists() {
            true => load(library, &path, &[], d),
            false => {
                d.push(Diagnostic::error(format!("there is no file {path}")));
                None
            }
        })
    }

    /// A formula from its RON text.
    pub fn from_ron(text: &str) -> Result<Formula, FormulaError> {
        Formula::load(|library, d| load_text(library, "formula.ron", text, &[], d))
    }

    /// A built-in fractal or a file with some values changed, each a path such as `power` and a value as RON.
    pub fn with(what: &str, set: &[(&str, &str)]) -> Result<Formula, FormulaError> {
        let set: Vec<(String, String)> = set.iter().map(|(k, v)| (k.to_string(), v.to_string())).collect();
        Formula::load(|library, d| load(library, what, &set, d))
    }

    fn load(read: impl FnOnce(&mut Library, &mut Diagnostics) -> Option<Loaded>) -> Result<Formula, FormulaError> {
        let mut library = Library::builtin();
        let mut d = Diagnostics::default();
        let loaded = read(&mut library, &mut d);
        let Some(loaded) = loaded.filter(|_| !d.has_errors()) else {
            return Err(FormulaError(d.render(&library.sources, false)));
        };
        let formula = Formula::of(library, loaded);
        match formula.planned() {
            Ok(_) => Ok(formula),
            Err(error) => Err(FormulaError(error.rendered(&formula.library.sources))),
        }
    }

    /// A formula that was loaded with this library.
    pub fn of(library: Library, loaded: Loaded) -> Formula {
        Formula { library, loaded, arena: Arc::new(Arena::default()), plan: OnceLock::new() }
    }

    /// All its texts.
    pub fn bundle(&self) -> Bundle {
        Bundle::of(&self.library, &self.loaded)
    }

    /// The choices by rules. Fails where a step's script does.
    fn planned(&self) -> Result<&Plan, Diagnostic> {
        if self.plan.get().is_none() {
            let plan = Subject::new(&self.library, &self.loaded.graph, &self.arena)?.plan;
            let _ = self.plan.set(plan);
        }
        Ok(self.plan())
    }

    /// The formula with its method, step multiplier and shortest step left open, where its file calls them calibrated: what a
    /// calibration starts from.
    #[must_use]
    pub fn without_calibration(mut self) -> Formula {
        self.loaded.graph = self.loaded.graph.without_calibration();
        self.plan = OnceLock::new();
        self
    }

    /// The formula as the rest of this module takes it.
    pub fn subject(&self) -> Subject<'_> {
        let plan = self.plan().clone();
        Subject { library: &self.library, graph: &self.loaded.graph, arena: &self.arena, plan }
    }

    /// The graph.
    pub fn graph(&self) -> &ValidGraph {
        &self.loaded.graph
    }

    /// The file's text among the library's sources.
    pub fn text(&self) -> SourceId {
        self.loaded.text
    }

    /// Steps, engine and sources.
    pub fn library(&self) -> &Library {
        &self.library
    }

    /// The methods, forms and extent that are chosen automatically, with their reasons.
    ///
    /// Panics if a step's script fails, which a formula that loaded does not.
    pub fn plan(&self) -> &Plan {
        let made = || Subject::new(&self.library, &self.loaded.graph, &self.arena).map(|subject| subject.plan);
        self.plan.get_or_init(|| self.composed(made()))
    }

    /// Whether the point belongs to the set.
    pub fn inside(&self, point: [f64; 3]) -> bool {
        self.estimate_with(point, None).1
    }

    /// The state of the (first) orbit after this many iterations, which escaping does not stop.
    ///
    /// Three or four components. Panics if a step's script fails.
    pub fn orbit(&self, point: [f64; 3], iterations: u32) -> Vec<f64> {
        let subject = self.subject();
        let kernel = self.composed(subject.orbit_kernel(iterations));
        let states = subject.orbits(&Backends::cpu_only(), Target::CPU_F64, &kernel, &[point]);
        states.expect("the CPU runs every kernel").swap_remove(0)
    }

    /// The distance estimate of a method at a point, in world units; 0 inside.
    ///
    /// Panics if the method does not apply: `plan().choices` says which do.
    pub fn estimate(&self, point: [f64; 3], method: Method) -> f64 {
        self.estimate_with(point, Some(method)).0
    }

    /// The estimate of the method that is chosen automatically.
    pub fn chosen_estimate(&self, point: [f64; 3]) -> f64 {
        self.estimate_with(point, None).0
    }

    /// The estimates of the method that is chosen automatically, in world units; 0 inside. Many points at once take a small
    /// part of the time that they take one by one.
    pub fn estimates(&self, points: &[[f64; 3]]) -> Vec<f64> {
        let subject = self.subject();
        let kernel = self.composed(subject.estimator(&subject.plan.choices));
        let values = subject.estimates(&Backends::cpu_only(), Target::CPU_F64, &kernel, points);
        values.expect("the CPU runs every kernel").into_iter().map(|(distance, _)| distance).collect()
    }

    fn estimate_with(&self, point: [f64; 3], method: Option<Method>) -> (f64, bool) {
        let subject = self.subject();
        let choices = subject.choices(method);
        let choices = choices.unwrap_or_else(|| panic!("the method {method:?} does not apply to this formula"));
        let kernel = self.composed(subject.estimator(&choices));
        let values = subject.estimates(&Backends::cpu_only(), Target::CPU_F64, &kernel, &[point]);
        values.expect("the CPU runs every kernel")[0]
    }

    /// The depth at which a ray meets the set; `direction` of any length but 0.
    pub fn ray(&self, origin: [f64; 3], direction: [f64; 3]) -> Option<f64> {
        let direction = glam::DVec3::from(direction).normalize().to_array();
        let depths = self.subject().depths(&Backends::cpu_only(), Target::CPU_F64, &[(origin, direction)], RAY_EPS);
        self.composed(depths.expect("the CPU runs every kernel"))[0]
    }

    /// All kernels of the formula's picture as WGSL that naga has validated.
    pub fn wgsl(&self) -> String {
        let composer = self.subject().composer();
        let pipeline = self.composed(compose_pipeline(&composer, &RenderSettings::default()));
        let mut all = String::new();
        for (name, kernel) in pipeline.kernels() {
            let text = wgsl::write(&self.arena, kernel);
            if let Err(error) = wgsl::validate(&text) {
                panic!("kernel {name}: {error}");
            }
            all.push_str(&format!("// kernel {name}\n{text}\n"));
        }
        all
    }

    /// Runs the tests that the file holds, on every back end of this machine.
    pub fn run_tests(&self) -> Report {
        run_graph(&self.library, self.graph(), self.library.sources.name(self.text()), &Options::default())
    }

    /// Runs the tests that the file holds and panics with the report if any fails.
    pub fn assert_tests(&self) {
        let report = self.run_tests();
        assert!(report.is_ok(), "\n{report}");
    }

    fn composed<T>(&self, result: Result<T, Diagnostic>) -> T {
        result.unwrap_or_else(|error| panic!("\n{}", error.rendered(&self.library.sources)))
    }
}

#[cfg(test)]
mod tests {
    use super::Formula;

    /// Threads may share a formula, and everything that it is made of.
    #[test]
    fn formulas_are_shared_between_threads() {
        fn shared<T: Send + Sync>() {}
        shared::<Formula>();
        let formula = Formula::builtin("mandelbulb").unwrap();
        let inside = || formula.inside([0.0; 3]) && !formula.inside([1.3, 0.0, 0.0]);
        std::thread::scope(|scope| {
            let threads: Vec<_> = (0..4).map(|_| scope.spawn(inside)).collect();
            assert!(threads.into_iter().all(|thread| thread.join().is_ok_and(|holds| holds)));
        });
    }
}
