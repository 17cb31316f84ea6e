//! Films in one file: by this program, or by ffmpeg where it is installed.

use std::fs;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use bulbfold::files::{Output, Target};
use bulbfold::film::{Movie, MovieForm, MovieFormat};
use bulbfold::graph::motion::Rate;
use bulbfold::shade::Size;

use super::film::{Written, not_joined};
use super::output::{Content, check_output, not_written};
use super::pictures::OutputArgs;
use super::progress::Progress;
use super::{Failure, Outcome, usage};

/// Endings of films that ffmpeg makes, and its settings: nearly without visible losses, in the colours of television (BT.709), which all
/// players show.
const FFMPEG: [(&str, &[&str], &[&str]); 4] = [
    (
        "mp4",
        &["-c:v", "libx264", "-preset", "slow", "-crf", "16", "-pix_fmt", "yuv420p", "-movflags", "+faststart"],
        &["-c:a", "aac", "-b:a", "256k"],
    ),
    ("mkv", &["-c:v", "libx264", "-preset", "slow", "-crf", "14", "-pix_fmt", "yuv420p"], &["-c:a", "flac"]),
    ("mov", &["-c:v", "prores_ks", "-profile:v", "3", "-pix_fmt", "yuv422p10le"], &["-c:a", "pcm_s16le"]),
    (
        "webm",
        &["-c:v", "libvpx-vp9", "-crf", "22", "-b:v", "0", "-row-mt", "1", "-pix_fmt", "yuv420p"],
        &["-c:a", "libopus", "-b:a", "192k"],
    ),
];
/// Endings of films that this program makes.
const OWN: [(&str, MovieFormat); 4] =
    [("gif", MovieFormat::Gif), ("apng", MovieFormat::Apng), ("png", MovieFormat::Apng), ("webp", MovieFormat::WebP)];

/// Makes a film of frames.
pub struct Encoder {
    target: Target,
    by: By,
}

#[derive(Clone, Copy)]
enum By {
    Own(MovieFormat),
    Ffmpeg(usize),
}

/// Whether a name's ending is that of a film.
pub fn is_film(ending: &str) -> bool {
    OWN.iter().map(|(known, _)| *known).chain(FFMPEG.iter().map(|(known, ..)| *known)).any(|known| known == ending)
}

/// What makes the film that is asked for; nothing where frames are wanted.
pub fn encoder(output: &OutputArgs, checks: bool) -> Result<Option<Encoder>, Failure> {
    let Some(name) = output.only("a film")?.filter(|_| !checks) else { return Ok(None) };
    let is_pattern = name.as_os_str().as_encoded_bytes().contains(&b'%');
    let ending = name.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let own = OWN.iter().find(|(known, _)| *known == ending).map(|(_, format)| By::Own(*format));
    let by = own.or_else(|| FFMPEG.iter().position(|(known, ..)| *known == ending).map(By::Ffmpeg));
    let Some(by) = by.filter(|_| !is_pattern) else { return Ok(None) };
    let target = check_output(name, None, Content::Bytes)?;
    if target.is_stream() {
        return match by {
            By::Own(_) => Ok(None),
            By::Ffmpeg(_) => Err(usage(format!("{} is no file", name.display()), "name a file: -o film.mp4")),
        };
    }
    output.refuse_forms("a film in one file")?;
    Ok(Some(Encoder { target, by }))
}

impl Encoder {
    /// The file.
    pub fn target(&self) -> &Path {
        self.target.path()
    }

    /// The folder of the frames, beside the film.
    pub fn folder(&self) -> PathBuf {
        let mut name = self.target.path().as_os_str().to_os_string();
        name.push(".frames");
        PathBuf::from(name)
    }

    /// Looks at what the film needs before any frame is rendered, and makes the folder of its frames.
    pub fn prepare(&self, audio: Option<&Path>) -> Outcome {
        match self.by {
            By::Own(_) if audio.is_some() => {
                return Err(usage(
                    format!("{} has no place for a sound", self.target().display()),
                    "write .mp4, .webm, .mov or .mkv, or frames",
                ));
            }
            By::Own(_) => {}
            By::Ffmpeg(_) => {
                let tried = Command::new(FFMPEG_NAME).arg("-version").stdin(Stdio::null()).output();
                if !tried.is_ok_and(|output| output.status.success()) {
                    let text = format!("{} needs ffmpeg, which is not installed", self.target().display());
                    return Err(usage(text, "install it, or write .gif, .apng, .webp, or frames: -o frame_%05d.png"));
                }
            }
        }
        if let Some(audio) = audio.filter(|audio| !audio.is_file()) {
            return Err(usage(format!("there is no sound file {}", audio.display()), "give the name of a file"));
        }
        let folder = self.folder();
        fs::create_dir_all(&folder).map_err(|error| super::output::cannot_write(&folder, &error))
    }

    /// Puts the frames together, and removes them unless they are to be kept. The sound has the time at which it begins, in seconds.
    pub fn join(
        &self,
        frames: &[Written],
        (rate, every): (Rate, u32),
        audio: Option<(&Path, f64)>,
        keeps: bool,
        mut progress: Progress,
    ) -> Outcome {
        let frame_time = (rate.seconds * every, rate.frames);
        let joined = match self.by {
            By::Own(format) => self.own(format, frames, frame_time, &mut progress),
            By::Ffmpeg(kind) => self.ffmpeg(kind, frames, (frame_time, audio), &mut progress),
        };
        progress.finish();
        joined?;
        if !keeps {
            // Only what this program has written there.
            frames.iter().for_each(|frame| drop(fs::remove_file(&frame.path)));
            drop(fs::remove_file(self.folder().join("manifest.json")));
            drop(fs::remove_dir(self.folder()));
        }
        Ok(())
    }

