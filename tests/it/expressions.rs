//! Properties of expressions: simplifying keeps values, derivatives are those of finite differences, and both hold for
//! every operator of the table on every back end.

use bulbfold::check::{Backends, Random, Target};
use bulbfold::expr::ops::Operator;
use bulbfold::expr::{Arena, Differentiator, Expr, Function, Port, Type};
use bulbfold::kernel::cpu::Cpu;
use bulbfold::kernel::work::Work;
use bulbfold::kernel::{Backend, Kernel};
use bulbfold::math::Precision;

/// Values that break things: zeros, folds, poles, halves, far and near. All finite; see `SPECIAL` for the others.
const SPICY: &[f64] = &[
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    -0.5,
    2.0,
    -2.0,
    1e-9,
    -1e-9,
    1e-3,
    3.0,
    -3.0,
    0.25,
    7.5,
    -7.5,
    100.0,
    1e4,
    -1e4,
    std::f64::consts::PI,
    std::f64::consts::FRAC_PI_2,
    -std::f64::consts::FRAC_PI_2,
];
const SPECIAL: &[f64] = &[f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e300, 1e-300];

/// Triples of spicy values.
fn triples(values: &[f64]) -> Vec<[f64; 3]> {
    let mut all = Vec::new();
    for &a in values {
        for &b in values {
            all.extend([0.0, 1.0, -2.5, 0.75].map(|c| [a, b, c]));
        }
    }
    all
}

fn inputs(arena: &Arena, operator: Operator) -> Vec<Expr<'_>> {
    let info = operator.info();
    (0..info.arity)
        .map(|i| {
            let x = arena.input(i as u16, Type::F);
            // A boolean argument comes from a comparison, as in a formula.
            if info.bool_arguments >> i & 1 == 1 { arena.f(0.0).lt(x) } else { x }
        })
        .collect()
}

fn number<'g>(arena: &'g Arena, e: Expr<'g>) -> Expr<'g> {
    if e.ty().is_bool { e.select(arena.f(1.0), arena.f(0.0)) } else { e }
}

fn run(arena: &Arena, target: Target, outputs: &[Expr], points: &[[f64; 3]]) -> Vec<Vec<f64>> {
    let ports = (0..3).map(|i| Port::new(format!("x{i}"), Type::F)).collect();
    let mut function = Function::new("f", ports);
    for (i, e) in outputs.iter().enumerate() {
        function.output(format!("y{i}"), *e);
    }
    let columns: Vec<Vec<f64>> = (0..3).map(|i| points.iter().map(|p| p[i]).collect()).collect();
    Backends::cpu_only().run(target, arena, &Kernel::Map(function), &columns).unwrap()
}

fn same(a: f64, b: f64, tolerance: f64) -> bool {
    a == b || (a.is_nan() && b.is_nan()) || (a - b).abs() <= tolerance * a.abs().max(b.abs()).max(1.0)
}

#[test]
fn every_operator_runs_as_it_folds() {
    for &operator in Operator::ALL {
        let arena = Arena::default();
        let y = number(&arena, Expr::apply(operator, &inputs(&arena, operator)));
        let points: Vec<[f64; 3]> = triples(SPICY).into_iter().chain(triples(SPECIAL)).collect();
        let found = run(&arena, Target::CPU_F64, &[y], &points);
        for (p, found) in points.iter().zip(&found[0]) {
            let args: Vec<f64> =
                (0..3)
                    .map(|i| {
                        if operator.info().bool_arguments >> i & 1 == 1 {
                            f64::from(u8::from(p[i] > 0.0))
                        } else {
                            p[i]
                        }
                    })
                    .collect();
            let folded = operator.evaluate_f64(args[0], args[1], args[2]);
            assert!(same(*found, folded, 1e-14), "{operator:?} of {p:?}: folded {folded}, run {found}");
        }
    }
}

