//! The moments of a film: what its formula and its camera are at each of them.

use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

use bulbfold::diag::{Diagnostic, Diagnostics};
use bulbfold::engine::path::{CameraPath, PathSettings, View};
use bulbfold::engine::{CameraChange, Engine, Error, Formula, FormulaMessages, Moment, Moments, Request, Zoom};
use bulbfold::formula::library::Library;
use bulbfold::graph::motion::{self, CameraMotion, Ease, KeyView, Rate};
use bulbfold::graph::{Camera, PRESET};
use bulbfold::load::load;
use bulbfold::motion::Moves;

use super::camera::CameraArgs;
use super::range::Range;

/// Pairs of a path and a value, as `--set` takes them.
type Changes = Vec<(String, String)>;

/// Opens a formula with one set of values after another. Its warnings were told when it was opened first.
pub struct Loader {
    /// Steps and texts.
    pub library: Library,
    /// The formula.
    pub file: PathBuf,
}

impl Loader {
    /// The formula with these values.
    pub fn open(&self, set: &[(String, String)]) -> Result<Arc<Formula>, Error> {
        let (mut library, mut messages) = (self.library.clone(), Diagnostics::default());
        match load(&mut library, &self.file, set, &mut messages).filter(|_| !messages.has_errors()) {
            Some(loaded) => Ok(Arc::new(Formula::of(library, loaded))),
            None => Err(Error::Formula(Box::new(FormulaMessages { messages, sources: library.sources }))),
        }
    }

    /// The failure for a message about the formula's texts.
    pub fn failed(&self, message: Diagnostic) -> Error {
        let mut messages = Diagnostics::default();
        messages.push(message);
        Error::Formula(Box::new(FormulaMessages { messages, sources: self.library.sources.clone() }))
    }
}

/// The times of a film.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Clock {
    /// Frames a second.
    pub rate: Rate,
    /// Frames of the whole film.
    pub frames: u32,
    /// Moments that each frame is the average of.
    pub blur: u32,
    /// The share of a frame in which they lie, around the frame's own time.
    pub shutter: f64,
}

impl Clock {
    /// The frame of a moment, with the fraction that the shutter makes.
    fn frame(&self, moment: usize) -> f64 {
        let (frame, k) = (moment as u32 / self.blur, moment as u32 % self.blur);
        let offset = (f64::from(k) + 0.5) / f64::from(self.blur) - 0.5;
        f64::from(frame) + if self.blur > 1 { self.shutter * offset } else { 0.0 }
    }
}

/// The way of a film's camera, ready to be asked.
pub enum Way {
    /// None.
    Still,
    /// A change for each share of the film.
    Move(CameraMotion),
    /// Through views.
    Path(Box<CameraPath>),
}

/// A film by tracks, sweeps and the way of a camera.
pub struct FilmMoments {
    /// The formula.
    pub loader: Loader,
    /// What the command line changes of it.
    pub changes: Changes,
    /// What it changes of the camera.
    pub camera: CameraArgs,
    /// Values that go from the first to the last frame.
    pub ranges: Vec<Range>,
    /// The formula's tracks.
    pub moves: Option<Moves>,
    /// The way of its camera.
    pub way: Way,
    /// Its times.
    pub clock: Clock,
    /// The formula of all moments, where it is one.
    pub still: OnceLock<Arc<Formula>>,
}

impl FilmMoments {
    /// The change of the camera at a frame, beside what tracks say of it.
    fn change(&self, frame: f64, tracked: CameraArgs) -> CameraChange {
        let mut own = tracked;
        for range in &self.ranges {
            let value = || range.numbers(frame, self.clock.frames);
            let vector = || <[f64; 3]>::try_from(value()).ok();
            match range.name.as_str() {
                "camera" => own.camera = vector(),
                "target" => own.target = vector(),
                "up" => own.up = vector(),
                "fov" => own.fov = value().first().copied(),
                "turn" => own.turn = value().first().map(|degrees| degrees.to_radians()),
                _ => {}
            }
        }
        let change = own.change();
        let time = self.clock.rate.time(frame);
        // A film that repeats is whole before its last frame: the next one would be the first.
        let share = (frame / f64::from(self.clock.frames)).clamp(0.0, 1.0);
        let last = f64::from(self.clock.frames.max(2) - 1);
        let eased = Ease::Smooth.at(frame / last);
        match &self.way {
            Way::Still => change,
            Way::Move(CameraMotion::Turntable { turns }) => CameraChange {
                turn: Some(change.turn.unwrap_or(0.0) + turns * share * std::f64::consts::TAU),
                ..change
            },
            Way::Move(CameraMotion::Orbit { turns, lift }) => {
                let angle = std::f64::consts::TAU * share;
                CameraChange { orbit: Some([turns * angle, lift * angle.sin()]), ..change }
            }
            Way::Move(CameraMotion::Dolly { to }) => {
                CameraChange { dolly: Some(change.dolly.unwrap_or(1.0) * to.powf(eased)), ..change }
            }
            Way::Move(_) => change,
            Way::Path(path) => {
                let Camera { position, target, up, fov, lens, near, far, .. } = path.at(time).camera;
                CameraChange {
                    position: change.position.or(Some(position)),
                    target: change.target.or(Some(target)),
                    up: change.up.or(Some(up)),
                    fov: change.fov.or(Some(fov)),
                    lens: change.lens.or(Some(lens)),
                    near: change.near.or(Some(near)),
                    far: change.far.or(far),
                    ..change
                }
            }
        }
    }

