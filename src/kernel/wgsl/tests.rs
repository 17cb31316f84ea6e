//! Every kernel of the built-in formulas is legal WGSL, and so are the corners of the language.

mod dealing;

use std::collections::HashMap;
use std::sync::Arc;

use super::{validate, write};
use crate::compose::Composer;
use crate::diag::Diagnostics;
use crate::expr::ops::Operator;
use crate::expr::{Arena, Expr, Function, Port, Type};
use crate::formula::library::Library;
use crate::graph::Schedule;
use crate::graph::{EstimateSettings, Method, ValidGraph};
use crate::kernel::{Estimator, Kernel, Orbit};
use crate::load::load_text;
use crate::render::{Pipeline, RenderSettings, compose_pipeline};

pub(crate) fn load(library: &mut Library, name: &str) -> ValidGraph {
    let path = format!("{}/formulas/fractals/{name}.ron", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(&path).expect("the formula is part of the repository");
    let mut d = Diagnostics::default();
    let loaded = load_text(library, &path, &text, &[], &mut d);
    loaded.unwrap_or_else(|| panic!("{}", d.render(&library.sources, false))).graph
}

pub(crate) fn pipeline(name: &str, settings: &RenderSettings) -> (Arc<Arena>, Pipeline) {
    let mut library = Library::builtin();
    let graph = load(&mut library, name);
    let arena = Arc::new(Arena::default());
    let composer = Composer { arena: &arena, library: &library, graph: &graph };
    let pipeline = compose_pipeline(&composer, settings).unwrap_or_else(|_| panic!("{name} composes"));
    (arena, pipeline)
}

#[test]
fn every_kernel_of_every_method_is_valid() {
    for name in ["mandelbulb", "mandelbox"] {
        for method in Method::ALL {
            let estimate = EstimateSettings { method: Some(method), ..Default::default() };
            let (arena, pipeline) = pipeline(name, &RenderSettings { estimate, ..Default::default() });
            for (kernel_name, kernel) in pipeline.kernels() {
                let text = write(&arena, kernel);
                if let Err(error) = validate(&text) {
                    panic!("{name} {method:?} {kernel_name}: {error}\n{text}");
                }
                assert_eq!(text, write(&arena, kernel), "writing is deterministic");
            }
        }
    }
}

#[test]
fn every_operator_is_valid_at_every_width() {
    for &operator in Operator::ALL {
        for width in [1, 3, 4] {
            let arena = Arena::default();
            let info = operator.info();
            let ports: Vec<Port> = (0..info.arity)
                .map(|i| Port::new(format!("min{i}"), Type { is_bool: info.bool_arguments >> i & 1 == 1, width }))
                .collect();
            let mut function = Function::new("select", ports);
            let inputs = function.input_exprs(&arena);
            function.output("var", Expr::apply(operator, &inputs));
            let text = write(&arena, &Kernel::Map(function));
            if let Err(error) = validate(&text) {
                panic!("{} at width {width}: {error}\n{text}", info.name);
            }
        }
    }
}

#[test]
fn constants_without_a_literal_are_valid() {
    let arena = Arena::default();
    let mut function = Function::new("constants", vec![Port::new("x", Type::F)]);
    let x = arena.input(0, Type::F);
    for (i, c) in [1e300, -1e300, f64::INFINITY, f64::NEG_INFINITY, f64::NAN, -0.0, 1e-42, -3.5].into_iter().enumerate()
    {
        function.output(format!("v{i}"), x * arena.f(c) - arena.f(c));
    }
    function.output("vector", arena.v3([f64::INFINITY, -1.0, 0.0]) - x);
    let text = write(&arena, &Kernel::Map(function));
    validate(&text).unwrap_or_else(|error| panic!("{error}\n{text}"));
}

/// An estimator whose orbit adds a different power of ten by item, so that its end tells the schedule.
pub(crate) fn scheduled(arena: &Arena, schedule: Schedule, items: usize, max_iterations: u32) -> Estimator {
    let state = vec![Port::new("z", Type::F)];
    let ports = vec![Port::new("z", Type::F), Port::new("n", Type::F)];
    let mut init = Function::new("sum_init", Estimator::inputs());
    init.output("z", arena.input(0, Type::V3).component(0));
    let item = |i: usize| {
        let mut function = Function::new(format!("sum_iterate_{i}"), ports.clone());
        let z = arena.input(0, Type::F) + 10f64.powi(i as i32);
        function.output("z", z);
        function.output("escaped", arena.f(1e6).lt(z));
        function
    };
    let mut finish = Function::new("sum_finish", ports.clone());
    finish.output("z", arena.input(0, Type::F));
    let mut inputs = Estimator::inputs();
    inputs.extend([Port::new("sum_z", Type::F), Port::new("sum_inside", Type::B), Port::new("sum_n", Type::F)]);
    let mut combine = Function::new("combine", inputs);
    combine.output("z", arena.input(4, Type::F));
    combine.output("inside", arena.input(5, Type::B));
    combine.output("n", arena.input(6, Type::F));
    let items = (0..items).map(item).collect();
    let orbit = Orbit { name: "sum".into(), state, frozen: Vec::new(), init, items, schedule, finish, max_iterations };
    Estimator { orbits: vec![orbit], combine }
}

#[test]
fn schedules_become_switches() {
    let arena = Arena::default();
    let schedule = Schedule { prefix: vec![2, 2], cycle: vec![0, 1, 0] };
    let text = write(&arena, &Kernel::Estimate(scheduled(&arena, schedule, 3, 7)));
    validate(&text).unwrap_or_else(|error| panic!("{error}\n{text}"));
    assert!(text.contains("case 3u: { state = sum_iterate_1(state.z, f32(n)); }"), "{text}");
    assert!(text.contains("case 0u, 1u: { state = sum_iterate_2(state.z, f32(n)); }"), "{text}");
    let single = write(&arena, &Kernel::Estimate(scheduled(&arena, Schedule::constant(0), 1, 7)));
    assert!(!single.contains("switch"), "{single}");
}

#[test]
fn a_small_change_stays_small() {
    let text = |factor: f64| {
        let arena = Arena::default();
        let mut function = Function::new("f", vec![Port::new("x", Type::F), Port::new("y", Type::F)]);
        let (x, y) = (arena.input(0, Type::F), arena.input(1, Type::F));
        let (a, b) = ((x * factor).sin(), (y + 1.0).cos());
        function.output("a", a * a);
        function.output("b", b * b + b);
        write(&arena, &Kernel::Map(function))
    };
    let (one, two) = (text(2.0), text(3.0));
    let different = one.lines().zip(two.lines()).filter(|(a, b)| a != b).count();
    assert_eq!(different, 2, "the changed line and its use:\n{one}\n{two}");
}

/// The kernels of a built-in fractal by name, with parts of it set.
fn texts(name: &str, set: &[(&str, &str)], method: Method) -> HashMap<&'static str, String> {
    let (mut library, mut d) = (Library::builtin(), Diagnostics::default());
    let set: Vec<(String, String)> = set.iter().map(|(path, value)| (path.to_string(), value.to_string())).collect();
    let loaded = crate::load::load(&mut library, name, &set, &mut d);
    let graph = loaded.unwrap_or_else(|| panic!("{}", d.render(&library.sources, false))).graph;
    let arena = Arc::new(Arena::default());
    let composer = Composer { arena: &arena, library: &library, graph: &graph };
    let estimate = EstimateSettings { method: Some(method), ..Default::default() };
    let settings = RenderSettings { estimate, ..Default::default() };
    let pipeline = compose_pipeline(&composer, &settings).unwrap_or_else(|_| panic!("{name} composes"));
    pipeline.kernels().into_iter().map(|(name, kernel)| (name, write(&arena, kernel))).collect()
}

