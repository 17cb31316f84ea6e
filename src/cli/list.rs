//! `bulbfold list`: steps, fractals, scenes, scripts, palettes and materials by group, and the search for those with some properties.
//!
//! Properties come from the files and graphs themselves: conformal steps are measured, methods that apply come from
//! the composer.

use std::collections::BTreeMap;
use std::io::Write;
use std::sync::Arc;

use bulbfold::check::is_conformal;
use bulbfold::colour::palettes;
use bulbfold::compose::{Composer, choose, scalar_rules};
use bulbfold::diag::{Diagnostics, nearest};
use bulbfold::expr::Arena;
use bulbfold::formula::embedded;
use bulbfold::formula::step::{ScalarRule, StateWidth, Step};
use bulbfold::graph::{EstimateSettings, NodeKind, ValidGraph};
use bulbfold::load::load;
use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use super::arguments::DeArg;
use super::matter_pages::swatch;
use super::{Failure, Outcome, Session, usage};

/// Arguments of `list`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold list
  bulbfold list palettes
  bulbfold list fold --only steps
  bulbfold list --group bulbs --years 2009..2012
  bulbfold list --only steps --conformal --json
  bulbfold list --only fractals --estimate gradient --dimension 4

All conditions must hold. --conformal takes steps whose Jacobian, with default parameters, is measured to be a multiple
of an orthogonal matrix, and fractals all of whose steps are such.")]
pub struct Arguments {
    /// Only what has this in its name, group, summary or inventor; or one kind: steps, fractals, scenes, scripts, palettes or materials
    filter: Option<String>,
    /// Only one kind
    #[arg(long, value_enum)]
    only: Option<Kind>,
    /// Only this group, such as bulbs or fold
    #[arg(long, value_name = "GROUP")]
    group: Option<String>,
    /// Only those whose inventor's name contains this
    #[arg(long, value_name = "TEXT")]
    inventor: Option<String>,
    /// Only those of these years, such as 2009..2012 or 2010
    #[arg(long, value_name = "FROM..TO", value_parser = parse_years)]
    years: Option<(u32, u32)>,
    /// Only conformal ones (measured)
    #[arg(long)]
    conformal: bool,
    /// Only differentiable ones
    #[arg(long)]
    differentiable: bool,
    /// Only those whose steps all have an exact scalar rule
    #[arg(long)]
    exact: bool,
    /// Only fractals to which this estimate applies; `auto` takes all
    #[arg(long, value_enum, value_name = "METHOD")]
    estimate: Option<DeArg>,
    /// Only fractals that take this estimate: the one that the file carries, else that of the rules
    #[arg(long, value_enum, value_name = "METHOD")]
    chosen: Option<DeArg>,
    /// Only those with so many components of state, or 2 for pictures of a plane
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(2..=4))]
    dimension: Option<u8>,
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
    /// Built-in scenes of several objects.
    Scenes,
    /// Built-in graph scripts.
    Scripts,
    /// Gradients, with five of their colours.
    Palettes,
    /// What surfaces can be made of.
    Materials,
}

impl Kind {
    /// Its heading.
    fn name(self) -> &'static str {
        match self {
            Kind::Steps => "steps",
            Kind::Fractals => "fractals",
            Kind::Scenes => "scenes",
            Kind::Scripts => "scripts",
            Kind::Palettes => "palettes",
            Kind::Materials => "materials",
        }
    }
}

/// A step, fractal or script with what is known of it.
struct Entry {
    kind: Kind,
    name: String,
    group: String,
    summary: String,
    inventor: String,
    year: Option<u32>,
    properties: Option<Properties>,
}

/// What is found out of a step or fractal, once.
#[derive(Clone, Default)]
struct Properties {
    conformal: bool,
    differentiable: bool,
    exact: bool,
    /// Components that it can have.
    dimensions: Vec<u8>,
    /// Estimates that apply; those of fractals.
    estimates: Vec<&'static str>,
    /// Estimates that rules choose.
    chosen: Vec<&'static str>,
}

