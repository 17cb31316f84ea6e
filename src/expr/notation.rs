//! Expressions in mathematical notation: plain text in Unicode, or LaTeX.
//!
//! In comes a [`Function`]; out go lines "name = formula", in evaluation order. What is used more than once, chosen by
//! cases or longer than a line gets a name (t1, t2, ...) and a line of its own; the outputs come last. Vectors stay
//! vectors: operators act on each component, and a number beside a vector stands in all of them. How an operator is
//! written is a column of its row in [`ops`](super::ops).
//!
//! ```
//! use bulbfold::expr::{Arena, Function, Port, Type, notation};
//! let arena = Arena::default();
//! let mut fold = Function::new("fold", vec![Port::new("z", Type::V3), Port::new("L", Type::F)]);
//! let inputs = fold.input_exprs(&arena);
//! let (z, l) = (inputs[0], inputs[1]);
//! fold.output("z'", z.clamp(-l, l) * 2.0 - z);
//! assert_eq!(notation::plain(&arena, &fold), "z' = 2 clamp(z, -L, L) - z\n");
//! ```

use std::collections::HashMap;

use super::differentiate::reachable;
use super::ops::Operator;
use super::{Arena, Function, Node, NodeId, Op, Type};

/// How tightly a text binds: what stands alone, products and sums. Greater is tighter.
const ATOM: u8 = 8;
const POWER: u8 = 7;
const PRODUCT: u8 = 6;
const SUM: u8 = 4;
/// Characters from which a part gets a line of its own.
const LONG: usize = 64;
/// Characters from which a part that is used again gets a line of its own.
const SHORT: usize = 8;

/// How formulas are written.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Style {
    Plain,
    Latex,
}

/// A part of a formula.
#[derive(Clone)]
struct Text {
    text: String,
    level: u8,
    /// Values and their conditions, where it is chosen by cases; the last has no condition.
    cases: Vec<(String, String)>,
}

impl Text {
    fn new(text: impl Into<String>, level: u8) -> Text {
        Text { text: text.into(), level, cases: Vec::new() }
    }
}

/// The function as plain text, a line for each part.
pub fn plain(arena: &Arena, function: &Function) -> String {
    let lines = Writer::new(arena, function, Style::Plain).lines();
    lines.iter().map(|(name, text)| plain_line(name, text)).collect()
}

/// The function as one `aligned` block of LaTeX, to stand in mathematical mode.
pub fn latex(arena: &Arena, function: &Function) -> String {
    let lines = Writer::new(arena, function, Style::Latex).lines();
    let lines: Vec<String> = lines.iter().map(|(name, text)| format!("{name} &= {}", text.text)).collect();
    format!("\\begin{{aligned}}\n{}\n\\end{{aligned}}\n", lines.join(" \\\\\n"))
}

fn plain_line(name: &str, text: &Text) -> String {
    if text.cases.is_empty() {
        return format!("{name} = {}\n", text.text);
    }
    let width = text.cases.iter().map(|(value, _)| value.chars().count()).max().unwrap_or(0);
    let mut head = format!("{name} = ");
    let mut lines = String::new();
    for (value, condition) in &text.cases {
        let when = if condition.is_empty() { "otherwise".into() } else { format!("if {condition}") };
        lines.push_str(&format!("{head}{{ {value:<width$}  {when}\n"));
        head = " ".repeat(head.chars().count());
    }
    lines
}

/// A name as LaTeX: one letter stands for itself, in bold type for a vector, words stand upright.
pub fn latex_name(name: &str, ty: Type) -> String {
    let primes = name.chars().rev().take_while(|c| *c == '\'').count();
    let stem = &name[..name.len() - primes];
    // What is in braces is an index.
    if let Some((stem, index)) = stem.split_once("_{") {
        return format!("{}_{{{index}{}", latex_name(stem, ty), "'".repeat(primes));
    }
    let font = match (stem.chars().count(), ty.width) {
        (1, 1) => stem.to_string(),
        (1, _) => format!("\\mathbf{{{stem}}}"),
        _ => format!("\\mathrm{{{}}}", stem.replace('_', "\\_").replace(' ', "\\,")),
    };
    format!("{font}{}", "'".repeat(primes))
}

