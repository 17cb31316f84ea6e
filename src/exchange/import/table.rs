//! The tables of formulas: which steps make a formula of another program, with which of its settings.
//!
//! A table is a RON file beside this one. A row names the formula and lists its map as nodes of our graphs, in which
//!
//! - `$scale` stands for a parameter of the new file, declared in the row's `params` with the setting it comes from;
//! - `{expression}` is replaced by the value of a Rhai expression of the settings, in which vectors have the parts `.x`,
//!   `.y` and `.z`;
//! - `#` is the number of the repetition, where a part has `times`.
//!
//! A part with `when` is there only where that expression is true, one with `range` only in the iterations from the first
//! expression to the one before the second. Every setting that a row names must have a default in the table, because
//! settings files list only what differs from it; words among them stand in single quotes.

use std::collections::BTreeMap;

use rhai::{Engine, Scope};
use serde::Deserialize;

use super::ask::Ask;
use super::text::sequence;
use super::value::{Value, written_dynamic};
use crate::diag::Diagnostics;

/// The program's last iteration where a setting says that something never stops.
const ENDLESS: f64 = 250.0;

/// A program's formulas.
#[derive(Deserialize, Debug)]
#[serde(deny_unknown_fields)]
pub struct Table {
    /// The program's default of every setting that rows read.
    pub defaults: BTreeMap<String, String>,
    /// The formulas.
    pub formulas: Vec<Row>,
}

/// One formula.
#[derive(Deserialize, Debug)]
#[serde(deny_unknown_fields)]
pub struct Row {
    /// What the program calls it.
    pub name: String,
    /// Its number, where formulas are numbered.
    #[serde(default)]
    pub id: u32,
    /// Names of files (without ending, in lower case) that hold it, where formulas are files.
    #[serde(default)]
    pub files: Vec<String>,
    /// Which constant it adds.
    pub constant: Adds,
    /// The program's default bailout, or an expression of the settings.
    pub bailout: String,
    /// What the running estimate is made of, as the `estimate` of graph files writes it, without brackets.
    #[serde(default)]
    pub estimate: String,
    /// An expression of the settings for the iteration limit, where it is a setting of the formula.
    #[serde(default)]
    pub iterations: String,
    /// Parameters of the new file: name, and expression of the settings.
    #[serde(default)]
    pub params: Vec<(String, String)>,
    /// The map: parts in their order.
    pub map: Vec<Part>,
    /// Maps of the start point before the first iteration, which the constant goes through as well.
    #[serde(default)]
    pub pre: Vec<Part>,
    /// The field that the end of an orbit is looked up in, where the program's estimate is not that of the length. Of several
    /// parts the first that is there counts.
    #[serde(default)]
    pub end: Vec<Part>,
    /// Shapes at the levels of the orbit (the dIFS families), instead of what escapes.
    #[serde(default)]
    pub levels: Vec<Level>,
    /// Where the map is not the program's: a condition, and what is not the same.
    #[serde(default)]
    pub caveats: Vec<(String, String)>,
    /// An expression of the settings for the radius of a ball around the origin that holds the set where each iteration adds
    /// the point; empty, or 0, where that is not known.
    #[serde(default)]
    pub reach: String,
    /// Whether the program's running derivative is not that of our scalar rules: it takes finite differences, a step has no
    /// rule, or ours is a bound.
    #[serde(default)]
    pub differences: bool,
    /// Settings (or beginnings of their names, with a `*` behind) that the program's formula reads and the map does not.
    #[serde(default)]
    pub ignores: Vec<String>,
}

/// Which constant a formula adds after an iteration.
#[derive(Deserialize, Clone, Copy, PartialEq, Eq, Debug)]
pub enum Adds {
    /// The start point or the Julia constant, unless the settings say otherwise.
    Point,
    /// None, unless the settings say otherwise.
    Nothing,
    /// The start point, whatever the settings say.
    Always,
}

