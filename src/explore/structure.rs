//! Drafts with other steps, or with the same ones in another order.

use super::numbers::rounded;
use super::tree::{entries_mut, field, field_mut, fields_of, list, number, set, string, string_of, tuple, value, walk};
use crate::diag::Span;
use crate::formula::library::Library;
use crate::formula::step::{Growth, StateWidth, Step};
use crate::formula::value::{Name, Value, ValueKind};
use crate::math::random::Random;

/// Changes a graph, and says how; nothing where it cannot.
type Change = fn(&mut Value, &Library, &mut Random) -> Option<String>;

/// Kinds of change, in the order in which they are tried from a random one on.
const KINDS: [Change; 6] = [exchange, insert, swap, remove, hybrid, constant];
/// Tries of a draft until a change applies.
const TRIES: usize = 8;

/// Changes a tree; says how. Nothing where no change applies.
pub(super) fn change(tree: &mut Value, library: &Library, random: &mut Random) -> Option<String> {
    (0..TRIES).find_map(|_| KINDS[random.below(KINDS.len())](tree, library, random))
}

/// How a step grows: what may stand for it grows alike.
fn kind_of(step: &Step) -> Option<Growth> {
    step.growth
}

/// A step of the library of this growth that acts on as many components. Shapes and steps that remember are none.
fn any_step(library: &Library, growth: Option<Growth>, state: StateWidth, random: &mut Random) -> Option<String> {
    let fits = |step: &Step| {
        let is_as_wide = step.state == StateWidth::Any || step.state == state;
        let is_wide = state == StateWidth::Any && step.state == StateWidth::Three;
        !step.is_shape() && !step.remembers() && kind_of(step) == growth && (is_as_wide || is_wide)
    };
    let names: Vec<&str> = library.steps().filter(|step| fits(step)).map(|step| step.name.as_str()).collect();
    (!names.is_empty()).then(|| names[random.below(names.len())].to_string())
}

/// Visits the nodes that are steps and maps.
fn steps(tree: &mut Value, library: &Library, visit: &mut dyn FnMut(&mut Value, &Step)) {
    let Some(nodes) = field_mut(tree, "nodes") else { return };
    walk(nodes, &mut |node| {
        let step = node.name().and_then(|name| library.step(&name.text)).cloned();
        if let Some(step) = step.filter(|step| !step.is_shape()) {
            visit(node, &step);
        }
    });
}

/// Does something to one of the steps, any of them.
fn with_step<T>(
    tree: &mut Value,
    library: &Library,
    random: &mut Random,
    act: impl FnOnce(&mut Value, &Step, &mut Random) -> Option<T>,
) -> Option<T> {
    let mut count = 0;
    steps(tree, library, &mut |_, _| count += 1);
    let (chosen, mut at, mut act, mut done) = (random.below(count), 0, Some(act), None);
    steps(tree, library, &mut |node, step| {
        if at == chosen
            && let Some(act) = act.take()
        {
            done = act(node, step, random);
        }
        at += 1;
    });
    done
}

/// A step for another one.
fn exchange(tree: &mut Value, library: &Library, random: &mut Random) -> Option<String> {
    with_step(tree, library, random, |node, step, random| {
        let new = any_step(library, kind_of(step), step.state, random).filter(|new| *new != step.name)?;
        *node = tuple(&new, Vec::new());
        Some(format!("{} for {}", new, step.name))
    })
}

/// A step that does not grow, before or behind another one.
fn insert(tree: &mut Value, library: &Library, random: &mut Random) -> Option<String> {
    with_step(tree, library, random, |node, step, random| {
        let new = any_step(library, None, step.state, random)?;
        let is_before = random.below(2) == 0;
        let (old, made) = (node.clone(), tuple(&new, Vec::new()));
        let both = if is_before { vec![made, old] } else { vec![old, made] };
        *node = tuple("Sequence", vec![list(both)]);
        Some(format!("{new} {} {}", if is_before { "before" } else { "behind" }, step.name))
    })
}

