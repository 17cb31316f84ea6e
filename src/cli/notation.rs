//! The mathematics of steps and fractals, for `explain`: plain text or LaTeX.

use std::sync::Arc;

use bulbfold::compose::{Composer, FieldOrbit, field_orbits};
use bulbfold::expr::{Arena, Function, notation};
use bulbfold::formula::step::{ParamValue, Step};
use bulbfold::formula::written::written;
use bulbfold::graph::{
    Condition, Constant, Escape, MapTree, NodeKind, NodeRef, ParamInput, Schedule, ValidGraph, resolve_schedule,
};

use super::explain::value_text;
use super::page::Block;
use super::{Failure, Session};

/// Writes formulas of one kind.
pub struct Notation<'a> {
    /// Steps and texts.
    pub session: &'a Session,
    /// LaTeX instead of plain text.
    pub latex: bool,
}

impl Notation<'_> {
    fn language(&self) -> &'static str {
        if self.latex { "latex" } else { "text" }
    }

    fn formula(&self, arena: &Arena, function: &Function) -> String {
        if self.latex { notation::latex(arena, function) } else { notation::plain(arena, function) }
    }

    /// A step's map, its scalar rule and its exact derivative.
    pub fn step(&self, step: &Step) -> Result<Vec<Block>, Failure> {
        let arena = Arc::new(Arena::default());
        let written =
            written(&self.session.library, step, &arena, &[]).map_err(|diagnostic| self.session.failure(diagnostic))?;
        let mut blocks = vec![Block::Heading(2, "Formula".into())];
        if !written.known.is_empty() {
            let note = "The form depends on these parameters, which have their defaults here";
            blocks.push(Block::Text(format!("{note}: {}.", written.known.join(", "))));
        }
        let code = |function: &Function| Block::Code(self.language(), self.formula(&arena, function));
        blocks.push(code(&written.value));
        blocks.push(Block::Heading(2, "Derivative".into()));
        blocks.extend(written.rule.as_ref().map(code));
        if step.differentiable {
            let note = "Exact, along a direction v, by differentiating the formula:";
            blocks.extend([Block::Text(note.into()), code(&written.tangent)]);
        }
        Ok(blocks)
    }

    /// The iterations of all orbits of a fractal, and when each runs.
    pub fn fractal(&self, composer: &Composer) -> Result<Vec<Block>, Failure> {
        let mut blocks = Vec::new();
        for orbit in field_orbits(composer) {
            blocks.push(Block::Heading(2, format!("Iteration of {}", composer.graph.node(orbit.root).name)));
            blocks.extend(self.orbit(composer.graph, &orbit)?);
        }
        Ok(blocks)
    }

    fn orbit(&self, graph: &ValidGraph, orbit: &FieldOrbit) -> Result<Vec<Block>, Failure> {
        let settings = &orbit.settings;
        let (maps, schedule) = resolve_schedule(graph, orbit.root, settings.constant, settings.max_iterations);
        let mut blocks = Vec::new();
        if maps.len() > 1 {
            blocks.push(Block::Text(schedule_text(&schedule)));
        }
        for (i, map) in maps.iter().enumerate() {
            if maps.len() > 1 {
                blocks.push(Block::Heading(3, format!("Iteration {}", letter(i))));
            }
            let mut text = String::new();
            self.map(graph, &map.map, 0, &mut text)?;
            text.push_str(&self.comment(&constant_text(map.constant), 0));
            blocks.push(Block::Code(self.language(), text));
        }
        if let Some(start) = settings.start {
            blocks.push(Block::Text(format!("It starts at {}, and c is the point.", point_text(start))));
        }
        let ends = escape_text(settings.escape, settings.escape_radius);
        let end =
            format!("It ends where {ends}, or after {} iterations: such points are inside.", settings.max_iterations);
        blocks.push(Block::Text(end));
        Ok(blocks)
    }

    /// A line of words, which LaTeX takes for a comment.
    fn comment(&self, text: &str, depth: usize) -> String {
        format!("{}{}{text}\n", if self.latex { "% " } else { "" }, "  ".repeat(depth))
    }

    fn map(&self, graph: &ValidGraph, map: &MapTree, depth: usize, text: &mut String) -> Result<(), Failure> {
        match map {
            MapTree::Identity => text.push_str(&self.comment("z stays as it is", depth)),
            MapTree::Step(node) => self.node(graph, *node, depth, text)?,
            MapTree::Sequence(parts) => {
                for part in parts {
                    self.map(graph, part, depth, text)?;
                }
            }
            MapTree::Repeat(of, times) => {
                text.push_str(&self.comment(&format!("{times} times:"), depth));
                self.map(graph, of, depth + 1, text)?;
            }
            MapTree::Blend(a, b, weight) => {
                text.push_str(&self.comment(&format!("the sum of {} of:", 1.0 - weight), depth));
                self.map(graph, a, depth + 1, text)?;
                text.push_str(&self.comment(&format!("and {weight} of:"), depth));
                self.map(graph, b, depth + 1, text)?;
            }
            MapTree::Choose(condition, a, b) => {
                text.push_str(&self.comment(&format!("where {}:", condition_text(*condition)), depth));
                self.map(graph, a, depth + 1, text)?;
                text.push_str(&self.comment("elsewhere:", depth));
                self.map(graph, b, depth + 1, text)?;
            }
        }
        Ok(())
    }

    /// A step with the values of its parameters.
    fn node(&self, graph: &ValidGraph, node: NodeRef, depth: usize, text: &mut String) -> Result<(), Failure> {
        let node = graph.node(node);
        let NodeKind::Step { step, params } = &node.kind else { return Ok(()) };
        let inputs = step.params.iter().zip(params);
        let given: Vec<(String, ParamValue)> = inputs
            .clone()
            .filter_map(|(param, input)| match input {
                ParamInput::Known(value) => Some((param.name.clone(), value.clone())),
                ParamInput::OfIteration(_) => None,
            })
            .collect();
        let arena = Arc::new(Arena::default());
        let written = written(&self.session.library, step, &arena, &given);
        let written = written.map_err(|diagnostic| self.session.failure(diagnostic))?;
        let values: Vec<String> = inputs
            .map(|(param, input)| match input {
                ParamInput::Known(value) => format!("{} = {}", param.name, value_text(value)),
                ParamInput::OfIteration(formula) => format!("{} = {formula}", param.name),
            })
            .collect();
        let title = if node.name == step.name { node.name.clone() } else { format!("{} ({})", node.name, step.name) };
        let with = if values.is_empty() { String::new() } else { format!(" with {}", values.join(", ")) };
        text.push_str(&self.comment(&format!("{title}{with}:"), depth));
        for line in self.formula(&arena, &written.value).lines() {
            text.push_str(&format!("{}{line}\n", "  ".repeat(depth + 1)));
        }
        Ok(())
    }
}

