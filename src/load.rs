//! Loading a formula: a RON file, a Rhai script that returns a graph, or the name of a built-in fractal.

mod panorama;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use self::panorama::{Named, load_picture};
use crate::diag::{Diagnostic, Diagnostics, Severity, SourceId};
use crate::formula::embedded;
use crate::formula::library::Library;
use crate::formula::ron::{Limits, read_ron};
use crate::formula::value::{Value, ValueKind};
use crate::graph::script::run_script;
use crate::graph::{
    Imports, IterationLimit, Node, NodeKind, Override, PRESET, ValidGraph, Wanted, expand_presets, patched, read,
    wanted,
};

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
    /// The formulas of its objects that are files: the names that the scenes give them, and their texts.
    pub files: Vec<(String, SourceId)>,
    /// The picture that surrounds it, with the name that the scene gives it.
    pub picture: Option<Named>,
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
    /// Names and texts of the files that its objects name.
    #[serde(default)]
    pub files: Vec<(String, String)>,
    /// Names and texts of the pictures that surround it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub pictures: Vec<(String, String)>,
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
            files: loaded
                .files
                .iter()
                .map(|(name, id)| (name.clone(), library.sources.text(*id).to_string()))
                .collect(),
            pictures: loaded.picture.iter().map(|(name, picture)| (name.clone(), picture.text().to_string())).collect(),
        }
    }

    /// Whether the text is a script, which makes the graph.
    pub fn is_script(&self) -> bool {
        Path::new(&self.name).extension().is_some_and(|end| end.eq_ignore_ascii_case("rhai"))
    }

    /// Whether the text is one of those that are built in.
    pub fn is_unchanged_builtin(&self) -> bool {
        embedded::FRACTALS.iter().chain(embedded::SCRIPTS).any(|(_, known)| *known == self.text)
    }

    /// Loads the formula from its texts alone, with a library of the built-in steps. Returns nothing when `d` has errors.
    pub fn load(&self, library: &mut Library, d: &mut Diagnostics) -> Option<Loaded> {
        for (name, text) in &self.steps {
            library.add_step_text(Path::new(&format!("{name}.rhai")), text.clone(), d);
        }
        let beside = Beside { folder: None, carried: &self.files, pictures: &self.pictures, depth: 0 };
        let loaded = load_text_beside(library, (&self.name, &self.text), &self.set, beside, d)?;
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
    let (name, text) = text_of(library, path, d)?;
    let loaded = load_text(library, &name, &text, set, d)?;
    Some(if names_file(path) { loaded } else { as_builtin(loaded) })
}

/// Whether a name is that of something to read. A folder is not: the built-in formula of its name is meant.
fn names_file(path: &Path) -> bool {
    path.exists() && !path.is_dir()
}

/// Names and texts of embedded files.
type Texts = &'static [(&'static str, &'static str)];

/// Name and text of a file, or of a built-in scene, fractal or script where there is no such file. Steps beside a file are read too.
fn text_of(library: &mut Library, path: &Path, d: &mut Diagnostics) -> Option<(String, String)> {
    // Only the names of files need not be UTF-8.
    let what = path.to_string_lossy();
    if names_file(path) {
        let text = read_text(library, path, d)?;
        if let Some(folder) = path.parent() {
            library.add_beside(folder, d);
        }
        return Some((what.to_string(), text));
    }
    const BUILTIN: [(Texts, &str, &str); 3] = [
        (embedded::FRACTALS, "fractals", "ron"),
        (embedded::SCENES, "scenes", "ron"),
        (embedded::SCRIPTS, "scripts", "rhai"),
    ];
    for (texts, folder, ending) in BUILTIN {
        if let Some((name, text)) = texts.iter().find(|(name, _)| *name == what) {
            return Some((format!("formulas/{folder}/{name}.{ending}"), (*text).to_string()));
        }
    }
    let names = BUILTIN.iter().flat_map(|(texts, ..)| texts.iter()).map(|(name, _)| *name);
    let message = match path.is_dir() {
        true => format!("`{what}` is a folder, and there is no built-in fractal of this name"),
        false => format!("there is no file and no built-in fractal `{what}`"),
    };
    d.push(match library.step(&what) {
        Some(step) => Diagnostic::error(format!("`{what}` is a step, not a fractal"))
            .help(format!("use it as a node of a formula file: `nodes: {{ \"a\": {}() }}`", step.name))
            .help(format!("`bulbfold explain {what}` says what it does, `bulbfold new NAME` writes a formula file")),
        None => Diagnostic::error(message).did_you_mean(&what, names).help("`bulbfold list` shows the built-in ones"),
    });
    None
}

