//! What surfaces are made of: a palette that traps mix, gradients placed by what an orbit says, and materials.

use std::fmt;
use std::sync::Arc;

use super::fields::read_palette;
use super::traps::{TRAPS, Trap};
use crate::colour::{Gradient, palettes, read_stops};
use crate::diag::{Diagnostic, Span};
use crate::formula::decode::{Fields, wrong_type};
use crate::formula::material::{Material, Study};
use crate::formula::step::{ParamValue, unknown_param};
use crate::formula::value::{Name, Value, ValueKind};
use crate::graph::ParamInput;
use crate::graph::read::Reader;

/// Base colour, and those that the traps blend in. Colours are linear RGB.
pub type Palette = [[f64; 3]; 5];

/// Most layers of colour.
pub const MOST_LAYERS: usize = 6;

/// How a surface gets its colour, and what it is made of.
#[derive(Clone, PartialEq, Debug)]
pub struct Paint {
    /// What the traps mix where there is no layer.
    pub palette: Palette,
    /// Gradients, the first at the bottom.
    pub layers: Vec<Layer>,
    /// What the colour goes into.
    pub material: Option<MaterialUse>,
}

impl Default for Paint {
    fn default() -> Self {
        Paint {
            palette: [
                [0.72, 0.68, 0.60],
                [0.75, 0.36, 0.12],
                [0.10, 0.33, 0.55],
                [0.82, 0.58, 0.20],
                [0.30, 0.46, 0.28],
            ],
            layers: Vec::new(),
            material: None,
        }
    }
}

/// A gradient, and what decides about the place in it.
#[derive(Clone, PartialEq, Debug)]
pub struct Layer {
    /// Its name, where it is a preset.
    pub name: String,
    /// Its colours.
    pub gradient: Gradient,
    /// What of a surface is looked at.
    pub by: By,
    /// How that becomes a place in the gradient.
    pub spread: Spread,
    /// How it goes over the layers below.
    pub blend: Blend,
    /// How much of it does, from 0 to 1.
    pub weight: f64,
}

/// A number that each point of a surface has.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum By {
    /// Least distance of the orbit from the trap of this number; of traps that are no distances, what they hold.
    Trap(u8),
    /// Number of the iteration, from 1, that came nearest to it.
    Caught(u8),
    /// Where on it that was: the share of a turn around it, or the place along a line.
    Where(u8),
    /// Iterations.
    Iterations,
    /// The same without steps.
    Smooth,
    /// Length of the orbit's last point.
    Radius,
    /// Distance of the point from the origin of its part.
    Distance,
    /// Place of the point along a unit vector.
    Position([f64; 3]),
    /// Cosine of the angle between the normal and a unit vector.
    Normal([f64; 3]),
    /// Cosine of the angle between the normal and the way to the viewer.
    Facing,
}

/// How a number becomes a place in a gradient.
#[derive(Clone, PartialEq, Debug)]
pub enum Spread {
    /// The gradient lies between two numbers.
    Value(f64, f64),
    /// The gradient is used up evenly by what the view shows. The numbers cut what was seen into equal shares; there are none
    /// before the view was looked at.
    Quantile(Vec<f64>),
    /// The gradient comes again and again: after so much, and begun at this share of it.
    Cyclic(f64, f64),
}

/// How a layer goes over those below.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Blend {
    /// It covers them.
    Mix,
    /// It darkens them.
    Multiply,
    /// It lightens them.
    Add,
}

/// A material with its parameters.
#[derive(Clone)]
pub struct MaterialUse {
    /// The material.
    pub material: Arc<Material>,
    /// Parameters that differ from the defaults.
    pub params: Vec<(String, ParamValue)>,
    /// What it reads and returns with them.
    pub study: Study,
}

impl PartialEq for MaterialUse {
    fn eq(&self, other: &MaterialUse) -> bool {
        let of = |used: &MaterialUse| (used.material.name.clone(), used.material.text);
        of(self) == of(other) && self.params == other.params
    }
}

impl fmt::Debug for MaterialUse {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}{:?}", self.material.name, self.params)
    }
}

