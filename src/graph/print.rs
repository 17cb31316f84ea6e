//! The graph in text: as a tree, and as Graphviz DOT.

use std::fmt::Write as _;

use super::escape::{Escape, Point};
use super::{Graph, Layer, NodeKind, Paint, ParamInput, TRAPS};
use crate::formula::step::ParamValue;

/// A listing of all nodes with their parameters and wires.
pub fn listing(graph: &Graph) -> String {
    let mut text = format!("fractal {}\n", graph.name);
    for param in &graph.params {
        let line = format!("  param {} = {} ({} to {}) {}", param.name, param.value, param.min, param.max, param.unit);
        let _ = writeln!(text, "{}", line.trim_end());
    }
    for node in &graph.nodes {
        let _ = writeln!(text, "  {} = {}", node.name, describe(graph, &node.kind));
    }
    let _ = writeln!(text, "  output {}", graph.node(graph.output).name);
    text
}

/// The same, with the file's colours.
pub fn listing_with_look(graph: &Graph) -> String {
    let mut text = listing(graph);
    if graph.scene.look.traps != TRAPS {
        let traps: Vec<String> = graph.scene.look.traps.iter().flatten().map(|trap| format!("{trap:?}")).collect();
        let _ = writeln!(text, "  traps {}", traps.join(", "));
    }
    let look = &graph.scene.look;
    if !look.paint.layers.is_empty() || look.paint.material.is_some() {
        let _ = writeln!(text, "  look {}", paint(&look.paint));
    }
    for part in &look.parts {
        let _ = writeln!(text, "  part {} {}", graph.node(part.node).name, paint(&part.paint));
    }
    text
}

/// The colours and the material of a surface.
fn paint(paint: &Paint) -> String {
    let layer = |layer: &Layer| {
        let name = if layer.name.is_empty() { "own" } else { &layer.name };
        format!("gradient {name} by {:?}", layer.by)
    };
    let mut parts: Vec<String> = paint.layers.iter().map(layer).collect();
    if parts.is_empty() {
        parts.push(format!("palette {:?}", paint.palette));
    }
    parts.extend(paint.material.as_ref().map(|used| format!("material {used:?}")));
    parts.join(", ")
}

/// The graph in the DOT language: wires point from a node to what uses it.
pub fn dot(graph: &Graph) -> String {
    let mut text = String::from("digraph {\n  rankdir=LR;\n  node [shape=box, fontname=\"sans-serif\"];\n");
    for (i, node) in graph.nodes.iter().enumerate() {
        let label = format!("{}\n{}", node.name, node.kind.keyword()).replace('"', "'").replace('\n', "\\n");
        let style = if i == graph.output.0 { ", style=bold" } else { "" };
        let _ = writeln!(text, "  n{i} [label=\"{label}\"{style}];");
        for wire in node.kind.wires() {
            let _ = writeln!(text, "  n{} -> n{i};", wire.0);
        }
    }
    text.push_str("}\n");
    text
}

fn describe(graph: &Graph, kind: &NodeKind) -> String {
    let wires: Vec<&str> = kind.wires().iter().map(|w| graph.node(*w).name.as_str()).collect();
    match kind {
        NodeKind::Step { step, params } | NodeKind::Shape { step, params } => {
            let params: Vec<String> =
                step.params.iter().zip(params).map(|(p, v)| format!("{}: {}", p.name, input(v))).collect();
            format!("{}({})", step.name, params.join(", "))
        }
        NodeKind::Primitive(primitive) => format!("{primitive:?}"),
        NodeKind::Repeat { times, .. } => format!("Repeat({} times {times})", wires[0]),
        NodeKind::Blend { weight, .. } => format!("Blend({} weight {weight})", wires.join(", ")),
        NodeKind::Choose { when, .. } => format!("Choose({} when {when:?})", wires.join(", ")),
        NodeKind::Between { from, to, .. } => format!("Between({} from {from} to {to})", wires.join(", ")),
        NodeKind::Alternate(turns) => {
            let turns: Vec<String> = turns.iter().map(|(w, n)| format!("{} x{n}", graph.node(*w).name)).collect();
            format!("Alternate({})", turns.join(", "))
        }
        NodeKind::Item { constant, .. } => format!("Item({} constant {constant})", wires[0]),
        NodeKind::Orbit { settings, .. } => {
            let shape = settings.shape.map(|shape| match shape.levels {
                Some(levels) => {
                    format!(", {} at levels from {}: {:?}", graph.node(shape.field).name, levels.from, levels.join)
                }
                None => format!(", end {}", graph.node(shape.field).name),
            });
            let start = settings.start.map(|start| format!(", start {}", Point(start))).unwrap_or_default();
            let escape = match settings.escape {
                Escape::Length => "escape_radius".to_string(),
                escape => format!("escape {escape}"),
            };
            format!(
                "Orbit({} constant {}{start}, {escape} {}, max_iterations {}{})",
                wires[0],
                settings.constant,
                settings.escape_radius,
                settings.max_iterations,
                shape.unwrap_or_default()
            )
        }
        NodeKind::SmoothUnion { radius, .. } => format!("SmoothUnion({} radius {radius})", wires.join(", ")),
        NodeKind::Tile { tiling, .. } => format!("Tile({} {tiling:?})", wires[0]),
        NodeKind::Transform { placement, .. } => format!("Transform({} {placement:?})", wires[0]),
        other => format!("{}({})", other.keyword(), wires.join(", ")),
    }
}

fn input(value: &ParamInput) -> String {
    match value {
        ParamInput::OfIteration(text) => format!("\"{text}\""),
        ParamInput::Known(ParamValue::Number(x)) => x.to_string(),
        ParamInput::Known(ParamValue::Bool(b)) => b.to_string(),
        ParamInput::Known(ParamValue::Word(word)) => word.clone(),
        ParamInput::Known(ParamValue::Vector(v)) => format!("({}, {}, {})", v[0], v[1], v[2]),
        ParamInput::Known(ParamValue::Point(v)) => Point(*v).to_string(),
        ParamInput::Known(ParamValue::Matrix(rows)) => format!("{rows:?}"),
    }
}
