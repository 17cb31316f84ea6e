//! `bulbfold gallery`: pictures of many fractals, and a page that shows them.
//!
//! Pictures are JPEG files that carry a key of what they show (formula, steps, size, program version) in a comment, so a later
//! run knows which of them are still right whatever became of the rest of the folder.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use bulbfold::calibrate::cache::hash;
use bulbfold::diag::{Diagnostic, Diagnostics};
use bulbfold::engine::{Formula, Observer, Request, Stage};
use bulbfold::files::{Chosen, read_bytes};
use bulbfold::film::Image;
use bulbfold::formula::embedded;
use bulbfold::graph::ValidGraph;
use bulbfold::load::load;
use bulbfold::shade::Size;
use clap::Args;
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;

use super::arguments::{AutoArgs, BackendArg};
use super::gallery_page::{Card, Shown, page};
use super::picture_key::graph_text;
use super::progress::short;
use super::session::formula_files;
use super::sizes::parse_size;
use super::{Failure, Outcome, Session, message, usage};

/// Version of how pictures are made; what older programs made is rendered again.
const VERSION: u32 = 3;
/// Most bytes of a picture that is looked at.
const MAX_PICTURE: u64 = 256 << 20;
/// Folder of the pictures, beside the page.
const PICTURES: &str = "pictures";
/// What a picture's comment begins with.
const MARK: &str = "bulbfold ";
/// Sizes where none is given.
const PAGE_SIZE: Size = Size { width: 640, height: 480 };
const THUMBNAIL_SIZE: Size = Size { width: 256, height: 192 };
/// JPEG qualities: no blocks that one sees at these sizes.
const PAGE_QUALITY: u8 = 88;
const THUMBNAIL_QUALITY: u8 = 82;

/// Arguments of `gallery`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold gallery -o gallery
  bulbfold gallery my_fractals flower.ron -o my_gallery --size 960x720
  bulbfold gallery --thumbnails docs/thumbnails

The page is DIR/index.html, with its pictures in DIR/pictures. It needs no network and no server, and browsers load
only the pictures on screen. A later run renders only changed pictures. Broken formulas get cards with their messages, and the exit code is 1.")]
pub struct Arguments {
    /// Formula files (.ron), folders of them, scripts or names of built-in fractals [default: all built-in fractals]
    #[arg(value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Folder for the page and its pictures; created if missing
    #[arg(short, long, value_name = "DIR", required_unless_present = "thumbnails")]
    output: Option<PathBuf>,
    /// Write small pictures NAME.jpg into this folder instead, and no page
    #[arg(long, value_name = "DIR", conflicts_with = "output")]
    thumbnails: Option<PathBuf>,
    /// Columns and rows of each picture [default: 640x480, of thumbnails 256x192]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<Size>,
    /// Samples along each edge of a pixel
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=16))]
    samples: u32,
    /// Where to compute
    #[arg(long, value_enum, default_value_t = BackendArg::Auto)]
    backend: BackendArg,
    #[command(flatten)]
    estimate: AutoArgs,
    /// Render all pictures again
    #[arg(long)]
    again: bool,
}

/// A formula and its picture.
struct Item {
    /// As commands take it.
    file: String,
    /// Without folder and ending; no two are equal.
    name: String,
    /// What was read of it, and the key of its picture; its messages where it is broken.
    read: Result<Read, String>,
}

struct Read {
    formula: Arc<Formula>,
    text: String,
    key: String,
}

/// Tells how far one of many pictures is, and its warnings.
struct Part<'a> {
    session: &'a Session,
    tell: &'a mut (dyn FnMut(f64) + Send),
}

impl Observer for Part<'_> {
    fn progress(&mut self, stage: Stage, share: f64) {
        if stage == Stage::Rendering {
            (self.tell)(share);
        }
    }

    fn warn(&mut self, warning: Diagnostic) {
        self.session.tell(warning);
    }
}

