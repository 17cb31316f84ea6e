//! Loading a formula: a RON file, a Rhai script that returns a graph, or the name of a built-in fractal.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::diag::{Diagnostic, Diagnostics, SourceId};
use crate::formula::embedded;
use crate::formula::library::Library;
use crate::formula::ron::{Limits, read_ron};
use crate::graph::script::run_script;
use crate::graph::{IterationLimit, Node, NodeKind, Override, PRESET, ValidGraph, expand_presets, read};

/// A formula ready to be composed.
pub struct Loaded {
    /// The fractal.
    pub graph: ValidGraph,
    /// Its text.
    pub text: SourceId,
    /// What was changed in it.
    pub set: Vec<(String, String)>,
    /// Whether it is one of the built-in fractals.
    pub is_builtin: bool,
}

/// Everything that a formula is made of, as texts: what another machine needs to make the same one.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Bundle {
    /// The file's name; its stem names the fractal.
    pub name: String,
    /// The file's text.
    pub text: String,
    /// What is changed in it: pairs of a path and a value.
    pub set: Vec<(String, String)>,
    /// Names and texts of the steps and materials that it uses beside the built-in ones.
    pub steps: Vec<(String, String)>,
    /// Whether it is one of the built-in fractals, whose limits of iterations are stated for their own views alone.
    pub is_builtin: bool,
}

impl Bundle {
    /// The texts of a formula that was loaded with this library.
    pub fn of(library: &Library, loaded: &Loaded) -> Bundle {
        let own = |node: &Node| match &node.kind {
            NodeKind::Step { step, .. } | NodeKind::Shape { step, .. } => {
                let text = library.sources.text(step.text);
                let is_builtin = embedded::STEPS.iter().any(|(name, known)| *name == step.name && *known == text);
                (!is_builtin).then(|| (step.name.clone(), text.to_string()))
            }
            _ => None,
        };
        let used = loaded.graph.scene.look.paints().filter_map(|paint| paint.material.as_ref());
        let materials = used.filter_map(|used| {
            let (name, text) = (&used.material.name, library.sources.text(used.material.text));
            let is_builtin = embedded::MATERIALS.iter().any(|(known, own)| known == name && *own == text);
            (!is_builtin).then(|| (name.clone(), text.to_string()))
        });
        let mut steps: Vec<(String, String)> = loaded.graph.nodes.iter().filter_map(own).chain(materials).collect();
        steps.sort();
        steps.dedup();
        Bundle {
            name: library.sources.name(loaded.text).to_string(),
            text: library.sources.text(loaded.text).to_string(),
            set: loaded.set.clone(),
            steps,
            is_builtin: loaded.is_builtin,
        }
    }

    /// Loads the formula from its texts alone, with a library of the built-in steps. Returns nothing when `d` has errors.
    pub fn load(&self, library: &mut Library, d: &mut Diagnostics) -> Option<Loaded> {
        for (name, text) in &self.steps {
            library.add_step_text(Path::new(&format!("{name}.rhai")), text.clone(), d);
        }
        let loaded = load_text(library, &self.name, &self.text, &self.set, d)?;
        Some(if self.is_builtin { as_builtin(loaded) } else { loaded })
    }
}

/// Loads `what`: a path, or the name of a built-in fractal where there is no such file. `set` holds pairs of a path such
/// as `power` or `bulb.power` and a value in RON; the path `preset` asks for a preset of the file. Steps that lie beside the file are read too. Returns nothing when
/// `d` has errors.
pub fn load(
    library: &mut Library,
    what: impl AsRef<Path>,
    set: &[(String, String)],
    d: &mut Diagnostics,
) -> Option<Loaded> {
    let path = what.as_ref();
    // Only the names of files need not be UTF-8.
    let what = path.to_string_lossy();
    let (name, text) = if path.exists() {
        let text = read_text(library, path, d)?;
        if let Some(folder) = path.parent() {
            library.add_beside(folder, d);
        }
        (what.to_string(), text)
    } else if let Some((name, text)) = embedded::FRACTALS.iter().find(|(name, _)| *name == what) {
        (format!("formulas/fractals/{name}.ron"), (*text).to_string())
    } else if let Some((name, text)) = embedded::SCRIPTS.iter().find(|(name, _)| *name == what) {
        (format!("formulas/scripts/{name}.rhai"), (*text).to_string())
    } else {
        let names = embedded::FRACTALS.iter().chain(embedded::SCRIPTS).map(|(name, _)| *name);
        let message = format!("there is no file and no built-in fractal `{what}`");
        d.push(match library.step(&what) {
            Some(step) => Diagnostic::error(format!("`{what}` is a step, not a fractal"))
                .help(format!("use it as a node of a formula file: `nodes: {{ \"a\": {}() }}`", step.name))
                .help(format!(
                    "`bulbfold explain {what}` says what it does, `bulbfold new NAME` writes a formula file"
                )),
            None => {
                Diagnostic::error(message).did_you_mean(&what, names).help("`bulbfold list` shows the built-in ones")
            }
        });
        return None;
    };
    let loaded = load_text(library, &name, &text, set, d)?;
    Some(if path.exists() { loaded } else { as_builtin(loaded) })
}

