//! What is watched: the formula as its file has it, what was moved since, and the last picture.

use std::io::Write;
use std::path::PathBuf;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use bulbfold::diag::{Diagnostic, Diagnostics};
use bulbfold::engine::{Engine, Error, Formula, Request, Stage};
use bulbfold::film::Image;
use bulbfold::formula::library::Library;
use bulbfold::graph::Camera;
use bulbfold::live::{Movement, Part, Screen, Shown, Sight, Slider, Viewer, Wanted, camera_text, sliders, written};
use bulbfold::load::load;
use bulbfold::render::Clearance;
use serde::Serialize;

use crate::cli::camera::flags;
use crate::cli::preview;
use crate::cli::progress::short;
use crate::cli::session::{Session, talk};

/// Changes of a formula: pairs of a path and a value.
type Changes = Vec<(String, String)>;

/// What is watched, for the thread that reads files, for those that answer the page, and for the one that renders.
pub struct Desk {
    /// Tells people, and knows the steps that every reading begins with.
    session: Mutex<Session>,
    library: Library,
    engine: Arc<Engine>,
    file: PathBuf,
    /// What the command line changes in it.
    changes: Changes,
    request: Request,
    shows: bool,
    viewer: Mutex<Option<Viewer>>,
    state: Mutex<State>,
    changed: Condvar,
}

/// A formula as its file has it now.
struct Read {
    formula: Arc<Formula>,
    /// The formula with what was moved.
    seen: Arc<Formula>,
    /// What makes it of the file's.
    changes: Changes,
    text: String,
    warnings: Vec<String>,
    sliders: Vec<Slider>,
    clearance: Option<Arc<Clearance>>,
}

#[derive(Default)]
struct State {
    /// Grows with every change that the page should know.
    version: u64,
    /// The last wish; pictures of older ones are out of date.
    wish: u64,
    read: Option<Read>,
    sight: Sight,
    /// Where the last picture was seen from.
    camera: Option<Camera>,
    picture: Option<Arc<Image>>,
    /// How many there were.
    pictures: u64,
    part: Option<Part>,
    took: Duration,
    first: Duration,
    progress: f64,
    message: String,
    warnings: Vec<String>,
}

/// What the page knows.
#[derive(Serialize)]
pub struct Told {
    version: u64,
    /// Number of the last picture.
    picture: u64,
    file: String,
    /// Columns and rows of the picture, and of the whole one.
    size: [u32; 2],
    whole: [u32; 2],
    /// How fine the picture is: `first`, `finer`, `whole`, or nothing yet.
    part: &'static str,
    took_ms: f64,
    first_ms: f64,
    progress: f64,
    /// What is wrong with the file; empty where nothing is.
    message: String,
    warnings: Vec<String>,
    sliders: Vec<Moved>,
    presets: Vec<[String; 2]>,
    preset: Option<String>,
    /// The camera as arguments and as text of a file; empty of a plane.
    flags: String,
    camera: String,
    is_moved: bool,
    can_write: bool,
}

