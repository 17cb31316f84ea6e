//! Options that change how surfaces look: `--palette`, `--seed` and `--material`.

use std::path::{Path, PathBuf};

use bulbfold::colour::{Gradient, palettes, random_gradient, read_gradient};
use bulbfold::diag::Diagnostics;
use bulbfold::files::{Chosen, MAX_TEXT, read_text};
use clap::Args;

use super::{Failure, Session, usage};

/// What is changed of a look.
#[derive(Args, Clone, Default, Debug)]
#[command(next_help_heading = "Light")]
pub struct LookArgs {
    /// Take the colours of a palette (`bulbfold list palettes`), of a file (.ggr, .ugr, .gradient, .map, .ron, a list of colours), or random ones
    #[arg(long, value_name = "NAME|FILE|random")]
    palette: Option<PathBuf>,
    /// Which random palette, and which random numbers of paths
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// Make the surface of a material (`bulbfold list materials`), or of a material file
    #[arg(long, value_name = "NAME|FILE.rhai")]
    material: Option<PathBuf>,
}

impl LookArgs {
    /// What is changed in the formula: pairs of a path and a value in RON. A material's file is read.
    /// `has_paths` says whether the seed is for paths of light, too.
    pub fn changes(&self, session: &mut Session, has_paths: bool) -> Result<Vec<(String, String)>, Failure> {
        let mut changes = Vec::new();
        let is_random = self.palette.as_ref().is_some_and(|name| name.as_os_str() == "random");
        if self.seed.is_some() && !is_random && !has_paths {
            let help = "write `--palette random --seed N`, or `--integrator path --seed N`";
            return Err(usage("`--seed` is for random palettes and paths of light", help));
        }
        if let Some(palette) = &self.palette {
            changes.push(("look.palette".to_string(), self.palette(palette, session)?));
        }
        if let Some(material) = &self.material {
            let mut name = material.to_string_lossy().into_owned();
            if material.extension().is_some_and(|e| e == "rhai") {
                let mut d = Diagnostics::default();
                session.library.add_step_file(material, &mut d);
                session.report(d)?;
                name = material.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            }
            changes.push(("look.material".to_string(), format!("{name:?}")));
        }
        Ok(changes)
    }

    fn palette(&self, palette: &Path, session: &mut Session) -> Result<String, Failure> {
        let name = palette.to_string_lossy();
        if name == "random" {
            return Ok(ron(&random_gradient(self.seed.unwrap_or(0))));
        }
        if palettes::named(&name).is_some() || !palette.exists() {
            return Ok(format!("{name:?}"));
        }
        read_file(palette, session).map(|gradient| ron(&gradient))
    }
}

/// The gradient of a file.
fn read_file(path: &Path, session: &mut Session) -> Result<Gradient, Failure> {
    let shown = path.display();
    let text = read_text(path, MAX_TEXT, Chosen::Named);
    let text = text.map_err(|error| usage(format!("cannot read {shown}: {error}"), ""))?;
    session.library.note_input(path);
    if path.extension().is_some_and(|e| e == "ron") {
        let id = session.library.sources.add(shown.to_string(), text);
        let mut d = Diagnostics::default();
        let palette = palettes::read_palette_file(&session.library.sources, id, &shown.to_string(), &mut d);
        session.report(d)?;
        return palette.map(|palette| palette.gradient).ok_or_else(|| usage(format!("{shown} is no palette"), ""));
    }
    read_gradient(&text).map_err(|error| {
        let help = "gradients are files of GIMP (.ggr), Ultra Fractal (.ugr, .gradient) and Fractint (.map), palettes (.ron), and lists \
                    such as `#102040, #e0a060 70%, #ffffff`";
        usage(format!("{shown}:{}: {}", error.line, error.why), help)
    })
}

/// A gradient as formula files have it.
fn ron(gradient: &Gradient) -> String {
    let stop = |stop: &bulbfold::colour::Stop| {
        let [r, g, b] = stop.colour;
        format!("(({r:?}, {g:?}, {b:?}), {:?})", stop.at)
    };
    let stops: Vec<String> = gradient.stops().iter().map(stop).collect();
    format!("Stops(colours: [{}], cyclic: {})", stops.join(", "), gradient.is_cyclic())
}
