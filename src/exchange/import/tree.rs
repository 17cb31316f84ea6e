//! Mandelbulber's tree of objects (since version 2.35): which formulas and primitives are drawn, and how they are joined.
//!
//! `node_0001_definition NAME 1,1,1,0,1,0;` states an object's name and number, its number again, its kind, the number of the object above
//! it (0: none), the number of what it draws and its place among its neighbours. Of files that differ in the first fields only
//! the numbers behind the last blank or the first comma are read, whichever makes a kind that is known.

use std::collections::BTreeMap;

use super::migrate::{OBJECT_TREE, OF_PLACE};
use super::settings::{Entry, Section, Settings};
use crate::diag::{Diagnostic, Diagnostics};

/// Most objects of a tree.
const MAX_NODES: usize = 200;

/// Deepest tree.
const MAX_DEPTH: usize = 20;

/// A tree of objects.
#[derive(Clone, PartialEq, Debug)]
pub enum Node {
    /// The formula of a section, by its number.
    Formula(usize),
    /// Formulas that take turns, and the beginning of the group's settings.
    Hybrid(Vec<usize>, String),
    /// A primitive such as `primitive_box_1`, and the beginning of its settings in the tree.
    Primitive(String, String),
    /// Objects joined by an operator, and the beginning of the group's settings.
    Join(Join, Vec<Node>, String),
}

/// How objects of a group are joined.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Join {
    /// All of them.
    Or,
    /// What they have in common.
    And,
    /// The first without the others.
    Without,
}

/// What an object is.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Kind {
    Formula,
    Primitive,
    Hybrid,
    Joined(Join),
}

/// A line that defines an object.
struct Definition {
    id: i64,
    kind: Kind,
    above: i64,
    drawn: i64,
    order: i64,
    /// Beginning of its settings, such as `node_0001`.
    prefix: String,
}

impl Node {
    /// Numbers of the formulas' sections, in order.
    pub fn formulas(&self) -> Vec<usize> {
        match self {
            Node::Formula(number) => vec![*number],
            Node::Hybrid(numbers, _) => numbers.clone(),
            Node::Primitive(..) => Vec::new(),
            Node::Join(_, children, _) => children.iter().flat_map(Node::formulas).collect(),
        }
    }
}

/// The tree of a file; nothing if the file has none. Settings of the tree's objects are brought to the names that old files
/// have for them. Errors: each is pushed, with its place.
pub fn read(settings: &mut Settings, d: &mut Diagnostics) -> Option<Node> {
    // The program takes older files without their trees, if a version in the making has written one.
    if settings.version.before(OBJECT_TREE) {
        return None;
    }
    let definitions = definitions(settings.section_mut("main_parameters"), d);
    if definitions.is_empty() || d.has_errors() {
        return None;
    }
    let mut children: BTreeMap<i64, Vec<&Definition>> = BTreeMap::new();
    for definition in &definitions {
        let known = definitions.iter().any(|other| other.id == definition.above);
        children.entry(if known { definition.above } else { 0 }).or_default().push(definition);
    }
    children.values_mut().for_each(|list| list.sort_by_key(|definition| (definition.order, definition.id)));
    let mut builder = Builder { children, settings, used: Vec::new() };
    let roots: Vec<&Definition> = builder.children.get(&0).cloned().unwrap_or_default();
    let mut nodes: Vec<Node> = roots.iter().filter_map(|root| builder.node(root, 0, d)).collect();
    match nodes.len() {
        0 => {
            let message = "the tree of objects draws nothing";
            d.push(Diagnostic::error(message).help("no `node_..._definition` at the top holds a formula"));
            None
        }
        1 => nodes.pop(),
        _ => Some(Node::Join(Join::Or, nodes, "node_0000".into())),
    }
}

fn definitions(main: &Section, d: &mut Diagnostics) -> Vec<Definition> {
    let is_definition = |entry: &&Entry| entry.name.starts_with("node_") && entry.name.ends_with("_definition");
    let mut found: Vec<Definition> = Vec::new();
    for entry in main.entries.iter().filter(is_definition) {
        main.raw(&entry.name);
        match definition(entry) {
            Some(definition) if found.iter().all(|other| other.id != definition.id) => found.push(definition),
            Some(_) => d.push(
                Diagnostic::error("two objects of the tree have the same number")
                    .label(entry.span, "the second of them"),
            ),
            None => d.push(
                Diagnostic::error(format!("`{}` defines no object that this reader knows", entry.name))
                    .label(
                        entry.span,
                        "expected a name and numbers: of itself, its kind, the object above it, what it draws",
                    )
                    .help("kinds are 1 formula, 2 primitive, 10 hybrid, 11 or, 12 and, 13 without"),
            ),
        }
    }
    if found.len() > MAX_NODES {
        let message = format!("the tree has {} objects, more than {MAX_NODES}", found.len());
        d.push(Diagnostic::error(message).label(main.entries[0].span, "in these settings"));
    }
    found
}

