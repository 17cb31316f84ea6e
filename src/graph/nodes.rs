//! Reading nodes: `step_name(parameter: value)` is a step, a capitalised name one of the kinds below.

use super::read::{Kind, Reader};
use super::{
    Condition, Constant, EndShape, Join, Levels, NO_ESCAPE, NodeKind, NodeRef, OrbitSettings, ParamInput, Placement,
    Primitive, SphereForm, Tiling,
};
use crate::diag::Diagnostic;
use crate::formula::decode::{Fields, wrong_type};
use crate::formula::script::{Spot, to_value};
use crate::formula::step::{ParamKind, ParamValue, StepParam, decode_param, unknown_param};
use crate::formula::value::{Name, Value, ValueKind};

/// Kinds of node other than steps.
pub(super) const KEYWORDS: &[&str] = &[
    "Sequence",
    "Repeat",
    "Blend",
    "Choose",
    "Between",
    "Alternate",
    "Item",
    "Orbit",
    "Levels",
    "Sphere",
    "Box",
    "Torus",
    "Plane",
    "Cylinder",
    "Union",
    "Intersection",
    "Difference",
    "SmoothUnion",
    "Transform",
    "Warp",
    "Tile",
];

impl Reader<'_> {
    /// Reads what a node is.
    pub(super) fn node_kind(&mut self, value: &Value) -> Kind {
        let Some(name) = value.name() else {
            wrong_type(value, "a node such as `box_fold(limit: 1.0)` or `Sequence([...])`", self.d);
            return None;
        };
        if !KEYWORDS.contains(&name.text.as_str()) {
            return self.step(name, value);
        }
        match &value.kind {
            ValueKind::Tuple { items, .. } if !items.is_empty() => self.tuple_node(name, items, value),
            ValueKind::Tuple { .. } | ValueKind::Struct { .. } => self.struct_node(name, value),
            _ => {
                self.d.push(
                    Diagnostic::error(format!("`{}` needs its parts", name.text))
                        .label(value.span, "write its parts in brackets"),
                );
                None
            }
        }
    }

    fn step(&mut self, name: &Name, value: &Value) -> Kind {
        let Some(step) = self.library.step(&name.text).cloned() else {
            if !self.library.is_broken(&name.text) {
                self.unknown_node(name);
            }
            return None;
        };
        let fields: &[(Name, Value)] = match &value.kind {
            ValueKind::Struct { fields, .. } => fields,
            ValueKind::Tuple { items, .. } if !items.is_empty() => {
                let message = format!("the parameters of `{}` need their names", step.name);
                let help = match step.params.first() {
                    Some(param) => format!("write `{}({}: ...)`", step.name, param.name),
                    None => format!("it has none: write `{}()`", step.name),
                };
                self.d.push(Diagnostic::error(message).label(value.span, "").help(help));
                return None;
            }
            _ => &[],
        };
        for (name, _) in fields {
            if step.param(&name.text).is_none() {
                self.d.push(unknown_param(&name.text, name.span, &step.params));
            }
        }
        let params: Vec<Option<ParamInput>> = step
            .params
            .iter()
            .map(|param| match fields.iter().find(|(n, _)| n.text == param.name) {
                Some((_, value)) => self.param_input(param, value),
                None => Some(ParamInput::Known(param.default.clone())),
            })
            .collect();
        let params = params.into_iter().collect::<Option<Vec<_>>>()?;
        Some(if step.is_shape() { NodeKind::Shape { step, params } } else { NodeKind::Step { step, params } })
    }

    /// A parameter: a plain value, or an expression of the fractal's parameters and the iteration number `n`.
    pub(super) fn param_input(&mut self, param: &StepParam, value: &Value) -> Option<ParamInput> {
        let resolved = match (&value.kind, &param.kind) {
            (ValueKind::Str(_), ParamKind::Choice(_)) => value.clone(),
            (ValueKind::Str(text), _) => {
                let mut scope = self.scope();
                if is_of_iteration(text) {
                    scope.push_constant("n", 0.0);
                }
                match self.library.engine.expression(text, &mut scope) {
                    Ok(result) => to_value(&result, &Spot::One(value.span)),
                    Err(error) => {
                        self.bad_expression(error, value.span);
                        return None;
                    }
                }
            }
            (ValueKind::Tuple { name: None, items } | ValueKind::List(items), ParamKind::Vec3 | ParamKind::Point) => {
                let items = items.iter().map(|item| self.evaluated(item)).collect::<Option<Vec<_>>>()?;
                Value::new(value.span, ValueKind::List(items))
            }
            _ => value.clone(),
        };
        let known = decode_param(param, &resolved, self.d)?;
        match &value.kind {
            ValueKind::Str(text) if is_of_iteration(text) && matches!(known, ParamValue::Number(_)) => {
                Some(ParamInput::OfIteration(text.clone()))
            }
            _ => Some(ParamInput::Known(known)),
        }
    }

    fn evaluated(&mut self, value: &Value) -> Option<Value> {
        match value.kind {
            ValueKind::Str(_) => {
                let number = self.number(value, f64::MIN, f64::MAX)?;
                Some(Value::new(value.span, ValueKind::Number(number)))
            }
            _ => Some(value.clone()),
        }
    }

    fn tuple_node(&mut self, name: &Name, items: &[Value], value: &Value) -> Kind {
        let [list] = items else {
            self.d.push(
                Diagnostic::error(format!("`{}` has the wrong form", name.text))
                    .label(value.span, "")
                    .help(form_of(&name.text)),
            );
            return None;
        };
        match name.text.as_str() {
            "Sequence" => self.wires(list).map(NodeKind::Sequence),
            "Union" => self.wires(list).map(NodeKind::Union),
            "Intersection" => self.wires(list).map(NodeKind::Intersection),
            "Alternate" => self.turns(list).map(NodeKind::Alternate),
            other => {
                self.d.push(
                    Diagnostic::error(format!("`{other}` has the wrong form"))
                        .label(value.span, "")
                        .help(form_of(other)),
                );
                None
            }
        }
    }

    /// `["a", ("b", 2)]`: nodes, with the number of iterations of each turn.
    fn turns(&mut self, list: &Value) -> Option<Vec<(NodeRef, u32)>> {
        let ValueKind::List(items) = &list.kind else {
            wrong_type(list, "a list of maps and repeats such as [(\"a\", 2), (\"b\", 1)]", self.d);
            return None;
        };
        if items.is_empty() {
            self.d.push(Diagnostic::error("the list of turns is empty").label(list.span, ""));
            return None;
        }
        let turns: Vec<Option<(NodeRef, u32)>> = items
            .iter()
            .map(|item| match &item.kind {
                // Scripts write turns as lists of two.
                ValueKind::Tuple { name: None, items } | ValueKind::List(items) if items.len() == 2 => {
                    let count = self.number(&items[1], 1.0, 1000.0);
                    Some((self.wire(&items[0])?, count? as u32))
                }
                _ => Some((self.wire(item)?, 1)),
            })
            .collect();
        turns.into_iter().collect()
    }

    fn struct_node(&mut self, name: &Name, value: &Value) -> Kind {
        let mut fields = Fields::new(value, "this node", self.d)?;
        let kind = match name.text.as_str() {
            "Repeat" => {
                let of = self.required_wire(&mut fields, "of");
                let times = self.required_number(&mut fields, "times", 0.0, 100.0);
                self.build(|| Some(NodeKind::Repeat { of: of?, times: times? as u32 }))
            }
            "Blend" => {
                let a = fields.optional_value("a").map(|v| self.wire(v));
                let b = self.required_wire(&mut fields, "b");
                let weight = self.required_number(&mut fields, "weight", -10.0, 10.0);
                self.build(|| {
                    Some(NodeKind::Blend { a: a.map_or(Some(None), |a| a.map(Some))?, b: b?, weight: weight? })
                })
            }
            "Choose" => self.choose(&mut fields),
            "Between" => {
                let of = self.required_wire(&mut fields, "of");
                let from = fields.optional_value("from").map_or(Some(0.0), |v| self.number(v, 0.0, 1e6));
                let to = fields.optional_value("to").map_or(Some(1e6), |v| self.number(v, 0.0, 1e6));
                let otherwise = fields.optional_value("otherwise").map(|v| self.wire(v));
                self.build(|| {
                    let otherwise = otherwise.map_or(Some(None), |o| o.map(Some))?;
                    Some(NodeKind::Between { of: of?, from: from? as u32, to: to? as u32, otherwise })
                })
            }
            "Item" => {
                let of = self.required_wire(&mut fields, "of");
                let outer = self.four;
                let constant = fields.optional_value("constant").and_then(|v| self.constant(v));
                self.four = outer;
                if constant.is_none() {
                    self.d.push(
                        Diagnostic::error("`Item` needs a `constant`").label(fields.span(), "").help(form_of("Item")),
                    );
                }
                self.build(|| Some(NodeKind::Item { of: of?, constant: constant? }))
            }
            "Orbit" => {
                let of = self.required_wire(&mut fields, "of");
                let settings = self.orbit_settings(&mut fields, &super::OrbitSettings::default());
                self.build(|| Some(NodeKind::Orbit { of: of?, settings: Box::new(settings) }))
            }
            "Levels" => self.levels(&mut fields),
            "Difference" => {
                let (a, b) = (self.required_wire(&mut fields, "a"), self.required_wire(&mut fields, "b"));
                self.build(|| Some(NodeKind::Difference { a: a?, b: b? }))
            }
            "SmoothUnion" => {
                let of = fields.optional_value("of").and_then(|v| self.wires(v));
                let radius = self.required_number(&mut fields, "radius", 1e-6, 1e6);
                if of.is_none() {
                    self.d.push(
                        Diagnostic::error("`SmoothUnion` needs its parts")
                            .label(fields.span(), "")
                            .help(form_of("SmoothUnion")),
                    );
                }
                self.build(|| Some(NodeKind::SmoothUnion { of: of?, radius: radius? }))
            }
            "Transform" => self.transform(&mut fields),
            "Warp" => {
                let (of, by) = (self.required_wire(&mut fields, "of"), self.required_wire(&mut fields, "by"));
                self.build(|| Some(NodeKind::Warp { of: of?, by: by? }))
            }
            "Tile" => self.tile(&mut fields),
            "Sphere" | "Box" | "Torus" | "Plane" | "Cylinder" => {
                self.primitive(&name.text, &mut fields).map(NodeKind::Primitive)
            }
            other => {
                self.d.push(
                    Diagnostic::error(format!("`{other}` has the wrong form"))
                        .label(value.span, "")
                        .help(form_of(other)),
                );
                return None;
            }
        };
        fields.finish(self.d);
        kind
    }

    /// Makes a node of parts that may be missing, after all its fields were read and their errors reported.
    fn build(&self, make: impl FnOnce() -> Kind) -> Kind {
        make()
    }

    pub(super) fn required_number(
        &mut self,
        fields: &mut Fields,
        name: &'static str,
        min: f64,
        max: f64,
    ) -> Option<f64> {
        match fields.optional_value(name) {
            Some(value) => self.number(value, min, max),
            None => {
                self.d
                    .push(Diagnostic::error(format!("the field `{name}` is missing")).label(fields.span(), "a number"));
                None
            }
        }
    }

    fn levels(&mut self, fields: &mut Fields) -> Kind {
        let of = self.required_wire(fields, "of");
        let field = self.required_wire(fields, "shape");
        let from = fields.optional_value("from").map_or(Some(0.0), |v| self.number(v, 0.0, 1000.0));
        let to = self.required_number(fields, "to", 1.0, 1000.0);
        let join = fields.optional_value("join").map_or(Some(Join::Union), |v| self.join(v));
        let span = fields.span();
        let base = OrbitSettings { constant: Constant::Off, escape_radius: NO_ESCAPE, ..OrbitSettings::default() };
        let mut settings = self.orbit_settings(fields, &base);
        let (from, to) = (from? as u32, to? as u32);
        if from >= to {
            let message = "there are no levels: `from` is not below `to`";
            self.d.push(Diagnostic::error(message).label(span, format!("levels {from} to {to}, without the last")));
            return None;
        }
        settings.max_iterations = to - 1;
        settings.shape = Some(EndShape { field: field?, levels: Some(Levels { from, join: join? }) });
        Some(NodeKind::Orbit { of: of?, settings: Box::new(settings) })
    }

    /// `Union`, `Intersection`, `Difference` or `SmoothUnion(radius)`.
    fn join(&mut self, value: &Value) -> Option<Join> {
        match &value.kind {
            ValueKind::Variant(name) if name.text == "Union" => return Some(Join::Union),
            ValueKind::Variant(name) if name.text == "Intersection" => return Some(Join::Intersection),
            ValueKind::Variant(name) if name.text == "Difference" => return Some(Join::Difference),
            ValueKind::Tuple { name: Some(name), items } if name.text == "SmoothUnion" && items.len() == 1 => {
                return self.number(&items[0], 1e-6, 1e6).map(Join::SmoothUnion);
            }
            _ => {}
        }
        wrong_type(value, "a join: Union, Intersection, Difference or SmoothUnion(radius)", self.d);
        None
    }

    fn choose(&mut self, fields: &mut Fields) -> Kind {
        let when = fields.optional_value("when").and_then(|v| self.condition(v));
        if when.is_none() {
            let help = "conditions are: IterationBelow(n), IterationEvery(n), RadiusBelow(r), RadiusAbove(r), Negative(\"x\"), Positive(\"x\")";
            self.d.push(Diagnostic::error("`Choose` needs a condition in `when`").label(fields.span(), "").help(help));
        }
        let then = self.required_wire(fields, "then");
        let otherwise = fields.optional_value("otherwise").map(|v| self.wire(v));
        let otherwise = otherwise.map_or(Some(None), |o| o.map(Some))?;
        Some(NodeKind::Choose { when: when?, then: then?, otherwise })
    }

    fn condition(&mut self, value: &Value) -> Option<Condition> {
        let ValueKind::Tuple { name: Some(name), items } = &value.kind else {
            return None;
        };
        let [argument] = items.as_slice() else {
            return None;
        };
        let axis = |reader: &mut Self| reader.word(argument, "coordinate", &[("x", 0), ("y", 1), ("z", 2), ("w", 3)]);
        Some(match name.text.as_str() {
            "IterationBelow" => Condition::IterationBelow(self.number(argument, 0.0, 1e6)? as u32),
            "IterationEvery" => Condition::IterationEvery(self.number(argument, 1.0, 1e6)? as u32),
            "RadiusBelow" => Condition::RadiusBelow(self.number(argument, 0.0, 1e6)?),
            "RadiusAbove" => Condition::RadiusAbove(self.number(argument, 0.0, 1e6)?),
            "Negative" => Condition::Negative(axis(self)?),
            "Positive" => Condition::Positive(axis(self)?),
            _ => return None,
        })
    }

    fn transform(&mut self, fields: &mut Fields) -> Kind {
        let of = self.required_wire(fields, "of");
        let outer = self.four;
        let translate = fields.optional_value("translate").map_or(Some([0.0; 4]), |v| self.point(v));
        self.four = outer;
        let axis = fields.optional_value("axis").map_or(Some([0.0, 0.0, 1.0]), |v| self.direction(v));
        let angle = fields.optional_value("angle").map_or(Some(0.0), |v| self.number(v, -3600.0, 3600.0));
        let scale = fields.optional_value("scale").map_or(Some(1.0), |v| self.number(v, 1e-6, 1e6));
        let placement = Placement { translate: translate?, axis: axis?, angle: angle?.to_radians(), scale: scale? };
        Some(NodeKind::Transform { of: of?, placement })
    }

    fn tile(&mut self, fields: &mut Fields) -> Kind {
        let of = self.required_wire(fields, "of");
        let mirror = fields.or("mirror", false, self.d);
        let Some(value) = fields.optional_value("period") else {
            let message = "`Tile` needs a `period`";
            self.d.push(Diagnostic::error(message).label(fields.span(), "").help(form_of("Tile")));
            return None;
        };
        let period = self.vector(value, 0.0, 1e6)?;
        Some(NodeKind::Tile { of: of?, tiling: Tiling { period, mirror } })
    }

    fn primitive(&mut self, name: &str, fields: &mut Fields) -> Option<Primitive> {
        let length = |reader: &mut Self, fields: &mut Fields, field: &'static str, default: f64| {
            fields.optional_value(field).map_or(Some(default), |v| reader.number(v, 1e-9, 1e6))
        };
        if name == "Plane" {
            let normal = fields.optional_value("normal").map_or(Some([0.0, 0.0, 1.0]), |v| self.direction(v));
            let offset = fields.optional_value("offset").map_or(Some(0.0), |v| self.number(v, -1e6, 1e6));
            return Some(Primitive::Plane { normal: normal?, offset: offset? });
        }
        let centre = fields.optional_value("centre").map_or(Some([0.0; 3]), |v| self.vector(v, -1e6, 1e6))?;
        Some(match name {
            "Sphere" => {
                let forms =
                    [("signed", SphereForm::Signed), ("solid", SphereForm::Solid), ("shell", SphereForm::Shell)];
                let form = fields
                    .optional_value("form")
                    .map_or(Some(SphereForm::Signed), |v| self.word(v, "form of a sphere", &forms));
                Primitive::Sphere { centre, radius: length(self, fields, "radius", 1.0)?, form: form? }
            }
            "Box" => {
                let size = fields.optional_value("half_size").map_or(Some([1.0; 3]), |v| self.vector(v, 1e-9, 1e6));
                Primitive::Box { centre, half_size: size? }
            }
            "Torus" => Primitive::Torus {
                centre,
                major: length(self, fields, "major", 1.0)?,
                minor: length(self, fields, "minor", 0.25)?,
            },
            _ => Primitive::Cylinder {
                centre,
                radius: length(self, fields, "radius", 0.5)?,
                half_height: length(self, fields, "half_height", 1.0)?,
            },
        })
    }
}

