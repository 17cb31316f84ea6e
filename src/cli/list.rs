//! `bulbfold list`: steps by group, fractals and scripts, with a line each.

use std::collections::BTreeMap;
use std::io::Write;

use bulbfold::diag::Diagnostics;
use bulbfold::formula::embedded;
use bulbfold::load::load;
use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use super::{Outcome, Session, usage};

/// Arguments of `list`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold list
  bulbfold list fold --only steps
  bulbfold list --steps my_steps --json")]
pub struct Arguments {
    /// Only what has this in its name, group or summary
    filter: Option<String>,
    /// Only one kind
    #[arg(long, value_enum)]
    only: Option<Kind>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// What can be listed.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
enum Kind {
    /// Formula steps.
    Steps,
    /// Built-in fractals.
    Fractals,
    /// Built-in graph scripts.
    Scripts,
}

/// Heading and entries (name and summary) of a part of the list.
type Part = (String, Vec<(String, String)>);

/// Runs the command.
pub fn run(arguments: &Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    let wanted = |kind: Kind| arguments.only.is_none_or(|only| only == kind);
    let filter = arguments.filter.as_deref().unwrap_or("").to_lowercase();
    let matching = |parts: Vec<Part>| -> Vec<Part> {
        let keep = |heading: &str, (name, summary): &(String, String)| {
            [heading, name, summary].iter().any(|text| text.to_lowercase().contains(&filter))
        };
        let parts = parts.into_iter().map(|(heading, entries)| {
            let entries = entries.into_iter().filter(|entry| keep(&heading, entry)).collect();
            (heading, entries)
        });
        parts.filter(|(_, entries): &Part| !entries.is_empty()).collect()
    };
    let steps = if wanted(Kind::Steps) { matching(steps(session)) } else { Vec::new() };
    let fractals = if wanted(Kind::Fractals) { matching(vec![fractals(session)]) } else { Vec::new() };
    let scripts = if wanted(Kind::Scripts) { matching(vec![scripts()]) } else { Vec::new() };
    if arguments.json {
        writeln!(out, "{}", to_json(&steps, &fractals, &scripts))?;
        return Ok(());
    }
    let parts: Vec<Part> = steps.into_iter().chain(fractals).chain(scripts).collect();
    if parts.is_empty() {
        return Err(usage(format!("nothing matches `{filter}`"), "`bulbfold list` shows everything"));
    }
    let width = parts.iter().flat_map(|(_, entries)| entries).map(|(name, _)| name.len()).max().unwrap_or(0);
    for (i, (heading, entries)) in parts.iter().enumerate() {
        writeln!(out, "{}{heading}", if i > 0 { "\n" } else { "" })?;
        for (name, summary) in entries {
            writeln!(out, "  {name:<width$}  {summary}")?;
        }
    }
    Ok(())
}

fn to_json(steps: &[Part], fractals: &[Part], scripts: &[Part]) -> Value {
    let steps = steps.iter().flat_map(|(heading, entries)| {
        let group = heading.strip_prefix("steps: ").unwrap_or(heading);
        entries.iter().map(move |(name, summary)| json!({"name": name, "group": group, "summary": summary}))
    });
    let plain = |parts: &[Part]| -> Vec<Value> {
        let entries = parts.iter().flat_map(|(_, entries)| entries);
        entries.map(|(name, summary)| json!({"name": name, "summary": summary})).collect()
    };
    json!({
        "version": 1, "steps": steps.collect::<Vec<_>>(), "fractals": plain(fractals), "scripts": plain(scripts),
    })
}

fn steps(session: &Session) -> Vec<Part> {
    let mut groups: BTreeMap<&str, Vec<(String, String)>> = BTreeMap::new();
    for step in session.library.steps() {
        groups.entry(&step.group).or_default().push((step.name.clone(), step.summary.clone()));
    }
    groups.into_iter().map(|(group, steps)| (format!("steps: {group}"), steps)).collect()
}

fn fractals(session: &mut Session) -> Part {
    let mut entries = Vec::new();
    for (name, _) in embedded::FRACTALS {
        let mut d = Diagnostics::default();
        let summary = load(&mut session.library, name, &[], &mut d).map(|loaded| loaded.graph.summary.clone());
        entries.push((name.to_string(), summary.unwrap_or_else(|| "(broken)".into())));
    }
    ("fractals".into(), entries)
}

fn scripts() -> Part {
    let entries = embedded::SCRIPTS.iter().map(|(name, text)| (name.to_string(), script_summary(text)));
    ("scripts".into(), entries.collect())
}

/// The first comment of a script, as far as its first sentence goes.
pub fn script_summary(text: &str) -> String {
    let lines = text.lines().map_while(|line| line.strip_prefix("//"));
    let comment = lines.map(str::trim).collect::<Vec<_>>().join(" ");
    match comment.split_once(". ") {
        Some((first, _)) => format!("{first}."),
        None => comment,
    }
}