/// A number as people write it.
fn number_text(x: f64, style: Style) -> String {
    let pi = if style == Style::Latex { "\\pi" } else { "π" };
    for (part, text) in [(1.0, pi.to_string()), (2.0, format!("{pi}/2")), (0.5, format!("2{pi}"))] {
        if (x * part - std::f64::consts::PI).abs() < 1e-15 {
            return text;
        }
    }
    let size = x.abs();
    if size != 0.0 && !(1e-4..1e7).contains(&size) {
        let text = format!("{x:e}");
        let (digits, exponent) = text.split_once('e').unwrap_or((&text, "0"));
        return match (style, digits) {
            (Style::Plain, _) => text.clone(),
            (Style::Latex, "1") => format!("10^{{{exponent}}}"),
            (Style::Latex, _) => format!("{digits} \\cdot 10^{{{exponent}}}"),
        };
    }
    let rounded = format!("{x:.6}").parse::<f64>().unwrap_or(x);
    if (rounded - x).abs() <= 1e-12 * size { rounded.to_string() } else { format!("{x:.6}") }
}

fn brackets(text: &str, style: Style) -> String {
    match style {
        Style::Plain => format!("({text})"),
        Style::Latex => format!("\\left({text}\\right)"),
    }
}

struct Writer<'a> {
    arena: &'a Arena,
    function: &'a Function,
    style: Style,
    /// How many nodes and outputs use a node.
    uses: HashMap<NodeId, usize>,
    texts: HashMap<NodeId, Text>,
    named: usize,
}

