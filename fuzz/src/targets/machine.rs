//! Machine code against the interpreter: equal to the bit.

use std::sync::Arc;

use bulbfold::check::Random;
use bulbfold::compose::{Purpose, compose_estimator};
use bulbfold::diag::Diagnostics;
use bulbfold::expr::ops::Operator;
use bulbfold::expr::{Arena, Differentiator, Expr, Function, Port, Type};
use bulbfold::kernel::cpu::Cpu;
use bulbfold::kernel::{Backend, Estimator, Kernel, listing};
use bulbfold::load::load_text;
use bulbfold::march::{MarchSettings, compose_march};
use bulbfold::math::Precision;

use super::{as_text, composer, fixed_choices, salt, with_library};

/// Values that break things.
const SPICY: [f64; 20] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    2.0,
    -2.0,
    1e-9,
    1e-30,
    1e-160,
    1e-310,
    7.5,
    1e4,
    -1e9,
    1e30,
    1e300,
    f64::MAX,
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
];

/// Bytes as choices; after the last byte all choices are those of a fixed row of random numbers.
struct Choices<'b> {
    bytes: std::slice::Iter<'b, u8>,
    random: Random,
}

impl Choices<'_> {
    fn below(&mut self, end: usize) -> usize {
        match self.bytes.next() {
            Some(byte) => usize::from(*byte) % end,
            None => self.random.below(end),
        }
    }

    fn number(&mut self) -> f64 {
        match self.below(3) {
            0 => SPICY[self.below(SPICY.len())],
            _ => (self.below(256) as f64 - 128.0) / 16.0,
        }
    }
}

/// Random expressions of three numbers and a vector, and their derivatives.
pub fn expressions(bytes: &[u8]) {
    let mut choices = Choices { bytes: bytes.iter(), random: Random::new(bytes.len() as u64) };
    let arena = Arena::default();
    let mut known: Vec<Expr> = (0..3).map(|i| arena.input(i, Type::F)).collect();
    known.push(arena.input(3, Type::V3));
    let count = 4 + choices.below(60);
    for _ in 0..count {
        let next = grown(&arena, &known, &mut choices);
        known.push(next);
    }
    let mut ports = ["x", "y", "z"].map(|name| Port::new(name, Type::F)).to_vec();
    ports.push(Port::new("v", Type::V3));
    let mut function = Function::new("f", ports);
    let outputs = 1 + choices.below(known.len().min(12));
    for i in 0..outputs {
        function.output(format!("out{i}"), known[known.len() - 1 - i]);
    }
    if choices.below(3) == 0 {
        let seeds: Vec<_> = (0..3).map(|i| (arena.input(i, Type::F), arena.f(1.0))).collect();
        let last = known.iter().rev().find(|e| !e.ty().is_bool).expect("the inputs are numbers");
        function.output("slope", Differentiator::new(&arena, &seeds).derivative(*last));
    }
    let len = 1 + choices.below(19);
    let columns: Vec<Vec<f64>> = (0..6).map(|_| (0..len).map(|_| choices.number()).collect()).collect();
    expect_same(&arena, &Kernel::Map(function), &columns);
}