    /// The changes of the formula at a frame, and those of its camera, which light does not follow.
    fn set(&self, frame: f64) -> Result<(Changes, CameraArgs), Error> {
        let (mut set, mut camera) = (self.changes.clone(), self.camera);
        if let Some(moves) = &self.moves {
            let time = self.clock.rate.time(frame);
            let moved = moves.at(&self.loader.library, time).map_err(|message| self.loader.failed(message))?;
            set.extend(moved.into_iter().filter(|(path, value)| !camera.takes(path, value)));
        }
        let moved = self.ranges.iter().filter(|range| !range.is_of_view());
        set.extend(moved.map(|range| (range.name.clone(), range.ron(frame, self.clock.frames))));
        Ok((set, camera))
    }

    /// Whether nothing but the camera's way moves.
    fn is_still(&self) -> bool {
        self.moves.as_ref().is_none_or(|moves| moves.motion().tracks.is_empty() && moves.motion().script.is_none())
            && self.ranges.iter().all(Range::is_of_view)
    }
}

impl Moments for FilmMoments {
    fn count(&self) -> usize {
        self.clock.frames as usize * self.clock.blur as usize
    }

    fn moment(&self, number: usize) -> Result<Moment, Error> {
        let frame = self.clock.frame(number);
        if let Some(formula) = self.still.get() {
            return Ok(Moment { formula: formula.clone(), camera: self.change(frame, self.camera) });
        }
        let (set, tracked) = self.set(frame)?;
        let camera = self.change(frame, tracked);
        let formula = self.loader.open(&set)?;
        if self.is_still() {
            let _ = self.still.set(formula.clone());
        }
        Ok(Moment { formula, camera })
    }

    fn show_one_set(&self) -> bool {
        self.moves.as_ref().is_none_or(Moves::moves_the_view_alone) && self.ranges.iter().all(Range::is_of_view)
    }
}

/// Makes the way of a formula's camera ready: views of presets are looked up, the distances to the surface measured.
///
/// Errors: [`Error::Formula`], [`Error::Request`].
pub fn way_of(
    (engine, loader): (&Engine, &Loader),
    (formula, changes): (&Arc<Formula>, &[(String, String)]),
    request: &Request,
    (motion, seconds): (&CameraMotion, f64),
) -> Result<Way, Error> {
    let own = || -> Result<Camera, Error> {
        engine.camera(formula, request)?.ok_or_else(|| {
            let text = "a picture of a plane has no camera that could move".to_string();
            Error::Request { text, help: "drop `animation.camera`".into() }
        })
    };
    let (views, settings, of_keys) = match motion {
        CameraMotion::Path(path) => {
            let view = |key: &motion::CameraKey| -> Result<View, Error> {
                let camera = match &key.view {
                    KeyView::Own => own()?,
                    KeyView::Camera(camera) => **camera,
                    KeyView::Preset(name) => {
                        let preset = (PRESET.to_string(), format!("{name:?}"));
                        let set: Changes = std::iter::once(preset).chain(changes.iter().cloned()).collect();
                        let formula = loader.open(&set)?;
                        engine.camera(&formula, request)?.unwrap_or(own()?)
                    }
                };
                Ok(View { time: key.time, camera })
            };
            let views = path.keys.iter().map(view).collect::<Result<Vec<View>, Error>>()?;
            let settings = PathSettings { even: path.even, repeat: path.repeat, clearance: path.clearance };
            (views, settings, Some(path.keys[0].span))
        }
        CameraMotion::Dive { at, zoom } => {
            let change = CameraChange { zoom: Some(Zoom { factor: *zoom, at: *at }), ..request.camera };
            let near = engine.camera(formula, &Request { camera: change, ..request.clone() })?.unwrap_or(own()?);
            let views = vec![View { time: 0.0, camera: own()? }, View { time: seconds, camera: near }];
            (views, PathSettings { even: true, ..PathSettings::default() }, None)
        }
        other => return Ok(Way::Move(other.clone())),
    };
    let clearance = engine.clearance(formula, request)?;
    let path = CameraPath::new(&views, settings, &|points| clearance.of(points));
    let path = path.map_err(|why| match of_keys {
        Some(span) => {
            let help = "`bulbfold look NAME` finds free points, `bulbfold probe NAME --point X,Y,Z` says where one is";
            loader.failed(Diagnostic::error(why).label(span, "the path begins here").help(help))
        }
        None => Error::Request { text: why, help: "choose another camera".into() },
    })?;
    Ok(Way::Path(Box::new(path)))
}
