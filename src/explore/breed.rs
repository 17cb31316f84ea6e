//! Drafts of two formulas.

use std::collections::BTreeMap;

use super::numbers::{self, rounded};
use super::structure::{between, free_name};
use super::tree::{
    self, Keeps, entries_mut, field, field_mut, fields_of, list, number, number_of, set, string, string_of, tuple,
    value,
};
use super::{Draft, Parent, random_of};
use crate::engine::Error;
use crate::formula::library::Library;
use crate::formula::value::{Value, ValueKind};
use crate::math::random::Random;

/// Draws a draft of two parents: of the same formula one whose numbers lie between theirs, of two formulas one that iterates both.
/// Always the same one of a seed and number.
///
/// Errors: [`Error::Request`] where the output of one has no name.
pub fn breed(a: &Parent, b: &Parent, seed: u64, number: u64) -> Result<Draft, Error> {
    let mut random = random_of(seed, number);
    let (mut first, mut second) = (a.tree.clone(), b.tree.clone());
    numbers::complete(&mut first, &a.library);
    numbers::complete(&mut second, &b.library);
    let is_same = skeleton(&first, &a.library) == skeleton(&second, &b.library);
    let changes = match is_same {
        true => mix(&mut first, &mut second, a, &mut random),
        false => join(&mut first, &mut second, (a, b), &mut random)?,
    };
    if random.below(2) == 1
        && let Some(look) = field(&second, "look")
    {
        set(&mut first, "look", look.clone());
    }
    tree::forget(&mut first, if is_same { Keeps::Camera } else { Keeps::Nothing });
    tree::remove(&mut first, &["inventor", "year", "source"]);
    tree::set_text(&mut first, "summary", format!("A child of {} and {}.", a.name, b.name));
    let head = vec![format!("A child of {} and {} (seed {seed}, draft {number}).", a.name, b.name)];
    Ok(Draft { tree: first, changes, head })
}

/// The nodes of a formula without their numbers.
fn skeleton(tree: &Value, library: &Library) -> String {
    let (mut tree, mut labels) = (tree.clone(), String::new());
    numbers::visit(&mut tree, library, &mut |site| {
        labels += &site.label;
        *site.value = 0.0;
    });
    let shown = |name: &str| field(&tree, name).map(|value| value.kind.to_string()).unwrap_or_default();
    [labels, shown("nodes"), shown("output")].join("\n")
}

/// Numbers between those of both, each by itself.
fn mix(first: &mut Value, second: &mut Value, a: &Parent, random: &mut Random) -> Vec<String> {
    let mut others = Vec::new();
    numbers::visit(second, &a.library, &mut |site| others.push(*site.value));
    let (mut others, mut changes) = (others.into_iter(), Vec::new());
    numbers::visit(first, &a.library, &mut |site| {
        let (own, other) = (*site.value, others.next().unwrap_or(*site.value));
        let share = random.unit();
        if own == other {
            return;
        }
        *site.value = match site.is_whole {
            true if share < 0.5 => own,
            true => other,
            false => rounded(own + (other - own) * share).clamp(own.min(other), own.max(other)),
        };
        changes.push(format!("{} {}, of {own} and {other}", site.label, site.value));
    });
    changes
}

/// The nodes of both, and a map that iterates both.
fn join(
    first: &mut Value,
    second: &mut Value,
    (a, b): (&Parent, &Parent),
    random: &mut Random,
) -> Result<Vec<String>, Error> {
    let output = |tree: &Value, parent: &Parent| {
        field(tree, "output").and_then(string_of).ok_or_else(|| {
            let text = format!("the output of `{}` has no name, so it cannot be joined", parent.name);
            Error::request(text, "name a node in its `output`, or take another formula")
        })
    };
    let own = output(first, a)?;
    output(second, b)?;
    rename(first, second);
    let other = output(second, b)?;
    let sequences = [items(first, &own), items(second, &other)];
    for table in ["params", "nodes"] {
        for (name, value) in field_mut(second, table).map(entries_mut).unwrap_or_default() {
            if field(first, table).is_none() {
                set(first, table, tree::value(ValueKind::Map(Vec::new())));
            }
            if let Some(own) = field_mut(first, table) {
                set(own, &name, value.clone());
            }
        }
    }
    let (node, said) = joined((&own, &other), sequences, random);
    if let Some(nodes) = field_mut(first, "nodes") {
        let name = free_name(nodes, "child");
        set(nodes, &name, node);
        set(first, "output", string(name));
    }
    let mut changes = vec![said];
    changes.extend(settings(first, second, b, random));
    Ok(changes)
}

