//! What one iteration does: everything that depends on the iteration number alone is decided here, before any
//! expression is made, so it costs nothing in a kernel.

use super::{Condition, Constant, Graph, NodeKind, NodeRef};

/// Item numbers by iteration: `prefix` first, then `cycle` over and over.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Schedule {
    /// Items of the first iterations.
    pub prefix: Vec<usize>,
    /// Items of all later iterations; never empty.
    pub cycle: Vec<usize>,
}

impl Schedule {
    /// The same item at every iteration.
    pub fn constant(item: usize) -> Schedule {
        Schedule { prefix: Vec::new(), cycle: vec![item] }
    }

    /// The shortest prefix and cycle that repeat a sequence of items.
    pub fn of_sequence(sequence: &[usize]) -> Schedule {
        find_period(sequence)
    }

    /// The item of iteration `n`, counted from 0.
    #[inline]
    pub fn item(&self, n: usize) -> usize {
        match n.checked_sub(self.prefix.len()) {
            None => self.prefix[n],
            Some(later) => self.cycle[later % self.cycle.len()],
        }
    }

    /// Shortens the cycle to its period and drops what the prefix repeats of it.
    pub fn normalized(mut self) -> Schedule {
        let cycle = &self.cycle;
        let period = (1..=cycle.len())
            .find(|&k| cycle.len().is_multiple_of(k) && (0..cycle.len()).all(|i| cycle[i] == cycle[i % k]))
            .unwrap_or(cycle.len());
        self.cycle.truncate(period);
        while self.prefix.last().is_some_and(|last| Some(last) == self.cycle.last()) {
            self.prefix.pop();
            self.cycle.rotate_right(1);
        }
        self
    }
}

/// A map with all choices by iteration number taken.
#[derive(Clone, PartialEq, Debug)]
pub enum MapTree {
    /// Changes nothing.
    Identity,
    /// A step node.
    Step(NodeRef),
    /// One after the other.
    Sequence(Vec<MapTree>),
    /// Several times.
    Repeat(Box<MapTree>, u32),
    /// `(1 - weight)` of the first plus `weight` of the second.
    Blend(Box<MapTree>, Box<MapTree>, f64),
    /// The first where the condition (on the state) holds, else the second.
    Choose(Condition, Box<MapTree>, Box<MapTree>),
}

/// One distinct iteration of a schedule: a map, and the constant added after it.
#[derive(Clone, PartialEq, Debug)]
pub struct IterationMap {
    /// The map.
    pub map: MapTree,
    /// The constant.
    pub constant: Constant,
}

/// Longest period that is looked for in a schedule.
const MAX_PERIOD: usize = 256;

/// The distinct iterations of a map node, and which of them runs when.
pub fn resolve_schedule(
    graph: &Graph,
    root: NodeRef,
    constant: Constant,
    max_iterations: u32,
) -> (Vec<IterationMap>, Schedule) {
    if !depends_on_iteration(graph, root) {
        return (vec![resolve_iteration(graph, root, constant, 0)], Schedule::constant(0));
    }
    let mut items: Vec<IterationMap> = Vec::new();
    let mut sequence = Vec::with_capacity(max_iterations as usize);
    for n in 0..max_iterations.max(1) {
        let item = resolve_iteration(graph, root, constant, n);
        let position = items.iter().position(|known| *known == item).unwrap_or_else(|| {
            items.push(item);
            items.len() - 1
        });
        sequence.push(position);
    }
    (items, find_period(&sequence))
}

/// Whether a map is not the same at every iteration.
pub(super) fn depends_on_iteration(graph: &Graph, root: NodeRef) -> bool {
    let mut open = vec![root];
    let mut seen = vec![false; graph.nodes.len()];
    while let Some(node) = open.pop() {
        if std::mem::replace(&mut seen[node.0], true) {
            continue;
        }
        let kind = &graph.node(node).kind;
        match kind {
            NodeKind::Between { .. } | NodeKind::Alternate(_) => return true,
            NodeKind::Choose { when, .. } if when.by_iteration(0).is_some() => return true,
            _ => open.extend(kind.wires()),
        }
    }
    false
}

/// The shortest prefix and cycle that repeat a sequence.
fn find_period(sequence: &[usize]) -> Schedule {
    let best = (1..=sequence.len().min(MAX_PERIOD))
        .map(|period| {
            let matching = |i: &usize| *i + period >= sequence.len() || sequence[*i] == sequence[*i + period];
            let prefix = (0..sequence.len()).rev().find(|i| !matching(i)).map_or(0, |i| i + 1);
            (prefix + period, prefix, period)
        })
        .filter(|(_, prefix, period)| prefix + period <= sequence.len())
        .min();
    let (_, prefix, period) = best.unwrap_or((0, 0, sequence.len()));
    Schedule { prefix: sequence[..prefix].to_vec(), cycle: sequence[prefix..prefix + period].to_vec() }.normalized()
}

