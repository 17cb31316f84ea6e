//! Gradients with a name: the files in `formulas/palettes/`, and those of the user that have the same form.

use std::sync::OnceLock;

use super::gradient::Gradient;
use super::written::read_stops;
use crate::diag::{Diagnostics, SourceId, Sources};
use crate::formula::decode::Fields;
use crate::formula::embedded;
use crate::formula::ron::{Limits, read_ron};

/// A gradient with its name.
#[derive(Clone, PartialEq, Debug)]
pub struct Palette {
    /// The file's name.
    pub name: String,
    /// Heading that listings show it under.
    pub group: String,
    /// What it is, in one line.
    pub summary: String,
    /// Its colours.
    pub gradient: Gradient,
}

/// All presets by name. Panics if a built-in file has an error, which a test rules out.
pub fn all() -> &'static [Palette] {
    static ALL: OnceLock<Vec<Palette>> = OnceLock::new();
    ALL.get_or_init(|| {
        let read = |(name, text): &(&str, &str)| {
            let mut sources = Sources::default();
            let id = sources.add(format!("formulas/palettes/{name}.ron"), *text);
            let mut d = Diagnostics::default();
            let palette = read_palette_file(&sources, id, name, &mut d);
            palette.unwrap_or_else(|| panic!("built-in palettes are broken:\n{}", d.render(&sources, false)))
        };
        embedded::PALETTES.iter().map(read).collect()
    })
}

/// The preset of this name.
pub fn named(name: &str) -> Option<&'static Palette> {
    all().iter().find(|palette| palette.name == name)
}

/// Reads a palette file: `(summary: "...", group: "...", cyclic: false, stops: ["#102040", ("#e0a060", 0.7), ...])`.
///
/// Errors: each is pushed.
pub fn read_palette_file(sources: &Sources, id: SourceId, name: &str, d: &mut Diagnostics) -> Option<Palette> {
    let value = read_ron(sources, id, &Limits::default(), d)?;
    let mut fields = Fields::new(&value, "a palette", d)?;
    let summary = fields.or("summary", String::new(), d);
    let group = fields.or("group", "own".to_string(), d);
    let is_cyclic = fields.or("cyclic", false, d);
    let stops = fields.required("stops", d);
    fields.finish(d);
    let gradient = read_stops(&stops?, is_cyclic, d)?;
    (!d.has_errors()).then(|| Palette { name: name.to_string(), group, summary, gradient })
}
