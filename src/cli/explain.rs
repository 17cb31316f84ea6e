//! `bulbfold explain`: everything about one step or fractal.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bulbfold::colour::palettes;
use bulbfold::compose::{Composer, choose};
use bulbfold::diag::Diagnostics;
use bulbfold::expr::{Arena, Function, Port, Type, print};
use bulbfold::files::{Chosen, MAX_TEXT, read_text};
use bulbfold::formula::embedded;
use bulbfold::formula::shape::ShapeDistance;
use bulbfold::formula::step::{
    Growth, ParamKind, ParamValue, ScalarRule, StateWidth, Step, StepInputs, Traced, script_value,
};
use bulbfold::graph::{Camera, EstimateSettings, ValidGraph, print as graph_print};
use bulbfold::kernel::{Kernel, wgsl};
use bulbfold::render::{RenderSettings, camera_of, compose_pipeline};
use clap::Args;

use super::notation::Notation;
use super::page::{Block, markdown, plain};
use super::{Failure, Outcome, Session, cost, matter_pages, usage};

/// Arguments of `explain`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold explain box_fold
  bulbfold explain mandelbulb
  bulbfold explain marble
  bulbfold explain mandelbox --latex
  bulbfold explain sphere_fold --markdown > sphere_fold.md")]
pub struct Arguments {
    /// A step, a built-in fractal or script, a material, a palette, or a file of one of them
    name: PathBuf,
    /// Print Markdown
    #[arg(long)]
    markdown: bool,
    /// Write formulas as LaTeX
    #[arg(long)]
    latex: bool,
}

/// Runs the command.
pub fn run(arguments: &Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    let path = &arguments.name;
    let blocks = match find_step(session, path)? {
        Some(step) => {
            let mut blocks = step_page(session, &step);
            blocks.extend(Notation { session, latex: arguments.latex }.step(&step)?);
            blocks.extend(code_blocks(session, &step)?);
            blocks
        }
        None => match matter_pages::explained(session, path)? {
            Some(blocks) => blocks,
            None => formula_page(arguments, session)?,
        },
    };
    let text = if arguments.markdown { markdown(&blocks, 0) } else { plain(&blocks) };
    Ok(out.write_all(text.as_bytes())?)
}

/// The page of a fractal or script.
fn formula_page(arguments: &Arguments, session: &mut Session) -> Result<Vec<Block>, Failure> {
    let (path, name) = (&arguments.name, arguments.name.to_string_lossy());
    let name = &*name;
    let formulas = embedded::FRACTALS.iter().chain(embedded::SCENES).chain(embedded::SCRIPTS).map(|(name, _)| *name);
    let looks = palettes::all().iter().map(|palette| palette.name.as_str());
    let looks = looks.chain(session.library.material_names());
    let known: Vec<&str> = session.library.names().chain(formulas).chain(looks).collect();
    if !known.contains(&name) && !path.exists() {
        let help = match bulbfold::diag::nearest(name, known) {
            Some(near) => format!("did you mean `{near}`?"),
            None => "`bulbfold list` shows all names".into(),
        };
        return Err(usage(format!("there is no step, fractal, material, palette or file `{name}`"), &help));
    }
    let graph = session.load(path, &[])?.graph;
    fractal_page(session, &graph, arguments.latex)
}

/// The step of this name or in this file, if there is one.
fn find_step(session: &mut Session, path: &Path) -> Result<Option<Arc<Step>>, Failure> {
    let is_step_file = path.extension().is_some_and(|e| e == "rhai")
        && read_text(path, MAX_TEXT, Chosen::Found).is_ok_and(|text| bulbfold::formula::shape::is_step_text(&text));
    if !is_step_file {
        return Ok(path.to_str().and_then(|name| session.library.step(name)).cloned());
    }
    let mut d = Diagnostics::default();
    session.library.add_step_file(path, &mut d);
    session.library.add_beside(path.parent().unwrap_or(Path::new("")), &mut d);
    session.report(d)?;
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    Ok(session.library.step(&stem).cloned())
}