fn resolve_iteration(graph: &Graph, root: NodeRef, constant: Constant, n: u32) -> IterationMap {
    match &graph.node(root).kind {
        NodeKind::Item { of, constant } => resolve_iteration(graph, *of, *constant, n),
        NodeKind::Between { of, from, to, otherwise } => match (*from..*to).contains(&n) {
            true => resolve_iteration(graph, *of, constant, n),
            false => otherwise.map_or(IterationMap { map: MapTree::Identity, constant }, |other| {
                resolve_iteration(graph, other, constant, n)
            }),
        },
        NodeKind::Choose { when, then, otherwise } if when.by_iteration(n).is_some() => {
            match (when.by_iteration(n), otherwise) {
                (Some(true), _) => resolve_iteration(graph, *then, constant, n),
                (_, Some(other)) => resolve_iteration(graph, *other, constant, n),
                (_, None) => IterationMap { map: MapTree::Identity, constant },
            }
        }
        NodeKind::Alternate(parts) => resolve_iteration(graph, turn(parts, n), constant, n),
        _ => IterationMap { map: resolve_map(graph, root, n), constant },
    }
}

/// Whose turn it is at iteration `n`.
fn turn(parts: &[(NodeRef, u32)], n: u32) -> NodeRef {
    let total: u32 = parts.iter().map(|(_, count)| count).sum();
    let mut position = n % total.max(1);
    for (of, count) in parts {
        if position < *count {
            return *of;
        }
        position -= count;
    }
    parts[0].0
}

fn resolve_map(graph: &Graph, node: NodeRef, n: u32) -> MapTree {
    let or_identity = |other: Option<NodeRef>| other.map_or(MapTree::Identity, |o| resolve_map(graph, o, n));
    match &graph.node(node).kind {
        NodeKind::Step { .. } => MapTree::Step(node),
        NodeKind::Sequence(of) => {
            let parts: Vec<MapTree> =
                of.iter().map(|part| resolve_map(graph, *part, n)).filter(|m| *m != MapTree::Identity).collect();
            MapTree::Sequence(parts)
        }
        NodeKind::Repeat { of, times } => MapTree::Repeat(Box::new(resolve_map(graph, *of, n)), *times),
        NodeKind::Blend { a, b, weight } => {
            MapTree::Blend(Box::new(or_identity(*a)), Box::new(resolve_map(graph, *b, n)), *weight)
        }
        NodeKind::Choose { when, then, otherwise } => match when.by_iteration(n) {
            Some(true) => resolve_map(graph, *then, n),
            Some(false) => or_identity(*otherwise),
            None => MapTree::Choose(*when, Box::new(resolve_map(graph, *then, n)), Box::new(or_identity(*otherwise))),
        },
        NodeKind::Between { of, from, to, otherwise } => match (*from..*to).contains(&n) {
            true => resolve_map(graph, *of, n),
            false => or_identity(*otherwise),
        },
        NodeKind::Alternate(parts) => resolve_map(graph, turn(parts, n), n),
        NodeKind::Item { of, .. } => resolve_map(graph, *of, n),
        _ => MapTree::Identity, // fields are refused by `validate`
    }
}

impl Condition {
    /// The condition's value where the iteration number alone decides it.
    pub fn by_iteration(self, n: u32) -> Option<bool> {
        match self {
            Condition::IterationBelow(limit) => Some(n < limit),
            Condition::IterationEvery(period) => Some(n.is_multiple_of(period.max(1))),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Schedule, find_period};

    #[test]
    fn periods_are_found_behind_a_prefix() {
        assert_eq!(find_period(&[0, 0, 1, 0, 0, 1, 0]), Schedule { prefix: vec![], cycle: vec![0, 0, 1] });
        assert_eq!(find_period(&[2, 2, 0, 1, 0, 1, 0]), Schedule { prefix: vec![2, 2], cycle: vec![0, 1] });
        assert_eq!(find_period(&[3]), Schedule::constant(3));
    }

    #[test]
    fn normalizing_keeps_every_item() {
        let long = Schedule { prefix: vec![2, 0, 1], cycle: vec![0, 1, 0, 1] };
        let short = long.clone().normalized();
        assert_eq!(short, Schedule { prefix: vec![2], cycle: vec![0, 1] });
        assert!((0..20).all(|n| long.item(n) == short.item(n)));
    }
}