/// A, B, ... for the distinct iterations of a hybrid.
fn letter(i: usize) -> String {
    match u8::try_from(i) {
        Ok(i) if i < 26 => char::from(b'A' + i).to_string(),
        _ => format!("A{i}"),
    }
}

fn schedule_text(schedule: &Schedule) -> String {
    let turns = |items: &[usize]| {
        let mut texts: Vec<String> = Vec::new();
        for run in items.chunk_by(|a, b| a == b) {
            let many = if run.len() > 1 { format!(" {} times", run.len()) } else { String::new() };
            texts.push(format!("{}{many}", letter(run[0])));
        }
        texts.join(", then ")
    };
    let cycle = match schedule.cycle.iter().all(|item| *item == schedule.cycle[0]) {
        true => format!("{} in all iterations", schedule.cycle.first().map_or(String::new(), |item| letter(*item))),
        false => format!("alternating {}", turns(&schedule.cycle)),
    };
    match schedule.prefix.is_empty() {
        true => format!("Iterations run {cycle}."),
        false => format!("Iterations run first {}, after that {cycle}.", turns(&schedule.prefix)),
    }
}

fn constant_text(constant: Constant) -> String {
    let point = point_text;
    match constant {
        Constant::Mandelbrot => "then z' = z + c, where c is the point".into(),
        Constant::Julia(p) => format!("then z' = z + {}", point(p)),
        Constant::Mix(p, amount) => {
            format!("then z' = z + {} c + {amount} {}, where c is the point", 1.0 - amount, point(p))
        }
        Constant::Off => "nothing is added".into(),
    }
}

/// A point with its fourth component where that is not 0.
fn point_text(p: [f64; 4]) -> String {
    let shown = if p[3] == 0.0 { &p[..3] } else { &p[..] };
    format!("({})", shown.iter().map(f64::to_string).collect::<Vec<_>>().join(", "))
}

fn escape_text(escape: Escape, bound: f64) -> String {
    match escape {
        Escape::Length => format!("r = |z| is above {bound}"),
        Escape::Largest => format!("the largest component of z in size is above {bound}"),
        Escape::Sum => format!("the sum of the sizes of z's components is above {bound}"),
        Escape::Above(normal) => format!("z · {} is above {bound}", point_text(normal)),
        Escape::Beyond(normal) => format!("|z · {}| is above {bound}", point_text(normal)),
        Escape::Near(point) => format!("|z - {}| is below {bound}", point_text(point)),
        Escape::Still => format!("z moves by less than {bound}, or by less than {bound} |z|, in an iteration"),
    }
}

fn condition_text(condition: Condition) -> String {
    let axis = |i: u8| ["x", "y", "z", "w"][usize::from(i.min(3))];
    match condition {
        Condition::IterationBelow(n) => format!("n < {n}"),
        Condition::IterationEvery(n) => format!("n mod {n} = 0"),
        Condition::RadiusBelow(r) => format!("‖z‖ < {r}"),
        Condition::RadiusAbove(r) => format!("‖z‖ > {r}"),
        Condition::Negative(i) => format!("z.{} < 0", axis(i)),
        Condition::Positive(i) => format!("z.{} > 0", axis(i)),
    }
}
