//! Objects of a scene: whole formulas, each with its own parameters, place and paint, as fields of one graph.
//!
//! `objects: {"flower": (fractal: "mandelbulb", set: {"power": 5.0}, at: (1, 0, 0), material: "gold"), "floor": (field: Plane())}`.
//! Formulas are loaded before the graph is read ([`wanted`]); reading takes their nodes over ([`Imports`]).

use std::collections::HashMap;
use std::sync::Arc;

use super::overrides::Override;
use super::presets::PRESET;
use super::read::Reader;
use super::scene::{Paint, Part, TRAPS, Trap, read_paint};
use super::{Graph, Node, NodeKind, NodeRef, ParamInput, Placement, Primitive, SphereForm, ValidGraph};
use crate::colour::Panorama;
use crate::diag::{Diagnostic, Diagnostics, Span};
use crate::formula::decode::{Fields, entries};
use crate::formula::value::{Name, Value, ValueKind};

/// What a file names beside itself.
#[derive(Default)]
pub struct Imports {
    /// Formulas that objects name, by the objects' names.
    pub formulas: HashMap<String, Arc<ValidGraph>>,
    /// The picture that surrounds everything. Without it surroundings that are one are left out.
    pub panorama: Option<Arc<Panorama>>,
}

/// Objects that a scene may have.
pub const MOST_OBJECTS: usize = 64;

/// A formula that an object names.
pub struct Wanted {
    /// Name of the object.
    pub object: String,
    /// Name of a built-in fractal or a file, relative to the scene's.
    pub formula: String,
    /// Place of that name.
    pub span: Span,
    /// What is changed in it.
    pub changes: Vec<Override>,
}

/// The formulas that the objects of a file name. What is wrong with them is told when the file is read.
pub fn wanted(value: &Value) -> Vec<Wanted> {
    let Some(objects) = field(value, "objects") else { return Vec::new() };
    let objects = entries(objects, "objects", &mut Diagnostics::default());
    let of_object = |(name, value): (Name, &Value)| {
        let formula = field(value, "fractal")?;
        let ValueKind::Str(text) = &formula.kind else { return None };
        let mut changes = Vec::new();
        if let Some(preset) = field(value, "preset") {
            changes.push(Override { path: PRESET.into(), value: preset.clone() });
        }
        if let Some(set) = field(value, "set") {
            let set = entries(set, "values", &mut Diagnostics::default());
            changes.extend(set.into_iter().map(|(path, value)| Override { path: path.text, value: value.clone() }));
        }
        Some(Wanted { object: name.text, formula: text.clone(), span: formula.span, changes })
    };
    objects.into_iter().take(MOST_OBJECTS).filter_map(of_object).collect()
}

/// A field of a struct.
pub(super) fn field<'v>(value: &'v Value, name: &str) -> Option<&'v Value> {
    match &value.kind {
        ValueKind::Struct { fields, .. } => fields.iter().find(|(field, _)| field.text == name).map(|(_, value)| value),
        _ => None,
    }
}

/// What objects add to a graph besides their nodes.
#[derive(Default)]
pub(super) struct Objects {
    /// Their nodes.
    pub shown: Vec<NodeRef>,
    /// Their paints.
    pub parts: Vec<Part>,
    /// Traps that they need and the file does not give.
    pub traps: Option<[Option<Trap>; 4]>,
}