/// The facts in a step's file.
pub fn step_page(session: &Session, step: &Step) -> Vec<Block> {
    let mut blocks = vec![Block::Heading(1, step.name.clone()), Block::Text(step.summary.clone())];
    let state = match step.state {
        StateWidth::Three => "x, y and z",
        StateWidth::Four => "x, y, z and w",
        StateWidth::Any => "all components that the orbit has",
        StateWidth::Embeds => "x, y and z; makes four components of them",
    };
    let growth = match step.growth {
        Some(Growth::Linear) => "by a factor",
        Some(Growth::Power) => "by a power",
        None => "not at all",
    };
    let distance = match step.distance {
        Some(ShapeDistance::Exact) => "exact",
        Some(ShapeDistance::Bound) => "a bound: it may be less than the true one",
        None => "none: it is a map",
    };
    let rule = match step.scalar_rule {
        Some(ScalarRule::Exact) => "exact",
        Some(ScalarRule::Heuristic) => "heuristic: can be exceeded",
        None => "none",
    };
    let invented = credit(&step.inventor, step.year);
    let facts = [
        ("Group", step.group.as_str()),
        ("Invented", invented.as_str()),
        ("Source", step.source.as_str()),
        ("Acts on", state),
        ("Far out r grows", growth),
        ("Scalar rule", rule),
        ("Distance", distance),
        ("Differentiable", if step.differentiable { "yes" } else { "no: finite differences are taken" }),
        ("File", session.library.sources.name(step.text)),
    ];
    let of_maps = ["Far out r grows", "Scalar rule"];
    let applies = |name: &str| if step.is_shape() { !of_maps.contains(&name) } else { name != "Distance" };
    let facts = facts.iter().filter(|(name, _)| applies(name));
    let rows = facts.map(|(name, value)| vec![name.to_string(), value.to_string()]).collect();
    blocks.push(Block::Table(vec!["Fact", "Value"], rows));
    if !step.params.is_empty() {
        blocks.push(Block::Heading(2, "Parameters".into()));
        let head = vec!["Name", "Type", "Default", "Range", "Unit", "Meaning"];
        blocks.push(Block::Table(head, step.params.iter().map(param_row).collect()));
    }
    if !step.notes.is_empty() {
        blocks.push(Block::Heading(2, "Notes".into()));
        blocks.push(Block::Text(step.notes.clone()));
    }
    blocks.push(Block::Heading(2, "Examples".into()));
    let head = vec!["z", "Parameters", "Result", "dr", "dr after"];
    blocks.push(Block::Table(head, step.examples.iter().map(example_row).collect()));
    blocks
}

/// Inventor and year, as far as they are known.
pub fn credit(inventor: &str, year: Option<u32>) -> String {
    let year = year.map(|year| year.to_string());
    let known: Vec<&str> = [Some(inventor), year.as_deref()].into_iter().flatten().filter(|s| !s.is_empty()).collect();
    if known.is_empty() { "unknown".into() } else { known.join(", ") }
}

pub(super) fn param_row(param: &bulbfold::formula::step::StepParam) -> Vec<String> {
    let kind = match &param.kind {
        ParamKind::Float => "float".into(),
        ParamKind::Int => "int".into(),
        ParamKind::Bool => "bool".into(),
        ParamKind::Angle => "angle".into(),
        ParamKind::Vec3 => "vec3".into(),
        ParamKind::Point => "point".into(),
        ParamKind::Mat3 => "mat3".into(),
        ParamKind::Choice(words) => words.join(" or "),
    };
    let range = match param.kind {
        ParamKind::Bool | ParamKind::Choice(_) => String::new(),
        _ => format!("{} to {}", param.min, param.max),
    };
    vec![param.name.clone(), kind, value_text(&param.default), range, param.unit.clone(), param.help.clone()]
}

pub fn value_text(value: &ParamValue) -> String {
    match value {
        ParamValue::Number(x) => x.to_string(),
        ParamValue::Bool(b) => b.to_string(),
        ParamValue::Word(word) => word.clone(),
        ParamValue::Vector(v) => numbers(v),
        ParamValue::Point(v) => numbers(v),
        ParamValue::Matrix(rows) => rows.iter().map(|row| numbers(row)).collect::<Vec<_>>().join(", "),
    }
}

