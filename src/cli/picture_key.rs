//! What a picture shows, in text: the part of a key that all kinds of pictures share.

use bulbfold::graph::{NodeKind, ValidGraph, print};

use super::Session;

/// The graph with all its settings and the texts of its steps. Comments, tests and descriptions do not show.
pub fn graph_text(session: &Session, graph: &ValidGraph) -> String {
    let mut text = format!("{}\n{:?} {:?}", print::listing(graph), graph.scene, graph.bounding_radius,);
    for node in &graph.nodes {
        match &node.kind {
            NodeKind::Step { step, .. } => text.push_str(session.library.sources.text(step.text)),
            NodeKind::Orbit { settings, .. } => text.push_str(&format!("{settings:?}")),
            _ => {}
        }
    }
    text
}
