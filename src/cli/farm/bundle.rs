//! The folder of a job for many machines.

use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};

use bulbfold::calibrate::cache::hash;
use bulbfold::engine::{Job, Recipe};
use bulbfold::files::{Chosen, is_foreign, read_text};
use bulbfold::graph::motion::Rate;
use bulbfold::shade::Size;
use serde::{Deserialize, Serialize};

use crate::cli::output::cannot_write;
use crate::cli::pictures::OutputArgs;
use crate::cli::{Failure, Outcome, Session, usage};

/// Counts changes of what bundles and parts hold.
pub const VERSION: u32 = 1;
/// The program that makes pictures of them.
pub const PROGRAM: &str = env!("CARGO_PKG_VERSION");
/// The file that says what a bundle is.
const MANIFEST: &str = "manifest.json";
/// Largest manifest and largest file of a frame, in bytes.
const MOST_TEXT: u64 = 1 << 28;
/// Rows that parts have a whole number of, where the picture has enough of them: they are marched together.
const BLOCK: u32 = 8;

/// What a bundle is.
#[derive(Serialize, Deserialize)]
pub struct Manifest {
    /// [`VERSION`].
    pub bundle: u32,
    /// Version of the program.
    pub program: String,
    /// Hash of all else and, through those of the frames, of everything in the bundle.
    pub hash: String,
    /// The formula's name.
    pub name: String,
    /// Columns and rows of all pictures.
    pub size: Size,
    /// Parts of a picture's rows.
    pub tiles: u32,
    /// Parts of its samples.
    pub samples_split: u32,
    /// Samples of each pixel where they are split.
    pub samples: u32,
    /// The pictures: one, or those of the film that are wanted.
    pub frames: Vec<Frame>,
    /// Of films: what makes one of the frames.
    pub film: Option<Reel>,
    /// The files of the picture.
    pub output: OutputArgs,
}

/// A picture of a bundle.
#[derive(Serialize, Deserialize)]
pub struct Frame {
    /// Its number in the film, counted from 1.
    pub number: u32,
    /// Pictures that it is the average of.
    pub moments: u32,
    /// Hash of its file.
    pub hash: String,
}

/// What makes a film of frames.
#[derive(Serialize, Deserialize)]
pub struct Reel {
    /// Frames, in so many seconds.
    pub rate: [u32; 2],
    /// Frames of the film from one picture to the next.
    pub every: u32,
    /// The file of its sound, in the bundle.
    pub sound: Option<String>,
}

impl Reel {
    /// Its frames a second.
    pub fn rate(&self) -> Rate {
        Rate { frames: self.rate[0], seconds: self.rate[1] }
    }
}

/// Which part of a bundle.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Place {
    /// Its number, counted from 1.
    pub number: u32,
    /// The index of its frame.
    pub frame: usize,
    /// The index of its rows.
    pub tile: u32,
    /// The index of its samples.
    pub samples: u32,
}

impl Manifest {
    /// The manifest with its hash.
    #[must_use]
    pub fn hashed(self) -> Manifest {
        Manifest { hash: self.own_hash(), ..self }
    }

    fn own_hash(&self) -> String {
        let mut value = serde_json::to_value(self).unwrap_or_default();
        value["hash"] = "".into();
        format!("{:032x}", hash(value.to_string().as_bytes()))
    }

    /// As JSON.
    pub fn text(&self) -> String {
        format!("{}\n", serde_json::to_string_pretty(self).unwrap_or_default())
    }

    /// How many parts there are.
    pub fn parts(&self) -> u32 {
        self.frames.len() as u32 * self.tiles * self.samples_split
    }

    /// A part by its number, from 1 to [`Manifest::parts`].
    pub fn place(&self, number: u32) -> Place {
        let (rest, samples) = ((number - 1) / self.samples_split, (number - 1) % self.samples_split);
        Place { number, frame: (rest / self.tiles) as usize, tile: rest % self.tiles, samples }
    }

    /// The rows of a part.
    pub fn rows(&self, place: Place) -> Range<u32> {
        let block = if self.size.height.div_ceil(BLOCK) >= self.tiles { BLOCK } else { 1 };
        let cut = |tile: u32| (share(self.size.height.div_ceil(block), tile, self.tiles) * block).min(self.size.height);
        cut(place.tile)..cut(place.tile + 1)
    }

    /// The samples of a part, where they are split.
    pub fn samples(&self, place: Place) -> Option<Range<u32>> {
        let cut = |part: u32| share(self.samples, part, self.samples_split);
        (self.samples_split > 1).then(|| cut(place.samples)..cut(place.samples + 1))
    }

    /// A part in words.
    pub fn shown(&self, place: Place) -> String {
        let mut text = match self.film {
            Some(_) => format!("frame {}, ", self.frames[place.frame].number),
            None => String::new(),
        };
        let rows = self.rows(place);
        text.push_str(&format!("rows {} to {}", rows.start + 1, rows.end));
        if let Some(samples) = self.samples(place) {
            text.push_str(&format!(", samples {} to {}", samples.start + 1, samples.end));
        }
        text
    }
}

/// Where the part of this index begins, of so many parts of a whole.
fn share(whole: u32, index: u32, parts: u32) -> u32 {
    (u64::from(whole) * u64::from(index) / u64::from(parts)) as u32
}

/// A job's text of a frame: a line for each of its pictures.
pub fn frame_text(jobs: &[Job]) -> String {
    let line = |job: &Job| format!("{}\n", Recipe { backend: String::new(), job: job.clone() }.text());
    jobs.iter().map(line).collect()
}