/// Where the formulas of objects are looked for.
#[derive(Clone, Copy)]
struct Beside<'a> {
    /// The folder of the scene's file.
    folder: Option<&'a Path>,
    /// Names and texts that came with it, which go before files.
    carried: &'a [(String, String)],
    /// The same of pictures.
    pictures: &'a [(String, String)],
    /// Scenes that it is in.
    depth: u32,
}

/// Scenes within scenes at most.
const MOST_DEPTH: u32 = 4;

/// Loads the formulas that the objects of a file name. Adds the texts of files to `files`.
fn load_objects(
    library: &mut Library,
    value: &Value,
    beside: Beside,
    files: &mut Vec<(String, SourceId)>,
    d: &mut Diagnostics,
) -> Imports {
    let mut imports = Imports::default();
    for Wanted { object, formula, span, changes } in wanted(value) {
        let mut own = Diagnostics::default();
        let loaded = match beside.depth >= MOST_DEPTH {
            true => {
                own.push(Diagnostic::error(format!("scenes are nested more than {MOST_DEPTH} deep")));
                None
            }
            false => load_object(library, &formula, &changes, beside, files, &mut own),
        };
        let failed = own.iter().filter(|diagnostic| diagnostic.severity == Severity::Error);
        failed.for_each(|error| d.push(error.clone().label(span, format!("needed by the object `{object}`"))));
        if let Some(graph) = loaded {
            // What the file's estimate was calibrated on is another picture.
            imports.formulas.insert(object, Arc::new(graph.without_calibration()));
        }
    }
    imports
}

fn load_object(
    library: &mut Library,
    formula: &str,
    changes: &[Override],
    beside: Beside,
    files: &mut Vec<(String, SourceId)>,
    d: &mut Diagnostics,
) -> Option<ValidGraph> {
    let carried = beside.carried.iter().find(|(name, _)| name == formula);
    let path = beside.folder.map_or_else(|| PathBuf::from(formula), |folder| folder.join(formula));
    let is_file = carried.is_some() || (path.extension().is_some() && path.exists());
    let (name, text) = match carried {
        Some((_, text)) => (formula.to_string(), text.clone()),
        None if is_file => text_of(library, &path, d)?,
        None => text_of(library, Path::new(formula), d)?,
    };
    let folder = Path::new(&name).parent().map(Path::to_path_buf);
    let inner = Beside { folder: folder.as_deref().filter(|_| is_file), depth: beside.depth + 1, ..beside };
    let loaded = load_value(library, (&name, &text), Changes::Values(changes), inner, d)?;
    if is_file && !files.iter().any(|(known, _)| known == formula) {
        files.push((formula.to_string(), loaded.text));
    }
    files.extend(loaded.files);
    Some(loaded.graph)
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
    let beside = Beside { folder: Path::new(name).parent(), carried: &[], pictures: &[], depth: 0 };
    load_text_beside(library, (name, text), set, beside, d)
}

fn load_text_beside(
    library: &mut Library,
    (name, text): (&str, &str),
    set: &[(String, String)],
    beside: Beside,
    d: &mut Diagnostics,
) -> Option<Loaded> {
    library.engine.begin_formula();
    load_value(library, (name, text), Changes::Texts(set), beside, d)
}

