//! Joined kernels against each frame's own.

use std::sync::Arc;

use super::Templates;
use crate::expr::{Arena, Function, Port, Type};
use crate::kernel::cpu::Cpu;
use crate::kernel::{Backend, Kernel};
use crate::math::Precision;

/// `(x a + b).y`, with a vector of three numbers.
fn map(a: f64, v: [f64; 3]) -> (Arc<Arena>, Kernel) {
    let arena = Arc::new(Arena::default());
    let mut f = Function::new("f", vec![Port::new("x", Type::F)]);
    let x = arena.input(0, Type::F);
    f.output("y", x * a + 0.25);
    f.output("v", (arena.v3(v) * x).xyz());
    (arena.clone(), Kernel::Map(f))
}

fn run(cpu: &Cpu, arena: &Arena, kernel: &Kernel, uniforms: &[f64]) -> Vec<Vec<f64>> {
    let prepared = cpu.prepare(arena, kernel).expect("maps compile");
    let bound = cpu.bind(&prepared, uniforms).expect("uniforms bind");
    let columns = cpu.upload(&[vec![0.3, -7.0, 100.0]]).expect("columns fit");
    cpu.run(&bound, &[&columns]).and_then(|c| cpu.download(&c)).expect("maps run")
}

#[test]
fn frames_of_one_structure_share_a_kernel_and_keep_their_numbers() {
    let frames = [(1.5, [3.0, 4.0, 5.0]), (1.75, [3.0, 4.5, 6.0]), (-2.0, [3.0, 9.0, 4.0])];
    let mut templates = Templates::default();
    for (a, v) in frames {
        let (arena, kernel) = map(a, v);
        templates.add(&arena, &kernel);
    }
    let joined = templates.finish();
    assert_eq!(joined.families.len(), 1);
    let family = &joined.families[0];
    // What never changes stays a constant: 0.25 and the vector's x.
    assert_eq!(family.kernel.uniforms(&family.arena), 3);
    for cpu in [Precision::F32, Precision::F64].map(Cpu::new).into_iter().flat_map(|cpu| [cpu, cpu.interpreted()]) {
        for ((a, v), frame) in frames.into_iter().zip(&joined.frames) {
            let (arena, kernel) = map(a, v);
            let own = run(&cpu, &arena, &kernel, &[]);
            assert_eq!(run(&cpu, &family.arena, &family.kernel, &frame.uniforms), own, "{}", cpu.description());
        }
    }
}

#[test]
fn equal_rows_of_values_are_one_uniform() {
    let mut templates = Templates::default();
    for a in [2.0, 3.0] {
        let (arena, kernel) = map(a, [a, a, 7.0]);
        templates.add(&arena, &kernel);
    }
    let joined = templates.finish();
    assert_eq!(joined.frames[1].uniforms, [3.0]);
}

#[test]
fn what_changes_the_structure_makes_another_family() {
    let mut templates = Templates::default();
    for a in [2.0, 0.0, 1.0, 3.0, 0.0] {
        let (arena, kernel) = map(a, [1.0, 2.0, 4.0]);
        templates.add(&arena, &kernel);
    }
    let joined = templates.finish();
    let families: Vec<usize> = joined.frames.iter().map(|frame| frame.family).collect();
    assert_eq!(families, [0, 1, 2, 0, 1], "a factor of 0 or 1 is folded away");
}