/// The name of a frame's file in a bundle.
pub fn frame_file(number: u32) -> String {
    format!("frames/{number:05}.json")
}

/// A bundle that was read.
pub struct Bundle {
    /// Its folder.
    pub folder: PathBuf,
    /// What it is.
    pub manifest: Manifest,
}

impl Bundle {
    /// Whether a folder has a manifest.
    pub fn is_in(folder: &Path) -> bool {
        folder.join(MANIFEST).exists()
    }

    /// Reads the manifest of a bundle of this version of the program.
    pub fn open(folder: &Path) -> Result<Bundle, Failure> {
        let shown = folder.display();
        if !folder.is_dir() {
            return Err(usage(format!("there is no folder {shown}"), "`bulbfold job SCENE -o JOB` writes one"));
        }
        let read = read_text(&folder.join(MANIFEST), MOST_TEXT, Chosen::Found);
        let help = "`bulbfold job SCENE -o JOB` writes a job's folder";
        let text = read.map_err(|error| usage(format!("{shown} is no job: cannot read {MANIFEST}: {error}"), help))?;
        let value: serde_json::Value = serde_json::from_str(&text)
            .map_err(|error| usage(format!("{shown} is no job: {MANIFEST} is damaged: {error}"), help))?;
        let program = value["program"].as_str().unwrap_or("an unknown version");
        if program != PROGRAM || value["bundle"] != VERSION {
            let text = format!("{shown} was made by bulbfold {program}, and this is {PROGRAM}");
            return Err(usage(text, "use the version that made it, or make the job again with this one"));
        }
        let manifest: Manifest = serde_json::from_value(value)
            .map_err(|error| usage(format!("{shown} is no job: {MANIFEST} is damaged: {error}"), help))?;
        if manifest.hash != manifest.own_hash() || !manifest.is_sound() {
            return Err(usage(format!("{shown}/{MANIFEST} was changed"), "make the job again: `bulbfold job`"));
        }
        Ok(Bundle { folder: folder.to_path_buf(), manifest })
    }

    /// The jobs of a frame by its index: one, or those that it is the average of. Scripts of a bundle that belongs to another user run
    /// with `--trust` alone.
    pub fn jobs(&self, session: &Session, index: usize) -> Result<Vec<Job>, Failure> {
        let frame = &self.manifest.frames[index];
        let path = self.folder.join(frame_file(frame.number));
        let shown = path.display();
        let text = read_text(&path, MOST_TEXT, Chosen::Found)
            .map_err(|error| usage(format!("cannot read {shown}: {error}"), "copy the whole folder of the job"))?;
        if text_hash(&text) != frame.hash {
            return Err(usage(format!("{shown} is damaged"), "copy the job's folder again, or make it again"));
        }
        let failed = |error| session.failed(error);
        let mut jobs = Vec::new();
        for line in text.lines() {
            let is_foreign = is_foreign(&path) || is_foreign(&self.folder);
            if is_foreign && !session.library.trusts_others && Recipe::has_scripts(line).map_err(failed)? {
                let text = format!("{} belongs to another user and holds scripts", self.folder.display());
                return Err(usage(text, "`--trust` runs them"));
            }
            let recipe = Recipe::read(line).map_err(failed)?;
            if !recipe.is_settled() || recipe.job.size() != self.manifest.size {
                return Err(usage(format!("{shown} is no settled picture"), "make the job again: `bulbfold job`"));
            }
            jobs.push(recipe.job);
        }
        match jobs.len() as u32 == frame.moments {
            true => Ok(jobs),
            false => Err(usage(format!("{shown} is damaged"), "copy the job's folder again, or make it again")),
        }
    }

    /// The line that a part's file begins with.
    pub fn head(&self, number: u32) -> String {
        let Manifest { program, hash, .. } = &self.manifest;
        format!("bulbfold part {VERSION} {program} {hash} {number}/{}", self.manifest.parts())
    }

    /// The file of a part.
    pub fn part(&self, number: u32) -> PathBuf {
        self.folder.join(format!("parts/{number}.part"))
    }

    /// The file of a part that is not finished.
    pub fn unfinished(&self, number: u32) -> PathBuf {
        self.folder.join(format!("parts/{number}.work"))
    }
}

impl Manifest {
    /// Whether its numbers can be computed with.
    fn is_sound(&self) -> bool {
        let parts = (self.frames.len() as u64).checked_mul(u64::from(self.tiles) * u64::from(self.samples_split));
        let rate = self.film.as_ref().is_none_or(|film| film.rate.iter().all(|n| *n > 0) && film.every > 0);
        let is_split = self.samples_split == 1 || self.samples >= self.samples_split;
        let moments = self.frames.iter().all(|frame| frame.moments > 0);
        parts.is_some_and(|parts| parts > 0 && parts <= u64::from(u32::MAX))
            && self.tiles <= self.size.height
            && is_split
            && rate
            && moments
    }
}

/// The hash of a text, as a manifest has it.
pub fn text_hash(text: &str) -> String {
    format!("{:032x}", hash(text.as_bytes()))
}

/// Writes a file of a bundle, whole or not at all.
pub fn write(path: &Path, bytes: &[u8]) -> Outcome {
    bulbfold::files::write(path, bytes).map_err(|error| cannot_write(path, &error))
}

/// Writes what is last: a folder without it is no bundle.
pub fn write_manifest(folder: &Path, manifest: &Manifest) -> Outcome {
    write(&folder.join(MANIFEST), manifest.text().as_bytes())
}

/// Makes a folder and those that it lies in.
pub fn make_folder(path: &Path) -> Outcome {
    fs::create_dir_all(path).map_err(|error| cannot_write(path, &error))
}