/// Runs the command.
pub fn run(arguments: &Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    let start = Instant::now();
    let folder = match (&arguments.thumbnails, &arguments.output) {
        (Some(folder), _) => folder.clone(),
        (None, Some(folder)) => folder.join(PICTURES),
        (None, None) => return Err(usage("there is no folder to write to", "say `-o DIR`")),
    };
    std::fs::create_dir_all(&folder).map_err(|error| {
        usage(format!("cannot make the folder {}: {error}", folder.display()), "choose another folder with -o")
    })?;
    let files = match arguments.files.is_empty() {
        true => embedded::FRACTALS.iter().map(|(name, _)| PathBuf::from(name)).collect(),
        false => formula_files(&arguments.files)?,
    };
    let mut items = read_all(arguments, session, files);
    let rendered = render_all(arguments, session, &mut items, &folder)?;
    let broken: Vec<&Item> = items.iter().filter(|item| item.read.is_err()).collect();
    let mut made = folder;
    if let Some(output) = &arguments.output {
        made = output.join("index.html");
        let cards: Vec<Card> = items.iter().map(|item| card(arguments, item)).collect();
        session.write(&made, page(&cards, &format!("Bulbfold {}", env!("CARGO_PKG_VERSION"))).as_bytes())?;
    }
    if !session.quiet {
        writeln!(out, "{}", made.display())?;
    }
    let kept = items.len() - broken.len() - rendered;
    let (broken_count, time) = (broken.len(), short(start.elapsed()));
    session.say(&format!("{rendered} pictures rendered, {kept} kept, {broken_count} broken ({time})"));
    if broken.is_empty() {
        return Ok(());
    }
    let texts: Vec<String> =
        broken.iter().map(|i| format!("{}: {}", i.file, i.read.as_ref().err().map_or("", |e| e.trim_end()))).collect();
    Err(Failure::Work(message(&texts.join("\n"), "all other formulas are done")))
}

fn read_all(arguments: &Arguments, session: &mut Session, files: Vec<PathBuf>) -> Vec<Item> {
    let mut items: Vec<Item> = Vec::new();
    for path in files {
        let mut d = Diagnostics::default();
        let read = match load(&mut session.library, &path, &[], &mut d) {
            Some(loaded) => Ok(Read {
                key: key(arguments, session, &loaded.graph),
                text: session.library.sources.text(loaded.text).to_string(),
                formula: Arc::new(Formula::of(session.library.clone(), loaded)),
            }),
            None => Err(d.render(&session.library.sources, false)),
        };
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let stem: String =
            stem.chars().map(|c| if c.is_ascii_alphanumeric() || "-_".contains(c) { c } else { '_' }).collect();
        let is_taken = |name: &str| items.iter().any(|item| item.name == name);
        let mut name = stem.clone();
        for i in 2.. {
            if !is_taken(&name) {
                break;
            }
            name = format!("{stem}-{i}");
        }
        items.push(Item { file: path.display().to_string(), name, read });
    }
    items
}

/// Size and quality of the pictures.
fn made_as(arguments: &Arguments) -> (Size, u8) {
    let (size, quality) = match arguments.thumbnails {
        Some(_) => (THUMBNAIL_SIZE, THUMBNAIL_QUALITY),
        None => (PAGE_SIZE, PAGE_QUALITY),
    };
    (arguments.size.unwrap_or(size), quality)
}

/// What a picture depends on: the graph with all its settings, the texts of its steps, and how it is rendered. Comments, tests
/// and descriptions do not show.
fn key(arguments: &Arguments, session: &Session, graph: &ValidGraph) -> String {
    let (size, quality) = made_as(arguments);
    let text = format!(
        "{} {VERSION} {size:?} {quality} {} {:?} {:?}\n{}",
        env!("CARGO_PKG_VERSION"),
        arguments.samples,
        arguments.estimate.settings(),
        arguments.estimate.error_budget,
        graph_text(&session.library.sources, graph)
    );
    format!("{:032x}", hash(text.as_bytes()))
}

