//! The manifest of a film: what its frames are, which settings made them, and how long they took.

use std::fs;

use bulbfold::calibrate::cache::hash;
use bulbfold::engine::Request;
use serde_json::{Value, json};

use super::film::Report;
use super::frames::Names;
use super::moments::Clock;
use super::output::{Content, check_output, write};
use super::picture_args::PictureArgs;
use super::{Failure, Outcome};

/// Writes the manifest beside the frames. Times of frames that were kept are those of the earlier manifest.
pub fn write_manifest(
    names: &Names,
    (arguments, request): (&PictureArgs, &Request),
    (clock, report): (&Clock, &Report),
) -> Outcome {
    let path = names.manifest();
    let earlier: Value = fs::read(&path).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok()).unwrap_or_default();
    let known = |file: &str, key: &str| {
        let frames = earlier["frames"].as_array()?;
        let entry = frames.iter().find(|entry| entry["file"] == file && entry["key"] == key)?;
        entry["seconds"].as_f64()
    };
    let mut frames = Vec::new();
    for frame in &report.written {
        let file = frame.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let bytes = fs::read(&frame.path).map_err(|error| super::output::cannot_write(&frame.path, &error))?;
        let seconds = frame.took.map(|took| took.as_secs_f64()).or_else(|| known(&file, &frame.key));
        frames.push(json!({
            "frame": frame.frame + 1,
            "time": clock.rate.time(f64::from(frame.frame)),
            "file": file,
            "key": frame.key,
            "hash": format!("{:032x}", hash(&bytes)),
            "seconds": seconds,
        }));
    }
    let manifest = json!({
        "version": 1,
        "program": env!("CARGO_PKG_VERSION"),
        "formula": arguments.formula.file.display().to_string(),
        "set": arguments.formula.changes(),
        "rate": [clock.rate.frames, clock.rate.seconds],
        "frames_of_film": clock.frames,
        "shutter": if clock.blur > 1 { clock.shutter } else { 0.0 },
        "pictures_of_frame": clock.blur,
        "request": request,
        "frames": frames,
    });
    let target = check_output(&path, None, Content::Text)?;
    let text = serde_json::to_string_pretty(&manifest).map_err(|error| Failure::Work(error.to_string()))?;
    write(&target, format!("{text}\n").as_bytes())
}
