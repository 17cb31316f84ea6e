//! Reading material files: their descriptions and examples.

use std::sync::Arc;

use rhai::AST;

use super::{INPUTS, Material, MaterialExample, OUTPUTS};
use crate::diag::{Diagnostic, Diagnostics, SourceId, Sources};
use crate::expr::{Arena, Type};
use crate::formula::decode::{Fields, FromValue, entries};
use crate::formula::script::{Places, ScriptEngine, Spot, base_scope, to_value};
use crate::formula::step::{StepParam, decode_param, unknown_param};
use crate::formula::value::{Value, ValueKind};

impl Material {
    /// Reads a material file whose text is already in `sources`.
    pub fn read(
        engine: &ScriptEngine,
        sources: &Sources,
        text: SourceId,
        name: &str,
        d: &mut Diagnostics,
    ) -> Option<Material> {
        let run = || {
            let ast = engine.compile(sources, text)?;
            engine.trace(&Arc::new(Arena::default()), sources, text);
            let description = engine.run(sources, text, &ast, &mut base_scope())?;
            Ok((ast, description))
        };
        let (ast, description) = match run() {
            Ok(parts) => parts,
            Err(error) => {
                d.push(error);
                return None;
            }
        };
        let places = Places::of(&ast);
        let description = to_value(&description, &Spot::Own { place: places.result(), sources, text });
        decode(name, text, ast, &description, d)
    }

    /// Everything that a material's text names and that means nothing; `material` is what could be read of it.
    pub(in crate::formula) fn unknown_names(
        engine: &ScriptEngine,
        sources: &Sources,
        text: SourceId,
        material: Option<&Material>,
    ) -> Vec<Diagnostic> {
        let Ok(ast) = engine.compile(sources, text) else { return Vec::new() };
        let params: Option<Vec<&str>> =
            material.map(|material| material.params.iter().map(|p| p.name.as_str()).collect());
        engine.unknown_names((sources, text), &ast, (&[], &[]), params.as_deref())
    }
}

fn decode(name: &str, text: SourceId, ast: AST, description: &Value, d: &mut Diagnostics) -> Option<Material> {
    let errors = d.error_count();
    let mut fields = Fields::new(description, "a material's description", d)?;
    let group = fields.or("group", "own".to_string(), d);
    let summary = fields.or("summary", String::new(), d);
    let source = fields.or("source", String::new(), d);
    let notes = fields.or("notes", String::new(), d);
    let params: Vec<StepParam> = fields.or("params", Vec::new(), d);
    let example_values: Vec<Value> = fields.or("examples", Vec::new(), d);
    fields.finish(d);
    let examples = example_values.iter().filter_map(|value| example(value, &params, d)).collect();
    if !ast.iter_functions().any(|f| f.name == "material" && f.params.len() == 2) {
        let message = "the file has no `fn material(s, p)`";
        d.push(Diagnostic::error(message).label(description.span, "described here"));
    }
    let name = name.to_string();
    (d.error_count() == errors).then(|| Material { name, text, group, summary, source, notes, params, examples, ast })
}

fn example(value: &Value, params: &[StepParam], d: &mut Diagnostics) -> Option<MaterialExample> {
    let mut fields = Fields::new(value, "an example", d)?;
    let (at, given) = (fields.optional_value("at"), fields.optional_value("params"));
    let expect = fields.required::<Value>("expect", d);
    let tolerance = fields.or("tolerance", 1e-6, d);
    fields.finish(d);
    let mut values = Vec::new();
    for (name, value) in given.map(|v| entries(v, "parameters", d)).unwrap_or_default() {
        match params.iter().find(|p| p.name == name.text) {
            Some(param) => values.extend(decode_param(param, value, d).map(|v| (name.text.clone(), v))),
            None => d.push(unknown_param(&name.text, name.span, params)),
        }
    }
    let inputs: Vec<(&str, Type)> = INPUTS.iter().map(|(name, ty, _)| (*name, *ty)).collect();
    let outputs: Vec<(&str, Type)> = OUTPUTS.iter().map(|(name, ty, ..)| (*name, *ty)).collect();
    let at = at.map_or_else(Vec::new, |at| numbers(at, &inputs, "a place", d));
    Some(MaterialExample { at, params: values, expect: numbers(&expect?, &outputs, "a material", d), tolerance })
}

/// Numbers of some names: the place of each name in the list, and as many as its type has.
fn numbers(value: &Value, known: &[(&str, Type)], what: &str, d: &mut Diagnostics) -> Vec<(usize, Vec<f64>)> {
    let mut read = Vec::new();
    for (name, value) in entries(value, what, d) {
        let Some(i) = known.iter().position(|(known, _)| *known == name.text) else {
            let message = format!("{what} has no `{}`", name.text);
            let names = known.iter().map(|(name, _)| *name);
            d.push(Diagnostic::error(message).label(name.span, "").did_you_mean(&name.text, names));
            continue;
        };
        let parts = match &value.kind {
            ValueKind::List(_) => Vec::<f64>::from_value(value, d),
            _ => f64::from_value(value, d).map(|x| vec![x]),
        };
        let width = usize::from(known[i].1.width);
        match parts {
            Some(parts) if parts.len() == width => read.push((i, parts)),
            Some(_) => {
                d.push(Diagnostic::error(format!("`{}` needs {width} numbers", name.text)).label(value.span, ""))
            }
            None => {}
        }
    }
    read
}
