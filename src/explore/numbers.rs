//! The numbers of a formula, where they may lie, and moving some of them.

use super::tree::{self, Keeps, entries_mut, field, field_mut, number, number_of, string_of};
use crate::diag::{Diagnostics, Span};
use crate::engine::Formula;
use crate::formula::library::Library;
use crate::formula::step::{ParamKind, ParamValue, Step};
use crate::formula::value::{Name, Value, ValueKind};
use crate::load::tree as load_tree;
use crate::math::random::Random;

/// Most numbers that a draft moves.
const MOST_MOVED: usize = 4;
/// What a number near 0 moves by at amount 1, in its own unit; and what an angle does, in degrees.
const NEAR_ZERO: f64 = 0.5;
const NEAR_ZERO_ANGLE: f64 = 45.0;
/// Farthest from 0 that a Julia constant goes.
const CONSTANT: f64 = 2.0;

/// A number of a formula that may be moved.
#[derive(Clone, PartialEq, Debug)]
pub struct Number {
    /// Where it stands, as `--set` names it.
    pub path: String,
    /// What it does, with its unit; empty where nothing is said.
    pub help: String,
    /// Least and greatest value.
    pub range: [f64; 2],
    /// Its value.
    pub value: f64,
    /// Whether it is whole.
    pub is_whole: bool,
}

/// The numbers of a formula that may be moved, those of steps that leave them out included: parameters, those of nodes, the Julia constant.
pub fn numbers(formula: &Formula) -> Vec<Number> {
    let (mut library, mut d, mut numbers) = (formula.library().clone(), Diagnostics::default(), Vec::new());
    let Some(mut tree) = load_tree(&mut library, &formula.bundle(), &mut d) else { return numbers };
    complete(&mut tree, &library);
    visit(&mut tree, &library, &mut |site| {
        let Site { path, help, range, value, is_whole, .. } = site;
        numbers.push(Number { path, help, range, value: *value, is_whole });
    });
    numbers
}

/// A number of a formula.
pub(super) struct Site<'v> {
    /// What it is called.
    pub label: String,
    /// Where it stands, as `--set` names it.
    pub path: String,
    /// What it does, with its unit; empty where nothing is said.
    pub help: String,
    /// Least and greatest value.
    pub range: [f64; 2],
    /// Whether it is whole.
    pub is_whole: bool,
    /// What it moves by where it is 0.
    pub near_zero: f64,
    /// Whether it is one of the formula's own parameters.
    pub is_parameter: bool,
    /// Itself.
    pub value: &'v mut f64,
}

/// What was moved.
pub(super) struct Moved {
    /// `scale 2 to 2.31`, a line each.
    pub changes: Vec<String>,
    /// What stays true.
    pub keeps: Keeps,
}

/// Where a part of a formula stands, for people and for `--set`.
#[derive(Clone)]
struct Place {
    label: String,
    path: String,
    help: String,
}

impl Place {
    fn new(name: &str) -> Place {
        Place { label: name.to_string(), path: name.to_string(), help: String::new() }
    }

    /// A part of it.
    fn part(&self, name: &str) -> Place {
        Place {
            label: format!("{}.{name}", self.label),
            path: format!("{}.{name}", self.path),
            help: self.help.clone(),
        }
    }

    /// A part that stands in another one, which people don't name.
    fn inner(&self, name: &str) -> Place {
        Place { path: format!("{}.{name}", self.path), ..self.clone() }
    }

    fn saying(self, help: &str, unit: &str) -> Place {
        let help = if unit.is_empty() { help.to_string() } else { format!("{help}, in {unit}") };
        Place { help, ..self }
    }

    /// A number here, of a node.
    fn site(self, range: [f64; 2], value: &mut f64) -> Site<'_> {
        let Place { label, path, help } = self;
        Site { label, path, help, range, is_whole: false, near_zero: NEAR_ZERO, is_parameter: false, value }
    }
}

