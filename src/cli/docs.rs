//! `bulbfold docs`: the reference of steps, fractals, materials, palettes and operators, from their files and the operator table.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

use bulbfold::expr::ops::Operator;
use bulbfold::formula::embedded;
use bulbfold::formula::step::Step;
use bulbfold::formula::symbolic::FUNCTIONS;
use bulbfold::graph::{NodeKind, ValidGraph};
use clap::Args;

use super::explain::{credit, params_table, presets_table, step_page};
use super::page::{Block, markdown};
use super::{Failure, Outcome, Session, matter_pages, usage};

/// Arguments of `docs`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold docs -o docs
  bulbfold docs -o my_docs --steps my_steps")]
pub struct Arguments {
    /// Folder for steps.md, fractals.md, materials.md, palettes.md and operators.md; pictures are looked for in its folder thumbnails
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
}

/// Runs the command.
pub fn run(arguments: &Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    let folder = &arguments.output;
    if !folder.is_dir() {
        return Err(usage(format!("there is no folder {}", folder.display()), "create it first"));
    }
    let pictures = folder.join("thumbnails");
    let fractals = Fractals::of(session)?;
    let pages = [
        ("steps.md", steps_page(session, &fractals, &pictures)),
        ("fractals.md", fractals.page(&pictures)),
        ("materials.md", trimmed(&matter_pages::materials(session))),
        ("palettes.md", trimmed(&matter_pages::palettes_page())),
        ("operators.md", operators_page()),
    ];
    for (name, text) in pages {
        let path = folder.join(name);
        session.write(&path, text.as_bytes())?;
        writeln!(out, "{}", path.display())?;
    }
    Ok(())
}

/// The reference of all steps, by group.
fn steps_page(session: &Session, fractals: &Fractals, pictures: &Path) -> String {
    let mut groups: BTreeMap<&str, Vec<&Step>> = BTreeMap::new();
    for step in session.library.steps() {
        groups.entry(&step.group).or_default().push(step);
    }
    let note = "Made by `bulbfold docs` from the step files; change those instead of this page.";
    let mut text = markdown(&[Block::Heading(1, "Steps".into()), Block::Text(note.into())], 0);
    let index = groups.iter().flat_map(|(group, steps)| steps.iter().map(move |step| (*group, *step)));
    let index = index.map(|(group, step)| vec![link(&step.name), group.to_string(), step.summary.clone()]);
    text.push_str(&markdown(&[Block::Table(vec!["Step", "Group", "What it does"], index.collect())], 0));
    for (group, steps) in groups {
        text.push_str(&markdown(&[Block::Heading(2, format!("Group: {group}"))], 0));
        for step in steps {
            text.push_str(&markdown(&step_page(session, step), 2));
            text.push_str(&fractals.using(&step.name, pictures));
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
                   `z.x`, `z.y`, `z.z` and `z.w` are components that can be read and set, and so are combinations of one to four of \
                   them such as `z.xzy`; `z.xy` is a vector of two numbers, which combines with numbers and others of its kind. `PI` is a \
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

/// A link to the heading of this name.
fn link(name: &str) -> String {
    format!("[{name}](#{name})")
}

/// The built-in fractals, by name.
struct Fractals(Vec<(&'static str, ValidGraph)>);

impl Fractals {
    fn of(session: &mut Session) -> Result<Fractals, Failure> {
        let names = embedded::FRACTALS.iter().map(|(name, _)| *name);
        let graphs = names.map(|name| Ok((name, session.load(name, &[])?.graph)));
        Ok(Fractals(graphs.collect::<Result<_, Failure>>()?))
    }

    /// The reference of all fractals: an index, then each by group.
    fn page(&self, pictures: &Path) -> String {
        let mut groups: BTreeMap<&str, Vec<(&str, &ValidGraph)>> = BTreeMap::new();
        for (name, graph) in &self.0 {
            let group = if graph.group.is_empty() { "other" } else { graph.group.as_str() };
            groups.entry(group).or_default().push((name, graph));
        }
        let note = "Made by `bulbfold docs` from the fractals' files; change those instead of this page. `bulbfold render NAME` \
                    renders one, `bulbfold explain NAME` shows its formulas.";
        let index = groups.iter().flat_map(|(group, graphs)| graphs.iter().map(move |of| (*group, *of)));
        let index = index.map(|(group, (name, graph))| vec![link(name), group.into(), graph.summary.clone()]);
        let blocks = [
            Block::Heading(1, "Fractals".into()),
            Block::Text(note.into()),
            Block::Table(vec!["Fractal", "Group", "What it is"], index.collect()),
        ];
        let mut text = markdown(&blocks, 0);
        for (group, graphs) in groups {
            text.push_str(&markdown(&[Block::Heading(2, format!("Group: {group}"))], 0));
            for (name, graph) in graphs {
                text.push_str(&entry(name, graph, pictures));
            }
        }
        trimmed(&text)
    }

    /// The fractals that use a step, with the picture of the first one that has any.
    fn using(&self, step: &str, pictures: &Path) -> String {
        let users: Vec<&str> =
            self.0.iter().filter(|(_, graph)| steps_of(graph).contains(&step)).map(|(name, _)| *name).collect();
        if users.is_empty() {
            return String::new();
        }
        let links: Vec<String> = users.iter().map(|name| format!("[{name}](fractals.md#{name})")).collect();
        let picture = users.iter().map(|name| picture(name, pictures)).find(|picture| !picture.is_empty());
        format!("{}Used by {}.\n\n", picture.unwrap_or_default(), links.join(", "))
    }
}

/// The facts in a fractal's file.
fn entry(name: &str, graph: &ValidGraph, pictures: &Path) -> String {
    let mut text = markdown(&[Block::Heading(3, name.into())], 0) + picture(name, pictures).as_str();
    let mut blocks = vec![Block::Text(graph.summary.clone())];
    let mut origin = credit(&graph.inventor, graph.year);
    if !graph.source.is_empty() {
        origin = format!("{origin}. Source: {}", graph.source);
    }
    blocks.push(Block::Text(format!("Invented: {}.", origin.trim_end_matches('.'))));
    blocks.extend((!graph.params.is_empty()).then(|| params_table(graph)));
    blocks.extend((!graph.presets.is_empty()).then(|| presets_table(graph)));
    text.push_str(&markdown(&blocks, 0));
    let steps: Vec<String> = steps_of(graph).iter().map(|step| format!("[{step}](steps.md#{step})")).collect();
    if !steps.is_empty() {
        text.push_str(&format!("Steps: {}.\n\n", steps.join(", ")));
    }
    text
}

/// The steps that a fractal is made of, each once, in order.
fn steps_of(graph: &ValidGraph) -> Vec<&str> {
    let mut steps: Vec<&str> = Vec::new();
    for node in &graph.nodes {
        if let NodeKind::Step { step, .. } = &node.kind
            && !steps.contains(&step.name.as_str())
        {
            steps.push(&step.name);
        }
    }
    steps
}

/// The thumbnail of a fractal, where there is one.
fn picture(name: &str, pictures: &Path) -> String {
    match pictures.join(format!("{name}.jpg")).is_file() {
        true => format!("![{name}](thumbnails/{name}.jpg)\n\n"),
        false => String::new(),
    }
}