/// Runs the command.
pub fn run(arguments: &Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    let all = entries(arguments, session);
    check_group(arguments, &all)?;
    let entries: Vec<&Entry> = all.iter().filter(|entry| arguments.takes(entry)).collect();
    if arguments.json {
        writeln!(out, "{}", to_json(&entries))?;
        return Ok(());
    }
    if entries.is_empty() {
        let what = arguments.filter.as_ref().map_or("all these conditions".into(), |filter| format!("`{filter}`"));
        return Err(usage(format!("nothing matches {what}"), "`bulbfold list` shows everything"));
    }
    print(&entries, out)
}

impl Arguments {
    /// Whether any condition asks for what has to be found out of graphs and steps.
    fn asks_properties(&self) -> bool {
        self.conformal || self.differentiable || self.exact || self.dimension.is_some() || self.asks_estimates()
    }

    /// Whether estimates have to be chosen, which measures each fractal.
    fn asks_estimates(&self) -> bool {
        self.json || self.estimate.is_some() || self.chosen.is_some()
    }

    /// The one kind that is asked for.
    fn kind(&self) -> Option<Kind> {
        let named = self.filter.as_ref().and_then(|filter| Kind::from_str(filter, true).ok());
        self.only.or(named)
    }

    /// The text that is searched for: a kind's name is none.
    fn text(&self) -> Option<&String> {
        self.filter.as_ref().filter(|filter| self.only.is_some() || Kind::from_str(filter, true).is_err())
    }

    fn takes(&self, entry: &Entry) -> bool {
        let has = |text: &str, part: &str| text.to_lowercase().contains(&part.to_lowercase());
        let texts = [&entry.name, &entry.group, &entry.summary, &entry.inventor];
        let plain = self.text().is_none_or(|filter| texts.iter().any(|text| has(text, filter)))
            && self.group.as_ref().is_none_or(|group| entry.group.eq_ignore_ascii_case(group))
            && self.inventor.as_ref().is_none_or(|inventor| has(&entry.inventor, inventor))
            && self.years.is_none_or(|(from, to)| entry.year.is_some_and(|year| (from..=to).contains(&year)));
        if !plain || !self.asks_properties() {
            return plain;
        }
        let Some(properties) = &entry.properties else { return false };
        let named = |asked: Option<DeArg>, known: &[&str]| match asked {
            Some(DeArg(Some(method))) => known.contains(&method.name()),
            _ => true,
        };
        (!self.conformal || properties.conformal)
            && (!self.differentiable || properties.differentiable)
            && (!self.exact || properties.exact)
            && self.dimension.is_none_or(|n| properties.dimensions.contains(&n))
            && named(self.estimate, &properties.estimates)
            && named(self.chosen, &properties.chosen)
    }
}

/// Reads `2009..2012` or one year.
fn parse_years(text: &str) -> Result<(u32, u32), String> {
    let year =
        |text: &str| text.trim().parse::<u32>().map_err(|_| "write years such as 2009..2012 or 2010".to_string());
    let (from, to) = text.split_once("..").unwrap_or((text, text));
    match (year(from)?, year(to)?) {
        (from, to) if from <= to => Ok((from, to)),
        (from, to) => Err(format!("{from} comes after {to}")),
    }
}

/// An empty group is a mistake; the message names the closest one.
fn check_group(arguments: &Arguments, all: &[Entry]) -> Result<(), Failure> {
    let Some(group) = &arguments.group else { return Ok(()) };
    let mut groups: Vec<&str> =
        all.iter().map(|entry| entry.group.as_str()).filter(|group| !group.is_empty()).collect();
    groups.sort_unstable();
    groups.dedup();
    if groups.iter().any(|known| known.eq_ignore_ascii_case(group)) {
        return Ok(());
    }
    let help = match nearest(group, groups.iter().copied()) {
        Some(near) => format!("did you mean `{near}`?"),
        None => format!("the groups are: {}", groups.join(", ")),
    };
    Err(usage(format!("there is no group `{group}`"), &help))
}

