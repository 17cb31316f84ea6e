//! The GPU against the CPU: every operator, and the estimates, marches and pictures of the built-in formulas.

use std::time::Instant;

use super::{AdapterWanted, Gpu, GpuKernel, adapters};
use crate::expr::ops::Operator;
use crate::expr::{Arena, Expr, Function, Port, Type};
use crate::graph::{EstimateSettings, Method, Schedule};
use crate::kernel::cpu::Cpu;
use crate::kernel::records::Marched;
use crate::kernel::wgsl::tests::{pipeline, scheduled};
use crate::kernel::{Backend, BackendError, Estimator, Kernel, Results, Status};
use crate::math::Precision;
use crate::render::{Pipeline, RenderSettings, Renderer, Role};
use crate::shade::Size;

/// A GPU, or `None` if there is none and none is required.
pub(super) fn gpu() -> Option<Gpu> {
    match Gpu::new(AdapterWanted::Any) {
        Ok(gpu) => Some(gpu),
        Err(error) if std::env::var("BULBFOLD_REQUIRE_GPU").is_ok_and(|v| v == "1") => panic!("{error}"),
        Err(error) => {
            println!("skipped: {error}"); // "no GPU adapter", and why
            None
        }
    }
}

fn run<B: Backend>(backend: &B, arena: &Arena, kernel: &Kernel, columns: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let prepared = backend.prepare(arena, kernel).unwrap_or_else(|error| panic!("{error}"));
    let columns = backend.upload(columns).unwrap_or_else(|error| panic!("{error}"));
    let result = backend.run(&prepared, &[&columns]).unwrap_or_else(|error| panic!("{error}"));
    backend.download(&result).unwrap_or_else(|error| panic!("{error}"))
}

/// Inputs at which operators tend to go wrong, all of them exact in single precision.
fn spicy() -> Vec<f64> {
    use std::f32::consts::PI;
    let mut list: Vec<f32> = vec![0.0, 1e-20, 1e-3, 0.3, 0.5, 0.999, 1.0, 1.5, 2.0, 7.25, 100.0, 1e10];
    list.extend([0.25 * PI, 0.5 * PI, PI, 2.0 * PI, 10.0 * PI]);
    let negative: Vec<f32> = list.iter().map(|x| -x).collect();
    list.extend(negative);
    list.into_iter().map(f64::from).collect()
}

/// Largest error of an operator: relative, and absolute where the value is small. The reasons are WGSL's accuracy
/// requirements (section 15.7.4) unless noted.
fn tolerance(operator: Operator) -> (f64, f64) {
    match operator {
        // 2^-11 absolute within [-pi, pi], nothing beyond; drivers in use do far better up to 10 pi.
        Operator::Sin | Operator::Cos => (0.0, 5e-4),
        // 4096 ulp.
        Operator::Atan2 | Operator::Asin | Operator::Acos => (5e-4, 5e-4),
        // (3 + 2 |x|) ulp, and the argument of exp is at most 100 here.
        Operator::Exp => (3e-5, 0.0),
        // 2^-21 absolute near 1, 3 ulp elsewhere.
        Operator::Ln => (1e-6, 1e-6),
        // As exp2(y log2(x)).
        Operator::Pow => (1e-4, 1e-30),
        // One rounding of a product of at most 1e3 divisors.
        Operator::Mod => (1e-5, 1e-5),
        // Inherited from 1 / inverseSqrt(x); 2.5 ulp.
        Operator::Sqrt | Operator::Div => (1e-6, 1e-30),
        _ => (1e-7, 1e-30),
    }
}

