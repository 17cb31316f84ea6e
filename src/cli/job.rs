//! `bulbfold job`: a picture or a film for many machines.

use std::fs;
use std::path::{Path, PathBuf};

use bulbfold::engine::Job;
use bulbfold::film::Format;
use bulbfold::graph::StereoLayout;
use clap::Args;

use super::animate::{Quick, Shot, ShotArgs};
use super::encode;
use super::farm::bundle::{self, Bundle, Frame, Manifest, PROGRAM, Reel, VERSION};
use super::farm::engines;
use super::film::{self, Film};
use super::frames::Names;
use super::picture_args::PictureArgs;
use super::pictures::{OutputArgs, has_layers};
use super::{Failure, Outcome, Session, usage};

/// Arguments of `job`.
#[derive(Args, Debug)]
#[command(
    mut_arg("output", |output| output.short(None).long("picture").value_name("NAME").help(PICTURE_HELP).help_heading("Job")),
    mut_arg("stats", |stats| stats.hide(true)),
    mut_arg("json", |json| json.hide(true)),
    mut_arg("threads", |threads| threads.hide(true)),
    mut_arg("force", |force| force.hide(true)),
    after_help = "\
Examples:
  bulbfold job mandelbulb --size 3840x2160 --tiles 8 -o bulb_job
  bulbfold job flight.ron --picture flight.mp4 --tiles 4 -o flight_job
  bulbfold job flight.ron --frames 25..48 --picture flight_%05d.exr -o exr_job
  bulbfold job menger --paths 1024 --samples-split 8 -o paths_job

Then one of:
  make -j4 -C bulb_job
  sh bulb_job/slurm_submit.sh
  openjd run bulb_job/template.yaml

Parts are rendered by `bulbfold render JOB --part 3/8` and joined by `bulbfold join JOB`: docs/farm.md."
)]
pub struct Arguments {
    #[command(flatten)]
    picture: PictureArgs,
    #[command(flatten)]
    shot: ShotArgs,
    /// The folder to write
    #[arg(short, long = "output", value_name = "JOB", required = true, help_heading = "Job")]
    out: PathBuf,
    /// Parts that the rows of each picture are cut into
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=16384), help_heading = "Job")]
    tiles: u32,
    /// Parts that the samples of each pixel are cut into; asks for `--paths`
    #[arg(long, value_name = "K", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=65536), help_heading = "Job")]
    samples_split: u32,
}

const PICTURE_HELP: &str = "The picture or the film that `bulbfold join` writes, as -o of `render` and `animate` names it; what is no whole \
                            path lies in the job's folder [default: NAME.png, of films NAME_%04d.png]";

/// Most parts of a job.
const MOST_PARTS: u64 = 1_000_000;

/// Runs the command.
pub fn run(arguments: &mut Arguments, session: &mut Session) -> Outcome {
    arguments.picture.take_changes();
    let arguments = &*arguments;
    arguments.picture.want_file("a job")?;
    if arguments.picture.stats || arguments.picture.json {
        return Err(usage("a job counts nothing yet", "drop --stats and --json"));
    }
    if arguments.picture.request().denoise {
        return Err(usage("noise is filtered in whole pictures, and a job has parts of them", "drop --denoise"));
    }
    let folder = Folder::new(&arguments.out)?;
    let written = arguments.write(&folder, session);
    if written.is_err() {
        folder.forget();
    }
    written
}

/// The folder of a job that is being written.
struct Folder {
    path: PathBuf,
    /// Whether it was made for this job.
    is_new: bool,
    /// The hash of the job that is there already.
    there: Option<String>,
}

impl Folder {
    fn new(path: &Path) -> Result<Folder, Failure> {
        let (path, is_new) = (path.to_path_buf(), !path.exists());
        let is_empty = is_new || fs::read_dir(&path).is_ok_and(|mut entries| entries.next().is_none());
        let there = if Bundle::is_in(&path) { Some(Bundle::open(&path)?.manifest.hash) } else { None };
        if !is_empty && there.is_none() {
            let text = format!("{} is there and holds no job", path.display());
            return Err(usage(text, "give the name of a new folder: -o JOB"));
        }
        Ok(Folder { path, is_new, there })
    }

    /// Writes a file, unless the job is there already.
    fn write(&self, name: &str, bytes: &[u8]) -> Outcome {
        if self.there.is_some() {
            return Ok(());
        }
        let path = self.path.join(name);
        bundle::make_folder(path.parent().unwrap_or(&self.path))?;
        bundle::write(&path, bytes)
    }

