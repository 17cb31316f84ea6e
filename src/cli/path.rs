//! `bulbfold path`: the way of a film's camera, as a drawing and for other programs.

use std::io::Write;
use std::path::PathBuf;

use bulbfold::chart::{path::PathChart, raster, svg};
use bulbfold::engine::path::Place;
use bulbfold::engine::{Moments, Request};
use bulbfold::exchange::camera::{CameraFilm, Posed};
use bulbfold::shade::Size;
use clap::Args;

use super::animate::FilmArgs;
use super::arguments::{AutoArgs, FormulaArgs};
use super::camera::CameraArgs;
use super::moments::FilmMoments;
use super::output::{Content, check_output, not_written, write};
use super::session::talk;
use super::sizes::parse_size;
use super::{Failure, Outcome, Session, message, usage};

/// Arguments of `path`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold path flight.ron
  bulbfold path flight.ron --plot flight.svg
  bulbfold path flight.ron -o camera.gltf -o camera.usda -o camera.json
  bulbfold path mandelbox --way 'Dive(zoom: 10000)' --seconds 12 --plot dive.png")]
pub struct Arguments {
    #[command(flatten)]
    formula: FormulaArgs,
    #[command(flatten)]
    film: FilmArgs,
    #[command(flatten)]
    camera: CameraArgs,
    #[command(flatten)]
    estimate: AutoArgs,
    /// Draw way, clearance and speed: .svg or .png
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Write the moving camera for other programs: .gltf, .usda or .json. May be given several times
    #[arg(short, long, value_name = "FILE")]
    output: Vec<PathBuf>,
    /// Columns and rows of the film's pictures, for other programs
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = parse_size)]
    size: Size,
}

/// Runs the command.
pub fn run(arguments: &mut Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    let camera = &mut arguments.camera;
    arguments.formula.take_changes(|path, value| camera.takes(path, value));
    let arguments = &*arguments;
    let ending =
        |path: &PathBuf| path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    for name in &arguments.output {
        if !["gltf", "usda", "json"].contains(&ending(name).as_str()) {
            let text = format!("the ending of {} names no format of cameras", name.display());
            return Err(usage(text, "write .gltf, .usda or .json"));
        }
        check_output(name, None, Content::Text)?;
    }
    if let Some(plot) = arguments.plot.as_ref().filter(|plot| !["svg", "png"].contains(&ending(plot).as_str())) {
        return Err(usage(format!("the plot {} must end in .svg or .png", plot.display()), "write --plot path.svg"));
    }
    let request = Request { camera: arguments.camera.change(), ..arguments.estimate.request(arguments.size) };
    let changes = arguments.formula.changes();
    let moments = arguments.film.moments(session, (&arguments.formula.file, changes), arguments.camera, &request)?;
    let places = places(session, &moments, &request)?;
    let name = arguments.formula.file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let rate = moments.clock.rate;
    let poses = places.iter().map(|place| Posed { time: place.time, camera: place.camera }).collect();
    let film = CameraFilm { name: name.clone(), poses, rate: (rate.frames, rate.seconds), size: arguments.size };
    for path in &arguments.output {
        let text = match ending(path).as_str() {
            "gltf" => film.gltf(),
            "usda" => film.usda(),
            _ => film.json(),
        };
        if film.zooms() && ending(path) == "gltf" {
            session
                .warn("the angle of view changes, and glTF keeps that of the first frame\nwrite .usda, which has it");
        }
        write(&check_output(path, None, Content::Text)?, text.as_bytes())?;
        talk(&path.display().to_string());
    }
    let chart = PathChart { name, places };
    if let Some(plot) = &arguments.plot {
        let failed = |error: String| Failure::Work(message(&error, ""));
        let target = check_output(plot, None, Content::Bytes)?;
        session.spare_inputs(&target)?;
        let drawing = chart.drawing();
        match ending(plot).as_str() {
            "svg" => write(&target, svg(&drawing).map_err(failed)?.as_bytes())?,
            _ => raster(&drawing, 1.5).map_err(failed)?.write_png_to(&target).map_err(|e| not_written(&target, &e))?,
        }
        talk(&plot.display().to_string());
    }
    tell(&chart, out)
}

/// The camera of each frame, with the distance to what the frame shows.
fn places(session: &Session, moments: &FilmMoments, request: &Request) -> Result<Vec<Place>, Failure> {
    let failed = |error| session.failed(error);
    let (mut places, mut known) = (Vec::new(), None);
    for frame in 0..moments.clock.frames {
        let moment = moments.moment((frame * moments.clock.blur) as usize).map_err(failed)?;
        let asked = Request { camera: moment.camera, ..request.clone() };
        let Some(camera) = session.engine.camera(&moment.formula, &asked).map_err(failed)? else {
            return Err(usage("a picture of a plane has no camera", "drop `plane`"));
        };
        if known.is_none() || !moments.show_one_set() {
            known = Some(session.engine.clearance(&moment.formula, request).map_err(failed)?);
        }
        let clearance = known.as_ref().map_or(0.0, |clearance| clearance.of(&[camera.position])[0]);
        places.push(Place { time: moments.clock.rate.time(f64::from(frame)), camera, clearance });
    }
    Ok(places)
}

/// The numbers of a path in a few lines.
fn tell(chart: &PathChart, out: &mut dyn Write) -> Outcome {
    let clearances = chart.places.iter().map(|place| place.clearance);
    let (least, most) = clearances.clone().fold((f64::INFINITY, 0.0f64), |(a, b), c| (a.min(c), b.max(c)));
    let inside = clearances.filter(|clearance| *clearance <= 0.0).count();
    let paces = chart.paces();
    let inner = &paces[paces.len() / 8..(paces.len() - paces.len() / 8).max(paces.len() / 8 + 1).min(paces.len())];
    let mean = inner.iter().map(|pace| pace.1).sum::<f64>() / inner.len().max(1) as f64;
    let (slow, fast) = inner.iter().fold((f64::INFINITY, 0.0f64), |(a, b), pace| (a.min(pace.1), b.max(pace.1)));
    writeln!(out, "frames               {}", chart.places.len())?;
    writeln!(out, "distance to surface  {least:.3e} to {most:.3e} world units; {inside} frames in the set")?;
    writeln!(
        out,
        "speed                {mean:.3} distances to the surface a second ({slow:.3} to {fast:.3} but for the ends)"
    )?;
    Ok(())
}
