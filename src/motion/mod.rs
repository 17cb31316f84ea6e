//! What moves in a film, ready to be asked: a formula's tracks, with the files and the script that they follow.
//!
//! In comes a formula whose scene has a [`Motion`]; out come, for any time, the changes that make the formula of that time: pairs of a path and a
//! value, as `--set` takes them.

mod column;
mod script;
mod sound;

use std::path::{Path, PathBuf};

use self::script::Script;
use crate::diag::{Diagnostic, Span};
use crate::formula::library::Library;
use crate::formula::script::base_scope;
use crate::graph::ValidGraph;
use crate::graph::motion::{Curve, Ease, Key, Keys, Motion, Moving, Repeat, Source, Track, Way, mix};
use crate::load::Loaded;

/// Changes of a formula: pairs of a path and a value, as `--set` takes them.
pub type Changes = Vec<(String, String)>;

/// A formula's motion with everything that it needs.
pub struct Moves {
    motion: Motion,
    /// Numbers of the formula that expressions may name.
    params: Vec<(String, f64)>,
    /// The tracks of files, in place of their names.
    read: Vec<Option<Keys>>,
    script: Option<Script>,
    /// The sound that the film is given.
    audio: Option<PathBuf>,
}

impl Moves {
    /// Opens the files that a formula's motion names, beside it; a formula without one moves by its script alone.
    ///
    /// Errors: a file is missing or broken; the message has its place in the formula.
    pub fn open(library: &mut Library, loaded: &Loaded, motion: Motion) -> Result<Moves, Diagnostic> {
        let own = library.sources.name(loaded.text).to_string();
        let beside = |name: &str| Path::new(&own).parent().map_or_else(|| PathBuf::from(name), |f| f.join(name));
        let mut read = Vec::new();
        for (_, track) in &motion.tracks {
            read.push(match track {
                Track::Curve(curve) => Some(followed(library, curve, &beside(&curve.file.name))?),
                _ => None,
            });
        }
        let script = match &motion.script {
            Some(file) => Some(Script::open(library, &beside(&file.name), file.span)?),
            None if own.to_ascii_lowercase().ends_with(".rhai") => Script::of_formula(library, loaded.text)?,
            None => None,
        };
        let audio = motion.audio.as_ref().map(|file| (beside(&file.name), file.span));
        if let Some((path, span)) = audio.as_ref().filter(|(path, _)| !path.is_file()) {
            return Err(Diagnostic::error(format!("there is no file {}", path.display())).label(*span, "named here"));
        }
        let params = params_of(&loaded.graph);
        Ok(Moves { motion, params, read, script, audio: audio.map(|(path, _)| path) })
    }

    /// The motion as the file states it.
    pub fn motion(&self) -> &Motion {
        &self.motion
    }

    /// The sound that the film is given.
    pub fn audio(&self) -> Option<&Path> {
        self.audio.as_deref()
    }

    /// Whether the formula itself never changes, only the camera.
    pub fn moves_the_view_alone(&self) -> bool {
        self.motion.tracks.iter().all(|(path, _)| path.text.starts_with("camera."))
            && self.script.as_ref().is_none_or(|script| !script.has_values())
    }

    /// The changes that make the formula of a time in seconds; the camera's way is not among them, but what a script says of the camera is.
    ///
    /// Errors: an expression or the script fails there; the message has its place.
    pub fn at(&self, library: &Library, time: f64) -> Result<Changes, Diagnostic> {
        let mut changes = Changes::new();
        for ((path, track), read) in self.motion.tracks.iter().zip(&self.read) {
            let value = match (track, read) {
                (_, Some(keys)) => keys.at(time).ron(),
                (Track::Keys(keys), _) => keys.at(time).ron(),
                (Track::Wave { ends: [from, to], seconds }, _) => {
                    let share = (1.0 - (std::f64::consts::TAU * time / seconds).cos()) / 2.0;
                    Moving::Numbers(mix(from, to, share)).ron()
                }
                (Track::Expression { text, span }, _) => self.expression(library, (text, *span), time)?.to_string(),
                (Track::Curve(_), None) => continue,
            };
            changes.push((path.text.clone(), value));
        }
        if let Some(script) = &self.script {
            let share = time / self.motion.seconds;
            changes.extend(script.values(library, time, share)?);
            let camera = script.camera(library, time, share)?;
            changes.extend(camera.into_iter().map(|(name, value)| (format!("camera.{name}"), value)));
        }
        Ok(changes)
    }

    fn expression(&self, library: &Library, (text, span): (&str, Span), time: f64) -> Result<f64, Diagnostic> {
        let mut scope = base_scope();
        for (name, value) in &self.params {
            scope.push_constant(name.clone(), *value);
        }
        scope.push_constant("t", time).push_constant("u", time / self.motion.seconds);
        let value = library.engine.expression(text, &mut scope).map_err(|error| {
            let diagnostic = Diagnostic::error(error.message).label(span, "in this expression");
            match &error.variable {
                Some(name) => {
                    let params = self.params.iter().map(|(name, _)| name.as_str());
                    diagnostic.did_you_mean(name, params.chain(["t", "u"])).help("expressions know t, u and parameters")
                }
                None => diagnostic,
            }
        })?;
        match value.as_float().or(value.as_int().map(|i| i as f64)) {
            Ok(number) if number.is_finite() => Ok(number),
            _ => {
                let message = format!("the expression does not give a finite number at {time} s");
                Err(Diagnostic::error(message).label(span, ""))
            }
        }
    }
}

/// The formula's parameters that stand for numbers.
fn params_of(graph: &ValidGraph) -> Vec<(String, f64)> {
    graph.params.iter().map(|param| (param.name.clone(), param.value)).collect()
}

/// The track of a file's numbers.
fn followed(library: &mut Library, curve: &Curve, path: &Path) -> Result<Keys, Diagnostic> {
    let found = match &curve.source {
        Source::Column { name, time } => column::read(library, path, (time, name)),
        Source::Band { from_to, fall } => sound::loudness(path, *from_to, *fall),
    };
    let [zero, one] = curve.ends;
    let key = |(time, value): (f64, f64)| {
        let value = Moving::Numbers(vec![zero + (one - zero) * value]);
        Key { time, value, way: None }
    };
    let keys = found.and_then(|points| {
        let way = Way::Eased(Ease::Linear);
        Keys::new(points.into_iter().map(key).collect(), way, Repeat::Hold, None)
    });
    keys.map_err(|why| {
        let message = format!("{}: {why}", path.display());
        Diagnostic::error(message).label(curve.file.span, "named here")
    })
}