/// What is changed in a file.
#[derive(Clone, Copy)]
enum Changes<'a> {
    /// Paths and values in RON.
    Texts(&'a [(String, String)]),
    /// The same as values of another file.
    Values(&'a [Override]),
}

fn load_value(
    library: &mut Library,
    (name, text): (&str, &str),
    changes: Changes,
    beside: Beside,
    d: &mut Diagnostics,
) -> Option<Loaded> {
    let (overrides, set) = match changes {
        Changes::Texts(set) => (read_overrides(library, set, d), set.to_vec()),
        Changes::Values(overrides) => (overrides.to_vec(), Vec::new()),
    };
    let id = library.sources.add(name, text);
    if text.trim().is_empty() {
        let help = "`bulbfold new NAME` writes a commented one to start from";
        d.push(Diagnostic::error(format!("{name} is empty")).help(help));
        return None;
    }
    let (value, expanded) = expanded(library, (name, id), &overrides, d)?;
    let stem = Path::new(name).file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let mut files = Vec::new();
    let (changed, _) = patched(&value, &expanded, &mut Diagnostics::default());
    let mut imports = load_objects(library, &changed, beside, &mut files, d);
    // What surrounds an object's own scene is not seen.
    let picture = (beside.depth == 0).then(|| load_picture(&changed, beside, d)).flatten();
    imports.panorama = picture.as_ref().map(|(_, panorama)| panorama.clone());
    let mut graph = read(library, &value, &stem, (&expanded, &imports), d)?;
    if expanded.iter().any(changes_the_view) {
        graph = graph.without_calibration();
    }
    (!d.has_errors()).then_some(Loaded { graph, text: id, set, is_builtin: false, files, picture })
}

/// The value that a text stands for, and what is changed in it once presets are spelled out.
fn expanded(
    library: &Library,
    (name, id): (&str, SourceId),
    overrides: &[Override],
    d: &mut Diagnostics,
) -> Option<(Value, Vec<Override>)> {
    let is_script = Path::new(name).extension().is_some_and(|e| e.eq_ignore_ascii_case("rhai"));
    let mut value = match is_script {
        true => run_script(library, id, overrides, d)?,
        false => read_ron(&library.sources, id, &Limits::default(), d)?,
    };
    let expanded = expand_presets(&value, overrides, d)?;
    if is_script && overrides.iter().any(|change| change.path == PRESET) {
        // A script takes its parameters while it runs, and only then says what its presets are.
        value = run_script(library, id, &expanded, d)?;
    }
    Some((value, expanded))
}

/// The value tree of a formula with all that is changed in it in its place: parameters have their values as defaults. What is wrong is
/// pushed.
pub fn tree(library: &mut Library, bundle: &Bundle, d: &mut Diagnostics) -> Option<Value> {
    let overrides = read_overrides(library, &bundle.set, d);
    let id = library.sources.add(bundle.name.as_str(), bundle.text.as_str());
    let (value, expanded) = expanded(library, (&bundle.name, id), &overrides, d)?;
    let (mut tree, params) = patched(&value, &expanded, d);
    for (name, value) in params {
        set_default(&mut tree, &name, value);
    }
    Some(tree)
}

/// Gives a parameter of a value tree another default.
fn set_default(tree: &mut Value, param: &str, value: Value) {
    let mut at = tree;
    for part in ["params", param, "default"] {
        let found = match &mut at.kind {
            ValueKind::Struct { fields, .. } => fields.iter_mut().find(|(name, _)| name.text == part).map(|(_, v)| v),
            ValueKind::Map(items) => {
                let is_key = |key: &Value| matches!(&key.kind, ValueKind::Str(text) if text == part);
                items.iter_mut().find(|(key, _)| is_key(key)).map(|(_, v)| v)
            }
            _ => None,
        };
        let Some(found) = found else { return };
        at = found;
    }
    *at = value;
}

/// Whether a change makes a calibrated estimate of the file one of another picture.
fn changes_the_view(change: &Override) -> bool {
    let parts = || change.path.split('.');
    !parts().next().into_iter().chain(parts().next_back()).any(|part| ["estimate", "look", "film"].contains(&part))
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
