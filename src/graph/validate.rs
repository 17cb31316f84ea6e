//! Checks what no single node shows: cycles, maps where fields belong, nodes that nothing uses.

use std::ops::Deref;

use super::{Camera, Graph, Node, NodeKind, NodeRef, OrbitSettings};
use crate::diag::{Diagnostic, Diagnostics};
use crate::formula::step::StateWidth;

/// A graph that `validate` has passed: no cycles, the right kind of node on every wire. Its output is a field.
#[derive(Clone)]
pub struct ValidGraph(Graph);

impl Deref for ValidGraph {
    type Target = Graph;

    fn deref(&self) -> &Graph {
        &self.0
    }
}

/// Longest chain of wires.
const MAX_DEPTH: usize = 64;

/// Checks a graph, and makes maps that stand where a field belongs into orbits.
pub(super) fn validate(mut graph: Graph, d: &mut Diagnostics) -> Option<ValidGraph> {
    let errors = d.error_count();
    if !check_cycles(&graph, d) {
        return None;
    }
    let output = graph.output;
    graph.output = as_field(&mut graph, output);
    for i in 0..graph.nodes.len() {
        wrap_maps(&mut graph, i);
    }
    for node in &graph.nodes {
        check_kinds(&graph, node, d);
    }
    if d.error_count() > errors {
        return None;
    }
    warn_unused(&graph, d);
    Some(ValidGraph(graph))
}

fn check_cycles(graph: &Graph, d: &mut Diagnostics) -> bool {
    // 0: not visited, 1: on the path, 2: done, with the depth below it.
    let mut state = vec![0u8; graph.nodes.len()];
    let mut depth = vec![0usize; graph.nodes.len()];
    for start in 0..graph.nodes.len() {
        let mut path = vec![(start, 0)];
        while let Some((node, next)) = path.pop() {
            let wires = graph.nodes[node].kind.wires();
            state[node] = 1;
            match wires.get(next) {
                Some(wire) => {
                    path.push((node, next + 1));
                    if state[wire.0] == 1 {
                        report_cycle(graph, &path, wire.0, d);
                        return false;
                    }
                    if state[wire.0] == 0 {
                        path.push((wire.0, 0));
                    }
                }
                None => {
                    state[node] = 2;
                    depth[node] = wires.iter().map(|w| depth[w.0] + 1).max().unwrap_or(0);
                    if depth[node] > MAX_DEPTH {
                        let message = format!("nodes are nested more than {MAX_DEPTH} deep");
                        d.push(Diagnostic::error(message).label(graph.nodes[node].span, ""));
                        return false;
                    }
                }
            }
        }
    }
    true
}

fn report_cycle(graph: &Graph, path: &[(usize, usize)], back_to: usize, d: &mut Diagnostics) {
    let start = path.iter().position(|(node, _)| *node == back_to).unwrap_or(0);
    let names: Vec<&str> = path[start..]
        .iter()
        .map(|(node, _)| graph.nodes[*node].name.as_str())
        .chain([graph.nodes[back_to].name.as_str()])
        .collect();
    let mut diagnostic = Diagnostic::error(format!("the wires form a cycle: {}", names.join(" -> ")));
    for (node, _) in &path[start..] {
        diagnostic = diagnostic.label(graph.nodes[*node].span, "on the cycle");
    }
    d.push(diagnostic.help("an orbit repeats its map by itself: wire the map to the output, not to itself"));
}

/// A map becomes the orbit that iterates it, with the file's settings; a field stays.
fn as_field(graph: &mut Graph, of: NodeRef) -> NodeRef {
    let node = graph.node(of).clone();
    if !node.kind.is_map() {
        return of;
    }
    let kind = NodeKind::Orbit { of, settings: Box::new(graph.orbit.clone()) };
    graph.nodes.push(Node { name: format!("orbit of {}", node.name), span: node.span, kind });
    NodeRef(graph.nodes.len() - 1)
}

