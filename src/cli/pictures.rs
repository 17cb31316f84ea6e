//! The files of a picture: names, formats, what they hold, and which of them may be replaced.

use std::path::{Path, PathBuf};

use bulbfold::engine::{Job, Request};
use bulbfold::files::Target;
use bulbfold::film::{Depth, Develop, Form, Format, Layer, Layers, PictureFile, Pictures, read_made};
use bulbfold::graph::{Film, Scene, StereoLayout};
use clap::Args;
use serde::{Deserialize, Serialize};

use super::output::{Content, cannot_write, check_output, not_written};
use super::{Failure, Outcome, Session, usage};

/// Where a picture goes, and in which form.
#[derive(Args, Clone, Default, Serialize, Deserialize, Debug)]
#[command(next_help_heading = "Picture")]
pub struct OutputArgs {
    /// The picture to write; its ending names the format: png, exr, tif, jpg, webp or hdr. A folder's name with / at its end
    /// takes NAME.png; - is stdout. May be given several times [default: NAME.png]
    #[arg(short, long, value_name = "OUT")]
    output: Vec<PathBuf>,
    /// Bits of a colour's number in PNG and TIFF: 8 or 16
    #[arg(long, value_name = "BITS", value_parser = parse_depth)]
    depth: Option<Depth>,
    /// Leave the background out: PNG, TIFF and WebP say how much of a pixel is covered, EXR has colours of surfaces alone
    #[arg(long)]
    transparent: bool,
    /// Pixels an inch, for printers
    #[arg(long, value_name = "N", value_parser = parse_dpi)]
    dpi: Option<f64>,
    /// What an EXR file holds besides colour: alpha, depth, position, normal, albedo, occlusion, trap, iterations, steps, confidence; or none
    /// [default: alpha,depth,normal,albedo]
    #[arg(long, value_name = "LAYERS", value_delimiter = ',', value_parser = parse_layer)]
    layers: Vec<Option<Layer>>,
    /// Replace a picture by another one
    #[arg(long)]
    force: bool,
}

/// Those of an EXR file where none is.
const USUAL: [Layer; 4] = [Layer::Alpha, Layer::Depth, Layer::Normal, Layer::Albedo];

fn parse_depth(text: &str) -> Result<Depth, String> {
    match text {
        "8" => Ok(Depth::Eight),
        "16" => Ok(Depth::Sixteen),
        _ => Err("write 8 or 16; EXR files have 32 bits of floating point".into()),
    }
}

fn parse_dpi(text: &str) -> Result<f64, String> {
    let dpi = super::arguments::parse_positive(text)?;
    if (1.0..=65_535.0).contains(&dpi) { Ok(dpi) } else { Err("it must be from 1 to 65535".into()) }
}

fn parse_layer(text: &str) -> Result<Option<Layer>, String> {
    let asked = || Layer::ALL.into_iter().filter(|layer| layer.is_besides());
    match asked().find(|layer| layer.name() == text) {
        None if text == "none" => Ok(None),
        None => Err(format!("choose some of: {}, none", asked().map(Layer::name).collect::<Vec<_>>().join(", "))),
        known => Ok(known),
    }
}

/// A file that a picture is to have.
pub struct Wanted {
    /// Where it goes.
    pub target: Target,
    /// How.
    pub format: Format,
    /// Whether the picture names it itself, and finds a free name.
    is_own: bool,
}

impl OutputArgs {
    /// All names.
    pub fn names(&self) -> &[PathBuf] {
        &self.output
    }

    /// The same of other names, which may replace other pictures or not.
    #[must_use]
    pub fn with_names(&self, names: Vec<PathBuf>, force: bool) -> OutputArgs {
        OutputArgs { output: names, force, ..self.clone() }
    }

    /// The only name; none where none is given.
    pub fn only(&self, what: &str) -> Result<Option<&PathBuf>, Failure> {
        match &self.output[..] {
            [] => Ok(None),
            [name] => Ok(Some(name)),
            _ => Err(usage(format!("{what} has one output"), "give -o once")),
        }
    }