#[test]
fn constants_fold_to_what_would_run() {
    for &operator in Operator::ALL {
        for p in triples(SPICY) {
            let arena = Arena::default();
            let args: Vec<Expr> = (0..operator.info().arity)
                .map(|i| match operator.info().bool_arguments >> i & 1 == 1 {
                    true => arena.bool(p[i] > 0.0),
                    false => arena.f(p[i]),
                })
                .collect();
            let folded = number(&arena, Expr::apply(operator, &args)).as_constant();
            let variable = number(&arena, Expr::apply(operator, &inputs(&arena, operator)));
            let found = run(&arena, Target::CPU_F64, &[variable], &[p])[0][0];
            if let Some([folded, ..]) = folded {
                assert!(same(found, folded, 1e-14), "{operator:?} of {p:?}: folded {folded}, run {found}");
            }
        }
    }
}

#[test]
fn simplified_mixtures_of_constants_and_inputs_keep_values() {
    // Each argument is an input or a telling constant: 0, 1, -1, 2 are where identities apply.
    let constants = [0.0, 1.0, -1.0, 2.0];
    for &operator in Operator::ALL {
        let info = operator.info();
        for choice in 0..5usize.pow(info.arity as u32) {
            let picks: Vec<usize> = (0..info.arity).map(|i| choice / 5usize.pow(i as u32) % 5).collect();
            let arena = Arena::default();
            let args: Vec<Expr> = inputs(&arena, operator)
                .into_iter()
                .zip(&picks)
                .map(|(x, &pick)| match (pick, x.ty().is_bool) {
                    (0, _) => x,
                    (pick, true) => arena.bool(constants[pick - 1] > 0.0),
                    (pick, false) => arena.f(constants[pick - 1]),
                })
                .collect();
            let y = number(&arena, Expr::apply(operator, &args));
            let points: Vec<[f64; 3]> = SPICY.iter().map(|&x| [x, x * 0.5 + 0.1, 1.5 - x]).collect();
            let found = run(&arena, Target::CPU_F64, &[y], &points);
            for (p, found) in points.iter().zip(&found[0]) {
                let value = |i: usize| match picks.get(i).copied().unwrap_or(0) {
                    0 => p[i],
                    pick => constants[pick - 1],
                };
                let as_bool = |i: usize| info.bool_arguments >> i & 1 == 1;
                let args = [0, 1, 2].map(|i| if as_bool(i) { f64::from(u8::from(value(i) > 0.0)) } else { value(i) });
                let wanted = operator.evaluate_f64(args[0], args[1], args[2]);
                // 0 * x is taken as 0 for every x, so only finite values are held to be kept.
                assert!(
                    !wanted.is_finite() || same(*found, wanted, 1e-14),
                    "{operator:?} {picks:?} at {p:?}: {wanted} became {found}"
                );
            }
        }
    }
}

#[test]
fn derivatives_are_those_of_finite_differences() {
    let mut compared = 0;
    for &operator in Operator::ALL {
        if operator.info().bool_result {
            continue;
        }
        let arena = Arena::default();
        let y = Expr::apply(operator, &inputs(&arena, operator));
        for axis in 0..operator.info().arity {
            if operator.info().bool_arguments >> axis & 1 == 1 {
                continue;
            }
            let x = arena.input(axis as u16, Type::F);
            let dy = Differentiator::new(&arena, &[(x, arena.f(1.0))]).derivative(y);
            // An operator that jumps may jump many times within a difference where an argument is smaller than its step.
            let least = if operator.info().continuous { 0.0 } else { 1e-3 };
            let usable = |x: &f64| x.abs() < 50.0 && (*x == 0.0 || x.abs() >= least);
            // A range of no width is a crease from every side.
            let crease = |p: &[f64; 3]| operator == Operator::Clamp && p[2] <= p[1];
            let points: Vec<[f64; 3]> =
                triples(SPICY).into_iter().filter(|p| p.iter().all(usable) && !crease(p)).collect();
            let h = 1e-5;
            let moved = |by: f64| -> Vec<[f64; 3]> {
                points
                    .iter()
                    .map(|p| {
                        let mut p = *p;
                        p[axis] += by;
                        p
                    })
                    .collect()
            };
            let at = |by: f64| run(&arena, Target::CPU_F64, &[y], &moved(by)).swap_remove(0);
            let exact = run(&arena, Target::CPU_F64, &[dy], &points).swap_remove(0);
            let (a, b, c, d, middle) = (at(-h), at(h), at(-h / 2.0), at(h / 2.0), at(0.0));
            for i in 0..points.len() {
                let (wide, narrow) = ((b[i] - a[i]) / (2.0 * h), (d[i] - c[i]) / h);
                let one_sided = (middle[i] - a[i]) / h;
                let size = wide.abs().max(1.0);
                let smooth = (wide - narrow).abs() < 1e-6 * size && (one_sided - wide).abs() < 1e-2 * size;
                if smooth {
                    compared += 1;
                    assert!(
                        (exact[i] - wide).abs() < 1e-5 * size,
                        "{operator:?} axis {axis} at {:?}: expected {wide}, found {}",
                        points[i],
                        exact[i]
                    );
                }
            }
        }
    }
    assert!(compared > 10_000, "only {compared} derivatives were compared");
}

