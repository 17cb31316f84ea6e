//! Graph scripts: Rhai programs that return a graph.
//!
//! In comes the text of a `.rhai` file, out goes the same value tree that a RON file gives, so everything after is
//! shared. A script runs once and leaves a graph; nothing of it runs for each point. It sees, beside Rhai itself:
//!
//! - a constructor for each kind of node and each step, named as in RON files: `bulb_power(#{ power: 8 })`,
//!   `Sequence([a, b])`, `Alternate([[a, 2], b])`, `Repeat(#{ of: a, times: 3 })`, `Julia([x, y, z])`, tests such as
//!   `Inside([0, 0, 0])`. Nodes are values: they may stand where RON names one.
//! - the words `Mandelbrot` and `Off`;
//! - `param(name, default)` and `param(name, default, #{ min: ..., max: ..., unit: ..., help: ... })`: a number that
//!   `--set name=value` replaces;
//! - `rand(seed)`: a source of random numbers with `float()` (0 to below 1), `range(a, b)`, `int(a, b)` (both included)
//!   and `pick(list)`; `random(seed, i)` is number `i` of a seed. Both are SplitMix64 and the same on every machine.
//!
//! The script's value is a map with the fields of a fractal file, or just the node to draw.

use std::sync::{Arc, Mutex, PoisonError};

use rhai::{Array, Dynamic, Engine, EvalAltResult, INT, Map, NativeCallContext, Position};

use super::nodes::KEYWORDS;
use super::overrides::Override;
use crate::diag::{Diagnostic, Diagnostics, SourceId, Sources, Span};
use crate::expr::Arena;
use crate::formula::library::Library;
use crate::formula::script::{Places, ScriptEngine, Spot, base_scope, type_name};
use crate::formula::value::{Name, Value, ValueKind};

/// Constructors beside those of nodes: constants, conditions, tests and symmetries.
const OTHER_CONSTRUCTORS: &[&str] = &[
    "Julia",
    "Mix",
    "IterationBelow",
    "IterationEvery",
    "RadiusBelow",
    "RadiusAbove",
    "Negative",
    "Positive",
    "Length",
    "Largest",
    "Sum",
    "Above",
    "Below",
    "Beyond",
    "Near",
    "Still",
    "Point",
    "Line",
    "Circle",
    "LastFold",
    "Inside",
    "Outside",
    "Estimate",
    "Ray",
    "Symmetric",
    "NeverAbove",
    "Mirror",
    "Swap",
    "Turn",
];
/// Values without parts.
const WORDS: &[&str] = &["Mandelbrot", "Off", "AgreesOnBackends", "Iterations"];
/// Values that one node may hold, with all its parts.
const MAX_VALUES: usize = 10_000;
/// How deep lists and fields of a node may lie in each other.
const MAX_NESTED: usize = 64;
/// Values that all nodes of a script may hold together.
const MAX_TOTAL: usize = 500_000;

type Fallible<T> = Result<T, Box<EvalAltResult>>;

/// A node as scripts hold it: cheap to copy, however large.
#[derive(Clone)]
struct Made {
    value: Arc<Value>,
    held: Holding,
}

/// A parameter that a script asked for.
struct AskedParam {
    name: String,
    /// Its description, as a fractal file would hold it.
    description: Value,
}

/// What the constructors share.
struct Run {
    sources: Sources,
    text: SourceId,
    overrides: Vec<Override>,
    places: Places,
    asked: Mutex<Vec<AskedParam>>,
    total: Mutex<usize>,
}

