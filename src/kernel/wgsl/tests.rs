//! Every kernel of the built-in formulas is legal WGSL, and so are the corners of the language.

use std::rc::Rc;

use super::{validate, write};
use crate::compose::Composer;
use crate::diag::Diagnostics;
use crate::expr::ops::Operator;
use crate::expr::{Arena, Expr, Function, Port, Type};
use crate::formula::library::Library;
use crate::graph::{EstimateSettings, Method, ValidGraph};
use crate::kernel::Kernel;
use crate::load::load_text;
use crate::render::{Pipeline, RenderSettings, compose_pipeline};

pub(crate) fn load(library: &mut Library, name: &str) -> ValidGraph {
    let path = format!("{}/formulas/fractals/{name}.ron", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(&path).expect("the formula is part of the repository");
    let mut d = Diagnostics::default();
    let loaded = load_text(library, &path, &text, &[], &mut d);
    loaded.unwrap_or_else(|| panic!("{}", d.render(&library.sources, false))).graph
}

pub(crate) fn pipeline(name: &str, settings: &RenderSettings) -> (Rc<Arena>, Pipeline) {
    let mut library = Library::builtin();
    let graph = load(&mut library, name);
    let arena = Rc::new(Arena::default());
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

#[test]
fn errors_show_the_place() {
    let text = validate("fn f() -> f32 { return g; }").expect_err("g is unknown").to_string();
    assert!(text.contains("kernel.wgsl:1:24"), "{text}");
}
