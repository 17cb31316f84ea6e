//! `bulbfold fly`: a flight that finds its way by itself, as a file to render and to change.

use std::path::PathBuf;

use bulbfold::diag::{Diagnostics, SourceId};
use bulbfold::engine::path::{CameraPath, Flight, PathSettings, View, fly};
use bulbfold::engine::{Formula, Request};
use bulbfold::formula::ron::{Limits, read_ron};
use bulbfold::formula::value::ValueKind;
use bulbfold::live::with_changes;
use bulbfold::render::Search;
use clap::Args;

use super::arguments::{AutoArgs, FormulaArgs, parse_positive};
use super::camera::CameraArgs;
use super::output::{Content, check_output, write};
use super::session::{refuse_plane, talk};
use super::{Failure, Outcome, Session, message, usage};

/// Arguments of `fly`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold fly menger --seed 3 --seconds 20
  bulbfold animate menger_flight.ron -o flight.mp4
  bulbfold fly mandelbox --camera 0.1,0.2,0.3 --target 1,0,0 --seconds 12 -o box_flight.ron
  bulbfold path menger_flight.ron --plot flight.svg

The file is the formula with `animation: (camera: Path(...))`: its views can be changed, moved and left out.")]
pub struct Arguments {
    #[command(flatten)]
    formula: FormulaArgs,
    /// Other seeds fly other ways
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Length of the flight
    #[arg(long, value_name = "S", default_value_t = 20.0, value_parser = parse_positive)]
    seconds: f64,
    /// Speed: distances to the surface a second
    #[arg(long, value_name = "N", default_value_t = 0.9, value_parser = parse_positive)]
    pace: f64,
    #[command(flatten)]
    camera: CameraArgs,
    #[command(flatten)]
    estimate: AutoArgs,
    /// The file to write; - is stdout [default: NAME_flight.ron]
    #[arg(short, long, value_name = "OUT.ron")]
    output: Option<PathBuf>,
}

/// Places that a flight may begin at, and the angle of view inside, in radians.
const PLACES: usize = 12;
const FOV: f64 = 1.15;

/// Runs the command.
pub fn run(arguments: &mut Arguments, session: &mut Session) -> Outcome {
    let camera = &mut arguments.camera;
    arguments.formula.take_changes(|path, value| camera.takes(path, value));
    let arguments = &*arguments;
    let file = &arguments.formula.file;
    let stem = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let output = arguments.output.clone().unwrap_or_else(|| PathBuf::from(format!("{stem}_flight.ron")));
    let target = check_output(&output, Some("ron"), Content::Text)?;
    let changes = arguments.formula.changes();
    let loaded = session.load(file, &changes)?;
    let text = session.library.sources.text(loaded.text).to_string();
    let formula = std::sync::Arc::new(Formula::of(session.library.clone(), loaded));
    refuse_plane(formula.graph(), "`fly`")?;
    session.spare_inputs(&target)?;
    if formula.bundle().is_script() {
        let help = "give a .ron file; a script says `fn camera(t)` itself";
        return Err(usage("a flight is written into a formula's RON file, and this is a script", help));
    }
    let request =
        Request { camera: arguments.camera.change(), ..arguments.estimate.request(super::picture_args::DEFAULT_SIZE) };
    let (views, clearance) = found(arguments, session, &formula, &request)?;
    let animation = animation(&views, (arguments, clearance));
    let text =
        with_changes(&text, &changes).map_err(|error| usage(error, "write the change into a file of your own"))?;
    let text = session.library.sources.add(file.display().to_string(), text);
    let written = with_animation(session, text, &animation)?;
    let note =
        format!("// A flight by `bulbfold fly {stem} --seed {} --seconds {}`.\n", arguments.seed, arguments.seconds);
    write(&target, format!("{note}{written}").as_bytes())?;
    if !target.is_stream() {
        let shown = output.display();
        talk(&format!("wrote {shown}: {} views; next: bulbfold animate {shown} -o {stem}_flight.mp4", views.len()));
    }
    Ok(())
}