impl Paint {
    /// The layers that anything shows.
    pub fn shown_layers(&self) -> &[Layer] {
        let reads = |input| self.material.as_ref().is_none_or(|used| used.study.reads(input));
        if reads("colour") || reads("tone") { &self.layers } else { &[] }
    }

    /// Whether it depends on the least distances from traps.
    pub fn reads_traps(&self, traps: &[Option<Trap>; 4]) -> bool {
        let shows = self.material.as_ref().is_none_or(|used| used.study.reads("colour"));
        let mixes = || (0..4).any(|i| traps[i].is_some() && self.palette[i + 1] != self.palette[0]);
        let by = |layer: &Layer| matches!(layer.by, By::Trap(_) | By::Caught(_) | By::Where(_));
        let reads = |name| self.material.as_ref().is_some_and(|used| used.study.reads(name));
        (self.layers.is_empty() && shows && mixes())
            || self.shown_layers().iter().any(by)
            || ["traps", "caught", "places"].into_iter().any(reads)
    }
}

/// What orbits have to note for colours and matter besides their traps.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Marks {
    /// The iteration that came nearest to each trap.
    pub caught: [bool; 4],
    /// Where on the trap that was.
    pub places: [bool; 4],
    /// The count of iterations without steps.
    pub smooth: bool,
    /// The length of the last point.
    pub radius: bool,
}

impl Marks {
    /// These, and those of a paint.
    pub fn with(mut self, paint: &Paint) -> Marks {
        for layer in paint.shown_layers() {
            match layer.by {
                By::Caught(i) => self.caught[usize::from(i)] = true,
                By::Where(i) => self.places[usize::from(i)] = true,
                By::Smooth => self.smooth = true,
                By::Radius => self.radius = true,
                _ => {}
            }
        }
        if let Some(study) = paint.material.as_ref().map(|used| &used.study) {
            self.caught = self.caught.map(|marked| marked || study.reads("caught"));
            self.places = self.places.map(|marked| marked || study.reads("places"));
            self.smooth |= study.reads("smooth");
            self.radius |= study.reads("radius");
        }
        self
    }
}

/// Reads `palette`, `colour` and `material`; what is not given is that of `base`.
pub(in crate::graph) fn read_paint(reader: &mut Reader, fields: &mut Fields, base: &Paint) -> Option<Paint> {
    let mut paint = base.clone();
    let (palette, colour) = (fields.optional_value("palette"), fields.optional_value("colour"));
    if let Some(value) = colour {
        paint.layers = read_layers(reader, value)?;
    }
    match palette {
        Some(value) if matches!(value.kind, ValueKind::List(_)) => {
            paint.palette = read_palette(reader, value)?;
            if colour.is_none() {
                paint.layers.clear();
            }
        }
        Some(value) => {
            let (name, gradient) = read_gradient(reader, value)?;
            match paint.layers.first_mut() {
                Some(layer) => (layer.name, layer.gradient) = (name, gradient),
                None => paint.layers = vec![Layer::new(name, gradient)],
            }
        }
        None => {}
    }
    if let Some(value) = fields.optional_value("material") {
        paint.material = Some(read_material(reader, value)?);
    }
    Some(paint)
}

impl Layer {
    /// A layer by the distance from the first trap, used up evenly.
    pub(super) fn new(name: String, gradient: Gradient) -> Layer {
        let spread = Spread::Quantile(Vec::new());
        Layer { name, gradient, by: By::Trap(0), spread, blend: Blend::Mix, weight: 1.0 }
    }
}