/// The node that iterates both outputs, and what it does in words.
fn joined((own, other): (&str, &str), sequences: [Vec<Value>; 2], random: &mut Random) -> (Value, String) {
    let turn = |name: &str, count: usize| {
        value(ValueKind::Tuple { name: None, items: vec![string(name), number(count as f64)] })
    };
    match random.below(4) {
        0 => {
            let [m, n] = [1 + random.below(3), 1 + random.below(3)];
            let node = tuple("Alternate", vec![list(vec![turn(own, m), turn(other, n)])]);
            (node, format!("{m} of {own}, then {n} of {other}"))
        }
        1 => {
            let mut queues = sequences.map(Vec::into_iter);
            let (mut all, mut at) = (Vec::new(), random.below(2));
            while queues.iter().any(|queue| queue.len() > 0) {
                all.extend(queues[at].next());
                at = 1 - at;
            }
            (tuple("Sequence", vec![list(all)]), format!("the steps of {own} and {other} alternately"))
        }
        2 => {
            let to = 1 + random.below(4);
            (between(string(own), string(other), to), format!("{own} for {to} iterations, then {other}"))
        }
        _ => {
            let weight = rounded(random.range(0.15, 0.85));
            let fields = vec![("a", string(own)), ("b", string(other)), ("weight", number(weight))];
            (fields_of("Blend", fields), format!("{own} blended with {weight} of {other}"))
        }
    }
}

/// The parts of an output that is a sequence, else itself.
fn items(tree: &Value, output: &str) -> Vec<Value> {
    let node = field(tree, "nodes").and_then(|nodes| field(nodes, output));
    match node.map(|node| (&node.kind, node.name().map(|name| name.text.as_str()))) {
        Some((ValueKind::Tuple { items, .. }, Some("Sequence"))) => match items.as_slice() {
            [Value { kind: ValueKind::List(items), .. }] => items.clone(),
            _ => vec![string(output)],
        },
        _ => vec![string(output)],
    }
}

/// How the child iterates: some of it as one parent does, some as the other; orbits leave where the wider one lets them.
fn settings(first: &mut Value, second: &Value, b: &Parent, random: &mut Random) -> Vec<String> {
    let mut changes = Vec::new();
    for name in ["constant", "max_iterations"] {
        if random.below(2) == 0 {
            continue;
        }
        match field(second, name) {
            Some(value) => set(first, name, value.clone()),
            None => {
                tree::remove(first, &[name]);
            }
        }
        changes.push(format!("{name} as in {}", b.name));
    }
    let radius = |tree: &Value| field(tree, "escape_radius").and_then(number_of);
    if let (Some(own), Some(other)) = (radius(first), radius(second)) {
        set(first, "escape_radius", number(own.max(other)));
    }
    changes
}

/// Gives names of the second tree that the first one has too another one.
fn rename(first: &mut Value, second: &mut Value) {
    let names = |tree: &mut Value| -> Vec<String> {
        let of = |tree: &mut Value, table: &str| -> Vec<String> {
            field_mut(tree, table).map(entries_mut).unwrap_or_default().into_iter().map(|(name, _)| name).collect()
        };
        [of(tree, "nodes"), of(tree, "params")].concat()
    };
    let (taken, own) = (names(first), names(second));
    let is_taken = |name: &String| taken.contains(name) || own.contains(name);
    let new = |name: &String| {
        let numbered = (2..).map(|i| format!("{name}{i}"));
        (name.clone(), numbered.into_iter().find(|name| !is_taken(name)).unwrap_or_default())
    };
    let new: BTreeMap<String, String> = own.iter().filter(|name| taken.contains(name)).map(new).collect();
    for table in ["nodes", "params"] {
        let Some(table) = field_mut(second, table) else { continue };
        match &mut table.kind {
            ValueKind::Map(items) => items.iter_mut().for_each(|(key, _)| *key = renamed(key, &new)),
            ValueKind::Struct { fields, .. } => fields.iter_mut().for_each(|(name, _)| {
                if let Some(new) = new.get(&name.text) {
                    name.text.clone_from(new);
                }
            }),
            _ => {}
        }
    }
    // Wires and expressions name nodes and parameters in texts; descriptions stay as they are.
    for part in ["nodes", "output", "max_iterations", "constant", "pre", "post"] {
        if let Some(part) = field_mut(second, part) {
            tree::walk(part, &mut |value| *value = renamed(value, &new));
        }
    }
}

/// A text with other names in it; any other value as it is.
fn renamed(value: &Value, new: &BTreeMap<String, String>) -> Value {
    let ValueKind::Str(text) = &value.kind else { return value.clone() };
    let (mut made, mut word) = (String::new(), String::new());
    let end = |word: &mut String, made: &mut String| {
        made.push_str(new.get(word.as_str()).unwrap_or(word));
        word.clear();
    };
    for c in text.chars() {
        if c.is_alphanumeric() || c == '_' {
            word.push(c);
            continue;
        }
        end(&mut word, &mut made);
        made.push(c);
    }
    end(&mut word, &mut made);
    Value::new(value.span, ValueKind::Str(made))
}