/// Runs a graph script whose text is in the library's sources. Parameters that it asks for are taken from `overrides`
/// and declared in the result, so [`read`](super::read()) accepts those overrides.
pub fn run_script(library: &Library, text: SourceId, overrides: &[Override], d: &mut Diagnostics) -> Option<Value> {
    if crate::formula::shape::is_step_text(library.sources.text(text)) {
        let message = "this is a step, not a graph script";
        let help = "use it in a formula file beside it, or with --steps FOLDER; a graph script returns a graph";
        d.push(Diagnostic::error(message).label(library.sources.span_at(text, 1, 1), "").help(help));
        return None;
    }
    let mut engine = ScriptEngine::new();
    engine.trace(&Arc::new(Arena::default()), &library.sources, text);
    let ast = match engine.compile(&library.sources, text) {
        Ok(ast) => ast,
        Err(diagnostic) => {
            d.push(diagnostic);
            return None;
        }
    };
    let run = Arc::new(Run {
        sources: library.sources.clone(),
        text,
        overrides: overrides.to_vec(),
        places: Places::of(&ast),
        asked: Mutex::default(),
        total: Mutex::default(),
    });
    register(engine.engine_mut(), library, &run);
    let constructors: Vec<&str> = constructors(library).collect();
    let unknown = engine.unknown_names((&library.sources, text), &ast, (WORDS, &constructors), None);
    if !unknown.is_empty() {
        d.extend(unknown);
        return None;
    }
    let result = engine.run(&library.sources, text, &ast, &mut base_scope());
    match result.and_then(|result| run.graph(&result)) {
        Ok(value) => Some(value),
        Err(diagnostic) => {
            d.push(with_form(diagnostic, library));
            None
        }
    }
}

/// Names of all functions that make a node or a part of one.
fn constructors(library: &Library) -> impl Iterator<Item = &str> {
    // A broken step's uses are none of the script's errors.
    KEYWORDS.iter().chain(OTHER_CONSTRUCTORS).copied().chain(library.names()).chain(library.broken())
}

/// Says how a constructor is written that got something else.
fn with_form(mut diagnostic: Diagnostic, library: &Library) -> Diagnostic {
    let name = diagnostic.message.strip_prefix("there is no function `").and_then(|rest| rest.strip_suffix('`'));
    let Some(name) = name.filter(|name| constructors(library).any(|known| known == *name)).map(str::to_string) else {
        return diagnostic;
    };
    diagnostic.message = format!("`{name}` cannot take these arguments");
    diagnostic.help = vec![format!("`{name}` takes at most three parts, a list of parts, or #{{ name: part, ... }}")];
    diagnostic
}

fn register(engine: &mut Engine, library: &Library, run: &Arc<Run>) {
    engine.register_type_with_name::<Made>("graph node");
    for name in constructors(library) {
        register_constructor(engine, name, run);
    }
    // `Orbit` is a node and a test, and made alike.
    let mut words = rhai::Module::new();
    for word in WORDS {
        let value = Value::new(Span::NONE, ValueKind::Variant(Name::new(Span::NONE, *word)));
        words.set_var(
            *word,
            Dynamic::from(Made { value: Arc::new(value), held: Holding { values: 1, ..Holding::default() } }),
        );
    }
    engine.register_global_module(words.into());
    register_params(engine, run);
    register_random(engine);
}

/// Registers a constructor of up to three parts; a single map gives named fields.
fn register_constructor(engine: &mut Engine, name: &str, run: &Arc<Run>) {
    let make = |run: &Arc<Run>| {
        let (run, name) = (run.clone(), name.to_string());
        move |context: &NativeCallContext, args: &[Dynamic]| run.node(&name, context.call_position(), args)
    };
    let f = make(run);
    engine.register_fn(name, move |context: NativeCallContext| f(&context, &[]));
    let f = make(run);
    engine.register_fn(name, move |context: NativeCallContext, a: Dynamic| f(&context, &[a]));
    let f = make(run);
    engine.register_fn(name, move |context: NativeCallContext, a: Dynamic, b: Dynamic| f(&context, &[a, b]));
    let f = make(run);
    engine.register_fn(name, move |context: NativeCallContext, a: Dynamic, b: Dynamic, c: Dynamic| {
        f(&context, &[a, b, c])
    });
}

fn register_params(engine: &mut Engine, run: &Arc<Run>) {
    let of = run.clone();
    engine.register_fn("param", move |context: NativeCallContext, name: &str, default: Dynamic| {
        of.param(context.call_position(), name, &default, &Map::new())
    });
    let of = run.clone();
    engine.register_fn("param", move |context: NativeCallContext, name: &str, default: Dynamic, about: Map| {
        of.param(context.call_position(), name, &default, &about)
    });
}