/// Reads the name of a preset, a list of colours, or `Stops(colours: [...], cyclic: true)`.
fn read_gradient(reader: &mut Reader, value: &Value) -> Option<(String, Gradient)> {
    match &value.kind {
        ValueKind::Str(name) => {
            let found = palettes::named(name);
            if found.is_none() {
                let names = palettes::all().iter().map(|palette| palette.name.as_str());
                let message = format!("there is no palette `{name}`");
                let error = Diagnostic::error(message).label(value.span, "").did_you_mean(name, names);
                reader.d.push(error.help("`bulbfold list palettes` shows all; a file's is taken by `--palette FILE`"));
            }
            found.map(|palette| (name.clone(), palette.gradient.clone()))
        }
        ValueKind::Struct { name: Some(kind), .. } if kind.text == "Stops" => {
            let mut fields = Fields::new(value, "a gradient", reader.d)?;
            let is_cyclic = fields.or("cyclic", false, reader.d);
            let colours = fields.required::<Value>("colours", reader.d);
            fields.finish(reader.d);
            Some((String::new(), read_stops(&colours?, is_cyclic, reader.d)?))
        }
        ValueKind::List(_) => Some((String::new(), read_stops(value, false, reader.d)?)),
        _ => {
            let expected = "a palette: the name of one, a list of colours, or Stops(colours: [...], cyclic: true)";
            wrong_type(value, expected, reader.d);
            None
        }
    }
}

/// Reads one layer, or a list of them.
fn read_layers(reader: &mut Reader, value: &Value) -> Option<Vec<Layer>> {
    let ValueKind::List(items) = &value.kind else { return Some(vec![read_layer(reader, value)?]) };
    if items.is_empty() || items.len() > MOST_LAYERS {
        let message = format!("expected 1 to {MOST_LAYERS} layers of colour");
        reader.d.push(Diagnostic::error(message).label(value.span, format!("found {}", items.len())));
        return None;
    }
    items.iter().map(|item| read_layer(reader, item)).collect()
}

/// Reads `Gradient(palette: "ember", by: Trap(0), place: Quantile, blend: Mix, weight: 1.0)`.
fn read_layer(reader: &mut Reader, value: &Value) -> Option<Layer> {
    if value.name().is_none_or(|name| name.text != "Gradient") {
        let expected = "a layer such as `Gradient(palette: \"ember\", by: Smooth, place: Quantile)`";
        wrong_type(value, expected, reader.d);
        return None;
    }
    let mut fields = Fields::new(value, "a layer of colour", reader.d)?;
    let gradient = match fields.optional_value("palette") {
        Some(value) => read_gradient(reader, value),
        None => {
            reader.d.push(Diagnostic::error("a layer of colour needs a `palette`").label(fields.span(), ""));
            None
        }
    };
    let by = fields.optional_value("by").map_or(Some(By::Trap(0)), |value| read_by(reader, value));
    let spread =
        fields.optional_value("place").map_or(Some(Spread::Quantile(Vec::new())), |value| read_spread(reader, value));
    let blends = [("mix", Blend::Mix), ("multiply", Blend::Multiply), ("add", Blend::Add)];
    let blend =
        fields.optional_value("blend").map_or(Some(Blend::Mix), |value| reader.word(value, "way to blend", &blends));
    let weight = fields.optional_value("weight").map_or(Some(1.0), |value| reader.number(value, 0.0, 1.0));
    fields.finish(reader.d);
    let (name, gradient) = gradient?;
    Some(Layer { name, gradient, by: by?, spread: spread?, blend: blend?, weight: weight? })
}

/// What a layer can be placed by.
const BY: &str = "a layer is placed by: Trap(0), Caught(0), Where(0), Iterations, Smooth, Radius, Distance, Position((0, 0, 1)), \
                  Normal((0, 0, 1)) or Facing";

fn read_by(reader: &mut Reader, value: &Value) -> Option<By> {
    let name = value.name().map_or("", |name| name.text.as_str());
    match (name, &value.kind) {
        ("Iterations", ValueKind::Variant(_)) => Some(By::Iterations),
        ("Smooth", ValueKind::Variant(_)) => Some(By::Smooth),
        ("Radius", ValueKind::Variant(_)) => Some(By::Radius),
        ("Distance", ValueKind::Variant(_)) => Some(By::Distance),
        ("Facing", ValueKind::Variant(_)) => Some(By::Facing),
        ("Trap" | "Caught" | "Where", ValueKind::Tuple { items, .. }) if items.len() == 1 => {
            let most = TRAPS.len() as f64 - 1.0;
            let number = reader.number(&items[0], 0.0, most)? as u8;
            Some(match name {
                "Trap" => By::Trap(number),
                "Caught" => By::Caught(number),
                _ => By::Where(number),
            })
        }
        ("Position", ValueKind::Tuple { items, .. }) if items.len() == 1 => {
            reader.direction(&items[0]).map(By::Position)
        }
        ("Normal", ValueKind::Tuple { items, .. }) if items.len() == 1 => reader.direction(&items[0]).map(By::Normal),
        _ => {
            let message = format!("a layer cannot be placed by {}", value.describe());
            reader.d.push(Diagnostic::error(message).label(value.span, "").help(BY));
            None
        }
    }
}

