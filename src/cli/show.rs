//! `bulbfold show`: how a picture was made.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;
use serde_json::{Value, json};

use super::again::made;
use super::{Outcome, usage};

/// Arguments of `show`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold show bulb.png
  bulbfold show bulb.exr --json | jq .recipe.job.camera
  bulbfold render bulb.png -o large.png --size 3840x2160      the same view, larger

Nothing that the picture holds is run.")]
pub struct Arguments {
    /// A picture that `bulbfold render` has written
    picture: PathBuf,
    /// Print everything as one JSON object
    #[arg(long)]
    json: bool,
}

/// Counts changes of the object's fields.
const VERSION: u32 = 1;

/// Runs the command.
pub fn run(arguments: &Arguments, out: &mut dyn Write) -> Outcome {
    let (made, text) = made(&arguments.picture)?;
    let recipe: Value = serde_json::from_str(&text).map_err(|error| {
        let shown = arguments.picture.display();
        usage(format!("the recipe of {shown} is damaged: {error}"), "render the formula itself")
    })?;
    if arguments.json {
        let whole = json!({ "version": VERSION, "key": made.key, "recipe": recipe });
        return Ok(writeln!(out, "{}", serde_json::to_string_pretty(&whole).unwrap_or_default())?);
    }
    let key = made.key.unwrap_or_else(|| "none".into());
    for (name, text) in lines(&recipe).into_iter().chain([("key", key)]).filter(|(_, text)| !text.is_empty()) {
        writeln!(out, "{name:<10} {text}")?;
    }
    let formula = &recipe["job"]["formula"];
    for step in formula["steps"].as_array().into_iter().flatten() {
        writeln!(out, "\nstep {}:\n{}", word(&step[0]), word(&step[1]).trim_end())?;
    }
    writeln!(out, "\n{}:\n{}", word(&formula["name"]), word(&formula["text"]).trim_end())?;
    Ok(())
}

/// What the recipe says, a line each.
fn lines(recipe: &Value) -> Vec<(&'static str, String)> {
    let job = &recipe["job"];
    let (request, camera) = (&job["request"], &job["camera"]);
    let size = &request["size"];
    let samples = &request["samples"];
    let changes: Vec<String> = changes(recipe).iter().map(|(path, value)| flag(path, value)).collect();
    let estimate =
        |choice: &Value| format!("{}, {}, fudge {}", word(&choice["method"]), word(&choice["form"]), choice["fudge"]);
    let estimates: Vec<String> = job["plan"]["choices"].as_array().into_iter().flatten().map(estimate).collect();
    vec![
        ("formula", word(&job["formula"]["name"])),
        ("changes", changes.join(" ")),
        ("camera", camera_flags(camera)),
        ("size", format!("{}x{}", size["width"], size["height"])),
        ("samples", format!("{samples}x{samples}, {}", word(&request["sampling"]).to_lowercase())),
        ("precision", word(&job["precision"]).to_lowercase()),
        ("estimate", estimates.join("; ")),
        ("back end", word(&recipe["backend"])),
        ("version", word(&job["version"])),
    ]
}

/// What was changed in the formula: pairs of a path and a value.
pub fn changes(recipe: &Value) -> Vec<(String, String)> {
    let pair = |change: &Value| (word(&change[0]), word(&change[1]));
    recipe["job"]["formula"]["set"].as_array().into_iter().flatten().map(pair).collect()
}

/// A change as it is written on the command line.
pub fn flag(path: &str, value: &str) -> String {
    match path {
        "preset" => format!("--preset {}", value.trim_matches('"')),
        _ => format!("--set '{path}={value}'"),
    }
}

/// A camera as it is written on the command line; nothing of pictures of a plane.
pub fn camera_flags(camera: &Value) -> String {
    let vector = |name: &str| {
        let numbers: Vec<String> = camera[name].as_array().into_iter().flatten().map(Value::to_string).collect();
        numbers.join(",")
    };
    match camera["fov"].as_f64() {
        Some(fov) => format!(
            "--camera={} --target={} --up={} --fov {}",
            vector("position"),
            vector("target"),
            vector("up"),
            degrees(fov)
        ),
        None => String::new(),
    }
}

/// An angle in degrees, without the digits that only the conversion gives.
pub fn degrees(radians: f64) -> f64 {
    (radians.to_degrees() * 1e9).round() / 1e9
}

/// A text without its quotes, or any other value.
pub fn word(value: &Value) -> String {
    value.as_str().map_or_else(|| if value.is_null() { String::new() } else { value.to_string() }, String::from)
}