/// Reads `NAME 1,1,1,0,1,0`, and the same without the number behind the name or without the last one.
fn definition(entry: &Entry) -> Option<Definition> {
    let numbers = |text: &str| text.split(',').map(|part| part.trim().parse().ok()).collect::<Option<Vec<i64>>>();
    let behind_comma = entry.value.split_once(',').and_then(|(_, rest)| numbers(rest));
    let behind_blank = entry.value.rsplit_once(' ').and_then(|(_, rest)| numbers(rest));
    let prefix = entry.name.trim_end_matches("_definition");
    let own: i64 = prefix.trim_start_matches("node_").parse().ok()?;
    let read = |parts: Vec<i64>| {
        let (id, kind, above, drawn) = (*parts.first()?, kind(*parts.get(1)?)?, *parts.get(2)?, *parts.get(3)?);
        let order = parts.get(4).copied().unwrap_or(0);
        (id == own && parts.len() <= 5).then(|| Definition { id, kind, above, drawn, order, prefix: prefix.into() })
    };
    behind_comma.and_then(read).or_else(|| behind_blank.and_then(read))
}

fn kind(code: i64) -> Option<Kind> {
    Some(match code {
        1 => Kind::Formula,
        2 => Kind::Primitive,
        10 => Kind::Hybrid,
        11 => Kind::Joined(Join::Or),
        12 => Kind::Joined(Join::And),
        13 => Kind::Joined(Join::Without),
        _ => return None,
    })
}

struct Builder<'a> {
    children: BTreeMap<i64, Vec<&'a Definition>>,
    settings: &'a mut Settings,
    /// Numbers of formulas that stand in the tree already.
    used: Vec<usize>,
}

impl Builder<'_> {
    /// The object of a definition with all below it; nothing for groups that are empty.
    fn node(&mut self, definition: &Definition, depth: usize, d: &mut Diagnostics) -> Option<Node> {
        if depth > MAX_DEPTH {
            d.push(Diagnostic::error(format!("the tree of objects is more than {MAX_DEPTH} deep")));
            return None;
        }
        let below = self.children.get(&definition.id).cloned().unwrap_or_default();
        match definition.kind {
            Kind::Formula => Some(Node::Formula(self.formula(definition, None))),
            Kind::Primitive => self.primitive(definition, d),
            Kind::Hybrid => {
                let formulas = below.iter().filter(|child| child.kind == Kind::Formula);
                let numbers: Vec<usize> = formulas.map(|child| self.formula(child, Some(&definition.prefix))).collect();
                (!numbers.is_empty()).then(|| Node::Hybrid(numbers, definition.prefix.clone()))
            }
            Kind::Joined(join) => {
                let nodes: Vec<Node> = below.iter().filter_map(|child| self.node(child, depth + 1, d)).collect();
                (!nodes.is_empty()).then(|| Node::Join(join, nodes, definition.prefix.clone()))
            }
        }
    }

    /// The number of a formula's section, which is a copy where the tree draws the same section twice.
    fn formula(&mut self, definition: &Definition, group: Option<&str>) -> usize {
        let section = definition.drawn.clamp(1, 999) as usize;
        let mut number = section;
        if self.used.contains(&section) {
            number = 1000 + self.used.len();
            let mut copy = self.settings.section(&format!("fractal_{section}"));
            copy.name = format!("fractal_{number}");
            self.settings.sections.push(copy);
            let of_section = format!("_{section}");
            self.copy(|name| {
                let stem = name.strip_suffix(&of_section).filter(|stem| OF_PLACE.contains(stem))?;
                Some(format!("{stem}_{number}"))
            });
        }
        self.used.push(number);
        for prefix in std::iter::once(definition.prefix.as_str()).chain(group) {
            for name in ["julia_mode", "julia_c", "fractal_constant_factor", "initial_waxis", "formula_maxiter"] {
                let of_node = format!("{prefix}_{name}");
                self.copy(|found| (found == of_node).then(|| format!("{name}_{number}")));
            }
        }
        for name in ["position", "rotation", "scale", "repeat", "material"] {
            let of_node = format!("{}_{name}", definition.prefix);
            let old = if name == "material" { "material_id" } else { name };
            self.copy(|found| (found == of_node).then(|| format!("formula_{old}_{number}")));
        }
        number
    }

    /// Adds settings under other names.
    fn copy(&mut self, renamed: impl Fn(&str) -> Option<String>) {
        let main = self.settings.section_mut("main_parameters");
        let copies: Vec<Entry> = main
            .entries
            .iter()
            .filter(|entry| !entry.name.ends_with("_definition"))
            .filter_map(|entry| Some(Entry { name: renamed(&entry.name)?, ..entry.clone() }))
            .collect();
        for copy in copies {
            if let Some(at) = main.entries.iter().position(|entry| renamed(&entry.name).as_deref() == Some(&copy.name))
            {
                let original = main.entries[at].name.clone();
                main.raw(&original);
            }
            if !main.has(&copy.name) {
                main.entries.push(copy);
            }
        }
    }

    fn primitive(&mut self, definition: &Definition, d: &mut Diagnostics) -> Option<Node> {
        let main = self.settings.section_mut("main_parameters");
        let drawn = definition.drawn.to_string();
        let found = main.entries.iter().find(|entry| {
            entry.name.starts_with("primitive_") && entry.name.ends_with("_object_id") && entry.value == drawn
        });
        let Some(entry) = found else {
            let definition = format!("{}_definition", definition.prefix);
            let span = main.raw(&definition).map(|entry| entry.span);
            let message = "an object of the tree is a primitive that the file does not describe";
            let diagnostic = Diagnostic::error(message).help(format!("no `primitive_..._object_id {drawn};` is there"));
            d.push(match span {
                Some(span) => diagnostic.label(span, "this object"),
                None => diagnostic,
            });
            return None;
        };
        let name = entry.name.clone();
        main.raw(&name);
        Some(Node::Primitive(name.trim_end_matches("_object_id").to_string(), definition.prefix.clone()))
    }
}
