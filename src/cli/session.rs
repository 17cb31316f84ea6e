//! What most commands share: the library of steps, loading, and talk on stderr.

use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bulbfold::diag::{Diagnostic, Diagnostics, Sources};
use bulbfold::engine::{Engine, Error, Formula};
use bulbfold::formula::library::Library;
use bulbfold::graph::ValidGraph;
use bulbfold::load::{Loaded, load};

use super::backend::try_hardware;
use super::watch::Watch;
use super::{Failure, message, usage};

/// A run of the program.
pub struct Session {
    /// Steps and texts.
    pub library: Library,
    /// Renders, and does all other work on back ends.
    pub engine: Engine,
    /// Whether stderr takes colour.
    colour: bool,
}

impl Session {
    /// The built-in steps and those of `folders`; and whether steps that belong to others are read too.
    pub fn new(folders: &[PathBuf], trusts_others: bool) -> Result<Session, Failure> {
        let no_colour = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
        let colour = std::io::stderr().is_terminal() && !no_colour;
        let mut session =
            Session { library: Library::builtin(), engine: Engine::new().trying_hardware(try_hardware), colour };
        session.library.trusts_others = trusts_others;
        let mut d = Diagnostics::default();
        for folder in folders {
            session.library.add_folder(folder, &mut d);
        }
        session.report(d)?;
        Ok(session)
    }

    /// Loads a fractal; its errors are the user's.
    pub fn load(&mut self, what: impl AsRef<Path>, set: &[(String, String)]) -> Result<Loaded, Failure> {
        let mut d = Diagnostics::default();
        let loaded = load(&mut self.library, &what, set, &mut d);
        self.report(d)?;
        loaded.ok_or_else(|| usage(format!("cannot load `{}`", what.as_ref().display()), ""))
    }

    /// Loads a fractal as the engine takes it.
    pub fn open(&mut self, what: impl AsRef<Path>, set: &[(String, String)]) -> Result<Arc<Formula>, Failure> {
        let loaded = self.load(what, set)?;
        Ok(Arc::new(Formula::of(self.library.clone(), loaded)))
    }

    /// The session as many pictures want it: kernels are kept from one to the next.
    pub fn keeping_kernels(&mut self) -> &Session {
        self.engine = std::mem::take(&mut self.engine).keeping_kernels();
        self
    }

    /// What tells the user of work.
    pub fn watch(&self, quiet: bool) -> Watch<'_> {
        Watch::new(self, quiet)
    }

    /// The failure for an error of the engine.
    pub fn failed(&self, error: Error) -> Failure {
        match error {
            Error::Formula(inner) => Failure::Usage(inner.messages.render(&inner.sources, self.colour)),
            Error::Request { text, help } => usage(text, &help),
            Error::Backend { error, help } => Failure::Work(message(&error.to_string(), help)),
            error @ (Error::Sink(_) | Error::Cancelled) => Failure::Work(message(&error.to_string(), "")),
        }
    }

    /// Loads a fractal for something that follows rays, which pictures of a plane have none of.
    pub fn load_solid(&mut self, file: &Path, set: &[(String, String)], what: &str) -> Result<ValidGraph, Failure> {
        let graph = self.load(file, set)?.graph;
        refuse_plane(&graph, what)?;
        Ok(graph)
    }

    /// Loads a fractal that has been loaded with other settings, without repeating warnings.
    pub fn load_again(&mut self, what: &Path, set: &[(String, String)]) -> Result<Loaded, Failure> {
        let mut d = Diagnostics::default();
        let loaded = load(&mut self.library, what, set, &mut d);
        match loaded {
            Some(loaded) => Ok(loaded),
            None => self.report(d).and(Err(usage(format!("cannot load `{}`", what.display()), ""))),
        }
    }

    /// Shows warnings on stderr; errors become a failure.
    pub fn report(&self, d: Diagnostics) -> Result<(), Failure> {
        if d.is_empty() {
            return Ok(());
        }
        let text = d.render(&self.library.sources, self.colour);
        if d.has_errors() {
            return Err(Failure::Usage(text));
        }
        let _ = write!(std::io::stderr(), "{text}");
        Ok(())
    }

    /// The failure for an error in a formula that showed only while it was composed.
    pub fn failure(&self, diagnostic: Diagnostic) -> Failure {
        let mut d = Diagnostics::default();
        d.push(diagnostic);
        Failure::Usage(d.render(&self.library.sources, self.colour))
    }

    /// Messages about texts of another library, as this session shows them.
    pub fn rendered(&self, d: &Diagnostics, sources: &Sources) -> String {
        d.render(sources, self.colour)
    }

    /// Says something on stderr, as a warning.
    pub fn warn(&self, text: &str) {
        let (what, help) = text.split_once('\n').unwrap_or((text, ""));
        let warning = Diagnostic::warning(what);
        self.tell(if help.is_empty() { warning } else { warning.help(help) });
    }

    /// Shows a message on stderr.
    pub fn tell(&self, message: Diagnostic) {
        let mut d = Diagnostics::default();
        d.push(message);
        let _ = write!(std::io::stderr(), "{}", d.render(&self.library.sources, self.colour));
    }
}

/// Tells that something follows rays where pictures of the fractal show a plane.
pub fn refuse_plane(graph: &ValidGraph, what: &str) -> Result<(), Failure> {
    match graph.scene.plane {
        None => Ok(()),
        Some(_) => Err(usage(
            format!("{what} follows rays, and a picture of `{}` shows the points of a plane", graph.name),
            "`bulbfold probe` gives the estimates of points, `bulbfold check` searches a formula for faults",
        )),
    }
}

/// Formula files among `paths`: those of folders (`*.ron`, in order, inner folders included), and all else as it stands.
pub fn formula_files(paths: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let mut files = Vec::new();
    for path in paths {
        let before = files.len();
        collect(path, &mut files);
        if files.len() == before {
            return Err(usage(format!("the folder {} holds no formula file (*.ron)", path.display()), ""));
        }
    }
    Ok(files)
}

fn collect(path: &Path, files: &mut Vec<PathBuf>) {
    if !path.is_dir() {
        return files.push(path.to_path_buf());
    }
    let mut entries: Vec<_> = std::fs::read_dir(path).into_iter().flatten().flatten().map(|e| e.path()).collect();
    entries.sort();
    // A link may lead back up.
    let wanted = |path: &PathBuf| !path.is_symlink() && (path.is_dir() || path.extension().is_some_and(|e| e == "ron"));
    entries.iter().filter(|path| wanted(path)).for_each(|entry| collect(entry, files));
}

/// Says something on stderr.
pub fn talk(text: &str) {
    let _ = writeln!(std::io::stderr(), "{}", bulbfold::diag::printable(text));
}