impl<'a> Writer<'a> {
    fn new(arena: &'a Arena, function: &'a Function, style: Style) -> Writer<'a> {
        Writer { arena, function, style, uses: HashMap::new(), texts: HashMap::new(), named: 0 }
    }

    /// All lines: names and what they stand for.
    fn lines(mut self) -> Vec<(String, Text)> {
        let roots: Vec<NodeId> = self.function.outputs.iter().map(|(_, id)| *id).collect();
        let order = reachable(self.arena, &roots);
        self.count_uses(&order);
        let mut lines = Vec::new();
        for id in order {
            let node = self.arena.node(id);
            let text = self.node(&node);
            let text = if self.needs_name(&node, id, &text) {
                self.named += 1;
                let (name, level) = self.name_of_part(node.ty);
                lines.push((name.clone(), text));
                Text::new(name, level)
            } else {
                text
            };
            self.texts.insert(id, text);
        }
        for (port, id) in &self.function.outputs {
            let name = match self.style {
                Style::Plain => port.name.clone(),
                Style::Latex => latex_name(&port.name, port.ty),
            };
            lines.push((name, self.texts[id].clone()));
        }
        lines
    }

    /// Counts the nodes that use each node; powers are made of one use of their base.
    fn count_uses(&mut self, order: &[NodeId]) {
        for id in order {
            let node = self.arena.node(*id);
            let mut args = node.args().to_vec();
            args.sort_unstable();
            args.dedup();
            for arg in args {
                *self.uses.entry(arg).or_default() += 1;
            }
        }
    }

    fn name_of_part(&self, ty: Type) -> (String, u8) {
        match (self.style, ty.width) {
            (Style::Plain, _) => (format!("t{}", self.named), ATOM),
            (Style::Latex, 1) => (format!("t_{{{}}}", self.named), ATOM),
            (Style::Latex, _) => (format!("\\mathbf{{t}}_{{{}}}", self.named), ATOM),
        }
    }

    fn needs_name(&self, node: &Node, id: NodeId, text: &Text) -> bool {
        let uses = self.uses.get(&id).copied().unwrap_or(0);
        if uses == 0 || matches!(node.op, Op::Const(_) | Op::Input(_) | Op::Uniform(_) | Op::Splat | Op::Extract(_)) {
            return false;
        }
        let (long, short) = match self.style {
            Style::Plain => (LONG, SHORT),
            Style::Latex => (3 * LONG, 3 * SHORT),
        };
        let length = text.text.chars().count();
        let chosen = node.op == Op::Apply(Operator::Select) && self.style == Style::Plain && !self.is_last_case(id);
        chosen || length > long || (uses > 1 && length > short)
    }

    /// Whether a choice is only used as the last case of another one, which then holds its cases.
    fn is_last_case(&self, id: NodeId) -> bool {
        let users = (id.index() + 1..self.arena.len()).map(|i| self.arena.node(NodeId(i as u32)));
        self.uses.get(&id) == Some(&1)
            && users
                .filter(|user| user.args().contains(&id))
                .all(|user| user.op == Op::Apply(Operator::Select) && user.args()[2] == id && user.args()[1] != id)
    }

    fn node(&self, node: &Node) -> Text {
        match node.op {
            Op::Const(_) => self.constant(node),
            Op::Input(i) => {
                let port = &self.function.inputs[i as usize];
                match self.style {
                    Style::Plain => Text::new(port.name.clone(), ATOM),
                    Style::Latex => Text::new(latex_name(&port.name, port.ty), ATOM),
                }
            }
            Op::Uniform(i) => Text::new(format!("u{i}"), ATOM),
            Op::Compose => {
                let parts: Vec<&str> = node.args().iter().map(|arg| self.texts[arg].text.as_str()).collect();
                self.vector(&parts)
            }
            Op::Splat => self.texts[&node.args()[0]].clone(),
            Op::Extract(i) => {
                let axis = ["x", "y", "z", "w"][i as usize];
                let vector = self.bracketed(node.args()[0], ATOM);
                match self.style {
                    Style::Plain => Text::new(format!("{vector}.{axis}"), ATOM),
                    Style::Latex => Text::new(format!("{{{vector}}}_{axis}"), ATOM),
                }
            }
            Op::Dot => self.dot(node),
            Op::Lookup(number) => Text::new(format!("table{number}[{}]", self.texts[&node.args()[0]].text), ATOM),
            Op::Apply(operator) => self.apply(operator, node),
        }
    }

    fn constant(&self, node: &Node) -> Text {
        let values = node.constant().unwrap_or_default();
        let values = &values[..node.ty.width as usize];
        if node.ty.is_bool {
            return Text::new(if values[0] == 0.0 { "false" } else { "true" }, ATOM);
        }
        if values.iter().all(|x| x.to_bits() == values[0].to_bits()) {
            let level = if values[0].is_sign_negative() { SUM } else { ATOM };
            return Text::new(number_text(values[0], self.style), level);
        }
        let texts: Vec<String> = values.iter().map(|x| number_text(*x, self.style)).collect();
        self.vector(&texts.iter().map(String::as_str).collect::<Vec<_>>())
    }

    fn vector(&self, parts: &[&str]) -> Text {
        match self.style {
            Style::Plain => Text::new(format!("({})", parts.join(", ")), ATOM),
            Style::Latex => Text::new(format!("\\begin{{pmatrix}}{}\\end{{pmatrix}}", parts.join(" \\\\ ")), ATOM),
        }
    }

    fn length(&self, of: NodeId) -> String {
        let text = &self.texts[&of].text;
        match self.style {
            Style::Plain => format!("‖{text}‖"),
            Style::Latex => format!("\\left\\lVert {text}\\right\\rVert"),
        }
    }

    fn dot(&self, node: &Node) -> Text {
        let (a, b) = (node.args()[0], node.args()[1]);
        if a == b {
            return Text::new(format!("{}{}", self.length(a), self.exponent(2)), POWER);
        }
        let sign = if self.style == Style::Plain { "·" } else { "\\cdot" };
        Text::new(format!("{} {sign} {}", self.bracketed(a, POWER), self.bracketed(b, POWER)), PRODUCT)
    }

    fn exponent(&self, n: u32) -> String {
        const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
        match self.style {
            Style::Plain => n.to_string().bytes().map(|digit| DIGITS[usize::from(digit - b'0')]).collect(),
            Style::Latex => format!("^{{{n}}}"),
        }
    }

    /// The base and exponent of a product of equal factors; parts with names of their own are bases.
    fn power(&self, id: NodeId) -> (NodeId, u32) {
        let node = self.arena.node(id);
        let is_product = node.op == Op::Apply(Operator::Mul);
        let is_named = self.texts.get(&id).is_some_and(|text| text.level == ATOM);
        if !is_product || is_named {
            return (id, 1);
        }
        let [(a, m), (b, n)] = [node.args()[0], node.args()[1]].map(|arg| self.power(arg));
        if a == b { (a, m + n) } else { (id, 1) }
    }

    fn apply(&self, operator: Operator, node: &Node) -> Text {
        let mut args = node.args().to_vec();
        let is_constant = |id: NodeId| self.arena.node(id).constant();
        match operator {
            Operator::Mul => {
                let [(a, m), (b, n)] = [args[0], args[1]].map(|arg| self.power(arg));
                if a == b && is_constant(a).is_none() {
                    return Text::new(format!("{}{}", self.bracketed(a, ATOM), self.exponent(m + n)), POWER);
                }
                if is_constant(args[1]).is_some() && is_constant(args[0]).is_none() {
                    args.swap(0, 1);
                }
                if is_constant(args[0])
                    .is_some_and(|values| values[..node.ty.width as usize].iter().all(|x| *x == -1.0))
                {
                    return Text::new(format!("-{}", self.bracketed(args[1], PRODUCT)), SUM);
                }
                // Numbers stand before the vectors that they multiply.
                let is_number = |id: NodeId| self.arena.node(id).op == Op::Splat;
                if is_number(args[1]) && !is_number(args[0]) && is_constant(args[0]).is_none() {
                    args.swap(0, 1);
                }
                // A negative factor in front needs no brackets.
                let first = &self.texts[&args[0]];
                if first.text.starts_with('-') && is_constant(args[0]).is_some() {
                    let space = if self.style == Style::Plain { " " } else { "\\," };
                    return Text::new(format!("{}{space}{}", first.text, self.bracketed(args[1], PRODUCT)), SUM);
                }
            }
            Operator::Add => {
                for (a, b) in [(args[0], args[1]), (args[1], args[0])] {
                    let text = &self.texts[&b].text;
                    let is_negative = is_constant(b).is_some() && text.starts_with('-');
                    if let (true, Some(positive)) = (is_negative, text.strip_prefix('-')) {
                        return Text::new(format!("{} - {positive}", self.bracketed(a, SUM)), SUM);
                    }
                }
            }
            Operator::Sqrt => {
                let under = self.arena.node(args[0]);
                let is_bare = self.texts[&args[0]].level == POWER;
                if under.op == Op::Dot && under.args()[0] == under.args()[1] && is_bare {
                    return Text::new(self.length(under.args()[0]), ATOM);
                }
            }
            Operator::Select => return self.select(node),
            _ => {}
        }
        self.filled(operator, &args)
    }

    /// The operator's own notation with its arguments in their places.
    fn filled(&self, operator: Operator, args: &[NodeId]) -> Text {
        let info = operator.info();
        let template = if self.style == Style::Plain { info.plain } else { info.latex };
        let mut parts = template.split('#');
        let mut text = parts.next().unwrap_or_default().to_string();
        for part in parts {
            // `0.4` is the first argument, in brackets where it binds less than 4.
            let digit = |i: usize| part.as_bytes()[i] - b'0';
            text.push_str(&self.bracketed(args[usize::from(digit(0))], digit(2)));
            text.push_str(&part[3..]);
        }
        let is_closed = self.style == Style::Latex && template.starts_with("\\frac");
        Text::new(text, if is_closed { ATOM } else { info.level })
    }

    fn select(&self, node: &Node) -> Text {
        let mut text = self.filled(Operator::Select, node.args());
        let [condition, value, other] = [0, 1, 2].map(|i| &self.texts[&node.args()[i]]);
        let mut cases = vec![(value.text.clone(), condition.text.clone())];
        match other.cases.is_empty() {
            true => cases.push((other.text.clone(), String::new())),
            false => cases.extend(other.cases.iter().cloned()),
        }
        if self.style == Style::Latex {
            let rows = cases.iter().map(|(value, condition)| match condition.as_str() {
                "" => format!("{value} & \\text{{otherwise}}"),
                condition => format!("{value} & \\text{{if }} {condition}"),
            });
            text.text = format!("\\begin{{cases}}{}\\end{{cases}}", rows.collect::<Vec<_>>().join(" \\\\ "));
        }
        text.cases = cases;
        text
    }

    fn bracketed(&self, id: NodeId, least: u8) -> String {
        let text = &self.texts[&id];
        if text.level < least { brackets(&text.text, self.style) } else { text.text.clone() }
    }
}