/// Numbers in brackets, rounded where that only hides the last digits.
fn numbers(values: &[f64]) -> String {
    let texts: Vec<String> = values.iter().map(|x| number(*x)).collect();
    format!("({})", texts.join(", "))
}

fn number(x: f64) -> String {
    let rounded = format!("{x:.6}").parse::<f64>().unwrap_or(x);
    if (rounded - x).abs() <= 1e-9 * x.abs().max(1e-3) { rounded.to_string() } else { x.to_string() }
}

fn example_row(example: &bulbfold::formula::step::StepExample) -> Vec<String> {
    let mut params: Vec<String> = example.params.iter().map(|(name, v)| format!("{name}: {}", value_text(v))).collect();
    params.extend(example.c.as_ref().map(|c| format!("c: {}", numbers(c))));
    params.extend(example.before.as_ref().map(|before| format!("before: {}", numbers(before))));
    if example.before_dr != 0.0 {
        params.push(format!("before_dr: {}", number(example.before_dr)));
    }
    let dr = |pick: fn((f64, f64)) -> f64| example.dr.map(|dr| number(pick(dr))).unwrap_or_default();
    vec![numbers(&example.z), params.join(", "), numbers(&example.expect), dr(|dr| dr.0), dr(|dr| dr.1)]
}

/// What the step becomes with its default parameters: expressions and WGSL.
fn code_blocks(session: &Session, step: &Step) -> Result<Vec<Block>, Failure> {
    let arena = Arc::new(Arena::default());
    let ty = if step.state == StateWidth::Four { Type::V4 } else { Type::V3 };
    let mut ports = vec![Port::new("z", ty), Port::new("c", ty), Port::new("dr", Type::F)];
    if step.remembers() {
        ports.extend([Port::new("before", ty), Port::new("before_dr", Type::F)]);
    }
    let mut function = Function::new(step.name.clone(), ports);
    let inputs = function.input_exprs(&arena);
    let params =
        step.params.iter().map(|p| (p.name.clone().into(), script_value(&arena, &p.kind, &p.default))).collect();
    let library = &session.library;
    if step.is_shape() {
        let distance = step.trace_distance(&library.engine, &library.sources, &arena, inputs[0], &params);
        function.output("distance", distance.map_err(|diagnostic| session.failure(diagnostic))?);
        return Ok(code_of(session, step, &arena, function));
    }
    let before = step.remembers().then(|| Traced { z: inputs[3], dr: Some(inputs[4]) });
    let ports = StepInputs { z: inputs[0], c: inputs[1], dr: Some(inputs[2]), before };
    let traced = step.trace(&library.engine, &library.sources, &arena, ports, &params);
    let traced = traced.map_err(|diagnostic| session.failure(diagnostic))?;
    function.output("z", traced.z);
    if let Some(dr) = traced.dr {
        function.output("dr", dr);
    }
    Ok(code_of(session, step, &arena, function))
}

/// A traced step in text.
fn code_of(session: &Session, step: &Step, arena: &Arena, function: Function) -> Vec<Block> {
    let library = &session.library;
    vec![
        Block::Heading(2, "Expressions, with default parameters".into()),
        Block::Code("text", print::listing(arena, &function, &library.sources)),
        Block::Heading(2, "WGSL, with default parameters".into()),
        Block::Code("wgsl", wgsl::write(arena, &Kernel::Map(function))),
        Block::Heading(2, "Step file".into()),
        Block::Code("rust", library.sources.text(step.text).to_string()),
    ]
}

