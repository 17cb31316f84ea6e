//! One straight-line function as WGSL text.

use std::collections::{BTreeSet, HashMap, HashSet};
use std::fmt::Write as _;

use super::number::{constant, identifier, suffix};
use crate::expr::ops::Operator;
use crate::expr::{Arena, Function, NodeId, Op, Port, Type};

/// Longest text that is written in place instead of getting a name of its own.
const MAX_INLINE: usize = 90;
/// How deep a node's name looks into its arguments: changes further down leave it alone.
const NAME_DEPTH: usize = 3;

/// The helpers that have been used: name without prefix and type, and width of the type.
pub(super) type Helpers = BTreeSet<(String, u8)>;

/// Text of an expression.
#[derive(Clone)]
struct Text {
    text: String,
    /// True if it can stand as an operand without parentheses.
    is_atom: bool,
}

impl Text {
    fn operand(&self) -> String {
        if self.is_atom { self.text.clone() } else { format!("({})", self.text) }
    }
}

/// Writes `struct <name>` with one member a port.
pub(super) fn write_struct(out: &mut String, name: &str, ports: &[Port]) {
    let _ = writeln!(out, "struct {name} {{");
    for (port, member) in ports.iter().zip(members(ports)) {
        let _ = writeln!(out, "    {member}: {},", port.ty.wgsl());
    }
    let _ = writeln!(out, "}}\n");
}

/// Legal and distinct names of ports.
pub(super) fn members(ports: &[Port]) -> Vec<String> {
    let mut seen = HashSet::new();
    ports
        .iter()
        .enumerate()
        .map(|(i, port)| {
            let mut name = identifier(&port.name);
            if !seen.insert(name.clone()) {
                name = format!("{name}_{i}");
                seen.insert(name.clone());
            }
            name
        })
        .collect()
}

/// Writes a function that returns the struct `result`, which must be written already.
pub(super) fn write_function(
    out: &mut String,
    arena: &Arena,
    function: &Function,
    result: &str,
    helpers: &mut Helpers,
) {
    let parameters = members(&function.inputs);
    let typed: Vec<String> =
        function.inputs.iter().zip(&parameters).map(|(port, name)| format!("{name}: {}", port.ty.wgsl())).collect();
    let _ = writeln!(out, "fn {}({}) -> {result} {{", identifier(&function.name), typed.join(", "));
    let mut writer = Writer::new(arena, function, parameters, helpers);
    writer.write_lets(out);
    let values: Vec<String> = function.outputs.iter().map(|(port, id)| writer.coerced(*id, port.ty).text).collect();
    let _ = writeln!(out, "    return {result}({});\n}}\n", values.join(", "));
}

struct Writer<'a> {
    arena: &'a Arena,
    nodes: Vec<NodeId>,
    uses: HashMap<NodeId, usize>,
    hashes: HashMap<NodeId, u64>,
    texts: HashMap<NodeId, Text>,
    names: HashSet<String>,
    parameters: Vec<String>,
    helpers: &'a mut Helpers,
}

