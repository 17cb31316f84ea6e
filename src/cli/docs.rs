//! `bulbfold docs`: the reference of steps and operators, from their files and the operator table.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::PathBuf;

use bulbfold::expr::ops::Operator;
use bulbfold::formula::step::Step;
use bulbfold::formula::symbolic::FUNCTIONS;
use clap::Args;

use super::explain::step_page;
use super::page::{Block, markdown};
use super::session::write_file;
use super::{Outcome, Session, usage};

/// Arguments of `docs`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold docs -o docs
  bulbfold docs -o my_docs --steps my_steps")]
pub struct Arguments {
    /// Folder for steps.md and operators.md
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
}

/// Runs the command.
pub fn run(arguments: &Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    let folder = &arguments.output;
    if !folder.is_dir() {
        return Err(usage(format!("there is no folder {}", folder.display()), "create it first"));
    }
    for (name, text) in [("steps.md", steps_page(session)), ("operators.md", operators_page())] {
        let path = folder.join(name);
        write_file(&path, &text)?;
        writeln!(out, "{}", path.display())?;
    }
    Ok(())
}

/// The reference of all steps, by group.
fn steps_page(session: &Session) -> String {
    let mut groups: BTreeMap<&str, Vec<&Step>> = BTreeMap::new();
    for step in session.library.steps() {
        groups.entry(&step.group).or_default().push(step);
    }
    let note = "Made by `bulbfold docs` from the step files; change those instead of this page.";
    let mut text = markdown(&[Block::Heading(1, "Steps".into()), Block::Text(note.into())], 0);
    for (group, steps) in groups {
        text.push_str(&markdown(&[Block::Heading(2, format!("Group: {group}"))], 0));
        for step in steps {
            text.push_str(&markdown(&step_page(session, step), 2));
        }
    }
    trimmed(&text)
}

/// The reference of all operators.
fn operators_page() -> String {
    let rows = Operator::ALL.iter().map(|operator| {
        let info = operator.info();
        let result = if info.bool_result { "boolean" } else { "number" };
        let continuous = if info.continuous { "yes" } else { "no" };
        let wgsl = format!("`{}`", info.wgsl);
        vec![info.name.into(), info.arity.to_string(), result.into(), continuous.into(), wgsl, info.help.into()]
    });
    let note = "Made by `bulbfold docs` from the operator table in `src/expr/ops.rs`. Operators work component by component \
                on numbers and vectors; a number combines with a vector as if written into every component.";
    let head = vec!["Name", "Arguments", "Result", "Continuous", "WGSL", "Meaning"];
    let scripts = "In scripts, arithmetic and comparisons are written `+`, `-`, `/`, `%` (mod), `==`, `!=`, `<`, `<=`, `>`, `>=`, the product \
                   and the power with one and two asterisks; the others are called by their names, such as `clamp(z, -1.0, 1.0)`. \
                   `z.x`, `z.y`, `z.z` and `z.w` are components that can be read and set, `z.xyz` the first three. `PI` is a \
                   number. Beside the operators there are:";
    let functions = FUNCTIONS.iter().map(|(call, help)| vec![format!("`{call}`"), help.to_string()]);
    let blocks = [
        Block::Heading(1, "Operators".into()),
        Block::Text(note.into()),
        Block::Table(head, rows.collect()),
        Block::Heading(2, "In step scripts".into()),
        Block::Text(scripts.into()),
        Block::Table(vec!["Call", "Meaning"], functions.collect()),
    ];
    trimmed(&markdown(&blocks, 0))
}

fn trimmed(text: &str) -> String {
    format!("{}\n", text.trim_end())
}