/// True if an operator's value is not comparable: beyond single precision, beyond what drivers promise, or at a jump.
fn is_out_of_reach(operator: Operator, x: &[f64], expected: f64) -> bool {
    let overflows = expected.abs() > 3e38 || (expected != 0.0 && expected.abs() < 1.2e-38);
    overflows
        || match operator {
            Operator::Sin | Operator::Cos => x[0].abs() > 1e3,
            // -0 has no angle of its own on most drivers; a tiny angle is lost beside a large x.
            Operator::Atan2 => x[0] == 0.0 || x[1].abs() > 1e9 || x[0].abs() > 1e9,
            // Where the quotient is nearly whole, its rounding decides between 0 and the divisor.
            Operator::Mod => {
                let quotient = x[0] / x[1];
                x[1] == 0.0
                    || quotient.abs() > 1e3
                    || (quotient - quotient.round()).abs() < 1e-6 * quotient.abs().max(1.0)
            }
            Operator::Div => x[1] == 0.0 || x[1].abs() > 1e9,
            _ => false,
        }
}

#[test]
fn every_operator_agrees_with_the_cpu() {
    let Some(gpu) = gpu() else { return };
    let values = spicy();
    let mut failures = Vec::new();
    for &operator in Operator::ALL {
        let info = operator.info();
        let mut rows: Vec<Vec<f64>> = vec![Vec::new()];
        for i in 0..info.arity {
            let is_bool = info.bool_arguments >> i & 1 == 1;
            // Of the third argument, every third value will do.
            let choices: Vec<f64> = match (is_bool, i) {
                (true, _) => vec![0.0, 1.0],
                (_, 2) => values.iter().copied().step_by(3).collect(),
                _ => values.clone(),
            };
            rows = rows.iter().flat_map(|row| choices.iter().map(|&x| [row.clone(), vec![x]].concat())).collect();
        }
        let columns: Vec<Vec<f64>> = (0..info.arity).map(|i| rows.iter().map(|row| row[i]).collect()).collect();
        let arena = Arena::default();
        let ports: Vec<Port> = (0..info.arity)
            .map(|i| Port::new(format!("x{i}"), Type { is_bool: info.bool_arguments >> i & 1 == 1, width: 1 }))
            .collect();
        let mut function = Function::new("operator", ports);
        let inputs = function.input_exprs(&arena);
        function.output("y", Expr::apply(operator, &inputs));
        // The same through vectors, whose helpers are others.
        let wide: Vec<Expr> = inputs.iter().map(|x| x.widen(3)).collect();
        function.output("wide", Expr::apply(operator, &wide).component(2));
        let kernel = Kernel::Map(function);
        let got = run(&gpu, &arena, &kernel, &columns);
        let expected = run(&Cpu::new(Precision::F64), &arena, &kernel, &columns);
        let (relative, absolute) = tolerance(operator);
        for (i, row) in rows.iter().enumerate() {
            for column in 0..2 {
                let (a, b) = (got[column][i], expected[column][i]);
                let allowed = b.abs() * relative + absolute;
                let is_close = (a.is_nan() && b.is_nan()) || a == b || (a - b).abs() <= allowed;
                if !is_close && !is_out_of_reach(operator, row, b) {
                    failures.push(format!("{} {row:?}: {a} instead of {b}", info.name));
                }
            }
        }
    }
    assert!(failures.is_empty(), "{} differ:\n{}", failures.len(), failures[..failures.len().min(60)].join("\n"));
}

#[test]
fn orbits_that_leave_every_range_count_as_escaped() {
    let Some(gpu) = gpu() else { return };
    let arena = Arena::default();
    let mut function = Function::new("escape", vec![Port::new("x", Type::F)]);
    let x = arena.input(0, Type::F);
    function.output("escaped", !(x * x).le(arena.f(100.0)));
    function.output("nan", !(x * x - x * x).le(arena.f(100.0)));
    let columns = [vec![1.0, 20.0, 1e30, f64::INFINITY, f64::NAN]];
    let got = run(&gpu, &arena, &Kernel::Map(function), &columns);
    assert_eq!(got[0], [0.0, 1.0, 1.0, 1.0, 1.0]);
}