/// Does something to one of the sequences of two steps or more.
fn with_sequence(
    tree: &mut Value,
    random: &mut Random,
    act: impl FnOnce(&mut Vec<Value>, &mut Random) -> Option<String>,
) -> Option<String> {
    fn items(node: &mut Value) -> Option<&mut Vec<Value>> {
        let ValueKind::Tuple { name: Some(name), items } = &mut node.kind else { return None };
        match items.as_mut_slice() {
            [Value { kind: ValueKind::List(items), .. }] if name.text == "Sequence" && items.len() > 1 => Some(items),
            _ => None,
        }
    }
    let nodes = field_mut(tree, "nodes")?;
    let mut count = 0;
    walk(nodes, &mut |node| count += usize::from(items(node).is_some()));
    let (chosen, mut at, mut act, mut done) = (random.below(count), 0, Some(act), None);
    walk(nodes, &mut |node| {
        let Some(items) = items(node) else { return };
        if at == chosen
            && let Some(act) = act.take()
        {
            done = act(items, random);
        }
        at += 1;
    });
    done
}

/// What a node is called in a line of changes.
fn shown(node: &Value) -> String {
    string_of(node).or_else(|| node.name().map(|name| name.text.clone())).unwrap_or_else(|| "a node".into())
}

/// Two neighbours of a sequence in the other order.
fn swap(tree: &mut Value, _: &Library, random: &mut Random) -> Option<String> {
    with_sequence(tree, random, |items, random| {
        let first = random.below(items.len() - 1);
        items.swap(first, first + 1);
        Some(format!("{} before {}", shown(&items[first]), shown(&items[first + 1])))
    })
}

/// A sequence without one of its steps.
fn remove(tree: &mut Value, _: &Library, random: &mut Random) -> Option<String> {
    with_sequence(tree, random, |items, random| {
        let gone = items.remove(random.below(items.len()));
        Some(format!("without {}", shown(&gone)))
    })
}

/// Iterations of another map between those of the formula.
fn hybrid(tree: &mut Value, library: &Library, random: &mut Random) -> Option<String> {
    let output = field(tree, "output").and_then(string_of)?;
    let mut state = None;
    steps(tree, library, &mut |_, step| {
        state.get_or_insert(step.state);
    });
    let growth = if random.below(2) == 0 { Growth::Power } else { Growth::Linear };
    let new = any_step(library, Some(growth), state?, random)?;
    let turns = 1 + random.below(3);
    let turn = value(ValueKind::Tuple { name: None, items: vec![string(output), number(turns as f64)] });
    let nodes = field_mut(tree, "nodes")?;
    let name = free_name(nodes, "hybrid");
    set(nodes, &name, tuple("Alternate", vec![list(vec![turn, tuple(&new, Vec::new())])]));
    set(tree, "output", string(name));
    Some(format!("{new} after every {turns} iterations"))
}

/// A name that no node has.
pub(super) fn free_name(nodes: &mut Value, wanted: &str) -> String {
    let taken: Vec<String> = entries_mut(nodes).into_iter().map(|(name, _)| name).collect();
    let numbered = (2..).map(|i| format!("{wanted}{i}"));
    std::iter::once(wanted.to_string()).chain(numbered).find(|name| !taken.contains(name)).unwrap_or_default()
}

/// A Julia set for a Mandelbrot set, or the other way round.
fn constant(tree: &mut Value, _: &Library, random: &mut Random) -> Option<String> {
    let is_julia = match field(tree, "constant") {
        None => false,
        Some(constant) => match constant.name().map(|name| name.text.as_str()) {
            Some("Mandelbrot") => false,
            Some("Julia") => true,
            _ => return None,
        },
    };
    if is_julia {
        let name = Name::new(Span::NONE, "Mandelbrot");
        set(tree, "constant", value(ValueKind::Variant(name)));
        return Some("the constant is the point".into());
    }
    let point: Vec<f64> = (0..3).map(|_| rounded(random.range(-1.2, 1.2))).collect();
    let text = point.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
    let items = point.into_iter().map(number).collect();
    set(tree, "constant", tuple("Julia", vec![value(ValueKind::Tuple { name: None, items })]));
    Some(format!("the constant is ({text})"))
}

/// `Between(of: a, from: 0, to: n, otherwise: b)`.
pub(super) fn between(a: Value, b: Value, to: usize) -> Value {
    fields_of("Between", vec![("of", a), ("from", number(0.0)), ("to", number(to as f64)), ("otherwise", b)])
}