    /// Removes what is not whole.
    fn forget(&self) {
        if self.is_new {
            drop(fs::remove_dir_all(&self.path));
        }
    }
}

impl Arguments {
    fn write(&self, folder: &Folder, session: &mut Session) -> Outcome {
        self.picture.prepare();
        let manifest = match self.is_film() {
            true => self.film(folder, session)?,
            false => self.still(folder, session)?,
        };
        let manifest = manifest.hashed();
        match &folder.there {
            Some(there) if *there != manifest.hash => {
                let text = format!("{} is another job", folder.path.display());
                return Err(usage(text, "give another name: -o JOB"));
            }
            Some(_) => {}
            None => {
                engines::files(&manifest).iter().try_for_each(|(name, text)| folder.write(name, text.as_bytes()))?;
                bundle::write_manifest(&folder.path, &manifest)?;
            }
        }
        session.say(&format!("{}: {}", folder.path.display(), counted(&manifest)));
        Ok(())
    }

    /// Whether a film is wanted.
    fn is_film(&self) -> bool {
        let is_films = |name: &PathBuf| {
            let ending = name.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
            let is_pattern = name.as_os_str().as_encoded_bytes().contains(&b'%');
            is_pattern || (Format::of(name).is_none() && encode::is_film(&ending))
        };
        self.shot.is_given() || self.picture.output.names().iter().any(is_films)
    }

    /// The names of the files, those of their own where none are given; they lie in the job's folder.
    fn output(&self, end: &str) -> Result<OutputArgs, Failure> {
        let output = &self.picture.output;
        let odd = |name: &&PathBuf| {
            let is_plain = name.parent().is_none_or(|folder| folder.as_os_str().is_empty());
            !name.is_absolute() && (!is_plain || name.as_os_str() == "-")
        };
        if let Some(name) = output.names().iter().find(odd) {
            let text = format!("the picture {} would not lie in the job's folder", name.display());
            return Err(usage(text, "give a name without folders, or a whole path"));
        }
        let names = match output.names() {
            [] => {
                let mut name = self.picture.formula.file.file_stem().unwrap_or_default().to_os_string();
                name.push(end);
                vec![PathBuf::from(name)]
            }
            names => names.to_vec(),
        };
        Ok(output.with_names(names, false))
    }

    /// A job of one picture.
    fn still(&self, folder: &Folder, session: &mut Session) -> Result<Manifest, Failure> {
        let output = self.output(".png")?;
        let wanted = output.wanted(Path::new(""))?;
        let mut request = self.picture.request();
        request.first_precision().map_err(|error| session.failed(error))?;
        let changes = self.picture.changes(session)?;
        let formula = session.open(&self.picture.formula.file, &changes)?;
        request.size = self.picture.size_for(formula.graph().scene.camera)?;
        let have_layers = has_layers(&formula.graph().scene, &request);
        for file in &wanted {
            request.layers = request.layers.or(output.layers(file.format, have_layers)?);
        }
        let mut watch = session.watch();
        let job = session.engine.settle(&formula, &request, &mut watch);
        let job = job.map_err(|error| session.failed(error))?;
        drop(watch);
        let mut frames = Vec::new();
        self.take(folder, (1, std::slice::from_ref(&job)), &mut frames)?;
        Ok(self.manifest(&job, frames, None, output))
    }

    /// A job of a film, or of some of its frames.
    fn film(&self, folder: &Folder, session: &mut Session) -> Result<Manifest, Failure> {
        let output = self.output("_%04d.png")?;
        let file = &self.picture.formula.file;
        let names = match encode::encoder(&output, false)? {
            Some(encoder) => Names::inside(&encoder.folder()),
            None => Names::new(&output, file, "a film")?,
        };
        let quick = Quick { is_small: false, has_shutter: true };
        let Shot { moments, frames, request, audio } =
            self.shot.shot((&self.picture, self.picture.request()), quick, session)?;
        let sound = audio.map(|audio| sound(folder, &audio)).transpose()?;
        let (blur, rate) = (moments.clock.blur, moments.clock.rate);
        if blur > 1 && self.samples_split > 1 {
            let help = "drop --samples-split: --tiles cuts the rows of such frames";
            return Err(usage("samples of frames with motion blur cannot be taken apart", help));
        }
        let film =
            Film { picture: &self.picture, request, moments: &moments, blur, frames, names: &names, keeps: true };
        let (mut entries, mut first) = (Vec::new(), None);
        film::settle(film, session, &mut |frame, jobs| {
            self.take(folder, (frame + 1, &jobs), &mut entries)?;
            first = first.take().or_else(|| jobs.into_iter().next());
            Ok(())
        })?;
        let first = first.ok_or_else(|| usage("the film has no frames", "give more --seconds"))?;
        let reel = Reel { rate: [rate.frames, rate.seconds], every: self.shot.every(), sound };
        Ok(self.manifest(&first, entries, Some(reel), output))
    }