/// A random expression of three inputs, of operators that are defined everywhere.
fn random_expression<'g>(arena: &'g Arena, random: &mut Random, depth: u32) -> Expr<'g> {
    if depth == 0 || random.below(8) == 0 {
        return match random.below(5) {
            0 => arena.f([0.0, 1.0, -1.0, 2.0, 0.5][random.below(5)]),
            i => arena.input((i % 3) as u16, Type::F),
        };
    }
    let of = |random: &mut Random| random_expression(arena, random, depth - 1);
    let (a, b) = (of(random), of(random));
    match random.below(12) {
        0 => a + b,
        1 => a - b,
        2 => a * b,
        3 => a / (b * b + 1.0),
        4 => a.min(b),
        5 => a.max(b),
        6 => a.sin() + b.cos(),
        7 => a.abs() - b,
        8 => a.lt(b).select(a, b * 2.0),
        9 => (a * a + 0.5).sqrt() - b,
        10 => a.clamp(arena.f(-1.0), arena.f(1.0)) * b,
        _ => -(a.powi(3) * 0.1) + b,
    }
}

/// Compiled and interpreted results of functions of three numbers, in both precisions.
fn expect_same_code(arena: &Arena, roots: &[Expr], points: &[[f64; 3]]) {
    let mut function = Function::new("f", ["x", "y", "z"].map(|name| Port::new(name, Type::F)).to_vec());
    roots.iter().enumerate().for_each(|(i, root)| function.output(format!("out{i}"), number(arena, *root)));
    let kernel = Kernel::Map(function);
    let columns: Vec<Vec<f64>> = (0..3).map(|i| points.iter().map(|p| p[i]).collect()).collect();
    for precision in [Precision::F32, Precision::F64] {
        let run = |cpu: Cpu| {
            let kernel = cpu.prepare(arena, &kernel).expect("the CPU takes every kernel");
            let inputs = cpu.upload(&columns).expect("columns fit");
            cpu.download(&cpu.run(&kernel, &[&inputs]).expect("the CPU runs every kernel")).expect("columns fit")
        };
        let (compiled, interpreted) = (run(Cpu::new(precision)), run(Cpu::new(precision).interpreted()));
        for (k, (a, b)) in compiled.iter().zip(&interpreted).enumerate() {
            for (i, (a, b)) in a.iter().zip(b).enumerate() {
                let same = a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan();
                assert!(same, "{precision:?}, output {k} at {:?}: compiled {a}, interpreted {b}", points[i]);
            }
        }
    }
}

#[test]
fn machine_code_is_the_interpreters_for_every_operator_and_random_expressions() {
    let mut points = triples(SPICY);
    points.extend(triples(SPECIAL));
    for operator in Operator::ALL {
        let arena = Arena::default();
        let value = Expr::apply(*operator, &inputs(&arena, *operator));
        expect_same_code(&arena, &[value], &points);
    }
    let mut random = Random::new(9);
    for _ in 0..200 {
        let arena = Arena::default();
        // Many results at once, so that registers run out.
        let roots: Vec<Expr> = (0..40).map(|_| random_expression(&arena, &mut random, 4)).collect();
        let points: Vec<[f64; 3]> = (0..40).map(|_| [0; 3].map(|_| random.range(-2.0, 2.0))).collect();
        expect_same_code(&arena, &roots, &points);
    }
}

