//! The steps and materials that formulas can use: the built-in ones and those of a user's folders, found and read alike.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use super::embedded;
use super::material::{Material, is_material_text};
use super::script::ScriptEngine;
use super::shape::is_step_text;
use super::step::Step;
use crate::diag::{Diagnostic, Diagnostics, SourceId, Sources, Span};
use crate::files::{Chosen, FileId, MAX_TEXT, is_foreign, read_text};

/// Most bytes of all scripts beside a formula.
const MAX_BESIDE: usize = 32 << 20;

/// All texts read so far, the script engine, and the steps found. A copy shares what it can, and costs some microseconds.
#[derive(Clone)]
pub struct Library {
    /// Every text that a message may point into.
    pub sources: Sources,
    /// Runs step files, parameter expressions and graph scripts.
    pub engine: Arc<ScriptEngine>,
    steps: BTreeMap<String, Arc<Entry<Step>>>,
    materials: BTreeMap<String, Arc<Entry<Material>>>,
    /// Names of step and material files with errors.
    broken: BTreeSet<String>,
    /// Whether steps are read that lie in a folder of another user. They are scripts that the user did not name.
    pub trusts_others: bool,
    /// Files that were read.
    inputs: Vec<FileId>,
    /// What pipes said, which they do only once.
    piped: BTreeMap<PathBuf, String>,
}

/// The file of a step or material, and what it holds. Built-in ones are read when they are first asked for: a picture needs few of them, and to
/// read all takes longer than a small one.
struct Entry<T> {
    text: SourceId,
    read: OnceLock<Arc<T>>,
}

impl<T> Entry<T> {
    /// What the file holds. Panics if a built-in file has an error, which a test rules out.
    fn get(&self, library: &Library, read: impl Fn(&mut Diagnostics) -> Option<T>) -> &Arc<T> {
        self.read.get_or_init(|| {
            let mut diagnostics = Diagnostics::default();
            let found = read(&mut diagnostics);
            let errors = || diagnostics.render(&library.sources, false);
            Arc::new(found.unwrap_or_else(|| panic!("built-in files are broken:\n{}", errors())))
        })
    }
}

impl Library {
    /// The built-in steps.
    pub fn builtin() -> Library {
        static BUILTIN: OnceLock<Library> = OnceLock::new();
        BUILTIN.get_or_init(Library::unread).clone()
    }

    /// The built-in steps, none of which is read yet.
    fn unread() -> Library {
        let mut library = Library {
            sources: Sources::default(),
            engine: Arc::new(ScriptEngine::new()),
            steps: BTreeMap::new(),
            materials: BTreeMap::new(),
            broken: BTreeSet::new(),
            trusts_others: false,
            inputs: Vec::new(),
            piped: BTreeMap::new(),
        };
        for (name, text) in embedded::STEPS {
            let text = library.sources.add(format!("formulas/steps/{name}.rhai"), *text);
            library.steps.insert(name.to_string(), Arc::new(Entry { text, read: OnceLock::new() }));
        }
        for (name, text) in embedded::MATERIALS {
            let text = library.sources.add(format!("formulas/materials/{name}.rhai"), *text);
            library.materials.insert(name.to_string(), Arc::new(Entry { text, read: OnceLock::new() }));
        }
        library
    }