/// A part of a map.
#[derive(Deserialize, Debug)]
#[serde(deny_unknown_fields)]
pub struct Part {
    /// A node of a graph, or several with commas between them.
    #[serde(default)]
    pub step: String,
    /// Parts in its place.
    #[serde(default)]
    pub each: Vec<Part>,
    /// Whether it is there; always where empty.
    #[serde(default)]
    pub when: String,
    /// How often it is repeated, with numbers from 0.
    #[serde(default)]
    pub times: Option<u32>,
    /// The first iteration in which it runs, and the first in which it does not any more.
    #[serde(default)]
    pub range: Option<(String, String)>,
}

/// A shape at levels of an orbit.
#[derive(Deserialize, Debug)]
#[serde(deny_unknown_fields)]
pub struct Level {
    /// A field.
    pub shape: String,
    /// Whether it is there; always where empty.
    #[serde(default)]
    pub when: String,
    /// Whether it is looked up behind the map of an iteration; otherwise before it.
    #[serde(default)]
    pub behind: bool,
    /// The first iteration in which it is looked up, and the first in which it is not any more.
    pub range: (String, String),
}

/// A level with a file's settings in it.
#[derive(Clone, PartialEq, Debug)]
pub struct ExpandedLevel {
    /// The field.
    pub shape: String,
    /// Iterations that it is looked up in.
    pub range: (f64, f64),
    /// Whether that is behind their maps.
    pub behind: bool,
}

/// A row with a file's settings in it.
#[derive(Clone, PartialEq, Debug)]
pub struct Expanded {
    /// Nodes of one iteration, in order.
    pub steps: Vec<String>,
    /// Maps of the start point.
    pub pre: Vec<String>,
    /// The field at the ends of orbits, where there is one.
    pub end: Option<String>,
    /// Shapes at levels, where there are some.
    pub levels: Vec<ExpandedLevel>,
    /// Parameters of the new file: name and value.
    pub params: Vec<(String, f64)>,
    /// Caveats that apply.
    pub caveats: Vec<String>,
    /// Bailout.
    pub bailout: f64,
    /// Iteration limit, where the row has one.
    pub iterations: Option<f64>,
    /// Radius of a ball around the set, where the row knows one.
    pub reach: Option<f64>,
}

impl Table {
    /// Mandelbulber's formulas.
    pub fn mandelbulber() -> Table {
        let mut table = read(include_str!("mandelbulber.ron"));
        for text in [
            include_str!("table/boxes.ron"),
            include_str!("table/kleinian.ron"),
            include_str!("table/bulbs.ron"),
            include_str!("table/transforms.ron"),
            include_str!("table/fields.ron"),
        ] {
            let more = read(text);
            table.defaults.extend(more.defaults);
            table.formulas.extend(more.formulas);
        }
        table
    }

    /// Formulas of Fragmentarium's examples.
    pub fn fragmentarium() -> Table {
        read(include_str!("fragmentarium.ron"))
    }

    /// The formula of a number.
    pub fn by_id(&self, id: u32) -> Option<&Row> {
        self.formulas.iter().find(|row| row.id == id)
    }

    /// Puts a file's settings into a row. `suffix` is appended to the names of parameters. Errors of values are pushed.
    pub fn expand(&self, row: &Row, suffix: &str, ask: &dyn Ask, d: &mut Diagnostics) -> Expanded {
        let mut scope = Scope::new();
        for name in row.settings() {
            let default = self.default_of(&name);
            scope.push_constant(name.clone(), ask.ask(&name, &default, d).dynamic());
        }
        let mut filler = Filler { engine: engine(), scope, suffix, row };
        let mut steps = Vec::new();
        filler.parts(&row.map, "", &mut steps);
        let (mut pre, mut end) = (Vec::new(), Vec::new());
        filler.parts(&row.pre, "", &mut pre);
        filler.parts(&row.end, "", &mut end);
        let levels = filler.levels(&row.levels);
        let caveats = row.caveats.iter().filter(|(when, _)| filler.truth(when)).map(|(_, text)| text.clone()).collect();
        let params = row.params.iter().map(|(name, from)| (format!("{name}{suffix}"), filler.number(from))).collect();
        let bailout = filler.number(&row.bailout);
        let iterations = (!row.iterations.is_empty()).then(|| filler.number(&row.iterations));
        let reach = (!row.reach.is_empty()).then(|| filler.number(&row.reach)).filter(|radius| *radius > 0.0);
        let end = end.into_iter().next();
        Expanded { steps, pre, end, levels, params, caveats, bailout, iterations, reach }
    }

