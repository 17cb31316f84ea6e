//! What most commands share: the library of steps, loading, and talk on stderr.

use std::io::{IsTerminal, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bulbfold::diag::{Diagnostic, Diagnostics, Sources};
use bulbfold::engine::{Engine, Error, Formula};
use bulbfold::files::MAX_TEXT;
use bulbfold::formula::embedded;
use bulbfold::formula::library::Library;
use bulbfold::graph::ValidGraph;
use bulbfold::load::{Loaded, load, load_text};

use super::backend::try_hardware;
use super::observer::Terminal;
use super::progress::Progress;
use super::{Failure, message, usage};

/// A run of the program.
pub struct Session {
    /// Steps and texts.
    pub library: Library,
    /// Renders, and does all other work on back ends.
    pub engine: Engine,
    /// Whether progress, and what was done, is not to be told.
    pub quiet: bool,
    /// Whether stderr takes colour.
    colour: bool,
    /// The formula that was written to stdin.
    stdin: Option<String>,
}

fn read_stdin() -> Result<String, Failure> {
    let mut bytes = Vec::new();
    let read = std::io::stdin().lock().take(MAX_TEXT + 1).read_to_end(&mut bytes);
    let text = match read {
        Ok(_) if bytes.len() as u64 > MAX_TEXT => Err(format!("it has more than {MAX_TEXT} bytes")),
        Ok(_) => String::from_utf8(bytes)
            .map_err(|error| format!("byte {} is not UTF-8 text", error.utf8_error().valid_up_to())),
        Err(error) => Err(error.to_string()),
    };
    text.map_err(|why| {
        usage(format!("cannot read stdin: {why}"), "write a formula into it: `cat FILE | bulbfold render -`")
    })
}

/// Whether a text is a graph, which begins with a bracket behind comments, and no script.
fn is_graph(text: &str) -> bool {
    let mut rest = text.trim_start_matches('\u{feff}').trim_start();
    loop {
        rest = match (rest.strip_prefix("//"), rest.strip_prefix("/*")) {
            (Some(line), _) => line.split_once('\n').map_or("", |(_, rest)| rest).trim_start(),
            (_, Some(block)) => block.split_once("*/").map_or("", |(_, rest)| rest).trim_start(),
            _ => return rest.starts_with('('),
        };
    }
}

impl Session {
    /// The built-in steps and those of `folders`; whether steps that belong to others are read too, and whether only errors and warnings are told.
    pub fn new(folders: &[PathBuf], trusts_others: bool, quiet: bool) -> Result<Session, Failure> {
        let no_colour = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
        let colour = std::io::stderr().is_terminal() && !no_colour;
        let mut session = Session {
            library: Library::builtin(),
            engine: Engine::new().trying_hardware(try_hardware),
            quiet,
            colour,
            stdin: None,
        };
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
        let loaded = self.read(what.as_ref(), set, &mut d)?;
        self.report(d)?;
        loaded.ok_or_else(|| usage(format!("cannot load `{}`", what.as_ref().display()), ""))
    }

    /// Loads a file, a built-in fractal, or the text that is written to stdin.
    fn read(&mut self, what: &Path, set: &[(String, String)], d: &mut Diagnostics) -> Result<Option<Loaded>, Failure> {
        if !is_stdin(what) {
            return Ok(load(&mut self.library, what, set, d));
        }
        let text = match &self.stdin {
            Some(text) => text.clone(),
            None => self.stdin.insert(read_stdin()?).clone(),
        };
        let name = if is_graph(&text) { "stdin.ron" } else { "stdin.rhai" };
        Ok(load_text(&mut self.library, name, &text, set, d))
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
    pub fn watch(&self) -> Terminal<'_> {
        Terminal::new(self, self.quiet)
    }

    /// What tells the user of warnings alone.
    pub fn hushed(&self) -> Terminal<'_> {
        Terminal::new(self, true)
    }

    /// The progress of work of many parts.
    pub fn progress(&self) -> Progress {
        Progress::new(self.quiet)
    }

    /// Says what was done on stderr, unless that is not wanted.
    pub fn say(&self, text: &str) {
        if !self.quiet {
            talk(text);
        }
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
        let loaded = self.read(what, set, &mut d)?;
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

/// Whether a name means the formula that is written to stdin.
pub fn is_stdin(file: &Path) -> bool {
    file.as_os_str() == "-"
}

/// The formulas that `render` was asked for: one as it stands, or several of files, folders and patterns.
pub fn asked_files(first: &Path, more: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let is_known = [embedded::FRACTALS, embedded::SCENES].concat().iter().any(|(name, _)| first.as_os_str() == *name);
    if more.is_empty() && (is_known || !first.is_dir() && !is_pattern(first)) {
        return Ok(vec![first.to_path_buf()]);
    }
    formula_files(&[&[first.to_path_buf()], more].concat())
}

/// Formula files among `paths`: those of folders (`*.ron`, in order, inner folders included), those that match a pattern, and all else as it
/// stands.
pub fn formula_files(paths: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let mut files = Vec::new();
    for path in paths {
        let before = files.len();
        match is_pattern(path) {
            true => matching(path)?.iter().for_each(|path| collect(path, &mut files)),
            false => collect(path, &mut files),
        }
        if files.len() == before {
            let shown = path.display();
            let text = match is_pattern(path) {
                true => format!("no file matches {shown}"),
                false => format!("`{shown}` is a folder that holds no formula file (*.ron)"),
            };
            return Err(usage(text, ""));
        }
    }
    Ok(files)
}

/// Whether a name is a pattern that no shell has expanded.
fn is_pattern(path: &Path) -> bool {
    path.as_os_str().as_encoded_bytes().iter().any(|byte| b"*?[".contains(byte)) && !path.exists()
}

/// The files that match a pattern, in order.
fn matching(pattern: &Path) -> Result<Vec<PathBuf>, Failure> {
    let text = pattern.to_string_lossy();
    let found = glob::glob(&text);
    let found =
        found.map_err(|error| usage(format!("the pattern {text} is broken: {}", error.msg), "use * ? and [abc]"))?;
    Ok(found.flatten().take(MOST_FILES).collect())
}

/// Most files that a pattern stands for.
const MOST_FILES: usize = 10_000;

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