impl<'a> Writer<'a> {
    fn new(arena: &'a Arena, function: &Function, parameters: Vec<String>, helpers: &'a mut Helpers) -> Writer<'a> {
        let nodes = function.nodes(arena);
        let mut uses: HashMap<NodeId, usize> = HashMap::new();
        for &id in &nodes {
            for &arg in arena.node(id).args() {
                *uses.entry(arg).or_default() += 1;
            }
        }
        for (_, id) in &function.outputs {
            *uses.entry(*id).or_default() += 1;
        }
        let hashes = local_hashes(arena, &nodes, &parameters);
        let names = parameters.iter().cloned().collect();
        Writer { arena, nodes, uses, hashes, texts: HashMap::new(), names, parameters, helpers }
    }

    /// Writes a `let` for every node that is used more than once or too long to stand in place.
    fn write_lets(&mut self, out: &mut String) {
        for id in self.nodes.clone() {
            let node = self.arena.node(id);
            let mut text = self.text_of(id);
            let shared = self.uses.get(&id).copied().unwrap_or(0) > 1;
            let cheap = match node.op {
                Op::Const(_) | Op::Input(_) | Op::Uniform(_) => true,
                Op::Extract(_) => text.text.len() < 40,
                _ => false,
            };
            if !cheap && (shared || text.text.len() > MAX_INLINE) {
                let name = self.name(id);
                let _ = writeln!(out, "    let {name} = {};", text.text);
                text = Text { text: name, is_atom: true };
            }
            self.texts.insert(id, text);
        }
    }

    /// A name made of the operation and of what stands right around it.
    fn name(&mut self, id: NodeId) -> String {
        let word = match self.arena.node(id).op {
            Op::Const(_) => "value",
            Op::Input(_) => "input",
            Op::Uniform(_) => "uniform",
            Op::Compose | Op::Splat => "vector",
            Op::Extract(_) => "part",
            Op::Dot => "dot",
            Op::Lookup(_) => "entry",
            Op::Apply(operator) => operator.info().name,
        };
        let hash = self.hashes[&id];
        let base = format!("{word}_{:04x}", (hash >> 16) & 0xffff);
        let mut name = base.clone();
        let mut copy = 1;
        // Nodes whose names would be equal are numbered in order of evaluation.
        while !self.names.insert(name.clone()) {
            copy += 1;
            name = format!("{base}_{copy}");
        }
        name
    }

    fn text_of(&mut self, id: NodeId) -> Text {
        let node = self.arena.node(id);
        let args = node.args();
        let atom = |text: String| Text { text, is_atom: true };
        match node.op {
            Op::Const(bits) => {
                let components = bits.map(f64::from_bits);
                if components.iter().any(|x| !x.is_finite()) {
                    self.helpers.extend(["inf", "nan"].map(|helper| (helper.to_string(), 1)));
                }
                atom(constant(node.ty, components))
            }
            Op::Input(number) => atom(self.parameters[usize::from(number)].clone()),
            Op::Uniform(number) => atom(format!("uniforms.u{number}")),
            Op::Compose => {
                let parts: Vec<String> = args.iter().map(|&a| self.coerced(a, node.ty.with_width(1)).text).collect();
                atom(format!("{}({})", node.ty.wgsl(), parts.join(", ")))
            }
            Op::Splat => atom(format!("{}({})", node.ty.wgsl(), self.coerced(args[0], node.ty.with_width(1)).text)),
            Op::Extract(i) => {
                atom(format!("{}.{}", self.texts[&args[0]].operand(), ["x", "y", "z", "w"][usize::from(i & 3)]))
            }
            Op::Dot if self.arena.node(args[0]).ty.width == 1 => Text {
                text: format!("{} * {}", self.texts[&args[0]].operand(), self.texts[&args[1]].operand()),
                is_atom: false,
            },
            Op::Dot => atom(format!("dot({}, {})", self.texts[&args[0]].text, self.texts[&args[1]].text)),
            Op::Lookup(number) => {
                let (index, last) = (&self.texts[&args[0]].text, self.arena.table(number).last());
                atom(format!("tables[table_{number} + u32(clamp({index}, 0.0, {last}.0))]"))
            }
            Op::Apply(operator) => self.apply(operator, args, node.ty),
        }
    }

    /// Fills the operator's spelling: `{0}` to `{2}` the arguments, `{t}` the type's helper suffix.
    fn apply(&mut self, operator: Operator, args: &[NodeId], ty: Type) -> Text {
        let info = operator.info();
        let is_call = info.wgsl.ends_with(')') && info.wgsl.starts_with(|c: char| c.is_ascii_alphabetic());
        let mut text = info.wgsl.replace("{t}", suffix(ty));
        if let Some(helper) = info.wgsl.strip_prefix("bf_") {
            let name = helper.split("_{t}").next().unwrap_or(helper);
            self.helpers.insert((name.to_string(), ty.width));
        }
        for (i, &arg) in args.iter().enumerate() {
            let is_bool = info.bool_arguments >> i & 1 == 1;
            let wanted = Type { is_bool, width: self.arena.node(arg).ty.width };
            let argument = self.coerced(arg, wanted);
            let argument = if is_call { argument.text } else { argument.operand() };
            text = text.replace(&format!("{{{i}}}"), &argument);
        }
        Text { text, is_atom: is_call }
    }

    /// The text of a node as a number or a boolean, whichever is wanted.
    fn coerced(&self, id: NodeId, wanted: Type) -> Text {
        let text = self.texts[&id].clone();
        let ty = self.arena.node(id).ty;
        match (ty.is_bool, wanted.is_bool) {
            (true, false) => Text { text: format!("{}({})", wanted.wgsl(), text.text), is_atom: true },
            (false, true) => {
                let half = constant(Type { is_bool: false, ..ty }, [0.5; 4]);
                Text { text: format!("({} > {half})", text.operand()), is_atom: true }
            }
            _ => text,
        }
    }
}

/// A hash of each node that looks [`NAME_DEPTH`] levels into its arguments.
fn local_hashes(arena: &Arena, nodes: &[NodeId], parameters: &[String]) -> HashMap<NodeId, u64> {
    let own = |id: NodeId| {
        let node = arena.node(id);
        let text = match node.op {
            Op::Input(number) => parameters[usize::from(number)].clone(),
            Op::Apply(operator) => operator.info().name.to_string(),
            op => format!("{op:?}"),
        };
        fnv1a(format!("{text} {}", node.ty.wgsl()).as_bytes())
    };
    let shallow: HashMap<NodeId, u64> = nodes.iter().map(|&id| (id, own(id))).collect();
    let mut hashes = shallow.clone();
    for _ in 0..NAME_DEPTH {
        hashes = nodes
            .iter()
            .map(|&id| {
                let mut bytes = shallow[&id].to_le_bytes().to_vec();
                bytes.extend(arena.node(id).args().iter().flat_map(|arg| hashes[arg].to_le_bytes()));
                (id, fnv1a(&bytes))
            })
            .collect();
    }
    hashes
}

/// A hash that stays the same from one release of Rust to the next (Fowler, Noll and Vo, 1991).
fn fnv1a(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}