    fn default_of(&self, name: &str) -> Value {
        let text = self.defaults.get(name).unwrap_or_else(|| panic!("the table has no default of `{name}`"));
        Value::read(text).unwrap_or_else(|| panic!("the table's default of `{name}` is no value"))
    }
}

impl Row {
    /// Names of all settings in the row's expressions.
    pub fn settings(&self) -> Vec<String> {
        let mut names = Vec::new();
        let mut add = |expression: &str| {
            for word in words(expression) {
                if !names.contains(&word) {
                    names.push(word);
                }
            }
        };
        for parts in [&self.map, &self.pre, &self.end] {
            each_part(parts, "", &mut |part, number| {
                add(&part.when.replace('#', number));
                part.range.iter().flat_map(|(from, to)| [from, to]).for_each(|e| add(&e.replace('#', number)));
                expressions(&part.step).into_iter().for_each(|e| add(&e.replace('#', number)));
            });
        }
        for level in &self.levels {
            [&level.when, &level.range.0, &level.range.1].into_iter().for_each(|e| add(e));
            expressions(&level.shape).into_iter().for_each(&mut add);
        }
        self.caveats.iter().for_each(|(when, _)| add(when));
        self.params.iter().for_each(|(_, from)| add(from));
        add(&self.bailout);
        add(&self.iterations);
        add(&self.reach);
        names
    }

    /// Whether the program's formula reads a setting that the map does not.
    pub fn ignores(&self, name: &str) -> bool {
        self.ignores.iter().any(|ignored| match ignored.strip_suffix('*') {
            Some(beginning) => name.starts_with(beginning),
            None => name == ignored,
        })
    }
}

/// Calls `f` with every part, repeated as often as it says, and the number of its repetition.
fn each_part(parts: &[Part], number: &str, f: &mut dyn FnMut(&Part, &str)) {
    for part in parts {
        for number in part.numbers(number) {
            f(part, &number);
            each_part(&part.each, &number, f);
        }
    }
}

impl Part {
    /// The numbers of its repetitions; that of the part around it where it has none.
    fn numbers(&self, outer: &str) -> Vec<String> {
        self.times.map_or(vec![outer.to_string()], |times| (0..times).map(|i| i.to_string()).collect())
    }
}

/// Replaces what is open in a row's texts.
struct Filler<'a> {
    engine: Engine,
    scope: Scope<'static>,
    suffix: &'a str,
    row: &'a Row,
}

