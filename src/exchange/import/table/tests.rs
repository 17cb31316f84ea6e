use super::{Table, words};
use crate::diag::Diagnostics;
use crate::exchange::import::ask::Ask;
use crate::exchange::import::value::Value;
use crate::formula::library::Library;
use crate::load::load_text;

/// A file that gives nothing, or that switches everything on.
struct Nothing {
    all_on: bool,
}

impl Ask for Nothing {
    fn ask(&self, _: &str, default: &Value, _: &mut Diagnostics) -> Value {
        match default {
            Value::Bool(_) if self.all_on => Value::Bool(true),
            Value::Vector(parts) if self.all_on => Value::Vector(parts.iter().map(|part| part + 0.5).collect()),
            other => other.clone(),
        }
    }
}

/// The graph of a row.
fn graph(table: &Table, row: &super::Row, all_on: bool) -> String {
    let mut d = Diagnostics::default();
    let expanded = table.expand(row, "_1", &Nothing { all_on }, &mut d);
    assert!(d.is_empty());
    let params: Vec<String> = expanded.params.iter().map(|(n, v)| format!("\"{n}\": (default: {v:?})")).collect();
    let mut steps = expanded.steps;
    steps.push("translate()".into());
    let end = expanded.end.map(|end| format!(", end: {end}")).unwrap_or_default();
    let pre = if expanded.pre.is_empty() { String::new() } else { format!(", pre: [{}]", expanded.pre.join(", ")) };
    let shapes = expanded.levels.iter().enumerate();
    let levels: Vec<String> = shapes.map(|(i, level)| format!(", \"shape{i}\": {}", level.shape)).collect();
    format!(
        "(params: {{ {} }}, nodes: {{ \"map\": Sequence([{}]){} }}, output: \"map\"{pre}{end})",
        params.join(", "),
        steps.join(", "),
        levels.concat()
    )
}

/// Every row is a graph that loads: names of steps and parameters are right, and expressions can be computed.
#[test]
fn every_row_loads_with_nothing_and_with_everything() {
    for table in [Table::mandelbulber(), Table::fragmentarium()] {
        for row in &table.formulas {
            for all_on in [false, true] {
                let (mut library, mut d) = (Library::builtin(), Diagnostics::default());
                let text = graph(&table, row, all_on);
                let loaded = load_text(&mut library, "row.ron", &text, &[], &mut d);
                assert!(loaded.is_some(), "{}:\n{text}\n{}", row.name, d.render(&library.sources, false));
            }
        }
    }
}

/// What rows say of the running derivative is so: all steps of the others have a rule for it.
#[test]
fn rows_without_differences_have_scalar_rules() {
    for row in Table::mandelbulber().formulas.iter().filter(|row| !row.differences) {
        let (mut library, mut d) = (Library::builtin(), Diagnostics::default());
        let text = graph(&Table::mandelbulber(), row, true);
        load_text(&mut library, "row.ron", &text, &[], &mut d).unwrap();
        let words = text.split(|c: char| !(c.is_ascii_alphanumeric() || c == '_'));
        // Shapes give distances of their own.
        for step in words.filter_map(|word| library.step(word)).filter(|step| step.group != "shape") {
            assert!(step.scalar_rule.is_some(), "{}: {}", row.name, step.name);
        }
    }
}

#[test]
fn every_default_is_read_by_a_row() {
    for table in [Table::mandelbulber(), Table::fragmentarium()] {
        for name in table.defaults.keys() {
            let knows = table.formulas.iter().any(|row| row.settings().contains(name) || row.ignores(name));
            assert!(knows, "no row reads `{name}`");
        }
    }
}

#[test]
fn numbers_and_names_are_found_once() {
    let table = Table::mandelbulber();
    for (i, row) in table.formulas.iter().enumerate() {
        assert!(table.formulas[..i].iter().all(|other| other.id != row.id && other.name != row.name), "{}", row.name);
    }
}

#[test]
fn names_are_words_without_parts_and_numbers() {
    assert_eq!(words("-2.0 * a.x + sqrt(b_1) > 1e-3 && !c"), ["a", "b_1", "c"]);
}
