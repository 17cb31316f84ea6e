//! `bulbfold watch`: a formula is rendered on every save, in the terminal and on a page of this machine.
//!
//! The file is the truth: what the page moves (numbers, a preset, the camera) is kept beside it until `Write` puts it into the file.

mod desk;
mod saved;
mod server;

use std::io::Write;
use std::sync::Arc;

use bulbfold::engine::Request;
use bulbfold::film::is_picture;
use bulbfold::shade::Size;
use clap::Args;

use self::desk::Desk;
use self::saved::Saved;
use super::arguments::{AutoArgs, BackendArg, FormulaArgs};
use super::camera::{CameraArgs, usual_size};
use super::output::opened;
use super::picture_args::PathArgs;
use super::session::talk;
use super::sizes::parse_size;
use super::{Outcome, Session, message, usage};

/// Arguments of `watch`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold new flower && bulbfold watch flower.ron --open
  bulbfold watch mandelbox.ron --size 1920x1080 --no-page
  bulbfold watch scene.ron --integrator path --paths 64

The page shows the picture, a slider for each number that has a range, and the presets. Drag to go around the target, with the right button or
shift to move sideways, turn the wheel to go nearer; W A S D, space and C fly at a speed that follows the distance to the surface, arrows turn, Q and E
roll. `Write into the file` keeps all of it, and comments and format stay as they are. Ctrl-C ends.")]
pub struct Arguments {
    #[command(flatten)]
    formula: FormulaArgs,
    /// Columns and rows of the whole picture [default: 1280x720]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<Size>,
    /// Samples along each edge of a pixel of the whole picture
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=16))]
    samples: u32,
    #[command(flatten)]
    path: PathArgs,
    /// Where to compute
    #[arg(long, value_enum, default_value_t = BackendArg::Auto)]
    backend: BackendArg,
    #[command(flatten)]
    estimate: AutoArgs,
    #[command(flatten)]
    camera: CameraArgs,
    /// Port of the page, on this machine alone; 0 is a free one
    #[arg(long, value_name = "PORT", default_value_t = 0)]
    port: u16,
    /// Open the page in the browser
    #[arg(long, conflicts_with = "no_page")]
    open: bool,
    /// Serve no page
    #[arg(long)]
    no_page: bool,
    /// Show no picture in the terminal
    #[arg(long)]
    no_preview: bool,
}

/// Runs the command, until the program is ended.
pub fn run(arguments: &mut Arguments, session: Session, out: &mut dyn Write) -> Outcome {
    let camera = &mut arguments.camera;
    arguments.formula.take_changes(|path, value| camera.takes(path, value));
    let arguments = &*arguments;
    let file = &arguments.formula.file;
    if is_picture(file) {
        return Err(usage(
            "a picture is not watched, but the file of a formula",
            "`bulbfold new NAME --from PICTURE` writes one",
        ));
    }
    if !file.is_file() {
        let help =
            "`bulbfold new NAME` writes one; `bulbfold new NAME --from FRACTAL` one that is like a built-in fractal";
        return Err(usage(format!("there is no file {} to watch", file.display()), help));
    }
    let request = request(arguments);
    request.first_precision().map_err(|error| session.failed(error))?;
    let saved = Saved::new(file);
    let shows = !arguments.no_preview && !session.quiet;
    let desk = Desk::new(session, (file.clone(), arguments.formula.changes()), request, shows);
    if !arguments.no_page {
        let page = server::start(Arc::clone(&desk), arguments.port).map_err(|error| {
            usage(format!("no page on port {}: {error}", arguments.port), "choose another `--port`, or `--no-page`")
        })?;
        writeln!(out, "{page}")?;
        out.flush()?;
        if arguments.open {
            opened(page.as_ref()).unwrap_or_else(|error| talk(&message(&error, "open the address above yourself")));
        }
    }
    saved.follow(&desk)
}

/// The whole picture that is wanted.
fn request(arguments: &Arguments) -> Request {
    let change = arguments.camera.change();
    let size = arguments.size.unwrap_or_else(|| usual_size(&change, None));
    Request {
        samples: arguments.samples,
        camera: change,
        backend: arguments.backend.choice(),
        path: arguments.path.tracing(0),
        ..arguments.estimate.request(size)
    }
}