impl Filler<'_> {
    /// Appends the nodes of all parts that are there.
    fn parts(&mut self, parts: &[Part], number: &str, steps: &mut Vec<String>) {
        for part in parts {
            for number in part.numbers(number) {
                if !part.when.is_empty() && !self.truth(&part.when.replace('#', &number)) {
                    continue;
                }
                let mut found = Vec::new();
                if !part.step.is_empty() {
                    found.push(self.fill(&part.step.replace('#', &number)));
                }
                self.parts(&part.each, &number, &mut found);
                match &part.range {
                    Some((from, to)) if !found.is_empty() => {
                        let (from, to) =
                            (self.number(&from.replace('#', &number)), self.number(&to.replace('#', &number)));
                        steps.extend(between(found, from, to));
                    }
                    _ => steps.extend(found),
                }
            }
        }
    }

    fn levels(&mut self, levels: &[Level]) -> Vec<ExpandedLevel> {
        let mut found = Vec::new();
        for level in levels {
            if level.when.is_empty() || self.truth(&level.when) {
                let range = (self.number(&level.range.0), self.number(&level.range.1));
                found.push(ExpandedLevel { shape: self.fill(&level.shape), range, behind: level.behind });
            }
        }
        found
    }

    fn fill(&mut self, template: &str) -> String {
        let mut text = String::new();
        let mut rest = template;
        while let Some(at) = rest.find(['$', '{']) {
            text.push_str(&rest[..at]);
            if rest[at..].starts_with('$') {
                let end = rest[at + 1..].find(|c: char| !is_word(c)).map_or(rest.len(), |i| at + 1 + i);
                text.push_str(&rest[at + 1..end]);
                text.push_str(self.suffix);
                rest = &rest[end..];
            } else {
                let end = rest[at..].find('}').map_or(rest.len(), |i| at + i);
                let value = self.value(&rest[at + 1..end]);
                text.push_str(&written_dynamic(&value).unwrap_or_else(|| "0.0".into()));
                rest = rest.get(end + 1..).unwrap_or("");
            }
        }
        text + rest
    }

    fn truth(&mut self, expression: &str) -> bool {
        self.value(expression).as_bool().unwrap_or(false)
    }

    fn number(&mut self, expression: &str) -> f64 {
        let value = self.value(expression);
        value.as_float().or_else(|_| value.as_int().map(|i| i as f64)).unwrap_or(0.0)
    }

    /// The tables are ours, so an expression that fails is a mistake of ours, which a test over all rows finds.
    fn value(&mut self, expression: &str) -> rhai::Dynamic {
        let result = self.engine.eval_expression_with_scope(&mut self.scope, expression);
        result.unwrap_or_else(|error| panic!("the row of {}: `{expression}`: {error}", self.row.name))
    }
}

/// Steps that run from iteration `from` on, below `to`.
fn between(steps: Vec<String>, from: f64, to: f64) -> Vec<String> {
    let from = from.max(0.0);
    if from >= to {
        return Vec::new();
    }
    if from == 0.0 && to >= ENDLESS {
        return steps;
    }
    vec![format!("Between(of: {}, from: {from}, to: {to})", sequence(&steps))]
}

fn engine() -> Engine {
    let mut engine = Engine::new();
    engine.set_max_operations(10_000).set_fail_on_invalid_map_property(true);
    functions::register(&mut engine);
    engine
}

/// A table of this program.
fn read(text: &str) -> Table {
    ron::from_str(text).unwrap_or_else(|error| panic!("a table of formulas is broken: {error}"))
}

fn is_word(c: char) -> bool {
    c.is_ascii_alphanumeric() || c == '_'
}

/// What stands in braces.
fn expressions(template: &str) -> Vec<&str> {
    template.split('{').skip(1).filter_map(|rest| rest.split('}').next()).collect()
}

/// Names in an expression: words that are no numbers, parts of vectors, functions or texts.
fn words(expression: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut previous = ' ';
    let mut rest = expression;
    while let Some(c) = rest.chars().next() {
        if c == '"' {
            rest = rest[1..].split_once('"').map_or("", |(_, rest)| rest);
        } else if c.is_ascii_alphabetic() || c == '_' {
            let end = rest.find(|c| !is_word(c)).unwrap_or(rest.len());
            let is_call = rest[end..].starts_with('(');
            let word = &rest[..end];
            if previous != '.'
                && !previous.is_ascii_digit()
                && !is_call
                && !["true", "false", "if", "else"].contains(&word)
            {
                found.push(word.to_string());
            }
            rest = &rest[end..];
        } else {
            rest = &rest[c.len_utf8()..];
        }
        previous = c;
    }
    found
}

mod functions;

#[cfg(test)]
mod tests;
