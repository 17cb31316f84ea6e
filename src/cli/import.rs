//! `bulbfold import`: files of other programs as graph files.

use std::path::{Path, PathBuf};

use bulbfold::check::measure_for_import;
use bulbfold::diag::{Diagnostic, Diagnostics};
use bulbfold::exchange::import::encoding::{Decoded, MAX_BYTES, decode};
use bulbfold::exchange::import::{Imported, LostKind, fragmentarium, mandelbulb3d, mandelbulber};
use bulbfold::files::{Chosen, read_bytes};
use bulbfold::formula::library::Library;
use bulbfold::load::load_text;
use clap::Args;

use super::output::{Content, check_output, write};
use super::session::talk;
use super::{Failure, Outcome, Session, usage};

/// Arguments of `import`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold import scene.fract && bulbfold render scene.ron
  bulbfold import Mandelbulb.frag --preset Spikes -o spikes.ron
  bulbfold import odd.frag --as mandelbox

A shader's code is run and compared with known formulas.
Stderr lists settings without a counterpart.")]
pub struct Arguments {
    /// Settings of Mandelbulber 2 (.fract), a shader of Fragmentarium (.frag) or parameters of Mandelbulb3D (.m3p, or as text)
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// The file to write [default: FILE with the ending .ron, beside it]
    #[arg(short, long, value_name = "OUT")]
    output: Option<PathBuf>,
    /// Preset of a Fragmentarium file [default: the file's default preset, or its first]
    #[arg(long, value_name = "NAME")]
    preset: Option<String>,
    /// Take a Fragmentarium file for this formula, without reading its code
    #[arg(long = "as", value_name = "FORMULA")]
    taken_for: Option<String>,
    /// Overwrite OUT if it exists
    #[arg(long)]
    force: bool,
}

/// Runs the command.
pub fn run(arguments: &Arguments, session: &mut Session) -> Outcome {
    let target = arguments.output.clone().unwrap_or_else(|| arguments.file.with_extension("ron"));
    let shown = target.display();
    let output = check_output(&target, Some("ron"), Content::Text)?;
    if output.is_taken() && !arguments.force {
        let message = format!("{shown} is there already and is not overwritten");
        return Err(usage(message, "choose another name with -o, or allow it with --force"));
    }
    let imported = read(arguments, session)?;
    session.spare_inputs(&output)?;
    check_loads(&imported, &target, session)?;
    write(&output, imported.text.as_bytes())?;
    report(&imported);
    if !output.is_stream() {
        talk(&format!("wrote {shown}; next: bulbfold render {shown}"));
    }
    Ok(())
}

fn read(arguments: &Arguments, session: &mut Session) -> Result<Imported, Failure> {
    let file = &arguments.file;
    let ending = file.extension().map(|ending| ending.to_string_lossy().to_lowercase()).unwrap_or_default();
    if arguments.preset.is_some() && ending != "frag" {
        return Err(usage("only Fragmentarium's files have presets", "leave --preset out"));
    }
    if arguments.taken_for.is_some() && ending != "frag" {
        return Err(usage("only Fragmentarium's files hold code instead of a formula's name", "leave --as out"));
    }
    if ending == "m3i" {
        let help = "copy its parameters as text in Mandelbulb3D, save them and import that";
        return Err(usage(format!("{} is a picture of Mandelbulb3D", file.display()), help));
    }
    let bytes = read_named(file, session)?;
    let Decoded { text, encoding } = decode(&bytes);
    let is_m3d = ending == "m3p" || (ending != "frag" && ending != "fract" && mandelbulb3d::is_in(&text));
    if ending != "frag" && ending != "fract" && !is_m3d {
        let message = format!("{} is neither a .fract nor a .frag nor a .m3p file", file.display());
        let help = "settings of Mandelbulber 2 end in .fract, shaders of Fragmentarium in .frag; parameters of Mandelbulb3D in .m3p, or they are a text with `Mandelbulb3Dv18{`";
        return Err(usage(message, help));
    }
    if let Some(encoding) = encoding.filter(|_| !is_m3d) {
        talk(&format!("{} is not UTF-8; it is read as {encoding}", file.display()));
    }
    let mut d = Diagnostics::default();
    let id = session.library.sources.add(file.display().to_string(), text.as_str());
    let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let sources = &session.library.sources;
    let imported = match ending.as_str() {
        "frag" => {
            let request = fragmentarium::Request {
                preset: arguments.preset.as_deref(),
                taken_for: arguments.taken_for.as_deref(),
            };
            fragmentarium::import(sources, (id, &name), request, &measure_for_import, &mut d)
        }
        _ if is_m3d => mandelbulb3d::import(sources, (id, &name), &bytes, &mut d),
        _ => mandelbulber::import(sources, id, &name, &mut d),
    };
    session.report(d)?;
    imported.ok_or_else(|| usage(format!("cannot import {}", file.display()), ""))
}

/// The bytes of a file. No output may replace it.
fn read_named(file: &Path, session: &mut Session) -> Result<Vec<u8>, Failure> {
    let bytes = read_bytes(file, MAX_BYTES, Chosen::Named)
        .map_err(|error| usage(format!("cannot read {}: {error}", file.display()), ""))?;
    session.library.note_input(file);
    Ok(bytes)
}

/// A graph that does not load is not written: some value is outside of what our steps take.
fn check_loads(imported: &Imported, target: &Path, session: &Session) -> Result<(), Failure> {
    let (mut library, mut d) = (Library::builtin(), Diagnostics::default());
    load_text(&mut library, &target.display().to_string(), &imported.text, &[], &mut d);
    if !d.has_errors() {
        return Ok(());
    }
    let message = "the settings hold values that the steps here do not take, so no file was written";
    let mut all = Diagnostics::default();
    all.push(Diagnostic::error(message).help("the messages below show the graph that would have been written"));
    all.extend(d);
    Err(Failure::Usage(session.rendered(&all, &library.sources)))
}

/// Says on stderr how a file was understood, and what was not carried over.
fn report(imported: &Imported) {
    imported.notes.iter().for_each(|note| talk(note));
    for kind in LostKind::ALL {
        let lost: Vec<_> = imported.lost.iter().filter(|lost| lost.kind == kind).collect();
        if lost.is_empty() {
            continue;
        }
        talk(&format!("{}:", kind.heading()));
        for part in lost {
            match part.why.is_empty() {
                true => talk(&format!("  {}", part.what)),
                false => talk(&format!("  {} ({})", part.what, part.why)),
            }
        }
    }
}