/// An expression of those before.
fn grown<'g>(arena: &'g Arena, known: &[Expr<'g>], choices: &mut Choices) -> Expr<'g> {
    let number = |e: Expr<'g>| if e.ty().is_bool { e.select(arena.f(1.0), arena.f(0.0)) } else { e };
    let pick = |choices: &mut Choices| {
        let back = choices.below(known.len().min(9));
        match choices.below(6) {
            0 => arena.f(choices.number()),
            1 => number(known[choices.below(known.len())]),
            _ => number(known[known.len() - 1 - back]),
        }
    };
    let of = pick(choices);
    match choices.below(12) {
        0 if of.ty().width == 3 => of.component(choices.below(3) as u8),
        1 if of.ty().width == 3 => of.length(),
        2 if of.ty().width == 1 => {
            let parts: Vec<Expr> =
                (0..3).map(|_| pick(choices)).map(|e| if e.ty().width == 1 { e } else { e.component(0) }).collect();
            arena.compose(&parts)
        }
        3 => of.powi(choices.below(9) as i32 - 4),
        _ => {
            let operator = Operator::ALL[choices.below(Operator::ALL.len())];
            let info = operator.info();
            let mut args: Vec<Expr> = (0..info.arity).map(|_| pick(choices)).collect();
            // A boolean argument comes from a comparison, as in a formula, and has the width of the others.
            let width = args.iter().map(|arg| arg.ty().width).max().unwrap_or(1);
            for (i, arg) in args.iter_mut().enumerate().filter(|(i, _)| info.bool_arguments >> i & 1 == 1) {
                let bound = arena.f(i as f64 * 0.5).widen(width);
                *arg = bound.lt(arg.widen(width));
            }
            number(Expr::apply(operator, &args))
        }
    }
}

/// The march and the estimate of a graph.
pub fn graphs(bytes: &[u8]) {
    with_library(|library| {
        let loaded = load_text(library, "input.ron", &as_text(bytes), &[], &mut Diagnostics::default());
        let Some(loaded) = loaded else { return };
        let graph = loaded.graph.with_orbit_settings(|s| s.max_iterations = s.max_iterations.min(12));
        let arena = Arc::new(Arena::default());
        let composer = composer(&arena, library, &graph);
        let salt = salt(bytes);
        let choices = fixed_choices(&composer, salt);
        let mut random = Random::new(salt);
        if let Ok(estimator) = compose_estimator(&composer, &choices, Purpose::Estimate) {
            let points: Vec<[f64; 3]> = (0..21).map(|_| point(&mut random)).collect();
            let columns = Estimator::columns(&points, &[[0.6, 0.0, 0.8]], &[1e-4], 0.0);
            expect_same(&arena, &Kernel::Estimate(estimator), &columns);
        }
        let Ok(estimator) = compose_estimator(&composer, &choices, Purpose::March) else { return };
        let settings = MarchSettings { pixel_radius: 0.1, max_march_steps: 40, ..MarchSettings::default() };
        let march = Kernel::March(compose_march(&arena, estimator, &settings));
        let mut columns = vec![Vec::new(); 8];
        for _ in 0..21 {
            let [x, y, _] = point(&mut random).map(|x| x * 0.05);
            let values = [-4.0, 0.1, 0.05, 1.0, x, y, 0.0, 8.0];
            columns.iter_mut().zip(values).for_each(|(column, value)| column.push(value));
        }
        expect_same(&arena, &march, &columns);
    });
}

fn point(random: &mut Random) -> [f64; 3] {
    std::array::from_fn(|_| match random.below(9) {
        0 => SPICY[random.below(10)],
        _ => random.range(-2.5, 2.5),
    })
}

/// Runs a kernel as machine code of each instruction set and by the interpreter, in both precisions.
fn expect_same(arena: &Arena, kernel: &Kernel, columns: &[Vec<f64>]) {
    for precision in [Precision::F32, Precision::F64] {
        let run = |cpu: Cpu| {
            let kernel = cpu.prepare(arena, kernel).expect("the CPU takes every kernel");
            let inputs = cpu.upload(columns).expect("columns fit");
            cpu.download(&cpu.run(&kernel, &[&inputs]).expect("the CPU runs every kernel")).expect("columns fit")
        };
        let best = Cpu::new(precision);
        if !best.compiles() {
            return;
        }
        for cpu in [best, best.narrow()] {
            let (compiled, interpreted) = (run(cpu), run(cpu.interpreted()));
            for (k, (a, b)) in compiled.iter().zip(&interpreted).enumerate() {
                for (i, (a, b)) in a.iter().zip(b).enumerate() {
                    let same = a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan();
                    let at: Vec<f64> = columns.iter().map(|column| column[i]).collect();
                    let said = || format!("{}, output {k} at {at:?}: compiled {a}, interpreted {b}", cpu.description());
                    assert!(same, "{}\n{}", said(), listing::listing(arena, kernel));
                }
            }
        }
    }
}
