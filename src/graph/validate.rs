//! Checks what no single node shows: cycles, maps where fields belong, nodes that nothing uses.

use std::collections::HashSet;
use std::ops::Deref;

use super::budget;
use super::{Camera, DeForm, Graph, Node, NodeKind, NodeRef, OrbitSettings, Spread};
use crate::diag::{Diagnostic, Diagnostics};
use crate::formula::library::Library;
use crate::formula::step::{Growth, StateWidth, Step};

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
pub(super) fn validate(library: &Library, mut graph: Graph, d: &mut Diagnostics) -> Option<ValidGraph> {
    let errors = d.error_count();
    if !check_cycles(&graph, MAX_DEPTH, d) {
        return None;
    }
    let output = graph.output;
    graph.output = as_field(&mut graph, output);
    for i in 0..graph.nodes.len() {
        wrap_maps(&mut graph, i);
    }
    // Orbits hold the file's end shape, which may hold them; and what is too large is not walked through.
    if !check_cycles(&graph, 2 * MAX_DEPTH, d) || !budget::check(library, &graph, d) {
        return None;
    }
    for node in &graph.nodes {
        check_kinds(&graph, node, d);
        super::widths::check_node(&graph, node, d);
    }
    super::widths::check_tests(&graph, d);
    check_parts(&graph, d);
    check_traps(&graph, d);
    check_shapes(&graph, graph.output, (3, false), &mut HashSet::new(), d);
    if d.error_count() > errors {
        return None;
    }
    warn_unused(&graph, d);
    warn_nested_stops(&graph, d);
    graph.cut_near();
    Some(ValidGraph(graph))
}

fn check_cycles(graph: &Graph, most: usize, d: &mut Diagnostics) -> bool {
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
                    if depth[node] > most {
                        let message = format!("nodes are nested more than {most} deep");
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
    let has_end = path[start..].iter().any(
        |(node, _)| matches!(&graph.nodes[*node].kind, NodeKind::Orbit { settings, .. } if settings.shape.is_some()),
    );
    d.push(diagnostic.help(match has_end {
        true => {
            "a map where a field belongs becomes an orbit with the file's settings, its `end` too: wire fields there"
        }
        false => "an orbit repeats its map by itself: wire the map to the output, not to itself",
    }));
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
        NodeKind::Transform { of, .. } | NodeKind::Warp { of, .. } | NodeKind::Tile { of, .. } => {
            *of = as_field(graph, *of);
        }
        _ => return,
    }
    graph.nodes[node].kind = kind;
}