/// Renders the pictures that are missing or show something else; says how many.
fn render_all(
    arguments: &Arguments,
    session: &mut Session,
    items: &mut [Item],
    folder: &Path,
) -> Result<usize, Failure> {
    let path = |item: &Item| folder.join(format!("{}.jpg", item.name));
    let is_due = |item: &Item| item.read.as_ref().is_ok_and(|read| arguments.again || !shows(&path(item), &read.key));
    let due: Vec<usize> = (0..items.len()).filter(|&i| is_due(&items[i])).collect();
    let (size, quality) = made_as(arguments);
    let mut progress = session.progress();
    let mut rendered = 0;
    for (done, &i) in due.iter().enumerate() {
        let Ok(Read { formula, key, .. }) = &items[i].read else { continue };
        let count = due.len() as f64;
        let request = Request {
            samples: arguments.samples,
            backend: arguments.backend.choice(),
            ..arguments.estimate.request(size)
        };
        let mut part = Part { session, tell: &mut |share| progress.update((done as f64 + share) / count) };
        let image = session.engine.picture(formula, &request, &mut part).map_err(|error| session.failed(error));
        match image {
            Ok(image) => {
                let path = path(&items[i]);
                session.write(&path, &jpeg(&image, quality, key))?;
                rendered += 1;
            }
            Err(Failure::Usage(why) | Failure::Work(why)) => items[i].read = Err(why),
            Err(Failure::ClosedPipe) => return Err(Failure::ClosedPipe),
        }
        progress.update((done + 1) as f64 / count);
    }
    progress.finish();
    Ok(rendered)
}

/// A JPEG file that carries a key in its first comment.
fn jpeg(image: &Image, quality: u8, key: &str) -> Vec<u8> {
    let mut bytes = Vec::new();
    let Size { width, height } = image.size;
    JpegEncoder::new_with_quality(&mut bytes, quality)
        .encode(&image.rgb, width, height, ExtendedColorType::Rgb8)
        .expect("sizes are below 65536 and the picture is complete");
    let comment = comment(key);
    // Behind the marker that begins the file.
    bytes.splice(2..2, comment);
    bytes
}

/// The comment segment of a key.
fn comment(key: &str) -> Vec<u8> {
    let text = format!("{MARK}{key}");
    let length = (text.len() + 2) as u16;
    [&[0xff, 0xfe], &length.to_be_bytes()[..], text.as_bytes()].concat()
}

/// Whether a file is a picture of this key.
fn shows(path: &Path, key: &str) -> bool {
    read_bytes(path, MAX_PICTURE, Chosen::Found).is_ok_and(|bytes| {
        // A file that was cut off lacks the marker at the end.
        bytes.get(2..).is_some_and(|rest| rest.starts_with(&comment(key))) && bytes.ends_with(&[0xff, 0xd9])
    })
}

fn card(arguments: &Arguments, item: &Item) -> Card {
    let (size, _) = made_as(arguments);
    let shown = item.read.as_ref().map_err(Clone::clone).map(|read| Shown {
        picture: format!("{PICTURES}/{}.jpg", item.name),
        size,
        command: command(arguments, item, size),
        formula: read.text.clone(),
        graph: read.formula.graph().clone(),
    });
    Card { name: item.name.clone(), file: item.file.clone(), shown }
}

/// The command that renders the same picture.
fn command(arguments: &Arguments, item: &Item, size: Size) -> String {
    let file = &item.file;
    let is_plain = file.chars().all(|c| c.is_ascii_alphanumeric() || "-_./".contains(c));
    let file = if is_plain { file.clone() } else { format!("'{}'", file.replace('\'', "'\\''")) };
    let (Size { width, height }, samples, name) = (size, arguments.samples, &item.name);
    format!("bulbfold render {file} --size {width}x{height} --samples {samples} -o {name}.png")
}

#[cfg(test)]
mod tests {
    use bulbfold::film::Image;
    use bulbfold::shade::Size;

    use super::{jpeg, shows};

    #[test]
    fn pictures_know_what_they_show() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.jpg");
        assert!(!shows(&path, "k"));
        let bytes = jpeg(&Image::new(Size { width: 9, height: 7 }), 80, "k");
        std::fs::write(&path, &bytes).unwrap();
        assert!(shows(&path, "k") && !shows(&path, "l") && !shows(&path, "kk"));
        let image = image::load_from_memory(&bytes).expect("the comment breaks nothing");
        assert_eq!((image.width(), image.height()), (9, 7));
        std::fs::write(&path, &bytes[..bytes.len() - 1]).unwrap();
        assert!(!shows(&path, "k"), "half a file is no picture");
    }
}
