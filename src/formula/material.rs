//! Material files: what a surface is made of, as a function of where it is seen.
//!
//! `fn material(s, p)` takes what is known of a place ([`INPUTS`]) and the material's parameters, and returns `#{ base: ..., metallic: ... }` with some
//! of [`OUTPUTS`]. It is traced into expressions once, as steps are.

mod read;
mod study;

pub use study::Study;

use std::sync::Arc;

use rhai::{AST, Dynamic, Map};

use super::script::{ScriptEngine, returned_span, type_name};
use super::step::{ParamValue, StepParam, script_value};
use super::symbolic::{Symbol, to_dynamic};
use crate::diag::{Diagnostic, SourceId, Sources, Span, nearest};
use crate::expr::{Arena, Expr, Type};

/// What a material knows of the place that is seen: name, type, and what it is.
pub const INPUTS: &[(&str, Type, &str)] = &[
    ("position", Type::V3, "The point, in the units of the part that it belongs to."),
    ("normal", Type::V3, "Unit vector out of the surface."),
    ("view", Type::V3, "Unit vector towards the viewer."),
    ("footprint", Type::F, "Radius of a pixel there, in world units."),
    ("traps", Type::V4, "Least distances of the orbit from the traps."),
    ("caught", Type::V4, "Number of the iteration, from 1, that came nearest to each trap."),
    (
        "places",
        Type::V4,
        "Where on each trap that was: the share of a turn around it, from 0 to 1, or the place along a line.",
    ),
    ("iterations", Type::F, "Iterations of the orbit."),
    ("smooth", Type::F, "The same without steps: how far through its last iteration the orbit escaped counts."),
    ("radius", Type::F, "Length of the orbit's last point."),
    ("part", Type::F, "Number of the part: 0 for all that has no look of its own, then in the order of `parts`."),
    ("colour", Type::V3, "The colour that the look's palette or gradient gives, linear."),
    ("tone", Type::F, "The place in the gradient of the look's first layer, from 0 to 1."),
];

/// What a material may return: name, type, value where it returns none, range, and what it is. Names and meanings are those of glTF 2.0
/// (`KHR_materials_*`) and OpenPBR 1.1.
pub const OUTPUTS: &[(&str, Type, f64, [f64; 2], &str)] = &[
    ("base", Type::V3, 0.8, [0.0, 1.0], "Base colour, linear: the albedo, or a metal's reflectance along the normal."),
    ("metallic", Type::F, 0.0, [0.0, 1.0], "From 0, which is no metal, to 1."),
    ("roughness", Type::F, 0.55, [0.0, 1.0], "From 0, a mirror, to 1."),
    ("specular", Type::F, 1.0, [0.0, 1.0], "Weight of the reflection of what is no metal."),
    ("transmission", Type::F, 0.0, [0.0, 1.0], "Share of the light that enters and is not scattered back."),
    (
        "transmission_depth",
        Type::F,
        0.0,
        [0.0, 1e6],
        "Distance over which light inside takes on the base colour, in world units; 0 where it does so at the surface.",
    ),
    ("ior", Type::F, 1.5, [1.0, 4.0], "Index of refraction."),
    ("coat", Type::F, 0.0, [0.0, 1.0], "Weight of a clear coat."),
    ("coat_roughness", Type::F, 0.05, [0.0, 1.0], "Roughness of the coat."),
    ("emission", Type::V3, 0.0, [0.0, 1e4], "Radiance that it emits, linear."),
];

/// A material, read from its file.
pub struct Material {
    /// Name, same as the file's.
    pub name: String,
    /// Its text.
    pub text: SourceId,
    /// Heading that listings show it under.
    pub group: String,
    /// What it is, in one line.
    pub summary: String,
    /// Where its numbers come from.
    pub source: String,
    /// What one should know of it.
    pub notes: String,
    /// Parameters in the order of the file.
    pub params: Vec<StepParam>,
    /// Worked examples.
    pub examples: Vec<MaterialExample>,
    ast: AST,
}