#[test]
fn columns_of_several_buffers_are_joined_and_empty_ones_are_fine() {
    let Some(gpu) = gpu() else { return };
    let arena = Arena::default();
    let mut function = Function::new("sum", vec![Port::new("a", Type::V3), Port::new("b", Type::F)]);
    function.output("sum", arena.input(0, Type::V3) + arena.input(1, Type::F));
    let prepared = gpu.prepare(&arena, &Kernel::Map(function)).expect("a legal kernel");
    let a = gpu.upload(&[vec![1.0; 100], vec![2.0; 100], vec![3.0; 100]]).expect("little memory");
    let b = gpu.upload(&[Vec::from_iter((0..100).map(f64::from))]).expect("little memory");
    let sum = gpu.run(&prepared, &[&a, &b]).and_then(|c| gpu.download(&c)).expect("it runs");
    assert_eq!((sum[0][99], sum[1][0], sum[2][7]), (100.0, 2.0, 10.0));
    let none = gpu.upload(&vec![Vec::new(); 4]).expect("no memory");
    let sum = gpu.run(&prepared, &[&none]).and_then(|c| gpu.download(&c)).expect("it runs");
    assert_eq!(sum, vec![Vec::<f64>::new(); 3]);
}

#[test]
fn columns_of_several_results_are_read_together() {
    let Some(gpu) = gpu() else { return };
    let upload = |columns: &[Vec<f64>]| gpu.upload(columns).expect("little memory");
    let (long, short) = (upload(&[vec![1.0, 2.0, 3.0], vec![4.0, 5.0, 6.0]]), upload(&[vec![7.0]]));
    let empty = upload(&[vec![], vec![]]);
    let wanted: [(&_, &[usize]); 4] = [(&long, &[1, 0]), (&empty, &[0, 1]), (&short, &[0]), (&long, &[])];
    let of_long: Vec<&[f32]> = vec![&[4.0, 5.0, 6.0], &[1.0, 2.0, 3.0]];
    let (of_short, nothing): (Vec<&[f32]>, Vec<&[f32]>) = (vec![&[7.0]], vec![&[], &[]]);
    let expected = Results::F32(vec![of_long, nothing.clone(), of_short, vec![]]);
    assert!(gpu.read(&wanted, |results| results == expected).expect("it works"));
    let expected = Results::F32(vec![nothing]);
    assert!(gpu.read(&wanted[1..2], |results| results == expected).expect("nothing to wait for"));
}

#[test]
fn columns_are_downloaded_in_the_order_asked_for() {
    let Some(gpu) = gpu() else { return };
    let columns = gpu.upload(&[vec![1.0, 2.0], vec![3.0, 4.0], vec![5.0, 6.0]]).expect("little memory");
    assert_eq!(gpu.download_only(&columns, &[2, 0]).expect("it works"), [[5.0, 6.0], [1.0, 2.0]]);
    assert!(gpu.download_only(&columns, &[]).expect("nothing is asked for").is_empty());
}

/// A march that two threads run at a time gives each of them what it gives alone.
#[test]
fn threads_do_not_disturb_each_other() {
    let Some(gpu) = gpu() else { return };
    let settings = RenderSettings { size: Size { width: 320, height: 240 }, ..Default::default() };
    let (arena, pipeline) = pipeline("mandelbulb", &settings);
    let rays = rays(&arena, &pipeline, settings.size);
    let kernel = gpu.prepare(&arena, pipeline.kernel(Role::March)).expect("a legal kernel");
    let march = || {
        let rays = gpu.upload(&rays).expect("little memory");
        gpu.run(&kernel, &[&rays]).and_then(|hits| gpu.download(&hits)).expect("it runs")
    };
    let alone = march();
    std::thread::scope(|scope| {
        let all = [0; 2].map(|_| scope.spawn(|| (0..4).all(|_| march() == alone)));
        assert!(all.into_iter().all(|thread| thread.join().expect("no thread fails")));
    });
}

#[test]
fn what_the_device_refuses_is_an_error() {
    let Some(gpu) = gpu() else { return };
    let result = gpu.columns(1 << 20, 1 << 32);
    assert!(matches!(result, Err(BackendError::OutOfMemory(_))));
    let columns = gpu.upload(&[vec![1.0]]).expect("the device still works");
    gpu.device.destroy();
    let lost = gpu.download(&columns);
    assert!(matches!(lost, Err(BackendError::DeviceLost(_))), "{lost:?}");
}

