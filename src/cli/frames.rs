//! The files of an animation's frames: their names, and which of them an earlier run has made.

use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

use bulbfold::calibrate::cache::hash;
use bulbfold::files::Target;
use bulbfold::film::{Format, MadePng, read_png};
use bulbfold::graph::ValidGraph;
use bulbfold::render::RenderSettings;
use rayon::prelude::*;

use super::output::{Content, cannot_write, check_output};
use super::picture_key::graph_text;
use super::render::Arguments;
use super::session::talk;
use super::{Failure, Outcome, Session, usage};

/// Counts changes of what frames show; those that older programs made are made anew.
const VERSION: u32 = 4;
/// Frames that are named one by one.
const MAX_NAMED: usize = 20;

/// Where frames go.
pub enum Names {
    /// All into one pipe, one after the other.
    One(Target),
    /// Each into a file of its own.
    Numbered(Pattern),
}

/// What stands before and after the number of a frame, and the number's least digits.
pub struct Pattern {
    before: OsString,
    after: OsString,
    digits: usize,
}

impl Names {
    /// The names that were asked for, else the formula's with a number; refuses what could not be written.
    pub fn new(arguments: &Arguments) -> Result<Names, Failure> {
        let Some(given) = arguments.output.only("a sweep")? else {
            let mut before = arguments.formula.file.file_stem().unwrap_or_default().to_os_string();
            before.push("_");
            return Ok(Names::Numbered(Pattern { before, after: ".png".into(), digits: 4 }));
        };
        if let Some(pattern) = Pattern::parse(given.as_os_str()) {
            arguments.output.file(&pattern.path(0))?;
            return Ok(Names::Numbered(pattern));
        }
        match Target::of(given) {
            Ok(target) if target.is_stream() => {
                check_output(given, None, Content::Bytes)?;
                Ok(Names::One(target))
            }
            _ => {
                let text = format!("the output {} has no place for the number of a frame", given.display());
                Err(usage(text, "write for example `-o frame_%04d.png`"))
            }
        }
    }

    /// The target of each of these frames.
    pub fn targets(&self, session: &Session, frames: &[u32]) -> Result<Vec<Target>, Failure> {
        let target = |&frame: &u32| match self {
            Names::One(target) => Ok(target.clone()),
            Names::Numbered(pattern) => {
                let path = pattern.path(frame);
                let target = Target::of(&path).map_err(|error| cannot_write(&path, &error))?;
                session.spare_inputs(&target).map(|()| target)
            }
        };
        frames.iter().map(target).collect()
    }

    /// The format of the frames.
    pub fn format(&self) -> Format {
        let format = match self {
            Names::One(target) => Format::of(target.path()),
            Names::Numbered(pattern) => Format::of(&pattern.path(0)),
        };
        format.unwrap_or(Format::Png)
    }

    /// The first and the last name, as people read them.
    pub fn shown(&self, frames: u32) -> String {
        match self {
            Names::One(target) => format!("{frames} frames to {}", target.path().display()),
            Names::Numbered(pattern) => {
                format!("{} to {}", pattern.path(0).display(), pattern.path(frames - 1).display())
            }
        }
    }
}

impl Pattern {
    fn parse(pattern: &OsStr) -> Option<Pattern> {
        let (before, rest) = split_once(pattern, '%')?;
        let (digits, after) = split_once(&rest, 'd')?;
        let digits = match digits.to_str()? {
            "" => 0,
            digits => digits.parse().ok().filter(|&n: &usize| n <= 12)?,
        };
        split_once(&after, '%').is_none().then_some(Pattern { before, after, digits })
    }

    /// The file of a frame, numbered from 1.
    fn path(&self, frame: u32) -> PathBuf {
        let (number, digits) = (frame + 1, self.digits);
        let mut name = self.before.clone();
        name.push(format!("{number:0digits$}"));
        name.push(&self.after);
        PathBuf::from(name)
    }
}