    fn read<'a>(&self, name: &str, entry: &'a Entry<Step>) -> &'a Arc<Step> {
        entry.get(self, |d| Step::read(&self.engine, &self.sources, entry.text, name, d))
    }

    fn read_material<'a>(&self, name: &str, entry: &'a Entry<Material>) -> &'a Arc<Material> {
        entry.get(self, |d| Material::read(&self.engine, &self.sources, entry.text, name, d))
    }

    fn add_step(&mut self, name: &str, id: SourceId, diagnostics: &mut Diagnostics) {
        let mut own = Diagnostics::default();
        let step = Step::read(&self.engine, &self.sources, id, name, &mut own);
        let unknown = Step::unknown_names(&self.engine, &self.sources, id, step.as_ref());
        if let Some(step) = self.without_errors(name, step, own, unknown, diagnostics) {
            let entry = Entry { text: id, read: OnceLock::from(Arc::new(step)) };
            self.steps.insert(name.to_string(), Arc::new(entry));
        }
    }

    fn add_material(&mut self, name: &str, id: SourceId, diagnostics: &mut Diagnostics) {
        let mut own = Diagnostics::default();
        let material = Material::read(&self.engine, &self.sources, id, name, &mut own);
        let unknown = Material::unknown_names(&self.engine, &self.sources, id, material.as_ref());
        if let Some(material) = self.without_errors(name, material, own, unknown, diagnostics) {
            let entry = Entry { text: id, read: OnceLock::from(Arc::new(material)) };
            self.materials.insert(name.to_string(), Arc::new(entry));
        }
    }

    /// What was read of a file, where its text names nothing unknown; otherwise the file is a broken one.
    fn without_errors<T>(
        &mut self,
        name: &str,
        read: Option<T>,
        own: Diagnostics,
        unknown: Vec<Diagnostic>,
        diagnostics: &mut Diagnostics,
    ) -> Option<T> {
        let read = read.filter(|_| unknown.is_empty());
        // What stops the description is told once, and in the better words.
        let is_new = |found: &Diagnostic| unknown.iter().all(|known| known.span() != found.span());
        diagnostics.extend(own.into_iter().filter(is_new).collect::<Vec<_>>());
        diagnostics.extend(unknown);
        match read.is_some() {
            true => drop(self.broken.remove(name)),
            false => drop(self.broken.insert(name.to_string())),
        }
        read
    }

    /// Reads every `*.rhai` of a folder as a step or a material. One of a built-in name replaces the built-in one, with a warning.
    pub fn add_folder(&mut self, folder: &Path, diagnostics: &mut Diagnostics) {
        let entries = match std::fs::read_dir(folder) {
            Ok(entries) => entries,
            Err(error) => {
                let message = format!("cannot read the step folder {}: {error}", folder.display());
                diagnostics.push(Diagnostic::error(message));
                return;
            }
        };
        let mut files: Vec<_> = entries.flatten().map(|entry| entry.path()).collect();
        files.sort();
        for file in files.iter().filter(|file| file.extension().is_some_and(|e| e == "rhai")) {
            self.add_step_file(file, diagnostics);
        }
    }

    /// Reads the steps and materials that lie beside a formula file: every `*.rhai` that defines `fn step`, `fn distance` or `fn material`. An empty path is the current
    /// folder. Files that are too large or not regular, and files of another user, are left out with a warning.
    pub fn add_beside(&mut self, folder: &Path, diagnostics: &mut Diagnostics) {
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        let mut files: Vec<_> =
            std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()).collect();
        files.sort();
        let mut left_out = |file: &Path, why: &str| {
            let message = format!("the script {} is left out: {why}", file.display());
            diagnostics.push(Diagnostic::warning(message).label(Span::NONE, ""));
        };
        let (mut steps, mut foreign, mut bytes) = (Vec::new(), None, 0);
        let is_others = is_foreign(folder);
        for file in files.into_iter().filter(|file| file.extension().is_some_and(|e| e == "rhai")) {
            match read_text(&file, MAX_TEXT, Chosen::Found) {
                Err(error) => left_out(&file, &error.to_string()),
                Ok(text) if !is_step_text(&text) && !is_material_text(&text) => {}
                Ok(_) if !self.trusts_others && (is_others || is_foreign(&file)) => foreign = Some(file),
                Ok(text) if bytes + text.len() > MAX_BESIDE => left_out(&file, "there are too many scripts beside it"),
                Ok(text) => {
                    bytes += text.len();
                    steps.push((file, text));
                }
            }
        }
        if let Some(file) = foreign {
            let message = format!("steps that belong to another user are left out, such as {}", file.display());
            let help = "steps are scripts: `--trust` reads these too";
            diagnostics.push(Diagnostic::warning(message).label(Span::NONE, "").help(help));
        }
        for (file, text) in steps {
            self.add_step_text(&file, text, diagnostics);
        }
    }

    /// Reads a step file that was named, or that lies in a folder that was.
    pub fn add_step_file(&mut self, file: &Path, diagnostics: &mut Diagnostics) {
        match read_text(file, MAX_TEXT, Chosen::Found) {
            Ok(text) => self.add_step_text(file, text, diagnostics),
            Err(error) => diagnostics.push(Diagnostic::error(format!("cannot read {}: {error}", file.display()))),
        }
    }

    /// The text of a file that was named. A pipe gives the same text each time.
    ///
    /// Errors: those of [`read_text`].
    pub fn read_named(&mut self, path: &Path) -> std::io::Result<String> {
        if let Some(text) = self.piped.get(path) {
            return Ok(text.clone());
        }
        let text = read_text(path, MAX_TEXT, Chosen::Named)?;
        match path.is_file() {
            true => self.inputs.extend(FileId::of(path)),
            false => drop(self.piped.insert(path.to_path_buf(), text.clone())),
        }
        Ok(text)
    }

    /// Adds a file to those that were read.
    pub fn note_input(&mut self, path: &Path) {
        self.inputs.extend(FileId::of(path));
    }

    /// The files that were read, which no output may replace.
    pub fn inputs(&self) -> &[FileId] {
        &self.inputs
    }

    /// Reads a step or a material from its text; the file's name names it.
    pub fn add_step_text(&mut self, file: &Path, text: String, diagnostics: &mut Diagnostics) {
        let name = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        self.inputs.extend(FileId::of(file));
        let is_material = is_material_text(&text);
        let (what, known) = match is_material {
            true => ("material", self.materials.get(&name).map(|known| known.text)),
            false => ("step", self.steps.get(&name).map(|known| known.text)),
        };
        if let Some(known) = known {
            if self.sources.text(known) == text {
                return;
            }
            let message =
                format!("the {what} `{name}` of {} replaces the built-in {what} of that name", file.display());
            diagnostics.push(Diagnostic::warning(message).label(Span::NONE, ""));
        }
        let id = self.sources.add(file.display().to_string(), text);
        match is_material {
            true => self.add_material(&name, id, diagnostics),
            false => self.add_step(&name, id, diagnostics),
        }
    }

    /// The material of this name.
    pub fn material(&self, name: &str) -> Option<&Arc<Material>> {
        self.materials.get(name).map(|entry| self.read_material(name, entry))
    }

    /// All materials by name.
    pub fn materials(&self) -> impl Iterator<Item = &Arc<Material>> {
        self.materials.iter().map(|(name, entry)| self.read_material(name, entry))
    }

    /// Names of all materials.
    pub fn material_names(&self) -> impl Iterator<Item = &str> {
        self.materials.keys().map(String::as_str)
    }

    /// The step of this name.
    pub fn step(&self, name: &str) -> Option<&Arc<Step>> {
        self.steps.get(name).map(|entry| self.read(name, entry))
    }

    /// Whether a file of this name was read whose errors were reported, so that its uses need no message.
    pub fn is_broken(&self, name: &str) -> bool {
        self.broken.contains(name)
    }

    /// Names of all such files.
    pub fn broken(&self) -> impl Iterator<Item = &str> {
        self.broken.iter().map(String::as_str)
    }

    /// Names of all steps.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.steps.keys().map(String::as_str)
    }

    /// All steps by name.
    pub fn steps(&self) -> impl Iterator<Item = &Arc<Step>> {
        self.steps.iter().map(|(name, entry)| self.read(name, entry))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn built_in_steps_are_read_when_they_are_asked_for() {
        let library = Library::unread();
        let read = || library.steps.values().filter(|entry| entry.read.get().is_some()).count();
        assert_eq!((read(), library.names().count()), (0, embedded::STEPS.len()));
        assert_eq!(library.step("box_fold").expect("a built-in step").name, "box_fold");
        assert!(library.step("no_such_step").is_none());
        assert_eq!(read(), 1);
        assert_eq!(library.steps().count(), embedded::STEPS.len());
    }
}