fn read_spread(reader: &mut Reader, value: &Value) -> Option<Spread> {
    let name = value.name().map_or("", |name| name.text.as_str());
    let (least, most) = (-1e9, 1e9);
    match (name, &value.kind) {
        ("Quantile", ValueKind::Variant(_)) => Some(Spread::Quantile(Vec::new())),
        ("Value", ValueKind::Tuple { items, .. }) if items.len() == 2 => {
            let (from, to) = (reader.number(&items[0], least, most)?, reader.number(&items[1], least, most)?);
            if from == to {
                let message = "a gradient cannot lie between two equal numbers";
                reader.d.push(Diagnostic::error(message).label(value.span, ""));
            }
            (from != to).then_some(Spread::Value(from, to))
        }
        ("Cyclic", ValueKind::Tuple { items, .. }) if (1..=2).contains(&items.len()) => {
            let period = reader.number(&items[0], 1e-9, most)?;
            let begin = items.get(1).map_or(Some(0.0), |item| reader.number(item, least, most))?;
            Some(Spread::Cyclic(period, begin))
        }
        _ => {
            let message = format!("expected a place in the gradient, found {}", value.describe());
            let help = "places are: Value(0.0, 1.0), Quantile, Cyclic(period) or Cyclic(period, begin)";
            reader.d.push(Diagnostic::error(message).label(value.span, "").help(help));
            None
        }
    }
}

/// Reads `"gold"` or `marble(scale: 2.0)`.
fn read_material(reader: &mut Reader, value: &Value) -> Option<MaterialUse> {
    let name = match &value.kind {
        ValueKind::Str(text) => Some(Name::new(value.span, text.as_str())),
        _ => value.name().cloned(),
    };
    let Some(name) = name else {
        wrong_type(value, "a material such as \"gold\" or marble(scale: 2.0)", reader.d);
        return None;
    };
    let Some(material) = reader.library.material(&name.text).cloned() else {
        if !reader.library.is_broken(&name.text) {
            let message = format!("there is no material `{}`", name.text);
            let error = Diagnostic::error(message)
                .label(name.span, "")
                .did_you_mean(&name.text, reader.library.material_names());
            reader.d.push(error.help("`bulbfold list materials` shows all"));
        }
        return None;
    };
    let params = match &value.kind {
        ValueKind::Struct { fields, .. } => read_params(reader, &material, fields)?,
        _ => Vec::new(),
    };
    let study = material.study(&reader.library.engine, &reader.library.sources, &params);
    match study {
        Ok(study) => Some(MaterialUse { material, params, study }),
        Err(error) => {
            reader.d.push(error.label(name.span, "used here"));
            None
        }
    }
}

fn read_params(
    reader: &mut Reader,
    material: &Material,
    fields: &[(Name, Value)],
) -> Option<Vec<(String, ParamValue)>> {
    let mut params = Vec::new();
    for (name, value) in fields {
        let Some(param) = material.params.iter().find(|param| param.name == name.text) else {
            reader.d.push(unknown_param(&name.text, name.span, &material.params));
            return None;
        };
        match reader.param_input(param, value)? {
            ParamInput::Known(known) => params.push((name.text.clone(), known)),
            ParamInput::OfIteration(_) => {
                refuse_iteration(reader, value.span);
                return None;
            }
        }
    }
    Some(params)
}

fn refuse_iteration(reader: &mut Reader, span: Span) {
    let message = "a material is the same in every iteration, so its parameters cannot depend on `n`";
    reader.d.push(Diagnostic::error(message).label(span, ""));
}
