//! `bulbfold new`: a commented file to start from.

use std::path::{Path, PathBuf};

use bulbfold::diag::nearest;
use bulbfold::film::is_picture;
use bulbfold::formula::embedded;
use clap::Args;

use super::output::{Content, check_output, write};
use super::session::talk;
use super::taken::{Taken, taken};
use super::{Failure, Outcome, usage};

/// Arguments of `new`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold new flower && bulbfold render flower.ron
  bulbfold new my_box --from mandelbox
  bulbfold new found --from picture.png
  bulbfold new my_fold --step -o my_steps/my_fold.rhai")]
pub struct Arguments {
    /// Name: letters, digits and _, not starting with a digit
    name: String,
    /// Write a step instead of a fractal
    #[arg(long)]
    step: bool,
    /// Start from a copy of this built-in step or fractal, or from the formula of a picture, with its camera
    #[arg(long, value_name = "NAME|PICTURE", conflicts_with = "step")]
    from: Option<PathBuf>,
    /// The file to write [default: NAME.ron, or NAME.rhai for a step]
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// A fractal that renders as it is.
const FRACTAL: &str = include_str!("templates/fractal.ron");
/// A step whose examples hold as it is.
const STEP: &str = include_str!("templates/step.rhai");

/// Runs the command.
pub fn run(arguments: &Arguments) -> Outcome {
    let name = &arguments.name;
    let is_word = name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    if !is_word || name.starts_with(|c: char| c.is_ascii_digit()) || name.is_empty() {
        let help = "use letters, digits and _, and do not start with a digit; -o takes any path";
        return Err(usage(format!("`{name}` cannot be the name of a formula"), help));
    }
    let template = match &arguments.from {
        Some(from) if is_picture(from) => of_picture(from)?,
        Some(from) => copied(&from.to_string_lossy())?,
        None if arguments.step => Template { is_step: true, ..Template::of(STEP, "rhai") },
        None => Template::of(FRACTAL, "ron"),
    };
    let extension = template.extension;
    let path = arguments.output.clone().unwrap_or_else(|| PathBuf::from(format!("{name}.{extension}")));
    let target = check_output(&path, Some(extension), Content::Text)?;
    if target.is_taken() {
        return Err(usage(
            format!("{} is there already and is not overwritten", path.display()),
            "choose another name with -o",
        ));
    }
    let stem = path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    let text = match &arguments.from {
        Some(_) => template.text.clone(),
        None => template.text.replace("NAME", if arguments.step { &stem } else { name }),
    };
    write_steps(&path, &template.steps)?;
    write(&target, text.as_bytes())?;
    if target.is_stream() {
        return Ok(());
    }
    let shown = path.display();
    talk(&match template.is_step {
        false if template.flags.is_empty() => format!("wrote {shown}; next: bulbfold render {shown}"),
        false => format!("wrote {shown}; next: bulbfold render {shown} {}", template.flags),
        true => format!("wrote {shown}; formulas beside it can use `{stem}()`, others with --steps FOLDER"),
    });
    Ok(())
}

/// What a new file starts from.
struct Template {
    text: String,
    extension: &'static str,
    is_step: bool,
    /// What else a picture was rendered with.
    flags: String,
    /// Names and texts of steps that belong beside it.
    steps: Vec<(String, String)>,
}

impl Template {
    fn of(text: &str, extension: &'static str) -> Template {
        Template { text: text.into(), extension, is_step: false, flags: String::new(), steps: Vec::new() }
    }
}

/// The formula of a picture.
fn of_picture(picture: &Path) -> Result<Template, Failure> {
    let Taken { text, extension, flags, steps } = taken(picture)?;
    Ok(Template { flags, steps, ..Template::of(&text, extension) })
}

/// Writes steps beside a formula, where none of these names is taken by another text.
fn write_steps(formula: &Path, steps: &[(String, String)]) -> Outcome {
    let path = |name: &str| formula.with_file_name(format!("{name}.rhai"));
    for (name, text) in steps {
        let path = path(name);
        if path.exists() && std::fs::read(&path).ok().as_deref() != Some(text.as_bytes()) {
            let text = format!("{} is there already and is not overwritten", path.display());
            return Err(usage(text, "choose another folder with -o: the formula's steps lie beside it"));
        }
    }
    for (name, text) in steps {
        write(&check_output(&path(name), Some("rhai"), Content::Text)?, text.as_bytes())?;
    }
    Ok(())
}

/// The text of a built-in step, fractal or script, with its origin in the first line.
fn copied(from: &str) -> Result<Template, Failure> {
    let kinds = [
        (embedded::STEPS, "step", "rhai"),
        (embedded::FRACTALS, "fractal", "ron"),
        (embedded::SCRIPTS, "script", "rhai"),
    ];
    for (files, kind, extension) in kinds {
        if let Some((_, text)) = files.iter().find(|(name, _)| *name == from) {
            let credit = format!("// Made from the {kind} `{from}` of Bulbfold {}.\n", env!("CARGO_PKG_VERSION"));
            let template = Template::of(&format!("{credit}//\n{text}"), extension);
            return Ok(Template { is_step: kind == "step", ..template });
        }
    }
    let names = kinds.iter().flat_map(|(files, ..)| files.iter()).map(|(name, _)| *name);
    let help = match nearest(from, names) {
        Some(near) => format!("did you mean `{near}`?"),
        None => "`bulbfold list` shows all names".into(),
    };
    Err(usage(format!("there is no built-in step or fractal `{from}`"), &help))
}
