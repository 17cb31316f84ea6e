//! `bulbfold new --from PICTURE`: the formula that a picture was made of.

use std::path::Path;

use bulbfold::diag::{Diagnostics, Sources};
use bulbfold::formula::edit::Edits;
use bulbfold::formula::ron::{Limits, read_ron};
use bulbfold::formula::value::Value as Ron;
use serde_json::Value;

use super::again::made;
use super::show::{camera_flags, changes, degrees, flag, word};
use super::{Failure, usage};

/// Fields of a formula whose parts can be written into its text.
const TABLES: [&str; 4] = ["estimate", "film", "look", "plane"];

/// A formula out of a picture.
pub struct Taken {
    /// Its text, with the picture's camera.
    pub text: String,
    /// `ron` or `rhai`.
    pub extension: &'static str,
    /// What of the picture the text does not say, as arguments of `render`.
    pub flags: String,
    /// Names and texts of its own steps.
    pub steps: Vec<(String, String)>,
}

/// Reads the formula of a picture. Nothing of it is run.
pub fn taken(path: &Path) -> Result<Taken, Failure> {
    let (_, text) = made(path)?;
    let recipe: Value = serde_json::from_str(&text).map_err(|error| {
        usage(format!("the recipe of {} is damaged: {error}", path.display()), "start from the formula itself")
    })?;
    let formula = &recipe["job"]["formula"];
    let credit = format!(
        "// Made from a picture of `{}` by Bulbfold {}.\n//\n",
        bulbfold::diag::printable(&word(&formula["name"])).replace('\n', " "),
        bulbfold::diag::printable(&word(&recipe["job"]["version"])).replace('\n', " ")
    );
    let steps = formula["steps"].as_array().into_iter().flatten().map(|step| (word(&step[0]), word(&step[1])));
    let steps: Vec<(String, String)> = steps.collect();
    if let Some((name, _)) = steps.iter().find(|(name, _)| !is_word(name)) {
        return Err(usage(format!("the picture has a step of the odd name `{name}`"), "start from the formula itself"));
    }
    let (text, camera, set) = (word(&formula["text"]), &recipe["job"]["camera"], changes(&recipe));
    if Path::new(&word(&formula["name"])).extension().is_some_and(|end| end.eq_ignore_ascii_case("rhai")) {
        let flags: Vec<String> =
            set.iter().map(|(path, value)| flag(path, value)).chain([camera_flags(camera)]).collect();
        return Ok(Taken { text: [credit, text].concat(), extension: "rhai", flags: flags.join(" "), steps });
    }
    let (text, left) = written(&text, camera, set);
    let flags: Vec<String> = left.iter().map(|(path, value)| flag(path, value)).collect();
    Ok(Taken { text: [credit, text].concat(), extension: "ron", flags: flags.join(" "), steps })
}

/// Whether a name can be that of a step's file.
fn is_word(name: &str) -> bool {
    !name.is_empty() && name.len() <= 100 && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
}

/// Pairs of a path and a value.
type Changes = Vec<(String, String)>;

/// A text with a camera, and with the changes that can be written into it; the others are left.
fn written(text: &str, camera: &Value, set: Changes) -> (String, Changes) {
    let mut left = Vec::new();
    let mut text = text.to_string();
    for (path, value) in set {
        let parts = path.split_once('.').filter(|(head, part)| TABLES.contains(head) && !part.contains('.'));
        match parts.and_then(|(head, part)| edited(&text, head, &[(part, value.clone())])) {
            Some(new) => text = new,
            None if path.starts_with("camera") => {}
            None => left.push((path, value)),
        }
    }
    let vector = |name: &str| {
        let numbers: Vec<String> = camera[name].as_array().into_iter().flatten().map(Value::to_string).collect();
        format!("({})", numbers.join(", "))
    };
    if let Some(fov) = camera["fov"].as_f64() {
        let mut entries: Vec<(&str, String)> = ["position", "target", "up"].map(|name| (name, vector(name))).to_vec();
        entries.push(("fov", format!("{:?}", degrees(fov))));
        text = edited(&text, "camera", &entries).unwrap_or(text);
    }
    (text, left)
}

/// A text with fields of one of its tables set; nothing where it cannot be read.
fn edited(text: &str, table: &str, entries: &[(&str, String)]) -> Option<String> {
    let (mut sources, mut d) = (Sources::default(), Diagnostics::default());
    let id = sources.add("formula.ron", text);
    let value: Ron = read_ron(&sources, id, &Limits::default(), &mut d)?;
    let mut edits = Edits::default();
    edits.set_struct(text, &value, table, entries, &[], &["nodes", "output", "max_iterations", "camera"]);
    (!d.has_errors() && !edits.is_empty()).then(|| edits.apply(text))
}
