//! Readers of Bulbfold's own files.

use std::sync::Arc;

use bulbfold::calibrate::cache::parse;
use bulbfold::check::{Options, run_graph};
use bulbfold::diag::Diagnostics;
use bulbfold::expr::{Arena, Function, Port, Type};
use bulbfold::formula::step::{StateWidth, Step, StepInputs, script_value};
use bulbfold::graph::print;
use bulbfold::kernel::Kernel;
use bulbfold::kernel::wgsl;
use bulbfold::load::load_text;

use super::{as_text, expect_told, salt, with_library};

/// A graph file in RON.
pub fn ron(bytes: &[u8]) {
    read("input.ron", bytes);
}

/// A script that returns a graph.
pub fn script(bytes: &[u8]) {
    read("input.rhai", bytes);
}

fn read(name: &str, bytes: &[u8]) {
    with_library(|library| {
        let mut d = Diagnostics::default();
        let loaded = load_text(library, name, &as_text(bytes), &[], &mut d);
        expect_told(library, &d, loaded.is_some());
        if let Some(loaded) = loaded {
            assert!(!print::listing_with_look(&loaded.graph).is_empty() && !print::dot(&loaded.graph).is_empty());
        }
    });
}

/// A step's script, traced with its defaults, and its shader.
pub fn step(bytes: &[u8]) {
    with_library(|library| {
        let id = library.sources.add("input.rhai", as_text(bytes));
        let mut d = Diagnostics::default();
        let read = Step::read(&library.engine, &library.sources, id, "input", &mut d);
        expect_told(library, &d, read.is_some());
        let Some(step) = read else { return };
        let arena = Arc::new(Arena::default());
        let ty = if step.state == StateWidth::Four { Type::V4 } else { Type::V3 };
        let mut params = rhai::Map::new();
        for param in &step.params {
            params.insert(param.name.as_str().into(), script_value(&arena, &param.kind, &param.default));
        }
        let (z, c) = (arena.input(0, ty), arena.input(1, ty));
        let mut function =
            Function::new("step", vec![Port::new("z", ty), Port::new("c", ty), Port::new("dr", Type::F)]);
        let (engine, sources) = (&library.engine, &library.sources);
        let value = match step.is_shape() {
            true => step.trace_distance(engine, sources, &arena, z, &params),
            false => {
                let inputs = StepInputs { z, c, dr: Some(arena.input(2, Type::F)), before: None };
                step.trace(engine, sources, &arena, inputs, &params).map(|traced| traced.z)
            }
        };
        match value {
            Err(error) => {
                d.push(error);
                assert!(!d.render(sources, false).is_empty(), "a message shows nothing");
            }
            // What the budget takes is written as a shader.
            Ok(value) if arena.len() < 2_000 => {
                function.output("value", value);
                let text = wgsl::write(&arena, &Kernel::Map(function));
                wgsl::validate(&text).unwrap_or_else(|error| panic!("{error}\n{text}"));
            }
            Ok(_) => {}
        }
    });
}

/// The list of a formula's tests. One in fifty is run on the CPU.
pub fn tests(bytes: &[u8]) {
    let text =
        format!("(nodes: {{\"a\": bulb_power()}}, max_iterations: 4, escape_radius: 4, tests: [{}])", as_text(bytes));
    with_library(|library| {
        let mut d = Diagnostics::default();
        let loaded = load_text(library, "input.ron", &text, &[], &mut d);
        expect_told(library, &d, loaded.is_some());
        if let Some(loaded) = loaded.filter(|_| salt(bytes) % 50 == 0) {
            let options = Options { filter: None, gpu: false };
            let report = run_graph(library, &loaded.graph, "input", &options);
            assert!(!report.outcomes.is_empty(), "no test was run");
        }
    });
}

/// Lines of `path=value` for `--set`, on a graph that has everything.
pub fn set(bytes: &[u8]) {
    const EVERYTHING: &str = include_str!("../../seeds/ron/everything.ron");
    let text = as_text(bytes);
    let pairs: Vec<(String, String)> =
        text.lines().filter_map(|line| line.split_once('=')).map(|(a, b)| (a.into(), b.into())).collect();
    with_library(|library| {
        let mut d = Diagnostics::default();
        let loaded = load_text(library, "everything.ron", EVERYTHING, &pairs, &mut d);
        expect_told(library, &d, loaded.is_some());
    });
}

/// An entry of the calibration cache: taken or not, and taken the same again.
pub fn cache(bytes: &[u8]) {
    let text = as_text(bytes);
    assert_eq!(format!("{:?}", parse(&text)), format!("{:?}", parse(&text)));
}
