//! Expressions as text: one line for each node that is computed, with its type and the place that made it.
//!
//! Inputs stand under their names and constants as numbers, components as `v.x`. Other nodes are named for their
//! operator and a hash of what they compute, so a change of a formula renames only what depends on it.

use std::collections::{HashMap, HashSet};
use std::fmt::Write as _;

use super::{Arena, Function, Node, NodeId, Op};
use crate::diag::Sources;

/// Names of the components of a vector.
const COMPONENTS: [&str; 4] = ["x", "y", "z", "w"];

/// A listing of a function.
pub fn listing(arena: &Arena, function: &Function, sources: &Sources) -> String {
    let mut printer = Printer { function, names: HashMap::new(), hashes: HashMap::new(), taken: HashSet::new() };
    let inputs: Vec<String> = function.inputs.iter().map(|port| format!("{}: {}", port.name, port.ty)).collect();
    let mut text = format!("fn {}({})\n", function.name, inputs.join(", "));
    for id in function.nodes(arena) {
        let node = arena.node(id);
        let hash = printer.hash(&node);
        printer.hashes.insert(id, hash);
        let value = printer.value(&node);
        if is_inline(node.op) {
            printer.names.insert(id, value);
            continue;
        }
        let name = printer.name(&node, hash);
        let line = format!("  {name} = {value}");
        let place = place(sources, &node);
        let _ = writeln!(text, "{}", format!("{line:<60} // {} {place}", node.ty).trim_end());
        printer.names.insert(id, name);
    }
    for (port, id) in &function.outputs {
        let _ = writeln!(text, "  return {}: {} = {}", port.name, port.ty, printer.names[id]);
    }
    text
}

fn is_inline(op: Op) -> bool {
    matches!(op, Op::Const(_) | Op::Input(_) | Op::Uniform(_) | Op::Extract(_) | Op::Splat)
}

fn place(sources: &Sources, node: &Node) -> String {
    match sources.line_col(node.span) {
        Some((line, column)) => format!("{}:{line}:{column}", sources.name(node.span.source)),
        None => String::new(),
    }
}

struct Printer<'a> {
    function: &'a Function,
    names: HashMap<NodeId, String>,
    hashes: HashMap<NodeId, u64>,
    taken: HashSet<String>,
}

impl Printer<'_> {
    /// What a node computes, in terms of its arguments' names.
    fn value(&self, node: &Node) -> String {
        let args: Vec<&str> = node.args().iter().map(|id| self.names[id].as_str()).collect();
        match node.op {
            Op::Const(_) => constant(node),
            Op::Input(number) => match self.function.inputs.get(number as usize) {
                Some(port) => port.name.clone(),
                None => format!("input_{number}"),
            },
            Op::Uniform(number) => format!("uniform_{number}"),
            Op::Extract(i) => format!("{}.{}", args[0], COMPONENTS[usize::from(i) % 4]),
            Op::Splat => args[0].to_string(),
            _ => format!("{}({})", operator(node), args.join(", ")),
        }
    }

    /// FNV-1a over the operator, the type and the arguments' hashes.
    fn hash(&self, node: &Node) -> u64 {
        let mut hash: u64 = 0xcbf2_9ce4_8422_2325;
        let mut add = |bytes: &[u8]| {
            for byte in bytes {
                hash = (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
            }
        };
        match node.op {
            Op::Apply(operator) => add(operator.info().name.as_bytes()),
            other => add(format!("{other:?}").as_bytes()),
        }
        add(&[node.ty.width, u8::from(node.ty.is_bool)]);
        for arg in node.args() {
            add(&self.hashes[arg].to_le_bytes());
        }
        hash
    }

    /// A name that no other node of the function has: as many digits of the hash as that takes.
    fn name(&mut self, node: &Node, hash: u64) -> String {
        let digits = format!("{hash:016x}");
        let name =
            (4..=16).map(|n| format!("{}_{}", operator(node), &digits[..n])).find(|name| !self.taken.contains(name));
        let name = name.unwrap_or_else(|| format!("{}_{digits}_{}", operator(node), self.taken.len()));
        self.taken.insert(name.clone());
        name
    }
}

fn operator(node: &Node) -> &'static str {
    match node.op {
        Op::Apply(operator) => operator.info().name,
        Op::Dot => "dot",
        Op::Lookup(_) => "look_up",
        _ if node.ty.width == 4 => "vec4",
        _ => "vec3",
    }
}

fn constant(node: &Node) -> String {
    let Some(values) = node.constant() else { return String::new() };
    match (node.ty.is_bool, node.ty.width) {
        (true, 1) => (values[0] != 0.0).to_string(),
        (_, 1) => values[0].to_string(),
        (_, width) => {
            let parts: Vec<String> = values[..width as usize].iter().map(f64::to_string).collect();
            format!("({})", parts.join(", "))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::listing;
    use crate::diag::Sources;
    use crate::expr::{Arena, Function, Port, Type};

    #[test]
    fn shared_nodes_are_printed_once() {
        let arena = Arena::default();
        let mut function = Function::new("fold", vec![Port::new("z", Type::V3)]);
        let z = arena.input(0, Type::V3);
        let square = z.dot(z);
        function.output("a", square.sqrt());
        function.output("b", square * z.component(0));
        let text = listing(&arena, &function, &Sources::default());
        assert_eq!(text.matches("dot(z, z)").count(), 1, "{text}");
        assert!(text.starts_with("fn fold(z: vec3)\n"), "{text}");
        assert!(text.contains(", z.x)") && text.contains("return a: number = sqrt_"), "{text}");
    }

    #[test]
    fn names_do_not_depend_on_what_was_built_before() {
        let text = |prelude: bool| {
            let arena = Arena::default();
            if prelude {
                let _ = arena.input(0, Type::V3).length() + 1.0;
            }
            let mut function = Function::new("f", vec![Port::new("z", Type::V3)]);
            function.output("r", arena.input(0, Type::V3).length() * 2.0);
            listing(&arena, &function, &Sources::default())
        };
        assert_eq!(text(false), text(true));
    }
}