/// A slider where it stands now.
#[derive(Serialize)]
struct Moved {
    path: String,
    help: String,
    least: f64,
    most: f64,
    value: f64,
    is_whole: bool,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Desk {
    /// Nothing is read yet. `shows` says whether the terminal shows pictures.
    pub fn new(mut session: Session, (file, changes): (PathBuf, Changes), request: Request, shows: bool) -> Arc<Desk> {
        session.keeping_kernels();
        let engine = Arc::new(std::mem::take(&mut session.engine));
        let library = session.library.clone();
        let desk = Arc::new(Desk {
            session: Mutex::new(session),
            library,
            engine: engine.clone(),
            file,
            changes,
            request,
            shows,
            viewer: Mutex::new(None),
            state: Mutex::new(State::default()),
            changed: Condvar::new(),
        });
        *locked(&desk.viewer) = Some(Viewer::start(engine, OnDesk(desk.clone())));
        desk
    }

    /// The files that the formula was read from.
    pub fn files(&self) -> Vec<PathBuf> {
        let state = locked(&self.state);
        let library = state.read.as_ref().map(|read| read.formula.library());
        library
            .map(|library| library.sources.names().map(PathBuf::from).filter(|path| path.is_file()).collect())
            .unwrap_or_default()
    }

    /// Reads the file anew, and shows it; `is_last` tells what is wrong with it. Returns whether it could be read.
    pub fn read(&self, since: Instant, is_last: bool) -> bool {
        let (formula, d, library) = self.opened(&[]);
        let Some((formula, text)) = formula else {
            if is_last {
                self.tell_of(&d, &library);
            }
            return false;
        };
        let before = {
            let mut state = locked(&self.state);
            state.message.clear();
            let sliders = sliders(&formula);
            // What stands no more in the file, or stands there by now, is not moved any more.
            state.sight.numbers.retain(|path, value| sliders.iter().any(|s| s.path == *path && s.value != *value));
            let known = |name: &String| formula.graph().presets.iter().any(|preset| preset.name == *name);
            state.sight.preset = state.sight.preset.take().filter(known);
            let own = formula.graph().scene.camera;
            if state.sight.camera.is_some() && state.sight.camera == own {
                state.sight.camera = None;
            }
            let warnings = d.iter().map(|warning| warning.message.clone()).collect();
            let (seen, changes) = (formula.clone(), Changes::new());
            state.read = Some(Read { seen, formula, changes, text, warnings, sliders, clearance: None });
            state.sight.clone()
        };
        if !d.is_empty() {
            let _ = write!(std::io::stderr(), "{}", locked(&self.session).rendered(&d, &library.sources));
        }
        let see = |sight: Sight| self.see(sight, (since, false));
        see(before).or_else(|_| see(Sight::default())).is_ok()
    }

    /// The formula with changes, and its text; what is said of it, with its texts.
    fn opened(&self, changes: &[(String, String)]) -> (Option<(Arc<Formula>, String)>, Diagnostics, Library) {
        let (mut library, mut d) = (self.library.clone(), Diagnostics::default());
        let all: Changes = self.changes.iter().chain(changes).cloned().collect();
        let loaded = load(&mut library, &self.file, &all, &mut d).filter(|_| !d.has_errors());
        let formula = loaded.map(|loaded| {
            let text = library.sources.text(loaded.text).to_string();
            (Arc::new(Formula::of(library.clone(), loaded)), text)
        });
        (formula, d, library)
    }

    fn tell_of(&self, d: &Diagnostics, library: &Library) {
        let text = locked(&self.session).rendered(d, &library.sources);
        let _ = write!(std::io::stderr(), "{text}");
        self.change(|state| state.message = d.render(&library.sources, false));
    }

    /// Shows the formula with what was moved.
    ///
    /// Errors: a number that the formula cannot have, such as one out of its range.
    fn see(&self, sight: Sight, (since, is_moving): (Instant, bool)) -> Result<(), String> {
        let changes = sight.changes();
        let is_other = locked(&self.state).read.as_ref().is_none_or(|read| read.changes != changes);
        let mut seen = None;
        if is_other {
            let (formula, d, library) = self.opened(&changes);
            seen = Some(formula.ok_or_else(|| d.render(&library.sources, false))?.0);
        }
        let mut state = locked(&self.state);
        let Some(read) = &mut state.read else { return Err("nothing is read yet".into()) };
        if let Some(seen) = seen {
            (read.seen, read.changes, read.clearance) = (seen, changes, None);
        }
        let wanted =
            Wanted { formula: read.seen.clone(), request: self.request.clone(), camera: sight.camera, is_moving };
        state.sight = sight;
        state.progress = 0.0;
        state.warnings.clear();
        if let Some(viewer) = &*locked(&self.viewer) {
            state.wish = viewer.show_since(wanted, since);
        }
        state.version += 1;
        self.changed.notify_all();
        Ok(())
    }

    /// Changes what was moved.
    fn moved(&self, is_moving: bool, change: impl FnOnce(&mut Sight) -> Result<(), String>) -> Result<(), String> {
        let mut sight = locked(&self.state).sight.clone();
        change(&mut sight)?;
        self.see(sight, (Instant::now(), is_moving))
    }

    /// Moves the camera.
    pub fn move_camera(&self, movement: Movement, is_moving: bool) -> Result<(), String> {
        let (camera, seen) = {
            let state = locked(&self.state);
            (state.sight.camera.or(state.camera), state.read.as_ref().map(|read| read.seen.clone()))
        };
        let (Some(camera), Some(seen)) = (camera, seen) else { return Err("there is no camera to move".into()) };
        let distance = if movement.goes_by_distance() { self.distance(&seen, camera) } else { None };
        let camera = movement.apply(camera, distance).map_err(|error| error.to_string())?;
        self.moved(is_moving, |sight| {
            sight.camera = Some(camera);
            Ok(())
        })
    }

    /// The distance from a camera to the surface; none where no estimate can be made.
    fn distance(&self, seen: &Arc<Formula>, camera: Camera) -> Option<f64> {
        let known = locked(&self.state).read.as_ref().and_then(|read| read.clearance.clone());
        let clearance = match known {
            Some(known) => known,
            None => Arc::new(self.engine.clearance(seen, &self.request).ok()?),
        };
        let distance = clearance.of(&[camera.position]).first().copied();
        if let Some(read) = locked(&self.state).read.as_mut().filter(|read| Arc::ptr_eq(&read.seen, seen)) {
            read.clearance = Some(clearance);
        }
        distance
    }

    /// Moves a number.
    pub fn set(&self, path: &str, value: f64, is_moving: bool) -> Result<(), String> {
        let known = locked(&self.state).read.as_ref().is_some_and(|read| read.sliders.iter().any(|s| s.path == path));
        if !known || !value.is_finite() {
            return Err(format!("there is no number `{path}` to set to {value}"));
        }
        self.moved(is_moving, |sight| {
            sight.numbers.insert(path.to_string(), value);
            Ok(())
        })
    }

    /// Shows a preset, or the file's own view; numbers and the camera go back.
    pub fn take_preset(&self, preset: Option<String>) -> Result<(), String> {
        self.moved(false, |sight| {
            *sight = Sight { preset, ..Sight::default() };
            Ok(())
        })
    }

    /// Writes what was moved into the file.
    pub fn write(&self) -> Result<(), String> {
        let (sight, text) = {
            let state = locked(&self.state);
            (state.sight.clone(), state.read.as_ref().map(|read| read.text.clone()).unwrap_or_default())
        };
        let now = std::fs::read_to_string(&self.file).map_err(|error| format!("cannot read the file: {error}"))?;
        if now != text {
            return Err("the file was changed meanwhile; look at it first, then write".into());
        }
        let new = written(&text, &sight)?;
        let (mut library, mut d) = (self.library.clone(), Diagnostics::default());
        let name = self.file.display().to_string();
        bulbfold::load::load_text(&mut library, &name, &new, &self.changes, &mut d);
        if d.has_errors() {
            return Err(d.render(&library.sources, false));
        }
        bulbfold::files::write(&self.file, new.as_bytes())
            .map_err(|error| format!("cannot write the file: {error}"))?;
        talk(&format!("wrote {name}"));
        // The file says now what was moved.
        locked(&self.state).sight = Sight::default();
        self.read(Instant::now(), true);
        Ok(())
    }

    fn change(&self, change: impl FnOnce(&mut State)) {
        let mut state = locked(&self.state);
        change(&mut state);
        state.version += 1;
        self.changed.notify_all();
    }

    /// What the page should know, as soon as it is something else than a version, or after a while.
    pub fn told(&self, after: u64, patience: Duration) -> Told {
        let mut state = locked(&self.state);
        let end = Instant::now() + patience;
        while state.version <= after && Instant::now() < end {
            let left = end.saturating_duration_since(Instant::now());
            state = self.changed.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0;
        }
        self.snapshot(&state)
    }

    fn snapshot(&self, state: &State) -> Told {
        let of = |slider: &Slider| Moved {
            path: slider.path.clone(),
            help: slider.help.clone(),
            least: slider.range[0],
            most: slider.range[1],
            value: state.sight.numbers.get(&slider.path).copied().unwrap_or(slider.value),
            is_whole: slider.is_whole,
        };
        let read = state.read.as_ref();
        let graph = read.map(|read| read.seen.graph());
        let presets = graph.map(|graph| graph.presets.iter().map(|p| [p.name.clone(), p.help.clone()]).collect());
        let camera = state.sight.camera.or(state.camera);
        let own = read.and_then(|read| read.formula.graph().scene.camera);
        Told {
            version: state.version,
            picture: state.pictures,
            file: self.file.display().to_string(),
            size: state.picture.as_ref().map_or([0; 2], |image| [image.size.width, image.size.height]),
            whole: [self.request.size.width, self.request.size.height],
            part: match state.part {
                None => "",
                Some(Part::First) => "first",
                Some(Part::Finer) => "finer",
                Some(Part::Whole) => "whole",
            },
            took_ms: 1e3 * state.took.as_secs_f64(),
            first_ms: 1e3 * state.first.as_secs_f64(),
            progress: state.progress,
            message: state.message.clone(),
            warnings: read.iter().flat_map(|read| &read.warnings).chain(&state.warnings).cloned().collect(),
            sliders: read.map(|read| read.sliders.iter().map(of).collect()).unwrap_or_default(),
            presets: presets.unwrap_or_default(),
            preset: state.sight.preset.clone(),
            flags: camera.map(|camera| flags(&camera, own).join(" ")).unwrap_or_default(),
            camera: camera.map(|camera| camera_text(&camera)).unwrap_or_default(),
            is_moved: state.sight.is_moved(),
            can_write: self.file.extension().is_some_and(|end| end.eq_ignore_ascii_case("ron")),
        }
    }

    /// The last picture.
    pub fn picture(&self) -> Option<Arc<Image>> {
        locked(&self.state).picture.clone()
    }
}

/// Puts pictures on a desk.
struct OnDesk(Arc<Desk>);

impl Screen for OnDesk {
    fn show(&mut self, shown: Shown) {
        let desk = &self.0;
        if shown.part == Part::Whole {
            if desk.shows {
                preview::show(&shown.image);
            }
            let first = locked(&desk.state).first;
            let size = shown.image.size;
            locked(&desk.session).say(&format!(
                "first picture {}, {}x{} {}",
                short(first),
                size.width,
                size.height,
                short(shown.took)
            ));
        }
        desk.change(|state| {
            state.camera = shown.camera;
            state.part = Some(shown.part);
            state.took = shown.took;
            if shown.part == Part::First {
                state.first = shown.took;
                state.progress = 0.0;
            }
            state.picture = Some(Arc::new(shown.image));
            state.pictures += 1;
        });
    }

    fn progress(&mut self, _: u64, stage: Stage, share: f64) {
        if stage == Stage::Rendering {
            locked(&self.0.state).progress = share;
        }
    }

    fn warn(&mut self, wish: u64, warning: Diagnostic) {
        let desk = &self.0;
        locked(&desk.session).tell(warning.clone());
        desk.change(|state| {
            if state.wish == wish {
                state.warnings.push(warning.message);
            }
        });
    }

    fn fail(&mut self, _: u64, error: Error) {
        let desk = &self.0;
        let text = match &error {
            Error::Formula(inner) => inner.messages.render(&inner.sources, false),
            other => other.to_string(),
        };
        talk(&text);
        desk.change(|state| state.message = text);
    }
}