    /// Refuses files' names where there are several pictures, which need a folder.
    pub fn want_folder(&self) -> Outcome {
        match self.output.iter().find(|name| !names_folder(name) && !name.is_dir()) {
            None => Ok(()),
            Some(name) => {
                let text = format!("{} is one file, and there are several pictures", name.display());
                Err(usage(
                    text,
                    &format!("name a folder, with / at its end: -o {}/", name.with_extension("").display()),
                ))
            }
        }
    }

    /// What is said of the files besides their names; nothing of plain ones.
    pub fn forms(&self) -> String {
        let is_plain = self.depth.is_none() && !self.transparent && self.dpi.is_none() && self.layers.is_empty();
        if is_plain { String::new() } else { format!("{:?}", (self.depth, self.transparent, self.dpi, &self.layers)) }
    }

    /// Refuses what says more of a file than its name.
    pub fn refuse_forms(&self, what: &str) -> Outcome {
        match self.forms().is_empty() {
            true => Ok(()),
            false => {
                Err(usage(format!("{what} is an 8-bit PNG file"), "drop --depth, --transparent, --dpi and --layers"))
            }
        }
    }

    /// The files, looked at; `stem` names those that have no name of their own.
    pub fn wanted(&self, stem: &Path) -> Result<Vec<Wanted>, Failure> {
        let own = |folder: &Path| {
            let mut name = stem.as_os_str().to_os_string();
            name.push(".png");
            folder.join(name)
        };
        let named = |name: &PathBuf| {
            if names_folder(name) || name.is_dir() { (own(name), true) } else { (name.clone(), false) }
        };
        let names = match self.output.is_empty() {
            true => vec![(own(Path::new("")), true)],
            false => self.output.iter().map(named).collect(),
        };
        for folder in self.output.iter().filter(|name| names_folder(name)) {
            std::fs::create_dir_all(folder).map_err(|error| cannot_write(folder, &error))?;
        }
        let mut wanted: Vec<Wanted> = Vec::new();
        for (i, (name, is_own)) in names.iter().enumerate() {
            if names[..i].iter().any(|(other, _)| other == name) {
                return Err(usage(format!("{} is named twice", name.display()), "give each -o once"));
            }
            wanted.push(Wanted { is_own: *is_own, ..self.file(name)? });
        }
        if wanted.iter().filter(|file| file.target.is_stdout()).count() > 1 {
            return Err(usage("two pictures would both go to stdout", "give each -o once"));
        }
        if !self.layers.is_empty() && !wanted.iter().any(|file| file.format.has_layers()) {
            return Err(usage("only EXR files have `--layers`", "write one: -o NAME.exr"));
        }
        Ok(wanted)
    }

    /// One file, whose format must be able to do what is asked for.
    pub fn file(&self, name: &Path) -> Result<Wanted, Failure> {
        let (shown, target) = (name.display(), check_output(name, None, Content::Bytes)?);
        let format = match Format::of(name) {
            Some(format) => format,
            None if target.is_stream() => Format::Png,
            None => {
                let endings: Vec<String> = Format::ENDINGS.iter().map(|(ending, _)| format!(".{ending}")).collect();
                let text = format!("the ending of the output {shown} names no format of pictures");
                return Err(usage(text, &format!("choose one of: {}", endings.join(", "))));
            }
        };
        if self.transparent && !format.has_alpha() {
            return Err(usage(
                format!("{shown} cannot have a transparent background: its format has no place for one"),
                "choose .png, .tif, .webp or .exr",
            ));
        }
        if self.depth == Some(Depth::Sixteen) && !format.is_deep() && !format.is_light() {
            let text = format!("{shown} cannot have 16 bits: its format has 8");
            return Err(usage(text, "choose .png or .tif; .exr has 32 bits of floating point"));
        }
        Ok(Wanted { target, format, is_own: false })
    }

    /// The layers that a file of a format wants.
    ///
    /// Errors: planes and pictures of paths have none.
    pub fn layers(&self, format: Format, has_layers: bool) -> Result<Layers, Failure> {
        let is_asked = self.transparent || self.layers.iter().any(Option::is_some);
        if is_asked && !has_layers {
            return Err(usage(
                "a picture of a plane, of paths of light or for red and cyan glasses has neither a transparent background nor layers",
                "drop --transparent and --layers, or render without --integrator path",
            ));
        }
        Ok(self.held(format, has_layers).wanted().data())
    }