/// A formula as one of the built-in ones: the iterations that it states are enough for its own view, and others may take more.
fn as_builtin(loaded: Loaded) -> Loaded {
    if loaded.set.iter().any(|(path, _)| path.rsplit('.').next() == Some("max_iterations")) {
        return Loaded { is_builtin: true, ..loaded };
    }
    let graph = loaded.graph.with_orbit_settings(|settings| {
        if settings.limit == IterationLimit::Stated {
            settings.limit = IterationLimit::OfOwnView;
        }
    });
    Loaded { graph, is_builtin: true, ..loaded }
}

/// Loads a formula from its text; `name` is its file name, whose stem names the fractal.
pub fn load_text(
    library: &mut Library,
    name: &str,
    text: &str,
    set: &[(String, String)],
    d: &mut Diagnostics,
) -> Option<Loaded> {
    library.engine.begin_formula();
    let overrides = read_overrides(library, set, d);
    let id = library.sources.add(name, text);
    if text.trim().is_empty() {
        let help = "`bulbfold new NAME` writes a commented one to start from";
        d.push(Diagnostic::error(format!("{name} is empty")).help(help));
        return None;
    }
    let is_script = Path::new(name).extension().is_some_and(|e| e.eq_ignore_ascii_case("rhai"));
    let mut value = match is_script {
        true => run_script(library, id, &overrides, d)?,
        false => read_ron(&library.sources, id, &Limits::default(), d)?,
    };
    let expanded = expand_presets(&value, &overrides, d)?;
    if is_script && overrides.iter().any(|change| change.path == PRESET) {
        // A script takes its parameters while it runs, and only then says what its presets are.
        value = run_script(library, id, &expanded, d)?;
    }
    let overrides = expanded;
    let stem = Path::new(name).file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let mut graph = read(library, &value, &stem, &overrides, d)?;
    if overrides.iter().any(changes_the_view) {
        graph = graph.without_calibration();
    }
    (!d.has_errors()).then_some(Loaded { graph, text: id, set: set.to_vec(), is_builtin: false })
}

/// Whether a change makes a calibrated estimate of the file one of another picture.
fn changes_the_view(change: &Override) -> bool {
    let parts = || change.path.split('.');
    !parts().next().into_iter().chain(parts().next_back()).any(|part| ["estimate", "look"].contains(&part))
}

/// Reads a text file of at most 1 MiB, or a pipe; an error is pushed.
pub fn read_text(library: &mut Library, path: &Path, d: &mut Diagnostics) -> Option<String> {
    let text = library.read_named(path);
    text.map_err(|error| d.push(Diagnostic::error(format!("cannot read {}: {error}", path.display())))).ok()
}

/// Reads `--set` values; a bare word or an expression may stand without quotes.
fn read_overrides(library: &mut Library, set: &[(String, String)], d: &mut Diagnostics) -> Vec<Override> {
    let mut overrides = Vec::new();
    for (path, text) in set {
        let id = library
            .sources
            .add(if path == PRESET { "--preset".into() } else { format!("--set {path}") }, text.as_str());
        let mut own = Diagnostics::default();
        match read_ron(&library.sources, id, &Limits::default(), &mut own) {
            Some(value) if !own.has_errors() => overrides.push(Override { path: path.clone(), value }),
            _ => d.extend(own),
        }
    }
    overrides
}