/// Visits the numbers that may be varied: parameters, those of nodes, the Julia constant.
pub(super) fn visit(tree: &mut Value, library: &Library, visit: &mut dyn FnMut(Site)) {
    for (name, param) in field_mut(tree, "params").map(entries_mut).unwrap_or_default() {
        let end = |name: &str, default: f64| field(param, name).and_then(number_of).unwrap_or(default);
        let range = [end("min", -1e6), end("max", 1e6)];
        let said = |name: &str| field(param, name).and_then(string_of).unwrap_or_default();
        let place = Place::new(&name).saying(&said("help"), &said("unit"));
        if let Some(Value { kind: ValueKind::Number(value), .. }) = field_mut(param, "default") {
            visit(Site { is_parameter: true, ..place.site(range, value) });
        }
    }
    for (name, node) in field_mut(tree, "nodes").map(entries_mut).unwrap_or_default() {
        of_node(&Place::new(&name), node, library, visit);
    }
    if let Some(constant) = field_mut(tree, "constant") {
        of_constant(&Place::new("constant"), constant, visit);
    }
}

/// A point such as that of `Julia((x, y, z))` or `Mix(julia: (x, y, z), amount: 0.5)`.
fn of_constant(place: &Place, constant: &mut Value, visit: &mut dyn FnMut(Site)) {
    let mut point = |place: &Place, items: &mut [Value]| plain(place, items, ([-CONSTANT, CONSTANT], NEAR_ZERO), visit);
    match &mut constant.kind {
        ValueKind::Tuple { name: Some(_), items } => match items.as_mut_slice() {
            [Value { kind: ValueKind::Tuple { items, .. } | ValueKind::List(items), .. }] => {
                point(&place.inner("0"), items);
            }
            items => point(place, items),
        },
        ValueKind::Struct { .. } => {
            let julia = field_mut(constant, "julia").map(|julia| &mut julia.kind);
            if let Some(ValueKind::Tuple { items, .. } | ValueKind::List(items)) = julia {
                point(&place.inner("julia"), items);
            }
        }
        _ => {}
    }
}

/// The numbers among components.
fn plain(place: &Place, items: &mut [Value], (range, near_zero): ([f64; 2], f64), visit: &mut dyn FnMut(Site)) {
    for (item, axis) in items.iter_mut().zip(["x", "y", "z", "w"]) {
        if let ValueKind::Number(value) = &mut item.kind {
            visit(Site { near_zero, ..place.part(axis).site(range, value) });
        }
    }
}

fn of_node(place: &Place, node: &mut Value, library: &Library, visit: &mut dyn FnMut(Site)) {
    let name = node.name().map(|name| name.text.clone()).unwrap_or_default();
    let step = library.step(&name).cloned();
    match &mut node.kind {
        ValueKind::Struct { fields, .. } => {
            for (field, value) in fields {
                let place = place.part(&field.text);
                match &step {
                    Some(step) => of_param(place, step, &field.text, value, visit),
                    None => of_field(place, (&name, &field.text), value, library, visit),
                }
            }
        }
        ValueKind::Tuple { items, .. } | ValueKind::List(items) => {
            for (i, item) in items.iter_mut().enumerate() {
                let mut place = place.inner(&i.to_string());
                if name.is_empty() {
                    place.label = format!("{}.{}", place.label, i + 1);
                }
                of_node(&place, item, library, visit);
            }
        }
        _ => {}
    }
}

fn of_param(place: Place, step: &Step, name: &str, value: &mut Value, visit: &mut dyn FnMut(Site)) {
    let Some(param) = step.param(name) else { return };
    let range = [param.min, param.max];
    let place = place.saying(&param.help, &param.unit);
    let near_zero = if param.kind == ParamKind::Angle { NEAR_ZERO_ANGLE } else { NEAR_ZERO };
    let is_whole = param.kind == ParamKind::Int;
    match (&mut value.kind, &param.kind) {
        (ValueKind::Number(value), ParamKind::Float | ParamKind::Angle | ParamKind::Int) => {
            visit(Site { is_whole, near_zero, ..place.site(range, value) });
        }
        (ValueKind::List(items) | ValueKind::Tuple { name: None, items }, ParamKind::Vec3 | ParamKind::Point) => {
            plain(&place, items, (range, near_zero), visit);
        }
        _ => {}
    }
}