impl Run {
    fn span(&self, position: Position) -> Span {
        match position.line() {
            Some(line) => self.sources.span_at(self.text, line, position.position().unwrap_or(1)),
            None => Span::NONE,
        }
    }

    /// Place of an argument of a call.
    fn argument(&self, call: Position, i: usize) -> Spot<'_> {
        Spot::Own { place: self.places.argument(call, i), sources: &self.sources, text: self.text }
    }

    fn node(&self, name: &str, position: Position, args: &[Dynamic]) -> Fallible<Made> {
        let span = self.span(position);
        // The node itself is one more level.
        let mut count = Holding { values: 1, nested: 1, depth: 1 };
        let name = Some(Name::new(span, name));
        let kind = match args {
            [only] if only.is_map() => {
                let map = only.read_lock::<Map>().expect("it was just seen to be a map");
                match map.is_empty() {
                    true => ValueKind::Tuple { name, items: Vec::new() },
                    false => ValueKind::Struct { name, fields: fields(&map, &self.argument(position, 0), &mut count)? },
                }
            }
            _ => {
                let parts = args.iter().enumerate();
                let items = parts
                    .map(|(i, arg)| convert(arg, &self.argument(position, i), &mut count))
                    .collect::<Fallible<Vec<Value>>>()?;
                ValueKind::Tuple { name, items }
            }
        };
        let mut total = self.total.lock().unwrap_or_else(PoisonError::into_inner);
        *total += count.values;
        if *total > MAX_TOTAL {
            return Err("the script makes too many nodes".into());
        }
        Ok(Made { value: Arc::new(Value::new(span, kind)), held: Holding { depth: 0, ..count } })
    }

    fn param(&self, position: Position, name: &str, default: &Dynamic, about: &Map) -> Fallible<Dynamic> {
        let number = |value: &Dynamic| value.as_float().ok().or_else(|| value.as_int().ok().map(|i| i as f64));
        let Some(default_number) = number(default) else {
            return Err(format!("the default of the parameter `{name}` must be a number").into());
        };
        let change = self.overrides.iter().find(|change| change.path == name);
        let value = match change.map(|change| &change.value.kind) {
            None => default_number,
            Some(ValueKind::Number(x)) if x.is_finite() => *x,
            Some(_) => return Err(format!("--set {name}: expected a number").into()),
        };
        for (limit, is_low) in [("min", true), ("max", false)] {
            if let Some(bound) = about.get(limit).and_then(number)
                && ((is_low && value < bound) || (!is_low && value > bound))
            {
                let side = if is_low { "at least" } else { "at most" };
                return Err(format!("`{name}` must be {side} {bound}, but is {value}").into());
            }
        }
        let span = self.span(position);
        let mut asked = self.asked.lock().unwrap_or_else(PoisonError::into_inner);
        if !asked.iter().any(|param| param.name == name) {
            let default = (Name::new(span, "default"), Value::new(span, ValueKind::Number(default_number)));
            let mut list = vec![default];
            list.extend(fields(about, &self.argument(position, 2), &mut Holding::default())?);
            asked.push(AskedParam {
                name: name.to_string(),
                description: Value::new(span, ValueKind::Struct { name: None, fields: list }),
            });
        }
        match default.is_int() {
            true if value.fract() != 0.0 => Err(format!("`{name}` must be a whole number, but is {value}").into()),
            true => Ok(Dynamic::from_int(value as INT)),
            false => Ok(Dynamic::from_float(value)),
        }
    }

    /// The graph that the script's value stands for, with the parameters it asked for.
    fn graph(&self, result: &Dynamic) -> Result<Value, Diagnostic> {
        let spot = Spot::Own { place: self.places.result(), sources: &self.sources, text: self.text };
        let end = spot.span();
        let fail = |message: String| {
            let help =
                "the last line, without a semicolon, is what a script returns: a node, or #{ output: node, ... }";
            Diagnostic::error(message).label(end, "the script ends with this").help(help)
        };
        if result.is_unit() {
            return Err(fail("the script must return a graph, but returns nothing".into()));
        }
        let whole = self.sources.span_at(self.text, 1, 1);
        let value = convert(result, &spot, &mut Holding::default()).map_err(|error| match *error {
            EvalAltResult::ErrorRuntime(text, _) => fail(text.to_string()),
            other => fail(other.to_string()),
        })?;
        let mut fields = match value.kind {
            ValueKind::Struct { name: None, fields } => fields,
            ValueKind::Struct { name: Some(_), .. } | ValueKind::Tuple { name: Some(_), .. } => {
                vec![(Name::new(value.span, "output"), value)]
            }
            _ => {
                let found = type_name(result.type_name());
                return Err(fail(format!("the script must return a graph, but returns a {found}")));
            }
        };
        let asked = std::mem::take(&mut *self.asked.lock().unwrap_or_else(PoisonError::into_inner));
        if !asked.is_empty() {
            if !fields.iter().any(|(name, _)| name.text == "params") {
                let none = ValueKind::Struct { name: None, fields: Vec::new() };
                fields.push((Name::new(whole, "params"), Value::new(whole, none)));
            }
            for (name, value) in &mut fields {
                if name.text == "params"
                    && let ValueKind::Struct { fields, .. } = &mut value.kind
                {
                    fields
                        .extend(asked.iter().map(|p| (Name::new(p.description.span, &*p.name), p.description.clone())));
                }
            }
        }
        Ok(Value::new(whole, ValueKind::Struct { name: None, fields }))
    }
}