fn wrap_maps(graph: &mut Graph, node: usize) {
    let mut kind = graph.nodes[node].kind.clone();
    match &mut kind {
        NodeKind::Union(of) | NodeKind::Intersection(of) | NodeKind::SmoothUnion { of, .. } => {
            for wire in of {
                *wire = as_field(graph, *wire);
            }
        }
        NodeKind::Difference { a, b } => {
            *a = as_field(graph, *a);
            *b = as_field(graph, *b);
        }
        NodeKind::Transform { of, .. } => *of = as_field(graph, *of),
        _ => return,
    }
    graph.nodes[node].kind = kind;
}

/// Maps may only be made of maps.
fn check_kinds(graph: &Graph, node: &Node, d: &mut Diagnostics) {
    let takes_maps = node.kind.is_map() || matches!(node.kind, NodeKind::Orbit { .. });
    if takes_maps {
        for wire in node.kind.wires() {
            let target = graph.node(wire);
            if !target.kind.is_map() {
                let message =
                    format!("`{}` is a distance field and cannot be a part of `{}`", target.name, node.kind.keyword());
                d.push(
                    Diagnostic::error(message)
                        .label(node.span, "needs maps of the orbit")
                        .label(target.span, "this is a distance field")
                        .help("fields are joined by Union, Intersection, Difference, SmoothUnion and Transform"),
                );
            }
        }
    }
    let iteration_only = |wire: &NodeRef| matches!(graph.node(*wire).kind, NodeKind::Item { .. });
    let holds_iterations = matches!(
        node.kind,
        NodeKind::Alternate(_) | NodeKind::Between { .. } | NodeKind::Choose { .. } | NodeKind::Orbit { .. }
    );
    if !holds_iterations && let Some(item) = node.kind.wires().iter().find(|w| iteration_only(w)) {
        let message = format!("`{}` cannot stand inside `{}`", graph.node(*item).name, node.kind.keyword());
        let help = "an Item is a whole iteration: use it in Alternate, Between, Choose by iteration, or as the output";
        d.push(Diagnostic::error(message).label(graph.node(*item).span, "").help(help));
    }
}

fn warn_unused(graph: &Graph, d: &mut Diagnostics) {
    let mut used = vec![false; graph.nodes.len()];
    let mut stack = vec![graph.output];
    while let Some(node) = stack.pop() {
        if !std::mem::replace(&mut used[node.0], true) {
            stack.extend(graph.node(node).kind.wires());
        }
    }
    for (node, _) in graph.nodes.iter().zip(used).filter(|(_, used)| !used) {
        d.push(Diagnostic::warning(format!("nothing uses the node `{}`", node.name)).label(node.span, ""));
    }
}

impl ValidGraph {
    /// The same graph seen from elsewhere; `camera`'s position, target and up direction must not lie on one line.
    #[must_use]
    pub fn with_camera(mut self, camera: Camera) -> ValidGraph {
        self.0.camera = Some(camera);
        self
    }

    /// The same graph with other settings of its orbits, for example to follow them past their escape. Wires in the
    /// settings (`pre`, `post`) must stay those of the graph.
    pub fn with_orbit_settings(&self, mut change: impl FnMut(&mut OrbitSettings)) -> ValidGraph {
        let mut graph = self.0.clone();
        for node in &mut graph.nodes {
            if let NodeKind::Orbit { settings, .. } = &mut node.kind {
                change(settings);
            }
        }
        ValidGraph(graph)
    }

    /// Components of the orbit state of a map: 4 if any of its steps asks for four.
    pub fn state_width(&self, root: NodeRef) -> u8 {
        let mut stack = vec![root];
        let mut seen = vec![false; self.nodes.len()];
        while let Some(of) = stack.pop() {
            if std::mem::replace(&mut seen[of.0], true) {
                continue;
            }
            let kind = &self.node(of).kind;
            if matches!(kind, NodeKind::Step { step, .. } if step.state == StateWidth::Four) {
                return 4;
            }
            stack.extend(kind.wires());
        }
        3
    }
}
