//! Machine code against the interpreter: the same results to the last bit, for every kernel of every picture.

use std::sync::Arc;

use bulbfold::compose::{Composer, Purpose, choose, compose_estimator};
use bulbfold::diag::Diagnostics;
use bulbfold::expr::Arena;
use bulbfold::formula::library::Library;
use bulbfold::graph::{EstimateSettings, Method};
use bulbfold::kernel::cpu::Cpu;
use bulbfold::kernel::{Backend, Estimator, Kernel};
use bulbfold::load::load;
use bulbfold::math::Precision;
use bulbfold::render::{Pipeline, RenderSettings, Role, compose_pipeline};
use bulbfold::shade::Size;

/// Composes the pipeline of a fractal by name.
fn with_pipeline(name: &str, size: Size, check: impl Fn(&Arena, &Pipeline)) {
    let mut library = Library::builtin();
    let mut diagnostics = Diagnostics::default();
    let loaded = load(&mut library, name, &[], &mut diagnostics).expect("built-in fractals load");
    let arena = Arc::new(Arena::default());
    let composer = Composer { arena: &arena, library: &library, graph: &loaded.graph };
    let settings = RenderSettings { size, ..RenderSettings::default() };
    let pipeline = compose_pipeline(&composer, &settings).expect("built-in fractals compose");
    check(&arena, &pipeline);
}

/// Runs a kernel both ways, compares the columns bit by bit, and gives them.
fn run_both(arena: &Arena, cpu: Cpu, label: &str, kernel: &Kernel, inputs: &[&Vec<Vec<f64>>]) -> Vec<Vec<f64>> {
    let (compiled, interpreted) = (cpu, cpu.interpreted());
    let run = |cpu: &Cpu| {
        let columns: Vec<_> = inputs.iter().map(|c| cpu.upload(c).expect("columns fit")).collect();
        let kernel = cpu.prepare(arena, kernel).expect("the CPU takes every kernel");
        let result = cpu.run(&kernel, &columns.iter().collect::<Vec<_>>()).expect("the CPU runs every kernel");
        cpu.download(&result).expect("the CPU holds every column")
    };
    let (a, b) = (run(&compiled), run(&interpreted));
    let names: Vec<String> = kernel.outputs().into_iter().map(|p| p.name).collect();
    for (i, (a, b)) in a.iter().zip(&b).enumerate() {
        for (k, (x, y)) in a.iter().zip(b).enumerate() {
            let same = x.to_bits() == y.to_bits() || x.is_nan() && y.is_nan();
            assert!(
                same,
                "{label}, {}: column {i} of {names:?}, element {k}: compiled {x}, interpreted {y}",
                cpu.description()
            );
        }
    }
    a
}

#[test]
fn machine_code_gives_the_interpreters_results_in_f32() {
    compare_sets(Precision::F32);
}

#[test]
fn machine_code_gives_the_interpreters_results_in_f64() {
    compare_sets(Precision::F64);
}

/// Every instruction set that this processor has.
fn compare_sets(precision: Precision) {
    let best = Cpu::new(precision);
    if !best.compiles() {
        eprintln!("skipped: this processor has neither AVX-512 nor AVX2, so kernels are interpreted");
        return;
    }
    compare(best);
    if best.narrow().description() != best.description() {
        compare(best.narrow());
    }
}

fn compare(cpu: Cpu) {
    let size = Size { width: 48, height: 36 };
    for name in crate::sampled::sampled(12) {
        with_pipeline(name, size, |arena, pipeline| {
            let pixels: Vec<(u32, u32)> = bulbfold::film::tiles(size).iter().flat_map(|tile| tile.pixels()).collect();
            let x = pixels.iter().map(|p| f64::from(p.0) + 0.5).collect();
            let y = pixels.iter().map(|p| f64::from(p.1) + 0.5).collect();
            let run = |part: &str, kernel: &Kernel, inputs: &[&Vec<Vec<f64>>]| {
                run_both(arena, cpu, &format!("{name}, {part}"), kernel, inputs)
            };
            let rays = run("camera", pipeline.kernel(Role::Camera), &[&vec![x, y]]);
            let hits = run("march", pipeline.kernel(Role::March), &[&rays]);
            let points = run("surface point", pipeline.kernel(Role::SurfacePoint), &[&rays, &hits]);
            let surface = run("surface", pipeline.kernel(Role::Surface), &[&points]);
            let odd = points.iter().map(|column| column[..column.len() - 5].to_vec()).collect();
            run("surface of all but five", pipeline.kernel(Role::Surface), &[&odd]);
            let Some(shadow_ray) = pipeline.passes.get(Role::ShadowRay(0)) else { return };
            let shadow_rays = run("shadow ray", shadow_ray, &[&rays, &hits, &surface]);
            let shadows = run("shadow", pipeline.kernel(Role::March), &[&shadow_rays]);
            let mut seen = vec![&rays, &hits, &surface, &shadows];
            let corners = pipeline.passes.get(Role::CornerRay).map(|ray| {
                let corner_rays = run("corner ray", ray, &[&rays, &hits, &surface]);
                run("corner", pipeline.kernel(Role::CornerMarch), &[&corner_rays])
            });
            seen.extend(&corners);
            run("colour", pipeline.kernel(Role::Colour), &seen);
        });
    }
}

/// Estimates whose states fit into registers, also with several alternating steps; a third of the lanes is not wanted.
#[test]
fn scalar_estimates_are_those_of_the_interpreter() {
    for name in ["mandelbulb", "mandelbox", "box_bulb", "sierpinski_tetrahedron"] {
        let mut library = Library::builtin();
        let loaded = load(&mut library, name, &[], &mut Diagnostics::default()).expect("built-in fractals load");
        let arena = Arc::new(Arena::default());
        let composer = Composer { arena: &arena, library: &library, graph: &loaded.graph };
        let settings = EstimateSettings { method: Some(Method::Scalar), ..EstimateSettings::default() };
        let choices = choose(&composer, &settings).expect("built-in fractals compose").choices;
        let estimator = compose_estimator(&composer, &choices, Purpose::March).expect("built-in fractals compose");
        let along = |i: usize| i as f64 * 0.39 - 7.0;
        let points: Vec<[f64; 3]> = (0..37 * 27).map(|i| [along(i % 37), along(i / 37), 0.1]).collect();
        let mut columns = Estimator::columns(&points, &[[1.0, 0.0, 0.0]], &[1e-4], 0.0);
        columns.last_mut().expect("points have columns").iter_mut().step_by(3).for_each(|threshold| *threshold = -1.0);
        for precision in [Precision::F32, Precision::F64] {
            let best = Cpu::new(precision);
            for cpu in [best, best.narrow()] {
                let kernel = Kernel::Estimate(estimator.clone());
                let found = run_both(&arena, cpu, name, &kernel, &[&columns]);
                assert!(found[0].iter().any(|&de| de > 0.1), "{name}: some points are outside");
                // Less than a block of lanes, one or two whole ones, and some more, in each precision and set.
                for len in [1, 11, 12, 16, 23, 24, 25, 32, 49] {
                    let first: Vec<Vec<f64>> = columns.iter().map(|column| column[..len].to_vec()).collect();
                    let part = run_both(&arena, cpu, name, &kernel, &[&first]);
                    let same = part.iter().zip(&found).all(|(part, all)| part[..] == all[..len]);
                    assert!(same, "{name}: the first {len} points have the estimates that they have among all");
                }
            }
        }
    }
}
