//! Tracks that a script computes: `fn values(t)` and `fn camera(t)`, which may take the share of the film as a second argument.

use std::path::Path;

use rhai::{AST, Dynamic};

use super::Changes;
use crate::diag::{Diagnostic, SourceId, Span};
use crate::formula::library::Library;
use crate::formula::script::{Spot, returned_span, to_value};
use crate::formula::value::ValueKind;

/// A script with functions of time.
pub struct Script {
    id: SourceId,
    ast: AST,
    /// How many arguments `values` and `camera` take; none where there is no such function.
    values: Option<usize>,
    camera: Option<usize>,
}

impl Script {
    /// Opens a script, which must have one of the functions.
    pub fn open(library: &mut Library, path: &Path, span: Span) -> Result<Script, Diagnostic> {
        let named = |message: String| Diagnostic::error(message).label(span, "named here");
        let text = library.read_named(path);
        let text = text.map_err(|error| named(format!("cannot read {}: {error}", path.display())))?;
        let id = library.sources.add(path.display().to_string(), text);
        Script::of_formula(library, id)?.ok_or_else(|| {
            let message = format!("{} has neither `fn values(t)` nor `fn camera(t)`", path.display());
            named(message)
                .help("`values` gives a map such as #{ \"power\": 5.0 + t }, `camera` one with position and target")
        })
    }

    /// The functions of a formula that is a script; nothing where it has none.
    pub fn of_formula(library: &Library, id: SourceId) -> Result<Option<Script>, Diagnostic> {
        let ast = library.engine.compile(&library.sources, id)?;
        let takes = |name: &str| {
            let mut found = ast.iter_functions().filter(|function| function.name == name);
            found.find_map(|function| (1..=2).contains(&function.params.len()).then_some(function.params.len()))
        };
        let (values, camera) = (takes("values"), takes("camera"));
        Ok((values.is_some() || camera.is_some()).then_some(Script { id, ast, values, camera }))
    }

    /// Whether it changes the formula.
    pub fn has_values(&self) -> bool {
        self.values.is_some()
    }

    /// The changes of the formula at a time.
    pub fn values(&self, library: &Library, time: f64, share: f64) -> Result<Changes, Diagnostic> {
        self.values.map_or(Ok(Vec::new()), |count| self.fields(library, "values", &[time, share][..count]))
    }

    /// The fields of the camera at a time.
    pub fn camera(&self, library: &Library, time: f64, share: f64) -> Result<Changes, Diagnostic> {
        self.camera.map_or(Ok(Vec::new()), |count| self.fields(library, "camera", &[time, share][..count]))
    }

    fn fields(&self, library: &Library, function: &str, numbers: &[f64]) -> Result<Changes, Diagnostic> {
        library.engine.begin_formula();
        let args = numbers.iter().map(|number| Dynamic::from_float(*number)).collect();
        let result = library.engine.call(&library.sources, self.id, &self.ast, function, args)?;
        let place = returned_span(&library.sources, self.id, &self.ast, function);
        let value = to_value(&result, &Spot::One(place));
        let ValueKind::Struct { fields, .. } = &value.kind else {
            let message = format!("`{function}` gives {}, and not a map", value.describe());
            return Err(Diagnostic::error(message).label(value.span, "").help("write #{ \"power\": 5.0 + t }"));
        };
        Ok(fields.iter().map(|(name, value)| (name.text.clone(), value.kind.to_string())).collect())
    }
}