/// The views of a flight, and the clearance that its path keeps.
fn found(
    arguments: &Arguments,
    session: &Session,
    formula: &std::sync::Arc<Formula>,
    request: &Request,
) -> Result<(Vec<View>, f64), Failure> {
    let failed = |error| session.failed(error);
    let own = formula.graph().scene.camera;
    let up = arguments.camera.up.or(own.map(|camera| camera.up)).unwrap_or([0.0, 0.0, 1.0]);
    let clearance = session.engine.clearance(formula, request).map_err(failed)?;
    let mut starts = Vec::new();
    if arguments.camera.camera.is_some() {
        starts.extend(session.engine.camera(formula, request).map_err(failed)?);
    } else {
        for interior in [true, false] {
            let search = Search { interior, count: PLACES, seed: arguments.seed, size: request.size, up };
            let asked = Request { camera: Default::default(), ..request.clone() };
            let views = session.engine.views(formula, &asked, &search).map_err(failed)?;
            starts.extend(views.into_iter().map(|view| view.camera));
        }
    }
    let flight = Flight {
        seed: arguments.seed,
        seconds: arguments.seconds,
        pace: arguments.pace,
        up,
        fov: arguments.camera.fov.unwrap_or(FOV),
        radius: clearance.bounding_radius(),
    };
    let distances = |points: &[[f64; 3]]| clearance.of(points);
    for camera in &starts {
        let ahead = [0, 1, 2].map(|k| camera.target[k] - camera.position[k]);
        let Ok(views) = fly(&flight, (camera.position, ahead), &distances) else { continue };
        let settings = PathSettings { even: true, ..PathSettings::default() };
        let Ok(path) = CameraPath::new(&views, settings, &distances) else { continue };
        if path.tightest().is_none() {
            return Ok((views, path.least_clearance()));
        }
    }
    let help = "give a free place with --camera X,Y,Z, or another --seed; `bulbfold look NAME --interior` finds places";
    Err(Failure::Work(message(&format!("no open way was found from {} places", starts.len()), help)))
}

/// The animation as a file holds it.
fn animation(views: &[View], (arguments, clearance): (&Arguments, f64)) -> String {
    let vector = |v: [f64; 3]| format!("({}, {}, {})", v[0], v[1], v[2]);
    let mut text =
        format!("(\n        seconds: {},\n        camera: Path(\n            pace: even,\n", arguments.seconds);
    text.push_str(&format!("            clearance: {clearance},\n            keys: [\n"));
    for View { time, camera } in views {
        text.push_str(&format!(
            "                ({time}, (position: {}, target: {}, up: {}, fov: {})),\n",
            vector(camera.position),
            vector(camera.target),
            vector(camera.up),
            camera.fov.to_degrees()
        ));
    }
    text.push_str("            ],\n        ),\n    )");
    text
}

/// The text of a formula with another animation.
fn with_animation(session: &Session, id: SourceId, animation: &str) -> Result<String, Failure> {
    let sources = &session.library.sources;
    let text = sources.text(id);
    let mut d = Diagnostics::default();
    let value = read_ron(sources, id, &Limits::default(), &mut d);
    let fields = value.as_ref().and_then(|value| match &value.kind {
        ValueKind::Struct { fields, .. } => Some(fields),
        _ => None,
    });
    let Some(fields) = fields.filter(|fields| !fields.is_empty()) else {
        return Err(usage("the formula has no fields", "write `(nodes: {...})`"));
    };
    let (mut written, mut from) = (String::new(), 0);
    for (name, value) in fields.iter().filter(|(name, _)| name.text == "animation") {
        let start = name.span.range().start;
        written.push_str(&text[from..start]);
        let end = value.span.range().end;
        let comma = text[end..].find(|c: char| !c.is_whitespace()).filter(|at| text[end + at..].starts_with(','));
        from = end + comma.map_or(0, |at| at + 1);
    }
    let end = text.rfind(')').filter(|end| *end >= from).unwrap_or(text.len());
    // A comma behind the last field, in front of whatever comment follows.
    let last = fields.last().map_or(from, |(_, value)| value.span.range().end).max(from);
    let has_comma = last == from || text[last..].trim_start().starts_with(',');
    written.push_str(&text[from..last]);
    written.push_str(if has_comma { "" } else { "," });
    written.push_str(text[last..end].trim_end());
    Ok(format!("{written}\n    animation: {animation},\n{}", &text[end..]))
}