#[test]
fn a_lost_device_is_rebuilt() {
    let Some(mut gpu) = gpu() else { return };
    gpu.device.destroy();
    assert!(matches!(gpu.upload(&[vec![1.0]]), Err(BackendError::DeviceLost(_))));
    gpu.rebuild().expect("the adapter is still there");
    let columns = gpu.upload(&[vec![1.0]]).expect("the new device works");
    assert_eq!(gpu.download(&columns).expect("it does"), [[1.0]]);
}

#[test]
fn schedules_run_as_on_the_cpu() {
    let Some(gpu) = gpu() else { return };
    let arena = Arena::default();
    let points = [0.0, 999_970.0, 2e6].map(|x| [x, 0.0, 0.0]);
    let columns = Estimator::columns(&points, &[[1.0, 0.0, 0.0]], &[0.0], 0.0);
    for (prefix, cycle) in [(vec![], vec![0, 1]), (vec![2, 2], vec![0, 1, 0]), (vec![1], vec![2])] {
        let kernel = Kernel::Estimate(scheduled(&arena, Schedule { prefix, cycle }, 3, 8));
        assert_eq!(run(&gpu, &arena, &kernel, &columns), run(&Cpu::new(Precision::F64), &arena, &kernel, &columns));
    }
}

/// Rays through every eighth pixel of a picture.
fn rays(arena: &Arena, pipeline: &Pipeline, size: Size) -> Vec<Vec<f64>> {
    let axis = |n: u32| (0..n).step_by(8).map(|i| f64::from(i) + 0.5);
    let pixels: Vec<(f64, f64)> = axis(size.height).flat_map(|y| axis(size.width).map(move |x| (x, y))).collect();
    let columns = [pixels.iter().map(|p| p.0).collect(), pixels.iter().map(|p| p.1).collect()];
    // Rays in single precision, so that all back ends march the same ones.
    let columns = run(&Cpu::new(Precision::F64), arena, pipeline.kernel(Role::Camera), &columns);
    columns.into_iter().map(|c| c.into_iter().map(|x| f64::from(x as f32)).collect()).collect()
}

#[test]
fn depths_agree_with_the_cpu() {
    let Some(gpu) = gpu() else { return };
    let settings = RenderSettings { size: Size { width: 640, height: 480 }, ..Default::default() };
    for name in ["mandelbulb", "mandelbox"] {
        let (arena, pipeline) = pipeline(name, &settings);
        let rays = rays(&arena, &pipeline, settings.size);
        let got = run(&gpu, &arena, pipeline.kernel(Role::March), &rays);
        let got_ends: Vec<Status> = got[5].iter().map(|&code| Status::from_code(code)).collect();
        for precision in [Precision::F32, Precision::F64] {
            let expected = run(&Cpu::new(precision), &arena, pipeline.kernel(Role::March), &rays);
            let (mut hits, mut same_end, mut close) = (0, 0, 0);
            for (i, &end) in got_ends.iter().enumerate() {
                let expected_end = Status::from_code(expected[5][i]);
                same_end += usize::from(end == expected_end);
                if end == Status::Hit && expected_end == Status::Hit {
                    hits += 1;
                    let (a, b) = (got[0][i], expected[0][i]);
                    close += usize::from((a - b).abs() <= pipeline.pixel.pixel_radius * b);
                }
            }
            let share = |n: usize, of: usize| n as f64 / of as f64;
            let (ends, depths) = (share(same_end, got_ends.len()), share(close, hits));
            println!("{name} {precision:?}: {hits} hits, same end {ends:.4}, within half a pixel {depths:.4}");
            assert!(hits > 500, "{name}: {hits} hits");
            // Rays that graze the surface may go either way; the rest has chaotic features below single precision.
            assert!(ends > 0.99 && depths > 0.95, "{name} {precision:?}: {ends} {depths}");
        }
    }
}