/// What a value that is being made holds.
#[derive(Clone, Copy, Default)]
struct Holding {
    /// Values in it.
    values: usize,
    /// How deep its parts lie in each other.
    nested: usize,
    /// How deep the part lies that is being read.
    depth: usize,
}

impl Holding {
    fn add(&mut self, values: usize) -> Fallible<()> {
        self.values += values;
        match self.values > MAX_VALUES {
            true => Err(format!("a node holds more than {MAX_VALUES} values").into()),
            false => Ok(()),
        }
    }

    /// Something that lies in the part that is being read, itself so deep.
    fn within(&mut self, nested: usize) -> Fallible<()> {
        self.nested = self.nested.max(self.depth + nested);
        match self.nested > MAX_NESTED {
            true => Err(format!("lists and nodes lie in each other more than {MAX_NESTED} deep").into()),
            false => Ok(()),
        }
    }

    fn enter(&mut self) -> Fallible<()> {
        self.depth += 1;
        self.within(0)
    }
}

fn fields(map: &Map, spot: &Spot, count: &mut Holding) -> Fallible<Vec<(Name, Value)>> {
    let field = |(key, item): (&rhai::Identifier, &Dynamic)| {
        let (name, inner) = spot.field(key.as_str());
        Ok((Name::new(name, key.as_str()), convert(item, &inner, count)?))
    };
    map.iter().map(field).collect()
}

/// The value tree of a script's value; `count` grows by the values in it.
fn convert(value: &Dynamic, spot: &Spot, count: &mut Holding) -> Fallible<Value> {
    count.add(1)?;
    let kind = if let Some(made) = value.read_lock::<Made>() {
        count.add(made.held.values)?;
        count.within(made.held.nested)?;
        let mut value = (*made.value).clone();
        if value.span.is_none() {
            value.span = spot.span();
        }
        return Ok(value);
    } else if let Some(kind) = crate::formula::script::plain_kind(value) {
        kind
    } else if let Some(items) = value.read_lock::<Array>() {
        count.enter()?;
        let item = |(i, item): (usize, &Dynamic)| convert(item, &spot.item(i), count);
        let list = items.iter().enumerate().map(item).collect::<Fallible<_>>()?;
        count.depth -= 1;
        ValueKind::List(list)
    } else if let Some(map) = value.read_lock::<Map>() {
        count.enter()?;
        let fields = fields(&map, spot, count)?;
        count.depth -= 1;
        ValueKind::Struct { name: None, fields }
    } else {
        return Err(format!("a graph cannot hold a {}", type_name(value.type_name())).into());
    };
    Ok(Value::new(spot.span(), kind))
}

