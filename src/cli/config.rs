//! The user's settings: what commands take where neither the command line nor the environment says otherwise.
//!
//! They stand in `config.ron` in the folder that the system has for settings, or in the file that `BULBFOLD_CONFIG` names:
//! `(size: "1920x1080", backend: "cpu", steps: ["/home/me/steps"], palette: "lagoon")`.

use std::path::{Path, PathBuf};

use bulbfold::diag::{Diagnostic, Diagnostics, Sources};
use bulbfold::files::{Chosen, MAX_TEXT, read_text};
use bulbfold::formula::decode::Fields;
use bulbfold::formula::ron::{Limits, read_ron};
use clap::{Command, ValueEnum};

use super::arguments::BackendArg;
use super::sizes::parse_size;
use super::{Failure, usage};

/// The user's settings; what is empty is not set.
#[derive(Default, PartialEq, Debug)]
pub struct Config {
    size: String,
    backend: String,
    palette: String,
    steps: Vec<String>,
}

/// Commands whose pictures have the user's size, and those that choose a back end.
const SIZED: [&str; 3] = ["render", "animate", "watch"];
const COMPUTING: [&str; 7] = ["render", "animate", "watch", "look", "sheet", "vary", "breed"];
const PAINTED: [&str; 2] = ["render", "animate"];

/// Where the settings stand; none where the system has no place for them, or `BULBFOLD_CONFIG` is empty.
pub fn place() -> Option<PathBuf> {
    let given = |name: &str| std::env::var_os(name).map(PathBuf::from);
    if let Some(path) = given("BULBFOLD_CONFIG") {
        return Some(path).filter(|path| !path.as_os_str().is_empty());
    }
    let absolute = |name: &str| given(name).filter(|path| path.is_absolute());
    let base = match cfg!(windows) {
        true => absolute("APPDATA"),
        false => absolute("XDG_CONFIG_HOME").or_else(|| absolute("HOME").map(|home| home.join(".config"))),
    };
    base.map(|base| base.join("bulbfold").join("config.ron"))
}

impl Config {
    /// Reads the settings where there are any.
    ///
    /// Errors: the file is broken, or `BULBFOLD_CONFIG` names none.
    pub fn read() -> Result<Config, Failure> {
        let Some(path) = place() else { return Ok(Config::default()) };
        if !path.exists() && std::env::var_os("BULBFOLD_CONFIG").is_none() {
            return Ok(Config::default());
        }
        let shown = path.display();
        let text = read_text(&path, MAX_TEXT, Chosen::Named)
            .map_err(|error| usage(format!("cannot read the settings {shown}: {error}"), "see BULBFOLD_CONFIG"))?;
        Config::of(&path, text)
    }

    fn of(path: &Path, text: String) -> Result<Config, Failure> {
        let (mut sources, mut d) = (Sources::default(), Diagnostics::default());
        let id = sources.add(path.display().to_string(), text);
        let value = read_ron(&sources, id, &Limits::default(), &mut d);
        let mut config = Config::default();
        if let Some(mut fields) = value.as_ref().and_then(|value| Fields::new(value, "settings", &mut d)) {
            let mut word = |name: &'static str, check: &dyn Fn(&str) -> Result<(), String>, d: &mut Diagnostics| {
                let span = fields.optional_value(name).map(|value| value.span);
                let text = fields.or(name, String::new(), d);
                if let (Some(span), Err(why)) = (span, if text.is_empty() { Ok(()) } else { check(&text) }) {
                    d.push(Diagnostic::error(format!("`{name}` cannot be {text:?}")).label(span, "").help(why));
                }
                text
            };
            config.size = word("size", &|text| parse_size(text).map(drop), &mut d);
            config.backend = word("backend", &|text| BackendArg::from_str(text, false).map(drop), &mut d);
            config.palette = word("palette", &|_| Ok(()), &mut d);
            config.steps = fields.or("steps", Vec::new(), &mut d);
            fields.finish(&mut d);
        }
        match d.has_errors() {
            true => Err(Failure::Usage(d.render(&sources, false))),
            false => Ok(config),
        }
    }

    /// The program's arguments with the settings as defaults, which are kept as long as the program runs.
    pub fn apply(self, mut program: Command) -> Command {
        let settings = [
            ("size", self.size, &SIZED[..]),
            ("backend", self.backend, &COMPUTING),
            ("palette", self.palette, &PAINTED),
        ];
        let settings = settings.map(|(argument, value, commands)| (argument, &*value.leak(), commands));
        for (argument, value, commands) in settings {
            for command in commands.iter().filter(|_| !value.is_empty()) {
                if program.find_subcommand(command).is_some() {
                    program = program
                        .mut_subcommand(command, |found| found.mut_arg(argument, |known| known.default_value(value)));
                }
            }
        }
        match self.steps.is_empty() {
            true => program,
            false => program.mut_arg("step_folders", |known| {
                known.default_values(self.steps.into_iter().map(|folder| &*folder.leak()))
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::Config;

    fn of(text: &str) -> Result<Config, String> {
        Config::of(Path::new("config.ron"), text.to_string()).map_err(|failure| failure.text().to_string())
    }

    #[test]
    fn settings_are_read_and_checked() {
        let config = of("(size: \"4k\", backend: \"cpu\", steps: [\"a\", \"b\"])").unwrap();
        assert_eq!((&config.size[..], &config.backend[..], config.steps.len()), ("4k", "cpu", 2));
        assert_eq!(of("()").unwrap(), Config::default());
        for (wrong, expected) in [
            ("(size: \"huge\")", "config.ron:1:8"),
            ("(backend: \"tpu\")", "`backend` cannot be"),
            ("(colour: 1)", "colour"),
            ("(size: 4)", "config.ron:1:8"),
            ("(", "config.ron:1"),
        ] {
            let error = of(wrong).unwrap_err();
            assert!(error.contains(expected), "{wrong}: {error}");
        }
    }
}