/// Fields of other nodes that may move, with their ranges where these are not around the number itself.
fn of_field(
    place: Place,
    (node, field): (&str, &str),
    value: &mut Value,
    library: &Library,
    visit: &mut dyn FnMut(Site),
) {
    match (&mut value.kind, field) {
        (ValueKind::Number(x), "weight") => visit(place.site([0.0, 1.0], x)),
        (ValueKind::Number(x), "radius" | "major" | "minor" | "half_height" | "scale") if *x > 0.0 => {
            visit(place.site([*x * 0.2, *x * 5.0], x));
        }
        (ValueKind::Number(x), "angle") => {
            visit(Site { near_zero: NEAR_ZERO_ANGLE, ..place.site([-360.0, 360.0], x) });
        }
        (ValueKind::Tuple { name: None, items } | ValueKind::List(items), "translate") => {
            plain(&place, items, ([-10.0, 10.0], NEAR_ZERO), visit);
        }
        (_, "constant") if node == "Orbit" || node == "Item" => of_constant(&place, value, visit),
        (_, "of" | "a" | "b" | "by" | "then" | "otherwise" | "shape") => of_node(&place, value, library, visit),
        _ => {}
    }
}

/// Writes out the parameters of steps that have their defaults, so that they may be moved.
pub(super) fn complete(tree: &mut Value, library: &Library) {
    let Some(nodes) = field_mut(tree, "nodes") else { return };
    tree::walk(nodes, &mut |node| {
        let Some(step) = node.name().and_then(|name| library.step(&name.text)).cloned() else { return };
        let mut missing = Vec::new();
        for param in step.params.iter().filter(|param| field(node, &param.name).is_none()) {
            let value = match &param.default {
                ParamValue::Number(x) => number(*x),
                ParamValue::Vector(v) => tree::list(v.iter().map(|x| number(*x)).collect()),
                _ => continue,
            };
            missing.push((Name::new(Span::NONE, &*param.name), value));
        }
        let name = node.name().cloned();
        match &mut node.kind {
            _ if missing.is_empty() => {}
            ValueKind::Struct { fields, .. } => fields.extend(missing),
            kind => *kind = ValueKind::Struct { name, fields: missing },
        }
    });
}

/// Moves from one to four numbers.
pub(super) fn move_some(tree: &mut Value, library: &Library, amount: f64, random: &mut Random) -> Moved {
    let mut sites = Vec::new();
    visit(tree, library, &mut |site| sites.push(site.range[0] < site.range[1]));
    let free: Vec<usize> = (0..sites.len()).filter(|i| sites[*i]).collect();
    let mut moved = Moved { changes: Vec::new(), keeps: Keeps::Expressions };
    if free.is_empty() {
        return moved;
    }
    let wanted = (1 + random.below(MOST_MOVED)).min(free.len());
    let mut chosen = Vec::new();
    while chosen.len() < wanted {
        let site = free[random.below(free.len())];
        if !chosen.contains(&site) {
            chosen.push(site);
        }
    }
    let mut at = 0;
    visit(tree, library, &mut |site| {
        if chosen.contains(&at) {
            let new = moved_number(&site, amount, random);
            if new != *site.value {
                moved.changes.push(format!("{} {} to {new}", site.label, rounded(*site.value)));
                *site.value = new;
                if !site.is_parameter {
                    moved.keeps = Keeps::Camera;
                }
            }
        }
        at += 1;
    });
    moved
}

/// Another number within the range of a site.
fn moved_number(site: &Site, amount: f64, random: &mut Random) -> f64 {
    let x = *site.value;
    let [least, most] = site.range;
    // Around 0 and less likely the farther; never next to nothing.
    let d = random.unit() + random.unit() - 1.0;
    let d = if d < 0.0 { d - 0.2 } else { d + 0.2 };
    if site.is_whole {
        let by = (d * (1.0 + amount * 2.0)).round();
        let by = if by == 0.0 { d.signum() } else { by };
        return (x + by).clamp(least.ceil(), most.floor());
    }
    let width = (0.5 * (most - least)).min(x.abs().max(site.near_zero));
    rounded((x + amount * width * d).clamp(least, most)).clamp(least, most)
}

/// The number to four digits.
pub(super) fn rounded(x: f64) -> f64 {
    format!("{x:.3e}").parse().unwrap_or(x)
}
