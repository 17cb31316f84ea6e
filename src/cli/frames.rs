//! The files of an animation's frames: their names, and which of them an earlier run has made.

use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

use bulbfold::files::Target;
use bulbfold::film::{Format, read_made, read_png};
use bulbfold::shade::Size;

use super::output::{Content, cannot_write, check_output};
use super::pictures::OutputArgs;
use super::{Failure, Outcome, Session, usage};

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
    /// The names that were asked for, else that of the formula's file with a number; refuses what could not be written.
    pub fn new(output: &OutputArgs, stem: &Path, what: &str) -> Result<Names, Failure> {
        let Some(given) = output.only(what)? else {
            let mut before = stem.file_stem().unwrap_or_default().to_os_string();
            before.push("_");
            return Ok(Names::Numbered(Pattern { before, after: ".png".into(), digits: 4 }));
        };
        if let Some(pattern) = Pattern::parse(given.as_os_str()) {
            output.file(&pattern.path(0))?;
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

    /// Frames in a folder of their own.
    pub fn inside(folder: &Path) -> Names {
        let before = folder.join("frame_").into_os_string();
        Names::Numbered(Pattern { before, after: ".png".into(), digits: 5 })
    }

    /// The film's manifest, beside its frames.
    pub fn manifest(&self) -> PathBuf {
        let Names::Numbered(pattern) = self else { return PathBuf::from("manifest.json") };
        let mut name = pattern.before.clone();
        name.push("manifest.json");
        let path = PathBuf::from(name);
        // Frames in a folder of their own have a plain name.
        match path.file_name().is_some_and(|name| name == "frame_manifest.json") {
            true => path.with_file_name("manifest.json"),
            false => path,
        }
    }

    /// Refuses to go on with what went into a pipe.
    pub fn refuse_stream(&self) -> Outcome {
        match self {
            Names::Numbered(_) => Ok(()),
            Names::One(_) => Err(usage(
                "what went into a pipe cannot be resumed",
                "drop --resume, or write files: -o frame_%04d.png",
            )),
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

/// Why a frame has to be rendered: nothing where its file is whole, of this size and of this key; the inner text where there is a file.
#[expect(clippy::option_option)]
pub fn why_not(target: &Target, key: &str, size: Size) -> Option<Option<String>> {
    let path = target.path();
    if target.is_stream() || std::fs::symlink_metadata(path).is_err() {
        return Some(None);
    }
    let own = match Format::of(path) {
        Some(Format::Png) => read_png(path, size).map(|made| made.key),
        _ => read_made(path).map(|made| made.key),
    };
    match own {
        Ok(Some(own)) if own == key => None,
        Ok(Some(_)) => Some(Some("it is of other settings".to_string())),
        Ok(None) => Some(Some("it does not say which settings made it".to_string())),
        Err(why) => Some(Some(why)),
    }
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