impl Reader<'_> {
    /// Makes the names of objects known, so that nodes can be wired to them.
    pub(super) fn declare_objects(&mut self, objects: &[(Name, &Value)]) {
        if objects.len() > MOST_OBJECTS {
            let message = format!("a scene may have {MOST_OBJECTS} objects, this one has {}", objects.len());
            self.d.push(Diagnostic::error(message).label(objects[MOST_OBJECTS].0.span, ""));
        }
        for (name, _) in objects {
            self.declare_one(name);
        }
    }

    /// Reads objects into the nodes that were declared for them, from number `first` on.
    pub(super) fn read_objects(&mut self, first: usize, objects: &[(Name, &Value)], imports: &Imports) -> Objects {
        let mut all = Objects::default();
        for (i, (name, value)) in objects.iter().take(MOST_OBJECTS).enumerate() {
            let slot = first + i;
            if let Some((kind, paint)) = self.read_object(name, value, imports, &mut all) {
                self.fill(slot, Node { name: name.text.clone(), span: value.span, kind });
                all.shown.push(NodeRef(slot));
                all.parts.push(Part { node: NodeRef(slot), span: name.span, paint });
            }
        }
        all
    }

    fn read_object(
        &mut self,
        name: &Name,
        value: &Value,
        imports: &Imports,
        all: &mut Objects,
    ) -> Option<(NodeKind, Paint)> {
        let mut fields = Fields::new(value, "an object", self.d)?;
        let (fractal, own) = (fields.optional_value("fractal"), fields.optional_value("field"));
        let (_, _) = (fields.optional_value("set"), fields.optional_value("preset"));
        let (of, base) = match (fractal, own) {
            (Some(_), None) => {
                let graph = imports.formulas.get(&name.text)?;
                if all.traps.is_none() && graph.scene.look.traps != TRAPS {
                    all.traps = Some(graph.scene.look.traps);
                }
                (Some(self.take_over(&name.text, graph)), graph.scene.look.paint.clone())
            }
            (None, Some(field)) => {
                self.enter(&name.text);
                let of = self.wire(field);
                self.leave();
                (of, Paint::default())
            }
            _ => {
                let help = "write `(fractal: \"mandelbulb\")` or `(field: Sphere(radius: 1.0))`";
                let message = format!("the object `{}` is one fractal or one field", name.text);
                self.d.push(Diagnostic::error(message).label(value.span, "").help(help));
                (None, Paint::default())
            }
        };
        let translate = fields.optional_value("at").map_or(Some([0.0; 3]), |v| self.vector(v, -1e6, 1e6));
        let axis = fields.optional_value("axis").map_or(Some([0.0, 0.0, 1.0]), |v| self.direction(v));
        let angle = fields.optional_value("angle").map_or(Some(0.0), |v| self.number(v, -3600.0, 3600.0));
        let scale = fields.optional_value("scale").map_or(Some(1.0), |v| self.number(v, 1e-6, 1e6));
        let paint = read_paint(self, &mut fields, &base);
        fields.finish(self.d);
        let ([x, y, z], axis, angle, scale) = (translate?, axis?, angle?.to_radians(), scale?);
        let placement = Placement { translate: [x, y, z, 0.0], axis, angle, scale };
        Some((NodeKind::Transform { of: of?, placement }, paint?))
    }

    /// Takes the nodes of a formula over. Gives its output.
    fn take_over(&mut self, object: &str, graph: &Graph) -> NodeRef {
        let first = self.count();
        let place = |node: NodeRef| NodeRef(node.0 + first);
        for node in &graph.nodes {
            let mut node = Node { name: format!("{object}/{}", node.name), ..node.clone() };
            node.kind.rewire(place);
            settle_params(&mut node.kind, graph);
            self.add(node);
        }
        let output = place(graph.output);
        let Some(radius) = graph.bounding_radius.filter(|_| graph.cuts) else { return output };
        // What the formula cuts off stays cut off.
        let span = graph.node(graph.output).span;
        let ball = Primitive::Sphere { centre: [0.0; 3], radius, form: SphereForm::Signed };
        let ball = self.add(Node { name: format!("{object}/bounds"), span, kind: NodeKind::Primitive(ball) });
        self.add(Node { name: format!("{object}/cut"), span, kind: NodeKind::Intersection(vec![output, ball]) })
    }
}

/// Puts the values of a formula's parameters into expressions of the iteration number, since the scene does not know them.
fn settle_params(kind: &mut NodeKind, graph: &Graph) {
    let (NodeKind::Step { params, .. } | NodeKind::Shape { params, .. }) = kind else { return };
    for param in params {
        let ParamInput::OfIteration(text) = param else { continue };
        for known in &graph.params {
            *text = replaced(text, &known.name, known.value);
        }
    }
}

/// A text with a number instead of a word.
fn replaced(text: &str, word: &str, number: f64) -> String {
    let is_part = |c: char| c.is_alphanumeric() || c == '_';
    let mut result = String::new();
    let mut rest = text;
    while let Some(at) = rest.find(word) {
        let (before, after) = (&rest[..at], &rest[at + word.len()..]);
        let is_whole = !before.ends_with(is_part) && !after.starts_with(is_part) && !before.ends_with('.');
        result.push_str(before);
        match is_whole {
            true => result.push_str(&format!("({number:?})")),
            false => result.push_str(word),
        }
        rest = after;
    }
    result + rest
}

impl NodeKind {
    /// Replaces every wire.
    fn rewire(&mut self, place: impl Fn(NodeRef) -> NodeRef) {
        let one = |node: &mut NodeRef| *node = place(*node);
        match self {
            NodeKind::Step { .. } | NodeKind::Primitive(_) | NodeKind::Shape { .. } => {}
            NodeKind::Sequence(of)
            | NodeKind::Union(of)
            | NodeKind::Intersection(of)
            | NodeKind::SmoothUnion { of, .. } => of.iter_mut().for_each(one),
            NodeKind::Repeat { of, .. }
            | NodeKind::Item { of, .. }
            | NodeKind::Transform { of, .. }
            | NodeKind::Tile { of, .. } => one(of),
            NodeKind::Warp { of, by } => [of, by].into_iter().for_each(one),
            NodeKind::Orbit { of, settings } => {
                one(of);
                settings.pre.iter_mut().chain(&mut settings.post).for_each(one);
                if let Some(shape) = &mut settings.shape {
                    one(&mut shape.field);
                }
            }
            NodeKind::Blend { a, b, .. } => a.iter_mut().chain([b]).for_each(one),
            NodeKind::Choose { then, otherwise, .. } => [then].into_iter().chain(otherwise).for_each(one),
            NodeKind::Between { of, otherwise, .. } => [of].into_iter().chain(otherwise).for_each(one),
            NodeKind::Alternate(parts) => parts.iter_mut().for_each(|(of, _)| one(of)),
            NodeKind::Difference { a, b } => [a, b].into_iter().for_each(one),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::replaced;

    #[test]
    fn whole_words_alone_are_replaced() {
        assert_eq!(replaced("a + ab * a.b - ba", "a", 2.5), "(2.5) + ab * (2.5).b - ba");
        assert_eq!(replaced("n * scale", "scale", -1.0), "n * (-1.0)");
    }
}