fn fractal_page(session: &Session, graph: &ValidGraph, latex: bool) -> Result<Vec<Block>, Failure> {
    let arena = Arc::new(Arena::default());
    let composer = Composer { arena: &arena, library: &session.library, graph };
    let plan = choose(&composer, &EstimateSettings::default()).map_err(|diagnostic| session.failure(diagnostic))?;
    let mut blocks = vec![Block::Heading(1, graph.name.clone())];
    blocks.extend((!graph.summary.is_empty()).then(|| Block::Text(graph.summary.clone())));
    let invented = credit(&graph.inventor, graph.year);
    for (name, text) in [("Group", graph.group.as_str()), ("Invented", &invented), ("Source", &graph.source)] {
        blocks.extend((!text.is_empty()).then(|| Block::Text(format!("{name}: {text}"))));
    }
    if !graph.params.is_empty() {
        blocks.extend([Block::Heading(2, "Parameters".into()), params_table(graph)]);
    }
    if !graph.presets.is_empty() {
        blocks.extend([Block::Heading(2, "Presets".into()), presets_table(graph)]);
    }
    blocks.push(Block::Heading(2, "Graph".into()));
    blocks.push(Block::Code("text", graph_print::listing_with_look(graph)));
    blocks.extend(Notation { session, latex }.fractal(&composer)?);
    blocks.push(Block::Heading(2, "Distance estimate".into()));
    let rows = plan.choices.iter().map(|c| {
        let applicable: Vec<&str> = c.applicable.iter().map(|m| m.name()).collect();
        vec![c.method.name().into(), c.form.name().into(), number(c.radius), applicable.join(", "), c.reason.clone()]
    });
    blocks.push(Block::Table(vec!["Method", "Form", "Radius", "Applicable", "Reason"], rows.collect()));
    let pipeline = compose_pipeline(&composer, &RenderSettings::default());
    let pipeline = pipeline.map_err(|diagnostic| session.failure(diagnostic))?;
    let table = cost::table(&composer, &pipeline).map_err(|diagnostic| session.failure(diagnostic))?;
    blocks.extend([Block::Heading(2, "Cost".into()), Block::Code("text", table)]);
    let camera = camera_of(&composer, &plan);
    blocks.extend(view(graph, &camera, plan.bounding_radius));
    let picture = format!("docs/thumbnails/{}.jpg", graph.name);
    blocks.extend([Block::Heading(2, "Picture".into()), Block::Text(picture)]);
    Ok(blocks)
}

/// What pictures of a fractal show: a plane, or what a camera sees.
fn view(graph: &ValidGraph, camera: &Camera, bounding_radius: f64) -> [Block; 2] {
    let rounded = |x: f64| (x * 1e4).round() / 1e4;
    if let Some(plane) = &graph.scene.plane {
        let text = format!(
            "Pictures show the points of a plane: center {}, height {}, right {}, up {}.",
            numbers(&plane.center),
            plane.height,
            numbers(&plane.right.map(rounded)),
            numbers(&plane.up.map(rounded)),
        );
        return [Block::Heading(2, "Plane".into()), Block::Text(text)];
    }
    let text = format!(
        "{}: position {}, target {}, field of view {} degrees; everything lies within {} of the origin.",
        if graph.scene.camera.is_some() { "From the file" } else { "Found automatically" },
        numbers(&camera.position.map(rounded)),
        numbers(&camera.target.map(rounded)),
        rounded(camera.fov.to_degrees()),
        rounded(bounding_radius),
    );
    [Block::Heading(2, "Camera".into()), Block::Text(text)]
}

/// The parameters of a fractal.
pub fn params_table(graph: &ValidGraph) -> Block {
    let rows = graph.params.iter().map(|p| {
        let range = format!("{} to {}", p.min, p.max);
        vec![p.name.clone(), p.default.to_string(), range, p.unit.clone(), p.help.clone()]
    });
    Block::Table(vec!["Name", "Default", "Range", "Unit", "Meaning"], rows.collect())
}

/// The presets of a fractal, with the values that they set.
pub fn presets_table(graph: &ValidGraph) -> Block {
    let rows = graph.presets.iter().map(|preset| {
        let changes = preset.changes.iter().map(|change| format!("{}: {}", change.path, change.value.kind));
        vec![preset.name.clone(), preset.help.clone(), changes.collect::<Vec<_>>().join(", ")]
    });
    Block::Table(vec!["Preset", "What it shows", "Values"], rows.collect())
}