    fn own(&self, format: MovieFormat, frames: &[Written], frame_time: (u32, u32), progress: &mut Progress) -> Outcome {
        let failed = |error: &dyn std::fmt::Display| not_joined(self.target(), &error.to_string());
        let mut output = Output::new(&self.target).map_err(|error| not_written(&self.target, &error))?;
        let mut movie: Option<Movie<&mut Output>> = None;
        let mut left = Some(&mut output);
        for (i, frame) in frames.iter().enumerate() {
            let (size, rgb) = pixels(&frame.path).map_err(|error| failed(&error))?;
            if let Some(output) = left.take() {
                let form = MovieForm { format, size, frames: frames.len() as u32, frame_time };
                movie = Some(Movie::new(output, form).map_err(|error| failed(&error))?);
            }
            if let Some(movie) = &mut movie {
                movie.push(&rgb).map_err(|error| failed(&error))?;
            }
            progress.update(i as f64 / frames.len() as f64);
        }
        movie.map_or(Ok(()), Movie::finish).map_err(|error| failed(&error))?;
        output.commit().map_err(|error| not_written(&self.target, &error))
    }

    fn ffmpeg(
        &self,
        kind: usize,
        frames: &[Written],
        (frame_time, audio): ((u32, u32), Option<(&Path, f64)>),
        progress: &mut Progress,
    ) -> Outcome {
        let (ending, video, sound) = FFMPEG[kind];
        let failed = |why: &str| not_joined(self.target(), why);
        let whole = self.folder().join(format!("film.{ending}"));
        let mut command = Command::new(FFMPEG_NAME);
        command.args(["-hide_banner", "-loglevel", "error", "-y", "-f", "image2pipe", "-c:v", "png", "-framerate"]);
        command.arg(format!("{}/{}", frame_time.1, frame_time.0)).args(["-i", "-"]);
        if let Some((audio, begin)) = audio {
            if begin > 0.0 {
                command.arg("-ss").arg(begin.to_string());
            }
            command.arg("-i").arg(audio).args(["-map", "0:v", "-map", "1:a"]).args(sound);
            // The film is as long as its pictures.
            command
                .arg("-t")
                .arg((frames.len() as f64 * f64::from(frame_time.0) / f64::from(frame_time.1)).to_string());
        }
        // Chroma of half the size wants even edges.
        command.args(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2,scale=out_color_matrix=bt709:out_range=tv"]);
        command.args(video).args(["-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709"]);
        command.args(["-color_range", "tv"]).arg(&whole);
        let child = command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn();
        let mut child = child.map_err(|error| failed(&error.to_string()))?;
        // Read while frames are fed: a pipe that is full would stop both.
        let messages = child.stderr.take().map(|stderr| std::thread::spawn(move || last_words(stderr)));
        let fed = feed(child.stdin.take(), frames, progress);
        let is_done = child.wait().is_ok_and(|status| status.success());
        let told = messages.and_then(|thread| thread.join().ok()).unwrap_or_default();
        let last = told.lines().rfind(|line| !line.trim().is_empty()).unwrap_or_default();
        match (is_done, fed) {
            (true, Ok(())) => {}
            (false, _) => return Err(failed(&format!("ffmpeg failed: {}", bulbfold::diag::printable(last)))),
            (true, Err(error)) => return Err(failed(&error.to_string())),
        }
        let copied = || -> io::Result<()> {
            let mut output = Output::new(&self.target)?;
            io::copy(&mut fs::File::open(&whole)?, &mut output)?;
            output.commit()
        };
        copied().map_err(|error| not_written(&self.target, &error))?;
        drop(fs::remove_file(whole));
        Ok(())
    }
}

/// The end of what a program says, which it never waits for.
fn last_words(mut from: impl Read) -> String {
    let (mut last, mut part) = (Vec::new(), [0; 4096]);
    while let Ok(count @ 1..) = from.read(&mut part) {
        last.extend(&part[..count]);
        last.drain(..last.len().saturating_sub(MOST_WORDS));
    }
    String::from_utf8_lossy(&last).into_owned()
}

/// Bytes of messages that are kept.
const MOST_WORDS: usize = 1 << 14;

/// The name under which ffmpeg is looked for.
const FFMPEG_NAME: &str = "ffmpeg";

fn feed(stdin: Option<impl Write>, frames: &[Written], progress: &mut Progress) -> io::Result<()> {
    let Some(mut stdin) = stdin else { return Ok(()) };
    for (i, frame) in frames.iter().enumerate() {
        io::copy(&mut fs::File::open(&frame.path)?, &mut stdin)?;
        progress.update(i as f64 / frames.len() as f64);
    }
    Ok(())
}

/// The pixels of a frame of this program: three bytes each.
fn pixels(path: &Path) -> io::Result<(Size, Vec<u8>)> {
    let file = io::BufReader::new(fs::File::open(path)?);
    let mut reader = png::Decoder::new(file).read_info().map_err(io::Error::other)?;
    let size = Size { width: reader.info().width, height: reader.info().height };
    let count = reader.output_buffer_size().ok_or_else(|| io::Error::other("it is too large"))?;
    let mut rgb = vec![0; count];
    reader.next_frame(&mut rgb).map_err(io::Error::other)?;
    Ok((size, rgb))
}
