//! Checks values of four components, which need an orbit of four, and orbits whose start does not move.

use super::{Constant, Graph, Node, NodeKind, NodeRef, OrbitSettings, ParamInput, resolve_schedule};
use crate::diag::{Diagnostic, Diagnostics, Span};
use crate::formula::step::{ParamValue, StateWidth, Step};

/// What a user may do about a value of four components.
const HELP: &str = "leave out the fourth number, or take a step of four components such as `quaternion_square`";

impl Graph {
    /// Components of the state of an orbit: 4 if any of its steps asks for four, a first map makes four of three, or a value of four
    /// components is given and the steps take them.
    pub fn state_width(&self, root: NodeRef, settings: &OrbitSettings) -> u8 {
        let maps = || [root].into_iter().chain(settings.pre.iter().copied());
        let given = || {
            let start = settings.start.is_some_and(|start| start[3] != 0.0);
            settings.four.is_some() || settings.slice != 0.0 || start || maps().any(|map| four_in(self, map).is_some())
        };
        let asks = maps().any(|map| self.asks_for_four(map));
        if asks || (self.takes_four(root) && given()) { 4 } else { 3 }
    }

    /// Whether a map can act on four components though none of its steps asks for them: one acts on as many as there are, and
    /// those that act on three neither scale nor raise them.
    fn takes_four(&self, root: NodeRef) -> bool {
        let is_narrow = |step: &Step| step.state == StateWidth::Three && step.growth.is_some();
        self.any_step(root, |step| step.state == StateWidth::Any) && !self.any_step(root, is_narrow)
    }
}

/// Checks a node's settings against the width of the state.
pub(super) fn check_node(graph: &Graph, node: &Node, d: &mut Diagnostics) {
    match &node.kind {
        NodeKind::Orbit { of, settings } => {
            check_start(graph, node, (*of, settings), d);
            if graph.state_width(*of, settings) == 3 {
                let maps = [*of].into_iter().chain(settings.pre.iter().chain(&settings.post).copied());
                let four = settings.four.or(maps.filter_map(|map| four_in(graph, map)).next());
                four.into_iter().for_each(|place| refuse(node, place, d));
            }
        }
        NodeKind::Warp { by, .. } => {
            if let Some(place) = four_in(graph, *by) {
                let message = "space has three components, and this value has four";
                d.push(Diagnostic::error(message).label(place, "").help("leave out the fourth number"));
            }
        }
        NodeKind::Transform { of, placement } if placement.translate[3] != 0.0 && !holds_four(graph, *of) => {
            refuse(node, node.span, d);
        }
        _ => {}
    }
}

/// Checks that tests at points of four components are of an orbit of four.
pub(super) fn check_tests(graph: &Graph, d: &mut Diagnostics) {
    for test in graph.tests.iter().filter(|test| test.kind.w().is_some()) {
        if !holds_four(graph, graph.output) {
            let message = "no orbit of the picture has four components, and this point has";
            d.push(Diagnostic::error(message).label(test.span, "").help(HELP));
        }
    }
}

fn refuse(node: &Node, place: Span, d: &mut Diagnostics) {
    let message = format!("`{}` has three components, and this value has four", node.name);
    d.push(Diagnostic::error(message).label(place, "").help(HELP));
}

/// Where a map holds a value of four components.
fn four_in(graph: &Graph, root: NodeRef) -> Option<Span> {
    let mut open = vec![root];
    let mut seen = vec![false; graph.nodes.len()];
    while let Some(of) = open.pop() {
        if std::mem::replace(&mut seen[of.0], true) {
            continue;
        }
        let node = graph.node(of);
        let is_four = match &node.kind {
            NodeKind::Item { constant, .. } => constant.fixed().is_some_and(|point| point[3] != 0.0),
            NodeKind::Step { params, .. } => {
                params.iter().any(|param| matches!(param, ParamInput::Known(ParamValue::Point(_))))
            }
            _ => false,
        };
        if is_four {
            return Some(node.span);
        }
        open.extend(node.kind.wires());
    }
    None
}

/// Whether an orbit or a shape of four components is a part of a field.
fn holds_four(graph: &Graph, root: NodeRef) -> bool {
    let mut open = vec![root];
    while let Some(of) = open.pop() {
        match &graph.node(of).kind {
            NodeKind::Orbit { of, settings } if graph.state_width(*of, settings) == 4 || graph.takes_four(*of) => {
                return true;
            }
            NodeKind::Shape { step, .. } if step.state == StateWidth::Four => return true,
            NodeKind::Orbit { settings, .. } => open.extend(settings.shape.map(|shape| shape.field)),
            kind if kind.is_map() => {}
            kind => open.extend(kind.wires()),
        }
    }
    false
}

/// An orbit that starts at a fixed point moves with the point by its constant alone; one that ends by convergence is looked at
/// where it ends.
fn check_start(graph: &Graph, node: &Node, (of, settings): (NodeRef, &OrbitSettings), d: &mut Diagnostics) {
    if settings.escape.is_convergence() && (!settings.post.is_empty() || settings.shape.is_some()) {
        let message = "an orbit that ends by convergence has no `post` and no `end`";
        let label = "its distance comes from what becomes small";
        d.push(Diagnostic::error(message).label(node.span, label).help("take another escape test, or leave them out"));
    }
    if settings.start.is_none() || !graph.node(of).kind.is_map() {
        return;
    }
    let (maps, _) = resolve_schedule(graph, of, settings.constant, settings.max_iterations);
    if maps.iter().all(|map| map.constant.start_weight() == 0.0) {
        let added = if settings.constant == Constant::Off { "nothing" } else { "a fixed constant" };
        let message = "the orbit is the same for every point: it has a `start`, and no iteration adds the point";
        d.push(Diagnostic::error(message).label(node.span, format!("its iterations add {added}")).help(
            "write `constant: Mandelbrot`, or leave out `start`: orbits of Julia sets start at the point itself",
        ));
    }
}
