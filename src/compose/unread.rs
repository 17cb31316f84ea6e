//! Steps that read the constant where an iteration has none: they see 0, and most of them then make something else of it.

use super::maps::reads_constant;
use super::{ComposeResult, Composer, FieldOrbit};
use crate::graph::{Constant, MapTree, NodeRef, resolve_schedule};

/// A warning for each such node, with its place.
pub(super) fn warnings(composer: &Composer, orbits: &[FieldOrbit]) -> ComposeResult<Vec<String>> {
    let mut seen: Vec<NodeRef> = Vec::new();
    let mut warnings = Vec::new();
    for orbit in orbits {
        let width = composer.graph.state_width(orbit.root, &orbit.settings);
        let (maps, _) =
            resolve_schedule(composer.graph, orbit.root, orbit.settings.constant, orbit.settings.max_iterations);
        for item in maps.iter().filter(|item| item.constant == Constant::Off) {
            for node in steps_of(&item.map) {
                if !seen.contains(&node) && reads_constant(composer, node, width)? {
                    warnings.push(warning(composer, node));
                }
                seen.push(node);
            }
        }
    }
    Ok(warnings)
}

fn warning(composer: &Composer, node: NodeRef) -> String {
    let (sources, node) = (&composer.library.sources, composer.graph.node(node));
    let place = sources.line_col(node.span);
    let place = place.map(|(line, column)| format!("{}:{line}:{column}: ", sources.name(node.span.source)));
    format!(
        "{}the node `{}` reads the constant `c`, which is 0 under `constant: Off`; write `constant: Mandelbrot` or \
         `constant: Julia((x, y, z))`, or take a step that needs none",
        place.unwrap_or_default(),
        node.name
    )
}

/// The step nodes of a map.
fn steps_of(map: &MapTree) -> Vec<NodeRef> {
    match map {
        MapTree::Identity => Vec::new(),
        MapTree::Step(node) => vec![*node],
        MapTree::Sequence(parts) => parts.iter().flat_map(steps_of).collect(),
        MapTree::Repeat(of, _) => steps_of(of),
        MapTree::Blend(a, b, _) | MapTree::Choose(_, a, b) => {
            [a, b].into_iter().flat_map(|part| steps_of(part)).collect()
        }
    }
}