    /// What a file of a format holds, as far as the arguments say.
    fn held(&self, format: Format, has_layers: bool) -> Form {
        let layers = match (format.has_layers() && has_layers, self.layers.is_empty()) {
            (false, _) => Layers::NONE,
            (true, true) => USUAL.into_iter().collect(),
            (true, false) => self.layers.iter().flatten().copied().collect(),
        };
        Form {
            format,
            size: super::picture_args::DEFAULT_SIZE,
            depth: self.depth.filter(|_| format.is_deep()).unwrap_or_default(),
            transparent: self.transparent,
            dpi: self.dpi,
            layers,
            film: Film::default(),
            kind: Develop::SOLID,
            key: None,
        }
    }

    /// What the file of a scene's picture holds.
    pub fn form(&self, format: Format, request: &Request, scene: &Scene, key: &str) -> Form {
        let kind = if scene.plane.is_some() { Develop::PLANE } else { Develop::SOLID };
        let held = self.held(format, has_layers(scene, request));
        Form { size: request.size, film: scene.film, kind, key: Some(key.to_string()), ..held }
    }

    /// The files of a settled picture; nothing is written yet.
    ///
    /// Errors: one of them is another picture already.
    pub fn open(&self, session: &Session, wanted: &[Wanted], job: &Job, key: &str) -> Result<Pictures, Failure> {
        let composed = job.composed().map_err(|error| session.failed(error))?;
        let scene = &composed.graph.scene;
        let mut files = Vec::new();
        for file in wanted {
            let target = if self.force { file.target.clone() } else { settled(file, key)? };
            let form = self.form(file.format, &job.request, scene, key);
            files.push(PictureFile::new(&target, form).map_err(|error| not_written(&target, &error))?);
        }
        Ok(Pictures(files))
    }
}

/// Whether a picture has layers besides its colours.
pub fn has_layers(scene: &Scene, request: &Request) -> bool {
    let own = scene.camera.and_then(|camera| camera.stereo).map(|stereo| stereo.layout);
    let is_anaglyph = request.camera.stereo.or(own) == Some(StereoLayout::Anaglyph);
    scene.plane.is_none() && request.path.is_none() && !is_anaglyph
}

/// Whether a name means the folder that a picture goes into.
fn names_folder(name: &Path) -> bool {
    name.as_os_str().as_encoded_bytes().last().is_some_and(|&end| std::path::is_separator(char::from(end)))
}

/// Names that are tried for a picture that names itself.
const MOST_NAMES: u32 = 9999;

/// The target of a picture: what was named, or the first of NAME.png, NAME_2.png, ... that is free or the same picture.
fn settled(file: &Wanted, key: &str) -> Result<Target, Failure> {
    let refused = match refuse_other(&file.target, key, !file.is_own) {
        Ok(()) => return Ok(file.target.clone()),
        Err(refused) if !file.is_own => return Err(refused),
        Err(refused) => refused,
    };
    let path = file.target.path();
    let stem = path.file_stem().unwrap_or_default();
    for number in 2..=MOST_NAMES {
        let mut name = stem.to_os_string();
        name.push(format!("_{number}.png"));
        let target = check_output(&path.with_file_name(name), None, Content::Bytes)?;
        if refuse_other(&target, key, false).is_ok() {
            return Ok(target);
        }
    }
    Err(refused)
}

/// Refuses to replace a file that is not the same picture. One that is empty holds nothing; another picture of this program is replaced
/// where its name was given, as people expect who change a formula and render it again.
fn refuse_other(target: &Target, key: &str, is_named: bool) -> Outcome {
    let path = target.path();
    if !target.is_taken() || std::fs::metadata(path).is_ok_and(|data| data.len() == 0) {
        return Ok(());
    }
    let what = match read_made(path) {
        Ok(made) if made.key.as_deref() == Some(key) => return Ok(()),
        Ok(made) if made.key.is_some() && is_named => return Ok(()),
        Ok(made) if made.key.is_some() => "is another picture",
        Ok(_) => "does not say which picture it is",
        Err(_) => "is something else",
    };
    let text = format!("{} {what} and is not overwritten", path.display());
    Err(usage(text, "choose another name with -o, or replace it with --force"))
}