/// Maps may only be made of maps.
fn check_kinds(graph: &Graph, node: &Node, d: &mut Diagnostics) {
    let takes_maps = node.kind.is_map() || matches!(node.kind, NodeKind::Orbit { .. });
    if let NodeKind::Warp { by, .. } = &node.kind {
        let target = graph.node(*by);
        if !target.kind.is_map() || graph.embeds(*by) {
            let what = if target.kind.is_map() { "makes four components of three" } else { "is a distance field" };
            let message = format!("`{}` {what} and cannot warp space", target.name);
            d.push(
                Diagnostic::error(message)
                    .label(node.span, "is warped by a step or a sequence of steps")
                    .help("`Warp(of: \"field\", by: \"step\")`; fields of four components start with `pre: [...]`"),
            );
        }
    }
    let shape = match &node.kind {
        NodeKind::Orbit { settings, .. } => settings.shape.map(|shape| shape.field),
        _ => None,
    };
    if takes_maps {
        for wire in node.kind.wires().into_iter().filter(|wire| Some(*wire) != shape) {
            let target = graph.node(wire);
            if !target.kind.is_map() {
                let message =
                    format!("`{}` is a distance field and cannot be a part of `{}`", target.name, node.kind.keyword());
                d.push(
                    Diagnostic::error(message)
                        .label(node.span, "needs maps of the orbit")
                        .label(target.span, "this is a distance field")
                        .help("fields are joined by Union, Intersection, Difference, SmoothUnion, Transform, Warp and Tile"),
                );
            }
        }
    }
    if let NodeKind::Orbit { of, settings } = &node.kind
        && [*of].iter().chain(&settings.post).any(|root| graph.embeds(*root))
    {
        let message = "a step that makes four components of three may only stand before an orbit";
        d.push(Diagnostic::error(message).label(node.span, "iterated here").help("name it in `pre: [...]`"));
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

/// Most iterations of an orbit inside an end shape, where each becomes a part of one expression.
const MOST_UNROLLED: u32 = 16;

/// Orbits inside end shapes are unrolled, and nothing about them is measured.
fn check_unrolled(graph: &Graph, node: &Node, of: NodeRef, settings: &OrbitSettings, d: &mut Diagnostics) {
    if settings.max_iterations > MOST_UNROLLED {
        let message = format!("an orbit inside an end shape may have {MOST_UNROLLED} iterations");
        let found = format!("it has {}", settings.max_iterations);
        d.push(Diagnostic::error(message).label(node.span, found).help("give it `max_iterations: 6`, say"));
    }
    if settings.escape.is_convergence() {
        let message = "an orbit inside an end shape cannot end by convergence";
        d.push(Diagnostic::error(message).label(node.span, "").help("take another escape test"));
    }
    let has_power = graph.any_step(of, |step| step.growth == Some(Growth::Power));
    let logarithmic = settings.estimate.form.map_or(has_power, |form| form == DeForm::Logarithmic);
    if settings.shape.is_some_and(|shape| shape.levels.is_some()) {
        let message = "levels cannot stand inside an end shape";
        d.push(Diagnostic::error(message).label(node.span, "looked up at every level").help("wire their field itself"));
    }
    if settings.shape.is_none() && !logarithmic && settings.estimate.radius.is_none() {
        d.push(
            Diagnostic::error("an orbit inside an end shape needs the radius of its set")
                .label(node.span, "nothing is measured here")
                .help("give it `estimate: (radius: 1.7)`: of a ball around the set, for `form: box` half its side"),
        );
    }
}

/// Nodes that were checked already, each in a state of so many components, and inside an end shape or not.
type Checked = HashSet<(NodeRef, u8, bool)>;

/// Shapes of four components need a state of four, and end shapes must be fields.
fn check_shapes(graph: &Graph, of: NodeRef, (width, in_end): (u8, bool), checked: &mut Checked, d: &mut Diagnostics) {
    if !checked.insert((of, width, in_end)) {
        return;
    }
    let node = graph.node(of);
    match &node.kind {
        NodeKind::Shape { step, .. } if step.state == StateWidth::Four && width != 4 => {
            let message = format!("`{}` is a shape of four components, and the point here has three", step.name);
            d.push(Diagnostic::error(message).label(node.span, "").help(
                "use it as the end of an orbit of four components: `Orbit(of: ..., pre: [\"stereographic\"], end: ...)`",
            ));
        }
        NodeKind::Orbit { of, settings } => {
            if in_end {
                check_unrolled(graph, node, *of, settings, d);
            }
            let Some(shape) = settings.shape else { return };
            let end = graph.node(shape.field);
            if end.kind.is_map() {
                let message = format!("`{}` is a map, and an end shape is a distance field", end.name);
                d.push(
                    Diagnostic::error(message)
                        .label(end.span, "this is a map")
                        .label(node.span, "its end is looked up in a field")
                        .help("fields are shapes such as Box(...), their combinations, and `Orbit(of: \"map\", ...)`"),
                );
            }
            let embeds = graph.state_width(*of, settings);
            check_shapes(graph, shape.field, (embeds, true), checked, d);
        }
        kind if kind.is_map() => {}
        kind => kind.wires().into_iter().for_each(|wire| check_shapes(graph, wire, (width, in_end), checked, d)),
    }
}

/// Parts with colours of their own are fields of the picture, or the maps of its orbits.
fn check_parts(graph: &Graph, d: &mut Diagnostics) {
    let mut shown = Vec::new();
    let mut open = vec![graph.output];
    while let Some(node) = open.pop() {
        if shown.contains(&node) {
            continue;
        }
        shown.push(node);
        match &graph.node(node).kind {
            NodeKind::Orbit { of, .. } => shown.push(*of),
            NodeKind::Warp { of, .. } => open.push(*of),
            kind => open.extend(kind.wires()),
        }
    }
    for part in graph.scene.look.parts.iter().filter(|part| !shown.contains(&part.node)) {
        let mut names: Vec<&str> = shown.iter().map(|node| graph.node(*node).name.as_str()).collect();
        names.retain(|name| !name.contains([' ', '/']));
        names.sort_unstable();
        let message = format!("`{}` is no part of the picture", graph.node(part.node).name);
        let help = format!("parts are fields that the picture is joined from: {}", names.join(", "));
        d.push(Diagnostic::error(message).label(part.span, "it cannot have a look of its own").help(help));
    }
}

/// Traps that are nodes are fields, which orbits of their width can be looked up in.
fn check_traps(graph: &Graph, d: &mut Diagnostics) {
    let mut checked = HashSet::new();
    for node in graph.scene.look.trap_fields() {
        let field = graph.node(node);
        if field.kind.is_map() {
            let message = format!("`{}` is a map, and a trap is a distance field", field.name);
            let help = "fields are shapes such as Box(...), their combinations, and `Orbit(of: \"map\", ...)`";
            d.push(Diagnostic::error(message).label(field.span, "named by `traps`").help(help));
        }
        check_shapes(graph, node, (3, true), &mut checked, d);
    }
}

fn warn_unused(graph: &Graph, d: &mut Diagnostics) {
    let mut used = vec![false; graph.nodes.len()];
    let mut stack = vec![graph.output];
    stack.extend(graph.scene.look.trap_fields());
    while let Some(node) = stack.pop() {
        if !std::mem::replace(&mut used[node.0], true) {
            stack.extend(graph.node(node).kind.wires());
        }
    }
    // Nodes of objects are not the file's own.
    let is_own = |node: &Node| !node.name.contains('/');
    for (node, _) in graph.nodes.iter().zip(used).filter(|(node, used)| !used && is_own(node)) {
        d.push(Diagnostic::warning(format!("nothing uses the node `{}`", node.name)).label(node.span, ""));
    }
}

/// A threshold is one of rays: within a field it would change what is cut and joined.
fn warn_nested_stops(graph: &Graph, d: &mut Diagnostics) {
    let file = graph.orbit.estimate.stop_at;
    for (i, node) in graph.nodes.iter().enumerate().filter(|(i, _)| *i != graph.output.0) {
        let NodeKind::Orbit { settings, .. } = &node.kind else { continue };
        if settings.estimate.stop_at.is_some() && settings.estimate.stop_at != file {
            d.push(
                Diagnostic::warning(format!(
                    "`stop_at` of the orbit `{}` is not used: rays stop, not fields",
                    graph.nodes[i].name
                ))
                .label(node.span, "this orbit is a part of the field")
                .help("write `estimate: (stop_at: ...)` beside `output`"),
            );
        }
    }
}

impl ValidGraph {
    /// The same graph seen from elsewhere; `camera`'s position, target and up direction must not lie on one line.
    #[must_use]
    pub fn with_camera(mut self, camera: Camera) -> ValidGraph {
        self.0.scene.move_camera(camera);
        self.0.cut_near();
        self
    }

    /// The same graph with the view that its file shows: what the lights of a look are fixed to, and nothing where the camera itself is.
    #[must_use]
    pub fn at_home(mut self, home: Option<Camera>) -> ValidGraph {
        self.0.scene.home = home;
        self
    }

    /// The same graph with what its view shows of the numbers that gradients are placed by: for each layer that is used up evenly, in the order of
    /// [`Look::paints`](super::Look::paints), the cuts of [`Spread::Quantile`].
    #[must_use]
    pub fn with_tones(mut self, tones: &[Vec<f64>]) -> ValidGraph {
        let mut tones = tones.iter();
        for layer in self.0.scene.look.layers_mut() {
            if let (Spread::Quantile(cuts), Some(found)) = (&mut layer.spread, tones.next()) {
                cuts.clone_from(found);
            }
        }
        self
    }

    /// The same graph with pictures through a camera: the solid that a plane cuts.
    #[must_use]
    pub fn without_plane(mut self) -> ValidGraph {
        self.0.scene.plane = None;
        self
    }

    /// The same graph without what a calibration put into its file: what a calibration starts from.
    #[must_use]
    pub fn without_calibration(&self) -> ValidGraph {
        self.with_orbit_settings(|settings| {
            let estimate = &mut settings.estimate;
            if estimate.calibrated.take().is_some() {
                (estimate.method, estimate.fudge) = (None, None);
                (estimate.least_step, estimate.most_step, estimate.late_ends) = (None, None, None);
            }
        })
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
}

impl Graph {
    /// True if a map makes a state of four components of three.
    pub fn embeds(&self, root: NodeRef) -> bool {
        self.any_step(root, |step| step.state == StateWidth::Embeds)
    }

    pub(super) fn asks_for_four(&self, root: NodeRef) -> bool {
        self.any_step(root, |step| matches!(step.state, StateWidth::Four | StateWidth::Embeds))
    }

    pub(super) fn any_step(&self, root: NodeRef, holds: impl Fn(&Step) -> bool) -> bool {
        let mut stack = vec![root];
        let mut seen = vec![false; self.nodes.len()];
        while let Some(of) = stack.pop() {
            if std::mem::replace(&mut seen[of.0], true) {
                continue;
            }
            let kind = &self.node(of).kind;
            if matches!(kind, NodeKind::Step { step, .. } if holds(step)) {
                return true;
            }
            stack.extend(kind.wires());
        }
        false
    }
}