/// What is known for a fast device lets a march go without being watched, and its results are those of slices.
#[test]
fn marches_that_nobody_watches_end_as_those_in_slices() {
    let Some(gpu) = gpu() else { return };
    let size = Size { width: 320, height: 240 };
    // So short steps that some rays take more than a thousand.
    let estimate = EstimateSettings { method: Some(Method::Scalar), fudge: Some(0.01), ..Default::default() };
    let settings = RenderSettings { size, estimate, plain: true, ..Default::default() };
    let (arena, pipeline) = pipeline("mandelbulb", &settings);
    let rays = gpu.upload(&rays(&arena, &pipeline, size)).expect("little memory");
    let prepare = || gpu.prepare(&arena, pipeline.kernel(Role::March)).expect("a legal kernel");
    let ends = |kernel: &GpuKernel| {
        let before = gpu.dispatches().count;
        let ends = gpu.run(kernel, &[&rays]).and_then(|ends| gpu.download(&ends)).expect("it runs");
        (ends, gpu.dispatches().count - before)
    };
    let (in_slices, watched) = ends(&prepare());
    assert!(watched > 1, "{watched}");
    let steps = Marched::COLUMNS.steps;
    let unfinished = in_slices[steps].iter().filter(|&&steps| steps > 800.0).count();
    assert!(unfinished > 100, "{unfinished} long rays");
    let slices = &gpu.prepare(&arena, pipeline.kernel(Role::March)).expect("a legal kernel").pipelines.slices;
    // The longest rays in time, then only so long that some are left, then nothing for certain.
    for (price, step, is_watched) in [(1e-12, 1e-6, false), (1e-12, 9e-5, true), (1e-3, 1e-6, true)] {
        slices.know(price, step);
        let (ends, watched) = ends(&prepare());
        assert!(ends == in_slices, "{price} s an estimate, {step} s a step");
        assert_eq!(watched > 0, is_watched, "{price} s an estimate, {step} s a step");
    }
}

#[test]
fn estimates_agree_with_the_cpu() {
    let Some(gpu) = gpu() else { return };
    for name in ["mandelbulb", "mandelbox"] {
        let (arena, pipeline) = pipeline(name, &RenderSettings::default());
        let estimator = match pipeline.kernel(Role::March) {
            Kernel::March(march) => march.estimator.clone(),
            _ => unreachable!("a pipeline marches with a march"),
        };
        let kernel = Kernel::Estimate(estimator);
        let count = 2000;
        let spread = |k: f64| -> Vec<f64> {
            (0..count).map(|i| f64::from(((f64::from(i) * k).fract() * 4.0 - 2.0) as f32)).collect()
        };
        let mut columns = vec![spread(0.754_877_666), spread(0.569_840_29), spread(0.618_033_988)];
        columns.extend([1.0, 0.0, 0.0, 1e-4].map(|x| vec![x; count as usize]));
        columns.push((0..count).map(|i| if i % 10 == 0 { -1.0 } else { 1e-3 }).collect());
        let got = run(&gpu, &arena, &kernel, &columns);
        let expected = run(&Cpu::new(Precision::F64), &arena, &kernel, &columns);
        let mut close = 0;
        for i in 0..count as usize {
            if i % 10 == 0 {
                assert_eq!(got[0][i], 0.0, "unwanted elements are 0");
            } else {
                let (a, b) = (got[0][i], expected[0][i]);
                close += usize::from((a - b).abs() <= 1e-4 + 1e-3 * b.abs());
            }
        }
        let share = close as f64 / f64::from(count) / 0.9;
        assert!(share > 0.97, "{name}: {share} of the estimates agree");
    }
}