fn entries(arguments: &Arguments, session: &mut Session) -> Vec<Entry> {
    let wanted = |kind: Kind| arguments.kind().is_none_or(|only| only == kind);
    let deep = arguments.json || arguments.asks_properties();
    let mut conformal: BTreeMap<String, bool> = BTreeMap::new();
    let mut entries = Vec::new();
    if wanted(Kind::Steps) {
        for step in session.library.steps() {
            entries.push(step_entry(session, step, deep, &mut conformal));
        }
    }
    if wanted(Kind::Fractals) {
        for (name, _) in embedded::FRACTALS {
            let graph = load(&mut session.library, name, &[], &mut Diagnostics::default()).map(|loaded| loaded.graph);
            let found = graph.as_ref().filter(|_| deep);
            let properties =
                found.and_then(|graph| fractal_properties(session, graph, arguments.asks_estimates(), &mut conformal));
            entries.push(fractal_entry(name, graph.as_ref(), properties));
        }
    }
    if wanted(Kind::Scenes) {
        for (name, _) in embedded::SCENES {
            let loaded = load(&mut session.library, name, &[], &mut Diagnostics::default());
            let summary = loaded.map_or(String::new(), |loaded| loaded.graph.summary.clone());
            entries.push(Entry { summary, ..plain_entry(Kind::Scenes, name, "scenes") });
        }
    }
    if wanted(Kind::Scripts) {
        entries.extend(embedded::SCRIPTS.iter().map(|(name, text)| Entry {
            kind: Kind::Scripts,
            name: name.to_string(),
            group: String::new(),
            summary: script_summary(text),
            inventor: String::new(),
            year: None,
            properties: None,
        }));
    }
    if wanted(Kind::Palettes) {
        entries.extend(palettes::all().iter().map(|palette| Entry {
            summary: format!("{}  {}", swatch(&palette.gradient), palette.summary),
            ..plain_entry(Kind::Palettes, &palette.name, &palette.group)
        }));
    }
    if wanted(Kind::Materials) {
        entries.extend(session.library.materials().map(|material| Entry {
            summary: material.summary.clone(),
            ..plain_entry(Kind::Materials, &material.name, &material.group)
        }));
    }
    entries
}

fn plain_entry(kind: Kind, name: &str, group: &str) -> Entry {
    let (name, group) = (name.to_string(), group.to_string());
    Entry { kind, name, group, summary: String::new(), inventor: String::new(), year: None, properties: None }
}

/// Whether a step is conformal, measured once.
fn conformal(session: &Session, step: &Step, known: &mut BTreeMap<String, bool>) -> bool {
    *known.entry(step.name.clone()).or_insert_with(|| is_conformal(&session.library, step))
}

fn step_entry(session: &Session, step: &Step, deep: bool, known: &mut BTreeMap<String, bool>) -> Entry {
    let properties = deep.then(|| Properties {
        conformal: conformal(session, step, known),
        differentiable: step.differentiable,
        exact: step.scalar_rule == Some(ScalarRule::Exact),
        dimensions: match step.state {
            StateWidth::Three => vec![3],
            StateWidth::Four => vec![4],
            StateWidth::Embeds => vec![4],
            StateWidth::Any => vec![3, 4],
        },
        ..Properties::default()
    });
    Entry {
        kind: Kind::Steps,
        name: step.name.clone(),
        group: step.group.clone(),
        summary: step.summary.clone(),
        inventor: step.inventor.clone(),
        year: step.year,
        properties,
    }
}

fn fractal_entry(name: &str, graph: Option<&ValidGraph>, properties: Option<Properties>) -> Entry {
    let of = |text: fn(&ValidGraph) -> &str| graph.map_or("", text).to_string();
    Entry {
        kind: Kind::Fractals,
        name: name.to_string(),
        group: of(|graph| &graph.group),
        summary: graph.map_or("(broken)", |graph| &graph.summary).to_string(),
        inventor: of(|graph| &graph.inventor),
        year: graph.and_then(|graph| graph.year),
        properties,
    }
}