/// True for an expression that mentions the iteration number `n`.
fn is_of_iteration(text: &str) -> bool {
    text.split(|c: char| !(c.is_alphanumeric() || c == '_')).any(|word| word == "n")
}

/// How a kind of node is written.
pub(super) fn form_of(name: &str) -> String {
    let form = match name {
        "Sequence" => "Sequence([\"fold\", \"scale\"])",
        "Repeat" => "Repeat(of: \"fold\", times: 3)",
        "Blend" => "Blend(a: \"fold\", b: \"bulb\", weight: 0.5)",
        "Choose" => "Choose(when: RadiusBelow(1.0), then: \"a\", otherwise: \"b\")",
        "Between" => "Between(of: \"menger\", from: 0, to: 4, otherwise: \"bulb\")",
        "Alternate" => "Alternate([(\"box\", 2), (\"bulb\", 1)])",
        "Item" => "Item(of: \"menger\", constant: Off)",
        "Orbit" => "Orbit(of: \"loop\", max_iterations: 12)",
        "Levels" => "Levels(of: \"loop\", shape: \"box\", from: 0, to: 6, join: Union)",
        "Sphere" => "Sphere(centre: (0, 0, 0), radius: 1.0, form: signed)",
        "Box" => "Box(centre: (0, 0, 0), half_size: (1, 1, 1))",
        "Torus" => "Torus(major: 1.0, minor: 0.25)",
        "Plane" => "Plane(normal: (0, 0, 1), offset: 0.0)",
        "Cylinder" => "Cylinder(radius: 0.5, half_height: 1.0)",
        "Union" => "Union([\"bulb\", \"floor\"])",
        "Intersection" => "Intersection([\"bulb\", \"ball\"])",
        "Difference" => "Difference(a: \"bulb\", b: \"ball\")",
        "SmoothUnion" => "SmoothUnion(of: [\"bulb\", \"ball\"], radius: 0.1)",
        "Warp" => "Warp(of: \"bulb\", by: \"twist\")",
        "Tile" => "Tile(of: \"ball\", period: (2, 2, 0), mirror: false)",
        _ => "Transform(of: \"bulb\", translate: (1, 0, 0), axis: (0, 0, 1), angle: 30, scale: 0.5)",
    };
    format!("write `{form}`")
}