#[test]
fn what_is_off_leaves_no_line() {
    let plain = texts("mandelbulb", &[], Method::Scalar);
    let julia = texts("mandelbulb", &[("constant", "Julia((0.3, 0.1, -0.2))")], Method::Scalar);
    // The "+1" of the running derivative, and the start point as the constant.
    let state = |texts: &HashMap<&str, String>| {
        let (_, iterate) = texts["march"].split_once("fn orbit_0_iterate_0(").expect("an iteration begins so");
        iterate.split_once("\n}").expect("and ends so").0.to_string()
    };
    assert!(state(&plain).contains("1.0f + ("), "{}", state(&plain));
    assert!(!state(&julia).contains("1.0f + "), "{}", state(&julia));
    assert!(plain["march"].contains("c: vec3<f32>") && !julia["march"].contains("c: vec3<f32>"), "{}", julia["march"]);
    // Orbit traps and derivatives belong to surfaces only, and no kernel has uniforms or helpers that it does not read.
    assert!(plain["surface"].contains("trap") && !plain["march"].contains("trap"));
    assert!(!plain["march"].contains("j_x"), "a scalar rule carries no Jacobian");
    let helpers = ["Uniforms", "bf_pow", "bf_atan2", "bf_mod", "atan2(", "switch"];
    // Encoding takes a power of its own.
    for text in plain.iter().filter(|(name, _)| **name != "encode").map(|(_, text)| text) {
        assert!(helpers.iter().all(|helper| !text.contains(helper)), "{text}");
    }
    // A fractional power is what the helpers are for.
    assert!(texts("mandelbulb", &[("power", "7.5")], Method::Scalar)["march"].contains("bf_atan2"));
    let dark = texts("mandelbulb", &[("look", "(shadows: false, fog: 0.0)")], Method::Scalar);
    let light = texts("mandelbulb", &[("look", "(shadows: true, fog: 0.3)")], Method::Scalar);
    assert!(light.contains_key("shadow_ray") && !dark.contains_key("shadow_ray"));
    assert!(light["colour"].contains("shadow") && !dark["colour"].contains("shadow"), "{}", dark["colour"]);
    let exponentials = |texts: &HashMap<&str, String>| texts["colour"].matches("exp(").count();
    assert_eq!(exponentials(&light), exponentials(&dark) + 1, "that of the fog");
}

/// What an iteration takes is the time of its longest chain: roots and divisions of an even power start from the sum of squares.
#[test]
fn roots_of_even_powers_wait_for_no_choice() {
    for (power, waits) in [("2", false), ("6", false), ("8", false), ("7", true)] {
        let march = &texts("mandelbulb", &[("power", power)], Method::Scalar)["march"];
        let (_, iterate) = march.split_once("fn orbit_0_iterate_0(").expect("an iteration begins so");
        let (iterate, _) = iterate.split_once("\n}").expect("a function ends so");
        let chained = iterate.contains("sqrt(select(") || iterate.contains("/ sqrt(");
        assert_eq!(chained, waits, "power {power}: {iterate}");
    }
}

#[test]
fn errors_show_the_place() {
    let text = validate("fn f() -> f32 { return g; }").expect_err("g is unknown").to_string();
    assert!(text.contains("kernel.wgsl:1:24"), "{text}");
}