#[test]
fn random_expressions_have_the_derivatives_of_their_differences() {
    let mut random = Random::new(5);
    let mut compared = 0;
    for _ in 0..300 {
        let arena = Arena::default();
        let y = random_expression(&arena, &mut random, 5);
        let points: Vec<[f64; 3]> = (0..20).map(|_| [0; 3].map(|_| random.range(-2.0, 2.0))).collect();
        let direction = random.direction();
        let seeds: Vec<_> = (0..3).map(|i| (arena.input(i as u16, Type::F), arena.f(direction[i]))).collect();
        let dy = Differentiator::new(&arena, &seeds).derivative(y);
        let h = 1e-6;
        let at = |by: f64| -> Vec<f64> {
            let moved: Vec<_> = points.iter().map(|p| [0, 1, 2].map(|i| p[i] + by * direction[i])).collect();
            run(&arena, Target::CPU_F64, &[y], &moved).swap_remove(0)
        };
        let (a, b, c, d) = (at(-h), at(h), at(-h / 2.0), at(h / 2.0));
        let exact = run(&arena, Target::CPU_F64, &[dy], &points).swap_remove(0);
        for i in 0..points.len() {
            let (wide, narrow) = ((b[i] - a[i]) / (2.0 * h), (d[i] - c[i]) / h);
            let size = wide.abs().max(y_size(&b, i));
            if wide.is_finite() && (wide - narrow).abs() < 1e-6 * size {
                compared += 1;
                assert!(
                    (exact[i] - wide).abs() < 1e-4 * size,
                    "at {:?}: expected {wide}, found {}",
                    points[i],
                    exact[i]
                );
            }
        }
    }
    assert!(compared > 4000, "only {compared} derivatives were compared");
}

/// Rounding of a difference is that of the values.
fn y_size(values: &[f64], i: usize) -> f64 {
    values[i].abs().max(1.0)
}

#[test]
fn wide_single_precision_agrees_on_random_expressions() {
    let mut random = Random::new(6);
    for _ in 0..200 {
        let arena = Arena::default();
        let y = random_expression(&arena, &mut random, 4);
        let points: Vec<[f64; 3]> =
            (0..40).map(|_| [0; 3].map(|_| f64::from(random.range(-2.0, 2.0) as f32))).collect();
        let moved: Vec<[f64; 3]> = points.iter().map(|p| p.map(|x| x + 1e-6)).collect();
        let double = run(&arena, Target::CPU_F64, &[y], &points).swap_remove(0);
        let nudged = run(&arena, Target::CPU_F64, &[y], &moved).swap_remove(0);
        let single = run(&arena, Target::CPU_F32, &[y], &points).swap_remove(0);
        for i in 0..points.len() {
            // What a nudge of the inputs explains is rounding (beside a jump, for example).
            let slack = 1e-4 * double[i].abs().max(1.0) + 20.0 * (double[i] - nudged[i]).abs();
            assert!((double[i] - single[i]).abs() <= slack, "at {:?}: f64 {} f32 {}", points[i], double[i], single[i]);
        }
    }
}

/// The product of a complex number whose parts are vectors with one whose parts are numbers.
fn complex_product<'g>([re, im]: [Expr<'g>; 2], by: [Expr<'g>; 2]) -> [Expr<'g>; 2] {
    let [c, s] = by.map(|x| x.widen(3));
    [re * c - im * s, im * c + re * s]
}

#[test]
fn complex_numbers_meet_before_they_meet_vectors() {
    let arena = Arena::default();
    let ports = ["a", "b"].map(|name| Port::new(name, Type::V3));
    let numbers = ["p", "p_im", "q", "q_im", "r", "r_im"].map(|name| Port::new(name, Type::F));
    let mut function = Function::new("chain", ports.into_iter().chain(numbers).collect());
    let vectors = [arena.input(0, Type::V3), arena.input(1, Type::V3)];
    let factors = [2, 4, 6].map(|i| [arena.input(i, Type::F), arena.input(i + 1, Type::F)]);
    let [re, im] = factors.into_iter().fold(vectors, complex_product);
    function.output("re", re);
    function.output("im", im);
    let kernel = Kernel::Map(function);
    // Two products of numbers, of two operations, and one of vectors, of six.
    assert_eq!(Work::of(&arena, &kernel).total(1.0, 1.0), 10.0);

    // (1 + 2i) (3 - i) (2 + i) is 5 + 15i; times the parts (1, 0), (0, 1) and (2, -3) of a + i b.
    let cpu = Cpu::new(Precision::F64);
    let columns: Vec<Vec<f64>> =
        [1.0, 0.0, 2.0, 0.0, 1.0, -3.0, 1.0, 2.0, 3.0, -1.0, 2.0, 1.0].map(|x| vec![x]).to_vec();
    let columns = cpu.upload(&columns).expect("columns fit");
    let kernel = cpu.prepare(&arena, &kernel).expect("the CPU takes every kernel");
    let result = cpu.run(&kernel, &[&columns]).expect("the CPU runs every kernel");
    let result = cpu.download(&result).expect("the CPU holds every column");
    let [re, im] = [5.0, 15.0];
    let expected = [re, -im, 2.0 * re + 3.0 * im, im, re, 2.0 * im - 3.0 * re];
    assert_eq!(result.concat(), expected);
}