    /// Writes the jobs of a frame.
    fn take(&self, folder: &Folder, (number, jobs): (u32, &[Job]), frames: &mut Vec<Frame>) -> Outcome {
        if frames.is_empty() {
            jobs.first().map_or(Ok(()), |job| self.check(job))?;
        }
        let text = bundle::frame_text(jobs);
        frames.push(Frame { number, moments: jobs.len() as u32, hash: bundle::text_hash(&text) });
        if frames.len() as u64 * u64::from(self.tiles) * u64::from(self.samples_split) > MOST_PARTS {
            return Err(usage(format!("the job has more than {MOST_PARTS} parts"), "give smaller --tiles"));
        }
        folder.write(&bundle::frame_file(number), text.as_bytes())
    }

    /// Refuses cuts that pictures cannot have.
    fn check(&self, job: &Job) -> Outcome {
        let (rows, path) = (job.size().height, job.request.path);
        if self.tiles > rows {
            return Err(usage(format!("a picture of {rows} rows has no {} parts", self.tiles), "give smaller --tiles"));
        }
        let is_noisy = path.is_some_and(|path| path.noise > 0.0);
        if is_noisy && self.tiles > 1 {
            let help = "give --paths alone, or no --tiles: whole frames can be parts";
            return Err(usage("a picture whose noise says when it is done cannot be cut into rows", help));
        }
        if self.samples_split == 1 {
            return Ok(());
        }
        let stereo = job.camera.and_then(|camera| camera.stereo).map(|stereo| stereo.layout);
        let why = match path {
            None => "the picture is not one of paths of light",
            Some(_) if is_noisy => "noise says how many there are",
            Some(_) if stereo == Some(StereoLayout::Anaglyph) => "the picture is for red and cyan glasses",
            Some(path) if path.samples < self.samples_split => "there are fewer of them than parts",
            Some(_) => return Ok(()),
        };
        let help = "give --paths, without --noise, or cut rows alone: --tiles";
        Err(usage(format!("samples cannot be taken apart: {why}"), help))
    }

    fn manifest(&self, job: &Job, frames: Vec<Frame>, film: Option<Reel>, output: OutputArgs) -> Manifest {
        Manifest {
            bundle: VERSION,
            program: PROGRAM.to_string(),
            hash: String::new(),
            name: job.formula.graph().name.clone(),
            size: job.size(),
            tiles: self.tiles,
            samples_split: self.samples_split,
            samples: job.request.path.map_or(1, |path| path.samples.max(1)),
            frames,
            film,
            output,
        }
    }
}

/// Copies a film's sound into the job's folder; gives its name there.
fn sound(folder: &Folder, audio: &Path) -> Result<String, Failure> {
    let bytes = fs::read(audio).map_err(|error| {
        usage(format!("cannot read the sound {}: {error}", audio.display()), "give the name of a file: --audio FILE")
    })?;
    let ending = audio.extension().unwrap_or_default().to_string_lossy();
    let name = format!("sound.{}", ending.chars().filter(char::is_ascii_alphanumeric).collect::<String>());
    folder.write(&name, &bytes)?;
    Ok(name)
}

/// What a job's parts are, as people read it.
fn counted(manifest: &Manifest) -> String {
    let Manifest { tiles, samples_split, .. } = manifest;
    let mut factors = Vec::new();
    if manifest.film.is_some() {
        factors.push(format!("{} frames", manifest.frames.len()));
    }
    for (count, what) in [(*tiles, "parts of rows"), (*samples_split, "parts of samples")] {
        if count > 1 {
            factors.push(format!("{count} {what}"));
        }
    }
    match factors.len() {
        0 => "1 part".to_string(),
        _ => format!("{} parts ({})", manifest.parts(), factors.join(" x ")),
    }
}