/// A worked example: a place, and what the material is there.
#[derive(Clone, Debug)]
pub struct MaterialExample {
    /// Inputs that are not 0, by their number in [`INPUTS`].
    pub at: Vec<(usize, Vec<f64>)>,
    /// Parameters that differ from the defaults.
    pub params: Vec<(String, ParamValue)>,
    /// Outputs to expect, by their number in [`OUTPUTS`].
    pub expect: Vec<(usize, Vec<f64>)>,
    /// Absolute tolerance, in f64.
    pub tolerance: f64,
}

/// Whether a text is that of a material: it defines `fn material`.
pub fn is_material_text(text: &str) -> bool {
    text.contains("fn material(")
}

impl Material {
    /// Script values of its parameters; those that are not given have their defaults.
    pub fn script_params(&self, arena: &Arena, given: &[(String, ParamValue)]) -> Map {
        let value = |param: &StepParam| {
            let value = given.iter().find(|(name, _)| *name == param.name).map_or(&param.default, |(_, value)| value);
            (param.name.as_str().into(), script_value(arena, &param.kind, value))
        };
        self.params.iter().map(value).collect()
    }

    /// Traces the material. `inputs` has an expression for each of [`INPUTS`]; out come those of [`OUTPUTS`] that it returns, each within its range.
    ///
    /// Errors: those of its script, with their place.
    pub fn trace<'g>(
        &self,
        (engine, sources): (&ScriptEngine, &Sources),
        arena: &'g Arc<Arena>,
        inputs: &[Expr<'g>],
        params: &Map,
    ) -> Result<Vec<Option<Expr<'g>>>, Diagnostic> {
        engine.trace(arena, sources, self.text);
        let place: Map = INPUTS.iter().zip(inputs).map(|((name, ..), e)| ((*name).into(), to_dynamic(*e))).collect();
        let args = vec![Dynamic::from(place), Dynamic::from(params.clone())];
        let result = engine.call(sources, self.text, &self.ast, "material", args)?;
        let outputs = self.outputs(sources, arena, result);
        arena.set_span(Span::NONE);
        outputs
    }

    fn outputs<'g>(
        &self,
        sources: &Sources,
        arena: &'g Arc<Arena>,
        result: Dynamic,
    ) -> Result<Vec<Option<Expr<'g>>>, Diagnostic> {
        let found = type_name(result.type_name());
        let wrong = |message: String, help: String| {
            let span = returned_span(sources, self.text, &self.ast, "material");
            Diagnostic::error(message).label(span, format!("in material `{}`", self.name)).help(help)
        };
        let names = || OUTPUTS.iter().map(|output| output.0);
        let help = || format!("it may return: {}", names().collect::<Vec<_>>().join(", "));
        let Some(map) = result.try_cast::<Map>() else {
            let message = format!("`material` must return `#{{ base: ... }}`, but returns a {found}");
            return Err(wrong(message, help()));
        };
        if let Some(name) = map.keys().find(|name| !names().any(|known| known == name.as_str())) {
            let help = nearest(name, names()).map_or_else(help, |near| format!("did you mean `{near}`?"));
            return Err(wrong(format!("a material has no `{name}`"), help));
        }
        let output = |(name, ty, _, [low, high], _): &(&str, Type, f64, [f64; 2], &str)| {
            let Some(value) = map.get(*name) else { return Ok(None) };
            let part = part_of(arena, value, *ty).ok_or_else(|| {
                let found = value
                    .read_lock::<Symbol>()
                    .map_or_else(|| type_name(value.type_name()), |symbol| symbol.type_name(arena));
                wrong(format!("`{name}` must be a {ty}, found a {found}"), help())
            })?;
            Ok(Some(part.clamp(part.lift(*low), part.lift(*high))))
        };
        OUTPUTS.iter().map(output).collect()
    }
}

/// An output of a type; a number stands for a grey.
fn part_of<'g>(arena: &'g Arena, value: &Dynamic, ty: Type) -> Option<Expr<'g>> {
    if let Some(symbol) = value.read_lock::<Symbol>() {
        return symbol.expr_of(arena, ty).or_else(|| symbol.expr_of(arena, Type::F).map(|e| e.widen(ty.width)));
    }
    let number = value.as_float().or_else(|_| value.as_int().map(|x| x as f64)).ok()?;
    Some(arena.f(number).widen(ty.width))
}