#[test]
fn pictures_are_encoded_as_srgb_says() {
    let arena = Arena::default();
    let kernel = Kernel::Map(bulbfold::film::compose_develop(&arena, bulbfold::film::Develop::PLANE));
    let red: Vec<f64> =
        (-10..=2100).map(|i| f64::from(i) / 2000.0).chain([f64::NAN, 1e-7, 0.0031308, 0.00314]).collect();
    let green: Vec<f64> = red.iter().rev().copied().collect();
    let blue = vec![0.25; red.len()];
    let byte = |x: f64| {
        let x = x.clamp(0.0, 1.0);
        255.0 * if x <= 0.0031308 { x * 12.92 } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
    };
    let columns = [red, green, blue];
    for target in Backends::cpu_only().targets() {
        let encoded = Backends::cpu_only().run(target, &arena, &kernel, &columns).unwrap();
        for (i, &all) in encoded[0].iter().enumerate() {
            let bytes = [(all / 65536.0).floor(), (all / 256.0).floor() % 256.0, all % 256.0];
            for (column, found) in columns.iter().zip(bytes) {
                let wanted = if column[i].is_nan() { 0.0 } else { byte(column[i]) };
                assert!((found - wanted).abs() < 0.501, "{target:?}: {} became {found} and not {wanted}", column[i]);
            }
        }
    }
}

#[test]
fn a_constant_over_a_number_is_one_quotient() {
    let run = |with_inverse: bool| {
        let arena = Arena::default();
        let mut function = Function::new("quotient", vec![Port::new("x", Type::F)]);
        let x = arena.input(0, Type::F);
        let inverse = arena.f(1.0) / x;
        function.output("of_three", inverse * 3.0);
        function.output("in_a_sum", inverse * 3.0 + x);
        if with_inverse {
            function.output("inverse", inverse);
        }
        let kernel = Kernel::Map(function);
        let cpu = Cpu::new(Precision::F64);
        let columns = cpu.upload(&[vec![7.0, -0.3]]).expect("columns fit");
        let prepared = cpu.prepare(&arena, &kernel).expect("the CPU takes every kernel");
        let results = cpu.run(&prepared, &[&columns]).expect("the CPU runs every kernel");
        (Work::of(&arena, &kernel).total(1.0, 1.0), cpu.download(&results).expect("the CPU holds every column"))
    };
    // A quotient, which counts as three products, and a sum; with the inverse itself a product more.
    let (operations, results) = run(false);
    assert_eq!((operations, &results[0]), (4.0, &vec![3.0 / 7.0, 3.0 / -0.3]));
    assert_eq!(results[1], vec![3.0 / 7.0 + 7.0, 3.0 / -0.3 - 0.3]);
    let (operations, results) = run(true);
    assert_eq!((operations, &results[2]), (5.0, &vec![1.0 / 7.0, 1.0 / -0.3]));
}

#[test]
fn bytes_are_rounded_to_the_nearest() {
    use bulbfold::film::srgb_byte;
    for byte in 0..=255_u8 {
        let value = f64::from(byte) / 255.0;
        assert_eq!(srgb_byte(value), byte);
        assert_eq!(srgb_byte(value + 0.499 / 255.0), byte);
        assert_eq!(srgb_byte(value - 0.499 / 255.0), byte);
    }
    assert_eq!([srgb_byte(-1.0), srgb_byte(0.5), srgb_byte(1e9), srgb_byte(f64::NAN)], [0, 128, 255, 0]);
}