/// What is before and after the first such ASCII character.
#[cfg(unix)]
fn split_once(text: &OsStr, at: char) -> Option<(OsString, OsString)> {
    use std::os::unix::ffi::OsStrExt;
    let bytes = text.as_bytes();
    let place = bytes.iter().position(|&byte| char::from(byte) == at)?;
    let part = |bytes: &[u8]| OsStr::from_bytes(bytes).to_os_string();
    Some((part(&bytes[..place]), part(&bytes[place + 1..])))
}

#[cfg(not(unix))]
fn split_once(text: &OsStr, at: char) -> Option<(OsString, OsString)> {
    text.to_str()?.split_once(at).map(|(before, after)| (before.into(), after.into()))
}

/// The key of a frame: everything that its pixels follow from but the back end, which all give the same picture.
pub fn frame_key(session: &Session, arguments: &Arguments, settings: &RenderSettings, graph: &ValidGraph) -> String {
    let estimate = &arguments.estimate;
    let text = format!(
        "{} {VERSION} {settings:?} {:?} {:?}\n{}",
        env!("CARGO_PKG_VERSION"),
        estimate.calibrate,
        estimate.error_budget,
        graph_text(&session.library.sources, graph)
    );
    format!("{:032x}", hash(text.as_bytes()))
}

/// The frames that have to be rendered: those whose file is missing, broken, of another size or of other settings. The last
/// three are named on stderr.
pub fn frames_to_do(names: &Names, keys: &[String], settings: &RenderSettings) -> Result<Vec<u32>, Failure> {
    let Names::Numbered(pattern) = names else {
        return Err(usage(
            "what went into a pipe cannot be resumed",
            "drop --resume, or write files: -o frame_%04d.png",
        ));
    };
    let why_not = |path: &Path, key: &str| match read_png(path, settings.size) {
        Ok(MadePng { key: Some(own), .. }) if own == key => None,
        Ok(MadePng { key: Some(_), .. }) => Some("it is of other settings".to_string()),
        Ok(MadePng { key: None, .. }) => Some("it does not say which settings made it".to_string()),
        Err(why) => Some(why),
    };
    let judged: Vec<Option<(u32, Option<String>)>> = (0..keys.len() as u32)
        .into_par_iter()
        .map(|frame| {
            let path = pattern.path(frame);
            match std::fs::symlink_metadata(&path) {
                Err(_) => Some((frame, None)),
                Ok(_) => why_not(&path, &keys[frame as usize]).map(|why| (frame, Some(why))),
            }
        })
        .collect();
    let todo: Vec<(u32, Option<String>)> = judged.into_iter().flatten().collect();
    let named: Vec<_> = todo.iter().filter_map(|(frame, why)| Some((frame, why.as_ref()?))).collect();
    for (frame, why) in named.iter().take(MAX_NAMED) {
        talk(&format!("{} is rendered again: {why}", pattern.path(**frame).display()));
    }
    if named.len() > MAX_NAMED {
        talk(&format!("{} more frames are rendered again", named.len() - MAX_NAMED));
    }
    Ok(todo.into_iter().map(|(frame, _)| frame).collect())
}

/// Refuses numbers on stdout beside pictures there.
pub fn refuse_json(names: &Names) -> Outcome {
    match names {
        Names::One(target) => super::output::refuse_both(target, "--json"),
        Names::Numbered(_) => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::Pattern;

    #[test]
    fn patterns_have_one_place_for_a_number() {
        let name = |pattern: &str| Pattern::parse(pattern.as_ref()).map(|names| names.path(11).display().to_string());
        assert_eq!(name("a/f_%04d.png").as_deref(), Some("a/f_0012.png"));
        assert_eq!(name("%d.png").as_deref(), Some("12.png"));
        for wrong in ["frame.png", "%04x.png", "%d_%d.png", "100%.png", "%999d.png"] {
            assert_eq!(name(wrong), None, "{wrong}");
        }
    }
}
