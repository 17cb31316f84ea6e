//! Pages and lines about palettes and materials.

use std::collections::BTreeMap;
use std::path::Path;

use bulbfold::colour::palettes::{self, Palette};
use bulbfold::colour::{Gradient, hex};
use bulbfold::diag::Diagnostics;
use bulbfold::files::{Chosen, MAX_TEXT, read_text};
use bulbfold::formula::material::{INPUTS, Material, MaterialExample, OUTPUTS, is_material_text};

use super::explain::{param_row, value_text};
use super::page::{Block, markdown};
use super::{Failure, Session};

/// Five colours of a gradient, from its start to its end.
pub fn swatch(gradient: &Gradient) -> String {
    let at = |i: i32| if gradient.is_cyclic() { f64::from(i) / 5.0 } else { f64::from(i) / 4.0 };
    (0..5).map(|i| hex(gradient.at(at(i)))).collect::<Vec<_>>().join(" ")
}

/// The page of the palette or material of this name, or of the material in this file; nothing where there is none.
pub fn explained(session: &mut Session, path: &Path) -> Result<Option<Vec<Block>>, Failure> {
    let is_file = path.extension().is_some_and(|e| e == "rhai")
        && read_text(path, MAX_TEXT, Chosen::Found).is_ok_and(|text| is_material_text(&text));
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    if is_file {
        let mut d = Diagnostics::default();
        session.library.add_step_file(path, &mut d);
        session.report(d)?;
    } else if path.exists() || path.extension().is_some() {
        return Ok(None);
    }
    if let Some(material) = session.library.material(&name).cloned() {
        let mut blocks = material_page(&material);
        let text = session.library.sources.text(material.text).to_string();
        blocks.extend([Block::Heading(2, "Material file".into()), Block::Code("rust", text)]);
        return Ok(Some(blocks));
    }
    Ok(palettes::named(&name).map(palette_page))
}

fn palette_page(palette: &Palette) -> Vec<Block> {
    let rows = palette.gradient.stops().iter().map(|stop| vec![format!("{:.3}", stop.at), hex(stop.colour)]);
    let goes =
        if palette.gradient.is_cyclic() { "It goes on from its end to its start." } else { "It ends at both ends." };
    vec![
        Block::Heading(1, palette.name.clone()),
        Block::Text(palette.summary.clone()),
        Block::Text(format!("Group: {}. {goes} Colours between stops are mixed in OKLab.", palette.group)),
        Block::Table(vec!["Place", "Colour"], rows.collect()),
    ]
}

fn material_page(material: &Material) -> Vec<Block> {
    let mut blocks = vec![Block::Heading(1, material.name.clone()), Block::Text(material.summary.clone())];
    blocks.push(Block::Text(format!("Group: {}", material.group)));
    if !material.source.is_empty() {
        blocks.push(Block::Text(format!("Source: {}", material.source)));
    }
    if !material.params.is_empty() {
        blocks.push(Block::Heading(2, "Parameters".into()));
        let head = vec!["Name", "Type", "Default", "Range", "Unit", "Meaning"];
        blocks.push(Block::Table(head, material.params.iter().map(param_row).collect()));
    }
    if !material.notes.is_empty() {
        blocks.push(Block::Heading(2, "Notes".into()));
        blocks.push(Block::Text(material.notes.clone()));
    }
    blocks.push(Block::Heading(2, "Examples".into()));
    blocks.push(Block::Table(vec!["At", "Parameters", "Result"], material.examples.iter().map(example_row).collect()));
    blocks
}

fn example_row(example: &MaterialExample) -> Vec<String> {
    let numbers = |name: &str, values: &[f64]| {
        let shown: Vec<String> = values.iter().map(|x| format!("{}", (x * 1e6).round() / 1e6)).collect();
        format!("{name}: {}", shown.join(", "))
    };
    let at = example.at.iter().map(|(i, values)| numbers(INPUTS[*i].0, values));
    let params = example.params.iter().map(|(name, value)| format!("{name}: {}", value_text(value)));
    let expect = example.expect.iter().map(|(i, values)| numbers(OUTPUTS[*i].0, values));
    let join = |parts: Vec<String>| parts.join("; ");
    vec![join(at.collect()), join(params.collect()), join(expect.collect())]
}

/// The reference of all materials.
pub fn materials(session: &Session) -> String {
    let mut groups: BTreeMap<&str, Vec<&Material>> = BTreeMap::new();
    for material in session.library.materials() {
        groups.entry(&material.group).or_default().push(material);
    }
    let note = "Made by `bulbfold docs` from the material files; change those instead of this page. A material is a file \
                `formulas/materials/NAME.rhai` with `fn material(s, p)`, where `s` holds what is known of a place and `p` the material's parameters.";
    let inputs = INPUTS.iter().map(|(name, ty, help)| vec![format!("s.{name}"), ty.to_string(), help.to_string()]);
    let outputs = OUTPUTS.iter().map(|(name, ty, default, [low, high], help)| {
        vec![name.to_string(), ty.to_string(), default.to_string(), format!("{low} to {high}"), help.to_string()]
    });
    let index = groups.iter().flat_map(|(group, list)| list.iter().map(move |material| (*group, *material)));
    let index = index.map(|(group, material)| {
        vec![format!("[{0}](#{0})", material.name), group.to_string(), material.summary.clone()]
    });
    let mut text = markdown(
        &[
            Block::Heading(1, "Materials".into()),
            Block::Text(note.into()),
            Block::Table(vec!["Material", "Group", "What it is"], index.collect()),
            Block::Heading(2, "What a material knows".into()),
            Block::Table(vec!["Name", "Type", "Meaning"], inputs.collect()),
            Block::Heading(2, "What it returns".into()),
            Block::Table(vec!["Name", "Type", "Default", "Range", "Meaning"], outputs.collect()),
        ],
        0,
    );
    for (group, list) in groups {
        text.push_str(&markdown(&[Block::Heading(2, format!("Group: {group}"))], 0));
        list.into_iter().for_each(|material| text.push_str(&markdown(&material_page(material), 2)));
    }
    text
}

/// The reference of all palettes.
pub fn palettes_page() -> String {
    let note = "Made by `bulbfold docs` from the files in `formulas/palettes/`; change those instead of this page.";
    let rows = palettes::all().iter().map(|palette| {
        let cyclic = if palette.gradient.is_cyclic() { "yes" } else { "no" };
        vec![
            palette.name.clone(),
            palette.group.clone(),
            cyclic.into(),
            swatch(&palette.gradient),
            palette.summary.clone(),
        ]
    });
    let head = vec!["Palette", "Group", "Cyclic", "Five of its colours", "What it is"];
    markdown(&[Block::Heading(1, "Palettes".into()), Block::Text(note.into()), Block::Table(head, rows.collect())], 0)
}