fn fractal_properties(
    session: &Session,
    graph: &ValidGraph,
    estimates: bool,
    known: &mut BTreeMap<String, bool>,
) -> Option<Properties> {
    let arena = Arc::new(Arena::default());
    let composer = Composer { arena: &arena, library: &session.library, graph };
    let plan = match estimates {
        true => Some(choose(&composer, &EstimateSettings::default()).ok()?),
        false => None,
    };
    let plan = plan.as_ref();
    let mut steps: Vec<&Step> = Vec::new();
    let mut roots = Vec::new();
    for node in &graph.nodes {
        match &node.kind {
            NodeKind::Step { step, .. } => steps.push(step),
            NodeKind::Orbit { of, settings } => roots.push((*of, settings)),
            _ => {}
        }
    }
    Some(Properties {
        conformal: !steps.is_empty() && steps.iter().all(|step| conformal(session, step, known)),
        differentiable: steps.iter().all(|step| step.differentiable),
        exact: !roots.is_empty()
            && roots.iter().all(|(root, _)| scalar_rules(&composer, *root) == Some(ScalarRule::Exact)),
        dimensions: vec![if graph.scene.plane.is_some() {
            2
        } else {
            roots.iter().map(|(root, settings)| graph.state_width(*root, settings)).max().unwrap_or(3)
        }],
        estimates: plan.iter().flat_map(|plan| plan.applicable()).map(|method| method.name()).collect(),
        chosen: plan.iter().flat_map(|plan| &plan.choices).map(|choice| choice.method.name()).collect(),
    })
}

fn print(entries: &[&Entry], out: &mut dyn Write) -> Outcome {
    let mut parts: BTreeMap<(u8, String), Vec<&Entry>> = BTreeMap::new();
    for entry in entries {
        let (order, kind) = (entry.kind as u8, entry.kind.name());
        let heading = if entry.group.is_empty() { kind.into() } else { format!("{kind}: {}", entry.group) };
        parts.entry((order, heading)).or_default().push(entry);
    }
    let width = entries.iter().map(|entry| entry.name.len()).max().unwrap_or(0);
    for (i, ((_, heading), entries)) in parts.iter().enumerate() {
        writeln!(out, "{}{heading}", if i > 0 { "\n" } else { "" })?;
        for entry in entries {
            writeln!(out, "  {:<width$}  {}", entry.name, entry.summary)?;
        }
    }
    Ok(())
}

fn to_json(entries: &[&Entry]) -> Value {
    let of = |kind: Kind| -> Vec<Value> {
        entries.iter().filter(|entry| entry.kind == kind).map(|entry| entry_json(entry)).collect()
    };
    json!({
        "version": 1, "steps": of(Kind::Steps), "fractals": of(Kind::Fractals), "scenes": of(Kind::Scenes),
        "scripts": of(Kind::Scripts),
        "palettes": of(Kind::Palettes), "materials": of(Kind::Materials),
    })
}

fn entry_json(entry: &Entry) -> Value {
    let mut value = json!({"name": entry.name, "summary": entry.summary});
    if entry.kind == Kind::Scripts {
        return value;
    }
    value["group"] = json!(entry.group);
    if matches!(entry.kind, Kind::Scenes | Kind::Palettes | Kind::Materials) {
        return value;
    }
    value["inventor"] = json!(entry.inventor);
    value["year"] = json!(entry.year);
    if let Some(properties) = &entry.properties {
        value["conformal"] = json!(properties.conformal);
        value["differentiable"] = json!(properties.differentiable);
        value["exact_scalar_rule"] = json!(properties.exact);
        value["dimensions"] = json!(properties.dimensions);
        if entry.kind == Kind::Fractals {
            value["estimates"] = json!(properties.estimates);
            value["chosen_estimates"] = json!(properties.chosen);
        }
    }
    value
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