/// A source of random numbers.
#[derive(Clone)]
struct Random {
    state: u64,
}

impl Random {
    /// The next 64 bits (SplitMix64, Steele, Lea and Flood 2014).
    fn next(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A number from 0 to below 1, of 53 random bits.
    fn float(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// A whole number from `low` to `high`, both included; `low` where the range is empty.
    fn int(&mut self, low: INT, high: INT) -> INT {
        let span = (high as i128 - low as i128 + 1).max(1) as f64;
        low.saturating_add((self.float() * span) as INT)
    }
}

fn register_random(engine: &mut Engine) {
    engine.register_type_with_name::<Random>("random source");
    engine.register_fn("rand", |seed: INT| Random { state: seed as u64 });
    engine.register_fn("rand", |seed: f64| Random { state: seed as i64 as u64 });
    engine.register_fn("float", Random::float);
    engine.register_fn("int", Random::int);
    let range = |random: &mut Random, low: f64, high: f64| low + (high - low) * random.float();
    engine.register_fn("range", range);
    engine.register_fn("range", move |r: &mut Random, low: INT, high: INT| range(r, low as f64, high as f64));
    engine.register_fn("range", move |r: &mut Random, low: INT, high: f64| range(r, low as f64, high));
    engine.register_fn("range", move |r: &mut Random, low: f64, high: INT| range(r, low, high as f64));
    engine.register_fn("pick", |random: &mut Random, list: Array| -> Fallible<Dynamic> {
        let last = list.len() as INT - 1;
        list.get(random.int(0, last) as usize).cloned().ok_or_else(|| "`pick` needs a list that is not empty".into())
    });
    engine.register_fn("random", |seed: INT, i: INT| {
        Random { state: (seed as u64).wrapping_add((i as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15)) }.float()
    });
}

#[cfg(test)]
mod tests {
    use super::run_script;
    use crate::diag::Diagnostics;
    use crate::formula::library::Library;
    use crate::graph::{NodeKind, ValidGraph, read};

    fn load(text: &str) -> Result<ValidGraph, String> {
        let mut library = Library::builtin();
        let id = library.sources.add("test.rhai", text);
        let mut d = Diagnostics::default();
        let graph = run_script(&library, id, &[], &mut d)
            .and_then(|value| read(&library, &value, "test", (&[], &Default::default()), &mut d));
        graph.ok_or_else(|| d.render(&library.sources, false))
    }

    #[test]
    fn a_script_may_return_just_a_node() {
        let graph = load("Alternate([[box_fold(), 2], bulb_power(#{ power: 3 })])").map_err(|e| println!("{e}"));
        let graph = graph.expect("the script is right");
        assert!(graph.nodes.iter().any(|n| matches!(&n.kind, NodeKind::Alternate(turns) if turns[0].1 == 2)));
    }

    #[test]
    fn mistakes_are_told_where_the_call_is() {
        let cases = [
            ("let a = 1;\nbulb_power(#{ powr: 8 })", "test.rhai:2:1"),
            ("let a = 1;", "must return a graph"),
            ("Sequence([box_fold(), boxfold()])", "test.rhai:1:23"),
            ("fn step(z, c, p) { z }", "not a graph script"),
            ("let x = box_fold(); loop { x = Sequence([x, x]); }", "more than"),
            ("loop { }", "operations"),
            ("box_fold(#{ limit: 0.0 / 0.0 })", "finite"),
            ("box_fold(#{ limit: |x| x })", "cannot hold"),
            ("param(\"a\", \"b\")", "must be a number"),
            ("", "must return a graph"),
        ];
        for (text, expected) in cases {
            let message = load(text).err().unwrap_or_default();
            assert!(message.contains(expected), "{text}: {message}");
        }
    }

    #[test]
    fn random_numbers_are_those_of_splitmix64() {
        // The first output of SplitMix64 from state 0 is 0xe220a8397b1dcdaf.
        let mut random = super::Random { state: 0 };
        assert_eq!(random.next(), 0xe220_a839_7b1d_cdaf);
        assert!((0..1000).all(|_| (2..=4).contains(&random.int(2, 4))));
    }
}