#[test]
fn a_slow_formula_is_dispatched_in_small_parts() {
    let Some(gpu) = gpu() else { return };
    let arena = Arena::default();
    // Never escapes, so that all of the iterations are made.
    let mut estimator = scheduled(&arena, Schedule { prefix: vec![], cycle: vec![0] }, 1, 20_000);
    for item in &mut estimator.orbits[0].items {
        let z = arena.input(0, Type::F);
        let slow = (0..20).fold(z, |z, _| z.sin().cos());
        item.outputs[0].1 = slow.id;
        item.outputs[1].1 = slow.lt(arena.f(-2.0)).id;
    }
    let points: Vec<[f64; 3]> = (0..4000).map(|i| [f64::from(i) * 0.01, 0.0, 0.0]).collect();
    let columns = Estimator::columns(&points, &[[1.0, 0.0, 0.0]], &[0.0], 0.0);
    let before = gpu.dispatches();
    let got = run(&gpu, &arena, &Kernel::Estimate(estimator), &columns);
    assert!(got[2].iter().all(|&n| n == 20_000.0));
    let dispatches = gpu.dispatches();
    println!("{dispatches:?}");
    // On any device: the first is as small as can be, and none is larger than eight times the largest before it.
    assert!(dispatches.count - before.count >= 2, "{dispatches:?}");
    assert!(dispatches.longest.as_secs() < 20, "{dispatches:?}");
}

#[test]
fn equal_kernels_are_compiled_once_and_uniforms_compile_nothing() {
    let Some(gpu) = gpu() else { return };
    let arena = Arena::default();
    let kernel = || {
        let mut function = Function::new("scaled", vec![Port::new("x", Type::F)]);
        function.output("y", arena.input(0, Type::F) * arena.uniform(0) + arena.uniform(1));
        Kernel::Map(function)
    };
    let first = gpu.prepare(&arena, &kernel()).expect("a legal kernel");
    let _ = gpu.prepare(&arena, &kernel()).expect("a legal kernel");
    let columns = gpu.upload(&[vec![1.0, 2.0]]).expect("little memory");
    for (uniforms, expected) in [([2.0, 0.5], [2.5, 4.5]), ([-1.0, 0.0], [-1.0, -2.0])] {
        let bound = gpu.bind(&first, &uniforms).expect("uniforms bind");
        let result = gpu.run(&bound, &[&columns]).and_then(|c| gpu.download(&c)).expect("it runs");
        assert_eq!(result, [expected]);
    }
    let compiling = gpu.compiling().expect("the GPU keeps account");
    assert_eq!((compiling.kernels, compiling.compiled), (2, 1));
}

/// Times for the record: `cargo test --release --lib measure -- --ignored --nocapture --test-threads 1`.
#[test]
#[ignore = "measures, checks nothing"]
fn measure() {
    println!("{:?}", adapters());
    let Some(gpu) = gpu() else { return };
    let settings = RenderSettings { size: Size { width: 640, height: 480 }, ..Default::default() };
    for name in ["mandelbulb", "mandelbox"] {
        let (arena, pipeline) = pipeline(name, &settings);
        for (kernel_name, kernel) in pipeline.kernels() {
            let start = Instant::now();
            let text = crate::kernel::wgsl::write(&arena, kernel);
            let written = start.elapsed();
            let before = gpu.cache.compiling();
            gpu.prepare(&arena, kernel).unwrap_or_else(|error| panic!("{error}"));
            let after = gpu.cache.compiling();
            println!(
                "{name} {kernel_name}: {} bytes, write {written:?}, own work {:?}, driver {:?}",
                text.len(),
                after.own - before.own,
                after.driver - before.driver
            );
        }
        let measured = measure_render(&gpu, &arena, &pipeline, &settings);
        println!("{name} gpu: {measured}");
        let measured = measure_render(&Cpu::new(Precision::F32), &arena, &pipeline, &settings);
        println!("{name} cpu f32: {measured}");
    }
}

fn measure_render<B: Backend>(backend: &B, arena: &Arena, pipeline: &Pipeline, settings: &RenderSettings) -> String {
    let mut renderer = Renderer::new(backend, arena, pipeline, settings).unwrap_or_else(|error| panic!("{error}"));
    let compile = renderer.stats.compile;
    let mut times = Vec::new();
    for _ in 0..3 {
        renderer.render(&mut |_| true).unwrap_or_else(|error| panic!("{error}"));
        times.push(renderer.stats.render);
    }
    format!("compile {compile:?}, render {times:?}, {:?}", renderer.stats)
}
